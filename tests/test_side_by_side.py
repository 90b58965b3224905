"""Many solves side by side: threads that share a robot, robots and contacts in turn, and memory that does not grow.

Memory is counted in blocks of the interpreter's allocator, in bytes of Python objects and arrays, and, over many solves, in
what the operating system has given to the process, which counts Pinocchio's too.
"""

from __future__ import annotations

import gc
import sys
import tracemalloc
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import psutil
import pytest

import rbd
from rbd.constraints.constraint import Constraint

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
NAMES = ("talos", "g1", "solo12")
LAWS = ("coulomb", "convex")


@dataclass(frozen=True, eq=False)
class Task:
    """One problem, to be solved again and again."""

    robot: rbd.Robot
    q: np.ndarray
    tau: np.ndarray
    contacts: Sequence[Constraint]
    law: str

    def solve(self) -> rbd.Solution:
        """From State on."""
        return rbd.solve(rbd.State(self.robot, self.q), self.tau, self.contacts, law=self.law)

    def numbers(self) -> np.ndarray:
        """Acceleration and forces, in one array."""
        s = self.solve()
        return np.concatenate([s.a, s.multipliers, *(f.ravel() for f in s.corner_forces.values())])


def tasks(count: int, seed: int = 3) -> list[Task]:
    """Problems of three robots, both laws, three contact sets each: held, sticking or slipping."""
    rng = np.random.default_rng(seed)
    found = []
    for name in NAMES:
        robot = rbd.load_robot(name)
        standing = robot.standing()
        sets = [robot.feet(friction, on=None) for friction in (None, 0.2, 0.7)]
        hold = rbd.hold(standing, robot.feet(0.7)).tau
        for _ in range(count):
            bend = np.concatenate([np.zeros(6), 0.1 * rng.normal(size=robot.nv - 6)])
            noise = robot.mass / 90.0 * rng.choice([1.0, 30.0]) * rng.normal(size=robot.nu)
            q, tau = pin.integrate(robot.model, standing.q, bend), hold + noise
            found.append(Task(robot, q, tau, sets[rng.integers(3)], LAWS[rng.integers(2)]))
    return found


def test_threads_and_robots_side_by_side_find_the_same_bits():
    """Four threads share three robots and nine contact sets, each in its own order: every answer is one thread's alone."""
    all_tasks = tasks(12)
    alone = [task.numbers() for task in all_tasks]

    def shuffled(seed: int) -> int:
        wrong = 0
        for i in np.random.default_rng(seed).permutation(3 * len(all_tasks)) % len(all_tasks):
            wrong += not np.array_equal(all_tasks[i].numbers(), alone[i])
        return wrong

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)  # threads change places within a solve
    try:
        with ThreadPoolExecutor(4) as pool:
            assert list(pool.map(shuffled, range(4))) == [0, 0, 0, 0]
    finally:
        sys.setswitchinterval(interval)


def test_solutions_that_are_kept_do_not_change():
    """An answer asked for its problem, forces and residuals after many others were found tells what it told at once."""
    all_tasks = tasks(8, seed=4)
    at_once = [task.numbers() for task in all_tasks]
    kept = [task.solve() for task in all_tasks]
    for task in all_tasks[::-1]:
        task.solve()
    for s, expected in zip(kept, at_once, strict=True):
        found = np.concatenate([s.a, s.multipliers, *(f.ravel() for f in s.corner_forces.values())])
        assert np.array_equal(found, expected)
        assert s.residuals.worst <= 1e-9 and s.status == "solved"


def test_more_contact_sets_than_are_kept_answer_right():
    """Fifty contact sets in turn, each made anew: what is prepared for one is never used for another."""
    robot = rbd.load_robot("talos")
    state, tau = robot.standing(), rbd.hold(robot.standing(), robot.feet()).tau + 1.0
    alone = {}
    for friction in np.linspace(0.3, 0.9, 5):
        alone[friction] = rbd.solve(state, tau, robot.soles(friction=friction), solver=rbd.ConeSolver()).a
    for i in range(50):
        friction = np.linspace(0.3, 0.9, 5)[i % 5]
        s = rbd.solve(state, tau, robot.soles(friction=friction))
        assert np.abs(s.a - alone[friction]).max() <= 1e-9 * max(1.0, np.abs(s.a).max())
        assert {r.patch.friction for r in s.problem.rows} == {friction}


def test_a_robot_that_is_dropped_is_freed():
    """What is prepared lives with its robot: fifty robots loaded, solved for and dropped leave their memory."""

    def one() -> None:
        robot = rbd.load_robot("solo12")
        rbd.solve(robot.standing(), np.zeros(robot.nu), robot.feet(0.7))

    assert growth(one, 10, 25) < 100  # blocks a robot, which has thousands


def growth(work: Callable[[], object], first: int, then: int) -> float:
    """Blocks of memory a call that stay, counted over `then` calls after `first` ones."""
    for _ in range(first):
        work()
    gc.collect()
    before = sys.getallocatedblocks()
    for _ in range(then):
        work()
    gc.collect()
    return (sys.getallocatedblocks() - before) / then


def test_memory_does_not_grow_over_many_solves(exhaustive):
    """2,000 solves of all kinds, 100,000 in an exhaustive run: no more blocks, and no more bytes, than the noise of caches."""
    all_tasks = tasks(10, seed=5)
    count, traced = (100_000, 5_000) if exhaustive else (2_000, 150)

    def some(n: int) -> None:
        for i in range(n):
            all_tasks[i % len(all_tasks)].solve()
        gc.collect()

    some(3 * len(all_tasks))
    blocks, process = sys.getallocatedblocks(), psutil.Process()
    given = process.memory_info().rss
    some(count)
    grown = sys.getallocatedblocks() - blocks
    assert grown < 300, f"{grown} blocks more after {count} solves"
    assert process.memory_info().rss - given < 16e6 + 40.0 * count  # 40 bytes a solve are less than any object
    tracemalloc.start()
    try:
        some(len(all_tasks))
        before = tracemalloc.get_traced_memory()[0]
        some(traced)
        more = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert more < 50_000, f"{more} bytes more after {traced} solves"


def test_the_count_of_memory_notices_a_leak():
    """A list that keeps every answer grows by dozens of blocks a solve."""
    task, kept = tasks(1, seed=6)[0], []
    assert growth(lambda: kept.append(task.solve()), 10, 100) > 3
