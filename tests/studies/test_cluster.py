"""A study on a cluster of dask: the dataset is that of one process, bit by bit, though a worker is killed on the way."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest
import studied

import rbd
from rbd.studies.evaluation import Evaluation
from rbd.studies.running import check_all

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")
pytestmark = [
    pytest.mark.long,
    pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed"),
    pytest.mark.filterwarnings("ignore:Port .* is already in use"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def client() -> Iterator[distributed.Client]:
    """Of a cluster with two processes on this machine."""
    quiet = {"logging.distributed": "critical", "distributed.comm.timeouts.connect": "30s"}
    with (
        dask.config.set(quiet),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as found,
    ):
        yield found


def test_a_killed_worker_changes_nothing(client, tmp_path):
    """Samples that fail, random numbers, a worker that is killed in the middle; values and reasons are equal."""

    def at(x: float, y: float, rng: np.random.Generator, mark: str) -> dict[str, float]:
        if (x, y) == (3.0, 0.75) and mark and not os.path.exists(mark):
            open(mark, "w").close()
            os.kill(os.getpid(), signal.SIGKILL)
        return studied.sums(x, y) | {"drawn": rng.standard_normal()}

    axes, mark = {"x": np.arange(25.0), "y": np.linspace(0.0, 1.0, 9)}, tmp_path / "killed"

    def run(mark: str, executor: object) -> object:
        def f(x: float, y: float, rng: np.random.Generator) -> dict[str, float]:
            return at(x, y, rng, mark)

        return rbd.study(f, rbd.grid(**axes), executor=executor, seed=5, chunk=4, progress=False)

    alone = run("", 0)
    pids = set(client.run(os.getpid).values())
    spread = run(str(mark), client.get_executor())
    assert mark.exists() and set(client.run(os.getpid).values()) != pids
    assert alone.drop_attrs().equals(spread.drop_attrs()) and not bool(alone.ok.all())
    assert all(alone[name].values.tobytes() == spread[name].values.tobytes() for name in ("sum", "product", "drawn"))


def test_workers_of_a_cluster_have_one_blas_thread(client):
    """Dask sets it for processes; its executor stays open; a client that is closed is refused before work."""
    with client.get_executor() as executor:
        found = rbd.study(studied.where, rbd.grid(x=np.arange(20.0)), executor=executor, progress=False)
        assert (found.threads == 1).all() and set(found.process.values.tolist()) <= set(client.run(os.getpid).values())
    with pytest.raises(rbd.InputError, match="takes no work"):
        check_all(Evaluation(studied.sums), executor, None)
