"""MJCF files, read by MuJoCo: its compiled model, what of it is refused here, and what is left out.

MuJoCo resolves classes, frames, units, meshes and masses. Refused by name is what cannot be part of
M a + h = S^T tau + J^T lam, unless `leave_out` names it: springs sized by the inertia, gravity compensation, tendons with
inertia or springs, actuators that are no torque at one joint.
"""

from __future__ import annotations

import math
import re
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.errors import ModelError
from rbd.errors.inputs import check_choice, listed_items
from rbd.model.input_files import MISSING, OUTSIDE, FileLimits, find_mesh, is_inside, mesh_bytes
from rbd.model.mjcf.loops_and_motors import (
    BALL,
    FREE,
    WORLD,
    Equality,
    Remark,
    check_actuators,
    equalities,
    is_off,
    read_motors,
)
from rbd.model.motors import Motor
from rbd.model.urdf import FARTHEST, LARGEST, LIGHTEST, LONGEST_NAME, Complaints

Element = ElementTree.Element
LEAVABLE = ("actuators", "springs", "gravcomp", "tendons")
"""What `load_robot(..., leave_out=...)` may name."""
MESHES = (".stl", ".obj", ".msh")
_HFIELD, _BOX = 1, 6  # of shapes
_ELSEWHERE = "Copy it there, or give the folder above both: load_robot(..., package_dirs=[folder])"
_WRITERS = ("replicate", "composite")
_NO_NUMBER = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
_PLACES = ("body_pos", "body_ipos", "jnt_pos", "site_pos", "geom_pos")
_NUMBERS = (
    "body_quat", "body_iquat", "body_mass", "body_inertia", "body_gravcomp", "jnt_axis", "jnt_range", "jnt_stiffness", "qpos0",
    "qpos_spring", "dof_armature", "dof_damping", "dof_frictionloss", "actuator_gear", "actuator_armature",
    "actuator_ctrlrange", "actuator_forcerange", "key_qpos", "eq_data", "geom_size",
)  # fmt: skip
_NAMED = ("body", "jnt", "site", "geom", "actuator", "key", "eq")


class Grid(NamedTuple):
    """A grid of heights.

    Attributes:
        name: Of its shape.
        body: Of its body.
        place: Of its middle, shape (3,) [m].
        turn: Its quaternion, w first, shape (4,).
        size: Half lengths along x and y, and the height of its highest point [m].
        z: Between 0 and 1, shape (along x, along y); empty where the heights are in a file.
    """

    name: str
    body: str
    place: Array
    turn: Array
    size: Array
    z: Array


@dataclass(frozen=True, eq=False)
class Mjcf:
    """An MJCF file that MuJoCo took, and that can be expressed here.

    Attributes:
        name: Of the model.
        model: `mujoco.MjModel`: bodies, joints and shapes with their numbers; the world is body 0.
        bodies: Names of the bodies.
        joints: Names of the joints, in the order of q.
        motors: {index of the joint: its motor}, in the order of the file; None where the actuators are left out.
        keys: {name: qpos in MuJoCo's order, shape (nq,)}.
        equalities: Those that are read.
        remarks: (kind, where, text) of ignored contents.
        meshes: {file as it is named: where it is, relative to the folder of the robot's file}.
        stand_ins: Indices of the shapes that are boxes in place of meshes, where shapes were asked for.
        refused: {file or mesh: why it cannot be read}.
        grids: Grids of heights.
    """

    name: str
    model: Any
    bodies: tuple[str, ...]
    joints: tuple[str, ...]
    motors: Mapping[int, Motor] | None
    keys: Mapping[str, Array]
    equalities: tuple[Equality, ...]
    remarks: tuple[Remark, ...]
    meshes: Mapping[str, str]
    stand_ins: frozenset[int]
    refused: Mapping[str, str]
    grids: tuple[Grid, ...] = ()

    @property
    def mass(self) -> float:
        """Of the bodies that hang from a joint [kg]."""
        moves = self.model.body_jntnum > 0
        for i, parent in enumerate(self.model.body_parentid):  # parents come first
            moves[i] |= moves[parent]
        return float(self.model.body_mass[moves].sum())

    @property
    def undriven(self) -> tuple[str, ...]:
        """Joints without a motor; a floating base has none anyway."""
        if self.motors is None:
            return ()
        return tuple(name for j, name in enumerate(self.joints) if j not in self.motors and self.model.jnt_type[j] != FREE)

    @property
    def springs(self) -> dict[str, tuple[float, float]]:
        """{joint: (stiffness [N m/rad, N/m], coordinate at rest [rad, m])}; the latter 0 of a ball joint: its drawn pose."""
        m = self.model
        rest = np.where(np.isin(m.jnt_type, (FREE, BALL)), 0.0, m.qpos_spring[m.jnt_qposadr])
        own = zip(self.joints, m.jnt_stiffness.tolist(), rest.tolist(), strict=True)
        return {name: (k, at) for name, k, at in own if k != 0.0 and not is_off(m, "SPRING")}


def read_mjcf(
    path: Path,
    root: Element,
    limits: FileLimits,
    folders: tuple[Path, ...] = (),
    leave_out: Collection[str] = (),
    *,
    stand_in_m: float | None = None,
    text: str | None = None,
) -> Mjcf:
    """An MJCF file.

    Args:
        path: Where it is; of a text in memory a name.
        root: Its first element, <mujoco>, includes carried out.
        limits: How large it may become.
        folders: Folders of meshes, besides the file's folder.
        leave_out: Of `LEAVABLE`.
        stand_in_m: Side of the boxes in place of meshes that cannot be read [m]; None: shapes are not asked for, and meshes
            that do not weigh are not read.
        text: Of the file, where it includes none: MuJoCo's messages then have its lines.

    Raises:
        ModelError: MuJoCo is not installed or refuses the file, in its words; or what cannot be expressed, by name.
    """
    wrong = Complaints(path.name)
    try:
        import mujoco
    except ImportError:
        wrong.stop(
            "MJCF files are read by MuJoCo, which is not installed. Install the extra that has it, "
            "pip install 'rbd-contact[mujoco]', or give a URDF."
        )
    _check_text(wrong, root, limits, path, folders)
    with _quiet(mujoco):
        spec = _parsed(wrong, mujoco, path, root, text)
        remarks = list(_springs(wrong, spec, leave_out))
        _check_settings(wrong, spec)
        _check_ranges(wrong, spec)
        check_actuators(wrong, mujoco, spec, leave_out)
        loader = _Loader(wrong, spec, path.parent, folders, stand_in_m)
        named, meshes = {mesh.name: mesh.file for mesh in spec.meshes}, loader.files()
        model, stand_ins = loader.compiled(lines=text is not None)
    _check_numbers(wrong, model)
    bodies = _names(wrong, mujoco, model, "BODY", model.nbody)
    joints = _names(wrong, mujoco, model, "JOINT", model.njnt, bodies)
    keys = _keys(wrong, spec, model, joints)
    equal, lost = equalities(wrong, mujoco, model)
    refused = {named.get(mesh) or mesh: why for mesh, why in loader.refused.items()}
    name = root.get("model") or "MuJoCo Model"
    found = Mjcf(name, model, bodies, joints, None, keys, equal, (), meshes, stand_ins, refused, loader.grids)
    remarks += _ignored(wrong, found, leave_out)
    if "actuators" not in leave_out:
        motors, told = read_motors(wrong, model, joints)
        found = replace(found, motors=motors)
        remarks += told
    return replace(found, remarks=(*remarks, *lost))


def of_compiled(model: Any, name: str) -> Mjcf:
    """A model that MuJoCo has compiled, without what files have besides: motors, keyframes, equalities, remarks.

    Raises:
        ModelError: numbers or names that cannot be expressed.
    """
    import mujoco

    wrong = Complaints(name)
    _check_numbers(wrong, model)
    bodies = _names(wrong, mujoco, model, "BODY", model.nbody)
    joints = _names(wrong, mujoco, model, "JOINT", model.njnt, bodies)
    return Mjcf(name, model, bodies, joints, None, {}, (), (), {}, frozenset(), {})


@contextmanager
def _quiet(mujoco: Any) -> Iterator[None]:
    """MuJoCo's warnings are about old words of MJCF, and go to the terminal and into a file of the folder one is in."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    finally:
        mujoco.set_mju_user_warning(before)


def _parsed(wrong: Complaints, mujoco: Any, path: Path, root: Element, text: str | None) -> Any:
    try:
        if root.find("asset/model") is not None and path.is_file():
            return mujoco.MjSpec.from_file(str(path))  # it finds the attached models while it reads
        return mujoco.MjSpec.from_string(text or ElementTree.tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError) as error:
        wrong.stop(_in_its_words(str(error), lines=text is not None))


def check_leave_out(leave_out: Collection[str]) -> None:
    """Refuse parts of an MJCF that cannot be left out.

    Raises:
        InputError: naming the first of them, with those that can.
    """
    for each in listed_items("leave_out", leave_out, f"a list of some of {', '.join(map(repr, LEAVABLE))}"):
        check_choice("what leave_out has", each, LEAVABLE)


# --------------------------------------------------------------------------------------------------------- before MuJoCo reads


def _check_text(wrong: Complaints, root: Element, limits: FileLimits, path: Path, folders: tuple[Path, ...]) -> None:
    """What MuJoCo would do at length, with a warning on the terminal, or outside the folders."""
    if _size(root) > limits.max_elements:
        tag = next(tag for tag in _WRITERS if root.find(f".//{tag}") is not None)
        wrong.stop(f"its <{tag}> writes more than {limits.max_elements} elements.")
    for element in root.iter():
        for key, text in element.attrib.items():
            if any(_NO_NUMBER.fullmatch(word) for word in text.split()) and "name" not in key:
                name = f" {element.get('name')!r:.80}" if element.get("name") else ""
                wrong.stop(f"<{element.tag:.40}>{name}: {key:.40} is {text!r:.80}; expected numbers.")
    for element in root.iterfind("asset/model"):
        name = element.get("file", "")
        _contained(wrong, "model", name, name, path.parent, folders)


def _size(element: Element) -> float:
    """How many elements it amounts to."""
    words = re.findall(r"\d+", element.get("count", "")) if element.tag in _WRITERS else []
    return math.prod(float(word) for word in words) * (1.0 + sum(_size(child) for child in element))


def _contained(wrong: Complaints, tag: str, name: str, place: str, folder: Path, folders: tuple[Path, ...]) -> None:
    """Refuse a file outside the folders, opened or not."""
    if not is_inside(folder / place, [each.resolve() for each in (folder, *folders)]):
        wrong.stop(f"<{tag}> names the file {name!r:.200}, outside the folder of {wrong.file}. {_ELSEWHERE}.")


def _in_its_words(text: str, *, lines: bool) -> str:
    """MuJoCo's message; without its lines where they are those of another text."""
    return f"MuJoCo refuses it: {_words(text, lines=lines):.400}"


def _words(text: str, *, lines: bool) -> str:
    words = re.sub(r"\s*Element (?:name )?'(.*?)'(?:, id -?[0-9]+)?(, line -?[0-9]+)?", r" ('\1'\2)", " ".join(text.split()))
    words = words.removeprefix("XML ").replace("Error: ", "")
    return words if lines else re.sub(r", line -?[0-9]+", "", words)


# ---------------------------------------------------------------------------------------------------- before MuJoCo compiles it


def _check_settings(wrong: Complaints, spec: Any) -> None:
    if spec.flexes:
        wrong.stop("<flex> is not read: bodies that bend are not rigid bodies.")
    if spec.plugins or spec.hasImplicitPluginElem:
        wrong.stop("<plugin> is not read: what a plugin does is not known.")
    compiler = spec.compiler
    anew = compiler.inertiafromgeom == 1
    if compiler.fusestatic and (anew or compiler.settotalmass > 0.0):
        other = "inertiafromgeom='true'" if anew else "settotalmass"
        wrong.stop(f"<compiler>: fusestatic with {other} weighs other bodies than it draws; not read. Take one out.")
    if compiler.discardvisual and anew:
        wrong.stop("<compiler>: discardvisual with inertiafromgeom='true' may discard what weighs. Take one out.")
    compiler.fusestatic = compiler.discardvisual = False  # bodies and shapes keep their names
    if spec.option.disableactuator:
        wrong.stop("<option>: actuatorgroupdisable switches motors off, and is not read. Take it out.")


def _check_ranges(wrong: Complaints, spec: Any) -> None:
    """Ranges from a larger to a smaller number, which MuJoCo takes for none where `autolimits` is on."""
    pairs = [("joint", each, key) for each in spec.joints for key in ("range", "actfrcrange")]
    pairs += [("actuator", each, key) for each in spec.actuators for key in ("ctrlrange", "forcerange")]
    for what, each, key in pairs:
        low, high = getattr(each, key)
        if low > high:
            wrong.stop(f"{what} {each.name!r:.80} has its limits swapped: its {key} is {low:g} to {high:g}.")


def _springs(wrong: Complaints, spec: Any, leave_out: Collection[str]) -> Iterator[Remark]:
    """Springs that MuJoCo sizes by the inertia, which its compiled model does not tell from others; they are taken out."""
    for joint in [each for each in spec.joints if np.any(each.springdamper)]:
        told = "a springdamper: MuJoCo finds its stiffness and damping from the inertia, and they are in no term here"
        _must_be_named(wrong, leave_out, "springs", f"joint {joint.name!r:.80} has {told}")
        joint.springdamper = np.zeros(2)
        yield "spring", joint.name, told


def _must_be_named(wrong: Complaints, leave_out: Collection[str], part: str, told: str) -> None:
    """Refuse what has no term in the dynamics, unless `leave_out` names it."""
    if part not in leave_out:
        wrong.stop(f"{told}. If that is meant: load_robot(..., leave_out=['{part}']).")


def _grid(geom: Any, field: Any) -> Grid:
    z = np.array([] if field.file else field.userdata, float)
    z = z.reshape(field.nrow, field.ncol).T if len(z) else np.zeros((0, 0))
    z = (z - z.min(initial=np.inf)) / max(float(np.ptp(z)) if z.size else 0.0, 1e-300)
    name = geom.name or field.name
    place, turn, size = (np.array(x, float) for x in (geom.pos, geom.quat, field.size[:3]))
    return Grid(name, geom.parent.name, place, turn, size, z)


class _Loader:
    """Brings the meshes that are needed, and leaves out all files that are not."""

    def __init__(self, wrong: Complaints, spec: Any, folder: Path, folders: tuple[Path, ...], stand_in_m: float | None) -> None:
        self.wrong, self.spec, self.folder, self.folders, self.stand_in_m = wrong, spec, folder, folders, stand_in_m
        self.refused: dict[str, str] = {}
        self.named: dict[str, str] = {}
        fields = {field.name: field for field in spec.hfields}
        shapes = [geom for geom in spec.geoms if geom.type == _HFIELD and geom.hfieldname in fields]
        self.grids = tuple([_grid(geom, fields[geom.hfieldname]) for geom in shapes])
        rule, (low, high) = spec.compiler.inertiafromgeom, spec.compiler.inertiagrouprange
        self.weighing: dict[str, str] = {}
        for geom in spec.geoms:
            body = geom.parent
            by_shape = rule == 1 or (rule == 2 and not body.explicitinertial)
            heavy = geom.density != 0.0 if math.isnan(geom.mass) else geom.mass != 0.0
            if geom.meshname and by_shape and low <= geom.group <= high and heavy and body.name != WORLD:
                self.weighing.setdefault(geom.meshname, body.name)

    def files(self) -> dict[str, str]:
        """{file as it is named: where it is, relative to the folder of the robot's file}.

        Raises:
            ModelError: a file outside the folders, opened or not.
        """
        found = {}
        for mesh in self.spec.meshes:
            if mesh.file:
                found[mesh.file] = place = self._place(mesh)
                if self.stand_in_m is None:
                    _contained(self.wrong, "mesh", mesh.file, place, self.folder, self.folders)
        return found

    def _place(self, mesh: Any) -> str:
        name = mesh.file.replace("\\", "/")
        name = PurePosixPath(name).name if self.spec.strippath else name
        return str(PurePosixPath(mesh.compiler.meshdir or self.spec.meshdir) / name)

    def compiled(self, *, lines: bool) -> tuple[Any, frozenset[int]]:
        """(MuJoCo's model, indices of the shapes that are boxes in place of meshes)."""
        spec = self.spec
        for each in (*spec.sensors, *spec.pairs, *spec.tuples, *spec.skins, *(g for g in spec.geoms if g.type == _HFIELD)):
            spec.delete(each)
        for each in (*spec.hfields, *spec.textures):
            spec.delete(each)
        for material in spec.materials:
            material.textures = [""] * len(list(material.textures))
        for i, mesh in enumerate(list(spec.meshes)):
            if self.stand_in_m is None and mesh.name not in self.weighing:
                self._drop(mesh)
            elif mesh.file:
                self._bring(i, mesh)
        boxes = [box for mesh in [m for m in spec.meshes if m.name in self.refused] for box in self._drop(mesh)]
        model, why = _compiled(spec)
        if why and not self._why_not(""):  # without any mesh it can be compiled
            boxes += [box for mesh in [m for m in spec.meshes if self._is_broken(m)] for box in self._drop(mesh)]
            model, why = _compiled(spec)
        if why:
            self.wrong.stop(_in_its_words(why, lines=lines))
        return model, frozenset(int(geom.id) for geom in boxes)

    def _bring(self, i: int, mesh: Any) -> None:
        """A mesh's file in memory, under a name of its own."""
        try:
            kind, data = mesh_bytes(find_mesh(self._place(mesh), self.folder, (self.folder, *self.folders)), MESHES)
            if kind == ".obj" and mesh.name in self.weighing and int(mesh.inertia) and (n := _widest(data)) > 4:
                raise ModelError(
                    f"has a face of {n} corners; MuJoCo's triangles of such a face may leave gaps, so that its mass would be "
                    "another one. Export it with triangles"
                )
        except ModelError as error:
            self._refuse(mesh, str(error))
            return
        self.named[f"mesh{i}{kind}"] = mesh.file
        mesh.file = f"mesh{i}{kind}"
        self.spec.assets[mesh.file] = data

    def _refuse(self, mesh: Any, reason: str) -> None:
        if mesh.name in self.weighing:
            body = self.weighing[mesh.name]
            told = f"names the file {mesh.file!r:.200}, which {reason}" if reason in (MISSING, OUTSIDE) else reason
            self.wrong.stop(
                f"mesh {mesh.name!r:.80} {told}. Body {body!r:.80} needs it for its mass; or give that body an <inertial>."
            )
        self.refused[mesh.name] = reason

    def _is_broken(self, mesh: Any) -> bool:
        """Whether MuJoCo refuses a mesh; its reason is kept."""
        why = _words(self._why_not(mesh.name), lines=False)
        for place, name in self.named.items():
            why = why.replace(place, name)
        if why:
            self._refuse(mesh, f"cannot be read: {why:.200}")
        return bool(why)

    def _why_not(self, name: str) -> str:
        """Why MuJoCo refuses the file with boxes in place of all meshes but one; empty where it takes it."""
        alone = self.spec.copy()
        for geom in alone.geoms:
            if geom.meshname and geom.meshname != name:
                geom.meshname, geom.type, geom.size = "", _BOX, np.ones(3)
        for other in [each for each in alone.meshes if each.name != name]:
            alone.delete(other)
        return _compiled(alone)[1]

    def _drop(self, mesh: Any) -> list[Any]:
        """Take a mesh out; small boxes stand for it where shapes are asked for: these."""
        used = [geom for geom in self.spec.geoms if geom.meshname == mesh.name]
        for geom in used:
            if self.stand_in_m is None:
                self.spec.delete(geom)
            else:
                geom.meshname, geom.type, geom.size = "", _BOX, np.full(3, 0.5 * self.stand_in_m)
        self.spec.delete(mesh)
        return [] if self.stand_in_m is None else used


def _compiled(spec: Any) -> tuple[Any, str]:
    """(MuJoCo's model, why there is none)."""
    try:
        return spec.compile(), ""
    except (ValueError, RuntimeError) as error:
        return None, str(error)


def _widest(data: bytes) -> int:
    """Corners of the widest face of an OBJ file."""
    return max((len(line.split()) - 1 for line in data.splitlines() if line.lstrip()[:2] in (b"f ", b"f\t")), default=0)


# -------------------------------------------------------------------------------------------------- what MuJoCo has compiled


def _check_numbers(wrong: Complaints, model: Any) -> None:
    for names, most in ((_PLACES, FARTHEST), (_NUMBERS, LARGEST)):
        for key in names:
            values = np.asarray(getattr(model, key))
            for i in np.argwhere(~(np.abs(values) <= most))[:1]:
                kind = key.partition("_")[0]
                of = f" of {kind} {getattr(model, kind)(i[0]).name!r:.80}" if kind in _NAMED else ""
                wrong.stop(f"{key}{of} has the number {values[tuple(i)]:g}; expected numbers up to {most:g}.")
    for i in np.flatnonzero((model.body_mass > 0.0) & (model.body_mass < LIGHTEST)):
        name, mass = model.body(i).name, model.body_mass[i]
        wrong.stop(f"body {name!r:.80} has a mass of {mass:g} kg; expected zero, or at least {LIGHTEST:g} kg.")


def _names(wrong: Complaints, mujoco: Any, model: Any, kind: str, n: int, bodies: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Names of bodies or joints; those that have none get one."""
    number = getattr(mujoco.mjtObj, f"mjOBJ_{kind}")
    given = [mujoco.mj_id2name(model, number, i) or "" for i in range(n)]
    out, what = list(given), kind.lower()
    for i, name in enumerate(given):
        if len(name) > LONGEST_NAME:
            wrong.stop(f"{what} {name[:40]!r}... has a name of {len(name)} letters; expected {LONGEST_NAME} at most.")
        if name == "universe" or name == WORLD and i:
            wrong.stop(f"{what} {name!r} has the name of the world. Rename it.")
        if not name and not bodies:
            out[i] = next(made for k in range(n + 1) if (made := f"body_{i}{'_' * k}") not in given)
        elif not name:
            body = int(model.jnt_bodyid[i])
            number_on = "_free" if model.jnt_type[i] == FREE else f"Joint_{i - int(model.body_jntadr[body])}"
            out[i] = f"{bodies[body]}{number_on}"
            if out[i] in given:
                wrong.stop(f"two joints are called {out[i]!r:.80}, one of them by its body; name them.")
    return tuple(out)


def _keys(wrong: Complaints, spec: Any, model: Any, joints: tuple[str, ...]) -> dict[str, Array]:
    """{name: qpos} of the keyframes that give a posture."""
    found = {key.name or f"key_{i}": np.array(list(key.qpos)) for i, key in enumerate(spec.keys) if len(key.qpos)}
    for name, q in found.items():
        for joint, kind, at in zip(joints, model.jnt_type, model.jnt_qposadr, strict=True):
            at += 3 if kind == FREE else 0
            if kind in (FREE, BALL) and not np.linalg.norm(q[at : at + 4]) > 1e-10:
                wrong.stop(f"<key> {name!r:.80} has a zero quaternion for joint {joint!r:.80}.")
    return found


def _ignored(wrong: Complaints, file: Mjcf, leave_out: Collection[str]) -> Iterator[Remark]:
    """Remarks about what is in no term of the dynamics; refused where it must be named to be left out."""
    model = file.model
    for name, share in zip(file.bodies, model.body_gravcomp, strict=True):
        if share != 0.0:
            told = f"gravcomp {share:g}: its weight is taken off it in the file, and is in full in the dynamics here"
            _must_be_named(wrong, leave_out, "gravcomp", f"body {name!r:.80} has {told}")
            yield "gravcomp", name, told
    for i, (name, kind) in enumerate(zip(file.joints, model.jnt_type, strict=True)):
        stiffness, bent = float(model.jnt_stiffness[i]), model.jnt_stiffnesspoly[i].any() or model.jnt_springyield[i].any()
        if (stiffness != 0.0 or bent) and not is_off(model, "SPRING"):
            told = f"a spring (stiffness {stiffness:g})"
            if kind == FREE or bent:
                told += ", which is in no term of the dynamics" if not bent else ", which is no linear one"
                _must_be_named(wrong, leave_out, "springs", f"joint {name!r:.80} has {told}")
                yield "spring", name, told
            elif "springs" in leave_out:
                yield "spring", name, f"{told}, which is left out"
            else:
                yield "joint spring", name, f"{told}, which acts where external=robot.joint_springs() is given"
        if kind == BALL and model.jnt_limited[i]:
            yield "limit", name, "is a ball joint with a limit, which is left out"
        if model.dof_dampingpoly[model.jnt_dofadr[i]].any() and not is_off(model, "DAMPER"):
            wrong.stop(f"joint {name!r:.80} has damping that is no multiple of its rate, which is in no term of the dynamics.")
        for key in ("armature", "damping", "frictionloss"):
            if (value := float(getattr(model, f"dof_{key}")[model.jnt_dofadr[i]])) < 0.0:
                wrong.stop(f"joint {name!r:.80} has {key} {value:g}; expected zero or more.")
    for i in range(model.ntendon):
        name = model.tendon(i).name or f"number {i + 1}"
        acting = [key for key in ("stiffness", "armature", "damping", "frictionloss") if getattr(model, f"tendon_{key}")[i]]
        if inner := [key for key in acting if key in ("stiffness", "armature")]:
            _must_be_named(
                wrong,
                leave_out,
                "tendons",
                f"tendon {name!r:.80} has {' and '.join(inner)}, which is in no term of the dynamics",
            )
        if acting or model.tendon_limited[i]:
            yield "tendon", name, f"is left out, with its {', '.join(acting) or 'limit'}"
    if model.opt.density or model.opt.viscosity:
        yield "fluid", "<option>", "density and viscosity: the forces of a fluid are in no term of the dynamics"
