"""Where the picture puts forces, and the support polygon it draws."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rbd.problem.answer import ContactForce
from rbd.problem.rows import Patch
from rbd.visual import shapes
from rbd.visual.marks.contacts import acting_point, shown_forces, support_polygon


def flat(name, centre, *, half=(0.1, 0.05), force=(0.0, 0.0, 100.0), normal=(0.0, 0.0, 1.0)):
    """One contact patch with a force at its centre, as the picture takes them."""
    x, y = half
    corners = np.array([[x, y, 0.0], [x, -y, 0.0], [-x, -y, 0.0], [-x, y, 0.0]])
    axes = np.eye(3) if normal[2] == 1.0 else shapes.axes_along(np.array(normal))
    patch = Patch(np.array(centre, float), axes, corners, 0.6)
    return name, patch, np.concatenate([force, np.zeros(3)])


def point(name, centre, *, force=(0.0, 0.0, 100.0)):
    return name, Patch(np.array(centre, float), np.eye(3), np.zeros((1, 3)), 0.6), np.array(force, float)


def pictured(*contacts):
    rows = [SimpleNamespace(name=name, patch=patch) for name, patch, _ in contacts]
    forces = {name: force for name, _, force in contacts}
    return shown_forces(SimpleNamespace(problem=SimpleNamespace(rows=rows), forces=forces, corner_forces={}))


def test_a_resultant_acts_at_the_centre_of_pressure():
    """Moving a force by d about the patch's centre gives the moment d x f: the arrow starts at d."""
    _, patch, wrench = flat("sole", (1.0, 2.0, 0.0))
    d = np.array([0.04, -0.03, 0.0])
    wrench[3:] = np.cross(d, wrench[:3])
    assert np.allclose(acting_point(patch, wrench), patch.point + d)


def test_a_sole_that_pulls_is_drawn_at_its_own_point():
    """Outside the patch, or under tension, there is no centre of pressure to draw from."""
    _, patch, wrench = flat("sole", (1.0, 2.0, 0.0))
    outside = np.concatenate([wrench[:3], [0.0, -100.0, 0.0]])
    assert np.allclose(acting_point(patch, outside), patch.point)
    assert np.allclose(acting_point(patch, -wrench), patch.point)
    assert ContactForce.of(patch, outside).centre_of_pressure is not None


def test_two_soles_side_by_side_span_one_rectangle():
    """Closed form: soles of 0.2 x 0.1 m at y = +-0.1 m have the hull [-0.1, 0.1] x [-0.15, 0.15]."""
    hull = support_polygon(pictured(flat("left", (0, 0.1, 0)), flat("right", (0, -0.1, 0))))
    assert len(hull) == 4
    assert np.allclose(hull.min(axis=0), [-0.1, -0.15]) and np.allclose(hull.max(axis=0), [0.1, 0.15])
    following = np.roll(hull, -1, axis=0)
    area = 0.5 * float((hull[:, 0] * following[:, 1] - hull[:, 1] * following[:, 0]).sum())
    assert area == pytest.approx(0.06)  # positive: counter-clockwise


def test_a_foot_that_carries_nothing_does_not_support():
    """Only loaded contacts count, and only those that push from below."""
    left = flat("left", (0, 0.1, 0))
    air = flat("right", (0, -0.1, 0), force=(0.0, 0.0, 0.0))
    wall = flat("hand", (1.0, 0.0, 1.0), force=(-50.0, 0.0, 0.0), normal=(-1.0, 0.0, 0.0))
    assert np.allclose(support_polygon(pictured(left, air, wall)), support_polygon(pictured(left)))


@pytest.mark.parametrize("count, corners", [(0, 0), (1, 1), (2, 2), (3, 2)])
def test_points_in_a_line_give_a_segment_and_no_failure(count, corners):
    """One point is a point, two or more in a row are a segment, none are nothing."""
    feet = [point(f"foot{i}", (0.1 * i, 0.2 * i, 0.0)) for i in range(count)]
    hull = support_polygon(pictured(*feet))
    assert hull.shape == (corners, 2)


def test_what_is_no_contact_has_no_arrow():
    """Rows without a patch, such as a loop's, and contacts without a force are left out."""
    name, patch, force = flat("sole", (0.0, 0.0, 0.0))
    rows = [SimpleNamespace(name="loop", patch=None), SimpleNamespace(name=name, patch=patch)]
    rows.append(SimpleNamespace(name="open", patch=patch))
    keeper = SimpleNamespace(rows=rows)
    shown = shown_forces(SimpleNamespace(problem=keeper, forces={"loop": np.ones(3), name: force}, corner_forces={}))
    assert [each.name for each in shown] == ["sole"]
