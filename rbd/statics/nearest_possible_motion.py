"""What is missing if a motion is impossible: a wrench on the base, torques beyond limits; and the nearest possible motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, blas, cross_matrix, inertia_factor, max_abs
from rbd.displayed import Displayed
from rbd.model.urdf import grouped
from rbd.problem.conic import Conic, ConicAnswer, Unknowns
from rbd.problem.programs import Outcome
from rbd.solvers.conic_newton import newton_steps, solve_conic
from rbd.statics.effort import POSSIBLE, Effort
from rbd.statics.force_balance import ForceBalance

_NEAR = 1e-6
"""What is possible is called the nearest, or the least, where it is by this, of numbers around one."""
_ANY = 1e-9
"""Weight of the square of forces beside what is made least: it picks one set of forces among many."""


@dataclass(frozen=True, eq=False)
class Missing(Displayed):
    """The least help that would let contact forces balance a motion, torque limits aside.

    It is the least of `sqrt(sum over bases of |F|^2 + |m|^2 / L^2 + sum over passive joints of (torque / L)^2)`; of a joint
    that slides its force counts as it is.

    Attributes:
        wrenches: {base joint: force and moment about the robot's centre of mass, world axes, shape (6,)} [N, N m].
        torques: {passive joint: its torques} [N, N m].
        length: L [m]: the root mean square distance of the robot's mass from its centre of mass.
        size: What was made least [N].

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> corner = rbd.PointContact("corner", "box", friction=0.5, on=rbd.Ground(normal=(0.6, 0.0, 0.8)))
        >>> try:
        ...     rbd.hold(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [corner])
        ... except rbd.CannotHold as error:
        ...     print(error.missing.force.round(2), f"{error.missing.size:.2f} N")
        [-17.27   0.     3.14] 17.55 N
    """

    wrenches: dict[str, Array]
    torques: dict[str, Array]
    length: float
    size: float

    @property
    def wrench(self) -> Array:
        """On the base: of several, the one with the largest; zero without one, shape (6,)."""
        return max(self.wrenches.values(), key=lambda w: float(np.linalg.norm(w)), default=np.zeros(6))

    @property
    def force(self) -> Array:
        """Its force, shape (3,) [N], world axes."""
        return self.wrench[:3]

    @property
    def moment(self) -> Array:
        """Its moment about the centre of mass, shape (3,) [N m], world axes."""
        return self.wrench[3:]

    def __str__(self) -> str:
        told = []
        for name, w in self.wrenches.items():
            digits = 2 - min(0, math.floor(math.log10(max(max_abs(w), 1e-9))))
            F, m = np.round(w[:3], digits) + 0.0, np.round(w[3:], digits) + 0.0
            of = "the base" if len(self.wrenches) == 1 else f"{name!r}"
            told.append(
                f"{of} misses ({F[0]:.4g}, {F[1]:.4g}, {F[2]:.4g}) N and ({m[0]:.4g}, {m[1]:.4g}, {m[2]:.4g}) N m about the "
                "centre of mass"
            )
        told += [f"{name!r} misses {max_abs(x):.4g} N m" for name, x in self.torques.items() if max_abs(x) > 1e-6]
        return ", ".join(told) + f" (least of |F|^2 + |m|^2 / L^2, L = {self.length:.3g} m)"


def missing(loads: ForceBalance, effort: Effort) -> Missing | None:
    """What is missing, zero where nothing is; None where it was not found."""
    state = loads.state
    robot, unit = state.robot, loads.unit
    L = _length(loads)
    columns, names, passive = [np.zeros((robot.nv, 0))], list[str](), list[tuple[str, int]]()
    for joint, where in loads.idle_joints:
        if joint.id in robot.bases:
            X = state.base_pose(joint.id)
            R, arm = X.rotation, state.com - X.translation
            per_wrench = np.zeros((robot.nv, 6))
            at = joint.v.start
            per_wrench[at : at + 3, :3] = R.T  # the point at the centre of mass moves at R (v + w x arm)
            per_wrench[at + 3 : at + 6, :3] = R.T @ cross_matrix(arm)
            per_wrench[at + 3 : at + 6, 3:] = R.T * L
            columns.append(per_wrench * unit)
            names.append(joint.name)
        else:
            for k in where:
                column = np.zeros((robot.nv, 1))
                column[k] = unit * (L if joint.kind.startswith(("R", "S")) else 1.0)
                columns.append(column)
                passive.append((joint.name, k))
    H = np.hstack(columns)
    if not H.shape[1]:
        return Missing({}, {}, L, 0.0)
    blocks = {"forces": loads.block(_ANY), "missing": Unknowns(H.shape[1], 1.0)}
    found = solve_conic(
        Conic.of(blocks, [({"forces": loads.A, "missing": loads.columns(H)[0]}, loads.b)], [effort.rows(loads)])
    )
    if not found.solved:
        return None
    u = found["missing"] * unit
    scale = np.array([1.0, 1.0, 1.0, L, L, L])
    wrenches = {name: u[6 * i : 6 * i + 6] * scale for i, name in enumerate(names)}
    values = zip(passive, u[6 * len(names) :].tolist(), strict=True)
    torques = grouped((name, float(value * H[k_, :].max() / unit)) for (name, k_), value in values)
    return Missing(wrenches, {name: np.array(x) for name, x in torques.items()}, L, float(np.linalg.norm(u)))


def _length(loads: ForceBalance) -> float:
    """Root mean square distance of the mass from its centre [m]; 1 m unless all bodies hang from one base."""
    robot = loads.state.robot
    if len(robot.bases) != 1:
        return 1.0
    A_g, _, mass = loads.state.centroidal()
    at = robot.joints[robot.model.names[robot.bases[0]]].v.start
    R = loads.state.base_pose().rotation
    return math.sqrt(max(float(np.trace(A_g[3:, at + 3 : at + 6] @ R.T)) / (2.0 * mass), 1e-12))


class Excess(NamedTuple):
    """Torques beyond limits.

    Attributes:
        share: By how many times its limit at rest each torque exceeds what it may be, least in sum, shape (nu,).
        tau: These torques, of motors with a limit, shape (nu,) [N, N m].
    """

    share: Array
    tau: Array


def excess(loads: ForceBalance, effort: Effort) -> Excess | None:
    """The least excess of torques over their limits; None where no forces balance."""
    limited, (rows, low, high) = np.flatnonzero(loads.limited), loads.torque_rows
    I = np.eye(len(limited))
    program = Conic.of(
        {"forces": loads.block(_ANY), "excess": Unknowns(len(limited), linear=1.0, lower=0.0)},
        [({"forces": loads.A}, loads.b)],
        [
            effort.rows(loads),
            (rows | {"excess": I}, low, math.inf),
            (rows | {"excess": -I}, -math.inf, high),
        ],
    )
    found = solve_conic(program, newton=False, tolerance=1e-8)
    if not (found.solved or _is_near(found)):
        return None
    out, tau = np.zeros(len(loads.limited)), np.zeros(len(loads.limited))
    out[limited] = found["excess"]
    tau[limited] = (loads.t - loads.T @ found["forces"])[limited] * loads.limit[limited]
    return Excess(out, tau)


def _is_near(found: ConicAnswer) -> bool:
    """Whether an answer is possible, and the least to six digits: enough for what is told of it."""
    return found.outcome is Outcome.NOT_FOUND and found.program.outside(found.x) <= POSSIBLE and found.miss <= _NEAR


def nearest_possible(
    loads: ForceBalance, a: Array, rhs: Array, still: Array, offset: Array, effort: Effort,
    before: list[ConicAnswer] | None = None,
) -> tuple[Array, Array] | Outcome:  # fmt: skip
    """(a, weights [N]) of the reachable acceleration nearest in the inertia metric, all contacts as they are; or why none.

        minimise 1/2 |a' - a|_M^2  subject to  M a' = S^T tau + rhs + J^T G w,  H^T J a' + offset = 0,  |tau| <= limit

    Args:
        loads: Of the contacts that keep as they are: their `need` is not looked at.
        a: The wanted acceleration, shape (nv,).
        rhs: tau_ext - h, shape (nv,).
        still: Columns of accelerations that stay zero, H^T J, shape (s, nv).
        offset: Their part at rest, shape (s,).
        effort: What the forces must keep to.
        before: The last answer of a similar motion, from which Newton's method starts; this one takes its place.
    """
    robot, unit = loads.state.robot, loads.unit
    M = loads.state.M
    factor = inertia_factor(M)
    size = math.sqrt(max(robot.mass, 1e-12)) * max(unit / max(robot.mass, 1e-12), 1.0)
    # a' = a + L^-T s size: then 1/2 |a' - a|_M^2 = 1/2 size^2 |s|^2.
    back = blas.dtrsm(size, factor, np.eye(robot.nv), lower=1, trans_a=1)
    Ma, Mb = M @ a - rhs, M @ back
    per_weight, un, mo = loads.per_weight * unit, robot.unactuated, robot.actuated[loads.limited]
    (least, most), limit = loads.bounds, loads.limit[loads.limited]
    d = Ma[mo] / limit  # of torques over limits, at a
    program = Conic.of(
        {"motion": Unknowns(robot.nv, 1.0), "forces": loads.block(_ANY)},
        [({"motion": Mb[un], "forces": -per_weight[un]}, -Ma[un]), ({"motion": still @ back}, -(still @ a + offset))],
        [
            effort.rows(loads),
            (
                {"motion": Mb[mo] / limit[:, None], "forces": -per_weight[mo] / limit[:, None]},
                least[loads.limited] - d, most[loads.limited] - d,
            ),
        ],
    )  # fmt: skip
    top = np.maximum(np.abs(program.A).max(axis=1, initial=0.0), 1e-300)
    live = top > 1e-12
    program = replace(program, A=program.A[live] / top[live, None], b=program.b[live] / top[live])
    found, last = None, before[-1] if before else None
    if last is not None and last.program.A.shape == program.A.shape and last.program.C.shape == program.C.shape:
        found = newton_steps(program, last.x, last.y, last.z)
    if found is None:
        found = solve_conic(program, newton=False, tolerance=1e-8)
    if not (found.solved or _is_near(found)):
        return found.outcome
    if before is not None:
        before[:] = [found]
    return a + back @ found["motion"], found["forces"] * unit
