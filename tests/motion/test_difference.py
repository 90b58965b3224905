"""How far two motions are from each other: of joints, base and centre of mass."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError
from rbd.motion import Motion, MotionDifference, minimum_jerk


@pytest.fixture(scope="module")
def talos() -> rbd.Robot:
    return rbd.load_robot("talos")


class TestDifference:
    """How far two motions are from each other."""

    def test_of_a_motion_from_itself(self, squat: rbd.Trajectory) -> None:
        """Nothing, to rounding."""
        m = Motion.of_trajectory(squat[::50])
        off = MotionDifference.of(m, m)
        assert not off.joints.any()
        assert max(size for _, size, _ in off.worst()) < 1e-7
        assert "base" in str(off)

    def test_known_differences(self, squat: rbd.Trajectory) -> None:
        """A joint, the place of the base and its turn, each in its frame."""
        m = Motion.of_trajectory(squat[::50])
        q = m.q.copy()
        q[3, m.robot.joints["waist_yaw_joint"].q] += 0.25
        q[5, :3] += [0.03, 0.04, 0.0]
        q[6, 3:7] = pin.Quaternion(pin.exp3(np.array([0.0, 0.0, 0.1])) @ pin.Quaternion(m.q[6, 3:7]).matrix()).coeffs()
        off = MotionDifference.of(Motion.of_arrays(m.robot, m.t, q, m.v, m.a), m)
        table = {name: (size, t) for name, size, t in off.worst()}
        assert table["waist_yaw_joint"] == (pytest.approx(0.25), m.t[3])
        assert table["base"] == (pytest.approx(0.05), m.t[5])
        assert table["turn of the base"] == (pytest.approx(0.1), m.t[6])
        assert off.worst()[3][0] == "waist_yaw_joint"
        assert "14.32 deg" in str(off)
        assert "base up to 50.0 mm" in repr(off)

    def test_what_cannot_be_compared(self, squat: rbd.Trajectory, talos: rbd.Robot) -> None:
        """Other robots, a reference that ends earlier, other things; a motion that ends earlier can."""
        m = Motion.of_trajectory(squat[::50])
        other = minimum_jerk(talos, [talos.standing().q] * 2, [0.0, 1.0])
        for motion, reference in ((m, other), (m, m.cut(0.0, 0.5)), (m, 3), ("x", m)):
            with pytest.raises(InputError):
                MotionDifference.of(motion, reference)  # type: ignore[arg-type]
        assert MotionDifference.of(m.cut(0.0, 0.5), m).left_out == pytest.approx(m.t[-1] - 0.5)
