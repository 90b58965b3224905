"""`check_motion`: whether a robot can perform a motion, frame by frame; if not, for which cause and by how much."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rbd.arrays import Array, as_finite, check_flag, check_number
from rbd.constraints.contact import Contact
from rbd.constraints.convex.polygons import convex_hull, half_planes
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.motion import causes as why
from rbd.motion.check_settings import CheckSettings
from rbd.motion.contact_detection import NOISE, TOUCH_HEIGHT, TOUCH_SPEED, find_contacts
from rbd.motion.contact_lanes import REST_SPEED, TOUCHES_M
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.frame_terms import FrameTerms, check_robot, placements, wrench_scale
from rbd.motion.grasps import Grasps
from rbd.motion.missing_wrench import least_effort, nearest_acceleration
from rbd.motion.reference_motion import Motion
from rbd.motion.report import HEIGHTS, MotionReport
from rbd.motion.self_collision import self_collisions
from rbd.simulation.progress_bar import progress_of
from rbd.solvers.cone_least_squares import nearest_in_cones
from rbd.workers import one_blas_thread

BLOCK = 2048
"""Frames computed at once: those of an hour would not fit into memory."""
FEW = 16
"""Contact points up to which a block has `BLOCK` frames; with more points, blocks have fewer frames in proportion."""
CARRIED = 1e-3
"""A sole that carries less of the weight has no centre of pressure to speak of."""
OPEN = 3.0
"""A wrench is missing where it is more than this many times what differentiation leaves open."""


def check_motion(
    motion: Motion,
    *,
    friction: float = 0.7,
    torque_limits: bool | float = True,
    contacts: ContactTimeline | None = None,
    ground: float | str | Terrain | None = None,
    threshold: float = 0.02,
    bodies: bool = False,
    self_collision: bool = True,
    torque_speed: Mapping[str, tuple[float, float]] | None = None,
    touch_height: float = TOUCH_HEIGHT,
    touch_speed: float = TOUCH_SPEED,
    rest_speed: float = REST_SPEED,
    grasp_tolerance: tuple[float, float] = (0.01, 0.1),
    progress: bool = True,
) -> MotionReport:
    """Which frames of a motion are possible, and why the others are not.

    In each frame the forces at the points that touch are sought, in circular friction cones, that leave the least wrench
    missing on the base: forces over the weight, moments about the centre of mass over 0.3 m times the weight, in the 2-norm. A
    frame balances if that is at most `threshold`, or three times what noise of the accelerations leaves open. With the same net
    wrench those forces are then chosen whose torques are least; none may exceed its limit. Sinking, sliding, limits of joints
    and speeds, jumps in the data and self-collision are read from the motion. A frame without any of these causes is possible.

    Contacts are those meant (`find_contacts`). Where the points on the floor do not do, those raised above it are taken as
    well, and the frame has the cause "tilted sole" or "hovering foot".

    Args:
        motion: The motion.
        friction: Coulomb's coefficient of the floor.
        torque_limits: Whether the robot's torque limits count, and the torque-speed lines of its `rbd.Motor`s; or a share of
            them, 0.6.
        contacts: Which points touch, when; None: `motion.contacts`, or what `find_contacts` finds.
        ground: Height of the floor, "fit", or an `rbd.Terrain`, whose own friction counts where it has one; by default fitted,
            see `find_contacts`.
        threshold: How much of the weight may be missing.
        bodies: Whether other bodies than the feet can touch the floor.
        self_collision: Whether bodies are tested against each other.
        torque_speed: {joint: (stall torque [N m], no-load speed [rad/s])}: less torque at higher speed, in a straight line;
            besides the lines of `robot.with_motors`.
        touch_height: Height up to which a foot is meant to touch [m]; see `find_contacts`.
        touch_speed: Speed up to which it is meant to [m/s].
        rest_speed: Fastest motion of a point that holds [m/s].
        grasp_tolerance: By how much two hands may leave the grasp of an object that both hold [m, rad]; see `robot.carrying`.
        progress: Show a bar on a terminal where it takes long.

    Raises:
        InputError: of what is no motion, no coefficient, no share; a robot without a floating base, with passive joints or
            loops; contacts of another motion.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0)
        >>> report = rbd.check_motion(hop)
        >>> print(f"{report.share_possible:.0%}", [c for c in rbd.motion.CAUSES if report.of_cause(c).any()])
        23% ['floats']
    """
    check_kind("motion", motion, Motion, "an rbd.Motion: rbd.Motion.read('dance.csv', robot='g1')")
    robot = motion.robot
    check_robot(robot)
    shares = (("friction", friction), ("threshold", threshold))
    mu, most = (check_number(what, x, 0.0, 1e6, expected="a number of 0 or more") for what, x in shares)
    limit = _limits(robot.effort_limit, torque_limits)
    check_flag("self_collision", self_collision)
    check_flag("bodies", bodies)
    check_flag("progress", progress)
    bounds = why.torque_bounds(robot, motion.v, torque_limits, torque_speed)
    settings = CheckSettings(
        mu, torque_limits, ground, most, bodies, self_collision, torque_speed, touch_height, touch_speed, rest_speed,
        _grasp_tolerance(grasp_tolerance),
    )  # fmt: skip
    lanes = _lanes(motion, contacts, settings)
    if isinstance(lanes.ground, Terrain) and lanes.ground.friction is not None:
        settings = replace(settings, friction=(mu := lanes.ground.friction))
    span = (0.0, float(motion.n))
    with one_blas_thread(), progress_of(span, shown=progress and motion.n > BLOCK, doing=f"checking {motion.source}") as told:
        found = balance(motion, lanes, settings, limit, bounds, told)
    collisions = self_collisions(robot, motion.q, *placements(robot, motion.q)) if self_collision else None
    masks = {
        "sinks": (lanes.heights < -why.SINKS_M).any(axis=1) | (lanes.heights_over(motion.q[:, :3]) < 0.0),
        "joint limit": why.beyond_position(motion).any(axis=1),
        "speed limit": why.beyond_speed(motion).any(axis=1),
        "torque-speed": why.beyond_curves(found["tau"], bounds, limit),
        "jump": why.jumps(motion),
        "self-collision": False if collisions is None else collisions.inside,
        "grasp": (Grasps.of(robot, motion.q).errors > settings.grasp_tolerance).any(axis=(1, 2)),
    }
    for name, mask in masks.items():
        found["causes"][:, why.CAUSES.index(name)] = mask
    weight = wrench_scale(robot)[0]
    return MotionReport(
        motion, lanes, settings, limit, **found,
        used_friction=_used_friction(lanes, found["forces"], weight, mu),
        edge_margin=_edge_margins(lanes, found["forces"], weight),
        check=partial(check_motion, **vars(settings)), collisions=collisions,
    )  # fmt: skip


def balance(
    motion: Motion,
    lanes: ContactTimeline,
    settings: CheckSettings,
    limit: Array,
    bounds: tuple[Array, Array],
    done: Callable[[float], None],
) -> dict[str, Any]:
    """What is missing in each frame, with forces, torques and the causes that dynamics knows; names as of `MotionReport`.

    Args:
        motion: The motion.
        lanes: Its contacts.
        settings: Friction and threshold.
        limit: Torque limits, shape (nu,).
        bounds: Least and largest torques of each frame, shapes (n, nu).
        done: Called with the number of frames that are done, after each block.
    """
    robot, mu = motion.robot, settings.friction
    n, nu = motion.n, robot.nu
    out: dict[str, Any] = {
        "causes": np.zeros((n, len(why.CAUSES)), bool), "missing": np.zeros((n, 6)), "missing_scaled": np.zeros(n),
        "open": np.zeros(n), "missing_on_floor": np.zeros(n), "reach": np.zeros(n),
        "forces": np.zeros((n, len(lanes.points), 3)), "tau": np.zeros((n, nu)),
        "excess": np.zeros((n, nu)), "nearest_a": motion.a.copy(),
    }  # fmt: skip
    scale = wrench_scale(robot)
    sigma = None if motion.derivation is None else motion.derivation.noise_a
    names = {name: i for i, name in enumerate(why.CAUSES)}
    most_torque = np.maximum(-bounds[0], bounds[1]).max(axis=0, initial=0.0)
    step = max(BLOCK * FEW // max(len(lanes.points), FEW), 32)
    for begin in range(0, n, step):
        at = slice(begin, begin + step)
        terms = FrameTerms.of(robot, motion.q[at], motion.v[at], motion.a[at], sigma)
        used = np.asarray(lanes.touches[at].any(axis=0))
        points, places, touches = lanes.points.some(used), lanes.places[at][:, used], lanes.touches[at][:, used]
        axes = None if lanes.axes is None else lanes.axes[at][:, used]
        all_A = terms.wrench_map(places, touches, axes) * (scale[0] / scale)[:, None, None]
        b, most = terms.wrench / scale, np.maximum(settings.threshold, OPEN * terms.wrench_noise)
        carry = _carrying(all_A, b, lanes.at_frames(at), used, most, mu)
        A, left, size, touches = carry.A, carry.left, np.linalg.norm(carry.left, axis=1), touches & carry.taken
        out["reach"][at], out["missing_on_floor"][at] = carry.reach, carry.on_floor
        for name, mask in carry.causes.items():
            out["causes"][at, names[name]] = mask
        out["missing"][at], out["missing_scaled"][at], out["open"][at] = left * scale, size, terms.wrench_noise
        now = bounds[0][at], bounds[1][at]
        forces, tau = least_effort(terms, points, places, touches, A, b - left, carry.w, mu, most_torque, now, axes)
        forces = forces if axes is None else np.matmul(axes, forces[..., None])[..., 0]
        out["forces"][at.start : at.stop, used], out["tau"][at] = forces, tau
        noise = NOISE * terms.M_size[:, robot.actuated] / limit
        over = np.maximum(np.abs(tau) / limit - 1.0, 0.0)
        out["excess"][at] = excess = np.where(over > why.EXCESS + noise, over, 0.0)
        out["causes"][at, names["motor"]] = excess.any(axis=1)
        bad = np.flatnonzero(size > most)
        if len(bad):
            some, own = terms.some(bad), None if axes is None else axes[bad]
            level = lanes.ground
            if isinstance(level, Terrain):  # a floor as low as the lowest point that touches
                level = np.where(touches[bad], places[bad, :, 2], np.inf).min(axis=1, initial=1e3)
            told = why.without_balance(some, places[bad], touches[bad], b[bad], most[bad], mu, level, own)
            for name, mask in zip(("floats", "friction", "tips"), told, strict=True):
                out["causes"][begin + bad, names[name]] = mask
            out["nearest_a"][begin + bad] = nearest_acceleration(some, motion.a[at][bad], places[bad], touches[bad], mu, own)
        done(float(begin + step))
    return out


@dataclass(frozen=True, eq=False)
class _Carrying:
    """Which points carry in n frames, and what is missing then.

    Attributes:
        A: Scaled map of their forces, shape (n, 6, k, 3).
        taken: Which points are taken, shape (n, k): those on the floor where these do, else all that touch as meant.
        w: Forces over the weight, shape (n, k, 3).
        left: The missing wrench over its scale, shape (n, 6).
        on_floor, reach: As `missing_on_floor` and `reach` of `MotionReport`, shapes (n,).
        causes: {cause of feet: its frames}.
    """

    A: Array
    taken: Array
    w: Array
    left: Array
    on_floor: Array
    reach: Array
    causes: dict[str, Array]


def _carrying(all_A: Array, b: Array, lanes: ContactTimeline, used: Array, most: Array, mu: float) -> _Carrying:
    slides, raised, heights = lanes.slides[:, used], lanes.raised[:, used], lanes.heights[:, used]
    A, taken, reach = np.where(raised[:, None, :, None], 0.0, all_A), ~raised, np.full(len(b), np.inf)
    fit = nearest_in_cones(A, b, mu)
    w, left, size = fit.w, fit.left, np.linalg.norm(fit.left, axis=1)
    slipping = why.needed(A, b, slides & taken, size, most, mu)
    reach[(size <= most) & ~slipping] = 0.0
    on_floor, (tilted, hovers) = size.copy(), np.zeros((2, len(b)), bool)
    lift = np.flatnonzero((size > most) & raised.any(axis=1))
    if len(lift):
        group, points = lanes.points.group[used], lanes.points
        down = points.group_reduced(np.logical_or, lanes.on_floor)[:, group]
        higher = heights - points.group_reduced(np.minimum, lanes.heights)[:, group] > TOUCHES_M  # than its own lowest corner
        A[lift], taken[lift] = all_A[lift], True
        fit = nearest_in_cones(A[lift], b[lift], mu)
        w[lift], left[lift], size[lift] = fit.w, fit.left, np.linalg.norm(fit.left, axis=1)
        some = A[lift], b[lift]
        slipping[lift] = why.needed(*some, slides[lift], size[lift], most[lift], mu)
        off = [(raised & each)[lift] for each in (down | higher, ~down)]
        tilted[lift], hovers[lift] = why.needs_raised(*some, off[0], off[1], size[lift], most[lift], mu)
    for height in HEIGHTS[1:]:
        at = np.flatnonzero(np.isinf(reach) & raised.any(axis=1))
        no = slides[at] | (raised[at] & (heights[at] > height))
        rest = nearest_in_cones(np.where(no[:, None, :, None], 0.0, all_A[at]), b[at], mu).left
        reach[at[np.linalg.norm(rest, axis=1) <= most[at]]] = height
    return _Carrying(A, taken, w, left, on_floor, reach, {"slides": slipping, "tilted sole": tilted, "hovering foot": hovers})


def _limits(limit: Array, given: bool | float) -> Array:
    if isinstance(given, bool | np.bool_):
        return limit if given else np.full_like(limit, np.inf)
    expected = "True, False, or a share of the file's limits, 0.6"
    return np.asarray(limit * check_number("torque_limits", given, 1e-6, 1e6, expected=expected))


def _grasp_tolerance(given: object) -> tuple[float, float]:
    length, angle = as_finite("grasp_tolerance", given, (2,), meaning="a length [m] and an angle [rad]")
    return float(length), float(angle)


def _lanes(motion: Motion, contacts: ContactTimeline | None, settings: CheckSettings) -> ContactTimeline:
    given = motion.contacts if contacts is None else contacts
    if given is None:
        names = ("bodies", "ground", "touch_height", "touch_speed", "rest_speed")
        return find_contacts(motion, **{name: getattr(settings, name) for name in names})
    check_kind("contacts", given, ContactTimeline, "ContactTimeline: rbd.motion.find_contacts(motion)")
    if not motion.robot.is_like(given.points.robot) or len(given.t) != motion.n or not np.array_equal(given.t, motion.t):
        raise InputError("contacts are of another motion: their robot or their times differ. Find those of this one.")
    return given


def _used_friction(lanes: ContactTimeline, forces: Array, weight: float, mu: float) -> Array:
    """|f_t| / (mu f_n) of each contact, shape (n, contacts); NaN where it carries nothing."""
    out = np.full((len(lanes.t), len(lanes.contacts)), np.nan)
    for g in range(len(lanes.contacts)):
        own = lanes.points.group == g
        f = forces[:, own].sum(axis=1)
        if lanes.axes is not None and own.any():
            f = np.matmul(f[:, None], lanes.axes[:, np.flatnonzero(own)[0]])[:, 0]
        on = (f[:, 2] > 1e-6 * weight) & (mu > 0.0)
        out[on, g] = np.hypot(f[on, 0], f[on, 1]) / (mu * f[on, 2])
    return out


def _edge_margins(lanes: ContactTimeline, forces: Array, weight: float) -> Array:
    """Distance of each sole's centre of pressure from its edge [m], shape (n, contacts); NaN where there is none."""
    out = np.full((len(lanes.t), len(lanes.contacts)), np.nan)
    for g, contact in enumerate(lanes.contacts):
        if not isinstance(contact, Contact) or len(contact.corners) < 3:
            continue
        own = np.flatnonzero(lanes.points.group == g)
        push = forces[:, own, 2]
        total = push.sum(axis=1)
        on = total > CARRIED * weight
        centre = push[on, : len(contact.corners)] @ contact.corners[:, :2] / total[on, None]
        normals, offsets = half_planes(convex_hull(contact.corners[:, :2]))
        out[on, g] = (centre @ normals.T - offsets).min(axis=1)
        over = on & (False if lanes.cut is None else lanes.cut[:, own].any(axis=1))
        for i in np.flatnonzero(over):  # within the part that rests
            xy = lanes.places[i, own, :2]
            hull = convex_hull(xy[lanes.touches[i, own]])
            normals, offsets = half_planes(hull) if len(hull) > 2 else (np.zeros((1, 2)), np.zeros(1))
            out[i, g] = (normals @ (push[i] @ xy / total[i]) - offsets).min()
    return out
