"""Common parts of all commands: options, tables, pictures, and errors in terms of the command line.

Text is printed literally, never as markup.
"""

from __future__ import annotations

import importlib.util
import io
import json
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TypeAlias, get_args, get_type_hints

import numpy as np
import rich.table
import typer
from rich import box
from rich.console import Console
from rich.text import Text
from typer.models import OptionInfo

from rbd.errors import InputError, NoSolution, RbdError, Reason, SimulationStopped, StudyStopped
from rbd.kernels import show_progress
from rbd.model.output_files import check_place, write_file, write_text
from rbd.records import plain

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from rbd.arrays import Array
    from rbd.control.schedules import Pushes
    from rbd.model.checked_model import CheckedModel
    from rbd.motion.report import MotionReport
    from rbd.robots.robot import Robot
    from rbd.simulation.trajectory import Trajectory

Command: TypeAlias = Callable[..., None]
NO_SOLUTION, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit codes; 130, as of shells, where Ctrl-C left something out."""
WIDTH = 140
"""Width for files and pipes: tables cut at 80 columns would lose numbers."""
PAGES, FIGURES, TRAJECTORIES, VIDEOS = (".html", ".htm"), (".png", ".svg", ".pdf"), (".npz", ".nc"), (".mp4", ".gif")
LOGS = (".npz",)
_SILENT = (DeprecationWarning, PendingDeprecationWarning, ResourceWarning)
_PYTHON = {
    "rbd.robots.catalogue.names()": "`rbd robots`",
    "rbd.doctor(robot)": "`rbd info`",
    "robot.frames()": "`rbd info`",
    "rbd.mechanism.assemble closes it": "`rbd mechanism` closes it",
    "(joint_motion)": "(--space joint)",
    ", or None for a bilateral contact": "",
}
"""Advice of messages in Python, with its form on the command line."""
_CODE = re.compile(r"\brbd\.\w|[A-Za-z_]\w*\(|\w=[\w.(\[{]")
"""A name of the package, a call, or a keyword argument."""


class TerminalTable(rich.table.Table):
    """A table whose text is printed literally: "[/foo]" and ":smile:" are names of joints, also where a console reads markup.

    Args:
        title: Above the table, on the left.
        left: Headings of its first columns, which are flush left.
        right: Headings of the columns after them, which are flush right.
        headings: Whether the headings are printed.
    """

    def __init__(
        self, title: str | None = None, left: Sequence[str] = (), right: Sequence[str] = (), *, headings: bool = True
    ) -> None:
        caption = None if title is None else Text(title)
        super().__init__(title=caption, title_justify="left", box=box.SIMPLE_HEAD, show_header=headings)
        for heading in left:
            self.add_column(heading)
        for heading in right:
            self.add_column(heading, justify="right")

    def add_column(self, header: Any = "", **options: Any) -> None:  # type: ignore[override]
        """A column; see rich."""
        super().add_column(_literal(header), **options)

    def add_row(self, *cells: Any, **options: Any) -> None:
        """A row; see rich."""
        super().add_row(*map(_literal, cells), **options)


def facts(title: str | None, rows: Iterable[tuple[str, str]]) -> TerminalTable:
    """A table of names and values, without headings."""
    table = TerminalTable(title, ("", ""), headings=False)
    for row in rows:
        table.add_row(*row)
    return table


def in_gravity(robot: Robot, gravity: str | None) -> Robot:
    """The robot in a world with the gravity of the option --gravity; as it is where there is none."""
    if gravity is None:
        return robot
    return robot.with_gravity(numbers_of("--gravity", gravity, "m/s2", names="X,Y,Z"))


def numbers_of(option: str, text: str, unit: str, *, names: str = "") -> Array:
    """The finite numbers of an option.

    Args:
        option: Its name.
        text: The option's text, numbers separated by commas.
        unit: Of the numbers, for the message.
        names: What the numbers are, as "X,Y,Z"; "" for any count.

    Raises:
        InputError: what cannot be read, another count, numbers that are not finite.
    """
    count = len(names.split(",")) if names else 0
    try:
        values = np.array([float(x) for x in text.split(",")])
    except ValueError:
        values = np.zeros(0)
    finite = bool((np.abs(values) < 1e150).all())  # and small enough to be squared
    if not finite or not len(values) or (count and len(values) != count):
        many = {0: "", 1: "one ", 2: "two ", 3: "three "}[count] + ("" if finite else "finite ")
        many += "number" if count == 1 else "numbers"
        example = {1: "0.5", 3: "0,80,0"}.get(count, "0.5,0.5")
        expected = f"{many}, {names} in {unit}" if names else f"{many} with commas between, in {unit}"
        raise InputError(f"{option} is {text!r:.80}; expected {expected}, e.g. {example}.")
    return values


def joints_of(options: Sequence[str] | None, robot: CheckedModel) -> dict[str, float]:
    """{joint: value} of the options `--joint NAME=VALUE`; a pattern is of all joints of one coordinate that are like it.

    Raises:
        InputError: no equals sign, no number, a joint twice.
        JointNotFound: with the nearest names.
    """
    found: dict[str, float] = {}
    for option in options or ():
        name, equals, text = (part.strip() for part in option.partition("="))
        if not equals or not name:
            raise InputError(f"--joint is {option!r:.80}; expected NAME=VALUE, e.g. knee=-1.4, or '*knee=-1.4' of all like it.")
        (value,) = numbers_of(f"--joint {name}", text, "rad or m", names="VALUE")
        like = dict.fromkeys(robot.joints.positions[i].joint for i in robot.joints.q_of(name).tolist())
        named = [name] if name in like else [joint for joint in like if robot.joints[joint].nv == 1]
        if twice := [joint for joint in named if joint in found]:
            raise InputError(f"--joint names {twice[0]!r:.80} twice; expected each joint once.")
        found |= dict.fromkeys(named, float(value))
    return found


def names_of(option: str, text: str | None) -> list[str] | None:
    """The names of an option, separated by commas; None if it was not given.

    Raises:
        InputError: an empty name.
    """
    if text is None:
        return None
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise InputError(f"{option} is {text!r:.80}; expected names separated by commas, e.g. left_ankle,right_ankle.")
    return names


def open_console(*, errors: bool = False) -> Console:
    """The console of standard output, or of the errors' stream.

    Text that the stream cannot encode (a name that is not UTF-8, a ² on an ASCII terminal) is written with backslashes.
    """
    stream = sys.stderr if errors else sys.stdout
    if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
        stream.reconfigure(errors="backslashreplace")
    console = Console(stderr=errors, markup=False, emoji=False)
    return console if console.is_terminal else Console(stderr=errors, markup=False, emoji=False, width=WIDTH)


@contextmanager
def answering(command: Command | None = None) -> Iterator[None]:
    """Turn this package's errors into messages and exit codes, and its warnings into lines, each printed once.

    Args:
        command: The command whose options appear in messages.
    """
    show_progress(_compiling)
    with warnings.catch_warnings(record=True, action="always") as caught:
        try:
            yield
        except NoSolution as error:
            _fail("no solution", in_options(str(error), command), NO_SOLUTION)
        except StudyStopped as error:
            _fail("stopped", in_options(str(error), command), NO_SOLUTION)
        except RbdError as error:
            _fail("bad input", in_options(str(error), command), BAD_INPUT)
        finally:
            messages = [str(w.message) for w in caught if not issubclass(w.category, _SILENT)]
            for message in dict.fromkeys(in_options(message, command) for message in messages):
                _complain("warning", "yellow", message)


def _compiling(count: int) -> AbstractContextManager[Callable[[float], None]]:
    """A progress bar for the functions that are compiled."""
    from rbd.simulation.progress_bar import progress_of

    return progress_of(range(count + 1), doing="compiling (once)")


def in_commands(text: str) -> str:
    """A text with commands in place of calls of Python."""
    for python, ours in _PYTHON.items():
        text = text.replace(python, ours)
    return text


def in_options(message: str, command: Command | None = None) -> str:
    """A message in terms of the command line: arguments are options of the command, and advice in Python is removed."""
    message = in_commands(message)
    options = {} if command is None else _options(command)
    for argument, option in options.items():
        before = rf"(?<![\w.(]){argument}="
        message = re.sub(rf"{before}(?:True\b|(?![\w.'\"(\[{{-]))", option, message)  # a flag, or no value
        message = re.sub(rf"{before}(?=[\w.'\"-])", f"{option} ", message)
    first, *more = re.split(r"(?<=\.)\s+(?=[A-Z`])", message)
    name, is_, rest = first.partition(" is ")
    if is_ and name in options:
        first = f"{options[name]} is {rest}"
    return " ".join([first, *(sentence for sentence in more if not _CODE.search(sentence))])


def _options(command: Command) -> dict[str, str]:
    """{argument: its option} of a command; of a flag, the one that sets it."""
    found = {}
    for name, hint in get_type_hints(command, include_extras=True).items():
        for option in (each for each in get_args(hint) if isinstance(each, OptionInfo)):
            # Of Annotated[..., Option("--json")] the name is first in `default`.
            stated = [x for x in (option.default, *(option.param_decls or ())) if isinstance(x, str)]
            found[name.rstrip("_")] = (stated or ["--" + name.replace("_", "-")])[0].split("/")[0]
    return found


def check_outputs(outputs: Mapping[str, tuple[Path | None, tuple[str, ...]]], *, reads: str | None = None) -> None:
    """Refuse files that could not be written, before computing.

    Args:
        outputs: {option: (path or None; allowed suffixes, () for any)}.
        reads: The file that the command reads: it is not overwritten.

    Raises:
        InputError: an unknown suffix, a missing folder, no permission, one file for two options, a
            figure without Matplotlib.
    """
    taken: dict[str, str] = {}
    if reads is not None and os.path.isfile(reads):
        taken[os.path.realpath(reads)] = "the file that is read"
    for option, (path, endings) in outputs.items():
        if path is None:
            continue
        suffix = path.suffix if endings is TRAJECTORIES else path.suffix.lower()
        if endings and suffix not in endings:
            raise InputError(f"{option} is {str(path)!r:.300}; expected a file that ends in {' or '.join(endings)}.")
        if endings is VIDEOS:
            from rbd.visual.playback.video import check_video

            check_video(path)
        if endings is FIGURES and importlib.util.find_spec("matplotlib") is None:
            raise InputError(f"{option} needs Matplotlib. Install the extra: pip install 'rbd-contact[plot]'")
        check_place(path, what=option)
        if other := taken.get(place := os.path.realpath(path)):
            raise InputError(f"{option} and {other} are one file, {str(path)!r:.300}. Give each its own.")
        if path.is_file() or not path.exists():  # two outputs may go to one device
            taken[place] = option


def save_figure(figure: Figure, path: Path, *, dpi: int) -> Path:
    """Write a figure; returns its path.

    Raises:
        InputError: the file cannot be written.
    """
    write_file(path, lambda file: figure.savefig(file, dpi=dpi, format=path.suffix[1:].lower()))
    return path


def save_drawn(draw: Callable[[], Sequence[Artist]], path: Path) -> Path:
    """Write the figure of what a record draws, given as its method; returns its path.

    Raises:
        InputError: the file cannot be written.
    """
    figure: Any = draw()[0].get_figure(root=True)
    return save_figure(figure, path, dpi=120)


def write_json(path: Path | None, report: object) -> None:
    """Write the fields of a report, if there is a path."""
    if path is not None:
        write_text(path, json.dumps(plain(report), indent=2, allow_nan=False) + "\n")


def print_report(console: Console, report: Any, path: Path | None, verbose: bool = False) -> None:
    """Print a report and, if `verbose`, how long each part took; write its fields as JSON, if there is a path."""
    write_json(path, report)
    console.print(report, highlight=False)
    if verbose:
        console.print("times  " + ", ".join(f"{what} {1e3 * t:.2f} ms" for what, t in report.seconds.items()), highlight=False)


def print_path(console: Console, what: str, where: Path | str) -> None:
    """Print where a file is; of a page also its address, on a line of its own, which a terminal opens at a click."""
    console.print(f"{what}: {where}", soft_wrap=True, highlight=False)
    if Path(where).suffix.lower() in PAGES:
        console.print(Path(where).absolute().as_uri(), soft_wrap=True, highlight=False)


def write_outputs(console: Console, *outputs: tuple[str, Path | None, Callable[[Path], object]]) -> None:
    """Write what was asked for, and print where it is.

    Args:
        console: Where.
        outputs: (what it is, its path or None, what writes it there).
    """
    for what, path, write in outputs:
        if path is not None:
            write(path)
            print_path(console, what, path)


def reached(run: Callable[[], Trajectory]) -> tuple[Trajectory, SimulationStopped | None]:
    """(the motion of a simulation, the error that ended it); one that ended before its first moment is raised."""
    try:
        return run(), None
    except SimulationStopped as error:
        if error.trajectory is None:
            raise
        return error.trajectory, error


def end(
    console: Console, motion: Trajectory, stopped: SimulationStopped | None, external: Pushes | None, *, show: bool
) -> None:
    """Play a simulated motion if asked to, and raise what ended it.

    Raises:
        SimulationStopped: what ended it.
        typer.Exit: Ctrl-C ended it.
    """
    if show:
        play(console, motion, external)
    if stopped is not None:
        raise stopped
    if motion.end_reason == Reason.INTERRUPTED:
        raise typer.Exit(INTERRUPTED)


def play(console: Console, motion: Trajectory | MotionReport, external: Pushes | None = None) -> None:
    """Serve a motion that plays, until Ctrl-C."""
    from rbd.visual.playback.animation import Playback, motion_scene

    with motion_scene(motion, Playback(external=external, playing=True)) as scene:
        serve(console, scene.open())


def serve(console: Console, url: str) -> None:
    """Print the address of a live scene, and wait until Ctrl-C."""
    console.print(f"serving at {url}; Ctrl-C ends it", soft_wrap=True, highlight=False)
    try:
        while True:
            time.sleep(3600.0)
    except KeyboardInterrupt:
        console.print("ended")


@contextmanager
def timed(seconds: dict[str, float], what: str) -> Iterator[None]:
    """Record the seconds that a block takes."""
    start = time.perf_counter()
    yield
    seconds[what] = time.perf_counter() - start


def _fail(what: str, message: str, code: int) -> NoReturn:
    _complain(what, "red", message)
    raise typer.Exit(code)


def _complain(what: str, color: str, message: str) -> None:
    open_console(errors=True).print(Text.assemble((what, color), f": {message}"), soft_wrap=True)


def _literal(cell: Any) -> Any:
    return Text(cell) if isinstance(cell, str) else cell


PackageDirs = Annotated[list[Path] | None, typer.Option(help="Folder of package:// meshes; may be repeated.")]
Json = Annotated[Path | None, typer.Option("--json", help="Write all numbers.")]
Show = Annotated[bool, typer.Option("--show", help="Serve the picture at 127.0.0.1 until Ctrl-C.")]
Feet = Annotated[
    str | None, typer.Option("--feet", metavar="A,B", help="Frames of its feet; those of the catalogue by default.")
]
Joints = Annotated[
    list[str] | None,
    typer.Option(
        "--joint", metavar="NAME=VALUE", help="A joint's angle [rad] or displacement [m]; '*knee=-1.4' of all such; may repeat."
    ),
]
Gravity = Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Gravity in the world, in m/s2; 0,0,-9.81 by default.")]
Friction = Annotated[float, typer.Option(help="Coulomb's coefficient at the feet.")]
Motion = Annotated[Path | None, typer.Option(help="Write the motion: one page that plays anywhere.")]
Law = Annotated[str, typer.Option(help="Law of contacts that slip: coulomb or convex.")]
RobotName = Annotated[str, typer.Argument(help="Name of a robot (talos, g1, ...) or path of a URDF.")]
Video = Annotated[Path | None, typer.Option(help="Write a video, .mp4 (wants ffmpeg) or .gif.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print how long each part took, too.")]
Out = Annotated[Path | None, typer.Option(help="Store every result, .zarr.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with a store that is there.")]
Workers = Annotated[int | None, typer.Option(metavar="N", help="Processes; one a core by default, 0: none but this one.")]
