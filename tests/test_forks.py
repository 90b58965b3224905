"""A process that is forked while threads compute can compute too, and leaves its parent's files alone."""

from __future__ import annotations

import ast
import multiprocessing
import os
import runpy
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import rbd
import rbd.model.data_pool
from rbd.model.output_files import new_folder
from rbd.visual import Scene

SECONDS = 20.0
"""A child that has not ended by then hangs."""
FORKS = 12
LOCKS = {f"threading.{kind}" for kind in ("Lock", "RLock", "Condition", "Semaphore", "BoundedSemaphore", "Barrier", "Event")}

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork on this system")


def forked(work: Callable[[], object]) -> int | None:
    """Exit code of a child that does some work and ends; None if it had to be stopped."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of threads beside a fork: that is the test
        child = multiprocessing.get_context("fork").Process(target=work)
        child.start()
    child.join(SECONDS)
    if child.is_alive():
        child.kill()
        child.join()
        return None
    return child.exitcode


@contextmanager
def beside(*works: Callable[[], object]) -> Iterator[None]:
    """Threads that repeat some work until the block ends."""
    end = threading.Event()

    def repeat(work: Callable[[], object]) -> None:
        while not end.is_set():
            work()

    threads = [threading.Thread(target=repeat, args=(work,)) for work in works]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        end.set()
        for thread in threads:
            thread.join()


@contextmanager
def held(lock: threading.Lock) -> Iterator[None]:
    """Another thread holds a lock until the block ends."""
    has, end = threading.Event(), threading.Event()

    def hold() -> None:
        with lock:
            has.set()
            end.wait(SECONDS)

    thread = threading.Thread(target=hold)
    thread.start()
    assert has.wait(SECONDS)
    try:
        yield
    finally:
        end.set()
        thread.join()


def test_a_child_forked_while_a_thread_holds_the_robots_lock_computes(talos: rbd.Robot):
    """The lock of the robot's data, held for certain: states, frames, a solve, and states of before the fork."""
    state, soles = talos.standing(), talos.soles()
    tau = rbd.hold(state, soles).tau
    expected = rbd.solve(state, tau, soles).multipliers

    def work() -> None:
        states = [talos.at("half_sitting") for _ in range(8)]  # more than the robot has data for
        assert all(s.frame("left_sole_link").J.shape == (6, talos.nv) for s in states)
        assert np.array_equal(rbd.solve(state, tau, soles).multipliers, expected)

    with held(talos.pool.lock):
        assert forked(work) == 0
    assert np.array_equal(rbd.solve(state, tau, soles).multipliers, expected)


def test_children_forked_beside_threads_that_compute_give_the_same_answer(g1: rbd.Robot):
    """A dozen forks at arbitrary moments; each child's answer is that of the parent, bit by bit."""
    state, feet = g1.standing(), g1.feet()
    tau = rbd.hold(state, feet).tau
    expected = rbd.solve(state, tau, feet).a

    def work() -> None:
        assert np.array_equal(rbd.solve(g1.at(state.q), tau, feet).a, expected)

    with beside(*[lambda: rbd.solve(g1.at(state.q), tau, feet)] * 3):
        assert [forked(work) for _ in range(FORKS)] == [0] * FORKS


def test_a_child_finds_contacts_while_a_thread_of_the_parent_does(talos: rbd.Robot):
    """The lock around collision shapes."""
    contacts = rbd.CollisionContacts("ground", talos)
    state = talos.standing()
    expected = contacts.points(state).gaps

    def work() -> None:
        assert np.array_equal(contacts.points(talos.at(state.q)).gaps, expected)

    with held(contacts._finder._lock):
        assert forked(work) == 0


def test_a_child_draws_while_a_thread_of_the_parent_draws(talos: rbd.Robot):
    """The lock of a scene's messages; a live scene's browsers stay with the parent."""
    state = talos.standing()
    with Scene(talos) as scene:
        scene.show(state)
        assert scene.url

        def work() -> None:
            scene.show(talos.at(state.q))
            scene.close()

        with held(scene.recorder._lock):
            assert forked(work) == 0
        scene.show(state)


def test_robots_without_a_file_of_their_own_survive_a_childs_end():
    """The folder for built robots' files stays with the process that made it; parent and child do not share names."""
    ours = new_folder()
    (ours / "robot.urdf").write_text("<robot/>")

    pid = os.fork()
    if pid == 0:  # an end with all clean-up, which multiprocessing's children leave out
        try:
            theirs = new_folder()
            code = 0 if theirs.parent != ours.parent else 1
        except BaseException:
            code = 2
        import atexit

        atexit._run_exitfuncs()
        os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert (ours / "robot.urdf").is_file() and new_folder().parent == ours.parent


def test_a_state_that_is_forgotten_waits_for_no_lock(talos: rbd.Robot):
    """The garbage collector may run in a thread that holds another robot's lock: two such threads would wait for ever."""
    state = talos.at("half_sitting")
    with held(talos.pool.lock):
        del state
        assert not talos.pool.lock.acquire(blocking=False)  # the other thread has it still: nothing waited for its end
    lent = len(talos.pool._lent)
    talos.at("half_sitting")
    assert len(talos.pool._lent) <= lent


@pytest.mark.parametrize("can_fork", [True, False])
def test_where_nothing_forks_nothing_is_registered(monkeypatch: pytest.MonkeyPatch, can_fork: bool):
    """Windows has no os.register_at_fork; elsewhere the owners known are renewed by what is registered."""
    registered = []
    monkeypatch.setattr(os, "register_at_fork", lambda **given: registered.append(given["after_in_child"]))
    if not can_fork:
        monkeypatch.delattr(os, "register_at_fork")
    module = runpy.run_path(rbd.model.data_pool.__file__)
    renewed = []

    class Owner:
        def renew_after_fork(self) -> None:
            renewed.append(self)

    owner = Owner()
    module["renewed_after_fork"](owner)
    for renew in registered:
        renew()
    assert renewed == ([owner] if can_fork else [])


def test_every_lock_of_the_package_is_renewed_after_a_fork():
    """A module that makes a lock renews it; functools.cached_property, which has one before Python 3.12, is not used."""
    for path in sorted(Path(rbd.__file__).parent.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        attributes = [n for n in ast.walk(tree) if isinstance(n, ast.Attribute)]
        found = {n.attr for n in attributes} | {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
        decorators = [each for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) for each in n.decorator_list]
        assert not any("cached_property" in ast.unparse(each) for each in decorators), f"{path.name}: use rbd.arrays.lazy"
        threads = {ast.unparse(n) for n in attributes if f"threading.{n.attr}" in LOCKS} & LOCKS
        threads |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module == "threading"}
        assert not threads or "renewed_after_fork" in found, f"{path.name} makes a lock that a child may find locked for ever"
