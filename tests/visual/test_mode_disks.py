"""Disks at contact points: their colour is the point's mode, they are filled by the share of friction that is used."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.contact_modes import modes_at_points
from rbd.visual import export_motion
from rbd.visual.marks.contacts import DISK, disk_marks, shown_forces
from rbd.visual.pages.browser import Browser
from rbd.visual.playback.mode_disks import IMPACT_SECONDS
from rbd.visual.playback.shown_motion import ShownMotion
from rbd.visual.style import MODE_COLORS

MU, SPEED, HEIGHT = 0.4, 1.0, 0.02
OPEN, STICKS, SLIPS, _, IMPACT = range(5)


@pytest.fixture(scope="module")
def face() -> rbd.SurfaceContact:
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    return rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), placement=below, friction=MU, on=0.0)


@pytest.fixture(scope="module")
def slide(face: rbd.SurfaceContact) -> rbd.Trajectory:
    """A box falls by 2 cm while it moves sideways, lands, slides, and stops."""
    start = rbd.State(rbd.load_robot("urdf/box.urdf"), [0, 0, 0.1 + HEIGHT, 0, 0, 0, 1], [SPEED, 0, 0, 0, 0, 0])
    return rbd.simulate(start, [face], duration=0.5, step=2e-3, progress=False)


def test_a_point_is_open_then_lands_slides_and_sticks(slide: rbd.Trajectory) -> None:
    """In closed form: it lands at sqrt(2 h / g), friction of the impact takes mu sqrt(2 g h), and the rest lasts v / (mu g)."""
    disks = ShownMotion.of_trajectory(slide).disks["face"]
    lands = np.sqrt(2.0 * HEIGHT / 9.81)
    stops = lands + (SPEED - MU * 9.81 * lands) / (MU * 9.81)
    before, lately = slide.t < lands, (slide.t > lands) & (slide.t < lands + IMPACT_SECONDS)
    slides, rests = (slide.t > lands + IMPACT_SECONDS) & (slide.t < stops - 2e-3), slide.t > stops + 2e-3
    for times, code in ((before, OPEN), (lately, IMPACT), (slides, SLIPS), (rests, STICKS)):
        assert times.any()
        assert (disks.codes[times] == code).all()
    assert np.isnan(disks.used[before]).all()
    assert np.abs(disks.used[slides] - 1.0).max() < 1e-9
    assert np.abs(disks.used[rests]).max() < 1e-6
    assert np.array_equal(disks.normals[5, 0], [0.0, 0.0, 1.0])


def test_a_trajectory_keeps_the_friction_of_its_contacts(slide: rbd.Trajectory, tmp_path: Path) -> None:
    """In slices and files; without it disks are full, as how much is used is not known."""
    assert slide.friction == slide[5:].friction == {"face": MU}
    slide.save(tmp_path / "run.npz")
    assert rbd.Trajectory.load(tmp_path / "run.npz", robot=slide.robot).friction == {"face": MU}
    without = rbd.Trajectory(**vars(slide) | {"friction": {}})
    assert np.isnan(ShownMotion.of_trajectory(without).disks["face"].used).all()
    for wrong in ({"hand": 0.5}, {"face": -0.1}):
        with pytest.raises(rbd.InputError, match="friction of a trajectory"):
            rbd.Trajectory(**vars(slide) | {"friction": wrong})


def test_the_page_fills_disks_by_the_friction_used(slide: rbd.Trajectory, tmp_path: Path, browser: Browser) -> None:
    """Colours of the modes; a third of the friction fills a third of the area; the rest is pale."""
    forces = {"face": slide.point_forces["face"].copy()}
    still = slide.t > 0.4
    forces["face"][still, :, 0] = MU / 3.0 * forces["face"][still, :, 2]  # as if a third were used
    page = export_motion(rbd.Trajectory(**vars(slide) | {"point_forces": forces}), tmp_path / "x.html", charts=False)
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    told = next(n["motion"] for n in notes if "motion" in n)["contacts"][0]["disks"]
    assert dict(zip(told["modes"], told["colors"], strict=True)) == MODE_COLORS
    assert np.frombuffer(base64.b64decode(told["used"]), "u1")[-1] == 85  # of 255
    look = """(t => {
      stage.player.go(t);
      const { disk, inner } = stage.player.cast.tracks[0].dots[0];
      return [disk.children[0].material.color.getHexString(), inner.visible, inner.scale.x,
        inner.children[0].material.color.getHexString()];
    })(%s)"""
    with browser.open(page, width=300, height=200) as shown:
        assert shown.evaluate(look % 0.01)[:2] == [MODE_COLORS["open"][1:], False]
        assert shown.evaluate(look % 0.15)[:2] == [MODE_COLORS["slips"][1:], False]  # full
        color, seen, radius, inner = shown.evaluate(look % 0.45)
        assert (seen, inner) == (True, MODE_COLORS["sticks"][1:])
        assert radius**2 == pytest.approx(1.0 / 3.0)
        assert bytes.fromhex(color) > bytes.fromhex(inner)
        legend = shown.evaluate("document.querySelector('#legend td.disks').textContent")
    assert all(mode in legend for mode in ("open", "sticks", "slips", "impact", "share of the friction"))
    assert "creeps" not in legend


def test_a_scene_has_the_disks_of_its_answer(face: rbd.SurfaceContact) -> None:
    """Pushed with a third of the friction, the corners stick and a third is filled; beyond it they slip; lifted, they open."""
    box = rbd.load_robot("urdf/box.urdf")
    state, weight = box.at([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]), box.mass * 9.81
    with rbd.visual.Scene(box) as scene:
        for push, mode, used in (
            ((MU * weight / 3.0, 0.0, 0.0), "sticks", 1.0 / 3.0),
            ((2.0 * MU * weight, 0.0, 0.0), "slips", 1.0),
            ((0.0, 0.0, 2.0 * weight), "open", None),
        ):
            pushed = rbd.ExternalForce("box", push, offset=(0.0, 0.0, -0.1))  # at the floor: it does not tip the box
            answer = rbd.solve(state, [], [face], external=[pushed])
            scene.show(state, answer)
            (contact,) = shown_forces(answer)
            assert [name for name, _ in contact.points] == [mode] * 4
            if used is not None:
                assert [share for _, share in contact.points] == pytest.approx([used] * 4, abs=1e-6)
            marks = disk_marks(contact, scene.sizes)
            assert {mark.color for mark in marks} == {MODE_COLORS[mode]}
            around = np.linalg.norm(marks[1].points - marks[1].points.mean(axis=0), axis=1)
            share = 1.0 if used is None else used
            assert around == pytest.approx(DISK * scene.sizes.shaft * np.sqrt(share), rel=1e-5)


def test_points_that_accelerate_along_the_ground_slip(face: rbd.SurfaceContact) -> None:
    """A box that a push turns about one corner: that corner sticks within its cone, the three others slip on theirs."""
    box = rbd.load_robot("urdf/box.urdf")
    push = rbd.ExternalForce("box", (0.3 * box.mass * 9.81, 0.0, 0.0), offset=(0.0, 0.2, 0.3))
    answer = rbd.solve(box.at([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]), [], [face], external=[push])
    (contact,) = shown_forces(answer)
    a = answer.a[:2] + answer.a[5] * np.column_stack([-contact.corners[:, 1], contact.corners[:, 0]])
    speeds = np.linalg.norm(a, axis=1)
    assert [mode for mode, _ in contact.points] == np.where(speeds > 1e-3, "slips", "sticks").tolist()
    assert sorted(speeds > 1e-3) == [False, True, True, True]
    assert all(used is not None and (mode == "sticks") == (used < 0.999) for mode, used in contact.points)
    assert modes_at_points(answer) == {"face": tuple(mode for mode, _ in contact.points)}


SIMULATED = {
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]],
}
"""Linear red, green and blue as people see them without one kind of cone: Machado, Oliveira and Fernandes 2009, table 1."""


def lab(color: str, seen: np.ndarray) -> np.ndarray:
    """A colour in CIELAB, white D65."""
    s = np.array([*bytes.fromhex(color[1:])]) / 255.0
    linear = np.clip(seen @ np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4), 0.0, 1.0)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ linear
    x, y, z = np.cbrt(xyz / [0.9505, 1.0, 1.089])
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def test_colour_blind_readers_tell_modes_apart() -> None:
    """Distances in CIELAB, where 2 are seen side by side: 30 between the modes of contacts with friction, 15 between all."""
    for seen in (np.eye(3), *map(np.array, SIMULATED.values())):
        found = {mode: lab(color, seen) for mode, color in MODE_COLORS.items()}
        apart = {(a, b): np.linalg.norm(found[a] - found[b]) for a in found for b in found if a < b}
        assert min(apart.values()) > 15.0
        assert min(size for pair, size in apart.items() if not {"holds", "pushes"} & {*pair}) > 30.0
