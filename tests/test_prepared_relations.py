"""Contacts with moving ground and between two bodies, edges that are held, and loops: the prepared way against the general way.

Bodies tumble, so that Coriolis' and centripetal terms of both sides count; loops are a little open. A fault put into any of the
constants of these rows is noticed by the certificate, which has constants of its own.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from test_corrupted_path import NAMES, Changed, _nothing

import rbd
from rbd.answers.prepared.constraint_dynamics import prepared
from rbd.problem.residuals import residuals_of
from rbd.solvers.default import GaussFirst

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
PREPARED = "ContactDynamics"
PAIR = rbd.robots.merge_robots(rbd.testing.box(mass=10.0), rbd.testing.box(mass=2.0))
GROUND = rbd.Ground(
    velocity=(0.3, 0.1, -0.2, 0.4, -0.5, 0.7), acceleration=(1.0, 2.0, 0.1, 0.1, 0.2, 0.3), normal=(0.6, 0.0, 0.8)
)  # fmt: skip
TURNTABLE = rbd.Ground(velocity=(0, 0, 0, 0, 0, 1.7), about=(0.1, 0.2, 0.3), normal=(0.0, 0.0, 1.0))
OTHER = rbd.Body("a_box", normal=(0.0, 0.6, 0.8))
SQUARE = {"half_lengths": (0.2, 0.1)}
SURFACES = {"ground": GROUND, "turntable": TURNTABLE, "body": OTHER}


def contacts_on(on: rbd.Ground | rbd.Body) -> dict[str, Callable[[float | None], Any]]:
    """{what touches: the contact, by its friction}."""
    place = pin.SE3(pin.exp3(np.array([0.2, 0.0, 0.3])), np.array([0.1, 0.0, 0.2]))
    return {
        "point": lambda mu: rbd.PointContact("c", "b_box", offset=(0.05, 0.1, -0.1), on=on, friction=mu),
        "edge": lambda mu: rbd.LineContact("c", "b_box", half_length=0.1, placement=place, on=on, friction=mu),
        "patch": lambda mu: rbd.SurfaceContact("c", "b_box", placement=place, on=on, friction=mu, **SQUARE),
    }


def at_rest(constraints: list, seed: int, q: np.ndarray | None = None) -> rbd.State:
    """A state in which rows have no velocity, and the bodies tumble."""
    rng = np.random.default_rng(seed)
    robot = PAIR
    if q is None:
        q = pin.integrate(robot.model, pin.neutral(robot.model), 0.4 * rng.normal(size=robot.nv))
    v = rng.normal(size=robot.nv)
    for _ in range(2):
        rows = [c.rows(rbd.State(robot, q, v)) for c in constraints]
        J, u = np.concatenate([r.J for r in rows]), np.concatenate([r.velocity for r in rows])
        v = v - np.linalg.lstsq(J, u, rcond=None)[0]
    return rbd.State(robot, q, v)


def both(state: rbd.State, constraints: list, push: np.ndarray) -> tuple[rbd.Solution, rbd.Solution]:
    """By the prepared way, and by the general one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        one = rbd.solve(state, [], constraints, external=push)
        other = rbd.solve(state, [], constraints, external=push, solver=GaussFirst())
    return one, other


def agree(state: rbd.State, constraints: list, seed: int) -> None:
    """To 1e-10, and certified by the problem in arrays."""
    push = 5.0 * np.random.default_rng(seed).normal(size=PAIR.nv)
    s, g = both(state, constraints, push)
    assert s.solver == PREPARED and g.solver != PREPARED
    assert residuals_of(s.problem, s.a, s.multipliers, s.weights, s.law).worst <= 1e-9
    assert np.abs(s.a - g.a).max() <= 1e-10 * max(1.0, np.abs(g.a).max())
    assert np.abs(s.multipliers - g.multipliers).max() <= 1e-10 * max(1.0, np.abs(g.multipliers).max())


@pytest.mark.parametrize("mu", [None, 0.6, 0.0])
@pytest.mark.parametrize("kind", ["point", "edge", "patch"])
@pytest.mark.parametrize("surface", SURFACES)
def test_contacts_with_what_moves(surface, kind, mu):
    """Ground that accelerates and turns, given at the contact or at a point of its own, and another body."""
    contact = contacts_on(SURFACES[surface])[kind](mu)
    for seed in range(3):
        agree(at_rest([contact], seed), [contact], seed)


def closed(kind: str, ends: tuple[str, str]) -> tuple[rbd.LoopClosure, np.ndarray]:
    """A loop, and a configuration in which it is open by 0.2 mm and 0.2 mrad."""
    crossed = {"axis_b": (-2.0, 1.0, 0.0)} if kind == "universal" else {}
    loop = rbd.LoopClosure("c", *ends, kind=kind, axis=(1.0, 2.0, 3.0), **crossed)
    q = pin.integrate(PAIR.model, pin.neutral(PAIR.model), np.random.default_rng(5).normal(size=PAIR.nv))
    off = pin.SE3(pin.exp3(np.array([1e-4, 2e-4, 0.0])), np.array([2e-4, 0.0, 1e-4]))
    where = pin.XYZQUATToSE3(q[:7]) if "a_box" in ends else pin.SE3.Identity()
    q[7:] = pin.SE3ToXYZQUAT(where * off)
    return loop, q


ENDS = [("a_box", "b_box"), ("b_box", "a_box"), ("universe", "b_box"), ("b_box", "universe")]


@pytest.mark.parametrize("ends", ENDS, ids="-".join)
@pytest.mark.parametrize("kind", ["point", "planar", "revolute", "rigid", "cylindrical", "prismatic", "universal"])
def test_loops(kind, ends):
    """Of every kind, between two bodies and with the ground on either side."""
    loop, q = closed(kind, ends)
    for seed in range(3):
        agree(at_rest([loop], seed, q), [loop], seed)


def linked(kind: str, ends: tuple[str, str], *, longer: float = 0.0, known: bool = True) -> tuple[rbd.LoopClosure, np.ndarray]:
    """A rod or rope between random poses, longer than the distance by so much."""
    q = pin.integrate(PAIR.model, pin.neutral(PAIR.model), np.random.default_rng(5).normal(size=PAIR.nv))
    apart = np.linalg.norm(np.subtract(*(rbd.State(PAIR, q).frame(end).X_WF.translation for end in ends)))
    return rbd.LoopClosure("c", *ends, kind=kind, length=float(apart) + longer if known else None), q


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("ends", ENDS, ids="-".join)
@pytest.mark.parametrize("kind", ["rod", "rope"])
def test_rods_and_ropes(kind, ends, known):
    """Their row turns with the two ends: centripetal terms of both bodies, at their own speeds along it; a rope opens too."""
    loop, q = linked(kind, ends, longer=1e-7, known=known)
    opened = set()
    for seed in range(6):
        state = at_rest([loop], seed, q)
        assert np.abs(state.v).max() > 0.5
        agree(state, [loop], seed)
        opened.add(both(state, [loop], 5.0 * np.random.default_rng(seed).normal(size=PAIR.nv))[0].multipliers[0] == 0.0)
    assert opened == ({True, False} if kind == "rope" else {False})


@pytest.mark.parametrize("ends", ENDS, ids="-".join)
def test_a_slack_rope_has_no_row(ends):
    """Beyond its margin it is not there, as in the general way; within a joint's limit beside it, which has its own."""
    for longer, rows in ((2e-3, 0), (2e-6, 0), (0.5e-6, 1), (-1e-4, 1)):
        rope, q = linked("rope", ends, longer=longer)
        state = at_rest([rope], 1, q) if rows else rbd.State(PAIR, q, np.random.default_rng(1).normal(size=PAIR.nv))
        push = np.random.default_rng(2).normal(size=PAIR.nv)
        s, g = both(state, [rope], push)
        assert (s.solver == PREPARED, len(s.multipliers), len(g.multipliers)) == (True, rows, rows)
        assert np.abs(s.a - g.a).max() <= 1e-10 * np.abs(g.a).max()
        assert np.array_equal(s.forces["c"] == 0.0, g.forces["c"] == 0.0)
        assert np.abs(s.forces["c"] - g.forces["c"]).max() <= 1e-10 * max(1.0, np.abs(g.forces["c"]).max())


def test_rods_that_hold_a_platform_are_prepared_with_its_limits_and_many_states():
    """A bar on two rods and a rope, at many states: one by one, all at once, and the general way."""
    b = rbd.RobotBuilder("swing", root="planar", plane="xz")
    b.body("bar", rbd.robots.Rod((-0.5, 0, 0), (0.5, 0, 0), mass=2.0))
    b.frame("left", "bar", (-0.5, 0, 0))
    b.frame("right", "bar", (0.5, 0, 0))
    b.frame("middle", "bar", (0, 0, 0.1))
    robot = b.robot()
    rods = [rbd.LoopClosure(f"to_{end}", "universe", end, kind="rod") for end in ("left", "right")]
    held = [*rods, rbd.LoopClosure("rope", "universe", "middle", kind="rope", length=0.8)]
    rng, states = np.random.default_rng(0), []
    for i in range(20):  # slack at every second one
        turned = robot.at([0.0, 0.0, *(lambda th: (np.cos(th), np.sin(th)))(rng.normal())])
        away = np.array([0.0, np.cos(0.3 * i), np.sin(0.3 * i)])[[1, 0, 2]] * (0.8 if i % 2 else 0.6)
        q = turned.q.copy()
        q[:2] += (away - turned.frame("middle").X_WF.translation)[[0, 2]]
        states.append(rbd.mechanism.project_velocity(robot.at(q, rng.normal(size=3)), held))
    Q, V = (np.array([getattr(s, x) for s in states]) for x in "qv")
    together = rbd.solve_many(robot, Q, V, np.zeros((20, 0)), held)
    for i, state in enumerate(states):
        one, general = rbd.solve(state, [], held), rbd.solve(state, [], held, solver=GaussFirst())
        assert one.solver == PREPARED and len(one.multipliers) == len(general.multipliers) == 2 + i % 2
        for found in (one.a, together.a[i]):
            assert np.abs(found - general.a).max() <= 1e-10 * max(1.0, np.abs(general.a).max())


def test_a_rod_without_length_is_refused_the_general_way():
    """Its ends coincide: no direction, by name, from either way."""
    rod = rbd.LoopClosure("c", "a_box", "b_box", kind="rod")
    with pytest.raises(rbd.errors.InputError, match="'c'.* coincide"):
        rbd.solve(PAIR.at(), [], [rod])


def test_a_loop_that_is_open_is_answered_the_general_way_with_its_warning():
    """By more than a millimetre, or a milliradian."""
    for kind in ("point", "planar", "revolute", "rigid", "rod", "rope"):
        loop, q = closed(kind, ENDS[0]) if kind[0] != "r" or kind in ("revolute", "rigid") else linked(kind, ENDS[0])
        q[7:10] += [0.0, 0.0, 0.01]
        with pytest.warns(rbd.errors.LoopNotClosedWarning):
            assert rbd.solve(rbd.State(PAIR, q), [], [loop]).solver != PREPARED


def test_a_mechanism_with_loops_of_its_own_is_prepared():
    """They count unless loops=False."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    with_them, without = (rbd.solve(robot.at("assembled"), [1.0], [], loops=loops) for loops in (True, False))
    assert with_them.solver == without.solver == PREPARED
    assert len(with_them.multipliers) == 2 and len(without.multipliers) == 0


@pytest.mark.parametrize(
    ("entries", "case"),
    [
        (slice(12, 18), "ground"),
        (slice(18, 24), "ground"),
        (slice(27, 30), "ground"),
        (slice(24, 27), "turntable"),
        (slice(30, 39), "revolute"),
        (slice(39, 48), "revolute"),
        (slice(30, 39), "rigid"),
        (slice(9, 12), "body"),
        (slice(30, 33), "rod"),
        (slice(34, 35), "rod"),
    ],
    ids=lambda x: x if isinstance(x, str) else f"{x.start}-{x.stop}",
)
def test_a_wrong_constant_is_noticed(entries, case, monkeypatch):
    """A milliunit more in one constant of the rows: the general way answers."""
    if case in SURFACES:
        constraint, q = contacts_on(SURFACES[case])["patch"](None), None
    else:
        constraint, q = linked(case, ENDS[0]) if case == "rod" else closed(case, ENDS[0])
    state, push = at_rest([constraint], 1, q), 5.0 * np.random.default_rng(1).normal(size=PAIR.nv)
    form = prepared(PAIR, (constraint,))
    assert form is not None
    assert both(state, [constraint], push)[0].solver == PREPARED

    def wrong(given: dict[str, Any]) -> None:
        given["places"] = given["places"].copy()
        given["places"][:, entries] += 1e-3 * np.arange(1.0, 1.0 + entries.stop - entries.start)

    assert "places" in NAMES
    plan = form.plan(state.q)
    monkeypatch.setattr(plan, "_kernel", Changed(wrong, _nothing))
    found = rbd.solve(state, [], [constraint], external=push, check=False)
    assert found.solver != PREPARED and found.residuals.within(1e-9)


def test_constraints_with_the_same_values_share_their_prepared_form():
    """They are often made anew at each call; other values, names and classes have forms of their own."""
    solo = rbd.load_robot("solo12")
    first = prepared(solo, tuple(solo.feet(0.7)))
    for _ in range(70):  # more than are kept
        assert prepared(solo, tuple(solo.feet(0.7))) is first
    assert prepared(solo, tuple(solo.feet(0.6))) is not first
    assert prepared(solo, tuple(solo.feet(0.7, on=None))) is not first
    a, b = (prepared(solo, (rbd.JointLock(name, "FL_KFE"),)) for name in ("a", "b"))
    assert a is not b and prepared(solo, (rbd.JointFriction("a", "FL_KFE", 1.0),)) is not a


# ------------------------------------------------------------------------------------------------------------- drives


def driven_arm() -> rbd.Robot:
    """A box that floats, with an arm of two links, whose tip a rod holds."""
    b = rbd.RobotBuilder("driven")
    b.body("box", rbd.robots.Box((0.3, 0.2, 0.1), mass=2.0))
    b.body("upper", rbd.robots.Rod((0, 0, 0), (0.3, 0.1, 0), mass=1.0))
    b.body("lower", rbd.robots.Rod((0, 0, 0), (0, 0.1, -0.4), mass=0.5))
    b.body("slide", rbd.robots.Sphere(0.05, mass=0.3))
    b.joint("shoulder", "box", "upper", at=(0.1, 0, 0), axis=(0, 1, 1), motor=True, armature=0.1)
    b.joint("elbow", "upper", "lower", "continuous", at=(0.3, 0.1, 0), axis=(1, 0, 0))
    b.joint("rail", "lower", "slide", "prismatic", at=(0, 0.1, -0.4), axis=(0, 1, 0))
    b.frame("tip", "slide", (0, 0, -0.1))
    return b.robot()


DRIVES = [
    rbd.DrivenJoint("one", "shoulder", rbd.Speed(2.0)),
    rbd.DrivenJoint("two", "elbow", lambda t: (0.3 * np.sin(4 * t), 1.2 * np.cos(4 * t), -4.8 * np.sin(4 * t))),
    rbd.DrivenJoint("three", "rail", lambda t: np.exp(t)),
]


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("held", ["alone", "rod", "ball", "sole"])
def test_driven_joints(held, count):
    """At several times, with a loop, a rod and a sole with friction beside them: J_dot v and M of the motion that is driven."""
    robot, drives = driven_arm(), DRIVES[:count]
    rng, beside = (
        np.random.default_rng(count),
        {
            "alone": [],
            "rod": [rbd.LoopClosure("held", "universe", "tip", kind="rod")],
            "ball": [rbd.LoopClosure("held", "universe", "tip")],
            "sole": [rbd.SurfaceContact("held", "box", half_lengths=(0.1, 0.1), friction=0.8, on=None)],
        }[held],
    )
    for t in (0.0, 0.3, 0.9):
        q = pin.integrate(robot.model, robot.neutral(), 0.5 * rng.normal(size=robot.nv))
        if held == "ball":
            q[:3] -= robot.at(q).frame("tip").X_WF.translation
        state = rbd.mechanism.project_velocity(robot.at(q, rng.normal(size=robot.nv)).at_time(t), [*drives, *beside])
        tau, push = rng.normal(size=1), rng.normal(size=robot.nv)
        s, g = (rbd.solve(state, tau, [*drives, *beside], external=push, solver=by) for by in (None, GaussFirst()))
        assert s.solver == PREPARED and g.solver != PREPARED
        assert residuals_of(s.problem, s.a, s.multipliers, s.weights, s.law).worst <= 1e-9
        assert np.abs(s.a - g.a).max() <= 1e-10 * max(1.0, np.abs(g.a).max())
        assert np.abs(s.multipliers - g.multipliers).max() <= 1e-9 * max(1.0, np.abs(g.multipliers).max())
        for drive in drives:
            given = drive.motion_at(t)[2]
            assert abs(s.a[robot.joints[drive.joint].v.start] - given) <= 1e-10 * max(1.0, abs(given))


def test_a_drive_that_shares_its_joint_or_is_off_its_speed_is_answered_as_before():
    """Dry friction on a driven joint, a coupling to it, a stop of it: the general way; off its speed the warning of both."""
    robot = driven_arm()
    state = robot.at(v=np.zeros(robot.nv))
    drive = rbd.DrivenJoint("drive", "shoulder", rbd.Speed(0.0))
    for other in (
        rbd.JointFriction("other", "shoulder", 1.0),
        rbd.JointCoupling("other", "elbow", "shoulder", ratio=2.0),
        rbd.JointLimit("other", "shoulder", upper=0.0),
    ):
        assert rbd.solve(state, [0.0], [drive, other]).solver != PREPARED
    with pytest.raises(rbd.errors.InputError, match="both prescribe"):
        rbd.solve(state, [0.0], [drive, rbd.DrivenJoint("other", "shoulder", rbd.Speed(1.0))])
    fast = rbd.DrivenJoint("drive", "shoulder", rbd.Speed(0.5))
    with pytest.warns(rbd.errors.MovingConstraintWarning, match="drive"):
        assert rbd.solve(state, [0.0], [fast]).solver == PREPARED
    with warnings.catch_warnings():
        warnings.simplefilter("error", rbd.errors.MovingConstraintWarning)
        rbd.solve(rbd.mechanism.project_velocity(state, [fast]), [0.0], [fast])


def test_many_states_with_drives_are_those_of_one_by_one():
    """Each at its own time."""
    robot, rng = driven_arm(), np.random.default_rng(0)
    states = [robot.at(v=rng.normal(size=robot.nv)).at_time(t) for t in (0.0, 0.2, 0.5)]
    states = [rbd.mechanism.project_velocity(s, DRIVES) for s in states]
    Q, V = (np.array([getattr(s, x) for s in states]) for x in "qv")
    found = rbd.solve_many(robot, Q, V, np.zeros((3, 1)), DRIVES, t=np.array([s.t for s in states]))
    for i, s in enumerate(states):
        assert np.abs(found.a[i] - rbd.solve(s, [0.0], DRIVES).a).max() <= 1e-10 * np.abs(found.a[i]).max()


LIFT = rbd.Ground(
    motion=lambda t: (
        (0.1 * np.sin(3 * t), 0.2 * t * t, 0.3 * np.cos(2 * t)),
        (0.3 * np.cos(3 * t), 0.4 * t, -0.6 * np.sin(2 * t)),
        (-0.9 * np.sin(3 * t), 0.4, -1.2 * np.cos(2 * t)),
    ),
    normal=(0.6, 0.0, 0.8),
)
BELT = rbd.Ground(motion=lambda t: (np.sin(t), 0.0, t), normal=(0.6, 0.0, 0.8))


@pytest.mark.parametrize("mu", [None, 0.6, 0.0])
@pytest.mark.parametrize("kind", ["point", "edge", "patch"])
def test_contacts_with_ground_that_follows_a_motion_of_time(kind, mu):
    """At several times, on one ground and on two that move apart: velocity and acceleration are those of the time."""
    for seed, t in enumerate((0.0, 0.4, 1.1)):
        two = [contacts_on(LIFT)[kind](mu), rbd.PointContact("d", "a_box", offset=(0.1, 0, 0), friction=mu, on=BELT)]
        for held in (two[:1], two):
            state = rbd.mechanism.project_velocity(at_rest(held[:1], seed).at_time(t), held)
            agree(state, held, seed)


def test_a_lift_is_looked_for_where_it_is():
    """A box on a lift's plane at 0.4 s: there it is prepared, and 0.4 s before it is off it by 3 cm, which is said."""
    lift = rbd.Ground(point=(0, 0, -0.5), motion=lambda t: (0.0, 0.0, 0.3 * t * t))
    sole = rbd.SurfaceContact(
        "c", "b_box", placement=pin.SE3(np.eye(3), np.array([0, 0, -0.5])), on=lift, friction=0.5, **SQUARE
    )
    q = pin.neutral(PAIR.model)
    q[9] += 0.3 * 0.16
    on = rbd.mechanism.project_velocity(rbd.State(PAIR, q).at_time(0.4), [sole])
    assert both(on, [sole], np.zeros(PAIR.nv))[0].solver == PREPARED
    with pytest.warns(rbd.errors.DistantContactWarning, match="'c'"):
        rbd.solve(rbd.State(PAIR, q), [], [sole])
