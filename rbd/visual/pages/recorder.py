"""The messages of a scene, in Meshcat's protocol and our own: kept for pages that are written or opened later, and passed on.

The package `meshcat` is not imported: it would load IPython, zmq and Pillow, which take a second and which no page needs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import umsgpack

from rbd.arrays import Array
from rbd.model.data_pool import renewed_after_fork

_Given = ParamSpec("_Given")
_Got = TypeVar("_Got")
_Key = tuple[str, str]
"""Path and kind of a Meshcat command; "" and the topic of a message for our own page."""
_DELETE = "delete/"
_MOTION: _Key = ("", "motion")


class Command(Protocol):
    """A Meshcat command, or one of ours."""

    def lower(self) -> dict[str, Any]:
        """The command as plain data; ours has its bytes as "packed"."""


def _nobody(told: object) -> None:
    """Who listens where nobody does."""


class Recorder:
    """What a viewer needs to show the present scene, without a server.

    It stores the messages, oldest first, and passes every new message to
    one listener, such as a live server. Messages are bytes (packed Meshcat commands) or text (JSON for our own page). What
    live pages send comes back through `receive`.
    """

    def __init__(self) -> None:
        self._lock, self._turn = threading.Lock(), threading.RLock()
        self._kept: dict[_Key, tuple[int, bytes | str]] = {}
        self._count = 0
        self._listener: Callable[[bytes | str], None] = _nobody
        self._bracket: Callable[[bool], None] = _nobody
        self._draft: list[tuple[_Key, bytes | str]] | None = None
        self._receiver: Callable[[str], None] = _nobody
        renewed_after_fork(self)

    def renew_after_fork(self) -> None:
        """In a forked child: new locks, and no listener, because a live server's thread stays with the parent."""
        self._lock, self._turn, self._listener, self._bracket = threading.Lock(), threading.RLock(), _nobody, _nobody

    def send(self, command: Command) -> None:
        """Store a Meshcat command, or one of ours that is packed already; a newer one of its kind on its path replaces it.

        A deletion removes all commands at and below its path, and is stored for viewers that have received them.
        """
        data = command.lower()
        packed = data["packed"] if "packed" in data else umsgpack.packb(data)
        self._put((data["path"], data["type"] + "/" + data.get("property", "")), packed)

    def post(self, topic: str, text: str) -> None:
        """Store a message for our page; a newer one on the same topic replaces it."""
        self._put(("", topic), text)

    @contextmanager
    def together(self) -> Iterator[None]:
        """Compare what is sent inside with what viewers have, and pass on only the difference, at the end.

        What is deleted and sent again unchanged is not passed on, and does not flicker. Other threads wait.
        """
        with self._turn:
            if self._draft is not None:  # inside another one
                yield
                return
            self._draft = []
            try:
                yield
            finally:
                draft, self._draft = self._draft, None
                with self._lock:
                    self._bracket(True)
                    self._keep_difference(draft)
                    self._bracket(False)

    def messages(self, *, after: int = 0) -> tuple[list[bytes | str], int]:
        """Messages for a viewer that has received the first `after` of them, oldest first, and their count so far."""
        with self._lock:
            return [message for number, message in self._kept.values() if number > after], self._count

    def listen(self, listener: Callable[[bytes | str], None] | None, bracket: Callable[[bool], None] | None = None) -> None:
        """Pass every later message to `listener`; None: to none. `bracket` hears True before those of a change, then False."""
        with self._lock:
            self._listener, self._bracket = listener or _nobody, bracket or _nobody

    def answer_by(self, receiver: Callable[[str], None] | None) -> None:
        """Pass what live pages send to `receiver`, in the server's thread; None: to none."""
        self._receiver = receiver or _nobody

    def receive(self, message: str) -> None:
        """A message of a live page, of any content."""
        self._receiver(message)

    def _put(self, key: _Key, message: bytes | str) -> None:
        with self._turn:
            if self._draft is not None:
                self._draft.append((key, message))
                return
            with self._lock:
                if key[1] == _DELETE:
                    self._kept = {k: m for k, m in self._kept.items() if not _is_below(k[0], key[0])}
                self._keep(key, message)

    def _keep(self, key: _Key, message: bytes | str) -> None:
        self._count += 1
        self._kept.pop(key, None)
        self._kept[key] = (self._count, message)
        self._listener(message)

    def _keep_difference(self, draft: list[tuple[_Key, bytes | str]]) -> None:
        wanted: dict[_Key, bytes | str] = {key: m for key, (_, m) in self._kept.items() if key[1] != _DELETE}
        for key, message in draft:
            if key[1] == _DELETE:
                wanted = {k: m for k, m in wanted.items() if not _is_below(k[0], key[0])}
            else:
                wanted.pop(key, None)  # what is sent again goes last: a list of marks comes after the marks
                wanted[key] = message
        gone = {path for path, kind in self._kept if kind != _DELETE and (path, kind) not in wanted}
        for top in _tops(gone, {path for path, _ in wanted}):
            for key in [k for k in self._kept if _is_below(k[0], top)]:
                del self._kept[key]
            self._keep((top, _DELETE), umsgpack.packb({"type": "delete", "path": top}))
        # A motion that has run in the page has moved the robot and written the legend there: all is sent again.
        sent = {key for key, _ in draft}
        anew = _MOTION in sent and self._kept.get(_MOTION, (0, wanted[_MOTION]))[1] != wanted[_MOTION]
        for key, message in wanted.items():
            if self._kept.get(key, (0, None))[1] != message or (anew and key in sent):
                self._keep(key, message)


class ViewerNode:
    """A place in the tree of the viewer: `node["robot/3"]` is one below it.

    Args:
        recorder: Gets the messages.
        path: From the root of the tree.
    """

    __slots__ = ("path", "recorder")

    def __init__(self, recorder: Recorder, path: str = "/meshcat") -> None:
        self.recorder, self.path = recorder, path

    def __getitem__(self, below: str) -> ViewerNode:
        return ViewerNode(self.recorder, f"{self.path}/{below}")

    def set_transform(self, X: Array) -> None:
        """Move what is here: the homogeneous matrix in the node above, shape (4, 4)."""
        self.recorder.send(_Told({"type": "set_transform", "path": self.path, "matrix": X.ravel("F").tolist()}))

    def delete(self) -> None:
        """Remove what is here, and all below it."""
        self.recorder.send(_Told({"type": "delete", "path": self.path}))


class _Told:
    """A command of Meshcat's protocol as plain data."""

    __slots__ = ("data",)

    def __init__(self, data: dict[str, Any]) -> None:
        self.data = data

    def lower(self) -> dict[str, Any]:
        return self.data


def drawn_together(method: Callable[Concatenate[Any, _Given], _Got]) -> Callable[Concatenate[Any, _Given], _Got]:
    """A method of an object with a `recorder`, all of whose messages are one change: see `Recorder.together`."""

    @wraps(method)
    def drawn(self: Any, *arguments: _Given.args, **settings: _Given.kwargs) -> _Got:
        with self.recorder.together():
            return method(self, *arguments, **settings)

    return drawn


def _tops(gone: set[str], there: set[str]) -> list[str]:
    """The fewest paths whose deletion takes all of `gone` along; below them is nothing of what is there.

    A path of `gone` that is itself still there has lost something: it is deleted, with all below it, and sent again.
    """
    alive = {path[:i] for path in there for i, letter in enumerate(path + "/") if letter == "/"}
    tops: list[str] = []
    for path in sorted(gone):
        if tops and _is_below(path, tops[-1]):
            continue
        top = path
        while (parent := top.rpartition("/")[0]) and parent not in alive:
            top = parent
        tops.append(top)
    return tops


def _is_below(path: str, top: str) -> bool:
    """Whether a path is `top`, or below it."""
    return (path + "/").startswith(top.rstrip("/") + "/")
