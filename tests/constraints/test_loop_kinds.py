"""Rods, ropes, crosses and slides that close loops: motions and forces that are known."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.prepared.constraint_dynamics import prepared
from rbd.constraints.loop import KINDS
from rbd.mechanism import mobility
from rbd.model.checked_model import CheckedModel
from rbd.testing import check_constraint

G = 9.81
HERE = pin.SE3.Identity()


def bead(x: float = 0.6, z: float = -0.8, y_rate: float = 0.5) -> rbd.State:
    """A box of 2 kg with its centre 1 m from W's origin, by default."""
    return rbd.State(rbd.testing.box(mass=2.0), [x, 0, z, 0, 0, 0, 1], [0, y_rate, 0, 0, 0, 0])


def shafts(bend: float, *, kind: str = "universal") -> tuple[CheckedModel, rbd.LoopClosure]:
    """Two shafts on the ground whose axes meet at W's origin, at an angle, joined by a cross there."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    for name, turn in (("input", 0.0), ("output", bend)):
        joint = model.addJoint(0, pin.JointModelRX(), pin.SE3(pin.exp3(np.array([0.0, 0.0, turn])), np.zeros(3)), name)
        model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), np.diag([0.2, 0.3, 0.4])), HERE)
        model.addFrame(pin.Frame(f"{name}_fork", joint, 0, HERE, pin.FrameType.OP_FRAME))
    cross = rbd.LoopClosure("cross", "input_fork", "output_fork", kind=kind, axis=(0, 1, 0), axis_b=(0, 0, 1))
    return CheckedModel(model, passive=["output"], name="shafts"), cross


@pytest.mark.parametrize("bend", [0.2, 0.7, 1.2])
def test_the_speeds_of_cardans_joint(bend):
    """w2/w1 = cos b / (1 - sin^2 b cos^2 th), the driving pin at th from the plane of the axes: to 1e-12 over a turn."""
    robot, cross = shafts(bend)
    for th in np.linspace(-3.0, 3.0, 13):
        state = rbd.State(robot, [th, np.arctan2(np.sin(th), np.cos(th) * np.cos(bend))])
        assert abs(cross.rows(state).error[3]) < 1e-15
        found = rbd.mechanism.velocity_partition(state, [cross], {"input": 1.0}).v
        assert found[1] == pytest.approx(np.cos(bend) / (1.0 - (np.sin(bend) * np.cos(th)) ** 2), rel=1e-12)
    assert mobility(state, [cross]).finite == 1


def test_a_shaft_drives_another_through_a_cross():
    """Over a turn from rest the work of the torque is the kinetic energy of both shafts, and the cross stays closed."""
    robot, cross = shafts(0.7)
    motion = rbd.simulate(
        rbd.State(robot, [0.0, 0.0]), [cross], controller=lambda state, t: [0.5], duration=3.0, step=5e-3, progress=False
    )
    assert motion.q[-1, 0] > 5.0
    assert np.abs(motion.energy - motion.energy[0] - 0.5 * motion.q[:, 0]).max() < 1e-8
    assert max(np.abs(cross.rows(rbd.State(robot, q)).error).max() for q in motion.q) < 1e-12


def test_a_rod_carries_a_spherical_pendulum():
    """Its force is m (g cos + v^2 / l) along it, in answers and motions; length and energy stay."""
    state, rod = bead(), rbd.LoopClosure("rod", "universe", "box", kind="rod", length=1.0)
    expected = 2.0 * (G * 0.8 + 0.25) * np.array([-0.6, 0.0, 0.8])
    for solver in (rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()):
        assert np.abs(rbd.solve(state, [], [rod], solver=solver).forces["rod"] - expected).max() < 1e-8
    motion = rbd.simulate(state, [rod], duration=1.0, step=2e-3, progress=False)
    assert np.ptp(motion.energy) < 1e-9 and np.abs(np.linalg.norm(motion.q[:, :3], axis=1) - 1.0).max() < 1e-11


def flat_bar(model: pin.Model, parent: int, name: str, length: float, at: float, mass: float) -> int:
    """A uniform bar along x that turns about z, with a frame at its end; gravity is along -y."""
    model.gravity.linear = np.array([0.0, -G, 0.0])
    joint = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([at, 0.0, 0.0])), name)
    inertia = np.diag([1e-3, 1.0, 1.0]) * mass * length**2 / 12.0
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.array([0.5 * length, 0.0, 0.0]), inertia), HERE)
    model.addFrame(pin.Frame(f"{name}_tip", joint, 0, pin.SE3(np.eye(3), np.array([length, 0.0, 0.0])), pin.FrameType.OP_FRAME))
    return joint


def test_a_rod_is_a_coupler_of_vanishing_mass():
    """A four-bar whose coupler is a rod, against couplers of 1e-3, 1e-5, 1e-7 kg: the answers approach linearly."""
    states, gaps = {}, []
    for mass in (0.0, 1e-3, 1e-5, 1e-7):
        model = pin.Model()
        crank = flat_bar(model, 0, "crank", 0.5, 0.0, 1.0)
        if mass:
            flat_bar(model, crank, "coupler", 1.2, 0.5, mass)
        flat_bar(model, 0, "rocker", 0.8, 1.0, 2.0)
        robot = CheckedModel(model, passive=list(model.names)[2:], name="four bar")
        one = ("coupler_tip", "planar", {}) if mass else ("crank_tip", "rod", {"length": 1.2})
        loop = rbd.LoopClosure("loop", one[0], "rocker_tip", kind=one[1], **one[2])
        start = rbd.State(robot, [0.9, -0.6, 1.4] if mass else [0.9, 1.4])
        closed = rbd.mechanism.assemble(start, [loop], fixed={"crank": 0.9})
        v = rbd.mechanism.velocity_partition(rbd.State(robot, closed.q), [loop], {"crank": 2.0}).v
        states[mass] = rbd.solve(rbd.State(robot, closed.q, v), [0.7], [loop])
        assert mobility(rbd.State(robot, closed.q), [loop]).finite == 1
    for mass in (1e-3, 1e-5, 1e-7):
        other = states[mass]
        gap = [other.a[[0, 2]] - states[0.0].a, other.forces["loop"] - states[0.0].forces["loop"]]
        gaps.append(max(np.abs(each).max() for each in gap))
    assert gaps[0] < 0.1 and gaps[1] == pytest.approx(1e-2 * gaps[0], rel=0.1) and gaps[2] < 2e-4 * gaps[0]


def test_a_rope_is_slack_then_becomes_taut_by_an_impact():
    """Dropped from 0.5 m beside its nail it falls freely, is stopped along the rope at 1 m, and swings on at that length."""
    state, rope = bead(0.5, 0.0, 0.0), rbd.LoopClosure("rope", "universe", "box", kind="rope", length=1.0)
    assert not len(rope.rows(state)) and np.abs(rbd.solve(state, [], [rope]).a[2] + G) < 1e-12
    motion = rbd.simulate(state, [rope], duration=1.0, step=2e-3, progress=False)
    (event,) = motion.events
    drop = np.sqrt(0.75)
    assert event.t == pytest.approx(np.sqrt(2.0 * drop / G), abs=1e-6)
    assert event.speed == pytest.approx(np.sqrt(2.0 * G * drop) * drop, rel=1e-5)  # of its 4.12 m/s those along the rope
    far = np.linalg.norm(motion.q[:, :3], axis=1)
    assert far.max() < 1.0 + 1e-8 and np.abs(far[motion.t > event.t + 2e-3] - 1.0).max() < 1e-8
    after = motion.t > event.t + 4e-3
    assert np.abs(np.ptp(motion.energy[after])) < 1e-3
    bounced = rbd.simulate(state, [rope], duration=0.8, step=2e-3, restitution=1.0, progress=False)
    assert np.ptp(bounced.energy) < 1e-9 and np.linalg.norm(bounced.q[:, :3], axis=1).min() < 0.95


def test_a_rope_pulls_and_never_pushes():
    """Above its nail it lets go, below it carries; of a rope that loosens the force is zero."""
    rope = rbd.LoopClosure("rope", "universe", "box", kind="rope", length=1.0)
    above, below = bead(0.6, 0.8, 0.0), bead(0.6, -0.8, 0.0)
    assert np.abs(rbd.solve(above, [], [rope]).forces["rope"]).max() < 1e-12
    assert np.abs(rbd.solve(below, [], [rope]).forces["rope"] - 2.0 * G * 0.8 * np.array([-0.6, 0.0, 0.8])).max() < 1e-9
    with pytest.raises(rbd.InputError, match="'rope' can break or slip"):
        mobility(below, [rope])


def test_without_length_it_is_that_where_it_is_anchored():
    """In a motion that of its start; at one state there is no error; in a file that of the posture `assembled`."""
    rod = rbd.LoopClosure("rod", "universe", "box", kind="rod")
    assert rod.rows(bead()).error is None and rod.anchored(bead()).length == pytest.approx(1.0)
    motion = rbd.simulate(bead(), [rod], duration=0.2, step=2e-3, progress=False)
    assert np.abs(np.linalg.norm(motion.q[:, :3], axis=1) - 1.0).max() < 1e-11
    b = rbd.RobotBuilder("swing", root="fixed")
    for name, x in (("left", 0.0), ("right", 1.0)):
        b.body(name, rbd.robots.Rod((0, 0, 0), (0, 0, -1), mass=1.0))
        b.joint(f"{name}_joint", "ground", name, at=(x, 0, 0), axis=(0, 1, 0))
    b.loop("bar", ("left", (0, 0, -1)), ("right", (0, 0, -1)), kind="rod")
    b.loop("rope", ("left", (0, 0, -0.5)), ("right", (0, 0, -1)), kind="rope", length=2.0)
    b.posture("assembled", {"left_joint": 0.3, "right_joint": -0.2})
    robot = b.robot()
    bar, rope = robot.loops()
    X = [robot.at("assembled").frame(name).X_WF.translation for name in bar.frames]
    assert bar.length == pytest.approx(np.linalg.norm(X[1] - X[0]), rel=1e-15) and rope.length == 2.0
    assert np.abs(bar.rows(robot.at("assembled")).error) < 1e-15


def test_a_rod_whose_ends_coincide_is_refused():
    """At one state, where its length is taken, and in a file."""
    state = bead(0.0, 0.0)
    for kind in ("rod", "rope"):
        for length in (None, 1.0):
            loop = rbd.LoopClosure("link", "universe", "box", kind=kind, length=length)
            if (kind, length) == ("rope", 1.0):
                assert not len(loop.rows(state))  # slack
                continue
            with pytest.raises(rbd.InputError, match=f"ends of the {kind} 'link', 'universe' and 'box', coincide"):
                loop.rows(state)
    with pytest.raises(rbd.InputError, match="coincide"):
        rbd.LoopClosure("link", "universe", "box", kind="rod").anchored(state)


def spherical(model: pin.Model, parent: int, name: str, X: pin.SE3, length: float) -> int:
    """A bar on a ball joint, with a frame at its end."""
    joint = model.addJoint(parent, pin.JointModelSpherical(), X, name)
    model.appendBodyToJoint(joint, pin.Inertia(0.5, np.array([0.5 * length, 0, 0]), 0.05 * np.eye(3)), HERE)
    model.addFrame(pin.Frame(f"{name}_tip", joint, 0, pin.SE3(np.eye(3), np.array([length, 0, 0])), pin.FrameType.OP_FRAME))
    return joint


def test_the_mobility_of_an_rccc():
    """6 (4 - 1 - 4) + 1 + 2 + 2 + 2 = 1, through a tree of a hinge and two cylindrical joints and a cylindrical closure."""
    model, rng = pin.Model(), np.random.default_rng(2)
    last = 0
    for name, joints in (("crank", "R"), ("coupler", "RP"), ("rocker", "RP")):
        X = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        for letter in joints:
            joint = pin.JointModelRZ() if letter == "R" else pin.JointModelPZ()
            last = model.addJoint(last, joint, X, f"{name}_{letter}")
            X = HERE
        model.appendBodyToJoint(last, pin.Inertia.Random(), HERE)
    X = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    model.addFrame(pin.Frame("end", last, 0, X, pin.FrameType.OP_FRAME))
    robot = CheckedModel(model, passive=list(model.names)[2:], name="RCCC")
    q = rng.normal(size=robot.nq)
    on_ground = rbd.State(robot, q).frame("end").X_WF
    closing = model.copy()
    closing.addFrame(pin.Frame("post", 0, 0, on_ground, pin.FrameType.OP_FRAME))
    robot = CheckedModel(closing, passive=list(model.names)[2:], name="RCCC")
    found = mobility(rbd.State(robot, q), [rbd.LoopClosure("guide", "post", "end", kind="cylindrical")])
    # A cylindrical joint of the tree is two joints with a body between: 6 (6 - 1 - 6) + 1 + 4 + 2.
    assert (found.count.value, found.instantaneous, found.finite) == (1, 1, 1)


@pytest.mark.parametrize("kind", KINDS)
def test_each_closure_describes_its_motion_where_it_is_closed(kind):
    """J v and J a + J_dot v against derivatives of the error: to 1e-9."""
    talos = rbd.load_robot("talos")
    cross, link = {"axis_b": (1.0, 0.2, 0.0)}, {"length": 0.7}
    more = {"universal": cross, "rod": link, "rope": link | {"margin": 1.0}}.get(kind, {})
    rng = np.random.default_rng(5)
    start = talos.at(pin.integrate(talos.model, talos.standing().q, 0.1 * rng.normal(size=talos.nv)))
    loop = rbd.LoopClosure("loop", "arm_left_7_link", "arm_right_7_link", kind=kind, axis=(0.0, 0.1, 1.0), **more)
    closed = rbd.mechanism.assemble(start, [loop])
    report = check_constraint(loop, talos.at(closed.q, 0.5 * rng.normal(size=talos.nv)))
    assert report.rows == KINDS[kind] and max(report.jacobian, report.velocity, report.jdot_v) < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_one_state_and_many_by_every_form_and_solver_agree(kind):
    """The prepared form of what has one, the general one, many states, and each solver: the same motion and force."""
    talos = rbd.load_robot("talos")
    state = talos.standing()
    more = {"axis_b": (1.0, 0.2, 0.0)} if kind == "universal" else {}
    loop = rbd.LoopClosure("loop", "arm_left_7_link", "arm_right_7_link", kind=kind, axis=(0.0, 0.1, 1.0), **more)
    loop = loop.anchored(state)
    if kind not in ("rod", "rope"):
        loop = rbd.constraints.Baumgarte(frequency=3.0).of(loop)  # its frames are apart
    feet, tau = talos.soles(None), 0.1 * np.random.default_rng(0).normal(size=talos.nu)
    expected = rbd.solve(state, tau, [loop, *feet], solver=rbd.KKT() if kind != "rope" else rbd.ConeSolver())
    assert expected.residuals.stationarity.scaled < 1e-8
    for solver in (None, rbd.ProxQP(), rbd.ConeSolver()):
        found = rbd.solve(state, tau, [loop, *feet], solver=solver)
        assert np.abs(found.a - expected.a).max() < 1e-6 * max(1.0, np.abs(expected.a).max())
    many = rbd.solve_many(talos, np.array([state.q] * 2), np.zeros((2, talos.nv)), tau, [loop, *feet])
    assert np.abs(many.a - expected.a).max() < 1e-6 * max(1.0, np.abs(expected.a).max())
    if expected.rank == len(expected.multipliers):
        assert np.abs(many.forces["loop"][0] - expected.forces["loop"]).max() < 1e-5 * max(
            1.0, np.abs(expected.forces["loop"]).max()
        )


@pytest.mark.parametrize("frames", [("arm_left_7_link", "arm_right_7_link"), ("universe", "arm_left_7_link")])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("rod", "rope")])
def test_the_prepared_form_of_a_closed_loop_agrees_with_the_general_one(kind, frames):
    """Moving on it, beside a held foot: accelerations and forces to 1e-10 of the largest; rods take the general way alone."""
    talos = rbd.load_robot("talos")
    more = {"axis_b": (1.0, 0.2, 0.0)} if kind == "universal" else {}
    loop = rbd.LoopClosure("loop", *frames, kind=kind, axis=(0.0, 0.1, 1.0), **more)
    rng = np.random.default_rng(5)
    start = talos.at(pin.integrate(talos.model, talos.standing().q, 0.1 * rng.normal(size=talos.nv)))
    q = rbd.mechanism.assemble(start, [loop]).q
    foot = talos.soles(None, on=None)[:1]
    moving = rbd.mechanism.project_velocity(talos.at(q, 0.5 * rng.normal(size=talos.nv)), [loop, *foot])
    tau = 0.1 * rng.normal(size=talos.nu)
    form = prepared(talos, (loop, *foot))
    assert form is not None
    found = rbd.solve(moving, tau, [loop, *foot])
    general = rbd.solve_problem(rbd.gauss_problem(moving, tau, [loop, *foot]), solver=rbd.KKT())
    assert np.abs(found.a - general.a).max() < 1e-10 * np.abs(general.a).max()
    assert np.abs(found.forces["loop"] - general.forces["loop"]).max() < 1e-9 * max(1.0, np.abs(general.forces["loop"]).max())
    assert (found.solver, general.solver) == ("ContactDynamics", "KKT")


def test_kinds_of_a_loop_file():
    """A cross, a rod with a length and a rope in YAML; the keys of other kinds, and a cross without its axis, are refused."""
    ends = "frame_a: universe, frame_b: box"
    text = f"""
    loops:
      - {{name: cross, kind: universal, {ends}, axis: [1, 0, 0], axis_b: [0, 2, 0]}}
      - {{name: strut, kind: rod, {ends}, length: 0.3}}
      - {{name: tie, kind: rope, {ends}, length: 2}}
    """
    cross, strut, tie = rbd.robots.LoopFile.of_text(text).loops
    assert np.array_equal(cross.axis_b, [0.0, 1.0, 0.0]) and (strut.length, tie.length) == (0.3, 2.0)
    for entry, says in (
        ("kind: universal", "loop 'x': .*has axis_b = None; expected the axis of the second pin"),
        ("kind: point, length: 1", "has a key 'length'"),
        ("kind: rod, axis_b: [0, 1, 0]", "has a key 'axis_b'"),
        ("kind: rod, length: -1", "loop 'x': .*length > 0"),
    ):
        with pytest.raises(rbd.errors.ModelError, match=says):
            rbd.robots.LoopFile.of_text(f"loops: [{{name: x, {entry}, {ends}}}]")
