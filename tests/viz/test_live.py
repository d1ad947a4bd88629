"""The live page: what a person does there reaches the robot, and what the robot does is shown."""

import contextlib
import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from playwright import sync_api as playwright

from hugwbc import Command, Gait, load_robot, rotations
from hugwbc.errors import SceneError
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime import ControlLoop, UpperBodySource
from hugwbc.scripts.socket_source import SocketSource
from hugwbc.sim import Simulation
from hugwbc.sim.scenes import Scene, Table, Tray
from hugwbc.viz.drive_link import DriveLink, page_address
from hugwbc.viz.live import CAMERA, HANDS_AT_FIRST, LOOK_AT, LivePage
from hugwbc.viz.shapes import colour_meshes, shapes_of
from hugwbc.viz.show import drive

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 1000, "height": 700}
FIELD_OF_VIEW = np.radians(75.0)  # viser's, vertical


def opened_page(simulation):
    """Return a page that a browser has opened."""
    page = LivePage(simulation, name="test")
    page.link._hear(1, "{}")
    return page


def test_the_page_listens_on_this_machine_only_and_leaves_it_to_the_caller_to_say_where(capsys):
    page = LivePage(Simulation(sensing="exact"), name="test")
    assert page.server.get_host() == "127.0.0.1"
    assert page.address == f"http://127.0.0.1:{page.server.get_port()}"
    page.close()
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("host", "written"), [("127.0.0.1", "127.0.0.1"), ("::1", "[::1]"), ("localhost", "localhost")]
)
def test_the_address_is_one_that_a_browser_takes(host, written):
    assert page_address(host, 8080) == f"http://{written}:8080"


def test_a_slider_shows_what_its_gait_admits_of_what_is_asked():
    simulation = Simulation(sensing="exact")
    page = opened_page(simulation)
    forward, height = page._sliders["v_x"], page._sliders["h"]
    height.value = -0.1
    page._obey(Gait.HOPPING_LEFT.label)
    forward.value = 1.0
    page.show(simulation)
    assert forward.value == page.source.requested.v_x == 0.6, "nobody hops faster"
    assert height.value == page.source.requested.h == -0.1
    assert "is outside -0.6 to 0.6" in page.source.notice
    page._obey(Gait.STANDING.label)
    page.show(simulation)
    assert forward.value == 0.0 and height.value == -0.1
    page.close()


def test_the_camera_follows_turns_along_and_lets_go():
    simulation = Simulation(sensing="exact")
    page = opened_page(simulation)
    offsets = []
    for turn in range(4):  # follows, turns along, stays, follows
        simulation.reset()
        page.show(simulation)
        simulation.data.qpos[:2] += (2.0 + turn, 1.0)
        simulation.data.qpos[3:7] = [np.cos(0.5), 0.0, 0.0, np.sin(0.5)]
        for _ in range(3):
            simulation.data.time += 1.0
            page.show(simulation)
        seen = rotations.to_matrix(np.array(page._world.wxyz)) @ simulation.data.qpos[:3] + page._world.position
        offsets.append((np.linalg.norm(seen[:2]), rotations.yaw_of(np.array(page._world.wxyz))))
        page._obey("camera")
    assert [offset < 0.1 for offset, _ in offsets] == [True, True, False, True]
    assert [round(float(turn), 1) for _, turn in offsets] == [0.0, -1.0, -1.0, -1.0]
    page.close()


@pytest.mark.parametrize(
    "message", ["", "[" * 4000, "[]", "{", b"\xff", "{" * 5000, '{"axes": 1, "held": {}, "presses": 2}']
)
def test_a_malformed_message_only_shows_that_the_page_is_alive(message):
    link = DriveLink({})
    link._hear(1, message)
    assert link.commands() == {} and link.take_actions() == [] and link.silence() < 1.0


def test_pages_with_different_themes_do_not_take_turns():
    link, themes = DriveLink({}), []
    for number, dark in [(1, True), (2, False), (1, True), (2, False), (1, False), (2, False), (1, True)]:
        link._hear(number, json.dumps({"dark": dark}))
        themes.append(link.dark)
    assert themes == [True, False, False, False, False, False, True]


def unheard(page, now):
    """No page has ever spoken."""


def closed(page, now):
    """A page came and went."""
    page.link._hear(1, "{}")
    page.link._pages.clear()
    page.link._last = now[0]


def silent(page, now):
    """A page is open and has not spoken for long."""
    page.link._hear(1, "{}")
    now[0] += 60.0


@pytest.mark.parametrize("absent", [unheard, closed, silent])
def test_nobody_drives_while_no_page_is_there(absent):
    simulation, now = Simulation(sensing="exact"), [100.0]
    page = LivePage(simulation, name="test")
    page.link.clock = lambda: now[0]
    absent(page, now)
    page.show(simulation)
    page._sliders["v_x"].value = 1.0  # viser's part of the page
    page._hands_on.value = True
    page._push(np.array([150.0, 0.0, 0.0]))
    commands = [page.source.command_at(0.02 * tick) for tick in range(100)]
    page.source.ask("v_x", 1.0)  # whatever else asks
    page.show(simulation)
    page.show(simulation)
    commands += [page.source.command_at(2.0 + 0.02 * tick) for tick in range(100)]
    assert {command.gait for command in commands} == {Gait.STANDING}
    assert max(abs(command.v_x) for command in commands) == 0.0
    assert page._sliders["v_x"].value == 0.0 and page.source.hands is None and page.push is None
    # A person opens the page: nothing of that is waiting.
    page.link._hear(2, "{}")
    page.show(simulation)
    assert page.source.command_at(5.0) == Command() and page.source.requested == Command()
    page.close()


@pytest.mark.parametrize("presses", [["KeyP"] * 500, ["KeyC"] * 500, ["KeyX", "KeyZ"] * 250])
def test_a_flood_of_presses_is_one_push_and_a_few_actions(presses):
    simulation, applied = Simulation(sensing="exact"), []
    page = opened_page(simulation)
    simulation.apply_force = lambda force, duration: applied.append(force)
    for _ in range(200):
        page.link._hear(1, json.dumps({"presses": presses}))
    assert len(page.link._pressed) <= 32
    page.show(simulation)
    page.disturb(simulation)
    assert len(applied) <= 1 and page.push is None and not page.link.take_actions()
    page.close()


def test_a_page_that_falls_silent_stops_the_robot_within_half_a_second():
    simulation, now = Simulation(sensing="exact"), [100.0]
    page = LivePage(simulation, name="test")
    page.link.clock = lambda: now[0]
    page.link._hear(1, '{"held": ["KeyW"]}')
    t = 0.0
    for _ in range(150):  # 3 s of a held key
        t, now[0] = t + 0.02, now[0] + 0.02
        page.link._hear(1, '{"held": ["KeyW"]}')
        page.show(simulation)
        command = page.source.command_at(t)
    assert command.v_x == pytest.approx(0.6) and page._sliders["v_x"].value == 0.6
    while command.v_x > 0.0 and now[0] < 105.0:
        t, now[0] = t + 0.02, now[0] + 0.02
        page.show(simulation)
        command = page.source.command_at(t)
    assert now[0] - 103.0 <= 0.5
    # It speaks again: the robot goes on. It is given up: the robot stands, and stays so when it comes back.
    page.link._hear(1, '{"held": ["KeyW"]}')
    page.show(simulation)
    assert page.source.command_at(t + 1.0).v_x == pytest.approx(0.5)
    now[0] += 2.1
    page.show(simulation)
    assert page.source.requested == Command() and page._sliders["v_x"].value == 0.0
    assert "the page is gone" in page.source.notice
    page.link._hear(1, "{}")
    page.show(simulation)
    assert page.source.requested == Command()
    page.close()


@pytest.mark.parametrize(("press", "said"), [("Space", ""), ("hide", "the page was hidden or closed: the robot was ")])
def test_stop_and_a_hidden_page_end_a_walk_that_was_chosen(press, said):
    simulation = Simulation(sensing="exact")
    page = opened_page(simulation)
    page.link.clock = lambda: 100.0  # the page is never silent
    page.link._hear(1, '{"presses": ["Digit2"]}')
    page.show(simulation)
    page._sliders["v_x"].value = 0.5
    assert page.source.requested == Command(v_x=0.5, gait=Gait.WALKING)
    page.link._hear(1, json.dumps({"presses": [press]}))
    page.show(simulation)
    assert page.source.requested == Command() and page._sliders["v_x"].value == 0.0
    assert page.source.command_at(0.02).gait is Gait.STANDING
    assert page.source.notice.startswith(said)
    page.close()


def test_sliders_follow_another_program_and_cannot_be_moved_meanwhile():
    simulation, now = Simulation(sensing="exact"), [10.0]
    with contextlib.closing(SocketSource(clock=lambda: now[0])) as stream:
        page = LivePage(simulation, name="test", stream=stream)
        page.link._hear(1, "{}")
        controls = (*page._sliders.values(), page._hands_on, page._body_on)
        page.show(simulation)
        assert not any(control.disabled for control in controls)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.sendto(b'{"command": {"v_x": 0.4, "w": -0.2}}', ("127.0.0.1", stream.port))
        page.source.command_at(0.02)
        page.show(simulation)
        assert all(control.disabled for control in controls)
        assert (page._sliders["v_x"].value, page._sliders["w"].value) == (0.4, -0.2)
        assert "another program drives" in page.link._status["notes"][0]
        page._sliders["v_x"].value = 1.0  # a page that does not know it yet
        page.source.command_at(0.04)
        page.show(simulation)
        assert page.source.command.v_x == page._sliders["v_x"].value == 0.4
        now[0] += 1.0
        page.source.command_at(0.06)
        page.show(simulation)
        assert not any(control.disabled for control in controls) and page._sliders["v_x"].value == 0.0
        page.close()


def tray_on_a_table():
    return Scene((Table(name="desk", position=(2.0, 0.0)), Tray(name="tray", on="desk")))


@pytest.mark.parametrize(("press", "ended"), [("Space", "stop was pressed"), ("hide", "the page was hidden or closed")])
def test_a_task_of_the_menu_is_done_among_its_objects_and_its_verdict_is_shown(press, ended):
    own, staged = Simulation(sensing="exact"), Simulation(sensing="exact", scene=tray_on_a_table())
    page, told, seen = LivePage(own, name="test", tasks=("carry", "press")), [], []
    page.link.clock = lambda: 100.0  # the page is never silent
    loop = ControlLoop(WholeBodyController(load_robot()), page.source, own, UpperBodySource(load_robot()))

    def perform(name):
        page.stage(staged)
        page.show(staged, name)
        seen.append((name, page.interruption, dict(page.link._status), len(page._objects)))
        page.link._hear(1, json.dumps({"presses": [press]}))
        page.show(staged, name)
        seen.append(page.interruption)
        page.source.ask_gait(Gait.JUMPING)
        return "carry with test: done after 1.0 s"

    page.link._hear(1, '{"presses": ["task:nothing", "task:carry"]}')
    drive(loop, page, 0.2, perform=perform, tell=told.append)
    (name, interruption, status, objects), stopped = seen
    assert name == "carry" and interruption == "" and stopped == ended
    assert status["task"] == "carry" and status["line"].startswith("carry at 0.0 s")
    assert objects == 1 + len(staged.scene.body_names)
    assert "carry with test: done after 1.0 s" in told
    assert page.link._status["notes"] == ["carry with test: done after 1.0 s"] and not page.interruption
    assert page._objects == [] and page._forces == {}, "the person's own robot stands alone again"
    assert page.source.requested == Command(), "what was pressed meanwhile was not for it"
    page.close()


def test_the_page_shows_the_commands_with_which_the_body_helps_the_hands():
    own = Simulation(sensing="exact")
    page = opened_page(own)
    page.link.clock = lambda: 100.0  # the page is never silent
    loop = ControlLoop(WholeBodyController(load_robot()), page.source, own, UpperBodySource(load_robot()))
    for handle in page._handles.values():
        handle.position = (1.0, 0.0, 0.0)
    page._hands_on.value = page._body_on.value = True
    drive(loop, page, 0.4, perform=lambda name: "", tell=lambda words: None)
    status = page.link._status
    assert status["asked"]["p"] == 0.0 and status["commanded"]["p"] > 0.02, "it leans ahead"
    page.close()


def test_a_page_that_is_silent_for_two_seconds_during_a_task_ends_it():
    simulation, now = Simulation(sensing="exact", scene=tray_on_a_table()), [100.0]
    page = LivePage(simulation, name="test", tasks=("carry",))
    page.link.clock = lambda: now[0]
    page.link._hear(1, "{}")
    page.stage(simulation)
    while not page.interruption and now[0] < 105.0:
        now[0] += 0.033
        page.show(simulation, "carry")
    assert 102.0 < now[0] < 102.1
    page.link._hear(1, "{}")
    page.show(simulation, "carry")
    assert page.interruption == "the page was silent for 2 s", "one that is back is told why the task was stopped"
    page.stage(simulation)
    assert not page.interruption
    page.close()


def test_a_task_that_fails_is_said_on_the_page_and_driving_goes_on():
    own = Simulation(sensing="exact")
    page, told = LivePage(own, name="test", tasks=("carry",)), []
    page.link.clock = lambda: 100.0  # the page is never silent
    loop = ControlLoop(WholeBodyController(load_robot()), page.source, own, UpperBodySource(load_robot()))

    def perform(name):
        raise SceneError("the robot stands in the table")

    page.link._hear(1, '{"presses": ["task:carry"]}')
    drive(loop, page, 0.2, perform=perform, tell=told.append)
    words = "carry was not done: the robot stands in the table"
    assert words in told and words in page.link._status["notes"]
    assert 0.0 < own.time < 0.2, "it stood up again after the attempt, and goes on"
    page.close()


class Driven:
    """A robot that runs in real time in a thread, with its page."""

    def __init__(self):
        self.simulation = Simulation(sensing="exact")
        self.page = LivePage(self.simulation, name="qp", tasks=("press_button", "carry_tray"))
        self.loop = ControlLoop(
            WholeBodyController(load_robot()), self.page.source, self.simulation, UpperBodySource(load_robot())
        )
        self.told = []
        self._running = True
        self._disturb, self.page.disturb = self.page.disturb, self._disturb_or_end
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        with contextlib.suppress(KeyboardInterrupt):
            drive(self.loop, self.page, np.inf, perform=lambda name: "", tell=self.told.append)

    def _disturb_or_end(self, simulation):
        if not self._running:
            raise KeyboardInterrupt  # as a person ends it
        self._disturb(simulation)

    def close(self):
        self._running = False
        self._thread.join()
        self.page.close()

    def until(self, condition, seconds=300.0):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if condition():
                return True
            time.sleep(0.02)
        return False


@pytest.fixture
def driven():
    robot = Driven()
    yield robot
    robot.close()


@pytest.fixture
def browser():
    if BROWSER is None:
        pytest.skip("no chromium on this machine; install it (Debian: apt install chromium) to drive the page")
    with playwright.sync_playwright() as api:
        browser = api.chromium.launch(executable_path=BROWSER, args=FLAGS)
        yield browser
        browser.close()


def opened(browser, address):
    page = browser.new_page(viewport=SIZE)
    page.set_default_timeout(300_000)
    page.goto(address)
    page.get_by_role("button", name="walking").wait_for()
    page.get_by_role("slider").first.wait_for()
    return page


@pytest.fixture
def browser_page(driven, browser):
    return opened(browser, driven.page.address)


def on_screen(point):
    """Pixel of a point in the world as the first camera sees it."""
    forward = np.subtract(LOOK_AT, CAMERA)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    x, y, depth = (np.dot(np.subtract(point, CAMERA), axis) for axis in (right, up, forward))
    scale = SIZE["height"] / 2.0 / np.tan(FIELD_OF_VIEW / 2.0)
    return SIZE["width"] / 2.0 + scale * x / depth, SIZE["height"] / 2.0 - scale * y / depth


def drawn(page):
    """Wait for two pictures: one may take a second where the browser draws without a graphics card."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.mark.slow
def test_a_gait_button_and_a_slider_make_the_robot_walk_and_stand_again(driven, browser_page):
    page, simulation = browser_page, driven.simulation
    # A gait button and a slider: the robot walks ahead.
    page.get_by_role("button", name="walking").click()
    assert driven.until(lambda: driven.loop.control.chain.command.gait is Gait.WALKING)
    page.wait_for_function("document.querySelector('[data-action=walking]').ariaPressed == 'true'")
    slider = page.get_by_role("slider").first
    slider.focus()
    for _ in range(40):
        slider.press("ArrowRight")
    assert driven.until(lambda: driven.page.source.requested.v_x > 0.3)
    assert driven.until(lambda: simulation.data.qpos[0] > 0.3), "it walks"
    page.wait_for_function("document.body.innerText.includes('walking at')")
    # Stop, and stand.
    page.get_by_role("button", name="stop").click()
    page.get_by_role("button", name="standing").click()
    assert driven.until(lambda: driven.loop.control.chain.command.gait is Gait.STANDING)
    assert not simulation.fallen
    # In a low window too, the whole list of keys does not push the button to stop out of it.
    page.set_viewport_size({"width": 1000, "height": 480})
    page.evaluate("document.querySelectorAll('#drive details').forEach(part => { part.open = true; })")
    assert page.get_by_role("button", name="stop").bounding_box()["y"] > 0.0


@pytest.mark.slow
def test_keys_drive_the_robot_and_a_page_that_is_closed_stops_it(driven, browser_page):
    page, simulation, source = browser_page, driven.simulation, driven.page.source
    # From standing, W walks and says so.
    page.keyboard.down("w")
    page.wait_for_function("document.body.innerText.includes('starts walking')")
    assert driven.until(lambda: simulation.data.qpos[0] > 0.4), "it walks"
    # A turns as well.
    page.keyboard.down("a")
    assert driven.until(lambda: driven.loop.control.chain.command.omega > 0.5)
    assert driven.until(lambda: simulation.state().yaw > 0.3), "it turns"
    page.keyboard.up("a")
    page.keyboard.up("w")
    assert driven.until(lambda: source.requested == Command()), "nothing is held: it stands"
    assert not simulation.fallen
    # Reset stands it up at the origin.
    page.keyboard.press("r")
    assert driven.until(lambda: np.linalg.norm(simulation.data.qpos[:2]) < 0.05 and simulation.time < 2.0)
    # A page that is closed while a key is held: the command is 0 within half a second, and the robot stays up.
    page.keyboard.down("w")
    assert driven.until(lambda: source.command.v_x > 0.4)
    page.close()
    closed = simulation.time  # the robot's time: on a busy computer it runs slower than the clock on the wall
    assert driven.until(lambda: source.command.v_x == 0.0)
    assert simulation.time - closed < 0.5 + 0.1, "0.1 s for the loop of this test"
    assert driven.until(lambda: source.command.gait is Gait.STANDING)
    assert driven.until(lambda: np.linalg.norm(simulation.data.qvel[:2]) < 0.1)
    assert not simulation.fallen


@pytest.mark.slow
def test_a_real_task_of_the_menu_is_done_by_play_and_a_closed_page_stops_the_next_one(browser):
    words = ["play", "--viewer", "live", "--controller", "qp"]
    command = [sys.executable, "-u", "-m", "hugwbc.cli", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as play:
        lines = iter(play.stdout)
        try:
            page = opened(browser, re.search(r"http://\S+", next(line for line in lines if "drive at" in line))[0])
            page.get_by_label("task").select_option("press_button")
            page.get_by_role("button", name="do it").click()
            page.wait_for_function("document.body.innerText.includes('press button at')")
            done = "document.querySelector('#drive .notes').innerText.includes('press_button with qp: done after')"
            page.wait_for_function(done, timeout=300_000)
            assert "done after" in next(line for line in lines if "press_button" in line)
            page.wait_for_function("document.body.innerText.includes('standing at')")
            page.get_by_role("button", name="do it").click()
            later = "(document.body.innerText.match(/press button at ([1-9][0-9.]+) s/) || [])[1]"
            shown = float(page.wait_for_function(later).json_value())  # a page that draws slowly may skip a second
            page.close()
            stopped = next(line for line in lines if "press_button" in line)
            assert "stopped (the page was hidden or closed) after" in stopped
            assert shown <= float(stopped.split()[-2]) < int(shown) + 2.0
        finally:
            play.send_signal(signal.SIGINT)
            play.wait(60.0)


@pytest.mark.slow
def test_a_dragged_hand_target_takes_the_hand_along(driven, browser_page):
    page, simulation = browser_page, driven.simulation
    page.get_by_role("checkbox").first.check(force=True)
    assert driven.until(lambda: driven.page.source.hands is not None)
    pelvis = simulation.data.qpos[:3].copy()
    target = pelvis + HANDS_AT_FIRST["left"]
    shown = np.array([*driven.page._view[:2], 0.0])  # the point of the ground in the middle of the picture
    assert driven.until(lambda: np.linalg.norm(simulation.hand_position("left") - target) < 0.03)
    before = np.array(driven.page.source.hands.left)
    for offset in (0.1, 0.15, 0.2, 0.05):  # along the upward arrow
        start, end = (on_screen(target - shown + np.array([0, 0, z])) for z in (offset, offset + 0.2))
        page.mouse.move(*start)
        drawn(page)  # the arrow takes hold of a pointer that it has seen above itself
        page.mouse.down()
        for share in np.linspace(0.1, 1.0, 10):
            page.mouse.move(*(start + share * np.subtract(end, start)))
            drawn(page)
        page.mouse.up()
        if driven.until(lambda: driven.page.source.hands.left[2] > before[2] + 0.05, 20.0):
            break
    moved = np.array(driven.page.source.hands.left)
    assert moved[2] > before[2] + 0.05
    assert driven.until(lambda: simulation.hand_position("left")[2] > target[2] + 0.04)
    assert not simulation.fallen


def test_the_page_shows_objects_and_says_the_forces_on_the_hands():
    simulation = Simulation(sensing="exact", scene=tray_on_a_table())
    page = LivePage(simulation, name="test")
    page.show(simulation)
    shown = [frame.position for frame in page._objects[1:]]
    np.testing.assert_allclose(shown, simulation.objects.poses[:, :3])
    assert page.link._status["line"].endswith("hands 0 and 0 N")
    page.close()


def test_every_colour_of_an_object_is_a_mesh():
    model = Scene((Tray(name="tray", colour="#ff0000"),)).model()
    meshes = colour_meshes(shapes_of(model))["tray"]
    assert "#ff0000" in meshes and len(meshes) == 2
    np.testing.assert_allclose(meshes["#ff0000"].extents, [0.35, 0.45, 0.012], atol=1e-6)
