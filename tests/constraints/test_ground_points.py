"""Contacts with the ground, measured together and one by one."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.ground_points import Grounds, OnGround
from rbd.constraints.sources import FromRows, sources_of

ROUNDING = 1e-13  # of entries of order one


def moving(robot: rbd.Robot, seed: int) -> rbd.State:
    """The robot off its feet, every joint moving."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.standing().q, 0.3 * rng.normal(size=robot.nv))
    return rbd.State(robot, q, rng.normal(size=robot.nv))


def contacts(name: str) -> tuple[rbd.Robot, list]:
    """Soles; toes; toes of which one has no friction, two stand on one body, and the ground is tilted."""
    if name != "tilted":
        robot = rbd.load_robot(name)
        return robot, robot.feet(0.7)
    robot = rbd.load_robot("bolt")
    one, other = robot.feet(0.7)
    tilted = rbd.PointContact(
        "ice", other.frame, offset=(0.1, 0.2, 0.3), normal=(0.0, 0.6, 0.8), anchor=(0, 0, 1), friction=0.0
    )
    return robot, [one, tilted, other]


@pytest.mark.parametrize("name", ["talos", "solo12", "tilted"])
def test_contacts_together_are_the_same_as_each_alone(name: str):
    """Rows, velocities, J_dot v, gaps, places and arms are those of `OnGround`, which goes through the frame's own Jacobian."""
    robot, feet = contacts(name)
    alone = [OnGround(foot, robot.standing()) for foot in feet]
    together = Grounds(alone, robot.standing())
    for seed in range(3):
        state = moving(robot, seed)
        found, each = together.at(state, 0.0), [one.at(state, 0.0) for one in alone]
        for what in ("J", "velocity", "bias", "gap", "error", "points"):
            assert np.abs(getattr(found, what) - np.concatenate([getattr(m, what) for m in each])).max() < ROUNDING, what
        if found.arms is not None:
            assert np.abs(found.arms - np.concatenate([m.arms for m in each])).max() < ROUNDING
        assert (found.axes == np.concatenate([np.tile(m.axes, (len(m.gap), 1, 1)) for m in each])).all()
        assert found.structure.owners == tuple(owner for m in each for owner in m.structure.owners)
        assert np.abs(together.gaps(state, 0.0) - found.gap).max() < ROUNDING
        assert max(np.abs(one.gaps(state, 0.0) - m.gap).max() for one, m in zip(alone, each, strict=True)) < ROUNDING


def test_what_stands_on_ground_at_rest_is_measured_together_and_nothing_else_is():
    """Soles and toes apart, as a sole has moments; a moving ground, a held contact and a lone toe are measured each alone."""
    robot = rbd.load_robot("talos")
    soles = robot.soles(0.7)
    toe = rbd.PointContact("toe", soles[0].frame, offset=(0.1, 0.0, 0.0), friction=0.5)
    band = rbd.PointContact("band", soles[1].frame, offset=(0.1, 0.0, 0.0), friction=0.5, velocity=(0.1, 0.0, 0.0))
    held = rbd.PointContact("hand", "torso_2_link", friction=None)
    kinds = [type(s) for s in sources_of([toe, soles[0], band, held, soles[1]], robot.standing())]
    assert kinds == [OnGround, Grounds, OnGround, FromRows]


@pytest.mark.parametrize("kind", ["patch", "edge", "tip"])
def test_points_of_contact_between_bodies_are_where_the_bodies_have_them(kind: str):
    """Corners in W are X_WF X_FP p of the body that bears them, however it is turned; their axes are those of the rows."""
    robot = rbd.load_robot("solo12")
    frame, on = robot.feet(0.7)[0].frame, robot.feet()[1].frame
    placement = pin.SE3(pin.exp3(np.array([0.4, -0.7, 0.2])), np.array([0.01, -0.02, 0.03]))
    contact = {
        "patch": rbd.SurfaceContact(kind, frame, half_lengths=(0.03, 0.01), placement=placement, friction=0.5, against=on),
        "edge": rbd.LineContact(kind, frame, half_length=0.04, placement=placement, friction=0.5, against=on),
        "tip": rbd.PointContact(kind, frame, offset=placement.translation, friction=0.5, against=on),
    }[kind]
    corners = {
        "patch": [[0.03, 0.01, 0], [0.03, -0.01, 0], [-0.03, -0.01, 0], [-0.03, 0.01, 0]],
        "edge": [[0.04, 0, 0], [-0.04, 0, 0]],
        "tip": [[0, 0, 0]],
    }[kind]
    state = moving(robot, 4)
    measured = FromRows(contact).at(state, 0.0)
    X_WP = state.frame(frame).X_WF * placement
    expected = [X_WP.act(np.array(p, float)) for p in corners]
    assert measured.points is not None and len(measured.points) == len(expected)
    gaps = np.abs(measured.points[:, None] - np.array(expected)).max(axis=2)  # in any order
    assert gaps.min(axis=1).max() < ROUNDING and sorted(gaps.argmin(axis=1)) == list(range(len(corners)))
    (rows,) = rbd.gauss_problem(state, np.zeros(robot.nu), [contact]).rows
    assert np.array_equal(measured.axes, rows.patch.axes)


@pytest.mark.parametrize("stepper", ["smooth", "stepping"])
def test_recorded_corners_of_a_held_patch_are_on_the_body(stepper: str):
    """A box that hangs by a patch, turned every way: its corners are X_WF X_FP p at each recorded moment, and carry m g."""
    robot = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")
    pose = pin.SE3(pin.exp3(np.array([0.4, -0.7, 0.9])), np.array([0.1, 0.2, 1.0]))
    state = robot.at(pin.SE3ToXYZQUAT(pose))
    placement = pin.SE3(pin.exp3(np.array([-0.3, 0.5, 0.2])), np.array([0.05, -0.1, 0.1]))
    patch = rbd.SurfaceContact("glue", "box", half_lengths=(0.05, 0.02), placement=placement)
    settings = {"integrator": rbd.RungeKutta4()} if stepper == "smooth" else {"integrator": rbd.TimeStepping()}
    motion = rbd.simulate(state, [patch], duration=0.02, step=0.01, progress=False, **settings)
    for k in range(len(motion)):
        X_WP = motion.state(k).frame("box").X_WF * placement
        expected = np.array([X_WP.act(p) for p in patch.corners])
        found = motion.points["glue"][k]
        assert np.abs(found - expected).max() < 1e-9 if len(found) == 4 else len(found) == 1
        assert motion.forces["glue"][k][:3] == pytest.approx([0.0, 0.0, 98.1], abs=1e-6)
