"""The prepared way with a fault put in: its own certificate notices, and the general way answers in its place.

Each fault changes one thing that the prepared way uses to find an answer: a sign, a buffer that still has the numbers of the
call before, the place of a contact, the configuration, the friction, the law. What judges the answer is left as it is. Without
a fault the prepared way answers the same problems, so that each test would fail if the fault were let through.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.prepared import constraint_dynamics, law_kernel
from rbd.answers.prepared.constraint_dynamics import Plan, prepared
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
    constraints: list
    draws: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    law: str = "coulomb"
    external: tuple[rbd.ExternalForce, ...] = ()

    @property
    def plan(self) -> Plan:
        """What `rbd.solve` uses."""
        found = prepared(self.robot, tuple(self.constraints))
        assert found is not None
        return found.plan(self.draws[0][0])

    def answers(self) -> list[rbd.Solution]:
        """One of each draw."""
        return [
            rbd.solve(
                rbd.State(self.robot, q, v), tau, self.constraints, law=self.law, external=self.external or None, check=False
            )
            for q, v, tau in self.draws
        ]


def corners(robot: rbd.Robot, friction: float) -> list:
    """The corners of its feet as points of their own."""
    return [
        rbd.PointContact(f"{foot.name} {i}", foot.frame, offset=foot.placement.act(x), friction=friction)
        for foot in robot.feet(friction, on=None)
        for i, x in enumerate(foot.corners)
    ]


def edges(robot: rbd.Robot, friction: float) -> list:
    """Edges under its feet, on ground that is inclined a little."""
    ground = rbd.Ground(normal=(0.06, 0.0, np.sqrt(1.0 - 0.06**2)))
    return [
        rbd.LineContact(foot.name, foot.frame, half_length=0.03, placement=foot.placement, friction=friction, on=ground)
        for foot in robot.feet(friction, on=None)
    ]


def rows_of_joints(robot: rbd.Robot, friction: float) -> list:
    """Feet, a lock, a coupling, dry friction, and a limit that is reached."""
    a, b, c, d = [joint.name for joint in robot.joints.values() if joint.nv == 1][-4:]
    stop = rbd.JointLimit("stop", d, lower=-np.inf, margin=100.0)
    more = [rbd.JointLock("lock", a), rbd.JointCoupling("gear", b, c, ratio=-0.7), rbd.JointFriction("dry", c, 0.4), stop]
    return [*robot.feet(friction, on=None), *more]


def moving(robot: rbd.Robot, friction: float) -> list:
    """Feet on ground that moves and turns."""
    motion = {"velocity": (0.1, 0.05, 0.0, 0.0, 0.0, 0.2), "acceleration": (0.3, 0.2, 0.1, 0.1, 0.0, 0.2)}
    return robot.feet(friction, on=rbd.Ground(about=(0.1, 0.2, 0.3), normal=(0.0, 0.0, 1.0), **motion))


def two_bodies(robot: rbd.Robot, friction: float) -> list:
    """Feet, and a point of a body against another one, which pushes and rubs."""
    links = [joint for joint in robot.joints.values() if joint.nv == 1]
    a, b = (robot.model.frames[robot.model.getFrameId(links[i].name)].name for i in (-1, len(links) // 2))
    return [*robot.feet(friction, on=None), rbd.PointContact("touch", a, on=rbd.Body(b, normal=(0.6, 0.0, 0.8)), friction=None)]


def case_of(name: str, kind: str, count: int = 6) -> Case:
    """Random draws of one robot, all answered by the prepared way, on constraints that are all new."""
    make, friction, noise, law = KINDS[kind]
    robot, rng = rbd.load_robot(name), np.random.default_rng(17)
    standing, constraints = robot.standing(), make(robot, friction)
    hold = rbd.hold(standing, robot.feet(0.8)).tau
    method = "Newton" if noise > 1.0 and friction is not None else "closed form"
    noise *= robot.mass / 90.0
    draws: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    frames = [foot.frame for foot in robot.feet()] if kind == "pushed" else []
    external = tuple(rbd.ExternalForce(frame, (3.0, -2.0, 1.0), (0.1, 0.2, 0.3), offset=(0.1, 0.0, 0.3)) for frame in frames)
    while len(draws) < count:
        bend = np.concatenate([np.zeros(6), 0.1 * rng.normal(size=robot.nv - 6)])
        q = pin.integrate(robot.model, standing.q, bend)
        free = 2 if "slide" in kind else 0  # tangents along which feet may move, and do not turn
        v = 0.1 * rng.normal(size=robot.nv)
        for _ in range(2):
            rows = [c.rows(rbd.State(robot, q, v)) for c in constraints]
            u = np.concatenate([r.velocity[free:] for r in rows])
            v -= np.linalg.lstsq(np.concatenate([r.J[free:] for r in rows]), u, rcond=None)[0]
        tau = hold + noise * rng.normal(size=robot.nu)
        s = rbd.solve(rbd.State(robot, q, v), tau, constraints, law=law, external=external or None, check=False)
        if s.solver == PREPARED and (method in s.method or make is not feet):
            draws.append((q, v, tau))
    return Case(robot, constraints, draws, law, external)


def feet(robot: rbd.Robot, friction: float | None) -> list:
    """As the robot has them."""
    return robot.feet(friction, on=None)


KINDS: dict[str, tuple[Callable[..., list], float | None, float, str]] = {
    "held": (feet, None, 1.0, "coulomb"),
    "sticking": (feet, 0.7, 0.5, "coulomb"),
    "slipping, Coulomb": (feet, 0.3, 40.0, "coulomb"),
    "slipping, convex": (feet, 0.3, 40.0, "convex"),
    "feet that slide": (feet, 0.2, 5.0, "coulomb"),
    "corners": (corners, 0.7, 0.5, "coulomb"),
    "edges": (edges, 0.6, 0.5, "coulomb"),
    "pushed": (feet, 0.7, 0.5, "coulomb"),
    "moving ground": (moving, 0.7, 0.5, "coulomb"),
    "two bodies": (two_bodies, 0.7, 0.5, "coulomb"),
    "joints": (rows_of_joints, 0.7, 1.0, "coulomb"),
}
Fault = Callable[[pytest.MonkeyPatch, Case], None]
NAMES = list(inspect.signature(law_kernel._answer).parameters)
"""Of the arguments of `law_kernel.answer`."""


class Changed:
    """`law_kernel` with another `answer`: its arguments are changed before, or what it writes after."""

    def __init__(self, before: Callable[[dict[str, Any]], None], after: Callable[[dict[str, Any]], None]) -> None:
        self.before, self.after = before, after

    def __getattr__(self, name: str) -> Any:
        return getattr(law_kernel, name)

    def answer(self, *given: Any) -> tuple[int, int, bool]:
        """As `law_kernel.answer`."""
        arguments = dict(zip(NAMES, given, strict=True))
        self.before(arguments)
        found = law_kernel.answer(*arguments.values())
        self.after(arguments)
        return found


def _nothing(arguments: dict[str, Any]) -> None:
    """Leave them."""


def _before(patch: pytest.MonkeyPatch, case: Case, change: Callable[[dict[str, Any]], None]) -> None:
    patch.setattr(case.plan, "_kernel", Changed(change, _nothing))


def _after(patch: pytest.MonkeyPatch, case: Case, change: Callable[[dict[str, Any]], None]) -> None:
    patch.setattr(case.plan, "_kernel", Changed(_nothing, change))


def sign_of_the_forces(patch: pytest.MonkeyPatch, case: Case) -> None:
    """Forces on the surroundings in place of those on the robot."""

    def wrong(given: dict[str, Any]) -> None:
        given["w"] *= -1.0

    _after(patch, case, wrong)


def _stale(patch: pytest.MonkeyPatch, case: Case, *names: str) -> None:
    last = {name: np.zeros(0) for name in names}

    def stale(given: dict[str, Any]) -> None:
        for name in names:
            now = given[name].copy()
            given[name][:] = last[name] if len(last[name]) else 0.0
            last[name] = now

    _after(patch, case, stale)


def forces_of_the_call_before(patch: pytest.MonkeyPatch, case: Case) -> None:
    """A buffer that was not renewed."""
    _stale(patch, case, "w")


def acceleration_of_the_call_before(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The other buffer that was not renewed."""
    _stale(patch, case, "a")


def both_of_the_call_before(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The whole answer to another state, right in itself."""
    _stale(patch, case, "a", "w")


def forces_a_millionth_too_large(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The map from the rows to the forces is wrong by a part in a million: still inside the cones."""

    def wrong(given: dict[str, Any]) -> None:
        given["w"] *= 1.0 + 1e-6

    _after(patch, case, wrong)


def one_force_that_is_no_number(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The first weight is NaN: what comes after it in the certificate must not hide that."""

    def wrong(given: dict[str, Any]) -> None:
        given["w"][0] = np.nan

    _after(patch, case, wrong)


def another_site(patch: pytest.MonkeyPatch, case: Case) -> None:
    """Contacts a millimetre off their places and turned by a milliradian, where the rows are made alone."""

    def wrong(given: dict[str, Any]) -> None:
        off = pin.SE3(pin.exp3(np.array([1e-3, 0.0, 0.0])), np.array([1e-3, 0.0, 0.0]))
        given["places"] = given["places"].copy()
        for place in given["places"]:
            moved = pin.SE3(place[:9].reshape(3, 3), place[9:12]) * off
            place[:12] = [*moved.rotation.ravel(), *moved.translation]

    _before(patch, case, wrong)


class OtherState:
    """Pinocchio, as the rows alone see it: at another q or v."""

    def __init__(self, change: Callable) -> None:
        self.change = change

    def __getattr__(self, name: str) -> Any:
        return getattr(pin, name)

    def crba(self, model: pin.Model, data: pin.Data, q: np.ndarray, *rest: Any) -> None:
        """As `pin.crba`."""
        pin.crba(model, data, self.change(model, q, q)[0], *rest)

    def nonLinearEffects(self, model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray) -> None:
        """As `pin.nonLinearEffects`."""
        pin.nonLinearEffects(model, data, *self.change(model, q, v))


def _with_other(patch: pytest.MonkeyPatch, change: Callable) -> None:
    patch.setattr(constraint_dynamics, "pin", OtherState(change))


def another_configuration(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The rows are those of q a tenth of a milliradian off in every joint."""
    _with_other(patch, lambda model, q, v: (pin.integrate(model, q, np.full(model.nv, 1e-4)), v))


def another_velocity(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The motion is that of v one per cent off."""
    _with_other(patch, lambda model, q, v: (q, 1.01 * v))


def torques_left_out(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The torque of the first motor is lost on the way."""

    def wrong(given: dict[str, Any]) -> None:
        given["generalised"] = given["generalised"].copy()
        given["generalised"][6] = 0.0

    _before(patch, case, wrong)


EVERYWHERE: list[Fault] = [
    sign_of_the_forces,
    forces_of_the_call_before,
    acceleration_of_the_call_before,
    both_of_the_call_before,
    forces_a_millionth_too_large,
    one_force_that_is_no_number,
    another_site,
    another_configuration,
    another_velocity,
    torques_left_out,
]


def another_friction(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The forces of a surface that is one per cent rougher."""

    def wrong(given: dict[str, Any]) -> None:
        given["mu"] = 1.01 * given["mu"]

    _before(patch, case, wrong)


def the_other_law(patch: pytest.MonkeyPatch, case: Case) -> None:
    """Forces are looked for under the other law."""

    def wrong(given: dict[str, Any]) -> None:
        given["coulomb"] = not given["coulomb"]

    _before(patch, case, wrong)


SLIPPING: list[Fault] = [another_friction, the_other_law]


def another_push(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The forces of the world are one per cent off."""

    def wrong(given: dict[str, Any]) -> None:
        given["loads"] = 1.01 * given["loads"]

    _before(patch, case, wrong)


def another_place(patch: pytest.MonkeyPatch, case: Case) -> None:
    """They act a millimetre off."""

    def wrong(given: dict[str, Any]) -> None:
        given["loads"] = given["loads"] + np.array([0.0] * 6 + [1e-3, 1e-3, 0.0])

    _before(patch, case, wrong)


def another_gear(patch: pytest.MonkeyPatch, case: Case) -> None:
    """Entries of the joints' rows are one per cent off."""

    def wrong(given: dict[str, Any]) -> None:
        given["gear"] = np.where(np.abs(given["gear"]) == 1.0, given["gear"], 1.01 * given["gear"])

    _before(patch, case, wrong)


def other_joints(patch: pytest.MonkeyPatch, case: Case) -> None:
    """Rows of joints are those of the joint before."""

    def wrong(given: dict[str, Any]) -> None:
        given["units"] = given["units"] - [0, 1]

    _before(patch, case, wrong)


def another_motion_of_the_ground(patch: pytest.MonkeyPatch, case: Case) -> None:
    """The ground accelerates by one per cent more, where the rows are made."""

    def wrong(given: dict[str, Any]) -> None:
        given["places"] = given["places"].copy()
        given["places"][:, 18:24] *= 1.01

    _before(patch, case, wrong)


def the_opposite_left_out(patch: pytest.MonkeyPatch, case: Case) -> None:
    """A body that is touched gets no force."""

    def wrong(given: dict[str, Any]) -> None:
        given["sites"] = given["sites"].copy()
        given["sites"][given["sites"][:, 5] > 0, 6] = -1

    _before(patch, case, wrong)


FAULTS = [
    ("moving ground", another_motion_of_the_ground),
    ("two bodies", the_opposite_left_out),
    *((kind, fault) for kind in KINDS for fault in EVERYWHERE),
    *((kind, fault) for kind in ("slipping, Coulomb", "slipping, convex") for fault in SLIPPING),
    ("feet that slide", another_friction),
    *(("pushed", fault) for fault in (another_push, another_place)),
    *(("joints", fault) for fault in (another_gear, other_joints)),
]


def judged(s: rbd.Solution) -> float:
    """The largest scaled residual by the problem in arrays, computed anew."""
    return residuals_of(s.problem, s.a, s.multipliers, s.weights, s.law).worst


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(("kind", "fault"), FAULTS, ids=lambda x: x if isinstance(x, str) else x.__name__)
def test_a_fault_is_noticed_and_the_general_way_answers(name, kind, fault, monkeypatch):
    """Never is a wrong answer returned as the prepared way's; what is returned is certified by the problem in arrays."""
    case = case_of(name if kind != "edges" else "talos", kind)
    with monkeypatch.context() as patch:
        fault(patch, case)
        answers = case.answers()
    for s in answers:
        assert s.solver != PREPARED, f"{s.method} let {fault.__name__} through"
        assert s.status == "solved" and judged(s) <= 1e-9


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kind", KINDS)
def test_without_a_fault_the_prepared_way_answers(name, kind):
    """The same draws: all by the prepared way, and right."""
    for s in case_of(name if kind != "edges" else "talos", kind).answers():
        assert s.solver == PREPARED and judged(s) <= 1e-9


def test_a_robot_that_moves_on_between_two_looks_is_noticed(monkeypatch):
    """Q of the certificate's `rnea` a tenth of a milliradian off: the bodies' placements that both share do not hide it."""
    case = case_of("talos", "held")
    right = pin.rnea

    def elsewhere(model, data, q, *rest):
        return right(model, data, pin.integrate(model, q, np.full(model.nv, 1e-4)), *rest)

    with monkeypatch.context() as patch:
        patch.setattr(pin, "rnea", elsewhere)
        assert all(s.solver != PREPARED for s in case.answers())
