"""Pages of audits: both sets of forces, modes of the points, lanes of the causes, and two engines over one bar."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rbd
from rbd.arrays import Array
from rbd.audits import AuditReport, Record, audit, compare
from rbd.errors import InputError
from rbd.visual import Browser, find_browser
from rbd.visual.playback.audit_motion import NO_ANSWER, POINT_COLORS, shown_audit, solid_robot
from rbd.visual.robot_meshes import robot_parts

G, MU, N = 9.81, 0.5, 12
SINGLE = 1e-6
"""Numbers of a page have seven digits."""
BOX = rbd.testing.box(mass=1.0)
CORNERS = np.array([[x, y, 0.0] for x in (-0.2, 0.2) for y in (-0.2, 0.2)])
SHARES = 0.25 * (1.0 + np.sign(CORNERS[:, 0]) * MU * 0.1 / 0.2)
"""How much of the force each corner has: friction at the bottom presses the front ones more."""
OPEN, STICKS, SLIPS, CREEPS = range(len(POINT_COLORS))


def slide(n: int = N, *, speed: float = 1.0, **other: Any) -> Record:
    """The box slides: a = -mu g; its corners are listed in another order in each frame."""
    rng, t = np.random.default_rng(0), 0.01 * np.arange(n)
    x, zero, order = speed * t - 0.5 * MU * G * t**2, np.zeros(n), np.array([rng.permutation(4) for _ in range(n)])
    q = np.column_stack([x, zero, zero + 0.1, zero, zero, zero, zero + 1.0])
    arrays: dict[str, Any] = {
        "t": t, "q": q, "v": np.outer(speed - MU * G * t, np.eye(6)[0]), "a": np.tile(-MU * G * np.eye(6)[0], (n, 1)),
        "contact_at": np.repeat(np.arange(n), 4), "contact_bodies": ["box"] * (4 * n), "friction": np.full(4 * n, MU),
        "points": (q[:, None, :3] * [1.0, 1.0, 0.0] + CORNERS[order]).reshape(-1, 3),
        "normals": np.tile([0.0, 0.0, 1.0], (4 * n, 1)), "forces": np.outer(SHARES[order].ravel(), [-MU * G, 0.0, G]),
        "gaps": np.zeros(4 * n), "engine": "planted",
    }  # fmt: skip
    return Record.of_arrays(BOX, **{**arrays, **other})


def planted() -> AuditReport:
    """One force scaled in frame 5, friction that is not known in frame 8, none in frame 10, friction within its cone in 11."""
    right = slide()
    forces, mu = np.array(right.forces), np.array(right.friction)
    forces[20] *= 1.5
    mu[32:36] = np.nan
    forces[40:44] = 0.0
    forces[44:, 0] *= 0.5
    return audit(slide(forces=forces, friction=mu))


def told(page: Path) -> dict[str, Any]:
    """The motion that a page holds."""
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    found: dict[str, Any] = next(n["motion"] for n in notes if "motion" in n)
    return found


def unpacked(text: str, kind: str = "<f4") -> Array:
    return np.frombuffer(base64.b64decode(text), kind)


def acting(motion: dict[str, Any]) -> tuple[Array, Array, Array]:
    """(points, the engine's forces, those of the law), each of shape (frames, 4, 3), of a page of one contact."""
    rows = unpacked(motion["rows"]).reshape(len(motion["times"]), -1)
    first = 7 * motion["bodies"] + 3
    both = rows[:, first : first + 48].reshape(len(rows), 2, 4, 6)
    return both[:, 0, :, :3], both[:, 0, :, 3:], both[:, 1, :, 3:]


@pytest.fixture(scope="module")
def report() -> AuditReport:
    return planted()


@pytest.fixture(scope="module")
def page(report: AuditReport, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return report.export(tmp_path_factory.mktemp("audit") / "audit.html")


def test_both_sets_of_forces_are_in_the_page(report: AuditReport, page: Path) -> None:
    """The engine's as recorded, each at its corner; the law's in the sum are friction mu m g and the weight."""
    motion = told(page)
    points, engine, law = acting(motion)
    assert np.abs(np.array(motion["times"]) - report.record.t).max() < 1e-9
    local = points - report.record.q[:, None, :3] * [1.0, 1.0, 0.0]
    assert np.abs(local - local[0]).max() < SINGLE  # one column, one corner of the box, in whatever order they were listed
    sums = report.record.forces.reshape(N, 4, 3).sum(axis=1)
    assert np.abs(engine.sum(axis=1) - sums).max() < SINGLE * G
    answered = np.arange(N) != 8
    assert np.abs(law[answered].sum(axis=1) - [-MU * G, 0.0, G]).max() < 1e-5 * G
    assert not law[~answered].any()
    (contact,), (by_law, missing) = motion["contacts"], motion["pushes"]
    assert missing["name"] == "missing force"
    lost = unpacked(motion["rows"]).reshape(N, -1)[:, -3:]
    assert np.abs(lost - ([-MU * G, 0.0, G] - sums)).max() < 1e-5 * G
    assert (contact["name"], by_law["name"], by_law["points"]) == ("box", "box, by the law", 4)
    assert by_law["aside"] is True
    assert by_law["color"] != contact["color"]


def test_disks_have_the_modes_of_the_points(page: Path) -> None:
    """They slip, are open in frame 10, creep in frame 11; the normals are up."""
    disks = told(page)["contacts"][0]["disks"]
    codes = unpacked(disks["codes"], "u1").reshape(N, 4)
    expected = np.full(N, SLIPS)
    expected[[10, 11]] = OPEN, CREEPS
    assert np.array_equal(codes, np.repeat(expected, 4).reshape(N, 4))
    assert disks["modes"] == ["open", "sticks", "slips", "creeps"]
    assert len(set(disks["colors"])) == 4
    assert np.array_equal(unpacked(disks["normals"]).reshape(-1, 3), np.tile([0, 0, 1], (4 * N, 1)))


def test_disks_are_filled_by_the_share_of_friction(page: Path) -> None:
    """Sliding uses all, halved forces half; full too where friction is not known, and where nothing touches."""
    used = unpacked(told(page)["contacts"][0]["disks"]["used"], "u1").reshape(N, 4)
    assert set(used[:11].ravel().tolist()) == {255}
    assert set(used[11].tolist()) == {round(0.5 * 255)}


def test_each_cause_has_a_lane_and_a_row(report: AuditReport, page: Path) -> None:
    """Lanes as long as the cause, a mark at its worst frame, a row of the card that goes there; why there is no answer."""
    motion = told(page)
    lanes = {lane["name"]: lane["stretches"] for lane in motion["lanes"]}
    assert set(lanes) == {*report.ranked, NO_ANSWER} >= {"balance", "creeps"}
    assert [s[:2] for s in lanes["balance"]] == [[0.05, 0.06], [0.1, 0.11]]
    assert [s[:2] for s in lanes[NO_ANSWER]] == [[0.08, 0.09]]
    words = [word for event in motion["events"] if event["name"] == NO_ANSWER for word in event["words"]]
    assert len(words) == 1
    assert "InputError: friction of point 0 in frame 8 is not known" in words[0]
    assert "12 frames; 1 has no answer" in motion["note"].replace("all frames", "12 frames")
    rows = {row["name"]: row for row in motion["card"]["rows"]}
    assert list(rows) == list(report.ranked)
    assert rows["balance"]["count"] == str(int(report.of_cause("balance").sum()))
    assert rows["balance"]["t"] == report.record.t[report.worst("balance", 1)[0]] == motion["start"]
    assert motion["card"]["words"] == report.explanations[0].text
    assert not [line for line in motion["card"]["lines"] if line.startswith("creeps")]
    assert motion["title"].startswith("planted: 9 of 12 frames")


def test_long_records_are_thinned_around_what_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 60 frames 20 are pictures and 12 are solved: the only bad one is among them; in between, forces are interpolated."""
    forces = np.array(slide(60, speed=6.0).forces)
    forces[4 * 17 : 4 * 18] *= 1.2
    long = audit(slide(60, speed=6.0, forces=forces))
    monkeypatch.setattr("rbd.visual.playback.audit_motion.MOST_FRAMES", 20)
    shown = shown_audit(long, 12)
    assert 10 <= len(shown.at) <= 20
    assert {0.0, long.record.t[17], long.record.t[-1]} <= set(shown.at.tolist())
    assert re.search(r"rbd\.solve in (\d+) of 60 frames", shown.notes[0])[1] in ("9", "10", "11", "12")  # type: ignore[index]
    law = shown.pushes[0].forces.sum(axis=1)
    assert np.abs(law - [-MU * G, 0.0, G]).max() < 1e-6 * G
    assert [track.name for track in shown_audit(long, 0).pushes] == ["missing force"]


def test_a_bare_model_is_drawn_as_the_boxes_of_its_inertias() -> None:
    """`rbd.testing.box` looks as large as it is."""
    (part,) = robot_parts(solid_robot(rbd.testing.box(mass=3.0, size=(0.5, 0.3, 0.1))))
    assert np.sort(np.ptp(part.mesh.vertices, axis=0)) == pytest.approx([0.1, 0.3, 0.5], abs=1e-12)
    corners = part.mesh.vertices @ part.placement.rotation.T + part.placement.translation
    assert np.abs(corners).max(axis=0) == pytest.approx([0.25, 0.15, 0.05], abs=1e-12)


def test_one_frame_and_none_that_touches_have_pages(tmp_path: Path) -> None:
    """An answer of a moment; and a box in the air."""
    one = told(audit(slide().some([3])).export(tmp_path / "one.html"))
    assert len(one["times"]) == 2
    assert np.abs(acting(one)[2].sum(axis=1) - [-MU * G, 0.0, G]).max() < 1e-5 * G
    falls = Record.of_arrays(
        BOX, t=[0.0, 0.1], q=[[0, 0, 1.0, 0, 0, 0, 1]] * 2, v=np.zeros((2, 6)), a=[[0, 0, -G, 0, 0, 0]] * 2
    )
    motion = told(audit(falls).export(tmp_path / "air.html", charts=["missing force"]))
    assert (motion["contacts"], motion["pushes"], motion["lanes"]) == ([], [], [])
    with pytest.raises(InputError, match="no numbers for the chart 'depth'"):
        audit(falls).export(tmp_path / "no.html", charts=["depth"])


def test_two_engines_are_beside_each_other(tmp_path: Path) -> None:
    """Each with its forces and disks; lanes say from when on they are apart, the card why."""
    right = slide()
    forces, q = np.array(right.forces), np.array(right.q)
    forces[24:28] *= 1.1
    q[9:, 1] += 0.003
    compared = compare(right, slide(forces=forces, q=q, engine="other"))
    motion = told(compared.export(tmp_path / "both.html"))
    second = motion["second"]
    assert (motion["name"], second["name"]) == ("1: planted", "2: other, dashed curves")
    assert motion["title"] == "planted and other part at 0.06 s"
    assert compared.parting is not None
    assert motion["card"]["words"] == compared.parting.text
    lanes = {lane["name"]: [s[:2] for s in lane["stretches"]] for lane in motion["lanes"]}
    assert lanes == {"motions apart": [[0.09, 0.11]], "forces apart": [[0.06, 0.07]]}
    rows = unpacked(second["rows"]).reshape(N, -1)[:, 7 * second["bodies"] + 3 :][:, :24].reshape(N, 4, 6)
    assert np.abs(rows[6, :, 3:].sum(axis=0) - 1.1 * np.array([-MU * G, 0.0, G])).max() < 1e-5 * G
    assert all(each["contacts"][0]["disks"] for each in (motion, second))
    assert motion["start"] == 0.06


def test_the_browser_shows_disks_and_goes_to_worst_frames(report: AuditReport, page: Path) -> None:
    """A click on a row of the card; a disk of a slipping point is yellow, of a creeping one red and half full.

    The page opens at the worst frame, but a camera that follows goes with the robot from where the first frame has it.
    """
    if find_browser() is None:
        pytest.skip("no Chromium on this machine")
    ask = """(() => {
        const {player} = stage, {tracks} = player.cast, {disk, inner} = tracks[0].dots[0];
        const color = () => '#' + (inner.visible ? inner : disk).children[0].material.color.getHexString();
        const buttons = [...document.querySelectorAll('#legend .card button')];
        buttons.find((each) => each.textContent === 'creeps').click();
        const from = player.cast.start, crept = [player.t, color(), inner.visible ? inner.scale.x ** 2 : 1];
        player.go(0);
        return {from, crept, slid: color(), flat: disk.position.z, aside: tracks[1].big.node.parent.position.length()};
    })()"""
    with Browser() as browser, browser.open(page, width=800, height=600) as shown:
        seen = shown.evaluate(ask)
    colors = list(POINT_COLORS.values())
    crept = report.record.t[report.worst("creeps", 1)[0]]
    assert seen["crept"] == [pytest.approx(crept), colors[CREEPS], pytest.approx(0.5, abs=1 / 255)]
    assert (seen["slid"], seen["flat"]) == (colors[SLIPS], 0.0)
    assert seen["aside"] > 0.0
    assert seen["from"] == pytest.approx([0.0, 0.0, 0.1], abs=SINGLE)
