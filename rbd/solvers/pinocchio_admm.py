"""Pinocchio's ADMM on a dense problem: the only file of the algebra side that imports Pinocchio.

The solver takes constraint models; these carry only the sets. Lines, half-lines and intervals are the
joint friction of a chain of as many joints, cones are point contacts. They belong to no robot.

Source: [Carpentier2024], the solver and its conventions; impulses are forces here, velocities accelerations.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.solvers.newton import Scaled


def admm(
    problem: Scaled, guess: Array, *, coulomb: bool, iterations: int, tolerance: float, step: float | None = None
) -> tuple[Array, int]:
    """(weights, iterations) of one run, in the problem's units and order; its own status is not used.

    Args:
        problem: With a symmetric D.
        guess: Weights to start from.
        coulomb: Coulomb's law (`solve_ncp`); else its convex relaxation.
        iterations: Largest number.
        tolerance: Absolute, on feasibility and complementarity.
        step: A constant step size; None: one from the spectrum of D, adapted while it runs, at half as much again an iteration.
    """
    order = problem.order
    models, datas = _stand_ins(order.singles, tuple(order.mu.tolist()), problem.lower.tobytes(), problem.upper.tobytes())
    settings = pin.ADMMSolverSettings()
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = tolerance
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = 0.0
    settings.max_iterations = iterations
    settings.solve_ncp = coulomb
    settings.anderson_capacity = 5  # a third of the iterations
    if step is not None:
        settings.rho_init, settings.admm_update_rule = step, pin.ADMMUpdateRule.CONSTANT
    result = pin.ADMMSolverResult()
    result.setConstraintImpulseGuess(guess)
    delassus = pin.DelassusOperatorDense(np.asfortranarray(problem.D))  # a new one: the solver stores its damping in it
    pin.ADMMConstraintSolver(len(problem.q)).solve(delassus, problem.q, models, datas, settings, result)
    found = result.retrieveConstraintImpulses()
    return (found if np.isfinite(found).all() else guess), result.iterations


def pgs(problem: Scaled, *, iterations: int, tolerance: float) -> Array:
    """Weights of projected Gauss-Seidel for Coulomb's law, from zero, in the problem's units and order.

    Args:
        problem: With a symmetric D.
        iterations: Largest number of sweeps.
        tolerance: Absolute, on feasibility and complementarity.
    """
    order, settings = problem.order, pin.PGSSolverSettings()
    models, datas = _stand_ins(order.singles, tuple(order.mu.tolist()), problem.lower.tobytes(), problem.upper.tobytes())
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = tolerance
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = 0.0
    settings.max_iterations, settings.solve_ncp = iterations, True
    result = pin.PGSSolverResult()
    delassus = pin.DelassusOperatorDense(np.asfortranarray(problem.D))
    pin.PGSConstraintSolver(len(problem.q)).solve(delassus, problem.q, models, datas, settings, result)
    found = result.retrieveConstraintImpulses()
    return found if np.isfinite(found).all() else np.zeros(len(problem.q))


@lru_cache(maxsize=64)
def _stand_ins(
    singles: int, mu: tuple[float, ...], lower: bytes, upper: bytes
) -> tuple[pin.StdVec_ConstraintModel, pin.StdVec_ConstraintData]:
    """Constraint models, and their data, that carry the sets; bounds as bytes, for the cache."""
    chain, joints, joint = pin.Model(), pin.StdVec_Index(), 0
    for i in range(max(singles, 1)):
        joint = chain.addJoint(joint, pin.JointModelRZ(), pin.SE3.Identity(), str(i))
        joints.append(joint)
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    if singles:
        low, high = np.frombuffer(lower), np.frombuffer(upper)
        models.append(pin.ConstraintModel(pin.JointFrictionConstraintModel(chain, joints, low, high)))
    for coefficient in mu:
        point = pin.PointContactConstraintModel(chain, 1, pin.SE3.Identity())
        point.setFriction(coefficient)
        models.append(pin.ConstraintModel(point))
    for model in models:
        datas.append(model.createData())
    return models, datas
