"""A person's drive as a script that any controller can replay."""

import dataclasses
import math
from typing import Any

import numpy as np
import yaml

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.targets import HandTargets

PERIOD = 0.1  # [s] between two samples
SHARE_TOLERANCE = 0.08  # of a command's whole range, by which the script may differ from the drive
HAND_TOLERANCE = 0.02  # [m]
_DECIMALS = 3


@dataclasses.dataclass(frozen=True)
class _Sample:
    time: float
    gait: Gait
    values: np.ndarray  # the commands, then the hands if there are any
    hands: tuple[str, bool] | None  # frame, whole body


class DriveLog:
    """Commands and hand targets over time, kept every `PERIOD`."""

    def __init__(self) -> None:
        self._samples: list[_Sample] = []

    def add(self, t: float, command: Command, hands: HandTargets | None) -> None:
        """Take what is commanded at time t [s]; times must not decrease."""
        if self._samples and t < self._samples[-1].time + PERIOD - 1e-9:
            return
        values, how = command.array(), None
        if hands is not None and hands.left is not None and hands.right is not None:
            values, how = np.concatenate((values, hands.left, hands.right)), (hands.frame, hands.whole_body)
        self._samples.append(_Sample(t, command.gait, values, how))

    def script(self, about: str) -> str:
        """Return the drive as the text of a script (`hugwbc.scripts.script_file`).

        A segment begins where the gait or the use of the hands changes, and where one ramp no longer describes the
        commands to `SHARE_TOLERANCE` of their ranges. A script begins at rest, wherever the drive was.
        """
        if len(self._samples) < 2:
            raise ConfigError("the drive was not recorded for long enough; record at least a second")
        ends = self._ends()
        segments: list[dict[str, Any]] = []
        begin = 0
        for end in ends:
            # The sample before a change of gait belongs to the segment, the change itself to the next one.
            length = round(self._samples[end].time - self._samples[begin].time, _DECIMALS)
            segments.append(self._segment(begin, end, length))
            begin = end
        return yaml.safe_dump({"about": about, "segments": segments}, sort_keys=False, width=110)

    def _ends(self) -> list[int]:
        """Return the index of the last sample of each segment, which is the first one of the next."""
        samples, ends, begin = self._samples, [], 0
        for index in range(1, len(samples)):
            new_kind = (samples[index].gait, samples[index].hands) != (samples[begin].gait, samples[begin].hands)
            if new_kind:
                ends.append(index)
                begin = index
            elif index - begin > 1 and not self._one_ramp(begin, index):
                ends.append(index - 1)
                begin = index - 1
        return ends if ends and ends[-1] == len(samples) - 1 else [*ends, len(samples) - 1]

    def _one_ramp(self, begin: int, end: int) -> bool:
        """Return whether a straight ramp between two samples passes close to those between them."""
        first, last = self._samples[begin], self._samples[end]
        share = np.array([(s.time - first.time) / (last.time - first.time) for s in self._samples[begin : end + 1]])
        straight = first.values + share[:, None] * (last.values - first.values)
        off = np.abs(straight - np.stack([s.values for s in self._samples[begin : end + 1]])).max(axis=0)
        return bool(np.all(off <= _tolerance(off.size)))

    def _segment(self, begin: int, end: int, length: float) -> dict[str, Any]:
        first, last = self._samples[begin], self._samples[end]
        # Where the gait changes, the next segment starts from values that both gaits admit.
        values = last.values if last.hands == first.hands else self._samples[end - 1].values
        command = Command.from_array(values[: len(COMMAND_NAMES)], last.gait).clamp()[0]
        given = {}
        for name, limits in command_ranges(first.gait).items():
            low, high = limits.finishing
            value = round(min(max(getattr(command, name), low), high), _DECIMALS)
            if not math.isclose(value, limits.default, abs_tol=10.0**-_DECIMALS):
                given[name] = value
        label = " ".join([first.gait.label.replace("_", " "), *(f"{name} {value:g}" for name, value in given.items())])
        segment: dict[str, Any] = {"label": label, "duration": length, "gait": first.gait.label}
        if given:
            segment["commands"] = given
        segment["ramp"] = length
        if first.hands is not None:
            frame, whole_body = first.hands
            left, right = np.round(values[len(COMMAND_NAMES) :].reshape(2, 3), _DECIMALS).tolist()
            segment["hands"] = {"frame": frame, "left": {"hold": left}, "right": {"hold": right}}
            if whole_body:
                segment["hands"]["whole_body"] = True
        return segment


def _tolerance(size: int) -> np.ndarray:
    widths = [high - low for low, high in (limits.finishing for limits in command_ranges(Gait.WALKING).values())]
    hands = np.full(size - len(widths), HAND_TOLERANCE)
    return np.concatenate((SHARE_TOLERANCE * np.array(widths), hands))
