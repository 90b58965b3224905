"""Faults of a robot's model, and the contents of its file that the dynamics ignore, by name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError, ModelError
from rbd.model.checked_model import CheckedModel
from rbd.model.files import RobotFile
from rbd.model.joints import AT_LIMIT
from rbd.model.mjcf import Mjcf
from rbd.model.state import State
from rbd.model.urdf import Complaints, grouped
from rbd.robots.rotors import rotors_of

SINGULAR = 1e-9
"""A joint's articulated inertia over its composite one (see `_weightless`); the real robots' are above 3e-4."""
NOTHING = 1e-14
"""The same over the largest entry of M's diagonal: smaller values are lost in rounding. The real robots': above 1e-8."""
TRIES, TRIES_STRANGE = 3, 50
"""Random configurations at which M is tried, for physical inertias and for unphysical ones."""
SHOWN = 3  # names in a line
CLOSED = 1e-6
"""A loop that is open by less counts as closed [m, rad]."""
ROUNDED = 1e-3
"""So does one that joint motions smaller than this close [rad, m]: files round the angles of their postures."""

_ENTRIES = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # of a symmetric matrix in (xx, xy, xz, yy, yz, zz)

REMEDY = "rbd.doctor(robot) lists everything."
SUMMARY = {
    "inertia": ("link has an inertia that no body has", "links have inertias that no body has"),
    "singular": ("joint has no inertia about it at q = 0", "joints have no inertia about them at q = 0"),
    "posture": ("posture is outside the joint limits", "postures are outside the joint limits"),
    "mesh": ("mesh is missing", "meshes are missing"),
    "effort": ("motor has no effort limit", "motors have no effort limit"),
    "friction": (
        "joint has damping or friction, which act where robot.joint_damping() or joint_frictions() are given",
        "joints have damping or friction, which act where robot.joint_damping() or joint_frictions() are given",
    ),
    "joint spring": (
        "joint has a spring, which acts where external=robot.joint_springs() is given",
        "joints have springs, which act where external=robot.joint_springs() is given",
    ),
    "spring": ("joint has a spring that is left out", "joints have springs that are left out"),
    "gravcomp": ("body has its weight, which the file takes off it", "bodies have their weight, which the file takes off them"),
    "tendon": ("tendon is left out", "tendons are left out"),
    "servo": ("actuator is taken as a plain motor", "actuators are taken as plain motors"),
    "one-sided": ("actuator has limits that differ by direction", "actuators have limits that differ by direction"),
    "limit": ("joint has a limit that is left out", "joints have limits that are left out"),
    "fluid": ("fluid is left out", "fluids are left out"),
    "armature": ("joint has a rotor inertia that is not in M", "joints have rotor inertias that are not in M"),
    "mimic": ("joint mimics another in the file, and is free here", "joints mimic others in the file, and are free here"),
    "planar": ("planar joint has an axis that is not its z", "planar joints have axes that are not their z"),
    "equality": ("equality constraint is left out", "equality constraints are left out"),
    "loop": ("loop is open in every posture", "loops are open in every posture"),
}
"""A count with singular or plural, for a sentence."""


@dataclass(frozen=True)
class ModelIssue(Displayed):
    """One issue that `rbd.doctor` found in a model, with the joint, link or file that has it.

    Attributes:
        kind: Kind of issue: "singular", "mass", "inertia", "posture", "mesh", "effort", "friction", ...
        where: Name of the link, the joint, the posture or the mesh.
        text: Message.

    Example:
        >>> report = rbd.doctor(rbd.load_robot("talos"))
        >>> print(report.warnings[0].kind, report.warnings[0].where)
        inertia rgbd_optical_frame
    """

    kind: str
    where: str
    text: str


@dataclass(frozen=True)
class ModelReport(Displayed):
    """What `rbd.doctor` found in a model: errors, warnings and notes, each with the name of its joint, link or file.

    Attributes:
        robot: Its name.
        errors: Issues that make answers wrong; `load_robot` refuses such a robot.
        warnings: What a user should know.
        notes: Loop closures, wheels and drives, for information.
        beside: Name of the other file of the robot, of `rbd.doctor(robot, beside=other)`; empty without one.
        differences: What the other file states otherwise.

    Example:
        >>> report = rbd.doctor(rbd.load_robot("talos"))
        >>> report.ok, len(report.warnings), sorted({issue.kind for issue in report.warnings})
        (True, 25, ['friction', 'inertia'])
    """

    robot: str
    errors: tuple[ModelIssue, ...]
    warnings: tuple[ModelIssue, ...]
    notes: tuple[ModelIssue, ...] = ()
    beside: str = ""
    differences: tuple[ModelIssue, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether there are no errors."""
        return not self.errors

    def __str__(self) -> str:
        """A table: a line a finding; one for all joints, links or meshes of which the same is said, with their names below."""
        found = [("ERROR", f) for f in self.errors] + [("warning", f) for f in self.warnings]
        head = f"{self.robot}: {len(self.errors)} errors, {len(self.warnings)} warnings"
        if self.beside:
            count = len(self.differences)
            head += f", {count} difference{'s' * (count != 1)} from {self.beside}"
        head += "" if found or self.differences else ". Nothing is wrong with it."
        found += [("differs", f) for f in self.differences] + [("note", f) for f in self.notes]
        if not found:
            return head
        lines: dict[tuple[str, str, str], list[str]] = {}
        for mark, f in found:
            lines.setdefault((mark, f.kind, f.text), []).append(f.where)
        titles = [names[0] if len(names) == 1 else f"these {len(names)}:" for names in lines.values()]
        kind, where = max(len(f.kind) for _, f in found), min(max(map(len, titles)), 40)
        out = [head]
        for (mark, each, text), title, names in zip(lines, titles, lines.values(), strict=True):
            out.append(f"  {mark:7}  {each:{kind}}  {title:{where}}  {text}")
            if len(names) > 1:
                indent = " " * (13 + kind)
                out += wrap(", ".join(names), 120, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
        return "\n".join(out)

    def summary(self) -> str:
        """Errors, and warnings counted by kind, in one line; empty if there are none."""
        kinds = grouped((finding.kind, finding.where) for finding in self.warnings)
        parts = [f"ERROR, {finding.text.rstrip('.')}" for finding in self.errors]
        parts += [f"{len(names)} {SUMMARY[kind][len(names) > 1]} ({_some(names)})" for kind, names in kinds.items()]
        return f"{self.robot}: {'; '.join(parts)}. {REMEDY}" if parts else ""


def examine(robot: CheckedModel, file: RobotFile, postures: Mapping[str, Array], package_dirs: Sequence[Path]) -> ModelReport:
    """The report on a model and its file, already read."""
    bodies = BodyFaults.of(file)
    errors = [*_bad_numbers(robot), *_lost(robot, bodies.names, file.content.mass)]
    weightless = [] if errors else list(_weightless(robot, tries=TRIES if bodies.physical else TRIES_STRANGE))
    errors += [issue for issue, everywhere in weightless if everywhere]
    warnings = [
        *(issue for issue, everywhere in weightless if not everywhere),
        *bodies.strange(),
        *_outside(robot, postures),
        *(ModelIssue("mesh", mesh, "is in none of the package folders") for mesh in file.missing_meshes(package_dirs)),
        *_unlimited(robot),
        *_friction(robot),
        *(ModelIssue(kind, where, text) for kind, where, text in file.remarks),
    ]
    notes = [] if errors else list(_loops(robot, postures))
    warnings += [f for f, closed in notes if not closed]
    told = *(f for f, closed in notes if closed), *_undriven(robot, file), *_semantic_rotors(robot)
    return with_rotors(ModelReport(robot.name, tuple(errors), tuple(warnings), told), robot)


def with_rotors(report: ModelReport, robot: CheckedModel) -> ModelReport:
    """The report with notes in place of warnings about rotor inertias that `with_motors` put into M."""
    inside = {name for name, motor in robot.motor_data.items() if motor is not None and motor.inertia is not None}
    about = [f for f in (*report.warnings, *report.notes) if f.kind == "armature" and f.where in inside]
    if not about:
        return report
    names = dict.fromkeys(f.where for f in about)
    given = {name: motor.inertia for name in names if (motor := robot.motor_data[name])}
    notes = [f for f in report.notes if f not in about]
    notes += [ModelIssue("armature", name, f"its rotor is in M, {given[name]:.4g} at the joint [kg m2, kg]") for name in names]
    return replace(report, warnings=tuple(f for f in report.warnings if f not in about), notes=tuple(notes))


def _undriven(robot: CheckedModel, file: RobotFile) -> Iterator[ModelIssue]:
    """Joints of an MJCF without an actuator."""
    told = "the file has no actuator at it: it is passive, and has no entry in tau"
    return (ModelIssue("passive", name, told) for name in file.content.undriven if name in robot.passive)


def _semantic_rotors(robot: Any) -> Iterator[ModelIssue]:
    """Rotor inertias of an SRDF, which M leaves out unless they are asked for."""
    source = getattr(robot, "source", None)
    if source is None:
        return
    try:
        found = rotors_of(None, source.urdf.name, source.srdf, robot.limits, robot.actuated_names)
    except ModelError as error:
        yield ModelIssue("armature", source.srdf.name, f"its rotor_params are not read: {error}")
        return
    for rotor in found:
        text = f"{rotor.file} states a rotor of {rotor.inertia:g} kg m2 and a gear of {rotor.gear:g}, which are not in M"
        yield ModelIssue("armature", rotor.joint, f"{text}; load_robot(..., rotors=True) adds {rotor.motor.inertia:.4g}")


def refuse(report: ModelReport, file: str) -> None:
    """Raise if there are errors: the first by name, the others counted.

    Raises:
        ModelError: naming the joint or the link.
    """
    Complaints(file, [issue.text for issue in report.errors]).refuse()


def _bad_numbers(robot: CheckedModel) -> Iterator[ModelIssue]:
    model = robot.model
    for name, inertia, placement in zip(model.names, model.inertias, model.jointPlacements, strict=True):
        if not np.isfinite(inertia.toDynamicParameters()).all() or not np.isfinite(placement.homogeneous).all():
            yield ModelIssue("number", name, f"the bodies at joint {name!r} have a mass, inertia or origin that is not finite.")
        elif inertia.mass < 0.0:
            yield ModelIssue("mass", name, f"the bodies at joint {name!r} weigh {inertia.mass:g} kg.")
    swapped = np.flatnonzero(~(model.lowerPositionLimit <= model.upperPositionLimit))
    for name in dict.fromkeys(robot.joints.positions[i].joint for i in swapped):
        yield ModelIssue("limit", name, f"joint {name!r} has its limits swapped, or not finite.")
    names = list(model.names)
    for name in {name for name in names if names.count(name) > 1}:
        yield ModelIssue("name", name, f"two joints are called {name!r}; expected different names.")


def _lost(robot: CheckedModel, bodies: list[str], mass: float) -> Iterator[ModelIssue]:
    """Bodies and mass that are in the file and not in the model."""
    frames = set(robot.frames())
    for name in bodies:
        if name not in frames:
            yield ModelIssue("body", name, f"body {name!r} of the file is not in the model that Pinocchio made of it.")
    lost, rounding = mass - robot.mass, 1e-9 * max(1.0, mass)
    if abs(lost) > rounding:
        yield ModelIssue(
            "mass",
            robot.name,
            f"the moving links of the file weigh {mass:.9g} kg, and the model {robot.mass:.9g} kg: mass was lost between them.",
        )


def _weightless(robot: CheckedModel, *, tries: int) -> Iterator[tuple[ModelIssue, bool]]:
    """A joint whose outboard bodies leave M singular at neutral or at random configurations, or indefinite; whether at all.

    One that is singular at neutral alone, as a pan-tilt joint that looks along the axis of the pan, is a fault of that pose.

    M = U D U^T, eliminated from the tips inward, has as D the articulated inertias: what a joint's motor feels when all
    joints beyond it are free. It must be positive, and not negligible against the composite inertia M_ii, felt when they are
    locked. Where every body has an inertia that a body can have, M is nowhere indefinite, and if regular at one
    configuration then nearly everywhere; else more configurations are tried.
    """
    model = robot.model
    draws = np.random.default_rng(0).uniform(-3.0, 3.0, (tries, model.nv))
    outermost, indefinite, singular = -1, False, []
    data, neutral = model.createData(), pin.neutral(model)
    for v in (np.zeros(model.nv), *draws):
        M = pin.crba(model, data, pin.integrate(model, neutral, v), pin.Convention.WORLD)
        pin.cholesky.decompose(model, data)
        composite, articulated = np.diagonal(M), np.ravel(data.D)
        sound = (articulated > SINGULAR * composite) & (articulated > NOTHING * composite.max())
        singular.append(not sound.all())
        if singular[-1]:  # the outermost counts: inward of it, D is not meaningful
            last = int(np.flatnonzero(~sound)[-1])
            if last > outermost:
                outermost, indefinite = last, bool(articulated[last] < -SINGULAR * np.abs(composite).max())
    if outermost < 0:
        return
    joint = robot.joints.at_v(outermost)
    name, below = joint.name, set(model.subtrees[joint.id])
    links = [f.name for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint in below]
    bodies = f"the bodies beyond joint {name!r} ({_some(links)}) have"
    if not indefinite and not any(singular[1:]):
        text = f"{bodies} no inertia about it at q = 0: M is singular there, and not elsewhere"
        yield ModelIssue("singular", name, text), False
        return
    what = "an indefinite inertia: M has a negative eigenvalue" if indefinite else "no inertia about it: M is singular"
    yield ModelIssue("singular", name, f"{bodies} {what}. Give them mass and inertia, or weld it."), True


@dataclass(frozen=True, eq=False)
class BodyFaults:
    """Links of a URDF, or bodies of an MJCF, and their principal moments of inertia, ascending [kg m2]."""

    what: str
    names: list[str]
    masses: Array
    moments: Array

    @classmethod
    def of(cls, file: RobotFile) -> BodyFaults:
        """The bodies of a file."""
        if isinstance(file.content, Mjcf):
            model = file.content.model
            return cls("body", list(file.content.bodies[1:]), model.body_mass[1:], np.sort(model.body_inertia[1:], axis=1))
        links = list(file.content.links.values())
        moments = np.linalg.eigvalsh(np.array([link.inertia for link in links])[:, _ENTRIES].reshape(-1, 3, 3))
        return cls("link", [link.name for link in links], np.array([link.mass for link in links]), moments)

    @property
    def broken(self) -> Array:
        """Which have a negative moment of inertia, or one larger than the sum of the others: shape (k,)."""
        small, middle, large = self.moments.T
        rounding = 1e-9 * np.abs(self.moments).max(axis=1)
        return (small < -rounding) | (small + middle < large - rounding)

    @property
    def physical(self) -> bool:
        """Whether all are physical, points allowed: then M has no negative eigenvalue."""
        return not self.broken.any()

    def strange(self) -> Iterator[ModelIssue]:
        """Unphysical ones: broken ones, those of a point or a line, and inertia without mass."""
        small, _, large = self.moments.T
        broken, thin, massless = self.broken, (self.masses > 0.0) & (small <= 0.0), (self.masses == 0.0) & (large > 0.0)
        for i in np.flatnonzero(broken | thin | massless):
            a, b, c = self.moments[i]
            if broken[i]:
                text = f"principal moments of inertia {a:.3g}, {b:.3g}, {c:.3g} kg m2"
                text += ": one is negative" if a < 0.0 else ": the largest is more than the sum of the others"
            elif thin[i]:
                text = f"{self.masses[i]:.3g} kg without extension: principal moments {a:.3g}, {b:.3g}, {c:.3g} kg m2"
            else:
                text = f"an inertia of up to {c:.3g} kg m2, but no mass"
            yield ModelIssue("inertia", self.names[i], f"{self.what} {self.names[i]!r} has {text}; no body has")


def _outside(robot: CheckedModel, postures: Mapping[str, Array]) -> Iterator[ModelIssue]:
    if not postures:
        return
    q = np.array(list(postures.values()))
    over = np.maximum(robot.model.lowerPositionLimit - q, q - robot.model.upperPositionLimit)
    for k, name in enumerate(postures):
        if (over[k] > AT_LIMIT).any():
            joints = dict.fromkeys(robot.joints.positions[i].joint for i in np.flatnonzero(over[k] > AT_LIMIT))
            yield ModelIssue("posture", name, f"{_some(joints)} outside the limits, by up to {over[k].max():.3g}")


def _unlimited(robot: CheckedModel) -> Iterator[ModelIssue]:
    names = dict.fromkeys(np.array(robot.actuated_names)[~np.isfinite(robot.effort_limit)].tolist())
    return (ModelIssue("effort", x, "the file states no effort limit; torques are not checked against one") for x in names)


def _friction(robot: CheckedModel) -> Iterator[ModelIssue]:
    damping, friction = np.array(robot.model.damping), np.array(robot.model.upperDryFrictionLimit)
    for i in np.flatnonzero((damping != 0.0) | (np.isfinite(friction) & (friction != 0.0))):
        name = robot.joints.velocities[i].joint
        text = f"damping {damping[i]:.3g} and dry friction {friction[i]:.3g} act only where they are given: "
        yield ModelIssue("friction", name, text + "external=robot.joint_damping(), and robot.joint_frictions() as constraints")


def _loops(robot: CheckedModel, postures: Mapping[str, Array]) -> Iterator[tuple[ModelIssue, bool]]:
    """Each loop and wheel, with the postures at which it is closed, if any."""
    given = {**{repr(name): q for name, q in postures.items()}, "the neutral posture": pin.neutral(robot.model)}
    states = [(where, State(robot, q)) for where, q in given.items()] if robot.loops() else []
    for loop in robot.loops():
        found = [(where, *gap) for where, state in states if (gap := _gap(loop, state)) is not None]
        shut = [(where, gap) for where, gap, way in found if gap <= CLOSED or way <= ROUNDED]
        closed = [where + (f" (to {gap:.1g})" if gap > CLOSED else "") for where, gap in shut]
        text, fine = f"{type(loop).__name__}: ", bool(closed) or not found
        if closed:
            text += f"closed in {', '.join(closed[:SHOWN])}" + (", ..." if len(closed) > SHOWN else "")
        elif not found:
            text += "has no place at which it is closed: it is not defined in these postures"
        else:
            where, least, _ = min(found, key=lambda each: each[1])
            text += f"open in every posture, by {least:.3g} in {where} at least; rbd.mechanism.assemble closes it"
        yield ModelIssue("loop", loop.name, text), fine
    for wheel in robot.wheels():
        yield ModelIssue("wheel", wheel.name, f"{type(wheel).__name__} on the ground, at {wheel.frame!r:.80}"), True
    for drive in robot.drives():
        yield ModelIssue("drive", drive.name, f"joint {drive.joint!r:.80} follows a motion of time where it is given"), True


def _gap(loop: Any, state: State) -> tuple[float, float] | None:
    """(loop-closure error [m, rad], least motion of its joints that closes it [rad, m]).

    None where that has no answer, as for a hinge whose axes are opposite. The second is to first order, infinite where no
    motion of the joints closes it.
    """
    try:
        rows = loop.rows(state)
    except InputError:
        return None
    assert rows.error is not None  # for closures, couplings and locks
    if not len(rows):  # a rope that is slack
        return 0.0, 0.0
    gap, way = float(np.abs(rows.error).max()), np.linalg.lstsq(rows.J, -rows.error, rcond=1e-9)[0]
    reached = np.abs(rows.J @ way + rows.error).max() <= max(1e-2 * gap, CLOSED)
    return gap, float(np.abs(way).max(initial=0.0)) if reached else np.inf


def _some(names: Iterable[str]) -> str:
    """The first few names, quoted."""
    known = list(names)
    return ", ".join(f"{name!r:.80}" for name in known[:SHOWN]) + (", ..." if len(known) > SHOWN else "")
