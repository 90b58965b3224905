"""Can Talos walk six steps, on the friction of its soles and within the limits of its motors?

`rbd.control.Walk` puts down feet where the standing robot has them, seen from a body that moves on; finds a motion of the
centre of mass over them whose forces are in the friction cones of the soles that stand, at all times; and at each step of
control the torques that follow it as well as friction and motors allow. G1 walks too:
`python examples/28_talos_walks.py g1`.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

FRICTION, STEPS, STEP = 0.7, 6, 2e-3


@dataclass(frozen=True)
class Result:
    """What the robot did, and the controller with its plan and its log."""

    walk: rbd.Trajectory
    controller: rbd.control.Walk


def walked(name: str, duration: float | None = None) -> Result:
    """The motion, to its end or for a time [s]."""
    controller = rbd.control.Walk(rbd.load_robot(name), STEPS, friction=FRICTION)
    lasting = controller.duration if duration is None else duration
    walk = rbd.simulate(controller.state, controller.contacts, duration=lasting, step=STEP, controller=controller)
    return Result(walk, controller)


def main(show: bool = True, name: str = "talos") -> Result:
    result = walked(name)
    walk, controller = result.walk, result.controller
    robot, log = walk.robot, controller.log
    print(f"{controller}; when each foot lands, how far it has come, how fast it touches")
    for step in controller.plan.footsteps:
        t, x, speed = landing(result, step)
        print(f"  {step.foot:<12} {t:4.1f} s {x:8.3f} m {speed:8.1f} m/s")
    share = log.torque_use.max(axis=0)
    joint = robot.actuated_names[share.argmax()].replace("_left", "").replace("_right", "")  # both sides take nearly as much
    print(f"The largest torque is {100.0 * share.max():.0f} % of its limit, at {joint} of one leg.")
    print(f"In {log.violations} of {len(log)} steps of control a contact or a joint limit could not be kept;")
    print(f"torques, forces and accelerations have residuals of at most {log.residual.max():.0e}.")
    if show:
        Path("out").mkdir(exist_ok=True)
        print(f"See {walk.export('out/28_talos_walks.html', plan=controller.plan)}.")
    return result


def landing(result: Result, step: rbd.control.Footstep) -> tuple[float, float, float]:
    """When a foot is down [s], how far it has come [m], how fast a corner touched at most [m/s]."""
    walk = result.walk
    touches = [e for e in walk.events if e.name == step.foot and e.kind == "touches" and abs(e.t - step.end) < 0.25]
    x = np.nanmean(walk.points[step.foot][..., 0], axis=1)
    return touches[-1].t, float(x[np.searchsorted(walk.t, touches[-1].t)] - x[0]), max(e.speed for e in touches)


def check(result: Result) -> None:
    """The feet land where and as slowly as planned, no torque is beyond its limit, and every step of control had an answer."""
    controller, walk = result.controller, result.walk
    for step in controller.plan.footsteps:
        _, x, speed = landing(result, step)
        assert abs(x - (step.pose.translation - controller.plan.poses[step.foot].translation)[0]) < 1e-3 and speed < 0.1
    assert (np.abs(walk.tau) <= walk.robot.effort_limit).all()
    assert controller.log.violations == 0 and controller.log.residual.max() < 1e-9


if __name__ == "__main__":
    check(main(name=sys.argv[1] if len(sys.argv) > 1 else "talos"))
