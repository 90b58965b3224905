"""Along a straight reach of a two-link arm, what is the tangential, the centripetal, the Coriolis part of its acceleration?

Problem 1 of the text [Duarte2021]: links of 0.5 m, the hand from (1, 0) to (0.5, 0.5) m in 1 s with the least jerk. The parts
add up to the acceleration that was planned. An observer who rides on the first link finds the same Coriolis part, 2 w x v, by
numerical differentiation. At the start the arm is stretched out: its hand accelerates gently, and its joints without bound.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd.planar

ELL = 0.5


@dataclass(frozen=True)
class Result:
    """The motion, the Coriolis part as the rider finds it [m/s2], and sqrt(t) times the elbow's at 1 and 10 ms."""

    motion: "rbd.planar.PlanarMotion"
    rider: np.ndarray
    elbow: np.ndarray


def main(show: bool = True) -> Result:
    arm = rbd.planar.Chain(2, lengths=(ELL, ELL))
    reach = rbd.planar.minimum_jerk([1.0, 0.0], [0.5, 0.5], 1.0)
    motion = rbd.planar.endpoint_motion(arm, reach, times=np.linspace(0.01, 1.0, 100))  # the text's samples
    parts = motion.split
    print("  t [s]    tangential        centripetal       Coriolis          their sum         planned  [m/s2]")
    for k in (9, 20, 49, 78, 98):
        row = [x[k] for x in (parts.tangential, parts.centripetal, parts.coriolis, parts.total, motion.a)]
        print(f"{motion.t[k]:7.2f}" + "".join(f"{x + 0.0:9.3f}{y + 0.0:8.3f} " for x, y in row))
    rider = coriolis_of_a_rider(motion)
    apart = np.abs(rider - parts.coriolis)[1:-1].max()
    print(f"Found by an observer on the first link: the same Coriolis part, to {apart:.3f} m/s2 (differences over 10 ms).")
    early = rbd.planar.endpoint_motion(arm, reach, times=[0.001, 0.01])
    elbow = early.qdd[:, 1] * np.sqrt(early.t)
    print(f"The elbow accelerates by {early.qdd[1, 1]:.1f} rad/s2 at 10 ms, by {early.qdd[0, 1]:.1f} rad/s2 at 1 ms:")
    print(f"  {elbow[1]:.3f} / sqrt(t), {elbow[0]:.3f} / sqrt(t); as t goes to 0, 3/2 sqrt(10) = {1.5 * np.sqrt(10.0):.3f}.")
    result = Result(motion, rider, elbow)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(10.0, 3.6), layout="constrained")
        plot_parts(figure.subplots(1, 3, sharex=True, sharey=True), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/18_acceleration_parts.png", dpi=150)
        print("See out/18_acceleration_parts.png.")
    return result


def coriolis_of_a_rider(motion) -> np.ndarray:
    """2 w x v, with v the hand's velocity as seen from the first link, whose rate is w; shape (samples, 2) [m/s2]."""
    q, t = motion.q, motion.t
    # Seen from the first link the hand is at (ell + ell cos q2, ell sin q2): differentiate there, then turn back.
    seen = np.gradient(ELL * np.column_stack([1.0 + np.cos(q[:, 1]), np.sin(q[:, 1])]), t, axis=0)
    w, c, s = np.gradient(q[:, 0], t), np.cos(q[:, 0]), np.sin(q[:, 0])
    vx, vy = c * seen[:, 0] - s * seen[:, 1], s * seen[:, 0] + c * seen[:, 1]
    return 2.0 * np.column_stack([-w * vy, w * vx])


def plot_parts(axes, result: Result) -> list:
    """The three parts against the whole; returns the artists."""
    from rbd.visual import plot_split

    return plot_split(axes, result.motion)


def check(result: Result) -> None:
    """The parts add up to what was planned; each has its direction; the elbow's acceleration begins as 3/2 sqrt(10 / t)."""
    motion, parts = result.motion, result.motion.split
    planned = rbd.planar.minimum_jerk([1.0, 0.0], [0.5, 0.5], 1.0).acceleration(motion.t)
    assert np.abs(parts.total - planned).max() < 1e-9, "the sum is the acceleration"
    across = ELL * np.column_stack([-np.sin(motion.q.sum(axis=1)), np.cos(motion.q.sum(axis=1))])
    assert np.abs(np.sum(parts.coriolis * across, axis=1)).max() < 1e-9, "Coriolis: along the second link"
    assert np.abs(result.rider - parts.coriolis)[1:-1].max() < 0.05, "2 w x v"
    assert abs((10.0 * result.elbow[0] - result.elbow[1]) / 9.0 - 1.5 * np.sqrt(10.0)) < 2e-3, "extrapolated to t = 0"


if __name__ == "__main__":
    check(main())
