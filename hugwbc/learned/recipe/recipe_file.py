"""Recipe files: YAML in, `Recipe` out; every mistake is reported with its line, all of them at once.

Nothing in a file is executed. A recipe can name another one as its parent and say what differs; a profile is such a
set of differences within a file.
"""

import os
import pathlib
from collections.abc import Callable

from hugwbc.errors import RecipeError, UnknownNameError
from hugwbc.learned.recipe.recipe_checks import check
from hugwbc.learned.recipe.recipe_reader import Draft, RecipeReader, Table, recipe_folder, shipped_recipes
from hugwbc.learned.recipe.recipe_records import Recipe

HINT = "a recipe has a list of stages, as docs/how-to/make-a-policy-again.md says"
_FIELDS = (
    "about",
    "parent",
    "seed",
    "measure",
    "rates",
    "settings",
    "stages",
    "without",
    "budget",
    "changes",
    "profiles",
)
_GRANDPARENTS = 5


def recipe_file(name_or_path: str | pathlib.Path) -> pathlib.Path:
    """Find a recipe, given the name of a shipped one or the path of a file.

    Raises:
        UnknownNameError: if it is neither.
    """
    path = pathlib.Path(name_or_path)
    shipped = recipe_folder() / f"{name_or_path}.yaml"
    for candidate in (path, shipped):
        if os.path.isfile(candidate):
            return candidate
    raise UnknownNameError("recipe", name_or_path, [*shipped_recipes(), "the path of a recipe file"])


def load_recipe(
    name_or_path: str | pathlib.Path,
    *,
    profile: str | None = None,
    check_table: Callable[[Table], None] = lambda table: None,
) -> Recipe:
    """Read a recipe and check all of it: names, units, ranges, schedules at every measurement, inputs.

    Args:
        name_or_path: name of a shipped recipe, or path of a file.
        profile: name of a profile in the file, or in its parent.
        check_table: raises a `HugwbcError` on a table of an evaluation that cannot be run.

    Raises:
        UnknownNameError: if there is no such recipe or profile.
        RecipeError: if the file has mistakes; the message has all of them, each with its line.
    """
    path = recipe_file(name_or_path)
    mistakes: list[str] = []
    draft = _read(path, mistakes, depth=0)
    if draft is not None and profile is not None:
        if profile not in draft.profiles:
            raise UnknownNameError("profile", profile, draft.profiles)
        draft.reader_of_profile[profile].change(draft, draft.profiles[profile])
        draft.fields["profile"] = profile
    if draft is not None and not mistakes:
        check(draft, mistakes, check_table)
    if mistakes:
        mistakes = list(dict.fromkeys(mistakes))
        head = f"{len(mistakes)} mistakes in the recipe {path}:\n" if len(mistakes) > 1 else ""
        raise RecipeError(head + "\n".join(mistakes))
    assert draft is not None
    return draft.recipe()


def _read(path: pathlib.Path, mistakes: list[str], depth: int) -> Draft | None:
    reader = RecipeReader(path, mistakes)
    root = reader.attempt(lambda: reader.load("recipe", HINT))
    if root is None:
        return None
    pairs = {key: (at, value) for key, at, value in reader.pairs(root, "recipe")}
    for key, (at, _) in pairs.items():
        if key not in _FIELDS:
            reader.note(at, UnknownNameError("recipe field", key, _FIELDS))
    values = {key: value for key, (_, value) in pairs.items()}
    draft = Draft()
    if "parent" in values:
        if depth >= _GRANDPARENTS:
            reader.note(values["parent"], "the recipe has more than five generations of parents; name its parent")
            return None
        parent = reader.attempt(lambda: reader.parent(values["parent"]))
        found = None if parent is None else _read(parent, mistakes, depth + 1)
        if found is None:
            return None
        draft = found
    draft.fields["name"] = path.stem
    reader.top(draft, values)
    if "stages" in values:
        shared = reader.pairs(values["settings"], "settings") if "settings" in values else []
        reader.stages(draft, values["stages"], shared)
    elif "parent" not in values:
        reader.note(root, f"the recipe has no stages and no parent; {HINT}")
    elif "settings" in values:
        reader.note(values["settings"], "'settings' belongs to a recipe with stages; use 'changes: {all: ...}'")
    reader.without(draft, values)
    if "changes" in values:
        reader.change(draft, values["changes"])
    if "budget" in values:
        reader.budget(draft, values["budget"])
    for name, _, node in reader.pairs(values["profiles"], "profiles") if "profiles" in values else []:
        draft.profiles[name], draft.reader_of_profile[name] = node, reader
    return draft
