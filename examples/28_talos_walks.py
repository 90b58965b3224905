"""Can Talos walk six steps, on the friction of its soles and within the limits of its motors?

The plan: while one foot swings, the zero-moment point p stays below the other; then it moves on in a straight line. The
centre of mass c at a constant height z follows from p = c - (z / g) c'', at all times together a tridiagonal system
[Kajita2003], and so leans aside before a foot is lifted. At each time step `rbd.control.WholeBodyController` finds the torques
that follow the plan as well as friction and motors allow. G1 walks too: `python examples/28_talos_walks.py g1`.
"""

import math
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.linalg import solveh_banded

import rbd
from rbd.control import ComTask, ContactSchedule, FrameTask, MomentumTask, PostureTask, Reference, WholeBodyController

FRICTION, GRAVITY, STEP = 0.7, 9.81, 2e-3
STEPS, LENGTH, HEIGHT = 6, 0.2, 0.05  # [m]
START, SWING, SHIFT, END = 1.3, 0.7, 0.3, 0.8  # before the first step, on one foot, on both, after the last [s]
SINKING = 0.03  # of a foot that does not touch when it should [m/s]
TORSO = {"talos": "torso_2_link", "g1": "torso_link"}


class Plan:
    """Footsteps, the zero-moment point below the feet, and the centre of mass above it."""

    def __init__(self, state: rbd.State, soles: list[rbd.SurfaceContact]) -> None:
        self.poses = {sole.name: state.frame(sole.frame).X_WF for sole in soles}
        centres = {sole.name: (self.poses[sole.name] * sole.placement).translation[:2] for sole in soles}
        feet = sorted(centres, key=lambda foot: centres[foot][1])  # the right one first
        self.swings, changes = [], {foot: [] for foot in feet}
        times, points, t, x = [0.0, START - SHIFT], 2 * [state.com[:2]], START, dict.fromkeys(feet, 0.0)
        for i in range(STEPS):
            foot, other = feet[i % 2], feet[1 - i % 2]
            target = x[other] + (LENGTH if i < STEPS - 1 else 0.0)  # the last one beside the other
            self.swings.append((t, foot, x[foot], target))
            x[foot] = target
            changes[foot] += [t, t + SWING]
            times += [t, t + SWING]
            points += 2 * [centres[other] + [x[other], 0.0]]
            t += SWING + SHIFT
        times += [t, t + END]
        points += 2 * [state.com[:2] + [target, 0.0]]
        self.schedule = ContactSchedule({foot: np.reshape([-math.inf, *c, math.inf], (-1, 2)) for foot, c in changes.items()})
        self.t = np.arange(0.0, t + END, STEP)
        self.zmp = np.column_stack([np.interp(self.t, times, values) for values in np.transpose(points)])
        self.com = centre_of_mass(self.zmp, state.com[2])

    def com_at(self, t: float) -> Reference:
        """Position, velocity and acceleration."""
        i = min(round(t / STEP), len(self.t) - 1)
        return Reference(*[values[i] for values in self.com])

    def foot_at(self, foot: str, t: float) -> Reference:
        """Forward, up and down; then on down until it touches."""
        swings = [swing for swing in self.swings if swing[1] == foot]
        start, _, x, target = next((swing for swing in reversed(swings) if swing[0] <= t), swings[0])
        path = np.zeros((3, 6))  # position, velocity, acceleration
        path[0, 0] = x
        path[:, 0] += (target - x) * smooth(t - start, 0.9 * SWING)
        path[:, 2] = HEIGHT * (smooth(t - start, SWING / 2) - smooth(t - start - SWING / 2, SWING / 2))
        if t > start + SWING:
            path[:2, 2] -= SINKING * (t - start - SWING), SINKING
        X = self.poses[foot]
        return Reference(pin.SE3(X.rotation, X.translation + path[0, :3]), path[1], path[2])


def centre_of_mass(p: np.ndarray, z: float) -> tuple[np.ndarray, ...]:
    """c, c' and c'' where p = c - (z / g) c'', shape (n, 3) each; at rest at both ends."""
    k = z / GRAVITY / STEP**2
    bands = np.tile([[-k], [1.0 + 2.0 * k]], len(p))
    bands[1, [0, -1]] = 1.0 + k
    c = np.column_stack([solveh_banded(bands, p), np.full(len(p), z)])
    velocity = np.gradient(c, STEP, axis=0)
    return c, velocity, np.gradient(velocity, STEP, axis=0)


def smooth(t: float, T: float) -> np.ndarray:
    """From 0 to 1 in a time T, at rest at both ends, by a polynomial of degree five: value, velocity, acceleration."""
    u = min(max(t / T, 0.0), 1.0)
    return np.array([u**3 * (10 - 15 * u + 6 * u**2), 30 * (u - u**2) ** 2 / T, 60 * u * (1 - u) * (1 - 2 * u) / T**2])


@dataclass(frozen=True)
class Result:
    """What was planned, what the robot did, and the controller with its log."""

    plan: Plan
    walk: rbd.Trajectory
    controller: WholeBodyController


def controller_of(state: rbd.State, soles: list[rbd.SurfaceContact], plan: Plan, torso: str) -> WholeBodyController:
    """Follow the plan with the torso upright; as far as that leaves them free, the joints stay near their posture."""
    along = {sole.frame: partial(plan.foot_at, sole.name) for sole in soles}
    tasks = [
        ComTask(plan.com_at, cost=100.0, gain=60.0),
        *[FrameTask(foot, path, position_cost=100.0, orientation_cost=20.0, gain=400.0) for foot, path in along.items()],
        FrameTask(torso, state.frame(torso).X_WF.rotation, orientation_cost=10.0, gain=80.0),
        MomentumTask(angular_cost=(0.0, 0.0, 0.5 * state.robot.mass**2)),  # none about the vertical: the arms swing
        PostureTask(state.q, cost=0.05, gain=40.0),
    ]
    return WholeBodyController(tasks, soles, schedule=plan.schedule)


def main(show: bool = True, name: str = "talos") -> Result:
    robot = rbd.load_robot(name)
    state, soles = robot.standing(), robot.soles(friction=FRICTION)
    plan = Plan(state, soles)
    controller = controller_of(state, soles, plan, TORSO[name])
    walk = rbd.simulate(state, soles, duration=plan.t[-1], step=STEP, controller=controller)

    print(f"{robot.name}, {robot.mass:.1f} kg: when each foot is down, how far it has come, how fast its corners touched")
    for start, foot, *_ in plan.swings:
        t, x, speed = landing(walk, foot, start)
        print(f"  {foot:<12} {t:4.1f} s {x:8.3f} m {speed:8.2f} m/s")
    log, share = controller.log, (np.abs(walk.tau) / robot.effort_limit).max(axis=0)
    print(f"The largest torque is {100.0 * share.max():.0f} % of its limit, at {robot.actuated_names[share.argmax()]}.")
    print(f"In {log.violations} of {len(log)} steps of control a contact or a joint limit could not be kept;")
    print(f"torques, forces and accelerations have residuals of at most {log.residual.max():.0e}.")
    if show:
        Path("out").mkdir(exist_ok=True)
        print(f"See {walk.export('out/28_talos_walks.html')}.")
    return Result(plan, walk, controller)


def landing(walk: rbd.Trajectory, foot: str, start: float) -> tuple[float, float, float]:
    """When a foot that is lifted at `start` is down [s], how far it has come [m], how fast a corner touched at most [m/s]."""
    touches = [e for e in walk.events if e.name == foot and e.kind == "touches" and start < e.t < start + SWING + SHIFT]
    x = walk.points[foot][..., 0].mean(axis=1)
    return touches[-1].t, x[np.searchsorted(walk.t, touches[-1].t)] - x[0], max(e.speed for e in touches)


def check(result: Result) -> None:
    """The feet land where and as slowly as planned, no torque is beyond its limit, and every step of control had an answer."""
    for start, foot, _, target in result.plan.swings:
        _, x, speed = landing(result.walk, foot, start)
        assert abs(x - target) < 1e-3 and speed < 0.1
    assert (np.abs(result.walk.tau) <= result.walk.robot.effort_limit).all()
    assert result.controller.log.violations == 0 and result.controller.log.residual.max() < 1e-9


if __name__ == "__main__":
    check(main(name=sys.argv[1] if len(sys.argv) > 1 else "talos"))
