"""Loops from files: the YAML beside a robot's file, and the equalities of an MJCF."""

from __future__ import annotations

import copy
import os
import pickle
import re
import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from work import calls

import rbd
from rbd.answers.least_constraint import momentum_balance
from rbd.errors import InputError, JointNotFound, ModelError, ModelWarning
from rbd.robots.loop_file import LARGEST_FILE, LoopFile, NamedFrame, read_loop_file

TOP = Path(__file__).parents[1]
FOUR_BAR = TOP / "urdf" / "four_bar.urdf"
LINKS = "crank_joint", "coupler_joint", "rocker_joint"


@pytest.fixture
def bar(tmp_path: Path) -> Path:
    """The four-bar's URDF without its loop file."""
    return Path(shutil.copy(FOUR_BAR, tmp_path / "bar.urdf"))


def load(bar: Path, text: str, **more: Any) -> rbd.Robot:
    """The four-bar with this text as its loop file."""
    bar.with_suffix(".loops.yaml").write_text(text, encoding="utf-8")
    return rbd.load_robot(bar, **more)


def read(folder: Path, text: str) -> LoopFile:
    path = folder / "x.loops.yaml"
    path.write_text(text, encoding="utf-8")
    return read_loop_file(path)


# ------------------------------------------------------------------------------------------------------ what it says

EVERYTHING = """
root: free_flyer
passive: [coupler_joint]
frames:
  middle: {link: coupler, xyz: [0.06, 1e-3, -0.002], rpy: [0.1, -0.2, 0.3]}
  beside: {link: crank}
loops:
  - {name: pin, kind: planar, frame_a: coupler_tip, frame_b: rocker_tip, axis: [0, 2, 0]}
  - {name: ball, kind: point, frame_a: middle, frame_b: ground}
couplings:
  - {name: gear, joint: rocker_joint, to: crank_joint, ratio: -2, offset: 010}
wheels:
  - {name: hoop, kind: rolling_disk, frame: crank, radius: 0.3, axis: [0, 0, 1]}
  - {name: roller, kind: rolling_wheel, frame: crank, radius: 1}
  - {name: marble, kind: rolling_ball, frame: middle, radius: .02}
  - {name: skate, kind: knife_edge, frame: ground, direction: [0, 1, 0]}
postures:
  bent: {crank_joint: 0.7, coupler_joint: [0, 1], root_joint: [0, 0, 2, 0, 0, 0, 1]}
"""


def test_every_part_of_the_file_is_on_the_robot(bar: Path) -> None:
    """Root, passive joints, frames, closures, gears, wheels and postures, under their names and with their numbers."""
    robot = load(bar, EVERYTHING, passive=["rocker_joint"])
    assert robot.root == "free_flyer" and robot.floating
    assert robot.passive == {"coupler_joint", "rocker_joint"} and robot.actuated_names == ("crank_joint",)
    pin_, ball, gear = robot.loops()
    assert isinstance(pin_, rbd.LoopClosure) and isinstance(ball, rbd.LoopClosure) and isinstance(gear, rbd.JointCoupling)
    assert (pin_.name, pin_.kind, pin_.frame_a, pin_.frame_b) == ("pin", "planar", "coupler_tip", "rocker_tip")
    assert np.array_equal(pin_.axis, [0.0, 1.0, 0.0]) and (ball.kind, ball.frame_a) == ("point", "middle")
    assert (gear.joint, gear.to, gear.ratio, gear.offset) == ("rocker_joint", "crank_joint", -2.0, 10.0)
    hoop, roller, marble, skate = robot.wheels()
    assert isinstance(hoop, rbd.RollingDisk) and isinstance(roller, rbd.RollingWheel)
    assert isinstance(marble, rbd.RollingBall) and isinstance(skate, rbd.KnifeEdge)
    assert (hoop.radius, roller.radius, marble.radius) == (0.3, 1.0, 0.02)
    assert np.array_equal(hoop.axis, [0.0, 0.0, 1.0]) and np.array_equal(roller.axis, [0.0, 1.0, 0.0])
    assert np.array_equal(skate.direction, [0.0, 1.0, 0.0])
    place = {name: robot.model.joints[robot.joint_id(name)].idx_q for name in LINKS}
    q = robot.posture("bent")
    assert np.allclose(q[place["crank_joint"] :][:2], [np.cos(0.7), np.sin(0.7)], rtol=0, atol=1e-16)
    assert q[place["coupler_joint"] :][:2].tolist() == [0.0, 1.0] and q[place["rocker_joint"] :][:2].tolist() == [1.0, 0.0]
    assert q[:7].tolist() == [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0]


def test_the_frames_of_the_file_are_where_it_says(bar: Path, rng: np.random.Generator) -> None:
    """X_W,new = X_W,link X_link,new with Rz(yaw) Ry(pitch) Rx(roll), at any configuration; no mass comes with them."""
    robot, plain = load(bar, EVERYTHING), rbd.load_robot(FOUR_BAR, root="free_flyer")
    assert robot.mass == plain.mass
    state = robot.at(pin.integrate(robot.model, robot.neutral(), rng.normal(size=robot.nv)))
    (roll, pitch, yaw), p = (0.1, -0.2, 0.3), np.array([0.06, 1e-3, -0.002])
    R = pin.exp3(np.array([0, 0, yaw])) @ pin.exp3(np.array([0, pitch, 0])) @ pin.exp3(np.array([roll, 0, 0]))
    expected = state.frame("coupler").X_WF * pin.SE3(R, p)
    assert np.abs(state.frame("middle").X_WF.homogeneous - expected.homogeneous).max() < 1e-15
    assert np.array_equal(state.frame("beside").X_WF.homogeneous, state.frame("crank").X_WF.homogeneous)


def test_a_frame_can_stand_on_a_frame_before_it(bar: Path) -> None:
    """In the order of the file."""
    robot = load(bar, "root: fixed\nframes: {a: {link: crank, xyz: [1, 0, 0]}, b: {link: a, xyz: [0, 2, 0]}}")
    assert robot.at().frame("b").X_WF.translation.tolist() == [1.0, 2.0, 0.0]


def test_words_are_those_of_yaml_1_2(tmp_path: Path) -> None:
    """`no` and `on` are names, 1e-3 is a number, and nothing is a date, an octal or sixty-based number."""
    found = read(tmp_path, "passive: [no, on, yes, 12:30:45, 2020-01-01]\nframes: {off: {link: y, xyz: [1e-3, 010, +.5E1]}}")
    assert found.passive == ("no", "on", "yes", "12:30:45", "2020-01-01")
    assert found.frames == (NamedFrame("off", "y", (1e-3, 10.0, 5.0)),)


# ------------------------------------------------------------------------------------------------- where it is found


def test_the_file_beside_is_found_by_its_name(bar: Path, tmp_path: Path) -> None:
    """`<stem>.loops.yaml` in the same folder; another one if given; none if told so; the argument's root goes first."""
    assert rbd.load_robot(bar).loops() == () and rbd.load_robot(bar).root == "free_flyer"
    text = (TOP / "urdf" / "four_bar.loops.yaml").read_text()
    robot = load(bar, text)
    assert robot.root == "fixed" and [loop.name for loop in robot.loops()] == ["coupler_pin"]
    assert load(bar, text, root="free_flyer").floating
    for none in (None, False):
        alone = rbd.load_robot(bar, loops=none)
        assert alone.loops() == () and alone.root == "free_flyer" and not alone.passive and not alone.postures
    other = tmp_path / "other.yaml"
    other.write_text("root: fixed\nloops: [{name: else, kind: point, frame_a: coupler_tip, frame_b: rocker_tip}]")
    for path in (other, str(other)):
        assert [loop.name for loop in rbd.load_robot(bar, loops=path).loops()] == ["else"]


@pytest.mark.parametrize("bad", [3, 0.5, [], ["x.yaml"], b"x.yaml", object(), {"a": 1}])
def test_what_is_no_path_is_refused(bar: Path, bad: Any) -> None:
    """`loops` is a path, True, or None."""
    with pytest.raises(InputError, match="loops"):
        rbd.load_robot(bar, loops=bad)


def test_a_file_that_cannot_be_read_is_named(bar: Path, tmp_path: Path) -> None:
    """Missing, a folder, a pipe, too large, not UTF-8."""
    with pytest.raises(ModelError, match="none.yaml cannot be read: No such file"):
        rbd.load_robot(bar, loops=tmp_path / "none.yaml")
    os.mkfifo(tmp_path / "pipe.yaml")
    for path in (tmp_path, tmp_path / "pipe.yaml"):
        with pytest.raises(ModelError, match="is no regular file"):
            rbd.load_robot(bar, loops=path)
    large = tmp_path / "large.yaml"
    large.write_text("#" * (LARGEST_FILE + 1))
    with pytest.raises(ModelError, match="larger than 200 kB"):
        rbd.load_robot(bar, loops=large)
    large.write_bytes(b"root: \xff")
    with pytest.raises(ModelError, match="byte 6 is not UTF-8"):
        rbd.load_robot(bar, loops=large)


# ------------------------------------------------------------------------------------------------------ what is wrong

LOOP = "loops: [{name: pin, kind: planar, frame_a: coupler_tip, frame_b: rocker_tip"
WRONG_FORM = [
    ("", "the file is None; expected `key: value` pairs"),
    ("- 1", r"the file is \[1\]"),
    ("just words", "the file is 'just words'"),
    ("loop: []", "has a key 'loop'; nearest: 'loops'"),
    ("1: 2", "a key of the file is 1; expected a name"),
    ("root: welded", "root is 'welded'; .* Expected one of"),
    ("root: [fixed]", r"root is \['fixed'\]"),
    ("passive: crank_joint", "passive is 'crank_joint'; expected a list of names"),
    ("passive: [1]", r"passive\[0\] is 1; expected a name"),
    ("passive: ['" + "x" * 200 + "']", "200 letters; expected 120 at most"),
    ("frames: []", r"frames is \[\]; expected `key: value` pairs"),
    ("frames: {a: {}}", "frame 'a' has no 'link'"),
    ("frames: {a: {link: crank, xyx: [0, 0, 0]}}", "frame 'a' has a key 'xyx'; nearest: 'xyz'"),
    ("frames: {a: {link: crank, xyz: [0, 0]}}", r"xyz of frame 'a' is \[0, 0\]; expected 3 finite numbers"),
    ("frames: {a: {link: crank, xyz: [0, 0, 1e5]}}", r"xyz of frame 'a' is \[0, 0, 100000.0\]; expected 3 .*at most 10000"),
    ("frames: {a: {link: crank, rpy: [0, .nan, 0]}}", r"'.nan', 0\]; expected 3 finite numbers"),
    ("loops: {}", "loops is {}; expected a list"),
    ("loops: [pin]", r"loops\[0\] is 'pin'; expected `key: value` pairs"),
    ("loops: [{name: pin, kind: planar, frame_a: x}]", r"loops\[0\] \('pin'\) has no 'frame_b'"),
    (LOOP + ", axes: [0, 0, 1]}]", r"loops\[0\] \('pin'\) has a key 'axes'; nearest: 'axis'"),
    (LOOP.replace("planar", "plane") + "}]", "kind of .*'pin'.* is 'plane'; nearest: 'planar'"),
    (LOOP + ", axis: [0, true, 1]}]", r"axis of .* is \[0, True, 1\]; expected 3 finite numbers"),
    (LOOP + ", axis: 1}]", "axis of .* is 1; expected 3 finite numbers"),
    (LOOP.replace("pin", "''") + "}]", "name of .* is ''; expected a name"),
    (LOOP + "}]\ncouplings: [{name: pin, joint: a, to: b, ratio: 1}]", "two constraints are named 'pin'"),
    ("couplings: [{name: g, joint: a, to: b, ratio: two}]", "ratio of .*'g'.* is 'two'; expected a finite number"),
    ("couplings: [{name: g, joint: a, to: b, ratio: " + "9" * 400 + "}]", "ratio of .* is a number of many digits"),
    ("wheels: [{name: w, kind: wheel, frame: crank}]", "kind of .*'w'.* is 'wheel'; nearest: 'rolling_wheel'"),
    ("wheels: [{name: w, kind: knife_edge}]", r"wheels\[0\] \('w'\) has no 'frame'"),
    ("postures: [1]", r"postures is \[1\]"),
    ("postures: {p: 1}", "posture 'p' is 1; expected `key: value` pairs"),
    ("postures: {p: {crank_joint: much}}", "'crank_joint' of posture 'p' is 'much'"),
    ("postures: {p: {crank_joint: [0, 1e999]}}", "'crank_joint' of posture 'p' is .0, inf.; expected 1 to 7 finite numbers"),
    ("postures: {p: {crank_joint: 2020-01-01}}", "is '2020-01-01'; expected a finite number"),
    ("root: fixed\nroot: fixed", "key 'root' comes twice, again in line 2"),
    ("postures: {p: {crank_joint: 1, 'crank_joint': 2}}", "key 'crank_joint' comes twice"),
    ("passive: &a [x]\nframes: *a", "it has an alias in line 2"),
    ("passive: !!set {a, b}", "it has a tag, 'tag:yaml.org,2002:set'"),
    ("root: !!python/object/apply:os.getcwd []", "it has a tag, 'tag:yaml.org,2002:python/object/apply:os.getcwd'"),
    ("passive: [!x a]", "it has a tag, '!x'"),
    ("<<: {root: fixed}", "has a key '<<'"),
    ("root: fixed\n--- {}", "expected a single document"),
    ("root: [fixed", "cannot be read as YAML: while parsing"),
    ("root: fixed\n\tpassive: []", "cannot be read as YAML"),
    ("? [1]\n: 2", "found unhashable key"),
    ("passive: " + "[" * 50 + "]" * 50, "more than 8 lists or pairs inside each other"),
    ("passive: " + "[" * 100_000, "more than 8 lists or pairs inside each other"),
    ("%YAML 3.0\n--- {}", "incompatible YAML document"),
    ("root: \0", "cannot be read as YAML: unacceptable character"),
    ("offset: " + "9" * 5000, "cannot be read as YAML: Exceeds the limit"),
]


@pytest.mark.parametrize(("text", "says"), WRONG_FORM, ids=range(len(WRONG_FORM)))
def test_a_wrong_form_is_refused_by_name(tmp_path: Path, text: str, says: str) -> None:
    """Before any robot is looked at; the message names the file, the entry, and the nearest word."""
    with pytest.raises(ModelError, match=says) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith("x.loops.yaml") and len(str(caught.value)) < 800


def test_an_alias_bomb_is_refused_at_once(tmp_path: Path) -> None:
    """Nine levels of nine aliases would be 400 million words; the first alias ends it."""
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{k}: &{k} [{', '.join([f'*{p}'] * 9)}]" for p, k in zip("abcdefgh", "bcdefghi", strict=True)]

    def refused() -> None:
        with pytest.raises(ModelError, match="it has an alias in line 2"):
            read(tmp_path, "\n".join(lines))

    assert calls(refused) < 20_000


WRONG_NAMES = [
    ("passive: [crank_join]", "passive names a joint 'crank_join'; nearest: 'crank_joint'"),
    ("frames: {a: {link: cronk}}", "frame 'a' is on a link 'cronk'; nearest: 'crank'"),
    ("frames: {crank_joint: {link: crank}}", "has a frame 'crank_joint' already"),
    ("frames: {coupler_tip: {link: crank}}", "has a frame 'coupler_tip' already"),
    (LOOP.replace("coupler_tip", "coupler_tp") + "}]", "loop 'pin': no frame 'coupler_tp' in bar; nearest: 'coupler_tip'"),
    (LOOP.replace("rocker_tip", "rocker_top") + "}]", "loop 'pin': no frame 'rocker_top' in bar; nearest: 'rocker_tip'"),
    (LOOP.replace("coupler_tip", "rocker") + "}]", "loop 'pin': .*'rocker' with 'rocker_tip', which are fixed to one body"),
    (LOOP.replace("coupler_tip", "rocker_tip") + "}]", "loop 'pin': .*one body"),
    (LOOP + ", axis: [0, 0, 0]}]", "axis of .*'pin'.* of length 0; expected a direction"),
    ("couplings: [{name: g, joint: a, to: crank_joint, ratio: 1}]", "loop 'g': no joint 'a' in bar"),
    ("couplings: [{name: g, joint: crank_joint, to: rocker, ratio: 1}]", "loop 'g': no joint 'rocker' .*: 'rocker_joint'"),
    ("couplings: [{name: g, joint: crank_joint, to: root_joint, ratio: 1}]", "joint 'root_joint' has 6 degrees of freedom"),
    ("couplings: [{name: g, joint: crank_joint, to: crank_joint, ratio: 1}]", "couples joint 'crank_joint' to itself"),
    ("wheels: [{name: w, kind: rolling_ball, frame: ball, radius: 1}]", "wheel 'w': no frame 'ball'"),
    ("wheels: [{name: w, kind: rolling_ball, frame: crank}]", r"wheels\[0\] \('w'\) has no 'radius'"),
    ("wheels: [{name: w, kind: rolling_ball, frame: crank, radius: 0}]", "wheel 'w': radius .* is 0.0; expected a length > 0"),
    (
        "wheels: [{name: w, kind: rolling_ball, frame: crank, radius: 1, axis: [0, 1, 0]}]",
        "'w'.* has a key 'axis'.* some of name, kind, frame, radius, on\\.",
    ),
    (
        "wheels: [{name: w, kind: rolling_disk, frame: crank, radius: 1, direction: [0, 1, 0]}]",
        "'w'.* has a key 'direction'.* some of name, kind, frame, radius, axis, on\\.",
    ),
    ("wheels: [{name: w, kind: rolling_disk, frame: crank, radius: 1, axis: [0, 0, 0]}]", "axis of .*'w'.* of length 0"),
    (
        "wheels: [{name: w, kind: knife_edge, frame: crank, radius: 1}]",
        "'w'.* has a key 'radius'; .* some of name, kind, frame, direction\\.",
    ),
    ("postures: {p: {crank: 1}}", "posture 'p': no joint 'crank' in bar; nearest: 'crank_joint'"),
    ("postures: {p: {crank_joint: [1, 2, 3]}}", "posture 'p': .*has 3 numbers; expected an angle"),
    ("postures: {p: {crank_joint: [1, 1]}}", "posture 'p': .*unit circle .* of norm 1.41"),
    ("postures: {p: {root_joint: 1}}", "posture 'p': .*has 1 numbers; expected 7 numbers"),
]


@pytest.mark.parametrize(("text", "says"), WRONG_NAMES, ids=range(len(WRONG_NAMES)))
def test_what_is_not_on_the_robot_is_refused_by_name(bar: Path, text: str, says: str) -> None:
    """Frames, joints, links, with the nearest names; numbers that a constraint or a joint does not take."""
    with pytest.raises(ModelError, match=says) as caught:
        load(bar, text)
    assert str(caught.value).startswith("bar.loops.yaml")


# -------------------------------------------------------------------------------------------------- a base on the ground


def test_a_planar_root_has_three_freedoms_and_no_motor(tmp_path: Path) -> None:
    """In q come x, y, cos, sin first, v has three more; the base is passive, and no momentum balance is claimed for it."""
    fixed, planar = (rbd.load_robot(TOP / "urdf" / "walker.urdf", root=root) for root in ("fixed", "planar"))
    assert (planar.root, planar.nq, planar.nv, planar.nu) == ("planar", fixed.nq + 4, fixed.nv + 3, fixed.nu)
    assert planar.passive == {"root_joint"} and planar.actuated_names == fixed.actuated_names and not planar.floating
    assert planar.mass == rbd.load_robot(TOP / "urdf" / "walker.urdf").mass
    state = planar.at()
    assert momentum_balance(state, np.zeros(6)) is None
    found = rbd.solve(state, np.zeros(planar.nu), [rbd.JointLock("knee", "left_knee")])
    assert found.residuals.centroidal is None and found.status is rbd.problem.Status.SOLVED
    with pytest.raises(ModelError, match="'root_joint' has the name of the floating base's own joint"):
        (tmp_path / "x.urdf").write_text(FOUR_BAR.read_text().replace("crank_joint", "root_joint"))
        rbd.load_robot(tmp_path / "x.urdf", root="planar")


def test_a_planar_base_moves_as_a_floating_one_that_is_kept_on_the_ground(rng: np.random.Generator) -> None:
    """M and h are the rows (x, y, turn) of those of the free-flyer at the same pose and with the same velocity."""
    free, planar = (rbd.load_robot(TOP / "urdf" / "walker.urdf", root=root) for root in ("free_flyer", "planar"))
    joints, v_joints, u = rng.normal(size=10), rng.normal(size=10), rng.normal(size=3)
    x, y, th = rng.normal(size=3)
    one = planar.at(np.r_[x, y, np.cos(th), np.sin(th), joints], np.r_[u, v_joints])
    other = free.at(np.r_[x, y, 0, 0, 0, np.sin(th / 2), np.cos(th / 2), joints], np.r_[u[:2], 0, 0, 0, u[2], v_joints])
    kept = np.r_[0, 1, 5, 6:16]
    assert np.abs(one.M - other.M[np.ix_(kept, kept)]).max() < 1e-12
    assert np.abs(one.h - other.h[kept]).max() < 1e-11


def test_an_mjcf_has_no_planar_root(tmp_path: Path) -> None:
    """It says itself how it moves; the word tells what to write."""
    with pytest.raises(InputError, match="root='planar' is for URDF files"):
        rbd.load_robot(mjcf(tmp_path, ""), root="planar")
    for bad in ("floating", "", 3, True, ["planar"], np.array(["planar"])):
        with pytest.raises(InputError, match="expected 'free_flyer', 'planar' or 'fixed'"):
            rbd.load_robot(FOUR_BAR, root=bad)  # type: ignore[arg-type]


def test_too_many_freedoms_are_counted_with_the_root() -> None:
    """13 of the walker on the ground, 16 in space."""
    for root, nv in (("fixed", 10), ("planar", 13), ("free_flyer", 16)):
        with pytest.raises(ModelError, match=f"has {nv} degrees of freedom; at most 9"):
            rbd.load_robot(TOP / "urdf" / "walker.urdf", root=root, limits=rbd.model.FileLimits(max_dof=9))  # type: ignore[arg-type]


# --------------------------------------------------------------------------------------------------- copies, the doctor


@pytest.mark.parametrize("again", [lambda r: pickle.loads(pickle.dumps(r)), copy.deepcopy, copy.copy])
def test_copies_keep_their_loops(bar: Path, again: Any) -> None:
    """Frames, loops, wheels, postures, passive joints, limits; and they move as the first does."""
    robot = load(bar, EVERYTHING)
    twin = again(robot)
    assert twin is not robot and twin.passive == robot.passive and twin.root == robot.root and twin.frames() == robot.frames()
    assert [c.name for c in (*twin.loops(), *twin.wheels())] == [c.name for c in (*robot.loops(), *robot.wheels())]
    assert twin.postures.keys() == robot.postures.keys() and twin.limits == robot.limits and twin.sound == robot.sound
    states = robot.at("bent"), twin.at("bent")
    assert np.array_equal(*[s.M for s in states]) and np.array_equal(*[s.frame("middle").J for s in states])
    assert np.array_equal(*[r.loops()[0].rows(s).error for r, s in zip((robot, twin), states, strict=True)])
    assert [g.name for g in twin.visual_model.geometryObjects] == [g.name for g in robot.visual_model.geometryObjects]


def test_a_robot_without_loops_is_copied_too(talos: rbd.Robot) -> None:
    """Postures, feet and soundness go along."""
    twin = pickle.loads(pickle.dumps(talos))
    assert np.array_equal(twin.standing().q, talos.standing().q) and len(twin.soles()) == 2 and twin.loops() == ()


def test_the_doctor_tells_of_loops(bar: Path) -> None:
    """Where each is closed, as a note; one that is open in every posture is a warning, with how far."""
    report = rbd.doctor(rbd.load_robot(FOUR_BAR))
    assert report.ok and not report.warnings and [n.where for n in report.notes] == ["coupler_pin"]
    assert "closed in 'assembled', 'crossed'" in str(report)
    with pytest.warns(ModelWarning, match=r"1 loop is open in every posture \('pin'\)"):
        robot = load(bar, f"root: fixed\n{LOOP}, axis: [0, 1, 0]}}]")
    (finding,) = [f for f in rbd.doctor(robot).warnings if f.kind == "loop"]
    # At zero all bars lie along x: the coupler ends at 0.04 + 0.12, the rocker at 0.1 + 0.08.
    assert "open in every posture, by 0.02 in the neutral posture at least" in finding.text
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        wheels = rbd.doctor(load(bar, EVERYTHING)).notes
    assert ["hoop", "roller", "marble", "skate"] == [n.where for n in wheels if n.kind == "wheel"]


def test_unknown_passive_joints_of_the_argument_are_still_named() -> None:
    """The file's passive joints join those given, a word or a list; what is neither is refused as before."""
    assert rbd.load_robot(FOUR_BAR, passive="crank_joint").nu == 0  # type: ignore[arg-type]
    assert rbd.load_robot(FOUR_BAR, passive=iter(["crank_joint"])).nu == 0  # type: ignore[arg-type]
    with pytest.raises(JointNotFound, match="'crank_joint'"):
        rbd.load_robot(FOUR_BAR, passive=["crank"])
    with pytest.raises(InputError, match="passive is 3"):
        rbd.load_robot(FOUR_BAR, passive=3)  # type: ignore[arg-type]


# ---------------------------------------------------------------------------------------------------------------- MJCF

CHAIN = """<mujoco model="chain"><compiler angle="radian"/>{more}<worldbody>
<body name="crank" pos="0.1 0 0.2" quat="0.8 0 0.6 0">
  <joint name="j1" axis="0 -1 0" ref="0.3"/><geom type="capsule" size=".02" fromto="0 0 0 1 0 0" mass="1"/>
  <site name="tip" pos="1 0 0" quat="0.6 0.8 0 0"/><site name="coupler" pos="1 0.1 .3" quat="0 0.6 0 0.8"/>
  <body name="coupler" pos="1 0 0.1"><joint name="j2" axis="0 -1 0.2" ref="-.2" pos="0.1 .2 .3"/>
    <geom type="capsule" size=".02" fromto="0 0 0 1 0 0" mass="1"/>
    <body name="rocker" pos="1 0 0" quat="1 0.2 0 0.1"><joint name="j3" type="slide" axis="0 -1 0" ref="0.1"/>
      <geom type="capsule" size=".02" fromto="0 0 0 1 0 0" mass="1"/><site name="end" pos="0.5 0.1 0.2"/></body>
  </body>
</body></worldbody><equality>{equality}</equality></mujoco>"""


def mjcf(folder: Path, equality: str, more: str = "") -> Path:
    path = folder / "chain.xml"
    path.write_text(CHAIN.format(equality=equality, more=more))
    return path


CLOSURES = {
    "connect to the world": '<connect name="c" body1="rocker" anchor="0.3 0.2 0.1"/>',
    "connect, from the world": '<connect name="c" body1="world" body2="coupler" anchor="0.3 0.2 0.1"/>',
    "connect of bodies": '<connect name="c" body1="rocker" body2="crank" anchor="1 0.1 0.2"/>',
    "connect of sites": '<connect name="c" site1="coupler" site2="end"/>',
    "weld as drawn": '<weld name="c" body1="crank" body2="rocker"/>',
    "weld to the world": '<weld name="c" body1="rocker" anchor="0.1 0.2 0.3"/>',
    "weld at a pose": '<weld name="c" body1="crank" body2="rocker" relpose="1 2 3 1.2 1.6 0 0" anchor=".1 .2 .3"/>',
    "weld at a pose, to the world": '<weld name="c" body1="coupler" relpose="1 2 3 0 0.6 0 -0.8"/>',
    "weld without a turn": '<weld name="c" body1="crank" body2="rocker" relpose="1 2 3 0 0 0 0" anchor=".1 .2 .3"/>',
    "weld of sites": '<weld name="c" site1="tip" site2="end"/>',
}


@pytest.mark.parametrize("kind", CLOSURES)
def test_closures_are_those_of_mujoco(tmp_path: Path, kind: str, rng: np.random.Generator) -> None:
    """At random configurations the distance between the two points, and J^T J of the rows of it, are MuJoCo's own."""
    mujoco = pytest.importorskip("mujoco")
    path = mjcf(tmp_path, CLOSURES[kind])
    robot = rbd.load_robot(path)
    (loop,) = robot.loops()
    assert isinstance(loop, rbd.LoopClosure) and loop.name == "c"
    assert loop.kind == ("rigid" if kind.startswith("weld") else "point")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    for q in (robot.posture("qpos0"), *(robot.posture("qpos0") + rng.normal(size=(4, 3)))):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        theirs = data.efc_pos[:3], data.efc_J.reshape(-1, model.nv)[:3]
        rows = loop.rows(robot.at(q))
        assert abs(np.linalg.norm(rows.error[:3]) - np.linalg.norm(theirs[0])) < 1e-12
        if loop.kind == "point":  # a weld's rows there turn with another body's axes off the closure
            state = robot.at(q)
            difference = state.frame("c_b").J[:3] - state.frame("c_a").J[:3]
            assert np.abs(difference.T @ difference - theirs[1].T @ theirs[1]).max() < 1e-12
        else:
            gap = pin.log3(robot.at(q).frame("c_a").X_WF.rotation.T @ robot.at(q).frame("c_b").X_WF.rotation)
            sine = np.linalg.norm(data.efc_pos[3:6])  # MuJoCo's: the vector part of the quaternion
            assert abs(abs(np.sin(np.linalg.norm(gap) / 2)) - sine) < 1e-12


@pytest.mark.parametrize("kind", [k for k in CLOSURES if "site" not in k and "pose" not in k and "turn" not in k])
def test_what_the_file_does_not_say_is_as_it_draws_its_bodies(tmp_path: Path, kind: str) -> None:
    """The second anchor and the relative pose are those of the posture `qpos0`, which is the file's: closed there."""
    robot = rbd.load_robot(mjcf(tmp_path, CLOSURES[kind]))
    assert np.abs(robot.loops()[0].rows(robot.at("qpos0")).error).max() < 1e-14
    assert robot.posture("qpos0").tolist() == [0.3, -0.2, 0.1]
    assert "closed in 'qpos0'" in str(rbd.doctor(robot))


@pytest.mark.parametrize("coefficients", ["", 'polycoef="0.4"', 'polycoef="0.4 -2"', 'polycoef="0.1 3 0 0 0"'])
@pytest.mark.parametrize("to", ["", 'joint2="j3"'])
def test_joint_equalities_are_those_of_mujoco(tmp_path: Path, coefficients: str, to: str, rng: np.random.Generator) -> None:
    """They read y - y0 = c0 + c1 (x - x0) about the file's reference angles; of one joint alone y - y0 = c0."""
    mujoco = pytest.importorskip("mujoco")
    path = mjcf(tmp_path, f'<joint name="g" joint1="j1" {to} {coefficients}/>')
    robot = rbd.load_robot(path)
    (loop,) = robot.loops()
    assert isinstance(loop, rbd.JointCoupling if to else rbd.JointLock)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    for q in rng.normal(size=(4, 3)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        rows = loop.rows(robot.at(q))
        assert np.abs(rows.error - data.efc_pos).max() < 1e-14 and np.abs(rows.J - data.efc_J.reshape(-1, 3)).max() < 1e-15


def test_a_four_bar_by_connect_moves_as_the_urdf_with_a_planar_pin(tmp_path: Path) -> None:
    """Two files, two readers, three rows of rank two against two rows: the same accelerations, at speed too."""
    urdf = rbd.load_robot(FOUR_BAR)
    state = urdf.at("assembled")
    J = urdf.loops()[0].rows(state).J
    v = np.linalg.svd(J)[2][-1] * 30.0
    state = state.with_velocity(v)
    bar, inertia = [], []
    for name in ("crank", "coupler", "rocker"):
        Y = urdf.model.inertias[urdf.joint_id(f"{name}_joint")]
        c, I = Y.lever.tolist(), np.diag(Y.inertia).tolist()
        at, moments = (" ".join(map(repr, three)) for three in (c, I))
        inertia.append(f'<inertial pos="{at}" mass="{Y.mass!r}" diaginertia="{moments}"/>')
        bar.append(f'<joint name="{name}_joint" axis="0 -1 0"/>')
    path = tmp_path / "bar.xml"
    path.write_text(
        '<mujoco model="bar"><compiler angle="radian"/><worldbody><body name="ground">'
        f'<body name="crank">{bar[0]}{inertia[0]}<body name="coupler" pos="0.04 0 0">{bar[1]}{inertia[1]}'
        '<site name="a" pos="0.12 0 0"/></body></body>'
        f'<body name="rocker" pos="0.1 0 0">{bar[2]}{inertia[2]}<site name="b" pos="0.08 0 0"/></body></body></worldbody>'
        '<equality><connect site1="a" site2="b"/></equality></mujoco>'
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        robot = rbd.load_robot(path)
    q = [np.arctan2(*state.q[urdf.model.joints[urdf.joint_id(j)].idx_q :][1::-1]) for j in robot.joints]
    v_xml = [v[urdf.model.joints[urdf.joint_id(j)].idx_v] for j in robot.joints]
    assert robot.loops()[0].name == "connect_a_b" and np.abs(robot.loops()[0].rows(robot.at(np.array(q))).error).max() < 1e-15
    found = rbd.solve(robot.at(np.array(q), np.array(v_xml)), np.zeros(0), robot.loops()).a
    expected = rbd.solve(state, [0.0], urdf.loops()).a
    expected = [expected[urdf.model.joints[urdf.joint_id(j)].idx_v] for j in robot.joints]
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("equality", "more", "says"),
    [
        (
            '<tendon tendon1="t"/></equality><tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon><equality>',
            "",
            "is of a kind that is not read; only <connect>, <weld>, <joint> are",
        ),
        ('<weld name="w" body1="crank" active="false"/>', "", "is not active"),
        ('<weld name="w" body1="crank"/>', '<default><equality active="false"/></default>', "is not active"),
        (
            '<weld name="w" body1="crank" class="x"/>',
            '<default><default class="y"><equality active="false"/><default class="x"/></default></default>',
            "is not active",
        ),
        ('<joint name="w" joint1="j1" joint2="j2" polycoef="0 1 0.5"/>', "", "polynomial above the first degree"),
    ],
)
def test_what_is_not_read_is_told(tmp_path: Path, equality: str, more: str, says: str) -> None:
    """Other kinds, inactive ones (by themselves or by their class) and curved gears: a warning each, never silence."""
    with pytest.warns(ModelWarning, match="1 equality constraint is left out"):
        robot = rbd.load_robot(mjcf(tmp_path, equality, more))
    assert robot.loops() == ()
    (finding,) = [f for f in rbd.doctor(robot).warnings if f.kind == "equality"]
    assert re.search(says, finding.text)


def test_a_class_that_is_off_can_be_switched_on(tmp_path: Path) -> None:
    """The element's own word goes before its class's, an inner class's before the outer's."""
    off = '<default><equality active="false"/><default class="on"><equality active="true"/></default></default>'
    for text in ('<weld body1="crank" active="true"/>', '<weld body1="crank" class="on"/>'):
        assert len(rbd.load_robot(mjcf(tmp_path, text, off)).loops()) == 1


@pytest.mark.parametrize(
    ("equality", "says"),
    [
        ('<connect name="c" body1="rockr" anchor="0 0 0"/>', "unknown element 'rockr' .*'c', line 10"),
        ('<connect name="c" body1="rocker" body2="crnk" anchor="0 0 0"/>', "unknown element 'crnk'"),
        ('<connect name="c" anchor="0 0 0"/>', "MuJoCo refuses it: .*'connect', line 10"),
        ('<connect name="c" site1="tip"/>', "MuJoCo refuses it: .*'connect', line 10"),
        ('<connect name="c" body1="rocker" anchor="0 0 nan"/>', "anchor is '0 0 nan'"),
        ('<connect name="c" body1="rocker" body2="rocker" anchor="0 0 0"/>', "'rocker' is repeated"),
        ('<weld name="c" body1="rocker" relpose="0 0 0 1"/>', "MuJoCo refuses it: .*'weld', line 10"),
        ('<joint name="c" joint1="j9"/>', "unknown element 'j9'"),
        ('<joint name="c" joint1="j1" polycoef="x 1"/>', "bad format in attribute 'polycoef'"),
        ('<weld name="c" body1="rocker"/><weld name="c" body1="crank"/>', "repeated name 'c'"),
    ],
)
def test_a_broken_equality_is_refused_by_name(tmp_path: Path, equality: str, says: str) -> None:
    """Bodies, sites and joints that are not there, numbers that are none: in MuJoCo's words, with the line of the file."""
    with pytest.raises(ModelError, match=says):
        rbd.load_robot(mjcf(tmp_path, equality))


def test_equalities_without_names_get_some(tmp_path: Path) -> None:
    """Kind and ends, told apart by a stroke; `loops=None` leaves all open."""
    path = mjcf(tmp_path, '<weld body1="rocker"/><weld body1="rocker"/><connect site1="tip" site2="end"/>')
    robot = rbd.load_robot(path)
    assert [loop.name for loop in robot.loops()] == ["weld_rocker", "weld_rocker'", "connect_tip_end"]
    assert rbd.load_robot(path, loops=None).loops() == () and "weld_rocker_a" not in rbd.load_robot(path, loops=None).frames()


def test_joints_that_share_a_body_can_be_coupled(tmp_path: Path) -> None:
    """Each is a joint of its own; one with several freedoms cannot be coupled."""
    text = mjcf(tmp_path, '<joint name="g" joint1="j1" joint2="extra"/>').read_text()
    path = tmp_path / "chain.xml"
    path.write_text(text.replace('<joint name="j1"', '<joint name="extra" axis="0 0 1"/><joint name="j1"'))
    robot = rbd.load_robot(path)
    (gear,) = robot.loops()
    assert robot.nv == 4 and isinstance(gear, rbd.JointCoupling) and np.abs(gear.rows(robot.at("qpos0")).error).max() < 1e-14
    path.write_text(
        text.replace('<joint name="j1"', '<joint name="extra" type="ball"/><joint name="was_j1"')
        .replace('<joint name="was_j1" axis="0 -1 0" ref="0.3"/>', "")
        .replace('joint1="j1"', 'joint1="j2"')
    )
    with pytest.raises(ModelError, match="only HINGE and SLIDE joint allowed .*'g', line 10"):
        rbd.load_robot(path)


def test_a_yaml_beside_an_mjcf_is_read_too(tmp_path: Path) -> None:
    """Its loops follow those of the file; one name for both is refused."""
    path = mjcf(tmp_path, '<weld name="w" body1="rocker"/>')
    beside = path.with_suffix(".loops.yaml")
    beside.write_text("passive: [j2]\nloops: [{name: v, kind: point, frame_a: tip, frame_b: rocker}]")
    robot = rbd.load_robot(path)
    assert [loop.name for loop in robot.loops()] == ["v", "w"] and "j2" in robot.passive
    beside.write_text("loops: [{name: w, kind: point, frame_a: tip, frame_b: rocker}]")
    with pytest.raises(ModelError, match="'w' is the name of an equality of chain.xml too"):
        rbd.load_robot(path)
    beside.write_text("frames: {w_a: {link: rocker}}")
    with pytest.raises(ModelError, match="wants a frame 'w_a', which is there"):
        rbd.load_robot(path)
