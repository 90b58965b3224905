"""Pages of robots against their marks: their size, and the time from opening one to its first whole picture.

Times are on the clock: a page is unpacked, built and drawn by several processes of the browser. Run by `make bench`.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

from bench_timing import Row

import rbd
from rbd.visual.pages.browser import Browser, find_browser

SIZE_MARKS_MB = {"talos": 3.2, "g1": 4.0}
DRAWN_MARK_S = 2.0
ROUNDS = 5
WINDOW = (960, 540)
MOTION_S = 2.0
_DRAWN = "performance.getEntriesByName('drawn')[0].startTime / 1000"


def page_rows() -> list[Row]:
    """Sizes of a standing Talos, a standing G1 and two seconds of Talos; where there is a browser, also their times."""
    with tempfile.TemporaryDirectory(prefix="rbd-bench-") as folder:
        pages = _written(Path(folder))
        rows = [Row(what, {name: page.stat().st_size / 1e6}, "MB", (SIZE_MARKS_MB[name],)) for what, name, page in pages]
        if find_browser() is None:
            return rows
        with Browser() as browser:
            # All pages in each round, and a first round that is left out.
            times = [[_seconds(browser, page) for _, _, page in pages] for _ in range(ROUNDS + 1)][1:]
    drawn = [statistics.median(each) for each in zip(*times, strict=True)]
    return rows + [
        Row(f"{what}: drawn after", {name: seconds}, "s", (DRAWN_MARK_S,))
        for (what, name, _), seconds in zip(pages, drawn, strict=True)
    ]


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
            stands = rbd.control.HoldPosture(state, feet)
            motion = rbd.simulate(state, feet, controller=stands, duration=MOTION_S, step=2e-3, progress=False)
            page = rbd.visual.export_motion(motion, folder / "motion.html")
            pages.append((f"a motion of {MOTION_S:g} s, with forces and curves", name, page))
    return pages


def _seconds(browser: Browser, page: Path) -> float:
    with browser.open(page, width=WINDOW[0], height=WINDOW[1]) as shown:
        return float(shown.evaluate(_DRAWN))
