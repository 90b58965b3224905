"""`rbd.impact` against closed forms: wheels, balls, rods with friction, Kane's gain of energy, loops, and a simulation's."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import flat_body, flat_state, floor_point
from scipy.optimize import linprog

import rbd
from rbd.errors import DistantContactWarning, DuplicateName, InputError, UnknownName
from rbd.model.checked_model import CheckedModel
from rbd.simulation import StateEvent, Switch

A, SLOPE, G = math.pi / 8.0, 0.08, 9.8


def checked(found, contacts, e=0.0):
    """The impact, after its laws are recomputed from rows: momentum, u_n+ >= -e u_n-, no pull, no impulse where it leaves."""
    before, after = found.before, found.state
    rounding = max(1e-12, 10.0 * np.finfo(float).eps * np.linalg.cond(before.M) * np.abs(before.v).max())
    change = before.M @ (after.v - before.v)
    for contact in contacts:
        rows = contact.rows(before)
        p = (
            found.impulses[contact.name]
            if rows.resultant is None
            else np.linalg.pinv(rows.resultant) @ found.impulses[contact.name]
        )
        change = change - rows.J.T @ p
        if contact.friction is None:
            assert np.abs(rows.J @ after.v).max() < rounding
            continue
        u, u_n = rows.J @ after.v, float((rows.J @ before.v)[-1])
        gap = u[-1] + e * min(u_n, 0.0)
        assert gap > -1e-12
        assert p[-1] >= 0.0
        assert abs(gap * p[-1]) < 1e-12
        if len(p) == 3:
            slip, limit = np.hypot(*u[:2]), contact.friction * p[2]
            assert np.hypot(*p[:2]) <= limit + 1e-12
            assert np.abs(p[:2] * slip + limit * u[:2]).max() < 1e-10 or slip < 1e-10
    assert np.abs(change).max() < 1e-11
    assert max(found.residuals.values()) < 1e-10
    assert found.solution.residuals.within(1e-9)
    return found


def wheel(inertia=0.0):
    """A rimless wheel in the plane: a mass of 1 kg with eight massless spokes of 1 m, on a slope."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -G])
    x = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    z = model.addJoint(x, pin.JointModelPZ(), pin.SE3.Identity(), "z")
    hub = model.addJoint(z, pin.JointModelRY(), pin.SE3.Identity(), "turn")
    model.appendBodyToJoint(z, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    model.appendBodyToJoint(hub, pin.Inertia(1e-12, np.zeros(3), np.diag([0.0, inertia, 0.0])), pin.SE3.Identity())
    for i in range(8):
        tip = np.array([math.sin(2.0 * A * i), 0.0, -math.cos(2.0 * A * i)])
        model.addFrame(pin.Frame(f"spoke{i}", hub, 0, pin.SE3(np.eye(3), tip), pin.FrameType.OP_FRAME))
    return CheckedModel(model, name="rimless wheel")


def on_spoke(robot, rate, side):
    """(state on spoke 0 and on that before it, side = -1, or after it, 1, turning about spoke 0 down the slope; all spokes)."""
    n, along = np.array([math.sin(SLOPE), 0, math.cos(SLOPE)]), np.array([math.cos(SLOPE), 0, -math.sin(SLOPE)])
    hub = side * math.sin(A) * along + math.cos(A) * n  # the tip of spoke 0 is the origin
    turn = math.atan2(hub[0], hub[2])
    v = rate * np.array([hub[2], -hub[0]])
    plane = rbd.Ground(point=(0.0, 0.0, 0.0), normal=n)
    spokes = [rbd.PointContact(f"spoke{i}", f"spoke{i}", friction=None, on=plane) for i in range(8)]
    return rbd.State(robot, [hub[0], hub[2], turn], [v[0], v[1], rate]), spokes


@pytest.mark.parametrize("inertia", [1e-4, 0.3])
def test_a_rimless_wheel_keeps_the_cosine_of_its_rate(inertia):
    """w+ = w- (cos 2a + I / m l^2) / (1 + I / m l^2); the spoke from which it steps takes no part."""
    robot = wheel(inertia)
    state, spokes = on_spoke(robot, 1.5, 1)
    found = checked(rbd.impact(state, [spokes[1]]), [spokes[1]])
    assert abs(found.v[2] - 1.5 * (math.cos(2.0 * A) + inertia) / (1.0 + inertia)) < 1e-8
    both = rbd.impact(state, [spokes[1], spokes[0]])  # two spokes that hold let nothing move
    assert np.abs(both.v).max() < 1e-10  # M has a condition of 1e4


def rolling_rate(inertia):
    """Rate just after a strike, on a slope: what a step gives, 2 m g l sin a sin slope, the strike takes."""
    kept = (math.cos(2.0 * A) + inertia) / (1.0 + inertia)
    return kept * math.sqrt(4.0 * G * math.sin(A) * math.sin(SLOPE) / (1.0 + inertia) / (1.0 - kept**2))


def test_a_rimless_wheel_rolls_to_mcgeers_rate():
    """Down a slope of 0.08 rad: after twenty strikes by switched spokes. Published without inertia: 1.0949043574 rad/s."""
    assert abs(rolling_rate(0.0) - 1.0949043574) < 1e-9
    robot = wheel(1e-4)
    state, spokes = on_spoke(robot, 1.1, -1)

    def strike(i):
        def height(s):
            return s.q[2] - state.q[2] - 2.0 * A * (i + 1)

        here, there = f"spoke{i % 8}", f"spoke{(i + 1) % 8}"
        last = {"terminal": True} if i == 19 else {}
        return StateEvent(height, f"strike {i}", direction=1, then=Switch(on=there, off=here), **last)

    off = [f"spoke{i}" for i in range(1, 8)]
    motion = rbd.simulate(
        state, spokes, duration=60.0, step=0.5, events=[strike(i) for i in range(20)], inactive=off,
        integrator=rbd.DormandPrince8(longest=0.5),
    )  # fmt: skip
    assert motion.end_reason is rbd.errors.Reason.EVENT
    assert abs(motion.v[-1, 2] - rolling_rate(1e-4)) < 1e-8


def test_balls_bounce_with_their_own_coefficients():
    """Two balls that strike at once, e = 0.3 and 0.9: `rbd.impact`, and a simulation's samples after it."""
    pair = rbd.robots.merge_robots(rbd.testing.box(mass=1.0), rbd.testing.box(mass=2.0))
    names = [j for j in pair.joints if pair.joints[j].kind == "FreeFlyer"]
    frames = [name for name in pair.frames() if name.endswith("box")]
    assert len(names) == len(frames) == 2
    balls = [rbd.PointContact(f"ball{i}", frame, friction=0.2, on=0.0) for i, frame in enumerate(frames)]
    q = pair.at().q.copy()
    for i, name in enumerate(names):
        at = pair.model.joints[pair.model.getJointId(name)].idx_q
        q[at : at + 3] = [2.0 * i, 0.0, 0.0]
    v = np.zeros(pair.nv)
    v[[2, 8]] = -1.5
    e = {"ball0": 0.3, "ball1": 0.9}
    found = rbd.impact(rbd.State(pair, q, v), balls, restitution=e)
    assert found.v[[2, 8]] == pytest.approx([0.45, 1.35], abs=1e-12)
    assert found.opens == ("ball0", "ball1")
    stepped = rbd.simulate(rbd.State(pair, q, v), balls, duration=1e-6, step=1e-6, restitution=e)
    assert stepped.v[0] == pytest.approx(found.v, abs=1e-12)
    one = rbd.simulate(rbd.State(pair, q, v), balls, duration=1e-6, step=1e-6, restitution={"ball1": 0.9})
    assert one.v[0, [2, 8]] == pytest.approx([0.0, 1.35], abs=1e-12)


def rod(angle, v, friction):
    """(state of a rod of 2 m, 1 kg, its lower end on the floor, at an angle from it; that end)."""
    robot = flat_body(1.0, 1.0 / 3.0)
    end = floor_point("end", (-1.0, 0.0), friction=friction)
    return flat_state(robot, (0.0, math.sin(angle), -angle), v), end


@pytest.mark.parametrize(("friction", "sticks"), [(0.1, False), (0.9, True)])
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_rod_strikes_a_table_with_friction(friction, sticks, e):
    """Closed form with the end's effective masses: p = -D^-1 (u + e u_n n) where it sticks, p_t = mu p_n where it slides on."""
    angle = 1.0
    state, end = rod(angle, (-0.8, -1.0, 0.0), friction)
    found = checked(rbd.impact(state, [end], restitution=e), [end], e)
    r = np.array([-math.cos(angle), -math.sin(angle)])
    J = np.array([[1.0, 0.0, r[1]], [0.0, 1.0, -r[0]]])
    Minv = np.diag([1.0, 1.0, 3.0])
    D, u, bounce = J @ Minv @ J.T, J @ state.v, np.array([0.0, 1.0])
    if sticks:
        p = -np.linalg.solve(D, u + e * u[1] * bounce)
        assert abs(p[0]) < friction * p[1]
    else:
        ray = np.array([friction, 1.0])
        p = -(1.0 + e) * u[1] / (D[1] @ ray) * ray
        assert (u + D @ p)[0] < 0.0
    assert found.modes["end"] == ("sticks" if sticks else "slips")
    assert np.abs(found.impulses["end"][[0, 2]] - p).max() < 1e-12
    expected = 0.5 * (state.v @ np.linalg.solve(Minv, state.v) - found.v @ np.linalg.solve(Minv, found.v))
    assert abs(found.energy_lost - expected) < 1e-12


def test_restitution_with_friction_can_add_energy_as_kane_says():
    """A rod at 45 degrees that arrives at 1 m/s and slides at 0.5 m/s: 8 % more for e = 0.9, never more for e = 0."""
    ladder = rbd.load_robot("ladder")
    R = pin.rpy.rpyToMatrix(0.0, -np.pi / 4.0, 0.0)
    q = np.r_[0.0, 0.0, np.sqrt(0.5), pin.Quaternion(R).coeffs()]
    state = rbd.State(ladder, q, np.r_[R.T @ [0.5, 0.0, -1.0], 0.0, 0.0, 0.0])
    foot = rbd.PointContact("foot", "ladder", offset=(-1.0, 0.0, 0.0), friction=0.6, anchor=(0.0, 0.0, 0.0))
    shares = [rbd.impact(state, [foot], restitution=e).energy_lost / (0.5 * ladder.mass * 1.25) for e in (0.0, 0.9)]
    assert shares == pytest.approx([0.325, -0.08], abs=1e-3)
    assert "GAINS" in str(rbd.impact(state, [foot], restitution=0.9))


def test_a_loop_is_struck_as_one_mechanism():
    """A four-bar whose bars move against the loop: v+ is the projection onto the loop in the metric of inertia."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    state = bars.at("assembled").with_velocity(np.array([1.0, -0.4, 0.3])[: bars.nv])
    found = rbd.impact(state, bars.loops())
    assert np.abs(found.v - rbd.mechanism.project_velocity(state, bars.loops()).v).max() < 1e-12
    assert found.energy_lost > 0.0
    assert found.modes == {c.name: "holds" for c in bars.loops()}


def test_four_corners_share_an_impulse_that_is_not_unique():
    """A flat box: the total is m v, its shares are those of least norm, and the print says so."""
    box = rbd.testing.box(mass=4.0)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.5, on=0.0)
    found = rbd.impact(rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [0, 0, -2.0, 0, 0, 0]), [face])
    assert found.impulses["face"] == pytest.approx([0, 0, 8.0, 0, 0, 0], abs=1e-12)
    assert found.point_impulses["face"][:, 2] == pytest.approx([2.0] * 4)
    assert not found.unique
    assert "not unique" in str(found)
    unique = found.uniqueness()
    assert unique.row_freedom == 6
    assert all(r.lowest <= r.value <= r.highest for r in unique.others["face"])
    assert [r.value for r in unique.others["face"][2::3]] == pytest.approx([2.0] * 4)


@pytest.mark.parametrize("speed", [2.0, 0.03])
def test_ranges_of_impulses_are_those_of_linear_programs(speed):
    """A box slides on four corners as it lands at any speed, e = 1: ends in N s, by SciPy over cones of 256 sides."""
    box, mu, sides = rbd.testing.box(mass=1.0), 0.5, 256
    corners = [
        rbd.PointContact(f"c{i}{j}", "box", offset=(0.1 * i, 0.1 * j, -0.05), friction=mu, on=0.0)
        for i in (-1, 1)
        for j in (-1, 1)
    ]
    state = rbd.State(box, [0, 0, 0.05, 0, 0, 0, 1], [0.5 * speed, 0, -speed, 0, 0, 0])
    found = rbd.impact(state, corners, restitution=1.0)
    unique = found.uniqueness()
    J = np.vstack([c.rows(state).J for c in corners])
    angles = 2.0 * np.pi * np.arange(sides) / sides
    rays = np.stack([mu * np.cos(angles), mu * np.sin(angles), np.ones(sides)])
    all_rays = np.kron(np.eye(4), rays)
    change, size = state.M @ (found.v - state.v), found.impulses["c11"][2]
    for i, corner in enumerate(corners):
        ends = unique.others[corner.name][2]
        assert ends.lowest <= found.impulses[corner.name][2] <= ends.highest
        assert ends.value == pytest.approx(found.impulses[corner.name][2])
        normal = all_rays[3 * i + 2]
        for sign, end, at in ((1.0, ends.lowest, ends.at_lowest), (-1.0, ends.highest, ends.at_highest)):
            exact = linprog(sign * normal, A_eq=J.T @ all_rays, b_eq=change, bounds=(0.0, None))
            assert abs(end - sign * exact.fun) < 1e-4 * size
            assert np.abs(J.T @ at.multipliers - change).max() < 1e-8 * speed
    assert sum(unique.others[c.name][2].highest for c in corners) == pytest.approx(3.75 * speed)
    text = str(unique)
    assert "impulse" in text
    assert "force" not in text
    assert f"{ends.highest:.4g}" in text


@pytest.mark.parametrize("speed", [1e-4, 1e-8, 1e-12, 1e-16])
def test_slow_impacts_are_fast_ones_scaled(speed):
    """Four corners with friction, e = 0: velocities and energies of an impact scale with the speed, however slow."""
    box, rng = rbd.testing.box(mass=1.0), np.random.default_rng(0)
    corners = [
        rbd.PointContact(f"c{i}{j}", "box", offset=(0.1 * i, 0.1 * j, -0.05), friction=0.5, on=0.0)
        for i in (-1, 1)
        for j in (-1, 1)
    ]
    for _ in range(12):
        v = rng.normal(size=6)
        fast, slow = (rbd.impact(rbd.State(box, [0, 0, 0.05, 0, 0, 0, 1], k * v), corners) for k in (1.0, speed))
        assert np.abs(slow.v / speed - fast.v).max() < 1e-8
        assert slow.energy_lost == pytest.approx(speed**2 * fast.energy_lost, rel=1e-8)


def test_a_contact_is_switched_on_where_another_holds_the_body_at_rest():
    """Two bilateral points of one body at one instant: what is left to stop by the second is rounding."""
    box = rbd.testing.box(mass=1.0)
    two = [rbd.PointContact("c", "box", friction=None), rbd.PointContact("d", "box", offset=(0.1, 0, 0), friction=None)]
    events = [StateEvent(lambda s: s.q[2] - 0.5, f"at {n}", then=Switch(on=n), while_off=n) for n in "cd"]
    fall = rbd.simulate(
        rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), two, inactive=["c", "d"], duration=0.6, step=0.05, events=events,
        integrator=rbd.DormandPrince8(),
    )  # fmt: skip
    assert fall.t[-1] == 0.6
    assert np.abs(fall.q[-1, :3] - [0, 0, 0.5]).max() < 1e-12
    assert np.abs(fall.v[-1]).max() < 1e-12
    speeds = {e.name: e.speed for e in fall.events if e.kind == "touches"}
    assert speeds == pytest.approx({"c": math.sqrt(9.81), "d": 0.0}, abs=1e-12)


def test_one_impulse_is_unique_in_its_units():
    """A ball of 2 kg at 3 m/s: 6 N s, printed as an impulse."""
    box = rbd.testing.box(mass=2.0)
    tip = rbd.PointContact("tip", "box", friction=0.5, on=0.0)
    unique = rbd.impact(rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [0, 0, -3.0, 0, 0, 0]), [tip]).uniqueness()
    assert unique.others["tip"][2].value == pytest.approx(6.0)
    assert "tip              impulse 0, 0, 6" in str(unique)


def test_talos_lands_as_in_a_simulation():
    """Two soles that arrive at 0.5 m/s, by another route: the step's impact on ground at rest."""
    talos = rbd.load_robot("talos")
    v = np.zeros(talos.nv)
    v[2] = -0.5
    state, soles = talos.standing().with_velocity(v), talos.soles()
    found = rbd.impact(state, soles)
    stepped = rbd.simulate(state, soles, duration=1e-6, step=1e-6)
    assert np.abs(stepped.v[0] - found.v).max() < 1e-9
    assert max(found.residuals.values()) < 1e-9
    total = sum(p[:3] for p in found.impulses.values())
    assert total[2] > 0.0
    touches = [e for e in stepped.events if e.kind == "touches"]
    assert sum(e.impulse for e in touches) == pytest.approx(total[2], rel=1e-9)


def test_nothing_happens_where_nothing_approaches():
    """A body that rises, and one at rest: the same velocity, no impulse."""
    box = rbd.testing.box(mass=4.0)
    tip = rbd.PointContact("tip", "box", friction=0.5, on=0.0)
    for speed in (0.0, 1.0):
        found = rbd.impact(rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [0, 0, speed, 0, 0, 0]), [tip], restitution=0.5)
        assert np.array_equal(found.v, found.v_before)
        assert not found.impulses["tip"].any()
        assert found.energy_lost == 0.0


def test_wrong_arguments_are_refused():
    """With what came, and the nearest names; a contact that is away is warned of."""
    box = rbd.testing.box(mass=4.0)
    tip = rbd.PointContact("tip", "box", friction=0.5, on=0.0)
    state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [0, 0, -1.0, 0, 0, 0])
    with pytest.raises(InputError, match="restitution is 1.5; expected a number from 0"):
        rbd.impact(state, [tip], restitution=1.5)
    with pytest.raises(UnknownName, match="'tap'.*'tip'"):
        rbd.impact(state, [tip], restitution={"tap": 0.5})
    with pytest.raises(DuplicateName, match="'tip'"):
        rbd.impact(state, [tip, tip])
    with pytest.raises(InputError, match="law"):
        rbd.impact(state, [tip], law="kane")
    with pytest.raises(InputError, match="State"):
        rbd.impact(3, [tip])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="plastic_below"):
        rbd.impact(state, [tip], plastic_below=-1.0)
    with pytest.warns(DistantContactWarning, match="'tip' 500 mm above"):
        rbd.impact(rbd.State(box, [0, 0, 0.5, 0, 0, 0, 1], [0, 0, -1.0, 0, 0, 0]), [tip])


def test_a_joint_limit_takes_part_where_it_is_reached():
    """A pendulum at its stop turns back with e w; away from it, and away from the other bound, nothing happens."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    stop = rbd.JointLimit("stop", next(iter(arm.joints)), lower=-0.5, upper=0.5)
    for q, after in ((0.5, -0.6), (0.2, 2.0)):
        found = rbd.impact(arm.at([q]).with_velocity(np.array([2.0])), [stop], restitution=0.3)
        assert found.v == pytest.approx([after], abs=1e-12)
        assert abs(found.impulses["stop"]).max() == pytest.approx((2.0 - after) / 3.0)  # m l^2 / 3


def test_shapes_take_part_where_they_touch():
    """A tilted box strikes with its lowest corner alone, as it does with that point given by hand."""
    box = rbd.load_robot("box")
    shapes = rbd.CollisionContacts("shapes", box, friction=0.5)
    half = np.array([g.geometry.halfSide for g in box.collision_model.geometryObjects][0])
    R = pin.rpy.rpyToMatrix(0.3, 0.4, 0.0)
    corner = -half * np.sign(R[2])
    q = np.r_[0.0, 0.0, -(R @ corner)[2], pin.Quaternion(R).coeffs()]
    state = rbd.State(box, q, np.r_[R.T @ [0.3, 0.0, -1.0], 0.2, 0.0, 0.0])
    point = rbd.PointContact("point", "box", offset=corner, friction=0.5, on=0.0)
    found, wanted = (rbd.impact(state, [contact], restitution=0.2) for contact in (shapes, point))
    assert np.abs(found.v - wanted.v).max() < 1e-12
    assert found.unique


def test_a_belt_drags_what_strikes_it():
    """Held, the body moves with the belt; with friction its speed along changes by mu times that across."""
    belt = rbd.Ground(point=(0, 0, 0), normal=(0, 0, 1), velocity=(0.7, 0, 0, 0, 0, 0))
    state = rbd.State(rbd.testing.box(mass=1.0), [0, 0, 0, 0, 0, 0, 1], [0, 0, -1.0, 0, 0, 0])
    for friction, along in ((None, 0.7), (0.2, 0.2), (0.9, 0.7)):
        found = rbd.impact(state, [rbd.PointContact("belt", "box", friction=friction, on=belt)])
        assert found.v == pytest.approx([along, 0, 0, 0, 0, 0], abs=1e-12)
        assert found.approach == pytest.approx({"belt": 1.0})
        assert found.normal_impulses == pytest.approx({"belt": 1.0})
        assert np.linalg.norm(found.impulses["belt"]) == pytest.approx(math.hypot(1.0, along))
