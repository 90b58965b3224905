"""Terms of the equations of motion: M(q) a + v^T C(q) v = S^T tau + tau_g(q) + tau_ext + J^T f.

tau_ext is the force of the surroundings except constraints: a push, a load, wind. Source:
`docs/courses/least_constraint/free_motion.md`, which names the equation for each function here.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, inertia_factor, is_finite, lapack, max_abs, zeros
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External, generalised
from rbd.model.inertial import HasRows, Regressor, body_names, check_rows, inertial_parameters, regressor
from rbd.model.state import State, checked

__all__ = [
    "Regressor",
    "bias_force",
    "body_names",
    "constraint_hessian",
    "coriolis_matrix",
    "coriolis_tensor",
    "free_acceleration",
    "gravity_torque",
    "inertial_parameters",
    "inverse_dynamics",
    "kinetic_energy",
    "mass_matrix",
    "momentum",
    "potential_energy",
    "regressor",
]
"""What users call; the rest serves the package."""
_WILD = 1e7
"""Accelerations above this [m/s2, rad/s2] can come from a joint that carries no inertia."""


def mass_matrix(state: State) -> Array:
    """Joint-space inertia M(q), shape (nv, nv) [kg, kg m, kg m2]: symmetric, positive definite, rotor inertia included.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> M = rbd.dynamics.mass_matrix(solo.standing())
        >>> M.shape, M.diagonal()[:3].round(3)  # the robot's mass, for translations of its base
        ((18, 18), array([2.5, 2.5, 2.5]))
    """
    return checked(state).M.copy()


def bias_force(state: State) -> Array:
    """h(q, v) = C(q, v) v - tau_g(q), shape (nv,) [N, N m]; neither damping nor friction of the file is in it.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> rbd.dynamics.bias_force(rbd.State(box, [0, 0, 1, 0, 0, 0, 1])).round(3)  # the weight, to be carried
        array([ 0. ,  0. , 98.1,  0. ,  0. ,  0. ])
    """
    return checked(state).h.copy()


def gravity_torque(state: State) -> Array:
    """tau_g(q), shape (nv,) [N, N m]: what gravity does, on the right-hand side; a robot at rest has h = -tau_g.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> rbd.dynamics.gravity_torque(arm.at([0.0])).round(3)  # m g / 2, towards smaller angles
        array([-4.905])
    """
    robot = checked(state).robot
    return robot.pool.compute(lambda data: -pin.computeGeneralizedGravity(robot.model, data, state.q))


def coriolis_matrix(state: State) -> Array:
    """C(q, v) with C(q, v) v = h + tau_g, shape (nv, nv): the one for which Mdot - 2 C is skew (Mdot = C + C^T).

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> rbd.dynamics.coriolis_matrix(arm.at([0.0, np.pi / 2], [1.0, 2.0])).round(3)
        array([[-1. , -1.5],
               [ 0.5,  0. ]])
    """
    return _coriolis_matrices(checked(state), state.v[:, None])[0]


def coriolis_tensor(state: State) -> Array:
    """C(q), shape (nv, nv, nv), so that `v @ C @ v` is the Coriolis and centrifugal force of any v [N, N m].

    Force index first, symmetric in the two velocity indices. On a fixed base of single-axis joints these are the
    Christoffel symbols of the first kind. On a floating base v is not the derivative of coordinates and Pinocchio's C(v) w
    differs from C(w) v; the symmetric part, C_ijk = 1/2 (C(e_j) e_k + C(e_k) e_j)_i, is the one that `v @ C @ v` defines.

    Source: Wieber's form of the equations of motion, `docs/courses/least_constraint/free_motion.md`.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> v = np.array([1.0, 2.0])
        >>> C = rbd.dynamics.coriolis_tensor(arm.at([0.0, np.pi / 2]))
        >>> C.shape, (v @ C @ v).round(3)
        ((2, 2, 2), array([-4. ,  0.5]))
    """
    by_velocity = _coriolis_matrices(checked(state), np.eye(state.robot.nv))  # [j, i, k]: column k of C(e_j)
    tensor = by_velocity.transpose(1, 0, 2)
    return 0.5 * (tensor + tensor.transpose(0, 2, 1))


def _coriolis_matrices(state: State, velocities: Array) -> Array:
    model, q = state.robot.model, state.q
    columns = [np.ascontiguousarray(v) for v in velocities.T]
    return state.robot.pool.compute(lambda data: np.array([pin.computeCoriolisMatrix(model, data, q, v) for v in columns]))


def constraint_hessian(state: State, constraint: HasRows) -> Array:
    """H(q), shape (m, nv, nv), so that `v @ H @ v` is the constraint's J_dot v [m/s2, rad/s2] of any v.

    Row index first, symmetric in the two velocity indices (the reference text writes n x m x n). By the constraint's own
    `hessian(state)` where it has one, as `rbd.FunctionConstraint` has; else by polarising its bias, which is quadratic in v:
    H_jk = 1/2 (b(e_j + e_k) - b(e_j) - b(e_k)).

    Raises:
        InputError: of a contact with a ground that moves, whose bias is not quadratic in v.

    Example:
        >>> bead = rbd.testing.box(mass=2.0)
        >>> rod = rbd.FunctionConstraint("rod", lambda q: np.linalg.norm(q[:3]) - 1.0)
        >>> H = rbd.dynamics.constraint_hessian(rbd.State(bead, [1, 0, 0, 0, 0, 0, 1]), rod)
        >>> H.shape, H[0, :3, :3].round(6)  # v^2 / r across the rod
        ((1, 6, 6), array([[0., 0., 0.],
               [0., 1., 0.],
               [0., 0., 1.]]))
    """
    nv = checked(state).robot.nv
    own = getattr(check_rows(constraint), "hessian", None)
    if callable(own):
        return np.asarray(own(state))

    def bias(v: Array) -> Array:
        r = constraint.rows(state.with_velocity(v))
        if not v.any() and r.velocity.any():
            raise InputError(_moves(r.name))
        return np.asarray(r.bias)

    return polarised(bias, nv, constraint.name)


def polarised(bias: Callable[[Array], Array], nv: int, name: str) -> Array:
    """H with v @ H @ v = bias(v), shape (m, nv, nv), of a function quadratic in v.

    Raises:
        InputError: the bias is not zero at v = 0, with the name of the constraint.
    """
    if bias(np.zeros(nv)).any():
        raise InputError(_moves(name))
    unit = np.eye(nv)
    single = np.array([bias(e) for e in unit])
    H = np.zeros((single.shape[1], nv, nv))
    for j in range(nv):
        H[:, j, j] = single[j]
        for k in range(j):
            H[:, j, k] = H[:, k, j] = 0.5 * (bias(unit[j] + unit[k]) - single[j] - single[k])
    return H


def _moves(name: str) -> str:
    return f"what {name!r} touches moves, so its J_dot v is not quadratic in v: it has no Hessian."


def free_acceleration(state: State, tau: Array | None, external: External = None) -> Array:
    """a_free = M^-1 (S^T tau + tau_ext - h), shape (nv,): the motion without any constraint.

    Args:
        state: Where the robot is and how it moves.
        tau: Motor torques, shape (nu,) [N, N m]; None: zero.
        external: Generalised force (nv,), or `ExternalForce` objects and springs (`rbd.constraints.forces`).

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> rbd.dynamics.free_acceleration(solo.standing(), np.zeros(solo.nu))[:3].round(3)
        array([0.  ,  0.  , -9.81])
    """
    robot = checked(state).robot
    applied = np.zeros(robot.nv) if external is None else generalised(state, external)[0]
    applied[robot.motors] += robot.check_tau(tau)
    return unconstrained(state, applied, strict=True)


def unconstrained(state: State, applied: Array, *, strict: bool = False) -> Array:
    """M^-1 (applied - h), shape (nv,), by the articulated bodies: M is made and factored only where it may be singular.

    Args:
        state: The state.
        applied: S^T tau + tau_ext, shape (nv,).
        strict: As of `inertia_factor`.

    Raises:
        SingularInertia: M is not positive definite.
    """
    robot = state.robot
    if robot.sound:
        a = robot.pool.compute(lambda data: pin.aba(robot.model, data, state.q, state.v, applied).copy())
        if is_finite(a) and max_abs(a) < _WILD:
            return a
    return np.asarray(lapack.dpotrs(inertia_factor(state.M, strict=strict), applied - state.h, lower=1)[0])


def free_force(state: State, tau: Array | None, external: External = None) -> tuple[Array, Array]:
    """(S^T tau + tau_ext - h, external wrench about the centre of mass): shapes (nv,) and (6,)."""
    robot = checked(state).robot
    if external is None:
        rhs, wrench = -state.h, zeros(6)
    else:
        tau_ext, wrench = generalised(state, external)
        rhs = tau_ext - state.h
    rhs[robot.motors] += robot.check_tau(tau)
    return rhs, wrench


def inverse_dynamics(state: State, a: Array) -> Array:
    """Generalised force M a + h that gives acceleration a, shape (nv,); its base part is what the world must supply.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> rbd.dynamics.inverse_dynamics(arm.at([0.0, 0.0]), [1.0, 0.0]).round(3)
        array([22.287,  5.738])
    """
    return checked(state).M @ state.robot.check_v(a, "a") + state.h


def kinetic_energy(state: State) -> float:
    """1/2 v^T M v [J].

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> rbd.dynamics.kinetic_energy(rbd.State(box, [0, 0, 1, 0, 0, 0, 1], [2.0, 0, 0, 0, 0, 0]))
        20.0
    """
    return 0.5 * float(checked(state).v @ state.M @ state.v)


def potential_energy(state: State) -> float:
    """Minus mass times gravity times centre of mass [J]; zero at the world's origin.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> round(rbd.dynamics.potential_energy(rbd.State(box, [0, 0, 1, 0, 0, 0, 1])), 3)  # m g h
        98.1
    """
    return -checked(state).robot.mass * float(state.robot.gravity @ state.com)


def momentum(state: State) -> Array:
    """Linear, then angular momentum about the centre of mass, in world axes, shape (6,) [kg m/s, kg m2/s].

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> rbd.dynamics.momentum(rbd.State(box, [0, 0, 1, 0, 0, 0, 1], [2.0, 0, 0, 0, 0, 3.0])).round(3)
        array([20. ,  0. ,  0. ,  0. ,  0. ,  0.8])
    """
    robot = checked(state).robot
    return robot.pool.compute(lambda data: pin.computeCentroidalMomentum(robot.model, data, state.q, state.v).vector.copy())


def energies_and_momenta(robot: CheckedModel, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
    """(kinetic energy (n,), potential energy (n,), momentum (n, 6), centre of mass (n, 3)) at n states, as one by one."""
    kinetic, both = np.empty(len(q)), np.empty((len(q), 9))

    def fill(data: pin.Data) -> None:
        model, momentum, com = robot.model, data.hg, data.com[0]
        for i in range(len(q)):
            pin.computeCentroidalMomentum(model, data, q[i], v[i])
            kinetic[i] = pin.computeKineticEnergy(model, data)
            both[i, :6], both[i, 6:] = momentum.vector, com

    robot.pool.compute(fill)
    return kinetic, -robot.mass * (both[:, 6:] @ robot.gravity), both[:, :6].copy(), both[:, 6:].copy()
