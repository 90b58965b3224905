"""Makes docs/pictures/*.png: `make pictures`, with Chromium on PATH."""

import contextlib
import importlib
import io
import itertools
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import planar_pictures
import task_pictures
from matplotlib.figure import Figure
from PIL import Image

import rbd
from rbd.cli.mechanism_report import report_mechanism
from rbd.visual import Scene, contact_sheet, motion_sheet, plot_region, screenshot
from rbd.visual.plots import frame

PICTURES = Path(__file__).resolve().parent
TOP = PICTURES.parents[1]
STANDING = ("talos", "g1", "romeo", "icub", "human", "solo12", "anymal_c", "go2", "bolt")
MECHANISMS = (
    *("four_bar", "slider_crank", "five_bar", "six_bar", "parallel_leg"),
    *("unicycle", "two_wheeled", "bicycle", "rolling_disk"),
)


def talos() -> Path:
    """The README's first screen: Talos pushed at its torso, with the forces of the README's code."""
    robot = rbd.load_robot("talos")
    state, soles = robot.standing(), robot.soles(friction=0.7)
    push = rbd.ExternalForce("torso_2_link", (0.0, 80.0, 0.0))
    solution = rbd.solve(state, rbd.hold(state, soles).tau, soles, external=push)
    with tempfile.TemporaryDirectory() as folder, Scene(robot) as scene:
        scene.show(state, solution, external=push)
        page = scene.export(Path(folder) / "talos.html")
        return screenshot(page, PICTURES / "talos.png", width=1100, height=900)


def poses() -> Path:
    """Three poses of `docs/reference/poses.md`, each held by its feet."""
    talos, g1, width, height = rbd.load_robot("talos"), rbd.load_robot("g1"), 500, 560
    step = {"left_sole": (0.15, 0.12, 0.0), "right_sole": (-0.1, -0.12, 0.0), "gripper_left_base_link": (0.55, 0.35, 1.25)}
    standing = g1.standing()
    stay = {sole.name: standing.frame(sole.frame).X_WF * sole.placement for sole in g1.soles()}
    stair = {"left_sole": (0.3, 0.085, 0.17), "right_sole": (0.0, -0.085, 0.0)}
    made = (
        (rbd.find_pose(talos, step, com=(0.02, 0.0)), talos.soles()),
        (rbd.find_pose(g1, stay, com=standing.com - [0.0, 0.0, 0.2]), g1.soles()),
        (rbd.find_pose(talos, stair, com=(0.15, 0.0)), talos.soles(on={"left_sole": 0.17})),
    )
    sheet = Image.new("RGB", (3 * width, height), "white")
    with tempfile.TemporaryDirectory() as folder:
        for i, (found, soles) in enumerate(made):
            solution = rbd.solve(found.state, rbd.hold(found.state, soles).tau, soles)
            with Scene(found.state.robot, legend=False) as scene:
                scene.show(found.state, solution)
                page = scene.export(Path(folder) / f"{i}.html")
            shot = Image.open(screenshot(page, Path(folder) / f"{i}.png", width=width, height=height))
            sheet.paste(shot.resize((width, height)), (width * i, 0))
    sheet.save(PICTURES / "poses.png")
    return PICTURES / "poses.png"


def hand_on_a_wall() -> Path:
    """Example 24: Talos pushed towards the wall, its hand there, and the support regions on the ground."""
    result = _result("24_hand_on_a_wall")
    held = result.held
    with tempfile.TemporaryDirectory() as folder, Scene(held.state.robot) as scene:
        scene.show(held.state, held, external=rbd.ExternalForce("torso_2_link", (0.0, 140.0, 0.0)))
        scene.draw(*result.regions["soles and hand"])
        page = scene.export(Path(folder) / "hand.html")
        return screenshot(page, PICTURES / "hand_on_a_wall.png", width=1000, height=820)


def where_it_can_stand() -> Path:
    """Support regions of Talos from above, and its largest pushes all around."""
    robot = rbd.load_robot("talos")
    state, soles = robot.standing(), robot.soles(friction=0.7)
    wall = rbd.Ground(normal=(0.0, -1.0, 0.0))
    contacts = [*soles, rbd.PointContact("hand", "gripper_left_base_link", on=wall, friction=0.5)]
    regions = {
        "with the hand": rbd.statics.support_region(state, contacts),
        "with the hand, within torque limits": rbd.statics.support_region(state, contacts, torque_limits=True),
        "soles alone": rbd.statics.support_region(state, soles),
    }
    angle = np.arange(72) * 2.0 * np.pi / 72
    ways = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    figure = Figure(figsize=(12.0, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot_region(left, *regions.values(), labels=list(regions))
    rbd.statics.push_limits(state, contacts, "torso_2_link", ways).plot(right)
    figure.savefig(PICTURES / "where_it_can_stand.png", dpi=110, metadata={"Software": None})
    return PICTURES / "where_it_can_stand.png"


def plot(picture: str, example: str, draw: str, size: tuple[float, float], *axes: int, sharex: bool = False) -> Path:
    """A plot of an example, drawn on axes of ours by the example's own function."""
    figure = Figure(figsize=size, layout="constrained")
    getattr(_example(example), draw)(figure.subplots(*axes, sharex=sharex), _result(example))
    figure.savefig(PICTURES / f"{picture}.png", dpi=110, metadata={"Software": None})
    return PICTURES / f"{picture}.png"


def plots() -> Iterator[Path]:
    """The plots of the examples."""
    yield plot("push", "02_push", "plot_push", (7.0, 4.2))
    yield plot("two_laws", "04_two_laws", "plot_laws", (8.6, 3.8), 1, 2)
    yield plot("sensitivities", "07_sensitivities", "plot_sensitivity", (7.0, 4.2))
    yield plot("unique", "08_what_is_unique", "draw", (8.0, 6.4), 2, sharex=True)
    yield plot("slider_crank", "11_slider_crank", "plot_turn", (7.0, 6.0), 3, 1, sharex=True)
    yield plot("sleigh", "13_sleigh", "plot_flow", (6.4, 5.0))
    yield plot("push_recovery", "14_push_recovery", "plot_pushes", (7.5, 6.0), 2, 1)
    yield plot("four_bar_swing", "15_four_bar_swing", "plot_swing", (7.0, 6.0), 2, 1)
    yield plot("coin", "16_rolling_disk", "plot_lean", (7.0, 4.0))
    yield plot("sliding_box", "17_sliding_box", "plot_slide", (7.0, 6.0), 2, 1)


def strips() -> Iterator[Path]:
    """Motions of the examples, side by side."""
    push = _example("14_push_recovery")
    fall = _result("14_push_recovery").ways[250.0]
    seen, size = (1.0, 0.25, 0.2), {"width": 300, "height": 420}
    yield motion_sheet(
        fall, [0.0, 0.15, 0.4, 0.7, 1.0], PICTURES / "fall.png", external=push.push(250.0), seen_from=seen, **size
    )
    coin = _result("16_rolling_disk").runs["slow"]
    yield motion_sheet(coin, [0.0, 0.3, 0.5, 0.6, 0.7], PICTURES / "coin_strip.png", width=300, height=300)
    crate, aside = _result("17_sliding_box").tipped[0.6], (0.2, -1.0, 0.2)
    yield motion_sheet(crate, [0.0, 0.15, 0.3, 0.45, 0.6], PICTURES / "tipping.png", width=300, height=300, seen_from=aside)


def fists() -> Path:
    """The page of examples/05_moving_and_body_contacts.py: two robots in one model."""
    example = _example("05_moving_and_body_contacts")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        example.main(show=True)
        page = next(Path(folder).rglob("*.html"))
        return screenshot(page, PICTURES / "fists.png", width=1100, height=900)


def crouch() -> Path:
    """The plot of examples/25_torques_of_a_crouch.py, as it writes it."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        _example("25_torques_of_a_crouch").main(show=True)
        with Image.open(next(Path(folder).rglob("*.png"))) as drawn:
            drawn.resize((770, 462), Image.Resampling.LANCZOS).save(PICTURES / "crouch.png")
    return PICTURES / "crouch.png"


def inverse_dynamics() -> Path:
    """The plot of docs/reference/inverse_dynamics.md: what Talos' hips cost on their way to the left, and what is possible of it."""
    robot = rbd.load_robot("talos")
    state, soles, held = robot.standing(), robot.soles(friction=0.7), robot.soles(friction=None)
    weight, wanted, shares, reached, lateral = 9.81 * robot.mass, np.linspace(0.0, 3.0, 121), [], [], np.zeros(robot.nv)
    for rate in wanted:
        lateral[1] = rate
        a = rbd.mechanism.project_acceleration(state, lateral, held).a
        try:
            way = rbd.inverse_dynamics(state, a, soles)
            friction = 1.0 - min(way.margins.friction.values())
            shares.append((1.0 - way.margins.torque.min(), friction, way.contacts["left_sole"].normal / weight))
        except rbd.CannotMove as error:
            way = error.nearest()
        reached.append((a[1], way.a[1]))
    figure = Figure(figsize=(8.6, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    words = ("largest torque, of its limit", "most friction of a foot, of its cone", "left foot, of the weight")
    colors = ("#0072b2", "#d55e00", "#009e73")
    for share, label, color in zip(100.0 * np.array(shares).T, words, colors, strict=True):
        left.plot(np.array(reached)[: len(shares), 0], share, color=color, label=label)
    left.set(ylabel="[%]", ylim=(0.0, 135.0), yticks=range(0, 101, 20), xlim=(0.0, 2.0))
    left.legend(frameon=False, loc="upper left")
    right.plot(*np.array(reached).T, color="#0072b2", label="possible")
    right.plot(*[np.array(reached)[:, 0]] * 2, ":", color="0.4", label="wanted")
    right.set(ylabel="nearest that is possible [m/s2]", xlim=(0.0, reached[-1][0]), ylim=(0.0, reached[-1][0]))
    right.legend(frameon=False, loc="upper left")
    for ax in (left, right):
        frame(ax, "y")
        ax.axvline(reached[len(shares) - 1][0], ls="--", color="0.4")
        ax.set_xlabel("hips to the left, wanted [m/s2]")
    figure.savefig(PICTURES / "inverse_dynamics.png", dpi=110, metadata={"Software": None})
    return PICTURES / "inverse_dynamics.png"


def motion_check() -> Path:
    """The page of `docs/reference/motions.md`: G1 raises its arms and leans, at the frame in which most is missing."""
    g1 = rbd.load_robot("g1")
    stands = g1.standing().q
    raises, leans = stands.copy(), stands.copy()
    for side in ("left", "right"):
        raises[g1.joints[f"{side}_shoulder_pitch_joint"].q] = -1.5
    leans[g1.joints["waist_pitch_joint"].q] = 0.5
    motion = rbd.motion.minimum_jerk(g1, [stands, raises, leans, stands], [0.0, 0.8, 1.4, 2.2])
    report = rbd.check_motion(motion)
    with tempfile.TemporaryDirectory() as folder:
        page = report.export(Path(folder) / "lean.html", title="G1 leans forward", arrow_per_weight=0.8)
        return screenshot(page, PICTURES / "motion_check.png", width=1200, height=720)


def mechanisms() -> Path:
    """The models of `urdf/` with loops and wheels, each with all its branches, three in a row."""
    width, height = 560, 440
    sheet = Image.new("RGB", (3 * width, 3 * height), "white")
    with tempfile.TemporaryDirectory() as folder:
        for i, name in enumerate(MECHANISMS):
            robot = rbd.load_robot(TOP / "urdf" / f"{name}.urdf")
            posture = next(iter(robot.postures), None)
            report = report_mechanism(robot, robot.at().q if posture is None else robot.at(posture).q)
            with Scene(robot, legend=False) as scene:
                scene.show(report.state)
                scene.beside(report.poses())
                page = scene.export(Path(folder) / f"{name}.html")
            shot = Image.open(screenshot(page, Path(folder) / f"{name}.png", width=width, height=height))
            sheet.paste(shot.resize((width, height)), (width * (i % 3), height * (i // 3)))
    sheet.save(PICTURES / "mechanisms.png")
    return PICTURES / "mechanisms.png"


def robots() -> Path:
    """The contact sheet: nine robots at rest on their feet, with the forces that carry them."""
    return contact_sheet(STANDING, PICTURES / "robots.png")


@cache
def _result(example: str) -> Any:
    """What an example returns."""
    with contextlib.redirect_stdout(io.StringIO()):
        return _example(example).main(show=False)


def _example(name: str) -> ModuleType:
    sys.path.insert(0, str(TOP / "examples"))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.pop(0)


if __name__ == "__main__":
    singles = (talos, fists, mechanisms, robots, crouch, inverse_dynamics, poses, hand_on_a_wall, where_it_can_stand)
    scenes = (make() for make in (*singles, motion_check))
    for made in itertools.chain(scenes, plots(), strips(), planar_pictures.pictures(), task_pictures.pictures()):
        print(made.relative_to(TOP))
