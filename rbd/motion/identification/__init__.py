"""Parameters of a robot from measured motions: base parameters, and inertias that a body can have."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.motion.identification.combinations import BaseParameters, base_parameters
from rbd.motion.identification.data import MeasuredMotion
from rbd.motion.identification.identifying import Excitation, excitation, identify
from rbd.motion.identification.result import BodyInertia, Identification, IdentificationCertificate

__all__ = [
    "BaseParameters",
    "BodyInertia",
    "Excitation",
    "Identification",
    "IdentificationCertificate",
    "MeasuredMotion",
    "base_parameters",
    "excitation",
    "identify",
]


__getattr__ = _partial(_submodule, __name__)
