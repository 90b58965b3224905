"""Solo12 falls on a rubber cord: how fast does it swing, how deep does it fall, and where does its energy go?

First all joints are locked. The cord is a linear spring straight above the centre of mass, so the robot is a mass on a spring:
it swings at sqrt(k / m) / 2 pi, and falls twice as deep as where it would hang at rest. `DormandPrince8` shows that, and keeps
the energy. Then each joint is a torsion spring with a damper, and the floor is in reach of the feet: `TimeStepping` takes the
elements implicitly, so they may be stiffer than its steps could follow. What leaves the energy is what dampers and floor take.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rbd

CORD, JOINTS, DAMPING = 100.0, 6.0, 0.02  # [N/m, N m/rad, N m s/rad]
LENGTH, HEIGHT = 1.0, 0.35  # of the cord, and of the feet, at the start [m]


@dataclass(frozen=True)
class Result:
    """Both motions, and the frequency of the first [Hz]: found, and that of a mass on a spring."""

    rigid: rbd.Trajectory
    sprung: rbd.Trajectory
    found: float
    expected: float


def cord_of(state: rbd.State) -> rbd.Spring:
    """A cord from the centre of mass straight up; relaxed at the start."""
    base = state.base_pose(state.robot.bases[0])
    over = base.actInv(state.com)
    return rbd.Spring("base_link", to=state.com + [0.0, 0.0, LENGTH], stiffness=CORD, rest=LENGTH, offset=over, name="cord")


def frequency(run: rbd.Trajectory) -> float:
    """Of the centre of mass, from a fit of its height by a + b cos(w t) + c sin(w t), by Newton's method in w [Hz]."""
    t, z = run.t, run.com[:, 2]
    w = 2.0 * np.pi * 0.5 / (t[np.argmin(z[: len(z) // 2])] - t[0])  # half a period down
    for _ in range(20):
        basis = np.column_stack([np.ones_like(t), np.cos(w * t), np.sin(w * t)])
        a, b, c = np.linalg.lstsq(basis, z, rcond=None)[0]
        slope = t * (c * np.cos(w * t) - b * np.sin(w * t))
        w += np.linalg.lstsq(np.column_stack([basis, slope]), z, rcond=None)[0][3]
    return float(w / (2.0 * np.pi))


def main(show: bool = True) -> Result:
    robot = rbd.load_robot("solo12")
    state = robot.standing()
    high = rbd.State(robot, state.q + HEIGHT * np.eye(robot.nq)[2])
    cord = cord_of(high)
    locked = [rbd.JointLock(f"{name} locked", name) for name in robot.actuated_names]
    rigid = rbd.simulate(high, locked, duration=2.0, step=0.01, external=cord, integrator=rbd.DormandPrince8())
    found, expected = frequency(rigid), float(np.sqrt(CORD / robot.mass)) / (2.0 * np.pi)

    place = robot.joints
    springs = [rbd.JointSpring(name, stiffness=JOINTS, rest=float(high.q[place[name].q][0])) for name in robot.actuated_names]
    dampers = rbd.JointDamping(dict.fromkeys(robot.actuated_names, DAMPING))
    sprung = rbd.simulate(high, robot.feet(friction=0.8), duration=2.0, step=2e-3, external=[cord, *springs, dampers])
    print(f"{robot.name}, {robot.mass:.3f} kg, all joints locked, on a cord of {CORD:g} N/m")
    print(f"  swings at {found:.6f} Hz; a mass on a spring at {expected:.6f} Hz")
    print(f"  falls by {np.ptp(rigid.com[:, 2]):.4f} m; 2 m g / k is {2 * 9.81 * robot.mass / CORD:.4f} m")
    print(f"  its energy changes by less than 1e-9 of the cord's: {np.ptp(rigid.energy) < 1e-9 * np.ptp(rigid.elastic)}")
    lost = balance(sprung)
    print("With springs and dampers in its joints, above a floor")
    print(f"  the springs hold {sprung.elastic.max():.2f} J at most, at {sprung.t[sprung.elastic.argmax()]:.2f} s")
    print(
        f"  after {sprung.t[-1]:g} s dampers have taken {sprung.dissipated[-1]:.2f} J, impacts and friction {-lost[-1]:.2f} J"
    )
    if show:
        Path("out").mkdir(exist_ok=True)
        draw(sprung).savefig("out/31_springs.png", dpi=150)
        print(f"See out/31_springs.png and {sprung.export('out/31_springs.html')}.")
    return Result(rigid, sprung, found, expected)


def balance(run: rbd.Trajectory) -> np.ndarray:
    """What is left of the change of energy without the dampers' part [J]."""
    return run.energy - run.energy[0] + run.dissipated


def draw(run: rbd.Trajectory) -> Figure:
    """Energies over time, and the height of the centre of mass."""
    figure = Figure(figsize=(8.8, 4.4), layout="constrained")
    above, below = figure.subplots(2, sharex=True, height_ratios=(2.6, 1.0))
    run.plot_energy(above)
    above.set_xlabel("")
    below.plot(run.t, run.com[:, 2], color="0.1")
    below.set(xlabel="time [s]", ylabel="height [m]")
    return figure


def check(result: Result) -> None:
    """The closed forms, energy to 1e-9; with dampers and floor energy is only lost, and never by the springs."""
    rigid, sprung = result.rigid, result.sprung
    assert abs(result.found / result.expected - 1.0) < 1e-9
    assert (
        abs(np.ptp(rigid.com[:, 2]) * CORD / (2 * 9.81 * rigid.robot.mass) - 1.0) < 1e-4
    )  # the lowest sample is not the lowest point
    assert np.ptp(rigid.energy) < 1e-9 * np.ptp(rigid.elastic)
    lost = balance(sprung)
    assert (np.diff(sprung.dissipated) >= 0.0).all() and sprung.dissipated[-1] > 1.0
    assert np.diff(lost).max() < 1e-3 and lost[-1] < -0.3
    assert sprung.residuals["law"].max() < 1e-9


if __name__ == "__main__":
    check(main())
