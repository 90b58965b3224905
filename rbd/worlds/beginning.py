"""The beginning of a run of many worlds from its arguments: for the run itself, and for one world of it again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rbd.arrays import Array, as_array
from rbd.errors import InputError
from rbd.worlds.stepping import Servo, Worlds


def begun(given: Mapping[str, Any], threads: int | None = 1) -> Worlds:
    """The worlds at their start.

    Args:
        given: The arguments of `simulate_many`, `states` as (robot, q, v).
        threads: As there.

    Raises:
        InputError: as `simulate_many`.
    """
    settings = {name: value for name, value in given.items() if name not in ("states", "contacts", "tau", "every")}
    robot, q, v = given["states"]
    tau, servo = given["tau"], given["controller"]
    torques = None if tau is None else as_array("tau", tau)
    if torques is not None and torques.ndim == 2 and len(torques) != 1 and q.ndim == 1:
        q = np.broadcast_to(q, (len(torques), robot.nq))
    worlds = Worlds(robot, given["contacts"], q, v, threads=threads, **settings)
    if torques is not None:
        check_torques("tau", torques, worlds)
        own = np.asarray(servo.torque, float) if isinstance(servo, Servo) else np.zeros((1, robot.nu))
        worlds.drive(tau=torques + own)
    return worlds


def check_torques(what: str, tau: Array, worlds: Worlds) -> None:
    """Refuse torques of another shape, and such as are not finite in a world that goes on."""
    n, nu = worlds.n, worlds.robot.nu
    if tau.shape not in ((nu,), (1, nu), (n, nu)):
        raise InputError(f"{what} have shape {tau.shape}; expected ({n}, {nu}), one row a world.")
    table = np.atleast_2d(tau)
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    alive = worlds.stopped < 0
    bad = bad[alive[bad]] if len(table) == n else bad
    if len(bad):
        raise InputError(f"{what} are not finite in world {bad[0]}; expected numbers.")
