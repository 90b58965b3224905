"""`identify`: the inertial parameters of a robot from measured motions; `excitation`, how well motions would tell them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, check_number, largest_first
from rbd.displayed import Displayed
from rbd.errors import InaccurateWarning, InputError, ModelWarning, PoorExcitationWarning
from rbd.model.checked_model import CheckedModel
from rbd.model.inertial import body_names, checked_columns, inertial_parameters, joint_velocities, parameter_values
from rbd.model.state import State
from rbd.motion.identification.combinations import BaseParameters, base_parameters
from rbd.motion.identification.data import (
    EXACT,
    UNTOLD,
    Equations,
    EquationSpectrum,
    MeasuredMotion,
    StackedMotions,
    is_told,
    measured_motions,
)
from rbd.motion.identification.possible import Prior, is_possible, made_possible, minimise, size_of
from rbd.motion.identification.result import Identification
from rbd.motion.sensor_noise import SensorNoise, checked_noise

BROAD = 10.0
"""Standard deviation of rotor inertia, damping and dry friction before the data, over the scale of the force."""


@dataclass(frozen=True, eq=False)
class IdentificationSetup:
    """The problem before any data were read.

    Attributes:
        base: The base parameters.
        data: What gives the equations.
        prior: The model.
        unit: Typical size of each base parameter, shape (r,).
    """

    base: BaseParameters
    data: StackedMotions
    prior: Prior
    unit: Array

    @classmethod
    def of(
        cls, motions: tuple[MeasuredMotion, ...], columns: Sequence[str], spread: float, noise: SensorNoise | None
    ) -> IdentificationSetup:
        """Of checked arguments of `rbd.identify`."""
        robot = motions[0].robot
        theta = _possible(robot, inertial_parameters(robot))
        base = base_parameters(robot, columns=columns)
        data, driven = StackedMotions(motions, base, columns, noise), joint_velocities(robot)
        inertia = "inertia" in columns
        bodies = np.flatnonzero(theta[:, 0] > 0.0) if inertia else np.zeros(0, int)
        wide = np.tile(BROAD * data.scale[driven], len(columns) - inertia)
        of_bodies = [size_of(each) if each[0] > 0.0 else np.zeros(10) for each in (theta if inertia else ())]
        sizes = np.concatenate([*of_bodies, wide])
        prior = Prior(parameter_values(robot, columns, theta), bodies, wide, 1.0 / (4.0 * spread**2))
        return cls(base, data, prior, np.linalg.norm(base.B * sizes, axis=1))


def _possible(robot: CheckedModel, theta: Array) -> Array:
    """The model's parameters, impossible bodies changed, with a warning."""
    names = body_names(robot)
    wrong = [i for i, each in enumerate(theta) if each[0] > 0.0 and not is_possible(each)]
    negative = [names[i] for i, each in enumerate(theta) if each[0] < 0.0]
    if negative:
        raise InputError(f"bodies of {robot.name} have negative mass: {', '.join(negative)}.")
    out = theta.copy()
    for i in wrong:
        out[i] = made_possible(theta[i])
    if wrong:
        warnings.warn(
            f"no body can have the inertia of {', '.join(names[i] for i in wrong)} in {robot.name}: the second moments about "
            "its centre of mass are raised to be positive before the data are fitted.",
            ModelWarning,
            stacklevel=4,
        )
    return out


_ROUNDS = 4
MANY = 0.1
"""Share of the base parameters that must be open for a warning, where none is open altogether."""
TOO_LIGHT = 0.3
"""Less than this share of the model's mass is not believed."""
UNEXPLAINED = 0.1
"""A residual at a floating base above this share of the weight is told."""
FAR = 100.0
"""Torques this many times those of the model, or as many times less, are in another unit, or are not its torques."""
UNUSED, DEAD = 1e-3, 0.3
"""A model that needs less than this share of `force_scale` tells nothing of torques; a motor that is needed for more than this
share of the inertia's and the weight's part has no torque of zero throughout."""
LEAST = 0.01
"""No coordinate's residual counts as smaller than this share of all, over `force_scale`: few equations are fitted too well."""


def identify(
    motions: object,
    *,
    columns: Sequence[str] = ("inertia",),
    prior: float = 0.3,
    noise: SensorNoise | None = None,
) -> Identification:
    """Inertial parameters of a robot's bodies from motions, torques and contact forces, by physically consistent least squares.

    M a + h = S^T tau + tau_ext + J^T f is linear in the parameters theta: Y theta = b. Sought are the parameters with the least
    weighted squares of the residual, near those of the model, that some bodies of positive mass have:

        1/2 sum |W (Y theta - b)|^2 + w sum_bodies D(P, P_model),      w = 1 / (4 prior^2)

    with P the pseudo-inertia matrix of a body, positive definite, and D the entropic divergence [Lee2020]: a convex program
    with one answer, solved by Newton's method. What the data tell they decide; what they leave open is the model's.

    Contact forces that were not measured are eliminated: the equations are multiplied by a basis of the null space of J.
    Without torques only the equations count that no motor enters, six of a floating base.

    Neglected: errors of q, v and a in Y itself (they bias the answer towards small inertias; smooth the data first),
    elasticity, and correlation of errors in time, by which the deviations are too small where a was derived over windows.

    Args:
        motions: `rbd.Motion`, `rbd.Trajectory`, or `rbd.motion.identification.MeasuredMotion` with torques, contacts and
            forces; one or several, of one robot. A trajectory has its torques; its contacts are given by a `MeasuredMotion`.
        columns: What is identified: "inertia", and any of "rotor_inertia", "damping", "dry_friction".
        prior: Relative standard deviation with which the masses of the model are believed, 0.01 to 100.
        noise: Of the sensors, which gives the weights W; None: each coordinate has one deviation, found from the residuals.

    Returns:
        Parameters, base parameters with deviations, residuals, certificate; `result.robot()` is the robot with them.

    Raises:
        InputError: no motion, different robots, fewer equations than base parameters, no accelerations, sizes that do not fit,
            torques missing of a robot without a floating base, contacts missing of one that is carried by them; torques that
            are zero throughout, of the other sign, or off by a factor of 100 or more from those of the model, as in N mm.
        NoSolution: Newton's method did not converge.

    Warns:
        PoorExcitationWarning: some base parameters are not told at all, or a tenth of them no better than by the model.
        InaccurateWarning: a tenth of the weight is unexplained at a floating base; a motor that is needed has no torque.
        ModelWarning: a body of the model is impossible; its second moments are raised first.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> wave = lambda t: np.array([1.2 * np.sin(3.0 * t), 0.9 * np.cos(5.0 * t)])
        >>> motion = rbd.Motion.from_function(arm, wave, np.linspace(0.0, 4.0, 81))
        >>> tau = np.array([rbd.dynamics.inverse_dynamics(motion.state(i), motion.a[i]) for i in range(81)])
        >>> found = rbd.identify(rbd.motion.identification.MeasuredMotion(motion, 1.1 * tau))  # every torque a tenth larger
        >>> model = found.base.values(found.model_theta)
        >>> {name: round(float(x / y), 4) for name, x, y in zip(found.base.labels, found.base_values, model) if abs(y) > 1e-9}
        {'link_1.mc_x': 1.1, 'link_1.I_yy': 1.1, 'link_2.mc_x': 1.1, 'link_2.I_yy': 1.1}
    """
    given = measured_motions(motions)
    asked = checked_columns(columns)
    spread = check_number("prior", prior, 0.01, 100.0, expected="a relative standard deviation from 0.01 to 100, e.g. 0.3")
    robot = given[0].robot
    if noise is not None:
        checked_noise(robot, noise, torques=any(x.tau is not None for x in given))
    if all(x.tau is None for x in given) and not len(robot.unactuated):
        raise InputError(
            f"every coordinate of {robot.name} has a motor, and no torques were given: MeasuredMotion(motion, tau)."
        )
    posed = IdentificationSetup.of(given, asked, spread, noise)
    base, data, unit = posed.base, posed.data, posed.unit
    equations = data.compressed()
    if equations.count < base.rank:
        raise InputError(
            f"{equations.count} equations of {sum(x.frames for x in given)} frames for {base.rank} base parameters of "
            f"{robot.name}: too few samples. Give more frames."
        )
    plain = equations
    if noise is None:
        equations = _weighed(data, equations, unit)
    _refuse_missing_forces(posed, equations)
    _refuse_other_torques(posed, plain)
    _warn_dead_motors(given)
    found = minimise(equations.R @ base.B, equations.z, posed.prior)
    result = Identification.of(given, data, equations, base, posed.prior, found, unit, asked, plain, spread)
    _warn(result, spread)
    _warn_unexplained(result, data.scale)
    return result


def _refuse_missing_forces(posed: IdentificationSetup, equations: Equations) -> None:
    """Refuse data that ask for next to no mass of a robot on a floating base, or for a negative one: a force is missing."""
    robot, base = posed.data.motions[0].robot, posed.base
    total = np.array([name.endswith(".m") for name in base.names], float)
    if not robot.bases or not total.any() or not base.reaches(total):
        return
    beta, k = _least_squares(equations, posed.unit), total[base.columns]
    mass, model = float(k @ beta), float(total @ posed.prior.theta)
    if is_told(equations.spectrum(posed.unit).told, k * posed.unit) and mass < TOO_LIGHT * model:
        raise InputError(
            f"the data ask for a total mass of {mass:.3g} kg, and the model of {robot.name} has {model:.4g} kg: a force that "
            "carried it is not given. Give the contacts that touched (contacts=), or their measured forces (forces=)."
        )


def _refuse_other_torques(posed: IdentificationSetup, equations: Equations) -> None:
    """Refuse torques that are no torques of such a robot: zeros, another sign or another unit.

    Masses follow them: without torques the least squares are those of a robot without mass.
    """
    motions, base = posed.data.motions, posed.base
    needed = equations.R @ (base.B @ posed.prior.theta)
    size = float(needed @ needed)
    factor = float(needed @ equations.z) / size if size > UNUSED**2 * equations.count else 1.0
    if any(x.tau is not None and x.tau.size for x in motions) and not 1.0 / FAR < factor < FAR:
        if all(not np.any(x.tau) for x in motions):
            why = "all torques are zero. Were they measured?"
        elif factor < -1.0 / FAR:
            why = "they have the other sign. Expected the torques on the joints, positive along the joint's velocity."
        else:
            why = "they are in another unit (N mm?), of another robot, or not of this motion. Expected N m, or N."
        raise InputError(
            f"the torques are {factor:.3g} times those that the model of {motions[0].robot.name} needs for these motions, and "
            f"so would the masses be: {why}"
        )


def _warn_dead_motors(given: tuple[MeasuredMotion, ...]) -> None:
    """Say which motors have no torque in any frame, though the model needs one."""
    robot, torques = given[0].robot, [x.tau for x in given if x.tau is not None]
    if not torques or not robot.nu:
        return
    dead = ~np.any(np.concatenate(torques), axis=0)
    if not dead.any() or dead.all():
        return
    needed, parts = np.zeros(robot.nu), np.zeros(robot.nu)
    for motion in (x for x in given if x.tau is not None and not len(x._given)):
        for i in range(motion.frames):
            state = State(robot, motion.motion.q[i], motion.motion.v[i])
            inertia, bias = (robot.actuation @ x for x in (state.M @ np.asarray(motion.motion.a[i]), state.h))
            needed += (inertia + bias) ** 2
            parts += inertia**2 + bias**2
    bad = np.flatnonzero(dead & (needed > DEAD**2 * parts) & (parts > 0.0))
    if len(bad):
        names = ", ".join(robot.actuated_names[i] for i in bad)
        warnings.warn(
            f"the torque of {names} is zero in all frames, and the model needs one there. Was it measured? A joint without "
            "motor is to be passive in the model; of a sensor that failed, leave the motion out.",
            InaccurateWarning,
            stacklevel=3,
        )


def _weighed(data: StackedMotions, equations: Equations, unit: Array) -> Equations:
    """The equations weighted by the deviation of each coordinate, which their residuals give."""
    for _ in range(_ROUNDS):
        rms, share = data.residuals(_least_squares(equations, unit))
        lost = equations.count / max(1, equations.count - data.base.rank)
        told = share > 1e-9
        of_all = float(np.sqrt(((rms / data.scale) ** 2 * share).sum() / share.sum()))
        floor = max(EXACT, LEAST * of_all) * data.scale
        before, data.sigma = data.sigma, np.where(told, np.maximum(rms * lost**0.5, floor), data.sigma)
        equations = data.compressed()
        if np.abs(np.log(data.sigma / before)).max() < 0.02:
            break
    return equations


def _least_squares(equations: Equations, unit: Array) -> Array:
    """Base parameters of least squares, of least norm in their units where the data do not decide, shape (r,)."""
    return np.asarray(unit * np.linalg.lstsq(equations.R * unit, equations.z, rcond=1e-12)[0])


def _warn_unexplained(result: Identification, scale: Array) -> None:
    """Say that a force may be missing, where much of the weight of a floating base is unexplained."""
    robot, share = result.model, result.residual / scale
    base = [i for joint in robot.joints.values() if joint.id in robot.bases for i in range(joint.v.start, joint.v.stop)]
    worst = max(base, key=lambda i: share[i], default=-1)
    if worst >= 0 and share[worst] > UNEXPLAINED:
        warnings.warn(
            f"the motions are explained badly: the root mean square residual at {robot.joints.velocities[worst].name} is "
            f"{result.residual[worst]:.3g} (N, or N m), {share[worst]:.0%} of what the weight does there. Are all contacts, "
            "their forces and pushes given?",
            InaccurateWarning,
            stacklevel=3,
        )


def _warn(result: Identification, spread: float) -> None:
    """Say what the data do not tell, where it is much."""
    open_, r = result.open_base(spread), result.base.rank
    if result.certificate.rank == r and len(open_) < MANY * r:
        return
    known = [
        f"to {result.relative_deviations[i]:.2g} of its size" if result.untold[i] < 0.5 else "not at all" for i in open_[:4]
    ]
    told = [f"{result.base.labels[i]} ({how})" for i, how in zip(open_, known, strict=False)]
    warnings.warn(
        f"poor excitation: the data tell {result.certificate.rank} of {r} combinations of the base parameters. Known no better "
        f"than the model is believed (prior = {spread:g}) are {len(open_)} parameters: {', '.join(told)}"
        f"{', ...' * (len(open_) > 4)}. They stay near the model. Move all joints, more and faster, in several postures.",
        PoorExcitationWarning,
        stacklevel=3,
    )


_LISTED = 5


@dataclass(frozen=True, eq=False, repr=False)
class Excitation(Displayed):
    """How well motions tell the base parameters: rank and condition of their equations.

    Attributes:
        base: The base parameters.
        spectrum: Of the equations, each over its `rbd.motion.sensor_noise.force_scale`, in relative changes of the base
            parameters.
        equations: How many there are.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> wave = lambda t: np.array([1.2 * np.sin(3.0 * t), 0.9 * np.cos(5.0 * t)])
        >>> both = rbd.Motion.from_function(arm, wave, np.linspace(0.0, 4.0, 81))
        >>> one = rbd.Motion.from_function(arm, lambda t: wave(t) * [0.0, 1.0], np.linspace(0.0, 4.0, 81))
        >>> print(rbd.motion.identification.excitation(both))
        6 of 6 combinations told by 162 equations, condition 101; least: link_1.mc_z, link_1.I_yy
        >>> print(rbd.motion.identification.excitation(one))
        4 of 6 combinations told by 162 equations, condition inf; least: link_1.mc_z, link_1.I_yy
    """

    base: BaseParameters
    spectrum: EquationSpectrum
    equations: int

    @property
    def singular_values(self) -> Array:
        """Of the equations, each over its `force_scale`, in relative changes of the base parameters, shape (r,), descending."""
        return self.spectrum.s

    @property
    def rank(self) -> int:
        """How many combinations are told."""
        return self.spectrum.rank

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; inf where some combination is not told."""
        return self.spectrum.condition

    @property
    def weakest(self) -> tuple[str, ...]:
        """Labels of the base parameters in the combinations that are told least, the largest first."""
        s = self.singular_values
        least = s <= (max(s[-1] * (1.0 + 1e-6), UNTOLD * s[0]) if len(s) else 0.0)
        part = np.linalg.norm(self.spectrum.V[:, least], axis=1)  # of their space: single directions in it are arbitrary
        return tuple(self.base.labels[i] for i in largest_first(part)[:_LISTED] if part[i] > 0.1)

    def __str__(self) -> str:
        told = f"{self.rank} of {self.base.rank} combinations told by {self.equations} equations"
        return f"{told}, condition {self.condition:.3g}; least: {', '.join(self.weakest)}"


def excitation(motions: object, *, columns: Sequence[str] = ("inertia",)) -> Excitation:
    """How well motions would tell the base parameters, all torques being measured: to choose motions before they are made.

    The equations are those of `rbd.identify`, each coordinate over its `rbd.motion.sensor_noise.force_scale` without effort
    limits, and the base parameters over their sizes in the model. A condition number below 100 is usually wanted [Gautier1991].

    Args:
        motions: As of `rbd.identify`; torques are not needed. Forces of contacts that are not in `forces` are eliminated.
        columns: As of `rbd.identify`.

    Raises:
        InputError: as `rbd.identify`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> crouch = solo.standing().with_joints({"FL_KFE": -1.2}).q
        >>> motion = rbd.motion.minimum_jerk(solo, [solo.standing().q, crouch], [0.0, 0.5], rate=60.0)
        >>> found = rbd.motion.identification.excitation(motion)
        >>> found.rank < found.base.rank == 94, found.condition
        (True, inf)
    """
    asked = checked_columns(columns)
    given = tuple(
        each if each.tau is not None else replace(each, tau=np.zeros((each.frames, each.robot.nu)))
        for each in measured_motions(motions)
    )
    posed = IdentificationSetup.of(given, asked, 1.0, None)
    found = posed.data.compressed()
    return Excitation(posed.base, found.spectrum(posed.unit), found.count)
