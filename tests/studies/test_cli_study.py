"""`rbd study FILE.toml` and `rbd stand --sweep`: what they compute, print and write, what they refuse, and how they end."""

from __future__ import annotations

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_cli import run

import rbd
from rbd.cli.sweeps import values_of

ROOT = Path(__file__).parents[2]
SOLO = """
question = "stand"
robot = "solo12"
[samples]
friction = [0.1, 0.6]
push.y = "0:6:3"
"""
SLIDE = '''
"""A box that is pushed on the floor."""

import time

import rbd

BOX = rbd.testing.box(mass=10.0)


def slide(friction, push_x=30.0, wait=0.0):
    time.sleep(wait)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=friction)
    push = rbd.ExternalForce("box", (push_x, 0.0, 0.0))
    solution = rbd.solve(rbd.State(BOX, [0, 0, 0, 0, 0, 0, 1]), [], [face], external=push)
    return {"slip": float(solution.a[0]), "worst_residual": solution.residuals.worst}


def never(friction):
    raise rbd.NoSolution("it is never solved")
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder: with a study of a function of a file that lies beside it."""
    name = f"slide_{abs(hash(tmp_path)) % 10**8}"  # one module for each test of a process
    (tmp_path / f"{name}.py").write_text(SLIDE)
    (tmp_path / "slide.toml").write_text(f'function = "{name}.py:slide"\n[samples]\nfriction = [0.2, 0.5]\npush_x = "0:80:5"\n')
    (tmp_path / "never.toml").write_text(f'function = "{name}.py:never"\n[samples]\nfriction = [0.2, 0.5]\n')
    (tmp_path / "solo.toml").write_text(SOLO)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
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
    assert "held up to 2 N, not held from 4 N" in told and "cannot_hold: friction 3" in told and "friction prevents it" in told
    data = json.loads(file.read_text())
    assert (data["samples"], data["ok"], sum(data["reasons"].values())) == (15, held.sum(), 15 - held.sum())
    for line, row in zip(data["boundary"], held, strict=True):
        last = int(row.sum())  # held up to the last one
        assert line["first_has_result"] and line["changes_between"] == ([[2.0 * (last - 1), 2.0 * last]] if last < 5 else [])
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


def test_a_file_and_its_short_form_give_the_same_dataset(folder):
    """Names with dots are arguments with underscores; what the command stores is what `rbd.study` returns."""
    xarray = pytest.importorskip("xarray")
    assert run("study", "solo.toml", "--workers", "0", "--out", "file.zarr")[0] == 0
    assert run("stand", "solo12", "--sweep", "friction=0.1,0.6", "--sweep", "push.y=0:6:3", "--workers", "0",
               "--out", "short.zarr")[0] == 0  # fmt: skip
    one, other = (xarray.open_zarr(name).load() for name in ("file.zarr", "short.zarr"))
    assert one.ok.dims == ("friction", "push_y") and one.push_y.attrs["units"] == "N"
    xarray.testing.assert_equal(one, other)
    assert one.ok.values.tolist() == [[True, False, False], [True, True, True]]


def test_the_study_of_the_examples_is_read():
    """examples/push_study.toml is a study of 399 samples."""
    from rbd.cli.study_file import StudyFile

    plan = StudyFile(ROOT / "examples" / "push_study.toml").plan()
    assert len(plan.samples) == 399 and plan.plot == {"x": "friction", "y": "push_y"}
    assert plan.function(friction=0.7, push_y=110.0).state.robot.name == "talos"


def test_the_page_of_the_command_line_holds(tmp_path, monkeypatch):
    """Its command prints the first line that it shows; its file is read; its commands have the options that it names."""
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "tasks" / "sweep_on_the_command_line.md").read_text()
    commands = re.findall(r"^rbd (.*)$", page, flags=re.MULTILINE)
    code, out, _ = run(*commands[0].removesuffix(" --png map.png").split(), "--workers", "0")
    assert code == 0 and out.splitlines()[0] == re.findall(r"```text\n(.*?)\n", page)[0]
    assert "0.1 held up to 80 N, not held from 90 N" in " ".join(out.split())
    (tmp_path / "push.toml").write_text(
        re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)[0].replace(":19", ":2").replace(":21", ":2")
    )
    assert len(commands) == 3
    for command in commands[1:]:
        code, out, _ = run(*command.split(), "--workers", "0")
        assert code == 0 and "of 4 cases" in out and "store: push.zarr" in out


def test_a_function_of_a_file_is_studied(folder):
    """It is called with each sample; what it returns is kept; fixed arguments and names with dots reach it."""
    file = folder / "slide.toml"
    file.write_text(file.read_text().replace("push_x =", "push.x =") + "[fixed]\nwait = 0.0\n")
    code, out, _ = run("study", "slide.toml", "--workers", "0", "--out", "slide.zarr")
    assert code == 0 and out.startswith("All 10 samples have a result.") and "store: slide.zarr" in out
    found = pytest.importorskip("xarray").open_zarr("slide.zarr")
    assert float(found.slip.sel(friction=0.2, push_x=80.0)) == pytest.approx(8.0 - 0.2 * 9.81)
    assert abs(float(found.slip.sel(friction=0.5, push_x=40.0))) < 1e-9


def test_random_samples_are_drawn(folder):
    """[draws] in place of [samples]: the same samples for one seed, others for another."""
    (folder / "draws.toml").write_text(
        'question = "stand"\nrobot = "solo12"\n[draws]\nn = 8\n[draws.ranges]\nfriction = [0.1, 0.9]\npush.y = "0:6"\n'
    )
    for name, *seed in (("a.zarr",), ("b.zarr",), ("c.zarr", "--seed", "1")):
        code, out, _ = run("study", "draws.toml", "--workers", "0", "--out", name, *seed)
        assert code == 0 and "8 cases" in out.splitlines()[0]
    a, b, c = (pytest.importorskip("xarray").open_zarr(name).load() for name in ("a.zarr", "b.zarr", "c.zarr"))
    assert a.identical(b) or a.friction.equals(b.friction)
    assert not a.friction.equals(c.friction)
    assert ((a.friction >= 0.1) & (a.friction <= 0.9) & (a.push_y >= 0.0) & (a.push_y <= 6.0)).all()


def test_a_store_that_is_there_is_gone_on_with_only_if_asked(folder):
    """Without --resume: refused, and named. With it, and complete: nothing is computed. --resume alone starts."""
    assert run("study", "slide.toml", "--workers", "0", "--out", "a.zarr", "--resume")[0] == 0
    code, _, complaint = run("study", "slide.toml", "--workers", "0", "--out", "a.zarr")
    assert code == 2 and "--resume" in complaint and "a.zarr" in complaint
    code, out, _ = run("study", "slide.toml", "--workers", "0", "--out", "a.zarr", "--resume")
    assert code == 0 and out.startswith("All 10 samples")
    file = folder / "slide.toml"
    file.write_text(file.read_text().replace("0:80:5", "0:80:6"))
    code, _, complaint = run("study", "slide.toml", "--workers", "0", "--out", "a.zarr", "--resume")
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


def test_robots_can_be_swept(folder):
    """In a file: robots of other sizes, told by name; what is kept fits all of them."""
    (folder / "two.toml").write_text('question = "stand"\n[samples]\nrobot = ["solo12", "go2"]\npush.y = [0.0, 300.0]\n')
    code, out, complaint = run("study", "two.toml", "--workers", "0", "--out", "two.zarr")
    assert code == 0 and out.startswith("2 of 4 cases can be held."), out + complaint
    found = pytest.importorskip("xarray").open_zarr("two.zarr")
    assert found.robot.values.tolist() == ["solo12", "go2"] and found.ok.values.tolist() == [[True, False]] * 2


def test_a_study_without_any_result_ends_with_code_1(folder):
    """The reason is counted, and told by an example."""
    code, out, _ = run("study", "never.toml", "--workers", "0")
    assert code == 1 and out.startswith("None of 2 samples") and "no_solution" in out and "it is never solved" in out


def test_a_picture_is_drawn(folder):
    """--png, as [plot] says."""
    pytest.importorskip("matplotlib")
    file = folder / "solo.toml"
    file.write_text(file.read_text() + '[plot]\nx = "friction"\ny = "push.y"\nvalue = "reason"\n')
    code, out, _ = run("study", "solo.toml", "--workers", "0", "--png", "map.png")
    assert code == 0 and "picture: map.png" in out
    assert (folder / "map.png").read_bytes()[:4] == b"\x89PNG"


def test_a_picture_that_would_not_show_the_study_is_refused_before_it_is_computed(folder):
    """Unknown names of [plot]; more dimensions than a picture has. Of three sweeps the shortest has a map for each value."""
    pytest.importorskip("matplotlib")
    three = ("--sweep", "friction=0.1:0.5:3", "--sweep", "push.y=0:6:3", "--sweep", "margin=0,0.1", "--workers", "0")
    code, out, _ = run("stand", "solo12", *three, "--png", "three.png")
    assert code == 0 and "of 18 cases" in out and (folder / "three.png").is_file()
    code, out, complaint = run("stand", "solo12", *three, "--sweep", "push.x=0,1", "--png", "four.png")
    assert code == 2 and not out and "at most three" in complaint
    for plot, words in (
        ('x = "fricton"', "'friction'"),
        ('x = "friction"\nby = "push.z"', "'push_y'"),
        ('y = "friction"', "y and no x"),
    ):
        (folder / "solo.toml").write_text(SOLO + f"[plot]\n{plot}\n")
        code, out, complaint = run("study", "solo.toml", "--workers", "0", "--png", "map.png")
        assert code == 2 and not out and words in complaint, complaint


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("question = stand", ["no TOML", "line 1"]),
        ("", ["neither a question nor a function"]),
        ('question = "stand"\nfunction = "a.py:b"', ["both a question and a function"]),
        ('question = "stnad"\nrobot = "solo12"', ["line 1", "'stand'"]),
        ('qestion = "stand"', ["qestion (line 1", "'question'"]),
        ('question = "stand"\nsample = 3', ["sample (line 2", "'samples'"]),
        ('question = "stand"\nsamples = 3', ["samples (line 2", "no table"]),
        (SOLO + "[smaples]\na = 1", ["smaples (line 7", "'samples'"]),
        (SOLO + "frition = [1]", ["[samples] frition (line 7", "'friction'"]),
        (SOLO.replace("[0.1, 0.6]", "0.1"), ["friction (line 5", "[fixed]"]),
        (SOLO.replace("[0.1, 0.6]", "[0.1, 0.1]"), ["friction (line 5", "0.1 twice"]),
        (SOLO.replace("[0.1, 0.6]", "[-0.1, 0.6]"), ["friction (line 5", "-0.1"]),
        (SOLO.replace("[0.1, 0.6]", "[]"), ["friction (line 5", "list of numbers"]),
        (SOLO.replace("[0.1, 0.6]", '["low"]'), ["friction (line 5", "expected numbers"]),
        (SOLO.replace("0:6:3", "0:6"), ["push.y (line 6", "FROM:TO:N"]),
        (SOLO.replace("0:6:3", "0:6:1"), ["push.y (line 6", "from 2"]),
        (SOLO.replace("0:6:3", "0:six:3"), ["push.y (line 6", "FROM:TO:N"]),
        (SOLO.replace("0:6:3", "0:1e400:3"), ["push.y (line 6", "FROM:TO:N"]),
        (SOLO.replace("push.y", "push"), ["push (line 6", "direction"]),
        (SOLO.replace("push.y", "law").replace("0:6:3", "coulomb,convex"), ["law (line 6", '"solve"']),
        (SOLO.replace("solo12", "solo13"), ["'solo12'"]),
        (SOLO.replace('robot = "solo12"', ""), ["no robot is named"]),
        (SOLO.replace('"solo12"', '"panda"'), ["no feet are known"]),
        (SOLO.replace('"solo12"', "12"), ["robot (line 3"]),
        (SOLO + '[fixed]\nat = "base_lnk"', ["[fixed] at (line 8", "'base_link'"]),
        (SOLO + '[fixed]\nposture = "sitting"', ["[fixed] posture (line 8", "standing"]),
        (SOLO + "[fixed]\nfriction = 0.5", ["friction", "both"]),
        (SOLO + "[fixed]\nmargin = 1.0", ["margin (line 8", "below 1"]),
        (SOLO + "[fixed]\nmargin = [0.1, 0.2]", ["margin (line 8", "one value"]),
        (SOLO + '[fixed]\nmargin = "0.1:0.2:3"', ["margin (line 8", "one value. Sweep it"]),
        (SOLO + "[fixed]\nmargin = true", ["margin (line 8", "expected a number"]),
        (SOLO + '[fixed]\nrobot = "talos"', ["robot (line 3", "in [fixed]; give it once"]),
        (SOLO + "[fixed]\nfeet = 3", ["[fixed] feet (line 8", "a list of frames"]),
        (SOLO + "[fixed]\npush = [0, 1, 0]\npush.x = 1.0".replace("push.x", "'push.x'"), ["both give the push"]),
        (SOLO + '[fixed]\npush = ["a", 1, 2]', ["[fixed] push (line 8", "three numbers"]),
        (SOLO.replace("push.y", "push") + "[fixed]\npush = 3.0", ["both swept and fixed"]),
        ("keep = []\n" + SOLO, ["keep (line 1", "a list of names"]),
        ('function = "my-push.py:push"\n[samples]\na = [1]', ["my-push.py", "letters, digits and _"]),
        (SOLO + "[plot]\nx = 3", ["[plot] x (line 8"]),
        (SOLO + '[plot]\nz = "friction"', ["[plot] z (line 8"]),
        ("keep = 3\n" + SOLO, ["keep (line 1"]),
        ("seed = -1\n" + SOLO, ["seed (line 1"]),
        ("seed = true\n" + SOLO, ["seed (line 1"]),
        ("batched = true\n" + SOLO, ["batched (line 1"]),
        (SOLO + "[draws]\nn = 3", ["[draws] ranges", "[draws.ranges]"]),
        (SOLO + "[draws]\nn = 3\n[draws.ranges]\nfriction = [0, 1]", ["friction", "twice"]),
        ('keep = ["forces", "worst_torqe"]\n' + SOLO, ["keep (line 1", "'worst_torque'"]),
        ('question = "stand"\nrobot = "solo12"', ["no samples"]),
        ('question = "stand"\nrobot = "solo12"\n[draws]\nn = 0\n[draws.ranges]\nfriction = [0.1, 1]', ["n (line 4"]),
        (
            'question = "stand"\nrobot = "solo12"\n[draws]\nn = 4\n[draws.ranges]\nfriction = [1, 0.1]',
            ["friction (line 6", "LOW"],
        ),
        (
            'question = "stand"\nrobot = "solo12"\n[draws]\nn = 4\nmethod = "sobel"\n[draws.ranges]\nfriction = [0, 1]',
            ["'sobol'"],
        ),
        ('function = "push"\n[samples]\na = [1]', ["function (line 1", "my_module.py:push"]),
        ('function = "nowhere.py:push"\n[samples]\na = [1]', ["nowhere.py", "no such file"]),
        ('function = "json.py:push"\n[samples]\na = [1]', ["'json'", "rename"]),
        ('function = "broken.py:push"\n[samples]\na = [1]', ["broken.py", "ZeroDivisionError"]),
    ],
    ids=itertools.count(),
)
def test_a_file_that_is_wrong_is_refused_with_the_line_and_the_nearest_names(folder, text, words):
    """Nothing is computed, nothing is printed as if it were an answer; exit code 2."""
    (folder / "json.py").write_text("")
    (folder / "broken.py").write_text("1 / 0")
    (folder / "my-push.py").write_text("")
    (folder / "wrong.toml").write_text(text)
    code, out, complaint = run("study", "wrong.toml", "--workers", "0")
    assert code == 2 and not out
    for word in words:
        assert word in " ".join(complaint.split()), complaint


def test_functions_that_are_wrong_are_refused(folder):
    """A name that the file lacks, arguments that the function lacks: with the nearest names, before any sample."""
    file = folder / "slide.toml"
    right = file.read_text()
    for old, new, words in (
        (":slide", ":slied", ["'slide'"]),
        ("friction =", "frction =", ["'frction'", "'friction'"]),
        ("push_x =", "wiat =", ["'wiat'", "'wait'"]),
        ("[samples]", 'robot = "solo12"\n[samples]', ["robot (line 2 of slide.toml) is no parameter of slide", "'friction'"]),
        ("[samples]", "[fixed]\nwiat = 1.0\n[samples]", ["[fixed] wiat (line 3", "nearest", "'wait'"]),
    ):
        file.write_text(right.replace(old, new))
        code, out, complaint = run("study", "slide.toml", "--workers", "0")
        assert code == 2 and not out
        for word in words:
            assert word in complaint, complaint


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sweep", "friction"], ["--sweep is 'friction'", "NAME=VALUES"]),
        (["--sweep", "frction=0.1:1:3"], ["'frction'", "'friction'"]),
        (["--sweep", "friction=0.1:1:3", "--sweep", "friction=2:3:4"], ["twice"]),
        (["--sweep", "friction=0.1:1:3", "--friction", "0.5"], ["--friction", "both"]),
        (["--sweep", "friction=0.1,low"], ["--sweep friction", "'low'"]),
        (["--sweep", "friction=0.1,,1"], ["--sweep friction"]),
        (["--sweep", "friction=-1:1:3"], ["--sweep friction", "-1"]),
        (["--sweep", "facets=2,4"], ["--sweep facets", "facets is 2"]),
        (["--sweep", "facets=4.5,6"], ["--sweep facets", "whole"]),
        (["--sweep", "law=coulomb,convex"], ["law", '"solve"']),
        (["--sweep", "robot=g1,talos"], ["--sweep robot"]),
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
        (["--sweep", "friction=0.1:1:3", "--workers", "2", "--dask", "tcp://x:1"], ["--workers and --dask"]),
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
    assert (values_of("0.1:1:19", "x") == np.linspace(0.1, 1.0, 19)).all()
    assert values_of("3,1,2", "x").tolist() == [3.0, 1.0, 2.0]
    assert values_of("a,b", "x") == ["a", "b"]


def test_a_scheduler_that_does_not_answer_is_refused(folder, monkeypatch):
    """--dask with an address where nothing listens: exit code 2, and how to start one."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("rbd.cli.study_command.DASK_SECONDS", 0.3)
    code, out, complaint = run("study", "slide.toml", "--dask", "tcp://127.0.0.1:9")
    assert code == 2 and not out and "dask scheduler" in complaint


def test_a_scheduler_computes_it(folder):
    """--dask: its workers get the function of the file, too; the client is closed afterwards."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as dask:
        code, out, complaint = run("study", "slide.toml", "--dask", dask.scheduler_address)
        assert code == 0 and out.startswith("All 10 samples"), complaint
        assert not dask.scheduler.clients.keys() - {"fire-and-forget"}


def command(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """The command in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen([sys.executable, "-m", "rbd", *arguments], cwd=folder, env=environment, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # fmt: skip


def test_ctrl_c_keeps_what_is_done_and_resume_goes_on(folder):
    """Exit code 130; the report says how many were not run; then --resume completes it, to the same bits as one run."""
    xarray = pytest.importorskip("xarray")
    file = folder / "slide.toml"
    quick = file.read_text().replace("0:80:5", "0:80:20") + "[fixed]\nwait = 0.0\n"
    (folder / "quick.toml").write_text(quick)
    file.write_text(quick.replace("wait = 0.0", "wait = 0.03"))
    process = command(folder, "study", "slide.toml", "--workers", "0", "--out", "cut.zarr")
    while process.poll() is None and not (folder / "cut.zarr").exists():
        time.sleep(0.02)
    time.sleep(0.4)  # of 1.2 seconds
    process.send_signal(signal.SIGINT)
    out, complaint = process.communicate(timeout=60)
    assert process.returncode == 130, complaint
    assert "were not run" in out.splitlines()[0] and "--resume" in out and "Traceback" not in complaint
    code, out, complaint = run("study", "slide.toml", "--workers", "0", "--out", "cut.zarr", "--resume")
    assert code == 0 and out.startswith("All 40 samples") and "of 40 samples were done" in complaint
    assert run("study", "quick.toml", "--workers", "0", "--out", "one.zarr")[0] == 0
    xarray.testing.assert_equal(xarray.open_zarr("cut.zarr").load(), xarray.open_zarr("one.zarr").load())


def test_a_study_that_is_stopped_tells_what_is_done(folder, monkeypatch):
    """A full disk: the report of what is stored, the reason, exit code 1."""
    import rbd.studies.running as running

    whole = running.study

    def full(function, samples, **options):
        dataset = whole(function, samples, **{**options, "out": None})
        raise rbd.errors.StudyStopped("a.zarr cannot be written: No space left on device.", dataset=dataset)

    monkeypatch.setattr(running, "study", full)
    code, out, complaint = run("study", "slide.toml", "--workers", "0", "--out", "a.zarr")
    assert code == 1 and out.startswith("All 10 samples") and "stopped: a.zarr cannot be written" in complaint


def test_a_second_ctrl_c_ends_at_once(folder, monkeypatch):
    """It says that what was finished is stored; exit code 130."""
    import rbd.studies.running as running

    def ended(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "study", ended)
    code, out, complaint = run("study", "slide.toml", "--workers", "0", "--out", "a.zarr")
    assert code == 130 and not out and "--resume" in complaint
