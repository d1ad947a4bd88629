import dataclasses
import math
import re

import mujoco
import numpy as np
import pytest

from hugwbc import Command, Gait, JointCommand, UpperBody, load_robot
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation import metrics
from hugwbc.runtime import Constant, rollout
from hugwbc.runtime.controllers import HoldController
from hugwbc.runtime.loop import ControlLoop
from hugwbc.runtime.trace import TouchDownWatch
from hugwbc.sim import Actuators, Arena, Ground, Simulation
from hugwbc.sim.faults import Fault
from hugwbc.sim.scenes import Box, Scene, Uniform
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import IKSolution, UpperBodySource

ROBOT = load_robot()


@pytest.fixture(scope="module")
def simulation():
    return Simulation(sensing="exact")


class FixedArms:
    """An upper-body source that moves the arms to one pose and calls the left target reachable, the right one not."""

    def __init__(self):
        self.solution = None
        self.commanded: list[np.ndarray | None] = []

    def reset(self):
        self.commanded.clear()

    def update(self, state, hands, command, dt, commanded=None, followed=None):
        self.commanded.append(commanded)
        q = np.full(8, 0.1)
        self.solution = hands and IKSolution(q, 0 * q, 0 * q, np.zeros(2), np.array([True, False]), ok=True)
        return (UpperBody.none() if hands is None else UpperBody.targets(q)), command


class Reaching:
    """Hand targets in the pelvis frame from 0.2 s on."""

    def command_at(self, t):
        return Command()

    def hands_at(self, t):
        return HandTargets.of((0.3, 0.2, 0.1), (0.3, -0.2, 0.1)) if t >= 0.2 - 1e-9 else None


def test_the_record_has_one_row_every_20_ms_and_agrees_with_the_simulator(simulation):
    trace = rollout(HoldController(load_robot()), Constant(Command(w=0.1)), simulation, duration=0.5)
    assert trace.name == "hold" and not trace.fell and trace.survived_s == 0.5 and trace.steps == 25
    np.testing.assert_allclose(trace.time, np.arange(25) * 0.02)
    for name, shape in {
        "command": (25, 8), "gait": (25,), "measured": (25, 6), "clearance": (25, 2), "foot_contact": (25, 2),
        "phase": (25,), "foot_force": (25, 2, 3), "pressure_centre": (25, 2, 3), "foothold": (25, 2, 2),
        "qpos": (25, 26), "qvel": (25, 25), "target": (25, 19), "hand_target_world": (25, 2, 3),
        "arm_target": (25, 8), "hand_error": (25, 2), "reachable": (25, 2),
        "torque": (25, 19), "power": (25,), "tick_ms": (25,), "ik_ms": (0,),
    }.items():  # fmt: skip
        assert getattr(trace, name).shape == shape, name
    assert trace.qpos[0, 2] == pytest.approx(0.98, abs=0.01)
    np.testing.assert_allclose(trace.measured[:, 3], trace.qpos[:, 2] - 0.98)
    np.testing.assert_allclose(trace.measured[:, 5], trace.qpos[:, 7 + ROBOT.waist])
    assert np.isnan(trace.hand_error).all() and np.isnan(trace.hand_target_world).all()
    assert trace.foot_contact[5:20].all(), "standing still, both feet stay on the ground"
    assert (trace.foot_force[5:20, :, 2] > 50.0).all() and np.isfinite(trace.pressure_centre[5:20]).all()
    assert np.isnan(trace.phase).all() and np.isnan(trace.foothold).all(), "this controller has no gait"


def test_two_runs_are_equal_and_a_command_is_a_source(simulation):
    first = rollout(HoldController(load_robot()), Constant(Command()), simulation, duration=0.4)
    second = rollout(HoldController(load_robot()), Command(), simulation, duration=0.4)
    np.testing.assert_array_equal(first.qpos, second.qpos)


def test_hand_targets_of_the_pelvis_frame_are_recorded_in_the_world(simulation):
    arms = FixedArms()
    trace = rollout(HoldController(load_robot()), Reaching(), simulation, arms, duration=0.8)
    assert arms.commanded[0] is None
    np.testing.assert_array_equal(arms.commanded[5], ROBOT.nominal[ROBOT.arms])
    # These targets do not start at the controller's arm command: the step fades over half a second.
    np.testing.assert_array_equal(arms.commanded[37], np.full(8, 0.1))
    assert np.isnan(trace.hand_target_world[:10]).all() and np.isfinite(trace.hand_target_world[10:]).all()
    offset = np.zeros(3)
    mujoco.mju_rotVecQuat(offset, np.array([0.3, 0.2, 0.1]), trace.qpos[10, 3:7])
    np.testing.assert_allclose(trace.hand_target_world[10, 0], trace.qpos[10, :3] + offset, atol=1e-9)
    assert np.isnan(trace.arm_target[:10]).all() and (trace.arm_target[10:] == 0.1).all()
    assert trace.reachable[10:, 0].all() and not trace.reachable[:, 1].any()
    assert np.isnan(trace.hand_error[:10]).all() and np.isfinite(trace.hand_error[10:]).all(), "in reach or not"
    away = simulation.data.sensor("left_hand_position").data - trace.hand_target_world[-1, 0]
    assert np.linalg.norm(away) == pytest.approx(trace.hand_error[-1, 0], abs=0.05)


def test_a_fall_ends_the_run_and_is_reported(simulation):
    class Limp(HoldController):
        def act(self, state, command, upper_body):
            output = super().act(state, command, upper_body)
            return dataclasses.replace(output, kp=0 * output.kp, kd=0 * output.kd)

    trace = rollout(Limp(load_robot()), Constant(Command()), simulation, duration=5.0)
    assert trace.fell and 0.1 < trace.survived_s < 3.0
    assert trace.steps == math.ceil(trace.survived_s / 0.02 - 1e-6)
    past_it = rollout(Limp(load_robot()), Constant(Command()), simulation, duration=3.2, past_falls=True)
    assert past_it.fell and past_it.survived_s == trace.survived_s and past_it.steps == 160


def test_a_fall_of_one_physics_step_counts_for_a_controller_of_any_rate(monkeypatch):
    """The trunk touches the ground for 2 ms only, in the middle of a control period."""
    simulation = Simulation(sensing="exact")
    monkeypatch.setattr(type(simulation), "_trunk_on_ground", lambda self: abs(self.time - 0.106) < 1e-6)
    for period in (0.004, 0.02):
        controller = HoldController(load_robot())
        controller.period = period
        trace = rollout(controller, Constant(Command()), simulation, duration=0.5)
        assert trace.fell and trace.survived_s == pytest.approx(0.106), period


def test_out_of_range_commands_are_recorded_as_clamped_and_reported(simulation):
    trace = rollout(HoldController(load_robot()), Constant(Command(w=5.0, h=float("nan"))), simulation, duration=0.1)
    assert (trace.command[:, 7] == 1.0).all() and (trace.command[:, 5] == 0.0).all()
    assert trace.safety.commands_clamped == {"w": 5, "h": 5}


def test_a_fast_controller_is_called_at_its_own_period_and_recorded_at_50_hz(simulation):
    class Fast(HoldController):
        period = 0.002

    trace = rollout(Fast(load_robot()), Constant(Command()), simulation, duration=0.2)
    assert trace.steps == trace.tick_ms.size == 100 and trace.time.size == 10


@pytest.mark.parametrize("period", [0.02, 0.028])
def test_power_is_that_of_every_physics_step_whenever_samples_are_taken(period):
    """Targets that jump at each call are paid in the steps after it, which samples in step with the calls miss."""

    class Jumping(HoldController):
        def act(self, state, command, upper_body):
            sign = 1.0 if round(state.time / self.period) % 2 else -1.0
            return JointCommand.position(self.robot, self.robot.nominal + 0.05 * sign)

    Jumping.period = period
    simulation, powers = Simulation(sensing="exact", timestep=0.002), []

    def on_step(truth, estimate):
        powers.append(np.abs(simulation.torque * truth.dq).sum())

    trace = rollout(Jumping(load_robot()), Command(), simulation, duration=0.4, on_step=on_step)
    steps = round(0.02 / 0.002)
    means = np.array(powers[: steps * (len(trace.time) - 1)]).reshape(-1, steps).mean(axis=1)
    np.testing.assert_allclose(trace.power, [0.0, *means])
    assert metrics.mechanical_power(trace, settle=0.02) == pytest.approx(means.mean())
    assert means.mean() > 20.0


@pytest.mark.parametrize("period", [0.008, 0.02, 0.04, 0.07])
def test_samples_come_every_20_ms_whatever_the_control_period_is(period):
    class Slow(HoldController):
        pass

    Slow.period = period
    trace = rollout(Slow(load_robot()), Constant(Command()), Simulation(timestep=0.002, seed=1), duration=0.56)
    assert trace.time == pytest.approx(0.02 * np.arange(28))


def test_only_calls_of_the_controller_are_timed():
    simulation = Simulation(faults=(Fault.parse("imu-gone@0.1"),))
    trace = rollout(HoldController(load_robot()), Command(), simulation, duration=0.8, past_falls=True)
    assert 0 < trace.safety.lowered == trace.steps - trace.tick_ms.size


def test_touch_downs_are_timed_and_bounces_ignored(simulation):
    """A leg that is tucked up and stretched again comes down once."""

    class Tuck(HoldController):
        def act(self, state, command, upper_body):
            q = self.robot.nominal.copy()
            if 0.1 < state.time < 0.35:
                left = [self.robot.index(f"left_{part}_joint") for part in ("hip_pitch", "knee", "ankle")]
                q[left] += np.array([-0.4, 0.8, -0.4])
            return JointCommand.position(self.robot, q)

    trace = rollout(Tuck(load_robot()), Constant(Command(gait=Gait.WALKING)), simulation, duration=0.7)
    left, right = trace.touch_downs
    assert left.size == 1 and 0.3 < left[0] < 0.7
    assert right.size == 0
    assert trace.clearance[trace.time < 0.35, 0].max() > 0.03


def test_touch_downs_speeds_and_peaks_of_a_foot_by_hand():
    """It bounces for 40 ms, then swings twice for 60 ms; its stances press with 900, 300 and 600 N."""
    watch, dt = TouchDownWatch(0.01), 0.01
    normal = [500.0] * 5 + [0.0] * 4 + [900.0] * 5 + [0.0] * 6 + [300.0] * 5 + [0.0] * 6 + [600.0] * 5
    for tick, force in enumerate(normal, start=1):
        feet, velocity = np.zeros((2, 3)), np.zeros((2, 3))
        feet[0, 2], velocity[0, 2] = force, -0.01 * tick
        watch.update(dt * tick, feet, velocity)
    found = watch.record()
    left, right = found["touch_downs"]
    np.testing.assert_allclose(left, [0.21, 0.32])
    assert not right.size
    np.testing.assert_allclose(found["touch_down_velocity"][0][:, 2], [-0.20, -0.31])
    np.testing.assert_allclose(found["stance_peak"][0], [300.0, 600.0])


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_a_bad_duration_is_refused(simulation, duration):
    with pytest.raises(ConfigError, match="give a finite time above 0"):
        rollout(HoldController(load_robot()), Constant(Command()), simulation, duration=duration)


def test_a_run_shorter_than_a_control_period_has_one_step():
    trace = rollout(HoldController(load_robot()), Constant(Command()), Simulation(sensing="exact"), duration=0.005)
    assert trace.steps == 1 and len(trace.time) == 1 and not trace.fell


@pytest.mark.parametrize("timestep", [0.001, 0.002, 0.005])
def test_touch_downs_have_the_speed_before_and_the_peak_after(timestep):
    """A robot dropped from 5 cm lands at 1 m/s or a little less, and with the same impact at any time step."""
    simulation = Simulation(sensing="exact", timestep=timestep, ground=Ground.named("soft"))

    class Dropped(HoldController):
        def reset(self, state):
            simulation.data.qpos[2] += 0.05

    trace = rollout(Dropped(load_robot()), Constant(Command()), simulation, duration=0.3)
    assert trace.mass == ROBOT.mass
    for foot in range(2):
        (velocity,), (peak,) = trace.touch_down_velocity[foot], trace.stance_peak[foot]
        assert -1.05 < velocity[2] < -0.85 and abs(velocity[0]) < 0.2
        assert peak == pytest.approx(1030.0, rel=0.08)


def test_a_record_holds_objects_and_hand_forces_of_a_scene_alone():
    scene = Scene((Box(name="parcel", position=(2.0, Uniform(-1.0, 1.0), 0.3), size=(0.2, 0.2, 0.2)),))
    simulation = Simulation(sensing="exact", scene=scene, seed=3)
    trace = rollout(HoldController(load_robot()), Constant(Command()), simulation, duration=0.3)
    assert trace.object_pose.shape == (15, 1, 7) and trace.hand_force.shape == (15, 2, 3)
    assert trace.object_pose[0, 0, 2] == pytest.approx(0.4) and trace.object_pose[-1, 0, 2] < 0.2  # it fell
    assert trace.scene == scene.draw(3) and trace.problems == ()
    alone = rollout(HoldController(load_robot()), Constant(Command()), Simulation(sensing="exact"), duration=0.1)
    assert alone.object_pose.size == alone.hand_force.size == 0 and alone.scene is None


def test_a_record_says_that_an_object_left_the_world():
    scene = Scene((Box(name="parcel", position=(2.0, 0.0, 9.0), size=(0.2, 0.2, 0.2)),))
    simulation = Simulation(sensing="exact", scene=scene)
    simulation.model.opt.gravity[2] = 200.0  # everything falls upwards
    trace = rollout(HoldController(load_robot()), Constant(Command()), simulation, duration=0.5)
    assert len(trace.problems) == 1 and trace.problems[0].startswith("object 'parcel' left the world at 0.3")


def test_a_dead_motor_is_found_where_the_sensors_tell_the_state():
    simulation = Simulation(sensing="exact", faults=(Fault.parse("motor-dead=left_knee_joint@0.1"),))
    safety = rollout(HoldController(load_robot()), Command(), simulation, duration=0.6).safety
    assert safety.lowered > 0 and "the motor of left_knee_joint is dead: kneeling down" in safety.messages


def test_names_stand_for_controller_robot_ground_and_scene():
    simulation = Simulation(robot="h1-2023", ground="soft", scene="parcel")
    trace = rollout("hold", Command(), simulation, duration=0.1)
    assert (trace.name, trace.robot, simulation.ground) == ("hold", "h1-2023", Ground.named("soft"))
    assert trace.scene is not None and "parcel" in simulation.objects.names
    ideal = ControlLoop("qp", Command(), Arena(drives="ideal").simulation())
    assert ideal.control.guard.controller.robot is Actuators.ideal().known_robot(load_robot())
    with pytest.raises(UnknownNameError, match=r"unknown scene 'parcl'\. Did you mean 'parcel'"):
        Simulation(scene="parcl")
    with pytest.raises(UnknownNameError, match=r"unknown controller 'qpp'\. Did you mean 'qp'"):
        rollout("qpp", Command(), simulation, duration=0.1)


class Few(HoldController):
    """Returns 12 joints."""

    def act(self, state, command, upper_body):
        return JointCommand(*np.zeros((5, 12)))


class Bare(HoldController):
    """Returns an array."""

    def act(self, state, command, upper_body):
        return np.zeros(19)


class Raising(HoldController):
    """Raises."""

    def act(self, state, command, upper_body):
        raise ValueError("no such thing")


class Mute:
    """A source of nothing."""

    def command_at(self, t):
        return None

    def hands_at(self, t):
        return None


@pytest.mark.parametrize(
    ("controller", "source", "words"),
    [
        (
            Few(load_robot()),
            Command(),
            "hold gave a joint command in which q, dq, kp, kd, tau are not 19 finite numbers each",
        ),
        (Bare(load_robot()), Command(), "act of hold returned a ndarray instead of a JointCommand"),
        (Raising(load_robot()), Command(), r"hold raised ValueError: no such thing \(test_rollout.py, line \d+\)"),
        (HoldController(load_robot()), Mute(), "it gave a NoneType and a NoneType instead of a Command"),
    ],
)
def test_a_mistake_in_somebody_elses_code_ends_a_run_unless_it_must_go_on(simulation, controller, source, words):
    with pytest.raises(ConfigError, match=words):
        rollout(controller, source, simulation, duration=0.2)
    assert simulation.time == 0.0
    trace = rollout(controller, source, simulation, duration=0.2, strict=False)
    safety = trace.safety
    assert safety.failures + safety.bad_outputs + safety.source_failures == trace.steps == 10
    assert re.search(words, safety.messages[0])


@pytest.mark.parametrize(
    ("controller", "source", "words"),
    [
        (HoldController, Command(), "the controller gives the class HoldController; give an object of it"),
        (len, Command(), "gives a builtin_function_or_method without name, period, reset, act"),
        (HoldController(load_robot()), "walk", r"the source is 'walk'; give a Command, a script \(load_script\)"),
        (HoldController(load_robot()), Reaching, r"the source is <class .*Reaching'>; give .* an object"),
    ],
)
def test_what_is_no_controller_or_no_source_is_refused(simulation, controller, source, words):
    with pytest.raises(ConfigError, match=words):
        rollout(controller, source, simulation, duration=0.2, strict=False)


def test_hand_targets_that_nothing_follows_are_told_once(simulation):
    with pytest.warns(UserWarning, match="give an UpperBodySource") as told:
        rollout(HoldController(load_robot()), Reaching(), simulation, duration=0.4)
    assert len(told) == 1


def test_hand_targets_that_the_arms_cannot_follow_are_reported_and_end_a_strict_run():
    source = Constant(Command(), HandTargets.of((0.35, 0.2, 0.15), None, left_orientation="level"))
    arms = UpperBodySource(load_robot())
    trace = rollout(HoldController(load_robot()), source, Simulation(), arms, duration=0.1, strict=False)
    assert trace.safety.hands_refused == trace.safety.ticks
    assert any("an arm of h1 has 4: left_shoulder_pitch_joint" in message for message in trace.safety.messages)
    with pytest.raises(ConfigError, match="left_orientation takes an arm of 5 joints"):
        rollout(HoldController(load_robot()), source, Simulation(), arms, duration=0.1)


def test_periods_without_an_arm_posture_are_counted_and_far_targets_are_not(simulation, monkeypatch):
    arms, far = UpperBodySource(load_robot()), Constant(Command(), HandTargets.of((1.2, 0.2, 0.15), None))
    assert rollout(HoldController(load_robot()), far, simulation, arms, duration=0.2).safety.hands_held == 0

    def fail(*_):
        raise RuntimeError("infeasible")

    monkeypatch.setattr(arms.ik._descent, "descend", fail)
    safety = rollout(HoldController(load_robot()), far, simulation, arms, duration=0.2).safety
    assert safety.hands_held == safety.ticks == 10 and safety.mistakes == 0
    assert safety.messages == ("no arm posture for the hand targets: the arms hold",)
