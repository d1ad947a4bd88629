"""Scripts as YAML files.

    segments:
      - label: wave
        duration: 3
        gait: standing            # optional, like everything but label and duration
        commands: {h: -0.1}
        ramp: 1
        hands:
          frame: pelvis           # pelvis, heading, steady or world
          right_direction: [1, 0, 0]  # along which the forearm points; left_direction likewise
          left_orientation: level # or [w, x, y, z], of a hand with wrists; right_orientation likewise
          together: true          # both hands hold one object
          whole_body: true        # h, p and w may help
          left: {line: {points: [[0.3, 0.3, 0.1], [0.3, 0.3, 0.3]], leg_time: 1, repeat: true}}
          right: mirror           # mirror image of the left; a hand that is left out rests
      - label: gesture
        duration: 5
        motion: wave.npz          # arm joints from a motion file (see `hugwbc.scripts.motion`), instead of hands

A path is one of `hold`, `line`, `grid`, `circle`, `swing` and `wander`, with the fields of the class of that name in
`scripts.hand_paths`, or `file`, the path of a CSV file (t, x, y, z). Paths of CSV and motion files are relative to the
script. YAML anchors may repeat parts.
"""

import pathlib

from hugwbc.robot import Robot
from hugwbc.scripts.script import Script
from hugwbc.settings_file import load, named_path, shipped_names

FOLDER = pathlib.Path(__file__).parent
SCRIPT_NAMES = shipped_names(FOLDER)


def load_script(name: str | pathlib.Path, robot: Robot | None = None) -> Script:
    """Load a shipped script, one of `SCRIPT_NAMES`, or a script from a path that ends in .yaml or .yml.

    Args:
        name: the name or the path.
        robot: whose arms the script's motion files move; a script without such files is for any robot.
    """
    path = named_path("script", name, FOLDER)
    return load(Script, path, robot, name=path.stem)
