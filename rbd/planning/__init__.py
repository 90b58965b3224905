"""Plans: motions from keyframe to keyframe whose contacts carry them at every instant, with the proof of that."""

from rbd.planning.momentum import MomentumProof
from rbd.planning.planned_motion import Plan

__all__ = ["MomentumProof", "Plan"]
