"""Plans: motions from keyframe to keyframe whose contacts carry them at every instant, with the certificate of that."""

from rbd.planning.momentum import MomentumCertificate
from rbd.planning.planned_motion import Plan

__all__ = ["MomentumCertificate", "Plan"]
