"""A plan as it is shown: forces where contacts stand, their lanes, and what is not certified, with the missing wrench."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.terrain import Terrain
from rbd.model.checked_model import CheckedModel
from rbd.motion.frame_terms import FrameTerms
from rbd.planning import Plan
from rbd.simulation.simulated_motion import OPEN, STICKS, Event
from rbd.visual.playback.report_motion import MOMENT_ARM, MOMENT_COLOR, YES
from rbd.visual.playback.shown_motion import ShownMotion, Track
from rbd.visual.playback.trajectory_charts import charts_of
from rbd.visual.robot_meshes import drawable
from rbd.visual.style import WRENCH_COLOR

UNCERTIFIED, UNCERTIFIED_COLOR = "not certified", "#c0392b"
"""Name and colour of the lane of what is not."""


@dataclass(frozen=True, eq=False)
class PlannedSamples:
    """A plan at the times of its motion, as charts read a trajectory.

    Attributes:
        robot: The robot.
        t: Times, shape (n,) [s].
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv).
        tau: Torques of the motors, shape (n, nu) [N, N m].
        points: {contact: where it stands, NaN in the air, shape (n, k, 3) [m]}.
        point_forces: {contact: forces there, shape (n, k, 3) [N]}.
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    tau: Array
    points: Mapping[str, Array]
    point_forces: Mapping[str, Array]

    @classmethod
    def of(cls, plan: Plan) -> PlannedSamples:
        """Forces and torques are linear between the ends of the intervals of its certificate."""
        x, pushes = plan.intervals, plan.pushes
        i, share = x.at(plan.t)
        s = share[:, None]
        knot, on = pushes.before(x.start, x.end)[i], x.on[i]
        places = np.where(pushes.on[knot, :, None], pushes.places[knot], pushes.places[knot + 1])
        places = np.where(on[..., None], places, np.nan)
        forces = (1.0 - s[..., None]) * x.forces[0, i] + s[..., None] * x.forces[1, i]
        contacts = plan.contacts.contacts
        sizes = np.cumsum([len(np.asarray(c.corners)) for c in contacts])[:-1]
        each = zip(contacts, np.split(places, sizes, axis=1), np.split(forces, sizes, axis=1), strict=True)
        parts = {c.name: (p, f) for c, p, f in each}
        tau = (1.0 - s) * x.torques[0, i] + s * x.torques[1, i]
        points, acting = ({name: part[k] for name, part in parts.items()} for k in (0, 1))
        return cls(plan.robot, plan.t, plan.q, plan.v, tau, points, acting)


def shown_plan(plan: Plan) -> ShownMotion:
    """A plan as a motion that can be shown; of one that is not certified the missing wrench, on what is not.

    The missing wrench is what the motion needs at its centre of mass less what contacts give, at the same times.
    """
    x, samples, floor = plan.intervals, PlannedSamples.of(plan), plan.floor
    bad = ~x.sure[x.at(plan.t)[0]]
    modes = {name: np.where(np.isnan(p).any(axis=(1, 2)), OPEN, STICKS).tolist() for name, p in samples.points.items()}
    events = [
        Event(float(plan.t[k + 1]), name, "leaves" if stands == STICKS else "touches", 0)
        for name, own in modes.items() for k, stands in enumerate(own[:-1]) if own[k + 1] != stands
    ]  # fmt: skip
    pushes = tuple[Track, ...]()
    if bad.any():
        modes[UNCERTIFIED] = np.where(bad, YES, OPEN).tolist()
        terms = FrameTerms.of(plan.robot, plan.q, plan.v, plan.a, None)
        p, f = (np.concatenate(list(values.values()), axis=1) for values in (samples.points, samples.point_forces))
        arm = np.nan_to_num(p - terms.com[:, None])
        missing = terms.wrench - np.concatenate([f.sum(axis=1), np.cross(arm, f).sum(axis=1)], axis=1)
        force, moment = np.split(missing * bad[:, None], 2, axis=1)
        pushes = (
            Track("missing force", terms.com[:, None], force[:, None], WRENCH_COLOR),
            Track(f"missing moment / {MOMENT_ARM:g} m", terms.com[:, None], moment[:, None] / MOMENT_ARM, MOMENT_COLOR),
        )
    return ShownMotion(
        samples, drawable(plan.robot), plan.t, plan.q, plan.v, str(plan).splitlines()[0], samples.points, samples.point_forces,
        modes, tuple(events), lanes={UNCERTIFIED: UNCERTIFIED_COLOR}, pushes=pushes,
        terrains=(floor,) if isinstance(floor, Terrain) else (), charts=partial(charts_of, samples),
        defaults={"start": float(plan.t[bad.argmax()])},
    )  # fmt: skip
