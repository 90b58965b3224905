"""Conic programs: closed forms, another solver, proofs that are recomputed, and programs without this or that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from second_conic import by_scs, proof

from rbd.arrays import Array
from rbd.problem.cones import project_cones
from rbd.problem.conic import Certificate, Conic, Unknowns
from rbd.problem.programs import Outcome
from rbd.solvers import conic_newton
from rbd.solvers.conic_newton import solve_conic

NONE = np.zeros(0)
FREE = (-np.inf, np.inf)


def plain(H: Array, g: Array, *, A=None, b=NONE, C=None, low=None, high=None, bounds=FREE, cones=(), mu=()) -> Conic:
    """A program of n columns; what is not given is not there."""
    n = len(g)
    at = np.array(cones, int).reshape(-1, 3)
    x = Unknowns(n, np.asarray(H, float), np.asarray(g, float), *bounds, at, np.array(mu, float))
    equations = [] if A is None else [({"x": np.asarray(A, float)}, np.asarray(b, float))]
    between = [] if C is None else [({"x": C}, -np.inf if low is None else low, np.inf if high is None else high)]
    return Conic.of({"x": x}, equations, between)


def drawn(rng: np.random.Generator, *, strict: bool = True) -> tuple[Conic, Array]:
    """A program with cones, intervals, equations and rows between bounds, and one of its feasible points."""
    k, boxes = int(rng.integers(1, 5)), int(rng.integers(0, 4))
    n = 3 * k + boxes
    mu = 10.0 ** rng.uniform(-1.5, 0.5, k)
    cones = rng.permutation(n)[: 3 * k].reshape(k, 3)
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    for j in set(range(n)) - set(cones.ravel().tolist()):
        lower[j], upper[j] = ((0.0, np.inf), (-1.0, 1.0), (-np.inf, 0.5), (0.3, 0.3))[int(rng.integers(4))]
    x = np.minimum(np.maximum(rng.normal(size=n), lower), upper)
    x[cones] = project_cones(rng.normal(size=(k, 3)) + [0.0, 0.0, 1.0], mu)
    e, q = int(rng.integers(0, k + boxes + 1)), int(rng.integers(0, 4))
    A, C = rng.normal(size=(e, n)), rng.normal(size=(q, n))
    low, high = C @ x - rng.uniform(0.0, 0.5, q), C @ x + rng.uniform(0.0, 0.5, q)
    low[rng.random(q) < 0.3] = -np.inf
    B = rng.normal(size=(n if strict else max(1, n // 2), n))
    H = B.T @ B + (0.1 * np.eye(n) if strict else 0.0)
    g = rng.normal(size=n) if strict else H @ rng.normal(size=n)
    return Conic(H, g, A, A @ x, C, low, high, lower, upper, cones, mu), x


def impossible(rng: np.random.Generator) -> Conic:
    """A program that a drawn combination of its equations refutes: A^T y + r = 0 with r inside the dual of X, y . b > 0."""
    k = int(rng.integers(1, 4))
    n, e = 3 * k, int(rng.integers(2, 6))
    mu, y = 10.0 ** rng.uniform(-1.0, 0.5, k), rng.normal(size=e)
    r = rng.normal(size=(k, 3))
    r[:, 2] = 1.1 * mu * np.hypot(r[:, 0], r[:, 1])
    A, b = rng.normal(size=(e, n)), rng.normal(size=e)
    A[-1] = -(r.ravel() + y[:-1] @ A[:-1]) / y[-1]
    b[-1] = (0.1 - y[:-1] @ b[:-1]) / y[-1]
    return plain(np.eye(n), np.zeros(n), A=A, b=b, cones=np.arange(n), mu=mu)


def is_proof(program: Conic, certificate: Certificate | None, rng: np.random.Generator) -> None:
    """Recomputed from the definition; and for points of X up to the reach the three terms do not come to zero."""
    assert certificate is not None
    r, gap, left = proof(program, certificate)
    assert gap > 0.0 and gap == pytest.approx(certificate.gap, rel=1e-9, abs=1e-15)
    assert certificate.reach >= 1e3
    reach = gap / left if left > 0.0 else np.inf
    assert min(certificate.reach, 1e8) == pytest.approx(min(reach, 1e8), rel=1e-4)  # beyond it is rounding of rounding
    least = float(certificate.y @ program.b)
    z, low, high = certificate.z, program.low, program.high
    least += sum(z[i] * (low[i] if z[i] > 0 else high[i]) for i in np.flatnonzero(z))
    for size in 10.0 ** rng.uniform(-2, 2, 50):
        x = program.project(size * rng.normal(size=len(program.g)))
        if np.abs(x).sum() < certificate.reach:
            assert least + r @ x > 0.0


# --------------------------------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize(("newton", "size"), [(True, 1.0), (False, 1.0), (True, 1e6)])
def test_the_nearest_point_of_cones_is_their_projection(newton: bool, size: float, rng: np.random.Generator) -> None:
    """Minimise 1/2 |x - p|^2 over cones, or a million times that: inside, on the edge, and at the tip."""
    mu = np.array([0.1, 0.7, 2.0, 0.5])
    p = rng.normal(size=(4, 3)) * 2.0
    p[3] = [0.1, 0.1, -3.0]
    found = solve_conic(plain(size * np.eye(12), -size * p.ravel(), cones=np.arange(12), mu=mu), newton=newton)
    assert found.solved and found.miss < max(1e-11, 1e-14 * size)
    assert found.x == pytest.approx(project_cones(p, mu).ravel(), abs=max(1e-10, 1e-14 * size))
    assert found.method == ("Newton" if newton else "Clarabel")


def test_what_begins_far_away_is_not_given_up(rng: np.random.Generator) -> None:
    """The nearest to points 10,000 away, under two equations: steps first miss by as much, and nearly all end at rounding."""
    by_newton = 0
    for _ in range(40):
        k = int(rng.integers(2, 6))
        mu, far, A = rng.uniform(0.1, 2.0, k), 1e4 * rng.normal(size=3 * k), rng.normal(size=(2, 3 * k))
        x = project_cones(rng.normal(size=(k, 3)) + [0.0, 0.0, 1.0], mu).ravel()
        found = solve_conic(plain(np.eye(3 * k), -far, A=A, b=A @ x, cones=np.arange(3 * k), mu=mu))
        by_newton += found.solved and found.method == "Newton"
    assert by_newton >= 32


@pytest.mark.parametrize("newton", [True, False])
def test_a_row_between_bounds_has_the_multiplier_of_its_side(newton: bool) -> None:
    """Least |x|^2 / 2 with 2 <= x1 + x2 <= 3 is (1, 1) with z = 1; with -3 <= x1 + x2 <= -2, (-1, -1) with z = -1."""
    for low, high, x, z in ((2.0, 3.0, 1.0, 1.0), (-3.0, -2.0, -1.0, -1.0), (-1.0, 1.0, 0.0, 0.0)):
        program = plain(np.eye(2), np.zeros(2), C=np.ones((1, 2)), low=np.array([low]), high=np.array([high]))
        found = solve_conic(program, newton=newton)
        assert found.solved and found.x == pytest.approx([x, x], abs=1e-10) and found.z == pytest.approx([z], abs=1e-9)


@pytest.mark.parametrize("newton", [True, False])
def test_equations_have_multipliers(newton: bool) -> None:
    """Least |x|^2 / 2 with the sum 1 of five: a fifth each, y = 1/5; with x1 <= 0.1, 0.9 / 4 of the others."""
    program = plain(np.eye(5), np.zeros(5), A=np.ones((1, 5)), b=[1.0])
    found = solve_conic(program, newton=newton)
    assert found.x == pytest.approx(np.full(5, 0.2), abs=1e-11) and found.y == pytest.approx([0.2], abs=1e-10)
    upper = np.array([0.1, np.inf, np.inf, np.inf, np.inf])
    found = solve_conic(replace(program, upper=upper), newton=newton)
    assert found.x == pytest.approx([0.1, *[0.225] * 4], abs=1e-11)


def test_without_curvature_the_least_is_at_a_corner() -> None:
    """x1 + 2 x2 with x1 + x2 >= 1, both >= 0: at (1, 0); a linear program wants no Newton's method."""
    program = plain(
        np.zeros((2, 2)), [1.0, 2.0], C=np.ones((1, 2)), low=np.array([1.0]), high=np.array([np.inf]), bounds=(0.0, np.inf)
    )
    found = solve_conic(program, newton=False, tolerance=1e-8)
    assert found.solved and found.x == pytest.approx([1.0, 0.0], abs=1e-8) and program.value(found.x) == pytest.approx(1.0)


def test_what_falls_without_end_is_told() -> None:
    """-x with x >= 0."""
    found = solve_conic(plain(np.zeros((1, 1)), [-1.0], bounds=(0.0, np.inf)), newton=False)
    assert found.outcome is Outcome.UNBOUNDED and not found.solved


def test_what_is_unbounded_has_a_direction(rng: np.random.Generator) -> None:
    """Drawn programs with a direction of recession in which the objective falls: UNBOUNDED, and x is such a direction."""
    told = 0
    for _ in range(40):
        program, inside = drawn(rng)
        d = inside * np.isin(np.arange(len(inside)), program.cones)
        d[program.cones[:, 2]] += 1.0
        d /= np.linalg.norm(d)
        flat = np.eye(len(d)) - np.outer(d, d)
        H, A, C = flat @ program.H @ flat, program.A @ flat, program.C @ flat
        ends = {"b": A @ inside, "low": np.minimum(program.low, C @ inside), "high": np.maximum(program.high, C @ inside)}
        found = solve_conic(replace(program, H=H, g=program.g - (program.g @ d + 1.0) * d, A=A, C=C, **ends), newton=False)
        assert not found.solved
        if found.outcome is Outcome.UNBOUNDED:
            told, x, fixed = told + 1, found.x, found.program
            assert -fixed.g @ x > 1e-3 and max(np.abs(H @ x).max(), np.abs(A @ x).max(initial=0.0)) < 1e-6
            s, beside = C @ x, np.delete(np.arange(len(x)), fixed.cones.ravel())
            for value, low, high in ((s, fixed.low, fixed.high), (x[beside], fixed.lower[beside], fixed.upper[beside])):
                assert (value[np.isfinite(low)] > -1e-6).all() and (value[np.isfinite(high)] < 1e-6).all()
            assert np.abs(x[fixed.cones] - project_cones(x[fixed.cones], fixed.mu)).max() < 1e-6
    assert told >= 36


@pytest.mark.parametrize("size", [1e8, 1e9, 1e10])
def test_what_curves_upwards_everywhere_is_not_unbounded(size: float, rng: np.random.Generator) -> None:
    """Strictly convex programs with a gradient so large: Clarabel calls a third of them unbounded, by no direction."""
    for newton in (True, False):
        for _ in range(20):
            program, _ = drawn(rng)
            found = solve_conic(replace(program, g=size * program.g), newton=newton)
            assert found.outcome is (Outcome.SOLVED if found.miss <= 1e-9 else Outcome.NOT_FOUND)


def test_a_far_minimum_is_found_by_numbers_around_one() -> None:
    """1/2 |x|^2 - 1e8 x1 over a cone of slope one: at 1e8 (1/2, 0, 1/2), which Clarabel calls unbounded as it is given."""
    for size in (1e8, 1e9, 1e12):
        found = solve_conic(plain(np.eye(3), [-size, 0.0, 0.0], cones=[0, 1, 2], mu=[1.0]), newton=False)
        assert found.outcome is not Outcome.UNBOUNDED
        assert found.x / size == pytest.approx([0.5, 0.0, 0.5], abs=1e-8)


# ---------------------------------------------------------------------------------------------------- another solver


def test_another_solver_finds_the_same_least(rng: np.random.Generator, exhaustive: bool) -> None:
    """Random programs, strictly convex ones by Newton's method first, others by the interior point: value, and feasibility."""
    methods = set()
    for i in range(1000 if exhaustive else 40):
        program, inside = drawn(rng, strict=i % 2 == 0)
        assert program.outside(inside) < 1e-12
        found = solve_conic(program, newton=i % 2 == 0)
        assert found.solved and found.miss <= 1e-9 and program.outside(found.x) < 1e-9
        methods.add(found.method)
        value = program.value(found.x)
        assert value <= program.value(inside) + 1e-9
        other = by_scs(program, eps=1e-8)
        if other.status == "solved":
            assert value == pytest.approx(other.value, rel=1e-5, abs=1e-5)
    assert methods == {"Newton", "Clarabel"}


def test_another_solver_is_met_on_most(rng: np.random.Generator) -> None:
    """The comparison above compares: SCS solves at least nine of ten."""
    assert sum(by_scs(drawn(rng)[0], eps=1e-8).status == "solved" for _ in range(20)) >= 18


def test_what_is_impossible_is_proved(rng: np.random.Generator, exhaustive: bool) -> None:
    """Programs that are impossible by construction: told so, with a proof; another solver agrees."""
    for _ in range(500 if exhaustive else 25):
        program = impossible(rng)
        found = solve_conic(program)
        assert found.outcome is Outcome.INFEASIBLE
        is_proof(program, found.certificate, rng)
        assert by_scs(program, steps=20_000).status in ("infeasible", "infeasible_inaccurate")


def test_bounds_may_contradict_equations(rng: np.random.Generator) -> None:
    """Intervals and rows are in a proof, too: 0 <= x <= 1 and sum 3 of two; x1 - x2 >= 3."""
    box = plain(np.eye(2), np.zeros(2), A=np.ones((1, 2)), b=[3.0], bounds=(0.0, 1.0))
    row = plain(
        np.eye(2), np.zeros(2), C=np.array([[1.0, -1.0]]), low=np.array([3.0]), high=np.array([np.inf]), bounds=(-1.0, 1.0)
    )
    for program in (box, row):
        found = solve_conic(program)
        assert found.outcome is Outcome.INFEASIBLE
        is_proof(program, found.certificate, rng)
    assert by_scs(box).status == by_scs(row).status == "infeasible"


@pytest.mark.parametrize("mu", [0.05, 0.7, 3.0])
def test_the_verdict_turns_within_a_millionth_of_a_limit(mu: float, rng: np.random.Generator) -> None:
    """A cone's force is given: (t mu, 0, 1) turned, with t to one millionth below and above 1; alone, and beside others."""
    for others in (0, 3):
        turn = rng.uniform(0.0, 2.0 * np.pi)
        n = 3 * (1 + others)
        mixed = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        A = np.zeros((3 + others, n))
        A[:3, :3] = mixed
        for k in range(others):
            A[3 + k, 5 + 3 * k] = 1.0
        for t, possible in ((1.0 - 1e-6, True), (1.0 + 1e-6, False), (0.5, True), (2.0, False)):
            b = np.concatenate([mixed @ [t * mu * np.cos(turn), t * mu * np.sin(turn), 1.0], np.ones(others)])
            program = plain(np.eye(n), np.zeros(n), A=A, b=b, cones=np.arange(n), mu=np.full(1 + others, mu))
            found = solve_conic(program)
            assert found.solved == possible, (t, found.outcome)
            if possible:
                assert program.outside(found.x) < 1e-9
            else:
                is_proof(program, found.certificate, rng)


# --------------------------------------------------------------------------------------------------------- degenerate


def test_without_columns_equations_hold_or_do_not() -> None:
    """No unknowns: 0 = 0 is met, 0 = 1 is not, nor is 1 <= 0."""
    nothing = plain(np.zeros((0, 0)), NONE, A=np.zeros((2, 0)), b=np.zeros(2))
    assert solve_conic(nothing).solved
    wrong = replace(nothing, b=np.array([0.0, 1.0]))
    found = solve_conic(wrong)
    assert found.outcome is Outcome.INFEASIBLE and found.certificate is not None and found.certificate.gap == 1.0
    rows = replace(nothing, C=np.zeros((1, 0)), low=np.array([1.0]), high=np.array([2.0]))
    assert solve_conic(rows).outcome is Outcome.INFEASIBLE
    assert solve_conic(replace(rows, low=np.array([-1.0]))).solved


@pytest.mark.parametrize("newton", [True, False])
def test_rows_of_zeros_and_twice_the_same_row(newton: bool, rng: np.random.Generator) -> None:
    """0 = 0 is met; what is said twice holds once; what is said twice differently is refuted."""
    program, x = drawn(rng)
    program = replace(program, A=rng.normal(size=(2, len(x))), b=np.zeros(2))
    program = replace(program, b=program.A @ x)
    expected = solve_conic(program)
    twice = replace(
        program, A=np.vstack([program.A, np.zeros(len(x)), program.A]), b=np.concatenate([program.b, [0.0], program.b])
    )
    found = solve_conic(twice, newton=newton)
    assert found.solved and found.x == pytest.approx(expected.x, abs=1e-7)
    for wrong in (np.array([0.0, 0.0, 1e-3, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, 1e-3])):
        refuted = solve_conic(replace(twice, b=twice.b + wrong), newton=newton)
        assert refuted.outcome is Outcome.INFEASIBLE
        is_proof(replace(twice, b=twice.b + wrong), refuted.certificate, rng)


def test_more_equations_than_unknowns(rng: np.random.Generator) -> None:
    """Five of three: no answer is made of rounding, whose multipliers are 1e17; where they are met, the answer is."""
    for _ in range(100):
        x = project_cones(rng.normal(size=(1, 3)) + [0.0, 0.0, 1.0], np.array([0.6]))[0]
        A, b = rng.normal(size=(5, 3)), rng.normal(size=5)
        program = plain(np.eye(3), np.zeros(3), A=A, b=b, cones=[0, 1, 2], mu=[0.6])
        found = solve_conic(program)
        assert found.outcome is Outcome.INFEASIBLE
        is_proof(program, found.certificate, rng)
        met = solve_conic(replace(program, b=A @ x))
        assert met.solved and met.x == pytest.approx(x, abs=1e-9)


@pytest.mark.parametrize("newton", [True, False])
def test_columns_that_are_fixed(newton: bool) -> None:
    """They keep their value, and what is left is decided by the others; where all are fixed, the equations are met or not."""
    one = plain(np.eye(2), np.zeros(2), A=np.ones((1, 2)), b=[1.0], bounds=([0.3, -np.inf], [0.3, np.inf]))
    found = solve_conic(one, newton=newton)
    assert found.solved and found.x == pytest.approx([0.3, 0.7], abs=1e-10)
    fixed = replace(one, lower=np.array([0.3, 0.7]), upper=np.array([0.3, 0.7]))
    assert solve_conic(fixed, newton=newton).solved
    wrong = solve_conic(replace(fixed, b=np.array([2.0])), newton=newton)
    assert wrong.outcome is Outcome.INFEASIBLE and wrong.certificate is not None and wrong.certificate.gap > 0.1


def test_without_cones_and_without_rows() -> None:
    """Bounds alone."""
    found = solve_conic(plain(np.eye(3), [-2.0, 0.5, 3.0], bounds=(-1.0, 1.0)))
    assert found.solved and found.x == pytest.approx([1.0, -0.5, -1.0], abs=1e-14)


# ------------------------------------------------------------------------------------------------------------- judges


def test_a_miss_is_noticed_in_each_part(rng: np.random.Generator) -> None:
    """Of an answer that is right a hundred-thousandth of x, y or z more is no answer; NaN is none."""
    program = plain(
        np.eye(3), [0.3, 0.0, 0.0], A=np.array([[0.0, 0.0, 1.0]]), b=[1.0], C=np.array([[0.0, 1.0, 0.0]]), low=np.array([0.2]),
        high=np.array([np.inf]), cones=[0, 1, 2], mu=[0.4],
    )  # fmt: skip
    found = solve_conic(program)
    assert found.solved and found.miss < 1e-12 and found.z[0] > 0.01
    x, y, z = found.x, found.y, found.z
    for parts in ((x + [1e-5, 0, 0], y, z), (x, y + 1e-5, z), (x, y, z + 1e-5)):
        assert program.miss(*parts) > 1e-6
    assert program.miss(x * np.nan, y, z) == program.miss(x, y * np.nan, z) == np.inf
    assert program.outside(x * np.nan) == np.inf and program.outside(x) < 1e-12
    assert program.outside(x - [0.0, 0.1, 0.0]) > 0.09


def test_what_is_no_proof_is_no_certificate(rng: np.random.Generator) -> None:
    """Zeros, the opposite sign, and multipliers of a program that can be solved."""
    program = impossible(rng)
    right = solve_conic(program).certificate
    assert right is not None and Certificate.of(program, right.y, right.z) is not None
    assert Certificate.of(program, -right.y, right.z) is None or Certificate.of(program, -right.y, right.z).reach < 100.0
    assert Certificate.of(program, 0.0 * right.y, right.z) is None
    assert Certificate.of(program, np.nan * right.y, right.z) is None
    possible, _ = drawn(rng)
    for _ in range(50):
        proof = Certificate.of(possible, rng.normal(size=len(possible.b)), rng.normal(size=len(possible.low)))
        assert proof is None or proof.reach < 1e3


def test_a_multiplier_of_a_bound_that_is_not_there_does_not_count() -> None:
    """That x >= 1 and x <= 0 is impossible, whatever rounding leaves at a row without lower bound; that row proves nothing."""
    rows = {"C": np.ones((2, 1)), "low": np.array([1.0, -np.inf]), "high": np.array([np.inf, 5.0]), "bounds": (-np.inf, 0.0)}
    program = plain(np.eye(1), [0.0], **rows)
    proof = Certificate.of(program, NONE, np.array([1.0, 1e-17]))
    assert proof is not None and proof.z.tolist() == [1.0, 0.0] and (proof.gap, proof.reach) == (1.0, np.inf)
    assert Certificate.of(program, NONE, np.array([0.0, 1.0])) is None


def test_where_both_methods_are_cut_short_nothing_is_claimed(monkeypatch: pytest.MonkeyPatch, rng) -> None:
    """Neither solved nor refuted."""
    program, _ = drawn(rng)
    monkeypatch.setattr(conic_newton, "CONIC_STEPS", 1)
    monkeypatch.setattr(conic_newton, "newton_steps", lambda *_: None)
    found = solve_conic(program)
    assert found.outcome is Outcome.NOT_FOUND and found.certificate is None


def test_multipliers_are_of_the_rows_that_hold():
    """The nearest to (3, 0) with x <= 1 is (1, 0): a parallel row that is far from its bound has none."""
    rows = np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
    program = Conic.of(
        {"x": Unknowns(2, 1.0, np.array([-3.0, 0.0]))},
        between=[({"x": rows}, np.array([-50.0, -50.0, -2.0]), np.array([1.0, 50.0, 2.0]))],
    )
    _, z = conic_newton._multipliers(program, np.array([1.0, 0.0]))
    assert z == pytest.approx([-2.0, 0.0, 0.0], abs=1e-12)
    found = solve_conic(program)
    assert found.x == pytest.approx([1.0, 0.0], abs=1e-12) and found.z == pytest.approx([-2.0, 0.0, 0.0], abs=1e-12)
