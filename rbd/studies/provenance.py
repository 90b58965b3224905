"""What a study is of, and what computed it: its attributes, and whether a store belongs to the same study."""

from __future__ import annotations

import json
import os
import platform
import shlex
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from rbd.errors import InputError
from rbd.installation import VERSION as VERSION_OF_RBD, in_use
from rbd.model.content_hash import digest, name_of
from rbd.records import joined

FORMAT, VERSION = "rbd study", 2
"""What a store is, and the version of its layout; a store of another one is refused."""
PACKAGES = ("pin", "numpy", "scipy", "proxsuite", "clarabel", "daqp", "numba")
"""Packages on which the bits of results can depend."""
MOST_TOLD = 3
"""Arguments in a message."""
SAME = ("function", "function_sha256", "samples_sha256", "seed", "keep", "batched")
"""Attributes that do not differ between the parts of a study."""


def attributes_of(
    function: Callable[..., Any], samples: Any, keep: tuple[str, Mapping[str, Any]], seed: int, batched: bool, *, stored: bool
) -> dict[str, Any]:
    """What a study is of, and what computes it, as text and numbers that zarr and netCDF can write.

    Args:
        function: What is computed.
        samples: At which samples.
        keep: What is kept of results: names as text, and functions by name.
        seed: Root of the seeds.
        batched: Whether the function takes arrays over samples.
        stored: Whether there is a store, which must know its function again.

    Raises:
        InputError: a function of a stored study that uses what cannot be counted; names it.
    """
    kept = [f"{name} by {name_of(f)} {_identity(f, stored)[:16]}" for name, f in keep[1].items()]
    return {
        "title": f"{name_of(function)} at {len(samples):,} samples",
        "format": f"{FORMAT} {VERSION}",
        "function": name_of(function),
        "function_sha256": _identity(function, stored),
        "arguments": _arguments(function),
        "samples": " x ".join(f"{n:,} {dim}" for dim, n in samples.dims.items()) or "1",
        "samples_sha256": samples.digest(),
        "seed": seed if abs(seed) < 2**31 else str(seed),
        "keep": ", ".join(filter(None, (keep[0], *kept))),
        "batched": "yes" if batched else "no",
        "versions": versions(),
        "machine": f"{platform.system()} {platform.machine()}, {_processor()}, {os.cpu_count()} cores",
        "command": storable(shlex.join(sys.argv)) or "python",
        "started": now(),
        "finished": now(),
    }


def _identity(function: Callable[..., Any], stored: bool) -> str:
    """The hash of a function; of a study without a store that uses what cannot be counted, what that is."""
    try:
        return digest(function)
    except InputError as error:
        if stored:
            raise
        return f"cannot be counted: {error}"


def _arguments(function: Callable[..., Any]) -> str:
    """{name: what it is} of the arguments that a `functools.partial` has already, as JSON; those of mappings one by one."""
    found, left = dict[str, str](), list(getattr(function, "keywords", {}).items())
    while left:
        name, value = left.pop()
        if isinstance(value, Mapping):
            left += [(f"{name}.{key}", each) for key, each in value.items()]
        else:
            found[name] = f"{value!r:.200}"
    return json.dumps(found)


def storable(text: str) -> str:
    """Text that zarr and netCDF can store: what UTF-8 has not (parts of file names in other codes), and NUL, as escapes."""
    if text.isascii() and "\0" not in text:
        return text
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")


def versions() -> str:
    """Python and the packages on which results depend, each with its version; and whether arithmetic is compiled."""
    packages = "".join(f", {package} {version(package)}" for package in PACKAGES)
    compiled = "compiled" if in_use() else "not compiled"
    return f"rbd {VERSION_OF_RBD}, python {platform.python_version()}{packages}, {compiled} arithmetic"


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            return next(line.partition(":")[2].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()


def now() -> str:
    """The time, as text."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def continued(old: Mapping[str, Any], new: Mapping[str, Any], path: str) -> dict[str, Any]:
    """Attributes of a study that goes on: begun then; of versions, machines and commands all that took part.

    Args:
        old: Attributes of the store.
        new: Attributes of this study.
        path: The store, as the user wrote it.

    Raises:
        InputError: the store is of another study; names what differs, and what can be done.
    """
    texts = {
        "function": f"the function is {new['function']}, and was {old.get('function')}",
        "function_sha256": f"{new['function']} has changed: its source, a function of its module that it calls, or a value "
        "that it uses, as they are when the study starts",
        "samples_sha256": f"the samples are others ({new.get('samples')}; the store has {old.get('samples')})",
    }
    was, given = (json.loads(each.get("arguments", "{}")) for each in (old, new))
    none = "not given"
    names = [name for name in sorted({*was, *given}) if was.get(name) != given.get(name)]
    if names:
        changed = (f"{name} is {given.get(name, none)} and was {was.get(name, none)}" for name in names)
        texts["function_sha256"] = joined(changed, MOST_TOLD)
    differing = [name for name in SAME if old.get(name) != new[name]]
    if differing:
        told = [texts.get(name) or f"{name} is {new[name]!r:.200}, and was {old.get(name)!r:.200}" for name in differing]
        raise InputError(
            f"{path!r:.200} is the store of another study: {'; '.join(told)}. Give another path as out=, delete this one, or "
            f"read it as it is by rbd.studies.open_study({path!r:.200})."
        )
    found = {**new, "started": old.get("started", new["started"])}
    for name in ("versions", "machine", "command"):
        parts = str(old.get(name, new[name])).split("; then ")
        found[name] = "; then ".join(parts if new[name] in parts else [*parts, new[name]])
    return found


def check_format(attributes: Mapping[str, Any], path: str) -> None:
    """Refuse what is no study, or of another version of `rbd`.

    Raises:
        InputError: says which.
    """
    name, _, number = str(attributes.get("format", "")).rpartition(" ")
    if name != FORMAT:
        raise InputError(f"{path!r:.200} is not the store of a study. Give another path as out=, or move it away.")
    if number != str(VERSION):
        raise InputError(
            f"{path!r:.200} was written by another version of rbd (layout {number}; this one reads {VERSION}). "
            "xarray.open_zarr reads the values of a finished study; give another path as out=."
        )
