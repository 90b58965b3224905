"""MJCF files changed at random: each must be refused by name, or have MuJoCo's M, gravity, motors and limits to 1e-8.

    python tests/fuzz.py --mjcf --n 4000 --seed 0        (mutant 1234 alone: --start 1234 --n 1)

Most changes leave a file that MuJoCo takes: attributes of MJCF are added, taken away and given other values, elements are
doubled, moved and put into frames, classes and settings are added. What MuJoCo refuses and rbd loads is counted as unjudged.
"""

from __future__ import annotations

import contextlib
import copy
import random
import warnings
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mjcf_twin
import numpy as np

import rbd

Element = ElementTree.Element
SCREEN = 1500

_CUBE = 'vertex="0 0 0 .2 0 0 0 .3 0 0 0 .4 .2 .3 0 .2 0 .4 0 .3 .4 .2 .3 .4"'
_DENT = 'vertex="0 0 0 .3 0 0 0 .3 0 0 0 .3 .1 .1 .1" face="0 2 1 0 1 3 0 3 2 1 2 4 2 3 4 3 1 4"'
SOURCES = {
    "arm": """<mujoco model="arm"><compiler angle="radian"/><option gravity="0 0 -9.81"/>
<default><joint damping="0.1" armature="0.02"/><geom density="700"/><default class="thin"><geom size="0.03"/></default>
</default>
<worldbody><geom type="plane" size="1 1 1"/><body name="base" pos="0 0 1"><geom type="box" size=".1 .1 .1"/>
<body name="upper" pos="0 0 .2" quat="1 .2 0 0"><joint name="a" axis="0 1 0" range="-1 1"/>
<geom class="thin" type="capsule" fromto="0 0 0 0 0 .4"/>
<body name="lower" pos="0 0 .4" euler="0.1 0.2 0.3"><joint name="b" axis="1 1 0" pos="0 .1 0" ref=".2"/>
<joint name="c" type="slide" axis="0 0 1" range="-.1 .2"/>
<geom type="cylinder" size=".03 .2" mass="0.6" contype="0" conaffinity="0"/>
<site name="tip" pos="0 0 .2"/></body></body></body></worldbody>
<actuator><motor joint="a" gear="50" ctrlrange="-1 1"/><motor name="m" joint="c" gear="20"/></actuator></mujoco>""",
    "walker": """<mujoco><compiler autolimits="true" settotalmass="0"/>
<default><geom contype="1"/><motor ctrlrange="-1 1"/></default>
<worldbody><body name="torso" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
<joint name="pitch" axis="0 1 0"/><geom type="ellipsoid" size=".1 .05 .2"/>
<geom type="sphere" size=".1" pos="0 0 .3" group="2"/>
<frame pos="0 .1 0" euler="0 10 0"><body name="thigh" pos="0 0 -.2"><joint name="hip" axis="0 -1 0" range="-60 30"/>
<geom type="capsule" size=".04 .2" pos="0 0 -.2"/><body name="foot" pos="0 0 -.4"><joint name="ankle" axis="0 -1 0"/>
<inertial pos=".05 0 0" mass=".4" diaginertia=".002 .003 .002"/></body></body></frame></body></worldbody>
<actuator><motor joint="hip" gear="100"/><position joint="ankle" kp="30" forcerange="-20 20"/></actuator></mujoco>""",
    "floating": f"""<mujoco><asset><mesh name="cube" {_CUBE}/><mesh name="dent" {_DENT} scale="1 2 1" inertia="exact"/></asset>
<worldbody><body name="hull" pos="1 2 3" quat=".5 .5 .5 .5"><freejoint name="root"/><geom type="mesh" mesh="cube"/>
<geom type="mesh" mesh="dent" pos="0 0 .5" axisangle="1 0 0 30" density="400"/>
<body name="head" pos="0 0 .6"><joint name="neck" type="ball" pos="0 0 -.1"/>
<geom type="box" size=".1 .2 .1" shellinertia="true"/>
<body name="eye" pos="0 .2 0"><joint name="lid" axis="0 0 1"/>
<inertial pos="0 0 .1" mass=".2" fullinertia=".02 .02 .03 .001 0 0"/>
</body></body></body><body name="box" pos="0 3 0"><freejoint/><geom type="box" size=".1 .1 .2"/></body></worldbody>
<actuator><general joint="lid" gainprm="4" ctrlrange="-2 2" gear="2"/></actuator></mujoco>""",
    "bound": """<mujoco><compiler boundmass=".3" boundinertia=".01" inertiafromgeom="auto" inertiagrouprange="0 3"/>
<default><default class="limb"><joint axis="0 1 0" limited="true" range="-40 40"/><geom type="capsule" size=".02 .1"/>
<default class="small"><geom size=".01"/></default></default></default>
<worldbody><body name="a" childclass="limb"><joint name="j0"/><geom name="g"/><geom class="small" pos="0 .1 0" group="4"/>
<body name="b" pos="0 0 .2" zaxis="0 1 1"><joint name="j1" range="-10 80" armature=".1"/><geom/><body name="c" pos=".1 0 0">
<geom/></body>
<body name="d" pos="0 .1 .2" xyaxes="1 0 0 0 0 1"><joint name="j2" class="small" frictionloss=".1"/>
<geom class="small" rgba="1 0 0 1"/>
</body></body></body></worldbody><actuator><motor joint="j0" forcerange="-3 3"/><velocity joint="j2" kv="2"/></actuator>
<keyframe><key name="up" qpos=".1 .2 .3"/></keyframe></mujoco>""",
}

_NUMBERS = "0 1 -1 0.5 2 1e-3 0.1 30 1e-9 -0.2 90 nan inf 1_0 1e6".split()
_TRUTH = ("true", "false", "true", "yes")
_AXES = ("0 0 1", "1 0 0", "1 1 0", "-1 0 0.5", "0 0 0", "0 0 1e-8", "0 0")
_POSES = {
    "pos": ("0.1 0.2 0.3", "1 0 0", "0 0 0", "1 2"), "quat": ("1 0 0 0", "0 1 0 0", "1 2 3 4", "0 0 0 0", "-1 0 .1 0"),
    "euler": ("10 20 30", "0.1 0.2 0.3", "90 0 0"), "axisangle": ("1 0 0 45", "1 1 1 0.3"), "zaxis": ("0 0 1", "0 0 -1",
    "1 0 1"),
    "xyaxes": ("0 1 0 -1 0 0", "1 1 0 0 1 1"),
}  # fmt: skip
_MOTOR = {
    "gear": ("3", "-2", "0", "1 2 3", "1 0 0 0 0 0"), "ctrlrange": ("-1 1", "-2 3", "0 1", "1 -1"), "ctrllimited": _TRUTH,
    "forcerange": ("-5 5", "-1 2"), "forcelimited": _TRUTH, "armature": _NUMBERS, "joint": ("a", "hip", "j1", "lid", "neck",
    "x"),
    "jointinparent": ("a", "j2"), "class": ("thin", "limb", "main", "none"), "site": ("tip",), "kp": _NUMBERS, "tendon": ("t",),
    "gainprm": ("3", "-1 2", "0"), "biastype": ("none", "affine"), "dyntype": ("none", "filter"), "group": ("1",),
    "kv": _NUMBERS,
    "delay": ("0.1",), "damping": _NUMBERS, "inheritrange": ("1",), "lengthrange": ("0 1",),
}  # fmt: skip
VALUES: dict[str, dict[str, tuple[str, ...] | list[str]]] = {
    "compiler": {
        "angle": ("degree", "radian", "turns"), "autolimits": _TRUTH, "balanceinertia": _TRUTH, "boundinertia": _NUMBERS,
        "boundmass": _NUMBERS, "coordinate": ("local", "global"), "eulerseq": ("zyx", "XYZ", "xYz", "ZXZ", "xy", "abc"),
        "inertiafromgeom": ("true", "false", "auto"), "inertiagrouprange": ("0 1", "2 5", "0 5", "3 2"),
        "settotalmass": _NUMBERS,
        "discardvisual": _TRUTH, "fusestatic": _TRUTH, "alignfree": _TRUTH, "fitaabb": _TRUTH, "strippath": _TRUTH,
        "usethread": _TRUTH, "meshdir": ("meshes", ".."), "conflict": ("warn",), "saveinertial": _TRUTH,
    },
    "option": {
        "gravity": ("0 0 0", "0 0 -1.6", "1 2 3", "0 0"), "density": _NUMBERS, "viscosity": _NUMBERS, "timestep": ("0.01",),
        "wind": ("1 0 0",), "integrator": ("Euler", "RK4", "implicitfast"), "impratio": ("2",), "actuatorgroupdisable": ("1",),
    },
    "flag": {k: ("enable",
    "disable") for k in "gravity spring damper limit constraint equality actuation clampctrl contact".split()},
    "body": {**_POSES, "gravcomp": _NUMBERS, "mocap": _TRUTH, "childclass": ("thin", "limb", "small", "main", "none"),
             "user": ("1 2",), "fuse": _TRUTH, "simple": _TRUTH, "sleep": ("auto", "never")},
    "frame": {**_POSES, "childclass": ("thin", "limb", "small")},
    "inertial": {**_POSES, "mass": _NUMBERS, "diaginertia": ("1 1 1", ".1 .2 .25", "1 1 3", "0 0 0", "-1 1 1"),
                 "fullinertia": ("1 1 1 0 0 0", ".1 .2 .2 .01 .02 .03", "1 1 1 2 0 0")},
    "joint": {
        "type": ("hinge", "slide", "ball", "free", "screw"), "axis": _AXES, "pos": _POSES["pos"], "range": ("-1 1", "0 90",
        "1 -1", "0 0"),
        "limited": _TRUTH, "ref": _NUMBERS, "armature": _NUMBERS, "damping": _NUMBERS, "stiffness": _NUMBERS,
        "springref": _NUMBERS,
        "springdamper": ("0.1 1", "0 0"), "frictionloss": _NUMBERS, "actuatorfrcrange": ("-2 2", "-1 5"), "group": ("2",),
        "actuatorfrclimited": _TRUTH, "margin": ("0.1",), "class": ("thin", "limb", "small", "none"), "user": ("1",),
        "actuatorgravcomp": _TRUTH, "solreflimit": ("0.02 1",), "name": ("a", "hip", "new"),
    },
    "freejoint": {"align": ("true", "false", "auto"), "group": ("1",)},
    "geom": {
        **_POSES, "type": ("sphere", "capsule", "cylinder", "ellipsoid", "box", "plane", "mesh", "hfield", "sdf", "cone"),
        "size": ("0.1", "0.1 0.2", "0.1 0.2 0.3", "0", "-0.1 0.1 0.1", "", "1e-12 1 1"), "mass": _NUMBERS, "density": _NUMBERS,
        "fromto": ("0 0 0 0 0 1", "0 1 0 1 0 0", "0 0 0 0 0 0"), "shellinertia": _TRUTH, "mesh": ("cube", "dent", "none"),
        "group": ("0", "1", "4", "9"), "contype": ("0", "1"), "conaffinity": ("0",), "class": ("thin", "limb", "small", "none"),
        "fitscale": ("2",), "friction": ("1",), "rgba": ("1 0 0 1",), "fluidshape": ("ellipsoid",), "margin": ("0.1",),
        "condim": ("3",), "gap": ("0.1",), "material": ("none",), "hfield": ("h",),
    },
    "mesh": {"scale": ("1 1 1", "-1 1 1", "1 2 3", "0 1 1", "1e-3 1e-3 1e-3", "-1 -1 -1"), "refpos": ("1 0 0", "0 .1 0"),
             "refquat": ("1 1 0 0", "0 0 0 0"), "inertia": ("convex", "exact", "legacy", "shell", "none"),
             "maxhullvert": ("5",),
             "file": ("none.stl", "/etc/passwd"), "builtin": ("sphere",), "face": ("0 2 1 0 1 3 0 3 2 1 2 3", "0 1 2", "0 1 9"),
             "name": ("cube", "other"), "smoothnormal": _TRUTH},
    **{tag: _MOTOR for tag in ("motor", "general", "position", "velocity", "muscle", "damper", "cylinder", "pid")},
    "key": {"qpos": ("0 0 0", "1"), "name": ("k",), "ctrl": ("0",)},
}  # fmt: skip
ELEMENTS = (
    '<frame pos="0.1 0 0"/>', "<body/>", '<body name="new" pos="0 0 .1"><joint name="jn"/><geom size=".1"/></body>',
    '<body name="still"><geom type="box" size=".1 .2 .1"/></body>', '<geom size="0.05"/>',
    '<geom type="capsule" size=".1 .1"/>',
    '<geom type="capsule"/>', '<joint name="extra" axis="1 0 0"/>', "<joint/>", '<joint type="ball"/>', "<freejoint/>",
    '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>', '<site name="s" pos="1 0 0"/>', '<camera pos="0 0 1"/>', "<light/>",
    '<include file="other.xml"/>', '<replicate count="2"><geom size=".1"/></replicate>', '<attach model="m" body="b"/>',
    '<composite type="cable"/>', '<flexcomp name="f"/>', '<plugin plugin="p"/>', "<unknown/>",
)  # fmt: skip
SECTIONS = (
    "<compiler/>", '<compiler angle="degree"/>', "<option/>", "<option><flag/></option>", "<default/>", "<visual/>", "<size/>",
    '<default><geom type="box" size=".1 .1 .1"/></default>', '<default><joint armature=".3"/></default>', "<statistic/>",
    '<default><default class="thin2"><geom mass="2"/></default></default>', '<default class="other"/>', "<custom/>",
    "<sensor/>",
    '<tendon><fixed name="t"><joint joint="a" coef="1"/></fixed></tendon>', '<contact><exclude body1="a" body2="b"/></contact>',
    '<tendon><fixed name="t" stiffness="3"><joint joint="j0" coef="1"/></fixed></tendon>', "<worldbody/>",
    '<tendon><fixed name="t" armature="1"><joint joint="hip" coef="1"/></fixed></tendon>', "<deformable/>", "<extension/>",
    "<odd/>",
    '<actuator><motor joint="b"/></actuator>', '<actuator><general tendon="t"/></actuator>',
    '<actuator><muscle joint="a"/></actuator>',
    '<default><position kp="9"/></default>', '<default><general gear="7" ctrlrange="-3 3"/></default>',
    '<keyframe><key qpos="0"/></keyframe>', '<equality><joint joint1="a" joint2="c"/></equality>',
    '<worldbody><body name="more"><freejoint/><geom size=".1"/></body></worldbody>',
)  # fmt: skip


def sources() -> dict[str, bytes]:
    """{name: file} to be changed."""
    return {name: text.encode() for name, text in SOURCES.items()}


class _Changer:
    """One file and the ways to change it."""

    STEPS = ("give " * 8 + "take scale scale double drop move wrap insert insert section section class_ nudge nudge").split()

    def __init__(self, data: bytes, rng: random.Random) -> None:
        self.tree, self.rng = ElementTree.fromstring(data), rng

    def any(self, *tags: str) -> Element:
        """An element; each tag is as likely as any other."""
        found = [e for e in self.tree.iter() if e is not self.tree and (not tags or e.tag in tags)]
        if not found:
            return ElementTree.Element("nothing")
        tag = self.rng.choice(sorted({e.tag for e in found}))
        return self.rng.choice([e for e in found if e.tag == tag])

    def above(self, one: Element) -> Element:
        return next((e for e in self.tree.iter() if one in list(e)), ElementTree.Element("nothing"))

    def give(self) -> None:
        one = self.any(*VALUES)
        key = self.rng.choice(sorted(VALUES.get(one.tag, {"x": ()})))
        one.set(key, self.rng.choice(VALUES.get(one.tag, {}).get(key) or ("1",)))

    def take(self) -> None:
        one = self.any()
        if one.attrib:
            del one.attrib[self.rng.choice(sorted(one.attrib))]

    def scale(self) -> None:
        one = self.any("geom", "inertial", "joint", "body", "mesh", "motor")
        by = self.rng.choice((2.0, 0.1, -1.0, 1.3, 1e-3, 30.0))
        for key, text in one.attrib.items():
            if self.rng.random() < 0.5:
                with contextlib.suppress(ValueError):
                    one.set(key, " ".join(f"{by * float(word):.9g}" for word in text.split()))

    def nudge(self) -> None:
        """A little change to every number of an element: it stays what it is, and is another."""
        for key, text in (one := self.any("geom", "inertial", "joint", "body", "mesh", "frame")).attrib.items():
            if key not in ("face", "group", "contype", "conaffinity", "name"):
                with contextlib.suppress(ValueError):
                    one.set(key, " ".join(f"{float(w) * (1.0 + 0.2 * self.rng.random()):.9g}" for w in text.split()))

    def double(self) -> None:
        one = self.any("geom", "body", "joint", "motor", "frame", "default", "mesh", "inertial", "actuator")
        twin = copy.deepcopy(one)
        for e in twin.iter() if self.rng.random() < 0.8 else ():
            if e.get("name"):
                e.set("name", e.get("name", "") + "_2")
        self.above(one).append(twin)

    def drop(self) -> None:
        one = self.any()
        with contextlib.suppress(ValueError):
            self.above(one).remove(one)

    def move(self) -> None:
        one, other = self.any("geom", "body", "joint", "site", "inertial", "frame"), self.any("body", "frame", "worldbody")
        if other not in list(one.iter()) and one.tag != "nothing":
            self.above(one).remove(one)
            other.append(one)

    def wrap(self) -> None:
        one = self.any("geom", "body", "joint", "inertial", "site")
        above = self.above(one)
        if one.tag != "nothing":
            frame = ElementTree.Element("frame", {"pos": "0.1 -0.2 0.3", "euler": self.rng.choice(("0 0 0", "10 20 30"))})
            above[list(above).index(one)] = frame
            frame.append(one)

    def insert(self) -> None:
        self.any("body", "body", "frame", "worldbody").append(ElementTree.fromstring(self.rng.choice(ELEMENTS)))

    def section(self) -> None:
        self.tree.insert(self.rng.randrange(len(self.tree) + 1), ElementTree.fromstring(self.rng.choice(SECTIONS)))

    def class_(self) -> None:
        """A default for everything, or for a class."""
        tag = self.rng.choice(("geom", "joint", "motor", "mesh", "position"))
        key = self.rng.choice(sorted(VALUES[tag]))
        entry = ElementTree.Element(tag, {key: self.rng.choice(list(VALUES[tag][key]))})
        found = self.tree.findall(".//default")
        if found:
            self.rng.choice(found).append(entry)
        else:
            top = ElementTree.SubElement(self.tree, "default")
            top.append(entry)


def mutant(seed: int, i: int, files: dict[str, bytes]) -> tuple[bytes, str, str]:
    """(file, "mjcf", what was done to it) of mutant i of a seed."""
    rng = random.Random(f"mjcf:{seed}:{i}")
    name = rng.choice(sorted(files))
    changer = _Changer(files[name], rng)
    steps = [rng.choice(_Changer.STEPS) for _ in range(rng.choice((1, 1, 2, 2, 3, 4)))]
    for step in steps:
        getattr(changer, step)()
    return ElementTree.tostring(changer.tree, encoding="utf-8"), "mjcf", f"{name}: {', '.join(steps)}"


def judge(path: Path, root: str = "mjcf", seed: int = 0) -> tuple[str, str]:
    """("refused", message), ("valid", ""), ("unjudged", why MuJoCo refuses it) or ("failure", what is wrong)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", rbd.errors.ModelWarning)
            robot = rbd.load_robot(path)
            robot.visual_model, robot.collision_model  # noqa: B018
            rbd.doctor(robot)
            state = rbd.State(robot, robot.posture("qpos0"), np.zeros(robot.nv))
            a = rbd.dynamics.free_acceleration(state, np.zeros(robot.nu))
    except rbd.RbdError as error:
        text = str(error)
        return ("refused", text) if 0 < len(text) <= SCREEN else ("failure", f"a message of {len(text)} letters: {text[:80]}")
    except Exception as error:
        return "failure", f"{type(error).__name__}: {error!s:.200}"
    if not np.isfinite(a).all():
        return "failure", "the acceleration is not finite"
    theirs = mjcf_twin.compiled(path)
    if isinstance(theirs, str):
        return "unjudged", theirs
    apart = mjcf_twin.differences(robot, theirs, seed)
    return ("failure", "; ".join(apart)[:400]) if apart else ("valid", "")
