"""Files of records: what is written is read again, and what is wrong is named; `rbd audit`."""

from __future__ import annotations

import numpy as np
import pytest
from audit_scenes import falling, loaded, pulling, scaled, sliding
from typer.testing import CliRunner

import rbd
from rbd.audits import Record, audit
from rbd.cli.app import app

GOOD = {
    "t": [0.0, 0.1], "q": [[0.0, 0, 0, 0, 0, 0, 1]] * 2, "v": np.zeros((2, 6)), "a": np.zeros((2, 6)), "contact_at": [0, 1],
    "contact_body": ["box", "box"], "contact_point": np.zeros((2, 3)), "contact_normal": [[0, 0, 1.0]] * 2,
    "contact_force": [[0, 0, 98.1]] * 2, "contact_friction": 0.5,
}  # fmt: skip


@pytest.fixture(scope="module")
def box():
    """One body of 10 kg."""
    return rbd.testing.box(mass=10.0)


def written(tmp_path, **changes):
    """The path of a record, with arrays changed, or left out where they are None."""
    path = tmp_path / "run.npz"
    np.savez(path, **{key: x for key, x in (GOOD | changes).items() if x is not None})
    return path


def test_what_is_saved_is_read(tmp_path):
    """To the last bit, with its robot."""
    record = falling()
    record.save(tmp_path / "run.npz")
    again = Record.read(tmp_path / "run.npz")
    assert again.robot.name == "solo12" and str(again) == str(record)
    for name, x in vars(record).items():
        if isinstance(x, np.ndarray):
            assert np.array_equal(getattr(again, name), x, equal_nan=True), name


def test_the_layout_that_engines_write(tmp_path, box):
    """In Pinocchio's conventions, and in others."""
    assert audit(Record.read(written(tmp_path), box)).ok
    other = {"q": [[0, 0, 0, 1, 0, 0, 0]] * 2, "quaternion": "wxyz", "base_velocity": "mixed"}
    assert audit(Record.read(written(tmp_path, **other), box)).ok
    stepped = {"a": None, "v_next": np.zeros((2, 6)), "step": 0.1, "contact_normal": None}
    axes = [[[0, 0, 1], [0, 1, 0], [-1, 0, 0]]] * 2
    assert audit(Record.read(written(tmp_path, **stepped, contact_axes=axes, contact_force=[[98.1, 0, 0]] * 2), box)).ok
    turned = {
        "contact_body": [["world", "box"]] * 2,
        "contact_normal": [[0, 0, -1.0]] * 2,
        "contact_force": [[0, 0, -98.1]] * 2,
    }
    record = Record.read(written(tmp_path, **turned), box)
    assert audit(record).ok and record.pair(0) == "box"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"t": None}, "has no t; expected t, q, v"),
        ({"qq": np.zeros(3)}, "the array 'qq', which no record has; nearest: 'q'"),
        ({"q": np.zeros((2, 6))}, r"q has shape \(2, 6\); expected \(2, 7\) for box"),
        ({"q": np.zeros((2, 7))}, "of length 0 where a quaternion"),
        ({"t": [0.0, 0.0]}, r"t goes back: t\[1\] = 0 s follows t\[0\] = 0 s"),
        ({"t": []}, "t is empty|q has shape"),
        ({"v": np.full((2, 6), np.nan)}, r"v\[0, 0\] is nan; expected a finite number"),
        ({"a": None}, "accelerations a, or velocities after a step v_next"),
        ({"a": None, "v_next": np.zeros((2, 6))}, "step is None; expected the length of the step"),
        ({"step": -1.0, "a": None, "v_next": np.zeros((2, 6))}, "above zero"),
        ({"contact_at": [0, 2]}, r"contact_at\[1\] is 2; expected the number of a frame, 0 to 1"),
        ({"contact_at": [1, 0]}, "contact_at goes back"),
        ({"contact_at": [0, 0.5]}, r"contact_at\[1\] is 0.5"),
        ({"contact_body": ["box", "bix"]}, "contact_body: no body 'bix' in box; nearest: 'box'"),
        ({"contact_body": ["box"]}, r"contact_body has shape \(1, 2\); expected \(2,\) or \(2, 2\)"),
        ({"contact_body": None}, "has contact_at and no contact_body"),
        ({"contact_normal": np.zeros((2, 3))}, r"contact_normal\[0\] is \[0.0, 0.0, 0.0\]; expected a vector of unit length"),
        ({"contact_normal": None}, "contact_normal is missing"),
        ({"contact_force": np.full((2, 3), np.inf)}, r"contact_force\[0, 0\] is inf"),
        ({"contact_friction": [-0.1, 0.5]}, r"contact_friction\[0\] is -0.1"),
        ({"contact_friction": [0.5]}, r"contact_friction has shape \(1,\); expected \(\) or \(2,\)"),
        ({"contact_axes": np.zeros((2, 3, 3))}, "contact_normal and contact_axes both came"),
        ({"quaternion": "zyxw"}, "quaternion is 'zyxw'"),
        ({"t": ["a", "b"]}, "t"),
        ({"q": np.array([object()])}, "no .npz with arrays of numbers"),
        ({"push_at": [0], "push_body": ["box"]}, "push_points is missing"),
        ({"tau": np.zeros((2, 3))}, r"tau has shape \(2, 3\); expected \(2, 6\) or \(2, 0\)"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, box, changes, words):
    """By the name of the array, and the frame or the point."""
    path = tmp_path / "run.npz"
    with np.errstate(all="ignore"):
        np.savez(path, allow_pickle=True, **{key: x for key, x in (GOOD | changes).items() if x is not None})
    with pytest.raises(rbd.InputError, match=words):
        Record.read(path, box)


def test_files_that_are_none(tmp_path, box):
    """Cut short, of another kind, not there; a file that names no robot, or one that there is not."""
    path = written(tmp_path)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(rbd.InputError, match="no .npz"):
        Record.read(path, box)
    for wrong, words in (("run.csv", "ends in .npz"), ("none.npz", "cannot be read"), (3, "expected the path of a record")):
        with pytest.raises(rbd.InputError, match=words):
            Record.read(tmp_path / wrong if isinstance(wrong, str) else wrong, box)
    with pytest.raises(rbd.InputError, match="does not name its robot"):
        Record.read(written(tmp_path))
    with pytest.raises(rbd.errors.UnknownRobot, match="solo12"):
        Record.read(written(tmp_path, robot="solo13"))
    with pytest.raises(rbd.InputError, match="recipe is no JSON"):
        Record.read(written(tmp_path, recipe="{", robot_numbers=np.zeros(3)))


def test_a_file_in_another_convention_is_told(tmp_path, box):
    """The quaternions of a box that lies on its side, in the other order."""
    tilted = [[0, 0, 0, 0, np.sin(0.3), 0, np.cos(0.3)]] * 2
    a = [[9.81 * np.sin(0.6), 0, -9.81 * np.cos(0.6), 0, 0, 0]] * 2
    given = {"q": _rolled(tilted), "a": a, "contact_force": np.zeros((2, 3))}
    assert "w, x, y, z" in audit(Record.read(written(tmp_path, **given), box)).explanations[0].text
    assert audit(Record.read(written(tmp_path, **given, quaternion="wxyz"), box)).ok


def run_cli(*arguments):
    """Of `rbd`."""
    return CliRunner().invoke(app, [*arguments], env={"COLUMNS": "200"})


def _rolled(q):
    return [[*each[:3], each[6], *each[3:6]] for each in q]


class TestCommand:
    """`rbd audit`."""

    def test_it_prints_the_report(self, tmp_path):
        """Exit code 0 where nothing is found, 1 else."""
        record = falling()
        record.save(tmp_path / "run.npz")
        done = run_cli("audit", str(tmp_path / "run.npz"), "--json", str(tmp_path / "run.json"))
        assert done.exit_code == 0 and "76 of 76 frames without a cause" in done.output
        assert '"obeys": "coulomb"' in (tmp_path / "run.json").read_text()
        scaled(record, loaded(record)).save(tmp_path / "run.npz")
        done = run_cli("audit", str(tmp_path / "run.npz"))
        assert done.exit_code == 1 and "1.05 times what balances" in done.output
        assert run_cli("audit", str(tmp_path / "run.npz"), "--threshold", "balance=1").exit_code == 0

    def test_two_files_are_compared(self, tmp_path):
        """Exit code 1 where they part."""
        record = falling()
        record.save(tmp_path / "one.npz")
        pulling(record, loaded(record)).save(tmp_path / "two.npz")
        same = run_cli("audit", str(tmp_path / "one.npz"), str(tmp_path / "one.npz"))
        assert same.exit_code == 0 and "agree in 76 steps" in same.output
        done = run_cli("audit", str(tmp_path / "one.npz"), str(tmp_path / "two.npz"), "--json", str(tmp_path / "run.json"))
        assert done.exit_code == 1 and "part at" in done.output
        assert '"cause": "' in (tmp_path / "run.json").read_text()

    def test_bad_input(self, tmp_path):
        """Named, with exit code 2."""
        falling().save(tmp_path / "run.npz")
        sliding().save(tmp_path / "box.npz")
        assert "was built by hand" in run_cli("audit", str(tmp_path / "box.npz")).output
        for options, words in (
            (("--robot", "talos"), "this motion is of 'solo12'"),
            (("--threshold", "sped=1"), "nearest: 'speed'"),
            (("--threshold", "speed=x"), "expected NAME=VALUE"),
            (("--law", "newton"), "law is 'newton'"),
        ):
            done = run_cli("audit", str(tmp_path / "run.npz"), *options)
            assert done.exit_code == 2 and words in " ".join(done.output.split()), (options, done.output)
