"""Holding torques: a robot at rest stays at rest, within its motors and its friction, or is told what is in the way."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog, nnls

import rbd
from rbd.arrays import Array
from rbd.errors import CannotHold, DuplicateName, InputError, NotAtRest
from rbd.problem.cones import pyramid
from rbd.statics.effort import FORCE_WEIGHT

G = 9.81
HALF = 0.1
"""Half the length and width of the box's foot [m]."""
ROBOTS = ["talos", "g1", "human", "romeo", "bolt", "solo12", "anymal_c"]
INERTIAL = '<inertial><mass value="{m}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'

Contacts = Sequence[rbd.SurfaceContact | rbd.PointContact]


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> rbd.Robot:
    """Ten kilograms, no joints; its frame is at its centre of mass."""
    path = tmp_path_factory.mktemp("box") / "box.urdf"
    path.write_text(f'<robot name="box"><link name="body">{INERTIAL.format(m=10)}</link></robot>')
    return rbd.load_robot(path)


def tilted(box: rbd.Robot, slope: float) -> rbd.State:
    """The box on a slope that falls along x."""
    return rbd.State(box, np.concatenate([np.zeros(3), pin.Quaternion(pin.rpy.rpyToMatrix(0.0, slope, 0.0)).coeffs()]))


def foot(
    friction: float | None, facets: int = 4, *, yaw: float = 0.0, at: Sequence[float] = (0.0, 0.0, 0.0)
) -> rbd.SurfaceContact:
    """A square patch on the box, its x axis turned by yaw from downhill."""
    X = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, yaw), np.array(at))
    return rbd.SurfaceContact("foot", "body", half_lengths=(HALF, HALF), placement=X, friction=friction, facets=facets)


def loads(held: rbd.Actuation, contacts: Contacts, external: Array | None = None) -> Array:
    """What is left of h = S^T tau + tau_ext + J^T f, with the forces put back through `frame`, shape (nv,)."""
    state = held.state
    total = state.robot.actuation.T @ held.tau - rbd.dynamics.bias_force(state)
    if external is not None:
        total += external
    for contact in contacts:
        offset = contact.offset if isinstance(contact, rbd.PointContact) else contact.placement.translation
        force = held.forces[contact.name]
        total += state.frame(contact.frame, offset).J[: len(force)].T @ force
    return total


# ------------------------------------------------------------------------------------------- what it promises


@pytest.mark.parametrize(("name", "friction"), list(itertools.product(ROBOTS, [None, 0.0, 0.4, 1.0])))
def test_forces_carry_the_weight_and_nothing_else_is_needed(name: str, friction: float | None) -> None:
    """Forces sum to m g to 1e-9 N, h = S^T tau + J^T f in every coordinate, the base's too: no torque on it, ever."""
    robot = rbd.load_robot(name)
    feet = robot.feet(friction)
    held = rbd.hold(robot.standing(), feet)
    total = sum(force[:3] for force in held.forces.values())
    assert np.abs(total - [0.0, 0.0, robot.mass * G]).max() < 1e-9
    assert held.tau.shape == (robot.nu,)
    assert np.abs(loads(held, feet)).max() < 1e-9
    assert held.residuals.stationarity < 1e-9


@pytest.mark.parametrize(("name", "friction"), list(itertools.product(ROBOTS, [None, 0.4, 1.0])))
def test_what_is_held_does_not_move(name: str, friction: float | None) -> None:
    """The least-constraint problem under the holding torques answers with zero acceleration, to 1e-7 m/s2."""
    robot = rbd.load_robot(name)
    state, feet = robot.standing(), robot.feet(friction)
    solution = rbd.solve(state, rbd.hold(state, feet).tau, feet)
    assert np.abs(solution.a).max() < 1e-7
    assert np.abs(sum(force[:3] for force in solution.forces.values()) - [0.0, 0.0, robot.mass * G]).max() < 1e-6


@pytest.mark.parametrize("facets", [4, 8])
@pytest.mark.parametrize("friction", [0.1, 0.7])
def test_corner_forces_lie_in_the_inscribed_pyramids(talos: rbd.Robot, friction: float, facets: int) -> None:
    """Facet k: f . (cos, sin)(2 pi k / n) <= mu cos(pi / n) f_n at each corner: so |f_t| <= mu f_n of the true cone too."""
    state, soles = talos.standing(), talos.soles(friction, facets=facets)
    push = [rbd.ExternalForce("torso_2_link", (20.0, 25.0, 0.0))]
    held = rbd.hold(state, soles, external=push, friction="inscribed")
    for sole in soles:
        patch = sole.rows(state).patch
        assert patch is not None
        corner = held.corner_forces[sole.name] @ patch.axes
        assert corner.shape == (4, 3) and (corner[:, 2] >= 0.0).all()
        for k in range(facets):
            angle = 2 * np.pi * k / facets
            out = corner[:, :2] @ [np.cos(angle), np.sin(angle)]
            assert (out <= friction * math.cos(math.pi / facets) * corner[:, 2] + 1e-6).all()
        assert (np.linalg.norm(corner[:, :2], axis=1) <= friction * corner[:, 2] + 1e-6).all()


@pytest.mark.parametrize("margin", [None, 0.0, 0.05, 0.3])
@pytest.mark.parametrize("friction", [0.1, 0.7])
def test_corner_forces_lie_in_the_cones_less_the_margin(talos: rbd.Robot, friction: float, margin: float | None) -> None:
    """|f_t| <= (1 - margin) mu f_n at each corner; unless told otherwise the margin is 5 %, where that can be."""
    state, soles = talos.standing(), talos.soles(friction)
    push = [rbd.ExternalForce("torso_2_link", (20.0, 25.0, 0.0))]
    held = rbd.hold(state, soles, external=push, margin=margin)
    kept = 0.05 if margin is None else margin
    assert held.margin == kept
    for sole in soles:
        patch = sole.rows(state).patch
        assert patch is not None
        corner = held.corner_forces[sole.name] @ patch.axes
        assert (np.linalg.norm(corner[:, :2], axis=1) <= (1.0 - kept) * friction * corner[:, 2] + 1e-9).all()
        assert np.nanmin(held.margins.corner_friction[sole.name]) >= kept - 1e-9


def test_where_the_margin_cannot_be_kept_friction_may_reach_its_limit(box: rbd.Robot) -> None:
    """A slope of 0.98 mu: held, with margin 0, which the words say; with a margin of 5 % asked for it is refused, and why."""
    state = tilted(box, math.atan(0.98 * 0.5))
    held = rbd.hold(state, [foot(0.5)])
    assert held.margin == 0.0 and abs(held.margins.friction["foot"] - 0.02) < 1e-9
    with pytest.raises(CannotHold, match="friction is kept 5 % from its limit, and prevents it; with margin=0 it could"):
        rbd.hold(state, [foot(0.5)], margin=0.05)
    at_it = rbd.hold(tilted(box, math.atan(0.5 * (1.0 - 1e-8))), [foot(0.5)])
    assert "friction is at its limit: with these torques other motions may be possible, too" in str(at_it)
    assert "limit" not in str(rbd.hold(tilted(box, 0.1), [foot(0.5)], margin=0.0))


def test_the_least_friction_of_a_refusal_has_room_for_the_margin(box: rbd.Robot) -> None:
    """On a slope of 0.6 with a fifth of friction left unused: 0.8 mu = 0.6, so 0.75; held above it, refused below."""
    state = tilted(box, math.atan(0.6))
    with pytest.raises(CannotHold, match=r"of 0\.75 at every contact would do \(the least is 0\.75\)"):
        rbd.hold(state, [foot(0.5)], margin=0.2)
    rbd.hold(state, [foot(0.7501)], margin=0.2)
    with pytest.raises(CannotHold):
        rbd.hold(state, [foot(0.7499)], margin=0.2)


def test_corner_forces_make_the_wrench(g1: rbd.Robot) -> None:
    """Their sum is the force; their moments about the patch's centre are the wrench's, in world axes."""
    state, soles = g1.standing(), g1.soles()
    held = rbd.hold(state, soles)
    for sole in soles:
        patch = sole.rows(state).patch
        assert patch is not None
        corners, arms = held.corner_forces[sole.name], patch.corners @ patch.axes.T
        wrench = np.concatenate([corners.sum(axis=0), np.cross(arms, corners).sum(axis=0)])
        assert np.abs(wrench - held.forces[sole.name]).max() < 1e-9


@pytest.mark.parametrize("name", ROBOTS)
def test_motors_stay_within_their_limits(name: str, exhaustive: bool) -> None:
    """In eight postures, or fifteen: |tau| <= limit, or CannotHold; margins.torque is 1 - |tau| / limit."""
    robot, rng, held = rbd.load_robot(name), np.random.default_rng(3), 0
    for _ in range(15 if exhaustive else 8):
        step = np.concatenate([np.zeros(6), rng.normal(size=robot.nv - 6) * 0.1])
        q = rbd.robots.posture.stand(robot, pin.integrate(robot.model, robot.standing().q, step), robot.feet())
        try:
            found = rbd.hold(rbd.State(robot, q), robot.feet(1.0, on=None))
        except CannotHold:
            continue
        held += 1
        assert (np.abs(found.tau) <= robot.effort_limit * (1.0 + 1e-9)).all()
        assert np.array_equal(found.margins.torque, 1.0 - np.abs(found.tau) / robot.effort_limit)
        assert np.abs(loads(found, robot.feet(1.0))).max() < 1e-8
    assert held > 0


def test_a_weaker_motor_is_spared() -> None:
    """With a hip's limit set a tenth below what it bore, it bears no more than that, and the others take over."""
    robot = rbd.load_robot("talos")
    state, soles = robot.standing(), robot.soles()
    before = rbd.hold(state, soles)
    hip = robot.actuated_names.index("leg_left_2_joint")
    robot.effort_limit[hip] = 0.9 * abs(before.tau[hip])
    after = rbd.hold(state, soles)
    assert abs(after.tau[hip]) <= robot.effort_limit[hip] * (1.0 + 1e-9)
    assert np.abs(loads(after, soles)).max() < 1e-9


# -------------------------------------------------------------------------------------------------- optimality


def corner_system(state: rbd.State, contacts: Contacts) -> tuple[Array, Array, Array]:
    """(rays, A, T): each corner's inscribed pyramid in W as columns; their base loads; their joint loads."""
    columns = []
    for contact in contacts:
        patch = contact.rows(state).patch
        assert patch is not None and contact.friction
        for corner in patch.corners @ patch.axes.T:
            rays = patch.axes @ pyramid(contact.friction, contact.facets, inscribed=True)
            at = state.frame(contact.frame)
            arm = patch.point + corner - at.X_WF.translation
            J = at.J[:3] - pin.skew(arm) @ at.J[3:]
            columns.append(J.T @ rays)
    loads = np.hstack(columns)
    return loads, loads[:6], loads[state.robot.actuated]


@pytest.mark.parametrize(
    ("name", "friction", "facets"), [("talos", 0.7, 4), ("talos", 0.2, 8), ("g1", 0.7, 4), ("solo12", 0.5, 4)]
)
def test_nothing_feasible_is_better(name: str, friction: float, facets: int, exhaustive: bool) -> None:
    """First-order optimality of a convex program: the objective does not fall towards any of 100 or 200 vertices.

    sum (tau / limit)^2 + small weight * sum (ray weight / m g)^2, over ray weights w >= 0 that balance the base; feasible
    vertices come from linear programs with random costs. Ray weights are recovered from the corner forces.
    """
    robot = rbd.load_robot(name)
    state, feet = robot.standing(), robot.feet(friction, facets=facets)
    held = rbd.hold(state, feet, friction="inscribed", margin=0.0)
    unit, h = robot.mass * G, rbd.dynamics.bias_force(state)
    _, A, T = corner_system(state, feet)
    A, T = A * unit, T * unit
    w = []
    for contact in feet:
        patch = contact.rows(state).patch
        assert patch is not None
        rays = pyramid(friction, facets, inscribed=True)
        for force in held.corner_forces[contact.name] @ patch.axes:
            # The least-squares weights of a corner's force: a small ridge picks the one of least norm.
            ridge = 1e-7 * np.eye(facets)
            w.append(nnls(np.vstack([rays, ridge]), np.r_[force / unit, np.zeros(facets)])[0])
    x = np.concatenate(w)
    assert np.abs(A @ x - h[:6]).max() < 1e-6 * unit
    limit = robot.effort_limit
    tau = h[robot.actuated] - T @ x
    assert np.abs(tau - held.tau).max() < 1e-5 * unit
    slope = -2.0 * T.T @ (tau / limit**2) + 2.0 * FORCE_WEIGHT * x
    value = float(((tau / limit) ** 2).sum() + FORCE_WEIGHT * (x @ x))
    rng = np.random.default_rng(5)
    reached, count = 0, 200 if exhaustive else 100
    for cost in rng.normal(size=(count, len(x))):
        vertex = linprog(cost + 0.5, A_eq=A / unit, b_eq=h[:6] / unit, bounds=(0.0, None), method="highs")
        if vertex.status != 0 or (np.abs(h[robot.actuated] - T @ vertex.x) > limit).any():
            continue
        reached += 1
        assert slope @ (vertex.x - x) > -1e-5 * value
    assert reached > count // 4


def test_of_forces_that_cost_no_torque_the_even_ones_are_chosen(box: rbd.Robot) -> None:
    """A box has no motors: its four corners carry a quarter of the weight each."""
    held = rbd.hold(tilted(box, 0.0), [foot(0.5)])
    assert np.abs(held.corner_forces["foot"] - [0.0, 0.0, 10 * G / 4]).max() < 1e-9


# ------------------------------------------------------------------------------------------ arms and held contacts


def test_a_fixed_arm_is_held_by_its_gravity_torques() -> None:
    """No contacts, nothing to choose: tau = -tau_g to rounding, and the arm stays where it is."""
    panda = rbd.load_robot("panda", root="fixed")
    state = panda.standing()
    held = rbd.hold(state, [])
    assert np.abs(held.tau + rbd.dynamics.gravity_torque(state)).max() < 1e-13
    assert not held.forces and not held.corner_forces and held.residuals.stationarity == 0.0
    assert np.abs(rbd.solve(state, held.tau).a).max() < 1e-11


def test_motors_without_stated_limits_are_no_obstacle(tmp_path: Path) -> None:
    """Limits of inf: held, with a torque margin of one, and the words say that no limits are stated."""
    robot = rbd.load_robot("double_pendulum", root="fixed")
    assert np.isinf(robot.effort_limit).all()
    state = robot.at(np.array([0.5, 0.4]))
    held = rbd.hold(state, [])
    assert np.abs(held.tau + rbd.dynamics.gravity_torque(state)).max() < 1e-14
    assert held.margins.torque.tolist() == [1.0, 1.0]
    assert "no limits are stated" in str(held)
    hinge = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>'
    arm = INERTIAL.replace("<mass", '<origin xyz="0.2 0 0"/><mass').format(m=2)
    path = tmp_path / "r.urdf"
    path.write_text(f'<robot name="r"><link name="a">{INERTIAL.format(m=5)}</link><link name="b">{arm}</link>{hinge}</robot>')
    robot = rbd.load_robot(path)
    held = rbd.hold(robot.at(), [rbd.SurfaceContact("foot", "a", half_lengths=(0.3, 0.3), friction=0.5)])
    assert abs(held.tau[0] + 2 * G * 0.2) < 1e-9
    assert abs(held.forces["foot"][2] - 7 * G) < 1e-9


def test_a_contact_that_holds_may_pull(talos: rbd.Robot) -> None:
    """Talos hung by its pelvis from one held patch: the patch pulls up with the whole weight, above or below it alike."""
    for up in (0.3, -0.3):
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, up]))
        hook = rbd.SurfaceContact("hook", "base_link", half_lengths=(0.1, 0.1), placement=at)
        held = rbd.hold(talos.standing(), [hook])
        assert np.abs(held.forces["hook"][:3] - [0.0, 0.0, talos.mass * G]).max() < 1e-9
        assert held.margins.friction == {}
        assert held.corner_forces["hook"].shape == (4, 3)


def test_passive_joints_get_no_torque_and_are_held_all_the_same() -> None:
    """With free ankles (roll) Talos stands; free in pitch it cannot, as its weight is 6 mm off the ankles' axis."""
    ankles = ["leg_left_6_joint", "leg_right_6_joint"]
    robot = rbd.load_robot("talos", passive=ankles)
    state, soles = robot.standing(), robot.soles()
    held = rbd.hold(state, soles)
    assert held.tau.shape == (30,)
    assert np.abs(loads(held, soles)).max() < 1e-9
    assert np.abs(rbd.solve(state, held.tau, soles).a).max() < 1e-7


def test_a_passive_joint_that_would_need_torque_is_named() -> None:
    """A free elbow under a bent arm, a free shoulder of Panda: they are in the way, not the feet or the motors."""
    robot = rbd.load_robot("talos", passive=["arm_left_4_joint", "leg_left_6_joint"])
    with pytest.raises(CannotHold, match="'arm_left_4_joint' would need torque, and is passive"):
        rbd.hold(robot.standing(), robot.soles())
    panda = rbd.load_robot("panda", root="fixed", passive=["panda_joint2"])
    with pytest.raises(CannotHold, match="'panda_joint2' would need torque, and is passive"):
        rbd.hold(panda.standing(), [])


@pytest.mark.parametrize("push", [(60.0, 0.0, 0.0), (0.0, 45.0, 0.0), (-30.0, 20.0, 100.0)])
def test_a_push_is_held(talos: rbd.Robot, push: tuple[float, float, float]) -> None:
    """Weight and push together are balanced, to 1e-9 N, and the pushed robot stays still under those torques."""
    state, soles = talos.standing(), talos.soles()
    external = [rbd.ExternalForce("torso_2_link", push)]
    held = rbd.hold(state, soles, external=external)
    total = sum(force[:3] for force in held.forces.values()) + np.array(push)
    assert np.abs(total - [0.0, 0.0, talos.mass * G]).max() < 1e-9
    tau_ext = state.frame("torso_2_link").J[:3].T @ push
    assert np.abs(loads(held, soles, tau_ext)).max() < 1e-9
    assert np.abs(rbd.solve(state, held.tau, soles, external=external).a).max() < 1e-7
    assert np.abs(rbd.hold(state, soles, external=tau_ext).tau - held.tau).max() < 1e-6


# ------------------------------------------------------------------------------------------------------ margins


def test_margins_of_a_box_by_hand(box: rbd.Robot) -> None:
    """Pushed with F at its foot's centre and turned by m: friction 1 - F / (mu W), centre of pressure m / W off the middle."""
    W, F, m = 10 * G, 12.0, 3.0
    held = rbd.hold(tilted(box, 0.0), [foot(0.5)], external=[rbd.ExternalForce("body", (F, 0.0, 0.0), (0.0, m, 0.0))])
    contact = held.contacts["foot"]
    assert contact.centre_of_pressure is not None
    assert np.abs(contact.centre_of_pressure - [m / W, 0.0, 0.0]).max() < 1e-9
    assert abs(held.margins.friction["foot"] - (1.0 - F / (0.5 * W))) < 1e-9
    assert abs(held.margins.centre_of_pressure["foot"] - (HALF - m / W)) < 1e-9
    assert held.margins.torque.shape == (0,)


def test_contacts_without_a_coefficient_have_no_friction_margin(talos: rbd.Robot) -> None:
    """A held sole and a frictionless one: no friction used, but a centre of pressure inside the patch where it pushes."""
    for friction in (None, 0.0):
        margins = rbd.hold(talos.standing(), talos.soles(friction)).margins
        assert margins.friction == {}
        assert min(margins.centre_of_pressure.values()) > 0.0
    assert rbd.hold(rbd.load_robot("solo12").standing(), rbd.load_robot("solo12").feet()).margins.centre_of_pressure == {}


def test_a_hold_tells_itself(talos: rbd.Robot, box: rbd.Robot) -> None:
    """One line of the largest torque and its motor, one line a contact; a box has no motors to speak of."""
    text = str(rbd.hold(talos.standing(), talos.soles()))
    assert text.startswith("held: largest torque ") and "% of its limit (" in text
    assert text.count("\n") == 2 and "left_sole" in text
    assert str(rbd.hold(tilted(box, 0.0), [foot(0.5)])).startswith("held: without motors")


# --------------------------------------------------------------------------------------------- what is in the way

FACETS = [
    (4, 0.0, math.cos(math.pi / 4)),
    (4, math.pi / 4, 1.0),
    (8, 0.0, math.cos(math.pi / 8)),
    (8, math.pi / 8, 1.0),
    (8, math.pi / 4, math.cos(math.pi / 8)),
]


@pytest.mark.parametrize(("facets", "yaw", "reach"), FACETS)
@pytest.mark.parametrize("slope", [0.1, 0.5])
def test_a_slope_is_held_up_to_the_inscribed_pyramid(
    box: rbd.Robot, slope: float, facets: int, yaw: float, reach: float
) -> None:
    """Held while tan(slope) <= mu reach; reach is cos(pi / n) across a facet and 1 along a ray. Above, friction is named.

    What is named is what the circular cone needs, tan(slope).
    """
    mu = math.tan(slope) / reach
    state = tilted(box, slope)
    held = rbd.hold(state, [foot(mu * (1.0 + 1e-6), facets, yaw=yaw)], friction="inscribed")
    assert abs(held.margins.friction["foot"] - (1.0 - reach)) < 1e-5
    with pytest.raises(CannotHold, match="friction prevents it.*circular") as caught:
        rbd.hold(state, [foot(mu * (1.0 - 1e-5), facets, yaw=yaw)], friction="inscribed")
    needed = float(str(caught.value).split("coefficient of ")[1].split()[0])
    assert -3e-6 * needed < needed - math.tan(slope) < 1e-3 * needed  # told to four digits, rounded up


@pytest.mark.parametrize("yaw", [0.0, 0.3, math.pi / 4, 2.0])
@pytest.mark.parametrize("slope", [0.1, 0.5, 1.2])
def test_a_slope_is_held_up_to_mu_itself_whatever_its_direction(box: rbd.Robot, slope: float, yaw: float) -> None:
    """Circular cones: held while tan(slope) <= mu (1 - 1e-6), refused with a proof beyond mu (1 + 1e-6), facets or not."""
    mu, state = math.tan(slope), tilted(box, slope)
    held = rbd.hold(state, [foot(mu * (1.0 + 1e-6), yaw=yaw)])
    assert held.status == "solved" and abs(held.margins.friction["foot"]) < 2e-6
    with pytest.raises(CannotHold, match="friction prevents it; a coefficient of") as caught:
        rbd.hold(state, [foot(mu * (1.0 - 1e-6), yaw=yaw)])
    assert caught.value.certificate is not None
    assert [limit.kind for limit in caught.value.limits] == ["friction", "base"]


@pytest.mark.parametrize("slope", [0.1, 0.5])
def test_a_point_on_a_slope_needs_the_same_friction(box: rbd.Robot, slope: float) -> None:
    """A point under the centre of mass, the ground's normal tilted: tan(slope) <= mu; inscribed, mu cos(pi / 4) along x."""
    normal = (math.sin(slope), 0.0, math.cos(slope))
    state = tilted(box, 0.0)
    for kind, reach in (("cone", 1.0), ("inscribed", math.cos(math.pi / 4))):
        mu = math.tan(slope) / reach
        toe = rbd.PointContact("toe", "body", on=rbd.Ground(normal=normal), friction=mu * (1.0 + 1e-6))
        rbd.hold(state, [toe], friction=kind)
        for friction in (mu * (1.0 - 1e-5), 0.0):
            with pytest.raises(CannotHold, match="friction prevents it"):
                rbd.hold(state, [toe.with_friction(friction)], friction=kind)


@pytest.mark.parametrize("side", [(1, 0), (-1, 0), (0, 1), (1, 1)])
def test_a_box_is_held_while_its_centre_of_mass_is_over_its_foot(box: rbd.Robot, side: tuple[int, int]) -> None:
    """Patch moved aside until its edge is under the centre of mass: held a micron inside; a millimetre outside, said."""
    for off, held in ((HALF - 1e-6, True), (HALF + 1e-3, False)):
        contact = foot(0.5, at=(side[0] * off, side[1] * off, -0.2))
        if held:
            margin = rbd.hold(tilted(box, 0.0), [contact]).margins.centre_of_pressure["foot"]
            assert abs(margin - 1e-6) < 1e-9
        else:
            beyond = np.linalg.norm(side)  # a millimetre beyond an edge, or beyond two: from the corner
            with pytest.raises(CannotHold, match=f"balance its weight .* {beyond:.1f} mm outside the hull of the contact"):
                rbd.hold(tilted(box, 0.0), [contact])


def test_a_robot_that_leans_is_told_by_how_much(talos: rbd.Robot) -> None:
    """Talos with its ankles bent by 0.15 rad: its support is in the way, 29 mm of it; neither friction nor a motor."""
    q = talos.standing().q.copy()
    for joint in ("leg_left_5_joint", "leg_right_5_joint"):
        q[talos.model.joints[talos.joint_id(joint)].idx_q] -= 0.15
    state = rbd.State(talos, rbd.robots.posture.stand(talos, q, talos.feet()))
    corners = rbd.robots.posture.corner_points(state, talos.feet())[:, :2]
    outside = -rbd.constraints.convex.polygons.inside_distance(
        state.com[:2], rbd.constraints.convex.polygons.convex_hull(corners)
    )
    with pytest.raises(CannotHold, match="centre of mass at x = ") as caught:
        rbd.hold(state, talos.soles())
    assert f"{1e3 * outside:.1f} mm outside" in str(caught.value)
    assert "friction is" not in str(caught.value) and "torque limit" not in str(caught.value)


def test_a_push_beyond_the_foot_is_told_as_such(talos: rbd.Robot) -> None:
    """300 N forward at the shoulders, on feet that only push and rub: weight and push do not balance; held feet pull."""
    push = [rbd.ExternalForce("torso_2_link", (300.0, 0.0, 0.0))]
    with pytest.raises(CannotHold, match="balance its weight and the external forces.*Push less"):
        rbd.hold(talos.standing(), talos.soles(5.0), external=push)
    assert rbd.hold(talos.standing(), talos.soles(None), external=push).residuals.stationarity < 1e-9


def test_a_push_that_slips_is_told_as_such(talos: rbd.Robot) -> None:
    """At the ground, 300 N sideways on 885.6 N: circular cones need 0.339, and 0.3 is given; four facets inside need more."""
    push = [rbd.ExternalForce("left_sole_link", (0.0, 300.0, 0.0))]
    with pytest.raises(CannotHold, match="friction prevents it") as caught:
        rbd.hold(talos.standing(), talos.soles(0.3), external=push)
    needed = float(str(caught.value).split("coefficient of ")[1].split()[0])
    least = 300.0 / (talos.mass * G)  # and a little more, as the push turns the robot about the vertical
    assert least < needed < 1.002 * least
    rbd.hold(talos.standing(), talos.soles(needed), external=push)
    rbd.hold(talos.standing(), talos.soles(needed * 1.01 * math.sqrt(2)), external=push, friction="inscribed")
    rbd.hold(talos.standing(), talos.soles(needed * 1.01, facets=64), external=push, friction="inscribed")


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_an_overloaded_arm_names_its_joint(name: str) -> None:
    """A load in the hand, increased until one motor is at its limit: held just below; just above, that joint is named."""
    robot = rbd.load_robot(name, root="fixed")
    q = robot.standing().q.copy()
    q[1:4] = [0.4, 0.3, -0.5]
    state = robot.at(q)
    hand = {"panda": "panda_hand", "ur5": "wrist_3_link"}[name]
    own, each = rbd.dynamics.bias_force(state), state.frame(hand).J[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        room = (robot.effort_limit * np.sign(each) - own) / each  # kg g at which each joint is at its limit
    worst = int(np.argmin(np.where(room > 0.0, room, np.inf)))
    load = room[worst]
    held = rbd.hold(state, [], external=[rbd.ExternalForce(hand, (0.0, 0.0, -load * (1.0 - 1e-6)))])
    assert np.argmin(held.margins.torque) == worst and 0.0 <= held.margins.torque[worst] < 1e-5
    joint = robot.actuated_names[worst]
    with pytest.raises(CannotHold, match=rf"a torque limit prevents it\. At best '{joint}' needs 1.*% of its limit"):
        rbd.hold(state, [], external=[rbd.ExternalForce(hand, (0.0, 0.0, -load * 1.01))])


def test_of_many_motors_the_one_in_the_way_is_named(talos: rbd.Robot) -> None:
    """150 N in the left hand: the elbow's limit is too low whatever the feet do; the legs are not blamed."""
    load = [rbd.ExternalForce("arm_left_7_link", (0.0, 0.0, -150.0))]
    state = talos.standing()
    elbow = talos.actuated_names.index("arm_left_4_joint")
    at = talos.actuated[elbow]
    need = rbd.dynamics.bias_force(state)[at] + 150.0 * state.frame("arm_left_7_link").J[2, at]
    percent = 100 * abs(need) / talos.effort_limit[elbow]
    with pytest.raises(CannotHold, match="torque limit") as caught:
        rbd.hold(state, talos.soles(2.0), external=load)
    assert f"At best 'arm_left_4_joint' needs {percent:.4g} % of its limit" in str(caught.value)
    assert "leg" not in str(caught.value)


def test_on_two_points_a_push_across_their_line_is_not_held() -> None:
    """Bolt stands on a line: a push along it is held, one across it is not."""
    robot = rbd.load_robot("bolt")
    state, feet = robot.standing(), robot.feet()
    assert rbd.hold(state, feet, external=[rbd.ExternalForce("base_link", (0.0, 0.5, 0.0))]).residuals.stationarity < 1e-9
    with pytest.raises(CannotHold, match="balance its weight and the external forces"):
        rbd.hold(state, feet, external=[rbd.ExternalForce("base_link", (0.5, 0.0, 0.0))])


def test_without_contacts_only_what_does_not_fall_is_held(talos: rbd.Robot) -> None:
    """A floating robot needs contacts, unless something else carries it: its weight, pushed up at the centre of mass."""
    with pytest.raises(CannotHold, match="it has no contact, so nothing carries its weight"):
        rbd.hold(talos.standing(), [])
    state = talos.standing()
    held = rbd.hold(state, [], external=np.concatenate([rbd.dynamics.bias_force(state)[:6], np.zeros(32)]))
    assert np.abs(held.tau - rbd.dynamics.bias_force(state)[6:]).max() < 1e-9


def test_a_cannot_hold_is_a_no_solution(talos: rbd.Robot) -> None:
    """It stands in our tree below NoSolution, as there is no answer."""
    with pytest.raises(rbd.NoSolution):
        rbd.hold(talos.standing(), [])


# ---------------------------------------------------------------------------------------------------- bad input


def test_a_moving_robot_is_not_at_rest(talos: rbd.Robot) -> None:
    """A velocity above 1e-9 is refused with its size; below, it is rounding."""
    q, v = talos.standing().q, np.zeros(talos.nv)
    v[12] = 2e-9
    with pytest.raises(NotAtRest, match=r"\|v\| reaches 2e-09"):
        rbd.hold(rbd.State(talos, q, v), talos.soles())
    v[12] = 1e-10
    rbd.hold(rbd.State(talos, q, v), talos.soles())


def test_two_contacts_of_one_name_are_refused(talos: rbd.Robot) -> None:
    """Their forces could not be told apart."""
    with pytest.raises(DuplicateName, match="two contacts are named 'left_sole'"):
        rbd.hold(talos.standing(), [talos.soles()[0]] * 2)


@pytest.mark.parametrize("contacts", [None, 3, "left_sole", ["left_sole"], [None], object(), [[]], rbd.SurfaceContact])
def test_contacts_that_are_none_are_refused(talos: rbd.Robot, contacts: object) -> None:
    """As in `solve`."""
    with pytest.raises(InputError, match="constraint"):
        rbd.hold(talos.standing(), contacts)  # type: ignore[arg-type]


def test_contacts_may_be_any_iterable(talos: rbd.Robot) -> None:
    """A tuple, a list, a generator: the same torques."""
    soles, state = talos.soles(), talos.standing()
    for contacts in (tuple(soles), (sole for sole in soles)):
        held = rbd.hold(state, contacts)  # type: ignore[arg-type]
        assert np.abs(held.tau - rbd.hold(state, soles).tau).max() < 1e-9


@pytest.mark.parametrize("state", [None, "talos", np.zeros(39)])
def test_a_state_that_is_none_is_refused(talos: rbd.Robot, state: object) -> None:
    """With what to make one with."""
    with pytest.raises(InputError, match="a State of a robot was expected first"):
        rbd.hold(state, talos.soles())  # type: ignore[arg-type]


def test_a_ground_that_moves_is_refused(talos):
    """Statics on a lift that starts, or on a belt, would be the answer to another question."""
    state, sole = talos.standing(), talos.soles()[0]
    for motion in ({"acceleration": (0.0, 0.0, 1.0)}, {"velocity": (0.1, 0.0, 0.0)}):
        moving = rbd.SurfaceContact(
            sole.name, sole.frame, corners=sole.corners, placement=sole.placement, friction=0.7, on=rbd.Ground(**motion)
        )
        with pytest.raises(rbd.errors.NotAtRest, match="ground at rest.*left_sole"):
            rbd.hold(state, [moving, talos.soles()[1]])
