"""What follows # in the address of a page: time, view, layers; and the layers of a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from rbd.arrays import as_float
from rbd.errors import InputError


def page_link(
    *, at: float | None = None, view: str | None = None, layers: Mapping[str, bool] | None = None, controls: bool = True
) -> str:
    """The fragment of an address that opens a page as wanted, as "t=0.9&view=front&on=labels&off=cones".

    Args:
        at: Time of a motion [s].
        view: One of `rbd.visual.pages.link.VIEWS`.
        layers: {layer: whether it is shown}, of `rbd.visual.pages.link.LAYERS`; the others stay as the page has them.
        controls: Whether the page has buttons; False for pictures.

    Returns:
        The fragment without #; empty where the page opens as it was written.

    Raises:
        InputError: a time that is no number, an unknown view or layer.
    """
    parts = []
    if at is not None:
        if not math.isfinite(as_float(at)):
            raise InputError(f"at is {at!r:.80}; expected a time in seconds.")
        parts.append(f"t={float(at)!r}")
    if view is not None:
        parts.append(f"view={checked_view(view)}")
    given = only_layers(layers)
    for word, wanted in (("on", True), ("off", False)):
        if names := [quote(name) for name, on in given.items() if on is wanted]:
            parts.append(f"{word}={','.join(names)}")
    if not controls:
        parts.append("controls=off")
    return "&".join(parts)


LAYERS: Mapping[str, bool] = {
    "meshes": True,
    "collision shapes": False,
    "frames": False,
    "forces": True,
    "corner forces": True,
    "cones": True,
    "surfaces": True,
    "loop forces": True,
    "pin forces": False,
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
    if unknown := [name for name in given if name not in LAYERS]:
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
