"""Trajectories in files: to the last bit, whole or refused."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from falling import ODD_NAME, Force, falling
from scipy.io import netcdf_file

import rbd
from rbd.model import array_file
from rbd.simulation.simulated_motion import ConstraintForce, Sample, SimulatedMotion
from rbd.simulation.trajectory import Trajectory
from rbd.simulation.trajectory_contents import arrays_of_netcdf

URDF = Path(__file__).parents[2] / "urdf"
ENDINGS = ("npz", "nc")


@pytest.fixture(scope="module")
def fall() -> Trajectory:
    motion, moments, events = falling(n=7)
    return Trajectory.of(motion, moments, events, "ByHand()", 0.09, "interrupted at t = 0.9 s")


def moved(robot: rbd.Robot, n: int = 3) -> Trajectory:
    """A robot that moves at random, seeded; numbers with all their bits."""
    rng = np.random.default_rng(6)
    q, moments = robot.neutral(), []
    for k in range(n):
        state = rbd.State(robot, q, rng.normal(size=robot.nv))
        touch = ConstraintForce(rng.normal(size=6), "holds")
        a, tau = rng.normal(size=robot.nv), rng.normal(size=robot.nu)
        moments.append(Sample.of(0.1 * k, state, a, tau, lambda touch=touch: {"grip": touch}))
        q = pin.integrate(robot.model, q, 0.1 * state.v)
    return Trajectory.of(SimulatedMotion(robot, (Force("grip"),)), moments)


def assert_same(one: Trajectory, other: Trajectory) -> None:
    """Field by field, to the last bit."""
    for field in dataclasses.fields(Trajectory):
        x, y = getattr(one, field.name), getattr(other, field.name)
        if field.name == "robot":
            assert list(x.joints) == list(y.joints)
        elif isinstance(x, dict):
            assert list(x) == list(y)
            for key in x:
                np.testing.assert_array_equal(x[key], y[key], strict=True)
        elif isinstance(x, np.ndarray):
            np.testing.assert_array_equal(x, y, strict=True)
        else:
            assert x == y


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_read_is_what_was_written(fall: Trajectory, tmp_path: Path, ending: str):
    """Every number to the last bit, holes, empty arrays, odd names and events too; nothing else is left in the folder."""
    path = tmp_path / f"fall.{ending}"
    fall.save(path)
    back = Trajectory.load(path, fall.robot)
    assert_same(fall, back)
    assert not back.q.flags.writeable and back.names[-1] == ODD_NAME
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.stat().st_mode & 0o777 == 0o666 & ~_umask()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(("name", "root"), [("talos", None), ("ur5", "fixed"), ("tiago", "planar")])
def test_a_robot_of_the_catalogue_is_loaded_again(name: str, root: str, ending: str, tmp_path: Path):
    """By its name, with its root: the same joints and motors."""
    there = moved(rbd.load_robot(name, root=root, passive=[] if root else ["torso_1_joint"]))
    there.save(tmp_path / f"x.{ending}")
    back = Trajectory.load(tmp_path / f"x.{ending}")
    assert_same(there, back)
    assert back.robot.actuated_names == there.robot.actuated_names and back.robot.root == there.robot.root


def copied(folder: Path, change: str = "", to: str = "") -> Path:
    """The four-bar's files in a folder, perhaps changed."""
    for name in ("four_bar.urdf", "four_bar.loops.yaml"):
        text = (URDF / name).read_text()
        assert change in text or name.endswith("yaml")
        (folder / name).write_text(text.replace(change, to, 1) if change else text)
    return folder / "four_bar.urdf"


@pytest.mark.parametrize("loops", [True, None])
def test_a_mechanism_is_loaded_with_its_loops(loops: bool | None, tmp_path: Path):
    """Closed where it was closed, with the same passive joints; open where it was open."""
    there = moved(rbd.load_robot(copied(tmp_path), loops=loops))
    there.save(tmp_path / "x.npz")
    back = Trajectory.load(tmp_path / "x.npz")
    assert bool(back.robot.loops()) == bool(loops)
    assert [x.name for x in back.robot.loops()] == [x.name for x in there.robot.loops()]
    assert back.robot.passive == there.robot.passive


def test_a_folder_may_move(tmp_path: Path):
    """Robot and trajectory side by side, both moved: the robot is found beside the trajectory."""
    (tmp_path / "old").mkdir()
    there = moved(rbd.load_robot(copied(tmp_path / "old")))
    there.save(tmp_path / "old" / "x.npz")
    (tmp_path / "old").rename(tmp_path / "new")
    assert_same(there, Trajectory.load(tmp_path / "new" / "x.npz"))


def test_a_mechanism_with_a_loop_file_of_another_name_is_loaded_with_it(tmp_path: Path):
    """Beside the robot it is found again, there and where both have moved; in a folder of its own it is not known any more."""
    (tmp_path / "old" / "apart").mkdir(parents=True)
    urdf = copied(tmp_path / "old")
    own = urdf.with_name("four_bar.loops.yaml")
    other, apart = own.rename(own.with_name("mine.yaml")), own.with_name("apart") / "mine.yaml"
    there = moved(rbd.load_robot(urdf, loops=str(other)))
    assert there.robot.loops()
    there.save(tmp_path / "old" / "x.npz")
    assert_same(there, Trajectory.load(tmp_path / "old" / "x.npz"))
    (tmp_path / "old").rename(tmp_path / "new")
    back = Trajectory.load(tmp_path / "new" / "x.npz")
    assert_same(there, back)
    assert [x.name for x in back.robot.loops()] == [x.name for x in there.robot.loops()]
    (tmp_path / "new").rename(tmp_path / "old")
    other.rename(apart)
    unknown = moved(rbd.load_robot(urdf, loops=str(apart)))
    unknown.save(tmp_path / "y.npz")
    with pytest.raises(rbd.InputError, match="'four_bar' was built by hand.*robot="):
        Trajectory.load(tmp_path / "y.npz")
    assert_same(unknown, Trajectory.load(tmp_path / "y.npz", unknown.robot))


def test_a_changed_gravity_or_joint_is_told(fall: Trajectory, tmp_path: Path):
    """Gravity, with both vectors; of as many joints, the first that has another name."""
    there = moved(rbd.load_robot(copied(tmp_path)))
    there.save(tmp_path / "x.npz")
    moon = rbd.load_robot(tmp_path / "four_bar.urdf")
    moon.model.gravity.linear = np.array([0.0, 0.0, -1.62])
    with pytest.warns(rbd.errors.ModelWarning, match=r"gravity was \[0.0, 0.0, -9.81\] and is \[0.0, 0.0, -1.62\]"):
        Trajectory.load(tmp_path / "x.npz", moon)
    name = list(there.robot.joints)[0]
    renamed = copied(tmp_path, f'joint name="{name}"', 'joint name="lead"')
    (tmp_path / "four_bar.loops.yaml").unlink()
    with pytest.raises(
        rbd.errors.ModelError, match=rf"'four_bar' with joints {name}; four_bar has lead\. Give the robot as it was"
    ):
        Trajectory.load(tmp_path / "x.npz")
    with pytest.raises(rbd.InputError, match=rf"joints {name}; four_bar has lead\. Give the robot that was simulated"):
        Trajectory.load(tmp_path / "x.npz", rbd.load_robot(renamed, root="fixed"))


def test_a_changed_robot_is_told(tmp_path: Path):
    """A mass in the file, another number of joints: ModelError that says what, and what it was; given by hand, a warning."""
    path = copied(tmp_path)
    there = moved(rbd.load_robot(path))
    there.save(tmp_path / "x.npz")
    mass = f'mass value="{_first_mass(path)}"'
    changed = copied(tmp_path, mass, 'mass value="1.2345"')
    with pytest.raises(rbd.errors.ModelError, match=r"has changed since .* mass at joint '\w+' was [\d.]+ and is 1\.2345"):
        Trajectory.load(tmp_path / "x.npz")
    with pytest.warns(rbd.errors.ModelWarning, match="not as it was"):
        assert_same(there, Trajectory.load(tmp_path / "x.npz", rbd.load_robot(changed)))
    path.unlink()
    with pytest.raises(rbd.errors.ModelError, match="cannot be loaded again.*no file"):
        Trajectory.load(tmp_path / "x.npz")
    with pytest.raises(rbd.InputError, match="of 'four_bar' with joints"):
        Trajectory.load(tmp_path / "x.npz", rbd.load_robot("ur5", root="fixed"))
    with pytest.raises(rbd.InputError, match="expected a robot"):
        Trajectory.load(tmp_path / "x.npz", "ur5")


def _first_mass(path: Path) -> str:
    found = path.read_text().split('mass value="')[2:]  # after that of the root link, which is welded
    return found[0].split('"')[0]


def test_what_was_built_by_hand_wants_its_robot(fall: Trajectory, tmp_path: Path):
    """No file says what it is."""
    fall.save(tmp_path / "x.npz")
    with pytest.raises(rbd.InputError, match="built by hand"):
        Trajectory.load(tmp_path / "x.npz")


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_that_was_cut_or_changed_is_refused(fall: Trajectory, tmp_path: Path, ending: str):
    """Cut at forty places, a byte flipped at a hundred: refused in words, or, in what no reader looks at, the same numbers."""
    path = tmp_path / f"x.{ending}"
    fall.save(path)
    data = path.read_bytes()
    spoilt = [data[:k] for k in np.linspace(0, len(data) - 1, 40).astype(int)]
    rng = np.random.default_rng(2)
    for k in rng.integers(0, len(data), 100):
        spoilt.append(data[:k] + bytes([data[k] ^ int(rng.integers(1, 256))]) + data[k + 1 :])
    refused = 0
    for each in spoilt:
        path.write_bytes(each)
        try:
            back = Trajectory.load(path, fall.robot)
        except (rbd.InputError, rbd.errors.ModelError) as error:
            refused += 1
            assert len(str(error)) < 1500 and path.name in str(error)
        except rbd.errors.ModelWarning:  # a number of the robot was hit
            refused += 1
        else:
            assert_same(fall, back)
    assert refused > 60


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_no_trajectory_is_refused(fall: Trajectory, tmp_path: Path, ending: str):
    """Nothing, text, a folder, no file, another ending, other arrays, pickles, a header of tomorrow."""
    path = tmp_path / f"x.{ending}"
    with pytest.raises(rbd.InputError, match="cannot be read"):
        Trajectory.load(path)
    for content in (b"", b"hello", b"PK\x03\x04", b"CDF\x02" + bytes(40)):
        path.write_bytes(content)
        with pytest.raises(rbd.InputError, match="no trajectory"):
            Trajectory.load(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(rbd.InputError, match="cannot be read"):
        Trajectory.load(path)
    with pytest.raises(rbd.InputError, match="cannot be written"):
        fall.save(path)
    for wrong in ("x.csv", "", 7, None, "x\0.npz"):
        for call in (fall.save, Trajectory.load):
            with pytest.raises(rbd.InputError, match="path is"):
                call(wrong)
    with pytest.raises(rbd.InputError, match="cannot be written"):
        fall.save(tmp_path / "nowhere" / f"x.{ending}")


def test_an_archive_of_something_else_is_refused(fall: Trajectory, tmp_path: Path):
    """Other arrays, objects, a header that is none, a part that is missing or of another size."""
    path = tmp_path / "x.npz"
    np.savez(path, a=np.zeros(3))
    with pytest.raises(rbd.InputError, match="it holds a"):
        Trajectory.load(path)
    fall.save(path)
    with np.load(path) as found:
        whole = dict(found)
    header = json.loads(str(whole["header"]))

    def refused(told: str, **changes: object) -> None:
        np.savez(path, **{k: v for k, v in (whole | changes).items() if v is not None})
        with pytest.raises(rbd.InputError, match=told):
            Trajectory.load(path, fall.robot)

    def changed(**entries: object) -> np.ndarray:
        return np.array(json.dumps({k: v for k, v in (header | entries).items() if v is not None}))

    refused("'header.npy': Object arrays cannot be loaded", header=np.array({"format": 1}, dtype=object))
    refused("its header is", header=np.array("{"))
    refused("its header is", header=np.array("[" * 100_000))
    refused("format 2; this rbd reads format 1", header=changed(version=2))
    refused("holds no 'q'", q=None)
    refused("shape", q=np.zeros((7, 3)))
    refused("norm", q=np.zeros((7, 7)))
    refused("not finite", v=np.full((7, 6), np.nan))
    refused("words", mode_floor=np.zeros(7))
    refused("complex", kinetic=np.zeros(7, complex))
    refused("numbers", tau=np.array(["a"]))
    refused("constraints", header=changed(constraints=["floor", "floor"]))
    refused("contacts", header=changed(contacts=["sky"]))
    refused("expected a list", header=changed(events=None))
    refused("an event", header=changed(events=[[0.0, "floor"]]))
    refused("no robot", header=changed(robot=None))
    refused("expected text", header=changed(law=3))
    refused("expected seconds", header=changed(step="fast"))
    refused("with joints", header=changed(robot={}))
    refused("numbers of box", robot_numbers=np.zeros((2, 2)))


def test_an_array_of_another_version_is_refused(fall: Trajectory, tmp_path: Path):
    """Version 3.0 of NumPy has a longer length of the header, which is not there."""
    path = tmp_path / "x.npz"
    fall.save(path)
    with zipfile.ZipFile(path) as archive:
        members = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
    assert members["t"][:8] == b"\x93NUMPY\x01\x00"
    npz_with(path, members | {"t": b"\x93NUMPY\x03\x00" + members["t"][8:]})
    with pytest.raises(rbd.InputError, match=r"no trajectory.*'t.npy': EOF: reading array header"):
        Trajectory.load(path, fall.robot)


def test_an_array_that_is_shorter_than_its_archive_says_is_refused(fall: Trajectory, tmp_path: Path):
    """Its checksum is right, and its header and the archive agree on the size: only what is unpacked is less."""
    path = tmp_path / "x.npz"
    fall.save(path)
    with zipfile.ZipFile(path) as archive:
        members = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
    whole = len(members["kinetic"])
    npz_with(path, members | {"kinetic": members["kinetic"][:-16]})
    data = path.read_bytes()
    at = data.rindex(b"kinetic.npy") - 46  # its entry in the directory, which has the size 24 bytes on
    assert data[at : at + 4] == b"PK\x01\x02"
    assert int.from_bytes(data[at + 24 : at + 28], "little") == whole - 16
    path.write_bytes(data[: at + 24] + whole.to_bytes(4, "little") + data[at + 28 :])
    with pytest.raises(rbd.InputError, match=r"no trajectory.*'kinetic.npy': EOF: reading array data"):
        Trajectory.load(path, fall.robot)


@pytest.mark.parametrize("code", [3, -1])
def test_a_mode_without_a_word_is_refused(code: int, fall: Trajectory, tmp_path: Path):
    """A netCDF file has modes as numbers, and the words in its header."""
    path = tmp_path / "x.nc"
    fall.save(path)
    with netcdf_file(path, "a", mmap=False) as file:
        assert set(file.variables["mode_floor"].data) <= {0, 1, 2}
        file.variables["mode_floor"][3] = code
    with pytest.raises(rbd.InputError, match="'mode_floor' holds numbers for which it gives no mode"):
        Trajectory.load(path, fall.robot)


def test_a_size_that_lies_takes_no_memory(fall: Trajectory, tmp_path: Path):
    """An array said to have 10^15 entries is refused before it is made."""
    path = tmp_path / "x.npz"
    fall.save(path)
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["t.npy"] = members["t.npy"].replace(b"(7,)", b"(9" + b"9" * 14 + b",)", 1)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    with pytest.raises(rbd.InputError, match="no trajectory"):
        Trajectory.load(path, fall.robot)


@pytest.mark.parametrize("ending", ENDINGS)
def test_ctrl_c_while_writing_leaves_the_old_file(fall: Trajectory, tmp_path: Path, ending: str, monkeypatch):
    """The new one is written beside it and moved there when it is whole."""
    path = tmp_path / f"x.{ending}"
    fall.save(path)
    before = path.read_bytes()

    def interrupted(fd: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(array_file.os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fall[:2].save(path)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_numpy_alone_reads_it(fall: Trajectory, tmp_path: Path):
    """Arrays by their names, without pickles."""
    fall.save(tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz", allow_pickle=False) as found:
        np.testing.assert_array_equal(found["force_floor"], fall.forces["floor"])
        assert json.loads(str(found["header"]))["law"] == "coulomb"


def test_netcdf_is_read_by_others(fall: Trajectory, tmp_path: Path):
    """SciPy's reader finds named dimensions, units, and modes as CF's flags."""
    fall.save(tmp_path / "x.nc")
    with netcdf_file(tmp_path / "x.nc", mmap=False) as found:
        assert found.variables["q"].dimensions == ("time", "position") and found.variables["com"].units == b"m"
        mode = found.variables["mode_floor"]
        words = mode.flag_meanings.decode().split()
        assert [words[k] for k in mode.data] == list(fall.modes["floor"])
        np.testing.assert_array_equal(found.variables["kinetic"].data, fall.kinetic)


def test_an_xarray_dataset_has_names_and_units(talos: rbd.Robot, fall: Trajectory):
    """Joints are asked for by name; forces by axis; every variable says what it is."""
    there = moved(talos)
    data = there.to_xarray()
    motor = talos.actuated_names.index("leg_left_4_joint")
    np.testing.assert_array_equal(data.tau.sel(motor="leg_left_4_joint"), there.tau[:, motor])
    np.testing.assert_array_equal(data.q.sel(position="root_joint.z"), there.q[:, 2])
    assert data.velocity_unit.sel(velocity="root_joint.wx") == "rad/s" and data.time.units == "s"
    assert data.motor_unit.sel(motor="leg_left_4_joint") == "N m"
    fallen = fall.to_xarray()
    assert fallen.force_floor.sel(floor_row="z")[-1] == pytest.approx(98.1) and fallen.force_floor.units == "N"
    assert list(fallen.event_kind.values) == ["touches"] * 4 and fallen.attrs["interrupted"] == fall.interrupted
    np.testing.assert_array_equal(fallen.energy, fall.energy)
    assert all("long_name" in v.attrs for name, v in fallen.data_vars.items() if not name.startswith("event_"))


def test_without_xarray_the_extra_is_named(fall: Trajectory, tmp_path: Path, monkeypatch):
    """Not an ImportError from deep inside."""
    monkeypatch.setitem(sys.modules, "xarray", None)  # an import of it then fails
    for call in (fall.to_xarray, lambda: fall.save(tmp_path / "x.nc"), lambda: Trajectory.load(tmp_path / "x.nc")):
        with pytest.raises(rbd.InputError, match=r"rbd-contact\[study\]"):
            call()
    fall.save(tmp_path / "x.npz")


# Files that mean harm


def npz_with(path: Path, members: dict[str, bytes]) -> None:
    """An archive with these bytes for its arrays, compressed: of zeros one byte in two hundred is left."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=3) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)


def npy_of(kind: str, shape: tuple[int, ...], data: bytes) -> bytes:
    """An .npy file by hand: its header says what it likes."""
    head = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + data


def netcdf_with(n: int, length: int, *, repeat: int = 1) -> bytes:
    """A netCDF 3 file whose n variables all lie at one place."""

    def name(text: str) -> bytes:
        return len(text).to_bytes(4, "big") + text.encode() + bytes(-len(text) % 4)

    def number(k: int) -> bytes:
        return k.to_bytes(4, "big")

    head = b"CDF\x01" + number(0) + number(10) + number(1) + name("time") + number(length) + bytes(8) + number(11) + number(n)
    each = number(1) + number(0) + bytes(8) + number(6) + number(8 * length)
    begin = len(head) + n * (len(name(f"v{n:06d}")) + len(each) + 4)
    return head + b"".join(name(f"v{i:06d}") + each + number(begin) for i in range(n)) + bytes(8 * length * repeat)


def harmful(folder: Path) -> dict[str, Path]:
    """{what it does: a file of at most a megabyte or two}."""
    text = '{"format": "rbd trajectory", "version": 1, "events": ['.ljust(64)
    out = {}

    def put(what: str, members: dict[str, bytes]) -> None:
        out[what] = folder / f"{what}.npz"
        npz_with(out[what], members)

    million = 1_000_000
    small = npy_of("<U2", (), "{}".encode("utf-32-le"))
    put("a long header", {"header": npy_of(f"<U{50 * million}", (), text.encode("utf-32-le") + bytes(200 * million - 256))})
    put("long times", {"header": small, "t": npy_of("<f8", (25 * million,), bytes(200 * million))})
    put("long words", {"header": small, "mode_x": npy_of(f"<U{25 * million}", (2,), bytes(200 * million))})
    put("what is no part of it", {"header": small, "x": npy_of("<f8", (25 * million,), bytes(200 * million))})
    lists = "[[]" + ",[]" * 3 * million + "]"
    put("many lists", {"header": npy_of(f"<U{len(lists)}", (), lists.encode("utf-32-le"))})
    put("deep lists", {"header": npy_of(f"<U{2 * million}", (), ("[" * 2 * million).encode("utf-32-le"))})
    put("objects", {"header": npy_of("|O", (), b"\x80\x04N.")})
    put("no such size", {"header": small, "t": npy_of("<f8", (2**62, 2**62), b"")})
    put("less than none", {"header": small, "t": npy_of("<f8", (-8, -1), bytes(64))})
    put("many members", {f"x{i}": b"" for i in range(8000)})
    bomb = folder / "two times.npz"
    with zipfile.ZipFile(bomb, "w") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        for _ in range(2):
            archive.writestr("header.npy", small)
    out["two of one name"] = bomb
    for what, content in {
        "netCDF over itself": netcdf_with(6000, 60_000),
        "netCDF of records": b"CDF\x02" + b"\xff" * 4 + bytes(24),
        "netCDF of many dimensions": b"CDF\x01" + bytes(4) + (10).to_bytes(4, "big") + b"\xff" * 4 + bytes(64),
        "netCDF cut short": netcdf_with(3, 60)[:60],
    }.items():
        out[what] = folder / f"{what}.nc"
        out[what].write_bytes(content)
    return out


def test_files_that_mean_harm_take_no_memory(tmp_path: Path):
    """A megabyte that holds hundreds, or says so, is refused in words, with 150 MB at most, in a process of its own."""
    files = harmful(tmp_path)
    assert max(path.stat().st_size for path in files.values()) < 2_500_000
    code = """
import resource, sys, rbd, xarray, scipy.io
rbd.Trajectory  # its modules are loaded before memory is measured
def peak(): return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
for path in sys.argv[1:]:
    before = peak()
    try:
        rbd.Trajectory.load(path)
    except rbd.InputError as error:
        print(peak() - before, len(str(error)) < 600 and "no trajectory" in str(error), path, error, sep="|")
"""
    command = [sys.executable, "-c", code, *map(str, files.values())]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    told = [line.split("|") for line in done.stdout.splitlines()]
    assert len(told) == len(files), done.stdout
    for megabytes, words, path, error in told:
        assert int(megabytes) < 150 and words == "True", (megabytes, path, error)


def test_files_of_others_that_hold_the_same_are_read(fall: Trajectory, tmp_path: Path):
    """Packed again by NumPy with compression, or with an array more."""
    fall.save(tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as found:
        whole = dict(found)
    np.savez_compressed(tmp_path / "y.npz", **whole, mine=np.arange(3.0))
    assert_same(fall, Trajectory.load(tmp_path / "y.npz", fall.robot))


def test_a_long_rest_may_be_compressed(tmp_path: Path):
    """A motion in which nothing changes packs a hundred times smaller, and is still read."""
    box = rbd.load_robot(URDF / "box.urdf")
    state, touch = box.at(), ConstraintForce(np.zeros(6), "holds")
    rest = [Sample.of(0.1 * k, state, np.zeros(6), np.zeros(0), lambda: {"grip": touch}) for k in range(3000)]
    still = Trajectory.of(SimulatedMotion(box, (Force("grip"),)), rest)
    still.save(tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as found:
        np.savez_compressed(tmp_path / "y.npz", **found)
    assert (tmp_path / "y.npz").stat().st_size * 20 < (tmp_path / "x.npz").stat().st_size
    assert_same(still, Trajectory.load(tmp_path / "y.npz"))


LONG = ("x" * 5000, "/" + "x" * 300 + "/y.urdf", "x/" * 3000)
ODD_TEXTS = (*LONG, "\ud800", "\udcff.urdf", "a\0b", "~nobody/x.urdf", "\x1b[2J", "")


@pytest.mark.parametrize("odd", ODD_TEXTS, ids=lambda text: ascii(text)[:12])
def test_odd_paths_and_characters_in_a_header_are_refused_in_words(odd: str, fall: Trajectory, tmp_path: Path):
    """Where the robot was, its packages and loops, names of constraints, words: long, null, lone surrogates."""
    path = tmp_path / "x.npz"
    fall.save(path)
    with np.load(path) as found:
        whole = dict(found)
    header = json.loads(str(whole["header"]))
    robot = rbd.simulation.trajectory_contents.recipe(rbd.load_robot(URDF / "box.urdf")) | {"joints": header["robot"]["joints"]}
    changes = [
        {"robot": robot | {"file": odd}},
        {"robot": robot | {"file": str(tmp_path / odd) if odd else odd}},
        {"robot": robot | {"package_dirs": [odd]}},
        {"robot": robot | {"loops": odd}},
        {"robot": robot | {"root": odd}},
        {"robot": robot | {"passive": [odd]}},
        {"robot": robot | {"name": odd}},
        {"constraints": [odd]},
        {"contacts": [odd]},
        {"law": odd},
        {"events": [[0.0, odd, odd, 0, 0.0, 0.0]]},
    ]
    for change in changes:
        np.savez(path, **whole | {"header": np.array(json.dumps(header | change))})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                repr(Trajectory.load(path))
            except (rbd.InputError, rbd.errors.ModelError) as error:
                assert len(str(error)) < 2000


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("odd", ODD_TEXTS, ids=lambda text: ascii(text)[:12])
def test_odd_paths_of_files_are_refused_in_words(odd: str, ending: str, fall: Trajectory, tmp_path: Path):
    """To write to and to read from."""
    for path in (f"{odd}.{ending}", str(tmp_path / f"no folder {odd}" / f"x.{ending}")):
        for call in (fall.save, Trajectory.load):
            if os.path.isabs(path) or "x" * 300 in path or call is Trajectory.load:
                with pytest.raises(rbd.InputError):
                    call(path)


def test_words_with_lone_surrogates_are_kept(tmp_path: Path):
    """A name of a file that is no UTF-8 becomes such a word; it comes back as it was."""
    motion, moments, events = falling(n=3)
    odd = Trajectory.of(motion, moments, events, "by \udcff", 0.1, "ended \ud800")
    for ending in ENDINGS:
        try:
            odd.save(tmp_path / f"x.{ending}")
        except rbd.InputError as error:
            assert ending == "nc" and "netCDF" in str(error)
            continue
        back = Trajectory.load(tmp_path / f"x.{ending}", odd.robot)
        assert (back.integrator, back.interrupted) == (odd.integrator, odd.interrupted)


def test_what_is_no_file_is_not_read(tmp_path: Path):
    """A pipe would be waited for, a device read for ever."""
    os.mkfifo(tmp_path / "x.npz")
    (tmp_path / "y.npz").symlink_to("/dev/zero")
    for name in ("x.npz", "y.npz"):
        with pytest.raises(rbd.InputError, match="device or a pipe"):
            Trajectory.load(tmp_path / name)


def test_an_empty_array_of_odd_shape_is_refused(fall: Trajectory, tmp_path: Path):
    """The header of a netCDF file names arrays without entries, and their shapes."""
    for shape in ([2**31, 0], [2**30] * 8 + [0], [0] * 70, [-1, 0], [True, 0], "ab", None):
        header = {"arrays": ["tau"], "modes": [], "empty": {"tau": shape}, "sha256": ""}
        with pytest.raises(rbd.InputError):
            arrays_of_netcdf(header, array_file.xarray_or_error().Dataset())
