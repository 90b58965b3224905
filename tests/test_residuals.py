"""The certificate: it vanishes on exact answers, and each residual is the size of what is wrong."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

import rbd
from rbd.answers.solution import Solution
from rbd.problem.residuals import SOLVED, USABLE, residuals_of
from rbd.problem.rows import Rows
from rbd.testing import law_residuals, reference_problems

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.EffortLimitWarning")  # noise on small motors

EQUATIONS = ("stationarity", "feasibility", "cone", "complementarity")


def _by_hand(a, f, cone=None, weights=None) -> Solution:
    """A 2 kg mass pushed with 6 N against a stop: answer as given."""
    rows = Rows("stop", np.ones((1, 1)), np.zeros(1), cone or rbd.problem.NonNegative(1))
    problem = rbd.GaussProblem(2.0 * np.ones((1, 1)), np.array([-6.0]), [rows])
    f = np.array([float(f)])
    return Solution(problem, np.array([float(a)]), f, f if weights is None else weights, "convex", "by hand", 1, 0.0)


def test_an_exact_answer_has_no_residual():
    """The stop pushes back with 6 N and nothing moves."""
    s = _by_hand(0.0, 6.0)
    assert s.residuals.worst == 0.0 and s.status == "solved"
    assert s.residuals.centroidal is None  # no floating base: nothing to compare with


@pytest.mark.parametrize(
    ("a", "f", "what", "size"),
    [
        (0.0, 5.0, "stationarity", 1.0),  # 2 * 0 + 6 - 5
        (-1.0, 4.0, "feasibility", 1.0),  # the stop is pierced with 1 m/s2
        (1.0, 8.0, "complementarity", 8.0),  # it pushes with 8 N while it opens with 1 m/s2
    ],
)
def test_each_residual_has_the_size_of_what_is_wrong(a, f, what, size):
    """In physical units, N or m/s2 or their product; `scaled` is over the terms that make it up."""
    r = _by_hand(a, f).residuals
    assert float(getattr(r, what)) == pytest.approx(size)
    terms = max(1.0, 2.0 * abs(a), 6.0, f)
    scale = {"stationarity": terms, "feasibility": max(1.0, abs(a)), "complementarity": terms * max(1.0, abs(a))}[what]
    assert getattr(r, what).scaled == pytest.approx(size / scale)
    assert what in str(r)


def test_a_pulling_stop_is_outside_its_cone():
    """A force of -2 N is 2 N from K, though it may satisfy the equation of motion."""
    s = _by_hand(-4.0, -2.0, weights=np.array([-2.0]))
    assert float(s.residuals.cone) == pytest.approx(2.0) and s.status == "failed"


def test_a_light_pull_is_not_excused_by_a_heavy_push_beside_it():
    """A stop pulls with 1e-7 N: a ten-millionth of the newton it is measured against, whatever 1000 N do at another stop.

    That one presses while it opens by 1e-13 m/s2, which passes; nothing else is wrong.
    """
    rows = [Rows(name, np.eye(2)[[i]], np.zeros(1), rbd.problem.NonNegative(1)) for i, name in enumerate(("heavy", "light"))]
    a, f = np.array([1e-13, 0.0]), np.array([1000.0, -1e-7])
    r = residuals_of(rbd.GaussProblem(np.eye(2), a - f, rows), a, f, f)
    assert r.complementarity.scaled <= SOLVED and r.stationarity == r.feasibility == 0.0
    assert float(r.cone) == pytest.approx(1e-7) and r.cone.scaled == pytest.approx(1e-7)
    for fresh in (residuals_of(rbd.GaussProblem(np.eye(2), a - f, rows), a, f, f), r):  # before its scales are known, and after
        assert not fresh.within(SOLVED) and fresh.within(1.01e-7)


def test_forces_without_weights_are_judged_by_their_cone():
    """A solver that gives no weights does not get its pulling forces certified."""
    rows = Rows("stop", np.ones((1, 1)), np.zeros(1), rbd.problem.NonNegative(1))
    problem = rbd.GaussProblem(np.ones((1, 1)), np.array([1.0]), [rows])
    pulls = Solution(problem, np.zeros(1), np.array([-1.0]), None, "convex", "by hand", 1, 0.0)
    assert pulls.status == "failed" and pulls.residuals.cone > 0.5


@pytest.mark.parametrize("what", ["a", "multipliers", "weights"])
def test_nan_is_never_solved(what):
    """An answer that is not a number fails, whichever part it is in."""
    reference = next(p for p in reference_problems() if p.name == "made up, all at once")
    s = rbd.ProxQP().solve(reference.problem)
    for i in (0, -1):
        bad = getattr(s, what).copy()
        bad[i] = np.nan
        assert replace(s, **{what: bad}).status == "failed"


def test_the_certificate_agrees_with_an_independent_one(rng):
    """On right and on spoilt answers: the worst residual is at least a sixteenth of one computed anew, row by row.

    A patch has sixteen rays, and the certificate takes the worst ray where the other code sums over rays.
    """
    for reference in reference_problems():
        if rbd.ProxQP().reason_unsupported(reference.problem):
            continue
        s = rbd.ProxQP().solve(reference.problem)
        spoilt = replace(s, a=s.a + 1e-4 * rng.normal(size=len(s.a)))
        for answer in (s, spoilt):
            own = law_residuals(reference.problem, answer, "convex")
            ours = answer.residuals.scaled
            assert max(own.values()) <= 16.0 * max(ours[what] for what in EQUATIONS) + 1e-12, reference.name
            assert own["stationarity"] == pytest.approx(ours["stationarity"], rel=1e-6, abs=1e-14)


def test_statuses_follow_the_largest_scaled_residual():
    """At most 1e-9 is solved, at most 1e-7 inaccurate, above it is no answer."""
    for error, status in ((0.0, "solved"), (0.5 * SOLVED, "solved"), (5 * SOLVED, "inaccurate"), (5 * USABLE, "failed")):
        s = _by_hand(0.0, 6.0 * (1.0 + error))
        assert s.status == status and s.residuals.worst == pytest.approx(error, rel=1e-6)
    assert (SOLVED, USABLE) == (1e-9, 1e-7)


def test_the_centroidal_residual_catches_what_stationarity_cannot(talos):
    """A wrong Jacobian, used consistently, satisfies every equation but the rate of momentum."""

    class Elsewhere:
        """A sole whose J and bias are those of a point 10 cm higher than it says."""

        name = "left_sole"

        def rows(self, state):
            sole = talos.soles(None)[0]
            r = sole.rows(state)
            lifted = np.eye(6)
            lifted[:3, 3:] = np.array([[0.0, 0.1, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
            return replace(r, J=lifted @ r.J, bias=lifted @ r.bias)

    state, tau = talos.standing(), 5.0 * np.ones(talos.nu)
    right = rbd.solve(state, tau, talos.soles(None), solver=rbd.KKT())
    assert right.residuals.centroidal.scaled < 1e-12
    wrong = rbd.solve(state, tau, [Elsewhere(), talos.soles(None)[1]], solver=rbd.KKT(), check=False)
    others = {name: x for name, x in wrong.residuals.scaled.items() if name != "centroidal"}
    assert max(others.values()) < 1e-10 and wrong.residuals.centroidal.scaled > 1e-3
    assert wrong.status == "failed"


def test_the_centroidal_residual_holds_for_external_forces_and_motion(talos, rng):
    """Any state, any external forces, given either way: contact wrenches + weight + external = rate of momentum."""
    state = talos.at(talos.standing().q, 0.5 * rng.normal(size=talos.nv))
    tau = 10.0 * rng.normal(size=talos.nu)
    push = rbd.ExternalForce("torso_2_link", (30.0, -80.0, 20.0), moment=(3.0, 4.0, 5.0), offset=(0.1, 0.2, 0.3))
    for external in (push, [push, push], 20.0 * rng.normal(size=talos.nv), None):
        for contacts in (talos.soles(None), talos.soles(None)[:1], []):
            s = rbd.solve(state, tau, contacts, external=external, solver=rbd.KKT())
            assert s.residuals.centroidal.scaled < 1e-12
            assert s.status == "solved"


def test_residuals_can_be_asked_of_any_answer():
    """The function behind `Solution.residuals`, on arrays."""
    s = _by_hand(0.0, 6.0)
    r = residuals_of(s.problem, s.a, s.multipliers, s.weights)
    assert set(r.scaled) == set(EQUATIONS) and r.worst == 0.0


def test_forces_of_moving_rows_are_judged_by_the_bound_against_the_motion():
    """Without weights too, and beside a pyramid: right at the bound, 0.5 N off it, and 3 N on a stop that leaves."""
    rub = Rows("rub", np.eye(3)[:1], np.zeros(1), rbd.problem.Bounds([-2.0], [2.0]), velocity=np.array([0.3]))
    stop = Rows("stop", np.eye(3)[1:2], np.zeros(1), rbd.problem.NonNegative(1), velocity=np.array([0.3]))
    end = Rows("end", np.eye(3)[2:], np.zeros(1), rbd.problem.NonNegative(1))
    P = rbd.GaussProblem(np.eye(3), np.array([1.0, -1.0, -1.0]), [rub, stop, end])
    for f, off in (([-2.0, 0.0, 1.0], 0.0), ([-1.5, 0.0, 1.0], 0.5), ([-2.0, 3.0, 1.0], 3.0)):
        a = P.rhs + np.array(f)
        for law in ("convex", "convex, 4 facets"):
            found = residuals_of(P, a, np.array(f), None, law)
            assert found.cone == pytest.approx(off) and found.stationarity == 0.0
            assert found.feasibility == pytest.approx(0.0) and found.complementarity == pytest.approx(0.0, abs=1e-9)


def _two_bodies(sink: float, share: float, mu: float = 0.5) -> Solution:
    """1 kg flung at 1e9 m/s2 beside a milligram on the floor, which sinks; the floor carries `share` of what it should."""
    M = np.diag([1.0, 1e-6, 1e-6, 1e-6])
    J = np.eye(4)[1:]
    weight = 1e-6 * 9.81
    problem = rbd.GaussProblem(
        M, np.array([1e9, 0.0, 0.0, -weight]), [Rows("tip", J, np.zeros(3), rbd.problem.FrictionCone(mu))]
    )
    f = np.array([0.0, 0.0, share * weight])
    return Solution(problem, np.array([1e9, 0.0, 0.0, -sink]), f, f, "coulomb", "by hand", 1, 0.0)


def test_a_light_body_is_not_excused_by_a_heavy_one():
    """Sinking at 0.01 m/s2 of a floor's 9.81, and a thousandth of its weight missing: each is told in its own terms."""
    assert _two_bodies(0.0, 1.0).status == "solved"
    sinks, hangs = _two_bodies(0.01, 1.0).residuals, _two_bodies(0.0, 0.999).residuals
    assert float(sinks.feasibility) == pytest.approx(0.01) and sinks.feasibility.scaled == pytest.approx(0.01)
    assert sinks.stationarity.scaled == pytest.approx(0.01 / 9.81)  # 1e-8 N, of 9.81e-6 N
    assert hangs.stationarity == pytest.approx(9.81e-9) and hangs.stationarity.scaled == pytest.approx(1e-3)
    assert _two_bodies(0.01, 1.0).status == _two_bodies(0.0, 0.999).status == "failed"


@pytest.mark.parametrize("mu", [1e-9, 0.5, 1e6])
def test_sinking_is_seen_whatever_the_friction(mu):
    """At 1e-3 m/s2, while it is dragged sideways at 10: no coefficient divides it."""
    s = _two_bodies(1e-3, 0.0, mu)
    a = s.a + np.array([0.0, 10.0, 0.0, 0.0])
    assert replace(s, a=a).residuals.feasibility == pytest.approx(1e-3)
    assert replace(s, a=a).residuals.feasibility.scaled == pytest.approx(1e-3)


def test_residuals_cross_processes_with_their_scales():
    """Pickled after they were asked, and told the same."""
    r = _two_bodies(0.01, 1.0).residuals
    assert r.worst > 1e-3
    back = pickle.loads(pickle.dumps(r))
    assert back.scaled == r.scaled and back.values == r.values and float(back.cone) == 0.0


def test_an_answer_that_is_no_number_is_worse_than_any():
    """NaN never displaces a number, however bad; a number displaces NaN."""
    nothing, bad, good = _by_hand(np.nan, np.nan).residuals, _by_hand(1e9, 1e9).residuals, _by_hand(0.0, 6.0).residuals
    assert good.less_than(bad) and good.less_than(nothing) and bad.less_than(nothing)
    assert not (bad.less_than(good) or nothing.less_than(good) or nothing.less_than(bad) or nothing.less_than(nothing))


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_forces_that_are_no_numbers_are_blamed_on_their_constraint(bad):
    """The second of two stops, though the first is missed too; of accelerations all constraints. No name is empty."""
    rows = [
        Rows(name, np.array([line]), np.zeros(1), rbd.problem.NonNegative(1))
        for name, line in zip("xy", np.eye(2), strict=True)
    ]
    P = rbd.GaussProblem(np.eye(2), -np.ones(2), rows)
    of_force = Solution(P, np.zeros(2), np.array([0.5, bad]), np.array([0.5, bad]), "convex", "by hand", 1, 0.0)
    assert of_force.worst == "y was given no finite force" and of_force.status == "failed"
    of_motion = Solution(P, np.array([bad, 0.0]), np.ones(2), np.ones(2), "convex", "by hand", 1, 0.0)
    assert of_motion.worst == "the constraints were given no finite acceleration"
    weights = Solution(P, np.zeros(2), np.ones(2), np.array([1.0, np.nan]), "convex", "by hand", 1, 0.0)
    assert weights.worst.startswith("y ")


def test_a_bound_beyond_all_forces_leaves_the_verdict_without_a_warning():
    """Forces from 0 to 1e100 N: one row holds with 1 N, at the other a push of 1 N leads away from its bound of zero."""
    rows = [Rows("row", np.eye(2), np.zeros(2), rbd.problem.Bounds([0.0, 0.0], [1e100, 2.0]))]
    s = rbd.solve_problem(rbd.GaussProblem(np.eye(2), np.array([-1.0, 1.0]), rows))
    assert s.a == pytest.approx([0.0, 1.0], abs=1e-12) and s.multipliers == pytest.approx([1.0, 0.0], abs=1e-12)
