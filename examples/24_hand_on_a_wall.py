"""A humanoid leans a hand on a wall: who carries what, where may its centre of mass be, and how hard can it be pushed?

The wall is at Talos' left, and the push goes there. Without the hand, and with it; torques of any size, and within limits.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd
from rbd.statics import PushLimits, SupportRegion, push_limits, support_region

TORSO, LEFT, PUSH_N = "torso_2_link", np.array([0.0, 1.0, 0.0]), 140.0


@dataclass(frozen=True)
class Result:
    """Held against the push, with the hand; regions without limits and within them; largest pushes."""

    held: rbd.Actuation
    regions: dict[str, tuple[SupportRegion, SupportRegion]]
    pushes: dict[str, PushLimits]


def main(show: bool = True) -> Result:
    talos = rbd.load_robot("talos")
    hand = rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Ground(normal=(0.0, -1.0, 0.0)), friction=0.5)
    state, contacts = talos.standing(), [*talos.soles(friction=0.7), hand]
    regions, pushes = {}, {}
    for name, n in (("soles", 2), ("soles and hand", 3)):
        free, limited = (support_region(state, contacts[:n], torque_limits=limits) for limits in (False, True))
        regions[name], pushes[name] = (free, limited), push_limits(state, contacts[:n], TORSO, LEFT)
        print(f"{name}: centre of mass over {1e4 * free.area:.0f} cm2, within torque limits {1e4 * limited.area:.0f} cm2;")
        print(f"  {pushes[name]}")
    push = rbd.ExternalForce(TORSO, PUSH_N * LEFT)
    held = rbd.hold(state, contacts, external=push)
    carried = ", ".join(f"{name} {np.linalg.norm(force[:3]):.0f} N" for name, force in held.forces.items())
    print(f"pushed with {PUSH_N:.0f} N: {carried}; hardest motor at {100 * (1 - held.margins.torque.min()):.0f} %")
    if show:
        from rbd.visual import Scene

        Path("out").mkdir(exist_ok=True)
        with Scene(talos) as scene:
            scene.show(state, held, external=push)
            scene.draw(*regions["soles and hand"])
            print("picture:", scene.export("out/24_hand_on_a_wall.html"))
    return Result(held, regions, pushes)


def check(result: Result) -> None:
    """A contact more takes nothing away, torque limits give nothing, and the hand makes 140 N possible."""
    (free, limited), (more, most) = result.regions.values()
    assert free.area < more.area and limited.area < most.area < more.area and limited.area <= free.area + 1e-4
    assert result.pushes["soles"].forces[0] < PUSH_N < result.pushes["soles and hand"].forces[0]
    assert result.held.forces["hand"][1] < -10.0 and max(x.residual for x in (free, limited, more, most)) < 1e-5


if __name__ == "__main__":
    check(main())
