"""Behaviours: steps that end by what happens, and what is made of them (`docs/how-to/add-a-behaviour.md`)."""

from hugwbc.scripts.behaviours.behaviour import Behaviour, Course, Failure, Status, run, seen
from hugwbc.scripts.behaviours.behaviour_source import BehaviourSource
from hugwbc.scripts.behaviours.composition import OnFailure, Parallel, Retry, Sequence, WaitUntil
from hugwbc.scripts.behaviours.conditions import Arrived, Condition, Contact, Elapsed, ForceAbove, Lifted, Moved
from hugwbc.scripts.behaviours.view import Action, Grip, SeenObject, SeenObjects, View, at_rest, kept, standing

__all__ = [
    "Action",
    "Arrived",
    "Behaviour",
    "BehaviourSource",
    "Condition",
    "Contact",
    "Course",
    "Elapsed",
    "Failure",
    "ForceAbove",
    "Grip",
    "Lifted",
    "Moved",
    "OnFailure",
    "Parallel",
    "Retry",
    "SeenObject",
    "SeenObjects",
    "Sequence",
    "Status",
    "View",
    "WaitUntil",
    "at_rest",
    "kept",
    "run",
    "seen",
    "standing",
]
