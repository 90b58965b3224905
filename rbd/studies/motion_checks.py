"""`check_motions`: `rbd.check_motion` of all motions of folders, in parallel and resumable, as one table, dataset and page."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rbd.arrays import check_flag, lazy
from rbd.displayed import Displayed, drawing
from rbd.errors import Reason
from rbd.errors.inputs import check_kind, check_known
from rbd.installation import VERSION
from rbd.model.checked_model import CheckedModel
from rbd.motion.causes import CAUSES, FIGURES
from rbd.motion.checking import check_motion
from rbd.motion.many_files import MotionFile, Names, list_motions
from rbd.motion.report import MotionReport
from rbd.records import RANKED_FILES, Field
from rbd.robots.carried import Carried
from rbd.studies.results import kept_names
from rbd.studies.running import study
from rbd.studies.tables import table

if TYPE_CHECKING:
    import xarray


def check_motions(
    files: Names | Iterable[Names] | Mapping[Any, Names | Iterable[Names]],
    *,
    robot: CheckedModel | Names | None = None,
    reading: Mapping[str, Any] | None = None,
    between: tuple[float | None, float | None] = (None, None),
    cutoff: float | None = None,
    lift: bool = False,
    carry: Sequence[Carried] = (),
    repair: Mapping[str, Any] | None = None,
    workers: int | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: bool = True,
    **settings: Any,
) -> MotionChecks:
    """What `rbd.check_motion` finds of all motions of a data set: ranked, with shares, causes, and files that it cannot read.

    Args:
        files: As of `rbd.motion.list_motions`: a folder, a pattern, several of them, or a mapping of robots to these.
        robot: The robot of all; None where the files name it.
        reading: Arguments of `rbd.Motion.read`: {"rate": 60}.
        between: From when to when each is checked [s].
        cutoff: Check each without what is faster than this [Hz].
        lift: Check each put onto the floor; for a floor that is given.
        carry: What the robot of each carries, taken as in its first frame: see `Motion.carrying`.
        repair: Repair each and check it again: arguments of `MotionReport.repaired`, {} for the usual ones, with `out`,
            {file: where the repaired motion is written}, and `kind`, of that file.
        workers: How many processes; None: one a core, 0: this one.
        out: A path that ends in .zarr: what is finished stays there, and the same call goes on with what is missing.
        progress: Whether a bar is drawn on a terminal.
        settings: Arguments of `rbd.check_motion`.

    Raises:
        InputError: as `list_motions` and `rbd.study`; xarray is not installed. What is wrong with one file is told in its row.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> rbd.motion.minimum_jerk(solo, [low, low], [0.0, 0.5], rate=50.0).save("stands.npz")
        >>> rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0).save("hops.npz")
        >>> found = rbd.studies.check_motions(["hops.npz", "stands.npz", "gone.npz"], robot=solo, workers=0)
        >>> print(found.export("report").name)
        index.html
        >>> print(found)
        2 motions, 57 frames, 1.10 s: 57.9 % possible; balance 57.9, feet 100.0, motors 100.0 %
          score  balance   feet  motors  possible  motion
            100      100    100     100       100  stands.npz
             43       23    100     100        23  hops.npz
        floats in 42.1 % of the frames
        1 file was not checked: gone.npz
    """
    check_kind("reading", reading, Mapping | None, "arguments of rbd.Motion.read by name: {'rate': 60}")
    check_kind("repair", repair, Mapping | None, "arguments of MotionReport.repaired by name: {'slower': 1.5}")
    check_flag("lift", lift)
    listed = list_motions(files, robot)
    robots = {id(file.robot): file.robot for file in listed if file.robot is not None}
    names = {key: getattr(each, "name", "") + f" {i}" * (i > 0) for i, (key, each) in enumerate(robots.items())}
    columns = {
        "file": [str(file.path) for file in listed],
        "motion": [file.name for file in listed],
        "robot": [names.get(id(file.robot), "") for file in listed],
    }
    known = {names[key]: each for key, each in robots.items()}
    function = partial(
        checked_file, robots=known, reading=dict(reading or {}), settings=settings, between=between, cutoff=cutoff, lift=lift,
        carry=carry, repair=repair,
    )  # fmt: skip
    keep: list[Any] = [*kept_names(MotionReport), {"numbers": _numbers}]
    found = study(function, table(columns), keep=keep, executor=workers, out=out, progress=progress)
    written, done = (repair or {}).get("out", {}), found["ok"].values
    gone = [i for i, file in enumerate(listed) if done[i] and not os.path.exists(written.get(str(file), os.curdir))]
    if gone:  # repaired motions that were written before the store went on, and are no longer there
        again = {name: [each[i] for i in gone] for name, each in columns.items()}
        study(function, table(again), keep=keep, executor=workers, progress=progress)
    return MotionChecks(found, function)


def checked_file(
    file: str,
    motion: str,
    robot: str,
    *,
    robots: Mapping[str, Any],
    reading: Mapping[str, Any],
    settings: Mapping[str, Any],
    between: tuple[float | None, float | None] = (None, None),
    cutoff: float | None = None,
    lift: bool = False,
    carry: Sequence[Carried] = (),
    repair: Mapping[str, Any] | None = None,
    progress: bool = False,
) -> MotionReport:
    """The report on one motion.

    Args:
        file: Its path.
        motion: Its name in a file that holds several; else empty.
        robot: Name of the robot among `robots`; empty where the file names its own.
        robots: {name: robot}.
        reading: Arguments of `Motion.read`.
        settings: Arguments of `check_motion`.
        between: From when to when [s].
        cutoff: Check it again without what is faster than this [Hz].
        lift: Check it again, put onto the floor.
        carry: What its robot carries.
        repair: Repair it, and check it again; as of `check_motions`.
        progress: Show a bar while it is read and checked.

    Raises:
        InputError: of what cannot be read or checked.
    """
    found = MotionFile(Path(file), robots.get(robot), motion).read(progress=progress, **reading)
    if between != (None, None):
        found = found.cut(*between)
    if carry:
        found = found.carrying(*carry)
    report = check_motion(found, progress=progress, **settings)
    if cutoff is not None:
        report = report.filtered(cutoff)
    if lift:
        report = report.lifted()
    if repair is None:
        return report
    how = {"out": {}, "kind": "motion", **repair}
    out, kind = how.pop("out").get(str(MotionFile(Path(file), None, motion))), how.pop("kind")
    report = report.checked_again(report.repaired(progress=progress, **how))
    if out is not None:
        report.motion.with_contacts(report.lanes, report.forces).save(out, kind=kind)
    return report


def short_names(files: Sequence[str]) -> dict[str, str]:
    """{file: its path from the folder that all are in}."""
    shared = len(os.path.commonpath([os.path.dirname(os.path.abspath(file)) for file in files])) if len(files) > 1 else 0
    return {file: os.path.abspath(file)[shared:].lstrip(os.sep) if shared else file for file in files}


def numbers_of(report: MotionReport) -> dict[str, Any]:
    """The summary of a report, and of the one before it, each with the worst frame of the first: what the robot does there."""
    worst = int(np.argmin(report.grades))
    return _numbers_at(report, worst) | ({} if report.before is None else {"before": _numbers_at(report.before, worst)})


def _numbers_at(report: MotionReport, i: int) -> dict[str, Any]:
    """The summary of a report, and what the robot does in a frame."""
    frame = {
        "frame": i, "t_s": float(report.motion.t[i]), "q": report.motion.q[i].tolist(),
        "missing": (report.missing[i, :3] / (report.motion.robot.mass * 9.81)).tolist(),
        "causes": [cause for cause in CAUSES if report.of_cause(cause)[i]],
    }  # fmt: skip
    return report.summary() | {"worst": frame}


def together(numbers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What motions are together: how many, frames, seconds, shares of the frames, and of each cause, most frequent first."""
    frames = sum(x["frames"] for x in numbers)
    shares = {name: float(sum(x[name] * x["frames"] for x in numbers) / max(frames, 1)) for name in ("possible", *FIGURES)}
    causes = {cause: sum(x["causes"].get(cause, 0) for x in numbers) / max(frames, 1) for cause in CAUSES}
    found = sorted(((cause, share) for cause, share in causes.items() if share), key=lambda each: -each[1])
    duration = float(sum(x["duration_s"] for x in numbers))
    return {"motions": len(numbers), "frames": frames, "duration_s": duration, **shares, "causes": dict(found)}


def beside(numbers: Mapping[str, Any], name: str, digits: int = 0) -> str:
    """A share as text [%], behind what it was before the motions were changed, if they were: "2 -> 98"."""
    shares = ([numbers["before"][name]] if "before" in numbers else []) + [numbers[name]]
    most = 100.0 - 10.0**-digits  # one bad frame of many is not rounded away
    return " -> ".join(f"{100.0 * share if share == 1.0 else min(100.0 * share, most):.{digits}f}" for share in shares)


def _numbers(report: MotionReport) -> str:
    return json.dumps(numbers_of(report), allow_nan=False)


@dataclass(frozen=True, eq=False, repr=False)
class MotionChecks(Displayed):
    """The checks of a data set of motions.

    Attributes:
        dataset: What `rbd.study` returned: a row for each motion, with the fields of `MotionReport`, and its `numbers` as JSON.
        check: Called with file, motion and robot, as the samples have them: `checked_file` with the same settings.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> rbd.motion.minimum_jerk(solo, 2 * [solo.standing().q], [0.0, 0.5]).save("stands.npz")
        >>> found = rbd.studies.check_motions("stands.npz", robot=solo, workers=0)
        >>> file, numbers = found.ranked[0]
        >>> file, numbers["score"], float(found.dataset.share_possible[0]), found.failed
        ('stands.npz', 100.0, 1.0, {})
    """

    dataset: xarray.Dataset
    check: Callable[..., MotionReport]

    fields: ClassVar[tuple[Field, ...]] = (
        Field("rbd", (), "", "version", lambda found: VERSION),
        Field("together", (), "", "shares of the frames of all motions, and how many they are"),
        *RANKED_FILES,
    )  # fmt: skip

    @lazy
    def ranked(self) -> list[tuple[str, dict[str, Any]]]:
        """(file, its numbers as `MotionReport.summary`) of each motion, by score, best first."""
        d = self.dataset
        texts = d["numbers"].values if "numbers" in d else [""] * d.sizes["sample"]  # no result has told what it would be
        found = ((file, json.loads(text)) for file, text in zip(self._files, texts, strict=True) if text)
        return sorted(found, key=lambda x: (-x[1]["score"], x[0]))

    @lazy
    def failed(self) -> dict[str, tuple[Reason, str]]:
        """{file: why it was not checked, and the message}; without those that were not begun."""
        d = self.dataset
        rows = zip(self._files, d["ok"].values, d["reason"].values, d["message"].values, strict=True)
        return {
            file: (Reason.of_code(code), str(message))
            for file, ok, code, message in rows
            if not (ok or code == Reason.NOT_RUN.code)
        }

    @property
    def left(self) -> int:
        """How many motions were not begun, after Ctrl-C."""
        return int((self.dataset["reason"].values == Reason.NOT_RUN.code).sum())

    @property
    def _files(self) -> list[str]:
        parts = zip(self.dataset["file"].values, self.dataset["motion"].values, strict=True)
        return [f"{file}[{name}]" if name else str(file) for file, name in parts]

    @lazy
    def names(self) -> dict[str, str]:
        """{file: its path from the folder that all are in}."""
        return short_names(self._files)

    def report(self, file: str) -> MotionReport:
        """The report on one motion, checked again; by its name in `ranked`.

        Raises:
            InputError: there is none, with the nearest names.
        """
        check_known("file is", file, self._files)
        sample = self.dataset.isel(sample=self._files.index(file))
        return self.check(**{name: str(sample[name].values) for name in ("file", "motion", "robot")})

    @lazy
    def together(self) -> dict[str, Any]:
        """What `together` says of them, and of them `before` they were repaired, lifted or filtered."""
        found = [x for _, x in self.ranked]
        before = [x["before"] for x in found if "before" in x]
        return together(found) | ({"before": together(before)} if before else {})

    def export(self, folder: str | os.PathLike[str], **settings: Any) -> Path:
        """Write the page of the data set into a folder; returns its path. See `rbd.visual.export_motion_checks`."""
        return drawing("export_motion_checks")(self, folder, **settings)

    def __str__(self) -> str:
        x, n = self.together, len(self.ranked)
        possible, *shares = (beside(x, name, 1) for name in ("possible", *FIGURES))
        figures = ", ".join(f"{name} {share}" for name, share in zip(FIGURES, shares, strict=True))
        lines = [
            f"{n} motion{'s' * (n != 1)}, {x['frames']} frames, {x['duration_s']:.2f} s: {possible} % possible; {figures} %",
            f"  score  {'  '.join(f'{name:>5}' for name in FIGURES)}  possible  motion",
        ]
        for file, x in self.ranked:
            each = "".join(f"{beside(x, name):>{max(len(name), 5) + 2}}" for name in FIGURES)
            lines.append(f"{x['score']:7.0f}{each}{beside(x, 'possible'):>10}  {file}")
        if causes := self.together["causes"]:
            lines.append(", ".join(f"{cause} in {100.0 * share:.1f}" for cause, share in causes.items()) + " % of the frames")
        if self.failed:
            many = len(self.failed) != 1
            lines.append(f"{len(self.failed)} file{'s were' if many else ' was'} not checked: {', '.join(self.failed)}")
        if self.left:
            lines.append(f"not begun: {self.left} of {self.dataset.sizes['sample']} files")
        return "\n".join(lines)
