"""A step of whole-body control once more: nothing eliminated, solved by Clarabel, polished on its active set.

Unknowns are the accelerations, the torques, the forces at the contacts' corners (or the rows of constraints that hold), and
the weights of the rays whose sums these forces are. Dynamics and contacts come from Pinocchio's own calls where a contact has
corners, the rays from their angles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import clarabel
import numpy as np
import pinocchio as pin
from scipy import sparse

import rbd
from rbd.constraints import SurfaceContact
from rbd.constraints.constraint import Constraint

Array = np.ndarray
RAY_COST, ACCELERATION_COST, G = 1e-2, 1e-4, 9.81


def corner_maps(state: rbd.State, contact: Constraint) -> list[tuple[Array, Array]]:
    """(J, R) of each corner of a contact: the point's Jacobian and the contact's axes, both in world axes."""
    rows = contact.rows(state)
    assert rows.patch is not None
    robot, data = state.robot, state.robot.model.createData()
    pin.computeJointJacobians(robot.model, data, state.q)
    pin.updateFramePlacements(robot.model, data)
    frame = robot.model.getFrameId(contact.frame)
    J = pin.getFrameJacobian(robot.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    origin = data.oMf[frame].translation
    return [(J[:3] - pin.skew(p - origin) @ J[3:], rows.patch.axes) for p in rows.patch.corners_W]


def rays(mu: float, facets: int = 4) -> Array:
    """Edges of the pyramid inside a friction cone, in contact axes, shape (3, facets): the first at half a facet's angle."""
    angle = (2.0 * np.arange(facets) + 1.0) * math.pi / facets
    return np.vstack([mu * np.cos(angle), mu * np.sin(angle), np.ones(facets)])


def dense_step(
    state: rbd.State,
    tasks: Sequence[object],
    contacts: Sequence[Constraint],
    *,
    share: float = 1.0,
    damping: float = 50.0,
    normal_force: Mapping[str, tuple[float, float]] | None = None,
    bounds: tuple[Array, Array] | None = None,
) -> tuple[Array, Array, float]:
    """(a, tau, worst violation of the optimality conditions)."""
    robot, nv, nu = state.robot, state.robot.nv, state.robot.nu
    model, data = robot.model, robot.model.createData()
    M = pin.crba(model, data, state.q)
    M = np.triu(M) + np.triu(M, 1).T
    h = pin.nonLinearEffects(model, data, state.q, state.v)
    unit = robot.mass * G
    push, weight, held, right = [], [], [], []  # J^T per force unknown; rays; rows of contacts
    for contact in contacts:
        rows = contact.rows(state)
        held.append(rows.J)
        right.append(-rows.bias - damping * rows.velocity)
        if isinstance(contact, SurfaceContact | rbd.PointContact) and contact.friction is not None:
            edges = rays(contact.friction)
            for J, R in corner_maps(state, contact):
                push.append(J.T)
                weight.append(R @ edges)
        else:
            push.append(rows.J.T)
            weight.append(np.eye(len(rows)))
    J = np.concatenate([np.zeros((0, nv)), *held])
    c = np.concatenate([np.zeros(0), *right])
    P = np.concatenate([np.zeros((nv, 0)), *push], axis=1)
    m = P.shape[1]
    R = np.zeros((m, sum(w.shape[1] for w in weight)))
    at = [0, 0]
    lower = np.full(R.shape[1], -np.inf)
    columns: dict[str, list[tuple[slice, Array]]] = {}
    k = 0
    for contact in contacts:
        friction = getattr(contact, "friction", None)
        for _ in range(len(corner_maps(state, contact)) if friction is not None else 1):
            w = weight[k]
            R[at[0] : at[0] + w.shape[0], at[1] : at[1] + w.shape[1]] = w
            own = slice(at[1], at[1] + w.shape[1])
            if friction is not None:
                lower[own] = 0.0
                columns.setdefault(contact.name, []).append((own, np.ones(w.shape[1])))
            at = [at[0] + w.shape[0], at[1] + w.shape[1]]
            k += 1
    p = R.shape[1]
    n = nv + nu + m + p  # a, tau over the unit, f over the unit, w over the unit
    H, g = np.zeros((n, n)), np.zeros(n)
    H[:nv, :nv] = ACCELERATION_COST * np.eye(nv)
    H[n - p :, n - p :] = RAY_COST * np.eye(p)
    for task in tasks:
        terms = task.terms(state, 0.0)  # type: ignore[attr-defined]
        H[:nv, :nv] += terms.A.T @ np.diag(terms.cost) @ terms.A
        g[:nv] -= terms.A.T @ (terms.cost * terms.wanted)
    A = np.zeros((nv + m + len(c), n))
    A[:nv] = np.concatenate([M / unit, -robot.actuation.T, -P, np.zeros((nv, p))], axis=1)
    A[nv : nv + m, nv + nu :] = np.concatenate([np.eye(m), -R], axis=1)
    A[nv + m :, :nv] = J
    b = np.concatenate([-h / unit, np.zeros(m), c])
    limit = share * robot.effort_limit / unit
    C, low, high = [np.eye(nu, n, nv), np.eye(p, n, n - p)], [-limit, lower], [limit, np.full(p, np.inf)]
    for name, (least, most) in (normal_force or {}).items():
        row = np.zeros((1, n))
        for own, ones in columns[name]:
            row[0, n - p + own.start : n - p + own.stop] = ones
        C.append(row)
        low.append(np.array([least / unit]))
        high.append(np.array([most / unit]))
    if bounds is not None:
        C.append(np.eye(nv, n))
        low.append(bounds[0])
        high.append(bounds[1])
    x, miss = solved(H, g, A, b, np.concatenate(C), np.concatenate(low), np.concatenate(high))
    return x[:nv], x[nv : nv + nu] * unit, miss


def solved(H: Array, g: Array, A: Array, b: Array, C: Array, low: Array, high: Array) -> tuple[Array, float]:
    """The minimiser by Clarabel, then on its active set; and the worst violation of the optimality conditions."""
    up, down = np.isfinite(high), np.isfinite(low)
    rows = np.concatenate([A, C[up], -C[down]])
    sides = np.concatenate([b, high[up], -low[down]])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    settings.max_iter = 200
    cones = [clarabel.ZeroConeT(len(A)), clarabel.NonnegativeConeT(len(sides) - len(A))]
    found = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(H)), g, sparse.csc_matrix(rows), sides, cones, settings).solve()
    z, s = np.array(found.z)[len(A) :], np.array(found.s)[len(A) :]
    active = z > s
    for _ in range(20):
        B, c = np.concatenate([A, rows[len(A) :][active]]), np.concatenate([b, sides[len(A) :][active]])
        K = np.block([[H, B.T], [B, np.zeros((len(B), len(B)))]])
        right = np.concatenate([-g, c])
        both = np.linalg.lstsq(K, right, rcond=1e-14)[0]
        both += np.linalg.lstsq(K, right - K @ both, rcond=1e-14)[0]
        x, y = both[: len(g)], both[len(g) :]
        room = sides[len(A) :] - rows[len(A) :] @ x
        pull = np.zeros(len(active))
        pull[active] = y[len(A) :]
        wrong = (room < -1e-12) & ~active | (pull < -1e-10) & active
        if not wrong.any():
            break
        active ^= wrong
    gradient = H @ x + g + B.T @ y
    size = max(1.0, float(np.abs(g).max()))
    miss = max(
        float(np.abs(gradient).max()) / size,
        float(np.abs(A @ x - b).max()),
        -float(room.min(initial=0.0)),
        -float(pull.min(initial=0.0)) / size,
    )
    return x, miss
