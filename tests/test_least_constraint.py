"""The one door: what goes in is checked, what comes out is proved, what cannot be is said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.errors import (
    ContactMoves,
    DuplicateName,
    EffortLimitWarning,
    FrameNotFound,
    InaccurateWarning,
    InputError,
    NoSolution,
    Unsupported,
)

G = 9.81


def drawn(robot: rbd.Robot, seed: int) -> rbd.State:
    """Moving, anywhere near the posture."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.standing().q, rng.uniform(-0.3, 0.3, robot.nv))
    return rbd.State(robot, q, rng.normal(size=robot.nv))


def held(robot: rbd.Robot) -> list[rbd.SurfaceContact]:
    return robot.soles(friction=None, on=None)  # in poses that are drawn, the feet are anywhere


def test_without_constraints_gauss_lets_a_robot_be(talos: rbd.Robot) -> None:
    """Least constraint: none. a = a_free, and Gauss's function is zero."""
    state, tau = drawn(talos, 0), np.full(talos.nu, 0.5)
    solution = rbd.solve(state, tau)
    assert np.abs(solution.a - rbd.dynamics.free_acceleration(state, tau)).max() < 1e-12 * np.abs(solution.a).max()
    assert solution.gauss == 0.0 and solution.forces == {} and solution.rank == 0
    assert solution.status is rbd.problem.Status.SOLVED and solution.law.kind == "bilateral"


@pytest.mark.parametrize("name", ["talos", "g1"])
@pytest.mark.parametrize("friction", [None, 0.7])
def test_a_robot_under_its_holding_torques_presses_with_its_weight(name: str, friction: float | None) -> None:
    """Forces sum to m g upwards, to 1e-9 N for held soles, whose forces are unique; rubbing ones to what is solved."""
    robot = rbd.load_robot(name)
    state, soles = robot.standing(), robot.soles(friction)
    solution = rbd.solve(state, rbd.hold(state, soles).tau, soles)
    total = sum(force[:3] for force in solution.forces.values())
    assert np.abs(total - [0.0, 0.0, robot.mass * G]).max() < (1e-9 if friction is None else 1e-6)


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.KKT()])
@pytest.mark.parametrize("name", ["talos", "g1"])
@pytest.mark.parametrize("seed", range(3))
def test_held_soles_agree_with_constraint_dynamics(name: str, seed: int, solver: rbd.ProxQP | rbd.KKT) -> None:
    """Pinocchio's constraintDynamics where it is right: feet at rest, independent rows, mu = 0. To 1e-9 of the largest."""
    robot = rbd.load_robot(name)
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.standing().q, np.r_[np.zeros(6), rng.uniform(-0.2, 0.2, robot.nv - 6)])
    J = np.vstack([sole.rows(rbd.State(robot, q)).J for sole in held(robot)])
    v = rng.normal(size=robot.nv)
    state = rbd.State(robot, q, v - np.linalg.pinv(J) @ (J @ v))
    tau = rng.uniform(-1.0, 1.0, robot.nu)
    model = robot.model
    contacts = pin.StdVec_RigidConstraintModel()
    for sole in held(robot):
        f = robot.frame(sole.frame)
        at = f.placement * sole.placement
        contacts.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, model, f.parentJoint, at, pin.LOCAL))
    data, datas = model.createData(), pin.StdVec_RigidConstraintData()
    for contact in contacts:
        datas.append(contact.createData())
    pin.initConstraintDynamics(model, data, contacts, datas)
    settings = pin.ProximalSettings(1e-14, 1e-14, 0.0, 10)
    expected = pin.constraintDynamics(model, data, state.q, state.v, robot.actuation.T @ tau, contacts, datas, settings)
    solution = rbd.solve(state, tau, held(robot), solver=solver)
    assert np.abs(solution.a - expected).max() < 1e-9 * np.abs(expected).max()


def test_both_solvers_agree_on_redundant_corners(talos: rbd.Robot) -> None:
    """Two feet held at four corner points each: 24 rows of rank 12; a and J^T f agree to 1e-9, and the rank is stated."""
    state = talos.standing()
    tau = rbd.hold(state, talos.soles()).tau * 0.9
    corners = [
        rbd.PointContact(f"{sole.name} {i}", sole.frame, offset=sole.placement.act(corner))
        for sole in talos.soles()
        for i, corner in enumerate(sole.corners)
    ]
    by_qp, by_kkt = (rbd.solve(state, tau, corners, solver=solver) for solver in (rbd.ProxQP(), rbd.KKT()))
    assert (by_qp.problem.m, by_qp.rank, by_kkt.rank) == (24, 12, 12)
    J = by_qp.problem.J
    assert np.abs(by_qp.a - by_kkt.a).max() < 1e-9
    assert np.abs(J.T @ (by_qp.multipliers - by_kkt.multipliers)).max() < 1e-9 * talos.mass * G


@pytest.mark.parametrize("name", ["talos", "talos_full", "g1", "g1_hands"])
def test_pushed_states_are_solved(name: str) -> None:
    """Forty draws: torque noise of 2 to 60 N m, pushes to 100 N, friction 0.05 to 1: every answer within 1e-9, scaled."""
    robot, rng = rbd.load_robot(name), np.random.default_rng(7)
    state = robot.standing()
    tau = rbd.hold(state, robot.soles()).tau
    for _ in range(40):
        noise = rng.normal(size=robot.nu) * rng.uniform(2.0, 60.0)
        push = [rbd.ExternalForce(robot.soles()[0].frame, rng.normal(size=3) * 50.0)]
        soles = robot.soles(float(rng.uniform(0.05, 1.0)))
        torque = np.clip(tau + noise, -robot.effort_limit, robot.effort_limit)
        solution = rbd.solve(state, torque, soles, external=push)
        assert solution.status is rbd.problem.Status.SOLVED and solution.residuals.worst <= 1e-9


def test_forces_stand_under_their_contacts_names(talos: rbd.Robot) -> None:
    """Whatever the order of the list, a name's force, acceleration and share are the same contact's."""
    state, soles = talos.standing(), held(talos)
    one, other = rbd.solve(state, np.zeros(talos.nu), soles), rbd.solve(state, np.zeros(talos.nu), soles[::-1])
    assert list(one.forces) == ["left_sole", "right_sole"] and list(other.forces) == ["right_sole", "left_sole"]
    for name in one.forces:
        assert np.abs(one.forces[name] - other.forces[name]).max() < 1e-7
        assert np.abs(one.accelerations[name]).max() < 1e-9
        assert abs(one.gauss.shares[name] - other.gauss.shares[name]) < 1e-6


def test_held_contacts_take_any_velocity(talos: rbd.Robot) -> None:
    """A contact that holds, while its point moves: c = J a + J_dot v = 0 all the same."""
    state = drawn(talos, 1)
    solution = rbd.solve(state, np.zeros(talos.nu), held(talos))
    assert max(rows.speed for rows in solution.problem.rows) > 0.1
    for acceleration in solution.accelerations.values():
        assert np.abs(acceleration).max() < 1e-8


@pytest.mark.parametrize("friction", [0.0, 0.7])
def test_a_rubbing_contact_that_moves_is_refused_by_name(talos: rbd.Robot, friction: float) -> None:
    """Above 1e-6 m/s, in any of its rows: the contact, its speed and the ways out are said; below, it rests."""
    q, v = talos.standing().q, np.zeros(talos.nv)
    v[talos.model.joints[talos.joint_id("leg_right_1_joint")].idx_v] = 0.3  # the hip turns the foot on the ground
    state, tau = rbd.State(talos, q, v), rbd.hold(talos.standing(), talos.soles()).tau
    if friction:
        with pytest.raises(ContactMoves, match=r"'right_sole' moves at .* m/s.*friction=None"):
            rbd.solve(state, tau, talos.soles(friction, on=None), law="convex")
    else:
        assert (
            rbd.solve(state, tau, talos.soles(friction, on=None)).status is rbd.problem.Status.SOLVED
        )  # smooth ground lets it turn
    for speed, refused in ((2e-6, True), (0.9e-6, False)):
        point = rbd.PointContact("toe", "right_sole_link", friction=friction)
        sinking = np.zeros(talos.nv)
        sinking[2] = -speed
        if refused:
            with pytest.raises(ContactMoves, match="'toe'"):
                rbd.solve(rbd.State(talos, q, sinking), tau, [point])
        else:
            rbd.solve(rbd.State(talos, q, sinking), tau, [point])


def test_a_torque_beyond_its_motor_is_said_and_used(talos: rbd.Robot) -> None:
    """Twice the limit: a warning that names the worst motor; the answer is for the torques given."""
    state, tau = talos.standing(), np.zeros(talos.nu)
    tau[3], tau[5] = 2.0 * talos.effort_limit[3], -1.5 * talos.effort_limit[5]
    name = talos.actuated_names[3]
    with pytest.warns(EffortLimitWarning, match=rf"tau of {name} is .* beyond its effort limit .*; 2 of 32"):
        solution = rbd.solve(state, tau)
    assert np.abs(solution.a - rbd.dynamics.free_acceleration(state, tau)).max() < 1e-12 * np.abs(solution.a).max()
    with pytest.warns(EffortLimitWarning):
        rbd.gauss_problem(state, tau)
    tau[3], tau[5] = talos.effort_limit[3], -talos.effort_limit[5]
    rbd.solve(state, tau)  # at the limit: no warning


def test_a_warning_points_at_the_users_line(talos: rbd.Robot) -> None:
    """The file that is blamed for a warning is the caller's, not one of ours."""
    tau = np.zeros(talos.nu)
    tau[0] = 2.0 * talos.effort_limit[0]
    for ask in (rbd.solve, rbd.gauss_problem):
        with pytest.warns(EffortLimitWarning) as caught:
            ask(talos.standing(), tau)
        assert caught[0].filename == __file__


def contradiction(talos: rbd.Robot) -> tuple[rbd.State, list[rbd.PointContact]]:
    """A turning foot held at its four corners: their centripetal accelerations contradict each other."""
    sole = talos.soles()[0]
    corners = [
        rbd.PointContact(f"corner {i}", sole.frame, offset=sole.placement.act(corner)) for i, corner in enumerate(sole.corners)
    ]
    v = np.zeros(talos.nv)
    v[3:6] = [1.0, 2.0, 3.0]
    return rbd.State(talos, talos.standing().q, v), corners


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.KKT()])
def test_contradicting_constraints_have_no_solution(talos: rbd.Robot, solver: rbd.ProxQP | rbd.KKT) -> None:
    """The error names the worst row and says what to do; it carries the problem and the best that was found."""
    state, corners = contradiction(talos)
    said = r"corner \d cannot hold: residual .* m/s2: no acceleration satisfies.*SurfaceContact"
    with pytest.raises(NoSolution, match=said) as e:
        rbd.solve(state, np.zeros(talos.nu), corners, solver=solver)
    assert isinstance(e.value.problem, rbd.GaussProblem) and e.value.problem.m == 12
    assert isinstance(e.value.result, rbd.Solution) and e.value.result.status is rbd.problem.Status.INFEASIBLE
    best = rbd.solve(state, np.zeros(talos.nu), corners, solver=solver, check=False)
    assert best.status is rbd.problem.Status.INFEASIBLE and best.residuals.worst > 1e-7


@dataclass(frozen=True)
class Off:
    """A solver that is off by a share of the answer."""

    share: float
    law: str = "bilateral"

    def reason_unsupported(self, problem: rbd.GaussProblem) -> str | None:
        """It takes anything."""
        return None

    def solve(self, problem: rbd.GaussProblem) -> rbd.problem.Answer:
        """The right answer, less so."""
        right = rbd.KKT().solve(problem)
        wrong = right.a + self.share * np.linalg.norm(right.a)
        return rbd.problem.Answer(problem, wrong, right.multipliers, None, "bilateral", "Off", 1, 0.0)


def test_an_answer_is_judged_by_its_residuals_not_by_its_solver(talos: rbd.Robot) -> None:
    """Off by 1e-11: inaccurate, said aloud; by 1e-3: no solution, though the solver says nothing; check=False gives it.

    1e-11 of |a| in each entry of a is a few 1e-8 of the smallest terms of a row.
    """
    state, tau = talos.standing(), np.zeros(talos.nu)
    with pytest.warns(InaccurateWarning, match="Off is inaccurate on talos: scaled residuals .*solved is 1e-9"):
        solution = rbd.solve(state, tau, held(talos), solver=Off(1e-11))
    assert solution.status is rbd.problem.Status.INACCURATE
    with pytest.raises(NoSolution, match="no answer within tolerance .Off, law bilateral"):
        rbd.solve(state, tau, held(talos), solver=Off(1e-3))
    assert rbd.solve(state, tau, held(talos), solver=Off(1e-3), check=False).status is rbd.problem.Status.FAILED


def test_kkt_refuses_what_can_slip_before_it_starts(talos: rbd.Robot) -> None:
    """By name, in words, with the way out."""
    with pytest.raises(Unsupported, match="KKT takes bilateral constraints, and 'left_sole' has forces in a WrenchCone"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(), solver=rbd.KKT())


class Locked:
    """A user's own constraint: one joint's acceleration is zero."""

    name = "locked"

    def __init__(self, index: int) -> None:
        self.index = index

    def rows(self, state: rbd.State) -> rbd.Rows:
        """One row."""
        return rbd.Rows(name=self.name, J=np.eye(state.robot.nv)[[self.index]], bias=np.zeros(1), cone=rbd.problem.Free(1))


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.KKT()])
def test_anything_with_rows_is_a_constraint(talos: rbd.Robot, solver: rbd.ProxQP | rbd.KKT) -> None:
    """A class of the user's own beside soles: its row is kept, its force is its row's torque, the certificate stays whole."""
    state = drawn(talos, 2)
    solution = rbd.solve(state, np.zeros(talos.nu), [*held(talos), Locked(20)], solver=solver)
    assert abs(solution.a[20]) < 1e-9 and solution.forces["locked"].shape == (1,)
    assert solution.residuals.centroidal is not None and solution.residuals.centroidal.scaled < 1e-9
    assert solution.status is rbd.problem.Status.SOLVED


def test_a_fixed_base_has_no_centroidal_residual() -> None:
    """The base's reaction is unknown there: the certificate leaves that equation out, and says so with None."""
    panda = rbd.load_robot("panda", root="fixed")
    solution = rbd.solve(panda.standing(), np.zeros(panda.nu), [rbd.PointContact("tip", "panda_hand")])
    assert solution.residuals.centroidal is None and "centroidal" not in solution.residuals.scaled
    assert np.abs(solution.accelerations["tip"]).max() < 1e-9


def test_an_answer_does_not_change_afterwards(talos: rbd.Robot) -> None:
    """States, torques and other solves come and go: an old solution says what it said."""
    state, tau = drawn(talos, 3), np.full(talos.nu, 0.5)
    solution = rbd.solve(state, tau, held(talos))
    P = solution.problem
    kept = [np.copy(x) for x in (solution.a, solution.multipliers, P.M, P.rhs, P.J)]
    tau[:] = 0.0
    for seed in range(10, 18):
        rbd.solve(drawn(talos, seed), tau, held(talos))
    for one, other in zip(kept, (solution.a, solution.multipliers, P.M, P.rhs, P.J), strict=True):
        assert np.array_equal(one, other)
    assert solution.residuals.worst < 1e-9


# ---------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    "constraints", [None, 5, "left_sole", ["left_sole"], [None], [[]], object(), rbd.SurfaceContact, [rbd.KKT()]]
)
def test_constraints_that_are_none_are_refused(talos: rbd.Robot, constraints: object) -> None:
    """Not a list, or a list of something else."""
    with pytest.raises(InputError, match="constraint"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), constraints)  # type: ignore[arg-type]


def test_a_lone_contact_is_told_to_come_in_a_list(talos: rbd.Robot) -> None:
    """The likeliest slip has its own words."""
    with pytest.raises(InputError, match=r"a single constraint; give a list, \[constraint\]"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles()[0])  # type: ignore[arg-type]


def test_two_constraints_of_one_name_are_refused(talos: rbd.Robot) -> None:
    """Their forces could not be told apart."""
    toes: Sequence[rbd.PointContact] = [rbd.PointContact("toe", "left_sole_link"), rbd.PointContact("toe", "right_sole_link")]
    with pytest.raises(DuplicateName, match="two constraints are named 'toe'"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), toes)


def test_a_contact_at_no_frame_is_refused(talos: rbd.Robot) -> None:
    """When it meets the robot, with the nearest names."""
    with pytest.raises(FrameNotFound, match="no frame 'left_sole' in talos; nearest: .*'left_sole_link'"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), [rbd.PointContact("toe", "left_sole")])


@pytest.mark.parametrize("solver", ["", "ProxQP", rbd.ProxQP, 3])
def test_a_solver_that_is_none_is_refused(talos: rbd.Robot, solver: object) -> None:
    """The class in place of an instance too."""
    with pytest.raises(InputError, match=r"expected a solver, e\.g\. rbd\.ProxQP\(\)"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), solver=solver)  # type: ignore[arg-type]


@pytest.mark.parametrize("tau", [0.0, "0", np.zeros(38), np.zeros(31), np.zeros((32, 1)), [np.nan] * 32, [1j] * 32])
def test_torques_that_are_none_are_refused(talos: rbd.Robot, tau: Array) -> None:
    """Wrong sizes, NaN, complex numbers."""
    for ask in (rbd.solve, rbd.gauss_problem, rbd.dynamics.free_acceleration):
        with pytest.raises(InputError, match="tau of talos"):
            ask(talos.standing(), tau)


class Broken:
    """A user's constraint whose rows are wrong in one way."""

    name = "broken"

    def __init__(self, **wrong: object) -> None:
        self.wrong = wrong

    def rows(self, state: rbd.State) -> rbd.Rows:
        """Good rows but for what is wrong."""
        good = {"name": "broken", "J": np.eye(state.robot.nv)[[0]], "bias": np.zeros(1), "cone": rbd.problem.Free(1)}
        return rbd.Rows(**{**good, **self.wrong})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "wrong",
    [
        {"J": np.full((1, 38), np.nan)},
        {"J": np.ones((1, 37))},
        {"J": np.ones(38)},
        {"J": None},
        {"J": "J"},
        {"bias": np.array([np.inf])},
        {"bias": np.zeros(2)},
        {"bias": None},
        {"cone": rbd.problem.Free(2)},
        {"velocity": np.zeros(3)},
        {"feedback": np.array([np.nan])},
    ],
)
def test_rows_that_are_wrong_are_refused(talos: rbd.Robot, wrong: dict[str, object]) -> None:
    """A user's constraint with NaN, or with sizes that do not fit: an InputError, not an answer."""
    with pytest.raises(InputError):
        rbd.solve(talos.standing(), np.zeros(talos.nu), [Broken(**wrong)])


def test_what_is_no_rows_is_refused(talos: rbd.Robot) -> None:
    """A `rows` method that returns something else, None above all."""

    class Nothing:
        name = "nothing"

        def rows(self, state: rbd.State) -> None:
            return None

    with pytest.raises(InputError, match="constraint 'nothing' gave a NoneType in place of rbd.Rows"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), [Nothing()])  # type: ignore[list-item]


def test_rows_have_the_name_of_their_constraint():
    """A constraint without a name, and one whose rows have another: both are refused, as in a simulation."""
    state = rbd.load_robot("bolt").standing()

    class Nameless:
        def rows(self, state: rbd.State) -> rbd.Rows:
            return rbd.Rows("somebody", np.zeros((1, state.robot.nv)), np.zeros(1), rbd.problem.Free(1))

    class Other(Nameless):
        name = "nobody"

    for constraint, told in (
        (Nameless(), "it wants a name and rows"),
        (Other(), "the rows of constraint 'nobody' are named 'somebody'; expected the constraint's name"),
    ):
        with pytest.raises(rbd.InputError, match=told):
            rbd.solve(state, np.zeros(state.robot.nu), [constraint])


def test_check_is_true_or_false():
    """A word is no answer to it."""
    state = rbd.load_robot("bolt").standing()
    with pytest.raises(rbd.InputError, match="check is 'x'; expected True or False"):
        rbd.solve(state, np.zeros(state.robot.nu), state.robot.feet(), check="x")
