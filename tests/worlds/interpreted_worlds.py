"""Run with RBD_COMPILED=0: worlds as their kernels are written, and with faults planted in one lane; prints JSON."""

from __future__ import annotations

import json
import sys
import warnings

from drawn_worlds import drawn

import rbd
from rbd.worlds import Worlds, advance_kernel

STEPS = 3


def begun() -> Worlds:
    """Three legs: one standing, two kicked."""
    robot, contacts, q, v, tau, mu = drawn("leg", 3, 1)
    v[0] = 0.0
    worlds = Worlds(robot, contacts, q, v, step=2e-3, friction=mu)
    worlds.drive(tau=tau)
    return worlds


def alone(worlds: Worlds, world: int) -> tuple[list[float], list[float]]:
    """(q, v) of a world by the scalar form, whose arrays have no last dimension."""
    one = worlds.only(world)
    space, whole = one._spaces[0]
    given = {name: x[:, :, 0].copy() for name, x in one._given.items()}
    parts = [x[:, :, 0].copy() for x in (one._q, one._v, one._before, one._impulse, one._told)]
    advance_kernel.advance_alone(
        *one.packed.tree, *one.touching.sites, *one.touching.ground, one._push_bodies,
        given["inertia"], given["checked"], given["joint"], given["world"], given["friction"], given["push"],
        *parts, space[:, 0].copy(), whole, 1, 0, STEPS, 0.0, one.step, one.coulomb,
    )  # fmt: skip
    return parts[0][0].tolist(), parts[1][0].tolist()


def main() -> None:
    """Print what there is."""
    worlds = begun()
    scalar = [alone(worlds, i) for i in range(3)]
    worlds.advance(STEPS)
    out = {"q": worlds.q.tolist(), "v": worlds.v.tolist(), "residual": worlds.residual.tolist(), "alone": scalar}
    solved, lanes = advance_kernel.solved, [1]

    def stopped_early(sites, active, count, starts, rows, coulomb, fresh, law, *more):
        steps = solved(sites, active, count, starts, rows, coulomb, fresh, law, *more)
        law.best[:, lanes] *= 1.0 + 1e-6
        return steps

    advance_kernel.solved = stopped_early
    faulty = begun()
    faulty.advance(STEPS)
    out["early"] = faulty.residual.tolist()
    lanes[:] = range(8)
    warnings.simplefilter("ignore")
    robot, contacts, q, v, tau, mu = drawn("leg", 3, 1)
    run = rbd.simulate_many((robot, q, v), contacts, duration=STEPS * 2e-3, step=2e-3, tau=tau, friction=mu)
    out["flagged"], out["law"] = run.flagged.tolist(), float(run.certify(1).law.max())
    json.dump(out, sys.stdout)


if __name__ == "__main__":
    main()
