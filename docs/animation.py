"""Make the README's animation from videos of `hugwbc compare`; `make animation` runs all of it.

Each robot does the whole task in the same ten seconds, so the slower one is played faster; the caption says how much.
"""

import json
import pathlib
import sys

import imageio.v2 as imageio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

ROOT = pathlib.Path(__file__).parents[1]
VIDEOS = ROOT / "out" / "animation"
TASK = "fetch box"
SHOWN = {"qp": "H1, QP", "learned": "H1, policy", "g1": "G1, QP"}  # folders, from left to right
LENGTH, FPS = 10.0, 10  # [s], [1/s]; the format counts the time of a frame in hundredths of a second
SIZE, CAPTION = (270, 300), 24  # [pixel]
COLOURED = 36  # difference of the channels of a pixel, of 255, from which it is not grey
COLOURS = 192  # few, because the size of the file grows with them


def frames(folder: str) -> list[Image.Image]:
    """Return the frames of one video, its middle cut out, with a caption below."""
    outcomes = json.loads((VIDEOS / folder / "summary.json").read_text())["controllers"].values()
    if not all(outcome["verdict"]["success"] for outcome in outcomes):
        sys.exit(f"the robot in out/animation/{folder} did not do the task; choose another seed")
    reader = imageio.get_reader(VIDEOS / folder / "compare.mp4")
    about = reader.get_meta_data()
    count, seconds = round(LENGTH * FPS), about["duration"]
    font, caption = ImageFont.load_default(size=14), f"{SHOWN[folder]}: {TASK}, {seconds / LENGTH:.1f} x"
    pictures = []
    for number in range(count):
        moment = min(number / (count - 1) * seconds, seconds - 2.0 / about["fps"])
        frame = Image.fromarray(reader.get_data(int(moment * about["fps"])))
        width = frame.height * SIZE[0] // SIZE[1]
        left = (frame.width - width) // 2
        picture = Image.new("RGB", (SIZE[0], SIZE[1] + CAPTION), "white")
        picture.paste(frame.crop((left, 0, left + width, frame.height)).resize(SIZE, Image.Resampling.LANCZOS))
        ImageDraw.Draw(picture).text((SIZE[0] / 2, SIZE[1] + CAPTION / 2), caption, "black", font, anchor="mm")
        pictures.append(picture)
    return pictures


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """Return an image with the palette for all frames. The few coloured pixels count as much in it as the grey ones."""
    pixels = np.concatenate([np.asarray(picture).reshape(-1, 3) for picture in pictures[::20]])
    coloured = pixels[np.ptp(pixels, axis=1) > COLOURED]
    chosen = np.concatenate([pixels[:: max(1, len(pixels) // max(1, len(coloured)))], coloured])
    return Image.fromarray(chosen[None]).quantize(COLOURS)


def main() -> None:
    """Write the robots side by side into one GIF, with one palette for all frames."""
    columns = [frames(folder) for folder in SHOWN]
    pictures = []
    for row in zip(*columns, strict=True):
        picture = Image.new("RGB", (SIZE[0] * len(row), row[0].height))
        for column, part in enumerate(row):
            picture.paste(part, (column * SIZE[0], 0))
        pictures.append(picture)
    palette = _palette(pictures)
    first, *others = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    path = ROOT / "docs" / "images" / "tasks.gif"
    first.save(path, save_all=True, append_images=others, duration=round(1000 / FPS), loop=0, optimize=True)
    print(f"wrote {path.relative_to(ROOT)}, {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
