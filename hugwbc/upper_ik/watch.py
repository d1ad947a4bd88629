"""A watch on the stream of hand targets: what is not usable is counted and ignored, the end of a stream is noticed."""

import dataclasses
import math

from hugwbc.targets import HandTargets


@dataclasses.dataclass(frozen=True)
class TargetCounts:
    """What arrived besides good targets, since `TargetWatch.reset`.

    Attributes:
        bad: targets with a number that is not finite, their stamp included, or a shape that is no point.
        late: targets that were made before one that had already arrived.
        repeated: targets that had already arrived.
        dropped: targets that never arrived, by the gaps in their sequence.
        stale: how often the stream ended, so that the arms went back to the controller.
    """

    bad: int = 0
    late: int = 0
    repeated: int = 0
    dropped: int = 0
    stale: int = 0


class TargetWatch:
    """Passes on the newest good target until it is stale.

    A target without a stamp is new whenever it arrives: a script's is. One with a stamp (see `HandTargets`) is new only
    if it is younger than the ones before. A stream that has become stale may go on with any other stamp, so that one
    message from a wrong clock does not shut out all that follow.

    Attributes:
        counts: what arrived besides good targets.
        age: time since the newest good target was made [s].
    """

    def __init__(self, stale_time: float) -> None:
        """Nothing has arrived yet; `stale_time` [s] after the last good target there is none any more."""
        self.stale_time = stale_time
        self.reset()

    def reset(self) -> None:
        """Forget the stream and the counts."""
        self.counts = TargetCounts()
        self.forget()

    def forget(self) -> None:
        """The stream has been ended on purpose; a new one may begin."""
        self.age = 0.0
        self._newest: HandTargets | None = None
        self._sequence: int | None = None
        self._stamp: float | None = None
        self._stale = False

    def admit(self, hands: HandTargets, now: float, dt: float) -> HandTargets | None:
        """The target to follow in this tick: the newest good one, or None if there is none or it is stale.

        Args:
            hands: what arrived last.
            now: time on the clock of the stamps [s].
            dt: time since the last tick [s].
        """
        self.age += dt if 0.0 < dt < math.inf else 0.0
        if self._is_new(hands):
            self._newest = hands
            self._stamp = hands.stamp
            self.age = 0.0 if hands.stamp is None else max(0.0, now - hands.stamp)
        stale = self._newest is not None and not self.age <= self.stale_time
        if stale and not self._stale:
            self._count("stale")
        self._stale = stale
        return None if stale else self._newest

    def _is_new(self, hands: HandTargets) -> bool:
        if not hands.is_usable or (hands.stamp is not None and not math.isfinite(hands.stamp)):
            self._count("bad")
            return False
        if hands.stamp is not None and self._stamp is not None:
            repeated = hands.stamp == self._stamp
            if repeated or (hands.stamp < self._stamp and not self._stale):
                self._count("repeated" if repeated else "late")
                return False
        if hands.sequence is not None:
            if self._sequence is not None:
                self._count("dropped", max(0, hands.sequence - self._sequence - 1))
            self._sequence = hands.sequence
        return True

    def _count(self, name: str, by: int = 1) -> None:
        self.counts = dataclasses.replace(self.counts, **{name: getattr(self.counts, name) + by})
