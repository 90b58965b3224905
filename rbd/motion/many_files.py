"""Many files of motions: those of folders, patterns and mappings of robots to files, listed at once and read one by one."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias
from zipfile import BadZipFile, ZipFile

from rbd.displayed import Displayed
from rbd.errors import InputError, RbdError
from rbd.errors.inputs import listed_items
from rbd.model.checked_model import CheckedModel
from rbd.motion.array_files import motion_names
from rbd.motion.file_frames import OtherRate
from rbd.motion.motion_files import PICKLES, SUFFIXES
from rbd.motion.reference_motion import Motion
from rbd.robots.loading import load_robot

Names: TypeAlias = str | os.PathLike[str]


@dataclass(frozen=True, eq=False, repr=False)
class MotionFile(Displayed):
    """A motion in a file, not yet read; it can be sent to another process.

    Attributes:
        path: The file.
        robot: The robot, or what names it; None where the file does.
        name: Of the motion, in a file that holds several; else empty.

    Example:
        >>> file = rbd.motion.list_motions("dance.csv", "g1")[0]
        >>> print(file, file.robot.name)
        dance.csv g1
    """

    path: Path
    robot: CheckedModel | Names | None = None
    name: str = ""

    def read(self, **settings: Any) -> Motion:
        """The motion; arguments and errors as `Motion.read`, but files that have a rate keep it, with a note."""
        given = settings | {"robot": self.robot} | ({"motion": self.name} if self.name else {})
        try:
            return Motion.read(self.path, **given)
        except OtherRate as error:
            found = Motion.read(self.path, **given | {"rate": None})
            return replace(found, notes=(*found.notes, f"its own rate was kept: {str(error).removesuffix(' Leave out rate.')}"))

    def __str__(self) -> str:
        return f"{self.path}[{self.name}]" if self.name else str(self.path)


def list_motions(
    files: Names | Iterable[Names] | Mapping[Any, Names | Iterable[Names]], robot: CheckedModel | Names | None = None
) -> list[MotionFile]:
    """The motions that are meant, each once, in order: files as they are, of folders and patterns those they have.

    Robots are loaded, each once. No motion is read, but the names in files that can hold several.

    Args:
        files: A file; a folder, with all below it; a pattern, "clips/*.csv" or "clips/**/*.npz"; several of them; or a mapping
            of robots, or their names, to these.
        robot: The robot of all, or a name or file for `rbd.load_robot`; not with a mapping.

    Raises:
        InputError: a folder without motions, a pattern without files, no path, a robot beside a mapping.
        UnknownRobot: a robot that has no such name.

    Example:
        >>> rbd.motion.list_motions("no/such/*.csv")
        Traceback (most recent call last):
            ...
        rbd.errors.InputError: no file is like 'no/such/*.csv'.
    """
    if isinstance(files, Mapping) and robot is not None:
        raise InputError("files names the robots of its motions; leave out robot.")
    found: dict[str, MotionFile] = {}
    for own, given in files.items() if isinstance(files, Mapping) else [(robot, files)]:
        loaded = own if own is None or isinstance(own, CheckedModel) else load_robot(own)
        for path in _paths([given] if isinstance(given, str | os.PathLike) else given):
            for name in _names(path):
                file = MotionFile(path, loaded, name)
                found.setdefault(str(file), file)
    return list(found.values())


def read_all(
    files: Names | Iterable[Names] | Mapping[Any, Names | Iterable[Names]],
    *,
    robot: CheckedModel | Names | None = None,
    **settings: Any,
) -> Iterator[tuple[MotionFile, Motion | RbdError]]:
    """Each motion with its file, read when it is asked for; in place of one that cannot be read, the error that says why.

    Args:
        files: As of `list_motions`.
        robot: As of `list_motions`.
        settings: Arguments of `Motion.read`.

    Raises:
        InputError: as `list_motions`, at once.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> rbd.Motion.from_function(solo, lambda t: solo.standing().q, np.linspace(0.0, 1.0, 31)).save("stands.npz")
        >>> for file, motion in rbd.motion.read_all(["stands.npz", "gone.npz"], robot=solo):
        ...     print(file, type(motion).__name__)
        stands.npz Motion
        gone.npz InputError
    """
    listed = list_motions(files, robot)
    return ((file, _read(file, settings)) for file in listed)


def _read(file: MotionFile, settings: Mapping[str, Any]) -> Motion | RbdError:
    try:
        return file.read(**settings)
    except RbdError as error:
        return error


def _names(path: Path) -> list[str]:
    """Names of the motions in a file that can hold several; one that is empty for others, and for what cannot be read."""
    try:
        several = path.suffix.lower() in PICKLES
        if path.suffix.lower() == ".npz":
            with ZipFile(path) as archive:
                several = "split_points.npy" in archive.namelist()
        return motion_names(path) if several else [""]
    except (RbdError, BadZipFile, OSError, ValueError, NotImplementedError):
        return [""]


def _paths(given: Iterable[Names]) -> Iterator[Path]:
    """Files of names, folders and patterns; a name without a file stays, so that reading it says what is wrong."""
    for each in listed_items("files", given, "paths, patterns, or a mapping of robots to them"):
        text = os.fspath(each) if isinstance(each, str | os.PathLike) else None
        if not isinstance(text, str) or not text or "\0" in text:
            raise InputError(f"files has {each!r:.80}; expected paths, folders or patterns: 'clips/*.csv'.")
        name = os.path.expanduser(text)
        if os.path.isdir(name):
            some = sorted(path for path in Path(name).rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
            if not some:
                raise InputError(f"the folder {name!r:.300} has no motion; expected files that end in {', '.join(SUFFIXES)}.")
            yield from some
        elif not os.path.exists(name) and glob.has_magic(name):
            matches = sorted(glob.glob(name, recursive=True))
            if not matches:
                raise InputError(f"no file is like {name!r:.300}.")
            yield from map(Path, matches)
        else:
            yield Path(name)
