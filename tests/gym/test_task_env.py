import dataclasses

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import hugwbc.gym  # noqa: F401  registers the environments
from hugwbc import Command, Gait
from hugwbc.behaviours import Action, BehaviourSource, stand
from hugwbc.commands import default_command
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.gym import TASK_ENVIRONMENTS
from hugwbc.gym.task_action import Wish
from hugwbc.gym.task_env import TaskEnv
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import ControllerSpec, load_controller
from hugwbc.scripts.view import SeenObjects
from hugwbc.sim import Arena, Scene
from hugwbc.sim.scenes import Button, Uniform, Wall
from hugwbc.targets import HAND_FRAMES, HandTargets
from hugwbc.tasks import Milestone, load_task, shapes_of
from hugwbc.tasks.demonstration import ACTION_NAMES, OBJECTS, demonstrate, state_names
from hugwbc.tasks.replay import replay

NEAR = Scene((Button(name="button", position=(0.62, Uniform(-0.25, -0.15)), height=1.1, force=15.0, travel=0.02),))


def press(controller: str = "hold", **options: object) -> TaskEnv:
    return gymnasium.make("hugwbc/PressButton-v0", controller=controller, **options).unwrapped  # type: ignore[return-value]


def play(env: TaskEnv, seed: int, steps: int = 8) -> list[np.ndarray]:
    """Observations and rewards of an episode of random actions."""
    observation, _ = env.reset(seed=seed)
    rng, rows = np.random.default_rng(0), [observation]
    for _ in range(steps):
        observation, reward, _, _, _ = env.step(rng.uniform(-1.0, 1.0, env.action_space.shape))
        rows.append(np.append(observation, reward))
    return rows


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", TASK_ENVIRONMENTS)
def test_gymnasiums_checker_is_content(name):
    env = gymnasium.make(name, controller="hold", disable_env_checker=True).unwrapped
    if TASK_ENVIRONMENTS[name] in ("fetch_box", "carry_tray", "press_button"):  # one for each way to grip
        check_env(env, skip_render_check=True)
    assert env.reset(seed=3)[1]["score"] == 0.0


def test_the_same_seed_is_the_same_episode():
    env = press("learned")
    first, other = play(env, 3), play(env, 4)
    for again in (play(env, 3), play(press("learned"), 3)):
        assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0], other[0])


def test_without_a_seed_every_episode_is_another_one():
    env = press()
    env.reset(seed=3)
    seeds = [env.reset()[1]["seed"] for _ in range(3)]
    assert len(set(seeds)) == 3 and min(seeds) >= 3000, "neither seeds of selection nor of reports"
    env.reset(seed=3)
    assert [env.reset()[1]["seed"] for _ in range(3)] == seeds


def test_the_robot_stands_by_its_own_defaults_before_the_first_action():
    env = press(arena=Arena(robot="g1"))
    env.reset(seed=3)
    assert env.view.last.command == default_command(Gait.STANDING, load_robot("g1"))


def test_bad_numbers_do_no_harm():
    env = press("learned")
    env.reset(seed=3)
    size = len(env.actions.names)
    for action in (np.full(size, np.nan), np.full(size, np.inf), np.full(size, -np.inf), np.full(size, 1e30)):
        observation, reward, terminated, _, _ = env.step(action)
        assert env.observation_space.contains(observation) and np.isfinite(reward) and not terminated


def test_a_fall_ends_the_episode_and_the_rewards_are_what_the_score_grew_by():
    env = press()
    _, info = env.reset(seed=3)
    start, total, terminated = info["score"], 0.0, False
    walk = env.actions.encode(Wish(used=np.array([True, True]), points=np.array([[0.7, 0.6, 0.6], [0.7, -0.6, -0.5]])))
    for _ in range(100):
        _, reward, terminated, truncated, info = env.step(walk)
        total += reward
        if terminated or truncated:
            break
    assert terminated and not truncated and not info["success"] and info["reason"] == "the robot fell"
    assert total == pytest.approx(info["score"] - start)


def test_the_time_limit_truncates():
    env = press("learned", limit=0.3)
    env.reset(seed=3)
    ends = [env.step(env.actions.rest)[1:] for _ in range(3)]
    assert [(terminated, truncated) for _, terminated, truncated, _ in ends] == [(False, False)] * 2 + [(False, True)]
    assert ends[-1][3]["reason"] == "the time was over: no hand touched the button"
    assert ends[-1][3]["time"] == 0.3


def test_a_success_just_before_the_time_limit_says_so():
    late = dataclasses.replace(
        load_task("press_button"), milestones=(Milestone("not yet", lambda record: float(record.time[-1] > 0.15)),)
    )
    env = TaskEnv(late, "hold", limit=0.2)
    env.reset(seed=3)
    *_, truncated, info = [env.step(env.actions.rest) for _ in range(2)][-1]
    assert truncated and info["score"] == 1.0 and not info["success"]
    assert info["reason"] == "the time was over: done for less than 1 s"


def test_a_judge_gets_its_samples_from_slow_controllers_too(tmp_path):
    """Speeds and durations are of samples 0.02 s apart."""
    slow = tmp_path / "slow.py"
    slow.write_text(
        "from hugwbc.runtime.controllers import HoldController\n"
        "class Slow(HoldController):\n    name, period = 'slow', 0.05\n"
    )
    times: list[np.ndarray] = []
    noting = Milestone("it is early", lambda record: times.append(record.time) or 0.0)
    env = TaskEnv(dataclasses.replace(load_task("press_button"), milestones=(noting,)), f"{slow}:Slow")
    env.reset(seed=3)
    for _ in range(2):
        env.step(env.actions.rest)
    np.testing.assert_allclose(times[-1], 0.02 * np.arange(11), atol=1e-9)


def test_an_observation_is_what_a_robot_has():
    env = press("learned", arena=Arena(sensing="exact", drives="ideal"))
    observation, _ = env.reset(seed=3)
    assert env.observation_space.contains(observation)
    simulation = env._simulation
    assert simulation is not None
    part = {name: observation[place] for name, place in env.observations.fields.items()}
    assert sum(value.size for value in part.values()) == observation.size
    truth = simulation.objects["button"]
    np.testing.assert_allclose(part["object/button"][:3], truth.position - simulation.qpos[:3], atol=1e-5)
    np.testing.assert_allclose(part["q"], simulation.qpos[7:] - load_robot().nominal, atol=1e-5)
    hands = np.ravel([simulation.hand_position(side) - simulation.qpos[:3] for side in ("left", "right")])
    np.testing.assert_allclose(part["hands"], hands, atol=1e-4)
    button = shapes_of(load_task("press_button").scene.draw(3))["button"]
    told = [number for value in button.values() for number in np.ravel(value)]
    np.testing.assert_allclose(part["shape/button"], told, atol=1e-6)
    for _ in range(15):
        observation, *_ = env.step(env.actions.encode(Wish(Command(v_x=0.3, gait=Gait.WALKING))))
    part = {name: observation[place] for name, place in env.observations.fields.items()}
    assert part["walk"] == 1.0 and part["command"][0] == pytest.approx(0.3)
    np.testing.assert_allclose(part["velocity"], simulation.qvel[:3], atol=0.05)
    assert part["velocity"][0] > 0.1 and part["time"] == pytest.approx(1.5 / 60.0)


@pytest.mark.parametrize("actions", ["scaled", "recorded"])
def test_objects_that_are_not_seen_are_zeros(actions, monkeypatch):
    env = press(actions=actions)
    env.reset(seed=3)
    monkeypatch.setattr("hugwbc.runtime.sight.Sight._objects", lambda self, picture, age: SeenObjects())
    observation, *_ = env.step(env.actions.rest)
    assert env.observation_space.contains(observation)
    seen = observation[OBJECTS] if actions == "recorded" else observation[env.observations.fields["object/button"]]
    assert not seen.any()


def test_many_run_one_after_another_in_a_sync_vector():
    envs = gymnasium.make_vec("hugwbc/PressButton-v0", num_envs=2, controller="hold", limit=0.2)
    assert isinstance(envs, gymnasium.vector.SyncVectorEnv)
    observations, info = envs.reset(seed=5)
    assert observations.shape == envs.observation_space.shape and info["seed"].tolist() == [5, 6]
    for _ in range(2):
        _, _, _, truncated, _ = envs.step(envs.action_space.sample())
    assert truncated.all()
    envs.close()


def test_a_scene_and_a_task_of_ones_own(tmp_path):
    env = press(scene=NEAR)
    observation, _ = env.reset(seed=3)
    assert observation[env.observations.fields["object/button"]][0] == pytest.approx(0.62, abs=0.02)
    own = tmp_path / "own.py"
    own.write_text(
        "import dataclasses\nfrom hugwbc.tasks.press_button import TASK\nTASK = dataclasses.replace(TASK, limit=1.0)\n"
    )
    env = gymnasium.make("hugwbc/Task-v0", task=str(own), controller="hold").unwrapped
    env.reset(seed=3)
    assert env.task.limit == 1.0  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"controller": "none"}, UnknownNameError, "unknown controller"),
        ({"actions": "recorder"}, UnknownNameError, "Did you mean 'recorded'"),
        ({"limit": 0.0}, ConfigError, "limit is 0.0 s"),
        ({"limit": float("nan")}, ConfigError, "limit is nan s"),
        ({"arena": "g1"}, ConfigError, "arena is .g1.; give an Arena"),
        ({"scene": Scene((Wall(name="wall", position=(2.0, 0.0)),))}, ConfigError, "the scene has no button"),
    ],
)
def test_bad_options_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        TaskEnv("press_button", **({"controller": "hold"} | options))


def test_a_view_says_how_the_robot_walks_as_in_a_run():
    env = press("learned")
    env.reset(seed=3)
    np.testing.assert_array_equal(env.view.stop, load_controller("learned").stop)
    assert env.view.stop.any()
    for _ in range(3):
        env.step(env.actions.encode(Wish(command=Command(v_x=0.3, gait=Gait.WALKING))))
    assert env.view.lag[0] > 0.0, "it has only begun to walk"


def test_what_cannot_be_rendered_and_a_step_before_a_reset_are_refused():
    with pytest.raises(ConfigError, match="hugwbc play --task"):
        TaskEnv("press_button", "hold", render_mode="human")
    env = TaskEnv("press_button", "hold")
    with pytest.raises(ConfigError, match=r"options of reset are \{'randomize': True\}, but none are known"):
        env.reset(options={"randomize": True})
    with pytest.raises(ConfigError, match="call reset first"):
        env.step(env.actions.rest)


@pytest.mark.slow
def test_the_tasks_own_behaviour_presses_the_button_by_these_actions():
    env = press("learned", scene=NEAR)
    env.reset(seed=3)
    behaviour = BehaviourSource(env.behaviour)
    total, over, info = 0.0, False, {}
    while not over:
        view = env.view
        _, reward, terminated, truncated, info = env.step(env.actions.encode(Wish.of(behaviour.act(view), view)))
        total, over = total + reward, terminated or truncated
    assert info["success"] and info["reason"] == "" and total == pytest.approx(1.0)


def reach_out(view):
    """Lean and walk on the spot, reach to a point of the world with a direction, and squeeze softly."""
    view = yield from stand(view, 0.06)
    for share in np.linspace(0.0, 1.0, 20):
        hands = HandTargets.of(
            (0.4 + 0.1 * share, 0.3, 1.1),
            (0.4, -0.3, 1.1),
            "world",
            left_direction=(1.0, 0.0, 0.2),
            left_force=(0.0, 5.0 * share, 0.0),
            stiffness=400.0,
        )
        view = yield Action(Command(f=1.7, l=0.2, w=0.3, gait=Gait.WALKING), hands, doing="reach")
    return view


@pytest.mark.parametrize("robot", ["h1", "g1"])
def test_recorded_actions_do_the_same_again(robot):
    """An episode of 0.5 s is recorded, replayed, and played step by step in the environment: the same states."""
    given, arena = load_task("press_button"), Arena(robot=robot)
    task = dataclasses.replace(given, behaviour=lambda view, shapes: reach_out(view), limit=0.5)
    task = task.sized(arena.known_robot)
    controller = ControllerSpec("learned").told(arena).build()
    simulation = arena.simulation(seed=5, scene=task.scene)
    told = demonstrate(task, controller, simulation, seed=5)
    height = told.state[0, state_names(arena.known_robot).index("base.z")]
    assert height == pytest.approx(arena.known_robot.nominal_height, abs=0.02), "in the robot's own lengths"
    rows = told.action.astype(np.float32)
    again = replay(task, controller, arena.simulation(seed=5, scene=task.scene), rows, seed=5)
    assert len(rows) >= 20 and again.verdict.reason == told.verdict.reason
    assert again.verdict.score == pytest.approx(told.verdict.score, abs=1e-6)
    np.testing.assert_allclose(again.state[: len(rows)], told.state, atol=1e-3)
    env = TaskEnv(given, "learned", actions="recorded", arena=arena)
    observation, _ = env.reset(seed=5)
    for row, state, objects in zip(rows, told.state, told.objects, strict=True):
        assert env.observation_space.contains(observation)
        np.testing.assert_allclose(observation["observation.state"], state, atol=1e-3)
        np.testing.assert_allclose(observation["observation.environment_state"], objects.ravel(), atol=1e-6)
        observation, *_, info = env.step(row)
    assert info["time"] == pytest.approx(0.02 * len(rows))


def test_a_recorded_action_that_is_repeated_keeps_to_its_place():
    """Each repetition would move a target of the world along with the robot."""
    env = press("learned", actions="recorded")
    env.reset(seed=3)
    action = env.actions.rest.copy()
    asked = {
        "gait": 1.0,
        "left_hand.given": 1.0,
        "left_hand.x": 0.3,
        "left_hand.y": 0.2,
        "frame": HAND_FRAMES.index("world"),
    }
    for name, value in asked.items():
        action[ACTION_NAMES.index(name)] = value
    places, moved = [], []
    for x in (0.30, 0.31):
        action[ACTION_NAMES.index("left_hand.x")] = x
        for _ in range(5):
            env.step(action)
            view = env.view
            assert view.last.hands is not None
            places.append(view.last.hands.left)
            moved.append(view.position)
    assert np.ptp(moved[:5], axis=0).max() > 1e-4, "the robot sways"
    for first, *others in (places[:5], places[5:]):
        assert all(np.array_equal(first, other) for other in others)
    assert not np.array_equal(places[0], places[5])


@pytest.mark.parametrize("seed", range(5))
def test_no_recorded_action_stops_the_environment(seed):
    env = press(actions="recorded")
    env.reset(seed=3)
    rng = np.random.default_rng(seed)
    for scale in (1.0, 100.0, np.inf, np.nan):
        observation, reward, *_, info = env.step(scale * rng.normal(size=env.action_space.shape))
        assert np.isfinite(observation["observation.state"]).all() and np.isfinite(reward)
        assert "raised" not in info["reason"]
