"""Can Gauss's principle be solved for a humanoid in fifteen lines?

The quadratic program of Gauss's principle, min 1/2 |a - a_free|_M^2 subject to J a + J_dot v = 0, with Pinocchio
and ProxSuite alone, for a Talos that moves on held soles; beside it `rbd.solve`. Accelerations and forces agree.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

import rbd
import rbd.solvers.qp  # chooses the build of ProxSuite; it comes before ProxSuite itself

import proxsuite  # isort: skip


@dataclass(frozen=True)
class Result:
    """Both answers, for `check`."""

    state: rbd.State
    solution: rbd.Solution
    a: np.ndarray
    f: np.ndarray
    J: np.ndarray


def gauss(model: pin.Model, q: np.ndarray, v: np.ndarray, force: np.ndarray, frames: list[int]) -> tuple[np.ndarray, ...]:
    """(a, f, J): the acceleration nearest to free motion with `frames` held, and the wrenches that hold them, in world axes."""
    data, axes = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    M = pin.crba(model, data, q)
    a_free = np.linalg.solve(M, force - pin.nonLinearEffects(model, data, q, v))
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    pin.updateFramePlacements(model, data)
    J = np.vstack([pin.getFrameJacobian(model, data, i, axes) for i in frames])
    J_dot = np.vstack([pin.getFrameJacobianTimeVariation(model, data, i, axes) for i in frames])
    qp = proxsuite.proxqp.dense.QP(model.nv, len(J), 0)
    qp.settings.eps_abs, qp.settings.eps_rel = 1e-10, 0.0
    qp.init(M, -M @ a_free, J, -J_dot @ v, compute_preconditioner=False, rho=1e-9, mu_eq=1e-8)
    qp.solve()
    return qp.results.x, -qp.results.y, J  # ProxSuite's stationarity is M (a - a_free) + J^T y = 0


def main(show: bool = True) -> Result:
    # Robot: Talos standing, its joints moving at random in a way that keeps both soles where they are.
    talos = rbd.load_robot("talos")
    soles = talos.soles(friction=None)
    random = np.random.default_rng(0).standard_normal(talos.nv)
    standing = talos.standing()
    state = rbd.mechanism.project_velocity(standing.with_velocity(random), soles)
    tau = rbd.hold(standing, soles).tau

    # Solve: the fifteen lines, and rbd.
    frames = [talos.model.getFrameId(sole.frame) for sole in soles]
    a, f, J = gauss(talos.model, state.q, state.v, talos.actuation.T @ tau, frames)
    solution = rbd.solve(state, tau, soles)

    # Print.
    print("                          fifteen lines   rbd.solve   difference")
    knee = talos.joints["leg_left_4_joint"].v
    rows = [("left knee [rad/s2]", a[knee].item(), solution.a[knee].item())]
    for i, sole in enumerate(soles):
        rows.append((f"{sole.name}, up [N]", f[6 * i + 2], solution.forces[sole.name][2]))
    rows.append(("Gauss's function", 0.5 * (a - solution.a_free) @ (J.T @ f), float(solution.gauss)))
    for what, ours, theirs in rows:
        print(f"{what:<25} {ours:13.4f} {theirs:11.4f}   {abs(ours - theirs):.0e}")
    print(f"largest difference of an acceleration: {np.abs(a - solution.a).max():.0e}")
    return Result(state, solution, a, f, J)


def check(result: Result) -> None:
    """The two answers are one, and it is a minimum: stationary in a, on the constraint."""
    solution = result.solution
    P = solution.problem
    scale = np.abs(solution.a).max()
    assert np.abs(result.a - solution.a).max() < 1e-9 * scale, "both find the same acceleration"
    force = P.M @ result.a - P.rhs
    assert np.abs(force - result.J.T @ result.f).max() < 1e-9 * np.abs(force).max(), "M (a - a_free) = J^T f"
    assert np.abs(force - P.J.T @ solution.multipliers).max() < 1e-9 * np.abs(force).max(), "the same forces on the joints"
    assert np.abs(P.J @ result.a + P.offset).max() < 1e-9 * scale, "the soles stay"
    assert np.abs(P.offset).max() > 0.1, "J_dot v is not zero: the test would miss it otherwise"


if __name__ == "__main__":
    check(main())
