"""Motions as videos: as many pictures as are due, each of its time, written whole or not at all."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from PIL import Image, ImageSequence
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.errors import InputError, PictureError
from rbd.visual import Browser, contact_colors, export_video
from rbd.visual.pages import encoders
from rbd.visual.pages.page import text_of
from rbd.visual.playback import video
from rbd.visual.playback.video import frame_times

SIZE = {"width": 480, "height": 300}
# It answers as ffmpeg does: tells codecs; counts the JPEG pictures that come and writes the count with the arguments.
FAKE = """#!{python}
import sys
if "-encoders" in sys.argv:
    print(" V....D {codec}  a codec")
    sys.exit(0)
data = sys.stdin.buffer.read()
if {fails}:
    print("first line", file=sys.stderr)
    print("disk quota exceeded", file=sys.stderr)
    sys.exit(7)
ends = all(p.endswith(b"\\xff\\xd9") for p in data.split(b"\\xff\\xd8\\xff\\xe0")[1:])
with open(sys.argv[-1], "wb") as out:
    out.write(repr((data.count(b"\\xff\\xd8\\xff\\xe0"), ends, sys.argv[1:-1])).encode())
"""


@pytest.fixture(scope="module")
def swing() -> rbd.Trajectory:
    """A four-bar linkage that swings for six tenths of a second."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    return rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.6, step=2e-2, progress=False)


@pytest.fixture(scope="module")
def held() -> tuple[rbd.Trajectory, list[str]]:
    """A Solo12 that holds its posture, and the names of its feet."""
    solo = rbd.load_robot("solo12")
    standing, feet = solo.standing(), solo.feet()
    hold = rbd.control.HoldPosture(standing, feet)
    return rbd.simulate(standing, feet, duration=0.1, step=5e-3, controller=hold, progress=False), [str(f.name) for f in feet]


@pytest.fixture
def on_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is first on PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return folder


def put_fake(folder: Path, codec: str = "libx264", fails: bool = False) -> None:
    """Put a program named ffmpeg into a folder."""
    path = folder / "ffmpeg"
    path.write_text(FAKE.format(python=sys.executable, codec=codec, fails=fails), encoding="utf-8")
    path.chmod(0o755)


def pictures(path: Path) -> tuple[list[np.ndarray], list[int]]:
    """Pictures of a GIF, each of shape (height, width, 3) from 0 to 255, and their times [ms]."""
    with Image.open(path) as image:
        frames = [(np.asarray(f.convert("RGB"), float), int(f.info["duration"])) for f in ImageSequence.Iterator(image)]
    return [each for each, _ in frames], [ms for _, ms in frames]


def test_pictures_are_evenly_spaced_to_the_end() -> None:
    """At so many a second of playback; the last one shows the end."""
    assert frame_times(0.0, 1.0, 30.0, 1.0) == pytest.approx(np.linspace(0.0, 1.0, 31))
    assert frame_times(2.0, 2.5, 10.0, 0.5) == pytest.approx(np.linspace(2.0, 2.5, 11))
    assert frame_times(0.0, 0.25, 10.0, 1.0) == pytest.approx([0.0, 0.1, 0.2, 0.25])
    with pytest.raises(InputError, match="a video of 100001 pictures; expected at most 20000"):
        frame_times(0.0, 100.0, 100.0, 0.1)


def test_a_gif_shows_the_motion(swing: rbd.Trajectory, browser: Browser, tmp_path: Path) -> None:
    """As many pictures as are due, of the size asked for, for as long as the motion takes; what moves is the linkage."""
    path = export_video(swing, tmp_path / "swing.gif", fps=20.0, speed=0.75, browser=browser, progress=False, **SIZE)
    shown, ms = pictures(path)
    assert len(shown) == 17
    assert sum(ms) == 850
    assert {each.shape for each in shown} == {(300, 480, 3)}
    moved = np.abs(shown[-1] - shown[0]).max(axis=2) > 60.0
    assert 20 < moved.sum() < 0.2 * moved.size
    assert (shown[0][-20:, -80:].max(axis=2) < 150.0).sum() > 40  # the clock: small letters are smoothed


def test_forces_keep_their_colours(held: tuple[rbd.Trajectory, list[str]], browser: Browser, tmp_path: Path) -> None:
    """Of few pixels, they would be lost among 256 colours chosen by area; layers can be left out."""
    trajectory, names = held
    found = []
    for layers in ({}, {"forces": False, "corner forces": False}):
        path = export_video(trajectory, tmp_path / "held.gif", fps=10.0, layers=layers, browser=browser, progress=False, **SIZE)
        last = pictures(path)[0][-1][:, 190:]  # right of the legend
        colors = [list(bytes.fromhex(color[1:])) for color in contact_colors(names).values()]
        found.append([int((np.linalg.norm(last - color, axis=2) < 45).sum()) for color in colors])
    assert min(found[0]) >= 8, found
    assert sum(found[1]) < 0.7 * sum(found[0]), found


def test_ffmpeg_is_given_every_picture(swing: rbd.Trajectory, browser: Browser, tmp_path: Path, on_path: Path) -> None:
    """Whole JPEG pictures through a pipe, the rate, the best codec that it has; the file replaces an old one."""
    put_fake(on_path, "libopenh264")
    folder = tmp_path / "out"
    folder.mkdir()
    target = folder / "swing.mp4"
    target.write_text("old")
    target.chmod(0o600)
    assert swing.video(target, fps=25.0, browser=browser, progress=False, **SIZE) == target
    count, whole, given = eval(target.read_text())  # noqa: S307 - what the fake wrote
    assert (count, whole) == (16, True)
    assert given[given.index("-framerate") + 1] == "25"
    assert "libopenh264" in given and "libx264" not in given
    assert given[given.index("-movflags") + 1] == "+faststart"
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    assert [each.name for each in folder.iterdir()] == ["swing.mp4"]


def test_a_failure_leaves_the_old_file(
    swing: rbd.Trajectory, browser: Browser, tmp_path: Path, on_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An ffmpeg that fails says why; Ctrl-C ends it; neither leaves half a file."""
    put_fake(on_path, fails=True)
    target = tmp_path / "swing.mp4"
    target.write_text("old")
    options = {"fps": 20.0, "browser": browser, "progress": False, **SIZE}
    with pytest.raises(PictureError, match=r"ffmpeg made no video \(exit 7\): disk quota exceeded"):
        swing.video(target, **options)
    put_fake(on_path)

    def interrupted(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr("rbd.visual.playback.video.base64.b64decode", interrupted)
    for path in (target, tmp_path / "swing.gif"):
        with pytest.raises(KeyboardInterrupt):
            swing.video(path, **options)
    assert target.read_text() == "old"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bin", "swing.mp4"]


def test_what_cannot_be_made_is_refused_before_work(
    swing: rbd.Trajectory, tmp_path: Path, on_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No ffmpeg, one without codecs or that does not run, another ending, odd sizes, rates that viewers do not keep."""
    monkeypatch.setattr("rbd.visual.playback.video.motion_scene", lambda *_, **__: pytest.fail("work began"))
    target = tmp_path / "x.mp4"
    put_fake(on_path)
    with pytest.raises(PictureError, match="the size is 321 x 200; expected even numbers of pixels"):
        swing.video(target, width=321, height=200)
    with pytest.raises(InputError, match="fps is 0; expected"):
        swing.video(target, fps=0)
    with pytest.raises(InputError, match="width is 4; expected a whole number from 16"):
        swing.video(target, width=4)
    with pytest.raises(PictureError, match=r"x\.avi'.*: expected a name that ends in \.mp4 or \.gif"):
        swing.video(tmp_path / "x.avi")
    with pytest.raises(PictureError, match=r"fps is 60; expected at most 50 for \.gif"):
        swing.video(tmp_path / "x.gif", fps=60)
    with pytest.raises(PictureError, match="there is no folder"):
        swing.video(tmp_path / "nowhere" / "x.gif")
    put_fake(on_path, codec="libvpx")
    with pytest.raises(PictureError, match="has none of the codecs libx264"):
        swing.video(target)
    (on_path / "ffmpeg").write_text("#!/bin/sh\nexit 1\n")
    with pytest.raises(PictureError, match="does not run"):
        swing.video(target)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(PictureError, match=r"no ffmpeg on PATH.*Install ffmpeg, or give a name that ends in \.gif"):
        swing.video(target)


def test_the_command_line_writes_a_video(tmp_path: Path, on_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rbd simulate --video`; a missing ffmpeg is told before the robot is loaded."""
    target = tmp_path / "swing.gif"
    monkeypatch.setattr(encoders, "MOST_GIF_FPS", 50.0)
    given = ["simulate", "urdf/four_bar.urdf", "--duration", "0.04", "--step", "0.01", "--video", str(target)]
    answer = CliRunner().invoke(app, given)
    assert answer.exit_code == 0, answer.output
    assert f"video: {target}" in answer.output
    assert len(pictures(target)[0]) == 3
    monkeypatch.setattr("shutil.which", lambda *_: None)
    answer = CliRunner().invoke(app, [*given[:-1], str(tmp_path / "x.mp4")])
    assert answer.exit_code == 2
    assert "no ffmpeg on PATH" in " ".join(answer.output.split())


def test_a_picture_costs_a_fraction_of_the_pages(browser: Browser, tmp_path: Path) -> None:
    """Processor time of all processes of the browser, of Talos at 960 x 540: about a sixth; at most half is asked for here."""
    talos = rbd.load_robot("talos")
    still = rbd.Motion.of_arrays(talos, np.array([0.0, 0.1]), np.array([talos.standing().q] * 2))
    page = rbd.visual.export_motion(still, tmp_path / "talos.html", charts=False)
    n, spent = 4, []
    pictures_of_page = f"""(() => {{
      const {{ renderer, scene, camera }} = stage.viewer, gl = renderer.getContext();
      for (let i = 0; i < {n}; i++) {{
        renderer.render(scene, camera);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
      }}
    }})()"""
    settings = "{ width: 960, height: 540, quality: 0.95, speed: 1 }"
    for before, ready, work in (
        ("", "0", pictures_of_page),
        (
            video._BEFORE,
            f"{text_of('rbd.visual.pages', 'web/video.js')}\nvoid (window.video = new Video(stage, {settings}))",
            f"video.frames(Array({n}).fill(0))",
        ),
    ):
        with browser.open(page, width=960, height=540, before=before) as shown:
            shown.evaluate(ready)
            shown.evaluate(work)  # what is first takes longer
            started = processor_time(browser.pid)
            shown.evaluate(work)
            spent.append(processor_time(browser.pid) - started)
    assert spent[1] < 0.5 * spent[0], spent


def test_the_camera_follows_in_a_video(browser: Browser, tmp_path: Path) -> None:
    """Where the robot travels far: its centre of mass is at one place of all pictures, and leaves it without following."""
    box, t = rbd.load_robot("urdf/box.urdf"), np.array([0.0, 1.0])
    q = np.array([[0.0, 0, 0.1, 0, 0, 0, 1], [6.0, 0, 0.1, 0, 0, 0, 1]])
    page = rbd.visual.export_motion(rbd.Motion.of_arrays(box, t, q, quaternion="xyzw"), tmp_path / "box.html", charts=False)
    settings = "{ width: 64, height: 40, quality: 0.9, speed: 1 }"
    ready = f"{text_of('rbd.visual.pages', 'web/video.js')}\nvoid (window.video = new Video(stage, {settings}))"
    where = "[0, 0.05].map((t) => { video.draw(t); return stage.project(stage.player.cast.ball.position.toArray()); })"
    with browser.open(page, width=320, height=200, before=video._BEFORE) as shown:
        shown.evaluate(ready)
        kept = shown.evaluate(where)
        shown.evaluate("stage.player.go(0); stage.player.setFollow(false)")
        left = shown.evaluate(where)
    assert np.hypot(*np.subtract(*kept)) < 1.0 < 20.0 < np.hypot(*np.subtract(*left))  # pixels


def processor_time(group: int) -> float:
    """Seconds that a browser and its processes have worked."""
    first = psutil.Process(group)
    times = [each.cpu_times() for each in (first, *first.children(recursive=True))]
    return sum(each.user + each.system for each in times)
