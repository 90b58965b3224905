"""`rbd study push.toml`, and the study that `rbd stand --sweep` asks for: run, stored, reported, drawn."""
# Imports are inside commands: --help takes a third of a second.

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from rbd.cli.options import Dask, Out, Resume, Workers
from rbd.cli.terminal import (
    FIGURES,
    INTERRUPTED,
    NO_SOLUTION,
    answering,
    check_outputs,
    open_console,
    print_path,
    save_figure,
    write_json,
)
from rbd.errors import InputError, ModelWarning, StudyStopped

if TYPE_CHECKING:
    import xarray

    from rbd.cli.study_plan import StudyPlan

STORES = (".zarr", ".nc")
DASK_SECONDS = 10
"""How long a scheduler may take to answer."""


@dataclass(frozen=True)
class Running:
    """How a study is run, and what is written.

    Attributes:
        out: The store, or None.
        resume: Whether a store that is there is gone on with.
        workers: How many processes; None: as many as cores, 0: none but this one.
        dask: Address of a scheduler, in place of own processes; or None.
        png: The picture, or None.
        json_: The numbers of the report, or None.
    """

    out: Path | None = None
    resume: bool = False
    workers: int | None = None
    dask: str | None = None
    png: Path | None = None
    json_: Path | None = None

    @classmethod
    def of(
        cls,
        out: Path | None,
        resume: bool,
        workers: int | None,
        dask: str | None,
        png: Path | None,
        json_: Path | None,
    ) -> Running:
        """With the ~ of `--out=~/push.zarr`, which a shell leaves, as the home folder."""
        return cls(None if out is None else out.expanduser(), resume, workers, dask, png, json_)

    def check(self, reads: str | None) -> None:
        """Refuse what cannot be, before anything is computed.

        Raises:
            InputError: paths that cannot be written, a store that is there without --resume, options that exclude each other.
        """
        if self.workers is not None and self.workers < 0:
            raise InputError(f"--workers is {self.workers}; expected how many processes, 0 for none but this one.")
        if self.workers is not None and self.dask is not None:
            raise InputError("--workers and --dask came both; give one of them: --dask has its own workers.")
        if self.resume and self.out is None:
            raise InputError("--resume came without --out FILE.zarr, the store to go on with.")
        check_outputs({"--png": (self.png, FIGURES), "--json": (self.json_, ())}, reads=reads)
        if self.out is not None:
            if self.out.suffix not in STORES:
                raise InputError(f"--out is {str(self.out)!r:.300}; expected a store that ends in {' or '.join(STORES)}.")
            if self.exists() and not self.resume:
                raise InputError(
                    f"--out is {str(self.out)!r:.300}, which is there. Go on with it by --resume, or give another name."
                )
            if not self.exists():
                check_outputs({"--out": (self.out, STORES)})

    def exists(self) -> bool:
        """Whether there is something where the study is to be stored."""
        return self.out is not None and self.out.exists()


def study(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="The study: robot, question, samples; see below.")],
    out: Out = None,
    resume: Resume = False,
    workers: Workers = None,
    dask: Dask = None,
    png: Annotated[Path | None, typer.Option(help="Draw the results, .png, .svg or .pdf, as its plot table says.")] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write the numbers of the report.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of random numbers, in place of the file's.")] = None,
) -> None:
    r"""Evaluate a question about a robot, or a function, at many samples: a study, described by a TOML file.

    The question "stand" asks whether any motor torques withstand a push, "solve" how the robot moves under the torques that
    hold it unpushed. A file:

    question = "stand"
    robot = "talos"
    \[samples]
    friction = "0.1:1:19"   # 19 values from 0.1 to 1
    push.y = "0:200:21"     # every combination is a sample
    \[fixed]
    at = "torso_2_link"

    What can differ, or be fixed: robot, posture, friction, at, push.x, push.y, push.z, push (its size), push.angle, margin,
    facets, law; and fixed also feet, direction. Lists are values, too: friction = \[0.2, 0.5].
    In place of \[samples], \[draws] has n and method (sobol, latin_hypercube, random), \[draws.ranges] friction = \[0.1, 1].
    Further keys: keep = \["forces"], seed = 0; and x, y, value, by in \[plot].

    With function = "my_module.py:push" in place of a question your function is called with each sample; that file is
    imported, and so executed. Nothing else of a study file is.

    Ctrl-C keeps what is finished; with --out, the same command and --resume goes on. Exit codes: 0 done, 1 no sample has a
    result, 2 bad input, 130 interrupted, with samples left out. For example:

    rbd study push.toml --out push.zarr --png push.png
    """
    from rbd.cli.study_file import StudyFile

    console = open_console()
    with answering(study):
        running = Running.of(out, resume, workers, dask, png, json_)
        running.check(str(file))
        if seed is not None and seed < 0:
            raise InputError(f"--seed is {seed}; expected a whole number, zero or more.")
        run_study(console, StudyFile(file).plan(seed), running)


def run_study(console: Console, plan: StudyPlan, running: Running) -> None:
    """Run a study, print its report, write what is asked for.

    Args:
        console: Where the report is printed.
        plan: The study.
        running: Where it is computed and stored; checked.

    Raises:
        typer.Exit: with the code 1 where no sample has a result, 130 after Ctrl-C with samples left out.
        StudyStopped: it ended early; the report of what is done was printed.
        InputError: as `rbd.study`.
    """
    from rbd.cli.study_plan import plot_of
    from rbd.cli.study_report import StudyReport
    from rbd.studies.running import study as evaluate

    resumed, out = running.exists(), running.out
    plotted = {} if running.png is None else plot_of(plan)
    began = time.perf_counter()
    stopped: StudyStopped | None = None
    with executor_of(running, plan) as executor, warnings.catch_warnings():
        if not plan.module:  # robots were loaded before, and what is wrong with their files was told
            warnings.simplefilter("ignore", ModelWarning)
        try:
            dataset = evaluate(
                plan.function, plan.samples, keep=plan.keep, executor=executor, out=out,
                seed=plan.seed, batched=plan.batched,
            )  # fmt: skip
        except StudyStopped as error:
            if error.dataset is None:
                raise
            dataset, stopped = error.dataset, error
        except KeyboardInterrupt:  # a second one, or before the first sample
            open_console(errors=True).print(f"Ended at once. {_how_to_go_on(out)}", highlight=False, soft_wrap=True)
            raise typer.Exit(INTERRUPTED) from None
    report = StudyReport(plan, dataset, time.perf_counter() - began, resumed)
    console.print(report)
    write_json(running.json_, report)
    if out is not None:
        print_path(console, "store", out)
    if running.png is not None and report.run.any():
        print_path(console, "picture", draw(dataset, plotted, running.png))
    if stopped is not None:
        raise stopped
    if report.interrupted:
        console.print(f"Ended by Ctrl-C. {_how_to_go_on(out)}", highlight=False, soft_wrap=True)
        raise typer.Exit(INTERRUPTED)
    if not report.ok.any():
        raise typer.Exit(NO_SOLUTION)


@contextmanager
def executor_of(running: Running, plan: StudyPlan) -> Iterator[Executor | int | None]:
    """What `rbd.study` takes as its executor; one of dask is closed afterwards.

    Raises:
        InputError: distributed is not installed, or no scheduler answers at the address.
    """
    if running.dask is None:
        yield running.workers
        return
    try:
        import cloudpickle
        import distributed
    except ImportError:
        raise InputError(
            "--dask wants the package distributed. Install the extra: pip install 'rbd-contact[cluster]'"
        ) from None
    try:
        client = distributed.Client(running.dask, timeout=DASK_SECONDS)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--dask is {running.dask!r:.200}, where no scheduler answers within {DASK_SECONDS} s ({_first_line(error)}). "
            "Start one (dask scheduler), and give the address that it prints, tcp://host:8786."
        ) from None
    if plan.module:  # other machines do not have the users' file
        import sys

        cloudpickle.register_pickle_by_value(sys.modules[plan.module])
    try:
        yield client.get_executor()
    finally:
        client.close()


def draw(dataset: xarray.Dataset, plotted: Mapping[str, str], path: Path) -> Path:
    """The picture of a study; returns where it is.

    Raises:
        InputError: what cannot be drawn, or not be written.
    """
    from rbd.visual import plot_study

    drawn: Any = plot_study(dataset, *(plotted.get(name) for name in ("x", "y", "value", "by")))[0]
    return save_figure(drawn.figure, path, dpi=130)


def _how_to_go_on(out: Path | None) -> str:
    if out is None:
        return "Nothing is stored; --out FILE.zarr would keep it."
    return f"What was finished is in {out}; the same command with --resume goes on."


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
