"""Layers, names and links of a page that moves, read back from a headless browser."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.simulation.simulated_motion import Event
from rbd.visual import Scene, export_motion
from rbd.visual.pages.browser import Browser

CORNERS = np.array([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]])
SHARES = np.array([0.4, 0.3, 0.2, 0.1])
SAID = "(({ title, lines, at }) => [title, lines, at])(trackLabel(stage.player.cast.tracks[0], [0, 0, 0]))"
SINGLE = 1e-5
"""Metres and newtons lose this in single precision."""


@dataclass(frozen=True, eq=False)
class Motion:
    """As much of a trajectory as pictures read."""

    robot: rbd.Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    points: dict
    point_forces: dict
    modes: dict
    events: tuple[Event, ...] = field(default=())


@pytest.fixture(scope="module")
def motion() -> Motion:
    """A box that glides along x on four corners, one corner loaded most, under a force that grows with time."""
    robot = rbd.load_robot("urdf/box.urdf")
    t = np.linspace(0.0, 1.0, 6)
    q = np.tile(pin.neutral(robot.model), (6, 1))
    q[:, 0], q[:, 2] = 0.3 * t, 0.1
    forces = (10.0 + 50.0 * t)[:, None, None] * SHARES[:, None] * np.array([-0.2, 0.1, 1.0])
    points = {"sole": CORNERS + np.array([[[0.3 * x, 0.0, 0.0]] for x in t])}
    return Motion(robot, t, q, np.zeros((6, robot.nv)), points, {"sole": forces}, {"sole": ["slips"] * 6})


@pytest.fixture(scope="module")
def page(motion: Motion, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """It in a page, with labels on."""
    return export_motion(
        motion, tmp_path_factory.mktemp("page") / "glides.html", fps=5, layers={"labels": True, "frames": True}
    )


def test_what_moves_is_in_layers(page: Path, browser: Browser):
    """The panel lists what the motion has; switches hide it."""
    with browser.open(page, width=700, height=500) as shown:
        present = shown.evaluate("stage.layers.present()")
        wanted = ["meshes", "collision shapes", "frames", "forces", "corner forces", "centre of mass"]
        wanted += ["support polygon", "axes", "labels"]
        assert present == wanted
        arrow = "stage.player.cast.tracks[0].big.node"
        assert shown.evaluate(f"seen({arrow})")
        shown.evaluate("stage.toolbar.show('forces', false)")
        assert not shown.evaluate(f"seen({arrow})") and shown.evaluate("seen(stage.player.cast.tracks[0].thin[0].node)")


def test_labels_move_and_count(page: Path, browser: Browser, motion: Motion):
    """At each time the name tells the force there, its normal part, where it acts and the mode."""
    with browser.open(page, width=700, height=500) as shown:
        for i in (0, 3, 5):
            shown.evaluate(f"stage.player.go({motion.t[i]}); stage.viewer.render()")
            force = motion.point_forces["sole"][i].sum(axis=0)
            at = SHARES @ motion.points["sole"][i]
            title, lines, where = shown.evaluate(SAID)
            assert title == "sole" and lines[0] == f"|f| {np.linalg.norm(force):.4g} N" and lines[-1] == "slips"
            assert lines[2].startswith(f"normal {force[2]:.4g} N, tangential {np.hypot(force[0], force[1]):.4g} N")
            assert lines[3] == f"tangential / normal {np.hypot(0.2, 0.1):.2f}"
            assert np.abs(np.array(where) - at).max() < SINGLE
            tags = shown.evaluate("[...document.querySelectorAll('.tags span')].map((s) => s.textContent)")
            assert f"sole: {lines[0]}" in tags and "support polygon: area 0.04 m2" in tags
            row = shown.evaluate("[...document.querySelectorAll('#legend td.value')].map((cell) => cell.textContent)")
            assert row[:2] == [f"{force[2]:.3g} N", f"{np.linalg.norm(force):.3g} N"]
        assert "normal" in shown.evaluate("document.querySelector('#legend tr.columns').innerText")


def test_frames_and_collision_shapes_go_along(page: Path, browser: Browser, motion: Motion):
    """At the end they are where the box is."""
    with browser.open(page, width=400, height=300, fragment="on=collision%20shapes") as shown:
        for i in (0, 5):
            shown.evaluate(f"stage.player.go({motion.t[i]})")
            frame = shown.evaluate("stage.frames[0].position.toArray()")
            assert np.abs(np.array(frame) - motion.q[i, :3]).max() < SINGLE
            shape = motion.robot.collision_model.geometryObjects[0].placement.translation
            place = shown.evaluate("stage.layers.object('collision/0').position.toArray()")
            assert np.abs(np.array(place) - motion.q[i, :3] - shape).max() < SINGLE
        assert shown.evaluate("seen(stage.layers.object('collision/0'))")


def test_the_link_keeps_the_time(page: Path, browser: Browser):
    """Going to a time writes it; the page opens there, in its view, and the bar is where the link says."""
    with browser.open(page, width=700, height=500) as shown:
        shown.evaluate("stage.player.go(0.4)")
        shown.key("2")
        link = str(shown.evaluate("new Promise((told) => setTimeout(() => told(location.hash), 600))"))
        assert link == "#t=0.4&view=side"
    with browser.open(page, width=700, height=500, fragment=f"{link[1:]}&off=forces") as again:
        assert again.evaluate("[stage.player.t, stage.views.name, stage.layers.on.forces]") == [0.4, "side", False]
        again.evaluate("location.hash = 't=0.6&view=follow'")
        again.wait("stage.player.t === 0.6 && stage.player.cast.follow")


def test_keys_of_the_toolbar_do_not_play(page: Path, browser: Browser):
    """Space on a switch turns the switch; elsewhere it plays."""
    with browser.open(page, width=700, height=500) as shown:
        shown.key("l")
        shown.evaluate("stage.toolbar.boxes.get('cones') === undefined && stage.toolbar.boxes.get('forces').focus()")
        shown.key(" ")
        assert shown.evaluate("stage.player.playing") is False
        shown.evaluate("document.activeElement.blur()")
        shown.key(" ")
        assert shown.evaluate("stage.player.playing") is True


def test_a_live_page_keeps_its_layers(browser: Browser, motion: Motion):
    """What the browser hides stays hidden when Python shows the next state."""
    with Scene(motion.robot) as scene:
        scene.show(motion.robot.at())
        with browser.open(scene.url, width=400, height=300) as shown:
            shown.evaluate("stage.toolbar.show('centre of mass', false)")
            scene.show(rbd.State(motion.robot, motion.q[3]))
            shown.wait(f"stage.layers.object('robot/0').matrix.elements[12] === {float(motion.q[3, 0])!r}")
            ball = "stage.layers.object('marks/com/ball')"
            shown.wait(f"Boolean({ball})")
            assert shown.evaluate(f"seen({ball})") is False
