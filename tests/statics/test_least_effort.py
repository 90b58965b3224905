"""The prepared form of least effort: it agrees with the general way, and a fault in what it uses is noticed."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import CannotMove
from rbd.problem.residuals import SOLVED
from rbd.statics import effort_kernel, least_effort, wanted_motion
from rbd.statics.actuation import Actuation
from rbd.statics.effort import DEFAULT
from rbd.statics.least_effort import LeastEffort
from rbd.statics.wanted_motion import EffortChoice, WantedMotion

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
Array = np.ndarray
ROBOTS = ("talos", "g1", "solo12")
KINDS = ("inside", "at a limit", "impossible")
SPREAD = {"inside": 0.2, "at a limit": 1.5, "impossible": 8.0}
"""Of wanted accelerations, in units of random generalised accelerations."""


@cache
def robot_of(name: str) -> rbd.Robot:
    """Loaded once."""
    return rbd.load_robot(name)


def draw(robot: rbd.Robot, feet: list, rng: np.random.Generator, spread: float) -> tuple[rbd.State, Array]:
    """A state at rest or moving, its feet at rest, and an acceleration that leaves them so."""
    standing = robot.standing()
    q = pin.integrate(robot.model, standing.q, 0.05 * rng.normal(size=robot.nv))
    J = np.concatenate([foot.rows(rbd.State(robot, q)).J for foot in feet])
    v = 0.3 * rng.normal(size=robot.nv)
    for _ in range(2):
        v -= np.linalg.lstsq(J, J @ v, rcond=None)[0]
    state = rbd.State(robot, q, v)
    a = spread * rng.normal(size=robot.nv)
    for _ in range(2):
        a -= np.linalg.lstsq(J, np.concatenate([r.J @ a + r.bias for r in (foot.rows(state) for foot in feet)]), rcond=None)[0]
    return state, a


def wanted(state: rbd.State, a: Array, contacts: list, margin: float, external: object = None) -> WantedMotion:
    """As `rbd.inverse_dynamics` makes it."""
    choice = EffortChoice.of(None, "cone", margin, 1e-6, holds=False)
    return WantedMotion(state, a, tuple(contacts), external, choice)


@pytest.mark.parametrize("name", ROBOTS)
def test_both_ways_find_the_same_least_effort(name):
    """Random motions on feet, some with a push or a lock: torques and forces are those of the general way."""
    robot, rng, met = robot_of(name), np.random.default_rng(23), dict.fromkeys(KINDS, 0)
    joint = [joint.name for joint in robot.joints.values() if joint.nv == 1][-1]
    for i in range(60):
        kind = KINDS[i % 3]
        feet = robot.feet(float(rng.uniform(0.3, 0.9)), on=None)[: None if i % 4 else 1 if name != "solo12" else 3]
        lock = [rbd.JointLock("lock", joint)] * (i % 5 == 0)
        push = [rbd.ExternalForce(feet[0].frame, (3.0, -2.0, 1.0), (0.1, 0.2, 0.3), offset=(0.1, 0.0, 0.3))] * (i % 2)
        state, a = draw(robot, [*feet, *lock], rng, SPREAD[kind])
        given = wanted(state, a, [*feet, *lock], 0.05 * (i % 3), push or None)
        quick, general = given.quick, given.sought(0.05 * (i % 3))
        if not isinstance(general, Actuation):
            met["impossible"] += 1
            assert quick is None
            continue
        if general.method != "Newton":  # whose steps did not end, in either way
            continue
        assert quick is not None and quick.bound <= SOLVED and quick.residuals.within(SOLVED) and quick.least
        met["inside" if quick.iterations == 0 else "at a limit"] += 1
        size = max(1.0, float(np.abs(general.tau).max()), robot.force_unit)
        assert np.abs(quick.tau - general.tau).max() < 1e-9 * size
        assert np.abs(quick.weights - general.weights).max() < 1e-9 * size
    assert min(met.values()) > 3, met


def test_what_opens_slips_or_moves_goes_the_general_way():
    """The prepared form is for points that keep still."""
    solo = robot_of("solo12")
    feet, state = solo.feet(0.7, on=None), solo.standing()
    up = rbd.mechanism.project_acceleration(state, np.eye(solo.nv)[2], feet).a
    assert wanted(state, up, feet, 0.05).quick is not None
    lifted = rbd.mechanism.project_acceleration(state, np.eye(solo.nv)[8], feet[1:]).a
    for case in (wanted(state, lifted, feet, 0.05), wanted(state.with_velocity(0.1 * np.ones(solo.nv)), up, feet, 0.05)):
        assert case.quick is None


FAULTS: dict[str, Callable[[list, Callable], object]] = {}
"""{what: what it does to the arguments of the compiled search, or to what is written after it}."""


def fault(place: int, change: Callable[[Array], Array], *, after: bool = False) -> Callable[[list, Callable], object]:
    """Of one argument of the compiled search: changed before, where it is read, or after, where it is written."""

    def spoil(arguments: list, call: Callable) -> object:
        if not after:
            arguments[place] = change(arguments[place])
        out = call(*arguments)
        if after:
            arguments[place][:] = change(arguments[place])
        return out

    return spoil


NAMES = list(inspect.signature(effort_kernel._least_effort).parameters)
"""The arguments of `effort_kernel.least_effort`."""
_SCALE = {"J": 1.01, "X": 1.01, "need": 1.01, "force": 1.02, "arm": 0.9, "limit": 1.1, "p": 1.3, "r": 2.0, "mu": 1.1}
for _name, _factor in _SCALE.items():
    FAULTS[f"{_name} is {_factor} of it"] = fault(NAMES.index(_name), lambda x, _factor=_factor: _factor * x)
FAULTS["p of one motor"] = fault(NAMES.index("p"), lambda p: p * np.where(np.arange(len(p)) == 3, 2.0, 1.0))
FAULTS["limits of torques are a thousandth"] = fault(NAMES.index("most"), lambda x: 1e-3 * x)
for _name in ("w", "tau", "rate", "z"):
    FAULTS[f"{_name} afterwards"] = fault(NAMES.index(_name), lambda x: x + 1e-4 * max(1.0, np.abs(x).max()), after=True)
FAULTS["weights of the state before"] = fault(NAMES.index("w"), lambda w: np.roll(w, 3), after=True)


@pytest.mark.parametrize("what", FAULTS)
def test_a_fault_in_the_search_is_noticed(what, monkeypatch):
    """The certificate, which uses none of these arrays, refuses what is wrong or not least; the general way answers."""
    talos, rng, kernel = robot_of("talos"), np.random.default_rng(5), least_effort.effort_kernel()
    soles = talos.soles(0.5, on=None)
    cases = [draw(talos, soles, rng, 1.0) for _ in range(8)]
    sound = [wanted(state, a, soles, 0.05) for state, a in cases]
    expected = [(case, case.quick) for case in sound if case.quick is not None]
    assert len(expected) > 3
    true, noticed = kernel.least_effort, 0
    monkeypatch.setattr(kernel, "least_effort", lambda *arguments: FAULTS[what](list(arguments), true))
    for case, right in expected:
        found = wanted(case.state, case.a, soles, 0.05)
        if found.quick is None:
            noticed += 1
        else:  # the fault made no difference here
            assert np.abs(found.quick.tau - right.tau).max() < 1e-6 * np.abs(right.tau).max()
    assert noticed > 0


def test_a_state_without_a_prepared_answer_has_that_of_the_general_way(monkeypatch):
    """Whatever the search does."""
    talos = robot_of("talos")
    soles = talos.soles(0.5, on=None)
    state, a = draw(talos, soles, np.random.default_rng(5), 0.2)
    expected = rbd.inverse_dynamics(state, a, soles)
    assert expected.bound <= SOLVED
    monkeypatch.setattr(LeastEffort, "at", lambda *_, **__: None)
    found = rbd.inverse_dynamics(state, a, soles)
    assert found.bound == np.inf and np.abs(found.tau - expected.tau).max() < 1e-9 * np.abs(expected.tau).max()


def test_an_impossible_motion_has_its_certificate():
    """The prepared form finds none, and the general way tells why."""
    talos = robot_of("talos")
    soles = talos.soles(0.5, on=None)
    state, a = draw(talos, soles, np.random.default_rng(5), 0.2)
    a = rbd.mechanism.project_acceleration(state, a - 30.0 * np.eye(talos.nv)[2], soles).a
    with pytest.raises(CannotMove) as told:
        rbd.inverse_dynamics(state, a, soles)
    assert told.value.certificate is not None


def test_what_is_constant_is_kept_with_the_robot():
    """One form for a plan, an effort and a margin."""
    solo = robot_of("solo12")
    state = solo.standing()
    form = wanted_motion.prepared(solo, tuple(solo.feet(0.7)))
    assert form is not None
    one, other = (LeastEffort.of(form.plan(state.q), DEFAULT, 0.05) for _ in range(2))
    assert one is other
