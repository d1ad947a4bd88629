"""The folder of a run: its recipe, the folders of its stages, the sessions that worked on it, what was set aside."""

import dataclasses
import json
import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

from hugwbc.errors import RecipeError
from hugwbc.files import write_whole
from hugwbc.learned.recipe.ancestry import Record, file_problems, read_record
from hugwbc.learned.recipe.ledger import LOCK, SESSIONS, SessionRecord, Spent, read_sessions, spent_on
from hugwbc.learned.recipe.recipe_records import Recipe, Stage, json_digest, usual_file

RECIPE_FILE, STAGES, ABANDONED = "recipe.json", "stages", "abandoned"
PLAN_FILE = "plan.json"  # planned CPU seconds of each stage
CHANGED = "changed"  # of --redo: all stages that the recipe has changed since


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """The folder of a run.

    Attributes:
        path: its path.
    """

    path: pathlib.Path

    def stage(self, name: str) -> pathlib.Path:
        """Return the folder of a stage."""
        return self.path / STAGES / name

    def key(self, name: str) -> str:
        """Return under which name sessions book a stage: one that was begun again has a new one."""
        earlier = len(list((self.path / ABANDONED).glob(f"{name}~*")))
        return f"{name}~{earlier + 1}"

    def spent_on_stage(self, name: str, sessions: Iterable[SessionRecord]) -> Spent:
        """Return what a stage has cost, earlier beginnings of it included."""
        total = Spent()
        for session in sessions:
            for key, spent in session.spent.items():
                if key.rpartition("~")[0] == name:
                    total += spent
        return total

    def sessions(self) -> list[SessionRecord]:
        """Return the sessions so far."""
        return read_sessions(self.path)

    def spent(self) -> Spent:
        """Return what everything in the folder has cost."""
        return spent_on(self.sessions())

    def records(self) -> dict[str, Record]:
        """Return the records of the finished stages, in the order of the recipe."""
        stored = self.stored()
        names = list(stored["stages"]) if stored else []
        found = {name: read_record(self.stage(name)) for name in names}
        return {name: record for name, record in found.items() if record is not None}

    def stored(self) -> dict[str, Any]:
        """Return the recipe as it was stored, with the digest of each stage; empty in a new folder.

        Raises:
            RecipeError: if the file is damaged.
        """
        path = self.path / RECIPE_FILE
        if not path.exists():
            return {}
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(content["stages"], dict) or not isinstance(content["recipe"], dict):
                raise ValueError("its fields are not those of a stored recipe")
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise RecipeError(
                f"{path} is damaged ({error}); copy it back, or start a new run in another folder"
            ) from error
        return content

    def prepare(self, recipe: Recipe, redo: Iterable[str]) -> list[str]:
        """Store the recipe in a new folder, or check that it is the one that runs there; set stages aside.

        Args:
            recipe: the recipe.
            redo: stages to begin again, or `CHANGED`; those that take their results are begun again as well.

        Returns:
            The stages that were set aside.

        Raises:
            RecipeError: if the folder holds a run of another recipe, or other files.
        """
        stored, redo = self.stored(), list(redo)
        if (
            not stored
            and self.path.exists()
            and any(p.name not in ("run.lock", "sessions") for p in self.path.iterdir())
        ):
            raise RecipeError(f"{self.path} holds other files and no run; give an empty or a new folder with --out")
        names = [stage.name for stage in recipe.stages]
        for name in redo:
            if name != CHANGED and name not in names:
                raise RecipeError(f"--redo {name}: there is no such stage. Valid: {', '.join(names)}, {CHANGED}")
        # The settings with their defaults are compared as well: another version of hugwbc may have other defaults.
        digests = {
            stage.name: [recipe.stage_digest(stage.name), json_digest(stage.resolved())] for stage in recipe.stages
        }
        changed = self._changed(stored, digests)
        begun = [name for name in changed if self.stage(name).exists()]
        is_other = bool(stored) and (stored["digest"] != recipe.digest or bool(begun))
        if is_other and CHANGED not in redo:
            raise RecipeError(
                f"the recipe, or a default of hugwbc, has changed since the run in {self.path} began: "
                f"{self._difference(changed, begun)}. Give another --out for the new recipe, or --redo {CHANGED} to go "
                "on here: stages that are the same stay, changed ones begin again, and what they cost counts as "
                f"discarded. `hugwbc recipe diff {self.path} RECIPE` shows the difference"
            )
        again = set(begun if CHANGED in redo else ()) | (set(redo) - {CHANGED})
        for stage in recipe.stages:  # parents come first
            if again & set(stage.parents()):
                again.add(stage.name)
        aside = [name for name in dict.fromkeys([*names, *changed]) if name in again and self.stage(name).exists()]
        for name in aside:
            target = self.path / ABANDONED / self.key(name)
            target.parent.mkdir(parents=True, exist_ok=True)
            self.stage(name).rename(target)
        content = {"digest": recipe.digest, "stages": digests, "recipe": recipe.as_dict()}
        write_whole(self.path / RECIPE_FILE, json.dumps(content, indent=1) + "\n")
        return aside

    @staticmethod
    def _changed(stored: Mapping[str, Any], digests: Mapping[str, Any]) -> list[str]:
        old = stored.get("stages", {})
        return [name for name in dict.fromkeys([*digests, *old]) if old.get(name) != digests.get(name)]

    @staticmethod
    def _difference(changed: list[str], begun: list[str]) -> str:
        if not changed:
            return "its profile or its name"
        return f"stages {', '.join(changed)} differ, of which {', '.join(begun) or 'none'} have begun"

    def inputs(self, recipe: Recipe, stage: Stage) -> dict[str, pathlib.Path]:
        """Return the path of each input of a stage, after checking that the file is what its stage wrote.

        Raises:
            RecipeError: if a parent's file is missing or was changed.
        """
        found: dict[str, pathlib.Path] = {}
        for name, source in stage.inputs.items():
            parent, _, file = source.partition("/")
            file = file or usual_file(name, recipe.stage(parent))
            record = read_record(self.stage(parent))
            if record is None:
                raise RecipeError(
                    f"stage {stage.name} needs {file} of stage {parent}, which is not finished; its record is missing "
                    f"in {self.stage(parent)}. Copy it back, or make it again with --redo {parent}"
                )
            if file not in record.outputs:
                raise RecipeError(
                    f"stage {stage.name} needs {file} of stage {parent}, which wrote {', '.join(record.outputs)} only; "
                    f"change the settings of {parent} so that it is written, or leave out the input '{name}'"
                )
            problems = file_problems(self.stage(parent), {file: record.outputs[file]}, f"stage {parent}")
            if problems:
                raise RecipeError(
                    f"stage {stage.name} cannot begin: {problems[0]}. Copy the file back, or make it again with "
                    f"--redo {parent}"
                )
            found[name] = self.stage(parent) / file
        return found


def _others(folder: pathlib.Path) -> bool:
    """Return whether a folder holds files that no run has written."""
    return any(path.name not in (LOCK, SESSIONS) for path in folder.iterdir())
