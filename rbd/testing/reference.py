"""Problems with their answers, for `rbd.testing.check_solver`: boxes, beads, joint limits, mechanisms, constructed ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.answers.least_constraint import gauss_problem
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.constraints.loop import LoopClosure
from rbd.constraints.nonholonomic import KnifeEdge
from rbd.constraints.rolling import RollingBall
from rbd.displayed import Displayed
from rbd.model.checked_model import CheckedModel
from rbd.model.external import ExternalForce
from rbd.model.state import State
from rbd.problem.cones import Bounds, Cone, Free, FrictionCone, NonNegative, Product
from rbd.problem.gauss_problem import GaussProblem
from rbd.problem.ground import Ground
from rbd.problem.rows import Rows

GRAVITY = 9.81
"""Standard gravity in Pinocchio [m/s2]."""


@dataclass(frozen=True, eq=False)
class ReferenceProblem(Displayed):
    """A least-constraint problem with its known answer, to test a solver.

    Attributes:
        name: What it is.
        problem: The arrays.
        a: {law: acceleration, shape (nv,)} in closed form; "any" for all laws.
        forces: {constraint: as `Solution.forces`}, where they are unique and the same under all laws.
        net_force: Sum of all contacts' forces in world axes, shape (3,) [N], where it is the same under all laws.
        source: Source of the answer.

    Example:
        >>> first = rbd.testing.reference_problems()[0]
        >>> first.name, {law: a.shape for law, a in first.a.items()}, first.source
        ('box in free fall', {'any': (6,)}, 'closed form')
    """

    name: str
    problem: GaussProblem
    a: Mapping[str, Array]
    forces: Mapping[str, Array] = field(default_factory=dict)
    net_force: Array | None = None
    source: str = "closed form"


def box(mass: float = 10.0, size: tuple[float, float, float] = (0.4, 0.4, 0.2)) -> CheckedModel:
    """A free box of uniform density, its one frame "box" at its centre; no file needed.

    Args:
        mass: [kg].
        size: Lengths along x, y, z [m].

    Example:
        >>> box = rbd.testing.box(mass=2.0, size=(0.3, 0.2, 0.1))
        >>> rbd.State(box, [0, 0, 1, 0, 0, 0, 1]).M.diagonal().round(5)
        array([2.     , 2.     , 2.     , 0.00833, 0.01667, 0.02167])
    """
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia.FromBox(mass, *size), pin.SE3.Identity())
    model.addBodyFrame("box", joint, pin.SE3.Identity(), 0)
    return CheckedModel(model, name="box")


def reference_problems() -> list[ReferenceProblem]:
    """Problems with known answers: at rest, bilateral, redundant, sticking, slipping, lifting, closed in loops, rolling.

    A solver skips, by its `reason_unsupported`, what it does not take.

    Example:
        >>> first = rbd.testing.reference_problems()[0]
        >>> print(first.name, rbd.solve_problem(first.problem).a)
        box in free fall [ 0.    0.   -9.81  0.    0.    0.  ]
    """
    return [*_boxes(), *_slipping(), *_mechanisms(), *_by_hand(), *_made_up()]


_SIZE = np.array([0.4, 0.4, 0.2])
_WEIGHT = 10.0 * GRAVITY  # of the box


def _box_problem(contacts: list[Constraint], push: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> GaussProblem:
    robot = box(10.0, (0.4, 0.4, 0.2))
    q = pin.neutral(robot.model)
    q[2] = 0.5 * _SIZE[2]
    return gauss_problem(State(robot, q), np.zeros(0), contacts, external=ExternalForce("box", push))


def _patch(friction: float | None, name: str = "floor", x: float = 0.0, half: float = 0.2) -> SurfaceContact:
    X_FP = pin.SE3(np.eye(3), np.array([x, 0.0, -0.1]))
    return SurfaceContact(name, "box", half_lengths=(half, 0.2), placement=X_FP, friction=friction)


def _corners(friction: float | None) -> list[Constraint]:
    signs = [(1, 1), (1, -1), (-1, -1), (-1, 1)]
    return [
        PointContact(f"corner{i}", "box", offset=(0.2 * x, 0.2 * y, -0.1), friction=friction) for i, (x, y) in enumerate(signs)
    ]


def _boxes() -> list[ReferenceProblem]:
    """A 10 kg box at rest: the floor pushes up with its weight, however the forces are shared."""
    still, up = {"any": np.zeros(6)}, np.array([0.0, 0.0, _WEIGHT])
    wrench = {"floor": np.r_[up, np.zeros(3)]}
    two_feet: list[Constraint] = [_patch(None, "left", -0.15, 0.05), _patch(None, "right", 0.15, 0.05)]
    two_rubbing: list[Constraint] = [_patch(0.6, "left", -0.15, 0.05), _patch(0.6, "right", 0.15, 0.05)]
    pull = 200.0
    lifted = np.array([0.0, 0.0, (pull - _WEIGHT) / 10.0, 0.0, 0.0, 0.0])
    return [
        ReferenceProblem("box in free fall", _box_problem([]), {"any": np.array([0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0])}),
        ReferenceProblem("box at rest on four corners", _box_problem(_corners(0.6)), still, net_force=up),
        ReferenceProblem("box at rest on four smooth corners", _box_problem(_corners(0.0)), still, net_force=up),
        ReferenceProblem("box at rest on a patch", _box_problem([_patch(0.6)]), still, wrench, up),
        ReferenceProblem("box at rest on a smooth patch", _box_problem([_patch(0.0)]), still, wrench, up),
        ReferenceProblem(
            "box held at a patch",
            _box_problem([_patch(None)], (70.0, 20.0, -30.0)),
            still,
            net_force=up + [-70, -20, 30],
        ),
        ReferenceProblem("box held at four corners, 12 rows of rank 6", _box_problem(_corners(None)), still, net_force=up),
        ReferenceProblem("box held by two feet, 12 rows of rank 6", _box_problem(two_feet), still, net_force=up),
        ReferenceProblem("box on two rubbing feet", _box_problem(two_rubbing), still, net_force=up),
        ReferenceProblem(
            "box on a patch, pulled up",
            _box_problem([_patch(0.6)], (0.0, 0.0, pull)),
            {"any": lifted},
            {"floor": np.zeros(6)},
        ),
        ReferenceProblem(
            "box on four corners, pulled up",
            _box_problem(_corners(0.6), (0.0, 0.0, pull)),
            {"any": lifted},
            net_force=np.zeros(3),
        ),
    ]


def _slipping() -> list[ReferenceProblem]:
    """The box pushed along x, mu = 0.6: at 30 N it sticks; at 80 N the convex law lifts it, Coulomb's makes it slide.

    Convex: f = N (-mu, 0, 1) with y . f = 0, so N = (m g + mu F) / (1 + mu^2) = 107.43 N and y_z = 0.933 m/s2.
    """
    mu, push = 0.6, 80.0
    N = (_WEIGHT + mu * push) / (1.0 + mu**2)
    a = {
        "convex": np.array([(push - mu * N) / 10.0, 0.0, (N - _WEIGHT) / 10.0, 0.0, 0.0, 0.0]),
        "coulomb": np.array([(push - mu * _WEIGHT) / 10.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    }
    sticks = {"any": np.zeros(6)}
    held = np.array([-30.0, 0.0, _WEIGHT])
    return [
        ReferenceProblem(
            "box pushed with 30 N on a patch sticks",
            _box_problem([_patch(mu)], (30.0, 0.0, 0.0)),
            sticks,
            net_force=held,
        ),
        ReferenceProblem(
            "box pushed with 30 N on corners sticks",
            _box_problem(_corners(mu), (30.0, 0.0, 0.0)),
            sticks,
            net_force=held,
        ),
        ReferenceProblem("box pushed with 80 N on a patch slips", _box_problem([_patch(mu)], (push, 0.0, 0.0)), a),
        ReferenceProblem("box pushed with 80 N on corners slips", _box_problem(_corners(mu), (push, 0.0, 0.0)), a),
    ]


_HERE = pin.SE3.Identity()


def _mechanisms() -> list[ReferenceProblem]:
    """Loops that swing, a sleigh, balls that roll: all of them moving."""
    swing, c, s, rate = 1.1, np.cos(1.1), np.sin(1.1), 0.6
    # N bars of 1 m and 1 kg on one coupler of 2 m and 2 kg: N/3 + 2 turns, N/2 + 2 weighs.
    turn = {n: -(n / 2 + 2) * GRAVITY * c / (n / 3 + 2) for n in (2, 3)}
    up = 0.5 * 2.0 * (turn[2] * c - rate**2 * s + GRAVITY)
    on_pin = np.array([(turn[2] / 3 + 0.5 * GRAVITY * c + c * up) / s, up, 0.0])
    signs = np.array([1.0, -1.0, 1.0, 1.0])
    loops = {n: _cranks(n, swing, rate) for n in (2, 3)}
    m, I, a, v, w = 2.0, 0.4, 0.3, 1.1, -0.9
    down = 5.0 / 7.0 * GRAVITY * np.sin(0.4)
    # In the ball's axes, which turn with 5 rad/s: the derivative of v's numbers is the acceleration less w x v.
    rolls = np.array([down, 0.0, 5.0 * 1.0, 0.0, down / 0.2, 0.0])
    carried = 2.0 * GRAVITY * np.array([5.0 / 7.0 * np.cos(0.4) * np.sin(0.4), 0.0, 1.0 - 5.0 / 7.0 * np.sin(0.4) ** 2])
    return [
        ReferenceProblem("four-bar swinging", loops[2], {"any": turn[2] * signs[:3]}, {"crank 1": on_pin}),
        ReferenceProblem("three cranks on one coupler, 4 rows of rank 3", loops[3], {"any": turn[3] * signs}),
        ReferenceProblem(
            "Chaplygin's sleigh",
            _sleigh(m, I, a, v, w),
            {"any": np.array([a * w**2, 0.0, -m * a * v * w / (I + m * a**2)])},
            source="closed form [Bloch2003]",
        ),
        *[
            ReferenceProblem(
                f"ball rolling down an incline, {how}",
                _rolling(friction),
                {"any": rolls},
                net_force=carried,
            )
            for how, friction in (("held", None), ("by friction", 0.5))
        ],
    ]


def _cranks(n: int, angle: float, rate: float) -> GaussProblem:
    """N parallel cranks on one coupler, the first in the tree and the others by loops; gravity along -y."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -GRAVITY, 0.0])

    def bar(parent: int, name: str, length: float, x: float) -> int:
        joint = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), name)
        rod = np.diag([0.01, 1.0, 1.0]) * length**3 / 12.0
        model.appendBodyToJoint(joint, pin.Inertia(length, np.array([0.5 * length, 0.0, 0.0]), rod), _HERE)
        return joint

    def mark(joint: int, name: str, x: float) -> None:
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), pin.FrameType.OP_FRAME))

    coupler = bar(bar(0, "crank", 1.0, 0.0), "coupler", 2.0, 1.0)
    loops: list[Constraint] = []
    for i in range(1, n):
        at = 2.0 * i / (n - 1)
        mark(coupler, f"on coupler {i}", at)
        mark(bar(0, f"crank {i}", 1.0, at), f"tip {i}", 1.0)
        loops.append(LoopClosure(f"crank {i}", f"tip {i}", f"on coupler {i}", kind="planar"))
    signs = np.r_[1.0, -1.0, np.ones(n - 1)]
    robot = CheckedModel(model, passive=list(model.names)[1:], name="cranks")
    return gauss_problem(State(robot, angle * signs, rate * signs), np.zeros(0), loops)


def _sleigh(m: float, I: float, a: float, v: float, w: float) -> GaussProblem:  # noqa: E741
    """A body on a planar joint with a knife edge at its origin, its centre of mass a ahead."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPlanar(), _HERE, "plane")
    model.appendBodyToJoint(joint, pin.Inertia(m, np.array([a, 0.0, 0.0]), np.diag([0.1, 0.1, I])), _HERE)
    model.addFrame(pin.Frame("sleigh", joint, 0, _HERE, pin.FrameType.OP_FRAME))
    q = np.array([0.4, -0.2, np.cos(0.8), np.sin(0.8)])
    state = State(CheckedModel(model, passive=["plane"], name="sleigh"), q, np.array([v, 0.0, w]))
    return gauss_problem(state, np.zeros(0), [KnifeEdge("blade", "sleigh")])


def _rolling(friction: float | None) -> GaussProblem:
    """A solid ball of 2 kg and 0.2 m, rolling at 1 m/s down a plane of 0.4 rad in the ball's axes."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), _HERE, "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(2.0, 0.2), _HERE)
    model.addFrame(pin.Frame("ball", joint, 0, _HERE, pin.FrameType.OP_FRAME))
    R = pin.exp3(np.array([0.0, 0.4, 0.0]))  # x downhill, z the normal
    q = pin.SE3ToXYZQUAT(pin.SE3(R, 0.2 * R[:, 2]))
    state = State(CheckedModel(model, name="ball"), q, np.array([1.0, 0.0, 0.0, 0.0, 5.0, 0.0]))
    floor = RollingBall("floor", "ball", radius=0.2, on=Ground(point=(0.0, 0.0, 0.0), normal=R[:, 2]), friction=friction)
    return gauss_problem(state, np.zeros(0), [floor])


def _by_hand() -> list[ReferenceProblem]:
    """A bob on a rod, a bead on a hill, a joint at its limit and with dry friction: arrays without a robot."""
    m, l, speed, angle = 2.0, 0.5, 3.0, 0.7
    out, along = np.array([np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), -np.sin(angle)])
    weight, M = np.array([0.0, -m * GRAVITY]), m * np.eye(2)

    def radial(v: float, cone: Cone) -> Rows:
        return Rows("radial", out[None], np.array([v**2 / l]), cone)  # d2|x|/dt2 = n . a + |v|^2 / l

    def ride(v: float) -> tuple[Array, Array]:
        """Acceleration and radial force while the distance stays."""
        return along * (along @ weight) / m - out * v**2 / l, np.array([-out @ weight - m * v**2 / l])

    a_rod, f_rod = ride(speed)
    slow = 0.5
    a_hill, f_hill = ride(slow)
    one = np.ones((1, 1))

    def stop(push: float, cone: Cone, feedback: float = 0.0, bias: float = 0.0) -> GaussProblem:
        rows = Rows("stop", one, np.array([bias]), cone, feedback=np.array([feedback]))
        return GaussProblem(2.0 * one, np.array([push]), [rows])

    def moving(v: float) -> GaussProblem:
        return GaussProblem(2.0 * one, np.array([3.0]), [Rows("rub", one, np.zeros(1), rub, velocity=np.array([v]))])

    unit = NonNegative(1)
    rub = Bounds(-5.0, 5.0)  # type: ignore[arg-type]
    mixed = Rows("mixed", np.eye(2), np.zeros(2), Product([unit, Free(1)]))
    return [
        ReferenceProblem(
            "bob on a turning rod: J_dot v",
            GaussProblem(M, weight, [radial(speed, Free(1))]),
            {"any": a_rod},
            {"radial": f_rod},
        ),
        ReferenceProblem(
            "bead riding over a hill: J_dot v",
            GaussProblem(M, weight, [radial(slow, unit)]),
            {"any": a_hill},
            {"radial": f_hill},
        ),
        ReferenceProblem(
            "bead leaving a hill",
            GaussProblem(M, weight, [radial(speed, unit)]),
            {"any": weight / m},
            {"radial": np.zeros(1)},
        ),
        ReferenceProblem("joint pushed into its stop", stop(-6.0, unit), {"any": np.zeros(1)}, {"stop": np.array([6.0])}),
        ReferenceProblem("joint pushed off its stop", stop(6.0, unit), {"any": np.array([3.0])}, {"stop": np.zeros(1)}),
        ReferenceProblem(
            "held joint with feedback",
            stop(1.0, Free(1), feedback=0.25),
            {"any": np.array([-0.25])},
            {"stop": np.array([-1.5])},
        ),
        ReferenceProblem(
            "stop with feedback and J_dot v",
            stop(-6.0, unit, 0.5, -2.0),
            {"any": np.array([1.5])},
            {"stop": np.array([9.0])},
        ),
        ReferenceProblem(
            "stop and held joint in one",
            GaussProblem(np.eye(2), np.array([4.0, 7.0]), [mixed]),
            {"any": np.array([4.0, 0.0])},
            {"mixed": np.array([0.0, -7.0])},
        ),
        ReferenceProblem("dry friction sticks", stop(3.0, rub), {"any": np.zeros(1)}, {"stop": np.array([-3.0])}),
        ReferenceProblem("dry friction slips", stop(8.0, rub), {"any": np.array([1.5])}, {"stop": np.array([-5.0])}),
        ReferenceProblem("dry friction brakes", moving(0.3), {"any": np.array([-1.0])}, {"rub": np.array([-5.0])}),
        ReferenceProblem("dry friction brakes the other way", moving(-0.3), {"any": np.array([4.0])}, {"rub": np.array([5.0])}),
    ]


def _made_up() -> list[ReferenceProblem]:
    """Random arrays built backwards from their answer: a, f and c first, then rhs = M a - J^T f, bias = c - J a."""
    rng = np.random.default_rng(7)
    mu = 0.5
    facet = np.array([-1.0, 0.0, mu])  # inward normal of the first facet; of the cone too, where they touch
    slides = np.array([-0.7, 0.0, 0.0])  # Coulomb's law: against the force, and it stays down
    modes: dict[str, tuple[Cone, Array, Array]] = {
        "sticks": (FrictionCone(mu), np.array([0.2, -0.1, 1.0]), np.zeros(3)),
        "slips": (FrictionCone(mu), np.array([mu, 0.0, 1.0]), 0.7 * facet),
        "breaks": (FrictionCone(mu), np.zeros(3), np.array([0.1, 0.2, 1.0])),
        "touches": (NonNegative(2), np.array([1.5, 0.0]), np.array([0.0, 0.4])),
        "holds": (Free(3), np.array([1.0, -2.0, 0.5]), np.zeros(3)),
    }

    def made(name: str, nv: int, which: list[str], law: str, repeat: bool = False) -> ReferenceProblem:
        A, a = rng.normal(size=(nv, nv)), rng.normal(size=nv)
        M, rows, pull, forces = A @ A.T + np.eye(nv), [], np.zeros(nv), {}
        for label in which:
            cone, f, c = modes[label]
            c = slides if law == "coulomb" and label == "slips" else c
            J, feedback = rng.normal(size=(cone.dim, nv)), rng.normal(size=cone.dim)
            rows.append(Rows(label, J, c - J @ a - feedback, cone, feedback=feedback))
            pull, forces[label] = pull + J.T @ f, f
        if repeat:  # a second copy of the first constraint, in other axes: the force may be shared in any way
            Q, r = np.linalg.qr(rng.normal(size=(3, 3)))[0], rows[0]
            rows.append(Rows("again", Q @ r.J, Q @ r.bias, r.cone, feedback=Q @ r.feedback))
            forces = {}
        if law != "any":
            forces = {}  # the rows are independent, so a determines them; under the other law they differ
        return ReferenceProblem(name, GaussProblem(M, M @ a - pull, rows), {law: a}, forces, source="built from its answer")

    return [
        made("made up, held", 7, ["holds"], "any"),
        made("made up, held twice: 6 rows of rank 3", 7, ["holds"], "any", repeat=True),
        made("made up, sticking and breaking", 9, ["sticks", "breaks", "touches", "holds"], "any"),
        made("made up, all at once", 14, ["sticks", "slips", "breaks", "touches", "holds"], "convex"),
        made("made up, large", 40, ["sticks", "slips", "breaks", "touches", "holds"], "convex"),
        made("made up, all at once, Coulomb", 14, ["sticks", "slips", "breaks", "touches", "holds"], "coulomb"),
        made("made up, large, Coulomb", 40, ["sticks", "slips", "breaks", "touches", "holds"], "coulomb"),
    ]
