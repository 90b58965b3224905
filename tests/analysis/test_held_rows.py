"""Derivatives of held and sticking answers: Pinocchio's against differences, and two ways to solve with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.active_set import ActiveSet, HeldRows
from rbd.answers.analysis.sensitivity import Derivatives
from rbd.constraints.fixed_rows import are_constant, fixed_rows_of

MOTION = ("da_dq", "da_dv", "da_dtau", "da_dexternal")
ROWS = ("df_dq", "df_dv", "df_dtau", "df_dexternal")
FORCES = ("dq", "dv", "dtau", "dexternal")


@dataclass(frozen=True, eq=False)
class Opaque:
    """A constraint that tells nothing but its rows: its derivatives are taken by differences."""

    given: Any

    @property
    def name(self) -> str:
        """The constraint's."""
        return self.given.name

    def rows(self, state: rbd.State) -> rbd.Rows:
        """The constraint's."""
        return self.given.rows(state)


class Tilting(rbd.PointContact):
    """A contact with rows of its own."""

    def rows(self, state: rbd.State) -> rbd.Rows:
        """Those of a point, twice as large."""
        r = super().rows(state)
        return rbd.Rows(self.name, 2.0 * r.J, 2.0 * r.bias, rbd.problem.Free(3))


def compare(found: Derivatives, expected: Derivatives, within: float) -> None:
    """All arrays, motion and forces, over max(1, largest entry)."""
    assert found.active == expected.active and found.not_unique == expected.not_unique
    pairs = [(getattr(found, kind), getattr(expected, kind)) for kind in (*MOTION, *ROWS)]
    for name, force in expected.forces.items():
        assert (found.forces[name] is None) == (force is None)
        pairs += [(getattr(found.forces[name], kind), getattr(force, kind)) for kind in FORCES if force is not None]
    for one, other in pairs:
        assert (one is None) == (other is None)
        if one is not None:
            assert np.abs(one - other).max(initial=0.0) <= within * max(1.0, np.abs(other).max(initial=0.0))


def draw(robot: rbd.Robot, seed: int, *, moving: bool) -> tuple[rbd.State, np.ndarray, list[rbd.ExternalForce]]:
    """Near the posture, pushed at a link by a force and a moment."""
    rng, state = np.random.default_rng(seed), robot.standing()
    F = 0.01 * robot.mass * 9.81
    push = rbd.ExternalForce(robot.frames()[-1], F * rng.normal(size=3), 0.1 * F * rng.normal(size=3), rng.normal(size=3) * 0.1)
    tau = rbd.hold(state, robot.feet()).tau
    if not moving:
        return state, tau + 0.02 * F * rng.normal(size=robot.nu), [push]
    q = pin.integrate(robot.model, state.q, rng.uniform(-0.2, 0.2, robot.nv))
    return rbd.State(robot, q, rng.normal(size=robot.nv)), tau, [push]


def contacts_of(robot: rbd.Robot, kind: str) -> list[rbd.Contact]:
    """Feet that hold, points with a tilted normal or without friction among them; or feet with friction."""
    if kind == "sticks":
        return list(robot.feet(friction=0.8, on=None))
    feet = list(robot.feet(friction=None, on=None))
    if kind == "mixed":
        first = feet[0]
        frame = first.frame
        tilted = rbd.Ground(normal=(0.0, 0.6, 0.8))
        feet[0] = rbd.PointContact(first.name, frame, offset=(0.03, 0.02, -0.01), on=tilted)
    return feet


@pytest.mark.parametrize("kind", ["holds", "mixed", "sticks"])
@pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
def test_analytical_derivatives_are_those_by_differences(name: str, kind: str) -> None:
    """Soles and points, moving or at rest, under a push: every array, to 1e-8 of its largest entry."""
    robot = rbd.load_robot(name)
    state, tau, push = draw(robot, 2, moving=kind != "sticks")
    contacts = contacts_of(robot, kind)
    solver = None if kind == "sticks" else rbd.KKT()
    found = rbd.solve(state, tau, contacts, external=push, solver=solver)
    opaque = rbd.solve(state, tau, [Opaque(c) for c in contacts], external=push, solver=solver)
    assert isinstance(HeldRows.of(found, found.problem), HeldRows)
    word = "sticks" if kind == "sticks" else "holds"
    assert {w for words in found.derivatives().active.values() for w in words} == {word}
    compare(found.derivatives(), opaque.derivatives(), 1e-8)


def test_a_frame_that_no_joint_moves_has_derivatives_of_zero() -> None:
    """A contact and a push at the fixed base of an arm that moves: its force is not unique, the rest as by differences."""
    robot = rbd.load_robot("panda", root="fixed")
    state = rbd.State(robot, robot.neutral(), np.ones(robot.nv))
    pushes = [rbd.ExternalForce(link, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)) for link in ("panda_link0", "panda_hand")]
    contacts = [rbd.PointContact("base", "panda_link0", offset=(0.1, 0.0, 0.0)), rbd.PointContact("tip", "panda_hand")]
    found, opaque = (
        rbd.solve(state, np.zeros(robot.nu), given, external=pushes, solver=rbd.KKT()).derivatives()
        for given in (contacts, [Opaque(c) for c in contacts])
    )
    assert found.not_unique == ("base",)
    compare(found, opaque, 1e-8)


def test_rows_on_joints_are_constant(talos: rbd.Robot) -> None:
    """A brake, a gear, a stop and dry friction beside soles: their terms are those by differences of their rows."""
    state, tau, push = draw(talos, 6, moving=False)
    joints = talos.actuated_names
    knee, hip = (float(state.q[talos.joints[joints[i]].q][0]) for i in (3, 2))
    constraints = [
        *talos.soles(None, on=None),
        rbd.JointLock("brake", joints[20]),
        rbd.JointCoupling("gear", joints[21], joints[22], ratio=0.5),
        rbd.JointLimit("stop", joints[3], lower=knee - 1.0, upper=knee),
        rbd.JointLimit("far", joints[2], upper=hip + 1e-3),
        rbd.JointFriction("rub", joints[25], 1e3),
    ]
    solver = rbd.ConeSolver()
    found = rbd.solve(state, tau, constraints, external=push, solver=solver).derivatives()
    opaque = rbd.solve(state, tau, [Opaque(c) for c in constraints], external=push, solver=solver).derivatives()
    assert found.active["brake"] == found.active["gear"] == found.active["rub"] == ("holds",) and found.active["far"] == ()
    compare(found, opaque, 1e-8)


@pytest.mark.parametrize("law", ["coulomb", "convex"])
@pytest.mark.parametrize("name", ["talos", "solo12"])
def test_slipping_contacts_use_the_analytical_terms_too(name: str, law: str) -> None:
    """Torques off balance until something slips; two corners a sole, where Coulomb's law has one motion."""
    robot = rbd.load_robot(name)
    state, rng = robot.standing(), np.random.default_rng(3)
    tau = rbd.hold(state, robot.feet()).tau
    contacts = [
        rbd.PointContact(f"{foot.name} {i}", foot.frame, offset=foot.placement.act(corner), friction=0.3)
        for foot in robot.feet()
        for i, corner in enumerate(foot.corners[:1])
    ]
    push = rbd.ExternalForce(robot.links()[0], 0.45 * robot.mass * 9.81 * np.array([1.0, 0.3, 0.0]))
    tau = tau + 0.1 * rng.normal(size=robot.nu)
    found = rbd.solve(state, tau, contacts, external=push, law=law)
    assert HeldRows.of(found, found.problem) is None
    assert "slips" in {w for words in found.derivatives().active.values() for w in words}
    opaque = rbd.solve(state, tau, [Opaque(c) for c in contacts], external=push, law=law)
    compare(found.derivatives(), opaque.derivatives(), 1e-7)


@pytest.mark.parametrize("name", ["talos", "g1"])
@pytest.mark.parametrize("friction", [None, 0.8])
def test_both_ways_to_solve_for_the_derivatives_agree(name: str, friction: float | None, monkeypatch) -> None:
    """The rows as equations, and the general set of active columns: the same arrays and words to rounding."""
    robot = rbd.load_robot(name)
    state, tau, push = draw(robot, 5, moving=False)
    solution = rbd.solve(state, tau, robot.feet(friction=friction), external=push)
    found = solution.derivatives()
    monkeypatch.setattr(HeldRows, "of", lambda *_: None)
    general = solution.derivatives()
    compare(found, general, 1e-9)


def test_pinocchio_has_the_same_derivatives_of_soles_at_rest(talos: rbd.Robot) -> None:
    """`computeConstraintDynamicsDerivatives` on two soles, in their own axes, where spatial and classical are one."""
    state, soles, model = talos.standing(), talos.soles(None), talos.model
    tau = 0.95 * rbd.hold(state, talos.soles()).tau
    found = rbd.solve(state, tau, soles).derivatives()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for sole in soles:
        joint, X_JF = talos.site(sole.frame)
        models.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, joint, X_JF * sole.placement, pin.LOCAL))
        datas.append(models[-1].createData())
    data, settings = model.createData(), pin.ProximalSettings(1e-12, 1e-12, 0.0, 1)
    pin.initConstraintDynamics(model, data, models, datas)
    pin.constraintDynamics(model, data, state.q, state.v, talos.actuation.T @ tau, models, datas, settings)
    pin.computeConstraintDynamicsDerivatives(model, data, models, datas, settings)
    torque = talos.actuation.T
    pairs = [
        (found.da_dq, data.ddq_dq),
        (found.da_dv, data.ddq_dv),
        (found.da_dtau, data.ddq_dtau @ torque),
        (found.df_dq, data.dlambda_dq),
        (found.df_dv, data.dlambda_dv),
        (found.df_dtau, data.dlambda_dtau @ torque),
    ]
    for one, other in pairs:
        assert np.abs(one - other).max() < 1e-9 * max(1.0, np.abs(other).max())


def pressed(push: Sequence[float], **options: Any) -> rbd.Solution:
    """A box of 10 kg on four corners with mu = 0.6, pushed at its centre of mass."""
    robot = rbd.testing.box(10.0)
    under = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    patch = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=under, friction=0.6, **options)
    state = rbd.State(robot, pin.neutral(robot.model))
    return rbd.solve(state, np.zeros(0), [patch], external=rbd.ExternalForce("box", push, offset=(0.0, 0.0, -0.1)))


def test_near_the_edge_of_a_mode_the_general_way_decides() -> None:
    """Pushed along the floor with all but a ten-thousandth of what friction holds: the general way, and it sticks."""
    most = 0.6 * 10.0 * 9.81
    far = pressed((0.9 * most, 0.0, 0.0))
    assert isinstance(HeldRows.of(far, far.problem), HeldRows)
    near = pressed(((1.0 - 1e-4) * most, 0.0, 0.0))
    assert HeldRows.of(near, near.problem) is None and near.derivatives().active == {"floor": ("sticks",) * 4}
    assert isinstance(ActiveSet(near), ActiveSet)


def test_repeated_rows_go_the_general_way(talos: rbd.Robot) -> None:
    """Two names for one sole: 18 rows of rank 12 have no equations for each force."""
    soles = talos.soles(None)
    twice = [*soles, rbd.SurfaceContact("again", soles[0].frame, corners=soles[0].corners, placement=soles[0].placement)]
    state = talos.standing()
    found = rbd.solve(state, np.zeros(talos.nu), twice, solver=rbd.KKT())
    assert HeldRows.of(found, found.problem) is None
    d = found.derivatives()
    once = rbd.solve(state, np.zeros(talos.nu), soles, solver=rbd.KKT()).derivatives()
    assert d.not_unique == (soles[0].name, "again") and d.df_dq is None
    for kind in MOTION:
        assert np.abs(getattr(d, kind) - getattr(once, kind)).max() < 1e-9 * max(1.0, np.abs(getattr(once, kind)).max())


def test_only_what_is_fixed_to_a_body_over_ground_at_rest_has_fixed_rows(talos: rbd.Robot) -> None:
    """Edges, moving ground, bodies, feedback and rows of one's own do not."""
    frame = talos.soles()[0].frame
    point = rbd.PointContact("toe", frame, friction=0.5)
    slope = fixed_rows_of(rbd.PointContact("toe", frame, friction=0.0, on=rbd.Ground(normal=(0.0, 0.6, 0.8))))
    assert slope is not None and slope.rows == slice(2, 3) and np.allclose(slope.pose.axes[:, 2], (0.0, 0.6, 0.8), atol=1e-15)
    assert fixed_rows_of(point) is not None and fixed_rows_of(talos.soles()[0]).pose.axes is None
    assert fixed_rows_of(rbd.PointContact("toe", frame, anchor=(0.0, 0.0, 0.0))) is not None
    for other in (
        rbd.LineContact("edge", frame, half_length=0.1),
        rbd.PointContact("toe", frame, on=rbd.Ground(velocity=(0.1, 0, 0, 0, 0, 0))),
        rbd.PointContact("toe", frame, on=rbd.Body(talos.soles()[1].frame)),
        rbd.constraints.Baumgarte(10.0).of(point),
        Tilting("toe", frame),
        Opaque(point),
    ):
        assert fixed_rows_of(other) is None


def test_a_lock_of_a_base_is_not_constant(talos: rbd.Robot) -> None:
    """Its rows turn with the base; those of a hinge do not, and with feedback they have more terms."""
    state = talos.standing()
    base, hinge = (rbd.JointLock("lock", name) for name in (talos.model.names[1], talos.actuated_names[0]))
    assert not are_constant(base, base.rows(state)) and are_constant(hinge, hinge.rows(state))
    pulled = rbd.constraints.Baumgarte(5.0).of(hinge)
    assert not are_constant(pulled, pulled.rows(state))


def test_derivatives_through_many_loops_are_those_one_by_one() -> None:
    """Four four-bars that swing: the rows of all loops together, and each loop's own."""
    robot = rbd.mechanism.n_four_bar(4)
    upright = robot.at("assembled")
    state = upright.with_velocity(rbd.mechanism.velocity_partition(upright, robot.loops(), {"crank_0_joint": -1.0}).v)
    found, opaque = (
        rbd.solve(state, [0.1], loops, solver=rbd.KKT(), loops=False).derivatives()
        for loops in (robot.loops(), [Opaque(loop) for loop in robot.loops()])
    )
    compare(found, opaque, 1e-9)


def test_a_contact_with_rows_of_its_own_is_differentiated_by_them(talos: rbd.Robot) -> None:
    """Rows twice as large have half the row forces; the motion is that of the plain point."""
    state, tau, _ = draw(talos, 4, moving=True)
    plain, own = (kind("toe", talos.soles()[0].frame, offset=(0.1, 0.0, 0.0)) for kind in (rbd.PointContact, Tilting))
    expected, found = (rbd.solve(state, tau, [c], solver=rbd.KKT()).derivatives() for c in (plain, own))
    for kind in MOTION:
        assert np.abs(getattr(found, kind) - getattr(expected, kind)).max() < 1e-8 * np.abs(getattr(expected, kind)).max()
    for kind in ROWS:
        assert np.abs(2.0 * getattr(found, kind) - getattr(expected, kind)).max() < 1e-8 * np.abs(getattr(expected, kind)).max()


@pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
@pytest.mark.parametrize("friction", [None, 0.8])
def test_a_prepared_answer_has_the_derivatives_of_its_problem_in_arrays(name: str, friction: float | None) -> None:
    """M and J of Pinocchio's derivatives in place of assembled ones, some feet with a push: the same derivatives."""
    robot, rng, seen = rbd.load_robot(name), np.random.default_rng(4), 0
    feet = robot.feet(friction, on=None)
    hold = rbd.hold(robot.standing(), robot.feet(0.8)).tau
    for i in range(12):
        q = pin.integrate(robot.model, robot.standing().q, 0.02 * rng.normal(size=robot.nv))
        J = np.concatenate([foot.rows(rbd.State(robot, q)).J for foot in feet])
        v = 0.1 * rng.normal(size=robot.nv)
        for _ in range(2):
            v -= np.linalg.lstsq(J, J @ v, rcond=None)[0]
        push = [rbd.ExternalForce(feet[0].frame, (3.0, -2.0, 1.0), (0.1, 0.2, 0.3), offset=(0.1, 0.0, 0.3))] * (i % 2)
        given = rbd.State(robot, q, v), hold, feet
        found = rbd.solve(*given, external=push or None)
        if found.solver != "ContactDynamics" or found.method != "closed form":
            continue
        seen += 1
        expected = rbd.solve_problem(rbd.gauss_problem(*given, external=push or None)).derivatives()
        got = found.derivatives()
        assert "problem" not in found.__dict__
        compare(got, expected, 1e-9)
    assert seen > 3
