"""`Variable`: an array with the names of its dimensions and entries, its unit and what it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rbd.arrays import Array


@dataclass(frozen=True, eq=False)
class Variable:
    """A quantity that is kept, of one sample or of n.

    Attributes:
        values: Of one sample an array of the shape of `dims`; of n samples, one more axis in front.
        dims: Names of the dimensions of one sample's value; empty of a number.
        units: Unit, "" where there is none.
        long_name: What it is.
        labels: {dimension: labels of its entries}, text or numbers.
        flags: {code: its meaning}, of codes.
    """

    values: Array
    dims: tuple[str, ...] = ()
    units: str = ""
    long_name: str = ""
    labels: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    flags: Mapping[int, str] = field(default_factory=dict)

    @property
    def attributes(self) -> dict[str, Any]:
        """Its unit and what it is, as attributes of an xarray variable; of codes their meanings too, as CF has them."""
        found: dict[str, Any] = {"units": self.units, "long_name": self.long_name}
        if self.flags:
            found["flag_values"], found["flag_meanings"] = list(self.flags), " ".join(self.flags.values())
        return {name: value for name, value in found.items() if value}
