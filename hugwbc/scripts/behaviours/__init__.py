"""Behaviours: steps that end by what happens, and what is made of them (`docs/how-to/add-a-behaviour.md`)."""

from hugwbc.scripts.behaviours.behaviour import Behaviour, Course, Failure, Status, run, seen
from hugwbc.scripts.behaviours.behaviour_file import BEHAVIOUR_NAMES, load_behaviour, load_plan
from hugwbc.scripts.behaviours.behaviour_source import BehaviourSource
from hugwbc.scripts.behaviours.composition import OnFailure, Parallel, Retry, Sequence, WaitUntil
from hugwbc.scripts.behaviours.conditions import Arrived, Condition, Contact, Elapsed, ForceAbove, Lifted, Moved
from hugwbc.scripts.behaviours.hand_steps import MoveHands, Press, Reach, Wipe
from hugwbc.scripts.behaviours.haul_steps import Pull, Push, Stand
from hugwbc.scripts.behaviours.hold_steps import Attach, Carry, Grasp, Lift, Place, Release, Squeeze
from hugwbc.scripts.behaviours.view import Action, Grip, SeenObject, SeenObjects, View, at_rest, kept, standing
from hugwbc.scripts.behaviours.walk_steps import Face, Goal, Walk, WalkTo

__all__ = [
    "BEHAVIOUR_NAMES",
    "Action",
    "Arrived",
    "Attach",
    "Behaviour",
    "BehaviourSource",
    "Carry",
    "Condition",
    "Contact",
    "Course",
    "Elapsed",
    "Face",
    "Failure",
    "ForceAbove",
    "Goal",
    "Grasp",
    "Grip",
    "Lift",
    "Lifted",
    "MoveHands",
    "Moved",
    "OnFailure",
    "Parallel",
    "Place",
    "Press",
    "Pull",
    "Push",
    "Reach",
    "Release",
    "Retry",
    "SeenObject",
    "SeenObjects",
    "Sequence",
    "Squeeze",
    "Stand",
    "Status",
    "View",
    "WaitUntil",
    "Walk",
    "WalkTo",
    "Wipe",
    "at_rest",
    "kept",
    "load_behaviour",
    "load_plan",
    "run",
    "seen",
    "standing",
]
