"""`Identification`: the parameters found, what the data say of each, and what they leave open."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, largest_first, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_known
from rbd.model.checked_model import CheckedModel
from rbd.model.inertial import body_names
from rbd.motion.identification.combinations import BaseParameters
from rbd.motion.identification.data import Equations, MeasuredMotion, StackedMotions, is_told, measured_motions
from rbd.motion.identification.possible import Minimum, Prior, mass_interval, pseudo_inertia, whitened_basis
from rbd.records import joined

_LISTED = 6


@dataclass(frozen=True, eq=False)
class BodyInertia(Displayed):
    """The inertia of one body.

    Attributes:
        name: Its name.
        mass: [kg].
        com: Centre of mass in the axes of its joint's frame, from its origin, shape (3,) [m].
        inertia: About the centre of mass, in the same axes, shape (3, 3) [kg m2].
        mass_alone: Whether the equations of motion tell its mass by itself.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> motion = rbd.Motion.from_function(arm, lambda t: np.array([np.sin(4.0 * t)]), np.linspace(0.0, 3.0, 61))
        >>> tau = np.array([rbd.dynamics.inverse_dynamics(motion.state(i), motion.a[i]) for i in range(61)])
        >>> link = rbd.identify(rbd.motion.identification.MeasuredMotion(motion, tau)).bodies["link_1"]
        >>> round(float(link.mass * link.com[0]), 6), link.mass_alone  # m c is told, m is not
        (0.5, False)
    """

    name: str
    mass: float
    com: Array
    inertia: Array
    mass_alone: bool


@dataclass(frozen=True, eq=False)
class IdentificationCertificate(Displayed):
    """The certificate of an identification: the Newton decrement, and that bodies can have the inertias found.

    Attributes:
        decrement: Newton decrement at the answer, lambda: the objective is within lambda^2 of its least.
        least_eigenvalue: Of all pseudo-inertia matrices, each in units of the model's; positive: bodies can have them.
        equations: How many were given.
        rank: How many base combinations they tell.
        condition: Excitation: largest over smallest singular value of the equations, over `force_scale`, in relative changes of
            the base parameters; the smaller, the better. inf: some are not told.

    Example:
        >>> certificate = rbd.motion.identification.IdentificationCertificate(1e-12, 0.4, 700, 213, 90.0)
        >>> print(certificate)
        decrement 1.0e-12, least eigenvalue 0.4 of the model's, rank 213 of 700 equations, condition 90
    """

    decrement: float
    least_eigenvalue: float
    equations: int
    rank: int
    condition: float

    def __str__(self) -> str:
        return (
            f"decrement {self.decrement:.1e}, least eigenvalue {self.least_eigenvalue:.3g} of the model's, rank {self.rank} of "
            f"{self.equations} equations, condition {self.condition:.3g}"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Displayed):
    """Parameters of a robot from measured motions: of bodies, of base combinations, with deviations and a certificate.

    Attributes:
        model: The robot that the motions are of.
        columns: What was identified.
        base: The base parameters, which combinations of theta they are.
        theta: All parameters, named by `base.names`, shape (p,).
        model_theta: Those of the model, shape (p,).
        base_values: Base parameters of theta, shape (r,).
        least_squares: Base parameters of the data alone, impossible bodies allowed; the model's where they tell nothing, shape
            (r,).
        deviations: Standard deviations of `least_squares`, shape (r,): by the data, and `prior` of what they do not tell.
        relative_deviations: The same over `unit`, shape (r,).
        untold: How much of each the data do not tell, 0 to 1, shape (r,).
        covariance: Of `least_squares` by the data alone, shape (r, r).
        sigma: Standard deviation of the residual at each velocity's equation, shape (nv,) [N, N m], by which the data were
            weighed; with noise=, that of the weights does this, and here is `force_scale`.
        residual: Root mean square residual of the data with theta, shape (nv,) [N, N m].
        model_residual: The same with the model's parameters.
        certificate: How near to the least, and what the data tell.
        told: Basis of the base combinations that the data tell, orthonormal in relative changes, shape (r, k).
        unit: Typical size of each base parameter in the model, shape (r,): the root of the sum of squares of its terms.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> motion = rbd.Motion.from_function(arm, lambda t: np.array([np.sin(4.0 * t)]), np.linspace(0.0, 3.0, 61))
        >>> tau = np.array([rbd.dynamics.inverse_dynamics(motion.state(i), motion.a[i]) for i in range(61)])
        >>> found = rbd.identify(rbd.motion.identification.MeasuredMotion(motion, tau))
        >>> found.base.labels, found.open_bodies
        (('link_1.mc_x', 'link_1.mc_z', 'link_1.I_yy'), ('link_1',))
        >>> float(found.residual[0]) < 1e-6
        True
    """

    model: CheckedModel
    columns: tuple[str, ...]
    base: BaseParameters
    theta: Array
    model_theta: Array
    base_values: Array
    least_squares: Array
    deviations: Array
    relative_deviations: Array
    untold: Array
    covariance: Array
    sigma: Array
    residual: Array
    model_residual: Array
    certificate: IdentificationCertificate
    told: Array = field(repr=False)
    unit: Array = field(repr=False)

    @classmethod
    def of(
        cls,
        motions: tuple[MeasuredMotion, ...],
        data: StackedMotions,
        equations: Equations,
        base: BaseParameters,
        prior: Prior,
        found: Minimum,
        unit: Array,
        columns: tuple[str, ...],
        plain: Equations,
        believed: float,
    ) -> Identification:
        """The record of an answer; see `identify`. `plain` are the equations before they were weighed by residuals."""
        seen = equations.spectrum(unit)
        rank, V, s = seen.rank, seen.told, seen.s[: seen.rank]
        start = base.values(prior.theta)
        least = start + unit * (V @ ((seen.U.T @ (equations.z - equations.R @ start))[:rank] / s))
        spread = (V / s) @ (V / s).T
        untold = np.linalg.norm(seen.V[:, rank:], axis=1)
        relative = np.sqrt(np.maximum(np.diag(spread), 0.0) + (believed * untold) ** 2)
        values = base.values(found.theta)
        bodies = [(x[10 * b : 10 * b + 10] for x in (found.theta, prior.theta)) for b in prior.bodies]
        relative_P = [np.tensordot(own, whitened_basis(pseudo_inertia(model)), axes=1) for own, model in bodies]
        least_eigenvalue = min([np.inf, *(float(np.linalg.eigvalsh(P)[0]) for P in relative_P)])
        return cls(
            motions[0].robot,
            columns,
            base,
            found.theta,
            prior.theta,
            values,
            least,
            unit * relative,
            relative,
            untold,
            unit[:, None] * spread * unit,
            data.sigma.copy(),
            data.residuals(values)[0],
            data.residuals(base.values(prior.theta))[0],
            IdentificationCertificate(found.decrement, least_eigenvalue, equations.count, rank, plain.spectrum(unit).condition),
            V,
            unit,
        )

    def open_base(self, spread: float) -> list[int]:
        """Base parameters whose relative deviation is `spread` or more, the least well known first; indices."""
        open_ = [i for i, d in enumerate(self.relative_deviations) if d > 0.99 * spread]
        return sorted(open_, key=lambda i: -self.relative_deviations[i])

    def parameter(self, name: str) -> float:
        """One parameter, e.g. "pelvis.m" or "knee.damping".

        Raises:
            UnknownName: with the nearest names.
        """
        check_known("no parameter", name, self.base.names)
        return float(self.theta[self.base.names.index(name)])

    @lazy
    def bodies(self) -> dict[str, BodyInertia]:
        """{body: its inertia}, of bodies with mass; empty where inertia was not identified."""
        out = {}
        for i, name in enumerate(body_names(self.model) if "inertia" in self.columns else ()):
            theta = self.theta[10 * i : 10 * i + 10]
            if theta[0] > 0.0:
                found = pin.Inertia.FromDynamicParameters(theta)
                out[name] = BodyInertia(name, found.mass, found.lever, found.inertia, name not in self.open_bodies)
        return out

    @property
    def mass(self) -> float:
        """Total mass of the bodies [kg]."""
        return float(self._total @ self.theta) if "inertia" in self.columns else self.model.mass

    @property
    def mass_deviation(self) -> float:
        """Standard deviation of the total mass by the data alone [kg]; inf where they do not tell it."""
        return self._deviation(self._total)

    @property
    def _total(self) -> Array:
        return np.array([name.endswith(".m") for name in self.base.names], float)

    def _deviation(self, combination: Array) -> float:
        """Standard deviation of a combination of the parameters, shape (p,)."""
        k = combination[self.base.columns]
        if not combination.any() or not self.base.reaches(combination) or not is_told(self.told, k * self.unit):
            return float("inf")
        return float(np.sqrt(max(0.0, k @ self.covariance @ k)))

    @lazy
    def open_bodies(self) -> tuple[str, ...]:
        """Bodies whose mass the data do not tell by itself: only together with others', see `mass_range`."""
        unit, names = np.eye(len(self.base.names)), body_names(self.model) if "inertia" in self.columns else ()
        heavy = [(name, unit[10 * i]) for i, name in enumerate(names) if self.theta[10 * i] > 0.0]
        return tuple(name for name, own in heavy if not np.isfinite(self._deviation(own)))

    def mass_range(self, body: str) -> tuple[float, float]:
        """(least, largest) mass of a body [kg] with the same base parameters, all bodies possible: what the data leave open.

        By two semidefinite programs (Clarabel): the bodies' pseudo-inertias are positive semidefinite, and the base
        combinations that the data tell are those found. inf: no upper limit. The noise is not in it.

        Raises:
            UnknownName: with the nearest names.
            NoSolution: a program was not solved.
        """
        names = tuple(self.bodies)
        check_known("no body with a mass is named", body, names)
        if body not in self.open_bodies:
            mass = self.bodies[body].mass
            return mass, mass
        kept = self.told.T @ (self.base.B / self.unit[:, None])
        return mass_interval(self.theta, kept, body_names(self.model).index(body), len(body_names(self.model)))

    def robot(self) -> Any:
        """A new robot with the inertias found; rotor inertia too, if it was identified. The model stays as it is.

        Damping and dry friction are no part of a robot's dynamics here: give them as `rbd.JointDamping` and
        `rbd.constraints.JointFriction`.
        """
        out = copy.deepcopy(self.model)
        if "inertia" in self.columns:
            for i, theta in enumerate(self.theta[: 10 * len(body_names(out))].reshape(-1, 10)):
                if theta[0] > 0.0:
                    out.model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(theta)
        if "rotor_inertia" in self.columns:
            found = dict(zip(self.base.names, self.theta.tolist(), strict=True))
            stated = zip(out.joints.velocities, out.model.armature.tolist(), strict=True)
            out.model.armature = np.array([found.get(f"{c.name}.rotor_inertia", rotor) for c, rotor in stated])
        return out

    def residuals(self, motions: object) -> tuple[Array, Array]:
        """(rms with theta, rms with the model's parameters) of other motions, each of shape (nv,) [N, N m].

        Args:
            motions: As of `identify`; of the same robot.

        Raises:
            InputError: as `identify`; another robot.
        """
        given = measured_motions(motions)
        if not given[0].robot.is_like(self.model):
            raise InputError(f"the motions are of {given[0].robot.name}, and the parameters of {self.model.name}.")
        data = StackedMotions(given, self.base, self.columns, None)
        data.sigma = self.sigma.copy()
        return data.residuals(self.base_values)[0], data.residuals(self.base.values(self.model_theta))[0]

    def predicted(self, motion: MeasuredMotion) -> Array:
        """Generalised forces by the parameters found, shape (n, nv) [N, N m]: what motors and unmeasured contacts must supply.

        Known contact forces and other known forces of the world are taken off. In the air, or with all contact forces measured,
        entries of motors are their torques, to be compared with `motion.tau`, and those of a floating base are zero.
        """
        given = measured_motions(motion)[0]
        equations = (given.equations(i, self.columns) for i in range(given.frames))
        out = np.array([Y @ self.theta - b for _, Y, b, _ in equations])
        if given.tau is not None:
            out[:, given.robot.motors] += given.tau
        return out

    def __str__(self) -> str:
        told = self.certificate
        mean, before = (float(np.sqrt((x**2).mean())) for x in (self.residual, self.model_residual))
        lines = [
            f"{self.base.rank} base parameters of {self.model.name}, {told.rank} of them told by {told.equations} equations"
        ]
        if "inertia" in self.columns:
            spread = f" +- {self.mass_deviation:.2g}" if np.isfinite(self.mass_deviation) else " (not told by the data)"
            lines.append(f"  total mass {self.mass:.5g}{spread} kg; the model has {self.model.mass:.5g} kg")
        lines.append(f"  residual {mean:.3g}, with the model's parameters {before:.3g} (root mean square of N and N m)")
        order = largest_first(self.relative_deviations)[:_LISTED]
        lines.append("  least well known of the base parameters:")
        for i in order:
            deviation = f"+- {self.deviations[i]:.2g}" if self.untold[i] < 0.5 else "not told by the data"
            lines.append(f"    {self.base.expression(int(i), 2)} = {self.base_values[i]:.4g} {deviation}")
        open_ = self.open_bodies
        if open_:
            some = f"all {len(open_)}" if len(open_) == len(self.bodies) else joined(open_, _LISTED)
            lines.append(f"  masses that are not told alone: {some}; .mass_range(name) says how far")
        first = 10 * len(body_names(self.model)) if "inertia" in self.columns else 0
        below = [f"{name} {x:.2g}" for name, x in zip(self.base.names[first:], self.theta[first:], strict=True) if x < 0.0]
        if below:
            lines.append(f"  negative, which no joint is: {', '.join(below[:_LISTED])}{', ...' * (len(below) > _LISTED)}")
        lines.append(f"  {told}")
        return "\n".join(lines)
