"""Feet stand on planes that are known; what is off its plane is named; pictures and motions use the plane."""

from __future__ import annotations

import warnings

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.cli.app import app
from rbd.errors import DistantContactWarning
from rbd.problem.ground import FLOOR, TOUCHES
from rbd.testing import box
from rbd.visual.marks.contacts import ground_under, shown_forces, support_outline, support_polygon

G = 9.81


def raised(state: rbd.State, height: float) -> rbd.State:
    """The same robot, higher up by so much [m]."""
    q = state.q.copy()
    q[2] += height
    return rbd.State(state.robot, q, state.v)


def turned(X: pin.SE3, state: rbd.State) -> rbd.State:
    """The same robot, moved as a whole; at rest."""
    q = state.q.copy()
    q[:7] = pin.SE3ToXYZQUAT(X * pin.XYZQUATToSE3(q[:7]))
    return rbd.State(state.robot, q)


def silent(call, *args, **given):
    """What a call gives that must not warn of distance."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DistantContactWarning)
        return call(*args, **given)


class TestDoors:
    """Who warns, and of what."""

    def test_soles_in_the_air_are_named_with_their_gap(self, talos):
        """A metre up: every door that solves says so, on the caller's line, once."""
        state, soles = talos.standing(), talos.soles()
        tau, high = rbd.hold(state, soles).tau, raised(state, 1.0)
        told = r"talos.*'left_sole' 1000 mm above, 'right_sole' 1000 mm above.*on=0\.75"
        for door in (
            lambda: rbd.hold(high, soles),
            lambda: rbd.solve(high, tau, soles),
            lambda: rbd.solve(high, tau, talos.soles(None), solver=rbd.KKT()),
            lambda: rbd.solve(high, tau, soles, solver=rbd.ConeSolver()),
            lambda: rbd.gauss_problem(high, tau, soles),
            lambda: rbd.studies.compare_laws(high, tau, soles),
            lambda: rbd.studies.compare_solvers(high, tau, soles),
        ):
            with pytest.warns(DistantContactWarning, match=told) as seen:
                door()
            assert len(seen) == 1 and seen[0].filename == __file__

    def test_a_millimetre_is_the_limit(self, talos):
        """0.9 mm above and below: nothing; 1.1 mm: named, above or below."""
        state, tau = talos.standing(), np.zeros(talos.nu)
        for off in (0.9e-3, -0.9e-3):
            silent(rbd.solve, raised(state, off), tau, talos.soles())
        for off, word in ((1.1e-3, "1.1 mm above"), (-1.1e-3, "1.1 mm below")):
            with pytest.warns(DistantContactWarning, match=f"'left_sole' {word}"):
                rbd.solve(raised(state, off), tau, talos.soles())

    def test_one_corner_is_enough(self, talos):
        """Tilted by 15 mrad about its heel line two corners of each sole are off, one by one."""
        state = talos.standing()
        X = pin.SE3(pin.exp3(np.array([0.0, -0.015, 0.0])), np.array([0.0, 0.0, 1.5e-3]))
        rows = [sole.rows(turned(X, state)) for sole in talos.soles()]
        gaps = np.array([r.patch.gaps for r in rows])
        off = np.abs(gaps) > TOUCHES
        assert off.any() and not off.all()
        with pytest.warns(DistantContactWarning, match=f"'left_sole' \\({int(off[0].sum())} of 4 points\\)"):
            rbd.solve(turned(X, state), np.zeros(talos.nu), talos.soles())

    def test_point_feet(self):
        """Of a quadruped with one leg drawn in, that foot alone."""
        robot = rbd.load_robot("solo12")
        state = robot.standing()
        q = state.q.copy()
        knee = robot.model.joints[robot.model.getJointId("FL_KFE")].idx_q
        q[knee] -= 0.3
        with pytest.warns(DistantContactWarning) as seen:
            rbd.solve(rbd.State(robot, q), np.zeros(robot.nu), robot.feet())
        said = str(seen[0].message)
        assert "'front_left'" in said and "'front_right'" not in said and "hind" not in said

    def test_the_command_line_says_it(self, tmp_path):
        """`rbd stand` of a robot whose posture lifts a foot; and not a word where it stands."""
        from typer.testing import CliRunner

        assert "off the ground" not in CliRunner().invoke(app, ["stand", "talos"]).output

    def test_derivatives_and_fallbacks_do_not_warn_again(self, talos):
        """One warning for one call."""
        state = raised(talos.standing(), 0.5)
        with pytest.warns(DistantContactWarning):
            s = rbd.solve(state, np.zeros(talos.nu), talos.soles(None))
        silent(s.derivatives)


class TestPlanes:
    """What can be said of the ground."""

    def test_a_table_a_stair_and_nothing(self, talos):
        """A height for all, one a foot, a plane, or none."""
        state, tau = talos.standing(), np.zeros(talos.nu)
        silent(rbd.solve, raised(state, 0.75), tau, talos.soles(on=0.75))
        silent(rbd.solve, raised(state, 0.75), tau, talos.soles(on=rbd.Ground(point=(3.0, 2.0, 0.75))))
        silent(rbd.solve, raised(state, 0.75), tau, talos.soles(on=None))
        silent(rbd.solve, raised(state, 0.17), tau, talos.soles(on={"left_sole": 0.17, "right_sole": 0.17}))
        with pytest.warns(DistantContactWarning, match="'left_sole' 170 mm below") as seen:
            rbd.solve(state, tau, talos.soles(on={"left_sole": 0.17}))
        assert "right" not in str(seen[0].message).split(". Move")[0]
        with pytest.warns(DistantContactWarning, match="'right_sole' 170 mm above"):
            rbd.solve(raised(state, 0.17), tau, talos.soles(on={"left_sole": 0.17}))

    def test_a_ramp(self, talos):
        """The whole robot turned with its ground: every gap stays zero, and a shift along the normal is told in full."""
        X = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.3, 0.5), np.array([0.3, -0.2, 0.4]))
        ramp = rbd.Ground(point=X.translation, normal=X.rotation[:, 2])
        state, tau = talos.standing(), np.zeros(talos.nu)
        silent(rbd.solve, turned(X, state), tau, talos.soles(on=ramp))
        assert all(np.abs(s.rows(turned(X, state)).patch.gaps).max() < 1e-12 for s in talos.soles(on=ramp))
        off = pin.SE3(np.eye(3), 0.02 * X.rotation[:, 2]) * X
        with pytest.warns(DistantContactWarning, match="'left_sole' 20 mm above"):
            rbd.solve(turned(off, state), tau, talos.soles(on=ramp))

    def test_contacts_by_hand(self):
        """Points, edges and faces that are told their plane; without, nothing is known and nothing is said."""
        robot = box(mass=3.0)
        state = rbd.State(robot, np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
        for make in (
            lambda **on: rbd.PointContact("it", "box", offset=(0.1, 0.0, -0.1), friction=0.5, **on),
            lambda **on: rbd.LineContact("it", "box", half_length=0.1, placement=below, **on),
            lambda **on: rbd.SurfaceContact("it", "box", half_lengths=(0.1, 0.1), placement=below, **on),
        ):
            silent(rbd.solve, state, np.zeros(0), [make()])
            silent(rbd.solve, state, np.zeros(0), [make(on=0.4)])
            assert make().rows(state).patch.gaps is None
            assert make(on=0.3).rows(state).patch.gaps == pytest.approx(0.1)
            with pytest.warns(DistantContactWarning, match="'it' 100 mm above"):
                rbd.solve(state, np.zeros(0), [make(on=0.3)])

    def test_a_ball_off_its_plane(self):
        """Balls, disks and wheels have told their plane all along."""
        robot = box(mass=3.0)
        state = rbd.State(robot, np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
        for kind in (rbd.RollingBall, rbd.RollingDisk):
            silent(rbd.solve, state, np.zeros(0), [kind("it", "box", radius=0.5, friction=0.5)])
            with pytest.warns(DistantContactWarning, match="'it' 300 mm above"):
                rbd.solve(state, np.zeros(0), [kind("it", "box", radius=0.2, friction=0.5)])

    def test_an_anchor_is_a_place_on_the_ground(self):
        """A contact that is above where it first touched does not touch; one that slid along the ground does."""
        robot = box(mass=3.0)
        state = rbd.State(robot, np.array([0.4, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
        silent(rbd.solve, state, np.zeros(0), [rbd.PointContact("it", "box", friction=0.5, anchor=(0.0, 0.0, 0.5))])
        with pytest.warns(DistantContactWarning, match="'it' 500 mm above"):
            rbd.solve(state, np.zeros(0), [rbd.PointContact("it", "box", friction=0.5, anchor=(0.0, 0.0, 0.0))])
        pulled = rbd.constraints.Baumgarte(10.0).of(rbd.PointContact("it", "box", anchor=(0.0, 0.0, 0.0)))
        silent(rbd.solve, state, np.zeros(0), [pulled])  # its feedback is there to bring it back

    def test_a_normal_is_that_of_the_plane(self):
        """Of a point and of an edge on a ramp."""
        n = np.array([0.6, 0.0, 0.8])
        ramp = rbd.Ground(normal=n, point=(0.0, 0.0, 0.0))
        assert rbd.PointContact("it", "box", on=ramp).normal == pytest.approx(n)
        assert rbd.LineContact("it", "box", half_length=0.1, on=ramp).normal == pytest.approx(n)
        assert rbd.PointContact("it", "box", on=ramp).on is ramp
        for word in ("normal", "against"):  # nothing else can contradict it: what is touched is one argument
            with pytest.raises(TypeError, match=word):
                rbd.PointContact("it", "box", on=ramp, **{word: (0, 0, 1)})

    @pytest.mark.parametrize("wrong", ["floor", True, np.nan, np.inf, (0, 0, 1), rbd.Ground])
    def test_what_is_no_plane_is_refused(self, talos, wrong):
        """By contacts and by robots."""
        with pytest.raises(rbd.InputError, match=r"on of .* expected rbd\.Ground"):
            rbd.PointContact("it", "box", on=wrong)
        with pytest.raises(rbd.InputError, match=r"on of .* expected rbd\.Ground"):
            talos.soles(on=wrong)

    def test_feet_that_are_none_are_refused(self, talos):
        """With the nearest names."""
        with pytest.raises(rbd.errors.UnknownName, match=r"'left_sol'.*'left_sole'"):
            talos.soles(on={"left_sol": 0.1})

    @pytest.mark.parametrize("given", [{"normal": (0, 0, 2)}, {"point": (0, 0)}, {"point": (0, 0, np.nan)}, {"normal": "up"}])
    def test_a_ground_that_is_none(self, given):
        """Numbers that are no plane."""
        with pytest.raises(rbd.InputError, match="ground"):
            rbd.Ground(**given)

    def test_distances_against_their_definition(self, rng):
        """Distance n . (p - point), and the height under a point."""
        n = np.array([0.6, 0.0, 0.8])
        plane = rbd.Ground(point=(1.0, 2.0, 3.0), normal=n)
        points = rng.normal(size=(5, 3))
        assert plane.distances(points) == pytest.approx([n @ (p - [1.0, 2.0, 3.0]) for p in points])
        for x, y, _ in points:
            assert n @ (np.array([x, y, plane.below(x, y)]) - [1.0, 2.0, 3.0]) == pytest.approx(0.0, abs=1e-12)
        assert plane.same(rbd.Ground(point=(1.8, -5.0, 2.4), normal=n)) and not plane.same(FLOOR)

    def test_two_robots(self, talos):
        """The second robot's ground moves with its world."""
        up = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.5]))
        pair = rbd.robots.merge_robots(talos, talos, placement=up)
        state, feet = pair.standing(), pair.feet()
        silent(rbd.solve, state, np.zeros(pair.nu), feet)
        assert [c.rows(state).patch.on.height for c in feet] == pytest.approx([0.0, 0.0, 0.5, 0.5])

    def test_soles_from_collision(self, talos):
        """Their plane is z = 0 too, unless told."""
        frames = ["leg_left_6_link", "leg_right_6_link"]
        soles = talos.soles_from_collision(frames)
        silent(rbd.solve, talos.standing(), np.zeros(talos.nu), soles)
        with pytest.warns(DistantContactWarning):
            rbd.solve(raised(talos.standing(), 0.1), np.zeros(talos.nu), soles)
        silent(rbd.solve, raised(talos.standing(), 0.1), np.zeros(talos.nu), talos.soles_from_collision(frames, on=0.1))

    def test_the_bound_is_no_more_than_a_bound(self, rng):
        """`touches` answers as the gaps do, for patches of all sizes, tilts and heights."""
        robot = box(mass=3.0)
        answers = set()
        for _ in range(300):
            X = pin.SE3(pin.exp3(rng.normal(size=3) * 10.0 ** rng.uniform(-6, -1)), np.array([0, 0, rng.normal() * 1e-3]))
            corners = rng.normal(size=(4, 3)) * [1.0, 1.0, rng.choice([0.0, 1e-3])]
            tilted = rbd.Ground(point=(0, 0, 0), normal=np.array([1e-3, 0, 1.0]) / np.hypot(1e-3, 1.0))
            on = FLOOR if rng.random() < 0.7 else tilted
            patch = rbd.SurfaceContact("it", "box", corners=corners, on=on).rows(rbd.State(robot, pin.SE3ToXYZQUAT(X))).patch
            assert patch.touches == (np.abs(patch.gaps).max() <= TOUCHES)
            answers.add(patch.touches)
        assert answers == {True, False}


class TestMotion:
    """`rbd.simulate` has the same ground."""

    def test_feet_fall_onto_their_plane(self):
        """A robot let go 5 cm above a table of 0.75 m: its feet fall for sqrt(2 h / g), and strike there."""
        robot = rbd.load_robot("solo12")
        start = raised(robot.standing(), 0.75 + 0.05)
        moved = silent(rbd.simulate, start, robot.feet(0.7, on=0.75), duration=0.12, step=1e-3, progress=False)
        first = next(e for e in moved.events if "front" in e.name or "hind" in e.name)
        assert first.t == pytest.approx(np.sqrt(2 * 0.05 / G), abs=1e-5)

    def test_standing_it_stands(self, talos):
        """On the plane the motion is what it was: held, it does not move."""
        state, soles = talos.standing(), talos.soles()
        moved = rbd.simulate(
            state, soles, duration=0.02, step=2e-3, controller=rbd.control.HoldPosture(state, soles), progress=False
        )
        assert np.abs(moved.q[-1] - state.q).max() < 1e-9

    def test_a_ramp_is_the_plane_that_was_told(self):
        """A block a centimetre above a slope of 0.3 rad, not turned with it, strikes it with one edge first."""
        robot, n = box(mass=1.0, size=(0.2, 0.2, 0.2)), np.array([np.sin(0.3), 0.0, np.cos(0.3)])
        ramp = rbd.Ground(normal=n, point=(0.0, 0.0, 0.0))
        sole = rbd.SurfaceContact(
            "sole", "box", half_lengths=(0.1, 0.1), placement=pin.SE3(np.eye(3), np.array([0, 0, -0.1])), friction=0.5, on=ramp
        )
        lowest = 0.01 / n[2] + 0.1 * np.tan(0.3)
        start = rbd.State(robot, np.array([0.0, 0.0, 0.1 + lowest, 0, 0, 0, 1.0]))
        moved = rbd.simulate(start, [sole], duration=0.06, step=1e-3, progress=False)
        assert moved.events[0].t == pytest.approx(np.sqrt(2 * 0.01 / n[2] / G), abs=1e-5)

    def test_below_its_plane_or_held_in_the_air_is_named(self, talos):
        """What would be pushed out of the ground, and what is held where there is none; what may fall is not."""
        state = talos.standing()
        given = {"duration": 0.002, "step": 1e-3, "progress": False}
        with pytest.warns(DistantContactWarning, match="'left_sole' 20 mm above"):
            rbd.simulate(raised(state, 0.02), talos.soles(None), **given)
        with pytest.warns(DistantContactWarning, match="'left_sole' 2 mm below") as seen:
            rbd.simulate(raised(state, -0.002), talos.soles(), **given)
        assert seen[0].filename == __file__
        silent(rbd.simulate, raised(state, 0.02), talos.soles(), **given)


class TestPictures:
    """The support polygon lies on the plane."""

    @pytest.mark.parametrize("height", [0.0, 0.75])
    def test_on_a_table(self, talos, height):
        """All corners of the polygon, and the mark below the centre of mass, at the table's height."""
        state = raised(talos.standing(), height)
        held = rbd.hold(state, talos.soles(on=height))
        outline = support_outline(shown_forces(held))
        assert outline[:, :2] == pytest.approx(support_polygon(shown_forces(held))) and len(outline) > 3
        assert outline[:, 2] == pytest.approx(height) and ground_under(state.com, shown_forces(held)) == pytest.approx(height)

    def test_on_a_ramp_and_where_nothing_is_known(self, talos):
        """On the ramp each corner lies in its plane, also where the plane is not told and the soles alone show it."""
        X = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.1, 0.0), np.array([0.3, -0.2, 0.4]))
        ramp = rbd.Ground(point=X.translation, normal=X.rotation[:, 2])
        state = turned(X, talos.standing())
        outline = support_outline(shown_forces(rbd.solve(state, np.zeros(talos.nu), talos.soles(on=ramp))))
        assert len(outline) and np.abs(ramp.distances(outline)).max() < 1e-12
        outline = support_outline(shown_forces(rbd.solve(state, np.zeros(talos.nu), talos.soles(on=None))))
        assert len(outline) and np.abs(ramp.distances(outline)).max() < 1e-9

    def test_in_the_scene(self, talos):
        """The marks that are drawn."""
        from rbd.visual import Scene

        state = raised(talos.standing(), 0.75)
        scene = Scene(talos)
        scene.show(state, rbd.hold(state, talos.soles(on=0.75)))
        at = {mark.path: mark.points[:, 2] for mark in scene.drawn}
        assert at["support/area"] == pytest.approx(0.75, abs=0.01)
        assert at["com/on_the_ground"] == pytest.approx(0.75, abs=0.02)

    def test_shapes_on_a_table(self, talos):
        """Collision contacts know their plane too."""
        state = raised(talos.standing(), 0.75)
        ground = rbd.CollisionContacts(
            "ground", talos, ground=["leg_left_6_link", "leg_right_6_link"], on=rbd.Ground(point=(0.0, 0.0, 0.75)), friction=0.7
        )
        outline = support_outline(shown_forces(silent(rbd.solve, state, np.zeros(talos.nu), [ground])))
        assert len(outline) > 2 and outline[:, 2] == pytest.approx(0.75)
