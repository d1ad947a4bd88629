"""The source of arm targets for a control loop: a watch on the stream of hand targets, inverse kinematics, takeover."""

import math

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.errors import TargetError
from hugwbc.hand_wrench import FREE
from hugwbc.numeric import changed
from hugwbc.robot import Robot
from hugwbc.state import RobotState
from hugwbc.streams import Tally
from hugwbc.targets import HandTargets, frame_axes
from hugwbc.upper_ik.body_reach import BodyReach
from hugwbc.upper_ik.held_targets import HeldTargets
from hugwbc.upper_ik.solver import ArmIK, IKSolution
from hugwbc.upper_ik.steady_hands import SteadyHands
from hugwbc.upper_ik.takeover import Phase, Takeover

STALE_TIME = 0.5  # [s] for which the last target is held without a new one, before the arms go back


class TargetWatch:
    """A watch on a stream of hand targets that passes on the newest good target until it is stale.

    A target without a stamp, such as a script's, is new whenever it arrives. A target with a stamp (see `HandTargets`)
    is new only if it is younger than all before it, by its number if it has one, else by its stamp. After the stream
    has become stale, any other is accepted; otherwise one message from a wrong clock would shut out all that follow.

    Attributes:
        tally: counts of "bad" targets, "late" ones (made before one that had already arrived), "repeated" ones, those
            "missing" by the gaps in their numbers, and of how often the stream went "stale".
        age: time since the newest good target was made [s].
        refusal: why the target that arrived last is bad; empty if it is not.
    """

    def __init__(self, robot: Robot) -> None:
        """Watch for targets of a robot, which may be of its arm joints."""
        self._robot = robot
        self.reset()

    def reset(self) -> None:
        """Forget the stream and the counts."""
        self._now, self.refusal = 0.0, ""
        self.tally = Tally("hand targets", clock=lambda: self._now)
        self.forget()

    def forget(self) -> None:
        """End the stream on purpose and allow a new one to begin."""
        self.age = 0.0
        self._newest: HandTargets | None = None
        self._sequence: int | None = None
        self._stamp: float | None = None
        self._stale = False

    def admit(self, hands: HandTargets, now: float, dt: float) -> HandTargets | None:
        """Return the newest good target, or None without one or once it is stale.

        Args:
            hands: the targets that arrived last.
            now: time on the clock of the stamps [s].
            dt: time since the last tick [s].
        """
        self._now = now
        self.age += dt if 0.0 < dt < math.inf else 0.0
        if self._is_new(hands):
            self.tally.arrived()
            self._newest = hands
            self._stamp = hands.stamp
            self.age = 0.0 if hands.stamp is None else max(0.0, now - hands.stamp)
        # A comparison with NaN is false: an age that is not a number counts as stale.
        stale = self._newest is not None and not self.age <= STALE_TIME
        if stale and not self._stale:
            self.tally.note("stale", f"no new one for {STALE_TIME:g} s, or stamps that lag by more: the arms go back")
        self._stale = stale
        return None if stale else self._newest

    def _is_new(self, hands: HandTargets) -> bool:
        self.refusal = ""
        try:
            hands.check(self._robot)
        except TargetError as error:
            self.refusal = str(error)
            self.tally.note("bad", self.refusal)
            return False
        if hands.stamp is not None and self._stamp is not None:
            ahead = hands.stamp - self._stamp
            if hands.sequence is not None and self._sequence is not None:  # a clock may jump, a number may not
                ahead = hands.sequence - self._sequence
            if ahead == 0 or (ahead < 0 and not self._stale):
                self.tally.note("late" if ahead else "repeated")
                return False
        if hands.sequence is not None:
            if self._sequence is not None:
                self.tally.note("missing", number=max(0, hands.sequence - self._sequence - 1))
            self._sequence = hands.sequence
        return True


class UpperBodySource:
    """The arms' part of a control loop: hand targets in, external arm control out, once in every tick.

    Attributes:
        robot: whose arms it moves.
        ik: the solver.
        takeover: the hand-over of the arms, with its phase.
        watch: the watch on the stream of targets, with the counts of unusable ones.
        refusal: why the hand targets that arrived last were refused; empty if they were not.
        solution: the solver's last answer; None while the arms are released or follow joint targets.
    """

    def __init__(self, robot: Robot) -> None:
        """Build the solver for a robot."""
        self.robot, self.ik = robot, ArmIK(robot)
        self.takeover = Takeover(robot)
        self.watch = TargetWatch(robot)
        self._steady = SteadyHands(robot)
        self._by_joints = False
        self.reset()

    def reset(self) -> None:
        """Release the arms at once, for a new episode."""
        self.takeover.reset()
        self.watch.reset()
        self._held = HeldTargets()
        self._steady.reset()
        self.solution: IKSolution | None = None
        self.refusal = ""
        self._own: np.ndarray | None = None
        self._body_reach: BodyReach | None = None  # built by the first targets that ask for the whole body

    def update(
        self,
        state: RobotState,
        hands: HandTargets | None,
        command: Command,
        dt: float,
        commanded: np.ndarray | None = None,
        followed: Command | None = None,
    ) -> tuple[UpperBody, Command]:
        """Return the external control of the arms for this tick, and the command adapted to the hands.

        Bad numbers never raise: the arms hold their position (`solution`, `refusal`). A stream of targets that ends,
        or that brings nothing usable any more, gives the arms back after `STALE_TIME`.

        Args:
            state: the robot now.
            hands: the targets of the hands or of the arm joints that arrived last; None gives the arms back to the
                controller.
            command: the user's command. Its h, p and w are changed for targets that ask for the whole body
                (`BodyReach`), and brought back afterwards.
            dt: time since the last tick [s].
            commanded: the arm part of the last joint command [rad], shape (k,), if known. A takeover starts there, and
                the next hand-back ends there, as the controller's own pose. Without it, a takeover starts from the
                measured arms and a hand-back ends in the nominal pose.
            followed: the command that the controller followed in the last tick, whose stride hands of the steady frame
                learn: it may step faster than `command`, or walk on before it stands. None for `command`.
        """
        if hands is None:
            self.watch.forget()
        else:
            hands = self.watch.admit(hands, state.time, dt)
            self.refusal = self.watch.refusal
        if hands is None:
            self._held = HeldTargets()
        else:
            hands = self._held.follow(hands, dt)
        if hands is None or hands.joints is not None or hands.frame != "steady":
            self._steady.reset()  # after a pause, what was learned would be out of phase
        arms = self._arms(state, hands, command if followed is None else followed, dt, commanded)
        return arms, self._whole_body(state, hands, command, dt)

    def _arms(
        self, state: RobotState, hands: HandTargets | None, command: Command, dt: float, commanded: np.ndarray | None
    ) -> UpperBody:
        if hands is None:
            self.solution = None
            return self.takeover.release(self._own, dt)
        by_joints = hands.joints is not None
        if self.takeover.phase is not Phase.TAKEN or by_joints is not self._by_joints:
            self.ik.reset(state.q[self.robot.arms])
            self.takeover.blend()
        self._by_joints = by_joints
        start = self._start(commanded) if self.takeover.phase is Phase.RELEASED else None
        if hands.joints is None:
            self.solution = self.ik.solve(self._placed(hands, state, command, dt), state, dt)
            q, dq, ddq = self.solution.q, self.solution.dq, self.solution.ddq
        else:
            self.solution = None
            q, dq, ddq = hands.joints, hands.joint_velocity, None
            dq = np.zeros_like(q) if dq is None else dq
        arms = self.takeover.follow(q, dq, dt, start, ddq)
        if hands.wrench is FREE or not state.is_usable:
            return arms
        force = hands.wrench.force @ frame_axes(hands.frame, state.orientation).T
        return changed(arms, wrench=changed(hands.wrench, force=force))

    def _placed(self, hands: HandTargets, state: RobotState, command: Command, dt: float) -> HandTargets:
        """Return the targets in a frame of the solver: those of the steady frame in that of the pelvis."""
        if hands.frame != "steady" or not state.is_usable:  # the solver refuses such a state, and counts it
            return hands
        measured = self.ik.hands(state.q[self.robot.arms], float(state.q[self.robot.waist]))
        return self._steady.place(hands, measured, state, command, dt)

    def _whole_body(self, state: RobotState, hands: HandTargets | None, command: Command, dt: float) -> Command:
        """Return the command with h, p and w adapted to hand targets with `whole_body`.

        Targets that the arms do not follow, such as the last ones of a stream that has ended, ask for nothing.
        """
        followed = hands if self.solution is not None else None
        if self._body_reach is None:
            if followed is None or not followed.whole_body:
                return command
            self._body_reach = BodyReach(robot=self.robot)
        return self._body_reach.update(followed, state, command, dt)

    def _start(self, commanded: np.ndarray | None) -> np.ndarray:
        """Return the arm command before a takeover, and keep it for the hand-back if the caller knows it."""
        known = commanded is not None and np.all(np.isfinite(commanded))
        self._own = np.array(commanded, dtype=float) if known else None
        return self.ik.q if self._own is None else self._own
