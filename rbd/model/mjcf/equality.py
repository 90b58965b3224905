"""The loops of an MJCF file: its <equality> element, as MuJoCo compiled it.

<connect> and <weld> close loops, <joint> couples two joints or locks one. Others, inactive ones, and polynomials above the
first degree are reported, by name, as left out. Softness (solref, solimp) is not read: loops are rigid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from rbd.model.mjcf.motors import Remark, is_off
from rbd.model.urdf import LONGEST_NAME, Complaints

WORLD = "world"
_KINDS: tuple[Literal["connect", "weld", "joint"], ...] = ("connect", "weld", "joint")


@dataclass(frozen=True)
class Equality:
    """One equality constraint; bodies, sites and joints by name, as MuJoCo understands them.

    Attributes:
        name: Its name, or one made from its kind and ends.
        kind: "connect", "weld" or "joint".
        ends: The two bodies or sites; of a joint equality the joint that follows and, if any, the one it follows.
        sites: Whether the ends are sites.
        anchor: Of a connect in the first body, of a weld in the second [m].
        pose: Where a weld wants the anchor in the first body [m], and the second body's turn against the first, as a quaternion
            w, x, y, z; None of a connect and between sites.
        polynomial: (constant, slope) of a joint equality, about the file's reference angles.
    """

    name: str
    kind: Literal["connect", "weld", "joint"]
    ends: tuple[str, ...]
    sites: bool = False
    anchor: tuple[float, ...] = (0.0, 0.0, 0.0)
    pose: tuple[float, ...] | None = None
    polynomial: tuple[float, float] = (0.0, 1.0)


def equalities(wrong: Complaints, mujoco: Any, model: Any) -> tuple[tuple[Equality, ...], list[Remark]]:
    """(equalities read, (kind, where, text) of those left out).

    Raises:
        ModelError: a name that is too long.
    """
    off = is_off(model, "EQUALITY")
    found: dict[str, Equality] = {}
    lost: list[Remark] = []
    for i in range(model.neq):
        number, objects, data = int(model.eq_type[i]), model.eq_objtype[i], tuple(model.eq_data[i].tolist())
        kind = _KINDS[number] if number < len(_KINDS) else None
        of = mujoco.mjtObj.mjOBJ_JOINT if kind == "joint" else objects
        ends = [int(model.eq_obj1id[i]), int(model.eq_obj2id[i])]
        names = tuple(mujoco.mj_id2name(model, int(of), end) or "" for end in ends if end >= 0) if kind else ()
        name = model.eq(i).name
        made = not name
        name = name or "_".join([kind or "equality", *(end[:40] for end in names if end != WORLD)])
        if len(name) > LONGEST_NAME:
            wrong.stop(f"an equality has a name of {len(name)} letters; expected {LONGEST_NAME} at most.")
        if kind is None:
            told = f"is of a kind that is not read; only {', '.join(f'<{each}>' for each in _KINDS)} are"
        elif off or not model.eq_active0[i]:
            told = "is not active in the file"
        elif kind == "joint" and any(data[2:5]):
            told = "has a polynomial above the first degree; give an rbd.FunctionConstraint"
        else:
            told = ""
        if told or kind is None:
            lost.append(("equality", name, told))
            continue
        while made and name in found:
            name += "'"
        sites = int(objects) == int(mujoco.mjtObj.mjOBJ_SITE)
        if kind == "joint":
            found[name] = Equality(name, kind, names, polynomial=(data[0], data[1]))
        else:
            pose = data[3:10] if kind == "weld" and not sites else None
            found[name] = Equality(name, kind, names, sites, data[:3], pose)
    return tuple(found.values()), lost
