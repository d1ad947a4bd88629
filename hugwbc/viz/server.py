"""A meshcat server that only this machine can reach, and the visualizer that talks to it.

meshcat's own server listens on every network interface. This one listens on 127.0.0.1 and answers only requests whose
`Host` header names this machine, so that a page of another site cannot reach it by DNS rebinding.
"""

import asyncio
import contextlib
import io
import queue
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
START_TIME = 20.0  # [s] that the server may take to listen
_HOST_PATTERN = r"(127\.0\.0\.1|localhost)"


class _LoopbackApplication(tornado.web.Application):
    def listen(self, port: int, address: str | None = None, **options: Any) -> HTTPServer:  # noqa: ANN401  tornado's
        return super().listen(port, address=HOST, **options)


class _QuietHandler(WebSocketHandler):
    """Says nothing of pages that come and go: what is printed is for the caller to decide."""

    def open(self, *args: str, **named: str) -> None:
        self.bridge.websocket_pool.add(self)
        self.bridge.send_scene(self)

    def on_close(self) -> None:
        self.bridge.websocket_pool.discard(self)


class _NoIcon(tornado.web.RequestHandler):
    """Answers browsers, which ask for an icon; tornado would print that there is none."""

    def get(self) -> None:
        self.set_status(204)


class _LoopbackBridge(Bridge):
    def make_app(self) -> tornado.web.Application:
        application = _LoopbackApplication()
        pages = {"path": VIEWER_ROOT, "default_filename": VIEWER_HTML}
        application.add_handlers(
            _HOST_PATTERN,
            [
                (r"/static/(.*)", StaticFileHandlerNoCache, pages),
                (r"/favicon.ico", _NoIcon),
                (r"/", _QuietHandler, {"bridge": self}),
            ],
        )
        return application


def open_visualizer() -> tuple[meshcat.Visualizer, str]:
    """Start a server in a thread of this process; return its visualizer, and the address to open in a browser."""
    started: queue.Queue[str] = queue.Queue()

    async def serve() -> None:
        started.put(_LoopbackBridge(host=HOST).zmq_url)
        await asyncio.Event().wait()

    threading.Thread(target=lambda: asyncio.run(serve()), name="meshcat", daemon=True).start()
    try:
        zmq_url = started.get(timeout=START_TIME)
    except queue.Empty as error:
        raise HugwbcError("the viewer's server did not start; its error is above. Run with `--viewer none`") from error
    with contextlib.redirect_stdout(io.StringIO()):
        visualizer = meshcat.Visualizer(zmq_url=zmq_url)
    return visualizer, visualizer.url()
