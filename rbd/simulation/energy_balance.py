"""The balance of energy of a motion, and which steps are too long for it or for its force elements, in words.

    T + V + E + D - W_m - W_o = its value at the start

with kinetic and potential energy, energy E in springs, and the work that dampers have taken, motors and all others have done:
each the sum over the steps of force times mean velocity. Exactly integrated it is constant; its change is energy that the steps
make or lose.

With M x'' + D x' + K x = 0 of the elements, every rate s satisfies |s|^2 <= |D| |s| + |K|, with the largest eigenvalues of
L^-1 D L^-T and L^-1 K L^-T on the directions that the constraints leave, where M = L L^T. So s is at most

    (|D| + sqrt(|D|^2 + 4 |K|)) / 2.

Kutta's method errs by 0.3 % of the speed in a step of h s = 0.8, by 0.7 % at 1, and is unstable beyond 2.8.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_triangular

from rbd.arrays import Array, inertia_factor
from rbd.constraints.constraint import Constraint, rows_of
from rbd.model.dynamics import kinetic_energy, potential_energy
from rbd.model.external import ForceElement, elements_of
from rbd.model.inertial import body_names
from rbd.model.state import State
from rbd.records import joined
from rbd.simulation.implicit_forces import ElementTerms
from rbd.simulation.simulated_motion import Integrator, SimulatedMotion, stored
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


def energy(motion: SimulatedMotion, state: State) -> float:
    """Kinetic and potential energy, and that in known force elements [J]; a function of time has no known ones."""
    elastic = 0.0 if callable(motion.external) else stored(motion.elements, state)
    return kinetic_energy(state) + potential_energy(state) + elastic


def balance(motion: SimulatedMotion, x: Fields, other_work: Array) -> Array:
    """The left-hand side at each sample [J], shape (n,); NaN where an integrator does not tell all work.

    Args:
        motion: The motion.
        x: The trajectory's fields.
        other_work: As of `Sample`, shape (n,) [J].
    """
    inside = 0.0 if callable(motion.external) else x["elastic"] + x["dissipated"]
    return np.asarray(x["kinetic"] + x["potential"] + inside - x["motor_work"] - other_work)


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
    slower = FAST / rate if rate * h > FAST else math.inf
    shorter = min(0.8 * h * (LARGEST / min(float(share[worst]), 1.0)) ** (1.0 / order), slower)
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
            rate = element_rate(State(robot, x["q"][i], x["v"][i], t=float(x["t"][i])), x["elements"], damped=damped)
            found.append((rate, "the motion on force elements"))
    return max(found)


RESOLVED = 0.8
"""Longest step times the fastest rate of force elements that an explicit method of order 4 resolves to half a percent."""
STABLE = 6.0
"""Longest step times the fastest rate for which Dormand and Prince's method of order 8 is stable, about."""
MANY = 6_000.0
"""Time between samples, times the fastest rate, for which it needs a thousand steps."""
_SHOWN = 4
_DEPENDENT = 1e-9
"""Rows whose singular value is below this, over the largest one, are dependent."""


def too_stiff(motion: SimulatedMotion, state: State, h: float, t: float | None = None, *, adaptive: bool = False) -> str:
    """Which elements are too stiff at a state for explicit steps of length h, and the cure, in words; empty if none is.

    Elements without derivatives are not looked at, and those of a function of time only if t is given.

    Args:
        motion: The motion.
        state: The state.
        h: Length of a step; of an integrator that chooses its steps, time between samples [s].
        t: Time of the state [s]; None at the start.
        adaptive: Whether the integrator chooses its steps.
    """
    limit = MANY if adaptive else RESOLVED
    given = motion.external
    if callable(given) and t is None:
        return ""
    now = 0.0 if t is None else t
    try:
        elements = elements_of(given(state, now) if callable(given) else given)
        if not elements:
            return ""
        free = _free(motion.constraints, state)
        rate = _rate(state, elements, free)
        if not h * rate > limit:
            return ""
        stiff = [e.name for e in elements if h * _rate(state, [e], free) > limit] or [e.name for e in elements]
    except Exception:  # an explicit method needs no derivatives: what is wrong with those of a user does not stop it
        return ""
    wait = f"or wait for some {h * rate / STABLE:.2g} steps between samples."
    cure = wait if adaptive else f"or steps below {RESOLVED / rate:.2g} s."
    return (
        f"stiff force elements ({joined(map(repr, stiff), _SHOWN):.300}): their fastest rate is {rate:.3g} per "
        f"second, {h * rate:.3g} times 1 / step. Use integrator=rbd.TimeStepping(), which takes them implicitly, {cure}"
    )


def element_rate(state: State, elements: Sequence[ForceElement], *, damped: bool) -> float:
    """Bound of the fastest rate of springs, and of dampers if `damped`, without constraints [1/s]; zero if not known."""
    try:
        return _rate(state, elements, _free((), state), damped=damped)
    except Exception:  # as above
        return 0.0


def _free(constraints: Sequence[Constraint], state: State) -> Array:
    """Directions L^T v that the constraints leave, shape (nv, k)."""
    L = inertia_factor(state.M)
    stacked = [r.J for r in rows_of(state, constraints) if len(r)]
    basis = np.eye(len(L))
    if stacked:
        _, size, rows = np.linalg.svd(solve_triangular(L, np.concatenate(stacked).T, lower=True).T)
        basis = rows[np.count_nonzero(size > _DEPENDENT * size.max(initial=0.0)) :].T
    return np.asarray(solve_triangular(L, basis, lower=True, trans=1))


def _rate(state: State, elements: Sequence[ForceElement], free: Array, *, damped: bool = True) -> float:
    """Bound of the fastest rate [1/s]; without dampers, if not `damped`."""
    terms = ElementTerms.of(state, elements)
    if terms is None or not free.size:
        return 0.0
    d, k = (max(0.0, float(np.linalg.eigvalsh(free.T @ A @ free)[-1])) for A in (terms.D, terms.K))
    d = d if damped else 0.0
    return 0.5 * (d + math.sqrt(d * d + 4.0 * k))
