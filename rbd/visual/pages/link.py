"""What follows # in the address of a page: time, view, layers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from urllib.parse import quote

from rbd.arrays import as_float
from rbd.errors import InputError
from rbd.visual.layers import checked_view, only_layers


def page_link(
    *, at: float | None = None, view: str | None = None, layers: Mapping[str, bool] | None = None, controls: bool = True
) -> str:
    """The fragment of an address that opens a page as wanted, as "t=0.9&view=front&on=labels&off=cones".

    Args:
        at: Time of a motion [s].
        view: One of `rbd.visual.layers.VIEWS`.
        layers: {layer: whether it is shown}, of `rbd.visual.layers.LAYERS`; the others stay as the page has them.
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
