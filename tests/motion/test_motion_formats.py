"""Motions in the formats of other tools, each made here in its layout: what is read, what is said, what is refused."""

from __future__ import annotations

import io
import pickle
from zipfile import ZipFile

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError
from rbd.model.sampled_motion import exponential
from rbd.motion import Motion, list_motions, read_all
from rbd.motion.file_conventions import breadth_first, file_order
from rbd.motion.file_frames import joint_values


@pytest.fixture(scope="module")
def steps(g1) -> Motion:
    """G1 that steps from foot to foot and turns, 1.5 s at 60 Hz, joints within limits; its feet stand still in turn."""
    t = np.arange(90) / 60.0
    q = np.tile(g1.standing().q, (len(t), 1))
    turn = 0.3 * np.sin(3.0 * t)
    q[:, 3:7] = exponential(np.stack([0.03 * np.sin(4.0 * t), 0.02 * np.cos(5.0 * t), turn], axis=1))
    q[:, :2] += np.stack([0.1 * t, 0.05 * np.sin(4.0 * t)], axis=1)
    for name, size, rate in (("knee", 0.2, 4.0), ("hip_roll", 0.1, 4.0), ("shoulder_roll", 0.2, 2.0), ("elbow", 0.3, 5.0)):
        for k, side in enumerate(("left", "right")):
            sign = -1.0 if k and name.endswith("roll") else 1.0
            q[:, g1.joints[f"{side}_{name}_joint"].q.start] += sign * size * (1.0 + k) * np.abs(np.sin(rate * t + k))
    return Motion.of_arrays(g1, t, q)


@pytest.fixture(scope="module")
def parts(steps, g1) -> dict[str, np.ndarray]:
    """Its base and joints as other tools store them."""
    q, names = steps.q, file_order(g1)
    vel = steps.v[:, [g1.joints[name].v.start for name in names]]
    qpos = q[:, [0, 1, 2, 6, 3, 4, 5, *range(7, g1.nq)]]
    dof = joint_values(g1, q, names)
    return {"pos": q[:, :3], "xyzw": q[:, 3:7], "wxyz": q[:, [6, 3, 4, 5]], "dof": dof, "vel": vel, "qpos": qpos}


def gmr(parts) -> dict:
    """What GMR pickles."""
    links = {"local_body_pos": None, "link_body_list": None}
    return {"fps": 60, "root_pos": parts["pos"], "root_rot": parts["xyzw"], "dof_pos": parts["dof"], **links}


def phc(parts, dof=None) -> dict:
    """A motion of what PHC and ASAP pickle."""
    return {
        "root_trans_offset": parts["pos"], "pose_aa": np.zeros((90, 30, 3)), "dof": parts["dof"] if dof is None else dof,
        "root_rot": parts["xyzw"], "smpl_joints": np.zeros((90, 24, 3)), "fps": 60,
    }  # fmt: skip


def pickled(path, value):
    """A file of it."""
    path.write_bytes(pickle.dumps(value))
    return path


def agrees(found: Motion, steps: Motion, tolerance: float = 1e-12) -> bool:
    """Whether q is the same, quaternions up to their sign."""
    sign = np.sign((found.q[:, 3:7] * steps.q[:, 3:7]).sum(axis=1))[:, None]
    other = np.hstack([found.q[:, :3], sign * found.q[:, 3:7], found.q[:, 7:]])
    return found.n == steps.n and np.abs(other - steps.q).max() < tolerance and abs(found.rate - 60.0) < 1e-6


class TestBaseAndJoints:
    """A base's pose and joints in arrays by name."""

    def test_gmr_and_twist(self, steps, parts, g1, tmp_path):
        """As pickle, as .npz in single precision, and with a name that says nothing."""
        assert agrees(Motion.read(pickled(tmp_path / "a.pkl", gmr(parts)), robot=g1), steps)
        assert agrees(Motion.read(pickled(tmp_path / "a.motion", gmr(parts)), robot=g1), steps)
        small = {name: np.asarray(x, np.float32) for name, x in gmr(parts).items() if x is not None}
        np.savez(tmp_path / "twist.npz", **small)
        found = Motion.read(tmp_path / "twist.npz", robot=g1)
        assert agrees(found, steps, 2e-6) and found.derivation.noise_q[10] > 1e-9
        assert any("all 29 joints of g1, in that order" in note for note in found.notes)

    def test_the_other_order_of_quaternions_is_seen(self, steps, parts, g1, tmp_path):
        """Where the base turns enough: it would roll in the order of the format."""
        turned = steps.q.copy()
        turned[:, 3:7] = exponential(np.array([0.0, 0.0, 2.0]) * np.linspace(0.5, 1.5, 90)[:, None])
        held = gmr(parts) | {"root_rot": turned[:, [6, 3, 4, 5]]}
        found = Motion.read(pickled(tmp_path / "a.pkl", held), robot=g1, trust=True)
        assert np.abs(found.q[:, 3:7] - turned[:, 3:7]).max() < 1e-12
        assert any("quaternions were taken as w, x, y, z" in note for note in found.notes)
        np.savez(tmp_path / "b.npz", qpos=turned, fps=60)
        found = Motion.read(tmp_path / "b.npz", robot=g1, trust=True)
        assert np.abs(found.q[:, 3:7] - turned[:, 3:7]).max() < 1e-12

    def test_lists_in_place_of_arrays(self, steps, parts, g1, tmp_path):
        """Rows as lists, or as a list of arrays."""
        as_lists = {name: list(x) if isinstance(x, np.ndarray) else x for name, x in gmr(parts).items()}
        as_lists["dof_pos"] = parts["dof"].tolist()
        assert agrees(Motion.read(pickled(tmp_path / "a.pkl", as_lists), robot=g1), steps)

    def test_phc_and_asap_hold_motions_by_name(self, steps, parts, g1, tmp_path):
        """One needs no name; of several one is named, or all are read; the 23 joints of ASAP have no wrists."""
        assert agrees(Motion.read(pickled(tmp_path / "one.pkl", {"walk": phc(parts)}), robot=g1), steps)
        keep = [i for i, name in enumerate(file_order(g1)) if "wrist" not in name]
        path = pickled(tmp_path / "two.pkl", {"walk": phc(parts), "small": phc(parts, parts["dof"][:, keep, None])})
        with pytest.raises(InputError, match="holds 2 motions: 'walk', 'small'; name one, motion='walk', or read all"):
            Motion.read(path, robot=g1)
        with pytest.raises(InputError, match="holds no motion 'smal'; nearest: 'small'"):
            Motion.read(path, robot=g1, motion="smal")
        found = Motion.read(path, robot=g1, motion="small")
        assert np.abs(found.q[:, 7:29] - steps.q[:, 7:29]).max() < 1e-12
        assert any("(no wrists), in that order" in note for note in found.notes)
        assert any("not read: pose_aa (90, 30, 3), smpl_joints (90, 24, 3)" in note for note in found.notes)
        listed = [str(file) for file, motion in read_all(tmp_path, robot=g1) if agrees(motion, steps)]
        assert listed == [f"{tmp_path / 'one.pkl'}[walk]", f"{path}[walk]", f"{path}[small]"]

    def test_joints_that_are_named(self, steps, parts, g1, tmp_path):
        """By the reader, or in the file with `_joint` left out: in any order."""
        index = [list(file_order(g1)).index(name) for name in breadth_first(g1)]
        held = gmr(parts) | {"dof_pos": parts["dof"][:, index]}
        path = pickled(tmp_path / "a.pkl", held)
        assert agrees(Motion.read(path, robot=g1, joints=list(breadth_first(g1))), steps)
        names = [name.removesuffix("_joint") for name in breadth_first(g1)]
        assert agrees(Motion.read(pickled(path, held | {"dof_names": names}), robot=g1), steps)

    def test_numbered_motions(self, steps, parts, g1, tmp_path):
        """A list of motions is read by number; LocoMuJoCo's split points cut one array into several."""
        path = pickled(tmp_path / "a.pkl", [gmr(parts), gmr(parts)])
        assert [file.name for file in list_motions(path)] == ["0", "1"]
        assert agrees(Motion.read(path, robot=g1, motion="1"), steps)
        twice = {"qpos": np.vstack([parts["qpos"]] * 2), "joint_names": ["root", *file_order(g1)], "frequency": 60.0}
        np.savez(tmp_path / "b.npz", **twice, split_points=[0, 90, 180])
        assert [agrees(motion, steps) for _, motion in read_all(tmp_path / "b.npz", robot=g1)] == [True, True]

    def test_what_is_missing_or_does_not_fit(self, parts, g1, tmp_path):
        """Another number of joints with what it looks like, other sizes, no rate, another rate, no frames, one frame."""

        def refused(match, robot=g1, **change):
            settings = change.pop("settings", {})
            with pytest.raises(InputError, match=match):
                Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | change), robot=robot, **settings)

        refused("dof_pos has 19 columns of joints; expected 29: all .*These look like H1 with 19", dof_pos=parts["dof"][:, :19])
        refused(r"root_rot \(90, 3\), dof_pos \(90, 29\); expected \(n, 3\), \(n, 4\)", root_rot=parts["pos"])
        refused("root_rot.0. has norm 2", root_rot=2.0 * parts["xyzw"])
        refused("fps in a.pkl is 0.0; expected 1 to", fps=0)
        refused("rate is 30, but fps in a.pkl is 60 Hz", settings={"rate": 30})
        refused("has no frame", **{name: np.empty((0, k)) for name, k in (("root_pos", 3), ("root_rot", 4), ("dof_pos", 29))})
        refused("one frame has no velocity", **{name: gmr(parts)[name][:1] for name in ("root_pos", "root_rot", "dof_pos")})
        refused(r"root_pos\[3, 1\] is nan", root_pos=np.where(np.arange(270).reshape(90, 3) == 10, np.nan, parts["pos"]))
        refused("no floating base", robot=rbd.load_robot("panda", root="fixed"))
        refused("root_pos is text; expected numbers", root_pos="here")
        refused("has 29 columns of joints; joints names 2", settings={"joints": ["left_knee_joint", "right_knee_joint"]})
        del (nothing := gmr(parts))["fps"]
        with pytest.raises(InputError, match="has no times; give rate=30"):
            Motion.read(pickled(tmp_path / "a.pkl", nothing), robot=g1)
        assert Motion.read(tmp_path / "a.pkl", robot=g1, rate=60).rate == pytest.approx(60.0)
        with pytest.raises(InputError, match="holds nothing"):
            Motion.read(pickled(tmp_path / "a.pkl", {}), robot=g1)


class TestQpos:
    """MuJoCo's qpos, quaternions w, x, y, z."""

    def test_alone_or_with_a_rate(self, steps, parts, g1, tmp_path):
        """An .npy with the rate in its name; an .npz with fps or a time step."""
        np.save(tmp_path / "walk_60hz.npy", parts["qpos"])
        np.savez(tmp_path / "a.npz", qpos=parts["qpos"], fps=60)
        np.savez(tmp_path / "b.npz", qpos=parts["qpos"], dt=1 / 60)
        np.savez(tmp_path / "c.npz", qpos=parts["qpos"], time=steps.t)
        for name in ("walk_60hz.npy", "a.npz", "b.npz", "c.npz"):
            assert agrees(Motion.read(tmp_path / name, robot=g1), steps, 1e-9), name

    def test_objects_behind_the_joints_are_told(self, steps, parts, g1, tmp_path):
        """A box's free joint, with names or without: the robot is read, and where the box moves is said."""
        box = np.hstack([0.4 * steps.t[:, None] * [1.0, 0.0, 1.0], np.tile([1.0, 0.0, 0.0, 0.0], (90, 1))])
        np.savez(tmp_path / "a.npz", qpos=np.hstack([parts["qpos"], box]), fps=60)
        names = ["box", "root", *breadth_first(g1)]
        index = [7 + file_order(g1).index(name) for name in names[2:]]
        np.savez(
            tmp_path / "b.npz", qpos=np.hstack([box, parts["qpos"][:, :7], parts["qpos"][:, index]]), fps=60, joint_names=names
        )
        for name, start in (("a.npz", 36), ("b.npz", 0)):
            found = Motion.read(tmp_path / name, robot=g1)
            assert agrees(found, steps), name
            told = f"columns {start} to {start + 6} of qpos are of an object, that moves over [0.59"
            assert any(told in note for note in found.notes)

    def test_shapes_and_names_that_do_not_fit(self, steps, parts, g1, tmp_path):
        """One axis is refused; names of another number are left aside."""
        np.savez(tmp_path / "a.npz", qpos=parts["qpos"][0], fps=60)
        with pytest.raises(InputError, match="qpos has shape .36,."):
            Motion.read(tmp_path / "a.npz", robot=g1)
        np.savez(tmp_path / "a.npz", qpos=parts["qpos"], fps=60, joint_names=["root", "left_knee_joint"])
        assert agrees(Motion.read(tmp_path / "a.npz", robot=g1), steps)

    def test_loco_mujoco(self, steps, parts, g1, tmp_path):
        """Names of joints, types, a frequency, and arrays of objects that hold nothing."""
        qvel = np.hstack([steps.v[:, :6], parts["vel"]])
        given = {"qpos": parts["qpos"].astype(np.float32), "qvel": qvel, "joint_names": ["root", *file_order(g1)]}
        given |= {"jnt_type": [0] + [3] * 29, "frequency": 60.0, "njnt": 30, "metadata": np.array(None, dtype=object)}
        given |= {"split_points": [0, 90]}
        np.savez(tmp_path / "a.npz", **given)
        found = Motion.read(tmp_path / "a.npz", robot=g1)
        assert agrees(found, steps, 1e-6) and any("not read: metadata" in note for note in found.notes)
        given["joint_names"] = ["root", *(f"x_{name}" for name in file_order(g1))]
        np.savez(tmp_path / "a.npz", **given)
        with pytest.raises(InputError, match="joint 'x_left_hip_pitch_joint' is none of g1"):
            Motion.read(tmp_path / "a.npz", robot=g1)


class TestWhatCannotBe:
    """Files of another robot, in other units, at other rates, with sides exchanged."""

    def test_left_and_right_exchanged(self, steps, parts, g1, tmp_path):
        """By limits: a roll of the hip that the other hip has not."""
        names = list(file_order(g1))
        other = [names.index(n.replace("left", "?").replace("right", "left").replace("?", "right")) for n in names]
        dof = parts["dof"].copy()
        dof[:, names.index("left_hip_roll_joint")] += 0.9
        dof[:, names.index("right_hip_roll_joint")] -= 0.9
        with pytest.raises(InputError, match="beyond its limits by .* they fit g1 in left and right exchanged"):
            Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"dof_pos": dof[:, other]}), robot=g1)
        assert Motion.read(tmp_path / "a.pkl", robot=g1, trust=True).n == 90

    def test_degrees_that_could_be_radians(self, steps, parts, g1, tmp_path):
        """Less than two turns as radians, but beyond all limits."""
        dof = np.degrees(0.15 * parts["dof"])
        with pytest.raises(InputError, match="they fit g1 in degrees, units='deg'"):
            Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"dof_pos": dof}), robot=g1)

    def test_a_base_in_millimetres_and_frames_as_times(self, parts, g1, tmp_path):
        """Asked about by the height of the base; frames that are counted need a rate."""
        with pytest.raises(InputError, match="Is its position in millimetres"):
            Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"root_pos": 1000.0 * parts["pos"]}), robot=g1)
        np.savez(tmp_path / "b.npz", qpos=parts["qpos"], time=np.arange(90.0))
        with pytest.raises(InputError, match="time counts frames, 0, 1, 2, ...; give rate=30"):
            Motion.read(tmp_path / "b.npz", robot=g1)
        assert Motion.read(tmp_path / "b.npz", robot=g1, rate=60).rate == pytest.approx(60.0)
        with ZipFile(tmp_path / "c.pt", "w") as archive:
            archive.writestr("archive/data.pkl", b"\x80\x02}.")
        with pytest.raises(InputError, match="is a file of PyTorch"):
            Motion.read(tmp_path / "c.pt", robot=g1)

    def test_sides_are_told_by_the_feet(self, steps, parts, g1, tmp_path):
        """One leg stands still and the other is lifted: exchanged, the standing one would slide. Of `q` and `t` as well."""
        t = np.arange(90) / 60.0
        q = np.tile(g1.standing().q, (90, 1))
        bend = 0.3 * np.sin(3.0 * t) ** 2
        for name, share in (("hip_pitch", -0.45), ("knee", 1.0), ("ankle_pitch", -0.55)):
            q[:, g1.joints[f"right_{name}_joint"].q.start] += share * bend  # lifted
        lean = -0.06 * np.sin(6.0 * t) ** 2  # the right hip rises
        q[:, 3:7] = exponential(np.stack([lean, 0.0 * t, 0.0 * t], axis=1))
        q[:, g1.joints["left_hip_roll_joint"].q.start] -= lean
        names = list(file_order(g1))
        data = g1.model.createData()
        for row in q:  # the left foot stays where it is
            pin.framesForwardKinematics(g1.model, data, row)
            row[:3] -= data.oMf[g1.frame_id("left_ankle_roll_link")].translation - [0.0, 0.1, 0.04]
        np.savez(tmp_path / "a.npz", q=q, t=t)
        assert not any("exchanged" in note for note in Motion.read(tmp_path / "a.npz", robot=g1).notes)
        other = [names.index(n.replace("left", "?").replace("right", "left").replace("?", "right")) for n in names]
        q[:, 7:] = q[:, 7:][:, other]
        np.savez(tmp_path / "a.npz", q=q, t=t)
        with pytest.raises(InputError, match="with left and right exchanged the lower foot moves"):
            Motion.read(tmp_path / "a.npz", robot=g1)
        rng, said = np.random.default_rng(0), []
        for size in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2):  # what shakes in both readings tells less
            np.savez(tmp_path / "a.npz", q=q + size * rng.normal(size=q.shape) * (np.arange(g1.nq) < 3), t=t)
            try:
                said.append(any("are they exchanged?" in note for note in Motion.read(tmp_path / "a.npz", robot=g1).notes))
            except InputError:
                said.append(None)
        assert said[0] is None and True in said and said[-1] is False, said

    def test_joints_beyond_limits(self, parts, g1, tmp_path):
        """A little is told; far, with no order that helps, is another robot's."""
        dof = parts["dof"].copy()
        dof[:, list(file_order(g1)).index("left_ankle_roll_joint")] += 0.5
        found = Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"dof_pos": dof}), robot=g1)
        assert any("joint 'left_ankle_roll_joint' is beyond its limits by 0.2" in note for note in found.notes)
        with pytest.raises(InputError, match="they look like those of another robot than g1"):
            Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"dof_pos": parts["dof"] * 0.0 + 7.0}), robot=g1)

    def test_another_order(self, steps, parts, g1, tmp_path):
        """Breadth-first, by limits."""
        dof = parts["dof"].copy()
        dof[:, list(file_order(g1)).index("left_knee_joint")] += 1.2
        index = [list(file_order(g1)).index(name) for name in breadth_first(g1)]
        with pytest.raises(InputError, match="they fit g1 in the order of breadth-first search"):
            Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"dof_pos": dof[:, index]}), robot=g1)

    def test_velocities_of_another_rate(self, steps, parts, g1, tmp_path):
        """Twice the rate of positions: named with the joint and the factor; half a frame late is no fault."""

        def written(v):
            return pickled(tmp_path / "a.pkl", gmr(parts) | {"dof_vel": v})

        found = Motion.read(written(parts["vel"]), robot=g1)
        assert any("velocities of joints in the file are the rates of q at 60 Hz" in note for note in found.notes)
        with pytest.raises(InputError, match=r"is (1\.8|2\.0)\d times the rate of its position"):
            Motion.read(written(2.0 * parts["vel"]), robot=g1)
        assert any("not used" in n for n in Motion.read(written(2.0 * parts["vel"]), robot=g1, trust=True).notes)

    def test_joints_of_another_robot(self, parts, g1, tmp_path):
        """Names that are all of another robot's: which one is said."""
        talos = rbd.load_robot("talos")
        with pytest.raises(
            InputError, match="joints that talos has not, 'left_hip_pitch_joint' first. These look like G1 with 29"
        ):
            Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"joint_names": list(file_order(g1))}), robot=talos)
        with pytest.raises(InputError, match="29 columns of joints; .*These look like G1 with 29"):
            Motion.read(pickled(tmp_path / "a.pkl", gmr(parts)), robot=talos)
        base = [f"root_{part}" for part in ("x", "y", "z", "qw", "qx", "qy", "qz")]
        for header in ("", ",".join([*base, *file_order(g1)])):
            np.savetxt(tmp_path / "a.csv", parts["qpos"], delimiter=",", header=header, comments="")
            with pytest.raises(InputError, match="These look like G1 with 29"):
                Motion.read(tmp_path / "a.csv", robot=talos, rate=60)

    def test_joints_in_a_muddle_are_no_degrees(self, steps, parts, g1, tmp_path):
        """Small angles are within limits in degrees whatever they are: so that is not proposed."""
        mixed = parts["dof"][:, np.random.default_rng(0).permutation(29)]
        for file in (pickled(tmp_path / "a.pkl", gmr(parts) | {"dof_pos": mixed}), tmp_path / "a.npz"):
            np.savez(tmp_path / "a.npz", qpos=np.hstack([parts["qpos"][:, :7], mixed]), frequency=60.0)
            try:
                told = " ".join(Motion.read(file, robot=g1).notes)
            except InputError as error:
                told = str(error)
            assert "beyond its limits" in told and "degrees" not in told

    def test_upside_down_in_either_order(self, steps, parts, g1, tmp_path):
        """Told; and a robot that hangs below the floor by its soles sinks."""
        turned = np.tile([0.0, 1.0, 0.0, 0.0], (len(parts["pos"]), 1))
        found = Motion.read(pickled(tmp_path / "a.pkl", gmr(parts) | {"root_rot": turned}), robot=g1)
        assert any(note.startswith("the base is upside down, in either order") for note in found.notes)
        assert rbd.check_motion(found, self_collision=False).of_cause("sinks").all()

    def test_one_frame_and_milliseconds(self, parts, g1, tmp_path):
        """Named by the file; times of 0.06 frames a second are no seconds."""
        one = gmr(parts) | {name: gmr(parts)[name][:1] for name in ("root_pos", "root_rot", "dof_pos")}
        with pytest.raises(InputError, match="a.pkl: one frame has no velocity; expected two frames"):
            Motion.read(pickled(tmp_path / "a.pkl", one), robot=g1)
        np.savez(tmp_path / "a.npz", qpos=parts["qpos"], t=np.arange(90) * 1e3 / 60.0)
        with pytest.raises(InputError, match="times in a.npz, if they are seconds, is 0.06; expected 1 to"):
            Motion.read(tmp_path / "a.npz", robot=g1)


class TestBodies:
    """Poses of bodies, as of holosoma: the free joint inside joint_pos, the world first, bodies that the robot has not."""

    def test_holosoma(self, steps, parts, g1, tmp_path):
        """The order of joints is proved by the links that the robot has; an object's arrays are told first."""
        steps.save(tmp_path / "a.npz", kind="beyondmimic")
        with np.load(tmp_path / "a.npz") as file:
            held = dict(file)
        held["joint_pos"] = np.hstack([parts["pos"], parts["wxyz"], parts["dof"]])
        held["joint_vel"] = np.hstack([np.zeros((90, 6)), parts["vel"]])
        held["joint_names"] = np.array(file_order(g1))
        far = np.tile([9.0, 9.0, 9.0], (90, 1))[:, None]
        held["body_pos_w"] = np.concatenate([0.0 * far, held["body_pos_w"], far], axis=1)
        one = np.tile([1.0, 0.0, 0.0, 0.0], (90, 1))[:, None]
        held["body_quat_w"] = np.concatenate([one, held["body_quat_w"], one], axis=1)
        held["body_names"] = np.array(["world", *held["body_names"], "largebox_link"])
        np.savez(tmp_path / "b.npz", **held, object_pos_w=far[:, 0], object_quat_w=one[:, 0])
        found = Motion.read(tmp_path / "b.npz", robot=g1)
        held["joint_pos"] += np.arange(36) < 1
        np.savez(tmp_path / "c.npz", **held)
        with pytest.raises(InputError, match="joint_pos begins with no body's place: the nearest is 0.94 m away"):
            Motion.read(tmp_path / "c.npz", robot=g1)
        with pytest.raises(InputError, match="panda has no floating base"):
            Motion.read(tmp_path / "c.npz", robot=rbd.load_robot("panda", root="fixed"))
        assert agrees(found, steps, 1e-9)
        assert any("bodies that g1 has no links for are not read: world, largebox_link" in note for note in found.notes)
        assert any("not read: object_pos_w (90, 3)" in n and "what it tells of an object is left out" in n for n in found.notes)


class TestWriting:
    """What other tools read is written, and read here again; contacts and forces stand beside it."""

    @pytest.mark.parametrize(
        "name", ["a.npz:beyondmimic", "a.npz:gmr", "a.pkl:gmr", "a.npz:mujoco", "a.npz:motion", "a.csv:motion"]
    )
    def test_each_kind_is_read_again(self, steps, g1, tmp_path, name):
        """To the last bit, or to the decimals of the table."""
        file, kind = name.split(":")
        steps.save(tmp_path / file, kind=kind)
        found = Motion.read(tmp_path / file, robot=g1)
        assert agrees(found, steps, 1e-12 if file != "a.csv" else 2e-6)
        assert any("rates of q at 60 Hz" in note for note in found.notes) == (kind in ("beyondmimic", "mujoco"))

    def test_bodies_and_velocities_are_those_of_kinematics(self, steps, g1, tmp_path):
        """Positions of GMR as seen from the base; velocities of bodies are the rates of their positions."""
        steps.save(tmp_path / "a.pkl", kind="gmr")
        held = pickle.loads((tmp_path / "a.pkl").read_bytes())
        k, frame = held["link_body_list"].index("left_knee_link"), g1.frame_id("left_knee_link")
        data = g1.model.createData()
        pin.framesForwardKinematics(g1.model, data, steps.q[40])
        assert np.abs(held["local_body_pos"][40, k] - data.oMi[1].actInv(data.oMf[frame].translation)).max() < 1e-12
        steps.save(tmp_path / "b.npz", kind="beyondmimic")
        with np.load(tmp_path / "b.npz") as file:
            rate = (file["body_pos_w"][41] - file["body_pos_w"][39]) * 30.0
            assert np.abs(rate - file["body_lin_vel_w"][40]).max() < 0.05
            assert file["body_quat_w"].shape == (90, 30, 4) and file["body_ang_vel_w"].shape == (90, 30, 3)
        steps.save(tmp_path / "c.npz", kind="mujoco")
        with np.load(tmp_path / "c.npz") as file:
            rate = (file["qpos"][41, :3] - file["qpos"][39, :3]) * 30.0
            assert np.abs(rate - file["qvel"][40, :3]).max() < 0.05

    @pytest.mark.parametrize("name", ["a.npz:motion", "a.npz:gmr", "a.pkl:gmr", "a.npz:beyondmimic", "a.npz:mujoco"])
    def test_contacts_and_forces_are_read_again(self, steps, g1, tmp_path, name):
        """Labels, slides and forces of each point, and the floor; told in the notes, and not read of a robot without them."""
        file, kind = name.split(":")
        report = rbd.check_motion(steps, ground="fit", self_collision=False)
        steps.with_contacts(report.lanes, report.forces).save(tmp_path / file, kind=kind)
        found = Motion.read(tmp_path / file, robot=g1)
        assert agrees(found, steps) and found.notes[-1].startswith("contacts and forces are those of the file, of left_sole, r")
        assert found.contacts.names == report.lanes.names and (found.forces == report.forces).all()
        for what in ("touches", "slides", "raised"):
            assert (getattr(found.contacts, what) == getattr(report.lanes, what)).all()
        assert found.ground == report.lanes.ground and found.ground_given and not found.forces.flags.writeable
        assert not any("not read" in note and "contact" in note for note in found.notes)
        if kind == "motion":
            again = rbd.check_motion(found, self_collision=False)
            assert (again.possible == report.possible).all() and "floor given" in str(again)
        cut, other = found.cut(0.2, 0.4), found.lifted(0.1)
        assert cut.forces.shape == cut.contacts.places.shape and other.forces is None and other.contacts is None
        toes = Motion.read(tmp_path / file, robot=rbd.load_robot("g1", feet=["left_ankle_roll_link"]))
        assert toes.contacts is None and "has no point 'left_sole 1'" in toes.notes[-1]

    def test_forces_need_contacts(self, steps, g1, tmp_path):
        """They are of points; a table of text holds neither; labels of another length are refused."""
        report = rbd.check_motion(steps, ground="fit", self_collision=False)
        with pytest.raises(InputError, match="forces act at contacts; expected both"):
            steps.with_contacts(None, report.forces)
        with pytest.raises(InputError, match="forces has shape"):
            steps.with_contacts(report.lanes, report.forces[1:])
        meant = steps.with_contacts(report.lanes, report.forces)
        meant.save(tmp_path / "a.csv")
        assert Motion.read(tmp_path / "a.csv", robot=g1).contacts is None
        for what, told in (("contact_labels", "89 rows"), ("contact_slides", "expected"), ("contact_forces", "expected")):
            meant.save(tmp_path / "a.npz", kind="gmr")
            with np.load(tmp_path / "a.npz") as file:
                held = dict(file)
            cut = [f"contact_{x}" for x in ("labels", "slides", "raised", "forces")] if what == "contact_labels" else [what]
            np.savez(tmp_path / "a.npz", **held | {name: held[name][1:] for name in cut})
            with pytest.raises(InputError, match=told):
                Motion.read(tmp_path / "a.npz", robot=g1)

    def test_a_floor_at_zero_is_told_from_none(self, steps, g1, tmp_path):
        """A motion 40 mm up: its floor is fitted, but not where z = 0 was given."""
        for ground, at in ((None, 0.04), (0.0, 0.0)):
            high = Motion.of_arrays(g1, steps.t, steps.q + 0.04 * np.eye(g1.nq)[2], ground=ground)
            high.save(tmp_path / "a.npz")
            steps.lifted(0.04).save(tmp_path / "a.csv", header=False)
            table = Motion.read(tmp_path / "a.csv", robot=g1, rate=60, ground=ground)
            for motion in (high, Motion.read(tmp_path / "a.npz"), table):
                assert motion.ground_given == (ground is not None)
                assert abs(rbd.motion.find_contacts(motion).ground - at) < 1e-3

    def test_what_a_kind_cannot_hold(self, steps, tmp_path):
        """Another ending, another kind, unequal times, no base: refused before a byte is written."""
        for match, kind, name in (
            ("a file of kind 'mujoco' ends in .npz", "mujoco", "a.pkl"),
            ("a file of kind 'gmr' ends in .pkl or .npz", "gmr", "a.csv"),
            ("kind is 'bodies'", "bodies", "a.npz"),
        ):
            with pytest.raises(InputError, match=match):
                steps.save(tmp_path / name, kind=kind)
        t = steps.t + 0.002 * np.sin(40.0 * steps.t)
        with pytest.raises(InputError, match="one rate for all frames"):
            Motion.of_arrays(steps.robot, t, steps.q).save(tmp_path / "a.npz", kind="gmr")
        arm = rbd.load_robot("panda", root="fixed")
        with pytest.raises(InputError, match="no floating base"):
            Motion.of_arrays(arm, steps.t, np.zeros((90, arm.nq))).save(tmp_path / "a.npz", kind="mujoco")
        assert not list(tmp_path.iterdir())


def test_broken_files_are_refused_or_read(steps, parts, g1, tmp_path):
    """Pickles, .npz and .npy with bytes changed, left out, doubled: an `InputError`, or a motion of this robot."""
    few = {name: x[:12] if isinstance(x, np.ndarray) else x for name, x in gmr(parts).items()}
    loco = {"qpos": parts["qpos"][:12], "fps": 60, "metadata": np.array(None, dtype=object), "split_points": [0, 6, 12]}
    seeds = [pickle.dumps(each, protocol) for protocol in (0, 2, 4, 5) for each in (few, {"walk": few}, loco)]
    for save in (lambda file: np.savez(file, **loco), lambda file: np.save(file, few)):
        save(held := io.BytesIO())
        seeds.append(held.getvalue())
    rng, read, path = np.random.default_rng(2), 0, tmp_path / "x.pkl"
    for i in range(500):
        data = bytearray(seeds[i % len(seeds)])
        at, n = int(rng.integers(len(data) if i % 2 else min(len(data), 400))), int(rng.integers(1, 12))
        new = [bytes(rng.integers(0, 256, 1, dtype=np.uint8)), b"", bytes(data[at : at + n]) * 2]
        data[at : at + (1 if i % 3 == 0 else n)] = new[i % 3]
        path.write_bytes(bytes(data))
        try:
            read += Motion.read(path, robot=g1).robot is g1
        except InputError as error:
            assert len(str(error)) < 2000
    assert 20 < read < 300


def test_headers_and_numbers_that_are_none(parts, g1, tmp_path):
    """A header of an .npy that is no Python, a text where bytes belong, numbers whose squares overflow."""
    np.save(tmp_path / "a.npy", parts["qpos"])
    data = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "b.npy").write_bytes(data.replace(b"'shape': (90, 36)", b"'shape': (((((((("))
    with pytest.raises(InputError, match="no .npy that can be read"):
        Motion.read(tmp_path / "b.npy", robot=g1)
    (tmp_path / "c.pkl").write_bytes(b"\x80\x02c_codecs\nencode\nK\x01X\x06\x00\x00\x00latin1\x86R.")
    with pytest.raises(InputError, match="no pickle that can be read"):
        Motion.read(tmp_path / "c.pkl", robot=g1)
    far = parts["pos"].copy()
    far[3, 1] = 1e200
    with pytest.raises(InputError, match=r"root_pos\[3, 1\] is 1e\+200"):
        Motion.read(pickled(tmp_path / "d.pkl", gmr(parts) | {"root_pos": far}), robot=g1)
