"""Robot files broken on purpose: each is refused by the name of what is wrong, before Pinocchio sees it."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from forked import alone
from work import calls

import rbd
from rbd.errors import InputError, ModelError, RbdError
from rbd.model.files import read
from rbd.model.input_files import FileLimits, read_xml
from rbd.model.urdf import check_urdf
from rbd.robots import catalogue

BODY = (
    '<inertial><origin xyz="0 0 -0.1" rpy="0 0 0.5"/><mass value="1"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="2"/>'
GOOD = f"""<?xml version="1.0"?>
<robot name="good">
  <link name="base">{BODY}</link> <link name="thigh">{BODY}</link> <link name="shin">{BODY}</link>
  <link name="eye"/> <link name="foot">{BODY}</link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="thigh"/><origin xyz="0 0.1 0" rpy="0.1 0 0"/>
    <axis xyz="0 1 0"/>{LIMIT}<dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="knee" type="prismatic"><parent link="thigh"/><child link="shin"/><axis xyz="0 0 1"/>{LIMIT}</joint>
  <joint name="ankle" type="continuous"><parent link="shin"/><child link="foot"/><axis xyz="1 0 0"/>
    <mimic joint="hip" multiplier="2" offset="0.1"/></joint>
  <joint name="weld" type="fixed"><parent link="base"/><child link="eye"/></joint>
</robot>
"""
SPARE = f'<link name="spare">{BODY}</link>'


def swapped(old: str, new: str, nth: int = 0) -> str:
    """GOOD with the nth occurrence of a text replaced."""
    parts = GOOD.split(old)
    assert len(parts) > nth + 1, old
    return old.join(parts[: nth + 1]) + new + old.join(parts[nth + 1 :])


def more(text: str) -> str:
    return GOOD.replace("</robot>", text + "</robot>")


def hinge(name: str, parent: str, child: str, kind: str = "fixed") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{LIMIT}</joint>'


NO_NUMBERS = ["nan", "NaN", "-nan", "inf", "-inf", "1e400", "1e13", "", " "]
NO_NUMBERS += [" 1", "\t1\n", "one", "0x10", "1_0", "1,5", "١", "1 2", "\u00a01", "${m}"]
INERTIA = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
BROKEN: dict[str, tuple[str, str]] = {
    # one number of a link or a joint after the other
    **{f"mass {x!r}": (swapped('<mass value="1"/>', f'<mass value="{x}"/>', 1), "mass of link 'thigh'") for x in NO_NUMBERS},
    **{f"inertia {x!r}": (swapped('ixy="0"', f'ixy="{x}"', 2), "inertia of link 'shin': ixy") for x in NO_NUMBERS[:8]},
    **{f"axis {x!r}": (swapped("0 1 0", f"0 {x} 0"), "axis of joint 'hip'") for x in ("nan", "inf", "", "1e400", "1 0")},
    **{f"origin {x!r}": (swapped("0 0.1 0", f"0 {x} 0"), "origin of joint 'hip'") for x in ("nan", "inf", "", "1e7", "1 0")},
    **{f"rpy {x!r}": (swapped("0.1 0 0", f"{x} 0 0"), "origin of joint 'hip': rpy") for x in ("nan", "inf", "", "1e400")},
    **{f"lower {x!r}": (swapped('lower="-1"', f'lower="{x}"', 1), "limit of joint 'knee'") for x in ("nan", "-inf", "", "a")},
    **{f"effort {x!r}": (swapped('effort="5"', f'effort="{x}"', 1), "limit of joint 'knee'") for x in ("nan", "inf", "")},
    "centre of mass": (swapped("0 0 -0.1", "0 nan -0.1", 3), "origin of the inertial of link 'foot'"),
    "damping": (swapped('damping="0.1"', 'damping="nan"'), "dynamics of joint 'hip': damping"),
    "negative friction": (swapped('friction="0.2"', 'friction="-1"'), "joint 'hip' has friction -1"),
    "multiplier": (swapped('multiplier="2"', 'multiplier="nan"'), "mimic of joint 'ankle': multiplier"),
    # numbers that are none of a body or a joint
    "negative mass": (swapped('<mass value="1"/>', '<mass value="-1"/>', 3), "link 'foot' has a mass of -1 kg"),
    "a mass below rounding": (swapped('<mass value="1"/>', '<mass value="1e-20"/>', 3), "link 'foot' has a mass of 1e-20 kg"),
    "no mass": (swapped('<mass value="1"/>', "", 1), "mass of link 'thigh': value is missing"),
    "no inertia": (swapped(INERTIA, "", 1), "inertia of link 'thigh'"),
    "half an inertia": (swapped(' iyz="0"', "", 1), "inertia of link 'thigh': iyz is missing"),
    "zero axis": (swapped("0 1 0", "0 0 0"), "joint 'hip' is revolute, and its axis is zero"),
    "short axis": (swapped("0 1 0", "0 1e-7 0"), "joint 'hip' is revolute, and its axis is 1e-07 long; expected a unit vector"),
    "zero axis of a slide": (swapped("0 0 1", "0 0 0"), "joint 'knee' is prismatic, and its axis is zero"),
    "zero axis of a wheel": (swapped('xyz="1 0 0"', 'xyz="-0 0 0.0"'), "joint 'ankle' is continuous, and its axis is zero"),
    "tiny axis": (swapped("0 1 0", "0 1e-200 0"), "axis of joint 'hip'|joint 'hip' is revolute, and its axis is"),
    "axis without numbers": (swapped('<axis xyz="0 1 0"/>', "<axis/>"), "axis of joint 'hip': xyz is missing"),
    "swapped limits": (swapped('lower="-1" upper="1"', 'lower="1" upper="-1"'), "joint 'hip' has its limits swapped"),
    "swapped limits of a slide": (swapped('upper="1"', 'upper="-2"', 1), "joint 'knee' has its limits swapped"),
    "no limit": (swapped(LIMIT, "", 0), "joint 'hip' is revolute, and has no <limit>"),
    "no effort": (swapped(' effort="5"', "", 1), "limit of joint 'knee': effort is missing"),
    "negative effort": (swapped('effort="5"', 'effort="-5"', 1), "joint 'knee' has effort -5"),
    "negative speed": (swapped('velocity="2"', 'velocity="-2"', 1), "joint 'knee' has velocity -2"),
    # names
    "robot without a name": (swapped(' name="good"', ""), "<robot> has no name"),
    "link without a name": (swapped(' name="eye"', ""), "link number 4 has no name"),
    "link of spaces": (swapped('name="eye"', 'name="  "'), "link number 4 has no name"),
    "joint without a name": (swapped(' name="hip"', ""), "joint number 1 has no name"),
    "two links of a name": (more('<link name="shin"/>'), "two links are called 'shin'"),
    "two joints of a name": (more(SPARE + hinge("hip", "base", "spare")), "two joints are called 'hip'"),
    "the base's own joint": (swapped('name="hip"', 'name="root_joint"'), "joint 'root_joint'"),
    "the world's own joint": (swapped('name="hip" ', 'name="universe" '), "joint 'universe'"),
    "a name of a kilometre": (swapped('name="eye"', f'name="{"e" * 1000}"'), "'eeee.* has a name of 1000 letters"),
    "a name of a megabyte": (swapped('link="eye"', f'link="{"e" * 1_000_000}"'), "joint 'weld' names a child link 'eeee"),
    # kinds
    "no type": (swapped(' type="revolute"', ""), "joint 'hip' is of type ''"),
    "unknown type": (swapped('type="revolute"', 'type="Revolute"'), "'hip' is of type 'Revolute'; expected one of revolute,"),
    "screw": (swapped('type="continuous"', 'type="screw"'), "joint 'ankle' is of type 'screw'"),
    # the tree
    "unknown parent": (swapped('parent link="thigh"', 'parent link="thig"'), "'knee' names a parent link 'thig'; .*'thigh'"),
    "unknown child": (swapped('child link="foot"', 'child link="toe"'), "joint 'ankle' names a child link 'toe'"),
    "no parent": (swapped('<parent link="thigh"/>', ""), "joint 'knee' has no parent link"),
    "no child": (swapped('<child link="shin"/>', ""), "joint 'knee' has no child link"),
    "two parents": (more(hinge("second", "base", "foot")), "link 'foot' has two parents, 'shin' and 'base'"),
    "twice the same parent": (more(hinge("second", "shin", "foot")), "link 'foot' has two parents"),
    "two roots": (more(SPARE), "one root link, found 2: 'base', 'spare'"),
    "ring": (more(hinge("back", "foot", "base")), "one root link, found 0"),
    "its own parent": (more(SPARE + hinge("loop", "spare", "spare")), "link 'spare' does not hang from the root 'base'"),
    "detached ring": (
        more(SPARE + '<link name="other"/>' + hinge("there", "spare", "other") + hinge("back", "other", "spare")),
        "link 'spare' does not hang from the root 'base'",
    ),
    "no link at all": ("<robot name='r'/>", "found 0"),
    # mimic
    "mimic of nothing": (swapped('mimic joint="hip"', 'mimic joint="hop"'), "joint 'ankle' mimics 'hop'.*'hip'"),
    "mimic of no name": (swapped('mimic joint="hip" ', "mimic "), "joint 'ankle' mimics nothing"),
    "mimic of itself": (swapped('mimic joint="hip"', 'mimic joint="ankle"'), "joint 'ankle' mimics itself"),
    "mimics in a circle": (
        swapped("<dynamics damping", '<mimic joint="ankle"/><dynamics damping'),
        "joint 'hip' mimics 'ankle', and that in a circle",
    ),
    # bytes
    "document type": (GOOD.replace("<robot", "<!DOCTYPE robot><robot", 1), "DOCTYPE"),
    "laughs": (GOOD.replace("<robot", '<!DOCTYPE r [<!ENTITY a "ha">]><robot', 1), "DOCTYPE"),
    "entity": (GOOD.replace("<link", '<!ENTITY a "ha"><link', 1), "ENTITY"),
    "other encoding": (GOOD.replace('"1.0"', '"1.0" encoding="cp037"', 1), "encoding is 'cp037'"),
    "unknown entity": (swapped("eye", "&ha;"), "cannot be read as XML"),
    "cut off": (GOOD[:900], "cannot be read as XML"),
    "two roots of XML": (GOOD + "<robot/>", "cannot be read as XML"),
    "another format": ("<sdf version='1.7'/>", "is no robot: its first element is <sdf>"),
    "deep": (GOOD.replace("</robot>", "<a>" * 5000 + "</a>" * 5000 + "</robot>"), "deep inside each other"),
}


def written(folder: Path, text: str | bytes, name: str = "mine.urdf") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_the_good_file_is_good(tmp_path: Path) -> None:
    """What all others are mutations of: it loads on both roots, all its numbers in it."""
    path = written(tmp_path, GOOD)
    for root, nv, mass in (("free_flyer", 9, 4.0), ("fixed", 3, 3.0)):
        robot = rbd.load_robot(path, root=root)  # type: ignore[arg-type]
        assert (robot.nv, robot.mass) == (nv, mass)
        assert np.linalg.eigvalsh(robot.at().M)[0] > 0.0


@pytest.mark.parametrize(("text", "says"), BROKEN.values(), ids=BROKEN)
def test_a_broken_file_is_refused_by_name(tmp_path: Path, text: str, says: str) -> None:
    """The message has the file and the link or joint, fits on a screen, and comes at once."""
    path = written(tmp_path, text)

    def load() -> None:
        with pytest.raises(ModelError, match=says) as caught:
            rbd.load_robot(path)
        assert str(caught.value).startswith("mine.urdf")
        assert len(str(caught.value)) < 1500

    load()  # the first in a process imports what it needs
    assert calls(load) < 20_000


def test_others_that_are_wrong_are_counted(tmp_path: Path) -> None:
    """The first by name, the rest by number."""
    with pytest.raises(ModelError, match=r"link 'base' has a mass of -1 kg.*\(3 more of this file\.\)"):
        rbd.load_robot(written(tmp_path, GOOD.replace('<mass value="1"/>', '<mass value="-1"/>')))


def test_a_fixed_base_has_no_joint_of_its_own(tmp_path: Path) -> None:
    """Without a free-flyer a joint may be called root_joint."""
    path = written(tmp_path, swapped('name="hip"', 'name="root_joint"').replace('joint="hip"', 'joint="root_joint"'))
    assert rbd.load_robot(path, root="fixed").actuated_names[0] == "root_joint"


CROWDED = GOOD.replace('"eye"', '"eye" ' + " ".join(f"a{k}='1'" for k in range(9_999)), 1)


@pytest.mark.parametrize(
    ("limits", "makes", "says"),
    [
        (FileLimits(), lambda: b" " * 64_000_001, "is larger than 64 MB.*max_bytes"),
        (FileLimits(), lambda: more("<link name='l'/>" * 2001).encode(), "has 2006 links; at most 2000.*max_links"),
        (FileLimits(), lambda: CROWDED.encode(), "10000 attributes or more on <link>.*max_attributes"),
        (FileLimits(), lambda: more("<a/>" * 1_000_000).encode(), "more than 1000000 elements"),
        (FileLimits(max_bytes=500), lambda: GOOD.encode(), "is larger than 0.0005 MB"),
        (FileLimits(max_dof=8), lambda: GOOD.encode(), "has 9 degrees of freedom; at most 8 are taken.*max_dof=9"),
        (FileLimits(max_links=4), lambda: GOOD.encode(), "has 5 links; at most 4"),
    ],
)
def test_what_is_too_large_is_refused_before_it_is_parsed(
    tmp_path: Path, limits: FileLimits, makes: Callable[[], bytes], says: str
) -> None:
    """By its bytes, at once, with the limit to raise."""
    with pytest.raises(ModelError):  # the first in a process imports what it needs
        rbd.load_robot(written(tmp_path, "", "empty.urdf"))
    path = written(tmp_path, makes())

    def load() -> None:
        with pytest.raises(ModelError, match=says):
            rbd.load_robot(path, limits=limits)

    assert calls(load) < 20_000


def chain(n: int, kind: str) -> str:
    links = "".join(f'<link name="l{k}">{BODY}</link>' for k in range(n + 1))
    return f'<robot name="chain">{links}{"".join(hinge(f"j{k}", f"l{k}", f"l{k + 1}", kind) for k in range(n))}</robot>'


def test_limits_can_be_raised(tmp_path: Path) -> None:
    """250 hinges want FileLimits(max_dof=256), and fall as one body."""
    path = written(tmp_path, chain(250, "continuous"))
    with pytest.raises(ModelError, match="has 256 degrees of freedom; at most 200"):
        rbd.load_robot(path)
    assert rbd.load_robot(path, limits=FileLimits(max_dof=256)).nv == 256
    for wrong in (0, -1, 2.5, "9", None, True, 2**41, 10**10_000):
        with pytest.raises(InputError, match="FileLimits.max_dof is"):
            FileLimits(max_dof=wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="limits is 300; expected rbd.model.FileLimits"):
        rbd.load_robot(path, limits=300)  # type: ignore[arg-type]


@pytest.mark.parametrize("limits", [FileLimits(), FileLimits(max_links=10**6, max_dof=10**6)], ids=["usual", "wide"])
@pytest.mark.parametrize("kind", ["fixed", "revolute"])
def test_a_chain_that_ends_pinocchio_is_refused(tmp_path: Path, kind: str, limits: FileLimits) -> None:
    """4,000 links below each other: an error and no crash, whatever the limits; in a process of its own."""
    path = written(tmp_path, chain(4000, kind))

    def load() -> str:
        with pytest.raises(ModelError) as refused:
            rbd.load_robot(path, limits=limits)
        return str(refused.value)

    assert "links" in alone(load)


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    """A pipe, a device, a folder, a file that is gone: refused; nobody writes into the pipe."""
    os.mkfifo(tmp_path / "pipe.urdf")
    for path in (tmp_path / "pipe.urdf", Path("/dev/zero"), tmp_path, tmp_path / "gone.urdf", tmp_path / ("x" * 300)):
        with pytest.raises(ModelError, match="is no regular file|cannot be read"):
            read_xml(path, FileLimits())


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-32", "latin-1", "cp037"])
def test_other_encodings_are_refused(tmp_path: Path, encoding: str) -> None:
    """Names would come out different in each reader; a mark of UTF-8 at the beginning is none of the name's business."""
    text = GOOD.replace("eye", "œil" if encoding != "latin-1" and encoding != "cp037" else "él")
    with pytest.raises(ModelError, match="cannot be read as XML"):
        read(written(tmp_path, text.encode(encoding)))
    robot = rbd.load_robot(written(tmp_path, b"\xef\xbb\xbf" + GOOD.replace("eye", "œil").encode()))
    assert robot.frame("œil").name == "œil"


def test_a_default_namespace_is_passed_over(tmp_path: Path) -> None:
    """As Drake's files have one."""
    text = GOOD.replace("<robot ", '<robot xmlns="http://drake.mit.edu" xmlns:x="u" ').replace("<link", "<x:y/><link")
    assert rbd.load_robot(written(tmp_path, text)).nv == 9


SOUND = [file for file in catalogue._files() if file not in catalogue.BROKEN and "psyonic" not in file]


@pytest.mark.parametrize("file", SOUND)
@pytest.mark.parametrize("floating", [True, False])
def test_the_text_that_pinocchio_reads_is_the_file(file: str, floating: bool) -> None:
    """For every robot of the data: the model of what was checked is the model of the whole file, bit for bit."""
    path = catalogue.robots_folder() / file
    checked = check_urdf(path, read_xml(path, FileLimits()), floating=floating)
    root = [pin.JointModelFreeFlyer()] if floating else []
    whole, ours = pin.buildModelFromUrdf(str(path), *root), pin.buildModelFromXML(checked.text, *root)
    assert whole == ours
    assert [frame.name for frame in whole.frames] == [frame.name for frame in ours.frames]
    assert whole.nv == checked.freedoms + 6 * floating
    assert abs(read(path, base=6 * floating).content.mass - pin.computeTotalMass(whole)) < 1e-9


ATTACKS: dict[str, Callable[[ElementTree.Element], str]] = {}


def attack(change: Callable[[ElementTree.Element], str]) -> Callable[[ElementTree.Element], str]:
    ATTACKS[change.__name__] = change
    return change


@attack
def mass_of_a_link_gone(robot: ElementTree.Element) -> str:
    link = robot.findall("link/inertial/..")[-1]
    next(iter(link.iterfind("inertial/mass"))).set("value", "nan")
    return f"link {link.get('name')!r}"


@attack
def axis_of_the_last_joint_zero(robot: ElementTree.Element) -> str:
    joint = [j for j in robot.findall("joint") if j.get("type") != "fixed" and j.find("axis") is not None][-1]
    joint.find("axis").set("xyz", "0 0 0")  # type: ignore[union-attr]
    return f"joint {joint.get('name')!r}"


@attack
def limits_swapped(robot: ElementTree.Element) -> str:
    joint = [j for j in robot.findall("joint") if j.get("type") == "revolute"][-1]
    limit = joint.find("limit")
    assert limit is not None
    limit.set("lower", "2"), limit.set("upper", "1")  # type: ignore[func-returns-value]
    return f"joint {joint.get('name')!r} has its limits swapped"


@attack
def a_second_parent(robot: ElementTree.Element) -> str:
    child = robot.findall("joint/child")[-1].get("link")
    robot.append(ElementTree.fromstring(hinge("second", robot.findall("link")[0].get("name", ""), str(child))))
    return f"link {child!r} has two parents"


@pytest.mark.parametrize("name", ["talos", "g1", "human", "solo12", "panda", "ur5"])
@pytest.mark.parametrize("change", ATTACKS.values(), ids=ATTACKS)
def test_real_robots_broken_are_refused_by_name(
    tmp_path: Path, name: str, change: Callable[[ElementTree.Element], str]
) -> None:
    """The same mistakes in files of a thousand lines."""
    robot = ElementTree.parse(catalogue.find(name).urdf).getroot()
    says = change(robot)
    with pytest.raises(ModelError) as caught:
        rbd.load_robot(written(tmp_path, ElementTree.tostring(robot)))
    assert says in str(caught.value)


def test_no_digit_of_a_good_file_crashes(tmp_path: Path, rng: np.random.Generator) -> None:
    """200 files with one digit changed: a refusal of ours, or a robot with a positive definite M and the file's mass."""
    loaded = 0
    digits = [i for i, letter in enumerate(GOOD) if letter.isdigit()]
    for _ in range(200):
        place = int(rng.choice(digits))
        text = GOOD[:place] + str(rng.choice(list("0123456789-.eN"))) + GOOD[place + 1 :]
        try:
            robot = rbd.load_robot(written(tmp_path, text))
        except RbdError:
            continue
        loaded += 1
        masses = ElementTree.fromstring(text).iterfind("link/inertial/mass")
        assert abs(robot.mass - sum(float(mass.get("value", "0")) for mass in masses)) < 1e-12
        assert np.linalg.eigvalsh(robot.at().M)[0] > 0.0
    assert 50 < loaded < 200
