"""Records of runs as files: one .npz with every array and a text for the rest, without pickled objects."""

import dataclasses
import io
import json
import pathlib
from typing import Any

import numpy as np

from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.files import write_whole, writing
from hugwbc.runtime.safety_report import SafetyReport
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.motion import UNREADABLE
from hugwbc.settings_file import parse
from hugwbc.sim.scenes.scene import Scene

FORMAT = 1
_ABOUT = "about"  # name of the array that holds the text


def write_trace(path: str | pathlib.Path, trace: Trace) -> pathlib.Path:
    """Write a record to a file and return its path.

    Args:
        path: path of the file; .npz is added to a name without it.
        trace: the record.
    """
    path = pathlib.Path(path)
    path = path if path.suffix == ".npz" else path.with_name(f"{path.name}.npz")
    arrays: dict[str, np.ndarray] = {}
    about: dict[str, Any] = {"format": FORMAT, "pairs": []}
    for field in dataclasses.fields(Trace):
        value = getattr(trace, field.name)
        if isinstance(value, np.ndarray):
            arrays[field.name] = value
        elif field.name == "scene":
            about["scene"] = None if value is None else scene_text(value)
        elif field.name == "safety":
            about["safety"] = dataclasses.asdict(value)
        elif isinstance(value, tuple) and field.name != "problems":  # one array for each foot
            about["pairs"].append(field.name)
            arrays |= {f"{field.name}/{foot}": entry for foot, entry in enumerate(value)}
        else:
            about[field.name] = value
    file = io.BytesIO()
    arrays[_ABOUT] = np.array(json.dumps(about))
    np.savez_compressed(file, allow_pickle=False, **arrays)
    with writing(path):
        write_whole(path, file.getvalue())
    return path


def read_trace(path: str | pathlib.Path) -> Trace:
    """Read a record that `write_trace` wrote.

    Args:
        path: path of the file.
    """
    path = pathlib.Path(path)
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        about = json.loads(str(arrays.pop(_ABOUT)[()]))
        if about.pop("format") != FORMAT:
            raise ConfigError(f"{path} was written by another version of hugwbc; run it again to record it anew")
        for name in about.pop("pairs"):
            arrays[name] = (arrays.pop(f"{name}/0"), arrays.pop(f"{name}/1"))
        about["safety"] = SafetyReport(**about["safety"] | {"messages": tuple(about["safety"]["messages"])})
        about["problems"] = tuple(about["problems"])
        if about["scene"] is not None:
            about["scene"] = parse(Scene, about["scene"], path)
        return Trace(**about, **arrays)
    except OSError as error:
        raise ConfigError(
            f"cannot read {path}: {error.strerror or error}; give a file that write_trace wrote"
        ) from error
    except HugwbcError:
        raise
    except (*UNREADABLE, TypeError, AttributeError) as error:
        raise ConfigError(f"{path} is not a recorded run ({error}); give a file that write_trace wrote") from error


def scene_text(scene: Scene) -> str:
    """Return a scene without variation as text that `settings_file.parse` reads: JSON, which is YAML as well."""
    things = []
    for thing in scene.objects:
        fields = {field.name: getattr(thing, field.name) for field in dataclasses.fields(thing)}
        given = {name: value for name, value in fields.items() if value is not None}
        if "mjcf" in given:
            given["mjcf"] = str(pathlib.Path(given["mjcf"]).resolve())
        else:
            given = {"kind": thing.kind, **given}
        things.append(given)
    whole = {"about": scene.about, "robot": scene.robot, "ground": scene.ground, "objects": things}
    return json.dumps({name: value for name, value in whole.items() if value is not None}, ensure_ascii=False)
