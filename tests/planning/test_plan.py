"""Plans: certificates against inverse dynamics at random instants, open loop and followed; what is refused, by which limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hops import hop_of

import rbd
from rbd.arrays import each_times
from rbd.errors import CannotPlan, CannotReach, InputError
from rbd.motion.frame_terms import FrameTerms, placements
from rbd.motion.self_collision import BodyPairs
from rbd.planning import Plan
from rbd.planning.bounds import Bounds
from rbd.planning.certificate import FALLS, at_instants, limits_between
from rbd.planning.curve import Curve
from rbd.planning.kept_limits import MEASURED, _apart, between
from rbd.planning.stays import centre_of, planned_contacts

FEET = {"left_sole": True, "right_sole": True}


def moved(robot: rbd.Robot, state: rbd.State, foot: str, by: list[float]) -> Any:
    """Where a foot is put down: where it stands, moved; of a point foot its place."""
    contact = next(c for c in robot.feet() if c.name == foot)
    X = centre_of(state, contact)
    place = X.translation + by
    return pin.SE3(X.rotation, place) if len(contact.corners) > 1 else place


def check_instants(plan: Plan, rng: np.random.Generator, n: int = 12) -> None:
    """At random instants the motion is possible by inverse dynamics, which shares only the robot with the certificate."""
    for t in rng.uniform(plan.curve.t[0], plan.curve.t[-1], n):
        contacts = [c.with_friction(0.6) for c in plan.contacts.standing(t)]
        state = rbd.mechanism.project_velocity(plan.state(t), contacts)
        assert np.abs(state.v - plan.state(t).v).max() < 5e-3
        a = rbd.mechanism.project_acceleration(state, plan.acceleration(t), contacts).a
        found = rbd.inverse_dynamics(state, a, contacts, margin=0.0)
        assert (np.abs(found.tau) <= plan.robot.effort_limit).all()


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def squat(talos: rbd.Robot) -> Plan:
    stand = talos.standing()
    return rbd.plan(talos, {0.0: stand, 0.8: {"com": stand.com - [0.0, 0.0, 0.08]}, 1.6: stand}, FEET, progress=False)


@pytest.fixture(scope="module")
def step(talos: rbd.Robot) -> Plan:
    stand = talos.standing()
    keys = {0.0: stand, 2.4: {"right_sole": moved(talos, stand, "right_sole", [0.2, 0.0, 0.0])}}
    return rbd.plan(talos, keys, {"left_sole": True, "right_sole": [(0.0, 0.8), (1.6, 2.4)]}, progress=False)


def test_keyframes_are_met_at_rest(squat: Plan, talos: rbd.Robot):
    """The first and the last exactly, the others nearly; the plan says so in words."""
    stand = talos.standing()
    for t in (0.0, 1.6):
        assert np.abs(squat.state(t).q - stand.q).max() < 1e-12
        assert np.abs(squat.state(t).v).max() < 1e-12
    assert squat.state(0.8).com[2] == pytest.approx(stand.com[2] - 0.08, abs=5e-3)
    assert squat.certified and "possible at every instant, certified" in str(squat)
    assert squat.missing < 1e-9 and squat.drift < 1e-3 and 0.0 < squat.torque_use < 1.0 and squat.friction_use < 1.0


@pytest.fixture(scope="module")
def lifted(solo: rbd.Robot) -> Plan:
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    keys = {0.0: stand, 2.0: {"front_left": moved(solo, stand, "front_left", [0.05, 0.0, 0.0])}}
    return rbd.plan(solo, keys, feet | {"front_left": [(0.0, 0.5), (1.0, 2.0)]}, progress=False)


@pytest.fixture(scope="module")
def hop(solo: rbd.Robot) -> Plan:
    """Nothing stands from 0.4 to 0.7 s."""
    return hop_of(solo)


def test_a_hop_is_a_throw(hop: Plan, solo: rbd.Robot):
    """The centre of mass rises by g T^2 / 8 = 11 cm on a parabola, without angular momentum, as far as `missing` allows."""
    assert hop.certified and 0.0 < hop.missing < FALLS
    t, g = np.linspace(0.0, 0.3, 31), 9.81
    states = [hop.state(0.4 + x) for x in t]
    z = np.array([state.com[2] for state in states])
    assert z.max() - z[0] == pytest.approx(g * 0.3**2 / 8.0, abs=0.5 * FALLS * g * 0.15**2 + 1e-5)
    speed = float((states[0].centroidal()[0] @ states[0].v)[2] / solo.mass)
    assert (np.abs(z - z[0] - speed * t + 0.5 * g * t**2) <= 0.5 * hop.missing * g * t**2 + 1e-12).all()
    turning = np.array([(state.centroidal()[0] @ state.v)[3:] for state in states])
    assert (np.linalg.norm(turning - turning[0], axis=1) <= np.sqrt(3.0) * hop.missing * 0.3 * solo.mass * g * t + 1e-12).all()
    assert not hop.forces(0.55)


def test_point_feet_push_within_cones_about_the_grounds_normal(lifted: Plan):
    """Not about an axis of their links; and the three that carry keep a part of their share of the weight."""
    weight = lifted.robot.mass * 9.81
    for t in np.linspace(0.01, 1.99, 60):
        each = np.concatenate(list(lifted.forces(t).values()))
        assert (np.hypot(each[:, 0], each[:, 1]) <= 0.6 * each[:, 2]).all()
    assert min(f[0, 2] for f in lifted.forces(0.75).values()) > 0.2 * weight / 3.0


@pytest.mark.parametrize("which", ["squat", "step", "lifted"])
def test_every_instant_is_possible(which: str, request: pytest.FixtureRequest, rng: np.random.Generator):
    """Of instants that are no ends of intervals, by other forces."""
    plan = request.getfixturevalue(which)
    assert plan.certified
    check_instants(plan, rng)


def test_forces_balance_between_the_ends_within_the_bound(step: Plan, rng: np.random.Generator):
    """What straight lines of forces leave of the wrench is within h^2 / 8 times the bound of its second derivative."""
    x, robot = step.intervals, step.robot
    some = rng.choice(len(x.start), 40, replace=False)
    found = []
    for i in some:
        t = np.linspace(x.start[i], x.end[i], 5)
        q, v, a = step.curve.at(t)
        terms = FrameTerms.of(robot, q, v, a, None)
        F, N = terms.wrench[:, :3], terms.wrench[:, 3:] + np.cross(terms.com - terms.com[0], terms.wrench[:, :3])
        s = np.linspace(0.0, 1.0, 5)[:, None]
        bend = [np.linalg.norm(y - (1.0 - s) * y[0] - s * y[-1], axis=1).max() for y in (F, N)]
        bounds = Bounds.of(robot, step.curve.sizes(x.start[i : i + 1], x.end[i : i + 1]))
        levers = np.array([body.lever for body in robot.model.inertias])
        R, p = placements(robot, q[[0, -1]])
        c = p + np.einsum("akij,kj->aki", R, levers)
        h = x.end[i] - x.start[i]
        reach = np.linalg.norm(c - terms.com[0], axis=2).max(axis=0)[:, None] + bounds.com[1] * 0.5 * h
        most = [float(y[0]) * h**2 / 8.0 for y in bounds.wrench(reach)]
        found.append([b / m for b, m in zip(bend, most, strict=True)])
    assert 0.0 < np.max(found) <= 1.0


def test_torques_are_near_to_straight_lines(step: Plan, rng: np.random.Generator):
    """Between the ends of intervals, by inverse dynamics with the plan's own forces: within the bound, some near to it."""
    x, robot, pushes = step.intervals, step.robot, step.pushes
    found = []
    for i in rng.choice(len(x.start), 60, replace=False):
        t = x.start[i] + np.array([0.25, 0.5, 0.8]) * (x.end[i] - x.start[i])
        s = np.array([0.25, 0.5, 0.8])[:, None]
        terms = FrameTerms.of(robot, *step.curve.at(t), None)
        knot = pushes.before(x.start[i : i + 1], x.end[i : i + 1])[0]
        places = np.where(pushes.on[knot, :, None], pushes.places[knot], pushes.places[knot + 1])
        on, f = np.tile(x.on[i], (3, 1)), ((1.0 - s) * x.forces[0, i].ravel() + s * x.forces[1, i].ravel())
        maps = terms.joint_map(pushes.joint, np.tile(places, (3, 1, 1)), on, np.asarray(robot.actuated))
        tau = terms.need[:, robot.actuated] - each_times(maps.reshape(3, robot.nu, -1), f)
        line = (1.0 - s) * x.torques[0, i] + s * x.torques[1, i]
        exact, exact_tau = at_instants(step.curve, pushes, x, t)
        found += (np.abs([tau - line, exact_tau - line]).max(axis=2) / x.off_line[i]).ravel().tolist()
        normal = exact @ pushes.axes[knot, 0, 2]
        assert (np.linalg.norm(exact - normal[..., None] * pushes.axes[knot, 0, 2], axis=2) <= 0.6 * normal + 1e-9).all()
        left = terms.wrench - np.einsum("kiab,kab->ki", terms.wrench_map(np.tile(places, (3, 1, 1)), on), exact)
        assert np.abs(left).max() < 1e-9 * robot.mass
        assert (np.abs(exact_tau) <= robot.effort_limit).all() and step.torques(t[1]) == pytest.approx(exact_tau[1])
        assert sum(f.sum(axis=0) for f in step.forces(t[1]).values()) == pytest.approx(terms.wrench[1, :3], abs=1e-7)
    assert 1e-3 < np.max(found) <= 1.0 and (x.bend <= 0.0).all()


def test_limits_at_speed_hold_between_the_ends(solo: rbd.Robot, rng: np.random.Generator):
    """Torque-speed lines of motors on a random curve: at no time less is left than what counts; more at both ends."""
    line = [(0.0, 2.7), (2.0, 2.0), (6.0, 0.5), (20.0, 0.0)]
    robot = solo.with_motors({name: rbd.Motor(limit=2.7, torque_speed=line) for name in solo.actuated_names})
    t, q0 = np.linspace(0.0, 0.4, 5), solo.standing().q
    curve = Curve.of(robot, t, np.array([pin.integrate(solo.model, q0, rng.normal(0.0, 0.2, solo.nv)) for _ in t]))
    start = np.linspace(0.0, 0.39, 40)
    end = start + 0.01
    ends = curve.at(np.concatenate([start, end]))[1].reshape(2, 40, -1)
    least, most = limits_between(curve, robot.limits_at, start, end, ends)
    for s in np.linspace(0.0, 1.0, 21):
        low, high = robot.limits_at(curve.at(start + 0.01 * s)[1])
        assert (least >= low - 1e-12).all() and (most <= high + 1e-12).all()
    at_ends = np.minimum(*(robot.limits_at(v)[1] for v in ends))
    assert (most < at_ends - 1e-3).any() and (at_ends - most < 0.5).all()


def test_bounds_hold_on_random_curves(solo: rbd.Robot, rng: np.random.Generator):
    """Second derivatives of the wrench and of torques of cubics with random coefficients, by differences of a fine grid."""
    t = np.linspace(0.0, 0.4, 5)
    q0 = solo.standing().q
    q = np.array([pin.integrate(solo.model, q0, rng.normal(0.0, 0.2, solo.nv)) for _ in t])
    curve = Curve.of(solo, t, q)
    start, end = np.array([0.12]), np.array([0.125])
    fine = np.linspace(start[0], end[0], 9)
    terms = FrameTerms.of(solo, *curve.at(fine), None)
    F, d = terms.wrench[:, :3], fine[1] - fine[0]
    N = terms.wrench[:, 3:] + np.cross(terms.com - terms.com[0], F)
    bounds = Bounds.of(solo, curve.sizes(start, end))
    reach = 0.6 + bounds.com[1] * 5e-3
    for values, most in zip((F, N), bounds.wrench(reach), strict=True):
        second = np.linalg.norm(values[2:] - 2.0 * values[1:-1] + values[:-2], axis=1) / d**2
        assert 0.0 < second.max() <= most[0]


def test_rates_of_a_curve_are_those_of_its_poses(talos: rbd.Robot, step: Plan):
    """Velocities and accelerations against differences of q."""
    d, t = 1e-5, np.linspace(0.11, 2.3, 23)
    (before, v0, _), (_, v, a), (after, v1, _) = (step.curve.at(t + by) for by in (-d, 0.0, d))
    moved = np.array([pin.difference(talos.model, x, y) for x, y in zip(before, after, strict=True)]) / (2.0 * d)
    assert moved == pytest.approx(v, abs=1e-7)
    inner = np.abs(t[:, None] - step.curve.t).min(axis=1) > 2.0 * d
    assert ((v1 - v0) / (2.0 * d))[inner] == pytest.approx(a[inner], abs=1e-5)


@pytest.mark.parametrize("which", ["squat", "step", "lifted", "hop"])
def test_torques_alone_hold_the_feet(which: str, request: pytest.FixtureRequest):
    """Without feedback: feet move by less than 0.1 mm in the first half second."""
    plan = request.getfixturevalue(which)
    contacts = plan.contacts.standing(0.0)
    duration = 0.39 if which == "hop" else 0.49 if which == "lifted" else 0.5  # then feet leave
    run = rbd.simulate(plan.state(0.0), contacts, duration=duration, step=1e-3, controller=plan.schedule, progress=False)
    for contact in contacts:
        off = centre_of(run.state(-1), contact).translation - centre_of(plan.state(0.0), contact).translation
        assert np.linalg.norm(off) < 1e-4


def test_a_plan_is_followed(step: Plan, talos: rbd.Robot):
    """To its end, without a violated step, onto the places of its feet."""
    controller = rbd.control.follow(step)
    run = rbd.simulate(
        step.state(0.0), talos.feet(friction=0.6, on=0.0), duration=2.6, step=2e-3, controller=controller, progress=False
    )  # fmt: skip
    assert controller.log.violations == 0
    assert run.com[-1] == pytest.approx(step.state(2.4).com, abs=1e-4)


def test_onto_a_box(talos: rbd.Robot, rng: np.random.Generator):
    """20 cm up, foot after foot, on terrain: certified, and possible by inverse dynamics at random instants."""
    stand = talos.standing()
    terrain = rbd.Terrain.boxes(((-1.0, -1.0, -1.0), (2.0, 1.0, 0.0)), ((0.25, -1.0, 0.0), (1.5, 1.0, 0.2)))
    right, left = (moved(talos, stand, foot, [0.4, 0.0, 0.2]) for foot in ("right_sole", "left_sole"))
    contacts = {"left_sole": [(0.0, 3.0), (4.0, 4.5)], "right_sole": [(0.0, 0.8), (1.8, 4.5)]}
    keys = {0.0: stand, 2.0: {"right_sole": right}, 4.5: {"right_sole": right, "left_sole": left}}
    plan = rbd.plan(talos, keys, contacts, ground=terrain, progress=False)
    assert plan.certified and plan.state(4.5).com[2] > stand.com[2] + 0.15
    check_instants(plan, rng)


def test_two_points_resist_all_but_one_wrench(solo: rbd.Robot):
    """Of two feet of four what no force can balance is told, and at most 0.2 % of the weight."""
    stand = solo.standing()
    contacts = {foot.name: True for foot in solo.feet()}
    plan = rbd.plan(solo, {0.0: stand, 0.8: {"com": stand.com - [0.0, 0.0, 0.04]}}, contacts, progress=False)
    assert plan.certified and plan.missing < FALLS
    assert set(plan.forces(0.4)) == set(contacts) and plan.torques(0.4).shape == (solo.nu,)
    total = sum(f.sum(axis=0) for f in plan.forces(0.0).values())
    assert total == pytest.approx([0.0, 0.0, solo.mass * 9.81], abs=0.02 * solo.mass * 9.81)


class TestRefused:
    """What is no plan, in words; what has none, with the limits."""

    def test_too_fast(self, talos: rbd.Robot):
        """Edges of soles are named, with the instants and the plan that came nearest."""
        stand = talos.standing()
        with pytest.raises(CannotPlan, match="the edge of 'left_sole'") as caught:
            rbd.plan(talos, {0.0: stand, 0.15: {"com": stand.com + [0.1, 0.0, 0.0]}, 0.3: stand}, FEET, progress=False)
        error = caught.value
        assert len(error.t) > 3 and not error.plan.certified and error.irreducible
        assert {"edge", "base"} <= {limit.kind for limit in error.limits}

    def test_too_weak(self, talos: rbd.Robot):
        """With 60 kg in one hand a motor is named, before anything is planned."""
        loaded = talos.carrying(rbd.Carried(60.0, ["gripper_left_base_link"]))
        stand = loaded.at(talos.standing().q)
        with pytest.raises(CannotPlan, match="at rest at 0 s") as caught:
            rbd.plan(loaded, {0.0: stand, 1.0: stand}, FEET, progress=False)
        assert caught.value.t == (0.0,) and caught.value.limits and caught.value.plan is None

    def test_out_of_reach(self, talos: rbd.Robot):
        """A keyframe's foot is too far: the pose that is nearest comes with the error."""
        stand = talos.standing()
        far = {"right_sole": moved(talos, stand, "right_sole", [2.5, 0.0, 0.0])}
        with pytest.raises(CannotReach, match="keyframe at 2 s is out of reach") as caught:
            rbd.plan(talos, {0.0: stand, 2.0: far}, {"left_sole": True, "right_sole": [(0.0, 0.5), (1.5, 2.0)]}, progress=False)
        assert caught.value.q is not None

    @pytest.mark.parametrize(
        ("keys", "contacts", "said"),
        [
            ({0.0: "standing"}, FEET, "two or more different times"),
            ({0.0: "standing", 1.0: "standing"}, {"left_sol": True}, "left_sole"),
            ({0.0: "standing", 1.0: "standing"}, {"left_sole": [(1.0, 0.5)]}, "later end"),
            ({0.0: "standing", 1.0: "standing"}, {"left_sole": 3}, r"\[\(start, end\), ...\]"),
            ({0.0: "standing", 1.0: "standing"}, {"left_sole": True, "right_sole": [(0.2, 0.4)]}, "no keyframe says where"),
            ({0.0: "standing", np.nan: "standing"}, FEET, "a time"),
        ],
    )
    def test_words(self, talos: rbd.Robot, keys: Any, contacts: Any, said: str):
        """Times, names, intervals and places that are none."""
        with pytest.raises(InputError, match=said):
            rbd.plan(talos, keys, contacts, progress=False)

    def test_a_contact_that_floats_or_moves(self, talos: rbd.Robot):
        """A keyframe has it above or inside the ground, or elsewhere than the one before."""
        stand = talos.standing()
        for height, said in ((0.02, "20.0 mm above"), (-0.02, "20.0 mm inside")):
            q = stand.q + height * np.eye(talos.nq)[2]
            with pytest.raises(InputError, match=said):
                rbd.plan(talos, {0.0: q, 1.0: q}, FEET, progress=False)
        q = stand.q + 0.1 * np.eye(talos.nq)[0]
        with pytest.raises(InputError, match="100.0 mm and 0.0 degrees from where it stood"):
            rbd.plan(talos, {0.0: stand, 1.0: q}, FEET, progress=False)

    def test_beyond_the_border_of_terrain(self, talos: rbd.Robot, solo: rbd.Robot):
        """A foot that is put there is named, with the time; one whose sole is partly beyond it stands on the rest alone."""
        stand, feet = solo.standing(), {foot.name: [(0.0, 0.4), (0.7, 1.0)] for foot in solo.feet()}
        small = rbd.Terrain.boxes(((-0.3, -0.3, -0.1), (0.3, 0.3, 0.0)))
        ahead = stand.q + 0.3 * np.eye(solo.nq)[0]
        with pytest.raises(InputError, match="'front_left' is to stand at 1 s, .* no terrain is within 1 mm"):
            rbd.plan(solo, {0.0: stand, 1.0: ahead}, feet, ground=small, progress=False)
        there = {"front_left": moved(solo, stand, "front_left", [0.3, 0.0, 0.0])}
        with pytest.raises(InputError, match="keyframe at 1 s, .*'front_left'.*: there is no terrain at x = 0.49"):
            rbd.plan(solo, {0.0: stand, 1.0: there}, feet, ground=small, progress=False)
        half = rbd.Terrain.boxes(((-1.0, -1.0, -0.1), (0.05, 1.0, 0.0)))
        plan = planned_contacts(talos, {0.0: talos.standing(), 1.0: talos.standing()}, FEET, friction=0.6, ground=half)
        for foot, corners in zip(plan.contacts, plan.corners(np.array([0.5])), strict=True):
            whole = np.asarray(foot.corners)
            x = centre_of(talos.standing(), foot).translation[0] + corners[0, :, 0]
            assert x.max() == pytest.approx(0.05, abs=1e-9) and (corners[0, :, 1] == pytest.approx(whole[:, 1], abs=1e-9))
            assert corners[0, :, 0].min() == whole[:, 0].min() and whole[:, 0].max() > 0.09

    def test_a_robot_on_a_fixed_base(self):
        """Has no centre of mass to carry."""
        arm = rbd.load_robot("panda", root="fixed")
        with pytest.raises(InputError, match="no floating base"):
            rbd.plan(arm, {0.0: arm.at().q, 1.0: arm.at().q}, {}, progress=False)


class TestBetweenKnots:
    """Limits of joints and of speeds, and bodies apart, at all times."""

    @staticmethod
    def curve(robot: rbd.Robot, rng: np.random.Generator) -> Curve:
        """Through random poses."""
        t, stand = np.linspace(0.0, 0.4, 9), robot.standing().q
        return Curve.of(robot, t, np.array([pin.integrate(robot.model, stand, rng.normal(0.0, 0.15, robot.nv)) for _ in t]))

    @pytest.mark.parametrize("order", [0, 1])
    def test_extremes_of_cubics_are_exact(self, solo: rbd.Robot, rng: np.random.Generator, order: int):
        """Nothing on a fine grid is outside, and the grid comes near to both."""
        curve = self.curve(solo, rng)
        low, high = curve.extremes(order)
        fine = np.array([curve.spline(np.linspace(a, b, 401), order) for a, b in zip(curve.t[:-1], curve.t[1:], strict=True)])
        assert (fine.min(axis=1) >= low - 1e-12).all() and (fine.max(axis=1) <= high + 1e-12).all()
        size = np.abs(fine).max()
        assert np.abs(fine.min(axis=1) - low).max() < 1e-4 * size and np.abs(fine.max(axis=1) - high).max() < 1e-4 * size

    def test_bodies_are_no_nearer_than_the_bound(self, step: Plan, talos: rbd.Robot):
        """Distances on a fine grid of a step of Talos, whose arms are near to its trunk; and it tells that nothing overlaps."""
        curve, bodies = step.curve, BodyPairs.of(talos)
        start, end = curve.t[20:60:6], curve.t[21:61:6]
        least, found = _apart(curve, bodies, start, end), []
        for a, b, most in zip(start, end, least, strict=True):
            R, p = placements(talos, curve.at(np.linspace(a, b, 17))[0])
            found.append(min((float(near.gap.min()) for *_, near in bodies.near(R, p, MEASURED)), default=MEASURED))
            assert most <= found[-1]
        assert min(found) < MEASURED and step.between.gaps[1] > 0.0

    def test_a_joint_beyond_its_limit_between_two_knots_is_told(self, solo: rbd.Robot):
        """Knots are inside, the cubic between them is not: by as much as its extreme."""
        stand, t = solo.standing().q, np.linspace(0.0, 0.4, 5)
        q = np.tile(stand, (5, 1))
        q[2:4, 7] = high = float(solo.model.upperPositionLimit[7])
        found = between(Curve.of(solo, t, q), np.array([stand]), None, None)
        assert not found.holds and found.worst[0] == 0.2 and repr(found.names[0]) in found.worst[1]
        s = np.linspace(0.2, 0.3, 2001)
        assert found.beyond[0] == pytest.approx(Curve.of(solo, t, q).spline(s)[:, 6].max() - high, abs=1e-9 + 1e-6 * high)


def test_onto_a_box_with_a_hand_on_a_rail(talos: rbd.Robot, exhaustive: bool):
    """20 cm up, with a hand that carries on the way; followed to the end without a violated step."""
    stand = talos.standing()
    hand_at = stand.frame("gripper_left_base_link").X_WF.translation
    place = hand_at + [0.15, 0.02, -0.03]
    terrain = rbd.Terrain.boxes(((-1.0, -1.0, -1.0), (2.0, 1.0, 0.0)), ((0.25, -1.0, 0.0), (1.5, 1.0, 0.2)))
    low, high = place - [0.07, 0.07, 0.05], place + [0.45, 0.06, 0.0]
    rail = rbd.Terrain.boxes(((-1.0, -1.0, -1.0), (2.0, 1.0, 0.0)), (tuple(low), tuple(high)))
    hand = rbd.PointContact("hand", "gripper_left_base_link", friction=0.5, on=rail)
    right, left = ({foot: moved(talos, stand, foot, [0.4, 0.0, 0.2])} for foot in ("right_sole", "left_sole"))
    keys = {0.0: stand, 1.0: {hand: place}, 2.8: {**right, hand: place}, 5.0: {**right, **left}}
    stays = {"left_sole": [(0.0, 3.4), (4.4, 5.0)], "right_sole": [(0.0, 1.4), (2.4, 5.0)], hand: [(1.0, 3.2)]}
    plan = rbd.plan(talos, keys, stays, ground=terrain, progress=False)
    assert plan.certified and plan.forces(2.0)["hand"][0, 2] > 50.0
    assert plan.between.beyond.max() < 1e-9  # a joint of the left arm is at its limit, and not beyond it between two knots
    assert plan.between.beyond[plan.between.names.index("arm_left_7_joint")] > -2e-3
    if not exhaustive:
        return
    controller = rbd.control.follow(plan)
    run = rbd.simulate(
        plan.state(0.0), [*talos.feet(friction=0.6, on=terrain), hand], duration=5.2, step=2e-3, controller=controller,
        progress=False,
    )  # fmt: skip
    assert controller.log.violations == 0
    assert run.com[-1] == pytest.approx(plan.state(5.0).com, abs=1e-4)


def test_over_a_gap(solo: rbd.Robot, exhaustive: bool):
    """Leaps of 20 cm over a gap of 15 cm: the front feet; in an exhaustive run all, by three leaps, followed to the end."""
    stand, leap = solo.standing(), 0.2
    terrain = rbd.Terrain.boxes(((-1.0, -1.0, -0.5), (0.22, 1.0, 0.0)), ((0.37, -1.0, -0.5), (2.0, 1.0, 0.0)))
    feet = [foot.name for foot in solo.feet()]
    keys, stays, start, n = dict[float, Any]({0.0: stand}), dict[str, Any]({foot: [] for foot in feet}), 0.0, 1 + 2 * exhaustive

    def over(by: float, up: float) -> dict[str, Any]:
        return {"com": stand.com + [by, 0.0, up]}

    for k in range(n):
        t = 1.3 * k
        keys |= {t + 0.3: over(leap * k, -0.06), t + 0.5: over(leap * k + 0.06, -0.02)}
        landed = {foot: moved(solo, stand, foot, [leap * (k + 1), 0.0, 0.0]) for foot in feet}
        keys |= {t + 0.8: over(leap * (k + 1) - 0.06, -0.02) | landed}
        keys |= {t + 1.0: over(leap * (k + 1), -0.06), t + 1.3: over(leap * (k + 1), 0.0)}
        for own in stays.values():
            own.append((start, t + 0.5))
        start = t + 0.8
    plan = rbd.plan(solo, keys, {foot: [*own, (start, 1.3 * n)] for foot, own in stays.items()}, ground=terrain, progress=False)
    assert plan.certified and plan.state(1.3 * n).com[0] == pytest.approx(stand.com[0] + leap * n, abs=1e-6)
    front = [foot.points(plan.state(1.3 * n)).positions[0, 0] for foot in solo.feet() if foot.name.startswith("front")]
    assert min(front) > 0.37
    if not exhaustive:
        return
    controller, on = rbd.control.follow(plan), solo.feet(friction=0.6, on=terrain)
    run = rbd.simulate(plan.state(0.0), on, duration=1.3 * n + 0.4, step=1e-3, controller=controller, progress=False)
    assert controller.log.violations == 0
    assert run.com[-1] == pytest.approx(plan.state(1.3 * n).com, abs=1e-4)
    for foot in on:
        off = centre_of(run.state(-1), foot).translation - centre_of(plan.state(1.3 * n), foot).translation
        assert np.linalg.norm(off) < 1e-3
