"""Cases of contact motion: where each starts, what it touches, and where it truly is at any time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
from closed_forms import (
    Ladder,
    RimlessWheel,
    RockingBlock,
    ball_on_cloth,
    bouncing_height,
    oscillator_with_dry_friction,
    symmetric_top,
)
from courses import Course, G, OnePoint, Tripod, falling_rod, pendulum_on_a_stop, rod_inertia
from flat_bodies import (
    ball,
    flat_body,
    flat_motion,
    flat_state,
    floor_point,
    free_body,
    free_motion,
    free_state,
    pendulum,
    slider,
)

import rbd
from rbd.arrays import Array


@dataclass(frozen=True, eq=False)
class Case:
    """A motion whose truth is known.

    Attributes:
        state: Where it starts.
        constraints: What it touches.
        truth: Coordinates at a time, without a contact solver.
        read: The same coordinates of a state.
        settings: Further arguments of `rbd.simulate`.
    """

    state: rbd.State
    constraints: Sequence[Any]
    truth: Callable[[float], Array]
    read: Callable[[rbd.State], Array] = flat_motion
    settings: dict[str, Any] = field(default_factory=dict)

    def run(self, duration: float, step: float, **more: Any) -> rbd.Trajectory:
        """Simulated."""
        given = self.settings | more
        return rbd.simulate(self.state, self.constraints, duration=duration, step=step, progress=False, **given)

    def error(self, trajectory: rbd.Trajectory, at: int = -1) -> float:
        """Largest difference from the truth [m, rad, m/s, rad/s], of the last moment, or of another."""
        k = at % len(trajectory)
        return float(np.abs(self.read(trajectory.state(k)) - self.truth(float(trajectory.t[k]))).max())


# -------------------------------------------------------------------------------------------------------- rods, ladders


def ladder(*, floor: float = 0.0, wall: float = 0.0, spatial: bool = False) -> Case:
    """A thin rod of 10 kg and 2 m from rest at 60 deg against a wall, its foot out at +x."""
    truth = Ladder(10.0, 1.0, rod_inertia(10.0, 1.0), math.pi / 3.0)
    course = truth.rough(1.0, floor, wall) if floor or wall else truth.course(1.0)
    start = truth.place(truth.start, 0.0)
    robot = free_body(10.0, [1e-3, truth.inertia, truth.inertia]) if spatial else flat_body(10.0, truth.inertia)
    ends = [
        floor_point("floor", (-1.0, 0.0), friction=floor),
        floor_point("wall", (1.0, 0.0), friction=wall, on=rbd.Ground(normal=(1.0, 0.0, 0.0))),
    ]
    return Case(flat_state(robot, start[:3], start[3:]), ends, course.at)


def rod_on_rough_table(friction: float) -> tuple[Case, Course]:
    """A thin rod of 10 kg and 2 m from rest at 10 deg from the vertical, its foot on the table."""
    course = falling_rod(10.0, 1.0, friction, math.radians(10.0), 3.0, flat=lambda t, y: -float(y[2]))
    start = course.at(0.0)
    state = flat_state(flat_body(10.0, rod_inertia(10.0, 1.0)), start[:3], start[3:])
    return Case(state, [floor_point("foot", (-1.0, 0.0), friction=friction)], course.at), course


def painleve_rod(friction: float, angle: float) -> tuple[rbd.State, list[rbd.PointContact], OnePoint, Array]:
    """A rod of 1 kg and 2 m raised by an angle, its lower, left end sliding at 1 m/s to the left, ahead of it."""
    body = OnePoint(1.0, rod_inertia(1.0, 1.0), (-1.0, 0.0), friction)
    start = np.array([math.cos(angle), math.sin(angle), -angle, -1.0, 0.0, 0.0])
    state = flat_state(flat_body(body.mass, body.inertia), start[:3], start[3:])
    return state, [floor_point("tip", (-1.0, 0.0), friction=friction)], body, start


# -------------------------------------------------------------------------------------------------- blocks on the ground


def sole(frame: str, half: tuple[float, float], depth: float, friction: float, **more: Any) -> rbd.SurfaceContact:
    """The underside of a block."""
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, -depth]))
    return rbd.SurfaceContact("sole", frame, half_lengths=half, placement=X, friction=friction, **more)


def block_thrown_up(brick: rbd.Robot, friction: float, slope: float = math.radians(25.0), speed: float = 3.0) -> Case:
    """The brick on its sole, thrown up an incline; coordinates are way and speed up the slope."""
    up, out = np.array([math.cos(slope), 0.0, math.sin(slope)]), np.array([-math.sin(slope), 0.0, math.cos(slope)])
    braked, back = (G * (math.sin(slope) + s * friction * math.cos(slope)) for s in (1.0, -1.0))
    stops = speed / braked

    def truth(t: float) -> Array:
        if t <= stops:
            return np.array([speed * t - braked * t * t / 2.0, speed - braked * t])
        s, a = t - stops, max(back, 0.0)
        return np.array([speed * stops / 2.0 - a * s * s / 2.0, -a * s])

    def read(state: rbd.State) -> Array:
        X, v, _ = free_motion(state)
        return np.array([up @ X.translation, up @ v])

    start = free_state(brick, 0.1 * out, (0.0, -slope, 0.0), speed * up)
    on = rbd.Ground(point=(0.0, 0.0, 0.0), normal=out)
    return Case(start, [sole("box", (0.2, 0.2), 0.1, friction, on=on)], truth, read)


def block_on_belt(brick: rbd.Robot, friction: float = 0.25, speed: float = 2.0) -> Case:
    """The brick put on a belt that runs along x, on its four corners; coordinates are way and speed."""
    reaches = speed / (friction * G)

    def truth(t: float) -> Array:
        s = min(t, reaches)
        return np.array([friction * G * s * s / 2.0 + speed * (t - s), friction * G * s])

    corners = [
        rbd.PointContact(f"c{i}", "box", offset=(x, y, -0.1), friction=friction, on=rbd.Ground(velocity=(speed, 0.0, 0.0)))
        for i, (x, y) in enumerate([(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)])
    ]
    return Case(free_state(brick, (0.0, 0.0, 0.1)), corners, truth, lambda s: np.array([s.q[0], s.v[0]]))


def toppling_crate(crate: rbd.Robot, push_N: float) -> Case:
    """The crate pushed at its middle, on a floor too rough to slide on; it turns about its front edge."""
    block = housner_block()

    def rate(t: float, y: Array) -> Array:
        lean = block.slenderness - y[0]
        torque = block.radius * (push_N * math.cos(lean) - block.mass * G * math.sin(lean))
        return np.array([y[1], torque / block.about_edge])

    course = Course()
    course.phase(rate, np.zeros(2), 0.0, 1.0, {}, lambda y: block.place(y, 1.0))
    state = flat_state(crate, (0.0, 0.5, 0.0))
    push = rbd.ExternalForce("crate", (push_N, 0.0, 0.0))
    return Case(state, [sole("crate", (0.2, 0.2), 0.5, 0.8)], course.at, settings={"external": push})


def housner_block() -> RockingBlock:
    """As large and heavy as the crate."""
    return RockingBlock(20.0, 0.2, 0.5, 20.0 * (0.4**2 + 1.0) / 12.0)


def rocking_block(tilt: float = 0.2, *, spatial: bool = False) -> tuple[Case, Course]:
    """Housner's block on rough ground, from rest at a tilt, on two edges, or in space on four corners."""
    block = housner_block()
    course = block.course(tilt, 3.0)
    start = block.place(np.array([tilt, 0.0]), 1.0)
    if spatial:
        robot = free_body(block.mass, [block.inertia, block.inertia, 0.5])
        at = [(x, y, -0.5) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    else:
        robot, at = flat_body(block.mass, block.inertia), [(x, 0.0, -0.5) for x in (-0.2, 0.2)]
    edges = [floor_point(f"edge{i}", p, friction=1.0) for i, p in enumerate(at)]
    return Case(flat_state(robot, start[:3], start[3:]), edges, course.at), course


def spinning_tripod() -> tuple[Case, Tripod]:
    """A disk of 2 kg and 0.15 m that slides and spins on three points; (x, y, turn, and their rates)."""
    tripod = Tripod(2.0, 0.0225, 0.05, 0.3, 0.15 * np.array([[1.0, 0.0], [-0.5, 0.75**0.5], [-0.5, -(0.75**0.5)]]))
    course = tripod.course(np.array([1.5, 0.0]), 20.0, 3.0)

    def read(state: rbd.State) -> Array:
        X, v, w = free_motion(state)
        return np.array([X.translation[0], X.translation[1], math.atan2(X.rotation[1, 0], X.rotation[0, 0]), v[0], v[1], w[2]])

    def truth(t: float) -> Array:
        y = course.at(t)[:6].copy()
        y[2] = math.remainder(y[2], 2.0 * math.pi)
        return y

    start = free_state(free_body(2.0, [0.01125, 0.01125, 0.0225]), (0.0, 0.0, 0.05), v=(1.5, 0.0, 0.0), w=(0.0, 0.0, 20.0))
    feet = [floor_point(f"foot{i}", (*p, -0.05), friction=0.3) for i, p in enumerate(tripod.points)]
    return Case(start, feet, truth, read), tripod


# --------------------------------------------------------------------------------------------------- wheels, balls, disks


def rimless_wheel(rate: float, feet: int, wheel: RimlessWheel) -> tuple[Case, Course]:
    """McGeer's wheel from just after an impact, with the first few of its feet; coordinates (x, z, turn, rate)."""
    a = wheel.half_angle
    along = np.array([math.cos(wheel.slope), -math.sin(wheel.slope)])
    out = np.array([math.sin(wheel.slope), math.cos(wheel.slope)])
    course = wheel.course(rate, 10.0)

    def hub(th: float, passed: float) -> Array:
        return along * (2.0 * wheel.leg * math.sin(a) * passed) + wheel.leg * (math.cos(th) * out + math.sin(th) * along)

    def truth(t: float) -> Array:
        th, w, passed = course.at(t)
        return np.array([*hub(th, passed), th + a + 2.0 * a * passed, w])

    robot = flat_body(1.0, wheel.j * wheel.leg**2, gravity=wheel.g)
    legs = [-wheel.leg * (math.cos(a + 2.0 * a * k) * out - math.sin(a + 2.0 * a * k) * along) for k in range(feet)]
    normal = (out[0], 0.0, out[1])
    points = [floor_point(f"foot{k}", tuple(leg), friction=1.0, on=rbd.Ground(normal=normal)) for k, leg in enumerate(legs)]
    v = rate * wheel.leg * (math.cos(a) * along + math.sin(a) * out)
    state = flat_state(robot, (*hub(-a, 0.0), 0.0), (*v, rate))
    return Case(state, points, truth, lambda s: np.array([*s.q, s.v[2]])), course


def billiard_ball(v: Sequence[float], w: Sequence[float] = (0.0, 0.0, 0.0), friction: float = 0.3) -> Case:
    """A ball of 2 kg and 0.1 m on a level plane; coordinates are its way, v and r w, each (3,)."""
    r, v, w = 0.1, np.asarray(v, float), np.asarray(w, float)

    def truth(t: float) -> Array:
        way, now, spin, _ = ball_on_cloth(v, w, r, friction, t)
        return np.concatenate([way + [0.0, 0.0, r], now, r * spin])

    def read(state: rbd.State) -> Array:
        X, now, spin = free_motion(state)
        return np.concatenate([X.translation, now, r * spin])

    touch = rbd.RollingBall("ball", "body", radius=r, friction=friction)
    return Case(free_state(ball(2.0, r), (0.0, 0.0, r), v=v, w=w), [touch], truth, read)


def sliding_disk(speed: float = 2.0, friction: float = 0.3) -> Case:
    """A uniform disk of 2 kg and 0.25 m, thrown upright without spin; coordinates x, z, v and r w: it rolls at 2/3 v."""
    r = 0.25
    rolls = speed / (3.0 * friction * G)

    def truth(t: float) -> Array:
        s = min(t, rolls)
        v = speed - friction * G * s
        return np.array([speed * s - friction * G * s * s / 2.0 + v * (t - s), r, v, 2.0 * friction * G * s])

    def read(state: rbd.State) -> Array:
        X, v, w = free_motion(state)
        return np.array([X.translation[0], X.translation[2], v[0], r * w[1]])

    robot = free_body(2.0, [r * r / 2.0, r * r, r * r / 2.0])
    touch = rbd.RollingDisk("rim", "body", radius=r, friction=friction)
    return Case(free_state(robot, (0.0, 0.0, r), v=(speed, 0.0, 0.0)), [touch], truth, read)


def bouncing_ball(restitution: float) -> Case:
    """A ball dropped from 1 m, of 0.1 m; coordinates are its height above the floor, and its velocity."""
    return Case(
        free_state(ball(2.0, 0.1), (0.0, 0.0, 1.1)),
        [rbd.RollingBall("ball", "body", radius=0.1, friction=0.5)],
        lambda t: np.array(bouncing_height(1.0, restitution, t)),
        lambda s: np.array([s.q[2] - 0.1, s.v[2]]),
        {"restitution": restitution},
    )


def symmetric_flight() -> Case:
    """A top thrown up from its tip, which touched; coordinates are its angular velocity in its own axes."""
    w = np.array([2.0, 1.0, 8.0])
    start = free_state(free_body(2.0, [0.3, 0.3, 0.1]), (0.0, 0.0, 0.1), v=(1.0, 0.0, 5.0), w=w)
    tip = floor_point("tip", (0.0, 0.0, -0.1), friction=0.5)
    return Case(start, [tip], lambda t: symmetric_top(0.1, 0.3, w, t), lambda s: s.v[3:])


# ---------------------------------------------------------------------------------------------------------------- joints


def stopped_pendulum(stop: float, restitution: float) -> tuple[Case, Course]:
    """A point of 1 kg on a bar of 1 m, from rest at 1 rad, and a stop; coordinates are angle and rate."""
    course = pendulum_on_a_stop(1.0, 1.0, stop, restitution, 2.0)
    limit = rbd.JointLimit("stop", "hinge", lower=stop)
    state = rbd.State(pendulum(1.0, 1.0), np.array([1.0]))
    return Case(state, [limit], course.at, lambda s: np.concatenate([s.q, s.v]), {"restitution": restitution}), course


def rubbed_oscillator() -> Case:
    """1 kg on 100 N/m with 5 N of dry friction, from rest at 0.33 m; coordinates are way and speed."""
    return Case(
        rbd.State(slider(1.0), np.array([0.33])),
        [rbd.JointFriction("rub", "slide", 5.0)],
        lambda t: np.array(oscillator_with_dry_friction(1.0, 100.0, 5.0, 0.33, t)),
        lambda s: np.concatenate([s.q, s.v]),
        {"external": lambda state, t: -100.0 * state.q},
    )
