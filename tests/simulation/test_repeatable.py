"""The same input gives the same bits: in one process, in another, whatever else lies in memory and whoever else computes.

Run as a script it does all `jobs` and prints one digest a job: that is what the other processes do.
Why this needs care at all: docs/design/repeatable.md.
"""

import hashlib
import math
import os
import subprocess
import sys
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.solvers import qp

Array = np.ndarray
Job = Callable[[], list[Array]]
DRAWS = 3
URDF = Path(__file__).parents[2] / "urdf"


def digest(arrays: list[Array]) -> str:
    """A short name of the bits of arrays."""
    together = hashlib.sha256()
    for array in arrays:
        together.update(np.ascontiguousarray(array).tobytes())
    return together.hexdigest()[:16]


class Litter:
    """Memory that is taken and given back in no order: what comes next lies elsewhere."""

    def __init__(self, seed: int) -> None:
        self.rng, self.kept = np.random.default_rng(seed), list[object]()

    def scatter(self) -> None:
        """A few more pieces, and half of all dropped where there are many."""
        for size in self.rng.integers(1, 700, size=20).tolist():
            self.kept += [np.empty(size), bytearray(3 * size)]
        if len(self.kept) > 2000:
            self.rng.shuffle(self.kept)
            del self.kept[::2]


def jobs() -> dict[str, Job]:
    """What is computed, by name; every job draws on inputs made beforehand."""
    talos = rbd.load_robot("talos")
    standing = talos.standing()
    hold = rbd.hold(standing, talos.feet()).tau
    out: dict[str, Job] = {"hold": lambda: [rbd.hold(standing, talos.feet()).tau]}
    rng = np.random.default_rng(3)
    for i in range(DRAWS):
        q = pin.integrate(talos.model, standing.q, 0.05 * rng.normal(size=talos.nv))
        v = 0.3 * rng.normal(size=talos.nv)
        noise = (1.0, 30.0)[i % 2] * rng.normal(size=talos.nu)  # soles that stick, and soles that slip or open
        tau = np.clip(hold + noise, -talos.effort_limit, talos.effort_limit)
        out |= {f"{name} {i}": job for name, job in _solves(talos, q, v, tau)}
    return out | dict(_simulations(standing))


def _simulations(standing: rbd.State) -> Iterator[tuple[str, Job]]:
    """A robot that is pushed till its soles slip and open; a fall with bounces; a loop."""
    feet, talos = standing.robot.feet(0.3), standing.robot
    push = np.zeros(talos.nv)
    push[1] = 1500.0
    hold = rbd.hold(standing, feet).tau
    yield (
        "push",
        lambda: _moved(standing, feet, 0.02, controller=lambda state, t: hold, external=lambda state, t: push * (t > 0.005)),
    )
    box = rbd.load_robot(URDF / "box.urdf")
    q = box.neutral()
    q[2], q[3:7] = 0.5, [0.1, 0.2, 0.0, math.sqrt(0.95)]
    frame = box.frames()[-1]
    corners = [
        rbd.PointContact(f"{x}{y}", frame, offset=(0.2 * x, 0.2 * y, -0.1), friction=0.5, anchor=(0.0, 0.0, 0.0))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    yield "fall", lambda: _moved(rbd.State(box, q), corners, 0.35, restitution=0.5)
    four_bar = rbd.load_robot(URDF / "four_bar.urdf")
    swing = four_bar.at("assembled")
    yield "swing", lambda: _moved(swing, four_bar.loops(), 0.1)


def _moved(state: rbd.State, constraints: list, duration: float, **options: object) -> list[Array]:
    run = rbd.simulate(state, constraints, duration=duration, step=1e-3, progress=False, **options)
    events = [[e.t, e.speed, e.impulse] for e in run.events]
    return [run.q, run.v, run.a, *run.forces.values(), np.array(events, float), *run.residuals.values()]


def _solves(robot: rbd.Robot, q: Array, v: Array, tau: Array) -> Iterator[tuple[str, Job]]:
    held, rubbing = robot.soles(friction=None, on=None), robot.soles(friction=0.7, on=None)
    yield from (
        ("KKT", lambda: _solved(rbd.State(robot, q, v), tau, held, rbd.KKT())),
        ("ProxQP held", lambda: _solved(rbd.State(robot, q, v), tau, held, rbd.ProxQP())),
        ("ProxQP", lambda: _solved(rbd.State(robot, q), tau, rubbing, rbd.ProxQP())),
        ("ConeSolver coulomb", lambda: _solved(rbd.State(robot, q), tau, rubbing, rbd.ConeSolver())),
        ("ConeSolver convex", lambda: _solved(rbd.State(robot, q), tau, rubbing, rbd.ConeSolver(law="convex"))),
    )


def _solved(state: rbd.State, tau: Array, constraints: list, solver: rbd.KKT | rbd.ProxQP | rbd.ConeSolver) -> list[Array]:
    solution = rbd.solve(state, tau, constraints, solver=solver)
    return [solution.a, *solution.forces.values(), np.array(list(solution.residuals.scaled.values()))]


def digests(seed: int) -> dict[str, str]:
    """One digest a job; with a seed above zero in another order, with litter in memory."""
    found, litter, rng = {}, Litter(seed), np.random.default_rng(seed)
    if seed:
        litter.scatter()
    todo = list(jobs().items())
    if seed:
        rng.shuffle(todo)  # type: ignore[arg-type]
    for name, job in todo:
        if seed:
            litter.scatter()
        found[name] = digest(job())
    return dict(sorted(found.items()))


def elsewhere(seed: int, **environment: str) -> subprocess.Popen:
    """Another process at it: its output is a line a job."""
    return subprocess.Popen(
        [sys.executable, __file__, str(seed)], env=os.environ | environment, stdout=subprocess.PIPE, text=True
    )


def said(process: subprocess.Popen) -> dict[str, str]:
    out, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return dict(line.rsplit(" ", 1) for line in out.splitlines())


@pytest.fixture(scope="module")
def here() -> dict[str, str]:
    """The digests of this process, one job after the other."""
    return digests(0)


def test_other_processes_find_the_same_bits(here: dict[str, str], exhaustive: bool):
    """Another hash seed, environment and heap move everything in memory; order and history change too; the bits stay.

    All in one process; in another without order and litter, too, where everything is run.
    """
    others = {"everything": elsewhere(5, PYTHONHASHSEED="8", FILLER=5017 * "x", MALLOC_PERTURB_="90")}
    if exhaustive:
        others["hash seed and environment"] = elsewhere(0, PYTHONHASHSEED="7", FILLER=5017 * "x")
    assert len(here) == 4 + 5 * DRAWS
    for what, process in others.items():
        theirs = said(process)
        assert {name: d for name, d in theirs.items() if here[name] != d} == {}, what
        assert theirs.keys() == here.keys()


def test_another_order_in_the_same_process_finds_the_same_bits(here: dict[str, str]):
    """What was computed before leaves no trace: neither in Pinocchio's data that states share, nor in anything cached."""
    assert digests(11) == here


def test_other_threads_do_not_change_the_bits():
    """A state whose data another thread takes away runs its kinematics again, and gives the same."""
    talos = rbd.load_robot("talos")
    standing, soles = talos.standing(), talos.soles(friction=0.7)
    rng, limit = np.random.default_rng(4), talos.effort_limit
    hold = rbd.hold(standing, talos.feet()).tau
    tau = [np.clip(hold + 5.0 * rng.normal(size=talos.nu), -limit, limit) for _ in range(30)]

    def run() -> list[str]:
        return [digest(_solved(standing, t, soles, rbd.ConeSolver())) for t in tau]

    alone, stop = run(), threading.Event()

    def busy() -> None:
        while not stop.is_set():
            rbd.solve(rbd.State(talos, standing.q), hold, soles)
            rbd.State(talos, standing.q, np.ones(talos.nv)).frame("torso_2_link")

    other = threading.Thread(target=busy)
    other.start()
    try:
        assert run() == alone
    finally:
        stop.set()
        other.join()


@pytest.mark.parametrize("offset", [16, 32, 48])
def test_no_term_depends_on_where_its_input_lies(offset: int):
    """NumPy's arrays begin at multiples of 16 bytes; terms, factors and products of a problem are the same at each."""
    talos = rbd.load_robot("talos")
    rng = np.random.default_rng(6)
    q = pin.integrate(talos.model, talos.standing().q, 0.1 * rng.normal(size=talos.nv))
    v, rhs = rng.normal(size=talos.nv), rng.normal(size=talos.nv)

    def terms(place: Callable[[Array], Array]) -> str:
        state = rbd.State(talos, place(q), place(v))
        sole = rbd.Rows("sole", place(state.frame("left_sole_link").J), np.zeros(6), rbd.problem.Free(6))
        P = rbd.GaussProblem(place(state.M), place(rhs), [sole], from_state=True)
        return digest([state.M, state.h, state.com, P.factor, P.whitened, P.delassus, P.a_free, rbd.KKT().solve(P).a])

    assert terms(lambda array: _placed(array, offset)) == terms(lambda array: _placed(array, 0))


def _placed(array: Array, offset: int) -> Array:
    """A copy that begins at this offset from a multiple of 64 bytes."""
    room = np.empty(array.nbytes + 128, np.uint8)
    start = -room.ctypes.data % 64 + offset
    out = room[start : start + array.nbytes].view(float).reshape(array.shape, order="F" if array.flags.f_contiguous else "C")
    out[...] = array
    return out


def test_a_quadratic_program_does_not_depend_on_where_it_lies():
    """Last digits used to: ProxSuite's vectorised builds answer in one of two ways, by the place of their memory."""
    rng, litter = np.random.default_rng(0), Litter(1)
    C, l, g = rng.normal(size=(16, 6)), rng.normal(size=16), rng.normal(size=6)
    found: Counter[str] = Counter()
    for _ in range(150):
        litter.scatter()
        answer = next(qp.attempts(np.eye(6), g, None, None, C, l))
        found[digest([answer.x, answer.z])] += 1
    assert len(found) == 1, found


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for name, bits in digests(int(sys.argv[1])).items():
        print(name, bits)
