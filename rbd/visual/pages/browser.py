"""A headless Chromium that stays open, driven through two pipes by the DevTools protocol: opens pages, photographs them."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import threading
import time
import weakref
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from rbd.errors import InputError, PictureError
from rbd.model.data_pool import renewed_after_fork

TIMEOUT_SECONDS = 120.0
"""Time that an answer may take [s]."""
END_SECONDS = 5.0
"""Time in which a browser may end by itself before it is killed [s]."""
_PIPE_BYTES = 1 << 20


def _spawned(command: list[str], told: Path) -> tuple[int, int, int]:
    """Start a process that reads commands from descriptor 3 and answers on 4: its number, and our ends of the two pipes.

    Args:
        command: The program and its arguments.
        told: File for what it writes to its standard error.
    """
    (theirs_in, ours_out), (ours_in, theirs_out) = os.pipe(), os.pipe()
    high: list[int] = []
    try:
        # Copies above 9, so that putting one on 3 does not overwrite the other.
        high += [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10) for fd in (theirs_in, theirs_out)]
        if hasattr(fcntl, "F_SETPIPE_SZ"):  # pictures are large; Linux only
            for fd in (ours_in, ours_out):
                with suppress(OSError):
                    fcntl.fcntl(fd, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        actions: list[tuple[Any, ...]] = [(os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_RDWR, 0) for fd in (0, 1)]
        actions += [(os.POSIX_SPAWN_OPEN, 2, str(told), os.O_WRONLY | os.O_CREAT, 0o600)]
        actions += [(os.POSIX_SPAWN_DUP2, high[0], 3), (os.POSIX_SPAWN_DUP2, high[1], 4)]
        pid = os.posix_spawn(command[0], command, os.environ, file_actions=actions, setpgroup=0)
    except BaseException:
        os.close(ours_out)
        os.close(ours_in)
        raise
    finally:
        for fd in (theirs_in, theirs_out, *high):
            os.close(fd)
    return pid, ours_out, ours_in


def _ended(pid: int, to: int, answers: int, profile: tempfile.TemporaryDirectory[str], owner: int) -> None:
    """Close the pipes, at which a browser ends; kill what has not ended in time, and remove its folder."""
    if os.getpid() != owner:
        return
    for fd in (to, answers):
        with suppress(OSError):
            os.close(fd)
    until = time.monotonic() + END_SECONDS
    with suppress(ChildProcessError):
        while os.waitpid(pid, os.WNOHANG) == (0, 0) and time.monotonic() < until:
            time.sleep(0.002)
    _kill(pid)  # whatever of its group is left
    with suppress(ChildProcessError):
        os.waitpid(pid, 0)
    until = time.monotonic() + 1.0
    while os.path.isdir(profile.name) and time.monotonic() < until:
        with suppress(OSError):  # a process of the group may write until it is gone
            profile.cleanup()


def _kill(group: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# Quiet, without a graphics card (SwiftShader draws in software), and unable to reach any other machine.
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
# A page without a stage, such as a contact sheet, is drawn when it is loaded.
_DRAWN = """(() => {
  if (document.readyState !== "complete") return false;
  const { ready, failed } = document.body.dataset;
  if (failed) throw new Error(failed);
  return !document.getElementById("meshcat-pane") || ready === "true";
})()"""


def find_browser() -> str | None:
    """Path of Chromium or Chrome on this machine, or None.

    Example:
        >>> rbd.visual.find_browser()  # doctest: +SKIP
        '/usr/bin/chromium'
    """
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def a_browser() -> str:
    """Path of Chromium or Chrome.

    Raises:
        PictureError: if there is none.
    """
    if (path := find_browser()) is None:
        raise PictureError(f"no browser found; looked on PATH for {', '.join(BROWSERS)}. Install Chromium.")
    return path


class Closing(ABC):
    """What is used as a context, and closed at its end."""

    @abstractmethod
    def close(self) -> None:
        """End it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class Browser(Closing):
    """One headless Chromium for many pages: to start it takes longer than a picture. Use it as a context.

    Pictures of many scenes are made faster with one: give it to `Scene.screenshot`, `screenshot`, `contact_sheet`,
    `motion_sheet` and `export_video` as `browser`. It is driven through pipes with the DevTools protocol: no port is opened. It
    leads a group of processes of its own: Ctrl-C in the terminal does not reach it, and all of them are killed together. It
    ends with its context, when it is no longer used, and when Python ends; a forked child cannot use it.

    Raises:
        PictureError: no browser on PATH, or it does not start.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> with rbd.visual.Browser() as browser, rbd.visual.Scene(robot) as scene:  # doctest: +SKIP
        ...     for name in robot.postures:
        ...         scene.show(robot.at(name))
        ...         scene.screenshot(f"{name}.png", browser=browser)
    """

    def __init__(self) -> None:
        program = a_browser()
        self._lock = threading.RLock()
        self._buffer, self._looked_at = bytearray(), 0
        self._answers: dict[int, dict[str, Any]] = {}
        self._count, self._in_order = 0, True
        self._thrown: dict[str, str] = {}
        self._profile = tempfile.TemporaryDirectory(prefix="rbd-browser-")
        self._told = Path(self._profile.name) / "stderr.txt"
        command = [program, *FLAGS, "--remote-debugging-pipe", f"--user-data-dir={self._profile.name}"]
        try:
            self.pid, self._to, self._from = _spawned(command, self._told)
        except OSError as error:
            self._profile.cleanup()
            raise PictureError(f"the browser {command[0]!r:.300} cannot be started: {error.strerror}.") from error
        self._end = weakref.finalize(self, _ended, self.pid, self._to, self._from, self._profile, os.getpid())
        renewed_after_fork(self)
        try:
            self.call("Browser.getVersion")
        except BaseException:
            self.kill()
            raise

    def renew_after_fork(self) -> None:
        """In a forked child: the browser belongs to the parent."""
        self._lock = threading.RLock()
        if self._end.detach() is not None:
            for fd in (self._to, self._from):
                with suppress(OSError):
                    os.close(fd)
            self._profile._finalizer.detach()  # type: ignore[attr-defined]

    @property
    def closed(self) -> bool:
        """Whether it has been closed."""
        return not self._end.alive

    def check_open(self) -> None:
        """Refuse a browser that has been closed.

        Raises:
            PictureError: it has been.
        """
        if self.closed:
            raise PictureError("the browser is closed; open another one: rbd.visual.Browser().")

    def open(
        self, page: Path | str, *, width: int = 1280, height: int = 960, fragment: str = "", before: str = ""
    ) -> BrowserPage:
        """A page in a tab of its own, as soon as it is drawn.

        Args:
            page: A file, or the address of a live scene.
            width: Of the window, in pixels.
            height: Of the window, in pixels.
            fragment: What follows # in the address, as in "t=0.5&view=front".
            before: A script that runs before those of the page.
        """
        address = page.resolve().as_uri() if isinstance(page, Path) else page
        return BrowserPage(self, address + (f"#{fragment}" if fragment else ""), width, height, before)

    def send(self, method: str, *, session: str | None = None, **params: Any) -> int:
        """Send a message without waiting for its answer; returns its number, for `answer`.

        Raises:
            PictureError: if the browser has ended.
        """
        with self._lock:
            self.check_open()
            self._count += 1
            message: dict[str, Any] = {"id": self._count, "method": method, "params": params}
            if session is not None:
                message["sessionId"] = session
            packed = memoryview(json.dumps(message).encode() + b"\0")
            self._in_order = False
            try:
                while packed:
                    packed = packed[os.write(self._to, packed) :]
            except OSError:
                raise self._has_ended() from None
            self._in_order = True
            return self._count

    def answer(self, number: int, method: str) -> dict[str, Any]:
        """The answer to a message.

        Raises:
            PictureError: if the browser refuses it, has ended, or does not answer in time.
        """
        with self._lock:
            until = time.monotonic() + TIMEOUT_SECONDS
            while number not in self._answers:
                one = self._read(until)
                if one.get("method") == "Inspector.targetCrashed":
                    raise PictureError(f"the page crashed at {method}: it may need more memory than there is.")
                if one.get("method") == "Runtime.exceptionThrown":
                    details = one["params"]["exceptionDetails"]
                    what = details.get("exception", {}).get("description", details.get("text", ""))
                    self._thrown.setdefault(one.get("sessionId", ""), str(what))
                if "id" in one:
                    self._answers[one["id"]] = one
            answer = self._answers.pop(number)
        if "error" in answer:
            raise PictureError(f"the browser refused {method}: {answer['error'].get('message', answer['error'])}.")
        return dict(answer["result"])

    def call(self, method: str, *, session: str | None = None, **params: Any) -> dict[str, Any]:
        """The result of a method of the DevTools protocol, see `send` and `answer`."""
        with self._lock:
            return self.answer(self.send(method, session=session, **params), method)

    def thrown(self, session: str) -> str:
        """The first error of a page's own scripts since `Runtime.enable`; empty without one."""
        return self._thrown.get(session, "")

    def close(self) -> None:
        """End the process: ask it to, and kill it if it does not."""
        with self._lock:
            if self._in_order and not self.closed:
                with suppress(PictureError):
                    self.send("Browser.close")
        self._end()

    def kill(self) -> None:
        """End the process at once, with its children."""
        if not self.closed:
            _kill(self.pid)
        self._end()

    def _read(self, until: float) -> dict[str, Any]:
        """The next message that comes."""
        while (end := self._buffer.find(b"\0", self._looked_at)) < 0:
            self._looked_at = len(self._buffer)
            self.check_open()
            ready, _, _ = select.select([self._from], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                self.kill()
                raise PictureError(f"the browser took over {TIMEOUT_SECONDS:g} s for an answer; it was ended.")
            if not (more := os.read(self._from, _PIPE_BYTES)):
                raise self._has_ended()
            self._buffer += more
        one = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        self._looked_at = 0
        return dict(json.loads(one))

    def _has_ended(self) -> PictureError:
        """What to raise when the process is not there any more; it is closed."""
        until = time.monotonic() + 1.0
        status: int | None = None
        while status is None and time.monotonic() < until:
            try:
                pid, code = os.waitpid(self.pid, os.WNOHANG)
            except ChildProcessError:
                break
            status = os.waitstatus_to_exitcode(code) if pid else None
            time.sleep(0.0 if pid else 0.005)
        lines = self._told.read_text(errors="replace").strip().splitlines() if self._told.exists() else []
        words = lines[-1][:300] if lines else "it said nothing"
        self.kill()
        how = "its pipe was closed" if status is None else f"exit {status}"
        return PictureError(f"the browser has ended ({how}): {words}.")


@contextmanager
def one_browser(browser: object = None) -> Iterator[Browser]:
    """A context with the browser that was given, which stays open; or with a new one, which is closed at its end.

    Raises:
        InputError: what is no browser.
        PictureError: one that is closed, or none on PATH.
    """
    if browser is None:
        with Browser() as new:
            yield new
        return
    if not isinstance(browser, Browser):
        raise InputError(f"browser is {browser!r:.80}; expected a rbd.visual.Browser, or None.")
    browser.check_open()
    yield browser


class BrowserPage(Closing):
    """A page open in a `Browser`."""

    def __init__(self, browser: Browser, address: str, width: int, height: int, before: str = "") -> None:
        self._browser = browser
        self._target = str(browser.call("Target.createTarget", url="about:blank")["targetId"])
        try:
            self._session = str(browser.call("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"])
            self.resize(width, height)
            for domain in ("Page", "Inspector", "Runtime"):
                self._call(f"{domain}.enable")
            self.prefer("light")  # pictures are the same whatever this machine prefers
            if before:
                self._call("Page.addScriptToEvaluateOnNewDocument", source=before)
            moved = self._call("Page.navigate", url=address)
            if "errorText" in moved:
                raise PictureError(f"the browser could not open {address}: {moved['errorText']}.")
            self.wait(_DRAWN)
        except BaseException:
            self.close()
            raise

    def evaluate(self, script: str) -> Any:
        """The value of an expression in JavaScript, as plain data; a promise's when it is kept.

        Raises:
            PictureError: if the script throws.
        """
        return self.value(self.begin(script))

    def begin(self, script: str) -> int:
        """Start the work of `evaluate` and do not wait for it; returns its number, for `value`."""
        given = {"expression": script, "returnByValue": True, "awaitPromise": True}
        return self._browser.send("Runtime.evaluate", session=self._session, **given)

    def value(self, number: int) -> Any:
        """What `evaluate` would return, of a script that `begin` started."""
        got = self._browser.answer(number, "Runtime.evaluate")
        if "exceptionDetails" in got:
            details = got["exceptionDetails"]
            raise PictureError(f"a script failed in the page: {details.get('exception', details).get('description', details)}")
        return got["result"].get("value")

    def wait(self, condition: str, *, seconds: float | None = None) -> None:
        """Wait until an expression in JavaScript is true.

        Raises:
            PictureError: if it is not in time.
        """
        seconds = TIMEOUT_SECONDS if seconds is None else seconds
        until = time.monotonic() + seconds
        while not self.evaluate(condition):
            if failed := self._browser.thrown(self._session):
                raise PictureError(f"a script of the page failed: {failed:.500}")
            if time.monotonic() > until:
                raise PictureError(f"the page was not ready within {seconds:g} s: {condition}")
            time.sleep(0.005)

    def resize(self, width: int, height: int) -> None:
        """Change the size of the window, in pixels."""
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def prefer(self, scheme: str) -> None:
        """Tell the page that its reader's system is "dark" or "light"."""
        self._call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def mouse(self, kind: str, x: float, y: float, *, button: str = "none") -> None:
        """Send a mouse event: mouseMoved, mousePressed or mouseReleased, in pixels from the top left."""
        self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=int(button != "none"))

    def click(self, x: float, y: float) -> None:
        """Press and release the left button."""
        self.mouse("mousePressed", x, y, button="left")
        self.mouse("mouseReleased", x, y, button="left")

    def touch(self, kind: str, *fingers: tuple[float, float]) -> None:
        """Send a touch event: touchStart, touchMove or touchEnd, with the fingers then down, in pixels from the top left."""
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(fingers)]
        self._call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    def key(self, key: str) -> None:
        """Press and release a key, as "t" or "ArrowLeft"."""
        for kind in ("keyDown", "keyUp"):
            self._call("Input.dispatchKeyEvent", type=kind, key=key, **({"text": key} if len(key) == 1 else {}))

    def picture(self) -> bytes:
        """The page as it is now, as a PNG."""
        return base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        """Close the tab."""
        with suppress(PictureError):
            self._browser.call("Target.closeTarget", targetId=self._target)

    def _call(self, method: str, **params: Any) -> dict[str, Any]:
        return self._browser.call(method, session=self._session, **params)
