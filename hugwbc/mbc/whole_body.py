"""The `qp` controller: command filter, gait plan, tasks and whole-body QP behind the interface of every controller."""

import dataclasses
import math

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.kinematics import in_place
from hugwbc.mbc.command_filter import CommandFilter, SmoothCommand
from hugwbc.mbc.dynamics import Dynamics, Predictor, pitch_of
from hugwbc.mbc.feet import SOLES, SlipWatch
from hugwbc.mbc.gait_plan import Mode
from hugwbc.mbc.hand_load import HandLoad
from hugwbc.mbc.locomotion import Locomotion
from hugwbc.mbc.params import ControllerParams
from hugwbc.mbc.qp import CONTACT_POINTS, QpSolution, QpStatus, WholeBodyQp
from hugwbc.mbc.tasks import PostureTask, Task, TaskTerms
from hugwbc.robot import FRICTION_SPEED, SIDES, Robot, load_mirror
from hugwbc.state import RobotState

_LONGEST_PERIOD = 0.05  # [s], with which a robot still stands; a longer one is in another unit
_LONGEST_GAP = 0.5  # [s], between two ticks; over a longer one the last velocity does not tell where the robot is now
_STICKING_SPEED = 0.01  # [rad/s], wanted speed at which most of the friction of a joint at rest is compensated
_ARM_SHARE = 0.95  # of the arms' highest torque that their task may take, the motion of the body left out


@dataclasses.dataclass(frozen=True, eq=False)
class Diagnostics:
    """State of the controller after a tick."""

    status: QpStatus  # outcome of the QP; failed before the first tick, and with a state that is not usable
    mode: Mode  # mode of the gait plan
    swing: str | None  # side of the swinging foot of a walk, or None
    contact_forces: dict[str, np.ndarray]  # force of the ground by contact point, world axes [N], each of shape (3,)
    fallbacks: int  # number of ticks since the reset without a joint command
    relaxed: int  # number of ticks since the reset in which the joint limits had to be dropped
    out_of_reach: int  # number of ticks since the reset in which the foothold of a walk was out of reach
    failed_plans: int  # number of force plans since the reset that were not solved; the feet pushed evenly instead
    friction: float  # coefficient that the contact forces may use; less than usual after a slip


class WholeBodyController:
    """Walks, leaps and stands by inverse dynamics: the controller `qp`.

    A late state is carried to the present (`Predictor`).

    Attributes:
        name: "qp".
        robot: the robot that the controller was told.
        period: time between two calls of `act` [s].
        params: gains, weights and limits of an H1, as they were given.
        dynamics: robot model at the last state.
    """

    name = "qp"

    def __init__(self, robot: Robot, params: ControllerParams | None = None, *, period: float = 0.004) -> None:
        """Set up the controller.

        Args:
            robot: robot that the controller is told, which may differ from the one that moves.
            params: gains, weights and limits of an H1, which a robot of another size gets in its own; None for the
                defaults.
            period: time between two calls of `act` [s]: 0.002 to 0.01, or 0.02 with reduced tracking.

        Raises:
            ConfigError: if the period is not above 0 s, or is above 0.05 s.
        """
        if not 0.0 < period <= _LONGEST_PERIOD:
            raise ConfigError(
                f"period is {period} s; give a finite time above 0 s, up to {_LONGEST_PERIOD} s, such as 0.004 s"
            )
        self.robot, self.params, self.period = robot, params or ControllerParams(), period
        self._params = params = self.params.of_size(robot)
        self.dynamics = Dynamics(robot)
        self._nominal_arms = robot.nominal[robot.arms]
        self._highest_torque = robot.torque_limit * params.torque_fraction
        self._kp, self._kd = params.joint_stiffness * robot.kp, params.joint_damping * robot.kd
        # Drives hold these joints: a task of the QP alone leaves them where friction does.
        held = robot.held
        self._holding_kp, self._holding_kd = self._kp.copy(), self._kd.copy()
        self._holding_kp[held], self._holding_kd[held] = robot.kp[held], robot.kd[held]
        for gains in (self._kp, self._kd, self._holding_kp, self._holding_kd):  # all commands share these arrays
            gains.setflags(write=False)
        self._filter = CommandFilter(params, robot)
        self._locomotion = Locomotion(params, robot)
        self._columns = in_place(self.dynamics.columns)
        arms = self.dynamics.columns[robot.arms]
        self._arm_columns, self._arm_block = in_place(arms), np.ix_(arms, arms)
        self._predictor = Predictor(self.dynamics, period)
        self._waist = PostureTask(np.array([robot.waist]), 10.0, params.waist_gains)
        self._held_joints = PostureTask(held, 10.0, params.waist_gains)
        self._held_joints.target[:] = robot.nominal[held]
        self._arms = PostureTask(robot.arms, params.takeover_speed)
        # The right hip may turn about the opposite axis; about the same one, yaws are mirrored by the factor -1.
        self._hip_ways = np.array([1.0, -load_mirror(robot).joint_sign[robot.pair("hip_yaw")[1]]])
        self._hand_load = HandLoad(params.hand_force_rate, params.least_hand_force)
        self._qp = WholeBodyQp(params, robot, self.dynamics.nv, self.dynamics.columns)
        forces, torque = np.zeros((len(CONTACT_POINTS), 3)), np.zeros_like(robot.kp)
        self._unsolved = QpSolution(QpStatus.FAILED, np.zeros(self.dynamics.nv), forces, torque)
        self._slip = SlipWatch(params.friction, robot.weight)
        self._clear()

    def _clear(self) -> None:
        self._fallbacks = 0
        self._relaxed = 0
        self._time = 0.0  # of the last tick [s]
        self._solution = self._unsolved  # of the last tick
        self._waist.rate[0] = 0.0
        self._hand_load.reset()
        self.dynamics.hand_force = self._hand_load.force
        self._free_arms()

    @property
    def phase(self) -> float:
        """Common phase of `hugwbc.gait` in the period of the last command, in [0, 1)."""
        return self._locomotion.plan.phase

    @property
    def footholds(self) -> np.ndarray:
        """Where the soles of the feet in the air should land, world x and y [m], shape (2, 2); NaN for the others."""
        return self._locomotion.footholds.copy()

    @property
    def planned_acceleration(self) -> np.ndarray | None:
        """Joint accelerations that the last command should cause [rad/s^2], shape (n,); None without one."""
        failed = self._solution.status is QpStatus.FAILED
        return None if failed else self._solution.acceleration[self._columns]

    def reset(self, state: RobotState) -> None:
        """Forget the past and start standing in this state; raise a ConfigError without position and velocity."""
        _motion(state)
        self._clear()
        self._time = state.time
        self._qp.reset()
        self._slip.reset()
        self._predictor.reset()
        self.dynamics.update(state)
        self._locomotion.reset(self.dynamics)
        pelvis, ground = self.dynamics.frame(self.robot.base), self._locomotion.references.ground
        height = float(pelvis.position[2]) - ground - self.robot.nominal_height
        self._filter.reset(height, pitch_of(pelvis.rotation), float(state.q[self.robot.waist]))

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand | None:
        """Return the joint command for the next period.

        There is none after an unsolved QP, or with a state that is not usable (`RobotState.is_usable`): the guard holds
        the last one for a while, then damps the joints. `Diagnostics.fallbacks` counts such ticks.

        Args:
            state: measured or estimated state, with position and velocity; foot forces may be missing.
            command: command to follow, within its ranges.
            upper_body: targets of the arm joints under external control, within the joints' ranges.

        Raises:
            ConfigError: if the state has no position or no velocity.
        """
        position, velocity = _motion(state)
        if not state.is_usable:  # a NaN would stay in what the controller remembers
            self._fail()
            return None
        # The guard does not ask while states are not usable.
        passed, self._time = state.time - self._time, state.time
        self._locomotion.follow_jumps(position, velocity, passed if 0.0 < passed < _LONGEST_GAP else self.period)
        # A command acts only after the delay of the drives: the state at that time counts.
        state = self._predictor.predict(state, self.robot.command_delay)
        stepping = self._locomotion.plan.mode is Mode.WALKING
        self._hand_load.update(state, upper_body, self.period, stepping=stepping)
        self.dynamics.hand_force = self._hand_load.force
        self.dynamics.update(state)
        self._watch_slips(state)
        smooth = self._filter.update(command, self.period, self._locomotion.state(self._slip.fastest))
        self._locomotion.update(self.dynamics, smooth, self.period)
        self._set_posture(smooth, upper_body)
        held = [self._held_joints] if self.robot.held.size else []
        tasks: list[Task] = [*self._locomotion.tasks(), self._waist, *held, self._arms]
        terms = [task.evaluate(self.dynamics) for task in tasks]
        if not self._arms_free:
            terms[-1] = self._attainable(terms[-1])
        points = self._locomotion.contact_points(self.dynamics)
        solution = self._qp.solve(self.dynamics, terms, points, self._locomotion.leap.forces, state.yaw)
        if solution.status is QpStatus.FAILED:
            self._fail()
            return None
        self._relaxed += solution.status is QpStatus.RELAXED
        # The next reading may be older than this command: the predictor has to know what happened in between.
        self._predictor.record(solution.acceleration)
        self._solution = solution
        return self._joint_command(state, solution)

    def _watch_slips(self, state: RobotState) -> None:
        """Let the contact forces use as much friction as the standing soles have."""
        if state.foot_force is not None:
            velocities = [self.dynamics.frame(sole).velocity for sole in SOLES]
            self._slip.update(velocities, state.foot_force * self._locomotion.contact[:, None], self.period)
        self._qp.friction = self._slip.friction

    def _set_posture(self, command: SmoothCommand, upper_body: UpperBody) -> None:
        """Set the targets of waist and arms; arm joints under external control become prescribed motion."""
        params, mask = self._params, upper_body.mask
        # Without the acceleration the waist would lag and overshoot.
        self._waist.acceleration[0] = (command.w_rate - float(self._waist.rate[0])) / self.period
        self._waist.target[0], self._waist.rate[0] = command.w, command.w_rate
        leaps = bool(self._locomotion.plan.legs)
        self._waist.weight[0] = params.leap_waist_weight if leaps else params.waist_weight
        self._held_joints.weight[:] = params.leap_held_weight if leaps else params.held_weight
        if not upper_body.indicator:
            if not self._arms_free:
                self._free_arms()
            return
        self._arms_free = False
        self._arms.target[:] = np.where(mask, upper_body.q, self._nominal_arms)
        self._arms.rate[:] = np.where(mask, upper_body.dq, 0.0)
        self._arms.acceleration[:] = np.where(mask, upper_body.ddq, 0.0)
        self._arms.weight[:] = np.where(mask, params.takeover_weight, params.arm_weight)
        # A servo that is sampled at the control period must stay well below the sampling frequency, or it oscillates.
        stiffness = min(params.takeover_gains[0], (0.4 / self.period) ** 2)
        damping = min(params.takeover_gains[1], 0.8 / self.period)
        self._arms.stiffness[:] = np.where(mask, stiffness, params.arm_gains[0])
        self._arms.damping[:] = np.where(mask, damping, params.arm_gains[1])

    def _attainable(self, arms: TaskTerms) -> TaskTerms:
        """Return the arms' terms, with accelerations limited to what their drives can give.

        Their servo stops at the torque limits, whatever the QP plans. A force on the hands that is too large for the
        arms moves them; a plan that held them nevertheless would do so at the expense of the balance.
        """
        dynamics, joints = self.dynamics, self._arm_columns
        inertia, bias = dynamics.M[self._arm_block], dynamics.bias[joints]
        torque = inertia.dot(arms.acceleration) + bias
        most = _ARM_SHARE * self._highest_torque[self.robot.arms]
        allowed = np.minimum(np.maximum(torque, -most), most)
        if (allowed == torque).all():
            return arms
        return arms._replace(acceleration=np.linalg.solve(inertia, allowed - bias))

    def _free_arms(self) -> None:
        """Let the arms hold the nominal pose, with low priority."""
        arms, params = self._arms, self._params
        arms.target[:] = self._nominal_arms
        arms.rate[:] = 0.0
        arms.acceleration[:] = 0.0
        arms.weight[:] = params.arm_weight
        arms.stiffness[:], arms.damping[:] = params.arm_gains
        self._arms_free = True

    def _joint_command(self, state: RobotState, solution: QpSolution) -> JointCommand:
        """Return the feed-forward torque with a weak PD about the motion that it should cause.

        The targets of the PD belong to the middle of the period. Along the predicted motion its torque then averages to
        zero, while it damps departures from that motion between two ticks.
        """
        half = 0.5 * self.period
        acceleration = solution.acceleration[self._columns]
        dq = state.dq + half * acceleration
        friction = self.robot.friction_torque(dq)
        # A sticking waist has no speed to compensate friction for, so the desired speed counts.
        waist = self.robot.waist
        sticks = 1.0 - abs(math.tanh(dq[waist] / FRICTION_SPEED))
        friction[waist] += sticks * self.robot.friction[waist] * math.tanh(self._waist.closing[0] / _STICKING_SPEED)
        if turn := self._locomotion.turn:  # likewise hips, which would stick at each landing and let go with a jerk
            hips = self.robot.pair("hip_yaw")
            sticks = 1.0 - np.abs(np.tanh(dq[hips] / FRICTION_SPEED))
            friction[hips] -= sticks * self.robot.friction[hips] * self._hip_ways * math.tanh(turn / FRICTION_SPEED)
        q, held, kp, kd = state.q + half * state.dq, self.robot.held, self._kp, self._kd
        if not self._locomotion.plan.legs:
            q[held], dq[held], kp, kd = self.robot.nominal[held], 0.0, self._holding_kp, self._holding_kd
        return JointCommand(
            q=q,
            dq=dq,
            kp=kp,
            kd=kd,
            tau=np.minimum(np.maximum(solution.torque + friction, -self._highest_torque), self._highest_torque),
        )

    def _fail(self) -> None:
        """Note a tick without a joint command."""
        self._fallbacks += 1
        self._solution = self._unsolved
        self._predictor.record(self._unsolved.acceleration)  # what the guard's command causes is not known

    @property
    def diagnostics(self) -> Diagnostics:
        """State after the last tick, assembled when it is read."""
        plan, solution = self._locomotion.plan, self._solution
        return Diagnostics(
            status=solution.status,
            mode=plan.mode,
            swing=None if plan.swing is None else SIDES[plan.swing],
            contact_forces=dict(zip(CONTACT_POINTS, solution.forces, strict=True)),
            fallbacks=self._fallbacks,
            relaxed=self._relaxed,
            out_of_reach=self._locomotion.walking.out_of_reach,
            failed_plans=self._locomotion.leap.failures,
            friction=self._slip.friction,
        )


def _motion(state: RobotState) -> tuple[np.ndarray, np.ndarray]:
    """Return position and velocity of the pelvis, or refuse a state without them."""
    if state.position is None or state.velocity is None:
        raise ConfigError(
            "qp needs the position and the velocity of the pelvis, which this state lacks; complete it with a "
            "hugwbc.runtime.StateEstimator"
        )
    return state.position, state.velocity
