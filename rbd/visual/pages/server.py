"""A live viewer on this machine, on 127.0.0.1 only: the messages of a scene, passed on through a web socket.

It is imported when a live scene is asked for: written pages need no Tornado.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import socket
import threading
from collections.abc import Awaitable
from contextlib import suppress
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from rbd.errors import PictureError
from rbd.model.data_pool import renewed_after_fork
from rbd.visual.pages.page import live_page
from rbd.visual.pages.recorder import Recorder

# Meshcat's server listens on every network card; this one cannot be reached from another machine.
HOST = "127.0.0.1"
# A page elsewhere could resolve its name to this machine: requests under other names are refused.
ALLOWED_HOSTS = r"^(127\.0\.0\.1|localhost)$"
_WITH_PORT = re.compile(r"(127\.0\.0\.1|localhost)(:[0-9]{1,5})?", re.ASCII)
_COUNT = re.compile(r"[0-9]{1,15}", re.ASCII)
LARGEST_REQUEST = 10_000
"""Largest message of a browser [bytes]: it asks for the page, and then sends what its sliders are set to."""
MOST_A_SECOND = 1000
"""Messages of one browser in a second; one that sends more is disconnected. A slider that is dragged sends 60."""
MOST_UNREAD = 400_000_000
"""Largest backlog of one browser [bytes]; one that stops reading is disconnected. Talos is 2 MB."""
START_SECONDS = 10.0


class LiveServer:
    """Serves a recorder's messages to any number of browsers, from a separate thread, and passes on what they send.

    Only pages that this server gave out get its socket: their origin must be the address under which they were asked for.

    Args:
        recorder: Whose messages to pass on.
        title: Shown on the browser's tab.
    """

    def __init__(self, recorder: Recorder, title: str) -> None:
        self.recorder = recorder
        self._title = title
        self._sockets: set[_Socket] = set()
        self._started = threading.Event()
        self._watched = threading.Event()
        self._failure: OSError | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self._listening: list[socket.socket] = []
        self.port = 0
        renewed_after_fork(self)
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
        self.recorder.listen(None)
        if self._loop is not None and self._stop is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()

    def renew_after_fork(self) -> None:
        """In a forked child: the thread stays with the parent, and so do its port and its browsers."""
        self._loop = self._stop = None
        for listening in self._listening:
            with suppress(OSError):
                os.close(listening.detach())
        self._listening, self._watched = [], threading.Event()

    async def _serve(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        # A port in use or an address refused must reach the caller, not die in this thread.
        try:
            listening = self._listening = bind_sockets(0, HOST)
        except OSError as error:
            self._failure = error
            self._started.set()
            return
        port = int(listening[0].getsockname()[1])
        application = Application(log_function=lambda handler: None, websocket_max_message_size=LARGEST_REQUEST)
        application.add_handlers(
            ALLOWED_HOSTS,
            [
                (r"/", _PageHandler, {"server": self}),
                (r"/favicon.ico", _NoIcon),
                (r"/changes", _Socket, {"server": self}),
            ],
        )
        server = HTTPServer(application, max_header_size=LARGEST_REQUEST, max_body_size=LARGEST_REQUEST)
        server.add_sockets(listening)
        self.recorder.listen(self._pass_on, self._bracket)
        self.port = port
        self._started.set()
        await self._stop.wait()
        self._listening = []
        server.stop()
        browsers = list(self._sockets)
        for browser in browsers:
            browser.close()
        await server.close_all_connections()
        for browser in browsers:
            browser.disconnect()  # the loop ends before one that does not answer would be

    def _pass_on(self, message: bytes | str) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._broadcast, message)

    def _bracket(self, begins: bool) -> None:
        """Pages draw the messages of one change together, not one by one."""
        self._pass_on(json.dumps({"hold": begins}))

    def _broadcast(self, message: bytes | str) -> None:
        for browser in list(self._sockets):
            browser.pass_on(message)

    def page(self, host: str) -> str:
        """The present scene, as a page that requests the later messages.

        Args:
            host: Name and port under which the browser knows this server: it may connect to no other.
        """
        messages, count = self.recorder.messages()
        return live_page(self._title, messages, f"ws://{host}/changes?after={count}")

    def welcome(self, browser: _Socket, after: int) -> None:
        """Send a new browser the messages since its page was made, and then all later ones."""
        self._sockets.add(browser)
        for message in self.recorder.messages(after=after)[0]:
            browser.pass_on(message)
        self._watched.set()

    def farewell(self, browser: _Socket) -> None:
        """Remove a browser that has disconnected."""
        self._sockets.discard(browser)


class _PageHandler(RequestHandler):
    def initialize(self, server: LiveServer) -> None:
        self._server = server

    def get(self) -> None:
        host = self.request.host.lower()
        if not _WITH_PORT.fullmatch(host):  # the name was compared, but not text after it
            raise HTTPError(400)
        self.set_header("Cache-Control", "no-store")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("X-Frame-Options", "DENY")  # no page elsewhere shows this one inside itself
        self.set_header("Cross-Origin-Resource-Policy", "same-origin")
        self.write(self._server.page(host))


class _NoIcon(RequestHandler):
    def get(self) -> None:
        self.set_status(204)


class _Socket(WebSocketHandler):
    def initialize(self, server: LiveServer) -> None:
        self._server = server
        self._after = self._unread = self._sent_lately = 0
        self._second = 0.0

    def check_origin(self, origin: str) -> bool:
        """Whether a page that this server gave out asks, under the name that it was asked for."""
        host = self.request.host.lower()
        return _WITH_PORT.fullmatch(host) is not None and self.request.headers.get_list("Origin") == [f"http://{host}"]

    def prepare(self) -> None:
        """Refuse pages elsewhere, who does not say whose page asks, and an invalid count, before there is a socket."""
        if not self.check_origin(self.request.headers.get("Origin", "")):  # Tornado asks for some requests only
            raise HTTPError(403)
        after = self.get_query_argument("after", "0")
        if not _COUNT.fullmatch(after):
            raise HTTPError(400)
        self._after = int(after)

    def open(self, *args: str, **kwargs: str) -> None:
        self._stream = None if self.ws_connection is None else self.ws_connection.stream
        self._server.welcome(self, self._after)

    def disconnect(self) -> None:
        """Close the connection at once, without waiting for the browser's answer to `close`."""
        if self._stream is not None:
            self._stream.close()

    def on_message(self, message: Any) -> None:
        """Pass on what the page's sliders are set to; what is not text is ignored."""
        now = asyncio.get_running_loop().time()
        if now - self._second >= 1.0:
            self._second, self._sent_lately = now, 0
        self._sent_lately += 1
        if self._sent_lately > MOST_A_SECOND:
            self._server.farewell(self)
            self.close(1008, "too many messages")
        elif isinstance(message, str):
            self._server.recorder.receive(message)

    def on_close(self) -> None:
        self._server.farewell(self)

    def pass_on(self, message: bytes | str) -> None:
        """Send to this browser; one that has just closed is no error, and one that does not read is disconnected."""
        size = len(message)
        if self._unread + size > MOST_UNREAD:
            self._server.farewell(self)
            self.close(1013, "too slow")
            return
        try:
            sending = self.write_message(message, binary=isinstance(message, bytes))
        except WebSocketClosedError:
            self._server.farewell(self)
            return
        self._unread += size
        asyncio.ensure_future(self._sent(sending, size))

    async def _sent(self, sending: Awaitable[None], size: int) -> None:
        with suppress(WebSocketClosedError):
            await sending
        self._unread -= size
