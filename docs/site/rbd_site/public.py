"""The public names of the package: where each is documented, and in which file it is written."""

from __future__ import annotations

import importlib
import inspect
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType

import rbd

PACKAGES = tuple(
    f"rbd.{name}"
    for name in (
        *("dynamics", "constraints", "constraints.forces", "problem", "solvers", "answers.analysis", "answers.many"),
        *("robots", "model", "statics", "robust", "centroid", "control", "mechanism", "mechanism.small_motion", "simulation"),
        *("planning", "worlds", "audits", "audits.bench", "motion", "motion.identification", "studies", "planar", "visual"),
        *("envs", "testing", "errors"),
    )
)
"""Sub-packages and modules that users import from, besides `rbd` itself."""
GROUPS = {
    "Robots and states": """
        load_robot Robot RobotBuilder Motor Carried doctor State find_pose register_constraint dynamics ExternalForce
    """,
    "Springs and dampers": "Spring Damper Bushing JointSpring JointDamping",
    "Motion and forces of one instant": "solve Solution gauss_problem solve_problem GaussProblem Rows solve_many",
    "Solvers": "KKT ProxQP ConeSolver",
    "Contacts": "PointContact LineContact SurfaceContact CollisionContacts Ground Terrain Speed Body",
    "Joints, loops and rolling": """
        LoopClosure DrivenJoint JointLimit JointLock JointCoupling JointFriction KnifeEdge RollingBall RollingDisk RollingWheel
        VelocityConstraint FunctionConstraint
    """,
    "Torques": "hold inverse_dynamics Actuation",
    "Small motion": "linearise find_equilibrium find_steady_motion",
    "Simulation": "simulate simulate_many Trajectory TimeStepping RungeKutta4 DormandPrince8 impact",
    "Motions": "Motion check_motion estimate_forces identify plan audit",
    "Studies": "study grid sample",
    "Errors": "RbdError InputError NoSolution CannotHold CannotMove",
}
"""The names on top, in the order in which one meets them; every name is in one group."""


@dataclass(frozen=True)
class Public:
    """A public name.

    Attributes:
        name: As users write it, e.g. `rbd.statics.zmp`.
        value: What it is.
    """

    name: str
    value: object

    @property
    def kind(self) -> str:
        """Which directive of Sphinx documents it."""
        if isinstance(self.value, ModuleType):
            return "module"
        if inspect.isclass(self.value):
            return "exception" if issubclass(self.value, BaseException) else "class"
        return "function" if callable(self.value) else "data"

    @property
    def first_line(self) -> str:
        """The first line of its docstring."""
        if self.kind == "data":
            return "A constant."
        return (inspect.getdoc(self.value) or "").split("\n", 1)[0]


def module_of(package: str) -> ModuleType:
    """The module behind a package's name; `rbd.dynamics` is `rbd.model.dynamics`."""
    return importlib.import_module("rbd.model.dynamics" if package == "rbd.dynamics" else package)


@cache
def names_of(package: str) -> dict[str, Public]:
    """{short name: public name} of a package; of a module without `__all__`, the functions and classes written there."""
    module = module_of(package)
    short = getattr(module, "__all__", None)
    if short is None:
        written_here = [n for n, value in vars(module).items() if getattr(value, "__module__", None) == module.__name__]
        short = [n for n in written_here if not n.startswith("_") and not getattr(vars(module)[n], "_is_protocol", False)]
    return {name: Public(f"{package}.{name}", getattr(module, name)) for name in short}


@cache
def homes() -> dict[str, str]:
    """{any public dotted name: the one under which it is documented}; a name on top of `rbd` is documented there."""
    found: dict[str, str] = {}
    first: dict[int, str] = {}
    for package in ("rbd", *PACKAGES):
        for public in names_of(package).values():
            unique = public.kind not in ("module", "data")
            found[public.name] = first.setdefault(id(public.value), public.name) if unique else public.name
    return found


@cache
def short_names() -> dict[str, str]:
    """{class name: documented name} of the classes that only one public name has: `State` is `rbd.State`."""
    seen: dict[str, set[str]] = {}
    for home in set(homes().values()):
        seen.setdefault(home.rsplit(".", 1)[1], set()).add(home)
    return {name: homes.pop() for name, homes in seen.items() if len(homes) == 1 and name[0].isupper() and len(name) > 3}


@cache
def place_of(dotted: str) -> tuple[Path, str | None] | None:
    """(file, name in it) in which `rbd.some.name` is written, or None if it is a value and not code."""
    try:
        value: object = rbd
        for i, part in enumerate(dotted.split(".")[1:], start=2):
            if inspect.ismodule(value) and not hasattr(value, part):
                value = importlib.import_module(".".join(dotted.split(".")[:i]))
            else:
                value = getattr(value, part)
        if isinstance(value, property):
            value = value.fget
        value = inspect.unwrap(getattr(value, "compute", value))  # type: ignore[arg-type]
        file = _file_of(value)
    except (AttributeError, ImportError, TypeError):
        return None
    return (file, getattr(value, "__qualname__", None)) if file else None


def _file_of(value: object) -> Path | None:
    """The file in which it is written; of a class that names its package as its module, as errors do, a file beside it."""
    named = inspect.getsourcefile(value)  # type: ignore[arg-type]
    if not named or not inspect.isclass(value):
        return Path(named) if named else None
    written = re.compile(rf"^class {value.__name__}\b", re.MULTILINE)
    beside = sorted(Path(named).parent.glob("*.py")) if Path(named).name == "__init__.py" else []
    return next((file for file in beside if written.search(file.read_text(encoding="utf-8"))), Path(named))
