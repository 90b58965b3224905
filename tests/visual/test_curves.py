"""Charts beside a motion: their numbers are the trajectory's, their cursor is at the present time."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.errors import InputError
from rbd.visual import export_motion
from rbd.visual.pages.browser import Browser, BrowserPage
from rbd.visual.playback.animation import shown_motion
from rbd.visual.playback.curves import MOST_POINTS, CurveChart, kept_samples, top_of
from rbd.visual.playback.motion_frames import frames_of
from rbd.visual.playback.trajectory_charts import CHARTS, carries_weight, charts_of, edge_distances, normals_of

SLOPE = 0.2
"""Angle of the slope about y [rad]."""


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def run(solo: rbd.Robot) -> rbd.Trajectory:
    """It holds its posture on four feet, and is pushed."""
    stand, feet = solo.standing(), solo.feet()
    hold = rbd.control.HoldPosture(stand, feet)
    push = rbd.control.Push("base_link", (0.0, 4.0, 0.0), start=0.05, duration=0.05)
    return rbd.simulate(stand, feet, duration=0.3, step=5e-3, controller=hold, external=push, progress=False)


@pytest.fixture(scope="module")
def slide() -> rbd.Trajectory:
    """A box slides down a slope: the contact's normal is not vertical."""
    R = pin.exp3(np.array([0.0, SLOPE, 0.0]))
    start = rbd.State(rbd.load_robot("urdf/box.urdf"), [*(0.1 * R[:, 2]), *pin.Quaternion(R).coeffs()], [1.0, 0, 0, 0, 0, 0])
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    face = rbd.SurfaceContact(
        "face", "box", half_lengths=(0.2, 0.2), placement=below, friction=0.5, on=rbd.Ground(point=(0, 0, 0), normal=R[:, 2])
    )  # fmt: skip
    return rbd.simulate(start, [face], duration=0.3, step=5e-3, progress=False)


@pytest.fixture(scope="module")
def page(run: rbd.Trajectory, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_motion(run, tmp_path_factory.mktemp("curves") / "solo.html")


def told(page: Path) -> dict[str, Any]:
    """The motion that a page holds."""
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    found: dict[str, Any] = next(n["motion"] for n in notes if "motion" in n)
    return found


def numbers(packed: str) -> Array:
    return np.frombuffer(base64.b64decode(packed), "<f4")


def named(charts: list[CurveChart], name: str) -> dict[str, Array]:
    """{curve: its values} of a chart whose curves have different names."""
    return {line.name: line.values for chart in charts if chart.name == name for line in chart.lines}


# Numbers


def test_numbers_of_the_page_are_those_of_the_trajectory(run: rbd.Trajectory, page: Path) -> None:
    """Every curve at every sample, exactly in single precision: forces, torques, energies, residuals."""
    given = told(page)["charts"]
    charts = {chart["name"]: {x["name"]: numbers(x["values"]) for x in chart["lines"]} for chart in given["charts"]}
    assert np.array_equal(numbers(given["times"][0]), run.t.astype("<f4"))
    assert list(charts) == ["forces", "torques", "energy", "residuals"]  # its feet are points: no centre of pressure
    for name in run.contacts:
        force = run.forces[name]
        assert np.array_equal(charts["forces"][f"{name} vertical"], force[:, 2].astype("<f4"))
    energy = charts["energy"]
    assert np.array_equal(energy["kinetic"], run.kinetic.astype("<f4"))
    assert np.array_equal(energy["potential"], (run.potential - run.potential[0]).astype("<f4"))
    assert np.array_equal(energy["work of the motors"], (run.motor_work - run.motor_work[0]).astype("<f4"))
    assert np.array_equal(energy["total"], (run.kinetic + (run.potential - run.potential[0])).astype("<f4"))
    assert np.array_equal(charts["residuals"]["law, scaled"], run.residuals["law"].astype("<f4"))
    share = 100.0 * np.abs(run.tau) / run.robot.effort_limit
    names = [name.removesuffix("_joint") for name in run.robot.actuated_names]
    rest = charts["torques"].pop("largest of the others")
    assert len(charts["torques"]) == 4
    for name, values in charts["torques"].items():
        assert np.array_equal(values, share[:, names.index(name)].astype("<f4"))
        assert values.max() >= rest.max()
    others = [j for j, name in enumerate(names) if name not in charts["torques"]]
    assert np.array_equal(rest, share[:, others].max(axis=1).astype("<f4"))


def test_each_contact_has_its_normal_force_and_the_size_of_its_force(slide: rbd.Trajectory) -> None:
    """On a slope: m g cos, and with friction m g cos sqrt(1 + mu^2), in closed form."""
    chart = charts_of(slide, ["forces"])[0]
    normal, size = chart.lines
    assert [line.name for line in chart.lines] == ["face normal", "|f|"]
    across = 10.0 * 9.81 * np.cos(SLOPE)
    assert np.abs(normal.values[1:] - across).max() < 1e-6
    assert np.abs(size.values[1:] - across * np.hypot(1.0, 0.5)).max() < 1e-6
    assert chart.limits["weight"] == pytest.approx(98.1)


def test_a_motion_tells_surfaces_that_it_does_not_draw(slide: rbd.Trajectory, run: rbd.Trajectory) -> None:
    """A box on a slope that a file of an earlier version does not know touches it off z = 0; feet on the floor do not."""
    unknown = rbd.Trajectory(**vars(slide) | {"planes": {}})
    assert frames_of(shown_motion(unknown), [1]).left_out == ("Surfaces off the ground z = 0 are not drawn; there: face.",)
    assert not frames_of(shown_motion(slide), [1]).left_out
    assert not frames_of(shown_motion(run), [1]).left_out


def test_the_centre_of_pressure_is_as_far_from_the_edge_as_the_wrench_says(slide: rbd.Trajectory) -> None:
    """Friction at the bottom moves it forward by mu times the height of the centre of mass: 0.2 - 0.05 m of 0.2 remain."""
    values = named(charts_of(slide, ["centre of pressure"]), "centre of pressure")["face"]
    assert np.abs(values[1:] - 150.0).max() < 1e-4


def test_any_load_on_any_sole() -> None:
    """Against the distance inside the polygon, for random soles of five points, turned, loaded at random."""
    draw = np.random.default_rng(3)
    for _ in range(20):
        flat, load = draw.normal(size=(5, 2)), draw.uniform(0.1, 1.0, 5)
        R, p = pin.exp3(draw.normal(size=3)), draw.normal(size=3)
        points = (p + np.column_stack([flat, np.zeros(5)]) @ R.T)[None]
        forces = (load[:, None] * R[:, 2])[None]
        expected = inside_distance(load @ flat / load.sum(), convex_hull(flat))
        found, normal = edge_distances(points, forces), normals_of(points, forces)
        assert found is not None
        assert normal is not None
        assert found[0] == pytest.approx(expected, abs=1e-12)
        assert np.abs(normal[0] - R[:, 2]).max() < 1e-12
        assert carries_weight(points, forces) == bool(R[2, 2] > np.cos(np.pi / 4))


def test_a_sole_that_tips_keeps_the_normal_of_its_ground() -> None:
    """From the moment at which it stands on two corners only, its own plane is not the ground's."""
    corners = np.array([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]])
    tipped = corners @ pin.exp3(np.array([0.0, 0.3, 0.0])).T
    up = np.tile([0.0, 0.0, 5.0], (4, 1))
    two = up * np.array([1.0, 0.0, 0.0, 1.0])[:, None]
    normal = normals_of(np.array([tipped, corners, tipped]), np.array([two, up, two]))
    assert normal is not None
    assert np.abs(normal - [0.0, 0.0, 1.0]).max() < 1e-12
    assert normals_of(np.array([tipped]), np.array([two])) is None
    assert edge_distances(np.array([corners, corners]), np.array([up, 0.0 * up]))[1:] == pytest.approx([np.nan], nan_ok=True)  # type: ignore[index]


def test_points_that_are_in_no_plane_have_no_normal() -> None:
    """As those of a body's collision shapes that touch here and there: the chart then says vertical."""
    corners = np.random.default_rng(1).normal(size=(1, 6, 3))
    up = np.tile([0.0, 0.0, 5.0], (1, 6, 1))
    assert normals_of(corners, up) is None
    assert edge_distances(corners, up) is None
    assert carries_weight(corners, up)
    box = np.array([[[x, y, z] for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (0.0, 0.2)]])
    below = np.where(box[..., 2:] == 0.0, up[0, 0], 0.0)
    normal = normals_of(box, below)
    assert normal is not None
    assert normal[0] == pytest.approx([0.0, 0.0, 1.0])
    assert edge_distances(box, below) is None  # a body, no sole


def test_of_a_motion_without_forces_there_are_positions_speeds_and_height(solo: rbd.Robot) -> None:
    """In % of the limits that the robot's file states."""
    low = solo.standing().q
    high = low + 0.1 * np.eye(solo.nq)[2]
    high[7] += 0.2
    rises = rbd.motion.minimum_jerk(solo, [low, high], [0.0, 0.2], rate=50.0)
    charts = charts_of(rises, True)
    assert [chart.name for chart in charts] == ["angles", "speeds", "height"]
    joint = solo.joints[solo.actuated_names[0]]
    speeds = named(charts, "speeds")
    assert np.allclose(speeds[joint.name.removesuffix("_joint")], 100.0 * np.abs(rises.v[:, joint.v.start]) / joint.speed)
    half = 0.5 * (joint.upper - joint.lower)
    angles = named(charts_of(rises, ["angles"]), "angles")
    expected = 100.0 * np.abs(rises.q[:, joint.q.start] - 0.5 * (joint.lower + joint.upper)) / half
    assert (
        any(np.allclose(values, expected) for values in angles.values())
        or expected.max() <= angles["largest of the others"].max()
    )
    height = named(charts, "height")["height"]
    assert height == pytest.approx([rises.state(i).com[2] for i in range(rises.n)], abs=1e-12)


def test_a_chart_that_there_are_no_numbers_for_is_refused(run: rbd.Trajectory, tmp_path: Path) -> None:
    """By name, and nothing is written."""
    for choice, words in (
        (["forcs"], "nearest: 'forces'"),
        (["centre of pressure"], "no numbers for the chart"),
        ("forces", "a list of names"),
        (3, "a list of names"),
    ):
        with pytest.raises(InputError, match=words):
            export_motion(run, tmp_path / "x.html", charts=choice)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
    assert charts_of(run, False) == []
    assert [c.name for c in charts_of(run, ["height", "forces", "height"])] == ["height", "forces"]
    assert set(CHARTS) == {"forces", "torques", "centre of pressure", "energy", "residuals", "angles", "speeds", "height"}


def test_long_motions_keep_their_peaks() -> None:
    """Of 100,000 samples 6,000, among them the impact of a single one; where a curve begins and ends too."""
    wave = np.sin(np.linspace(0.0, 20.0, 100_000))
    hit, gap = wave.copy(), wave.copy()
    hit[33_333] = 50.0
    gap[40_000:40_010] = np.nan
    kept = kept_samples(len(wave), [wave, hit, gap])
    assert len(kept) == MOST_POINTS
    assert (np.diff(kept) > 0).all()
    assert {0, 33_333, 40_005, 99_999} <= set(kept.tolist())
    assert np.array_equal(kept_samples(MOST_POINTS, [wave]), np.arange(MOST_POINTS))


def test_a_peak_that_would_hide_all_else_is_cut_off() -> None:
    """An axis ends at four times the usual; of nothing at all at 1."""
    values = np.ones(1000)
    values[7] = 1e6
    assert top_of(values, 0.0, 98.0) == pytest.approx(4.32)
    assert top_of(values[:7], 0.0, 98.0) == pytest.approx(1.08)
    assert top_of(np.full(3, np.nan), 0.0, 98.0) == 1.0


def test_curves_of_a_long_motion_take_little_room(run: rbd.Trajectory, tmp_path: Path) -> None:
    """Ten minutes: at most 6,000 numbers a curve."""
    n = 60_000
    again = np.arange(n) % len(run)
    fields = {k: v[again] if isinstance(v, np.ndarray) else v for k, v in vars(run).items()}
    columns = {k: v for k, v in fields.items() if isinstance(v, dict) and k not in ("friction", "planes")}
    fields |= {k: {a: b[again] for a, b in v.items()} for k, v in columns.items()}
    long = rbd.Trajectory(**{**fields, "t": np.arange(n) * 0.01, "events": ()})
    given = told(export_motion(long, tmp_path / "x.html", fps=1.0))["charts"]
    assert {len(numbers(x["values"])) for chart in given["charts"] for x in chart["lines"]} == {MOST_POINTS}


# In a browser

BOX = "((b) => [b.left, b.top, b.right, b.bottom])(stage.player.curves.%s.getBoundingClientRect())"


@pytest.fixture(scope="module")
def opened(browser: Browser, page: Path) -> Iterator[BrowserPage]:
    """The page of these tests, which need no picture: it draws once, in a small window, and then no more."""
    with browser.open(page, width=320, height=240) as shown:
        shown.evaluate("void (stage.viewer.renderer.render = () => {})")
        yield shown


def at_size(shown: BrowserPage, width: int, height: int) -> BrowserPage:
    """The page in a window of this size, with its charts as they are at first."""
    shown.resize(width, height)
    shown.wait(f"window.innerWidth === {width}")
    shown.evaluate("stage.player.curves.chosen = stage.touched = false; stage.fit(); stage.toolbar.refresh()")
    fits = "({ plot, node }) => node.hidden || !node.clientWidth || plot.width === plot.root.parentElement.clientWidth"
    shown.wait(f"stage.player.curves.charts.every({fits})", seconds=20.0)  # charts follow their boxes a frame later
    return shown


def cursor(shown: BrowserPage, chart: int) -> float:
    """Where the cursor of a chart is on the screen [pixels]."""
    found: float = shown.evaluate(f"stage.player.curves.charts[{chart}].now.getBoundingClientRect().x")
    return found


def place(shown: BrowserPage, chart: int, share: float) -> tuple[float, float]:
    """Where a share of the time axis of a chart is on the screen [pixels]."""
    x, y, width, height = shown.evaluate(
        f"((b) => [b.x, b.y, b.width, b.height])(stage.player.curves.charts[{chart}].plot.over.getBoundingClientRect())"
    )
    return x + share * width, y + 0.4 * height


def test_the_cursor_is_at_the_present_time(opened: BrowserPage, run: rbd.Trajectory) -> None:
    """Within a pixel: after a seek, and after a click on a curve, which goes to the time there."""
    shown = at_size(opened, 1200, 800)
    shown.evaluate("stage.player.go(0.12)")
    for chart in range(4):
        assert cursor(shown, chart) == pytest.approx(place(shown, chart, 0.4)[0], abs=1.0)
    shown.evaluate("stage.player.seek(0.21)")
    assert cursor(shown, 2) == pytest.approx(place(shown, 2, 0.7)[0], abs=1.0)
    shown.click(*place(shown, 0, 0.25))
    assert shown.evaluate("stage.player.t") == pytest.approx(0.25 * run.t[-1], abs=run.t[-1] / 268.0)
    assert cursor(shown, 0) == pytest.approx(place(shown, 0, 0.25)[0], abs=1.0)
    assert float(shown.evaluate("stage.player.knob.style.left").removesuffix("%")) == pytest.approx(25.0, abs=0.5)


def test_values_at_the_cursor_are_those_of_the_trajectory(opened: BrowserPage, run: rbd.Trajectory) -> None:
    """Three digits of each curve's number: at a sample, and between two as the line is drawn."""
    shown = at_size(opened, 1200, 800)
    for t in (0.0, 0.1, 0.1017, 0.2):
        shown.evaluate(f"stage.player.seek({t})")
        text = shown.evaluate("stage.player.curves.charts.map((c) => c.shown.map((x) => x.key.textContent))")
        name = run.contacts[0]
        force = [np.interp(t, run.t, column) for column in run.forces[name].T]
        size = np.interp(t, run.t, np.linalg.norm(run.forces[name], axis=1))
        assert text[0][0] == f"{name} vertical {float(f'{force[2]:.3g}'):g}"
        assert text[0][1] == f"|f| {float(f'{size:.3g}'):g}"
        law = np.interp(t, run.t, run.residuals["law"])
        assert text[3][0].startswith("law, scaled ")
        assert float(text[3][0].removeprefix("law, scaled ")) == pytest.approx(law, rel=0.06)


def test_axes_show_signs(opened: BrowserPage) -> None:
    """Numbers below zero have a minus sign, and the axis has room for all of it: the longest number ends inside the picture."""
    shown = at_size(opened, 1200, 800)
    axes = shown.evaluate(
        """stage.player.curves.charts.map(({ plot }) => {
          const { _values: words, _size: size } = plot.axes[1];
          plot.ctx.font = AXIS_FONT;
          return [words, size, Math.max(...words.map((word) => plot.ctx.measureText(word).width))];
        })"""
    )
    assert all(size >= width + 6.0 for _, size, width in axes)  # 3 for the tick, 3 between
    energy = [float(word) for word in axes[2][0]]
    assert min(energy) < 0.0 < max(energy)  # the motors take energy out
    assert shown.evaluate("[-0.527, -5e-4, 0, 12500, -2.5e6].map(onAxis)") == ["-0.527", "-5e-4", "0", "12500", "-2.5e6"]


def test_residuals_have_a_logarithmic_axis(opened: BrowserPage, run: rbd.Trajectory) -> None:
    """A decade is as high everywhere; ticks are powers of ten; what is below the foot is drawn at it, never left out."""
    shown = at_size(opened, 1200, 800)
    words = shown.evaluate("stage.player.curves.charts[3].plot.axes[1]._values")
    assert len(words) > 2
    assert all(re.fullmatch(r"1e-\d+", word) for word in words)
    heights = shown.evaluate("[1e-6, 1e-8, 1e-10].map((x) => stage.player.curves.charts[3].plot.valToPos(x, 'y'))")
    assert heights[1] - heights[0] == pytest.approx(heights[2] - heights[1])
    assert heights[0] < heights[1]
    drawn = shown.evaluate("stage.player.curves.charts[3].plot.data.slice(1).map((line) => Math.min(...line))")
    assert min(drawn) >= 1e-16
    assert shown.evaluate("[powers(2e-7, 8e-6), powers(1e-3, 1e3), powers(1e-16, 1)]") == [
        [2e-7, 5e-7, 1e-6, 2e-6, 5e-6], [1e-3, 1e-1, 1e1, 1e3], [1e-16, 1e-12, 1e-8, 1e-4, 1.0],
    ]  # fmt: skip


def test_dragging_enlarges_and_the_pointer_reads(opened: BrowserPage, run: rbd.Trajectory) -> None:
    """All charts show what is between; values under the pointer are the trajectory's there; the present time stays."""
    shown = at_size(opened, 1200, 800)
    shown.evaluate("stage.player.go(0.1)")
    shown.mouse("mousePressed", *place(shown, 0, 0.4), button="left")
    shown.mouse("mouseMoved", *place(shown, 0, 0.8), button="left")
    shown.mouse("mouseReleased", *place(shown, 0, 0.8), button="left")
    pixel = run.t[-1] / 250.0
    for chart in range(4):
        x = shown.evaluate(f"((x) => [x.min, x.max])(stage.player.curves.charts[{chart}].plot.scales.x)")
        assert x == pytest.approx([0.4 * run.t[-1], 0.8 * run.t[-1]], abs=pixel)
    low, top = shown.evaluate("((y) => [y.min, y.max])(stage.player.curves.charts[0].plot.scales.y)")
    force = np.array([run.forces[name][(run.t > x[0]) & (run.t < x[1])] for name in run.contacts])
    assert low < force[..., 2].min() < np.linalg.norm(force, axis=-1).max() < top < 1.3 * force[..., 2].max()  # axes fit it
    assert shown.evaluate("stage.player.t") == 0.1
    assert shown.evaluate("stage.player.curves.charts[0].now.hidden") is True  # 0.1 s is not shown
    shown.mouse("mouseMoved", *place(shown, 0, 0.5))
    t = shown.evaluate("stage.player.curves.pointed")
    assert t == pytest.approx(0.5 * (x[0] + x[1]), abs=pixel)
    assert shown.evaluate("stage.player.curves.moment.textContent").startswith("at 0.1")
    text = shown.evaluate("stage.player.curves.charts[0].shown[0].key.textContent")
    name = run.contacts[0]
    assert text == f"{name} vertical {float(f'{np.interp(t, run.t, run.forces[name][:, 2]):.3g}'):g}"
    shown.evaluate("stage.player.curves.whole.click()")
    assert shown.evaluate("stage.player.curves.charts[1].plot.scales.x.max") == pytest.approx(run.t[-1])
    assert shown.evaluate("stage.player.curves.whole.hidden") is True


def test_fingers_enlarge_curves(opened: BrowserPage, run: rbd.Trajectory) -> None:
    """One that drags across as the mouse does; two keep the times under them, in all charts; a tap goes to its time."""
    shown, end = at_size(opened, 1200, 800), run.t[-1]
    plot = "stage.player.curves.charts[{}].plot"

    def shows(first: float, last: float, chart: int = 0) -> None:
        """The chart shows these shares of the whole time, to a pixel and a half; fingers are told of at the next frame."""
        off = f"Math.abs({{}}.scales.x.min - {first * end}) + Math.abs({{}}.scales.x.max - {last * end})"
        shown.wait(f"{off.replace('{}', plot.format(chart))} < {1.5 * end / 250.0}", seconds=20.0)

    def fingers(kind: str, chart: int, *shares: float) -> None:
        shown.touch(kind, *[place(shown, chart, share) for share in shares])

    shows(0.0, 1.0)
    fingers("touchStart", 0, 0.2)
    for share in (0.3, 0.6):
        fingers("touchMove", 0, share)
    over, marked = plot.format(0) + ".over.clientWidth", plot.format(0) + ".select.width"
    shown.wait(f"Math.abs({marked} / {over} - 0.4) < 0.01")
    shows(0.0, 1.0)
    shown.touch("touchEnd")
    for chart in range(4):
        shows(0.2, 0.6, chart)
    assert shown.evaluate(marked) == 0.0
    # Two fingers 0.4 of the width apart go to 0.8 of it: half of the time is left, about what is between them.
    fingers("touchStart", 1, 0.3, 0.7)
    fingers("touchMove", 1, 0.1, 0.9)
    shows(0.3, 0.5, 2)
    fingers("touchMove", 1, 0.2, 1.0)  # shifted together
    shows(0.28, 0.48, 2)
    fingers("touchMove", 1, 0.45, 0.55)  # closed
    shows(0.0, 1.0, 2)
    shown.touch("touchEnd")
    fingers("touchStart", 0, 0.5)
    shown.touch("touchEnd")
    shown.wait(f"Math.abs(stage.player.t - {0.5 * end}) < {end / 250.0}")
    shows(0.0, 1.0)


def test_the_panel_folds_and_charts_are_chosen(opened: BrowserPage) -> None:
    """By its button, by c, and by a button for each chart; the robot then has the room."""
    hidden = "stage.player.curves.charts.map((c) => c.node.offsetHeight === 0)"
    target = "stage.viewer.camera.view.offsetX"
    shown = at_size(opened, 1200, 800)
    assert shown.evaluate(hidden) == [False] * 4
    wide = shown.evaluate(target)
    shown.key("c")
    assert shown.evaluate(hidden) == [True] * 4
    assert shown.evaluate(target) < wide
    assert shown.evaluate("stage.player.curves.folder.getAttribute('aria-expanded')") == "false"
    x, y = shown.evaluate(
        "(() => { const b = stage.player.curves.folder.getBoundingClientRect(); return [b.x + 5, b.y + 5]; })()"
    )
    shown.click(x, y)
    assert shown.evaluate(hidden) == [False] * 4
    shown.evaluate("stage.player.curves.charts[2].button.click()")
    assert shown.evaluate(hidden) == [False, False, True, False]
    assert shown.evaluate("stage.player.curves.charts[2].button.getAttribute('aria-pressed')") == "false"


def test_in_a_narrow_window_charts_are_below(opened: BrowserPage) -> None:
    """Across the window, above the bar, with as many charts as fit in a row; folded at first in a small frame."""
    hidden = "stage.player.curves.charts.map((c) => c.node.offsetHeight === 0)"
    shown = at_size(opened, 1200, 800)
    left, top, right, _ = shown.evaluate(BOX % "panel")
    assert (left, top, right) == pytest.approx((826.0, 14.0, 1186.0), abs=4.0)
    for width, expected in ((900, [False, False, False, True]), (420, [False, True, True, True])):
        shown.resize(width, 700)
        shown.wait("stage.player.curves.below && stage.viewer.camera.view.fullWidth === window.innerWidth")
        if width == 420:
            assert shown.evaluate(hidden) == [True] * 4
            shown.key("c")
        left, top, right, bottom = shown.evaluate(BOX % "panel")
        assert (left, right) == pytest.approx((14.0, width - 14.0), abs=1.0)
        assert 250.0 < top < bottom < shown.evaluate("stage.player.footer.getBoundingClientRect().top")
        assert shown.evaluate(hidden) == expected
    apart, inside = shown.evaluate(
        """(() => {
          const legend = document.getElementById("legend"), fold = legend.querySelector("h1 button");
          if (legend.dataset.fold === "folded") fold.click();
          const it = legend.getBoundingClientRect(), buttons = document.querySelector(".toolbar .row").getBoundingClientRect();
          return [it.top - buttons.bottom, it.right <= window.innerWidth && legend.scrollWidth <= legend.clientWidth];
        })()"""
    )
    assert apart > 0.0
    assert inside is True
    at_size(shown, 420, 320)
    assert shown.evaluate("stage.player.curves.folded")
    shown.evaluate("void (stage.touched = true)")  # the camera stays, the panel moves
    shown.resize(1200, 800)
    shown.wait("!stage.player.curves.panel.classList.contains('below')")


def test_a_page_without_charts_holds_none(run: rbd.Trajectory, tmp_path: Path) -> None:
    """charts=False: no numbers for them are in the page."""
    assert told(export_motion(run, tmp_path / "x.html", charts=False))["charts"] is None


def test_the_support_polygon_goes_along(opened: BrowserPage, run: rbd.Trajectory) -> None:
    """Its corners are the hull of the points that carry load at the time; its layer shows and hides it."""
    shown = at_size(opened, 600, 500)
    for t in (0.0, 0.1, 0.3):
        shown.evaluate(f"stage.player.seek({t})")
        i = int(np.abs(run.t - t).argmin())
        points = np.array([run.points[name][i, 0] for name in run.contacts if np.linalg.norm(run.forces[name][i]) > 1e-2])
        outline = np.array(shown.evaluate("stage.player.cast.support.outline"))
        assert len(outline) == len(convex_hull(points[:, :2]))
        for corner in convex_hull(points[:, :2]):
            assert np.abs(outline[:, :2] - corner).max(axis=1).min() < 1e-6
    seen = "stage.player.cast.layers.get('support polygon').visible"
    shown.evaluate("stage.layers.show('support polygon', false)")
    assert shown.evaluate(seen) is False
    shown.evaluate("stage.player.seek(0.2)")
    assert shown.evaluate(seen) is False


def test_what_moves_is_in_layers(browser: Browser, slide: rbd.Trajectory, tmp_path: Path) -> None:
    """Arrows of forces, those of corners, the centre of mass: each is hidden with its layer, and stays hidden as it moves."""
    with browser.open(export_motion(slide, tmp_path / "x.html"), width=300, height=200) as shown:
        names = shown.evaluate("[...stage.player.cast.layers.keys()]")
        assert {"forces", "corner forces", "centre of mass", "support polygon"} <= set(names)
        shown.evaluate("stage.layers.show('corner forces', false)")
        shown.evaluate("stage.player.seek(0.2)")
        drawn = "((n) => { while (n && n.visible) n = n.parent; return !n; })(stage.player.cast.tracks[0].%s.node)"
        assert shown.evaluate(drawn % "big") is True
        assert shown.evaluate(drawn % "thin[0]") is False


def test_a_picture_at_rest_takes_bar_and_curves_away(browser: Browser, page: Path) -> None:
    """As a live page gets it after a motion; the keys of the motion are then without effect."""
    with browser.open(page, width=300, height=200) as shown:
        shown.evaluate("stage.note({ motion: null })")
        assert shown.evaluate("document.querySelectorAll('.player, .curves').length") == 0
        shown.key(" ")
        assert shown.evaluate("stage.player") is None


def test_slices_of_a_trajectory_have_charts(slide: rbd.Trajectory) -> None:
    """Two samples are enough; a trajectory without residuals worth a line shows the law's only."""
    charts = charts_of(slide[3:5], True)
    assert [len(chart.lines[0].values) for chart in charts] == [2] * len(charts)
    still = replace(slide, residuals={name: np.zeros(len(slide)) for name in slide.residuals})
    assert list(named(charts_of(still, ["residuals"]), "residuals")) == ["law, scaled"]


def test_forces_of_loops_and_locks_are_curves() -> None:
    """|f| of a loop, the torque of a lock as it is; the largest first."""
    bars = rbd.load_robot("four_bar")
    given = [rbd.JointLock("brake", "crank_joint")]
    held = rbd.simulate(bars.at("assembled"), given, duration=0.02, step=1e-2, progress=False)
    chart = charts_of(held, ["forces"])[0]
    assert chart.title == "forces of constraints, N or N m"
    values = named([chart], "forces")
    assert np.array_equal(values["|f| coupler_pin"], np.linalg.norm(held.forces["coupler_pin"][:, :3], axis=1))
    assert np.array_equal(values["brake"], held.forces["brake"][:, 0])
    size = [np.abs(line.values).max() for line in chart.lines]
    assert size == sorted(size, reverse=True)


def test_torques_of_motors_without_limits_are_in_newton_metres() -> None:
    """And nothing is drawn where none pulls."""
    builder = rbd.RobotBuilder("arm", root="fixed")
    for name, parent in (("upper", "ground"), ("lower", "upper")):
        builder.body(name, rbd.robots.Rod((0, 0, 0), (1, 0, 0), mass=1.0))
        builder.joint(f"to_{name}", parent, name, at=(1, 0, 0), axis=(0, 1, 0), motor=True)
    arm = builder.robot()
    start, pulls = arm.at([0.1, 0.2]), lambda state, t: np.array([3.0, -7.0])
    moved = rbd.simulate(start, duration=0.02, step=1e-2, controller=pulls, progress=False)
    chart = charts_of(moved, ["torques"])[0]
    assert chart.title == "motor torques, N m (no limits are known)"
    assert [float(line.values[1]) for line in chart.lines] == [7.0, 3.0]
    limp = rbd.simulate(start, duration=0.02, step=1e-2, progress=False)
    assert "torques" not in [chart.name for chart in charts_of(limp, True)]
