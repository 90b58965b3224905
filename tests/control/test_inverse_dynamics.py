"""Inverse dynamics under contact: solving forward gives the motion back; effort and verdicts as by another solver."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from moving_states import NAMES, Moving, drawn, robot, still_at_contacts
from second_conic import Whole, by_scs

import rbd
from rbd.arrays import Array
from rbd.errors import CannotMove, ContactMoves, DuplicateName, InputError, JointNotFound, UnknownName
from rbd.statics import Effort, Limit
from rbd.testing import box, law_residuals

G = 9.81
PUSHED = {"talos": "torso_2_link", "g1": "torso_link", "solo12": "base_link", "leg": "foot"}


def wanted(one: rbd.Robot, rng: np.random.Generator, size: float = 0.5) -> tuple[Moving, Array]:
    """A moving state and an acceleration that keeps its contacts still."""
    moving = drawn(one, rng)
    return moving, still_at_contacts(moving, size * rng.normal(size=one.nv))


def off(found: rbd.Solution, a: Array) -> float:
    """How far a motion is from a wanted one, relative, in the metric of inertia."""
    M, e = found.problem.M, found.a - a
    return math.sqrt(e @ M @ e / max(1e-3, a @ M @ a))


# ---------------------------------------------------------------------------------------------------- the round trip


@pytest.mark.parametrize("name", NAMES)
def test_the_torques_bring_the_motion_about(name: str, exhaustive: bool) -> None:
    """Random moving states: `solve` with the torques gives back a to 1e-8, under both laws; equations and limits are met."""
    one, rng = robot(name), np.random.default_rng(7)
    count, refused, wanted_count = 0, 0, 1000 if exhaustive else 25
    while count < wanted_count:
        moving, a = wanted(one, rng)
        try:
            found = rbd.inverse_dynamics(moving.state, a, moving.contacts)
        except CannotMove:
            refused += 1
            assert refused < 20 + count
            continue
        count += 1
        assert found.status == "solved" and (np.abs(found.tau) <= one.effort_limit * (1.0 + 1e-9)).all()
        for law in ("convex", "coulomb"):
            back = rbd.solve(moving.state, found.tau, moving.contacts, law=law)
            assert off(back, a) < 1e-8, (count, law)
        J = np.concatenate([c.rows(moving.state).J for c in moving.contacts])
        f = found.answer.multipliers
        left = moving.state.M @ a + rbd.dynamics.bias_force(moving.state) - one.actuation.T @ found.tau - J.T @ f
        assert np.abs(left).max() < 1e-9 * max(1.0, one.mass * G)


@pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
def test_motions_that_slip_and_open_have_torques(name: str, exhaustive: bool) -> None:
    """A of `solve` under random torques, on soles of friction 0.3: torques are found, of no more effort, that bring it about.

    That they do is judged by Coulomb's law written down once more; `solve` gives it back where a sole that slips and turns
    has no other motion.
    """
    one, rng = robot(name), np.random.default_rng(11)
    modes, count, back = set(), 0, 0
    while count < (300 if exhaustive else 20):
        moving = drawn(one, rng, friction=0.3)
        state = moving.state
        try:
            tau = rbd.hold(rbd.State(one, state.q), moving.contacts).tau
        except rbd.CannotHold:
            continue
        tau = np.clip(tau + 0.1 * one.effort_limit * rng.normal(size=one.nu), -one.effort_limit, one.effort_limit)
        moved = rbd.solve(state, tau, moving.contacts, check=False)
        if moved.status != "solved":
            continue
        count += 1
        found = rbd.inverse_dynamics(state, moved.a, moving.contacts, margin=0.0)
        assert found.status == "solved" and (np.abs(found.tau) <= one.effort_limit * (1.0 + 1e-9)).all()
        assert max(law_residuals(found.answer.problem, found.answer, "coulomb").values()) < 1e-7
        own = ((tau / one.effort_limit) ** 2).sum() + 1e-4 * len(found.weights) * 4.0
        assert ((found.tau / one.effort_limit) ** 2).sum() <= own
        modes |= {e.size for e in found.loads.sets.elements} | {bool(u) for u in found.loads.sets.upper if u == 0.0}
        back += off(rbd.solve(state, found.tau, moving.contacts, check=False), moved.a) < 1e-8
    assert {1, 3} <= modes and False in modes  # points that slip, points that keep still, points that open
    assert back > 0.5 * count


def test_motions_that_are_possible_but_for_rounding_are_possible() -> None:
    """Forces of a foot that slips are on a line, six equations for one number: they hold to rounding of what is added up."""
    one, rng = robot("solo12"), np.random.default_rng(11)
    for _ in range(20):
        moving = drawn(one, rng, friction=0.3)
        tau = 0.3 * one.effort_limit * rng.normal(size=one.nu)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rbd.errors.RbdWarning)
            moved = rbd.solve(moving.state, tau, moving.contacts, check=False)
        limit = np.abs(tau / one.effort_limit).max()
        if moved.status == "solved" and limit < 1.0:
            a = moved.a * (1.0 + 1e-11 * rng.normal(size=one.nv))
            assert rbd.inverse_dynamics(moving.state, a, moving.contacts, margin=0.0).status == "solved"


def test_pyramids_inside_the_cones_are_kept(talos: rbd.Robot) -> None:
    """friction="inscribed": each corner's force is within the facets' planes, the margin kept."""
    rng = np.random.default_rng(3)
    moving, a = wanted(talos, rng, 0.2)
    cone = rbd.inverse_dynamics(moving.state, a, moving.contacts)
    inside = rbd.inverse_dynamics(moving.state, a, moving.contacts, friction="inscribed")
    assert off(rbd.solve(moving.state, inside.tau, moving.contacts), a) < 1e-8
    for contact in moving.contacts:
        patch = contact.rows(moving.state).patch
        corner = inside.corner_forces[contact.name] @ patch.axes
        for k in range(4):
            out = corner[:, :2] @ [math.cos(k * math.pi / 2), math.sin(k * math.pi / 2)]
            assert (out <= 0.95 * 0.7 * math.cos(math.pi / 4) * corner[:, 2] + 1e-7).all()
    efforts = []
    for found in (cone, inside):
        corners = sum(float((f**2).sum()) for f in found.corner_forces.values())
        efforts.append(((found.tau / talos.effort_limit) ** 2).sum() + 1e-4 * corners / (talos.mass * G) ** 2)
    assert efforts[0] <= efforts[1] + 1e-9


def test_hold_is_inverse_dynamics_at_rest(talos: rbd.Robot) -> None:
    """A = 0, v = 0: the same torques and forces."""
    state, push = talos.standing(), rbd.ExternalForce("torso_2_link", (10.0, 40.0, 0.0))
    for margin in (0.0, 0.05, 0.4):
        held = rbd.hold(state, talos.soles(), external=push, margin=margin)
        moved = rbd.inverse_dynamics(state, np.zeros(talos.nv), talos.soles(), external=push, margin=margin)
        assert np.array_equal(held.tau, moved.tau) and held.still and moved.still


def test_external_forces_take_their_part(talos: rbd.Robot) -> None:
    """Generalised or at a frame: the same torques; with S^T of the torques themselves nothing is left for the motors."""
    rng = np.random.default_rng(5)
    moving, a = wanted(talos, rng, 0.2)
    push = rbd.ExternalForce("torso_2_link", (10.0, -20.0, 5.0))
    e = moving.state.frame("torso_2_link").J[:3].T @ [10.0, -20.0, 5.0]
    by_frame = rbd.inverse_dynamics(moving.state, a, moving.contacts, external=[push])
    by_v = rbd.inverse_dynamics(moving.state, a, moving.contacts, external=e)
    assert np.abs(by_frame.tau - by_v.tau).max() < 1e-8
    assert off(rbd.solve(moving.state, by_v.tau, moving.contacts, external=e), a) < 1e-8
    helped = rbd.inverse_dynamics(moving.state, a, moving.contacts, external=e + talos.actuation.T @ by_v.tau)
    assert ((helped.tau / talos.effort_limit) ** 2).sum() <= 1e-3


# ------------------------------------------------------------------------------------------------- another solver


@pytest.mark.parametrize("name", NAMES)
def test_the_effort_is_least_by_another_solver(name: str, exhaustive: bool) -> None:
    """SCS on equations that are assembled here, torques as unknowns beside the forces: the same effort, the same torques."""
    one, rng, count = robot(name), np.random.default_rng(13), 0
    weight = one.mass * G
    limit = np.where(np.isfinite(one.effort_limit), one.effort_limit, weight)
    while count < (50 if exhaustive else 13):
        moving, a = wanted(one, rng, 0.3)
        try:
            found = rbd.inverse_dynamics(moving.state, a, moving.contacts)
        except CannotMove:
            continue
        count += 1
        whole = Whole.of(moving.state, moving.contacts, 0.05)
        squares = np.full(whole.columns.shape[1], 2e-4)
        squares[: one.nu] = 2.0
        need = moving.state.M @ a + rbd.dynamics.bias_force(moving.state)
        other = by_scs(whole.program(need, squares, np.zeros(len(squares))))
        assert other.status == "solved"
        effort = ((found.tau / limit) ** 2).sum() + 1e-4 * ((found.weights / weight) ** 2).sum()
        assert effort == pytest.approx(other.value, rel=1e-6)
        assert np.abs(other.x[: one.nu] * limit - found.tau).max() < 1e-4 * limit.max()


@pytest.mark.parametrize("name", NAMES)
def test_the_verdict_turns_where_another_solver_puts_the_limit(name: str, exhaustive: bool) -> None:
    """The largest push s in a drawn direction by SCS: possible at s less 1e-5 of it, refused with a proof at 1e-5 more."""
    one, rng, count = robot(name), np.random.default_rng(17), 0
    while count < (125 if exhaustive else 5):
        moving, a = wanted(one, rng, 0.3)
        state = moving.state
        direction = rng.normal(size=3)
        push = state.frame(PUSHED[name]).J[:3].T @ direction * one.mass * G
        whole = Whole.of(state, moving.contacts, 0.05, push[:, None])
        g = np.zeros(whole.columns.shape[1])
        g[-1] = -1.0
        other = by_scs(whole.program(state.M @ a + rbd.dynamics.bias_force(state), np.zeros(len(g)), g))
        if other.status != "solved":
            continue
        count += 1
        most = float(other.x[-1])
        room = 1e-5 * max(1e-2, abs(most))
        found = rbd.inverse_dynamics(state, a, moving.contacts, external=(most - room) * push)
        assert found.status == "solved"
        with pytest.raises(CannotMove) as caught:
            rbd.inverse_dynamics(state, a, moving.contacts, external=(most + room) * push)
        assert caught.value.certificate is not None and caught.value.limits


# ------------------------------------------------------------------------------------------------------ closed forms


@pytest.fixture(scope="module")
def crate() -> rbd.Robot:
    """A free box of 10 kg; its frame is at its centre."""
    return box(10.0)


def point(mu: float | None = 0.6) -> list[rbd.PointContact]:
    """Under its centre of mass, at it: no moment."""
    return [rbd.PointContact("toe", "box", offset=(0.0, 0.0, 0.0), friction=mu, on=None)]


def at(crate: rbd.Robot, v: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> rbd.State:
    """Moving without turning."""
    return rbd.State(crate, pin.neutral(crate.model), np.array([*v, 0.0, 0.0, 0.0]))


def line(x: float, y: float, z: float) -> Array:
    """An acceleration without turning."""
    return np.array([x, y, z, 0.0, 0.0, 0.0])


def test_a_point_that_slips_rubs_with_the_whole_coefficient(crate: rbd.Robot) -> None:
    """80 N on 10 kg, mu = 0.6: it slides at 2.114 m/s2 and no other acceleration along x is possible; margin or not."""
    push = np.array([80.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for margin in (0.0, 0.05):
        found = rbd.inverse_dynamics(at(crate), line(8.0 - 0.6 * G, 0.0, 0.0), point(), external=push, margin=margin)
        assert found.forces["toe"][:3] == pytest.approx([-58.86, 0.0, 98.1], abs=1e-9)
    for a in (0.0, 1.0, 2.2, -1.0):
        with pytest.raises(CannotMove) as caught:
            rbd.inverse_dynamics(at(crate), line(a, 0.0, 0.0), point(), external=push)
        kinds = {limit.kind for limit in caught.value.limits}
        assert kinds == {"friction" if a == 0.0 else "slips", "base"}


def test_a_point_that_slides_rubs_against_its_velocity(crate: rbd.Robot) -> None:
    """Sliding along -y at 1 m/s: the only deceleration is mu g."""
    found = rbd.inverse_dynamics(at(crate, (0.0, -1.0, 0.0)), line(0.0, 0.6 * G, 0.0), point())
    assert found.forces["toe"][:3] == pytest.approx([0.0, 58.86, 98.1], abs=1e-9)
    with pytest.raises(CannotMove, match="friction|slip"):
        rbd.inverse_dynamics(at(crate, (0.0, -1.0, 0.0)), line(0.0, 0.5 * G, 0.0), point())


def test_a_point_that_opens_carries_nothing(crate: rbd.Robot) -> None:
    """Lifted by 108.1 N it rises at 1 m/s2; free fall apart, nothing else does it; into the ground it does not go."""
    lift = np.array([0.0, 0.0, 108.1, 0.0, 0.0, 0.0])
    found = rbd.inverse_dynamics(at(crate), line(0.0, 0.0, 1.0), point(), external=lift)
    assert found.forces["toe"][:3] == pytest.approx(np.zeros(3), abs=1e-12)
    with pytest.raises(CannotMove) as caught:
        rbd.inverse_dynamics(at(crate), line(0.0, 0.0, 0.5), point(), external=lift)
    assert {limit.kind for limit in caught.value.limits} == {"opens", "base"}
    with pytest.raises(CannotMove, match=r"'toe' \(point 1 of 1\) would sink at 0.3"):
        rbd.inverse_dynamics(at(crate), line(0.0, 0.0, -0.3), point(), external=lift)
    with pytest.raises(CannotMove, match="'toe' is held, and would accelerate at 0.3.*project_acceleration"):
        rbd.inverse_dynamics(at(crate), line(0.3, 0.0, 0.0), point(None), external=lift)


def test_a_point_that_already_leaves_is_named_with_the_way_back(crate: rbd.Robot) -> None:
    """Rising at 2 mm/s it carries nothing, whatever is wanted: a warning names it, its speed and `project_velocity`."""
    with (
        pytest.warns(rbd.errors.OpeningContactWarning, match="'toe' at 0.002 m/s.*project_velocity") as told,
        pytest.raises(CannotMove) as caught,
    ):
        rbd.inverse_dynamics(at(crate, (0.0, 0.0, 2e-3)), line(0.0, 0.0, 0.0), point())
    assert len(told) == 1 and told[0].filename == __file__
    assert {limit.kind for limit in caught.value.limits} == {"opens", "base"}


def test_dry_friction_and_stops_of_joints_take_their_part() -> None:
    """One hinge at rest: driven off its stop the stop gives nothing, and dry friction its bound against the motion."""
    one = rbd.load_robot("double_pendulum", root="fixed")
    state = one.at(np.array([0.4, 0.3]))
    name = one.actuated_names[0]
    rubs = rbd.constraints.JointFriction("rubs", name, 2.0)
    a = np.array([1.5, 0.0])
    free = rbd.inverse_dynamics(state, a, [])
    assert np.abs(free.tau - (state.M @ a + rbd.dynamics.bias_force(state))).max() < 1e-12
    found = rbd.inverse_dynamics(state, a, [rubs])
    assert found.tau - free.tau == pytest.approx([2.0, 0.0], abs=1e-9)
    assert rbd.inverse_dynamics(state, -a, [rubs]).tau[0] == pytest.approx(
        (rbd.dynamics.bias_force(state) - state.M @ a)[0] - 2.0, abs=1e-9
    )
    assert off(rbd.solve(state, found.tau, [rubs]), a) < 1e-8


def test_redundant_drives_share_by_their_weights() -> None:
    """A four-bar with a motor in each joint: n . tau is given, so tau_i is as n_i limit_i^2 / p_i."""
    one = rbd.load_robot("four_bar", passive=[])
    assert one.nu >= 1
    one = rbd.load_robot("four_bar", loops=False, root="fixed")
    whole = rbd.load_robot("four_bar")
    loops = whole.loops()
    state = rbd.State(one, whole.posture("assembled"))
    J = np.concatenate([c.rows(state).J for c in loops])
    n = np.linalg.svd(J)[2][-1]
    given = still_at_contacts(Moving(state, loops), np.array([1.0, 0.0, 0.0]))
    k = n @ (state.M @ given + rbd.dynamics.bias_force(state))
    limit = np.where(np.isfinite(one.effort_limit), one.effort_limit, one.mass * G)
    for weights in (np.ones(3), np.array([1.0, 4.0, 0.5])):
        found = rbd.inverse_dynamics(state, given, loops, objective=Effort(torques=weights, forces=1e-11))
        share = n * limit**2 / weights
        assert found.tau == pytest.approx(k * share / (n @ share), rel=1e-6, abs=1e-8)
        assert off(rbd.solve(state, found.tau, loops), given) < 1e-8
    assert found.uniqueness().torques == 2


# -------------------------------------------------------------------------------------------------------- objectives


def test_a_weighed_motor_is_spared(talos: rbd.Robot) -> None:
    """A hundred times the weight on one motor: it does less, the others together more."""
    state, soles = talos.standing(), talos.soles()
    plain = rbd.hold(state, soles)
    i = int(np.argmax(np.abs(plain.tau[:12] / talos.effort_limit[:12])))
    name = talos.actuated_names[i]
    spared = rbd.hold(state, soles, objective=Effort(torques={name: 100.0}))
    assert abs(spared.tau[i]) < 0.5 * abs(plain.tau[i])
    assert ((spared.tau / talos.effort_limit) ** 2).sum() >= ((plain.tau / talos.effort_limit) ** 2).sum()
    same = rbd.hold(state, soles, objective=Effort(torques=np.ones(talos.nu)))
    assert np.abs(same.tau - plain.tau).max() < 1e-9


def test_forces_can_be_weighed(talos: rbd.Robot) -> None:
    """Weighed much more on the left sole, its force is less."""
    state, soles = talos.standing(), talos.soles()
    plain = rbd.hold(state, soles).forces["left_sole"][2]
    assert rbd.hold(state, soles, objective=Effort(forces={"left_sole": 100.0})).forces["left_sole"][2] < 0.8 * plain


def test_normal_forces_keep_to_their_bounds(talos: rbd.Robot) -> None:
    """Between 100 and 300 N on the left sole, whose share else is half the weight; both below half of it: refused, and why."""
    state, soles = talos.standing(), talos.soles()
    held = rbd.hold(state, soles, objective=Effort(normal_force={"left_sole": (100.0, 300.0)}))
    assert held.forces["left_sole"][2] == pytest.approx(300.0, abs=1e-6)
    assert np.abs(rbd.solve(state, held.tau, soles).a).max() < 1e-7
    exact = rbd.hold(state, soles, objective=Effort(normal_force={"right_sole": (500.0, 500.0)}))
    assert exact.forces["right_sole"][2] == pytest.approx(500.0, abs=1e-6)
    with pytest.raises(rbd.CannotHold, match="what the objective asks of normal forces") as caught:
        rbd.hold(state, soles, objective=Effort(normal_force={"left_sole": (0.0, 400.0), "right_sole": (0.0, 400.0)}))
    assert {Limit("normal force", "left_sole"), Limit("normal force", "right_sole")} <= set(caught.value.limits)


def test_centres_of_pressure_keep_off_the_edge(talos: rbd.Robot) -> None:
    """Pushed sideways the centres of pressure are as far from the edges as asked; further than a sole is wide: refused."""
    state, soles = talos.standing(), talos.soles()
    push = rbd.ExternalForce("torso_2_link", (0.0, 45.0, 0.0))
    free = min(rbd.hold(state, soles, external=push).margins.centre_of_pressure.values())
    margin = free + 0.01
    kept = rbd.hold(state, soles, external=push, objective=Effort(edge_margin=margin))
    assert min(kept.margins.centre_of_pressure.values()) >= margin - 1e-9
    assert np.abs(rbd.solve(state, kept.tau, soles, external=push).a).max() < 1e-7
    edges = [rbd.LineContact(s.name, s.frame, half_length=0.06, placement=s.placement, friction=0.7) for s in soles]
    ends = rbd.hold(state, edges, objective=Effort(edge_margin=0.02))
    for edge in edges:
        f, patch = ends.corner_forces[edge.name], edge.rows(state).patch
        at = (f[:, 2] @ patch.corners[:, 0]) / f[:, 2].sum()
        assert abs(at) <= 0.04 + 1e-9
    with pytest.raises(rbd.CannotHold, match="what the objective asks of normal forces or centres of pressure at 'left_sole'"):
        rbd.hold(state, soles, external=push, objective=Effort(edge_margin=0.2))


def test_at_the_edge_of_friction_the_words_say_so(talos: rbd.Robot) -> None:
    """margin=0 with a corner at its limit: other motions may be possible; with a margin they are silent."""
    rng = np.random.default_rng(19)
    said = []
    for _ in range(20):
        moving, a = wanted(talos, rng, 0.4)
        try:
            text = str(rbd.inverse_dynamics(moving.state, a, moving.contacts, margin=0.0))
            silent = str(rbd.inverse_dynamics(moving.state, a, moving.contacts))
        except CannotMove:
            continue
        assert text.startswith("moves as wanted: largest torque") and "friction is at its limit" not in silent
        said.append("friction is at its limit: with these torques other motions may be possible, too" in text)
    assert any(said) and not all(said)


# --------------------------------------------------------------------------------------------------------- uniqueness


def test_what_is_unique(talos: rbd.Robot, crate: rbd.Robot) -> None:
    """Counted by hand: two soles 12 - 6, their corners 24 - 6; one sole none, 12 - 6; the leg with its loops none."""
    soles = talos.soles()
    both = rbd.hold(talos.standing(), soles).uniqueness()
    assert (both.torques, both.forces, both.corner_forces, both.inside) == (6, 6, 18, True)
    assert str(both) == "torques 6-dimensional, forces 6-dimensional, corner forces 18-dimensional"
    wide = rbd.SurfaceContact("wide", soles[0].frame, half_lengths=(1.0, 1.0), friction=0.7)
    one = rbd.hold(talos.standing(), [wide]).uniqueness()
    assert (one.torques, one.forces, one.corner_forces) == (0, 0, 6)
    leg = robot("leg")
    u = rbd.inverse_dynamics(leg.at("assembled"), np.zeros(leg.nv), leg.loops()).uniqueness()
    assert (u.torques, u.forces) == (0, 0) and str(u).startswith("torques unique, forces unique")
    push = np.array([58.86, 0.0, 0.0, 0.0, 0.0, 0.0])
    edge = rbd.hold(at(crate), [*point(), replace_name(point()[0], "other")], external=push, margin=0.0).uniqueness()
    assert not edge.inside and "at most" in str(edge)


def replace_name(contact: rbd.PointContact, name: str) -> rbd.PointContact:
    """The same under another name."""
    return rbd.PointContact(name, contact.frame, offset=(0.0, 0.0, 0.0), friction=contact.friction, on=None)


# ---------------------------------------------------------------------------------------------------------- bad input


def test_what_is_no_question_is_refused(talos: rbd.Robot) -> None:
    """NaN, sizes, names, kinds: before any solver."""
    state, a, soles = talos.standing(), np.zeros(talos.nv), talos.soles()
    for wrong in (np.full(talos.nv, np.nan), np.zeros(talos.nv - 1), np.zeros((talos.nv, 1)), "0", None):
        with pytest.raises(InputError):
            rbd.inverse_dynamics(state, wrong, soles)  # type: ignore[arg-type]
    with pytest.raises(DuplicateName, match="two contacts are named 'left_sole'"):
        rbd.inverse_dynamics(state, a, [soles[0], soles[0]])
    with pytest.raises(InputError, match="friction is 'pyramid'; .*Expected one of cone, inscribed"):
        rbd.inverse_dynamics(state, a, soles, friction="pyramid")
    for margin in (-0.1, 1.0, np.nan, "0.1", None):
        with pytest.raises(InputError, match="margin is .*; expected a number from 0, below 1"):
            rbd.inverse_dynamics(state, a, soles, margin=margin)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="rest_speed is -1"):
        rbd.inverse_dynamics(state, a, soles, rest_speed=-1.0)
    with pytest.raises(InputError, match="expected an rbd.statics.Effort"):
        rbd.inverse_dynamics(state, a, soles, objective="effort")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="a State of a robot was expected first"):
        rbd.inverse_dynamics("talos", a, soles)  # type: ignore[arg-type]


def test_names_that_nothing_has_are_refused_with_the_nearest(talos: rbd.Robot) -> None:
    """Of motors, of contacts, of frames of pushes."""
    state, a, soles = talos.standing(), np.zeros(talos.nv), talos.soles()
    with pytest.raises(JointNotFound, match="no motor, 'leg_left_9_joint'; nearest: 'leg_left_"):
        rbd.inverse_dynamics(state, a, soles, objective=Effort(torques={"leg_left_9_joint": 2.0}))
    for field in ({"forces": {"left_sol": 1.0}}, {"normal_force": {"left_sol": (0.0, 1.0)}}):
        with pytest.raises(UnknownName, match="what is no contact here, 'left_sol'; nearest: 'left_sole'"):
            rbd.inverse_dynamics(state, a, soles, objective=Effort(**field))  # type: ignore[arg-type]
    with pytest.raises(UnknownName):
        rbd.inverse_dynamics(state, a, soles, external=[rbd.ExternalForce("torso", (0.0, 0.0, 1.0))])
    with pytest.raises(InputError, match=r"torques has shape \(3,\); expected one weight, or \(32,\)"):
        rbd.inverse_dynamics(state, a, soles, objective=Effort(torques=np.ones(3)))


@pytest.mark.parametrize(
    "given",
    [
        {"torques": -1.0}, {"torques": np.nan}, {"forces": 0.0}, {"forces": np.ones(3)}, {"forces": {"left_sole": -1.0}},
        {"edge_margin": -0.01}, {"edge_margin": np.nan}, {"normal_force": 3.0}, {"normal_force": {"left_sole": (2.0, 1.0)}},
        {"normal_force": {"left_sole": (1.0,)}}, {"normal_force": {"left_sole": (np.nan, 1.0)}},
        {"normal_force": {"left_sole": (-2.0, -1.0)}}, {"normal_force": {"left_sole": (np.inf, np.inf)}},
    ],
)  # fmt: skip
def test_an_effort_that_is_none_is_refused(given: dict[str, object]) -> None:
    """Negative weights, bounds that cross, what are no numbers."""
    with pytest.raises(InputError, match="|".join(given)):
        Effort(**given)  # type: ignore[arg-type]


def test_without_contacts_a_floating_robot_falls(talos: rbd.Robot) -> None:
    """Only free fall is possible, with any motion of the joints; it is found."""
    state = talos.standing()
    with pytest.raises(CannotMove, match="it has no contact") as caught:
        rbd.inverse_dynamics(state, np.zeros(talos.nv), [])
    assert caught.value.limits == (Limit("base", "root_joint"),)
    fall = rbd.solve(state, np.zeros(talos.nu)).a
    found = rbd.inverse_dynamics(state, fall, [])
    assert np.abs(found.tau).max() < 1e-8 and found.status == "solved"


def test_velocities_that_contacts_do_not_allow_are_refused(talos: rbd.Robot) -> None:
    """Into the ground, or of a foot that is held: how fast, and what puts it right."""
    rng = np.random.default_rng(23)
    v = 0.1 * rng.normal(size=talos.nv)
    state, a = rbd.State(talos, talos.standing().q, v), np.zeros(talos.nv)
    for soles in (talos.soles(), talos.soles(None)):
        with pytest.raises(ContactMoves, match=r"rbd\.mechanism\.project_velocity\(state, contacts\)"):
            rbd.inverse_dynamics(state, a, soles)
    with pytest.raises(ContactMoves, match=r"'left_sole' is held, and its velocity is 0\.\d+"):
        rbd.inverse_dynamics(state, a, talos.soles(None))
    right = rbd.mechanism.project_velocity(state, talos.soles(None))
    a = still_at_contacts(Moving(right, talos.soles()), a)
    assert rbd.inverse_dynamics(right, a, talos.soles(None)).status == "solved"


def test_an_actuation_tells_itself(talos: rbd.Robot) -> None:
    """What moved, how hard the hardest motor works, each contact; the first line is the short form."""
    rng = np.random.default_rng(29)
    moving, a = wanted(talos, rng, 0.1)
    found = rbd.inverse_dynamics(moving.state, a, moving.contacts)
    worst = int(np.argmax(np.abs(found.tau) / talos.effort_limit))
    share = 100 * abs(found.tau[worst]) / talos.effort_limit[worst]
    assert f"largest torque {share:.1f} % of its limit ({talos.actuated_names[worst]})" in str(found)
    assert "left_sole" in str(found) and not found.still and repr(found) == f"Actuation({str(found).splitlines()[0]})"
    assert replace(found).tau is found.tau
