"""Regions, largest pushes and wrench cones, plotted and in the scene: where things stand, in which colour."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import rbd
from rbd.statics import push_limits, support_region, wrench_cone, zmp_region
from rbd.visual import Scene, plot_region
from rbd.visual.style import LIMIT_COLORS, LIMITED_COLOR, SUPPORT_COLOR, WRENCH_COLOR, ZMP_COLOR

AROUND = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])


@pytest.fixture(scope="module")
def standing(talos: rbd.Robot):
    state, soles = talos.standing(), talos.soles(0.7)
    return state, soles, support_region(state, soles)


def edge_of(lines, corners) -> bool:
    return any(
        line.get_xydata().shape == (len(corners) + 1, 2) and np.allclose(line.get_xydata()[:-1], corners) for line in lines
    )


def test_a_region_is_drawn_at_its_corners_with_the_centre_of_mass(standing):
    """The edge goes through the corners; both regions are in view, and named."""
    state, soles, region = standing
    ax = Figure().subplots()
    limited = support_region(state, soles, torque_limits=True)
    plot_region(ax, region, limited, zmp_region(state, soles), labels=["a", "b", "c"])
    assert edge_of(ax.lines, region.vertices)
    colors = [to_hex(line.get_color()) for line in ax.lines if line.get_label() in "abc"]
    assert colors == [SUPPORT_COLOR, LIMITED_COLOR, ZMP_COLOR]
    named = {text.get_text() for text in ax.get_legend().get_texts()}
    assert named == {"a", "b", "c", "left_sole", "right_sole", "centre of mass"}
    dot = next(line for line in ax.lines if line.get_label() == "centre of mass")
    assert np.allclose(dot.get_xydata(), state.com[None, :2])
    low, high = np.transpose([ax.get_xlim(), ax.get_ylim()])
    assert (region.vertices > low).all() and (region.vertices < high).all()


def test_what_is_empty_or_without_end_says_so(talos, standing):
    """In the legend; and the frame stays around the contacts."""
    state, soles, _ = standing
    ax = Figure().subplots()
    support_region(state, talos.soles(None)).plot(ax)
    zmp_region(state, [rbd.PointContact("wall", "left_sole_link", friction=0.0, on=rbd.Ground(normal=(0, 1, 0)))]).plot(
        other := Figure().subplots()
    )
    assert any("without end" in text.get_text() for text in ax.get_legend().get_texts())
    assert any("empty" in text.get_text() for text in other.get_legend().get_texts())
    assert np.ptp(ax.get_xlim()) < 1.0


def test_pushes_are_drawn_by_what_gives_way(standing):
    """Each tip at its push, in the colour of its limit."""
    state, soles, _ = standing
    limits = push_limits(state, soles, "torso_2_link", AROUND)
    ax = Figure().subplots()
    limits.plot(ax)
    dots = next(line for line in ax.lines if line.get_label() == LIMIT_COLORS["edge"][1])
    assert to_hex(dots.get_color()) == LIMIT_COLORS["edge"][0]
    assert np.allclose(dots.get_xydata(), limits.forces[:, None] * AROUND[:, :2])


def test_pushes_that_must_be_there_are_drawn_from_the_smallest_to_the_largest(talos, standing):
    """On one sole: no area around zero, a line in the plot and an arrow in the scene for each direction with an interval."""
    state, soles, _ = standing
    limits = push_limits(state, soles[:1], "torso_2_link", AROUND)
    some = np.isfinite(limits.forces)
    ax = Figure().subplots()
    limits.plot(ax)
    lines = [line.get_xydata() for line in ax.lines if len(line.get_xydata()) == 2 and line.get_color() == "0.6"]
    assert 0 < some.sum() < len(AROUND) and len(lines) == some.sum()
    for line, way, least, most in zip(lines, AROUND[some], limits.least[some], limits.forces[some], strict=True):
        assert np.allclose(line, [least * way[:2], most * way[:2]])
    with Scene(talos) as scene:
        scene.show(state)
        scene.draw(limits)
        drawn = {mark.path: mark for mark in scene.drawn}
        nearest = np.linalg.norm(drawn["statics/0/edge"].points - limits.point, axis=1).min()
        assert "statics/0/around" not in drawn and nearest > 0.5 * scene.metres_per_newton * limits.least[some].min()
    assert "cannot be held without a push" in limits._repr_html_()


def test_a_wrench_cone_shows_how_far_a_force_may_lean(talos, standing):
    """From the centre of mass of Talos the lean ends where the force passes an edge of the soles."""
    state, soles, region = standing
    cone = wrench_cone(state, soles)
    corners = cone.leans()
    expected = (state.com[:2] - region.vertices) / state.com[2]  # the force comes from there
    assert len(corners) == 4
    for corner in expected:
        assert np.abs(corners - corner).sum(axis=1).min() < 1e-9
    assert len(cone.plot(Figure().subplots())) == 3
    slippery = wrench_cone(state, talos.soles(0.02)[:1])  # a force from beside the centre of mass leans by 2.5 %
    assert not len(slippery.leans()) and len(slippery.plot(Figure().subplots())) == 1


def test_the_scene_draws_them_around_the_robot(talos, standing):
    """The region at the height of the soles, arrows from where the push acts at the scene's scale, until a new `draw`."""
    state, soles, region = standing
    limits = push_limits(state, soles, "torso_2_link", AROUND)
    with Scene(talos) as scene:
        with pytest.raises(rbd.errors.PictureError):
            scene.draw(region)
        scene.show(state, rbd.hold(state, soles))
        before = len(scene.drawn)
        scene.draw(region, limits, zmp_region(state, soles), wrench_cone(state, soles))
        drawn = {mark.path: mark for mark in scene.drawn}
        area = drawn["statics/0/area"].points
        assert np.abs(area[:, 2]).max() < 0.05 and np.allclose(area[:, :2].max(axis=0), region.vertices.max(axis=0))
        tips = drawn["statics/1/edge"].points - limits.point
        assert abs(tips[:, 1].max() - scene.metres_per_newton * limits.forces[1]) < 1e-6
        assert drawn["statics/3/cone"].color == WRENCH_COLOR
        assert "largest pushes" in scene.page() and "support region" in scene.page()
        scene.show(state)  # they stay
        assert any(mark.path.startswith("statics/") for mark in scene.drawn)
        with pytest.raises(rbd.InputError):
            scene.draw(state)
        scene.draw()
        assert not any(mark.path.startswith("statics/") for mark in scene.drawn)
        scene.show(state, rbd.hold(state, soles))
        assert len(scene.drawn) == before
