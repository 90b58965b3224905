"""Every record can be pickled and deep-copied: sent to another process, kept in a file, returned from a worker."""

from __future__ import annotations

import copy
import importlib
import inspect
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from copied import difference, instances

import rbd
from rbd.answers.analysis.sensitivity import StateOrigin
from rbd.cli.mechanism_report import report_mechanism

URDF = Path(__file__).parents[1] / "urdf"
WAYS: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda x: pickle.loads(pickle.dumps(x)),
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


def height(state: rbd.State) -> float:
    """A function of the state, for an event."""
    return float(state.q[2])


def fixed(state: rbd.State) -> np.ndarray:
    """A function of the configuration, for a constraint: one that a pickle can name."""
    return state.q[:1]


def errors(*asks: Callable[[], object]) -> Iterator[BaseException]:
    """What each of some questions raises."""
    for ask in asks:
        try:
            ask()
        except rbd.RbdError as error:
            yield error
        else:
            raise AssertionError("the question has an answer")


def robust_answers(box: rbd.Robot) -> Iterator[object]:
    """Proofs over sets, and what refutes them."""
    state, base = box.at(), [rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.2), friction=0.5)]
    pushes = rbd.robust.PushSet("box", [(0, 0, 0), (60, 0, 0)])
    refuted = rbd.robust.hold(state, base, pushes=pushes, mass={"box": 0.1})
    yield from (pushes, refuted, refuted.members[0], rbd.robust.hold(state, base, mass={"box": 0.1}))
    yield from (rbd.robust.push_limits(state, base, "box", (1, 0, 0)), rbd.robust.region(state, base))


def contact_answers() -> Iterator[object]:
    """States, torques, answers, errors, derivatives of robots in contact."""
    talos = rbd.load_robot("talos")
    box = rbd.load_robot(URDF / "box.urdf")
    state, soles = talos.standing(), talos.soles()
    held = rbd.hold(state, soles)
    push = rbd.ExternalForce("torso_2_link", (0.0, 80.0, 0.0))
    yield from (talos, talos.joints, talos.joints["leg_left_4_joint"], state, held, push, rbd.doctor(talos))
    motors = {"leg_left_4_joint": rbd.Motor(gear=100.0, rotor_inertia=1e-5, torque_speed=[(0.0, 300.0), (5.0, 0.0)])}
    yield from (motors["leg_left_4_joint"], talos.with_motors(motors))
    yield from (thing := rbd.Carried(2.0, ["gripper_left_base_link"]), talos.carrying(thing))
    yield from (held.uniqueness(), rbd.statics.Effort({"leg_left_4_joint": 2.0}, normal_force={"left_sole": (10.0, 900.0)}))
    yield state.frame("left_sole_link")
    for solver in (rbd.ProxQP(), rbd.ConeSolver()):
        solution = rbd.solve(state, held.tau, soles, external=push, solver=solver)
        assert str(solution)
        yield from (solver, solution, solution.uniqueness(), solution.derivatives())
    regions = [rbd.statics.support_region(state, soles, torque_limits=True), rbd.statics.zmp_region(state, soles)]
    yield from (*regions, rbd.statics.wrench_cone(state, soles), rbd.statics.support_region(state, soles[:1]))
    yield rbd.statics.push_limits(state, soles, "torso_2_link", np.eye(3))
    yield from robust_answers(box)
    assert all(map(str, regions))
    yield from (rbd.KKT(), rbd.solve(state, held.tau, talos.soles(friction=None), solver=rbd.KKT()))
    yield rbd.KKT().solve(rbd.gauss_problem(state, held.tau, talos.soles(friction=None)))
    yield rbd.solve(state, held.tau, soles).enclosure()
    many = rbd.solve_many(talos, np.tile(state.q, (3, 1)), None, held.tau, soles, friction=[0.5, 0.6, -1.0])
    assert str(many)
    yield many
    yield rbd.statics.hold_many(talos, state.q, soles)
    yield rbd.grid(robot=talos, friction=[0.3, 0.6], law=["a", "b"]) * rbd.sample(4, push=(0.0, 9.0))
    yield rbd.studies.compare_laws(state, held.tau, soles)
    yield rbd.studies.compare_solvers(state, held.tau, soles)
    pair = rbd.robots.merge_robots(talos, box)
    yield from (pair, pair.at())
    yield rbd.model.checked_model.CheckedModel(talos.model)
    yield from rbd.constraints.joint_limits(talos)
    yield from rbd.constraints.joint_frictions(talos)
    ground = rbd.CollisionContacts("ground", talos)
    yield from (ground, ground.points(state), ground.rows(state))
    stairs = rbd.Terrain.stairs(0.1, 0.3, 3)
    yield from (stairs, rbd.hold(state, talos.soles(on=rbd.Terrain.boxes([(-1, -1, -1), (1, 1, 0)]))))
    twice = [rbd.JointLock("one", "arm_left_4_joint", position=-1.0), rbd.JointLock("two", "arm_left_4_joint", position=-1.2)]
    with_pull = [rbd.constraints.Baumgarte(10.0).of(lock) for lock in twice]
    yield from with_pull
    yield rbd.FunctionConstraint("fixed", fixed)
    yield rbd.VelocityConstraint("turn", fixed)
    for ask in errors(
        lambda: rbd.hold(state, soles[:1]),
        lambda: rbd.inverse_dynamics(state, np.full(talos.nv, 0.1), soles),
        lambda: rbd.solve(state, held.tau, with_pull),
        lambda: talos.frame("left_sol"),
    ):
        if isinstance(ask, rbd.errors.CannotMove) or (isinstance(ask, rbd.NoSolution) and ask.problem is not None):
            yield ask.nearest()
        yield ask
    yield rbd.answers.solution.nearest_motion(rbd.gauss_problem(state, held.tau, with_pull))


def motions() -> Iterator[object]:
    """Trajectories, their settings, events and errors."""
    box = rbd.load_robot(URDF / "box.urdf")
    start = box.at(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]))
    floor = rbd.CollisionContacts("floor", box, friction=0.5)
    nudge = rbd.control.Push("box", (0.0, 3.0, 0.0), start=0.02, duration=0.05)
    fall = rbd.simulate(start, [floor], duration=0.25, step=5e-3, external=rbd.control.Pushes([nudge]), progress=False)
    assert fall.events
    yield from (fall, fall[0], nudge, rbd.control.Pushes([nudge]))
    corner = rbd.PointContact("corner", "box", friction=0.5, on=0.0)
    struck = rbd.impact(start.with_velocity(np.array([0.1, 0.0, -1.0, 0.0, 0.0, 0.0])), [corner], restitution=0.5)
    assert struck.energy_lost and str(struck)
    switch = rbd.simulation.Switch(on="corner")
    yield from (struck, switch, rbd.simulation.StateEvent(height, "height", then=switch))
    yield from (
        rbd.TimeStepping(),
        rbd.RungeKutta4(),
        rbd.DormandPrince8(),
        rbd.simulation.Projection(),
        rbd.constraints.Baumgarte(5.0),
    )
    arm = rbd.load_robot("panda", root="fixed")
    tau = np.zeros((2, arm.nu))
    yield from (
        rbd.control.HoldPosture(arm.at()),
        rbd.control.TorqueSchedule([0.0, 1.0], tau),
        rbd.control.ZeroOrderHold(rbd.control.HoldPosture(arm.at()), 0.01),
        rbd.control.TrackingController(rbd.motion.minimum_jerk(arm, [arm.at().q] * 2, [0.0, 0.02])),
    )
    posture = rbd.control.PostureTask(arm.at(), cost={"panda_joint1": 2.0})
    tasks = [
        *(posture, rbd.control.ComTask(np.ones(3)), rbd.control.FrameTask("panda_hand", np.eye(4))),
        *(rbd.control.MomentumTask(np.ones(6)), rbd.control.ForceTask("tip", np.ones(3))),
    ]
    yield from tasks
    yield from (task.terms(arm.at(), 0.0) for task in tasks)
    yield rbd.control.Reference(np.ones(3))
    yield rbd.control.ContactSchedule({"toe": [(0.0, 1.0)]})
    walk = rbd.control.Walk(rbd.load_robot("solo12"), 1, gait="trot")
    yield from (walk, walk.plan, walk.plan.footsteps[0], walk.gait)
    yield rbd.control.Balance(rbd.load_robot("g1"))
    yield rbd.control.capture_region(walk.state, walk.contacts, friction="inscribed")
    whole_body = rbd.control.WholeBodyController([posture])
    whole_body.accepted(rbd.control.AcceptedStep(arm.at(), 0.0, 0.01, {}))
    yield from (whole_body, whole_body.log)
    lifted, stands = rbd.ExternalForce("box", (0.0, 0.0, 1e4)), rbd.PointContact("stands", "box", friction=0.5, on=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.RelaxedLimitsWarning)
        yield rbd.control.step(start, [rbd.control.ComTask(np.ones(3))], [stands], external=[lifted])
    touch = rbd.control.ContactTouch(np.zeros(1), np.ones(1, bool), np.ones((1, 3)), ("toe:0",))
    yield from (touch, rbd.control.AcceptedStep(start, 0.1, 0.01, {"toe": touch}))
    lock = rbd.JointLock("lock", "panda_joint1", position=0.0)
    yield rbd.simulate(arm.at(), [lock], duration=0.02, step=0.01, progress=False)
    locks = [rbd.constraints.Baumgarte(9.0).of(rbd.JointLock(f"at {q}", "panda_joint1", position=q)) for q in (0.1, 0.2)]
    [cause] = errors(lambda: rbd.solve(arm.at(), np.zeros(arm.nu), locks))
    stopped = rbd.errors.SimulationStopped("no step", state=start, t=0.1, names=("floor",), trajectory=fall, cause=cause)
    assert stopped.problem is not None and stopped.contradiction is not None
    yield stopped


def measured() -> Iterator[object]:
    """Contact forces from measurements."""
    box = rbd.load_robot(URDF / "box.urdf")
    feet = [rbd.PointContact(name, "box", offset=(x, 0.0, 0.0), friction=0.5) for name, x in (("a", 0.1), ("b", -0.1))]
    noise = rbd.motion.SensorNoise(v=1e-3, a=0.1)
    found = rbd.estimate_forces(box.at(), np.zeros(6), feet, noise=noise)
    assert found.open and str(found) and found.deviations and found.contacts and found.corner_forces
    observer = rbd.motion.MomentumObserver(box, feet, bandwidth=5.0, torques=False)
    falls = rbd.simulate(box.at(), [], duration=0.02, step=0.01, progress=False)
    yield from (noise, found, *found.open, observer.run(falls), observer)


def identified() -> Iterator[object]:
    """Parameters from a motion of an arm, and derivatives by parameters."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
    motion = rbd.motion.minimum_jerk(
        arm, [np.zeros(2), np.array([1.0, -2.0]), np.array([-1.0, 1.0])], [0.0, 0.5, 0.9], rate=20.0
    )
    tau = [rbd.dynamics.inverse_dynamics(motion.state(i), motion.a[i]) for i in range(motion.n)]
    measured = rbd.motion.identification.MeasuredMotion(motion, np.array(tau))
    found = rbd.identify(measured)
    assert str(found) and found.open_bodies and found.bodies
    yield from (
        measured,
        found,
        found.base,
        rbd.motion.identification.excitation(motion),
        rbd.dynamics.regressor(motion.state(1), motion.a[1]),
    )
    derived = rbd.solve(motion.state(1), np.zeros(2), []).derivatives(parameters=("mass", "gravity"))
    yield from derived.parameters.values()


def built() -> Iterator[object]:
    """Models in memory: their parts, their texts, their robots."""
    solids = rbd.robots.Box((0.1, 0.2, 0.3), mass=1.0), rbd.robots.Sphere(0.1), rbd.robots.Cylinder(0.1, 0.2)
    solids += rbd.robots.Capsule(0.1, 0.2), rbd.robots.Plate((0.1, 0.2)), rbd.robots.Rod((0, 0, 0), (0, 0, 1), mass=1.0)
    solids += (rbd.robots.PointMass(1.0),)
    b = rbd.RobotBuilder("one", root="fixed")
    b.body("one", *solids)
    b.joint("pivot", "ground", "one")
    link = rbd.mechanism.Link("arm", "ground", (0.0, 0.0), ((0.1, 0.0),), 1.0)
    linkage = rbd.mechanism.Linkage("flat", "", ((0.0, 0.0),), (link,), {}, {}, 0.01)
    yield from (*solids, b, b.robot(), rbd.robots.LoopFile.of_text(b.loop_file()), link, linkage, linkage.robot())


def mechanisms() -> Iterator[object]:
    """What the analysis of loops and wheels returns."""
    four_bar = rbd.load_robot(URDF / "four_bar.urdf")
    unicycle = rbd.load_robot(URDF / "unicycle.urdf")
    yield from (*four_bar.loops(), *unicycle.wheels(), four_bar, unicycle)
    for robot in (four_bar, unicycle):
        report = report_mechanism(robot, next(iter(robot.postures.values()), robot.neutral()))
        assert str(report)
        yield from (report, report.state)
    state = report.state if not four_bar.loops() else four_bar.at(rbd.mechanism.assemble(four_bar.at()).q)
    moving = rbd.mechanism.velocity_partition(state, None, {"crank_joint": 1.0})
    rates = rbd.mechanism.acceleration_partition(four_bar.at(state.q, moving.v), None, {"crank_joint": 0.0})
    yield from (rbd.mechanism.assemble(four_bar.at()), moving, rates)
    yield rbd.mechanism.project_acceleration(four_bar.at(state.q, moving.v), np.ones(four_bar.nv))
    hanging = rbd.find_equilibrium(state)
    assert str(hanging) and str(hanging.linearised)
    yield rbd.simulation.floquet(hanging.state, period=0.01)
    yield from (hanging, hanging.linearised, *hanging.linearised.modes())
    yield from errors(
        lambda: rbd.find_equilibrium(rbd.load_robot(URDF / "box.urdf").at()), lambda: hanging.linearised.changed([1.0])
    )
    box = rbd.load_robot(URDF / "box.urdf")
    yield rbd.find_pose(box, {"box": (0.1, 0.2, 0.3)})
    yield from errors(lambda: rbd.find_pose(four_bar, {"coupler_tip": (9.0, 0.0, 9.0)}))
    yield rbd.mechanism.trace(state, joint="crank_joint", values=(state.q[0], state.q[0] + 0.2), steps=4)


def more_constraints() -> Iterator[object]:
    """One of each that no robot above has."""
    yield rbd.LineContact("edge", "box", half_length=0.1, friction=0.5)
    yield rbd.JointCoupling("gear", "a", "b", ratio=2.0)
    yield from (rbd.Speed(2.0), rbd.DrivenJoint("drive", "a", rbd.Speed(2.0, start=0.1)))
    yield rbd.KnifeEdge("blade", "box")
    yield rbd.RollingBall("ball", "box", radius=0.1)
    yield rbd.RollingDisk("disk", "box", radius=0.1)
    yield rbd.constraints.RollingBody("egg", "box", shape=(0.3, 0.2, 0.1))
    yield rbd.constraints.RollingOnRound("bowl", "box", radius=0.1, surface_radius=-0.5)
    yield rbd.PointContact("tip", "box", friction=0.5)
    yield rbd.SurfaceContact("palm", "box", half_lengths=(0.1, 0.1), on=rbd.Body("table", normal=(0.0, 0.6, 0.8)))
    for corners in ([[0.1, 0.2]], [[0.1, 0.2], [0.3, 0.1]], [[0.1, 0.2], [0.3, 0.1], [0.0, 0.0]]):
        yield rbd.constraints.Contact("corners", "box", corners=corners, friction=0.5)
    yield rbd.problem.NonNegative(3)
    yield rbd.problem.Product([rbd.problem.Free(1), rbd.problem.LineCone(0.1, 0.5)])
    yield rbd.problem.EllipticCone(0.5, 0.4)
    yield rbd.problem.UnevenCone(np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]), np.tile(np.eye(3), (2, 1, 1)), 0.5, dim=5)


def springs() -> Iterator[object]:
    """Force elements, what draws them, and an answer with them."""
    four_bar = rbd.load_robot(URDF / "four_bar.urdf")
    state, tip = four_bar.at(), "coupler_tip"
    elements = [
        rbd.Spring(tip, to=(0, 0, 3), stiffness=10.0, rest=1.0, axis=None),
        rbd.Damper(tip, to=(0, 0, 3), damping=1.0, axis=(0, 1, 0)),
        rbd.Bushing(tip, to=pin.SE3(np.eye(3), np.ones(3)), stiffness=2.0),
        rbd.JointSpring("crank_joint", stiffness=3.0),
        rbd.JointDamping({"crank_joint": 0.5}),
    ]
    yield from (*elements, elements[0].picture(state), rbd.solve(state, np.zeros(four_bar.nu), [], external=elements))


def reference_motions() -> Iterator[object]:
    """A motion that was made, one that was derived."""
    box = rbd.load_robot(URDF / "box.urdf")
    made = rbd.motion.minimum_jerk(box, [box.neutral(), box.neutral()], [0.0, 0.2])
    derived = rbd.Motion.of_arrays(box, made.t, made.q, noise=1e-6)
    report = rbd.check_motion(derived, ground="fit")
    yield rbd.motion.MotionDifference.of(derived, derived)
    yield rbd.motion.list_motions("dance.csv", box)
    yield rbd.studies.check_motions("dance.csv", robot=box, workers=0)
    yield rbd.motion.find_timing(made, contacts=report.lanes)
    assert str(report)
    yield from (made, derived, derived.derivation, report, report.lanes)
    yield from (report.settings, report.collisions, report.lanes.points, report.feet_faults)


def planar_chains() -> Iterator[object]:
    """Symbols, compiled functions once used, and numbers."""
    planar = pytest.importorskip("rbd.planar")
    chain = planar.Chain(2, lengths=[1.0, 0.8])
    equations = planar.dynamics(chain, masses=[1.0, 2.0], centres=[0.5, 0.4], inertias=[0.1, 0.1], gravity=9.81)
    assert np.isfinite(equations.inverse([0.1, 0.2], [0.0, 0.1], [0.3, 0.0])).all()
    assert np.isfinite(equations.forward([0.1, 0.2], [0.0, 0.1])).all()
    linear = equations.linearised([-np.pi / 2.0, 0.0])
    held = planar.constrained(planar.Chain(3), {2: 0})
    path = planar.minimum_jerk([1.2, 0.3], [0.5, 0.9], 1.0)
    motion = planar.endpoint_motion(chain, path)
    reach = planar.inverse(chain, [0.5, 0.9])
    yield from (chain, equations, linear, linear.modes(), held, path, motion, reach, motion.split, path.peaks, equations.bodies)
    yield from (held.split(), chain.ellipse([0.1, 0.9]), chain.angle_map("segment"), chain.numeric, planar.classify(chain))
    yield from (planar.inverse_path(chain, motion.x[:5]), planar.robot_coordinates(chain))
    yield chain.function(chain.position())


def friction_problems() -> Iterator[object]:
    """A friction problem, its answer, and answers of several solvers."""
    problem = next(rbd.audits.bench.humanoid_problems(1))
    yield from (problem, rbd.audits.bench.solve(problem), rbd.audits.bench.compare([problem], ["rbd, sparse Newton"]))


@pytest.fixture(scope="module")
def found() -> dict[type, list[Any]]:
    """{class: instances} of all questions above."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        questions = (
            contact_answers,
            motions,
            measured,
            identified,
            built,
            mechanisms,
            more_constraints,
            reference_motions,
            planar_chains,
            springs,
            friction_problems,
        )
        return instances([answer for ask in questions for answer in ask()])


KEPT = 3
"""So many instances of a class are copied."""
PUBLIC = ("rbd", "rbd.control", "rbd.simulation", "rbd.mechanism", "rbd.planar", "rbd.constraints", "rbd.problem", "rbd.model")
PUBLIC += (
    "rbd.answers.many",
    "rbd.answers.analysis",
    "rbd.robots",
    "rbd.studies",
    "rbd.robust",
    "rbd.statics",
    "rbd.motion",
    "rbd.constraints.forces",
)
PUBLIC += ("rbd.motion.identification", "rbd.audits.bench")


def public_classes() -> list[type]:
    """Classes that a user can name, but for protocols, executors, and warnings and errors, which `test_errors` sends."""
    out: dict[type, None] = {}
    for module in map(importlib.import_module, PUBLIC):
        for name in module.__all__:
            kind = getattr(module, name)
            if getattr(kind, "_is_protocol", False) or kind is rbd.problem.Cone:  # nothing is an instance of these alone
                continue
            if inspect.isclass(kind) and not issubclass(kind, BaseException | Enum | Executor):
                out[kind] = None
    return list(out)


PUBLIC_CLASSES = tuple(public_classes())


@pytest.mark.parametrize("kind", PUBLIC_CLASSES, ids=lambda kind: kind.__name__)
def test_every_public_class_has_a_real_instance_here(kind: type, found: dict[type, list[Any]]):
    """A new class of the package must be made by one of the questions above, used, and then copied below."""
    assert kind in found, f"no question above returns a {kind.__name__}: add one"


NEVER_COPIED = {"_Terms"}
"""Holds functions, and lives in lazy values alone, which copies of their owners leave out and compute again."""


def records(found: dict[type, list[Any]]) -> Iterator[Any]:
    """A few instances of each class that keeps data, errors among them."""
    for kind, some in found.items():
        if kind.__name__ in NEVER_COPIED:
            continue
        known = BaseException | float | rbd.model.checked_model.CheckedModel
        if is_dataclass(kind) or kind in PUBLIC_CLASSES or issubclass(kind, known):
            yield from some[:KEPT]


@pytest.mark.parametrize("way", WAYS)
def test_a_copy_is_the_same(found: dict[type, list[Any]], way: str):
    """Pickled, deep-copied, copied: all fields are equal, to the last bit; also after everything lazy was computed."""
    wrong = []
    for one in records(found):
        try:
            told = difference(one, WAYS[way](one), type(one).__name__)
        except Exception as error:
            told = f"{type(one).__name__}: {error!r:.200}"
        if told and not (way == "pickle" and isinstance(one, StateOrigin)):  # of which another test tells
            wrong.append(told)
    assert not wrong, "\n".join(wrong)


def test_a_copy_answers_the_same(talos: rbd.Robot):
    """A state that was sent gives the same answer, bit by bit; so do a held pose and a trajectory."""
    state, soles = talos.standing(), talos.soles()
    held = rbd.hold(state, soles)
    expected = rbd.solve(state, held.tau, soles).multipliers
    for copied in (ask(held) for ask in WAYS.values()):
        assert np.array_equal(copied.state.q, state.q) and not copied.state.q.flags.writeable
        assert copied.margins.friction == held.margins.friction
        assert np.array_equal(rbd.solve(copied.state, copied.tau, soles).multipliers, expected)


def test_q_keeps_its_last_bit(talos: rbd.Robot, rng: np.random.Generator):
    """Normalising a quaternion a second time may change it: a copy takes it as it is."""
    for _ in range(50):
        state = rbd.State(talos, pin.randomConfiguration(talos.model, -np.ones(talos.nq), np.ones(talos.nq)))
        for copied in (ask(state) for ask in (WAYS["pickle"], WAYS["copy"])):
            assert np.array_equal(copied.q, state.q) and np.array_equal(copied.M, state.M)


def test_an_error_keeps_what_it_carries(talos: rbd.Robot):
    """`NoSolution` with its problem, result and certificate, and its way to the nearest motion."""
    locks = [rbd.JointLock(name, "arm_left_4_joint", position=p) for name, p in (("one", -1.0), ("two", -1.2))]
    state = talos.standing()
    with pytest.raises(rbd.NoSolution) as caught, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rbd.solve(state, np.zeros(talos.nu), [rbd.constraints.Baumgarte(10.0).of(lock) for lock in locks])
    for ask in WAYS.values():
        sent = ask(caught.value)
        assert str(sent) == str(caught.value) and sent.problem.m == 2
        assert np.array_equal(sent.nearest().a, caught.value.nearest().a)


def test_an_error_of_a_motion_keeps_what_it_carries(talos: rbd.Robot):
    """`CannotHold` with its limits, certificate and what is missing, and its way to the nearest motion that is possible."""
    with pytest.raises(rbd.CannotHold) as caught:
        rbd.hold(talos.standing(), talos.soles()[:1])
    one = caught.value
    for ask in WAYS.values():
        sent = ask(one)
        assert str(sent) == str(one) and sent.limits == one.limits and sent.limits
        assert np.array_equal(sent.certificate.y, one.certificate.y) and np.array_equal(sent.missing.wrench, one.missing.wrench)
        assert np.array_equal(sent.nearest().a, one.nearest().a)


def test_a_copy_in_a_fresh_process(tmp_path: Path):
    """As a worker that was not forked finds it: nothing is imported there but what the pickle names."""
    box = rbd.load_robot(URDF / "box.urdf")
    state = box.at(np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]))
    solution = rbd.solve(state, [], [rbd.SurfaceContact("side", "box", half_lengths=(0.1, 0.1), friction=0.5)])
    assert str(solution)
    (tmp_path / "sent").write_bytes(pickle.dumps((state, solution)))
    code = "import pickle, sys; s, x = pickle.load(open(sys.argv[1], 'rb')); print(s.M.shape, x.status, x.rank)"
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "sent")], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "(6, 6) solved 6", done.stderr
