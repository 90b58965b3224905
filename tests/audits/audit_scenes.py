"""Records of exact answers and motions, and faults planted into them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import rbd
from rbd.audits import Record, from_solutions, from_trajectory
from rbd.audits.kinematics import balance_of

ROBOTS = ("solo12", "talos", "g1", "anymal_c")


@cache
def robot(name: str) -> rbd.Robot:
    """One of the catalogue."""
    return rbd.load_robot(name)


def standing(name: str, n: int, seed: int) -> Record:
    """A robot on its feet, its torques and pushes drawn at random: some stick, some slip, some leave the ground."""
    rng, owner = np.random.default_rng(seed), robot(name)
    state, feet, found = owner.standing(), owner.feet(friction=0.5), []
    weight = 9.81 * owner.mass
    hold = rbd.inverse_dynamics(state, np.zeros(owner.nv), feet).tau
    while len(found) < n:
        push = rbd.ExternalForce(owner.feet()[0].frame, weight * rng.normal(0.0, 0.15, 3))
        tau = hold * (1.0 + 0.1 * rng.normal(size=owner.nu))
        found.append(rbd.solve(state, tau, feet, external=[push]))
    return from_solutions(found)


def sliding(friction: float = 0.5, speed: float = 1.0, tilt: float = 0.0) -> Record:
    """A box that slides on its face until it stops."""
    box = rbd.testing.box(mass=10.0)
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=friction, on=0.0)
    gravity = 9.81 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
    start = rbd.State(box.with_gravity(gravity), [0, 0, 0, 0, 0, 0, 1], [speed, 0.3 * speed, 0, 0, 0, 0])
    return from_trajectory(rbd.simulate(start, [floor], duration=0.4, step=0.01, progress=False), [floor])


def stacked() -> Record:
    """A box that is pushed over another one, which rests on the floor."""
    boxes = rbd.robots.merge_robots(rbd.testing.box(mass=10.0), rbd.testing.box(mass=2.0))
    floor = rbd.SurfaceContact("floor", "a_box", half_lengths=(0.2, 0.2), friction=0.6)
    upper = rbd.SurfaceContact("stacked", "b_box", half_lengths=(0.1, 0.1), on=rbd.Body("a_box"), friction=0.3)
    state = boxes.at([0, 0, 0.1, 0, 0, 0, 1, 0, 0, 0.3, 0, 0, 0, 1])
    pushes = [rbd.ExternalForce("b_box", (x, 0.4 * x, 0.0)) for x in (0.0, 2.0, 5.0, 8.0, 12.0)]
    return from_solutions([rbd.solve(state, [], [floor, upper], external=[push]) for push in pushes])


def scenes() -> Iterator[tuple[str, Callable[[], Record]]]:
    """Twenty: (name, what makes it)."""
    for name in ROBOTS:
        for seed in range(3):
            yield f"{name} {seed}", partial(standing, name, 4, seed)
    for mu, speed, tilt in (
        (0.5, 1.0, 0.0),
        (0.2, 0.5, 0.0),
        (0.8, 2.0, 0.0),
        (0.5, 1.0, 0.2),
        (0.3, 0.2, 0.1),
        (1.2, 1.5, -0.3),
    ):
        yield f"box {mu} {speed} {tilt}", partial(sliding, mu, speed, tilt)
    yield "two boxes", stacked
    yield "solo12 falls", falling


@cache
def falling() -> Record:
    """Solo12 without torques, dropped from 2 cm: impacts, slips, joints that fold."""
    solo = robot("solo12")
    q = np.array(solo.standing().q)
    q[2] += 0.02
    feet = solo.feet(friction=0.6)
    run = rbd.simulate(rbd.State(solo, q), feet, duration=0.15, step=0.002, progress=False)
    return from_trajectory(run, feet)


def loaded(record: Record) -> int:
    """A point that pushes hard and drags, of a frame in the middle."""
    push, along = np.linalg.norm(record.forces, axis=1), np.einsum("ki,ki->k", record.forces, record.normals)
    drag = np.linalg.norm(record.forces - along[:, None] * record.normals, axis=1)
    return int(np.argmax(push * (drag > 0.02 * push)))


def _with_force(record: Record, i: int, f: np.ndarray) -> Record:
    forces = record.forces.copy()
    forces[i] = f
    return replace(record, forces=forces)


def scaled(record: Record, i: int) -> Record:
    """A force 5 % too large."""
    return _with_force(record, i, 1.05 * record.forces[i])


def turned(record: Record, i: int) -> Record:
    """A force turned by 20 degrees about the vertical."""
    axis = np.cross(record.forces[i], [1.0, 0.3, 0.0])
    turn = Rotation.from_rotvec(np.radians(20.0) * axis / np.linalg.norm(axis))
    return _with_force(record, i, turn.apply(record.forces[i].copy()))


def stale(record: Record, i: int) -> Record:
    """A contact that is listed once more, beside its place, with the force that it had."""
    order = np.insert(np.arange(len(record.contact_at)), i, i)
    names = ("contact_at", "contact_bodies", "points", "normals", "friction", "forces", "gaps")
    fields = {name: getattr(record, name)[order].copy() for name in names}
    fields["points"][i] += (0.013, 0.007, 0.0)
    return replace(record, **fields)


def reversed_friction(record: Record, i: int) -> Record:
    """Friction in the direction of the motion."""
    push = (record.forces[i] @ record.normals[i]) * record.normals[i]
    return _with_force(record, i, 2.0 * push - record.forces[i])


def pulling(record: Record, i: int) -> Record:
    """A point that pulls."""
    push = (record.forces[i] @ record.normals[i]) * record.normals[i]
    return _with_force(record, i, record.forces[i] - 1.5 * push)


def consistent(record: Record, faulty: Record) -> Record:
    """A faulty record whose accelerations follow from its forces: only the law is wrong."""
    a, data, model = record.a.copy(), record.robot.model.createData(), record.robot.model
    change = balance_of(replace(faulty, a=record.a)).missing
    for i in np.flatnonzero(np.abs(change).max(axis=1) > 0.0):
        M = pin.crba(model, data, record.q[i], pin.Convention.WORLD)
        a[i] -= np.linalg.solve(M, change[i])
    return replace(faulty, a=a)


FAULTS = {"scaled": scaled, "turned": turned, "stale": stale, "friction sign": reversed_friction, "pulling": pulling}
