"""Drawings of force elements: where springs and dampers are, their colours and labels, in scenes and in motions."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
import pytest

import rbd
from rbd.visual import shapes
from rbd.visual.marks.applied_forces import PULLS, PUSHES, RELAXED, coil, color_of, shown_elements, spiral, turns_of
from rbd.visual.pages.link import LAYERS
from rbd.visual.playback.animation import shown_motion
from rbd.visual.playback.motion_frames import frames_of
from rbd.visual.playback.motion_page import MotionPage
from rbd.visual.robot_meshes import robot_parts
from rbd.visual.scene import Scene
from rbd.visual.style import rgb


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def high(solo: rbd.Robot) -> rbd.State:
    state = solo.standing()
    return rbd.State(solo, state.q + 0.3 * np.eye(solo.nq)[2])


@pytest.fixture(scope="module")
def elements() -> list[object]:
    return [
        rbd.Spring("base_link", to=(0.0, 0.0, 1.5), stiffness=100.0, rest=0.5, name="cord"),
        rbd.Spring("FL_FOOT", to=(0.3, 0.3, 0.0), stiffness=50.0, rest=1.0, name="strut"),
        rbd.Damper("HL_FOOT", to="HR_FOOT", damping=3.0, name="shock"),
        rbd.JointSpring("FL_KFE", stiffness=2.0, rest=0.0),
        rbd.Spring("FL_LOWER_LEG", to="base_link", axis=(0, 1, 0), stiffness=1.0, rest=0.2, name="twist"),
        rbd.Bushing("base_link", to=(0.0, 0.05, 0.6), stiffness=(10.0,) * 6, name="mount"),
    ]


@pytest.fixture(scope="module")
def scene(solo: rbd.Robot) -> Iterator[Scene]:
    with Scene(solo) as made:
        yield made


def marks_of(scene: Scene, layer: str = "force elements") -> dict[str, object]:
    return {mark.path: mark for mark in scene.drawn if mark.layer == layer}


def test_every_element_is_drawn_between_its_ends(scene: Scene, high: rbd.State, elements: list[object]) -> None:
    """Coils and cylinders reach from end to end; nothing is farther from their line than a coil is thick."""
    scene.show(high, external=elements)
    shown, words = shown_elements(high, elements)
    assert len(shown) == len(elements) and not words and not scene.left_out
    marks = marks_of(scene)
    assert "force elements" in LAYERS
    for i, element in enumerate(shown[:3]):
        vertices, (a, b) = marks[f"force_elements/{i}/0"].points, element.points  # type: ignore[attr-defined]
        along = (b - a) / np.linalg.norm(b - a)
        places = (vertices - a) @ along
        assert abs(places.min()) < 0.01 and abs(places.max() - np.linalg.norm(b - a)) < 0.01
        assert np.linalg.norm(vertices - a - np.outer(places, along), axis=1).max() < 0.03


def test_the_ends_are_those_of_the_element(high: rbd.State, elements: list[object]) -> None:
    shown = {element.name: element for element in shown_elements(high, elements)[0]}
    cord, foot = shown["cord"], high.frame("FL_FOOT").X_WF.translation
    assert {tuple(point) for point in cord.points.round(12)} == {(0.0, 0.0, 1.5), tuple(high.q[:3].round(12))}
    assert any(np.abs(point - foot).max() < 1e-12 for point in shown["strut"].points)
    knee = shown["spring in FL_KFE"]
    assert knee.shape == "spiral" and np.abs(knee.points[0] - high.frame("FL_KFE").X_WF.translation).max() < 1e-12
    assert abs(abs(knee.axis @ high.frame("FL_KFE").X_WF.rotation[:, 1]) - 1.0) < 1e-12


def test_colours_tell_pulling_from_pushing(scene: Scene, high: rbd.State, elements: list[object]) -> None:
    """The stretched cord is orange, the compressed strut blue, the damper at rest grey."""
    scene.show(high, external=elements)
    shown = {element.name: element for element in shown_elements(high, elements)[0]}
    assert shown["cord"].tension > 0.0 > shown["strut"].tension and shown["shock"].tension == 0.0
    red, _, blue = np.array(rgb(color_of(shown["cord"], scene.sizes)))
    assert red > blue
    red, _, blue = np.array(rgb(color_of(shown["strut"], scene.sizes)))
    assert blue > red
    assert color_of(shown["shock"], scene.sizes) == RELAXED
    assert color_of(shown["cord"], scene.sizes) == PULLS  # it pulls with several weights


def test_labels_and_legend_tell_the_force(scene: Scene, high: rbd.State, elements: list[object]) -> None:
    cord = elements[0]
    scene.show(high, external=elements)
    label = marks_of(scene)["force_elements/0/0"].label  # type: ignore[attr-defined]
    force = abs(float(cord.force(high)[0]))  # type: ignore[attr-defined]
    assert label.title == "cord" and label.lines[0] == f"{force:.4g} N" and label.lines[1] == "spring, pulls"
    message = next(m for m in scene.recorder.messages()[0] if isinstance(m, str) and m.startswith('{"legend"'))
    entries = {entry["name"]: entry for entry in json.loads(message)["legend"]["entries"]}
    assert entries["cord"]["value"] == f"{force:.4g} N" and entries["strut"]["detail"] == "spring, pushes"


def test_a_solution_and_a_hold_draw_their_own_elements(scene: Scene, solo: rbd.Robot, elements: list[object]) -> None:
    state, feet = solo.standing(), solo.feet(friction=0.8)
    soft = [rbd.Spring("base_link", to=(0.0, 0.0, 1.0), stiffness=5.0, rest=0.5, name="cord")]
    for answer in (rbd.hold(state, feet, external=soft), rbd.solve(state, np.zeros(solo.nu), feet, external=soft)):
        scene.show(state, answer)
        assert len(marks_of(scene)) == 1
        scene.show(state, answer, external=[])
        assert not marks_of(scene)


def test_pushes_beside_elements_are_drawn_as_pushes(scene: Scene, high: rbd.State, elements: list[object]) -> None:
    push = rbd.ExternalForce("base_link", (0.0, 5.0, 0.0))
    scene.show(high, external=[elements[0], push])
    assert len(marks_of(scene)) == 1 and "pushes/0/force" in marks_of(scene, "pushes")


def test_what_acts_in_many_places_is_told_in_words(scene: Scene, high: rbd.State, solo: rbd.Robot) -> None:
    scene.show(high, external=rbd.JointDamping(dict.fromkeys(solo.actuated_names, 0.1), name="gears"))
    assert not marks_of(scene) and any("gears" in words for words in scene.left_out)


@pytest.mark.filterwarnings("ignore:the steps of solo12 lose energy")  # 0.15 %
def test_a_motion_shows_its_elements_at_every_frame(solo: rbd.Robot, high: rbd.State, elements: list[object]) -> None:
    """Ends, axis and tension in the rows are those of the elements at the sample."""
    run = rbd.simulate(high, duration=0.12, step=2.5e-3, external=elements)
    parts = robot_parts(solo)
    joints = sorted({part.joint for part in parts} - {0})
    frames = frames_of(shown_motion(run), joints)
    assert [track.name for track in frames.elements] == [e.name for e in elements]  # type: ignore[attr-defined]
    i = len(frames.times) // 2
    at = int(np.argmin(abs(run.t - frames.times[i])))
    assert run.t[at] == frames.times[i]
    expected, _ = shown_elements(run.state(at), elements)
    rows = frames.rows[i, -10 * len(elements) :].reshape(-1, 10)
    for row, element in zip(rows, expected, strict=True):
        assert np.abs(row[:6] - element.points.ravel()).max() < 1e-12
        assert row[9] == pytest.approx(element.tension, abs=1e-9)
    page = MotionPage(shown_motion(run), frames, parts, _sizes(solo, high), True)
    told = json.loads(page.whole({}, 1.0))["motion"]
    assert [e["shape"] for e in told["elements"]] == ["coil", "coil", "cylinder", "spiral", "spiral", "bushing"]
    assert told["elements"][0]["colors"] == [RELAXED, PULLS, PUSHES] and "orange" in told["note"]


def _sizes(robot: rbd.Robot, state: rbd.State) -> object:
    with Scene(robot, legend=False) as scene:
        scene.show(state)
        return scene.sizes


def test_elements_of_a_function_of_time_are_drawn_if_it_is_given(high: rbd.State, elements: list[object]) -> None:
    def external(state: rbd.State, t: float) -> list[object]:
        return elements[:1] if t < 0.05 else []

    run = rbd.simulate(high, duration=0.1, step=5e-3, external=external)
    assert frames_of(shown_motion(run), [1]).elements == ()
    (track,) = frames_of(shown_motion(run), [1], external=external).elements
    times = frames_of(shown_motion(run), [1], external=external).times
    assert np.array_equal(np.isfinite(track.points[:, 0, 0]), times < 0.05)


def test_coils_and_spirals_are_smooth_closed_tubes() -> None:
    for line in (coil(0.5, 0.02, turns_of(0.5, 0.02)), spiral(0.05)):
        mesh = shapes.tube(line, 2e-3)
        assert np.isfinite(mesh.vertices).all() and len(mesh.faces) > 100
        far = np.linalg.norm(mesh.vertices[:, None] - line[None, :], axis=2).min(axis=1)
        assert far.max() < 6e-3
