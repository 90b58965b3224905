"""Robots in pickles: small, by name or by content, one robot in a process, to the last bit, and copies that are independent."""

from __future__ import annotations

import copy
import pickle
import re
import shutil
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model import pickling
from rbd.robots import catalogue

PACKAGE = Path(rbd.__file__).parent
BOX = """<robot name="crate"><link name="body"><inertial><mass value="2"/><origin xyz="0.01 0 0.02"/>
<inertia ixx="0.1" iyy="0.12" izz="0.13" ixy="0" ixz="0" iyz="0.003"/></inertial>
<visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual>
<collision><geometry>{shape}</geometry></collision></link>
<link name="lid"><inertial><mass value="0.3"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="body"/><child link="lid"/><origin xyz="0 0 0.1" rpy="0.3 0.2 0.1"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="3"/></joint></robot>"""
SRDF = """<robot name="crate"><group name="all"><joint name="hinge"/></group>
<group_state name="ajar" group="all"><joint name="hinge" value="0.4"/></group_state></robot>"""
LOOPS = "{loops: [{name: shut, kind: point, frame_a: body, frame_b: lid}], passive: [hinge]}"
MJCF = """<mujoco model="toy"><include file="parts/body.xml"/></mujoco>"""
PART = """<mujoco><asset><mesh name="m" file="wedge.stl"/></asset><worldbody><body name="trunk"><freejoint/>
<geom name="g" type="mesh" mesh="m" mass="1.5"/></body></worldbody>
<keyframe><key name="up" qpos="0 0 1 1 0 0 0"/></keyframe></mujoco>"""


def wedge(path: Path) -> None:
    """A tetrahedron as an STL."""
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.3, 0], [0, 0, 0.1]], "<f4")
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    body = b"".join(np.zeros(3, "<f4").tobytes() + corners[list(face)].tobytes() + b"\0\0" for face in faces)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"\0" * 80 + (4).to_bytes(4, "little") + body)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Robots of files with all that can stand beside them."""
    here = tmp_path / "files"
    (here / "urdf").mkdir(parents=True)
    (here / "parts").mkdir()
    (here / "urdf" / "crate.urdf").write_text(BOX.format(shape='<mesh filename="../meshes/wedge.stl" scale="2 1 1"/>'))
    (here / "urdf" / "crate.srdf").write_text(SRDF)
    (here / "urdf" / "crate.loops.yaml").write_text(LOOPS)
    (here / "toy.xml").write_text(MJCF)
    (here / "parts" / "body.xml").write_text(PART)
    wedge(here / "meshes" / "wedge.stl")
    wedge(here / "wedge.stl")
    return here


def forget() -> None:
    """Arrive as in a process that has unpickled nothing yet."""
    pickling._here.clear()
    pickling._last.clear()


def arrived_anew(one: object) -> object:
    """What another process unpickles."""
    sent = pickle.dumps(one)
    forget()
    return pickle.loads(sent)


@pytest.fixture(scope="module")
def answers(talos: rbd.Robot) -> dict[str, object]:
    """Answers of Talos, by kind."""
    state, soles = talos.standing(), talos.soles()
    held = rbd.hold(state, soles)
    with pytest.raises(rbd.CannotHold) as caught:
        rbd.hold(state, soles[:1])
    return {
        "robot": talos, "state": state, "hold": held, "posture": rbd.control.HoldPosture(state, soles),
        "solution": rbd.solve(state, held.tau, soles), "error": caught.value,
        "push limits": rbd.statics.push_limits(state, soles, "torso_2_link", np.eye(3)),
        "region": rbd.statics.support_region(state, soles),
        "whole body": rbd.control.WholeBodyController([rbd.control.PostureTask(state)]),
    }  # fmt: skip


BOUNDS = {
    "robot": 600, "state": 1_200, "hold": 25_000, "posture": 45_000, "solution": 30_000, "error": 30_000,
    "push limits": 25_000, "region": 25_000, "whole body": 20_000,
}  # fmt: skip


@pytest.mark.parametrize("kind", BOUNDS)
def test_pickles_are_small(answers: dict[str, object], kind: str):
    """A robot of the catalogue travels by name; before, each of these had 104 kB of its model in it."""
    assert len(pickle.dumps(answers[kind])) < BOUNDS[kind]


def test_many_states_share_one_robot(talos: rbd.Robot):
    """In one pickle, and in a thousand that arrive one by one; the robot of the sender is another one."""
    state = talos.standing()
    sent = [pickle.dumps(state.with_velocity(np.full(talos.nv, i / 1e3))) for i in range(1000)]
    assert len(pickle.dumps([pickle.loads(one) for one in sent])) < 1000 * 800
    forget()
    robots = {id(pickle.loads(one).robot) for one in sent}
    assert len(robots) == 1 and id(talos) not in robots


def test_a_robot_is_built_once_while_it_is_in_use_or_among_the_last():
    """Also without any state of it in between; threads that ask at once get one robot."""
    box = rbd.load_robot("box")
    sent = pickle.dumps(box.at())
    forget()
    found: list[object] = []
    threads = [threading.Thread(target=lambda: found.append(pickle.loads(sent).robot)) for _ in range(4)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert len(found) == 4 and len({id(pickle.loads(sent).robot), *map(id, found)}) == 1


def test_a_robot_that_was_changed_on_arrival_is_not_handed_out_again():
    """A user changes the mass of what arrived: the next pickle gives the robot as it was sent."""
    box = rbd.load_robot("box")
    sent = pickle.dumps(box.at())
    first = pickle.loads(sent).robot
    first.model.inertias[1].mass = 77.0
    second = pickle.loads(sent).robot
    assert second is not first and second.mass == box.mass
    assert pickle.loads(pickle.dumps(first)).mass == first.mass != box.mass


CHANGES: dict[str, Callable[[rbd.Robot], object]] = {
    "mass": lambda robot: setattr(robot.model.inertias[2], "mass", 1.25),
    "gravity": lambda robot: setattr(robot.model.gravity, "linear", np.array([0.0, 0.0, -1.62])),
    "armature": lambda robot: setattr(robot.model, "armature", robot.model.armature + 0.01),
    "limit": lambda robot: setattr(robot.model, "upperPositionLimit", robot.model.upperPositionLimit * 0.5),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_robot_travels_with_its_changes(change: str):
    """Masses, gravity, limits that a user changed after loading: by the model's numbers, to the last bit; again and again."""
    solo = rbd.load_robot("solo12")
    before = solo.digest
    CHANGES[change](solo)
    state = solo.standing()
    sent = arrived_anew(state)
    assert isinstance(sent, rbd.State) and sent.robot.model == solo.model and solo.digest != before
    assert np.array_equal(sent.M, state.M) and np.array_equal(sent.h, state.h)
    assert np.array_equal(sent.robot.effort_limit, solo.effort_limit)
    assert len(pickle.dumps(sent)) < 4000
    again = pickle.loads(pickle.dumps(sent))
    assert again.robot is sent.robot


def test_deep_copies_are_independent():
    """A deep copy is another robot with another model, whatever was pickled; a state's has its own robot, too."""
    solo = rbd.load_robot("solo12")
    solo.model.inertias[1].mass = 3.0
    pickle.dumps(solo)
    one = copy.deepcopy(solo)
    assert one.model == solo.model and one.model is not solo.model
    one.model.inertias[1].mass = 4.0
    assert solo.model.inertias[1].mass == 3.0 and one.mass == pytest.approx(solo.mass + 1.0)
    state = copy.deepcopy(solo.standing())
    assert state.robot is not solo and state.robot.model == solo.model
    solo.collision_model.geometryObjects[0].placement = pin.SE3.Identity()
    shaped = copy.deepcopy(solo)
    shaped.collision_model.geometryObjects[0].name = "another"
    assert shaped.collision_model.geometryObjects[0].placement == pin.SE3.Identity()
    assert solo.collision_model.geometryObjects[0].name != "another"
    two = copy.deepcopy([solo, solo.standing(), solo.standing()])
    assert two[0] is two[1].robot is two[2].robot is not solo
    arrived = pickle.loads(pickle.dumps(solo))
    assert copy.deepcopy(arrived) is not arrived
    assert copy.copy(solo).model is solo.model and pickle.loads(pickle.dumps(copy.copy(solo))).mass == solo.mass


def test_a_changed_pair_travels_with_its_changes():
    """Two robots in one model: their own changes and those of the model of both."""
    solo, box = rbd.load_robot("solo12"), rbd.load_robot("box")
    pair = rbd.robots.merge_robots(solo, box)
    assert len(pickle.dumps(pair.at())) < 2500
    pair.model.inertias[1].mass = 5.0
    box.model.inertias[1].mass = 6.0
    for way in (arrived_anew, copy.deepcopy):
        sent = way(pair.at())
        assert isinstance(sent, rbd.State) and sent.robot.model == pair.model and np.array_equal(sent.M, pair.at().M)
        assert sent.robot.members[1].mass == box.mass


def test_a_robot_of_a_file_travels_by_content(folder: Path, tmp_path: Path):
    """Sent, its folder deleted, used in another process elsewhere: the same bits, postures, loops, shapes, report."""
    crate, toy = rbd.load_robot(folder / "urdf" / "crate.urdf", package_dirs=[folder]), rbd.load_robot(folder / "toy.xml")
    state = crate.at("ajar")
    tip = rbd.PointContact("tip", "body", friction=0.5, on=None)
    solution = rbd.solve(state, np.zeros(crate.nu), [tip], loops=False)
    sent = pickle.dumps((state, solution, toy.at("up"), crate, rbd.CollisionContacts("floor", toy, margin=10.0)))
    assert len(sent) < 40_000
    shapes = [np.array(each.collision_model.geometryObjects[0].geometry.vertices()) for each in (crate, toy)]
    gaps = rbd.CollisionContacts("floor", toy, margin=10.0).points(toy.at("up")).gaps
    expected = [state.M, state.h, solution.a, solution.multipliers, toy.at("up").M, *shapes, gaps]
    np.savez(tmp_path / "expected.npz", *expected)
    (tmp_path / "sent").write_bytes(sent)
    shutil.rmtree(folder)
    code = """
import pathlib, pickle, sys, numpy as np, rbd
state, solution, up, crate, floor = pickle.loads(pathlib.Path(sys.argv[1], "sent").read_bytes())
tip = rbd.PointContact("tip", "body", friction=0.5, on=None)
again = rbd.solve(state, np.zeros(crate.nu), [tip], loops=False)
shapes = [np.array(each.collision_model.geometryObjects[0].geometry.vertices()) for each in (crate, up.robot)]
found = [state.M, state.h, again.a, again.multipliers, up.M, *shapes, floor.points(up).gaps]
kept = np.load(sys.argv[1] + "/expected.npz")
assert all(np.array_equal(one, other) for one, other in zip(found, kept.values(), strict=True))
assert np.array_equal(solution.a, again.a) and crate is state.robot and not crate.collision_stand_ins
assert crate.visual_model.ngeoms == 1 and sorted(crate.postures) == ["ajar"] and len(crate.loops()) == 1
assert rbd.doctor(crate).notes[-1].text.startswith("is no longer there")
assert crate.urdf.name == "crate.urdf" and rbd.motion.file_conventions.file_order(crate) == ("hinge",)
print(pickle.loads(pickle.dumps(crate)) is crate, len(pickle.dumps(state)))
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, str(tmp_path)], cwd="/", capture_output=True, text=True, timeout=120
    )
    assert done.stdout.startswith("True"), done.stderr
    assert int(done.stdout.split()[1]) < 15_000


def test_a_missing_large_mesh_is_told_by_name(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """Meshes above the bound go with a robot whose shapes were used; else their files must be there."""
    monkeypatch.setattr("rbd.robots.body_shapes.SMALL_BYTES", 100)
    crate = rbd.load_robot(folder / "urdf" / "crate.urdf", package_dirs=[folder])
    light = pickle.dumps(crate)
    assert crate.collision_model.ngeoms == 1
    full = pickle.dumps(crate)
    assert len(full) > len(light) + 60
    (folder / "meshes" / "wedge.stl").unlink()
    forget()
    one = pickle.loads(light)
    with pytest.warns(rbd.errors.ModelWarning, match=r"wedge\.stl"):
        assert one.collision_stand_ins
    assert pickle.loads(full) is one and not one.collision_stand_ins  # the files came later


def test_collision_pairs_travel():
    """Pairs that a user added to the collision model."""
    solo = rbd.load_robot("solo12")
    solo.collision_model.addCollisionPair(pin.CollisionPair(0, 5))
    for sent in (arrived_anew(solo), copy.deepcopy(solo)):
        assert isinstance(sent, rbd.Robot) and len(sent.collision_model.collisionPairs) == 1
        assert sent.collision_model.collisionPairs[0] == pin.CollisionPair(0, 5)
    assert not rbd.load_robot("solo12").collision_model.collisionPairs.tolist()


def test_another_file_under_the_same_name_is_refused(monkeypatch: pytest.MonkeyPatch):
    """Example-robot-data in another version: the versions of both are in the message."""
    sent = pickle.dumps(rbd.load_robot("solo12"))
    forget()
    monkeypatch.setattr("rbd.robots.travelling.numbers_digest", lambda model: "0" * 32)
    with pytest.raises(rbd.errors.ModelError, match=r"solo12 is another robot here .* example-robot-data \d.*; here: "):
        pickle.loads(sent)
    monkeypatch.undo()
    monkeypatch.setattr("rbd.robots.catalogue.robots_folder", lambda: Path("nowhere"))
    with pytest.raises(rbd.errors.ModelError, match="which is not here. Install the same version"):
        pickle.loads(sent)


def test_options_of_a_robot_of_the_catalogue_travel():
    """Root, passive joints, loops that are left open, feet of one's own."""
    arm = rbd.load_robot("panda", root="fixed", passive=["panda_joint7"])
    bar = rbd.load_robot("four_bar", loops=None)
    solo = rbd.load_robot("solo12", feet=["FL_FOOT", "FR_FOOT", "HL_FOOT"])
    assert all(len(pickle.dumps(each)) < 1500 for each in (arm, bar, solo))
    for one in (arm, bar, solo):
        sent = arrived_anew(one)
        assert isinstance(sent, rbd.Robot) and sent.model == one.model and sent.passive == one.passive
        assert (sent.nu, sent.root, len(sent.loops()), sent.source.feet) == (
            one.nu,
            one.root,
            len(one.loops()),
            one.source.feet,
        )
        assert sent.report == one.report and sent.sound == one.sound and sent.digest == one.digest


@pytest.mark.parametrize("name", catalogue.robots())
def test_every_robot_of_the_catalogue_arrives_bit_for_bit(name: str):
    """By name, its model, postures and feet; M at a random configuration."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.ModelWarning)
        robot = rbd.load_robot(name)
    state = robot.at(
        pin.integrate(robot.model, robot.neutral(), np.linspace(-1.0, 1.0, robot.nv)), np.linspace(0.0, 1.0, robot.nv)
    )
    sent = arrived_anew(state)  # and nothing warns
    assert isinstance(sent, rbd.State) and sent.robot.model == robot.model and len(pickle.dumps(robot)) < 700
    assert np.array_equal(sent.q, state.q) and np.array_equal(sent.v, state.v)
    assert np.array_equal(sent.M, state.M) and np.array_equal(sent.h, state.h)
    assert all(np.array_equal(q, sent.robot.postures[posture]) for posture, q in robot.postures.items())


def test_parts_that_arrived_with_separate_pickles_fit_together(talos: rbd.Robot):
    """A state, contacts, a controller of robots that were unpickled apart: they are like each other, if not the same."""
    state, soles = talos.standing(), talos.soles()
    law = rbd.control.HoldPosture(state, soles)
    other = arrived_anew(law)
    assert isinstance(other, rbd.control.HoldPosture) and other.state.robot is not talos
    assert np.array_equal(law(state, 0.0), other(state, 0.0))
    solo = rbd.load_robot("solo12")
    ground = rbd.CollisionContacts("ground", solo, ground=["FL_FOOT"], margin=1.0)
    sent = arrived_anew(solo.standing())
    assert isinstance(sent, rbd.State) and sent.robot.is_like(solo)
    assert np.array_equal(ground.points(sent).gaps, ground.points(solo.standing()).gaps)
    heavier = copy.deepcopy(solo)
    heavier.model.inertias[1].mass = 9.0
    with pytest.raises(rbd.InputError, match="are of solo12"):
        ground.points(heavier.standing())


def test_nothing_of_a_users_file_is_unpickled():
    """A pickle can run any program: only what this package's own processes send each other is read."""
    found = {
        f"{path.relative_to(PACKAGE)}: {line.strip()}"
        for path in PACKAGE.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.search(r"pickle\.(load|loads|Unpickler)\b|allow_pickle=True|read_pickle|\bshelve\b|\bmarshal\b", line)
    }
    own = ("studies/", "answers/many/side_by_side.py")
    assert all(line.startswith(own) and "pickle.loads(" in line for line in found), found
