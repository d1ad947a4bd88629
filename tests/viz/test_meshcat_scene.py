"""The live scene and its server."""

import pathlib
import sys
import urllib.error
import urllib.parse
import urllib.request

import meshcat
import numpy as np
import pytest

from hugwbc import load_robot
from hugwbc.viz.framing import snapshot
from hugwbc.viz.meshcat_scene import Scene
from hugwbc.viz.server import open_visualizer


def _listening_addresses(port: int) -> set[str]:
    """Local addresses that listen on a port, from the kernel's tables, in its hexadecimal notation."""
    rows = [
        line.split() for name in ("tcp", "tcp6") for line in pathlib.Path(f"/proc/net/{name}").read_text().splitlines()
    ]
    listening = "0A"
    return {row[1].split(":")[0] for row in rows if row[3] == listening and row[1].endswith(f":{port:04X}")}


@pytest.fixture(scope="module")
def live() -> tuple[meshcat.Visualizer, str]:
    return open_visualizer()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads the kernel's table of sockets")
def test_viewer_listens_on_loopback_only(live: tuple[meshcat.Visualizer, str]) -> None:
    visualizer, url = live
    loopback = "0100007F"
    for address in (url, visualizer.window.zmq_url):
        port = urllib.parse.urlparse(address).port
        assert _listening_addresses(port) == {loopback}


def test_viewer_answers_its_own_host_only(live: tuple[meshcat.Visualizer, str]) -> None:
    _, url = live
    with urllib.request.urlopen(url, timeout=5) as answer:
        assert answer.status == 200
        assert b"MeshCat" in answer.read()
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(urllib.request.Request(url, headers={"Host": "other.example"}), timeout=5)
    assert urllib.parse.urlparse(url).hostname == "127.0.0.1"


def test_live_scene_takes_poses(make_run, live, capsys):
    visualizer, _ = live
    scene = Scene(visualizer, ["qp", "learned"], load_robot())
    run = make_run()
    for view in scene.robots:
        view.show(snapshot(run, 0))
        view.show(snapshot(run, -1))
    scene.look_at(np.array([1.0, 2.0]))
    page = visualizer.static_html()
    # 20 links and their marks, and the floor.
    assert page.count("handle_command_bytearray") > 2 * 22
    assert capsys.readouterr().out == ""
