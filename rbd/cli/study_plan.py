"""What a study on the command line evaluates: its function with fixed arguments, its samples, and the words of its report."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from rbd.cli.sweeps import COMPONENTS, QUANTITIES, QUESTIONS, Values, as_kind, quantity_of, sweeps_of, values_of
from rbd.errors import InputError, nearest
from rbd.problem.cones import check_friction
from rbd.robots import catalogue
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.solution import Solution
from rbd.solvers.default import slip_law
from rbd.statics.actuation import Actuation
from rbd.statics.wanted_motion import checked_margin
from rbd.studies import Samples, grid
from rbd.studies.standing import heaviest_link, move_under_push, withstand_push

FUNCTIONS: dict[str, Callable[..., Any]] = {"stand": withstand_push, "solve": move_under_push}
RESULTS: dict[str, type] = {"stand": Actuation, "solve": Solution}
ANY_ROBOT = {
    "stand": ("status", "worst_residual", "worst_torque", "worst_motor", "forces", "friction_used"),
    "solve": ("status", "worst_residual", "forces", "friction_used"),
}
"""What is kept where robots differ, unless the study says: nothing that has a number for each joint."""
ROBOT_OPTIONS = ("feet", "package_dir")
"""Of the fixed arguments, those with which the robot is loaded."""


@dataclass(frozen=True)
class Words:
    """What a report says of the samples that have a result, and of the others.

    Attributes:
        asked: What is studied, in a line.
        many: Of how many: a sentence with a place for "212 of 399".
        good: One that has a result, in short.
        bad: One that has none.
    """

    asked: str
    many: str = "{} samples have a result"
    good: str = "with a result"
    bad: str = "without one"

    def verdict(self, good: int, n: int) -> str:
        """How many of n have a result, as a sentence without its stop."""
        share = f"all {n:,}" if good == n > 1 else f"none of {n:,}" if not good else f"{good:,} of {n:,}"
        told = self.many.format(share)
        return told[0].upper() + told[1:] if self.many.startswith("{}") else told


@dataclass(frozen=True, eq=False)
class StudyPlan:
    """A study, checked as far as it can be without computing.

    Attributes:
        function: What is evaluated, picklable.
        samples: Its samples.
        words: What is said of its results.
        keep: Names of what is kept; None: the defaults of the result's type.
        seed: Of the samples' random numbers.
        batched: Whether the function takes arrays over samples.
        plot: Arguments of `rbd.visual.plot_study`.
        module: Name of the users' module with the function; "" for one of this package.
    """

    function: Callable[..., Any]
    samples: Samples
    words: Words
    keep: tuple[str, ...] | None = None
    seed: int = 0
    batched: bool = False
    plot: Mapping[str, str] = field(default_factory=dict)
    module: str = ""


@dataclass(frozen=True, eq=False)
class Given:
    """Arguments of a question about a robot on its feet, as a user wrote them.

    Attributes:
        question: "stand" or "solve".
        fixed: {name: value} that all samples share; robot is among them, or is swept.
        swept: {name: values}; of random draws both ends of the range.
        where: {name: where it is written}, for messages; else the name itself.
    """

    question: str
    fixed: Mapping[str, Any]
    swept: Mapping[str, Values]
    where: Mapping[str, str] = field(default_factory=dict)

    def at(self, name: str) -> str:
        """Where a name is written."""
        return self.where.get(name, name)


def standing_function(given: Given) -> tuple[partial[Any], dict[str, Any], Robot | None]:
    """The function of a question with its fixed arguments, and the arguments that differ, all checked.

    Args:
        given: The arguments.

    Returns:
        The function, {argument: values} in the order given, and the robot where it is one.

    Raises:
        InputError: unknown names (of the robot's postures and frames, too), values that are none, a push without direction.
        ModelError, UnknownRobot: as `rbd.load_robot`.
    """
    options = {name: given.fixed[name] for name in ROBOT_OPTIONS if name in given.fixed}
    fixed = {quantity_of(n, given.question, given.at(n)).name if n != "direction" else n: value
             for n, value in given.fixed.items() if n not in ROBOT_OPTIONS}  # fmt: skip
    swept = dict(given.swept)
    for name in swept.keys() & fixed.keys() - {"push"}:
        raise InputError(f"{given.at(name)} is both swept and fixed; give it once.")
    arguments = _push_arguments(given, fixed, swept)
    only: Robot | None = None
    columns: dict[str, Any] = {QUANTITIES[name].argument: values for name, values in swept.items()}
    if "robot" in swept:
        columns["robot"] = [_robot(name, options, given)[0] for name in swept["robot"]]
    else:
        arguments["robot"], only = _robot(fixed.get("robot"), options, given)
    for name, value in fixed.items():
        if name not in ("robot", "push", "direction", *COMPONENTS):
            arguments[QUANTITIES[name].argument] = _one(name, value, given)
    _check_values(given, {**{k: [v] for k, v in fixed.items() if k in QUANTITIES}, **given.swept}, only)
    if only is not None and "at" not in arguments and "at" not in swept:
        arguments["at"] = heaviest_link(only)
    return partial(FUNCTIONS[given.question], **arguments), columns, only


def plot_of(plan: StudyPlan) -> dict[str, str]:
    """The arguments of `rbd.visual.plot_study`, known to show every dimension of the study before it is computed.

    Args:
        plan: The study; of three dimensions, those that it does not name are x, y and, with the fewest values, by.

    Raises:
        InputError: names that the study lacks, dimensions that nothing would show.
    """
    dims_of = {name: dims for name, (dims, *_) in plan.samples.coords().items()}
    dims_of = {**{dim: (dim,) for dim in plan.samples.dims}, **dims_of}
    chosen = {key: name for key, name in plan.plot.items() if key != "value"}
    for key, name in chosen.items():
        if name not in dims_of:
            raise InputError(f"[plot] {key} is {name!r:.80}, which the study has not; {nearest(name, dims_of)}.")
    wide = {dim: n for dim, n in plan.samples.dims.items() if n > 1}
    if not chosen and len(wide) == 3:
        by = min(wide, key=lambda dim: wide[dim])
        x, y = (dim for dim in wide if dim != by)
        return {**plan.plot, "x": x, "y": y, "by": by}
    shown = {dim for name in chosen.values() for dim in dims_of[name]} if chosen else set(list(wide)[:2])
    if "y" in chosen and "x" not in chosen:
        raise InputError("[plot] has y and no x; name both, or x alone for curves.")
    free = 0 if not chosen or "y" in chosen else 1 if "x" in chosen else 2  # they become x, y and by
    left = [dim for dim in wide if dim not in shown]
    if len(left) > free:
        raise InputError(
            f"a picture shows at most three dimensions, x, y and by, and this one leaves out {', '.join(left)}. Name them in "
            "[plot] of a study file, fix one, or draw parts of the store of --out in Python: dataset.sel(...)."
        )
    return dict(plan.plot)


def sweep_plan(options: Sequence[str], fixed: Mapping[str, Any]) -> StudyPlan:
    """The study of `rbd stand ROBOT --sweep ...`.

    Args:
        options: Texts of `--sweep`.
        fixed: {name: value} of the other options that were given.

    Raises:
        InputError: as `standing_function`; an option that is swept, too; a frame without a push.
    """
    swept = sweeps_of(options, "stand")
    where = {name: f"--{name.replace('_', '-')}" for name in fixed} | {name: f"--sweep {name}" for name in swept}
    if "robot" in swept:
        raise InputError("--sweep robot: the command names its robot; a study file sweeps robots (rbd study --help).")
    for name in swept.keys() & fixed.keys() - {"push"}:
        raise InputError(f"--{name} is both fixed and swept; give it once.")
    if ("at" in fixed or "at" in swept) and "push" not in fixed and not any(name.startswith("push") for name in swept):
        raise InputError("--at came without a push; give --push X,Y,Z, or sweep push.x, push.y or push.z.")
    given = Given("stand", fixed, swept, where)
    function, columns, robot = standing_function(given)
    units = {QUANTITIES[name].argument: QUANTITIES[name].unit for name in swept if QUANTITIES[name].unit}
    return StudyPlan(function, grid(**columns).with_units(**units), words_of(given, robot))


def words_of(given: Given, robot: Robot | None) -> Words:
    """What a report says of a question."""
    asked = QUESTIONS[given.question]
    told = asked if robot is None else f"{robot.name}: {asked}"
    if given.question == "stand":
        many = "{} cases can be held" if robot is None else f"{robot.name} can be held in {{}} cases"
        return Words(told, many, "held", "not held")
    return Words(told, "{} samples have a solution", "with a solution")


def _push_arguments(given: Given, fixed: Mapping[str, Any], swept: Mapping[str, Values]) -> dict[str, Any]:
    """The push that does not differ: its direction where its size is swept, else its components."""
    out: dict[str, Any] = {}
    parts = {name: _one(name, fixed[name], given) for name in COMPONENTS if name in fixed}
    push, direction = fixed.get("push"), fixed.get("direction")
    vector = None if push is None or isinstance(push, int | float) else _vector(push, given.at("push"))
    if vector is not None and parts:
        raise InputError(f"{given.at('push')} and {next(iter(parts))} both give the push; give one of them.")
    if "push" in swept and push is not None and vector is None:
        raise InputError(f"{given.at('push')} is both swept and fixed; give it once, or its direction by push X,Y,Z.")
    along = vector if vector is not None and ("push" in swept or "push.angle" in swept) else None
    if direction is not None:
        along = _vector(direction, given.at("direction"))
    has_size = "push" in swept or (push is not None and vector is None)
    if has_size and (both := [name for name in COMPONENTS if name in swept or name in parts]):
        raise InputError(
            f"{given.at('push')} is the size of the push and {given.at(both[0])} a component of it; give one of them: "
            "components push.x, push.y and push.z, or a size with its direction, by push X,Y,Z or push.angle."
        )
    if has_size and along is None and not {"push.angle"} & (swept.keys() | fixed.keys()):
        raise InputError(
            f"{given.at('push')} has a size and no direction; give it by push X,Y,Z (whose length does not matter), by "
            "push.angle, or sweep push.x, push.y or push.z."
        )
    if "push.angle" in swept.keys() | fixed.keys() and push is None and "push" not in swept:
        raise InputError(f"{given.at('push.angle')} turns a push that has no size; give push (in newtons), fixed or swept.")
    if along is not None:
        if not along.any():
            raise InputError(f"{given.at('push')} is zero; expected the direction of the push, e.g. 0,1,0.")
        out["direction"] = tuple(along.tolist())
        if "push" not in swept and vector is not None:  # its angle is swept
            out["push"] = float(np.linalg.norm(vector))
    elif vector is not None:
        parts = {name: x for name, x in zip(COMPONENTS, vector.tolist(), strict=True) if name not in swept}
    if push is not None and vector is None:
        out["push"] = _one("push", push, given)
    return out | {QUANTITIES[name].argument: x for name, x in parts.items()}


def _vector(value: Any, what: str) -> np.ndarray:
    numbers = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    if not numbers or len(value) != 3 or any(isinstance(x, bool) or not isinstance(x, int | float) for x in value):
        raise InputError(f"{what} is {value!r:.80}; expected three numbers, [X, Y, Z].")
    return np.array(value, float)


def _robot(name: Any, options: Mapping[str, Any], given: Given) -> tuple[Robot | str, Robot]:
    """What workers get, a name of the catalogue or a robot with its content, and the robot."""
    if not isinstance(name, str):
        expected = 'expected a name or a path, e.g. robot = "talos"'
        raise InputError(
            f"{given.at('robot')}: {'no robot is named' if name is None else f'robot is {name!r:.80}'}; {expected}."
        )
    feet, folders = options.get("feet"), options.get("package_dir", ())
    loaded = load_robot(name, package_dirs=folders, feet=feet)
    if not loaded.source.feet:
        raise InputError(
            f"no feet are known for {loaded.name}, so that it cannot stand; `rbd robots` lists those that do. Or name the "
            "frames of its feet, feet=A,B."
        )
    known = name in catalogue.names() and not feet and not folders and not os.path.isfile(name)
    return (name if known else loaded), loaded


def _one(name: str, value: Any, given: Given) -> Any:
    """A fixed value: a number or a word, as its quantity wants."""
    quantity, what = QUANTITIES[name], given.at(name)
    if isinstance(value, list):
        raise InputError(f"{what} is a list, {value!r:.80}; what is the same in all samples is one value.")
    if isinstance(value, str) and (":" in value or "," in value) and quantity.kind != "words":
        raise InputError(f"{what} is {value!r:.80}; what is the same in all samples is one value. Sweep it to have several.")
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError(f"{what} is {value!r:.80}; expected {'a name' if quantity.kind == 'words' else 'a number'}.")
    found = as_kind(quantity, values_of([value], what), what)[0]
    return found.item() if isinstance(found, np.generic) else found


def _check_values(given: Given, values: Mapping[str, Any], robot: Robot | None) -> None:
    """Refuse values that no sample could take, before anything is computed.

    Raises:
        InputError: a negative friction, an unknown law, posture or frame; the message says where it is written.
    """
    checks: dict[str, Callable[[Any], object]] = {
        "friction": lambda x: check_friction(float(x), 4),
        "facets": lambda x: check_friction(0.5, int(x)),
        "margin": lambda x: checked_margin(float(x)),
        "law": lambda x: slip_law(str(x)),
    }
    if robot is not None:
        checks |= {"posture": lambda x: robot.posture(str(x)), "at": lambda x: robot.frame(str(x))}
    for name, check in checks.items():
        for value in values.get(name, ()):
            try:
                check(value)
            except InputError as error:
                raise type(error)(f"{given.at(name)}: {error}") from None
