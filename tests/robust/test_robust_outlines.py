"""Outlines from both sides: closed forms, what single members say, and pictures."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import rbd
from rbd.robust import PushSet, hold, push_limits, region
from rbd.visual.marks.regions import hull_of

BOX = rbd.testing.box(mass=10.0)
STATE = rbd.State(BOX, [0, 0, 0, 0, 0, 0, 1])
G = 9.81


def sole(friction: float = 0.5) -> list[rbd.SurfaceContact]:
    """A base of 0.4 x 0.2 m at the height of the box's middle: a push there tips nothing."""
    return [rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.1), friction=friction)]


def level(count: int) -> np.ndarray:
    angle = np.arange(count) * (2.0 * np.pi / count)
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def test_the_lightest_box_slips_first_in_every_direction():
    """Of masses from 9 to 11 kg and friction from 0.3 on: 0.3 x 9 kg x g, from inside and from outside to a millionth."""
    found, expected = push_limits(STATE, sole(), "box", level(8), mass={"box": 0.1}, friction=0.3), 0.3 * 9.0 * G
    assert (found.inner <= expected).all() and (found.outer >= expected).all()
    assert (found.outer - found.inner).max() < 1e-5 * expected
    assert all(proof.verify() for proof in found.holds) and all(against.verify() for against in found.counterexamples)
    assert all(against.members[0].mass["box"] == pytest.approx(9.0) for against in found.counterexamples)


def test_a_box_at_an_uncertain_place_tips_over_the_nearer_edge():
    """Pushed 0.3 m above its base: m g (0.1 - 0.02) / 0.3 sideways where the centre of mass is within 2 cm."""
    found = push_limits(STATE, sole(2.0), "box", (0, 1, 0), offset=(0, 0, 0.3), com={"box": 0.02})
    expected = BOX.mass * G * 0.08 / 0.3
    assert found.inner[0] <= expected <= found.outer[0] and found.outer[0] - found.inner[0] < 1e-5 * expected
    assert found.counterexamples[0].members[0].com["box"][1] == pytest.approx(0.02)


def test_the_region_of_a_base_does_not_ask_for_the_mass():
    """Of any mass the centre of mass may be above the base, and nowhere else: a rectangle, from inside and from outside."""
    found, area = region(STATE, sole(), mass={"box": 0.3}), 0.4 * 0.2
    assert area - 1e-6 < found.area <= area <= found.outer_area < area + 1e-6
    assert all(proof.verify() for proof in found.holds) and all(against.verify() for against in found.counterexamples)


def test_an_uncertain_centre_of_mass_takes_a_strip_off_the_region():
    """Within 2 cm along x and 1 cm along y: 0.36 x 0.18 m is left."""
    found, area = region(STATE, sole(), com={"box": (0.02, 0.01, 0.0)}), 0.36 * 0.18
    assert (
        found.outer_area == pytest.approx(area, abs=1e-6) and found.area == pytest.approx(area, rel=0.02) and found.area <= area
    )


def test_a_push_moves_the_region_by_its_lever():
    """Pushed by up to 5 N along x, 0.3 m above the base, a box of 9 kg or more loses 5 x 0.3 / (9 g) at both ends."""
    push = PushSet.box("box", (-5, 0, 0), (5, 0, 0), offset=(0, 0, 0.3))
    found, lost = region(STATE, sole(), pushes=push, mass={"box": (9.0, 12.0)}), 5.0 * 0.3 / (9.0 * G)
    assert np.abs(found.outer).max(axis=0) == pytest.approx([0.2 - lost, 0.1], abs=1e-6)
    assert found.area <= found.outer_area and found.area == pytest.approx(found.outer_area, rel=1e-5)


def test_single_robots_agree_with_the_limits_of_solo12():
    """The robot as it is withstands the inner push by `rbd.statics.push_limits`; the inner end is near the outer one."""
    solo = rbd.load_robot("solo12")
    state, ways = solo.standing(), level(4)
    found = push_limits(state, solo.feet(friction=0.7), "base_link", ways, friction=0.5, com={"base_link": 0.01})
    nominal = rbd.statics.push_limits(state, solo.feet(friction=0.5), "base_link", ways)
    assert (found.inner <= nominal.forces + 1e-6).all() and (found.inner <= found.outer).all()
    assert (found.outer - found.inner).max() < 0.06 * nominal.forces.max() and (found.outer < nominal.forces).all()


def test_bad_outlines_are_refused():
    """A set with a member that falls by itself, or that falls wherever another stands; no base; a region without end."""
    with pytest.raises(rbd.CannotHold, match="cannot be held without a push"):
        push_limits(STATE, sole(), "box", (1, 0, 0), com={"box": 0.15})
    with pytest.raises(rbd.CannotHold, match="no place of the centre of mass"):
        region(STATE, sole(), com={"box": 0.15})
    with pytest.raises(rbd.errors.FrameNotFound, match="nearest: 'box'"):
        push_limits(STATE, sole(), "bx", (1, 0, 0))
    arm = rbd.load_robot("ur5", root="fixed")
    with pytest.raises(rbd.InputError, match="bases"):
        region(arm.at(), [rbd.PointContact("tool", "tool0", friction=0.5)])
    glued = [rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.1), friction=None)]
    with pytest.raises(rbd.NoSolution, match="does not end"):
        region(STATE, glued)


def test_both_outlines_are_drawn():
    """As curves on axes, and around a robot: the set of pushes at its frame, arrows, an area with a line around it."""
    crate = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "crate.urdf")
    state, base = crate.at(), [rbd.SurfaceContact("base", "crate", half_lengths=(0.2, 0.2), friction=0.5)]
    pushes = PushSet.box("crate", (-2, -2, -2), (2, 2, 2))
    limits, places = push_limits(state, base, "crate", level(4)), region(state, base, pushes=pushes)
    held, axes = hold(state, base, pushes=pushes), Figure().subplots(1, 2)
    assert [text.get_text() for text in limits.plot(axes[0])[0].axes.get_legend().get_texts()] == [
        "every member withstands",
        "a member does not withstand more",
    ]
    assert len(places.plot(axes[1])) >= 3
    with rbd.visual.Scene(crate) as scene:
        scene.show(state)
        scene.draw(held, limits, places)
        drawn = {mark.path for mark in scene._around_marks}
    assert drawn >= {
        "statics/0/edge",
        "statics/0/area",
        "statics/1/arrows",
        "statics/1/outer",
        "statics/2/area",
        "statics/2/outer",
    }


def test_the_hull_of_pushes_has_the_edges_of_its_solid():
    """A box of pushes has twelve edges, a square four, a line one, a point none."""
    corners = np.asarray(PushSet.box("box", (-1, -1, -1), (1, 1, 1)).corners)
    assert [len(hull_of(each)[1]) for each in (corners, corners[:4], corners[:2], corners[:1])] == [12, 4, 1, 0]
    assert math.isclose(len(hull_of(corners)[0]), 12)
