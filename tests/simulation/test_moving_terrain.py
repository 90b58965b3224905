"""Pieces of terrain that move: lifts, conveyors, carts, against closed forms; and shapes on ground that moves."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.constraints.terrain.pieces import EDGES
from rbd.model.content_hash import digest

G = 9.81
BOX = rbd.testing.box(mass=2.0)
REST = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
FLOOR = rbd.Terrain.boxes([(-5, -1, -1), (5, 1, 0)])


def lifted(t: float) -> Array:
    """Up by 0.1 m and back each second, with its derivatives."""
    w = 2.0 * math.pi
    x = 0.05 * (1.0 - math.cos(w * t)), 0.05 * w * math.sin(w * t), 0.05 * w * w * math.cos(w * t)
    return np.outer(x, [0.0, 0.0, 1.0])


def shaken(t: float) -> Array:
    return np.array([
        [0.1 * math.sin(3 * t), 0.05 * t * t, 0.05 * math.sin(4 * t)],
        [0.3 * math.cos(3 * t), 0.1 * t, 0.2 * math.cos(4 * t)],
        [-0.9 * math.sin(3 * t), 0.1, -0.8 * math.sin(4 * t)],
    ])  # fmt: skip


def face(on: Any, **given: Any) -> rbd.SurfaceContact:
    return rbd.SurfaceContact("face", "box", on=on, **{"half_lengths": (0.1, 0.1), "friction": 0.6, **given})


def run(state: rbd.State, contact: Any, duration: float, step: float, **given: Any) -> rbd.Trajectory:
    return rbd.simulate(state, [contact], duration=duration, step=step, progress=False, **given)


@pytest.mark.parametrize("friction", [None, 0.6, 0.0])
def test_a_box_on_a_lift_presses_with_its_mass_times_g_plus_a(friction):
    """Smooth and stepped, to 1e-10 N; it is the motion on a plane that moves alike, to 1e-12."""
    lift = FLOOR.with_motion("box 0", motion=lifted)
    step = 1e-2 if friction is None else 2e-3
    found, plane = (
        run(rbd.State(BOX, REST), face(on, friction=friction), 0.5, step)
        for on in (lift, rbd.Ground(point=(0, 0, 0), motion=lifted))
    )
    height, speed, up = np.array([lifted(t)[:, 2] for t in found.t]).T
    assert np.abs(found.forces["face"][:, 2] - 2.0 * (G + up)).max() <= 1e-10
    assert np.abs(found.q[:, 2] - height).max() <= (1e-12 if friction is None else 1e-9)
    assert np.abs(found.v[:, 2] - speed).max() <= 1e-12
    assert not found.events
    assert np.abs(found.q - plane.q).max() <= 1e-12
    assert np.abs(found.v - plane.v).max() <= 1e-12
    assert np.abs(found.residuals["energy"] - plane.residuals["energy"]).max() <= 1e-12
    assert np.abs(found.residuals["energy"]).max() <= 1e-3 * found.kinetic.max()


def test_a_tumbling_box_on_one_piece_that_moves_is_that_on_a_plane_that_moves():
    """It falls, tips and slides, with impacts, on a piece that is shaken along three axes."""
    q = np.concatenate([[0.0, 0.0, 0.03], pin.Quaternion(pin.rpy.rpyToMatrix(0.03, 0.05, 0.4)).coeffs()])
    v = [0.5, 0.0, -0.3, 0.1, 0.2, 0.0]
    runs = [
        run(rbd.State(BOX, q, v), face(on, half_lengths=(0.2, 0.1), friction=0.4), 0.25, 2e-3)
        for on in (FLOOR.with_motion("box 0", motion=shaken), rbd.Ground(point=(0, 0, 0), motion=shaken))
    ]
    assert len(runs[0].events) == len(runs[1].events) > 3
    assert np.abs(runs[0].q - runs[1].q).max() <= 1e-12


def test_a_lift_that_falls_faster_than_gravity_is_left_and_caught_again():
    """The lift is at z = -a cos w t, a w^2 = 2 g: left where its acceleration is -g, and met again by a parabola."""
    a, w = 0.02, math.sqrt(2.0 * G / 0.02)
    lift = FLOOR.with_motion("box 0", motion=lambda t: (0.0, 0.0, -a * math.cos(w * t)))
    leaves = (2.0 * math.pi / 3.0) / w
    z, speed = -a * math.cos(w * leaves), a * w * math.sin(w * leaves)
    meets = leaves + 1e-3
    while z + speed * (meets - leaves) - 0.5 * G * (meets - leaves) ** 2 > -a * math.cos(w * meets):
        meets += 1e-3
    for _ in range(50):  # Newton's method
        s = meets - leaves
        off, rate = z + speed * s - 0.5 * G * s * s + a * math.cos(w * meets), speed - G * s - a * w * math.sin(w * meets)
        meets -= off / rate
    for h in (1e-3, 5e-4):
        found = run(rbd.State(BOX, [0, 0, -a, 0, 0, 0, 1]), face(lift, friction=0.0), meets + 0.02, h)
        kinds = {event.kind: event.t for event in found.events}
        assert abs(kinds["leaves"] - leaves) <= 2.0 * h
        late = 0.5 * a * w**3 * h * h * (meets - leaves)  # of one that leaves a step too late
        assert abs(kinds["touches"] - meets) <= 1e-4
        t = found.t[(found.t > leaves + 2 * h) & (found.t < meets)]
        flight = z + speed * (t - leaves) - 0.5 * G * (t - leaves) ** 2
        assert np.abs(found.q[np.searchsorted(found.t, t), 2] - flight).max() <= late


def test_a_box_on_a_conveyor_slides_until_it_is_as_fast():
    """After v / (mu g), on a way of v^2 / (2 mu g); the belt stays where it is, and its side runs along itself."""
    belt, mu = FLOOR.with_motion("box 0", velocity=(0.8, 0.0, 0.0)), 0.4
    stops = 0.8 / (mu * G)
    found = run(rbd.State(BOX, REST), face(belt, friction=mu), 0.4, 2e-3)
    assert {event.kind for event in found.events} == {"sticks"}
    assert max(abs(event.t - stops) for event in found.events) <= 1e-12
    assert found.v[-1] == pytest.approx([0.8, 0, 0, 0, 0, 0], abs=1e-12)
    assert found.q[-1, 0] == pytest.approx(0.8 * 0.4 - 0.8**2 / (2.0 * mu * G), abs=1e-12)
    assert np.abs(found.residuals["energy"]).max() <= 1e-12
    beside = rbd.PointContact("toe", "box", friction=0.5, on=belt)
    rows = beside.source(rbd.State(BOX, REST)).at(rbd.State(BOX, [5.001, 0.0, -0.5, 0, 0, 0, 1]), 0.0)  # at its end
    assert np.abs(rows.velocity).max() <= 1e-15


def test_rates_of_points_on_pieces_that_move():
    """The gap's rate, and J_dot v by differences in time, of corners, crossings and what is under a sole."""
    rng, h, met = np.random.default_rng(1), 1e-6, 0
    still = rbd.Terrain.boxes([(-1, -1, -0.5), (0, 0.03, 0.0)], [(-1, 0.2, -0.5), (0, 1, -0.02)])
    for a, b in (("box 0", "box 1"), ("box 1", "box 0")):
        terrain = still.with_motion(a, motion=shaken).with_motion(b, velocity=(0.3, 0.2, 0.1))
        source: Any = face(terrain, half_lengths=(0.2, 0.1)).source(rbd.State(BOX, REST))
        for _ in range(40):
            turn = pin.Quaternion(pin.rpy.rpyToMatrix(*rng.uniform(-0.3, 0.3, 2), rng.uniform(-3.0, 3.0))).coeffs()
            q, v = np.concatenate([[-0.03, 0.01, rng.uniform(0.0, 0.02)], turn]), rng.normal(size=6)
            found = []
            for t in (-h, 0.0, h):
                state = rbd.State(BOX, pin.integrate(BOX.model, q, t * v), v, t=t)
                m, which = source.at(state, t), source.touches(state)[0].which
                parts = zip(m.structure.numbers, which, m.velocity.reshape(-1, 3), m.bias.reshape(-1, 3), strict=True)
                found.append({(n, w[4]): (velocity, bias) for n, w, velocity, bias in parts})
            before, now, after = found
            for key in now.keys() & before.keys() & after.keys():
                if key[1] != EDGES:
                    met += 1
                    np.testing.assert_allclose((after[key][0] - before[key][0]) / (2.0 * h), now[key][1], atol=1e-6)
    assert met > 100


def test_constraints_on_pieces_that_move_are_checked_by_time():
    """`check_constraint` at a time: a toe and a sole, bilateral and anchored, whose error moves with the piece."""
    terrain = FLOOR.with_motion("box 0", motion=shaken)
    state = rbd.State(BOX, [0.0, 0.0, float(shaken(0.05)[0, 2]), 0, 0, math.sin(0.1), math.cos(0.1)], t=0.05)
    for constraint in (
        rbd.PointContact("toe", "box", on=terrain), face(terrain, friction=None), face(terrain, friction=None).anchored(state),
    ):  # fmt: skip
        rbd.testing.check_constraint(constraint, state)
    put = face(terrain, friction=None).anchored(state)
    there = rbd.State(BOX, state.q + np.concatenate([shaken(0.2)[0] - shaken(0.05)[0], np.zeros(4)]), t=0.2)
    assert np.abs(put.rows(state).error).max() <= 1e-15
    assert np.abs(put.rows(there).error).max() <= 1e-12


def test_statics_refuse_a_lift_and_inverse_dynamics_bear_its_acceleration():
    """`hold` refuses what moves, as on a plane; the sole bears M (g + a) in `inverse_dynamics` and `solve`."""
    lift, talos = FLOOR.with_motion("box 0", motion=lambda t: (0.0, 0.0, 1.5 * t * t)), rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=0.7, on=lift)
    with pytest.raises(rbd.errors.NotAtRest, match="wants a ground at rest"):
        rbd.hold(state, soles)
    a = np.zeros(talos.nv)
    a[:3] = state.base.rotation.T @ [0.0, 0.0, 3.0] if hasattr(state, "base") else [0.0, 0.0, 3.0]
    found = rbd.inverse_dynamics(state, a, soles)
    total = sum(found.forces[sole.name][2] for sole in soles)
    assert total == pytest.approx(talos.mass * (G + 3.0), rel=1e-10)
    again = rbd.solve(state, found.tau, soles)
    assert np.abs(again.a - a).max() <= 1e-8


def test_a_sole_half_on_a_lift_and_half_on_the_floor():
    """One that sinks leaves the half on the floor, borne at the crossings of the seam; one that rises holds up the other half.

    `solve` refuses halves that move differently.
    """
    both = rbd.Terrain.boxes([(-1, -1, -1), (0, 1, 0)], [(0, -1, -1), (1, 1, 0)])
    start = rbd.State(BOX, [-0.02, 0, 0, 0, 0, 0, 1])  # its centre of mass is above the floor
    sinks = face(both.with_motion("box 1", motion=lambda t: (0.0, 0.0, -2.0 * t**3)))
    found = run(start, sinks, 0.2, 2e-3)
    assert np.abs(found.q[:, :3] - [-0.02, 0.0, 0.0]).max() <= 1e-9
    assert abs(found.forces["face"][-1, 2] - 2.0 * G) <= 1e-6
    state = start.at_time(0.05)
    with pytest.raises(rbd.InputError, match="'face' rests on two pieces of the terrain that move differently"):
        rbd.solve(state, [], [sinks])
    m, places = sinks.source(start).at(state, 0.05), []
    for gap, velocity, place in zip(m.gap, m.velocity.reshape(-1, 3), m.points, strict=True):
        assert (gap, velocity[2]) == pytest.approx((0.00025, 0.015) if velocity[2] else (0.0, 0.0), abs=1e-12)
        places.append((round(float(place[0]), 9), bool(velocity[2])))
    assert sorted(places) == sorted(2 * [(-0.12, False), (0.0, False), (0.08, True)])
    level = sinks.source(start).at(start, 0.0).points  # at the seam a crossing on either side
    np.testing.assert_allclose(sorted(level[:, 0]), np.repeat([-0.12, 0.0, 0.08], [2, 4, 2]), atol=1e-12)
    above = rbd.Terrain.boxes([(-1, -1, -1), (0, 1, 0)], [(0, -1, -1), (1, 1, 0.01)])
    rises = face(above.with_motion("box 1", motion=lambda t: (0.0, 0.0, 0.3 * t**3)))
    tipped = run(rbd.State(BOX, [-0.02, 0, 0.0115, 0, 0, 0, 1]), rises, 0.4, 2e-3)
    m, lift = rises.source(start).at(tipped.state(-1), 0.4), 0.01 + 0.3 * 0.4**3
    np.testing.assert_allclose(m.points[np.abs(m.gap) < 1e-7, 2][:2], lift, atol=1e-7)  # its underside is on the lift's edge
    assert tipped.residuals["penetration"].max() <= 1e-7
    assert tipped.state(-1).frame("box").X_WF.rotation[2, 0] > 0.5 * lift / 0.12


@pytest.mark.parametrize("tilt", [0.0, 5e-6, -5e-6])
def test_a_half_lift_that_rises_slowly_moves_nothing_sideways(tilt):
    """A box over its seam turns about its edge on the floor: faces tilted by a hair are not met by a way along both."""
    both = rbd.Terrain.boxes([(-1, -1, -1), (0, 1, 0)], [(0, -1, -1), (1, 1, 0)])
    rises = face(both.with_motion("box 1", motion=lambda t: (0.0, 0.0, 1e-3 * t**3)))
    q = [-0.02, 0.0, 0.0, 0.0, math.sin(0.5 * tilt), 0.0, math.cos(0.5 * tilt)]
    found = run(rbd.State(BOX, q), rises, 0.3, 2e-3, may_sink=True)
    assert np.abs(found.q[:, :2] - [-0.02, 0.0]).max() <= 1e-8  # of second order in the tilt
    lift, slope = 1e-3 * 0.3**3, found.state(-1).frame("box").X_WF.rotation[2, 0]
    assert found.q[-1, 2] - 0.1 * slope == pytest.approx(0.0, abs=1e-8)
    assert found.q[-1, 2] + 0.02 * slope == pytest.approx(lift, abs=1e-8)
    late = np.searchsorted(found.t, 0.02)  # once it rests on both: the edge stays a point, also while it is a micrometre high
    assert all(event.t < 0.02 for event in found.events)
    assert np.abs(found.residuals["energy"][late:] - found.residuals["energy"][late]).max() <= 1e-6 * 2.0 * G * lift + 1e-8


@pytest.mark.parametrize("shape", ["box", "ball"])
def test_shapes_on_ground_that_moves(tmp_path, shape):
    """A box and a ball by their collision shapes ride a lift, and are carried by a belt: a ball rolls after 2/7 of the time."""
    geometry, inertia = ('<box size="0.2 0.2 0.1"/>', 1.0 / 240.0) if shape == "box" else ('<sphere radius="0.05"/>', 1e-3)
    path = tmp_path / "body.urdf"
    path.write_text(
        f'''<robot name="b"><link name="body"><inertial><mass value="1"/><inertia ixx="{inertia}" iyy="{inertia}"
        izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><geometry>{geometry}</geometry></collision></link></robot>'''
    )
    body = rbd.load_robot(path)
    start = rbd.State(body, [0, 0, 0.05, 0, 0, 0, 1])
    for on in (rbd.Ground(point=(0, 0, 0), motion=lifted), FLOOR.with_motion("box 0", motion=lifted)):
        contacts = rbd.CollisionContacts("c", body, friction=0.4, on=on)
        found = run(start, contacts, 0.3, 2e-3)
        height, _, up = np.array([lifted(t)[:, 2] for t in found.t]).T
        assert np.abs(found.q[:, 2] - 0.05 - height).max() <= 1e-9
        assert np.abs(found.a[:, 2] - up).max() <= 1e-10
        assert not found.events
        rows = contacts.with_margin(0.05).rows(rbd.State(body, [0, 0, 0.06, 0, 0, 0, 1], t=0.1))
        assert rows.error[2] == pytest.approx(0.01 - lifted(0.1)[0, 2], abs=1e-15)
        assert rows.velocity[2] == pytest.approx(-lifted(0.1)[1, 2], abs=1e-15)
        assert rows.bias[2] == pytest.approx(-lifted(0.1)[2, 2], abs=1e-15)
    for on in (rbd.Ground(point=(0, 0, 0), velocity=(0.8, 0, 0)), FLOOR.with_motion("box 0", velocity=(0.8, 0.0, 0.0))):
        found = run(start, rbd.CollisionContacts("c", body, friction=0.4, on=on), 0.3, 2e-3)
        k = inertia / (inertia + 0.05**2) if shape == "ball" else 1.0
        assert found.events
        assert max(abs(event.t - k * 0.8 / (0.4 * G)) for event in found.events) <= 1e-12


def test_shapes_on_a_ground_that_turns_are_refused():
    with pytest.raises(rbd.InputError, match="the ground of 'c' turns"):
        on = rbd.Ground(point=(0, 0, 0), velocity=(0, 0, 0, 0, 0, 1.0), about=(0, 0, 0))
        rbd.CollisionContacts("c", rbd.load_robot("solo12"), on=on)


def test_a_terrain_keeps_its_friction_from_shapes_too():
    """The same refusal as that of a contact."""
    icy = rbd.Terrain.boxes([(-1, -1, -1), (1, 1, 0)], friction=0.05)
    with pytest.raises(rbd.InputError, match=r"the friction of contact 'c' is its terrain's, 0.05; give it there"):
        rbd.CollisionContacts("c", rbd.load_robot("solo12"), on=icy).with_friction(0.5)


def test_a_jump_of_a_piece_is_refused_with_its_time():
    """Its velocity may not jump: that is an impact."""
    kink = FLOOR.with_motion("box 0", motion=lambda t: (0.0, 0.0, max(0.0, t - 0.05)))
    with pytest.raises(rbd.RbdError, match=r"0\.05"):
        run(rbd.State(BOX, REST), face(kink), 0.1, 2e-3)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda: FLOOR.with_motion("box 0"), "motion= or velocity=, one of the two"),
        (lambda: FLOOR.with_motion("box 0", motion=lifted, velocity=(1, 0, 0)), "motion= or velocity=, one of the two"),
        (lambda: FLOOR.with_motion("box 1", motion=lifted), "no piece 'box 1'; nearest: 'box 0'"),
        (lambda: FLOOR.with_motion("box 0", motion=3.0), "motion of piece 'box 0' of a terrain is 3.0; expected"),
        (lambda: FLOOR.with_motion("box 0", motion=lambda t: 0.0).at(1.0), r"shape \(3,\)"),
        (lambda: FLOOR.with_motion("box 0", velocity=(1, 0)), "velocity of piece 'box 0' of a terrain"),
        # one that turns: a velocity or a motion with angles
        (lambda: FLOOR.with_motion("box 0", velocity=(0, 0, 0, 0, 0, 1)), r"has shape \(6,\); expected \(3,\)"),
        (lambda: FLOOR.with_motion("box 0", motion=lambda t: (0, 0, 0, 0, 0, t)).at(1.0), r"of shape \(6,\); expected s"),
        (lambda: FLOOR.with_motion("box 0", motion=rbd.Speed((0, 0, 0, 0, 0, 1))).at(1.0), r"of shape \(3, 6\); expected s"),
        (lambda: rbd.Terrain.heights(np.zeros((3, 3)), 1.0).with_motion("heights", motion=lifted), "grid of heights"),
        (lambda: rbd.Terrain({"a": rbd.Ground(point=(0, 0, 0), velocity=(1, 0, 0))}), "at rest or with a motion"),
    ],
)
def test_bad_motions_of_pieces_are_refused_in_words(ask, said):
    with pytest.raises(rbd.InputError, match=said):
        ask()


def test_a_terrain_at_a_time():
    """`terrain.at(t)`: heights, planes and distances are those of pieces where they are, and the plane has their velocity."""
    lift = rbd.Terrain({"plate": rbd.Ground(point=(0, 0, 0), motion=lifted), "post": FLOOR.solids[0]})
    assert lift.moves and not lift.carries and lift.at(0.2) is not lift and FLOOR.at(0.2) is FLOOR
    there = lift.at(0.25)
    z, rate, _ = lifted(0.25)[:, 2]
    assert there.heights_of([[0.0, 0.0, 1.0]])[0] == pytest.approx(1.0 - z, abs=1e-15)
    assert there.distances(np.array([[0.0, 0.0, 1.0]]))[0] == pytest.approx(1.0 - z, abs=1e-15)
    ground = there.ground_at(0.0, 0.0)
    assert ground.velocity[2] == pytest.approx(rate, abs=1e-15) and ground.point[2] == pytest.approx(z, abs=1e-15)


def test_files_and_copies_keep_motions(tmp_path):
    """A trajectory's file has the motion at its samples to rounding, and between them to 1e-10; and a belt's velocity."""
    terrain = rbd.Terrain.boxes([(-5, -1, -1), (5, 1, 0)], [(6, -1, -1), (7, 1, 0)])
    terrain = terrain.with_motion("box 0", motion=lifted).with_motion("box 1", velocity=(0.3, 0.0, 0.0))
    run(rbd.State(BOX, REST), face(terrain), 0.1, 2e-3).save(tmp_path / "a.npz")
    read = rbd.Trajectory.load(tmp_path / "a.npz", robot=BOX)
    read.save(tmp_path / "b.npz")
    for found in (read, rbd.Trajectory.load(tmp_path / "b.npz", robot=BOX), read[10:20]):
        lift, belt = found.terrains[0].solids
        off = np.array([np.abs(lift.moved.at(t) - lifted(t)).max(axis=1) for t in found.t]).max(axis=0)
        assert (off <= [1e-16, 1e-13, 1e-10]).all()
        assert np.abs(lift.moved.at(0.0312)[0] - lifted(0.0312)[0]).max() <= 1e-10
        assert belt.rates.tolist() == [0.0] * 6 + [0.3, 0.0, 0.0]
    for copied in (copy.deepcopy(terrain), pickle.loads(pickle.dumps(terrain))):
        assert copied.at(0.3).heights_of([[0.0, 0.0, 1.0]]) == terrain.at(0.3).heights_of([[0.0, 0.0, 1.0]])
        assert copied.solids[1].rates.tolist() == belt.rates.tolist()
    assert digest(terrain, "t") == digest(copy.deepcopy(terrain), "t")
    assert digest(terrain, "t") != digest(terrain.with_motion("box 0", motion=shaken), "t")
    assert digest(terrain, "t") != digest(terrain.with_motion("box 1", velocity=(0.31, 0.0, 0.0)), "t")


def test_motions_are_checked_on_ground_at_rest():
    """The ground of a reference motion is refused where a piece moves; as it is at a time it is taken."""
    solo = rbd.load_robot("solo12")
    q, t = np.tile(solo.standing().q, (3, 1)), np.array([0.0, 0.1, 0.2])
    with pytest.raises(rbd.InputError, match="of which 'box 0' moves; expected one at rest"):
        rbd.Motion.of_arrays(solo, t, q, ground=FLOOR.with_motion("box 0", motion=lifted))
    still = rbd.Motion.of_arrays(solo, t, q, ground=FLOOR.with_motion("box 0", motion=lifted).at(0.0))
    for moves in (FLOOR.with_motion("box 0", motion=lifted), FLOOR.with_motion("box 0", velocity=(1.0, 0.0, 0.0))):
        with pytest.raises(rbd.InputError, match=r"of which 'box 0' moves; expected one at rest.* terrain\.at\(t\)"):
            rbd.check_motion(still, ground=moves)


def test_overlapping_pieces_are_said():
    """With the depth of the closed form, of boxes that are turned too; pieces of stairs and those that touch do not overlap."""
    R = pin.rpy.rpyToMatrix(0.3, 0.2, 0.7)
    cube = coal.Box(1, 1, 1)
    pieces = {name: (cube, pin.SE3(R, R @ [x, 0.3, 0.2])) for name, x in (("a", 0.0), ("b", 0.9), ("c", 1.0))}
    terrain = rbd.Terrain(pieces | {"floor": rbd.Ground(point=(0, 0, -50))})
    assert terrain.overlaps == {("a", "b"): pytest.approx(0.1, abs=1e-14), ("b", "c"): pytest.approx(0.9, abs=1e-14)}
    assert str(terrain).endswith("; 'b' and 'c' overlap by 0.9 m, and 1 more do")
    crossed = rbd.Terrain({"a": (cube, pin.SE3(pin.rpy.rpyToMatrix(0, 0, 0.25 * np.pi), np.array([1.1, 0, 0]))), "b": cube})
    assert crossed.overlaps == {("a", "b"): pytest.approx(0.5 + 0.5 * np.sqrt(2.0) - 1.1, abs=1e-14)}
    for still in (rbd.Terrain.stairs(0.17, 0.29, 5, down=True), FLOOR, rbd.Terrain.heights(np.zeros((3, 3)), 1.0)):
        assert not still.overlaps
        assert "overlap" not in str(still)


def test_what_sticks_to_a_cart_has_its_velocity():
    """Along all three axes, on a plane and on a piece, by soles and by shapes; where it slides, its normal velocity alone."""

    def cart(t: float) -> Array:
        x, v, a = 0.02 * (1.0 - math.cos(9.0 * t)), 0.18 * math.sin(9.0 * t), 1.62 * math.cos(9.0 * t)
        return np.outer([x, v, a], [1.0, -0.5, 0.6])

    for friction in (0.6, 0.05):
        for on in (rbd.Ground(point=(0, 0, 0), motion=cart), FLOOR.with_motion("box 0", motion=cart)):
            found = run(rbd.State(BOX, REST), face(on, friction=friction), 0.2, 4e-3)
            off = np.abs(found.v[:, :3] - [cart(t)[1] for t in found.t]).max(axis=0)
            assert off[2] <= 1e-13
            assert (off[:2] <= 1e-13).all() == (friction == 0.6)
            assert np.abs(found.residuals["energy"]).max() <= 2e-3 * found.kinetic.max()
