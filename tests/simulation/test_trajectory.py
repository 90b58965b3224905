"""What a trajectory keeps of a motion that is known in closed form."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest
from falling import CORNERS, GRAVITY, HALF, MASS, ODD_NAME, WEIGHT, falling

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.simulation.recording import Recording
from rbd.simulation.simulated_motion import ConstraintForce, Sample
from rbd.simulation.trajectory import Trajectory
from rbd.simulation.trajectory_fields import COLUMNS, WORDS

NAMES = ("floor", "stop", ODD_NAME)


@pytest.fixture(scope="module")
def fall() -> Trajectory:
    motion, moments, events = falling()
    return Trajectory.of(motion, moments, events, "ByHand()", 0.09)


def test_a_fall_keeps_its_energy_and_gains_momentum(fall: Trajectory):
    """Until it lands, T + V = m g z0 and p = -m g t; after it, V = m g z alone."""
    falls = fall.t < fall.t[-1] / 2.0
    t = fall.t[falls]
    assert fall.energy[falls] == pytest.approx(MASS * GRAVITY * (1.0 + HALF), abs=1e-12 * 100)
    assert fall.kinetic[falls] == pytest.approx(0.5 * MASS * (GRAVITY * t) ** 2, abs=1e-12)
    assert fall.momentum[falls, 2] == pytest.approx(-WEIGHT * t, abs=1e-12) and not fall.momentum[:, [0, 1, 3, 4, 5]].any()
    assert fall.com[falls, 2] == pytest.approx(1.0 + HALF - 0.5 * GRAVITY * t**2, abs=1e-14)
    assert fall.energy[~falls] == pytest.approx(WEIGHT * HALF, abs=1e-12) and not fall.momentum[~falls].any()


def test_what_changes_its_number_of_points_is_padded(fall: Trajectory):
    """No point while it falls, four when it lies: NaN and zero force where there is none; a sample has those that are there."""
    assert fall.points["floor"].shape == fall.point_forces["floor"].shape == (11, 4, 3)
    assert np.isnan(fall.points["floor"][:5]).all() and not fall.point_forces["floor"][:5].any()
    np.testing.assert_array_equal(fall.points["floor"][-1], CORNERS)
    assert fall[0].points["floor"].shape == (0, 3) and fall[-1].points["floor"].shape == (4, 3)
    assert fall[-1].point_forces["floor"].sum(axis=0) == pytest.approx([0.0, 0.0, WEIGHT])
    assert fall.contacts == ("floor", ODD_NAME)


def test_what_never_acts_has_an_entry(fall: Trajectory):
    """Zero rows, always open; a constraint with less rows at one time than at another has zeros there."""
    assert fall.names == ("floor", "stop", ODD_NAME)
    assert fall.forces["stop"].shape == (11, 0) and set(fall.modes["stop"]) == {"open"}
    assert fall.forces[ODD_NAME][0] == pytest.approx([0, 1, 2]) and not fall.forces[ODD_NAME][-1].any()
    assert list(fall.modes["floor"]) == ["open"] * 5 + ["sticks"] * 6


def test_rows_that_come_and_go_are_padded_with_zeros():
    """A limit with one row, then two, then none."""
    motion, moments, _ = falling(n=3)
    rows = [np.array([1.0]), np.array([2.0, 3.0]), np.zeros(0)]
    for i, force in enumerate(rows):
        moments[i] = dataclasses.replace(
            moments[i], constraint_forces=lambda force=force: {"stop": ConstraintForce(force, "pushes")}
        )
    kept = Trajectory.of(motion, moments)
    np.testing.assert_array_equal(kept.forces["stop"], [[1, 0], [2, 3], [0, 0]])
    assert kept.contacts == () and list(kept.modes["floor"]) == ["open"] * 3


def test_forces_are_asked_once_a_sample():
    """They are expensive."""
    motion, moments, _ = falling(n=4)
    asked = []
    moments = [
        dataclasses.replace(m, constraint_forces=lambda m=m: asked.append(m.t) or m.constraint_forces()) for m in moments
    ]
    Trajectory.of(motion, moments)
    assert asked == [m.t for m in moments]


def test_what_is_not_finite_stops_the_recording():
    """A NaN in the acceleration, in a force, in a residual: NoSolution, and the moments before it are kept."""
    motion, moments, _ = falling(n=4)
    for bad in (
        {"a": np.full(6, np.nan)},
        {"law": math.nan},
        {"constraint_forces": lambda: {"floor": ConstraintForce(np.array([0.0, 0.0, np.inf]), "sticks")}},
    ):
        recording = Recording(motion)
        recording.add(moments[0])
        with pytest.raises(rbd.NoSolution, match=r"t = 0\.3.* not finite"):
            recording.add(dataclasses.replace(moments[1], **bad))
        recording.add(moments[1])
        kept = Trajectory.of(motion, recording)
        assert len(kept) == 2 and kept.forces["floor"].shape == (2, 3)


def test_the_culprit_is_named():
    """The force of the constraint that is not finite."""
    motion, moments, _ = falling(n=2)
    forces = {"floor": ConstraintForce(np.ones(3), "sticks"), "stop": ConstraintForce(np.array([np.nan]), "pushes")}
    with pytest.raises(rbd.NoSolution, match="at t = 0 s a number is not finite: forces of 'stop'"):
        Recording(motion).add(dataclasses.replace(moments[0], constraint_forces=lambda: forces))


def test_an_integrator_may_use_its_arrays_again():
    """What was recorded does not change with them."""
    motion, moments, _ = falling(n=2)
    force, a = np.array([0.0, 0.0, 5.0]), np.zeros(6)
    recording = Recording(motion)
    recording.add(dataclasses.replace(moments[0], a=a, constraint_forces=lambda: {"floor": ConstraintForce(force, "sticks")}))
    force[:], a[:] = 7.0, 7.0
    kept = Trajectory.of(motion, recording)
    assert kept.forces["floor"][0] == pytest.approx([0, 0, 5]) and not kept.a.any()


def test_indexing_and_slicing(fall: Trajectory):
    """As a list of samples; a slice is a trajectory, with the events between its ends."""
    assert len(fall) == 11 and len(list(fall)) == 11
    last = fall[-1]
    assert isinstance(last, Sample) and last.t == fall.t[-1] and last.modes["floor"] == "sticks"
    np.testing.assert_array_equal(last.state.q, fall.q[-1])
    assert (last.law, last.drift, last.penetration) == (fall.residuals["law"][-1], 0.0, fall.residuals["penetration"][-1])
    assert fall[5].events == fall.events and fall[4].events == fall[6].events == fall[0].events == ()
    part = fall[3:9:2]
    assert isinstance(part, Trajectory) and len(part) == 3 and part.events == fall.events and part.step == fall.step
    np.testing.assert_array_equal(part.t, fall.t[3:9:2])
    np.testing.assert_array_equal(part.points["floor"], fall.points["floor"][3:9:2])
    np.testing.assert_array_equal(part.residuals["penetration"], fall.residuals["penetration"][3:9:2])
    assert fall[:3].events == () and part.forces["floor"].base is not None  # no copy
    for wrong in (11, -12):
        with pytest.raises(IndexError, match="with 11"):
            fall[wrong]
    for wrong in (1.5, "floor", True, None):
        with pytest.raises(rbd.InputError, match="whole number or a slice"):
            fall[wrong]
    for wrong in (slice(5, 5), slice(None, None, -1)):
        with pytest.raises(rbd.InputError, match="no samples, or goes back"):
            fall[wrong]


def test_between_two_samples_it_is_interpolated(fall: Trajectory):
    """Between them q goes along its manifold, v linearly: exact in v in free fall, and in q to 1/8 g dt^2."""
    for i in (0, 4, 10):
        np.testing.assert_array_equal(fall.at(fall.t[i]).q, fall.q[i])
    dt = fall.t[1]
    middle = fall.at(1.5 * dt)
    assert middle.v[2] == pytest.approx(-GRAVITY * 1.5 * dt, rel=1e-14)
    exact = 1.0 + HALF - 0.5 * GRAVITY * (1.5 * dt) ** 2
    assert exact - middle.q[2] == pytest.approx(GRAVITY * dt**2 / 8.0, rel=1e-10)
    for wrong in (-0.1, 2.0, math.nan, "now"):
        with pytest.raises(rbd.InputError, match=r"from 0 to 0\.903"):
            fall.at(wrong)


def test_half_way_of_a_turn_is_half_the_angle():
    """The base turns by 1 rad about z between two samples: half-way it is at 0.5 rad, its quaternion of unit length."""
    motion, moments, _ = falling(n=2)
    turned = np.array([0, 0, HALF, 0, 0, math.sin(0.5), math.cos(0.5)])
    moments = [moments[0], dataclasses.replace(moments[1], q=turned)]
    kept = Trajectory.of(motion, moments)
    assert kept.at(kept.t[1] / 2.0).q[3:] == pytest.approx([0, 0, math.sin(0.25), math.cos(0.25)], abs=1e-14)


def test_nobody_writes_into_it(fall: Trajectory):
    """All arrays are read-only, those of slices too; the fields cannot be set."""
    for array in (fall.q, fall.t, fall.forces["floor"], fall.modes["floor"], fall[2:4].q, fall[2].v, fall.residuals["law"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        fall.step = 1.0


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("t", np.zeros(11), "increasing"),
        ("t", np.zeros(0), "one or more"),
        ("q", np.zeros((11, 6)), r"shape \(11, 6\)"),
        ("a", np.full((11, 6), np.nan), "not finite in sample 0"),
        ("com", None, "expected real numbers"),
        ("residuals", {"law": np.zeros(11)}, "expected law, drift"),
        ("forces", {"floor": np.zeros((11, 3))}, "same constraints"),
        ("modes", dict.fromkeys(NAMES, np.array(["open"] * 10)), r"'floor' are <U4 of shape \(10,\); expected 11 words"),
        ("modes", dict.fromkeys(NAMES, np.zeros(11)), "'floor' are float64 of .* 11 words"),
        ("events", ("bounce",), "Events"),
        ("law", None, "expected text"),
        ("step", math.nan, "expected seconds"),
        ("robot", "talos", "expected a robot"),
    ],
)
def test_parts_that_do_not_fit_are_refused(fall: Trajectory, field: str, value: object, told: str):
    """In words."""
    with pytest.raises(rbd.InputError, match=told):
        dataclasses.replace(fall, **{field: value})


def test_points_without_forces_are_refused(fall: Trajectory):
    """Of a contact that no constraint is named after."""
    points, pushes = fall.points | {"sky": np.zeros((11, 1, 3))}, fall.point_forces | {"sky": np.zeros((11, 1, 3))}
    with pytest.raises(rbd.InputError, match="contacts that have no forces"):
        dataclasses.replace(fall, points=points, point_forces=pushes)


def test_forces_at_points_that_are_not_told_are_left_out():
    """Of a constraint without points; what was recorded behind them is still what was given."""
    motion, moments, _ = falling(n=2)
    here = np.array([[0.2, 0.0, 0.0]])

    def forces() -> dict[str, ConstraintForce]:
        return {
            "stop": ConstraintForce(np.array([7.0]), "pushes", None, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])),
            "floor": ConstraintForce(np.array([0.0, 0.0, 8.0]), "sticks", here, np.array([[0.0, 0.0, 8.0]])),
        }

    kept = Trajectory.of(motion, [dataclasses.replace(m, constraint_forces=forces) for m in moments])
    assert kept.contacts == ("floor",)
    assert kept.forces["stop"].tolist() == [[7.0], [7.0]]
    assert kept.points["floor"].tolist() == [here.tolist()] * 2
    assert kept.point_forces["floor"][:, 0].tolist() == kept.forces["floor"].tolist() == [[0.0, 0.0, 8.0]] * 2


def test_no_moments_make_no_trajectory():
    """Nothing to keep."""
    with pytest.raises(rbd.InputError, match="none was recorded"):
        Trajectory.of(falling()[0], [])


def test_it_prints_its_certificate(fall: Trajectory):
    """How it was made, what it kept, its worst residuals with units, modes and events; on one screen."""
    text = str(dataclasses.replace(fall, interrupted="interrupted at t = 0.9 s"))
    for part in (
        "box: 0 to 0.903047 s by steps of 90 ms, 11 samples; interrupted at t = 0.9 s",
        "ByHand()",
        "107.91 J -> 9.81 J, change -98.1 J",
        "law 1.0e-12 (scaled) at 0 s",
        "penetration 1.0e-05 m or rad at 0.45",
        "floor    sticks at the end, at most 98.1 N at 0.4515 s",
        "stop     open at the end, no force",
        "4 events        0.451524 s: floor[0] touches at 4.43 m/s, impulse 11.1 N s",
    ):
        assert part in text
    assert max(map(len, text.splitlines())) < 120 and len(text.splitlines()) < 30
    assert repr(fall).startswith("Trajectory(box: 0 to 0.903047 s") and repr(fall[0]) == "Sample('box', t=0)"


def test_long_lists_of_events_are_cut(fall: Trajectory):
    """Eight, and how many more."""
    text = str(dataclasses.replace(fall, events=fall.events * 10))
    assert "40 events" in text and text.endswith("and 32 more")


def test_every_field_is_in_the_table_of_fields_or_has_a_form_of_its_own():
    """Files, datasets and checks go by the table: a new field that is not in it would not be saved."""
    names = [f.name for f in dataclasses.fields(Trajectory)]
    known = [*(c.name for c in COLUMNS), *WORDS]
    own = ["robot", "t", "forces", "points", "point_forces", "modes", "residuals", "events", "absent", "step", "elements"]
    own += ["pushed", "terrains", "driven", "friction", "planes"]
    assert sorted(names) == sorted(known + own)


def test_coordinates_have_names_and_units(talos: rbd.Robot):
    """One each for q, v and the motors; one-jointed ones are called like the joint."""
    q, v, tau = talos.joints.positions, talos.joints.velocities, talos.motor_coordinates
    assert (len(q), len(v), len(tau)) == (talos.nq, talos.nv, talos.nu)
    assert [c.name for c in q[:8]] == [*(f"root_joint.{x}" for x in ("x", "y", "z", "qx", "qy", "qz", "qw")), q[7].joint]
    assert [c.unit for c in v[:7]] == ["m"] * 3 + ["rad"] * 4 and tuple(c.name for c in tau) == talos.actuated_names
    planar = rbd.load_robot("tiago", root="planar")
    assert [c.name for c in planar.joints.positions[:4]] == [f"root_joint.{x}" for x in ("x", "y", "cos", "sin")]
    assert len(planar.joints.positions) == planar.nq and len({c.name for c in planar.joints.velocities}) == planar.nv


def test_joints_of_several_freedoms_name_each_of_them():
    """Balls, carriages and joints made of others: a name of its own for each entry, and the unit of what it measures."""
    model, at, wrist = pin.Model(), 0, pin.JointModelComposite()
    for part in (pin.JointModelRUBX(), pin.JointModelPZ(), pin.JointModelSpherical()):
        wrist.addJoint(part)
    for name, joint in (("ball", pin.JointModelSpherical()), ("carriage", pin.JointModelTranslation()), ("wrist", wrist)):
        at = model.addJoint(at, joint, pin.SE3.Identity(), name)
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    robot = CheckedModel(model, passive=("wrist",))
    quaternion, turns = [("qx", "1"), ("qy", "1"), ("qz", "1"), ("qw", "1")], [("wx", "rad"), ("wy", "rad"), ("wz", "rad")]
    assert [(c.name, c.unit) for c in robot.joints.positions] == [
        *((f"ball.{x}", unit) for x, unit in quaternion),
        *((f"carriage.{x}", "m") for x in "xyz"),
        ("wrist.0.cos", "1"), ("wrist.0.sin", "1"), ("wrist.1", "m"), *((f"wrist.2.{x}", unit) for x, unit in quaternion),
    ]  # fmt: skip
    assert [(c.name, c.unit) for c in robot.joints.velocities] == [
        *((f"ball.{x}", unit) for x, unit in turns),
        *((f"carriage.v{x}", "m") for x in "xyz"),
        ("wrist.0", "rad"), ("wrist.1", "m"), *((f"wrist.2.{x}", unit) for x, unit in turns),
    ]  # fmt: skip
    assert [c.name for c in robot.motor_coordinates] == [c.name for c in robot.joints.velocities[:6]]
