"""Terrain of convex pieces: its surface, and what contacts touch on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.constraints.terrain.on_terrain import OnTerrain
from rbd.constraints.terrain.pieces import EDGES, Plates
from rbd.constraints.terrain.touches import Touches
from rbd.control import ComTask, PostureTask, WholeBodyController
from rbd.simulation.ground_dynamics import GroundDynamics

BOX = rbd.testing.box(mass=10.0)
TALOS = rbd.load_robot("talos")
UP = np.array([0.0, 0.0, 1.0])
SOLE = np.array([[0.12, 0.06, 0.0], [0.12, -0.06, 0.0], [-0.12, -0.06, 0.0], [-0.12, 0.06, 0.0]])


def touched(terrain: rbd.Terrain, corners: Array, up: Array = UP) -> Touches:
    P, at = np.ascontiguousarray(corners, float), np.array([0, len(corners)])
    return Touches.of(terrain.polytopes, Plates(P, at, np.array(up)[None].copy(), np.zeros(1)), 0.05)


def on_box(q: Any, terrain: rbd.Terrain, **given: Any) -> tuple[rbd.State, rbd.SurfaceContact]:
    face = rbd.SurfaceContact("face", "box", on=terrain, **{"half_lengths": (0.2, 0.1), "friction": 0.6, **given})
    return rbd.State(BOX, q), face


def test_surface():
    """Heights, distances and planes of boxes, a slope and a grid of heights are those of the formulas."""
    stairs = rbd.Terrain.stairs(0.1, 0.3, 3)
    points = np.array(
        [[-0.5, 0.0, 0.1], [0.1, 0.0, 0.25], [0.7, 0.0, 0.35], [0.7, 0.0, 0.29], [0.7, 0.0, 0.1], [9.0, 0.0, 0.0]]
    )
    np.testing.assert_allclose(stairs.heights_of(points), [0.1, 0.15, 0.05, -0.01, -0.2, np.inf], atol=1e-14)
    np.testing.assert_allclose(
        stairs.distances(np.array([[-0.3, 0.0, 0.1], [-0.03, 0.0, 0.14], [-0.05, 0.0, 0.06], [0.7, 0.0, 0.26]])),
        [0.1, 0.05, 0.05, -0.04], atol=1e-14,
    )  # fmt: skip
    x = np.arange(8) * 0.25
    y = np.arange(5) * 0.25
    slope = rbd.Terrain.heights(0.3 * x[:, None] - 0.1 * y, 0.25)
    n = np.array([-0.3, 0.1, 1.0]) / np.sqrt(1.1)
    np.testing.assert_allclose(slope.ground_at(0.33, 0.51).normal, n, atol=1e-14)
    np.testing.assert_allclose(slope.heights_of([[0.33, 0.51, 1.0]]), 1.0 - 0.3 * 0.33 + 0.1 * 0.51, atol=1e-14)
    p = np.array([0.8, 0.4, 0.24 - 0.04]) + 0.07 * n
    np.testing.assert_allclose(slope.distances(p[None]), 0.07, atol=1e-14)
    floor = rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0.2), normal=(0.6, 0.0, 0.8))})
    np.testing.assert_allclose(floor.distances(np.array([[0.0, 0.0, 1.2]])), 0.8, atol=1e-14)


def test_sole_over_an_edge():
    """Its points are the corners over the tread and the crossings of its outline with the tread's edges."""
    stairs = rbd.Terrain.stairs(0.1, 0.3, 3)
    over = touched(stairs, SOLE + [0.0, 0.0, 0.1])
    np.testing.assert_allclose(sorted(over.places[:, 0]), [0.0, 0.0, 0.12, 0.12], atol=1e-15)
    assert (over.normals == UP).all()
    np.testing.assert_allclose(over.gaps, 0.0, atol=1e-15)
    # a toe a centimetre before a riser is no penetration; at the riser it touches two pieces
    for away, count in ((0.01, 4), (0.0, 6)):
        beside = touched(stairs, SOLE + [-0.12 - away, 0.0, 0.0])
        assert np.count_nonzero(beside.gaps <= 1e-12) == count
        np.testing.assert_allclose(beside.gaps[beside.normals[:, 0] == -1.0], away, atol=1e-15)
        assert beside.gaps.min() >= 0.0


@pytest.mark.parametrize("x", [-1e-6, -1e-9, 0.0, 1e-9])
def test_point_where_a_riser_begins(x):
    """In the corner between a tread and a riser a point touches both."""
    found = touched(rbd.Terrain.stairs(0.1, 0.3, 3), np.array([[x, 0.0, 0.0]]))
    assert sorted(map(tuple, found.normals.round(9).tolist())) == [(-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
    assert np.abs(found.gaps).max() <= 1e-6


def test_a_point_on_a_grid_touches_its_surface_alone():
    """Also where walls between three prisms are within the margin beside it."""
    flat, rng = rbd.Terrain.heights(np.zeros((9, 9)), 0.1), np.random.default_rng(0)
    for x, y in rng.uniform(0.1, 0.7, (200, 2)):
        found = touched(flat, [[x, y, 0.0]])
        assert len(found.gaps) == 1 and abs(found.gaps[0]) < 1e-12, (x, y)
        np.testing.assert_allclose(found.normals, [UP], atol=1e-12)


def test_seams_are_not_there():
    """On level boxes side by side, and on the prisms of a slope, a sole has its four corners and nothing else."""
    level = rbd.Terrain.boxes(*[((0.1 * k, -1, -0.5), (0.1 * (k + 1), 1, 0.0)) for k in range(20)])
    x = np.arange(20) * 0.1
    slope = rbd.Terrain.heights(np.repeat(0.2 * x[:, None], 20, axis=1), 0.1)
    n = np.array([-0.2, 0.0, 1.0]) / np.sqrt(1.04)
    R = np.column_stack([np.cross(UP * 0 + [0, 1, 0], n), [0.0, 1.0, 0.0], n])
    rng = np.random.default_rng(0)
    for _ in range(100):
        turn = pin.rpy.rpyToMatrix(0.0, 0.0, rng.uniform(-3.0, 3.0))
        x, y = rng.uniform(0.5, 1.2, 2)
        for found in (
            touched(level, SOLE @ turn.T + [x, 0.0, 0.0]),
            touched(slope, SOLE @ (R @ turn).T + [x, y, 0.2 * x], n),
        ):
            assert found.which[:, 0].tolist() == [0] * 4
            np.testing.assert_allclose(found.gaps, 0.0, atol=1e-15)


@pytest.mark.parametrize("seed", range(4))
def test_touching_random_boxes(seed, exhaustive):
    """A sole that comes down on random boxes touches where a dense sampling of it does, and nothing of it is inside above."""
    rng = np.random.default_rng(seed)
    g = np.linspace(-1.0, 1.0, 41)
    samples = np.stack(np.meshgrid(0.12 * g, 0.06 * g, [0.0], indexing="ij"), -1).reshape(-1, 3)
    checked = 0
    while checked < (250 if exhaustive else 40):
        pieces = {}
        for i in range(rng.integers(1, 4)):
            turn = rng.uniform(-0.3, 0.3, 3) if rng.random() < 0.5 else [0.0, 0.0, rng.uniform(-3.0, 3.0)]
            X = pin.SE3(pin.rpy.rpyToMatrix(*turn), rng.uniform(-0.3, 0.3, 3) * [1.0, 1.0, 0.2])
            pieces[str(i)] = coal.Box(*rng.uniform(0.1, 0.6, 3)), X
        terrain = rbd.Terrain(pieces)
        R = pin.rpy.rpyToMatrix(*(rng.uniform(-0.3, 0.3, 3) if rng.random() < 0.7 else (0.0, 0.0, rng.uniform(-3.0, 3.0))))
        up, start = R[:, 2].copy(), np.array([*rng.uniform(-0.2, 0.2, 2), 2.0])
        falls = np.inf  # where the line down from a sample enters a box
        for piece in terrain.pieces:
            lean, s = piece.faces[:, :3] @ up, (samples @ R.T + start) @ piece.faces[:, :3].T - piece.faces[:, 3]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = s / lean
            enters, leaves = np.where(lean > 1e-9, t, -np.inf).max(axis=1), np.where(lean < -1e-9, t, np.inf).min(axis=1)
            hit = (enters <= leaves) & ~((np.abs(lean) <= 1e-9) & (s > 0.0)).any(axis=1)
            falls = min(falls, enters[hit].min(initial=np.inf))
        if not np.isfinite(falls):
            continue
        checked += 1
        P = SOLE @ R.T + start - falls * up
        assert -0.02 < touched(terrain, P, up).gaps.min(initial=np.inf) < 1e-9  # 0.02: between two samples an edge is higher
        low, high = 0.0, 0.02
        for _ in range(40):
            middle = 0.5 * (low + high)
            apart = touched(terrain, P + middle * up, up).gaps.min(initial=np.inf) >= 0.0
            low, high = (low, middle) if apart else (middle, high)
        lifted = samples @ R.T + start + (high - falls) * up
        assert min(piece.depths(lifted).min() for piece in terrain.pieces) > -1e-9


def test_rates():
    """J_dot v is the derivative of J v along the motion, also of crossings and of what is under a sole: they wander over it."""
    terrain = rbd.Terrain.boxes([(-1, -1, -0.5), (0, 0.03, 0.0)], [(-1, 0.2, -0.5), (0, 1, -0.02)])
    rng, h, met = np.random.default_rng(1), 1e-6, set[tuple[str, int]]()
    source = on_box([0, 0, 0, 0, 0, 0, 1], terrain)[1].source(rbd.State(BOX, [0, 0, 0, 0, 0, 0, 1]))
    assert isinstance(source, OnTerrain)
    for _ in range(60):
        turn = pin.Quaternion(pin.rpy.rpyToMatrix(*rng.uniform(-0.3, 0.3, 2), rng.uniform(-3.0, 3.0))).coeffs()
        q, v = np.concatenate([[-0.03, 0.01, rng.uniform(0.0, 0.02)], turn]), rng.normal(size=6)
        found = []
        for t in (-h, 0.0, h):
            state = rbd.State(BOX, pin.integrate(BOX.model, q, t * v), v)
            m, which = source.at(state, 0.0), source.touches(state)[0].which
            parts = zip(m.structure.numbers, which, m.velocity.reshape(-1, 3), m.bias.reshape(-1, 3), strict=True)
            found.append({(n, w[4]): (velocity, bias) for n, w, velocity, bias in parts})
        before, now, after = found
        for key in now.keys() & before.keys() & after.keys():
            if key[1] == EDGES:
                continue
            met.add((source.label(key[0]).split()[0], int(key[1])))
            np.testing.assert_allclose((after[key][0] - before[key][0]) / (2.0 * h), now[key][1], atol=1e-6)
    assert met >= {("corner", 0), ("outline", 0), ("under", 0), ("outline", 1), ("under", 1)}


def test_rows_of_an_overhang_are_those_of_the_cut_sole():
    """`hold` over an edge has the torques of the sole cut there, and refuses where the edge passes the centre of mass."""
    state, flat = TALOS.standing(), TALOS.soles(friction=0.7)
    front = max((state.frame(s.frame).X_WF * s.placement).act(c)[0] for s in flat for c in s.corners)
    for over in (0.03, 0.08, 0.15):
        edge = front - over
        feet = TALOS.soles(friction=0.7, on=rbd.Terrain.boxes([(-2, -1, -0.5), (edge, 1, 0.0)]))
        cut = [
            rbd.SurfaceContact(
                s.name, s.frame, placement=s.placement, friction=0.7,
                corners=np.where(s.corners > 0.09, 0.097 - over, s.corners),
            )
            for s in flat
        ]  # fmt: skip
        if over == 0.15:
            for contacts in (feet, cut):
                with pytest.raises(rbd.CannotHold, match="centre of mass"):
                    rbd.hold(state, contacts)
            continue
        there, known = rbd.hold(state, feet), rbd.hold(state, cut)
        np.testing.assert_allclose(there.tau, known.tau, atol=1e-9)
        for name, force in there.forces.items():
            np.testing.assert_allclose(force, known.forces[name], atol=1e-9)


def test_standing_over_an_edge():
    """With 3 cm of its soles over an edge Talos stands without an event, and the controller counts the soles as whole."""
    state = TALOS.standing()
    front = max((state.frame(s.frame).X_WF * s.placement).act(c)[0] for s in TALOS.soles() for c in s.corners)
    feet = TALOS.soles(friction=0.7, on=rbd.Terrain.boxes([(-2, -1, -0.5), (front - 0.03, 1, 0.0)]))
    controller = WholeBodyController([ComTask(state.com, cost=100.0), PostureTask(state.q, cost=0.05, gain=40.0)], feet)
    stood = rbd.simulate(state, feet, duration=1.0, step=2e-3, controller=controller, progress=False)
    assert not stood.events
    assert np.abs(stood.com - stood.com[0]).max() < 1e-6
    assert stood.residuals["penetration"].max() < 1e-12
    assert "partial" not in str(controller) and "not all of it" not in str(controller)


def test_one_tread_is_the_ground(monkeypatch):
    """A box that falls, tips and slides on one box of terrain moves as on the plane of its top, to rounding."""
    tread = rbd.Terrain.boxes([(-3, -3, -1), (3, 3, 0.05)])
    q = np.concatenate([[0.0, 0.0, 0.08], pin.Quaternion(pin.rpy.rpyToMatrix(0.03, 0.05, 0.4)).coeffs()])
    v = np.array([0.5, 0.0, -0.3, 0.1, 0.2, 0.0])
    monkeypatch.setattr(GroundDynamics, "of", lambda *given: None)  # the same way of stepping
    runs = [
        rbd.simulate(
            rbd.State(BOX, q, v), [rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.4, on=on)],
            duration=0.5, step=2e-3, progress=False,
        )
        for on in (tread, rbd.Ground(point=(0, 0, 0.05)))
    ]  # fmt: skip
    assert len(runs[0].events) == len(runs[1].events) > 3
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-12)


def moving(tmp_path: Path, kind: str, *sizes: float) -> rbd.Robot:
    """A free ball or box of 1 kg."""
    shape = f'<sphere radius="{sizes[0]}"/>' if kind == "ball" else f'<box size="{sizes[0]} {sizes[1]} {sizes[2]}"/>'
    I = 0.4 * sizes[0] ** 2 if kind == "ball" else (sizes[0] ** 2 + sizes[2] ** 2) / 12.0
    path = tmp_path / f"{kind}.urdf"
    path.write_text(
        f'''<robot name="{kind}"><link name="body"><inertial><mass value="1"/><inertia ixx="{I}" iyy="{I}" izz="{I}" ixy="0"
        ixz="0" iyz="0"/></inertial><collision><geometry>{shape}</geometry></collision></link></robot>'''
    )
    return rbd.load_robot(path)


@pytest.mark.parametrize("off", [0.0, 0.03, 0.06, 0.09])
def test_ball_on_an_edge(tmp_path, off):
    """Without friction and loss it is reflected about the line from the edge to its centre."""
    ball, r, g = moving(tmp_path, "ball", 0.1), 0.1, 9.81
    contacts = [rbd.CollisionContacts("c", ball, friction=0.0, on=rbd.Terrain.boxes([(-0.5, -0.5, 0.0), (0.5, 0.5, 0.3)]))]
    state = rbd.State(ball, [0.5 + off, 0, 0.6, 0, 0, 0, 1])
    run = rbd.simulate(state, contacts, duration=0.3, step=1e-3, restitution=1.0, progress=False, may_sink=True)
    n = np.array([off, 0.0, np.sqrt(r * r - off * off)]) / r
    meets = np.sqrt(2.0 * (0.3 - r * n[2]) / g)
    after = np.array([0.0, 0.0, -g * meets])
    after -= 2.0 * (after @ n) * n
    rest = run.t[-1] - meets
    assert run.events[0].t == pytest.approx(meets, abs=1e-12)
    np.testing.assert_allclose(run.v[-1, :3], after + [0.0, 0.0, -g * rest], atol=1e-12)
    place = np.array([0.5 + off, 0.0, 0.3 + r * n[2]]) + after * rest + [0.0, 0.0, -0.5 * g * rest * rest]
    np.testing.assert_allclose(run.q[-1, :3], place, atol=1e-12)


def test_shapes_pass_seams(tmp_path):
    """A box slides over a level seam, and a ball rolls down a slope of 96 prisms, as on a plane; a step down costs no depth."""
    box, ball = moving(tmp_path, "box", 0.2, 0.2, 0.1), moving(tmp_path, "ball", 0.1)
    level = rbd.Terrain.boxes([(-1, -1, -0.5), (0.5, 1, 0)], [(0.5, -1, -0.5), (3, 1, 0)])
    slid = rbd.simulate(
        rbd.State(box, [0, 0, 0.05, 0, 0, 0, 1], [2.0, 0, 0, 0, 0, 0]),
        [rbd.CollisionContacts("c", box, friction=0.3, on=level)], duration=0.6, step=1e-3, progress=False,
    )  # fmt: skip
    assert not slid.events
    np.testing.assert_allclose(slid.q[-1, :3], [2.0 * 0.6 - 0.5 * 0.3 * 9.81 * 0.36, 0.0, 0.05], atol=1e-12)
    down = rbd.Terrain.boxes([(-1, -1, -0.5), (0.5, 1, 0)], [(0.5, -1, -0.5), (3, 1, -0.001)])
    fell = rbd.simulate(
        rbd.State(box, [0.35, 0, 0.05, 0, 0, 0, 1], [2.0, 0, 0, 0, 0, 0]),
        [rbd.CollisionContacts("c", box, friction=0.0, on=down)], duration=0.2, step=1e-3, progress=False,
    )  # fmt: skip
    assert fell.residuals["penetration"].max() < 1e-9
    assert fell.q[-1, 2] == pytest.approx(0.049, abs=1e-6)
    angle, x = np.deg2rad(10.0), np.arange(13) * 0.25
    slope = rbd.Terrain.heights(np.repeat(-np.tan(angle) * x[:, None], 5, axis=1), 0.25, origin=(0.0, -0.5))
    n = np.array([np.sin(angle), 0.0, np.cos(angle)])
    place = np.array([0.37, 0.013, -np.tan(angle) * 0.37]) + 0.1 * n
    rolled = [
        rbd.simulate(
            rbd.State(ball, [*place, 0, 0, 0, 1]), [rbd.CollisionContacts("c", ball, friction=0.5, on=on)],
            duration=0.8, step=2e-3, progress=False, may_sink=True,
        )
        for on in (slope, rbd.Ground(point=(0, 0, 0), normal=n))
    ]  # fmt: skip
    np.testing.assert_allclose(rolled[0].q, rolled[1].q, atol=1e-12)


def slid_off(tmp_path: Path, duration: float) -> tuple[rbd.Trajectory, int, Array, Array]:
    """A box slides off a table of 0.3 m: (its motion, the sample before it lands; R, and (x, z, v_x, v_z, w) as it does)."""
    box = moving(tmp_path, "box", 0.2, 0.2, 0.2)
    ground = rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0)), "table": (coal.Box(1.0, 1.0, 0.3), (0.0, 0.0, 0.15))})
    run = rbd.simulate(
        rbd.State(box, [0.3, 0, 0.4, 0, 0, 0, 1], [1.4, 0, 0, 0, 0, 0]),
        [rbd.CollisionContacts("c", box, friction=0.3, on=ground)], duration=duration, step=5e-4, progress=False,
    )  # fmt: skip
    lands = next(event.t for event in run.events if event.piece == "floor")
    k = int(lands / 5e-4)
    R, w, s = run.state(k).frame("body").X_WF.rotation, run.v[k, 4], lands - run.t[k]  # the rate of a free fall is constant
    v = R @ run.v[k, :3]
    p, R = run.q[k, :3] + v * s - [0, 0, 0.5 * 9.81 * s * s], R @ pin.exp3(np.array([0.0, w * s, 0.0]))
    return run, k, R, np.array([p[0], p[2], v[0], v[2] - 9.81 * s, w])


def rate_after(R: Array, u: Array, lifts: float) -> float:
    """Of a box whose lowest corner slips in a plastic impact, friction 0.3: it leaves the floor at `lifts` times its slip."""
    c = min((R @ np.array([x, 0.0, z]) for x in (-0.1, 0.1) for z in (-0.1, 0.1)), key=lambda p: p[2])
    J, found = np.array([[1.0, 0.0, c[2]], [0.0, 1.0, -c[0]]]), []
    for way in (1.0, -1.0):  # of the slip after the impact, against which friction is
        d = np.array([-0.3 * way, 1.0]) @ J / [1.0, 1.0, 0.08 / 12.0]  # change of u by a unit of impulse along the normal
        rows = J[1] - lifts * way * J[0]
        after = u - d * (rows @ u) / (rows @ d)
        if way * (J[0] @ after) > 0.0:
            found.append(float(after[2]))
    assert len(found) == 1
    return found[0]


def mujoco_box(head: str, world: str, place: Array, turn: Array, spatial: Array, w: float) -> tuple[Any, Any]:
    """MuJoCo's model and data of the box on its floor: place, quaternion (x, y, z, w), velocity in W, rate about y."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(
        f'''<mujoco>{head}<worldbody><geom type="plane" size="5 5 .1"/>{world}
        <body><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>'''
    )
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = [*place, turn[3], *turn[:3]], [*spatial, 0.0, w, 0.0]
    return model, data


def apart(run: rbd.Trajectory, first: int, last: int, model: Any, data: Any) -> float:
    """How far the box is at most from MuJoCo's, which begins at sample `first`, up to sample `last` [m]."""
    mujoco, away = pytest.importorskip("mujoco"), 0.0
    begins = run.t[first] - data.time
    for t, q in zip(run.t[first + 1 : last + 1], run.q[first + 1 : last + 1], strict=True):
        while begins + data.time < t - 0.5 * model.opt.timestep:
            mujoco.mj_step(model, data)
        away = max(away, float(np.linalg.norm(q[:3] - data.qpos[:3])))
    return away


def test_box_slides_off_an_edge_as_in_mujoco(tmp_path):
    """Up to its landing within 1 mm of MuJoCo's, with one of its settings: its slide does not converge as contact gets stiffer.

    With time constants of 0.8, 0.4, 0.2, 0.1, 0.05 ms it is 0.4, 0.4, 1.1, 2.1 and 9 mm away there.
    """
    run, k, _, _ = slid_off(tmp_path, 0.48)
    head = '''<option timestep="2e-5" cone="elliptic" impratio="100" iterations="200" tolerance="1e-12"/>
        <default><geom solref="4e-4 1" solimp="0.9999 0.9999 0.0001" friction="0.3 0 0" condim="3"/></default>'''
    table = '<geom type="box" size=".5 .5 .15" pos="0 0 .15"/>'
    model, data = mujoco_box(head, table, run.q[0, :3], run.q[0, 3:], run.v[0, :3], 0.0)
    assert apart(run, 0, k, model, data) < 1e-3 and run.t[k] > 0.45
    assert run.residuals["penetration"].max() < 1e-9


def test_a_corner_lands_as_in_the_rigid_limit_of_mujoco(tmp_path):
    """From its landing on the box is within 2 mm of MuJoCo's up to the second impact, and each obeys its own law.

    MuJoCo's contact is a spring with a time constant and a damping ratio. With a ratio of 1 it rebounds however stiff it is:
    the impact is plastic only as the ratio goes to infinity and the time to zero. That limit is the convex law: a corner that
    slips leaves the floor at u_n = mu |u_t|. `rbd` has that with law="convex"; by Coulomb's law, u_n = 0.
    """
    run, k, R, at = slid_off(tmp_path, 0.55)
    coulomb, convex = (rate_after(R, at[2:], lifts) for lifts in (0.0, 0.3))
    assert run.v[k + 1, 4] == pytest.approx(coulomb, rel=1e-6)
    other = rbd.simulate(
        run.state(k).at_time(0.0), [rbd.CollisionContacts("c", run.robot, friction=0.3, on=rbd.Ground(point=(0, 0, 0)))],
        duration=5e-3, step=5e-4, law="convex", progress=False,
    )  # fmt: skip
    assert other.v[-1, 4] == pytest.approx(convex, rel=1e-6)
    second = int(next(e.t for e in run.events if e.t > run.t[k] + 5e-3) / 5e-4)
    assert run.t[second] - run.t[k] > 0.03
    first, errors = k - 2, []
    spatial = run.state(first).frame("body").X_WF.rotation @ run.v[first, :3]
    for stiff in (1e-4, 2.5e-5):
        head = f'''<option timestep="{stiff / 20.0}" cone="elliptic" impratio="100" iterations="200" tolerance="1e-14"/>
            <default><geom solref="{stiff} 100" solimp="0.9999 0.9999 0.0001" friction="0.3 0 0" condim="3"/></default>'''
        model, data = mujoco_box(head, "", run.q[first, :3], run.q[first, 3:], spatial, run.v[first, 4])
        assert apart(run, first, second, model, data) < 2e-3
        errors.append(abs(float(data.qvel[4]) - convex))
    assert errors[1] < 0.35 * errors[0] and errors[1] < 0.05 * (convex - coulomb)


def test_hulls_on_boxes_fall_as_on_the_plane():
    """All shapes of Talos on seven boxes side by side: the same motion as on the plane of their tops."""
    q, v = TALOS.standing().q.copy(), np.zeros(TALOS.nv)
    q[2] += 0.02
    v[0], v[4] = 0.5, 0.5
    boxes = rbd.Terrain.boxes(*[((-1 + 0.3 * k, -1, -0.5), (-0.7 + 0.3 * k, 1, 0.0)) for k in range(7)])
    ends = []
    for on in (boxes, 0.0):
        contacts = [rbd.CollisionContacts("c", TALOS, friction=0.7, on=on)]
        ends.append(rbd.simulate(rbd.State(TALOS, q, v), contacts, duration=0.15, step=2e-3, progress=False))
    np.testing.assert_allclose(ends[0].q[-1], ends[1].q[-1], atol=1e-8)
    assert ends[0].residuals["penetration"].max() < 1e-9


def test_friction_is_that_of_the_terrain():
    """A terrain with a coefficient gives it to all contacts on it; another one is refused."""
    icy = rbd.Terrain.boxes([(-1, -1, -1), (1, 1, 0)], friction=0.05)
    state, face = on_box([0, 0, 0, 0, 0, 0, 1], icy)
    assert face.friction == 0.05
    with pytest.raises(rbd.InputError, match="its terrain's, 0.05"):
        face.with_friction(0.5)
    push = rbd.ExternalForce("box", (20.0, 0.0, 0.0))
    assert rbd.solve(state, [], [face], external=[push]).forces["face"][0] == pytest.approx(-0.05 * 98.1)


def test_starting_inside_is_named():
    """A sole that begins in a riser is refused with the point, its depth and the way out; `solve` warns of it."""
    state, face = on_box([0.07 - 0.2, 0.0, 0.0, 0, 0, 0, 1], rbd.Terrain.stairs(0.1, 0.3, 3))
    warns = pytest.warns(rbd.errors.DistantContactWarning, match="out along")
    with warns, pytest.raises(rbd.InputError, match=r"70 mm at 'face, corner \d on box 1 \(out along \(-1, 0, 0\)\)'"):
        rbd.simulate(state, [face], duration=0.1, step=1e-3, progress=False)
    with pytest.warns(rbd.errors.DistantContactWarning, match="out along"):
        rbd.solve(state, [], [face])


URDF_WORLD = '''<robot name="stairs"><link name="floor"><collision><geometry><box size="1 1 0.2"/></geometry></collision></link>
<link name="b"><collision name="step"><origin xyz="0 0 0.1"/><geometry><box size="0.5 1 0.2"/></geometry></collision></link>
<joint name="j" type="fixed"><parent link="floor"/><child link="b"/><origin xyz="0.5 0 0.1"/></joint></robot>'''
MJCF_WORLD = '''<mujoco><asset>
<hfield name="h" nrow="3" ncol="5" size="1 2 0.3 0.1" elevation="0 0 0 0 0 0 1 2 1 0 0 0 0 0 0"/></asset>
<worldbody><geom name="floor" type="plane" size="5 5 .1"/><geom name="box" type="box" size=".2 .3 .1" pos="1 0 .1"/>
<geom name="field" type="hfield" hfield="h" pos="3 0 0.5"/></worldbody></mujoco>'''


def test_worlds_in_files(tmp_path):
    """Boxes, planes and grids of heights of URDF and MJCF stand where the files have them."""
    urdf, mjcf = tmp_path / "w.urdf", tmp_path / "w.xml"
    urdf.write_text(URDF_WORLD)
    mjcf.write_text(MJCF_WORLD)
    np.testing.assert_allclose(rbd.Terrain.read(urdf).heights_of([[0.5, 0, 1.0], [0.0, 0.0, 1.0]]), [0.7, 0.9], atol=1e-14)
    world = rbd.Terrain.read(mjcf, friction=0.4)
    assert world.friction == 0.4
    tops = [float(world.ground_at(*at).point[2]) for at in ((-1, 0), (1, 0), (3, 0), (3.25, 0), (3, 1))]
    np.testing.assert_allclose(tops, [0.0, 0.2, 0.8, 0.725, 0.65], atol=1e-7)  # the file's elevations are in single precision
    moves = tmp_path / "m.urdf"
    moves.write_text(URDF_WORLD.replace('type="fixed"', 'type="continuous"'))
    with pytest.raises(rbd.InputError, match="nothing moves"):
        rbd.Terrain.read(moves)


def test_meshes_are_convex_parts(tmp_path):
    """Connected parts of a mesh are pieces; one that is not convex is refused, with how far its surface is inside."""

    def written(name: str, triangles: list[Array]) -> Path:
        corners = ["".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in t.tolist()) for t in triangles]
        text = "".join(f"facet normal 0 0 0\nouter loop\n{three}endloop\nendfacet\n" for three in corners)
        (tmp_path / name).write_text(f"solid a\n{text}endsolid a\n")
        return tmp_path / name

    def prism(outline: list[tuple[float, float]], faces: list[tuple[int, int, int]]) -> list[Array]:
        low = np.array([(x, y, 0.0) for x, y in outline])
        high, n = low + UP, len(outline)
        out = [low[[a, c, b]] for a, b, c in faces] + [high[list(f)] for f in faces]
        for i in range(n):
            j = (i + 1) % n
            out += [np.array([low[i], low[j], high[j]]), np.array([low[i], high[j], high[i]])]
        return out

    square = prism([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)])
    two = rbd.Terrain.mesh(written("two.stl", square + [t + [3.0, 0.0, 0.0] for t in square]), scale=0.5)
    assert two.names == ("two 0", "two 1")
    np.testing.assert_allclose(two.heights_of([[0.2, 0.2, 1.0], [1.7, 0.2, 1.0]]), 0.5, atol=1e-9)
    corner = prism([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    with pytest.raises(rbd.InputError, match=r"goes 0\.\d+ m below that of its hull"):
        rbd.Terrain.mesh(written("corner.stl", corner))
    with pytest.raises(rbd.InputError, match="no file"):
        rbd.Terrain.mesh(tmp_path / "none.stl")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: rbd.Terrain({}), "pieces of a terrain"),
        (lambda: rbd.Terrain({"a": 3.0}), "'a' of a terrain is 3.0"),
        (lambda: rbd.Terrain({"a": coal.Sphere(0.1)}), "Sphere"),
        (lambda: rbd.Terrain({"a": (coal.Box(1, 1, 1), np.eye(3))}), "4 x 4"),
        (lambda: rbd.Terrain({"a": rbd.Ground(normal=(0, 0, 1))}), "with a point"),
        (lambda: rbd.Terrain.boxes([(0, 0, 0), (1, 0, 1)]), "lowest corner"),
        (lambda: rbd.Terrain.stairs(0.1, -0.3, 3), "depth of stairs"),
        (lambda: rbd.Terrain.stairs(0.1, 0.3, 0), "number n of steps"),
        (lambda: rbd.Terrain.heights(np.array([[0.0, np.nan], [0.0, 0.0]]), 0.1), "not finite"),
        (lambda: rbd.Terrain.heights(np.zeros((1, 4)), 0.1), "two rows"),
        (lambda: rbd.Terrain.boxes([(0, 0, 0), (1, 1, 1)], friction=-0.1), "friction"),
        (lambda: rbd.Terrain.boxes([(0, 0, 0), (1, 1, 1)]).ground_at(4.0, 0.0), "no terrain at x = 4"),
    ],
)
def test_what_is_refused(make, says):
    with pytest.raises(rbd.InputError, match=says):
        make()


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.0, 0.0, 5e-7), (3e-7, 0.0, 1e-6), (0.0, 0.3, -1e-7)])
def test_the_bottom_of_a_valley_is_on_both_planes(at):
    """A point at the bottom of two half-spaces touches both, also within the length at which pieces are joined."""
    normals = np.array([[-0.2, 0.0, 1.0], [0.1, 0.0, 1.0]]) / np.sqrt([[1.04], [1.01]])
    valley = rbd.Terrain({f"{i}": rbd.Ground(point=(0, 0, 0), normal=n) for i, n in enumerate(normals)})
    found = touched(valley, np.array([at]))
    np.testing.assert_allclose(found.normals, normals, atol=1e-15)
    np.testing.assert_allclose(found.gaps, normals @ np.array(at), atol=1e-15)
