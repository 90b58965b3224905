"""Nonsense into every public function: an error of our own tree, or a right answer; nothing else, and never a crash."""

from __future__ import annotations

import datetime
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from forked import alone

import rbd
from rbd import dynamics
from rbd.errors import InputError, RbdError
from rbd.robots import catalogue

NV, NQ, NU = 38, 39, 32  # of Talos


def nonsense(talos: rbd.Robot) -> dict[str, Any]:
    """Things that users have passed, or might, by a name for each."""
    state, soles = talos.standing(), talos.soles()
    push = rbd.ExternalForce("torso_2_link", (1.0, 2.0, 3.0))
    return {
        "None": None,
        "word": "talons",
        "empty word": "",
        "null": "a\0b",
        "half a letter": "\ud800",
        "bytes": b"talos",
        "one": 1,
        "minus one": -1,
        "half": 0.5,
        "nan": float("nan"),
        "inf": float("inf"),
        "True": True,
        "huge": 10**400,
        "complex": 1j,
        "object": object(),
        "function": len,
        "class": rbd.State,
        "error": ValueError("x"),
        "date": datetime.date(2020, 1, 1),
        "path": Path("/nowhere/at/all"),
        "[]": [],
        "()": (),
        "{}": {},
        "dict": {"left_sole": 1.0},
        "set": {1.0, 2.0, 3.0},
        "words": ["a", "b", "c"],
        "ragged": [[1.0, 2.0], [3.0]],
        "objects": [object()] * 3,
        "generator": (x for x in (1.0, 2.0, 3.0)),
        "range": range(NV),
        "0-d": np.array(3.0),
        "two": np.zeros(2),
        "three": np.zeros(3),
        "three nan": np.array([0.0, np.nan, 0.0]),
        "three huge": [10**400] * 3,
        "six": np.zeros(6),
        "3 x 3": np.eye(3),
        "4 x 4 nan": np.full((4, 4), np.nan),
        "nv": np.zeros(NV),
        "nq": np.zeros(NQ),
        "nu": np.zeros(NU),
        "column": np.zeros((NV, 1)),
        "nv nan": np.full(NV, np.nan),
        "nv inf": np.r_[np.zeros(NV - 1), -np.inf],
        "nv huge": [10**400] * NV,
        "nv 1e308": np.full(NV, 1e308),
        "nv complex": np.zeros(NV) + 1j,
        "nv words": ["1"] * NV,
        "nv objects": np.array([None] * NV, dtype=object),
        "nv booleans": np.ones(NV, bool),
        "nv masked": np.ma.masked_array(np.zeros(NV), mask=True),
        "nv whole": np.zeros(NV, int),
        "nv dates": np.array(["2020-01-01"] * NV, dtype="datetime64[D]"),
        "nu nan": np.full(NU, np.nan),
        "nu complex": np.zeros(NU) + 1j,
        "nu words": ["1"] * NU,
        "q off": talos.standing().q * (1.0 + 1e-5),
        "robot": talos,
        "model": talos.model,
        "state": state,
        "contact": soles[0],
        "contacts": soles,
        "contacts twice": soles * 2,
        "mixed": [soles[0], "right_sole"],
        "rows": soles[0].rows(state),
        "push": push,
        "pushes mixed": [push, 1.0],
        "pose": pin.SE3.Identity(),
        "solver": rbd.KKT(),
        "NumPy's nan": np.float64("nan"),
        "NumPy's inf": np.float32("inf"),
        "NumPy's True": np.True_,
        "NumPy's text": np.str_("tal(ons)"),
        "NumPy's numbers": [np.float64(1.0 / 3.0)] * (NV + 2),
        "NumPy's nans": (np.float64("nan"),) * 3,
        "NumPy's dict": {np.str_("left_sole"): np.float64("nan")},
    }


Call = Callable[[rbd.Robot, Any], object]
TORSO = "torso_2_link"


def at_rest(robot: rbd.Robot) -> tuple[rbd.State, np.ndarray]:
    return robot.standing(), np.zeros(robot.nu)


WORDS = {"word", "half a letter", "null", "NumPy's text"}
VECTOR = {"nv", "nv whole", "range"}
EXTERNAL = VECTOR | {"None", "[]", "()", "push"}
FRICTION = {"None", "one", "half"}

CALLS: dict[str, tuple[Call, set[str]]] = {
    # what is called with the nonsense, and which of it is good there
    "load_robot(x)": (lambda r, x: rbd.load_robot(x), set()),
    "load_robot(root=)": (lambda r, x: rbd.load_robot("panda", root=x), {"None"}),
    "load_robot(passive=)": (lambda r, x: rbd.load_robot("panda", passive=x), {"[]", "()", "{}"}),
    "load_robot(passive=[])": (lambda r, x: rbd.load_robot("panda", passive=[x]), set()),
    "catalogue.find(x)": (lambda r, x: catalogue.find(x), set()),
    "State(x, q)": (lambda r, x: rbd.State(x, r.neutral()), {"robot"}),
    "State(robot, x)": (lambda r, x: rbd.State(r, x), set()),
    "State(robot, q, x)": (lambda r, x: rbd.State(r, r.neutral(), x), VECTOR | {"None"}),
    "state.with_velocity": (lambda r, x: r.standing().with_velocity(x), VECTOR | {"None"}),
    "state.frame(x)": (lambda r, x: r.standing().frame(x), set()),
    "state.frame(offset=)": (lambda r, x: r.standing().frame(TORSO, x), {"three"}),
    "robot.frame": (lambda r, x: r.frame(x), set()),
    "robot.frame_id": (lambda r, x: r.frame_id(x), set()),
    "robot.joint_id": (lambda r, x: r.joint_id(x), set()),
    "robot.posture": (lambda r, x: r.posture(x), set()),
    "robot.at": (lambda r, x: r.at(x), {"None"}),
    "robot.at(v=)": (lambda r, x: r.at("standing", x), VECTOR | {"None"}),
    "robot.standing": (lambda r, x: r.standing(x), {"None"}),
    "robot.soles": (lambda r, x: r.soles(x), FRICTION),
    "robot.feet": (lambda r, x: r.feet(x), FRICTION),
    "robot.soles(facets=)": (lambda r, x: r.soles(facets=x), set()),
    "ExternalForce(x)": (lambda r, x: rbd.solve(*at_rest(r), external=[rbd.ExternalForce(x, (0, 0, 1))]), set()),
    "ExternalForce(force=)": (lambda r, x: rbd.ExternalForce(TORSO, x), {"three"}),
    "ExternalForce(moment=)": (lambda r, x: rbd.ExternalForce(TORSO, (0, 0, 1), x), {"three"}),
    "ExternalForce(offset=)": (lambda r, x: rbd.ExternalForce(TORSO, (0, 0, 1), offset=x), {"three"}),
    "PointContact(name=)": (lambda r, x: rbd.solve(*at_rest(r), [rbd.PointContact(x, TORSO)]), WORDS),
    "PointContact(frame=)": (lambda r, x: rbd.PointContact("toe", x).rows(r.standing()), set()),
    "PointContact(offset=)": (lambda r, x: rbd.PointContact("toe", TORSO, offset=x), {"three"}),
    "Ground(normal=)": (lambda r, x: rbd.PointContact("toe", TORSO, on=rbd.Ground(normal=x)), {"None"}),
    "PointContact(friction=)": (lambda r, x: rbd.PointContact("toe", TORSO, friction=x), FRICTION),
    "PointContact(facets=)": (lambda r, x: rbd.PointContact("toe", TORSO, friction=0.5, facets=x), set()),
    "PointContact(facets=) held": (lambda r, x: rbd.PointContact("toe", TORSO, facets=x), set()),
    "PointContact.rows": (lambda r, x: rbd.PointContact("toe", TORSO).rows(x), {"state"}),
    "SurfaceContact(name=)": (lambda r, x: rbd.SurfaceContact(x, TORSO, half_lengths=(0.1, 0.1)), WORDS),
    "SurfaceContact(frame=)": (lambda r, x: rbd.SurfaceContact("a", x, half_lengths=(0.1, 0.1)).rows(r.standing()), set()),
    "SurfaceContact(half_lengths=)": (lambda r, x: rbd.SurfaceContact("a", TORSO, half_lengths=x), set()),
    "SurfaceContact(corners=)": (lambda r, x: rbd.SurfaceContact("a", TORSO, corners=x), {"3 x 3"}),
    "SurfaceContact(placement=)": (
        lambda r, x: rbd.SurfaceContact("a", TORSO, half_lengths=(0.1, 0.1), placement=x),
        {"None", "pose"},
    ),
    "SurfaceContact(friction=)": (lambda r, x: rbd.SurfaceContact("a", TORSO, half_lengths=(1, 1), friction=x), FRICTION),
    "SurfaceContact(facets=)": (lambda r, x: rbd.SurfaceContact("a", TORSO, half_lengths=(1, 1), facets=x), set()),
    "SurfaceContact.rows": (lambda r, x: r.soles()[0].rows(x), {"state"}),
    "solve(x, tau)": (lambda r, x: rbd.solve(x, np.zeros(NU)), {"state"}),
    "solve(state, x)": (lambda r, x: rbd.solve(r.standing(), x), {"nu", "None"}),
    "solve(.., x)": (lambda r, x: rbd.solve(*at_rest(r), x), {"[]", "()", "{}", "contacts"}),
    "solve(.., [x])": (lambda r, x: rbd.solve(*at_rest(r), [x]), {"contact"}),
    "solve(external=)": (lambda r, x: rbd.solve(*at_rest(r), external=x), EXTERNAL),
    "solve(external=[x])": (lambda r, x: rbd.solve(*at_rest(r), external=[x]), {"push"}),
    "solve(solver=)": (lambda r, x: rbd.solve(*at_rest(r), solver=x), {"solver", "None"}),
    "solve(law=)": (lambda r, x: rbd.solve(*at_rest(r), law=x), {"None"}),
    "gauss_problem": (lambda r, x: rbd.gauss_problem(r.standing(), x), {"nu", "None"}),
    "hold(x, soles)": (lambda r, x: rbd.hold(x, r.soles()), {"state"}),
    "hold(state, x)": (lambda r, x: rbd.hold(r.standing(), x), {"contacts"}),
    "hold(external=)": (lambda r, x: rbd.hold(r.standing(), r.soles(), external=x), EXTERNAL - {"range"}),
    "free_acceleration(x, tau)": (lambda r, x: dynamics.free_acceleration(x, np.zeros(NU)), {"state"}),
    "free_acceleration(state, x)": (lambda r, x: dynamics.free_acceleration(r.standing(), x), {"nu", "None"}),
    "free_acceleration(external=)": (lambda r, x: dynamics.free_acceleration(*at_rest(r), x), EXTERNAL),
    "inverse_dynamics(x, a)": (lambda r, x: dynamics.inverse_dynamics(x, np.zeros(NV)), {"state"}),
    "inverse_dynamics(state, x)": (lambda r, x: dynamics.inverse_dynamics(r.standing(), x), VECTOR),
    "constraint_hessian(x, sole)": (
        lambda r, x: dynamics.constraint_hessian(x, rbd.PointContact("toe", TORSO, friction=0.0)),
        {"state"},
    ),
    "constraint_hessian(state, x)": (lambda r, x: dynamics.constraint_hessian(r.standing(), x), {"contact"}),
    **{
        f"dynamics.{term.__name__}": (lambda r, x, term=term: term(x), {"state"})  # type: ignore[misc]
        for term in (
            dynamics.mass_matrix,
            dynamics.bias_force,
            dynamics.gravity_torque,
            dynamics.coriolis_matrix,
            dynamics.coriolis_tensor,
            dynamics.kinetic_energy,
            dynamics.potential_energy,
            dynamics.momentum,
        )
    },
}


@pytest.mark.parametrize("call", CALLS)
def test_nonsense_is_refused_in_our_own_words(talos: rbd.Robot, call: str) -> None:
    """Every kind of nonsense raises an RbdError with a message, in plain numbers; what is good there is taken without one."""
    ask, good = CALLS[call]
    for name, x in nonsense(talos).items():
        if name in good:
            ask(talos, x)
            continue
        with pytest.raises(RbdError) as caught:
            ask(talos, x)
            pytest.fail(f"{call} took {name}")
        assert 20 < len(str(caught.value)) < 600, f"{call} with {name}: {caught.value}"
        assert "np." not in str(caught.value), f"{call} with {name}: {caught.value}"


def arrays(rng: np.random.Generator, robot: rbd.Robot) -> Any:
    """A random thing in place of a vector: a size, a shape, a kind of number, a bad entry here and there."""
    size = int(rng.choice([0, 1, 2, 3, 6, robot.nu - 1, robot.nu, robot.nv, robot.nv + 1, robot.nq]))
    shape = [(size,), (size, 1), (1, size), (size, size % 3), ()][rng.choice(5, p=[0.8, 0.05, 0.05, 0.05, 0.05])]
    x = rng.normal(size=shape) * 10.0 ** rng.integers(-300, 300 if rng.random() < 0.2 else 2)
    if x.size and rng.random() < 0.3:
        x.flat[rng.integers(x.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e308, 0.0])
    kind = rng.integers(8)
    if kind == 0:
        return x.tolist()
    if kind == 1:
        return x.astype(object)
    if kind == 2:
        return x + 1j * rng.integers(2)
    if kind == 3:
        return [x, None, "x"][: rng.integers(4)]
    return x


@pytest.mark.parametrize("seed", range(6))
def test_random_arrays_are_refused_or_answered(talos: rbd.Robot, seed: int) -> None:
    """Draws of q, v, tau, external and offsets: each call raises an RbdError, or all that it returns is finite."""
    rng = np.random.default_rng(seed)
    state, tau, answered = talos.standing(), np.zeros(talos.nu), 0
    for _ in range(150):
        x = arrays(rng, talos)
        for ask in (
            lambda x=x: rbd.State(talos, x).M,
            lambda x=x: rbd.State(talos, state.q, x).h,
            lambda x=x: dynamics.free_acceleration(state, x),
            lambda x=x: dynamics.free_acceleration(state, tau, x),
            lambda x=x: dynamics.inverse_dynamics(state, x),
            lambda x=x: state.frame(TORSO, x).X_WF.homogeneous,
            lambda x=x: rbd.solve(state, tau, talos.soles(), external=x, check=False).residuals.worst,
        ):
            try:
                with np.errstate(all="ignore"):
                    answer = ask()
            except (RbdError, rbd.errors.RbdWarning):
                continue
            answered += 1
            assert np.isfinite(answer).all()
    assert answered > 30


@pytest.mark.parametrize("bad", [-0.1, -1, float("nan"), float("inf"), -float("inf"), True, "0.7", [0.7], 10**400])
def test_friction_is_a_number_from_zero_up(talos: rbd.Robot, bad: Any) -> None:
    """Negative, infinite and NaN coefficients, and words, are refused wherever one is given."""
    for ask in (
        lambda: talos.soles(bad),
        lambda: rbd.PointContact("toe", TORSO, friction=bad),
        lambda: rbd.SurfaceContact("sole", TORSO, half_lengths=(0.1, 0.1), friction=bad),
    ):
        with pytest.raises(InputError, match="friction is .*expected a finite number >= 0, or None"):
            ask()


@pytest.mark.parametrize("bad", [2, 1, 0, -4, 4.0, True, None, "4", float("nan"), 10**400])
def test_facets_are_three_or_more(talos: rbd.Robot, bad: Any) -> None:
    """Two facets make no pyramid; whole numbers only; absurdly many are refused too."""
    for ask in (
        lambda: talos.soles(0.7, facets=bad),
        lambda: rbd.PointContact("toe", TORSO, friction=0.5, facets=bad),
        lambda: rbd.SurfaceContact("sole", TORSO, half_lengths=(0.1, 0.1), friction=0.5, facets=bad),
    ):
        with pytest.raises(InputError, match="facets is"):
            ask()


@pytest.mark.parametrize("normal", [(0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.0, 0.0, 1.0 + 1e-5), (1e-200, 0.0, 0.0)])
def test_a_normal_is_a_unit_vector(normal: tuple[float, float, float]) -> None:
    """Zero and other lengths are refused with the length that came; -z is a ceiling, and fine."""
    with pytest.raises(InputError, match="normal of the ground has length .*expected a unit vector"):
        rbd.PointContact("toe", TORSO, on=rbd.Ground(normal=normal))
    assert np.array_equal(rbd.PointContact("toe", TORSO, on=rbd.Ground(normal=(0.0, 0.0, -1.0))).normal, [0.0, 0.0, -1.0])


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"half_lengths": (0.1, 0.1), "corners": [[0, 0], [1, 0], [0, 1]]},
        {"half_lengths": (0.1, -0.1)},
        {"half_lengths": (0.0, 0.1)},
        {"half_lengths": (0.1, np.inf)},
        {"half_lengths": (0.1, 0.1, 0.1)},
        {"corners": [[0, 0], [1, 1], [2, 2]]},
        {"corners": [[0, 0], [0, 0], [0, 0]]},
        {"corners": [[0, 0], [1, 0]]},
        {"corners": [[0, 0], [1, 0], [0, np.nan]]},
        {"half_lengths": (0.1, 0.1), "placement": np.diag([1.0, 1.0, -1.0, 1.0])},
        {"half_lengths": (0.1, 0.1), "placement": np.diag([2.0, 1.0, 1.0, 1.0])},
        {"half_lengths": (0.1, 0.1), "placement": np.zeros((4, 4))},
    ],
)
def test_a_patch_has_an_area_and_a_place(wrong: dict[str, Any]) -> None:
    """Lengths above zero, corners not on a line, a placement that is one: mirrored and stretched axes are refused."""
    with pytest.raises(InputError, match="contact 'sole'"):
        rbd.SurfaceContact("sole", TORSO, **wrong)


@pytest.mark.parametrize("bad", [None, 5, [None], [3.0], [b"x"], object(), [["a"]]])
def test_package_dirs_are_folders(bad: Any) -> None:
    """Anything but names of folders is refused; folders that are not there are passed over."""
    with pytest.raises(InputError, match="package"):
        rbd.load_robot("panda", package_dirs=bad)
    for fine in ("no/such/folder", Path("no/such"), ["no/such"], ()):
        assert rbd.load_robot("panda", package_dirs=fine).nq == 16  # type: ignore[arg-type]


def test_every_frame_of_every_robot_answers_and_no_other_does() -> None:
    """Unknown ids crash Pinocchio: names near and far from known ones are refused, known ones answered."""
    rng = np.random.default_rng(0)
    for name in ("talos", "panda", "solo12"):
        robot = rbd.load_robot(name)
        state, known = robot.at(), set(robot.frames())
        for frame in known:
            assert np.isfinite(state.frame(frame).J).all()
            letters = list(frame)
            letters[rng.integers(len(letters))] = str(rng.choice(list("abcxyz_ 0\n\0")))
            if (other := "".join(letters)) not in known:
                with pytest.raises(rbd.errors.FrameNotFound):
                    state.frame(other)


CRASHERS = {
    "ids, sizes and orders": """
for x in (-1, 0, 10**6, 10**30, None): refused(lambda: s.frame(x), lambda: r.joint_id(x), lambda: r.frame(x))
refused(lambda: rbd.State(r, []), lambda: rbd.State(r, q, []), lambda: rbd.solve(s, []))
assert np.array_equal(rbd.State(r, np.array([q, q]).T[:, 0]).M, s.M)
""",
    "lifetimes": """
import gc, threading
gone, s2 = rbd.load_robot("g1"), rbd.load_robot("g1").standing()
del gone, r
gc.collect()
assert s2.frame("left_ankle_roll_link").J.any() and s.frame("left_sole_link").J.any()
keep = [rbd.State(s.robot, q) for _ in range(20)]
threading.Thread(target=lambda: [s.frame("base_link") for _ in range(500)]).start()
""",
    "huge loads": """
for e in (3, 6, 12, 24, 100, 140):
    load = np.random.default_rng(0).normal(size=38) * 10.0**e
    x = rbd.solve(s, np.zeros(32), r.soles(), external=load, check=False)
    assert np.isfinite(x.a).all()
    refused(lambda: rbd.hold(s, r.soles(), external=load))
""",
    "a chain": """
n = 4000
inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
link = '<link name="l{}">' + inertial + "</link>"
bar = '<joint name="j{0}" type="fixed"><parent link="l{0}"/><child link="l{1}"/></joint>'
body = "".join(link.format(i) for i in range(n + 1)) + "".join(bar.format(i, i + 1) for i in range(n))
open("chain.urdf", "w").write(f'<robot name="chain">{body}</robot>')
refused(lambda: rbd.load_robot("chain.urdf"))
""",
    "an entity that grows": """
levels = "".join(f'<!ENTITY e{i} "{("&e%d;" % (i - 1)) * 10}">' for i in range(1, 30))
open("bomb.urdf", "w").write(f'<!DOCTYPE r [<!ENTITY e0 "x">{levels}]><robot name="&e29;"/>')
refused(lambda: rbd.load_robot("bomb.urdf"))
""",
}


@pytest.mark.parametrize("what", CRASHERS)
def test_nothing_ends_the_process(what: str, tmp_path: Path) -> None:
    """What has crashed Pinocchio, or might, in a process of its own; where it is about lifetimes, to the interpreter's end."""
    script = f"""
import numpy as np, rbd
r = rbd.load_robot("talos"); s = r.standing(); q = s.q.copy()
def refused(*asked):
    for ask in asked:
        try: ask()
        except rbd.RbdError: continue
        raise SystemExit("taken")
{CRASHERS[what]}
"""

    def run() -> str:
        os.chdir(tmp_path)
        exec(script, {})
        return "well"

    if what != "lifetimes":
        assert alone(run) == "well"
        return
    script = f"import faulthandler; faulthandler.enable()\n{script}\nprint('well')"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "well\n"), done.stderr[-2000:]
