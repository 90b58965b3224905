"""The page and the plots of a report on a motion: what they show is what the report says."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import rbd
from rbd.visual import Scene, export_motion, plot_report, screenshot
from rbd.visual.playback.animation import shown_motion
from rbd.visual.playback.report_motion import MOMENT_ARM, cause_colors

UP = 24
"""The frame from which the robot hangs in the air."""
HANGS = 0.05
N = 40


@pytest.fixture(scope="module")
def report(g1):
    """G1 stands still on a floor at -0.1 m, and from one frame on hangs 5 cm above it."""
    q = np.tile(g1.standing().q, (N, 1))
    q[UP:, 2] += HANGS
    still = np.zeros((N, g1.nv))
    t = np.arange(N) / 30.0
    low = rbd.Motion.of_arrays(g1, t, q - np.eye(g1.nq)[2] * 0.1, still, still, source="hangs.csv", ground=-0.1)
    return rbd.check_motion(low)


@pytest.fixture(scope="module")
def page(report, tmp_path_factory):
    return export_motion(report, tmp_path_factory.mktemp("report") / "hangs.html")


@pytest.fixture(scope="module")
def told(page):
    """The motion that the page holds."""
    notes = [json.loads(n) for n in re.findall(r"stage\.note\((\{.*)\);", page.read_text(encoding="utf-8"))]
    return next(n["motion"] for n in notes if "motion" in n)


def numbers(packed: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed), "<f4")


def rows(told: dict) -> np.ndarray:
    return numbers(told["rows"]).reshape(len(told["times"]), -1)


def test_what_hangs_in_the_air_misses_its_weight(report):
    """The motion of these tests is what they take it for: closed form of the missing force."""
    weight = report.motion.robot.mass * 9.81
    assert report.possible[: UP - 1].all() and not report.possible[UP:].any()
    assert np.abs(report.missing[UP:, :3] - [0.0, 0.0, weight]).max() < 1e-6 * weight


def test_the_page_has_every_frame_of_the_motion(report, told):
    """A picture for each frame: none is between two, where forces would be blended."""
    assert np.allclose(told["times"], report.motion.t, atol=1e-9)


def test_the_missing_force_is_an_arrow_at_the_centre_of_mass(report, told):
    """Its point is Pinocchio's centre of mass over the floor; its force and moment are the report's."""
    got = rows(told)
    assert [push["name"] for push in told["pushes"]] == ["missing force", f"missing moment / {MOMENT_ARM:g} m"]
    for i in (0, UP - 1, UP, N - 1):
        com = report.motion.state(i).com + [0.0, 0.0, 0.1]  # the page's floor is at zero
        assert np.abs(got[i, -12:-9] - com).max() < 1e-5 and np.abs(got[i, -6:-3] - com).max() < 1e-5
        assert np.abs(got[i, -9:-6] - report.missing[i, :3]).max() < 1e-3
        assert np.abs(got[i, -3:] * MOMENT_ARM - report.missing[i, 3:]).max() < 1e-3


def test_contact_forces_of_the_page_carry_what_is_not_missing(report, told):
    """All arrows together, the missing one included, are the weight of a robot that does not move."""
    got, k = rows(told), sum(contact["points"] for contact in told["contacts"])
    forces = got[:, -12 - 6 * k : -12].reshape(N, k, 6)[:, :, 3:].sum(axis=1) + got[:, -9:-6]
    assert np.abs(forces - [0.0, 0.0, report.motion.robot.mass * 9.81]).max() < 1e-2


def test_lanes_tell_when_a_contact_touches_and_a_cause_holds(report, told):
    """Soles touch until the robot hangs; then it floats until the end."""
    t = report.motion.t
    for contact in told["contacts"]:
        assert [stretch[:2] for stretch in contact["stretches"]] == [[0.0, pytest.approx(t[UP])]]
    lanes = {lane["name"]: lane for lane in told["lanes"]}
    assert set(lanes) == {cause for cause in rbd.motion.CAUSES if report.of_cause(cause).any()} >= {"floats"}
    assert [stretch[:2] for stretch in lanes["floats"]["stretches"]] == [[pytest.approx(t[UP]), pytest.approx(t[-1])]]
    assert lanes["floats"]["color"] == cause_colors()["floats"]
    floats = next(mark for mark in told["events"] if mark["name"] == "floats")
    assert floats["t"] == pytest.approx(t[report.worst("floats", 1)[0]]) and "100 % of the weight" in floats["words"][0]
    leaves = [mark for mark in told["events"] if mark["kind"] == "leaves"]
    assert {mark["name"] for mark in leaves} == {contact["name"] for contact in told["contacts"]}


def test_curves_are_those_of_the_report(report, told):
    """Missing wrench in percent, the most used motors by name, friction of each sole."""
    assert np.allclose(numbers(told["charts"]["times"][0]), report.motion.t)
    missing, torque, friction, pressure = told["charts"]["charts"]
    by_name = {line["name"]: numbers(line["values"]) for line in missing["lines"]}
    assert np.allclose(by_name["missing"], 100.0 * report.missing_scaled, atol=1e-4)
    assert missing["limits"] == [{"name": "threshold", "value": 2.0}]
    names = [name.removesuffix("_joint") for name in report.motion.robot.actuated_names]
    curves = {line["name"]: numbers(line["values"]) for line in torque["lines"]}
    rest = curves.pop("largest of the others")
    peaks = report.used_torque.max(axis=0)
    assert set(curves) == {names[j] for j in np.argsort(-peaks, kind="stable")[:4]}
    assert torque["limits"] == [{"name": "limit", "value": 100.0}]
    for name, values in curves.items():
        assert np.allclose(values, 100.0 * report.used_torque[:, names.index(name)], atol=1e-3)
        assert values.max() >= rest.max() - 1e-3
    assert [line["name"] for line in friction["lines"]] == [contact.name for contact in report.lanes.contacts]
    assert all(np.isnan(numbers(line["values"])[UP:]).all() for line in friction["lines"])
    for line, edge in zip(pressure["lines"], report.edge_margin.T, strict=True):
        assert np.array_equal(numbers(line["values"]), (1e3 * edge).astype("<f4"), equal_nan=True)


def test_a_robot_without_limits_has_no_curve_of_torques(report, tmp_path):
    """There is nothing to measure them by."""
    free = rbd.check_motion(report.motion, torque_limits=False, self_collision=False)
    text = export_motion(free, tmp_path / "x.html").read_text(encoding="utf-8")
    assert "missing wrench, % of the weight" in text and "motor torques, %" not in text


def test_the_page_opens_where_most_is_missing(report, told, tmp_path):
    """By default; or where it is told to."""
    assert told["start"] == pytest.approx(report.motion.t[report.missing_scaled.argmax()])
    other = export_motion(report, tmp_path / "x.html", start=0.1, title="Hangs").read_text(encoding="utf-8")
    assert '"start": 0.1' in other and "<title>Hangs</title>" in other
    assert told["title"] == f"hangs.csv: {report.possible.sum()} of {N} frames possible"
    m = report.motion
    unnamed = replace(report, motion=rbd.Motion.of_arrays(m.robot, m.t, m.q, m.v, m.a))
    assert shown_motion(unnamed).title == f"g1: {report.possible.sum()} of {N} frames possible"


def test_contacts_that_never_touch_are_left_out(report):
    """Hands that could touch the floor, and do not, would only make the page larger."""
    every = rbd.check_motion(report.motion, bodies=True, self_collision=False)
    assert len(every.lanes.contacts) > 2 and set(shown_motion(every).points) == {c.name for c in report.lanes.contacts}


def test_a_report_shows_the_motion_before_it(report):
    """As a ghost on the same floor, with lanes of its contacts and how far this one is from it; at its times, where slower."""
    m = report.motion
    turned = m.q.copy()
    turned[:, 7:] += 0.01
    slow = rbd.Motion.of_arrays(m.robot, 2.0 * m.t, turned, 0.0 * m.v, 0.0 * m.a, ground=-0.1)
    shown = shown_motion(report.checked_again(slow.lifted(0.02)))
    assert np.array_equal(shown.defaults["ghost"].t, slow.t) and np.array_equal(shown.defaults["ghost"].q, m.q)
    assert set(shown.modes["left_sole, before"][: UP - 1]) == {"sticks"} and shown.modes["left_sole, before"][-1] == "open"
    joints, base, _ = next(c for c in shown.charts(True) if c.name == "deviation").lines
    assert joints.values == pytest.approx(10.0) and base.values == pytest.approx(20.0)  # [mrad], [mm]
    other = shown_motion(report.checked_again(m.cut(0.0, 0.5)))  # not the same frames
    assert other.defaults["ghost"] is None and "left_sole, before" not in other.modes
    with pytest.raises(rbd.InputError, match="deviation"):
        other.charts(["deviation"])


def test_a_browser_draws_the_curves(page, tmp_path, browser):
    """The panel is on the right side of a wide window: text and curves there, which a page without them has not."""
    from matplotlib.image import imread

    picture = imread(screenshot(page, tmp_path / "page.png", width=1200, height=700, browser=browser))
    panel = picture[20:440, 830:1180, :3]
    assert (np.ptp(panel, axis=2) > 0.4).sum() > 200  # coloured lines; walls and robot are grey
    assert (panel.max(axis=2) < 0.3).sum() > 200  # headings and the line of the present time


def test_plots_draw_the_report(report):
    """Lines are the report's, in percent; frames that are not possible are shaded."""
    axes = Figure().subplots(2)
    drawn = plot_report(axes, report)
    assert np.allclose(drawn[1].get_ydata(), 100.0 * report.missing_scaled)
    assert np.allclose(drawn[0].get_ydata(), 300.0 * report.open) and np.allclose(drawn[2].get_ydata(), 2.0)
    labels = [line.get_label() for line in axes[1].get_lines()]
    assert "limit" in labels and len(labels) == 6
    shade = drawn[-1].get_paths()[0].vertices[:, 0]
    assert report.motion.t[UP - 2] < shade.min() <= report.motion.t[UP] and shade.max() == pytest.approx(report.motion.t[-1])
    assert len(plot_report(None, report)[0].figure.axes) == 2
    assert len(report.plot(Figure().subplots())) == 4  # one pair of axes: the missing wrench alone


def test_the_live_view_goes_through_the_frames(report, monkeypatch):
    """It opens one browser, whose page has the missing force of the last frame; if no browser comes, it ends all the same."""
    opened, sent = [], []
    stage = Scene.stage_motion
    monkeypatch.setattr("webbrowser.open", lambda address, new: opened.append(address))
    monkeypatch.setattr("rbd.visual.playback.animation.VIEWER_SECONDS", 0.05)

    def heard(self, motion, *args, **further):
        sent.append(json.loads(motion)["motion"])
        stage(self, motion, *args, **further)

    monkeypatch.setattr(Scene, "stage_motion", heard)
    report.show(speed=20.0)
    assert len(opened) == 1 and opened[0].startswith("http://127.0.0.1:")
    (found,) = sent
    assert found["times"][0] == 0.0 and found["times"][-1] == pytest.approx(report.motion.t[-1]) and found["playing"]
    assert np.abs(numbers(found["rows"])[-9:-6] - report.missing[-1, :3]).max() < 1e-3


def test_what_is_no_report_is_refused(report, tmp_path):
    """By name, before anything is drawn or written."""
    with pytest.raises(rbd.RbdError, match=r"expected what rbd\.check_motion returned"):
        plot_report(None, 3)
    with pytest.raises(rbd.RbdError, match="axes are 3"):
        plot_report(Figure().subplots(3), report)
    for bad in ("noon", float("nan")):
        with pytest.raises(rbd.RbdError, match="start"):
            export_motion(report, tmp_path / "x.html", start=bad)
    with pytest.raises(rbd.RbdError, match="one sample"):
        first = rbd.Motion.of_arrays(report.motion.robot, [0.0], report.motion.q[:1], report.motion.v[:1], report.motion.a[:1])
        rbd.check_motion(first, self_collision=False).export(tmp_path / "x.html")
    assert not (tmp_path / "x.html").exists()
