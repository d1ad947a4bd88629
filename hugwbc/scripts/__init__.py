"""Requests to a robot over time: command scripts, hand paths, motions, and the shipped scripts (*.yaml)."""

from hugwbc.scripts.hand_paths import Circle, Grid, HandPath, Hold, Line, Swing, Wander, read_path
from hugwbc.scripts.motion import ArmMotion, generate_motions, load_motion, load_motions
from hugwbc.scripts.script import SCRIPT_NAMES, HandMotion, Script, Segment, load_script, while_walking
from hugwbc.scripts.view import CommandSource, Constant, SeeingSource

__all__ = [
    "SCRIPT_NAMES",
    "ArmMotion",
    "Circle",
    "CommandSource",
    "Constant",
    "Grid",
    "HandMotion",
    "HandPath",
    "Hold",
    "Line",
    "Script",
    "SeeingSource",
    "Segment",
    "Swing",
    "Wander",
    "generate_motions",
    "load_motion",
    "load_motions",
    "load_script",
    "read_path",
    "while_walking",
]
