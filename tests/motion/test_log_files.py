"""Logs with joint states and a base: MCAP and rosbag2 as `rosbags` writes them; these tests need the extra `logs`."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.errors import InputError
from rbd.model.sampled_motion import exponential
from rbd.motion import Motion
from rbd.motion.file_conventions import breadth_first
from rbd.motion.file_frames import joint_values
from rbd.motion.log_files import is_log

START = 1_700_000_000.0


@pytest.fixture(scope="module")
def sway(g1) -> Motion:
    """G1 that sways and turns, 1 s at 100 Hz."""
    t = np.arange(101) / 100.0
    q = np.tile(g1.standing().q, (len(t), 1))
    q[:, :2] += 0.05 * np.stack([np.sin(3.0 * t), np.cos(2.0 * t)], axis=1)
    q[:, 3:7] = exponential(np.stack([0.05 * np.sin(3.0 * t), 0.0 * t, 0.4 * t], axis=1))
    q[:, 7:] += 0.1 * np.sin(4.0 * t)[:, None]
    return Motion.of_arrays(g1, t, q)


def written(
    path: Path,
    motion: Motion,
    *,
    mcap: bool = True,
    base: str = "odometry",
    factor: float = 1.0,
    states: int = 1,
    late: float = 0.0,
):
    """A log: joint states at 100 Hz in breadth-first order with a gripper beside them; poses of the base at 50 Hz."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    kind = {
        "odometry": "nav_msgs/msg/Odometry", "pose": "geometry_msgs/msg/PoseStamped", "tf": "tf2_msgs/msg/TFMessage"
    }.get(base)  # fmt: skip

    def header(t, frame="odom"):
        nano = round((START + t) * 1e9)
        return kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](nano // 10**9, nano % 10**9), frame)

    names = [name for name in breadth_first(motion.robot)]
    x = joint_values(motion.robot, motion.q, names)
    v = factor * motion.v[:, [motion.robot.joints[name].v.start for name in names]]
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as log:
        topics = [log.add_connection(f"/joint_states{i}", "sensor_msgs/msg/JointState", typestore=store) for i in range(states)]
        poses = kind and log.add_connection("/base", kind, typestore=store)
        for i, t in enumerate(motion.t):
            last = np.append(x[i], 0.01), np.append(v[i], 0.0)
            state = kinds["sensor_msgs/msg/JointState"](header(t, ""), [*names, "gripper"], *last, np.zeros(0))
            for connection in topics:
                log.write(connection, round((START + t) * 1e9), store.serialize_cdr(state, state.__msgtype__))
            if i % 2 or not kind:
                continue
            q = motion.q[i]
            point, turn = kinds["geometry_msgs/msg/Point"](*q[:3]), kinds["geometry_msgs/msg/Quaternion"](*q[3:7])
            pose = kinds["geometry_msgs/msg/Pose"](point, turn)
            if base == "odometry":
                zero = kinds["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
                twist = kinds["geometry_msgs/msg/TwistWithCovariance"](
                    kinds["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36)
                )
                message = kinds[kind](
                    header(t + late), "pelvis", kinds["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)), twist
                )
            elif base == "pose":
                message = kinds[kind](header(t + late), pose)
            else:
                place = kinds["geometry_msgs/msg/Transform"](kinds["geometry_msgs/msg/Vector3"](*q[:3]), turn)
                each = [
                    kinds["geometry_msgs/msg/TransformStamped"](header(t + late), name, place) for name in ("camera", "pelvis")
                ]
                message = kinds[kind](each)
            log.write(poses, round((START + t) * 1e9), store.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize("mcap", [True, False])
@pytest.mark.parametrize("base", ["odometry", "pose", "tf"])
def test_a_log_is_read(sway, g1, tmp_path, mcap, base):
    """Joints by name, the base between its poses; the folder, or the file in it."""
    folder = written(tmp_path / "log", sway, mcap=mcap, base=base)
    assert is_log(folder)
    for path in (folder, next(folder.glob("*.mcap" if mcap else "*.db3"))):
        found = Motion.read(path, robot=g1)
        assert found.n == sway.n and found.t[0] == 0.0 and found.rate == pytest.approx(100.0)
        assert np.abs(found.q[:, 7:] - sway.q[:, 7:]).max() < 1e-12 and np.abs(found.q[:, :7] - sway.q[:, :7]).max() < 1e-4
        assert any("joints that g1 has not are not read: gripper" in note for note in found.notes)
        assert any("'/base'" in note and "51 poses" in note for note in found.notes)
        assert any("velocities of joints in the file are the rates of q at 100 Hz" in note for note in found.notes)


def test_what_a_log_lacks_is_said(sway, g1, tmp_path):
    """No base, several topics, other velocities, another robot, no log, cut short."""

    def refused(match, path, **settings):
        with pytest.raises(InputError, match=match):
            Motion.read(path, **{"robot": g1, **settings})

    refused("has no pose of the base of g1, 'pelvis'", written(tmp_path / "a", sway, base="none"))
    two = written(tmp_path / "b", sway, states=2)
    refused("has joint states on '/joint_states0', '/joint_states1'; name one: motion=", two)
    assert Motion.read(two, robot=g1, motion="/joint_states1").n == sway.n
    refused("no joint states on '/joint_states2'", two, motion="/joint_states2")
    refused("is 2.00 times the rate of its position", written(tmp_path / "c", sway, factor=2.0))
    refused(
        "none of the joints of '/joint_states0' is of solo12", written(tmp_path / "d", sway), robot=rbd.load_robot("solo12")
    )
    refused("does not name its robot", tmp_path / "d", robot=None)
    later = sway.cut(0.0, 0.4)
    refused("has no joint states; expected", written(tmp_path / "e", later, states=0))
    refused("has poses at other times than the joint states", written(tmp_path / "f", later, late=5.0))
    whole = next((tmp_path / "d").glob("*.mcap"))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:5000])
    refused("no log that can be read", cut)
    cut.write_bytes(b"")
    refused("no log that can be read", cut)
    shutil.rmtree(tmp_path / "d")
    refused("no log that can be read", whole)


def test_damaged_logs_are_refused_or_read(sway, g1, tmp_path):
    """Bytes changed: no other error."""
    data = next(written(tmp_path / "log", sway).glob("*.mcap")).read_bytes()
    rng, path, read = np.random.default_rng(0), tmp_path / "bad.mcap", 0
    for _ in range(60):
        bad = bytearray(data)
        for at in rng.integers(0, len(bad), 3):
            bad[at] = rng.integers(256)
        path.write_bytes(bytes(bad))
        try:
            read += Motion.read(path, robot=g1).n > 0
        except InputError:
            pass
    assert read


def test_without_the_package_the_extra_is_named(g1, tmp_path, monkeypatch):
    """It says what to install."""
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    (tmp_path / "x.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(InputError, match=r"pip install 'rbd-contact\[logs\]'"):
        Motion.read(tmp_path / "x.mcap", robot=g1)
