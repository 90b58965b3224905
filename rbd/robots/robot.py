"""Robot, load_robot and doctor: a checked model with its postures, its feet, a standing state, and its faults."""

from __future__ import annotations

import copy
import os
import pickle
import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact_kinds import PointContact, SurfaceContact
from rbd.constraints.joint import JointCoupling, JointFriction
from rbd.constraints.joint_limit import JointLimit
from rbd.constraints.joint_lists import joint_frictions, joint_limits, mimics
from rbd.errors import InputError, ModelError, ModelWarning, nearest
from rbd.model import mjcf
from rbd.model.checked_model import CheckedModel
from rbd.model.files import build_model, check_freedoms, read
from rbd.model.input_files import FileLimits
from rbd.model.state import State
from rbd.model.travelling import Recipe, packed, unpacked
from rbd.model.urdf import BASE_JOINT
from rbd.problem.ground import On
from rbd.robots import catalogue, travelling
from rbd.robots.diagnosis import ModelIssue, ModelReport, examine, refuse
from rbd.robots.feet import contacts_of, registered
from rbd.robots.loop_file import ROOTS, Root
from rbd.robots.loops import Mechanism, loop_file_of, mechanism, read_postures
from rbd.robots.posture import stand
from rbd.robots.shapes import ShapedRobot


class Robot(ShapedRobot):
    """A robot, as `load_robot` gives it: its checked Pinocchio model, its postures, feet, limits and loops.

    Made by `load_robot`. In addition to `CheckedModel`:

    Attributes:
        urdf: The model file.
        root: "free_flyer", "planar" or "fixed".
        postures: {name: q, shape (nq,)}, from the SRDF, the catalogue and the loop file.
        leave_out: Parts of an MJCF file that were left out, as requested from `load_robot`.
        report: What the doctor found when it was loaded; None where it was not loaded from a file.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> print(solo)
        Robot('solo12', nq=19, nv=18, nu=12, mass=2.500 kg)
        >>> print(sorted(solo.postures), [foot.name for foot in solo.feet()])
        ['standing', 'straight_standing'] ['front_left', 'front_right', 'hind_left', 'hind_right']
        >>> solo.standing().com.round(3)
        array([0.   , 0.   , 0.209])
    """

    def __init__(
        self,
        model: pin.Model,
        source: catalogue.Source,
        root: Root,
        passive: Iterable[str] = (),
        limits: FileLimits = FileLimits(),  # noqa: B008  frozen
        mechanism: Mechanism = Mechanism(),  # noqa: B008  frozen
        leave_out: Iterable[str] = (),
        postures: Mapping[str, Array] | None = None,
    ) -> None:
        # A base that slides on the ground has no motor.
        base = (BASE_JOINT,) if root == "planar" else ()
        super().__init__(model, passive=_joined(passive, (*mechanism.file.passive, *base)), name=source.name)
        self.source = source
        self.urdf = source.urdf
        self.root: Root = root
        self.limits = limits
        self.leave_out = frozenset(leave_out)
        self.report: ModelReport | None = None
        found = read_postures(self, source, mechanism) if postures is None else {name: q.copy() for name, q in postures.items()}
        for q in found.values():
            q.flags.writeable = False
        self.postures = MappingProxyType(found)
        self.mechanism = mechanism
        self._loops: tuple[Constraint, ...] = mechanism.loops(self)
        self._wheels: tuple[Constraint, ...] = mechanism.wheels(self)

    in_catalogue: tuple[tuple[str, str], tuple[Any, ...], tuple[catalogue.Foot, ...] | None] | None = None

    def _recipe(self) -> Recipe:
        """By name, of a robot of the catalogue as it is there; else the numbers of the model, the text, and the rest."""
        if self.in_catalogue is not None:
            return Recipe(_known_again, (*self.in_catalogue, *travelling.numbers_and_versions(self._as_made)))
        numbers = packed(self._as_made), pin.__version__
        parts = (
            travelling.sent_source(self.source),
            self.root,
            sorted(self.passive),
            self.limits,
            self.mechanism,
            sorted(self.leave_out),
        )
        kept = dict(self.postures), self._text, self._mesh_names, self.report, self.sound
        return Recipe(_robot_again, (*numbers, *parts, *kept))

    def _content(self) -> str:
        postures = [(name, q.tolist()) for name, q in self.postures.items()]
        loops = pickle.dumps(self.mechanism).hex() if self.mechanism.file_name else ""
        return repr((self.name, self.root, sorted(self.passive), self.source.feet, self.source.posture, postures, loops))

    def _with_model(self, model: pin.Model, memo: dict[int, object] | None) -> Robot:
        closed = self.mechanism if memo is None else copy.deepcopy(self.mechanism, memo)
        out = Robot(model, self.source, self.root, self.passive, self.limits, closed, self.leave_out, self.postures)
        out.in_catalogue, out.report, out.sound = self.in_catalogue, self.report, self.sound
        self._share_shapes(out)
        return out

    def neutral(self) -> Array:
        """The configuration with every joint at zero, shape (nq,)."""
        return pin.neutral(self.model)

    def posture(self, name: str) -> Array:
        """A named configuration, copied, shape (nq,).

        Raises:
            InputError: with the nearest names.
        """
        if not isinstance(name, str) or name not in self.postures:
            raise InputError(f"no posture {name!r:.80} of {self.name}; {nearest(name, self.postures)}.")
        return self.postures[name].copy()

    def at(self, q: Array | str | None = None, v: Array | None = None) -> State:
        """The state at a configuration, a named posture, or the neutral one.

        Args:
            q: Configuration (nq,), the name of a posture, or None.
            v: Velocity (nv,); zero if not given.
        """
        return State(self, self.neutral() if q is None else self.posture(q) if isinstance(q, str) else q, v)

    def standing(self, posture: str | None = None) -> State:
        """At rest on its feet: soles (or points) on z = 0, the base turned so that they lie flat.

        A robot on point feet is then turned about them until its centre of mass is over its support. A fixed-base robot
        keeps its base.

        Args:
            posture: A name in `postures`; by default that of the catalogue, else the only one; a robot without postures stands
                in the neutral configuration.

        Raises:
            InputError: an unknown posture.
            ModelError: no feet are known for this robot, or it has several postures and no default.
        """
        name = self.source.posture if posture is None else posture
        if name is None and len(self.postures) == 1:
            name = next(iter(self.postures))
        if not self.floating:
            return self.at() if name is None else self.at(self.posture(name))
        feet = self.feet(friction=None)
        if name is None and not self.postures:
            return State(self, stand(self, self.neutral(), feet))
        if name is None:
            raise ModelError(
                f"no standing posture is known for {self.name}; {nearest('standing', self.postures)}. "
                "Name one, standing(posture), or build a State with your own q."
            )
        return State(self, stand(self, self.posture(name), feet))

    def soles(self, friction: float | None = 0.7, *, facets: int = 4, on: On | Mapping[str, On] = 0.0) -> list[SurfaceContact]:
        """The soles of its feet as surface contacts, from the catalogue or from `load_robot(feet=...)`.

        Args:
            friction: Coulomb's coefficient; None for bilateral contacts.
            facets: Facets of the corner pyramids in a QP.
            on: The ground under them: a plane, `rbd.Ground(point=..., normal=...)`, or the height of a level one [m]; or
                {foot: ground}, as on stairs, with z = 0 for feet that are not named. None: not known. A foot more than a
                millimetre off its plane gets a `DistantContactWarning` where it is solved.

        Raises:
            ModelError: no soles are known; a robot on point feet has `feet`.
            UnknownName: `on` names a foot that is none.

        >>> stairs = talos.soles(on={"left_sole": 0.17})  # the right one on z = 0
        """
        feet = self.feet(friction, facets=facets, on=on)
        soles = [foot for foot in feet if isinstance(foot, SurfaceContact)]
        if len(soles) != len(feet):
            raise ModelError(f"{self.name} stands on points; use robot.feet() in place of soles().")
        return soles

    def feet(
        self, friction: float | None = 0.7, *, facets: int = 4, on: On | Mapping[str, On] = 0.0
    ) -> list[SurfaceContact | PointContact]:
        """Its feet as contacts: soles or points, from the catalogue or from `load_robot(feet=...)`. Arguments as `soles`.

        Raises:
            ModelError: no feet are known for this robot.
            UnknownName: `on` names a foot that is none.
        """
        if not self.source.feet:
            raise ModelError(
                f"no feet are known for {self.name}: its file names none. Name the frames of its feet, "
                "rbd.load_robot(file, feet=[...]), or give your own contacts: "
                "rbd.SurfaceContact(name, frame, half_lengths=(X, Y)) or rbd.PointContact(name, frame)."
            )
        return contacts_of(self.source.feet, friction, facets, on)

    def loops(self) -> tuple[Constraint, ...]:
        """The constraints that close its tree: of the loop file of its URDF, or of an MJCF's <equality>; empty for a tree.

        They act only where they are given: `rbd.solve(state, tau, robot.loops())`.
        """
        return self._loops

    def wheels(self) -> tuple[Constraint, ...]:
        """Its wheels, balls and knife edges on the ground, from the loop file; they too act only where given as constraints."""
        return self._wheels

    def joint_limits(self, *, margin: float = 1e-6) -> list[JointLimit]:
        """The limits of its joints, as `rbd.constraints.joint_limits`."""
        return joint_limits(self, margin=margin)

    def joint_frictions(self) -> list[JointFriction]:
        """The dry friction of its joints, as `rbd.constraints.joint_frictions`."""
        return joint_frictions(self)

    def mimics(self) -> list[JointCoupling]:
        """The joint couplings of its URDF's <mimic> tags, as `rbd.constraints.mimics`."""
        return mimics(self)

    def _down(self) -> State:
        """The state in which feet are assumed to be down: standing, else its only posture, else neutral."""
        known = self.source.posture or (next(iter(self.postures)) if len(self.postures) == 1 else None)
        return self.at(known) if known is None or not self.source.feet else self.standing(known)


def load_robot(
    name_or_path: str | os.PathLike[str],
    *,
    root: Root | None = None,
    passive: Sequence[str] = (),
    package_dirs: Iterable[str | os.PathLike[str]] = (),
    limits: FileLimits | None = None,
    loops: str | os.PathLike[str] | bool | None = True,
    leave_out: Collection[str] = (),
    feet: Sequence[str | SurfaceContact | PointContact] | None = None,
) -> Robot:
    """A robot by its short name, by the name of a file of example-robot-data, or by the path of a URDF or MJCF file.

    Args:
        name_or_path: "talos", "g1", "panda", "tiago_dual", "my/robot.urdf", ...
        root: "free_flyer" gives it six unactuated coordinates, position and quaternion; "planar" three, on the ground: x, y
            and the cosine and sine of its heading; "fixed" welds its root link to the world (and so drops that link's mass).
            By default that of the loop file, else "free_flyer". An MJCF file states itself whether it floats.
        passive: Joints without a motor, besides those of the loop file.
        package_dirs: Folders with the packages of `package://` meshes, or the meshes and included files of an MJCF that
            are not in its folder.
        limits: How large the file may be; `FileLimits(max_dof=400)` takes a robot of more than 200 degrees of freedom.
        loops: The file that closes its tree, see `rbd.robots.loop_file`; by default `<stem>.loops.yaml` next to the robot's
            file, if there is one, and the <equality> of an MJCF. None leaves all loops open.
        leave_out: What of an MJCF file is to be left out, where the equation of motion has no term for it and the file would
            else be refused: "springs" of joints, "gravcomp", "tendons" with springs or inertia; "actuators" gives every joint
            a motor without limits in place of those of the file.
        feet: Its feet, in place of those of the catalogue, for `standing`, `feet`, `soles` and `rbd.find_pose`: frames, each
            with the flat underside of its body's collision shapes (for a ball, its lowest point), taken in the standing
            posture, else in the neutral one; or surface and point contacts, whose friction and ground `robot.feet` replaces.

    What the doctor finds wrong is refused; what it finds worth knowing is one `ModelWarning`, and `rbd.doctor(robot)`
    reports it in full. Files of example-robot-data are loaded with their faults, as warnings: the full Romeo's and iCub's M is
    singular, so they have kinematics and no accelerations.

    Raises:
        UnknownRobot: no such robot; the nearest names are in the message.
        JointNotFound: an unknown passive joint.
        ModelError: a missing or broken file, of the robot or of its loops.
        InputError: arguments of the wrong kind.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> solo.nq, solo.nv, solo.nu, [foot.name for foot in solo.feet()]
        (19, 18, 12, ['front_left', 'front_right', 'hind_left', 'hind_right'])
        >>> arm = rbd.load_robot("panda", root="fixed", passive=["panda_joint7"])
        >>> arm.nv, arm.nu
        (9, 8)
    """
    if root is not None and (not isinstance(root, str) or root not in ROOTS):
        raise InputError(f"root is {root!r:.80}; expected 'free_flyer', 'planar' or 'fixed'.")
    if limits is not None and not isinstance(limits, FileLimits):
        raise InputError(f"limits is {limits!r:.80}; expected rbd.model.FileLimits(max_dof=...).")
    limits = FileLimits() if limits is None else limits
    mjcf.check_leave_out(leave_out)
    source = catalogue.find(name_or_path, package_dirs)
    robot = _loaded(source, root, passive, limits, loops, leave_out)
    if feet is not None:
        robot.source = replace(source, feet=registered(robot, robot._collision, feet, robot._down()))
    named = source.package_dirs[0] == source.urdf.parent and (loops is None or isinstance(loops, bool))
    place = travelling.known_place(source) if named else None
    if place is not None:
        options = robot.root, sorted(robot.passive), None if limits == FileLimits() else limits, loops, sorted(robot.leave_out)
        robot.in_catalogue = place, options, None if feet is None else robot.source.feet
    report = robot.report
    assert report is not None
    if not source.known:
        refuse(report, source.urdf.name)
    if report.errors or report.warnings:
        warnings.warn(report.summary(), ModelWarning, stacklevel=2)
    return robot


def _loaded(
    source: catalogue.Source,
    root: Root | None,
    passive: Sequence[str],
    limits: FileLimits,
    loops: str | os.PathLike[str] | bool | None,
    leave_out: Collection[str],
) -> Robot:
    """The robot of a file and its report, whatever is in that."""
    closing = loop_file_of(source.urdf, loops)
    root = root or (closing.root if closing else None) or "free_flyer"
    file = read(source.urdf, limits, base=ROOTS[root], known=source.known, folders=source.package_dirs, leave_out=leave_out)
    model = build_model(file, root)
    if file.mjcf is not None:
        passive = tuple(_joined(passive, mjcf.passive(file.mjcf)))
        root = "free_flyer" if model.nv and model.joints[1].shortname() == "JointModelFreeFlyer" else "fixed"
    check_freedoms(source.urdf, model.nv, limits)
    if model.nv == 0:
        raise ModelError(f"nothing moves in {source.urdf.name}: it has no joints, and its root is fixed.")
    closed = mechanism(model, source.urdf.name, closing, file.equalities if loops else ())
    robot = Robot(model, source, root, passive, limits, closed, leave_out)
    if not source.known:
        robot.keep_text(file)
    robot.report = examine(robot, file, robot.postures, source.package_dirs)
    robot.sound = robot.report.ok
    return robot


def _known_again(
    place: tuple[str, str], options: tuple[Any, ...], feet: tuple[catalogue.Foot, ...] | None, digest: str, versions: str
) -> Robot:
    """A robot of the catalogue in another process."""
    source = travelling.again_known(place)
    root, passive, limits, loops, leave_out = options
    robot = _loaded(source, root, passive, limits or FileLimits(), loops, leave_out)
    if feet is not None:
        robot.source = replace(source, feet=feet)
    travelling.check_same(robot, digest, versions)
    robot.in_catalogue = place, options, feet
    return robot


def _robot_again(model: bytes, version: str, source: travelling.SentSource, *rest: Any) -> Robot:
    """A robot of a file in another process."""
    root, passive, limits, closed, leave_out, postures, text, meshes, report, sound = rest
    out = Robot(unpacked(model, version), travelling.source_again(source), root, passive, limits, closed, leave_out, postures)
    out._text, out._mesh_names, out.report, out.sound = text, meshes, report, sound
    return out


def doctor(robot: Robot) -> ModelReport:
    """Report on the faults of a robot, and on the contents of its file that the dynamics ignore.

    Errors: masses and inertias that are not finite, negative masses, joints whose outboard bodies leave M singular or
    indefinite, mass lost between file and model, swapped limits. Warnings: inertias that no body has, postures outside
    limits, missing meshes, missing effort limits, damping and friction, mimicked joints, loops that no posture closes. Notes:
    loops and wheels, and where the loops are closed. M is tried at neutral and at
    random configurations (the same ones each time); no mesh is opened.

    If the file no longer exists, the report at loading, with a note.

    Raises:
        InputError: not a robot.
        ModelError: its file is broken since.

    Example:
        >>> print(rbd.doctor(rbd.load_robot("solo12")))
        solo12: 0 errors, 0 warnings. Nothing is wrong with it.
    """
    if not isinstance(robot, CheckedModel) or not hasattr(robot, "source"):
        raise InputError(f"doctor wants a robot, got {type(robot).__name__}. Load one with rbd.load_robot(name).")
    source = robot.source
    if robot.report is not None and not source.urdf.is_file():
        gone = ModelIssue("file", source.urdf.name, "is no longer there; this is what was found when it was loaded")
        return replace(robot.report, notes=(*robot.report.notes, gone))
    file = read(source.urdf, robot.limits, base=ROOTS[robot.root], folders=source.package_dirs, leave_out=robot.leave_out)
    return examine(robot, file, robot.postures, source.package_dirs)


def _joined(passive: Iterable[str], more: tuple[str, ...]) -> Iterable[str]:
    given = (passive,) if isinstance(passive, str) else passive
    try:
        return (*given, *more)
    except TypeError:
        return passive  # other types are refused where names are looked up
