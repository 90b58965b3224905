"""Contacts along a line: edges of boxes and feet, about which these may turn."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.testing import box, check_constraint, law_residuals

BELOW = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))  # of the box of 0.4 x 0.4 x 0.2 m
WEIGHT_N = 98.1
SOLVERS = [rbd.ProxQP(), rbd.ConeSolver()]


def _edge(x: float = 0.0, y: float = 0.0, **more) -> rbd.LineContact:
    """An edge under the box along its x axis, 0.3 m long, its middle at (x, y)."""
    placement = pin.SE3(np.eye(3), np.array([x, y, -0.1]))
    return rbd.LineContact(more.pop("name", "edge"), "box", half_length=0.15, placement=placement, **more)


def _at(R: np.ndarray | None = None, v: np.ndarray | None = None) -> rbd.State:
    X = pin.SE3(np.eye(3) if R is None else R, np.array([0.0, 0.0, 0.1]))
    return rbd.State(box(), pin.SE3ToXYZQUAT(X), v)


@pytest.fixture(scope="module")
def bent(talos: rbd.Robot) -> rbd.State:
    """Talos in no particular pose."""
    return talos.at(pin.integrate(talos.model, talos.standing().q, 0.4 * np.random.default_rng(3).normal(size=talos.nv)))


@pytest.mark.parametrize("friction", [None, 0.0, 0.5])
@pytest.mark.parametrize("against", [None, rbd.Body("right_sole_link")])
def test_a_line_describes_its_motion(talos, bent, rng, friction, against):
    """J, velocity and J_dot v of its five rows, against the ground and as seen from another body."""
    X_FP = pin.SE3(pin.exp3(rng.normal(size=3)), 0.3 * rng.normal(size=3))
    line = rbd.LineContact("edge", "torso_2_link", half_length=0.1, placement=X_FP, friction=friction, on=against)
    report = check_constraint(line, bent)
    assert report.rows == 5 and max(report.jacobian, report.velocity, report.jdot_v) < 1e-9


def test_a_line_on_a_ground_of_its_own_normal_describes_its_motion(bent):
    """The body may roll over its edge: axes follow the line and the ground, not the body."""
    X_FP = pin.SE3(pin.exp3(np.array([0.4, 0.0, 0.0])), np.array([0.1, 0.05, -0.1]))
    up = bent.frame("left_sole_link").X_WF.rotation @ np.array([0.1, -0.3, np.sqrt(0.9)])
    line = rbd.LineContact(
        "edge", "left_sole_link", half_length=0.1, placement=X_FP, on=rbd.Ground(normal=up / np.linalg.norm(up))
    )
    report = check_constraint(line, bent)
    assert report.rows == 5 and max(report.jacobian, report.jdot_v) < 1e-9
    axes = line.rows(bent).patch.axes
    assert abs(axes[:, 1] @ up) < 1e-15 and axes[:, 2] @ up > 0.9 and np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("friction", [None, 0.0, 0.6])
def test_a_box_on_its_middle_line_stands_and_presses_with_its_weight(friction, solver):
    """Balanced on a line under its centre: m g in all, half of it at each end, and no moment."""
    s = rbd.solve(_at(), np.zeros(0), [_edge(friction=friction)], solver=solver)
    assert s.status == "solved" and np.abs(s.a).max() < 1e-9
    assert s.forces["edge"] == pytest.approx([0.0, 0.0, WEIGHT_N, 0.0, 0.0, 0.0], abs=1e-8)
    assert s.corner_forces["edge"] == pytest.approx(np.tile([0.0, 0.0, WEIGHT_N / 2], (2, 1)), abs=1e-8)
    assert s.contacts["edge"].centre_of_pressure == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("friction", [None, 0.9])
def test_a_box_on_its_edge_turns_about_it(friction):
    """Nothing resists the turn: a point mass m at (d, h) from the edge, I about x: w' = m g d / (I + m (d^2 + h^2))."""
    s = rbd.solve(_at(), np.zeros(0), [_edge(y=0.2, friction=friction)], solver=rbd.ConeSolver())
    inertia = 10.0 / 12.0 * (0.4**2 + 0.2**2)
    about_edge = WEIGHT_N * 0.2 / (inertia + 10.0 * (0.2**2 + 0.1**2))
    assert s.a[3:] == pytest.approx([about_edge, 0.0, 0.0], abs=1e-9)
    assert s.forces["edge"][2] == pytest.approx(WEIGHT_N - 10.0 * 0.2 * about_edge, abs=1e-8)  # the centre falls
    wrench = s.forces["edge"]
    assert abs(wrench[3]) < 1e-12 and abs(s.contacts["edge"].centre_of_pressure[1] - 0.2) < 1e-12


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
def test_a_push_across_the_ends_shifts_the_load(solver):
    """Statics: 20 N along the line at the centre's height moves 20 * 0.1 / 0.3 N from one end to the other."""
    push = rbd.ExternalForce("box", (20.0, 0.0, 0.0))
    s = rbd.solve(_at(), np.zeros(0), [_edge(friction=0.8)], external=push, solver=solver)
    shift = 20.0 * 0.1 / 0.3
    assert s.corner_forces["edge"][:, 2] == pytest.approx([WEIGHT_N / 2 + shift, WEIGHT_N / 2 - shift], abs=1e-7)
    assert s.forces["edge"][:3] == pytest.approx([-20.0, 0.0, WEIGHT_N], abs=1e-7)


def test_ends_of_a_frictionless_line_only_push():
    """Pushed along a smooth line it slides away, and the moment about y is carried until an end is unloaded."""
    smooth = _edge(friction=0.0)
    s = rbd.solve(_at(), np.zeros(0), [smooth], external=rbd.ExternalForce("box", (30.0, 0.0, 0.0), (0.0, 4.0, 0.0)))
    assert s.a[:3] == pytest.approx([3.0, 0.0, 0.0], abs=1e-9)
    ends = s.corner_forces["edge"]
    assert not ends[:, :2].any() and ends[:, 2] == pytest.approx([WEIGHT_N / 2 + 4 / 0.3, WEIGHT_N / 2 - 4 / 0.3])
    tips = rbd.solve(_at(), np.zeros(0), [smooth], external=rbd.ExternalForce("box", (0.0, 0.0, 0.0), (0.0, 20.0, 0.0)))
    assert tips.corner_forces["edge"][1] == pytest.approx([0, 0, 0], abs=1e-8) and tips.a[4] > 0.1  # 20 > 98.1 * 0.15


def test_two_lines_are_a_surface():
    """Two opposite edges that push and rub carry what the patch between them carries: one acceleration, one wrench."""
    push = rbd.ExternalForce("box", (5.0, 11.0, -3.0), (0.4, -0.7, 1.5))
    edges = [_edge(y=0.2, friction=0.7, name="left"), _edge(y=-0.2, friction=0.7, name="right")]
    patch = rbd.SurfaceContact("floor", "box", half_lengths=(0.15, 0.2), placement=BELOW, friction=0.7)
    two, one = (rbd.solve(_at(), np.zeros(0), c, external=push) for c in (edges, [patch]))
    assert np.abs(two.a - one.a).max() < 1e-8
    assert sum(f[:3] for f in two.forces.values()) == pytest.approx(one.forces["floor"][:3], abs=1e-7)


def test_a_sliding_line_rubs_against_its_motion():
    """Slid across itself at 1 m/s: mu m g against the motion at its ends, and the load shifts to no end."""
    s = rbd.solve(_at(v=np.array([1.0, 0, 0, 0, 0, 0])), np.zeros(0), [_edge(friction=0.3)], solver=rbd.ConeSolver())
    assert s.forces["edge"][:3] == pytest.approx([-0.3 * WEIGHT_N, 0.0, WEIGHT_N], abs=1e-8)
    assert s.a[0] == pytest.approx(-0.3 * 9.81)


def test_a_turn_about_the_line_is_no_slip():
    """A box that tips about its edge is at rest there: the convex law takes it, and the edge feels the centripetal force."""
    w, up = 0.8, (0.0, 0.0, 1.0)
    arm = np.array([0.0, -0.2, 0.1])  # from the edge to the centre
    v = np.r_[np.cross([w, 0, 0], arm), w, 0.0, 0.0]
    s = rbd.solve(_at(v=v), np.zeros(0), [_edge(y=0.2, friction=0.9, on=rbd.Ground(normal=up))])
    # The middle of the line stays: centre's acceleration = w' x arm + w x (w x arm), force = m (that - g).
    angular = s.a[3:]
    centre = np.cross(angular, arm) + w**2 * np.array([0.0, 0.2, -0.1])
    assert s.forces["edge"][:3] == pytest.approx(10.0 * centre + [0.0, 0.0, WEIGHT_N], abs=1e-7)
    assert angular == pytest.approx([WEIGHT_N * 0.2 / (10 / 12 * 0.2 + 0.5), 0.0, 0.0], abs=1e-8)


def test_ends_of_a_line_that_rolls_and_spins_accelerate_as_points_do(talos, bent, rng):
    """From the five rows: c + L (0, c_z, -c_y) - L (w_y^2 + w_z^2) x; the roll's part w_x w of the ends is in the rows."""
    X_FP = pin.SE3(pin.exp3(rng.normal(size=3)), 0.2 * rng.normal(size=3))
    line = rbd.LineContact("edge", "left_sole_link", half_length=0.1, placement=X_FP, friction=0.5)
    state, a = bent.with_velocity(3.0 * rng.normal(size=talos.nv)), rng.normal(size=talos.nv)
    rows = line.rows(state)
    c, (wy, wz) = rows.J @ a + rows.bias, rows.velocity[3:]
    for L, offset in zip((0.1, -0.1), line.corners, strict=True):
        end = state.frame("left_sole_link", line.placement.act(offset))
        expected = rows.patch.axes.T @ (end.J @ a + end.bias)[:3]
        assert c[:3] + L * np.array([-(wy**2) - wz**2, c[4], -c[3]]) == pytest.approx(expected, abs=1e-11)


def test_a_rolled_box_keeps_the_grounds_normal():
    """Tipped by 30 deg about its edge: with `normal` the edge pushes along the ground's, without along the body's."""
    R = pin.exp3(np.array([np.pi / 6, 0.0, 0.0]))
    smooth = {"y": 0.2, "friction": 0.0}
    for more, expected in (({"on": rbd.Ground(normal=(0.0, 0.0, 1.0))}, [0.0, 0.0, 1.0]), ({}, R[:, 2])):
        patch = _edge(**smooth, **more).rows(_at(R)).patch
        assert patch.axes[:, 2] == pytest.approx(expected)
    force = rbd.solve(_at(R), np.zeros(0), [_edge(**smooth, on=rbd.Ground(normal=(0.0, 0.0, 1.0)))]).forces["edge"]
    assert not force[:2].any() and 0.0 < force[2] < WEIGHT_N


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
def test_answers_on_a_line_obey_the_law_recomputed(rng, solver):
    """Pushes and torques at random, sticking, slipping, tipping: residuals written down once more."""
    for _ in range(20):
        push = rbd.ExternalForce("box", 40.0 * rng.normal(size=3), 4.0 * rng.normal(size=3))
        s = rbd.solve(_at(), np.zeros(0), [_edge(friction=float(rng.uniform(0.2, 1.0)))], external=push, solver=solver)
        assert max(law_residuals(s.problem, s, solver.law).values()) < 1e-9


def test_the_anchor_of_a_line_does_not_feel_its_roll():
    """Shifted, swung and rolled: the error has the shift, the swing about y and z, and nothing of the roll."""
    start = _at()
    line = _edge(y=0.2).anchored(start)
    assert not line.rows(start).error.any()
    roll = pin.SE3(pin.exp3(np.array([0.5, 0.0, 0.0])), np.zeros(3))
    edge = pin.SE3(np.eye(3), np.array([0.0, 0.2, -0.1]))
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])) * edge * roll * edge.inverse()
    rolled = rbd.State(start.robot, pin.SE3ToXYZQUAT(X))
    assert line.rows(rolled).error == pytest.approx(np.zeros(5), abs=1e-15)
    swing = pin.SE3(pin.exp3(np.array([0.0, 1e-4, -2e-4])), np.array([1e-3, 2e-3, 3e-3]))
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])) * edge * roll * swing * edge.inverse()
    error = line.rows(rbd.State(start.robot, pin.SE3ToXYZQUAT(X))).error
    assert error == pytest.approx([1e-3, 2e-3, 3e-3, 1e-4, -2e-4], abs=1e-6)
    check_constraint(line, start, moving=False)


def test_no_torques_hold_a_robot_on_two_edges_off_its_centre(talos):
    """Statics takes lines: Talos on the middle lines of its soles is held; on one of them, beside its weight, it is not."""
    state = talos.standing()
    edges = [
        rbd.LineContact(sole.name, sole.frame, half_length=0.09, placement=sole.placement, friction=0.7)
        for sole in talos.soles()
    ]
    held = rbd.hold(state, edges)
    assert held.residuals.stationarity < 1e-6 and sum(f[2] for f in held.forces.values()) == pytest.approx(talos.mass * 9.81)
    with pytest.raises(rbd.CannotHold):
        rbd.hold(state, edges[:1])


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("half_length", {"half_length": 0.0}),
        ("half_length", {"half_length": -0.1}),
        ("half_length", {"half_length": np.nan}),
        ("half_length", {"half_length": "long"}),
        ("friction", {"half_length": 0.1, "friction": -1.0}),
        ("placement", {"half_length": 0.1, "placement": np.ones((4, 4))}),
        ("anchor", {"half_length": 0.1, "anchor": (0.0, 0.0, 0.0)}),
    ],
)
def test_a_line_that_means_nothing_is_refused(what, arguments):
    """By name, before any robot is involved."""
    with pytest.raises(rbd.InputError, match=what):
        rbd.LineContact("edge", "box", **arguments)


def test_a_normal_that_is_none_is_refused():
    """Of ground and of a body, before any contact."""
    for make in (rbd.Ground, lambda **given: rbd.Body("box", **given)):
        with pytest.raises(rbd.InputError, match="normal of the .* has length 2; expected a unit vector"):
            make(normal=(0.0, 0.0, 2.0))


def test_a_line_that_stands_on_the_ground_is_refused():
    """Its x axis along the normal: the placement is turned."""
    upright = pin.SE3(pin.exp3(np.array([0.0, np.pi / 2, 0.0])), np.zeros(3))
    with pytest.raises(rbd.InputError, match="90 degrees to its surface"):
        rbd.LineContact("edge", "box", half_length=0.1, placement=upright, on=rbd.Ground(normal=(0.0, 0.0, 1.0))).rows(_at())
