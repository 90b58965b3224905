"""Plots of motions: what is drawn, where, in which colour and unit."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import rbd
from rbd.simulation.simulated_motion import ConstraintForce, Event, Sample, SimulatedMotion
from rbd.simulation.trajectory import Trajectory
from rbd.testing import box
from rbd.visual.figures.trajectory_plots import plot_energy, plot_forces, plot_joint
from rbd.visual.style import contact_colors

N = 101
LOW, HIGH = 40, 60
"""Samples between which the box slips; before it, it sticks; after it, it is in the air."""


@dataclasses.dataclass(frozen=True)
class Named:
    """A constraint of which only the name is asked."""

    name: str


def sliding() -> Trajectory:
    """A 10 kg box on two points: it sticks, slips, leaves the ground; a gear with three rows acts all the while."""
    robot = box(10.0)
    state = rbd.State(robot, np.array([0.0, 0, 0.1, 0, 0, 0, 1]))

    def touches(k: int) -> dict[str, ConstraintForce]:
        mode = "sticks" if k < LOW else "slips" if k < HIGH else "open"
        force = np.zeros(3) if k >= HIGH else np.array([3.0, 4.0, 49.05])
        points = np.zeros((0 if k >= HIGH else 1, 3))
        both = {name: ConstraintForce(force, mode, points, np.tile(force, (len(points), 1))) for name in ("left", "right")}
        return both | {"gear": ConstraintForce(np.array([1.0, 2.0, 3.0]) * k, "holds")}

    motion = SimulatedMotion(robot, (Named("left"), Named("gear"), Named("right")))
    moments = [Sample.of(0.01 * k, state, np.zeros(6), np.zeros(0), lambda k=k: touches(k)) for k in range(N)]
    events = [Event(0.4, "left", "slips"), Event(0.6, "left", "leaves"), Event(0.6, "right", "leaves")]
    return Trajectory.of(motion, moments, events)


@pytest.fixture(scope="module")
def slide() -> Trajectory:
    return sliding()


def axes(width: float = 6.4):
    return Figure(figsize=(width, 3.6), layout="constrained").subplots()


def legend(ax) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_forces_are_vertical_and_horizontal(slide: Trajectory):
    """A bold and a fine line a contact, f_z and hypot(f_x, f_y), in the colours of the scene; a unit on each axis."""
    ax = axes()
    artists = plot_forces(ax, slide)
    lines = [a for a in artists if isinstance(a, Line2D) and a.axes is ax]
    colors = contact_colors(slide.contacts)
    assert slide.contacts == ("left", "right")
    for i, name in enumerate(slide.contacts):
        bold, fine = lines[2 * i : 2 * i + 2]
        np.testing.assert_array_equal(bold.get_ydata(), slide.forces[name][:, 2])
        np.testing.assert_allclose(fine.get_ydata(), np.where(np.arange(N) < HIGH, 5.0, 0.0))
        assert bold.get_color() == fine.get_color() == colors[name] and bold.get_linewidth() > fine.get_linewidth()
    assert ax.get_ylabel() == "force [N]" and ax.child_axes[0].get_xlabel() == "time [s]" and not ax.get_xlabel()
    assert [n for n in legend(ax) if n in slide.names] == ["left", "right"] and "weight 98.1 N" in legend(ax)
    weight = next(a for a in artists if isinstance(a, Line2D) and a.get_label().startswith("weight"))
    assert weight.get_ydata() == pytest.approx([98.1, 98.1]) and weight.get_linestyle() == ":"


def test_the_band_shows_modes(slide: Trajectory):
    """Filled while it sticks, hatched while it slips, empty in the air; each up to the next sample."""
    artists = plot_forces(axes(), slide, names=["right"])
    bands = [a for a in artists if isinstance(a, PolyCollection)]
    spans = [(p.vertices[:, 0].min(), p.vertices[:, 0].max()) for band in bands for p in band.get_paths()]
    assert spans == [pytest.approx((0.0, 0.4)), pytest.approx((0.4, 0.6))]
    assert bands[0].get_hatch() is None and bands[1].get_hatch()
    assert {band.axes for band in bands} == {bands[0].axes} and bands[0].axes is not artists[0].axes


def test_events_are_hairlines(slide: Trajectory):
    """One each time a contact begins or ends; beginnings of slipping are seen in the band."""
    for draw in (plot_forces, plot_energy):
        artists = draw(axes(), slide)
        marks = [a for a in artists if isinstance(a, LineCollection) and not isinstance(a, PolyCollection)]
        assert len(marks) == 2
        assert [[s[0, 0] for s in mark.get_segments()] for mark in marks] == [[0.6], [0.6]]


def test_what_is_no_contact_has_a_line_a_row(slide: Trajectory):
    """Three rows of a gear, with their numbers; unknown units are not claimed to be newton."""
    ax = axes()
    artists = plot_forces(ax, slide, names=["gear"])
    for k in range(3):
        np.testing.assert_array_equal(artists[k].get_ydata(), slide.forces["gear"][:, k])
    assert ax.get_ylabel() == "force [N, N m]" and legend(ax) == ["gear, row 1", "gear, row 2", "gear, row 3", "holds"]


def test_a_peak_does_not_flatten_the_rest(slide: Trajectory):
    """One sample of 10 kN among 49 N: cut off, and told."""
    spoilt = {name: force.copy() for name, force in slide.forces.items()}
    spoilt["left"][50, 2] = 1e4
    ax = axes()
    plot_forces(ax, dataclasses.replace(slide, forces=spoilt))
    low, high = ax.get_ylim()
    assert low < 0.0 and 49.05 < high < 200.0
    assert [t.get_text() for t in ax.texts] == ["cut off: 10,000 N\nat 0.5 s"]
    plain = axes()
    plot_forces(plain, slide)
    assert not plain.texts


def test_energies_add_up(slide: Trajectory):
    """Kinetic plus potential from its start is the total; how much it changes is in the legend."""
    changing = dataclasses.replace(slide, kinetic=np.linspace(0.0, 3.0, N), potential=np.linspace(10.0, 8.0, N))
    ax = axes()
    kinetic, potential, total = plot_energy(ax, changing)[:3]
    np.testing.assert_allclose(kinetic.get_ydata() + potential.get_ydata(), total.get_ydata(), atol=1e-14)
    assert potential.get_ydata()[-1] == pytest.approx(-2.0) and "total, changes by 1 J" in legend(ax)
    assert ax.get_ylabel() == "energy [J]" and ax.get_xlabel() == "time [s]" and ax.get_xlim() == (0.0, 1.0)


@pytest.fixture(scope="module")
def swing(talos: rbd.Robot) -> Trajectory:
    """Talos' left knee from 0.9 to 1.1 rad, moved by hand."""
    q0 = talos.posture("half_sitting")
    at = talos.model.joints[talos.joint_id("leg_left_4_joint")]
    motor = talos.actuated_names.index("leg_left_4_joint")
    moments = []
    for k in range(11):
        q, v, tau = q0.copy(), np.zeros(talos.nv), np.zeros(talos.nu)
        q[at.idx_q], v[at.idx_v], tau[motor] = 0.9 + 0.02 * k, 0.2, -20.0 * k
        moments.append(Sample.of(0.1 * k, rbd.State(talos, q, v), np.zeros(talos.nv), tau, dict))
    return Trajectory.of(SimulatedMotion(talos, ()), moments)


def test_a_joint_with_its_limits(swing: Trajectory):
    """Limits in sight are dashed; those out of sight are named in the legend and do not flatten the motion."""
    robot = swing.robot
    ax = axes()
    artists = plot_joint(ax, swing, "leg_left_4_joint", what="tau")
    motor = robot.actuated_names.index("leg_left_4_joint")
    limit = robot.effort_limit[motor]
    np.testing.assert_array_equal(artists[0].get_ydata(), swing.tau[:, motor])
    assert artists[1].get_ydata() == pytest.approx([-limit, -limit]) and artists[1].is_dashed() and len(artists) == 2
    assert ax.get_ylabel() == "torque [N m]" and legend(ax) == [f"leg_left_4_joint (limit {limit:g} N m)", "limit"]
    ax = axes()
    (line,) = plot_joint(ax, swing, "leg_left_4_joint", what="v")
    assert np.ptp(ax.get_ylim()) < 1.0 and ax.get_ylabel() == "velocity [rad/s]" and "(limit ±" in legend(ax)[0]
    assert plot_joint(axes(), swing, "leg_left_4_joint", what="a")[0].get_ydata() == pytest.approx(np.zeros(11))


def test_several_joints_and_one_coordinate(swing: Trajectory):
    """A colour each; of the base one coordinate, by its name."""
    ax = axes()
    left, right = plot_joint(ax, swing, ["leg_left_4_joint", "leg_right_4_joint"])[:2]
    assert left.get_color() != right.get_color() and ax.get_ylabel() == "angle [rad]"
    np.testing.assert_array_equal(plot_joint(axes(), swing, "root_joint.z")[0].get_ydata(), swing.q[:, 2])


def test_a_continuous_joint_goes_on_beyond_a_turn():
    """Cosine and sine become an angle: two turns are 4 pi."""
    robot = rbd.load_robot("tiago", root="planar")
    wheel = next(n for n in robot.joints if n.startswith("wheel"))
    at = robot.model.joints[robot.joint_id(wheel)].idx_q
    moments = []
    for k in range(41):
        q = robot.neutral()
        q[at : at + 2] = math.cos(0.1 * math.pi * k), math.sin(0.1 * math.pi * k)
        moments.append(Sample.of(0.1 * k, robot.at(q), np.zeros(robot.nv), np.zeros(robot.nu), dict))
    line = plot_joint(axes(), Trajectory.of(SimulatedMotion(robot, ()), moments), wheel)[0]
    assert line.get_ydata()[-1] == pytest.approx(4.0 * math.pi)


def test_what_cannot_be_drawn_is_refused(slide: Trajectory, swing: Trajectory):
    """In words, with the nearest names."""
    for draw in (plot_forces, plot_energy, lambda ax, t: plot_joint(ax, t, "leg_left_4_joint")):
        with pytest.raises(rbd.InputError, match="expected Matplotlib axes"):
            draw(None, swing)
        with pytest.raises(rbd.InputError, match=r"expected what rbd\.simulate returns"):
            draw(axes(), "fall.npz")
    for names, told in ((["lefd"], "nearest: 'left'"), ("left", "expected a list"), (7, "expected a list")):
        with pytest.raises(rbd.InputError, match=told):
            plot_forces(axes(), slide, names=names)
    for joint, what, told in (
        ("leg_left_4", "q", "nearest: 'leg_left_4_joint'"),
        ("root_joint", "q", "values in m and in 1"),
        ("root_joint", "tau", "carries no motor"),
        ("leg_left_4_joint", "x", "expected one of 'q'"),
        ("leg_left_4_joint", None, "expected one of 'q'"),
        ([], "q", "expected a joint's name"),
        (7, "q", "expected a joint's name"),
        ([7], "q", "no joint 7"),
    ):
        with pytest.raises(rbd.InputError, match=told):
            plot_joint(axes(), swing, joint, what=what)


def test_a_trajectory_draws_itself(slide: Trajectory, swing: Trajectory):
    """Methods, with axes or without."""
    ax = axes()
    assert slide.plot_forces(ax, names=["left"])[0].axes is ax
    assert swing.plot_joint("leg_left_4_joint", ax, what="v")[0].axes is ax and slide.plot_energy(ax)[0].axes is ax
    matplotlib.use("agg")  # no window
    from matplotlib import pyplot

    assert slide.plot_energy()[0].figure is pyplot.gcf()
    pyplot.close()


def test_every_plot_can_be_printed(slide: Trajectory, swing: Trajectory, tmp_path: Path):
    """As PDF and PNG, wide and narrow, of one sample too: no warning on the way."""
    for width in (3.4, 9.0):
        for draw in (slide.plot_forces, slide[:1].plot_forces, slide.plot_energy, slide[:1].plot_energy):
            ax = axes(width)
            draw(ax)
            ax.figure.savefig(tmp_path / "x.pdf")
    ax = axes()
    swing.plot_joint("leg_left_4_joint", ax)
    ax.figure.savefig(tmp_path / "x.png")
