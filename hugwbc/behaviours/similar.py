"""A behaviour for another robot of the same shape: it sees and commands in the lengths of the one it was made for.

Where lengths grow by a factor s and densities stay, weights and forces grow by s^3, and stiffnesses by s^2. Times stay.
"""

import dataclasses
import re

import numpy as np

from hugwbc.behaviours.course import Behaviour, Course, Failure
from hugwbc.hand_wrench import FREE, HandWrench
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot
from hugwbc.robot_tables import DEFAULT_ROBOT
from hugwbc.scripts.view import Action, SeenObjects, View
from hugwbc.targets import HandTargets

_A_LENGTH = re.compile(r"\d [mc]?m\b")  # in the words of a failure
_LENGTHS = ("v_x", "v_y", "l", "h")
_SEEN = {"position": 1, "velocity": 1, "hand_force": 3, "foot_force": 3}  # of a state, and their powers of the size


def similar(behaviour: Behaviour, size: float, robot: Robot | None = None) -> Behaviour:
    """Return a behaviour for a robot whose lengths are `size` times those of the robot that it was made for.

    Args:
        behaviour: the behaviour.
        size: the factor of the lengths.
        robot: the one that it was made for, whose ranges and defaults its commands have; None for the paper's.
    """

    def course(view: View) -> Course:
        inner = behaviour(_seen(view, 1.0 / size, robot))
        try:
            action = next(inner)
            while True:
                view = yield _asked(action, size)
                action = inner.send(_seen(view, 1.0 / size, robot))
        except StopIteration:
            return view
        except Failure as failure:
            said = f"{failure}, in lengths of {DEFAULT_ROBOT if robot is None else robot.name}"
            raise Failure(said, named=failure.named) if _A_LENGTH.search(said) else failure from None

    return behaviour if size == 1.0 else course


def _seen(view: View, size: float, robot: Robot | None) -> View:
    state = changed(
        view.state,
        **{n: size**power * value for n, power in _SEEN.items() if (value := getattr(view.state, n)) is not None},
    )
    seen = list(view.objects.values())
    poses = np.array([np.concatenate((size * one.position, one.orientation)) for one in seen]).reshape(-1, 7)
    return dataclasses.replace(
        view,
        state=state,
        hands=size * view.hands,
        objects=SeenObjects(tuple(view.objects), poses, seen[0].age if seen else 0.0),
        hand_force=None if view.hand_force is None else size**3 * view.hand_force,
        last=_asked(view.last, size),
        stop=view.stop * (size, size, 1.0),
        lag=view.lag * (size, size, 1.0),
        stuck=view.stuck,
        mid_stance=view.mid_stance,
        robot=robot,
        hand_tip=size * view.hand_tip,
        hand_half_width=size * view.hand_half_width,
    )


def _asked(action: Action, size: float) -> Action:
    lengths = {name: size * getattr(action.command, name) for name in _LENGTHS}
    return dataclasses.replace(
        action,
        command=dataclasses.replace(action.command, **lengths),
        hands=None if action.hands is None else _hands(action.hands, size),
        grips=tuple(dataclasses.replace(one, breaking_force=size**3 * one.breaking_force) for one in action.grips),
    )


def _hands(hands: HandTargets, size: float) -> HandTargets:
    points = {name: size * point for name in SIDES if (point := getattr(hands, name)) is not None}
    weight = None if hands.orientation_weight is None else size**2 * hands.orientation_weight
    return changed(hands, **points, wrench=_wrench(hands.wrench, size), orientation_weight=weight)


def _wrench(wrench: HandWrench, size: float) -> HandWrench:
    if wrench is FREE:
        return wrench
    payload, stiffness = wrench.payload, wrench.stiffness
    return HandWrench(
        size**3 * wrench.force,
        None if payload is None else size**3 * payload,
        None if stiffness is None else size**2 * stiffness,
    )
