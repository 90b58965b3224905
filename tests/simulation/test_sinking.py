"""A robot that falls, with contacts at its feet alone, does not sink through the floor unnoticed; nothing else is stopped."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.simulation.missing_floor_warning import Floor

STEP = 4e-3


@pytest.fixture(scope="module", params=["talos", "g1", "solo12"])
def limp(request) -> tuple[rbd.Robot, rbd.State, list[rbd.PointContact]]:
    """A robot on its feet, whose motors do nothing."""
    robot = rbd.load_robot(request.param)
    return robot, robot.standing(), list(robot.feet(0.7))


def collapse(robot, state, contacts, duration: float = 0.8, **more):
    """Its fall: forward by a push at its base in the first fifth of a second."""
    force = np.zeros(robot.nv)
    force[0] = 0.4 * robot.mass * 9.81
    return rbd.simulate(
        state, contacts, duration=duration, step=STEP, external=lambda s, t: force if t < 0.2 else None, progress=False, **more
    )


def test_a_robot_that_falls_through_its_floor_stops_the_run(limp):
    """With the motion until then, the body, its depth, and what to give; its trunk is still above the floor."""
    robot, state, feet = limp
    with pytest.raises(rbd.errors.SimulationStopped, match=f"{robot.name} sinks through the floor: bodies with") as stopped:
        collapse(robot, state, feet)
    error = stopped.value
    assert 'rbd.CollisionContacts("bodies", robot), or may_sink=True' in str(error)
    assert error.trajectory.t[-1] == error.t and np.array_equal(error.trajectory.q[-1], error.state.q)
    assert error.trajectory.interrupted == f"stopped at t = {error.t:.6g} s"
    assert error.reason is error.trajectory.end_reason is rbd.errors.Reason.STOPPED_SINKS
    assert error.names == tuple(foot.name for foot in feet)
    below = [
        (inertia.mass, joint)
        for joint, inertia in enumerate(robot.model.inertias)
        if joint
        and (error.state.joint_places([joint])[1][0] + error.state.joint_places([joint])[0][0] @ inertia.lever)[2] < 0.0
    ]
    share = sum(mass for mass, _ in below) / robot.mass
    assert 0.25 <= share < 0.8 and f"bodies with {100.0 * share:.0f} % of its mass" in str(error)
    assert error.state.com[2] > 0.0
    named = next(f for f in robot.model.frames if f"{f.name!r} by" in str(error))
    assert int(named.parentJoint) in [joint for _, joint in below]
    depth = float(str(error).split(f"{named.name!r} by ")[1].split(" m, the deepest.")[0])
    assert 0.0 < depth < 0.4 * state.com[2]


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # of 4 ms
def test_the_same_fall_goes_on_where_that_is_wished(limp):
    """`may_sink=True`: the bits are those of the run that stops, until there; then the floor holds the feet alone."""
    robot, state, feet = limp
    with pytest.raises(rbd.errors.SimulationStopped) as stopped:
        collapse(robot, state, feet)
    kept = stopped.value.trajectory
    duration = STEP * (len(kept) + 5)
    whole = collapse(robot, state, feet, duration, may_sink=True)
    assert len(whole) == len(kept) + 6
    assert np.array_equal(whole.q[: len(kept)], kept.q) and np.array_equal(whole.a[: len(kept)], kept.a)


def test_with_all_shapes_it_lands():
    """Solo12 collapses on its own shapes: the run goes on to the end, and nothing is below the floor."""
    solo = rbd.load_robot("solo12")
    shapes = rbd.CollisionContacts("bodies", solo, friction=0.7)
    fall = collapse(solo, solo.standing(), [shapes], 0.6)
    assert fall.interrupted == "" and fall.com[-1, 2] > 0.02 and fall.residuals["penetration"].max() < 1e-3


def carrier(arm_mass: float, *, motor: bool = True, above: bool = False) -> CheckedModel:
    """A slab of 8 kg, half a metre long, with an arm of 0.4 m that hangs beyond its front edge, or stands on it."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(base, pin.Inertia(8.0, np.array([0.0, 0.0, 0.05]), 0.1 * np.eye(3)), pin.SE3.Identity())
    model.addBodyFrame("slab", base, pin.SE3.Identity(), 0)
    hinge = model.addJoint(base, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.35, 0.0, 0.1])), "hinge")
    lever = np.array([0.0, 0.0, 0.2 if above else -0.2])
    model.appendBodyToJoint(hinge, pin.Inertia(arm_mass, lever, 0.01 * np.eye(3)), pin.SE3.Identity())
    model.addBodyFrame("arm", hinge, pin.SE3.Identity(), 0)
    return CheckedModel(model, name="carrier", passive=() if motor else ("hinge",))


def corners(**more) -> list[rbd.SurfaceContact]:
    """The slab's lower face on the floor."""
    return [rbd.SurfaceContact("face", "slab", half_lengths=(0.4, 0.2), **{"on": 0.0, "friction": 0.7} | more)]


def start(robot: CheckedModel) -> rbd.State:
    """On the floor."""
    return rbd.State(robot, [0, 0, 0, 0, 0, 0, 1, 0])


def test_an_arm_that_reaches_below_the_floor_stops_nothing():
    """A fifth of the mass swings from above the edge of a table to below its top."""
    robot = carrier(2.0, above=True)
    state = start(robot)
    (floor,) = Floor.of(state, corners())
    below = rbd.State(robot, [0, 0, 0, 0, 0, 0, 1, np.pi])
    assert floor.sunk(state) == floor.sunk(below) == ""
    heavy = carrier(4.0, above=True)
    (floor,) = Floor.of(start(heavy), corners())
    on_its_side = rbd.State(heavy, [0, 0, -0.2, 0, 0, 0, 1, np.pi])
    assert floor.sunk(start(heavy)) == "" and "'arm' by 0.3 m" in floor.sunk(on_its_side)


def test_bodies_that_begin_below_are_left_out():
    """A heavy arm that hangs over the edge of a table from the start; it can still tell when the slab sinks."""
    robot = carrier(6.0)
    (floor,) = Floor.of(start(robot), corners())
    assert floor.sunk(rbd.State(robot, [0, 0, -0.04, 0, 0, 0, 1, 0])) == ""
    assert "bodies with 57 % of its mass" in floor.sunk(rbd.State(robot, [0, 0, -0.1, 0, 0, 0, 1, 0]))


def test_only_robots_on_floors_are_looked_at(talos):
    """Not: without motors, on a wall, without friction, on a floor that rises, fixed to the world, without weight."""
    state = talos.standing()
    assert len(Floor.of(state, talos.soles(0.7))) == 1
    assert Floor.of(state, talos.soles(None)) == Floor.of(state, []) == ()
    robot = carrier(2.0)
    assert len(Floor.of(start(robot), corners())) == 1
    passive = carrier(2.0, motor=False)
    assert Floor.of(start(passive), corners()) == ()
    wall = rbd.Ground(normal=(1.0, 0.0, 0.0), point=(0.0, 0.0, 0.0))
    lift = rbd.Ground(normal=(0.0, 0.0, 1.0), velocity=(0.0, 0.0, -1.0, 0.0, 0.0, 0.0))
    belt = rbd.Ground(normal=(0.0, 0.0, 1.0), velocity=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert Floor.of(start(robot), corners(on=wall)) == Floor.of(start(robot), corners(on=lift)) == ()
    assert len(Floor.of(start(robot), corners(on=belt))) == 1
    assert Floor.of(start(robot), corners(friction=0.0)) == ()
    arm = rbd.load_robot("ur5", root="fixed")
    tip = rbd.PointContact("tip", "tool0", friction=0.5, on=0.0)
    assert Floor.of(arm.at(), [tip]) == ()
    box = rbd.testing.box(mass=10.0)
    corner = rbd.PointContact("corner", "box", friction=0.5, on=0.0)
    assert Floor.of(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [corner]) == ()
    weightless = carrier(2.0)
    weightless.model.gravity.linear = np.zeros(3)
    free = CheckedModel(weightless.model, name="free")
    assert Floor.of(start(free), corners()) == ()


def test_a_lower_floor_counts():
    """Soles on a table and shapes on the ground below it: beside the table a robot falls to the ground, and lands there."""
    solo = rbd.load_robot("solo12")
    state = solo.standing()
    q = state.q.copy()
    q[2] += 0.5
    feet = [foot.with_friction(0.7) for foot in solo.feet(0.7)]
    on_table = [rbd.PointContact(f.name, f.frame, offset=f.offset, friction=0.7, on=0.5) for f in feet]
    ground = rbd.CollisionContacts("ground", solo, friction=0.7)
    (table,) = Floor.of(solo.at(q), on_table)
    (both,) = Floor.of(solo.at(q), [*on_table, ground])
    assert table.sunk(state) and both.sunk(state) == ""
    q[2] -= 1.0
    assert both.sunk(solo.at(q))


def test_the_switch_is_checked():
    """A truth value and nothing else."""
    with pytest.raises(rbd.InputError, match="may_sink is 'yes'; expected True or False"):
        rbd.simulate(start(carrier(2.0)), duration=0.1, step=0.01, may_sink="yes")
