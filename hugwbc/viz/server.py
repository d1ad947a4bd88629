"""A meshcat server that only this machine can reach, and the visualizer that talks to it.

meshcat's own server listens on every network interface. This one listens on 127.0.0.1 and answers only requests whose
`Host` header names this machine, so that a page of another site cannot reach it by DNS rebinding.
"""

import atexit
import contextlib
import io
import os
import subprocess
import sys
import threading
from typing import Any

import meshcat
import tornado.web
from meshcat.servers.zmqserver import (
    VIEWER_HTML,
    VIEWER_ROOT,
    StaticFileHandlerNoCache,
    WebSocketHandler,
    ZMQWebSocketBridge as Bridge,
)
from tornado.httpserver import HTTPServer

from hugwbc.errors import HugwbcError

HOST = "127.0.0.1"
_HOST_PATTERN = r"(127\.0\.0\.1|localhost)"
_READY = "zmq_url="


class _LoopbackApplication(tornado.web.Application):
    def listen(self, port: int, address: str | None = None, **options: Any) -> HTTPServer:  # noqa: ANN401  tornado's
        return super().listen(port, address=HOST, **options)


class _LoopbackBridge(Bridge):
    def make_app(self) -> tornado.web.Application:
        application = _LoopbackApplication()
        pages = {"path": VIEWER_ROOT, "default_filename": VIEWER_HTML}
        application.add_handlers(
            _HOST_PATTERN,
            [(r"/static/(.*)", StaticFileHandlerNoCache, pages), (r"/", WebSocketHandler, {"bridge": self})],
        )
        return application


def serve() -> None:
    """Run a server until the process or its standard input ends; the first line of standard output is its address."""
    threading.Thread(target=_end_with_input, daemon=True).start()
    bridge = _LoopbackBridge(host=HOST)
    sys.stdout.write(f"{_READY}{bridge.zmq_url}\n")
    sys.stdout.flush()
    bridge.run()


def _end_with_input() -> None:
    """End the process when its standard input closes: whoever started the server may have been killed."""
    sys.stdin.buffer.read()
    os._exit(0)


def open_visualizer() -> tuple[meshcat.Visualizer, str]:
    """Start a server in a child process, which ends with this process.

    Returns:
        The visualizer, and the address to open in a browser.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "hugwbc.viz.server"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    atexit.register(_stop, process)
    assert process.stdout is not None
    line = process.stdout.readline().strip()
    if not line.startswith(_READY):
        _stop(process)
        raise HugwbcError(
            "the viewer's server did not start; run `python -m hugwbc.viz.server` to see why, or run without a viewer"
        )
    # meshcat prints the address; what is printed is for the caller to decide.
    with contextlib.redirect_stdout(io.StringIO()):
        visualizer = meshcat.Visualizer(zmq_url=line.removeprefix(_READY))
    return visualizer, visualizer.url()


def _stop(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        serve()
