"""Small models that the tests of motion share; do not change them."""

from __future__ import annotations

from pathlib import Path

import pytest

import rbd

URDF = Path(__file__).parents[2] / "urdf"


@pytest.fixture(scope="session")
def brick() -> rbd.Robot:
    """The box of 10 kg, 0.4 x 0.4 x 0.2 m, its frame "box" at its centre."""
    return rbd.load_robot(URDF / "box.urdf")


@pytest.fixture(scope="session")
def crate() -> rbd.Robot:
    """The crate of 20 kg, 0.4 x 0.4 x 1 m, its frame "crate" at its centre."""
    return rbd.load_robot(URDF / "crate.urdf")
