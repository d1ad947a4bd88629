"""Measure training on a GPU that is there for minutes only, on a machine without a package index.

    python tools/gpu_window.py pack FOLDER SITE    # here: what must travel, in parts of at most 60 MiB
    python tools/gpu_window.py unpack FOLDER SITE  # there; then with PYTHONPATH=SITE:. and WARP_CACHE_PATH set
    python tools/gpu_window.py measure --out FILE.jsonl --seconds 300
    python -m hugwbc.cli train --recipe FILE.yaml --out RUN --device cuda --env.count 8192

SITE holds warp-lang, mujoco-warp, mujoco and mujoco-core, made by pip install --target SITE --no-deps; other packages
that are missing there are carried as wheels. Those of the QP and the arms, which training imports and does not use, are
large, and stay behind: `unpack` writes empty modules in their place. `measure` writes a line for each finding at once,
so that a cut loses one: throughput by number of robots, with and without the graph, and shares by part. Keep the folder
of WARP_CACHE_PATH: with it, the next window compiles nothing.
"""

import argparse
import dataclasses
import io
import json
import pathlib
import struct
import tarfile
import time

PART = 60 << 20  # bytes
KEPT = {90}  # compute capabilities whose machine code travels
_BLOCK, _CODE = struct.Struct("<IHHQ"), struct.Struct("<HHIQ")  # headers of a fat binary, and of the code of one GPU
UNUSED = ("pinocchio", "placo", "proxsuite")
EMPTY = '''"""Stands for a package that training imports and does not use."""
import numpy


def skew(vector):
    return numpy.zeros((3, 3))


def __getattr__(name):
    if name.startswith("__"):
        raise AttributeError(name)
    return object
'''
_MAGIC, _CAPABILITY = 0xBA55ED50, 28  # first number of a fat binary; place of the capability in the second header


def pruned(library: bytes) -> bytes:
    """Return warp.so with zeros for the machine code of other GPUs, so that it compresses; headers stay."""
    data, place = bytearray(library), 0
    while (place := data.find(struct.pack("<I", _MAGIC), place)) >= 0:
        _, version, header, size = _BLOCK.unpack_from(data, place)
        code, end = place + header, place + header + size
        if version != 1 or header != _BLOCK.size or end > len(data):
            place += 4
            continue
        while code < end:
            _, _, header, size = _CODE.unpack_from(data, code)
            (capability,) = struct.unpack_from("<I", data, code + _CAPABILITY)
            if capability not in KEPT:
                data[code + header : code + header + size] = bytes(size)
            code += header + size
        place = end
    return bytes(data)


def pack(folder: pathlib.Path, site: pathlib.Path) -> None:
    """Compress the packages into parts; warp-clang.so, which serves processors, stays behind."""
    folder.mkdir(parents=True, exist_ok=True)
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:xz", preset=6) as tar:
        for path in sorted(site.rglob("*")):
            if not path.is_file() or path.name == "warp-clang.so" or "__pycache__" in path.parts:
                continue
            data = pruned(path.read_bytes()) if path.name == "warp.so" else path.read_bytes()
            entry = tarfile.TarInfo(str(path.relative_to(site)))
            entry.size, entry.mode = len(data), path.stat().st_mode
            tar.addfile(entry, io.BytesIO(data))
    content = packed.getvalue()
    starts = range(0, len(content), PART)
    for number, start in enumerate(starts):
        (folder / f"site.part{number:03}").write_bytes(content[start : start + PART])
    print(f"{len(content) / 2**20:.1f} MiB in {len(starts)} parts")


def unpack(folder: pathlib.Path, site: pathlib.Path) -> None:
    """Put the parts together."""
    content = b"".join(path.read_bytes() for path in sorted(folder.glob("site.part*")))
    with tarfile.open(fileobj=io.BytesIO(content)) as tar:
        tar.extractall(site, filter="data")
    for name in UNUSED:
        (site / f"{name}.py").write_text(EMPTY)


def measure(out: pathlib.Path, counts: list[int], seconds: float, device: str, steps: int) -> None:
    """Measure by number of robots until the time is over."""
    import torch

    from hugwbc.evaluation.speed import training_speed
    from hugwbc.learned.policy.records import versions
    from hugwbc.source import short_commit

    begin = time.monotonic()

    def note(**figures: object) -> None:
        line = json.dumps({"at": round(time.monotonic() - begin, 1), **figures})
        print(line, flush=True)
        with out.open("a") as file:
            file.write(line + "\n")

    name = torch.cuda.get_device_name() if device == "cuda" else "processor"
    note(device=name, commit=short_commit(), versions=versions())
    for count in counts:
        if time.monotonic() - begin > seconds:
            return
        try:
            for graph in (True, False):
                note(count=count, **physics(count, device, steps, graph=graph))
            speed = dataclasses.asdict(training_speed(count, steps, 2, 1, device))  # pyright: ignore[reportArgumentType]
            parts = {name: 1.0 / speed[name] for name in ("environment", "learner")}
            shares = {f"share_{name}": round(part * speed["training"], 3) for name, part in parts.items()}
            note(**speed, **shares, share_physics=round(speed["training"] / speed["bare"], 3))
        except (RuntimeError, MemoryError) as error:  # out of memory, or what no test without a GPU could find
            note(count=count, error=f"{type(error).__name__}: {error}"[:2000])
        if device == "cuda":
            torch.cuda.empty_cache()


def physics(count: int, device: str, steps: int, *, graph: bool) -> dict[str, object]:
    """Return the time of a control step of physics alone, with robots that stand and shake."""
    import torch

    from hugwbc.sim.warp_batch import WarpBatch

    start = time.perf_counter()
    batch = WarpBatch(count, device="cpu" if device == "warp" else device)
    batch.graphs = graph and device == "cuda"
    target = batch.ctrl.clone()

    def run(number: int) -> float:
        begin = time.perf_counter()
        for _ in range(number):
            batch.ctrl[:] = target + 0.05 * torch.randn_like(target)
            batch.step(4)
        if not bool(batch.qpos.isfinite().all()):  # waits
            raise RuntimeError(f"{count} robots diverged")
        return (time.perf_counter() - begin) / number

    run(2)
    built = time.perf_counter() - start
    each = run(steps)
    free = torch.cuda.mem_get_info()[0] >> 20 if device == "cuda" else 0
    return {
        "graph": batch.graphs,
        "built_s": round(built, 1),
        "step_ms": round(1e3 * each, 3),
        "physics": round(count / each),
        "free_mib": free,
        "faults": batch.faults(),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    for verb in ("pack", "unpack"):
        chosen = verbs.add_parser(verb)
        chosen.add_argument("folder", type=pathlib.Path)
        chosen.add_argument("site", type=pathlib.Path)
    chosen = verbs.add_parser("measure")
    chosen.add_argument("--out", type=pathlib.Path, default=pathlib.Path("gpu.jsonl"))
    chosen.add_argument("--counts", type=int, nargs="+", default=[4096, 8192, 16384, 32768, 1024])
    chosen.add_argument("--seconds", type=float, default=300.0)
    chosen.add_argument("--device", choices=("cuda", "warp"), default="cuda")
    chosen.add_argument("--steps", type=int, default=50)
    given = vars(parser.parse_args())
    {"pack": pack, "unpack": unpack, "measure": measure}[given.pop("verb")](**given)
