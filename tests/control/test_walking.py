"""Walking: gaits and ways of feet, plans, robots of two and four feet, slopes and stairs, pushes, and what is refused."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import re

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.control import Footstep, Gait, Push, Walk, WalkPlan
from rbd.control.walking.gaits import GAITS
from rbd.control.walking.legs import carrying
from rbd.control.walking.swings import Swing, bump, smooth, to_rest
from rbd.errors import InputError, ModelError, NoSolution, SimulationStopped, SingularInertia, UnknownName

FRICTION, STEP = 0.6, 2e-3


def walked(walk: Walk, **given: object) -> rbd.Trajectory:
    """The motion of a walk."""
    return rbd.simulate(walk.state, walk.contacts, duration=walk.duration, step=STEP, controller=walk, progress=False, **given)  # type: ignore[arg-type]


def check(walk: Walk, run: rbd.Trajectory, place: float = 1e-3) -> None:
    """It stands at the end as planned: no violated step, feet and centre of mass where they are to be, torques in limits."""
    end = run.state(-1)
    assert walk.log.violations == 0 and walk.log.residual.max() < 1e-9
    assert (np.abs(run.tau) <= walk.robot.effort_limit * (1.0 + 1e-9)).all()
    for foot in walk.contacts:
        X = end.frame(foot.frame, foot.placement.act(foot.corners.mean(axis=0))).X_WF
        assert X.translation == pytest.approx(walk.plan.placed(foot.name, 1e3).translation, abs=place)
    assert end.com == pytest.approx(walk.plan.centroid.com[-1], abs=5e-3)
    assert np.abs(end.v[:6]).max() < 0.02  # arms still swing


def certify(walk: Walk, run: rbd.Trajectory) -> None:
    """Every tenth frame again by `rbd.solve`: its certificate, and the same accelerations and forces of points."""
    weight, frames = walk.robot.mass * 9.81, range(0, len(run.t) - 1, 10)
    for i in frames:
        feet = run.touching(i, walk.contacts)
        found = rbd.solve(run.state(i), tau=run.tau[i], constraints=feet, rest_speed=1e-3)  # feet of a bound that stick move so
        assert found.residuals.within(1e-9)
        assert found.a == pytest.approx(run.a[i], abs=1e-6)
        for foot in feet:
            if len(run.points[foot.name][i]) == 1:  # forces of soles need not be unique
                assert found.forces[foot.name] == pytest.approx(run.forces[foot.name][i], abs=1e-9 * weight)
    assert len(frames) > 50


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


def test_a_foot_moves_smoothly() -> None:
    """Velocity and acceleration of its way are the differences of its places, also where it is sent elsewhere."""
    begin, end = pin.SE3.Identity(), pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.3), np.array([0.2, 0.05, 0.02]))
    way = Swing(begin, end, 1.0, 0.6, 0.07)
    other = way.redirected(1.25, pin.SE3(end.rotation, end.translation + [0.1, -0.1, 0.0]), 1.5)
    rises = dataclasses.replace(way, heel=np.array([0.02, 0.3, 0.0]), toes=0.1)
    whole, rest = np.linspace(1.05, 1.55, 9), np.linspace(1.3, 1.45, 5)
    for some, times in ((way, whole), (rises, whole), (other, rest)):
        for t in times:
            (_, v0, _), (X, v, a), (_, v1, _) = (some.at(x) for x in (t - 1e-5, t, t + 1e-5))
            before, after = some.at(t - 1e-5)[0], some.at(t + 1e-5)[0]
            assert (after.translation - before.translation) / 2e-5 == pytest.approx(v[:3], abs=1e-5)
            assert (v1 - v0)[:3] / 2e-5 == pytest.approx(a[:3], abs=1e-3)
            assert pin.log3(after.rotation @ before.rotation.T) / 2e-5 == pytest.approx(v[3:], abs=1e-5)
    for old, new in zip(way.at(1.25), other.at(1.25), strict=True):
        if isinstance(old, pin.SE3):
            assert old.isApprox(new, 1e-12)
        else:
            assert new[:3] == pytest.approx(old[:3], abs=1e-9)
    assert rises.at(1.6)[0].isApprox(way.end, 1e-9)
    for t in np.linspace(1.02, 1.58, 9):  # the heel is higher than of a flat foot, and toes no lower
        (X, *_), (flat, *_) = rises.at(t), way.at(t)
        heel, toes = (float((X.act(p) - flat.act(p))[2]) for p in (np.array([-0.1, 0.0, 0.0]), np.array([0.1, 0.0, 0.0])))
        assert heel >= -1e-12 and -1e-3 < toes < 5e-3
    X, v, _ = other.at(1.5)
    assert X.isApprox(other.end, 1e-9) and v == pytest.approx(np.zeros(6), abs=1e-9)
    assert smooth(0.3, 0.6) == pytest.approx([0.5, 30 / 16 / 0.6, 0.0]) and bump(0.3, 0.6)[:2] == pytest.approx([1.0, 0.0])
    ended = to_rest(2.0, 1.0, np.array([0.3]), np.array([1.0]), np.array([0.0]))
    assert ended.ravel() == pytest.approx([0.3, 0.0, 0.0])


def test_feet_clear_the_stairs(talos: rbd.Robot) -> None:
    """Corners of feet in the air are over the treads below them, measured anew along the whole way."""
    stairs = rbd.Terrain.stairs(0.1, 0.3, 3, start=(talos.standing().com[0] + 0.25, 0, 0), down=True)
    walk = Walk(talos, 12, terrain=stairs)
    corners = {foot.name: np.asarray(foot.corners) for foot in walk.contacts}
    lowest = []
    for foot, ways in walk.plan.swings.items():
        for way in ways:
            for t in np.linspace(way.start + 0.02 * way.T, way.landing - 0.02 * way.T, 60):
                X = way.at(t)[0]
                points = corners[foot] @ X.rotation.T + X.translation
                high = [stairs.ground_at(x, y).point[2] for x, y, _ in points]
                lowest.append((points[:, 2] - high).min())
    assert min(lowest) > -1e-3
    for step in walk.plan.footsteps:  # whole soles
        points = corners[step.foot] @ step.pose.rotation.T + step.pose.translation
        assert np.ptp([stairs.ground_at(x, y).point[2] for x, y, _ in points]) < 1e-9
    assert walk.plan.footsteps[-1].pose.translation[2] == pytest.approx(0.0, abs=1e-9)


def test_a_plan_is_a_motion(solo: rbd.Robot) -> None:
    """Forces are in their cones, zero in the air, and accelerate the planned centre of mass; it begins and ends at rest."""
    plan = Walk(solo, 4, gait="trot", friction=FRICTION).plan
    found, dt = plan.centroid, float(plan.t[1] - plan.t[0])
    f, m, g = found.forces, solo.mass, solo.gravity
    assert (np.hypot(f[..., 0], f[..., 1]) <= 0.8 * FRICTION * f[..., 2] + 1e-4 * m * 9.81).all()
    acceleration = np.diff(found.com, 2, axis=0) / dt**2
    assert m * (acceleration - g) == pytest.approx(f[1:-1].sum(axis=1), abs=1e-3 * m * 9.81)
    for i, foot in enumerate(plan.poses):
        for way in plan.swings[foot]:
            air = (plan.t > way.start + 1e-6) & (plan.t < way.landing - 1e-6)
            assert air.any() and not f[air, i].any()
    assert found.com[0] == pytest.approx(solo.standing().com, abs=1e-6)
    for t in (0.0, plan.duration):
        assert plan.com(t).velocity == pytest.approx(np.zeros(3), abs=2e-3)
    assert plan.momentum(-1.0).value == pytest.approx(np.zeros(6))


@pytest.mark.parametrize("gait", ["crawl", "trot", "bound"])
def test_quadrupeds_walk(solo: rbd.Robot, gait: str) -> None:
    """By each gait, as far as planned, without a new plan; a bound flies and pitches."""
    walk = Walk(solo, 4, gait=gait, friction=FRICTION)
    run = walked(walk)
    end = run.state(-1)
    assert walk.log.violations == 0 and not walk.plans and end.com[2] == pytest.approx(walk.state.com[2], abs=5e-3)
    assert end.com[:2] == pytest.approx(walk.plan.centroid.com[-1, :2], abs=1e-3)
    assert end.com[0] - walk.state.com[0] > 0.02
    certify(walk, run)
    if gait == "bound":
        assert walk.gait.flies and not walk.plan.centroid.forces.any(axis=(1, 2)).all()
        assert max(abs(walk.plan.tilt(t, 0.0)[0, 1]) for t in walk.plan.t) > 0.1


def test_a_tilt_is_the_integral_of_its_rate(solo: rbd.Robot) -> None:
    """And the rate that of its acceleration, as differences say; it ends level."""
    plan = Walk(solo, 4, gait="bound", friction=FRICTION).plan
    for t in np.linspace(0.4, 1.2, 7):
        before, now, after = (plan.tilt(t + by, 0.0) for by in (-1e-5, 0.0, 1e-5))
        assert (after - before)[:2] / 2e-5 == pytest.approx(now[1:], abs=1e-4)
    assert np.abs(plan.tilt(plan.duration, 0.0)[0]).max() < 0.01


def test_the_weight_is_within_the_torques_of_ankles() -> None:
    """At the corners that a plan uses: by the generalised force of the weight on a foot, not by the formula."""
    human = rbd.load_robot("human")
    state, feet = human.standing(), human.feet()
    points = carrying(state, feet, float(state.com[2]))
    ankles = [j for j, name in enumerate(human.model.names[2:]) if "ankle" in name]
    limits = human.effort_limit[ankles]
    for foot in feet:
        shares = [
            (np.abs(state.frame(foot.frame, foot.placement.act(p)).J[2, 6:][ankles]) * human.mass * 9.81 / limits).max()
            for p in points[foot.name]
        ]
        assert max(shares) == pytest.approx(0.8, abs=1e-3)  # mass times 9.81 is the weight to 1e-4
    talos = rbd.load_robot("talos")
    for foot, inner in carrying(talos.standing(), talos.feet(), 0.9).items():
        corners = next(np.asarray(each.corners) for each in talos.feet() if each.name == foot)
        assert sorted(inner[:, :2].ravel()) == pytest.approx(sorted(0.75 * corners[:, :2].ravel()))


@pytest.mark.parametrize(
    ("name", "gait", "said"),
    [
        ("bolt", None, "right_foot are points: it falls"),
        ("solo8", "trot", r"move 'front_left' in 2 directions, and not along \[-?0.0, -?1.0"),
        ("solo12", "pace", r"would roll by 0\.3"),
        ("b1", "bound", r"too weak for this walk: .* times the torque limit of 'RL_thigh_joint'"),
    ],
)
def test_robots_that_cannot_walk_are_refused(name: str, gait: str | None, said: str) -> None:
    """Before, with the reason."""
    with pytest.raises((InputError, ModelError), match=said):
        Walk(rbd.load_robot(name), gait=gait)


def test_a_walk_that_joints_are_too_slow_for_is_refused(exhaustive: bool) -> None:
    """Romeo's hips turn by 0.32 rad/s: at 0.17 rad/s they are behind when a foot lands; at 0.15, exhaustive, not."""
    romeo = rbd.load_robot("romeo")
    with pytest.raises(InputError, match=r"too slow .*: '[LR]HipYaw', at 90% of 0\.32 rad/s, is 0\.00\d rad behind"):
        Walk(romeo, 2, (0.0, 0.0, 0.17))
    if exhaustive:
        walk = Walk(romeo, 6, (0.0, 0.0, 0.15))
        check(walk, walked(walk))


def test_strides_that_legs_are_too_slow_for_are_refused_with_one_that_they_are_not(exhaustive: bool) -> None:
    """Romeo falls at 0.16 m/s: refused, in a curve too, with a velocity that is walked, exhaustive; aside he may be quicker."""
    romeo = rbd.load_robot("romeo")
    with pytest.raises(InputError, match=r"too slow to walk forwards at 0\.16 m/s: .* Give at most (\d\.\d+) m/s") as straight:
        Walk(romeo, 4, (0.16, 0.0, 0.0))
    if exhaustive:
        with pytest.raises(InputError, match=r"too slow to walk forwards at 0\.16 m/s: .* Give at most (\d\.\d+) m/s"):
            Walk(romeo, 6, (0.16, 0.02, 0.05))
        given = re.search(r"at most ([\d.]+) m/s", str(straight.value))
        assert given is not None
        walk = Walk(romeo, 6, (float(given[1]), 0.0, 0.0))
        check(walk, walked(walk))


@pytest.mark.filterwarnings("ignore::rbd.errors.ModelWarning")
@pytest.mark.parametrize("name", ["romeo_full", "icub_full"])
def test_a_singular_inertia_is_refused(name: str) -> None:
    """Before the first step."""
    with pytest.raises(SingularInertia, match="has no motion where it stands"):
        Walk(rbd.load_robot(name))


def test_bipeds_walk_six_steps(exhaustive: bool) -> None:
    """One call each; iCub and Romeo in exhaustive tests. Romeo's joints are slow: its strides are 65 % of the others'."""
    for name in ("talos", "g1", "human", *(("icub", "romeo") if exhaustive else ())):
        walk = Walk(rbd.load_robot(name), 6, friction=FRICTION)
        run = walked(walk)
        check(walk, run)
        assert len(walk.plan.footsteps) == 6 and not walk.plans
        stride = (0.65 if name == "romeo" else 1.0) * 0.23 * walk.plan.centroid.com[0, 2]
        assert run.com[-1, 0] - run.com[0, 0] == pytest.approx(5 * stride, rel=0.02)


@pytest.mark.parametrize(("velocity", "turn"), [((0.0, 0.08, 0.0), 0.0), ((0.0, 0.0, 0.262), 90.0), ((-0.15, 0.0, 0.0), 0.0)])
def test_a_humanoid_walks_aside_turns_and_goes_back(talos: rbd.Robot, velocity: tuple[float, ...], turn: float) -> None:
    """The body moves and turns as the velocity says, feet as planned."""
    walk = Walk(talos, 6, velocity, friction=FRICTION)
    run = walked(walk)
    check(walk, run)
    R = run.state(-1).frame("base_link").X_WF.rotation
    period = 3.35 * math.sqrt((walk.state.com[2]) / 9.81)
    assert math.degrees(math.atan2(R[1, 0], R[0, 0])) == pytest.approx(math.degrees(6 * velocity[2] * period), abs=0.5)
    assert abs(math.degrees(6 * velocity[2] * period) - turn) < 1.5
    aside = run.com[-1] - run.com[0]
    assert aside[1] == pytest.approx(6 * velocity[1] * period, abs=0.02 if not turn else 0.2)


def test_humanoids_walk_up_and_down_stairs(exhaustive: bool) -> None:
    """Three stairs of 10 cm: no violated step, feet where planned; G1 in exhaustive tests.

    Checked, every frame of the motion is possible, and no bodies touch; on stairs shifted by 1 cm and 12 cm it sinks, hovers,
    tips and floats.
    """
    for name in ("talos", *(("g1",) if exhaustive else ())):
        check_stairs(rbd.load_robot(name))


def check_stairs(robot: rbd.Robot) -> None:
    """Up and down."""
    stairs = rbd.Terrain.stairs(0.1, 0.3, 3, start=(robot.standing().com[0] + 0.25, 0, 0), down=True)
    walk = Walk(robot, 12, terrain=stairs, friction=FRICTION)
    run = walked(walk)
    check(walk, run)
    highest = walk.plan.centroid.com[:, 2].max()
    assert highest - run.com[0, 2] > 0.19 and np.max(run.com[:, 2]) == pytest.approx(highest, abs=0.005)
    assert run.residuals["law"].max() < 1e-9 and run.residuals["penetration"].max() < 1e-8
    motion, place = rbd.Motion.of_trajectory(run[::8]), np.array([robot.standing().com[0] + 0.25, 0.0, 0.0])
    wrong, found = ("floats", "hovering foot", "sinks", "tips"), {}
    for by in ((0.0, 0.0), (0.0, 0.01), (0.0, -0.01), (0.12, 0.0), (0.0, 0.12), (0.0, -0.12)):
        shifted = rbd.Terrain.stairs(0.1, 0.3, 3, start=place + [by[0], 0.0, by[1]], down=True)
        report = rbd.check_motion(motion, ground=shifted, self_collision=by == (0.0, 0.0), progress=False)
        found[by] = {cause: float(report.of_cause(cause).mean()) for cause in wrong if report.of_cause(cause).any()}
        assert (report.share_possible == 1.0) == (by == (0.0, 0.0))
    assert found[0.0, 0.0] == {} and set(found[0.0, 0.01]) == {"sinks"} and set(found[0.12, 0.0]) == {"sinks", "tips"}
    assert found[0.0, -0.01] == {"hovering foot": 1.0} and found[0.0, 0.12] == {"sinks": 1.0}
    assert found[0.0, -0.12] == {"floats": 1.0}


@pytest.mark.parametrize("angle", [8.0, -8.0])
def test_a_humanoid_walks_on_a_slope(talos: rbd.Robot, angle: float) -> None:
    """8 degrees up and down."""
    a = math.radians(angle)
    slope = rbd.Ground(point=(0.0, 0.0, 0.0), normal=(-math.sin(a), 0.0, math.cos(a)))
    walk = Walk(talos, 6, terrain=slope, friction=FRICTION)
    run = walked(walk)
    check(walk, run)
    rise = (run.com[-1] - run.com[0]) @ [0.0, 0.0, 1.0]
    assert rise == pytest.approx(math.tan(a) * (run.com[-1, 0] - run.com[0, 0]), abs=2e-3)


@pytest.mark.parametrize(
    ("name", "link", "force", "hardest"), [("talos", "torso_2_link", 300.0, 90.0), ("g1", "torso_link", 60.0, 270.0)]
)
def test_pushes_in_a_swing_are_taken_up_by_steps(name: str, link: str, force: float, hardest: float, exhaustive: bool) -> None:
    """0.1 s while a foot is in the air; without new plans it falls or misses more, and footholds change."""
    robot = rbd.load_robot(name)
    for angle in (0.0, 90.0, 180.0, 270.0) if exhaustive else (hardest,):
        walk = Walk(robot, 6, friction=FRICTION)
        way = walk.plan.footsteps[2]
        a, start = math.radians(angle), way.start + 0.3 * (way.end - way.start)
        push = Push(link, force * np.array([math.cos(a), math.sin(a), 0.0]), start=start, duration=0.1)
        before = walk.plan
        run = walked(walk, external=push)
        assert run.com[-1, 2] == pytest.approx(walk.plan.centroid.com[-1, 2], abs=0.02)
        assert np.abs(run.v[-1, :6]).max() < 0.02
        assert walk.plans and all(isinstance(plan, WalkPlan) for _, plan in walk.plans)
        moved = [
            np.linalg.norm(x.pose.translation - y.pose.translation)
            for x, y in zip(before.footsteps[2:], walk.plan.footsteps[2:], strict=True)
        ]
        assert max(moved) > 0.01


def test_a_walk_used_again_gives_the_same_bits(solo: rbd.Robot) -> None:
    """It forgets a motion, also one with new plans; copies do the same to rounding, which new plans enlarge."""
    walk = Walk(solo, 2, gait="trot", friction=FRICTION)
    push = Push("base_link", (6.0, 4.0, 0.0), start=0.5, duration=0.1)
    runs = [walked(each, external=push).q for each in (walk, walk, copy.deepcopy(walk), pickle.loads(pickle.dumps(walk)))]
    assert walk.plans
    assert np.array_equal(runs[0], runs[1])
    for run in runs[2:]:
        assert run == pytest.approx(runs[0], abs=1e-4)


def test_footsteps_of_ones_own(talos: rbd.Robot) -> None:
    """A list of steps at times of its own: plans stand where they say."""
    poses = {step.foot: step.pose for step in Walk(talos, 2).plan.footsteps}
    left = poses["left_sole"].translation
    there = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.2), left + [0.05, 0.03, 0.0])
    plan = Walk(talos, [Footstep("left_sole", there, 1.0, 1.8)]).plan
    assert plan.placed("left_sole", 5.0).isApprox(there) and len(plan.footsteps) == 1
    assert plan.schedule.intervals["left_sole"] == ((-math.inf, 1.0), (1.8, math.inf))
    support = plan.centroid.com[np.searchsorted(plan.t, 1.4), :2]
    right = plan.placed("right_sole", 1.4).translation[:2]
    assert np.abs(support - right).max() < 0.12  # over the foot that stands


def random_walk(rng: np.random.Generator, name: str | None = None) -> Walk:
    """Robot, direction, terrain and speed are drawn."""
    names = ["talos", "g1", "icub", "romeo", "human", "solo12", "go2", "a1", "anymal_b"]
    robot = rbd.load_robot(name or str(rng.choice(names)))
    two = len(robot.feet()) == 2
    gait = "walk" if two else str(rng.choice(["crawl", "trot"]))
    stand = robot.standing()
    h, known = float(stand.com[2]), GAITS[gait]
    most = known.stride * h / ((known.swing + known.overlap) * math.sqrt(h / 9.81))
    velocity = rng.uniform([-0.7 * most, -0.5 * most, -0.15], [1.3 * most, 0.5 * most, 0.15])
    kind, angle = int(rng.integers(3)), math.radians(rng.uniform(-6.0, 6.0))
    way = rng.uniform(0.0, 2.0 * math.pi)
    on: float | rbd.Ground | rbd.Terrain = 0.0
    if kind == 1:
        lean = math.sin(angle)
        on = rbd.Ground(point=(0.0, 0.0, 0.0), normal=(lean * math.cos(way), lean * math.sin(way), math.cos(angle)))
    elif kind == 2 and two:
        start, depth = (float(stand.com[0]) + 0.3 * h, 0.0, 0.0), 0.35 * h + 0.05
        on = rbd.Terrain.stairs(rng.uniform(0.03, 0.09) * h, depth, 2, start=start, down=True)
        velocity = np.array([abs(velocity[0]) + 0.3 * most, 0.0, 0.0])
    return Walk(robot, 6, velocity, terrain=on, gait=gait, friction=FRICTION)


@pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")  # energy that steps of 2 ms lose where a foot turns fast
def test_walks_drawn_at_random_stand_or_are_refused(exhaustive: bool) -> None:
    """Fifty in exhaustive tests; none falls."""
    rng, refused, n = np.random.default_rng(38), 0, 50 if exhaustive else 2
    fell = list[str]()
    for _ in range(n):
        name = None if exhaustive else "solo12"
        try:
            walk = random_walk(rng, name)
        except (InputError, NoSolution):
            refused += 1
            continue
        try:
            run = walked(walk)
        except SimulationStopped:
            fell.append(walk.robot.name)
            continue
        end, off = run.state(-1), np.abs(run.com[-1] - walk.plan.centroid.com[-1]).max()
        if walk.log.violations or walk.log.residual.max() > 1e-8 or off > 0.02 or np.abs(end.v[:6]).max() > 0.05:
            fell.append(walk.robot.name)
    assert refused <= n // 2 and not fell


def test_gaits() -> None:
    """Which fly; what is refused."""
    assert [name for name, gait in GAITS.items() if gait.flies] == ["bound"]
    for order in ((("left",),), (("left", "right", "left"),), (("front",), ("hind",))):
        with pytest.raises(InputError, match=r"expected each of left, right once"):
            Gait(order, swing=2.0, overlap=1.0)
    with pytest.raises(InputError, match="overlap of a gait is -3"):
        Gait((("left",), ("right",)), swing=2.0, overlap=-3.0)


def at(x: float, y: float, z: float = 0.0) -> pin.SE3:
    """A level pose."""
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def test_what_cannot_be_walked_is_refused(talos: rbd.Robot, solo: rbd.Robot) -> None:
    """By name, with the limit."""
    with pytest.raises(InputError, match=r"expected at most 0\.4\d+ m/s forwards"):
        Walk(talos, 6, (2.0, 0.0, 0.0))
    with pytest.raises(InputError, match="has no floating base"):
        Walk(rbd.load_robot("solo12", root="fixed"))
    with pytest.raises(InputError, match="gait is 'trot', of a robot with 2 feet"):
        Walk(talos, gait="trot")
    with pytest.raises(ModelError, match="no feet are known for ur5"):
        Walk(rbd.load_robot("ur5"))
    with pytest.raises(InputError, match=r"'left_sole' to \[1\.4.*is out of reach.*this foot at \["):
        Walk(talos, [Footstep("left_sole", at(1.4, 0.085), 1.0, 1.7)])
    with pytest.raises(InputError, match=r"is 30\.0 mm above the ground"):
        Walk(talos, [Footstep("left_sole", at(0.2, 0.085, 0.03), 1.0, 1.7)])
    with pytest.raises(InputError, match=r"is 30\.0 mm inside the ground"):
        Walk(talos, [Footstep("left_sole", at(0.2, 0.085, -0.03), 1.0, 1.7)])
    with pytest.raises(UnknownName, match="nearest: 'left_sole'"):
        Walk(talos, [Footstep("left_sol", at(0.2, 0.085), 1.0, 1.7)])
    with pytest.raises(InputError, match=r"lifted at 1\.5 s; it stands from 1\.7 s"):
        Walk(talos, [Footstep("left_sole", at(0.2, 0.085), 1.0, 1.7), Footstep("left_sole", at(0.3, 0.085), 1.5, 2.0)])
    high = rbd.Terrain.stairs(0.3, 0.3, 2, start=(0.3, 0.0, 0.0))
    with pytest.raises(InputError, match="finds no place to stand on"):
        Walk(talos, 6, terrain=high)
    with pytest.raises(InputError, match="steps of Walk"):
        Walk(solo, 0)
