"""The messages of a scene, kept for pages and passed on to live viewers."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Protocol

import umsgpack

from rbd.model.forks import renewed_after_fork


class Command(Protocol):
    """A Meshcat command, or one of ours."""

    def lower(self) -> dict[str, Any]:
        """The command as plain data; ours has its bytes as "packed"."""


class Recorder:
    """The `window` of a `meshcat.Visualizer` that needs no server.

    It stores the messages that a viewer needs to show the present scene, oldest first, and passes every new message to
    one listener, such as a live server. Messages are bytes (packed Meshcat commands) or text (JSON for our own page).
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: dict[tuple[str, str], tuple[int, bytes | str]] = {}
        self._count = 0
        self._listener: Callable[[bytes | str], None] | None = None
        renewed_after_fork(self)

    def renew_after_fork(self) -> None:
        """In a forked child: a new lock, and no listener, because a live server's thread stays with the parent."""
        self._lock, self._listener = threading.Lock(), None

    def send(self, command: Command) -> None:
        """Store a Meshcat command, or one of ours that is packed already; a newer one of its kind on its path replaces it.

        A deletion removes all commands at and below its path, and is stored for viewers that have received them.
        """
        data = command.lower()
        path, kind = data["path"], data["type"]
        packed = data["packed"] if "packed" in data else umsgpack.packb(data)
        with self._lock:
            if kind == "delete":
                below = path.rstrip("/") + "/"
                self._kept = {key: m for key, m in self._kept.items() if not (key[0] + "/").startswith(below)}
            self._keep((path, kind + "/" + data.get("property", "")), packed)

    def post(self, topic: str, text: str) -> None:
        """Store a message for our page; a newer one on the same topic replaces it."""
        with self._lock:
            self._keep(("", topic), text)

    def messages(self, *, after: int = 0) -> tuple[list[bytes | str], int]:
        """Messages for a viewer that has received the first `after` of them, oldest first, and their count so far."""
        with self._lock:
            return [message for number, message in self._kept.values() if number > after], self._count

    def listen(self, listener: Callable[[bytes | str], None] | None) -> None:
        """Pass every later message to `listener`; None: to none."""
        with self._lock:
            self._listener = listener

    def _keep(self, key: tuple[str, str], message: bytes | str) -> None:
        self._count += 1
        self._kept.pop(key, None)
        self._kept[key] = (self._count, message)
        if self._listener is not None:
            self._listener(message)
