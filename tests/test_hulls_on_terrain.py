"""Convex hulls on terrain: what they touch of pieces, how these points move, and falls over edges."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

import rbd
from rbd.arrays import Array
from rbd.constraints.contact_kinematics import Touching
from rbd.constraints.convex.convex_shapes import convex_shape, polyhedron
from rbd.constraints.terrain.pieces import polytope
from rbd.constraints.terrain.shapes import OnPieces

BOX = rbd.testing.box(mass=10.0)
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def on_pieces(corners: Array, terrain: rbd.Terrain) -> OnPieces:
    """The hull of some corners as the shape of a free body."""
    return OnPieces(BOX, [replace(polyhedron("hull", corners), joint=1)], terrain)


def at(R: Array, p: Array, v: Array | None = None) -> rbd.State:
    return rbd.State(BOX, np.concatenate([p, pin.Quaternion(R).coeffs()]), v)


@cache
def _directions(data: bytes) -> tuple[Array, Array]:
    points = np.frombuffer(data).reshape(-1, 3)
    hull = ConvexHull(points)
    e = np.vstack([points[s[[1, 2, 0]]] - points[s] for s in hull.simplices])
    return hull.equations[:, :3], e / np.linalg.norm(e, axis=1)[:, None]


def parted(A: Array, R: Array, p: Array, B: Array) -> float:
    """The largest separation of two hulls along all normals of faces and all products of edges, one by one."""
    (N_1, e), (N_2, d) = _directions(A.tobytes()), _directions(B.tobytes())
    c = np.cross((e @ R.T)[:, None], d[None]).reshape(-1, 3)
    size = np.linalg.norm(c, axis=1)
    c = c[size > 1e-7] / size[size > 1e-7][:, None]
    N = np.vstack([-N_1 @ R.T, N_2, c, -c])
    return float((((A @ R.T + p) @ N.T).min(axis=0) - (B @ N.T).max(axis=0)).max())


def drawn(rng: np.random.Generator) -> tuple[Array, Array]:
    """Corners of a hull and of a piece: boxes, or of random corners."""

    def solid() -> Array:
        if rng.random() < 0.4:
            return CUBE * rng.uniform(0.03, 0.2, 3)
        x = rng.normal(size=(rng.integers(5, 20), 3))
        return x * rng.uniform(0.05, 0.2, 3) / np.linalg.norm(x, axis=1)[:, None]

    A, B = solid(), solid() @ pin.rpy.rpyToMatrix(*rng.uniform(-3.0, 3.0, 3)).T
    return tuple(np.ascontiguousarray(x[np.sort(ConvexHull(x).vertices)]) for x in (A, B))  # type: ignore[return-value]


def near(A: Array, R: Array, d: Array, B: Array, apart: float) -> Array:
    """A place along d from the piece at which the hull is so far from it."""
    low, high = 0.0, 3.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if parted(A, R, middle * d, B) > apart else (middle, high)
    return 0.5 * (low + high) * d


def gaps_of(found: list[Touching]) -> Array:
    return np.concatenate([np.zeros(0), *[part.gaps for part in found]])


@pytest.mark.parametrize("seed", range(2))
def test_gaps_are_separations(seed, exhaustive):
    """The least gap of touching hulls is their separation along the best of all normals; apart none is less than it."""
    rng = np.random.default_rng(seed)
    for _ in range(20 if exhaustive else 6):
        A, B = drawn(rng)
        terrain, d = rbd.Terrain({"piece": polytope("piece", B)}), rng.normal(size=3)
        pieces, R, d = on_pieces(A, terrain), pin.rpy.rpyToMatrix(*rng.uniform(-3.0, 3.0, 3)), d / np.linalg.norm(d)
        for apart in (1e-6, 0.0, -1e-7, -1e-4):
            gaps = gaps_of(pieces.at(at(R, near(A, R, d, B, apart)), 0.02))
            assert gaps.min() == pytest.approx(apart, abs=3e-9)
        for apart in (0.001, 0.009):
            gaps = gaps_of(pieces.at(at(R, near(A, R, d, B, apart)), 0.02))
            assert gaps.min() > apart - 3e-9


def test_rates_of_points_of_hulls():
    """J v is the rate of the gap, and J_dot v the derivative of J v along the motion, where a hull touches."""
    rng, h, met = np.random.default_rng(1), 1e-6, set[tuple[int, int]]()
    for _ in range(60):
        A, B = drawn(rng)
        terrain, d = rbd.Terrain({"piece": polytope("piece", B)}), rng.normal(size=3)
        pieces, R, d = on_pieces(A, terrain), pin.rpy.rpyToMatrix(*rng.uniform(-3.0, 3.0, 3)), d / np.linalg.norm(d)
        q, v = at(R, near(A, R, d, B, 0.0)).q, rng.normal(size=6)
        found = []
        for t in (-h, 0.0, h):
            state = rbd.State(BOX, pin.integrate(BOX.model, q, t * v), v)
            R_t, p_t = state.joint_places(pieces.joints)
            which = pieces._on_hulls(R_t, p_t, 0.02, 0.0)[1]
            (part,) = pieces.at(state, 0.02)
            rows = zip(part.names, which, part.gaps, part.velocity.reshape(-1, 3), part.bias.reshape(-1, 3), strict=True)
            found.append({(name, int(w[0]), int(w[4])): x for name, w, *x in rows})
        before, now, after = found
        for key in now.keys() & before.keys() & after.keys():
            (gap_0, u_0, _), (gap, u, bias), (gap_1, u_1, _) = before[key], now[key], after[key]
            if key[1:] == (3, 2) and gap > 1e-8:
                continue  # of edges apart the motion of the nearest points is that of edges that cross
            met.add(key[1:])
            np.testing.assert_allclose((u_1 - u_0) / (2.0 * h), bias, atol=2e-5, rtol=1e-6)
            if abs(gap) < 1e-8:
                assert (gap_1 - gap_0) / (2.0 * h) == pytest.approx(u[2], abs=1e-6)
    assert met >= {(0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (3, 2)}


@pytest.mark.parametrize("seed", [1, 2])
def test_box_falls_over_edges(tmp_path, seed):
    """A box thrown onto stairs tumbles down them, and is nowhere inside of a step by the normals of all faces and edges."""
    rng, size = np.random.default_rng(seed), np.array([0.2, 0.12, 0.08])
    path = tmp_path / "box.urdf"
    path.write_text(
        '''<robot name="box"><link name="body"><inertial><mass value="1"/><inertia ixx="0.002" iyy="0.004" izz="0.005" ixy="0"
        ixz="0" iyz="0"/></inertial><collision><geometry><box size="0.2 0.12 0.08"/></geometry></collision></link></robot>'''
    )
    box, stairs = rbd.load_robot(path), rbd.Terrain.stairs(0.1, 0.2, 3, start=(-0.3, 0.0, -0.3))
    turn = pin.Quaternion(pin.rpy.rpyToMatrix(*rng.uniform(-3.0, 3.0, 3))).coeffs()
    state = rbd.State(box, [0.1, 0.0, 0.2, *turn], [-1.0, *rng.uniform(-0.3, 0.3, 2), *rng.uniform(-3.0, 3.0, 3)])
    contacts = [rbd.CollisionContacts("c", box, friction=0.5, on=stairs)]
    run = rbd.simulate(state, contacts, duration=0.4, step=2.5e-4, progress=False, may_sink=True)
    assert run.residuals["penetration"].max() < 1e-9
    for q in run.q[::20]:
        X = pin.XYZQUATToSE3(q)
        for piece in stairs.pieces:
            if np.all(X.translation > piece.box[:3] - 0.2) and np.all(X.translation < piece.box[3:] + 0.2):
                assert parted(0.5 * size * CUBE, X.rotation, X.translation, piece.vertices) > -1e-9


def test_talos_falls_onto_boxes_of_different_heights():
    """Of all its shapes no corner is inside of a box by 1e-9 m, and no point of a box's edge inside of a shape."""
    talos = rbd.load_robot("talos")
    q, v = talos.standing().q.copy(), np.zeros(talos.nv)
    q[2] += 0.08
    v[:2], v[3:6] = [0.3, -0.2], [0.5, 0.9, -0.4]
    tops = [0.0, 0.01, -0.02, 0.015, -0.01, 0.02, 0.0]
    on = rbd.Terrain.boxes(*[((-1 + 0.3 * k, -1, -0.5), (-0.7 + 0.3 * k, 1, z)) for k, z in enumerate(tops)])
    contacts = rbd.CollisionContacts("c", talos, friction=0.7, on=on)
    run = rbd.simulate(rbd.State(talos, q, v), [contacts], duration=0.5, step=2e-3, progress=False, may_sink=True)
    assert run.residuals["penetration"].max() < 1e-9
    shapes = [convex_shape(each) for each in talos.collision_model.geometryObjects if each.parentJoint > 0]
    y, met = np.linspace(-1.0, 1.0, 4001), 0
    for i in range(100, len(run.t), 30):
        state = rbd.State(talos, run.q[i])
        for shape in shapes:
            R, p = (x[0] for x in state.joint_places([shape.joint]))
            corners, centre = shape.vertices @ R.T + p, R @ shape.centre + p
            for piece in on.pieces:
                assert piece.depths(corners).min() > -1e-9
                for x in piece.box[[0, 3]].tolist():
                    rim = np.column_stack([np.full(len(y), x), y, np.full(len(y), piece.box[5])])
                    rim = rim[np.linalg.norm(rim - centre, axis=1) < shape.reach]
                    if len(rim) and not shape.rounds:
                        inside = ((rim - p) @ R) @ shape.faces[:, :3].T - shape.faces[:, 3]
                        met += 1
                        assert inside.max(axis=1).min() > -1e-9
    assert met > 20


def test_box_rocks_on_a_ridge_as_on_a_plane(tmp_path):
    """From side to side with both ends of its face in turn: Housner's ratio of rates at each impact, and the plane's motion."""
    a, b, h, tilt = 0.1, 0.06, 0.2, 0.05
    path = tmp_path / "block.urdf"
    path.write_text(
        f"""<robot name="block"><link name="body"><inertial><mass value="2"/><inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0"
        ixz="0" iyz="0"/></inertial><collision><geometry><box size="{2 * a} {2 * b} {2 * h}"/></geometry></collision></link>
        </robot>"""
    )
    block = rbd.load_robot(path)
    ridge = polytope("ridge", np.array([[0.0, -1, 0], [0.0, 1, 0], [-1, -1, -1], [-1, 1, -1], [1, -1, -1], [1, 1, -1]]))
    R = pin.rpy.rpyToMatrix(tilt, 0.0, 0.0)
    p = np.array([0.0, -b, 0.0]) - R @ [0.0, -b, -h]  # it turns about the end at y = -b
    X = np.concatenate([p, pin.Quaternion(R).coeffs()])
    runs = []
    for on in (rbd.Terrain({"ridge": ridge}), rbd.Ground(point=(0, 0, 0))):
        contacts = [rbd.CollisionContacts("c", block, friction=2.0, on=on)]
        runs.append(rbd.simulate(rbd.State(block, X), contacts, duration=0.45, step=1e-3, progress=False))
    on_ridge, on_plane = runs
    strikes = sorted({event.t for event in on_ridge.events if event.kind == "touches"})
    assert len(strikes) >= 2
    np.testing.assert_allclose(on_ridge.q, on_plane.q, atol=1e-8)
    assert on_ridge.residuals["penetration"].max() < 1e-9
    assert np.abs(on_ridge.residuals["energy"]).max() < 1e-5
    ratio = (0.03 + 2.0 * (h * h - b * b)) / (0.03 + 2.0 * (h * h + b * b))
    energy = on_ridge.energy  # at rest in the middle it is m g h: the rest is of the rate
    for t, after in zip(strikes, [*strikes[1:], on_ridge.t[-1]], strict=True):
        before, later = (energy[np.searchsorted(on_ridge.t, x) - 1] - 2.0 * 9.81 * h for x in (t, after))
        assert later / before == pytest.approx(ratio**2, rel=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_patches_are_those_of_coal(seed):
    """What a sole, and a box, touch of a tread: the polygon of `coal.computeContactPatch`, its corners and its area."""
    rng, met = np.random.default_rng(seed), set[int]()
    half, pressed, request = np.array([0.11, 0.06, 0.02]), 1e-5, coal.ContactPatchRequest()
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]) * half
    for _ in range(15):
        tread, turn = rng.uniform(0.05, 0.3, 2), pin.rpy.rpyToMatrix(0.0, 0.0, float(rng.uniform(-3.0, 3.0)))
        place = np.append((tread + 0.05) * rng.uniform(-1.0, 1.0, 2), 0.0)
        on = rbd.Terrain.boxes([(-tread[0], -tread[1], -0.5), (*tread, 0.0)])
        low = coal.Transform3s(turn, place + [0.0, 0.0, half[2] - pressed])
        under = coal.Transform3s(np.eye(3), np.array([0.0, 0.0, -0.25]))
        shapes = coal.Box(*(2.0 * half)), low, coal.Box(*(2.0 * tread), 0.5), under
        hit, found = coal.CollisionResult(), coal.ContactPatchResult()
        coal.collide(*shapes, coal.CollisionRequest(), hit)
        theirs = np.zeros((0, 2))
        if hit.isCollision():
            if abs(hit.getContact(0).normal[2]) < 0.999 or hit.getContact(0).penetration_depth > 2.0 * pressed:
                continue  # beside the tread, or across its edge by less than it is pressed
            coal.computeContactPatch(*shapes, hit, request, found)
            patch = found.getContactPatch(0)
            theirs = np.array([patch.getPoint(i)[:2] for i in range(patch.size())])
        sole = rbd.SurfaceContact("sole", "box", half_lengths=half[:2], friction=0.5, on=on)
        state = at(turn, place)
        soles = sole.source(state).at(state, 0.0)
        hulls = on_pieces(corners, on).at(at(turn, place + [0.0, 0.0, half[2]]), 1e-3)
        of_hull = np.concatenate([part.positions[np.abs(part.gaps) < 1e-9] for part in hulls] or [np.zeros((0, 3))])
        for ours in (soles.points[np.abs(soles.gap) < 1e-9, :2], of_hull[:, :2]):
            assert len(theirs) > 2 or not len(ours)
            if len(theirs) > 2:
                met.add(len(theirs))
                mine, other = ConvexHull(ours), ConvexHull(theirs)
                assert mine.volume == pytest.approx(other.volume, rel=1e-6)  # the area of a polygon
                away = np.linalg.norm(ours[mine.vertices][:, None] - theirs[other.vertices][None], axis=2)
                assert away.min(axis=0).max() < 1e-6 and away.min(axis=1).max() < 1e-6
    assert len(met) >= 2
