"""Answers at many states are those of `rbd.solve` at each; what is wrong at one of them stays there."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
import tracemalloc
import warnings
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.many import Solutions, StateStatus, side_by_side
from rbd.answers.many.many_answers import WARNINGS
from rbd.answers.prepared.constraint_dynamics import Plan
from rbd.answers.prepared.contact_bodies import MOST, MOST_BODIES
from rbd.errors import DistantContactWarning, EffortLimitWarning, OpeningContactWarning

URDF = Path(__file__).parents[1] / "urdf"


def near(robot: rbd.Robot, rng: np.random.Generator, n: int, *, far: float = 0.02) -> np.ndarray:
    """Configurations near standing, shape (n, nq)."""
    q = robot.standing().q
    return np.array([pin.integrate(robot.model, q, far * rng.normal(size=robot.nv)) for _ in range(n)])


def pushed(robot: rbd.Robot, rng: np.random.Generator, n: int, *, push: float = 20.0) -> np.ndarray:
    """Torques around those that hold it, within their limits, shape (n, nu)."""
    held = rbd.hold(robot.standing(), robot.feet()).tau
    return np.clip(held + push * rng.normal(size=(n, robot.nu)), -robot.effort_limit, robot.effort_limit)


def anywhere(contacts: Sequence[rbd.constraints.Contact]) -> list[rbd.constraints.Contact]:
    """The same contacts on surfaces that are not known: none is off its plane."""
    return [
        rbd.constraints.Contact(c.name, c.frame, corners=c.corners, placement=c.placement, friction=c.friction)
        for c in contacts
    ]


def single(solutions: Solutions, i: int) -> rbd.Solution:
    """What `rbd.solve` answers at state i."""
    states = solutions.states
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return rbd.solve(
            rbd.State(states.robot, states.q[i], states.v[i]), solutions.tau[i], states.constraints_at(i),
            law=solutions.law, external=states.external_at(i), check=False,
        )  # fmt: skip


def agrees(solutions: Solutions, *, unique: bool = True) -> None:
    """Rows equal single answers to 1e-9, over the largest entry; forces add up from the corners'."""
    for i in np.flatnonzero(solutions.answered).tolist():
        one = single(solutions, i)
        assert solutions.worst[i] <= 1e-9
        if one.others or not unique:
            continue
        size = max(1.0, float(np.abs(one.a).max()))
        np.testing.assert_allclose(solutions.a[i], one.a, rtol=0.0, atol=1e-9 * size)
        weight = solutions.states.robot.mass * 9.81
        for name, force in one.forces.items():
            np.testing.assert_allclose(solutions.forces[name][i], force, rtol=0.0, atol=1e-7 * weight)
        for name, corners in solutions.corner_forces.items():
            np.testing.assert_allclose(corners[i].sum(axis=0), solutions.forces[name][i, :3], rtol=0.0, atol=1e-8 * weight)
        for name, contact in one.contacts.items():
            if contact.friction_used is not None:
                assert abs(solutions.friction_used[name][i] - contact.friction_used) < 1e-6
            if contact.centre_of_pressure is not None and contact.normal > 1e-3 * weight:
                np.testing.assert_allclose(solutions.centre_of_pressure[name][i], contact.centre_of_pressure, atol=1e-7)


@pytest.mark.parametrize("law", ["coulomb", "convex"])
@pytest.mark.parametrize("name", ["talos", "g1", "solo12", "bolt"])
@pytest.mark.filterwarnings("ignore::rbd.errors.NonUniqueMotionWarning")
def test_rows_are_single_answers(name: str, law: str, rng: np.random.Generator):
    """On soles and points, sticking, slipping and lifting, under both laws."""
    robot = rbd.load_robot(name)
    contacts = anywhere(robot.feet(friction=0.6))
    q, tau = near(robot, rng, 12), pushed(robot, rng, 12, push=0.1 * robot.mass)
    tau[:4] = rbd.hold(robot.standing(), robot.feet()).tau
    solutions = rbd.solve_many(robot, q, None, tau, contacts, law=law)
    assert solutions.a.shape == (12, robot.nv) and len(solutions) == 12
    assert solutions.counts == {"solved": 12}
    agrees(solutions)


def test_held_soles_that_move(talos: rbd.Robot, rng: np.random.Generator):
    """Bilateral contacts take any velocity, turning soles too."""
    q, v = near(talos, rng, 8), 0.3 * rng.normal(size=(8, talos.nv))
    solutions = rbd.solve_many(talos, q, v, pushed(talos, rng, 8), anywhere(talos.soles(friction=None)))
    assert solutions.counts == {"solved": 8}
    agrees(solutions)


def test_a_whole_solution_of_one_state(talos: rbd.Robot, rng: np.random.Generator):
    """`solutions[i]` has all that `rbd.solve` gives, and the same numbers."""
    solutions = rbd.solve_many(talos, near(talos, rng, 5), None, pushed(talos, rng, 5), anywhere(talos.soles(0.7)))
    for i in (0, 3, -1):
        one = solutions[i]
        assert isinstance(one, rbd.Solution) and one.status is rbd.problem.Status.SOLVED
        np.testing.assert_allclose(one.a, solutions.a[i], rtol=0.0, atol=1e-9 * max(1.0, np.abs(one.a).max()))
        assert one.law == solutions.law and one.residuals.worst <= 1e-9
    assert [one.a.shape for one in solutions] == [(talos.nv,)] * 5
    with pytest.raises(IndexError):
        solutions[5]
    with pytest.raises(rbd.InputError, match="whole number"):
        solutions[1:2]  # type: ignore[index]


class TestBadRows:
    """One bad state among good ones."""

    def test_what_is_not_finite_is_its_own_row(self, talos: rbd.Robot, rng: np.random.Generator):
        """NaN in q, infinity in tau, a quaternion off the sphere, a velocity beyond all bounds: rows of NaN."""
        q, v, tau = near(talos, rng, 9), np.zeros((9, talos.nv)), pushed(talos, rng, 9)
        q[7, 20], tau[2, 5], v[4, 3] = np.nan, np.inf, 1e9
        q[5, 3:7] *= 1.01
        contacts = anywhere(talos.soles(0.7))
        solutions = rbd.solve_many(talos, q, v, tau, contacts)
        bad = [2, 4, 5, 7]
        assert np.flatnonzero(solutions.status == StateStatus.BAD_INPUT).tolist() == bad
        assert sorted(solutions.reasons) == bad and "norm 1.01" in solutions.reasons[5] and "nan" in solutions.reasons[7]
        assert np.isnan(solutions.a[bad]).all() and np.isnan(solutions.forces["left_sole"][bad]).all()
        assert np.isnan(solutions.worst[bad]).all() and (solutions.method[bad] == "").all()
        good = np.delete(np.arange(9), bad)
        alone = rbd.solve_many(talos, q[good], v[good], tau[good], contacts)
        np.testing.assert_array_equal(solutions.a[good], alone.a)
        with pytest.raises(rbd.InputError, match="at state 7: q of talos is not finite"):
            solutions[7]

    def test_an_impact_and_a_slide_are_rows(self, talos: rbd.Robot):
        """A foot that approaches is refused by name under both laws, one that slides under the convex one."""
        state = talos.standing()
        tau, soles = rbd.hold(state, talos.soles()).tau, talos.soles(0.7)
        v = np.zeros((3, talos.nv))
        v[1, 2], v[2, 0] = -0.2, 0.2
        for law, expected in (("coulomb", [0, 4, 0]), ("convex", [0, 4, 4])):
            solutions = rbd.solve_many(talos, state.q, v, tau, soles, law=law)
            assert solutions.status.tolist() == expected
            assert "approaches" in solutions.reasons[1] and "left_sole" in solutions.reasons[1]
            with pytest.raises(rbd.errors.ContactMoves):
                solutions[1]
        assert "slide" in solutions.reasons[2] or "moves at" in solutions.reasons[2]

    def test_a_contradiction_is_a_row(self):
        """Two locks that pull a joint to two places: proved at each state, and no exception."""
        arm = rbd.load_robot("panda", root="fixed")
        locks = [rbd.constraints.Baumgarte(9.0).of(rbd.JointLock(f"at {q}", "panda_joint1", position=q)) for q in (0.1, 0.2)]
        solutions = rbd.solve_many(arm, np.zeros((2, arm.nq)) + arm.at().q, None, np.zeros(arm.nu), locks)
        assert solutions.counts == {"infeasible": 2} and np.isnan(solutions.a).all()
        assert solutions[0].contradiction is not None

    def test_what_is_wrong_everywhere_is_an_error(self, talos: rbd.Robot):
        """Sizes, names and numbers of states concern all rows."""
        q, soles, tau = np.tile(talos.standing().q, (3, 1)), talos.soles(0.7), np.zeros(talos.nu)
        for given, told in (
            ({"tau": np.zeros((3, talos.nu + 1))}, "tau has shape"),
            ({"tau": np.zeros((3, talos.nv))}, "no entry for the floating base"),
            ({"tau": np.zeros((4, talos.nu))}, "numbers of states differ"),
            ({"q": q[:, :-1]}, "q has shape"),
            ({"tau": tau * np.nan}, "not finite"),
            ({"constraints": [*soles, soles[0]]}, "two constraints are named"),
            ({"constraints": [rbd.PointContact("toe", "nowhere")]}, "no frame 'nowhere'"),
            ({"law": "dry"}, "law is 'dry'"),
            ({"friction": {"left_sol": 0.5}}, "nearest: 'left_sole'"),
            ({"friction": -0.5}, "friction of 'left_sole' is"),
            ({"friction": np.full(5, 0.5)}, "numbers of states differ"),
            ({"constraints": talos.soles(None), "friction": 0.5}, "no contact has a coefficient"),
            ({"external": np.zeros((3, 6))}, "external has shape"),
            ({"robot": "talos"}, "a robot is wanted"),
        ):
            with pytest.raises(rbd.InputError, match=told):
                rbd.solve_many(**({"robot": talos, "q": q, "v": None, "tau": tau, "constraints": soles} | given))


class TestBroadcasting:
    """One row for all states, or one a state."""

    def test_one_pose_under_many_torques(self, g1: rbd.Robot, rng: np.random.Generator):
        """One q and v, tau a row a state; and the other way round."""
        contacts, tau = anywhere(g1.soles(0.6)), pushed(g1, rng, 6, push=3.0)
        q = near(g1, rng, 6)
        solutions = rbd.solve_many(g1, q[0], g1.zero_v, tau, contacts)
        assert len(solutions) == 6 and solutions.states.q.strides[0] == 0
        agrees(solutions)
        solutions = rbd.solve_many(g1, q, None, tau[:1], contacts)
        assert len(solutions) == 6
        agrees(solutions)

    def test_external_forces(self, talos: rbd.Robot, rng: np.random.Generator):
        """`ExternalForce`s at every state; generalised forces a row a state."""
        q, tau, contacts = near(talos, rng, 4), pushed(talos, rng, 4, push=2.0), anywhere(talos.soles(0.7))
        push = rbd.ExternalForce("torso_2_link", (0.0, 60.0, 0.0), offset=(0.0, 0.0, 0.1))
        for external in (push, [push, rbd.ExternalForce("head_2_link", (5.0, 0.0, 0.0))], 3.0 * rng.normal(size=(4, talos.nv))):
            solutions = rbd.solve_many(talos, q, None, tau, contacts, external=external)
            assert solutions.counts == {"solved": 4}
            agrees(solutions)
        with pytest.raises(rbd.InputError, match="mixes forces"):
            rbd.solve_many(talos, q, None, tau, contacts, external=[push, 1.0])

    def test_friction_of_each_state(self, talos: rbd.Robot, rng: np.random.Generator):
        """A number of all contacts, a row a state, or by name; the bad ones are rows."""
        contacts, tau = anywhere(talos.soles(0.7)), pushed(talos, rng, 5, push=8.0)
        q = near(talos, rng, 1)
        mu = np.array([0.05, 0.3, 0.6, -1.0, 0.0])
        solutions = rbd.solve_many(talos, q, None, tau, contacts, friction=mu)
        assert solutions.status.tolist() == [0, 0, 0, 5, 0] and "friction" in solutions.reasons[3]
        agrees(solutions)
        assert (solutions.friction_used["left_sole"][:3] <= np.sqrt(1.0) + 1e-9).all()
        named = rbd.solve_many(talos, q, None, tau[0], contacts, friction={"left_sole": mu[:3], "right_sole": 0.7})
        agrees(named)
        assert named.states.friction["left_sole"].tolist() == mu[:3].tolist()
        agrees(rbd.solve_many(talos, q, None, tau[0], contacts, friction=0.4))

    def test_no_states(self, talos: rbd.Robot):
        """None at all: empty arrays of the right shapes."""
        solutions = rbd.solve_many(talos, np.zeros((0, talos.nq)), None, np.zeros(talos.nu), talos.soles(0.7))
        assert len(solutions) == 0 and solutions.a.shape == (0, talos.nv) and solutions.counts == {}
        assert list(solutions) == [] and "0 states" in repr(solutions) and solutions.worst.shape == (0,)


def test_all_kinds_of_constraints(rng: np.random.Generator):
    """Loops, limits that come and go and frictionless points: row forces with zeros where a constraint is inactive."""
    four_bar = rbd.load_robot(URDF / "four_bar.urdf")
    state = four_bar.at(rbd.mechanism.assemble(four_bar.at()).q)
    solutions = rbd.solve_many(four_bar, state.q, None, rng.normal(size=(3, four_bar.nu)), list(four_bar.loops()))
    agrees(solutions)
    assert solutions.one_by_one.all() and solutions.corner_forces.keys() == set()
    arm = rbd.load_robot("panda", root="fixed")
    stop = rbd.JointLimit("stop", "panda_joint1", lower=-0.5, upper=0.5)
    q = np.tile(arm.at().q, (2, 1))
    q[:, 0] = 0.0, 0.5
    limited = rbd.solve_many(arm, q, None, np.eye(arm.nu)[0] * 5.0, [stop])
    assert limited.forces["stop"].shape == (2, 1) and limited.forces["stop"][0, 0] == 0.0 and limited.forces["stop"][1, 0] > 0.0


def test_one_warning_of_each_kind(talos: rbd.Robot):
    """Torques beyond limits, soles in the air, contacts that leave: counted, and told once."""
    state = talos.standing()
    q, v = np.tile(state.q, (4, 1)), np.zeros((4, talos.nv))
    q[1:, 2] += 0.1
    v[3, 2] = 0.5
    tau = np.tile(rbd.hold(state, talos.soles()).tau, (4, 1))
    tau[2, 0] = 2.0 * talos.effort_limit[0]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        solutions = rbd.solve_many(talos, q, v, tau, talos.soles(0.7))
    kinds = [w.category for w in told]
    assert len(kinds) == len(set(kinds)) and set(kinds) == {EffortLimitWarning, DistantContactWarning, OpeningContactWarning}
    assert all(w.filename == __file__ for w in told)
    by_kind = {WARNINGS[what]: some.tolist() for what, some in solutions.warned.items()}
    assert by_kind[EffortLimitWarning] == [False, False, True, False]
    assert by_kind[DistantContactWarning] == [False, True, True, True]
    assert by_kind[OpeningContactWarning] == [False, False, False, True]
    assert "at 3 of 4 states of talos, the first of them state 1" in str(
        next(w.message for w in told if w.category is DistantContactWarning)
    )


def test_words_and_not_arrays(talos: rbd.Robot, rng: np.random.Generator):
    """What is printed counts, and shows no array."""
    q = near(talos, rng, 50)
    q[3, 8] = np.nan
    solutions = rbd.solve_many(talos, q, None, pushed(talos, rng, 50, push=1.0), anywhere(talos.soles(0.7)))
    assert repr(solutions).startswith("Solutions(50 states of 'talos': 49 solved, 1 bad input; worst residual ")
    text = str(solutions)
    assert "1 bad input, the first at state 3" in text and "array" not in text and len(text) < 1000
    assert repr(solutions.states) == "ManyStates(50 of 'talos')"
    for array in (solutions.a, solutions.status, solutions.forces["left_sole"]):
        assert not array.flags.writeable


def test_what_was_given_is_not_touched(talos: rbd.Robot, rng: np.random.Generator):
    """Arguments are copied: a later change of the caller's arrays changes nothing, nor are quaternions normalised in them."""
    q, tau = near(talos, rng, 2), pushed(talos, rng, 2)
    q[1, 3:7] *= 1.0 + 1e-8
    before = q.copy()
    solutions = rbd.solve_many(talos, q, None, tau, anywhere(talos.soles(0.7)))
    np.testing.assert_array_equal(q, before)
    a = solutions[0].a
    q[:], tau[:] = 0.0, 0.0
    np.testing.assert_array_equal(solutions[0].a, a)


def test_threads_side_by_side(talos: rbd.Robot, g1: rbd.Robot, rng: np.random.Generator):
    """Two robots in four threads: the same numbers as one after the other, to the last bit."""
    asked = []
    for robot in (talos, g1):
        q, tau = near(robot, rng, 10), pushed(robot, rng, 10, push=0.1 * robot.mass)
        asked.append((robot, q, None, tau, anywhere(robot.soles(0.7))))
    expected = [rbd.solve_many(*given).a for given in asked]
    found: dict[int, np.ndarray] = {}
    old = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        threads = [threading.Thread(target=lambda i=i: found.update({i: rbd.solve_many(*asked[i % 2]).a})) for i in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(old)
    for i in range(4):
        np.testing.assert_array_equal(found[i], expected[i % 2])


def test_as_a_dataset(talos: rbd.Robot, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch):
    """xarray: dimensions, labels and units; without it the extra is named."""
    solutions = rbd.solve_many(
        talos, near(talos, rng, 3), None, pushed(talos, rng, 3), anywhere(talos.soles(0.7)), friction=0.6
    )
    pytest.importorskip("xarray")
    data = solutions.to_xarray()
    assert dict(data.sizes)["state"] == 3 and data.force_left_sole.dims == ("state", "left_sole_row")
    np.testing.assert_array_equal(
        data.a.sel(velocity="leg_left_4_joint"), solutions.a[:, talos.joints["leg_left_4_joint"].v.start]
    )
    assert data.corner_forces_left_sole.shape == (3, 4, 3) and data.friction_left_sole.values.tolist() == [0.6] * 3
    assert data.tau.sizes["motor"] == talos.nu and data.status.attrs["flag_meanings"].startswith("solved ")
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(rbd.InputError, match=r"rbd-contact\[study\]"):
        solutions.to_xarray()


class TestActuations:
    """Torques of many poses and motions are those of `rbd.hold` and `rbd.inverse_dynamics`."""

    def test_held_poses(self, talos: rbd.Robot, rng: np.random.Generator):
        """Torques, forces and margins as of single poses; one that cannot be held is a row, its proof on demand."""
        q, soles = near(talos, rng, 8), anywhere(talos.soles(0.7))
        q[2, 0] = np.nan
        q[5] = talos.standing().q
        push = np.zeros((8, talos.nv))
        push[5, 1] = 500.0
        found = rbd.statics.hold_many(talos, q, soles, external=push)
        assert found.status.tolist() == [0, 0, 5, 0, 0, 7, 0, 0]
        assert "cannot be held" in found.reasons[5] and np.isnan(found.tau[[2, 5]]).all()
        for i in (0, 1, 3, 4, 6, 7):
            one = rbd.hold(rbd.State(talos, q[i]), soles, external=push[i])
            np.testing.assert_allclose(found.tau[i], one.tau, rtol=0.0, atol=1e-7)
            assert found.margin[i] == one.margin and found.least[i] and found.worst[i] <= 1e-9
            for name in one.forces:
                np.testing.assert_allclose(found.forces[name][i], one.forces[name], rtol=0.0, atol=1e-6)
                np.testing.assert_allclose(found.corner_forces[name][i], one.corner_forces[name], rtol=0.0, atol=1e-6)
                assert abs(found.friction_used[name][i] - one.contacts[name].friction_used) < 1e-8
            np.testing.assert_allclose(found[i].tau, found.tau[i], rtol=0.0, atol=1e-7)
        with pytest.raises(rbd.CannotHold, match="base"):
            found[5]
        with pytest.raises(rbd.InputError, match="at state 2"):
            found[2]
        assert repr(found).startswith("Actuations(8 states of 'talos': 6 solved, 1 bad input, 1 cannot move")

    def test_wanted_motions(self, g1: rbd.Robot, rng: np.random.Generator):
        """`rbd.solve_many` with the torques gives the accelerations back; one that the soles do not allow is a row."""
        soles, held = anywhere(g1.soles(0.7)), anywhere(g1.soles(None))
        q = near(g1, rng, 6)
        a = np.array([rbd.mechanism.project_acceleration(rbd.State(g1, x), 0.2 * rng.normal(size=g1.nv), held).a for x in q])
        a[4, 2] -= 1.0
        found = rbd.control.inverse_dynamics_many(g1, q, None, a, soles)
        good = [0, 1, 2, 3, 5]
        assert found.status[good].tolist() == [0] * 5 and found.status[4] == StateStatus.CANNOT_MOVE
        assert "cannot move so" in found.reasons[4]
        for i in good:
            one = rbd.inverse_dynamics(rbd.State(g1, q[i]), a[i], soles)
            np.testing.assert_allclose(found.tau[i], one.tau, rtol=0.0, atol=1e-7)
        back = rbd.solve_many(g1, q[good], None, found.tau[good], soles)
        np.testing.assert_allclose(back.a, a[good], rtol=0.0, atol=1e-8)
        np.testing.assert_array_equal(found.a[good], a[good])

    def test_friction_and_what_is_wrong_everywhere(self, talos: rbd.Robot):
        """Coefficients a row a pose; words and objectives are checked once."""
        q, soles = talos.standing().q, talos.soles(0.7)
        found = rbd.statics.hold_many(
            talos, q, soles, coefficients=[0.1, 0.7, -1.0], external=rbd.ExternalForce("torso_2_link", (0, 70.0, 0))
        )
        assert found.status.tolist() == [0, 0, 5]
        one = rbd.hold(talos.standing(), talos.soles(0.1), external=rbd.ExternalForce("torso_2_link", (0, 70.0, 0)))
        np.testing.assert_allclose(found.tau[0], one.tau, rtol=0.0, atol=1e-7)
        assert len(rbd.statics.hold_many(talos, np.zeros((0, talos.nq)), soles)) == 0
        for given, told in (
            ({"friction": "dry"}, "friction is 'dry'"),
            ({"objective": 3}, "objective is 3"),
            ({"margin": 2.0}, "margin is 2"),
            ({"coefficients": {"toe": 1.0}}, "friction is given for 'toe'"),
            ({"q": np.zeros(3)}, "q has shape"),
        ):
            with pytest.raises(rbd.InputError, match=told):
                rbd.statics.hold_many(**({"robot": talos, "q": q, "contacts": soles} | given))

    def test_a_passive_joint_that_no_contact_moves(self, rng: np.random.Generator):
        """On three feet, the knee of the fourth without a motor: its row is empty, so a block has no linear system to solve."""
        solo = rbd.load_robot("solo12", passive=["HR_KFE"])
        feet, q = anywhere(solo.feet(friction=None))[:3], near(solo, rng, 3)
        a = rbd.solve_many(solo, q, None, rng.normal(size=(3, solo.nu)), feet).a
        found = rbd.control.inverse_dynamics_many(solo, q, None, a, feet)
        assert found.counts == {"solved": 3} and found.one_by_one.all()
        back = rbd.solve_many(solo, q, None, found.tau, feet)
        np.testing.assert_allclose(back.a, a, rtol=0.0, atol=1e-7)

    def test_contacts_that_leave(self, talos: rbd.Robot):
        """Feet that already separate carry nothing, and are told once."""
        state = talos.standing()
        v = np.zeros((2, talos.nv))
        v[:, 2] = 0.5
        falls = np.zeros(talos.nv)
        falls[2] = -9.81
        with pytest.warns(OpeningContactWarning, match="at 2 of 2 states"):
            found = rbd.control.inverse_dynamics_many(talos, state.q, v, falls, talos.soles(0.7))
        assert (found.forces["left_sole"][found.answered] == 0.0).all()


@pytest.mark.parametrize("law", ["coulomb", "convex"])
@pytest.mark.parametrize(
    "fault", ["sign of forces", "stale acceleration", "another q", "another v", "wrong site", "scaled forces"]
)
def test_a_corrupted_block_is_not_certified(talos: rbd.Robot, rng: np.random.Generator, law: str, fault: str, monkeypatch):
    """What finds the answers is spoilt, what judges them is not: not one row of a block is certified."""
    contacts, q, tau = anywhere(talos.soles(0.7)), near(talos, rng, 12), pushed(talos, rng, 12)
    assert not rbd.solve_many(talos, q, None, tau, contacts, law=law).one_by_one.all()
    found, last = Plan.search, [np.zeros(talos.nv)]

    def spoilt(plan, space, q, v, *rest):
        if fault == "another q":
            q = pin.integrate(talos.model, q, np.full(talos.nv, 1e-4))
        elif fault == "another v":
            v = v + 0.05
        answer = found(plan, space, q, v, *rest)
        if answer is None:
            return None
        last.append(answer.a.copy())
        if fault == "sign of forces":
            answer.w[:] *= -1.0
        elif fault == "scaled forces":
            answer.w[:] *= 1.0 + 1e-7
        elif fault == "stale acceleration":
            answer.a[:] = last[-2]
        elif fault == "wrong site":
            answer.w[:] = np.roll(answer.w, 12)
        return answer

    monkeypatch.setattr(Plan, "search", spoilt)
    assert rbd.solve_many(talos, q, None, tau, contacts, law=law).one_by_one.all()


@pytest.mark.parametrize("name", ["talos", "solo12"])
def test_blocks_of_poses_are_single_poses(name: str, rng: np.random.Generator):
    """Most poses need no program: the least effort is inside all limits. Their torques and forces are those of the program.

    Coefficients given state by state are answered as the contacts' own.
    """
    robot = rbd.load_robot(name)
    feet, q = anywhere(robot.feet(friction=0.7)), near(robot, rng, 30)
    effort = rbd.statics.Effort(torques=2.0, forces=1e-3)
    found = rbd.statics.hold_many(robot, q, feet, objective=effort)
    assert found.counts == {"solved": 30} and found.one_by_one.sum() <= 3
    for i in range(0, 30, 3):
        one = rbd.hold(rbd.State(robot, q[i]), feet, objective=effort)
        np.testing.assert_allclose(found.tau[i], one.tau, rtol=0.0, atol=1e-7)
        for foot in one.corner_forces:
            np.testing.assert_allclose(found.corner_forces[foot][i], one.corner_forces[foot], rtol=0.0, atol=1e-6)
    given = rbd.statics.hold_many(robot, q, anywhere(robot.feet(friction=0.2)), coefficients=np.full(30, 0.7), objective=effort)
    np.testing.assert_array_equal(given.one_by_one, found.one_by_one)
    np.testing.assert_allclose(given.tau, found.tau, rtol=0.0, atol=1e-7)
    bounded = rbd.statics.Effort(normal_force={feet[0].name: (0.3 * robot.mass * 9.81, np.inf)})
    assert rbd.statics.hold_many(robot, q[:2], feet, objective=bounded).one_by_one.all()


def test_mixed_contacts_in_a_block(talos: rbd.Robot, rng: np.random.Generator):
    """A held sole beside one with friction, and a hand on an inclined wall; robots that move with their contacts at rest."""
    left, right = anywhere(talos.soles(0.6))
    hand = rbd.PointContact(
        "hand", "arm_left_7_link", offset=(0.02, 0.0, 0.1), friction=0.5, on=rbd.Ground(normal=(0.0, -0.6, 0.8))
    )
    bar = rbd.PointContact("bar", "arm_right_7_link", on=rbd.Ground(normal=(0.6, 0.0, 0.8)))
    q, tau = near(talos, rng, 10), pushed(talos, rng, 10, push=3.0)
    for contacts in ([left, right, hand], [left.with_friction(None), right, bar], [left, bar]):
        held = [c.with_friction(None) for c in contacts]
        v = np.array([rbd.mechanism.project_velocity(rbd.State(talos, x, rng.normal(size=talos.nv)), held).v for x in q])
        for given in (None, 0.3 * v):
            solutions = rbd.solve_many(talos, q, given, tau, contacts)
            assert solutions.counts == {"solved": 10}
            assert not solutions.one_by_one[:4].all()
            agrees(solutions)
            for i in (0, 5):
                assert solutions[i].residuals.worst <= 1e-9
                assert solutions[i].corner_forces.keys() == solutions.corner_forces.keys()
                for name, corners in solutions[i].corner_forces.items():
                    assert corners.shape == solutions.corner_forces[name][i].shape


def test_memory_stays(talos: rbd.Robot, rng: np.random.Generator):
    """Thousands of states leave nothing behind, and what is kept with a robot has a limit, however many contacts are made."""
    q, tau = near(talos, rng, 100), pushed(talos, rng, 100)
    contacts = anywhere(talos.soles(0.7))

    def ask() -> int:
        for _ in range(5):
            rbd.solve_many(talos, q, None, tau, contacts)
            rbd.statics.hold_many(talos, q, contacts)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        ask()
        before = ask()
        assert ask() - before < 50_000
    finally:
        tracemalloc.stop()
    for _ in range(MOST + 5):
        rbd.solve_many(talos, q[0], None, tau[0], anywhere(talos.soles(0.7)))
    assert len(talos.kept_bodies) <= MOST_BODIES and len(talos.kept) <= MOST


class TestProcesses:
    """Parts of the states in processes of their own."""

    def test_the_same_bits(self, talos: rbd.Robot, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch):
        """Limits that come and go, friction and a push at each state, bad states: as in one process, at any number of parts."""
        monkeypatch.setattr(side_by_side, "LEAST", 7)
        n = 40
        q, tau = near(talos, rng, n, far=0.1), pushed(talos, rng, n)
        q[3, 20] = np.nan
        name = next(joint.name for joint in talos.joints.values() if joint.nv == 1)
        stop = rbd.JointLimit("stop", name, lower=float(np.nanmedian(q[:, talos.joints[name].q.start])), upper=9.0)
        given = {
            "external": rng.normal(size=(n, talos.nv)),
            "friction": {"left_sole": rng.uniform(-0.05, 0.9, n), "right_sole": 0.6},
        }
        asked = (talos, q, None, tau, [*anywhere(talos.soles(0.7)), stop])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            alone, found = rbd.solve_many(*asked, **given), rbd.solve_many(*asked, **given, threads=2)
        assert found.reasons == alone.reasons and found.counts == alone.counts and len(alone.counts) > 1
        for kind in ("forces", "corner_forces", "friction_used", "centre_of_pressure", "residuals", "warned"):
            ours, theirs = getattr(found, kind), getattr(alone, kind)
            assert ours.keys() == theirs.keys()
            for key in ours:
                np.testing.assert_array_equal(ours[key], theirs[key])
        for kind in ("a", "status", "reason_codes", "method", "one_by_one"):
            np.testing.assert_array_equal(getattr(found, kind), getattr(alone, kind))
        with pytest.raises(rbd.InputError, match="threads"):
            rbd.solve_many(*asked, threads=0)

    def test_what_is_done_stays(self, talos: rbd.Robot, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch):
        """Ctrl-C after one part of two: its rows are kept, the others say that they were not computed."""
        monkeypatch.setattr(side_by_side, "LEAST", 5)
        monkeypatch.setattr(side_by_side, "SHARES", 1)
        monkeypatch.setattr(side_by_side, "_workers", lambda *given: Interrupted())
        with pytest.warns(rbd.errors.StudyWarning, match="Ctrl-C after 5 of 10 states"):
            found = rbd.solve_many(
                talos, near(talos, rng, 10), None, pushed(talos, rng, 10), anywhere(talos.soles(0.7)), threads=2
            )
        assert found.status.tolist() == [StateStatus.SOLVED] * 5 + [StateStatus.FAILED] * 5
        assert (found.reason_codes[5:] == rbd.errors.Reason.NOT_RUN.code).all() and np.isnan(found.a[5:]).all()

    def test_a_script_without_a_guard_says_so(self, tmp_path: Path):
        """It is started again by its processes: they end, and the first names the line that is missing."""
        script = tmp_path / "script.py"
        script.write_text(
            "import numpy as np, rbd\nsolo = rbd.load_robot('solo12')\n"
            "rbd.solve_many(solo, solo.standing().q, None, np.zeros(solo.nu), solo.feet(), threads=2)\n"
        )
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
        assert done.returncode and "InputError: rbd.solve_many is started again" in done.stderr and "__main__" in done.stderr


class Interrupted:
    """Two workers that compute the first part; then Ctrl-C is pressed."""

    count, used = 2, False

    def submit(self, function, *given):
        """As of an executor."""
        done: Future = Future()
        if self.used:
            done.set_exception(KeyboardInterrupt())
        else:
            done.set_result(function(*given))
        self.used = True
        return done


def test_memory_of_a_state(talos: rbd.Robot, rng: np.random.Generator):
    """As the docstring tells: the answers, and the forces once they are read."""
    q, tau = near(talos, rng, 100), pushed(talos, rng, 100, push=1.0)
    found = rbd.solve_many(talos, q, None, tau, anywhere(talos.soles(0.7)))
    arrays = [found.a, found._sheet.weights, found.status, found.reason_codes, found.method_codes, found.one_by_one]
    arrays += [*found.residuals.values(), *found.warned.values()]
    assert sum(x.nbytes for x in arrays) <= 550 * len(found)
    kinds = (found.forces, found.corner_forces, found.friction_used, found.centre_of_pressure)
    assert sum(x.nbytes for kind in kinds for x in kind.values()) <= 400 * len(found)
