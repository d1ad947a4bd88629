"""What held keys, sticks and pressed buttons ask for."""

import pytest

from hugwbc import Command, Gait
from hugwbc.viz.drive_keys import FAST_SPEED, FULL_TILT, HELD, KEY_CODES, PRESSED, SPEED, Touched, actions

REST = {"v_x": 0.0, "v_y": 0.0, "omega": 0.0}


@pytest.mark.parametrize(
    ("held", "asked"),
    [
        ([], {}),
        (["KeyW"], {"v_x": 0.6}),
        (["KeyW", "ShiftLeft"], {"v_x": FAST_SPEED["v_x"]}),
        (["KeyS"], {"v_x": -0.4}),
        (["KeyS", "ShiftRight"], {"v_x": -0.4}),
        (["KeyW", "KeyS"], {"v_x": 0.0}),
        (["KeyA", "KeyW"], {"v_x": 0.6, "omega": SPEED["omega"]}),
        (["KeyE"], {"v_y": -SPEED["v_y"]}),
        (["ShiftLeft"], {}),
        (["KeyJ", 3, None], {}),
        ("KeyW", {}),
    ],
)
def test_held_keys_are_velocities(held, asked):
    assert Touched.parse({"held": held}).commands() == ({**REST, **asked} if asked else {})


def test_sticks_are_velocities_beyond_their_dead_zone():
    assert Touched.parse({"axes": [0.1, -0.1, 0.05, 1.0]}).commands() == {}
    full = Touched.parse({"axes": [1.0, -1.0, -1.0, 0.0]}).commands()
    assert full == {"v_x": FULL_TILT["v_x"], "v_y": -FULL_TILT["v_y"], "omega": FULL_TILT["omega"]}
    half = Touched.parse({"axes": [0.0, -0.575, 0.0, 0.0]}).commands()
    assert half == {**REST, "v_x": pytest.approx(0.6)}
    assert Touched.parse({"squat": 1.0}).commands() == {"h": -0.3}
    assert Touched.parse({"axes": [0, -9, 0, 0], "squat": "deep"}).commands() == {**REST, "v_x": FULL_TILT["v_x"]}
    assert Touched.parse({"axes": [float("nan"), True, "a", {}]}).commands() == {}
    assert Touched.parse({"axes": [0, -(10**400), 0, 0]}).commands() == {**REST, "v_x": FULL_TILT["v_x"]}


def test_all_that_is_asked_for_is_a_command_of_the_walk():
    for code in HELD:
        Command.from_mapping(Touched(frozenset([code, "ShiftLeft"])).commands(), Gait.WALKING).validate()
    Command.from_mapping(FULL_TILT, Gait.WALKING).validate()


def test_presses_are_actions_and_what_is_unknown_is_left_out():
    assert actions(["Digit1", "Space", "Pad0", "walking", "KeyW", 7, "quit"]) == [
        "standing", "stop", "walking", "walking",
    ]  # fmt: skip
    assert actions("stop") == actions(None) == []
    assert {PRESSED[f"Digit{n}"] for n in range(1, 6)} == {gait.label for gait in Gait}
    assert set(KEY_CODES).isdisjoint({"Pad0"}) and "KeyW" in KEY_CODES and "Space" in KEY_CODES
