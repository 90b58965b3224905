"""Study files, `push.toml`: what is evaluated, at which samples, what is kept and drawn; read and checked strictly."""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

from rbd.cli.study_plan import ANY_ROBOT, RESULTS, Given, StudyPlan, Words, standing_function, words_of
from rbd.cli.sweeps import QUANTITIES, QUESTIONS, Drawn, Values, argument_of, as_kind, quantity_of, ranges_of, values_of
from rbd.errors import InputError, nearest
from rbd.studies import Samples, grid, kept_names, sample
from rbd.studies.workers.calling import name_of, parameters_of

TOP = ("question", "function", "robot", "keep", "seed", "batched")
TABLES = {
    "samples": "names with values: every combination is a sample",
    "draws": "n, method and ranges: random samples",
    "fixed": "names with one value, that of all samples",
    "plot": "x, y, value, by: what --png draws",
}
DRAWS = ("n", "method", "ranges")
METHODS = ("sobol", "latin_hypercube", "random")
PLOT = ("x", "y", "value", "by")
MOST_BYTES = 1_000_000


class StudyFile:
    """A study file: its keys, each with the line on which it stands.

    Args:
        path: Where it is.

    Raises:
        InputError: what cannot be read, is no TOML, or has unknown keys; names the line where it is known.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = _text_of(path)
        try:
            self.keys: dict[str, Any] = tomllib.loads(self.text)
        except tomllib.TOMLDecodeError as error:
            why, twice = str(error).rstrip("."), "overwrite" in str(error)
            written = "Beside push, push.angle is written push_angle." if twice else 'Text stands in quotes, as in "0.1:1:19".'
            raise InputError(f"{path.name} is no TOML: {why}. {written}") from None
        self._known((*TOP, *TABLES), self.keys, "")
        for name in TABLES.keys() & self.keys.keys():
            if not isinstance(self.keys[name], dict):
                raise self.wrong(name, f"is no table; expected [{name}] on a line, and below it {TABLES[name]}")

    def table(self, name: str) -> dict[str, Any]:
        """The keys of a table, {} where it is absent; those of tables inside by names with dots."""
        return dict(_flat(self.keys.get(name, {})))

    def where(self, key: str, table: str = "") -> str:
        """Where a key stands, for messages: "[samples] friction (line 7 of push.toml)"."""
        line = _line_of(self.text, key, table)
        told = f"line {line} of {self.path.name}" if line else f"in {self.path.name}"
        return f"{f'[{table}] ' if table else ''}{key} ({told})"

    def wrong(self, key: str, what: str, table: str = "") -> InputError:
        """The error of a key."""
        return InputError(f"{self.where(key, table)} {what}.")

    def get(self, key: str, kind: type, expected: str, default: Any = None) -> Any:
        """A key of the file's head.

        Raises:
            InputError: of another type.
        """
        value = self.keys.get(key, default)
        if value is not default and (not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool)):
            raise self.wrong(key, f"is {value!r:.80}; expected {expected}")
        return value

    def _known(self, known: Iterable[str], given: Iterable[str], table: str) -> None:
        for key in given:
            if key not in (names := list(known)):
                raise self.wrong(key, f"is not known; {nearest(key, names)}", table)

    def plan(self, seed: int | None = None) -> StudyPlan:
        """The study.

        Args:
            seed: In place of the file's.

        Raises:
            InputError: what is missing or wrong, before anything is computed.
            ModelError: as `rbd.load_robot`.
        """
        question = self.get("question", str, f"one of {', '.join(QUESTIONS)}")
        function = self.get("function", str, 'a file and a name, "my_module.py:push"')
        if (question is None) == (function is None):
            both = "both a question and a function" if question else "neither a question nor a function"
            raise InputError(
                f'{self.path.name} has {both}; expected question = "stand" (or {", ".join(list(QUESTIONS)[1:])}), or '
                'function = "my_module.py:push".'
            )
        own = self.get("seed", int, "a whole number", 0)
        if own < 0:
            raise self.wrong("seed", f"is {own}; expected a whole number, zero or more")
        keep = self._keep()
        plot = self._plot()
        batched = self.get("batched", bool, "true or false", False)
        seed = own if seed is None else seed
        if question is not None:
            if batched:
                raise self.wrong("batched", "is of functions; a question takes samples one by one")
            return self._standing(question, seed, keep, plot)
        return self._own(str(function), seed, keep, plot, batched)

    def _standing(self, question: str, seed: int, keep: tuple[str, ...] | None, plot: dict[str, str]) -> StudyPlan:
        if question not in QUESTIONS:
            raise self.wrong("question", f"is {question!r:.80}; {nearest(question, QUESTIONS)}")
        where: dict[str, str] = {}

        def named(table: str, key: str) -> str:
            place = self.where(key, table)
            name = quantity_of(key, question, place).name
            where[name] = place
            return name

        fixed: dict[str, Any] = {}
        for key, value in self.table("fixed").items():
            name = key if key in ("feet", "package_dir", "direction") else named("fixed", key)
            where.setdefault(name, self.where(key, "fixed"))
            fixed[name] = self._robot_option(name, value) if name in ("feet", "package_dir") else value
        if "robot" in self.keys:
            if "robot" in fixed:
                raise self.wrong("robot", "is at the head of the file and in [fixed]; give it once")
            fixed["robot"], where["robot"] = self._robot(), self.where("robot")
        swept: dict[str, Values] = {}
        for key, value in self.table("samples").items():
            name = named("samples", key)
            swept[name] = as_kind(QUANTITIES[name], values_of(self._several(key, value), where[name]), where[name])
        drawn: dict[str, Drawn] = {}
        for key, ends in self._ranges().items():
            name = named("draws.ranges", key)
            as_kind(QUANTITIES[name], np.array(ends) if isinstance(ends, tuple) else ends, where[name])
            drawn[name] = ends
        both = {**swept, **{name: np.array(ends) if isinstance(ends, tuple) else ends for name, ends in drawn.items()}}
        self._once(swept, drawn)
        given = Given(question, fixed, both, where)
        function, columns, robot = standing_function(given)
        ranges = {QUANTITIES[name].argument: ends for name, ends in drawn.items()}
        values = {argument: column for argument, column in columns.items() if argument not in ranges}
        samples = self._samples(values, ranges, seed, {QUANTITIES[name].argument: QUANTITIES[name].unit for name in both})
        if keep is not None:
            known = kept_names(RESULTS[question])
            for name in keep:
                if name not in known:
                    raise self.wrong("keep", f"has {name!r:.80}; {nearest(name, known)}")
        if keep is None and robot is None:
            keep = ANY_ROBOT[question]
        return StudyPlan(function, samples, words_of(given, robot), keep, seed, False, plot)

    def _own(self, name: str, seed: int, keep: tuple[str, ...] | None, plot: dict[str, str], batched: bool) -> StudyPlan:
        fixed = {argument_of(key): value for key, value in self.table("fixed").items()}
        if "robot" in self.keys:
            fixed["robot"] = self._robot()
        ranges = {argument_of(key): ends for key, ends in self._ranges().items()}
        values = {
            argument_of(key): values_of(self._several(key, value), self.where(key, "samples"))
            for key, value in self.table("samples").items()
        }
        self._once(fixed, {**values, **ranges})
        self._once(values, ranges)
        samples = self._samples(values, ranges, seed, {})
        function, module = self._imported(name)
        self._taken(function, fixed)
        called = partial(function, **fixed) if fixed else function
        return StudyPlan(called, samples, Words(name), keep, seed, batched, plot, module)

    def _taken(self, function: Callable[..., Any], fixed: Iterable[str]) -> None:
        """Refuse arguments that are the same in all samples and that the function lacks."""
        parameters = parameters_of(function)
        if parameters is None or any(p.kind is p.VAR_KEYWORD for p in parameters):
            return
        known = [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
        places = {argument_of(key): key for key in self.table("fixed")}
        for name in fixed:
            if name not in known:
                told = f"is no parameter of {name_of(function)}; {nearest(name, known) if known else 'it has none'}"
                raise self.wrong(places.get(name, name), told, "fixed" if name in places else "")

    def _several(self, key: str, value: Any) -> Any:
        if isinstance(value, str | list):
            return value
        raise self.wrong(
            key, f'is {value!r:.80}; expected several, "0.1:1:19" or a list; one value stands in [fixed]', "samples"
        )

    def _once(self, names: Iterable[str], others: Iterable[str]) -> None:
        """Refuse names that stand in two tables."""
        if twice := set(names) & set(others):
            raise InputError(f"{self.path.name} gives {min(twice)} twice, in two tables; give it once.")

    def _ranges(self) -> dict[str, Drawn]:
        """{name: (low, high), or words} that are drawn."""
        if "draws" not in self.keys:
            return {}
        draws = self.keys["draws"]
        self._known(DRAWS, draws, "draws")
        n, method, ranges = draws.get("n"), draws.get("method", METHODS[0]), draws.get("ranges")
        if isinstance(n, bool) or not isinstance(n, int) or n < 1:
            raise self.wrong("n", f"is {n!r:.80}; expected how many samples, a whole number from 1", "draws")
        if method not in METHODS:
            raise self.wrong("method", f"is {method!r:.80}; {nearest(method, METHODS)}", "draws")
        if not isinstance(ranges, dict) or not ranges:
            raise self.wrong("ranges", "is missing or empty; expected [draws.ranges] and below it friction = [0.1, 1]", "draws")
        flat = dict(_flat(ranges))
        return ranges_of(flat, {key: self.where(key, "draws.ranges") for key in flat})

    def _samples(self, values: Mapping[str, Any], ranges: Mapping[str, Any], seed: int, units: Mapping[str, str]) -> Samples:
        """Every combination of the values; random draws; or as many draws at every combination.

        Raises:
            InputError: neither of them.
        """
        if not values and not ranges:
            raise InputError(f'{self.path.name} has no samples; expected [samples] and below it e.g. friction = "0.1:1:19".')
        found = grid(**values) if values else None
        if ranges:
            draws = self.keys["draws"]
            drawn = sample(draws["n"], method=draws.get("method", METHODS[0]), seed=seed, ranges=ranges)
            found = drawn if found is None else found * drawn
        assert found is not None
        return found.with_units(**{name: unit for name, unit in units.items() if unit})

    def _keep(self) -> tuple[str, ...] | None:
        keep = self.get("keep", list, 'a list of names, keep = ["forces"]')
        if keep is not None and (not keep or not all(isinstance(name, str) for name in keep)):
            raise self.wrong("keep", f'is {keep!r:.80}; expected a list of names, keep = ["forces"]')
        return None if keep is None else tuple(keep)

    def _plot(self) -> dict[str, str]:
        plot = self.keys.get("plot", {})
        self._known(PLOT, plot, "plot")
        for key, value in plot.items():
            if not isinstance(value, str):
                raise self.wrong(key, f"is {value!r:.80}; expected a name in quotes", "plot")
        return {key: value if key == "value" else argument_of(value) for key, value in plot.items()}

    def _robot(self) -> str:
        """The robot's name, or its path from the folder of this file."""
        name = self.get("robot", str, "a name or a path")
        beside = self.path.parent / Path(name).expanduser()
        return str(beside) if beside.is_file() else str(name)

    def _robot_option(self, name: str, value: Any) -> list[str]:
        listed = [value] if isinstance(value, str) else value
        if not isinstance(listed, list) or not listed or not all(isinstance(x, str) for x in listed):
            raise self.wrong(name, f"is {value!r:.80}; expected a list of {'frames' if name == 'feet' else 'folders'}", "fixed")
        return [str(self.path.parent / x) for x in listed] if name == "package_dir" else listed

    def _imported(self, name: str) -> tuple[Callable[..., Any], str]:
        """A function of a Python file beside this one, and the name of its module.

        Raises:
            InputError: no such file or function, a name that another module has, an error while it is imported.
        """
        place, colon, function = name.rpartition(":")
        if not colon or not place.endswith(".py") or not function.isidentifier():
            raise self.wrong("function", f'is {name!r:.80}; expected a file and a name, "my_module.py:push"')
        file = (self.path.parent / Path(place).expanduser()).resolve()
        if not file.is_file():
            raise self.wrong("function", f"is in {place!r:.200}, and there is no such file")
        module = file.stem
        if not module.isidentifier():
            raise self.wrong("function", f"is in {place!r:.200}; its name is imported, so expected letters, digits and _ in it")
        known = sys.modules.get(module)
        if known is None and (spec := find_spec(module)) is not None and spec.origin != str(file):
            raise self.wrong("function", f"is in {place!r:.200}, and Python has another module {module!r}; rename the file")
        if known is None or getattr(known, "__file__", None) != str(file):
            if known is not None:
                raise self.wrong("function", f"is in {place!r:.200}, and Python has another module {module!r}; rename the file")
            known = _import(file, module, self.where("function"))
        found = getattr(known, function, None)
        if not callable(found):
            names = [n for n, x in vars(known).items() if callable(x) and getattr(x, "__module__", "") == module]
            raise self.wrong("function", f"is {function!r}, which {place} does not have; {nearest(function, names)}")
        return found, module


def _import(file: Path, module: str, where: str) -> Any:
    """The module of a file, whose folder joins the places where Python looks: workers find it there, too."""
    folder = str(file.parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    spec = spec_from_file_location(module, file)
    assert spec is not None and spec.loader is not None  # a .py file that exists
    found = module_from_spec(spec)
    sys.modules[module] = found
    try:
        spec.loader.exec_module(found)
    except Exception as error:
        del sys.modules[module]
        raise InputError(f"{where}: {file.name} cannot be imported: {type(error).__name__}: {error}") from error
    return found


def _text_of(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"the study file {str(path)!r:.300} cannot be read: {error.strerror}.") from None
    if len(content) > MOST_BYTES:
        raise InputError(f"{path.name} is larger than {MOST_BYTES:,} bytes; expected a study file, a few lines of TOML.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path.name} is no text in UTF-8 (byte {error.start}); expected a study file, a few lines of TOML."
        ) from None


def _flat(table: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _line_of(text: str, key: str, table: str) -> int:
    """The number of the line on which a key is set; 0 where it is not found."""
    current, last = "", key.rpartition(".")[2]
    for number, line in enumerate(text.splitlines(), 1):
        if head := re.match(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$", line):
            current = head[1].replace('"', "").replace("'", "").replace(" ", "")
            if not table and current == key:
                return number
            continue
        name = re.match(r"\s*([\w.\-\"' ]+?)\s*=", line)
        if name is None:
            continue
        full = name[1].replace('"', "").replace("'", "").replace(" ", "")
        whole = f"{current}.{full}".strip(".")
        if whole == f"{table}.{key}".strip(".") or (not table and whole == last):
            return number
    return 0
