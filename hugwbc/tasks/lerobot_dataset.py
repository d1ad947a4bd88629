"""Demonstrations in files: a data set in the layout of LeRobot, version 3.

FOLDER/
  meta/info.json                                  features with their names, counts, templates of the paths
  meta/stats.json                                 minimum, maximum, mean, deviation and quantiles of each number
  meta/tasks.parquet                              what is to be done, in words
  meta/subtasks.parquet                           the steps of the behaviours, in words
  meta/episodes/chunk-000/file-000.parquet        a row for each episode: its frames, its verdict, its statistics
  data/chunk-000/file-000.parquet                 a row for each frame of the first episode, and so on
  videos/observation.images.head/chunk-000/file-000.mp4   what a camera saw in the first episode, and so on
"""

import contextlib
import json
import os
import pathlib
import shutil
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from hugwbc.errors import ConfigError
from hugwbc.files import LOCK, sole_writer, write_whole
from hugwbc.robot import Robot
from hugwbc.robot_tables import robot_names
from hugwbc.tasks.demonstration import ACTION_NAMES, FPS, Demonstration, pose_names, state_names
from hugwbc.tasks.task import Task

VERSION = "v3.0"
_JOURNAL = "episodes.jsonl"  # of an unfinished data set: its settings, and a line for each complete episode
_FILES_IN_CHUNK = 1000
_FILE_SIZE = 100  # [MB], which readers expect to be told; a file has one episode
_PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_DATA, _EPISODES = f"data/{_PLACE}", f"meta/episodes/{_PLACE}"
_VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_ROUNDING = 2e-7  # of the largest value: statistics are of numbers before they get single precision
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_ARROW = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
_COUNTED = ("frame_index", "episode_index", "index", "task_index", "subtask_index")
Film = tuple[pathlib.Path, Mapping[str, Any]]
"""A film with a picture for each frame of an episode; "min", "max", "mean" and "std" of its channels, from 0 to 1, and
"count", the pictures that these are of."""


def features_of(
    tasks: Sequence[Task], robot: Robot, images: Mapping[str, int] | None = None
) -> dict[str, dict[str, Any]]:
    """Return the columns of the frames: type, shape and the names of their numbers.

    A body has the same seven numbers in all episodes of a task. Tasks of different scenes in one data set share the
    numbers: body k of each of them, from 0, is `object_k`, and unused numbers are 0.

    Args:
        tasks: the tasks.
        robot: the robot.
        images: height and width of the films by camera [pixels]; they are not columns, but files of their own.
    """
    scenes = [task.scene.body_names for task in tasks]
    most = max(len(bodies) for bodies in scenes)
    bodies = scenes[0] if len(set(scenes)) == 1 else [f"object_{place}" for place in range(most)]
    vectors = {
        "observation.state": state_names(robot),
        "observation.environment_state": [name for body in bodies for name in pose_names(body)],
        "action": ACTION_NAMES,
    }
    return {
        **{key: {"dtype": "float32", "shape": [len(names)], "names": list(names)} for key, names in vectors.items()},
        **{key: {"dtype": "bool", "shape": [1], "names": None} for key in ("next.done", "next.success")},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        **{key: {"dtype": "int64", "shape": [1], "names": None} for key in _COUNTED},
        **{f"observation.images.{name}": _video_feature(size) for name, size in (images or {}).items()},
    }


def _video_feature(size: int) -> dict[str, Any]:
    info = {"height": size, "width": size, "channels": 3, "codec": "h264", "pix_fmt": "yuv420p", "fps": FPS}
    info |= {"is_depth_map": False}
    return {
        "dtype": "video",
        "shape": [size, size, 3],
        "names": ["height", "width", "channels"],
        "info": {**{f"video.{name}": value for name, value in info.items()}, "has_audio": False},
    }


class DatasetWriter:
    """A data set that is written episode by episode and appears only when it is complete.

    Use it in a `with` statement. Files go to the hidden folder `.NAME.partial` beside the requested one, which gets its
    name at the end. An error or Ctrl-C ends the data set after the last complete episode. What a killed recording has
    left is continued by the next one with the same settings.
    """

    def __init__(
        self,
        folder: str | pathlib.Path,
        tasks: Sequence[Task],
        robot: Robot,
        images: Mapping[str, int] | None = None,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        """Prepare the columns.

        Args:
            folder: path of the new data set; it must not exist.
            tasks: tasks of which there will be episodes, at least one.
            robot: the robot.
            images: height and width of the films of each episode by camera [pixels]; None for no films.
            settings: what else the episodes depend on, as JSON; a killed recording with others, or with another scene,
                is not continued.
        """
        self.folder = pathlib.Path(folder).absolute()
        if os.path.lexists(self.folder):
            raise ConfigError(f"{folder} is there already; give a new folder, because recordings are never overwritten")
        self._tasks = [task.name for task in tasks]
        self._abouts = [task.about for task in tasks]
        self._robot = robot
        self._features = features_of(tasks, robot, images)
        columns = {key: feature for key, feature in self._features.items() if feature["dtype"] != "video"}
        self._videos = [key for key in self._features if key not in columns]
        self._schema = pa.schema([(key, _arrow_type(feature)) for key, feature in columns.items()])
        self._staging = self.folder.with_name(f".{self.folder.name}.partial")
        self._settings = json.dumps(dict(settings or {}))
        scenes = [repr(task.scene) for task in tasks]  # an edited one has the name of the last
        self._key = json.dumps([self._features, self._tasks, self._settings, scenes])
        self._only = contextlib.ExitStack()
        self._steps: dict[str, int] = {}
        self._seen: dict[str, list[Mapping[str, Any]]] = {}
        self._episodes: list[dict[str, Any]] = []
        self._lines: list[str] = []  # of the journal, one for each episode
        self._frames = 0

    def __enter__(self) -> Self:
        """Make the hidden folder, or continue in that of a killed recording."""
        self._only.enter_context(sole_writer(self._staging))
        journal = self._staging / _JOURNAL
        if journal.exists():
            key, *lines = journal.read_text(encoding="utf-8").splitlines()
            if key != self._key:
                self._only.close()
                raise ConfigError(
                    f"{self._staging} holds an unfinished recording with other settings or another scene; "
                    "repeat it with those, or remove the folder"
                )
            for line in lines:
                with contextlib.suppress(ValueError):  # half a line: the process was killed in the middle of it
                    self._take(**json.loads(line))
        write_whole(journal, "\n".join([self._key, *self._lines]) + "\n")
        return self

    @property
    def recorded(self) -> set[tuple[str, int]]:
        """Task and seed of each episode so far."""
        return {(row["suite_task"], row["seed"]) for row in self._episodes}

    def _take(self, row: dict[str, Any], steps: list[str], images: Mapping[str, Mapping[str, Any]]) -> None:
        """Count an episode whose files are complete."""
        self._episodes.append(row)
        self._lines.append(json.dumps({"row": row, "steps": steps, "images": images}))
        self._steps = {step: number for number, step in enumerate(steps)}
        for key, statistics in images.items():
            self._seen.setdefault(key, []).append(statistics)
        self._frames += row["length"]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Give the data set its name; after an error, with the episodes that are complete, if there are any.

        If that fails too, they stay in the unfinished recording, which the same settings continue.
        """
        complete = False
        try:
            if kind is None or self._episodes:
                self._finish()
                complete = True
        finally:
            if not self._episodes:
                shutil.rmtree(self._staging, ignore_errors=True)
            self._only.close()
        if not complete:
            return
        try:
            self._staging.rename(self.folder)
        except OSError as error:
            raise ConfigError(
                f"cannot give the data set its name {self.folder}: {error.strerror}, something has taken it meanwhile; "
                f"it is in {self._staging}, rename that folder"
            ) from error

    def add(self, episode: Demonstration, films: Mapping[str, Film] | None = None) -> None:
        """Write one episode, and move its films to their places.

        Args:
            episode: the episode.
            films: a film by camera, if the data set has images.
        """
        if episode.task.name not in self._tasks or episode.robot != self._robot.name:
            raise ConfigError(
                f"an episode of task '{episode.task.name}' with robot {episode.robot} is for another data set: this "
                f"one has {', '.join(self._tasks)} with robot {self._robot.name}"
            )
        columns, place = self._columns(episode), _place(len(self._episodes))
        arrays = [_arrow(columns[key], self._schema.field(key).type) for key in self._schema.names]
        path = self._staging / _DATA.format(**place)
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.Table.from_arrays(arrays, schema=self._schema), path)
        count, verdict = len(episode.state), episode.verdict
        videos, images = dict[str, Any](), {}
        for key in self._videos:
            film, statistics = (films or {})[key.rpartition(".")[2]]
            target = self._staging / _VIDEO.format(video_key=key, **place)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(film, target)
            videos |= {f"videos/{key}/{name}": value for name, value in place.items()}
            videos |= {f"videos/{key}/from_timestamp": 0.0, f"videos/{key}/to_timestamp": count / FPS}
            images[key] = {name: np.asarray(value).tolist() for name, value in statistics.items()}
            videos |= {f"stats/{key}/{name}": value for name, value in _of_channels(statistics).items()}
        self._take(
            {
                "episode_index": len(self._episodes),
                "tasks": [episode.task.about],
                "length": count,
                "dataset_from_index": self._frames,
                "dataset_to_index": self._frames + count,
                **{f"data/{name}": value for name, value in place.items()},
                **{f"meta/episodes/{name}": value for name, value in _place(0).items()},
                "suite_task": episode.task.name,
                "seed": episode.seed,
                "controller": episode.controller,
                "settings": self._settings,
                "objects": list(episode.task.scene.body_names),
                "success": verdict.success,
                "score": verdict.score,
                "reason": verdict.reason,
                "detail": verdict.detail,
                **{f"stats/{key}/{name}": x for key, rows in columns.items() for name, x in _stats(rows).items()},
                **videos,
            },
            list(self._steps),
            images,
        )
        with (self._staging / _JOURNAL).open("a", encoding="utf-8") as file:
            file.write(self._lines[-1] + "\n")

    def _columns(self, episode: Demonstration) -> dict[str, np.ndarray]:
        """Return the frames of an episode as columns, shapes (T,) or (T, numbers)."""
        count, numbers = len(episode.state), np.arange(len(episode.state))
        objects = np.zeros((count, self._features["observation.environment_state"]["shape"][0]))
        objects[:, : episode.objects[0].size] = episode.objects.reshape(count, -1)
        last = numbers == count - 1
        steps = [self._steps.setdefault(step, len(self._steps)) for step in episode.steps]
        return {
            "observation.state": episode.state,
            "observation.environment_state": objects,
            "action": episode.action,
            "next.done": last,
            "next.success": last & episode.verdict.success,
            "timestamp": numbers / FPS,
            "frame_index": numbers,
            "episode_index": np.full(count, len(self._episodes)),
            "index": self._frames + numbers,
            "task_index": np.full(count, self._tasks.index(episode.task.name)),
            "subtask_index": np.array(steps),
        }

    def _finish(self) -> None:
        if not self._episodes:
            raise ConfigError("no episode was recorded; add at least one")
        (self._staging / _DATA.format(**_place(len(self._episodes)))).unlink(missing_ok=True)  # of a broken episode
        meta = self._staging / "meta"
        path = self._staging / _EPISODES.format(**_place(0))
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.Table.from_pylist(self._episodes), path)
        _write_words(meta / "tasks.parquet", "task", self._abouts)
        _write_words(meta / "subtasks.parquet", "subtask", list(self._steps))
        numbers = {key: _stats(self._whole(key)) for key in self._schema.names}
        _write_json(meta / "stats.json", numbers | self._image_stats())
        _write_json(meta / "info.json", self._info())
        for name in (_JOURNAL, LOCK):
            (self._staging / name).unlink()

    def _whole(self, key: str) -> np.ndarray:
        """Return a column of all frames, read back from the files."""
        paths = sorted((self._staging / "data").glob("*/*.parquet"))
        tables = [pq.read_table(path, columns=[key]) for path in paths]
        column = pa.concat_tables(tables).column(key)
        if pa.types.is_fixed_size_list(column.type):
            return pc.list_flatten(column).to_numpy().reshape(len(column), -1)
        return column.to_numpy()

    def _image_stats(self) -> dict[str, Any]:
        """Return the statistics of the images of all episodes by camera."""
        found = {}
        for key, parts in self._seen.items():
            counts = np.array([part["count"] for part in parts], dtype=float)[:, None]
            low, high, mean, std = (np.array([part[name] for part in parts]) for name in ("min", "max", "mean", "std"))
            whole = (counts * mean).sum(axis=0) / counts.sum()
            square = (counts * (std**2 + mean**2)).sum(axis=0) / counts.sum()
            spread = np.sqrt(np.maximum(square - whole**2, 0.0))
            total = {"min": low.min(axis=0), "max": high.max(axis=0), "mean": whole, "std": spread}
            found[key] = _of_channels({**total, "count": int(counts.sum())})
        return found

    def _info(self) -> dict[str, Any]:
        name = self._robot.name
        return {
            "codebase_version": VERSION,
            # A robot of the user's own has the path of its table as its name.
            "robot_type": f"unitree_{name}" if name in robot_names() else pathlib.Path(name).stem,
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": _FILES_IN_CHUNK,
            "data_files_size_in_mb": _FILE_SIZE,
            "video_files_size_in_mb": 2 * _FILE_SIZE,
            "fps": FPS,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": _DATA,
            "video_path": _VIDEO if self._videos else None,
            "features": self._features,
        }


def read_episodes(folder: pathlib.Path) -> list[dict[str, Any]]:
    """Return the rows of the episodes of a data set; `settings` are a dictionary, as `DatasetWriter` was given."""
    path = folder / _EPISODES.format(**_place(0))
    try:
        rows = pq.read_table(path).to_pylist()
        names = json.loads((folder / "meta/info.json").read_text())["features"]["action"]["names"]
    except (OSError, pa.ArrowInvalid, ValueError, LookupError, TypeError) as error:
        raise ConfigError(f"{folder} is no data set of `hugwbc tasks --record`: {error}; give its folder") from error
    try:
        for row in rows:
            settings = row["settings"] = json.loads(row["settings"])
            (_, _), _, _ = settings["told"], dict(settings["arena"]), settings["controller"]
    except (LookupError, TypeError, ValueError):
        raise ConfigError(f"{folder} does not say with what settings it was recorded; record it again") from None
    if names != list(ACTION_NAMES):
        other = ", ".join(sorted(set(names) ^ set(ACTION_NAMES))) or "their order"
        raise ConfigError(f"{folder} is of another version of hugwbc, whose actions differ: {other}; record it again")
    return rows


def read_frames(folder: pathlib.Path, row: Mapping[str, Any], key: str) -> np.ndarray:
    """Return a column of the frames of an episode by its row, shape (T, numbers)."""
    path = folder / _DATA.format(**{name: row[f"data/{name}"] for name in _place(0)})
    try:
        table = pq.read_table(path, columns=[key, "episode_index", "frame_index"])
        frames = np.array(table[key].to_pylist(), dtype=float)
        places = list(zip(*(table[name].to_pylist() for name in ("episode_index", "frame_index")), strict=True))
    except (OSError, pa.ArrowInvalid, LookupError, TypeError, ValueError) as error:
        raise ConfigError(f"cannot read {path}: {error}; copy the data set again") from error
    if len(frames) != row["length"]:
        raise ConfigError(f"{path} has {len(frames)} frames, its episode {row['length']}; copy the data set again")
    episode = row["episode_index"]
    if places != [(episode, number) for number in range(len(frames))]:
        raise ConfigError(f"{path} has not the frames of episode {episode} in their order; copy the data set again")
    off = _ROUNDING * np.abs(frames).max(axis=0)
    for name, found in _stats(frames).items():
        if (np.abs(np.array(row[f"stats/{key}/{name}"]) - found) > off).any():
            raise ConfigError(f"{path} has other values of {key} than were recorded; copy the data set again")
    return frames


def _place(number: int) -> dict[str, int]:
    """Return the indices in the path of a file by its number."""
    return {"chunk_index": number // _FILES_IN_CHUNK, "file_index": number % _FILES_IN_CHUNK}


def _arrow_type(feature: Mapping[str, Any]) -> pa.DataType:
    kind, (length,) = _ARROW[feature["dtype"]], feature["shape"]
    return kind if feature["names"] is None else pa.list_(kind, length)


def _arrow(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    if pa.types.is_fixed_size_list(kind):
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel().astype(np.float32)), type=kind)
    return pa.array(values).cast(kind)


def _stats(values: np.ndarray) -> dict[str, list[float] | list[int]]:
    """Return the statistics of each number of a column, shape (T,) or (T, numbers)."""
    rows = values.reshape(len(values), -1).astype(float)
    found = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": rows.mean(axis=0), "std": rows.std(axis=0)}
    quantiles = np.quantile(rows, list(_QUANTILES.values()), axis=0)
    found |= dict(zip(_QUANTILES, quantiles, strict=True))
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(rows)]}


def _of_channels(statistics: Mapping[str, Any]) -> dict[str, Any]:
    """Return statistics of channels in the shape of images: (3, 1, 1)."""
    shaped = {name: np.reshape(statistics[name], (3, 1, 1)).tolist() for name in ("min", "max", "mean", "std")}
    return {**shaped, "count": [statistics["count"]]}


def _write_words(path: pathlib.Path, what: str, words: list[str]) -> None:
    """Write a table from words to numbers, the words as its index: readers look a number up with pandas."""
    table = pa.table({what: pa.array(words, pa.string()), f"{what}_index": pa.array(range(len(words)), pa.int64())})
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
        for name, kind, numpy in ((f"{what}_index", "int64", "int64"), (what, "unicode", "object"))
    ]
    pandas = {"index_columns": [what], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def _write_json(path: pathlib.Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")
