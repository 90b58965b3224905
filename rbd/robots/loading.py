"""load_robot: a robot from its file, or by its name; doctor: what is wrong with it."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from rbd.arrays import Array, check_flag
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.files import build_model, check_freedoms, read
from rbd.model.input_files import FileLimits, parse_xml
from rbd.model.mjcf import Mjcf, check_leave_out
from rbd.model.world import STANDARD, Plane, checked_gravity, checked_plane, is_standard
from rbd.robots import catalogue, travelling
from rbd.robots.compared import differences
from rbd.robots.diagnosis import ModelIssue, ModelReport, examine, refuse, with_rotors
from rbd.robots.feet import registered
from rbd.robots.loop_file import ROOTS, LoopFile, Root
from rbd.robots.loops import loop_file_of, mechanism
from rbd.robots.robot import Robot, joined


def load_robot(
    name_or_path: str | os.PathLike[str] | None = None,
    *,
    text: str | bytes | None = None,
    root: Root | None = None,
    passive: Sequence[str] = (),
    package_dirs: Iterable[str | os.PathLike[str]] = (),
    limits: FileLimits | None = None,
    loops: str | os.PathLike[str] | LoopFile | bool | None = True,
    leave_out: Collection[str] = (),
    feet: Sequence[str | SurfaceContact | PointContact] | None = None,
    gravity: Sequence[float] | Array | None = None,
    plane: Plane | None = None,
    rotors: bool = False,
) -> Robot:
    """A robot by its short name, the name of a file of example-robot-data, the path of a URDF or MJCF file, or its text.

    Args:
        name_or_path: "talos", "g1", "panda", "tiago_dual", "my/robot.urdf", ...
        text: The URDF or MJCF itself, as a string or as bytes in UTF-8, in place of a name or path. No file is written. The
            robot's `urdf` is then a name in "(in memory)", which is no file. Meshes and included files come from
            `package_dirs` only.
        root: "free_flyer" gives it six unactuated coordinates, position and quaternion; "planar" three, in `plane`: x, y and
            the cosine and sine of its heading; "fixed" welds its root link to the world (and so drops that link's mass).
            By default that of the loop file, else "free_flyer". An MJCF file states itself whether it floats.
        passive: Joints without a motor, besides those of the loop file.
        package_dirs: Folders with the packages of `package://` meshes, or the meshes and included files of an MJCF that
            are not in its folder.
        limits: How large the file may be; `FileLimits(max_dof=400)` takes a robot of more than 200 degrees of freedom.
        loops: The file that closes its tree, see `rbd.robots.loop_file`, or its contents, `rbd.robots.LoopFile.of_text(...)`;
            by default `<stem>.loops.yaml` next to the robot's file, if there is one, and the <equality> of an MJCF. None
            leaves all loops open.
        leave_out: What of an MJCF file is to be left out: "gravcomp" and "tendons" with springs or inertia, for which the
            equation of motion has no term, so that the file would else be refused; "springs" of joints, which are else in
            `robot.joint_springs()`; "actuators" gives every joint a motor without limits in place of those of the file.
        feet: Its feet, in place of those of the catalogue, for `standing`, `feet`, `soles` and `rbd.find_pose`: frames, each
            with the flat underside of its body's collision shapes (for a ball its lowest point: see `rbd.Robot.feet`),
            taken where `robot.standing()` has its joints; or surface and point contacts, whose friction and ground
            `robot.feet` replaces.
        gravity: In W, shape (3,) [m/s2]; zero too. By default that of an MJCF's <option>, else (0, 0, -9.81). The planes of
            contacts stay: see `robot.with_gravity`.
        plane: Of a planar root, the axes of W along which it slides: that of the loop file by default, else "xy", the ground;
            "xz" upright, where it turns counter-clockwise seen from -y, as `rbd.mechanism.link_angles` measures; "yz", seen
            from x. Its q has these two coordinates, then cosine and sine of the angle.
        rotors: Whether the rotor inertias of a URDF's transmissions and of its SRDF are added to M; see `Robot.rotors`.

    What the doctor finds wrong is refused; what it finds worth knowing is one `ModelWarning`, and `rbd.doctor(robot)`
    reports it in full. Of robots of the catalogue, without `loops` of your own, that is known: the doctor and `rbd info` have
    it, without a warning. Files of example-robot-data are loaded with their faults, as warnings: the full Romeo's M is
    singular, so it has kinematics and no accelerations.

    Raises:
        UnknownRobot: no such robot; the nearest names are in the message.
        JointNotFound: an unknown passive joint.
        ModelError: a missing or broken file, of the robot or of its loops.
        InputError: arguments of the wrong kind; a name and a text, or neither.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> solo.nq, solo.nv, solo.nu, [foot.name for foot in solo.feet()]
        (19, 18, 12, ['front_left', 'front_right', 'hind_left', 'hind_right'])
        >>> arm = rbd.load_robot("panda", root="fixed", passive=["panda_joint7"])
        >>> arm.nv, arm.nu
        (9, 8)
        >>> ball = '<robot name="ball"><link name="ball"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" '
        >>> print(rbd.load_robot(text=ball + 'ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'))
        Robot('ball', nq=7, nv=6, nu=0, mass=2.000 kg)
    """
    if root is not None and (not isinstance(root, str) or root not in ROOTS):
        raise InputError(f"root is {root!r:.80}; expected 'free_flyer', 'planar' or 'fixed'.")
    check_kind("limits", limits, FileLimits | None, "rbd.model.FileLimits(max_dof=...)")
    limits = FileLimits() if limits is None else limits
    check_leave_out(leave_out)
    fall = None if gravity is None else checked_gravity(gravity)
    check_flag("rotors", rotors)
    source, data = _source(name_or_path, text, package_dirs, limits)
    robot = _loaded(source, root, passive, limits, loops, leave_out, plane, data)
    if feet is not None:
        robot.source = replace(source, feet=registered(robot, robot._collision, feet, robot._down()))
    named = data is None and source.package_dirs[0] == source.urdf.parent and (loops is None or isinstance(loops, bool))
    place = travelling.known_place(source) if named else None
    if place is not None:
        kept = None if limits == FileLimits() else limits
        options = robot.root, sorted(robot.passive), kept, loops, sorted(robot.leave_out), robot.plane
        robot.known = partial(_known_again, place, options, None if feet is None else robot.source.feet)
    if rotors:
        robot = robot.with_motors(robot.rotors())
        assert robot.report is not None
        robot.report = with_rotors(robot.report, robot)
    if fall is not None:
        robot.model.gravity.linear = fall  # last: its feet are where level ground under it would touch
    report = robot.report
    assert report is not None
    if not source.known:
        refuse(report, source.urdf.name)
    if report.errors or (report.warnings and not (source.known and (loops is None or isinstance(loops, bool)))):
        warnings.warn(report.summary(), ModelWarning, stacklevel=2)
    return robot


def _source(
    name_or_path: str | os.PathLike[str] | None,
    text: str | bytes | None,
    package_dirs: Iterable[str | os.PathLike[str]],
    limits: FileLimits,
) -> tuple[catalogue.RobotSource, bytes | None]:
    """(the source, the bytes of a text in memory)."""
    if text is None:
        if name_or_path is None:
            raise InputError("no robot is named; expected a name or a path, load_robot('talos'), or load_robot(text=...).")
        if isinstance(name_or_path, str) and name_or_path.lstrip("\ufeff \t\r\n").startswith("<"):
            raise InputError(f"the robot is {name_or_path!r:.60}, which is XML and no name; give it as load_robot(text=...).")
        return catalogue.find(name_or_path, package_dirs), None
    if name_or_path is not None:
        raise InputError(f"text came with a name, {name_or_path!r:.80}; expected one of them.")
    check_kind("text", text, str | bytes, "a URDF or MJCF as a string or as bytes")
    try:
        data = text.encode() if isinstance(text, str) else text
    except UnicodeEncodeError as error:
        raise InputError(f"text has the character {error.object[error.start]!r}, which no file in UTF-8 has.") from None
    if b"<" not in data:
        raise InputError(
            f"text is {text!r:.80}, which is no XML; expected a URDF or MJCF. A file is loaded by load_robot(path)."
        )
    element = parse_xml("the text", data, limits)
    name, ending = ("model", ".xml") if element.tag == "mujoco" else ("name", ".urdf")
    return catalogue.RobotSource.of_text(element.get(name, ""), ending, package_dirs), data


def _loaded(
    source: catalogue.RobotSource,
    root: Root | None,
    passive: Sequence[str],
    limits: FileLimits,
    loops: str | os.PathLike[str] | LoopFile | bool | None,
    leave_out: Collection[str],
    plane: Plane | None,
    data: bytes | None = None,
) -> Robot:
    """The robot of a file and its report, whatever is in that."""
    closing = loop_file_of(source, loops)
    root = root or closing.root or "free_flyer"
    file = read(
        source.place,
        limits,
        base=ROOTS[root],
        known=source.known,
        folders=source.package_dirs,
        leave_out=leave_out,
        data=data,
    )
    plane = closing.plane if plane is None and root == "planar" else plane
    model = build_model(file, root, checked_plane(plane, root), closing.order)
    if isinstance(file.content, Mjcf):
        passive = tuple(joined(passive, file.content.undriven))
        root = "free_flyer" if model.nv and model.joints[1].shortname() == "JointModelFreeFlyer" else "fixed"
    check_freedoms(source.urdf, model.nv, limits)
    if model.nv == 0:
        raise ModelError(f"nothing moves in {source.urdf.name}: it has no joints, and its root is fixed.")
    closed = mechanism(model, source.urdf.name, closing, file.content.equalities if loops else ())
    robot = Robot(model, source, root, passive, limits, closed, leave_out)
    robot.springs = {} if "springs" in leave_out else file.content.springs
    if not source.known:
        robot._keep_text(file)
    robot.report = examine(robot, file, robot.postures, source.package_dirs)
    robot.sound = robot.report.ok and not any(issue.kind == "singular" for issue in robot.report.warnings)
    return robot


def _known_again(
    place: tuple[str, str], options: tuple[Any, ...], feet: tuple[catalogue.Foot, ...] | None, digest: str, versions: str
) -> Robot:
    """A robot of the catalogue in another process."""
    source = travelling.again_known(place)
    root, passive, limits, loops, leave_out, plane = options
    robot = _loaded(source, root, passive, limits or FileLimits(), loops, leave_out, plane)
    if feet is not None:
        robot.source = replace(source, feet=feet)
    travelling.check_same(robot, digest, versions)
    robot.known = partial(_known_again, place, options, feet)
    return robot


def doctor(robot: Robot, *, beside: Robot | None = None) -> ModelReport:
    """Report on the faults of a robot, and on the contents of its file that the dynamics ignore.

    Errors: masses and inertias that are not finite, negative masses, joints whose outboard bodies leave M singular or
    indefinite, mass lost between file and model, swapped limits. Warnings: inertias that no body has, postures outside
    limits, missing meshes, missing effort limits, damping and friction, mimicked joints, loops that no posture closes. Notes:
    loops and wheels, and where the loops are closed. M is tried at neutral and at
    random configurations (the same ones each time); no mesh is opened.

    If the file no longer exists, the report at loading, with a note. A robot in memory keeps its text, which is read again.

    Args:
        robot: Whose report.
        beside: The same robot by another file, as an MJCF beside a URDF: `differences` are then the joints, axes, limits,
            efforts, speeds, rotor inertias, masses, centres and inertias that this file states otherwise, by more than a file's
            rounding, 0.1 %, 1 mm or 1 mrad. Joints are the same by name, also where case, punctuation or the word "joint"
            differ; places, axes and inertias are those at q = 0.

    Raises:
        InputError: not a robot; one beside itself.
        ModelError: its file is broken since.

    Example:
        >>> print(rbd.doctor(rbd.load_robot("solo12")))
        solo12: 0 errors, 0 warnings. Nothing is wrong with it.
        >>> lifted = rbd.load_robot("solo12").with_motors({"FL_KFE": rbd.Motor(limit=4.0)})
        >>> print(rbd.doctor(rbd.load_robot("solo12"), beside=lifted).differences[0].text)
        1000 N m here, 4 N m in solo12.urdf
    """
    if not isinstance(robot, CheckedModel) or not hasattr(robot, "source"):
        raise InputError(f"doctor wants a robot, got {type(robot).__name__}. Load one with rbd.load_robot(name).")
    if beside is not None and (not isinstance(beside, CheckedModel) or not hasattr(beside, "source")):
        raise InputError(f"beside is {type(beside).__name__}; expected the same robot by another file: rbd.load_robot(path).")
    if beside is robot:
        raise InputError("beside is the robot itself; expected the same robot by another file: rbd.load_robot(path).")
    source, more = robot.source, []
    data = robot.text.encode() if source.in_memory else None
    if not is_standard(robot.gravity):
        told = f"is {(robot.gravity + 0.0).tolist()} m/s2, not {list(STANDARD)}; planes of contacts stay as they are"
        more.append(ModelIssue("gravity", robot.name, told))
    if data is None and robot.report is not None and not source.urdf.is_file():
        report = robot.report
        more.append(ModelIssue("file", source.urdf.name, "is no longer there; this is what was found when it was loaded"))
    else:
        folders = source.package_dirs
        file = read(source.place, robot.limits, base=ROOTS[robot.root], folders=folders, leave_out=robot.leave_out, data=data)
        report = examine(robot, file, robot.postures, source.package_dirs)
    report = replace(report, notes=(*report.notes, *more)) if more else report
    if beside is None:
        return report
    name = beside.source.urdf.name
    return replace(report, beside=name, differences=tuple(differences(robot, beside, name)))
