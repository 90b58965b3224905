"""Steps of many worlds beside MuJoCo's `mj_step` of the same robot, contacts and step, by turns on one thread.

Solo12, Talos and G1 sway on their feet, held by the torques of `bench_simulation`; are kicked, so that their feet slip and
touch down; and fall without torques on feet and knees as points, MuJoCo with balls there, for as long.
Then the work at an error: a sway of half a second beside `rbd.simulate` and MuJoCo's hard contacts. Run by `make bench`.
"""

from __future__ import annotations

import statistics
import time
import warnings

import numpy as np
from bench_simulation import FRICTION, STEP, Bench, InMujoco
from bench_timing import CLOCK, Row

import rbd
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.errors import RbdWarning
from rbd.worlds import Servo, Worlds

N, TURN, ROUNDS, KICK, FALL_STEPS = 128, 200, 4, 0.5, 1_000
ROBOTS = ("solo12", "talos", "g1")
BALL_MARKS, SOLE_MARKS, SLIP_MARKS, FALL_MARKS = (0.3, 0.15), (0.4, 0.2), (1.0, 0.5), (1.5, 0.8)
THREAD_MARKS, WORK_MARKS = (1.0 / 1.7,), (1.0,)
KNEES = ("FL_LOWER_LEG", "FR_LOWER_LEG", "HL_LOWER_LEG", "HR_LOWER_LEG", "leg_left_4_link", "leg_right_4_link")
KNEES += ("left_knee_link", "right_knee_link")
SWAY_S, FINE = 0.5, 2e-4


def world_rows() -> list[Row]:
    """Steps of a world in `mj_step`s, two threads over one, and the work at MuJoCo's error."""
    benches = {name: Bench.of(name) for name in ROBOTS}
    still = {name: _held(bench, 0.0) for name, bench in benches.items()}
    soles = {name: x for name, x in still.items() if name != "solo12"}
    return [
        Row("a step of one of many worlds, swaying on balls", {"solo12": still["solo12"]}, "mj_step", BALL_MARKS),
        Row("swaying on soles", soles, "mj_step", SOLE_MARKS),
        Row("feet that slip and touch down", {name: _held(b, KICK) for name, b in benches.items()}, "mj_step", SLIP_MARKS),
        Row("falling on feet and knees", {name: _falls(b) for name, b in benches.items()}, "mj_step", FALL_MARKS),
        Row("two threads over one, on the clock", {"talos": _threads(benches["talos"])}, "x", THREAD_MARKS),
        Row("a sway as exact as MuJoCo's hard contacts", {n: _work(b) for n, b in benches.items()}, "x its time", WORK_MARKS),
    ]


def servo_of(bench: Bench) -> Servo:
    """The torques of `bench_simulation`."""
    held = bench.held
    return Servo(held.stiffness, held.damping, target=held.posture, torque=held.torque, limited=False)


def _ours(worlds: Worlds, steps: int) -> float:
    start = time.thread_time()
    worlds.advance(steps)
    return (time.thread_time() - start - CLOCK) / steps / worlds.n


def _held(bench: Bench, kick: float) -> float:
    """Of worlds that sway, or whose velocities are random."""
    ours, theirs, rng = list[float](), list[float](), np.random.default_rng(1)
    q, v = np.tile(bench.swaying.q, (N, 1)), np.tile(bench.swaying.v, (N, 1))
    for _ in range(ROUNDS):
        thrown = kick * rng.normal(size=v.shape) if kick else v
        ours.append(_ours(Worlds(bench.swaying.robot, bench.feet, q, thrown, step=STEP, controller=servo_of(bench)), TURN))
        twin = InMujoco(bench.swaying.with_velocity(thrown[0]), bench.feet)
        theirs.append(twin.steps(TURN, bench.held) / TURN)
    return statistics.median(ours) / statistics.median(theirs)


def _falls(bench: Bench) -> float:
    robot, rng = bench.swaying.robot, np.random.default_rng(1)
    frames = {frame.name for frame in robot.model.frames}
    knees = [PointContact(f"knee {name}", name, friction=FRICTION, on=0.0) for name in KNEES if name in frames]
    contacts: list[PointContact | SurfaceContact] = [*bench.feet, *knees]
    ours, theirs = list[float](), list[float]()
    q = np.tile(bench.swaying.q, (N, 1))
    for _ in range(2):
        v = 0.1 * rng.normal(size=(N, robot.nv))
        ours.append(_ours(Worlds(robot, contacts, q, v, step=STEP), FALL_STEPS))
        theirs.append(InMujoco(bench.swaying.with_velocity(v[0]), contacts).steps(FALL_STEPS, None) / FALL_STEPS)
    return statistics.median(ours) / statistics.median(theirs)


def _threads(bench: Bench) -> float:
    seconds: dict[int, list[float]] = {1: [], 2: []}
    q, v = np.tile(bench.swaying.q, (2 * N, 1)), np.tile(bench.swaying.v, (2 * N, 1))
    worlds = {
        k: Worlds(bench.swaying.robot, bench.feet, q, v, step=STEP, controller=servo_of(bench), threads=k) for k in seconds
    }
    for _ in range(ROUNDS):
        for threads, some in worlds.items():
            start = time.perf_counter()
            some.advance(TURN)
            seconds[threads].append(time.perf_counter() - start)
    return min(seconds[2]) / min(seconds[1])


def _work(bench: Bench) -> float:
    """Our processor time for a world over MuJoCo's at steps of 1 ms, by steps with which the joints' error is no larger."""
    start, robot = bench.swaying, bench.swaying.robot
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)
        fine = rbd.simulate(
            start, bench.feet, duration=SWAY_S, step=FINE, controller=bench.held, record_every=10**6, progress=False
        ).state(-1)
    theirs = InMujoco(start, bench.feet)
    theirs.model.geom_solref[:] = (2.0 * STEP, 1.0)
    theirs.model.geom_solimp[:] = (0.9999, 0.9999, 0.001, 0.5, 2.0)
    begin = time.thread_time()
    theirs.steps(round(SWAY_S / STEP), bench.held)
    cost = time.thread_time() - begin
    joints = theirs.data.qpos[theirs.qpos]
    error = float(np.abs(joints - fine.q[7:]).max())
    q, v, step = np.tile(start.q, (N, 1)), np.tile(start.v, (N, 1)), STEP
    while True:  # the longest step, from MuJoCo's on, that is as accurate
        worlds = Worlds(robot, bench.feet, q, v, step=step, controller=servo_of(bench))
        begin = time.thread_time()
        worlds.advance(round(SWAY_S / step))
        spent = (time.thread_time() - begin) / N
        if np.abs(worlds.q[0, 7:] - fine.q[7:]).max() <= error:
            return spent / cost
        step *= 0.5
