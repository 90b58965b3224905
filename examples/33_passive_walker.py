"""Can two straight legs walk down a slope, without motors and without a controller?

McGeer's walker (1990): legs on round feet, a mass at the hip, nothing else. One foot rolls on the slope while the other leg
swings; an event is the instant at which both legs are at the same angle from the slope's normal: there the swinging foot
strikes, and the other one leaves. Straight legs are equally long, so that the swinging foot passes through the slope: it is
switched off until then. After a hundred steps the gait is the same from step to step, and a strike takes the energy that the
slope gives. (`tests/simulation/test_passive_walker.py` compares each step with the planar equations of two angles.)
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd
from rbd.robots import Cylinder, PointMass, Rod
from rbd.simulation import StateEvent, Switch

G, SLOPE = 9.81, 0.01
HIP, LEG, INERTIA, REACH, MIDDLE, FOOT = 1.0, 0.5, 0.02, 1.0, 0.5, 0.2  # kg, kg, kg m2; hip to arc's centre, to leg's, arc [m]
SIDES = ("left", "right")
START = np.array([0.22, -0.22, -0.95, -0.4])  # angles of stance and swing leg from the normal, and their rates


@dataclass(frozen=True)
class Result:
    """The walk; (angles, rates) after each strike; periods; the energy that the last strike takes, and the slope gives [J]."""

    walk: rbd.Trajectory
    after: np.ndarray
    periods: np.ndarray
    lost: float
    given: float


def walker() -> rbd.Robot:
    """The left leg with the hip's mass moves in the x-z plane, the right one hangs on it; the slope is gravity's."""
    b = rbd.RobotBuilder("walker", root="planar")
    for side, more in zip(SIDES, ([PointMass(HIP)], []), strict=True):
        leg = Rod((0, 0, 0), (0, 0, -REACH), color="blue" if side == "left" else "orange", radius=0.015)
        foot = Cylinder(FOOT, 0.04, at=(0, 0, -REACH), rpy=(np.pi / 2, 0, 0), color="grey")
        mass = LEG + HIP * bool(more)
        com = (0, 0, -MIDDLE * LEG / mass)
        about = INERTIA + LEG * (MIDDLE + com[2]) ** 2 + HIP * bool(more) * com[2] ** 2
        b.body(side, leg, foot, mass=mass, com=com, inertia=(about, about, 1e-3))
        b.frame(f"{side}_foot", side, at=(0, 0, -REACH))
    b.joint("hip", "left", "right", "revolute", axis=(0, -1, 0))
    downhill = (G * np.sin(SLOPE), 0.0, -G * np.cos(SLOPE))
    return rbd.load_robot(text=b.urdf(), root="planar", plane="xz", gravity=downhill, passive=("hip",))


def state_of(robot: rbd.Robot, y: np.ndarray) -> rbd.State:
    """On the left foot, from angles and rates."""
    p, w, dp, dw = y
    q = [-FOOT * p - REACH * np.sin(p), FOOT + REACH * np.cos(p), np.cos(p), np.sin(p), w - p]
    world = np.array([-FOOT - REACH * np.cos(p), -REACH * np.sin(p)]) * dp
    turn = np.array([[np.cos(p), np.sin(p)], [-np.sin(p), np.cos(p)]])
    return rbd.State(robot, q, [*turn @ world, dp, dw - dp])


def angles(state: rbd.State, stance: str = "left") -> np.ndarray:
    """(stance leg, swing leg, their rates)."""
    left, between = np.arctan2(state.q[3], state.q[2]), state.q[4]
    both = np.array([[left, left + between], [state.v[2], state.v[2] + state.v[3]]])
    return (both if stance == "left" else both[:, ::-1]).ravel()


def main(show: bool = True) -> Result:
    robot = walker()
    feet = [rbd.RollingDisk(side, f"{side}_foot", radius=FOOT, on=0.0) for side in SIDES]
    strikes = [
        StateEvent(
            lambda state: float(angles(state)[:2].sum()), f"{side} strikes", direction=-1, while_off=side,
            then=Switch(on=side, off=other),
        )
        for side, other in (SIDES, SIDES[::-1])
    ]  # fmt: skip
    walk = rbd.simulate(
        state_of(robot, START), feet, duration=78.5, step=0.04, events=strikes, inactive="right",
        integrator=rbd.DormandPrince8(rtol=1e-9, atol=1e-11, longest=0.2), progress=False,
    )  # fmt: skip
    times = np.array([event.t for event in walk.events if event.name.endswith("strikes")])
    samples = np.searchsorted(walk.t, times)
    after = np.array([angles(walk.state(i), SIDES[1 - k % 2]) for k, i in enumerate(samples)])
    periods, last = np.diff(np.r_[0.0, times]), samples[-1]
    n, stride = len(times), walk.com[last, 0] - walk.com[samples[-2], 0]
    lost, given = walk.energy[last - 1] - walk.energy[last], robot.mass * G * np.sin(SLOPE) * stride
    result = Result(walk, after, periods, lost, given)
    print(f"{n} steps in {times[-1]:.2f} s down a slope of {np.degrees(SLOPE):.2f} deg, {walk.com[-1, 0]:.1f} m.")
    print("  step    period        angle of the new stance leg")
    for k in (0, 1, 2, 5, 10, 20, 50, n - 1):
        print(f"  {k + 1:4d}   {periods[k]:.7f} s   {np.degrees(after[k, 0]):.6f} deg")
    print(f"Length of a step {stride:.4f} m, speed {stride / periods[-1]:.4f} m/s.")
    print(f"A strike takes {lost:.6f} J, and the slope gives {given:.6f} J a step.")
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.0, 9.0), layout="constrained")
        plot_walk(figure.subplots(3, 1), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/33_passive_walker.png", dpi=150)
        print(f"See out/33_passive_walker.png and {walk[:160].export('out/33_passive_walker.html')}.")
    return result


def plot_walk(axes, result: Result) -> list:
    """Four steps, how fast the gait converges, and the left leg in its phase plane."""
    (legs, phase, error), walk, artists = axes, result.walk, []
    arc = np.linspace(-0.5, 0.5, 20)
    for i in range(0, 80, 4):
        hip = walk.state(i).frame("left").X_WF.translation
        for side, color in zip(SIDES, ("#0072b2", "#d55e00"), strict=True):
            centre = walk.state(i).frame(f"{side}_foot").X_WF.translation
            lean = np.arctan2(hip[0] - centre[0], hip[2] - centre[2])
            foot = np.array([centre[0] - FOOT * np.sin(lean + arc), centre[2] - FOOT * np.cos(lean + arc)])
            artists += legs.plot([hip[0], foot[0, 10]], [hip[2], foot[1, 10]], color=color, lw=1.2, alpha=0.7)
            artists += legs.plot(*foot, color=color, lw=1.2, alpha=0.7)
    legs.axhline(0.0, color="0.4", lw=0.8)
    legs.set(aspect="equal", xlabel="along the slope [m]", ylabel="normal to it [m]", title="The first steps")
    strikes = np.searchsorted(walk.t, np.cumsum(result.periods) - 1e-9)
    left = np.insert(np.degrees(np.unwrap(np.arctan2(walk.q[:, 3], walk.q[:, 2]))), strikes, np.nan)
    artists += phase.plot(left, np.insert(walk.v[:, 2], strikes, np.nan), color="#0072b2", lw=0.7)
    phase.set(xlabel="left leg from the normal [deg]", ylabel="its rate [rad/s]", title="Its way to the limit cycle")
    off = np.abs(result.after - result.after[-1]).max(axis=1)[:-20]
    artists += error.semilogy(np.arange(1, len(off) + 1), off, color="#0072b2")
    error.set(xlabel="step", ylabel="off the last one [rad, rad/s]", title="How far a step is from the hundredth")
    return artists


def check(result: Result) -> None:
    """A hundred steps, the same at the end; the balance of energy; the period of the planar equations."""
    assert len(result.periods) >= 100
    assert np.abs(result.after[-1] - result.after[-2]).max() < 1e-7
    assert abs(result.lost - result.given) < 1e-7
    assert abs(result.periods[-1] * np.sqrt(G) - 2.42795584) < 1e-6  # of that test
    assert result.walk.residuals["drift"].max() < 1e-9


if __name__ == "__main__":
    check(main())
