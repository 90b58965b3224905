"""`Motion`: a reference motion of a robot, configurations with velocities and accelerations over time."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, as_array, as_float, check_finite
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.motion.derivation import NEARLY_UNIT, Derivation, checked_times, derivative, derivatives, method_of, unit_blocks
from rbd.motion.reading import read_frames

if TYPE_CHECKING:
    from rbd.simulation.trajectory import Trajectory

EXACT = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """A motion of a robot: n frames, read-only arrays, SI units.

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
        ground: Height of the floor [m].
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array
    a: Array
    source: str = "arrays"
    notes: tuple[str, ...] = ()
    derivation: Derivation | None = None
    contacts: Any = None
    ground: float = 0.0

    def __post_init__(self) -> None:
        for name in ("t", "q", "v", "a"):
            getattr(self, name).flags.writeable = False

    @classmethod
    def of_arrays(
        cls,
        robot: CheckedModel,
        t: Array,
        q: Array,
        v: Array | None = None,
        a: Array | None = None,
        *,
        source: str = "arrays",
        notes: Iterable[str] = (),
        window: float = 0.2,
        order: int = 3,
        cutoff: float | None = None,
        noise: float | Array = 0.0,
        ground: float = 0.0,
    ) -> Motion:
        """The motion of arrays; v and a, where they are not given, by `rbd.motion.derivatives`.

        Quaternions within 1e-3 of unit length are normalised, and a note says so.

        Args:
            robot: The robot.
            t: Times, shape (n,) [s], increasing.
            q: Configurations, shape (n, nq).
            v: Velocities, shape (n, nv).
            a: Accelerations, shape (n, nv), only with v.
            source: Where they came from.
            notes: What is to be said of them.
            window: Length of the windows that v and a are computed in [s].
            order: Order of the polynomials in them.
            cutoff: Frequency of a low-pass in place of window and order [Hz].
            noise: Standard deviation of q along each velocity, a number or shape (nv,) [m, rad].
            ground: Height of the floor [m].

        Raises:
            InputError: sizes that do not fit, times that do not increase, numbers that are not finite, quaternions of
                another length.
        """
        if not isinstance(robot, CheckedModel):
            raise InputError(f"robot is a {type(robot).__name__}; expected a robot: rbd.load_robot('g1').")
        t, q = checked_times(t), as_array("q", q)
        _check_shape("q", q, (len(t), robot.nq))
        said = [*notes, *_normalise(robot, q)]
        how = None
        settings: dict[str, Any] = {"window": window, "order": order}
        if v is None and a is not None:
            raise InputError("a was given without v; give both, or neither.")
        if v is None:
            v, a, how = derivatives(robot, t, q, **settings, method=method_of(cutoff), cutoff=cutoff, noise=noise)
        else:
            v = as_array("v", v)
            _check_shape("v", v, (len(t), robot.nv))
            if a is None:
                if len(t) < 2:
                    raise InputError("one frame has no acceleration; give a with v.")
                a = derivative(t, v, **settings)
                said.append(f"accelerations are derivatives of the velocities given, over {window:g} s.")
        a = as_array("a", a)
        _check_shape("a", a, (len(t), robot.nv))
        height = as_float(ground)
        if not abs(height) < 1e5:
            raise InputError(f"ground is {ground!r:.80}; expected a height [m].")
        return cls(robot, t, q, v, a, str(source), tuple(said), how, None, height)

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
        order: int = 3,
        cutoff: float | None = None,
        ground: float | None = None,
        progress: bool = True,
    ) -> Motion:
        """The motion of a file; whatever had to be guessed is in its notes.

        - A table of text without a header (.csv, any other suffix): root x y z [m], quaternion, joints in the order of the
          robot's own file, or of a format known by its number of columns, with times [s] in front or without.
        - The same with names in a header: t, root_x, root_y, root_z, root_qx, ..., root_qw, and joints, in any order.
        - .npz with `fps`, `joint_pos`, `body_pos_w`, `body_quat_w`: the order of its joints is tried and proved by forward
          kinematics, to a millimetre, or refused.
        - .npz with `q` and `t`, and `v`, `a`; of `Motion.save`; and trajectories of `rbd`, .npz or .nc.

        Pickles are never read.

        Args:
            path: The file.
            robot: The robot, or a name or file for `rbd.load_robot`; files of `save` name theirs.
            rate: Frames a second, of a file without times; else of its name ("walk_30hz.csv").
            quaternion: "xyzw" or "wxyz"; by default that in which the base stays upright, in an .npz of bodies "wxyz".
            joints: Names of the joints of the columns, in order, without those of a base.
            units: "rad" or "deg" of the joints' angles; by default radians, where they can be.
            window: Length of the windows that v and a are computed in [s].
            order: Order of the polynomials in them.
            cutoff: Frequency of a low-pass in place of window and order [Hz].
            ground: Height of the floor [m]; by default 0, or that of the file.
            progress: Show a bar on a terminal where reading takes long.

        Raises:
            InputError: no such file, or one that holds no motion of this robot: names line and column, or array and frame.
            ModelError: the robot's own file is missing or broken.

        >>> motion = rbd.Motion.read("dance.csv", robot="g1", rate=60)
        """
        found = read_frames(path, robot, rate=rate, quaternion=quaternion, joints=joints, units=units, progress=progress)
        height = found.ground if ground is None else ground
        given: dict[str, Any] = {"source": Path(path).name, "notes": found.notes, "noise": found.noise, "ground": height}
        settings: dict[str, Any] = {"window": window, "order": order, "cutoff": cutoff}
        out = cls.of_arrays(found.robot, found.t, found.q, found.v, found.a, **given, **settings)
        return out if found.derivation is None else replace(out, derivation=found.derivation)

    @classmethod
    def of_trajectory(cls, trajectory: Trajectory) -> Motion:
        """The motion of a trajectory: its t, q, v and a as they were simulated."""
        x = trajectory
        return cls.of_arrays(x.robot, x.t, x.q, x.v, x.a, source="trajectory")

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
        if isinstance(i, bool) or not isinstance(i, int | np.integer) or not -self.n <= i < self.n:
            raise InputError(f"frame {i!r:.80} of a motion; expected a whole number from {-self.n} to {self.n - 1}.")
        return State(self.robot, self.q[i], self.v[i])

    def __len__(self) -> int:
        return self.n

    def __repr__(self) -> str:
        times = f"{self.t[0]:g} to {self.t[-1]:g} s at {self.rate:.4g} Hz"
        return f"Motion({self.robot.name!r}, {self.n} frames, {times}, from {self.source})"


def _check_shape(what: str, x: Array, shape: tuple[int, ...]) -> None:
    if x.shape != shape:
        raise InputError(f"{what} has shape {x.shape}; expected {shape}: a row a time, a column a coordinate.")
    if not np.isfinite(x).all():
        row, column = np.argwhere(~np.isfinite(x))[0]
        raise InputError(f"{what} at frame {row}, column {column} is {x[row, column]}; expected a finite number.")
    check_finite(what, x)


def _normalise(robot: CheckedModel, q: Array) -> list[str]:
    """Divide quaternions and unit circles by their norms, in place, and say so where it changes them."""
    said = []
    for block in unit_blocks(robot):
        norm = np.linalg.norm(q[:, block], axis=1)
        off = np.abs(norm - 1.0)
        worst = int(off.argmax())
        if not off[worst] <= NEARLY_UNIT:
            what = "quaternion (x, y, z, w)" if block.stop - block.start == 4 else "unit circle (cos, sin)"
            raise InputError(
                f"frame {worst}: the {what} in columns {block.start} to {block.stop - 1} has norm {norm[worst]:.6g}; "
                f"expected 1 to {NEARLY_UNIT:g}. Are these its columns?"
            )
        q[:, block] /= norm[:, None]
        if off[worst] > EXACT:
            said.append(
                f"unit vectors in columns {block.start} to {block.stop - 1} were normalised: off by up to {off[worst]:.1g}."
            )
    return said
