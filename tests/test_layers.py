"""Imports go downward only: the table of the plan, kept by reading the imports of every module."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "rbd"

LAYERS: dict[str, int] = {
    # 0: know nothing of robots or problems. arrays and cones raise our errors.
    "errors": 0,
    "arrays": 0,
    "cones": 0,
    "rays": 0,
    "polygon": 0,
    "kept_files": 0,
    # limits: plain numbers; programs: SciPy's optimisers within them.
    "limits": 0,
    "programs": 0,
    "forks": 0,
    "output_files": 0,
    "openings": 0,
    "ground": 0,
    # engine is imported before all else: is it our Pinocchio?
    "engine": 0,
    # 1: one side knows Pinocchio, the other NumPy; `problem` is made of `rows`.
    "catalogue": 1,
    "xml_file": 1,
    "urdf_file": 1,
    "urdf_shapes": 1,
    "mjcf": 1,
    "mjcf_equality": 1,
    "loop_file": 1,
    "model_file": 1,
    "model": 1,
    "rows": 1,
    "parts": 1,
    "problem": 1,
    # 2: a state is made of a model and can say its momentum balance, in the arrays of `problem`.
    #    dynamics and external read a state; residuals, contact_force and analysis are parts of the solution.
    "state": 2,
    "geometry": 2,
    "external": 2,
    "dynamics": 2,
    "doctor": 2,
    "scales": 2,
    "residuals": 2,
    "contact_force": 2,
    "analysis": 2,
    "solution": 2,
    # 3: constraints and solvers never import each other.
    "constraints": 3,
    "solvers": 3,
    "sensitivity": 3,
    # 4: the facade stands on a posture; least_constraint is the door.
    "posture": 4,
    "loops": 4,
    "robot": 4,
    "combined": 4,
    "nearest": 4,
    "least_constraint": 4,
    # 5 and 6: what is built on the answer.
    "simulation": 5,
    "equilibrium": 5,
    "least_friction": 4,
    "laws": 5,
    "agreement": 5,
    "inverse": 5,
    "mechanism": 5,
    "planar": 5,
    "terminal": 5,
    "reference_problems": 5,
    "study": 6,
    "visual": 6,
    "testing": 6,
    "report": 6,
    "mechanism_report": 6,
    "simulate_report": 6,
    "simulate_setup": 6,
    "plane_report": 6,
    "listing": 6,
    "cli": 6,
    # 7: the package's own doors.
    "": 7,
    "__main__": 7,
}

BESIDE: set[tuple[str, str]] = {
    ("arrays", "errors"),  # what is not finite is refused
    ("cones", "errors"),  # a negative friction is refused
    ("cones", "arrays"),  # the type Array, and the check of numbers
    ("cones", "programs"),  # the nearest wrench of a patch
    ("programs", "arrays"),  # what is not finite is not passed on
    ("programs", "limits"),
    ("ground", "arrays"),
    ("ground", "errors"),  # a normal that is no unit vector is refused
    ("rays", "arrays"),
    ("rays", "cones"),  # rays of the sets
    ("polygon", "arrays"),  # the type Array
    ("output_files", "errors"),  # what cannot be written is refused
    ("engine", "errors"),  # another Pinocchio is refused
    ("mjcf", "urdf_file"),  # complaints and numbers are told alike
    ("mjcf", "xml_file"),  # included files are read alike
    ("mjcf_equality", "urdf_file"),
    ("loop_file", "urdf_file"),  # the same largest numbers and names
    ("model_file", "xml_file"),  # a robot's file is read, then checked as URDF or MJCF
    ("model_file", "urdf_file"),
    ("model_file", "urdf_shapes"),
    ("urdf_shapes", "urdf_file"),  # sizes are numbers, complained of alike
    ("model_file", "mjcf"),
    ("model_file", "mjcf_equality"),
    ("catalogue", "errors"),
    ("parts", "rows"),  # sets and velocities of rows
    ("problem", "parts"),
    ("problem", "rows"),  # a problem is made of rows
    ("external", "state"),  # a force at a frame needs the frame's Jacobian
    ("dynamics", "state"),  # terms of a state
    ("doctor", "state"),  # where loops are closed
    ("dynamics", "external"),  # the right-hand side has external forces in it
    ("solution", "residuals"),  # the certificate
    ("least_constraint", "nearest"),  # an error offers the nearest motion
    ("solution", "contact_force"),  # the table of contacts
    ("solution", "analysis"),  # what is unique, chosen, contradictory
    ("analysis", "residuals"),  # what counts as zero
    ("analysis", "scales"),
    ("residuals", "scales"),  # what misses are measured against
    ("analysis", "contact_force"),  # what carries nothing
    ("robot", "posture"),  # a robot stands in one
    ("robot", "loops"),  # and has loops
    ("simulation", "equilibrium"),  # a posture is held by the torques of `hold`
    ("cli", "simulate_report"),
    ("cli", "simulate_setup"),
    ("cli", "plane_report"),
    ("plane_report", "visual"),  # its picture, imported where it is drawn
    ("simulate_report", "simulate_setup"),
    ("simulate_report", "report"),  # numbers are printed alike
    ("cli", "mechanism_report"),
    ("cli", "report"),  # the command line prints it
    ("cli", "visual"),  # imported where the page is written, so that the table alone needs no viewer
    ("cli", "listing"),
    ("cli", "study"),
}
"""Imports within one layer that are allowed, and why; anything else must go down."""

SIDES = [{"constraints", "solvers"}, {"model", "rows"}, {"model", "problem"}]
"""Rooms that never import each other: they meet in `rows`."""


def _modules() -> dict[str, Path]:
    """{dotted name below rbd, "" for rbd itself: file}."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = list(path.relative_to(PACKAGE).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


def imports(source: str, importer: str = "") -> set[str]:
    """Modules below rbd that a source imports, at the top or inside functions; not those for type checking only."""
    found: set[str] = set()
    package = importer.split(".")[:-1] if MODULES.get(importer, Path()).name != "__init__.py" else importer.split(".")

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for child in node.orelse:
                visit(child)
            return
        if isinstance(node, ast.Import):
            ours = [a.name for a in node.names if a.name.split(".")[0] == "rbd"]
            found.update(name.removeprefix("rbd").removeprefix(".") for name in ours)
        if isinstance(node, ast.ImportFrom):
            base = (node.module or "").split(".")
            if node.level:
                base = ["rbd", *package[: len(package) - node.level + 1], *(base if node.module else [])]
            if base[0] == "rbd":
                inner = ".".join(p for p in base[1:] if p)
                for alias in node.names:
                    name = f"{inner}.{alias.name}".removeprefix(".")
                    found.add(name if name in MODULES else inner)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(source))
    return found


def room(module: str) -> str:
    """The first part of a dotted name: the unit that has a layer."""
    return module.split(".")[0]


def _imports_of(module: str) -> set[str]:
    return imports(MODULES[module].read_text(), module) - {module}


def test_every_module_has_a_layer():
    """A new room is put into the table, by a person."""
    assert {room(m) for m in MODULES} <= set(LAYERS), "give the new module a layer in tests/test_layers.py"


@pytest.mark.parametrize("module", MODULES)
def test_imports_go_down(module: str):
    """A module imports from lower layers, from its own folder, or from a neighbour that the table names."""
    here = room(module)
    for other in _imports_of(module):
        there = room(other)
        if there == here:
            continue
        assert LAYERS[there] < LAYERS[here] or (here, there) in BESIDE, f"{module} imports {other}, not below it"


@pytest.mark.parametrize(("one", "other"), [sorted(pair) for pair in SIDES])
def test_two_sides_never_import_each_other(one: str, other: str):
    """Constraints and solvers, robot and algebra meet in `rows` alone."""
    for module in MODULES:
        if room(module) in (one, other):
            foreign = other if room(module) == one else one
            assert foreign not in {room(m) for m in _imports_of(module)}, module


def test_no_import_goes_round_in_a_circle():
    """The imports of all modules, lazy ones too, can be put in an order."""
    graph = {m: _imports_of(m) for m in MODULES if m != ""}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"circle: {error.args[1]}")


def test_no_module_is_longer_than_four_hundred_lines():
    """One idea a file."""
    long = {m: n for m, p in MODULES.items() if (n := len(p.read_text().splitlines())) > 400}
    assert not long


def test_only_one_file_knows_proxsuite():
    """One sign, one retry policy: `solvers/qp.py`."""
    users = {m for m, path in MODULES.items() if _imports_library(path, "proxsuite")}
    assert users == {"solvers.qp"}


def test_only_one_file_calls_the_optimisers():
    """Each program is posed within the limits of `limits.py`; the root of one number needs none, a checker trusts no one."""
    users = {m for m, path in MODULES.items() if "scipy.optimize import" in path.read_text()}
    assert users == {"programs", "mechanism.continuation", "testing.solver_check"}


def test_the_algebra_knows_no_pinocchio():
    """Cones, rows, problems, solutions and solvers are arrays; one file asks Pinocchio's ADMM."""
    algebra = "errors arrays cones rays parts polygon rows problem scales residuals contact_force analysis".split()
    algebra += ["solution", "solvers"]
    users = {m for m, path in MODULES.items() if room(m) in algebra and _imports_library(path, "pinocchio")}
    assert users == {"solvers.pinocchio_admm"}


def _imports_library(path: Path, library: str) -> bool:
    for node in ast.walk(ast.parse(path.read_text())):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
        if any(n.split(".")[0] == library for n in names):
            return True
    return False


def test_importing_rbd_is_light():
    """`import rbd` brings neither viewer, nor plots, nor computer algebra, nor the command line's tools."""
    heavy = ("meshcat", "matplotlib", "sympy", "typer", "rich")
    code = f"import sys, rbd; print(*[m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []


def test_the_reader_of_imports_sees_lazy_ones_and_passes_over_types():
    """The test above can fail: imports inside functions count, those under TYPE_CHECKING do not."""
    source = """
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from rbd.robot import Robot
def late():
    from rbd.solvers import qp
import rbd.cones
from . import rows
"""
    assert imports(source, "state") == {"solvers.qp", "cones", "rows"}
