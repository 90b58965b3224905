"""`rbd region`: what it prints, draws and writes, and what it refuses."""

from __future__ import annotations

import json

import numpy as np
from test_cli import run

import rbd
from rbd.statics import support_region


def test_talos_region_is_printed_drawn_and_written(tmp_path):
    """Area, distance, the corners' forces; the file of numbers agrees with the library, the picture is one."""
    png, numbers = tmp_path / "region.png", tmp_path / "region.json"
    code, out, _ = run("region", "talos", "--torque-limits", "--png", str(png), "--json", str(numbers))
    assert code == 0
    for word in ("570.36 cm2", "85.7 mm inside", "torques within limits", "torques of any size", "885.6", "leg_left_4_joint",
                 "left out", "residual", "885.57"):  # fmt: skip
        assert word in out, word
    assert png.read_bytes()[:4] == b"\x89PNG"
    data = json.loads(numbers.read_text())
    talos = rbd.load_robot("talos")
    region = support_region(talos.standing(), talos.feet(0.7), torque_limits=True)
    given = data["regions"]["torques within limits"]
    assert np.abs(np.array(given["vertices"]) - region.vertices).max() < 1e-9 and given["torque_limits"] is True
    assert abs(data["regions"]["torques of any size"]["area"] - given["area"]) < 1e-9
    assert list(data["regions"]) == ["torques within limits", "torques of any size"]
    assert data["contacts"] == ["left_sole", "right_sole"]


def test_a_biped_on_two_points_stands_on_a_line():
    """Bolt's region has no area; its centre of mass is above it."""
    code, out, _ = run("region", "bolt")
    assert code == 0 and "0.00 cm2, 2 corners" in out and "is on the edge of its support region" in out


def test_bad_input_is_refused(tmp_path):
    """No feet, no such posture, wrong numbers, files that cannot be."""
    for arguments, word in (
        (("region", "ur5"), "no feet"),
        (("region", "talos", "--posture", "lying"), "lying"),
        (("region", "talos", "--margin", "1"), "--margin is 1"),
        (("region", "talos", "--friction", "-1"), "friction is -1"),
        (("region", "talos", "--png", str(tmp_path / "x.txt")), "--png"),
        (("region", "nobody"), "nobody"),
    ):
        code, _, complaint = run(*arguments)
        assert code == 2 and word in complaint, complaint
