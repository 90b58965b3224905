"""Pages that carry an answer's numbers, and compute its residuals anew in the browser."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.visual.pages.browser import Browser, find_browser
from rbd.visual.verified_frames import Frame, verified

needs_chromium = pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine")
FOUND = """stage.verifier.verify().then(() => {
    const { found, differ, said } = stage.verifier;
    return { found, differ, said: said.textContent };
})"""


def answers(rng: np.random.Generator, n: int) -> Iterator[Frame]:
    """Of each kind of row and set: soles pushed until they slip, both laws, pyramids, loops, points that slide and turn."""
    solo, talos = rbd.load_robot("solo12"), rbd.load_robot("talos")
    box, bar = rbd.testing.box(mass=10.0), rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5)
    for i in range(n):
        push = rng.normal(size=3)
        if i % 5 == 0:
            state, rows, given = talos.standing(), talos.soles(friction=0.7), rbd.ExternalForce("torso_2_link", 200.0 * push)
            yield float(i), state, rbd.solve(state, None, rows, external=given, law=("coulomb", "convex")[i % 2])
        elif i % 5 == 1:
            state, given, tau = solo.standing(), rbd.ExternalForce("base_link", 20.0 * push), 2.0 * rng.normal(size=12)
            yield float(i), state, rbd.solve(state, tau, solo.feet(), external=given)
        elif i % 5 == 2:
            state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], np.array([*push[:2], 0.0, 0.0, 0.0, push[2]]))
            yield float(i), state, rbd.solve(state, None, [face])
        elif i % 5 == 3:
            state, given = rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), rbd.ExternalForce("box", 40.0 * push)
            yield float(i), state, rbd.solve(state, None, [face], external=given, solver=rbd.ProxQP())
        else:
            state = bar.at("assembled")
            yield float(i), state, rbd.solve(state, None, bar.loops())


@pytest.fixture(scope="module")
def scene() -> Iterator[rbd.visual.Scene]:
    """A small page."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    with rbd.visual.Scene(robot) as made:
        made.show(robot.at("assembled"))
        yield made


@needs_chromium
@pytest.mark.filterwarnings("ignore::rbd.errors.NonUniqueMotionWarning")  # of a face that slides and turns
def test_residuals_in_the_browser_are_those_of_python(
    scene: rbd.visual.Scene, browser: Browser, rng: np.random.Generator, tmp_path: Path, exhaustive: bool
) -> None:
    """Of 1,000 answers in exhaustive tests, to 1e-12 of the terms; a number that is off by 1e-9 of itself is found."""
    frames = list(answers(rng, 1000 if exhaustive else 10))
    text = verified(frames)
    page = tmp_path / "page.html"
    page.write_text(scene.page(text))
    with browser.open(page) as shown:
        got = shown.evaluate(FOUND)
    worst = 0.0
    for (_, _, solution), found, differ in zip(frames, got["found"], got["differ"], strict=True):
        for value, here in zip(solution.residuals.values, found, strict=True):
            assert (value is None) == (here is None)
            if value is not None:
                worst = max(worst, abs(here[0] - value) / max(here[1], 1.0))
        assert max(differ) <= 1e-12
    assert worst <= 1e-12 and f"All {len(frames)} answers agree" in got["said"]
    given = json.loads(text)
    numbers = np.frombuffer(zlib.decompress(base64.b64decode(given["verify"]["data"])), "<f8").copy()
    head = given["verify"]["frames"][0]
    at = head["nv"] * (head["nv"] + 1) // 2 + head["m"] * head["nv"] + int(np.abs(frames[0][2].a).argmax())
    numbers[at] *= 1.0 + 1e-9
    given["verify"]["data"] = base64.b64encode(zlib.compress(numbers.tobytes())).decode()
    page.write_text(scene.page(json.dumps(given)))
    with browser.open(page) as shown:
        assert shown.evaluate(FOUND)["said"] == f"1 of {len(frames)} answers do NOT agree with what rbd found."


@needs_chromium
def test_less_friction_tells_which_contacts_leave_their_cones(browser: Browser, tmp_path: Path) -> None:
    """A box on a slope of 0.3 with friction 0.5 leaves its cone at 0.6 of that, and not just above; its samples agree."""
    b = rbd.RobotBuilder("box")
    b.body("box", rbd.robots.Box((0.4, 0.4, 0.1), mass=10.0))
    box = b.robot()
    ground = rbd.Ground(point=(0, 0, 0), normal=(np.sin(np.arctan(0.3)), 0.0, np.cos(np.arctan(0.3))))
    face = rbd.PointContact("face", "box", friction=0.5, on=ground)  # at the centre of mass: every force is determined
    state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
    with rbd.visual.Scene(box) as scene:
        scene.show(state, rbd.solve(state, None, [face]))
        page = scene.export(tmp_path / "box.html", verify=True)
        with pytest.raises(rbd.InputError, match=r"rbd\.solve in the scene"):
            scene.show(state)
            scene.export(tmp_path / "none.html", verify=True)
    ask = """(factor) => stage.verifier.verify().then(() => {
        stage.verifier.slider.value = factor; stage.verifier.slider.dispatchEvent(new Event("input"));
        return stage.verifier.cones.textContent; })"""
    with browser.open(page) as shown:
        assert shown.evaluate(f"({ask})(0.61)") == "face98.4 % of friction"
        assert shown.evaluate(f"({ask})(0.59)") == "faceleaves its cone: 102 % of friction"
    run = rbd.simulate(state, [face], duration=0.1, step=1e-2)
    with browser.open(run.export(tmp_path / "run.html", verify=[face])) as shown:
        got = shown.evaluate(FOUND)
        assert len(got["found"]) > 3 and "answers agree" in got["said"]
    with pytest.raises(rbd.InputError, match=r"what rbd\.simulate returned"):
        rbd.visual.export_motion(run.state(0), tmp_path / "m.html", verify=[face])
