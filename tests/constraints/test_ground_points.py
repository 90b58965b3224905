"""Contacts with the ground, measured together and one by one."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import free_body, free_state
from scipy.integrate import solve_ivp

import rbd
from rbd.constraints.contact_points import FromRows, sources_of
from rbd.constraints.ground_points import Grounds, OnGround

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
        "ice", other.frame, offset=(0.1, 0.2, 0.3), on=rbd.Ground(normal=(0.0, 0.6, 0.8)), anchor=(0, 0, 1), friction=0.0
    )
    return robot, [one, tilted, other]


def alone(contact: rbd.constraints.Contact, start: rbd.State) -> Grounds:
    """The source of one contact."""
    return Grounds([OnGround(contact, start)], start)


def by_frames(contact: rbd.constraints.Contact, state: rbd.State) -> list[np.ndarray]:
    """(J, velocity, J_dot v, places) of a contact's points, each as the origin of a frame of its own."""
    R = alone(contact, state.robot.standing()).R[:, 3 - (3 if contact.friction else 1) :]
    found = []
    for p in contact.corners:
        X, J, v, bias = state.moving(contact.frame, contact.placement * pin.SE3(np.eye(3), p), pin.LOCAL_WORLD_ALIGNED)
        found.append((R.T @ J[:3], R.T @ v[:3], R.T @ bias[:3], X.translation[None]))
    return [np.concatenate(each) for each in zip(*found, strict=True)]


@pytest.mark.parametrize("name", ["talos", "solo12", "tilted"])
def test_contacts_together_are_the_same_as_each_alone(name: str):
    """Rows, velocities, J_dot v and places are those by the Jacobians of frames; gaps and arms those of each contact alone."""
    robot, feet = contacts(name)
    each_alone = [alone(foot, robot.standing()) for foot in feet]
    together = Grounds.joined(each_alone, robot.standing())
    for seed in range(3):
        state = moving(robot, seed)
        found, each = together.at(state, 0.0), [one.at(state, 0.0) for one in each_alone]
        expected = [np.concatenate(parts) for parts in zip(*(by_frames(foot, state) for foot in feet), strict=True)]
        for what, value in zip(("J", "velocity", "bias", "points"), expected, strict=True):
            assert np.abs(getattr(found, what) - value).max() < ROUNDING, what
        for what in ("J", "velocity", "bias", "gap", "error", "points"):
            assert np.abs(getattr(found, what) - np.concatenate([getattr(m, what) for m in each])).max() < ROUNDING, what
        if found.arms is not None:
            assert np.abs(found.arms - np.concatenate([m.arms for m in each])).max() < ROUNDING
        assert (found.axes == np.concatenate([np.tile(m.axes, (len(m.gap), 1, 1)) for m in each])).all()
        assert found.structure.owners == tuple(owner for m in each for owner in m.structure.owners)
        assert np.abs(together.gaps(state, 0.0) - found.gap).max() < ROUNDING
        assert max(np.abs(one.gaps(state, 0.0) - m.gap).max() for one, m in zip(each_alone, each, strict=True)) < ROUNDING


def test_what_stands_on_ground_at_rest_is_measured_together_and_nothing_else_is():
    """Soles and toes apart, as a sole has moments; a moving ground, a held contact and a lone toe are measured each alone."""
    robot = rbd.load_robot("talos")
    soles = robot.soles(0.7)
    toe = rbd.PointContact("toe", soles[0].frame, offset=(0.1, 0.0, 0.0), friction=0.5)
    band = rbd.PointContact(
        "band", soles[1].frame, offset=(0.1, 0.0, 0.0), friction=0.5, on=rbd.Ground(velocity=(0.1, 0.0, 0.0))
    )
    held = rbd.PointContact("hand", "torso_2_link", friction=None)
    sources = sources_of([toe, soles[0], band, held, soles[1]], robot.standing())
    assert [type(s) for s in sources] == [Grounds, Grounds, Grounds, FromRows]
    assert [len(s.members) for s in sources[:3]] == [1, 2, 1]


@pytest.mark.parametrize("kind", ["patch", "edge", "tip"])
def test_points_of_contact_between_bodies_are_where_the_bodies_have_them(kind: str):
    """Corners in W are X_WF X_FP p of the body that bears them, however it is turned; their axes are those of the rows."""
    robot = rbd.load_robot("solo12")
    frame, on = robot.feet(0.7)[0].frame, robot.feet()[1].frame
    placement = pin.SE3(pin.exp3(np.array([0.4, -0.7, 0.2])), np.array([0.01, -0.02, 0.03]))
    contact = {
        "patch": rbd.SurfaceContact(kind, frame, half_lengths=(0.03, 0.01), placement=placement, friction=0.5, on=rbd.Body(on)),
        "edge": rbd.LineContact(kind, frame, half_length=0.04, placement=placement, friction=0.5, on=rbd.Body(on)),
        "tip": rbd.PointContact(kind, frame, offset=placement.translation, friction=0.5, on=rbd.Body(on)),
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


TILT = pin.exp3(np.array([0.2, -0.3, 0.4]))
EDGES = {
    "its placement's z": {},
    "a normal": {"on": rbd.Ground(normal=(0.0, 0.6, 0.8))},
    "an anchor": {"anchor": pin.SE3(TILT, np.array([0.1, 0.2, 0.3]))},
    "an anchor and a normal": {"anchor": pin.SE3(TILT, np.array([0.1, 0.2, 0.3])), "on": rbd.Ground(normal=(0.0, 0.6, 0.8))},
    "a plane": {"on": rbd.Ground(point=(0.0, 0.0, 0.2), normal=(0.0, 0.6, 0.8))},
}


@pytest.mark.parametrize("by", EDGES)
@pytest.mark.parametrize("friction", [0.5, 0.0])
def test_an_edge_on_the_ground_is_its_two_ends(by: str, friction: float):
    """Velocities, J_dot v, gaps and places of its ends, in W, are those of two points on the plane that the edge is told of."""
    robot, given = free_body(2.0, [0.1, 0.2, 0.3]), EDGES[by]
    start = free_state(robot, (0.3, -0.2, 0.5), (0.1, 0.2, -0.3))
    placement = pin.SE3(pin.exp3(np.array([-0.2, 0.1, 0.5])), np.array([0.05, -0.1, -0.2]))
    edge = rbd.LineContact("edge", "body", half_length=0.3, placement=placement, friction=friction, **given)
    there = start.frame("body").X_WF * placement
    on, anchor = given.get("on", rbd.Ground()), given.get("anchor", there)
    normal = anchor.rotation[:, 2] if on.normal is None else on.normal
    through = anchor.translation if on.point is None else on.point
    ends = [
        rbd.PointContact(
            f"end{i}",
            "body",
            offset=placement.act(np.array([x, 0.0, 0.0])),
            on=rbd.Ground(normal=normal),
            anchor=through,
            friction=friction,
        )
        for i, x in enumerate((0.3, -0.3))
    ]
    state = free_state(robot, (0.4, -0.1, 0.6), (-0.4, 0.5, 0.7), (0.3, -1.0, 0.6), (1.0, 2.0, -3.0))
    line = alone(edge, start).at(state, 0.0)
    points = [alone(end, start).at(state, 0.0) for end in ends]
    for what in ("J", "velocity", "bias"):
        rows = getattr(line, what).reshape(2, 3 if friction else 1, -1)
        found = line.axes[:, -rows.shape[1] :] @ rows
        expected = [m.axes[:, -rows.shape[1] :] @ getattr(m, what).reshape(rows.shape[1], -1) for m in points]
        assert np.abs(found - np.array(expected)).max() < 10.0 * ROUNDING, what
    assert np.abs(line.gap - np.concatenate([m.gap for m in points])).max() < ROUNDING
    assert np.abs(line.points - np.concatenate([m.points for m in points])).max() < ROUNDING
    assert np.abs(alone(edge, start).gaps(state, 0.0) - line.gap).max() < ROUNDING


def test_a_sole_that_stands_on_its_rim_has_axes_of_its_plane():
    """Its x points along the plane's normal and says no direction on it: gaps are z of its corners, axes a turn with z up."""
    robot = free_body(2.0, [0.1, 0.2, 0.3])
    placement = pin.SE3(pin.exp3(np.array([0.0, -0.5 * math.pi, 0.0])), np.array([0.0, 0.0, 0.2]))
    sole = rbd.SurfaceContact("rim", "body", half_lengths=(0.2, 0.1), placement=placement, friction=0.5, on=0.1)
    state = free_state(robot, (0.0, 0.0, 0.1))
    found = alone(sole, state).at(state, 0.0)
    assert sorted(np.round(found.gap, 12)) == [0.0, 0.0, 0.4, 0.4]
    assert np.abs(found.axes[:, 2] - [0.0, 0.0, 1.0]).max() < ROUNDING
    assert np.abs(found.axes.T @ found.axes - np.eye(3)).max() < ROUNDING and np.linalg.det(found.axes) > 0.0


def test_a_box_falls_about_the_edge_that_it_stands_on():
    """An inverted pendulum, I phi'' = m g r sin phi about the edge, which does not slip: of second order, as its forces are."""
    m, half, low, g = 10.0, 0.2, 0.1, 9.81
    inertia, r = m * (0.4**2 + 0.2**2) / 12.0, math.hypot(half, low)
    about = inertia + m * r * r
    placement = pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.5 * math.pi])), np.array([half, 0.0, -low]))
    edge = rbd.LineContact(
        "edge", "body", half_length=0.2, placement=placement, on=rbd.Ground(normal=(0.0, 0.0, 1.0)), friction=1.5
    )
    phi0, duration = math.atan2(half, low) - 0.4, 0.16
    true = solve_ivp(
        lambda t, y: [y[1], m * g * r * math.sin(y[0]) / about], (0.0, duration), [-phi0, 0.0], rtol=1e-12, atol=1e-12
    ).y[:, -1]
    robot, errors = free_body(m, [0.1, inertia, 0.1]), []
    start = free_state(robot, r * np.array([-math.sin(phi0), 0.0, math.cos(phi0)]), (0.0, 0.4, 0.0))
    for step in (1e-2, 5e-3):
        found = rbd.simulate(start, [edge], duration=duration, step=step, progress=False)
        assert set(found.modes["edge"]) == {"sticks"}
        phi, rate = math.atan2(found.q[-1, 0], found.q[-1, 2]), found.v[-1, 4]
        errors.append(max(abs(phi - true[0]), abs(rate - true[1])))
    assert errors[1] < 30.0 * 5e-3**2  # at up to 4 rad/s and 25 rad/s2
    assert 3.0 < errors[0] / errors[1] < 5.0
    turning = m * g * r * math.sin(true[0]) / about
    com = r * (turning * np.array([math.cos(true[0]), -math.sin(true[0])])
               - true[1] ** 2 * np.array([math.sin(true[0]), math.cos(true[0])]))  # fmt: skip
    assert np.abs(found.forces["edge"][-1][[0, 2]] - m * (com + [0.0, g])).max() < 5e-3 * m * g
    assert np.abs(found.point_forces["edge"][-1].sum(axis=0) - found.forces["edge"][-1][:3]).max() < 1e-9


@pytest.mark.parametrize("turn", [0.0, 0.4, -2.0])
def test_axes_on_a_plane_follow_the_soles_length(turn: float):
    """The first axis of a sole that stands on a ramp is its own x as far as the plane goes: friction is told along the foot."""
    c, s = np.cos(0.3), np.sin(0.3)
    ramp = rbd.Ground(point=(0.0, 0.0, 0.5), normal=(s, 0.0, c))
    robot = free_body(2.0, [0.1, 0.2, 0.3])
    sole = rbd.SurfaceContact("sole", "body", half_lengths=(0.1, 0.05), friction=0.5, on=ramp)
    R = pin.exp3(np.array([0.0, 0.3, 0.0])) @ pin.exp3(np.array([0.0, 0.0, turn]))
    state = free_state(robot, (0.0, 0.0, 0.5), pin.log3(R))
    assert np.abs(alone(sole, state).R - R).max() < ROUNDING


def test_a_contact_kind_of_ones_own_has_the_resultants_of_its_corners(talos: rbd.Robot):
    """Only rows are given: forces at the corners make the wrench that the rows' forces make, in world axes."""
    sole, state = talos.soles(friction=0.6)[0], talos.standing()

    class Mine:
        name = "mine"

        def rows(self, state: rbd.State) -> rbd.Rows:
            return replace(sole.rows(state), name=self.name)

    rows, found = sole.rows(state), FromRows(Mine()).at(state, 0.0)
    G, _ = rows.cone.generators()
    f = np.random.default_rng(3).normal(size=G.shape[1])
    assert np.abs(found.to_world @ f - rows.resultant @ (G @ f)).max() < 1e-14
    assert np.abs(found.J - G.T @ rows.J).max() < 1e-14
