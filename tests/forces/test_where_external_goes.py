"""Force elements wherever `external` goes: the same as their generalised force, with pushes in one list, at many states."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import DuplicateName, InputError
from rbd.model.external import generalised

HAND, TORSO = "arm_left_7_link", "torso_2_link"


@pytest.fixture(scope="module")
def standing(talos: rbd.Robot) -> tuple[rbd.State, list, list]:
    """Talos on its soles, elements that its motors can hold, and these with a push."""
    state = talos.standing()
    springs = [
        rbd.Spring(HAND, to=(0.6, 0.6, 1.3), stiffness=40.0, rest=0.1),
        rbd.Damper(HAND, to=TORSO, damping=5.0),
        rbd.Bushing(HAND, to=TORSO, stiffness=2.0, damping=1.0),
        rbd.JointSpring("arm_left_4_joint", stiffness=5.0, rest=-0.5),
        talos.joint_damping(),
    ]
    return state, springs, [*springs, rbd.ExternalForce(TORSO, (5.0, 5.0, 0.0))]


def test_every_call_takes_them(talos: rbd.Robot, standing):
    """As the generalised force of the same list would: torques, forces, motions and the zero-moment point."""
    state, _, acting = standing
    soles = talos.soles()
    tau_ext, wrench = generalised(state, acting)
    held = rbd.hold(state, soles, external=acting)
    assert held.residuals.worst < 1e-9 and held.external == acting
    a = rbd.mechanism.project_acceleration(state, 0.3 * np.ones(talos.nv), soles).a
    calls = {
        "solve": lambda e: rbd.solve(state, held.tau, soles, external=e).a,
        "gauss_problem": lambda e: rbd.solve_problem(rbd.gauss_problem(state, held.tau, soles, external=e)).a,
        "hold": lambda e: rbd.hold(state, soles, external=e).tau,
        "inverse_dynamics": lambda e: rbd.inverse_dynamics(state, a, soles, external=e).tau,
        "free_acceleration": lambda e: rbd.dynamics.free_acceleration(state, held.tau, e),
        "zmp": lambda e: rbd.statics.zmp(state, np.zeros(talos.nv), external=e),
        "compare_laws": lambda e: rbd.studies.compare_laws(state, held.tau, soles, external=e).coulomb.a,
        "estimate_forces": lambda e: rbd.estimate_forces(state, 0.0 * state.v, soles, held.tau, external=e).forces["left_sole"],
        "step": lambda e: rbd.control.step(state, [], soles, external=e).tau,
    }  # fmt: skip
    for name, call in calls.items():
        one, other, none = call(acting), call(tau_ext), call(None)
        assert np.abs(one - other).max() < 1e-7 * max(1.0, np.abs(other).max()), name
        assert np.abs(one - none).max() > 1e-4, name
    assert wrench[:3] == pytest.approx(generalised(state, tau_ext)[1][:3], abs=1e-9)
    estimate = rbd.estimate_forces(state, np.zeros(talos.nv), soles, held.tau, external=acting)
    total = sum(f[:3] for f in estimate.forces.values())
    assert total == pytest.approx(sum(f[:3] for f in held.forces.values()), abs=1e-6)


@pytest.mark.filterwarnings("ignore::rbd.errors.ForceElementWarning")
def test_controllers_hold_against_springs_that_they_know(talos: rbd.Robot, standing):
    """`HoldPosture` and `WholeBodyController` with `external` keep still what others let go; damping acts in motion alone."""
    state, springs, _ = standing
    soles = talos.soles()
    acting = {"external": springs}
    told, untold = (rbd.control.HoldPosture(state, soles, **more)(state, 0.0) for more in (acting, {}))
    assert np.abs(told - rbd.hold(state, soles, external=springs).tau).max() < 1e-9
    assert (
        np.abs(rbd.solve(state, told, soles, **acting).a).max()
        < 1e-7
        < np.abs(rbd.solve(state, untold, soles, **acting).a).max()
    )
    for more, still in ((acting, True), ({}, False)):
        controller = rbd.control.WholeBodyController([rbd.control.PostureTask(state)], soles, **more)
        controller.accepted(rbd.control.AcceptedStep(state, 0.0, 1e-3, {}))
        assert (np.abs(rbd.solve(state, controller(state, 0.0), soles, **acting).a).max() < 1e-3) == still
    pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    down = pendulum.at([-np.pi / 2])
    pushed = rbd.JointSpring("joint_1", stiffness=-50.0, rest=-np.pi / 2)  # tips
    bare, told = (rbd.control.HoldPosture(down, external=e).gains(down).stiffness for e in (None, pushed))
    assert told - bare == pytest.approx(np.array([[50.0 - 0.5 * 9.81]]), rel=1e-6)


def test_at_many_states(talos: rbd.Robot, standing):
    """Row by row as the single calls; damping knows each state's v."""
    state, springs, acting = standing
    rng, soles = np.random.default_rng(0), talos.soles()
    q = np.array(
        [pin.integrate(talos.model, state.q, np.r_[np.zeros(18), rng.uniform(-0.1, 0.1, talos.nv - 18)]) for _ in range(3)]
    )
    moving = state.with_velocity(0.1 * rng.normal(size=talos.nv))
    legs = rbd.mechanism.project_velocity(moving, soles).v
    v = np.array([0.0 * legs, legs, -legs])
    tau = np.array(rbd.hold(state, soles, external=acting).tau)
    fixed = np.repeat(state.q[None], 3, 0)
    many = rbd.solve_many(talos, fixed, v, tau, soles, external=acting)
    free = rbd.solve_many(talos, q, v, tau, [], external=acting)
    held = rbd.statics.hold_many(talos, q, talos.soles(friction=None, on=None), external=springs)
    feet = talos.soles(friction=None)
    still = [rbd.mechanism.project_acceleration(rbd.State(talos, state.q, w), np.zeros(talos.nv), feet).a for w in v]
    wanted = rbd.control.inverse_dynamics_many(talos, fixed, v, np.array(still), feet, external=acting)
    for i in range(3):
        one = rbd.solve(rbd.State(talos, state.q, v[i]), tau, soles, external=acting)
        assert np.abs(many.a[i] - one.a).max() < 1e-8 * max(1.0, np.abs(one.a).max())
        assert np.abs(many[i].a - one.a).max() < 1e-8 * max(1.0, np.abs(one.a).max())
        alone = rbd.solve(rbd.State(talos, q[i], v[i]), tau, [], external=acting).a
        assert np.abs(free.a[i] - alone).max() < 1e-9 * np.abs(alone).max()
        single = rbd.hold(rbd.State(talos, q[i]), talos.soles(friction=None, on=None), external=springs)
        assert np.abs(held.tau[i] - single.tau).max() < 1e-6 * np.abs(single.tau).max()
        driven = rbd.inverse_dynamics(rbd.State(talos, state.q, v[i]), still[i], feet, external=acting)
        assert np.abs(wanted.tau[i] - driven.tau).max() < 1e-6 * np.abs(driven.tau).max()
    assert not np.allclose(many.a[1], many.a[2])


def test_a_state_without_a_force_is_a_row_of_its_own():
    """Zero length at one of three states: that one is refused with its reason, the others are solved."""
    box = rbd.testing.box(mass=10.0)
    q = np.array([[0, 0, z, 0, 0, 0, 1.0] for z in (0.0, 1.0, 3.0)])
    spring = rbd.Spring("box", to=(0, 0, 1), stiffness=10.0, rest=0.5)
    many = rbd.solve_many(box, q, None, np.zeros(0), [], external=spring)
    assert many.status.tolist()[0] == many.status.tolist()[2] == 0 and many.status[1] != 0
    assert "has zero length" in many.reasons[1]
    assert many.a[[0, 2], 2] == pytest.approx([-9.81 + 0.5, -9.81 - 1.5])
    with pytest.raises(rbd.errors.FrameNotFound, match="no frame 'lid'"):
        rbd.solve_many(box, q, None, np.zeros(0), [], external=rbd.Spring("lid", to=(0, 0, 1), stiffness=1.0, rest=1.0))
    with pytest.raises(DuplicateName):
        rbd.solve_many(box, q, None, np.zeros(0), [], external=[spring, spring])
    with pytest.raises(InputError, match="mixes forces and springs"):
        rbd.solve_many(box, q, None, np.zeros(0), [], external=[spring, 1.0])


class Own:
    """A user's element; its outputs are given."""

    def __init__(self, tau=None, wrench=None, derivatives=None, name="own"):
        self.name, self._found = name, (tau, wrench)
        if derivatives is not None:
            self.derivatives = lambda state: derivatives

    def generalised(self, state):
        """What was given."""
        return self._found

    def energy(self, state):
        """None."""
        return 0.0

    def dissipation(self, state):
        """None."""
        return 0.0


def test_what_a_users_element_returns_is_checked():
    """Sizes and finite numbers, with its name; and what a force element must have."""
    box = rbd.testing.box(mass=10.0)
    state = rbd.State(box, pin.neutral(box.model))
    lift = np.array([0.0, 0.0, 98.1, 0.0, 0.0, 0.0])
    assert np.abs(rbd.solve(state, [], external=Own(lift, lift)).a).max() < 1e-12
    assert np.abs(rbd.solve(state, [], external=Own(lift.tolist(), lift)).a).max() < 1e-12
    for tau, wrench, says in (
        (np.zeros(5), lift, r"tau of 'own' has shape \(5,\); expected \(6,\)"),
        (lift, np.zeros(3), r"wrench of 'own' has shape \(3,\)"),
        (np.full(6, np.nan), lift, r"tau of 'own' is not finite at \(0,\): nan"),
        (lift, np.full(6, np.inf), "wrench of 'own' is not finite"),
        ("lift", lift, "tau of 'own'"),
    ):
        with pytest.raises(InputError, match=says):
            rbd.solve(state, [], external=[Own(tau, wrench)])
    bad = Own(lift, lift)
    bad.generalised = lambda state: lift
    with pytest.raises(InputError, match=r"generalised.state. of 'own' is .*; expected .tau .nv,., wrench"):
        rbd.solve(state, [], external=bad)
    for derivatives, says in (
        (np.zeros((6, 6)), "expected .dtau/dq, dtau/dv"),
        ((np.zeros((6, 6)), np.zeros(6)), r"dtau/dv of 'own' has shape \(6,\); expected \(6, 6\)"),
        ((np.full((6, 6), np.nan), np.zeros((6, 6))), "dtau/dq of 'own' is not finite"),
    ):
        with pytest.raises(InputError, match=says):
            rbd.solve(state, [], external=Own(lift, lift, derivatives)).derivatives()

    class Half:
        name = "half"

        def generalised(self, state):
            return lift, lift

    with pytest.raises(InputError, match="holds Half, which has generalised.state., but no energy and no dissipation"):
        rbd.solve(state, [], external=[Half()])
    with pytest.raises(InputError, match="but the name ''; a force element has a name"):
        rbd.solve(state, [], external=[Own(lift, lift, name="")])
    with pytest.raises(InputError, match="external"):
        rbd.solve(state, [], external=[rbd.Spring])


def test_elements_travel(standing):
    """Copies and pickles act as the originals, to the last bit; what was given may change afterwards."""
    state, springs, _ = standing
    for way in (copy.deepcopy, copy.copy, lambda x: pickle.loads(pickle.dumps(x))):
        for element in springs:
            again = way(element)
            assert again.name == element.name and np.array_equal(again.generalised(state)[0], element.generalised(state)[0])
    K = np.diag(np.arange(1.0, 7.0))
    offset, damping = np.zeros(3), {"torso_1_joint": 2.0}
    kept = rbd.Bushing(HAND, to=TORSO, stiffness=K, offset=offset), rbd.JointDamping(damping)
    moving = state.with_velocity(np.ones(state.robot.nv))
    before = [element.generalised(moving)[0] for element in kept]
    K[:], offset[:], damping["torso_1_joint"] = 9.0, 1.0, 7.0
    assert all(np.array_equal(element.generalised(moving)[0], tau) for element, tau in zip(kept, before, strict=True))
    with pytest.raises(TypeError):
        kept[1].damping["torso_1_joint"] = 1.0
