"""Pages of robots against their marks: size, time from opening to the first whole picture, a frame of a video, an answer live.

Times are on the clock: a page is unpacked, built and drawn by several processes of the browser. Run by `make bench`.
"""

from __future__ import annotations

import shutil
import statistics
import tempfile
import time
from functools import cache
from pathlib import Path

from bench_timing import Row

import rbd
from rbd.cli.live_standing import Standing
from rbd.visual.pages.browser import Browser, find_browser

SIZE_MARKS_MB = {"talos": 3.2, "g1": 4.0}
DRAWN_MARK_S = 2.0
FRAME_MARK_MS, ANSWER_MARK_MS = 60.0, 50.0
FRAMES_PER_SECOND = (10, 50)
"""Of two videos of one motion: their difference is what the further frames cost."""
PUSHES_N = range(20, 44, 2)
ROUNDS = 5
WINDOW = (960, 540)
MOTION_S = 2.0
_MOVED = """(async (value) => {
  const { input } = stage.controls.inputs.get("push"), began = performance.now();
  input.value = value;
  input.dispatchEvent(new Event("input"));
  const asked = stage.controls.asked;
  while (stage.controls.answered < asked || stage.viewer.needs_render) await new Promise((r) => setTimeout(r, 1));
  return performance.now() - began;
})"""
_DRAWN = "performance.getEntriesByName('drawn')[0].startTime / 1000"


def page_rows() -> list[Row]:
    """Sizes of a standing Talos, a standing G1 and two seconds of Talos; where there is a browser, also their times."""
    with tempfile.TemporaryDirectory(prefix="rbd-bench-") as folder:
        pages = _written(Path(folder))
        rows = [Row(what, {name: page.stat().st_size / 1e6}, "MB", (SIZE_MARKS_MB[name],)) for what, name, page in pages]
        if find_browser() is None:
            return rows
        with Browser() as browser:
            live = [_video_row(browser, Path(folder)), _answer_row(browser)]
            # All pages in each round, and a first round that is left out.
            times = [[_seconds(browser, page) for _, _, page in pages] for _ in range(ROUNDS + 1)][1:]
    drawn = [statistics.median(each) for each in zip(*times, strict=True)]
    return [*rows, *live] + [
        Row(f"{what}: drawn after", {name: seconds}, "s", (DRAWN_MARK_S,))
        for (what, name, _), seconds in zip(pages, drawn, strict=True)
    ]


@cache
def _standing() -> tuple[rbd.Trajectory, rbd.Robot]:
    """Talos, which holds its posture on its feet for two seconds."""
    robot = rbd.load_robot("talos")
    state, feet = robot.standing(), robot.feet()
    stands = rbd.control.HoldPosture(state, feet)
    return rbd.simulate(state, feet, controller=stands, duration=MOTION_S, step=2e-3, progress=False), robot


def _video_row(browser: Browser, folder: Path) -> Row:
    motion, robot = _standing()
    target = folder / ("stands.mp4" if shutil.which("ffmpeg") else "stands.gif")
    each = []
    for _ in range(3):
        took = []
        for fps in FRAMES_PER_SECOND:
            began = time.perf_counter()
            rbd.visual.export_video(motion, target, fps=fps, browser=browser, progress=False)
            took.append(time.perf_counter() - began)
        few, many = (round(MOTION_S * fps) for fps in FRAMES_PER_SECOND)
        each.append(1e3 * (took[1] - took[0]) / (many - few))
    what = f"a frame of a video of 960 x 540, {target.suffix}"
    return Row(what, {robot.name: statistics.median(each)}, "ms", (FRAME_MARK_MS,))


def _answer_row(browser: Browser) -> Row:
    """From a slider's event in the page to the picture of the answer."""
    robot = rbd.load_robot("talos")
    with rbd.visual.Scene(robot) as scene:
        live = Standing(scene, robot, robot.standing(), 4)
        controls = live.controls(None, None, 0.7, "coulomb", False)
        with rbd.visual.explore(scene, controls, live.answer) as page:
            with browser.open(page.url, width=WINDOW[0], height=WINDOW[1]) as shown:
                shown.wait("stage.live.open")
                took = [float(shown.evaluate(f"{_MOVED}({push})")) for push in PUSHES_N]
    return Row("an answer to a slider, drawn", {robot.name: statistics.median(took[2:])}, "ms", (ANSWER_MARK_MS,))


def _written(folder: Path) -> list[tuple[str, str, Path]]:
    """(what is shown, robot, page) of each page."""
    pages = []
    for name in SIZE_MARKS_MB:
        robot = rbd.load_robot(name)
        state, feet = robot.standing(), robot.feet()
        with rbd.visual.Scene(robot) as scene:
            scene.show(state, rbd.hold(state, feet))
            pages.append(("a robot that stands, with its forces", name, scene.export(folder / f"{name}.html")))
        if name == "talos":
            page = rbd.visual.export_motion(_standing()[0], folder / "motion.html")
            pages.append((f"a motion of {MOTION_S:g} s, with forces and curves", name, page))
    return pages


def _seconds(browser: Browser, page: Path) -> float:
    with browser.open(page, width=WINDOW[0], height=WINDOW[1]) as shown:
        return float(shown.evaluate(_DRAWN))
