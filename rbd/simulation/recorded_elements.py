"""The force elements of a trajectory in its file's header: those of `rbd.constraints.forces` whole, others by name."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from rbd.constraints.forces.plain_data import data_of, element_of
from rbd.errors import InputError
from rbd.errors.warned import ForceElementWarning, stacklevel_of_user
from rbd.model.checked_model import CheckedModel
from rbd.model.external import ForceElement
from rbd.simulation.trajectory_file import listed_in, words_in

_KNOWN, _OTHERS = "elements", "other_elements"


def header_of_elements(elements: Sequence[ForceElement]) -> dict[str, Any]:
    """The entries of a header that describe the elements; of classes of a user a file has the names alone."""
    data = [data_of(element) for element in elements]
    others = [element.name for element, known in zip(elements, data, strict=True) if known is None]
    return {_KNOWN: [known for known in data if known is not None], _OTHERS: others}


def elements_in(header: Mapping[str, Any], robot: CheckedModel) -> tuple[ForceElement, ...]:
    """The elements that a header describes, none of files of earlier versions; those that it only names are warned of.

    Raises:
        InputError: no elements, or none of the robot.
    """
    others = words_in(header, _OTHERS) if _OTHERS in header else ()
    found = tuple(element_of(data) for data in (listed_in(header, _KNOWN) if _KNOWN in header else ()))
    for element in found:
        element.check_on(robot)
    names = [element.name for element in found]
    if len(set(names)) != len(names):
        raise InputError(f"its header has two force elements of one name: {', '.join(names):.200}")
    if others:
        warnings.warn(
            f"force elements acted that the file has by name alone ({', '.join(others):.200}), as they are not of "
            "rbd.constraints.forces. Drawings do not show them, and rbd.identify needs them: external=[...].",
            ForceElementWarning,
            stacklevel=stacklevel_of_user(),
        )
    return found
