"""The audit of contact forces: no alarm on exact answers, planted faults named with their contact, laws told apart."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from audit_scenes import FAULTS, consistent, falling, loaded, reversed_friction, robot, scenes, sliding, standing

import rbd
from rbd.audits import Record, Thresholds, audit, from_trajectory

SCENES = dict(scenes())


def box_record(force: tuple[float, float, float], *, v: float = 1.0, a: object = None, **more: object) -> Record:
    """A box of 1 kg that slides along x on one point below its centre, friction 0.5."""
    given = {"normals": [[0, 0, 1]], "friction": 0.5, "points": np.zeros((1, 3)), "forces": [force]} | more
    moved = np.array([[force[0], force[1], force[2] - 9.81, 0, 0, 0]]) if a is None else a
    return Record.of_arrays(
        rbd.testing.box(mass=1.0), t=[0.0], q=[[0, 0, 0, 0, 0, 0, 1]], v=[[v, 0, 0, 0, 0, 0]], a=moved, contact_at=[0],
        contact_bodies=["box"], **given,
    )  # fmt: skip


class TestPoints:
    """One point, by hand."""

    def test_sliding_friction_is_right(self):
        """Nothing is wrong with it."""
        report = audit(box_record((-4.905, 0.0, 9.81)))
        assert report.ok and report.obeys == "coulomb" and report.energy_made == 0.0
        assert report.laws.power == pytest.approx([-4.905])

    @pytest.mark.parametrize(
        ("force", "cause", "size"),
        [
            ((-6.0, 0.0, 9.81), "outside the cone", (6.0 - 4.905) * 0.8**0.5),
            ((0.0, 0.0, -3.0), "pulls", 3.0),
            ((-2.0, 0.0, 9.81), "creeps", 1.0),
            ((4.905, 0.0, 9.81), "friction not opposed", 180.0),
            ((4.905, 0.0, 9.81), "makes energy", 4.905),
            ((0.0, 4.905, 9.81), "friction not opposed", 90.0),
        ],
    )
    def test_a_fault_has_its_size(self, force, cause, size):
        """The distance to a cone of slope mu is (excess of friction) / sqrt(1 + mu^2)."""
        report = audit(box_record(force))
        assert report.points[cause] == pytest.approx([size])
        assert report.of_cause(cause).all() and not report.of_cause("balance").any()

    def test_a_force_at_a_distance_and_one_in_depth(self):
        """Gaps and depths in metres."""
        assert audit(box_record((0.0, 0.0, 9.81), v=0.0, gaps=[0.01])).points["pushes at a distance"] == [0.01]
        assert audit(box_record((0.0, 0.0, 9.81), v=0.0, gaps=[-0.02])).points["sinks"] == [0.02]

    def test_a_point_that_leaves_while_it_is_pushed(self):
        """A launched box: the convex law has it leave with mu |u_t|, Coulomb's law keeps it."""
        h, force = 0.01, (-40.0, 0.0, 80.0)
        v_x = 6.0 - 40.0 * h
        lifted = 0.5 * v_x  # of the convex law
        a = [[-40.0, 0.0, lifted / h, 0, 0, 0]]
        record = box_record(force, v=6.0, a=a, step=h)
        report, convex = audit(record), audit(record, law="convex")
        assert report.points["lifts"] == pytest.approx([lifted]) and report.laws.convex == pytest.approx([0.0], abs=1e-12)
        assert report.obeys == convex.obeys == "convex"
        assert convex.ranked == ("balance",) and not convex.points["lifts"].any()

    def test_unknown_friction_judges_the_rest(self):
        """Cones need a coefficient."""
        record = box_record((-6.0, 0.0, 9.81), friction=None)
        assert audit(record).ok and not audit(record, friction=0.5).ok

    def test_at_rest_the_acceleration_counts(self):
        """What begins to slide."""
        report = audit(box_record((2.0, 0.0, 9.81), v=0.0))
        assert report.points["creeps"] == pytest.approx([0.2])  # 2 m/s2 for 0.1 s


class TestExactAnswers:
    """`rbd`'s own."""

    @pytest.mark.parametrize("name", ["solo12", "talos", "g1", "anymal_c"])
    def test_no_alarm_on_a_thousand(self, name):
        """Of each robot 250 answers with random torques and pushes: sticking, slipping, leaving."""
        report = audit(standing(name, 250, 7))
        assert report.ok and report.obeys in ("coulomb", "both")
        assert report.missing_scaled.max() < 1e-11

    def test_no_alarm_on_motions(self):
        """With impacts, and joints that fold."""
        record = falling()
        report = audit(record)
        assert report.ok and report.obeys == "coulomb" and report.energy_made < 0.01 * report.energy_taken

    def test_a_body_that_tips_has_the_normals_of_its_ground(self):
        """A tall box that is pushed over slides and turns about an edge; its face is no longer level."""
        box = rbd.testing.box(mass=10.0, size=(0.2, 0.2, 0.8))
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.4]))
        face = rbd.SurfaceContact("face", "box", half_lengths=(0.1, 0.1), placement=place, friction=0.4, on=0.0)
        push = rbd.ExternalForce("box", (35.0, 0.0, 0.0), offset=(0.0, 0.0, 0.1))
        start = rbd.State(box, [0, 0, 0.4, 0, 0, 0, 1])
        run = rbd.simulate(start, [face], duration=0.6, step=2e-3, external=push, progress=False)
        record = from_trajectory(run, [face], external=push)
        assert abs(2.0 * run.q[-1, 4]) > 0.2 and (record.normals == [0.0, 0.0, 1.0]).all()
        assert audit(record).ok

    def test_the_law_gives_the_same_answer(self):
        """`rbd.solve`, from the record alone."""
        record = standing("solo12", 3, 11)
        report = audit(record)
        for i in range(record.n):
            assert report.answer(i).a == pytest.approx(record.a[i], abs=1e-9 * np.abs(record.a).max())

    def test_forces_that_are_not_unique_are_counted(self):
        """Two soles of four points each transmit two wrenches: 24 numbers of rank 12."""
        assert audit(standing("talos", 1, 3)).loose(0) == 12
        assert audit(standing("solo12", 1, 3)).loose(0) == 0

    def test_ranges_of_forces_are_those_of_the_answer(self):
        """A box on four corners: the record's ranges are those that `solution.uniqueness` proves."""
        box = rbd.testing.box(mass=10.0)
        floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.1), friction=0.6, on=0.0)
        push = rbd.ExternalForce("box", (10.0, 5.0, 0.0))
        solution = rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [floor], external=[push])
        corners = solution.uniqueness().contacts["floor"].corners
        found = audit(rbd.audits.from_solutions([solution])).ranges(0)
        assert found == pytest.approx(np.array([[each.lowest, each.highest] for each in corners]), abs=1e-4)
        assert (found[:, 1] - found[:, 0] > 10.0).all()

    def test_unique_forces_have_no_range(self):
        """Four feet that are points."""
        report = audit(standing("solo12", 1, 3))
        for side in (0, 1):
            assert report.ranges(0)[:, side] == pytest.approx(report.laws.push, abs=1e-4)


class TestPlantedFaults:
    """In twenty scenes, each named with its contact."""

    @pytest.mark.parametrize("scene", SCENES)
    def test_a_wrong_force_is_found(self, scene):
        """With the force that would balance."""
        record = SCENES[scene]()
        clean = audit(record)
        assert clean.ok
        i = loaded(record)
        words = {
            "scaled": "1.05 times",
            "turned": "turned by 20 degrees",
            "stale": "does not act",
            "friction sign": "wrong way",
        }
        for name, fault in FAULTS.items():
            report = audit(fault(record, i))
            found = report.explanations[0]
            assert (found.point, found.frames) == (i, (record.contact_at[i],)), name
            assert words.get(name, "would balance") in found.text
            assert found.force == pytest.approx((0.0,) * 3 if name == "stale" else record.forces[i], abs=1e-6)
            assert report.points["pulls"][i] > 0.0 or name != "pulling"

    @pytest.mark.parametrize("scene", [name for name in SCENES if name.startswith("box")])
    def test_energy_that_is_added_is_found(self, scene):
        """Friction along the motion where it takes most power, in an engine whose equation of motion holds."""
        record = SCENES[scene]()
        i = int(audit(record).laws.power.argmin())
        report = audit(consistent(record, reversed_friction(record, i)))
        assert not report.of_cause("balance").any()
        made = np.flatnonzero(report.points["makes energy"])
        assert made.tolist() == [i] and report.points["friction not opposed"][i] == pytest.approx(180.0, abs=5.0)
        assert report.energy_made > 0.0

    @pytest.mark.parametrize("scene", ["solo12 0", "g1 1", "two boxes"])
    def test_a_consistent_pull_is_found(self, scene):
        """In an engine whose equation of motion holds."""
        record = SCENES[scene]()
        i = loaded(record)
        report = audit(consistent(record, FAULTS["pulling"](record, i)))
        assert not report.of_cause("balance").any() and np.flatnonzero(report.points["pulls"]).tolist() == [i]


class TestConventions:
    """A record in another convention is told so."""

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda r: {"forces": -r.forces}, "change their signs"),
            (lambda r: {"forces": 0.7 * r.forces}, "0.7 times what balances"),
            (lambda r: {"q": np.column_stack([r.q[:, :3], np.roll(r.q[:, 3:7], 1, axis=1), r.q[:, 7:]])}, "w, x, y, z"),
            (lambda r: {"tau": r.tau * np.where(np.arange(18) < 6, 1.0, 0.5)}, "motor torques are missing"),
            (lambda r: {"tau": -r.tau}, "motor torques have the other sign"),
        ],
    )
    def test_it_is_named(self, change, words):
        """All frames have the same fault."""
        record = standing("solo12", 8, 2)
        report = audit(replace(record, **change(record)))
        assert words in report.explanations[0].text and report.of_cause("balance").any()

    def test_gravity_that_the_engine_has_not(self):
        """The motion is that without weight."""
        solo = robot("solo12")
        floating = solo.with_gravity((0, 0, 0))
        state = rbd.State(floating, solo.standing().q, 0.3 * np.ones(18))
        record = rbd.audits.from_solutions([rbd.solve(state, np.ones(12), [])])
        assert "no gravity" in audit(replace(record, robot=solo)).explanations[0].text

    @pytest.mark.parametrize("axes", ["mixed", "world"])
    def test_velocities_in_world_axes(self, axes):
        """A body that tumbles: the same motion in three conventions, and what is said where the wrong one is assumed."""
        box = rbd.testing.box(mass=2.0, size=(0.1, 0.2, 0.4))
        run = rbd.simulate(rbd.State(box, [0, 0, 1, 0, 0, 0, 1], [1, 2, 3, 4, 5, 6]), duration=0.3, step=0.01, progress=False)
        R = np.array([rbd.State(box, q).frame("box").X_WF.rotation for q in run.q])
        v, a = run.v.copy(), run.a.copy()
        a[:, :3] = np.einsum("nij,nj->ni", R, a[:, :3] + np.cross(v[:, 3:], v[:, :3]))
        v[:, :3] = np.einsum("nij,nj->ni", R, v[:, :3])
        if axes == "world":
            v[:, 3:], a[:, 3:] = (np.einsum("nij,nj->ni", R, x[:, 3:]) for x in (v, a))
        arrays = {"t": run.t, "q": run.q, "v": v, "a": a}
        assert audit(Record.of_arrays(box, **arrays, base_velocity=axes)).missing_scaled.max() < 1e-12
        wrong = audit(Record.of_arrays(box, **arrays))
        assert f"base_velocity='{axes}'" in wrong.explanations[0].text

    def test_forces_in_the_contacts_axes(self):
        """Normal first, as MuJoCo gives them."""
        record = sliding(0.5, 1.0, 0.2)
        push = np.einsum("ki,ki->k", record.forces, record.normals)  # with axes as MuJoCo makes them: z, y, -x
        other = np.column_stack([push, record.forces[:, 1], -record.forces[:, 0]])
        assert "normal first" in audit(replace(record, forces=other)).explanations[0].text


def test_thresholds_decide():
    record = box_record((-4.7, 0.0, 9.81))
    assert audit(record).ranked == ("creeps",)
    assert audit(record, thresholds=Thresholds(cone=0.05)).ok


def test_the_report_says_it_all():
    record = sliding()
    text = str(audit(FAULTS["scaled"](record, loaded(record))))
    assert text.splitlines()[0].startswith("40 of 41 frames without a cause; judged by Coulomb's law;")
    for words in ("balance", "explained: the force at box", "contacts made", "thresholds: balance 0.0001", "not unique"):
        assert words in text


def test_an_answer_that_the_law_does_not_give_says_why():
    with pytest.raises(rbd.InputError, match="friction of point 0 in frame 0 is not known"):
        audit(box_record((0.0, 0.0, 9.81), friction=None)).answer(0)


def test_a_thousand_steps_are_judged_within_seconds(exhaustive):
    """The cost is told by `make bench`; here, that a long record goes through in blocks, as its parts do."""
    record = standing("solo12", 30, 5)
    many = 1000 if exhaustive else 50
    fields = {name: np.concatenate([getattr(record, name)] * many) for name in ("q", "v", "a", "tau", "step")}
    points = {
        n: np.concatenate([getattr(record, n)] * many)
        for n in ("contact_bodies", "points", "normals", "friction", "forces", "gaps")
    }
    at = np.concatenate([record.contact_at + record.n * j for j in range(many)])
    whole = replace(record, t=0.01 * np.arange(record.n * many), contact_at=at, **fields, **points)
    with warnings.catch_warnings(action="error"):
        missing = audit(whole).missing
    assert np.array_equal(missing[-record.n :], audit(record).missing)
