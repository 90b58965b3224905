"""Reference motions: read, made, edited and differentiated; and checked: is this motion possible?"""

from rbd.modules import submodule as _submodule
from rbd.motion.causes import CAUSES
from rbd.motion.checking import check_motion
from rbd.motion.contact_detection import find_contacts
from rbd.motion.derivation import Derivation, derivatives
from rbd.motion.lanes import Lanes
from rbd.motion.making import minimum_jerk
from rbd.motion.motion import Motion
from rbd.motion.report import MotionReport

__all__ = [
    "CAUSES",
    "Derivation",
    "Lanes",
    "Motion",
    "MotionReport",
    "check_motion",
    "derivatives",
    "find_contacts",
    "minimum_jerk",
]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
