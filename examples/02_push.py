"""Pushed sideways at the torso, what gives first: the joints, the friction, or the edge of the foot?

Three answers. Limp: the motors keep the torques of standing, so the joints give way and the contact forces hardly change.
Braced: the motors balance the push as well as torques can, the far foot unloads, and at some force the robot tips. Slippery:
braced as on a rough floor, but on ice, where the contact law matters.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

GRAVITY, FRICTION, ICE = 9.81, 0.7, 0.05
TORSO, NEAR, FAR = "torso_2_link", "left_sole", "right_sole"  # the push is to the robot's left, +y


@dataclass(frozen=True)
class Result:
    """The braced answers push by push, where they end and why, and the other two answers."""

    push_N: np.ndarray
    braced: list[rbd.Actuation]
    tips_at_N: float
    reason: str
    rigid_N: float
    limp: rbd.Solution
    ice: list[np.ndarray]


def main(show: bool = True) -> Result:
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=FRICTION)

    def push(force_N: float) -> rbd.ExternalForce:
        return rbd.ExternalForce(TORSO, (0.0, force_N, 0.0))

    def brace(force_N: float) -> rbd.Actuation:
        return rbd.hold(state, soles, external=push(force_N))

    limp = rbd.solve(state, brace(0.0).tau, soles, external=push(80.0))
    tips_at_N, reason = last_push(brace)
    push_N = np.append(np.arange(0.0, tips_at_N, 20.0), tips_at_N)
    braced = [brace(force_N) for force_N in push_N]
    patch = soles[0].rows(state).patch  # a rigid robot turns about its outer edge: push x height = weight x distance to it
    edge_m = (patch.point + patch.corners @ patch.axes.T)[:, 1].max() - state.com[1]
    rigid_N = talos.mass * GRAVITY * edge_m / state.frame(TORSO).X_WF.translation[2]

    on_ice = state, brace(80.0).tau, talos.soles(friction=ICE)
    ice = [rbd.solve(*on_ice, external=push(80.0), solver=s).accelerations[NEAR] for s in (None, rbd.ProxQP())]
    result = Result(push_N, braced, tips_at_N, reason, rigid_N, limp, ice)

    far, near = limp.contacts[FAR].normal, limp.contacts[NEAR].normal
    print(f"Limp, pushed with 80 N (torques of standing):\n  far foot {far:.0f} N, near foot {near:.0f} N")
    print(f"Braced:{'far foot':>16}{'near foot':>12}{'friction used':>16}{'largest torque':>17}")
    for force_N, hold in zip(push_N, braced, strict=True):
        far, near, top = hold.contacts[FAR].normal, hold.contacts[NEAR].normal, 1.0 - hold.margins.torque.min()
        print(f"{force_N:5.0f} N{far:14.0f} N{near:10.0f} N{100 * friction_used(hold):14.1f} %{100 * top:15.1f} %")
    print(f"It tips at {tips_at_N:.2f} N; a rigid robot of this weight and these feet, at {rigid_N:.2f} N.")
    print(f"On ice (mu = {ICE}), 80 N: the near foot slides at {ice[0][1]:.2f} m/s2, and stays on the ground;")
    print(f"under the convex law, with pyramids, it slides at {ice[1][1]:.2f} m/s2, and lifts at {ice[1][2]:.3f} m/s2.")

    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        plot_push(figure.subplots(), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/02_push.png", dpi=150)
        print("See out/02_push.png.")
    return result


def last_push(brace) -> tuple[float, str]:
    """The largest push that torques can balance [N], and the limit that prevents more."""
    low_N, high_N, reason = 0.0, 200.0, ""
    while high_N - low_N > 1e-4:
        middle_N = 0.5 * (low_N + high_N)
        try:
            brace(middle_N)
            low_N = middle_N
        except rbd.CannotHold as why:
            high_N, reason = middle_N, str(why)
    return low_N, reason


def friction_used(hold: rbd.Actuation) -> float:
    """|f_t| / (mu f_n) of both feet together: unlike each foot's own share, it follows from the push alone."""
    total = sum(wrench[:3] for wrench in hold.forces.values())
    return float(np.hypot(*total[:2]) / (FRICTION * total[2]))


def plot_push(ax, result: Result) -> list:
    """Normal force of each foot against the push, up to where the robot tips; returns the artists."""
    artists = []
    for name, label, color in ((NEAR, "near foot, left", "#0072b2"), (FAR, "far foot, right", "#d55e00")):
        normal_N = [hold.contacts[name].normal for hold in result.braced]
        artists += ax.plot(result.push_N, normal_N, "o-", color=color, label=label)
    artists.append(ax.axvline(result.rigid_N, ls="--", color="0.4", label=f"tips: {result.rigid_N:.1f} N"))
    ax.set(xlabel="push on the torso, to the left [N]", ylabel="normal force [N]", title="Talos braced against a push")
    ax.legend(loc="center", bbox_to_anchor=(0.72, 0.45), frameon=False)
    return artists


def check(result: Result) -> None:
    """Statics of a rigid body, and what each law does to a foot that slides."""
    assert abs(result.tips_at_N - result.rigid_N) < 0.01, "it tips where the weight's moment about the edge is used up"
    assert "no forces" in result.reason, "neither friction nor a motor was the limit"
    far_N = [hold.contacts[FAR].normal for hold in result.braced]
    assert np.all(np.diff(far_N) < 0.0) and far_N[-1] < 2.0, "the far foot unloads, to nothing where it tips"
    carried_N, weight_N = sum(c.normal for c in result.limp.contacts.values()), result.braced[0].state.robot.mass * GRAVITY
    assert abs(carried_N / weight_N - 1.0) < 0.01, "limp: joints give way, and the feet go on carrying the weight"
    (slip, stays), (slide, lift) = [c[1:3] for c in result.ice]
    assert slip > 1.0 and abs(stays) < 1e-8, "Coulomb's law: what slides stays on the ground"
    assert slide > 1.0 and abs(lift - ICE * slide) < 1e-8, "convex law: what slides also lifts, mu times as fast"


if __name__ == "__main__":
    check(main())
