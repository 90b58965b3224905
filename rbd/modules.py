"""Modules and names of a package, loaded on first use: `rbd.robots.catalogue` after `import rbd`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.resources import files
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from rbd.errors import InputError
from rbd.installation import without_system_library


def submodule(package: str, name: str) -> ModuleType:
    """The module `name` of a package, imported; for a package's `__getattr__`.

    Raises:
        AttributeError: there is none; of a name that a package inside this one has, its place is told.
    """
    full = f"{package}.{name}"
    if name.startswith("__") or find_spec(full) is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}{_elsewhere(package, name)}")
    return _imported(full)


def _elsewhere(package: str, name: str) -> str:
    """Where packages inside this one list the name in `__all__`, for a message; empty if none does."""
    found = list[str]()
    if name.startswith("_"):
        return ""
    for room in sorted(files(package).iterdir(), key=lambda path: path.name):
        top = room.joinpath("__init__.py")
        if top.is_file() and f'    "{name}",\n' in top.read_text(encoding="utf-8"):
            found.append(f"{package}.{room.name}.{name}")
    return f"; there is {' and '.join(found)}" if found else ""


def _imported(name: str) -> ModuleType:
    """A module; where a library of the system is missing, the error says which, and how it is installed."""
    try:
        return import_module(name)
    except ImportError as error:
        if (explained := without_system_library(error)) is None:
            raise
        raise explained from error


def named(package: str, homes: Mapping[str, str], name: str) -> object:
    """A name of a package, from the module that defines it; else the package's module of this name.

    Args:
        package: The package.
        homes: {name: the module that defines it}.
        name: The requested name.

    Raises:
        AttributeError: there is neither.
    """
    if name not in homes:
        return submodule(package, name)
    return getattr(_imported(homes[name]), name)


def xarray_or_error() -> Any:
    """The module xarray.

    Raises:
        InputError: if it is not installed; names the extra.
    """
    return of_extra("xarray", "study")


def of_extra(name: str, extra: str) -> Any:
    """A module that an extra installs; errors as `xarray_or_error`."""
    try:
        return import_module(name)
    except ImportError as error:
        told = f"Install the extra: pip install 'rbd-contact[{extra}]'"
        raise InputError(f"{name} is not installed here, and this needs it. {told}") from error
