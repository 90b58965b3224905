"""Where does the convex law differ from Coulomb's, and does it matter for a humanoid?

First a box, with a closed form. Then Talos on ice (mu = 0.05), with torques that would balance a push to its side on a
rough floor: while the soles stick the two laws agree to the last digit; where they slip, the convex law lifts them.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

import rbd

ROUGH, ICE = 0.7, 0.05


@dataclass(frozen=True)
class Result:
    """The box under 30 and 80 N, and Talos push by push."""

    box: dict[float, rbd.studies.LawComparison]
    push_N: np.ndarray
    talos: list[rbd.studies.LawComparison]


def main(show: bool = True) -> Result:
    box = {push_N: pushed_box(push_N) for push_N in (30.0, 80.0)}
    for push_N, both in box.items():
        print(f"A 10 kg box, mu = 0.6, pushed with {push_N:.0f} N.\n{both}")

    talos = rbd.load_robot("talos")
    state, push_N = talos.standing(), np.arange(0.0, 111.0, 10.0)
    pushed = [pushed_talos(state, force_N) for force_N in push_N]
    result = Result(box, push_N, pushed)
    print("Talos on ice, braced against a push to its left; largest of its soles' points:")
    print(f"{'':>10}{'':>8}{'slip [m/s2]':>24}{'lift-off [m/s2]':>28}{'normal force':>19}")
    print(f"{'':>10}{'laws':>8}{'convex':>12}{'Coulomb':>12}{'convex':>16}{'Coulomb':>12}{'convex/Coulomb':>19}")
    for force_N, both in zip(push_N, pushed, strict=True):
        slip, lift = [[worst(law, what) for law in both_laws(both)] for what in ("slip", "lift_off")]
        verdict = "agree" if both.agree else "part"
        row = f"{slip[0]:12.2f}{slip[1]:12.2f}{lift[0]:16.3f}{lift[1]:12.3f}{normal(both):19.4f}"
        print(f"{force_N:8.0f} N{verdict:>8}{row}".replace("-0.000", " 0.000"))

    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(8.6, 3.8), layout="constrained")
        plot_laws(figure.subplots(1, 2), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/04_two_laws.png", dpi=150)
        print("See out/04_two_laws.png.")
    return result


def pushed_box(push_N: float) -> rbd.studies.LawComparison:
    """The box of `urdf/box.urdf` on its floor."""
    robot = rbd.load_robot("box")
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=X, friction=0.6)
    state = rbd.State(robot, np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]))
    return rbd.studies.compare_laws(state, np.zeros(0), [floor], external=rbd.ExternalForce("box", (push_N, 0.0, 0.0)))


def pushed_talos(state: rbd.State, push_N: float) -> rbd.studies.LawComparison:
    """Talos on ice, with the torques that would hold the push on a rough floor."""
    talos, push = state.robot, rbd.ExternalForce("torso_2_link", (0.0, push_N, 0.0))
    tau = rbd.hold(state, talos.soles(friction=ROUGH), external=push).tau
    return rbd.studies.compare_laws(state, tau, talos.soles(friction=ICE), external=push)


def both_laws(both: rbd.studies.LawComparison) -> tuple[dict, dict]:
    """What the contacts do under the convex law, and under Coulomb's."""
    return both.under_convex, both.under_coulomb


def worst(contacts: dict, what: str) -> float:
    """The largest of the contacts' `slip` or `lift_off`."""
    return max(getattr(contact, what) for contact in contacts.values())


def normal(both: rbd.studies.LawComparison) -> float:
    """Normal force of both feet, convex over Coulomb."""
    convex, coulomb = (sum(contact.normal for contact in law.values()) for law in both_laws(both))
    return convex / coulomb


def plot_laws(axes, result: Result) -> list:
    """Slip and lift-off of Talos' soles against the push, under both laws; returns the artists."""
    artists = []
    for ax, what, label in zip(axes, ("slip", "lift_off"), ("tangential", "normal"), strict=True):
        for law, name, style, color in ((0, "convex", "o-", "#d55e00"), (1, "Coulomb", "s--", "#0072b2")):
            y = [worst(both_laws(both)[law], what) for both in result.talos]
            artists += ax.plot(result.push_N, y, style, color=color, label=name, markersize=4)
        ax.set(xlabel="push on the torso, to the left [N]", ylabel=f"largest {label} acceleration of a sole [m/s²]")
        ax.legend(frameon=False)
    axes[0].set_title("Talos on ice: slip")
    axes[1].set_title("and lift-off")
    return artists


def check(result: Result) -> None:
    """The box in closed form; Talos parts where friction is used up, and only the convex law lifts."""
    slips = result.box[80.0]
    normal_N = (98.1 + 48.0) / 1.36
    assert result.box[30.0].agree and not slips.agree
    assert abs(slips.coulomb.a[0] - 2.114) < 1e-9 and abs(slips.coulomb.forces["floor"][2] - 98.1) < 1e-8
    assert abs(slips.convex.forces["floor"][2] - normal_N) < 1e-8, "107.4 N"
    for push_N, both in zip(result.push_N, result.talos, strict=True):
        assert both.convex.status == both.coulomb.status == "solved"
        assert worst(both.under_coulomb, "lift_off") < 1e-6, "Coulomb's law lifts nothing that is loaded"
        convex = both.under_convex
        lifts, slips = worst(convex, "lift_off"), worst(convex, "slip")
        assert both.agree == (slips < 1e-6), f"{push_N:.0f} N: the laws part where a sole slips, and only there"
        assert lifts < 1e-6 or slips > lifts / ICE * (1.0 - 1e-9), "what is loaded lifts mu times as fast as it slips"


if __name__ == "__main__":
    check(main())
