"""A checked robot file as Pinocchio's model."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.errors import InputError, ModelError
from rbd.model import mjcf
from rbd.model.files import RobotFile
from rbd.model.urdf import BASE_JOINT, UrdfFile


def build_model(file: RobotFile, root: str) -> pin.Model:
    """Pinocchio's model of a checked file, with the rotor inertias that Pinocchio's own reader of URDF drops.

    Args:
        file: As `rbd.model.files.read` gives it.
        root: "free_flyer", "planar" or "fixed".

    Raises:
        InputError: a root that this file does not take.
        ModelError: Pinocchio cannot build it.
    """
    path = file.path
    if file.mjcf is not None and root == "planar":
        raise InputError(
            f"root='planar' is for URDF files; {path.name} says itself how it moves: give its body two slides and a hinge."
        )
    try:
        if file.mjcf is not None:
            model = mjcf.build(file.mjcf)
        else:
            assert file.urdf is not None
            base = {"planar": pin.JointModelPlanar, "free_flyer": pin.JointModelFreeFlyer}.get(root)
            model = pin.buildModelFromXML(file.urdf.text, *((base(), BASE_JOINT) if base else ()))
            _add_rotors(model, file.urdf)
    except (ValueError, RuntimeError, IndexError) as error:
        reason = str(error).strip().split("\n")[0].rstrip(".")
        raise ModelError(
            f"Pinocchio cannot build {path.name}: {reason:.400}. What its parser printed on stderr says more."
        ) from None
    if file.mjcf is not None and root == "fixed" and any(j.shortname() == "JointModelFreeFlyer" for j in model.joints):
        raise InputError(f"root='fixed' cannot weld {path.name}, whose own freejoint lets it float. Remove it from the file.")
    return model


def _add_rotors(model: pin.Model, urdf: UrdfFile) -> None:
    """The rotor inertias of the file's <dynamics armature>, on the diagonal of M; Pinocchio's reader drops them."""
    armature = np.array(model.armature)
    for joint in urdf.joints.values():
        if joint.armature and model.existJointName(joint.name):
            made = model.joints[model.getJointId(joint.name)]
            armature[made.idx_v : made.idx_v + made.nv] = joint.armature
    model.armature = armature
