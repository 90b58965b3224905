"""`Wanted`: the argument `keep` of a study, checked; picks what it names from the results of a function."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from rbd.answers.many.naming import Named, Variable
from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.studies.kept.layout import RESERVED
from rbd.studies.kept.plain import WANTED, NotKept, mapping_of, variable_of
from rbd.studies.kept.registry import Kept, Kind, Rows, Verdict, kind_of

Function: TypeAlias = Callable[[Any], Any]
Keep: TypeAlias = Sequence[str | Mapping[str, Function]] | Mapping[str, Function] | None
"""What `rbd.study` takes: names; {name: function of a result}; or names and such mappings; None: the defaults."""


class Wanted:
    """What is kept of a result: names that its type knows, and functions of it.

    Args:
        keep: As of `rbd.study`.

    Attributes:
        names: Names that are kept; None: the defaults of each type.
        functions: {name: function of a result}.

    Raises:
        InputError: neither names nor functions by name, or one name twice.
    """

    def __init__(self, keep: Keep) -> None:
        self.names: tuple[str, ...] | None = None
        self.functions: dict[str, Function] = {}
        self._chosen: dict[type, tuple[tuple[Kept, ...], tuple[Kept, ...]]] = {}
        if keep is None:
            return
        if isinstance(keep, str) or not isinstance(keep, Sequence | Mapping):
            example = f"({keep!r:.40},)" if isinstance(keep, str) else "('status', 'forces')"
            raise InputError(f"keep is {keep!r:.80}; expected names, e.g. keep={example}, or {{name: function of a result}}.")
        names: list[str] = []
        for entry in [keep] if isinstance(keep, Mapping) else keep:
            if isinstance(entry, Mapping):
                for name, function in entry.items():
                    _check_function(name, function)
                    names.append(name)
                    self.functions[name] = function
            elif isinstance(entry, str):
                names.append(entry)
            else:
                raise InputError(f"keep has the entry {entry!r:.80}; expected a name, or {{name: function of a result}}.")
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise InputError(f"keep names {twice[0]!r:.80} twice.")
        self.names = tuple(name for name in names if name not in self.functions)

    def of_one(self, result: Any) -> tuple[list[Named], Verdict]:
        """What is kept of one sample's result, and why it is no answer, where it is none.

        Raises:
            NotKept: a result, or a name of `keep`, that cannot be kept.
            Exception: what a function of `keep` raises.
        """
        kind, verdict = kind_of(type(result)), None
        if kind is None:
            found, verdict = self._plain(result, None)
        elif kind.rows is not None:
            raise NotKept(f"the function returned {_told(result)}, of many states. Set batched=True, or return one of them")
        else:
            verdict = kind.verdict(result)
            found = [named for kept in self._of_kind(kind, type(result))[verdict is not None] for named in kept.of(result)]
        if verdict is None:
            for name, function in self.functions.items():
                found += _named(name, function(result), None)[0]
        return found, verdict

    def of_batch(self, result: Any, n: int) -> tuple[list[Named], Rows]:
        """What is kept of a batched function's result, with one row a sample, and which rows are no answers.

        Raises:
            NotKept: a result, or a name of `keep`, that cannot be kept.
            Exception: what a function of `keep` raises.
        """
        kind = kind_of(type(result))
        if kind is None:
            found, rows = self._plain_batch(result, n)
        elif kind.rows is None:
            raise NotKept(
                f"the batched function returned {_told(result)}, of one sample; expected one row a sample: what rbd.solve_many "
                "returns, or arrays by name. Leave batched=True out where the function takes one sample"
            )
        else:
            if len(result) != n:
                raise NotKept(f"the batched function returned {len(result)} states for {n} samples; expected one a sample")
            rows = kind.rows(result)
            found = [named for kept in self._of_kind(kind, type(result))[0] for named in kept.of(result)]
        for name, function in self.functions.items():
            found += _named_batch(name, function(result), n)[0]
        return found, rows

    def _of_kind(self, kind: Kind, given: type) -> tuple[tuple[Kept, ...], tuple[Kept, ...]]:
        """(what is kept of an answer, what is kept where there is none): certificates first."""
        chosen = self._chosen.get(given)
        if chosen is None:
            names = kind.defaults if self.names is None and not self.functions else self.names or ()
            for name in names:
                if name not in kind.names:
                    raise NotKept(f"keep names {name!r:.80}, which {given.__name__} has not; {nearest(name, kind.names)}")
            names = tuple(dict.fromkeys([*kind.certificate, *names]))
            sure = [name for name in names if name in kind.certificate or name == "residuals"]
            chosen = tuple(kind.names[x] for x in names), tuple(kind.names[x] for x in sure)
            self._chosen[given] = chosen
        return chosen

    def _picked(self, result: Any) -> Iterable[tuple[Any, Any, tuple[str, ...] | None]]:
        """A result that is no record of rbd: the name and value of each that is kept, and what is kept in it; None: all."""
        found = mapping_of(result)
        if found is None:
            if result is None:
                raise NotKept(f"the function returned None; {WANTED}")
            if isinstance(result, tuple):
                raise NotKept(
                    f"the function returned a tuple of {len(result)}; return them by name, e.g. "
                    "{'friction_used': ..., 'torque': ...}"
                )
            found = {"value": result}
        names = self.names
        if self.functions and not names:
            return []
        if names is None:
            return [(name, value, None) for name, value in found.items()]
        if all(name in found for name in names):
            return [(name, found[name], None) for name in names]
        return _within(names, found)

    def _plain(self, result: Any, rows: int | None) -> tuple[list[Named], Verdict]:
        found: list[Named] = []
        verdict: Verdict = None
        for name, value, within in self._picked(result):
            if isinstance(value, float | bool | np.bool_):  # what most functions return, without the looks at other types
                found.append((name, Variable(np.array(value))))
                continue
            inner, told = _named(name, value, rows, within)
            found += inner
            verdict = verdict or told
        return found, verdict

    def _plain_batch(self, result: Any, n: int) -> tuple[list[Named], Rows]:
        found: list[Named] = []
        codes, messages = np.zeros(n, np.int16), dict[int, str]()
        for name, value, within in self._picked(result):
            inner, (own, told) = _named_batch(name, value, n, within)
            found += inner
            if told or own.any():
                codes, messages = np.where(codes, codes, own), {**told, **messages}
        return found, (codes, messages)


def _within(names: Sequence[str], found: Mapping[Any, Any]) -> list[tuple[Any, Any, tuple[str, ...] | None]]:
    """Values that are kept, where some names are `<key>_<name>`: of a record, or a mapping, that stands under a key.

    Raises:
        NotKept: a name that there is not, with the nearest.
    """
    known = {f"{key}_{own}": (key, own) for key, value in found.items() for own in _names_in(value)}
    chosen: dict[Any, tuple[str, ...]] = {}
    for name in names:
        if name not in found and name not in known:
            told = nearest(name, [*map(str, found), *known])
            raise NotKept(f"keep names {name!r:.80}, which the function did not return; {told}")
        key, own = (name, ()) if name in found else (known[name][0], known[name][1:])
        more = tuple(_names_in(found[key], defaults=True)) if name in found else own
        chosen[key] = tuple(dict.fromkeys((*chosen.get(key, ()), *more)))
    return [(key, found[key], within) for key, within in chosen.items()]


def _names_in(value: Any, *, defaults: bool = False) -> Iterable[str]:
    """Names of what can be kept in a value: of a record, or of a mapping; all, or those that are kept where nothing is said."""
    kind = kind_of(type(value))
    if kind is not None:
        return kind.defaults if defaults else kind.names
    return [str(own) for own in mapping_of(value) or ()]


def _named(name: str, value: Any, rows: int | None, within: tuple[str, ...] | None = None) -> tuple[list[Named], Verdict]:
    """A value by name; of a record of rbd or a mapping its own variables, those of `within`, with the name in front."""
    kind = kind_of(type(value))
    if kind is not None:
        if kind.rows is not None:
            raise NotKept(f"{name!r:.80} is {_told(value)}, of many states. Set batched=True, or return one of them")
        verdict = kind.verdict(value)
        names = _chosen(kind, within)
        if verdict is not None:
            names = [k for k in names if k in kind.certificate or k == "residuals"]
        return [(f"{name}_{own}", x) for k in names for own, x in kind.names[k].of(value)], verdict
    inner = mapping_of(value)
    if inner is None:
        variable = variable_of(name, value, rows)
        return ([] if variable is None else [(name, variable)]), None
    pairs = [
        (f"{name}_{own}", variable_of(f"{name}_{own}", x, rows)) for own, x in inner.items() if within is None or own in within
    ]
    return [(own, x) for own, x in pairs if x is not None], None


def _named_batch(name: str, value: Any, n: int, within: tuple[str, ...] | None = None) -> tuple[list[Named], Rows]:
    kind = kind_of(type(value))
    none: Array = np.zeros(n, np.int16)
    if kind is None:
        return _named(name, value, n, within)[0], (none, {})
    if kind.rows is None or len(value) != n:
        raise NotKept(f"{name!r:.80} is {_told(value)}; expected one row a sample: {n}")
    found = [(f"{name}_{own}", x) for k in _chosen(kind, within) for own, x in kind.names[k].of(value)]
    return found, kind.rows(value)


def _chosen(kind: Kind, within: tuple[str, ...] | None) -> Sequence[str]:
    """Names that are kept of a record under a key: certificates, and those of `within`; None: the defaults."""
    return kind.defaults if within is None else list(dict.fromkeys([*kind.certificate, *within]))


def _check_function(name: object, function: object) -> None:
    if not isinstance(name, str) or not name.isidentifier() or name in RESERVED:
        raise InputError(f"keep has the name {name!r:.80}; expected letters, digits and _, and none of {', '.join(RESERVED)}.")
    if not callable(function):
        raise InputError(
            f"keep[{name!r}] is {function!r:.80}; expected a function of a result, e.g. {{{name!r}: lambda held: "
            "held.residuals.worst}. Names stand beside such a mapping: keep=('forces', {...})."
        )


def _told(value: Any) -> str:
    kind = type(value).__name__
    return f"{'an' if kind[:1] in 'AEIOU' else 'a'} {kind}"
