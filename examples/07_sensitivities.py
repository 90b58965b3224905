"""Talos is pushed: which motor takes most weight off the foot on the far side, and how far does that rule hold?

An answer's derivatives are those of the modes it has: all corners of both soles stick here. At a fixed state the forces are
then exactly linear in torques and pushes, up to where a foot starts to slip; there the slope changes, and is refused.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

TORSO, NEAR, FAR = "torso_2_link", "left_sole", "right_sole"  # the push is to the robot's left, +y
PUSH_N = 80.0
UP = 2  # row of the vertical force in a wrench in world axes


@dataclass(frozen=True)
class Result:
    """The derivatives; the motor that moves most weight, how far its rule holds, and what it did up to there."""

    talos: rbd.Robot
    derivatives: rbd.answers.analysis.Derivatives
    motor: int
    gain: float
    change_Nm: np.ndarray
    far_N: np.ndarray
    ends_at_Nm: float
    refused: str


def main(show: bool = True) -> Result:
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=0.7)
    tau = rbd.hold(state, soles).tau

    def pushed(motor: int, change_Nm: float) -> rbd.Solution:
        torque = tau + change_Nm * np.eye(talos.nu)[motor]
        return rbd.solve(state, torque, soles, external=rbd.ExternalForce(TORSO, (0.0, PUSH_N, 0.0)))

    solution = pushed(0, 0.0)
    d = solution.derivatives()
    print(d)
    print(f"Pushed with {PUSH_N:.0f} N: near foot {solution.contacts[NEAR].normal:.0f} N, far foot ", end="")
    print(f"{solution.contacts[FAR].normal:.0f} N. One newton more of push changes the far foot by ", end="")
    J_P = state.frame(TORSO).J[:3]  # of the point that is pushed
    print(f"{(d.forces[FAR].dexternal @ J_P.T)[UP, 1]:.4f} N.")

    gains = d.forces[FAR].dtau[UP]
    print("far foot, per newton metre of")
    for i in np.argsort(-np.abs(gains).round(6), kind="stable")[:6]:
        print(f"  {talos.actuated_names[i]:<20}{gains[i]:8.3f} N, near foot {d.forces[NEAR].dtau[UP][i]:8.3f} N")

    motor = int(np.argmax(np.abs(gains)))
    ends_at_Nm = end_of_mode(lambda x: pushed(motor, x), -np.sign(gains[motor]))
    change_Nm = np.linspace(0.0, 1.5 * ends_at_Nm, 13)
    far_N = np.array([pushed(motor, x).contacts[FAR].normal for x in change_Nm])
    print(f"{talos.actuated_names[motor]} unloads it at that rate up to {ends_at_Nm:.2f} N m; there,")
    try:
        refused = str(pushed(motor, ends_at_Nm).derivatives())
    except rbd.errors.NotDifferentiable as why:
        refused = str(why)
    print(f"  {refused.split(' (')[0]}.")
    result = Result(talos, d, motor, float(gains[motor]), change_Nm, far_N, ends_at_Nm, refused)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        plot_sensitivity(figure.subplots(), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/07_sensitivities.png", dpi=150)
        print("See out/07_sensitivities.png.")
    return result


def end_of_mode(solved, sign: float) -> float:
    """Where a sole starts to slip: by bisection on its acceleration [N m]."""
    low, high = 0.0, 200.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        still = max(np.abs(c).max() for c in solved(sign * middle).accelerations.values()) < 1e-7
        low, high = (middle, high) if still else (low, middle)
    return sign * low


def plot_sensitivity(ax, result: Result) -> list:
    """The far foot's normal force against the torque, and the tangent; returns the artists."""
    x = result.change_Nm
    artists = ax.plot(x, result.far_N, "o-", color="#d55e00", label="solved")
    artists += ax.plot(x, result.far_N[0] + result.gain * x, "--", color="0.4", label="by its derivative")
    artists.append(ax.axvline(result.ends_at_Nm, ls=":", color="#0072b2", label="it starts to slip"))
    name = result.talos.actuated_names[result.motor]
    ax.set(xlabel=f"torque added at {name} [N m]", ylabel="normal force of the far foot [N]")
    ax.legend(frameon=False)
    return artists


def check(result: Result) -> None:
    """Linear as long as all corners stick, to rounding; not beyond; and the derivative is refused where the two meet."""
    tangent = result.far_N[0] + result.gain * result.change_Nm
    inside = np.abs(result.change_Nm) < abs(result.ends_at_Nm)
    assert np.abs(result.far_N - tangent)[inside].max() < 1e-6
    assert np.abs(result.far_N - tangent)[~inside][-1] > 0.1
    assert "change of contact mode" in result.refused
    assert set(result.derivatives.active[FAR]) == {"sticks"}


if __name__ == "__main__":
    check(main())
