"""`rbd stand --sweep`: what it computes, prints and writes, what it refuses, and how it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from test_cli import run

import rbd
from rbd.cli.sweeps import values_of

ROOT = Path(__file__).parents[2]
SOLO = ("stand", "solo12", "--sweep", "friction=0.1,0.6", "--sweep", "push.y=0:6:3", "--workers", "0")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_sweep_tells_how_many_cases_are_held_and_between_which_pushes_that_ends(tmp_path):
    """Solo on four point feet: as many cases as `rbd.hold` holds, the boundary between neighbours, the reasons counted."""
    file = tmp_path / "out.json"
    swept = ("--sweep", "friction=0.1:0.9:3", "--sweep", "push.y=0:8:5", "--workers", "0", "--json", str(file))
    code, out, _ = run("stand", "solo12", *swept)
    robot = rbd.load_robot("solo12")
    state, held = robot.standing(), np.zeros((3, 5), bool)
    for i, friction in enumerate(np.linspace(0.1, 0.9, 3)):
        for j, push in enumerate(np.linspace(0.0, 8.0, 5)):
            try:
                rbd.hold(state, robot.feet(friction), external=rbd.ExternalForce("base_link", (0.0, push, 0.0)))
                held[i, j] = True
            except rbd.CannotHold:
                pass
    assert code == 0 and 0 < held.sum() < 15
    assert out.splitlines()[0] == f"solo12 can be held in {held.sum()} of 15 cases."
    told = " ".join(out.split())
    assert (
        "friction 0.1: held up to 2 N, not held from 4 N" in told
        and "cannot_hold: friction 3" in told
        and "friction prevents it" in told
    )
    data = json.loads(file.read_text())
    assert (data["samples"], data["ok"], sum(data["reasons"].values())) == (15, held.sum(), 15 - held.sum())
    for line, row in zip(data["boundary"], held, strict=True):
        last = int(row.sum())  # held up to the last one
        assert line["first_is_held"] and line["changes_between"] == ([[2.0 * (last - 1), 2.0 * last]] if last < 5 else [])
    assert data["worst_residual"] < 1e-9


def test_one_sweep_tells_the_boundary_in_a_sentence():
    """Talos tips at 118.3 N to its left."""
    code, out, _ = run("stand", "talos", "--sweep", "push.y=110,115,120", "--at", "torso_2_link", "--workers", "0")
    assert code == 0
    assert out.splitlines()[:2] == [
        "talos can be held in 2 of 3 cases.", "Along push.y: held up to 115 N, not held from 120 N."
    ]  # fmt: skip


def test_a_size_is_swept_along_the_push_and_an_angle_around_it():
    """--push 0,3,0 gives the direction; the same force by its component, and by its angle."""
    boundary = []
    for arguments in (
        ("--push", "0,3,0", "--sweep", "push=0:8:5"),
        ("--sweep", "push.y=0:8:5"),
        ("--sweep", "push=0:8:5", "--sweep", "push.angle=90,270"),
    ):
        code, out, _ = run("stand", "solo12", "--friction", "0.2", *arguments, "--workers", "0")
        assert code == 0
        boundary.append(next(line for line in out.splitlines() if "not held from" in line).split("held up")[1].split())
    assert boundary[0][:6] == boundary[1][:6] == boundary[2][:6]


def test_what_is_stored_is_what_a_study_returns(folder):
    """Names with dots are arguments with underscores, with their units."""
    xarray = pytest.importorskip("xarray")
    assert run(*SOLO, "--out", "short.zarr")[0] == 0
    samples = rbd.grid(friction=[0.1, 0.6], push_y=[0.0, 3.0, 6.0]).with_units(friction="1", push_y="N")
    function = partial(rbd.studies.withstand_push, rbd.load_robot("solo12"), friction=0.7)
    found, own = xarray.open_zarr("short.zarr").load(), rbd.study(partial(function), samples, executor=0)
    assert found.ok.dims == ("friction", "push_y") and found.push_y.attrs["units"] == "N"
    xarray.testing.assert_equal(found, own.drop_vars("reason_text"))
    assert found.ok.values.tolist() == [[True, False, False], [True, True, True]]


def test_the_page_of_the_command_line_holds(tmp_path, monkeypatch):
    """Its command prints the first line that it shows; its file is read; its commands have the options that it names."""
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "tasks" / "sweep_on_the_command_line.md").read_text()
    commands = re.findall(r"^rbd (.*)$", page, flags=re.MULTILINE)
    code, out, _ = run(*commands[0].removesuffix(" --png map.png").split(), "--workers", "0")
    assert code == 0 and tuple(out.splitlines()[:2]) == re.findall(r"```text\n(.*?)\n(.*?)\n", page)[0]
    assert len(commands) == 3
    for command in commands[1:]:
        code, out, _ = run(*command.replace(":19", ":2").replace(":21", ":2").split(), "--workers", "0")
        assert code == 0 and "of 4 cases" in out and "store: push.zarr" in out


def test_a_store_that_is_there_is_gone_on_with_only_if_asked(folder):
    """Without --resume: refused, and named. With it, and complete: nothing is computed. --resume alone starts."""
    assert run(*SOLO, "--out", "a.zarr", "--resume")[0] == 0
    code, _, complaint = run(*SOLO, "--out", "a.zarr")
    assert code == 2 and "--resume" in complaint and "a.zarr" in complaint
    code, out, _ = run(*SOLO, "--out", "a.zarr", "--resume")
    assert code == 0 and out.startswith("solo12 can be held in 4 of 6 cases.")
    code, _, complaint = run(*(x.replace("0:6:3", "0:6:4") for x in SOLO), "--out", "a.zarr", "--resume")
    assert code == 2 and "samples" in complaint


def test_a_robot_of_a_file_counts_by_its_content(folder):
    """A store goes on with the same file under --resume, and refuses another content under the same name."""
    text = rbd.load_robot("solo12").urdf.read_text()
    (folder / "mine.urdf").write_text(text)
    call = ("stand", "mine.urdf", "--feet", "FL_FOOT,FR_FOOT,HL_FOOT,HR_FOOT", "--sweep", "push.x=0:9:2", "--friction", "0.3",
            "--workers", "0", "--out", "a.zarr", "--resume")  # fmt: skip
    assert run(*call)[0] == 0
    assert "mine can be held in 1 of 2 cases." in run(*call)[1]
    (folder / "mine.urdf").write_text(text.replace('mass value="', 'mass value="1', 1))
    code, out, complaint = run(*call)
    assert code == 2 and not out and "another study" in complaint


def test_a_sweep_of_which_none_is_held_ends_with_code_1(folder):
    """The reason is counted, and told by an example."""
    code, out, _ = run("stand", "solo12", "--sweep", "push.y=50,60", "--workers", "0")
    assert code == 1 and out.startswith("solo12 can be held in none of 2 cases") and "cannot_hold: " in out


def test_a_picture_is_drawn(folder):
    """Of three sweeps the shortest has a map for each value; of four none, which is said before anything is computed."""
    pytest.importorskip("matplotlib")
    three = ("--sweep", "friction=0.1:0.5:3", "--sweep", "push.y=0:6:3", "--sweep", "margin=0,0.1", "--workers", "0")
    code, out, _ = run("stand", "solo12", *three, "--png", "three.png")
    assert code == 0 and "of 18 cases" in out and (folder / "three.png").read_bytes()[:4] == b"\x89PNG"
    code, out, complaint = run("stand", "solo12", *three, "--sweep", "push.x=0,1", "--png", "four.png")
    assert code == 2 and not out and "at most" in complaint


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sweep", "friction"], ["--sweep is 'friction'", "NAME=VALUES"]),
        (["--sweep", "frction=0.1:1:3"], ["'frction'", "'friction'"]),
        (["--sweep", "friction=0.1:1:3", "--sweep", "friction=2:3:4"], ["twice"]),
        (["--sweep", "friction=0.1:1:3", "--friction", "0.5"], ["--friction", "both"]),
        (["--sweep", "friction=0.1,low"], ["--sweep friction", "low'", "expected numbers"]),
        (["--sweep", "friction=0.1,,1"], ["--sweep friction"]),
        (["--sweep", "friction=-1:1:3"], ["--sweep friction", "-1"]),
        (["--sweep", "facets=2,4"], ["--sweep facets", "facets is 2"]),
        (["--sweep", "facets=4.5,6"], ["--sweep facets", "whole"]),
        (["--sweep", "law=coulomb,convex"], ["'law'", "cannot be swept"]),
        (["--sweep", "robot=g1,talos"], ["'robot' cannot be swept"]),
        (["--sweep", "posture=sitting,standing"], ["--sweep posture", "'sitting'"]),
        (["--sweep", "at=base_link,base_lnk"], ["--push"]),
        (["--sweep", "at=base_link,base_lnk", "--push", "0,1,0"], ["--sweep at", "'base_link'"]),
        (["--sweep", "push=0:1:2"], ["--sweep push", "direction"]),
        (["--sweep", "push=0:1:2", "--push", "0,0,0"], ["zero"]),
        (
            ["--sweep", "push=0:1:2", "--sweep", "push.x=1,2"],
            ["--sweep push is the size", "--sweep push.x a component", "one of"],
        ),
        (["--sweep", "push.angle=0:90:2"], ["--sweep push.angle", "no size"]),
        (["--sweep", "push.y=0:1:2", "--push", "0,1"], ["--push", "three numbers"]),
        (["--sweep", "friction=0.1:1:3", "--html", "a.html"], ["--html", "one case"]),
        (["--sweep", "friction=0.1:1:3", "--braced"], ["--braced"]),
        (["--sweep", "friction=0.1:1:3", "--law", "convex"], ["--law", "no effect"]),
        (["--sweep", "friction=0.1:1:3", "--out", "a.npz"], ["--out", ".zarr"]),
        (["--sweep", "friction=0.1:1:3", "--out", "nowhere/a.zarr"], ["--out", "nowhere"]),
        (["--sweep", "friction=0.1:1:3", "--png", "a.txt"], ["--png"]),
        (["--sweep", "friction=0.1:1:3", "--resume"], ["--resume", "--out"]),
        (["--sweep", "friction=0.1:1:3", "--workers", "-1"], ["--workers is -1"]),
        (["--out", "a.zarr"], ["--out", "--sweep"]),
        (["--workers", "0"], ["--workers", "--sweep"]),
    ],
)
def test_sweeps_that_are_wrong_are_refused(tmp_path, monkeypatch, arguments, words):
    """In terms of the options, with the nearest names; exit code 2, and nothing is printed as an answer."""
    monkeypatch.chdir(tmp_path)
    code, out, complaint = run("stand", "solo12", *arguments)
    assert code == 2 and not out
    for word in words:
        assert word in " ".join(complaint.split()), complaint


def test_values_are_those_of_numpy():
    """FROM:TO:N is `numpy.linspace`, to the last bit."""
    assert (values_of("friction", "0.1:1:19") == np.linspace(0.1, 1.0, 19)).all()
    assert values_of("facets", "6,4,8").tolist() == [6, 4, 8]
    assert values_of("at", "a, b").tolist() == ["a", "b"]


def command(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """The command in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen([sys.executable, "-m", "rbd", *arguments], cwd=folder, env=environment, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # fmt: skip


def test_ctrl_c_keeps_what_is_done_and_resume_goes_on(folder):
    """Exit code 130; the report says how many were not run; then --resume completes it, to the same bits as one run."""
    xarray = pytest.importorskip("xarray")
    many = [x.replace("0:6:3", "0:6:300") for x in SOLO]
    process = command(folder, *many, "--out", "cut.zarr")
    while process.poll() is None and not list((folder / "cut.zarr.parts").glob("*.part")):  # of some seconds
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, complaint = process.communicate(timeout=60)
    assert process.returncode == 130, complaint
    assert "were not run" in out.splitlines()[0] and "--resume" in out and "Traceback" not in complaint
    code, out, complaint = run(*many, "--out", "cut.zarr", "--resume")
    assert code == 0 and "of 600 cases" in out and "of 600 samples were done" in complaint
    assert run(*many, "--out", "one.zarr")[0] == 0
    xarray.testing.assert_equal(xarray.open_zarr("cut.zarr").load(), xarray.open_zarr("one.zarr").load())


def test_a_sweep_that_is_stopped_tells_what_is_done(folder, monkeypatch):
    """A full disk: the report of what is stored, the reason, exit code 1."""
    import rbd.studies.running as running

    whole = running.study

    def full(function, samples, **options):
        dataset = whole(function, samples, **{**options, "out": None})
        raise rbd.errors.StudyStopped("a.zarr cannot be written: No space left on device.", dataset=dataset)

    monkeypatch.setattr(running, "study", full)
    code, out, complaint = run(*SOLO, "--out", "a.zarr")
    assert code == 1 and out.startswith("solo12 can be held in 4 of 6") and "stopped: a.zarr cannot be written" in complaint


def test_a_second_ctrl_c_ends_at_once(folder, monkeypatch):
    """It says that what was finished is stored; exit code 130."""
    import rbd.studies.running as running

    def ended(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "study", ended)
    code, out, complaint = run(*SOLO, "--out", "a.zarr")
    assert code == 130 and not out and "--resume" in complaint
