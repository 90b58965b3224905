"""What is to be said of a repaired motion: what was changed, how far it is from its reference, what is not possible and why."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.motion.contact_timeline import stretches
from rbd.motion.frame_terms import placements
from rbd.motion.reference_motion import Motion
from rbd.motion.repair.feet import rotation_vectors
from rbd.motion.repair.repairing import Repaired

TOGETHER = 0.1
"""Times that are this near to each other are told as one [s]."""
TOLD = 12
"""So many are told one by one."""
TURNS, TILTS, REACH = math.radians(45.0), math.radians(15.0), 1e-3
"""A foot that turns by more while it stands [rad], is tilted by more [rad], or misses its place by more [m], is a reason."""


def notes_of(
    found: Repaired, motion: Motion, before: Motion, share: float, possible: Array, causes: Callable[[int, int], list[str]]
) -> tuple[str, ...]:
    """The notes of a repaired motion.

    Args:
        found: How it was found.
        motion: The repaired motion.
        before: The reference.
        share: Share of the reference's frames that are possible.
        possible: Which of the repaired are, shape (n,).
        causes: In words, of frames from one up to another.
    """
    course = found.course
    out = [
        f"repaired {before.source}: {possible.mean():.1%} of its frames are possible, {share:.1%} were.",
        f"{len(course.stances)} stances, moved along the floor by up to {1e3 * found.moved.max(initial=0.0):.0f} mm.",
    ]
    raised = found.course.ground - found.floor
    if abs(raised) >= 5e-4:
        way = "raised" if raised > 0.0 else "lowered"
        out.append(f"the reference was {way} by {1e3 * abs(raised):.0f} mm to the floor at z = {course.ground:g} m.")
    out.append(_far(found))
    names = [c.name for c in found.contacts]
    runs: list[tuple[int, int]] = []
    for a, b in stretches(~possible):
        if runs and motion.t[a] - motion.t[runs[-1][1] - 1] < TOGETHER:
            runs[-1] = (runs[-1][0], b)
        else:
            runs.append((a, b))
    for a, b in sorted(runs, key=lambda run: run[0] - run[1])[:TOLD]:
        why = [*reasons(found, names, float(motion.t[a]), float(motion.t[b - 1])), *causes(a, b)]
        out.append(f"not possible from {motion.t[a]:.2f} to {motion.t[b - 1]:.2f} s: {'; '.join(why)}.")
    if len(runs) > TOLD:
        out.append(f"and in {len(runs) - TOLD} more stretches of time, shorter ones.")
    return tuple(out)


def reasons(found: Repaired, names: list[str], start: float, end: float) -> list[str]:
    """What stances ask of feet between two times that they cannot do, in words."""
    course, out = found.course, []
    feet, dt = course.feet, course.reference.dt
    first, last = ((time - found.start) / dt for time in (start, end))
    for s in course.stances:
        if s.first > last or s.last < first:
            continue
        name = names[s.foot]
        if feet.flat[s.foot]:
            turn, tilt = np.ptp(feet.yaw[s.frames, s.foot]), np.arccos(feet.R[s.frames, s.foot, 2, 2].clip(-1.0, 1.0)).max()
            if turn > TURNS:
                out.append(f"{name} turns by {math.degrees(turn):.0f} degrees while it stands")
            if tilt > TILTS:
                out.append(f"{name} is tilted by {math.degrees(tilt):.0f} degrees while it stands")
        miss = float(np.linalg.norm(found.foot_errors[s.frames, s.foot, :3], axis=1).max())
        if miss > REACH:
            out.append(f"{name} does not reach its place, by {1e3 * miss:.0f} mm")
    return out


def _far(found: Repaired) -> str:
    """How far the poses are from the reference, in words."""
    reference, sweep = found.course.reference, found.sweep
    robot = reference.robot
    off = np.array([pin.difference(robot.model, a, b) for a, b in zip(reference.q, sweep.q, strict=True)])
    joints = off[:, robot.actuated]
    worst = np.unravel_index(np.abs(joints).argmax(), joints.shape)
    R, p = placements(robot, reference.q)
    at, turn = sweep.p[:, 1] - p[:, 1], np.linalg.norm(rotation_vectors(sweep.R[:, 1].swapaxes(1, 2) @ R[:, 1]), axis=1)
    unit = robot.motor_coordinates[worst[1]].unit
    return (
        f"from the reference: joints {np.sqrt(np.square(joints).mean()):.3f} in the root mean square, "
        f"{robot.actuated_names[worst[1]]} by up to {abs(joints[worst]):.2f} {unit}; the base by up to "
        f"{1e3 * np.linalg.norm(at, axis=1).max():.0f} mm and {math.degrees(turn.max()):.0f} degrees."
    )
