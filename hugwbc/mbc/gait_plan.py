"""Contact schedule: standing, shifting weight, walking, jumping, hopping and landing."""

import enum

import numpy as np

from hugwbc.gait import Gait, advance_phase, foot_phases


class Mode(enum.Enum):
    """The modes of the plan."""

    STANDING = "standing"
    SHIFTING = "shifting weight"
    WALKING = "walking"
    LEAPING = "leaping"
    LANDING = "landing"


_STEPPING = (Mode.WALKING, Mode.LEAPING)
_LONGEST_WAIT = 0.4  # longest wait for a foot that does not find the ground, as a share of the step's duration


class GaitPlan:
    """Gait clock. A walk or a series of leaps ends only at the end of a step.

    A leap on one leg or two is a stance of half a stride and a flight of the other half. The first stance of a series
    is longer, for the countermovement, and the stance after the last flight only brakes.

    Attributes:
        mode: what the plan is doing.
        gait: gait of the mode; standing if it has none.
        phase: common phase of `hugwbc.gait`, in [0, 1); steps end at 0 and 0.5.
        frequency: stride frequency [Hz].
        swing: foot in the air of a walk, 0 for left, 1 for right, or None.
        legs: feet that leap or land; none in other modes. The last flight of a series ends on both.
        elapsed: time since the last change of mode or step [s].
        overdue: time for which the clock has waited for the swing foot of a walk to land [s].
        delay: by how much the current step of a walk ends later than its frequency asks for [s]; negative for sooner.
    """

    def __init__(self, gather_time: float = 0.0) -> None:
        """Stand; the first and the last stance of a series of leaps are longer by the time to gather [s]."""
        self._gather_time = gather_time
        self.reset()

    def reset(self) -> None:
        """Stand, and forget the past."""
        self.frequency = 2.0
        self._enter(Mode.STANDING, Gait.STANDING)

    def _keep_time(self) -> None:
        self.delay = 0.0
        self._pace = 1.0

    @property
    def stepping(self) -> bool:
        """Whether the robot walks or leaps; the clock then runs, except during a countermovement."""
        return self.mode in _STEPPING

    @property
    def step_time(self) -> float:
        """Nominal duration of a step, a stance or a flight [s]: half a stride."""
        return 0.5 / self.frequency

    @property
    def remaining(self) -> float:
        """Time to the end of the step, the stance or the flight [s]; zero when standing or shifting."""
        if self.overdue > 0.0:
            return 0.0
        if self.mode in _STEPPING:
            return self._gather + (0.5 - self.phase % 0.5) / (self.frequency * self._pace)
        return max(self._gather - self.elapsed, 0.0) if self.mode is Mode.LANDING else 0.0

    @property
    def duration(self) -> float:
        """Duration of the current step of a walk, with its delay [s]."""
        return self.step_time + self.delay

    def retime(self, remaining: float) -> None:
        """Let the current step of a walk end in another time [s], above 0; its clock is faster or slower until then."""
        self.delay += remaining - self.remaining
        self._pace = (0.5 - self.phase % 0.5) / (self.frequency * remaining)

    @property
    def stance(self) -> int | None:
        """Foot that carries a step of a walk, 0 for left, 1 for right, or None when both do."""
        return None if self.swing is None else 1 - self.swing

    @property
    def on_both(self) -> bool:
        """Whether both feet leap or land."""
        return len(self.legs) == 2

    @property
    def airborne(self) -> bool:
        """Whether the robot is in flight by the clock."""
        return self.mode is Mode.LEAPING and self.phase >= 0.5

    def advance(
        self,
        gait: Gait,
        frequency: float,
        dt: float,
        *,
        may_start: bool,
        may_stop: bool,
        first_swing: int = 0,
        landed: bool = True,
    ) -> bool:
        """Advance by one tick.

        Args:
            gait: gait as commanded.
            frequency: stride frequency [Hz].
            dt: time since the last tick [s].
            may_start: whether the weight is where the first step or the first leap needs it.
            may_stop: whether the robot can stand where the current step ends.
            first_swing: foot that a walk starts with, 0 for left, 1 for right.
            landed: whether the swing foot of a walk has found the ground. Until it has, the feet keep their roles for a
                while; the clock runs on, so that the next step is shorter.

        Returns:
            Whether a foot lifts off in this tick.
        """
        self.frequency = frequency
        self.elapsed += dt
        if self.mode is Mode.STANDING:
            if gait.flight and not gait.hops:
                if may_start:
                    self._enter(Mode.LEAPING, gait)
                    self._gather = self._gather_time
            elif gait is not Gait.STANDING:
                self._enter(Mode.SHIFTING, gait)
            return False
        if self.mode is Mode.SHIFTING:
            return self._shift(gait, may_start=may_start, first_swing=first_swing)
        if self.mode is Mode.LANDING:
            if self.remaining <= 0.0:
                self._enter(Mode.STANDING, Gait.STANDING)
            return False
        if self._gather > 0.0:  # the clock stands still during a countermovement
            self._gather = max(self._gather - dt, 0.0)
            return False
        # A step ends where the phase crosses 0 or 0.5. A foot that is overdue keeps the step open after the crossing.
        half = self.phase >= 0.5
        self.phase = float(advance_phase(self.phase, frequency * self._pace, dt))
        if (self.phase >= 0.5) is half and self.overdue == 0.0:
            return False
        if self.mode is Mode.WALKING and not landed and self.overdue < _LONGEST_WAIT * self.step_time:
            self.overdue += dt
            return False
        self.overdue = 0.0
        self.elapsed = 0.0
        self._keep_time()
        return self._end_of_step(gait, may_stop=may_stop)

    def _shift(self, gait: Gait, *, may_start: bool, first_swing: int) -> bool:
        """Start the gait once the weight is there, or stand again if another gait is commanded meanwhile."""
        if gait is not self.gait:
            self._enter(Mode.STANDING, Gait.STANDING)
            return False
        if not may_start:
            return False
        if gait.alternates:
            # The left foot swings from phase 0 on, the right one from 0.5.
            self._enter(Mode.WALKING, gait, 0.5 * first_swing)
        else:
            self._enter(Mode.LEAPING, gait)
            self._gather = self._gather_time
        return True

    def _end_of_step(self, gait: Gait, *, may_stop: bool) -> bool:
        """Change feet, or change between stance and flight, or stop; return whether a foot lifts off."""
        stops = gait is not self.gait and may_stop
        if self.mode is Mode.WALKING:
            if stops:
                self._enter(Mode.STANDING, Gait.STANDING)
            self._set_feet()
            return not stops
        if self.airborne:
            self._last = stops  # a series of leaps stops by a flight that lands on both feet
            self._set_feet()
            return True
        if self._last:
            self._enter(Mode.LANDING, self.gait)
            self._gather = self._gather_time + self.step_time  # the clock has ended: this time alone ends the landing
        return False

    def _enter(self, mode: Mode, gait: Gait, phase: float = 0.0) -> None:
        self.mode = mode
        self.gait = gait
        self.elapsed = 0.0
        self.phase = phase
        self._gather = 0.0
        self._last = False
        self.overdue = 0.0
        self._keep_time()
        self._set_feet()

    def _set_feet(self) -> None:
        self.legs: tuple[int, ...] = (0, 1) if self.mode is Mode.LANDING else ()
        if self.mode is Mode.LEAPING:
            self.legs = (0, 1) if self._last else self.gait.feet
        walks = self.mode is Mode.WALKING
        self.swing = int(np.argmax(foot_phases(self.phase, Gait.WALKING))) if walks else None
