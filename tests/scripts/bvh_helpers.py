"""A small person and their clips, written as BVH files."""

import pathlib

import numpy as np

# A person of 40 + 40 cm legs and 30 + 30 cm arms, who stands along y and looks along z: parent, offset [cm].
SKELETON = {
    "Hips": (None, (0, 0, 0)),
    "LeftUpLeg": ("Hips", (10, 0, 0)),
    "LeftLeg": ("LeftUpLeg", (0, -40, 0)),
    "LeftFoot": ("LeftLeg", (0, -40, 0)),
    "RightUpLeg": ("Hips", (-10, 0, 0)),
    "RightLeg": ("RightUpLeg", (0, -40, 0)),
    "RightFoot": ("RightLeg", (0, -40, 0)),
    "Spine": ("Hips", (0, 10, 0)),
    "LeftArm": ("Spine", (18, 40, 0)),
    "LeftForeArm": ("LeftArm", (0, -30, 0)),
    "LeftHand": ("LeftForeArm", (0, 0, 30)),
    "RightArm": ("Spine", (-18, 40, 0)),
    "RightForeArm": ("RightArm", (0, -30, 0)),
    "RightHand": ("RightForeArm", (0, 0, 30)),
    "Head": ("Spine", (0, 60, 0)),
}
FPS, FRAMES = 25, 126  # 5 s


def write_bvh(
    path: pathlib.Path, move=lambda t: {}, *, up="y", unit=1.0, prefix="", without=(), skeleton=SKELETON
) -> pathlib.Path:
    """Write a clip; `move` gives the position of the hips [cm] and angles by joint (about z, x, y) [deg] at a time."""
    parts = {name: part for name, part in skeleton.items() if name not in without}

    def axes(v):
        return np.array(v, dtype=float) if up == "y" else np.array([v[2], v[0], v[1]], dtype=float)

    # The file's axes (z, x, y) are x, y, z where z is up, and the rotations keep their order.
    order = "Zrotation Xrotation Yrotation" if up == "y" else "Xrotation Yrotation Zrotation"

    def node(name, depth):
        offset = " ".join(f"{unit * x:g}" for x in axes(parts[name][1]))
        place = "Xposition Yposition Zposition " if depth == 0 else ""
        lines = [f"{'JOINT' if depth else 'ROOT'} {prefix}{name}", "{", f"OFFSET {offset}"]
        lines.append(f"CHANNELS {3 if depth else 6} {place}{order}")
        children = [child for child, (parent, _) in parts.items() if parent == name]
        for child in children:
            lines += node(child, depth + 1)
        return [*lines, *([] if children else ["End Site", "{", "OFFSET 0 0 0", "}"]), "}"]

    sequence: list[str] = []

    def walk(name):
        sequence.append(name)
        for child, (parent, _) in parts.items():
            if parent == name:
                walk(child)

    root = next(iter(parts))
    walk(root)
    frames = []
    for frame in range(FRAMES):
        pose = move(frame / FPS)
        hips = unit * axes(pose.get("position", (0, 80, 0)))
        angles = [x for name in sequence for x in pose.get(name, (0, 0, 0))]
        frames.append(" ".join(f"{x:.5f}" for x in (*hips, *angles)))
    head = ["HIERARCHY", *node(root, 0), "MOTION", f"Frames: {FRAMES}", f"Frame Time: {1 / FPS:.6f}"]
    path.write_text("\n".join([*head, *frames]) + "\n")
    return path
