"""The loops and the motors of an MJCF file, as MuJoCo compiled them.

<connect> and <weld> close loops, <joint> couples two joints or locks one. Others, inactive ones, and polynomials above the
first degree are reported, by name, as left out. Softness (solref, solimp) is not read: loops are rigid.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rbd.model.motors import Motor
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


FREE, BALL, SLIDE, HINGE = range(4)
"""MuJoCo's numbers of joint types."""
Remark = tuple[str, str, str]
_JOINT_TYPES = ("free", "ball", "slide", "hinge")
_TRANSMISSIONS = ("joint", "joint", "slider crank", "tendon", "site", "body")
_LEAVE = "load_robot(..., leave_out=['actuators']) gives every joint a motor without limits"


def is_off(model: Any, flag: str) -> bool:
    """Whether a file switches something off, by MuJoCo's name for it: "SPRING", "DAMPER", "LIMIT", ..."""
    import mujoco

    return bool(model.opt.disableflags & int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")))


def check_actuators(wrong: Complaints, mujoco: Any, spec: Any, leave_out: Collection[str]) -> None:
    """Takes out those that are left out; refuses muscles, whose lengths MuJoCo would first search by simulation.

    Raises:
        ModelError: a muscle.
    """
    for each in spec.actuators:
        if "actuators" in leave_out:
            spec.delete(each)
        elif each.gaintype == mujoco.mjtGain.mjGAIN_MUSCLE:
            wrong.stop(
                f"actuator {each.name or each.target!r:.80} is a muscle and no motor at a joint, and not read. {_LEAVE}."
            )
    if "actuators" in leave_out:
        for key in spec.keys:
            key.ctrl = key.act = []


def read_motors(wrong: Complaints, model: Any, joints: Sequence[str]) -> tuple[dict[int, Motor], list[Remark]]:
    """The motors by the indices of their joints, in the order of the file, and remarks about them.

    MuJoCo's control goes through a gain and a gear; here tau is the torque at the joint itself. So a gear is in the limits of
    tau alone, and a servo is a motor whose own control law is left out.

    Args:
        wrong: Where complaints go.
        model: `mujoco.MjModel`.
        joints: Names of the joints.

    Raises:
        ModelError: an actuator that is no torque at one hinge or slide, or a second one there.
    """
    remarks: list[Remark] = []
    motors: dict[int, Motor] = {}
    if model.nu and is_off(model, "ACTUATION"):
        wrong.stop("<flag>: actuation is disabled, so that no motor turns; it is not read. Take it or the <actuator> out.")
    for i in range(model.nu):
        on, joint = int(model.actuator_trntype[i]), int(model.actuator_trnid[i, 0])
        name = model.actuator(i).name or (joints[joint] if on < 2 else f"number {i + 1}")
        what = f"actuator {name!r:.80}"
        if on >= 2:
            kind = _TRANSMISSIONS[on] if on < len(_TRANSMISSIONS) else "something else"
            wrong.stop(f"{what} acts on a {kind}, which no torque at one joint is; it is not read. {_LEAVE}.")
        if model.jnt_type[joint] not in (HINGE, SLIDE):
            kind = _JOINT_TYPES[int(model.jnt_type[joint])]
            wrong.stop(f"{what} acts on {joints[joint]!r:.80}, a {kind} joint; motors are read at hinges and slides. {_LEAVE}.")
        if joint in motors:
            wrong.stop(f"{what} is a second actuator at joint {joints[joint]!r:.80}; expected one a joint. {_LEAVE}.")
        gear, armature = float(model.actuator_gear[i, 0]), float(model.actuator_armature[i])
        if gear == 0.0 or armature < 0.0:
            fault = "the gear 0; expected another" if gear == 0.0 else f"armature {armature:g}; expected zero or more"
            wrong.stop(f"{what} has {fault}.")
        effort, told = _effort(wrong, model, i, joint, gear, f"{what} gives joint {joints[joint]!r:.80}")
        motors[joint] = Motor(limit=effort, gear=gear, rotor_inertia=armature)
        remarks += [(kind, name, text) for kind, text in told]
    return motors, remarks


def _effort(
    wrong: Complaints, model: Any, i: int, joint: int, gear: float, what: str
) -> tuple[float | None, list[tuple[str, str]]]:
    """The largest torque either way, None for no limit, and remarks."""
    plain = not (model.actuator_gaintype[i] or model.actuator_biastype[i] or model.actuator_dyntype[i])
    gain = float(model.actuator_gainprm[i, 0]) if plain else 0.0
    spans = []
    if gain and model.actuator_ctrllimited[i] and not is_off(model, "CLAMPCTRL"):
        spans.append(gain * gear * model.actuator_ctrlrange[i])
    if model.actuator_forcelimited[i]:
        spans.append(gear * model.actuator_forcerange[i])
    if model.jnt_actfrclimited[joint]:
        spans.append(model.jnt_actfrcrange[joint])
    told = [] if gain else [("servo", "has a control law of its own, which is left out; tau is the torque at the joint")]
    if not spans:
        return None, told
    low, high = max(float(min(span)) for span in spans), min(float(max(span)) for span in spans)
    least = min(-low, high)
    if not least > 0.0:
        wrong.stop(f"{what} torques from {low:g} to {high:g}: limits here are the same both ways, and not zero. {_LEAVE}.")
    if abs(low + high) > 1e-12 * least:
        told.append(("one-sided", f"gives torques from {low:g} to {high:g}; taken as {least:g} either way"))
    return least, told
