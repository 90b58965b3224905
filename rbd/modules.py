"""Modules of a package, loaded when they are asked for: `rbd.robots.catalogue` after `import rbd`."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType


def submodule(package: str, name: str) -> ModuleType:
    """The module `name` of a package, imported; for a package's `__getattr__`.

    Raises:
        AttributeError: there is none.
    """
    full = f"{package}.{name}"
    if name.startswith("__") or find_spec(full) is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    return import_module(full)
