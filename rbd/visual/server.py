"""A live viewer on this machine: a page and a web socket, on 127.0.0.1 and nowhere else."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rbd.errors import PictureError
from rbd.visual.page import live_page
from rbd.visual.recorder import Recorder

# Meshcat's own server listens on every network card; this one cannot be reached from another machine.
HOST = "127.0.0.1"
# A page elsewhere could point its own name at this machine: requests under other names are refused.
ALLOWED_HOSTS = r"^(127\.0\.0\.1|localhost)$"
START_SECONDS = 10.0


class LiveServer:
    """Serves what a recorder keeps to any number of browsers, from a thread of its own.

    Args:
        recorder: Whose messages to pass on.
        title: Shown on the browser's tab.
    """

    def __init__(self, recorder: Recorder, title: str) -> None:
        self._recorder = recorder
        self._title = title
        self._sockets: set[_Socket] = set()
        self._started = threading.Event()
        self._watched = threading.Event()
        self._failure: OSError | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self.port = 0
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), name="rbd-live-scene", daemon=True)
        self._thread.start()
        self._started.wait(START_SECONDS)
        if self.port == 0:
            raise PictureError(f"the live scene could not listen on {HOST}: {self._failure or 'it did not start'}.")

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.port}/"

    def wait_for_viewer(self, seconds: float) -> bool:
        """Wait until a first browser has the page; whether one has."""
        return self._watched.wait(seconds)

    def close(self) -> None:
        """Stop serving, and wait until the thread has ended."""
        self._recorder.listen(None)
        if self._loop is not None and self._stop is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        # A port in use or an address refused must reach the caller, not die in this thread.
        try:
            listening = bind_sockets(0, HOST)
        except OSError as error:
            self._failure = error
            self._started.set()
            return
        port = int(listening[0].getsockname()[1])
        application = Application(log_function=lambda handler: None)
        application.add_handlers(
            ALLOWED_HOSTS,
            [
                (r"/", _PageHandler, {"server": self}),
                (r"/favicon.ico", _NoIcon),
                (r"/changes", _Socket, {"server": self}),
            ],
        )
        server = HTTPServer(application)
        server.add_sockets(listening)
        self._recorder.listen(self._pass_on)
        self.port = port
        self._started.set()
        await self._stop.wait()
        server.stop()
        for socket in list(self._sockets):
            socket.close()
        await server.close_all_connections()

    def _pass_on(self, message: bytes | str) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._broadcast, message)

    def _broadcast(self, message: bytes | str) -> None:
        for socket in list(self._sockets):
            socket.pass_on(message)

    def page(self) -> str:
        """The present scene, as a page that asks for what comes after it."""
        messages, count = self._recorder.messages()
        return live_page(self._title, messages, f"ws://{HOST}:{self.port}/changes?after={count}")

    def welcome(self, socket: _Socket, after: int) -> None:
        """Tell a new browser what came after its page was made, and then all that follows."""
        for message in self._recorder.messages(after=after)[0]:
            socket.pass_on(message)
        self._sockets.add(socket)
        self._watched.set()

    def farewell(self, socket: _Socket) -> None:
        """Forget a browser that left."""
        self._sockets.discard(socket)


class _PageHandler(RequestHandler):
    def initialize(self, server: LiveServer) -> None:
        self._server = server

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.write(self._server.page())


class _NoIcon(RequestHandler):
    def get(self) -> None:
        self.set_status(204)


class _Socket(WebSocketHandler):
    def initialize(self, server: LiveServer) -> None:
        self._server = server

    def open(self, *args: str, **kwargs: str) -> None:
        after = self.get_query_argument("after", "0")
        self._server.welcome(self, int(after) if after.isdecimal() else 0)

    def on_message(self, message: Any) -> None:
        """Browsers only listen."""

    def on_close(self) -> None:
        self._server.farewell(self)

    def pass_on(self, message: bytes | str) -> None:
        """Send to this browser; one that has just gone is no error."""
        try:
            self.write_message(message, binary=isinstance(message, bytes))
        except WebSocketClosedError:
            self._server.farewell(self)
