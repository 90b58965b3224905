"""`rbd plane`: what it prints, draws and writes, and how it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from rbd.cli.app import app

runner = CliRunner()


def run(*arguments: str) -> tuple[int, str, str]:
    """(exit code, what is printed, what is complained)."""
    answer = runner.invoke(app, ["plane", *arguments])
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer.exit_code, answer.stdout, answer.stderr


def test_the_texts_motion_is_told_and_drawn(tmp_path):
    """The command of the promise: reach, both branches, the singular beginning, peaks with times, and one picture."""
    picture, page, numbers = tmp_path / "plane.png", tmp_path / "plane.html", tmp_path / "plane.json"
    code, out, _ = run(
        "--links", "2", "--from", "1,0", "--to", "0.5,0.5", "--out", str(picture), "--html", str(page), "--json", str(numbers)
    )  # fmt: skip
    assert code == 0
    told = " ".join(out.split())
    words = (
        *(
            "2 links of 0.5, 0.5 m",
            "(0, 90) deg or (90, -90) deg",
            "1.3258 m/s at 0.5 s",
            "4.0825 m/s2 at 0.211 s",
            "picture:",
            "page:",
        ),
        *("without bound towards 0 s", "least manipulability 0 m2 at 0 s", "begins stretched out"),
    )
    for word in words:
        assert word in told, word
    with Image.open(picture) as image:
        assert min(image.size) > 1000 and np.asarray(image.convert("L")).std() > 10.0
    assert "<html" in page.read_text()[:500].lower()
    data = json.loads(numbers.read_text())
    assert data["start"]["singular"] and not data["stop"]["singular"] and data["unbounded"] == [0.0]
    assert data["peaks"]["speed"] == {"value": pytest.approx(1.875 * np.sqrt(0.5)), "at": 0.5, "unit": "m/s"}
    assert np.degrees(data["q"][-1]) == pytest.approx([0.0, 90.0], abs=1e-9) and np.isfinite(data["qd"]).all()


def test_of_a_long_chain_the_first_angles_are_told():
    """As many as there is room for, and how many there are beside them."""
    code, out, _ = run("--links", "14", "--from", "0.5,0", "--to", "0.4,0.2")
    assert code == 0 and "peak rate of theta_12" in out and "rate of theta_13" not in out and "and 16 more peaks" in out


def test_an_unreachable_target_is_told_by_how_much():
    """Exit code 1, the distance, and the nearest point; so is a way that leads through a hole, and a single link's chord."""
    code, out, complaint = run("--from", "1,0", "--to", "1.2,0.5")
    assert code == 1 and "Not reached: (1.2, 0.5) m by 0.3 m." in out
    assert "out of reach by 0.3 m" in complaint and "(0.92308, 0.38461)" in complaint  # on the way to it, at 1 m
    code, _, complaint = run("--lengths", "0.7,0.3", "--from", "0.9,0", "--to", "-0.9,0")
    assert code == 1 and "out of reach by 0.4 m" in complaint
    code, _, complaint = run("--links", "1", "--from", "1,0", "--to", "0,1", "--space", "endpoint")
    assert code == 1 and "--space joint" in complaint


def test_spaces_branches_angles_and_numbers_of_links():
    """One link turns; the other branch bends the other way; in joint space a stretched chain is no trouble."""
    code, out, _ = run("--links", "1", "--from", "1,0", "--to", "0,1")
    assert code == 0 and "joint space" in out and "168.75 deg/s at 0.5 s" in out
    code, out, _ = run("--from", "1,0", "--to", "0.5,0.5", "--branch", "1", "--duration", "2")
    assert code == 0 and "-91.098 deg/s at 0.482 s" in out  # mirrored, half as fast
    code, out, _ = run("--from", "1,0", "--to", "0.5,0.5", "--space", "joint")
    assert code == 0 and "without bound" not in out and "168.75 deg/s at 0.5 s" in out
    code, out, _ = run("--lengths", "0.4,0.3,0.3", "--from", "0.8,0", "--to", "-0.2,0.6", "--angles", "vertical")
    assert code == 0 and "from the vertical" in out and "one pose of a family" in out and "theta_3" in out


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--from", "1", "--to", "0,1"), "X,Y"),
        (("--from", "1,a", "--to", "0,1"), "--from"),
        (("--from", "1,nan", "--to", "0,1"), "finite"),
        (("--from", "1,0", "--to", "0,1", "--links", "0"), "links"),
        (("--from", "1,0", "--to", "0,1", "--lengths", "0.5,-0.5"), "length"),
        (("--from", "1,0", "--to", "0,1", "--lengths", "0.5,0.5", "--links", "3"), "3"),
        (("--from", "1,0", "--to", "0,1", "--angles", "joints"), "joint"),
        (("--from", "1,0", "--to", "0,1", "--space", "plane"), "--space"),
        (("--from", "1,0", "--to", "0,1", "--branch", "2"), "--branch"),
        (("--from", "1,0", "--to", "0,1", "--duration", "0"), "--duration"),
        (("--from", "1,0", "--to", "0,1", "--out", "plane.txt"), ".png"),
        (("--from", "1,0", "--to", "0,1", "--out", "/nowhere/plane.png"), "no folder"),
        (("--from", "1,0", "--to", "0,1", "--html", "plane.png"), ".html"),
    ],
)
def test_bad_input_is_refused(arguments, word):
    """Exit code 2 and a message that names what came."""
    code, _, complaint = run(*arguments)
    assert code == 2 and word in complaint
