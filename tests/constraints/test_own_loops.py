"""One rule for all verbs: a robot's own loops hold, unless loops=False; given among the constraints they count once."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rbd
from rbd.control import HoldPosture, PostureTask, TrackingController, WholeBodyController, step
from rbd.errors import DuplicateName, InputError
from rbd.motion import MomentumObserver, estimate_forces_along as along

BARS = rbd.load_robot("four_bar")
PIN = BARS.loops()[0]
STATE = BARS.at("assembled")
LOWEST = rbd.find_equilibrium(STATE, [PIN]).state
ROCKER = rbd.ExternalForce("rocker", (0.0, 0.0, 4.0))
BENT = STATE.with_joints({"crank_joint": 0.8})


def moving() -> rbd.State:
    """On the loop, at 1 rad/s of the crank."""
    return STATE.with_velocity(rbd.mechanism.velocity_partition(STATE, [PIN], {"crank_joint": 1.0}).v)


def swung(constraints: list[Any], **loops: bool) -> rbd.Trajectory:
    return rbd.simulate(STATE, constraints, duration=0.02, step=1e-3, progress=False, **loops)


def followed(constraints: list[Any], **loops: bool) -> np.ndarray:
    """Torques of feed-forward along a motion of the closed four-bar."""
    follow = TrackingController(swung([PIN]), constraints, torques="nearest", **loops)
    return np.asarray(follow.reference.tau)


def estimated(found: rbd.motion.ForceEstimate) -> list[str]:
    return [rows.name for rows in found.rows]


def identified(constraints: list[Any], **loops: bool) -> np.ndarray:
    given = rbd.motion.identification.MeasuredMotion(swung([PIN]), contacts=constraints, **loops)
    return np.asarray(str(given))


def posture(constraints: list[Any], **loops: bool) -> np.ndarray:
    hold = HoldPosture(STATE, constraints, external=[ROCKER], **loops)
    return np.asarray(hold(STATE.with_joints({"crank_joint": 0.8}), 0.0))


def whole_body(constraints: list[Any], **loops: bool) -> np.ndarray:
    controller = WholeBodyController([PostureTask(BENT.q)], constraints, **loops)
    return np.asarray(rbd.simulate(STATE, duration=0.02, step=0.01, controller=controller, progress=False).tau)


VERBS: dict[str, Callable[..., Any]] = {
    "solve": lambda c, **k: rbd.solve(STATE, [0.5], c, **k).a,
    "gauss_problem": lambda c, **k: rbd.gauss_problem(STATE, [0.5], c, **k).J,
    "solve_many": lambda c, **k: rbd.solve_many(BARS, STATE.q, None, [[0.0], [0.5]], c, **k).a,
    "inverse_dynamics": lambda c, **k: rbd.inverse_dynamics(STATE, rbd.solve(STATE, [0.5], [PIN]).a, c, **k).tau,
    "hold": lambda c, **k: rbd.hold(STATE, c, **k).tau,
    "hold_many": lambda c, **k: rbd.statics.hold_many(BARS, STATE.q, c, **k).tau,
    "push_limits": lambda c, **k: rbd.statics.push_limits(STATE, c, "rocker", (1, 0, 0), at_most=5.0, **k).forces,
    "simulate": lambda c, **k: swung(c, **k).q,
    "impact": lambda c, **k: rbd.impact(STATE.with_velocity([1.0, 1.0, 1.0]), c, **k).v,
    "linearise": lambda c, **k: rbd.linearise(LOWEST, c, **k).A,
    "find_equilibrium": lambda c, **k: rbd.find_equilibrium(STATE, c, **k).state.q,
    "estimate_forces": lambda c, **k: estimated(rbd.estimate_forces(STATE, np.zeros(3), c, [0.0], **k)),
    "estimate_forces_along": lambda c, **k: estimated(along(swung([PIN]), c, np.zeros((21, 1)), **k)[0]),
    "MomentumObserver": lambda c, **k: estimated(MomentumObserver(BARS, c, bandwidth=9.0, **k).update(0.0, STATE, [0.0])),
    "MeasuredMotion": identified,
    "step": lambda c, **k: step(STATE, [PostureTask(BENT.q)], c, **k).tau,
    "HoldPosture": posture,
    "TrackingController": followed,
    "WholeBodyController": whole_body,
    "mobility": lambda c, **k: rbd.mechanism.mobility(STATE, c, **k).instantaneous,
    "integrability": lambda c, **k: rbd.mechanism.integrability(STATE, [*c, lock()], **k).velocity_dof,
    "project_velocity": lambda c, **k: rbd.mechanism.project_velocity(STATE.with_velocity([1.0, 0.0, 0.0]), c, **k).v,
    "project_acceleration": lambda c, **k: rbd.mechanism.project_acceleration(moving(), [1.0, 0.0, 0.0], c, **k).a,
    "independent_velocities": lambda c, **k: len(rbd.mechanism.independent_velocities(STATE, c, **k)),
    "classify": lambda c, **k: rbd.mechanism.classify(STATE, c, **k).kind,
}  # fmt: skip


def lock() -> rbd.JointLock:
    """Another constraint, so that something is left without the loop."""
    return rbd.JointLock("shut", "crank_joint", position=0.698)


@pytest.mark.parametrize("verb", VERBS)
def test_own_loops_hold_once_or_not_at_all(verb: str) -> None:
    """By default as if they were given; given they count once; with loops=False only what is given holds."""
    ask = VERBS[verb]
    default, given = np.array(ask([])), np.array(ask([PIN]))
    assert np.array_equal(default, given, equal_nan=default.dtype.kind == "f")
    assert np.array_equal(np.array(ask([PIN], loops=False)), given, equal_nan=default.dtype.kind == "f")
    try:
        without = np.array(ask([], loops=False))
    except (rbd.RbdError, rbd.errors.RbdWarning):  # e.g. an open chain that its motor cannot hold
        return
    assert not (without.shape == default.shape and np.array_equal(without, default))


def test_a_four_bar_stays_closed() -> None:
    """It opened by 61 mm in 0.1 s."""
    motion = rbd.simulate(STATE, duration=0.1, step=1e-3, progress=False)
    assert max(np.abs(PIN.rows(sample.state).error).max() for sample in motion) < 1e-9
    opened = rbd.simulate(STATE, duration=0.1, step=1e-3, progress=False, loops=False)
    assert np.abs(PIN.rows(opened[-1].state).error).max() > 0.01


def test_a_pose_is_found_on_its_loops_or_off_them() -> None:
    """The tip of the coupler where crank and coupler alone can put it: off the circle of the rocker's tip."""
    place = STATE.with_joints({"crank_joint": 0.8, "coupler_joint": -0.3}).frame("coupler_tip").X_WF.translation
    near = rbd.find_pose(BARS, {"coupler_tip": tuple(place)}, posture="assembled", loops=False)
    assert np.abs(PIN.rows(BARS.at(near.q)).error).max() > 1e-3
    with pytest.raises(rbd.errors.CannotReach):
        rbd.find_pose(BARS, {"coupler_tip": tuple(place)}, posture="assembled")


def test_what_has_a_loops_name_and_kind_stands_in_its_place() -> None:
    """As one with feedback; what is no loop and has its name is refused."""
    pulled = rbd.constraints.Baumgarte(50.0).of(PIN)
    assert rbd.solve(STATE, [0.0], [pulled]).problem.origin.constraints == (pulled,)
    with pytest.raises(DuplicateName, match="a JointLock is named 'coupler_pin', as a loop of four_bar.*loops=False"):
        rbd.solve(STATE, [0.0], [rbd.JointLock("coupler_pin", "crank_joint")])
    assert rbd.solve(STATE, [0.0], [rbd.JointLock("coupler_pin", "crank_joint")], loops=False).a[0] == pytest.approx(0.0)


def test_loops_go_with_other_constraints() -> None:
    """A limit does not open the loop, and wheels, mimics and limits are what one gives."""
    limits = BARS.joint_limits()
    assert [rows.name for rows in rbd.gauss_problem(STATE, [0.0], limits).rows][-1] == "coupler_pin"
    coin = rbd.load_robot("rolling_disk")
    assert not rbd.gauss_problem(coin.at("upright"), [], []).rows


@pytest.mark.parametrize("nonsense", [None, 1, "no", [PIN]])
def test_loops_is_a_truth_value(nonsense: Any) -> None:
    solo = rbd.load_robot("solo12")
    for state in (STATE, solo.standing()):
        with pytest.raises(InputError, match="loops is .*expected True or False"):
            rbd.solve(state, None, loops=nonsense)


def test_every_verb_with_constraints_has_the_rule() -> None:
    """Each public function of constraints takes loops=True, but those whose answer contacts with the world decide alone."""
    modules = (rbd, rbd.mechanism, rbd.control, rbd.statics, rbd.motion, rbd.simulation, rbd.studies, rbd.motion.identification)
    public = {
        getattr(module, name) for module in modules for name in module.__all__ if name not in ("zmp_region", "wrench_cone")
    }
    seen = 0
    for each in filter(inspect.isfunction, public):
        taken = inspect.signature(each).parameters
        if "Sequence[Constraint]" in str(taken.get("constraints", taken.get("contacts", ""))):
            assert "loops" in taken and taken["loops"].default is True, each
            seen += 1
    assert seen > 30
