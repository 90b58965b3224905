"""Files are written whole or not at all, where they belong, and their places are checked before the work."""

from __future__ import annotations

import importlib
import os
import pkgutil
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.model.output_files import check_place, write_file, write_text
from rbd.visual import Scene, export_motion, motion_sheet, screenshot

URDF = Path(__file__).parents[1] / "urdf"
ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


@pytest.fixture(scope="module")
def box() -> rbd.Robot:
    """The crate of 10 kg."""
    return rbd.load_robot(URDF / "box.urdf")


@pytest.fixture(scope="module")
def fall(box: rbd.Robot) -> rbd.Trajectory:
    """Free fall of a tenth of a second."""
    return rbd.simulate(box.at(), [], duration=0.1, step=0.01, progress=False)


@pytest.fixture
def umask():
    """Sets the process's umask for one test."""
    before = os.umask(0o022)
    os.umask(before)
    yield os.umask
    os.umask(before)


def left_in(folder: Path) -> list[str]:
    """All names in a folder, hidden ones too."""
    return sorted(os.listdir(folder))


def mode(path: Path) -> int:
    """Permissions."""
    return stat.S_IMODE(path.stat().st_mode)


class TestWriting:
    """The one home of files that are written."""

    def test_a_failure_leaves_the_old_file_and_nothing_else(self, tmp_path: Path):
        """An error or Ctrl-C in the middle: the old bytes stay, no part is left."""
        place = tmp_path / "x.html"
        place.write_text("old")
        for failure in (OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError("odd")):

            def write(file, failure=failure):
                file.write(b"half")
                raise failure

            with pytest.raises((rbd.InputError, KeyboardInterrupt, ValueError)):
                write_file(place, write)
            assert place.read_text() == "old" and left_in(tmp_path) == ["x.html"]

    def test_readers_see_the_old_file_or_the_new_one(self, tmp_path: Path):
        """Another thread reads while the file is written again and again: never a part of it."""
        place, texts = tmp_path / "x.json", {"a" * 200_000, "b" * 300_000}
        write_text(place, min(texts))
        seen, end = set(), threading.Event()

        def read():
            while not end.is_set():
                seen.add(place.read_text())

        thread = threading.Thread(target=read)
        thread.start()
        for _ in range(20):
            for text in texts:
                write_text(place, text)
        end.set()
        thread.join()
        assert seen <= texts

    @pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
    def test_a_new_file_has_the_permissions_of_new_files(self, tmp_path: Path, umask, mask: int):
        """As `open` gives them."""
        umask(mask)
        (tmp_path / "made by open").write_text("")
        write_text(tmp_path / "x", "")
        assert mode(tmp_path / "x") == mode(tmp_path / "made by open") == 0o666 & ~mask

    def test_an_old_file_keeps_its_permissions(self, tmp_path: Path):
        """One that only its owner may read does not become public."""
        place = tmp_path / "x"
        for permissions in (0o600, 0o640, 0o666):
            place.write_text("old")
            place.chmod(permissions)
            write_text(place, "new")
            assert mode(place) == permissions and place.read_text() == "new"

    def test_links_are_followed(self, tmp_path: Path):
        """A link stays one, to a file that is there or not, relative or in a chain."""
        (tmp_path / "folder").mkdir()
        (tmp_path / "link").symlink_to("folder/file")
        (tmp_path / "second").symlink_to(tmp_path / "link")
        for text, place in (("new", "link"), ("newer", "link"), ("last", "second")):
            write_text(tmp_path / place, text)
            assert (tmp_path / "folder" / "file").read_text() == text
        assert (tmp_path / "link").is_symlink() and (tmp_path / "second").is_symlink()
        assert left_in(tmp_path / "folder") == ["file"]

    def test_pipes_and_devices_are_written_directly(self, tmp_path: Path):
        """/dev/null stays a device; a pipe gets the bytes."""
        write_text(Path("/dev/null"), "x")
        assert not Path("/dev/null").is_file()
        pipe, got = tmp_path / "pipe", []
        os.mkfifo(pipe)
        reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
        reader.start()
        write_text(pipe, "told")
        reader.join(10)
        assert got == ["told"] and stat.S_ISFIFO(pipe.stat().st_mode)

    def test_a_text_that_is_no_unicode_is_written(self, tmp_path: Path):
        """A lone surrogate of a file's name has no UTF-8."""
        write_text(tmp_path / "x", "a\udcffb")
        assert (tmp_path / "x").read_bytes() == b"a?b"

    def test_long_names_are_taken_as_far_as_the_system_goes(self, tmp_path: Path):
        """The name of the part is not longer than the file's."""
        place = tmp_path / ("x" * os.pathconf(tmp_path, "PC_NAME_MAX"))
        check_place(place)
        write_text(place, "x")
        assert place.read_text() == "x"


def bad_places(folder: Path) -> dict[str, Path]:
    """{why: a place where nothing can be written}."""
    (folder / "taken.html").mkdir()
    (folder / "file").write_text("")
    (folder / "loop.html").symlink_to("loop.html")
    (folder / "dangling").symlink_to("nowhere/at all")
    out = {
        "there is no folder": folder / "nowhere" / "x.html",
        "it is a folder": folder / "taken.html",
        "Not a directory": folder / "file" / "x.html",
        "too long": folder / ("x" * 300 + ".html"),
        "symbolic links": folder / "loop.html",
        "no folder": folder / "dangling",
    }
    if not ROOT:  # root may write anywhere
        closed, kept = folder / "closed", folder / "kept.html"
        closed.mkdir()
        closed.chmod(0o500)
        kept.write_text("old")
        kept.chmod(0o400)
        out |= {"may be made in the folder": closed / "x.html", "may not be overwritten": kept}
    return out


def test_a_place_where_nothing_can_be_written_is_refused(tmp_path: Path):
    """Each in words, by the check and by the writing, in the error that was asked for."""
    for words, place in bad_places(tmp_path).items():
        for act in (lambda place=place: check_place(place), lambda place=place: write_text(place, "x")):
            with pytest.raises(rbd.InputError, match=words):
                act()
        with pytest.raises(rbd.errors.PictureError, match="Give a file in a folder"):
            check_place(place, rbd.errors.PictureError)
    check_place(tmp_path / "file")
    check_place(Path("x"))


def test_exports_check_their_place_before_they_work(box: rbd.Robot, fall: rbd.Trajectory, tmp_path: Path, monkeypatch):
    """Pages, pictures and files: refused before anything is drawn or collected."""

    def never(*args: object, **kwargs: object) -> None:
        raise AssertionError("work was done for a place where nothing can be written")

    with Scene(box) as scene:
        scene.show(box.at())
        monkeypatch.setattr(scene, "page", never)
        monkeypatch.setattr("rbd.visual.playback.animation.motion_scene", never)
        monkeypatch.setattr("rbd.simulation.trajectory.arrays_of", never)
        monkeypatch.setattr("rbd.simulation.trajectory.for_netcdf", never)
        nowhere = tmp_path / "nowhere"
        asks: list[tuple[type[Exception], Callable[[], object]]] = [
            (rbd.errors.PictureError, lambda: scene.export(nowhere / "x.html")),
            (rbd.errors.PictureError, lambda: export_motion(fall, nowhere / "x.html")),
            (rbd.errors.PictureError, lambda: motion_sheet(fall, 2, nowhere / "x.png")),
            (rbd.errors.PictureError, lambda: screenshot(URDF / "box.urdf", nowhere / "x.png")),
            (rbd.InputError, lambda: fall.save(nowhere / "x.npz")),
            (rbd.InputError, lambda: fall.save(nowhere / "x.nc")),
            (rbd.errors.ModelError, lambda: rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5, path=nowhere / "x.urdf")),
        ]
        for kind, ask in asks:
            with pytest.raises(kind, match="there is no folder"):
                ask()


def test_a_mechanism_is_not_written_without_its_loops(tmp_path: Path):
    """The URDF alone would load as an open chain: where the loop file cannot be written, neither is."""
    (tmp_path / "x.loops.yaml").mkdir()
    with pytest.raises(rbd.errors.ModelError, match="it is a folder"):
        rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5, path=tmp_path / "x.urdf")
    assert left_in(tmp_path) == ["x.loops.yaml"]


@pytest.mark.parametrize("ending", ["npz", "nc", "html"])
def test_ctrl_c_while_a_trajectory_is_written(fall: rbd.Trajectory, tmp_path: Path, ending: str, monkeypatch):
    """The old file stays, of each kind."""
    place = tmp_path / f"x.{ending}"
    place.write_text("old")

    def interrupted(fd: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fall.export(place) if ending == "html" else fall.save(place)
    assert place.read_text() == "old" and left_in(tmp_path) == [place.name]


COMMANDS = {
    "stand": (["bolt"], {"--html": "html", "--json": "json"}),
    "mechanism": ([str(URDF / "four_bar.urdf")], {"--html": "html", "--json": "json"}),
    "simulate": ([str(URDF / "box.urdf")], {"--html": "html", "--json": "json", "--save": "npz", "--plot": "png"}),
    "walk": (["solo12"], {"--html": "html", "--json": "json", "--save": "npz", "--plot": "png", "--log": "npz"}),
    "plane": (["--from", "1,0", "--to", "0.5,0.5"], {"--html": "html", "--json": "json", "--out": "png"}),
}
OPTIONS = [(command, option, ending) for command, (_, options) in COMMANDS.items() for option, ending in options.items()]


@pytest.mark.parametrize(("command", "option", "ending"), OPTIONS)
def test_the_command_line_refuses_a_place_before_it_works(command: str, option: str, ending: str, tmp_path: Path, monkeypatch):
    """Exit code 2, and no robot was loaded: a missing folder, a folder, a file of the same name twice, a wrong ending."""

    def never(*args: object, **kwargs: object) -> None:
        raise AssertionError("a robot was loaded")

    for module in pkgutil.iter_modules(rbd.cli.__path__):  # one that is first imported below would keep what is put there
        importlib.import_module(f"rbd.cli.{module.name}")
    for door in ("rbd.robots.loading.load_robot", "rbd.cli.simulate_report.load_robot", "rbd.cli.plane_report.plane_task"):
        monkeypatch.setattr(door, never)
    (tmp_path / f"taken.{ending}").mkdir()
    places = {"there is no folder": [tmp_path / "nowhere" / f"x.{ending}"], "it is a folder": [tmp_path / f"taken.{ending}"]}
    arguments, options = COMMANDS[command]
    other = next(name for name in options if name != option)
    if ending == "json":
        places["are one file"] = [tmp_path / f"x.{options[other]}", other, tmp_path / "." / f"x.{options[other]}"]
    else:
        places["ends in"] = [tmp_path / "x.txt"]
    for words, given in places.items():
        done = CliRunner().invoke(app, [command, *arguments, option, *map(str, given)])
        assert done.exit_code == 2 and words in done.stderr and option in done.stderr, (done.stderr, done.exception)
        assert not done.stdout


def test_the_robots_own_file_is_not_overwritten(tmp_path: Path):
    """Rbd mechanism x.urdf --json x.urdf would leave no robot."""
    robot = tmp_path / "box.urdf"
    robot.write_text((URDF / "box.urdf").read_text())
    done = CliRunner().invoke(app, ["simulate", str(robot), "--json", str(tmp_path / "." / "box.urdf")])
    assert done.exit_code == 2 and "the file that is read" in done.stderr
    assert robot.read_text() == (URDF / "box.urdf").read_text()


def test_numbers_may_go_to_standard_output(tmp_path: Path):
    """--json /dev/stdout, in a process of its own."""
    command = [sys.executable, "-m", "rbd", "plane", "--from", "1,0", "--to", "0.5,0.5", "--json", "/dev/stdout"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0 and '"lengths": [' in done.stdout, done.stderr


def test_no_module_writes_files_on_its_own():
    """Files for a user are written by `rbd.model.output_files` alone; the others write into folders of their own."""
    own = {"output_files.py", "planar_motion.py", "stores.py"}
    for path in sorted(Path(rbd.__file__).parent.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        writes = [word for word in (".write_text(", ".write_bytes(", "savefig(path", '"wb")', '"w")') if word in text]
        in_memory = path.match("audits/bench/files.py")  # HDF5 is written into bytes
        assert not writes or path.name in own or in_memory, f"{path.name}: {writes}"


@pytest.mark.parametrize(("name", "words"), [("kept.html", "it may not be overwritten"), ("x.html", "no file may be made")])
def test_what_the_system_does_not_permit_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str):
    """As to a user without the rights, whoever runs this test: the old file stays, and nothing else is made."""
    (tmp_path / "kept.html").write_text("old")
    denied = os.path.realpath(tmp_path / name if name == "kept.html" else tmp_path)
    monkeypatch.setattr(os, "access", lambda path, how: os.path.realpath(path) != denied)
    for act in (lambda: check_place(tmp_path / name), lambda: write_text(tmp_path / name, "x")):
        with pytest.raises(rbd.InputError, match=f"{words}.*permission denied"):
            act()
    assert left_in(tmp_path) == ["kept.html"] and (tmp_path / "kept.html").read_text() == "old"
