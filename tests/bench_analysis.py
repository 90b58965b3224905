"""What is measured in milliseconds and seconds, beside its marks.

Derivatives of answers, a Hessian, a row of linkages that swings, a fall; assembly, loading, regions and pushes.
"""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from bench_answers import CALLS, HELD, STICKING, UNIT
from bench_draws import Draws
from bench_peers import ConstraintDynamics
from bench_timing import DRAWS, Column, Row, interleaved, once, turns

import rbd
from rbd.errors import RbdWarning

URDF = Path(__file__).parents[1] / "urdf"
MILLISECONDS = {"assemble four-bar": 1.0, "assemble six-bar": 2.0, "load talos": 50.0, "load human": 50.0}
MILLISECONDS |= {"support region, pyramids": 50.0, "support region, cones": 50.0, "72 pushes": 200.0}
"""Marks of what has no `constraintDynamics` call to be measured by."""
DERIVATIVES_MARKS, HESSIAN_MARKS, LINKAGE_MARKS, FALL_MARKS = (20.0, 12.0), (0.5,), (10.0,), (4.0, 2.0)
FALL_SECONDS, FALL_STEP = 2.5, 1e-3
N, SWING_SECONDS, SWING_STEP = 40, 20.0, 0.01


def derivative_rows(everyone: Sequence[Draws]) -> list[Row]:
    """`solution.derivatives()` of answers that were just found, the answers not counted."""
    found: dict[str, dict[str, float]] = {kind: {} for kind in (HELD, STICKING)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)
        for d in everyone:
            draws = d.sticking()
            unit = statistics.median(turns({UNIT: ConstraintDynamics(d).column(draws)}, rounds=2)[UNIT])
            for kind, contacts in ((HELD, d.held), (STICKING, d.frictional)):
                times = []
                for q, v, tau in draws:
                    solution = rbd.solve(rbd.State(d.robot, q, v), tau, contacts)
                    times.append(once(solution.derivatives))
                found[kind][d.robot.name] = statistics.median(times[1:]) / unit
    return [Row(f"solution.derivatives(), {kind}", values, CALLS, DERIVATIVES_MARKS) for kind, values in found.items()]


def hessian_rows(robot: rbd.Robot) -> list[Row]:
    """`constraint_hessian` of a distance between two points of a robot, given as a function of q alone."""
    model, data = robot.model, robot.model.createData()
    hand, foot = (model.getFrameId(name) for name in ("gripper_left_base_link", "left_sole_link"))

    def apart(q: np.ndarray) -> float:
        pin.framesForwardKinematics(model, data, q)
        return float(np.linalg.norm(data.oMf[hand].translation - data.oMf[foot].translation))

    string = rbd.FunctionConstraint("string", apart)
    seconds = once(lambda: rbd.dynamics.constraint_hessian(robot.standing(), string))
    return [Row("constraint_hessian of a FunctionConstraint", {robot.name: seconds}, "s", HESSIAN_MARKS)]


def linkage_rows(duration: float = SWING_SECONDS) -> list[Row]:
    """A row of upright four-bars, their cranks turning at 1 rad/s, swings for 20 s at 10 ms by `RungeKutta4`."""
    robot = rbd.mechanism.n_four_bar(N)
    upright, loops = robot.at("assembled"), robot.loops()
    v = rbd.mechanism.velocity_partition(upright, loops, {"crank_0_joint": -1.0}).v
    start = upright.with_velocity(v)

    def swing() -> rbd.Trajectory:
        return rbd.simulate(start, loops, duration=duration, step=SWING_STEP, integrator=rbd.RungeKutta4(), progress=False)

    seconds = once(swing) * SWING_SECONDS / duration
    return [Row(f"n_four_bar({N}), {SWING_SECONDS:g} s at 10 ms, RungeKutta4", {"": seconds}, "s", LINKAGE_MARKS)]


def fall_rows(robot: rbd.Robot, duration: float = FALL_SECONDS) -> list[Row]:
    """A robot without torques falls from its standing posture, all its collision shapes touching the ground; 1 ms steps."""
    ground = rbd.CollisionContacts("ground", robot, friction=0.7)
    push = np.zeros(robot.nv)
    push[3:6] = 0.0, 0.3, 0.1  # turning forward: it would not know which way to fall
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)
        start, settings = robot.standing().with_velocity(push), {"step": FALL_STEP, "record_every": 10, "progress": False}
        rbd.simulate(start, [ground], duration=20 * FALL_STEP, **settings)  # what is compiled or prepared on first use
        seconds = once(lambda: rbd.simulate(start, [ground], duration=duration, **settings))
    what = f"falling {FALL_SECONDS:g} s, all shapes, 1 ms steps, a simulated second"
    return [Row(what, {robot.name: seconds / duration}, "s", FALL_MARKS)]


def assembling(robot: rbd.Robot) -> Column:
    """From 0.3 rad a joint off its posture (deviation of each), the crank fixed, onto the loops."""
    rng, q = np.random.default_rng(11), robot.posture("assembled")
    starts = [pin.integrate(robot.model, q, dq) for dq in 0.3 * rng.normal(size=(DRAWS, robot.nv))]
    fixed = {"crank_joint": q[:2]}
    return lambda i: rbd.mechanism.assemble(rbd.State(robot, starts[i]), fixed=fixed)


def standing(robot: rbd.Robot) -> dict[str, Column]:
    """Where a robot can stand on its soles, and how hard it can be pushed at its torso, all around."""
    state, soles, angle = robot.standing(), robot.soles(friction=0.7), np.arange(72) * (2.0 * np.pi / 72.0)
    ways = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(72)])
    return {
        "support region, pyramids": lambda i: rbd.statics.support_region(state, soles, friction="inscribed"),
        "support region, cones": lambda i: rbd.statics.support_region(state, soles),
        "72 pushes": lambda i: rbd.statics.push_limits(state, soles, "torso_2_link", ways),
    }


def millisecond_rows(talos: rbd.Robot) -> list[Row]:
    """Assembly of mechanisms, loading of robots, regions and pushes."""
    robots = {"four-bar": rbd.load_robot(URDF / "four_bar.urdf"), "six-bar": rbd.load_robot(URDF / "six_bar.urdf")}
    medians = interleaved({f"assemble {name}": assembling(robot) for name, robot in robots.items()}, rounds=1)
    loads = {f"load {name}": lambda i, name=name: rbd.load_robot(name) for name in ("talos", "human")}
    medians |= interleaved(loads, draws=100, turn=5, rounds=1) | interleaved(standing(talos), draws=40, turn=5, rounds=1)
    return [Row(label, {"": 1e3 * seconds}, "ms", (MILLISECONDS[label],)) for label, seconds in medians.items()]
