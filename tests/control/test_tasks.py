"""Tasks: their rows are the rates of what they are about, and each alone is reached to its own closed form."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array, range_of
from rbd.control import (
    ComTask,
    ForceTask,
    FrameTask,
    MomentumTask,
    PostureTask,
    Reference,
    TaskTerms,
    WholeBodyController,
    step,
)
from rbd.control.task_terms import Task, checked_tasks, robot_of
from rbd.errors import DuplicateName, FrameNotFound, InputError, JointNotFound
from rbd.model.checked_model import CheckedModel
from rbd.testing import TaskWrong, check_task

OFFSET = np.array([0.03, -0.02, 0.05])
LEG = Path(__file__).parents[2] / "urdf" / "parallel_leg.urdf"
HANDS = {"talos": "gripper_left_joint", "solo12": "FL_FOOT", "panda": "panda_hand", "leg": "foot"}


def robot(name: str) -> rbd.Robot:
    """One of `HANDS`: two with a floating base, an arm, a leg with passive joints."""
    if name == "leg":
        return rbd.load_robot(LEG)
    return rbd.load_robot(name, root="fixed") if name == "panda" else rbd.load_robot(name)


def drawn(one: rbd.Robot, rng: np.random.Generator, speed: float = 1.0) -> rbd.State:
    """Some pose, with some velocity."""
    q = pin.integrate(one.model, one.neutral(), rng.uniform(-1.0, 1.0, one.nv))
    return rbd.State(one, q, speed * rng.normal(size=one.nv))


def turn(rng: np.random.Generator, size: float = 1.0) -> Array:
    """A rotation of some size [rad]."""
    axis = rng.normal(size=3)
    return np.asarray(pin.exp3(size * axis / np.linalg.norm(axis)))


def frame_at(state: rbd.State, frame: str, a: Array) -> tuple[Array, Array, Array]:
    """(R, velocity, acceleration) of the point `OFFSET` of a frame, by Newton-Euler from Pinocchio's frame accelerations."""
    model, data = state.robot.model, state.robot.model.createData()
    pin.forwardKinematics(model, data, state.q, state.v, a)
    pin.updateFramePlacements(model, data)
    i, world = state.robot.frame_id(frame), pin.LOCAL_WORLD_ALIGNED
    R = data.oMf[i].rotation.copy()
    v, dv = pin.getFrameVelocity(model, data, i, world).vector, pin.getFrameClassicalAcceleration(model, data, i, world).vector
    w, r = v[3:], R @ OFFSET
    linear = dv[:3] + np.cross(dv[3:], r) + np.cross(w, np.cross(w, r))
    return R, np.concatenate([v[:3] + np.cross(w, r), w]), np.concatenate([linear, dv[3:]])


def least(terms: TaskTerms) -> Array:
    """The least acceleration that meets a task."""
    return np.asarray(np.linalg.lstsq(terms.A, terms.wanted, rcond=None)[0])


# ------------------------------------------------------------------------------------------ rows against differences


@pytest.mark.parametrize("name", HANDS)
def test_rows_are_the_rates_of_the_value(name: str, rng: np.random.Generator) -> None:
    """A v = y' and A a + J_dot v = y'' of the centre of mass, a point of a frame and its turning, and the motors' joints."""
    one, frame = robot(name), HANDS[name]
    state = drawn(one, rng)
    R0 = state.frame(frame).X_WF.rotation

    def pose(at: rbd.State) -> Array:
        X = at.frame(frame, OFFSET).X_WF
        return np.concatenate([X.translation, pin.log3(X.rotation @ R0.T)])

    def joints(at: rbd.State) -> Array:
        return np.asarray(pin.difference(one.model, state.q, at.q))[one.actuated]

    X, free = pin.SE3(turn(rng), rng.normal(size=3)), np.array([1.0, 0.0, 1.0])
    cases: list[tuple[Task, Callable[[rbd.State], Array]]] = [
        (ComTask(np.ones(3)), lambda at: at.com),
        (FrameTask(frame, X, offset=OFFSET), pose),
        (FrameTask(frame, X.translation, offset=OFFSET), lambda at: pose(at)[:3]),
        (FrameTask(frame, X.rotation), lambda at: pose(at)[3:]),
        (FrameTask(frame, X, offset=OFFSET, position_cost=free, orientation_cost=0.0), lambda at: pose(at)[[0, 2]]),
        (FrameTask(frame, X.translation, offset=OFFSET, axes="frame"), lambda at: R0.T @ pose(at)[:3]),
        (FrameTask(frame, X.rotation, axes="frame", orientation_cost=free), lambda at: (R0.T @ pose(at)[3:])[[0, 2]]),
        (PostureTask(drawn(one, rng)), joints),
        (PostureTask(drawn(one, rng).q, joints=one.actuated_names[1:]), lambda at: joints(at)[1:]),
    ]
    for task, value in cases:
        report = check_task(task, value, state, draws=2)
        assert report.rows == len(value(state)) and report.jacobian < 1e-7 and report.jdot_v < 1e-7


@pytest.mark.parametrize("name", ["talos", "panda"])
def test_rows_of_the_momentum_are_its_rate(name: str, rng: np.random.Generator) -> None:
    """A v is the momentum over the mass, by Pinocchio; A a + bias its rate, by differences along a motion."""
    one = robot(name)
    state, a = drawn(one, rng), rng.normal(size=one.nv)
    task, h = MomentumTask(linear_cost=1.0), 1e-3

    def momentum(q: Array, v: Array) -> Array:
        return np.asarray(pin.computeCentroidalMomentum(one.model, one.model.createData(), q, v).vector)

    there, back = task.terms(state, 0.0), task.terms(state.with_velocity(-state.v), 0.0)
    assert np.abs(there.A @ state.v * one.mass - momentum(state.q, state.v)).max() < 1e-10
    along = [
        momentum(pin.integrate(one.model, state.q, s * state.v + 0.5 * s * s * a), state.v + s * a)
        for s in (-2 * h, -h, h, 2 * h)
    ]
    rate = np.array([1.0, -8.0, 8.0, -1.0]) @ along / (12.0 * h)
    bias = -0.5 * (there.wanted + back.wanted)  # what is even in v
    assert np.abs(one.mass * (there.A @ a + bias) - rate).max() < 1e-7 * max(1.0, np.abs(rate).max())


def test_wrong_rows_are_noticed() -> None:
    """`check_task` sees a wrong sign and a missing J_dot v, and refuses what has no rows or another size."""
    talos = rbd.load_robot("talos")
    state = drawn(talos, np.random.default_rng(3))

    class Changed:
        name = "changed"

        def __init__(self, sign: float, bias: float) -> None:
            self.sign, self.bias, self.asked = sign, bias, set[float]()

        def terms(self, at: rbd.State, t: float) -> TaskTerms:
            self.asked.add(t)
            hand = at.frame("gripper_left_joint")
            return TaskTerms("changed", self.sign * hand.J[:3], -self.bias * hand.bias[:3], np.ones(3))

    def place(at: rbd.State) -> Array:
        return np.asarray(at.frame("gripper_left_joint").X_WF.translation)

    right = Changed(1.0, 1.0)
    assert check_task(right, place, state).rows == 3 and right.asked == {0.0}
    assert check_task(right, place, state, t=0.5).rows == 3 and right.asked == {0.0, 0.5}
    with pytest.raises(TaskWrong, match="A v of row"):
        check_task(Changed(-1.0, 1.0), place, state)
    with pytest.raises(TaskWrong, match="J_dot v of row"):
        check_task(Changed(1.0, 0.0), place, state)
    with pytest.raises(InputError, match="its rows are 3"):
        check_task(Changed(1.0, 1.0), lambda at: place(at)[:2], state)
    with pytest.raises(InputError, match="no rows of accelerations"):
        check_task(ForceTask("left_sole", np.zeros(3)), place, state)
    with pytest.raises(InputError, match="no rows of accelerations"):
        check_task(ComTask(np.zeros(3), cost=0.0), lambda at: np.zeros(0), state)


# ------------------------------------------------------------------------------------------------------- closed forms


@pytest.mark.parametrize("name", HANDS)
def test_the_error_decays_as_its_own_oscillator(name: str, rng: np.random.Generator) -> None:
    """The law e'' + 2 zeta sqrt(k) e' + k e = 0 to 1e-8, with e'' by Pinocchio; for targets that move in any way."""
    one, frame = robot(name), HANDS[name]
    for _ in range(10):
        state, k, zeta = drawn(one, rng), float(rng.uniform(1.0, 300.0)), float(rng.uniform(0.0, 2.0))
        d, law = 2.0 * zeta * math.sqrt(k), {"gain": k, "damping_ratio": zeta}
        model, data = one.model, one.model.createData()

        x, dx, ddx = rng.normal(size=(3, 3))
        terms = ComTask(Reference(x, dx, ddx), **law).terms(state, 0.0)
        pin.centerOfMass(model, data, state.q, state.v, least(terms))
        left = (ddx - data.acom[0]) + d * (dx - data.vcom[0]) + k * (x - data.com[0])
        assert np.abs(range_of(terms.A).T @ left).max() < 1e-8 * k
        full = range_of(terms.A).shape[1] == 3

        X, dX, ddX = pin.SE3(turn(rng), rng.normal(size=3)), rng.normal(size=6), rng.normal(size=6)
        terms = FrameTask(frame, Reference(X, dX, ddX), offset=OFFSET, **law).terms(state, 0.0)
        R, v, dv = frame_at(state, frame, least(terms))
        e = np.concatenate([X.translation - state.frame(frame, OFFSET).X_WF.translation, pin.log3(X.rotation @ R.T)])
        assert np.abs(range_of(terms.A, 1e-6).T @ ((ddX - dv) + d * (dX - v) + k * e)).max() < 1e-8 * k
        assert abs(np.trace(X.rotation.T @ pin.exp3(e[3:]) @ R) - 3.0) < 1e-12  # e turns R to its target

        q, dq, ddq = drawn(one, rng).q, *rng.normal(size=(2, one.nv))
        a = least(PostureTask(Reference(q, dq, ddq), **law).terms(state, 0.0))
        e = np.asarray(pin.difference(model, state.q, q))
        assert np.abs(((ddq - a) + d * (dq - state.v) + k * e)[one.actuated]).max() < 1e-8 * k
        assert full == (name != "leg")  # which moves in a plane: what it cannot do is left out


def test_the_momentum_decays_exponentially(rng: np.random.Generator) -> None:
    """The law h' = h*' + k (h* - h), with h' by Pinocchio's own time derivative."""
    talos = robot("talos")
    for _ in range(10):
        state, h, dh, k = drawn(talos, rng), *rng.normal(size=(2, 6)), float(rng.uniform(1.0, 30.0))
        a = least(MomentumTask(Reference(h, dh), linear_cost=1.0, gain=k).terms(state, 0.0))
        data = talos.model.createData()
        rate = pin.computeCentroidalMomentumTimeVariation(talos.model, data, state.q, state.v, a).vector
        assert np.abs((dh - rate) + k * (h - data.hg.vector)).max() < 1e-8 * k * max(1.0, np.abs(data.hg.vector).max())


def test_the_energy_of_a_wrong_orientation_falls_at_the_rate_of_damping(rng: np.random.Generator) -> None:
    """d/dt (k/2 angle^2 + 1/2 |w* - w|^2) = -2 zeta sqrt(k) |w* - w|^2, about any axes, for targets that turn too."""
    talos, frame, h = robot("talos"), HANDS["talos"], 1e-3
    for _ in range(10):
        state, k, zeta = drawn(talos, rng), float(rng.uniform(1.0, 100.0)), float(rng.uniform(0.0, 2.0))
        R0, w, dw = turn(rng, 1.5) @ state.frame(frame).X_WF.rotation, rng.normal(size=3), rng.normal(size=3)
        task = FrameTask(frame, Reference(R0, w, dw), gain=k, damping_ratio=zeta)
        a = least(task.terms(state, 0.0))

        def energy(
            s: float, state: rbd.State = state, a: Array = a, k: float = k, goal: tuple[Array, ...] = (R0, w, dw)
        ) -> float:
            """At a time, with the target and the robot on their ways to second order."""
            R0, w, dw = goal
            at = rbd.State(talos, pin.integrate(talos.model, state.q, s * state.v + 0.5 * s * s * a), state.v + s * a)
            wanted = pin.exp3(s * w + 0.5 * s * s * dw) @ R0
            seen = at.frame(frame)
            angle, off = np.linalg.norm(pin.log3(wanted @ seen.X_WF.rotation.T)), w + s * dw - seen.v[3:]
            return float(0.5 * k * angle**2 + 0.5 * off @ off)

        rate = np.array([1.0, -8.0, 8.0, -1.0]) @ [energy(s) for s in (-2 * h, -h, h, 2 * h)] / (12.0 * h)
        off = w - state.frame(frame).v[3:]
        assert abs(rate + 2.0 * zeta * math.sqrt(k) * off @ off) < 1e-6 * max(1.0, k)


def test_joints_with_several_axes_and_without_ends_follow_a_posture(rng: np.random.Generator) -> None:
    """The error of a ball joint falls as that of a frame; a continuous hinge goes the short way round, as its law says."""
    model = pin.Model()
    hip = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "hip")
    model.appendBodyToJoint(hip, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    wheel = model.addJoint(hip, pin.JointModelRUBZ(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5])), "wheel")
    model.appendBodyToJoint(wheel, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    one, k, zeta, h = CheckedModel(model, name="ball"), 20.0, 0.4, 1e-3
    costs = PostureTask(one_at(one, rng), cost={"wheel": 3.0}).terms(one_at(one, rng), 0.0).cost
    assert costs.tolist() == [1.0, 1.0, 1.0, 3.0]
    for _ in range(10):
        state, goal, dv, da = one_at(one, rng), one_at(one, rng), *rng.normal(size=(2, 4))
        a = least(PostureTask(Reference(goal, dv, da), gain=k, damping_ratio=zeta).terms(state, 0.0))
        way = math.remainder(wheel_angle(goal.q) - wheel_angle(state.q), 2.0 * math.pi)
        assert abs(a[3] - (da[3] + k * way + 2.0 * zeta * math.sqrt(k) * (dv[3] - state.v[3]))) < 1e-9

        def energy(
            s: float, state: rbd.State = state, goal: rbd.State = goal, a: Array = a, dv: Array = dv, da: Array = da
        ) -> float:
            """Of the ball joint at a time, with the target and the joint on their ways to second order."""
            to = pin.integrate(model, goal.q, s * dv + 0.5 * s * s * da)
            at = pin.integrate(model, state.q, s * state.v + 0.5 * s * s * a)
            e, off = pin.difference(model, at, to)[:3], (dv + s * da - state.v - s * a)[:3]
            return float(0.5 * k * e @ e + 0.5 * off @ off)

        rate = np.array([1.0, -8.0, 8.0, -1.0]) @ [energy(s) for s in (-2 * h, -h, h, 2 * h)] / (12.0 * h)
        off = (dv - state.v)[:3]
        assert abs(rate + 2.0 * zeta * math.sqrt(k) * off @ off) < 1e-6 * k


def one_at(one: CheckedModel, rng: np.random.Generator) -> rbd.State:
    """Some pose, its ball joint within half a turn of any other such pose, and some velocity."""
    q = pin.integrate(one.model, pin.neutral(one.model), np.array([0.8, 0.8, 0.8, 3.0]) * rng.uniform(-1.0, 1.0, 4))
    return rbd.State(one, q, rng.normal(size=one.nv))


def wheel_angle(q: Array) -> float:
    """Of the wheel above, by its cosine and sine."""
    return math.atan2(q[5], q[4])


def decay(e0: Array, de0: Array, k: float, zeta: float, t: Array) -> Array:
    """The solution of e'' + 2 zeta sqrt(k) e' + k e = 0, shape (n, m)."""
    w = math.sqrt(k)
    a, b = np.roots([1.0, 2.0 * zeta * w, k]) if zeta != 1.0 else (-w, -w)
    if zeta == 1.0:
        return np.asarray(np.exp(-w * t)[:, None] * (e0 + t[:, None] * (de0 + w * e0)))
    one = (de0 - b * e0) / (a - b)
    return np.asarray((np.exp(a * t)[:, None] * one + np.exp(b * t)[:, None] * (e0 - one)).real)


COST = 1e6
"""So much more than the regularisation of a step that a task alone is met to 1e-9."""


@pytest.mark.parametrize("zeta", [0.3, 1.0, 1.5])
def test_a_posture_is_reached_as_the_closed_form_says(zeta: float) -> None:
    """An arm under `step` alone, integrated to fourth order; with its torque limits off, as they would slow it down."""
    panda = robot("panda")
    start = panda.at(panda.at().q, np.linspace(-0.4, 0.4, panda.nv))
    goal = start.q + np.linspace(0.2, -0.1, panda.nv)
    task = PostureTask(goal, gain=60.0, damping_ratio=zeta, cost=COST)
    went = run(start, task, 0.2)
    expected = decay(goal - start.q, -start.v, 60.0, zeta, went.t)
    assert np.abs(goal - went.q - expected).max() < 1e-6 * np.abs(expected).max()


def run(start: rbd.State, task: Task, duration: float, h: float = 4e-3) -> rbd.Trajectory:
    """A motion under one task, with nothing that limits it."""
    free = rbd.control.Limits(torque=None, position=False, velocity=False)
    return rbd.simulate(
        start, [], duration=duration, step=h, integrator=rbd.RungeKutta4(), progress=False,
        controller=lambda state, t: step(state, [task], t=t, limits=free).tau,
    )  # fmt: skip


def test_an_orientation_about_a_fixed_axis_is_reached_as_the_closed_form_says() -> None:
    """Both hinges of a double pendulum are parallel, so that the angle of its tip obeys the law."""
    pendulum = rbd.load_robot("double_pendulum_simple", root="fixed")
    frame = pendulum.links()[-1]
    start = pendulum.at(np.array([0.4, -0.9]), np.array([0.5, 1.0]))
    task = FrameTask(
        frame, start.frame(frame).X_WF.rotation @ pin.exp3(np.array([1.3, 0.0, 0.0])), gain=40.0, orientation_cost=COST
    )
    went = run(start, task, 0.3)
    target: Any = task.target
    seen = [rbd.State(pendulum, q).frame(frame).X_WF.rotation for q in went.q]
    errors = np.array([pin.log3(target.value.R @ R.T) for R in seen])
    axis = errors[0] / np.linalg.norm(errors[0])
    rate = -axis @ start.frame(frame).v[3:]
    expected = decay(np.array([errors[0] @ axis]), np.array([rate]), 40.0, 1.0, went.t)
    assert np.abs(errors - expected * axis).max() < 1e-6


def test_feed_forward_follows_a_moving_target() -> None:
    """An arm follows a swing to the order of the integrator; without feed-forward it lags as linear theory says."""
    panda, w, k = robot("panda"), 5.0, 100.0
    q0, size = panda.at().q, np.linspace(0.1, 0.3, panda.nv)

    def swing(t: float) -> Reference:
        return Reference(q0 + size * math.sin(w * t), w * size * math.cos(w * t), -w * w * size * math.sin(w * t))

    start = panda.at(q0, swing(0.0).velocity)
    errors = []
    for h in (0.02, 0.01):
        went = run(start, PostureTask(swing, gain=k, cost=1e8), 0.4, h)
        errors.append(np.abs(went.q - np.array([swing(t).value for t in went.t])).max())
    assert errors[0] < 1e-4 and 10.0 < errors[0] / errors[1] < 25.0
    # Without: e'' + 2 sqrt(k) e' + k e = x*'' + 2 sqrt(k) x*', so e = Im(E exp(i w t)) and what decays.
    lags = run(start, PostureTask(lambda t: swing(t).value, gain=k, cost=COST), 0.4, 0.01)
    E = (-w * w + 2j * math.sqrt(k) * w) / (k - w * w + 2j * math.sqrt(k) * w)
    expected = (E * np.exp(1j * w * lags.t)).imag + decay(np.array([-E.imag]), np.array([-(E * 1j * w).imag]), k, 1.0, lags.t)[
        :, 0
    ]
    lag = np.array([swing(t).value for t in lags.t]) - lags.q
    assert np.abs(lag - np.outer(expected, size)).max() < 1e-4 and np.abs(lag).max() > 0.05


# ------------------------------------------------------------------------------------------------- tasks under contact


@pytest.fixture
def standing(talos: rbd.Robot, rng: np.random.Generator) -> tuple[rbd.State, list[Any]]:
    """Talos on two soles, moving a little."""
    soles, state = talos.soles(friction=0.7), talos.standing()
    v = 0.05 * rng.normal(size=talos.nv)
    return rbd.mechanism.project_velocity(state.with_velocity(v), talos.soles(friction=None)), soles


def test_each_task_alone_is_reached_on_two_soles(standing: tuple[rbd.State, list[Any]], talos: rbd.Robot) -> None:
    """The law of the centre of mass, of a hand, of the arms and of the momentum holds in the answer of `step`."""
    state, soles = standing
    hand = "gripper_left_joint"
    seen = state.frame(hand, OFFSET)
    x = state.com + [0.01, 0.0, -0.01]
    X = pin.SE3(pin.exp3(np.array([0.1, 0.2, -0.1])) @ seen.X_WF.rotation, seen.X_WF.translation + 0.02)
    arms = [name for name in talos.actuated_names if "arm" in name]
    data = talos.model.createData()

    a = step(state, [ComTask(x, gain=30.0, cost=COST)], soles).a
    pin.centerOfMass(talos.model, data, state.q, state.v, a)
    left = data.acom[0] - 30.0 * (x - data.com[0]) + 2.0 * math.sqrt(30.0) * data.vcom[0]
    assert np.abs(left).max() < 1e-6

    a = step(state, [FrameTask(hand, X, offset=OFFSET, gain=30.0, position_cost=COST, orientation_cost=COST)], soles).a
    R, v, dv = frame_at(state, hand, a)
    e = np.concatenate([X.translation - seen.X_WF.translation, pin.log3(X.rotation @ R.T)])
    assert np.abs(dv - 30.0 * e + 2.0 * math.sqrt(30.0) * v).max() < 1e-6

    bent = rbd.State(talos, pin.integrate(talos.model, state.q, 0.1 * np.ones(talos.nv)))
    a = step(state, [PostureTask(bent, joints=arms, gain=30.0, cost=COST)], soles).a
    at = np.array([talos.joints[name].v.start for name in arms])
    assert np.abs(a[at] - 30.0 * 0.1 + 2.0 * math.sqrt(30.0) * state.v[at]).max() < 1e-6

    found = step(state, [MomentumTask(linear_cost=COST, angular_cost=COST, gain=5.0)], soles)
    rate = pin.computeCentroidalMomentumTimeVariation(talos.model, data, state.q, state.v, found.a).vector
    assert np.abs(rate + 5.0 * data.hg.vector).max() < 1e-6 * talos.mass
    about = sum(wrench_about(found, c, state) for c in soles) + np.concatenate([talos.mass * talos.gravity, np.zeros(3)])
    assert np.abs(about - rate).max() < 1e-8 * talos.mass * 9.81


def wrench_about(found: rbd.Actuation, contact: Any, state: rbd.State) -> Array:
    """Wrench of a contact on the robot, about the centre of mass, in world axes."""
    patch = contact.rows(state).patch
    wrench = np.asarray(found.forces[contact.name])
    force, moment = patch.axes @ wrench[:3], patch.axes @ wrench[3:]
    return np.concatenate([force, moment + np.cross(patch.point - state.com, force)])


def test_two_feet_press_against_each_other_as_wanted(talos: rbd.Robot) -> None:
    """A force that the contacts can give is given, one of a component too; the others balance it."""
    state, soles = talos.standing(), talos.soles(friction=0.7)
    left, right = (c.rows(state).patch.axes for c in soles)
    posture = PostureTask(state)
    found = step(state, [posture, ForceTask("left_sole", [0.0, -60.0, 430.0], cost=COST)], soles)
    assert np.abs(left @ found.forces["left_sole"][:3] - [0.0, -60.0, 430.0]).max() < 1e-4
    com = state.centroidal()[0][:3] @ found.a  # what is left accelerates the mass
    total = left @ found.forces["left_sole"][:3] + right @ found.forces["right_sole"][:3]
    assert np.abs(total + talos.mass * talos.gravity - com).max() < 1e-8 * talos.mass * 9.81
    sway = step(state, [posture, ForceTask("left_sole", lambda t: [1e3 * t, 0.0, 0.0], cost=[0.0, COST, 0.0])], soles, t=0.02)
    assert sway.missed["force of left_sole"].shape == (1,)
    assert np.abs((left @ sway.forces["left_sole"][:3])[1]) < 1e-4
    wrench = np.array([10.0, -20.0, 400.0, 3.0, -2.0, 1.0])
    turned = step(state, [posture, ForceTask("left_sole", wrench, cost=COST)], soles).forces["left_sole"]
    assert np.abs(np.concatenate([left @ turned[:3], left @ turned[3:]]) - wrench).max() < 1e-4


@pytest.mark.parametrize("cost", [1.0, 1e4])
def test_a_foot_that_should_pull_is_told_as_missed(talos: rbd.Robot, cost: float) -> None:
    """No sole pulls: the nearest force is none, and what is missed is all that was wanted, over the mass."""
    state, soles = talos.standing(), talos.soles(friction=0.7)
    found = step(state, [ForceTask("left_sole", [0.0, 0.0, -50.0], cost=[0.0, 0.0, cost])], soles)
    assert abs(found.forces["left_sole"][2]) < 1e-9
    assert abs(found.missed["force of left_sole"][0] + 50.0 / talos.mass) < 1e-9


# --------------------------------------------------------------------------------------------- what a task can be given


def same(one: TaskTerms, other: TaskTerms) -> bool:
    """Whether two tasks have the same terms, to rounding."""
    return one.A.shape == other.A.shape and all(
        np.abs(getattr(one, what) - getattr(other, what)).max(initial=0.0) < 1e-12 for what in ("A", "wanted", "cost")
    )


def test_targets_may_be_given_in_many_ways(rng: np.random.Generator) -> None:
    """A pose as pin.SE3 or a matrix, a reference, a function of time; positions and orientations are parts of it."""
    talos = robot("talos")
    state, X, frame = drawn(talos, rng), pin.SE3(turn(rng), rng.normal(size=3)), HANDS["talos"]
    rates = rng.normal(size=(2, 6))
    one = FrameTask(frame, X).terms(state, 0.0)
    for target in (X.homogeneous, X.homogeneous.tolist(), Reference(X), lambda t: X, lambda t: Reference(X.homogeneous)):
        assert same(FrameTask(frame, target).terms(state, 0.0), one)
    whole = FrameTask(frame, Reference(X, *rates)).terms(state, 0.0)
    place = FrameTask(frame, Reference(X.translation, *rates[:, :3])).terms(state, 0.0)
    turned = FrameTask(frame, lambda t: Reference(X.rotation, *rates[:, 3:])).terms(state, 0.0)
    assert same(place, TaskTerms("part", whole.A[:3], whole.wanted[:3], whole.cost[:3]))
    assert same(turned, TaskTerms("part", whole.A[3:], whole.wanted[3:], whole.cost[3:]))
    assert same(FrameTask(frame, Reference(X, *rates), orientation_cost=0.0).terms(state, 0.0), place)
    other = drawn(talos, rng)
    held = FrameTask(frame, other.frame(frame, OFFSET).X_WF, offset=OFFSET).terms(state, 0.0)
    for target in (other, Reference(other), lambda t: other):
        assert same(FrameTask(frame, target, offset=OFFSET).terms(state, 0.0), held)
        assert same(ComTask(target).terms(state, 0.0), ComTask(other.com).terms(state, 0.0))
    posture = PostureTask(state.q).terms(state, 0.0)
    for target in (state, Reference(state), lambda t: state, lambda t: Reference(state.q, np.zeros(talos.nv))):
        assert same(PostureTask(target).terms(state, 0.0), posture)
    moves = [np.array([math.sin(t), 0.0, 1.0]) for t in (0.0, 1.0)]
    follows = ComTask(lambda t: [math.sin(t), 0.0, 1.0])
    assert all(same(follows.terms(state, t), ComTask(x).terms(state, 0.0)) for t, x in zip((0.0, 1.0), moves, strict=True))


def test_rotations_are_told_from_reflections(rng: np.random.Generator) -> None:
    """Of any orientation: it is taken, its opposite is not."""
    for _ in range(30):
        R = turn(rng, float(rng.uniform(0.0, math.pi)))
        assert FrameTask("hand", R).name == "hand"
        for wrong in (-R, R * [1.0, 1.0, -1.0]):
            with pytest.raises(InputError, match="target of task 'hand' is no rotation"):
                FrameTask("hand", wrong)


def test_what_is_not_given_is_as_it_is_told(rng: np.random.Generator) -> None:
    """Gains of 100 1/s2, of 10 1/s for momenta, a critical damping ratio, costs of one."""
    talos = robot("talos")
    state, goal, frame = drawn(talos, rng), drawn(talos, rng), HANDS["talos"]
    law = {"gain": 100.0, "damping_ratio": 1.0}
    for one, same_as in (
        (ComTask(goal), ComTask(goal, cost=1.0, name="com", **law)),
        (FrameTask(frame, goal), FrameTask(frame, goal, position_cost=1.0, orientation_cost=1.0, axes="world", **law)),
        (PostureTask(goal), PostureTask(goal, cost=1.0, name="posture", **law)),
        (MomentumTask(), MomentumTask(np.zeros(6), linear_cost=0.0, angular_cost=1.0, gain=10.0)),
    ):
        assert one.name == same_as.name and same(one.terms(state, 0.0), same_as.terms(state, 0.0))


def test_costs_in_the_axes_of_the_frame(rng: np.random.Generator) -> None:
    """Equal costs weigh the same in all axes; others weigh what is missed along the frame's own."""
    talos = robot("talos")
    state, X, frame = drawn(talos, rng), pin.SE3(turn(rng), rng.normal(size=3)), HANDS["talos"]
    world, own = (FrameTask(frame, X, axes=axes).terms(state, 0.0) for axes in ("world", "frame"))
    assert np.abs(world.A.T @ world.A - own.A.T @ own.A).max() < 1e-12
    assert np.abs(world.A.T @ world.wanted - own.A.T @ own.wanted).max() < 1e-9
    along = FrameTask(frame, X, axes="frame", position_cost=[0.0, 2.0, 0.0], orientation_cost=0.0).terms(state, 0.0)
    y = state.frame(frame).X_WF.rotation[:, 1]
    assert np.abs(along.A - y @ world.A[:3]).max() < 1e-12 and abs(along.wanted[0] - y @ world.wanted[:3]) < 1e-10
    assert along.cost.tolist() == [2.0]


def test_costs_of_a_posture_by_joint() -> None:
    """By number, by name and in a list; of cost zero no row is left, and of a task none."""
    solo = robot("solo12")
    state = solo.standing()
    every = PostureTask(state).terms(state, 0.0)
    assert every.A is solo.actuation and every.cost.tolist() == [1.0] * 12
    named = PostureTask(state, cost={"FL_KFE": 4.0, "HR_KFE": 0.0}).terms(state, 0.0)
    assert len(named.A) == 11 and sorted(named.cost)[-2:] == [1.0, 4.0]
    assert named.A[named.cost == 4.0, solo.joints["FL_KFE"].v.start] == 1.0
    some = PostureTask(state, joints=["HR_KFE", "FL_HAA"], cost=[1.0, 3.0]).terms(state, 0.0)
    assert [int(row.argmax()) for row in some.A] == [solo.joints[name].v.start for name in ("HR_KFE", "FL_HAA")]
    assert some.cost.tolist() == [1.0, 3.0]
    for task in (PostureTask(state, cost=0.0), ComTask(state.com, cost=0.0), ForceTask("front_left", np.zeros(3), cost=0.0)):
        assert task.terms(state, 0.0).A.shape[0] == 0
    idle = step(state, [PostureTask(state), ComTask(state.com, cost=0.0)], solo.feet(friction=0.7))
    assert idle.missed["com"].shape == (0,)


def test_a_task_keeps_what_it_was_given(rng: np.random.Generator) -> None:
    """Arrays that change afterwards change no task; one that was changed by `replace`, pickled or copied is as it was."""
    talos = robot("talos")
    state, frame = drawn(talos, rng), HANDS["talos"]
    place, q, wrench, cost = state.com.copy(), state.q.copy(), np.ones(6), np.ones(3)
    tasks: list[Any] = [
        ComTask(Reference(place, np.ones(3), np.ones(3)), cost=cost),
        FrameTask(frame, Reference(place, np.ones(3))),
        FrameTask(frame, Reference(np.eye(3), np.ones(3))),
        FrameTask(frame, np.eye(4), axes="frame", offset=place),
        PostureTask(q, joints=["torso_1_joint"], cost=[2.0]),
        MomentumTask(Reference(wrench, wrench)),
        ForceTask("left_sole", wrench, cost=np.ones(6)),
    ]
    before = [task.terms(state, 0.0) for task in tasks]
    for array in (place, q, wrench, cost):
        array += 0.1
    for task, terms in zip(tasks, before, strict=True):
        for other in (task, replace(task, name="x"), pickle.loads(pickle.dumps(task)), copy.deepcopy(task)):
            assert same(other.terms(state, 0.0), terms)
    stiff = replace(tasks[0], gain=400.0).terms(state, 0.0).wanted
    assert np.abs(stiff - replace(tasks[0], gain=400.0, name="y").terms(state, 0.0).wanted).max() == 0.0
    assert np.abs(stiff - before[0].wanted).max() > 1.0


# ---------------------------------------------------------------------------------------------------------- bad input

BAD: dict[str, Callable[[], Any]] = {
    r"target of task 'com' has shape \(2,\); expected \(3,\)": lambda: ComTask([0.0, 1.0]),
    r"target of task 'com' is not finite at \(1,\): nan": lambda: ComTask([0.0, np.nan, 1.0]),
    r"velocity of the target of task 'com' has shape \(6,\)": lambda: ComTask(Reference(np.zeros(3), np.zeros(6))),
    r"acceleration of the target of task 'com' is not finite": lambda: ComTask(
        Reference(np.zeros(3), None, [0.0, 0.0, np.inf])
    ),
    r"cost of task 'com' has shape \(2,\); expected one number, or \(3,\), one of each axis": lambda: ComTask(
        np.zeros(3), cost=[1.0, 1.0]
    ),
    r"cost of task 'com' is \[1.0, -1.0, 1.0\]; expected numbers from 0": lambda: ComTask(np.zeros(3), cost=[1.0, -1.0, 1.0]),
    r"cost of task 'com' is nan; expected": lambda: ComTask(np.zeros(3), cost=np.nan),
    r"gain of task 'com' is -1.0; expected a number from 0": lambda: ComTask(np.zeros(3), gain=-1.0),
    r"gain of task 'com' is nan": lambda: ComTask(np.zeros(3), gain=np.nan),
    r"damping_ratio of task 'com' is -0.5": lambda: ComTask(np.zeros(3), damping_ratio=-0.5),
    r"damping_ratio of task 'com' is inf": lambda: ComTask(np.zeros(3), damping_ratio=np.inf),
    r"the name of a task is 3; expected a text": lambda: ComTask(np.zeros(3), name=3),  # type: ignore[arg-type]
    r"frame of a task is None; expected the name of a frame": lambda: FrameTask(None, np.eye(4)),  # type: ignore[arg-type]
    r"frame of a task is ''; expected the name of a frame": lambda: FrameTask("", np.eye(4), name="hand"),
    r"target of task 'hand' is no rigid placement": lambda: FrameTask("hand", np.diag([1.0, 1.0, -1.0, 1.0])),
    r"target of task 'foot' is no rigid placement": lambda: FrameTask("foot", pin.SE3(1.01 * np.eye(3), np.zeros(3))),
    r"target of task 'head' is no rotation": lambda: FrameTask("head", np.diag([1.0, 1.0, -1.0])),
    r"target of task 'toe' has shape \(7,\); expected a pose": lambda: FrameTask("toe", np.ones(7)),
    r"target of task 'tip' is no rigid placement": lambda: FrameTask("tip", pin.SE3(np.eye(3), np.array([0.0, np.nan, 0.0]))),
    r"velocity of the target of task 'hand' has shape \(6,\); expected \(3,\)": lambda: FrameTask(
        "hand", Reference(np.zeros(3), np.zeros(6))
    ),
    r"acceleration of the target of task 'hand' has shape \(3,\); expected \(6,\)": lambda: FrameTask(
        "hand", Reference(pin.SE3.Identity(), np.zeros(6), np.zeros(3))
    ),
    r"position_cost of task 'hand' has shape \(6,\)": lambda: FrameTask("hand", np.eye(4), position_cost=np.ones(6)),
    r"orientation_cost of task 'hand' is -1": lambda: FrameTask("hand", np.eye(4), orientation_cost=-1.0),
    r"axes of task 'hand' is 'body'; .*Expected one of world, frame": lambda: FrameTask("hand", np.eye(4), axes="body"),
    r"axes of task 'hand' is array": lambda: FrameTask("hand", np.eye(4), axes=np.ones(2)),  # type: ignore[arg-type]
    r"gain of task 'hand' is -1": lambda: FrameTask("hand", np.eye(4), gain=-1.0),
    r"gain of task 'posture' is -1": lambda: PostureTask(np.zeros(19), gain=-1.0),
    r"offset of task 'hand' has shape \(2,\)": lambda: FrameTask("hand", np.eye(4), offset=[0.0, 1.0]),
    r"joints of task 'posture' are 'knee'; expected a list of names": lambda: PostureTask(np.zeros(19), joints="knee"),
    r"joints of task 'posture' are 5": lambda: PostureTask(np.zeros(19), joints=5),  # type: ignore[arg-type]
    r"joints of task 'posture' are \['a', 'a'\]": lambda: PostureTask(np.zeros(19), joints=["a", "a"]),
    r"cost of task 'posture' of joint 'a' is -1": lambda: PostureTask(np.zeros(19), cost={"a": -1.0}),
    r"cost of task 'posture' has shape \(2, 2\)": lambda: PostureTask(np.zeros(19), cost=np.ones((2, 2))),
    r"target of task 'posture' is not finite": lambda: PostureTask(np.full(19, np.nan)),
    r"target of task 'momentum' has shape \(3,\); expected \(6,\)": lambda: MomentumTask(np.zeros(3)),
    r"target of task 'momentum' has an acceleration": lambda: MomentumTask(Reference(np.zeros(6), None, np.zeros(6))),
    r"angular_cost of task 'momentum' is -1": lambda: MomentumTask(angular_cost=-1.0),
    r"gain of task 'momentum' is -1": lambda: MomentumTask(gain=-1),
    r"contact of a force task is ''": lambda: ForceTask("", np.zeros(3)),
    r"target of task 'force of left' has shape \(2,\); expected a force \(3,\) or a wrench \(6,\)": lambda: ForceTask(
        "left", np.zeros(2)
    ),
    r"target of task 'force of left' has a velocity": lambda: ForceTask("left", Reference(np.zeros(3), np.zeros(3))),
    r"cost of task 'force of left' has shape \(6,\); expected one number, or \(3,\)": lambda: ForceTask(
        "left", np.zeros(3), cost=np.ones(6)
    ),
    r"cost of task 'force of left' has shape \(4,\)": lambda: ForceTask("left", np.zeros(3), cost=np.ones(4)),
    r"the terms of task 'own' have shapes A \(1, 4\), wanted \(2,\)": lambda: TaskTerms("own", np.ones((1, 4)), [1, 2], [1.0]),  # type: ignore[arg-type]
    r"wanted of task 'own' is not finite": lambda: TaskTerms("own", np.ones((1, 4)), np.array([np.nan]), np.ones(1)),
    r"cost of task 'own' is \[1.0, -1.0\]; expected numbers from 0": lambda: TaskTerms(
        "own", np.ones((2, 4)), np.ones(2), np.array([1.0, -1.0])
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_input_is_refused_where_a_task_is_made(message: str) -> None:
    """With the task's name, what was given, and what was expected."""
    with pytest.raises(InputError, match=message):
        BAD[message]()


def test_names_are_checked_where_the_robot_is_known(talos: rbd.Robot) -> None:
    """At construction if the target is a State; else by `check`, as a controller asks it, and at the first use."""
    state = talos.standing()
    hand = FrameTask("gripper_lef_joint", np.eye(4))
    with pytest.raises(FrameNotFound, match="no frame 'gripper_lef_joint' in .*nearest: 'gripper_left_joint'"):
        hand.check(talos)
    with pytest.raises(FrameNotFound, match="gripper_left_joint"):
        hand.terms(state, 0.0)
    with pytest.raises(FrameNotFound, match="gripper_left_joint"):
        FrameTask("gripper_lef_joint", state)
    with pytest.raises(JointNotFound, match="no joint 'torso_1_join' in .*nearest: 'torso_1_joint'"):
        PostureTask(state, joints=["torso_1_join"])
    with pytest.raises(JointNotFound, match="cost of task 'posture' has joint 'torso_1_join'; nearest: 'torso_1_joint'"):
        PostureTask(state, cost={"torso_1_join": 1.0})
    with pytest.raises(JointNotFound, match="joint 'root_joint' of task 'posture' has no motor"):
        PostureTask(state, joints=["root_joint"])
    with pytest.raises(
        InputError, match=r"cost of task 'posture' has shape \(3,\); expected one number, or \(32,\), one of each joint"
    ):
        PostureTask(state, cost=np.ones(3))
    with pytest.raises(InputError, match=r"target of task 'posture': q of .* has shape \(19,\); expected \(39,\)"):
        PostureTask(np.zeros(19)).check(talos)
    with pytest.raises(InputError, match="target of task 'posture' is a state of solo12; expected one of talos"):
        PostureTask(robot("solo12").standing()).terms(state, 0.0)
    again = rbd.load_robot("talos").standing()  # the same robot, loaded once more
    assert same(PostureTask(again).terms(state, 0.0), PostureTask(state).terms(state, 0.0))
    with pytest.raises(InputError, match=r"velocity of the target of task 'posture' has shape \(32,\); expected \(38,\)"):
        PostureTask(Reference(state, np.zeros(32)))
    for bad in (3.0, talos, None):
        with pytest.raises(InputError, match="a State of a robot was expected"):
            ComTask(np.zeros(3)).terms(bad, 0.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (ComTask(lambda t: [t]), r"target of task 'com' at t = 0.25 s has shape \(1,\)"),
        (ComTask(lambda t: [np.nan, t, t]), "target of task 'com' at t = 0.25 s is not finite"),
        (ComTask(lambda t: 1 / 0), "the function that is the target of task 'com' at t = 0.25 s raised ZeroDivisionError"),
        (
            FrameTask("base_link", lambda t: np.full((4, 4), t)),
            "target of task 'base_link' at t = 0.25 s is no rigid placement",
        ),
        (
            FrameTask("base_link", lambda t: Reference(np.zeros(3), [t])),
            "velocity of the target of task 'base_link' at t = 0.25 s",
        ),
        (PostureTask(lambda t: [t]), r"target of task 'posture' at t = 0.25 s: q of solo12 has shape \(1,\)"),
        (MomentumTask(lambda t: [t]), r"target of task 'momentum' at t = 0.25 s has shape \(1,\)"),
        (ForceTask("a", lambda t: [t]), r"target of task 'force of a' at t = 0.25 s has shape \(1,\)"),
        (ForceTask("a", lambda t: np.zeros(6), cost=np.ones(3)), r"cost of task 'force of a' has shape \(3,\)"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_what_a_function_of_time_gives_is_checked(task: Task, message: str) -> None:
    """The message says at what time; an error of the function itself is the cause."""
    with pytest.raises(InputError, match=message):
        task.terms(robot("solo12").standing(), 0.25)


def test_lists_of_tasks_are_checked(talos: rbd.Robot) -> None:
    """One task in place of a list, what is none, two of one name, and names that the robot does not have."""
    com = ComTask(np.zeros(3))
    calm = MomentumTask()
    assert checked_tasks([com, calm], talos) == (com, calm) and checked_tasks(()) == ()
    assert robot_of([com, calm]) is None and robot_of([com, PostureTask(talos.standing())]) is talos
    for bad in (com, "com", 3, None):
        with pytest.raises(InputError, match="tasks is .*; expected a list"):
            checked_tasks(bad)  # type: ignore[arg-type]
    for each in (ComTask, None, "com", talos.soles()[0]):
        with pytest.raises(InputError, match="is no task: it wants a name and terms"):
            checked_tasks([com, each])  # type: ignore[list-item]
    with pytest.raises(DuplicateName, match="two tasks are named 'com'"):
        checked_tasks([com, ComTask(np.ones(3))])
    with pytest.raises(FrameNotFound, match="nearest: 'left_sole_link'"):
        checked_tasks([com, FrameTask("left_sole_lin", np.eye(4))], talos)
    with pytest.raises(FrameNotFound, match="nearest: 'left_sole_link'"):  # the posture knows the robot
        WholeBodyController([PostureTask(talos.standing()), FrameTask("left_sole_lin", np.eye(4))])
