"""`rbd check`: which frames of a motion are possible, and why the others are not, repaired too; for many motions, a ranking."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer
from rich.console import Group
from rich.text import Text

from rbd.cli.ground_option import ground_of
from rbd.cli.terminal import (
    BAD_INPUT,
    FIGURES as PICTURES,
    INTERRUPTED,
    NO_SOLUTION,
    PAGES,
    TRAJECTORIES,
    VIDEOS,
    Feet,
    PackageDirs,
    TerminalTable,
    answering,
    check_outputs,
    facts,
    in_options,
    names_of,
    open_console,
    play,
    print_path,
    save_figure,
    write_json,
    write_outputs,
)
from rbd.errors import InputError, Reason
from rbd.errors.inputs import check_choice
from rbd.installation import VERSION
from rbd.records import RANKED_FILES, Field, counted, joined

if TYPE_CHECKING:
    from rbd.constraints.terrain.terrain import Terrain
    from rbd.motion.many_files import MotionFile
    from rbd.motion.report import MotionReport
    from rbd.robots.carried import Carried
    from rbd.robots.robot import Robot
    from rbd.studies.motion_checks import MotionChecks

CAUSES_SHOWN = 3


def check(
    files: Annotated[list[str], typer.Argument(metavar="FILE...", help="Motions, or folders or patterns of them.")],
    robot: Annotated[str | None, typer.Option(help="Name (g1) or path of a URDF; not needed where a file names it.")] = None,
    rate: Annotated[float | None, typer.Option(help="Frames a second, of files that do not say.")] = None,
    friction: Annotated[float, typer.Option(help="Coulomb's coefficient of the floor.")] = 0.7,
    ground: Annotated[
        str | None,
        typer.Option(
            metavar="Z|fit|FILE|...",
            help="Height of the floor in metres (fitted, and said), or terrain: a file, stairs:0.1,0.3,5 or slope:8.",
        ),
    ] = None,
    torque_limits: Annotated[
        str, typer.Option(metavar="SHARE|none", help="Share of the robot's torque limits that counts, or none.")
    ] = "1",
    motors: Annotated[
        Path | None,
        typer.Option(metavar="YAML", help="Motors of --robot: {joint: {torque_speed: [[0, 60], [9, 0]]}}."),
    ] = None,
    threshold: Annotated[float, typer.Option(help="Share of the weight that may be missing.")] = 0.02,
    bodies: Annotated[
        bool, typer.Option("--bodies/--feet-only", help="Let hands, knees and all else touch the floor.")
    ] = False,
    self_collision: Annotated[
        bool, typer.Option("--self-collision/--no-self-collision", help="Test the bodies against each other.")
    ] = True,
    touch_height: Annotated[float, typer.Option(metavar="M", help="Feet lower than this are meant to touch.")] = 0.03,
    touch_speed: Annotated[float, typer.Option(metavar="M/S", help="Feet slower than this are meant to touch.")] = 0.25,
    quaternion: Annotated[str | None, typer.Option(metavar="ORDER", help="Quaternions, xyzw or wxyz; guessed, said.")] = None,
    units: Annotated[str | None, typer.Option(help="Unit of joint angles: rad or deg; guessed, and said.")] = None,
    trust: Annotated[bool, typer.Option("--trust", help="Take times, lengths, v and a as they are.")] = False,
    joints: Annotated[str | None, typer.Option(metavar="A,B", help="Names of the columns after the base, in order.")] = None,
    from_: Annotated[float | None, typer.Option("--from", metavar="S", help="Start of what is checked.")] = None,
    to: Annotated[float | None, typer.Option(metavar="S", help="End of what is checked.")] = None,
    filter_: Annotated[
        float | None, typer.Option("--filter", metavar="HZ", help="Check it without what is faster, too.")
    ] = None,
    lift: Annotated[bool, typer.Option("--lift", help="Check it put onto the floor by one height, too.")] = False,
    carry: Annotated[
        list[str] | None,
        typer.Option(metavar="KG@A,B", help="Object in one hand or two, by their frames, as held in the first frame."),
    ] = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Repair it over its whole length, and check that, beside what was given.")
    ] = False,
    slower: Annotated[float | None, typer.Option(metavar="FACTOR", help="Repair: 1.5 for half as long again.")] = None,
    keep: Annotated[str | None, typer.Option(metavar="A,B", help="Repair: frames whose poses stay, as those of hands.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write what was repaired, .npz, .csv or .pkl; of several motions, into a folder.")
    ] = None,
    kind: Annotated[
        str | None, typer.Option(metavar="KIND", help="Layout of that file: motion (the default), gmr, beyondmimic or mujoco.")
    ] = None,
    least_possible: Annotated[float, typer.Option(help="Share of frames that must be possible for exit code 0.")] = 1.0,
    workers: Annotated[int, typer.Option(help="Processes for several motions; 0: this one.")] = 0,
    store: Annotated[
        Path | None, typer.Option(metavar="ZARR", help="Resume several motions: keep what is finished, go on with the rest.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option(help="Write the page that plays it; of several motions, a folder: index.html and the worst.")
    ] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write all numbers of the report.")] = None,
    save: Annotated[Path | None, typer.Option(help="Write all arrays, .npz or .nc (one motion).")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw curves, .png, .svg or .pdf (one motion).")] = None,
    show: Annotated[bool, typer.Option("--show", help="Play it at 127.0.0.1 until Ctrl-C (one motion).")] = False,
    video: Annotated[Path | None, typer.Option(help="Write a video, .mp4 (wants ffmpeg) or .gif (one motion).")] = None,
    feet_: Feet = None,
    package_dir: PackageDirs = None,
) -> None:
    """Check motions: which frames are possible for the robot, and why not the others; several files are ranked.

    Each frame is tested by its equations of motion: whether forces of the floor within friction and torques within the motors'
    limits bring about the motion. Else it floats, tips, slips, or a motor is too weak. Feet below the floor or sliding,
    limits of joints and speeds, jumps and self-collision are reported as well. With --repair the motion is repaired: feet flat
    and fixed while they stand, balanced, within limits, near what was given; all outputs are then of the repaired motion.

    Exit codes: 0 possible, 1 not possible, 2 bad input. For example:

    rbd check dance.csv --robot g1 --rate 60 --html dance.html

    rbd check dance.csv --robot g1 --rate 60 --repair --out repaired.npz
    """
    from rbd.motion.many_files import list_motions
    from rbd.motion.motion_writing import ENDINGS
    from rbd.studies.motion_checks import check_motions, checked_file, numbers_of

    console = open_console()
    with answering(check):
        loaded = None if robot is None else _loaded(robot, names_of("--feet", feet_), package_dir, motors)
        if robot is None and motors is not None:
            raise InputError("--motors changes the motors of --robot; expected both.")
        chosen = list_motions(files, loaded)
        one = len(chosen) == 1
        if not 0.0 <= least_possible <= 1.0:
            raise InputError(f"--least-possible is {least_possible:g}; expected a share from 0 to 1.")
        for option, given in {"--slower": slower, "--keep": keep, "--out": out, "--kind": kind}.items():
            if given is not None and not repair:
                raise InputError(f"{option} is of the repaired motion; expected --repair beside it.")
        check_choice("kind", kind := kind or "motion", tuple(ENDINGS))
        _check_outputs(chosen, html=html, json_=json_, save=save, plot=plot, video=video, show=show, out=out, kind=kind)
        how = {
            "slower": 1.0 if slower is None else slower, "keep": names_of("--keep", keep) or [],
            "out": _places(chosen, out, kind), "kind": kind,
        }  # fmt: skip
        # What Motion.read and check_motion refuse, they refuse by the names of these options.
        reading = {
            "rate": rate, "quaternion": quaternion, "units": units, "joints": names_of("--joints", joints), "trust": trust,
        }  # fmt: skip
        settings: dict[str, Any] = {
            "friction": friction, "ground": _ground(ground), "torque_limits": _share(torque_limits), "threshold": threshold,
            "bodies": bodies, "self_collision": self_collision, "touch_height": touch_height, "touch_speed": touch_speed,
        }  # fmt: skip
        ranking, named = Ranking(least_possible), dict[str, Any](between=(from_, to), cutoff=filter_, lift=lift)
        named |= {"carry": [*map(_carried, carry or (), count(1))], "repair": how if repair else None}
        if one:
            robots = {"": chosen[0].robot} if loaded is not None else {}
            report = checked_file(
                str(chosen[0].path),
                chosen[0].name,
                "",
                robots=robots,
                reading=reading,
                settings=settings,
                progress=True,
                **named,
            )
            ranking.checked[str(chosen[0])] = numbers_of(report) | {"per_frame": _per_frame(report)}
            console.print(verdict(report), highlight=False, soft_wrap=True)
            for line in _beside_given(report) if repair else ():
                console.print(line, highlight=False, soft_wrap=True)
            console.print(str(report), highlight=False, soft_wrap=True)
            write_json(json_, ranking)
            if out is not None:
                print_path(console, "motion", out)
            write_outputs(
                console, ("page", html, report.export), ("report", save, report.save), ("plot", plot, partial(draw, report)),
                ("video", video, report.video),
            )  # fmt: skip
        else:
            checks = check_motions(files, robot=loaded, reading=reading, workers=workers, out=store, **named, **settings)
            ranking.take(checks, partial(in_options, command=check))
            console.print(ranking, highlight=False)
            write_json(json_, ranking)
            if html is not None and ranking.checked:
                print_path(console, "page", checks.export(html))
            if out is not None and ranking.checked:
                print_path(console, "motions", out)
            if store is not None:
                print_path(console, "store", store)
            if checks.left:
                kept = "Nothing was kept; --store would." if store is None else "The same command goes on."
                console.print(f"Ended by Ctrl-C before {counted(checks.left, 'motion')}. {kept}", highlight=False)
                raise typer.Exit(INTERRUPTED)
        if show:
            play(console, report)
        if ranking.code:
            raise typer.Exit(ranking.code)


@dataclass
class Ranking:
    """Motions that were checked, and files that could not be.

    Attributes:
        least_possible: Share of frames that must be possible.
        checked: {file: its numbers}.
        failed: {file: why it was not checked, and the message}.
        together: Shares of the frames of all motions, of several.
    """

    least_possible: float
    checked: dict[str, dict[str, Any]] = field(default_factory=dict)
    failed: dict[str, tuple[Reason, str]] = field(default_factory=dict)
    together: dict[str, Any] = field(default_factory=dict)

    fields: ClassVar[tuple[Field, ...]] = (
        Field("rbd", (), "", "version", lambda found: VERSION),
        Field("exit_code", (), "", "exit code", lambda found: found.code),
        Field("together", (), "", "shares of the frames of all motions, of several"),
        *RANKED_FILES,
    )

    def take(self, checks: MotionChecks, worded: Callable[[str], str]) -> None:
        """Take the motions of a data set, and what they are together.

        Args:
            checks: The data set.
            worded: What a message says to somebody who gave options.
        """
        self.checked = dict(checks.ranked)
        self.failed = {file: (reason, worded(message)) for file, (reason, message) in checks.failed.items()}
        self.together = checks.together

    @property
    def ranked(self) -> list[tuple[str, dict[str, Any]]]:
        """Files with their numbers, best first."""
        return sorted(self.checked.items(), key=lambda item: (-item[1]["score"], item[0]))

    @property
    def code(self) -> int:
        """Exit code: 2 if a file could not be checked, 1 if a motion has too few possible frames, else 0."""
        if self.failed:
            return BAD_INPUT
        return NO_SOLUTION if any(x["possible"] < self.least_possible for x in self.checked.values()) else 0

    def more_faults(self, names: Mapping[str, str]) -> list[str]:
        """Causes that repaired motions have in more frames than those that were given, in words, a line a file.

        Args:
            names: {file: its name in the table}.
        """
        out = []
        for file, x in self.ranked:
            was = x.get("before", x)["causes"]
            more = [f"{cause} {was.get(cause, 0)} -> {n}" for cause, n in x["causes"].items() if n > was.get(cause, 0)]
            out += [f"more faults in {names[file]}: {', '.join(more)} frames."] if more else []
        return out

    def __rich__(self) -> Group:
        """How many are possible, the ranking, then the files that were not checked."""
        from rbd.motion.causes import FIGURES
        from rbd.studies.motion_checks import beside, short_names

        parts: list[Any] = []
        if self.checked:
            good = sum(x["possible"] >= self.least_possible for x in self.checked.values())
            motions = counted(len(self.checked), "motion")
            share = "" if self.least_possible == 1.0 else f" in {100.0 * self.least_possible:g} % of their frames or more"
            headings = ("frames", "seconds", "score", "balance", "feet", "motors", "possible", "causes, frames")
            table = TerminalTable(f"{motions}, best first", ("file",), headings)
            names = short_names([*self.checked])
            for file, x in self.ranked:
                causes = sorted(x["causes"].items(), key=lambda item: -item[1])
                table.add_row(
                    names[file], str(x["frames"]), f"{x['duration_s']:.2f}", f"{x['score']:.1f}",
                    *(f"{beside(x, figure)} %" for figure in FIGURES), f"{beside(x, 'possible', 1)} %",
                    joined((f"{name} {count}" for name, count in causes), CAUSES_SHOWN),
                )  # fmt: skip
            note = "balance, feet, motors: share of the frames without a fault of theirs; possible: without any; score: of 100"
            parts += [Text(f"{good} of {motions} possible{share}."), table, Text(note)]
            parts += [Text(line) for line in self.more_faults(names)]
            if self.together:
                shares = ", ".join(f"{name} {beside(self.together, name, 1)} %" for name in ("possible", *FIGURES))
                parts.append(Text(f"of all {self.together['frames']:,} frames: {shares}"))
        if self.failed:
            rows = [(file, why) for file, (_, why) in self.failed.items()]
            parts.append(facts(f"not checked: {counted(len(rows), 'file')}", rows))
        return Group(*parts)


def verdict(report: MotionReport) -> str:
    """Whether a motion is possible, or what prevents it in how many frames, most frequent first."""
    from rbd.motion.causes import CAUSES

    bad = int((~report.possible).sum())
    if not bad:
        return f"Possible: no cause against any of its {counted(report.n, 'frame')}."
    counts = sorted(((int(report.of_cause(c).sum()), c) for c in CAUSES), reverse=True)
    causes = ", ".join(f"{cause} in {count}" for count, cause in counts if count)
    return f"Not possible in {bad} of {counted(report.n, 'frame')}: {causes}."


def _beside_given(report: MotionReport) -> list[str]:
    """Frames of a repaired motion with faults that the one that was given had not there, and its rate where that is another."""
    from rbd.motion.repair.notes import new_faults, new_rate

    given, m = report.before, report.motion
    lines = [] if given is None else [*new_faults(m.t, given.causes, report.causes), *new_rate(m, given.motion)]
    return [line[0].upper() + line[1:] for line in lines]


def _per_frame(report: MotionReport) -> dict[str, Any]:
    causes = {name: report.worst(name, report.n).tolist() for name in report.summary()["causes"]}
    return {
        "t_s": report.motion.t.tolist(), "possible": report.possible.tolist(), "missing": report.missing_scaled.tolist(),
        "noise": report.open.tolist(), "causes": causes, "reason_codes": report.reason_codes.tolist(),
    }  # fmt: skip


def _check_outputs(
    files: Sequence[MotionFile],
    *,
    html: Path | None,
    json_: Path | None,
    save: Path | None,
    plot: Path | None,
    video: Path | None,
    show: bool,
    out: Path | None,
    kind: str,
) -> None:
    from rbd.motion.motion_writing import ENDINGS

    if len(files) == 1:
        outputs = {"--html": (html, PAGES), "--json": (json_, ()), "--save": (save, TRAJECTORIES), "--plot": (plot, PICTURES)}
        outputs["--out"] = (out, ENDINGS[kind])
        check_outputs({**outputs, "--video": (video, VIDEOS)}, reads=str(files[0].path))
        return
    given_one = {"--save": save, "--plot": plot, "--video": video, "--show": show or None}
    for option, given in ((name, value is not None) for name, value in given_one.items()):
        if given:
            raise InputError(f"{option} is for one motion; {len(files)} were given.")
    for file in files:
        check_outputs({"--json": (json_, ())}, reads=str(file.path))
    for option, folder, endings in (("--html", html, PAGES), ("--out", out, (".csv", ".npz", ".pkl"))):
        if folder is None:
            continue
        if folder.suffix.lower() in endings or (folder.exists() and not folder.is_dir()):
            raise InputError(f"{option} is {str(folder)!r:.300}; of {len(files)} motions expected a folder.")
        _make(option, folder)


def _make(option: str, folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{option}: the folder {str(folder)!r:.300} cannot be made: {error.strerror}.") from None


def _places(files: Sequence[MotionFile], out: Path | None, kind: str) -> dict[str, str]:
    """{motion: where it is written once it is repaired}; in folders as those of several files.

    Raises:
        InputError: two motions in one place, or one in place of a file that is read.
    """
    from rbd.motion.motion_writing import ENDINGS
    from rbd.studies.motion_checks import short_names

    if out is None or len(files) == 1:
        return {} if out is None else {str(files[0]): str(out)}
    names, taken = short_names([str(file.path) for file in files]), {os.path.realpath(file.path) for file in files}
    found = dict[str, str]()
    for file in files:
        place = out / Path(names[str(file.path)]).with_suffix("")
        name = re.sub(r"[^\w.-]+", "_", file.name) if file.name else place.name
        folder = place if file.name else place.parent
        found[str(file)] = written = str(folder / f"{name}{ENDINGS[kind][-1]}")
        if os.path.realpath(written) in taken:
            raise InputError(f"--out: {written!r:.300} is read, or of two motions. Give another folder, or fewer motions.")
        taken.add(os.path.realpath(written))
        _make("--out", folder)
    return found


def draw(report: MotionReport, path: Path) -> Path:
    """The curves of a report; returns their path."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    report.plot(list(figure.subplots(2, sharex=True)))
    return save_figure(figure, path, dpi=150)


def _loaded(robot: str, feet: list[str] | None, package_dirs: list[Path] | None, motors: Path | None) -> Robot:
    from rbd.robots.loading import load_robot
    from rbd.robots.loop_file import read_motor_file

    found = load_robot(robot, feet=feet, package_dirs=package_dirs or ())
    return found if motors is None else found.with_motors(read_motor_file(motors))


def _carried(text: str, number: int) -> Carried:
    from rbd.robots.carried import Carried

    mass, _, hands = text.partition("@")
    try:
        kg = float(mass if hands else hands)
    except ValueError:
        raise InputError(f"--carry is {text!r:.80}; expected kilograms and one frame or two: 3@left_hand,right_hand.") from None
    return Carried(kg, names_of("--carry", hands) or [], name=f"object {number}")


def _ground(text: str | None) -> float | str | Terrain | None:
    return text if text is None or text == "fit" else ground_of(text)


def _share(text: str) -> bool | float:
    if text == "none":
        return False
    try:
        share = float(text)
    except ValueError:
        raise InputError(
            f"--torque-limits is {text!r:.80}; expected a share of the robot's limits, e.g. 0.6, or none."
        ) from None
    return True if share == 1.0 else share
