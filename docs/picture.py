"""Make the README's picture of both controllers from frames of `hugwbc compare`'s video; `make picture` runs both."""

import json
import pathlib
import sys

import imageio.v2 as imageio
import numpy as np
from PIL import Image

ROOT = pathlib.Path(__file__).parents[1]
VIDEO = ROOT / "out" / "compare" / "compare.mp4"
WIDTH = 1440  # [pixel]
MOMENTS = (4.5, 7.4, 16.5)  # [s], while reaching, walking and squatting


def main() -> None:
    """Write the frames side by side into one picture."""
    outcomes = json.loads(VIDEO.with_name("summary.json").read_text())["controllers"]
    if fallen := [name for name, outcome in outcomes.items() if outcome["fell"]]:
        sys.exit(f"{' and '.join(fallen)} fell")
    reader = imageio.get_reader(VIDEO)
    fps = reader.get_meta_data()["fps"]
    frames = [np.asarray(reader.get_data(round(moment * fps))) for moment in MOMENTS]
    edge = frames[0].shape[1] // 5
    picture = Image.fromarray(np.concatenate([frame[:, edge:-edge] for frame in frames], axis=1))
    size = (WIDTH, round(WIDTH * picture.height / picture.width))
    picture.resize(size, Image.Resampling.LANCZOS).save(ROOT / "docs" / "images" / "compare.png", optimize=True)


if __name__ == "__main__":
    main()
