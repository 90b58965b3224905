"""Velocities and accelerations of sampled configurations, on the manifold, with the noise that the samples cause in them.

Positions and angles are differentiated as numbers, a free base's position in world axes, so that a flight is exact; rotations
by the logarithms of the rotations within a window relative to its frame, so that a constant spin is exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from scipy.linalg import solveh_banded

from rbd.arrays import Array, as_array, as_finite, as_float, check_number, check_positive, check_whole
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_choice, check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import conjugate, flat_coordinates, logarithm, own_rates, product, quaternions

Method: TypeAlias = Literal["local polynomial", "low-pass"]
NEARLY_UNIT = 0.05
"""Quaternions off the unit sphere by up to this are normalised, as retargeting and decimals leave them; beyond it, refused."""
UNIFORM = 1e-6
"""Time steps count as equal within this share of them."""
CHUNK = 4096
"""Frames differentiated at once: windows of a million would not fit into memory."""
SMOOTHED = 7
"""Frames of the window, of order 6, that differentiates what a low-pass has smoothed."""
LOWEST = 0.005
"""Least cut-off over the rate: below it the smoother's matrix is singular to rounding."""


@dataclass(frozen=True, eq=False)
class Derivation(Displayed):
    """How v and a of a motion came from q, and the noise in them.

    Attributes:
        method: "local polynomial", a least-squares fit in a window around each frame (Savitzky-Golay), or "low-pass", q
            smoothed without delay first.
        window: From the first frame of a window to its last [s].
        order: Order of the polynomial.
        cutoff: Frequency at which half of an acceleration's amplitude is left [Hz]; of a low-pass, half of a position's.
        noise_q: Standard deviation of q along each velocity, shape (nv,) [m, rad]: of rounded decimals, or as given.
        noise_v: What it leaves in v, shape (nv,) [m/s, rad/s], half a window from the ends and more.
        noise_a: What it leaves in a, shape (nv,) [m/s2, rad/s2], likewise.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> t = np.linspace(0.0, 1.0, 61)
        >>> how = rbd.motion.derivatives(solo, t, np.tile(solo.standing().q, (61, 1)), noise=1e-4)[2]
        >>> print(how.method, f"{how.noise_v[6]:.1e} rad/s, {how.noise_a[6]:.1e} rad/s2")
        local polynomial 1.1e-03 rad/s, 5.9e-02 rad/s2
    """

    method: Method
    window: float
    order: int
    cutoff: float
    noise_q: Array
    noise_v: Array
    noise_a: Array

    def __str__(self) -> str:
        how = f"a polynomial of order {self.order} over {self.window:.3g} s"
        if self.method == "low-pass":
            how = f"a low-pass without delay, then {how}"
        noise = float(self.noise_a.max(initial=0.0))
        told = f"; noise of q leaves up to {noise:.2g} in them [m/s2, rad/s2]" if noise else ""
        return f"{how}; half of an acceleration at {self.cutoff:.3g} Hz is left{told}"


def derivatives(
    robot: CheckedModel,
    t: Array,
    q: Array,
    *,
    window: float = 0.2,
    order: int = 4,
    method: Method = "local polynomial",
    cutoff: float | None = None,
    noise: float | Array = 0.0,
) -> tuple[Array, Array, Derivation]:
    """(v, a, how they came from q): velocities and accelerations of sampled configurations, each of shape (n, nv).

    Windows at the ends are one-sided, and less exact. Times may be unequal for a local polynomial; a low-pass needs equal ones.

    Args:
        robot: The robot.
        t: Times, shape (n,) [s], increasing; two frames or more.
        q: Configurations, shape (n, nq).
        window: Length of the windows [s]; at least `order + 2` frames, where there are as many.
        order: Order of the polynomials, 2 to 8. Away from the ends 2 and 3 give one a, and so do 4 and 5, which reaches
            about twice as high a frequency, with four times the noise.
        method: "local polynomial" or "low-pass".
        cutoff: Of a low-pass, where half of an amplitude is left [Hz]; window and order are then not used.
        noise: Standard deviation of q along each velocity, a number or shape (nv,) [m, rad].

    Raises:
        InputError: sizes that do not fit, times that do not increase, numbers that are not finite, or settings out of range.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> t = np.linspace(0.0, 1.0, 101)
        >>> v, a, how = rbd.motion.derivatives(arm, t, np.sin(3.0 * t)[:, None])
        >>> print(f"{v[50, 0]:.3f} {3.0 * np.cos(1.5):.3f}, {a[50, 0]:.3f} {-9.0 * np.sin(1.5):.3f}")  # found and exact
        0.212 0.212, -8.977 -8.977
    """
    check_kind("robot", robot, CheckedModel, "a robot: rbd.load_robot('g1')")
    t = checked_times(t)
    q = as_finite("q", q, (len(t), robot.nq), meaning=": a row a time, a column a coordinate")
    check_choice("method", method, get_args(Method))
    if len(t) < 2:
        raise InputError(f"{len(t)} frame has no velocity; expected two frames or more, or v and a with q.")
    sigma = as_array("noise", noise)
    if sigma.shape not in ((), (robot.nv,)) or not (sigma >= 0.0).all() or not (sigma <= 1e5).all():
        raise InputError(f"noise is {noise!r:.80}; expected a standard deviation, a number or shape ({robot.nv},) [m, rad].")
    sigma = np.broadcast_to(sigma, robot.nv).copy()
    dt = check_number("the mean step of the times", float(t[-1] - t[0]) / (len(t) - 1), 1e-7, 1e5, expected="1e-7 to 1e5 s")
    smoother = None
    if method == "low-pass":
        if cutoff is None:
            raise InputError("a low-pass needs its cut-off: cutoff=6.0 [Hz].")
        smoother = check_cutoff(cutoff, t)
        q, frames, order = low_passed(robot, q, smoother), SMOOTHED, 6
    else:
        order = check_whole("order", order, 8, least=2)
        frames = _window(t, window, order)
    frames = min(frames, len(t))
    order = min(order, frames - 1)
    v, a = np.empty((len(t), robot.nv)), np.zeros((len(t), robot.nv))
    for part in _parts(t, frames, order):
        v[part.rows], a[part.rows] = _derived(robot, q[part.near], part)
    gain_v, gain_a, half_left = _response(dt, frames, order, smoother)
    half_left = half_left if cutoff is None or smoother is None else float(cutoff)
    how = Derivation(method, (frames - 1) * dt, order, half_left, sigma, gain_v * sigma, gain_a * sigma)
    return v, a, how


def stencil_derivatives(robot: CheckedModel, t: Array, q: Array) -> tuple[Array, Array]:
    """(v, a) at the middle of each group of five frames, by the polynomial of order 4 through them, shape (n / 5, nv)."""
    found = [_derived(robot, q[part.near], part) for part in _parts(t, 5, 4)]
    return np.concatenate([v for v, _ in found])[2::5], np.concatenate([a for _, a in found])[2::5]


def derived_again(robot: CheckedModel, t: Array, q: Array, how: Derivation) -> tuple[Array, Array, Derivation]:
    """The same of other frames, with the settings and the noise of q of an earlier derivation."""
    cutoff = how.cutoff if how.method == "low-pass" else None
    settings: dict[str, Any] = {"window": how.window or 0.2, "order": max(2, how.order), "method": how.method, "cutoff": cutoff}
    return derivatives(robot, t, q, **settings, noise=how.noise_q)


def derivative(t: Array, x: Array, *, window: float = 0.2, order: int = 4) -> Array:
    """The derivative of sampled numbers, shape (n, k), by local polynomials; arguments as `derivatives`."""
    if len(t) < 2:
        raise InputError("one frame has no acceleration; give a with v.")
    order = check_whole("order", order, 8, least=2)
    frames = _window(t, window, order)
    out = np.empty(x.shape)
    for part in _parts(t, frames, min(order, frames - 1)):
        out[part.rows] = np.einsum("iw,iwk->ik", part.once, x[part.near][part.windows])
    return out


def checked_times(t: Array) -> Array:
    """Times as an array that increases.

    Raises:
        InputError: naming the first two that do not.
    """
    t = as_finite("t", t, ("n",), meaning=": a time for each frame")
    if not len(t):
        raise InputError("t is empty; expected a time for each frame.")
    bad = np.flatnonzero(~(np.diff(t) > 0.0))
    if len(bad):
        i = int(bad[0])
        raise InputError(
            f"times do not increase: t[{i}] = {t[i]:.9g} s, t[{i + 1}] = {t[i + 1]:.9g} s. Sort the frames, leave out "
            "repeated ones."
        )
    return t


def is_uniform(t: Array, tolerance: float = UNIFORM) -> bool:
    """Whether all time steps are equal, to a share of them."""
    if len(t) < 3:
        return True
    even = np.linspace(t[0], t[-1], len(t))
    return bool(np.abs(t - even).max() <= tolerance * (t[-1] - t[0]) / (len(t) - 1))


def check_cutoff(cutoff: float, t: Array) -> float:
    """The cut-off over the rate.

    Raises:
        InputError: no number that this rate can have, or unequal times.
    """
    if len(t) < 4:
        raise InputError(f"a low-pass needs four frames or more; here are {len(t)}.")
    if not is_uniform(t):
        raise InputError("a low-pass needs equal time steps; resample the motion first: motion.resample(rate).")
    rate = (len(t) - 1) / float(t[-1] - t[0])
    share = as_float(cutoff) / rate
    if not LOWEST <= share <= 0.5:
        raise InputError(
            f"cutoff is {cutoff!r:.80}; expected {LOWEST * rate:.3g} to {0.5 * rate:.3g} Hz at a rate of {rate:.6g} Hz."
        )
    return share


def low_passed(robot: CheckedModel, q: Array, share: float) -> Array:
    """Configurations smoothed without delay: half of an amplitude is left at `share` of the rate, shape (n, nq).

    Whittaker's smoother of third differences, whose response 1 / (1 + (f / cutoff)^6) is that of Butterworth's filter run
    forwards and backwards, and which needs nothing beyond the ends. Quaternions, and circles, are smoothed as numbers of
    continuous sign and divided by their norm: a constant spin remains as it is.
    """
    x = q.copy()
    units = unit_blocks(robot)
    for block in units:
        if block.stop - block.start == 4:
            x[:, block] = continuous(x[:, block])
    x = _smoothed(x, share)
    for block in units:
        x[:, block] /= np.linalg.norm(x[:, block], axis=1)[:, None]
    return x


def unit_blocks(robot: CheckedModel) -> list[slice]:
    """Which parts of q must have norm one: quaternions and unit circles."""
    units = [(p, p.unit) for p in robot.joints.pieces]
    return [slice(p.q + u.start, p.q + u.stop) for p, u in units if u.start < u.stop]


def continuous(x: Array) -> Array:
    """Quaternions with the signs that make each nearest to the one before, shape (n, 4)."""
    turns = np.where((x[1:] * x[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    return x * np.concatenate([[1.0], np.cumprod(turns)])[:, None]


def _smoothed(x: Array, share: float) -> Array:
    n = len(x)
    if n < 4:
        return x
    weight = (2.0 * math.sin(math.pi * share)) ** -6
    bands = np.zeros((4, n))
    difference = np.array([-1.0, 3.0, -3.0, 1.0])
    for lag in range(4):
        for k in range(4 - lag):  # D^T D for D with a third difference a row
            bands[lag, k : k + n - 3] += difference[k] * difference[k + lag]
    bands *= weight
    bands[0] += 1.0
    return np.asarray(solveh_banded(bands, x, lower=True))


def _window(t: Array, window: float, order: int) -> int:
    """How many frames a window has."""
    dt = float(t[-1] - t[0]) / (len(t) - 1)
    half = min(0.5 * check_positive("window", window, 1e6) / dt, len(t))
    return min(max(2 * round(half) + 1, order + 2 + order % 2), len(t))


class _Part(NamedTuple):
    """Frames that are differentiated at once: which, those in their windows, and the weights of these."""

    rows: slice
    near: slice
    own: slice  # the rows, within near
    windows: Array  # (i, w), within near
    once: Array  # (i, w)
    twice: Array


def _derived(robot: CheckedModel, q: Array, part: _Part) -> tuple[Array, Array]:
    """(v, a) of the rows of a part, from the configurations near it."""
    x = flat_coordinates(robot, q)[part.windows]
    v, a = (np.einsum("iw,iwk->ik", weights, x) for weights in (part.once, part.twice))
    for at, spin in quaternions(robot):
        turns = logarithm(product(conjugate(q[part.own, at])[:, None], q[:, at][part.windows]))
        v[:, spin], a[:, spin] = (np.einsum("iw,iwk->ik", weights, turns) for weights in (part.once, part.twice))
    return own_rates(robot, q[part.own], v, a)


def _parts(t: Array, frames: int, order: int) -> Iterator[_Part]:
    """All frames in parts of a few thousand, with windows around each, one-sided at the ends."""
    even = (t[-1] - t[0]) / (len(t) - 1) if is_uniform(t) else None
    for begin in range(0, len(t), CHUNK):
        end = min(begin + CHUNK, len(t))
        at = np.arange(begin, end)
        first = np.clip(at - frames // 2, 0, len(t) - frames)
        near = slice(int(first[0]), int(first[-1]) + frames)
        if even is None:
            once, twice = _fit(t[first[:, None] + np.arange(frames)] - t[at][:, None], order)
        else:
            offsets, same = np.unique(first - at, return_inverse=True)
            few = _fit((offsets[:, None] + np.arange(frames)) * even, order)
            once, twice = few[0][same], few[1][same]
        own, windows = slice(begin - near.start, end - near.start), first[:, None] + np.arange(frames) - near.start
        yield _Part(slice(begin, end), near, own, windows, once, twice)


def _fit(times: Array, order: int) -> tuple[Array, Array]:
    """Weights of the first and second derivative at zero of the polynomial fitted to values at these times, (i, w) each."""
    scale = np.abs(times).max(axis=1)
    powers = (times / scale[:, None])[:, :, None] ** np.arange(order + 1)
    inverse = np.linalg.pinv(powers)
    twice = 2.0 * inverse[:, 2] / scale[:, None] ** 2 if order >= 2 else np.zeros(times.shape)
    return inverse[:, 1] / scale[:, None], twice


def _response(dt: float, frames: int, order: int, smoother: float | None) -> tuple[float, float, float]:
    """(noise of v over that of q, noise of a over it, frequency at which half of a is left [Hz]), away from the ends."""
    times = (np.arange(frames) - frames // 2) * dt
    once, twice = (x[0] for x in _fit(times[None], order))
    if smoother is not None:
        n = 2 * max(64, math.ceil(4.0 / smoother)) + 1
        impulse = np.zeros((n, 1))
        impulse[n // 2] = 1.0
        answer = _smoothed(impulse, smoother)[:, 0]
        once, twice = np.convolve(answer, once), np.convolve(answer, twice)
        times = (np.arange(len(twice)) - (len(twice) // 2)) * dt
    f = np.linspace(0.0, 0.5 / dt, 2001)[1:]
    left = -(np.cos(2.0 * math.pi * f[:, None] * times) @ twice) / (2.0 * math.pi * f) ** 2
    below = np.flatnonzero(left < 0.5)
    return math.sqrt(once @ once), math.sqrt(twice @ twice), float(f[below[0]] if len(below) else f[-1])
