"""`Trajectory`: a simulated motion as arrays over time, with residuals."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, overload

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float, zeros
from rbd.constraints.constraint import Constraint, listed, member
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.schedules import ExternalAt
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError, Reason
from rbd.errors.inputs import check_known
from rbd.model.array_file import a_trajectory_path, read_netcdf, read_npz, write_netcdf, write_npz
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External, ForceElement
from rbd.model.output_files import check_place
from rbd.model.state import State
from rbd.problem.ground import Ground
from rbd.records import Axis, Field
from rbd.simulation.contact_gaps import CLOSED
from rbd.simulation.recording import Recording
from rbd.simulation.simulated_motion import OPEN, ConstraintForce, Event, Integrator, Sample, SimulatedMotion
from rbd.simulation.trajectory_contents import (
    arrays_of,
    arrays_of_netcdf,
    dataset_of,
    fields_of,
    for_netcdf,
    header_of,
)
from rbd.simulation.trajectory_fields import ENERGY, ENTRIES, checked, table

if TYPE_CHECKING:
    import os
    from pathlib import Path

    import xarray
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trajectory(Displayed):
    """A motion, as `rbd.simulate` returns it: n samples, read-only arrays, SI units, world axes, forces on the robot.

    `trajectory[i]` is a `Sample`, `trajectory[a:b:c]` a Trajectory, `print(trajectory)` its certificate.

    Attributes:
        robot: The robot.
        t: Times, shape (n,) [s], increasing.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv) [m/s, rad/s].
        a: Accelerations, shape (n, nv) [m/s2, rad/s2]; M a + h = S^T tau + tau_ext + J^T f at each sample.
        tau: Motor torques, shape (n, nu) [N, N m].
        forces: {constraint: shape (n, m)}: the force (m = 3) of a point or the wrench (m = 6) of a surface at its centre, in W;
            row forces if it has no resultant [N, N m]. Zero where it is inactive.
        points: {contact: shape (n, k, 3)}: its points in W [m]; NaN if a point does not exist at that time.
        point_forces: {contact: shape (n, k, 3)}: the force at each point, in W [N]; zero where there is none.
        modes: {constraint: shape (n,)}: "open", "sticks", "slips", "holds" or "pushes".
        kinetic: Kinetic energy, shape (n,) [J].
        potential: Potential energy, shape (n,) [J]; zero at the world's origin.
        motor_work: Work of the motors since the start of the motion, shape (n,) [J]: exact for torques that are held during a
            step, of the integrator's order for others. `energy` changes by it, by the work of external forces, and by
            what dampers, impacts, friction and moving ground take or give.
        elastic: Energy stored in force elements, e.g. springs, shape (n,) [J]; of a function of time, in those of the sample.
        dissipated: Work that force elements, e.g. dampers, have taken out of the motion since its start, shape (n,) [J].
        momentum: Linear, then angular momentum about the centre of mass, in W, shape (n, 6) [N s, N m s].
        com: Centre of mass in W, shape (n, 3) [m].
        residuals: {"law": residual of the contact law, scaled; "drift", "drift_rate": largest error of the
            bilateral constraints [m, rad; per s]; "penetration": depth of the deepest contact [m, rad]; "energy": energy that
            the steps have made since the start, or lost [J], NaN where it is not known}, each of shape (n,).
        events: Beginnings and ends of contact, and events of yours, in order of time; `absent` names those that did not happen.
        integrator: The integrator, with its settings.
        law: Contact law.
        stabilisation: Stabilisation of the bilateral constraints, with its settings.
        step: The integrator's step [s].
        interrupted: When it ended early; empty if it did not.
        end_reason: Why it ended early, a `rbd.errors.Reason`; `NONE` if it did not.
        elements: Force elements that acted, which drawings show; empty where a function gave others with time.
        pushed: Whether other external forces acted, which are not recorded.
        terrains: Those that contacts were on, and planes that moved, as half-spaces.
        driven: {constraint: the joint whose motion it gave as a function of time}.
        friction: {contact: Coulomb's coefficient}, of those that have one; not of other sets of forces.
        planes: {contact: the plane that it touches, a `rbd.Ground`}, of those whose plane is known and stays where it is.

    Raises:
        InputError: sizes that do not fit, times that do not increase, numbers that are not finite.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> fall = rbd.simulate(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), duration=0.4, step=0.1)
        >>> fall.com[:, 2].round(4), bool(np.ptp(fall.energy) < 1e-9)
        (array([1.    , 0.951 , 0.8038, 0.5585, 0.2152]), True)
        >>> print(f"{fall.momentum[-1, 2]:.2f} N s")  # -m g t
        -39.24 N s
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    forces: Mapping[str, Array]
    points: Mapping[str, Array]
    point_forces: Mapping[str, Array]
    modes: Mapping[str, Array]
    kinetic: Array
    potential: Array
    motor_work: Array
    momentum: Array
    com: Array
    residuals: Mapping[str, Array]
    elastic: Array = field(default_factory=partial(zeros, 0))
    dissipated: Array = field(default_factory=partial(zeros, 0))
    events: tuple[Event, ...] = ()
    absent: tuple[str, ...] = ()
    integrator: str = ""
    law: str = ""
    stabilisation: str = ""
    step: float = 0.0
    interrupted: str = ""
    end_reason: Reason = Reason.NONE
    elements: tuple[ForceElement, ...] = ()
    pushed: bool = False
    terrains: tuple[Terrain, ...] = ()
    driven: Mapping[str, str] = field(default_factory=dict)
    friction: Mapping[str, float] = field(default_factory=dict)
    planes: Mapping[str, Ground] = field(default_factory=dict)

    fields: ClassVar[tuple[Field, ...]] = (
        Field(
            "worst_residual", (), "1", "largest scaled residual of the contact law, over the motion",
            lambda run: run.residuals["law"].max(initial=0.0), certificate=True,
        ),
        Field(
            "penetration", (), "m or rad", "depth of the deepest contact, over the motion",
            lambda run: run.residuals["penetration"].max(initial=0.0), certificate=True,
        ),
        Field(
            "drift", (), "m or rad", "largest position error of the bilateral constraints",
            lambda run: run.residuals["drift"].max(initial=0.0), certificate=True,
        ),
        Field("duration", (), "s", "time from the first sample to the last"),
        Field(
            "ended_early", (), "", "whether it ended before the time that was asked for", lambda run: bool(run.interrupted)
        ),
        Field(
            "end_reason", (), "", "why it ended early: a code of rbd.errors.Reason; 0 if it did not",
            lambda run: np.int16(run.end_reason.code), flags={reason.code: reason.name.lower() for reason in Reason},
        ),
        Field("interrupted", (), "", "when and why it ended early, in words", default=False),
        Field("final_q", ("position",), "{}", "configuration at the end", lambda run: run.q[-1]),
        Field("final_v", ("velocity",), "{}/s", "velocities at the end", lambda run: run.v[-1]),
        Field("final_com", ("axis",), "m", "centre of mass in W at the end", lambda run: run.com[-1]),
        Field("lowest_com", (), "m", "lowest height of the centre of mass", lambda run: run.com[:, 2].min()),
        Field(
            "energy_change", (), "J", "energy at the end less that at the beginning",
            lambda run: run.energy[-1] - run.energy[0],
        ),
        Field("motor_work", (), "J", "work of the motors", lambda run: run.motor_work[-1]),
        Field(
            "worst_torque", (), "1", "largest share of a motor limit that is used",
            lambda run: run.robot.torque_use(run.tau, run.v).max(initial=0.0),
        ),
        Field(
            "largest_tau", ("motor",), "{}", "largest torque of each motor",
            lambda run: np.abs(run.tau).max(axis=0), default=False,
        ),
        Field(
            "largest_forces", (), "N", "largest force of each contact",
            lambda run: {x: np.linalg.norm(run.forces[x][:, :3], axis=1).max(initial=0.0) for x in run.contacts},
            "largest_force_{}", "largest force of {}", default=False,
        ),
        Field("events", (), "1", "number of beginnings and ends of contact", lambda run: len(run.events), default=False),
    )  # fmt: skip

    @property
    def coordinate_axes(self) -> dict[str, Axis]:
        """Labels and units of the robot's coordinates."""
        return self.robot.coordinate_axes

    def __post_init__(self) -> None:
        for name, value in checked(vars(self)).items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(
        cls,
        motion: SimulatedMotion,
        samples: Recording | Iterable[Sample],
        events: Sequence[Event] = (),
        integrator: Integrator | str = "",
        step: float = 0.0,
        interrupted: str = "",
        end_reason: Reason = Reason.NONE,
    ) -> Trajectory:
        """The trajectory of samples.

        Args:
            motion: The motion simulated.
            samples: In order of time; a `Recording` of them takes a hundredth of the memory.
            events: All of them, in any order, those between the recorded samples too.
            integrator: The integrator.
            step: Its step [s].
            interrupted: When it ended early.
            end_reason: Why it ended early.

        Raises:
            InputError: no samples.
            NoSolution: a number that is not finite.
        """
        recording = samples if isinstance(samples, Recording) else Recording(motion)
        for sample in () if isinstance(samples, Recording) else samples:
            recording.add(sample)
        if not len(recording):
            raise InputError("a trajectory has one sample or more; none was recorded.")
        return cls(
            robot=motion.robot,
            **recording.fields(),
            events=tuple(sorted(events, key=_time)),  # an end of contact can be dated in the step before
            absent=motion.search.absent if motion.search else (),
            integrator=integrator if isinstance(integrator, str) else repr(integrator),
            law=motion.law,
            stabilisation="" if motion.stabilisation is None else repr(motion.stabilisation),
            step=step,
            interrupted=interrupted,
            end_reason=end_reason,
            elements=motion.elements,
            pushed=motion.pushed,
            terrains=motion.terrains,
            driven=motion.driven,
            friction=motion.friction,
            planes=motion.planes,
        )

    @property
    def energy(self) -> Array:
        """Kinetic, potential and elastic energy, shape (n,) [J]."""
        return self.kinetic + self.potential + self.elastic

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all constraints, in order."""
        return tuple(self.forces)

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of constraints with contact points, in order: the order of their colours."""
        return tuple(self.points)

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0])

    def state(self, i: int) -> State:
        """The robot at sample i; negative ones count from the end."""
        i = self._index(i)
        return State(self.robot, self.q[i], self.v[i], t=float(self.t[i]))

    def at(self, t: float) -> State:
        """The robot at any time between the first sample and the last: its recorded state, or one between two.

        Between two samples q follows the shortest path on its manifold and v is interpolated linearly in time:
        second-order accurate in a smooth motion; an impact between them is spread over the interval.

        Raises:
            InputError: a time outside the trajectory.
        """
        if not self.t[0] <= as_float(t) <= self.t[-1]:
            raise InputError(f"t is {t!r:.80}; expected a time from {self.t[0]:g} to {self.t[-1]:g} s.")
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        if self.t[i] == t:
            return self.state(i)
        share = float((t - self.t[i]) / (self.t[i + 1] - self.t[i]))
        q = pin.interpolate(self.robot.model, self.q[i], self.q[i + 1], share)
        return State(self.robot, q, (1.0 - share) * self.v[i] + share * self.v[i + 1], t=float(t))

    def touching(self, i: int, constraints: Sequence[Constraint]) -> tuple[Constraint, ...]:
        """Those of the motion's constraints that act in sample i, contacts at the corners that touch there.

        For `rbd.solve`, which takes a contact with all corners that are within a millimetre of its plane: of a sole on its heel
        the toes too. From the state of a sample, its torques, and these, it has the sample's accelerations, where `rest_speed`
        is above the velocities of points that stick, which vanish to O(h^2), and below those of points that slide.

        Args:
            i: The sample; negative ones count from the end.
            constraints: Constraints of the motion, as they were given to `rbd.simulate`.

        Raises:
            InputError: a constraint that the motion did not have.

        Example:
            >>> box = rbd.testing.box(mass=10.0)
            >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
            >>> tilted = rbd.State(box, [0, 0, 0.2 * np.sin(0.1), 0, np.sin(0.05), 0, np.cos(0.05)])
            >>> falls = rbd.simulate(tilted, [face], duration=0.04, step=1e-3)
            >>> (edge,) = falls.touching(-1, [face])
            >>> again = rbd.solve(falls.state(-1), None, [edge], rest_speed=1e-4)
            >>> len(edge.corners), bool(np.allclose(again.a, falls.a[-1], atol=1e-9))
            (2, True)
        """
        i, given = self._index(i), listed(constraints)
        for constraint in given:
            check_known("a constraint of Trajectory.touching is", getattr(constraint, "name", None), self.forces)
        acting = [c for c in given if self.modes[c.name][i] != OPEN]
        return tuple([c if member(c, "of_corners") is None else self._at_corners(i, c) for c in acting])

    def _at_corners(self, i: int, contact: Any) -> Constraint:
        """The contact at the corners that touch in sample i; whole where other points do, as edges of terrain."""
        found, k = contact.points(self.state(i), float(self.t[i])), len(contact.corners)
        whole: Constraint = contact
        if found is None:
            return whole
        numbers = np.array([int(name.rpartition(":")[2]) for name in found.names], int)
        loaded = self.point_forces[contact.name][i]
        near = found.gaps <= CLOSED
        if len(loaded) == k and np.array_equal(numbers, np.arange(k)):  # one that carries can hover by the error of a step
            near |= loaded.any(axis=1)
        touches = sorted(set(numbers[near].tolist()))
        some: Constraint = contact.of_corners(touches) if 0 < len(touches) < k and touches[-1] < k else whole
        return some

    def __len__(self) -> int:
        return len(self.t)

    @overload
    def __getitem__(self, key: int) -> Sample: ...
    @overload
    def __getitem__(self, key: slice) -> Trajectory: ...
    def __getitem__(self, key: int | slice) -> Sample | Trajectory:
        """A sample, or the trajectory of some; its events are those from its first time to its last."""
        return self._slice(key) if isinstance(key, slice) else self._sample(self._index(key))

    def __iter__(self) -> Iterator[Sample]:
        return (self._sample(i) for i in range(len(self)))

    def __str__(self) -> str:
        return table(vars(self))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file: .npz, for which NumPy is sufficient, or .nc, netCDF, with the extra `study`.

        Numbers are stored to the last bit. The robot is stored as its source with its inertias and placements, so that
        a file that has changed since is reported on loading. An existing file is replaced only when the new one is complete.

        Raises:
            InputError: another suffix, a path that cannot be written, or no xarray for .nc.
        """
        where = a_trajectory_path(path)
        check_place(where)
        if where.suffix == ".nc":
            write_netcdf(where, *for_netcdf(vars(self)))
        else:
            write_npz(where, header_of(vars(self)), arrays_of(vars(self)))

    @staticmethod
    def load(path: str | os.PathLike[str], robot: CheckedModel | None = None) -> Trajectory:
        """A trajectory from a file that `save` wrote; its robot is loaded again, unless it is given.

        Raises:
            InputError: no such file, or not a trajectory; a robot built by hand that is not given, or a different one.
            ModelError: the robot's file is gone, or has changed.
        """
        where = a_trajectory_path(path)
        try:
            if where.suffix == ".nc":
                header, dataset = read_netcdf(where)
                arrays = arrays_of_netcdf(header, dataset)
            else:
                header, arrays = read_npz(where)
            out = Trajectory(**fields_of(header, arrays, where.parent, robot))
            for q in out.q:
                out.robot.check_q(q)
        except InputError as error:
            message = str(error) if where.name in str(error) else f"{where.name}: {error}"
            raise InputError(message) from error
        return out

    def to_xarray(self) -> xarray.Dataset:
        """An xarray.Dataset: every array with the names of its dimensions and entries, and units.

        Dimensions are time, position (nq), velocity (nv), motor (nu), axis, spatial, event, and a row and a point of each
        constraint; variables q, v, a, tau, kinetic, potential, elastic, energy, motor_work, dissipated, momentum, com,
        `residual_...`, `force_...`, `mode_...`, `points_...` and `point_forces_...` of each constraint, and `event_...`.

        Raises:
            InputError: xarray is not installed; names the extra.

        >>> trajectory.to_xarray().tau.sel(motor="leg_left_4_joint").max()
        """
        return dataset_of(vars(self))

    def plot_forces(self, ax: Axes | None = None, *, names: Sequence[str] | None = None) -> list[Artist]:
        """Forces over time, see `rbd.visual.plot_forces`; on axes of a new figure if none are given."""
        return drawing("plot_forces")(drawing("axes_or_new")(ax), self, names=names)

    def plot_energy(self, ax: Axes | None = None) -> list[Artist]:
        """Energies over time, see `rbd.visual.plot_energy`; on axes of a new figure if none are given."""
        return drawing("plot_energy")(drawing("axes_or_new")(ax), self)

    def plot_joint(self, joint: str | Sequence[str], ax: Axes | None = None, *, what: str = "q") -> list[Artist]:
        """A joint over time, see `rbd.visual.plot_joint`; on axes of a new figure if none are given."""
        return drawing("plot_joint")(drawing("axes_or_new")(ax), self, joint, what=what)

    def replay(self, *, speed: float = 1.0, external: External | ExternalAt = None) -> None:
        """Show it live in the browser, `speed` seconds a second; `external`, as it was simulated, draws pushes.

        See `rbd.visual.replay`, which accepts a scene too.
        """
        drawing("replay")(self, speed=speed, external=external)

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        fps: float | None = None,
        speed: float = 1.0,
        title: str | None = None,
        external: External | ExternalAt = None,
        **options: Any,
    ) -> Path:
        """Write one HTML page with the motion, a play button, a scrub bar and charts, which needs no network.

        `options` are the others of `rbd.visual.export_motion`, such as charts=["forces"], ghost= or beside=.
        """
        return drawing("export_motion")(self, path, fps=fps, speed=speed, title=title, external=external, **options)

    def video(self, path: str | os.PathLike[str], *, fps: float = 30.0, speed: float = 1.0, **options: Any) -> Path:
        """Write a video, .mp4 (by the ffmpeg on PATH) or .gif, with the legend and the time; forces move along.

        See `rbd.visual.export_video`, which has the other options: `external`, `ghost`, `follow`, `width`, `height`, ...
        """
        return drawing("export_video")(self, path, fps=fps, speed=speed, **options)

    def _index(self, i: int) -> int:
        if isinstance(i, bool) or not isinstance(i, int | np.integer):
            raise InputError(f"sample {i!r:.80} of a trajectory; expected a whole number or a slice. `at(t)` takes a time.")
        if not -len(self) <= i < len(self):
            raise IndexError(f"sample {i} of a trajectory with {len(self)}.")
        return int(i) % len(self)

    def _sample(self, i: int) -> Sample:
        acting = {}
        for name, force in self.forces.items():
            points = pushes = None
            if name in self.points:
                there = ~np.isnan(self.points[name][i]).any(axis=1)
                points, pushes = self.points[name][i][there], self.point_forces[name][i][there]
            acting[name] = ConstraintForce(force[i], str(self.modes[name][i]), points, pushes)
        since = bisect_right(self.events, self.t[i - 1], key=_time) if i else 0
        return Sample(
            self.robot,
            float(self.t[i]),
            self.q[i],
            self.v[i],
            self.a[i],
            self.tau[i],
            partial(dict, acting),  # which a copy or a pickle includes
            **{name: float(x[i]) for name, x in self.residuals.items() if name != ENERGY.name},
            **{name: float(getattr(self, name)[i]) for name in ("motor_work", "elastic", "dissipated")},
            found=None,
            events=self.events[since : bisect_right(self.events, self.t[i], key=_time)],
        )

    def _slice(self, key: slice) -> Trajectory:
        chosen = range(len(self))[key]
        if not len(chosen) or chosen.step < 0:
            raise InputError(f"[{key.start}:{key.stop}:{key.step}] of a trajectory has no samples, or goes back in time.")
        fields = self.__dict__ | {name: x[key] for name, x in self.__dict__.items() if isinstance(x, np.ndarray)}
        fields |= {name: {each: x[key] for each, x in getattr(self, name).items()} for name in ENTRIES}
        first, last = fields["t"][0], fields["t"][-1]
        fields["events"] = tuple(e for e in self.events if first <= e.t <= last)
        return Trajectory(**fields)


def _time(event: Event) -> float:
    return event.t
