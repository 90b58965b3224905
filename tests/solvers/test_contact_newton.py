"""Newton's methods in loops: against the law itself, steps in NumPy, other methods, and the same functions not compiled."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import threading
from typing import NamedTuple

import numpy as np
import pytest

from rbd.answers.prepared.constraint_columns import spread_out
from rbd.problem.cones import Bounds, Free, FrictionCone, NonNegative, Product
from rbd.problem.force_set import at_rest
from rbd.solvers.law_kernel import forces
from rbd.solvers.newton import FOUND, Scaled, _gap, _matrix, family_limit, scaled, steps_from
from rbd.solvers.newton_kernel import Problem

MIXED = Product([FrictionCone(0.5), Free(1), Bounds([-1.0, -np.inf, 0.3], [2.0, 1.0, 0.3]), NonNegative(2), FrictionCone(1.2)])
"""Every kind of part."""
CORNERS = np.array([[0.1, 0.06], [0.1, -0.06], [-0.1, 0.06], [-0.1, -0.06]])


class ContactForces(NamedTuple):
    """Forces of the points of bodies: weights (3 k,), their forces on the rows, and what `law_kernel.forces` says."""

    weights: np.ndarray
    wrench: np.ndarray
    merit: float
    steps: int
    open: bool


class ContactNewton:
    """`law_kernel.forces` for one set of points: P, shape (nw, 3 k), maps their forces onto the bodies' rows, six each."""

    def __init__(self, P: np.ndarray, mu: np.ndarray) -> None:
        self.P, self.mu, (nw, n) = np.array(P, float), np.array(mu, float), P.shape
        k, self.d = n // 3, min(6, nw)
        blocks = [P[:, 3 * i : 3 * i + 3].any(axis=1).nonzero()[0] for i in range(k)]
        self.first = np.array([self.d * (int(rows[0]) // self.d) for rows in blocks])
        self.columns = np.array([self.P[self.first[j // 3] : self.first[j // 3] + self.d, j] for j in range(n)])
        self.seeds = np.arange(k)
        if k > 12:
            places = self.columns.reshape(k, -1)
            bodies = [(self.first == row).nonzero()[0] for row in np.unique(self.first)]
            self.seeds = np.concatenate([here[spread_out(places[here], 4)] for here in bodies])
        some = (3 * self.seeds[:, None] + np.arange(3)).ravel()
        self.share = np.zeros((n, n))
        self.share[some] = np.eye(n) if k <= 12 else np.linalg.pinv(self.P[:, some]) @ self.P

    def forces(self, D: np.ndarray, c: np.ndarray, start: np.ndarray, *, coulomb: bool) -> ContactForces:
        """Weights that obey the law."""
        n, none = len(self.columns), np.empty(0)
        columns, width, out = self.columns.copy(), np.full(len(self.mu), self.d), np.empty(n)
        first, mu = self.first.copy(), self.mu.copy()
        problem = Problem(D.copy(), c.copy(), columns, columns, np.zeros(n), first, width, none, none.copy(), mu)
        found = forces(
            problem, self.share @ start if len(self.seeds) < len(mu) else start.copy(), coulomb, self.seeds.copy(), out
        )
        return ContactForces(out, self.P @ out, *found)


def contact_forces(
    D: np.ndarray, c: np.ndarray, P: np.ndarray, mu: np.ndarray, start: np.ndarray, *, coulomb: bool
) -> ContactForces:
    """`ContactNewton.forces`, for one call."""
    return ContactNewton(P, mu).forces(D, c, start, coulomb=coulomb)


def ring(n: int) -> np.ndarray:
    """Points on an oval sole."""
    turn = 2 * np.pi * (np.arange(n) + 0.5) / n
    return np.column_stack([0.11 * np.cos(turn), 0.06 * np.sin(turn)])


def soles(*patches: np.ndarray) -> np.ndarray:
    """P of so many bodies, each with points at (x, y) of its own plane."""
    blocks = []
    for points in patches:
        # moment r x f of a force at r = (x, y, 0)
        arms = [np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]]) for x, y in points]
        blocks.append(np.hstack([np.vstack([np.eye(3), arm]) for arm in arms]))
    P = np.zeros((6 * len(blocks), sum(block.shape[1] for block in blocks)))
    at = 0
    for i, block in enumerate(blocks):
        P[6 * i : 6 * i + 6, at : at + block.shape[1]] = block
        at += block.shape[1]
    return P


def drawn(rng, P: np.ndarray, *, push: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(D, c, start) of two bodies of some mass and inertia, coupled, pressed on the ground and pushed about."""
    nw = len(P)
    A = rng.normal(size=(nw, nw)) * np.tile([0.1, 0.1, 0.1, 0.4, 0.4, 0.4], nw // 6)[:, None]
    D = A @ A.T + np.diag(np.tile([0.05, 0.05, 0.05, 1.0, 1.0, 1.0], nw // 6))
    wrench = np.tile([0.0, 0.0, 300.0, 0.0, 0.0, 0.0], nw // 6)
    wrench += push * rng.normal(size=nw) * np.tile([150.0, 150.0, 150.0, 15.0, 15.0, 10.0], nw // 6)
    return D, -D @ wrench, np.linalg.pinv(P) @ wrench


def law_missed(D, c, P, mu, found: ContactForces, *, coulomb: bool) -> float:
    """How far forces are from their law, scaled: written down from the law itself, point by point."""
    w, s = found.weights.reshape(-1, 3), D @ (P @ found.weights) + c
    y = (P.T @ s).reshape(-1, 3)
    size, speed = max(1.0, np.abs(w).max()), max(1.0, np.abs(c).max())
    along = mu * np.hypot(y[:, 0], y[:, 1])
    least = y[:, 2] if coulomb else y[:, 2] - along
    work = (w * y).sum(axis=1) + (along * w[:, 2] if coulomb else 0.0)
    outside = np.maximum(np.hypot(w[:, 0], w[:, 1]) - mu * w[:, 2], -w[:, 2]).max()
    assert np.abs(P @ found.weights - found.wrench).max() <= 1e-12 * size
    normal = np.abs(w[:, 2] * y[:, 2]).max() if coulomb else 0.0
    return max(outside / size, -least.min() / speed, np.abs(work).max() / (size * speed), normal / (size * speed))


def plain_steps(S: Scaled, w: np.ndarray, *, coulomb: bool, iterations: int, proximal: float) -> tuple[np.ndarray, float]:
    """(weights, merit) after `iterations` damped Newton steps in NumPy: what the compiled steps must give."""
    gap, p, edges = _gap(S, w, S.D @ w + S.q, coulomb)
    best, least = w, np.abs(gap).max()
    for _ in range(iterations):
        move = np.linalg.solve(_matrix(S, S.D + (proximal - 1.0) * np.eye(len(w)), p, edges, coulomb), gap)
        before, t = gap @ gap, 1.0
        for _ in range(7):
            new = w + t * move
            gap, p, edges = _gap(S, new, S.D @ new + S.q, coulomb)
            if gap @ gap <= before * (1.0 - 1e-4 * t):
                break
            t *= 0.5
        w = new
        if np.abs(gap).max() < least:
            best, least = w, np.abs(gap).max()
    return best, least


@pytest.mark.parametrize("coulomb", [False, True])
def test_steps_are_those_of_numpys_matrices(coulomb, rng):
    """Also with a nonsymmetric D, a proximal term and few iterations: the iterates themselves agree; the start is kept."""
    T = at_rest(MIXED)
    for iterations in (0, 1, 2, 3):
        for _ in range(10):
            D = np.eye(T.size) + 0.2 * rng.normal(size=(T.size, T.size))
            S = scaled(D, rng.normal(size=T.size), T)
            w0, settings = rng.normal(size=T.size), {"coulomb": coulomb, "iterations": iterations, "proximal": 1e-3}
            kept = w0.copy()
            found, (w, merit) = steps_from(S, w0, **settings), plain_steps(S, w0, **settings)
            assert np.array_equal(w0, kept)
            assert found[2] <= iterations and abs(found[1] - merit) < 1e-11 and np.abs(found[0] - w).max() < 1e-10


@pytest.mark.parametrize("coulomb", [False, True])
def test_a_hundred_points_are_solved_by_lapack(coulomb, rng):
    """Three hundred weights: the law holds to 1e-9, and a singular matrix ends the steps."""
    T = at_rest(Product([FrictionCone(0.6)] * 100))
    A = rng.normal(size=(300, 300)) / 10.0
    S = scaled(A @ A.T + 0.1 * np.eye(300), A @ rng.normal(size=300), T)
    w, merit, _ = steps_from(S, np.zeros(300), coulomb=coulomb)
    y = S.D @ w + S.q
    assert merit < FOUND and np.abs(_gap(S, w, y, coulomb)[0]).max() < FOUND
    still = scaled(np.zeros((300, 300)), np.tile([0.0, 0.0, -1.0], 100), T)  # all stick, and nothing moves
    assert steps_from(still, np.zeros(300), coulomb=coulomb, proximal=0.0)[1:] == (1.0, 0)


def test_whole_numbers_as_friction_and_bounds():
    """Frictions and bounds given as integers are numbers like others."""
    S = scaled(np.eye(4), np.array([-1.0, -1.0, 0.0, -1.0]), at_rest(Product([FrictionCone(1), Bounds([0], [2])])))
    root = np.sqrt(0.5)
    for coulomb, expected in ((True, [0.0, 0.0, 0.0, 1.0]), (False, [0.5, 0.5, root, 1.0])):  # the latter: a projection
        w, merit, _ = steps_from(S, np.zeros(4), coulomb=coulomb)
        assert merit < FOUND and np.abs(S.weights(w) - expected).max() < 1e-12


def dense(D: np.ndarray, c: np.ndarray, P: np.ndarray, mu: np.ndarray) -> tuple[Scaled, np.ndarray]:
    """(the same problem with three unknowns a point, its columns' set)."""
    T = at_rest(Product([FrictionCone(x) for x in mu]))
    return scaled(P.T @ D @ P, P.T @ c, T), T


@pytest.mark.parametrize("coulomb", [False, True])
def test_two_soles_obey_the_law(coulomb, rng):
    """And where the motion is unique, it is that of steps on the points themselves: always for the convex law."""
    P, mu = soles(CORNERS, CORNERS), np.full(8, 0.6)
    newton, other, slipped, opened, compared = ContactNewton(P, mu), 0, 0, 0, 0
    for _ in range(90):
        D, c, start = drawn(rng, P)
        found = newton.forces(D, c, start, coulomb=coulomb)
        assert found.merit < FOUND and law_missed(D, c, P, mu, found, coulomb=coulomb) < 1e-9
        opened += found.open
        slipped += np.abs(D @ found.wrench + c).max() > 1e-6
        S, T = dense(D, c, P, mu)
        w, merit, _ = steps_from(S, S.guess(T.project(start)), coulomb=coulomb)
        if not found.open and merit < FOUND:
            compared += 1
            differ = np.abs(D @ (found.wrench - P @ S.weights(w))).max() / max(1.0, np.abs(c).max())
            other += differ > 1e-9
            assert coulomb or differ < 1e-9
    assert slipped > 50 and other <= 3 and compared > 30
    assert (opened > 5) == coulomb  # a sole that slips and turns on four corners


@pytest.mark.parametrize("coulomb", [False, True])
def test_soles_with_many_points(coulomb, rng):
    """Two oval soles of 16 points, few of them taken into account at first: the law holds at all, or the merit says no."""
    P, mu = soles(ring(16), ring(16)), np.full(32, 0.6)
    newton, solved, steps = ContactNewton(P, mu), 0, []
    for _ in range(40):
        D, c, start = drawn(rng, P)
        found = newton.forces(D, c, start, coulomb=coulomb)
        steps.append(found.steps)
        if not found.merit < FOUND:
            continue
        solved += 1
        assert law_missed(D, c, P, mu, found, coulomb=coulomb) < 1e-9
    assert solved >= 36 and np.median(steps) <= 26  # about 32 where all points are taken at once, compliant ones first


def test_families_of_motions_are_those_of_the_points_themselves(rng):
    """Two soles of four corners: where singular values of Newton's matrix leave a motion, and where they leave none."""
    P, mu, told, wrong = soles(CORNERS, CORNERS), np.full(8, 0.6), [0, 0], 0
    for _ in range(90):
        D, c, start = drawn(rng, P)
        S, T = dense(D, c, P, mu)
        w, merit, _ = steps_from(S, S.guess(T.project(start)), coulomb=True)
        if not merit < FOUND:
            continue
        _, _, opened = family_limit(S, w)
        y = S.D @ w + S.q
        touching = y[2::3] < 1e-9
        pressed = w.copy()
        pressed[2::3] = np.where(touching, np.maximum(w[2::3], 1e-9), w[2::3])  # an unloaded point may become loaded
        _, p, edges = _gap(S, pressed, y, coulomb=True)
        _, s, Vt = np.linalg.svd(_matrix(S, S.D - np.eye(24), p, edges, coulomb=True))
        moves = np.abs(Vt[s < 1e-8 * s[0]] @ S.D).max(initial=0.0) > 1e-8
        told[opened] += 1
        wrong += opened != (moves and (touching & (np.hypot(y[::3], y[1::3]) > 1e-9)).any())
    assert min(told) > 15 and wrong <= 1  # 1 in 150, at the edge of a cone


def test_a_family_of_motions_gives_the_limit_of_equal_compliance(rng):
    """A box that slides and turns on four corners: its shares of the load are those of steps on the points themselves."""
    P, mu = soles(CORNERS), np.full(4, 0.3)
    D = np.diag([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    newton = ContactNewton(P, mu)
    for _ in range(10):
        wrench = np.array([100.0 + rng.random(), 20.0 * rng.random(), 100.0, 0.0, 0.0, 10.0 + 5.0 * rng.random()])
        start = np.linalg.pinv(P) @ wrench
        found = newton.forces(D, -D @ wrench, start, coulomb=True)
        assert found.open and found.merit < FOUND
        S, T = dense(D, -D @ wrench, P, mu)
        w, _, _ = family_limit(S, steps_from(S, S.guess(T.project(start)), coulomb=True)[0])
        assert np.abs(found.weights - S.weights(w)).max() < 1e-5 * 100.0
    # With three corners the shares are determined.
    P = soles(CORNERS[:3])
    found = contact_forces(D, -D @ wrench, P, mu[:3], np.zeros(9), coulomb=True)
    S, _ = dense(D, -D @ wrench, P, mu[:3])
    assert not found.open and np.abs(found.weights - S.weights(steps_from(S, np.zeros(9), coulomb=True)[0])).max() < 1e-9


def rubbing(points: np.ndarray, turn: np.ndarray, mu: float, rng) -> np.ndarray:
    """Weights of points that all press, by 1 to 50 N, and rub with all their friction against velocities `turn`, (k, 2)."""
    load = rng.uniform(1.0, 50.0, (len(points), 1))
    return np.hstack([-mu * load * turn / np.linalg.norm(turn, axis=1)[:, None], load]).ravel()


@pytest.mark.parametrize("points", [CORNERS, ring(7), ring(16)], ids=["4 points", "7 points", "16 points"])
def test_a_sole_that_slides_without_turning_moves_in_one_way(points, rng):
    """All points rub along one line: however they share the load, friction is the same, and the motion not open."""
    P, mu, D = soles(points), np.full(len(points), 0.3), np.diag([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    for _ in range(5):
        a = np.r_[rng.normal(size=2), np.zeros(4)]
        w = rubbing(points, np.tile(a[:2], (len(points), 1)), 0.3, rng)
        found = contact_forces(D, a - D @ P @ w, P, mu, w, coulomb=True)
        assert found.merit < FOUND and not found.open
        assert np.abs(found.wrench - P @ w).max() < 1e-9


@pytest.mark.parametrize("points", [CORNERS, ring(7)], ids=["4 points", "7 points"])
def test_a_sole_on_the_verge_of_turning_keeps_still(points, rng):
    """Pushed as hard as all its friction holds, a millionth of a millionth more or less: it does not move, in any share."""
    P, mu, D = soles(points), np.full(len(points), 0.3), np.diag([0.1, 0.1, 0.1, 1.0, 1.0, 1.0])
    for _ in range(6):
        arm = points - 0.2 * rng.normal(size=2)  # about some pole
        w = rubbing(points, np.column_stack([-arm[:, 1], arm[:, 0]]), 0.3, rng)
        for more in (0.0, 1e-12, -1e-12):
            c = -(1.0 + more) * (D @ P @ w)
            found = contact_forces(D, c, P, mu, w, coulomb=True)
            assert found.merit < FOUND and not found.open and np.abs(D @ found.wrench + c).max() < 1e-9


def test_a_box_pushed_on_its_points_slides_as_the_closed_form_says():
    """A point mass of 10 kg, mu = 0.6, pushed with 80 N: it slides at 2.114 m/s2 under Coulomb's law, and flies up at 0.933."""
    D, weight = np.eye(3) / 10.0, 98.1
    c = D @ np.array([80.0, 0.0, -weight])
    coulomb = contact_forces(D, c, np.eye(3), np.array([0.6]), np.zeros(3), coulomb=True)
    assert np.abs(coulomb.weights - [-0.6 * weight, 0.0, weight]).max() < 1e-9
    convex = contact_forces(D, c, np.eye(3), np.array([0.6]), np.zeros(3), coulomb=False)
    normal = (0.6 * 80.0 + weight) / (1.0 + 0.36)  # the projection of the needed force on the cone
    assert np.abs(convex.weights - [-0.6 * normal, 0.0, normal]).max() < 1e-9


@pytest.mark.parametrize("coulomb", [False, True])
@pytest.mark.parametrize(("mu", "least"), [(0.0, 10), (1e-9, 10), (1e3, 4)])
def test_extreme_friction(coulomb, mu, least, rng):
    """None, hardly any and a thousand: an answer that satisfies the law, or a merit that says it is none."""
    P, solved = soles(CORNERS, CORNERS), 0
    newton = ContactNewton(P, np.full(8, mu))
    for _ in range(10):
        D, c, start = drawn(rng, P)
        found = newton.forces(D, c, start, coulomb=coulomb)
        assert np.isfinite(found.weights).all()
        if found.merit < FOUND:
            solved += 1
            assert law_missed(D, c, P, np.full(8, mu), found, coulomb=coulomb) < 1e-7 * max(1.0, mu)
    assert solved >= least


@pytest.mark.parametrize("coulomb", [False, True])
def test_points_that_all_leave_carry_nothing(coulomb):
    """Bodies drawn upwards: zero forces, exactly; and zero for bodies that nothing moves."""
    P, mu, D = soles(CORNERS, CORNERS), np.full(8, 0.6), np.eye(12)
    up = np.tile([0.0, 0.0, 5.0, 0.0, 0.0, 0.0], 2)
    found = contact_forces(D, up, P, mu, np.ones(24), coulomb=coulomb)
    assert found.merit < FOUND and not found.weights.any() and not found.open
    found = contact_forces(D, np.zeros(12), P, mu, np.zeros(24), coulomb=coulomb)
    assert found.merit < FOUND and not found.weights.any()


@pytest.mark.parametrize("coulomb", [False, True])
def test_numbers_that_are_none_give_an_infinite_merit(coulomb, rng):
    """NaN or infinity in D or c: zero forces and an infinite merit, no exception; in the start: no harm."""
    P = soles(CORNERS, CORNERS)
    newton = ContactNewton(P, np.full(8, 0.6))
    good = drawn(rng, P)
    expected = newton.forces(*good, coulomb=coulomb)
    for which in range(3):
        for bad in (math.nan, math.inf):
            given = [x.copy() for x in good]
            given[which].flat[5] = bad
            found = newton.forces(*given, coulomb=coulomb)
            if which < 2:
                assert found.merit == math.inf and not found.weights.any() and not found.wrench.any()
            else:
                assert found.merit < FOUND
    for i in range(3):  # a start is left out as a whole
        bad, left_out = good[2].copy(), good[2].copy()
        bad[3 + i], left_out[3:6] = math.nan, 0.0
        one, other = (newton.forces(*good[:2], start, coulomb=coulomb) for start in (bad, left_out))
        assert np.array_equal(one.weights, other.weights) and one.steps == other.steps
    again = newton.forces(*good, coulomb=coulomb)
    assert np.array_equal(again.weights, expected.weights) and again[2:] == expected[2:]


def test_results_are_not_overwritten_by_the_next_call(rng):
    """Weights and wrench belong to the caller."""
    P = soles(CORNERS, CORNERS)
    newton = ContactNewton(P, np.full(8, 0.6))
    first = newton.forces(*drawn(rng, P), coulomb=True)
    kept = first.weights.copy()
    newton.forces(*drawn(rng, P), coulomb=False)
    assert np.array_equal(first.weights, kept)


def test_objects_of_several_threads_do_not_disturb_each_other(rng):
    """Four threads, each with its own object, give the bits of one."""
    P, mu = soles(CORNERS, CORNERS), np.full(8, 0.6)
    draws = [drawn(rng, P) for _ in range(20)]
    expected = [ContactNewton(P, mu).forces(*d, coulomb=True).weights for d in draws]
    wrong: list[int] = []

    def run() -> None:
        newton = ContactNewton(P, mu)
        for i, d in enumerate(draws):
            if not np.array_equal(newton.forces(*d, coulomb=True).weights, expected[i]):
                wrong.append(i)

    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def run_python(code: str, **env: str) -> dict:
    """What a new process prints, as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **env}, capture_output=True, text=True, check=True, timeout=120
    )
    return json.loads(done.stdout)


ANSWERS = """
import json, sys
import numpy as np, rbd
before = "numba" in sys.modules
from rbd.testing import reference_problems
found = []
for law in ("coulomb", "convex"):
    for reference in reference_problems():
        solver = rbd.ConeSolver(law=law)
        if solver.reason_unsupported(reference.problem) is None:
            found.append(solver.solve(reference.problem).a.tolist())
talos = rbd.load_robot("talos")
state, soles = talos.standing(), talos.feet()
for push in (0.0, 400.0):
    force = rbd.ExternalForce("torso_2_link", (0.0, push, 0.0))
    found.append(rbd.solve(state, rbd.hold(state, soles).tau, soles, external=[force]).a.tolist())
start = rbd.State(talos, state.q, 0.3 * np.ones(talos.nv))
motion = rbd.simulate(start, [rbd.CollisionContacts("floor", talos)], duration=0.004, step=0.002)
found.append(motion.q[-1].tolist())
print(json.dumps({"before": before, "after": "numba" in sys.modules, "found": found}))
"""


def test_functions_that_are_not_compiled_give_the_same_answers():
    """With RBD_COMPILED=0, and without importing Numba; `import rbd` does not import it either.

    Both laws on every reference problem, two soles that stick and that slip, and a fall with all shapes.
    """
    fast, slow = run_python(ANSWERS, RBD_COMPILED="1"), run_python(ANSWERS, RBD_COMPILED="0")
    assert (fast["before"], fast["after"]) == (False, True) and (slow["before"], slow["after"]) == (False, False)
    assert len(fast["found"]) == len(slow["found"]) > 20
    for one, other in zip(fast["found"], slow["found"], strict=True):
        assert np.abs(np.array(one) - other).max() <= 1e-9 * max(1.0, np.abs(one).max())


def test_code_that_cannot_be_kept_on_disk_is_compiled_all_the_same():
    """Where no cache can be written: Numba refuses to cache a function without a file, and it works nevertheless."""
    from rbd.kernels import compiled as compile_

    space: dict = {}
    exec(compile("def twice(x):\n    return 2.0 * x\n", "<nowhere>", "exec"), space)
    assert compile_(space["twice"])(21.0) == 42.0


def test_what_an_older_version_kept_on_disk_does_no_harm(tmp_path):
    """Of a function of records, whose module may get another name, nothing is kept: it is a part of those that call it."""
    record = "from typing import NamedTuple\nclass Pair(NamedTuple):\n    x: float\n    y: float\n"
    kernel = "from rbd.kernels import compiled\nfrom {0} import Pair\n@compiled\ndef total(p):\n    return p.x + p.y\n"
    for module in ("before", "after"):
        (tmp_path / f"{module}.py").write_text(record)
        (tmp_path / "sums.py").write_text(kernel.format(module))
        code = f"import sums, {module}, json; print(json.dumps({{'sum': sums.total({module}.Pair(1.0, 2.0))}}))"
        assert run_python(code, PYTHONPATH=os.pathsep.join([str(tmp_path), *sys.path]), NUMBA_CACHE_DIR="") == {"sum": 3.0}
        assert not list(tmp_path.glob("__pycache__/*.nbi"))
        (tmp_path / f"{module}.py").unlink()


def test_elimination_solves_and_knows_what_it_cannot():
    """With pivots; a singular matrix and one that is not finite are refused."""
    from rbd.solvers.small_systems import eliminate, independent

    rng = np.random.default_rng(4)
    A, x = rng.normal(size=(7, 7)), rng.normal(size=7)
    A[0, 0] = 0.0
    b = A @ x
    assert eliminate(A.copy(), b, 7) and np.abs(b - x).max() < 1e-12
    assert not eliminate(np.ones((3, 3)), np.ones(3), 3)
    assert not eliminate(np.full((3, 3), np.nan), np.ones(3), 3)
    rows = np.vstack([rng.normal(size=(3, 7)), np.zeros((1, 7))])
    rows[3] = rows[0] - 2.0 * rows[1]
    assert independent(rows, 4, 1e-9) == 3
    assert np.abs(rows[:3] @ rows[:3].T - np.eye(3)).max() < 1e-12
