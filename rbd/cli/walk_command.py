"""`rbd walk`: a robot walks by `rbd.control.Walk`, on level ground, stairs, slopes and terrain, pushed or not."""
# Imports are inside the command: --help takes a third of a second.

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rbd.cli.ground_option import TerrainOption, ground_of
from rbd.cli.terminal import (
    FIGURES,
    LOGS,
    PAGES,
    TRAJECTORIES,
    VIDEOS,
    Feet,
    Friction,
    Json,
    Motion,
    PackageDirs,
    RobotName,
    Verbose,
    Video,
    answering,
    check_outputs,
    end,
    names_of,
    numbers_of,
    open_console,
    print_report,
    reached,
    save_drawn,
    timed,
    write_outputs,
)


def walk(
    robot: RobotName,
    steps: Annotated[int, typer.Option(help="Number of times a foot (of four: a group of the gait) is lifted.")] = 6,
    velocity: Annotated[
        str | None,
        typer.Option(metavar="X,Y,TURN", help="Velocity forwards and left, in m/s, turn in rad/s; as usual of the gait."),
    ] = None,
    gait: Annotated[str | None, typer.Option(help="Gait: walk of two feet; crawl, trot, pace or bound of four.")] = None,
    terrain: TerrainOption = None,
    friction: Friction = 0.6,
    push: Annotated[list[str] | None, typer.Option(metavar="X,Y,Z", help="Push with this world force, in newtons.")] = None,
    at: Annotated[list[str] | None, typer.Option(metavar="FRAME", help="Frame at whose origin it is pushed.")] = None,
    from_: Annotated[list[float] | None, typer.Option("--from", metavar="S", help="Start of the push (0).")] = None,
    for_: Annotated[list[float] | None, typer.Option("--for", metavar="S", help="Its duration (0.1); may repeat.")] = None,
    step: Annotated[float, typer.Option(help="Length of a step of the simulation, in seconds.")] = 2e-3,
    feet_: Feet = None,
    package_dir: PackageDirs = None,
    save: Annotated[Path | None, typer.Option(help="Write the trajectory, .npz or .nc.")] = None,
    log: Annotated[Path | None, typer.Option(help="Write what the controller did at each step, .npz.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the plan: footsteps, feet, stays, .png, .svg or .pdf.")] = None,
    torques: Annotated[Path | None, typer.Option(help="Draw torques against their limits, .png, .svg or .pdf.")] = None,
    html: Motion = None,
    video: Video = None,
    json_: Json = None,
    show: Annotated[bool, typer.Option("--show", help="Play it at 127.0.0.1 until Ctrl-C.")] = False,
    verbose: Verbose = False,
) -> None:
    """Walk: footsteps, timing and motion of the centre of mass are planned, and the walk is simulated.

    Forwards, sideways, turning, up and down stairs and slopes; pushes are taken up by steps. Prints how far it came, steps of
    control that violated a limit, the largest torques and friction, and how far feet are from where they were planned. The
    page has the forces and the footprints of the plan. For example:

    rbd walk talos --steps 6 --terrain stairs --html walk.html
    """
    from rbd.cli.simulate_report import loaded, pushes
    from rbd.cli.walk_report import WalkReport
    from rbd.control.schedules import Pushes
    from rbd.control.walking.walk import Walk
    from rbd.simulation.run import simulate as run

    console = open_console()
    with answering(walk):
        pushed = pushes(push or (), at or (), from_ or (), for_ or ())
        figures = {"--plot": (plot, FIGURES), "--torques": (torques, FIGURES)}
        files = {
            "--save": (save, TRAJECTORIES),
            "--log": (log, LOGS),
            "--html": (html, PAGES),
            "--json": (json_, ()),
            **figures,
        }
        check_outputs({**files, "--video": (video, VIDEOS)}, reads=robot)
        wanted = None if velocity is None else numbers_of("--velocity", velocity, "m/s, m/s and rad/s", names="X,Y,TURN")
        seconds: dict[str, float] = {}
        with timed(seconds, "load"):
            found = loaded(robot, package_dirs=package_dir or (), feet=names_of("--feet", feet_))
        for p in pushed:
            found.frame(p.frame)  # an unknown frame is refused before anything is computed
        with timed(seconds, "plan"):
            on = 0.0 if terrain is None else ground_of(terrain, "--terrain", found)
            controller = Walk(found, steps, wanted, terrain=on, gait=gait, friction=friction)
        external, first = Pushes(pushed) if pushed else None, controller.plan
        with timed(seconds, "simulate"):
            trajectory, stopped = reached(
                partial(
                    run, controller.state, controller.contacts, duration=controller.duration, step=step, controller=controller,
                    external=external,
                )
            )  # fmt: skip
        plans = [(0.0, first), *controller.plans]
        print_report(console, WalkReport(trajectory, controller, first, pushed, seconds), json_, verbose)
        plays = len(trajectory) > 1
        write_outputs(
            console,
            ("trajectory", save, trajectory.save),
            ("log", log, controller.log.save),
            ("plan", plot, partial(save_drawn, first.plot)),
            ("torques", torques, partial(save_drawn, controller.log.plot)),
            ("picture", html if plays else None, partial(trajectory.export, external=external, plan=plans)),
            ("video", video if plays else None, partial(trajectory.video, external=external)),
        )
        end(console, trajectory, stopped, external, show=show and plays)
