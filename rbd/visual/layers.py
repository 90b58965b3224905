"""The layers of a scene: groups of marks that are shown and hidden together, on the page and from Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rbd.errors import InputError

LAYERS: Mapping[str, bool] = {
    "meshes": True,
    "collision shapes": False,
    "frames": False,
    "forces": True,
    "corner forces": True,
    "cones": True,
    "surfaces": True,
    "loop forces": True,
    "moments": True,
    "joint torques": False,
    "pushes": True,
    "force elements": True,
    "centre of mass": True,
    "support polygon": True,
    "regions": True,
    "other poses": True,
    "axes": False,
    "labels": False,
}
"""{name: whether it is shown at first}, in the order of the page's list."""


VIEWS = ("start", "front", "side", "top")
"""Where the camera stands: as the page opened it, before the face, on the left of the robot, above with x upwards."""


def checked_layers(layers: object) -> dict[str, bool]:
    """{name: whether it is shown at first} of all layers, where `layers` says so for some.

    Raises:
        InputError: what is no mapping of names of layers to True or False.
    """
    return {**LAYERS, **only_layers(layers)}


def only_layers(layers: object) -> dict[str, bool]:
    """{name: whether it is shown} of those layers that `layers` names; none of None.

    Raises:
        InputError: what is no mapping of names of layers to True or False.
    """
    if layers is None:
        return {}
    given: Any = layers
    if not isinstance(layers, Mapping) or not all(isinstance(on, bool) for on in given.values()):
        raise InputError(f"layers are {layers!r:.80}; expected {{name: True or False}}, of {', '.join(LAYERS)}.")
    unknown = [name for name in given if name not in LAYERS]
    if unknown:
        raise InputError(f"there is no layer {unknown[0]!r:.80}; expected {', '.join(LAYERS)}.")
    return dict(given)


def checked_view(view: object) -> str:
    """The name of a view.

    Raises:
        InputError: if it is not the name of a view.
    """
    if view not in VIEWS:
        raise InputError(f"view is {view!r:.80}; expected one of {', '.join(VIEWS)}.")
    return str(view)
