"""Robot: a checked model with its postures, its feet, and a standing state."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float, locked
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.constraints.driven import DrivenJoint
from rbd.constraints.forces.joint_springs import JointDamping, JointSpring
from rbd.constraints.joint import JointCoupling, JointFriction, JointLimit, joint_frictions, joint_limits, mimics
from rbd.constraints.surface import On
from rbd.errors import InputError, ModelError, nearest
from rbd.errors.inputs import check_different, check_kind
from rbd.model.input_files import FileLimits
from rbd.model.motors import Motor
from rbd.model.pickling import Recipe, packed, unpacked
from rbd.model.state import State, checked
from rbd.model.urdf import BASE_JOINT
from rbd.problem.cones import Cone
from rbd.robots import catalogue, travelling
from rbd.robots.body_shapes import ShapedRobot
from rbd.robots.carried import Carried
from rbd.robots.diagnosis import ModelReport
from rbd.robots.feet import contacts_of
from rbd.robots.loop_file import Root
from rbd.robots.loops import Mechanism, read_postures
from rbd.robots.posture import place_on_ground, settled, stand, warn_of_gaps
from rbd.robots.rotors import file_damping, file_springs, rotors_of


class Robot(ShapedRobot):
    """A robot, as `load_robot` gives it: its checked Pinocchio model, its postures, feet, limits and loops.

    Made by `load_robot`. In addition to `CheckedModel`:

    Attributes:
        urdf: The model file; of a robot in memory, `load_robot(text=...)`, a name in "(in memory)", where there is no file.
        root: "free_flyer", "planar" or "fixed".
        postures: {name: q, shape (nq,)}, from the SRDF, the catalogue and the loop file.
        carried: What it holds in its hands, with the places that were left open; see `carrying`.
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
        source: catalogue.RobotSource,
        root: Root,
        passive: Iterable[str] = (),
        limits: FileLimits = FileLimits(),  # noqa: B008  frozen
        mechanism: Mechanism = Mechanism(),  # noqa: B008  frozen
        leave_out: Iterable[str] = (),
        postures: Mapping[str, Array] | None = None,
    ) -> None:
        # A base that slides on the ground has no motor.
        base = (BASE_JOINT,) if root == "planar" else ()
        super().__init__(model, passive=joined(passive, (*mechanism.file.passive, *base)), name=source.name)
        self.source = source
        self.urdf = source.urdf
        self.root: Root = root
        self.limits = limits
        self.leave_out = frozenset(leave_out)
        self.report: ModelReport | None = None
        found = read_postures(self, source, mechanism) if postures is None else {name: q.copy() for name, q in postures.items()}
        self.postures = MappingProxyType({name: locked(q) for name, q in found.items()})
        self.mechanism = mechanism
        self._loops: tuple[Constraint, ...] = mechanism.loops(self, found)
        self._wheels: tuple[Constraint, ...] = mechanism.wheels(self)
        self._drives: tuple[DrivenJoint, ...] = mechanism.drives(self)

    springs: Mapping[str, tuple[float, float]] = MappingProxyType({})
    """Springs of an MJCF's joints: {joint: (stiffness, coordinate at rest)}; `joint_springs` makes them force elements."""

    carried: tuple[Carried, ...] = ()

    known: Recipe | None = None
    """Of a robot of the catalogue: how another process loads it."""

    def _recipe(self) -> Recipe:
        """By name, of a robot of the catalogue as it is there; else the numbers of the model, the text, and the rest."""
        if self.known is not None:
            return partial(self.known, *travelling.numbers_and_versions(self._as_made))
        source = replace(self.source, srdf=None)  # its postures are sent
        names, left_out = sorted(self.passive), sorted(self.leave_out)
        kept = dict(self.postures), self._text, self._mesh_names, self.report, dict(self.springs)
        rest = (self.root, names, self.limits, self.mechanism, left_out, *kept)
        return partial(_robot_again, packed(self._as_made), pin.__version__, source, *rest)

    def _content(self) -> str:
        postures = [(name, q.tolist()) for name, q in self.postures.items()]
        loops = pickle.dumps(self.mechanism).hex() if self.mechanism.file_name else ""
        told = self.name, self.root, sorted(self.passive), self.source.feet, self.source.posture, postures, loops
        held = [each.plain for each in self.carried]
        return repr((*told, *([sorted(self.springs.items())] if self.springs else []), *held))

    def _extras(self) -> tuple[Any, ...]:
        return self.carried, super()._extras()

    def _take_extras(self, extras: tuple[Any, ...]) -> None:
        self.carried, rest = extras
        super()._take_extras(rest)

    def _with_model(self, model: pin.Model, memo: dict[int, object] | None) -> Robot:
        closed = self.mechanism if memo is None else copy.deepcopy(self.mechanism, memo)
        out = Robot(model, self.source, self.root, self.passive, self.limits, closed, self.leave_out, self.postures)
        out.known, out.report, out.springs = self.known, self.report, self.springs
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

        Raises:
            InputError: what `State` refuses, an unknown posture; a bare list, of a robot whose joints cannot be in the order
                in which they were declared.
        """
        for given in (q, v):
            if isinstance(given, list | tuple) and self.mechanism.file.order:
                self._refuse_lists()
        return State(self, self.neutral() if q is None else self.posture(q) if isinstance(q, str) else q, v)

    def _refuse_lists(self) -> None:
        declared = [name for name in self.mechanism.file.order if name in self.joints]
        ours = [name for name in self.joints if name in set(declared)]
        if ours != declared:
            raise InputError(
                f"q or v is a bare list, and the joints of {self.name} were declared as {', '.join(declared)}, but are in the "
                f"order {', '.join(ours)}: all joints beyond one come before the next. Name them: "
                f"robot.at().with_joints({{{declared[0]!r}: ...}}), or give an array in the order of robot.joints."
            )

    def standing(self, posture: str | None = None, *, ground: On = 0.0) -> State:
        """At rest on its feet: soles (or points) on z = 0 to 1e-9 m, the base turned so that they lie flat.

        Joint angles are those of the posture; where its file's digits leave soles leaning on each other, joints move by up to
        1e-4 rad. Feet that the posture leaves more than a millimetre off the ground are named by a `DistantContactWarning`.

        A robot on two points is then turned about them until its centre of mass is over them along gravity. The ground is z = 0
        whatever the gravity: under one that leans, feet are flat on an incline, and whether the robot can stand so is for
        `rbd.hold` to say. A base that slides in an upright plane is turned and lowered in this plane; a fixed base, and one
        that slides on the ground, stay.

        Args:
            posture: A name in `postures`; by default that of the catalogue, else the only one. A robot without postures has
                its joints at zero, or where their limits leave zero out, at the limit nearest to it: a knee of [-2.6, -0.2]
                rad at -0.2. For other angles: `rbd.robots.place_on_ground(robot.at().with_joints({...}), robot.feet())`.
                Of a robot with loops, which that would open, all are at zero.
            ground: Under its feet, if that is not z = 0: a height [m], `rbd.Ground` or `rbd.Terrain`. A floating base is then
                placed as by `rbd.robots.place_on_ground`; `rbd.find_pose(robot, ground=...)` moves joints too.

        Raises:
            InputError: an unknown posture; no ground under the feet.
            ModelError: no feet are known for this robot, or it has several postures and no default.
        """
        if as_float(ground) != 0.0:
            return place_on_ground(self.standing(posture), self.feet(friction=None, on=ground))
        name = self.source.posture if posture is None else posture
        if name is None and len(self.postures) == 1:
            name = next(iter(self.postures))
        if not self.floating:
            placed = self.at(self._plain() if name is None else self.posture(name))
            upright = self.plane in ("xz", "yz") and self.source.feet
            return self._settled(stand(self, placed.q, self.feet(friction=None))) if upright else placed
        feet = self.feet(friction=None)
        if name is None and self.postures:
            raise ModelError(
                f"no standing posture is known for {self.name}; {nearest('standing', self.postures)}. "
                "Name one, standing(posture), or build a State with your own q."
            )
        return self._settled(stand(self, self._plain() if name is None else self.posture(name), feet))

    def _settled(self, q: Array) -> State:
        state = State(self, settled(self, q, self.feet(friction=None)))
        warn_of_gaps(state, self.feet(friction=None), stacklevel=4)
        return state

    def soles(
        self, friction: float | Cone | None = 0.7, *, facets: int = 4, on: On | Mapping[str, On] = 0.0
    ) -> list[SurfaceContact]:
        """The soles of its feet as surface contacts, from the catalogue or from `load_robot(feet=...)`.

        Args:
            friction: Coulomb's coefficient, or a set of forces, as of `rbd.constraints.Contact`; None for bilateral contacts.
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
        self,
        friction: float | Cone | None = 0.7,
        *,
        facets: int = 4,
        on: On | Mapping[str, On] = 0.0,
        at: State | None = None,
    ) -> list[SurfaceContact | PointContact]:
        """Its feet as contacts: soles or points, from the catalogue or from `load_robot(feet=...)`.

        Args:
            friction: As of `soles`, like `facets` and `on`.
            facets: Of the corner pyramids.
            on: The ground under them.
            at: The state in which they touch. A foot that `load_robot(feet=...)` took from a ball has its point where the ball
                is lowest at this state, which is exact at rest; that it rolls as the leg moves is neglected. By default it is
                the lowest of the state at loading, and a `DistantContactWarning` names the feet of which another is lower
                where they are solved. Soles, and points of the catalogue, are the same in all states.

        Raises:
            ModelError: no feet are known for this robot.
            UnknownName: `on` names a foot that is none.
            InputError: `at` is no state.
            FrameNotFound: `at` is a state of another robot.

        Example:
            >>> ball = '<link name="ball"><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
            >>> ball += '</inertial><collision><geometry><sphere radius="0.02"/></geometry></collision></link>'
            >>> robot = rbd.load_robot(text=f'<robot name="ball">{ball}</robot>', feet=["ball"])
            >>> turned = rbd.State(robot, [0, 0, 0.02, 0.6, 0, 0, 0.8])
            >>> [foot.offset.round(4) for foot in (*robot.feet(), *robot.feet(at=turned))]
            [array([ 0.  ,  0.  , -0.02]), array([ 0.    , -0.0192, -0.0056])]
        """
        if not self.source.feet:
            raise ModelError(
                f"no feet are known for {self.name}: its file names none. Name the frames of its feet, "
                "rbd.load_robot(file, feet=[...]), or give your own contacts: "
                "rbd.SurfaceContact(name, frame, half_lengths=(X, Y)) or rbd.PointContact(name, frame)."
            )
        return contacts_of(self.source.feet, friction, facets, on, None if at is None else checked(at))

    def loops(self) -> tuple[Constraint, ...]:
        """The constraints that close its tree: of the loop file of its URDF, or of an MJCF's <equality>; empty for a tree.

        They hold in `rbd.solve`, `rbd.simulate` and all other functions of constraints, unless `loops=False`.
        """
        return self._loops

    def wheels(self) -> tuple[Constraint, ...]:
        """Its wheels, balls and knife edges on the ground, from the loop file; they act only where given as constraints."""
        return self._wheels

    def drives(self) -> tuple[DrivenJoint, ...]:
        """Its driven joints, from the loop file; they act only where given as constraints: `[*robot.drives()]`."""
        return self._drives

    def joint_limits(self, *, margin: float = 1e-6) -> list[JointLimit]:
        """The limits of its joints, as `rbd.constraints.joint_limits`."""
        return joint_limits(self, margin=margin)

    def joint_frictions(self) -> list[JointFriction]:
        """The dry friction of its joints, as `rbd.constraints.joint_frictions`."""
        return joint_frictions(self)

    def joint_damping(self) -> JointDamping:
        """The viscous damping of its file as one force element: it acts where it is given, `external=robot.joint_damping()`.

        Raises:
            InputError: a damping of the file is negative or not finite; with the joint's name.
        """
        return file_damping(self)

    def joint_springs(self) -> list[JointSpring]:
        """The springs of an MJCF's joints as force elements, which act where they are given; none of a URDF.

        >>> everything = [*robot.joint_springs(), robot.joint_damping()]
        >>> solution = rbd.solve(state, tau, contacts, external=everything)
        """
        return file_springs(self.springs)

    def rotors(self) -> dict[str, Motor]:
        """The rotor inertias that its files state and that are in no term of M: {joint: `rbd.Motor` with gear and inertia}.

        Of <motorInertia> and <mechanicalReduction> in the transmissions of a URDF (or Drake's rotor_inertia and gear_ratio),
        then of <rotor_params> in its SRDF. `load_robot(..., rotors=True)` is `robot.with_motors(robot.rotors())`: n^2 I of a
        rotor I behind a gear n is then on the diagonal of M. Left out are joints without a motor, and differentials that drive
        several joints. What <dynamics armature> states is in M in any case, and replaced where both are given.

        Raises:
            ModelError: the files cannot be read, or have numbers that are none.

        Example:
            >>> talos = rbd.load_robot("talos")
            >>> knee = talos.rotors()["leg_left_4_joint"]
            >>> knee.gear, knee.rotor_inertia, knee.inertia  # the last at the joint [kg m2]
            (100.0, 1e-05, 0.1)
        """
        stated = rotors_of(self.element, self.urdf.name, self.source.srdf, self.limits, self.actuated_names)
        return {rotor.joint: rotor.motor for rotor in stated}

    def carrying(self, *things: Carried, at: Array | str | None = None) -> Robot:
        """The same robot with objects in its hands; this one stays as it is.

        The inertia of each object is added to the bodies that hold it, so M, gravity and all that follows from them have it:
        statics, simulation, checks and repairs of motions, controllers. With one hand the object is part of that body. With two
        hands each bears its share, as near to it as masses of the object's size can be. This is exact for the robot as a whole
        (momentum, balance, forces of the floor) while both keep their poses relative to each other. The wrench between them is
        then the one by which each moves its share: nothing squeezes the object, and where it is smaller than the way between
        the hands, wrists bear moments that one object would take off them. Nothing holds the hands together, either: see
        `rbd.check_motion` and `MotionReport.repaired`. The object is drawn; it touches neither the robot nor the floor.

        Args:
            things: The objects, of different names.
            at: The pose in which they are taken, q or the name of a posture: it gives the places that they leave open, of two
                hands how these are to each other. By default the standing one; `motion.carrying` takes a motion's first frame.

        Raises:
            FrameNotFound: a grasp that is no frame of the robot, with the nearest names.
            InputError: no objects; a robot that carries some; a grasp on the world, or two of an object on one body.

        Example:
            >>> g1 = rbd.load_robot("g1")
            >>> loaded = g1.carrying(rbd.Carried(3.0, ["left_wrist_yaw_link"]))
            >>> force = [rbd.hold(robot.standing(), robot.soles()).forces["left_sole"][2] for robot in (g1, loaded)]
            >>> print(f"{force[0]:.0f} -> {force[1]:.0f} N on the left sole")
            164 -> 194 N on the left sole
        """
        if not things or self.carried:
            raise InputError(
                f"{self.name} carries {'; '.join(map(str, self.carried)) or 'nothing'}, and {len(things)} objects are given; "
                "expected some, all in one call, of a robot with free hands."
            )
        for thing in things:
            check_kind("what is carried", thing, Carried, "rbd.Carried(mass, ['left_hand'])")
        check_different([thing.name for thing in things], "carried objects")
        out, state = copy.deepcopy(self), self._down() if at is None else self.at(at)
        out.carried = tuple(thing.held(state) for thing in things)
        for thing in out.carried:
            for joint, _, inertia in thing.parts(self):
                out.model.inertias[joint] += inertia
        return out

    def mimics(self) -> list[JointCoupling]:
        """The joint couplings of its URDF's <mimic> tags, as `rbd.constraints.mimics`."""
        return mimics(self)

    def _down(self) -> State:
        """The state in which feet are assumed to be down: standing, else its only posture, else that without postures."""
        known = self.source.posture or (next(iter(self.postures)) if len(self.postures) == 1 else None)
        if known is None:
            return self.at(self._plain())
        return self.standing(known) if self.source.feet else self.at(known)

    def _plain(self) -> Array:
        """The configuration of a robot without postures: neutral, within the limits of joints that turn or slide."""
        q = self.neutral()
        if not self._loops:
            at = [joint.q.start for joint in self.joints.values() if joint.nq == joint.nv == 1]
            low, high = self.joints.limits
            q[at] = np.clip(q[at], low[at], high[at])
        return q


def with_plain_things(robot: Robot, plain: object) -> Robot:
    """The robot that carries the objects of a list of `Carried.plain`; the same where there are none.

    Raises:
        InputError: what is no such data.
    """
    try:
        things = [Carried(**each) for each in plain or ()]  # type: ignore[attr-defined]
    except TypeError:
        raise InputError(f"carried objects in a file are {plain!r:.80}; expected the arguments of rbd.Carried.") from None
    return robot.carrying(*things) if things else robot


def _robot_again(model: bytes, version: str, source: catalogue.RobotSource, *rest: Any) -> Robot:
    """A robot of a file in another process."""
    root, passive, limits, closed, leave_out, postures, text, meshes, report, springs = rest
    out = Robot(unpacked(model, version), source, root, passive, limits, closed, leave_out, postures)
    out._text, out._mesh_names, out.report, out.springs = text, meshes, report, springs
    return out


def joined(passive: Iterable[str], more: tuple[str, ...]) -> Iterable[str]:
    """Names of passive joints, with more of them."""
    given = (passive,) if isinstance(passive, str) else passive
    try:
        return (*given, *more)
    except TypeError:
        return passive  # other types are refused where names are looked up
