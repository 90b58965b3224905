"""RobotBuilder: the same robot in memory and from its saved files, all kinds of parts, and faults refused by name."""

from __future__ import annotations

import copy
import os
import pickle
import stat
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import ModelError, ModelWarning
from rbd.mechanism import Link, Linkage, assemble
from rbd.robots import Box, Capsule, LoopFile, PointMass, RobotBuilder, Rod, Sphere


def zoo() -> RobotBuilder:
    """Each kind of joint, of body, of loop and of wheel, names that YAML and XML must quote."""
    b = RobotBuilder("zoo & co", root="fixed", about="One of each -- <all> & more.")
    b.body("ground", Box((1, 1, 0.1)))
    b.body("turns", Rod((0, 0, 0), (0.5, 0, 0), mass=1.0), PointMass(0.5, at=(0.5, 0, 0)))
    b.body("spins", mass=2.0, com=(0.1, 0.2, 0.3), inertia=(0.1, 0.01, 0.02, 0.2, 0.03, 0.25))
    b.body("slides", Sphere(0.1, density=1000.0), Box((0.1, 0.1, 0.1), at=(1, 0, 0)))
    b.body("null", Capsule(0.05, 0.3, mass=1.0, rpy=(0.3, 0.2, 0.1)))
    b.body("glides", mass=1.0, inertia=np.diag([0.1, 0.1, 0.1]))
    b.body("floats", mass=1.0, inertia=(0.1, 0.1, 0.1))
    b.body("rests", mass=1.0, inertia=(0.1, 0.1, 0.1))
    b.joint("a", "ground", "turns", axis=(0, 2, 0), limits=(-1.5, 2), motor=True, effort=30.0, speed=4.0, armature=0.01)
    b.joint("b: #1", "turns", "spins", "continuous", at=(0.5, 0, 0), rpy=(0.1, 0.2, 0.3), axis=(1, 1, 1), motor=True)
    b.joint("c", "ground", "slides", "prismatic", at=(0, 1, 0), axis=(1, 0, 0), limits=(0, 1))
    b.joint("d", "slides", "null", "ball", at=(0, 0, -0.2))
    b.joint("e", "ground", "glides", "planar", rpy=(0.1, 0, 0))
    b.joint("f", "ground", "floats", "free", at=(3, 0, 0))
    b.joint("g", "turns", "rests", "fixed", at=(0.1, 0, 0))
    b.frame("tip 'x'", "spins", (0.2, 0, 0), rpy=(0, 0, 1))
    b.frame("corner", "ground", (0.5, 0.5, 0))
    b.loop("pin", "tip 'x'", ("null", (0, 0, -0.2)), kind="point")
    b.loop("hinge", ("turns", (0, 0, 0)), "slides", kind="revolute", axis=(0, 0, 3))
    b.loop("weld", "floats", "corner", kind="rigid")
    b.loop("flat", "turns", "floats", kind="planar", axis=(0, 1, 0))
    b.coupling("gear", "a", "c", ratio=-2.0, offset=0.1)
    b.wheel("wheel", "spins", radius=0.2, axis=(0, 1, 0))
    b.wheel("disk", "turns", kind="rolling_disk", radius=0.3)
    b.wheel("ball", "floats", kind="rolling_ball", radius=0.4)
    b.wheel("skate", "glides", kind="knife_edge", direction=(0, 1, 0))
    b.posture("true", {"a": 0.3, "b: #1": -1.0, "d": (0, 0, 0, 1), "e": [1.0, 2.0, 0.6, 0.8]})
    return b


def same(one: rbd.Robot, other: rbd.Robot) -> None:
    """Two robots have the same numbers bit by bit, names, motors, postures, loops and wheels."""
    assert one.model == other.model and one.passive == other.passive and one.root == other.root
    assert one.postures.keys() == other.postures.keys()
    assert all(np.array_equal(q, other.postures[name]) for name, q in one.postures.items())
    assert str((one.loops(), one.wheels())) == str((other.loops(), other.wheels()))


@pytest.mark.filterwarnings("ignore::rbd.errors.ModelWarning")
def test_the_robot_is_that_of_its_saved_files(tmp_path: Path) -> None:
    """Each kind of part; the loop file goes beside it, and saving again gives the same files."""
    b = zoo()
    robot = b.robot()
    path = b.save(tmp_path / "zoo.urdf")
    assert path == tmp_path / "zoo.urdf" and sorted(os.listdir(tmp_path)) == ["zoo.loops.yaml", "zoo.urdf"]
    file = rbd.load_robot(path)
    same(robot, file)
    assert (robot.name, robot.nq, robot.nv, robot.nu) == ("zoo & co", 1 + 2 + 1 + 4 + 4 + 7, 1 + 1 + 1 + 3 + 3 + 6, 2)
    assert robot.effort_limit.tolist() == [30.0, np.inf] and robot.joints["a"].speed == 4.0
    assert [len(found) for found in (robot.loops(), robot.wheels())] == [5, 4]
    assert repr(b) == "RobotBuilder('zoo & co', root='fixed', 8 bodies, 7 joints, 4 loops, 1 couplings, 4 wheels)"
    texts = [each.read_text() for each in sorted(tmp_path.iterdir())]
    copy.deepcopy(b).save(tmp_path / "zoo.urdf")
    pickle.loads(pickle.dumps(b)).save(tmp_path / "zoo.urdf")
    assert texts == [each.read_text() for each in sorted(tmp_path.iterdir())]
    again = pickle.loads(pickle.dumps(robot))
    same(again, robot)


def test_numbers_arrive_as_they_were_given(rng: np.random.Generator) -> None:
    """Masses, centres, inertias and places in the model are those of the call, to the last bit; a number has 17 digits."""
    b = RobotBuilder("exact", root="fixed")
    m, com, at = (float(x) for x in rng.uniform(1, 2, 1)), rng.normal(size=3), rng.normal(size=3)
    mass = next(m)
    inertia = np.diag(rng.uniform(1.0, 1.5, 3)) + 1e-3 * (np.ones((3, 3)) - np.eye(3)) * rng.uniform()
    b.body("one", mass=mass, com=com, inertia=inertia)
    b.joint("j", "ground", "one", at=at, axis=(0, 0, 1))
    model = b.robot().model
    assert model.inertias[1].mass == mass and np.array_equal(model.inertias[1].lever, com)
    assert np.array_equal(model.inertias[1].inertia, inertia) and np.array_equal(model.jointPlacements[1].translation, at)


@pytest.mark.filterwarnings("ignore::rbd.errors.ModelWarning")
def test_a_ball_joint_and_the_others_move_as_pinocchios(rng: np.random.Generator) -> None:
    """The model that Pinocchio's own functions build joint by joint has the same M and bias."""
    b = RobotBuilder("three", root="fixed")
    X = [pin.SE3(pin.rpy.rpyToMatrix(*rng.normal(size=3)), rng.normal(size=3)) for _ in range(3)]
    kinds = {"ball": pin.JointModelSpherical(), "prismatic": pin.JointModelPrismaticUnaligned(0.6, 0.0, 0.8)}
    kinds["revolute"] = pin.JointModelRevoluteUnaligned(0.0, 0.6, 0.8)
    by_hand, parent = pin.Model(), "ground"
    for i, ((kind, joint), place) in enumerate(zip(kinds.items(), X, strict=True)):
        solid = Box((0.1, 0.2, 0.4), mass=1.0 + i, at=(0.1, 0.0, 0.2), rpy=(0.1, 0.2, 0.3))
        b.body(f"link_{i}", solid)
        axis = {"prismatic": (0.6, 0, 0.8), "revolute": (0, 0.6, 0.8)}.get(kind, (0, 0, 1))
        b.joint(f"j_{i}", parent, f"link_{i}", kind, at=place.translation, rpy=pin.rpy.matrixToRpy(place.rotation), axis=axis)
        parent = f"link_{i}"
        by_hand.addJoint(i, joint, place, f"j_{i}")
        of = solid.mass_properties()
        by_hand.appendBodyToJoint(i + 1, pin.Inertia(of.mass, of.lever, of.inertia), pin.SE3.Identity())
    robot, data = b.robot(), by_hand.createData()
    q, v = pin.integrate(by_hand, pin.neutral(by_hand), rng.normal(size=5)), rng.normal(size=5)
    state = robot.at(q, v)
    for shapes in (robot.visual_model, robot.collision_model):  # where the solids are, beyond a ball joint too
        for shape in shapes.geometryObjects:
            X = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.1, 0.0, 0.2]))
            assert shape.placement.isApprox(X, 1e-12) and f"link_{shape.parentJoint - 1}_0" == shape.name
        assert shapes.ngeoms == 3
    assert np.allclose(state.M, pin.crba(by_hand, data, q), atol=1e-13)
    assert np.allclose(state.h, pin.nonLinearEffects(by_hand, data, q, v), atol=1e-12)


def test_planar_roots_and_gravity() -> None:
    """`plane` is kept in the loop file; `gravity` is that of the robot."""
    b = RobotBuilder("hopper", root="planar", plane="xz")
    b.body("hopper", Sphere(0.1, mass=1.0))
    robot = b.robot(gravity=(0, 0, -1.62))
    assert robot.gravity.tolist() == [0.0, 0.0, -1.62] and robot.root == "planar"
    assert "plane: xz" in b.loop_file()
    fall = rbd.solve(robot.at(), []).a
    assert np.allclose(fall, [0.0, -1.62, 0.0], atol=1e-14)  # along z, its second coordinate
    assert rbd.load_robot(text=b.urdf(), loops=LoopFile.of_text(b.loop_file())).plane == "xz"


def test_feet_of_a_robot_in_memory() -> None:
    """From its solids: a box's underside, a ball's lowest point."""
    b = RobotBuilder("stool")
    b.body("seat", Box((0.3, 0.3, 0.05), mass=3.0, at=(0, 0, 0.5)), Box((0.2, 0.2, 0.02), at=(0, 0, 0.01)))
    robot = b.robot(feet=["seat"])
    held = rbd.hold(robot.standing(), robot.soles())
    assert np.abs(robot.soles()[0].corners[:, :2]).max() == pytest.approx(0.1)
    assert held.forces["seat"][2] == pytest.approx(3.0 * 9.81)


def test_warnings_are_those_that_were_not_asked_for() -> None:
    """Motors without limits and point masses are what the user typed; damping that the dynamics lack is said."""
    b = RobotBuilder("bob", root="fixed")
    b.body("bob", PointMass(1.0, at=(0, 0, -1)))
    b.joint("pivot", "ground", "bob", axis=(0, 1, 0), motor=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = b.robot()
    assert {f.kind for f in robot.report.warnings} == {"effort", "inertia"}  # type: ignore[union-attr]
    assert rbd.solve(robot.at([np.pi / 2]), [0.0]).a == pytest.approx([-9.81])
    b.body("lever", Rod((0, 0, 0), (0, 0, 1), mass=1.0))
    b.joint("worn", "bob", "lever", axis=(0, 1, 0), damping=0.1)
    with pytest.warns(ModelWarning, match=r"damping.*'worn'") as told:
        b.robot()
    assert told[0].filename == __file__ and "effort" not in str(told[0].message)


def test_a_user_s_constraint_closes_a_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    """A registered kind, with text, truth, numbers and lists."""
    from rbd.robots import loop_file

    monkeypatch.setattr(loop_file, "KINDS", dict(loop_file.KINDS))
    made: list[object] = []

    def parked(name: str, joint: str, angle: float, firm: bool = True, axis: tuple[float, ...] = ()) -> rbd.JointLock:
        made.append((firm, axis))
        return rbd.JointLock(name, joint, position=angle)

    rbd.register_constraint("parked", parked)
    b = RobotBuilder("arm", root="fixed")
    b.body("arm", Rod((0, 0, 0), (1, 0, 0), mass=1.0))
    b.joint("pivot", "ground", "arm", axis=(0, -1, 0))
    b.constraint("park", "parked", joint="pivot", angle=0.5, firm=False, axis=(1, 2.5))
    (lock,) = b.robot().loops()
    assert isinstance(lock, rbd.JointLock) and made[0] == (False, (1.0, 2.5))
    with pytest.raises(rbd.InputError, match="parked"):
        b.constraint("other", "parkd")


# ------------------------------------------------------------------------------------------------------ flat linkages


def test_a_linkage_is_public_and_stands_on_the_builder(tmp_path: Path) -> None:
    """In memory as from its files; more can be added to its builder."""
    crank = Link("crank", "ground", (0.0, 0.0), ((0.1, 0.0),), mass=0.1, motor=True)
    arm = Link("arm", "crank", (0.1, 0.0), ((0.2, 0.0),), mass=0.2, tip=1)
    lever = Link("lever", "ground", (0.25, 0.0), ((0.2, 0.0), (0.2, 0.1)), mass=0.2, tip=1)
    linkage = Linkage(
        "own", "A four-bar.", ((0.0, 0.0), (0.25, 0.0)), (crank, arm, lever), {"pin": ("arm", "lever")}, {}, 0.005
    )
    robot = linkage.robot()
    same(robot, linkage.load(tmp_path / "own.urdf"))
    assert robot.source.in_memory and len(robot.visual_model.geometryObjects) > 10
    closed = robot.at(assemble(robot.at()).q)
    assert np.abs(robot.loops()[0].rows(closed).error).max() < 1e-12
    more = linkage.builder()
    more.body("lamp", Sphere(0.01, mass=0.1))
    more.joint("lamp_joint", "lever", "lamp", "ball")
    assert more.robot().nv == robot.nv + 3


LINK = {"name": "arm", "parent": "ground", "at": (0.0, 0.0), "points": ((0.1, 0.0),), "mass": 1.0}
WRONG_LINKS: dict[str, tuple[dict[str, object], str]] = {
    "points": ({"points": ((0.1, np.nan),)}, "a point of link 'arm'"),
    "no points": ({"points": ()}, "points of link 'arm'"),
    "mass": ({"mass": 0.0}, "mass of link 'arm'"),
    "color": ({"color": "bleu"}, "blue"),
    "tip": ({"tip": 2}, "0 to 1"),
    "name": ({"name": ""}, "name of a link"),
}


@pytest.mark.parametrize("what", WRONG_LINKS)
def test_a_wrong_link_is_refused(what: str) -> None:
    """By its key."""
    given, message = WRONG_LINKS[what]
    with pytest.raises(rbd.InputError, match=message):
        Link(**(LINK | given))  # type: ignore[arg-type]


def test_a_wrong_linkage_is_refused() -> None:
    """A closure of a link without a tip, with the nearest one; no links."""
    arm = Link(**(LINK | {"tip": 1}))  # type: ignore[arg-type]
    with pytest.raises(rbd.InputError, match="'arn'.*arm"):
        Linkage("own", "", ((0.0, 0.0),), (arm,), {"pin": ("arn", "arm")}, {}, 0.005)
    with pytest.raises(rbd.InputError, match="links of linkage 'own'"):
        Linkage("own", "", ((0.0, 0.0),), (), {}, {}, 0.005)


# ------------------------------------------------------------------------------------------------------------- faults


def arm() -> RobotBuilder:
    """A body on a hinge."""
    b = RobotBuilder("arm", root="fixed")
    b.body("upper", Rod((0, 0, 0), (0, 0, -1), mass=1.0))
    b.body("lower", Rod((0, 0, 0), (0, 0, -1), mass=1.0))
    b.joint("shoulder", "ground", "upper", axis=(0, 1, 0))
    return b


def with_second_parent(b: RobotBuilder) -> None:
    """A circle of three bodies, closed by a joint."""
    b.joint("elbow", "upper", "lower", at=(0, 0, -1), axis=(0, 1, 0))
    b.joint("wrist", "ground", "lower", axis=(0, 1, 0))


EAGER: dict[str, tuple[Callable[[RobotBuilder], object], str]] = {
    "two parents": (with_second_parent, r"body 'lower' has two parents, 'upper' .* and 'ground' .* use \.loop\('wrist'"),
    "triangle inequality": (
        lambda b: b.body("x", mass=1.0, inertia=(1.0, 1.0, 3.0)),
        r"an inertia that no body can have: its principal moments are 1, 1, 3 kg m2, which violate the triangle inequality "
        r"I3 <= I1 \+ I2: 3 > 1 \+ 1 = 2",
    ),
    "hidden triangle": (
        lambda b: b.body("x", mass=1.0, inertia=(1.0, 0.9, 0.0, 1.0, 0.0, 1.0)),
        r"an inertia that no body can have.*violate the triangle inequality",
    ),
    "negative moment": (lambda b: b.body("x", mass=1.0, inertia=(-1.0, 1.0, 1.0)), "no body can have.*-1 is negative"),
    "lopsided": (lambda b: b.body("x", mass=1.0, inertia=[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]), "not symmetric"),
    "two moments": (lambda b: b.body("x", mass=1.0, inertia=(1.0, 1.0)), "expected 3 or 6 finite numbers"),
    "no inertia": (lambda b: b.body("x", mass=1.0), r"has a mass and no inertia.*PointMass\(1"),
    "no mass": (lambda b: b.body("x", inertia=(1, 1, 1)), "has com or inertia, and no mass"),
    "weightless": (lambda b: b.body("x", mass=0.0, inertia=(1, 1, 1)), "an inertia and no mass; no body can have that"),
    "mass twice": (lambda b: b.body("x", Sphere(1, mass=1.0), mass=1.0, inertia=(1, 1, 1)), "expected one of them"),
    "nan mass": (lambda b: b.body("x", mass=np.nan, inertia=(1, 1, 1)), "mass of body 'x' is nan"),
    "no solid": (lambda b: b.body("x", 3.0), "expected a solid"),
    "same body": (lambda b: b.body("upper"), "a body or frame 'upper' already"),
    "same frame": (lambda b: b.frame("upper", "lower"), "a body or frame 'upper' already"),
    "same joint": (lambda b: b.joint("shoulder", "upper", "lower"), "a joint 'shoulder' already"),
    "same loop": (lambda b: [b.loop("x", "upper", "lower", kind="rigid") for _ in "ab"], "'x' already"),
    "same posture": (lambda b: [b.posture("x", {}) for _ in "ab"], "'x' already"),
    "zero axis": (lambda b: b.joint("x", "upper", "lower", axis=(0, 0, 0)), "axis of joint 'x' is .* of length 0"),
    "nan place": (lambda b: b.joint("x", "upper", "lower", at=(0, np.nan, 0)), "at of joint 'x'"),
    "kind": (lambda b: b.joint("x", "upper", "lower", "revolut"), "revolute"),
    "itself": (lambda b: b.joint("x", "upper", "upper"), "joins 'upper' with itself"),
    "swapped": (lambda b: b.joint("x", "upper", "lower", limits=(1, -1)), "the lower one first"),
    "no limits": (lambda b: b.joint("x", "upper", "lower", "continuous", limits=(-1, 1)), "has limits; expected a revolute"),
    "negative damping": (lambda b: b.joint("x", "upper", "lower", damping=-1.0), "damping of joint 'x'"),
    "damped ball": (lambda b: b.joint("x", "upper", "lower", "ball", damping=1.0), "is ball and has damping"),
    "driven weld": (lambda b: b.joint("x", "upper", "lower", "fixed", motor=True), "is fixed and has a motor"),
    "motor": (lambda b: b.joint("x", "upper", "lower", motor=30.0), "expected True or False"),
    "effort": (lambda b: b.joint("x", "upper", "lower", effort=0.0), "above zero"),
    "tilted plane": (lambda b: b.joint("x", "upper", "lower", "planar", axis=(0, 1, 0)), "turn that by rpy"),
    "moving ground": (lambda b: b.joint("x", "upper", "ground"), "moves the ground"),
    "loop kind": (lambda b: b.loop("x", "upper", "lower", kind="pin"), "planar"),
    "loop end": (lambda b: b.loop("x", "upper", ("lower",), kind="point"), "a body and a point"),
    "wheel kind": (lambda b: b.wheel("x", "upper", kind="weel", radius=1.0), "rolling_wheel"),
    "no radius": (lambda b: b.wheel("x", "upper"), "has no 'radius'"),
    "skate with radius": (
        lambda b: b.wheel("x", "upper", kind="knife_edge", radius=1.0),
        "has a key 'radius'.*name, kind, frame, direction",
    ),
    "posture": (lambda b: b.posture("x", {"shoulder": "up"}), "'shoulder' of posture 'x'"),
    "no dictionary": (lambda b: b.posture("x", [1.0]), "joints and their values"),
    "elements": (lambda b: b.body("x", elements="<inertial/>"), "<visual> and <collision> elements"),
    "root": (lambda b: RobotBuilder("x", root="floating"), "free_flyer"),
    "name": (lambda b: RobotBuilder(""), "name of the robot"),
    "plane": (lambda b: RobotBuilder("x", plane="xz"), "root='planar'"),
    "path": (lambda b: b.save("arm.xml"), r"ends in \.urdf"),
}


@pytest.mark.parametrize("what", EAGER)
def test_what_is_wrong_by_itself_is_refused_at_once(what: str) -> None:
    """In the line where it is typed; the builder is as before, and goes on."""
    act, message = EAGER[what]
    b = arm()
    with pytest.raises(rbd.InputError, match=message):
        act(b)
    if "elbow" not in b.joints:
        b.joint("elbow", "upper", "lower", at=(0, 0, -1), axis=(0, 1, 0))
    assert b.robot().nv == 2


def unknown_frame(b: RobotBuilder) -> None:
    """A loop whose end is misspelt."""
    b.joint("elbow", "upper", "lower")
    b.loop("x", "uper", "ground", kind="point")


def circle(b: RobotBuilder) -> None:
    """Two bodies that hang on each other."""
    b.joint("elbow", "upper", "lower")
    for one, other in (("a", "b"), ("b", "a")):
        b.body(one, Sphere(0.1, mass=1.0))
        b.joint(f"on_{one}", other, one)


def massless(b: RobotBuilder) -> None:
    """Two bodies of shapes only, behind each other."""
    b.joint("elbow", "upper", "lower")
    b.body("hand", Sphere(0.1))
    b.body("nail", Sphere(0.1))
    b.joint("wrist", "lower", "hand")
    b.joint("glue", "hand", "nail", "fixed")


LATE: dict[str, tuple[Callable[[RobotBuilder], object], str]] = {
    "unknown parent": (lambda b: b.joint("x", "uper", "lower"), "the parent of joint 'x' is 'uper'; .*'upper'"),
    "unknown child": (lambda b: b.joint("x", "upper", "lowr"), "the child of joint 'x' is 'lowr'; .*'lower'"),
    "two roots": (lambda b: None, r"one body that hangs on no joint, found 2: 'ground', 'lower'.*\.joint"),
    "circle": (circle, r"its joints make a circle.*\.loop"),
    "massless": (massless, "body 'hand' moves in joint 'wrist' and has no mass, nor has 'nail'.*'fixed'"),
    "frame": (lambda b: b.frame("x", "uper"), "frame 'x' is on 'uper'; .*'upper'"),
    "loop's end": (unknown_frame, r"arm\.loops\.yaml: loop 'x': .*'uper'.*upper"),
}


@pytest.mark.parametrize("what", LATE)
def test_what_does_not_fit_together_is_refused_by_the_robot(what: str, tmp_path: Path) -> None:
    """Bodies may be declared in any order, so names are looked up when the robot is made, or saved."""
    act, message = LATE[what]
    b = arm()
    act(b)
    with pytest.raises(ModelError, match=message):
        b.robot()
    if what != "loop's end":
        with pytest.raises(ModelError, match=message):
            b.save(tmp_path / "x.urdf")
        assert not os.listdir(tmp_path)


def test_a_ground_is_there_where_the_root_is_fixed() -> None:
    """With another root the message says so; without bodies there is no robot."""
    b = RobotBuilder("ball")
    b.body("ball", Sphere(0.1, mass=1.0))
    b.joint("x", "ground", "ball", "free")
    with pytest.raises(ModelError, match="root='fixed'"):
        b.robot()
    with pytest.raises(ModelError, match="it has no bodies"):
        RobotBuilder("nothing").robot()


def test_saving_where_it_cannot_be_written(tmp_path: Path) -> None:
    """No folder, a folder by that name, a folder of somebody else: nothing is left behind."""
    b = arm()
    b.joint("elbow", "upper", "lower")
    with pytest.raises(ModelError, match="there is no folder"):
        b.save(tmp_path / "gone" / "arm.urdf")
    (tmp_path / "arm.loops.yaml").mkdir()
    with pytest.raises(ModelError, match="it is a folder"):
        b.save(tmp_path / "arm.urdf")
    assert os.listdir(tmp_path) == ["arm.loops.yaml"]
    if os.geteuid() != 0:
        closed = tmp_path / "closed"
        closed.mkdir(mode=stat.S_IRUSR | stat.S_IXUSR)
        with pytest.raises(ModelError, match="permission denied"):
            b.save(closed / "arm.urdf")


def test_a_mesh_is_an_element(tmp_path: Path) -> None:
    """Drawn from the package folders; its file is not looked for elsewhere."""
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "part.obj").write_text(corners)
    b = RobotBuilder("part")
    mesh = '<visual><geometry><mesh filename="package://part.obj" scale="2 2 2"/></geometry></visual>'
    b.body("part", mass=1.0, inertia=(1, 1, 1), elements=mesh)
    assert b.robot(package_dirs=[tmp_path]).visual_model.geometryObjects[0].geometry.num_vertices == 4
    with pytest.warns(ModelWarning, match="mesh is missing"):
        b.robot()


def tree(rng: np.random.Generator, names: list[str], parents: list[int]) -> RobotBuilder:
    """Joints in this order, each on the body of an earlier one or on the ground (-1); every inertia is different."""
    builder = RobotBuilder("tree", root="fixed")
    for i, (name, parent) in enumerate(zip(names, parents, strict=True)):
        at = rng.normal(size=3)
        builder.body(f"body_{i}", mass=1.0 + i, com=rng.normal(size=3), inertia=np.full(3, 0.1 * (1 + i)))
        kind = ("revolute", "ball", "prismatic", "continuous")[i % 4]
        limits = (-1.0 - i, 1.0 + i) if kind in ("revolute", "prismatic") else None
        parent_name = "ground" if parent < 0 else f"body_{parent}"
        builder.joint(name, parent_name, f"body_{i}", kind, at=at, limits=limits, motor=kind != "ball")
    return builder


def test_joints_are_in_the_order_in_which_they_were_declared(tmp_path: Path) -> None:
    """Two arms on the ground, "slow" before "fast": q, v and tau as declared, and so after saving, copying and pickling."""
    builder = RobotBuilder("arms", root="fixed")
    for name in ("slow", "fast"):
        builder.body(f"{name}_rod", Rod((0, 0, 0), (0, 0, -1), mass=3.0 if name == "slow" else 1.0))
        builder.joint(name, "ground", f"{name}_rod", axis=(0, 1, 0), motor=True)
    arms = builder.robot()
    path = builder.save(tmp_path / "arms.urdf")
    for robot in (arms, rbd.load_robot(path), copy.deepcopy(arms), pickle.loads(pickle.dumps(arms))):
        assert list(robot.joints) == ["slow", "fast"] == list(robot.actuated_names)
        state = robot.at([0.1, 0.2])
        assert np.array_equal(state.q, robot.at().with_joints({"slow": 0.1, "fast": 0.2}).q)
        assert np.diag(state.M) == pytest.approx([1.0, 1.0 / 3.0])  # m l^2 / 3


def test_in_another_order_a_tree_is_the_same_robot(rng: np.random.Generator, tmp_path: Path) -> None:
    """Depth-first trees of all kinds of joints under random names: as declared; limits, M, h and frames by name the same."""
    parents = [-1, 0, 1, 0, -1, 4, 4, 6]
    for _ in range(5):
        names = [f"{letter}_joint" for letter in rng.permutation(list("abcdefgh"))]
        builder = tree(rng, names, parents)
        ours = builder.robot()
        plain = rbd.load_robot(builder.save(tmp_path / "tree.urdf"), loops=False, root="fixed", passive=sorted(ours.passive))
        assert list(ours.joints) == names and list(plain.joints) != names
        q, v = pin.integrate(ours.model, ours.neutral(), rng.normal(size=ours.nv)), rng.normal(size=ours.nv)
        at_q, at_v = plain.neutral(), np.zeros(plain.nv)
        for name in names:
            at_q[plain.joints[name].q], at_v[plain.joints[name].v] = q[ours.joints[name].q], v[ours.joints[name].v]
            assert (ours.joints[name].lower, ours.joints[name].upper) == (plain.joints[name].lower, plain.joints[name].upper)
        places = np.concatenate([np.arange(plain.nv)[plain.joints[name].v] for name in names])
        one, other = rbd.State(ours, q, v), rbd.State(plain, at_q, at_v)
        assert np.abs(one.M - other.M[np.ix_(places, places)]).max() < 1e-12
        assert np.abs(one.h - other.h[places]).max() < 1e-11
        for frame in ours.frames():
            assert np.abs(one.frame(frame).X_WF.homogeneous - other.frame(frame).X_WF.homogeneous).max() < 1e-12


def test_where_joints_cannot_be_as_declared_a_bare_list_is_refused(rng: np.random.Generator) -> None:
    """A tip declared after the other arm comes before it, since M is right only depth-first: both orders are named."""
    builder = tree(rng, ["upper", "other", "tip"], [-1, -1, 0])  # revolute, ball, prismatic
    robot = builder.robot()
    assert list(robot.joints) == ["upper", "tip", "other"]
    for given in ({"q": [0.0] * robot.nq}, {"v": tuple([0.0] * robot.nv)}):
        with pytest.raises(rbd.InputError, match="declared as upper, other, tip, but are in the order upper, tip, other"):
            robot.at(**given)
    assert np.array_equal(robot.at(robot.neutral(), np.zeros(robot.nv)).q, robot.at().q)
    robot.at().with_joints({"tip": 0.1})


def test_an_order_of_joints_that_are_not_there_is_refused(rng: np.random.Generator) -> None:
    """With the nearest names; and one for an MJCF, whose order is its own."""
    text = tree(rng, ["b", "a"], [-1, -1]).urdf()
    with pytest.raises(ModelError, match="order names a joint 'c'"):
        rbd.load_robot(text=text, loops=LoopFile.of_text("{root: fixed, order: [b, c]}"))
    mjcf = "<mujoco><worldbody><body><joint name='j' type='hinge'/><geom size='.1'/></body></worldbody></mujoco>"
    with pytest.raises(rbd.InputError, match="order is for URDF"):
        rbd.load_robot(text=mjcf, loops=LoopFile.of_text("order: [j]"))


def test_a_planar_joint_is_not_said_to_have_a_strange_axis() -> None:
    """Its normal is z, in its file too; warnings are errors here."""
    builder = RobotBuilder("puck", root="fixed")
    builder.body("disk", rbd.robots.Cylinder(0.1, 0.02, mass=1.0))
    builder.joint("slide", "ground", "disk", "planar")
    with warnings.catch_warnings():
        warnings.simplefilter("error", ModelWarning)
        puck = builder.robot()
    assert puck.report is not None and not puck.report.warnings and puck.nv == 3


def test_a_robot_that_is_singular_at_zero_alone_is_built_with_a_warning() -> None:
    """A camera that looks along the axis of its pan: refused is the pose, by `solve`; a pan without any mass beyond is not."""

    def pan_tilt(arm: float) -> RobotBuilder:
        builder = RobotBuilder("camera", root="fixed")
        builder.body("pan", PointMass(1.0))
        builder.body("tilt", PointMass(2.0, at=(0, 0, arm)))
        builder.joint("pan_joint", "ground", "pan", axis=(0, 0, 1))
        builder.joint("tilt_joint", "pan", "tilt", axis=(0, 1, 0))
        return builder

    with pytest.warns(ModelWarning, match="no inertia about it at q = 0 .'pan_joint'"):
        robot = pan_tilt(0.5).robot()
    turned = rbd.solve(robot.at([0.3, 0.5]), [], [])
    assert np.abs(turned.a - [0.0, 9.81 * np.sin(0.5) / 0.5]).max() < 1e-12  # an upright pendulum of 0.5 m
    with pytest.raises(rbd.errors.SingularInertia):
        rbd.solve(robot.at([0.3, 0.0]), [], [])
    with pytest.raises(ModelError, match="no inertia about it: M is singular"):
        pan_tilt(0.0).robot()
