"""Many robots on one picture, each standing on its feet with its contact forces."""

from __future__ import annotations

import base64
import html
import tempfile
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from string import Template

from rbd.answers.least_constraint import solve
from rbd.errors import InputError
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.statics.equilibrium import hold
from rbd.visual.pages.browser import Browser, one_browser
from rbd.visual.pages.page import screenshot
from rbd.visual.scene import Scene
from rbd.visual.style import a_count, a_picture

CAPTION_HEIGHT = 46
GAP = 10

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; img-src data:">
<title>robots</title>
<style>
body { margin: 0; background: #ffffff; font: 15px/20px system-ui, "DejaVu Sans", sans-serif; color: #1f2933; }
main { display: grid; grid-template-columns: repeat($columns, ${width}px); gap: ${gap}px; padding: ${gap}px; }
figure { margin: 0; border-radius: 10px; overflow: hidden; background: #dbe3eb; }
img { display: block; width: ${width}px; height: ${height}px; }
figcaption { height: ${caption}px; line-height: ${caption}px; padding: 0 16px; background: #eef2f5; display: flex; }
figcaption b { flex: 1; font-size: 17px; }
figcaption span { color: #5b6770; font-size: 13px; }
</style>
</head>
<body><main>
$figures
</main></body>
</html>
""")


def contact_sheet(
    robots: Iterable[Robot | str] | Robot | str,
    png_path: str | PathLike[str],
    *,
    columns: int = 3,
    width: int = 440,
    height: int = 440,
    friction: float = 0.7,
    browser: Browser | None = None,
) -> Path:
    """Draw robots side by side, each at rest on its feet with the contact forces that carry it; returns the picture's path.

    The forces are those of `solve` under the torques of `hold`; every cell has a separate scale. A robot is seen from
    its front left, if its soles show where that is.

    Args:
        robots: Robots that stand (`robot.standing()`, `robot.feet()`), or their names.
        png_path: Path of the picture.
        columns: Robots in a row.
        width: Of one robot's picture, in pixels.
        height: Of one robot's picture without its caption, in pixels.
        friction: Coulomb's coefficient at the feet.
        browser: An open browser; by default one is started for all these pictures.

    Raises:
        InputError: no robots, or sizes that are not positive.
        ModelError: one that has no posture or no feet.
        CannotHold: a robot that cannot stand.
        PictureError: no browser, or it made no picture.

    Example:
        >>> rbd.visual.contact_sheet(["solo12", "talos"], "standing.png")  # doctest: +SKIP
        PosixPath('standing.png')
    """
    columns, width, height = a_count("columns", columns, 100), a_count("width", width, 4000), a_count("height", height, 4000)
    a_picture(png_path)
    try:
        given = [robots] if isinstance(robots, str | Robot) else list(robots)
    except TypeError:
        raise InputError(f"robots are {robots!r:.80}; expected robots or their names: ['talos', 'go2'].") from None
    if bad := [r for r in given if not isinstance(r, str | Robot)]:
        raise InputError(f"{bad[0]!r:.80} is no robot; expected robots or their names: ['talos', 'go2'].")
    loaded = [load_robot(robot) if isinstance(robot, str) else robot for robot in given]
    if not loaded:
        raise InputError("a contact sheet of no robots; give some, or their names: ['talos', 'go2'].")
    columns = min(columns, len(loaded))
    rows = -(-len(loaded) // columns)
    with tempfile.TemporaryDirectory(prefix="rbd-sheet-") as folder, one_browser(browser) as used:
        figures = [_figure(robot, Path(folder), width, height, friction, used) for robot in loaded]
        page = Path(folder) / "sheet.html"
        text = _PAGE.substitute(
            columns=columns, width=width, height=height, caption=CAPTION_HEIGHT, gap=GAP, figures="\n".join(figures)
        )
        page.write_text(text, encoding="utf-8")
        whole = columns * (width + GAP) + GAP, rows * (height + CAPTION_HEIGHT + GAP) + GAP
        return screenshot(page, png_path, width=whole[0], height=whole[1], browser=used)


def _figure(robot: Robot, folder: Path, width: int, height: int, friction: float, browser: Browser) -> str:
    state, feet = robot.standing(), robot.feet(friction)
    solution = solve(state, hold(state, feet).tau, feet)
    with Scene(robot, legend=False) as scene:
        scene.show(state, solution)
        picture = scene.screenshot(folder / "robot.png", width=width, height=height, browser=browser)
    data = base64.b64encode(picture.read_bytes()).decode("ascii")
    kind = "soles" if len(feet[0].corners) > 1 else "points"
    facts = f"{robot.mass:.3g} kg on {len(feet)} {kind}"
    name = html.escape(robot.name)
    caption = f"<figcaption><b>{name}</b><span>{facts}</span></figcaption>"
    return f'<figure><img alt="{name}" src="data:image/png;base64,{data}">{caption}</figure>'
