"""Linkages of any lengths: their geometry against the texts, their motion against closed forms."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rbd
from rbd.errors import InputError, ModelError
from rbd.mechanism import four_bar, link_angles, n_four_bar, slider_crank

G = 9.81


def closed_velocity(state: rbd.State, **known: float) -> np.ndarray:
    """The velocity on the loops with these joint rates, by least squares."""
    robot = state.robot
    J = np.vstack([loop.rows(state).J for loop in robot.loops()])
    extra = np.zeros((len(known), robot.nv))
    for row, name in enumerate(known):
        extra[row, robot.model.joints[robot.joint_id(name)].idx_v] = 1.0
    return np.linalg.lstsq(np.vstack([J, extra]), np.r_[np.zeros(len(J)), list(known.values())], rcond=None)[0]


def rate(robot: rbd.Robot, v: np.ndarray, joint: str) -> float:
    return float(v[robot.model.joints[robot.joint_id(joint)].idx_v])


# ----------------------------------------------------------------------------------------------------------- four-bars


@pytest.mark.parametrize(("branch", "coupler", "rocker"), [("assembled", 20.298, 57.325), ("crossed", -60.98, -98.01)])
def test_nortons_four_bar_closes_as_published(branch: str, coupler: float, rocker: float) -> None:
    """40/120/80/100, crank at 40 deg: the angles of coupler and rocker from the ground, to the digits printed [Norton]."""
    robot = four_bar(40, 120, 80, 100, crank_angle=math.radians(40))
    angles = {link: math.degrees(x) for link, x in link_angles(robot.at(branch)).items()}
    assert abs(angles["crank"] - 40.0) < 1e-12 and angles["ground"] == 0.0
    digit = 1e-3 if branch == "assembled" else 1e-2  # a unit of the last one: -98.005 is printed as -98.01
    assert abs(angles["coupler"] - coupler) < digit and abs(angles["rocker"] - rocker) < digit


def test_nortons_four_bar_moves_as_published() -> None:
    """Crank rate 25, crank acceleration 15: rates (-4.1209, 6.9980), accelerations (296.089, 470.134), from the rows alone."""
    robot = four_bar(40, 120, 80, 100, crank_angle=math.radians(40))
    state = robot.at("assembled")
    v = closed_velocity(state, crank_joint=25.0)
    assert abs(rate(robot, v, "crank_joint") + rate(robot, v, "coupler_joint") + 4.1209) < 0.5e-4
    assert abs(rate(robot, v, "rocker_joint") - 6.9980) < 0.5e-4
    rows = robot.loops()[0].rows(state.with_velocity(v))
    at = [robot.model.joints[robot.joint_id(f"{link}_joint")].idx_v for link in ("crank", "coupler", "rocker")]
    coupler, rocker = np.linalg.solve(rows.J[:, at[1:]], -rows.bias - 15.0 * rows.J[:, at[0]])
    assert abs(15.0 + coupler - 296.089) < 0.5e-3 and abs(rocker - 470.134) < 0.5e-3


def test_the_rhombus_of_the_text_has_its_two_branches() -> None:
    """All lengths 1, crank 30 deg: open (0, 30) deg, where the rocker follows the crank; folded (210, 180), where it rests."""
    robot = four_bar(1, 1, 1, 1, crank_angle=math.radians(30))
    for branch, expected, rates in (("assembled", (0, 30), (0, 1)), ("crossed", (210, 180), (1, 0))):
        state = robot.at(branch)
        angles = link_angles(state)
        for link, degrees in zip(("coupler", "rocker"), expected, strict=True):
            assert abs(math.remainder(angles[link] - math.radians(degrees), 2 * math.pi)) < 1e-12
        v = closed_velocity(state, crank_joint=1.0)
        assert abs(1.0 + rate(robot, v, "coupler_joint") - rates[0]) < 1e-12
        assert abs(rate(robot, v, "rocker_joint") - rates[1]) < 1e-12


@pytest.mark.parametrize("seed", range(30))
def test_any_lengths_that_close_are_closed(seed: int) -> None:
    """In complex numbers, a e^(i th2) + b e^(i th3) = d + c e^(i th4), both branches, on either side of the diagonal."""
    rng = np.random.default_rng(seed)
    a, b, c, d = 10.0 ** rng.uniform(-2, 2) * rng.uniform(0.2, 1.0, 4)
    if 2 * max(a, b, c, d) > a + b + c + d:
        with pytest.raises(InputError, match="cannot close: . is .* m longer than the others together"):
            four_bar(a, b, c, d)
        return
    robot, sides = four_bar(a, b, c, d), []
    for branch in ("assembled", "crossed"):
        state = robot.at(branch)
        th = link_angles(state)
        tip = a * np.exp(1j * th["crank"])
        gap = tip + b * np.exp(1j * th["coupler"]) - d - c * np.exp(1j * th["rocker"])
        assert abs(gap) < 1e-13 * (a + b + c + d)
        assert np.abs(robot.loops()[0].rows(state).error).max() < 1e-13 * (a + b + c + d)
        sides.append((np.conj(tip - d) * c * np.exp(1j * th["rocker"])).imag)
    assert sides[0] < 0.0 < sides[1]


def test_the_open_branch_is_the_one_of_the_texts() -> None:
    """`assembled` is Norton's open one for every crank angle of a crank-rocker: no jump on the way round."""
    for degrees in range(0, 360, 15):
        th = link_angles(four_bar(40, 120, 80, 100, crank_angle=math.radians(degrees)).at("assembled"))
        assert 0.0 < th["rocker"] < math.pi  # the rocker of the open branch stays above the ground


def test_bars_are_thin_uniform_rods() -> None:
    """Each has m L^2 / 3 about the pin; masses are lengths times kg/m, or those given in order."""
    robot = four_bar(2, 3, 2.5, 4, mass_per_length=0.5)
    for link, length in (("crank", 2.0), ("coupler", 3.0), ("rocker", 2.5)):
        Y = robot.model.inertias[robot.joint_id(f"{link}_joint")]
        assert Y.mass == 0.5 * length and np.allclose(Y.lever, [length / 2, 0, 0], rtol=0, atol=1e-15)
        assert abs(Y.matrix()[4, 4] - Y.mass * length**2 / 3) < 1e-14
        moments = np.linalg.eigvalsh(Y.inertia)
        assert moments[0] > 0.0 and moments[0] + moments[1] >= moments[2]
    given = four_bar(2, 3, 2.5, 4, masses=(1, 2, 3))
    assert [given.model.inertias[given.joint_id(f"{x}_joint")].mass for x in ("crank", "coupler", "rocker")] == [1, 2, 3]


@pytest.mark.parametrize("posture", ["assembled", "crossed"])
def test_the_open_linkage_moves_by_lagranges_equations_in_absolute_angles(posture: str) -> None:
    """M and h of bars without their loop, in th1, th2, th3 from x: closed forms of thin rods, to 1e-13."""
    L = m = np.array([0.4, 1.2, 0.8])  # 1 kg/m
    robot = four_bar(*L, 1.0, crank_angle=math.radians(40.0))
    to_joints = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # the coupler's joint turns from the crank
    w = np.array([3.0, -2.0, 1.5])
    state = robot.at(posture).with_velocity(to_joints @ w)
    th = link_angles(state)
    t1, t2, t3 = th["crank"], th["coupler"], th["rocker"] + math.pi
    cross = 0.5 * m[1] * L[0] * L[1]
    M = np.diag([(m[0] / 3 + m[1]) * L[0] ** 2, m[1] * L[1] ** 2 / 3, m[2] * L[2] ** 2 / 3])
    M[0, 1] = M[1, 0] = cross * math.cos(t1 - t2)
    h = [
        cross * math.sin(t1 - t2) * w[1] ** 2 + (0.5 * m[0] + m[1]) * G * L[0] * math.cos(t1),
        -cross * math.sin(t1 - t2) * w[0] ** 2 + 0.5 * m[1] * G * L[1] * math.cos(t2),
        -0.5 * m[2] * G * L[2] * math.cos(t3),
    ]
    assert np.abs(to_joints.T @ rbd.dynamics.mass_matrix(state) @ to_joints - M).max() < 1e-13
    assert np.abs(to_joints.T @ rbd.dynamics.bias_force(state) - h).max() < 1e-13


def test_three_equal_bars_hang_where_statics_says() -> None:
    """Ground 2 m, bars of 4 m and 20 kg: at rest at 75.5225 and 104.4775 deg below the ground, cos = 1/4 (Drake's example)."""
    th = math.acos(0.25)
    assert abs(math.degrees(th) - 75.5225) < 0.5e-4
    robot = four_bar(4, 4, 4, 2, masses=(20, 20, 20), crank_angle=th - math.pi)
    hanging = [p for p in robot.postures if abs(link_angles(robot.at(p))["rocker"] + th) < 1e-9]
    assert len(hanging) == 1
    state = robot.at(hanging[0])
    found = rbd.solve(state, [0.0], robot.loops())
    assert np.abs(found.a).max() < 1e-12
    # Statics: half the coupler's weight at each pin, and the pins' horizontal force H: moments of a rocker about O4 vanish.
    horizontal = (0.5 * 20 + 0.5 * 20) * G * math.cos(th) / math.sin(th)
    force = found.forces["coupler_pin"]
    assert abs(abs(force[0]) - horizontal) < 1e-9 and abs(force[1]) < 1e-12 and abs(abs(force[2]) - 0.5 * 20 * G) < 1e-9


def test_a_four_bar_is_a_mechanism_of_one_freedom() -> None:
    """The motor is the crank's; all joints turn for ever; the doctor has nothing to say but where it is closed."""
    robot = four_bar(40, 120, 80, 100)
    assert robot.actuated_names == ("crank_joint",) and robot.passive == {"coupler_joint", "rocker_joint"}
    assert (robot.name, robot.root, robot.nq, robot.nv) == ("four_bar", "fixed", 6, 3)
    report = rbd.doctor(robot)
    assert report.ok and not report.warnings
    with pytest.warns(rbd.errors.EffortLimitWarning):
        rbd.solve(robot.at("assembled"), [1e9], robot.loops())


BAD = [0, -1, 0.0, float("nan"), float("inf"), "1", None, True, [1], 1e5, 1e-9, 10**400, 1 + 0j]


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("which", "abcd")
def test_a_length_is_a_number_above_zero(which: str, bad: Any) -> None:
    """Zero, negative, not finite, no number: named by its letter."""
    with pytest.raises(InputError, match=f"{which} of the four-bar, in metres.* is .*expected a finite number from 1e-06"):
        four_bar(**({"a": 1.0, "b": 1.0, "c": 1.0, "d": 1.0} | {which: bad}))


def test_lengths_that_cannot_close_tell_what_is_missing() -> None:
    """The longest bar by its letter and by how much; a crank angle out of reach; a crank's tip on the other pivot."""
    with pytest.raises(InputError, match="bars of a 1, b 1, c 1, d 3.5 m cannot close: d is 0.5 m longer"):
        four_bar(1, 1, 1, 3.5)
    with pytest.raises(InputError, match="bars of 1 and 1 m do not meet from points 4 m apart: 2 m are missing"):
        four_bar(2, 1, 1, 2, crank_angle=math.pi)
    with pytest.raises(InputError, match="bars of 3 and 1 m do not meet from points 1 m apart: 1 m are missing"):
        four_bar(2, 3, 1, 3, crank_angle=0.0)
    with pytest.raises(InputError, match="bars of 1 and 1 m start at one point"):
        four_bar(1, 1, 1, 1, crank_angle=0.0)
    flat = four_bar(1, 1, 1, 3)  # just long enough, stretched out
    assert np.abs(flat.loops()[0].rows(flat.at("assembled")).error).max() < 1e-14


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"crank_angle": float("nan")}, "crank_angle .rad. is nan"),
        ({"crank_angle": "40"}, "crank_angle .rad. is '40'"),
        ({"masses": (1, 2)}, r"masses of the four-bar is \(1, 2\); expected 3 numbers .*: crank, coupler, rocker"),
        ({"masses": (1, 2, -3)}, "mass of the rocker of the four-bar, .* is -3"),
        ({"masses": 3}, "masses of the four-bar is 3"),
        ({"masses": "123"}, "masses of the four-bar is '123'"),
        ({"mass_per_length": 0}, "mass_per_length of the four-bar, .* is 0"),
        ({"path": 3}, "the path is 3"),
        ({"path": "four_bar.txt"}, "expected one that ends in .urdf"),
        ({"path": "no/such/folder/four_bar.urdf"}, "four_bar.urdf' cannot be written: there is no folder .*No such file"),
    ],
)
def test_other_arguments_are_checked(wrong: dict[str, Any], says: str) -> None:
    """By their names, before or instead of writing a file."""
    with pytest.raises((InputError, ModelError), match=says):
        four_bar(1.0, 1.0, 1.0, 1.0, **wrong)


def test_files_are_written_where_asked(tmp_path: Path) -> None:
    """URDF and loop file beside it; loading them again gives the same robot; a second one without a path is another file."""
    path = tmp_path / "mine.urdf"
    robot = four_bar(40, 120, 80, 100, path=path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.loops.yaml", "mine.urdf"]
    again = rbd.load_robot(path)
    assert again.name == "mine" and again.postures.keys() == robot.postures.keys()
    assert np.array_equal(again.at("crossed").M, robot.at("crossed").M)
    assert "Licence: BSD-2-Clause" in path.read_text() and "Licence: BSD-2-Clause" in (tmp_path / "mine.loops.yaml").read_text()
    one, other = four_bar(1, 1, 1, 1), four_bar(2, 2, 2, 2)
    assert one.urdf != other.urdf and one.urdf.is_file()
    assert copy.deepcopy(one).visual_model.ngeoms == one.visual_model.ngeoms > 10


# --------------------------------------------------------------------------------------------------------- N-four-bars


@pytest.mark.parametrize("n", [1, 2, 5, 20])
def test_an_n_four_bar_swings_as_its_closed_form(n: int) -> None:
    """[(N + 1)/3 + N] phi'' = -[(N + 1)/2 + N] g cos phi (per m and L), at any phi and speed; cranks carry each other."""
    robot = n_four_bar(n)
    assert (robot.nv, len(robot.loops()), robot.nu) == (2 * n + 1, n, 1)
    rng = np.random.default_rng(n)
    for phi, speed in zip(rng.uniform(0.3, 2.8, 4), rng.normal(size=4) * 5, strict=True):
        q, v = robot.neutral(), np.zeros(robot.nv)
        for name in robot.joints:
            joint = robot.model.joints[robot.joint_id(name)]
            sign = 1.0 if name.startswith("crank") else -1.0
            q[joint.idx_q :][:2] = np.cos(sign * phi), np.sin(sign * phi)
            v[joint.idx_v] = sign * speed
        state = robot.at(q, v)
        assert all(np.abs(loop.rows(state).error).max() < 1e-14 for loop in robot.loops())
        assert all(np.abs(loop.rows(state).velocity).max() < 1e-13 for loop in robot.loops())
        expected = -((n + 1) / 2 + n) * G * math.cos(phi) / ((n + 1) / 3 + n)
        a = rbd.solve(state, [0.0], robot.loops(), solver=rbd.KKT()).a
        for i in range(n + 1):
            assert abs(rate(robot, a, f"crank_{i}_joint") - expected) < 1e-9
        energy = 0.5 * ((n + 1) / 3 + n) * speed**2
        assert abs(rbd.dynamics.kinetic_energy(state) - energy) < 1e-12 * energy


def test_an_n_four_bar_lying_flat_loses_a_rank_a_loop() -> None:
    """The singular pose of the benchmark: phi = 0 has N + 1 degrees of freedom in the small, upright it has one."""
    for n in (1, 2, 4):
        robot = n_four_bar(n, length=0.5, mass=2.0)
        for state, freedoms in ((robot.at("assembled"), 1), (robot.at(), n + 1)):
            J = np.vstack([loop.rows(state).J for loop in robot.loops()])
            assert robot.nv - np.linalg.matrix_rank(J, tol=1e-9) == freedoms


@pytest.mark.parametrize(("n", "length", "mass"), [(1, 0.3, 1.0), (3, 0.7, 2.0), (4, 2.5, 0.1)])
def test_an_n_four_bar_is_a_row_of_squares(n: int, length: float, mass: float) -> None:
    """Pivots at x = 0, L ... n L on the ground, crank tips L above them, each bar of mass m with m L^2 / 3 about its end."""
    robot = n_four_bar(n, length=length, mass=mass)
    state = robot.at("assembled")
    for i in range(n + 1):
        pivot = state.frame(f"crank_{i}").X_WF.act(np.zeros(3))
        tip = state.frame(f"crank_{i}").X_WF.act(np.array([length, 0.0, 0.0]))
        assert np.abs(pivot - [i * length, 0.0, 0.0]).max() < 1e-14 * n
        assert np.abs(tip - [i * length, 0.0, length]).max() < 1e-14 * n
    for i in range(1, n + 1):
        ends = [state.frame(f"coupler_{i}").X_WF.act(np.array([x, 0.0, 0.0])) for x in (0.0, length)]
        assert np.abs(ends - np.array([[(i - 1) * length, 0, length], [i * length, 0, length]])).max() < 1e-14 * n
    for Y in robot.model.inertias[1:]:
        assert Y.mass == mass and abs(Y.matrix()[4, 4] - mass * length**2 / 3) < 1e-14 * mass * length**2


@pytest.mark.parametrize("bad", [0, -1, 100, 2.0, "2", True, None, 10**400])
def test_n_is_a_whole_number(bad: Any) -> None:
    """From 1 to 99."""
    with pytest.raises(InputError, match="expected a whole number from 1 to 99"):
        n_four_bar(bad)
    with pytest.raises(InputError, match="length of the N-four-bar, in metres or kilograms, is -1"):
        n_four_bar(2, length=-1)


# ------------------------------------------------------------------------------------------------------- slider-cranks


@pytest.mark.parametrize("seed", range(20))
def test_a_slider_is_where_its_closed_form_says(seed: int) -> None:
    """At x = r cos th +- sqrt(l^2 - (r sin th - e)^2), and x' = dx/dth th'."""
    rng = np.random.default_rng(seed)
    r, l, e = rng.uniform(0.1, 1.0), rng.uniform(0.5, 3.0), rng.uniform(-0.6, 0.6)
    if abs(e) > 0.99 * (r + l):
        pytest.fail("no draw of this seed cannot close")
    robot = slider_crank(r, l, offset=e)
    for branch, side in (("assembled", 1.0), ("crossed", -1.0)):
        state = robot.at(branch)
        th = link_angles(state)["crank"]
        root = math.sqrt(l**2 - (r * math.sin(th) - e) ** 2)
        at = robot.model.joints[robot.joint_id("slider_joint")].idx_q
        assert abs(state.q[at] - (r * math.cos(th) + side * root)) < 1e-12
        assert np.abs(robot.loops()[0].rows(state).error).max() < 1e-13
        slope = -r * math.sin(th) - side * (r * math.sin(th) - e) * r * math.cos(th) / root
        v = closed_velocity(state, crank_joint=2.0)
        assert abs(rate(robot, v, "slider_joint") - 2.0 * slope) < 1e-11


@pytest.mark.parametrize(
    ("rod", "offset", "degrees"),
    [
        (2.0, 0.0, 45.0),
        (1.2, 1.5, 45.0),  # the tip at 45 deg is 0.793 m below the line
        (1.2, -1.0, -90.0),  # 1.707 m above it: too far; straight down it is on the line
        (1.0, -0.2629, math.degrees(math.asin(-0.2629))),  # 0.97 m would close, with too little to spare
        (0.5, -0.1, math.degrees(math.asin(-0.1))),
        (2.0, 2.5, 45.0),
        (1.2, 2.1, 90.0),  # above what the crank reaches: as near as it comes
        (1.2, -2.1, -90.0),
    ],
)
def test_a_slider_crank_stands_at_45_degrees_where_it_closes_well(rod: float, offset: float, degrees: float) -> None:
    """Else with the crank's tip as near to the slider's line as it comes: on it, or straight up or down."""
    robot = slider_crank(1.0, rod, offset=offset)
    for branch in ("assembled", "crossed"):
        assert abs(math.degrees(link_angles(robot.at(branch))["crank"]) - degrees) < 1e-10
        assert np.abs(robot.loops()[0].rows(robot.at(branch)).error).max() < 1e-13


def test_a_slider_crank_falls_as_lagranges_equation_says() -> None:
    """With T = 1/2 I(th) th'^2 and V(th) of the loop: I th'' + 1/2 I' th'^2 + V' = tau; I', V' by complex steps."""
    r, l, e, masses = 0.3, 0.8, 0.1, (1.2, 2.0, 0.7)

    def inertia_and_height(th: complex) -> tuple[complex, complex]:
        s, c = np.sin(th), np.cos(th)
        root = np.sqrt(l**2 - (e - r * s) ** 2)
        # Rod: centre halfway; phi = asin((e - r s) / l), phi' = -r c / root. Slider: x = r c + root.
        dphi, dx = -r * c / root, -r * s + (e - r * s) * r * c / root
        middle = (-r * s + dx) / 2, r * c / 2
        total = masses[0] * r**2 / 3 + masses[1] * (middle[0] ** 2 + middle[1] ** 2 + l**2 / 12 * dphi**2) + masses[2] * dx**2
        return total, masses[0] * r / 2 * s + masses[1] * (r * s + e) / 2

    robot = slider_crank(r, l, offset=e, masses=masses, crank_angle=0.9)
    th, speed, tau = 0.9, 4.0, 1.5
    I, _ = inertia_and_height(th)
    dI, dV = (x.imag / 1e-30 for x in inertia_and_height(th + 1e-30j))
    expected = (tau - 0.5 * dI * speed**2 - G * dV) / float(np.real(I))
    state = robot.at("assembled")
    state = state.with_velocity(closed_velocity(state, crank_joint=speed))
    found = rbd.solve(state, [tau], robot.loops())
    assert abs(rate(robot, found.a, "crank_joint") - expected) < 1e-10 * abs(expected)


def test_slider_cranks_that_cannot_close_are_refused() -> None:
    """The line is too far, the rod too short at this angle, no numbers."""
    with pytest.raises(InputError, match="the slider's line is 4 m away, 1 m more than both together"):
        slider_crank(1, 2, offset=-4)
    with pytest.raises(InputError, match="the crank's tip is 1 m from the slider's line, and the rod is 0.5 m long: 0.5 m"):
        slider_crank(1, 0.5, crank_angle=math.pi / 2)
    for wrong in ({"crank": 0}, {"rod": -1}, {"offset": "x"}, {"offset": math.nan}, {"crank_angle": math.inf}, {"masses": [1]}):
        with pytest.raises(InputError, match=next(iter(wrong)).replace("offset", "offset of the slider")):
            slider_crank(**({"crank": 1.0, "rod": 2.0} | wrong))
    assert np.abs((r := slider_crank(1, 2, offset=3)).loops()[0].rows(r.at("assembled")).error).max() < 1e-14


# ----------------------------------------------------------------------------------------------------------- angles


def test_link_angles_are_those_of_flat_mechanisms(talos: rbd.Robot) -> None:
    """A robot that turns out of the plane, or no state, is refused by name."""
    with pytest.raises(InputError, match="is turned out of the x-z plane"):
        link_angles(talos.standing())
    with pytest.raises(InputError, match="the state of link_angles is .* expected a State"):
        link_angles(talos)  # type: ignore[arg-type]
