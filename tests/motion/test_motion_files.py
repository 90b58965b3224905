"""Motions to files and back, the guesses that are made on the way, and what is refused by line and column."""

from __future__ import annotations

import io
import pickle
import tempfile
from contextlib import nullcontext
from pathlib import Path

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError
from rbd.model.sampled_motion import exponential
from rbd.motion import Motion
from rbd.motion.file_conventions import breadth_first, file_order, formats


@pytest.fixture(scope="module")
def dance(g1) -> Motion:
    """G1 that turns, leans and swings its joints, 2 s at 50 Hz."""
    t = np.arange(100) / 50.0
    q = np.tile(g1.standing().q, (len(t), 1))
    q[:, :2] += np.stack([0.2 * t, 0.1 * np.sin(t)], axis=1)
    q[:, 3:7] = exponential(np.stack([0.1 * np.sin(3.0 * t), 0.1 * np.cos(2.0 * t), 0.8 * t], axis=1))
    phase = np.arange(29)
    q[:, 7:] += 0.3 * np.sin(2.0 * t[:, None] + phase)
    return Motion.of_arrays(g1, t, q)


def table(motion: Motion, decimals: int = 6) -> list[list[str]]:
    """The cells of a table without a header."""
    return [[f"{x:.{decimals}f}" for x in row] for row in motion.q]


def written(folder: Path, cells: list[list[str]], name: str = "dance.csv") -> Path:
    """A file of these cells."""
    path = folder / name
    path.write_text("\n".join(",".join(row) for row in cells) + "\n")
    return path


def angle_between(x: np.ndarray, y: np.ndarray) -> float:
    """Largest difference of unit quaternions, up to sign."""
    return float(np.minimum(np.abs(x - y), np.abs(x + y)).max())


class TestRoundTrips:
    """What is written is read again, to the decimals of the file."""

    def test_a_table_with_a_header(self, dance, g1, tmp_path):
        """Times, base and joints to half of the last decimal, which is counted as noise."""
        dance.save(tmp_path / "dance.csv")
        again = Motion.read(tmp_path / "dance.csv", robot=g1)
        assert np.abs(again.t - dance.t).max() < 1e-9
        assert np.abs(again.q - dance.q).max() <= 1.1e-6
        assert again.derivation.noise_q[6:] == pytest.approx(1e-6 / np.sqrt(12.0))
        assert again.derivation.noise_q[3:6] == pytest.approx(2e-6 / np.sqrt(12.0))
        limit = 6.0 * again.derivation.noise_a.max()
        assert np.abs(again.a - dance.a)[5:-5].max() < limit

    @pytest.mark.parametrize("decimals", [3, 4, 6])
    def test_a_table_without_one(self, dance, g1, tmp_path, decimals):
        """As most tools write them, at any number of decimals; quaternions are normalised, and it is said."""
        dance.save(tmp_path / "d_50hz.csv", header=False, decimals=decimals)
        again = Motion.read(tmp_path / "d_50hz.csv", robot=g1)
        assert again.rate == pytest.approx(50.0) and any("50 Hz, was taken from the file's name" in n for n in again.notes)
        assert np.abs(again.q - dance.q).max() <= 1.2 * 10.0**-decimals
        assert again.derivation.noise_q[-1] == pytest.approx(10.0**-decimals / np.sqrt(12.0))
        assert any("normalised" in note for note in again.notes)
        assert any("all 29 joints of g1" in note for note in again.notes)
        text = str(again)
        assert (
            "half of an acceleration at" in text and "noise of q leaves up to" in text and all(n in text for n in again.notes)
        )

    @pytest.mark.parametrize("units", ["rad", "deg"])
    def test_the_noise_of_decimals_is_that_of_the_file(self, g1, tmp_path, units):
        """Standard deviation of what is read from what was written, of the base's place and turn, and of joints."""
        rng, n = np.random.default_rng(11), 1500
        t = np.arange(n) / 50.0
        q = np.tile(g1.standing().q, (n, 1)) + 0.3 * np.sin(t[:, None] + rng.uniform(0.0, 6.0, g1.nq))
        q[:, 3:7] = exponential(np.stack([0.3 * np.sin(1.1 * t), 0.4 * np.cos(1.7 * t), 0.9 * t], axis=1))
        shown = q.copy()
        shown[:, 7:] *= 180.0 / np.pi if units == "deg" else 1.0
        np.savetxt(tmp_path / "d.csv", shown, fmt="%.3f", delimiter=",")
        again = Motion.read(tmp_path / "d.csv", robot=g1, rate=50, units=units)
        off = np.array([pin.difference(g1.model, a, b) for a, b in zip(q, again.q, strict=True)])
        found, stated = off.std(axis=0), again.derivation.noise_q
        for part in (slice(0, 3), slice(3, 6), slice(6, None)):
            assert np.sqrt((found[part] ** 2).mean()) == pytest.approx(np.sqrt((stated[part] ** 2).mean()), rel=0.06)

    def test_our_own_file_to_the_last_bit(self, dance, g1, tmp_path):
        """With how v and a came from q, with notes and ground; and without a robot given."""
        moved = dance.lifted(0.02)
        moved.save(tmp_path / "dance.npz")
        again = Motion.read(tmp_path / "dance.npz")
        assert again.robot.name == g1.name
        for name in ("t", "q", "v", "a"):
            assert (getattr(again, name) == getattr(moved, name)).all()
        assert again.notes == moved.notes
        assert again.derivation.method == "local polynomial" and again.derivation.cutoff == moved.derivation.cutoff
        assert (again.derivation.noise_a == moved.derivation.noise_a).all()

    def test_bodies_over_time(self, dance, g1, tmp_path):
        """Joints breadth-first, as Isaac has them, proved by where all bodies are."""
        dance.save(tmp_path / "dance.npz", kind="beyondmimic")
        again = Motion.read(tmp_path / "dance.npz", robot=g1)
        assert np.abs(again.q[:, 7:] - dance.q[:, 7:]).max() < 1e-12
        assert angle_between(again.q[:, 3:7], dance.q[:, 3:7]) < 1e-12
        assert again.rate == pytest.approx(50.0)

    @pytest.mark.parametrize("suffix", [".npz", ".nc"])
    def test_a_trajectory(self, tmp_path, suffix):
        """What `simulate` gave: t, q, v and a to the last bit."""
        box = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")
        fall = rbd.simulate(box.at(), [], duration=0.05, step=0.01, progress=False)
        fall.save(tmp_path / f"fall{suffix}")
        again = Motion.read(tmp_path / f"fall{suffix}")
        own = Motion.of_trajectory(fall)
        for name in ("t", "q", "v", "a"):
            assert (getattr(again, name) == getattr(fall, name)).all() and (getattr(own, name) == getattr(fall, name)).all()
        assert own.source == "trajectory" and again.derivation is None

    def test_a_robot_without_a_base(self, tmp_path):
        """An arm's columns are joints alone."""
        arm = rbd.load_robot("panda", root="fixed")
        t = np.arange(30) / 30.0
        q = 0.5 * np.sin(t[:, None] + np.arange(arm.nq))
        Motion.of_arrays(arm, t, q).save(tmp_path / "arm.csv")
        assert np.abs(Motion.read(tmp_path / "arm.csv", robot=arm).q - q).max() <= 0.51e-6

    def test_nothing_is_half_written(self, dance, tmp_path):
        """Another suffix, a missing folder, a kind that there is not: refused before a byte is written."""
        for bad, given in (("dance.txt", {}), ("no/dance.csv", {}), ("d.npz", {"kind": "x"}), ("d.csv", {"decimals": 0})):
            with pytest.raises(InputError):
                dance.save(tmp_path / bad, **given)
        assert not list(tmp_path.iterdir())


class TestGuesses:
    """What is guessed is said; what is given wins."""

    def test_the_order_of_quaternions_is_seen_by_the_base(self, dance, g1, tmp_path):
        """It stays upright in one order only; the wrong one, given, is taken and told of."""
        swapped = [[*row[:3], row[6], *row[3:6], *row[7:]] for row in table(dance)]
        path = written(tmp_path, swapped)
        guessed = Motion.read(path, robot=g1, rate=50)
        assert any("quaternions were taken as w, x, y, z" in note for note in guessed.notes)
        assert angle_between(guessed.q[:, 3:7], dance.q[:, 3:7]) < 2e-6
        given = Motion.read(path, robot=g1, rate=50, quaternion="wxyz")
        assert angle_between(given.q[:, 3:7], dance.q[:, 3:7]) < 2e-6
        wrong = Motion.read(path, robot=g1, rate=50, quaternion="xyzw")
        assert angle_between(wrong.q[:, 3:7], dance.q[:, 3:7]) > 0.5
        assert any("the base spins or lies" in note and "Is dance.csv in w, x, y, z?" in note for note in wrong.notes)
        plain = Motion.read(written(tmp_path, table(dance)), robot=g1, rate=50)
        assert any("quaternions were taken as x, y, z, w" in note for note in plain.notes)

    def test_g1_with_23_joints(self, dance, g1, tmp_path):
        """Thirty columns: what the smaller G1 lacks stays as in the posture, by name."""
        names = [name for name in file_order(g1) if name in formats(g1)[list(formats(g1))[1]]]
        assert len(names) == 23
        columns = [*range(7), *(g1.joints[name].q.start for name in names)]
        path = written(tmp_path, [[row[k] for k in columns] for row in table(dance)])
        again = Motion.read(path, robot=g1, rate=50)
        still = {name for name in file_order(g1) if name not in names}
        assert still == {
            *("waist_roll_joint", "waist_pitch_joint", "left_wrist_pitch_joint", "left_wrist_yaw_joint"),
            *("right_wrist_pitch_joint", "right_wrist_yaw_joint"),
        }
        note = next(note for note in again.notes if "6 joints are not in the file" in note)
        for name in still:
            assert name in note and (again.q[:, g1.joints[name].q] == g1.posture("standing")[g1.joints[name].q]).all()
        for name in names:
            assert np.abs(again.q[:, g1.joints[name].q] - dance.q[:, g1.joints[name].q]).max() < 1e-6

    def test_of_two_with_23_joints_that_whose_sides_agree(self, dance, g1, tmp_path):
        """A table of the other 23: both orders are within limits; the note names the one not taken."""
        one, other = list(formats(g1))[1:]
        for taken, left in ((one, other), (other, one)):
            columns = [*range(7), *(g1.joints[name].q.start for name in formats(g1)[taken])]
            found = Motion.read(written(tmp_path, [[row[k] for k in columns] for row in table(dance)]), robot=g1, rate=50)
            assert f"23 joints without names: {taken}, in that order." in found.notes
            assert any(note.startswith(f"as many joints has {left}; joints are beyond") for note in found.notes)

    def test_joints_in_another_order(self, dance, g1, tmp_path):
        """Named by `joints`, or by a header in any order, with times or without."""
        order = breadth_first(g1)
        columns = [*range(7), *(g1.joints[name].q.start for name in order)]
        cells = [[row[k] for k in columns] for row in table(dance)]
        given = Motion.read(written(tmp_path, cells), robot=g1, rate=50, joints=list(order))
        assert np.abs(given.q - dance.q).max() < 2e-6
        header = ["x", "y", "z", "qx", "qy", "qz", "qw", *(name.removesuffix("_joint") for name in order)]
        named = Motion.read(written(tmp_path, [header, *cells]), robot=g1, rate=50)
        assert np.abs(named.q - dance.q).max() < 2e-6
        backwards = Motion.read(written(tmp_path, [row[::-1] for row in [header, *cells]]), robot=g1, rate=50)
        assert np.abs(backwards.q - dance.q).max() < 2e-6

    def test_degrees(self, dance, g1, tmp_path):
        """Given, they are taken; angles of many turns in radians are asked about, not taken."""
        cells = [[*row[:7], *(f"{np.degrees(x):.6f}" for x in q[7:])] for row, q in zip(table(dance), dance.q, strict=True)]
        path = written(tmp_path, cells)
        again = Motion.read(path, robot=g1, rate=50, units="deg")
        assert np.abs(again.q - dance.q).max() < 2e-6
        assert again.derivation.noise_q[-1] == pytest.approx(np.radians(1e-6) / np.sqrt(12.0))
        with pytest.raises(InputError, match="turns in radians.*units='deg'"):
            Motion.read(path, robot=g1, rate=50)
        assert np.abs(Motion.read(path, robot=g1, rate=50, units="rad").q[:, 7:]).max() > 12.0

    def test_times_in_front(self, dance, g1, tmp_path):
        """One column more, that increases; even to its decimals, it is taken for even."""
        cells = [[f"{t:.3f}", *row] for t, row in zip(np.arange(100) / 30.0, table(dance), strict=True)]
        again = Motion.read(written(tmp_path, cells), robot=g1)
        assert np.abs(again.t - np.arange(100) / 30.0).max() < 1e-3
        assert np.ptp(np.diff(again.t)) < 1e-12
        assert any("taken for times" in note for note in again.notes) and any("even" in note for note in again.notes)

    def test_other_separators_and_line_ends(self, dance, g1, tmp_path):
        """Semicolons, tabs, blanks, Windows' line ends, a byte order mark, comments and empty lines."""
        cells = table(dance)
        for mark, end in ((";", "\n"), ("\t", "\r\n"), (" ", "\n"), (", ", "\r\n")):
            path = tmp_path / "odd.csv"
            path.write_bytes(("\ufeff# made by hand\n\n" + end.join(mark.join(row) for row in cells) + "\n\n").encode())
            assert np.abs(Motion.read(path, robot=g1, rate=50).q - dance.q).max() < 2e-6

    def test_arrays_in_an_npz(self, dance, g1, tmp_path):
        """Only q and t; v and a are derived."""
        np.savez(tmp_path / "plain.npz", q=dance.q.astype(np.float32), t=dance.t)
        again = Motion.read(tmp_path / "plain.npz", robot="g1")
        assert np.abs(again.q - dance.q).max() < 1e-6 and again.derivation is not None


class TestProvedOrder:
    """The order of joints of an .npz of bodies."""

    @pytest.fixture
    def arrays(self, dance, tmp_path) -> dict[str, np.ndarray]:
        """The arrays of a file that trackers read."""
        dance.save(tmp_path / "dance.npz", kind="beyondmimic")
        with np.load(tmp_path / "dance.npz") as file:
            return dict(file)

    def test_it_is_found_without_names(self, dance, g1, arrays, tmp_path):
        """Breadth-first or as in the robot's file, whichever puts the bodies where they are; float32 suffices."""
        del arrays["joint_names"]
        small = {name: x.astype(np.float32) if x.dtype == float else x for name, x in arrays.items()}
        np.savez(tmp_path / "a.npz", **small)
        found = Motion.read(tmp_path / "a.npz", robot=g1)
        assert np.abs(found.q - dance.q).max() < 2e-6
        assert any("order of breadth-first search" in note for note in found.notes)
        index = [breadth_first(g1).index(name) for name in file_order(g1)]
        np.savez(tmp_path / "b.npz", **{**small, **{name: small[name][:, index] for name in ("joint_pos", "joint_vel")}})
        found = Motion.read(tmp_path / "b.npz", robot=g1)
        assert np.abs(found.q - dance.q).max() < 2e-6
        assert any("order of the robot's file" in note for note in found.notes)

    def test_no_order_that_fits_is_refused(self, g1, arrays, tmp_path):
        """Two joints exchanged, a body moved by 3 mm, or a wrong name: no silent guess."""
        del arrays["joint_names"]
        swapped = arrays["joint_pos"].copy()
        swapped[:, [0, 9]] = swapped[:, [9, 0]]
        moved = arrays["body_pos_w"].copy()
        moved[50, 12, 0] += 3e-3
        for change in ({"joint_pos": swapped}, {"body_pos_w": moved}):
            np.savez(tmp_path / "bad.npz", **{**arrays, **change})
            with pytest.raises(InputError, match="no order of joints puts all bodies within 1 mm"):
                Motion.read(tmp_path / "bad.npz", robot=g1)
        np.savez(tmp_path / "bad.npz", **arrays)
        with pytest.raises(InputError, match="no order of joints"):
            Motion.read(tmp_path / "bad.npz", robot=g1, joints=list(file_order(g1)))

    def test_angles_at_the_ends_of_limbs_are_proved_too(self, g1, arrays, tmp_path):
        """The last joint of an arm moves no body's place, only how it is turned."""
        del arrays["joint_names"]
        k = breadth_first(g1).index("left_wrist_yaw_joint")
        arrays["joint_pos"][:, k] += 0.05
        np.savez(tmp_path / "bad.npz", **arrays)
        with pytest.raises(InputError, match="no order of joints"):
            Motion.read(tmp_path / "bad.npz", robot=g1)

    def test_bodies_must_show_all_joints(self, dance, g1, arrays, tmp_path):
        """Without the hands, the wrists' angles could stand in any order."""
        del arrays["joint_names"]
        keep = [i for i, name in enumerate(arrays["body_names"]) if "wrist" not in str(name)]
        few = {**arrays, "body_pos_w": arrays["body_pos_w"][:, keep], "body_quat_w": arrays["body_quat_w"][:, keep]}
        np.savez(tmp_path / "few.npz", **few)
        with pytest.raises(InputError, match="no body shows the angles of .*left_wrist_yaw_joint"):
            Motion.read(tmp_path / "few.npz", robot=g1)
        named = Motion.read(tmp_path / "few.npz", robot=g1, joints=list(breadth_first(g1)))
        assert any("they are in the order of their names" in note for note in named.notes)
        assert np.abs(named.q[:, 7:] - dance.q[:, 7:]).max() < 1e-12

    def test_single_precision_is_counted_as_noise(self, dance, g1, arrays, tmp_path):
        """What float32 rounds off; double precision leaves none."""
        small = {name: x.astype(np.float32) if x.dtype == float else x for name, x in arrays.items()}
        np.savez(tmp_path / "a.npz", **small)
        noise = Motion.read(tmp_path / "a.npz", robot=g1).derivation.noise_q
        assert (noise >= 2.0**-23 / np.sqrt(12.0)).all() and noise.max() < 1e-6
        np.savez(tmp_path / "b.npz", **arrays)
        assert (Motion.read(tmp_path / "b.npz", robot=g1).derivation.noise_q == 0.0).all()

    def test_sizes_are_checked(self, g1, arrays, tmp_path):
        """Shapes, NaN by index, fps, missing arrays."""
        arrays["joint_pos"][7, 3] = np.nan
        np.savez(tmp_path / "bad.npz", **arrays)
        with pytest.raises(InputError, match=r"joint_pos\[7, 3\] is nan"):
            Motion.read(tmp_path / "bad.npz", robot=g1)
        arrays["joint_pos"][7, 3] = 0.0
        for change, told in (
            ({"body_quat_w": arrays["body_quat_w"][:, :3]}, "expected .n, joints., .n, bodies, 3., .n, bodies, 4."),
            ({"fps": np.array([0.0])}, "fps"),
            ({"joint_pos": arrays["joint_pos"][:, :20]}, "names given|20 columns"),
            ({"body_quat_w": 0.0 * arrays["body_quat_w"]}, r"body_quat_w\[0, 0\] has norm 0"),
        ):
            np.savez(tmp_path / "bad.npz", **{**arrays, **change})
            with pytest.raises(InputError, match=told):
                Motion.read(tmp_path / "bad.npz", robot=g1)
        np.savez(tmp_path / "bad.npz", x=np.zeros(3))
        with pytest.raises(InputError, match="holds x; expected q and t; fps"):
            Motion.read(tmp_path / "bad.npz", robot=g1)


class TestBadTables:
    """Errors name line and column, what came, what was expected, what to try."""

    def refused(self, g1, path: Path, match: str, **given: object) -> None:
        """Reading it says so."""
        with pytest.raises(InputError, match=match):
            Motion.read(path, robot=g1, **{"rate": 50, **given})

    def test_wrong_numbers_of_columns(self, dance, g1, tmp_path):
        """Which formats have how many."""
        self.refused(
            g1, written(tmp_path, [row[:-1] for row in table(dance)]), "35 columns; expected .* 36: all 29 .* 30: G1 with 23"
        )
        cells = table(dance)
        cells[41] = cells[41][:-2]
        self.refused(g1, written(tmp_path, cells), "line 42 has 34 columns, those before it 36")
        more = [["1.0", *row] for row in table(dance)]
        self.refused(g1, written(tmp_path, more), "37 columns, one more than .* it would increase")

    def test_numbers_that_are_none(self, dance, g1, tmp_path):
        """NaN, infinity, words and empty cells, far down too."""
        for bad, told in (
            ("nan", "'nan'; expected a finite"),
            ("-inf", "finite"),
            ("1e999", "finite"),
            ("abc", "'abc'"),
            ("", "empty"),
        ):
            for line in (0, 77):
                cells = table(dance)
                cells[line][8] = bad
                self.refused(g1, written(tmp_path, cells), f"line {line + 1}, column 9 is .*{told}")

    def test_quaternions_of_another_length(self, dance, g1, tmp_path):
        """Norm zero, or columns that are none of a quaternion."""
        cells = table(dance)
        cells[12][3:7] = ["0"] * 4
        self.refused(g1, written(tmp_path, cells), "line 13: the quaternion in columns 4 to 7 has norm 0; expected 1 to 0.05")

    def test_times(self, dance, g1, tmp_path):
        """Unsorted, repeated, at absurd rates; none at all."""
        header = ["t", "x", "y", "z", "qx", "qy", "qz", "qw", *file_order(g1)]
        for at, value in ((30, "0.1"), (31, "0.6")):
            cells = [[f"{0.02 * i:.3f}", *row] for i, row in enumerate(table(dance))]
            cells[at][0] = value
            self.refused(
                g1, written(tmp_path, [header, *cells]), f"line {at + 2}: time {float(value):g} s does not follow", rate=None
            )
        for slow in (0.001, 1e-6):
            cells = [[f"{i / slow:.3f}", *row] for i, row in enumerate(table(dance))]
            self.refused(g1, written(tmp_path, [header, *cells]), "expected 1 to 10000 frames a second", rate=None)
        plain = written(tmp_path, table(dance))
        self.refused(g1, plain, "has no times; give rate=30", rate=None)
        for rate in (0, -30, 1e9, float("nan"), "60", True):
            self.refused(g1, plain, "rate is", rate=rate)
        cells = [[f"{0.02 * i:.3f}", *row] for i, row in enumerate(table(dance))]
        self.refused(g1, written(tmp_path, [header, *cells]), "rate is 60, but the times .* 50 Hz", rate=60)
        dance.save(tmp_path / "dance.npz")
        self.refused(g1, tmp_path / "dance.npz", "rate is 60, but the times in dance.npz have 50 Hz", rate=60)

    def test_joints_that_the_robot_lacks(self, dance, g1, tmp_path):
        """With the nearest names; twice the same; no base."""
        header = ["x", "y", "z", "qx", "qy", "qz", "qw", *file_order(g1)]
        wrong = ["left_knie_joint" if name == "left_knee_joint" else name for name in header]
        self.refused(g1, written(tmp_path, [wrong, *table(dance)]), "column 11 is named 'left_knie_joint'.*'left_knee_joint'")
        twice = ["left_knee_joint" if name == "right_knee_joint" else name for name in header]
        self.refused(g1, written(tmp_path, [twice, *table(dance)]), "columns 11 and 17 are both 'left_knee_joint'")
        euler = ["x", "y", "z", "frame", "qy", "qz", "qw", *file_order(g1)]
        self.refused(g1, written(tmp_path, [euler, *table(dance)]), "no column of the base for qx")
        self.refused(g1, written(tmp_path, [header[:-1], *table(dance)]), "names 35 columns, line 2 has 36")
        plain = written(tmp_path, table(dance))
        self.refused(g1, plain, "no joint 'knee'", joints=["knee"])
        self.refused(g1, plain, "two joints of the columns are named", joints=["left_knee_joint"] * 29)
        self.refused(g1, plain, "quaternion is 'zyxw'", quaternion="zyxw")
        self.refused(g1, plain, "units is 'grad'", units="grad")

    def test_files_that_are_no_tables(self, dance, g1, tmp_path):
        """Empty, a header alone, binary, pickles by name or by content, folders, nothing."""
        path = tmp_path / "x.csv"
        path.write_bytes(b"")
        self.refused(g1, path, "holds nothing")
        path.write_text("x,y,z,qx,qy,qz,qw\n")
        self.refused(g1, path, "only a header")
        path.write_bytes(bytes(range(256)) * 100)
        self.refused(g1, path, "binary")
        path.write_bytes(b"\xff\xfe1,2,3\n" * 50)
        self.refused(g1, path, "UTF-8")
        path.write_bytes(b"1" * 300_000)
        self.refused(g1, path, "column|characters")
        path.write_bytes(pickle.dumps({"q": [1.0, 2.0]}))
        self.refused(g1, path, "holds q; expected q and t")
        (tmp_path / "x.pkl").write_bytes(b"whatever")
        self.refused(g1, tmp_path / "x.pkl", "is no pickle")
        np.savez(tmp_path / "x.npz", q=np.array([{"a": 1}], dtype=object), t=np.zeros(1))
        self.refused(g1, tmp_path / "x.npz", "holds q, t; expected")
        (tmp_path / "y.npz").write_bytes(b"PK\x03\x04 nothing")
        self.refused(g1, tmp_path / "y.npz", "no .npz")
        (tmp_path / "z.npz").write_bytes(b"")
        self.refused(g1, tmp_path / "z.npz", "empty")
        self.refused(g1, tmp_path, "is no file")
        self.refused(g1, tmp_path / "nothing.csv", "cannot be read")
        with pytest.raises(InputError, match="does not name its robot"):
            Motion.read(written(tmp_path, table(dance)), rate=50)


SOUND = "0,0,0.8,0,0,0,1," + ",".join(["0.1"] * 29) + "\n"


@hypothesis.settings(max_examples=60, deadline=None, derandomize=True, database=None)
@hypothesis.given(
    data=st.one_of(
        st.binary(max_size=400),
        st.text(alphabet='0123456789.,;-+eE \t\n\rnaif#"x', max_size=400).map(str.encode),
        st.tuples(st.integers(0, len(SOUND) - 1), st.binary(min_size=1, max_size=6)).map(
            lambda x: 4 * SOUND.encode() + SOUND.encode()[: x[0]] + x[1] + SOUND.encode()[x[0] + 1 :]
        ),
    ),
    suffix=st.sampled_from([".csv", ".npz", ".nc", ".txt"]),
)
def test_rubbish_is_refused_or_read_right(g1, data: bytes, suffix: str) -> None:
    """Any bytes: an error of ours, or numbers that are finite and are those of the text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"x{suffix}"
        path.write_bytes(data)
        try:
            motion = Motion.read(path, robot=g1, rate=30)
        except rbd.RbdError as error:
            assert len(str(error)) < 1500
            return
    assert np.isfinite(motion.q).all() and np.isfinite(motion.a).all()
    lines = [line for line in data.decode("utf-8-sig").replace("\r", "\n").split("\n") if line.strip()]
    rows = [line for line in lines if not line.lstrip().startswith("#")]
    assert len(rows) == motion.n
    for row, q in zip(rows, motion.q, strict=True):
        assert np.abs(np.array([float(cell) for cell in row.split(",")])[-29:] - q[7:]).max() < 1e-12


@hypothesis.settings(max_examples=60, deadline=None, derandomize=True, database=None)
@hypothesis.given(at=st.integers(0, 10**6), bits=st.integers(1, 255), cut=st.booleans())
def test_a_damaged_archive_is_refused_or_read_right(g1, at: int, bits: int, cut: bool) -> None:
    """One byte changed, or the end cut off: an error of ours, or the numbers that were written."""
    t, q = np.arange(6) / 30.0, np.tile(g1.standing().q, (6, 1))
    content = io.BytesIO()
    np.savez(content, t=t, q=q, fps=np.array(30))
    data = bytearray(content.getvalue())
    data[at % len(data)] ^= bits
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.npz"
        path.write_bytes(bytes(data[: at % len(data)] if cut else data))
        try:
            motion = Motion.read(path, robot=g1)
        except rbd.RbdError as error:
            assert len(str(error)) < 1500
            return
    assert (motion.t == t).all() and np.abs(motion.q - q).max() < 1e-15


def test_many_rows_are_read_with_a_bar(g1, tmp_path, monkeypatch) -> None:
    """It reaches the size of the file; errors far down name their line."""
    rows = 4000
    x = np.tile(np.r_[np.zeros(2), 0.8, 0.0, 0.0, 0.0, 1.0, np.zeros(29)], (rows, 1))
    x[:, 7] = np.sin(0.01 * np.arange(rows))
    path = tmp_path / "long.csv"
    np.savetxt(path, x, fmt="%.6f", delimiter=",")
    whole = Motion.read(path, robot=g1, rate=100, progress=False)
    assert whole.n == rows and np.abs(whole.q - x).max() < 1e-6
    monkeypatch.setattr("rbd.motion.csv_files.TOLD", 50)
    told: list[float] = []
    monkeypatch.setattr("rbd.motion.csv_files.progress_of", lambda times, **given: nullcontext(told.append))
    Motion.read(path, robot=g1, rate=100)
    size = path.stat().st_size
    assert len(told) > 50 and told == sorted(told) and told[-1] == size
    text = path.read_text().split("\n")
    text[3210] = text[3210].replace("0.800000", "zero", 1)
    path.write_text("\n".join(text))
    with pytest.raises(InputError, match="line 3211, column 3 is 'zero'"):
        Motion.read(path, robot=g1, rate=100)
