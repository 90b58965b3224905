"""A file holds the motion of a crouching G1. Can the robot do it? If not, which frames are impossible, and why?"""

import tempfile
from pathlib import Path

import numpy as np

import rbd

BENT = (("hip_pitch", -0.75), ("knee", 1.57), ("ankle_pitch", -0.82))  # [rad]
LEGS = {f"{side}_{name}_joint": angle for side in ("left", "right") for name, angle in BENT}
SECONDS, RATE = 2.0, 60.0


def crouch(g1: rbd.Robot) -> rbd.Motion:
    """Down in one second and up in another with the least jerk, the soles where they are."""
    standing = g1.standing()
    held = [sole.anchored(standing) for sole in g1.soles(friction=None)]

    def pose(t: float) -> np.ndarray:
        u = 1.0 - abs(1.0 - np.clip(2.0 * t / SECONDS, 0.0, 2.0))  # from 0 to 1 and back
        s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        legs = {name: (1.0 - s) * standing.q[g1.joints[name].q] + s * angle for name, angle in LEGS.items()}
        return rbd.mechanism.assemble(standing, held, fixed=legs).q  # the base follows from the soles

    return rbd.Motion.from_function(g1, pose, np.arange(0.0, SECONDS + 0.5 / RATE, 1.0 / RATE))


def checked(motion: rbd.Motion) -> dict[str, rbd.motion.MotionReport]:
    """The motion as it is, and with what goes wrong when motions of people are put onto robots."""
    g1, t, q = motion.robot, motion.t, motion.q
    dragged = q.copy()
    dragged[:, 0] += 0.05 * t  # 5 cm/s to the front
    tilted = q.copy()
    tilted[:, [g1.joints[f"{side}_ankle_pitch_joint"].q.start for side in ("left", "right")]] += np.deg2rad(5.0)
    return {
        "as it is": rbd.check_motion(motion),
        "5 cm too high": rbd.check_motion(motion.lifted(0.05), ground=0.0),
        "3 cm too low": rbd.check_motion(motion.lifted(-0.03), ground=0.0),
        "dragged along": rbd.check_motion(rbd.Motion.of_arrays(g1, t, dragged)),
        "soles tilted": rbd.check_motion(rbd.Motion.of_arrays(g1, t, tilted)),
        "in 0.5 s": rbd.check_motion(rbd.Motion.of_arrays(g1, 0.25 * t, q, window=0.05)),
        "weak motors": rbd.check_motion(motion, torque_limits=0.2),
    }


def main(show: bool = True) -> dict[str, rbd.motion.MotionReport]:
    g1 = rbd.load_robot("g1")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "crouch.csv"
        crouch(g1).save(file, header=False)  # rows as in the files of others: base, quaternion, joints
        motion = rbd.Motion.read(file, robot=g1, rate=RATE)
    for note in motion.notes[:2]:  # what was guessed of the file
        print("note:", note)
    reports = checked(motion)
    print(f"{'G1 crouches,':<16}{'possible':>9}{'score':>7}   frames by cause")
    for name, report in reports.items():
        causes = ", ".join(
            f"{cause} {report.of_cause(cause).sum()}" for cause in rbd.motion.CAUSES if report.of_cause(cause).any()
        )
        print(f"{name:<16}{100.0 * report.share_possible:>7.0f} %{report.score:>7.0f}   {causes or 'none'}")
    again = reports["5 cm too high"].lifted()
    print(f"put back onto the floor: {100.0 * again.share_possible:.0f} % possible")
    if show:
        Path("out").mkdir(exist_ok=True)
        reports["in 0.5 s"].export("out/26_is_this_motion_possible.html")
    return reports


def check(result: dict[str, rbd.motion.MotionReport]) -> None:
    """Each fault is found by its name; what is missing in the air is the weight and what accelerates the robot."""
    expected = {
        "5 cm too high": "floats",
        "3 cm too low": "sinks",
        "dragged along": "slides",
        "soles tilted": "tilted sole",
        "in 0.5 s": "tips",
        "weak motors": "motor",
    }
    assert result["as it is"].possible.all()
    for name, cause in expected.items():
        assert result[name].of_cause(cause).any(), name
    report = result["5 cm too high"]
    for i in range(0, report.n, 10):
        state, a = report.motion.state(i), report.motion.a[i]
        force = (state.M @ a + state.h)[:3]  # of the base, in its own axes
        assert abs(np.linalg.norm(force) - np.linalg.norm(report.missing[i, :3])) < 1e-6 * np.linalg.norm(force)


if __name__ == "__main__":
    check(main())
