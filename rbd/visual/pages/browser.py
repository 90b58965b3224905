"""A headless Chromium that stays open: opens pages, runs scripts in them, photographs them."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from rbd.errors import PictureError

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
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",  # a live scene of this machine is there
)
TIMEOUT_SECONDS = 120.0
# A page without a stage, such as a contact sheet, is drawn when it is loaded.
_DRAWN = "document.readyState === 'complete' && (typeof stage === 'undefined' || document.body.dataset.ready === 'true')"


def find_browser() -> str | None:
    """Path of Chromium or Chrome on this machine, or None.

    Example:
        >>> rbd.visual.find_browser()  # doctest: +SKIP
        '/usr/bin/chromium'
    """
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


class Browser:
    """One headless browser for many pages: starting it takes longer than a picture.

    It is driven through a pipe with the DevTools protocol: no port is opened. Use it as a context.

    Raises:
        PictureError: no browser on PATH, or it does not start.
    """

    def __init__(self) -> None:
        path = find_browser()
        if path is None:
            raise PictureError(f"no browser found; looked on PATH for {', '.join(BROWSERS)}. Install Chromium.")
        self._profile = tempfile.TemporaryDirectory(prefix="rbd-browser-")
        command = [path, *FLAGS, "--remote-debugging-pipe", f"--user-data-dir={self._profile.name}", "about:blank"]
        self._pid, self._to, self._from = _spawned(command)
        self._buffer, self._count = b"", 0
        self.call("Browser.getVersion")

    def call(self, method: str, *, session: str | None = None, **params: Any) -> dict[str, Any]:
        """The result of a method of the DevTools protocol.

        Raises:
            PictureError: if the browser refuses it, has ended, or does not answer.
        """
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        packed = json.dumps(message).encode() + b"\0"
        try:
            while packed:
                packed = packed[os.write(self._to, packed) :]
        except OSError as error:
            raise PictureError(f"the browser has ended: {error}.") from error
        until = time.monotonic() + TIMEOUT_SECONDS
        while True:
            answer = self._read(until)
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise PictureError(f"the browser refused {method}: {answer['error'].get('message', answer['error'])}.")
                return dict(answer["result"])

    def open(self, page: Path | str, *, width: int = 1280, height: int = 960, fragment: str = "") -> BrowserPage:
        """A page in a tab of its own, as soon as it is drawn.

        Args:
            page: A file, or the address of a live scene.
            width: Of the window, in pixels.
            height: Of the window, in pixels.
            fragment: What follows # in the address, as in "t=0.5&view=front".
        """
        address = page.resolve().as_uri() if isinstance(page, Path) else page
        return BrowserPage(self, address + (f"#{fragment}" if fragment else ""), width, height)

    def close(self) -> None:
        """End the browser."""
        with suppress(PictureError):
            self.call("Browser.close")
        with suppress(OSError):
            os.close(self._to)
            os.close(self._from)
        until = time.monotonic() + 10.0
        while os.waitpid(self._pid, os.WNOHANG) == (0, 0):
            if time.monotonic() > until:
                os.kill(self._pid, signal.SIGKILL)
            time.sleep(0.005)
        with suppress(OSError):
            self._profile.cleanup()

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _read(self, until: float) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._from], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                raise PictureError(f"the browser took over {TIMEOUT_SECONDS:g} s.")
            more = os.read(self._from, 1 << 20)
            if not more:
                raise PictureError("the browser has ended.")
            self._buffer += more
        one, _, self._buffer = self._buffer.partition(b"\0")
        return dict(json.loads(one))


def _spawned(command: list[str]) -> tuple[int, int, int]:
    """Start a process that reads commands from descriptor 3 and answers on 4: its number, and our ends of the two pipes."""
    pipes = [os.pipe(), os.pipe()]
    (theirs_in, ours_out), (ours_in, theirs_out) = pipes
    # Copies above 9, so that putting one on 3 does not overwrite the other.
    high = [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10) for fd in (theirs_in, theirs_out)]
    actions: list[tuple[Any, ...]] = [(os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_RDWR, 0) for fd in (0, 1, 2)]
    actions += [(os.POSIX_SPAWN_DUP2, high[0], 3), (os.POSIX_SPAWN_DUP2, high[1], 4)]
    try:
        pid = os.posix_spawn(command[0], command, os.environ, file_actions=actions)
    finally:
        for fd in (theirs_in, theirs_out, *high):
            os.close(fd)
    return pid, ours_out, ours_in


class BrowserPage:
    """A page open in a `Browser`."""

    def __init__(self, browser: Browser, address: str, width: int, height: int) -> None:
        self._browser = browser
        self._target = str(browser.call("Target.createTarget", url="about:blank")["targetId"])
        self._session = str(browser.call("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"])
        self.resize(width, height)
        self._call("Page.enable")
        moved = self._call("Page.navigate", url=address)
        if "errorText" in moved:
            raise PictureError(f"the browser could not open {address}: {moved['errorText']}.")
        self.wait(_DRAWN)

    def evaluate(self, script: str) -> Any:
        """The value of an expression in JavaScript, as plain data; a promise's when it is kept.

        Raises:
            PictureError: if the script throws.
        """
        got = self._call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in got:
            details = got["exceptionDetails"]
            raise PictureError(f"a script failed in the page: {details.get('exception', details).get('description', details)}")
        return got["result"].get("value")

    def wait(self, condition: str, *, seconds: float = TIMEOUT_SECONDS) -> None:
        """Wait until an expression in JavaScript is true.

        Raises:
            PictureError: if it is not in time.
        """
        until = time.monotonic() + seconds
        while not self.evaluate(condition):
            if time.monotonic() > until:
                raise PictureError(f"the page was not ready within {seconds:g} s: {condition}")
            time.sleep(0.005)

    def resize(self, width: int, height: int) -> None:
        """Change the size of the window, in pixels."""
        size = {"width": width, "height": height}
        self._call("Emulation.setDeviceMetricsOverride", **size, deviceScaleFactor=1, mobile=False)

    def mouse(self, kind: str, x: float, y: float, *, button: str = "none") -> None:
        """Send a mouse event: mouseMoved, mousePressed or mouseReleased, in pixels from the top left."""
        pressed = 0 if button == "none" else 1
        self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=pressed)

    def click(self, x: float, y: float) -> None:
        """Press and release the left button."""
        self.mouse("mousePressed", x, y, button="left")
        self.mouse("mouseReleased", x, y, button="left")

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

    def __enter__(self) -> BrowserPage:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def _call(self, method: str, **params: Any) -> dict[str, Any]:
        return self._browser.call(method, session=self._session, **params)
