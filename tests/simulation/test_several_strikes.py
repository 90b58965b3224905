"""Several impacts in one step: each at its own time, up to as many as are asked for; then what comes through is stopped."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from closed_forms import bounces, bouncing_height
from contact_cases import bouncing_ball
from flat_bodies import chain, flat_body, flat_state, floor_point

import rbd
from rbd.simulation.time_step import StepSystem

G = 9.81
BY = pytest.mark.parametrize("extrapolate", [False, True])


def _touches(found, name=None):
    return [e for e in found.events if e.kind == "touches" and (name is None or e.name == name)]


@BY
@pytest.mark.parametrize("step", [0.02, 0.07])
def test_bounces_that_last_longer_than_a_step_are_those_of_the_series(step, extrapolate):
    """A ball with e = 0.6: times and speeds of its bounces fall as e^k, and its height is exact, wherever steps fall."""
    case, times = bouncing_ball(0.6), bounces(1.0, 0.6, 4)
    found = case.run(1.55, step, integrator=rbd.TimeStepping(extrapolate=extrapolate))
    touched = _touches(found)
    assert len(touched) == len(times)
    assert np.abs(np.array([e.t for e in touched]) - times).max() < 1e-9
    assert np.abs(np.array([e.speed for e in touched]) - np.sqrt(2.0 * G) * 0.6 ** np.arange(4)).max() < 1e-8
    assert case.error(found) < 1e-8


def _falling_mass(height, speed=0.0, name="mass"):
    """A mass above the floor on a slider."""
    robot = chain([("z", pin.JointModelPZ(), 1.0, [0.1] * 3)], names=(name,), name=name)
    return rbd.State(robot, np.array([height]), np.array([speed])), [floor_point("floor", (0.0,) * 3, friction=0.0, frame=name)]


@BY
@pytest.mark.parametrize(("e", "step", "flights"), [(0.9, 0.13, 4), (0.5, 0.06, 10), (0.5, 0.15, 10), (0.7, 0.3, 12)])
def test_bounces_that_last_less_than_a_step_are_those_of_the_series_too(e, step, flights, extrapolate):
    """Where the mass turns round and comes down again in the step in which it struck: each bounce at its time, none caught."""
    start, floor = _falling_mass(0.05)
    by = rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, floor, duration=0.6, step=step, restitution=e, integrator=by, progress=False)
    times = bounces(0.05, e, flights)
    times = times[times < found.t[-1]]
    touched = _touches(found)[: len(times)]
    assert len(times) >= 4
    assert np.abs(np.array([event.t for event in touched]) - times).max() < 1e-9
    for t, q, v in zip(found.t, found.q[:, 0], found.v[:, 0], strict=True):
        if t < times[-1]:
            assert np.abs(np.array([q, v]) - bouncing_height(0.05, e, float(t))).max() < 1e-8


@BY
@pytest.mark.parametrize("step", [0.1, 0.06, 0.01])
def test_what_is_thrown_up_from_the_floor_flies(step, extrapolate):
    """It touches at the start, and is on its way back before the first step is over: z = v t - g t^2 / 2 until 2 v / g."""
    start, floor = _falling_mass(0.0, 0.5)
    by = rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, floor, duration=0.3, step=step, restitution=0.0, integrator=by, progress=False)
    t = found.t
    assert np.abs(found.q[:, 0] - np.maximum(0.5 * t - 0.5 * G * t * t, 0.0)).max() < 1e-9
    (landed,) = [event for event in _touches(found) if event.speed]
    assert abs(landed.t - 2.0 * 0.5 / G) < 1e-9
    assert abs(landed.speed - 0.5) < 1e-8
    assert not found.forces["floor"][0].any()
    assert found.forces["floor"][-1][2] == pytest.approx(G)


@BY
@pytest.mark.parametrize("early", [1e-9, 5e-10, 1e-10, 1e-12, 0.0])
def test_a_strike_at_the_very_end_of_a_step_is_one_strike(early, extrapolate):
    """At 0.2 s less a part of a thousand millionth: no step of no length follows, and it bounces from there."""
    t = 0.2 * (1.0 - early)
    start, floor = _falling_mass(0.5 * G * t * t)
    by = rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, floor, duration=0.35, step=0.05, restitution=0.5, integrator=by, progress=False)
    (struck,) = _touches(found)
    assert abs(struck.t - t) < 1e-11
    assert abs(struck.speed - G * t) < 1e-9
    true = np.array([bouncing_height(0.5 * G * t * t, 0.5, float(x)) for x in found.t])
    assert np.abs(found.q[:, 0] - true[:, 0]).max() < 1e-8
    assert np.abs(found.v[5:, 0] - true[5:, 1]).max() < 1e-7


@BY
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_what_dips_below_the_floor_while_something_else_stops_is_struck(e, extrapolate):
    """A mass that rubs stops in the middle of a step, while another is below the floor, and above it again at the end."""
    joints = [("x", pin.JointModelPX(), 1.0, [0.1] * 3), ("z", pin.JointModelPZ(), 1.0, [0.1] * 3)]
    robot = chain(joints, names=("rubs", "dips"), name="two")
    robot.model.gravity.linear = np.zeros(3)
    high, down, up = 0.0115, 0.4, 4.0
    start = rbd.State(robot, np.array([0.0, high]), np.array([1.0, -down]))
    found = rbd.simulate(
        start, [rbd.JointFriction("rub", "x", 10.0), floor_point("floor", (0.0,) * 3, friction=0.0, frame="dips")],
        duration=0.4, step=0.2, restitution=e, integrator=rbd.TimeStepping(extrapolate=extrapolate), progress=False,
        external=lambda state, t: np.array([0.0, up]),
    )  # fmt: skip
    assert high - down * 0.2 + 0.5 * up * 0.2**2 > 0.0  # above the floor after a step, without the floor
    strikes = (down - np.sqrt(down**2 - 2.0 * up * high)) / up
    speed = down - up * strikes
    (told,) = _touches(found, "floor")
    assert abs(told.t - strikes) < 1e-9
    assert abs(told.speed - speed) < 1e-9
    after = 0.4 - strikes
    assert found.q[-1] == pytest.approx([0.05, e * speed * after + 0.5 * up * after**2], abs=1e-9)
    assert found.v[-1] == pytest.approx([0.0, e * speed + up * after], abs=1e-9)


@pytest.mark.parametrize(
    "given", [{"impact_speed": 0.0}, {"impact_speed": np.nan}, {"impacts": -1}, {"impacts": 2.5}, {"impacts": True},
              {"extrapolate": 1}, {"extrapolate": None}],
)  # fmt: skip
def test_settings_that_are_none_are_refused(given):
    """With what was expected."""
    (name,) = given
    with pytest.raises(rbd.InputError, match=f"{name} is .*; expected"):
        rbd.TimeStepping(**given)


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # one of 0.3 s, at whose end all are at rest
@BY
def test_bodies_that_strike_at_different_times_of_one_step_do_so_in_order(extrapolate):
    """A block held level that lands on a high and on a low step: its edges strike apart, each at its own time."""
    robot = flat_body(2.0, 0.02)
    edges = [
        floor_point("edge0", (-0.2, -0.1), friction=0.0),
        floor_point("edge1", (0.2, -0.1), friction=0.0, anchor=(0.0, 0.0, -0.05)),
    ]
    start, by = flat_state(robot, (0.0, 0.2, 0.0)), rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, edges, duration=0.3, step=0.3, integrator=by, progress=False)
    first, second = _touches(found)[:2]
    assert [first.name, second.name] == ["edge0", "edge1"]
    assert abs(first.t - np.sqrt(2.0 * 0.1 / G)) < 1e-9
    # A plastic blow p at the left edge: J = (1, x), so u- = -v, p = v / (1/m + x^2 / I), and the block turns from there on.
    speed = np.sqrt(2.0 * G * 0.1)
    impulse = speed / (1.0 / 2.0 + 0.2**2 / 0.02)
    assert abs(first.impulse - impulse) < 1e-9
    assert first.t < second.t < 0.3
    assert second.speed > speed


@pytest.mark.parametrize("impacts", [0, 3, 20])
def test_so_many_bodies_bounce_in_one_step_and_the_others_are_stopped(impacts):
    """Four masses fall from different heights in one step; with `impacts=n` the first n bounce, each at its own time."""
    heights, e, step = np.array([0.10, 0.15, 0.20, 0.25]), 0.5, 0.27
    joints = [(f"z{i}", pin.JointModelPZ(), 1.0 + i, [0.1, 0.1, 0.1]) for i in range(4)]
    robot = chain(joints, names=[f"mass{i}" for i in range(4)], name="four_masses")
    floors = [floor_point(f"floor{i}", (0.0, 0.0, 0.0), friction=0.0, frame=f"mass{i}") for i in range(4)]
    times = np.sqrt(2.0 * heights / G)
    assert times[-1] < step < 2.0 * times[0]
    found = rbd.simulate(
        rbd.State(robot, heights), floors, duration=step, step=step, restitution=e, progress=False,
        integrator=rbd.TimeStepping(impacts=impacts),
    )  # fmt: skip
    bounced = min(impacts, 4)
    struck = [event for event in _touches(found) if event.speed]
    assert [event.name for event in struck[:bounced]] == [f"floor{i}" for i in range(bounced)]
    for event, t, mass in zip(struck, times[:bounced], (1.0, 2.0, 3.0, 4.0), strict=False):
        assert abs(event.t - t) < 1e-9
        assert abs(event.speed - G * t) < 1e-9
        assert abs(event.impulse - (1.0 + e) * mass * G * t) < 1e-8
    for i in range(4):
        height, speed = bouncing_height(heights[i], e, step) if i < bounced else (0.0, 0.0)
        assert abs(found.q[-1, i] - height) < 1e-8
        assert abs(found.v[-1, i] - speed) < 1e-8


@BY
def test_extrapolated_steps_are_of_order_two_and_record_the_same_forces(extrapolate):
    """A box pulled along a rough floor by a force that grows with time: it sticks, slips at mu m g, and v has a closed form."""
    robot, m, mu = flat_body(2.0, 0.02), 2.0, 0.4
    edges = [floor_point(f"edge{i}", (x, -0.1), friction=mu) for i, x in enumerate((-0.4, 0.4))]
    start, rate = flat_state(robot, (0.0, 0.1, 0.0)), 20.0
    slips = mu * m * G / rate
    errors = []
    for step in (0.02, 0.01):
        found = rbd.simulate(
            start, edges, duration=0.8, step=step, integrator=rbd.TimeStepping(extrapolate=extrapolate), progress=False,
            external=lambda s, t: np.array([rate * t, 0.0, 0.0]),
        )  # fmt: skip
        t = np.maximum(found.t - slips, 0.0)
        errors.append(np.abs(found.q[:, 0] - rate * t**3 / (6.0 * m)).max())
        friction = sum(found.forces[edge.name][:, 0] for edge in edges)
        expected = -np.minimum(rate * found.t, mu * m * G)
        near = np.abs(found.t - slips) > 2.0 * step
        assert np.abs(friction - expected)[near].max() < 1e-6
        assert np.abs(sum(found.forces[edge.name][:, 2] for edge in edges) - m * G).max() < 1e-6
    assert errors[0] < 0.5 * 0.02**2  # how much depends on where in its step the slip begins
    assert errors[1] < 0.5 * 0.01**2


BALL_ON_ARM = """<robot name="arm">
  <link name="base"/>
  <link name="bar">
    <inertial><origin xyz="0.5 0 0"/><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
    <collision><origin xyz="1 0 0"/><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <joint name="joint" type="{kind}"><parent link="base"/><child link="bar"/><axis xyz="{axis}"/>
    <limit lower="-9" upper="9" effort="9" velocity="99"/></joint>
</robot>"""


def ball_before_a_wall(folder: Path, kind: str, axis: str) -> tuple[rbd.Robot, list[rbd.CollisionContacts]]:
    """A ball of 0.05 m, 1 m along x from a joint of this kind, and a smooth wall that it touches 0.6 m along y."""
    (folder / "arm.urdf").write_text(BALL_ON_ARM.format(kind=kind, axis=axis))
    robot = rbd.load_robot(folder / "arm.urdf", root="fixed")
    wall = rbd.Ground(point=(0.0, 0.65, 0.0), normal=(0.0, -1.0, 0.0))
    return robot, [rbd.CollisionContacts("wall", robot, friction=0.0, on=wall)]


@BY
@pytest.mark.parametrize("swept_deg", [50.0, 85.0])
def test_a_collision_point_that_swings_in_from_far_off_strikes_at_its_time(swept_deg, extrapolate, tmp_path):
    """An arm that turns at 10 rad/s brings its ball to the wall when it has turned by asin 0.6; the rate is halved.

    At the step's beginning the ball is 0.6 m off, beyond the margin within which points are watched; at its end the arm has
    swept 50 or 85 degrees. At 85 the ball moves along the wall, 0.4 m deep in it: back along its velocity it was never outside.
    """
    robot, wall = ball_before_a_wall(tmp_path, "revolute", "0 0 1")
    step, turned = np.deg2rad(swept_deg) / 10.0, np.arcsin(0.6)
    start, by = rbd.State(robot, np.array([0.0]), np.array([10.0])), rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, wall, duration=2.0 * step, step=step, restitution=0.5, integrator=by, progress=False)
    (struck,) = _touches(found)
    assert abs(struck.t - turned / 10.0) < 1e-9
    assert abs(struck.speed - 10.0 * 0.8) < 1e-8
    assert found.v[-1] == pytest.approx([-5.0], abs=1e-9)
    assert found.q[-1] == pytest.approx([turned - 5.0 * (found.t[-1] - turned / 10.0)], abs=1e-9)


@BY
def test_a_collision_point_that_flies_in_straight_is_located_at_the_first_try(extrapolate, tmp_path, monkeypatch):
    """At 20 m/s, steps of 1 m: back along its velocity it touched at 0.6 m; the whole step, the part to there, and the rest."""
    robot, wall = ball_before_a_wall(tmp_path, "prismatic", "0 1 0")
    lengths, finish = [], StepSystem._finish
    monkeypatch.setattr(StepSystem, "_finish", lambda self, half, h: lengths.append(h) or finish(self, half, h))
    start, by = rbd.State(robot, np.array([0.0]), np.array([20.0])), rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, wall, duration=0.05, step=0.05, restitution=0.5, integrator=by, progress=False)
    assert lengths == pytest.approx([0.05, 0.03, 0.02], rel=1e-12)
    (struck,) = _touches(found)
    assert (struck.t, struck.speed) == pytest.approx((0.03, 20.0), rel=1e-12)
    assert found.q[-1] == pytest.approx([0.6 - 10.0 * 0.02], abs=1e-12)
