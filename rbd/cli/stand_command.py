"""`rbd stand` and `rbd region`: a robot on its feet, torques that withstand a push, and where its centre of mass may be."""
# Imports are inside commands: --help takes a third of a second.

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from rbd.cli.ground_option import GroundOption, ground_of, standing_on
from rbd.cli.terminal import (
    FIGURES,
    NO_SOLUTION,
    PAGES,
    Feet,
    Friction,
    Gravity,
    Joints,
    Json,
    Law,
    Out,
    PackageDirs,
    Resume,
    RobotName,
    Show,
    Verbose,
    Workers,
    answering,
    check_outputs,
    in_gravity,
    joints_of,
    names_of,
    numbers_of,
    open_console,
    print_report,
    serve,
    timed,
    write_outputs,
)
from rbd.errors import CannotHold, InputError

if TYPE_CHECKING:
    from rbd.robots.robot import Robot

FRICTION, FACETS, LAW = 0.7, 4, "coulomb"


def stand(
    robot: RobotName,
    feet_: Feet = None,
    friction: Friction = FRICTION,
    facets: Annotated[int, typer.Option(help="Facets of the friction pyramids.")] = FACETS,
    law: Law = LAW,
    push: Annotated[str | None, typer.Option(metavar="X,Y,Z", help="Push with this world force, in newtons.")] = None,
    at: Annotated[str | None, typer.Option(metavar="FRAME", help="Frame that is pushed (the heaviest link's).")] = None,
    braced: Annotated[bool, typer.Option("--braced", help="Apply torques that withstand the push.")] = False,
    posture: Annotated[str | None, typer.Option(help="Posture by name; the catalogue's by default.")] = None,
    joint: Joints = None,
    ground: GroundOption = None,
    gravity: Gravity = None,
    package_dir: PackageDirs = None,
    html: Annotated[Path | None, typer.Option(help="Write the picture: one page that opens anywhere.")] = None,
    json_: Json = None,
    show: Show = False,
    sweep: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=FROM:TO:N", help="Study many cases: N values, or NAME=A,B,C; may repeat."),
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Draw what --sweep finds can be held, .png, .svg or .pdf.")] = None,
    out: Out = None,
    resume: Resume = False,
    workers: Workers = None,
    verbose: Verbose = False,
) -> None:
    """Stand a robot on its feet: holding torques, contact forces, residuals, and a picture.

    Finds the motor torques that hold it at rest, applies the push if there is one, finds motion and contact forces under
    the contact law, compares them with those of Gauss's least-constraint QP in ProxSuite, and prints what each foot carries.
    Of a push it says first whether any motor torques withstand it, and if none do, which limits prevent it; the exit code is
    then 1.

    With --sweep it answers that question at every combination of the values: a study, as of rbd.study. What can be swept:
    posture, friction, at, push.x, push.y, push.z, push (its size along --push), push.angle (in degrees, from x towards y),
    margin (share of friction left unused), facets (of pyramids inside the friction cones). For example:

    rbd stand talos --sweep friction=0.1:1:19 --sweep push.y=0:200:21 --at torso_2_link --png map.png
    """
    from rbd.answers.least_constraint import solve
    from rbd.cli.robot_reports import StandReport, confirming, holding
    from rbd.cli.sweeps import check_running, check_values, push_arguments, run_sweep, sweeps_of
    from rbd.model.external import ExternalForce
    from rbd.problem.cones import check_friction
    from rbd.robots.loading import load_robot
    from rbd.solvers.default import slip_law
    from rbd.statics.actuation import Actuation
    from rbd.statics.equilibrium import hold
    from rbd.statics.push_functions import heaviest_link

    console = open_console()
    with answering(stand):
        out = None if out is None else out.expanduser()  # the ~ of --out=~/push.zarr, which a shell leaves
        if sweep:
            _only(
                {"--html": html, "--show": show, "--braced": braced, "--verbose": verbose, "--gravity": gravity}
                | {"--ground": ground, "--joint": joint},
                "is of one case; --sweep has many",
            )
            _only(
                {"--facets": facets != FACETS, "--law": law != LAW},
                "has no effect on whether torques withstand a push, which --sweep asks",
            )
            swept = sweeps_of(sweep)
            _only(
                {f"--{name}": name in swept and value for name, value in (("posture", posture), ("at", at))}
                | {"--friction": "friction" in swept and friction != FRICTION},
                "is both fixed and swept; give it once",
            )
            _only({"--png": png and sum(len(values) > 1 for values in swept.values()) > 3}, "shows three dimensions at most")
            check_running(out, resume, workers, png, json_, robot)
            vector = None if push is None else numbers_of("--push", push, "newtons", names="X,Y,Z")
            same = push_arguments(swept, vector, at) | {"posture": posture, "friction": friction, "at": at}
            stands = _on_feet(load_robot(robot, package_dirs=package_dir or (), feet=names_of("--feet", feet_)))
            same = {name: value for name, value in same.items() if value is not None and name not in swept}
            check_values(stands, swept, same)
            return run_sweep(console, stands, swept, same, out=out, workers=workers, png=png, json_=json_)
        _only(
            {"--png": png, "--out": out, "--resume": resume, "--workers": workers is not None},
            "is of sweeps, and there is no --sweep",
        )
        force = _push(push, at)
        if braced and force is None:
            raise InputError("--braced came without --push X,Y,Z: there is nothing to withstand.")
        check_outputs({"--html": (html, PAGES), "--json": (json_, ())}, reads=robot)
        check_friction(friction, facets)
        slip_law(law)
        on = None if ground is None else ground_of(ground)
        seconds: dict[str, float] = {}
        with timed(seconds, "load"):
            loaded = load_robot(robot, package_dirs=package_dir or (), feet=names_of("--feet", feet_))
            loaded = in_gravity(loaded, gravity)
        _on_feet(loaded)
        with timed(seconds, "stand"):
            state = standing_on(loaded, posture, on, joints_of(joint, loaded))
            under = 0.0 if on is None else on
            feet = loaded.feet(friction, facets=facets, on=under, at=state)
        at = heaviest_link(loaded) if at is None else at
        external = [] if force is None else [ExternalForce(at, force)]
        for e in external:
            loaded.frame(e.frame)  # an unknown frame is refused before anything is computed
        with timed(seconds, "hold"):
            against = holding(state, feet, external) if external else None
            if braced and isinstance(against, CannotHold):
                raise against
            held = against if braced and isinstance(against, Actuation) else hold(state, feet)
        with timed(seconds, "solve"):
            solution = solve(state, held.tau, feet, law=law, external=external)
            solution.residuals  # noqa: B018  the certificate is part of the answer
        with timed(seconds, "confirm"):
            confirmed = confirming(solution, partial(solve, state, held.tau, feet, law="convex", external=external))
        report = StandReport(held, solution, force, at, seconds, against, braced, confirmed)
        print_report(console, report, json_, verbose)
        if html is not None or show:
            from rbd.visual import Scene

            with Scene(loaded) as scene:
                scene.show(state, solution, external=external)
                write_outputs(console, ("picture", html, scene.export))
                if show:
                    from rbd.cli.live_standing import Standing
                    from rbd.visual.live import explore

                    live = Standing(scene, loaded, state, facets, under)
                    with explore(scene, live.controls(force, at, friction, law, braced), live.answer) as page:
                        serve(console, page.open())
        if isinstance(against, CannotHold):
            raise typer.Exit(NO_SOLUTION)


def region(
    robot: RobotName,
    torque_limits: Annotated[bool, typer.Option("--torque-limits", help="Keep motors within their limits.")] = False,
    friction: Friction = 0.7,
    margin: Annotated[float, typer.Option(help="Share of friction to leave unused.")] = 0.0,
    posture: Annotated[str | None, typer.Option(help="Posture by name; the catalogue's by default.")] = None,
    joint: Joints = None,
    ground: GroundOption = None,
    gravity: Gravity = None,
    package_dir: PackageDirs = None,
    png: Annotated[Path | None, typer.Option(help="Draw it from above, .png, .svg or .pdf.")] = None,
    json_: Json = None,
    verbose: Verbose = False,
) -> None:
    """Compute the support region: where the centre of mass can be for a robot to stand on its feet, with its certificate.

    For example: rbd region talos --torque-limits --png region.png
    """
    from rbd.cli.robot_reports import draw, report_region

    console = open_console()
    with answering(region):
        check_outputs({"--png": (png, FIGURES), "--json": (json_, ())}, reads=robot)
        report = report_region(
            robot, package_dir or (), posture, friction=friction, margin=margin, torque_limits=torque_limits, gravity=gravity,
            ground=None if ground is None else ground_of(ground), joints=joint,
        )  # fmt: skip
        print_report(console, report, json_, verbose)
        write_outputs(console, ("picture", png, partial(draw, report.regions)))


def _push(push: str | None, at: str | None) -> np.ndarray | None:
    if push is None:
        if at is not None:
            raise InputError("--at came without --push X,Y,Z; a push is e.g. --push 0,80,0 --at torso_2_link.")
        return None
    return numbers_of("--push", push, "newtons", names="X,Y,Z")


def _only(options: Mapping[str, object], why: str) -> None:
    """Refuse options that are given where they have no meaning."""
    for option, given in options.items():
        if given:
            raise InputError(f"{option} {why}.")


def _on_feet(robot: Robot) -> Robot:
    """The robot, if its feet are known."""
    if not robot.source.feet:
        raise InputError(
            f"no feet are known for {robot.name}, so that it cannot stand; `rbd robots` lists those that do. Or name the "
            "frames of its feet: --feet A,B."
        )
    return robot
