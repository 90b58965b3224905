"""RobotBuilder: a robot or mechanism from bodies, joints, shapes and loops, without a file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rbd.arrays import Array
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.displayed import Displayed
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.errors.inputs import check_choice, check_kind
from rbd.model.input_files import FileLimits
from rbd.model.output_files import check_place, write_text
from rbd.model.urdf import BASE_JOINT, depth_first, grouped
from rbd.model.world import Plane, checked_plane
from rbd.robots import catalogue
from rbd.robots.building.parts import BuilderBody, BuilderJoint, a_body
from rbd.robots.building.solids import Solid
from rbd.robots.building.writing import Entry, check_tree, urdf_text, yaml_text
from rbd.robots.loading import load_robot
from rbd.robots.loop_file import ENDING, ROOTS, LoopFile, NamedFrame, Root, constraint_entry
from rbd.robots.number_checks import checked_mapping, checked_name, checked_triple, checked_values
from rbd.robots.robot import Robot

DELIBERATE = ("effort",)
"""Kinds of warnings of the doctor that a user of the builder has asked for: a motor whose limit was not given."""


def finished(text: str, loops: LoopFile, thin: Collection[str], **options: Any) -> Robot:
    """The robot of two texts. A `ModelWarning` has what the doctor finds, without motors whose limit was not given.

    Args:
        text: The URDF.
        loops: The loop file.
        thin: Bodies without extension that were asked for, which are left out of the warning too.
        options: More for `load_robot`.
    """
    with warnings.catch_warnings(action="ignore", category=ModelWarning):
        robot = load_robot(text=text, loops=loops, **options)
    report = robot.report
    assert report is not None
    kept = [f for f in report.warnings if f.kind not in DELIBERATE and not (f.kind == "inertia" and f.where in thin)]
    if kept:
        warnings.warn(replace(report, warnings=tuple(kept)).summary(), ModelWarning, stacklevel=3)
    return robot


GROUND = "ground"
"""The body of a fixed root: what does not move. It need not be declared."""
End = str | tuple[str, Sequence[float] | Array]


class RobotBuilder(Displayed):
    """Builds a robot or mechanism in memory: bodies, joints, loops, drives, wheels, postures, then `robot()` or `save()`.

    A body's axes are those of its joint: `at` and `rpy` of `joint` place the child's axes in the parent's, for the joint at
    zero, and everything of the child (solids, com, frames, joints that hang on it) is given in them. Where no joint is turned,
    all bodies' axes are parallel to the world's at q = 0. The tree may be declared in any order. A loop of bodies is a tree
    and a `loop` that closes it.

    In q, v and tau the joints on one body follow each other as declared, each with all those beyond it before the next one:
    `robot.joints` lists them. Where that is not the order in which all joints were declared, `robot.at` takes no bare list.

    Args:
        name: Of the robot.
        root: "free_flyer": the root body floats. "planar": it slides and turns in a plane. "fixed": it does not move; it may be
            called "ground", and then need not be declared.
        plane: Of a planar root: "xy", the ground, by default; "xz" or "yz", upright. See `load_robot`.
        about: What it is, for the head of its file.

    Raises:
        InputError: an empty name, an unknown root.

    Example:
        >>> b = rbd.RobotBuilder("pendulum", root="fixed")
        >>> b.body("bob", rbd.robots.Rod((0, 0, 0), (0, 0, -0.9), mass=0.1), rbd.robots.Sphere(0.1, mass=2.0, at=(0, 0, -1)))
        >>> b.joint("pivot", "ground", "bob", "revolute", axis=(0, 1, 0))
        >>> pendulum = b.robot()
        >>> print(pendulum, rbd.solve(pendulum.at([0.1]), []).a.round(4))
        Robot('pendulum', nq=1, nv=1, nu=0, mass=2.100 kg) [-0.9842]
    """

    def __init__(self, name: str, *, root: Root = "free_flyer", plane: Plane | None = None, about: str = "") -> None:
        self.name = checked_name("the name of the robot", name)
        check_choice("root", root, ROOTS)
        self.root: Root = root
        self.plane = None if plane is None else checked_plane(plane, root)
        check_kind("about", about, str, "a sentence")
        self.about = about
        self._bodies: dict[str, BuilderBody] = {}
        self._joints: dict[str, BuilderJoint] = {}
        self._frames: dict[str, NamedFrame] = {}
        self._lists: dict[str, list[Entry]] = {"loops": [], "couplings": [], "drives": [], "wheels": []}
        self._postures: dict[str, dict[str, float | tuple[float, ...]]] = {}

    def __repr__(self) -> str:
        counts = [f"{len(found)} {what}" for what, found in (("bodies", self.bodies), ("joints", self.joints))]
        counts += [f"{len(found)} {what}" for what, found in self._lists.items() if found]
        return f"RobotBuilder({self.name!r}, root={self.root!r}, {', '.join(counts)})"

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies, as declared."""
        return tuple(self._bodies)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, as declared."""
        return tuple(self._joints)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames, as declared."""
        return tuple(self._frames)

    def body(
        self,
        name: str,
        *solids: Solid,
        mass: float | None = None,
        com: Sequence[float] | Array | None = None,
        inertia: Sequence[float] | Array | None = None,
        elements: str = "",
    ) -> None:
        """Declare a body: of solids, or by its mass, centre of mass and inertia.

        Args:
            name: Of the body, which becomes a link of the robot.
            solids: `rbd.robots.Box`, `Cylinder`, `Sphere`, `Capsule`, `Rod`, `Plate`, `PointMass`: they are drawn and can
                touch, and their masses, centres and inertias are joined. Solids without mass are shapes only.
            mass: In place of the masses of solids [kg].
            com: Its centre of mass in the body's axes, shape (3,) [m]; the origin by default.
            inertia: About the centre of mass in the body's axes [kg m2]: (Ixx, Iyy, Izz), six entries (xx, xy, xz, yy, yz, zz),
                or the matrix (3, 3).
            elements: More <visual> and <collision> elements of a URDF, such as meshes, see `package_dirs` of `robot`.

        Raises:
            InputError: a name that is taken, numbers that are wrong, an inertia that no body can have, with the violated
                triangle inequality.
        """
        self._unused("body or frame", name, (*self._bodies, *self._frames))
        self._bodies[name] = a_body(name, solids, mass, com, inertia, elements)

    def joint(
        self,
        name: str,
        parent: str,
        child: str,
        kind: str = "revolute",
        *,
        at: Sequence[float] | Array = (0.0, 0.0, 0.0),
        rpy: Sequence[float] | Array = (0.0, 0.0, 0.0),
        axis: Sequence[float] | Array = (0.0, 0.0, 1.0),
        motor: bool = False,
        effort: float | None = None,
        limits: Sequence[float] | Array | None = None,
        speed: float | None = None,
        damping: float = 0.0,
        friction: float = 0.0,
        armature: float = 0.0,
        plane: Plane = "xy",
    ) -> None:
        """Declare the joint by which a body hangs on another one.

        Args:
            name: Of the joint.
            parent: A body, or "ground" where the root is fixed.
            child: The body that it moves; a body hangs on one joint.
            kind: "revolute" (q is the angle), "continuous" (q is its cosine and sine), "prismatic", "ball" (a quaternion),
                "planar" (slides and turns in a plane of its axes), "free", or "fixed".
            at: Origin of the child's axes in the parent's, shape (3,) [m].
            rpy: Their roll, pitch and yaw [rad].
            axis: In the child's axes, shape (3,), of any length.
            motor: Whether it has a motor.
            effort: The motor's limit [N m, N]; None where it has none.
            limits: (lower, upper) of a revolute or prismatic joint [rad, m]; if none are given, 10,000 rad or 1 km either way.
            speed: Largest speed [rad/s, m/s]; None where it has none.
            damping: Of the file [N m s/rad, N s/m]; the dynamics have it where `external` does.
            friction: Dry friction [N m, N], for `robot.joint_frictions()`.
            armature: Rotor inertia seen through the gear [kg m2, kg].
            plane: Of a planar joint: "xy" by default; "xz", where it turns about -y, or "yz", as of a planar root. The file
                has a link `<name>_plane` between the two bodies.

        Raises:
            InputError: a name that is taken, a child with two parents, an axis of zero length, an unknown kind, numbers that
                are wrong.
        """
        self._unused("joint", name, (*self._joints, BASE_JOINT))
        made = BuilderJoint(
            name, parent, child, kind, at=at, rpy=rpy, axis=axis, motor=motor, effort=effort, limits=limits, speed=speed,
            damping=damping, friction=friction, armature=armature, plane=plane,
        )  # fmt: skip
        if child == GROUND and self.root == "fixed":
            raise InputError(f"joint {name!r:.80} moves the ground, which is fixed; expected it as the parent.")
        for other in self._joints.values():
            if other.child == child:
                raise InputError(
                    f"body {child!r:.80} has two parents, {other.parent!r:.80} (joint {other.name!r:.80}) and "
                    f"{parent!r:.80} (joint {name!r:.80}). Bodies in a circle are a tree and a loop: keep one of the "
                    f"joints, and use .loop({name!r:.80}, a, b, kind=...) for the other."
                )
        self._joints[name] = made

    def frame(
        self,
        name: str,
        body: str,
        at: Sequence[float] | Array = (0.0, 0.0, 0.0),
        *,
        rpy: Sequence[float] | Array = (0.0, 0.0, 0.0),
    ) -> None:
        """Declare a frame on a body: for contacts, loops, forces and drawings.

        Args:
            name: Of the frame.
            body: That carries it, or "ground" where the root is fixed.
            at: Its origin in the body's axes, shape (3,) [m].
            rpy: Its roll, pitch and yaw [rad].

        Raises:
            InputError: a name that is taken, numbers that are wrong.
        """
        self._unused("body or frame", name, (*self._bodies, *self._frames))
        what = f"of frame {name!r:.80}"
        link = checked_name(f"the body {what}", body)
        self._frames[name] = NamedFrame(name, link, checked_triple(f"at {what}", at), checked_triple(f"rpy {what}", rpy))

    def loop(
        self,
        name: str,
        a: End,
        b: End,
        *,
        kind: str,
        axis: Sequence[float] | Array | None = None,
        axis_b: Sequence[float] | Array | None = None,
        length: float | None = None,
    ) -> None:
        """Close a loop of bodies: a joint between two frames, see `rbd.LoopClosure`.

        Args:
            name: Of the loop.
            a: A frame or body, or (body, point in its axes [m]); for the point a frame `<name>_a` is added.
            b: The other end, likewise; its frame is `<name>_b`.
            kind: "point" (a ball joint), "revolute", "rigid", "planar" (a pin of flat mechanisms, or in a slot), "cylindrical",
                "prismatic", "universal", "rod" or "rope".
            axis: Of "revolute", "cylindrical", "prismatic", the first pin of "universal", or normal of "planar", in the axes of
                a, z by default; that of b is the same.
            axis_b: Of the second pin of "universal", in the axes of b.
            length: Of a "rod" or "rope" [m]; by default that in the posture "assembled", else in the neutral one.

        Raises:
            InputError: a name that is taken, an unknown kind, an axis of zero length, keys that a kind does not have.
        """
        names = {f"frame_{key}": end if isinstance(end, str) else f"{name}_{key}" for key, end in (("a", a), ("b", b))}
        entry = self._entry("loops", f"loop {name!r:.80}", name, kind=kind, **names, axis=axis, axis_b=axis_b, length=length)
        for key, end in (("a", a), ("b", b)):
            if isinstance(end, str):
                continue
            if not isinstance(end, tuple | list) or len(end) != 2:
                raise InputError(
                    f"end {key} of loop {name!r:.80} is {end!r:.80}; expected a frame, or a body and a point: "
                    "('K3', (0.1, 0, 0))."
                )
            self.frame(f"{name}_{key}", end[0], end[1])
        self._lists["loops"].append(entry)

    def coupling(self, name: str, joint: str, to: str, ratio: float, offset: float = 0.0) -> None:
        """Couple two joints, q_joint = ratio q_to + offset, as gears and belts do; see `rbd.JointCoupling`.

        Raises:
            InputError: a name that is taken, numbers that are wrong.
        """
        keys = {"joint": joint, "to": to, "ratio": ratio, "offset": offset}
        self._lists["couplings"].append(self._entry("couplings", f"coupling {name!r:.80}", name, **keys))

    def drive(
        self,
        name: str,
        joint: str,
        *,
        rate: float | None = None,
        start: float | None = None,
        times: Sequence[float] | Array | None = None,
        values: Sequence[float] | Array | None = None,
        periodic: bool | None = None,
    ) -> None:
        """Drive a joint: at a constant speed, q = start + rate t, or along a spline; see `rbd.DrivenJoint` and `Robot.drives`.

        Args:
            name: Of the drive.
            joint: A joint with one degree of freedom.
            rate: Its speed [rad/s, m/s].
            start: Where it is at t = 0 [rad, m]; zero by default.
            times: In place of a rate: of the points of a cubic spline, increasing, four or more [s].
            values: Of the joint at these times [rad, m].
            periodic: Whether the spline repeats, its last value being its first.

        Raises:
            InputError: a name that is taken, numbers that are wrong, neither a rate nor times and values, or both.
        """
        keys = {"rate": rate, "start": start, "times": times, "values": values, "periodic": periodic}
        kind = "speed" if times is None and values is None else "spline"
        self._lists["drives"].append(self._entry("drives", f"drive {name!r:.80}", name, kind=kind, joint=joint, **keys))

    def wheel(
        self,
        name: str,
        frame: str,
        *,
        kind: str = "rolling_wheel",
        radius: float | None = None,
        axis: Sequence[float] | Array | None = None,
        direction: Sequence[float] | Array | None = None,
        shape: Sequence[float] | Array | None = None,
        surface_radius: float | None = None,
        on: str | float | Sequence[float] | Array | None = None,
    ) -> None:
        """Let something roll or slide on the ground z = 0, or on something else.

        Args:
            name: Of the wheel.
            frame: At its centre.
            kind: "rolling_wheel" (upright), "rolling_disk" (it may lean), "rolling_ball", "rolling_body" (an ellipsoid),
                "rolling_on_round" (a ball in or on a ball or cylinder), or "knife_edge".
            radius: Of what rolls [m]; of "rolling_body" by how much it is grown, zero by default.
            axis: Of a wheel or disk, in the frame's axes, y by default; of the cylinder of "rolling_on_round", in W.
            direction: Of a knife edge, in the frame's axes; x by default.
            shape: Semi-axes of "rolling_body" [m].
            surface_radius: Of "rolling_on_round": of what it rolls on [m]; negative of what it rolls in.
            on: Of what rolls: a height [m], a point of level ground, shape (3,) [m], or a frame of the robot; of
                "rolling_on_round" the centre, or a point of the cylinder's axis.

        Raises:
            InputError: a name that is taken, an unknown kind, a radius that is missing or none.
        """
        keys = {"radius": radius, "axis": axis, "direction": direction, "shape": shape, "on": on}
        keys |= {"surface_radius": surface_radius}
        self._lists["wheels"].append(self._entry("wheels", f"wheel {name!r:.80}", name, kind=kind, frame=frame, **keys))

    def constraint(self, name: str, kind: str, **keys: str | bool | float | Sequence[float]) -> None:
        """Add a user's kind of constraint, see `rbd.register_constraint`, to the loops.

        Args:
            name: Of the constraint.
            kind: The registered word.
            keys: Its parameters.

        Raises:
            InputError: a name that is taken, a kind that is not registered.
        """
        self._lists["loops"].append(self._entry("loops", f"constraint {name!r:.80}", name, kind=kind, **keys))

    def _entry(self, part: str, what: str, name: str, **keys: object) -> Entry:
        """A constraint for the loop file, checked; keys that are None are left out."""
        names = [entry["name"] for known in self._lists.values() for entry in known]
        self._unused("loop, coupling, drive or wheel", name, names)
        return constraint_entry(part, what, {"name": name} | {key: value for key, value in keys.items() if value is not None})

    def posture(self, name: str, values: Mapping[str, float | Sequence[float]]) -> None:
        """Name a configuration: {joint: angle [rad], displacement [m], or the joint's part of q}; joints not named are at zero.

        Args:
            name: Of the posture, for `robot.at(name)`.
            values: By joint; the root's joint is "root_joint".

        Raises:
            InputError: a name that is taken, values that are no numbers.
        """
        self._unused("posture", name, self._postures)
        what = f"posture {name!r:.80}, joints and their values as {{'knee': 0.3}},"
        angles = checked_mapping(what, values).items()
        self._postures[name] = {joint: checked_values(f"{joint!r:.80} of posture {name!r:.80}", each) for joint, each in angles}

    def urdf(self) -> str:
        """The URDF: its bodies, joints, frames and shapes.

        Ball joints have the type "spherical", which `rbd` and PyBullet read.

        Raises:
            ModelError: no tree with one root, unknown bodies, a moving body without mass.
        """
        bodies, joints = self._bodies, list(self._joints.values())
        ends = {*(joint.parent for joint in joints), *(frame.link for frame in self._frames.values())}
        if self.root == "fixed" and GROUND in ends and GROUND not in bodies:
            bodies = {GROUND: BuilderBody(GROUND), **bodies}
        check_tree(self.name, self.root, bodies, joints, self._frames.values())
        return urdf_text(self.name, self.about, bodies.values(), joints, self._frames.values())

    def loop_file(self) -> str:
        """The loop file, in YAML: the root, passive joints, loops, couplings, drives, wheels and postures."""
        passive = [joint.name for joint in self._joints.values() if not joint.motor and joint.kind not in ("fixed", "free")]
        head = "".join(f"# {line.strip()}\n" for line in self.about.splitlines())
        return head + yaml_text(self.root, self.plane, passive, self._order(), self._lists, self._postures)

    def _order(self) -> list[str]:
        """The joints that move, as declared; none where Pinocchio, by the alphabet and depth-first, has them so."""
        on = {joint.child: joint for joint in self._joints.values()}
        declared = [joint.name for joint in on.values() if joint.kind != "fixed"]
        by_name = sorted(on.values(), key=lambda joint: joint.name)
        below = grouped((joint.parent if joint.parent in on else "", joint.child) for joint in by_name)
        found = [on[body].name for body in depth_first("", below) if on[body].kind != "fixed"]
        return [] if found == declared else declared

    def robot(
        self,
        *,
        feet: Sequence[str | SurfaceContact | PointContact] | None = None,
        limits: FileLimits | None = None,
        package_dirs: Iterable[str | os.PathLike[str]] = (),
        gravity: Sequence[float] | Array | None = None,
    ) -> Robot:
        """The robot: the one that `load_robot` gives for the saved file. No file is written.

        What the doctor finds worth knowing is a `ModelWarning`, without motors whose limit was not given and thin bodies that
        were asked for.

        Args:
            feet: Its feet, as for `load_robot`.
            limits: How large it may be, as for `load_robot`.
            package_dirs: Folders of meshes, as for `load_robot`.
            gravity: In W, shape (3,) [m/s2], as for `load_robot`; a file has no place for it.

        Raises:
            ModelError: no tree with one root, unknown names, moving bodies without mass, an M that is singular.
            InputError: feet or limits of the wrong kind.
        """
        loops = LoopFile.of_text(self.loop_file(), f"{self.name}{ENDING}")
        thin = {name for name, body in self._bodies.items() if body.thin}
        return finished(self.urdf(), loops, thin, limits=limits, feet=feet, package_dirs=package_dirs, gravity=gravity)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the URDF, and the loop file beside it; `load_robot(path)` gives the same robot, named as the file.

        Args:
            path: A name that ends in .urdf.

        Returns:
            The path of the URDF.

        Raises:
            InputError: another ending.
            ModelError: a model that is wrong, as `robot`; files that cannot be written.
        """
        place = catalogue.file_path(path, "the path")
        if place.suffix != ".urdf":
            raise InputError(f"the path is {str(path)!r:.200}; expected one that ends in .urdf, the loop file goes beside it.")
        texts = {place: self.urdf(), place.with_suffix(ENDING): self.loop_file()}
        for each in texts:
            check_place(each, ModelError)
        for each, text in texts.items():
            write_text(each, text, ModelError)
        return place

    def _unused(self, what: str, name: object, names: Iterable[object]) -> None:
        if checked_name(f"the name of a {what}", name) in names:
            raise InputError(f"there is a {what} {name!r:.80} already; expected another name.")
