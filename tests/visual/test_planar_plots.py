"""Plots of planar motions: what is drawn is what was computed; and the page in Meshcat."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from rbd.errors import InputError
from rbd.planar import Chain, endpoint_motion, joint_motion, minimum_jerk
from rbd.visual.figures.planar_figures import plot_ellipses, plot_sticks
from rbd.visual.figures.planar_plots import plot_panels, plot_paths, plot_split
from rbd.visual.playback.animation import export_motion, replay, shown_motion

TWO = Chain(2, lengths=(0.5, 0.5))


@pytest.fixture(scope="module")
def text():
    return endpoint_motion(TWO, minimum_jerk([1.0, 0.0], [0.5, 0.5], 1.0))


@pytest.fixture(scope="module")
def one():
    return joint_motion(Chain(1, lengths=[1.0]), minimum_jerk(0.0, np.pi / 2, 1.0))


@pytest.fixture(scope="module")
def four():
    return endpoint_motion(Chain(4, lengths=[0.25] * 4, angles="segment"), minimum_jerk([0.7, -0.3], [0.1, 0.6], 1.0))


def axes(*shape: int):
    return Figure(layout="constrained").subplots(*shape)


def lines(artists):
    return [a for a in artists if isinstance(a, Line2D)]


@pytest.mark.parametrize("name", ["text", "one", "four"])
def test_panels_show_both_spaces(name: str, request):
    """Two rows of four: the planned space first; angles in degrees; a unit in every title."""
    motion = request.getfixturevalue(name)
    grid = axes(2, 4)
    drawn = lines(plot_panels(grid, motion))
    n = motion.chain.n
    assert len(drawn) == 4 * (2 + n)
    first = motion.x if motion.space == "endpoint" else np.degrees(motion.q)
    np.testing.assert_array_equal(drawn[0].get_ydata(), first[:, 0])
    titles = [ax.get_title(loc="left") for ax in grid.flat]
    place, angle = (
        titles[:4] if motion.space == "endpoint" else titles[4:],
        titles[4:] if motion.space == "endpoint" else titles[:4],
    )
    assert place == ["position [m]", "velocity [m/s]", "acceleration [m/s²]", "jerk [m/s³]"]
    assert angle == ["angle [°]", "velocity [°/s]", "acceleration [°/s²]", "jerk [°/s³]"]
    last = drawn[4 * 2 + 3 * n : 4 * 2 + 4 * n] if motion.space == "endpoint" else drawn[3 * n : 4 * n]
    np.testing.assert_allclose([line.get_ydata() for line in last], np.degrees(motion.qddd).T)


def test_a_curve_that_shoots_up_is_cut_off_and_told(text, one):
    """Beside the singular beginning the jerk of the joints is 141,000 degrees/s^3; the axis stays readable, the panel tells."""
    grid = axes(2, 4)
    notes = [a for a in plot_panels(grid, text) if not isinstance(a, Line2D)]
    told = [note.get_text() for note in notes]
    assert any("cut off" in t and "141,000 °/s³" in t and "0.01 s" in t for t in told)
    assert grid[1, 3].get_ylim()[1] < 20_000.0
    assert not [a for a in plot_panels(axes(2, 4), one) if not isinstance(a, Line2D)]


@pytest.mark.parametrize("name", ["text", "one", "four"])
def test_split_stands_before_the_whole(name: str, request):
    """In each panel the whole is pale and thick, the part thin; the parts drawn add up to the whole drawn."""
    motion = request.getfixturevalue(name)
    drawn = lines(plot_split(axes(1, 3), motion))
    assert len(drawn) == 12
    whole, part = drawn[0], drawn[2]
    assert whole.get_linewidth() > part.get_linewidth() and whole.get_alpha() < 0.5 and whole.get_color() == part.get_color()
    for k in range(2):
        total = sum(drawn[4 * panel + 2 + k].get_ydata() for panel in range(3))
        np.testing.assert_allclose(total, motion.a[:, k], atol=1e-11)
        np.testing.assert_array_equal(drawn[k].get_ydata(), motion.a[:, k])


@pytest.mark.parametrize("name", ["text", "one", "four"])
def test_paths_in_both_spaces(name: str, request):
    """The end point in the plane in one scale; angles in degrees over the first one, of one link over time."""
    motion = request.getfixturevalue(name)
    plane, joints = axes(1, 2)
    drawn = plot_paths((plane, joints), motion)
    assert len(drawn) == 4 * (1 + max(1, motion.chain.n - 1)) and plane.get_aspect() == 1.0
    np.testing.assert_array_equal(drawn[0].get_xydata(), motion.x)
    across, up = (
        (np.degrees(motion.q[:, 0]), np.degrees(motion.q[:, 1]))
        if motion.chain.n > 1
        else (motion.t, np.degrees(motion.q[:, 0]))
    )
    np.testing.assert_array_equal(drawn[4].get_xydata(), np.stack([across, up], axis=1))


@pytest.mark.parametrize("name", ["text", "one", "four"])
def test_sticks_darken_with_time(name: str, request):
    """Nine poses from the first to the last sample, each darker; every stick ends on the path."""
    motion = request.getfixturevalue(name)
    ax = axes()
    drawn = plot_sticks(ax, motion.chain, motion.q)
    path, sticks = drawn[0], drawn[1:10]
    np.testing.assert_allclose(path.get_xydata(), motion.x, atol=1e-13)
    np.testing.assert_allclose(sticks[0].get_xydata()[-1], motion.x[0], atol=1e-13)
    np.testing.assert_allclose(sticks[-1].get_xydata(), motion.chain.numeric.positions(motion.q[-1]))
    shades = [sum(s.get_color()) for s in sticks]
    assert shades == sorted(shades, reverse=True) and shades[0] > 2.0 > shades[-1] and ax.get_aspect() == 1.0
    assert len(plot_sticks(axes(), motion.chain, motion.q[0])) > 3  # one pose will do


@pytest.mark.parametrize("kind", ["manipulability", "velocity", "force"])
def test_ellipses_have_one_scale(kind: str, text, one):
    """The outline's area is pi times the manipulability times the scale squared (velocity), or its inverse (force)."""
    q = text.q[[40, 70, -1]]
    ax = axes()
    outlines = [a for a in plot_ellipses(ax, TWO, q, kind=kind, count=3) if isinstance(a, Polygon)][:3]
    areas = []
    for outline in outlines:
        x, y = outline.get_xy().T
        areas.append(0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])))
    w = text.manipulability[[40, 70, -1]]
    expected = 1.0 / w if kind == "force" else w
    np.testing.assert_allclose(np.array(areas) / areas[0], expected / expected[0], rtol=1e-9)
    assert {"force": "N at 1 N m"}.get(kind, "m/s at 1 rad/s") in ax.get_title(loc="left")
    if kind == "manipulability":
        assert [t.get_text() for t in ax.texts] == [f"{x:.2f}" for x in w]
    plot_ellipses(axes(), one.chain, one.q, kind=kind)  # one link: flat ones
    plot_ellipses(axes(), TWO, [0.3, 0.0], kind=kind)  # and a singular pose


def test_the_page_plays_the_same_motion(text, tmp_path):
    """The chain upright, its path behind it, no mass and so no centre of mass."""
    motion = shown_motion(text)
    assert motion.robot.mass == 0.0 and list(motion.robot.model.names)[1:] == ["joint_1", "joint_2"]
    np.testing.assert_array_equal(motion.q, text.q)
    data = motion.robot.model.createData()
    from pinocchio import framesForwardKinematics

    for i in (0, 50, 99):
        framesForwardKinematics(motion.robot.model, data, motion.q[i])
        end = data.oMf[motion.robot.model.getFrameId("end")].translation
        np.testing.assert_allclose(end, [text.x[i, 0], 0.0, text.x[i, 1]], atol=1e-12)
    page = export_motion(text, tmp_path / "plane.html").read_text()
    assert "2 links, minimum jerk" in page and "centre of mass" not in page.split("<script")[0]


def test_what_is_no_motion_or_no_axes_is_refused(text):
    """Errors that say what was expected."""
    for ask in (
        lambda: plot_panels(axes(2, 3), text),
        lambda: plot_panels(axes(2, 4), None),
        lambda: plot_split(axes(), text),
        lambda: plot_split([1, 2, 3], text),
        lambda: plot_paths(axes(1, 2), "motion"),
        lambda: plot_sticks(None, TWO, text.q),
        lambda: plot_sticks(axes(), "chain", text.q),
        lambda: plot_sticks(axes(), TWO, [[0.0]]),
        lambda: plot_sticks(axes(), TWO, np.zeros((0, 2))),
        lambda: plot_sticks(axes(), Chain(2), text.q),
        lambda: plot_sticks(axes(), TWO, text.q, count=0),
        lambda: plot_ellipses(axes(), TWO, text.q, kind="speed"),
        lambda: plot_ellipses(axes(), TWO, [np.nan, 0.0]),
        lambda: export_motion(None, "x.html"),
        lambda: replay(endpoint_motion(TWO, text.path, times=[0.5])),
    ):
        with pytest.raises(InputError):
            ask()


def test_a_motion_of_one_moment_and_one_that_rests_are_drawn(text):
    """An axis of no length is Matplotlib's own; a curve that is level is not cut off."""
    rest = joint_motion(TWO, minimum_jerk([0.3, 0.4], [0.3, 0.4], 1.0))
    for motion in (endpoint_motion(TWO, text.path, times=[0.5]), rest):
        panels = axes(2, 4)
        plot_panels(panels, motion)
        assert not any("cut off" in each.get_text() for ax in panels.flat for each in ax.texts)
    assert all(np.ptp(line.get_ydata()) < 1e-12 for ax in panels.flat for line in ax.lines)
