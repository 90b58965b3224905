"""One browser for many pages: it stays open, it ends with its owner, and it leaves nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from rbd.errors import InputError, PictureError
from rbd.visual import Browser, screenshot
from rbd.visual.pages import browser as devtools
from rbd.visual.pages.browser import find_browser

pytestmark = pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine")
HELD = "from rbd.visual import Browser; import time; b = Browser(); print(b.pid, flush=True); time.sleep(60)"


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """A page with a word and a green field."""
    path = tmp_path / "page.html"
    path.write_text('<html><body style="margin:0;background:#00ff00"><b id="b">word</b></body></html>', encoding="utf-8")
    return path


def alive(group: int) -> list[int]:
    """Numbers of the processes of a group that still run; a dead one that nobody waits for does not."""
    found = []
    for process in psutil.process_iter(["status"]):
        try:
            if os.getpgid(process.pid) == group and process.info["status"] != psutil.STATUS_ZOMBIE:
                found.append(process.pid)
        except (ProcessLookupError, PermissionError):
            continue
    return found


def gone(group: int, seconds: float = 20.0) -> bool:
    """Whether all processes of a group end in time."""
    until = time.monotonic() + seconds
    while alive(group) and time.monotonic() < until:
        time.sleep(0.02)
    return not alive(group)


def test_one_browser_draws_many_pages(browser: Browser, page: Path, tmp_path: Path) -> None:
    """Pictures and scripts of two pages that are open at once; a picture leaves the browser open."""
    with browser.open(page, width=100, height=80) as first, browser.open(page, width=60, height=50) as second:
        assert [p.evaluate("[innerWidth, innerHeight]") for p in (first, second)] == [[100, 80], [60, 50]]
        asked = first.begin("new Promise((done) => setTimeout(() => done('late'), 50))")
        assert second.evaluate("document.getElementById('b').textContent") == "word"
        assert first.value(asked) == "late"
        with pytest.raises(PictureError, match="a script failed in the page: TypeError"):
            first.evaluate("null.x")
        with pytest.raises(PictureError, match="the page was not ready within 0.02 s: 1 > 2"):
            first.wait("1 > 2", seconds=0.02)
    for i in range(2):
        assert screenshot(page, tmp_path / f"{i}.png", width=40, height=30, browser=browser).stat().st_size > 0
    assert not browser.closed
    with pytest.raises(PictureError, match=r"could not open .*nowhere\.html: net::ERR_FILE_NOT_FOUND"):
        browser.open(tmp_path / "nowhere.html")


def test_nothing_is_left_of_a_closed_browser(page: Path, tmp_path: Path) -> None:
    """No process, no descriptor, no folder; a closed browser says so, and what is none is refused."""
    before = psutil.Process().num_fds()
    with Browser() as opened, opened.open(page) as shown:
        group, folder = opened.pid, opened._profile.name
        assert len(alive(group)) > 1
        assert Path(folder).is_dir()
        shown.picture()
    assert gone(group)
    assert not Path(folder).exists()
    assert psutil.Process().num_fds() == before
    opened.close()
    with pytest.raises(PictureError, match="the browser is closed; open another one"):
        screenshot(page, tmp_path / "x.png", browser=opened)
    with pytest.raises(InputError, match="browser is 'chromium'; expected a rbd.visual.Browser, or None"):
        screenshot(page, tmp_path / "x.png", browser="chromium")  # type: ignore[arg-type]


def test_one_that_is_forgotten_ends(page: Path) -> None:
    """It ends when nothing refers to it; a forked child neither uses nor ends it."""
    opened = Browser()
    group = opened.pid
    child = os.fork()
    if child == 0:
        try:
            opened.call("Browser.getVersion")
        except PictureError:
            del opened
            os._exit(3)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
    assert "Chrom" in opened.call("Browser.getVersion")["product"]
    del opened
    assert gone(group)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_it_ends_with_its_python(number: signal.Signals) -> None:
    """However Python ends: by an exception, or killed."""
    with subprocess.Popen([sys.executable, "-c", HELD], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as python:
        assert python.stdout is not None
        group = int(python.stdout.readline())
        python.send_signal(number)
        python.wait(20)
    assert gone(group)


def test_one_that_hangs_is_ended_with_its_children(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script without end: the answer is not waited for for ever, and no process stays."""
    with Browser() as opened:
        shown = opened.open(page)
        monkeypatch.setattr(devtools, "TIMEOUT_SECONDS", 0.3)
        with pytest.raises(PictureError, match=r"the browser took over 0\.3 s"):
            shown.evaluate("(() => { for (;;); })()")
        assert gone(opened.pid)
        assert opened.closed


def test_one_that_crashes_says_so(page: Path) -> None:
    """A killed process, and a page whose process is gone, are errors and not a wait."""
    with Browser() as opened:
        shown = opened.open(page)
        with pytest.raises(PictureError, match="the page crashed at Page.crash"):
            shown._call("Page.crash")
        os.kill(opened.pid, signal.SIGKILL)
        with pytest.raises(PictureError, match=r"the browser has ended \(exit -9\)"):
            opened.call("Browser.getVersion")
