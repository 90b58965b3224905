"""Bodies inside each other, and contacts without a ground: said by every verb, refused where a motion would make energy."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.errors import DistantContactWarning, InputError

HEIGHT = 0.3
"""Of the table [m]; the brick's is 0.1."""


def urdf(name: str, mass: float, x: float, y: float, z: float) -> str:
    """A box."""
    I = mass / 12.0 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    shape = f'<geometry><box size="{x} {y} {z}"/></geometry>'
    inertia = f'<inertia ixx="{I[0]}" iyy="{I[1]}" izz="{I[2]}" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial><collision>{shape}</collision></link>'
    return f'<robot name="{name}">{link}</robot>'


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> rbd.Robot:
    """A table of 50 kg and a brick of 1 kg."""
    folder, robots = tmp_path_factory.mktemp("boxes"), []
    for name, mass, size in (("table", 50.0, (1.0, 1.0, HEIGHT)), ("brick", 1.0, (0.2, 0.2, 0.1))):
        path = folder / f"{name}.urdf"
        path.write_text(urdf(name, mass, *size))
        robots.append(rbd.load_robot(path))
    return rbd.robots.merge_robots(*robots)


def contacts(both: rbd.Robot, friction: float = 0.2) -> rbd.CollisionContacts:
    names = tuple(shape.name for shape in both.collision_model.geometryObjects)
    return rbd.CollisionContacts("all", both, friction=friction, ground=True, pairs=[names])


def brick_at(both: rbd.Robot, depth: float, v: float = 0.0) -> rbd.State:
    """The brick so deep in the table [m]."""
    table, brick = [0, 0, 0.5 * HEIGHT, 0, 0, 0, 1], [0, 0, HEIGHT + 0.05 - depth, 0, 0, 0, 1]
    return rbd.State(both, [*table, *brick], [*np.zeros(6), v, *np.zeros(5)])


def test_a_brick_in_a_table_is_said(both: rbd.Robot) -> None:
    """With the depth and the place; by `solve`, by many states, and by statics; not at a tenth of a millimetre."""
    state = brick_at(both, 0.06)
    words = "'all' 60 mm at '.*brick.*' and 3 more points. They are computed as if they touched"
    with pytest.warns(DistantContactWarning, match=words):
        rbd.solve(state, np.zeros(0), [contacts(both)])
    with pytest.warns(DistantContactWarning, match=words):
        rbd.hold(state, [contacts(both)])
    with pytest.warns(DistantContactWarning, match="at 1 of 2 states"):
        found = rbd.solve_many(both, [state.q, brick_at(both, 0.0).q], np.zeros((2, both.nv)), np.zeros(0), [contacts(both)])
    assert [x.tolist() for x in found.warned.values()] == [[True, False]]
    rbd.solve(brick_at(both, 1e-4), np.zeros(0), [contacts(both)])


def test_no_motion_starts_from_a_brick_in_a_table(both: rbd.Robot) -> None:
    """From 60 mm it would gain 0.59 J; of up to 10 mm it says so."""
    with pytest.raises(InputError, match="'all' 60 mm at .* accepts up to 10 mm"), pytest.warns(DistantContactWarning):
        rbd.simulate(brick_at(both, 0.06), [contacts(both)], duration=0.01, step=1e-3)
    with pytest.warns(DistantContactWarning, match="'all' 5 mm at"):
        rbd.simulate(brick_at(both, 0.005), [contacts(both)], duration=0.002, step=1e-3)


def test_a_box_slides_off_the_edge_of_another(both: rbd.Robot) -> None:
    """It lands flat on the ground, and no energy is made. Coal finds no distance at some of the poses over the edge."""
    motion = rbd.simulate(brick_at(both, 0.0, v=1.5), [contacts(both)], duration=1.2, step=2e-3)
    end = motion.q[-1]
    assert end[7] > 0.6 and abs(end[9] - 0.05) < 1e-9
    assert motion.residuals["law"].max() < 1e-9 and motion.residuals["penetration"].max() < 1e-8
    assert np.diff(motion.energy).max() < 1e-6 * motion.kinetic.max()  # the steps of a tumbling box are of order 2


@pytest.mark.parametrize(
    "kind",
    [
        lambda on: rbd.PointContact("it", "box", friction=0.5, on=on),
        lambda on: rbd.SurfaceContact("it", "box", half_lengths=(0.1, 0.1), friction=0.5, on=on),
        lambda on: rbd.SurfaceContact("it", "box", half_lengths=(0.1, 0.1), friction=0.0, on=on),
    ],
)
def test_a_motion_says_what_a_contact_without_ground_stands_on(kind: object) -> None:
    """Once a run; not where that is the floor, nor of contacts that cannot break."""
    box = rbd.testing.box()
    air, floor = (rbd.State(box, [0, 0, z, 0, 0, 0, 1]) for z in (0.02, 0.0))
    settings = {"duration": 2e-3, "step": 1e-3}
    with pytest.warns(DistantContactWarning, match="box have no ground.*'it' on z = 0.02 m") as told:
        rbd.simulate(air, [kind(None)], **settings)  # type: ignore[operator]
    assert len(told) == 1
    with pytest.warns(DistantContactWarning, match="'it' on z = 0.02 m"):
        rbd.simulate(air, [kind(rbd.Ground(velocity=(0.1, 0, 0)))], **settings)  # type: ignore[operator]
    rbd.simulate(floor, [kind(None)], **settings)  # type: ignore[operator]
    rbd.simulate(air, [kind(0.0)], **settings)  # type: ignore[operator]
    rbd.simulate(air, [kind(0.02)], **settings)  # type: ignore[operator]
    rbd.simulate(air, [rbd.PointContact("held", "box")], **settings)
    rbd.solve(air, np.zeros(0), [kind(None)])  # type: ignore[operator]


def test_the_plane_of_a_leaning_contact_without_ground_is_said() -> None:
    """Its point and its normal."""
    box = rbd.testing.box()
    half = 0.1
    leaning = rbd.State(box, [0, 0, 0.5, 0, np.sin(half), 0, np.cos(half)])
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.1, 0.1), friction=0.5)
    plane = r"'face' on the plane through \(0, 0, 0.5\) m with the normal \(0.199, 0, 0.98\)"
    with pytest.warns(DistantContactWarning, match=plane):
        rbd.simulate(leaning, [face], duration=2e-3, step=1e-3)
