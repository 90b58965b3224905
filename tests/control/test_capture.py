"""Capture regions: closed forms, forces of the motions that prove them, and simulations from both sides."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.control import CaptureRegion, capture_region
from rbd.errors import InputError


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


def same_corners(a: np.ndarray, b: np.ndarray) -> None:
    """Two polygons have the same corners."""
    assert len(a) == len(b)
    for corner in a:
        assert np.abs(b - corner).max(axis=1).min() < 1e-6


def test_a_point_mass_has_the_hull_of_its_contacts(solo: rbd.Robot) -> None:
    """Enough friction, no angular momentum, no torque limits: both polygons are the hull of the feet."""
    state, feet = solo.standing(), solo.feet(friction=5.0)
    region = capture_region(state, feet, torque_limits=False, momentum=0.0, friction="inscribed")
    hull = convex_hull(np.array([state.frame(f.frame).X_WF.act(f.placement.translation)[:2] for f in feet]))
    same_corners(region.inner, hull)
    same_corners(region.outer, hull)


def test_friction_bounds_the_inner_region(solo: rbd.Robot) -> None:
    """The first force leans by at most mu: |x - c| <= mu h, reached to the error of the polygon."""
    state = solo.standing()
    region = capture_region(state, solo.feet(friction=0.5))
    far = np.linalg.norm(region.inner - state.com[:2], axis=1).max()
    assert far <= 0.5 * region.height * (1.0 + 1e-6) and far == pytest.approx(0.5 * region.height, rel=2e-3)


def test_the_outer_bound_is_moved_out_by_momentum_and_height(solo: rbd.Robot) -> None:
    """L / (m h w), and (H / h)^1.5 - 1 of the distance to the edge."""
    state, feet = solo.standing(), solo.feet(friction=5.0)
    h = capture_region(state, feet).height
    region = capture_region(state, feet, momentum=0.2, highest=1.2 * h)
    hull = capture_region(state, feet, momentum=0.0).outer
    by = 0.2 / (solo.mass * h * region.rate)
    for way in (0, 1):
        edge = hull[:, way].max()
        wanted = edge + by + (1.2**1.5 - 1.0) * (edge - state.com[way])
        assert region.outer[:, way].max() == pytest.approx(wanted, abs=1e-9)


def test_no_motion_brings_back_what_is_beyond_the_outer_bound() -> None:
    """Any height up to H, any angular momentum up to Lmax, any centre of pressure: K about the edge never falls to zero."""
    rng, m, g, h = np.random.default_rng(1), 30.0, 9.81, 0.8
    for _ in range(50):
        top, most, inside = h * rng.uniform(1.0, 1.3), rng.uniform(0.0, 5.0), rng.uniform(0.02, 0.3)
        w = np.sqrt(g / h)
        beyond = most / (m * h * w) + ((top / h) ** 1.5 - 1.0) * inside + 1e-3
        u, K, t, dt = -inside / h, m * h * w * (inside + beyond), 0.0, 1e-3  # z' = 0 at the beginning
        a, b, at = rng.uniform(1.0, 8.0), rng.uniform(0.0, 6.0), rng.uniform(0.5, 1.0)
        for _ in range(3000):
            z = at * top + (h - at * top) * np.exp(-a * t)
            L = most * np.cos(b * t)
            pressure = 0.05 * rng.uniform()  # inside the edge
            u, K, t = u + dt * (K - L) / (m * z**2), K + dt * m * (g * z * u + g * pressure), t + dt
            assert K > 0.0
            if u > 0.1:
                break
        assert u > 0.1


def test_forces_of_the_motion_to_rest_obey_newton_and_euler(talos: rbd.Robot) -> None:
    """At any time: forces accelerate the centre of mass, have no moment about it, and keep their cones."""
    state, soles = talos.standing(), talos.soles(friction=0.5)
    region = capture_region(state, soles)
    x = region.inner[0] + 0.3 * (region.inner[2] - region.inner[0])
    assert region.contains(x)
    m, g = talos.mass, talos.gravity
    for t in (0.0, 0.07, 0.4, 3.0):
        forces, (c, v) = region.forces(x, t), region.com(x, t)
        total, moment = np.zeros(3), np.zeros(3)
        for row in region.end.loads.rows:
            f = forces[row.name]
            total += f[:3]
            moment += np.cross(row.patch.point - c, f[:3]) + f[3:]
            assert np.hypot(f[0], f[1]) <= 0.5 * f[2] + 1e-6 * m * 9.81
        acceleration = -region.rate * v
        assert total == pytest.approx(m * (acceleration - g), abs=1e-6 * m * 9.81)
        assert moment == pytest.approx(np.zeros(3), abs=1e-5 * m * 9.81)
    assert (c + v / region.rate)[:2] == pytest.approx(x, abs=1e-12)


def test_the_capture_point_of_a_state(solo: rbd.Robot) -> None:
    """Of a body that translates, c + c' / w."""
    v = np.zeros(solo.nv)
    v[0] = 0.2
    region = capture_region(solo.standing().with_velocity(v), solo.feet(friction=0.7))
    assert region.capture_point == pytest.approx(solo.standing().com[:2] + [0.2 / region.rate, 0.0], abs=1e-9)


class FallsError(Exception):
    """It is gone."""


def comes_to_rest(region: CaptureRegion, feet: list, x: np.ndarray) -> bool:
    """A simulation from the velocity of a capture point, with feet that stay: a controller follows the motion to rest.

    The motion has no angular momentum. A newton metre second of it moves the capture point of Talos by 4 mm, 1 / (m h w), so
    near the edge both must be followed before the posture: centre of mass and momentum cost much more than it.
    """
    state, robot, w = region.state, region.state.robot, region.rate
    A_g, _, m = state.centroidal()
    A = np.concatenate([*[foot.rows(state).J for foot in feet], A_g])
    b = np.zeros(len(A))
    b[-6:-4] = m * w * (x - state.com[:2])
    v = np.linalg.lstsq(A, b, rcond=1e-9)[0]
    assert np.abs(A @ v - b).max() < 1e-6

    def com(t: float) -> rbd.control.Reference:
        c, v = region.com(x, t)
        return rbd.control.Reference(c, v, -w * v)

    base = robot.model.names[robot.bases[0]]
    tasks = [
        rbd.control.ComTask(com, cost=1e5, gain=60.0),
        rbd.control.MomentumTask(angular_cost=1e3, gain=20.0),
        rbd.control.FrameTask(base, state.frame(base).X_WF.rotation, orientation_cost=10.0, gain=80.0),
        rbd.control.PostureTask(state.q, cost=0.5, gain=40.0),
    ]

    def watched(now: rbd.State, t: float) -> tuple:
        if np.abs(now.com - state.com).max() > 0.5 * region.height:
            raise FallsError
        return ()

    given = {"external": watched, "progress": False, "record_every": 10}
    control = rbd.control.WholeBodyController(tasks, feet)
    try:
        run = rbd.simulate(state.with_velocity(v), feet, duration=1.5, step=2e-3, controller=control, **given)
    except rbd.errors.SimulationStopped as stopped:
        if isinstance(stopped.__cause__, FallsError):
            return False
        raise
    return bool(np.linalg.norm(run.momentum[-1, :3]) < 0.02 * m)


def draws_inside(region: CaptureRegion, n: int, seed: int) -> list[np.ndarray]:
    """Capture points of the inner polygon, evenly drawn, up to its edge."""
    rng, out = np.random.default_rng(seed), list[np.ndarray]()
    while len(out) < n:
        x = rng.uniform(region.inner.min(axis=0), region.inner.max(axis=0))
        if region.contains(x):
            out.append(x)
    return out


def test_talos_comes_to_rest_from_inside(talos: rbd.Robot, exhaustive: bool) -> None:
    """None of 200 capture points of the inner polygon falls, however near the edge; four by default, half within 4 mm of it."""
    soles = talos.soles(friction=0.7)
    region = capture_region(talos.standing(), soles, friction="inscribed")
    drawn = draws_inside(region, 200, 2026)
    if not exhaustive:
        near = [x for x in drawn if inside_distance(x, region.inner) < 4e-3]
        drawn = [*near[:2], *drawn[:2]]
    fell = [x for x in drawn if not comes_to_rest(region, soles, x)]
    assert len(drawn) >= 4 and not fell, fell


def test_simulations_from_both_sides(solo: rbd.Robot, exhaustive: bool) -> None:
    """It comes to rest from inside, 5 mm from the edge; from beyond it falls. The controller has pyramids for cones."""
    feet, rng = solo.feet(friction=0.7), np.random.default_rng(3)
    region = capture_region(solo.standing(), feet, friction="inscribed")
    inside, beyond, (some, others) = list[np.ndarray](), list[np.ndarray](), (4, 3) if exhaustive else (1, 1)
    while len(inside) < some or len(beyond) < others:
        x = rng.uniform(region.outer.min(axis=0) - 0.1, region.outer.max(axis=0) + 0.1)
        if inside_distance(x, region.inner) > 5e-3:
            inside.append(x)
        elif region.beyond(x):
            beyond.append(x)
    assert all(comes_to_rest(region, feet, x) for x in inside[:some])
    assert not any(comes_to_rest(region, feet, x) for x in beyond[:others])


def test_what_is_refused(solo: rbd.Robot) -> None:
    """Contacts that are not level, points that are none or outside, limits that are none."""
    state, feet = solo.standing(), solo.feet(friction=0.7)
    tilted = rbd.Ground(point=(0.0, 0.0, 0.0), normal=(0.6, 0.0, 0.8))
    with pytest.warns(rbd.errors.RbdWarning), pytest.raises(InputError, match="expected all on one level plane"):
        capture_region(state, solo.feet(friction=0.7, on=tilted))
    region = capture_region(state, feet)
    with pytest.raises(InputError, match="expected one in the inner polygon"):
        region.forces([0.5, 0.0], 0.0)
    with pytest.raises(InputError, match="capture point"):
        region.contains([0.1, 0.0, 0.2])
    with pytest.raises(InputError, match="highest of capture_region"):
        capture_region(state, feet, highest=0.01)
    with pytest.raises(InputError, match="in one line"):
        capture_region(state, feet[:2])


def test_it_is_drawn_from_above(solo: rbd.Robot) -> None:
    """Both polygons, the feet, the capture point."""
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    region = capture_region(solo.standing(), solo.feet(friction=0.7))
    region.plot(axes)
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names[:2] == ["comes to rest from here", "from outside it cannot"] and "capture point" in names
