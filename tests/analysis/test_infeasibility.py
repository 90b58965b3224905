"""Why there is no answer: contradictions are proved by certificates, and the nearest motion by its own."""

from __future__ import annotations

import itertools
import math
import pickle
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.conditions import conditions_of, smallest_violation
from rbd.answers.analysis.infeasibility import Contradiction, _balanced, contradiction, split
from rbd.arrays import Array, cross_matrix
from rbd.errors import CannotHold, InputError, NoSolution
from rbd.problem.conic import Conic, ConicAnswer
from rbd.problem.gauss_problem import CONVEX
from rbd.problem.programs import Outcome
from rbd.problem.rows import Patch, Rows
from rbd.testing.reference import box

MU = 0.5
RUB = rbd.problem.Bounds([-1.0], [2.0])  # type: ignore[arg-type]
TINY = 1e-11


def rows(
    name: str, J: Sequence[Sequence[float]] | Array, offset: Sequence[float] | Array, cone: rbd.problem.cones.Cone
) -> Rows:
    """Rows from lists; the offset as bias."""
    return Rows(name, np.array(J, float), np.array(offset, float), cone)


def problem(*given: Rows) -> rbd.GaussProblem:
    """Rows on coordinates of unit inertia, pulled along all of them."""
    nv = given[0].J.shape[1]
    return rbd.GaussProblem(np.eye(nv), np.ones(nv), given)


def stacked(P: rbd.GaussProblem, parts: dict[str, Array]) -> Array:
    """Row forces of all constraints, in order."""
    return np.concatenate([parts[r.name] for r in P.rows])


def off_cone(cone: rbd.problem.cones.Cone, f: Array, law: str) -> float:
    """Distance of row forces to what may push or pull, by closed forms; for Coulomb's law along normals alone."""
    if isinstance(cone, rbd.problem.FrictionCone) and "facets" in law:
        return max(0.0, abs(f[0]) - cone.mu * f[2], abs(f[1]) - cone.mu * f[2])  # four facets
    if isinstance(cone, rbd.problem.FrictionCone) and law == "coulomb":
        return float(np.hypot(f[0], f[1]) + max(0.0, -f[2]))
    if isinstance(cone, rbd.problem.FrictionCone):
        return float(max(0.0, np.hypot(f[0], f[1]) - cone.mu * f[2]))
    if isinstance(cone, rbd.problem.NonNegative):
        return float(np.maximum(-f, 0.0).max())
    if isinstance(cone, rbd.problem.Bounds):
        return float(np.abs(f).max())
    assert isinstance(cone, rbd.problem.Free)
    return 0.0


def assert_proved(P: rbd.GaussProblem, found: Contradiction | None, law: str = "convex") -> None:
    """Farkas, from outside: f in K, J^T f = 0, f . offset = -1; and so every acceleration misses some row."""
    assert found is not None
    f = stacked(P, dict(found.certificate))
    assert abs(f @ P.offset + 1.0) < TINY * max(1.0, np.abs(f).max())
    assert np.abs(P.J.T @ f).max() < TINY * max(1.0, np.abs(f).max())
    for r in P.rows:
        assert off_cone(r.cone, found.certificate[r.name], law) < TINY * max(1.0, np.abs(f).max())
        assert (r.name in found.rows) == bool(found.certificate[r.name].any())


def assert_irreducible(P: rbd.GaussProblem, found: Contradiction | None, law: str = "convex") -> None:
    """Any one of the constraints left out, the rest agree."""
    assert found is not None
    for name in found.rows:
        rest = [r for r in P.rows if r.name in found.rows and r.name != name]
        assert not rest or contradiction(rbd.GaussProblem(P.M, P.rhs, rest), law) is None


def driven(r: Rows, away: float) -> Rows:
    """A contact's rows with a feedback that drives it off along its normal [m/s2]."""
    return replace(r, feedback=np.r_[0.0, 0.0, -away, np.zeros(len(r) - 3)])


def squeezed() -> rbd.GaussProblem:
    """One coordinate between two stops with opposite feedback: a >= 1 and a <= -2."""
    return problem(rows("low", [[1]], [-1], rbd.problem.NonNegative(1)), rows("high", [[-1]], [-2], rbd.problem.NonNegative(1)))


@pytest.mark.parametrize("law", ["convex", "coulomb", "convex, 4 facets"])
def test_two_stops_squeeze(law: str) -> None:
    """Asked for a >= 1 and a <= -2: forces 1/3 each do work -1, and a = -1/2 misses both by 3/2, the least. Closed form."""
    found = contradiction(squeezed(), law)
    assert_proved(squeezed(), found, law)
    assert found is not None and found.smallest and list(found.rows) == ["low", "high"]
    assert np.allclose([found.certificate["low"], found.certificate["high"]], 1.0 / 3.0, rtol=0, atol=TINY)
    assert abs(found.violation - 1.5) < TINY


def test_a_joint_limit_against_a_held_frame() -> None:
    """A bar of 0.8 m at its stop (angle must grow), its tip drawn down by 2 m/s2: the two are named, a third joint is not."""
    P = problem(
        rows("stop", [[1, 0]], [0], rbd.problem.NonNegative(1)),
        rows("tip", [[0.8, 0]], [2], rbd.problem.Free(1)),
        rows("neck", [[0, 1]], [5], rbd.problem.Free(1)),
    )
    found = contradiction(P)
    assert_proved(P, found)
    assert found is not None and set(found.rows) == {"stop", "tip"} and found.smallest
    assert found.certificate["tip"] == pytest.approx([-0.5], abs=TINY)  # 2 f = -1
    assert found.certificate["stop"] == pytest.approx([0.4], abs=TINY)  # balances -0.8 / 2


def test_three_that_contradict_each_other_though_every_two_agree() -> None:
    """Asked for x >= 1, y >= 1, x + y <= 1/2: the corner of a triangle turned inside out; violation 1/2 each."""
    P = problem(
        rows("right", [[1, 0]], [-1], rbd.problem.NonNegative(1)),
        rows("up", [[0, 1]], [-1], rbd.problem.NonNegative(1)),
        rows("back", [[-1, -1]], [0.5], rbd.problem.NonNegative(1)),
    )
    found = contradiction(P)
    assert_proved(P, found)
    assert_irreducible(P, found)
    assert found is not None and len(found.rows) == 3 and found.smallest
    assert abs(found.violation - 0.5) < TINY


def test_the_smallest_of_two_contradictions_is_named() -> None:
    """Three rows contradict each other by 100, two others by 0.01: the two are named, as they are fewer."""
    P = problem(
        rows("a", [[1, 0, 0]], [-100], rbd.problem.NonNegative(1)),
        rows("b", [[0, 1, 0]], [-100], rbd.problem.NonNegative(1)),
        rows("c", [[-1, -1, 0]], [-100], rbd.problem.NonNegative(1)),
        rows("d", [[0, 0, 1]], [0], rbd.problem.Free(1)),
        rows("e", [[0, 0, 2]], [0.02], rbd.problem.Free(1)),
    )
    found = contradiction(P)
    assert_proved(P, found)
    assert found is not None and set(found.rows) == {"d", "e"} and found.smallest


def test_a_constraint_may_contradict_itself_and_its_rows_are_named() -> None:
    """Rows 2 and 4 of five ask for two accelerations of one coordinate."""
    J = np.eye(5)
    J[3] = J[1]
    P = problem(
        rows("hand", J, [0, 1, 2, 3, 4], rbd.problem.Free(5)), rows("knee", [[0, 0, 0, 1, 0]], [1], rbd.problem.Free(1))
    )
    found = contradiction(P, "bilateral")
    assert_proved(P, found)
    assert found is not None and dict(found.rows) == {"hand": ("row 2", "row 4")}
    assert "'hand' (row 2, row 4) contradicts itself" in str(found)


def test_redundant_rows_that_agree_are_no_contradiction() -> None:
    """The same row thrice, scaled, with the same demand; and four held corners of a box at rest."""
    P = problem(*[rows(str(i), [[s, 0], [0, -s]], [-s, 2 * s], rbd.problem.Free(2)) for i, s in enumerate((1.0, -3.0, 1e-3))])
    assert contradiction(P) is None
    assert contradiction(rbd.gauss_problem(box_state(0.0), [], corners())) is None


def test_no_rows_and_rows_that_ask_nothing_do_not_contradict() -> None:
    """Intervals allow any acceleration; no row allows more."""
    assert contradiction(problem(Rows("none", np.zeros((0, 2)), np.zeros(0), rbd.problem.Free(0)))) is None
    rub = [rows(str(i), [[1.0]], [7.0 * i], RUB) for i in range(3)]
    assert contradiction(problem(*rub)) is None


@pytest.mark.parametrize("seed", range(20))
def test_random_systems_with_a_known_contradiction(seed: int) -> None:
    """One positive dependence among rows that are independent otherwise: that set, those multipliers, no other."""
    rng = np.random.default_rng(seed)
    k, more = int(rng.integers(2, 6)), int(rng.integers(0, 5))
    nv = k + more + 2
    A, b, z = rng.normal(size=(k + more, nv)), rng.normal(size=k + more), rng.uniform(0.2, 2.0, k)
    A[k - 1] = -(z[:-1] @ A[: k - 1]) / z[-1]
    b[k - 1] -= (z @ b[:k] + rng.uniform(0.1, 1.0)) / z[-1]  # so that z . b < 0
    order = rng.permutation(k + more)
    P = problem(*[rows(f"row {i}", A[[i]], b[[i]], rbd.problem.NonNegative(1)) for i in order])
    found = contradiction(P)
    assert_proved(P, found)
    assert found is not None and set(found.rows) == {f"row {i}" for i in range(k)} and found.smallest
    expected = z / -(z @ b[:k])
    assert np.allclose([found.certificate[f"row {i}"][0] for i in range(k)], expected, rtol=1e-9, atol=0)
    assert found.violation == pytest.approx(1.0 / expected.sum(), rel=1e-9)


def floor_and_pull(normal: float, facets: int = 4) -> rbd.GaussProblem:
    """A point on a rough floor that is drawn along (1, 1, normal) m/s2."""
    return problem(
        rows("floor", np.eye(3), [0, 0, 0], rbd.problem.FrictionCone(MU, facets)),
        rows("pull", np.eye(3), [-1, -1, -normal], rbd.problem.Free(3)),
    )


@pytest.mark.parametrize(("law", "least"), [("convex", MU * math.sqrt(2.0)), ("convex, 4 facets", 2.0 * MU), ("coulomb", 0.0)])
def test_each_law_contradicts_where_its_own_cone_says_so(law: str, least: float) -> None:
    """What slides must lift: c_n >= mu |c_t| (circular), mu (|c_x| + |c_y|) (four facets), 0 (Coulomb). To 1e-6 of it."""
    assert contradiction(floor_and_pull(least + 1e-6), law) is None
    P = floor_and_pull(least - 1e-6)
    found = contradiction(P, law)
    assert_proved(P, found, law)
    assert_irreducible(P, found, law)
    assert found is not None and 0.0 < found.violation <= 1e-6


@pytest.mark.parametrize("mu", [0.05, 0.6, 3.0])
@pytest.mark.parametrize("seed", range(5))
def test_true_cones_that_miss_each_other(mu: float, seed: int) -> None:
    """A point drawn in any direction outside the dual of its circular cone: certificates in the true cone, not a pyramid's."""
    rng = np.random.default_rng(seed)
    angle, R = rng.uniform(0.0, 2.0 * math.pi), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    c = np.array([math.cos(angle), math.sin(angle), 0.9 * mu])
    P = problem(
        rows("floor", R, np.zeros(3), rbd.problem.FrictionCone(mu)), rows("pull", np.eye(3), -R.T @ c, rbd.problem.Free(3))
    )
    found = contradiction(P)
    assert_proved(P, found)
    # With the pull met, the floor misses by the distance of c to its dual: no more than that is claimed.
    assert found is not None and 0.0 < found.violation <= 0.1 * mu / math.hypot(1.0, mu) * (1.0 + 1e-9)


@pytest.mark.parametrize("law", ["convex", "convex, 4 facets", "coulomb"])
def test_floor_and_ceiling_with_feedback(law: str) -> None:
    """Both press a point away with 1 m/s2: no acceleration does both; normals alone prove it, under every law."""
    down = np.diag([1.0, -1.0, -1.0])
    P = problem(
        Rows("floor", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(MU), feedback=np.array([0.0, 0.0, -1.0])),
        Rows("ceiling", down, np.zeros(3), rbd.problem.FrictionCone(MU), feedback=np.array([0.0, 0.0, -1.0])),
    )
    found = contradiction(P, law)
    assert_proved(P, found, law)
    assert found is not None and dict(found.rows) == {"floor": ("normal",), "ceiling": ("normal",)}
    assert found.violation == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("law", ["convex", "coulomb", "convex, 4 facets"])
def test_what_moves_away_takes_no_part(law: str) -> None:
    """A floor that the point leaves at 1 m/s pushes nothing: of a lift and a lid the two are named, and never the floor."""
    leaves = replace(rows("floor", np.eye(3), [0, 0, 3], rbd.problem.FrictionCone(MU)), velocity=np.array([0.0, 0.0, 1.0]))
    P = problem(
        leaves,
        rows("lift", [[0, 0, 1]], [-1], rbd.problem.NonNegative(1)),
        rows("lid", [[0, 0, -1]], [0], rbd.problem.NonNegative(1)),
    )
    found = contradiction(P, law)
    assert found is not None and set(found.rows) == {"lift", "lid"} and found.smallest
    assert found.violation == pytest.approx(0.5, abs=TINY) and not found.certificate["floor"].any()


def test_rows_of_a_patch_that_are_no_wrench_are_counted() -> None:
    """Two rows at a place, neither a force nor a wrench: rows 1 and 2, not axes."""
    patch = Patch(np.zeros(3), np.eye(3), np.zeros((1, 3)), None)
    P = problem(replace(rows("odd", [[1.0, 0.0], [1.0, 0.0]], [1.0, 2.0], rbd.problem.Free(2)), patch=patch))
    found = contradiction(P)
    assert found is not None and dict(found.rows) == {"odd": ("row 1", "row 2")}
    assert "'odd' (row 1, row 2) contradicts itself" in found.claim


def test_a_sliding_point_counts_along_its_normal() -> None:
    """Under Coulomb's law a point that slides must not sink; its friction proves nothing, so f is along the normal."""
    slides = Rows("floor", np.eye(3), np.array([0.0, 0.0, -1.0]), rbd.problem.FrictionCone(MU), np.array([1.0, 0.0, 0.0]))
    P = problem(slides, rows("pull", [[0, 0, 1]], [0.5], rbd.problem.Free(1)))
    found = contradiction(P, "coulomb")
    assert_proved(P, found, "coulomb")
    assert contradiction(problem(slides, rows("pull", [[1, 0, 0]], [9], rbd.problem.Free(1))), "coulomb") is None
    away = Rows("floor", np.eye(3), np.array([0.0, 0.0, -1.0]), rbd.problem.FrictionCone(MU), np.array([1.0, 0.0, 1.0]))
    assert contradiction(problem(away, rows("pull", [[0, 0, 1]], [0.5], rbd.problem.Free(1))), "coulomb") is None


def box_state(turn: float, tilt: float = 0.0) -> rbd.State:
    """A box on the ground that turns about the vertical, and about its x axis [rad/s]."""
    robot = box()
    q = pin.neutral(robot.model)
    q[2] = 0.1
    return rbd.State(robot, q, np.array([0.0, 0.0, 0.0, tilt, 0.0, turn]))


SITES = np.array([[0.2, 0.1, -0.1], [0.2, -0.1, -0.1], [-0.2, -0.1, -0.1], [-0.2, 0.1, -0.1]])


def corners() -> list[rbd.PointContact]:
    """The box's four lower corners, held."""
    return [rbd.PointContact(f"corner {i}", "box", offset=p) for i, p in enumerate(SITES)]


def test_two_corners_of_a_turning_box_contradict_each_other() -> None:
    """Both held, their distance d would have to change at w^2 d: two neighbours across 0.2 m, by 0.2 w^2 / 2 each."""
    P = rbd.gauss_problem(box_state(2.0), [], corners())
    found = contradiction(P, "bilateral")
    assert_proved(P, found)
    assert found is not None and len(found.rows) == 2 and found.smallest
    one, other = (found.certificate[name] for name in found.rows)
    p, r = (SITES[int(name.split()[1])] for name in found.rows)
    along = (r - p) / np.linalg.norm(r - p)
    assert np.abs(np.cross(one, along)).max() < TINY and np.abs(one + other).max() < TINY  # a squeeze along their line
    assert abs(abs(one @ along) - 1.0 / (4.0 * np.linalg.norm(r - p))) < TINY  # f w^2 d = 1


def test_what_held_corners_require_is_split() -> None:
    """Turning about the vertical, corner i requires +w^2 p: no rigid motion gives any of it. Closed form."""
    P = rbd.gauss_problem(box_state(2.0), [], corners())
    found = contradiction(P, "bilateral")
    assert found is not None
    for i, p in enumerate(SITES):
        assert np.abs(found.unmet[f"corner {i}"] - 4.0 * np.array([p[0], p[1], 0.0])).max() < 1e-12
        assert np.abs(found.met[f"corner {i}"]).max() < 1e-12
    assert "Bilateral rows cannot be met" in found.unmet_most and "corner 0" in found.unmet_most


def test_the_split_is_the_least_squares_one_and_adds_up() -> None:
    """Met in the range of J, unmet at right angles to it; zero where held rows agree; rows that push have no part in it."""
    P = rbd.gauss_problem(box_state(2.0, 1.5), [], [*corners(), rbd.PointContact("rubs", "box", friction=0.5)])
    met, unmet = split(P)
    held = slice(0, 12)
    assert set(met) == set(unmet) == {f"corner {i}" for i in range(4)}
    s = np.concatenate(list(unmet.values()))
    assert np.abs(P.J[held].T @ s).max() < 1e-12 < np.abs(s).max()
    assert np.abs(np.concatenate(list(met.values())) + s + P.offset[held]).max() < 1e-12
    a = np.linalg.lstsq(P.J[held], -P.offset[held])[0]
    assert np.abs(P.J[held] @ a - np.concatenate(list(met.values()))).max() < 1e-12
    assert np.abs(np.concatenate(list(split(rbd.gauss_problem(box_state(0.0), [], corners()))[1].values()))).max() < 1e-12


def test_a_foot_held_by_the_floor_and_by_a_lift() -> None:
    """One patch of a box, held by the floor and by a lift that rises with 1 m/s2: normal against normal, 1/2 m/s2 each."""
    at = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=at)
    lift = rbd.SurfaceContact(
        "lift", "box", half_lengths=(0.1, 0.1), placement=at, on=rbd.Ground(acceleration=(0, 0, 1.0, 0, 0, 0))
    )
    with pytest.raises(NoSolution, match=r"'floor' \(normal\) and 'lift' \(normal\) contradict each other") as caught:
        rbd.solve(box_state(0.0), [], [floor, lift])
    error = caught.value
    assert error.problem is not None
    assert_proved(error.problem, error.contradiction)
    assert error.contradiction is not None and error.contradiction.violation == pytest.approx(0.5, abs=TINY)
    near = error.nearest()
    assert near.a[2] == pytest.approx(0.5, abs=1e-12)
    assert near.violation["floor"] == pytest.approx([0, 0, -0.5, 0, 0, 0], abs=1e-12)
    assert sum(near.forces.values())[2] == pytest.approx(10.0 * (9.81 + 0.5), abs=1e-9)  # type: ignore[index]
    assert "SurfaceContact, not" not in str(error)


def test_a_robots_soles_with_feedback_that_no_acceleration_satisfies(talos: rbd.Robot) -> None:
    """A foot between floor and ceiling, both rubbing, drawn apart: under pyramids and true cones, proved point by point."""
    state = talos.standing()
    found_rows = [c.rows(state) for c in talos.soles(0.7)]
    sole = talos.soles(0.7)[0]
    above = rbd.PointContact("ceiling", sole.frame, on=rbd.Ground(normal=(0.0, 0.0, -1.0)), friction=0.3).rows(state)
    P = rbd.GaussProblem(state.M, -state.h, [driven(found_rows[0], 2.0), driven(above, 2.0), found_rows[1]])
    for law in ("convex, 4 facets", "convex", "coulomb"):
        found = contradiction(P, law)
        assert found is not None and set(found.rows) == {sole.name, "ceiling"} and found.smallest
        f = stacked(P, dict(found.certificate))
        assert abs(f @ P.offset + 1.0) < TINY and np.abs(P.J.T @ f).max() < TINY
        wrench = found.certificate[sole.name]
        x, y = np.abs(sole.corners[:, :2]).max(axis=0)
        assert wrench[2] > 0.0 and abs(wrench[3]) <= y * wrench[2] and abs(wrench[4]) <= x * wrench[2]  # pushes within the sole
        assert off_cone(above.cone, found.certificate["ceiling"], law) < TINY


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_rounding_is_no_contradiction(size: float) -> None:
    """Two held rows 1e-12 apart, relative to what they ask: none; and solved. 1e-6 apart: contradictory, and not solved."""
    for apart, wrong in ((1e-12, False), (1e-5, True)):
        far = apart * max(1.0, size)
        P = problem(
            rows("one", [[1.0]], [size], rbd.problem.Free(1)), rows("other", [[1.0]], [size + far], rbd.problem.Free(1))
        )
        assert (contradiction(P) is not None) == wrong
        for solver in (rbd.ProxQP(), rbd.KKT()):
            assert (rbd.solve_problem(P, solver=solver, check=False).status is rbd.problem.Status.INFEASIBLE) == wrong
            assert (rbd.solve_problem(P, solver=solver, check=False).status is rbd.problem.Status.SOLVED) != wrong


def test_dependence_to_rounding_is_needed_not_to_a_thousandth() -> None:
    """Rows that are nearly the same can still be met, by a large motion."""
    for angle in (1e-2, 1e-4):
        P = problem(rows("one", [[1, 0]], [0], rbd.problem.Free(1)), rows("other", [[1, angle]], [1], rbd.problem.Free(1)))
        assert contradiction(P) is None


def ladder_of_stops(n: int) -> rbd.GaussProblem:
    """a_1 >= 1, each next one at least 1 above, and the last at most n / 2: n + 1 rows, none of which can be left out."""
    J = np.eye(n) - np.eye(n, k=-1)
    steps = [rows(f"step {i}", J[i : i + 1], [-1.0], rbd.problem.NonNegative(1)) for i in range(n)]
    return problem(*steps, rows("lid", -np.eye(n)[-1:], [0.5 * n], rbd.problem.NonNegative(1)))


def test_of_many_that_contradict_each_other_eight_are_named() -> None:
    """Nine steps and a lid: each of ten rows missed by n / 2 / 10, seven are named and three counted; the table names all."""
    P = ladder_of_stops(9)
    found = contradiction(P)
    assert_proved(P, found)
    assert found is not None and len(found.rows) == 10 and found.violation == pytest.approx(0.45, abs=TINY)
    assert found.who.endswith("'step 6' and 3 others") and "'step 7'" not in found.who
    assert "  step 8 " in str(found) and "  lid " in str(found)


def test_where_nothing_is_held_no_row_is_said_to_be_unmet() -> None:
    """Two stops: the proof is listed, and least squares over rows that hold has nothing to say."""
    found = contradiction(squeezed())
    assert found is not None and found.unmet_most == "" and "least squares" not in str(found)
    assert str(found).splitlines()[-1].split() == ["high", "[0.3333]"]


@pytest.mark.parametrize("limit", ["CERTIFICATE_LEFT_OUT", "CERTIFICATE_PROGRAMS"])
def test_a_search_that_ends_at_its_limit_does_not_claim_the_smallest(monkeypatch: pytest.MonkeyPatch, limit: str) -> None:
    """The contradiction is proved as ever; that no smaller one exists is not said."""
    monkeypatch.setattr(f"rbd.answers.analysis.infeasibility.{limit}", 0)
    found = contradiction(ladder_of_stops(3))
    assert_proved(ladder_of_stops(3), found)
    assert found is not None and not found.smallest and "A smaller set was not excluded." in str(found)


def given_up(program: Conic, *, newton: bool = True) -> ConicAnswer:
    """In place of `solve_conic`: zeros, and that nothing was found."""
    x, y, z = np.zeros(len(program.g)), np.zeros(len(program.b)), np.zeros(len(program.C))
    return ConicAnswer(program, Outcome.NOT_FOUND, x, y, z, "none", 0)


def test_a_program_that_gives_up_proves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """No certificate is found; None, not a wrong one."""
    monkeypatch.setattr("rbd.answers.analysis.conditions.solve_conic", given_up)
    assert contradiction(ladder_of_stops(3)) is None


def test_forces_of_the_wrong_sign_leave_a_certificate() -> None:
    """Three stops on one line, 1 + 1e-5, 1 and 1e-6: balance would make the third pull, so the first two are left, even."""
    P = problem(*(rows(n, [[s]], [-1.0], rbd.problem.NonNegative(1)) for n, s in (("a", 1.0), ("b", -1.0), ("c", 1.0))))
    z = _balanced(conditions_of(P, CONVEX), np.array([1.0 + 1e-5, 1.0, 1e-6]), 1.0)
    assert z[2] == 0.0 and z[0] == pytest.approx(1.0 + 5e-6, abs=1e-12) and abs(z[0] - z[1]) < 1e-15
    assert not _balanced(conditions_of(P, CONVEX), np.array([1.0, 0.0, 0.0]), 1.0).any()  # one force cannot balance


def test_a_law_that_is_none_is_refused() -> None:
    """In words."""
    for law in ("hooke", "", None, "facets"):
        with pytest.raises(InputError, match="law is"):
            contradiction(squeezed(), law)  # type: ignore[arg-type]


# The nearest motion


def test_stops_give_way_to_each_other_by_their_weights() -> None:
    """Asked for a >= 1 and a <= -2: a = -1/2; where the lower stop's square counts w^2 times, a = (w^2 - 2) / (1 + w^2)."""
    near = rbd.answers.solution.nearest_motion(squeezed())
    assert near.a == pytest.approx([-0.5], abs=TINY)
    assert near.violation["low"] == pytest.approx([1.5], abs=TINY) and near.optimality < TINY
    near = rbd.answers.solution.nearest_motion(squeezed(), weights={"low": 3.0})
    assert near.a == pytest.approx([(9.0 - 2.0) / 10.0], abs=TINY)
    assert near.violation["low"] == pytest.approx([0.3], abs=TINY)


def assert_least(P: rbd.GaussProblem, near: rbd.answers.solution.NearestMotion) -> None:
    """Its own proof, from outside: s in K with J^T s = 0 and s . offset = -|s|^2, so no a has a row distance below |s|."""
    s = stacked(P, dict(near.violation))
    size = max(1.0, float(np.abs(s).max())) ** 2
    assert np.abs(P.J.T @ s).max() < 1e-9 * size
    assert abs(s @ P.offset + s @ s) < 1e-9 * size
    for r in P.rows:
        assert off_cone(r.cone, near.violation[r.name], str(near.solution.law)) < 1e-9 * size


@pytest.mark.parametrize("seed", range(20))
def test_the_violation_is_the_least(seed: int) -> None:
    """Random cones and one held row too many: s proves itself, the relaxed problem is solved, no other a comes nearer."""
    rng = np.random.default_rng(seed)
    nv = int(rng.integers(1, 4))
    cones = [
        rbd.problem.FrictionCone(0.6),
        rbd.problem.NonNegative(2),
        rbd.problem.Free(nv + 1),
        rbd.problem.FrictionCone(1.2),
        RUB,
    ]
    P = problem(*[rows(str(i), rng.normal(size=(c.dim, nv)), 3.0 * rng.normal(size=c.dim), c) for i, c in enumerate(cones)])
    assert contradiction(P, "convex, 4 facets") is not None
    near = rbd.answers.solution.nearest_motion(P, solver=rbd.ProxQP())
    assert_least(P, near)
    assert near.solution.status is rbd.problem.Status.SOLVED and near.optimality < 1e-9
    s = stacked(P, dict(near.violation))
    for _ in range(50):
        a = near.a + rng.normal(size=nv) * 10.0 ** rng.uniform(-3, 1)
        assert distance_to_dual(P, a) >= np.linalg.norm(s) - 1e-9
    assert distance_to_dual(P, near.a) == pytest.approx(np.linalg.norm(s), abs=1e-8)


def distance_to_dual(P: rbd.GaussProblem, a: Array) -> float:
    """Distance of c to K* in the Euclidean norm of the rows, four facets: by Moreau, the length of -c's projection onto K."""
    c, total = P.J @ a + P.offset, 0.0
    for r in P.rows:
        part = c[P.slices[r.name]]
        if isinstance(r.cone, rbd.problem.FrictionCone):
            total += nearest_in_pyramid(-part, r.cone.mu)
        elif isinstance(r.cone, rbd.problem.NonNegative):
            total += float((np.minimum(part, 0.0) ** 2).sum())
        elif isinstance(r.cone, rbd.problem.Free):
            total += float(part @ part)
    return math.sqrt(total)


def nearest_in_pyramid(x: Array, mu: float) -> float:
    """Squared length of the projection of x onto |f_x|, |f_y| <= mu f_z, face by face."""
    best = 0.0
    corners = [np.array([i * mu, j * mu, 1.0]) for i, j in itertools.product((-1, 1), repeat=2)]
    for k in range(1, 4):
        for some in itertools.combinations(corners, k):
            G = np.array(some).T
            w = np.linalg.lstsq(G, x)[0]
            if (w >= -1e-12).all():
                best = max(best, float((G @ w) @ (G @ w)))
    return best


def test_of_what_can_be_solved_the_nearest_motion_is_the_answer(talos: rbd.Robot) -> None:
    """No violation, and the same acceleration as `solve`."""
    state, soles = talos.standing(), talos.soles()
    tau = rbd.hold(state, soles).tau * 0.9
    P = rbd.gauss_problem(state, tau, soles)
    near = rbd.answers.solution.nearest_motion(P)
    assert near.worst == 0.0
    assert np.abs(near.a - rbd.solve(state, tau, soles).a).max() < 1e-9


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.KKT()])
def test_a_box_turning_on_four_held_corners_moves_as_on_one_patch(solver: rbd.ProxQP | rbd.KKT) -> None:
    """About the vertical, no part of the corners' demand can be met: motion and wrench are those of six rows, 98.1 N."""
    state = box_state(3.0)
    at = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    patch = rbd.SurfaceContact("patch", "box", corners=SITES * [1, 1, 0], placement=at)
    six = rbd.solve(state, [], [patch])
    P = rbd.gauss_problem(state, [], corners())
    near = rbd.answers.solution.nearest_motion(P, solver=solver)
    best = rbd.solve(state, [], corners(), solver=solver, check=False)
    for answer in (near.solution, best):
        assert np.abs(answer.a - six.a).max() < 1e-9
        assert np.abs(P.J.T @ answer.multipliers - six.problem.J.T @ six.multipliers).max() < 1e-8
        assert np.abs(answer.multipliers).max() < 50.0  # 98.1 N on four corners, and nothing of 1e5 N
    assert best.status is rbd.problem.Status.INFEASIBLE


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.KKT()])
def test_talos_turning_on_four_held_points_moves_as_on_a_sole(talos: rbd.Robot, solver: rbd.ProxQP | rbd.KKT) -> None:
    """A foot that turns in any way: as on six rows that require what of the twelve can be met; forces of the weight's size."""
    rng = np.random.default_rng(5)
    sole = talos.soles(None)[0]
    points = [rbd.PointContact(f"point {i}", sole.frame, offset=sole.placement.act(p)) for i, p in enumerate(sole.corners)]
    state = talos.standing().with_velocity(rng.normal(size=talos.nv))
    tau = rbd.hold(talos.standing(), talos.soles()).tau
    P = rbd.gauss_problem(state, tau, points)
    near = rbd.answers.solution.nearest_motion(P, solver=solver)
    met = np.concatenate([near.violation[p.name] for p in points])
    assert np.abs(met).max() > 0.01
    # Accelerations of the corners are B times that of the patch, so six rows with B^+ of the corners' offsets say the same.
    r = sole.rows(state)
    world = r.patch.axes if r.patch is not None else np.eye(3)
    B = np.vstack([np.hstack([world, -world @ cross_matrix(p)]) for p in sole.corners])
    assert np.abs(B @ r.J - P.J).max() < 1e-12
    six = Rows("sole", r.J, np.linalg.lstsq(B, P.offset)[0], rbd.problem.Free(6))
    expected = rbd.KKT().solve(rbd.GaussProblem(P.M, P.rhs, [six]))
    best = rbd.solve(state, tau, points, solver=solver, check=False)
    for answer in (near.solution, best):
        assert np.abs(answer.a - expected.a).max() < 1e-9 * np.abs(expected.a).max()
        wrench = B.T @ answer.multipliers
        assert np.abs(wrench - expected.multipliers).max() < 1e-8 * np.abs(expected.multipliers).max()
        assert np.abs(answer.multipliers).max() < 10.0 * np.abs(expected.multipliers).max()


@pytest.mark.parametrize("law", ["convex", "coulomb"])
def test_true_cones_have_a_nearest_motion_too(law: str) -> None:
    """A point drawn along its floor: circular cone, distance of (1, 1, n) and (0, 0, 0) shared by two rows, half each."""
    normal = 0.3 if law == "convex" else -0.3
    P = floor_and_pull(normal)
    near = rbd.answers.solution.nearest_motion(P, solver=rbd.ConeSolver(law=law))  # type: ignore[arg-type]
    assert_least(P, near)
    slope = MU if law == "convex" else 0.0  # c_n >= slope |c_t|
    apart = (slope * math.sqrt(2.0) - normal) / math.hypot(1.0, slope)
    assert np.linalg.norm(near.violation["floor"]) == pytest.approx(0.5 * apart, abs=1e-9)
    assert np.linalg.norm(near.violation["pull"]) == pytest.approx(0.5 * apart, abs=1e-9)


@pytest.mark.parametrize("angle", [0.3, 1.0, 4.0])
def test_a_true_cone_is_met_in_any_direction(angle: float) -> None:
    """Drawn along any direction: the shared distance is the closed form's."""
    along = np.array([math.cos(angle), math.sin(angle)])
    P = problem(
        rows("floor", np.eye(3), [0, 0, 0], rbd.problem.FrictionCone(MU)),
        rows("pull", np.eye(3), [*-along, 0.0], rbd.problem.Free(3)),
    )
    near = rbd.answers.solution.nearest_motion(P, solver=rbd.ConeSolver(law="convex"))
    assert_least(P, near)
    half = 0.5 * MU / math.hypot(1.0, MU)  # from (along, 0) to c_n >= mu |c_t|, shared by two
    expected = half * np.r_[-MU * along, 1.0] / math.hypot(1.0, MU)
    assert np.linalg.norm(near.violation["floor"]) == pytest.approx(half, abs=1e-9)
    # Its conditions hold to 1e-10, and so does its square: of a strictly convex minimum the place is known to the root of that.
    assert np.linalg.norm(near.violation["floor"] - expected) <= math.sqrt(2e-10)


def drawn_along() -> rbd.GaussProblem:
    """A point on a rough floor that is drawn along it, at a radian from x."""
    pull = rows("pull", np.eye(3), [-math.cos(1.0), -math.sin(1.0), 0.0], rbd.problem.Free(3))
    return problem(rows("floor", np.eye(3), [0, 0, 0], rbd.problem.FrictionCone(MU)), pull)


@pytest.mark.parametrize("P", [drawn_along(), squeezed()], ids=["cone", "stops"])
def test_a_violation_is_judged_by_its_own_conditions(monkeypatch: pytest.MonkeyPatch, P: rbd.GaussProblem) -> None:
    """Whatever the solver gives: of zeros the optimality says that they are not the least."""
    expected, miss = smallest_violation(P, CONVEX)
    assert miss < 1e-9

    monkeypatch.setattr("rbd.answers.analysis.conditions.solve_conic", given_up)
    s, optimality = smallest_violation(P, CONVEX)
    assert optimality > 1e-6 and np.abs(s - expected).max() <= 10.0 * optimality


def test_weights_that_are_none_are_refused() -> None:
    """Unknown names with the nearest ones; zeros, wrong sizes; a problem and a solver that are none."""
    for weights, said in (
        ({"lo": 1.0}, "no constraint 'lo'; nearest: 'low'"),
        ({"low": 0.0}, "expected one number > 0"),
        ({"low": [1.0, 2.0]}, "or 1 of them"),
        ([1.0], "expected {constraint: weight}"),
    ):
        with pytest.raises(InputError, match=said):
            rbd.answers.solution.nearest_motion(squeezed(), weights=weights)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="solver is"):
        rbd.answers.solution.nearest_motion(squeezed(), solver=rbd.ProxQP)  # type: ignore[arg-type]
    with pytest.raises(rbd.errors.Unsupported, match="KKT"):
        rbd.answers.solution.nearest_motion(squeezed(), solver=rbd.KKT())


# The error


def test_the_error_says_who_contradicts_whom_and_offers_certificate_and_motion(talos: rbd.Robot) -> None:
    """Names, size, what cannot be met, where the proof is and what to do; the proof holds, the motion is near."""
    sole = talos.soles(None)[0]
    points = [rbd.PointContact(f"point {i}", sole.frame, offset=sole.placement.act(p)) for i, p in enumerate(sole.corners)]
    v = np.zeros(talos.nv)
    v[3:6] = [0.0, 0.0, 2.0]
    with pytest.raises(NoSolution) as caught:
        rbd.solve(talos.standing().with_velocity(v), np.zeros(talos.nu), points)
    error = caught.value
    for said in ("no acceleration", "contradict each other", "error.contradiction", "error.nearest()", "SurfaceContact"):
        assert said in str(error)
    assert error.problem is not None and error.result is not None
    assert_proved(error.problem, error.contradiction)
    assert error.contradiction is error.result.contradiction
    assert all(repr(name) in str(error) for name in error.contradiction.rows)  # type: ignore[union-attr]
    assert np.abs(error.nearest().a - error.result.a).max() < 1e-9
    weighed = error.nearest(weights={"point 0": 100.0})
    assert np.abs(weighed.violation["point 0"]).max() < 0.1 * np.abs(error.nearest().violation["point 0"]).max()


def test_an_error_crosses_processes_with_its_motion() -> None:
    """Pickled and back: contradiction, problem and nearest motion are there."""
    with pytest.raises(NoSolution) as caught:
        rbd.solve(box_state(2.0), [], corners())
    back = pickle.loads(pickle.dumps(caught.value))
    assert str(back) == str(caught.value)
    assert_proved(back.problem, back.contradiction)
    assert np.abs(back.nearest().a - caught.value.nearest().a).max() < TINY


def test_where_no_contact_problem_was_posed_there_is_no_nearest_motion() -> None:
    """Statics have no acceleration to be near to."""
    for error in (NoSolution("none"), CannotHold("none")):
        assert error.contradiction is None
        with pytest.raises(InputError, match="no nearest motion"):
            error.nearest()


class GivesUp:
    """A solver without an answer that says why."""

    law = "bilateral"

    def reason_unsupported(self, problem: rbd.GaussProblem) -> str | None:
        """It takes anything."""
        return None

    def solve(self, problem: rbd.GaussProblem) -> rbd.problem.Answer:
        """Nothing moves."""
        a, f = np.zeros(problem.nv), np.zeros(problem.m)
        return rbd.problem.Answer(problem, a, f, None, "bilateral", "GivesUp", 0, 0.0, reason="the rod jams")


def test_a_solvers_own_reason_is_said_where_rows_do_not_contradict_each_other(talos: rbd.Robot) -> None:
    """Painleve's rod has no answer, though its rows agree: the reason stands first, and no proof is claimed."""
    with pytest.raises(NoSolution, match="^the rod jams") as caught:
        rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(None), solver=GivesUp())  # type: ignore[arg-type]
    assert caught.value.contradiction is None and "error.contradiction" not in str(caught.value)


def test_a_status_is_infeasible_where_it_is_proved() -> None:
    """Whatever the solver says."""
    agrees = problem(rows("one", [[1.0]], [3.0], rbd.problem.Free(1)))
    against = problem(rows("one", [[1.0]], [3.0], rbd.problem.Free(1)), rows("other", [[1.0]], [2.0], rbd.problem.Free(1)))
    assert rbd.solve_problem(agrees, solver=GivesUp(), check=False).status is rbd.problem.Status.FAILED
    assert rbd.solve_problem(against, solver=GivesUp(), check=False).status is rbd.problem.Status.INFEASIBLE


@pytest.mark.parametrize("seed", range(5))
def test_unchecked_answers_of_contradictory_contacts_are_bounded(talos: rbd.Robot, seed: int) -> None:
    """Rubbing soles whose feedback presses a foot between two: the motion of least violation, forces like the weight."""
    rng = np.random.default_rng(seed)
    state = talos.standing()
    tau = rbd.hold(state, talos.soles()).tau + 0.3 * rng.uniform(-1.0, 1.0, talos.nu)
    below = talos.soles(0.7)[0].rows(state)
    above = rbd.PointContact("ceiling", talos.soles()[0].frame, on=rbd.Ground(normal=(0.0, 0.0, -1.0)), friction=0.3).rows(
        state
    )
    out = rng.uniform(0.5, 2.0, 2)
    pushed = [driven(r, x) for r, x in zip((below, above), out, strict=True)]
    P = rbd.GaussProblem(state.M, rbd.gauss_problem(state, tau, []).rhs, pushed)
    found = rbd.solve_problem(P, check=False)
    assert found.status is rbd.problem.Status.INFEASIBLE
    assert np.abs(found.multipliers).max() < 10.0 * talos.mass * 9.81
    near = rbd.answers.solution.nearest_motion(P)
    assert near.solution.status is rbd.problem.Status.SOLVED and np.abs(found.a - near.a).max() < 1e-7
    s = stacked(P, dict(near.violation))
    # The two normals share what they are apart; so does the sole's moment, of the ceiling's lever about its centre.
    assert below.patch is not None and above.patch is not None
    lever = np.linalg.norm((above.patch.point - below.patch.point)[:2])
    assert s @ s == pytest.approx(out.sum() ** 2 / (2.0 + lever**2), rel=1e-9)
