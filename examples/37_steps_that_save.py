"""What do steps add to the push that Talos survives on fixed feet?

Pushed to its left as in example 29, for 0.1 s at its torso: with the 52 N s that its whole-body control there survives, and
with 70 N s, after which it falls. Over a foot that stands, with z the centre of pressure and w = sqrt(g / h), the capture
point moves as

    x = c + c' / w,    x(T) = z + (x - z) exp(w T):    beside the soles it runs away, until a foot is put where it is.

`rbd.control.Balance` lifts a foot once x has left the soles by 4 % of the height h of c, puts it where x will be when it lands,
and chooses place and time again each 0.1 / w until then.
"""

import importlib
import warnings
from pathlib import Path

import numpy as np

import rbd

EX29 = importlib.import_module("29_balance")
LEFT, PUSHES, WATCHED_S, STEP_S = np.array([0.0, 1.0, 0.0]), (52, 70), 2.0, 2e-3


def stepped(size: float) -> tuple[rbd.control.Balance, rbd.Trajectory]:
    """The controller and the motion after a push to the left [N s]."""
    robot = EX29.talos()[0].robot
    balance = rbd.control.Balance(robot, friction=0.7)
    given = {"controller": balance, "external": EX29.push(size * LEFT), "record_every": 5, "progress": False}
    with warnings.catch_warnings():  # joints that reach their limits, and feet that slip, are counted below
        warnings.simplefilter("ignore", rbd.errors.RelaxedLimitsWarning)
        return balance, rbd.simulate(balance.state, balance.contacts, duration=WATCHED_S, step=STEP_S, **given)


def main(show: bool = True) -> tuple[list[bool], list[rbd.Trajectory]]:
    print("Talos pushed to its left at its torso for 0.1 s; how far each foot is to the left afterwards")
    print(" N s   fixed feet    steps   plans   left foot [cm]   right foot [cm]   violated steps of control")
    fixed, saved = [], []
    for size in PUSHES:
        fixed.append(EX29.stands(EX29.pushed(EX29.CONTROL, size * LEFT)))
        balance, way = stepped(size)
        saved.append(way)
        left, right = (100.0 * (p[-1] - p[0]).mean(axis=0)[1] for p in (way.points["left_sole"], way.points["right_sole"]))
        n, plans, log = len(balance.plan.footsteps), len(balance.plans), balance.log
        print(f"{size:4d}   {'stands' if fixed[-1] else 'falls':>10}   {n:6d}   {plans:5d}", end="")
        print(f"   {left:14.0f}   {right:15.0f}   {log.violations:12d} of {len(log)}")
        if show:
            Path("out").mkdir(exist_ok=True)
            region, page = rbd.control.capture_region(balance.state, balance.contacts), f"out/37_steps_{size}.html"
            page = way.export(page, external=EX29.push(size * LEFT), plan=balance.plans, regions=[region], speed=0.25)
            print(f"See {page}: footholds as they were planned, the capture point and the region that it leaves.")
    return fixed, saved


def check(result: tuple[list[bool], list[rbd.Trajectory]]) -> None:
    """Fixed feet hold the first push and not the second; after both it stands on two feet, as high as at first, still."""
    fixed, saved = result
    assert fixed == [True, False]
    for way in saved:
        mass = way.robot.mass
        assert abs(way.com[-1, 2] - way.com[0, 2]) < 0.05 and np.linalg.norm(way.momentum[-1, :3]) < 0.05 * mass
        assert all(force[-1, 2] > 0.2 * EX29.GRAVITY * mass for force in way.forces.values())


if __name__ == "__main__":
    check(main())
