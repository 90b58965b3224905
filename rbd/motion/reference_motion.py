"""`Motion`: a reference motion of a robot, configurations with velocities and accelerations; motions made from poses."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rbd.arrays import Array, as_array, as_finite, as_float, check_flag, check_number, check_whole, locked
from rbd.constraints.terrain.terrain import Terrain, check_still
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import FARTHEST, CheckedModel
from rbd.model.sampled_motion import (
    conjugate,
    cubic,
    exponential,
    flat_coordinates,
    from_flat,
    interpolated_q,
    logarithm,
    minimum_jerk_way,
    own_rates,
    product,
    quaternions,
)
from rbd.model.state import State
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.derivation import (
    Derivation,
    check_cutoff,
    checked_times,
    derivative,
    derivatives,
    derived_again,
    low_passed,
    stencil_derivatives,
)
from rbd.motion.file_conventions import order_base
from rbd.motion.file_frames import (
    ReadSettings,
    check_base_height,
    check_quaternion,
    check_rate,
    check_shape,
    counts_frames,
    normalise,
    times_of,
    value_at,
)
from rbd.motion.motion_files import read_frames
from rbd.motion.motion_writing import ToSave, save_motion
from rbd.motion.rates import checked_rates
from rbd.motion.symmetry import mirrored, symmetry_of
from rbd.robots.carried import Carried, carried_by
from rbd.robots.robot import Robot
from rbd.simulation.trajectory import Trajectory

STENCIL = 1e-3
"""Time between the values of a function that v and a come from [s]."""
ARRAYS = "arrays"
"""Source of a motion that was given none."""


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Displayed):
    """A motion to check, edit and follow: q, v and a of a robot at n frames, read or made, in read-only arrays; SI units.

    Made by `Motion.of_arrays` and its kin, which check what they are given; the constructor takes its fields as they are.

    Attributes:
        robot: The robot.
        t: Times, shape (n,) [s], increasing.
        q: Configurations, shape (n, nq).
        v: Velocities, shape (n, nv) [m/s, rad/s]; of a floating base in its own axes.
        a: Accelerations, shape (n, nv) [m/s2, rad/s2].
        source: Where it came from: a file's name, "arrays", "trajectory" or "function".
        notes: Every guess that was made and every change of the data, in words.
        derivation: How v and a came from q; None where they were given.
        contacts: Which points touch and slide, when; None: `find_contacts` finds them.
        ground: Height of the floor [m], or the terrain.
        ground_given: Whether that was given; else the floor is fitted where contacts are looked for.
        forces: On the robot at the points of its contacts, in W, shape (n, k, 3) [N]; None where they are not known.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> q, up = solo.standing().q, np.eye(solo.nq)[2]
        >>> times = np.linspace(0.0, 1.0, 61)
        >>> motion = rbd.Motion.from_function(solo, lambda t: q + 0.05 * np.sin(2 * np.pi * t) * up, times)
        >>> motion.n, motion.duration, round(float(motion.a[:, 2].max()), 3)
        (61, 1.0, 1.974)
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    a: Array
    source: str = ARRAYS
    notes: tuple[str, ...] = ()
    derivation: Derivation | None = None
    contacts: ContactTimeline | None = None
    ground: float | Terrain = 0.0
    ground_given: bool = False
    forces: Array | None = None

    def __post_init__(self) -> None:
        for name in ("t", "q", "v", "a", "forces"):
            if (x := getattr(self, name)) is not None:
                object.__setattr__(self, name, locked(x.view()))  # whoever gave an array may go on to write to it

    @classmethod
    def of_arrays(
        cls,
        robot: CheckedModel,
        t: Array,
        q: Array,
        v: Array | None = None,
        a: Array | None = None,
        *,
        source: str = ARRAYS,
        notes: Sequence[str] = (),
        window: float = 0.2,
        order: int = 4,
        cutoff: float | None = None,
        noise: float | Array = 0.0,
        ground: float | Terrain | None = None,
        quaternion: str | None = None,
        trust: bool = False,
    ) -> Motion:
        """The motion of arrays; v and a, where they are not given, by `rbd.motion.derivatives`.

        Quaternions within 5 % of unit length are normalised, and a note says so. Given v and a must be the rates of q, within
        what sampling and noise leave open, a tenth at least; those of a base in world axes (MuJoCo's linear ones, Isaac's and
        Drake's linear and angular ones) are recognised, converted to its own axes and told in the notes.

        Args:
            robot: The robot.
            t: Times, shape (n,) [s], increasing.
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            a: Accelerations, shape (n, nv), only with v.
            source: Where they came from; see `title`.
            notes: What is to be said of them.
            window: Length of the windows that v and a are computed in [s].
            order: Order of the polynomials in them.
            cutoff: Frequency of a low-pass in place of window and order [Hz].
            noise: Standard deviation of q along each velocity, a number or shape (nv,) [m, rad].
            ground: Height of the floor [m], or an `rbd.Terrain`; by default it is not known: 0, and fitted where contacts are
                looked for.
            quaternion: "xyzw" or "wxyz"; by default x, y, z, w, unless only w, x, y, z fits v, or keeps the base upright.
            trust: Take times, lengths, v and a as they are, without looking whether they can be.

        Raises:
            InputError: sizes that do not fit, times that do not increase, numbers that are not finite, quaternions of
                another length; v or a that is not the rate of q, with the coordinate and the factor; frame numbers as times;
                a base in millimetres or centimetres.
        """
        check_kind("robot", robot, CheckedModel, "a robot: rbd.load_robot('g1')")
        t, q = checked_times(t), as_array("q", q)
        check_shape("q", q, (len(t), robot.nq), FARTHEST)
        if not isinstance(notes, list | tuple) or not all(isinstance(note, str) for note in notes):
            raise InputError(f"notes is {notes!r:.80}; expected a list of sentences.")
        check_flag("trust", trust)
        check_quaternion(quaternion)
        said = [*notes, *normalise(robot, q)]
        how = None
        settings: dict[str, Any] = {"window": window, "order": order}
        if isinstance(ground, Terrain):
            check_still(ground)
        height = ground if isinstance(ground, Terrain) else _height(ground)
        if v is None and a is not None:
            raise InputError("a was given without v; give both, or neither.")
        for what, x in (("v", v), ("a", a)):
            if x is not None:
                check_shape(what, as_array(what, x), (len(t), robot.nv), FARTHEST if what == "v" else np.inf)
        v, a = (None if x is None else as_array(what, x) for what, x in (("v", v), ("a", a)))
        said += order_base(robot, t, q, v, quaternion, str(source))
        if not trust:
            check_base_height(robot, q, 0.0 if isinstance(height, Terrain) else height, str(source))
        if v is None:
            if len(t) == 1:
                raise InputError(f"{source}: one frame has no velocity; expected two frames or more, or v and a with q.")
            if not trust and counts_frames(t):
                raise InputError(
                    f"{source}: times are {t[0]:g}, {t[1]:g}, {t[2]:g}, ...: these count frames. Expected seconds: "
                    "t = numpy.arange(n) / rate; or trust=True of a motion with one frame a second."
                )
            v, a, how = derivatives(
                robot, t, q, **settings, method="local polynomial" if cutoff is None else "low-pass", cutoff=cutoff, noise=noise
            )
        else:
            if not trust:
                v, a, converted = checked_rates(robot, t, q, v, a, str(source))
                said += converted
            if a is None:
                a = derivative(t, v, **settings)
                said.append(f"accelerations are derivatives of the velocities given, over {window:g} s.")
        return cls(robot, t, q, v, a, str(source), tuple(said), how, None, height, ground is not None)

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        *,
        robot: CheckedModel | str | os.PathLike[str] | None = None,
        rate: float | None = None,
        quaternion: str | None = None,
        joints: Sequence[str] | None = None,
        units: str | None = None,
        window: float = 0.2,
        order: int = 4,
        cutoff: float | None = None,
        ground: float | Terrain | None = None,
        motion: str | None = None,
        trust: bool = False,
        progress: bool = True,
    ) -> Motion:
        """The motion of a file; whatever had to be guessed is in its notes.

        - A table of text without a header (.csv, any other suffix): root x y z [m], quaternion, joints in the order of the
          robot's own file, or of a format known by its number of columns, with times [s] in front or without.
        - The same with names in a header: t, root_x, root_y, root_z, root_qx, ..., root_qw, and joints, in any order.
        - .npz, pickles and files of joblib, by the names of their arrays: `q` and `t`, and `v`, `a`, of `Motion.save`;
          `root_pos`, `root_rot`, `dof_pos`, `fps` (GMR, TWIST); `root_trans_offset`, `root_rot`, `dof`, `fps` (PHC, ASAP);
          `qpos` and its rate (MuJoCo, LocoMuJoCo), also an .npy of it alone; `fps`, `joint_pos`, `body_pos_w`, `body_quat_w`
          (BeyondMimic, holosoma): the order of its joints is tried and confirmed by forward kinematics, or refused.
        - Trajectories of `rbd`, .npz or .nc.
        - Logs, MCAP and rosbag2, with joint states and the pose of a base; `motion` names a topic. They need the extra `logs`.

        Pickles are read as data: NumPy arrays, dicts, lists, strings and numbers. All else is refused by name; nothing runs.
        Joints beyond their limits that fit in another unit or order, or with left and right exchanged, are refused.

        Args:
            path: The file.
            robot: The robot, or a name or file for `rbd.load_robot`; files of `save` name theirs.
            rate: Frames a second, of a file without times, or one that numbers its frames; else of its name
                ("walk_30hz.csv").
            quaternion: "xyzw" or "wxyz"; by default that in which the base stays upright, in an .npz of bodies "wxyz".
            joints: Names of the joints of the columns, in order, without those of a base.
            units: "rad" or "deg" of the joints' angles; by default radians, where they can be.
            window: Length of the windows that v and a are computed in [s].
            order: Order of the polynomials in them.
            cutoff: Frequency of a low-pass in place of window and order [Hz].
            ground: Height of the floor [m], or an `rbd.Terrain`; by default that of the file, else fitted where contacts are
                looked for.
            motion: Name of the motion, of a file that holds several; of a log, the topic of the joint states.
            trust: Take times, lengths, joints, v and a of the file as they are; see `of_arrays`.
            progress: Show a bar on a terminal where reading takes long.

        Raises:
            InputError: no such file, or one that holds no motion of this robot: names line and column, or array and frame.
            ModelError: the robot's own file is missing or broken.

        >>> motion = rbd.Motion.read("dance.csv", robot="g1", rate=60)
        """
        found = read_frames(path, robot, ReadSettings(rate, quaternion, joints, units, trust, motion), progress=progress)
        out = cls.of_arrays(
            found.robot, found.t, found.q, found.v, found.a, source=Path(path).name, notes=found.notes, noise=found.noise,
            ground=found.ground if ground is None else ground, window=window, order=order, cutoff=cutoff,
            quaternion=found.quaternion, trust=trust or found.simulated,
        )  # fmt: skip
        out = out if found.derivation is None else replace(out, derivation=found.derivation)
        if found.contacts is None:
            return out
        lanes, forces, told = found.contacts.of(out, out.ground)
        return replace(out, contacts=lanes, forces=forces, notes=(*out.notes, told))

    @classmethod
    def of_trajectory(cls, trajectory: Trajectory) -> Motion:
        """The motion of a trajectory: its t, q, v and a as they were simulated, on its terrain if it has one."""
        x = trajectory
        check_kind("trajectory", x, Trajectory, "what rbd.simulate returns")
        several = [f"its {len(x.terrains)} terrains are left out: ground= names one."] if len(x.terrains) > 1 else []
        return cls.of_arrays(
            x.robot, x.t, x.q, x.v, x.a, source="trajectory", notes=several, quaternion="xyzw", trust=True,
            ground=x.terrains[0] if len(x.terrains) == 1 else None,
        )  # fmt: skip

    @classmethod
    def from_function(
        cls, robot: CheckedModel, f: Callable[[float], Array], t: Array, *, ground: float | Terrain | None = None
    ) -> Motion:
        """The motion q = f(t) at given times; v and a by differences over 4 ms, of fourth and third order.

        Args:
            robot: The robot.
            f: Takes a time [s], also up to 2 ms before the first and after the last; returns q, shape (nq,).
            t: Times, shape (n,) [s], increasing by 5 ms or more.
            ground: Height of the floor [m], or an `rbd.Terrain`; see `of_arrays`.

        Raises:
            InputError: times that do not increase so, or what f returns is no q of this robot.
        """
        if not isinstance(robot, CheckedModel) or not callable(f):
            raise InputError(f"robot and f are {robot!r:.60} and {f!r:.60}; expected a robot and a function of time.")
        t = checked_times(t)
        if len(t) > 1 and np.diff(t).min() < 5.0 * STENCIL:
            raise InputError(f"times are {np.diff(t).min():.3g} s apart; expected {5.0 * STENCIL:g} s or more.")
        times = (t[:, None] + STENCIL * np.arange(-2, 3)).ravel()
        q = np.array([robot.check_q(value_at(f, float(each))) for each in times])
        v, a = stencil_derivatives(robot, times, q)
        return cls.of_arrays(robot, t, q[2::5], v, a, source="function", ground=ground, quaternion="xyzw", trust=True)

    @property
    def title(self) -> str:
        """What its pages are called: its source, or its robot's name where that is only "arrays"."""
        return self.robot.name if self.source == ARRAYS else self.source

    @property
    def n(self) -> int:
        """How many frames it has."""
        return len(self.t)

    @property
    def duration(self) -> float:
        """From the first frame to the last [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def rate(self) -> float:
        """Frames a second, in the mean [Hz]; infinite of one frame."""
        return (self.n - 1) / self.duration if self.n > 1 else np.inf

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the robot's joints, in the order of q, without a floating base."""
        return tuple(joint.name for joint in self.robot.joints.values() if joint.id not in self.robot.bases)

    def state(self, i: int) -> State:
        """The robot at frame i; negative ones count from the end."""
        check_whole("the frame of a motion", i, self.n - 1, least=-self.n)
        return State(self.robot, self.q[i], self.v[i], t=float(self.t[i]))

    def with_contacts(self, contacts: ContactTimeline | None, forces: Array | None = None) -> Motion:
        """The same motion with given contacts, or None to have them found.

        Args:
            contacts: Of this motion.
            forces: At their points, in W, shape (n, k, 3) [N], as `MotionReport.forces` has them.

        Raises:
            InputError: contacts of another motion; forces of another shape, or without contacts.
        """
        if contacts is not None and (not isinstance(contacts, ContactTimeline) or not np.array_equal(contacts.t, self.t)):
            raise InputError(
                f"contacts is {contacts!r:.80}; expected ContactTimeline of this motion: rbd.motion.find_contacts(motion)."
            )
        if forces is not None:
            if contacts is None:
                raise InputError("forces act at contacts; expected both: motion.with_contacts(report.lanes, report.forces).")
            meaning = ": a force [N] a frame and point, as report.forces"
            forces = as_finite("forces", forces, (self.n, len(contacts.names), 3), meaning=meaning)
        return replace(self, contacts=contacts, forces=forces)

    def carrying(self, *things: Carried) -> Motion:
        """The same motion of a robot that carries objects, taken as in the first frame; see `Robot.carrying`.

        Two hands are to keep the grasp that they have there. v, a and contacts stay, forces do not; check and repair it then.

        Raises:
            InputError: what `Robot.carrying` refuses.

        >>> report = rbd.check_motion(motion.carrying(rbd.Carried(3.0, ["left_wrist_yaw_link", "right_wrist_yaw_link"])))
        """
        if not isinstance(self.robot, Robot):
            raise InputError(f"{self.robot.name} is a bare model; expected a robot: rbd.load_robot('g1').")
        robot, lanes = self.robot.carrying(*things, at=self.q[0]), self.contacts
        lanes = lanes and replace(lanes, points=replace(lanes.points, robot=robot))
        return replace(self, robot=robot, contacts=lanes, forces=None)

    def resample(self, rate: float) -> Motion:
        """The motion at another rate [Hz]; q by cubics on the manifold through q and v of the frames.

        v and a are derived again as they were; given ones are interpolated. The last frame is the last that fits.

        Raises:
            InputError: a rate that no motion has, or a motion of one frame.
        """
        rate = check_rate(rate)
        if self.n < 2:
            raise InputError("a motion of one frame cannot be resampled.")
        t = times_of(float(self.t[0]), float(self.t[-1]), rate)
        if len(t) < 2:
            raise InputError(f"rate is {rate:g}; a motion of {self.duration:g} s has no two frames then.")
        q = interpolated_q(self.robot, self.t, self.q, self.v, t)
        note = f"resampled from {self.rate:.6g} to {rate:.6g} Hz."
        if self.derivation is not None:
            return self._changed(note, t=t, q=q)
        a = np.stack([np.interp(t, self.t, x) for x in self.a.T], axis=1)
        return self._changed(note, t=t, q=q, v=cubic(self.t, self.v, self.a, t), a=a)

    def cut(self, start: float | None = None, end: float | None = None) -> Motion:
        """The frames from one time to another [s], both included; times remain as they are.

        Raises:
            InputError: no frame is between them.
        """
        begin = self.t[0] if start is None else as_float(start)
        stop = self.t[-1] if end is None else as_float(end)
        chosen = (self.t >= begin - 1e-9) & (self.t <= stop + 1e-9)
        if not chosen.any():
            raise InputError(
                f"no frame is from {start!r:.40} to {end!r:.40} s; the motion is from {self.t[0]:g} to {self.t[-1]:g} s."
            )
        given = {name: getattr(self, name)[chosen] for name in ("t", "q", "v", "a")}
        lanes = self.contacts and self.contacts.at_frames(chosen)
        forces = None if self.forces is None else self.forces[chosen]
        return self._changed(f"cut to {given['t'][0]:g} to {given['t'][-1]:g} s.", contacts=lanes, forces=forces, **given)

    def mirror(self) -> Motion:
        """Left and right exchanged, by the names of the joints, across the plane y = 0 of the world.

        Kinematics is mirrored to the symmetry of the robot, whose joints are checked; its masses are not.

        Raises:
            InputError: a robot without a floating base or with full hands, a motion on terrain, a joint that is not the mirror
                image of its partner.
        """
        if held := carried_by(self.robot):
            raise InputError(f"{self.robot.name} carries {held[0]}; expected free hands: motion.mirror().carrying(...).")
        if isinstance(self.ground, Terrain):
            raise InputError(f"the motion is on {self.ground}; expected a level floor to mirror it on.")
        symmetry = symmetry_of(self.robot)
        q, (v, a) = mirrored(self.robot, symmetry, self.q, (self.v, self.a))
        how = self.derivation
        if how is not None:
            noise = {f"noise_{x}": getattr(how, f"noise_{x}")[symmetry.partner] for x in "qva"}
            how = replace(how, **noise)
        error = f"; the robot is symmetric to {1e3 * symmetry.error:.2g} mm" if symmetry.error > 1e-6 else ""
        return self._changed(f"left and right were exchanged{error}.", q=q, v=v, a=a, derivation=how)

    def lifted(self, height: float) -> Motion:
        """The same motion higher above the floor, by a constant [m].

        Raises:
            InputError: a robot without a floating base, or no height.
        """
        by = check_number("height", height, -1e5, 1e5, expected="a length [m]")
        if not self.robot.floating:
            raise InputError(f"{self.robot.name} has no floating base that could be lifted.")
        q = self.q.copy()
        q[:, 2] += by
        return self._changed(f"lifted by {by:g} m.", q=q, v=self.v, a=self.a)

    def filtered(self, cutoff: float) -> Motion:
        """Q smoothed by a low-pass without delay, and v and a from it; half of an amplitude at `cutoff` [Hz] is left.

        Raises:
            InputError: a cut-off that the rate does not allow, or unequal times.
        """
        q = low_passed(self.robot, self.q, check_cutoff(cutoff, self.t))
        noise = 0.0 if self.derivation is None else self.derivation.noise_q
        v, a, how = derivatives(self.robot, self.t, self.q, method="low-pass", cutoff=cutoff, noise=noise)
        return self._changed(f"smoothed by a low-pass at {cutoff:g} Hz.", contacts=self.contacts, q=q, v=v, a=a, derivation=how)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        kind: str = "motion",
        header: bool = True,
        decimals: int = 6,
    ) -> None:
        """Write it to a file that `read` reads; an existing one is replaced only when the new one is complete.

        Contacts and forces, if it has them, are beside it in an .npz or .pkl, in arrays that `read` takes up: `contact_names`,
        shape (k,), `contact_labels`, `contact_slides` and `contact_raised`, shape (n, k), `contact_positions`, shape (n, k, 3)
        [m], and `contact_forces` [N]; and `ground`, the height of the floor, or `terrain`. A .csv has no
        place for them, and refuses a terrain.

        Args:
            path: Ends in .csv or .npz; of GMR in .pkl or .npz.
            kind: "motion": a table of t and q in a .csv, or t, q, v and a to the last bit in an .npz. "beyondmimic", as
                trackers of motions read it: fps, joint_pos, joint_vel, and the poses and velocities of all bodies, joints
                breadth-first, quaternions w x y z. "gmr": fps, root_pos, root_rot x y z w, dof_pos, local_body_pos,
                link_body_list. "mujoco": qpos and qvel, quaternions w x y z, joint_names, frequency.
            header: Of a .csv: names and times; False for numbers alone, as most tools for retargeted motions expect.
            decimals: Of a .csv.

        Raises:
            InputError: another suffix, a path that cannot be written, or a robot that this kind of file cannot hold.
        """
        check_flag("header", header)
        ground = self.ground if self.ground_given else None
        held = ToSave(self, self.contacts, self.forces, self.notes, self.derivation, ground)
        save_motion(held, path, kind, header=header, decimals=decimals)

    def _changed(self, note: str, **fields: Any) -> Motion:
        """A copy with other arrays; v, a derived again where they are not given, contacts and forces left out likewise."""
        notes = [*self.notes, note]
        fields.setdefault("forces", None)
        if self.contacts is not None and "contacts" not in fields:
            fields["contacts"] = None
            notes.append("contacts given before were left out.")
        if "v" not in fields and self.derivation is not None:
            t, q = fields.get("t", self.t), fields["q"]
            fields["v"], fields["a"], fields["derivation"] = derived_again(self.robot, t, q, self.derivation)
        return replace(self, notes=tuple(notes), **fields)

    def __len__(self) -> int:
        return self.n

    def __str__(self) -> str:
        how = "v and a were given" if self.derivation is None else f"v and a by {self.derivation}"
        return "\n".join([repr(self), *(f"  {line}" for line in (how, *self.notes))])

    def __repr__(self) -> str:
        times = f"{self.t[0]:g} to {self.t[-1]:g} s at {self.rate:.4g} Hz"
        return f"Motion({self.robot.name!r}, {self.n} frames, {times}, from {self.source})"


def minimum_jerk(
    robot: CheckedModel, poses: Sequence[Array], times: Array, *, rate: float = 60.0, ground: float | Terrain | None = None
) -> Motion:
    """The motion through poses with minimum jerk between each two, at rest at each of them; v and a are exact.

    Each coordinate goes 10 s^3 - 15 s^4 + 6 s^5 of its way, s = 0 to 1: joints and positions along straight lines, rotations
    about one axis. Quintics from rest to rest have the least integral of the squared jerk [Flash1985].

    Args:
        robot: The robot.
        poses: Configurations, each of shape (nq,), two or more.
        times: When each of them is reached [s], increasing.
        rate: Frames a second.
        ground: Height of the floor [m], or an `rbd.Terrain`; see `Motion.of_arrays`.

    Raises:
        InputError: as many times as poses are expected, times that increase, configurations of this robot.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> motion = rbd.motion.minimum_jerk(arm, [np.array([0.0]), np.array([1.0])], [0.0, 1.0], rate=4.0)
        >>> motion.q[:, 0].round(4), motion.v[:, 0].round(4)
        (array([0.    , 0.1035, 0.5   , 0.8965, 1.    ]), array([0.    , 1.0547, 1.875 , 1.0547, 0.    ]))
    """
    check_kind("robot", robot, CheckedModel, "a robot: rbd.load_robot('g1')")
    t, rate = checked_times(times), check_rate(rate)
    listed = isinstance(poses, list | tuple) or (isinstance(poses, np.ndarray) and poses.ndim == 2)
    if not listed or len(poses) != len(t) or len(t) < 2:
        raise InputError(f"poses is {poses!r:.80} for {len(t)} times; expected two or more configurations, one a time.")
    q = np.array([robot.check_q(pose) for pose in poses])
    at = times_of(float(t[0]), float(t[-1]), rate)
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    h = (t[i + 1] - t[i])[:, None]
    s = (at - t[i])[:, None] / h
    way = minimum_jerk_way(s)
    speed = 30.0 * (s * (1.0 - s)) ** 2 / h
    rise = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / h**2
    x, turns = flat_coordinates(robot, q), []
    change = x[i + 1] - x[i]
    v, a = speed * change, rise * change
    for own, spin in quaternions(robot):
        vector = logarithm(product(conjugate(q[i, own]), q[i + 1, own]))
        turns.append(product(q[i, own], exponential(way * vector)))
        v[:, spin], a[:, spin] = speed * vector, rise * vector
    out = from_flat(robot, x[i] + way * change, turns)
    v, a = own_rates(robot, out, v, a)
    return Motion.of_arrays(robot, at, out, v, a, source="minimum jerk", ground=ground, quaternion="xyzw", trust=True)


def _height(ground: float | None) -> float:
    return check_number("ground", 0.0 if ground is None else ground, -1e5, 1e5, expected="a height [m], or an rbd.Terrain")
