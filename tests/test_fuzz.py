"""The fuzz itself: 500 mutants of every run, and a judge that can tell a failure when it sees one."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import fuzz
import pytest
from forked import alone

import rbd

SCRIPT = Path(fuzz.__file__)


def test_mutants_are_refused_or_valid(exhaustive: bool) -> None:
    """No mutant of a fixed seed crashes, hangs, or loads as a robot that its file does not describe."""
    n = 500 if exhaustive else 50
    command = [sys.executable, str(SCRIPT), "--n", str(n), "--seed", "3"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    told = re.search(rf"{n} mutants in .*: (\d+) refused, (\d+) valid, (\d+) failure", run.stdout)
    assert told and run.returncode == 0 and told[3] == "0", run.stdout + run.stderr
    refused, valid = int(told[1]), int(told[2])
    assert refused + valid == n and min(refused, valid) > 0.15 * n, "mutants that all go one way test nothing"


@pytest.mark.parametrize("root", ["free_flyer", "fixed"])
@pytest.mark.parametrize("name", fuzz.sources())
def test_what_is_not_broken_is_valid(name: str, root: str, tmp_path: Path) -> None:
    """The judge finds nothing at the files themselves, but that one body alone cannot be welded."""
    path = tmp_path / "whole.urdf"
    path.write_bytes(fuzz.sources()[name])
    verdict, message = fuzz.judge(path, root)
    assert verdict == "valid" or (root == "fixed" and "nothing moves" in message), message


def test_a_mutant_is_always_the_same() -> None:
    """Seed and number say all; another seed says something else."""
    files = fuzz.sources()
    once, again, other = ([fuzz.mutant(seed, i, files) for i in range(30)] for seed in (0, 0, 1))
    assert once == again
    assert sum(a == b for a, b in zip(once, other, strict=True)) < 3


def test_every_way_to_break_a_file_comes_up() -> None:
    """In 250 mutants there is each step, and nine in ten files are changed."""
    files = fuzz.sources()
    drawn = [fuzz.mutant(5, i, files) for i in range(250)]
    steps = Counter(word for _, _, story in drawn for word in re.findall(r"\w+", story.split(": ")[1]))
    assert {*fuzz._Breaker.TREE, *fuzz._Breaker.TEXT, *fuzz._Breaker.BYTES} <= set(steps)
    assert sum(data not in files.values() for data, _, _ in drawn) > 225


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda model: setattr(model.inertias[2], "mass", 3.0), "mass is not the file's at joint ['hinge']"),
        (lambda model: setattr(model.inertias[2], "inertia", 9.0 * model.inertias[2].inertia), "not that of Pinocchio's own"),
    ],
)
def test_a_robot_that_is_not_the_files_is_a_failure(change, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mass and inertia that differ from what the file says are seen, each by its own name."""
    path = tmp_path / "pendulum.urdf"
    path.write_bytes(fuzz.sources()["pendulum"])
    build = rbd.load_robot

    def wrong(*given, **more) -> rbd.Robot:
        robot = build(*given, **more)
        change(robot.model)
        return robot

    monkeypatch.setattr(rbd, "load_robot", wrong)
    verdict, message = fuzz.judge(path, "free_flyer")
    assert verdict == "failure" and why in message


@pytest.mark.parametrize(
    ("load", "why"),
    [
        (lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL), "crash by signal 9"),
        (lambda *_, **__: time.sleep(60), "not ready within 1 s"),
        (lambda *_, **__: [][0], "IndexError"),
        (lambda *_, **__: bytearray(1 << 40), "MemoryError"),
    ],
)
def test_crashes_and_time_outs_are_failures(load, why: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A fork that dies or hangs is counted, its file is kept, and the others go on."""
    monkeypatch.setattr(rbd, "load_robot", load)
    monkeypatch.setattr(fuzz, "TIME_LIMIT", 1.0)
    ended = list(fuzz.run(0, range(2), keep=tmp_path / "kept"))
    assert [(verdict, why in message) for _, verdict, message in ended] == [("failure", True)] * 2
    assert len(list((tmp_path / "kept").iterdir())) == 2


@pytest.mark.parametrize(
    ("work", "seconds", "why"),
    [
        (lambda: os.kill(os.getpid(), signal.SIGKILL), 60.0, "signal 9"),
        (lambda: time.sleep(60.0), 0.3, "late: True"),
        (lambda: os._exit(0), 60.0, "without a word"),
        (lambda: 1 / 0, 60.0, "ZeroDivisionError"),
    ],
)
def test_what_is_done_alone_fails_alone(work, seconds: float, why: str) -> None:
    """A crash, a hang, an end or an error in a child is told by an assertion; an answer comes back."""
    with pytest.raises(AssertionError, match=why):
        alone(work, seconds)
    assert alone(lambda: [1, "a"]) == [1, "a"]


def test_a_message_that_fills_screens_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A refusal is for a reader: one with the whole file in it is none."""

    def refuse(*_, **__) -> None:
        raise rbd.errors.ModelError("x" * 2000)

    monkeypatch.setattr(rbd, "load_robot", refuse)
    assert fuzz.judge(tmp_path / "any.urdf", "fixed") == ("failure", "a message of 2000 letters: " + "x" * 80)


def test_stopping_it_prints_the_counts() -> None:
    """Ctrl-C ends the run with what was counted so far."""
    run = subprocess.Popen(
        [sys.executable, str(SCRIPT), "--n", "100000", "--jobs", "1"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert run.stderr is not None
    run.stderr.read(20)  # the first progress
    run.send_signal(signal.SIGINT)
    said, _ = run.communicate(timeout=30)
    assert re.search(r"\d+ mutants in \d+ s: \d+ refused", said)
