"""Parameters of a robot from measured motions: base parameters, and inertias that a body can have."""

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


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
