"""Eggs and tyres on planes, balls in bowls and pipes and on globes: closed forms, limits and invariants."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import free, state_of

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.testing import check_constraint

G = 9.81
HERE = pin.SE3.Identity()
RADII = np.array([0.4, 0.2, 0.3])
MOVING = {"velocity": (0.3, -0.2, 0.5, 0.4, 0.3, -0.7), "acceleration": (1, 2, 3, 0.3, 0.2, 0.1), "about": (0.3, 0.4, 0.5)}


def rim(R: float):
    """The rim of a disk about y, as a function of the normal."""
    return lambda u: R * np.array([u[0], 0.0, u[2]]) / np.hypot(u[0], u[2])


KINDS = {
    "egg": lambda **more: rbd.constraints.RollingBody("it", "body", shape=RADII, **more),
    "tyre": lambda **more: rbd.constraints.RollingBody("it", "body", shape=rim(0.3), radius=0.1, **more),
    "bowl": lambda **more: rbd.constraints.RollingOnRound("it", "body", radius=0.1, surface_radius=-0.7, **more),
    "globe": lambda **more: rbd.constraints.RollingOnRound("it", "body", radius=0.1, surface_radius=0.7, **more),
    "pipe": lambda **more: rbd.constraints.RollingOnRound(
        "it", "body", radius=0.1, surface_radius=-0.7, axis=(0.2, 1, 0.4), **more
    ),
    "shaft": lambda **more: rbd.constraints.RollingOnRound(
        "it", "body", radius=0.1, surface_radius=0.7, axis=(0.2, 1, 0.4), **more
    ),
}


@pytest.fixture
def tumbling(rng: np.random.Generator) -> rbd.State:
    """A body with no symmetry, anyhow."""
    robot = free(pin.Inertia.FromBox(2.0, 0.1, 0.2, 0.3))
    return rbd.State(robot, pin.integrate(robot.model, pin.neutral(robot.model), rng.normal(size=6)), rng.normal(size=6))


@pytest.mark.parametrize("friction", [None, 0.5, 0.0])
@pytest.mark.parametrize("kind", KINDS)
def test_what_rolls_describes_its_motion(tumbling, kind, friction):
    """The gap's two derivatives, and the change of the other rows along the motion, off the surface and slipping: to 1e-9."""
    for more in ({}, MOVING):
        rolling = KINDS[kind](friction=friction, on=rbd.Ground(normal=(0.6, 0, 0.8), point=(0.1, 0.2, 0.3), **more))
        report = check_constraint(rolling, tumbling)
        assert report.rows == (1 if friction == 0.0 else 3)
        assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_what_rolls_on_a_body_describes_its_motion(kind, rng):
    """On another body that moves; opposite forces: the momentum of both is unchanged."""
    model = pin.Model()
    for name in ("body", "other"):
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), HERE, name)
        model.appendBodyToJoint(joint, pin.Inertia.Random(), HERE)
        X = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        model.addFrame(pin.Frame("body" if name == "body" else "plate", joint, 0, X, pin.FrameType.OP_FRAME))
    robot = CheckedModel(model, passive=(), name="two")
    state = rbd.State(robot, pin.integrate(model, pin.neutral(model), rng.normal(size=12)), rng.normal(size=12))
    rolling = KINDS[kind](friction=0.5, on=rbd.Body("plate"))
    report = check_constraint(rolling, state)
    assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-9
    rows = rolling.rows(state)
    R = [pin.XYZQUATToSE3(state.q[i : i + 7]).rotation for i in (0, 7)]
    assert np.abs(R[0] @ rows.J[:, :3].T + R[1] @ rows.J[:, 6:9].T).max() < 1e-13


def test_the_point_that_touches_is_the_lowest_of_the_surface(tumbling):
    """Of many points of an ellipsoid and of a tyre; the rows are the velocity of that material point."""
    n = np.array([0.6, 0.0, 0.8])
    X, h, model = pin.XYZQUATToSE3(tumbling.q), 1e-5, tumbling.robot.model
    u = np.random.default_rng(1).normal(size=(20000, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    circle = np.stack([u[:, 0], 0.0 * u[:, 0], u[:, 2]], axis=1) / np.hypot(u[:, 0], u[:, 2])[:, None]
    for kind, points in (("egg", RADII * u), ("tyre", 0.3 * circle + 0.1 * u)):
        rows = KINDS[kind](on=rbd.Ground(normal=n, point=(0.0, 0.0, 0.0)), friction=0.4).rows(tumbling)
        p = rows.patch.point
        heights = (X.translation + points @ X.rotation.T) @ n
        assert 0.0 <= heights.min() - p @ n < 1e-2 and rows.error[2] == pytest.approx(p @ n)
        ends = [pin.XYZQUATToSE3(pin.integrate(model, tumbling.q, s * h * tumbling.v)).act(X.actInv(p)) for s in (1.0, -1.0)]
        assert np.abs(rows.patch.axes @ rows.velocity - (ends[0] - ends[1]) / (2.0 * h)).max() < 1e-8


def test_a_sphere_and_a_rim_are_the_limits(tumbling):
    """Equal semi-axes are a ball, a rim grown by nothing is a disk, a globe of 1e7 m is a plane."""
    ground = rbd.Ground(normal=(0.6, 0, 0.8), point=(0.1, 0.2, 0.3))
    ball = rbd.RollingBall("it", "body", radius=0.3, on=ground).rows(tumbling)
    for other in (
        rbd.constraints.RollingBody("it", "body", shape=(0.3, 0.3, 0.3), on=ground),
        rbd.constraints.RollingBody("it", "body", shape=(0.2, 0.2, 0.2), radius=0.1, on=ground),
        rbd.constraints.RollingBody("it", "body", shape=lambda u: 0.3 * u, on=ground),
    ):
        rows = other.rows(tumbling)
        for name in ("J", "bias", "velocity", "error"):
            assert np.abs(getattr(rows, name) - getattr(ball, name)).max() < 1e-12
    disk = rbd.RollingDisk("it", "body", radius=0.3, on=ground).rows(tumbling)
    rows = rbd.constraints.RollingBody("it", "body", shape=rim(0.3), on=ground).rows(tumbling)
    turn = rows.patch.axes.T @ disk.patch.axes
    assert np.abs(turn @ disk.J - rows.J).max() < 1e-12 and np.abs(disk.bias[2] - rows.bias[2]).max() < 1e-10
    far = 1e7 * np.array([0.6, 0.0, 0.8])
    centre = rbd.Ground(point=np.array([0.1, 0.2, 0.3]) - far)
    globe = rbd.constraints.RollingOnRound("it", "body", radius=0.3, surface_radius=1e7, on=centre)
    assert np.abs(globe.rows(tumbling).J - ball.J).max() < 1e-6


def test_an_egg_that_rolls_keeps_its_energy():
    """Without slip, over a second of tumbling on a slope: energy to 1e-8, the gap to 1e-11; as a function it moves alike."""
    robot = free(pin.Inertia.FromEllipsoid(2.0, *RADII))
    R = pin.exp3(np.array([0.4, -0.3, 0.2]))
    n = np.array([np.sin(0.2), 0.0, np.cos(0.2)])
    egg = rbd.constraints.RollingBody("egg", "body", shape=RADII, on=rbd.Ground(normal=n, point=(0.0, 0.0, 0.0)))
    r = R @ egg.surface(-R.T @ n)
    w = np.array([1.0, 2.0, -0.5])
    state = state_of(robot, R, -r @ n * n, -np.cross(w, r), w)
    assert np.abs(egg.rows(state).velocity).max() < 1e-14 and abs(egg.rows(state).error[2]) < 1e-15
    motion = rbd.simulate(state, [egg], duration=1.0, step=2e-3, progress=False)
    assert np.ptp(motion.energy) < 1e-8 and motion.residuals["drift"].max() < 1e-11
    same = rbd.constraints.RollingBody("egg", "body", shape=lambda u: RADII**2 * u / np.sqrt(u @ (RADII**2 * u)), on=egg.on)
    again = rbd.simulate(state, [same], duration=0.2, step=2e-3, progress=False)
    assert np.abs(again.q - motion.q[: len(again.q)]).max() < 1e-12


def test_an_egg_falls_strikes_and_comes_to_roll():
    """With friction: it lands by impacts at its lowest point, and slips until it rolls; no violated law, no gain of energy."""
    robot = free(pin.Inertia.FromEllipsoid(2.0, *RADII))
    egg = rbd.constraints.RollingBody("egg", "body", shape=RADII, friction=0.6)
    start = state_of(robot, pin.exp3(np.array([0.4, -0.3, 0.2])), (0, 0, 0.5), (1.0, 0, 0), (0, 0, 0))
    motion = rbd.simulate(start, [egg], duration=0.8, step=2e-3, progress=False)
    assert motion.events[0].kind == "touches" and motion.residuals["law"].max() < 1e-8
    assert motion.residuals["penetration"].max() < 1e-6
    lowest = [egg.rows(rbd.State(robot, q)).error[2] for q in motion.q]
    assert min(lowest) > -1e-6 and lowest[0] > 0.1
    assert np.diff(motion.energy).max() < 1e-4


def test_a_ball_in_a_pipe_goes_up_and_down():
    """In an upright pipe it does not sink: z swings at sqrt(2/7) of the rate at which it goes round the axis."""
    m, r, R, rate = 0.05, 0.1, 0.5, 6.0
    robot = free(pin.Inertia.FromSphere(m, r))
    pipe = rbd.constraints.RollingOnRound(
        "pipe", "body", radius=r, surface_radius=-R, axis=(0, 0, 1), on=rbd.Ground(point=(0, 0, 0))
    )
    c = np.array([R - r, 0.0, 0.0])
    v = rate * np.array([0.0, R - r, 0.0])
    w = np.array([0.0, 0.0, -v[1] / r])  # it rolls: v + w x (r, 0, 0) = 0
    state = state_of(robot, np.eye(3), c, v, w)
    assert np.abs(pipe.rows(state).velocity).max() < 1e-13
    exact = rbd.simulation.DormandPrince8()
    motion = rbd.simulate(state, [pipe], duration=1.0, step=5e-3, integrator=exact, progress=False)
    swing = rate * np.sqrt(2.0 / 7.0)
    sink = 5.0 / 7.0 * G / swing**2
    assert np.abs(motion.q[:, 2] + sink * (1.0 - np.cos(swing * motion.t))).max() < 1e-7
    assert np.abs(np.hypot(*motion.q[:, :2].T) - (R - r)).max() < 1e-11


def test_a_marble_swings_in_a_bowl():
    """As a pendulum of length 7/5 (R - r): th'' = -5/7 g sin(th) / (R - r), and the bowl carries m (g cos + (R - r) th'^2)."""
    m, r, R, th = 0.02, 0.05, 0.6, 0.8
    bowl = rbd.constraints.RollingOnRound(
        "bowl", "body", radius=r, surface_radius=-R, friction=0.5, on=rbd.Ground(point=(0, 0, R))
    )
    n = np.array([-np.sin(th), 0.0, np.cos(th)])
    state = state_of(free(pin.Inertia.FromSphere(m, r)), np.eye(3), np.array([0, 0, R]) - (R - r) * n, np.zeros(3), np.zeros(3))
    for law in ("coulomb", "convex"):
        found = rbd.solve(state, [], [bowl], law=law)
        assert np.linalg.norm(found.a[:3]) == pytest.approx(5.0 / 7.0 * G * np.sin(th), rel=1e-9)
        assert found.forces["bowl"] @ n == pytest.approx(m * G * np.cos(th), rel=1e-9)
    slick = rbd.constraints.RollingOnRound("bowl", "body", radius=r, surface_radius=-R, friction=0.1, on=bowl.on)
    slips = rbd.solve(state, [], [slick], solver=rbd.ConeSolver())  # 2/7 tan(0.8) = 0.294 is needed
    assert np.linalg.norm(slips.a[:3]) == pytest.approx(G * (np.sin(th) - 0.1 * np.cos(th)), rel=1e-7)


def test_a_ball_leaves_a_globe():
    """Without friction at cos = 2/3 of the top's height; it rolls with a force that vanishes at 10/17."""
    m, r, R = 1.0, 0.1, 1.0
    robot = free(pin.Inertia.FromSphere(m, r))

    def make(mu: float | None) -> rbd.constraints.RollingOnRound:
        """The ball on the globe."""
        return rbd.constraints.RollingOnRound(
            "globe", "body", radius=r, surface_radius=R, friction=mu, on=rbd.Ground(point=(0, 0, 0))
        )

    th = 0.05
    n = np.array([np.sin(th), 0.0, np.cos(th)])
    state = state_of(robot, np.eye(3), (R + r) * n, np.zeros(3), np.zeros(3))
    motion = rbd.simulate(state, [make(0.0)], duration=1.6, step=2e-3, progress=False)
    leaves = next(event.t for event in motion.events if event.kind == "leaves")
    i = int(np.searchsorted(motion.t, leaves))
    assert motion.q[i, 2] / (R + r) == pytest.approx(2.0 / 3.0 * np.cos(th), abs=5e-3)
    top = np.arccos(10.0 / 17.0 * np.cos(th))
    speed = np.sqrt(10.0 / 7.0 * G * (R + r) * (np.cos(th) - np.cos(top)))
    n, along = np.array([np.sin(top), 0.0, np.cos(top)]), np.array([np.cos(top), 0.0, -np.sin(top)])
    rolls = state_of(robot, np.eye(3), (R + r) * n, speed * along, np.cross(n, speed * along) / r)
    held = rbd.solve(rolls, [], [make(None)])
    assert abs(held.forces["globe"] @ n) < 1e-9


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: KINDS["egg"](friction=-1.0), "friction"),
        (lambda: rbd.constraints.RollingBody("it", "body", shape=(0.1, 0.0, 0.1)), "semi-axes > 0"),
        (lambda: rbd.constraints.RollingBody("it", "body", shape=(0.1, 0.1)), "shape"),
        (lambda: rbd.constraints.RollingBody("it", "body", shape=(0.1, 0.1, 0.1), radius=-0.1), "expected a length >= 0"),
        (lambda: rbd.constraints.RollingOnRound("it", "body", radius=0.0, surface_radius=1.0), "expected a length > 0"),
        (
            lambda: rbd.constraints.RollingOnRound("it", "body", radius=0.1, surface_radius=0.0),
            "is zero; expected a length, or minus",
        ),
        (lambda: rbd.constraints.RollingOnRound("it", "body", radius=0.5, surface_radius=-0.5), "expected a smaller ball"),
        (lambda: rbd.constraints.RollingOnRound("it", "body", radius=0.1, surface_radius=1.0, axis=(0, 0, 0)), "length 0"),
    ],
)
def test_what_rolls_nowhere_is_refused(make, words):
    """With what was expected."""
    with pytest.raises(rbd.InputError, match=words):
        make()


def test_a_function_that_gives_no_point_is_refused(tumbling):
    """One that raises, and one of the wrong size; a ball with its centre at that of the bowl."""
    for shape, words in (
        (lambda u: 1 / 0, "shape of 'it' raised ZeroDivisionError"),
        (lambda u: u[:2], "shape of 'it' at the normal"),
        (lambda u: np.full(3, np.nan), "not finite"),
    ):
        with pytest.raises(rbd.InputError, match=words):
            rbd.constraints.RollingBody("it", "body", shape=shape).rows(tumbling)
    with pytest.raises(rbd.InputError, match="touches at no one point"):
        KINDS["bowl"](on=rbd.Ground(point=tumbling.q[:3])).rows(tumbling)
