"""Robots in contact, from the command line.

Exit codes: 0 done, 1 no solution (the message names the limit that prevents it), 2 bad input, 130 interrupted,
with something left out.
"""
# Imports are inside commands: --help takes a third of a second.

from __future__ import annotations

import math
import os
import platform
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from rbd.cli.audit_command import audit
from rbd.cli.check_command import check
from rbd.cli.ground_option import GroundOption, ground_of
from rbd.cli.options import Completing, in_panels
from rbd.cli.stand_command import region, stand
from rbd.cli.terminal import (
    FIGURES,
    PAGES,
    TRAJECTORIES,
    VIDEOS,
    Feet,
    Friction,
    Gravity,
    Joints,
    Json,
    Law,
    Motion,
    PackageDirs,
    RobotName,
    Show,
    Verbose,
    Video,
    answering,
    check_outputs,
    end,
    in_gravity,
    names_of,
    open_console,
    print_report,
    reached,
    serve,
    timed,
    write_outputs,
)
from rbd.cli.verify_command import verify
from rbd.cli.walk_command import walk
from rbd.errors import InputError, ModelWarning
from rbd.installation import VERSION

MOST_SAMPLES = 10_000
"""Largest number of recorded samples by default."""


app = typer.Typer(help=__doc__, no_args_is_help=True, pretty_exceptions_enable=False)


def _print_version(wanted: bool) -> None:
    if wanted:
        import pinocchio

        versions = f"rbd {VERSION} (Python {platform.python_version()}, pin {pinocchio.__version__})"
        open_console().print(versions, highlight=False)
        raise typer.Exit


@app.callback()
def rbd(
    version_: Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print it.")] = False,
) -> None:
    """Robots in contact, from the command line. Exit codes: 0 done, 1 no solution, 2 bad input, 130 interrupted."""


def _command(function: Callable[..., None]) -> Callable[..., None]:
    """A command with panels of options and completion."""
    return app.command(cls=Completing)(in_panels(function))


for _each in (stand, region, check, walk, audit, verify):
    _command(_each)


@app.command()
def robots() -> None:
    """List the robots: name, degrees of freedom, mass, postures, feet, and whether it stands as it is loaded."""
    from rbd.cli.robot_reports import robot_lines, robots_table
    from rbd.kernels import few_more
    from rbd.robots import catalogue
    from rbd.simulation.progress_bar import progress_of

    console = open_console()
    with answering(robots):
        names = catalogue.robots()
        few_more(200 * len(names))  # a stance takes 130
        with progress_of(range(len(names) + 1), doing="loading") as loaded:  # no thread: beside one, kernels are compiled
            lines = []
            for line in robot_lines(names):
                lines.append(line)
                loaded(len(lines))
        stand_ = sum(line.stands == "yes" for line in lines)
        console.print(f"{len(lines)} robots; {stand_} of them stand on their feet as they are loaded.", highlight=False)
        console.print(robots_table(lines))


@_command
def info(
    robot: RobotName,
    root: Annotated[str | None, typer.Option(help="Base: free_flyer, planar or fixed; as its loop file says.")] = None,
    beside: Annotated[
        str | None, typer.Option(metavar="FILE", help="Another file of the same robot: list the numbers that differ.")
    ] = None,
    package_dir: PackageDirs = None,
) -> None:
    """Show one robot's joints, limits, frames, effort limits, mass, and what the model validation (`doctor`) found."""
    from rbd.cli.robot_reports import robot_info
    from rbd.robots.loading import load_robot

    console = open_console()
    with answering(info):
        with warnings.catch_warnings(action="ignore", category=ModelWarning):  # the doctor's findings are printed below in full
            loaded = load_robot(robot, root=_root(root), package_dirs=package_dir or ())
            other = None if beside is None else load_robot(beside, package_dirs=package_dir or ())
        console.print(robot_info(loaded, other), soft_wrap=False)


@_command
def mechanism(
    file: Annotated[str, typer.Argument(help="Path of a URDF (its loops in FILE.loops.yaml) or MJCF, or name of a robot.")],
    posture: Annotated[str | None, typer.Option(help="Posture by name to start from; the file's first by default.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the random starts that look for branches.")] = 0,
    tries: Annotated[int, typer.Option(help="Number of random starts.")] = 200,
    package_dir: PackageDirs = None,
    html: Annotated[Path | None, typer.Option(help="Write the picture with every branch: one page.")] = None,
    json_: Json = None,
    show: Show = False,
) -> None:
    """Analyse a mechanism: bodies, joints, loops, mobility three ways, branches, singular poses.

    Constraints of velocity (wheels, knife edges) are tested for integrability. Every branch is drawn.
    """
    from rbd.cli.mechanism_report import check_tries, report_mechanism
    from rbd.robots.loading import load_robot

    console = open_console()
    with answering(mechanism):
        check_outputs({"--html": (html, PAGES), "--json": (json_, ())}, reads=file)
        check_tries(seed, tries)
        loaded = load_robot(file, package_dirs=package_dir or ())
        name = posture if posture is not None else next(iter(loaded.postures), None)
        q = loaded.at().q if name is None else loaded.at(name).q
        report = report_mechanism(loaded, q, seed=seed, tries=tries)
        print_report(console, report, json_)
        if html is not None or show:
            from rbd.visual import Scene

            with Scene(loaded) as scene:
                scene.show(report.state)
                details, note = report.legend()
                scene.beside(report.poses(), shown=report.shown, details=details, note=note)
                write_outputs(console, ("picture", html, scene.export))
                if show:
                    serve(console, scene.open())


@_command
def simulate(
    robot: Annotated[str, typer.Argument(help="Name of a robot (talos, ur5, ...) or path of a URDF (urdf/four_bar.urdf).")],
    duration: Annotated[float, typer.Option(help="Seconds to simulate.")] = 2.0,
    step: Annotated[float, typer.Option(help="Length of a step, in seconds.")] = 1e-3,
    push: Annotated[list[str] | None, typer.Option(metavar="X,Y,Z", help="Push with this world force, in newtons.")] = None,
    at: Annotated[list[str] | None, typer.Option(metavar="FRAME", help="Frame at whose origin it is pushed.")] = None,
    from_: Annotated[list[float] | None, typer.Option("--from", metavar="S", help="Start of the push (0).")] = None,
    for_: Annotated[list[float] | None, typer.Option("--for", metavar="S", help="Its duration (0.1); may repeat.")] = None,
    feet_: Feet = None,
    friction: Friction = 0.7,
    law: Law = "coulomb",
    hold_: Annotated[
        bool | None, typer.Option("--hold/--free", help="Hold the posture by motors, or leave them off; --free of mechanisms.")
    ] = None,
    bodies: Annotated[
        bool | None, typer.Option("--bodies/--feet-only", help="Let all shapes touch the ground, as of a robot on feet.")
    ] = None,
    stops: Annotated[bool, typer.Option("--stops", help="Let joints stop at the limits of the robot's file.")] = False,
    posture: Annotated[str | None, typer.Option(help="Posture by name to start from; the standing or first one.")] = None,
    joint: Joints = None,
    ground: GroundOption = None,
    root: Annotated[str | None, typer.Option(help="Base: free_flyer, planar or fixed; arms are fixed by default.")] = None,
    gravity: Gravity = None,
    package_dir: PackageDirs = None,
    save: Annotated[Path | None, typer.Option(help="Write the trajectory, .npz or .nc.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw forces and energy over time, .png, .svg or .pdf.")] = None,
    html: Motion = None,
    video: Video = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Write all numbers of the report.")] = None,
    show: Annotated[bool, typer.Option("--show", help="Play it at 127.0.0.1 until Ctrl-C.")] = False,
    verbose: Verbose = False,
) -> None:
    """Simulate a robot: on its feet, holding its posture; a mechanism, swinging; an arm, held; with pushes.

    Contacts stick, slip, lift and impact; loops and wheels are constraints. Prints the final state, the events, energy,
    residuals, and what the model neglects. Ctrl-C ends it early and keeps the motion until then. For example:

    rbd simulate talos --push 0,20,0 --at torso_2_link --from 0.2 --for 0.1 --html push.html
    """
    from rbd.cli.simulate_report import SimulateReport, draw, loaded, pushes, setup
    from rbd.control.schedules import Pushes
    from rbd.problem.cones import check_friction
    from rbd.simulation.run import simulate as run
    from rbd.solvers.default import slip_law

    console = open_console()
    with answering(simulate):
        pushed = pushes(push or (), at or (), from_ or (), for_ or ())
        save = None if save is None else Path(os.path.expanduser(save))  # a shell leaves the ~ of --save=~/x.npz
        files = {"--save": (save, TRAJECTORIES), "--plot": (plot, FIGURES), "--html": (html, PAGES), "--json": (json_, ())}
        check_outputs({**files, "--video": (video, VIDEOS)}, reads=robot)
        check_friction(friction, 4)
        slip_law(law)
        on = None if ground is None else ground_of(ground)
        seconds: dict[str, float] = {}
        with timed(seconds, "load"):
            found = loaded(robot, root=_root(root), package_dirs=package_dir or (), feet=names_of("--feet", feet_))
            found = in_gravity(found, gravity)
        for p in pushed:
            found.frame(p.frame)  # an unknown frame is refused before anything is computed
        with timed(seconds, "set up"):
            given = setup(
                found, posture=posture, friction=friction, hold=hold_, bodies=bodies, stops=stops, ground=on, joints=joint
            )
        external = Pushes(pushed) if pushed else None
        with timed(seconds, "simulate"):
            trajectory, stopped = reached(
                partial(
                    run, given.state, given.constraints, duration=duration, step=step, controller=given.controller,
                    external=external, law=law, record_every=_every(duration, step),
                )
            )  # fmt: skip
        print_report(console, SimulateReport(trajectory, given, pushed, seconds), json_, verbose)
        plays = len(trajectory) > 1
        write_outputs(
            console,
            ("trajectory", save, trajectory.save),
            ("plot", plot, partial(draw, trajectory)),
            ("picture", html if plays else None, partial(trajectory.export, external=external)),
            ("video", video if plays else None, partial(trajectory.video, external=external)),
        )
        end(console, trajectory, stopped, external, show=show and plays)


@_command
def plane(
    from_: Annotated[str, typer.Option("--from", metavar="X,Y", help="Start of the path of the end point, in metres.")],
    to: Annotated[str, typer.Option(metavar="X,Y", help="End of the path, in metres.")],
    links: Annotated[int | None, typer.Option(help="Number of links; as many as lengths, or two.")] = None,
    lengths: Annotated[str | None, typer.Option(metavar="L1,L2,..", help="Lengths of links, in metres; together 1 m.")] = None,
    angles: Annotated[str, typer.Option(help="Measure of angles: joint, segment or vertical.")] = "joint",
    duration: Annotated[float, typer.Option(help="Seconds from rest to rest.")] = 1.0,
    branch: Annotated[int, typer.Option(help="Bend of two links: 0 counterclockwise, 1 clockwise.")] = 0,
    space: Annotated[str | None, typer.Option(help="Space of the straight path: endpoint, or joint (of one link).")] = None,
    out: Annotated[Path | None, typer.Option(help="Draw the motion, .png, .svg or .pdf.")] = None,
    html: Motion = None,
    json_: Json = None,
) -> None:
    """Move a planar chain from point to point with the least jerk: reach, branches, singular poses, peaks, a picture.

    The base is at the origin. For example: rbd plane --links 2 --from 1,0 --to 0.5,0.5 --out plane.png
    """
    console = open_console()
    with answering(plane):
        try:
            from rbd.cli.plane_report import PlaneReport, draw, page, plane_task
        except ImportError as error:  # SymPy is an extra
            raise InputError(str(error)) from None
        check_outputs({"--out": (out, FIGURES), "--html": (html, PAGES), "--json": (json_, ())})
        task = plane_task(
            from_, to, links=links, lengths=lengths, angles=angles, duration=duration, branch=branch, space=space
        )  # fmt: skip
        console.print(str(task), highlight=False)
        motion = task.motion()
        print_report(console, PlaneReport(task, motion), json_)
        write_outputs(console, ("picture", out, partial(draw, motion)), ("page", html, partial(page, motion)))


@app.command("warm-up")
def warm_up() -> None:
    """Compile ahead, once for this machine, what the first processes would else pause for: one to two minutes.

    It is kept beside the package, else in the user's cache, or in the folder that NUMBA_CACHE_DIR names.
    """
    from rbd import kernels
    from rbd.installation import in_use

    console, seconds = open_console(), dict[str, float]()
    with answering(warm_up):
        if not in_use():
            raise InputError("RBD_COMPILED=0, or NUMBA_DISABLE_JIT=1, is in the environment: nothing is compiled. Unset it.")
        with timed(seconds, "compile"):
            kernels.warm_up()
            _first_answers()
        compiled, kept = kernels.warm_up(), kernels.folders()
        took = f"{len(compiled)} functions compiled in {seconds['compile']:.0f} s" if compiled else "nothing is left to compile"
        console.print(f"{took}; kept in {', '.join(kept) or 'no folder'}", highlight=False, soft_wrap=True)
        if not kept:
            raise InputError(
                "neither the package's folder nor the user's cache can be written, so every process compiles again. "
                "Try: NUMBA_CACHE_DIR=a/folder in the environment, here and later."
            )


def _first_answers() -> None:
    """What compiles the functions that are compiled for the arguments of their first call."""
    import numpy as np

    from rbd.answers.least_constraint import solve
    from rbd.constraints import CollisionContacts
    from rbd.model.state import State
    from rbd.robots.loading import load_robot
    from rbd.simulation.run import simulate as run

    solo = load_robot("solo12")
    state, tau = solo.standing(), np.zeros(solo.nu)
    for friction in (None, 0.7, 0.01):
        solve(state, tau, solo.feet(friction=friction))
    falling = State(solo, state.q, np.full(solo.nv, 0.3))
    for start, constraints in ((state, solo.feet()), (falling, [CollisionContacts("floor", solo)])):
        run(start, constraints, duration=0.004, step=0.002)


def _every(duration: float, step: float) -> int:
    """Number of steps between records; one for an invalid motion, which `simulate` refuses."""
    if not (0.0 < step < math.inf and 0.0 < duration < math.inf):
        return 1
    return max(1, math.ceil(min(duration / step, 1e12) / MOST_SAMPLES))


def _root(root: str | None) -> Literal["free_flyer", "fixed", "planar"] | None:
    from rbd.robots.loop_file import ROOTS

    for known in ROOTS:
        if root == known:
            return known
    if root is not None:
        raise InputError(f"--root is {root!r}; expected {', '.join(ROOTS)}.")
    return None


def main() -> None:
    """Run the command line."""
    app()
