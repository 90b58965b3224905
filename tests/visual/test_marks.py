"""Marks of forces: what their geometry and their labels say, read back as numbers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.visual import Scene
from rbd.visual.layers import LAYERS
from rbd.visual.marks.mark import FULL_TURN

PUSH = rbd.ExternalForce("torso_2_link", [0.0, 60.0, 0.0], moment=[0.0, 0.0, 12.0])


@pytest.fixture(scope="module")
def pushed(talos) -> tuple[rbd.State, rbd.Actuation]:
    """Talos at rest on two soles, pushed sideways and turned."""
    state = talos.standing()
    return state, rbd.hold(state, talos.soles(friction=0.7), external=PUSH)


def shown(robot, state, solution=None, external=None, **given):
    """({path: mark}, scene) of a picture."""
    scene = Scene(robot, **given)
    scene.show(state, solution, external=external)
    return {mark.path: mark for mark in scene.drawn}, scene


def notes_and_entries(scene) -> tuple[list[str], dict[str, dict[str, str]]]:
    """The notes of the legend, and its entries by name."""
    import json

    message = next(m for m in scene._recorder.messages()[0] if isinstance(m, str) and m.startswith('{"legend"'))
    legend = json.loads(message)["legend"]
    return legend["notes"], {entry["name"]: entry for entry in legend["entries"]}


class TestLabels:
    """Every mark has a layer and a label; labels tell the solved numbers."""

    def test_every_mark_has_a_layer_and_a_label(self, talos, pushed):
        """The layers are those of the page's list, the first line of a tag is short."""
        marks, _ = shown(talos, *pushed, PUSH)
        assert {mark.layer for mark in marks.values()} <= set(LAYERS)
        assert {marks[f"contacts/left_sole/{part}"].layer for part in ("cone", "rim")} == {"cones"}
        assert marks["contacts/left_sole/corner_forces"].layer == "corner forces" and marks["pushes/0"].layer == "pushes"
        assert marks["support/area"].layer == "support polygon" and marks["com/ball"].layer == "centre of mass"
        for path, mark in marks.items():
            assert mark.label is not None and mark.label.title and mark.label.lines, path
            assert np.isfinite(mark.label.at).all() and (not mark.label.tag or len(mark.label.lines[0]) < 40)

    def test_a_label_tells_the_solved_numbers(self, talos, pushed):
        """|f|, the force on the robot, normal and tangential parts, friction used, centre of pressure."""
        state, held = pushed
        marks, _ = shown(talos, state, held, PUSH)
        force, contact = held.forces["left_sole"], held.contacts["left_sole"]
        lines = marks["contacts/left_sole/force"].label.lines
        assert lines[0] == f"|f| {np.linalg.norm(force[:3]):.4g} N"
        told = np.array([float(x) for x in lines[1].split("(")[1].split(")")[0].split(",")])
        assert lines[1].startswith("force on the robot") and np.abs(told - force[:3]).max() < 0.06
        assert lines[2] == f"normal {contact.normal:.4g} N, tangential {contact.tangential:.4g} N"
        assert lines[3] == f"friction used {100 * contact.friction_used:.1f} % of mu 0.7"
        assert lines[-1].startswith("centre of pressure (")
        assert "force on the robot (0, 60, 0) N" in marks["pushes/0"].label.lines

    def test_the_legend_tells_normal_force_and_size_apart(self, talos, pushed):
        """Both with their names; the push with its vector."""
        state, held = pushed
        _, scene = shown(talos, state, held, PUSH)
        _, entries = notes_and_entries(scene)
        contact = held.contacts["left_sole"]
        assert entries["left_sole"]["value"] == f"|f| {np.linalg.norm(contact.force):.4g} N"
        assert entries["left_sole"]["detail"].startswith(f"normal {contact.normal:.4g} N, friction ")
        assert entries["push on torso_2_link"]["detail"] == "(0, 60, 0) N, moment (0, 0, 12) N m"


class TestSupport:
    """The support polygon lies on the ground that carries."""

    def test_on_a_slope_it_lies_in_the_plane(self, talos):
        """On 10 degrees, without a plane told: all corners within 1e-9 m of it; the mark is parallel to it."""
        X = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.radians(10.0), 0.0), np.array([0.2, 0.0, 0.3]))
        q = talos.standing().q.copy()
        q[:7] = pin.SE3ToXYZQUAT(X * pin.XYZQUATToSE3(q[:7]))
        state = rbd.State(talos, q)
        solution = rbd.solve(state, np.zeros(talos.nu), talos.soles(friction=1.0, on=None))
        marks, scene = shown(talos, state, solution)
        n = X.rotation[:, 2]
        off = (scene._picture.outline - X.translation) @ n
        assert len(off) >= 4 and np.abs(off).max() < 1e-9
        drawn = (marks["support/area"].mesh.vertices - X.translation) @ n
        assert np.ptp(drawn) < 1e-9 and 0.0 < drawn[0] < 0.01

    def test_it_shines_through_the_feet(self, talos, pushed):
        """Area and edge are drawn through what hides them."""
        marks, _ = shown(talos, *pushed)
        assert marks["support/area"].seen_through and marks["support/outline"].seen_through


class TestMoments:
    """Arcs about the axis of a moment."""

    def test_the_angle_of_the_arc_is_the_moment(self, talos, pushed):
        """The tip is at that share of the full turn about the moment's axis, on the circle."""
        marks, scene = shown(talos, *pushed, PUSH)
        mark, sizes = marks["pushes/0_moment"], scene.sizes
        centre = pushed[0].frame(PUSH.frame, PUSH.offset).X_WF.translation
        expected = 12.0 / sizes.full_moment * FULL_TURN
        assert tip_angle(mark.mesh.vertices, centre, np.array([0.0, 0.0, 1.0]), sizes.arc) == pytest.approx(expected, abs=1e-9)
        assert mark.layer == "moments" and mark.label.lines[0] == "|m| 12 N m"


def tip_angle(vertices, centre, axis, radius) -> float:
    """The angle that an arc turns from its beginning to its tip [rad], in (-2 pi, 2 pi)."""
    from rbd.visual.shapes import axes_along

    local = (vertices - centre) @ axes_along(axis)
    on_circle = (np.abs(np.hypot(local[:, 0], local[:, 1]) - radius) < 1e-9) & (np.abs(local[:, 2]) < 1e-9)
    angles = np.arctan2(local[on_circle, 1], local[on_circle, 0]) % (2.0 * np.pi)
    return float(angles[-1])  # the tip of the head is the last point on the circle
