"""`motion_derivatives`: how a whole motion changes with its parameters, by differences of many worlds."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, check_positive
from rbd.constraints.constraint import Constraint, has_friction, listed, member
from rbd.control.schedules import Push
from rbd.displayed import Displayed
from rbd.errors import InaccurateWarning, InputError
from rbd.errors.inputs import check_kind, check_known, listed_items
from rbd.model.state import State
from rbd.problem.gauss_problem import Law
from rbd.worlds.simulating import simulate_many
from rbd.worlds.stepping import Servo, WorldPushes
from rbd.worlds.trajectories import Trajectories

KINDS = ("friction", "mass", "gravity", "ground", "q", "v", "tau")
"""What a motion may be differentiated by."""
STEPS = (1.0, -1.0, 2.0, -2.0)
"""Differences of the worlds of one parameter."""


@dataclass(frozen=True, eq=False, repr=False)
class MotionDerivatives(Displayed):
    """Derivatives of a motion at T samples by p parameters, as central differences, with estimates of their errors.

    Attributes:
        names: Of the parameters, p.
        t: Times, shape (T,) [s].
        q: Of the configuration, as velocities per unit of the parameter, shape (p, T, nv); NaN where a world has stopped.
        v: Of the velocity, shape (p, T, nv).
        q_error: Difference to that with twice the perturbation, shape (p, T, nv): about three times the error where the motion
            depends smoothly on the parameter, and about the error where the step's rounding of events counts.
        v_error: Likewise, shape (p, T, nv).
        worlds: The 4 p perturbed motions: of each parameter those with +1, -1, +2 and -2 perturbations.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> slides = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        >>> found = rbd.worlds.motion_derivatives(slides, [face], ("friction", "v"), duration=0.4, step=1e-3, size=0.01)
        >>> found["friction"][0][-1, 0].round(3), round(-1.0 / (2 * 0.5**2 * 9.81), 3)  # of v^2 / (2 mu g)
        (np.float64(-0.204), -0.204)
        >>> found["v root_joint.vx"][0][-1, 0].round(3), round(1.0 / (0.5 * 9.81), 3)
        (np.float64(0.204), 0.204)
    """

    names: tuple[str, ...]
    t: Array
    q: Array
    v: Array
    q_error: Array
    v_error: Array
    worlds: Trajectories = field(repr=False)

    def __getitem__(self, name: str) -> tuple[Array, Array]:
        """(dq, dv) by one parameter, shapes (T, nv)."""
        check_known("no parameter", name, self.names)
        i = self.names.index(name)
        return self.q[i], self.v[i]

    @property
    def flagged(self) -> tuple[str, ...]:
        """The parameters of whose worlds one stopped or has a residual above 1e-8."""
        some = {int(i) // len(STEPS) for i in self.worlds.flagged}
        return tuple(name for i, name in enumerate(self.names) if i in some)

    def __str__(self) -> str:
        size, off = np.nanmax(np.abs(self.q[:, -1]), axis=1), np.nanmax(np.abs(self.q_error[:, -1]), axis=1)
        lines = [
            f"{name}: |dq| {a:.3g} at the end, error about {b:.1g}" for name, a, b in zip(self.names, size, off, strict=True)
        ]
        return "\n".join([f"derivatives by {len(self.names)} parameters, {self.t[-1]:g} s", *lines])


def motion_derivatives(
    state: State,
    contacts: Sequence[Constraint] = (),
    by: Sequence[str] = KINDS[:1],
    *,
    duration: float,
    step: float,
    size: float = 1e-3,
    tau: Array | None = None,
    mass: float = 1.0,
    gravity: Sequence[float] | Array | None = None,
    ground: float = 0.0,
    controller: Servo | None = None,
    law: Law | str = "coulomb",
    damping: Mapping[str, float] | None = None,
    pushes: WorldPushes | Push | Sequence[WorldPushes | Push] = (),
    record: int | None = None,
    threads: int | None = 1,
) -> MotionDerivatives:
    """Derivatives of a whole motion, through impacts and slips, by central differences of `simulate_many`.

    Two differences are taken, of perturbations by `size` and by twice as much; the first is the derivative, and what the second
    differs by the estimate of its error. Where an event (a touch, a stop, the end of a slip) moves from one step to the next,
    a motion is rounded by about step^2: perturbations much larger than the step give the derivatives of the continuous motion.
    Where the motion has a kink, as between sticking and slipping, there is none, and the estimate is large.

    Args:
        state: Where it begins.
        contacts: As of `simulate_many`.
        by: "friction" of all contacts together, "mass" (a factor of all), "gravity" (x, y, z), "ground" (its height), "q" and
            "v" (each velocity's direction), "tau" (each motor).
        duration: Simulated time [s].
        step: Length of a step [s].
        size: Perturbation of friction, mass factor, configurations [m, rad], velocities [m/s, rad/s] and height [m]; times 9.81
            of gravity [m/s2]; times the weight of the robot of torques [N, N m].
        tau: Motor torques, shape (nu,) [N, N m].
        mass: Factor of all masses and inertias.
        gravity: Shape (3,) [m/s2]; None: the robot's.
        ground: Height added to all ground [m].
        controller: A `Servo`, or None.
        law: "coulomb" or "convex".
        damping: {joint: viscous damping}.
        pushes: As of `simulate_many`.
        record: Steps between samples; None: the first and the last alone.
        threads: As of `simulate_many`.

    Raises:
        UnknownName: a parameter that is none of these.
        InputError: perturbations that make friction or mass negative, and as of `simulate_many`.

    Example:
        >>> falls = rbd.State(rbd.testing.box(mass=3.0), [0, 0, 1, 0, 0, 0, 1])
        >>> found = rbd.worlds.motion_derivatives(falls, [], ["gravity"], duration=0.4, step=1e-2)
        >>> found.names, found["gravity z"][0][-1, 2].round(6)  # t^2 / 2
        (('gravity x', 'gravity y', 'gravity z'), np.float64(0.08))
    """
    check_kind("state", state, State, "an rbd.State")
    check_positive("size", size, 1.0, "in units of each parameter")
    robot, kinds = state.robot, listed_items("by", (by,) if isinstance(by, str) else by, f"a list of {', '.join(KINDS)}")
    names: list[tuple[str, str, int]] = []
    rates = [each.name for each in robot.joints.velocities]
    for kind in kinds:
        check_known("no parameter of a motion", kind, KINDS)
        parts = {"gravity": "xyz", "q": rates, "v": rates, "tau": robot.actuated_names}.get(kind)
        names += [(kind, kind, 0)] if parts is None else [(kind, f"{kind} {part}", i) for i, part in enumerate(parts)]
    n = len(STEPS) * len(names)
    q, v = np.tile(state.q, (n, 1)), np.tile(state.v, (n, 1))
    torques = np.tile(np.zeros(robot.nu) if tau is None else as_finite("tau", tau, (robot.nu,)), (n, 1))
    pulls = np.tile(robot.gravity if gravity is None else as_finite("gravity", gravity, (3,)), (n, 1))
    factor, height, more = np.full(n, as_finite("mass", mass, ())), np.full(n, as_finite("ground", ground, ())), np.zeros(n)
    units = {"gravity": 9.81, "tau": robot.force_unit}
    widths = np.array([size * units.get(kind, 1.0) for kind, _, _ in names])
    for c, (kind, _, i) in enumerate(names):
        for k, times in enumerate(STEPS):
            at, d = len(STEPS) * c + k, times * widths[c]
            if kind == "q":
                q[at] = pin.integrate(robot.model, state.q, d * np.eye(robot.nv)[i])
            elif kind in ("v", "tau", "gravity"):
                {"v": v, "tau": torques, "gravity": pulls}[kind][at, i] += d
            else:
                {"friction": more, "mass": factor, "ground": height}[kind][at] += d
    own: dict[str, float] = {}
    for contact in listed(contacts) if "friction" in kinds else ():
        if has_friction(contact) and isinstance(mu := member(contact, "friction"), float | int):
            own[contact.name] = float(mu)
    for what, least in [
        ("mass", factor.min(initial=1.0)),
        *((f"friction of {x!r}", mu + more.min(initial=0.0)) for x, mu in own.items()),
    ]:
        if least <= 0.0:
            raise InputError(
                f"perturbed by {size:g}, the {what} becomes {least:.3g}; expected numbers above 0: try a smaller size."
            )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InaccurateWarning)
        worlds = simulate_many(
            (robot, q, v), contacts, duration=duration, step=step, tau=torques, gravity=pulls, mass=factor, ground=height,
            friction={name: mu + more for name, mu in own.items()} or None, controller=controller, law=law, damping=damping,
            pushes=pushes, record=record, threads=threads,
        )  # fmt: skip
    found = MotionDerivatives(tuple(name for _, name, _ in names), worlds.t, *_differences(worlds, widths), worlds)
    if found.flagged:
        some = ", ".join(found.flagged[:5])
        warnings.warn(
            f"derivatives by {some} are of worlds that stopped, or are not accurate; see `worlds.flagged`.", InaccurateWarning,
            stacklevel=2,
        )  # fmt: skip
    return found


def _differences(worlds: Trajectories, widths: Array) -> tuple[Array, Array, Array, Array]:
    """(dq, dv, and their errors), shapes (p, T, nv)."""
    model, p = worlds.robot.model, len(widths)
    q, v = (x.reshape(p, len(STEPS), len(worlds.t), -1) for x in (worlds.q, worlds.v))
    near, far = (np.zeros_like(v[:, 0]) for _ in range(2))
    for c in range(p):
        for i in range(len(worlds.t)):
            for out, plus, minus, d in ((near, 0, 1, 2.0 * widths[c]), (far, 2, 3, 4.0 * widths[c])):
                out[c, i] = pin.difference(model, q[c, minus, i], q[c, plus, i]) / d
    d = 2.0 * widths[:, None, None]
    rate, rate_far = (v[:, 0] - v[:, 1]) / d, (v[:, 2] - v[:, 3]) / (2.0 * d)
    return near, rate, np.abs(near - far), np.abs(rate - rate_far)
