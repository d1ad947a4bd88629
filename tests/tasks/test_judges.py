"""The milestones of each task, on made-up records: what is a success, and what is missing otherwise."""

import dataclasses
import math

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.behaviours import stand
from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.evaluation.experiments.behaviours import task_of
from hugwbc.gym.task_env import TaskEnv
from hugwbc.runtime.controllers import HoldController
from hugwbc.sim import Scene, Simulation
from hugwbc.sim.scenes import Box, Cylinder, Table
from hugwbc.tasks import TASK_NAMES, Milestone, Task, load_task, run_task
from hugwbc.tasks.judges import at_rest, happened, lifted, stands_on, touched, trunk_clear
from hugwbc.tasks.wipe_table import CORNERS, path_points

BOX = Box(name="box", on="table", size=(0.2, 0.2, 0.2))
LEFT, RIGHT, BOTH = (("left_hand",), ("right_hand",), ("left_hand", "right_hand"))


def verdict_of(name, record):
    return load_task(name).judge(record)


def touching(*bodies, links=BOTH):
    return {(link, body): 1.0 for link in links for body in bodies}


def path(start, *legs):
    """Positions that stay, then go through points, each at a fifth of the time, shape (1000, 3)."""
    points = np.array([start, start, *legs])
    at = np.linspace(0.0, 0.8, len(points))
    return np.stack([np.interp(np.linspace(0, 1, 1000), at, points[:, axis]) for axis in range(3)], axis=1)


def moved(record, body, positions, turn=None):
    poses = dict(record.poses)
    changed = poses[body].copy()
    changed[:, :3] = positions
    if turn is not None:
        changed[len(changed) // 2 :, 3:] = rotations.multiply(changed[0, 3:], turn)
    poses[body] = changed
    return dataclasses.replace(record, poses=poses)


@pytest.mark.parametrize("name", TASK_NAMES)
def test_nothing_is_no_success(name, made_up):
    verdict = verdict_of(name, made_up(name))
    assert not verdict.success and verdict.reason and 0.0 <= verdict.score < 0.5


def test_a_button_that_is_pressed_and_let_go(made_up):
    travel = 0.02 * np.sin(np.linspace(0.0, math.pi, 1000))
    pressed = made_up("press_button", travel={"button": travel}, touched=touching("button", links=RIGHT))
    assert verdict_of("press_button", pressed).success
    half = dataclasses.replace(pressed, travel={"button": 0.5 * travel})
    assert verdict_of("press_button", half).reason == "the button was not pressed all the way"
    kept = dataclasses.replace(pressed, travel={"button": np.full(1000, 0.02)})
    assert verdict_of("press_button", kept).reason == "the button was not released"
    bumped = dataclasses.replace(pressed, touched={**pressed.touched, ("trunk", "button/panel"): 3.0})
    assert verdict_of("press_button", bumped).reason == "the trunk ran into the panel"


def test_a_box_that_is_fetched(made_up):
    still = made_up("fetch_box", touched=touching("box"))
    start, bench = still.poses["box"][0, :3], still.poses["bench"][0, :3]
    height = still.thing("bench").height + 0.11
    goal = np.array([bench[0], bench[1] - 0.1, height])
    up = [0.0, 0.0, 0.2]
    assert verdict_of("fetch_box", moved(still, "box", path(start, start + up, goal + up, goal))).success
    off = goal + np.array([0.15, 0.0, 0.0])
    far = moved(still, "box", path(start, start + up, off + up, off))
    assert verdict_of("fetch_box", far).reason == "the box stands more than 10 cm off its place"
    fallen = moved(still, "box", path(start, start + up, [0.5, 1.0, 0.11]))
    assert verdict_of("fetch_box", fallen).reason == "the box was dropped"
    lying = rotations.from_yaw_pitch_roll(0, 0, math.pi / 2)
    tipped = moved(still, "box", path(start, start, start + 0.4 * np.array(up)), lying)
    assert verdict_of("fetch_box", tipped).reason == "the box was not lifted"
    held = moved(still, "box", path(start, start + up, goal + up))
    assert verdict_of("fetch_box", held).reason == "the box does not stand on the other table"
    on_its_side = moved(
        still, "box", path(start, start + up, goal + up, goal), rotations.from_yaw_pitch_roll(0, 0, math.pi / 2)
    )
    assert verdict_of("fetch_box", on_its_side).reason == "the box is not upright"
    pressing = np.zeros((1000, 2, 3))
    pressing[-1, 0, 1] = 20.0
    grasped = dataclasses.replace(moved(still, "box", path(start, start + up, goal + up, goal)), hand_force=pressing)
    assert verdict_of("fetch_box", grasped).success  # a hand on the robot's own thigh
    grasped = dataclasses.replace(grasped, hand_touches=np.abs(pressing).any(axis=2))
    assert verdict_of("fetch_box", grasped).reason == "a hand still touched something at the end"


def test_a_box_on_a_table_does_not_stand_on_another_one_that_is_as_high(made_up):
    still = made_up("fetch_box")
    start, bench = still.poses["box"][0], still.poses["bench"][0]
    beside = np.array([*start[:2], still.thing("bench").height + 0.11])
    assert not stands_on(moved(still, "box", path(beside)), "box", "bench")
    there = beside * [0.0, 0.0, 1.0] + bench[:3] * [1.0, 1.0, 0.0]
    assert stands_on(moved(still, "box", path(there)), "box", "bench")
    scene = Scene((Table(name="desk", position=(0.8, 0.0)), Cylinder(name="cup", on="desk", radius=0.04, height=0.1)))
    assert stands_on(made_up(scene), "cup", "desk")
    apart = Scene((Table(name="desk", position=(0.8, 0.0)), Table(name="other", position=(3.0, 0.0))))
    with pytest.raises(ConfigError, match="'other' is a table; name a box, a cylinder or a tray"):
        stands_on(made_up(apart), "other", "desk")
    with pytest.raises(ConfigError, match="'cart' is a cart; name a table, a step, a box or a tray"):
        stands_on(made_up("push_cart"), "cart", "cart")


def test_a_box_that_is_delivered_through_a_door(made_up):
    still = made_up("deliver_box", touched=touching("box"), travel={"door": np.full(1000, 1.2)})
    bench, start, up = still.poses["bench"][0], still.poses["box"][0, :3], [0.0, 0.0, 0.2]
    goal = np.array([bench[0], bench[1] - 0.1, still.thing("bench").height + 0.11])
    carried = moved(still, "box", path(start, start + up, goal + up, goal))
    assert verdict_of("deliver_box", carried).reason == "the robot did not get through the door"
    walk = still.pelvis.copy()
    walk[:, 1] = np.minimum(np.linspace(0.0, 4.2, 1000), 3.8)
    through = dataclasses.replace(carried, pelvis=walk)
    assert verdict_of("deliver_box", through).success
    shut = dataclasses.replace(through, travel={"door": np.full(1000, 0.1)})
    assert verdict_of("deliver_box", shut).reason == "the door was not pushed open"


def test_a_box_that_is_held_at_the_chest(made_up):
    still = made_up("lift_from_stool", touched=touching("box"))
    start = still.poses["box"][0, :3]
    assert verdict_of("lift_from_stool", moved(still, "box", path(start, [0.4, 0.0, 1.25]))).success
    low = moved(still, "box", path(start, [0.4, 0.0, 0.8]))
    assert verdict_of("lift_from_stool", low).reason == "the box was not brought to the chest"
    away = path(start, [0.4, 0.0, 1.25], [0.4, 0.0, 0.7])
    assert (
        verdict_of("lift_from_stool", moved(still, "box", away)).reason == "the box was not held at the chest for 5 s"
    )
    one = dataclasses.replace(moved(still, "box", path(start, [0.4, 0.0, 1.25])), touched=touching("box", links=LEFT))
    assert verdict_of("lift_from_stool", one).reason == "a hand did not touch the box"


def test_a_cart_that_is_pushed(made_up):
    still = made_up("push_cart", touched=touching("cart"))
    start = still.poses["cart"][0]
    ahead = rotations.to_matrix(start[3:])[:, 0]
    assert verdict_of("push_cart", moved(still, "cart", path(start[:3], start[:3] + 2.1 * ahead))).success
    short = moved(still, "cart", path(start[:3], start[:3] + 1.5 * ahead))
    assert verdict_of("push_cart", short).reason == "the cart was not pushed 2 m"
    far = moved(still, "cart", path(start[:3], start[:3] + 2.5 * ahead))
    assert verdict_of("push_cart", far).reason == "the cart stands more than 20 cm off its goal"
    turn = rotations.from_yaw_pitch_roll(math.radians(15.0), 0.0, 0.0)
    askew = moved(still, "cart", path(start[:3], start[:3] + 2.0 * ahead), turn)
    assert verdict_of("push_cart", askew).reason == "the cart has turned by more than 10 degrees"


def test_a_door_that_is_walked_through(made_up):
    still = made_up("open_door", touched=touching("door"), travel={"door": np.full(1000, 1.2)})
    walk = still.pelvis.copy()
    walk[:, 0] = np.linspace(0.0, 2.5, 1000)
    through = dataclasses.replace(still, pelvis=walk)
    assert verdict_of("open_door", through).success
    assert verdict_of("open_door", still).reason == "the robot did not get through the door"
    around, back = walk.copy(), walk.copy()
    around[:, 1] = 2.0 * np.sin(np.linspace(0.0, math.pi, 1000))
    beside = verdict_of("open_door", dataclasses.replace(still, pelvis=around))
    assert beside.reason == "the robot did not get through the door" and beside.score < 0.75
    back[:, 0] = np.interp(np.linspace(0.0, 4.2, 1000), [0, 1, 2, 3, 4], [0.0, 2.5, 2.5, 0.0, 2.5])
    back[:, 1] = np.interp(np.linspace(0.0, 4.2, 1000), [0, 1, 2, 3, 4], [0.0, 3.0, 3.0, 0.0, 0.0])
    assert verdict_of("open_door", dataclasses.replace(still, pelvis=back)).success, "round it, back, and through"
    bumped = dataclasses.replace(through, touched={**still.touched, ("trunk", "door/frame"): 3.0})
    assert verdict_of("open_door", bumped).reason == "the trunk touched the frame"
    shut = dataclasses.replace(through, travel={"door": np.full(1000, 0.1)})
    assert verdict_of("open_door", shut).reason == "the door was not pushed open"


def test_a_drawer_that_is_pulled_open(made_up):
    held = np.full((1000, 2), -1)
    held[300:700, 1] = 0
    opened = made_up("open_drawer", held=held, travel={"drawer": np.linspace(0.0, 0.26, 1000)})
    assert verdict_of("open_drawer", opened).success
    assert opened.gripped == ("drawer",)
    less = dataclasses.replace(opened, travel={"drawer": np.linspace(0.0, 0.2, 1000)})
    assert verdict_of("open_drawer", less).reason == "the drawer was not pulled open by 25 cm"
    alone = dataclasses.replace(opened, held=np.full((1000, 2), -1))
    assert verdict_of("open_drawer", alone).reason == "no hand got hold of the handle"


def test_a_tray_that_is_carried(made_up):
    still = made_up("carry_tray")
    names = still.scene.body_names
    held = np.full((1000, 2), names.index("tray"))
    start = still.poses["tray"][0, :3]
    up = np.array([0.0, 0.0, 0.05])
    way = path(start, start + up, start + up + [-1.0, 0.0, 0.0], start + up + [-1.0, 2.2, 0.0])
    cup = way + still.poses["tray/cup"][0, :3] - start
    pelvis = still.pelvis.copy()
    pelvis[700:, 3:] = rotations.from_yaw_pitch_roll(1.5, 0.0, 0.0)
    carried = moved(moved(dataclasses.replace(still, held=held, pelvis=pelvis), "tray", way), "tray/cup", cup)
    assert verdict_of("carry_tray", carried).success
    by_the_cup = held.copy()
    by_the_cup[:, 1] = names.index("tray/cup")
    steadied = dataclasses.replace(carried, held=by_the_cup)
    assert verdict_of("carry_tray", steadied).reason == "the hands did not get hold of the tray"
    late = held.copy()
    late[:900] = -1
    assert not verdict_of("carry_tray", dataclasses.replace(carried, held=late)).success, "pushed, and turned before"
    straight = dataclasses.replace(carried, pelvis=still.pelvis)
    assert verdict_of("carry_tray", straight).reason == "the robot did not turn the corner"
    tipped = moved(carried, "tray/cup", cup, rotations.from_yaw_pitch_roll(0.0, 0.5, 0.0))
    assert verdict_of("carry_tray", tipped).reason == "the cup fell over"
    lost = moved(carried, "tray/cup", still.poses["tray/cup"][0, :3])
    assert verdict_of("carry_tray", lost).reason == "the cup fell over"


def test_the_path_on_the_table_is_one_metre():
    assert np.linalg.norm(np.diff(CORNERS, axis=0), axis=1).sum() == pytest.approx(1.0)
    assert np.linalg.norm(np.diff(path_points(), axis=0), axis=1).max() <= 0.0101


def test_a_table_that_is_wiped(made_up):
    still = made_up("wipe_table", touched=touching("table", links=RIGHT))
    pose, yaw = still.poses["table"][0], still.yaw("table")[0]
    points = path_points()[np.linspace(0, len(path_points()) - 1, 1000).round().astype(int)]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    hands, force = still.hands.copy(), np.zeros((1000, 2, 3))
    hands[:, 1, :2] = pose[:2] + (points - [0.3, 0.0]) @ turn.T
    force[:, 1, 2] = 15.0
    wiped = dataclasses.replace(still, hands=hands, hand_force=force, hand_touches=np.ones((1000, 2), dtype=bool))
    assert verdict_of("wipe_table", wiped).success
    above = dataclasses.replace(wiped, hand_touches=np.zeros((1000, 2), dtype=bool))  # a hand that presses on the other
    assert not verdict_of("wipe_table", above).success
    for newton in (2.0, 40.0):
        force = np.zeros((1000, 2, 3))
        force[:, 1, 2] = newton
        wrong = verdict_of("wipe_table", dataclasses.replace(wiped, hand_force=force))
        assert wrong.reason == "less than 90 % of the path was wiped with 5 to 25 N"
    force[::20, 1, 2] = 15.0  # for one sample of 0.4 s, and 40 N in the others
    assert not verdict_of("wipe_table", dataclasses.replace(wiped, hand_force=force)).success
    gap = np.zeros((1000, 2, 3))
    gap[:700, 1, 2] = 15.0
    assert not verdict_of("wipe_table", dataclasses.replace(wiped, hand_force=gap)).success


def test_a_box_that_is_put_on_another(made_up):
    still = made_up("stack_boxes", touched=touching("upper"))
    start, lower = still.poses["upper"][0, :3], still.poses["lower"][0, :3]
    top = lower + np.array([0.02, 0.0, 0.16])
    up = [0.0, 0.0, 0.3]
    assert verdict_of("stack_boxes", moved(still, "upper", path(start, start + up, lower + up, top))).success
    beside = moved(still, "upper", path(start, start + up, start + np.array([0.0, 0.1, 0.0])))
    assert verdict_of("stack_boxes", beside).reason == "the box does not stand on the other one"
    edge = moved(still, "upper", path(start, start + up, top + np.array([0.0, 0.1, 0.0])))
    assert verdict_of("stack_boxes", edge).reason == "the boxes are not in line"


def test_a_box_that_is_put_back_where_it_stood(made_up):
    task = task_of(2.0, 0.6, 60.0)
    still = made_up(task.scene)
    start, up = still.poses["box"][0, :3], np.array([0.0, 0.0, 0.2])

    def reason(end, turn=None):
        return task.judge(moved(still, "box", path(start, start + up, start + end), turn)).reason

    assert task.judge(still).reason == "the box was not lifted"
    assert reason([0.05, -0.05, 0.01]) == ""
    assert reason([0.0, 0.0, 0.2]) == "the box does not stand on the block"
    assert reason([0.08, -0.08, 0.0]) == "the box stands more than 10 cm off its place"
    assert reason([0.0, 0.0, 0.0], rotations.from_yaw_pitch_roll(0, math.pi / 2, 0)) == "the box is not upright"


def test_weights_that_are_held(made_up):
    still = made_up("hold_payload")
    names = still.scene.body_names
    held = np.full((1000, 2), -1)
    held[200:, 0], held[200:, 1] = names.index("left-weight"), names.index("right-weight")
    way = path([0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, 0.1])[:, None] * [1.0, 1.0, 1.0]
    way[300:] = [0.0, 0.0, 0.1]
    lifted = dataclasses.replace(still, held=held, hands=still.hands + way)
    for name in ("left-weight", "right-weight"):
        lifted = moved(lifted, name, still.poses[name][0, :3] + way[:, 0])
    assert verdict_of("hold_payload", lifted).success
    sagging = dataclasses.replace(
        lifted, hands=lifted.hands - np.where(np.arange(1000) > 500, 0.05, 0.0)[:, None, None]
    )
    assert verdict_of("hold_payload", sagging).reason == "the hands were not within 3 cm for 10 s"
    one = dataclasses.replace(lifted, held=np.where(np.arange(2) == 0, held, -1))
    assert verdict_of("hold_payload", one).reason == "a weight was not taken"


def refused(make, *words):
    with pytest.raises(HugwbcError) as error:
        make()
    assert all(word in str(error.value) for word in words), str(error.value)


def test_arguments_of_milestones_in_a_wrong_order_or_of_a_wrong_kind_are_refused_at_once():
    refused(lambda: lifted("box", 0.05, "the box was not lifted"), "height is 'the box was not lifted'", "0.05")  # type: ignore[arg-type]
    refused(lambda: at_rest("box", 0.05), "missed is 0.05", "'the box was not lifted'")  # type: ignore[arg-type]
    refused(lambda: lifted("box", "low", -0.1), "height is -0.1", "metres")
    refused(lambda: touched(BOX, "no touch"), "body is Box", "give the name")  # type: ignore[arg-type]
    refused(lambda: happened("no", lambda record: True), "missed is <function")  # type: ignore[arg-type]
    refused(lambda: Milestone("no", 1.0), "progress of 'no' is 1.0", "give a function of a TaskRecord")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("later", "words"),
    [
        (lifted("bok", "it was not lifted"), ("unknown body of the scene 'bok'. Did you mean 'box'?",)),
        (trunk_clear("tabel", "the trunk touched it"), ("unknown body", "Did you mean 'table'")),
        (happened(lambda record: stands_on(record, "box", "tabel"), "no"), ("object of the scene", "mean 'table'")),
        (Milestone("no", lambda record: record.travel["x"]), ("'no' cannot be judged: KeyError: 'x' (test_judges.py",)),
        (Milestone("no", lambda record: None), ("'no' cannot be judged", "give a number from 0 to 1")),  # type: ignore[arg-type,return-value]
    ],
)
def test_a_milestone_that_cannot_be_judged_is_said_in_the_first_sample(later, words):
    """Although an earlier one is missed then."""
    scene = Scene((Table(name="table", position=(0.7, 0.0)), BOX))
    task = Task(
        name="small",
        about="Nothing.",
        scene=scene,
        behaviour=lambda view, shapes: stand(view, 50.0),
        limit=60.0,
        milestones=(Milestone("it is early", lambda record: record.time[-1] / 60.0), later),
    )
    simulation = Simulation(sensing="exact", scene=scene)
    refused(lambda: run_task(task, HoldController(load_robot()), simulation), *words)
    assert simulation.time == 0.0
    refused(lambda: TaskEnv(task, "hold").reset(seed=3), *words)
