"""The push study of Talos: whether it can be held, over friction and a push to its left; imported by workers too."""

from __future__ import annotations

import os
import time
from functools import cache
from pathlib import Path

import numpy as np
import xarray

import rbd

FRAME = "torso_2_link"
SAMPLES = rbd.grid(friction=np.linspace(0.1, 1.0, 7), push_y=np.linspace(0.0, 200.0, 9))


@cache
def state() -> rbd.State:
    """Talos on its feet; built once in a process."""
    return rbd.load_robot("talos").standing()


def held(friction: float, push_y: float) -> rbd.Actuation:
    """The torques that withstand the push; takes longer where a test wants to come in between."""
    time.sleep(float(os.environ.get("PAUSE", "0")))
    at = state()
    soles = at.robot.soles(friction=friction)
    return rbd.hold(at, soles, external=rbd.ExternalForce(FRAME, (0.0, push_y, 0.0)))


def run(out: str | Path | None = None, executor: object = 0) -> xarray.Dataset:
    """The study, two samples in a chunk."""
    return rbd.study(held, SAMPLES, out=out, executor=executor, chunk=2, seed=3, progress=False)
