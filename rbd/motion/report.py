"""`MotionReport`: what `check_motion` found, frame by frame, with its summary, its table, its dataset and its files."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rbd.arrays import Array, as_array, check_flag, check_number, largest_first, lazy
from rbd.constraints.terrain.terrain import Terrain
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError, Reason
from rbd.errors.inputs import check_choice
from rbd.installation import VERSION
from rbd.model.array_file import a_trajectory_path
from rbd.model.joints import FORCE_OF
from rbd.model.motors import torque_use
from rbd.model.output_files import write_file
from rbd.modules import xarray_or_error
from rbd.motion.causes import CAUSES, FIGURES, beyond_position, beyond_speed, torque_bounds
from rbd.motion.check_settings import CheckSettings
from rbd.motion.contact_detection import fitted_ground
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.feet_faults import ANGLE, EXCESS, MISSING, SPEED, FeetFaults, grade
from rbd.motion.grasps import Grasps
from rbd.motion.reference_motion import Motion
from rbd.motion.repair.notes import notes_of
from rbd.motion.repair.repairing import repaired
from rbd.motion.self_collision import SelfCollisions
from rbd.records import Field
from rbd.robots.carried import carried_by
from rbd.simulation.progress_bar import progress_of
from rbd.workers import one_blas_thread

if TYPE_CHECKING:
    from pathlib import Path

    import xarray
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

THRESHOLDS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Shares of the weight at which the summary reads the curve."""
HEIGHTS = (0.006, 0.012, 0.02, 0.03)
"""Heights at which the summary tells what share were possible if lower points touched [m]: sensitivity to the contacts."""
_SPATIAL = ["x", "y", "z", "about_x", "about_y", "about_z"]
_SIZES = {
    "sinks": (1e3, "mm below the floor"),
    "slides": (1e3, "mm/s"),
    "hovering foot": (1e3, "mm above the floor"),
    **dict.fromkeys(FIGURES["balance"], (1e2, "% of the weight missing")),
}
"""{cause: (factor, words) with which the size of its worst frame is told}."""


@dataclass(frozen=True, eq=False, repr=False)
class MotionReport(Displayed):
    """The report of `check_motion`: which of n frames are possible, and why the others are not; k points, c contacts.

    Attributes:
        motion: The motion.
        lanes: Which points touch and slide, when.
        settings: Friction, threshold and the other arguments.
        limit: Torque limits at rest, shape (nu,) [N m]; inf where there is none. See `torque_bounds` for those at speed.
        causes: Why frames are not possible, shape (n, len(CAUSES)), in the order of `rbd.motion.CAUSES`.
        missing: The least wrench on the base that no contact force brings, torque limits aside: world axes, moment about the
            centre of mass, shape (n, 6) [N, N m].
        missing_scaled: Its size: force over the weight, moment over 0.3 m times the weight, shape (n,).
        open: Standard deviation of that by noise of the accelerations, as differentiation tells it, shape (n,). That of q and v
            moves it by less and is left out.
        missing_on_floor: The same of points on the floor alone, none of them raised, shape (n,).
        reach: The least of `HEIGHTS` at which the frame would balance without slip, if the points of meant contacts below it
            were on the floor, shape (n,) [m]; 0 where those that are do, inf where none does.
        forces: At the points, world axes, shape (n, k, 3) [N]: of least effort with what is not missing.
        tau: Motor torques with these forces, shape (n, nu) [N m].
        excess: By how many times its limit each torque exceeds it at least, shape (n, nu).
        used_friction: `|f_t| / (mu f_n)` of each contact, shape (n, c); NaN where it carries nothing.
        edge_margin: Distance of each sole's centre of pressure from its edge, shape (n, c) [m]; NaN where it carries nothing.
        nearest_a: The nearest possible acceleration in the inertia metric, torque limits aside, shape (n, nv); that of the
            motion where this is balanced.
        check: `check_motion` with these settings.
        collisions: Which bodies overlap, when; None where that was not asked.
        before: The report with which this one is compared; see `lifted` and `filtered`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0)
        >>> report = rbd.check_motion(hop)
        >>> report.n, int(report.possible.sum()), int(report.of_cause("floats").sum()), round(report.score)
        (31, 7, 24, 43)
    """

    motion: Motion
    lanes: ContactTimeline
    settings: CheckSettings
    limit: Array
    causes: Array
    missing: Array
    missing_scaled: Array
    open: Array
    missing_on_floor: Array
    reach: Array
    forces: Array
    tau: Array
    excess: Array
    used_friction: Array
    edge_margin: Array
    nearest_a: Array
    check: Callable[..., MotionReport]
    collisions: SelfCollisions | None = None
    before: MotionReport | None = None

    fields: ClassVar[tuple[Field, ...]] = (
        Field("share_possible", (), "1", "share of the frames that are possible"),
        Field("score", (), "1", "0 to 100, as MotionReport.score"),
        Field(
            "causes", (), "1", "share of the frames with each cause: share_floats, share_motor, ...",
            lambda report: dict(zip(CAUSES, report.causes.mean(axis=0), strict=True)),
            "share_{}", "share of the frames that are not possible: {}",
        ),
        Field("balance", (), "1", "share of the frames that balance on contacts as meant"),
        Field("feet", (), "1", "share of the frames without a foot at fault"),
        Field("motors", (), "1", "share of the frames within limits of torque, speed and position"),
        Field(
            "possible_at", (), "1", "share possible if points up to a height touched",
            lambda report: {f"{1e3 * h:g}": x for h, x in report.possible_at.items()},
            "possible_at_{}_mm", "share of the frames possible if points up to {} mm touched",
        ),
        Field("tilt", (), "rad", "median over the frames of the largest tilt of a sole", lambda x: x.feet_faults.medians()[0]),
        Field("hover", (), "m", "median of the largest height of a foot that hovers", lambda x: x.feet_faults.medians()[1]),
        Field("slip", (), "m/s", "median of the largest speed of a contact that slides", lambda x: x.feet_faults.medians()[2]),
        Field("sink", (), "m", "median of the largest depth of a foot", lambda x: x.feet_faults.medians()[3]),
        Field("missing_median", (), "1", "median of the missing wrench, scaled", lambda x: np.median(x.missing_scaled)),
        Field("missing_largest", (), "1", "largest missing wrench, scaled", lambda x: x.missing_scaled.max(initial=0.0)),
        Field("open_median", (), "1", "median of its standard deviation by noise", lambda x: np.median(x.open)),
        Field("worst_torque", (), "1", "largest share of a motor limit", lambda x: x.used_torque.max(initial=0.0)),
        Field(
            "friction_used", (), "1", "largest |f_t| / (mu f_n) of a contact",
            lambda x: np.fmax.reduce(x.used_friction, axis=None, initial=np.nan),
        ),
        Field(
            "edge_margin", (), "m", "smallest distance of a centre of pressure from the edge",
            lambda x: np.fmin.reduce(x.edge_margin, axis=None, initial=np.nan),
        ),
        Field("frames", (), "1", "number of frames", lambda x: x.n, default=False),
        Field("duration", (), "s", "time from the first frame to the last", lambda x: x.motion.duration, default=False),
    )  # fmt: skip

    @property
    def n(self) -> int:
        """How many frames it has."""
        return self.motion.n

    @property
    def friction(self) -> float:
        """Coulomb's coefficient of the floor."""
        return self.settings.friction

    @property
    def reason_codes(self) -> Array:
        """`rbd.errors.Reason.code` of each frame, shape (n,), integers: of the first of `CAUSES` that it has; 0 without any."""
        codes = np.array([Reason.of_cause(cause).code for cause in CAUSES])
        return np.where(self.possible, Reason.NONE.code, codes[self.causes.argmax(axis=1)]).astype(np.int16)

    @property
    def possible(self) -> Array:
        """Frames without any cause, shape (n,)."""
        return np.asarray(~self.causes.any(axis=1))

    @property
    def share_possible(self) -> float:
        """The share of possible frames, 0 to 1."""
        return float(self.possible.mean())

    @lazy
    def used_torque(self) -> Array:
        """`|tau|` over what the motors have at their speeds, shape (n, nu); zero where there is no limit."""
        return torque_use(self.tau, *self.torque_bounds)

    @lazy
    def torque_bounds(self) -> tuple[Array, Array]:
        """(least, most) torques of each frame, shapes (n, nu): the limits, less where torque-speed lines limit driving."""
        return torque_bounds(self.motion.robot, self.motion.v, self.settings.torque_limits, self.settings.torque_speed)

    @property
    def balance(self) -> float:
        """Share of the frames whose wrench is possible on the contacts as meant, 0 to 1."""
        return self._without("balance")

    @property
    def feet(self) -> float:
        """Share of the frames in which no foot that must carry is tilted, hovers, slides or sinks, 0 to 1."""
        return self._without("feet")

    @property
    def motors(self) -> float:
        """Share of the frames in which motors and joints are within their limits, of torque, speed and position, 0 to 1."""
        return self._without("motors")

    def _without(self, figure: str) -> float:
        return float((~self._has(*FIGURES[figure])).mean())

    def _has(self, *causes: str) -> Array:
        return np.asarray(self.causes[:, [CAUSES.index(cause) for cause in causes]].any(axis=1))

    @property
    def possible_at(self) -> dict[float, float]:
        """{height: share of the frames that were possible if points of meant contacts up to it were on the floor [m]}.

        How much depends on the heights of feet: the first is `share_possible` with contacts as found, but for sums of causes.
        """
        others = self._has(*(cause for cause in CAUSES if cause not in (*FIGURES["balance"], *FIGURES["feet"][:3])))
        return {height: float((~others & (self.reach <= height)).mean()) for height in HEIGHTS}

    @lazy
    def feet_faults(self) -> FeetFaults:
        """Tilt, hover, slip and depth of the feet."""
        return FeetFaults.of(self.lanes)

    @lazy
    def grasps(self) -> Grasps:
        """What two hands hold, and how far they leave these grasps."""
        return Grasps.of(self.motion.robot, self.motion.q)

    @lazy
    def grades(self) -> Array:
        """How near each frame is to be possible, shape (n,): 1 where it is, and less the larger its faults are.

        A product of 1 / (1 + x). x of balance: the missing wrench beyond the threshold over 0.1; of feet: tilt over 5 degrees,
        hover over 18 mm, slip over 20 mm/s and depth over 10 mm, summed, where feet or balance have a cause; the better of
        contacts as meant, and of those on the floor alone, of which none hovers. x of motors: torques over their bounds beyond
        1 over 0.1, and joints over 0.1 rad and speeds over 1 rad/s beyond limits, where they have a cause. A jump, a
        self-collision and a grasp that is left halve it.
        """
        m, most = self.motion, np.maximum(self.settings.threshold, 3.0 * self.open)
        bad = self._has(*FIGURES["balance"], *FIGURES["feet"])
        by_feet = [grade(np.where(bad, self.feet_faults.sizes(on_floor=x).T, 0.0)) for x in (False, True)]
        meant, strict = (np.maximum(x - most, 0.0) / MISSING for x in (self.missing_scaled, self.missing_on_floor))
        used = np.nan_to_num(self.used_torque, posinf=100.0).max(axis=1, initial=0.0)
        beyond = (
            np.maximum(used - 1.0, 0.0) / EXCESS,
            *(x.max(axis=1, initial=0.0) / unit for x, unit in ((beyond_position(m), ANGLE), (beyond_speed(m), SPEED))),
        )
        by_motors = np.where(self._has(*FIGURES["motors"]), beyond, 0.0)
        half = 0.5 ** (sum(self.of_cause(cause) * 1.0 for cause in ("jump", "self-collision", "grasp")))
        standing = np.maximum(grade([meant]) * by_feet[0], grade([strict]) * by_feet[1])
        return standing * grade(by_motors) * half

    @property
    def score(self) -> float:
        """0 to 100, to rank motions by: 100 times the mean of `grades`; 100 where all frames are possible."""
        return 100.0 * float(self.grades.mean())

    def of_cause(self, cause: str) -> Array:
        """Frames with a cause, shape (n,).

        Raises:
            InputError: no cause, with their names.
        """
        check_choice("cause", cause, CAUSES)
        return np.asarray(self.causes[:, CAUSES.index(cause)])

    def worst(self, cause: str, most: int = 10) -> Array:
        """Frames with a cause, worst first, up to `most` of them; of equal ones the earlier first.

        Raises:
            InputError: no cause, with their names.
        """
        frames = np.flatnonzero(self.of_cause(cause))
        return frames[largest_first(self._badness(cause)[frames])][: int(most)]

    def _badness(self, cause: str) -> Array:
        """By how much each frame is impossible, for a cause, shape (n,); zero where a frame has it or not."""
        lanes, missing = self.lanes, self.missing_scaled
        sizes = {
            "sinks": -lanes.heights.min(axis=1, initial=0.0),
            "slides": np.where(lanes.slides, lanes.speeds, 0.0).max(axis=1, initial=0.0),
            "motor": self.excess.max(axis=1, initial=0.0),
            "torque-speed": np.where(np.isfinite(self.used_torque), self.used_torque, np.inf).max(axis=1, initial=0.0),
            "tilted sole": self.feet_faults.tilt.max(axis=1, initial=0.0),
            "hovering foot": self.feet_faults.hover.max(axis=1, initial=0.0),
            "grasp": self.grasps.errors[:, :, 0].max(axis=1, initial=0.0),
            **dict.fromkeys(FIGURES["balance"], missing),
        }
        return sizes.get(cause, np.zeros(self.n))

    def on_line(self, frame: int) -> str:
        """The motor that is furthest beyond its torque-speed line in a frame: its torque, its speed, and what that leaves."""
        robot, (least, most) = self.motion.robot, self.torque_bounds
        tau, v = self.tau[frame], self.motion.v[frame, robot.actuated]
        i = int(np.argmax(self.used_torque[frame]))
        unit, left = robot.motor_coordinates[i].unit, (most if tau[i] > 0.0 else least)[frame, i]
        force = FORCE_OF[unit]
        needs = f"{robot.actuated_names[i]} {abs(tau[i]):.4g} {force} at {abs(v[i]):.3g} {unit}/s"
        return f"{needs}, which leaves {abs(left):.4g} {force}"

    def share_over(self, thresholds: Sequence[float] | Array = THRESHOLDS) -> Array:
        """The share of frames whose `missing_scaled` is above each threshold."""
        levels = as_array("thresholds", thresholds).reshape(-1)
        return np.asarray((self.missing_scaled[None] > levels[:, None]).mean(axis=1))

    def checked_again(self, motion: Motion) -> MotionReport:
        """Another motion with the same settings, this report beside it as `before`."""
        return replace(self.check(motion), before=self)

    def lifted(self) -> MotionReport:
        """The report of the same motion moved by a constant height, so that its lowest points stand on the floor.

        The height is that of the fitted floor; see `find_contacts`. Contacts are found again.
        """
        level = self.lanes.level("lifted")
        down = fitted_ground(self.motion.t, self.lanes.places) - level if len(self.lanes.points) else 0.0
        return self.checked_again(self.motion.lifted(-down))

    def filtered(self, cutoff: float) -> MotionReport:
        """The report of the same motion without what is above a frequency [Hz]. Contacts are found again."""
        return self.checked_again(self.motion.filtered(cutoff))

    def repaired(self, *, slower: float = 1.0, keep: Sequence[str] = (), progress: bool = True) -> Motion:
        """The motion repaired over its whole length: near this one, and possible wherever it can be.

        1. Contacts: stances of each foot from the report's lanes (`check_motion(contacts=)` takes edited ones), without those
           and steps that are too short to make; feet that change share the load for 0.1 s; a foot that drifts or turns while
           it stands makes one more step where there is time.
        2. Feet: fixed in stances, flat on the floor or, where the lanes have an edge of a sole alone, leaning on their toes or
           heels as the reference does; smooth and above the floor between. On terrain they are flat on the tread under them,
           level or not, moved by as little as puts what carries of a sole, its inner 0.75, inside the tread's edges, and all of
           it beside what rises there; and between 25 mm above what they pass.
        3. Centroid: the trajectory of the centre of mass and of angular momentum nearest to the reference for which forces in
           friction cones at the stances exist at all times; stances may shift (`rbd.centroid`).
        4. Posture: poses over the whole motion near the reference, with feet on their paths, these forces, torques and joints
           within limits, bodies apart; the angular momentum that they have goes back into 3, until both agree.
        5. The result is judged by the same check; its notes say what is not possible, by interval and cause, and first in which
           frames it has a kind of fault that this one has not there: limits are broken where the stances cannot be reached.

        A motion that is possible at each frame comes back as it is. The reference is followed up to 6 Hz, its accelerations by
        differences of frames at 45 to 75 Hz; 0.86 of the friction, 0.75 of the soles and of the torques are used.

        Args:
            slower: How many times as long it takes, in as many frames; contacts are those of the given pace.
            keep: Names of frames whose poses stay where they are, as those of hands.
            progress: Show a bar on a terminal.

        Returns:
            A motion of the same robot and frames, with its contacts and accelerations. See `rbd.motion.MotionDifference` for
            how far it is from this one.

        Raises:
            InputError: no feet, a motion of fewer than eight frames, a pace or a frame that is none.
            NoSolution: the centroid's program has no answer.
        """
        m, settings = self.motion, self.settings
        pace = check_number("slower", slower, 1.0, 100.0, expected="a factor of 1 or more")
        check_flag("progress", progress)
        if isinstance(keep, str) or not isinstance(keep, Sequence):
            raise InputError(f"keep is {keep!r:.80}; expected names of frames: ['left_hand', 'right_hand'].")
        frames = [m.robot.frame(name).name for name in keep]
        level = found = self.lanes.ground
        if settings.ground in (None, "fit") and not isinstance(found, Terrain) and not isinstance(m.ground, Terrain):
            level = m.ground
        if pace == 1.0 and self.possible.all():
            raised = 0.0 if isinstance(level, Terrain) or isinstance(found, Terrain) else level - found
            same, lanes = m, self.lanes
            if raised:
                same, lanes = m.lifted(raised), replace(lanes, places=lanes.places + [0.0, 0.0, raised], ground=level)
            told = "each frame is possible: nothing was repaired."
            return replace(same, notes=(*same.notes, told), contacts=lanes, forces=None)
        torques = partial(torque_bounds, m.robot, torque_limits=settings.torque_limits, torque_speed=settings.torque_speed)
        with one_blas_thread(), progress_of((0.0, 1.0), shown=progress, doing=f"repairing {m.source}") as done:
            new, course = repaired(
                m, self.lanes, self.friction, torques, level, self_collision=settings.self_collision, slower=pace, keep=frames,
                done=done,
            )  # fmt: skip
        again = self.check(new, progress=False)
        return replace(new, notes=notes_of(course, new, m, self.causes, again.causes, again.why))

    def arrays(self) -> dict[str, Array]:
        """All arrays by name."""
        return {"t": self.motion.t} | {name: x for name, x, *_ in self._variables()}

    def to_xarray(self) -> xarray.Dataset:
        """The report with named dimensions, labels and units.

        Raises:
            InputError: xarray is not installed.
        """
        xr, robot, motors = xarray_or_error(), self.motion.robot, self.motion.robot.motor_coordinates
        variables: dict[str, Any] = {}
        for name, x, dims, unit, meaning in self._variables():
            variables[name] = (["time", *dims], x, {"long_name": meaning} | ({"units": unit} if unit else {}))
        coords: dict[str, Any] = {
            "time": ("time", self.motion.t, {"units": "s"}),
            "cause": np.array(CAUSES),
            "position": [c.name for c in robot.joints.positions],
            "velocity": [c.name for c in robot.joints.velocities],
            "motor": np.array([c.name for c in motors], str),
            "motor_unit": ("motor", np.array([FORCE_OF[c.unit] for c in motors], str)),
            "point": np.array(self.lanes.names, str),
            "contact": np.array([c.name for c in self.lanes.contacts], str),
            "axis": _SPATIAL[:3],
            "spatial": _SPATIAL,
        }
        about = {"title": f"check of a motion of {robot.name}", "rbd": VERSION, "report": self._json()}
        return xr.Dataset(variables, coords, about)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as .npz (arrays by name) or .nc (netCDF), whole or not at all.

        Raises:
            InputError: another ending, a folder that is not there, or xarray is not installed (.nc).
        """
        place = a_trajectory_path(path)
        if place.suffix == ".npz":
            words = {"cause": np.array(CAUSES), "point": np.array(self.lanes.names, str), "report": np.array(self._json())}
            write_file(place, lambda file: np.savez(file, allow_pickle=False, **self.arrays(), **words))
            return
        whole = self.to_xarray()
        dataset = whole.drop_vars([name for name, x in whole.variables.items() if not x.size])  # netCDF 3 has no empty arrays
        flags = {name: x.astype(np.int8) for name, x in dataset.data_vars.items() if x.dtype == bool}
        content = dataset.assign(flags).to_netcdf(engine="scipy", format="NETCDF3_64BIT")
        write_file(place, lambda file: file.write(content))

    def _json(self) -> str:
        return json.dumps(self.summary(), allow_nan=False)

    def summary(self) -> dict[str, Any]:
        """The main numbers as plain data, for JSON and for ranking."""
        return {
            "source": self.motion.source,
            "robot": self.motion.robot.name,
            "carried": [each.plain for each in carried_by(self.motion.robot)],
            "frames": self.n,
            "duration_s": self.motion.duration,
            "possible": self.share_possible,
            "score": self.score,
            **{name: self._without(name) for name in FIGURES},
            "possible_at_mm": {f"{1e3 * h:g}": x for h, x in self.possible_at.items()},
            **dict(zip(("tilt_rad", "hover_m", "slip_m_s", "sink_m"), self.feet_faults.medians(), strict=True)),
            "causes": {name: int(self.causes[:, i].sum()) for i, name in enumerate(CAUSES) if self.causes[:, i].any()},
            "worst_frames": {name: self.worst(name, 5).tolist() for i, name in enumerate(CAUSES) if self.causes[:, i].any()},
            "share_over": dict(zip(map(str, THRESHOLDS), self.share_over().tolist(), strict=True)),
            "missing_median": float(np.median(self.missing_scaled)),
            "open_median": float(np.median(self.open)),
            "ground_m": str(self.lanes.ground) if isinstance(self.lanes.ground, Terrain) else self.lanes.ground,
            "settings": json.loads(
                json.dumps({k: v for k, v in vars(self.settings).items() if k != "torque_speed"}, default=str)
            ),
            "notes": [*self.motion.notes, *self.lanes.notes],
        }

    def export(self, path: str | os.PathLike[str], **settings: Any) -> Path:
        """Write it as one page that plays the motion; returns its path. Settings are those of `rbd.visual.export_motion`."""
        return drawing("export_motion")(self, path, **settings)

    def video(self, path: str | os.PathLike[str], **settings: Any) -> Path:
        """Write it as a video, .mp4 or .gif; returns its path. Settings are those of `rbd.visual.export_video`."""
        return drawing("export_video")(self, path, **settings)

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> list[Artist]:
        """Curves of the missing wrench and of torques on axes, or on a new figure; see `rbd.visual.plot_report`.

        A new figure is none of pyplot's: `artists[0].figure.savefig("report.png")` writes it.
        """
        return drawing("plot_report")(axes, self)

    def show(self, *, speed: float = 1.0) -> None:
        """Show the motion live in the browser, with its forces and the missing wrench; see `rbd.visual.replay`."""
        drawing("replay")(self, speed=speed)

    def _variables(self) -> list[tuple[str, Array, list[str], str, str]]:
        """Name, array, dimensions after time, unit and meaning."""
        m, lanes = self.motion, self.lanes
        return [
            ("q", m.q, ["position"], "", "configuration"),
            ("v", m.v, ["velocity"], "", "velocity"),
            ("a", m.a, ["velocity"], "", "acceleration"),
            ("possible", self.possible, [], "", "whether a frame has no cause"),
            ("causes", self.causes, ["cause"], "", "why a frame is not possible"),
            ("missing", self.missing, ["spatial"], "N, then N m", "least wrench missing on the base, about its centre of mass"),
            ("missing_scaled", self.missing_scaled, [], "1", "the same over the weight, moments over 0.3 m"),
            ("open", self.open, [], "1", "its standard deviation by noise of the accelerations"),
            ("reach", self.reach, [], "m", "height up to which points must touch for it to balance; inf where it does not"),
            ("grades", self.grades, [], "1", "how near a frame is to be possible: 1 where it is"),
            ("tilt", self.feet_faults.tilt, ["contact"], "rad", "angle between a sole that touches and the floor"),
            ("hover", self.feet_faults.hover, ["contact"], "m", "height of a foot that is meant to touch"),
            ("touches", lanes.touches, ["point"], "", "whether a point touches the floor"),
            ("slides", lanes.slides, ["point"], "", "whether it slides there"),
            ("raised", lanes.raised, ["point"], "", "whether it touches as meant, and is above the floor"),
            ("heights", lanes.heights, ["point"], "m", "height of a point above the floor"),
            ("speeds", lanes.speeds, ["point"], "m/s", "speed of a point along the floor; NaN where it does not touch"),
            ("points", lanes.places, ["point", "axis"], "m", "points in W"),
            ("forces", self.forces, ["point", "axis"], "N", "force on the robot at each point, in W"),
            ("tau", self.tau, ["motor"], "", "motor torques"),
            ("excess", self.excess, ["motor"], "1", "torque beyond its limit, over the limit"),
            ("used_torque", self.used_torque, ["motor"], "1", "torque over its limit"),
            ("used_friction", self.used_friction, ["contact"], "1", "tangential force over the largest; NaN without load"),
            ("edge_margin", self.edge_margin, ["contact"], "m", "centre of pressure to the sole's edge; NaN without load"),
            ("nearest_a", self.nearest_a, ["velocity"], "", "nearest possible acceleration"),
        ]  # fmt: skip

    def __str__(self) -> str:
        m, before = self.motion, self.before
        share = _beside(100 * self.share_possible, None if before is None else 100 * before.share_possible)
        score = _beside(self.score, None if before is None else before.score)
        shares = [(x, 100.0 * self._without(x), None if before is None else 100.0 * before._without(x)) for x in FIGURES]  # noqa: SLF001
        lines = [
            f"{m.source}: {m.n} frames of {m.robot.name}, {m.duration:.2f} s at {m.rate:.4g} Hz",
            *(f"  carries    {each}" for each in carried_by(m.robot)),
            f"  possible   {share} % of the frames, score {score} of 100",
            f"  {', '.join(f'{name} {_beside(now, was)}' for name, now, was in shares)} % of the frames without a fault",
            f"  feet, medians: {self.feet_faults}",
            "  possible if points up to " + ", ".join(f"{1e3 * h:g}" for h in HEIGHTS) + " mm touched: "
            + ", ".join(f"{100.0 * x:.1f}" for x in self.possible_at.values()) + " %",
        ]  # fmt: skip
        for i, cause in enumerate(CAUSES):
            count, was = int(self.causes[:, i].sum()), None if before is None else int(before.causes[:, i].sum())
            if count or was:
                lines.append(f"  {cause:<15}{_beside(count, was, 0)} frames{self._worst(cause)}")
        over = ", ".join(f"{100 * level:g} %: {100 * x:.1f}" for level, x in zip(THRESHOLDS, self.share_over(), strict=True))
        lines.append(f"  missing wrench over a share of the weight, % of the frames:  {over}")
        lines.append(
            f"  median missing {100 * float(np.median(self.missing_scaled)):.2g} % of the weight; noise of the accelerations "
            f"explains {100 * float(np.median(self.open)):.2g} %"
        )
        if m.derivation is not None:
            lines.append(f"  accelerations: {m.derivation}")
        s = self.settings
        given = m.contacts is not None or m.ground_given or s.ground not in (None, "fit")
        level = self.lanes.ground
        floor = f"{level}" if isinstance(level, Terrain) else f"floor {'given' if given else 'fitted'} at z = {level:.4g} m"
        lines.append(f"  friction {s.friction:g}, {floor}, threshold {100 * s.threshold:g} % of the weight")
        return "\n".join(lines + [f"  note: {note}" for note in (*m.notes, *self.lanes.notes)])

    def why(self, first: int, end: int) -> list[str]:
        """The causes of frames from `first` up to `end`, in words: with motors and bodies."""
        out = []
        for cause in (c for c in CAUSES if self.of_cause(c)[first:end].any()):
            named = ""
            if cause in ("motor", "torque-speed"):
                over = self.excess if cause == "motor" else self.used_torque - 1.0
                j = int(over[first:end].max(axis=0).argmax())
                named = f" {self.motion.robot.actuated_names[j]}"
            if cause == "self-collision" and self.collisions is not None:
                pairs = [" and ".join(pair) for pair, at in self.collisions.pairs.items() if ((at >= first) & (at < end)).any()]
                named = f" of {', '.join(pairs)}"
            if cause == "grasp":
                named = f" {self.grasps.words(first, end)}"
            if cause == "tips":
                named = self.lanes.over_edge(np.flatnonzero(self.of_cause(cause)[first:end]) + first)
            out.append(f"{cause}{named}")
        return out

    def _worst(self, cause: str) -> str:
        """The worst frames of a cause, and how bad the first of them is."""
        frames, t = self.worst(cause, 3), self.motion.t
        if not len(frames):
            return ""
        f = int(frames[0])
        told = f", worst {', '.join(f'{int(i)} ({t[i]:.2f} s)' for i in frames)}"
        if cause == "tilted sole":
            tilt, edge = (x[f].max() for x in (self.feet_faults.tilt, self.feet_faults.edge))
            return f"{told}: {np.rad2deg(tilt):.0f} degrees, its edge {1e3 * edge:.0f} mm up"
        if cause in _SIZES:
            factor, words = _SIZES[cause]
            edge = self.lanes.over_edge([f]) if cause == "tips" else ""
            return f"{told}: {factor * self._badness(cause)[f]:.0f} {words}{edge}"
        if cause == "motor":
            j = int(self.excess[f].argmax())
            return f"{told}: {self.motion.robot.actuated_names[j]} {100 * self.excess[f, j]:.0f} % beyond its limit"
        if cause == "torque-speed":
            return f"{told}: {self.on_line(f)}"
        if cause == "grasp":
            return f"{told}: {self.grasps.words(f, f + 1)}"
        if cause == "self-collision" and self.collisions is not None:
            pairs = [" and ".join(pair) for pair, at in self.collisions.pairs.items() if f in at]
            return f"{told}: {', '.join(pairs)}"
        return told


def _beside(now: float, was: float | None, digits: int = 1) -> str:
    text = f"{now:.{digits}f}"
    return text if was is None else f"{was:.{digits}f} -> {text}"
