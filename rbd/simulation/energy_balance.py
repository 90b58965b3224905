"""The balance of energy of a motion, and which steps are too long for it, in words.

    T + V + E + D - W_m - W_o = its value at the start

with kinetic and potential energy, energy E in springs, and the work that dampers have taken, motors and all others have done:
each the sum over the steps of force times mean velocity. Exactly integrated it is constant; its change is energy that the steps
make or lose.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.model.dynamics import kinetic_energy, potential_energy
from rbd.model.inertial import body_names
from rbd.model.state import State
from rbd.simulation.motion import Integrator, Motion, Sample, stored
from rbd.simulation.stiffness import element_rate
from rbd.simulation.trajectory_fields import ENERGY, Fields

LARGEST = 1e-3
"""Largest change of the balance, over the largest kinetic energy so far, that needs no warning."""
STILL = 1e-9
"""Changes up to this, over the work of the weight along the robot's size, are tolerances of contacts and rounding."""
BEGINS = 1e-4
"""A kinetic energy below this, over the weight times a metre, counts as this: a robot that begins to move has hardly any."""
FAST = 0.1
"""Steps of this over the fastest rate of a motion are short."""
_WEIGHS = 10.0
"""Weight of a kilogram, times a metre [J/kg]."""


def energy(motion: Motion, state: State) -> float:
    """Kinetic and potential energy, and that in known force elements [J]; a function of time has no known ones."""
    elastic = 0.0 if callable(motion.external) else stored(motion.elements, state)
    return kinetic_energy(state) + potential_energy(state) + elastic


def balance(motion: Motion, sample: Sample, kinetic: float, potential: float) -> float:
    """The left-hand side at a sample [J]; NaN where an integrator does not tell all work."""
    inside = 0.0 if callable(motion.external) else sample.elastic + sample.dissipated
    return kinetic + potential + inside - sample.motor_work - sample.other_work


def unbalanced(x: Fields, by: Integrator) -> str:
    """Message: by how much the steps of a motion have changed its energy, and which steps would do; empty if by little.

    Args:
        x: The trajectory's fields.
        by: Its integrator; one that chooses its steps has no `order`.
    """
    order = getattr(by, "order", None)
    change, largest = x["residuals"][ENERGY.name], np.maximum.accumulate(x["kinetic"])
    at_work = np.abs([x[name] for name in ("elastic", "dissipated", "motor_work")]).max() + np.ptp(x["potential"])
    weighs = _WEIGHS * x["robot"].mass
    above = np.flatnonzero(np.abs(change) > LARGEST * np.maximum(largest, BEGINS * weighs) + STILL * (at_work + weighs))
    if not len(above):
        return ""
    first, share = int(above[0]), np.abs(change) / np.maximum(largest, 1e-300)
    worst = int(above[np.argmax(share[above])])
    made = "make" if change[worst] > 0.0 else "lose"
    said = (
        f"the steps of {x['robot'].name} {made} energy: residual 'energy' passes {100.0 * LARGEST:g} % of the largest kinetic "
        f"energy so far at t = {x['t'][first]:.6g} s, and is {change[worst]:.3g} J at t = {x['t'][worst]:.6g} s, "
        f"{100.0 * share[worst]:.3g} % of {largest[worst]:.3g} J. `trajectory.residuals['energy']` has all of it. "
    )
    if order is None:
        return said + "Give the integrator a smaller tolerance."
    h, (rate, what) = x["step"], _fastest(x, [max(first - 1, 0), first], damped=not getattr(by, "implicit", False))
    shorter = 0.8 * h * (LARGEST / min(float(share[worst]), 1.0)) ** (1.0 / order)
    if rate * h > FAST:
        shorter = min(shorter, FAST / rate)
    fast = f"Fastest there is {what}, {rate:.3g} per second; times the step that is {h * rate:.2g}. " if rate else ""
    return f"{said}{fast}Give a shorter step, by the order of the integrator about {shorter:.2g} s."


def _fastest(x: Fields, samples: Sequence[int], *, damped: bool) -> tuple[float, str]:
    """(the largest rate at some samples [1/s], what has it): the turn of a body, or oscillation on force elements.

    Their decay too, if `damped`: to implicit steps that makes no difference.
    """
    robot, found = x["robot"], [(0.0, "nothing")]
    names, data = body_names(robot), robot.model.createData()
    for i in samples:
        pin.forwardKinematics(robot.model, data, x["q"][i], x["v"][i])
        turns = [float(np.linalg.norm(data.v[j].angular)) for j in range(1, robot.model.njoints)]
        found += [(turn, f"the turn of {name!r:.80}") for name, turn in zip(names, turns, strict=True)]
        if x["elements"]:
            rate = element_rate(State(robot, x["q"][i], x["v"][i]), x["elements"], damped=damped)
            found.append((rate, "the motion on force elements"))
    return max(found)
