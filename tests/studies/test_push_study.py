"""Talos pushed to its left: serial, in processes, on a cluster that loses a worker, and resumed, it is one dataset."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import distributed
import numpy as np
import pushed
import pytest
import xarray

import rbd


def plain(attributes: dict) -> dict:
    """Attributes without arrays, so that they can be compared."""
    return {name: np.asarray(value).tolist() for name, value in attributes.items()}


def assert_same_bits(one: xarray.Dataset, other: xarray.Dataset) -> None:
    """Values and coordinates of two datasets are the same, bit for bit; attributes of variables too."""
    assert list(one.variables) == list(other.variables)
    for name in one.variables:
        a, b = one[name], other[name]
        assert a.dims == b.dims and a.dtype == b.dtype and plain(a.attrs) == plain(b.attrs), name
        same = a.values.tolist() == b.values.tolist() if a.dtype.kind in "OUT" else a.values.tobytes() == b.values.tobytes()
        assert same, name


@pytest.fixture(scope="module")
def serial() -> xarray.Dataset:
    """The study in this process."""
    return pushed.run()


def test_the_verdict_changes_where_push_limits_says(serial):
    """Every push up to the limit is held and none above: the limit lies in the cell where the verdict changes."""
    assert serial.ok.dims == ("friction", "push_y")
    for friction in serial.friction.values:
        soles = pushed.state().robot.soles(friction=friction)
        limit = rbd.statics.push_limits(pushed.state(), soles, pushed.FRAME, (0.0, 1.0, 0.0)).forces[0]
        ok = serial.ok.sel(friction=friction)
        assert 0.0 < limit < 200.0
        assert ok.values.tolist() == (serial.push_y.values <= limit).tolist()


def test_each_refusal_has_its_reason(serial):
    """Rows without torques say why, in a code and in words; the others have their certificate."""
    refused = ~serial.ok.values
    assert 10 < refused.sum() < 50
    codes = set(serial.reason.values[refused].tolist())
    assert {rbd.errors.Reason.of_code(code).value.split(":")[0] for code in codes} == {"cannot_hold"}
    assert len(codes) > 1  # friction at low coefficients, the edges of the soles at high ones
    assert all("talos cannot be held" in text for text in serial.message.values[refused])
    assert (serial.worst_residual.values[~refused] < 1e-9).all() and np.isnan(serial.worst_residual.values[refused]).all()


def test_two_processes(serial, workers):
    """Chunks in two processes give the same bits."""
    assert_same_bits(serial, pushed.run(executor=workers))


def test_a_cluster_that_loses_a_worker(serial):
    """A dask cluster of two workers, one of them killed on the way, gives the same bits."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            left: list[int] = []
            killing = threading.Thread(target=kill_one, args=(cluster, client, left))
            killing.start()
            found = pushed.run(executor=client.get_executor())
            killing.join()
    assert left and left[0] > 0  # chunks were not finished when the worker died
    assert_same_bits(serial, found)


def test_resumed_after_ctrl_c(serial, tmp_path):
    """Ctrl-C in the middle loses what was under way; the same call goes on, and gives the same bits."""
    out = tmp_path / "push.zarr"
    code = "import sys, pushed; pushed.run(sys.argv[1])"
    folder, slowly = Path(pushed.__file__).parent, os.environ | {"PAUSE": "0.1"}
    process = subprocess.Popen([sys.executable, "-c", code, str(out)], cwd=folder, env=slowly)
    begin = time.monotonic()
    while time.monotonic() - begin < 60.0 and process.poll() is None:
        if done_of(out):
            break
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    process.wait(timeout=60.0)
    first = done_of(out)
    assert 0 < first < len(pushed.SAMPLES)
    assert_same_bits(serial, pushed.run(out))
    assert_same_bits(serial, rbd.studies.open_study(out))


def kill_one(cluster: distributed.LocalCluster, client: distributed.Client, left: list[int]) -> None:
    """Kill one of the cluster's processes while it works; notes how many of its chunks were not finished."""
    end = time.monotonic() + 30.0
    while time.monotonic() < end and not any(client.processing().values()):
        time.sleep(0.01)
    time.sleep(0.2)
    worker = next(iter(cluster.workers.values()))
    left.append(len(client.processing()[worker.worker_address]))
    os.kill(worker.pid, signal.SIGKILL)


def done_of(out: Path) -> int:
    """How many samples a store has."""
    try:
        found = rbd.studies.open_study(out)
    except rbd.InputError:  # not there yet
        return 0
    return int((found.reason != rbd.errors.Reason.NOT_RUN.code).sum())
