"""Given v and a that are not the rates of q are refused, those of a base in world axes converted; frame numbers and units."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.errors import InputError
from rbd.model.sampled_motion import exponential, rotated
from rbd.motion import Motion

RATE = 60.0


@pytest.fixture(scope="module")
def dance(g1) -> Motion:
    """G1 that walks a curve, leans and swings its joints, 3 s at 60 Hz; v and a by differences of the exact q."""
    stands, phase = g1.standing().q, np.arange(29)

    def q(t: float) -> np.ndarray:
        out = stands.copy()
        out[:2] += [0.6 * t, 0.1 * np.sin(2.0 * t)]
        out[3:7] = exponential(np.array([0.15 * np.sin(5.0 * t), 0.15 * np.cos(4.0 * t), 0.3 + 0.8 * t]))
        out[7:] += 0.3 * np.sin(4.0 * t + phase)
        return out

    return Motion.from_function(g1, q, np.arange(180) / RATE)


def in_world(x: Motion, *, turning: bool) -> tuple[np.ndarray, np.ndarray]:
    """(v, a) as MuJoCo has them: linear ones in world axes, a classical; and as Isaac: angular ones as well."""
    v, a, R = x.v.copy(), x.a.copy(), x.q[:, 3:7]
    v[:, :3] = rotated(R, x.v[:, :3])
    a[:, :3] = rotated(R, x.a[:, :3] + np.cross(x.v[:, 3:6], x.v[:, :3]))
    if turning:
        v[:, 3:6], a[:, 3:6] = rotated(R, x.v[:, 3:6]), rotated(R, x.a[:, 3:6])
    return v, a


class TestOtherRates:
    """v and a that are no rates of q: the error names the coordinate and the factor."""

    @pytest.mark.parametrize(("share", "told"), [(0.0, "0.00 times"), (0.5, "0.50 times"), (2.0, "2.00 times")])
    def test_a_share_of_the_speed(self, dance, share: float, told: str):
        """Zeros, half and twice the speed."""
        with pytest.raises(InputError, match=f"v is not the rate of q.*{told}.*rad/s.*trust=True"):
            Motion.of_arrays(dance.robot, dance.t, dance.q, share * dance.v, share**2 * dance.a)

    def test_a_fast_lean_does_not_become_possible(self, g1):
        """G1 that leans in 0.3 s tips; with v = a = 0, or half the speed, it would pass."""
        stands = g1.standing().q
        leans = stands.copy()
        leans[g1.joints["waist_pitch_joint"].q] = 0.5
        fast = rbd.motion.minimum_jerk(g1, [stands, leans, stands], [0.0, 0.3, 0.6], rate=RATE)
        shares = [rbd.check_motion(fast).share_possible]
        for share in (0.5, 0.0):
            given = (g1, fast.t, fast.q, share * fast.v, share**2 * fast.a)
            with pytest.raises(InputError, match="v is not the rate of q"):
                Motion.of_arrays(*given)
            shares.append(rbd.check_motion(Motion.of_arrays(*given, trust=True)).share_possible)
        assert shares[0] < 0.5 and shares[1:] == [1.0, 1.0]  # what the refusal prevents

    def test_one_joint(self, dance):
        """A sign, and the joints in another order."""
        v = dance.v.copy()
        v[:, 10] *= -1.0
        with pytest.raises(InputError, match=r"v\[:, 10\], left_ankle_pitch_joint: it is -1.00 times"):
            Motion.of_arrays(dance.robot, dance.t, dance.q, v)
        v[:, 6:] = dance.v[:, :5:-1]
        with pytest.raises(InputError, match="order of its columns"):
            Motion.of_arrays(dance.robot, dance.t, dance.q, v)

    def test_degrees(self, dance):
        """All angles of v, the base's too."""
        v = dance.v.copy()
        v[:, 3:] *= 180.0 / np.pi
        with pytest.raises(InputError, match=r"57\.\d+ times.*degrees"):
            Motion.of_arrays(dance.robot, dance.t, dance.q, v)

    def test_accelerations_alone(self, dance):
        """Zeros beside right velocities."""
        with pytest.raises(InputError, match="a is not the rate of v.*0.00 times"):
            Motion.of_arrays(dance.robot, dance.t, dance.q, dance.v, 0.0 * dance.a)

    def test_in_a_file_and_trusted(self, dance, tmp_path):
        """An .npz of q, t, v, a; with trust they are taken as they are."""
        path = tmp_path / "half.npz"
        np.savez(path, t=dance.t, q=dance.q, v=0.5 * dance.v, a=0.25 * dance.a)
        with pytest.raises(InputError, match=r"half.npz: v is not the rate of q.*0.50 times"):
            Motion.read(path, robot=dance.robot)
        assert (Motion.read(path, robot=dance.robot, trust=True).v == 0.5 * dance.v).all()

    def test_a_saved_motion_whose_velocities_were_changed(self, dance, tmp_path):
        """What Motion.save wrote is tested as well."""
        dance.save(tmp_path / "right.npz")
        assert (Motion.read(tmp_path / "right.npz").v == dance.v).all()
        replace(dance, v=0.0 * dance.v, a=0.0 * dance.a).save(tmp_path / "wrong.npz")
        with pytest.raises(InputError, match="v is not the rate of q"):
            Motion.read(tmp_path / "wrong.npz")


class TestWorldAxes:
    """Velocities of the base as other engines have them."""

    @pytest.mark.parametrize(("turning", "engine"), [(False, "MuJoCo"), (True, "Isaac")])
    def test_they_are_converted_and_it_is_told(self, dance, turning: bool, engine: str):
        """To rounding."""
        v, a = in_world(dance, turning=turning)
        found = Motion.of_arrays(dance.robot, dance.t, dance.q, v, a)
        assert np.abs(found.v - dance.v).max() < 1e-13
        assert np.abs(found.a - dance.a).max() < 1e-12
        assert [f"the base's linear {what}" in note and engine in note for what, note in
                zip(("velocities", "accelerations"), found.notes, strict=True)] == [True, True]  # fmt: skip

    def test_with_noise_of_sensors(self, dance):
        """5 cm/s, and 0.05 rad/s."""
        rng = np.random.default_rng(0)
        v, _ = in_world(dance, turning=True)
        noise = 0.05 * rng.normal(size=v.shape)
        found = Motion.of_arrays(dance.robot, dance.t, dance.q, v + noise)
        assert "Isaac" in found.notes[0]
        assert np.abs(found.v - dance.v).max() < 2.0 * np.abs(noise).max()

    def test_classical_accelerations_in_its_own_axes(self, dance):
        """R^T p'' in place of the rate of R^T p'."""
        a = dance.a.copy()
        a[:, :3] += np.cross(dance.v[:, 3:6], dance.v[:, :3])
        found = Motion.of_arrays(dance.robot, dance.t, dance.q, dance.v, a)
        assert np.abs(found.a - dance.a).max() < 1e-12 and "classical" in found.notes[0]

    def test_its_own_axes_stay(self, dance):
        """Nothing is said, nothing changed."""
        found = Motion.of_arrays(dance.robot, dance.t, dance.q, dance.v, dance.a)
        assert (found.v == dance.v).all() and (found.a == dance.a).all() and not found.notes

    def test_a_planar_base(self):
        """A body in a plane, in world axes."""
        sled = rbd.load_robot("solo12", root="planar")
        t = np.arange(120) / RATE
        angle = 0.5 + 2.0 * t
        q = np.tile(sled.neutral(), (len(t), 1))
        q[:, :4] = np.stack([t, np.sin(2.0 * t), np.cos(angle), np.sin(angle)], axis=1)
        world = np.stack([np.ones_like(t), 2.0 * np.cos(2.0 * t)], axis=1)
        v = np.zeros((len(t), sled.nv))
        v[:, :2], v[:, 2] = world, 2.0
        found = Motion.of_arrays(sled, t, q, v)
        c, s = np.cos(angle), np.sin(angle)
        assert np.allclose(found.v[:, 0], c * world[:, 0] + s * world[:, 1]) and "world axes" in found.notes[0]
        assert (Motion.of_arrays(sled, t, q, found.v).v == found.v).all()


class TestRightOnes:
    """What sampling and noise leave open is no fault."""

    @pytest.mark.parametrize("shift", [0, 1])
    def test_differences_of_q(self, dance, shift: int):
        """Forward and backward ones, off by half a frame, and accelerations from them."""
        model, h = dance.robot.model, 1.0 / RATE
        step = np.array([rbd.dynamics.pin.difference(model, *x) for x in zip(dance.q, dance.q[1:], strict=False)]) / h
        v = np.vstack([step[:1], step]) if shift else np.vstack([step, step[-1:]])
        assert not Motion.of_arrays(dance.robot, dance.t, dance.q, v, np.gradient(v, h, axis=0)).notes

    def test_noise_and_encoders(self, dance):
        """Noise of v; q in steps of a milliradian at 1 kHz, whose differences are all noise: and half of v is still seen."""
        rng = np.random.default_rng(1)
        v = dance.v + 0.1 * rng.normal(size=dance.v.shape)
        Motion.of_arrays(dance.robot, dance.t, dance.q, v)
        arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        t = np.arange(2000) / 1000.0
        angles = 0.2 * np.sin(3.0 * np.outer(t, [1.0, 1.5]))
        rates = 0.6 * np.array([1.0, 1.5]) * np.cos(3.0 * np.outer(t, [1.0, 1.5]))
        coarse = np.round(angles, 3)
        Motion.of_arrays(arm, t, coarse, rates)
        with pytest.raises(InputError, match="v is not the rate of q"):
            Motion.of_arrays(arm, t, coarse, 0.5 * rates)

    @pytest.mark.parametrize("every", [1, 3, 10, 40])
    def test_simulated_motions_with_impacts(self, four_steps, every: int):
        """Steps that land, in full and sparsely recorded: neither refused nor taken for other axes."""
        x = four_steps[::every]
        assert not Motion.of_arrays(x.robot, x.t, x.q, x.v, x.a).notes

    @pytest.mark.parametrize("every", [1, 4, 25])
    def test_a_box_that_is_thrown(self, every: int):
        """It spins, strikes the floor and slides."""
        box = rbd.testing.box()
        face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        start = rbd.State(box, [0, 0, 0.3, 0, 0, 0, 1], [2.0, 1.0, 1.0, 1.0, 2.0, 3.0])
        x = rbd.simulate(start, [face], duration=1.0, step=5e-3, may_sink=True)[::every]
        assert not Motion.of_arrays(box, x.t, x.q, x.v, x.a).notes

    def test_a_jump_in_q(self, dance):
        """A frame-wise cut of 5 cm is no fault of v."""
        q = dance.q.copy()
        q[90:, 0] += 0.05
        assert not Motion.of_arrays(dance.robot, dance.t, q, dance.v).notes[1:]

    def test_one_and_two_frames(self, dance):
        """One has no rate; of two, zeros are seen."""
        Motion.of_arrays(dance.robot, dance.t[:1], dance.q[:1], dance.v[:1], dance.a[:1])
        Motion.of_arrays(dance.robot, dance.t[:2], dance.q[:2], dance.v[:2], dance.a[:2])
        with pytest.raises(InputError, match="0.00 times"):
            Motion.of_arrays(dance.robot, dance.t[:2], dance.q[:2], 0.0 * dance.v[:2], 0.0 * dance.a[:2])


class TestQuaternionOrder:
    """w first, in arrays as in files."""

    @pytest.fixture
    def first(self, dance) -> np.ndarray:
        """Its configurations, w first."""
        return dance.q[:, [0, 1, 2, 6, 3, 4, 5, *range(7, 36)]]

    def test_it_is_seen_by_the_upright_base(self, dance, first):
        """And told; the order can be given."""
        found = Motion.of_arrays(dance.robot, dance.t, first)
        assert np.allclose(found.q, dance.q) and "w, x, y, z" in found.notes[0] and "quaternion='xyzw'" in found.notes[0]
        given = Motion.of_arrays(dance.robot, dance.t, first, quaternion="wxyz")
        assert np.allclose(given.q, dance.q) and not given.notes
        kept = Motion.of_arrays(dance.robot, dance.t, first, quaternion="xyzw")
        assert np.allclose(kept.q[:, 3:7], first[:, 3:7])
        with pytest.raises(InputError, match="quaternion is 'wxzy'; .*Expected one of xyzw, wxyz"):
            Motion.of_arrays(dance.robot, dance.t, first, quaternion="wxzy")

    def test_angular_velocities_decide(self, dance, first):
        """Those of the dance fit w first; those of a robot that rolls over on its back fit its own order."""
        found = Motion.of_arrays(dance.robot, dance.t, first, dance.v, dance.a)
        assert np.allclose(found.q, dance.q) and (found.v == dance.v).all() and "angular velocities fit" in found.notes[0]
        t = np.arange(60) / RATE
        q = np.tile(dance.robot.standing().q, (60, 1))
        q[:, 3:7] = exponential(np.stack([np.pi - 0.5 * np.sin(3.0 * t), 0.0 * t, 0.0 * t], axis=1))
        v = np.zeros((60, dance.robot.nv))
        v[:, 3] = -1.5 * np.cos(3.0 * t)
        back = Motion.of_arrays(dance.robot, t, q, v)
        assert np.allclose(back.q, q) and not any("taken as" in note for note in back.notes)

    def test_in_an_npz(self, dance, first, tmp_path):
        """Of q and t; what Motion.save wrote is x, y, z, w."""
        np.savez(tmp_path / "first.npz", t=dance.t, q=first)
        assert np.allclose(Motion.read(tmp_path / "first.npz", robot=dance.robot).q, dance.q)
        np.savez(tmp_path / "given.npz", t=dance.t, q=dance.q)
        assert np.allclose(Motion.read(tmp_path / "given.npz", robot=dance.robot).q, dance.q)


class TestFrameNumbers:
    """0, 1, 2, ... are no seconds."""

    def table(self, dance, folder, column, header: str = "") -> Path:
        """A file of these numbers, then its frames."""
        rows = [",".join([f"{i:g}", *(f"{x:.6f}" for x in q)]) for i, q in zip(column, dance.q, strict=True)]
        (folder / "dance.csv").write_text("\n".join([header] * bool(header) + rows) + "\n")
        return folder / "dance.csv"

    def test_a_first_column_of_them(self, dance, tmp_path):
        """It asks for the rate, which then is used."""
        path = self.table(dance, tmp_path, range(180))
        with pytest.raises(InputError, match="counts frames, 0, 1, 2, .*; give rate=30"):
            Motion.read(path, robot=dance.robot)
        found = Motion.read(path, robot=dance.robot, rate=RATE)
        assert np.allclose(found.t, dance.t) and any("counts frames" in note for note in found.notes)
        assert not any("taken for times" in note for note in found.notes)

    def test_missing_frames_are_gaps(self, dance, tmp_path):
        """From frame 10, without 15."""
        numbers = np.delete(np.arange(10, 191), 5)
        found = Motion.read(self.table(dance, tmp_path, numbers), robot=dance.robot, rate=RATE)
        assert np.allclose(found.t, (numbers - 10) / RATE)

    def test_a_column_t_and_an_npz(self, dance, tmp_path):
        """The same, by name."""
        names = ["t", *(f"root_{x}" for x in ("x", "y", "z", "qx", "qy", "qz", "qw")), *dance.joints]
        path = self.table(dance, tmp_path, range(180), ",".join(names))
        np.savez(tmp_path / "dance.npz", t=np.arange(180), q=dance.q)
        for each in (path, tmp_path / "dance.npz"):
            with pytest.raises(InputError, match="count(s|) frames.*rate=30"):
                Motion.read(each, robot=dance.robot)
            assert np.allclose(Motion.read(each, robot=dance.robot, rate=RATE).t, dance.t)

    def test_in_arrays(self, dance):
        """Without v they make it 60 times as slow; with v that is seen."""
        with pytest.raises(InputError, match="count frames.*numpy.arange"):
            Motion.of_arrays(dance.robot, np.arange(180), dance.q)
        with pytest.raises(InputError, match=r"v is not the rate of q.* (60\.0\d|59\.9\d) times.*rate and times"):
            Motion.of_arrays(dance.robot, np.arange(180.0), dance.q, dance.v)


class TestUnits:
    """Lengths of the base, norms of quaternions."""

    @pytest.mark.parametrize(("factor", "unit"), [(100.0, "centimetres"), (1000.0, "millimetres")])
    def test_a_base_in_other_units(self, dance, tmp_path, factor: float, unit: str):
        """Of a table and of arrays; a high floor is none of these."""
        q = dance.q.copy()
        q[:, :3] *= factor
        np.savetxt(tmp_path / "dance.csv", q, delimiter=",")
        with pytest.raises(InputError, match=rf"dance.csv: the base is .* Is its position in {unit}\?.*by {factor:g}"):
            Motion.read(tmp_path / "dance.csv", robot=dance.robot, rate=RATE)
        with pytest.raises(InputError, match=unit):
            Motion.of_arrays(dance.robot, dance.t, q)
        high = dance.q + 0.7 * factor * np.eye(36)[2]
        Motion.of_arrays(dance.robot, dance.t, high, ground=0.7 * factor)
        Motion.of_arrays(dance.robot, dance.t, high, trust=True)

    def test_quaternions_up_to_five_percent_off(self, dance, tmp_path):
        """Normalised, with a note of the largest; six per cent are refused."""
        q = dance.q.copy()
        q[:, 3:7] *= 1.0 + 0.045 * np.sin(np.arange(180.0))[:, None]
        np.savetxt(tmp_path / "dance.csv", q, delimiter=",")
        read = Motion.read(tmp_path / "dance.csv", robot=dance.robot, rate=RATE)
        for found in (Motion.of_arrays(dance.robot, dance.t, q), read):
            assert np.allclose(found.q, dance.q, atol=1e-12) and any("off by up to 0.04" in note for note in found.notes)
        q[7, 3:7] = 1.06 * dance.q[7, 3:7]
        with pytest.raises(InputError, match="frame 7: the quaternion .* norm 1.06"):
            Motion.of_arrays(dance.robot, dance.t, q)

    def test_those_of_bodies_too(self, dance, tmp_path):
        """In an .npz of bodies."""
        dance.save(tmp_path / "bodies.npz", kind="beyondmimic")
        arrays = dict(np.load(tmp_path / "bodies.npz"))
        arrays["body_quat_w"] = 1.03 * arrays["body_quat_w"]
        np.savez(tmp_path / "long.npz", **arrays)
        found = Motion.read(tmp_path / "long.npz", robot=dance.robot)
        assert np.allclose(found.q, dance.q, atol=1e-9) and any("body_quat_w were normalised" in note for note in found.notes)


def test_a_wheel_that_turns_round_and_round() -> None:
    """Its angle jumps by a turn where it passes pi: v of 3 rad/s is that of its q for two turns, and 2 rad/s is not."""
    unicycle = rbd.load_robot("unicycle")
    t = np.arange(140) / 30.0
    wheel = next(p for p in unicycle.joints.pieces if p.kind == "circle")
    q, v = np.tile(unicycle.at().q, (len(t), 1)), np.zeros((len(t), unicycle.nv))
    q[:, wheel.q : wheel.q + 2] = np.stack([np.cos(3.0 * t), np.sin(3.0 * t)], axis=1)
    v[:, wheel.v] = 3.0
    assert np.array_equal(Motion.of_arrays(unicycle, t, q, v).v, v)
    with pytest.raises(InputError, match="it is 0.67 times that rate"):
        Motion.of_arrays(unicycle, t, q, 2.0 / 3.0 * v)
