"""Pictures of motion: right poses at right times, arrows as long as forces, one offline page, a bar that obeys."""

from __future__ import annotations

import base64
import json
import re
import time
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image

import rbd
from rbd.errors import InputError, PictureError
from rbd.model.checked_model import CheckedModel
from rbd.model.external import ExternalForce
from rbd.simulation.simulated_motion import Event
from rbd.visual import Scene, contact_colors, find_browser, screenshot
from rbd.visual.playback.animation import export_motion, motion_sheet, replay, shown_motion
from rbd.visual.playback.motion_frames import frames_of
from rbd.visual.robot_meshes import robot_parts

SINGLE = 1e-6
"""What is left of a metre, or of a unit quaternion, in single precision."""
TURN = np.array([0.3, 1.1, -0.4])  # rad/s, about the body's own axes
SPEED = np.array([0.5, 0.1, 0.0])


@dataclass(frozen=True, eq=False)
class Motion:
    """As much of a trajectory as pictures read."""

    robot: rbd.Robot
    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    points: dict = field(default_factory=dict)
    point_forces: dict = field(default_factory=dict)
    modes: dict = field(default_factory=dict)
    events: tuple = ()


@pytest.fixture(scope="module")
def box():
    """A box of two parts."""
    return rbd.load_robot("urdf/box.urdf")


def evenly(robot, times, turn=TURN):
    """A free body that flies and turns evenly: position and rotation in closed form, exact at any time."""
    q0 = pin.neutral(robot.model)
    q0[2] = 0.8
    v = np.zeros(robot.nv)
    q = []
    for t in times:
        at = q0[:3] + t * SPEED
        q.append(np.concatenate([at, pin.Quaternion(pin.exp3(t * turn)).coeffs()]))
        v[3:6] = turn
    return np.array(q), np.tile(v, (len(times), 1))


def touching(times):
    """Two contacts: one of two points that is closed from 0.2 to 0.6 s with a force that grows, and one that never is."""
    n = len(times)
    closed = (times >= 0.2 - 1e-12) & (times <= 0.6 + 1e-12)
    points = np.tile([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]], (n, 1, 1))
    forces = np.zeros((n, 2, 3))
    forces[closed, 0] = np.column_stack([0 * times, 2.0 * times, 10.0 * times])[closed]
    forces[closed, 1, 2] = 5.0
    far = np.full((n, 1, 3), np.nan)
    modes = {"feet": np.where(closed, "sticks", "open"), "hand": np.full(n, "open")}
    given = {"feet": forces, "hand": np.zeros((n, 1, 3))}
    return {"points": {"feet": points, "hand": far}, "point_forces": given, "modes": modes}


@pytest.fixture(scope="module")
def motion(box):
    times = np.linspace(0.0, 1.0, 501)
    q, v = evenly(box, times)
    events = (Event(0.2, "feet", "touches", 1, 0.3, 1.5), Event(0.601, "feet", "leaves", 1), Event(0.602, "feet", "leaves", 0))
    return Motion(box, times, q, v, **touching(times), events=events)


@pytest.fixture(scope="module")
def page(motion, tmp_path_factory):
    return export_motion(motion, tmp_path_factory.mktemp("motion") / "box.html", title="A box")


def score_of(page):
    """(the motion in a page, its rows, its codes)."""
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    score = next(n["motion"] for n in notes if "motion" in n)
    n = len(score["times"])
    rows = np.frombuffer(base64.b64decode(score["rows"]), "<f4").reshape(n, -1)
    return score, rows, np.frombuffer(base64.b64decode(score["codes"]), "u1").reshape(n, -1)


# Frames


def test_poses_in_the_page_are_those_of_pinocchio(tmp_path):
    """Every part of a two-legged robot that moves all its joints has Pinocchio's placement in every frame."""
    rng, times = np.random.default_rng(3), np.linspace(0.0, 0.5, 16)
    bolt = rbd.load_robot("bolt")
    start, v = np.array(bolt.standing().q), rng.normal(size=bolt.nv)
    q = np.array([pin.integrate(bolt.model, start, t * v) for t in times])
    score, rows, _ = score_of(export_motion(Motion(bolt, times, q, np.tile(v, (16, 1))), tmp_path / "bolt.html"))
    assert np.allclose(score["times"], times, atol=1e-9)
    data, geometry = bolt.model.createData(), bolt.visual_model
    placed = pin.GeometryData(geometry)
    assert len(score["parts"]) == sum(part.joint > 0 for part in robot_parts(bolt))
    worst = 0.0
    for q_i, row in zip(q, rows, strict=True):
        pin.updateGeometryPlacements(bolt.model, data, geometry, placed, q_i)
        com = pin.centerOfMass(bolt.model, data, q_i)
        k = 7 * score["bodies"]
        worst = max(worst, np.abs(row[k : k + 3] - com).max())
        for part in score["parts"]:
            pose = pin.XYZQUATToSE3(np.array(row[7 * part["body"] : 7 * part["body"] + 7], float))
            X_WG = pose * pin.XYZQUATToSE3(np.array(part["at"]))
            worst = max(worst, np.abs(X_WG.homogeneous - placed.oMg[part["node"]].homogeneous).max())
    assert worst < SINGLE


@pytest.mark.parametrize(("fps", "speed", "expected"), [(30, 1.0, 31), (50, 1.0, 51), (30, 0.5, 61), (30, 2.0, 16)])
def test_there_are_as_many_frames_as_asked_for(motion, tmp_path, fps, speed, expected):
    """Frames a second of playback: at half the speed twice as many of them."""
    score, rows, codes = score_of(export_motion(motion, tmp_path / "x.html", fps=fps, speed=speed))
    assert len(score["times"]) == len(rows) == len(codes) == expected
    assert score["times"][0] == 0.0 and score["times"][-1] == 1.0
    assert speed in score["speeds"] and {0.1, 2.0} <= set(score["speeds"])


def test_frames_are_samples_where_those_are_near(motion):
    """No interpolated configuration stands for one that was computed 1 ms away."""
    assert np.isin(frames_of(shown_motion(motion), [1], fps=30).times, motion.t).all()


def test_between_coarse_samples_a_body_turns_evenly(box):
    """Three samples, thirty frames: what flies straight and turns evenly is where it really is in each of them."""
    times = np.array([0.0, 0.4, 1.0])
    frames = frames_of(shown_motion(Motion(box, times, *evenly(box, times))), [1], fps=30)
    assert len(frames.times) == 31
    exact = evenly(box, frames.times)[0]
    turned = np.abs(np.einsum("ij,ij->i", frames.poses[:, 0, 3:], exact[:, 3:]))
    assert np.abs(turned - 1.0).max() < 1e-12 and np.abs(frames.poses[:, 0, :3] - exact[:, :3]).max() < 1e-12


def test_what_turns_fast_has_more_frames(box):
    """At 60 rad/s thirty frames a second would turn the body backwards; no step is over half a radian, no sign jumps."""
    times = np.linspace(0.0, 1.0, 2001)
    frames = frames_of(shown_motion(Motion(box, times, *evenly(box, times, np.array([0.0, 0.0, 60.0])))), [1])
    cosines = np.einsum("ij,ij->i", frames.poses[1:, 0, 3:], frames.poses[:-1, 0, 3:])
    assert 120 <= len(frames.times) <= 130 and cosines.min() > np.cos(0.26)


def test_forces_of_a_frame_are_those_of_its_sample(motion, page):
    """Points and forces in the rows, in order; NaN where a point is not; the colours of the plots."""
    score, rows, codes = score_of(page)
    at = np.searchsorted(motion.t, np.array(score["times"]) - 1e-9)
    k = 7 * score["bodies"] + 3
    feet = rows[:, k : k + 12].reshape(-1, 2, 6)
    assert np.abs(feet[:, :, :3] - motion.points["feet"][at]).max() < SINGLE
    assert np.abs(feet[:, :, 3:] - motion.point_forces["feet"][at]).max() < 10 * SINGLE
    assert np.isnan(rows[:, k + 12 : k + 15]).all() and not rows[:, k + 15 :].any()
    assert [score["words"][c] for c in codes[:, 0]] == list(motion.modes["feet"][at])
    assert {c["name"]: c["color"] for c in score["contacts"]} == contact_colors(["feet", "hand"])
    assert score["contacts"][0]["stretches"] == [[0.2, 0.602, score["words"].index("sticks")]]


def test_a_push_is_there_while_it_acts(motion, tmp_path):
    """A force as a function of time has its arrow at its point from its beginning to its end, and none outside."""

    def external(state, t):
        return ExternalForce(motion.robot.frames()[-1], [0.0, 3.0, 0.0]) if t < 0.5 else ()

    score, rows, _ = score_of(export_motion(motion, tmp_path / "x.html", external=external))
    early = np.array(score["times"]) < 0.5
    assert len(score["pushes"]) == 1 and (rows[early, -2] == 3.0).all() and not rows[~early, -3:].any()


def test_constraints_without_points_are_told_by_their_mode(motion, tmp_path):
    """A joint's stop has no arrow, but a line in the legend."""
    stops = replace(motion, modes={**motion.modes, "stop": np.where(motion.t > 0.5, "pushes", "open")})
    score, _, codes = score_of(export_motion(stops, tmp_path / "x.html"))
    assert score["others"] == ["stop"] and "pushes" in score["words"]
    assert [score["words"][codes[i, 2]] for i in (0, -1)] == ["open", "pushes"]


# Page


def test_the_page_asks_for_nothing_from_outside(page):
    """Nothing outside the viewer names an address, and the page forbids the browser every request."""
    text = page.read_text(encoding="utf-8")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy and "default-src 'none'" in policy[1] and "connect-src 'none'" in policy[1]
    scripts = re.findall(r"<script>(.*?)</script>", text, flags=re.DOTALL)
    ours = text.replace(max(scripts[:1], key=len), "")
    assert len(ours) < len(text) and not re.search(r"(?:https?|wss?|file)://", ours)


def test_the_same_motion_gives_the_same_page(motion, page, tmp_path):
    """No clock and no random name goes into a page."""
    assert export_motion(motion, tmp_path / "again.html", title="A box").read_bytes() == page.read_bytes()


def test_ten_seconds_of_a_humanoid_are_less_than_a_megabyte(talos):
    """At thirty frames a second, over what a still page takes."""
    times = np.linspace(0.0, 10.0, 101)
    still = Motion(talos, times, np.tile(talos.standing().q, (101, 1)), np.zeros((101, talos.nv)))
    joints = sorted({part.joint for part in robot_parts(talos)} - {0})
    frames = frames_of(shown_motion(still), joints)
    assert len(frames.times) == 301 and frames.rows.astype("f4").nbytes * 4 / 3 < 1e6


def test_events_are_marks_with_their_words(motion, page, tmp_path):
    """One mark a contact and hundredth of the bar; of very many events the first and their number."""
    marks = score_of(page)[0]["events"]
    told = [(m["t"], m["kind"], m["point"], len(m["words"])) for m in marks]
    assert told == [(0.2, "touches", 1, 1), (0.601, "leaves", 1, 2)]
    assert marks[0]["words"] == [str(motion.events[0])]
    many = tuple(Event(0.5 + 1e-5 * i, "feet", "slips") for i in range(100))
    marks = score_of(export_motion(replace(motion, events=many), tmp_path / "x.html"))[0]["events"]
    assert len(marks) == 1 and len(marks[0]["words"]) == 9 and marks[0]["words"][-1].startswith("and 92 more")


def test_what_happens_after_the_end_is_no_mark(motion, tmp_path):
    """A shortened motion keeps the events of the whole one; the bar has those of its own time."""
    late = replace(motion, events=(*motion.events, replace(motion.events[0], t=motion.t[-1] + 1.0)))
    marks = [score_of(export_motion(each, tmp_path / "x.html"))[0]["events"] for each in (late, motion)]
    assert len(motion.events) > 0 and marks[0] == marks[1]


def test_what_chatters_is_told_as_coarsely_as_it_is_shown(box):
    """Of a thousand changes of mode in one second, 30 frames show 30 at most."""
    times = np.linspace(0.0, 1.0, 1001)
    q = np.tile(box.neutral(), (len(times), 1))
    words = ["sticks" if i % 2 else "slips" for i in range(len(times))]
    chatter = Motion(box, times, q, np.zeros((len(times), box.nv)), modes={"foot": words})
    stretches = frames_of(shown_motion(chatter), [1], fps=30).stretches["foot"]
    assert 1 <= len(stretches) <= 30 and stretches[0][0] == 0.0 and stretches[-1][1] == 1.0
    assert all(a[1] == b[0] for a, b in zip(stretches, stretches[1:], strict=False))
    assert len(frames_of(shown_motion(replace(chatter, modes={"foot": ["sticks"] * 1001})), [1], fps=30).stretches["foot"]) == 1


def test_without_bodies_the_centre_of_mass_alone_moves(box):
    """Of a robot with nothing to draw: no poses, one place a frame."""
    times = np.array([0.0, 0.5, 1.0])
    q = np.tile(box.neutral(), (3, 1))
    q[:, 0] = times
    frames = frames_of(shown_motion(Motion(box, times, q, np.zeros((3, box.nv)))), [], fps=2)
    assert frames.poses.shape == (3, 0, 7) and np.abs(frames.com[:, 0] - frames.times).max() < 1e-12


def test_the_camera_sees_all_of_the_motion(motion, page):
    """The box at its start and its end, and the longest arrow, are within what is framed."""
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    points = np.array([n["view"]["points"] for n in notes if "view" in n][-1])
    assert points[:, 0].min() < 0.0 and points[:, 0].max() > 0.5 and points[:, 2].min() < 1e-3


def test_a_robot_that_goes_far_is_followed(box, tmp_path):
    """What goes over five times its size is; unless it is said otherwise."""
    times = np.linspace(0.0, 100.0, 101)
    far = Motion(box, times, *evenly(box, times))
    assert score_of(export_motion(far, tmp_path / "x.html"))[0]["follow"] is True
    assert score_of(export_motion(far, tmp_path / "x.html", follow=False))[0]["follow"] is False


def test_names_cannot_break_out_of_the_page(motion, tmp_path):
    """A contact called </script> is text."""
    odd = "</script><b>"
    renamed = replace(motion, **{k: {odd: getattr(motion, k)["feet"]} for k in ("points", "point_forces", "modes")}, events=())
    assert odd not in export_motion(renamed, tmp_path / "x.html", title=odd).read_text(encoding="utf-8")


def test_wrong_uses_are_refused_in_words(motion, tmp_path):
    """What came, what was expected, what to try."""
    out = tmp_path / "x.html"

    def cut(n):
        some = {k: {c: x[:n] for c, x in getattr(motion, k).items()} for k in ("points", "point_forces", "modes")}
        return replace(motion, t=motion.t[:n], q=motion.q[:n], v=motion.v[:n], **some)

    bare = CheckedModel(motion.robot.model)
    broken = motion.q.copy()
    broken[7, 2] = np.nan
    wrong = [
        (InputError, "has no sample", (cut(0), out), {}),
        (InputError, "one sample only.*Scene", (cut(1), out), {}),
        (InputError, "no trajectory; expected what rbd.simulate", (motion.robot, out), {}),
        (InputError, r"q is not finite at 0\.014 s.*\[:7\]", (replace(motion, q=broken), out), {}),
        (InputError, "times.*do not increase", (replace(motion, t=0 * motion.t), out), {}),
        (InputError, "fps is 0", (motion, out), {"fps": 0}),
        (InputError, "speed is -1", (motion, out), {"speed": -1}),
        (InputError, "speed is 0.0001; expected at least 0.001", (motion, out), {"speed": 1e-4}),
        (InputError, "'box' has no meshes: it is a bare model", (replace(motion, robot=bare), out), {}),
        (InputError, "start is 7; the motion runs from 0 s to 1 s", (motion, out), {"start": 7}),
        (InputError, "title is 3", (motion, out), {"title": 3}),
        (PictureError, r"ends in \.html", (motion, tmp_path / "x.png"), {}),
        (PictureError, "No such file.*Give a file in a folder", (motion, tmp_path / "no" / "x.html"), {}),
    ]
    for error, words, given, settings in wrong:
        with pytest.raises(error, match=words):
            export_motion(*given, **settings)
    with pytest.raises(InputError, match="a time is 2.0; the motion runs"):
        motion_sheet(motion, [0.0, 2.0], tmp_path / "x.png")
    with pytest.raises(InputError, match="times have the shape"):
        motion_sheet(motion, [], tmp_path / "x.png")
    with pytest.raises(InputError, match="scene is 3"):
        replay(motion, scene=3)
    with pytest.raises(InputError, match="at is 'now'"):
        screenshot(out, tmp_path / "x.png", at="now")


# In a browser

ASK = """(() => {
const told = {};
const world = (node) => { node.updateWorldMatrix(true, false); return node.matrixWorld.toArray(); };
for (const t of TIMES) {
  stage.player.seek(t);
  told[t] = {
    parts: stage.player.cast.parts.map((part) => world(part.object)),
    arrows: stage.player.cast.tracks.map(({ big }) => {
      const tip = big.heads[0].position.z + big.heads[0].scale.z;
      return big.node.visible ? [tip, ...world(big.node).slice(8, 15)] : [];
    }),
    legend: document.getElementById("legend").textContent,
    clock: document.querySelector(".clock").textContent,
  };
}
const press = (key) => window.dispatchEvent(new KeyboardEvent("keydown", { key }));
const keys = {};
stage.player.seek(0.0);
for (const key of ["ArrowRight", "PageDown", "PageDown", "End", "PageUp", "Home", "ArrowUp", " "]) {
  press(key);
  keys[Object.keys(keys).length] = [key, stage.player.t, stage.player.speed, stage.player.playing];
}
return { told, keys, marks: document.querySelectorAll(".event").length };
})()"""
FROM_THREE = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From three.js's world, y up, to W, z up."""
SEEN_TIMES = (0.0, 0.2, 0.4125, 0.5, 1.0)


@pytest.fixture(scope="module")
def told(page, browser):
    """What the page says of itself in Chromium."""
    with browser.open(page, width=800, height=600) as shown:
        return shown.evaluate(ASK.replace("TIMES", str(list(SEEN_TIMES))))


def test_the_browser_shows_each_body_where_it_is(told, motion):
    """World poses in the viewer's own tree, at frames and between them, equal the motion in closed form."""
    parts = [part for part in robot_parts(motion.robot) if part.joint]
    for t in SEEN_TIMES:
        q = evenly(motion.robot, [t])[0][0]
        X_WB = pin.XYZQUATToSE3(q)
        shown = [FROM_THREE @ np.reshape(m, (4, 4)).T for m in told["told"][f"{t:g}"]["parts"]]
        assert len(shown) == len(parts)
        for part, matrix in zip(parts, shown, strict=True):
            assert np.abs(matrix - (X_WB * part.placement).homogeneous).max() < SINGLE


def test_the_arrow_in_the_browser_is_the_force(told, motion, page):
    """Length and direction of the resultant times the scale, from the centre of pressure; none while nothing touches."""
    scale = score_of(page)[0]["sizes"]["metresPerNewton"]
    for t in (0.2, 0.5):
        force, (p, f) = np.array([0.0, 2.0 * t, 10.0 * t + 5.0]), (motion.points["feet"][0], [np.hypot(2 * t, 10 * t), 5.0])
        length, *axis_and_start = told["told"][f"{t:g}"]["arrows"][0]
        rest = np.concatenate([FROM_THREE @ axis_and_start[:4], FROM_THREE @ [*axis_and_start[4:], 1.0]])
        assert abs(length - scale * np.linalg.norm(force)) < SINGLE
        assert np.abs(rest[:3] - force / np.linalg.norm(force)).max() < SINGLE
        assert np.abs(rest[4:7] - (np.array(f) @ p) / sum(f)).max() < SINGLE
        assert told["told"][f"{t:g}"]["arrows"][1] == []
    assert told["told"]["0"]["arrows"] == [[], []]


def test_the_legend_tells_modes_and_newtons_of_the_moment(told):
    """Mode and force of each contact, the last event, the time."""
    during, after = told["told"]["0.5"], told["told"]["1"]
    assert f"feetsticks{np.hypot(1.0, 10.0):.3g} N" in during["legend"] and "handopen0 N" in during["legend"]
    assert "touches at 0.3 m/s" in during["legend"] and during["clock"] == "0.50 / 1.00 s"
    assert "feetopen0 N" in after["legend"] and "0.601000 s: feet[1] leaves" in after["legend"]


def test_keys_step_jump_and_play(told):
    """Right: a frame; page down: the next event; end, page up, home; up: faster; space: play."""
    seen = list(told["keys"].values())
    assert [round(t, 3) for _, t, _, _ in seen] == [0.033, 0.2, 0.601, 1.0, 0.601, 0.0, 0.0, 0.0]
    assert [speed for _, _, speed, _ in seen[-3:]] == [1.0, 2.0, 2.0]
    assert [playing for *_, playing in seen] == 7 * [False] + [True]
    assert told["marks"] == 2


def test_a_strip_shows_the_motion_from_left_to_right(motion, tmp_path):
    """Three pictures in a row, of the size asked for, with the time in writing under each, no two alike."""
    if find_browser() is None:
        pytest.skip("Chromium is not installed: no picture to look at")
    picture = motion_sheet(motion, 3, tmp_path / "strip.png", width=200, height=160)
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"), float)
    assert pixels.shape == (160 + 34, 3 * 200 + 2 * 6, 3)
    cells = [pixels[:160, 206 * i : 206 * i + 200] for i in range(3)]
    assert min(np.abs(a - b).max() for a, b in zip(cells, cells[1:], strict=False)) > 50
    for i in range(3):
        assert (pixels[160:, 206 * i : 206 * i + 200].max(axis=2) < 110).sum() > 40


# Live


def staged(scene):
    """Listen to a scene; returns the list of motions, and of pauses, that it will be told."""
    told = []

    def hear(message):
        if isinstance(message, str) and message[2:8] in ("motion", "paused"):
            told.append(json.loads(message))

    scene.recorder.listen(hear)
    return told


def test_a_replay_keeps_time_and_ends_at_the_end(motion, box, monkeypatch):
    """Half a second of playback takes half a second; the page has all frames, the first and the last among them, and plays."""
    slept = []
    monkeypatch.setattr("rbd.visual.playback.animation.time.sleep", slept.append)
    with Scene(box) as scene:
        scene.show(rbd.State(box, motion.q[0]))
        told = staged(scene)
        replay(motion, speed=2.0, scene=scene)
    ((found,),) = [list(message.values()) for message in told]
    assert slept == [pytest.approx(0.5, rel=1e-9)] and found["playing"] and found["speed"] == 2.0
    assert found["times"][0] == 0.0 and found["times"][-1] == 1.0 and (np.diff(found["times"]) > 0.0).all()
    row = np.frombuffer(base64.b64decode(found["rows"]), "<f4").reshape(len(found["times"]), -1)[-1]
    assert np.abs(row[:3] - motion.q[-1, :3]).max() < SINGLE


def test_control_c_ends_a_replay_and_a_new_picture_ends_the_motion(motion, box, monkeypatch):
    """The replay returns at once, without an error, and the page pauses; `show` then takes the arrows of the motion away."""

    def interrupted(seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr(time, "sleep", interrupted)
    with Scene(box) as scene:
        told = staged(scene)
        replay(motion, scene=scene)
        assert told[-1] == {"paused": True} and "motion" in told[-2]
        scene.show(rbd.State(box, motion.q[0]))
        kept = [m for m in scene.recorder.messages()[0] if isinstance(m, str)]
        assert '{"motion": null}' in kept


def test_a_replay_of_its_own_opens_and_closes_the_browser(motion, monkeypatch):
    """A browser that does not come is not waited for for ever; the server is closed."""
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address, new: opened.append(address))
    monkeypatch.setattr("rbd.visual.playback.animation.VIEWER_SECONDS", 0.05)
    replay(motion, speed=10.0)
    assert len(opened) == 1 and opened[0].startswith("http://127.0.0.1:")
