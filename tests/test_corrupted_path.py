"""The prepared way with a fault put in: its own certificate notices, and the general way answers in its place.

Each fault changes one thing that the prepared way uses to find an answer: a sign, a buffer that still has the numbers of the
call before, the place of a contact, the configuration, the friction, the law. What judges the answer is left as it is. Without
a fault the prepared way answers the same problems, so that each test would fail if the fault were let through.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.prepared.contact_bodies import Workspace
from rbd.answers.prepared.contact_dynamics import ContactDynamics, prepared
from rbd.problem.residuals import residuals_of

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
PREPARED = "ContactDynamics"
"""`Solution.solver` of the prepared way."""
ROBOTS = ("talos", "solo12")
"""One on soles, one on points."""


@dataclass(frozen=True, eq=False)
class Case:
    """States of one robot, with torques that leave its feet still or make them slip."""

    robot: rbd.Robot
    contacts: list
    draws: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    law: str = "coulomb"

    @property
    def form(self) -> ContactDynamics:
        """The prepared form that `rbd.solve` uses."""
        found = prepared(self.robot, tuple(self.contacts))
        assert found is not None
        return found

    def answers(self) -> list[rbd.Solution]:
        """One of each draw."""
        return [
            rbd.solve(rbd.State(self.robot, q, v), tau, self.contacts, law=self.law, check=False) for q, v, tau in self.draws
        ]


def case_of(name: str, friction: float | None, noise: float, law: str = "coulomb", count: int = 6) -> Case:
    """Random draws of one robot, all answered by the prepared way, on contacts that are all new."""
    robot, rng = rbd.load_robot(name), np.random.default_rng(17)
    standing, contacts = robot.standing(), robot.feet(friction, on=None)
    hold = rbd.hold(standing, robot.feet(0.8)).tau
    noise *= robot.mass / 90.0
    draws: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    method = "Newton" if noise > robot.mass / 90.0 and friction is not None else "closed form"
    while len(draws) < count:
        bend = np.concatenate([np.zeros(6), 0.1 * rng.normal(size=robot.nv - 6)])
        q = pin.integrate(robot.model, standing.q, bend)
        J = np.concatenate([c.rows(rbd.State(robot, q)).J for c in contacts])
        v = 0.1 * rng.normal(size=robot.nv)
        for _ in range(2):
            v -= np.linalg.lstsq(J, J @ v, rcond=None)[0]
        tau = hold + noise * rng.normal(size=robot.nu)
        s = rbd.solve(rbd.State(robot, q, v), tau, contacts, law=law)
        if s.solver == PREPARED and method in s.method:
            draws.append((q, v, tau))
    return Case(robot, contacts, draws, law)


KINDS: dict[str, tuple[float | None, float, str]] = {
    "held": (None, 1.0, "coulomb"),
    "sticking": (0.7, 0.5, "coulomb"),
    "slipping, Coulomb": (0.3, 40.0, "coulomb"),
    "slipping, convex": (0.3, 40.0, "convex"),
}
Fault = Callable[[pytest.MonkeyPatch, ContactDynamics], None]


def _after(patch: pytest.MonkeyPatch, owner: object, name: str, change: Callable) -> None:
    """Have a function's result changed: `change(result, *args)`."""
    right = getattr(owner, name)
    patch.setattr(owner, name, lambda *args, **kwargs: change(right(*args, **kwargs), *args))


def sign_of_the_forces(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """Forces on the surroundings in place of those on the robot."""

    def wrong(a, space, *_):
        space.row_forces *= -1.0
        return a

    _after(patch, Workspace, "held", wrong)


def forces_of_the_call_before(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """A buffer that was not renewed."""
    last = [np.zeros(form.bodies.m)]

    def stale(a, space, *_):
        last.append(space.row_forces.copy())
        space.row_forces[:] = last[-2]
        return a

    _after(patch, Workspace, "held", stale)


def acceleration_of_the_call_before(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The other buffer that was not renewed."""
    last = [np.zeros(form.bodies.robot.nv)]

    def stale(a, *_):
        last.append(a.copy())
        return last[-2].copy()

    _after(patch, Workspace, "held", stale)


def both_of_the_call_before(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The whole answer to another state, right in itself."""
    last = [(np.zeros(form.bodies.robot.nv), np.zeros(form.bodies.m))]

    def stale(a, space, *_):
        last.append((a.copy(), space.row_forces.copy()))
        space.row_forces[:] = last[-2][1]
        return last[-2][0].copy()

    _after(patch, Workspace, "held", stale)


def another_site(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """A contact a millimetre off its place and turned by a milliradian, where the rows are made alone."""
    place = form.bodies.spare[-1].sites[0]
    off = pin.SE3(place[:9].reshape(3, 3), place[9:]) * pin.SE3(
        pin.exp3(np.array([1e-3, 0.0, 0.0])), np.array([1e-3, 0.0, 0.0])
    )
    place[:] = [*off.rotation.ravel(), *off.translation]


def _with_other(patch: pytest.MonkeyPatch, change: Callable) -> None:
    right = Workspace.held
    patch.setattr(Workspace, "held", lambda space, q, v, *rest: right(space, *change(space._model, q, v), *rest))


def another_configuration(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The rows are those of q a tenth of a milliradian off in every joint."""
    _with_other(patch, lambda model, q, v: (pin.integrate(model, q, np.full(model.nv, 1e-4)), v))


def another_velocity(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The motion is that of v one per cent off."""
    _with_other(patch, lambda model, q, v: (q, 1.01 * v))


def torques_left_out(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The torque of the last motor is lost on the way."""
    right = Workspace.held

    def wrong(space, q, v, generalised, *rest):
        less = generalised.copy()
        less[-1] = 0.0
        return right(space, q, v, less, *rest)

    patch.setattr(Workspace, "held", wrong)


EVERYWHERE: list[Fault] = [
    sign_of_the_forces,
    forces_of_the_call_before,
    acceleration_of_the_call_before,
    both_of_the_call_before,
    another_site,
    another_configuration,
    another_velocity,
    torques_left_out,
]


def weights_of_the_call_before(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """Corner forces that add up to another wrench."""
    last = [np.zeros(form.force_set.size)]

    def stale(found, *_):
        w, forces = found
        last.append(w.copy() if forces is not None else last[-1])
        return (w, None) if forces is None else (last[-2], form.G @ last[-2])

    _after(patch, form, "sticking", stale)


def weights_of_other_corners(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The map from forces to corner forces is wrong by a part in a million: still inside the cones."""
    patch.setattr(form, "_least_norm", (1.0 + 1e-6) * form._least_norm)


STICKING: list[Fault] = [weights_of_the_call_before, weights_of_other_corners]


def friction_in_newtons_method(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The forces of a surface that is one per cent rougher."""
    patch.setattr(form, "_newton", type(form._newton)(form.G, 1.01 * form.force_set.mu))


class _Changed:
    """Newton's method whose results are changed."""

    def __init__(self, newton, change: Callable) -> None:
        self.newton, self.change = newton, change

    def found(self, *args, coulomb: bool):
        return self.change(self.newton.found(*args, coulomb=coulomb))


class _OtherLaw:
    """Newton's method that takes the one law for the other."""

    def __init__(self, newton) -> None:
        self.newton = newton

    def found(self, *args, coulomb: bool):
        return self.newton.forces(*args, coulomb=not coulomb)


def the_other_law(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """Newton's method is asked for the other law."""
    patch.setattr(form, "_newton", _OtherLaw(form._newton))


def newtons_forces_of_the_call_before(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """Newton's result is that of another state."""
    last = []

    def stale(found):
        last.append(found)
        return last[-2] if len(last) > 1 else found._replace(wrench=2.0 * found.wrench, weights=2.0 * found.weights)

    patch.setattr(form, "_newton", _Changed(form._newton, stale))


def weights_that_are_not_of_the_wrench(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """Newton's weights are doubled, the wrench is not."""
    patch.setattr(form, "_newton", _Changed(form._newton, lambda found: found._replace(weights=2.0 * found.weights)))


def friction_of_the_set_before(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """Newton's method of contacts on the same bodies, a tenth smoother."""
    robot = form.bodies.robot
    other = prepared(robot, tuple(robot.feet(0.9 * form.force_set.mu[0], on=None)))
    assert other is not None and other.bodies is form.bodies
    patch.setattr(form, "_newton", other._newton)


def motion_of_the_call_before(patch: pytest.MonkeyPatch, form: ContactDynamics) -> None:
    """The change of the acceleration is that of another state."""
    last = [np.zeros(form.bodies.robot.nv)]

    def stale(change, *_):
        last.append(change[0].copy())
        return last[-2], change[1]

    _after(patch, Workspace, "change", stale)


SLIPPING: list[Fault] = [
    friction_of_the_set_before,
    friction_in_newtons_method,
    the_other_law,
    newtons_forces_of_the_call_before,
    weights_that_are_not_of_the_wrench,
    motion_of_the_call_before,
]
FAULTS = [
    *((kind, fault) for kind in KINDS for fault in EVERYWHERE),
    *(("sticking", fault) for fault in STICKING),
    *((kind, fault) for kind in ("slipping, Coulomb", "slipping, convex") for fault in SLIPPING),
]


def judged(s: rbd.Solution) -> float:
    """The largest scaled residual by the problem in arrays, computed anew."""
    return residuals_of(s.problem, s.a, s.multipliers, s.weights, s.law).worst


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(("kind", "fault"), FAULTS, ids=lambda x: x if isinstance(x, str) else x.__name__)
def test_a_fault_is_noticed_and_the_general_way_answers(name, kind, fault, monkeypatch):
    """Never is a wrong answer returned as the prepared way's; what is returned is certified by the problem in arrays."""
    case = case_of(name, *KINDS[kind])
    with monkeypatch.context() as patch:
        fault(patch, case.form)
        answers = case.answers()
    for s in answers:
        assert s.solver != PREPARED, f"{s.method} let {fault.__name__} through"
        assert s.status == "solved" and judged(s) <= 1e-9


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kind", KINDS)
def test_without_a_fault_the_prepared_way_answers(name, kind):
    """The same draws: all by the prepared way, and right."""
    for s in case_of(name, *KINDS[kind]).answers():
        assert s.solver == PREPARED and judged(s) <= 1e-9


def test_a_robot_that_moves_on_between_two_looks_is_noticed(monkeypatch):
    """Q of the certificate's `rnea` a tenth of a milliradian off: the bodies' placements that both share do not hide it."""
    case = case_of("talos", *KINDS["held"])
    right = pin.rnea

    def elsewhere(model, data, q, *rest):
        return right(model, data, pin.integrate(model, q, np.full(model.nv, 1e-4)), *rest)

    with monkeypatch.context() as patch:
        patch.setattr(pin, "rnea", elsewhere)
        assert all(s.solver != PREPARED for s in case.answers())
