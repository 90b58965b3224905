"""Derivatives of an answer against closed forms, and against differences of the whole solve on the manifold."""

from __future__ import annotations

import copy
import importlib
import pickle
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import nnls

import rbd
from rbd.answers.analysis.sensitivity import Derivatives
from rbd.answers.analysis.state_changes import SMOOTH, slope as slope_of
from rbd.model.external import generalised
from rbd.testing import box

G, MASS, MU = 9.81, 10.0, 0.6
TOLERANCE = 1e-7
"""Largest deviation from differences, over max(1, largest entry)."""
WEIGHTS = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
KINDS = {"dq": "da_dq", "dv": "da_dv", "dtau": "da_dtau", "dexternal": "da_dexternal"}
BOX, UNDER = box(MASS), pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
BEAD = rbd.PointContact("floor", "box", friction=MU)  # at the centre of mass: a point mass
PATCH = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=UNDER, friction=MU)

PATCH_HELD = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=UNDER)


def resting_box(push: Any, contacts: Sequence[Any], solver: Any, moment: Any = (0, 0, 0)) -> rbd.Solution:
    force = rbd.ExternalForce("box", push, moment)
    return rbd.solve(rbd.State(BOX, pin.neutral(BOX.model)), np.zeros(0), contacts, external=force, solver=solver)


def slope(f: Callable[[float], np.ndarray], h: float) -> np.ndarray:
    """Differences of the sixth order."""
    return sum(w * f(k * h) for k, w in zip(range(-3, 4), WEIGHTS, strict=True) if w) / h


def whole_solve(state: rbd.State, tau: Any, constraints: Any, external: Any, solver: Any, *, held: bool) -> np.ndarray:
    """(a, forces) of a new solve; `held` forgets the velocities that would change the modes of what is at rest."""
    rest_speed = 1.0 if held else 1e-6
    problem = rbd.gauss_problem(state, tau, constraints, external=external, rest_speed=rest_speed)
    if held:
        rows = [replace(r, velocity=np.zeros(len(r))) for r in problem.rows]
        problem = rbd.GaussProblem(problem.M, problem.rhs, rows)
    solution = rbd.Solution.of(solver.solve(problem))
    assert solution.status in (rbd.problem.Status.SOLVED, rbd.problem.Status.INACCURATE)
    return np.concatenate([solution.a, *solution.forces.values()])


def check_against_differences(
    state: rbd.State, tau: Any, constraints: Any, external: Any, solver: Any, *, h: float = 1e-3, held: bool = False
) -> Derivatives:
    """All four kinds, every column, motion and forces."""
    robot, nv = state.robot, state.robot.nv
    found = rbd.solve(state, tau, constraints, external=external, solver=solver).derivatives()
    model, more, none = robot.model, generalised(state, external)[0], np.zeros(nv)

    def answer(dq: np.ndarray, dv: np.ndarray, dtau: np.ndarray, push: np.ndarray | None) -> np.ndarray:
        at = rbd.State(robot, pin.integrate(model, state.q, dq), state.v + dv)
        return whole_solve(at, tau + dtau, constraints, external if push is None else more + push, solver, held=held)

    moved: dict[str, tuple[int, Callable[[np.ndarray], np.ndarray]]] = {
        "dq": (nv, lambda x: answer(x, none, np.zeros(robot.nu), None)),
        "dv": (nv, lambda x: answer(none, x, np.zeros(robot.nu), None)),
        "dtau": (robot.nu, lambda x: answer(none, none, x, None)),
        "dexternal": (nv, lambda x: answer(none, none, np.zeros(robot.nu), x)),
    }
    for kind, (n, f) in moved.items():
        forces = [getattr(force, kind) for force in found.forces.values() if force is not None]
        given = np.vstack([getattr(found, KINDS[kind]), *forces])
        expected = np.column_stack([slope(lambda t, f=f, e=e: f(t * e), h) for e in np.eye(n)])
        if None in found.forces.values():
            expected = expected[:nv]
        for part in (slice(nv), slice(nv, None)):
            scale = max(1.0, np.abs(expected[part]).max(initial=0.0))
            assert np.abs(given - expected)[part].max(initial=0.0) <= TOLERANCE * scale, (kind, part)
    return found


def bent(robot: rbd.Robot, seed: int) -> tuple[rbd.State, np.ndarray, list[rbd.ExternalForce]]:
    """Moving, anywhere near the posture, pushed at a link."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.standing().q, rng.uniform(-0.2, 0.2, robot.nv))
    push = rbd.ExternalForce(robot.frames()[-1], rng.normal(size=3) * 30.0, rng.normal(size=3), rng.normal(size=3) * 0.2)
    return rbd.State(robot, q, rng.normal(size=robot.nv)), 0.5 * robot.effort_limit * rng.uniform(-1.0, 1.0, robot.nu), [push]


@pytest.mark.parametrize("solver", [rbd.KKT(), rbd.ProxQP()], ids=["KKT", "ProxQP"])
@pytest.mark.parametrize("name", ["talos", "g1"])
def test_held_soles_of_a_moving_robot_agree_with_differences(name: str, solver: Any) -> None:
    """Any q and v, a push in world axes: every column of the motion and of the wrenches."""
    robot = rbd.load_robot(name)
    state, tau, push = bent(robot, 3)
    found = check_against_differences(state, tau, robot.soles(None, on=None), push, solver)
    assert found.active == {sole.name: ("holds",) * 6 for sole in robot.soles(None)} and not found.not_unique


@pytest.mark.parametrize(
    "solver", [rbd.ProxQP(), rbd.ConeSolver(law="convex"), rbd.ConeSolver()], ids=["pyramids", "convex", "coulomb"]
)
@pytest.mark.parametrize(("name", "seed", "noise"), [("talos", 0, 1.0), ("talos", 5, 40.0), ("g1", 8, 40.0)])
def test_soles_that_stick_slip_and_tip_agree_with_differences(name: str, seed: int, noise: float, solver: Any) -> None:
    """At rest on rubbing soles, torques off balance: the modes held, all columns, as the law of the solver has it."""
    robot, rng = rbd.load_robot(name), np.random.default_rng(seed)
    state = robot.standing()
    tau = rbd.hold(state, robot.soles()).tau + rng.normal(size=robot.nu) * noise
    tau = np.clip(tau, -0.9 * robot.effort_limit, 0.9 * robot.effort_limit)
    soles = robot.soles(float(rng.uniform(0.2, 1.0)), on=None)
    push = [rbd.ExternalForce(robot.frames()[-1], rng.normal(size=3) * 20.0)]
    found = check_against_differences(state, tau, soles, push, solver, h=1e-4, held=True)
    words = {word for each in found.active.values() for word in each}
    assert words == {"sticks"} if noise == 1.0 else "slips" in words


PANDA_JOINTS = [f"panda_joint{i}" for i in range(1, 8)]


def panda(seed: int) -> tuple[rbd.State, np.ndarray]:
    robot, rng = rbd.load_robot("panda", root="fixed"), np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.neutral(), rng.uniform(-0.3, 0.3, robot.nv))
    q[3], q[5] = -1.5, 1.5
    return rbd.State(robot, q, rng.normal(size=robot.nv)), rng.uniform(-6.0, 6.0, size=robot.nu)


@pytest.mark.parametrize("solver", [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()], ids=["KKT", "ProxQP", "ConeSolver"])
def test_joints_that_are_held_coupled_and_pulled_back_agree_with_differences(solver: Any) -> None:
    """A brake, a gear, and a lock with Baumgarte's feedback, which changes with q and with v."""
    state, tau = panda(1)
    constraints = [
        rbd.JointLock("brake", PANDA_JOINTS[1]),
        rbd.JointCoupling("gear", PANDA_JOINTS[2], PANDA_JOINTS[4], ratio=-0.7),
        rbd.constraints.Baumgarte(20.0).of(rbd.JointLock("pulled", PANDA_JOINTS[5], position=0.3)),
    ]
    check_against_differences(state, tau, constraints, None, solver)


@pytest.mark.parametrize(
    "contact",
    [
        rbd.PointContact("tip", "panda_hand", offset=(0.1, 0.05, 0.2), on=rbd.Ground(normal=(0.0, 0.6, 0.8))),
        rbd.constraints.Baumgarte(10.0).of(
            rbd.PointContact("tip", "panda_hand", offset=(0.1, 0.05, 0.2), anchor=(0.3, 0.1, 0.4))
        ),
        rbd.PointContact(
            "tip", "panda_hand", on=rbd.Ground(velocity=(0.1, 0.2, 0.3, 1, 2, 3), acceleration=(1, 2, 3), about=(0, 0, 0))
        ),
        rbd.LineContact("edge", "panda_hand", half_length=0.1),
        rbd.PointContact("pinch", "panda_hand", offset=(0.1, 0.0, 0.1), on=rbd.Body("panda_link2")),
    ],
    ids=["tilted ground", "anchored", "turntable", "line", "own arm"],
)
def test_contacts_that_hold_while_they_move_agree_with_differences(contact: Any) -> None:
    """A hand that moves, held to the ground, to ground that moves, along an edge, and to its own arm."""
    state, tau = panda(2)
    check_against_differences(state, tau, [contact], rbd.ExternalForce("panda_hand", (1.0, 2.0, 3.0)), rbd.ProxQP())


def test_dry_friction_holds_or_stands_at_its_bound() -> None:
    """Inside its bounds a joint's friction answers like a lock; at the bound it stays, and the joint is as free as without."""
    state, _ = panda(3)
    state = rbd.State(state.robot, state.q)
    tau = rbd.hold(state, []).tau
    tau[:2] += [1.0, 9.0]
    frictions = [rbd.JointFriction("first", PANDA_JOINTS[0], 3.0), rbd.JointFriction("second", PANDA_JOINTS[1], 3.0)]
    found = rbd.solve(state, tau, frictions, solver=rbd.ConeSolver()).derivatives()
    assert found.active == {"first": ("holds",), "second": ("yields",)}
    push = np.zeros(state.robot.nv)
    push[1] = -3.0  # what the yielding joint rubs with
    lock = rbd.solve(state, tau, [rbd.JointLock("first", PANDA_JOINTS[0])], external=push, solver=rbd.KKT()).derivatives()
    for kind in KINDS.values():
        assert np.abs(getattr(found, kind) - getattr(lock, kind)).max() < 1e-9 * max(1.0, np.abs(getattr(lock, kind)).max())
    assert lock.df_dtau is not None and np.abs(found.forces["first"].dtau - lock.df_dtau).max() < 1e-9
    assert not found.forces["second"].dq.any()


@pytest.mark.parametrize("pressed", [True, False])
def test_a_joint_at_its_stop_is_a_lock_or_free(pressed: bool) -> None:
    """Its row is gone as soon as q leaves the stop, so the derivative is taken from the stop's side: exactly a lock's."""
    state, _ = panda(4)
    state = rbd.State(state.robot, state.q)
    tau = rbd.hold(state, []).tau
    tau[3] += -30.0 if pressed else 30.0
    stops = [
        rbd.JointLimit("stop", PANDA_JOINTS[3], lower=float(state.q[3])),
        rbd.JointLimit("far", PANDA_JOINTS[5], upper=float(state.q[5]) + 0.01),  # within the reach of the differences
    ]
    found = rbd.solve(state, tau, stops).derivatives()
    assert found.active == {"stop": ("presses",) if pressed else ("opens",), "far": ()}
    lock = [rbd.JointLock("stop", PANDA_JOINTS[3])] if pressed else []
    expected = rbd.solve(state, tau, lock, solver=rbd.KKT()).derivatives()
    for kind in KINDS.values():
        assert np.abs(getattr(found, kind) - getattr(expected, kind)).max() < 1e-9


class TestTheSlippingPointMass:
    """10 kg, mu 0.6, pushed along x: all in closed form."""

    push = 80.0

    def test_coulomb(self) -> None:
        """Slides along the push with (P - mu N)/m: by P, by weight taken off, and sideways, where friction turns along."""
        found = resting_box((self.push, 0, 0), [BEAD], rbd.ConeSolver())
        d = found.derivatives()
        slide = (self.push - MU * MASS * G) / MASS
        expected = np.array([[1.0, 0.0, MU], [0.0, slide * MASS / self.push, 0.0], [0.0, 0.0, 0.0]]) / MASS
        assert d.active == {"floor": ("slips",)}
        assert np.abs(d.da_dexternal[:3, :3] - expected).max() < 1e-9
        force = np.array([[0.0, 0.0, MU], [0.0, slide * MASS / self.push - 1.0, 0.0], [0.0, 0.0, -1.0]])
        assert np.abs(d.forces["floor"].dexternal[:, :3] - force).max() < 1e-8

    @pytest.mark.parametrize("solver", [rbd.ConeSolver(law="convex"), rbd.ProxQP()], ids=["cone", "pyramid"])
    def test_convex(self, solver: Any) -> None:
        """What slides lifts: (P - mu m g) = m (1 + mu^2) slide. Sideways, the cone turns along and the pyramid holds on."""
        d = resting_box((self.push, 0, 0), [BEAD], solver).derivatives()
        slide = (self.push - MU * MASS * G) / (MASS * (1.0 + MU**2))
        along = 1.0 / (MASS * (1.0 + MU**2))
        assert abs(d.da_dexternal[0, 0] - along) < 1e-9 and abs(d.da_dexternal[2, 0] - MU * along) < 1e-9
        sideways = slide / self.push if isinstance(solver, rbd.ConeSolver) else 0.0
        assert abs(d.da_dexternal[1, 1] - sideways) < 1e-9
        assert abs(d.forces["floor"].dexternal[2, 0] - MU / (1.0 + MU**2)) < 1e-8

    def test_turning_the_base_turns_the_axes_of_a(self) -> None:
        """Yaw changes nothing in the world: a's components turn back, da = -z x a, and the world's force stays."""
        found = resting_box((self.push, 10.0, 0), [BEAD], rbd.ConeSolver())
        d = found.derivatives()
        assert np.abs(d.da_dq[:3, 5] + np.cross([0.0, 0.0, 1.0], found.a[:3])).max() < 1e-9
        assert np.abs(d.forces["floor"].dq).max() < 1e-6

    def test_friction_of_what_slides_already_turns_with_its_velocity(self) -> None:
        """The acceleration is (P - mu m g t)/m with t = v/|v|: sideways velocity turns it by -mu g/|v|."""
        speed = 0.5
        state = rbd.State(BOX, pin.neutral(BOX.model), np.array([speed, 0, 0, 0, 0, 0]))
        push = rbd.ExternalForce("box", (self.push, 0, 0))
        d = rbd.solve(state, np.zeros(0), [BEAD], external=push, solver=rbd.ConeSolver()).derivatives()
        assert d.active == {"floor": ("slides",)}
        assert np.abs(d.da_dv[:3, :2] - np.array([[0.0, 0.0], [0.0, -MU * G / speed], [0.0, 0.0]])).max() < 1e-8
        assert np.abs(d.da_dexternal[:3, 2] - np.array([MU, 0.0, 0.0]) / MASS).max() < 1e-9


@pytest.mark.parametrize("v", [(0.3, 0.4, 0.0, 0.0, 0.0, 0.0), (0.3, 0.4, 0.0, 0.0, 0.0, 2.0)], ids=["straight", "turning"])
def test_a_sliding_patch_agrees_with_differences_along_a_sliding_motion(v: tuple[float, ...]) -> None:
    """A three-cornered patch that slides and turns: friction turns with v, corners go round.

    Along a curve on which the patch goes on sliding: v is projected so that its corners neither rise nor sink.
    """
    patch = rbd.SurfaceContact("floor", "box", corners=[[0.2, 0.2], [-0.2, 0.1], [0.0, -0.2]], placement=UNDER, friction=MU)
    push = rbd.ExternalForce("box", (20.0, 0.0, 0.0), (0.1, 0.2, 0.3))
    rng = np.random.default_rng(0)
    q, (dq, dv) = pin.neutral(BOX.model), rng.normal(size=(2, 6))

    def at(t: float) -> rbd.State:
        moved = rbd.State(BOX, pin.integrate(BOX.model, q, dq * t), np.array(v) + dv * t)
        N = patch.rows(moved).J[2:5]
        return moved.with_velocity(moved.v - np.linalg.pinv(N) @ N @ moved.v)

    def answer(t: float) -> np.ndarray:
        solution = rbd.solve(at(t), np.zeros(0), [patch], external=push, solver=rbd.ConeSolver())
        return np.concatenate([solution.a, solution.forces["floor"]])

    d = rbd.solve(at(0.0), np.zeros(0), [patch], external=push, solver=rbd.ConeSolver()).derivatives()
    along = slope(lambda t: at(t).v, 1e-3)
    given = np.concatenate([d.da_dq @ dq + d.da_dv @ along, d.forces["floor"].dq @ dq + d.forces["floor"].dv @ along])
    expected = slope(answer, 1e-3)
    assert d.active == {"floor": ("slides",) * 3}
    assert np.abs(given - expected).max() < TOLERANCE * np.abs(expected).max()


def test_the_derivative_by_velocity_is_the_robots_own_while_the_soles_stay_put(talos: rbd.Robot) -> None:
    """No mode held by hand: along J v = 0 the soles stick by themselves, and the plain solve has this derivative."""
    rng, state, soles = np.random.default_rng(1), talos.standing(), talos.soles()
    tau = rbd.hold(state, soles).tau
    J = rbd.gauss_problem(state, tau, soles).J
    dv = rng.normal(size=talos.nv)
    dv -= np.linalg.pinv(J) @ (J @ dv)
    base = rbd.State(talos, state.q, dv)
    d = rbd.solve(base, tau, soles).derivatives()
    found = slope(lambda t: rbd.solve(rbd.State(talos, state.q, (1.0 + t) * dv), tau, soles).a, 1e-2)
    assert np.abs(found).max() > 0.1
    assert np.abs(d.da_dv @ dv - found).max() < TOLERANCE * np.abs(found).max()


class TestRedundantRows:
    """What is not unique is not given; the motion's derivatives are."""

    def test_four_held_corners_move_as_one_sole(self, talos: rbd.Robot) -> None:
        """24 rows of rank 12: no corner force is unique; the motion's derivatives are those of two held soles."""
        state, soles = talos.standing(), talos.soles(None)
        tau = 0.9 * rbd.hold(state, talos.soles()).tau
        corners = [
            rbd.PointContact(f"{sole.name} {i}", sole.frame, offset=sole.placement.act(corner))
            for sole in soles
            for i, corner in enumerate(sole.corners)
        ]
        by_corners = rbd.solve(state, tau, corners, solver=rbd.KKT()).derivatives()
        by_soles = rbd.solve(state, tau, soles, solver=rbd.KKT()).derivatives()
        for kind in KINDS.values():
            given, expected = getattr(by_corners, kind), getattr(by_soles, kind)
            assert np.abs(given - expected).max() < 1e-9 * max(1.0, np.abs(expected).max())
        assert by_corners.not_unique == tuple(c.name for c in corners) and set(by_corners.forces.values()) == {None}
        assert by_corners.df_dq is None and by_soles.df_dq is not None and "not unique" in str(by_corners)

    def test_a_sticking_pyramid_with_idle_rays_is_no_change_of_mode(self) -> None:
        """Sixteen rays for six components: whichever carry, the wrench is unique and its derivatives are a held patch's."""
        found = resting_box((10.0, 5.0, -3.0), [PATCH], rbd.ProxQP())
        basic = replace(found, weights=nnls(found.problem.force_set.pyramids.G, found.multipliers)[0])
        assert (basic.weights == 0.0).sum() >= 10 and basic.status is rbd.problem.Status.SOLVED
        d, expected = basic.derivatives(), resting_box((10.0, 5.0, -3.0), [PATCH_HELD], rbd.KKT()).derivatives()
        assert d.active == {"floor": ("sticks",) * 4}
        for kind, name in KINDS.items():
            assert np.abs(getattr(d, name) - getattr(expected, name)).max(initial=0.0) < 1e-8
            given = getattr(d.forces["floor"], kind) - getattr(expected.forces["floor"], kind)
            assert np.abs(given).max(initial=0.0) < 1e-6

    def test_corner_forces_at_the_edge_of_their_cones_can_be_shared_otherwise(self) -> None:
        """A split with a corner at its edge is no edge of the sole: another split of the same wrench has room."""
        found = resting_box((10.0, 5.0, -3.0), [PATCH], rbd.ConeSolver())
        T = found.problem.force_set
        w = found.weights.copy()
        G = T.G
        kernel = np.linalg.svd(G)[2][np.linalg.matrix_rank(G) :]
        step = kernel.T @ (kernel @ np.random.default_rng(0).normal(size=len(w)))

        def room(t: float) -> float:
            corner = (w + t * step).reshape(4, 3)
            return float((MU * corner[:, 2] - np.hypot(corner[:, 0], corner[:, 1])).min())

        low, high = 0.0, 1e4
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if room(middle) > 0.0 else (low, middle)
        edged = replace(found, weights=w + low * step)
        assert edged.status is rbd.problem.Status.SOLVED and abs(room(low)) < 1e-9
        assert np.abs(edged.derivatives().da_dq - found.derivatives().da_dq).max() < 1e-9


class TestRefused:
    """At a change of mode there are two derivatives, or none."""

    @pytest.mark.parametrize(
        "solver", [rbd.ProxQP(), rbd.ConeSolver(law="convex"), rbd.ConeSolver()], ids=["pyramid", "convex", "coulomb"]
    )
    @pytest.mark.parametrize(
        ("push", "moment", "contact"),
        [
            ((MU * MASS * G, 0.0, 0.0), (0.0, 0.0, 0.0), BEAD),  # about to slip
            ((0.0, 0.0, MASS * G), (0.0, 0.0, 0.0), BEAD),  # carries nothing
            ((0.0, 0.0, 0.0), (0.2 * MASS * G, 0.0, 0.0), PATCH),  # all weight on one edge
        ],
        ids=["edge of slipping", "weightless", "tipping"],
    )
    def test_the_edge_of_a_mode(self, push: Any, moment: Any, contact: Any, solver: Any) -> None:
        """The contact is named, and what to try; a little to either side there are derivatives, and they differ."""
        found = resting_box(push, [contact], solver, moment)
        with pytest.raises(
            rbd.errors.NotDifferentiable, match=r"'floor' is at a change of contact mode: .* Move q, tau or the push"
        ):
            found.derivatives()
        sides = [
            resting_box(np.array(push) * t, [contact], solver, np.array(moment) * t).derivatives().da_dexternal
            for t in (0.999, 1.001)
        ]
        assert np.abs(sides[0] - sides[1]).max() > 0.01

    def test_a_patch_that_slides_on_four_corners_has_no_one_motion(self) -> None:
        """Coulomb on a patch that slides and turns: two shares of one load, both lawful, move the box differently."""
        v = np.array([0.3, 0.4, 0.0, 0.0, 0.0, 2.0])
        push = rbd.ExternalForce("box", (20.0, 0.0, 0.0), (0.1, 0.2, 0.3))
        state = rbd.State(BOX, pin.neutral(BOX.model), v)
        with pytest.warns(rbd.errors.NonUniqueMotionWarning):
            found = rbd.solve(state, np.zeros(0), [PATCH], external=push, solver=rbd.ConeSolver())
        with pytest.raises(rbd.errors.NotDifferentiable, match="how the points that slip share the load is not unique"):
            found.derivatives()
        problem = rbd.gauss_problem(state, np.zeros(0), [PATCH], external=push)
        T = problem.force_set
        D = T.H.T @ problem.J @ np.linalg.solve(problem.M, problem.J.T @ T.G)
        free = T.H.T @ problem.free_row_acceleration + T.offset
        one = np.linalg.lstsq(D, -free, rcond=1e-12)[0]
        other = one + 5.0 * np.linalg.svd(D)[2][3]
        lawful = [(w > 0.0).all() and np.abs(D @ w + free).max() < 1e-9 for w in (one, other)]
        moved = [np.linalg.solve(problem.M, problem.J.T @ T.G @ w) for w in (one, other)]
        assert lawful == [True, True] and np.abs(moved[0] - moved[1]).max() > 0.1

    def test_a_singular_configuration(self) -> None:
        """The walker's two soles resist one twist twice, in this posture alone: the motion jumps, however small the move."""
        folder = Path(__file__).parents[1]
        sys.path.insert(0, str(folder / "examples"))
        try:
            example = importlib.import_module("03_your_own_robot")
        finally:
            sys.path.remove(str(folder / "examples"))
        walker = rbd.load_robot(example.URDF, feet=example.FEET)
        state = example.bent_knees(walker)
        soles = walker.soles(friction=None, on=None)
        push = rbd.ExternalForce("torso", (5.0, 3.0, 0.0), (0.0, 0.0, 2.0))
        tau = np.zeros(walker.nu)
        found = rbd.solve(state, tau, soles, external=push, solver=rbd.KKT())
        with pytest.raises(rbd.errors.NotDifferentiable, match="in this configuration and not nearby"):
            found.derivatives()
        dq = np.random.default_rng(0).normal(size=walker.nv)
        for t in (1e-3, 1e-5):
            near = rbd.State(walker, pin.integrate(walker.model, state.q, t * dq))
            assert np.abs(rbd.solve(near, tau, soles, external=push, solver=rbd.KKT()).a - found.a).max() > 0.5

    def test_feedback_with_a_kink(self) -> None:
        """A contact pushed out of the ground, and not pulled into it, has two slopes where it just touches."""
        bead = rbd.constraints.Baumgarte(10.0).of(rbd.PointContact("floor", "box", friction=MU, anchor=(0, 0, 0)))
        with pytest.raises(rbd.errors.NotDifferentiable, match=r"do not change smoothly with q\[2\]: its slopes"):
            resting_box((0, 0, 0), [bead], rbd.ProxQP()).derivatives()

    def test_a_set_of_forces_that_changes_with_the_state(self) -> None:
        """Bounds that depend on q are not differentiated: said, not left out."""

        class Sticky:
            name = "sticky"

            def rows(self, state: rbd.State) -> rbd.Rows:
                return rbd.Rows("sticky", np.eye(6)[:1], np.zeros(1), rbd.problem.Bounds([-1.0 - state.q[0]], [1.0]))

        with pytest.raises(rbd.errors.NotDifferentiable, match="the set of forces of 'sticky' changes"):
            resting_box((0.5, 0, 0), [Sticky()], rbd.ConeSolver()).derivatives()

    def test_rows_that_come_and_go_on_both_sides(self) -> None:
        """A constraint that acts at one position only."""

        class Fleeting:
            name = "fleeting"

            def rows(self, state: rbd.State) -> rbd.Rows:
                m = int(state.q[0] == 0.0)
                return rbd.Rows("fleeting", np.eye(6)[:m], np.zeros(m), rbd.problem.Free(m))

        with pytest.raises(rbd.errors.NotDifferentiable, match=r"q\[0\]: their rows appear and disappear"):
            resting_box((0.5, 0, 0), [Fleeting()], rbd.KKT()).derivatives()

    def test_what_is_no_answer(self) -> None:
        """Contradictory rows have a nearest motion, and no derivatives."""
        locks = [rbd.PointContact("still", "box"), rbd.PointContact("lift", "box", on=rbd.Ground(acceleration=(0, 0, 1.0)))]
        state = rbd.State(BOX, pin.neutral(BOX.model))
        found = rbd.solve(state, np.zeros(0), locks, solver=rbd.KKT(), check=False)
        with pytest.raises(rbd.errors.NotDifferentiable, match="this is no answer"):
            found.derivatives()

    def test_a_problem_built_by_hand(self) -> None:
        """It has no state."""
        solution = rbd.solve_problem(rbd.GaussProblem(np.eye(2), np.ones(2)))
        with pytest.raises(rbd.errors.Unsupported, match="built by hand has no state"):
            solution.derivatives()


def test_an_answer_travels_without_its_state() -> None:
    """A pickled solution is whole but for its derivatives, and says so; a copy in the same process has them."""
    found = resting_box((10.0, 5.0, -3.0), [PATCH], rbd.ConeSolver())
    sent = pickle.loads(pickle.dumps(found))
    assert np.array_equal(sent.a, found.a) and sent.status is rbd.problem.Status.SOLVED
    with pytest.raises(rbd.errors.Unsupported, match="its state stayed there"):
        sent.derivatives()
    assert np.array_equal(copy.deepcopy(found).derivatives().da_dq, found.derivatives().da_dq)


def test_without_constraints_the_derivatives_are_pinocchios(g1: rbd.Robot) -> None:
    """Free motion: computeABADerivatives, and M^-1 for torques and forces."""
    state, tau, _ = bent(g1, 5)
    d = rbd.solve(state, tau).derivatives()
    data = g1.model.createData()
    pin.computeABADerivatives(g1.model, data, state.q, state.v, g1.actuation.T @ tau)
    M_inverse = np.linalg.inv(state.M)
    expected = (data.ddq_dq, data.ddq_dv, M_inverse @ g1.actuation.T, M_inverse)
    for given, wanted in zip((d.da_dq, d.da_dv, d.da_dtau, d.da_dexternal), expected, strict=True):
        assert np.abs(given - wanted).max() < 1e-9 * np.abs(wanted).max()
    assert d.active == {} and d.forces == {} and "held: nothing" in str(d)


def test_a_smooth_constraint_with_short_waves_gets_short_steps() -> None:
    """On z = sin(k x)/k with waves of a millimetre: the step shrinks until the two rules agree."""
    k = 2.0e3 * np.pi

    class Washboard:
        name = "washboard"

        def rows(self, state: rbd.State) -> rbd.Rows:
            x, u = state.q[0], state.v[0]
            return rbd.Rows(
                "washboard",
                np.array([[-np.cos(k * x), 0, 1.0, 0, 0, 0]]),
                np.array([k * np.sin(k * x) * u * u]),
                rbd.problem.Free(1),
            )

    q = pin.neutral(BOX.model)
    q[0] = 2e-4
    d = rbd.solve(rbd.State(BOX, q), np.zeros(0), [Washboard()], solver=rbd.KKT()).derivatives()
    s, c = np.sin(k * q[0]), np.cos(k * q[0])
    # On a slope c: a_x = -g c/(1 + c^2), whose derivative by x is g k s (1 - c^2)/(1 + c^2)^2.
    expected = G * k * s * (1.0 - c * c) / (1.0 + c * c) ** 2
    assert abs(d.da_dq[0, 0] - expected) < 1e-6 * abs(expected)


def test_the_page_of_a_solution_says_what_was_held(talos: rbd.Robot) -> None:
    """One line: sizes, and what each constraint does."""
    state = talos.standing()
    d = rbd.solve(state, rbd.hold(state, talos.soles()).tau, talos.soles()).derivatives()
    assert str(d) == "nv = 38, nu = 32, held: left_sole sticks (4); right_sole sticks (4)" and str(d) in repr(d)


def test_a_sample_rounded_to_eight_digits_has_a_slope_of_five() -> None:
    """No step is fine enough for 1e-7, and the best one is taken: 2, to what the rounding leaves."""
    found = slope_of(lambda x: np.array([2.0 * x + 1e-8 * np.sin(1e9 * x)]), np.zeros(1), 0.01, "q")
    assert 0.0 < abs(found[0] - 2.0) < 1e3 * SMOOTH
    with pytest.raises(rbd.errors.NotDifferentiable, match="its slopes on the two sides differ"):
        slope_of(lambda x: np.array([abs(x)]), np.zeros(1), 0.01, "q")
