"""What robots of the catalogue and of users' files are in a pickle: places in installed packages, and paths as text."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import pinocchio as pin

from rbd.errors import ModelError
from rbd.installation import VERSION
from rbd.model.checked_model import CheckedModel
from rbd.model.pickling import numbers_digest
from rbd.robots import catalogue
from rbd.robots.catalogue import DATA, RobotSource
from rbd.robots.loop_file import ENDING, LoopFile
from rbd.robots.loops import Mechanism

OWN = "rbd"


def known_place(source: RobotSource) -> tuple[str, str] | None:
    """(package, file in it) of a robot that is installed with a package; None of any other."""
    if source.known:
        return DATA, source.urdf.resolve().relative_to(catalogue.robots_folder().resolve()).as_posix()
    if catalogue.MODELS is not None and source.urdf.resolve().parent == catalogue.MODELS.resolve():
        return OWN, source.urdf.name
    return None


def again_known(place: tuple[str, str]) -> RobotSource:
    """The source of `known_place` in this process.

    Raises:
        ModelError: the file is not installed here.
    """
    package, file = place
    folder = catalogue.robots_folder() if package == DATA else catalogue.MODELS
    path = None if folder is None else folder / file
    if path is None or not path.is_file():
        raise ModelError(
            f"a robot that was pickled elsewhere is the file {file!r:.200} of {package}, which is not here. Install the same "
            f"version of {package} in both environments; here: {_versions()}."
        )
    return catalogue.find(path)


def numbers_and_versions(model: pin.Model) -> tuple[str, str]:
    """The digest of a model as it was loaded, and the versions on which it depends, in words."""
    return numbers_digest(model), _versions()


def check_same(robot: CheckedModel, digest: str, versions: str) -> None:
    """Refuse a robot whose file is another one here than where it was pickled.

    Args:
        robot: As it was loaded here.
        digest: Of the model where it was pickled.
        versions: Of that environment.

    Raises:
        ModelError: with the versions of both.
    """
    if numbers_digest(robot.model) != digest:
        raise ModelError(
            f"{robot.name} is another robot here than where it was pickled: its model has other numbers or names. There: "
            f"{versions}; here: {_versions()}. Install the same versions in both environments."
        )


def texts_of(text: str, mechanism: Mechanism) -> dict[str, Any]:
    """Of a robot in memory, what a file needs to load it again: its text and that of its loop file, as plain data.

    "loops" is None where its loops are in no text, so that they cannot be written.
    """
    closing = mechanism.file
    loops = (True if closing.text else None) if closing.name else bool(mechanism.equalities)
    return {"text": text, "loop_file": closing.text, "loops": loops}


def given_texts(given: Mapping[str, Any]) -> dict[str, Any] | None:
    """The arguments `text` and `loops` of `load_robot` from `texts_of`; None where there is no text.

    Raises:
        InputError: a loop file that is no text.
        ModelError: a loop file that is wrong.
    """
    text, closing = given.get("text"), given.get("loop_file")
    if not isinstance(text, str) or not text:
        return None
    name = f"{given.get('name')!s:.80}{ENDING}"
    return {"text": text, "loops": LoopFile.of_text(closing, name) if closing else bool(given.get("loops", True))}


def _versions() -> str:
    return f"{DATA} {_version(DATA)}, rbd {VERSION}, Pinocchio {pin.__version__}"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
