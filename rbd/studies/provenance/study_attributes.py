"""What a study is of, and what computed it: its attributes, and whether a store belongs to the same study."""

from __future__ import annotations

import os
import platform
import shlex
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.installation import VERSION as VERSION_OF_RBD, in_use
from rbd.studies.dataset import LAYOUT
from rbd.studies.outputs.fields import storable
from rbd.studies.outputs.output_selection import Keep, OutputSelection
from rbd.studies.provenance.identity import function_hash, name_of
from rbd.studies.sampling.samples import Samples

FORMAT = "rbd study"
VERSION = 1
"""Version of the layout of stores; a store of a newer one is refused."""
PACKAGES = ("pin", "numpy", "scipy", "proxsuite", "clarabel", "daqp", "numba")
"""Packages on which the bits of results can depend."""
SAME = ("function", "function_sha256", "samples_sha256", "seed", "keep", "batched")
"""Attributes that do not differ between the parts of a study."""


def attributes_of(
    function: Callable[..., Any],
    samples: Samples,
    *,
    keep: Keep,
    seed: int,
    batched: bool,
    stored: bool,
) -> dict[str, Any]:
    """What a study is of, and what computes it, as text and numbers that zarr and netCDF can write.

    Args:
        function: What is computed.
        samples: At which samples.
        keep: What is kept of results.
        seed: Root of the seeds.
        batched: Whether the function takes arrays over samples.
        stored: Whether there is a store, which must know its function again.

    Raises:
        InputError: a function of a stored study that uses what cannot be counted; names it.
    """
    name, now = name_of(function), _now()
    return {
        "title": f"{name} at {len(samples):,} samples",
        "format": f"{FORMAT} {VERSION}",
        "function": name,
        "function_sha256": _identity(function, stored),
        "samples": " x ".join(f"{n:,} {dim}" for dim, n in samples.dims.items()) or "1",
        "samples_sha256": samples.digest(),
        "seed": seed if abs(seed) < 2**31 else str(seed),
        "keep": kept_as_text(keep, stored=stored),
        "batched": "yes" if batched else "no",
        "versions": versions(),
        "machine": machine(),
        "command": storable(shlex.join(sys.argv)) or "python",
        "started": now,
        "finished": now,
    }


def _identity(function: Callable[..., Any], stored: bool) -> str:
    """The hash of a function; of a study without a store that uses what cannot be counted, what that is."""
    try:
        return function_hash(function)
    except InputError as error:
        if stored:
            raise
        return f"cannot be counted: {error}"


def kept_as_text(keep: Keep, *, stored: bool = True) -> str:
    """What is kept: names, each function with its hash; "default" where nothing is said."""
    found = OutputSelection(keep)
    names = ("default",) if found.names is None else found.names
    return ", ".join((*names, *(f"{name} by {name_of(f)} {_identity(f, stored)[:16]}" for name, f in found.functions.items())))


def versions() -> str:
    """Python and the packages on which results depend, each with its version; and whether arithmetic is compiled."""
    return f"{_packages()}, {'compiled' if in_use() else 'not compiled'} arithmetic"


@cache
def _packages() -> str:
    """Python and the packages, each with its version."""
    found = [f"rbd {VERSION_OF_RBD}", f"python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


@cache
def machine() -> str:
    """System, processor, number of cores, and NumPy's BLAS."""
    blas = np.show_config(mode="dicts").get("Build Dependencies", {}).get("blas", {})
    told = f"BLAS {blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
    return f"{platform.system()} {platform.machine()}, {_processor()}, {os.cpu_count()} cores, {told}"


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            return next(
                (line.partition(":")[2].strip() for line in file if line.startswith("model name")), platform.processor()
            )
    except OSError:
        return platform.processor()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def check_same(old: Mapping[str, Any], new: Mapping[str, Any], path: str) -> None:
    """Refuse to go on with a store of another study.

    Args:
        old: Attributes of the store.
        new: Attributes of this study.
        path: The store, as the user wrote it.

    Raises:
        InputError: names what differs, and what can be done.
    """
    differing = [name for name in SAME if old.get(name) != new[name]]
    if not differing:
        return
    texts = {
        "function": f"the function is {new['function']}, and was {old.get('function')}",
        "function_sha256": f"{new['function']} has changed: its source, a function of its module that it calls, or a value "
        "that it uses, as they are when the study starts",
        "samples_sha256": f"the samples are others ({new['samples']}; the store has {old.get('samples')})",
        "seed": f"seed is {new['seed']}, and was {old.get('seed')}",
        "keep": f"keep is {new['keep']!r:.200}, and was {old.get('keep')!r:.200}",
        "batched": f"batched is {new['batched']!r}, and was {old.get('batched')!r}",
    }
    if "function" in differing and "function_sha256" in differing:
        differing.remove("function_sha256")
    told = "; ".join(texts[name] for name in differing)
    raise InputError(
        f"{path!r:.200} is the store of another study: {told}. Give another path as out=, delete this one, or read it as it is "
        f"by rbd.studies.open_study({path!r:.200})."
    )


def continued(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes of a study that goes on: begun then, finished now; of versions, machines and commands all that took part."""
    found = {**new, "started": old.get("started", new["started"])}
    for name in ("versions", "machine", "command"):
        parts = str(old.get(name, new[name])).split("; then ")
        found[name] = "; then ".join(parts if new[name] in parts else [*parts, new[name]])
    return found


def finished(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """The attributes with the time that it is now."""
    return {**attributes, "finished": _now()}


def others_of(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """A sentence on versions that computed a part of a study and are not those here; empty where they are the same."""
    before = set(str(old.get("versions", "")).replace("; then ", ", ").split(", ")) - {""}
    here = set(str(new["versions"]).split(", "))
    if before <= here:
        return ""
    return f"A part was computed with {', '.join(sorted(before - here))}, and the rest with {', '.join(sorted(here - before))}."


def format_of(attributes: Mapping[str, Any], path: str) -> None:
    """Refuse what is no study, of a newer `rbd`, or no store but a dataset that was written by xarray.

    Raises:
        InputError: says which.
    """
    text = str(attributes.get("format", ""))
    name, _, number = text.rpartition(" ")
    if name != FORMAT or not number.isdigit():
        raise InputError(f"{path!r:.200} is not the store of a study. Give another path as out=, or move it away.")
    if int(number) > VERSION:
        raise InputError(
            f"{path!r:.200} was written by a newer rbd (layout {number}; this one reads {VERSION}). Update rbd, or give "
            "another path."
        )
    if LAYOUT not in attributes:
        opener = "open_dataset" if path.endswith(".nc") else "open_zarr"
        raise InputError(
            f"{path!r:.200} is the dataset of a study, written by xarray (to_netcdf, to_zarr), and no store that rbd.study "
            f"wrote as out=. Read it by xarray.{opener}({path!r:.200}); as out= give another path."
        )
