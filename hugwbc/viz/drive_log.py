"""A person's drive as a script that any controller can replay."""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
import yaml

from hugwbc.commands import Command, command_ranges
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.targets import HandTargets

PERIOD = 0.5  # [s], longest segment
_DECIMALS = 3


class _Sample(NamedTuple):
    time: float
    command: Command
    hands: HandTargets | None

    @property
    def kind(self) -> tuple[Gait, tuple[str, bool] | None]:
        """What cannot change within a segment: the gait, and how hand targets are given."""
        return self.command.gait, None if self.hands is None else (self.hands.frame, self.hands.whole_body)


class DriveLog:
    """Commands and hand targets over time, kept every `PERIOD` and where the gait or the use of the hands changes."""

    def __init__(self) -> None:
        self._samples: list[_Sample] = []
        self._end: _Sample | None = None

    def add(self, t: float, command: Command, hands: HandTargets | None) -> None:
        """Take what is commanded at time t [s]; times must not decrease. Targets of a single hand are left out."""
        sample = _Sample(t, command, None if hands is None or hands.left is None or hands.right is None else hands)
        last, self._end = self._samples[-1] if self._samples else None, sample
        if last is None or sample.kind != last.kind or t >= last.time + PERIOD - 1e-9:
            self._samples.append(sample)

    def script(self, about: str) -> str:
        """Return the drive as the text of a script (`hugwbc.scripts.script_file`), with a description for people.

        A segment ramps from one sample to the next. A script begins at rest, wherever the drive was.
        """
        if self._end is None or self._end.time < self._samples[0].time + PERIOD:
            raise ConfigError("the drive was not recorded for long enough; record at least a second")
        segments: list[dict[str, Any]] = []
        for first, last in itertools.pairwise([*self._samples, self._end]):
            segment, length = _segment(first, last), round(last.time - first.time, _DECIMALS)
            if length <= 0.0:
                continue
            if segments and segment.items() <= segments[-1].items():
                segments[-1]["duration"] = round(segments[-1]["duration"] + length, _DECIMALS)
            else:
                segments.append(segment | {"duration": length, "ramp": length})
        return yaml.safe_dump({"about": about, "segments": segments}, sort_keys=False, width=110)


def _segment(first: _Sample, last: _Sample) -> dict[str, Any]:
    """Return what a segment says apart from its length."""
    # Where the kind changes, the next segment starts from values that both admit.
    given, hands = {}, last.hands if first.kind[1] == last.kind[1] else first.hands
    for name, limits in command_ranges(first.command.gait).items():
        low, high = limits.finishing
        value = round(min(max(getattr(last.command, name), low), high), _DECIMALS)
        if not math.isclose(value, limits.default, abs_tol=10.0**-_DECIMALS):
            given[name] = value
    gait = first.command.gait.label
    label = " ".join([gait.replace("_", " "), *(f"{name} {value:g}" for name, value in given.items())])
    segment: dict[str, Any] = {"label": label, "gait": gait, "commands": given}
    if hands is not None:
        left, right = np.round(hands.array(), _DECIMALS).tolist()
        segment["hands"] = {"frame": hands.frame, "left": {"hold": left}, "right": {"hold": right}}
        segment["hands"]["whole_body"] = hands.whole_body
    return segment
