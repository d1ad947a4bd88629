import dataclasses
import math
import time

import numpy as np
import pytest

from hugwbc import load_robot, rotations
from hugwbc.kinematics import Kinematics
from hugwbc.robot import load_mirror
from hugwbc.scripts.script import load_script
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK, ArmIKConfig
from hugwbc.upper_ik.solver import LONGEST_TICK
from tests.conftest import make_state

DT = 0.02
COMFORTABLE = np.array([[0.35, 0.2, 0.15], [0.3, -0.25, 0.05]])


def converge(ik, targets, state, seconds=3.0, dt=DT):
    solution = ik.solve(targets, state, dt)
    for _ in range(round(seconds / dt)):
        solution = ik.solve(targets, state, dt)
        assert solution.ok
    return solution


def shoulder_to_targets(points):
    """From each shoulder's centre in the pelvis frame, at waist angle 0 (h1.yaml: joint offsets, added by hand)."""
    return points - np.array([[0.0, 0.2136, 0.4389], [0.0, -0.2136, 0.4389]])


@pytest.fixture
def ik():
    return ArmIK(load_robot())


TURN = rotations.from_yaw_pitch_roll(0.3, -0.3, 0.2)


@pytest.mark.parametrize(
    ("orientation", "frame"), [(TURN, "pelvis"), (TURN, "heading"), (-TURN, "heading"), ("level", "pelvis")]
)
def test_an_arm_of_seven_joints_brings_its_hand_to_a_place_and_an_orientation(orientation, frame):
    """Checked with Pinocchio on the whole robot, whose pelvis leans."""
    robot = load_robot("g1")
    state = make_state(robot.nominal, yaw=0.5, pitch=0.2, roll=-0.1, position=np.zeros(3))
    ik, kinematics = ArmIK(robot), Kinematics(robot)
    targets = HandTargets.of((0.26, 0.15, 0.1), (0.26, -0.15, 0.15), frame, left_orientation=orientation)
    solution = converge(ik, targets, state)
    assert solution.residual.max() < 0.001 and solution.ok
    q = robot.nominal.copy()
    q[robot.arms] = solution.q
    kinematics.update(make_state(q, yaw=0.5, pitch=0.2, roll=-0.1, position=np.zeros(3)))
    hand = kinematics.rotation("left_hand")
    if isinstance(orientation, str):
        assert hand[2, 2] > math.cos(0.01), "its z axis points up"
    else:
        axes = rotations.to_matrix(state.orientation) if frame == "pelvis" else rotations.rotation_z(0.5)
        assert np.trace((axes @ rotations.to_matrix(TURN)).T @ hand) > 1.0 + 2.0 * math.cos(0.01)


@pytest.mark.parametrize(
    ("point", "orientation", "off"),
    [
        ((0.3, 0.2, 0.2), rotations.from_yaw_pitch_roll(0.0, -math.pi / 2, 0.0), 0.06),
        ((0.2, 0.3, -0.25), "level", 0.25),
    ],
    ids=["fingers up", "level, low"],
)
def test_an_arm_comes_to_rest_where_it_cannot_have_both_place_and_orientation(point, orientation, off):
    robot = load_robot("g1")
    ik, state = ArmIK(robot), make_state(robot.nominal)
    targets = HandTargets.of(point, None, left_orientation=orientation)
    converge(ik, targets, state, seconds=4.0)
    moves = [np.abs(ik.solve(targets, state, DT).dq).max() for _ in range(round(1.0 / DT))]
    assert max(moves) < 0.3 and ik.solve(targets, state, DT).residual[0] < off


def test_an_orientation_is_for_one_hand_and_ends_with_its_targets():
    robot = load_robot("g1")
    state, points = make_state(robot.nominal), ((0.25, 0.2, 0.1), (0.25, -0.2, 0.1))
    plain = converge(ArmIK(robot), HandTargets.of(*points), state, seconds=1.0)
    ik = ArmIK(robot)
    level = converge(ik, HandTargets.of(*points, left_orientation="level"), state, seconds=1.0)
    assert level.q.reshape(2, -1)[1] == pytest.approx(plain.q.reshape(2, -1)[1], abs=1e-3), "the right arm"
    ik.reset(robot.nominal[robot.arms])
    again = converge(ik, HandTargets.of(*points), state, seconds=1.0)
    assert again.q == pytest.approx(plain.q, abs=1e-9)


@pytest.mark.parametrize("name", ["h1", "g1"])
def test_hands_stay_where_they_are_while_the_trunk_turns_to_and_fro(name):
    """By 0.2 rad at 12 rad/s, as a trunk may in a walk: a braking hand alone lags by v^2 / (2 * 6 m/s^2), some 5 cm."""
    robot = load_robot(name)
    ik, q, errors = ArmIK(robot), robot.nominal.copy(), []
    for t in np.arange(0.0, 1.6, 0.004):
        q[robot.waist] = 0.2 * math.sin(12.0 * t)
        errors.append(ik.solve(HandTargets((0.28, 0.18, 0.1), (0.28, -0.18, 0.1)), make_state(q), 0.004).residual)
    assert np.max(errors[250:]) < 0.003


def test_hands_agree_with_pinocchio_on_the_whole_robot(robot):
    ik, kinematics = ArmIK(robot), Kinematics(robot)
    rng = np.random.default_rng(0)
    for _ in range(50):
        q = rng.uniform(robot.lower, robot.upper)
        kinematics.update(make_state(q, position=np.zeros(3)))
        hands = ik.hands(q[robot.arms], q[robot.waist])
        assert hands == pytest.approx(np.array([kinematics.position(f"{s}_hand") for s in ("left", "right")]), abs=1e-9)


@pytest.mark.parametrize("dt", [0.002, 0.02])
def test_reachable_targets_leave_no_residual(robot, dt):
    ik, kinematics = ArmIK(robot), Kinematics(robot)
    q = robot.nominal.copy()
    q[robot.waist] = 0.5
    solution = converge(ik, HandTargets(*COMFORTABLE), make_state(q), dt=dt)
    assert solution.ok
    assert solution.reachable.all()
    assert np.all(solution.residual < 5e-4)
    assert np.abs(solution.dq).max() < 0.02
    q[robot.arms] = solution.q
    kinematics.update(make_state(q, position=np.zeros(3)))
    for side, target in zip(("left", "right"), COMFORTABLE, strict=True):
        assert kinematics.position(f"{side}_hand") == pytest.approx(target, abs=5e-4)


def test_world_targets_follow_the_pelvis_pose(robot):
    position, orientation = np.array([3.0, -2.0, 0.8]), rotations.from_yaw_pitch_roll(2.0, 0.3, -0.1)
    state = make_state(robot.nominal, orientation=orientation, position=position)
    world = HandTargets(*(position + COMFORTABLE @ rotations.to_matrix(orientation).T), frame="world")
    in_world = converge(ArmIK(robot), world, state)
    in_pelvis = converge(ArmIK(robot), HandTargets(*COMFORTABLE), state)
    assert in_world.q == pytest.approx(in_pelvis.q, abs=1e-9)


def test_heading_targets_stay_level_and_turn_with_the_yaw_alone(robot):
    yaw, lean = 2.0, rotations.from_yaw_pitch_roll(2.0, 0.3, -0.1)
    state = make_state(robot.nominal, orientation=lean)
    heading = HandTargets(*COMFORTABLE, frame="heading")
    level = COMFORTABLE @ rotations.rotation_z(yaw).T  # in the world's axes, about the pelvis
    solution = converge(ArmIK(robot), heading, state)
    hands = ArmIK(robot).hands(solution.q, 0.0) @ rotations.to_matrix(lean).T
    assert hands == pytest.approx(level, abs=5e-4)


def test_a_hand_without_a_target_rests(ik, robot, nominal_state):
    rest = ik.hands(robot.nominal[robot.arms], 0.0)
    solution = converge(ik, HandTargets(None, COMFORTABLE[1]), nominal_state)
    hands = ArmIK(robot).hands(solution.q, 0.0)
    assert hands == pytest.approx(np.stack((rest[0], COMFORTABLE[1])), abs=1e-3)
    assert solution.ok


def test_a_target_out_of_reach_gives_the_stretched_arm(nominal_state):
    directions = np.array([[1.0, 0.3, 0.1], [0.8, -0.6, -0.3]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    shoulders = -shoulder_to_targets(np.zeros((2, 3)))
    targets = shoulders + 1.5 * directions
    solution = converge(ArmIK(load_robot()), HandTargets(*targets), nominal_state)
    assert solution.ok
    assert not solution.reachable.any()
    # Upper arm 0.333 m, forearm 0.280 m: 0.613 m stretched; the shoulder's axes miss each other by 1.7 cm.
    assert solution.residual == pytest.approx([1.5 - 0.613] * 2, abs=0.025)
    hands = ArmIK(load_robot()).hands(solution.q, 0.0)
    angle = np.sum((hands - shoulders) * directions, axis=1) / np.linalg.norm(hands - shoulders, axis=1)
    assert np.all(angle > 0.999)
    assert np.abs(solution.dq).max() < 0.05, "settled, no chatter"


def test_nothing_sampled_is_nearer_to_a_target_out_of_reach(ik, nominal_state):
    rng = np.random.default_rng(1)
    postures = [q for q in rng.uniform(ik.lower, ik.upper, (3000, 8)) if ik.clearance(q).min() > 0.01]
    samples = np.array([ik.hands(q, 0.0) for q in postures])
    for targets in ([[0.9, 0.1, 0.1], [0.2, -0.9, -0.2]], [[0.02, 0.0, 0.25], [0.5, -0.3, 1.4]]):
        ik.reset(np.zeros(8))
        solution = converge(ik, HandTargets(*np.array(targets)), nominal_state)
        nearest = np.linalg.norm(samples - targets, axis=2).min(axis=0)
        assert np.all(solution.residual < nearest + 0.01)


def test_a_wound_up_arm_finds_its_way_to_any_reachable_target(robot, nominal_state):
    """One target after the other, all over the workspace, behind the head too: dead ends are left by detours."""
    ik, probe = ArmIK(robot), ArmIK(robot)
    rng = np.random.default_rng(3)
    speed = 0.5 * robot.velocity_limit[robot.arms]
    q, dq, clearance = ik.q, np.zeros(8), []
    postures = [q for q in rng.uniform(ik.lower, ik.upper, (120, 8)) if probe.clearance(q).min() > 0.02][:25]
    for posture in postures:
        targets = HandTargets(*probe.hands(posture, 0.0))
        for tick in range(150):
            solution = ik.solve(targets, nominal_state, DT)
            assert solution.ok
            assert np.all(np.abs(solution.q - q) <= speed * DT + 1e-9)
            assert np.all(np.abs(solution.dq - dq) <= 60.0 * DT + 1e-9)
            q, dq = solution.q, solution.dq
            if tick % 5 == 0:
                clearance.append(probe.clearance(q).min())
        assert np.all(solution.residual < 0.025)
    assert len(postures) == 25
    assert ik._detours.count > 5, "the sample must contain dead ends"
    assert min(clearance) > -0.02, "soft: a moving forearm may graze the trunk, not go through it"
    assert ik.without_collisions == 0


def test_a_detour_ends_once(ik, nominal_state):
    """A target behind the head, out of reach: the arm goes to the better side and then rests there."""
    targets = HandTargets(np.array([-1.2, -0.1, 1.8]), COMFORTABLE[1])
    converge(ik, targets, nominal_state, seconds=8.0)
    hands = ik.hands(ik.q, 0.0).copy()
    solution = converge(ik, targets, nominal_state, seconds=2.0)
    assert ik._detours.count == 1
    assert ik.hands(solution.q, 0.0) == pytest.approx(hands, abs=1e-3)
    assert np.abs(solution.dq).max() < 0.05, "at most the elbow drifts towards its posture"
    assert solution.reachable.tolist() == [False, True]
    samples = np.array([ik.hands(q, 0.0)[0] for q in np.random.default_rng(4).uniform(ik.lower, ik.upper, (3000, 8))])
    assert solution.residual[0] < np.linalg.norm(samples - targets.left, axis=1).min() + 0.02


def test_a_way_round_that_is_refused_is_not_taken_for_a_motion_of_the_hand(nominal_state, monkeypatch):
    """Looking along it moves virtual arms; the body at rest has carried the hands nowhere."""
    ik, carried = ArmIK(load_robot()), []
    looked, speed = [], ik._carried
    monkeypatch.setattr(
        ik._detours, "look", lambda arm, *rest: looked.append(type(ik._detours).look(ik._detours, arm, *rest))
    )
    monkeypatch.setattr(ik, "_carried", lambda *args: carried.append(speed(*args)) or carried[-1])
    while len(looked) < 3:
        ik.solve(HandTargets(np.array([-0.04, -0.04, -0.13]), None), nominal_state, 0.01)
    assert ik._detours.count == 1
    assert not np.any(carried)


def test_a_search_that_fails_costs_the_arm_no_step(nominal_state, monkeypatch):
    def fail(*_):
        failures.append(1)
        raise RuntimeError

    failures: list[int] = []
    ik, searching = ArmIK(load_robot()), ArmIK(load_robot())
    monkeypatch.setattr(ik._scout, "advance", fail)
    far = HandTargets(np.array([0.25, 0.35, 0.6]), np.array([0.25, -0.35, 0.6]))
    for _ in range(15):  # half a metre on a free way: the arm looks ahead and needs no detour
        solution = ik.solve(far, nominal_state, DT)
        assert solution.ok
        assert solution.q == pytest.approx(searching.solve(far, nominal_state, DT).q)
    assert len(failures) > 5 and searching._detours.count == 0


INSIDE = [
    ([[0.0, 0.0, 0.25], [0.3, -0.25, 0.1]], "chest"),
    ([[0.03, 0.0, 0.58], [0.3, -0.25, 0.1]], "head"),
    ([[0.05, 0.2, -0.3], [0.05, -0.2, -0.3]], "thighs"),
    ([[0.3, -0.02, 0.1], [0.3, 0.02, 0.1]], "each other"),
]


@pytest.mark.parametrize("targets", [targets for targets, _ in INSIDE], ids=[name for _, name in INSIDE])
def test_forearms_stay_out_of_the_body_and_off_each_other(robot, targets):
    q = robot.nominal.copy()
    q[robot.legs] = np.array([0.0, 0.0, -0.9, 1.6, -0.7] * 2)  # squatting: the thighs come forward
    ik, state = ArmIK(robot), make_state(q)
    ticks = [ik.solve(HandTargets(*np.array(targets)), state, DT) for _ in range(250)]
    clearance = [ik.clearance(solution.q).min() for solution in ticks]
    assert min(clearance) > -0.005
    assert clearance[-1] > 0.005
    assert np.abs(ticks[-1].dq).max() < 0.5, "no chatter"
    assert all(solution.ok for solution in ticks)
    loose = ArmIK(robot, ArmIKConfig(collision_weight=1e-12))
    solution = converge(loose, HandTargets(*np.array(targets)), state, 5.0)
    assert ik.clearance(solution.q).min() < -0.005, "without it they would not"


def pointing(ik, q):
    """Unit vectors from elbows to hands in the pelvis frame, shape (2, 3)."""
    forearms = ik.hands(q, 0.0) - np.array([ik._descent.elbow(hand) for hand in range(2)])
    return forearms / np.linalg.norm(forearms, axis=1, keepdims=True)


def test_a_forearm_turns_towards_its_direction_once_the_hand_is_in_place(nominal_state):
    inward = np.array([0.0, -1.0, 0.0])
    plain = converge(ArmIK(load_robot()), HandTargets(*COMFORTABLE), nominal_state)
    targets = HandTargets.of(*COMFORTABLE, left_direction=inward)
    solution = converge(ArmIK(load_robot()), targets, nominal_state)
    probe = ArmIK(load_robot())
    angle = [np.arccos(pointing(probe, s.q)[0] @ inward) for s in (plain, solution)]
    assert angle[1] < angle[0] - 0.2
    assert np.all(solution.residual < [0.004, 5e-4])
    assert solution.q[4:] == pytest.approx(plain.q[4:], abs=1e-3), "the other arm does not care"
    # A direction that the arm has at its target already leaves everything as it is.
    same = HandTargets.of(*COMFORTABLE, left_direction=pointing(probe, plain.q)[0])
    assert converge(ArmIK(load_robot()), same, nominal_state).q == pytest.approx(plain.q, abs=5e-3)


def test_hands_that_hold_one_thing_keep_their_distance_when_one_cannot_follow(nominal_state):
    box = np.array([[0.35, 0.16, 0.15], [0.35, -0.16, 0.15]])
    far = box - np.array([0.0, 0.5, 0.0])  # out of reach for the left hand across the chest
    apart, together = ArmIK(load_robot()), ArmIK(load_robot())
    for ik, held in ((apart, False), (together, True)):
        converge(ik, HandTargets.of(*box, together=held), nominal_state)
        converge(ik, HandTargets.of(*far, together=held), nominal_state, 4.0)
    gap = {}
    for name, ik in (("apart", apart), ("together", together)):
        hands = ik.hands(ik.q, 0.0)
        gap[name] = np.linalg.norm(hands[1] - hands[0] - (box[1] - box[0]))
    assert gap["apart"] > 0.05
    assert gap["together"] < 0.01


@pytest.mark.parametrize(("x", "half"), [(0.2, 0.06), (0.35, 0.05), (0.35, 0.03)])
def test_hands_on_something_that_is_too_thin_for_the_arms_come_to_rest(x, half, nominal_state):
    """The arms keep a centimetre from each other, so that the hands cannot be as near as the thing is thin."""
    ik = ArmIK(load_robot())
    targets = HandTargets.of((x, half, 0.15), (x, -half, 0.15), together=True)
    converge(ik, targets, nominal_state)
    before = ik.hands(ik.q, 0.0).copy()
    solution = converge(ik, targets, nominal_state, 0.2)
    np.testing.assert_allclose(ik.hands(solution.q, 0.0), before, atol=1e-3)
    assert not solution.reachable.any() and solution.residual.max() < 0.04 and ik.clearance(solution.q).min() > 0.0


def test_a_stretched_arm_does_not_jitter(nominal_state):
    """A target that circles out of reach: the arm stays singular throughout, and its jerk that of a smooth motion."""
    ik, dt = ArmIK(load_robot()), 0.02
    qs = []
    for t in np.arange(0.0, 8.0, dt):
        angle = np.pi * t / 4.0
        left = np.array([0.7, 0.3 + 0.2 * np.cos(angle), 0.4 + 0.2 * np.sin(angle)])
        qs.append(ik.solve(HandTargets(left, left * [1.0, -1.0, 1.0]), nominal_state, dt).q)
    jerk = np.diff(np.array(qs)[100:], n=3, axis=0) / dt**3
    # Amplitudes of about 0.4 rad at pi/4 rad/s have a jerk of 0.2 rad/s^3; a chatter of 1 mrad one of 1000.
    assert np.sqrt(np.mean(jerk**2)) < 50.0


def test_an_arm_with_a_stuck_joint_reaches(robot, nominal_state):
    """As the how-to makes one for a shoulder without yaw: its range is smaller than both margins."""
    stuck = np.isin(np.arange(robot.nominal.size), robot.pair("shoulder_yaw"))
    lower, upper = (np.where(stuck, end, limit) for end, limit in ((-1e-3, robot.lower), (1e-3, robot.upper)))
    ik = ArmIK(dataclasses.replace(robot, lower=lower, upper=upper))
    q, kinematics = robot.nominal.copy(), Kinematics(robot)
    q[robot.pair("shoulder_pitch")] -= 0.5
    q[robot.pair("elbow")] += 0.3
    kinematics.update(dataclasses.replace(nominal_state, q=q, position=np.zeros(3)))
    left, right = (kinematics.position(f"{side}_hand") for side in ("left", "right"))
    solution = converge(ik, HandTargets.of(left, right), nominal_state)
    assert solution.residual.max() < 0.005
    assert np.abs(solution.q[np.isin(robot.arms, robot.pair("shoulder_yaw"))]).max() <= 1e-3


def test_limits_hold_over_1000_random_targets_half_of_them_out_of_reach(ik, robot):
    rng = np.random.default_rng(2)
    margin = ik.config.limit_margin
    lower, upper = robot.lower[robot.arms] + margin, robot.upper[robot.arms] - margin
    speed, dt = 0.5 * robot.velocity_limit[robot.arms], 0.02
    q, dq, far = ik.q, np.zeros(8), 0
    for _ in range(1000):
        state = make_state(rng.uniform(robot.lower - 0.1, robot.upper + 0.1))
        targets = rng.uniform([-1.0, -1.2, -0.6], [1.0, 1.2, 1.4], (2, 3))
        far += np.sum(np.linalg.norm(shoulder_to_targets(targets), axis=1) > 0.65)
        solution = ik.solve(HandTargets(*targets), state, dt)
        assert solution.ok
        assert np.all(solution.q >= lower - 1e-9)
        assert np.all(solution.q <= upper + 1e-9)
        assert np.all(np.abs(solution.q - q) <= speed * dt + 1e-9)
        assert np.all(np.abs(solution.dq - dq) <= 60.0 * dt + 1e-9)
        assert solution.dq == pytest.approx((solution.q - q) / dt, abs=1e-9)
        q, dq = solution.q, solution.dq
    assert far > 1000


def test_with_unusable_numbers_the_arms_hold(ik, robot, nominal_state):
    good = HandTargets(*COMFORTABLE)
    held = converge(ik, good, nominal_state)
    lost_waist = nominal_state.q.copy()
    lost_waist[robot.waist] = math.nan
    bad = [
        (HandTargets(np.array([math.nan, 0.2, 0.1]), COMFORTABLE[1]), nominal_state, DT),
        (HandTargets(COMFORTABLE[0], np.array([math.inf, 0.2, 0.1])), nominal_state, DT),
        (HandTargets(COMFORTABLE[0], np.zeros(2)), nominal_state, DT),
        (HandTargets(*COMFORTABLE, frame="world"), nominal_state, DT),
        (good, make_state(lost_waist), DT),
        (good, nominal_state, 0.0),
    ]
    for targets, state, dt in bad:
        solution = ik.solve(targets, state, dt)
        assert not solution.ok
        assert solution.q == pytest.approx(held.q, abs=1e-3)
        assert solution.dq == pytest.approx(np.zeros(8), abs=1e-2)
        assert solution.residual.tolist() == held.residual.tolist()
    assert ik.solve(good, nominal_state, DT).ok


def test_a_level_hand_of_a_pelvis_that_leans_nobody_knows_how_is_unusable():
    robot = load_robot("g1")
    ik, targets = ArmIK(robot), HandTargets.of((0.25, 0.2, 0.1), None, left_orientation="level")
    assert not ik.solve(targets, make_state(robot.nominal, orientation=np.full(4, math.nan)), DT).ok
    assert ik.without_collisions == 0


def test_far_but_finite_numbers_are_harmless(ik, nominal_state):
    solution = converge(ik, HandTargets(np.array([1e12, 0.0, 0.0]), np.array([0.0, -1e12, 0.0])), nominal_state, 2.0)
    assert np.all(np.isfinite(solution.q))
    assert not solution.reachable.any()


def test_reset_moves_into_the_limits_and_ignores_nan(ik, robot, nominal_state):
    outside = robot.upper[robot.arms] + 0.3
    outside[0] = math.nan
    ik.reset(outside)
    assert ik.q[0] == 0.0
    assert ik.q[1:] == pytest.approx(robot.upper[robot.arms][1:] - 0.02)
    assert ik.solve(HandTargets(*COMFORTABLE), nominal_state, DT).ok


def test_mirrored_targets_give_the_mirrored_arms(robot):
    mirror = load_mirror(robot)
    q = robot.nominal.copy()
    q[robot.waist] = 0.4
    mirrored = COMFORTABLE[::-1] * [1.0, -1.0, 1.0]
    a = converge(ArmIK(robot), HandTargets(*COMFORTABLE), make_state(q), seconds=0.4)
    b = converge(ArmIK(robot), HandTargets(*mirrored), make_state(mirror.joints(q)), seconds=0.4)
    assert b.q == pytest.approx(mirror.arms(a.q, robot), abs=1e-6)
    assert b.residual[::-1] == pytest.approx(a.residual, abs=1e-6)


def test_the_script_stays_comfortably_within_reach(ik, robot):
    script = load_script("loco_manipulation")
    q = robot.nominal.copy()
    shoulders = -shoulder_to_targets(np.zeros((2, 3)))
    for t in np.arange(2.0, 19.0, DT):
        hands = script.hands_at(t)
        assert hands is not None
        q[robot.waist] = script.command_at(t).w
        solution = ik.solve(hands, make_state(q), DT)
        assert solution.reachable.all()
        if t > 3.0:
            assert np.all(solution.residual < 0.002)
            assert np.all(solution.q - ik.lower > 0.1)
            assert np.all(ik.upper - solution.q > 0.1)
        turned = shoulders @ rotations.rotation_z(q[robot.waist]).T
        assert np.all(np.linalg.norm(hands.array() - turned, axis=1) < 0.9 * 0.613)


def test_after_a_reset_nothing_is_left_of_the_searches_before(robot, nominal_state):
    """Otherwise an episode would depend on the ones before it."""
    awkward = HandTargets.of((-0.385, 0.488, 0.987), None)  # behind the head, where the direct way ends short of it

    def path(ik):
        ik.reset(robot.nominal[robot.arms])
        return np.array([ik.solve(awkward, nominal_state, 0.02).q for _ in range(60)])

    used = ArmIK(robot)
    used.reset(robot.nominal[robot.arms])
    for _ in range(30):
        used.solve(HandTargets.of((0.2, 0.3, 1.0), (0.1, 0.35, 0.2)), nominal_state, 0.02)
    before = used._detours.count
    assert np.array_equal(path(used), path(ArmIK(robot)))
    assert used._detours.count > before


def test_after_a_reset_nothing_is_left_of_the_body_before():
    """A G1's waist rolls and pitches, too, and carries the hands."""
    robot = load_robot("g1")
    q, new, used = robot.nominal.copy(), ArmIK(robot), ArmIK(robot)
    q[robot.held] += 0.2
    used.solve(HandTargets.of((0.25, 0.2, 0.1), None), make_state(q), DT)
    used.reset(robot.nominal[robot.arms])
    assert np.array_equal(used.hands(new.q, 0.0), new.hands(new.q, 0.0))


def test_a_loop_that_paused_for_long_goes_on_at_once(ik, robot, nominal_state):
    ik.reset(robot.nominal[robot.arms])
    before, begin = ik.q, time.process_time()
    solution = ik.solve(HandTargets(*COMFORTABLE), nominal_state, 3600.0)
    assert time.process_time() - begin < 0.5, "one minute of it takes a quarter of a second"
    assert solution.ok and np.all(np.abs(solution.q - before) <= ik.velocity_limit * LONGEST_TICK + 1e-9)
    assert np.all(np.abs(solution.dq) <= ik.velocity_limit + 1e-9)
