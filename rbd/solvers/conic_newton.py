"""Conic programs by Newton's method and, if it does not converge, by Clarabel: the only file that imports Clarabel.

Newton's method on the equations of `rbd.problem.conic` [Qi1993] ends at rounding from a near start; Clarabel's interior-point
method [Goulart2024] needs none, and tells when there is no x, with a certificate.

With few equations, many unknowns (a hundred contacts on one robot) and a diagonal H, equal within a cone, Newton's method on
the dual is smaller (`by_dual`): x = P_X(H^-1 (A^T y - g)) follows from one multiplier an equation, and y solves A x = b.
The left side has symmetric, positive semidefinite derivatives, so that with a line search on the dual value it ends wherever
the set has an interior. The result is exact: x is in X to rounding, and no other point with A x = b is smaller.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rbd.arrays import Array, is_finite, max_abs
from rbd.problem.conic import Certificate, Conic, ConicAnswer, Unknowns
from rbd.problem.programs import CONIC_SECONDS, CONIC_STEPS, Outcome, Work

MET = 1e-11
"""A miss up to this is rounding, of numbers around one."""
_NEAR = 1e-4  # a miss of Clarabel's from which Newton's method is tried
_REACH = 1e6  # of a certificate that is not improved
_ENOUGH = 1e3  # of a certificate
_GAP = 1e-10
_RAY = 1e-7  # of a direction: what it misses, over how steeply the objective falls
_NIL = 1e-12
_INWARD = 1e-10


def solve_conic(program: Conic, *, newton: bool = True, tolerance: float = 1e-9) -> ConicAnswer:
    """The minimiser, or that there is none.

    Args:
        program: The program.
        newton: Try Newton's method first: for an objective that is strictly convex where A x = 0.
        tolerance: Largest miss of an answer that is called solved.
    """
    if not len(program.g):
        return _of_no_columns(program, tolerance)
    quick = _by_newton(program) if newton else None
    return _by_clarabel(program, tolerance) if quick is None else quick


def _of_no_columns(program: Conic, tolerance: float) -> ConicAnswer:
    """Without unknowns the equations hold, or do not."""
    x = np.zeros(0)
    y, z = np.zeros(len(program.b)), np.zeros(len(program.C))
    if program.outside(x) <= tolerance:
        return ConicAnswer(program, Outcome.SOLVED, x, y, z, "Newton", 0)
    violated = np.maximum(program.low, 0.0) + np.minimum(program.high, 0.0)
    certificate = Certificate.of(program, program.b, violated)
    return ConicAnswer(program, Outcome.INFEASIBLE, x, y, z, "Newton", 0, certificate)


def _by_newton(program: Conic) -> ConicAnswer | None:
    """From the minimiser of the equations alone; None where it does not end."""
    return newton_steps(program, np.zeros(len(program.g)), np.zeros(len(program.b)), np.zeros(len(program.C)), True)


def newton_steps(program: Conic, x: Array, y: Array, z: Array, fresh: bool = False) -> ConicAnswer | None:
    """Newton's method from a point; None where it does not end at a miss of rounding.

    Args:
        program: The program.
        x: Shape (n,).
        y: Multipliers of the equations, shape (e,).
        z: Of the rows between bounds, shape (q,).
        fresh: Begin at the minimiser of the equations alone.
    """
    from rbd.solvers.conic_kernel import newton  # imports Numba

    x, y, z, arrays = x.copy(), y.copy(), z.copy(), [np.ascontiguousarray(each) for each in program.arrays]
    count = newton(*arrays, fresh, x, y, z)
    return ConicAnswer(program, Outcome.SOLVED, x, y, z, "Newton", count) if count >= 0 else None


def by_dual(program: Conic, y: Array | None = None, work: Work | None = None) -> tuple[Array, Array] | None:
    """(x, y): the minimiser, shape (n,), and its multipliers, shape (e,), where H is diagonal and there are no rows C.

    None where Newton's method does not converge, or multipliers grow so large that rounding dominates: in a set without an
    interior, or an empty one; and where no work is left.

    Args:
        program: The program; entries of H are above zero, and equal within a cone.
        y: Multipliers to start from; zeros if not given.
        work: Limit of the cost; unlimited if not given.
    """
    from rbd.solvers import conic_kernel  # imports Numba

    P, cost = program, float(len(program.b) + 3) * program.A.size + 1e5
    given = [np.ascontiguousarray(each) for each in (P.A, P.b, P.H.diagonal(), P.g, P.lower, P.upper, P.cones, P.mu)]
    work = work or Work(np.inf)
    most = int(min(max(work.left, 0.0) / cost, conic_kernel.DUAL_STEPS))
    x, y = np.empty(len(P.g)), np.zeros(len(P.b)) if y is None else y.copy()
    steps = conic_kernel.by_dual(*given, most, x, y)
    work.spend(cost * (most if steps < 0 else steps))
    return None if steps < 0 else (P.project((y @ P.A - P.g) / given[2]), y)


# ------------------------------------------------------------------------------------------------------------------- Clarabel

_STATUS = {"PrimalInfeasible": Outcome.INFEASIBLE, "DualInfeasible": Outcome.UNBOUNDED}


def _by_clarabel(program: Conic, tolerance: float) -> ConicAnswer:
    """By the interior-point method, then Newton's from its point; where it does not know, a certificate is looked for."""
    found = interior_point(program)
    if found.outcome is Outcome.INFEASIBLE:
        told = Certificate.of(program, found.y, found.z)
        if told is not None and told.reach >= _REACH and told.gap > _GAP:
            return replace(found, certificate=told)
    elif found.outcome is Outcome.UNBOUNDED:
        return found
    elif (better := settled(program, found, tolerance)) is not None:
        return better
    told = _refuted(program)
    return found if told is None else replace(found, outcome=Outcome.INFEASIBLE, certificate=told)


def settled(program: Conic, found: ConicAnswer, tolerance: float) -> ConicAnswer | None:
    """The answer made exact by Newton's method, or as it is where it is good enough; None where it is no answer."""
    if not (program.H.any() or program.g.any()):  # any x will do, without multipliers
        y, z = np.zeros_like(found.y), np.zeros_like(found.z)
        return replace(found, outcome=Outcome.SOLVED, y=y, z=z) if program.outside(found.x) <= tolerance else None
    miss = program.miss(found.x, found.y, found.z)
    if miss <= _NEAR:
        for y, z in ((found.y, found.z), _multipliers(program, found.x)):
            if (better := newton_steps(program, found.x, y, z)) is not None:
                return replace(better, method=found.method, iterations=found.iterations)
    return replace(found, outcome=Outcome.SOLVED) if miss <= tolerance else None


def _multipliers(program: Conic, x: Array) -> tuple[Array, Array]:
    """Multipliers with r = 0 at all that is inside X by a little more than rounding, and z = 0 inside the rows' bounds.

    Where x is that near to the edge of X, r as found is as large as the distance, and Newton's method takes x for held.
    """
    s = program.C @ x
    inside = (x > program.lower + _INWARD) & (x < program.upper - _INWARD)
    if len(program.mu):
        cones = x[program.cones]
        far = program.mu * cones[:, 2] - np.hypot(cones[:, 0], cones[:, 1]) > _INWARD
        inside[program.cones] = far[:, None]
    held = (s <= program.low + _INWARD) | (s >= program.high - _INWARD)
    E = np.vstack([program.A, program.C[held]])[:, inside]
    found = np.linalg.lstsq(E.T, (program.H @ x + program.g)[inside], rcond=1e-12)[0]
    z = np.zeros(len(s))
    z[held] = found[len(program.b) :]
    return found[: len(program.b)], z


def _refuted(program: Conic) -> Certificate | None:
    """The certificate that no x meets the rows with the largest gap, of multipliers up to one; None where none is found."""
    row_down, row_up = np.isfinite(program.low), np.isfinite(program.high)
    down, up = np.isfinite(program.lower), np.isfinite(program.upper)
    flat, I = program.cones.ravel(), np.eye(len(program.g))
    blocks = {
        "y": Unknowns(len(program.b), 0.0, -program.b, -1.0, 1.0),
        "low": Unknowns(int(row_down.sum()), 0.0, -program.low[row_down], 0.0, 1.0),
        "high": Unknowns(int(row_up.sum()), 0.0, program.high[row_up], 0.0, 1.0),
        "lower": Unknowns(int(down.sum()), 0.0, -program.lower[down], 0.0),
        "upper": Unknowns(int(up.sum()), 0.0, program.upper[up], 0.0),
        "cones": Unknowns(len(flat), cones=np.arange(len(flat)).reshape(-1, 3), mu=1.0 / program.mu),
    }
    parts = {
        "y": program.A.T, "low": program.C[row_down].T, "high": -program.C[row_up].T, "lower": I[:, down], "upper": -I[:, up],
        "cones": I[:, flat],
    }  # fmt: skip
    inward = np.zeros(len(program.g))
    inward[down & ~up] = _INWARD
    inward[program.cones[:, 2]] = _INWARD * np.maximum(1.0, program.mu)
    for shift in (inward, np.zeros(len(inward))):  # r inside of what it must be by more than rounding, if that can be
        dual = Conic.of(blocks, [(parts, -shift)])
        found = interior_point(dual)
        found = settled(dual, found, MET) or found
        z = np.zeros(len(program.C))
        z[row_down] += found["low"]
        z[row_up] -= found["high"]
        made = Certificate.of(program, found["y"], z)
        if made is not None and made.reach >= _ENOUGH and made.gap > _GAP:
            return made
    return None


def clarabel_settings(tolerance: float) -> Any:
    """Settings of Clarabel with a tolerance of gap and rows, and the limits of `rbd.problem.programs`."""
    import clarabel

    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.max_iter, settings.time_limit = CONIC_STEPS, CONIC_SECONDS
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings


def interior_point(program: Conic) -> ConicAnswer:
    """What Clarabel says: INFEASIBLE; UNBOUNDED, x a direction, checked; else NOT_FOUND, its best point, judged by nobody."""
    import clarabel
    from scipy.sparse import csc_matrix

    e, n = program.A.shape
    q = len(program.C)
    free = program.lower < program.upper
    given = np.where(free, 0.0, program.lower)
    nothing = ConicAnswer(program, Outcome.NOT_FOUND, given, np.zeros(e), np.zeros(q), "Clarabel", 0)
    # Clarabel: minimise 1/2 x P x + q x with M x + s = h, s in a product of cones; then P x + q + M^T u = 0, u in their duals.
    I, flat = np.eye(n), program.cones.ravel()
    bounded = free.copy()
    bounded[flat] = False
    down, up = bounded & np.isfinite(program.lower), bounded & np.isfinite(program.upper)
    row_down, row_up = np.isfinite(program.low), np.isfinite(program.high)
    cones = -I[program.cones]  # (k, 3, n), tangent, tangent, normal; Clarabel has the axis first, of slope one
    cones[:, 2] *= program.mu[:, None]
    rows = [program.A, -program.C[row_down], program.C[row_up], -I[down], I[up], cones[:, [2, 0, 1]].reshape(-1, n)]
    side = [
        program.b, -program.low[row_down], program.high[row_up], -program.lower[down], program.upper[up],
        np.zeros(len(flat)),
    ]  # fmt: skip
    M = np.vstack(rows)
    h = np.concatenate(side) - M @ given
    nil = np.flatnonzero(np.abs(M[:e]).max(axis=1, initial=0.0) <= _NIL)  # rows of rounding have no answer in digits
    M[nil], h[nil] = 0.0, np.where(np.abs(h[nil]) <= _NIL, 0.0, h[nil])
    P, g = np.triu(program.H[np.ix_(free, free)]), (program.g + program.H @ given)[free]
    if not free.any() or not (is_finite(M) and is_finite(h) and is_finite(P) and is_finite(g)):
        return nothing
    sizes = [len(part) for part in side]
    kinds = [clarabel.ZeroConeT(e), clarabel.NonnegativeConeT(sum(sizes[1:5]))]
    settings = clarabel_settings(1e-11)
    settings.tol_infeas_abs = settings.tol_infeas_rel = 1e-10
    found = clarabel.DefaultSolver(
        csc_matrix(P), g, csc_matrix(M[:, free]), h, kinds + [clarabel.SecondOrderConeT(3)] * len(program.mu), settings
    ).solve()
    x, u = given.copy(), np.asarray(found.z)
    x[free] = np.asarray(found.x)
    if not (is_finite(x) and is_finite(u)):
        return nothing
    ends = np.cumsum(sizes)
    z = np.zeros(q)
    z[row_down] += u[ends[0] : ends[1]]
    z[row_up] -= u[ends[1] : ends[2]]
    outcome = _STATUS.get(str(found.status).removeprefix("Almost"), Outcome.NOT_FOUND)
    if outcome is Outcome.UNBOUNDED:
        x[~free] = 0.0
        if _falls(program, x):
            return replace(nothing, outcome=outcome, x=x / max_abs(x), iterations=int(found.iterations))
        return _of_numbers_around_one(program) or nothing
    return ConicAnswer(program, outcome, program.project(x), -u[:e], z, "Clarabel", int(found.iterations))


def _falls(program: Conic, d: Array) -> bool:
    """Whether the objective falls along d, a direction of recession: g . d < 0, H d = 0, x + t d feasible for all t > 0."""
    recedes = recession(program)
    g, H, A, C = (max_abs(part.ravel()) for part in (program.g, program.H, program.A, program.C))
    fall = _RAY * float(-program.g @ d)
    return fall > 0.0 and g * max_abs(program.H @ d) <= fall * H and g * recedes.outside(d) <= fall * max(1.0, A, C)


def recession(program: Conic) -> Conic:
    """The same, of the directions in which x may go on without end."""
    low, high, lower, upper = (
        np.where(np.isfinite(end), 0.0, end) for end in (program.low, program.high, program.lower, program.upper)
    )
    return replace(program, b=np.zeros(len(program.b)), low=low, high=high, lower=lower, upper=upper)


def _of_numbers_around_one(program: Conic) -> ConicAnswer | None:
    """The answer by the program in x / s and its objective over |g| s, for s = |g| / |H|; None where g is around one already.

    Clarabel's test of a direction has no scale: with a large g it believes that any x of that size is one.
    """
    g, H = max_abs(program.g), max_abs(program.H.ravel())
    if not g > 2.0:
        return None
    s = g / H if H > 0.0 else 1.0
    b, low, high, lower, upper = (end / s for end in (program.b, program.low, program.high, program.lower, program.upper))
    found = interior_point(
        replace(program, H=program.H * (s / g), g=program.g / g, b=b, low=low, high=high, lower=lower, upper=upper)
    )
    x = found.x if found.outcome is Outcome.UNBOUNDED else program.project(s * found.x)
    return replace(found, program=program, x=x, y=g * found.y, z=g * found.z)
