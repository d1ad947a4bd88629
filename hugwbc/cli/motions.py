"""`hugwbc motions`: write a library of arm motions, made by the hand IK from a seed."""

import dataclasses
import pathlib
from collections.abc import Sequence

from hugwbc.cli.output import check_folder, parse, progress, say


@dataclasses.dataclass(frozen=True)
class MotionsOptions:
    """Write a library of arm motions (.npz), made by the hand IK: for training and evaluation with `--motions`."""

    out: pathlib.Path = pathlib.Path("out/motions")
    """Folder of the motion files."""
    seed: int = 0
    """Of the motions."""
    count: int = 40
    """How many."""
    duration: float = 30.0
    """Of each [s]."""


def run(words: Sequence[str]) -> int:
    """Parse, make, write."""
    options = parse(MotionsOptions, words, "motions", MotionsOptions.__doc__)
    from hugwbc.upper_ik.motion_library import make_library

    library = make_library(options.seed, options.count, options.duration)
    check_folder(options.out)
    total = 0.0
    with progress(f"{options.count} motions") as advance:
        for index, motion in enumerate(library):
            motion.save(options.out / f"{motion.name}.npz")
            total += motion.duration
            advance((index + 1) / options.count)
    say(f"wrote {options.count} motions, {total / 60.0:.1f} minutes, to {options.out}")
    return 0
