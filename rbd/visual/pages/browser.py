"""A headless Chromium that stays open: opens pages, runs scripts in them, photographs them."""

from __future__ import annotations

import base64
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from rbd.errors import InputError, PictureError
from rbd.visual.pages import devtools
from rbd.visual.pages.devtools import DevTools

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
    path = find_browser()
    if path is None:
        raise PictureError(f"no browser found; looked on PATH for {', '.join(BROWSERS)}. Install Chromium.")
    return path


class Browser:
    """One headless Chromium for many pages: to start it takes longer than a picture. Use it as a context.

    Pictures of many scenes are made faster with one: give it to `Scene.screenshot`, `screenshot`, `contact_sheet`,
    `motion_sheet` and `export_video` as `browser`. It is driven through a pipe with the DevTools protocol: no port is opened.
    It ends with its context, when it is no longer used, and when Python ends; a forked child cannot use it.

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
        self._tools = DevTools([a_browser(), *FLAGS, "--remote-debugging-pipe"])
        try:
            self.call("Browser.getVersion")
        except BaseException:
            self._tools.kill()
            raise

    @property
    def pid(self) -> int:
        """Number of the browser's process, and of the group of all its processes."""
        return self._tools.pid

    @property
    def closed(self) -> bool:
        """Whether it has been closed."""
        return self._tools.closed

    def call(self, method: str, *, session: str | None = None, **params: Any) -> dict[str, Any]:
        """The result of a method of the DevTools protocol.

        Raises:
            PictureError: if the browser refuses it, has ended, or does not answer.
        """
        return self._tools.call(method, session=session, **params)

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

    def close(self) -> None:
        """End the browser."""
        self._tools.close()

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


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
    if browser.closed:
        raise PictureError("the browser is closed; open another one: rbd.visual.Browser().")
    yield browser


class BrowserPage:
    """A page open in a `Browser`."""

    def __init__(self, browser: Browser, address: str, width: int, height: int, before: str = "") -> None:
        self._browser = browser
        self._target = str(browser.call("Target.createTarget", url="about:blank")["targetId"])
        try:
            self._session = str(browser.call("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"])
            self.resize(width, height)
            self._call("Page.enable")
            self._call("Inspector.enable")
            self._call("Runtime.enable")
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
        return self._browser._tools.send("Runtime.evaluate", session=self._session, **given)

    def value(self, number: int) -> Any:
        """What `evaluate` would return, of a script that `begin` started."""
        got = self._browser._tools.answer(number, "Runtime.evaluate")
        if "exceptionDetails" in got:
            details = got["exceptionDetails"]
            raise PictureError(f"a script failed in the page: {details.get('exception', details).get('description', details)}")
        return got["result"].get("value")

    def wait(self, condition: str, *, seconds: float | None = None) -> None:
        """Wait until an expression in JavaScript is true.

        Raises:
            PictureError: if it is not in time.
        """
        seconds = devtools.TIMEOUT_SECONDS if seconds is None else seconds
        until = time.monotonic() + seconds
        while not self.evaluate(condition):
            if failed := self._browser._tools.thrown(self._session):
                raise PictureError(f"a script of the page failed: {failed:.500}")
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
