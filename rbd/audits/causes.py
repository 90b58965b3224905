"""What can be wrong with a contact force, by name, and from which size on it is said."""

from __future__ import annotations

from dataclasses import dataclass, fields
from types import MappingProxyType

from rbd.arrays import check_number
from rbd.displayed import Displayed

CAUSES = MappingProxyType({
    "balance": ("N", "M a + h = S^T tau + J^T f does not hold: this force is missing"),
    "outside the cone": ("N", "friction is larger than mu times the normal force"),
    "pulls": ("N", "the normal force is negative"),
    "pushes at a distance": ("m", "a force where the surfaces are apart"),
    "lifts": ("m/s", "the point leaves the surface while it is pushed"),
    "creeps": ("m/s", "the point slides while its force is inside the cone"),
    "friction not opposed": ("degrees", "friction is not opposite to the sliding"),
    "sinks": ("m", "the surfaces are inside each other"),
    "makes energy": ("W", "the contact does positive work"),
})
"""{cause: (unit of its size, what it is)}, in the order of `AuditReport.sizes`."""


@dataclass(frozen=True, kw_only=True)
class Thresholds(Displayed):
    """From which size on a cause is reported. Shares are of the robot's weight; without gravity, of the forces.

    Attributes:
        balance: Missing force, or moment over 0.3 m, a share.
        force: Force below which a point counts as free, a share.
        cone: Force outside of the cone, a share; and 1 less the share of friction from which a force is on its cone.
        gap: Distance at which a force is wrong [m].
        depth: Depth that is called sinking [m].
        speed: Speed of creeping and of lifting [m/s].
        angle: Angle between friction and what opposes the sliding [degrees].
        after: A point at rest whose record has true accelerations is judged by its speed after this time [s].

    Raises:
        InputError: numbers that are not above zero.

    Example:
        >>> rbd.audits.Thresholds(speed=0.01).gap
        0.001
    """

    balance: float = 1e-4
    force: float = 1e-3
    cone: float = 1e-3
    gap: float = 1e-3
    depth: float = 1e-3
    speed: float = 1e-3
    angle: float = 5.0
    after: float = 0.1

    def __post_init__(self) -> None:
        for each in fields(self):
            value = check_number(each.name, getattr(self, each.name), 1e-15, 1e6, expected="a number above zero")
            object.__setattr__(self, each.name, value)
