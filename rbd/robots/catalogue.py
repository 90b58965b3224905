"""Files, feet and standing posture of a robot, by short name, file name or path.

The robots come from the package `example-robot-data`, found through the installed packages' records and never through
its loaders. What those files leave out (soles, contact points, a posture that balances) is in `data/robots.toml`.
"""

from __future__ import annotations

import math
import os
import re
import sys
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from rbd.constraints.round_feet import Ball
from rbd.errors import InputError, ModelError, UnknownRobot, nearest
from rbd.errors.inputs import listed_items
from rbd.model.input_files import is_file

DATA = "example-robot-data"
DESCRIPTIONS = "robot_descriptions"
ROBOTS = f"cmeel.prefix/share/{DATA}/robots"  # inside site-packages; its meshes are named from share/
MODEL_FILES = (".urdf", ".xml")
_HERE = Path(__file__).parent
MODELS = next((folder for folder in (_HERE / "urdf", _HERE.parents[1] / "urdf") if folder.is_dir()), None)
"""The mechanisms and vehicles that come with `rbd`: in its wheel, or in the checkout that it runs from; None in neither."""

IN_MEMORY = Path("(in memory)")
"""Stands for the folder of a robot whose text was given in place of a file. No file is looked for there."""

BROKEN = {
    "romeo_description/urdf/romeo_laas_small.urdf": "its meshes are on the author's disk; 'romeo' is romeo_small.urdf",
    "ur_description/urdf/ur3.urdf": "its robot has no name, as URDF demands; 'ur3' is ur3_robot.urdf",
}

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Foot:
    """A foot of a robot: its sole or point on one of its frames F.

    The patch frame P has its x towards the toes and its z out of the ground, into the robot, when the robot stands in
    its posture. For a point, P sits at the lowest point of the foot's sphere in that posture; the rolling of a round
    foot is neglected.

    Attributes:
        name: Its role: `left_sole`, `front_left`.
        frame: The robot's frame that carries it.
        kind: A `sole` has corners, a `point` has none.
        translation: p_FP [m], the middle of the patch or the point of contact.
        rpy: Roll, pitch, yaw of P in F [rad].
        corners: (x, y), or (x, y, z), in P [m], in order around the sole.
        ball: Of a round foot that a user names: its lowest point is that of any posture.
    """

    name: str
    frame: str
    kind: Literal["sole", "point"]
    translation: Triple
    rpy: Triple = (0.0, 0.0, 0.0)
    corners: tuple[tuple[float, ...], ...] = ()
    ball: Ball | None = None

    @property
    def rotation(self) -> np.ndarray:
        """R_FP, shape (3, 3): the columns are the axes of the patch in the foot's frame."""
        return pin.rpy.rpyToMatrix(np.array(self.rpy))


@dataclass(frozen=True, eq=False)
class RobotSource:
    """The catalogue's data of a robot, before its model is built.

    Attributes:
        name: The short name, or the file's stem.
        urdf: The model file, URDF or MJCF; of a robot in memory a name in `IN_MEMORY`, where there is no file.
        srdf: Its semantic file, if there is one.
        package_dirs: Where `package://` starts from, the user's own first.
        feet: Its feet, from the catalogue or from the user; empty if unknown.
        postures: Postures of the catalogue, besides those of the SRDF: joint name -> angle [rad]; joints not named are at zero.
        posture: Name of the standing posture, in `postures` or in the SRDF.
        known: Whether the file is one of the robot data's, whose faults are known: it is loaded with a warning where a
            user's file would be refused.
    """

    name: str
    urdf: Path
    srdf: Path | None
    package_dirs: tuple[Path, ...]
    feet: tuple[Foot, ...]
    postures: Mapping[str, Mapping[str, float]]
    posture: str | None
    known: bool = False

    @property
    def in_memory(self) -> bool:
        """Whether it was made from a text, so that there is no file."""
        return self.urdf.parent == IN_MEMORY

    @property
    def place(self) -> Path:
        """The model file; of a robot in memory the same name in the first of its folders, where relative names start."""
        return self.package_dirs[0] / self.urdf.name if self.in_memory and self.package_dirs else self.urdf

    @staticmethod
    def of_text(name: str, ending: str, package_dirs: Iterable[str | os.PathLike[str]] = ()) -> RobotSource:
        """The source of a robot whose text is in memory: no feet and no postures are known.

        Args:
            name: Of the robot, as its text states it.
            ending: ".urdf" or ".xml".
            package_dirs: Folders of its meshes and included files; without them none is opened, but those of the robot data.

        Raises:
            InputError: package folders that are no paths.
        """
        folders = tuple(dict.fromkeys((*_package_dirs(package_dirs), *_shares())))
        file = re.sub(r"[/\\\0]", "_", name).strip()[:80] or "text"
        return RobotSource(name or file, IN_MEMORY / f"{file}{ending}", None, folders, (), {}, None)


def find(name_or_path: str | os.PathLike[str], package_dirs: Iterable[str | os.PathLike[str]] = ()) -> RobotSource:
    """The files, feet and postures of a robot.

    A plain name is a short name, then one of the mechanisms that come with `rbd`, then the name of a file of the robot data,
    then a file in the working folder; others are a path first, then a file of the robot data. "h1" and "h1_2" are looked up in
    the package `robot_descriptions`, which downloads them.

    Args:
        name_or_path: `"talos"`, `"four_bar"`, `"tiago_dual"`, `"ur_description/urdf/ur5_robot.urdf"` or the path of any model
            file.
        package_dirs: More folders for `package://` to start from; they are searched first.

    Raises:
        UnknownRobot: if the name is unknown; the message has the nearest names.
        ModelError: if the file is missing or known to be broken, or the robot data, or that package, are not installed.

    >>> find("talos").urdf.name, [foot.name for foot in find("talos").feet]
    ('talos_reduced.urdf', ['left_sole', 'right_sole'])
    """
    name = _text(name_or_path, "the robot")
    path = _expanded(name)
    extra = _package_dirs(package_dirs)
    looks_like_path = not isinstance(name_or_path, str) or path.suffix in MODEL_FILES or path.name != name
    if looks_like_path and is_file(path):
        return _source(path, extra)
    if isinstance(name_or_path, str) and name in _entries("described"):
        return _described(name, extra)
    if isinstance(name_or_path, str) and (known := _by_name(name)):
        return _source(known, extra)
    if is_file(path):
        return _source(path, extra)
    close = nearest(path.stem if looks_like_path else name, names())
    if looks_like_path:
        raise ModelError(f"no file {name!r:.200}, neither from {str(Path.cwd())!r} nor in {DATA}; {close}.")
    robots_folder()  # if the data are absent, that is the reason
    raise UnknownRobot(f"no robot {name!r:.80}; {close}. rbd.robots.catalogue.names() has them all.")


def file_path(path: str | os.PathLike[str], what: str) -> Path:
    """A path as given, `~` understood.

    Raises:
        InputError: if it is no path.
    """
    return _expanded(_text(path, what))


def _text(value: object, what: str) -> str:
    """A name or path as text.

    Raises:
        InputError: if it is neither.
    """
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str):
        raise InputError(f"{what} is {value!r:.80}; expected a name or a path.")
    if "\0" in text:
        raise UnknownRobot(f"{what} is {value!r:.80}; no name or path has a null character in it.")
    return text


def _package_dirs(package_dirs: object) -> tuple[Path, ...]:
    alone = isinstance(package_dirs, str | os.PathLike)  # one folder, not its letters
    folders: list[Any] = [package_dirs] if alone else listed_items("package_dirs", package_dirs, "a list of folders")
    return tuple(file_path(folder, "a package folder") for folder in folders)


def _shares() -> tuple[Path, ...]:
    """Where `package://` meshes of the robot data start from; none if the data are not installed."""
    try:
        folder = robots_folder()
    except ModelError:
        return ()
    return folder.parents[1], folder


def _expanded(text: str) -> Path:
    try:
        return Path(text).expanduser()
    except RuntimeError:  # "~nobody"
        return Path(text)


def names() -> list[str]:
    """All names that `find` takes: the short ones, the mechanisms that come with `rbd`, and the stems of the data's files.

    Left out are the broken files and stems that two files share. Without the robot data, only the short names.
    """
    files = _files()
    stems = [Path(file).stem for file in files if file not in BROKEN]
    return sorted({*_entries(), *mechanisms(), *(stem for stem in stems if stems.count(stem) == 1)})


def mechanisms() -> list[str]:
    """Names of the mechanisms and vehicles that come with `rbd`."""
    return [] if MODELS is None else sorted(path.stem for path in MODELS.glob("*.urdf"))


def robots() -> list[str]:
    """One name for each robot file that loads: its short name, else the file's stem. Those with short names come first."""
    short = {entry["file"]: key for key, entry in _entries().items()}
    known = set(names())
    others = (Path(file).stem for file in _files() if file not in short and file not in BROKEN)
    return [*short.values(), *(stem for stem in others if stem in known)]


def robots_folder() -> Path:
    """The `robots/` folder of the installed robot data: of pip's package, else of conda's.

    Raises:
        ModelError: if the package is not installed, or installed in a way that `rbd` does not know.
    """
    remedy = f"try: pip install {DATA}"
    conda = Path(sys.prefix) / "share" / DATA / "robots"
    try:
        folder = Path(str(distribution(DATA).locate_file(ROBOTS)))
    except PackageNotFoundError:
        if conda.is_dir():
            return conda
        raise ModelError(f"the robots come with the package {DATA!r}, which is not installed here; {remedy}") from None
    if not folder.is_dir() and conda.is_dir():
        return conda
    if not folder.is_dir():
        raise ModelError(f"{DATA} is installed, but without the folder {ROBOTS!r} of its pip package; {remedy}")
    return folder


def licence(source: RobotSource) -> str:
    """Licence of a robot's files, from their README; empty if not stated."""
    if MODELS is not None and source.urdf.is_relative_to(MODELS):
        return "BSD-2-Clause"
    if not source.known:
        return ""
    folder = robots_folder()
    page = folder / source.urdf.resolve().relative_to(folder.resolve()).parts[0] / "README.md"
    head = page.read_text(encoding="utf-8", errors="replace")[:2000] if page.is_file() else ""
    stated = re.search(r"^license: *(\S.*?) *$", head, re.MULTILINE)
    return stated[1] if stated else ""


def _by_name(name: str) -> Path | None:
    """The file with this short name, file name or path inside the data; None if there is none."""
    if name in _entries():
        return robots_folder() / _entries()[name]["file"]
    if MODELS is not None and name in mechanisms():
        return MODELS / f"{name}.urdf"
    wanted = Path(name).as_posix()
    if Path(wanted).suffix != ".urdf":
        wanted += ".urdf"
    matches = [file for file in _files() if file == wanted or file.endswith("/" + wanted)]
    if len(matches) > 1:
        short = {entry["file"]: f"{key!r} is " for key, entry in _entries().items()}
        choices = ", ".join(f"{short.get(file, '')}{file!r}" for file in matches)
        raise UnknownRobot(f"{len(matches)} files go by the name {name!r}: {choices}. Name one of them.")
    return robots_folder() / matches[0] if matches else None


def _source(urdf: Path, extra: tuple[Path, ...]) -> RobotSource:
    """The catalogue's data of a model file, if it is in the robot data; else only its folder."""
    shares, inside = _shares(), ""
    if shares and urdf.resolve().is_relative_to(shares[1].resolve()):
        inside = urdf.resolve().relative_to(shares[1].resolve()).as_posix()
    if inside in BROKEN:
        raise ModelError(f"{inside!r} of {DATA} is broken: {BROKEN[inside]}.")
    key, entry = next(((k, e) for k, e in _entries().items() if inside and e["file"] == inside), (urdf.stem, {}))
    return _with_entry(urdf, (*extra, urdf.parent, *shares), key, entry, known=bool(inside))


def _described(name: str, extra: tuple[Path, ...]) -> RobotSource:
    """A robot of the package robot_descriptions, which is imported here, and downloads its files when they are not there.

    Raises:
        ModelError: the package is not installed, or there is no network.
    """
    entry = _entries("described")[name]
    other = "or give the path of its URDF: rbd.load_robot('h1.urdf', feet=['left_ankle_link', 'right_ankle_link'])"
    try:
        module = import_module(f"{DESCRIPTIONS}.{entry['description']}")
        folder, file = Path(module.PACKAGE_PATH), Path(module.URDF_PATH)
    except ImportError as error:
        raise ModelError(
            f"{name!r} comes with the package {DESCRIPTIONS}; try: pip install {DESCRIPTIONS}; {other}."
        ) from error
    except Exception as error:  # of git, of the network, of a folder that cannot be written
        told = str(error).strip().splitlines()[-1:] or [type(error).__name__]
        raise ModelError(
            f"{DESCRIPTIONS} cannot download {name!r} by git: {told[0]:.200}; try again with a network, {other}."
        ) from error
    urdf = folder / entry["file"] if "file" in entry else file
    return _with_entry(urdf, (*extra, urdf.parent, folder.parent), name, entry)


def _with_entry(urdf: Path, folders: tuple[Path, ...], key: str, entry: Mapping[str, Any], known: bool = False) -> RobotSource:
    """A model file with what a table says of it."""
    srdf = robots_folder() / entry["srdf"] if "srdf" in entry else _srdf_beside(urdf)
    postures = {name: dict(angles) for name, angles in entry.get("postures", {}).items()}
    in_degrees = entry.get("postures_deg", {}).items()
    postures |= {name: {joint: math.radians(angle) for joint, angle in angles.items()} for name, angles in in_degrees}
    soles = tuple(_sole(name, data) for name, data in entry.get("soles", {}).items())
    points = tuple(_point(name, data, entry["sphere"]) for name, data in entry.get("points", {}).items())
    return RobotSource(key, urdf, srdf, tuple(dict.fromkeys(folders)), soles + points, postures, entry.get("posture"), known)


def _srdf_beside(urdf: Path) -> Path | None:
    """The SRDF of the same stem, in the same folder or in the `srdf` folder next to it, if it is there."""
    places = (urdf.with_suffix(".srdf"), urdf.parent.parent / "srdf" / f"{urdf.stem}.srdf")
    return next((place for place in places if place.is_file()), None)


@cache
def _entries(file: str = "robots") -> dict[str, dict[str, Any]]:
    """The tables of `data/robots.toml`, or of another file beside it, with `like` carried out."""
    tables = tomllib.loads((Path(__file__).parent / "data" / f"{file}.toml").read_text(encoding="utf-8"))
    for key, table in tables.items():  # in the order of the file: a `like` refers to an entry above it
        if "like" in table:
            tables[key] = {**tables[table["like"]], **table}
    return tables


def _files() -> list[str]:
    """Every URDF of the robot data, relative to its `robots/` folder; none if the data are not installed."""
    folders = _shares()[1:]
    return sorted(path.relative_to(folder).as_posix() for folder in folders for path in folder.glob("**/*.urdf"))


def _sole(name: str, data: Mapping[str, Any]) -> Foot:
    X, Y = data.get("half_lengths", (0.0, 0.0))
    corners = tuple((x, y) for x, y in data.get("corners", ((X, Y), (-X, Y), (-X, -Y), (X, -Y))))
    return Foot(name, data["frame"], "sole", tuple(data["centre"]), tuple(data.get("rpy", (0.0, 0.0, 0.0))), corners)


def _point(name: str, data: Mapping[str, Any], sphere: Mapping[str, Any]) -> Foot:
    rpy: Triple = tuple(data["rpy"])
    up = pin.rpy.rpyToMatrix(np.array(rpy))[:, 2]
    x, y, z = np.array(sphere["centre"]) - sphere["radius"] * up  # lowest point when P's z is up
    return Foot(name, data["frame"], "point", (float(x), float(y), float(z)), rpy)
