"""How do I load my own robot, if all I have is its URDF?

The walker of `urdf/walker.urdf` has no SRDF, no named posture and no named feet. Three things are needed: the names of
its feet, angles with which it stands, and the report of the model check (the doctor).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

URDF = Path(__file__).parents[1] / "urdf" / "walker.urdf"  # put the path of yours here
FEET = ["left_foot", "right_foot"]  # names of links
BEND = 0.5  # knees [rad]; hips and ankles take half of it each, so that torso and soles stay level


@dataclass(frozen=True, eq=False)
class Result:
    """The walker, what holds it, and its answer to a push."""

    robot: rbd.Robot
    report: rbd.robots.ModelReport
    soles: list[rbd.SurfaceContact]
    held: rbd.Actuation
    solution: rbd.Solution


def bent_knees(robot: rbd.Robot) -> rbd.State:
    """Knees bent, feet on the ground: angles by joint name, then the base placed."""
    bends = {"hip_pitch": -BEND / 2, "knee": BEND, "ankle_pitch": -BEND / 2}
    angles = {f"{side}_{joint}": angle for side in ("left", "right") for joint, angle in bends.items()}
    return rbd.robots.place_on_ground(robot.at().with_joints(angles), robot.feet())


def main(show: bool = True) -> Result:
    """Load, examine, stand, hold, push."""
    robot = rbd.load_robot(URDF, feet=FEET)
    report = rbd.doctor(robot)
    print(report)
    print(robot.joints["left_knee"])

    state = bent_knees(robot)
    soles = robot.soles(friction=0.6)  # robot.feet(), if some are points
    for sole in soles:
        print(f"{sole.name}: corners {np.round(sole.corners[:, :2], 3).tolist()} m")

    held = rbd.hold(state, soles)
    worst = held.worst_motor.split("_", 1)[1]  # left and right carry the same
    print(f"held: largest torque {100 * held.torque_use.max():.1f} % of its limit, by each {worst}")

    push = rbd.ExternalForce("torso", force=(15.0, 0.0, 0.0), offset=(0.0, 0.0, 0.3))
    solution = rbd.solve(state, held.tau, soles, external=push)
    print(solution)
    if show:
        from rbd.visual import Scene

        with Scene(robot) as scene:
            scene.show(state, solution, external=push)
            print("picture:", scene.export("walker.html"))
    return Result(robot, report, soles, held, solution)


def check(result: Result) -> None:
    """The doctor finds nothing broken, the feet carry the weight, the answer is certified."""
    assert result.report.ok
    weight = result.robot.mass * 9.81
    assert abs(sum(force[2] for force in result.held.forces.values()) - weight) < 1e-9
    assert result.solution.status == "solved"


if __name__ == "__main__":
    check(main())
