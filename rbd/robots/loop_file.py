"""Files in YAML beside a robot's: loops, couplings, drives, wheels and postures of a mechanism; motors.

A URDF is a tree. `four_bar.loops.yaml` next to `four_bar.urdf` closes it; `load_robot` finds it by that name. Every part may be
left out:

    root: fixed                         # or planar, or free_flyer: what load_robot takes by default
    plane: xz                           # of a planar root: xy (the ground, by default), xz or yz
    passive: [coupler_joint]            # joints that carry no motor
    order: [slow_joint, fast_joint]     # joints of a URDF as they are to follow each other in q; else those on one body by name
    frames:                             # more frames, on links of the robot [m, rad]
      coupler_tip: {link: coupler, xyz: [0.12, 0, 0], rpy: [0, 0, 0]}
    loops:                              # kind: one of rbd.LoopClosure, axis in frame_a; or yours
      - {name: pin, kind: planar, frame_a: coupler_tip, frame_b: rocker_tip, axis: [0, 1, 0]}
      - {name: strut, kind: rod, frame_a: crank_tip, frame_b: slider, length: 0.3}    # without: as in posture "assembled"
      - {name: cross, kind: universal, frame_a: input, frame_b: output, axis: [1, 0, 0], axis_b: [0, 1, 0]}
    couplings:                          # q_joint = ratio q_to + offset, see rbd.JointCoupling
      - {name: gear, joint: left_joint, to: right_joint, ratio: -1, offset: 0}
    drives:                             # joints that follow a motion of time, see rbd.DrivenJoint: q = start + rate t,
      - {name: motor, joint: crank_joint, rate: 30, start: 0.7}
      - {name: cam, joint: lift, kind: spline, times: [0, 1, 2, 3], values: [0, 0.1, 0.1, 0], periodic: true}    # or a spline
    wheels:                             # on the ground z = 0; kind: rolling_wheel, rolling_disk (both with axis in frame),
      - {name: rear, kind: rolling_wheel, frame: rear_wheel, radius: 0.3, axis: [0, 1, 0]}    # rolling_ball or knife_edge
      - {name: skate, kind: knife_edge, frame: blade, direction: [1, 0, 0]}
      - {name: egg, kind: rolling_body, frame: egg, shape: [0.1, 0.05, 0.05]}    # semi-axes; radius: by which it is grown
      - {name: marble, kind: rolling_on_round, frame: ball, radius: 0.05, surface_radius: -0.5, on: [0, 0, 0.5]}    # a bowl
    postures:                           # joint: angle [rad] or displacement [m], or a list: the joint's part of q
      assembled: {crank_joint: 0.7, coupler_joint: -0.4}

A user's kind is read under `loops` or `wheels` by the name given to `rbd.register_constraint(word, kind)`; its keys
are its parameters, their values numbers, strings, truth values or lists of numbers:

      - {name: strut, kind: air_spring, frame_a: coupler_tip, frame_b: rocker_tip, length: 0.3}

What rolls takes `on`: a height [m], a point [x, y, z] of level ground, or a frame of the robot. Of `rolling_on_round` it is the
centre, or a point of the `axis` of a cylinder.

Values follow YAML 1.2: 1e-3 is a number, 010 is ten, `no` and `on` are names. Links and joints are looked up later, on the
robot. Aliases, a key that comes twice, an unknown key, and files above 200 kB are refused by name.

For example `FL_KFE: {torque_speed: [[0, 2.7], [20, 2.7], [50, 0]], gear: 9, rotor_inertia: 2.0e-6}`, a line a joint.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

from rbd.constraints.constraint import Constraint, made
from rbd.constraints.driven import DrivenJoint
from rbd.constraints.joint import JointCoupling
from rbd.constraints.loop import KINDS as CLOSURES, LoopClosure
from rbd.constraints.nonholonomic import KnifeEdge
from rbd.constraints.rolling import RollingBall, RollingBody, RollingDisk, RollingOnRound, RollingWheel
from rbd.displayed import Displayed
from rbd.errors import InputError, ModelError
from rbd.errors.inputs import check_choice, check_different, check_kind
from rbd.model.input_files import file_bytes, is_file
from rbd.model.motors import Motor
from rbd.model.urdf import LONGEST_NAME
from rbd.model.world import PLANES, Plane, checked_plane
from rbd.problem.ground import Body, Ground
from rbd.problem.motions import Speed
from rbd.robots.number_checks import (
    Check,
    Triple,
    checked_axis,
    checked_entry,
    checked_mapping,
    checked_name,
    checked_names,
    checked_number,
    checked_numbers,
    checked_plain,
    checked_triple,
    checked_values,
    in_file,
)

Root = Literal["free_flyer", "fixed", "planar"]

ENDING = ".loops.yaml"
ROOTS: dict[Root, int] = {"free_flyer": 6, "planar": 3, "fixed": 0}
"""Kinds of root joint, and their degrees of freedom."""
LARGEST_FILE = 200_000
"""Bytes. Larger files would take seconds to read, and no robot needs them."""
DEEPEST = 8
"""Lists inside lists; the format needs four."""


@dataclass(frozen=True)
class NamedFrame(Displayed):
    """A frame to be added: its link and position; rpy as in URDF [m, rad]."""

    name: str
    link: str
    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class LoopFile(Displayed):
    """Contents of a loop file, checked; by default empty.

    Attributes:
        name: Of the file, for messages.
        root: Kind of the robot's root joint, if given.
        plane: Of a planar root, if given.
        passive: Joints without a motor.
        order: Joints that move, as declared. Those on one body follow each other in this order, each with all beyond it.
        frames: To be added to the robot.
        loops: Closures, then couplings, as constraints.
        wheels: What rolls or slides on the ground, as constraints.
        drives: Driven joints.
        postures: {name: {joint: numbers}}.
        text: What was read.

    Example:
        >>> closing = rbd.robots.LoopFile.of_text("{root: fixed, postures: {up: {crank_joint: 1.57}}}")
        >>> closing.root, closing.postures
        ('fixed', {'up': {'crank_joint': (1.57,)}})
    """

    name: str = ""
    root: Root | None = None
    plane: Plane | None = None
    passive: tuple[str, ...] = ()
    order: tuple[str, ...] = ()
    frames: tuple[NamedFrame, ...] = ()
    loops: tuple[Constraint, ...] = ()
    wheels: tuple[Constraint, ...] = ()
    drives: tuple[DrivenJoint, ...] = ()
    postures: Mapping[str, Mapping[str, tuple[float, ...]]] = field(default_factory=dict)
    text: str = field(default="", repr=False, compare=False)

    @classmethod
    def of_text(cls, text: str, name: str = "loops.yaml") -> LoopFile:
        """The contents of a loop file in memory, checked: for `load_robot(text=..., loops=...)`.

        Args:
            text: In YAML, as described in `rbd.robots.loop_file`.
            name: For messages.

        Raises:
            InputError: no text.
            ModelError: too large, no YAML, or an entry that is wrong, by its name.
        """
        if not isinstance(text, str) or not isinstance(name, str):
            raise InputError(f"the text of a loop file is {text!r:.80}; expected YAML as a string.")
        return _contents(name, text.encode(errors="surrogatepass"))  # which then is no UTF-8


@dataclass(frozen=True)
class FileForm:
    """Meaning of a name of a kind of constraint.

    Attributes:
        part: The part of a file in which it is read; "" for a user's: in loops or wheels.
        make: Makes the constraint, from its name and the keys.
        keys: {key that is allowed: check of its value}.
        needed: Required keys.
    """

    part: str
    make: Callable[..., Constraint]
    keys: Mapping[str, Check]
    needed: tuple[str, ...]


_ENDS: dict[str, Check] = {"frame_a": checked_name, "frame_b": checked_name, "axis": checked_axis}
_NEEDED = ("frame_a", "frame_b")
_LENGTH: dict[str, Check] = {"length": checked_number}
_MORE: dict[str, dict[str, Check]] = {"universal": {"axis_b": checked_axis}, "rod": _LENGTH, "rope": _LENGTH}
_JOINTS: dict[str, Check] = {"joint": checked_name, "to": checked_name, "ratio": checked_number, "offset": checked_number}


def _surface(what: str, value: object) -> str | float | tuple[float, ...]:
    """A frame, a height or a point."""
    given = checked_plain(what, value)
    if isinstance(given, bool) or isinstance(given, tuple) and len(given) != 3:
        raise InputError(f"{what} is {value!r:.80}; expected a height [m], a point [x, y, z] of the ground, or a frame's name.")
    return given


def _rolling(kind: Callable[..., Constraint], /, *, on: str | float | tuple[float, ...] = 0.0, **keys: Any) -> Constraint:
    """What rolls, on what a file names."""
    if isinstance(on, str):
        return kind(**keys, on=Body(on))
    return kind(**keys, on=Ground(point=on) if isinstance(on, tuple) else on)


def _at_speed(name: str, joint: str, rate: float, start: float = 0.0) -> DrivenJoint:
    return DrivenJoint(name, joint, Speed(rate, start=start))


def _along_spline(
    name: str, joint: str, times: tuple[float, ...], values: tuple[float, ...], periodic: bool = False
) -> DrivenJoint:
    """A joint along the cubic spline through values at times."""
    from scipy.interpolate import CubicSpline

    what = f"drive {name!r:.80}"
    if len(times) != len(values):
        raise InputError(f"{what} has {len(times)} times and {len(values)} values; expected a value for each time.")
    if not all(b > a for a, b in zip(times, times[1:], strict=False)):
        raise InputError(f"{what} has times that do not increase; expected each after the one before [s].")
    if periodic and values[0] != values[-1]:
        raise InputError(f"{what} repeats, from {values[0]:g} to {values[-1]:g}; expected its last value to be its first.")
    return DrivenJoint(name, joint, CubicSpline(times, values, bc_type="periodic" if periodic else "not-a-knot"))


def _truth(what: str, value: object) -> bool:
    check_kind(what, value, bool, "true or false")
    return bool(value)


_MOST_POINTS = 10_000
_POINTS: Check = partial(checked_numbers, counts=range(4, _MOST_POINTS + 1))
_DRIVE: dict[str, Check] = {"joint": checked_name}
_SPEED = _DRIVE | {"rate": checked_number, "start": checked_number}
_SPLINE = _DRIVE | {"times": _POINTS, "values": _POINTS, "periodic": _truth}
_ON: dict[str, Check] = {"on": _surface}
_ROLLS: dict[str, Check] = {"frame": checked_name, "radius": checked_number}
_TURNS = _ROLLS | {"axis": checked_axis}
_NEEDS = ("frame", "radius")
KINDS: dict[str, FileForm] = {
    **{word: FileForm("loops", partial(LoopClosure, kind=word), _ENDS | _MORE.get(word, {}), _NEEDED) for word in CLOSURES},
    "coupling": FileForm("couplings", JointCoupling, _JOINTS, ("joint", "to", "ratio")),
    "speed": FileForm("drives", _at_speed, _SPEED, ("joint", "rate")),
    "spline": FileForm("drives", _along_spline, _SPLINE, ("joint", "times", "values")),
    "rolling_wheel": FileForm("wheels", partial(_rolling, RollingWheel), _TURNS | _ON, _NEEDS),
    "rolling_disk": FileForm("wheels", partial(_rolling, RollingDisk), _TURNS | _ON, _NEEDS),
    "rolling_ball": FileForm("wheels", partial(_rolling, RollingBall), _ROLLS | _ON, _NEEDS),
    "rolling_body": FileForm(
        "wheels", partial(_rolling, RollingBody), _ROLLS | {"shape": checked_triple} | _ON, ("frame", "shape")
    ),
    "rolling_on_round": FileForm(
        "wheels",
        partial(_rolling, RollingOnRound),
        _TURNS | {"surface_radius": checked_number} | _ON,
        (*_NEEDS, "surface_radius"),
    ),  # fmt: skip
    "knife_edge": FileForm("wheels", KnifeEdge, {"frame": checked_name, "direction": checked_axis}, ("frame",)),
}
"""The kinds of constraints of loop files, by name."""


def register_constraint(word: str, kind: Callable[..., Constraint]) -> None:
    """Register a user's kind of constraint, which loop files then accept as `kind: word` in loops and wheels.

    Args:
        word: The name in the file.
        kind: Its class, or a function that makes one. The file's keys are its parameters, `name` first among them; those
            without a default must be there.

    Raises:
        InputError: a name in use, or a kind without a parameter `name`.

    Example:
        >>> def parked(name, joint, angle):
        ...     return rbd.JointLock(name, joint, position=angle)
        >>> rbd.register_constraint("parked", parked)
        >>> with open("arm.yaml", mode="x") as file:
        ...     _ = file.write("{loops: [{name: park, kind: parked, joint: crank_joint, angle: 0.5}]}")
        >>> print(rbd.load_robot(rbd.mechanism.four_bar(1, 3, 3, 4).urdf, root="fixed", loops="arm.yaml").loops())
        (JointLock(name='park', joint='crank_joint', position=array([0.5])),)
    """
    if not isinstance(word, str) or not word.strip() or len(word) > LONGEST_NAME:
        raise InputError(f"the word for a constraint is {word!r:.80}; expected a short one, e.g. 'belt'.")
    try:
        given = inspect.signature(kind).parameters
    except (TypeError, ValueError):
        raise InputError(f"{kind!r:.80} makes no constraint; expected a class with a name and rows(state).") from None
    if "name" not in given:
        raise InputError(f"{kind!r:.80} has no parameter `name`; expected a constraint's class, or a function that makes one.")
    open_ended = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    own = {key: p for key, p in given.items() if key not in ("name", "kind") and p.kind not in open_ended}
    needed = tuple(key for key, p in own.items() if p.default is inspect.Parameter.empty)
    known = KINDS.get(word)
    if known is not None and (known.part or known.make is not kind):
        raise InputError(f"{word!r:.80} stands for {known.make!r:.120} already; expected another word.")
    KINDS[word] = FileForm("", kind, dict.fromkeys(own, checked_plain), needed)


def beside(path: Path) -> Path | None:
    """The loop file of a robot's file, `<stem>.loops.yaml` in the same folder, if it is there."""
    found = path.with_suffix(ENDING)
    return found if is_file(found) else None


def constraint_entry(part: str, what: str, value: object) -> dict[str, Any]:
    """An entry of one of a file's lists of constraints, checked by its kind.

    Args:
        part: "loops", "couplings", "drives" or "wheels".
        what: What the entry is, for messages.
        value: The entry: a name, the word of its kind (couplings and drives of constant speed need none), and the keys of it.

    Raises:
        InputError: an unknown kind or key, with the nearest one; a key that is missing; a value that is none of its kind.
    """
    first = dict[str, Check](name=checked_name, kind=checked_name)
    own = part in ("couplings", "drives")
    words = [word for word, form in KINDS.items() if form.part == part or not form.part and not own]
    alone = {"kind": words[0]} if own else {}
    entry = {**alone, **checked_mapping(what, value)}
    word = check_choice(f"kind of {what}", entry.get("kind"), words)
    return checked_entry(what, entry, {**first, **KINDS[word].keys}, (*first, *KINDS[word].needed))


def read_loop_file(path: Path) -> LoopFile:
    """The contents of a loop file, checked.

    Raises:
        ModelError: not readable, not YAML, or an entry that is wrong, by its name.
    """
    return _contents(path.name, file_bytes(path, LARGEST_FILE, "a loop file in YAML"))


def _contents(file: str, data: bytes) -> LoopFile:
    lists = {part: partial(_constraints, file, part) for part in ("loops", "couplings", "drives", "wheels")}
    checks: dict[str, Check] = {"root": partial(check_choice, known=ROOTS), "plane": partial(check_choice, known=PLANES)}
    checks |= {"passive": checked_names, "order": checked_names, "frames": _frames, **lists, "postures": _postures}
    with in_file(file):
        top = checked_entry("the file", parsed(f"{file:.120}", data), checks, of="")
        if "plane" in top:
            checked_plane(top["plane"], str(top.get("root")))
        top["loops"] = (*top.get("loops", ()), *top.pop("couplings", ()))
        check_different([c.name for c in (*top["loops"], *top.get("drives", ()), *top.get("wheels", ()))], "constraints")
    return LoopFile(file, **top, text=data.decode())


_OF = {"wheels": "wheel", "drives": "drive"}


def _constraints(file: str, part: str, what: str, value: Any) -> tuple[Constraint, ...]:
    check_kind(what, value, list, "a list: a line for each, beginning with a dash")
    out = []
    for i, each in enumerate(value):
        name = each.get("name") if isinstance(each, dict) else None
        entry = constraint_entry(part, f"{what}[{i}]" + (f" ({name!r:.80})" if isinstance(name, str) else ""), each)
        form = KINDS[entry.pop("kind")]
        with in_file(f"{file}: {_OF.get(part, 'loop')} {name!r:.80}"):
            out.append(made(form.make(**entry)))
    return tuple(out)


def _frames(what: str, value: object) -> tuple[NamedFrame, ...]:
    checks: dict[str, Check] = {"link": checked_name, "xyz": checked_triple, "rpy": checked_triple}
    frames = checked_mapping(what, value).items()
    return tuple(NamedFrame(name, **checked_entry(f"frame {name!r:.80}", each, checks, ("link",))) for name, each in frames)


def _postures(what: str, value: object) -> dict[str, dict[str, tuple[float, ...]]]:
    out: dict[str, dict[str, tuple[float, ...]]] = {}
    for name, joints in checked_mapping(what, value).items():
        angles = checked_mapping(f"posture {name!r:.80}", joints)
        values = {joint: checked_values(f"{joint!r:.80} of posture {name!r:.80}", each) for joint, each in angles.items()}
        out[name] = {joint: each if isinstance(each, tuple) else (each,) for joint, each in values.items()}
    return out


@cache
def _reader() -> Any:
    """PyYAML, and its reader of plain data; loaded with the first file."""
    import yaml

    class Loader(yaml.SafeLoader):
        """YAML 1.2's numbers and truth values; no aliases, repeated keys or deep nesting."""

        yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}
        depth = 0

        def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
            """One node; an alias may expand to a thousand nodes, each an alias of a thousand others."""
            event = self.peek_event()
            tag = getattr(event, "tag", None)
            if isinstance(event, yaml.AliasEvent) or tag is not None:
                what = "an alias" if tag is None else f"a tag, {tag!r:.80},"
                raise yaml.YAMLError(f"it has {what} in line {event.start_mark.line + 1}; write it out in plain words")
            if self.depth >= DEEPEST:
                raise yaml.YAMLError(f"more than {DEEPEST} lists or pairs inside each other")
            self.depth += 1
            node = super().compose_node(parent, index)
            self.depth -= 1
            return node

        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
            """A dictionary; YAML's readers silently drop repeated keys."""
            seen: set[str] = set()
            for key, _ in node.value:
                if isinstance(key, yaml.ScalarNode):
                    if key.value in seen:
                        raise yaml.YAMLError(f"key {key.value!r:.80} comes twice, again in line {key.start_mark.line + 1}")
                    seen.add(key.value)
            return super().construct_mapping(node, deep)

    for tag, pattern, first in (
        ("null", r"~|null|", ["~", "n", ""]),
        ("bool", r"true|false", ["t", "f"]),
        ("int", r"[-+]?(?:0|[1-9][0-9]*)", list("-+0123456789")),
        ("float", r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?", list("-+.0123456789")),
    ):
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{tag}", re.compile(f"(?:{pattern})$", re.ASCII), first)
    return yaml, Loader


def parsed(name: str, data: bytes) -> object:
    """What the text of a loop file says, in plain dictionaries, lists, words and numbers.

    Raises:
        ModelError: too large, or no YAML of plain data.
    """
    if len(data) > LARGEST_FILE:
        raise ModelError(f"{name} is larger than {LARGEST_FILE / 1000:g} kB; no mechanism needs so much.")
    yaml, loader = _reader()
    try:
        return yaml.load(data.decode("utf-8"), Loader=loader)  # a SafeLoader: plain data only
    except UnicodeDecodeError as error:
        raise ModelError(f"{name} cannot be read as YAML: byte {error.start} is not UTF-8.") from None
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        message = " ".join(str(error).split())
        raise ModelError(f"{name} cannot be read as YAML: {message:.400}.") from None


_MOTOR: dict[str, Check] = {field.name: lambda what, value: value for field in fields(Motor)}
"""The motor checks its numbers."""


def read_motor_file(path: Path) -> dict[str, Motor | None]:
    """{joint: its motor, or None}, for `robot.with_motors`.

    Raises:
        ModelError: no file, no YAML, or another content; the message has the joint.
    """
    if not path.is_file():
        raise ModelError(f"no file {str(path)!r:.200}; expected a YAML file of motors, {{joint: {{limit: 40}}}}.")
    given = parsed(path.name, file_bytes(path, LARGEST_FILE, "a YAML file of motors"))
    if not isinstance(given, dict) or not all(isinstance(joint, str) for joint in given):
        raise ModelError(f"{path.name} holds {given!r:.80}; expected motors by their joints, {{joint: {{limit: 40}}}}.")
    out: dict[str, Motor | None] = {}
    for joint, data in given.items():
        with in_file(f"{path.name}: {joint!r:.80}"):
            out[joint] = None if data is None else Motor(**checked_entry("its motor, as {limit: 40} or null,", data, _MOTOR))
    return out
