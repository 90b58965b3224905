"""Steps on ground at rest by contact dynamics: the same numbers as by M, h and J, and residuals that see an error."""

from __future__ import annotations

import gc
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from contact_cases import sole
from flat_bodies import ball, flat_body, flat_state, floor_point, free_body, free_state

import rbd
from rbd.answers.prepared.contact_bodies import Workspace
from rbd.simulation.ground_dynamics import GroundSteps
from rbd.simulation.instant import Instant
from rbd.simulation.integrators import TimeStepping
from rbd.simulation.simulated_motion import SimulatedMotion
from rbd.simulation.time_step import StepSystem

H = 1e-3
STAIRS = rbd.Terrain.stairs(0.1, 0.6, 3, start=(-0.9, 0.0, -0.2))
"""Robots stand on the middle one of its steps."""
GRID = rbd.Terrain.heights(np.zeros((21, 21)), 0.1, origin=(-1.03, -1.02))
"""Level cells: corners of one sole are over several."""
EDGE = rbd.Terrain.boxes(((-1.0, -1.0, -0.1), (0.06, 1.0, 0.0)))
"""Toes of Talos and of G1 reach over it."""
GROUNDS = {"plane": None, "stairs": STAIRS, "grid": GRID, "edge": EDGE}
AGREES = 1e-9
"""Between both ways, over the size of the largest entry: of velocities, and of the impulses of independent points."""


def system(motion: SimulatedMotion, state: rbd.State, *, prepared: bool = True) -> StepSystem:
    """The steps of a motion, by contact dynamics or the general way."""
    made = StepSystem(motion, state, impact_speed=1e-3, impacts=20, extrapolate=False)
    made.snapshot(state, 0.0)
    assert made.snapshot(state, 0.0).ground is not None  # of points over edges only where they were before
    if not prepared:
        made.ground = None
    return made


def both_ways(motion: SimulatedMotion, state: rbd.State) -> tuple[StepSystem, StepSystem]:
    """The steps of a motion by contact dynamics and the general way, with the same layouts."""
    fast, general = system(motion, state), system(motion, state, prepared=False)
    general.points, general.correction = fast.points, fast.correction
    return fast, general


def seen_by(fast: StepSystem, now: Instant) -> Instant:
    """An instant of the general way, with the points as contact dynamics has them."""
    return replace(now, at=fast.snapshot(now.at.state, now.t))


def standing(
    robot: rbd.Robot, friction: float, seed: int, law: str = "coulomb", push: float = 0.3, on: rbd.Terrain | None = None
) -> tuple[SimulatedMotion, rbd.State]:
    """A robot on its feet, pushed, with torques near those that hold it and velocities that leave its feet at rest."""
    rng = np.random.default_rng(seed)
    state, feet = robot.standing(), robot.feet(friction, on=on)
    tau = rbd.hold(state, robot.feet(0.7)).tau + 0.3 * rng.normal(size=robot.nu)
    J = np.concatenate([foot.rows(state).J for foot in feet])
    v = 0.2 * rng.normal(size=robot.nv)
    force = np.zeros(robot.nv)
    force[:3] = push * rng.normal(size=3) * [1.0, 1.0, 0.3] * robot.mass * 9.81
    motion = SimulatedMotion(robot, tuple(feet), lambda s, t: tau, force, law, {}, rbd.simulation.Projection())
    return motion, state.with_velocity(v - np.linalg.lstsq(J, J @ v, rcond=None)[0])


def tumbling(seed: int) -> tuple[SimulatedMotion, rbd.State]:
    """A box that slides and turns on its sole."""
    rng = np.random.default_rng(seed)
    state = free_state(free_body(10.0, [0.1, 0.1, 0.15]), (0, 0, 0.05), (0, 0, 0), (*rng.normal(size=2), 0), (0, 0, 4.0))
    return SimulatedMotion(
        state.robot, (sole("body", (0.1, 0.1), 0.05, 0.5),), stabilisation=rbd.simulation.Projection()
    ), state


def close(one: np.ndarray, other: np.ndarray, size: float = 1.0) -> bool:
    """Whether two arrays agree."""
    return bool(np.abs(one - other).max(initial=0.0) <= AGREES * max(size, float(np.abs(other).max(initial=0.0))))


@pytest.mark.parametrize("law", ["coulomb", "convex"])
@pytest.mark.parametrize("friction", [0.7, 0.15])
@pytest.mark.parametrize(
    ("name", "ground"), [(n, g) for n in ("talos", "solo12", "g1") for g in GROUNDS if (n, g) != ("solo12", "edge")]
)
def test_steps_are_those_of_mass_matrix_and_jacobian(name, friction, law, ground):
    """Both halves of a step, sticking and slipping, one after another: velocities, gaps, sets, and what impulses do."""
    motion, state = standing(rbd.load_robot(name), friction, 3, law, on=GROUNDS[ground])
    fast, general = both_ways(motion, state)
    now = general.begin(state, 0.0).end
    for _ in range(4):
        one, other = fast.solved(seen_by(fast, now), H), general.solved(now, H)
        assert close(one.answer.v, other.answer.v)
        assert close(now.at.J.T @ one.answer.impulse, now.at.J.T @ other.answer.impulse)
        acts = np.repeat(one.active, 3)  # u+ of points in the air is used nowhere
        assert close(one.answer.velocity[acts], other.answer.velocity[acts], 1e-2)
        assert fast.law_residual(one, one.a) < 1e-9
        a, b = fast._finish(one, H), general._finish(other, H)
        assert close(a.answer.v, b.answer.v) and close(a.answer.velocity[acts], b.answer.velocity[acts], 1e-2)
        assert close(a.end.gap, b.end.gap) and close(a.end.velocity, b.end.velocity) and close(a.end.J, b.end.J)
        end, other_end = fast.step(one, now.t + H), general.step(other, now.t + H)
        assert [type(x) for x in end.passed] == [type(x) for x in other_end.passed]
        assert close(end.end.at.state.q, other_end.end.at.state.q)
        now = other_end.end


def test_points_that_turn_have_their_centripetal_acceleration():
    """A spinning box on its sole: w x (v + w x r) of each corner is in the step, to the last digits."""
    for seed in range(3):
        motion, state = tumbling(seed)
        fast, general = both_ways(motion, state)
        now = general.begin(state, 0.0).end
        for _ in range(5):
            one, other = fast.solved(seen_by(fast, now), H), general.solved(now, H)
            assert close(one.answer.velocity, other.answer.velocity) and close(one.answer.v, other.answer.v)
            a, b = fast._finish(one, H), general._finish(other, H)
            assert close(a.answer.velocity, b.answer.velocity) and close(a.answer.v, b.answer.v)
            now = general.step(other, now.t + H).end


def test_gaps_and_velocities_of_points_are_those_of_their_contacts():
    """At random poses and velocities, feet in the air: gaps, velocities; and a step without contact is free flight."""
    rng = np.random.default_rng(1)
    for name in ("talos", "solo12"):
        robot = rbd.load_robot(name)
        motion, state = standing(robot, 0.7, 0)
        fast, general = both_ways(motion, state)
        for _ in range(5):
            q = pin.integrate(robot.model, state.q, 0.3 * rng.normal(size=robot.nv))
            q[2] += 1.0
            flying = rbd.State(robot, q, rng.normal(size=robot.nv))
            one, other = fast.snapshot(flying, 0.0), general.snapshot(flying, 0.0)
            assert close(one.gap, other.gap) and close(one.velocity, other.velocity)
            ahead, behind = (x.solved(x.begin(flying, 0.0).end, H) for x in (fast, general))
            assert not ahead.active.any()
            assert close(ahead.answer.v, behind.answer.v)


def test_one_foot_in_the_air_carries_nothing():
    """The bodies of feet that do not touch are held by no force."""
    robot = rbd.load_robot("talos")
    motion, state = standing(robot, 0.7, 2)
    lifted = state.with_joints({"leg_left_4_joint": float(state.q[robot.joints["leg_left_4_joint"].q][0]) + 0.2})
    fast, general = both_ways(motion, lifted)
    one, other = (x.solved(x.begin(lifted, 0.0).end, H) for x in (fast, general))
    assert one.active.any() and not one.active.all()
    assert not one.answer.impulse.reshape(-1, 3)[~one.active].any()
    assert close(one.answer.v, other.answer.v)


@pytest.mark.parametrize(
    "wrong", ["a sign", "a stale force", "another configuration", "a wrong site", "another acceleration", "a wrong share"]
)
@pytest.mark.parametrize("name", ["talos", "solo12"])
def test_residuals_see_an_answer_that_is_wrong(monkeypatch, name, wrong):
    """The residual of a step is found by inverse dynamics and the bodies' accelerations: what was corrupted shows."""
    motion, state = standing(rbd.load_robot(name), 0.7, 4, push=0.0)
    fast = system(motion, state)
    now = fast.begin(state, 0.0).end
    now = fast.step(fast.solved(now, H), H).end
    right = fast.solved(now, H)
    assert right.answer.least and fast.law_residual(right, right.a) < 1e-9
    ground = now.at.ground
    assert ground is not None
    terms, advance = Workspace.terms, ground._kernel.advance

    def changed(change):
        def advanced(*given):
            found = advance(*given)
            change(*given[-3:])
            return found

        monkeypatch.setattr(ground._kernel, "advance", advanced)

    if wrong == "a sign":

        def turned(v, impulse, velocity):
            impulse[::3] *= -1.0

        changed(turned)
    elif wrong == "a stale force":
        fast._finish(right, H)  # terms are those of the step's middle
        monkeypatch.setattr(Workspace, "terms", lambda *given: None)
    elif wrong == "another configuration":

        def elsewhere(space, model, q, *rest):
            terms(space, model, pin.integrate(model, q, np.full(model.nv, 1e-4)), *rest)

        monkeypatch.setattr(Workspace, "terms", elsewhere)
    elif wrong == "a wrong site":
        ground._workspace.sites[0, 9] += 1e-3
    elif wrong == "another acceleration":

        def faster(v, impulse, velocity):
            v += 1e-4 * H

        changed(faster)
    else:
        active, shares = ground._shares
        ground._shares = active, shares * (1.0 + 1e-3 * (np.arange(len(shares)) == 0))[:, None, None]
    corrupted = fast.solved(now, H)
    assert fast.law_residual(corrupted, corrupted.a) > 1e-7


def test_what_is_not_covered_steps_the_general_way():
    """No friction, an edge, moving ground, a floor that another body is, collision shapes, joint limits: no prepared form."""
    box = free_body(10.0, [0.1, 0.1, 0.15])
    state = free_state(box, (0.0, 0.0, 0.05))
    plane = rbd.Ground(point=(0, 0, 0), velocity=(0.1, 0, 0, 0, 0, 0))
    edge = rbd.LineContact("edge", "body", half_length=0.1, friction=0.5, placement=pin.SE3(np.eye(3), np.array([0, 0, -0.05])))
    belt = rbd.SurfaceContact("belt", "body", half_lengths=(0.1, 0.1), friction=0.5, on=plane)
    flat = flat_body(1.0, 0.1)
    for start, constraint in (
        (state, sole("body", (0.1, 0.1), 0.05, 0.0)),
        (state, edge),
        (state, belt),
        (flat_state(flat, (0, 0, 0)), floor_point("toe", (0, 0, 0), friction=0.5)),
    ):
        stepping = StepSystem(
            SimulatedMotion(start.robot, (constraint,)), start, impact_speed=1e-3, impacts=20, extrapolate=False
        )
        assert stepping.ground is None, constraint.name
    assert GroundSteps.of(system(*tumbling(0)).points, state) is not None


def test_dependent_rows_step_the_general_way(monkeypatch):
    """Where pivots say that the bodies' rows may depend on each other, a step is solved by M, h and J."""
    motion, state = standing(rbd.load_robot("talos"), 0.7, 3)
    fast = system(motion, state)
    now = fast.begin(state, 0.0).end
    known = fast.solved(now, H)
    asked: list[int] = []
    general = StepSystem._general
    monkeypatch.setattr(StepSystem, "_general", lambda self, *given: asked.append(1) or general(self, *given))
    fast.solved(now, H)
    assert not asked
    kernel = fast.snapshot(state, 0.0).ground._kernel
    monkeypatch.setattr(kernel, "advance", lambda *given: (kernel.UNDECIDED, np.inf))
    assert close(fast.solved(now, H).answer.v, known.answer.v) and asked


def test_memory_does_not_grow_with_steps():
    """After five hundred steps of Solo12 on its feet, two thousand more keep no memory."""
    robot = rbd.load_robot("solo12")
    motion, state = standing(robot, 0.7, 6)
    tau = rbd.hold(robot.standing(), robot.feet(0.7)).tau
    motion = SimulatedMotion(
        robot, motion.constraints, lambda s, t: tau - 2.0 * s.v[6:], None, "coulomb", {}, rbd.simulation.Projection(), 10**9
    )
    times = [H * k for k in range(100_000)]
    samples = TimeStepping().run(motion, state, times)

    def held(steps: int) -> int:
        for _ in range(steps):
            next(samples)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before = held(500)
        once = held(1000)
        twice = held(1000)
    finally:
        tracemalloc.stop()
    assert twice - before < 20_000 and twice - once < 10_000  # bytes


def test_a_ball_rolls_off_as_by_the_general_way():
    """One point on one body: three rows of six; forty steps of a ball that slides, then rolls no further than its point."""
    robot = ball()
    state = free_state(robot, (0.0, 0.0, 0.1), (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 1.0, 0.0))
    point = rbd.PointContact("toe", "body", offset=(0.0, 0.0, -0.1), friction=0.3)
    motion = SimulatedMotion(robot, (point,), stabilisation=rbd.simulation.Projection())
    ends: list[Instant] = []
    for prepared in (True, False):
        stepping = system(motion, state, prepared=prepared)
        now = stepping.begin(state, 0.0).end
        for _ in range(40):
            now = stepping.step(stepping.solved(now, H), now.t + H).end
        ends.append(now)
    assert close(ends[0].at.state.q, ends[1].at.state.q) and close(ends[0].at.state.v, ends[1].at.state.v)


def test_motions_side_by_side_and_one_after_another_do_not_touch_each_other():
    """Pinocchio's data of one motion serve the next; motions at the same time have their own. The same bits each time."""
    robot = rbd.load_robot("solo12")
    feet = robot.feet(0.7)
    tau = rbd.hold(robot.standing(), feet).tau

    def run(seed: int) -> np.ndarray:
        v = 0.05 * np.random.default_rng(seed).normal(size=robot.nv)
        start = robot.standing().with_velocity(v)
        found = rbd.simulate(start, feet, duration=0.03, step=H, controller=lambda s, t: tau - 0.5 * s.v[6:], progress=False)
        return np.concatenate([found.q.ravel(), found.v.ravel(), found.residuals["law"]])

    alone = [run(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(run, [0, 1, 2, 3] * 2))
    for k, found in enumerate(together):
        np.testing.assert_array_equal(found, alone[k % 4])
    assert not np.array_equal(alone[0], alone[1])
