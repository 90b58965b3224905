"""Pictures of lines, of contacts between bodies, and of two robots in one model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.visual import Scene
from rbd.visual.marks.contacts import acting_point, shown_forces, support_polygon

BOX = Path(__file__).parents[2] / "urdf" / "box.urdf"
BELOW = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))


@pytest.fixture(scope="module")
def stack() -> tuple[rbd.robots.RobotPair, rbd.State, rbd.Solution]:
    """A box on a box, the upper one shifted, each with its patch."""
    box = rbd.load_robot(BOX)
    pair = rbd.robots.merge_robots(box, box, names=("lower_", "upper_"))
    state = pair.at(pair.q(np.r_[0, 0, 0.1, 0, 0, 0, 1.0], np.r_[0.15, 0, 0.3, 0, 0, 0, 1.0]))
    small = {"half_lengths": (0.05, 0.05), "placement": BELOW, "friction": 0.5}
    contacts = [
        rbd.SurfaceContact("floor", "lower_box", half_lengths=(0.2, 0.2), placement=BELOW, friction=0.5),
        rbd.SurfaceContact("between", "upper_box", on=rbd.Body("lower_box"), **small),
    ]
    return pair, state, rbd.solve(state, np.zeros(0), contacts)


@pytest.fixture(scope="module")
def edge() -> tuple[rbd.Robot, rbd.State, rbd.Solution]:
    """A box on the line under its middle, pushed along it."""
    box = rbd.load_robot(BOX)
    state = box.at(np.r_[0, 0, 0.1, 0, 0, 0, 1.0])
    line = rbd.LineContact("line", "box", half_length=0.15, placement=BELOW, friction=0.5)
    return box, state, rbd.solve(state, np.zeros(0), [line], external=rbd.ExternalForce("box", (20.0, 0.0, 0.0)))


def test_both_bodies_arrows_start_at_the_contact_and_point_apart(stack):
    """The force on the first, and its opposite on the second, of one length."""
    pair, state, solution = stack
    with Scene(pair) as scene:
        scene.show(state, solution)
        drawn, scale = {mark.path: mark.points for mark in scene.drawn}, scene.metres_per_newton
        start = next(c.start for c in scene.contacts if c.name == "between")
    force = scale * solution.forces["between"][:3]
    assert force[2] > 0.0
    for path, vector in (("contacts/between/force", force), ("contacts/between/reaction", -force)):
        along = (drawn[path] - start) @ vector / (vector @ vector)
        assert abs(along.min()) < 1e-9 and abs(along.max() - 1.0) < 1e-9
    assert "contacts/floor/reaction" not in drawn


def test_what_is_between_two_bodies_carries_no_one_from_below(stack):
    """The support polygon is the floor's patch, though the upper one presses too."""
    _, _, solution = stack
    hull = support_polygon(shown_forces(solution))
    assert np.abs(hull).max() == pytest.approx(0.2) and len(hull) == 4


def test_the_legend_says_what_is_touched(stack, tmp_path):
    """The other body's frame stands under the contact's name."""
    pair, state, solution = stack
    with Scene(pair) as scene:
        scene.show(state, solution)
        text = scene.export(tmp_path / "stack.html").read_text(encoding="utf-8")
    assert "against lower_box, normal 98.1 N, friction used 0.0 % of mu 0.5" in text


def test_a_line_is_drawn_from_end_to_end_with_its_end_forces(edge):
    """A tube between the two ends, a ball on each, an arrow from each, the resultant where the load is."""
    robot, state, solution = edge
    with Scene(robot) as scene:
        scene.show(state, solution)
        drawn = {mark.path: mark for mark in scene.drawn}
        contact, (balls,) = scene.contacts[0], drawn["contacts/line/ends"].shape
        assert balls.sizes["radius"] == 1.3 * scene.sizes.shaft
    ends = np.array([[0.15, 0.0, 0.0], [-0.15, 0.0, 0.0]])
    assert contact.corners == pytest.approx(ends, abs=1e-15) and contact.corner_forces.shape == (2, 3)
    assert np.abs(balls.points[:, 0]) == pytest.approx([0.15, 0.15])
    assert {"contacts/line/outline", "contacts/line/corner_forces", "contacts/line/force"} <= set(drawn)
    assert "contacts/line/patch" not in drawn  # a line has no area
    # Statics: the push of 20 N at 0.1 m shifts the load by 20 * 0.1 / 98.1 m along the line.
    assert contact.start == pytest.approx([20.0 * 0.1 / 98.1, 0.0, 0.0], abs=1e-7)


def test_a_force_beyond_the_end_of_a_line_is_drawn_at_its_middle(edge):
    """A held line may pull: then there is no centre of pressure on it."""
    patch = edge[2].problem.rows[0].patch
    assert acting_point(patch, np.r_[0, 0, 50.0, 0, 20.0, 0]) == pytest.approx([0.0, 0.0, 0.0])


def test_two_robots_are_drawn_where_they_stand(stack):
    """Two boxes, one above the other: the pieces' heights."""
    pair, state, _ = stack
    with Scene(pair) as scene:
        scene.show(state)
        cloud = scene._body.cloud
    assert cloud[:, 2].min() == pytest.approx(0.0, abs=1e-12) and cloud[:, 2].max() == pytest.approx(0.4)
    assert cloud[:, 0].max() == pytest.approx(0.35)
