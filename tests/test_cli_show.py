"""Every `--show` of the command line, driven once: its address, its page in a browser, Ctrl-C, and nothing left behind."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

import rbd
from rbd.cli.app import app
from rbd.visual.pages.browser import Browser, BrowserPage, find_browser

URDF = Path(__file__).parents[1] / "urdf"
SECONDS = 120.0
"""For a command to print its address, and to end."""
DRAWN = """(() => {
  const { renderer } = stage.viewer, gl = renderer.getContext(), found = new Set();
  stage.viewer.render();
  const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
  gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  for (let i = 0; i < pixels.length; i += 4) found.add((pixels[i] << 16) + (pixels[i + 1] << 8) + pixels[i + 2]);
  return found.size;
})()"""
"""How many colours the picture has."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A headless browser; tests that want it are skipped where none is installed."""
    if find_browser() is None:
        pytest.skip("no Chromium on this machine")
    with Browser() as opened:
        yield opened


@dataclass
class Served:
    """A command that serves.

    Attributes:
        url: Its address.
        process: The command.
        lines: What it has printed.
    """

    url: str
    process: subprocess.Popen[str]
    lines: list[str] = field(default_factory=list)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self.url.rstrip("/").rsplit(":", 1)[1])

    def interrupt(self) -> int:
        """Press Ctrl-C; the exit code."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(SECONDS)


@contextmanager
def serving(*command: str, cwd: Path) -> Iterator[Served]:
    """A command of the command line that runs until its context ends, with a `webbrowser` that opens nothing."""
    quiet = {**os.environ, "BROWSER": "true", "PYTHONWARNINGS": "ignore", "COLUMNS": "200"}
    run = [sys.executable, "-m", "rbd", *command, "--show"]
    process = subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=quiet, cwd=cwd)
    guard = threading.Timer(SECONDS, process.kill)
    guard.start()
    lines: list[str] = []
    try:
        assert process.stdout is not None
        for line in process.stdout:
            lines.append(line)
            if found := re.search(r"serving at (http://127\.0\.0\.1:\d+/)", line):
                served = Served(found[1], process, lines)
                rest = threading.Thread(target=lambda: lines.extend(process.stdout or ()), daemon=True)
                rest.start()
                yield served
                rest.join(SECONDS)
                break
        else:
            pytest.fail(f"no address in: {''.join(lines)}")
    finally:
        guard.cancel()
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def refused(port: int) -> bool:
    """Whether nobody listens there any more."""
    try:
        socket.create_connection(("127.0.0.1", port), timeout=10).close()
    except ConnectionRefusedError:
        return True
    return False


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    """A motion that `rbd check` reads: a robot that bends its knees."""
    solo = rbd.load_robot("solo12")
    low, high = solo.standing().q, solo.standing().q.copy()
    high[2] += 0.01
    path = tmp_path / "hop.npz"
    rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=20.0).save(path)
    return path


def see_standing(page: BrowserPage) -> None:
    """Forces of the feet, and sliders that answer."""
    assert page.evaluate("stage.layers.listed.some(({ path }) => path.startsWith('contacts/'))")
    page.evaluate("""(() => {
      const { input } = stage.controls.inputs.get("push");
      input.value = 2;
      input.dispatchEvent(new Event("input"));
    })()""")
    page.wait("stage.controls.answered === 1")
    assert "withstand" in page.evaluate("document.querySelector('.verdict').innerText")


def see_mechanism(page: BrowserPage) -> None:
    """The robot and its other branch."""
    assert "branch" in page.evaluate("stage.legend.innerText")


def see_motion(page: BrowserPage) -> None:
    """The whole motion with its bar: it plays, it can be scrubbed, and it has curves."""
    page.wait("stage.player.t > stage.player.first")
    assert page.evaluate("stage.player.times.length") > 2
    page.evaluate("stage.player.go(stage.player.last)")
    assert page.evaluate("stage.player.t === stage.player.last && !stage.player.playing")
    page.evaluate("stage.player.go(0.5 * (stage.player.first + stage.player.last))")
    assert page.evaluate("document.querySelectorAll('.curves canvas').length") > 0
    assert page.evaluate("getComputedStyle(document.querySelector('.player')).display") != "none"


SHOWN = {
    "stand": (["stand", "solo12"], see_standing),
    "mechanism": (["mechanism", str(URDF / "four_bar.urdf"), "--tries", "20"], see_mechanism),
    "simulate": (["simulate", str(URDF / "box.urdf"), "--duration", "0.05"], see_motion),
    "walk": (["walk", "solo12", "--gait", "trot", "--steps", "1"], see_motion),
    "check": (["check", "{motion}", "--robot", "solo12", "--least-possible", "0"], see_motion),
}


def test_every_show_is_driven():
    """A command that gets a `--show` gets a test here."""
    with_show = {
        command.name or command.callback.__name__
        for command in app.registered_commands
        if command.callback is not None and "show" in command.callback.__annotations__
    }
    assert with_show == set(SHOWN)


@pytest.mark.parametrize("name", SHOWN)
def test_a_scene_is_served_drawn_and_ended(name: str, browser: Browser, motion: Path, tmp_path: Path):
    """Its address is printed after its tables, its page is drawn, Ctrl-C ends it with 0, and its port is free again."""
    command, see = SHOWN[name]
    with serving(*(word.format(motion=motion) for word in command), cwd=tmp_path) as served:
        assert len(served.lines) > 3 and "Ctrl-C ends it" in served.lines[-1]
        with browser.open(served.url, width=1000, height=640) as page:
            page.wait("stage.live.open")
            assert page.evaluate(DRAWN) > 200
            see(page)
            assert page.evaluate("document.querySelector('.ended') === null")
            assert served.interrupt() == 0
            page.wait("document.querySelector('.ended') !== null")
        assert refused(served.port)
    told = "".join(served.lines)
    assert told.endswith("ended\n") or "ended\nwarning: " in told  # warnings come last
    assert "Traceback" not in told
    assert {path.name for path in tmp_path.iterdir()} == {motion.name}
