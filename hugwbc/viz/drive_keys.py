"""The meaning of keys, gamepad and touch pad of the live page. The page itself only says what is held and pressed."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from hugwbc.gait import Gait

SPEED = {"v_x": 0.6, "v_y": 0.3, "omega": 0.8}  # of a held key [m/s, m/s, rad/s]
FAST_SPEED = {"v_x": 1.2, "v_y": 0.5, "omega": 1.0}  # with shift
BACKWARD = 0.4  # [m/s], of a held key
FULL_TILT = FAST_SPEED  # of a stick pushed all the way
DEAD_ZONE = 0.15  # share of a stick's way that counts as rest; worn sticks do not return to the middle
DEEPEST = -0.3  # [m], of the left trigger

# Held keys: by the place of a key on the keyboard, as browsers name it, whatever letter is printed on it.
HELD: Mapping[str, tuple[str, float]] = {
    "KeyW": ("v_x", 1.0),
    "KeyS": ("v_x", -1.0),
    "KeyA": ("omega", 1.0),
    "KeyD": ("omega", -1.0),
    "KeyQ": ("v_y", 1.0),
    "KeyE": ("v_y", -1.0),
}
SHIFT = ("ShiftLeft", "ShiftRight")
# Pressed keys, and a gamepad's buttons in the order of the browser's standard mapping (W3C, Gamepad, section 11).
PRESSED: Mapping[str, str] = {
    **{f"Digit{number}": gait.label for number, gait in enumerate(Gait, start=1)},
    "Space": "stop",
    "KeyR": "reset",
    "KeyC": "camera",
    "KeyP": "push",
    "KeyZ": "lower",
    "KeyX": "higher",
    "Pad0": Gait.WALKING.label,
    "Pad1": "stop",
    "Pad2": Gait.JUMPING.label,
    "Pad3": "camera",
    "Pad4": Gait.HOPPING_LEFT.label,
    "Pad5": Gait.HOPPING_RIGHT.label,
    "Pad8": "reset",
}
TASK = "task:"  # the beginning of the action that does a task
HIDE = "hide"  # what a page says as the browser hides or closes it
ACTIONS = (*dict.fromkeys(PRESSED.values()), HIDE)
HELP = (
    ("W S", "forward, backward"),
    ("A D", "turn left, right"),
    ("Q E", "step left, right"),
    ("Shift", "faster"),
    ("1 to 5", "gait"),
    ("Z X", "lower, higher"),
    ("Space", "stop and stand, also if another program drives"),
    ("R", "reset"),
    ("C", "camera: follow, turn along, let go"),
    ("P", "push"),
    ("gamepad", "left stick walks, right stick turns, left trigger squats"),
    ("its buttons", "A walk, X jump, LB RB hop, B stop, Y camera, Back reset"),
)
KEY_CODES = (*HELD, *SHIFT, *(code for code in PRESSED if not code.startswith("Pad")))  # that the page takes


@dataclasses.dataclass(frozen=True)
class Touched:
    """What a page's keys and sticks ask for at one time."""

    held: frozenset[str] = frozenset()  # codes of the held keys
    # the gamepad's axes in [-1, 1]: left stick right and down, right stick right and down; empty without one
    axes: tuple[float, ...] = ()
    squat: float = 0.0  # the left trigger in [0, 1]

    @classmethod
    def parse(cls, message: Mapping[str, Any]) -> "Touched":
        """Return the content of a page's message; malformed parts count as not touched."""
        held = message.get("held")
        codes = frozenset(code for code in held if isinstance(code, str)) if isinstance(held, list) else frozenset()
        axes = message.get("axes")
        numbers = tuple(_unit(value) for value in axes[:4]) if isinstance(axes, list) else ()
        return cls(codes, numbers, max(0.0, _unit(message.get("squat"))))

    def commands(self) -> dict[str, float]:
        """Return the requested values of v_x, v_y, omega, and of h where the trigger is pulled; empty if nothing is."""
        speeds = FAST_SPEED if self.held & set(SHIFT) else SPEED
        values: dict[str, float] = {}
        for code in self.held & HELD.keys():
            name, sign = HELD[code]
            values[name] = values.get(name, 0.0) + sign * speeds[name]
        if "v_x" in values:
            values["v_x"] = max(values["v_x"], -BACKWARD)
        if len(self.axes) == 4:
            right, down, turn, _ = (_beyond_dead_zone(value) for value in self.axes)
            for name, share in (("v_x", -down), ("v_y", -right), ("omega", -turn)):
                if share:
                    values[name] = share * FULL_TILT[name]
        if values:  # one key held means that the other directions are at rest
            values = {**dict.fromkeys(SPEED, 0.0), **values}
        if self.squat > DEAD_ZONE:
            values["h"] = self.squat * DEEPEST
        return values


def actions(presses: object, tasks: Sequence[str] = ()) -> list[str]:
    """Return the known actions among what was pressed: codes of keys and buttons, or names of actions.

    The presses are what a page says, whatever it is. The action for a task is `TASK` and its name.
    """
    known = (*ACTIONS, *(f"{TASK}{name}" for name in tasks))
    if not isinstance(presses, Sequence) or isinstance(presses, str):
        return []
    named = (PRESSED.get(press, press) for press in presses if isinstance(press, str))
    return [name for name in named if name in known]


def _unit(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
        return 0.0
    return float(min(max(value, -1.0), 1.0))


def _beyond_dead_zone(value: float) -> float:
    """Return a stick's way beyond the dead zone as a share of the rest, with its sign."""
    share = max(0.0, abs(value) - DEAD_ZONE) / (1.0 - DEAD_ZONE)
    return share if value > 0.0 else -share
