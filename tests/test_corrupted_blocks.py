"""Blocks of states with a fault put in: their certificate notices, and what is returned is right.

As `tests/test_corrupted_path.py`, for `rbd.solve_many`. The faults are in `Workspace.held`, which finds the motion that
holds the bodies: what blocks do after it, they do for all states at once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from test_corrupted_path import KINDS, ROBOTS, case_of, judged

import rbd
from rbd.answers.prepared.contact_bodies import Workspace
from rbd.solvers.contact_newton import ContactNewton

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
COUNT = 10
Right = Callable[..., np.ndarray]


def another_configuration(right: Right) -> Right:
    """Q a tenth of a milliradian off in every joint."""
    return lambda space, q, *rest: right(space, pin.integrate(space._model, q, np.full(space._model.nv, 1e-4)), *rest)


def another_velocity(right: Right) -> Right:
    """V one per cent off."""
    return lambda space, q, v, *rest: right(space, q, 1.01 * v, *rest)


def torque_left_out(right: Right) -> Right:
    """The torque of the last motor is lost on the way."""

    def wrong(space, q, v, generalised, *rest):
        less = generalised.copy()
        less[-1] = 0.0
        return right(space, q, v, less, *rest)

    return wrong


def sign_of_the_forces(right: Right) -> Right:
    """Forces on the surroundings in place of those on the robot."""

    def wrong(space, *rest):
        a = right(space, *rest)
        space.row_forces *= -1.0
        return a

    return wrong


def motion_of_the_state_before(right: Right) -> Right:
    """A buffer that was not renewed; of the first state it is zero."""
    last = [None]

    def wrong(space, *rest):
        before, last[0] = last[0], right(space, *rest)
        return np.zeros(len(last[0])) if before is None else before.copy()

    return wrong


FAULTS = [another_configuration, another_velocity, torque_left_out, sign_of_the_forces, motion_of_the_state_before]


def answered(case) -> rbd.Solutions:
    """All draws of a case at once."""
    q, v, tau = (np.array(each) for each in zip(*case.draws, strict=True))
    return rbd.solve_many(case.robot, q, v, tau, case.contacts, law=case.law)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_is_noticed_in_every_row(name, kind, fault, monkeypatch):
    """Each row is solved and certified by the problem in arrays, and its motion is that of the faultless call."""
    case = case_of(name, *KINDS[kind], count=COUNT)
    right = answered(case)
    with monkeypatch.context() as patch:
        patch.setattr(Workspace, "held", fault(Workspace.held))
        found = answered(case)
    for i in range(COUNT):
        s = found[i]
        assert s.status == "solved" and judged(s) <= 1e-9 and np.array_equal(found.a[i], s.a)
        if kind != "slipping, Coulomb":  # whose motion may be one of several
            assert np.abs(found.a[i] - right.a[i]).max() <= 1e-9 * max(1.0, np.abs(right.a[i]).max())


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_faults_have_an_effect(name, kind, monkeypatch):
    """Without the certificate's verdict the same faults would change what is returned: no row is left to the blocks."""
    case = case_of(name, *KINDS[kind], count=COUNT)
    before = answered(case).method
    for fault in FAULTS[:3]:
        with monkeypatch.context() as patch:
            patch.setattr(Workspace, "held", fault(Workspace.held))
            after = answered(case).method
        assert kind == "held" or not (np.asarray(before) == np.asarray(after)).any(), fault.__name__


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("wrong", ["weights", "change"])
def test_a_fault_of_newtons_forces_is_noticed(name, wrong, monkeypatch):
    """Forces at the points of the bodies, or the accelerations that they give, are a ten-thousandth too large."""
    case = case_of(name, *KINDS["slipping, convex"], count=COUNT)
    right = answered(case)
    owner, what = (ContactNewton, "found") if wrong == "weights" else (Workspace, "change")
    faultless = getattr(owner, what)

    def faulty(*given, **law):
        found = faultless(*given, **law)
        return found._replace(weights=1.0001 * found.weights) if wrong == "weights" else (1.0001 * found[0], found[1])

    with monkeypatch.context() as patch:
        patch.setattr(owner, what, faulty)
        found = answered(case)
    assert not (np.asarray(found.method) == np.asarray(right.method)).any()
    for i in range(COUNT):
        assert found[i].status == "solved" and judged(found[i]) <= 1e-9
        assert np.abs(found.a[i] - right.a[i]).max() <= 1e-9 * max(1.0, np.abs(right.a[i]).max())
