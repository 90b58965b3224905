"""How fast must a pivot shake for a pendulum to stand on its head, and a plate, for a ball to leave it?

Both are motions that are prescribed in time. Kapitza's pendulum: its pivot, a `rbd.DrivenJoint`, moves along z by a cos(w t).
Where a w is above sqrt(2 g l) the pendulum stands upright, and swings about it slowly, at

    sqrt((a w / l)^2 / 2 - g / l)                                               (Kapitza 1951, for a << l)

Below, it falls. Then a ball on a plate that moves by a (1 - cos(w t)), `rbd.Ground(motion=...)`: as the plate only pushes, the
ball leaves it where the plate falls faster than g, and flies a parabola until it is hit again.
"""

from dataclasses import dataclass
from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rbd
from rbd.robots import PointMass, Sphere

GRAVITY, LENGTH, AMPLITUDE, LEAN = 9.81, 0.2, 0.01, 0.1  # [m/s2, m, m, rad]
FAST, SLOW = 300.0, 100.0  # frequencies of the pivot [rad/s]
PLATE, SHAKES = 0.01, sqrt(2.0 * GRAVITY / 0.01)  # amplitude of the plate [m], and its frequency, for 2 g [rad/s]


@dataclass(frozen=True)
class Result:
    """The pendulum on a fast and on a slow pivot, and the ball; when the ball leaves [s]; a period of the slow swing [s]."""

    stands: rbd.Trajectory
    falls: rbd.Trajectory
    ball: rbd.Trajectory
    leaves: float
    period: float


def pendulum() -> rbd.Robot:
    """A mass on a rod without mass, above a pivot that slides along z; no motors."""
    b = rbd.RobotBuilder("kapitza", root="fixed", about="A pendulum on a pivot that shakes.")
    b.body("pivot", Sphere(0.01, mass=0.1))
    b.joint("shaker", "ground", "pivot", kind="prismatic", axis=(0, 0, 1), motor=False)
    b.body("bob", PointMass(1.0, at=(0, 0, LENGTH)))
    b.joint("swing", "pivot", "bob", axis=(0, 1, 0), motor=False)
    return b.robot()


def shaken(w: float, duration: float) -> rbd.Trajectory:
    """The pendulum from rest, off the vertical by `LEAN`, on a pivot of frequency w."""
    a, robot = AMPLITUDE, pendulum()
    drive = rbd.DrivenJoint("drive", "shaker", lambda t: (a * cos(w * t), -a * w * sin(w * t), -a * w * w * cos(w * t)))
    start = robot.at([a, LEAN])
    return rbd.simulate(start, [drive], duration=duration, step=2.5e-3, integrator=rbd.DormandPrince8(), progress=False)


def period_of(run: rbd.Trajectory) -> float:
    """Of the slow swing: twice the time between its first two passes through the vertical, shaking smoothed out [s]."""
    angle = np.convolve(run.q[:, 1], np.ones(9) / 9.0, mode="same")
    i = np.flatnonzero(np.diff(np.sign(angle)))[:2]
    at = run.t[i] - angle[i] * np.diff(run.t)[i] / np.diff(angle)[i]
    return float(2.0 * (at[1] - at[0]))


def plate(t: float) -> np.ndarray:
    """How far the plate has moved, with its derivatives, shape (3, 3)."""
    a, w = PLATE, SHAKES
    return np.outer([a * (1.0 - cos(w * t)), a * w * sin(w * t), a * w * w * cos(w * t)], [0.0, 0.0, 1.0])


def main(show: bool = True) -> Result:
    stands, falls = shaken(FAST, 1.0), shaken(SLOW, 1.0)
    limit, period = sqrt(2.0 * GRAVITY * LENGTH), period_of(stands)
    expected = 2.0 * pi / sqrt(0.5 * (AMPLITUDE * FAST / LENGTH) ** 2 - GRAVITY / LENGTH)
    print(f"A pendulum of {LENGTH} m stands on its head where its pivot shakes faster than {limit:.3f} m/s.")
    for run, w in ((stands, FAST), (falls, SLOW)):
        print(f"  at {AMPLITUDE * w:.2f} m/s it leans by {np.abs(run.q[:, 1]).max():.3f} rad at most")
    print(f"  it swings about the vertical in {period:.3f} s; {expected:.3f} s by the mean of its fast motion")
    force = np.abs(stands.forces["drive"]).max()
    print(f"  force of the drive up to {force:.0f} N; energy is its work to 1e-6 J:", balanced(stands))
    contact = rbd.PointContact("contact", "box", friction=0.0, on=rbd.Ground(point=(0, 0, 0), motion=plate))
    rest = rbd.State(rbd.testing.box(mass=1.0), [0, 0, 0, 0, 0, 0, 1])
    ball = rbd.simulate(rest, [contact], duration=0.4, step=1e-3, progress=False)
    leaves = next(event.t for event in ball.events if event.kind == "leaves")
    hits = [event for event in ball.events if event.speed]
    print(f"A ball leaves a plate that shakes with 2 g at {leaves:.4f} s; closed form {2 * pi / 3 / SHAKES:.4f} s.")
    print(f"  it is hit {len(hits)} times in {ball.duration:g} s, first at {hits[0].speed:.3f} m/s")
    result = Result(stands, falls, ball, leaves, period)
    if show:
        Path("out").mkdir(exist_ok=True)
        draw(result).savefig("out/36_shakers.png", dpi=150)
        print(f"See out/36_shakers.png and {stands.export('out/36_shakers.html')}.")
    return result


def balanced(run: rbd.Trajectory) -> bool:
    """Whether the change of energy is the work of the drive."""
    return bool(np.abs(run.residuals["energy"]).max() < 1e-6)


def draw(result: Result) -> Figure:
    """Leans of both pendulums, and heights of ball and plate, over time."""
    figure = Figure(figsize=(8.8, 5.0), layout="constrained")
    above, below = figure.subplots(2)
    for run, w, color in ((result.stands, FAST, "#0072b2"), (result.falls, SLOW, "#d55e00")):
        above.plot(run.t, run.q[:, 1], color=color, label=f"pivot at {AMPLITUDE * w:.1f} m/s")
    above.set(ylabel="lean [rad]", xlabel="time [s]")
    above.legend(frameon=False, loc="upper left")
    below.plot(result.ball.t, [1e3 * plate(t)[0, 2] for t in result.ball.t], color="0.5", label="plate")
    below.plot(result.ball.t, 1e3 * result.ball.q[:, 2], color="#0072b2", label="ball")
    below.set(ylabel="height [mm]", xlabel="time [s]")
    below.legend(frameon=False, loc="upper left")
    return figure


def check(result: Result) -> None:
    """One stands and one falls; the slow period to some percent; the ball leaves as in closed form, never in the plate."""
    assert np.abs(result.stands.q[:, 1]).max() < 0.2 and result.falls.q[:, 1].max() > 1.5
    expected = 2.0 * pi / sqrt(0.5 * (AMPLITUDE * FAST / LENGTH) ** 2 - GRAVITY / LENGTH)
    assert abs(result.period / expected - 1.0) < 0.05
    assert balanced(result.stands) and result.stands.residuals["drift"].max() < 1e-12
    assert abs(result.leaves - 2.0 * pi / 3.0 / SHAKES) < 1e-3
    heights = np.array([plate(t)[0, 2] for t in result.ball.t])
    assert (result.ball.q[:, 2] - heights).min() > -1e-9


if __name__ == "__main__":
    check(main())
