"""`rbd check`: one motion, many motions, what it writes, and its exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.check_command import Ranking

runner = CliRunner()
N, UP = 30, 20


def run(*arguments: str | Path) -> tuple[int, str, str]:
    """(exit code, what is printed, what is complained)."""
    answer = runner.invoke(app, ["check", *map(str, arguments)])
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer.exit_code, answer.stdout, answer.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory, g1) -> Path:
    """Files of G1 at 30 Hz: it stands; it stands, then hangs 5 cm above the floor; one with a broken row; another text."""
    place = tmp_path_factory.mktemp("motions")
    q = np.tile(g1.standing().q, (N, 1))
    np.savetxt(place / "stands.csv", q, delimiter=",", fmt="%.6f")
    q[UP:, 2] += 0.05
    np.savetxt(place / "hangs.csv", q, delimiter=",", fmt="%.6f")
    (place / "notes.md").write_text("no motion")
    return place


G1 = ("--robot", "g1", "--rate", "30", "--no-self-collision")


def test_a_robot_that_stands_is_possible(folder):
    """Exit code 0, every frame possible; what was guessed of the file is said."""
    code, out, err = run(folder / "stands.csv", *G1[:-1])
    assert code == 0 and not err
    assert "stands.csv: 30 frames of g1" in out and "possible   100.0 %" in out and "note:" in out


def test_a_robot_that_hangs_is_not(folder, tmp_path):
    """Exit code 1; the numbers of the file, and of the arrays, are those of check_motion."""
    paths = {name: tmp_path / f"hangs.{name}" for name in ("html", "json", "npz", "png")}
    code, out, _ = run(
        folder / "hangs.csv", *G1, "--html", paths["html"], "--json", paths["json"],
        "--save", paths["npz"], "--plot", paths["png"]
    )  # fmt: skip
    assert code == 1 and "floats" in out
    assert all(str(path) in out and path.stat().st_size > 1000 for name, path in paths.items() if name != "json")
    report = rbd.check_motion(rbd.Motion.read(folder / "hangs.csv", robot="g1", rate=30))
    data = json.loads(paths["json"].read_text())
    assert data["exit_code"] == 1 and data["failed"] == [] and len(data["motions"]) == 1
    numbers = data["motions"][0]
    assert numbers["file"] == str(folder / "hangs.csv") and numbers["rank"] == 1
    assert numbers["possible"] == report.share_possible and numbers["score"] == report.score
    frames = numbers["per_frame"]
    assert frames["possible"] == report.possible.tolist() and frames["t_s"] == report.motion.t.tolist()
    assert sorted(frames["causes"]["floats"]) == np.flatnonzero(report.of_cause("floats")).tolist()
    assert frames["missing"] == report.missing_scaled.tolist()
    assert paths["html"].read_text().startswith("<!DOCTYPE html>")


def test_many_motions_are_ranked_and_a_bad_one_does_not_stop_them(folder, tmp_path):
    """The folder's motions, best first; of the broken file the reason; exit code 2; a page for each that was checked."""
    broken = tmp_path / "broken.csv"
    broken.write_text((folder / "stands.csv").read_text() + "1,2,3\n")
    code, out, _ = run(broken, folder, *G1, "--html", tmp_path / "pages", "--json", tmp_path / "all.json")
    assert code == 2
    assert out.index("stands.csv") < out.index("hangs.csv") < out.index("broken.csv")
    assert "2 motions, best first" in out and "not checked: 1 file" in out
    data = json.loads((tmp_path / "all.json").read_text())
    assert [Path(m["file"]).name for m in data["motions"]] == ["stands.csv", "hangs.csv"]
    assert [m["rank"] for m in data["motions"]] == [1, 2] and data["motions"][0]["score"] > data["motions"][1]["score"]
    assert [f["file"] for f in data["failed"]] == [str(broken)] and "31" in data["failed"][0]["error"]
    assert (data["failed"][0]["reason"], data["failed"][0]["reason_code"]) == ("bad_input", 10)
    assert data["together"]["motions"] == 2 and 0.0 < data["together"]["possible"] < 1.0
    assert sorted(path.name for path in (tmp_path / "pages").iterdir()) == ["hangs.html", "index.html", "stands.html"]


def test_many_motions_have_one_exit_code(folder):
    """1 where one of them is not possible; 0 where so many frames as are asked for are."""
    assert run(folder, *G1)[0] == 1
    assert run(folder, *G1, "--least-possible", "0.6")[0] == 0


def test_settings_reach_the_check(folder, tmp_path):
    """The floor at 5 cm is where the robot hangs, and above where it stood; without torque limits none is exceeded."""
    out = tmp_path / "x.json"
    code, _, _ = run(folder / "hangs.csv", *G1, "--ground", "0.05", "--from", "0.8", "--json", out)
    numbers = json.loads(out.read_text())["motions"][0]
    assert code == 0 and numbers["ground_m"] == 0.05 and numbers["frames"] == N - 24
    code, said, _ = run(folder / "stands.csv", *G1, "--torque-limits", "0.01")
    assert code == 1 and "motor" in said
    assert run(folder / "stands.csv", *G1, "--torque-limits", "none")[0] == 0


def test_lifted_and_filtered_motions_stand_beside_the_first(folder, tmp_path):
    """The file says both; a robot that always hangs 3 cm high is possible once it is put onto the floor."""
    q = np.loadtxt(folder / "stands.csv", delimiter=",") + 0.03 * np.eye(36)[2]
    np.savetxt(tmp_path / "high.csv", q, delimiter=",", fmt="%.6f")
    assert run(tmp_path / "high.csv", *G1)[0] == 0  # the floor is fitted
    assert run(tmp_path / "high.csv", *G1, "--ground", "0")[0] == 1
    code, out, _ = run(tmp_path / "high.csv", *G1, "--ground", "0", "--lift", "--filter", "6", "--json", tmp_path / "x.json")
    numbers = json.loads((tmp_path / "x.json").read_text())["motions"][0]
    assert code == 0 and "0.0 -> 100.0 %" in out
    assert numbers["possible"] == 1.0 and numbers["before"]["possible"] == 0.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nowhere.csv",), "nowhere.csv"),
        (("stands.csv", "--rate", "-3"), "--rate is -3"),
        (("stands.csv", "--friction", "-1"), "--friction is -1"),
        (("stands.csv", "--threshold", "nan"), "--threshold is nan"),
        (("stands.csv", "--torque-limits", "all"), "--torque-limits is 'all'"),
        (("stands.csv", "--torque-limits", "-1"), "--torque-limits is -1"),
        (("stands.csv", "--ground", "low"), "--ground is 'low'"),
        (("stands.csv", "--quaternion", "zyx"), "--quaternion is 'zyx'"),
        (("stands.csv", "--units", "turns"), "--units is 'turns'"),
        (("stands.csv", "--joints", "a,,b"), "--joints is"),
        (("stands.csv", "--least-possible", "2"), "--least-possible is 2"),
        (("stands.csv", "--html", "x.pdf"), "--html is"),
        (("stands.csv", "--html", "stands.csv.html", "--json", "stands.csv"), "one file"),
        (("stands.csv", "hangs.csv", "--html", "pages.html"), "expected a folder"),
        (("stands.csv", "hangs.csv", "--save", "x.npz"), "--save is for one motion"),
        (("stands.csv", "hangs.csv", "--json", "hangs.csv"), "one file"),
        (("stands.csv", "--out", "x.npz"), "--out is of the repaired motion; expected --repair"),
        (("stands.csv", "--slower", "2"), "--slower is of the repaired motion; expected --repair"),
        (("stands.csv", "--repair", "--slower", "0"), "--slower is 0"),
        (("stands.csv", "--repair", "--keep", "nose"), "nose"),
        (("stands.csv", "--repair", "--kind", "bvh"), "--kind is 'bvh'"),
        (("stands.csv", "--repair", "--kind", "gmr", "--out", "x.csv"), "--out is 'x.csv'"),
        (("stands.csv", "--repair", "--out", "stands.csv"), "one file"),
        (("stands.csv", "hangs.csv", "--repair", "--out", "x.npz"), "expected a folder"),
        (("*.npz",), "no file is like"),
        ((".hidden",), "has no motion"),
        (("stands.csv", "--robot", "g2"), "g2"),
    ],
)
def test_bad_input_is_refused(folder, monkeypatch, arguments, said):
    """Exit code 2, in terms of the options; nothing is written."""
    monkeypatch.chdir(folder)
    (folder / ".hidden").mkdir(exist_ok=True)
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    robot = () if "--robot" in arguments else ("--robot", "g1")
    rate = () if "--rate" in arguments else ("--rate", "30")
    code, out, err = run(*arguments, *robot, *rate)
    assert code == 2 and said in err and "Traceback" not in err, (out, err)
    assert before == {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_checked(folder, tmp_path):
    """Of several motions the page needs a folder."""
    (tmp_path / "file").write_text("")
    code, _, said = run(folder, *G1, "--html", tmp_path / "file" / "pages")
    assert code == 2 and "cannot be made" in said


def test_a_store_is_gone_on_with(folder, tmp_path):
    """The second time nothing is left to check, and the numbers are the same; touch heights reach the check."""
    arguments = (folder, *G1, "--store", tmp_path / "checks.zarr", "--touch-height", "0.05", "--json", tmp_path / "x.json")
    first = run(*arguments), json.loads((tmp_path / "x.json").read_text())
    again = run(*arguments), json.loads((tmp_path / "x.json").read_text())
    assert "nothing is left to compute" in again[0][2] and first[1] == again[1]
    assert first[1]["motions"][0]["settings"]["touch_height"] == 0.05


def tilted(path: Path, g1) -> Path:
    """G1 stands for half a second with all of it pitched by 4 degrees: the toes are low, the heels 15 mm up."""
    q = np.tile(g1.standing().q, (N // 2, 1))
    q[:, 3:7] = 0.0, np.sin(0.035), 0.0, np.cos(0.035)
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, q, delimiter=",", fmt="%.6f")
    return path


def test_a_repaired_motion_is_shown_beside_what_it_was_and_written(g1, tmp_path):
    """Both figures are printed, with notes; the file, of the kind that was asked for, is possible; the page has both."""
    file, page, data = tilted(tmp_path / "tilted.csv", g1), tmp_path / "page.html", tmp_path / "x.json"
    code, said, _ = run(
        file, *G1, "--repair", "--slower", "1.5", "--out", tmp_path / "x.pkl", "--kind", "gmr", "--html", page, "--json", data
    )
    numbers = json.loads(data.read_text())["motions"][0]
    assert said.splitlines()[1] == "It has as many frames, so that its rate is 20 Hz instead of 30 Hz."
    assert code == 0 and "0.0 -> 100.0 %" in said and "feet 0.0 -> 100.0" in said and "note: from the reference: joints" in said
    assert numbers["possible"] == 1.0 and numbers["before"]["possible"] == 0.0
    assert numbers["duration_s"] == pytest.approx(1.5 * numbers["before"]["duration_s"])
    new = rbd.Motion.read(tmp_path / "x.pkl", robot=g1)
    assert new.n == N // 2 and rbd.check_motion(new, self_collision=False).share_possible > 0.9  # v and a from its q
    text = page.read_text(encoding="utf-8")
    assert all(words in text for words in ("(translucent)", "left_sole, before", "distance from the reference"))


def test_each_of_several_motions_is_repaired_into_a_folder(g1, tmp_path):
    """Folders as those that are read; a file that is read is never written; the ranking has both shares."""
    for name in ("a", "b"):
        tilted(tmp_path / name / "x.csv", g1)
    out = tmp_path / "new"
    code, said, _ = run(tmp_path, *G1, "--repair", "--out", out, "--kind", "mujoco")
    assert code == 0 and said.count(" 0.0 -> 100.0 %") >= 2 and f"motions: {out}" in said
    assert sorted(path.relative_to(out) for path in out.rglob("*.npz")) == [Path("a/x.npz"), Path("b/x.npz")]
    code, _, said = run(out, *G1, "--repair", "--out", out)
    assert code == 2 and "is read" in said


def test_a_repair_that_adds_faults_names_them():
    """Of causes that both have, those in more frames; motions that were not repaired, or are better, have no line."""
    same, worse = {"score": 2.0, "causes": {"tips": 4}}, {"score": 1.0, "causes": {"joint limit": 60, "tips": 1, "motor": 5}}
    worse["before"] = {"causes": {"tips": 2, "motor": 3}}
    found = Ranking(1.0, {"a": same, "b": worse, "c": same | {"before": same}})
    assert found.more_faults({"b": "b.csv"}) == ["more faults in b.csv: joint limit 0 -> 60, motor 3 -> 5 frames."]


MOTORS = (
    "left_knee_joint: {torque_speed: [[0, 30], [5, 0]], gear: 22.5, rotor_inertia: 1.0e-5}\nleft_hip_yaw_joint: {limit: 5}\n"
)


def test_motors_of_a_file_limit_the_torques(folder, tmp_path):
    """Standing takes more than 5 N m at both knees: with less the motor is too weak; with enough it is possible."""
    weak, strong = tmp_path / "weak.yaml", tmp_path / "strong.yaml"
    strong.write_text(MOTORS)
    weak.write_text("".join(f"{side}_{joint}: {{limit: 0.5}}\n" for side in ("left", "right") for joint in LEGS))
    code, out, err = run(folder / "stands.csv", *G1, "--motors", strong)
    assert code == 0 and not err
    code, out, _ = run(folder / "stands.csv", *G1, "--motors", weak)
    assert code == 1 and "motor" in out


LEGS = ("hip_pitch_joint", "hip_roll_joint", "knee_joint", "ankle_pitch_joint", "ankle_roll_joint")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("left_knee_joint: {limt: 3}", "'left_knee_joint': its motor, as {limit: 40} or null, has a key 'limt'; nearest"),
        ("left_knee_joint: {gear: 0}", "'left_knee_joint': gear of a motor is 0; expected a ratio that is not 0"),
        ("left_knee_joint: 3", "'left_knee_joint': its motor, as {limit: 40} or null, is 3; expected"),
        ("knee: {limit: 3}", "no joint 'knee' in g1"),
        ("[1, 2]", "motors.yaml holds [1, 2]; expected motors by their joints"),
        ("a: {b: [", "motors.yaml cannot be read as YAML"),
    ],
)
def test_bad_motor_files_are_named(folder, tmp_path, text, said):
    """Exit code 2, and what was expected."""
    path = tmp_path / "motors.yaml"
    path.write_text(text)
    code, _, err = run(folder / "stands.csv", *G1, "--motors", path)
    assert code == 2 and said in " ".join(err.split())
    code, _, err = run(folder / "stands.csv", *G1, "--motors", tmp_path / "none.yaml")
    assert code == 2 and "no file" in err
    code, _, err = run(folder / "stands.csv", "--motors", path)
    assert code == 2 and "--robot" in err
