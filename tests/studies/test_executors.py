"""The values of a study do not depend on where it is computed; nothing is lost when processes die, or by Ctrl-C."""

from __future__ import annotations

import io
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
import warnings
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import redirect_stderr
from functools import partial
from pathlib import Path

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
import studied

import rbd
from rbd.errors import Reason
from rbd.studies.evaluation import BATCH, Evaluation
from rbd.studies.processes import Chunks, sent_columns
from rbd.studies.results import Block, OutputSelection, joined
from rbd.studies.running import Filling, check_all, counted_interrupts
from rbd.studies.samples import Samples, grid
from rbd.studies.stores import Store
from rbd.workers import Workers

GRID = {"x": np.arange(12.0), "y": np.linspace(0.0, 1.0, 9)}


def fill(
    store: Store, evaluation: Evaluation, samples: Samples, executor: Executor | int | None, chunk: int | None = None
) -> Filling:
    """What a store lacks, computed."""
    check_all(evaluation, executor, chunk, samples)
    with counted_interrupts() as pressed:
        filling = Filling(store, evaluation, samples, pressed, chunk)
        filling.run(executor, progress=False)
        return filling


def filled(
    evaluation: Evaluation, samples: Samples, executor: Executor | int | None, chunk: int | None = None
) -> tuple[Store, Filling]:
    """A store in memory, filled."""
    store = Store(None, samples, {})
    return store, fill(store, evaluation, samples, executor, chunk)


def kept_of(store: Store) -> Block:
    """All that is kept."""
    return joined(np.arange(len(store.done)), store.blocks, store.layout.forms)


def messages_of(block: Block) -> dict[int, str]:
    """{number of the sample: message} where there is one."""
    return {i: text for i, text in enumerate(block.variables["message"].values.tolist()) if text}


def same(one: Store, other: Store) -> bool:
    """Whether all that is kept is equal, bit by bit."""
    a, b = kept_of(one), kept_of(other)
    return (
        messages_of(a) == messages_of(b)
        and sorted(a.variables) == sorted(b.variables)
        and all(
            np.array_equal(v.values, b.variables[n].values, equal_nan=v.values.dtype.kind == "f")
            for n, v in a.variables.items()
        )
    )


@pytest.mark.parametrize("function", [studied.sums, studied.drawn, lambda x, y: {"value": np.array([x, y])}])
def test_the_values_do_not_depend_on_executor_and_chunk(function, workers):
    """This process, two processes, threads; one sample at a time or all; with failures and random numbers."""
    axes = {"x": GRID["x"]} if function is studied.drawn else GRID
    evaluation = Evaluation(function, seed=3)
    first, _ = filled(evaluation, grid(**axes), 0)
    assert first.done.all()
    with ThreadPoolExecutor(3) as threads:
        for executor in (0, workers, threads):
            for chunk in (None, 1, 5, 1000):
                assert same(filled(evaluation, grid(**axes), executor, chunk=chunk)[0], first)
    other, _ = filled(Evaluation(function, seed=4), grid(**axes), 0)
    assert same(other, first) == (function is not studied.drawn)


def test_seeds_are_those_that_numpy_spawns():
    """Sample i has child i of the root."""
    found = kept_of(filled(Evaluation(studied.drawn, seed=11), grid(x=np.arange(6.0)), 0)[0])
    expected = [np.random.default_rng(s).standard_normal() for s in np.random.SeedSequence(11).spawn(6)]
    assert found.variables["value"].values.tolist() == (np.arange(6.0) + expected).tolist()


@pytest.mark.parametrize("function", [studied.sizes, studied.batch_drawn, studied.with_one_bad_sample])
def test_batches_are_the_same_whatever_the_chunk(function, workers):
    """512 samples from multiples of 512, the last ones fewer."""
    samples, evaluation = grid(x=np.arange(1300.0)), Evaluation(function, batched=True)
    first, _ = filled(evaluation, samples, 0)
    for executor in (0, workers):
        for chunk in (None, 1, 700, 5000):
            assert same(filled(evaluation, samples, executor, chunk=chunk)[0], first)
    kept = kept_of(first)
    if function is studied.sizes:
        assert np.array_equal(kept.variables["size"].values, np.repeat([BATCH, BATCH, 1300 - 2 * BATCH], [BATCH, BATCH, 276]))
    if function is studied.with_one_bad_sample:  # only the second batch is computed one by one, from what was given
        assert np.array_equal(np.flatnonzero(~kept.ok), [700]) and messages_of(kept) == {700: "ValueError: no number of mine"}
        assert np.array_equal(kept.variables["above"].values[kept.ok], np.arange(1300)[kept.ok] + 0.5)
        sizes = kept.variables["size"].values[[0, 511, 512, 1023, 1024]].tolist()
        assert sizes == [BATCH, BATCH, 1, 1, 276]


@pytest.mark.parametrize(
    ("function", "told"),
    [
        (studied.only_whole_batches, "IndexError: x has no second entry"),
        (studied.without_short_axes, "sample 600: 'value' has shape () for 1 sample"),
    ],
)
def test_a_batch_that_raises_and_whose_samples_cannot_be_computed_alone_is_told_with_its_samples(function, told):
    """What the batch raised stands behind what the samples do; the study goes on."""
    samples, evaluation = grid(x=np.arange(1300.0)), Evaluation(function, batched=True)
    kept = kept_of(filled(evaluation, samples, 0)[0])
    assert np.array_equal(kept.ok, np.arange(1300) // BATCH != 1)
    assert messages_of(kept)[600].startswith(told)
    assert messages_of(kept)[600].endswith("(samples 512 to 1023 in one call: ValueError: no batch of mine)")


def test_a_function_of_keep_that_raises_for_one_sample_of_a_batch_loses_no_others():
    """The same as of the function itself; its warnings are counted once a sample."""

    def square(x: np.ndarray) -> np.ndarray:
        if (x == 3).any():
            warnings.warn("three", UserWarning, stacklevel=2)
        return x * x

    def root(y: np.ndarray) -> np.ndarray:
        if (y == 9).any():
            raise rbd.InputError("y is 9.")
        return np.sqrt(y)

    store, told = filled(Evaluation(square, keep=OutputSelection({"root": root}), batched=True), grid(x=np.arange(20.0)), 0)
    assert messages_of(kept_of(store)) == {3: "y is 9."} and [first for _, first, _ in told.warned.found.values()] == [0]


def test_an_exit_in_a_sample_is_a_row(workers):
    """Of `sys.exit`, in this process and others, as any other exception."""
    for executor in (0, workers):
        store, _ = filled(Evaluation(studied.ends_at_three), grid(x=np.arange(6.0)), executor)
        assert store.done.all() and messages_of(kept_of(store)) == {3: "SystemExit: no case of mine"}


def test_an_unfinished_store_is_filled_batch_by_batch():
    """What is left of a batch is computed with the whole batch, and counted once."""
    samples, evaluation = grid(x=np.arange(1300.0)), Evaluation(studied.sizes, batched=True)
    first, _ = filled(evaluation, samples, 0)
    store = Store(None, samples, {})
    store.put(evaluation.run(0, samples.columns(0, BATCH)).block)
    store.done[100:] = False
    fill(store, evaluation, samples, 0)
    assert same(store, first) and store.done.all()


def test_processes_have_one_blas_thread_and_stay(workers):
    """Of two studies, in at most two processes, which are not this one; its environment is as it was."""
    before = dict(os.environ)
    found = [kept_of(filled(Evaluation(studied.where), grid(x=np.arange(40.0)), workers, chunk=4)[0]) for _ in range(2)]
    processes = {p for kept in found for p in kept.variables["process"].values.tolist()}
    assert len(processes) <= 2 and os.getpid() not in processes
    assert all((kept.variables["threads"].values == 1).all() for kept in found)
    assert found[1].variables["calls"].values.max() > found[0].variables["calls"].values.max()  # its modules stay loaded
    assert dict(os.environ) == before


def test_a_killed_process_is_replaced(workers, tmp_path):
    """What it computed is computed again; its chunk is not lost, nor others."""
    function = partial(studied.killed_once, mark=str(tmp_path / "killed"))
    store, _ = filled(Evaluation(function), grid(x=np.arange(30.0)), workers)
    assert (tmp_path / "killed").exists()
    assert np.array_equal(kept_of(store).variables["value"].values, np.arange(30.0))


@pytest.mark.parametrize("chunk", [None, 4, 30])
def test_a_sample_that_kills_its_processes_costs_itself_only(workers, chunk):
    """After two processes it is a row that says so; all others have their results."""
    store, _ = filled(Evaluation(studied.killed_at_seven), grid(x=np.arange(30.0)), workers, chunk)
    kept = kept_of(store)
    assert np.array_equal(np.flatnonzero(~kept.ok), [7]) and kept.variables["reason"].values[7] == Reason.OTHER_ERROR.code
    assert "ProcessDied: was ended by signal 9 (SIGKILL), as the system does where memory runs out" in messages_of(kept)[7]
    assert np.array_equal(np.delete(kept.variables["value"].values, 7), np.delete(np.arange(30.0), 7))


def test_a_function_of_which_every_process_dies_ends_the_study():
    """After ten samples, with what is done."""
    with pytest.raises(rbd.errors.StudyStopped, match="10 samples, or batches, have ended their processes") as caught:
        rbd.study(studied.killed, grid(x=np.arange(30.0)), executor=2, chunk=1, progress=False)
    assert 0 < (caught.value.dataset.reason == Reason.OTHER_ERROR.code).sum() < 10


def test_another_executor_that_breaks_ends_the_study():
    """It cannot be repaired here: what is done is kept; the next call refuses it before work."""
    samples = grid(x=np.arange(30.0))
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        with pytest.raises(rbd.errors.StudyStopped, match="the executor computes no more, as it broke") as caught:
            rbd.study(studied.killed_at_seven, samples, executor=pool, chunk=1, progress=False)
        assert caught.value.__cause__ is not None and caught.value.dataset.ok.sum() < 30
        with pytest.raises(rbd.InputError, match="takes no work"):
            check_all(Evaluation(studied.sums), pool, None)


@pytest.mark.parametrize("given", [-1, True, 2.5, "two", 10**9, multiprocessing])
def test_what_is_no_executor_is_refused(given):
    """Before work, with what was expected."""
    told = "executor is 1000000000; expected at most 1,024 processes" if given == 10**9 else "executor is .*; expected None"
    with pytest.raises(rbd.InputError, match=told):
        check_all(Evaluation(studied.sums), given, None)


@pytest.mark.parametrize("name", ["batched", "progress"])
def test_flags_are_true_or_false(name):
    """No words."""
    with pytest.raises(rbd.InputError, match=f"{name} is 'no'; expected True or False"):
        rbd.study(studied.warned, grid(x=[1.0]), executor=0, **{name: "no"})


def test_warnings_that_are_errors_lose_no_study():
    """The filters of Python make an error of the warning at the end: it has the dataset."""
    with (
        warnings.catch_warnings(),
        pytest.raises(rbd.errors.StudyStopped, match="a warning is an error here.*x is 3") as caught,
    ):
        warnings.simplefilter("error")
        rbd.study(studied.warned, grid(x=[1.0, 3.0]), executor=0)
    assert caught.value.dataset.value.values.tolist() == [1.0, 3.0] and isinstance(caught.value.__cause__, RuntimeWarning)


def test_what_numpy_does_about_a_division_by_zero_does_not_depend_on_the_process(workers):
    """Neither what the caller has set counts, nor what a process has."""
    with np.errstate(all="raise"):
        for executor in (0, workers):
            store, told = filled(Evaluation(studied.inverse), grid(x=[0.0, 2.0]), executor)
            assert kept_of(store).variables["value"].values.tolist() == [np.inf, 0.5]
            assert [name for _, name in told.warned.found] == ["RuntimeWarning"]


def test_one_sample_is_no_samples():
    """In the summary."""
    assert rbd.study(studied.warned, grid(x=[1.0]), executor=0).attrs["summary"] == "1 sample: 1 ok"


def test_executors_that_are_shut_down_are_refused():
    """Those of this package and others; and a client of dask that is given in place of its executor."""
    pool, own = ThreadPoolExecutor(1), Workers(1)
    for executor in (pool, own):
        executor.shutdown()
        with pytest.raises(rbd.InputError, match="takes no work: cannot schedule new futures after shutdown"):
            check_all(Evaluation(studied.sums), executor, None)

    class Client:
        """Looks like one."""

        def get_executor(self) -> None:
            """As a client of dask."""

    with pytest.raises(rbd.InputError, match="executor=client.get_executor"):
        check_all(Evaluation(studied.sums), Client(), None)  # type: ignore[arg-type]


@pytest.mark.parametrize("chunk", [0, -1, 1.5, True, "all"])
def test_bad_chunks_are_refused(chunk):
    """A number of samples from 1."""
    with pytest.raises(rbd.InputError, match="chunk is .*; expected a whole number"):
        check_all(Evaluation(studied.sums), 0, chunk)


LOCK = threading.Lock()


def test_what_cannot_be_sent_is_named(tmp_path):
    """Locks, open files, generators: where they are, and what to do; this process needs none of that."""
    file, drawing = (tmp_path / "log").open("w"), (i for i in range(3))

    def writes(x: float) -> float:
        file.write("x")
        return x

    read, told = (tmp_path / "log").open(), io.TextIOWrapper(io.BytesIO(b"1"))

    def reads(x: float) -> float:
        return read.fileno() + x

    def says(x: float) -> float:
        return float(told.read()) + x

    class Box:
        def __init__(self) -> None:
            self.parts = {"next": drawing}

        def value(self, x: float) -> float:
            return x

    cases = [
        (writes, r"file is a _io.TextIOWrapper, which only this process has"),
        (reads, r"read is a _io.TextIOWrapper"),
        (says, r"told is a _io.TextIOWrapper"),
        (partial(studied.killed_once, mark=LOCK), r"mark.* is a _thread.lock"),
        (Box().value, r"drawing is a builtins.generator"),
    ]
    for function, words in cases:
        with pytest.raises(rbd.InputError, match=words) as caught:
            check_all(Evaluation(function), 2, None)
        assert "cannot be sent to other processes" in str(caught.value) and "executor=0" in str(caught.value)
        check_all(Evaluation(function), 0, None)
    with pytest.raises(rbd.InputError, match="keep|file"):
        check_all(Evaluation(studied.sums, keep=OutputSelection({"wrote": writes})), 2, None)
    file.close()
    read.close()


def test_samples_go_as_functions_do(workers):
    """Functions without a name, and objects of local classes; what cannot is named."""

    class Scaled:
        def __init__(self, by: float) -> None:
            self.by = by

        def __call__(self, x: float) -> float:
            return self.by * x

    samples = grid(law={"double": lambda x: 2.0 * x, "half": Scaled(0.5)}, x=[1.0, 2.0])
    found = rbd.study(studied.applied, samples, executor=workers)
    assert found.value.values.tolist() == [[2.0, 4.0], [0.5, 1.0]] and found.ok.values.all()
    with pytest.raises(rbd.InputError, match=r"samples: law.* is a _thread.lock, .*executor=0 computes in this process"):
        sent_columns({"law": ["b", LOCK]})
    assert sent_columns(texts := {"law": ["b", "c"], "x": np.ones(2)}) is texts


def test_without_cloudpickle_a_study_computes_in_this_process(monkeypatch):
    """Processes need it; what installs it is said."""
    monkeypatch.setitem(sys.modules, "cloudpickle", None)
    check_all(Evaluation(studied.sums), 0, None)
    with pytest.raises(rbd.InputError, match=r"rbd-contact\[study\]"):
        check_all(Evaluation(studied.sums), 2, None)
    with ThreadPoolExecutor(1) as threads:
        check_all(Evaluation(studied.sums), threads, None)


def test_modules_that_processes_lack_are_named(workers, tmp_path, monkeypatch):
    """The processes were started before its folder was on the path."""
    filled(Evaluation(studied.drawn), grid(x=[1.0, 2.0]), workers)
    (tmp_path / "far_away.py").write_text("def f(x):\n    return x\n")
    monkeypatch.syspath_prepend(tmp_path)
    import far_away

    with pytest.raises(
        rbd.InputError, match="cannot load the function: ModuleNotFoundError: No module named 'far_away'.*PYTHON"
    ):
        filled(Evaluation(far_away.f), grid(x=[1.0, 2.0]), workers)


@pytest.mark.parametrize("options", [[], ["-W", "always"]])
def test_processes_do_not_repeat_what_the_script_warned_of(options, tmp_path):
    """Each imports the script, and with it loads its robots; only the first process tells what is wrong with files."""
    (tmp_path / "loads.py").write_text(
        "import warnings, rbd\n"
        "warnings.warn('inertia of a file', rbd.errors.ModelWarning)\n"
        "def twice(x):\n"
        "    warnings.warn('odd')\n"
        "    return 2 * x\n"
        "if __name__ == '__main__':\n"
        "    rbd.study(twice, rbd.grid(x=[1.0, 2.0, 3.0]), executor=2, chunk=1, progress=False)\n"
    )
    call = [sys.executable, *options, "loads.py"]
    told = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=True).stderr
    assert told.count("ModelWarning: inertia of a file") == 1
    assert told.count("UserWarning: odd [3 of 3 calls warn so") == 1


def test_warnings_are_told_once_a_kind(workers):
    """With their numbers and the first sample, wherever computed; filters that make errors of them change no row."""
    samples, evaluation = grid(x=np.arange(20.0)), Evaluation(studied.warned)
    texts = []
    for executor in (0, workers):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            store, told = filled(evaluation, samples, executor)
        assert kept_of(store).ok.all()
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            told.warn()
        texts.append([(w.category, str(w.message)) for w in seen])
    assert (
        texts[0]
        == texts[1]
        == [
            (RuntimeWarning, "x is 3 [17 of 20 calls warn so, the first of them sample 3]"),
            (UserWarning, "five [sample 5]"),
        ]
    )


@hypothesis.given(
    st.lists(st.booleans(), max_size=60), st.one_of(st.none(), st.integers(1, 70)), st.booleans(), st.floats(1e-6, 10.0)
)
@hypothesis.settings(deadline=None, max_examples=60)
def test_chunks_cover_what_is_left(done: list[bool], size: int | None, batched: bool, pace: float):
    """Each sample that is not done is in one chunk; a batched function gets whole batches."""
    some = np.repeat(done, 100).astype(bool)
    chunks, counts = Chunks(some, size, batched=batched, shares=4), np.zeros(len(some), int)
    unit = BATCH if batched else 1
    before = 0
    while (chunk := chunks.take()) is not None:
        start, stop = chunk
        assert before <= start < stop <= len(some) and start % unit == 0 and (stop % unit == 0 or stop == len(some))
        counts[start:stop] += 1
        chunks.learn(stop - start, pace * (stop - start))
        before = stop
    assert (counts[~some] == 1).all() and (batched or not counts[some].any()) and counts.max(initial=0) <= 1


def test_chunks_take_about_a_second():
    """They grow from one sample, and become small near the end."""
    chunks, sizes = Chunks(np.zeros(200_000, bool), None, batched=False, shares=6), []
    while (chunk := chunks.take()) is not None:
        sizes.append(chunk[1] - chunk[0])
        chunks.learn(sizes[-1], 1e-4 * sizes[-1])
    assert sizes[0] == 1 and max(sizes) == 10_000 and sizes[-2] <= 1000 and len(sizes) < 80
    slow = Chunks(np.zeros(50, bool), None, batched=False)
    slow.learn(1, 10.0)
    assert slow.take() == (0, 1)


def script(tmp_path: Path, text: str) -> Path:
    """A script of these lines."""
    path = tmp_path / "script.py"
    path.write_text("import os, sys, time, numpy as np, rbd\n" + textwrap.dedent(text), encoding="utf-8")
    return path


def ends(group: int) -> bool:
    """Whether no process of a group is left, after a while."""
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


def test_a_script_without_a_guard_is_told_so(tmp_path):
    """One message in place of a page of tracebacks from each process."""
    path = script(tmp_path, "def f(x):\n    return x\nrbd.study(f, rbd.grid(x=[1.0, 2.0]), executor=1)\n")
    done = subprocess.run([sys.executable, path], capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr.count("Traceback") == 1
    assert "InputError: the study is started again" in done.stderr and 'if __name__ == "__main__":' in done.stderr


def test_functions_of_a_command_line_work():
    """They have no file that other processes could import."""
    text = "import rbd; k = 3.0; print(rbd.study(lambda x: k * x, rbd.grid(x=[1.0, 2.0]), executor=1).value.values)"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("[3. 6.]\n", "")


SLOW = """
def f(x):
    time.sleep(0.02)
    if x == 0.0:
        print("begun", flush=True)
    return x

if __name__ == "__main__":
    found = rbd.study(f, rbd.grid(x=np.arange(5000.0)), executor={executor}, chunk={chunk})
    ok = found.ok.values
    print(int(ok.sum()), found.reason.values[~ok].min(), found.value.values[ok].max(), found.attrs["interrupted"])
"""


@pytest.mark.parametrize(("executor", "chunk"), [(0, None), (1, 4000)])
def test_ctrl_c_returns_what_is_done(tmp_path, executor, chunk):
    """At once, with one warning, and no process is left; of chunks that never end, too."""
    path = script(tmp_path, SLOW.format(executor=executor, chunk=chunk))
    with subprocess.Popen(
        [sys.executable, path], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0
    ) as run:
        assert run.stdout is not None and run.stderr is not None and run.stdout.readline() == "begun\n"
        time.sleep(0.5)
        began = time.monotonic()
        os.killpg(run.pid, signal.SIGINT)  # as a terminal does: to all of them
        if chunk == 4000:
            said, told = "", run.stderr.read()
            assert "AttributeError" in told  # nothing is done: the dataset has no variable
        else:
            said, told = run.communicate()
            done, reason, *_, interrupted = said.split(maxsplit=3)
            assert 0 < int(done) < 5000 and int(reason) == 99
            assert interrupted == f"{int(done):,} of 5,000 samples are done\n"
        assert told.count("StudyWarning: Ctrl-C after") == 1 and "KeyboardInterrupt" not in told
        assert time.monotonic() - began < 5.0
    assert ends(run.pid)


def test_processes_end_with_the_one_that_started_them(tmp_path):
    """Even if that is killed."""
    path = script(tmp_path, SLOW.format(executor=1, chunk=10))
    with subprocess.Popen([sys.executable, path], stdout=subprocess.PIPE, text=True, process_group=0) as run:
        assert run.stdout is not None and run.stdout.readline() == "begun\n"
        run.kill()
        run.wait()
    assert ends(run.pid)


def test_a_function_that_swallows_ctrl_c_does_not_keep_its_result():
    """As `rbd.simulate` does, which returns what it has: the sample is not done."""

    def swallows(x: float) -> float:
        try:
            if x == 3.0:
                signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            return -1.0
        return x

    store, told = filled(Evaluation(swallows), grid(x=np.arange(10.0)), 0, chunk=1)
    assert told.interrupted == "Ctrl-C after 3 of 10 samples" and store.done.sum() == 3
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with pytest.warns(rbd.errors.StudyWarning, match="3 of 10 samples"):
        told.warn()


@pytest.mark.parametrize("when", ["before", "after"])
def test_ctrl_c_while_a_block_is_stored_loses_nothing(when):
    """What is stored then is there, or is computed again; who presses it twice wants the end."""

    class Slow(Store):
        presses = 1

        def put(self, block):
            if when == "after":
                super().put(block)
            for _ in range(self.presses):
                signal.raise_signal(signal.SIGINT)
            super().put(block)

    store = Slow(None, grid(x=np.arange(5.0)), {})
    told = fill(store, Evaluation(studied.warned), grid(x=np.arange(5.0)), 0, 2)
    assert store.done.sum() == (2 if when == "after" else 0) and told.interrupted
    store.presses = 0
    fill(store, Evaluation(studied.warned), grid(x=np.arange(5.0)), 0, 2)
    assert kept_of(store).variables["value"].values.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


class Terminal(io.StringIO):
    """A stderr that says it is a terminal."""

    def isatty(self) -> bool:
        """It is."""
        return True


def test_progress_is_drawn_on_a_terminal(monkeypatch):
    """On stderr, from a second on, with the share of the samples that are done; the cursor is given back."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    with redirect_stderr(Terminal()) as screen:
        rbd.study(studied.warned, grid(x=[0.0]), executor=0)
        assert screen.getvalue() == ""
        rbd.study(lambda x: time.sleep(0.6) or x, grid(x=np.arange(3.0)), executor=0, chunk=1)
    assert "67 %" in screen.getvalue() and "100 %" in screen.getvalue()  # two of three samples, and all
    assert "studying" in screen.getvalue() and screen.getvalue().count("\x1b[?25h") == 1
