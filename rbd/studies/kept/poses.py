"""What is kept of poses: of a state, and of what `rbd.find_pose` finds."""

from __future__ import annotations

from rbd.answers.many import naming
from rbd.answers.many.naming import Named
from rbd.mechanism.pose_search import FoundPose
from rbd.model.state import State
from rbd.studies.kept.registry import Kept, Kind, one


def _q(state: State) -> list[Named]:
    return [naming.coordinates("q", state.q, state.robot)]


def _v(state: State) -> list[Named]:
    return [naming.coordinates("v", state.v, state.robot)]


def _com(state: State) -> list[Named]:
    return [naming.com(state.com)]


def _of_pose(found: FoundPose) -> list[Named]:
    return _q(found.state)


KINDS = {
    "rbd.model.state.State": Kind(
        {
            "q": Kept("configuration", _q),
            "v": Kept("velocities", _v),
            "com": Kept("centre of mass in W", _com),
        }
    ),
    "rbd.mechanism.pose_search.FoundPose": Kind(
        {
            **one("worst_error", "largest error of targets and loops", lambda found: found.worst, "m or rad"),
            "q": Kept("configuration", _of_pose),
            "com": Kept("centre of mass in W", lambda found: _com(found.state)),
            **one("moved", "distance of the joints from the posture", lambda found: found.moved, "rad"),
            **one("at_limits", "number of joints at a limit", lambda found: len(found.at_limits), default=False),
            **one("starts", "number of starts of the search", lambda found: found.starts, default=False),
        },
        ("worst_error",),
    ),
}
"""What is kept of each class."""
