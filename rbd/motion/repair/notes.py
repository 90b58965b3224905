"""What is to be said of a repaired motion: what was changed, how far it is from its reference, what is not possible and why."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rbd.arrays import Array
from rbd.motion.causes import CAUSES
from rbd.motion.contact_timeline import stretches
from rbd.motion.difference import MotionDifference
from rbd.motion.grasps import Grasps
from rbd.motion.reference_motion import Motion
from rbd.motion.repair.repairing import Course, Repaired
from rbd.motion.repair.sweep import Sweep
from rbd.records import counted

TOGETHER = 0.1
"""Times that are this near to each other are told as one [s]."""
TOLD = 12
"""So many are told one by one."""
MOVES, TURNS, TILTS, REACH = 0.1, math.radians(45.0), math.radians(15.0), 1e-3
"""A foot that moves by more [m], turns or tilts by more [rad] while it stands, or misses its place by more [m] is a reason."""


def notes_of(
    found: Repaired, motion: Motion, before: Motion, was: Array, now: Array, causes: Callable[[int, int], list[str]]
) -> tuple[str, ...]:
    """The notes of a repaired motion.

    Args:
        found: How it was found.
        motion: The repaired motion.
        before: The reference.
        was: Causes against frames of the reference, shape (n, len(CAUSES)).
        now: Causes against those of the repaired motion, shape (n, len(CAUSES)).
        causes: In words, of frames from one up to another.
    """
    course, possible = found.course, np.asarray(~now.any(axis=1))
    share = 1.0 - float(was.any(axis=1).mean())
    out = [f"repaired {before.title}: {possible.mean():.1%} of its frames are possible, {share:.1%} were."]
    out += new_faults(motion.t, was, now)
    out += new_rate(motion, before)
    out.append(f"{len(course.stances)} stances, moved along the floor by up to {1e3 * found.moved.max(initial=0.0):.0f} mm.")
    out += on_edges(course, float(motion.t[0]))
    raised = course.raised
    if abs(raised) >= 5e-4:
        way = "raised" if raised > 0.0 else "lowered"
        out.append(f"the reference was {way} by {1e3 * abs(raised):.0f} mm to the floor at z = {course.ground} m.")
    out.append(_far(course, found.sweep))
    grasps = Grasps.of(motion.robot, motion.q)
    if grasps.things:
        out.append(f"hands leave the grasp {grasps.words(0, motion.n)} at most.")
    names = [c.name for c in course.contacts]
    runs = together(motion.t, ~possible)
    for a, b in sorted(runs, key=lambda run: run[0] - run[1])[:TOLD]:
        why = [*reasons(found, names, float(motion.t[a]), float(motion.t[b - 1])), *causes(a, b)]
        out.append(f"not possible from {motion.t[a]:.2f} to {motion.t[b - 1]:.2f} s: {'; '.join(why)}.")
    if len(runs) > TOLD:
        out.append(f"and in {len(runs) - TOLD} more stretches of time, shorter ones.")
    return tuple(out)


def new_faults(t: Array, was: Array, now: Array) -> list[str]:
    """In which frames a motion has a kind of fault that it had not before, in words: one line, or none.

    Args:
        t: Times of the frames, shape (n,) [s].
        was: Causes against them before, shape (n, len(CAUSES)).
        now: Causes against them now, shape (n, len(CAUSES)).
    """
    new = now & ~was
    counts = sorted(((int(count), cause) for cause, count in zip(CAUSES, new.sum(axis=0), strict=True) if count), reverse=True)
    if not counts:
        return []
    runs = sorted(sorted(together(t, np.asarray(new.any(axis=1))), key=lambda run: run[0] - run[1])[:TOLD])
    times = ", ".join(f"{t[a]:.2f}" + (f" to {t[b - 1]:.2f}" if b > a + 1 else "") for a, b in runs)
    kinds = ", ".join(f"{cause} in {count}" for count, cause in counts)
    return [f"new faults in {counted(int(new.any(axis=1).sum()), 'frame')}: {kinds}; at {times} s."]


def new_rate(motion: Motion, before: Motion) -> list[str]:
    """That a slower motion has another rate, in words: one line, or none."""
    if not motion.duration > 1.001 * before.duration:
        return []
    return [f"it has as many frames, so that its rate is {motion.rate:.6g} Hz instead of {before.rate:.6g} Hz."]


def together(t: Array, some: Array) -> list[tuple[int, int]]:
    """(first, end) of stretches of frames, those as one between which less than `TOGETHER` passes.

    Args:
        t: Times of the frames, shape (n,) [s].
        some: Which frames, shape (n,).
    """
    runs = list[tuple[int, int]]()
    for a, b in stretches(some):
        if runs and t[a] - t[runs[-1][1] - 1] < TOGETHER:
            runs[-1] = (runs[-1][0], b)
        else:
            runs.append((a, b))
    return runs


def on_edges(course: Course, first: float) -> list[str]:
    """Which stances were put onto their treads, or stand over an edge, in words, the farthest first.

    Args:
        course: The motion.
        first: Its first time [s].
    """
    names, told = [c.name for c in course.contacts], list[tuple[float, str]]()
    for s in course.stances:
        put, over = float(np.linalg.norm(s.put)), s.overhang(course.feet)
        what = f"{names[s.foot]} at {max(course.start + course.feet.dt * s.first, first):.2f} s"
        on = f"{s.tread.name}" if s.tread.name else "its tread"
        if put > REACH:
            why = "more of it than its balance allows was beside it"
            told.append((put, f"{what} was put onto {on}, by {1e3 * put:.0f} mm: {why}."))
        if len(s.part):
            told.append((over, f"{what} stands on {on} with a part of its sole: {on} is too narrow for it."))
        elif over > REACH:
            told.append((over, f"{what} stands {1e3 * over:.0f} mm over the edge of {on}: what carries of it is on it."))
    told.sort(key=lambda each: -each[0])
    more = [f"and {len(told) - TOLD} more stances at edges."] if len(told) > TOLD else []
    return [words for _, words in told[:TOLD]] + more


def reasons(found: Repaired, names: list[str], start: float, end: float) -> list[str]:
    """What stances ask of feet between two times that they cannot do, in words."""
    course, out = found.course, []
    feet, dt = course.feet, course.reference.dt
    first, last = ((time - course.start) / dt for time in (start, end))
    for s in course.stances:
        if s.first > last or s.last < first:
            continue
        name, way = names[s.foot], float(np.ptp(feet.places[s.frames, s.foot, :2], axis=0).max())
        if way > MOVES:
            out.append(f"{name} moves by {1e3 * way:.0f} mm while it stands")
        if feet.flat[s.foot]:
            lean = feet.lean[s.frames, s.foot, None] * np.eye(3)[1]
            turn, tilt = np.ptp(feet.yaw[s.frames, s.foot]), np.linalg.norm(feet.tilt[s.frames, s.foot] - lean, axis=1).max()
            if turn > TURNS:
                out.append(f"{name} turns by {math.degrees(turn):.0f} degrees while it stands")
            if tilt > TILTS:
                out.append(f"{name} is tilted by {math.degrees(tilt):.0f} degrees while it stands")
        miss = float(np.linalg.norm(found.foot_errors[s.frames, s.foot, :3], axis=1).max())
        if miss > REACH:
            out.append(f"{name} does not reach its place, by {1e3 * miss:.0f} mm")
    return out


def _far(course: Course, sweep: Sweep) -> str:
    """How far the poses are from the reference, in words."""
    robot = sweep.robot
    t = course.start + sweep.dt * np.arange(len(sweep.q))
    reference, poses = (Motion(robot, t, q, sweep.v, sweep.a) for q in (course.reference.q, sweep.q))
    off = MotionDifference.of(poses, reference)
    largest = np.abs(off.joints).max(axis=0)
    j = int(largest.argmax())
    return (
        f"from the reference: joints {off.joint_rms:.3f} in the root mean square, {off.names[j]} by up to {largest[j]:.2f} "
        f"{robot.motor_coordinates[j].unit}; the base by up to {1e3 * np.linalg.norm(off.base, axis=1).max():.0f} mm and "
        f"{math.degrees(off.turn.max()):.0f} degrees."
    )
