"""Solids: their masses and inertias against coal's, textbooks' and each other, joined, turned and refused."""

from __future__ import annotations

from collections.abc import Callable

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.robots import Box, Capsule, Cylinder, Plate, PointMass, Rod, Sphere
from rbd.robots.building.solids import Solid, joined

AT, RPY = (0.1, -0.2, 0.3), (0.4, -0.5, 0.6)
SHAPES = {
    "box": (Box((0.2, 0.3, 0.5), density=700.0), coal.Box(0.2, 0.3, 0.5)),
    "sphere": (Sphere(0.2, density=700.0), coal.Sphere(0.2)),
    "cylinder": (Cylinder(0.2, 0.7, density=700.0), coal.Cylinder(0.2, 0.7)),
    "capsule": (Capsule(0.2, 0.7, density=700.0), coal.Capsule(0.2, 0.7)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_solid_has_the_inertia_of_coals_shape(name: str) -> None:
    """Volume, mass and moments about the centre of mass, to rounding."""
    solid, shape = SHAPES[name]
    found = solid.mass_properties()
    assert found.mass == pytest.approx(700.0 * shape.computeVolume(), rel=1e-14)
    assert np.allclose(found.inertia, 700.0 * np.array(shape.computeMomentofInertiaRelatedToCOM()), rtol=1e-13, atol=0.0)
    assert not found.lever.any()


def test_a_capsule_is_what_its_points_say(rng: np.random.Generator) -> None:
    """The moments of a million random points in it, to half a percent: no formula is shared."""
    r, length = 0.2, 0.7
    points = rng.uniform(-1.0, 1.0, (1_000_000, 3)) * [r, r, length / 2.0 + r]
    beyond = np.maximum(np.abs(points[:, 2]) - length / 2.0, 0.0)
    x, y, z = points[points[:, 0] ** 2 + points[:, 1] ** 2 + beyond**2 < r * r].T
    found = Capsule(r, length, mass=1.0).mass_properties().inertia.diagonal()
    assert found == pytest.approx([np.mean(y * y + z * z), np.mean(x * x + z * z), np.mean(x * x + y * y)], rel=5e-3)


def test_thin_solids_are_limits_of_thick_ones() -> None:
    """A plate is a box of no height, a rod across a cylinder of no radius; a rod's own radius counts about its length."""
    plate, box = Plate((0.3, 0.2), mass=2.0), Box((0.3, 0.2, 1e-8), mass=2.0)
    assert np.allclose(plate.mass_properties().inertia, box.mass_properties().inertia, rtol=1e-12, atol=1e-16)
    rod, cylinder = Rod((0, 0, -0.5), (0, 0, 0.5), mass=3.0, radius=1e-8), Cylinder(1e-8, 1.0, mass=3.0)
    assert np.allclose(rod.mass_properties().inertia, cylinder.mass_properties().inertia, rtol=1e-12, atol=1e-22)
    assert Rod((0, 0, 0), (2, 0, 0), mass=3.0).mass_properties().inertia[0, 0] == pytest.approx(3.0 * 0.02**2 / 2.0)
    assert Rod((0, 0, 0), (0, 2, 0), density=1.5).kilograms == pytest.approx(3.0)
    assert Plate((2.0, 3.0), density=1.5).kilograms == pytest.approx(9.0)


def test_a_turned_solid_is_pinocchios_turned_inertia() -> None:
    """`at` and `rpy` as an SE3 acts on an inertia; a rod is along the line between its ends."""
    X = pin.SE3(pin.rpy.rpyToMatrix(*RPY), np.array(AT))
    for solid in (Box((0.2, 0.3, 0.5), mass=4.0, at=AT, rpy=RPY), Capsule(0.1, 0.4, mass=4.0, at=AT, rpy=RPY)):
        found = solid.mass_properties()
        own = type(solid)(**{**solid.__dict__, "at": (0, 0, 0), "rpy": (0, 0, 0)}).mass_properties()
        expected = X.act(pin.Inertia(own.mass, own.lever, own.inertia))
        assert np.allclose(found.lever, expected.lever, atol=1e-15)
        assert np.allclose(found.inertia, expected.inertia, atol=1e-15)
    start, end = np.array([0.1, 0.2, 0.3]), np.array([0.4, -0.1, 0.5])
    for rod in (Rod(start, end, mass=2.0), Rod(end, start, mass=2.0), Rod((0, 0, 0), (0, 0, -1), mass=1.0)):
        _, rpy = rod.place()
        R = pin.rpy.rpyToMatrix(np.array(rpy))
        assert np.allclose(R[:, 2] * rod.length, np.subtract(rod.end, rod.start), atol=1e-15)
        small, middle, large = np.linalg.eigvalsh(rod.mass_properties().inertia)
        assert middle == pytest.approx(large) == pytest.approx(rod.kilograms * rod.length**2 / 12.0)
        assert small == pytest.approx(rod.kilograms * (0.01 * rod.length) ** 2 / 2.0)


def test_joined_solids_are_joined_inertias(rng: np.random.Generator) -> None:
    """As Pinocchio adds them; a dumbbell of point masses is m1 m2 / (m1 + m2) d^2; shapes without mass weigh nothing."""
    dumbbell = joined([PointMass(2.0, at=(1, 0, 0)), PointMass(3.0, at=(-1, 0, 0)), Box((1, 1, 1), at=(9, 9, 9))])
    assert (dumbbell.mass, dumbbell.lever.tolist()) == (5.0, pytest.approx([-0.2, 0.0, 0.0]))
    assert np.allclose(dumbbell.inertia, np.diag([0.0, 1.2, 1.2]) * 4.0, atol=1e-15)
    solids: list[Solid] = [Sphere(0.1, mass=m, at=rng.normal(size=3), rpy=rng.normal(size=3)) for m in (1.0, 2.0)]
    solids += [Box((0.1, 0.2, 0.3), mass=m, at=rng.normal(size=3), rpy=rng.normal(size=3)) for m in (0.5, 0.7)]
    total = pin.Inertia.Zero()
    for solid in solids:
        one = solid.mass_properties()
        total += pin.Inertia(one.mass, one.lever, one.inertia)
    found = joined(solids)
    assert found.mass == pytest.approx(total.mass)
    assert np.allclose(found.lever, total.lever, atol=1e-14) and np.allclose(found.inertia, total.inertia, atol=1e-14)


def test_a_solid_is_drawn_and_touches_where_it_weighs(rng: np.random.Generator) -> None:
    """The shapes of the robot are in the file's place, of its size and colour; capsules, which no URDF reader knows, too."""
    b = rbd.RobotBuilder("shapes")
    solids = [
        Box((0.1, 0.2, 0.3), mass=1.0, at=AT, rpy=RPY, color="red"),
        Sphere(0.4, at=AT, color=(0.1, 0.2, 0.3), collides=False),
        Cylinder(0.05, 0.6, at=AT, rpy=RPY, draws=False),
        Capsule(0.07, 0.8, at=AT, rpy=RPY, color=(0.1, 0.2, 0.3, 0.5)),
        PointMass(0.5, at=AT),
        Plate((1.0, 2.0), draws=False, collides=False),
    ]
    b.body("all", *solids)
    robot = b.robot()
    drawn, touched = list(robot.visual_model.geometryObjects), list(robot.collision_model.geometryObjects)
    assert [type(g.geometry).__name__ for g in drawn] == ["Box", "Sphere", "Capsule", "Sphere"]
    assert [type(g.geometry).__name__ for g in touched] == ["Box", "Cylinder", "Capsule"]
    assert (drawn[2].geometry.radius, drawn[2].geometry.halfLength) == (0.07, 0.4)
    assert np.allclose(drawn[0].meshColor, [0.75, 0.22, 0.20, 1.0]) and np.allclose(drawn[2].meshColor, [0.1, 0.2, 0.3, 0.5])
    X = pin.SE3(pin.rpy.rpyToMatrix(*RPY), np.array(AT))
    assert all(shape.placement.isApprox(X, 1e-12) for shape in (drawn[0], drawn[2], *touched))
    assert not robot.collision_stand_ins


NONSENSE: dict[str, Callable[[], object]] = {
    "a negative mass": lambda: Box((1, 1, 1), mass=-1.0),
    "mass and density": lambda: Sphere(1.0, mass=1.0, density=2.0),
    "a mass that is no number": lambda: Sphere(1.0, mass=np.nan),
    "a radius of zero": lambda: Cylinder(0.0, 1.0, mass=1.0),
    "a length that is infinite": lambda: Capsule(0.1, np.inf, mass=1.0),
    "two sides": lambda: Box((1, 1), mass=1.0),  # type: ignore[arg-type]
    "a side of zero": lambda: Plate((1.0, 0.0), mass=1.0),
    "a rod of no length": lambda: Rod((1, 1, 1), (1, 1, 1), mass=1.0),
    "a rod with a place": lambda: Rod((0, 0, 0), (1, 1, 1), mass=1.0, at=(1, 0, 0)),
    "a point of no mass": lambda: PointMass(0.0),
    "a point of two masses": lambda: PointMass(1.0, mass=2.0),
    "an unknown colour": lambda: Sphere(1.0, color="gren"),
    "a colour above one": lambda: Sphere(1.0, color=(2.0, 0.0, 0.0)),
    "a place of two numbers": lambda: Sphere(1.0, at=(1.0, 2.0)),
    "a truth that is none": lambda: Sphere(1.0, draws="no"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("what", NONSENSE)
def test_nonsense_is_refused_by_name(what: str) -> None:
    """The message names the solid and its key, or the colour that was meant."""
    with pytest.raises(rbd.InputError, match="Box|Sphere|Cylinder|Capsule|Plate|Rod|PointMass"):
        NONSENSE[what]()
    if what == "an unknown colour":
        with pytest.raises(rbd.InputError, match="green"):
            NONSENSE[what]()
