"""`ControlLog`: what a controller did at each of its steps, as arrays; saved, read again, as a dataset, drawn."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError
from rbd.installation import VERSION
from rbd.model.array_file import FileKind, a_path, checksum, listed_in, read_npz, words_in, write_npz
from rbd.model.output_files import check_place
from rbd.records import Variable, counted, dataset

if TYPE_CHECKING:
    import xarray
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

FILE = FileKind("control log", "ControlLog.save(path)")
CONTACTS = ("planned", "touching", "assumed")
"""What is recorded of each contact."""

MEANING = {
    "late": "planned, and does not touch",
    "partial": "taken as a contact, and not all of it touches",
    "early": "touches before it is planned, and is taken as a contact",
    "overdue": "is not planned any more, and is kept as the only contact that carries the robot",
    "unplanned": "touches, and is not planned",
    "slips": "taken as a contact, and slides",
}
"""How what touches can differ from what a step of control assumes."""


class ControlStep(NamedTuple):
    """One step of control: the entries of `ControlLog`, and how contacts differed, as (contact, kind)."""

    t: float
    residual: float
    violation: float
    tau: Array
    torque_use: Array
    missed: Mapping[str, float]
    planned: Collection[str]
    touching: Collection[str]
    assumed: Collection[str]
    different: Collection[tuple[str, str]]


class ControlLog(Displayed):
    """What a `WholeBodyController` did since the start of a motion: arrays with one entry a step of control.

    Args:
        tasks: Names of its tasks.
        contacts: Names of its contacts.

    Attributes:
        disagreements: {contact: {kind: in how many steps}} where what touches is not what was assumed. Kinds: "late", planned
            and does not touch; "partial", taken as a contact though not all its points touch; "early", touches before it is
            planned, late in its swing, and is taken as a contact; "overdue", not planned any more, and kept as the only one
            that carries the robot; "unplanned", touches and is not planned (of a contact that
            the controller does not have, too); "slips", taken as a contact and slides.
        first: {(contact, kind): when that was first seen [s]}.
        motors: Names of the motors; empty before the first step.

    Example:
        >>> arm = rbd.load_robot("ur5", root="fixed")
        >>> reach = rbd.control.WholeBodyController([rbd.control.PostureTask(arm.at().q)])
        >>> reach.accepted(rbd.control.AcceptedStep(arm.at(), 0.0, 1e-3, {}))
        >>> print(reach.log.t, reach.log.missed["posture"].round(6), reach.log.violations)
        [0.] [0.] 0
    """

    def __init__(self, tasks: Iterable[str], contacts: Iterable[str]) -> None:
        self._tasks, self._contacts = tuple(tasks), tuple(contacts)
        self._steps: list[ControlStep] = []
        self.disagreements: dict[str, dict[str, int]] = {}
        self.first: dict[tuple[str, str], float] = {}
        self.motors: tuple[str, ...] = ()

    def add(self, step: ControlStep) -> None:
        """Record a step."""
        self._steps.append(step)
        for contact, kind in step.different:
            kinds = self.disagreements.setdefault(contact, {})
            kinds[kind] = kinds.get(kind, 0) + 1
            self.first.setdefault((contact, kind), step.t)

    def __len__(self) -> int:
        return len(self._steps)

    def _column(self, i: int) -> Array:
        return np.array([step[i] for step in self._steps], float)

    @property
    def t(self) -> Array:
        """Times of the steps, shape (n,) [s]."""
        return self._column(0)

    @property
    def residual(self) -> Array:
        """The largest residual of each step, scaled, shape (n,)."""
        return self._column(1)

    @property
    def violation(self) -> Array:
        """How far each step had to leave contacts' accelerations or joint limits, shape (n,) [m/s2, rad/s2]; 0: not at all."""
        return self._column(2)

    @property
    def tau(self) -> Array:
        """Motor torques, shape (n, nu) [N, N m]."""
        return self._column(3).reshape(len(self), len(self.motors))

    @property
    def torque_use(self) -> Array:
        """Motor torques over their limits, shape (n, nu); 0 where there is no limit."""
        return self._column(4).reshape(len(self), len(self.motors))

    @property
    def torque_share(self) -> Array:
        """The largest motor torque of each step over its limit, shape (n,)."""
        return self.torque_use.max(axis=1, initial=0.0)

    @property
    def missed(self) -> dict[str, Array]:
        """{task: |wanted less reached| of each step, shape (n,)}; NaN where the task was left out."""
        return {name: np.array([step.missed.get(name, math.nan) for step in self._steps], float) for name in self._tasks}

    @property
    def planned(self) -> dict[str, Array]:
        """{contact: whether the schedule wants it, shape (n,) of truth values}."""
        return self._which(step.planned for step in self._steps)

    @property
    def touching(self) -> dict[str, Array]:
        """{contact: whether any of its points touch, shape (n,) of truth values}."""
        return self._which(step.touching for step in self._steps)

    @property
    def assumed(self) -> dict[str, Array]:
        """{contact: whether the step counts on it, shape (n,) of truth values}."""
        return self._which(step.assumed for step in self._steps)

    def _which(self, named: Iterable[Collection[str]]) -> dict[str, Array]:
        chosen = list(named)
        return {name: np.array([name in each for each in chosen], bool) for name in self._contacts}

    @property
    def violations(self) -> int:
        """In how many steps contacts or joint limits were not kept."""
        return sum(step.violation > 0.0 for step in self._steps)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file .npz, for which NumPy is sufficient, to the last bit.

        Raises:
            InputError: another suffix, or a path that cannot be written.
        """
        where = _npz(path)
        check_place(where)
        header, arrays = self._contents()
        write_npz(where, header | {"checksum": checksum(header, arrays)}, arrays, FILE)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> ControlLog:
        """A log from a file that `save` wrote.

        Raises:
            InputError: no such file, no log, or one that was cut short or changed.
        """
        where = _npz(path)
        header, arrays = read_npz(where, FILE)
        try:
            return _log_of(header, arrays)
        except (InputError, KeyError, ValueError, TypeError, IndexError) as error:
            raise InputError(f"{where.name} is no {FILE.name} as {FILE.writer} writes it: {error}"[:300]) from error

    def to_xarray(self) -> xarray.Dataset:
        """An xarray.Dataset over time.

        Variables: residual, violation; tau and torque_use by motor; missed by task; planned, touching and assumed by contact;
        different, by what is listed in `first`.

        Raises:
            InputError: xarray is not installed; names the extra.

        >>> walk.log.to_xarray().torque_use.max("time").to_series().nlargest(3)
        """
        motors, contacts = {"motor": self.motors}, {"contact": self._contacts}
        kinds = [f"{contact}: {kind}" for contact, kind in self.first]
        of_contacts = zip(CONTACTS, ("wanted by the schedule", "any of its points touch", "counted on"), strict=True)
        variables = [
            ("residual", Variable(self.residual, long_name="largest residual, scaled")),
            ("violation", Variable(self.violation, units="m/s2 or rad/s2", long_name="violation of contacts or joint limits")),
            ("tau", Variable(self.tau, ("motor",), "N or N m", "motor torques", motors)),
            ("torque_use", Variable(self.torque_use, ("motor",), "1", "motor torques over their limits", motors)),
            ("missed", Variable(self._columns("missed"), ("task",), "", "distance from the target", {"task": self._tasks})),
            *[(name, Variable(self._columns(name), ("contact",), "", said, contacts)) for name, said in of_contacts],
            ("different", Variable(self._differences(), ("difference",), "", "what differs", {"difference": tuple(kinds)})),
        ]
        return dataset(variables, {"time": ("time", self.t, {"units": "s"})}, {"title": "log of a controller", "rbd": VERSION})

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> list[Artist]:
        """Torques against their limits, and contacts as planned and counted on; see `rbd.visual.plot_control`."""
        return drawing("plot_control")(axes, self)

    def _columns(self, name: str) -> Array:
        """One of the tables by name as columns, shape (n, k)."""
        table = getattr(self, name)
        return np.array(list(table.values())).reshape(len(table), len(self)).T

    def _differences(self) -> Array:
        """Whether each of the kinds of `first` is seen in each step, shape (n, kinds)."""
        seen = [[key in step.different for key in self.first] for step in self._steps]
        return np.array(seen, bool).reshape(len(self), len(self.first))

    def _contents(self) -> tuple[dict[str, Any], dict[str, Array]]:
        """(header, arrays) of a file."""
        header = {
            "rbd": VERSION,
            "tasks": list(self._tasks),
            "contacts": list(self._contacts),
            "motors": list(self.motors),
            "differences": [list(key) for key in self.first],
        }
        arrays = {name: np.asarray(getattr(self, name), float) for name in ("t", "residual", "violation", "tau", "torque_use")}
        arrays |= {name: self._columns(name) for name in ("missed", *CONTACTS)}
        return header, {name: np.asarray(x, float) for name, x in {**arrays, "different": self._differences()}.items()}

    def __str__(self) -> str:
        if not self._steps:
            return "no step of control yet"
        t, worst = self.t, int(np.argmax(self.residual))
        lines = [
            f"{counted(len(t), 'step')} of control from {t[0]:.6g} to {t[-1]:.6g} s",
            f"worst residual {self.residual[worst]:.2g} (scaled) at t = {t[worst]:.6g} s",
            f"largest torque {100.0 * self.torque_share.max():.0f} % of its limit",
        ]
        if n := self.violations:
            worst = int(np.argmax(self.violation))
            lines.append(
                f"{counted(n, 'step')} could not keep contacts or joint limits, by at most {self.violation[worst]:.3g} m/s2 "
                f"or rad/s2, at t = {t[worst]:.6g} s"
            )
        else:
            lines.append("contacts and joint limits were kept in all steps")
        for contact, kinds in self.disagreements.items():
            for kind, n in kinds.items():
                lines.append(
                    f"{contact}: {MEANING[kind]}, in {counted(n, 'step')}, first at t = {self.first[contact, kind]:.6g} s"
                )
        if not self.disagreements:
            lines.append("what touches is what was planned, in all steps")
        return "\n".join(lines)


def _npz(path: object) -> Any:
    found = a_path(path, "the path of a file, e.g. 'walk.npz'")
    if found.suffix != ".npz":
        raise InputError(f"path is {str(path)!r:.200}; expected one that ends in .npz.")
    return found


def _log_of(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> ControlLog:
    """The log of a file's contents.

    Raises:
        InputError: contents that no log has.
        KeyError: an array that is not there.
        ValueError: arrays of other shapes.
    """
    told = {name: x for name, x in header.items() if name not in ("format", "version", "checksum")}
    if header.get("checksum") != checksum(told, arrays):
        raise InputError("its checksum differs: it was changed")
    tasks, contacts, motors = (words_in(header, name) for name in ("tasks", "contacts", "motors"))
    kinds = [(str(contact), str(kind)) for contact, kind in listed_in(header, "differences")]
    n = len(arrays["t"])
    wide = {"tau": motors, "torque_use": motors, "missed": tasks, "different": kinds}
    wide |= dict.fromkeys(CONTACTS, contacts)
    shapes = dict.fromkeys(("t", "residual", "violation"), (n,)) | {name: (n, len(over)) for name, over in wide.items()}
    for name, shape in shapes.items():
        if arrays[name].shape != shape or arrays[name].dtype.kind != "f":
            raise InputError(f"{name} has the shape {arrays[name].shape}; expected {shape}")
    log = ControlLog(tasks, contacts)
    log.motors = motors
    for i in range(n):
        planned, touching, assumed = (
            [name for name, on in zip(contacts, arrays[which][i], strict=True) if on] for which in CONTACTS
        )
        missed = {name: x for name, x in zip(tasks, arrays["missed"][i].tolist(), strict=True) if not math.isnan(x)}
        different = [kind for kind, on in zip(kinds, arrays["different"][i], strict=True) if on]
        t, residual, violation = (float(arrays[name][i]) for name in ("t", "residual", "violation"))
        tau, use = arrays["tau"][i], arrays["torque_use"][i]
        log.add(ControlStep(t, residual, violation, tau, use, missed, planned, touching, assumed, different))
    return log
