"""Friction problems in files: FCLIB's HDF5 and Siconos' text in all their forms, and files broken on purpose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_array, csr_array

import rbd
from rbd.audits.bench import FrictionProblem, read, solve, write

W = np.array([[3.0, 0.5, 0.0], [0.5, 2.0, 0.25], [0.0, 0.25, 1.0]])
Q = np.array([-1.0, 2.0, 0.5])
DENSE = "3\n1\n0\n3\n3\n3 3\n3 .5 0\n.5 2 .25\n0 .25 1\n-1 2 .5\n.3\n"
BLOCKS = "3\n1\n1\n3\n3\n1\n1\n1\n3\n3\n2\n1\n0 1\n0\n0\n3 .5 0 .5 2 .25 0 .25 1\n-1 2 .5\n.3\n1\n"
PLANAR = "2\n1\n0\n2\n2\n2 2\n1 0\n0 1\n-1 2\n.3\n0\n"
ROLLING = "5\n1\n0\n5\n5\n5 5\n" + "\n".join(" ".join(map(str, row)) for row in np.eye(5)) + "\n-1 2 0 0 3\n.3\n.1\n"
GLOBAL = "3\n1\n0\n2\n2\n2 2\n2 0\n0 4\n0\n2\n3\n2 3\n1 0 0\n0 1 0\n-2 4\n0 0 .5\n.3\n"
"""M = diag(2, 4), H of its two velocities along n and t."""


def in_file(folder: Path, text: str) -> Path:
    path = folder / "problem.dat"
    path.write_text(text)
    return path


class TestText:
    """Siconos' forms."""

    @pytest.mark.parametrize("text", [DENSE, BLOCKS])
    def test_a_local_problem_is_dense_or_of_blocks_stored_by_columns(self, tmp_path, text):
        """Both hold the same W and q; a number may follow."""
        found = read(in_file(tmp_path, text))
        assert (found.dim, found.mu.tolist(), found.M) == (3, [0.3], None)
        np.testing.assert_array_equal(found.delassus.toarray(), W)
        np.testing.assert_array_equal(found.free, Q)

    def test_blocks_of_other_shapes_are_put_in_place(self, tmp_path):
        """H of 3 x 2 and 1 x 2 blocks: entries of a block go down its columns."""
        H = "1\n4\n2\n2\n2\n1\n3 4\n2\n3\n2\n0 1 2\n0 0\n0\n1 2 3 4 5 6\n1\n7 8\n"
        M = "0\n4\n4\n4 4\n" + "\n".join(" ".join(map(str, row)) for row in np.eye(4))
        found = read(in_file(tmp_path, f"2\n1\n{M}\n{H}0 0 0 0\n0 0\n.5\n"))
        np.testing.assert_array_equal(found.H.toarray(), [[1, 4], [2, 5], [3, 6], [7, 8]])

    def test_a_global_problem_has_the_acceleration_of_its_inertia(self, tmp_path):
        """Of u = H^T M^-1 f + w = (-2 / 2, 4 / 4, 0.5), W = diag(1/2, 1/4, 0)."""
        found = read(in_file(tmp_path, GLOBAL))
        np.testing.assert_allclose(found.free, [-1.0, 1.0, 0.5], rtol=1e-15)
        np.testing.assert_allclose(found.delassus.toarray(), np.diag([0.5, 0.25, 0.0]), rtol=1e-15)

    def test_contacts_in_the_plane_and_contacts_that_resist_rolling(self, tmp_path):
        """Two rows a contact; five, with a second list of frictions."""
        assert read(in_file(tmp_path, PLANAR)).dim == 2
        rolling = read(in_file(tmp_path, ROLLING))
        assert rolling.mu_r is not None and (rolling.dim, rolling.mu_r.tolist()) == (5, [0.1])

    @pytest.mark.parametrize(
        ("text", "told"),
        [
            ("", "dimension has 1 numbers, and 0 are left"),
            (DENSE.replace("3", "4", 1), "H: kind of storage|H has"),
            ("4\n0\n0\n0\n0\n0 0\n", "the dimension is 4"),
            ("3\n99999999\n", "number of contacts is"),
            ("3\n1.5\n", "number of contacts is"),
            ("3\nnan\n", "number of contacts is"),
            ("3\n1\n7\n3\n3\n", "stored as kind 7"),
            ("3\n1\n0\n900000\n900000\n900000 900000\n1 2\n", "entries has 810000000000 numbers, and 2 are left"),
            ("3\n1\n0\n3\n3\n3 4\n", "and then 3 x 4"),
            (DENSE.replace(".25", "__import__('os')", 1), "entries: could not convert"),
            (DENSE.replace("2 .5\n.3", "2 nan\n.3"), "q .* not finite"),
            (DENSE.replace(".3", "-.3"), "below zero"),
            (DENSE + "1 2 3 4 5 6 7 8 9", "H: kind of storage|expected"),
            (BLOCKS.replace("1\n1\n1\n3\n3\n2", "1\n1\n1\n4\n3\n2"), "blocks of rows end at 4"),
            (BLOCKS.replace("0 1\n0\n0\n", "0 2\n0\n0\n"), "row pointers"),
            (BLOCKS.replace("0 1\n0\n0\n", "0 1\n5\n0\n"), "block columns is"),
            (BLOCKS.replace("0 1\n0\n0\n", "0 1\n0\n9\n"), "block 0 has another number"),
            ("3\n1\n1\n900000\n900000\n1\n1\n1\n900000\n900000\n2\n1\n0 1\n0\n0\n1", "block 0 has 810000000000 numbers"),
            (GLOBAL.replace("2\n3\n2 3", "1\n3\n1 3"), "H has shape"),
            (GLOBAL.replace("2 0\n0 4", "0 0\n0 4"), "M is singular"),
            ("3\n1\n\u00e9", "cannot be read"),
        ],
    )
    def test_a_broken_text_is_refused_by_its_field(self, tmp_path, text, told):
        """Before memory is taken for what it claims to hold; nothing in it is executed."""
        with pytest.raises(rbd.InputError, match=told):
            read(in_file(tmp_path, text)).delassus  # noqa: B018

    def test_folders_and_large_files_are_not_opened(self, tmp_path, monkeypatch):
        """By their size."""
        with pytest.raises(rbd.errors.ModelError, match="is no regular file"):
            read(tmp_path)
        monkeypatch.setattr("rbd.audits.bench.files.LARGEST", 10)
        with pytest.raises(rbd.InputError, match="has more than 10 bytes"):
            read(in_file(tmp_path, DENSE))


def hdf5(path: Path, **changes: Any) -> Path:
    """A local problem in FCLIB's layout, with some of its items replaced; None: left out."""
    h5py = pytest.importorskip("h5py")
    stored = csr_array(W)
    items = {
        "spacedim": np.array([3]), "vectors/q": Q, "vectors/mu": np.array([0.3]), "W/m": np.array([3]), "W/n": np.array([3]),
        "W/nz": np.array([-2]), "W/p": stored.indptr, "W/i": stored.indices, "W/x": stored.data,
    }  # fmt: skip
    with h5py.File(path, "w") as file:
        for name, value in (items | {name.replace("__", "/"): value for name, value in changes.items()}).items():
            if value is not None:
                file[f"fclib_local/{name}"] = value
    return path


class TestHdf5:
    """FCLIB's form."""

    def test_rows_columns_and_triplets_are_the_same_matrix(self, tmp_path):
        """With nz = -2, -1, or the number of triplets, whose p are columns and whose i are rows."""
        columns, triplets = csc_array(W), csr_array(W).tocoo()
        by_columns = {"W__nz": np.array([-1]), "W__p": columns.indptr, "W__i": columns.indices, "W__x": columns.data}
        by_triplets = {"W__nz": np.array([7]), "W__p": triplets.col, "W__i": triplets.row, "W__x": triplets.data}
        for changes in ({}, by_columns, by_triplets):
            np.testing.assert_array_equal(read(hdf5(tmp_path / "a.hdf5", **changes)).delassus.toarray(), W)

    @pytest.mark.parametrize(
        ("changes", "told"),
        [
            ({"vectors__q": None}, "vectors/a is missing"),
            ({"vectors__mu": np.array([0.3, 0.2])}, "W has shape"),
            ({"vectors__mu": np.array(["rm -rf"], "S6")}, "vectors/mu is .S6"),
            ({"vectors__mu": np.array([np.nan])}, "mu .* not finite"),
            ({"spacedim": np.array([1 << 40])}, "spacedim is"),
            ({"W__m": np.array([1 << 30])}, "W/m is"),
            ({"W__p": np.array([0, 2, 1, 7])}, "W/p has 4 entries; expected 4 that ascend"),
            ({"W__p": np.array([0, 2, 5, 90])}, "W/p has"),
            ({"W__i": np.array([0, 1, 0, 1, 2, 1, 9])}, "outside of its 3 rows"),
            ({"W__x": np.ones(3)}, "has 7, 7 and 3 entries"),
            ({"W__x": np.ones((7, 7))}, r"of shape \(7, 7\)"),
            ({"V__m": np.array([3])}, "V: equations beside"),
        ],
    )
    def test_a_broken_file_is_refused_by_its_field(self, tmp_path, changes, told):
        """Sizes, kinds of numbers, indices."""
        with pytest.raises(rbd.InputError, match=told):
            read(hdf5(tmp_path / "a.hdf5", **changes))

    def test_links_to_other_files_are_not_followed(self, tmp_path):
        """Neither links nor datasets whose numbers are elsewhere."""
        h5py = pytest.importorskip("h5py")
        hdf5(tmp_path / "other.hdf5")
        link = h5py.ExternalLink(str(tmp_path / "other.hdf5"), "/fclib_local/vectors/q")
        with pytest.raises(rbd.InputError, match="vectors/q is missing; expected a dataset in the file itself"):
            read(hdf5(tmp_path / "a.hdf5", vectors__q=link))
        virtual = h5py.VirtualLayout((3,), float)
        virtual[:] = h5py.VirtualSource(str(tmp_path / "other.hdf5"), "fclib_local/vectors/q", (3,))
        with h5py.File(hdf5(tmp_path / "a.hdf5", vectors__q=None), "r+") as file:
            file.create_virtual_dataset("fclib_local/vectors/q", virtual)
        with pytest.raises(rbd.InputError, match="expected a list of numbers"):
            read(tmp_path / "a.hdf5")

    def test_a_file_cut_short_is_refused(self, tmp_path):
        """At every sixteenth of it."""
        whole = hdf5(tmp_path / "a.hdf5").read_bytes()
        for part in range(1, 16):
            (tmp_path / "b.hdf5").write_bytes(whole[: len(whole) * part // 16])
            with pytest.raises(rbd.InputError):
                read(tmp_path / "b.hdf5")


    def test_a_byte_that_is_wrong_is_refused_or_harmless(self, tmp_path):
        """An error of ours, or a problem with finite numbers: HDF5's own errors stay inside."""
        whole = hdf5(tmp_path / "a.hdf5").read_bytes()
        refused = 0
        for at in range(8, len(whole), 97):
            (tmp_path / "b.hdf5").write_bytes(whole[:at] + b"\xff" + whole[at + 1 :])
            try:
                assert np.isfinite(read(tmp_path / "b.hdf5").free).all()
            except rbd.InputError:
                refused += 1
        assert refused > 2


class TestWriting:
    """Both forms, read again."""

    @pytest.mark.parametrize("text", [DENSE, PLANAR, ROLLING, GLOBAL])
    @pytest.mark.parametrize("ending", ["dat", "hdf5"])
    def test_what_is_written_is_read_again_bit_by_bit(self, tmp_path, text, ending):
        """Local and global, in the plane, with rolling; in HDF5 with the answer."""
        if ending == "hdf5":
            pytest.importorskip("h5py")
        given = read(in_file(tmp_path, text))
        answer = solve(given)
        again = read(write(tmp_path / f"again.{ending}", given, answer if ending == "hdf5" else None))
        for what in ("W", "M", "H"):
            mine, theirs = getattr(given, what), getattr(again, what)
            assert (mine is None) == (theirs is None) and (mine is None or (mine != theirs).nnz == 0)
        for what in ("q", "f", "w", "mu", "mu_r"):
            np.testing.assert_array_equal(getattr(again, what), getattr(given, what))
        if ending == "hdf5":
            np.testing.assert_array_equal(again.known["solution"], answer.r)

    def test_answers_have_no_place_in_a_text(self, tmp_path):
        """Nor do those of another problem in a file."""
        problem = FrictionProblem("drop", 3, mu=[0.5], W=np.eye(3), q=[-1.0, 0.0, 0.0])
        for path, owner in (("a.dat", problem), ("a.hdf5", read(in_file(tmp_path, DENSE)))):
            with pytest.raises(rbd.InputError, match="stored with its own problem"):
                write(tmp_path / path, problem, solve(owner))
