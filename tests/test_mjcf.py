"""MJCF files are read as MuJoCo reads them, element by element; what cannot be expressed is refused or told by its name."""

from __future__ import annotations

import math
import os
import re
import struct
import subprocess
import sys
import warnings
from pathlib import Path

import mjcf_twin
import mujoco
import numpy as np
import pytest

import rbd
from rbd.errors import InputError, ModelError, ModelWarning

GRAVITY = 9.81
NO_GRAVITY = '<option><flag gravity="disable"/></option>'
CUBE = 'vertex="0 0 0 1 0 0 0 1 0 0 0 1 1 1 0 1 0 1 0 1 1 1 1 1"'
DENT = 'vertex="0 0 0 .3 0 0 0 .3 0 0 0 .3 .1 .1 .1" face="0 2 1 0 1 3 0 3 2 1 2 4 2 3 4 3 1 4"'
CORNER = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
SIDES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.fixture
def write(tmp_path: Path):
    """A function that writes an MJCF file of a world, and of what stands before and after it."""

    def make(world: str, before: str = "", after: str = "", name: str = "m.xml") -> Path:
        path = tmp_path / name
        path.write_text(f"<mujoco>{before}<worldbody>{world}</worldbody>{after}</mujoco>")
        return path

    return make


def load(path: Path, **more) -> rbd.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return rbd.load_robot(path, **more)


def check_same(path: Path, **more) -> rbd.Robot:
    """The robot of a file, after it was found to be MuJoCo's."""
    model, robot = mjcf_twin.compiled(path), load(path, **more)
    assert not isinstance(model, str), model
    assert mjcf_twin.differences(robot, model) == []
    return robot


def body(inside: str, joint: str = '<joint name="j" axis="0 1 0"/>', attributes: str = "") -> str:
    return f'<body name="b" {attributes}>{joint}{inside}</body>'


BALL = '<geom size=".1"/>'
BOX = '<geom type="box" size=".1 .2 .3" pos=".1 .2 .3"/>'
MESH = '<asset><mesh name="m" {}/></asset>'
MESHED = body('<geom type="mesh" mesh="m"/>')
POINTS = 'vertex="0 0 0 1 0 0 0 1 0 0 0 1"'
WEIGHT = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
ARM = body(BOX + f'<body name="c" pos=".3 0 .1"><joint name="k" axis="1 0 0"/>{BALL}</body>')

READ = {
    # shapes
    "sphere": (body('<geom size=".1" pos=".1 0 0"/>'),),
    "capsule": (body('<geom type="capsule" size=".1 .2" pos=".1 0 0" euler="20 30 40"/>'),),
    "cylinder": (body('<geom type="cylinder" size=".1 .2" axisangle="1 1 0 50"/>'),),
    "ellipsoid": (body('<geom type="ellipsoid" size=".1 .2 .3" quat="1 2 3 4"/>'),),
    "box": (body(BOX),),
    "fromto": (body('<geom type="capsule" size=".1" fromto="0 0 0 1 2 3"/>'
                    '<geom type="box" size=".1" fromto="0 1 0 0 0 -1"/>'),),
    "shell of each": (body("".join(f'<geom type="{t}" size=".1 .2 .3" shellinertia="true"/>' for t in
                                   ("sphere", "capsule", "cylinder", "ellipsoid", "box"))),),
    "mass of a shape": (body('<geom type="box" size=".1 .2 .3" mass="2"/><geom size=".1" mass="0"/>'),),
    "density": (body('<geom size=".1" density="30"/>'),),
    "shapes that touch nothing": (body('<geom size=".1" contype="0" conaffinity="0"/>'),),
    "a plane weighs nothing": ('<geom type="plane" size="1 1 1"/>' + body(BALL),),
    # meshes
    "mesh": (body('<geom type="mesh" mesh="m"/>'), f'<asset><mesh name="m" {CUBE}/></asset>'),
    **{f"mesh, {kind}": (body('<geom type="mesh" mesh="m" pos="1 0 0" euler="10 20 30"/>'),
                         f'<asset><mesh name="m" {DENT} inertia="{kind}"/></asset>')
       for kind in ("convex", "exact", "legacy", "shell")},
    "mesh moved, scaled and mirrored": (body('<geom type="mesh" mesh="m"/>'),
                                        f'<asset><mesh name="m" {DENT} scale="1 2 -3" refpos="1 0 .2" '
                                        'refquat="1 1 0 .5"/></asset>'),
    "mesh with a mass": (body('<geom type="mesh" mesh="m" mass="3"/>'), f'<asset><mesh name="m" {DENT}/></asset>'),
    "mesh of a class": (body('<geom type="mesh" mesh="m"/>'),
                        f'<default><mesh scale=".1 .1 .2"/></default><asset><mesh name="m" {DENT}/></asset>'),
    "a box fitted to a mesh": (body('<geom type="box" mesh="m"/>'), f'<asset><mesh name="m" {DENT}/></asset>'),
    "a hull of few corners": (MESHED, MESH.format(CUBE + ' maxhullvert="5"')),
    "a mesh in two places": (body('<geom type="mesh" mesh="m"/><geom type="mesh" mesh="m" pos="1 0 0" density="30"/>'),
                             f'<asset><mesh name="m" {DENT}/></asset>'),
    # inertials
    "inertial": (body('<inertial pos="1 2 3" euler="10 20 30" mass="2" diaginertia=".1 .2 .25"/>'),),
    "full inertia": (body('<inertial pos="1 2 3" mass="2" fullinertia=".3 .2 .25 .01 .02 -.03"/>'),),
    "an inertial before shapes": (body(f'<inertial pos="1 2 3" mass="2" diaginertia=".1 .2 .25"/>{BOX}'),),
    "shapes before an inertial": (body(f'<inertial pos="1 2 3" mass="2" diaginertia=".1 .2 .25"/>{BOX}'),
                                  '<compiler inertiafromgeom="true"/>'),
    "groups that weigh": (body('<geom size=".1" group="1"/><geom size=".2" group="3"/>'),
        '<compiler inertiagrouprange="0 2"/>'),
    "boundmass and boundinertia": (ARM, '<compiler boundmass="40" boundinertia=".2"/>'),
    "balanceinertia": (body('<inertial pos="1 2 3" quat="1 1 0 0" mass="2" diaginertia=".1 .2 .5"/>'),
                       '<compiler balanceinertia="true"/>'),
    "settotalmass": (ARM + '<body><geom size=".2"/></body>', '<compiler settotalmass="3"/>'),
    "welded bodies": (body(f'{BOX}<body pos=".1 0 0" euler="1 2 3">{BOX}<body pos="0 1 0">{BALL}</body></body>'),),
    # joints
    "slide": (body(BOX, '<joint type="slide" axis="1 1 0" ref=".2" range="-1 2"/>'),),
    "hinge with a ref": (body(BOX, '<joint axis="1 1 0" ref="20" range="-10 90" pos=".1 .2 .3" armature=".3"/>'),),
    "ball": (body(BOX, '<joint type="ball" pos=".1 0 .2"/>', 'pos="1 2 3" euler="10 20 30"'),),
    "free": (body(BOX, "<freejoint/>", 'pos="1 2 3" euler="10 20 30"'),),
    "free, another word for it": (body(BOX, '<joint type="free" armature=".1"/>'),),
    "several joints of one body": (body(BOX, '<joint type="slide" axis="1 0 0"/><joint axis="0 1 0" pos=".1 .2 .3" ref="30"/>'
                                             '<joint axis="1 0 1" pos="-.1 0 0"/>', 'euler="10 20 30"'),),
    "a ball after a slide": (body(BOX, '<joint type="slide" axis="1 0 0"/><joint type="ball" pos="0 .1 0"/>'),),
    "a slide after a ball": (body(BOX, '<joint type="ball" pos="0 .1 0"/><joint type="slide" axis="1 1 0"/>'),),
    "a body that a mocap system moves": (f'<body mocap="true" pos="0 0 1">{BALL}</body>' + ARM,),
    "several bodies in the world": (ARM + f'<body pos="0 3 0"><freejoint/>{BALL}</body><body>{BALL}</body>',),
    "no name at all": (f'<body><joint/>{BOX}<body><joint axis="1 0 0"/>{BALL}</body></body>',),
    "limits off": (body(BOX, '<joint range="-1 1"/>'), '<option><flag limit="disable"/></option>'),
    # settings
    "radians": (body(BOX, '<joint range="-1 1" ref=".3"/>', 'euler=".1 .2 .3"'), '<compiler angle="radian"/>'),
    "the last setting is in force": (body(BOX, attributes='euler=".1 .2 .3"'),
        '<compiler angle="degree"/><compiler angle="radian"/>'),
    **{f"eulerseq {seq}": (body(BOX, attributes='euler="10 20 30"'), f'<compiler eulerseq="{seq}"/>') for seq in ("zyx", "XYZ",
        "xYz")},
    "autolimits off": (body(BOX, '<joint range="-1 1" limited="true"/>'), '<compiler autolimits="false"/>'),
    "gravity": (ARM, '<option gravity="1 2 -3"/>'),
    "no gravity": (ARM, NO_GRAVITY),
    "what draws only": (body('<geom size=".1" contype="0" conaffinity="0" group="2"/>' + BOX),
                        '<compiler discardvisual="true" fusestatic="true"/>'),
    # notations
    "xyaxes": (body(BOX, attributes='xyaxes="0 1 .1 -1 0 .2"'),),
    "zaxis": (body(BOX + '<geom type="box" size=".1 .2 .3" zaxis="0 0 -1"/>', attributes='zaxis="1 .2 -.3"'),),
    "frames of floating bodies that are moved": (body(BOX, "<freejoint/>"), '<compiler alignfree="true"/>'),
    "a frame that is moved": (body(BOX, '<freejoint align="true"/>', 'pos="1 2 3" euler="10 20 30"'),),
    # structure
    "classes": (
        '<body name="b" childclass="x"><joint name="j"/><geom/><body><joint class="y"/>'
        '<geom class="main" size=".3"/></body></body>',
        '<default><geom size=".1"/><joint armature=".1"/><default class="x"><geom type="box" size=".1 .2 .3" pos="1 0 0"/>'
        '<joint axis="1 0 0"/><default class="y"><joint type="slide"/></default></default></default>'),
    "a part of a class's numbers": (body('<geom type="box" size=".5"/>'), '<default><geom size=".1 .2 .3"/></default>'),
    "an orientation before that of a class": (body('<geom type="box" size=".1 .2 .3" quat="1 0 0 1"/>'),
                                              '<default><geom euler="90 0 0"/></default>'),
    "mass of a class before a density": (body('<geom size=".1" density="5"/>'), '<default><geom mass="2"/></default>'),
    "frames": ('<frame pos="1 0 0" euler="0 30 0" childclass="x"><body name="b"><frame pos="0 .1 0" quat="1 1 0 0">'
               f'<joint name="j" pos=".1 0 0"/><geom/><frame pos="0 0 1">{BOX}<body pos="1 0 0"><joint/><geom/></body></frame>'
               "</frame></body></frame>",
                   '<default><default class="x"><geom type="capsule" size=".1 .2"/></default></default>'),
    # motors
    "motors at some joints": (ARM, "", '<actuator><motor joint="k"/></actuator>'),
    "no motors": (ARM,),
    "armature of a motor": (ARM, "", '<actuator><motor joint="k" gear="3" armature=".5"/></actuator>'),
    "servos": (ARM, "", '<actuator><position joint="k" kp="3"/><velocity jointinparent="j"/></actuator>'),
    "general": (ARM, '<default><general gear="4" armature=".1"/></default>',
        '<actuator><general joint="j" gainprm="2"/></actuator>'),
    "a general of a servo's class": (ARM, '<default><position kp="5"/></default>', '<actuator><general joint="j"/></actuator>'),
    "a motor beside a servo's defaults": (ARM, '<default><position kp="5" ctrlrange="-2 2"/></default>',
        '<actuator><motor joint="j"/></actuator>'),
    # what changes nothing
    "sites without a name": (body(BOX + '<site pos="1 0 0"/><site name="s" type="capsule" size=".1" fromto="0 0 0 0 0 1"/>'),),
    "a tendon that acts on nothing": (ARM, "", '<tendon><fixed stiffness="0.0"><joint joint="j" coef="1"/></fixed></tendon>'),
    "sections without effect": (
        ARM + '<camera pos="0 0 1"/><light/><site name="s"/>',
        '<visual><global fovy="3"/></visual><statistic extent="2"/><size memory="1M"/>'
        '<custom><numeric name="n" data="1"/></custom>'
        '<default><material rgba="1 0 0 1"/><camera fovy="3"/></default><asset><material name="m"/></asset>',
        '<sensor><jointpos joint="j"/></sensor><contact><exclude body1="b" body2="c"/></contact>'),
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_each_element_is_read_as_mujoco_reads_it(write, case: str) -> None:
    """M, gravity, the motors' joints and the limits are MuJoCo's, to 1e-8, at the posture drawn and at two random ones."""
    check_same(write(*READ[case]))


def test_the_judge_sees_a_gram(write) -> None:
    """One gram of 2.4 kg at the elbow, a motor more, a limit and gravity are each seen."""
    path = write(ARM, after='<actuator><motor joint="k"/></actuator>')
    robot = load(path)
    other = write(ARM.replace(BALL, '<geom size=".1" mass="4.1897902"/>').replace('name="k"', 'name="k" range="-1 1"'),
                  '<option gravity="0 0 -9.8"/>', name="other.xml")  # fmt: skip
    said = " ".join(mjcf_twin.differences(robot, mjcf_twin.compiled(other)))
    for word in ("nu is 1, and 0", "M differs", "gravity differs", "limits of joint 1"):
        assert word in said


@pytest.mark.parametrize("ending", ["stl", "obj", "msh"])
def test_mesh_files_weigh_what_their_tetrahedron_does(write, tmp_path: Path, ending: str) -> None:
    """A corner of a 1 x 2 x 3 m box has a sixth of its volume, 1 m3, and its centre a quarter along each; MuJoCo's too."""
    triangles = CORNER[SIDES].astype("<f4")
    data = {
        "stl": bytes(80) + struct.pack("<I", 4) + b"".join(bytes(12) + t.tobytes() + bytes(2) for t in triangles),
        "obj": "".join(f"v {x} {y} {z}\n" for x, y, z in CORNER).encode() + b"f 1 3 2\nf 1/1 2/2 4/3\nf -4 -1 -2\nf 2 3 4\n",
        "msh": struct.pack("<4i", 4, 0, 0, 4) + CORNER.astype("<f4").tobytes() + SIDES.astype("<i4").tobytes(),
    }
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / f"corner.{ending}").write_bytes(data[ending])
    path = write(
        body('<geom type="mesh" mesh="corner"/>'), f'<compiler meshdir="meshes"/><asset><mesh file="corner.{ending}"/></asset>'
    )
    robot = check_same(path)
    assert abs(robot.mass - 1000.0) < 1e-9
    assert np.abs(robot.model.inertias[1].lever - [0.25, 0.5, 0.75]).max() < 1e-12
    assert robot.visual_model.geometryObjects[0].geometry.num_tris == 4


OBJ_FACES = {
    "square faces, one corner pulled out": ("1 4 3 2", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"),
    "the same, each from its next corner": ("4 3 2 1", "6 7 8 5", "2 6 5 1", "3 7 6 2", "4 8 7 3", "1 5 8 4"),
}


def obj(corners: np.ndarray, faces) -> str:
    """The text of an OBJ file."""
    return "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {face}\n" for face in faces)


@pytest.mark.parametrize("case", OBJ_FACES)
def test_a_bent_face_of_four_corners_folds_along_its_shorter_diagonal(write, tmp_path: Path, case: str) -> None:
    """A cube whose corner (1, 1, 1) went to (2, 2, 1.5) encloses 17/12 m3, as in MuJoCo; other folds more."""
    cube = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [2, 2, 1.5], [0, 1, 1]])
    (tmp_path / "cube.obj").write_text("# bent\no cube\ns off\n" + obj(cube, OBJ_FACES[case]))
    robot = check_same(write(MESHED, MESH.format('file="cube.obj" inertia="exact"')))
    assert abs(robot.mass - 17.0 / 12.0 * 1000.0) < 1e-9


def test_a_face_of_many_corners_weighs_nothing_certain(write, tmp_path: Path) -> None:
    """MuJoCo makes two thirds of a disc of two hundred corners: that is refused, its hull and a picture of it are not."""
    n = 200
    ring = [(math.cos(2.0 * math.pi * k / n), math.sin(2.0 * math.pi * k / n)) for k in range(n)]
    sides = [f"{k + 1} {(k + 1) % n + 1} {(k + 1) % n + n + 1} {k + n + 1}" for k in range(n)]
    lids = [" ".join(str(k + n + 1) for k in range(n)), " ".join(str(n - k) for k in range(n))]
    (tmp_path / "disc.obj").write_text(obj(np.array([(*xy, z) for z in (0.0, 1.0) for xy in ring]), [*lids, *sides]))
    path = write(MESHED, MESH.format('file="disc.obj"'))
    model = mjcf_twin.compiled(path)
    assert not isinstance(model, str) and model.body_mass[1] < 0.7 * math.pi * 1000.0  # what is not to be followed
    with pytest.raises(ModelError, match="mesh 'm' has a face of 200 corners; MuJoCo's .* Export it with triangles"):
        load(path)
    assert abs(check_same(write(MESHED, MESH.format('file="disc.obj" inertia="convex"'))).mass - 500.0 * n * math.sin(
        2.0 * math.pi / n)) < 1e-3  # fmt: skip
    drawn = load(write(body('<geom type="mesh" mesh="m"/>' + WEIGHT), MESH.format('file="disc.obj"'))).visual_model
    assert drawn.geometryObjects[0].geometry.num_tris == 2 * n


BROKEN_MESHES = {
    "of another kind": ("m.ply", b"ply", "is a .ply file; expected .stl, .obj, .msh"),
    "of no kind": ("m", b"", "is a nameless file"),
    "STL of text": ("m.stl", b"solid m", "cannot be read: "),
    "STL cut short": ("m.stl", bytes(80) + struct.pack("<I", 2) + bytes(50), "cannot be read: "),
    "MSH without a head": ("m.msh", bytes(8), "cannot be read: "),
    "MSH cut short": ("m.msh", struct.pack("<4i", 4, 0, 0, 4) + bytes(40), "cannot be read: "),
    "MSH of fewer than none": ("m.msh", struct.pack("<4i", 4, -4, 0, 0), "cannot be read: "),
    "OBJ of words": ("m.obj", b"v 0 0 zero", "cannot be read: "),
    "OBJ of pairs": ("m.obj", b"v 0 0\nv 0 1\nv 0 0\nv 0 1\nv 0 0\nv 1 1\n", "cannot be read: "),
    "OBJ of 1_0": ("m.obj", obj(CORNER, ["1 2 3", "1 2 3_0"]).encode(), "cannot be read: "),
    "OBJ of corner zero": ("m.obj", obj(CORNER, ["0 1 2"]).encode(), "cannot be read: "),
    "OBJ of corners before the first": ("m.obj", obj(CORNER, ["-9 1 2"]).encode(), "cannot be read: "),
    "OBJ of nothing": ("m.obj", b"", "cannot be read: "),
    "OBJ as large as a planet": ("m.obj", obj(CORNER * 1e7, ["1 2 3"]).encode(), "cannot be read: "),
}


@pytest.mark.parametrize("case", BROKEN_MESHES)
def test_a_broken_mesh_is_refused_in_words(write, tmp_path: Path, case: str) -> None:
    """With its name, and what is wrong with its file."""
    name, data, says = BROKEN_MESHES[case]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(ModelError, match=f"mesh 'm' {says}"):
        load(write(MESHED, MESH.format(f'file="{name}"')))


def test_a_mesh_file_that_cannot_be_held_is_not_opened(write, tmp_path: Path) -> None:
    """One of more than 256 MiB, and a pipe, which would be waited for."""
    with (tmp_path / "m.stl").open("wb") as file:
        file.truncate(2**28 + 1)  # without a byte on the disk
    with pytest.raises(ModelError, match="mesh 'm' is larger than 256 MiB"):
        load(write(MESHED, MESH.format('file="m.stl"')))
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(ModelError, match="mesh 'm' is no regular file"):
        load(write(MESHED, MESH.format('file="pipe.stl"')))


def test_a_mesh_is_not_its_bounding_box(write) -> None:
    """A tetrahedron of density one in a box of 1 m3 weighs 1/6 kg, and swings as that: M = m (b^2 + c^2) / 10 about an edge."""
    tetrahedron = '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'
    robot = load(write(body('<geom type="mesh" mesh="m" density="1"/>'), tetrahedron))
    assert abs(robot.mass - 1.0 / 6.0) < 1e-12
    assert abs(robot.at().M[0, 0] - 1.0 / 6.0 * 2.0 / 10.0) < 1e-12


def test_a_capsule_swings_as_tube_and_balls(write) -> None:
    """Closed form: m r^2 (3/12) + m h^2 / 12 for the tube, and two half balls at its ends."""
    r, half, density = 0.1, 0.3, 700.0
    robot = load(write(body(f'<geom type="capsule" size="{r} {half}" density="{density}"/>')))
    tube, ball, h = density * math.pi * r * r * 2.0 * half, density * 4.0 / 3.0 * math.pi * r**3, 2.0 * half
    expected = tube * (3.0 * r * r + h * h) / 12.0 + ball * (2.0 / 5.0 * r * r + h * h / 4.0 + 3.0 / 8.0 * h * r)
    assert abs(robot.at().M[0, 0] - expected) < 1e-12 * expected and abs(robot.mass - tube - ball) < 1e-12


def test_settotalmass_scales_masses_and_moments(write) -> None:
    """Two kilograms in all, static bodies counted: a quarter of 1 kg and of its moment stays of a body as heavy as three."""
    weight = '<inertial pos="0 0 0" mass="{}" diaginertia=".4 .4 .4"/>'
    still = f"<body>{weight.format(3)}</body>"
    robot = load(write(body(weight.format(1)) + still, '<compiler settotalmass="2"/>'))
    assert abs(robot.mass - 0.5) < 1e-15 and abs(robot.at().M[0, 0] - 0.2) < 1e-15


def test_gravity_of_the_file_is_that_of_the_robot(write) -> None:
    """A pendulum hangs towards the file's gravity: h = m g l where it is level, and none where gravity is off."""
    bob = body('<inertial pos=".5 0 0" mass="2" diaginertia=".1 .1 .1"/>')
    for option, g in (("", GRAVITY), ('<option gravity="0 0 -1.62"/>', 1.62), (NO_GRAVITY, 0.0)):
        robot = load(write(bob, option))
        assert abs(rbd.dynamics.gravity_torque(robot.at())[0] - 2.0 * g * 0.5) < 1e-14 and abs(robot.gravity[2] + g) < 1e-15


WALKER = """<body name="torso" pos="0 0 1.2"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="z" type="slide" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/><geom type="capsule" size=".05 .2"/>
<body name="leg" pos="0 0 -.2"><joint name="hip" axis="0 -1 0" range="-150 0"/>
<geom type="capsule" size=".05" fromto="0 0 0 0 0 -.5"/>
<body name="foot" pos="0 0 -.5"><joint name="ankle" axis="0 -1 0" range="-45 45"/>
<geom type="box" size=".15 .05 .02"/><site name="sole" pos="0 0 -.02"/></body></body></body>"""
MOTORS = """<actuator><motor joint="hip" gear="100" ctrlrange="-1 1"/>
<motor joint="ankle" gear="60" ctrlrange="-1 1"/></actuator>"""


def test_the_root_of_a_planar_walker_has_no_motors(write) -> None:
    """Six joints, two motors: torques hold it over its foot, and the ground carries it; with motors at x and z none would."""
    robot = check_same(write(WALKER, after=MOTORS))
    assert robot.actuated_names == ("hip", "ankle") and robot.passive == {"x", "z", "pitch"}
    assert robot.effort_limit.tolist() == [100.0, 60.0]
    foot = rbd.SurfaceContact("foot", "sole", half_lengths=(0.15, 0.05))
    held = rbd.hold(robot.at(), [foot])
    assert held.tau.shape == (2,) and abs(held.tau).max() < 1e-6  # upright, its centre of mass over the ankle
    assert abs(held.forces["foot"][2] - robot.mass * GRAVITY) < 1e-6


def test_limits_of_motors_are_torques_at_the_joint(write) -> None:
    """Control times gear, not above the force range times the gear, nor what the joint takes; none where none is given."""
    for motor, expected in (
        ('<motor joint="k" gear="50" ctrlrange="-1 1"/>', 50.0),
        ('<motor joint="k" gear="-50" ctrlrange="-1 1" forcerange="-.5 .5"/>', 25.0),
        ('<motor joint="k" gear="50" ctrlrange="-1 1" ctrllimited="false"/>', 7.0),
        ('<position joint="k" kp="9" ctrlrange="-1 1" forcerange="-3 3"/>', 3.0),
        ('<general joint="k" gainprm="4" ctrlrange="-1 1"/>', 4.0),
        ('<motor joint="k" ctrlrange="-1 3"/>', 1.0),
        ('<motor joint="k"/>', math.inf),
    ):
        world = ARM.replace('name="k"', 'name="k" actuatorfrcrange="-7 7"') if expected == 7.0 else ARM
        assert load(write(world, after=f"<actuator>{motor}</actuator>")).effort_limit.tolist() == [expected]
    clamped = '<option><flag clampctrl="disable"/></option>'
    robot = load(write(ARM, clamped, '<actuator><motor joint="k" ctrlrange="-1 1"/></actuator>'))
    assert robot.effort_limit.tolist() == [math.inf]


REFUSED = {
    "gravcomp": (body(BOX, attributes='gravcomp="1"'), "", "", "body 'b' has gravcomp 1.*leave_out=..gravcomp"),
    "stiffness of a free joint": (body(BOX, '<joint name="j" type="free" stiffness="3"/>'), "", "",
        "joint 'j' has a spring .stiffness 3..*leave_out=..springs"),
    "springdamper": (body(BOX, '<joint name="j" springdamper=".1 1"/>'), "", "",
        "joint 'j' has a springdamper.*from the inertia"),
    "tendon spring": (ARM, "", '<tendon><fixed name="t" stiffness="1"><joint joint="j" coef="1"/></fixed></tendon>',
                      "tendon 't' has stiffness.*leave_out=..tendons"),
    "tendon armature": (ARM, "", '<tendon><fixed name="t" armature="1"><joint joint="j" coef="1"/></fixed></tendon>',
                        "tendon 't' has armature"),
    "two motors of a joint": (ARM, "", '<actuator><motor joint="k"/><motor name="n" joint="k"/></actuator>',
                              "actuator 'n' is a second actuator at joint 'k'.*leave_out=..actuators"),
    "motor of a tendon": (ARM, "", '<actuator><motor name="n" tendon="t"/></actuator>', "MuJoCo refuses it"),
    "motor of a site": (ARM, "", '<actuator><motor name="n" site="s"/></actuator>', "MuJoCo refuses it"),
    "motor of a ball": (body(BOX, '<joint name="j" type="ball"/>'), "", '<actuator><motor joint="j"/></actuator>',
        "'j', a ball joint"),
    "muscle": (ARM, "", '<actuator><muscle joint="j"/></actuator>', "'j' is a muscle and no motor.*leave_out"),
    "motor that only pulls": (ARM, "", '<actuator><motor joint="j" ctrlrange="0 1"/></actuator>', "torques from 0 to 1"),
    "motor of nothing": (ARM, "", '<actuator><motor joint="jj"/></actuator>', "MuJoCo refuses it"),
    "gear of zero": (ARM, "", '<actuator><motor joint="j" gear="0"/></actuator>', "the gear 0"),
    "motors off": (ARM, '<option><flag actuation="disable"/></option>', '<actuator><motor joint="j"/></actuator>', "actuation"),
    "coordinate": (ARM, '<compiler coordinate="global"/>', "", "MuJoCo refuses it"),
    "fusestatic, weighed anew": (ARM, '<compiler fusestatic="true" settotalmass="3"/>', "", "fusestatic with settotalmass"),
    "discardvisual, weighed anew": (ARM, '<compiler discardvisual="true" inertiafromgeom="true"/>', "", "discardvisual with"),
    "unknown attribute": (body('<geom size=".1" weight="3"/>'), "", "", "MuJoCo refuses it"),
    "unknown section": (ARM, "<physics/>", "", "MuJoCo refuses it"),
    "flex": (ARM, "", "<deformable><flex/></deformable>", "MuJoCo refuses it"),
    "plugin": (body(f'{BOX}<plugin plugin="x"/>'), "", "", "<plugin> is not read"),
    "capsule without size": (body('<geom name="g" type="capsule"/>'), "", "", "MuJoCo refuses it"),
    "capsule with one size": (body('<geom name="g" type="capsule" size="1"/>'), "", "", "MuJoCo refuses it"),
    "negative radius": (body('<geom name="g" size="-1"/>'), "", "", "MuJoCo refuses it"),
    "size that is nothing": (body('<geom name="g" size="1e-320"/>'), "", "", "MuJoCo refuses it"),
    "fromto of a point": (body('<geom name="g" type="capsule" size="1" fromto="1 2 3 1 2 3"/>'), "", "", "MuJoCo refuses it"),
    "flat mesh": (body('<geom type="mesh" mesh="m"/>'), MESH.format(CUBE + ' scale="1 1 0"'), "", "'m' cannot be read"),
    "corners in a plane": (body('<geom type="mesh" mesh="m"/>'), MESH.format('vertex="0 0 0 1 0 0 0 1 0 1 1 0"'), "",
        "'m' cannot be read"),
    "mesh inside out": (body('<geom type="mesh" mesh="m"/>'), MESH.format(
        'vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 1 2 0 3 1 0 2 3 1 3 2" inertia="exact"'), "", "'m' cannot be read"),
    "mesh that is not there": (body('<geom type="mesh" mesh="m"/>'), MESH.format('file="m.stl"'), "",
        "'m.stl', which is not there"),
    "builtin mesh": (body('<geom type="mesh" mesh="m"/>'), MESH.format('builtin="sphere"'), "", "MuJoCo refuses it"),
    "no such class": (body('<geom class="x" size="1"/>'), "", "", "MuJoCo refuses it"),
    "no such mesh": (body('<geom type="mesh" mesh="x"/>'), "", "", "MuJoCo refuses it"),
    "two inertials": (body('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>' * 2), "", "", "MuJoCo refuses it"),
    "boundmass of nothing": (body("", attributes='pos="1 2 3"'), '<compiler boundmass="1"/>', "", "MuJoCo refuses it"),
    "boundmass of weightless shapes": (body('<geom size="1" density="0"/>'), '<compiler boundmass="1"/>', "",
        "MuJoCo refuses it"),
    "boundmass of shapes that do not weigh": (body(BALL), '<compiler boundmass="1" inertiafromgeom="false"/>', "",
        "MuJoCo refuses it"),
    "two orientations": (body(BOX, attributes='quat="1 0 0 0" euler="1 2 3"'), "", "", "MuJoCo refuses it"),
    "free below another": (body(BOX + f'<body name="c"><freejoint/>{BALL}</body>'), "", "", "MuJoCo refuses it"),
    "range of nothing": (body(BOX, '<joint name="j" limited="true"/>'), "", "", "MuJoCo refuses it"),
    "1_0": (body('<geom size="1_0"/>'), "", "", "MuJoCo refuses it"),
    "nan in a mesh": (body('<geom type="mesh" mesh="m"/>'), MESH.format(CUBE.replace("1 1 1", "1 1 nan")), "", "vertex is"),
    "nan in a keyframe": (ARM, "", '<keyframe><key qpos="nan 0"/></keyframe>', "qpos is 'nan 0'"),
    # the tree
    "joint of the world": ("<frame><joint/></frame>" + ARM, "", "", "MuJoCo refuses it"),
    "inertial of the world": (f"<frame>{WEIGHT}</frame>" + ARM, "", "", "MuJoCo refuses it"),
    "mocap that moves": (body(BOX, attributes='mocap="true"'), "", "", "MuJoCo refuses it"),
    "plane that moves": (body(BOX + '<geom type="plane" size="1 1 1"/>'), "", "", "MuJoCo refuses it"),
    "inertial nowhere": (body(WEIGHT.replace('pos="0 0 0"', "")), "", "", "MuJoCo refuses it"),
    "inertial of no mass": (body(WEIGHT.replace('mass="1"', "")), "", "", "MuJoCo refuses it"),
    "inertial of a negative mass": (body(WEIGHT.replace('mass="1"', 'mass="-1"')), "", "", "MuJoCo refuses it"),
    "two inertias": (body(WEIGHT.replace("diag", 'fullinertia="1 1 1 0 0 0" diag')), "", "", "MuJoCo refuses it"),
    "negative moment": (body(WEIGHT.replace("1 1 1", "1 1 -1")), "", "", "MuJoCo refuses it"),
    "less than a grain": (body('<geom size=".1" mass="1e-15"/>'), "", "", "MuJoCo refuses it"),
    # classes and joints
    "another outermost class": (ARM, '<default class="x"/>', "", "MuJoCo refuses it"),
    "two classes of a name": (ARM, '<default><default class="x"/><default class="x"/></default>', "", "MuJoCo refuses it"),
    "class of no name": (ARM, "<default><default/></default>", "", "MuJoCo refuses it"),
    "plugin of a class": (ARM, '<default><geom><plugin plugin="x"/></geom></default>', "", "MuJoCo refuses it"),
    "joint of no kind": (body(BOX, '<joint name="j" type="screw"/>'), "", "", "MuJoCo refuses it"),
    "axis of zero": (body(BOX, '<joint name="j" axis="0 0 0"/>'), "", "", "MuJoCo refuses it"),
    "damping that drives": (body(BOX, '<joint name="j" damping="-1"/>'), "", "", "joint 'j' has damping -1"),
    "seven slides": (body(BOX, '<joint type="slide"/>' * 7), "", "", "MuJoCo refuses it"),
    "hinge after a ball": (body(BOX, '<joint type="ball"/><joint/>'), "", "", "MuJoCo refuses it"),
    "name without end": (body(BOX, f'<joint name="{"x" * 121}"/>'), "", "", "has a name of 121 letters"),
    "a joint's name, given to its neighbour": (body(f'{BOX}<body><joint name="bJoint_0"/>{BALL}</body>', "<joint/>"), "", "",
        "two joints are called 'bJoint_0', one of them by its body"),
    "range that is not said to be one": (body(BOX, '<joint name="j" range="-1 1"/>'), '<compiler autolimits="false"/>', "",
        "MuJoCo refuses it"),
    # shapes and meshes
    "mesh of no name": (body('<geom type="mesh"/>'), "", "", "MuJoCo refuses it"),
    "plane of no size": ('<geom type="plane"/>' + ARM, "", "", "MuJoCo refuses it"),
    "negative mass": (body('<geom size=".1" mass="-1"/>'), "", "", "MuJoCo refuses it"),
    "negative density": (body('<geom size=".1" density="-1"/>'), "", "", "MuJoCo refuses it"),
    "shell of a mesh": (body('<geom type="mesh" mesh="m" shellinertia="true"/>'), MESH.format(CUBE), "", "'m' cannot be read"),
    "fromto of a sphere": (body('<geom size=".1" fromto="0 0 0 1 0 0"/>'), "", "", "MuJoCo refuses it"),
    "pos and fromto": (body('<geom type="capsule" size=".1" pos="1 0 0" fromto="0 0 0 1 0 0"/>'), "", "", "MuJoCo refuses it"),
    "two meshes of a name": (ARM, '<asset><mesh file="a/m.stl"/><mesh file="m.obj"/></asset>', "", "MuJoCo refuses it"),
    "three corners": (MESHED, MESH.format('vertex="0 0 0 1 0 0 0 1 0"'), "", "'m' cannot be read"),
    "a third of a corner": (MESHED, MESH.format('vertex="0 0 0 1"'), "", "'m' cannot be read"),
    "half a corner": (MESHED, MESH.format(f'{POINTS} face="0 1.5 2"'), "", "MuJoCo refuses it"),
    "corner that is not there": (MESHED, MESH.format(f'{POINTS} face="0 1 7"'), "", "'m' cannot be read"),
    "triangles on a line": (MESHED, MESH.format('vertex="0 0 0 1 0 0 2 0 0 3 0 0" face="0 1 2 1 2 3"'), "",
        "'m' cannot be read"),
    "open triangles that leave out what they enclose": (MESHED, MESH.format('vertex="-3 -1 2 2 3 2 3 -3 2 -2 1 2 2 3 1" '
        'face="0 1 3 4 3 2 2 1 0" inertia="exact"'), "", "'m' cannot be read"),
    "triangles that face anywhere": (MESHED, MESH.format(DENT.replace("0 2 1 0", "0 1 2 0") + ' inertia="exact"'), "",
        "'m' cannot be read"),
    # motors and keyframes
    "motor with less than no rotor": (ARM, "", '<actuator><motor joint="j" armature="-1"/></actuator>', "has armature -1"),
    "group of motors off": (ARM, '<option actuatorgroupdisable="1"/>', "", "actuatorgroupdisable switches motors off"),
    "two keyframes of a name": (ARM, "", '<keyframe><key name="k" qpos="1 2"/><key name="k" qpos="2 3"/></keyframe>',
        "MuJoCo refuses it"),
    "quaternion of zero": (body(BOX, '<freejoint name="f"/>'), "", '<keyframe><key qpos="0 0 0 0 0 0 0"/></keyframe>',
        "<key> 'key_0' has a zero quaternion for joint 'f'"),
    # settings
    "angles in grads": (ARM, '<compiler angle="grad"/>', "", "MuJoCo refuses it"),
    "equality of a long name": (ARM, "", f'<equality><joint name="{"x" * 121}" joint1="j"/></equality>',
        "an equality has a name of 121 letters"),
    "polycoef": (ARM, "", '<equality><joint joint1="j" polycoef="0 1 1_0"/></equality>', "MuJoCo refuses it"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_would_be_another_robot_is_refused_by_name(write, case: str) -> None:
    """The message names the element, and the file is not loaded as something else."""
    world, before, after, says = REFUSED[case]
    with pytest.raises(ModelError, match=says):
        load(write(world, before, after))


def test_a_user_can_leave_out_what_the_equation_has_no_term_for(write) -> None:
    """Weight taken off, tendons, actuators, and springs, each told by the doctor; M and gravity are those of the rest."""
    world = ARM.replace('name="k"', 'name="k" stiffness="3"').replace('name="c"', 'name="c" gravcomp="1"')
    tendon = '<tendon><fixed name="t" stiffness="1"><joint joint="j" coef="1"/></fixed></tendon>'
    path = write(world, after=tendon + '<actuator><motor tendon="t"/></actuator>')
    everything = ["springs", "gravcomp", "tendons", "actuators"]
    for missing in everything[1:]:
        with pytest.raises(ModelError, match=f"leave_out=..{missing}"):
            load(path, leave_out=[each for each in everything if each != missing])
    with pytest.warns(ModelWarning, match="1 joint has a spring that is left out .'k'.; .*1 tendon is left out"):
        robot = rbd.load_robot(path, leave_out=everything)
    assert {f.kind for f in rbd.doctor(robot).warnings} >= {"spring", "gravcomp", "tendon"}
    assert robot.nu == 2 and np.isinf(robot.effort_limit).all() and robot.joint_springs() == []
    assert mjcf_twin.differences(robot, mjcf_twin.compiled(path), motors=False) == []
    for wrong in ("springs", ["spring"], 3, [None]):
        with pytest.raises(InputError, match="leave_out .* (e|E)xpected (a list of some|one) of '?actuators"):
            rbd.load_robot(path, leave_out=wrong)  # type: ignore[arg-type]


def test_what_is_not_in_force_is_not_refused(write) -> None:
    """A spring that the file switches off, and one of no stiffness."""
    spring = body(BOX, '<joint name="j" stiffness="3" damping="1"/>')
    off = load(write(spring, '<option><flag spring="disable" damper="disable"/></option>'))
    assert off.model.damping.tolist() == [0.0] and "spring" not in {f.kind for f in rbd.doctor(off).warnings}
    load(write(body(BOX, '<joint name="j" stiffness="0" springref="3"/>')))


def test_included_files_are_read_where_they_stand(write, tmp_path: Path) -> None:
    """One of the main file's folder and one of its own; a second time, one that is missing or outside is refused by name."""
    (tmp_path / "parts").mkdir()
    arm = f'<mujoco><body name="b"><joint/>{BOX}<include file="hand.xml"/></body></mujoco>'
    (tmp_path / "parts" / "arm.xml").write_text(arm)
    (tmp_path / "parts" / "hand.xml").write_text(f'<mujocoinclude><body name="c"><joint/>{BALL}</body></mujocoinclude>')
    (tmp_path / "settings.xml").write_text('<mujoco><compiler angle="radian"/><option gravity="0 0 -2"/></mujoco>')
    path = write('<include file="parts/arm.xml"/>', '<include file="settings.xml"/>')
    robot = check_same(path)
    assert robot.nv == 2 and robot.visual_model.ngeoms == 2
    for name, says in (("settings.xml", "a second time"), ("none.xml", "<include> is not read"), ("../x.xml", "outside")):
        (tmp_path.parent / "x.xml").write_text("<mujoco/>")
        with pytest.raises(ModelError, match=says):
            load(write('<include file="parts/arm.xml"/>', f'<include file="settings.xml"/><include file="{name}"/>'))


def test_includes_are_held_to_the_limits_of_a_file(write, tmp_path: Path) -> None:
    """All of them together: their bytes, their elements, how deep they stand inside each other; and each is an MJCF file."""
    arm = f"<mujoco>{ARM}</mujoco>"
    (tmp_path / "arm.xml").write_text(arm)
    (tmp_path / "robot.xml").write_text("<robot/>")
    path = write('<include file="arm.xml"/>')
    assert load(path, limits=rbd.model.FileLimits(max_depth=5)).nv == 2
    for limits, says in (
        (rbd.model.FileLimits(max_depth=4), "its includes bring elements 5 deep"),
        (rbd.model.FileLimits(max_bytes=len(path.read_bytes())), "arm.xml is larger than"),
    ):
        with pytest.raises(ModelError, match=says):
            load(path, limits=limits)
    (tmp_path / "leg.xml").write_text(re.sub('name="(.)"', r'name="\1\1"', arm))
    both = write('<include file="arm.xml"/><include file="leg.xml"/>')
    assert load(both).nv == 4
    with pytest.raises(ModelError, match="its includes bring more than 100 files, .* MB or"):
        load(both, limits=rbd.model.FileLimits(max_bytes=len(arm) + 10))
    with pytest.raises(ModelError, match="<include> brings 'robot.xml', whose first element is <robot>; expected <mujoco>"):
        load(write(ARM + '<include file="robot.xml"/>'))
    with pytest.raises(ModelError, match="<include> is not read: its file 'x+ is not there"):
        load(write(ARM + f'<include file="{"x" * 300}"/>'))  # longer than a name may be on a disk


def test_meshes_of_a_folder_beside_are_read_where_it_is_given(tmp_path: Path) -> None:
    """A meshdir above the file's own folder is refused, unless `package_dirs` has it."""
    (tmp_path / "xml").mkdir()
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNER)
    (tmp_path / "corner.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    path = tmp_path / "xml" / "m.xml"
    world = body('<geom type="mesh" mesh="corner"/>')
    asset = '<asset><mesh file="corner.obj"/></asset>'
    path.write_text(f'<mujoco><compiler meshdir=".."/>{asset}<worldbody>{world}</worldbody></mujoco>')
    with pytest.raises(ModelError, match="'corner.obj', outside the folder of m.xml.*package_dirs"):
        load(path)
    assert abs(load(path, package_dirs=[tmp_path]).mass - 1000.0) < 1e-9


def test_a_file_says_what_it_means_to_be_left_out(write) -> None:
    """Air, and the limit of a ball joint, are in no term: the robot is loaded, and its remarks name them."""
    world = body(BOX + '<site name="s"/>', '<joint name="j" type="ball" range="0 30"/>') + '<site name="t" pos="0 0 1"/>'
    robot = load(
        write(
            world,
            '<option density="1.2"/>',
            '<tendon><spatial name="t" range="-1 1"><site site="s"/><site site="t"/></spatial></tendon>',
        )
    )
    found = {finding.kind: finding for finding in rbd.doctor(robot).warnings}
    assert "forces of a fluid" in found["fluid"].text
    assert found["limit"].where == "j" and "a ball joint with a limit" in found["limit"].text
    assert found["tendon"].where == "t" and "with its limit" in found["tendon"].text


def test_a_keyframe_without_a_posture_is_none(write) -> None:
    """One that gives velocities or controls alone is passed over; the other keeps its name."""
    robot = load(write(ARM, after='<keyframe><key name="v" qvel="1 2"/><key name="q" qpos=".1 .2"/></keyframe>'))
    assert set(robot.postures) >= {"qpos0", "q"} and "v" not in robot.postures
    assert robot.posture("q").tolist() == [0.1, 0.2]


def test_a_site_with_two_ends_is_in_their_middle(write) -> None:
    """And its z axis points from the second end to the first, as MuJoCo's does."""
    path = write(body(BOX + '<site name="s" type="capsule" size=".1" fromto="1 0 0 3 0 0"/>'))
    state, model = load(path).at(), mjcf_twin.compiled(path)
    assert not isinstance(model, str)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    X_WS = state.frame("s").X_WF
    assert np.abs(X_WS.translation - [2.0, 0.0, 0.0]).max() < 1e-15
    assert np.abs(X_WS.rotation[:, 2] - [-1.0, 0.0, 0.0]).max() < 1e-15
    assert np.abs(data.site_xmat[0].reshape(3, 3) - X_WS.rotation).max() < 1e-15


def test_keyframes_keep_their_joints_and_quaternions(write) -> None:
    """MuJoCo's w, x, y, z becomes x, y, z, w, normalised; joints are in the file's order, siblings too."""
    arms = "".join(f'<body name="{name}"><joint name="{name}"/>{BALL}</body>' for name in "za")
    world = f'<body name="b"><freejoint/>{BOX}{arms}</body>'
    key = '<keyframe><key name="k" qpos="1 2 3 2 0 0 0 .1 .2"/><key qpos="0 0 0 0 1 0 0 0 0"/></keyframe>'
    robot = load(write(world, after=key))
    assert list(robot.joints)[1:] == ["z", "a"]
    assert robot.posture("k").tolist() == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.1, 0.2]
    assert robot.posture("key_1")[3:7].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_strange_inertias_name_their_body(write) -> None:
    """Not the joint it hangs from: two bodies may hang from one."""
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="{}"/>'
    path = write(body(inertial.format("1 1 1") + f'<body name="lid">{inertial.format("1 1 9")}</body>'))
    with pytest.raises(ModelError, match=r"MuJoCo refuses it: inertia must satisfy A . B >= C.*'lid', line 1"):
        load(path)


def drawn(robot: rbd.Robot) -> dict[str, str]:
    """{name: kind of shape} of what is drawn."""
    return {each.name: type(each.geometry).__name__ for each in robot.visual_model.geometryObjects}


def test_a_shape_fitted_to_a_mesh_is_not_the_mesh(write) -> None:
    """Whichever stands first in the file: the box that is fitted is drawn as a box, the mesh as itself."""
    fitted, whole = '<geom name="fitted" type="box" mesh="m"/>', '<geom name="whole" type="mesh" mesh="m"/>'
    for shapes in (fitted + whole, whole + fitted):
        robot = load(write(body(WEIGHT + shapes), MESH.format(DENT)))
        assert drawn(robot) == {"fitted": "Box", "whole": "BVHModelOBBRSS"}
        assert [each.geometry.num_tris for each in robot.visual_model.geometryObjects if each.name == "whole"] == [6]


def test_a_mesh_that_cannot_be_read_is_a_box_in_each_place(write, tmp_path: Path) -> None:
    """And told once."""
    (tmp_path / "m.stl").write_bytes(b"solid")
    shapes = '<geom type="mesh" mesh="m"/><geom type="mesh" mesh="m" pos="1 0 0"/>'
    robot = load(write(body(WEIGHT + shapes), MESH.format('file="m.stl"')))
    with pytest.warns(ModelWarning, match="boxes in place of 1 mesh: 'm.stl'"):
        assert robot.visual_model.ngeoms == 2
    assert drawn(robot) == {"bGeom_0": "Box", "bGeom_1": "Box"}
    assert [each.placement.translation[0] for each in robot.visual_model.geometryObjects] == [0.0, 1.0]


def test_all_shapes_are_drawn_though_a_name_is_taken(write) -> None:
    """A shape may be called what another would be called by its number; height fields are not drawn."""
    field = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/></asset>'
    names = '<geom name="bGeom_1" size=".1"/><geom size=".2"/><geom name="b_bGeom_1_1" size=".3"/><geom size=".4"/>'
    robot = load(write('<geom type="hfield" hfield="h"/>' + body(names), field))
    assert sorted(each.geometry.radius for each in robot.visual_model.geometryObjects) == [0.1, 0.2, 0.3, 0.4]
    assert sorted(each.geometry.radius for each in robot.collision_model.geometryObjects) == [0.1, 0.2, 0.3, 0.4]


def test_a_floor_is_the_half_space_below_it(write) -> None:
    """Where the file puts it: its surface goes through its own place, and its normal is its own z axis."""
    robot = load(write('<geom name="floor" type="plane" size="1 1 1" pos="0 0 .2" euler="90 0 0"/>' + body(BALL)))
    floor = robot.collision_model.geometryObjects[0]
    assert type(floor.geometry).__name__ == "Halfspace" and floor.parentJoint == 0 and floor.geometry.d == 0.0
    assert np.abs(floor.placement.rotation @ floor.geometry.n - [0.0, -1.0, 0.0]).max() < 1e-15  # z, turned about x
    assert floor.placement.translation.tolist() == [0.0, 0.0, 0.2]


def test_a_shape_has_its_own_colour_or_its_materials(write) -> None:
    """Its own before the material's, white where that says none, and MuJoCo's grey where it has neither."""
    materials = '<material name="red" rgba="1 0 0 1"/><material name="plain"/>'
    grey = [0.5, 0.5, 0.5, 1.0]
    for says, expected in (
        ('rgba="0 1 0 1"', [0.0, 1.0, 0.0, 1.0]),
        ('material="red"', [1.0, 0.0, 0.0, 1.0]),
        ('material="red" rgba="0 1 0 .5"', [0.0, 1.0, 0.0, 0.5]),
        ('material="plain"', [1.0] * 4),
        ("", grey),
    ):
        robot = load(write(body(f'<geom size=".1" {says}/>'), f"<asset>{materials}</asset>"))
        assert robot.visual_model.geometryObjects[0].meshColor.tolist() == expected


def test_a_motion_of_such_a_robot_can_be_loaded_again(write, tmp_path: Path) -> None:
    """What was left out is part of where it came from."""
    path = write(body(BOX, '<joint name="j" axis="0 1 0" stiffness="3"/>'))
    robot = load(path, leave_out=["springs"])
    motion = rbd.simulate(robot.at(), duration=0.01, step=0.005)
    motion.save(tmp_path / "motion.npz")
    again = rbd.Trajectory.load(tmp_path / "motion.npz").robot
    assert again.leave_out == {"springs"} and again.nu == 0


def test_mutants_are_refused_or_mujocos_own(exhaustive: bool) -> None:
    """Files changed at random, of a fixed seed: none is silently another robot than MuJoCo's."""
    n = 200 if exhaustive else 16
    script = Path(__file__).with_name("fuzz.py")
    command = [sys.executable, str(script), "--mjcf", "--n", str(n), "--seed", "7"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    told = re.search(rf"{n} mutants in .*: (\d+) refused, (\d+) valid, (\d+) failure, (\d+) unjudged", run.stdout)
    assert told and run.returncode == 0 and told[3] == "0", run.stdout + run.stderr
    assert min(int(told[1]), int(told[2])) > 0.2 * n, "mutants that all go one way test nothing"


def test_mujocos_own_files_are_refused_or_the_same() -> None:
    """Those that its package brings."""
    for path in Path(mujoco.__file__).parent.glob("**/*.xml"):
        model = mjcf_twin.compiled(path)
        try:
            robot = load(path)
        except rbd.RbdError as error:
            assert str(error)
            continue
        assert not isinstance(model, str) and mjcf_twin.differences(robot, model) == []
