"""MJCF files with elements that write others, <replicate>, <composite> and <attach>: written out by MuJoCo's own reader.

It is used for such files alone, where the extra "mujoco" is installed; what it writes is read as any other file. Its writer
is asked for all digits, and what it wrote is compared with what it read.
"""

from __future__ import annotations

import ctypes
import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np

from rbd.model.input_files import FileLimits
from rbd.model.urdf import Complaints

Element = ElementTree.Element
WRITERS = ("replicate", "composite", "attach")
"""Elements that write others."""
DIGITS = 17
"""Significant digits with which a number that is written and read again has the same bits."""
_SAME = 1e-12
_COMPARED = (
    "body_parentid body_pos body_quat body_mass body_inertia body_ipos jnt_type jnt_pos jnt_axis jnt_range dof_armature "
    "dof_damping dof_frictionloss jnt_stiffness geom_size geom_pos actuator_gear actuator_ctrlrange actuator_forcerange qpos0"
).split()


def writers_in(root: Element) -> str:
    """The first of `WRITERS` that a file has; "" where it has none."""
    return next((tag for tag in WRITERS if root.find(f".//{tag}") is not None), "")


def written_out(path: Path, root: Element, limits: FileLimits) -> Element:
    """The first element of the same robot without `WRITERS`.

    Args:
        path: Where the file is; meshes and attached models are in its folder. Of a text in memory, a name.
        root: Its first element, includes carried out.
        limits: How large it may become.

    Raises:
        ModelError: MuJoCo is not installed, refuses the file, or does not write what it read.
    """
    wrong, tag = Complaints(path.name), writers_in(root)
    if _size(root) > limits.max_elements:
        wrong.stop(f"its <{tag}> writes more than {limits.max_elements} elements.")
    try:
        import mujoco
    except ImportError:
        wrong.stop(
            f"<{tag}> writes other elements, which only MuJoCo's own reader does. Install the extra that has it, "
            "pip install 'rbd-contact[mujoco]', or write out what it writes."
        )
    try:
        spec = _spec(mujoco, path, root)
        model = spec.compile()
        text = _text(mujoco, spec)
        again = mujoco.MjSpec.from_string(text)
        again.modelfiledir = spec.modelfiledir
        _compare(wrong, model, again.compile())
    except (ValueError, RuntimeError, OSError) as error:
        wrong.stop(f"it has <{tag}>, so MuJoCo's own reader was asked, and refuses it: {' '.join(str(error).split()):.400}")
    return ElementTree.fromstring(text)


def _spec(mujoco: Any, path: Path, root: Element) -> Any:
    if root.find("asset/model") is not None and path.is_file():
        return mujoco.MjSpec.from_file(str(path))  # it finds the attached models while it reads
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.modelfiledir = str(path.parent.resolve()) if path.is_file() else ""
    return spec


def _text(mujoco: Any, spec: Any) -> str:
    """What MuJoCo writes, with all digits; six of them where this version cannot be asked, which the comparison then tells."""
    try:
        library = ctypes.CDLL(next(map(str, Path(mujoco.__file__).parent.glob("libmujoco*.*"))))
        precision = library._mjPRIVATE__set_xml_precision, library._mjPRIVATE__get_xml_precision
    except (OSError, AttributeError, StopIteration):
        return str(spec.to_xml())
    before = precision[1]()
    precision[0](DIGITS)
    try:
        return str(spec.to_xml())
    finally:
        precision[0](before)


def _compare(wrong: Complaints, one: Any, other: Any) -> None:
    """Refuse what is not the same model again."""
    for name in _COMPARED:
        a, b = np.asarray(getattr(one, name), float), np.asarray(getattr(other, name), float)
        if a.shape != b.shape or not np.allclose(a, b, rtol=_SAME, atol=_SAME):
            wrong.stop(f"MuJoCo does not write it as it read it: {name} differs. Write out what its elements write by hand.")


def _size(element: Element) -> float:
    """How many elements it amounts to."""
    words = re.findall(r"\d+", element.get("count", "")) if element.tag in ("replicate", "composite") else []
    return math.prod(float(word) for word in words) * (1.0 + sum(_size(child) for child in element))
