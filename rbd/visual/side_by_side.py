"""Scenes side by side in one page, and many robots on one picture, each with its contact forces."""

from __future__ import annotations

import html
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from rbd.answers.least_constraint import solve
from rbd.answers.solution import NearestMotion, Solution
from rbd.arrays import Array, check_flag, check_whole
from rbd.errors import InputError, PictureError
from rbd.model.state import State
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.statics.actuation import Actuation
from rbd.statics.equilibrium import hold
from rbd.visual.marks.other_constraints import origin_of
from rbd.visual.pages.browser import Browser
from rbd.visual.pages.page import page_template, screenshot, system_colors, write_page
from rbd.visual.robot_meshes import drawable
from rbd.visual.scene import Scene
from rbd.visual.style import MOST_SIZE, a_page, a_picture, check_size

MOST = 12
"""Browsers draw some sixteen scenes at a time, and no more."""
CAPTION_HEIGHT, GAP = 44, 4
"""Of a scene's caption, and between two scenes [pixels]."""

_PAGE = page_template(
    system_colors()
    + """html, body { margin: 0; height: 100%; background: var(--halo); font: 15px/20px system-ui, "DejaVu Sans", sans-serif; }
main { display: grid; grid-template-columns: repeat($columns, minmax(0, 1fr)); gap: ${gap}px; height: 100%; }
main { grid-template-rows: repeat($rows, minmax(0, 1fr)); }
figure { margin: 0; display: flex; flex-direction: column; min-height: 0; }
iframe { flex: 1; min-height: 0; width: 100%; border: 0; }
figcaption { height: ${caption}px; line-height: ${caption}px; padding: 0 16px; background: var(--pressed); color: var(--ink); }
figcaption { white-space: nowrap; overflow: hidden; text-overflow: ellipsis; font-weight: 600; flex: none; }""",
    """<main id="meshcat-pane">
$figures
</main>
<script>
// The page is drawn when all its frames are; what follows # in its address goes to each of them: view, layers, no buttons.
const inner = [...document.querySelectorAll("iframe")].map((frame) => frame.contentWindow);
const told = (word) => inner.map((page) => page.document && page.document.body ? page.document.body.dataset[word] : undefined);
let passed = false;
const wait = setInterval(() => {
  const failed = told("failed").find(Boolean);
  if (failed) document.body.dataset.failed = failed;
  if (failed || !told("ready").every(Boolean)) return;
  if (!passed && window.location.hash) {
    for (const page of inner) page.location.hash = window.location.hash;
    passed = true;
    return;
  }
  clearInterval(wait);
  document.body.dataset.ready = "true";
}, 100);
</script>""",
    policy="default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; worker-src blob:; frame-src 'self' about:",
)


def scenes_beside(
    scenes: Mapping[str, Scene | State | Actuation | Solution | NearestMotion | Sequence[Any]],
    html_path: str | PathLike[str],
    *,
    columns: int | None = None,
    seen_from: Sequence[float] | Array | None = None,
    legend: bool = True,
) -> Path:
    """Write scenes side by side as one page that needs no network, each with its caption; returns its path.

    For samples of a study: the last push that is held beside the first that is not. Robots may differ. Each scene is a frame
    that turns by itself, with its own legend. A page has some 2 MB for each humanoid; `rbd.visual.screenshot` makes it a PNG.

    Args:
        scenes: {caption: what is shown}, up to twelve: what `rbd.hold` or `rbd.solve` returned, or the `nearest()` motion of an
            error, each with its own external forces; a `State`; (state, solution, external) as for `Scene.show`; or a `Scene`.
        html_path: Of the page, which ends in .html.
        columns: Scenes in a row; by default up to three.
        seen_from: Direction from each robot to the camera, in W, as of `Scene`; not of scenes that are given.
        legend: Whether names, forces and scales stand beside each robot; not of scenes that are given.

    Raises:
        InputError: no scenes, too many, or what is none.
        PictureError: an empty scene, or a page that cannot be written.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet, push = solo.standing(), solo.feet(), rbd.ExternalForce("base_link", (0.0, 4.0, 0.0))
        >>> shown = {"as it stands": rbd.hold(state, feet), "pushed": rbd.hold(state, feet, external=push)}
        >>> print(rbd.visual.scenes_beside(shown, "beside.html").name)
        beside.html
    """
    target = a_page(html_path)
    if not isinstance(scenes, Mapping) or not all(isinstance(name, str) for name in scenes):
        raise InputError(f"scenes are {scenes!r:.80}; expected {{caption: what rbd.hold or rbd.solve returned}}.")
    if not 1 <= len(scenes) <= MOST:
        raise InputError(f"there are {len(scenes)} scenes; expected 1 to {MOST}, as browsers draw no more of them at a time.")
    across = min(3, len(scenes)) if columns is None else min(check_whole("columns", columns, MOST), len(scenes))
    check_flag("legend", legend)
    figures = [_figure(caption, _scene(caption, given, seen_from, legend)) for caption, given in scenes.items()]
    text = _PAGE.substitute(
        title=html.escape(", ".join(scenes)[:120]),
        columns=across,
        rows=-(-len(scenes) // across),
        caption=CAPTION_HEIGHT,
        gap=GAP,
        figures="\n".join(figures),
    )
    write_page(target, text)
    return target


def _scene(caption: str, given: object, seen_from: Sequence[float] | Array | None, legend: bool) -> Scene:
    """The scene of what was given, shown."""
    if isinstance(given, Scene):
        if not given.shown:
            raise PictureError(f"the scene {caption!r:.80} is empty: call its show(state, solution) first.")
        return given
    state, solution, external = _parts(caption, given)
    scene = Scene(drawable(state.robot), seen_from=seen_from, legend=legend)
    scene.show(state, solution, external=external)
    return scene


def _parts(caption: str, given: Any) -> tuple[State, Any, Any]:
    """State, answer and external forces."""
    if isinstance(given, State):
        return given, None, None
    if isinstance(given, list | tuple) and 1 <= len(given) <= 3 and isinstance(given[0], State):
        return (*given, None, None)[:3]
    answer = given.solution if isinstance(given, NearestMotion) else given
    if not isinstance(answer, Solution | Actuation):
        raise InputError(
            f"{caption!r:.80} is {given!r:.80}; expected what rbd.hold or rbd.solve returned, a state, "
            "(state, solution, external), or a Scene."
        )
    origin = origin_of(answer)
    if not isinstance(getattr(origin, "state", None), State):
        raise InputError(f"{caption!r:.80} answers a problem built by hand, which has no state: give (state, solution).")
    return origin.state, answer, origin.external


def _figure(caption: str, scene: Scene) -> str:
    name, page = html.escape(caption), html.escape(scene.page())
    head = f'<figcaption title="{name}">{name}</figcaption>'
    return f'<figure>{head}<iframe title="{name}" srcdoc="{page}"></iframe></figure>'


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
        robots: Robots that stand (`robot.standing()`, `robot.feet()`), or their names, up to twelve.
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
    columns = check_whole("columns", columns, MOST)
    width, height = check_size(width, height, MOST_SIZE)
    picture = a_picture(png_path)
    try:
        given = [robots] if isinstance(robots, str | Robot) else list(robots)
    except TypeError:
        raise InputError(f"robots are {robots!r:.80}; expected robots or their names: ['talos', 'go2'].") from None
    if bad := [r for r in given if not isinstance(r, str | Robot)]:
        raise InputError(f"{bad[0]!r:.80} is no robot; expected robots or their names: ['talos', 'go2'].")
    loaded = [load_robot(robot) if isinstance(robot, str) else robot for robot in given]
    if not loaded:
        raise InputError("a contact sheet of no robots; give some, or their names: ['talos', 'go2'].")
    scenes: dict[str, tuple[State, Solution]] = {}
    for robot in loaded:
        state = robot.standing()
        feet = robot.feet(friction, at=state)
        kind = "soles" if len(feet[0].corners) > 1 else "points"
        caption = f"{robot.name}: {robot.mass:.3g} kg on {len(feet)} {kind}"
        while caption in scenes:
            caption += ", again"
        scenes[caption] = state, solve(state, hold(state, feet).tau, feet)
    columns = min(columns, len(loaded))
    across, down = columns * (width + GAP) - GAP, -(-len(loaded) // columns) * (height + CAPTION_HEIGHT + GAP) - GAP
    with tempfile.TemporaryDirectory(prefix="rbd-sheet-") as folder:
        page = scenes_beside(scenes, Path(folder) / "sheet.html", columns=columns, legend=False)
        return screenshot(page, picture, width=across, height=down, browser=browser)
