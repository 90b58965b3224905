"""Controllers with memory: what they are told, once a step; what touches; torques that are held between samples."""

from __future__ import annotations

import copy
import itertools
import pickle

import numpy as np
import pinocchio as pin
import pytest
from smooth_models import chain

import rbd
from rbd.control import AcceptedStep, ContactTouch, SteppedController, ZeroOrderHold
from rbd.model.checked_model import CheckedModel

INERTIA = 2.0
FIXED = [rbd.RungeKutta4(), rbd.TimeStepping(), rbd.TimeStepping(extrapolate=True)]
ALL = [*FIXED, rbd.DormandPrince8()]
DOWN = [0, 0, 0, 0, 0, 0, 1]


def rotor() -> CheckedModel:
    """One hinge about the vertical: no weight acts on it, so the acceleration is torque over inertia."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), INERTIA * np.eye(3)), pin.SE3.Identity())
    return CheckedModel(model, name="rotor")


class Counts:
    """A controller whose torque is the number of steps it was told of; it writes down all that happens."""

    def __init__(self) -> None:
        self.count, self.resets, self.log, self.steps = 0, 0, [], []

    def reset(self) -> None:
        """Write down that a motion starts."""
        self.count, self.log, self.steps = 0, [], []
        self.resets += 1

    def accepted(self, step: AcceptedStep) -> None:
        """Count."""
        self.count += 1
        self.log.append(("told", step.t))
        self.steps.append(step)

    def __call__(self, state: rbd.State, t: float) -> np.ndarray:
        """As many newton metres as steps."""
        self.log.append(("asked", t))
        return np.full(state.robot.nu, float(self.count))


class Watches:
    """A controller without torques that keeps the contacts of every step."""

    def __init__(self, *, reads: bool = True) -> None:
        self.reads = reads

    def reset(self) -> None:
        """Forget."""
        self.seen: list[dict[str, ContactTouch]] = []

    def accepted(self, step: AcceptedStep) -> None:
        """Read all that touches."""
        self.seen.append(dict(step.contacts) if self.reads else {})

    def __call__(self, state: rbd.State, t: float) -> np.ndarray:
        """No torque."""
        return np.zeros(state.robot.nu)


@pytest.mark.parametrize("integrator", FIXED, ids=repr)
def test_each_step_is_told_once_before_its_torques(integrator):
    """At every sample, the last included; no torque is asked for at a step's beginning before it is told."""
    counts = Counts()
    run = rbd.simulate(rbd.State(rotor(), [0.0]), duration=0.1, step=0.01, controller=counts, integrator=integrator)
    assert counts.resets == 1
    assert [step.t for step in counts.steps] == run.t.tolist()
    assert [step.h for step in counts.steps] == pytest.approx([0.01] * 11, rel=1e-9)
    assert all(np.array_equal(step.state.q, q) for step, q in zip(counts.steps, run.q, strict=True))
    assert np.array_equal(run.tau[:, 0], np.arange(1.0, 12.0)), "the recorded torque is that of a controller that was told"
    told = -np.inf
    for what, t in counts.log:
        assert t >= told - 1e-12
        told = t if what == "told" else told
    assert counts.log[0] == ("told", 0.0)


def test_an_adaptive_integrator_tells_the_steps_it_takes_and_none_that_it_rejects():
    """In order of time, from the start to the end; it ends a step at each of the controller's sample times."""
    arm = rbd.State(chain(2), np.array([1.0, 0.5]))
    counts = Counts()
    rbd.simulate(arm, duration=0.5, step=0.25, controller=counts, integrator=rbd.DormandPrince8())
    times = np.array([step.t for step in counts.steps])
    assert times[0] == 0.0 and times[-1] == 0.5 and (np.diff(times) > 0.0).all()
    lengths = np.array([step.h for step in counts.steps])
    assert (np.diff(times) <= lengths[:-1] + 1e-15).all()
    counts.every = 0.03
    rbd.simulate(arm, duration=0.5, step=0.25, controller=counts, integrator=rbd.DormandPrince8())
    sampled = np.array([step.t for step in counts.steps])
    for k in range(17):
        assert np.abs(sampled - 0.03 * k).min() < 1e-12
    assert (np.diff(sampled) > 1e-9).all()


def test_parts_up_to_an_impact_are_not_told():
    """A box that bounces divides its steps; they are told as wholes."""
    box = rbd.testing.box(mass=10.0)
    corner = rbd.PointContact("corner", "box", friction=0.6, on=0.0)
    counts = Counts()
    fall = rbd.simulate(
        rbd.State(box, [0, 0, 0.05, 0, 0, 0, 1]), [corner], duration=0.3, step=0.01, controller=counts, restitution=0.6
    )
    assert sum(event.kind == "touches" for event in fall.events) >= 2
    assert [step.t for step in counts.steps] == fall.t.tolist()


@pytest.mark.parametrize("integrator", ALL, ids=repr)
def test_held_torques_give_the_motion_of_the_sampled_system(integrator):
    """Accelerations are u / I with u = -k q - d v of the last sample: the closed form of the sampled system, to rounding.

    Samples of 0.06 s, steps and records of 0.02 s; of the adaptive integrator records every 0.04 s, between the samples too.
    """
    k, d, period = 8.0, 3.0, 0.06
    hold = ZeroOrderHold(lambda state, t: -k * state.q - d * state.v, period)
    step = 0.04 if isinstance(integrator, rbd.DormandPrince8) else 0.02
    run = rbd.simulate(rbd.State(rotor(), [0.7], [0.2]), duration=0.6, step=step, controller=hold, integrator=integrator)
    q, v, expected, torques = 0.7, 0.2, [], []
    for t in run.t:
        n = int(np.floor(t / period + 1e-9))
        q, v = 0.7, 0.2
        for _ in range(n):
            a = (-k * q - d * v) / INERTIA
            q, v = q + v * period + 0.5 * a * period**2, v + a * period
        s, a = t - n * period, (-k * q - d * v) / INERTIA
        expected.append(q + v * s + 0.5 * a * s**2)
        torques.append(INERTIA * a)
    assert np.abs(run.q[:, 0] - expected).max() < 1e-12
    assert np.abs(run.tau[:, 0] - torques).max() < 1e-10


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
@pytest.mark.parametrize("integrator", ALL, ids=repr)
@pytest.mark.parametrize("kind", ["held", "counter", "posture"])
def test_a_fresh_and_a_used_controller_give_the_same_bits(integrator, kind):
    """Also after a run that stopped in the middle, at another state."""
    robot = chain(2)
    start, other = rbd.State(robot, np.array([1.0, 0.5])), rbd.State(robot, np.array([-0.4, 0.2]), np.array([1.0, 2.0]))

    def made():
        if kind == "counter":
            return Counts()
        posture = rbd.control.HoldPosture(start)
        return posture if kind == "posture" else ZeroOrderHold(posture, 0.03)

    def run(state, controller):
        return rbd.simulate(state, duration=0.2, step=0.01, controller=controller, integrator=integrator, progress=False)

    used = made()
    run(other, used)
    fresh, again = run(start, made()), run(start, used)
    for what in ("q", "v", "a", "tau"):
        assert np.array_equal(getattr(fresh, what), getattr(again, what)), what


def test_a_held_controller_is_told_the_samples_alone():
    """`reset` and `accepted` reach what is held, once a period, with its length as that of a step."""
    counts = Counts()
    hold = ZeroOrderHold(counts, 0.04)
    run = rbd.simulate(rbd.State(rotor(), [0.0]), duration=0.12, step=0.01, controller=hold, integrator=rbd.RungeKutta4())
    assert counts.resets == 1
    assert [round(step.t, 9) for step in counts.steps] == [0.0, 0.04, 0.08, 0.12]
    assert {step.h for step in counts.steps} == {0.04}
    assert run.tau[:, 0].tolist() == [1.0] * 4 + [2.0] * 4 + [3.0] * 4 + [4.0]
    assert [what for what, _ in counts.log] == ["told", "asked"] * 4


def test_a_hold_outside_a_simulation_evaluates_its_controller():
    """Nothing is held before a step was told, and a call does not change that."""
    hold = ZeroOrderHold(lambda state, t: np.array([t]), 0.1)
    state = rbd.State(rotor(), [0.0])
    assert [hold(state, t)[0] for t in (0.0, 0.05, 0.02)] == [0.0, 0.05, 0.02]
    hold.accepted(AcceptedStep(state, 0.1, 0.01, {}))
    assert [hold(state, t)[0] for t in (0.1, 0.15, 0.3)] == [0.1, 0.1, 0.1]
    hold.accepted(AcceptedStep(state, 0.2 - 1e-12, 0.01, {}))
    assert hold(state, 0.2)[0] == pytest.approx(0.2)
    hold.reset()
    assert hold(state, 0.05)[0] == 0.05


def test_what_touches_is_told_with_the_forces_of_the_step_before():
    """A box falls flat on its face: no contact and no force; then contact at four corners, which carry its weight."""
    box = rbd.testing.box(mass=10.0)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
    watch = Watches()
    fall = rbd.simulate(rbd.State(box, [0, 0, 0.05, 0, 0, 0, 1]), [face], duration=0.2, step=0.01, controller=watch)
    (lands,) = {event.t for event in fall.events}
    for t, height, seen in zip(fall.t, fall.q[:, 2], watch.seen, strict=True):
        touch = seen["face"]
        assert touch.gaps == pytest.approx(np.full(4, height), abs=1e-12)
        assert touch.touches.tolist() == [t >= lands] * 4 and touch.touches.dtype == bool
        if t < lands:
            assert not touch.forces.any()
        if t > lands + 0.02:
            assert touch.forces.sum(axis=0) == pytest.approx([0.0, 0.0, 10.0 * 9.81], abs=1e-9)
    assert watch.seen[0]["face"].forces.shape == (4, 3)


def test_forces_are_in_world_axes():
    """On a slope of 30 degrees, which holds the box: they add up to its weight."""
    box = rbd.testing.box(mass=10.0)
    R = pin.rpy.rpyToMatrix(0.0, np.pi / 6.0, 0.0)
    slope = rbd.Ground(point=(0, 0, 0), normal=R[:, 2])
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.9, on=slope)
    watch = Watches()
    start = rbd.State(box, np.r_[np.zeros(3), pin.Quaternion(R).coeffs()])
    rbd.simulate(start, [face], duration=0.05, step=0.01, controller=watch)
    assert watch.seen[-1]["face"].forces.sum(axis=0) == pytest.approx([0.0, 0.0, 98.1], abs=1e-9)


def test_all_that_touches_is_told_shapes_by_their_links(talos):
    """Soles by corners, collision shapes by the names of their points; joint limits have no points."""
    state, watch = talos.standing(), Watches()
    given = [*talos.soles(0.7), rbd.CollisionContacts("shapes", talos, ground=["arm_left_7_link", "leg_left_6_link"])]
    limit = rbd.JointLimit("knee", "leg_left_4_joint")
    rbd.simulate(state, [*given, limit], duration=2e-3, step=1e-3, controller=watch)
    last = watch.seen[-1]
    assert list(last) == [c.name for c in given]
    assert last["left_sole"].names == () and len(last["left_sole"].gaps) == 4
    shapes = last["shapes"]
    assert len(shapes.names) == len(shapes.gaps) > 0
    assert all(name.startswith("leg_left_6_link") for name in shapes.names)
    only = rbd.CollisionContacts("arm", talos, ground=["arm_left_7_link"])
    rbd.simulate(state, [only], duration=1e-3, step=1e-3, controller=watch)
    assert watch.seen[-1]["arm"].gaps.shape == (0,) and watch.seen[-1]["arm"].forces.shape == (0, 3)


@pytest.mark.parametrize("integrator", [rbd.RungeKutta4(), rbd.DormandPrince8(), rbd.TimeStepping()], ids=repr)
def test_bilateral_contacts_always_touch(integrator):
    """Their gap is -inf; the forces that they told of carry the weight; loops have no points."""
    box = rbd.testing.box(mass=10.0)
    held = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=None)
    watch = Watches()
    rbd.simulate(rbd.State(box, DOWN), [held], duration=0.05, step=0.01, controller=watch, integrator=integrator)
    first, last = watch.seen[0]["face"], watch.seen[-1]["face"]
    assert first.touches.all() and (first.gaps == -np.inf).all() and not first.forces.any()
    assert last.forces.sum(axis=0) == pytest.approx([0.0, 0.0, 98.1], abs=1e-8)
    bars = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    rbd.simulate(bars.at("assembled"), bars.loops(), duration=0.02, step=0.01, controller=watch, integrator=integrator)
    assert watch.seen[-1] == {}


class Spoils(Watches):
    """Reads what touches, and writes over it."""

    def accepted(self, step: AcceptedStep) -> None:
        """Overwrite all arrays."""
        super().accepted(step)
        for touch in step.contacts.values():
            touch.gaps[:], touch.touches[:], touch.forces[:] = -1.0, False, 1e6


def test_reading_what_touches_does_not_change_the_motion(talos):
    """The same bits, whether a controller reads it or not, or writes over it."""
    state, soles = talos.standing(), talos.soles(0.7)
    q = state.q.copy()
    q[2] += 1e-3
    runs = [
        rbd.simulate(talos.at(q), soles, duration=0.03, step=1e-3, controller=controller, record_every=7)
        for controller in (Watches(), Watches(reads=False), Spoils())
    ]
    for run in runs[1:]:
        assert np.array_equal(runs[0].q, run.q) and np.array_equal(runs[0].a, run.a)


def test_an_unknown_contact_is_named():
    """A KeyError with the nearest name; `in` and `get` work as on any mapping; a copy has what was computed."""
    box = rbd.testing.box(mass=10.0)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
    counts = Counts()
    rbd.simulate(rbd.State(box, DOWN), [face], duration=0.01, step=0.01, controller=counts)
    contacts = counts.steps[-1].contacts
    with pytest.raises(KeyError, match="no contact 'fase' with points in this motion; nearest: 'face'"):
        contacts["fase"]
    assert "fase" not in contacts and contacts.get("fase") is None and len(contacts) == 1
    for copied in (pickle.loads(pickle.dumps(counts.steps[-1])), copy.deepcopy(counts.steps[-1])):
        assert np.array_equal(copied.contacts["face"].forces, contacts["face"].forces)


class Broken(Exception):
    """An error that `rbd` knows nothing of."""


@pytest.mark.parametrize("integrator", ALL, ids=repr)
@pytest.mark.parametrize("where", ["accepted", "reset"])
def test_an_error_in_a_hook_keeps_the_motion_so_far(integrator, where):
    """`SimulationStopped`, with the user's error as its cause, as for an error in the controller itself."""
    error = Broken("a cable came off")

    class Fails(Counts):
        def reset(self):
            super().reset()
            if where == "reset":
                raise error

        def accepted(self, step):
            super().accepted(step)
            if step.t > 0.1:
                raise error

    with pytest.raises(rbd.errors.SimulationStopped, match="Broken was raised .a cable came off.") as stopped:
        rbd.simulate(rbd.State(rotor(), [0.0]), duration=0.3, step=0.02, controller=Fails(), integrator=integrator)
    assert stopped.value.__cause__ is error
    kept = stopped.value.trajectory
    assert kept is None if where == "reset" else len(kept) == 6


def test_hooks_that_cannot_be_called_are_named():
    """What the controller has in place of a method, or why it cannot be called; its sample times."""
    start = rbd.State(rotor(), [0.0])

    def run(**members):
        controller = type("Own", (Counts,), members)()
        rbd.simulate(start, duration=0.02, step=0.01, controller=controller)

    with pytest.raises(rbd.InputError, match=r"accepted of the controller .*Own.* is 3; expected a method"):
        run(accepted=3)
    with pytest.raises(rbd.InputError, match=r"reset of the controller .* was called with no arguments .*missing 1 required"):
        run(reset=lambda self, seed: None)
    with pytest.raises(rbd.InputError, match=r"was called with an rbd.control.AcceptedStep at t = 0 s, and failed"):
        run(accepted=lambda self: None)
    for every in (0.0, -1.0, "1 ms", True, np.inf, np.nan):
        with pytest.raises(rbd.InputError, match="every of the controller .*expected a time above 0"):
            run(every=every)
    with pytest.raises(rbd.InputError, match="accepted of the controller .* is 3"):
        ZeroOrderHold(type("Own", (Counts,), {"accepted": 3})(), 0.1)


def test_hooks_may_be_left_out():
    """A controller with one of them is told that alone; one without any is called as before."""
    start = rbd.State(rotor(), [0.0])
    for left in itertools.chain.from_iterable(itertools.combinations(("reset", "accepted"), n) for n in (1, 2)):
        controller = type("Own", (Counts,), dict.fromkeys(left))()
        rbd.simulate(start, duration=0.02, step=0.01, controller=controller)
        assert controller.resets == ("reset" not in left)
        assert len(controller.steps) == (0 if "accepted" in left else 3)
    table = rbd.control.TorqueSchedule([0.0], [[0.0]])
    assert isinstance(Counts(), SteppedController) and not isinstance(table, SteppedController)
