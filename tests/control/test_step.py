"""A step of whole-body control: equal to a dense program, its equations met, its violation the least, the same bits again."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin
import pytest
from dense_step import corner_maps, dense_step, rays
from moving_states import NAMES, drawn, robot
from scipy.optimize import lsq_linear, minimize

import rbd
from rbd.arrays import Array
from rbd.constraints import JointLock, SurfaceContact
from rbd.constraints.constraint import Constraint
from rbd.control import (
    ComTask,
    ForceTask,
    FrameTask,
    Limits,
    MomentumTask,
    PostureTask,
    Reference,
    Task,
    TaskActuation,
    TaskTerms,
    step,
    step_program,
)
from rbd.control.step_problem import StepProblem
from rbd.control.step_program import by_clarabel, by_daqp, minimiser
from rbd.errors import DistantContactWarning, DuplicateName, InputError, RelaxedLimitsWarning, UnknownName
from rbd.solvers.qp import StrictAnswer
from rbd.testing import box

G = 9.81
ONLY_TORQUES = Limits(position=False, velocity=False)
TORSO = {"talos": "torso_2_link", "g1": "torso_link", "solo12": "base_link"}


def relative(found: Array, expected: Array) -> float:
    return float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max()))


def tasks_of(state: rbd.State, rng: np.random.Generator) -> list[Task]:
    """Those of a walking robot, their targets a little off."""
    one = state.robot
    posture = PostureTask(pin.integrate(one.model, state.q, 0.1 * rng.normal(size=one.nv)), cost=0.5, gain=40.0)
    if not one.floating:
        return [posture]
    torso = FrameTask(TORSO[one.name], np.eye(3), orientation_cost=10.0, gain=80.0)
    com = ComTask(state.com + 0.02 * rng.normal(size=3), cost=100.0, gain=60.0)
    return [com, MomentumTask(angular_cost=0.02 * one.mass**2, gain=3.0), torso, posture]


def problem_of(state: rbd.State, tasks: Sequence[Task], contacts: Sequence[Constraint], **given: object) -> StepProblem:
    """What `step` solves."""
    asked = {"limits": Limits(), "external": None, "normal_force": None} | given
    return StepProblem.of(
        state, tasks, contacts, 0.0, asked["limits"], asked["external"], asked["normal_force"], 50.0, stacklevel=2
    )  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------ another program


@pytest.mark.parametrize("name", NAMES)
def test_a_step_equals_a_dense_program_with_nothing_eliminated(name: str) -> None:
    """50 random moving states of each robot, on all feet or one fewer, with few or many torques: a and tau to 1e-8."""
    one, rng = robot(name), np.random.default_rng(1)
    limited, unloaded, count = 0, 0, 0
    for i in range(50):
        moving = drawn(one, rng)
        state, contacts = moving.state, list(moving.contacts)
        if one.floating and i % 2:
            contacts = contacts[1:]
        tasks, share = tasks_of(state, rng), (1.0, 0.3, 0.15)[i % 3]
        limits = Limits(torque=share, position=False, velocity=i % 5 == 1, horizon=0.5)
        normal = {contacts[-1].name: (0.0, 0.3 * one.mass * G)} if one.floating and i % 4 == 3 else None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RelaxedLimitsWarning)
            found = step(state, tasks, contacts, limits=limits, normal_force=normal)
        if found.violation is not None:
            continue
        count += 1
        bounds = limits.accelerations(state)
        a, tau, miss = dense_step(state, tasks, contacts, share=share, normal_force=normal, bounds=bounds)
        assert miss < 1e-11
        assert relative(found.a, a) < 1e-8 and relative(found.tau, tau) < 1e-8, i
        assert found.status == "solved" and found.residuals.worst < 1e-9
        limited += "torque" in found.at_limit
        unloaded += bool((found.weights[found.loads.sets.lower == 0.0] == 0.0).any())
    assert count >= 40
    least = {"talos": (20, 30), "g1": (20, 30), "solo12": (0, 30), "leg": (0, 0)}[
        name
    ]  # solo12's limits are far, the leg has no cones
    assert limited >= least[0] and unloaded >= least[1]


@pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
def test_the_rate_of_momentum_is_what_the_contacts_and_the_weight_make(name: str) -> None:
    """Of every step, by Pinocchio's own centroidal calls: linear and about the centre of mass."""
    one, rng = robot(name), np.random.default_rng(4)
    model, data = one.model, one.model.createData()
    for _ in range(20):
        moving = drawn(one, rng)
        state = moving.state
        found = step(state, tasks_of(state, rng), moving.contacts, limits=ONLY_TORQUES)
        pin.computeCentroidalMomentumTimeVariation(model, data, state.q, state.v, found.a)
        rate = np.concatenate([data.dhg.linear, data.dhg.angular])
        total = np.concatenate([one.mass * one.gravity, np.zeros(3)])
        for contact in moving.contacts:
            patch, force = contact.rows(state).patch, found.forces[contact.name]
            assert patch is not None
            total[:3] += force[:3]
            total[3:] += np.cross(patch.point - data.com[0], force[:3]) + (force[3:] if len(force) == 6 else 0.0)
        assert np.abs(rate - total).max() < 1e-9 * one.mass * G


def test_solving_forward_gives_the_motion_back() -> None:
    """`rbd.solve` with the torques of a step whose soles stick inside their cones."""
    one, rng, count = robot("talos"), np.random.default_rng(5), 0
    for _ in range(10):
        moving = drawn(one, rng)
        state = moving.state
        found = step(state, tasks_of(state, rng), moving.contacts, limits=ONLY_TORQUES, contact_damping=0.0)
        back = rbd.solve(state, found.tau, moving.contacts)
        if max(np.abs(c).max() for c in back.accelerations.values()) > 1e-6:
            continue  # at the edge of a cone other motions may be possible too
        count += 1
        assert relative(back.a, found.a) < 1e-8
    assert count >= 5


# ------------------------------------------------------------------------------------------------ the certificate


def test_the_certificate_sees_every_wrong_number() -> None:
    """Each entry of the minimiser and of its multipliers matters; each law of the step has a residual of its own."""
    moving = drawn(robot("talos"), np.random.default_rng(6))
    state = moving.state
    problem = problem_of(state, tasks_of(state, np.random.default_rng(0)), moving.contacts, limits=Limits(torque=0.2))
    program = problem.program
    point, miss = minimiser(program)
    assert point is not None and miss < 1e-10 and point.z.any()
    for what in ("x", "y", "z", "bounds"):
        value = getattr(point, what)
        for i in range(len(value)):
            moved = value.copy()
            moved[i] += 1e-4 * max(1.0, abs(value[i]))
            assert program.optimality(point._replace(**{what: moved})) > 1e-9, (what, i)
    assert program.optimality(point._replace(x=np.full_like(point.x, np.nan))) == np.inf


def test_the_same_input_gives_the_same_bits() -> None:
    """Whatever was asked before; a fresh robot, and fresh tasks."""
    kept = []
    for seed in (0, 1):
        one = rbd.load_robot("talos")
        soles = one.soles(0.7, on=None)
        if seed:
            step(one.standing(), [PostureTask(one.standing().q)], soles[:1])
        moving = drawn(one, np.random.default_rng(8))
        for _ in range(2):
            found = step(moving.state, tasks_of(moving.state, np.random.default_rng(9)), soles)
            kept.append((found.tau.tobytes(), found.a.tobytes(), found.weights.tobytes()))
    assert len(set(kept)) == 1


@pytest.mark.parametrize("name", ["talos", "solo12"])
def test_every_method_finds_the_same_step(name: str) -> None:
    """By DAQP on few rows or on independent ones, and by Clarabel: to 1e-7."""
    one, rng = robot(name), np.random.default_rng(10)
    for share in (1.0, 0.4):
        moving = drawn(one, rng)
        program = problem_of(moving.state, tasks_of(moving.state, rng), moving.contacts, limits=Limits(torque=share)).program
        best, miss = minimiser(program)
        assert best is not None and miss < 1e-11
        second, solved = by_daqp(program)
        assert solved
        for other in (second, by_clarabel(program)[0]):
            (w, a), (best_w, best_a) = (np.split(each.x, [program.p]) for each in (other, best))
            assert relative(a, best_a) < 1e-7 and relative(w, best_w) < 1e-6


# ------------------------------------------------------------------------------------------------ the least violation


@pytest.mark.parametrize("name", ["talos", "g1"])
def test_what_cannot_be_kept_is_violated_by_the_least(name: str) -> None:
    """Equal to bounded least squares over torques and forces, of SciPy, of robots that are pulled and move fast."""
    one, rng = robot(name), np.random.default_rng(1)
    count = 0
    for share in (0.2, 0.05, 0.1, 0.02):
        moving = drawn(one, rng, speed=4.0)
        state, limits = moving.state, Limits(torque=share, position=False, velocity=False)
        pull = [rbd.ExternalForce(TORSO[name], (0.2 * one.mass * G, 0.0, 1.5 * one.mass * G))]
        tasks = tasks_of(state, rng)
        with pytest.warns(RelaxedLimitsWarning, match="left_sole"):
            found = step(state, tasks, moving.contacts, limits=limits, external=pull)
        assert found.violation is not None and found.status == "solved"
        missed = np.concatenate([found.violation.contacts.get(c.name, np.zeros(6)) for c in moving.contacts])
        sizes = np.tile([1.0, 1.0, 1.0, 0.1, 0.1, 0.1], 2)
        assert 0.5 * ((sizes * missed) ** 2).sum() == pytest.approx(
            _least(state, moving.contacts, share, pull, sizes), rel=1e-9
        )
        rows = [c.rows(state) for c in moving.contacts]
        reached = np.concatenate([r.J @ found.a + r.bias + 50.0 * r.velocity for r in rows])
        assert np.abs(reached - missed).max() < 1e-8 * np.abs(found.a).max()
        assert (np.abs(found.tau) <= share * one.effort_limit * (1.0 + 1e-12)).all()
        count += 1
    assert count == 4


def _least(
    state: rbd.State, contacts: Sequence[Constraint], share: float, pull: list[rbd.ExternalForce], sizes: Array
) -> float:
    """Half the sum of squares of contact accelerations over torques within limits and forces within pyramids."""
    one = state.robot
    rows = [c.rows(state) for c in contacts]
    J, wanted = np.concatenate([r.J for r in rows]), np.concatenate([-r.bias - 50.0 * r.velocity for r in rows])
    P = []
    for contact in contacts:
        for point, axes in corner_maps(state, contact):
            P.append(point.T @ axes @ rays(0.7))
    limit = share * one.effort_limit
    B = np.linalg.solve(state.M, np.concatenate([one.actuation.T * limit, one.mass * G * np.concatenate(P, axis=1)], axis=1))
    at = state.frame(TORSO[one.name])
    free = np.linalg.solve(state.M, at.J[:3].T @ pull[0].force - state.h)
    n = B.shape[1] - one.nu
    bounds = np.concatenate([-np.ones(one.nu), np.zeros(n)]), np.concatenate([np.ones(one.nu), np.full(n, np.inf)])
    found = lsq_linear(sizes[:, None] * (J @ B), sizes * (wanted - J @ free), bounds, method="bvls", tol=1e-14, max_iter=3000)
    return float(found.cost)


def test_joints_that_cannot_brake_in_time_pass_their_bounds_by_the_least() -> None:
    """A fast arm with a hundredth of its torques: as SciPy's L-BFGS-B has it over the torques, to six digits."""
    arm = rbd.load_robot("ur5", root="fixed")
    rng, count = np.random.default_rng(11), 0
    for _ in range(6):
        state = rbd.State(arm, rng.uniform(-2.0, 2.0, arm.nq), 4.0 * rng.normal(size=arm.nv))
        limits = Limits(torque=0.01)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RelaxedLimitsWarning)
            found = step(state, [PostureTask(state.q)], limits=limits)
        least, most = limits.accelerations(state)
        other = _least_passed(state, least, most, 0.01 * arm.effort_limit)
        own = np.minimum(found.a - least, 0.0) + np.maximum(found.a - most, 0.0)
        assert 0.5 * own @ own == pytest.approx(other, rel=1e-6, abs=1e-12)
        if found.violation is not None:
            count += 1
            told = found.violation.joints
            assert sorted(told.values()) == pytest.approx(sorted(np.abs(own[np.abs(own) > 1e-6])), rel=1e-6)
            assert all(abs(own[arm.joints[name].v.start]) == pytest.approx(x, rel=1e-6) for name, x in told.items())
    assert count >= 2


def _least_passed(state: rbd.State, least: Array, most: Array, limit: Array) -> float:
    """Half the sum of squares by which accelerations pass their bounds, over torques within limits."""
    free, B = -np.linalg.solve(state.M, state.h), np.linalg.inv(state.M) * limit

    def half(share: Array) -> tuple[float, Array]:
        a = free + B @ share
        passed = np.minimum(a - least, 0.0) + np.maximum(a - most, 0.0)
        return 0.5 * float(passed @ passed), B.T @ passed

    options = {"ftol": 1e-16, "gtol": 1e-12, "maxiter": 10000, "maxfun": 100000}
    sides = [(-1.0, 1.0)] * len(limit)
    return float(minimize(half, np.zeros(len(limit)), jac=True, method="L-BFGS-B", bounds=sides, options=options).fun)


def test_where_daqp_fails_another_solver_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """DAQP's verdict is not the end: with one that always finds none, the step is the same."""
    moving = drawn(robot("talos"), np.random.default_rng(12))
    tasks = tasks_of(moving.state, np.random.default_rng(0))
    before = step(moving.state, tasks, moving.contacts)

    def none(H: Array, g: Array, lower: Array, upper: Array, C: Array, low: Array, high: Array) -> StrictAnswer:
        return StrictAnswer(np.zeros(len(g)), np.zeros(len(lower)), np.zeros(len(low)), 0, False)

    monkeypatch.setattr(step_program, "solve_strict", none)
    after = step(moving.state, tasks, moving.contacts)
    assert after.violation is None and after.certificate.worst < 1e-9
    assert relative(after.a, before.a) < 1e-8 and relative(after.tau, before.tau) < 1e-6


def test_a_printed_answer_tells_what_tasks_missed() -> None:
    """A robot in the air falls, whatever its centre of mass is wanted to do."""
    solo = robot("solo12")
    state = solo.standing()
    falls = step(state, [rbd.control.ComTask(state.com), rbd.control.PostureTask(state)])
    assert str(falls).startswith("meets its tasks at least cost: ") and "missed [m/s2, rad/s2]: com 9.81" in str(falls)


def test_a_box_that_is_lifted_leaves_the_floor_as_it_must() -> None:
    """120 N on 10 kg: it accelerates at (120 - 98.1) / 10 m/s2, the contact carries nothing, and the warning says so."""
    body = box(mass=10.0)
    floor = SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=0.5, on=None)
    lift = rbd.ExternalForce("box", (0.0, 0.0, 120.0))
    state = rbd.State(body, [0, 0, 0.1, 0, 0, 0, 1])
    with pytest.warns(RelaxedLimitsWarning, match=r"'floor' accelerates by 2\.19 m/s2"):
        found = step(state, [], [floor], external=[lift])
    assert found.a == pytest.approx([0, 0, 2.19, 0, 0, 0], abs=1e-10)
    assert found.violation is not None and found.violation.worst == pytest.approx(2.19)
    assert np.abs(found.forces["floor"]).max() < 1e-9


def test_contacts_that_contradict_each_other_meet_half_way() -> None:
    """A floor at rest and one that rises at 1 m/s2; corners of a turning patch, held: rows that no acceleration meets."""
    body = box(mass=10.0)
    state = rbd.State(body, [0, 0, 0.1, 0, 0, 0, 1], [0, 0, 0, 0.3, 0.2, 0.5])
    floor = SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), on=None)
    rising = SurfaceContact("rising", "box", half_lengths=(0.2, 0.2), on=rbd.Ground(acceleration=(0, 0, 1.0)))
    with pytest.warns(RelaxedLimitsWarning):
        found = step(rbd.State(body, state.q), [], [floor, rising])
    assert found.a == pytest.approx([0, 0, 0.5, 0, 0, 0], abs=1e-10)
    corners = [
        rbd.PointContact(f"corner {i}", "box", offset=(x, y, -0.1), friction=None, on=None)
        for i, (x, y) in enumerate([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)])
    ]
    with pytest.warns(RelaxedLimitsWarning):
        found = step(state, [], corners)
    rows = [c.rows(state) for c in corners]
    J, wanted = np.concatenate([r.J for r in rows]), np.concatenate([-r.bias - 50.0 * r.velocity for r in rows])
    assert found.a == pytest.approx(np.linalg.lstsq(J, wanted, rcond=None)[0], abs=1e-9)


def test_redundant_contacts_are_kept() -> None:
    """Four points and two patches on one body, a loop twice: rows that depend on each other, and no violation."""
    body = box(mass=10.0)
    state = rbd.State(body, [0, 0, 0.1, 0, 0, 0, 1])
    points = [rbd.PointContact(f"p{x}{y}", "box", offset=(x, y, -0.1), friction=0.5) for x in (0.2, -0.2) for y in (0.2, -0.2)]
    found = step(state, [], points)
    assert found.violation is None and found.certificate.worst < 1e-12
    assert [f[2] for f in found.forces.values()] == pytest.approx([98.1 / 4] * 4)
    leg = robot("leg")
    moving = drawn(leg, np.random.default_rng(3))
    once = step(moving.state, [PostureTask(moving.state.q, cost=1e6, gain=10.0)], moving.contacts)
    again = [_renamed(c) for c in moving.contacts]
    twice = step(moving.state, [PostureTask(moving.state.q, cost=1e6, gain=10.0)], [*moving.contacts, *again])
    assert twice.violation is None and relative(twice.a, once.a) < 1e-9 and relative(twice.tau, once.tau) < 1e-8


def _renamed(constraint: Constraint) -> Constraint:
    return dataclasses.replace(constraint, name=f"{constraint.name} again")  # type: ignore[type-var]


def test_a_moving_contact_is_brought_to_rest_at_its_rate() -> None:
    """J a + J_dot v = -k J v; a foot that slides or rises is no error, and is said."""
    solo = robot("solo12")
    feet = solo.feet(0.7, on=None)
    state = solo.standing().with_velocity(np.concatenate([[0.1, 0.0, 0.2], np.zeros(15)]))
    found = step(state, [PostureTask(state.q)], feet, contact_damping=20.0, limits=ONLY_TORQUES)
    assert found.violation is None and set(found.moving) == {foot.name for foot in feet}
    assert "is brought to rest" in str(found)
    for foot in feet:
        r = foot.rows(state)
        assert r.J @ found.a + r.bias == pytest.approx(-20.0 * r.velocity, abs=1e-9)
    still = step(solo.standing(), [PostureTask(state.q)], feet)
    assert not still.moving


# ------------------------------------------------------------------------------------------------ forces, words, bad input


def test_normal_forces_stay_within_their_bounds() -> None:
    """At most 3 N, between 2 and 4 N, none at all: the others carry the rest."""
    solo = robot("solo12")
    state, feet = solo.standing(), solo.feet(0.7)
    bounds = {"front_left": (0.0, 3.0), "hind_left": (0.0, 0.0)}
    found = step(state, [PostureTask(state.q)], feet, normal_force=bounds)
    normal = {name: force[2] for name, force in found.forces.items()}
    assert found.certificate.worst < 1e-9 and normal["front_left"] <= 3.0 + 1e-9 and normal["hind_left"] == 0.0
    pressed = step(state, [PostureTask(state.q)], feet, normal_force={"front_left": (9.0, 9.0)})
    assert pressed.forces["front_left"][2] == pytest.approx(9.0)


def test_what_was_missed_is_wanted_less_reached() -> None:
    """Of accelerations, of a force alone and of a wrench."""
    talos = robot("talos")
    state, soles = talos.standing(), talos.soles(0.7)
    up = ComTask(Reference(state.com, acceleration=[0.0, 0.0, 0.5]), cost=3.0)
    force = ForceTask("left_sole", [0.0, 0.0, 300.0], name="force")
    wrench = ForceTask("right_sole", [0.0, 0.0, 400.0, 1.0, 2.0, 0.0], name="wrench")
    found = step(state, [up, force, wrench], soles)
    A_g, _, mass = state.centroidal()
    assert found.missed["com"] == pytest.approx([0.0, 0.0, 0.5] - A_g[:3] @ found.a / mass, abs=1e-9)
    assert found.missed["force"] == pytest.approx(([0.0, 0.0, 300.0] - found.forces["left_sole"][:3]) / mass, abs=1e-9)
    assert found.missed["wrench"] == pytest.approx((np.array(wrench.target) - found.forces["right_sole"]) / mass, abs=1e-9)  # type: ignore[arg-type]


def test_limits_that_are_reached_are_named() -> None:
    """Torques at their share of the limits; and the words of a step."""
    talos = robot("talos")
    state, soles = talos.standing(), talos.soles(0.7)
    found = step(state, [ComTask(state.com + [0.0, 0.0, 0.5])], soles, limits=Limits(torque=0.1, position=False))
    limited = found.at_limit["torque"]
    share = np.abs(found.tau) / talos.effort_limit
    assert limited == tuple(name for name, s in zip(talos.actuated_names, share, strict=True) if s > 0.1 - 1e-7)
    assert share.max() <= 0.1 and "torque limits: " in str(found) and repr(found).startswith("TaskActuation(meets its tasks")
    assert found.program.H.shape == (32, 32)  # made when it is asked for


BAD: dict[str, tuple[type[Exception], str, Callable[[rbd.State, list[SurfaceContact]], TaskActuation]]] = {
    "no state": (InputError, "State", lambda s, c: step(s.q, [], c)),  # type: ignore[arg-type]
    "one task": (InputError, "list", lambda s, c: step(s, PostureTask(s.q), c)),  # type: ignore[arg-type]
    "no task": (InputError, "no task", lambda s, c: step(s, [3], c)),  # type: ignore[list-item]
    "one contact": (InputError, "list", lambda s, c: step(s, [], c[0])),  # type: ignore[arg-type]
    "tasks of one name": (DuplicateName, "posture", lambda s, c: step(s, [PostureTask(s.q)] * 2, c)),
    "contacts of one name": (DuplicateName, "left_sole", lambda s, c: step(s, [], [c[0], c[0]])),
    "limits": (InputError, "limits", lambda s, c: step(s, [], c, limits=1.0)),  # type: ignore[arg-type]
    "a time": (InputError, "t is", lambda s, c: step(s, [], c, t=np.nan)),
    "damping": (InputError, "contact_damping", lambda s, c: step(s, [], c, contact_damping=-1.0)),
    "force of whom": (UnknownName, "nearest: 'left_sole'", lambda s, c: step(s, [ForceTask("left_sol", [0, 0, 1.0])], c)),
    "bounds of whom": (UnknownName, "nearest: 'left_sole'", lambda s, c: step(s, [], c, normal_force={"left_sol": (0, 1)})),
    "bounds that cross": (InputError, "normal_force", lambda s, c: step(s, [], c, normal_force={"left_sole": (2, 1)})),
    "bounds that pull": (InputError, "normal_force", lambda s, c: step(s, [], c, normal_force={"left_sole": (-2, -1)})),
    "bounds of no contact": (
        InputError,
        "what is no contact here",
        lambda s, c: step(s, [], [JointLock("lock", "torso_1_joint")], normal_force={"lock": (0, 1)}),
    ),
    "no bounds": (InputError, "normal_force", lambda s, c: step(s, [], c, normal_force=[1.0])),  # type: ignore[arg-type]
    "NaN of a task": (InputError, "own", lambda s, c: step(s, [_Own(np.full((1, s.robot.nv), np.nan))], c)),
    "NaN of a constraint": (InputError, "rows of 'wild'", lambda s, c: step(s, [], [_Wild()])),
    "a task of another robot": (InputError, "own", lambda s, c: step(s, [_Own(np.ones((1, 3)))], c)),
    "terms that are none": (InputError, "TaskTerms", lambda s, c: step(s, [_Own(None)], c)),
}


class _Own:
    """A user's task that gives wrong terms."""

    name = "own"

    def __init__(self, A: Array | None) -> None:
        self.A = A

    def terms(self, state: rbd.State, t: float) -> TaskTerms:
        if self.A is None:
            return None  # type: ignore[return-value]
        return TaskTerms("own", self.A, np.zeros(1), np.ones(1))


class _Wild:
    """A user's constraint that gives NaN."""

    name = "wild"

    def rows(self, state: rbd.State) -> rbd.Rows:
        return rbd.Rows("wild", J=np.full((1, state.robot.nv), np.nan), bias=np.zeros(1), cone=rbd.problem.Free(1))


@pytest.mark.parametrize("what", BAD)
def test_bad_input_is_refused_by_name(what: str) -> None:
    """Before anything is solved."""
    talos = robot("talos")
    error, words, ask = BAD[what]
    with pytest.raises(error, match=words):
        ask(talos.standing(), talos.soles(0.7))


def test_a_robot_without_contacts_and_one_without_gravity_are_moved() -> None:
    """A fixed arm reaches what is wanted exactly; a box in flight falls."""
    arm = rbd.load_robot("panda", root="fixed")
    state = arm.at()
    wanted = Reference(state.q, acceleration=np.linspace(-1.0, 1.0, arm.nv))
    found = step(state, [PostureTask(wanted, cost=1e3)], limits=Limits(torque=None, position=False, velocity=False))
    assert found.a == pytest.approx(np.linspace(-1.0, 1.0, arm.nv), abs=1e-6)
    assert found.tau == pytest.approx(state.M @ found.a + state.h, abs=1e-9)
    falling = step(rbd.State(box(), [0, 0, 1, 0, 0, 0, 1]), [])
    assert falling.a == pytest.approx([0, 0, -G, 0, 0, 0], abs=1e-9) and not falling.forces


def test_warnings_name_the_line_that_asked() -> None:
    """Of contacts off their planes, and of a violation."""
    solo = robot("solo12")
    state = solo.standing()
    high = state.q.copy()
    high[2] += 0.05
    with pytest.warns(DistantContactWarning, match="50 mm above") as seen:
        step(rbd.State(solo, high), [], solo.feet(0.7))
    floor = rbd.PointContact("floor", "box", friction=0.5, on=None)
    lift = rbd.ExternalForce("box", (0.0, 0.0, 200.0))
    with pytest.warns(RelaxedLimitsWarning) as more:
        step(rbd.State(box(mass=10.0), [0, 0, 0, 0, 0, 0, 1]), [], [floor], external=lift)
    assert {w.filename for w in (*seen, *more)} == {__file__}
