"""What is kept of each type of result: names, each with one line that says what it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np

from rbd.answers.many.naming import Named, Variable
from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.reasons import Reason

Verdict: TypeAlias = tuple[Reason, str] | None
"""Why a result is no answer, and its message; None where it is one."""
Rows: TypeAlias = tuple[Array, Mapping[int, str]]
"""Of a result with n rows: `Reason.code` of each, shape (n,), 0 where there is an answer; {row: message} of the others."""

_HOMES = {
    "rbd.problem.answer.Answer": "answers",
    "rbd.statics.actuation.Actuation": "answers",
    "rbd.control.task_actuation.TaskActuation": "control_steps",
    "rbd.answers.many.answers.ManyAnswers": "many_answers",
    "rbd.statics.actuations.Actuations": "many_answers",
    "rbd.model.state.State": "poses",
    "rbd.mechanism.pose_search.FoundPose": "poses",
    "rbd.simulation.trajectory.Trajectory": "motions",
    "rbd.motion.report.MotionReport": "motions",
    "rbd.statics.pushes.PushLimits": "limits_of_standing",
    "rbd.statics.regions.SupportRegion": "limits_of_standing",
    "rbd.statics.zero_moment_point.ZmpRegion": "limits_of_standing",
    "rbd.answers.analysis.uniqueness.Uniqueness": "uniqueness",
    "rbd.studies.comparison.LawComparison": "comparisons",
    "rbd.mechanism.degrees_of_freedom.Mobility": "comparisons",
}
"""{class: module of this package with its `KINDS`}: imported when a result of the class first comes."""
_looked_up: dict[type, Kind | None] = {}


@dataclass(frozen=True, eq=False)
class Kept:
    """A name that `keep` may have.

    Attributes:
        about: What it is, in one line.
        of: The variables of a result, each with its name in the dataset.
        default: Whether it is kept where nothing is said.
    """

    about: str
    of: Callable[[Any], list[Named]]
    default: bool = True


def no_verdict(result: Any) -> Verdict:
    """Results of this type are always answers."""
    return None


@dataclass(frozen=True, eq=False)
class Kind:
    """A type of results.

    Attributes:
        names: {name that `keep` may have: what it keeps}.
        certificate: Those that are always kept, whatever `keep` says.
        verdict: Whether a result is an answer; where it is none only `residuals` is kept of it beside the certificate.
        rows: Of a type with one row a sample, in place of `verdict`: which rows are answers; None of other types.
    """

    names: Mapping[str, Kept]
    certificate: tuple[str, ...] = ()
    verdict: Callable[[Any], Verdict] = no_verdict
    rows: Callable[[Any], Rows] | None = field(default=None, kw_only=True)

    @property
    def defaults(self) -> tuple[str, ...]:
        """Names that are kept where nothing is said."""
        return tuple(name for name, kept in self.names.items() if kept.default)


def kind_of(result: type) -> Kind | None:
    """What is known of a type of results; None where nothing is."""
    if result not in _looked_up:
        known = [full_name(base) for base in result.__mro__ if full_name(base) in _HOMES]
        _looked_up[result] = known_types(known[:1]).get(known[0]) if known else None
    return _looked_up[result]


def known_types(names: Iterable[str] = tuple(_HOMES)) -> dict[str, Kind]:
    """{class: what is kept of it}, of all types that a study knows, or of some."""
    return {name: import_module(f"rbd.studies.kept.{_HOMES[name]}").KINDS[name] for name in names}


def full_name(kind: type) -> str:
    """Module and name of a class."""
    return f"{kind.__module__}.{kind.__qualname__}"


def kept_names(result: type) -> dict[str, str]:
    """What `keep` of `rbd.study` may name of a type of results: {name: what it is}; see `rbd.study`.

    Args:
        result: A class that a study's function may return, e.g. `rbd.Solution`.

    Raises:
        InputError: no class, or one that studies do not know. Of those a function returns the numbers that count, by name.

    Example:
        >>> list(rbd.studies.kept_names(rbd.statics.SupportRegion))
        ['residual', 'area', 'com_distance', 'empty', 'bounded', 'cut', 'area_gap', 'inscribed_radius']
        >>> rbd.studies.kept_names(rbd.Actuation)["worst_torque"]
        'largest share of a motor limit that is used'
    """
    kind = kind_of(result) if isinstance(result, type) else None
    if kind is None:
        known = ", ".join(name.rsplit(".", 1)[1] for name in _HOMES)
        raise InputError(
            f"{result!r:.80} is no type of which a study keeps something by name; these are {known}. A function may return "
            "numbers and arrays by name, too: {'height': 0.3}."
        )
    return {name: kept.about for name, kept in kind.names.items()}


def number(name: str, value: Any, units: str, about: str) -> list[Named]:
    """One variable: a number, a truth value or text."""
    return [(name, Variable(np.asarray(value), (), units, about))]


def one(name: str, about: str, value: Callable[[Any], Any], units: str = "1", *, default: bool = True) -> dict[str, Kept]:
    """{name: what it keeps}, of one number, truth value or text of a result.

    Args:
        name: Name in `keep` and in the dataset.
        about: What it is.
        value: Gives it.
        units: Its unit.
        default: Whether it is kept where nothing is said.
    """
    return {name: Kept(about, lambda result: number(name, value(result), units, about), default)}
