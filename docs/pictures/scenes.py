"""Scenes in three dimensions, as pages that need no network: those of which docs/pictures shows a picture.

The build of the site puts them beside its pages; `make.py` photographs some of them.
"""

import contextlib
import importlib
import io
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import task_pictures

import rbd
from rbd.visual import Scene

TOP = Path(__file__).resolve().parents[2]


def talos(page: Path) -> Path:
    """The README's first screen: Talos pushed at its torso, with the forces of the README's code."""
    robot = rbd.load_robot("talos")
    state, soles = robot.standing(), robot.soles(friction=0.7)
    push = rbd.ExternalForce("torso_2_link", (0.0, 80.0, 0.0))
    solution = rbd.solve(state, rbd.hold(state, soles).tau, soles, external=push)
    with Scene(robot) as scene:
        scene.show(state, solution, external=push)
        return scene.export(page)


def hand_on_a_wall(page: Path) -> Path:
    """Example 24: Talos pushed towards the wall, its hand there, and the support regions on the ground."""
    given = result("24_hand_on_a_wall")
    held = given.held
    with Scene(held.state.robot) as scene:
        scene.show(held.state, held, external=rbd.ExternalForce("torso_2_link", (0.0, 140.0, 0.0)))
        scene.draw(*given.regions["soles and hand"])
        return scene.export(page)


def fall(page: Path) -> Path:
    """Example 14: Talos pushed with 250 N falls."""
    push = example("14_push_recovery").push(250.0)
    return result("14_push_recovery").ways[250.0].export(page, external=push)


def coin(page: Path) -> Path:
    """Example 16: a slow coin rolls and leans over."""
    return result("16_rolling_disk").runs["slow"].export(page)


def walk(page: Path) -> Path:
    """Example 28: Talos walks six steps."""
    return result("28_talos_walks").walk.export(page)


def balance(page: Path) -> Path:
    """Example 29: Talos survives a hard push to its left."""
    push, way = balanced()
    return way.export(page, external=push)


def balanced() -> tuple[rbd.control.Push, rbd.Trajectory]:
    """The hardest push that Talos survives in the short search of example 29, and the motion after it."""
    module, (ways, impulses) = example("29_balance"), result("29_balance")
    impulse = ways[0] * impulses[module.CONTROL][0]
    return module.push(impulse), module.pushed(module.CONTROL, impulse)


def tipping(page: Path) -> Path:
    """Example 17: a crate slides, its edge grips, and it tips over."""
    return result("17_sliding_box").tipped[0.6].export(page)


def lean(speed: float) -> rbd.Motion:
    """G1 raises its arms and leans, in 2.2 s over the speed."""
    g1 = rbd.load_robot("g1")
    stands = g1.standing().q
    raises, leans = stands.copy(), stands.copy()
    for side in ("left", "right"):
        raises[g1.joints[f"{side}_shoulder_pitch_joint"].q] = -1.5
    leans[g1.joints["waist_pitch_joint"].q] = 0.5
    times = [0.0, 0.8 / speed, 1.4 / speed, 2.2 / speed]
    return rbd.motion.minimum_jerk(g1, [stands, raises, leans, stands], times)


def motion_check(page: Path) -> Path:
    """The page of `docs/reference/motions.md`: G1 raises its arms and leans, at the frame in which most is missing."""
    return rbd.check_motion(lean(1.0)).export(page, title="G1 leans forward", arrow_per_weight=0.8)


def repaired_motion(page: Path) -> Path:
    """The page of `docs/tasks/check_a_motion_file.md`: G1 leans at twice the speed, and the motion repaired."""
    motion = lean(2.0)
    repaired = rbd.check_motion(rbd.check_motion(motion).repaired(progress=False))
    return repaired.export(page, title="G1's lean repaired", ghost=motion, start=0.55, arrow_per_weight=0.8)


def push_samples(page: Path) -> Path:
    """Example 30: the last push that is held, and beside it the nearest motion under the first that is not."""
    module, samples = example("30_push_study"), rbd.grid(friction=[1.0], push=[110.0, 120.0])
    return module.beside(samples, rbd.study(module.held, samples, executor=0, progress=False), page)


def four_bar(page: Path) -> Path:
    """Example 10: the rhombus of the text, with its other branch beside it."""
    return shown("10_four_bar", page)


def double_pendulum(page: Path) -> Path:
    """Example 21: a large swing of a pendulum with two links."""
    return shown("21_two_link_pendulum", page)


def weave(page: Path) -> Path:
    """Example 34: the weave of a bicycle at 5 m/s, in two poses a quarter of a period apart."""
    module = example("34_bicycle")
    modes = rbd.linearise(module.rolling(module.build(), 5.0)).modes()
    shape = next(mode for mode in modes if mode.frequency)
    with shape.scene(amplitude=0.3, seen_from=(0.5, -1.0, 0.35)) as scene:
        return scene.export(page)


SCENES: dict[str, Callable[[Path], Path]] = {
    "talos": talos,
    "weave": weave,
    "hand_on_a_wall": hand_on_a_wall,
    "fall": fall,
    "coin_strip": coin,
    "walk": walk,
    "balance_strip": balance,
    "tipping": tipping,
    "motion_check": motion_check,
    "repaired_motion": repaired_motion,
    "push_samples": push_samples,
    "four_bar": four_bar,
    "double_pendulum": double_pendulum,
    "task_walker": task_pictures.walker_page,
    "task_loop": task_pictures.loop_page,
}
"""{picture in docs/pictures: writes the scene of which it is taken}."""


@cache
def result(name: str) -> Any:
    """What an example returns."""
    with contextlib.redirect_stdout(io.StringIO()):
        return example(name).main(show=False)


def shown(name: str, page: Path) -> Path:
    """The page or picture that an example writes where it shows something."""
    page = page.resolve()
    sys.path.insert(0, str(TOP / "examples"))  # processes that an example starts import it from there
    try:
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
            example(name).main(show=True)
            written = next(path for path in sorted(Path(folder).rglob("*")) if path.suffix == page.suffix)
            return Path(shutil.copyfile(written, page))
    finally:
        sys.path.remove(str(TOP / "examples"))


def example(name: str) -> ModuleType:
    """An example as a module."""
    sys.path.insert(0, str(TOP / "examples"))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.pop(0)
