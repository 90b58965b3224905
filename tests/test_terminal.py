"""The command line tells names as they are: nothing that a file or a user calls something is read as markup."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import time
import urllib.request
import warnings
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.terminal import TerminalTable, answering, open_console, write_json

URDF = Path(__file__).parents[1] / "urdf"
ODD = ("[/foo]", "[red]", "[bold", "o[x]", ":smiley:", "[link=http://x.example]y[/link]", "a[/]b", "\\[x]")
"""Names that rich would close, colour, hide or draw."""


def run(*arguments: str) -> tuple[int, str, str]:
    """(exit code, what is printed, what is complained)."""
    answer = CliRunner().invoke(app, list(arguments))
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer.exit_code, answer.stdout, answer.stderr


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    """A chain of eight links whose joints and links have odd names; the last lacks an inertia that a body could have."""
    links = []
    for name in ("base", *(f"{name} link" for name in ODD)):
        inertia = '<inertia ixx="9" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
        links.append(f'<link name="{name}"><inertial><mass value="1"/><origin xyz="0 0 -0.2"/>{inertia}</inertial></link>')
    parents = ["base", *(f"{name} link" for name in ODD)]
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name} link"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="100" velocity="1"/><dynamics damping="1"/></joint>'
        for name, parent in zip(ODD, parents, strict=False)
    ]
    path = tmp_path / "odd[bold].urdf"
    path.write_text(f'<robot name="odd[bold]">{"".join(links + joints)}</robot>')
    return path


def test_names_of_joints_are_told_as_they_are(odd: Path, tmp_path: Path):
    """In tables, headlines, lists and warnings of every command that takes a file."""
    code, out, _ = run("info", str(odd), "--root", "fixed")
    assert code == 0 and all(name in out for name in ODD) and "odd[bold]" in out
    code, out, told = run("simulate", str(odd), "--root", "fixed", "--duration", "0.003")
    assert code == 0 and all(name in out for name in ODD) and "odd[bold]" in out
    assert "[/foo]" in told and told.count("warning: ") == 1
    code, out, _ = run("mechanism", str(odd), "--tries", "5")
    assert code == 0 and "[/foo]" in out and "odd[bold]" in out


@pytest.mark.parametrize("name", ODD)
def test_names_that_are_not_there_are_told_as_they_came(name: str, odd: Path):
    """In errors: of robots, files, postures, frames, options."""
    asks = [
        ["stand", f"{name}.urdf"],
        ["info", name],
        ["mechanism", f"no such {name}"],
        ["simulate", "solo12", "--posture", name],
        ["simulate", str(odd), "--root", name],
        ["simulate", str(odd), "--root", "fixed", "--push", "0,1,0", "--at", f"{name} lnk"],
        ["simulate", str(odd), "--push", name, "--at", "x"],
        ["plane", "--from", name, "--to", "1,0"],
        ["plane", "--from", "1,0", "--to", "1,0", "--angles", name],
        ["stand", "solo12", "--html", f"{name}/x.html"],
    ]
    for arguments in asks:
        code, out, told = run(*arguments)
        assert code == 2 and not out
        assert told.replace("\\\\", "\\").count(name.replace("//", "/") if "--html" in arguments else name), arguments


@pytest.mark.parametrize("name", ODD)
def test_files_are_told_under_their_names(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each line `picture: x.html` names the file that is there; figures are drawn for the first name alone."""
    if name != ODD[0]:
        monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, file, **_: file.write(b"a picture"))
    monkeypatch.chdir(tmp_path)
    name = name.replace("/", "|")
    box = str(URDF / "box.urdf")
    outputs = ["--html", f"{name}.html", "--plot", f"{name}.png", "--save", f"{name}.npz"]
    code, out, _ = run("simulate", box, "--duration", "0.002", *outputs)
    assert code == 0
    for what, ending in (("picture", "html"), ("plot", "png"), ("trajectory", "npz")):
        assert f"{what}: {name}.{ending}\n" in out and (tmp_path / f"{name}.{ending}").is_file()
    code, out, _ = run("plane", "--from", "1,0", "--to", "0.5,0.5", "--out", f"{name}2.png")
    assert code == 0 and f"picture: {name}2.png\n" in out


def test_reports_are_right_on_any_console(odd: Path):
    """Printed by a user's own console too, which reads markup in what is text."""
    from rbd.cli.robot_reports import robot_info

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = rbd.load_robot(odd, root="fixed")
    for console in (Console(file=io.StringIO(), width=200), Console(file=io.StringIO(), width=200, markup=False)):
        console.print(robot_info(robot))
        told = console.file.getvalue()
        assert all(name in told for name in ODD if name != ":smiley:") and "\\[/foo]" not in told


def test_a_table_tells_its_cells_as_they_are():
    """Title, headings and cells."""
    table = TerminalTable("[/title]")
    table.add_column("[/heading]")
    table.add_row(":smiley: [/cell]")
    console = Console(file=io.StringIO(), width=60)
    console.print(table)
    assert all(word in console.file.getvalue() for word in ("[/title]", "[/heading]", ":smiley: [/cell]"))


def test_what_the_terminal_cannot_say_is_written_with_backslashes(tmp_path: Path):
    """A file's name that is no UTF-8, and an ASCII terminal: no UnicodeEncodeError."""
    name = os.fsdecode(b"\xff\xfe")
    box = str(URDF / "box.urdf")
    command = [sys.executable, "-m", "rbd", "simulate", box, "--duration", "0.002", "--save", f"{name}.npz"]
    for encoding in ("utf-8", "ascii"):
        environment = os.environ | {"PYTHONIOENCODING": encoding, "RBD_COMPILED": "0"}  # to load Numba takes a second
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, timeout=120)
        assert done.returncode == 0, done.stderr
        assert b"trajectory: \\udcff\\udcfe.npz" in done.stdout and (tmp_path / f"{name}.npz").is_file()


def test_each_warning_is_told_once(capsys: pytest.CaptureFixture[str]):
    """However often it is given; others, and their order, stay."""
    with answering():
        for words in ("first [/x]", "second", "first [/x]", "second"):
            warnings.warn(words, rbd.errors.ModelWarning, stacklevel=1)
        warnings.warn("not for users", DeprecationWarning, stacklevel=1)
    assert capsys.readouterr().err == "warning: first [/x]\nwarning: second\n"


@pytest.mark.parametrize("robot", ["panda", "solo12", "bolt"])
def test_no_line_of_warnings_comes_twice(robot: str):
    """Of a robot that is loaded, held and simulated: each joint's complaint once."""
    _, _, told = run("simulate", robot, "--duration", "0.002")
    lines = told.splitlines()
    assert len(lines) == len(set(lines)) and sum(" joints have damping" in line for line in lines) <= 1


@pytest.mark.parametrize("option", ["--tries=-5", "--tries=0", "--tries=1000001", "--tries=99999999999999999999", "--seed=-1"])
@pytest.mark.parametrize("name", ["four_bar", "box", "unicycle"])
def test_tries_and_seeds_out_of_range_are_refused(option: str, name: str):
    """Also where no branches are looked for; they were told as something that is left out."""
    code, out, told = run("mechanism", str(URDF / f"{name}.urdf"), option)
    assert code == 2 and not out and "expected a whole number from" in told and option.split("=")[1] in told


@pytest.mark.parametrize("friction", ["nan", "inf", "-1", "1e300"])
@pytest.mark.parametrize("command", [["stand", "solo12"], ["simulate", str(URDF / "box.urdf")], ["simulate", "ur5"]])
def test_friction_out_of_range_is_refused(command: list[str], friction: str):
    """Also where nothing touches."""
    code, out, told = run(*command, "--friction", friction)
    assert code == 2 and not out and "friction is" in told


@pytest.mark.parametrize(
    ("command", "advice"),
    [
        (["stand", "no such"], "`rbd robots` has them all"),
        (["stand", "ur5"], "`rbd robots` lists those that do"),
        (["stand", "solo12", "--friction=-1"], "--friction is -1.0; expected a finite number >= 0."),
        (["stand", "solo12", "--facets=2"], "--facets is 2"),
        (["stand", "solo12", "--push=0,1,0", "--at=x"], "See `rbd info`"),
        (["stand", "solo12", "--push=0,inf,0", "--at=base_link"], "three finite numbers, X,Y,Z in newtons"),
        (["mechanism", str(URDF / "four_bar.urdf"), "--tries=0"], "--tries is 0"),
        (["simulate", str(URDF / "box.urdf"), "--step=0"], "--step is 0.0"),
        (["simulate", str(URDF / "box.urdf"), "--law=x"], "--law is 'x'; expected 'coulomb' or 'convex'"),
        (["plane", "--from=1,0", "--to=0.5,0.5", "--links=0"], "--links 1 to 50"),
        (["plane", "--from=1,0", "--to=0,1", "--lengths=0.5,0.5", "--links=3"], "--lengths has 2 numbers, and --links is 3"),
        (["plane", "--from=0,1", "--to=1,0", "--links=1", "--space=endpoint"], "Plan in joint space (--space joint)"),
        (["plane", "--from=nan,0", "--to=1,0"], "--from is 'nan,0'; expected two finite numbers, X,Y in metres"),
    ],
)
def test_messages_advise_in_options_and_commands(command: list[str], advice: str):
    """A call of Python, or an argument's name, helps nobody at a prompt."""
    code, _, told = run(*command)
    assert code in (1, 2) and advice in told
    assert not re.search(r"\brbd\.\w|\w\(|\w=", told), told


def test_warnings_speak_of_commands_too():
    """Where a report is to be had, it is a command's."""
    _, _, told = run("simulate", "solo12", "--duration", "0.002")
    assert "rbd.doctor" not in told and "robot.standing()" not in told


def test_the_issues_of_a_model_speak_of_commands(tmp_path: Path):
    """A loop that is open in every posture: the command that closes it, not the function."""
    text = (URDF / "four_bar.loops.yaml").read_text()
    (tmp_path / "four_bar.loops.yaml").write_text(text.split("postures:")[0])
    (tmp_path / "four_bar.urdf").write_bytes((URDF / "four_bar.urdf").read_bytes())
    code, out, _ = run("info", str(tmp_path / "four_bar.urdf"))
    assert code == 0 and "open in every posture" in out and "`rbd mechanism` closes it" in out


def test_numbers_that_json_has_not_are_null(tmp_path: Path):
    """NaN and infinity would make a file that other readers refuse."""

    @dataclass
    class Report:
        """A report.

        Attributes:
            a: Numbers.
            b: More of them.
            d: Text.
        """

        a: np.ndarray
        b: dict[str, tuple[float, int]]
        d: str

    write_json(tmp_path / "x.json", Report(np.array([1.0, np.nan]), {"c": (float("inf"), 2)}, "NaN"))
    told = json.loads((tmp_path / "x.json").read_text(), parse_constant=pytest.fail)
    assert told == {"a": [1.0, None], "b": {"c": [None, 2]}, "d": "NaN"}


def test_the_console_reads_no_markup():
    """What every command prints with."""
    console = open_console()
    with console.capture() as told:
        console.print("[/foo] :smiley: [red]x[/]")
    assert told.get() == "[/foo] :smiley: [red]x[/]\n"


def test_no_other_module_makes_a_console():
    """One home: a second console would read markup again."""
    for path in sorted(Path(rbd.__file__).parent.rglob("*.py")):
        if path.name not in ("terminal.py", "progress_bar.py"):  # of the simulation, whose bar has words of its own only
            text = path.read_text(encoding="utf-8")
            assert "Console(" not in text and "rich.markup" not in text and "rich.table import" not in text, path.name


@pytest.mark.parametrize(
    "command",
    [
        ["stand", "bolt"],
        ["mechanism", str(URDF / "four_bar.urdf")],
        ["simulate", str(URDF / "box.urdf"), "--duration", "0.05"],
    ],
    ids=lambda command: command[0],
)
def test_a_live_scene_is_served_until_ctrl_c(monkeypatch: pytest.MonkeyPatch, command: list[str]):
    """Its address is told, the page is there meanwhile, and the answer is printed before."""
    pages = []

    def wait(seconds: float) -> None:
        with urllib.request.urlopen(opened[0], timeout=10.0) as page:
            pages.append(page.read().decode())
        raise KeyboardInterrupt

    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address, new=0: opened.append(address))
    monkeypatch.setattr("rbd.cli.terminal.time", SimpleNamespace(sleep=wait, perf_counter=time.perf_counter))
    code, out, _ = run(*command, "--show")
    assert code == 0 and out.endswith(f"serving at {opened[0]}; Ctrl-C ends it\nended\n")
    assert len(pages) == 1 and "</html>" in pages[0]


def test_a_motion_stopped_before_it_began_has_no_tables(monkeypatch: pytest.MonkeyPatch):
    """Nothing was computed: the reason alone, and code 1."""

    def stop(*arguments: object, **settings: object) -> None:
        raise rbd.errors.SimulationStopped(
            "the start has no solution", state=None, t=0.0, names=(), trajectory=None, cause=ValueError()
        )  # fmt: skip

    monkeypatch.setattr("rbd.simulation.run.simulate", stop)
    code, out, told = run("simulate", str(URDF / "box.urdf"), "--duration", "0.05")
    assert code == 1 and "the start has no solution" in told and "steps" not in out
