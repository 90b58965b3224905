"""A wheel cannot move sideways: can a unicycle be parked sideways all the same?

Its wheel rolls without slipping: two constraints of velocity, none of position. Frobenius' test says that they cannot be
integrated: brackets of the two velocities that are left reach every configuration nearby. So forward, turn, back, turn back
ends to the side. And its motor: how does it accelerate?
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

import rbd
from rbd.mechanism import Integrability, integrability, mobility, velocity_partition

TORQUE = 2.0  # at the wheel [N m]


@dataclass(frozen=True)
class Result:
    """What Frobenius says, how far four small moves go, and what the wheel's motor does."""

    frobenius: Integrability
    freedoms: int
    steps: np.ndarray
    aside: np.ndarray
    acceleration: float
    expected: float


def main(show: bool = True) -> Result:
    robot = rbd.load_robot("unicycle")
    wheel = robot.wheels()
    state = robot.at()
    freedoms = mobility(state, wheel).instantaneous
    frobenius = integrability(robot.at(), wheel)
    dof = frobenius.configuration_dof
    print(f"{freedoms} degrees of freedom of velocity, {dof} of configuration: growth vector {frobenius.growth}.")
    print(f"Are the wheel's constraints holonomic? {'yes' if frobenius.holonomic else 'no'}.")
    steps = np.array([0.4, 0.2, 0.1, 0.05])
    ends = [four_moves(robot, wheel, step) for step in steps]
    aside = np.array([np.abs(end[:2]).max() for end in ends])
    print("forward, turn, back, turn back:   each move   ends aside by   heading   over move^2")
    for step, end, y in zip(steps, ends, aside, strict=True):
        print(f"{step:41.2f} m, rad{y:12.5f} m{end[2] + 0.0:10.4f}{y / step**2:12.3f}".replace("-0.0000", " 0.0000"))
    driven = rbd.solve(state, motors(robot, TORQUE), wheel, solver=rbd.KKT())
    expected = rolling_acceleration(robot)
    forward = float(np.linalg.norm(driven.a[:2]))
    print(f"{TORQUE} N m at the wheel: {forward:.4f} m/s2; by Newton for a rolling wheel {expected:.4f} m/s2. {driven.status}.")
    if show:
        from rbd.visual import Scene

        Path("out").mkdir(exist_ok=True)
        with Scene(robot) as scene:
            scene.show(state)
            scene.beside({"after four moves": rbd.State(robot, moved(robot, wheel, 0.8)[-1])})
            print(f"See {scene.export('out/12_unicycle.html')}.")
    return Result(frobenius, freedoms, steps, aside, forward, expected)


def four_moves(robot: rbd.Robot, wheel, step: float) -> np.ndarray:
    """(x, y, heading) after forward, turn left, back, turn right, each as far as `step`."""
    q = moved(robot, wheel, step)[-1]
    return np.array([q[0], q[1], np.arctan2(q[3], q[2])])


def moved(robot: rbd.Robot, wheel, step: float, pieces: int = 50) -> list[np.ndarray]:
    """The configurations at the ends of the four moves."""
    q, out = robot.at().q, []
    for known in (forward_at(1.0), turn_at(1.0), forward_at(-1.0), turn_at(-1.0)):
        for _ in range(pieces):
            v = velocity_partition(rbd.State(robot, q), wheel, known).v
            q = pin.integrate(robot.model, q, v * step / pieces)
        out.append(q)
    return out


def forward_at(speed: float) -> dict[str, float]:
    """Known velocities of the base: ahead, without turning."""
    return {"root_joint.vx": speed, "root_joint.wz": 0.0}


def turn_at(rate: float) -> dict[str, float]:
    """Known velocities of the base: turning on the spot."""
    return {"root_joint.vx": 0.0, "root_joint.wz": rate}


def motors(robot: rbd.Robot, torque: float) -> np.ndarray:
    """Torque at the wheel, nothing elsewhere."""
    return np.array([torque if name == "wheel_joint" else 0.0 for name in robot.actuated_names])


def rolling_acceleration(robot: rbd.Robot) -> float:
    """T / r over m + I / r^2, the whole mass and the wheel's inertia about its axle."""
    wheel, radius = robot.model.inertias[robot.joint_id("wheel_joint")], robot.wheels()[0].radius
    axle = float(np.diag(wheel.inertia)[1])
    return TORQUE / radius / (robot.mass + axle / radius**2)


def check(result: Result) -> None:
    """Nonholonomic; a bracket goes with the square of the moves; Newton's law of a driven wheel."""
    assert not result.frobenius.holonomic and result.freedoms == 2
    assert result.frobenius.growth[0] == 2 and result.frobenius.configuration_dof == 4
    order = np.log2(result.aside[:-1] / result.aside[1:])
    assert np.abs(order[-1] - 2.0) < 0.05, "aside by the square of the moves: the bracket of forward and turn"
    assert abs(result.acceleration - result.expected) < 1e-9 * result.expected


if __name__ == "__main__":
    check(main())
