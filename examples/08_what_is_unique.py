"""Which forces under two feet are unique, and which did the solver choose?

Twice the same Talos, standing still with the same torques. On its soles: what each foot carries follows from the torques, what
each corner carries does not. With all joints locked it is a table on two legs: the torques no longer decide, and the feet
may share the weight in many ways. Last a real table, whose ranges are a line of algebra.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd
from rbd.visual import plot_ranges

WEIGHT_N = 400.0  # of the table
LEGS = {"++": (0.6, 0.4), "+-": (0.6, -0.4), "-+": (-0.6, 0.4), "--": (-0.6, -0.4)}  # [m]
COM = (0.15, -0.1)  # [m]


@dataclass(frozen=True, eq=False)
class Result:
    """What is unique in each case, and two choices of the table's forces."""

    free: rbd.answers.analysis.Uniqueness
    braked: rbd.answers.analysis.Uniqueness
    rigid: tuple[float, float]
    table: rbd.answers.analysis.Uniqueness
    least_N: np.ndarray
    weighted_N: np.ndarray


def rigid_share(state: rbd.State, rows: list[rbd.Rows]) -> tuple[float, float]:
    """Least and largest share of a rigid robot's left foot: both feet together carry under the centre of mass."""
    left, right = ((r.patch.point + r.patch.corners @ r.patch.axes.T)[:, 1] for r in rows[:2])
    y = state.com[1]
    return (y - right.max()) / (left.max() - right.max()), (y - right.min()) / (left.min() - right.min())


def table() -> rbd.Solution:
    """A plate on four legs that only push: mass and moments of inertia 1, but for the weight; nothing moves."""
    rows = []
    for name, (x, y) in LEGS.items():
        patch = rbd.problem.rows.Patch(np.array([x, y, 0.0]), np.eye(3), np.zeros((1, 3)), friction=0.0)
        J = np.array([[1.0, y - COM[1], COM[0] - x]])  # of lift, roll and pitch about the centre of mass
        rows.append(rbd.Rows(name, J, np.zeros(1), rbd.problem.NonNegative(1), resultant=np.eye(3)[:, 2:], patch=patch))
    return rbd.solve_problem(rbd.GaussProblem(np.eye(3), np.array([-WEIGHT_N, 0.0, 0.0]), rows))


def main(show: bool = True) -> Result:
    """Stand, lock the joints, ask what is unique."""
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=0.5)
    tau = rbd.hold(state, soles).tau

    free = rbd.solve(state, tau, soles).uniqueness()
    print(free)

    brakes = [rbd.JointLock(f"brake of {joint}", joint) for joint in talos.actuated_names]
    braked = rbd.solve(state, tau, [*soles, *brakes])
    print(f"\nThe same with brakes on all {talos.nu} joints:")
    stiff = braked.uniqueness()
    feet = [f"{name} {100 * c.share.lowest:.1f} .. {100 * c.share.highest:.1f} %" for name, c in stiff.contacts.items()]
    print(f"rows {stiff.rows} of rank {stiff.rank}; share of the weight: {', '.join(feet)}")

    least = table().with_forces()
    weighted = least.with_forces({"+-": 10.0})
    print("\nA table on four legs:")
    print(least.uniqueness())
    least_N, weighted_N = (np.array([s.contacts[name].normal for name in LEGS]) for s in (least, weighted))
    print(f"{least.force_choice}: {np.round(least_N, 3) + 0.0}")
    print(f"{weighted.force_choice} (leg +- spared): {np.round(weighted_N, 3) + 0.0}")

    result = Result(free, stiff, rigid_share(state, braked.problem.rows), least.uniqueness(), least_N, weighted_N)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(8.0, 6.4), layout="constrained")
        draw(figure.subplots(2, sharex=True), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/08_what_is_unique.png", dpi=150)
        print("See out/08_what_is_unique.png.")
    return result


def draw(axes, result: Result) -> list:
    """The ranges with given torques above those with brakes; returns the artists."""
    above, below = axes
    above.set_title("Talos on two soles, torques given", loc="left")
    below.set_title("Talos on two soles, brakes on all joints", loc="left")
    artists = plot_ranges(above, result.free) + plot_ranges(below, result.braked)
    above.set_xlabel("")
    return artists


def check(result: Result) -> None:
    """Statics."""
    for contact in result.free.contacts.values():
        assert contact.unique_wrench and contact.unique_centre_of_pressure, "rank 12 of 12: torques decide each foot's wrench"
        assert not any(corner.unique for corner in contact.corners), "four corners, one wrench"
    left, right = (contact.share for contact in result.braked.contacts.values())
    assert np.allclose((left.lowest, left.highest), result.rigid, atol=1e-6), "locked, Talos is a rigid body on two soles"
    assert abs(left.lowest + right.highest - 1.0) < 1e-9, "what one foot sheds the other takes"
    for contact, ends in zip(result.table.contacts.values(), ((0, 150), (100, 250), (0, 150), (0, 150)), strict=True):
        assert np.allclose((contact.normal.lowest, contact.normal.highest), ends), "f0 + t (1, -1, -1, 1), none below zero"
    assert np.allclose(result.least_N, (100, 150, 50, 100)) and np.allclose(result.weighted_N, (150, 100, 0, 150))


if __name__ == "__main__":
    check(main())
