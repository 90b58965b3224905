"""Rates and loop Jacobians in absolute angles, against the texts' formulas and numbers, and against differences."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError
from rbd.mechanism import four_bar, link_angles, link_jacobians, link_rates, trace, velocity_partition

URDF = Path(__file__).parents[2] / "urdf"
NORTON = four_bar(40, 120, 80, 100, crank_angle=math.radians(40))


def across(angle: float) -> np.ndarray:
    """(-sin, cos): a quarter turn beyond the angle."""
    return np.array([-math.sin(angle), math.cos(angle)])


@pytest.mark.parametrize(("branch", "sign"), [("assembled", -1.0), ("crossed", 1.0)])
def test_j1_and_j2_are_nortons_and_det_j2_has_its_sign(branch: str, sign: float) -> None:
    """J1 = a n2, J2 = [b n3, -c n4], det J2 = b c sin(th3 - th4): below zero on the open branch, above on the crossed one."""
    state = NORTON.at(branch)
    th = link_angles(state)
    found = link_jacobians(state, known=["crank"])
    assert found.known == ("crank",) and found.unknown == ("coupler", "rocker")
    assert np.abs(found.J_known[:, 0] - 40.0 * across(th["crank"])).max() < 1e-12
    expected = np.column_stack([120.0 * across(th["coupler"]), -80.0 * across(th["rocker"])])
    assert np.abs(found.J_unknown - expected).max() < 1e-12
    det = 120.0 * 80.0 * math.sin(th["coupler"] - th["rocker"])
    assert found.determinant == pytest.approx(det, rel=1e-13) and found.determinant * sign > 0.0
    assert found.volume == pytest.approx(abs(det), rel=1e-12)
    by_joints = velocity_partition(state, known={"crank_joint": 1.0}).columns
    assert by_joints.determinant == pytest.approx(det, rel=1e-12)  # T and the turn of the rows have determinant one


def test_link_rates_are_nortons() -> None:
    """Crank at 25 rad/s and 15 rad/s2: coupler and rocker at (-4.1209, 6.9980) rad/s and (296.089, 470.134) rad/s2."""
    still = NORTON.at("assembled")
    moving = still.with_velocity(velocity_partition(still, known={"crank_joint": 25.0}).v)
    rates = link_rates(moving)
    assert rates["ground"] == 0.0 and rates["crank"] == 25.0
    assert abs(rates["coupler"] + 4.1209) < 0.51e-4 and abs(rates["rocker"] - 6.9980) < 0.51e-4
    a = rbd.mechanism.acceleration_partition(moving, known={"crank_joint": 15.0}).a
    accelerations = link_rates(moving, a)
    assert abs(accelerations["coupler"] - 296.089) < 0.51e-3 and abs(accelerations["rocker"] - 470.134) < 0.51e-3
    columns = link_jacobians(still, known=["crank"])
    unknown = -np.linalg.solve(columns.J_unknown, columns.J_known @ [25.0])
    assert np.abs(unknown - [rates["coupler"], rates["rocker"]]).max() < 1e-12


@pytest.mark.parametrize(("branch", "angles", "rates", "det"), [
    ("assembled", (180.0, 210.0), (0.0, 1.0), 0.5),
    ("crossed", (210.0, 180.0), (1.0, 0.0), -0.5),
])  # fmt: skip
def test_the_texts_rhombus_in_the_texts_angles(branch: str, angles: tuple, rates: tuple, det: float) -> None:
    """All lengths 1, th1 = 30 deg: the text's loop is the robot turned by half a turn, the rocker's vector reversed."""
    robot = four_bar(1.0, 1.0, 1.0, 1.0, crank_angle=math.radians(30.0 - 180.0))
    branch = {"assembled": "crossed", "crossed": "assembled"}[branch]  # turned by half a turn, above is below
    state = robot.at(branch)
    links = link_angles(state)
    th2, th3 = links["coupler"] + math.pi, links["rocker"]
    for found, degrees in ((th2, angles[0]), (th3, angles[1])):
        assert abs(math.remainder(found - math.radians(degrees), 2.0 * math.pi)) < 1e-12
    assert link_jacobians(state, known=["crank"]).determinant == pytest.approx(math.sin(th3 - th2), abs=1e-12)
    assert math.sin(th3 - th2) == pytest.approx(det, abs=1e-12)
    moving = state.with_velocity(velocity_partition(state, known={"crank_joint": 1.0}).v)
    found = link_rates(moving)
    assert abs(found["coupler"] - rates[0]) < 1e-12 and abs(found["rocker"] - rates[1]) < 1e-12


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "five_bar", "six_bar", "parallel_leg"])
def test_the_jacobian_is_the_derivative_of_the_loop(name: str) -> None:
    """J_theta T v = (p_a - p_b)' along joint rates, by differences of the loops' points; sliders keep their displacement."""
    robot = rbd.load_robot(URDF / f"{name}.urdf")
    q = robot.at("assembled").q
    v, h = np.random.default_rng(1).normal(size=robot.nv), 1e-6
    state = rbd.State(robot, q, v)
    found = link_jacobians(state, known=[])
    rates = link_rates(state)
    coordinates = [rates[n] if n in rates else v[robot.joints[n].v][0] for n in found.unknown]

    def gaps(t: float) -> np.ndarray:
        there = rbd.State(robot, pin.integrate(robot.model, q, t * v))
        ends = [[there.frame(f).X_WF.translation[[0, 2]] for f in loop.frames] for loop in robot.loops()]
        return np.concatenate([a - b for a, b in ends])

    assert np.abs(found.J_unknown @ coordinates - (gaps(h) - gaps(-h)) / (2.0 * h)).max() < 1e-8


@pytest.mark.parametrize("branch", ["assembled", "crossed"])
def test_the_angles_of_the_links_close_the_texts_loop(branch: str) -> None:
    """L1 e^(i th1) + L2 e^(i th2) + L3 e^(i th3) + L4 e^(i th4) = 0, with th3 the rocker's angle + pi and th4 = pi."""
    links = link_angles(NORTON.at(branch))
    angles = np.array([links["crank"], links["coupler"], links["rocker"] + math.pi, math.pi])
    total = np.array([40.0, 120.0, 80.0, 100.0]) @ np.exp(1j * angles)
    assert abs(total) < 1e-12 * 340.0
    assert abs(math.remainder(links["crank"] - math.radians(40.0), 2.0 * math.pi)) < 1e-14


def test_link_rates_are_the_derivatives_of_link_angles() -> None:
    """Along the turn of a crank, by central differences."""
    turn = trace(NORTON.at("assembled"), joint="crank_joint", values=np.radians(40.0) + np.array([-1e-5, 0.0, 1e-5]))
    before, here, after = (rbd.State(NORTON, q) for q in turn.q)
    rates = link_rates(here, velocity_partition(here, known={"crank_joint": 1.0}).v)
    for link in ("crank", "coupler", "rocker"):
        slope = math.remainder(link_angles(after)[link] - link_angles(before)[link], 2.0 * math.pi) / 2e-5
        assert abs(slope - rates[link]) < 1e-6


def test_a_determinant_needs_a_square_j2(talos: rbd.Robot) -> None:
    """With nothing known J2 is two by three; what has no absolute angles is refused by name."""
    state = NORTON.at("assembled")
    with pytest.raises(InputError, match="J2 has 2 rows and 3 columns .*no determinant; see `volume`"):
        _ = link_jacobians(state, known=[]).determinant
    with pytest.raises(InputError, match="called 'crnk'; .*'crank'"):
        link_jacobians(state, known=["crnk"])
    with pytest.raises(InputError, match="expected a list of links"):
        link_jacobians(state, known="crank")
    with pytest.raises(InputError, match="names 'crank' twice"):
        link_jacobians(state, known=["crank", "crank"])
    weld = rbd.LoopClosure("weld", "coupler_tip", "rocker_tip", kind="rigid")
    slide = rbd.LoopClosure("slide", "coupler_tip", "rocker_tip", kind="prismatic", axis=(1, 0, 0))
    for other in (rbd.JointLock("lock", "rocker_joint"), weld, slide):
        with pytest.raises(InputError, match=f"'{other.name}' is no pin of a loop"):
            link_jacobians(state, [other], known=["crank"])
    with pytest.raises(InputError, match="'root_joint' of .* neither turns about y nor slides"):
        link_jacobians(talos.standing(), [], known=[])
    with pytest.raises(InputError, match=r"rates has shape \(2,\); expected \(3,\)"):
        link_rates(state, [1.0, 2.0])
