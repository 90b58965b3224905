"""A box that falls on its four corners and stays: samples in closed form, made without any integrator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.simulation.simulated_motion import ConstraintForce, Event, Sample, SimulatedMotion
from rbd.testing import box

GRAVITY = 9.81
MASS = 10.0
WEIGHT = MASS * GRAVITY
CORNERS = np.array([[0.2, 0.2, 0.0], [-0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.2, -0.2, 0.0]])
HALF = 0.1
ODD_NAME = "Fuß / 1"


@dataclass(frozen=True)
class Force:
    """A constraint of which only the name is asked."""

    name: str


def falling(
    robot: CheckedModel | None = None, n: int = 11, height: float = 1.0
) -> tuple[SimulatedMotion, list[Sample], list[Event]]:
    """From `height` above the floor, n samples in twice the time of the fall; lands plastically."""
    robot = box(MASS) if robot is None else robot
    motion = SimulatedMotion(robot, (Force("floor"), Force("stop"), Force(ODD_NAME)))
    t1 = math.sqrt(2.0 * height / GRAVITY)
    impulse = MASS * GRAVITY * t1
    events = [Event(t1, "floor", "touches", k, speed=GRAVITY * t1, impulse=impulse / 4.0) for k in range(4)]
    return motion, [sample(robot, t, t1, height) for t in np.linspace(0.0, 2.0 * t1, n)], events


def sample(robot: CheckedModel, t: float, t1: float, height: float) -> Sample:
    """Free fall until t1, rest after it."""
    falls = t < t1
    q, v, a = np.zeros(robot.nq), np.zeros(robot.nv), np.zeros(robot.nv)
    q[6] = 1.0
    q[2] = HALF + (height - 0.5 * GRAVITY * t * t if falls else 0.0)
    v[2] = -GRAVITY * t if falls else 0.0
    a[2] = -GRAVITY if falls else 0.0

    def touches() -> dict[str, ConstraintForce]:
        if falls:
            one = np.array([[0.2, 0.0, 0.0]])
            return {
                "floor": ConstraintForce(np.zeros(3), "open", np.zeros((0, 3)), np.zeros((0, 3))),
                ODD_NAME: ConstraintForce(np.array([0.0, 1.0, 2.0]), "slips", one, np.array([[0.0, 1.0, 2.0]])),
            }
        pressed = np.tile([0.0, 0.0, WEIGHT / 4.0], (4, 1))
        return {"floor": ConstraintForce(np.array([0.0, 0.0, WEIGHT]), "sticks", CORNERS, pressed)}

    state = rbd.State(robot, q, v)
    return Sample.of(t, state, a, np.zeros(robot.nu), touches, law=1e-12, penetration=0.0 if falls else 1e-5)
