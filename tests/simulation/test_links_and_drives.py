"""Drives against what holds them; work of rods, ropes, rolling and drives; shapes of points and forces by every integrator."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import simpson

import rbd
from rbd.constraints import RollingBody, RollingOnRound
from rbd.constraints.constraint import Constraint
from rbd.errors import InputError, SimulationStopped

INTEGRATORS = (rbd.TimeStepping(), rbd.RungeKutta4(), rbd.DormandPrince8())
ARM = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
BELOW = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))


# ---------------------------------------------------------------------------------------------------- contradictions


def test_a_drive_into_a_stop_is_named_with_the_stop_and_the_time():
    """At 1 rad/s the bound at 0.25 rad is reached at 0.25 s: the step before ends there, and what was reached is kept."""
    drive, stop = rbd.DrivenJoint("drive", "joint_1", rbd.Speed(1.0)), rbd.JointLimit("stop", "joint_1", upper=0.25)
    for h in (0.01, 0.003):
        with pytest.raises(SimulationStopped, match=r"after t = 0\.2\d* s has no solution: .*drive, stop") as caught:
            rbd.simulate(ARM.at([0.0], [1.0]), [drive, stop], duration=1.0, step=h, progress=False)
        assert 0.25 - h <= caught.value.trajectory.t[-1] + 1e-12 <= 0.25 + h
        assert abs(caught.value.state.q[0] - caught.value.state.t) <= 1e-12


def test_a_drive_that_only_touches_a_stop_moves_on():
    """Where s = (1 - cos t) / 4 has its top at the bound: neither pushes the other there, and the motion is the drive's."""
    drive = rbd.DrivenJoint(
        "drive", "joint_1", lambda t: (0.25 - 0.25 * math.cos(t), 0.25 * math.sin(t), 0.25 * math.cos(t))
    )  # fmt: skip
    stop = rbd.JointLimit("stop", "joint_1", upper=0.5)
    found = rbd.simulate(ARM.at([0.0]), [drive, stop], duration=6.0, step=0.01, progress=False)
    assert np.abs(found.q[:, 0] - 0.25 + 0.25 * np.cos(found.t)).max() <= 1e-12


def test_a_drive_through_a_loop_against_a_stop_a_lock_and_another_drive():
    """All that take part are named: what drives, what stops, and the pin between them."""
    engine = rbd.mechanism.slider_crank(0.045, 0.15)
    here = engine.at("assembled")
    at, x = (engine.joints[name].coordinate(here.q) for name in ("crank_joint", "slider_joint"))
    drive = rbd.DrivenJoint("drive", "crank_joint", rbd.Speed(3.0, start=at))
    start = rbd.mechanism.project_velocity(here, [drive])
    wall = rbd.JointLimit("wall", "slider_joint", lower=x - 0.01)
    with pytest.raises(SimulationStopped, match=r"after t = 0\.07\d* s has no solution: .*drive, wall, wrist_pin"):
        rbd.simulate(start, [drive, wall], duration=1.0, step=0.005, progress=False)
    other = rbd.DrivenJoint("other", "slider_joint", rbd.Speed(0.0, start=x))
    with pytest.raises(rbd.NoSolution, match="'drive', 'other' and 'wrist_pin' .* contradict each other"):
        rbd.solve(start, None, [drive, other])
    for name, held in (("lock", rbd.JointLock("lock", "slider_joint")), ("other", other)):
        with pytest.raises(InputError, match=f"'{name}' holds, and moves at 0.11"):
            rbd.simulate(start, [drive, held], duration=0.1, step=0.005, progress=False)


# -------------------------------------------------------------------------------------------------------------- work


def rodded() -> tuple[rbd.State, list[Constraint], Callable[[float], tuple[float, float, float]]]:
    """A crank that a drive turns unevenly, a rod without mass, and a piston."""
    b = rbd.RobotBuilder("rodded", root="fixed")
    b.body("crank", rbd.robots.Rod((0, 0, 0), (0.05, 0, 0), mass=0.4))
    b.body("piston", rbd.robots.Box((0.04, 0.04, 0.04), mass=0.5))
    b.joint("crank_joint", "ground", "crank", axis=(0, 0, 1))
    b.joint("piston_joint", "ground", "piston", "prismatic", axis=(1, 0, 0))
    b.loop("rod", ("crank", (0.05, 0, 0)), ("piston", (0, 0, 0)), kind="rod", length=0.2)
    robot = b.robot(gravity=(-3.0, -9.0, 0.0))

    def motion(t: float) -> tuple[float, float, float]:
        return 20.0 * t + 0.2 * math.sin(30.0 * t), 20.0 + 6.0 * math.cos(30.0 * t), -180.0 * math.sin(30.0 * t)

    drive = rbd.DrivenJoint("drive", "crank_joint", motion)
    return rbd.mechanism.project_velocity(robot.at([0.0, 0.25]), [drive]), [drive], motion


@pytest.mark.parametrize("integrator", [rbd.RungeKutta4(), rbd.DormandPrince8()], ids=["RungeKutta4", "DormandPrince8"])
def test_a_rod_does_no_work_and_the_drive_does_all(integrator):
    """Energy is the drive's work, by Simpson's rule over its torque and speed; the rod's length stays, so that it has none."""
    start, held, motion = rodded()
    found = rbd.simulate(start, held, duration=0.2, step=2.5e-4, integrator=integrator, progress=False)
    speed = np.array([motion(t)[1] for t in found.t])
    work = simpson(found.forces["drive"].ravel() * speed, x=found.t)
    assert np.ptp(found.energy) > 0.05
    assert abs(work - (found.energy[-1] - found.energy[0])) <= 1e-7 * np.ptp(found.energy)
    assert np.abs(found.residuals["energy"]).max() <= 1e-8 * np.ptp(found.energy)
    x = 0.05 * np.cos(found.q[:, 0]) + np.sqrt(0.2**2 - (0.05 * np.sin(found.q[:, 0])) ** 2)
    assert np.abs(found.q[:, 1] - x).max() <= 1e-12


def test_a_taut_rope_does_no_work():
    """A box swings on it for a second, tumbling about its end: what steps make of energy falls with the square of the step."""
    b = rbd.RobotBuilder("swing")
    b.body("box", rbd.robots.Box((0.2, 0.3, 0.1), mass=2.0))
    robot = b.robot()
    rope = rbd.LoopClosure("rope", "universe", "box", kind="rope", length=1.0)
    start = robot.at([0.6, 0.0, -0.8, 0, 0, 0, 1], [0.0, 0.5, 0.0, 1.0, -2.0, 0.5])
    errors = []
    for h in (2e-3, 1e-3):
        found = rbd.simulate(start, [rope], duration=1.0, step=h, progress=False)
        assert (np.linalg.norm(found.forces["rope"], axis=1) > 1.0).all() and not found.events
        errors.append(np.abs(found.residuals["energy"]).max())
        assert np.abs(np.linalg.norm(found.q[:, :3], axis=1) - 1.0).max() <= 1e-6
    assert math.log2(errors[0] / errors[1]) > 1.6 and errors[1] <= 1e-4 * np.ptp(found.kinetic)


def test_rolling_does_no_work_where_a_drive_shakes_what_it_rolls_on():
    """A ball on a plank that a drive shakes: energy is the drive's work, though the friction that rolls it moves."""
    b = rbd.RobotBuilder("shaken", root="fixed")
    b.body("plank", rbd.robots.Box((1.0, 0.3, 0.1), mass=1.0))
    b.body("ball", rbd.robots.Sphere(0.1, mass=0.7))
    b.joint("rail", "ground", "plank", "prismatic", axis=(1, 0, 0))
    b.joint("ball_joint", "ground", "ball", "free")
    b.frame("top", "plank", (0, 0, 0.05))
    b.wheel("rolls", "ball", kind="rolling_ball", radius=0.1, on="top")
    b.drive("shaker", "rail", times=np.linspace(0, 1, 9), values=0.1 * np.sin(2 * np.pi * np.linspace(0, 1, 9)).round(12))
    robot = b.robot()
    held = [*robot.wheels(), *robot.drives()]
    start = rbd.mechanism.project_velocity(robot.at([0.0, 0.0, 0.0, 0.15, 0, 0, 0, 1]), held)
    found = rbd.simulate(start, held, duration=1.0, step=1e-3, integrator=rbd.DormandPrince8(), progress=False)
    speed = found.v[:, robot.joints["rail"].v].ravel()
    work = simpson(found.forces["shaker"].ravel() * speed, x=found.t)
    assert abs(work - (found.energy[-1] - found.energy[0])) <= 1e-6 * np.ptp(found.energy)
    assert np.abs(found.residuals["energy"]).max() <= 1e-8 * np.ptp(found.energy)
    x, plank = found.q[:, robot.joints["ball_joint"].q][:, 0], found.q[:, robot.joints["rail"].q].ravel()
    drifts = found.v[0, robot.joints["ball_joint"].v][0] - 2.0 / 7.0 * speed[0]
    assert np.abs(x - x[0] - drifts * found.t - 2.0 / 7.0 * (plank - plank[0])).max() <= 1e-10
    assert np.abs(found.forces["rolls"][:, 0]).max() > 0.1


# ------------------------------------------------------------------------------------------------------------ shapes


def box() -> rbd.Robot:
    """A box of 20 cm that can be saved."""
    b = rbd.RobotBuilder("box")
    b.body("box", rbd.robots.Box((0.2, 0.2, 0.2), mass=1.0))
    b.frame("edge", "box", (-0.1, 0, 0))
    return b.robot()


def touching(mu: float | None) -> dict[str, Constraint]:
    """What touches the ground, by the number of its points."""
    return {
        "point": rbd.PointContact("c", "box", offset=(0, 0, -0.1), friction=mu),
        "edge": rbd.LineContact("c", "box", half_length=0.1, placement=BELOW, friction=mu),
        "patch": rbd.SurfaceContact("c", "box", half_lengths=(0.1, 0.05), placement=BELOW, friction=mu),
        "ball": rbd.RollingBall("c", "box", radius=0.1, friction=mu),
        "disk": rbd.RollingDisk("c", "box", radius=0.1, friction=mu),
        "egg": RollingBody("c", "box", shape=(0.2, 0.15, 0.1), friction=mu),
        "bowl": RollingOnRound("c", "box", radius=0.1, surface_radius=-0.5, on=0.5, friction=mu),
    }


def shapes(run: rbd.Trajectory) -> dict[str, tuple[tuple[int, ...], ...]]:
    """{constraint: shapes of forces, points and their forces at one time}."""
    return {
        name: tuple(x[name].shape[1:] for x in (run.forces, run.points, run.point_forces) if name in x) for name in run.forces
    }


@pytest.mark.parametrize("mu", [None, 0.0, 0.5])
@pytest.mark.parametrize(
    ("kind", "k"), [("point", 1), ("edge", 2), ("patch", 4), *((x, 1) for x in ("ball", "disk", "egg", "bowl"))]
)
def test_points_have_one_shape_by_every_integrator_and_in_files(kind, k, mu, tmp_path: Path):
    """As many corners and forces, held or with friction, stepped or smooth, saved and read; they add up to the force."""
    contact, start = touching(mu)[kind], box().at([0, 0, 0.1, 0, 0, 0, 1])
    for i, integrator in enumerate(INTEGRATORS if mu is None else INTEGRATORS[:1]):
        run = rbd.simulate(start, [contact], duration=0.01, step=1e-3, integrator=integrator, progress=False)
        assert shapes(run) == {"c": ((3 if k == 1 else 6,), (k, 3), (k, 3))}
        assert np.abs(run.point_forces["c"].sum(axis=1) - run.forces["c"][:, :3]).max() <= 1e-12 * 9.81
        assert np.abs(run.point_forces["c"].sum(axis=(0, 1)) / len(run) - [0, 0, 9.81]).max() <= 1e-6
        if k > 1:  # moments about the centre
            arms = run.points["c"] - run.points["c"].mean(axis=1, keepdims=True)
            moment = np.cross(arms, run.point_forces["c"]).sum(axis=1)
            assert np.abs(moment - run.forces["c"][:, 3:]).max() <= 1e-12
            assert np.abs(run.points["c"][:, :, 2]).max() <= 1e-6
        assert run.state(0).t == 0.0 and rbd.solve(start, [], [contact]).corner_forces["c"].shape == (k, 3)
        path = tmp_path / f"{i}.npz"
        run.save(path)
        assert shapes(rbd.Trajectory.load(path)) == shapes(run)


@pytest.mark.parametrize(
    ("kind", "m"), [("rod", 3), ("point", 3), ("planar", 3), ("revolute", 6), ("rigid", 6), ("prismatic", 6)]
)
def test_closures_have_forces_and_no_points_by_every_integrator(kind, m, tmp_path: Path):
    """A force or a wrench each, as `rbd.solve` has it."""
    start = box().at([0.1, 0, -0.3 * (kind == "rod"), 0, 0, 0, 1])
    loop = rbd.LoopClosure("loop", "universe", "edge", kind=kind, axis=(0, 1, 0))
    for i, integrator in enumerate(INTEGRATORS):
        run = rbd.simulate(start, [loop], duration=0.01, step=1e-3, integrator=integrator, progress=False)
        assert shapes(run) == {"loop": ((m,),)} and rbd.solve(start, [], [loop]).forces["loop"].shape == (m,)
        run.save(tmp_path / f"{i}.npz")
        assert shapes(rbd.Trajectory.load(tmp_path / f"{i}.npz")) == shapes(run)


@pytest.mark.parametrize("length", [None, 0.31, 3.0])
def test_a_rope_has_a_force_of_three_whether_it_is_taut_or_not(length):
    """Taut from the start, later, or never."""
    rope = rbd.LoopClosure("rope", "universe", "edge", kind="rope", length=length)
    start = box().at([0.1, 0, -0.3, 0, 0, 0, 1])
    run = rbd.simulate(start, [rope], duration=0.1, step=1e-3, progress=False)
    assert shapes(run) == {"rope": ((3,),)} and run.forces["rope"].any() == (length != 3.0)
