"""The possible motion nearest to a reference: followed by a whole-body controller, from contact to contact.

At each time a quadratic program chooses accelerations, contact forces and torques within friction and limits that come nearest
to what the reference wants, and the motion is integrated from them: so every instant of it is possible. The centre of mass
follows that of the reference, shifted so that the zero-moment point stays within the contacts (`rbd.motion.balanced_com`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import Contact
from rbd.control import ComTask, FrameTask, PostureTask, Reference, Task
from rbd.control.motion_limits import Limits
from rbd.control.tracking import sampled
from rbd.control.whole_body_step import silent_step
from rbd.errors import NoSolution
from rbd.mechanism.projection import project_velocity
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import cubic
from rbd.model.state import State
from rbd.motion.balanced_com import com_shift, held_places
from rbd.motion.contact_detection import slopes
from rbd.motion.contact_timeline import LANDED, ContactTimeline, FloorContacts, stretches
from rbd.motion.frame_terms import FrameTerms, numbers_of, placements
from rbd.motion.reference_motion import Motion

COM, BASE, POSTURE, FOOT = 100.0, 10.0, 1.0, 100.0
"""Costs of missing what the reference wants: of the centre of mass and feet (m/s2)^2, of the base and joints (rad/s2)^2."""
TORQUE_MARGIN = 0.03
"""Share of the torque limits that is not used: `check_motion` finds torques at a limit to one or two hundredths of it."""
GAIN, FOOT_GAIN = 100.0, 400.0
"""Gains with which it returns to the reference [1/s2]."""
FALLEN = 0.5
"""It has fallen where its centre of mass is below this share of the reference's height ..."""
TIPPED = 1.0
"""... or its base leans by more than this from the reference's [rad]."""
OFF_FLOOR = 5e-3
"""Contacts of the result that are farther than this from the floor are told [m]."""
START_STEPS = 20
"""Newton steps that put the centre of mass of the first frame to where the motion begins."""


@dataclass(frozen=True, eq=False)
class Course:
    """What is followed, at closely spaced times; the lowest points of feet that touch are on the floor.

    Attributes:
        t: Times, shape (n,) [s].
        frame: The frame of the reference at each time or before it, shape (n,).
        q: Shape (n, nq).
        v: Shape (n, nv).
        a: Shape (n, nv).
        shift: Of the centre of mass, with its velocity and acceleration, shape (3, n, 3).
        raised: By how much each contact is raised in the air so that it lands on the floor, shape (n, contacts) [m].
        lifted: By how much the whole reference was raised [m].
    """

    t: Array
    frame: Array
    q: Array
    v: Array
    a: Array
    shift: Array
    raised: Array
    lifted: float

    @classmethod
    def of(cls, motion: Motion, lanes: ContactTimeline, longest: float) -> Course:
        """That of a motion with its contacts, at times `longest` apart at most [s]."""
        t, q, v, a = sampled(motion, longest)
        lifted = -_floor_error(lanes)
        q[:, 2] += lifted
        terms = FrameTerms.of(motion.robot, motion.q, motion.v, motion.a, None)
        held = held_places(lanes.places, lanes.touches, lanes.points.group)
        # The floor stays where it is: heights above it grow by what the reference is raised.
        plan = com_shift(motion.t, terms, held, lanes.touches, lanes.ground - lifted)
        shift = np.zeros((3, len(t), 3))
        if len(motion.t) > 1:
            shift[0, :, :2] = cubic(motion.t, plan.s, plan.rate, t)
            shift[1, :, :2] = cubic(motion.t, plan.rate, plan.acceleration, t)
            for axis in range(2):
                shift[2, :, axis] = np.interp(t, motion.t, plan.acceleration[:, axis])
        frame = np.clip(np.searchsorted(motion.t, t + 1e-9, side="right") - 1, 0, motion.n - 1)
        raised = np.stack([_raised(lanes, g, lifted, t) for g in range(len(lanes.contacts))], axis=1)
        return cls(t, frame, q, v, a, shift, raised, lifted)


def standing(lanes: ContactTimeline) -> ContactTimeline:
    """The same contacts without the frames in which a foot already rises, or is not yet down.

    `find_contacts` lets a point touch from 6 to 10 mm above the floor, as recorded feet hover. Here a contact begins and ends
    where its lowest point is within a millimetre of the median height of the time in which it touches.
    """
    touches = lanes.touches.copy()
    for g in np.unique(lanes.points.group):
        own = lanes.points.group == g
        low = lanes.heights[:, own].min(axis=1)
        for a, b in stretches(np.asarray(lanes.touches[:, own].any(axis=1))):
            down = np.flatnonzero(low[a:b] <= float(np.median(low[a:b])) + LANDED)
            if a > 0:
                touches[a : a + down[0], own] = False
            if b < len(low):
                touches[a + down[-1] + 1 : b, own] = False
    return replace(lanes, touches=touches, slides=lanes.slides & touches)


def _floor_error(lanes: ContactTimeline) -> float:
    """The median over the frames with contact of the height of the lowest point that touches [m]."""
    on = lanes.touches.any(axis=1)
    heights = np.where(lanes.touches, lanes.heights, np.inf)[on]
    return float(np.median(heights.min(axis=1))) if on.any() else 0.0


def _raised(lanes: ContactTimeline, g: int, lifted: float, t: Array) -> Array:
    """By how much a contact must be raised so that its lowest point is on the floor while it touches, shape (len(t),)."""
    own = lanes.points.group == g
    if not own.any():
        return np.zeros(len(t))
    runs = stretches(np.asarray(lanes.touches[:, own].any(axis=1)))
    if not runs:
        return np.zeros(len(t))
    low = lanes.heights[:, own].min(axis=1) + lifted
    error = np.repeat([float(np.median(low[a:b])) for a, b in runs], 2)
    return np.interp(t, lanes.t[[i for a, b in runs for i in (a, b - 1)]], -error)


class _Follower:
    """The tasks, which read the time that is followed now; `State` of the reference there."""

    def __init__(self, course: Course, motion: Motion, feet: Sequence[Constraint]) -> None:
        self.course, self.robot = course, motion.robot
        self.base = motion.robot.model.names[1]
        self.fixed: list[Task] = [
            ComTask(lambda t: Reference(*self.com()), cost=COM, gain=GAIN),
            FrameTask(self.base, lambda t: self._turned(), orientation_cost=BASE, gain=GAIN, name="base"),
        ]
        if motion.robot.nu:
            self.fixed.append(PostureTask(lambda t: Reference(self.now.q, self.now.v, self.a), cost=POSTURE, gain=GAIN))
        self.swings: dict[int, Task] = {
            g: FrameTask(
                foot.frame, self._place(g, foot.frame), position_cost=FOOT, orientation_cost=FOOT, gain=FOOT_GAIN,
                name=f"{foot.name} in the air",
            )
            for g, foot in enumerate(feet)
            if isinstance(foot, Contact)
        }  # fmt: skip
        self.go_to(0)

    def go_to(self, k: int) -> None:
        self.k, self.a = k, self.course.a[k]
        self.now = State(self.robot, self.course.q[k], self.course.v[k])

    def com(self) -> tuple[Array, Array, Array]:
        """Place, velocity and acceleration of the centre of mass that is followed."""
        Ag, bias, mass = self.now.centroidal()
        s = self.course.shift[:, self.k]
        return (
            self.now.com + s[0],
            Ag[:3] @ self.now.v / mass + s[1],
            (Ag[:3] @ self.a + bias[:3]) / mass + s[2],
        )

    def _turned(self) -> Reference:
        seen = self.now.frame(self.base)
        return Reference(seen.X_WF.rotation, seen.v[3:], (seen.J @ self.a + seen.bias)[3:])

    def _place(self, g: int, frame: str) -> Callable[[float], Reference]:
        def target(t: float) -> Reference:
            seen = self.now.frame(frame)
            X = pin.SE3(seen.X_WF.rotation, seen.X_WF.translation + [0.0, 0.0, self.course.raised[self.k, g]])
            return Reference(X, seen.v, seen.J @ self.a + seen.bias)

        return target

    def tasks(self, touching: Array) -> list[Task]:
        """Those of the whole robot, and of the feet that do not touch."""
        return [*self.fixed, *(task for g, task in self.swings.items() if not touching[g])]


def nearest_motion(
    motion: Motion,
    lanes: ContactTimeline,
    friction: float,
    torque: float | None,
    margin: float,
    longest: float,
    done: Callable[[float], None],
) -> Motion:
    """The nearest possible motion, with its contacts and notes; it ends where it falls.

    Args:
        motion: The reference.
        lanes: Its contacts.
        friction: Coulomb's coefficient of the floor.
        torque: Share of the torque limits; None for no limits.
        margin: Share of the friction, of the soles' size and of the torques that is not used.
        longest: Longest step of the integration [s].
        done: Called with each time reached.
    """
    lanes = standing(lanes)
    course = Course.of(motion, lanes, longest)
    contacts = FloorContacts(lanes, friction, margin)
    follower = _Follower(course, motion, contacts.feet)
    limits = Limits(
        torque=None if torque is None else torque * (1.0 - max(margin, TORQUE_MARGIN)),
        horizon=max(Limits().horizon, 2.0 * longest),
    )
    q, v = _start(follower, contacts, lanes)
    kept: list[tuple[Array, Array, Array, Array]] = []
    fell, relaxed = "", 0.0
    for k, t in enumerate(course.t):
        follower.go_to(k)
        state = State(motion.robot, q, v)
        fell = _fallen(state, follower.now, lanes.ground)
        if fell:
            break
        touching = contacts.update(state, int(course.frame[k]))
        try:
            answer = silent_step(state, follower.tasks(touching), contacts.constraints(state), limits=limits)
        except NoSolution as error:
            fell = f"no accelerations keep its limits: {error}"
            break
        contacts.carried(answer)
        if answer.violation is not None:  # which the notes tell once
            relaxed = max(relaxed, answer.violation.worst)
        if len(kept) == course.frame[k]:
            kept.append((q, v, answer.a, contacts.on.copy()))
        if k + 1 < len(course.t):
            h = float(course.t[k + 1] - t)
            q = pin.integrate(motion.robot.model, q, h * v + 0.5 * h * h * answer.a)
            v = v + h * answer.a
        done(float(t))
    return _made(motion, lanes, course, kept, fell, relaxed)


def _fallen(state: State, wanted: State, ground: float) -> str:
    """In words, or empty."""
    if not np.isfinite(state.com).all():
        return "numbers are not finite"
    height, other = state.com[2] - ground, wanted.com[2] - ground
    if height < FALLEN * other:
        return f"its centre of mass is {height:.2f} m above the floor, that of the reference {other:.2f} m"
    lean = float(np.linalg.norm(pin.log3(wanted.base_pose().rotation.T @ state.base_pose().rotation)))
    return f"its base leans by {math.degrees(lean):.0f} degrees from that of the reference" if lean > TIPPED else ""


def _start(follower: _Follower, contacts: FloorContacts, lanes: ContactTimeline) -> tuple[Array, Array]:
    """(q, v) of the first frame: feet where they are and at rest, joints within limits, the centre of mass where it begins."""
    robot, now = follower.robot, follower.now
    q, v = now.q.copy(), now.v.copy()
    wanted, rate, _ = follower.com()
    contacts.on = lanes.touches[0].copy()
    feet = [c.frame for c in contacts.constraints(now) if isinstance(c, Contact)]
    clipped, fixed = within_limits(robot, q)
    if (clipped != q).any() or np.abs(follower.course.shift[:2, 0]).max() > 1e-6:
        found = _posed(State(robot, clipped, v), feet, [now.frame(name).X_WF for name in feet], fixed, wanted)
        q = clipped if found is None else found.q
        if found is not None:
            J, W = _rows(found, feet, fixed)
            off = np.concatenate([np.zeros(len(J) - 3), rate]) - J @ v
            v = v + W @ np.linalg.lstsq(J @ W, off, rcond=1e-9)[0]
    state = State(robot, q, v)
    held = contacts.constraints(state)
    return q, project_velocity(state, held).v if held else v


def _posed(state: State, feet: Sequence[str], goals: Sequence[pin.SE3], fixed: Array, com: Array) -> State | None:
    """A pose near a state's with feet and centre of mass at goals, some coordinates as they are; None if it finds none."""
    model, v, first = state.robot.model, state.v, state.q
    for _ in range(START_STEPS):
        off = [_between(state.frame(name).X_WF, goal) for name, goal in zip(feet, goals, strict=True)]
        error = np.concatenate([*off, np.zeros(len(fixed)), com - state.com])
        if np.abs(error).max() < 1e-9:
            return state if np.abs(pin.difference(model, first, state.q)).max() < TIPPED else None
        J, W = _rows(state, feet, fixed)
        state = State(state.robot, pin.integrate(model, state.q, W @ np.linalg.lstsq(J @ W, error, rcond=1e-9)[0]), v)
    return None


def _between(X: pin.SE3, goal: pin.SE3) -> Array:
    return np.concatenate([goal.translation - X.translation, pin.log3(goal.rotation @ X.rotation.T)])


def _rows(state: State, feet: Sequence[str], fixed: Array) -> tuple[Array, Array]:
    """(rows of feet, fixed coordinates and the centre of mass; W, W W^T = M^-1): of W y with least |y| the inertia is least."""
    Ag, _, mass = state.centroidal()
    J = np.concatenate([*(state.frame(name).J for name in feet), np.eye(state.robot.nv)[fixed], Ag[:3] / mass])
    return J, np.linalg.inv(np.linalg.cholesky(state.M)).T


def within_limits(robot: CheckedModel, q: Array) -> tuple[Array, Array]:
    """(a configuration with its joints of one number inside their limits, the coordinates of v of those at their limits)."""
    (i, k), out = numbers_of(robot), q.copy()
    low, high = robot.model.lowerPositionLimit[i], robot.model.upperPositionLimit[i]
    out[i] = np.minimum(np.maximum(q[i], low), high)
    return out, k[(out[i] == low) | (out[i] == high)]


def _made(
    motion: Motion,
    lanes: ContactTimeline,
    course: Course,
    kept: Sequence[tuple[Array, Array, Array, Array]],
    fell: str,
    relaxed: float,
) -> Motion:
    robot, n = motion.robot, len(kept)
    notes = [f"nearest possible motion to {motion.source}, followed in steps of {np.diff(course.t).max(initial=0.0):.2g} s."]
    if abs(course.lifted) > 1e-3:
        notes.append(f"the reference was raised by {1e3 * course.lifted:.0f} mm to the floor.")
    if np.abs(course.shift[0]).max() > 1e-3:
        notes.append(f"its centre of mass was shifted by up to {1e3 * np.abs(course.shift[0]).max():.0f} mm to balance it.")
    if relaxed > 1e-6:
        notes.append(f"contacts or joint limits could not be kept at some times, by {relaxed:.2g} at most.")
    if fell:
        last = "before its first frame" if not n else f"after {motion.t[n - 1]:.3f} s"
        notes.append(f"it falls, and ends {last}: {fell}.")
    if not n:
        raise NoSolution(" ".join(notes))
    q, v, a, on = (np.array(x) for x in zip(*kept, strict=True))
    places = lanes.points.places(*placements(robot, q))
    off = float(np.abs(np.where(on, places[..., 2] - lanes.ground, 0.0)).max(initial=0.0))
    if off > OFF_FLOOR:
        notes.insert(1, f"it is possible on contacts up to {1e3 * off:.0f} mm off the floor, as those of the reference are.")
    speeds, noise = slopes(motion.t[:n], places[..., :2], on, np.zeros(len(lanes.points)))
    own = ContactTimeline(
        motion.t[:n],
        lanes.points,
        on,
        np.zeros_like(on),
        places[..., 2] - lanes.ground,
        speeds,
        places,
        lanes.ground,
        noise,
        np.zeros_like(on),
    )
    return Motion.of_arrays(
        robot, motion.t[:n], q, v, a, source=f"nearest to {motion.source}", notes=notes, ground=lanes.ground,
        quaternion="xyzw", trust=True,
    ).with_contacts(own)  # fmt: skip
