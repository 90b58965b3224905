"""The rooms of the package: what may import what, by the imports of every module, lazy ones and those of types too."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import rbd

PACKAGE = Path(__file__).parent.parent / "rbd"

ORDER = """
displayed
errors
arrays installation
modules
intervals kernels records
model problem
constraints solvers workers
robots
answers
centroid statics
robust
mechanism
control
simulation
planar
motion
audits planning worlds
envs visual testing studies
cli
__main__
"""
"""A room imports those of the lines above it, and its own modules; two rooms of a line know nothing of each other."""

LAYERS = {room: layer for layer, line in enumerate(ORDER.split("\n")) for room in line.split()}


def _modules() -> dict[str, Path]:
    """{dotted name below rbd, "" for rbd itself: file}."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = list(path.relative_to(PACKAGE).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


@cache
def parsed(module: str) -> ast.Module:
    """The syntax tree of a module; do not change it."""
    return ast.parse(MODULES[module].read_text())


def called(node: ast.Call) -> str:
    """The last part of the name of what is called, "" where it has none."""
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def imports(tree: ast.Module) -> set[str]:
    """Modules below rbd that a module imports: at the top, inside functions, for types only, or by a string."""
    found: set[str] = set()
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name.removeprefix("rbd.") in MODULES else node.module or "" for name in inner]
        elif isinstance(node, ast.Call) and called(node) in ("import_module", "__import__"):
            names = re.findall(r"rbd[.\w]*", ast.unparse(node.args[0]))
        ours = {name.removeprefix("rbd").strip(".") for name in names if name.split(".")[0] == "rbd"}
        found |= ours
    return found


def statements(tree: ast.Module) -> int:
    """How many, docstrings and imports left out."""
    texts = (node for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    left_out = sum(isinstance(node.value.value, str) for node in texts)
    kept = (isinstance(node, ast.stmt) and not isinstance(node, ast.Import | ast.ImportFrom) for node in ast.walk(tree))
    return sum(kept) - left_out


@cache
def all_imports() -> dict[str, set[str]]:
    """{module: what it imports}; read when a test asks, for a second of every process that collects."""
    return {module: imports(parsed(module)) - {module} for module in MODULES}


def room(module: str) -> str:
    """The first part of a dotted name: what has a layer."""
    return module.split(".")[0]


def test_every_module_is_in_a_room():
    """Nothing lies flat but what `ORDER` names."""
    assert {room(module) for module in MODULES} - {""} == set(LAYERS)


def test_imports_go_down():
    """A module imports from lower rooms and from its own."""
    upward = [
        f"{module} imports {other or 'rbd'}"
        for module, others in all_imports().items()
        for other in others
        if module and room(other) != room(module) and not LAYERS.get(room(other), 99) < LAYERS[room(module)]
    ]
    assert not upward


def test_no_import_goes_round_in_a_circle():
    """The imports of all modules can be put in an order; so no two files import each other."""
    try:
        TopologicalSorter({module: others for module, others in all_imports().items() if module}).prepare()
    except CycleError as error:
        pytest.fail(f"circle: {error.args[1]}")


def test_no_name_hides_a_module():
    """`import rbd.a.b` gives the module wherever there is one: nothing is named as a module beside it, or as its own."""
    hidden = []
    for module, path in MODULES.items():
        tree = parsed(module)
        own = [node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
        if module.rpartition(".")[2] in own:
            hidden.append(f"{module}.{module.rpartition('.')[2]}")
        if path.name == "__init__.py" and module:
            taken = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module != f"rbd.{module}"]
            given = {alias.asname or alias.name for node in taken for alias in node.names}
            hidden += [f"{module}.{name}" for name in given if f"{module}.{name}" in MODULES]
    assert not hidden


def test_no_module_is_longer_than_six_hundred_lines():
    """One idea a file."""
    long = {module: n for module, path in MODULES.items() if (n := len(path.read_text().splitlines())) > 600}
    assert not long


def test_only_one_file_knows_proxsuite():
    """One sign, one retry policy: `solvers/qp.py`."""
    assert _users("proxsuite") == {"solvers.qp"}


def test_only_one_file_calls_the_optimisers():
    """Each program is posed within the limits of `programs.py`; the root of one number needs none, a checker trusts no one."""
    users = {module for module, path in MODULES.items() if "scipy.optimize import" in path.read_text()}
    assert users == {"problem.programs", "mechanism.continuation", "simulation.events", "testing.solver_check"}


def test_private_kernels_are_called_by_kernels_alone():
    """They have no wrapper for Python: such a call would end the process."""
    found = []
    for module, path in MODULES.items():
        if path.stem.endswith("_kernel"):
            continue
        for node in ast.walk(parsed(module)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").endswith("_kernel"):
                found += [(module, each.name) for each in node.names if each.name.startswith("_")]
            if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
                if ast.unparse(node.value).removesuffix("()").endswith("kernel"):
                    found.append((module, node.attr))
    assert found == []


def test_kernels_that_python_calls_have_signatures():
    """`rbd warm-up` compiles these; others were compiled by the first call, in the middle of a simulation."""
    bare = {
        node.name
        for module, path in MODULES.items()
        if path.stem.endswith("_kernel")
        for node in parsed(module).body
        if isinstance(node, ast.FunctionDef) and any(ast.unparse(each) == "compiled" for each in node.decorator_list)
    }
    found = [
        (module, ast.unparse(node))
        for module, path in MODULES.items()
        if not path.stem.endswith("_kernel")
        for node in ast.walk(parsed(module))
        if isinstance(node, ast.Attribute) and node.attr in bare and "kernel" in ast.unparse(node.value)
    ]
    assert len(bare) > 50 and found == []


def test_the_algebra_knows_no_pinocchio():
    """Problems, answers and solvers are arrays; one file asks Pinocchio's ADMM, one differentiates states."""
    algebra = ("errors.", "arrays", "problem.", "solvers.", "answers.analysis.", "answers.solution")
    users = {module for module in _users("pinocchio") if f"{module}.".startswith(algebra)}
    assert users == {"solvers.pinocchio_admm", "answers.analysis.sensitivity"}


ASKS_NO_KINDS = (
    "simulation",
    "control",
    "answers.analysis",
    "answers.solution",
    "answers.least_constraint",
    "statics",
    "mechanism",
    "solvers",
    "visual",
)
"""They ask a constraint for its members and never for its type; of `robots`, what merges them and puts them on feet."""


def kinds_of_constraints() -> set[str]:
    """Names of the classes of `rbd.constraints` that have rows, and of those that gather several."""
    trees = [parsed(module) for module in MODULES if room(module) == "constraints"]
    classes = {node.name: node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
    own = {
        name for name, node in classes.items() if any(isinstance(x, ast.FunctionDef) and x.name == "rows" for x in node.body)
    }
    return own | {name for name, node in classes.items() if any(ast.unparse(base) in own for base in node.bases)}


def asked_types(tree: ast.Module) -> set[str]:
    """Names of the types that a module asks for: by isinstance, issubclass, type(...) is, a match, or a type's name."""
    found: set[str] = set()
    for node in ast.walk(tree):
        asked: list[ast.AST] = []
        if isinstance(node, ast.Call) and called(node) in ("isinstance", "issubclass"):
            asked = list(node.args[1:])
        elif isinstance(node, ast.Compare) and any(
            re.match(r"type\(|.*__class__|.*__name__", ast.unparse(x)) for x in [node.left]
        ):
            asked = list(node.comparators)
        elif isinstance(node, ast.MatchClass):
            asked = [node.cls]
        found |= {name for each in asked for name in re.findall(r"\w+", ast.unparse(each))}
    return found


def test_no_room_above_the_constraints_asks_for_their_kinds():
    """Each kind answers by a member that `rbd.constraints.constraint` names, so that a user's kind can have it too."""
    kinds = kinds_of_constraints()
    assert {"PointContact", "JointLimit", "LoopClosure", "RollingWheel", "CollisionContacts", "Stabilised"} <= kinds
    asking = (*ASKS_NO_KINDS, "robots.merge", "robots.posture", "robots.loops")
    rooms = {m for m in MODULES if f"{m}.".startswith(tuple(f"{each}." for each in asking))}
    shared = {"constraints.constraint", "constraints.contact_points", "constraints.ground_points"}
    asks = {module: asked & kinds for module in rooms | shared if (asked := asked_types(parsed(module))) & kinds}
    assert not asks


def test_the_reader_of_asked_types_sees_all_ways():
    """The test above can fail."""
    ways = ["isinstance(c, LoopClosure | A)", "issubclass(k, (JointLimit, B))", "type(c) is C", "type(c).__name__ == 'D'"]
    ways.append("match c:\n    case E(): pass")
    assert {"LoopClosure", "A", "JointLimit", "B", "C", "D", "E"} <= {
        name for way in ways for name in asked_types(ast.parse(way))
    }


def _users(library: str) -> set[str]:
    return _libraries()[library]


@cache
def _libraries() -> dict[str, set[str]]:
    """{library: modules that import it}."""
    out = defaultdict(set)
    for module in MODULES:
        for node in ast.walk(parsed(module)):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                out[name.split(".")[0]].add(module)
    return out


class TestWhatStandsOnTop:
    """Names of `rbd` are loaded when they are asked for; type checkers are told the same ones."""

    def test_type_checkers_are_told_the_same_names(self):
        """The imports for types and the table say one thing, and each name is there."""
        tree = parsed("")
        for_types = next(node for node in tree.body if isinstance(node, ast.If))
        told = {alias.name: node.module for node in for_types.body if isinstance(node, ast.ImportFrom) for alias in node.names}
        assert told == rbd._HOME | {"dynamics": "rbd.model"}
        for name in rbd.__all__:
            assert getattr(rbd, name) is not None
        assert set(rbd.__all__) == told.keys() and set(rbd.__all__) <= set(dir(rbd))

    def test_few_names_stand_on_top(self):
        """What a first script needs; the rest is in the sub-packages."""
        later = {
            "inverse_dynamics",
            "find_pose",
            "solve_many",
            "Motion",
            "check_motion",
            "audit",
            "estimate_forces",
            "plan",
            "study",
            "grid",
            "sample",
            "Bushing",
            "Carried",
            "Damper",
            "DrivenJoint",
            "Speed",
            "JointDamping",
            "JointSpring",
            "Motor",
            "RobotBuilder",
            "Spring",
            "Terrain",
            "find_equilibrium",
            "find_steady_motion",
            "identify",
            "impact",
            "linearise",
            "simulate_many",
        }
        assert len({*rbd.__all__} - later) <= 45

    def test_every_sub_package_can_be_reached(self):
        """`import rbd` is enough."""
        packages = sorted(
            module for module, path in MODULES.items() if path.name == "__init__.py" and module and "." not in module
        )
        code = f"import rbd; print(*[getattr(rbd, name).__name__ for name in {packages}])"
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert run.stdout.split() == [f"rbd.{name}" for name in packages]

    def test_what_is_not_there_is_told_so(self):
        """As of any module."""
        with pytest.raises(AttributeError, match="module 'rbd' has no attribute 'slove'"):
            rbd.slove  # noqa: B018

    def test_importing_rbd_loads_little(self):
        """Neither SciPy, viewer, plots, computer algebra, nor the command line's tools."""
        heavy = ("scipy", "proxsuite", "meshcat", "matplotlib", "sympy", "typer", "rich", "yaml")
        code = f"import sys, rbd; print(*[m for m in {heavy} if m in sys.modules])"
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert run.stdout.split() == []

    def test_the_command_line_loads_little_for_its_help(self):
        """Neither Pinocchio nor SciPy, pictures or computer algebra: what a command needs is loaded when it runs."""
        heavy = ("pinocchio", "scipy", "proxsuite", "meshcat", "matplotlib", "sympy", "yaml")
        code = f"import sys, rbd.cli.app; print(*[m for m in {heavy} if m in sys.modules])"
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert run.stdout.split() == []


def test_the_reader_of_imports_sees_lazy_ones_types_and_strings():
    """The tests above can fail."""
    source = """
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from rbd.robots.robot import Robot
def late():
    from rbd.solvers import qp
    import_module(f"rbd.{planar}")
def plot():
    from rbd.simulation import trajectory
import rbd.problem.cones
import numpy
"""
    assert imports(ast.parse(source)) == {"robots.robot", "solvers.qp", "", "simulation.trajectory", "problem.cones"}


class TestBudget:
    """What each room may hold: neither packing lines nor splitting files helps."""

    def test_no_room_has_more_statements_than_its_budget(self):
        """Nor much less: a room that became smaller keeps no reserve. `tests/budget.txt` says how a number is raised."""
        lines = Path(__file__).with_name("budget.txt").read_text().split("\n\n")[1].splitlines()
        budget = {name: int(number) for name, number in map(str.split, lines)}
        held = dict.fromkeys(budget, 0)
        for module, path in MODULES.items():
            inside = path.name == "__init__.py" and module or "." in module
            held[room(module) if inside else "flat"] += statements(parsed(module))
        assert {name: n for name, n in held.items() if n > budget[name]} == {}
        assert {name: n for name, n in held.items() if n < 0.98 * budget[name] - 10} == {}
