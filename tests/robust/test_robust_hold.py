"""Sets that are held: closed forms, Talos, members drawn at random, bad input."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.robust import Counterexample, PushSet, RobustHold, hold

URDF = Path(__file__).parents[2] / "urdf"
BOX, CRATE, LADDER = (rbd.load_robot(URDF / f"{name}.urdf") for name in ("box", "crate", "ladder"))
G = 9.81
SIDEWAYS = PushSet.box("torso_2_link", (-20.0, -20.0, -20.0), (20.0, 20.0, 20.0))
"""Pushes of a robot that stands."""


def sole(robot: rbd.Robot, height: float, friction: float, **on: object) -> list[rbd.SurfaceContact]:
    """The underside, 0.4 x 0.4 m, of a box of this height."""
    placement = np.eye(4)
    placement[2, 3] = -0.5 * height
    return [rbd.SurfaceContact("base", robot.name, half_lengths=(0.2, 0.2), placement=placement, friction=friction, **on)]


def on_slope(angle: float) -> RobustHold | Counterexample:
    """The box on a slope of friction 0.5, its underside on the plane."""
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    state = BOX.at(np.array([*(0.1 * normal), 0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2)]))
    return hold(state, sole(BOX, 0.2, 0.5, on=rbd.Ground(normal=normal, point=(0, 0, 0))))


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-2])
def test_a_block_is_held_up_to_the_friction_angle_and_not_beyond(off):
    """A block on a slope slips where tan(angle) exceeds the coefficient: to a billionth of a radian from either side."""
    held, slips = on_slope(math.atan(0.5) - off), on_slope(math.atan(0.5) + off)
    assert held.proved and held.verify() and not slips.proved and slips.verify()
    at_a_point = 0.25 * BOX.mass * G * (0.5 * math.cos(math.atan(0.5) - off) - math.sin(math.atan(0.5) - off))
    assert held.margin == pytest.approx(at_a_point, rel=0.02) and slips.reach > 1e6 * BOX.mass * G


def test_a_busy_machine_proves_the_same(monkeypatch):
    """No clock ends the programs: without a moment of time the proof is that of an idle machine."""
    idle = on_slope(0.3)
    monkeypatch.setattr("rbd.solvers.conic_newton.CONIC_SECONDS", 1e-9)
    busy = on_slope(0.3)
    assert idle.proved and busy.document == idle.document


@pytest.mark.parametrize(("friction", "largest"), [(0.2, 0.2 * 20.0 * G), (0.9, 20.0 * G * 0.2 / 0.5)])
def test_a_crate_slips_or_tips(friction, largest):
    """Pushed at its middle, half its height above ground, it slips at mu m g or tips where push x height = m g x half width."""
    state = CRATE.at(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
    for share, proved in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
        found = hold(state, sole(CRATE, 1.0, friction), pushes={"crate": [(0, 0, 0), (share * largest, 0, 0)]})
        assert found.proved is proved and found.verify()


def test_a_lighter_crate_slips_first():
    """Of masses within 10 %, the lightest decides how far friction carries a push; it is the member that is named."""
    state, lightest = CRATE.at(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0])), 18.0
    contacts, largest = sole(CRATE, 1.0, 0.7), 0.2 * lightest * G
    held = hold(state, contacts, pushes={"crate": [(0, 0, 0), (0.999 * largest, 0, 0)]}, friction=0.2, mass={"crate": 0.1})
    slips = hold(
        state, contacts, pushes={"crate": [(0, 0, 0), (1.001 * largest, 0, 0)]}, friction=0.2, mass={"crate": (18, 22)}
    )
    assert held.proved and not slips.proved and slips.members[0].mass["crate"] == pytest.approx(lightest)


def test_a_ladder_stands_from_an_angle_on():
    """Floor mu1, wall mu2: tan(angle) >= (1 - mu1 mu2) / (2 mu1); each end on two points, 0.2 m apart."""
    ends = [("floor", -1.0, rbd.Ground(), 0.4), ("wall", 1.0, rbd.Ground(normal=(-1.0, 0.0, 0.0)), 0.3)]
    contacts = [
        rbd.PointContact(f"{name}{y}", "ladder", offset=(x, y, 0.0), friction=mu, on=on)
        for name, x, on, mu in ends
        for y in (-0.1, 0.1)
    ]
    angle = math.atan((1 - 0.4 * 0.3) / 0.8)
    for off, proved in ((1e-7, True), (-1e-7, False)):
        turn = 0.5 * (angle + off)
        state = LADDER.at(np.array([-math.cos(2 * turn), 0.0, math.sin(2 * turn), 0.0, -math.sin(turn), 0.0, math.cos(turn)]))
        found = hold(state, contacts)
        assert found.proved is proved and found.verify()


def drawn(robot: rbd.Robot, state: rbd.State, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(load, push) of a member: masses within 5 %, the trunk's centre of mass within 2 cm, by Pinocchio of another robot."""
    model, (trunk, X_JF) = robot.model.copy(), robot.site("torso_2_link")
    for j in range(1, model.njoints):
        I = model.inertias[j]
        lever = I.lever + (X_JF.rotation @ rng.uniform(-0.02, 0.02, 3) if j == trunk else 0.0)
        model.inertias[j] = pin.Inertia(I.mass * rng.uniform(0.95, 1.05), lever, I.inertia)
    push = rng.uniform(-20.0, 20.0, 3)
    weight = pin.computeGeneralizedGravity(model, model.createData(), state.q)
    return weight - state.frame("torso_2_link").J[:3].T @ push, push


@pytest.fixture(scope="module")
def talos_held(talos) -> RobustHold:
    """Eight corners of pushes, 33 masses within 5 %, the trunk within 2 cm, friction from 0.5 on."""
    found = hold(talos.standing(), talos.soles(0.7), pushes=SIDEWAYS, friction=0.5, mass=0.05, com={"torso_2_link": 0.02})
    assert isinstance(found, RobustHold)
    return found


def test_talos_is_held_whatever_it_weighs_and_however_it_is_pushed(talos, talos_held):
    """The proof holds in fractions; and `rbd.hold` holds robots of other masses, made anew, under other pushes."""
    state, rng = talos.standing(), np.random.default_rng(0)
    assert talos_held.parts == 1 and talos_held.margin > 0.9 and talos_held.verify() and len(talos_held.loads.names) == 36
    for _ in range(3):
        load, _ = drawn(talos, state, rng)
        assert rbd.hold(state, talos.soles(0.5), external=state.h - load).margins is not None


def test_loads_of_members_lie_in_the_set(talos, talos_held):
    """What Pinocchio says of another robot is a corner of the pushes plus columns with numbers up to one."""
    loads, state, rng = talos_held.loads, talos.standing(), np.random.default_rng(1)
    for _ in range(5):
        load, push = drawn(talos, state, rng)
        base = loads.corners.mean(axis=0) - state.frame("torso_2_link").J[:3].T @ push
        t, *_ = np.linalg.lstsq(loads.columns.T, load - base, rcond=None)
        assert np.abs(loads.columns.T @ t - (load - base)).max() < 1e-9 * loads.balance.unit and np.abs(t).max() <= 1.0


def test_members_refute_nothing_that_was_proved(talos, talos_held, exhaustive):
    """A thousand members, a million in the exhaustive run: the forces of the proof balance each within its cones and limits."""
    loads, count = talos_held.loads, 1_000_000 if exhaustive else 1_000
    balance, proof, rng = loads.balance, talos_held.document["proof"], np.random.default_rng(2)
    forces = np.array([[float(Fraction(x)) for x in row] for row in proof["forces"]])
    corrections = np.array([[[float(Fraction(x)) for x in row] for row in part] for part in proof["corrections"]])
    P, idle, cones = balance.per_weight, loads.state.robot.unactuated, balance.sets.cone_columns
    _, most = loads.limits
    for start in range(0, count, 10_000):
        n = min(10_000, count - start)
        shares, t = rng.dirichlet(np.full(len(forces), 0.3), n), rng.choice([-1.0, 1.0], (n, corrections.shape[1]))
        t[::2] *= rng.uniform(0.0, 1.0, t[::2].shape)
        f = shares @ forces + np.einsum("nv,ni,vip->np", shares, t, corrections, optimize=True)
        load = shares @ loads.corners + t @ loads.columns
        left = load - f @ P.T
        normal, aside = f[:, cones[:, 2]], np.hypot(f[:, cones[:, 0]], f[:, cones[:, 1]])
        assert np.abs(left[:, idle]).max() < 1e-9 * balance.unit
        assert (balance.sets.mu * normal - aside).min() > talos_held.margin - 1e-9 * balance.unit
        assert (most - np.abs(left[:, loads.state.robot.actuated])).min() > talos_held.margin - 1e-9 * balance.unit


def test_one_torque_and_a_law_of_the_push(talos):
    """No one torque balances pushes of a robot with joints, a law affine in the push does; one torque serves any friction."""
    state, soles = talos.standing(), talos.soles(0.7)
    pushed = PushSet("torso_2_link", [(0, 0, 0), (10, 0, 0), (0, 10, 0)])
    one, law = (hold(state, soles, pushes=pushed, torques=torques) for torques in ("one", "affine"))
    assert isinstance(one, Counterexample) and one.verify() and "torques='each'" in str(one)
    assert (
        isinstance(law, RobustHold)
        and law.verify()
        and law.gain.shape == (32, 3)
        and law.balance < 1e-6 * law.loads.balance.unit
    )
    free = hold(state, soles, friction=0.5, torques="one")
    assert isinstance(free, RobustHold) and free.verify()
    for friction in (0.5, 0.9):
        assert np.abs(rbd.solve(state, free.torque, talos.soles(friction)).a).max() < 1e-5


def test_sets_that_need_parts_are_split():
    """A centre of mass within 0.15 m of the middle of a base 0.4 m wide: corner forces are no affine function of it."""
    state = CRATE.at(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
    anywhere, contacts = {"crate": (0.15, 0.15, 0.0)}, sole(CRATE, 1.0, 0.3)
    found = hold(state, contacts, com=anywhere)
    assert isinstance(found, RobustHold) and 1 < found.parts <= 8 and found.verify()
    with pytest.raises(rbd.NoSolution, match="not decided in the set as a whole.*larger most_parts"):
        hold(state, contacts, com=anywhere, most_parts=1)
    beyond = hold(state, contacts, com={"crate": (0.15, 0.2001, 0.0)})
    assert isinstance(beyond, Counterexample) and beyond.verify() and abs(beyond.members[0].com["crate"][1]) > 0.2


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"pushes": {"crate": np.zeros((0, 3))}}, "at least one"),
        ({"pushes": {"crate": [(0, 0)]}}, r"corners \(k, 3\)"),
        ({"pushes": {"crat": [(0, 0, 0)]}}, "nearest: 'crate'"),
        ({"pushes": 3.0}, "PushSet"),
        ({"mass": {"crate": (22.0, 18.0)}}, "low <= high"),
        ({"mass": {"crate": 18.0}}, "share from 0 to 1"),
        ({"mass": {"create": 0.1}}, "nearest: 'crate'"),
        ({"mass": -0.1}, "share from 0 to 1"),
        ({"com": {"crate": -0.01}}, "half-widths"),
        ({"com": {"trunk": 0.01}}, "no frame 'trunk'"),
        ({"com": 0.02}, "half-width"),
        ({"friction": {"bas": 0.5}}, "nearest: 'base'"),
        ({"friction": -1.0}, "friction"),
        ({"torques": "any"}, "each, one, affine"),
        ({"margin": -1.0}, "zero or more"),
        ({"most_parts": 0}, "most_parts"),
    ],
)
def test_sets_that_are_none_are_named(given, words):
    """Empty, reversed, of other units, of links that are not there."""
    state = CRATE.at(np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
    with pytest.raises(rbd.RbdError, match=words):
        hold(state, sole(CRATE, 1.0, 0.5), **given)


def test_a_reversed_box_of_pushes_is_named():
    """The first number is the least."""
    with pytest.raises(rbd.InputError, match="none of the first above"):
        PushSet.box("crate", (1, 0, 0), (0, 1, 1))


def test_a_cone_of_pushes_holds_the_circular_one():
    """The pyramid is around it: each force of the circle is a combination of its corners."""
    found = PushSet.cone("crate", (0, 0, -2), 10.0, 30.0, sides=6)
    corners = np.asarray(found.corners)[1:]
    middles = 0.5 * (corners + np.roll(corners, -1, axis=0))
    assert np.allclose(corners[:, 2], -10.0) and np.hypot(middles[:, 0], middles[:, 1]).min() == pytest.approx(
        10.0 / math.sqrt(3.0)
    )
