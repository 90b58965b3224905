"""Check that Python imports the Pinocchio that pip installed; and whether loops are compiled, by Numba.

ROS puts its own on PYTHONPATH, where it hides pip's, and PyPI's `pinocchio` is an unrelated plugin of nose.

Numba is imported by `rbd.kernels` after some answers, not with `rbd`.
"""

from __future__ import annotations

import os
import re
from functools import lru_cache

from rbd.errors import WrongPinocchio

VERSION = "0.1.0"
"""Of `rbd`; the build reads it here."""
OLDEST = (4, 1)
REMEDY = (
    "Try: unset PYTHONPATH, or a terminal that did not source ROS's setup; pip uninstall pinocchio; "
    "pip install --force-reinstall 'pin>=4.1'"
)


def check(module: object) -> None:
    """Refuse a module that is not Pinocchio 4.1 or later, or that is ROS's.

    Raises:
        WrongPinocchio: what was found, where, and what to do.
    """
    where = str(getattr(module, "__file__", None) or list(getattr(module, "__path__", ["nowhere"]))[0])
    if not hasattr(module, "Model"):
        raise WrongPinocchio(
            f"'import pinocchio' finds {where}, which knows no robots: PyPI's package of that name, or a folder of yours. "
            + REMEDY
        )
    version = str(getattr(module, "__version__", "0"))
    words = version.split(".")[:2]
    old = not all(word.isdigit() for word in words) or tuple(map(int, words)) < OLDEST
    if old or where.startswith("/opt/ros"):
        raise WrongPinocchio(
            f"'import pinocchio' finds version {version} at {where}{_by_path(where)}; rbd needs pip's, "
            f"{OLDEST[0]}.{OLDEST[1]} or later. {REMEDY}"
        )


def _by_path(where: str) -> str:
    folders = [folder for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep) if folder]
    return ", by PYTHONPATH" if any(where.startswith(folder) for folder in folders) else ""


def _found() -> object:
    try:
        import pinocchio
    except Exception as error:
        # A ModuleNotFoundError of `pinocchio` itself; else one that was made for another Python, or another package.
        import importlib.util

        found = importlib.util.find_spec("pinocchio")
        if found is None:
            raise WrongPinocchio("Pinocchio is not installed here. Try: pip install 'pin>=4.1'") from error
        where = found.origin or "a folder without code"
        raise WrongPinocchio(
            f"'import pinocchio' finds {where}{_by_path(where)}, which cannot be imported: {type(error).__name__}: {error}. "
            + REMEDY
        ) from error
    return pinocchio


def without_system_library(error: ImportError) -> WrongPinocchio | None:
    """The error that names the library of the system which a wheel needs and this machine has not; None if it is not that."""
    found = re.match(r"(lib[\w+.-]+): cannot open shared object file", str(error))
    if found is None:
        return None
    library = found[1]
    gomp = library.startswith("libgomp")
    package = "libgomp1 (Debian, Ubuntu) or libgomp (Fedora)" if gomp else f"the package that has {library}"
    return WrongPinocchio(f"Pinocchio, or what it uses, needs {library}, which this system has not. Try: install {package}")


def check_place() -> None:
    """Refuse another Pinocchio than pip's without importing it: pip's is in a separate folder, `cmeel.prefix`.

    Raises:
        WrongPinocchio: as `check`; a Pinocchio elsewhere is imported and checked.
    """
    import importlib.util

    found = importlib.util.find_spec("pinocchio")
    if found is None or "cmeel.prefix" not in (found.origin or ""):
        check_whole()


def check_whole() -> None:
    """Import Pinocchio, and refuse a wrong one; errors as `check`."""
    check(_found())


@lru_cache(maxsize=1)
def in_use() -> bool:
    """Whether functions in loops are compiled; else they take some hundred times as long."""
    return os.environ.get("RBD_COMPILED") != "0" and os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
