"""Parameters of a robot from measured motions: base parameters, and inertias that a body can have."""

from rbd.identification.combinations import BaseParameters, base_parameters
from rbd.identification.data import MeasuredMotion
from rbd.identification.exciting import Excitation, excitation
from rbd.identification.identifying import identify
from rbd.identification.result import BodyInertia, Identification, IdentificationCertificate
from rbd.modules import submodule as _submodule

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
