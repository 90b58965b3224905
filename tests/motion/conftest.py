"""Motions of G1 that several tests share, simulated once in a run."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import recorded

import rbd


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the motions of this run are kept: one place for all of its processes."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def _made(name: str, kept: Path, g1: rbd.Robot) -> rbd.Trajectory:
    path = kept / f"{name}.npz"
    if not path.exists():  # two processes may both make it: the file is replaced only when it is complete
        getattr(recorded, name)(g1).save(path)
    return rbd.Trajectory.load(path, g1)


@pytest.fixture(scope="session")
def squat(kept: Path, g1: rbd.Robot) -> rbd.Trajectory:
    """Down by 6 cm and up again."""
    return _made("squat", kept, g1)


@pytest.fixture(scope="session")
def crouch(kept: Path, g1: rbd.Robot) -> rbd.Trajectory:
    """Down by 12 cm."""
    return _made("crouch", kept, g1)


@pytest.fixture(scope="session")
def four_steps(kept: Path, g1: rbd.Robot) -> rbd.Trajectory:
    """Four steps of 0.15 m."""
    return _made("four_steps", kept, g1)


@pytest.fixture(scope="session")
def fall(kept: Path, g1: rbd.Robot) -> rbd.Trajectory:
    """Over the front edges of its soles."""
    return _made("fall", kept, g1)
