"""Measured motions as equations that are linear in the parameters, without the contact forces that were not measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rbd.arrays import Array, as_finite, null_space
from rbd.constraints.constraint import Constraint, listed, rows_of, with_loops
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind, check_known
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External, generalised
from rbd.model.inertial import columns_at
from rbd.model.sampled_motion import SampledAccelerations
from rbd.model.state import State
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.identification.combinations import BaseParameters
from rbd.motion.measured import checked_touches, frame_rows
from rbd.motion.sensor_noise import SensorNoise, force_scale, whitening

EXACT = 1e-9
"""Residuals up to this share of `force_scale` count as exact."""
UNTOLD = 1e-9
"""Directions that the data tell less than this share of the best one are not told."""
_CHUNK = 4000  # equations that are compressed at once


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredMotion(Displayed):
    """A motion with what was measured beside it: torques, contacts, contact forces.

    Attributes:
        motion: A reference motion or a trajectory: robot, t, q, v and a.
        tau: Motor torques, shape (n, nu) [N, N m]; None: those of a trajectory. Of a motion without torques only the
            equations that no motor enters count: the rate of momentum of a floating base.
        contacts: What may touch; None: those of `Motion.contacts`. Forces that are not in `forces` are eliminated.
        touches: Which of them touch when, shape (n, k), of truth values; all if not given. Measured forces count always.
        forces: {contact: measured forces (n, 3), of a point, or wrenches (n, 6)} on the robot, in W, as `Trajectory.forces`.
        external: Other forces of the world that are known, the same at all times; springs are taken at each state.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: sizes that do not fit, numbers that are not finite; a motion without accelerations; a trajectory with forces
            of contacts, or of springs, that are not given.
        UnknownName: forces of a contact that is not given.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> rest = rbd.simulate(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [face], duration=0.02, step=1e-2)
        >>> print(rbd.motion.identification.MeasuredMotion(rest, contacts=[face], forces=rest.forces))
        3 frames over 0.02 s, torques measured, forces of face measured
    """

    motion: SampledAccelerations
    tau: Array | None = None
    contacts: Sequence[Constraint] | None = None
    touches: Array | None = None
    forces: Mapping[str, Array] = field(default_factory=dict)
    external: External = None
    loops: bool = True

    def __post_init__(self) -> None:
        x: Any = self.motion
        if not isinstance(getattr(x, "robot", None), CheckedModel) or not all(np.ndim(getattr(x, name, 0.0)) for name in "tqv"):
            raise InputError(f"motion is {x!r:.80}; expected an rbd.Motion, or what rbd.simulate returns.")
        robot, frames = x.robot, len(x.t)
        if getattr(x, "a", None) is None:
            raise InputError(
                "the motion has no accelerations. rbd.Motion.of_arrays(robot, t, q) derives v and a from q, "
                "rbd.Motion.of_arrays(robot, t, q, v) a from v."
            )
        frame_rows("a", x.a, frames, robot.nv)
        tau = getattr(x, "tau", None) if self.tau is None else self.tau
        lanes, contacts, touches = getattr(x, "contacts", None), self.contacts, self.touches
        if contacts is None and isinstance(lanes, ContactTimeline):
            contacts = lanes.contacts
            if touches is None:
                on = [lanes.of_contact(c.name) for c in contacts]
                touches = np.array(on, bool).reshape(len(on), frames).T
        named = listed(() if contacts is None else contacts)
        given = with_loops(robot, named, self.loops)
        for each in given:
            if not callable(getattr(each, "rows", None)) or not isinstance(getattr(each, "name", None), str):
                raise InputError(f"{each!r:.80} is no contact: it has no rows(state). Give e.g. robot.soles().")
        self.__dict__.update(
            tau=None if tau is None else frame_rows("tau", tau, frames, robot.nu),
            contacts=given,
            touches=checked_touches(touches, frames, named, given),
        )
        self._check_forces(frames)
        if self.external is None and getattr(x, "pushed", False) is True:
            raise InputError(
                "external forces acted in the trajectory, which it does not record, and external is not given. Give those that "
                "acted at all times as external=..., or simulate without them."
            )
        springs = getattr(x, "elements", ())
        if isinstance(springs, tuple) and springs and self.external is None:
            raise InputError(
                f"springs or dampers acted in the trajectory ({', '.join(e.name for e in springs):.200}), and external is "
                "not given. Give external=list(trajectory.elements) with it, and pushes that acted."
            )
        if self.external is None and any(np.any(getattr(x, name, 0.0)) for name in ("elastic", "dissipated")):
            raise InputError(
                "the trajectory has energy of springs or work of dampers, whose elements it does not know (a function of time "
                "gave them, or they are not in its file), and external is not given. Give those that acted as external=[...]."
            )

    def _check_forces(self, frames: int) -> None:
        names = [c.name for c in self._given]
        check_kind("forces", self.forces, Mapping, "{contact: (n, 3) or (n, 6)}")
        known = {}
        for name, value in self.forces.items():
            check_known("forces names a contact that is not given,", name, names)
            known[name] = as_finite(f"forces of {name!r}", value, (frames, "k"), meaning=": a row for each frame")
        object.__setattr__(self, "forces", known)
        simulated = getattr(self.motion, "forces", None)
        for name, force in simulated.items() if isinstance(simulated, Mapping) else ():
            if name not in names and np.abs(force).max(initial=0.0) > 0.0:
                raise InputError(
                    f"the trajectory has forces of {name!r}, which is none of the contacts given "
                    f"({', '.join(names) or 'none'}). Give contacts=[...] with it, and forces=trajectory.forces if they are "
                    "to count as measured."
                )

    @property
    def _given(self) -> Sequence[Constraint]:
        assert self.contacts is not None
        return self.contacts

    @property
    def robot(self) -> CheckedModel:
        """The robot."""
        return self.motion.robot

    @property
    def frames(self) -> int:
        """How many frames it has."""
        return len(self.motion.t)

    def equations(self, i: int, columns: Sequence[str]) -> tuple[State, Array, Array, Array]:
        """(state, Y, b, E) of frame i: Y theta = b + E x with unknown forces x; shapes (nv, p), (nv,), (nv, k)."""
        robot, motion = self.robot, self.motion
        state = State(robot, motion.q[i], motion.v[i], t=float(motion.t[i]))
        Y, known = columns_at(state, np.asarray(motion.a[i]), columns)
        b = -known
        unknown = [np.zeros((robot.nv, 0))]
        if self.tau is None:
            unknown.append(robot.actuation.T)
        else:
            b[robot.motors] += self.tau[i]
        if self.external is not None:
            b += generalised(state, self.external)[0]
        touching = np.asarray(self.touches)[i]
        acting = [c for c, on in zip(self._given, touching, strict=True) if on or c.name in self.forces]
        for rows in [r for r in rows_of(state, acting) if len(r)]:  # a limit that is not reached has none
            force = self.forces.get(rows.name)
            if force is None:
                unknown.append(rows.J.T)
                continue
            width = len(rows) if rows.resultant is None else len(rows.resultant)
            if force.shape[1] != width:
                raise InputError(f"forces of {rows.name!r} have {force.shape[1]} columns; expected {width}.")
            f = force[i] if rows.resultant is None else np.linalg.lstsq(rows.resultant, force[i], rcond=None)[0]
            b += rows.J.T @ f
        return state, Y, b, np.hstack(unknown)

    def __str__(self) -> str:
        t = self.motion.t
        names = [c.name for c in self._given]
        known, open_ = [n for n in names if n in self.forces], [n for n in names if n not in self.forces]
        told = [
            f"{self.frames} frames over {float(t[-1] - t[0]):.4g} s",
            "no torques" if self.tau is None else "torques measured",
        ]
        told += [f"forces of {', '.join(of)} {what}" for of, what in ((known, "measured"), (open_, "unknown")) if of]
        return ", ".join(told)


def measured_motions(motions: object) -> tuple[MeasuredMotion, ...]:
    """Motions, each with what was measured beside it, of one robot.

    Raises:
        InputError: none, something else, or different robots.
    """
    single = isinstance(motions, MeasuredMotion) or hasattr(motions, "robot")
    given = (motions,) if single else tuple(motions) if isinstance(motions, Sequence) else ()
    if not given:
        raise InputError(f"motions is {motions!r:.80}; expected one motion or more: rbd.Motion, Trajectory, MeasuredMotion.")
    out = tuple(each if isinstance(each, MeasuredMotion) else MeasuredMotion(each) for each in given)
    for each in out[1:]:
        if not each.robot.is_like(out[0].robot):
            raise InputError(
                f"motions are of different robots: {out[0].robot.name} and {each.robot.name}. Identify one at a time."
            )
    return out


@dataclass(frozen=True, eq=False)
class Equations:
    """All equations of some motions, weighted, as those of the base parameters alone: |W_b beta - z|^2 + rest.

    Attributes:
        R: Shape (r, r) or fewer rows, weighted equations compressed by QR.
        z: Their right-hand side.
        rest: Sum of squares that no beta explains.
        count: How many equations there are.
    """

    R: Array
    z: Array
    rest: float
    count: int

    def spectrum(self, unit: Array) -> EquationSpectrum:
        """What they tell of changes of the base parameters over `unit`, shape (r,)."""
        U, s, Vt = np.linalg.svd(self.R * unit)
        return EquationSpectrum(U, np.concatenate([s, np.zeros(len(unit) - len(s))]), Vt.T)


@dataclass(frozen=True, eq=False)
class EquationSpectrum:
    """Singular values of equations, with their vectors.

    Attributes:
        U: Of the equations, shape (k, k).
        s: Singular values, shape (r,), descending.
        V: Of the changes, as columns, shape (r, r).
    """

    U: Array
    s: Array
    V: Array

    @property
    def rank(self) -> int:
        """How many directions they tell."""
        return int((self.s > UNTOLD * self.s[0]).sum()) if len(self.s) and self.s[0] > 0.0 else 0

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; inf where some direction is not told."""
        return float(self.s[0] / self.s[-1]) if len(self.s) and self.rank == len(self.s) else float("inf")

    @property
    def told(self) -> Array:
        """Basis of the directions that they tell, orthonormal, shape (r, rank)."""
        return self.V[:, : self.rank]


def is_told(told: Array, change: Array) -> bool:
    """Whether a change, shape (r,), is in the directions that are told, orthonormal columns."""
    return bool(np.linalg.norm(change - told @ (told.T @ change)) <= 1e-6 * np.linalg.norm(change))


class StackedMotions:
    """The equations of motions, with weights.

    Args:
        motions: Of one robot.
        base: Its base parameters.
        columns: Those of the regressor.
        noise: Of the sensors; None: each coordinate has the deviation `sigma`.
    """

    def __init__(
        self, motions: tuple[MeasuredMotion, ...], base: BaseParameters, columns: Sequence[str], noise: SensorNoise | None
    ) -> None:
        self.motions, self.base, self.columns, self.noise = motions, base, columns, noise
        first = motions[0]
        self.scale = force_scale(State(first.robot, first.motion.q[0]), motors=False)
        self.sigma = self.scale.copy()

    def frames(self) -> Iterator[tuple[Array, Array, Array, Array]]:
        """(Y, b, W, Q) of each frame: Y theta = b, weights W, and Q^T W free of unknown forces."""
        for motion in self.motions:
            for i in range(motion.frames):
                state, Y, b, E = motion.equations(i, self.columns)
                a, torques = np.asarray(motion.motion.a[i]), motion.tau is not None
                noise = None if self.noise is None else self.noise.covariance(state, a, None, torques=torques)
                W = np.diag(1.0 / self.sigma) if noise is None else whitening(noise, self.scale)
                Q = null_space((W @ E).T) if E.shape[1] else np.eye(len(b))
                yield Y, b, W, Q

    def compressed(self) -> Equations:
        """The equations of all frames."""
        r = self.base.rank
        kept, stack, count, waiting = np.zeros((0, r + 1)), [], 0, 0
        for Y, b, W, Q in self.frames():
            T = Q.T @ W
            stack.append(np.column_stack([T @ Y[:, self.base.columns], T @ b]))
            count, waiting = count + len(T), waiting + len(T)
            if waiting > _CHUNK:
                kept, stack, waiting = np.asarray(np.linalg.qr(np.concatenate([kept, *stack]), mode="r")), [], 0
        kept = np.asarray(np.linalg.qr(np.concatenate([kept, *stack]), mode="r"))
        rest = float(np.sum(kept[r:, r] ** 2))
        return Equations(kept[:r, :r], kept[:r, r], rest, count)

    def residuals(self, beta: Array) -> tuple[Array, Array]:
        """(rms, share): root mean square residual of each coordinate, shape (nv,), and how many equations it had.

        Of what no unknown force explains; a coordinate without an equation has rms zero.
        """
        squares, share = np.zeros(len(self.sigma)), np.zeros(len(self.sigma))
        for Y, b, W, Q in self.frames():
            e = Q.T @ (W @ (Y[:, self.base.columns] @ beta - b))
            squares += np.linalg.solve(W, Q @ e) ** 2
            share += (Q**2).sum(axis=1)
        return np.sqrt(squares / np.maximum(share, 1e-12)), share
