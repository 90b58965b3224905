"""A data set of motions: its numbers are those of each motion, whoever computes them; its page has them all."""

from __future__ import annotations

import json
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.errors import InputError, Reason
from rbd.motion import CAUSES, Motion
from rbd.studies import MotionChecks, check_motions, motion_checks
from rbd.visual.stills import still


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Solo12 stands, hops and slides, two files of one name; a broken table, and what is no motion."""
    top: Path = tmp_path_factory.mktemp("clips")
    (top / "more").mkdir()
    solo = rbd.load_robot("solo12")
    low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
    far = low + 0.05 * np.eye(solo.nq)[0]
    for poses, name in (([low, low], "a.npz"), ([low, high, low], "hops.npz"), ([low, far], "more/a.npz")):
        rbd.motion.minimum_jerk(solo, poses, np.linspace(0.0, 0.6, len(poses)), rate=50.0).save(top / name)
    (top / "broken.csv").write_text("1,2\n3\n")
    (top / "README.md").write_text("clips")
    return top


@pytest.fixture(scope="module")
def checks(folder: Path) -> MotionChecks:
    """The whole folder, in this process."""
    return check_motions(folder, robot="solo12", workers=0)


def test_numbers_are_those_of_each_motion(folder: Path, checks: MotionChecks) -> None:
    """Of dataset, ranking and totals; the broken file has its reason."""
    assert [Path(file).relative_to(folder).as_posix() for file, _ in checks.ranked] == ["a.npz", "hops.npz", "more/a.npz"]
    reports = {file: rbd.check_motion(Motion.read(file)) for file, _ in checks.ranked}
    for file, numbers in checks.ranked:
        report = reports[file]
        assert {key: numbers[key] for key in report.summary()} == report.summary()
        row = checks.dataset.isel(sample=checks.dataset["file"].values.tolist().index(file))
        assert float(row.score) == report.score and float(row.share_possible) == report.share_possible
        assert float(row.balance) == report.balance and int(row.frames) == report.n
        assert numbers["worst"]["q"] == report.motion.q[numbers["worst"]["frame"]].tolist()
    possible, causes = (np.concatenate([getattr(r, name) for r in reports.values()]) for name in ("possible", "causes"))
    assert checks.together["frames"] == len(possible) and checks.together["possible"] == pytest.approx(possible.mean())
    assert checks.together["causes"] == pytest.approx({c: x for c, x in zip(CAUSES, causes.mean(axis=0), strict=True) if x})
    assert list(checks.failed) == [str(folder / "broken.csv")]
    assert checks.failed[str(folder / "broken.csv")][0] == Reason.BAD_INPUT
    assert str(checks).endswith("broken.csv") and "1 file was not checked" in str(checks)
    again = checks.report(checks.ranked[1][0])
    assert again.score == checks.ranked[1][1]["score"]
    with pytest.raises(InputError, match="hops"):
        checks.report(str(folder / "hop.npz"))


def test_two_processes_and_a_store_give_the_same(folder: Path, checks: MotionChecks, tmp_path: Path) -> None:
    """What is stored is not computed again: files that are gone since are in it."""
    copies = tmp_path / "copies"
    copies.mkdir()
    for name in ("a.npz", "hops.npz"):
        (copies / name).write_bytes((folder / name).read_bytes())
    pattern, store = [str(copies / "a.npz"), str(copies / "hops.npz")], tmp_path / "checks.zarr"
    first = check_motions(pattern, robot="solo12", workers=2, out=store)
    assert [x for _, x in first.ranked] == [x for _, x in checks.ranked[:2]]
    (copies / "a.npz").unlink()
    again = check_motions(pattern, robot="solo12", workers=0, out=store, progress=False)
    assert again.ranked == first.ranked and not again.failed


def test_ctrl_c_keeps_what_is_done(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second motion is interrupted: the first is there, the others were not begun."""
    files, seen = [folder / "a.npz", folder / "hops.npz", folder / "more/a.npz"], list[str]()

    def interrupted(motion: Motion, **settings: object) -> rbd.MotionReport:
        seen.append(motion.source)
        if len(seen) == 2:
            raise KeyboardInterrupt
        return rbd.check_motion(motion, **settings)

    with monkeypatch.context() as patched, pytest.warns(rbd.errors.StudyWarning, match="Ctrl-C"):
        patched.setattr(motion_checks, "check_motion", interrupted)
        first = check_motions(files, robot="solo12", workers=0)
    assert len(first.ranked) == 1 and first.left == 2 and not first.failed and "not begun: 2 of 3 files" in str(first)


def test_robots_by_name_and_settings(folder: Path) -> None:
    """A mapping of robots to files; a share of torque limits that is too low for standing."""
    found = check_motions({"solo12": folder / "a.npz"}, workers=0, torque_limits=1e-4, self_collision=False)
    ((_, numbers),) = found.ranked
    assert numbers["causes"]["motor"] == numbers["frames"] and numbers["settings"]["torque_limits"] == 1e-4


def test_the_page_has_all_motions_and_asks_for_nothing(checks: MotionChecks, tmp_path: Path) -> None:
    """A row for each motion, causes, histograms, a picture and a page of the worst; names that occur twice stay apart."""
    with warnings.catch_warnings(action="ignore"):
        path = checks.export(tmp_path / "report", pages=3)
    text = path.read_text()
    assert sorted(each.name for each in path.parent.iterdir()) == ["a.html", "a_2.html", "hops.html", "index.html"]
    assert text.count("<img src='data:image/png;base64,") == 3 and text.count("<svg") == 6
    for word in ("3 motions of solo12", "hops.npz", "more/a.npz", "broken.csv", "floats", "slides", "default-src 'none'"):
        assert word in text
    assert "http" not in text.replace("http-equiv", "") and "None" not in text and "nan" not in text
    assert checks.export(tmp_path / "none", pages=0).read_text().count("<img") == 0


def test_a_data_set_of_files_that_cannot_be_read_has_no_page(folder: Path, tmp_path: Path) -> None:
    """It is said; the dataset has the reasons."""
    found = check_motions(folder / "broken.csv", robot="solo12", workers=0)
    assert not found.ranked and found.together["frames"] == 0 and found.together["possible"] == 0.0
    with pytest.raises(InputError, match="no motion was checked"):
        found.export(tmp_path / "report")


@pytest.fixture(scope="module")
def repaired(tmp_path_factory: pytest.TempPathFactory) -> tuple[MotionChecks, dict[str, object]]:
    """A leg of Solo12 that is lifted too fast, and one that stands, repaired, in a store; with the arguments of the call."""
    top: Path = tmp_path_factory.mktemp("repaired")
    solo = rbd.load_robot("solo12")
    low, lean = solo.standing().q, solo.standing().q + 0.02 * np.eye(solo.nq)[1]
    for poses, name in (([low, low], "stands"), ([low, lean, low], "slides")):
        rbd.motion.minimum_jerk(solo, poses, np.linspace(0.0, 0.8, len(poses)), rate=50.0).save(top / f"{name}.npz")
    files = sorted(top.glob("*.npz"))
    how = {"out": {str(file): str(top / f"{file.stem}_out.npz") for file in files}, "kind": "mujoco"}
    given = {"files": files, "robot": solo, "workers": 0, "out": top / "checks.zarr", "progress": False, "repair": how}
    return check_motions(**given), given


def test_what_was_before_a_repair_stands_beside(repaired: tuple[MotionChecks, dict[str, object]], tmp_path: Path) -> None:
    """In the totals, the table, and on the page: two pictures of each motion at the same frame."""
    checks, _ = repaired
    whole = checks.together
    assert whole["before"]["frames"] == whole["frames"] and whole["before"]["feet"] < whole["feet"] == whole["possible"] == 1.0
    assert "-> 100.0 % possible" in str(checks) and str(checks).count(" -> 100") > 8
    for _, numbers in checks.ranked:
        assert numbers["before"]["worst"]["frame"] == numbers["worst"]["frame"]
    text = checks.export(tmp_path / "page", pages=1).read_text()
    assert text.count("<img src='data:image/png;base64,") == 2 and "Grey: before" in text and "None" not in text
    assert text.count("<span class='was'>") > 30


def test_a_store_of_repairs_goes_on_and_names_other_options(repaired: tuple[MotionChecks, dict[str, object]]) -> None:
    """What is done is not done again, but a repaired motion that is gone is written; other options are refused by name."""
    checks, given = repaired
    how: dict[str, dict[str, str]] = given["repair"]  # type: ignore[assignment]
    first, second = (Path(each) for each in how["out"].values())
    when = second.stat().st_mtime_ns
    assert Motion.read(first, robot="solo12").contacts is not None
    first.unlink()
    again = check_motions(**given)
    assert again.ranked == checks.ranked and first.exists() and second.stat().st_mtime_ns == when
    with pytest.raises(InputError, match=r"another study: repair.slower is 1.25 and was not given. Give"):
        check_motions(**given | {"repair": how | {"slower": 1.25}})
    with pytest.raises(InputError, match=r"settings.friction is 0.5 and was not given"):
        check_motions(**given, friction=0.5)


def test_a_still_shows_the_robot_its_shadow_and_the_force() -> None:
    """A PNG of the size that is asked for: mostly paper, with dark pixels of the robot, and orange ones with a force."""
    plt = pytest.importorskip("matplotlib.image")
    solo = rbd.load_robot("solo12")
    plain, pushed = (still(solo, solo.standing().q, push=push, size=80) for push in ((0, 0, 0), (0, 0, 0.5)))
    assert struct.unpack(">2I", plain[16:24]) == (80, 80)
    import io

    one, two = (plt.imread(io.BytesIO(each))[..., :3] for each in (plain, pushed))
    orange = lambda x: (x[..., 0] - x[..., 2] > 0.4).mean()  # noqa: E731
    assert 0.4 < (one > 0.99).all(axis=2).mean() < 0.95 and (one.mean(axis=2) < 0.7).mean() > 0.05
    assert orange(one) == 0.0 and orange(two) > 0.005


def test_json_of_a_data_set(checks: MotionChecks) -> None:
    """Its fields as plain data."""
    found = json.loads(json.dumps({f.name: f.of(checks) for f in MotionChecks.fields}))
    assert found["together"]["frames"] == checks.together["frames"] and [m["rank"] for m in found["motions"]] == [1, 2, 3]
    assert found["failed"][0]["reason_code"] == 10 and {"balance", "feet", "motors"} < set(found["together"])


def test_the_page_of_motions_on_terrain(tmp_path: Path) -> None:
    """Its pictures stand on the terrain: nothing is asked for the height of a level floor."""
    solo = rbd.load_robot("solo12")
    q = solo.standing().q
    rbd.motion.minimum_jerk(solo, [q, q], [0.0, 0.2], rate=30.0).save(tmp_path / "stand.npz")
    steps = rbd.Terrain.boxes([(-2, -2, -1), (0, 2, 0.0)], [(0, -2, -1), (2, 2, -0.05)])
    checks = check_motions(
        [tmp_path / "stand.npz"], robot="solo12", out=tmp_path / "out.zarr", ground=steps, workers=1, progress=False
    )
    page = checks.export(tmp_path / "page").read_text(encoding="utf-8")
    assert page.count("data:image/png") >= 1 and (tmp_path / "page" / "stand.html").exists()
