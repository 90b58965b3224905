"""Many files of motions: which are meant by folders, patterns and mappings; each read when it is asked for, or its error."""

from __future__ import annotations

import pickle
import shutil

import numpy as np
import pytest

import rbd
from rbd.errors import InputError
from rbd.motion import Motion, list_motions, read_all


@pytest.fixture(scope="module")
def folder(tmp_path_factory, g1):
    """Two motions of G1, one below the other, one of Solo12, a page, and a broken table."""
    top = tmp_path_factory.mktemp("clips")
    (top / "more").mkdir()
    solo = rbd.load_robot("solo12")
    for robot, name in ((g1, "a.npz"), (solo, "more/b.npz")):
        Motion.of_arrays(robot, np.arange(5) / 50.0, np.tile(robot.standing().q, (5, 1))).save(top / name)
    shutil.copy(top / "a.npz", top / "more/c.npz")
    (top / "broken.csv").write_text("1,2\n3\n")
    (top / "README.md").write_text("clips")
    return top


def test_folders_patterns_and_files_are_listed_in_order_each_once(folder):
    """A folder with all below it, sorted; what is named twice stands once."""
    names = [str(file.path.relative_to(folder)) for file in list_motions(folder)]
    assert names == ["a.npz", "broken.csv", "more/b.npz", "more/c.npz"]
    both = list_motions([folder / "more/c.npz", f"{folder}/**/*.npz"])
    assert [file.path.name for file in both] == ["c.npz", "a.npz", "b.npz"]
    assert str(both[0]) == str(folder / "more/c.npz")


def test_each_is_read_or_its_error_stands_in_its_place(folder):
    """Reading goes on after a file that cannot be read, and nothing is read before it is asked for."""
    found = read_all(folder, robot=None)
    assert next(found)[1].robot.name == "g1"
    (folder / "more/c.npz").rename(folder / "gone.npz")
    rest = [(file.path.name, motion) for file, motion in found]
    (folder / "gone.npz").rename(folder / "more/c.npz")
    assert [name for name, _ in rest] == ["broken.csv", "b.npz", "c.npz"]
    assert isinstance(rest[0][1], InputError) and rest[1][1].robot.name == "solo12"
    assert "cannot be read" in str(rest[2][1])


def test_files_with_a_rate_keep_it(folder, g1, tmp_path):
    """The rate that is given is of the files without one; alone a file with another one is refused."""
    motion = Motion.read(folder / "a.npz")
    motion.save(tmp_path / "a.npz", kind="mujoco")
    motion.save(tmp_path / "b.csv", header=False)
    one, two = (motion for _, motion in read_all(tmp_path, robot=g1, rate=30.0))
    assert (round(one.rate), round(two.rate)) == (50, 30)
    assert one.notes[-1] == "its own rate was kept: rate is 30, but frequency in a.npz is 50 Hz."
    with pytest.raises(InputError, match="Leave out rate"):
        Motion.read(tmp_path / "a.npz", robot=g1, rate=30.0)


def test_a_mapping_gives_each_robot_its_files(folder, g1):
    """Robots by name or as they are; loaded once, and they travel to other processes."""
    listed = list_motions({g1: [folder / "a.npz"], "solo12": folder / "more/b.npz"})
    assert [file.robot.name for file in listed] == ["g1", "solo12"]
    assert pickle.loads(pickle.dumps(listed[1])).read().n == 5


@pytest.mark.parametrize(
    ("files", "robot", "told"),
    [
        ("nothing/*.csv", None, "no file is like"),
        ([], None, None),
        (3, None, "expected paths, patterns"),
        ([3], None, "expected paths, folders"),
        ("a\0b", None, "expected paths, folders"),
        ({"g1": "x.csv"}, "g1", "leave out robot"),
        ("x.csv", "g11", "no robot 'g11'"),
    ],
)
def test_bad_lists_are_refused(files, robot, told):
    """With what was expected; an empty list is empty."""
    if told is None:
        assert list_motions(files, robot) == []
        return
    with pytest.raises(rbd.errors.RbdError, match=told):
        read_all(files, robot=robot)


def test_a_folder_without_motions_is_refused(tmp_path):
    """It says which files are motions."""
    with pytest.raises(InputError, match="has no motion; expected files that end in .csv"):
        list_motions(tmp_path)
