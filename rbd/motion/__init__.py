"""Motions over time: reference motions, read, made, edited and checked; measured motions, and their contact forces."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.motion.causes import CAUSES
from rbd.motion.checking import check_motion
from rbd.motion.contact_detection import find_contacts
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.derivation import Derivation, derivatives
from rbd.motion.difference import MotionDifference
from rbd.motion.force_estimate import ForceEstimate, OpenComponents
from rbd.motion.many_files import MotionFile, list_motions, read_all
from rbd.motion.measured import ForceHistory, estimate_forces, estimate_forces_along
from rbd.motion.observer import MomentumObserver
from rbd.motion.reference_motion import Motion, minimum_jerk
from rbd.motion.report import MotionReport
from rbd.motion.retiming.timing import Timing, find_timing, retimed
from rbd.motion.sensor_noise import SensorNoise

__all__ = [
    "CAUSES",
    "Derivation",
    "ForceEstimate",
    "ForceHistory",
    "ContactTimeline",
    "MomentumObserver",
    "Motion",
    "MotionDifference",
    "MotionFile",
    "MotionReport",
    "OpenComponents",
    "SensorNoise",
    "Timing",
    "check_motion",
    "derivatives",
    "estimate_forces",
    "estimate_forces_along",
    "find_contacts",
    "find_timing",
    "list_motions",
    "minimum_jerk",
    "read_all",
    "retimed",
]


__getattr__ = _partial(_submodule, __name__)
