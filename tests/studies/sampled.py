"""Samples of many kinds, whose digests are compared between processes."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from scipy import stats

import rbd
from rbd.studies import Samples


def size(values: list[float], power: int = 2) -> float:
    """A function, as a value of an argument."""
    return float(sum(values) ** power)


def made() -> list[Samples]:
    """Objects, distributions, sets, functions, paths."""
    box = rbd.testing.box(mass=10.0)
    state = rbd.State(box, np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
    contacts = {name: rbd.PointContact("toe", "box", friction=mu) for name, mu in (("ice", 0.3), ("rubber", 0.6))}
    how = [size, np.sin, partial(size, power=3)]
    return [
        rbd.grid(robot=box, contact=contacts, law=[rbd.KKT(), rbd.ProxQP()], a=[0.1, np.nan]),
        rbd.sample(50, a=(0.0, 1.0), b=stats.norm(1.0, 0.1), c=["x", "y"], seed=4),
        rbd.grid(name=[{"b", "a", "c"}, {1: 2.0}], state=state, how=how, where=Path("a")),
    ]
