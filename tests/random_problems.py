"""Random problems for `tests/fuzz_problems.py`: least-constraint problems in arrays, and robots with contacts and loops.

Draws are hard on purpose: masses over nine decades, contacts at one point, opposed, a hundred of them, friction from 1e-9 to
1e6, loops given twice, soles turned any way. Everything follows from the random generator alone.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import certificate as C
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import rbd

Array = NDArray[np.float64]
Rng = np.random.Generator
Forces = Mapping[str, Array]
Thing = C.Touch | C.Held | C.Loop | C.Coordinate

FRICTIONS = (0.0, 1e-9, 1e-4, 0.3, 0.6, 1.0, 10.0, 1e3, 1e6)


def pick(rng: Rng, items: Sequence):
    """One of them."""
    return items[int(rng.integers(len(items)))]


def unit(rng: Rng) -> Array:
    """A direction."""
    x = rng.normal(size=3)
    return x / np.linalg.norm(x)


def decades(rng: Rng, n: int, spread: float) -> Array:
    """So many numbers n over so many decades: at random, falling, or rising."""
    x = np.sort(rng.uniform(0.0, spread, n))
    order = int(rng.integers(3))
    return 10.0 ** -(rng.permutation(x) if order == 0 else x if order == 1 else x[::-1])


# -- arrays ---------------------------------------------------------------------------------------------------------------


def _cone(rng: Rng) -> rbd.problem.cones.Cone:
    mu = pick(rng, FRICTIONS)
    facets = pick(rng, (3, 4, 4, 6, 8))
    kind = int(rng.integers(8))
    if kind == 0:
        return rbd.problem.Free(int(rng.integers(1, 4)))
    if kind == 1:
        return rbd.problem.NonNegative(int(rng.integers(1, 3)))
    if kind in (2, 3):
        return rbd.problem.FrictionCone(mu, facets)
    if kind == 4:
        lo = -float(10.0 ** rng.uniform(-4, 2))
        return rbd.problem.Bounds([lo, -np.inf][:1], [float(rng.choice([-lo, 2.0 * abs(lo), np.inf]))])
    if kind == 5:
        k = int(rng.integers(3, 6))
        above = np.zeros(k) if rng.random() < 0.7 else rng.uniform(-0.1, 0.1, k)
        corners = np.column_stack([rng.uniform(-0.2, 0.2, (k, 2)), above])
        return rbd.problem.WrenchCone(corners, mu, facets)
    if kind == 6:
        return rbd.problem.LineCone(float(10.0 ** rng.uniform(-2, 0)), mu, facets)
    return rbd.problem.Product([rbd.problem.FrictionCone(mu, facets), rbd.problem.NonNegative(1)])


def arrays(rng: Rng) -> tuple[str, rbd.GaussProblem]:
    """A problem without a robot: any M, any rows."""
    n = int(rng.integers(1, 13))
    spread = pick(rng, (0.0, 3.0, 9.0))
    A = rng.normal(size=(n, n + 2))
    S = np.sqrt(decades(rng, n, spread))
    M = (A @ A.T / n + 0.3 * np.eye(n)) * np.outer(S, S)
    M = 0.5 * (M + M.T)
    rhs = rng.normal(size=n) * S * S * 9.81 if rng.random() < 0.7 else rng.normal(size=n)
    family = pick(rng, ("random", "random", "one point", "opposed", "twice", "hundred", "scaled"))
    count = 100 if family == "hundred" else int(rng.integers(1, 6))
    rows: list[rbd.Rows] = []
    a0 = np.linalg.solve(M / np.outer(S, S), rhs / S) / S  # rows that hold are made to agree with some acceleration
    a0 = a0 * rng.uniform(0.0, 1.5, n)
    first = rng.normal(size=(6, n))
    for k in range(count):
        cone = (
            rbd.problem.FrictionCone(pick(rng, FRICTIONS), 4) if family in ("hundred", "opposed", "one point") else _cone(rng)
        )
        m = cone.dim
        if family == "one point" and m <= 6:
            J = first[:m].copy()
        elif family == "opposed" and k % 2 and m == 3:
            J = np.diag([1.0, -1.0, -1.0]) @ rows[-1].J[:3] if len(rows[-1].J) == 3 else rng.normal(size=(m, n))
        elif family == "twice" and rows and len(rows[-1].J) == m:
            J = rows[-1].J.copy()
        else:
            J = rng.normal(size=(m, n))
        if family == "scaled":
            J = J * 10.0 ** rng.uniform(-4, 4)
        bias = -J @ a0 if isinstance(cone, rbd.problem.Free) else J @ a0 * rng.normal() * 0.3
        feedback = rng.normal(size=m) * 0.1 if rng.random() < 0.2 and not isinstance(cone, rbd.problem.Free) else np.zeros(m)
        velocity = np.zeros(m)
        if isinstance(cone, rbd.problem.Bounds | rbd.problem.NonNegative) and rng.random() < 0.2:
            velocity[:] = np.abs(rng.normal(size=m)) + 0.01
        rows.append(rbd.Rows(f"r{k}", J, bias, cone, velocity, feedback=feedback))
    return f"arrays: nv {n}, {spread:g} decades, {family}, {sum(len(r) for r in rows)} rows", rbd.GaussProblem(M, rhs, rows)


# -- robots ---------------------------------------------------------------------------------------------------------------


@dataclass
class Tree:
    """A robot and where things can be put on it.

    Attributes:
        robot: Loaded from a file that was written for it.
        links: Names of its links, the root first.
        urdf: The file's text.
    """

    robot: rbd.Robot
    links: list[str]
    urdf: str


def _numbers(x: Array) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(x))


def _link(name: str, mass: float, size: float, rng: Rng) -> str:
    a, b, c = (size * rng.uniform(0.3, 1.0, 3)).tolist()
    xx, yy, zz = mass / 12.0 * (b * b + c * c), mass / 12.0 * (a * a + c * c), mass / 12.0 * (a * a + b * b)
    return (
        f'<link name="{name}"><inertial><origin xyz="{_numbers(0.3 * size * rng.normal(size=3))}" '
        f'rpy="{_numbers(rng.uniform(-1, 1, 3))}"/><mass value="{mass!r}"/>'
        f'<inertia ixx="{xx!r}" ixy="0" ixz="0" iyy="{yy!r}" iyz="0" izz="{zz!r}"/></inertial></link>\n'
    )


def _load(text: str, root: str) -> rbd.Robot:
    with tempfile.NamedTemporaryFile("w", suffix=".urdf", delete=False) as file:
        file.write(text)
    path = Path(file.name)
    try:
        return rbd.load_robot(path, root=root, loops=None)  # type: ignore[arg-type]
    finally:
        path.unlink()


def tree(rng: Rng, *, most: int = 8, spread: float | None = None, root: str | None = None) -> tuple[str, Tree]:
    """A random tree of revolute, prismatic and continuous joints."""
    n = int(rng.integers(1, most + 1))
    root = root or pick(rng, ("free_flyer", "free_flyer", "fixed", "planar"))
    spread = pick(rng, (0.0, 3.0, 9.0)) if spread is None else spread
    size = float(10.0 ** rng.uniform(-2, 0.3))
    masses = decades(rng, n + 1, spread) * 10.0 ** rng.uniform(-1, 1.5)
    chain = rng.random() < 0.6
    limit = float(10.0 ** rng.uniform(-1, 3))
    links = [f"l{k}" for k in range(n + 1)]
    text = '<?xml version="1.0"?>\n<robot name="random">\n' + "".join(
        _link(name, float(mass), size, rng) for name, mass in zip(links, masses, strict=True)
    )
    for k in range(1, n + 1):
        parent = links[k - 1 if chain else int(rng.integers(k))]
        kind = pick(rng, ("revolute", "revolute", "continuous", "prismatic"))
        bounds = f'<limit lower="-2" upper="2" effort="{limit!r}" velocity="9"/>' if kind != "continuous" else ""
        text += (
            f'<joint name="j{k}" type="{kind}"><parent link="{parent}"/><child link="{links[k]}"/>'
            f'<origin xyz="{_numbers(size * rng.normal(size=3))}" rpy="{_numbers(rng.uniform(-2, 2, 3))}"/>'
            f'<axis xyz="{_numbers(unit(rng))}"/>{bounds}</joint>\n'
        )
    text += "</robot>\n"
    story = f"{root} {'chain' if chain else 'tree'} of {n} joints, {spread:g} decades of mass, {size:.2g} m"
    return story, Tree(_load(text, root), links, text)


def polygon(rng: Rng, *, root: str = "fixed") -> tuple[str, Tree, list[Given]]:
    """A planar chain along a polygon, its last corner closed onto its first by a loop, once or twice."""
    sides = int(rng.integers(4, 7))
    angle = np.sort(rng.uniform(0, 2 * math.pi, sides))
    size = float(10.0 ** rng.uniform(-1.5, 0.5))
    flat = size * np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(0.5, 1.5, (sides, 1))
    n, bars = unit(rng), [f"l{k}" for k in range(sides)]
    t = np.cross(n, unit(rng))
    t /= np.linalg.norm(t)
    P = flat @ np.array([t, np.cross(n, t)])
    masses = decades(rng, sides, pick(rng, (0.0, 2.0, 6.0)))
    text = '<?xml version="1.0"?>\n<robot name="loop">\n' + "".join(
        _link(name, float(m), size, rng) for name, m in zip(bars, masses, strict=True)
    )
    text += '<link name="end"/><link name="start"/>\n'
    for k in range(1, sides):
        text += (
            f'<joint name="j{k}" type="continuous"><parent link="{bars[k - 1]}"/><child link="{bars[k]}"/>'
            f'<origin xyz="{_numbers(P[k] - (P[k - 1] if k > 1 else 0.0 * n))}"/><axis xyz="{_numbers(n)}"/></joint>\n'
        )
    for name, parent, at in (("end", bars[-1], P[0] - P[-1]), ("start", bars[0], P[0])):
        text += (
            f'<joint name="to_{name}" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{_numbers(at)}"/></joint>\n'
        )
    robot = _load(text + "</robot>\n", root)
    kinds = [pick(rng, ("planar", "point", "revolute", "revolute"))]
    if rng.random() < 0.3:
        kinds.append(pick(rng, ("planar", "point", "revolute")))
    given = [loop(f"loop{k}", robot, kind, n) for k, kind in enumerate(kinds)]
    return f"{root} polygon of {sides} bars closed by {' and '.join(kinds)}", Tree(robot, bars, text), given


@dataclass
class Given:
    """A constraint, and how the certificate sees it.

    Attributes:
        constraint: For `rbd.solve`.
        thing: From the state and the answer's forces and corner forces, what the certificate is to judge.
        name: Of the constraint.
        holds: Whether it holds, whatever that takes.
    """

    constraint: object
    thing: Callable[[rbd.State, Forces, Forces], Thing]
    holds: bool
    name: str = field(init=False)

    def __post_init__(self) -> None:
        self.name = self.constraint.name  # type: ignore[attr-defined]


def _site(robot: rbd.Robot, link: str) -> tuple[int, pin.SE3]:
    frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
    return int(frame.parentJoint), pin.SE3(frame.placement)


def _pose(robot: rbd.Robot, q: Array, joint: int) -> pin.SE3:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return pin.SE3(data.oMi[joint])


def _axes(n: Array) -> Array:
    """(t1, t2, n): t1 along the world's x as far as that goes, along y for a normal along x."""
    along = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t1 = along - (along @ n) * n
    t1 /= np.linalg.norm(t1)
    return np.column_stack([t1, np.cross(n, t1), n])


def point(name: str, robot: rbd.Robot, link: str, offset: Array, n: Array, mu: float | None, facets: int = 4) -> Given:
    """A point of a link on something with the outward normal n, in world axes."""
    contact = rbd.PointContact(name, link, offset=offset, on=rbd.Ground(normal=n), friction=mu, facets=facets)
    joint, X = _site(robot, link)
    at = X.act(offset)

    def thing(state: rbd.State, forces: Forces, corners: Forces) -> Thing:
        if mu is None:
            turn = _pose(robot, state.q, joint).rotation.T @ _axes(n)
            return C.Held(name, joint, pin.SE3(turn, at), "point", np.r_[forces[name], np.zeros(3)])
        return C.Touch(name, joint, at[None], _axes(n), mu, facets, corners[name])

    return Given(contact, thing, mu is None)


def patch(name: str, robot: rbd.Robot, link: str, X_FP: pin.SE3, corners: Array, mu: float | None, facets: int = 4) -> Given:
    """A sole, or with two corners along x a line, of a link."""
    if len(corners) == 2:
        half = float(corners[0, 0])
        contact: object = rbd.LineContact(name, link, half_length=half, placement=X_FP, friction=mu, facets=facets)
    else:
        contact = rbd.SurfaceContact(name, link, corners=corners, placement=X_FP, friction=mu, facets=facets)
    joint, X = _site(robot, link)
    X_JP = X * X_FP

    def thing(state: rbd.State, forces: Forces, pushes: Forces) -> Thing:
        if mu is None:
            return C.Held(name, joint, X_JP, "line" if len(corners) == 2 else "sole", forces[name])
        R = _pose(robot, state.q, joint).rotation @ X_JP.rotation
        points = X_JP.translation + corners @ X_JP.rotation.T
        return C.Touch(name, joint, points, R, mu, facets, pushes[name])

    return Given(contact, thing, mu is None)


def loop(name: str, robot: rbd.Robot, kind: str, axis: Array) -> Given:
    """The closure of a polygon."""
    closure = rbd.LoopClosure(name, "start", "end", kind=kind, axis=axis)
    (ja, Xa), (jb, Xb) = _site(robot, "start"), _site(robot, "end")

    def thing(state: rbd.State, forces: Forces, corners: Forces) -> Thing:
        wrench = np.r_[forces[name], np.zeros(6 - len(forces[name]))]
        return C.Loop(name, ja, jb, Xa, Xb, kind, axis / np.linalg.norm(axis), wrench)

    return Given(closure, thing, True)


def coordinate(name: str, robot: rbd.Robot, joint: str, kind: str, q: Array, limit: float) -> Given:
    """A locked joint, one at a stop, or one with dry friction."""
    j = robot.model.joints[robot.model.getJointId(joint)]
    i, sign = int(j.idx_v), 1.0 if limit > 0.5 else -1.0
    if kind == "lock":
        made: object = rbd.JointLock(name, joint)
    elif kind == "stop":
        at = float(q[j.idx_q])
        low, high = (at, at + 1.0) if sign > 0.0 else (at - 1.0, at)
        made = rbd.JointLimit(name, joint, lower=low, upper=high)
    else:
        made = rbd.JointFriction(name, joint, limit)

    def thing(state: rbd.State, forces: Forces, corners: Forces) -> Thing:
        f = forces[name]
        if kind == "stop" and len(f) == 2:  # of a trajectory: at the lower bound, and at the upper
            at = sign if f[0] == f[1] else math.copysign(1.0, f[0] - f[1])  # one that carries nothing stands where it is put
            return C.Coordinate(name, i, kind, float(f[0] - f[1]), at)
        one = float(f[0]) if len(f) else 0.0
        return C.Coordinate(name, i, kind, sign * one if kind == "stop" else one, sign, limit)

    return Given(made, thing, kind == "lock")


def contacts(rng: Rng, made: Tree, q: Array, *, held: bool | None = None, unlimited: bool = True) -> tuple[str, list[Given]]:
    """Contacts of a family: at one point, opposed, a hundred, soles turned any way, or mixed."""
    robot, links = made.robot, made.links if made.robot.root != "fixed" else made.links[1:]
    size = max(1e-2, float(np.abs(robot.model.inertias[-1].lever).max()))
    family = pick(rng, ("mixed", "mixed", "one point", "opposed", "soles", "soles", *(("hundred",) if unlimited else ())))
    same = pick(rng, FRICTIONS)

    def friction() -> float | None:
        if held is not None and held:
            return None
        if rng.random() < 0.5:
            return same
        return None if held is None and rng.random() < 0.3 else pick(rng, FRICTIONS)

    def normal() -> Array:
        return np.array([0.0, 0.0, 1.0]) if rng.random() < 0.5 else unit(rng)

    out: list[Given] = []
    if family == "hundred":
        some = [pick(rng, links) for _ in range(int(rng.integers(1, 5)))]
        n = normal()
        for k in range(100):
            mu = same if held is None or not held else None
            out.append(point(f"c{k}", robot, pick(rng, some), size * rng.normal(size=3), n, mu))
        return f"a hundred points at friction {same:g}", out
    count, link, offset = int(rng.integers(1, 7)), pick(rng, links), size * rng.normal(size=3)
    for k in range(count):
        n, mu, facets = normal(), friction(), pick(rng, (4, 4, 8))
        if family == "one point":
            out.append(point(f"c{k}", robot, link, offset, n, mu, facets))
        elif family == "opposed":
            out.append(point(f"c{k}", robot, link, offset, n, mu, facets))
            apart = (0.0 if rng.random() < 0.5 else 0.1) * size * n
            out.append(point(f"o{k}", robot, link, offset + apart, -n, mu, facets))
        elif family == "soles" or rng.random() < 0.3:
            corners = np.zeros((int(rng.integers(2, 6)), 3))
            corners[:, :2] = size * rng.normal(size=(len(corners), 2))
            if len(corners) == 2:
                corners[:, 1], corners[0, 0] = 0.0, abs(corners[0, 0]) + 1e-3
                corners[1, 0] = -corners[0, 0]
            where = pick(rng, links)
            joint, X = _site(robot, where)
            R = (_pose(robot, q, joint) * X).rotation.T if rng.random() < 0.4 else pin.exp3(rng.normal(size=3))
            out.append(patch(f"s{k}", robot, where, pin.SE3(R, size * rng.normal(size=3)), corners, mu, facets))
        else:
            out.append(point(f"c{k}", robot, pick(rng, links), size * rng.normal(size=3), n, mu, facets))
    return f"{family}, {len(out)} contacts", out


def joints(rng: Rng, made: Tree, q: Array) -> list[Given]:
    """Sometimes a lock, a stop, friction on a joint."""
    names = [
        str(name) for name in made.robot.model.names
        if name.startswith("j") and made.robot.model.joints[made.robot.model.getJointId(name)].nq == 1
    ]  # fmt: skip
    if not names or rng.random() < 0.6:
        return []
    return [
        coordinate(f"on_{name}", made.robot, name, pick(rng, ("lock", "stop", "friction")), q, 10.0 ** rng.uniform(-4, 1))
        for name in rng.permutation(names)[: int(rng.integers(1, 3))]
    ]


def posture(rng: Rng, robot: rbd.Robot) -> Array:
    """A configuration near the neutral one, its base anywhere."""
    v = rng.uniform(-1.0, 1.0, robot.nv)
    return pin.integrate(robot.model, pin.neutral(robot.model), v)


def still_velocity(rng: Rng, robot: rbd.Robot, q: Array, given: Sequence[Given], *, slide: bool = False) -> Array:
    """A velocity that leaves what touches where it is, or lets it slide; zero where there is none."""
    rows = [g.constraint.rows(rbd.State(robot, q)) for g in given]  # type: ignore[attr-defined]
    stacked = []
    for r in rows:
        slides = slide and type(r.cone).__name__ == "FrictionCone"
        stacked.append(r.J[2:] if slides else r.J)
    J = np.concatenate(stacked) if stacked else np.zeros((0, robot.nv))
    size = np.linalg.norm(J, axis=1, keepdims=True)
    _, s, Vt = np.linalg.svd(J / np.where(size > 0.0, size, 1.0))
    null = Vt[int((s > 1e-9).sum()) :]
    v = null.T @ rng.normal(size=len(null))
    return v if len(null) and np.abs(J @ v).max(initial=0.0) < 1e-9 * max(1.0, np.abs(v).max()) else np.zeros(robot.nv)


def torques(rng: Rng, robot: rbd.Robot) -> Array:
    """Motor torques of the size of the robot's weight, or far below."""
    scale = robot.mass * 9.81 * 10.0 ** rng.uniform(-4, 0)
    return scale * rng.normal(size=robot.nu) if rng.random() < 0.7 else np.zeros(robot.nu)
