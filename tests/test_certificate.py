"""The second certificate: zero on closed forms, and not fooled by an answer that is wrong by one part in a million."""

from __future__ import annotations

from dataclasses import replace

import certificate as C
import numpy as np
import pinocchio as pin
import pytest
import random_problems as R

import rbd
from rbd.testing import reference_problems

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
LIMIT = 1e-7
WRONG = 1e-6
FAMILIES = ("one point", "opposed", "soles", "mixed", "a hundred")


def _corners(s: rbd.Solution) -> dict:
    patches = {r.name: r.patch for r in s.problem.rows}
    return {
        name: corners if patches[name] is None else corners @ patches[name].axes for name, corners in s.corner_forces.items()
    }


def _of(s: rbd.Solution, a: np.ndarray | None = None) -> C.Certificate:
    a = s.a if a is None else a
    return C.of_arrays(s.problem.M, s.problem.rhs, s.problem.rows, a, s.multipliers, _corners(s), str(s.law))


@pytest.mark.parametrize("solver", [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver(), rbd.ConeSolver(law="convex")], ids=repr)
def test_known_answers_have_a_clean_certificate(solver) -> None:
    """Boxes at rest, slipping, lifting; stops, linkages, made-up sets: every solver's answers meet every equation."""
    taken = 0
    for reference in reference_problems():
        if solver.reason_unsupported(reference.problem):
            continue
        s = rbd.Solution.of(solver.solve(reference.problem))
        if s.status == "solved":
            taken += 1
            assert _of(s).worst <= LIMIT, f"{reference.name}: {_of(s)}"
    assert taken >= 10


def _slider(p: tuple[float, float, float], c: tuple[float, float, float], u: tuple[float, float, float], law: str) -> float:
    return C.point_miss(law, 0.5, 4, np.array(p), np.array(c), np.array(u), 10.0, 10.0)


@pytest.mark.parametrize(
    ("p", "c", "u", "law"),
    [
        ((1.0, 2.0, 10.0), (0, 0, 0), (0, 0, 0), "coulomb"),  # sticks
        ((-5.0, 0, 10.0), (3.0, 0, 0), (0, 0, 0), "coulomb"),  # slips: friction against the motion, no lift
        ((0, 0, 0), (1.0, 5.0, 2.0), (0, 0, 0), "coulomb"),  # opens
        ((0, -5.0, 10.0), (3.0, 1.0, 0), (0, 0.2, 0), "coulomb"),  # slides: friction against the velocity
        ((0, 0, 0), (0, 0, -9.0), (0, 0, 0.2), "coulomb"),  # leaves already
        ((-5.0, 0, 10.0), (4.0, 0, 2.0), (0, 0, 0), "convex"),  # the cone's edge, and its normal there
        ((-5.0, 3.0, 10.0), (4.0, 0, 2.0), (0, 0, 0), "convex, 4 facets"),  # anywhere on the pyramid's facet
    ],
)
def test_points_that_obey_their_law_are_clean_and_others_are_not(p, c, u, law: str) -> None:
    """Each mode of a point in closed form; spoilt by a part in a million in force or acceleration it is seen."""
    assert _slider(p, c, u, law) < 1e-15
    seen = [_slider(tuple(np.add(p, d)), c, u, law) for d in (*(1e-5 * np.eye(3)), *(-1e-5 * np.eye(3)))]
    seen += [_slider(p, tuple(np.add(c, d)), u, law) for d in (*(1e-5 * np.eye(3)), *(-1e-5 * np.eye(3)))]
    assert max(seen) >= 0.5e-6


@pytest.mark.parametrize("cone", [rbd.problem.Free(1), rbd.problem.Bounds([-1.0], [1.0])], ids=["locked", "rubs"])
@pytest.mark.parametrize(("turns", "clean"), [(0.0, True), (2e-14, True), (2e-12, False), (1e-6, False)])
def test_the_last_digits_of_a_fall_are_no_turn_of_a_joint(cone, turns: float, clean: bool) -> None:
    """100 g at an arm of 0.1 m on a kilogram that falls: its joint keeps still, to the rounding of 9.81 m/s2 over the arm."""
    M = np.array([[1.0, 0.01], [0.01, 0.001]])
    row = rbd.Rows("joint", np.array([[0.0, 1.0]]), np.zeros(1), cone)
    found = C.of_arrays(M, M @ np.array([-9.81, 0.0]), [row], np.array([-9.81, turns]), np.zeros(1), {}, "convex")
    assert (found.found.get("holds", found.found.get("bound"))[0] <= LIMIT) == clean


def test_convex_answers_are_none_of_coulombs_and_the_other_way_round() -> None:
    """A contact that slips tells the laws apart."""
    assert _slider((-5.0, 0, 10.0), (4.0, 0, 2.0), (0, 0, 0), "coulomb") > 0.1
    assert _slider((-5.0, 0, 10.0), (3.0, 0, 0), (0, 0, 0), "convex") > 0.1
    assert _slider((-5.0, 3.0, 10.0), (4.0, 0, 2.0), (0, 0, 0), "convex") > 0.01


def _answers(seed: int, *, moving: bool) -> list[tuple[R.Tree, list[R.Given], rbd.State, np.ndarray, rbd.Solution]]:
    """Solved draws in which accelerations, forces, and of what moves J_dot v too, count in the equations that they are in."""
    out: list[tuple[R.Tree, list[R.Given], rbd.State, np.ndarray, rbd.Solution]] = []
    rng = np.random.default_rng(seed)
    while len(out) < 6:
        _, made = R.tree(rng, most=5, spread=R.pick(rng, (0.0, 2.0)), root="free_flyer")
        q = R.posture(rng, made.robot)
        if moving:  # points that hold take any velocity
            where = [(R.pick(rng, made.links), 0.1 * R.unit(rng), R.unit(rng)) for _ in range(2)]
            given = [R.point(f"c{k}", made.robot, *each, None) for k, each in enumerate(where)]
            v = rng.uniform(-1.0, 1.0, made.robot.nv)
        else:
            given = R.contacts(rng, made, q, unlimited=False)[1]
            v = np.zeros(made.robot.nv)
        state, tau = rbd.State(made.robot, q, v), R.torques(rng, made.robot)
        solver = rbd.KKT() if moving else rbd.ProxQP()
        s = rbd.solve(state, tau, [g.constraint for g in given], solver=solver, check=False)
        P, turning = s.problem, np.abs(s.problem.J) @ np.abs(s.a)
        terms = _terms(s)
        counts = [
            ((np.abs(P.M @ s.a) > 0.2 * terms) & (np.abs(s.a) > 1e-6 * np.abs(s.a).max())).any(),
            (np.abs(P.J.T @ s.multipliers) > 0.2 * terms).any(),
            not moving or (np.abs(P.bias) > 0.2 * (turning + np.abs(P.bias)) + 1e-3).any(),
        ]
        if s.residuals.within(1e-9) and all(counts):
            out.append((made, given, state, tau, s))
    return out


def _terms(s: rbd.Solution) -> np.ndarray:
    P = s.problem
    return np.abs(P.M) @ np.abs(s.a) + np.abs(P.rhs) + np.abs(P.J).T @ np.abs(s.multipliers)


def _of_robot(made, given, state, tau, s, **other) -> C.Certificate:
    force = np.zeros(made.robot.nv)
    force[made.robot.actuated] = tau
    forces = other.get("forces", s.forces)
    corners = other.get("corners", s.corner_forces)
    things = [g.thing(state, forces, corners) for g in other.get("placed", given)]
    q, v, a = (other.get(name, value) for name, value in (("q", state.q), ("v", state.v), ("a", s.a)))
    return C.of_robot(made.robot.model, q, v, a, force, things, str(s.law))


def test_an_answer_wrong_by_a_part_in_a_million_is_seen_on_the_robot() -> None:
    """Accelerations, forces, the configuration, the points' places: each spoilt alone."""
    rng = np.random.default_rng(1)
    for one in _answers(3, moving=False):
        made, given, state, _, s = one
        assert _of_robot(*one).worst <= LIMIT
        assert _of_robot(*one, a=(1.0 + WRONG) * s.a).worst > LIMIT
        forces = {name: (1.0 + WRONG) * f for name, f in s.forces.items()}
        corners = {name: (1.0 + WRONG) * f for name, f in s.corner_forces.items()}
        assert _of_robot(*one, forces=forces, corners=corners).worst > LIMIT
        q = pin.integrate(made.robot.model, state.q, np.r_[np.zeros(3), 10.0 * WRONG * rng.normal(size=made.robot.nv - 3)])
        assert _of_robot(*one, q=q).worst > LIMIT
        assert _of_robot(*one, placed=[_elsewhere(g, made) for g in given]).worst > LIMIT


def _elsewhere(g: R.Given, made: R.Tree) -> R.Given:
    """The same, its points moved by a few parts in a million of the robot's size."""
    off = 10.0 * WRONG * np.array([1.0, -1.0, 1.0]) * max(0.1, float(np.abs(made.robot.model.inertias[-1].lever).max()))

    def thing(state, forces, corners):
        x = g.thing(state, forces, corners)
        if isinstance(x, C.Held):
            return replace(x, placement=pin.SE3(x.placement.rotation, x.placement.translation + off))
        return replace(x, points=x.points + off)

    out = R.Given(g.constraint, thing, g.holds)
    return out


def test_a_wrong_bias_is_seen_on_the_robot() -> None:
    """A velocity that differs by a part in a million from the one that was solved."""
    for one in _answers(5, moving=True):
        assert _of_robot(*one).worst <= LIMIT
        assert _of_robot(*one, v=one[2].v * (1.0 + WRONG)).worst > LIMIT


@pytest.mark.parametrize("what", ["J", "bias"])
def test_rows_that_are_wrong_and_used_consistently_are_seen_on_the_robot(what: str) -> None:
    """The arrays agree with themselves; the forces on the bodies and the motion of the points do not."""
    for made, given, state, tau, s in _answers(7, moving=True):
        rows = [replace(r, **{what: getattr(r, what) * (1.0 + WRONG)}) for r in s.problem.rows]
        wrong = rbd.Solution.of(rbd.KKT().solve(rbd.GaussProblem(s.problem.M, s.problem.rhs, rows)))
        if wrong.residuals.within(1e-9):  # rows that repeat each other contradict each other then
            assert _of(wrong).worst <= LIMIT
            assert _of_robot(made, given, state, tau, wrong).worst > LIMIT


def test_a_spoilt_answer_in_arrays_is_seen_row_by_row() -> None:
    """Masses over nine decades: each acceleration and each force that counts in its own row, one at a time."""
    rng, tried = np.random.default_rng(11), 0
    for _ in range(40):
        _, P = R.arrays(rng)
        s = rbd.Solution.of(rbd.ConeSolver(law="convex").solve(P))
        if s.status != "solved" or P.m > 60 or _of(s).worst > LIMIT:
            continue
        terms = _terms(s)
        for i in range(P.nv):
            if P.M[i, i] * abs(s.a[i]) > 0.2 * terms[i]:
                a = s.a.copy()
                a[i] *= 1.0 + WRONG
                assert _of(s, a).worst > LIMIT
                tried += 1
        for r in range(P.m):
            if (np.abs(P.J[r] * s.multipliers[r]) > 0.2 * terms).any():
                f = s.multipliers.copy()
                f[r] *= 1.0 + WRONG
                found = C.of_arrays(P.M, P.rhs, P.rows, s.a, f, _corners(s), str(s.law))
                assert found.worst > LIMIT
                tried += 1
    assert tried > 100


def test_what_is_not_a_number_is_never_clean() -> None:
    """NaN and infinity in an answer."""
    s = rbd.solve_problem(next(p.problem for p in reference_problems() if "patch sticks" in p.name))
    for bad in (np.nan, np.inf):
        a = s.a.copy()
        a[0] = bad
        assert not _of(s, a).worst <= LIMIT


def test_an_own_linear_program_tells_whether_there_are_accelerations() -> None:
    """Two stops that contradict each other by 1 m/s2 miss by half of it at least; two that agree, by nothing."""
    for bias, least in ((-1.0, 0.5), (1.0, 0.0)):
        stop, both = rbd.problem.NonNegative(1), (("a", 1.0), ("b", -1.0))
        rows = [rbd.Rows(name, sign * np.ones((1, 1)), np.array([bias]), stop) for name, sign in both]
        assert C.least_miss(np.eye(1), rows) == pytest.approx(2.0 * least, abs=1e-9)
