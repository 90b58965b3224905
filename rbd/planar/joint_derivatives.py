"""Rates, accelerations and jerks of joints from those of the end point.

    J q' = v,   J q'' = a - J' q',   J q''' = j - 2 J' q'' - J'' q'.

Two links solve these. More links have many solutions for q'; taken is the least one, q' = J^T l with J J^T l = v (the
pseudo-inverse), and its time derivatives,

    q'' = J^T l' + J'^T l,   q''' = J^T l'' + 2 J'^T l' + J''^T l,

so that q'' is the derivative of q' along the motion: J^+ (a - J' q') alone is not, it leaves out how the null space turns.
One link has one angle for two components: a velocity that is not along its circle contradicts it.
At a singular pose the rates are undetermined, or without bound as the pose is approached, and are reported as NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_finite
from rbd.errors import InputError, SingularPose
from rbd.errors.inputs import check_choice
from rbd.planar.angles import samples
from rbd.planar.chain import Chain, check_chain
from rbd.planar.inverse_kinematics import SINGULAR
from rbd.planar.numeric import ChainNumbers

CONTRADICTS = 1e-6
"""Part of a single link's end-point motion that may be off its circle: round-off of its computation, and no more."""


@dataclass(frozen=True, eq=False)
class JointRates:
    """Motion of the joints; parts not requested are empty, shape (0, n), or (0,) for one sample.

    Attributes:
        qd: Angular velocities, as the chain measures its angles, shape (samples, n) or (n,) [rad/s].
        qdd: Angular accelerations [rad/s^2].
        qddd: Angular jerks [rad/s^3].
        singular: Whether the pose is singular, shape (samples,) or (): rates are NaN there, if requested.
    """

    qd: Array
    qdd: Array
    qddd: Array
    singular: Array


def joint_rates(
    chain: Chain,
    q: Sequence[float] | Array,
    velocity: Sequence[float] | Array,
    acceleration: Sequence[float] | Array | None = None,
    jerk: Sequence[float] | Array | None = None,
    *,
    at_singular: str = "raise",
) -> JointRates:
    """Rates of the joints that give the end point a velocity, an acceleration and a jerk.

    Args:
        chain: The chain, its lengths numbers.
        q: Angles, as the chain measures them, shape (n,) or (samples, n) [rad].
        velocity: Of the end point, shape (2,) or (samples, 2) [m/s].
        acceleration: Acceleration, of the same shape [m/s^2]; None if not known.
        jerk: Jerk, of the same shape [m/s^3]; needs the acceleration.
        at_singular: "raise", or "nan" for NaN in the samples that are singular.

    Returns:
        The rates; more than two links: the least ones, in the sum of squares of the chain's own angles.

    Raises:
        SingularPose: where the chain is in line (smallest over largest singular value of J below 1e-7), naming the sample.
        InputError: on wrong shapes, numbers that are not finite, or motion off the circle of a single link.

    Example:
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 1.0])
        >>> rates = rbd.planar.joint_rates(arm, [0.0, np.pi / 2], [0.0, 1.0])
        >>> rates.qd.round(4)
        array([ 1., -1.])
    """
    arm = check_chain(chain).numeric
    pose = samples("q", q, arm.n)
    check_choice("at_singular", at_singular, ("raise", "nan"))
    if jerk is not None and acceleration is None:
        raise InputError("a jerk came without an acceleration; expected both: the joints' jerk depends on it.")
    single = pose.ndim == 1
    given = [("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk)]
    motion = [_vectors(what, value, pose).reshape(-1, 2) for what, value in given if value is not None]
    pose = pose.reshape(-1, arm.n)
    J = arm.jacobian(pose)
    s = np.linalg.svd(J, compute_uv=False)
    singular = s[:, 1] <= SINGULAR * s[:, 0] if arm.n > 1 else np.zeros(len(pose), dtype=bool)
    if singular.any() and at_singular == "raise":
        raise SingularPose(_singular_message(arm, pose, singular))
    good = ~singular
    motion = [m[good] for m in motion]
    out = []
    for rates in _rates(arm, pose[good], J[good], motion):
        full = np.full(pose.shape, np.nan)
        full[good] = rates
        out.append(full[0] if single else full)
    out += [out[0][:0]] * (3 - len(out))
    return JointRates(out[0], out[1], out[2], singular[0] if single else singular)


def _vectors(what: str, value: Sequence[float] | Array, pose: Array) -> Array:
    return as_finite(what, value, (*pose.shape[:-1], 2), meaning=": x and y for every row of q")


def _singular_message(arm: ChainNumbers, pose: Array, singular: Array) -> str:
    k = int(np.argmax(singular))
    x, y = arm.position(pose[k])
    more = f" ({int(singular.sum())} samples of {len(pose)} are singular)" if singular.sum() > 1 else ""
    where = f"at sample {k} of {len(pose)}" if len(pose) > 1 else "here"
    return (
        f"{where} the chain is in line, with its end point at ({x:g}, {y:g}) m{more}: joint rates are undetermined there, and "
        "may be without bound nearby. Begin near it, or ask for NaN there: at_singular='nan'."
    )


def _rates(arm: ChainNumbers, q: Array, J: Array, motion: list[Array]) -> list[Array]:
    """Rates, accelerations and jerks, as far as motion is given: along the circle of one link, the least of more than two."""
    out: list[Array] = []
    multipliers: list[Array] = []
    JT = np.swapaxes(J, 1, 2)
    for order, given in enumerate(motion):
        wanted = given - _lower(arm, q, out, out, order)
        if arm.n == 1:
            rate = _times(JT, wanted) / arm.outer**2
            _check_on_circle(order, given, wanted, wanted - _times(J, rate))
        elif arm.n == 2:
            rate = np.linalg.solve(J, wanted[..., None])[..., 0]
        else:
            # The part of the rate that the multipliers known so far give, of q' = J^T l differentiated.
            rest = _lower(arm, q, out, multipliers, order, transposed=True)
            multipliers.append(np.linalg.solve(J @ JT, (wanted - _times(J, rest))[..., None])[..., 0])
            rate = _times(JT, multipliers[-1]) + rest
        out.append(rate)
    return out


def _check_on_circle(order: int, given: Array, wanted: Array, rest: Array) -> None:
    off = np.abs(rest).max(axis=1, initial=0.0)
    size = np.abs(given).max(axis=1, initial=0.0) + np.abs(wanted).max(axis=1, initial=0.0)
    if (off > CONTRADICTS * size).any():
        k = int(np.argmax(off - CONTRADICTS * size))
        what = ("velocity", "acceleration", "jerk")[order]
        raise InputError(
            f"the {what} at sample {k}, ({given[k, 0]:g}, {given[k, 1]:g}), is off by {off[k]:g} from what a single link "
            "can do on its circle; expected one of a motion along it."
        )


def _lower(
    arm: ChainNumbers, q: Array, rates: list[Array], terms: list[Array], order: int, *, transposed: bool = False
) -> Array:
    """Terms of the lower rates: zero, J' x, or 2 J' x' + J'' x of x = q' (transposed: J^T, of x = l)."""
    if order == 0:
        return np.zeros((len(q), arm.n if transposed else 2))
    Js = [arm.jacobian_rate(q, rates[0])] + ([arm.jacobian_second_rate(q, rates[0], rates[1])] if order > 1 else [])
    Js = [np.swapaxes(J, 1, 2) for J in Js] if transposed else Js
    return _times(Js[0], terms[0]) if order == 1 else 2.0 * _times(Js[0], terms[1]) + _times(Js[1], terms[0])


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
