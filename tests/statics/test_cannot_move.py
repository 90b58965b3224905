"""What stands in the way of a motion: verdicts at the limit, irreducible sets, proofs, what is missing, the nearest motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import pytest
from moving_states import NAMES, Moving, drawn, robot, still_at_contacts
from second_conic import Whole, by_scs, proof

import rbd
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, with_loops
from rbd.errors import CannotHold, CannotMove, InputError, NoSolution
from rbd.problem.conic import Conic
from rbd.problem.contact_motion import REST_SPEED
from rbd.statics import Effort, Limit
from rbd.statics.limits import Relaxable
from rbd.statics.wanted_motion import EffortChoice, WantedMotion
from rbd.testing import box

G = 9.81


def relaxable(
    state: rbd.State,
    a: Array,
    contacts: Sequence[Constraint],
    *,
    external=None,
    margin: float = 0.05,
    effort: Effort | None = None,
) -> Relaxable:
    """The limits of a question, to be relaxed one by one."""
    choice = EffortChoice.of(effort, "cone", margin, REST_SPEED, holds=not (a.any() or state.v.any()))
    wanted = WantedMotion.of(state, a, with_loops(state.robot, contacts, True), external, choice, stacklevel=2)
    return Relaxable(wanted.loads(margin), choice.effort)


def refused(call) -> CannotMove:
    """The error of what cannot move so."""
    with pytest.raises(CannotMove) as caught:
        call()
    return caught.value


def proves(program: Conic, error: CannotMove) -> None:
    """The certificate of an error, recomputed from the definition."""
    assert error.certificate is not None
    _, gap, left = proof(program, error.certificate)
    assert gap > 0.0 and (left == 0.0 or gap / left > 1e3)
    assert gap == pytest.approx(error.certificate.gap, rel=1e-6, abs=1e-15)


# ------------------------------------------------------------------------------------------------------ at the limit


def largest_push(state: rbd.State, contacts: Sequence[Constraint], push: Array) -> float:
    """By SCS, on equations of its own: the most that some torques within their limits withstand."""
    whole = Whole.of(state, contacts, 0.0, push[:, None] * state.robot.mass * G)
    g = np.zeros(whole.columns.shape[1])
    g[-1] = -1.0
    found = by_scs(whole.program(rbd.dynamics.bias_force(state), np.zeros(len(g)), g))
    assert found.status == "solved"
    return float(found.x[-1]) * state.robot.mass * G


def test_talos_on_slippery_ground_is_held_up_to_its_limit(talos: rbd.Robot) -> None:
    """Friction 0.1, pushed along y at the torso: 88.511 N, less than mu m g = 88.557 N as the push turns the robot, too.

    Found by bisection to 1e-9; held a millionth below, refused with a proof a millionth above, as another solver says; the
    square pyramids inside the cones end at 62.6 N.
    """
    state, soles = talos.standing(), talos.soles(0.1)
    push = state.frame("torso_2_link").J[1]
    other = largest_push(state, soles, push)

    def withstands(size: float) -> bool:
        wanted = relaxable(state, np.zeros(talos.nv), soles, external=size * push, margin=0.0)
        return wanted.refuted() is None

    low, high = 88.0, 89.0
    assert withstands(low) and not withstands(high)
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if withstands(middle) else (low, middle)
    assert high == pytest.approx(other, rel=1e-6) and high == pytest.approx(88.511, abs=5e-4)
    assert high < 0.1 * talos.mass * G
    held = rbd.hold(state, soles, external=high * (1.0 - 1e-6) * push)
    assert held.status == "solved" and held.margin == 0.0
    assert 0.0 <= min(held.margins.friction.values()) < 1e-3
    beyond = high * (1.0 + 1e-6) * push
    error = refused(lambda: rbd.hold(state, soles, external=beyond))
    proves(relaxable(state, np.zeros(talos.nv), soles, external=beyond, margin=0.0).program(), error)
    assert {limit.kind for limit in error.limits} >= {"friction", "base"}
    assert "friction prevents it; a coefficient just above 0.1 at every contact would do" in str(error)
    assert "The base misses (0, 0, 0) N" not in str(error)
    rbd.hold(state, soles, external=62.5 * push, friction="inscribed")
    assert "circular cones would hold it" in str(
        refused(lambda: rbd.hold(state, soles, external=62.7 * push, friction="inscribed"))
    )


@pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
def test_pushes_are_held_up_to_where_another_solver_puts_the_limit(name: str, exhaustive: bool) -> None:
    """Drawn poses, friction and directions: held a millionth below, refused with a proof a millionth above."""
    one, rng, count = robot(name), np.random.default_rng(31), 0
    while count < (60 if exhaustive else 3):
        moving = drawn(one, rng, friction=float(rng.uniform(0.2, 0.9)), speed=0.0)
        state, direction = moving.state, rng.normal(size=3)
        push = state.frame({"talos": "torso_2_link", "g1": "torso_link", "solo12": "base_link"}[name]).J[:3].T @ direction
        try:
            rbd.hold(state, moving.contacts)
            most = largest_push(state, moving.contacts, push)
        except (CannotHold, AssertionError):
            continue
        count += 1
        assert rbd.hold(state, moving.contacts, external=(1.0 - 2e-6) * most * push).status == "solved"
        error = refused(lambda s=state, c=moving.contacts, e=(1.0 + 2e-6) * most * push: rbd.hold(s, c, external=e))
        assert error.certificate is not None and error.limits


# ---------------------------------------------------------------------------------------------------- irreducible sets


Question = tuple[rbd.State, Array, Sequence[Constraint], dict]


@pytest.fixture(scope="module")
def questions() -> dict[str, Question]:
    """Motions that are not possible, each for another reason: (state, a, contacts, more)."""
    talos, g1, leg = robot("talos"), robot("g1"), robot("leg")
    standing, rest = talos.standing(), np.zeros(talos.nv)
    torso = standing.frame("torso_2_link").J
    rng = np.random.default_rng(37)
    running = drawn(g1, rng, friction=0.4)
    hanging = drawn(leg, rng)
    passive = rbd.load_robot("talos", passive=["arm_left_4_joint"])
    hand = standing.frame("arm_left_7_link").J[2]
    fast = np.zeros(talos.nv)
    fast[talos.actuated[:12]] = 40.0
    asked = Effort(normal_force={"left_sole": (0.0, 20.0)}, edge_margin=0.05)
    return {
        "slips": (standing, rest, talos.soles(0.1), {"external": 100.0 * torso[1]}),
        "tips": (standing, rest, talos.soles(0.7), {"external": 200.0 * torso[1]}),
        "lifts": (standing, rest, talos.soles(0.7), {"external": 1000.0 * torso[2]}),
        "elbow": (standing, rest, talos.soles(0.7), {"external": -150.0 * hand}),
        "one foot": (standing, rest, talos.soles(0.7)[:1], {}),
        "in the air": (standing, rest, [], {}),
        "passive elbow": (passive.standing(), rest, passive.soles(), {}),
        "hanging leg": (hanging.state, still_at_contacts(hanging, 3e5 * rng.normal(size=leg.nv)), hanging.contacts, {}),
        "running": (running.state, still_at_contacts(running, 6.0 * rng.normal(size=g1.nv)), running.contacts, {}),
        "jumps": (standing, still_at_contacts(Moving(standing, talos.soles()), fast), talos.soles(0.7), {}),
        "asked": (standing, rest, talos.soles(0.7), {"effort": asked}),
    }


EXPECTED = {
    "slips": {"friction", "base"},
    "tips": {"edge", "base"},
    "lifts": {"push", "base"},
    "elbow": {"motor"},
    "one foot": {"edge", "base"},
    "in the air": {"base"},
    "passive elbow": {"passive"},
    "hanging leg": {"motor", "passive"},
    "running": set(),
    "jumps": set(),
    "asked": set(),
}
"""Kinds of limits that are in the way; of the last three whatever is found."""


@pytest.mark.parametrize("name", EXPECTED)
def test_what_is_in_the_way_is_irreducible(name: str, questions: dict[str, Question]) -> None:
    """All limits that are named contradict each other, with all others left out; without any one of them they do not.

    Another solver agrees, and the proof is one.
    """
    state, a, contacts, more = questions[name]
    ask = relaxable(state, a, contacts, **more)
    told = {"external": more.get("external"), "objective": more.get("effort"), "margin": 0.05}
    error = refused(lambda: rbd.inverse_dynamics(state, a, contacts, **told))
    proves(ask.program(), error)
    named = error.limits
    assert named and error.irreducible and set(named) <= set(ask.limits)
    if EXPECTED[name]:
        assert {limit.kind for limit in named} == EXPECTED[name]
    finer = {limit.name for limit in named if limit.kind in ("friction", "edge", "slips")}
    rest = [x for x in ask.limits if x not in named and not (x.kind == "push" and x.name in finer)]
    assert ask.refuted(rest) is not None
    for one in named:
        assert ask.refuted([*rest, one]) is None, one
        program = ask.program([*rest, one])
        assert not len(program.g) or by_scs(program, eps=1e-7, steps=50_000).status != "infeasible"
    for one in named:
        assert str(one) in str(error) or len(named) > 8


@pytest.mark.parametrize("name", NAMES)
def test_drawn_motions_beyond_limits_are_refused_by_irreducible_sets(name: str, exhaustive: bool) -> None:
    """Accelerations that are too large, of drawn moving states: an irreducible set each, and a nearest motion comes back."""
    one, rng, count = robot(name), np.random.default_rng(41), 0
    while count < (100 if exhaustive else 6):
        moving = drawn(one, rng, friction=float(rng.uniform(0.2, 0.9)), speed=0.5)
        state, contacts = moving.state, moving.contacts
        a = still_at_contacts(moving, (1e5 if name == "leg" else 4.0) * rng.normal(size=one.nv))
        try:
            rbd.inverse_dynamics(state, a, contacts)
        except CannotMove as caught:
            error = caught
        else:
            continue
        count += 1
        ask, named = relaxable(state, a, contacts), error.limits
        assert named and error.irreducible and error.certificate is not None
        finer = {limit.name for limit in named if limit.kind in ("friction", "edge", "slips")}
        rest = [x for x in ask.limits if x not in named and not (x.kind == "push" and x.name in finer)]
        assert ask.refuted(rest) is not None
        assert all(ask.refuted([*rest, limit]) is None for limit in named)
        near = error.nearest()
        assert near.status == "solved" and (np.abs(near.tau) <= one.effort_limit).all()
        # At its limits Coulomb's law may allow another motion too; the convex law has one motion, and all points keep still.
        assert off_by(rbd.solve(state, near.tau, contacts, law="convex"), near.a) < 1e-6


def test_what_is_named_is_what_helps(talos: rbd.Robot) -> None:
    """Not of the program but of the robot: more friction where friction is named, a stronger motor where a motor is."""
    state = talos.standing()
    push = state.frame("torso_2_link").J[1]
    error = refused(lambda: rbd.hold(state, talos.soles(0.1), external=100.0 * push))
    frictions = {limit.name for limit in error.limits if limit.kind == "friction"}
    assert frictions
    rbd.hold(state, [s.with_friction(0.9) if s.name in frictions else s for s in talos.soles(0.1)], external=100.0 * push)
    weak = rbd.load_robot("talos")
    i = weak.actuated_names.index("leg_left_4_joint")
    weak.effort_limit[:] = np.where(np.arange(weak.nu) == i, 1e-3, weak.effort_limit)
    left = [s for s in weak.soles() if s.name == "left_sole"]
    held = rbd.SurfaceContact("left_sole", left[0].frame, half_lengths=(1.0, 1.0), friction=0.9)
    error = refused(lambda: rbd.hold(weak.standing(), [held]))
    assert Limit("motor", "leg_left_4_joint") in error.limits
    weak.effort_limit[i] = 1e4
    rbd.hold(weak.standing(), [held])


# ------------------------------------------------------------------------------------------------------ what is missing


def least_help(p: Array, L: float, weight: float) -> tuple[Array, Array]:
    """(F, m) about the centre of mass, of a body that stands on one point at p from it: least |F|^2 + |m|^2 / L^2.

    F = W - f and m = -p x f with any force f: (1 + [p]^T [p] / L^2) f = W.
    """
    X = pin.skew(p)
    f = np.linalg.solve(np.eye(3) + X.T @ X / L**2, np.array([0.0, 0.0, weight]))
    return np.array([0.0, 0.0, weight]) - f, -np.cross(p, f)


@pytest.mark.parametrize("p", [(0.1, 0.0, -0.1), (0.05, -0.08, -0.2), (0.0, 0.3, -0.1)])
def test_what_a_box_on_a_point_misses(p: tuple[float, float, float]) -> None:
    """By least squares in three unknowns; L^2 = (a^2 + b^2 + c^2) / 12 of a box; friction of 5 leaves the force free."""
    size = (0.4, 0.3, 0.2)
    one = box(3.0, size)
    state = rbd.State(one, pin.neutral(one.model))
    F, m = least_help(np.array(p), math.sqrt(sum(x * x for x in size) / 12.0), 3.0 * G)
    toe = rbd.PointContact("toe", "box", offset=p, friction=5.0, on=None)
    missing = refused(lambda: rbd.hold(state, [toe])).missing
    assert missing.length == pytest.approx(math.sqrt(sum(x * x for x in size) / 12.0), rel=1e-9)
    assert missing.force == pytest.approx(F, abs=1e-6) and missing.moment == pytest.approx(m, abs=1e-6)
    assert missing.size == pytest.approx(math.sqrt(F @ F + m @ m / missing.length**2), rel=1e-6)
    rbd.hold(state, [toe], external=np.concatenate([missing.force, missing.moment]))


def test_what_a_table_on_two_legs_misses() -> None:
    """Its legs beside its centre of mass: what a point between their feet would miss; on three, around it, nothing."""
    one = box(8.0, (1.0, 0.6, 0.1))
    state = rbd.State(one, pin.neutral(one.model))

    def legs(*at: tuple[float, float]) -> list[rbd.PointContact]:
        return [rbd.PointContact(f"leg{i}", "box", offset=(*x, -0.4), friction=3.0, on=None) for i, x in enumerate(at)]

    missing = refused(lambda: rbd.hold(state, legs((-0.4, 0.25), (0.4, 0.25)))).missing
    F, m = least_help(np.array([0.0, 0.25, -0.4]), missing.length, 8.0 * G)
    assert missing.force == pytest.approx(F, abs=1e-6) and missing.moment == pytest.approx(m, abs=1e-6)
    assert "the base misses" in str(missing) and f"L = {missing.length:.3g} m" in str(missing)
    rbd.hold(state, legs((-0.4, 0.25), (0.4, 0.25), (0.0, -0.25)))


def test_in_the_air_the_weight_is_missing(talos: rbd.Robot) -> None:
    """M g upwards, no moment about the centre of mass; moved with a, m g plus the rate of momentum."""
    state = talos.standing()
    missing = refused(lambda: rbd.hold(state, [])).missing
    assert missing.force == pytest.approx([0.0, 0.0, talos.mass * G], abs=1e-6)
    assert missing.moment == pytest.approx(np.zeros(3), abs=1e-6) and missing.size == pytest.approx(talos.mass * G)
    a = np.random.default_rng(1).normal(size=talos.nv)
    missing = refused(lambda: rbd.inverse_dynamics(state, a, [])).missing
    A_g, bias, _ = state.centroidal()
    rate = A_g @ a + np.concatenate([[0.0, 0.0, talos.mass * G], np.zeros(3)])
    assert np.concatenate([missing.force, missing.moment]) == pytest.approx(rate, abs=1e-5)


def test_a_passive_joint_misses_its_torque() -> None:
    """An arm whose shoulder is passive: its gravity torque, alone."""
    panda = rbd.load_robot("panda", root="fixed", passive=["panda_joint2"])
    state = panda.standing()
    error = refused(lambda: rbd.hold(state, []))
    need = rbd.dynamics.bias_force(state)[panda.joints["panda_joint2"].v]
    assert error.missing.torques["panda_joint2"] == pytest.approx(need, rel=1e-6)
    assert error.limits == (Limit("passive", "panda_joint2"),) and "'panda_joint2' misses" in str(error)
    assert not error.missing.wrench.any() and error.missing.size == pytest.approx(abs(need[0]), rel=1e-6)


def test_motors_that_are_too_weak_exceed_their_limits_by_what_is_told() -> None:
    """An arm alone: tau is its gravity torque, so the excess is |tau| / limit - 1 of each; nothing on a base is missing."""
    panda = rbd.load_robot("panda", root="fixed")
    state = panda.at(panda.standing().q)
    need = rbd.dynamics.bias_force(state)
    panda.effort_limit[:] = np.maximum(np.abs(need) / (1.5 + 0.1 * np.arange(panda.nu)), 1e-2)
    panda.effort_limit[3] = 10.0 * abs(need[3])
    error = refused(lambda: rbd.hold(state, []))
    assert error.excess == pytest.approx(np.maximum(np.abs(need) / panda.effort_limit - 1.0, 0.0), abs=1e-6)
    assert error.missing.size == 0.0 and [limit.kind for limit in error.limits] == ["motor"]
    worst = int(np.argmax(error.excess))
    assert f"At best '{panda.actuated_names[worst]}' needs {100 * (1 + error.excess[worst]):.4g} %" in str(error)


def test_forces_share_what_is_beyond(talos: rbd.Robot) -> None:
    """Limits scaled down until they do not hold it: the least sum of what exceeds them, by a linear program of its own."""
    weak = rbd.load_robot("talos")
    weak.effort_limit[:] = 0.2 * weak.effort_limit
    state, soles = weak.standing(), weak.soles(2.0)
    error = refused(lambda: rbd.hold(state, soles))
    whole = Whole.of(state, soles, 0.0)
    n, nu = whole.columns.shape[1], weak.nu
    # Least sum of e with |tau / limit| <= 1 + e: tau = t + d, |t| <= 1, as columns t, d+ and d- beside the forces.
    columns = np.hstack([whole.columns, whole.columns[:, :nu], -whole.columns[:, :nu]])
    lower = np.concatenate([whole.lower, np.zeros(2 * nu)])
    upper = np.concatenate([whole.upper, np.full(2 * nu, np.inf)])
    wide = Whole(columns, whole.cones, whole.mu, lower, upper, nu)
    g = np.concatenate([np.zeros(n), np.ones(2 * nu)])
    other = by_scs(wide.program(rbd.dynamics.bias_force(state), np.zeros(len(g)), g), eps=1e-8)
    assert other.status == "solved" and other.value > 0.01
    assert error.excess.sum() == pytest.approx(other.value, rel=1e-4)
    weak.effort_limit[:] *= 1.0 + error.excess + 1e-5
    assert rbd.hold(state, soles, margin=0.0).status == "solved"


# ---------------------------------------------------------------------------------------------------------- the nearest


@pytest.mark.parametrize("name", ["running", "jumps", "tips", "slips", "elbow", "hanging leg"])
def test_the_nearest_motion_is_possible_and_nearest(name: str, questions: dict[str, Question]) -> None:
    """Contacts kept, limits met, residuals solved; `solve` gives it back; none is nearer, says another solver."""
    state, a, contacts, more = questions[name]
    one, external = state.robot, more.get("external")
    near = refused(lambda: rbd.inverse_dynamics(state, a, contacts, external=external)).nearest()
    rows = [c.rows(state) for c in contacts]
    J, bias = np.concatenate([r.J for r in rows]), np.concatenate([r.bias for r in rows])
    assert np.abs(J @ near.a + bias).max() < 1e-7 * max(1.0, np.abs(near.a).max())
    assert near.status == "solved" and (np.abs(near.tau) <= one.effort_limit * (1.0 + 1e-8)).all()
    # By SCS: a' = a + L^-T s, least |s|^2 / 2, with torques and forces beside it and the contacts kept.
    back = np.linalg.inv(np.linalg.cholesky(state.M)).T
    whole = Whole.of(state, contacts, 0.05)
    n, nv = whole.columns.shape[1], one.nv
    need = state.M @ a + rbd.dynamics.bias_force(state) - (0.0 if external is None else external)
    size = max(1.0, float(np.abs(need).max()) / (one.mass * G))
    columns = np.vstack(
        [np.hstack([whole.columns, -state.M @ back * size]), np.hstack([np.zeros((len(J), n)), J @ back * size])]
    )
    free = np.full(nv, np.inf)
    wide = Whole(
        columns, whole.cones, whole.mu, np.concatenate([whole.lower, -free]), np.concatenate([whole.upper, free]), whole.nu
    )
    squares = np.concatenate([np.zeros(n), np.ones(nv)])
    other = by_scs(wide.program(np.concatenate([need, -(J @ a + bias)]), squares, np.zeros(n + nv)), eps=1e-8)
    assert other.status == "solved"
    distance = float((near.a - a) @ state.M @ (near.a - a))
    assert distance == pytest.approx(2.0 * size**2 * other.value, rel=1e-4)
    again = rbd.solve(state, near.tau, contacts, external=external)
    e = again.a - near.a
    assert math.sqrt(e @ state.M @ e) < 1e-5 * math.sqrt(max(near.a @ state.M @ near.a, 1.0))


def test_a_point_that_would_sink_has_a_nearest_motion(talos: rbd.Robot) -> None:
    """No proof is asked for where the contacts do not allow the motion at all; the nearest keeps them."""
    state = talos.standing()
    a = np.zeros(talos.nv)
    a[2] = -0.5
    error = refused(lambda: rbd.inverse_dynamics(state, a, talos.soles()))
    assert "'left_sole' (point " in str(error) and "would sink at 0.5" in str(error) and error.limits == ()
    near = error.nearest()
    assert np.abs(rbd.solve(state, near.tau, talos.soles()).a - near.a).max() < 1e-6
    assert abs(near.a[2]) < 0.5


def test_in_the_air_the_nearest_motion_falls(talos: rbd.Robot) -> None:
    """Of standing still: the centre of mass falls with g, whatever the motors do; of all such motions it is the nearest."""
    state = talos.standing()
    near = refused(lambda: rbd.hold(state, [])).nearest()
    A_g, _, mass = state.centroidal()
    assert A_g @ near.a == pytest.approx([0.0, 0.0, -mass * G, 0.0, 0.0, 0.0], abs=1e-6)
    assert off_by(rbd.solve(state, near.tau), near.a) < 1e-8
    assert near.a @ state.M @ near.a == pytest.approx(mass * G**2, rel=1e-8)  # falling without moving a joint


def test_a_motion_that_keeps_contacts_may_be_impossible() -> None:
    """A box without motors, lifted with five times its weight: its point only pushes, and cannot be kept on the ground."""
    one = box(2.0)
    state = rbd.State(one, pin.neutral(one.model))
    floor = [rbd.PointContact("toe", "box", offset=(0.0, 0.0, 0.0), friction=0.5, on=None)]
    lift = np.array([0.0, 0.0, 100.0, 0.0, 0.0, 0.0])
    error = refused(lambda: rbd.hold(state, floor, external=lift))
    with pytest.raises(NoSolution, match="no possible motion that keeps its contacts as they are"):
        error.nearest()


def off_by(found: rbd.Solution, a: Array) -> float:
    """How far a motion is from another, relative, in the metric of inertia."""
    M, e = found.problem.M, found.a - a
    return math.sqrt(e @ M @ e / max(1.0, a @ M @ a))


def test_the_nearest_takes_no_weights_and_may_not_be_there(talos: rbd.Robot) -> None:
    """Words, not crashes."""
    error = refused(lambda: rbd.hold(talos.standing(), talos.soles()[:1]))
    with pytest.raises(InputError, match="has none"):
        error.nearest(weights={"left_sole": 2.0})
    with pytest.raises(InputError, match="there is no nearest motion"):
        CannotMove("no").nearest()
    assert isinstance(error, CannotHold) and isinstance(error, NoSolution)


# --------------------------------------------------------------------------------------------------------------- words


def test_limits_tell_themselves() -> None:
    """In words, by kind."""
    words = {str(Limit(kind, "x")) for kind in "motor friction edge push opens slips base passive".split()}
    assert len(words) == 8 and "the torque limit of 'x'" in words and "the base, which no motor drives" in words


def test_messages_stay_short() -> None:
    """Of forty contacts in the way the first few are named, and the rest counted."""
    one = box(3.0)
    state = rbd.State(one, pin.neutral(one.model))
    many = [
        rbd.PointContact(f"point number {i}", "box", offset=(0.1, 0.01 * i, -0.1), friction=0.5, on=None) for i in range(40)
    ]
    error = refused(lambda: rbd.hold(state, many))
    assert len(str(error)) < 1500 and "and 32 more" in str(error)


def test_a_search_among_many_limits_is_cut_short(talos: rbd.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Then all that was not tried is named, as still refuted together, and said not to be irreducible."""
    ask = {"external": 100.0 * talos.standing().frame("torso_2_link").J[1]}
    whole = refused(lambda: rbd.hold(talos.standing(), talos.soles(0.1), **ask))
    monkeypatch.setattr("rbd.problem.programs.LIMIT_PROGRAMS", 2)
    part = refused(lambda: rbd.hold(talos.standing(), talos.soles(0.1), **ask))
    assert whole.irreducible and not part.irreducible and len(part.limits) > len(whole.limits)
    assert "All or some of these limits prevent it" in str(part) and "Together these limits prevent it" in str(whole)
    question = relaxable(talos.standing(), np.zeros(talos.nv), talos.soles(0.1), margin=0.0, **ask)
    assert (
        question.refuted([limit for limit in question.limits if limit not in part.limits and limit.kind != "push"]) is not None
    )


def test_with_a_margin_the_words_say_that_it_could_without(talos: rbd.Robot) -> None:
    """Between the margin's limit and friction's own."""
    state, push = talos.standing(), talos.standing().frame("torso_2_link").J[1]
    rbd.hold(state, talos.soles(0.1), external=87.0 * push)
    error = refused(lambda: rbd.hold(state, talos.soles(0.1), external=87.0 * push, margin=0.05))
    assert "friction is kept 5 % from its limit, and prevents it; with margin=0 it could" in str(error)
    assert not str(error).count("nearest()")
