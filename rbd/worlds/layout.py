"""What is where in the arrays of the kernels: rows of joints, worlds, pushes, points, and of what is told of a world."""

from __future__ import annotations

from typing import NamedTuple

from rbd.arrays import Array

STIFF, DAMP, TARGET, FEED, LIMIT, VISCOUS, RUBS, LOW, HIGH, MOBILE = range(10)
"""Rows of a joint: gains, target, torque and limit of its motor; damping, dry friction and range of the joint; and about how
much a torque accelerates it, its entry of the diagonal of M^-1 at the beginning."""
JOINT = 10
RUB, STOP = 0, 1
"""What a single row is: dry friction of its joint, or a stop."""
PUSH = 12
"""Rows of a push: place in its body (3), force and moment in the world's axes (3, 3), beginning, end, and none."""
INERTIA = 11
"""Numbers of a body: mass, centre of mass, inertia about it, armature of its joint."""
EQUATION, CONTACT, DEPTH, RESCUED, STOPPED, TURN = range(6)
"""Rows of what is told of a world: largest residuals of equation and law, largest depth [m], steps solved alone, whether it
stopped: 0, or the number of the step plus one; and the largest angle by which a body turned in a step [rad]."""
TOLD = 6
BLOCK, STEP, PART, HOW_MANY, HOW_WIDE, ACTIVE = range(6)
"""Where a run is: its block, step and part of it (1: impulses of some worlds are to be found alone); how many sites are active,
how many rows they have; and where the active sites and their first rows begin."""
BODY, SIZE, FIRST, MANY = range(4)
"""Columns of a site's integers: its body, rows, first point (or single) and how many."""
ARM, NORMAL, OFFSET, MU, UNIT, IDLE, GAP, STICK, EDGE, SIDE, ACROSS, ALONG, FELT, SHIFT, STILL, LIGHT = (
    0, 3, 6, 9, 10, 11, 12, 15, 16, 17, 18, 21, 24, 27, 30, 31,
)  # fmt: skip
"""Where a point has what: its arm from the site's point, normal, velocity without impulses, friction, unit, whether it is out
of reach, P(w - y) - w, whether it sticks, whether it slips, the share of its tangential force, directions across and along, its
arm at the end of the step, what was added to its velocity so that friction opposes that in the middle of the step, and the
least scales of its velocity and of its weight, of which the former is kept as its inverse."""
POINT = 32
"""Rows of a point in `Law.point`."""
LEAST, MERIT, SQUARE, DEEP, ARRIVAL, ARRIVES, LEFT = range(7)
"""Rows of `Law.merit`, which is the last."""
MERITS = 7
ALONE = 0.25
"""In row LEFT: impulses were found, but not with those of the other worlds of the block."""


class Ground(NamedTuple):
    """What the points may touch.

    Attributes:
        plane: Normal and height of the plane of each point, shape (k, 4); unused where it is on pieces.
        pieces: First and last piece under each point, shape (k, 2); none: on its plane.
        faces: Where those of a piece begin, shape (pieces + 1,).
        face: Outward normals and distances from the origin, shape (faces, 4).
    """

    plane: Array
    pieces: Array
    faces: Array
    face: Array


class Given(NamedTuple):
    """What acts in the worlds of one block: rows by lanes.

    Attributes:
        inertia: As of `free_motion`, shape (11 n,).
        checked: The same, for the residuals.
        joint: Shape (JOINT joints,).
        world: Gravity (3) and height of the ground, shape (4,).
        friction: Shape (k,).
        push: Shape (PUSH pushes,).
    """

    inertia: Array
    checked: Array
    joint: Array
    world: Array
    friction: Array
    push: Array


class Space(NamedTuple):
    """Working memory of one block: rows by lanes."""

    x: Array
    y: Array
    v: Array
    acc: Array
    end: Array
    free: Array
    work: Array
    base: Array
    tau: Array
    damping: Array
    pushes: Array


class Law(NamedTuple):
    """Working memory of the contact problem: rows by lanes.

    Attributes:
        lift: S . F of each row and joint, shape (rows n,).
        base: L^-1 F of each row at the base, shape (6 rows,).
        mobility: D, shape (rows rows,).
        factor: C, shape (rows rows,).
        turned: Q M Q^T C, shape (rows rows,).
        point: Of each point, shape (POINT k,).
        single: Of each single: offset, lower and upper bound, unit, gap, slope, and scales as of points, shape (8 l,).
        w: Weights, shape (3 k + l,).
        new: As w.
        best: As w.
        move: As w.
        live: Whether a site may touch, shape (s,).
        block: Q M Q^T of a site, shape (36,).
        system: C^T Q M Q^T C + I, shape (rows rows,).
        load: Q w, shape (rows,).
        answer: D Q w, shape (rows,).
        merit: Least merit, merit, sum of squares; the largest depth, when a point arrives in the step, whether one does, and
            whether impulses are left to be found, or ALONE, shape (7,).
    """

    lift: Array
    base: Array
    mobility: Array
    factor: Array
    turned: Array
    point: Array
    single: Array
    w: Array
    new: Array
    best: Array
    move: Array
    live: Array
    block: Array
    system: Array
    load: Array
    answer: Array
    merit: Array
