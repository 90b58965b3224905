"""Which torques does a G1 need to crouch and stand up again, how near are they to their limits, and what if it is faster?"""

from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

import rbd

BENT = (("hip_pitch", -0.75), ("knee", 1.57), ("ankle_pitch", -0.82))  # [rad]
LEGS = {f"{side}_{name}_joint": angle for side in ("left", "right") for name, angle in BENT}


def crouch(g1: rbd.Robot, down_s: float) -> tuple[np.ndarray, list[rbd.Actuation]]:
    """Times, and torques and forces at each: down by a quintic in time, and up the same way."""
    standing, soles = g1.standing(), g1.soles(friction=0.7)
    held = [sole.anchored(standing) for sole in g1.soles(friction=None)]
    t, u, q, ways = np.linspace(0.0, 2.0 * down_s, 101), 1.0 - np.abs(np.linspace(-1.0, 1.0, 101)), [], []
    for s in u**3 * (10.0 - 15.0 * u + 6.0 * u**2):  # from 0 to 1 and back; the base follows from the soles
        legs = {name: (1.0 - s) * standing.q[g1.joints[name].q] + s * angle for name, angle in LEGS.items()}
        q.append(rbd.mechanism.assemble(standing, held, fixed=legs).q)
    plan = CubicSpline(t, [pin.difference(g1.model, q[0], x) for x in q], bc_type="clamped")  # the base does not turn
    for x, v, a in zip(q, plan(t, 1), plan(t, 2), strict=True):
        state = rbd.mechanism.project_velocity(rbd.State(g1, x, v), held)
        nearest = rbd.mechanism.project_acceleration(state, a, held)
        ways.append(rbd.inverse_dynamics(state, nearest.a, soles))
    return t, ways


def main(show: bool = True) -> tuple[list[rbd.Actuation], tuple]:
    (t, ways), limits = crouch(g1 := rbd.load_robot("g1"), 0.5), ()
    print(f"G1 goes down by {1e3 * np.ptp([way.state.com[2] for way in ways]):.0f} mm in 0.5 s, and up again. At its hardest:")
    print(min(ways, key=lambda way: way.margins.torque.min().round(6)))
    try:
        crouch(g1, 0.3)
    except rbd.CannotMove as why:
        print("In 0.3 s it cannot. Together these limits prevent it:", *(limits := why.limits), sep="\n  ")
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        ax = (figure := Figure(figsize=(7.0, 4.2), layout="constrained")).subplots()
        left = [g1.actuated_names.index(name) for name in list(LEGS)[:3]]
        ax.plot(t, [100.0 * way.tau[left] / g1.effort_limit[left] for way in ways], label=list(LEGS)[:3])
        ax.set(xlabel="time [s]", ylabel="torque in % of its limit", title="G1 crouches, and stands up again")
        ax.legend(frameon=False)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/25_torques_of_a_crouch.png", dpi=150)
    return ways, limits


def check(result: tuple[list[rbd.Actuation], tuple]) -> None:
    """Under these torques Coulomb's law gives back the planned motion; the hasty crouch does not fail for want of torque."""
    for way in result[0][::10]:
        assert np.abs(rbd.solve(way.state, way.tau, way.constraints).a - way.a).max() < 1e-8 * np.abs(way.a).max()
    assert {limit.kind for limit in result[1]} == {"edge", "base"}


if __name__ == "__main__":
    check(main())
