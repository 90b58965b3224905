"""The log of a controller: written and read to the last bit, as a dataset, and what no log is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.control import ControlLog, Walk
from rbd.errors import InputError

ARRAYS = ("t", "residual", "violation", "tau", "torque_use", "torque_share")
TABLES = ("missed", "planned", "touching", "assumed")


@pytest.fixture(scope="module")
def walked() -> tuple[Walk, rbd.Trajectory]:
    """Solo12 with its first pair of feet in the air, and down again."""
    walk = Walk(rbd.load_robot("solo12"), 1, gait="trot")
    duration = walk.plan.footsteps[0].end + 0.1
    run = rbd.simulate(walk.state, walk.contacts, duration=duration, step=2e-3, controller=walk, progress=False)
    return walk, run


def test_a_log_has_the_torques_and_their_share_of_the_limits(walked: tuple[Walk, rbd.Trajectory]) -> None:
    """Those that the simulation recorded at the beginning of each step; over the limits of the robot's file."""
    walk, run = walked
    log = walk.log
    assert log.motors == walk.robot.actuated_names
    assert np.array_equal(log.tau, run.tau[: len(log)]) and len(log) >= len(run) - 1
    assert log.torque_use == pytest.approx(np.abs(log.tau) / walk.robot.effort_limit)
    assert np.array_equal(log.torque_share, log.torque_use.max(axis=1)) and 0.0 < log.torque_share.max() < 1.0


def test_a_log_is_written_and_read_to_the_last_bit(walked: tuple[Walk, rbd.Trajectory], tmp_path: Path) -> None:
    """All arrays, what differed and when first, and so what it prints."""
    log = walked[0].log
    log.save(tmp_path / "walk.npz")
    read = ControlLog.load(tmp_path / "walk.npz")
    for name in ARRAYS:
        assert np.array_equal(getattr(read, name), getattr(log, name)), name
    for name in TABLES:
        own, other = getattr(log, name), getattr(read, name)
        assert list(own) == list(other) and own
        assert all(np.array_equal(own[key], other[key], equal_nan=True) for key in own), name
    assert (read.first, read.disagreements, read.motors, str(read)) == (log.first, log.disagreements, log.motors, str(log))


def test_an_empty_log_too(tmp_path: Path) -> None:
    """Without a step of control; but there is nothing to draw."""
    log = Walk(rbd.load_robot("solo12"), 1, gait="trot").log
    log.save(tmp_path / "none.npz")
    read = ControlLog.load(tmp_path / "none.npz")
    assert len(read) == 0 and str(read) == "no step of control yet" and list(read.missed) == list(log.missed)
    assert read.torque_share.shape == (0,) and read.to_xarray().sizes["time"] == 0
    with pytest.raises(InputError, match="log has no step of control yet"):
        log.plot()


def test_a_log_is_a_dataset(walked: tuple[Walk, rbd.Trajectory]) -> None:
    """Over time, by names of motors, tasks and contacts, with units."""
    log = walked[0].log
    data = log.to_xarray()
    assert dict(data.sizes) == {"time": len(log), "motor": 12, "task": 8, "contact": 4, "difference": len(log.first)}
    assert data.tau.attrs["units"] == "N or N m" and data.time.attrs["units"] == "s"
    motor = log.motors[int(log.torque_use.max(axis=0).argmax())]
    assert data.torque_use.max("time").idxmax().item() == motor
    assert np.array_equal(data.planned.sel(contact="front_left"), log.planned["front_left"])
    for (contact, kind), count in {(c, k): n for c, kinds in log.disagreements.items() for k, n in kinds.items()}.items():
        assert int(data.different.sel(difference=f"{contact}: {kind}").sum()) == count


def test_what_is_no_log_is_refused(walked: tuple[Walk, rbd.Trajectory], tmp_path: Path) -> None:
    """Other suffixes and files, trajectories, what was changed or cut short."""
    walk, run = walked
    path = tmp_path / "walk.npz"
    walk.log.save(path)
    with pytest.raises(InputError, match=r"expected one that ends in \.npz"):
        walk.log.save(tmp_path / "walk.nc")
    run[:3].save(tmp_path / "run.npz")
    with pytest.raises(InputError, match=r"run\.npz is no control log, or an incomplete one"):
        ControlLog.load(tmp_path / "run.npz")
    with pytest.raises(InputError, match="is no trajectory, or an incomplete one"):
        rbd.Trajectory.load(path)
    with np.load(path) as found:
        arrays = dict(found)
    np.savez(path, **arrays | {"tau": arrays["tau"] + 1.0})
    with pytest.raises(InputError, match="its checksum differs"):
        ControlLog.load(path)
    np.savez(path, **{name: x for name, x in arrays.items() if name != "tau"})
    with pytest.raises(InputError, match="its checksum differs"):
        ControlLog.load(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="no control log, or an incomplete one"):
        ControlLog.load(path)
