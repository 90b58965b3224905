"""The force and moment that no contact can apply, frame by frame, with the forces and torques of least effort."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.motion.contact_timeline import FloorPoints
from rbd.motion.frame_terms import FrameTerms, wrench_scale
from rbd.problem.cones import project_cones
from rbd.problem.conic import Conic, Unknowns
from rbd.solvers.cone_least_squares import ConeFits, Stage, nearest_in_cones, staged_fits
from rbd.solvers.conic_newton import solve_conic

BALANCE, STEEP = 1e8, 1e3
"""Weight of balance, and of torques beyond limits, beside that of torques within: the last stages."""
FORCES = 1e-2
"""Weight of the squares of forces over the weight of the robot beside those of torques over their limits."""
_BALANCED = 1e-6
"""Forces that have a net wrench have it to this share of the weight."""


def least_effort(
    terms: FrameTerms,
    points: FloorPoints,
    places: Array,
    touches: Array,
    A: Array,
    net: Array,
    start: Array,
    mu: float,
    limit: Array,
    bounds: tuple[Array, Array],
    axes: Array | None = None,
) -> tuple[Array, Array]:
    """(forces (n, k, 3) [N], torques (n, nu) [N m]) with a given net wrench.

    The forces are in the cones, and the torques least in the sum of squares over their limits.

    A hundredth of the squares of the forces over the weight is added, which makes them unique. Frames whose torques then
    exceed limits are solved again with these: what still exceeds them is the least excess, in its sum of squares, to a
    thousandth of a limit.

    Args:
        terms: The equations of motion.
        points: The points.
        places: Where they are, shape (n, k, 3).
        touches: Which of them touch, shape (n, k).
        A: `FrameTerms.wrench_map`, scaled.
        net: Their wrench, scaled, shape (n, 6).
        start: Forces that have it, over the weight, shape (n, k, 3).
        mu: Friction.
        limit: Torque limits at rest, shape (nu,), inf where there is none.
        bounds: Least and largest torques of each frame, shapes (n, nu). Of a motor both are finite, or both infinite.
        axes: Of the forces; see `FrameTerms.wrench_map`.
    """
    weight, motors, known = wrench_scale(terms.robot)[0], terms.robot.actuated, np.isfinite(limit)
    # Where a joint has no limit, the largest of the others, or the weight times 0.3 m.
    scale = np.where(known, limit, limit[known].max() if known.any() else 0.3 * weight)
    carried = terms.joint_map(points.joint, places, touches, motors, axes) * (weight / scale)[None, :, None, None]
    moved = np.flatnonzero(carried.any(axis=(0, 2, 3)))
    t = terms.need[:, motors] / scale
    tau, forces = t, start
    if len(moved):
        stacked, aims = np.concatenate([A, carried[:, moved]], axis=1), np.concatenate([net, t[:, moved]], axis=1)
        bounded = np.concatenate([np.zeros(6), np.isfinite(limit[moved]).astype(float)])
        forces = _kept_if_balanced(staged_fits(stacked, aims, mu, _stages(bounded, len(moved)), exact=6), start)
        tau = t - _carried(carried, forces)
        middle, half = _middles(bounds, scale)
        over = np.flatnonzero((np.abs(tau - middle) > half)[:, known].any(axis=1))
        if len(over):
            # Limits that differ by direction: seen from their middle they are -1 and 1 again.
            m, s = middle[over], half[over]
            stacked, aims = stacked[over], aims[over]
            stacked[:, 6:] /= s[:, moved, None, None]
            aims[:, 6:] = (aims[:, 6:] - m[:, moved]) / s[:, moved]
            again = staged_fits(stacked, aims, mu, _stages(bounded, len(moved), limits=True), exact=6)
            found = _kept_if_balanced(again, forces[over])
            for i in np.flatnonzero(np.abs(again.left[:, :6]).max(axis=1) > _BALANCED):
                found[i] = _one_frame(stacked[i], aims[i], bounded, mu, found[i])
            forces[over] = _with_less_excess(carried[over], t[over] - m, s, found, forces[over], start[over])
            tau[over] = t[over] - _carried(carried[over], forces[over])
    return forces * weight, tau * scale


def _middles(bounds: tuple[Array, Array], scale: Array) -> tuple[Array, Array]:
    """(middle, half the width) of torque limits over their scale, shapes (n, nu); 0 and 1 of a motor without limits."""
    known = np.isfinite(bounds[0]) & np.isfinite(bounds[1])
    least, most = (np.where(known, each / scale, end) for each, end in zip(bounds, (-1.0, 1.0), strict=True))
    return 0.5 * (least + most), 0.5 * (most - least)


def _kept_if_balanced(found: ConeFits, other: Array) -> Array:
    """The forces found where they have the net wrench, else others that have it.

    On the edge of what friction allows, where a wrench is missing, forces may have no freedom left, and Newton's method no end.
    """
    good = np.abs(found.left[:, :6]).max(axis=1) <= _BALANCED
    return np.where(good[:, None, None], found.w, other)


def _one_frame(stacked: Array, aim: Array, bounded: Array, mu: float, other: Array) -> Array:
    """The forces of least excess and effort of one frame, as a conic program; others where it finds none, shape (k, 3)."""
    touching = np.flatnonzero(stacked[:6].any(axis=(0, 2)))
    if not len(touching) or mu <= 0.0:
        return other
    flat = stacked[:, touching].reshape(len(stacked), -1)
    A, T, t = flat[:6], flat[6:], aim[6:]
    limited = np.flatnonzero(bounded[6:])
    n, I = flat.shape[1], np.eye(len(limited))
    squares, cones = (T.T @ T + FORCES * np.eye(n)) / STEEP, np.arange(n).reshape(-1, 3)
    program = Conic.of(
        {
            "forces": Unknowns(n, squares, -T.T @ t / STEEP, cones=cones, mu=np.full(len(touching), mu)),
            "excess": Unknowns(len(limited), 1.0, lower=0.0),
        },
        [({"forces": A}, A @ other[touching].ravel())],
        [
            ({"forces": T[limited], "excess": -I}, -np.inf, t[limited] + 1.0),
            ({"forces": T[limited], "excess": I}, t[limited] - 1.0, np.inf),
        ],
    )
    found = solve_conic(program, newton=False, tolerance=1e-6)
    if not found.solved:
        return other
    out = np.zeros_like(other)
    out[touching] = project_cones(found["forces"].reshape(-1, 3), mu)
    return out


def _with_less_excess(carried: Array, t: Array, half: Array, *choices: Array) -> Array:
    """Of several forces, frame by frame, those with the least sum of squares of torques beyond limits, -half and half."""
    over = [np.square(np.maximum(np.abs(t - _carried(carried, w)) - half, 0.0)).sum(axis=1) for w in choices]
    best = np.argmin(over, axis=0)
    return np.asarray(np.stack(choices)[best, np.arange(len(t))])


def _carried(T: Array, forces: Array) -> Array:
    return np.matmul(T.reshape(*T.shape[:2], -1), forces.reshape(len(forces), -1, 1))[..., 0]


def _stages(bounded: Array, m: int, *, limits: bool = False) -> list[Stage]:
    """From equal weights to those wanted."""
    row = [(1.0, 1e2, 0.0), (10.0, 1e3, 0.0), (1.0 / FORCES, 1e4, 0.0)]
    row += (
        [(1.0 / FORCES, 1e4, 1.0), (1.0 / FORCES, 1e5, 10.0), (1.0 / FORCES, 1e6, 1e2), (1.0 / FORCES, 1e6, STEEP)]
        if limits
        else []
    )
    row += [(1.0 / FORCES, BALANCE, STEEP if limits else 0.0)]
    return [Stage(sigma, np.concatenate([np.full(6, w), np.ones(m)]), steep * bounded) for sigma, w, steep in row]


def nearest_acceleration(
    terms: FrameTerms, a: Array, places: Array, touches: Array, mu: float, axes: Array | None = None
) -> Array:
    """The possible accelerations nearest in the inertia metric, torque limits and rest of contacts aside, shape (n, nv).

        minimise |a' - a|_M   subject to   M a' + h = S^T tau + J^T f,  f in the cones

    The joints then accelerate as wanted, and the base otherwise: a' - a = -M_bb^-1 x on the base, with x the missing
    force on it, least in the metric of M_bb^-1.
    """
    robot = terms.robot
    weight = wrench_scale(robot)[0]
    M = terms.M_base[:, :, :6]
    L = np.linalg.cholesky(M)
    root = float(np.sqrt(robot.mass))
    n, _, k, _ = (A := terms.wrench_map(places, touches, axes)).shape
    columns = A.transpose(0, 2, 3, 1).reshape(-1, 6)
    rows = _repeated_rows(terms, columns, 3 * k).reshape(n, 3 * k, 6).transpose(0, 2, 1)
    scaled = np.linalg.solve(L, rows) * root
    need = np.linalg.solve(L, terms.need[:, :6, None])[..., 0] * (root / weight)
    left = nearest_in_cones(scaled.reshape(n, 6, k, 3), need, mu).left
    x = np.matmul(L, left[..., None]) * (weight / root)
    out = a.copy()
    out[:, :6] -= np.linalg.solve(M, x)[..., 0]
    return out


def _repeated_rows(terms: FrameTerms, wrenches: Array, times: int) -> Array:
    """Wrenches about the centre of mass as generalised forces on the base, `times` of each frame."""
    R, arm = np.repeat(terms.R, times, axis=0), np.repeat(terms.base - terms.com, times, axis=0)
    F = wrenches[:, :3]
    m = wrenches[:, 3:] - np.cross(arm, F)
    back = R.transpose(0, 2, 1)
    return np.hstack([np.matmul(back, F[:, :, None])[..., 0], np.matmul(back, m[:, :, None])[..., 0]])
