"""What a shell completes, the panels of --help, and the address of a page."""

from __future__ import annotations

import io
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from rich.console import Console
from typer.models import OptionInfo
from typer.testing import CliRunner

from rbd.cli.app import app
from rbd.cli.options import PANELS
from rbd.cli.terminal import print_path


def completed(line: str) -> list[str]:
    """What bash is told at the end of a line."""
    asked = {"_RBD_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    answer = CliRunner().invoke(app, [], prog_name="rbd", env=asked)
    assert answer.exit_code == 0 and not answer.stderr, answer.stderr
    return answer.stdout.split()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("rbd warm", ["warm-up"]),
        ("rbd stand solo", ["solo12", "solo8"]),
        ("rbd stand ./so", []),
        ("rbd stand solo12 --at FL_", ["FL_HAA", "FL_SHOULDER", "FL_HFE", "FL_UPPER_LEG", "FL_KFE", "FL_LOWER_LEG"]),
        ("rbd walk solo12 --feet FL_FOOT,HR_F", ["FL_FOOT,HR_FOOT"]),
        ("rbd mechanism four_bar --posture ", ["assembled", "crossed"]),
        ("rbd simulate nobody --at ", []),
        ("rbd stand talos --law c", ["coulomb", "convex"]),
        ("rbd check a.csv --robot four_", ["four_bar"]),
        ("rbd stand solo12 --joint FL_K", ["FL_KFE="]),
    ],
)
def test_a_shell_completes_robots_frames_and_postures(line: str, expected: list[str]):
    """Those of the robot that the line names; nothing for paths, which a shell completes by itself, and unknown robots."""
    assert completed(line)[: len(expected) or None] == expected


def test_every_parameter_in_a_panel_is_one_of_a_command():
    """No name of the table is stale, and what commands share is in one panel everywhere."""
    used = dict[str, set[str | None]]()
    for command in app.registered_commands:
        assert command.callback is not None
        for name, hint in get_type_hints(command.callback, include_extras=True).items():
            for option in (each for each in get_args(hint) if isinstance(each, OptionInfo)):
                used.setdefault(name, set()).add(option.rich_help_panel)
    panels = {name: panel for panel, names in PANELS.items() for name in names.split()}
    assert set(panels) <= set(used)
    assert {name: used[name] for name in panels} == {name: {panel} for name, panel in panels.items()} | {"from_": used["from_"]}
    assert used["from_"] == {"Push", "Motion"}


def test_a_page_has_its_address_on_a_line_of_its_own(tmp_path: Path):
    """Spaces and such are escaped, as a terminal wants it; other files have none."""
    console = Console(file=io.StringIO(), width=40)
    for name in ("a walk.html", "a.png"):
        print_path(console, "picture", tmp_path / name)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    page, figure = tmp_path / "a walk.html", tmp_path / "a.png"
    assert lines == [f"picture: {page}", page.as_uri(), f"picture: {figure}"]
    assert lines[1].startswith("file:///") and "a%20walk.html" in lines[1]
