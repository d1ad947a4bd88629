"""Behaviours: what a robot does until something has happened, for any controller.

`course` says what a behaviour is and how behaviours are put together; `walk`, `reach`, `hold` and `boxes` have the
steps that they are made of; `fetch_cup` is a whole one. `docs/how-to/add-a-behaviour.md` shows how to write one.
"""

from hugwbc.behaviours.boxes import BoxGrip
from hugwbc.behaviours.course import (
    Behaviour,
    Course,
    Failure,
    at_rest,
    doing,
    kept,
    parallel,
    retry,
    seen,
    standing,
    step,
    wait,
    wait_until,
)
from hugwbc.behaviours.fetch_cup import fetch_cup
from hugwbc.behaviours.hands import glide
from hugwbc.behaviours.hold import carry, lift, place, release, squeeze
from hugwbc.behaviours.reach import grip, press, reach, wipe
from hugwbc.behaviours.source import BEHAVIOUR_NAMES, BehaviourSource, Status, load_behaviour, load_plan
from hugwbc.behaviours.walk import face, pull, push, stand, walk_to
from hugwbc.scripts.view import Action, Grip, SeenObject, SeenObjects, View

__all__ = [
    "BEHAVIOUR_NAMES",
    "Action",
    "Behaviour",
    "BehaviourSource",
    "BoxGrip",
    "Course",
    "Failure",
    "Grip",
    "SeenObject",
    "SeenObjects",
    "Status",
    "View",
    "at_rest",
    "carry",
    "doing",
    "face",
    "fetch_cup",
    "glide",
    "grip",
    "kept",
    "lift",
    "load_behaviour",
    "load_plan",
    "parallel",
    "place",
    "press",
    "pull",
    "push",
    "reach",
    "release",
    "retry",
    "seen",
    "squeeze",
    "stand",
    "standing",
    "step",
    "wait",
    "wait_until",
    "walk_to",
    "wipe",
]
