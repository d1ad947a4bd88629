"""docs/architecture.md: functions of the walks exist, no room is entered twice, and ranges are those of the code."""

import importlib
import pathlib
import re
import sys
from collections import Counter

import pytest

import hugwbc
from hugwbc import Command, Gait, load_robot
from hugwbc.commands import command_ranges
from hugwbc.runtime import Constant, ControlLoop, Simulation, UpperBodySource, load_controller
from hugwbc.targets import HandTargets

ROOT = pathlib.Path(hugwbc.__file__).parent
PAGE = (ROOT.parent / "docs" / "architecture.md").read_text()
ROOMS = {path.name for path in ROOT.iterdir() if (path / "__init__.py").exists()}
WALKS = {title: text for title, text in re.findall(r"^## (A walk .*?)\n(.*?)(?=^## )", PAGE, re.M | re.S)}
ROW = re.compile(r"^\| `(\w+)` \| (.*?) \|", re.M)


def _room(name: str) -> str:
    first = name.split(".")[0]
    return first if first in ROOMS else "core"


def _exists(name: str) -> bool:
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(("hugwbc", *parts[:count])))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            found = getattr(found, part, None)
        return callable(found)
    return False


@pytest.mark.parametrize("title", WALKS)
def test_the_functions_of_a_walk_exist_and_no_room_appears_twice(title: str) -> None:
    rows = ROW.findall(WALKS[title])
    names = [(room, name) for room, cell in rows for name in re.findall(r"`([\w.]+)`", cell)]
    assert len(names) > 10 and len(WALKS) == 3
    assert [name for _, name in names if not _exists(name)] == []
    assert {room for room, name in names if _room(name) not in (room, "core")} == set()
    rooms = [room for room, _ in rows]
    assert rooms[-2:] == ["mbc", "learned"], "one of the two controllers"
    assert len(set(rooms)) == len(rooms)


def test_the_table_of_commands_has_the_ranges_of_both_robots() -> None:
    (table,) = re.findall(r"^### Commands\n(.*?)(?=^## )", PAGE, re.M | re.S)
    rows = re.findall(r"^\| (\w+) \[.*?\] \| (.*?) \|(.*?)\|$", table, re.M)
    told = {
        "h1": {name: cell for name, cell, _ in rows},
        "g1": {name: other.strip() or cell for name, cell, other in rows},
    }
    for robot, cells in told.items():
        ranges = command_ranges(Gait.WALKING, load_robot(robot))
        assert list(cells) == list(ranges)
        for name, limits in ranges.items():
            numbers = [float(number) for number in re.findall(r"-?[\d.]+", cells[name])]
            assert numbers == [round(value, 2) for value in (*limits.finishing, limits.default)], (robot, name)


def test_the_table_of_rooms_names_every_package() -> None:
    (table,) = re.findall(r"^## Rooms and layers\n(.*?)(?=^## )", PAGE, re.M | re.S)
    rows = dict(re.findall(r"^\| (?:the )?`?(\w+)`?[^|]* \| (.*?) \|", table, re.M))
    rows.pop("room")
    rooms = list(rows)
    assert rooms[0] == "core" and set(rooms[1:]) == ROOMS
    inner = [path.parent.relative_to(ROOT) for path in ROOT.glob("*/*/__init__.py")]
    assert len(inner) > 5
    assert [str(path) for path in inner if f"`{path.name}`" not in rows[path.parts[0]]] == []
    # The reference of the site lists them in the same order.
    (layers,) = re.findall(r"^LAYERS = \((.*?)\)", (ROOT.parent / "docs" / "site_pages.py").read_text(), re.M | re.S)
    assert re.findall(r'"(\w+)"', layers) == rooms


@pytest.mark.parametrize(("controller", "room"), [("qp", "mbc"), ("learned", "learned")])
def test_a_control_period_enters_each_room_once(controller: str, room: str) -> None:
    """With hands that ask for the whole body: command source, arms, filter, and the controller inside the filter."""
    robot = load_controller(controller)
    low = HandTargets.of((0.45, 0.2, 0.6), (0.45, -0.2, 0.6), "world", whole_body=True)
    loop = ControlLoop(
        robot,
        Constant(Command(v_x=0.3, gait=Gait.WALKING), low),
        Simulation(sensing="exact"),
        UpperBodySource(load_robot()),
    )
    loop.reset()
    for tick in range(5):
        loop.step(loop.decide(tick * loop.period), loop.period)
    entered: list[str] = []
    stack: list[str] = []

    def watch(frame, event, _) -> None:
        if event == "call":
            path = pathlib.Path(frame.f_code.co_filename)
            parts = path.relative_to(ROOT).parts if path.is_relative_to(ROOT) else ()
            here = _room(parts[0]) if len(parts) > 1 else stack[-1] if stack else ""
            if stack and here != stack[-1]:
                entered.append(f"{here}.{frame.f_code.co_name}")
            stack.append(here)
        elif event == "return" and stack:
            stack.pop()

    sys.setprofile(watch)
    try:
        loop.decide(5 * loop.period)
    finally:
        sys.setprofile(None)
    rooms = Counter(name.split(".")[0] for name in entered)
    assert rooms["upper_ik"] == 1 and rooms[room] == 1, entered
    # The command and the hand targets are asked for separately.
    assert [name for name in entered if name.startswith("scripts.")] == ["scripts.command_at", "scripts.hands_at"]
    assert rooms["runtime"] == 0, "nothing below calls back"
