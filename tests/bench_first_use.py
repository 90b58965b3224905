"""The first answer of a process, from `import rbd` on, beside importing Pinocchio and loading the same file there.

Each in a process of its own, by turns; processor time of the whole process, the least of several. What Python and Numba keep on
disk is there: the first round is left out. Run by `make bench`.
"""

from __future__ import annotations

import os
import subprocess
import sys

from bench_timing import Row

import rbd

ROUNDS = 9
MARK = 2.5
FEET = {"talos": "soles", "solo12": "feet"}
_ANSWER = """
import rbd
robot = rbd.load_robot({name!r})
rbd.solve(robot.standing(), [0.0] * robot.nu, robot.{feet}(friction=0.7))
"""
_PINOCCHIO = """
import pinocchio
pinocchio.buildModelFromUrdf({path!r}, pinocchio.JointModelFreeFlyer())
"""


def first_rows() -> list[Row]:
    """In Python, as a process begins; and compiled at once, as it goes on."""
    beside, at_once = {}, {}
    for name, feet in FEET.items():
        answer, path = _ANSWER.format(name=name, feet=feet), str(rbd.load_robot(name).source.urdf)
        codes = {"pinocchio": (_PINOCCHIO.format(path=path), ""), "first": (answer, ""), "compiled": (answer, "1")}
        rounds = [{what: _seconds(*code) for what, code in codes.items()} for _ in range(ROUNDS + 1)][1:]
        least = {what: min(each[what] for each in rounds) for what in codes}
        beside[name], at_once[name] = (least[what] / least["pinocchio"] for what in ("first", "compiled"))
    unit = "x import pinocchio, load"
    return [
        Row("import rbd, load, first rbd.solve on feet", beside, unit, (MARK,)),
        Row("the same, compiled at once: RBD_COMPILED=1", at_once, unit),
    ]


def _seconds(code: str, compiled: str) -> float:
    """Processor time of a process that runs some code."""
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    told = "\nimport time\nprint(time.process_time())"
    done = subprocess.run(
        [sys.executable, "-c", code + told],
        env={**inherited, "RBD_COMPILED": compiled},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)
