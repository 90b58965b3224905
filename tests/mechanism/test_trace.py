"""Driven mechanisms: one branch all the way, the limits of motion, and what is passed on it."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from linkages import bennett, pinned, sarrus, sarrus_pose
from planar_models import absolute, four_bar, four_bar_angles, six_bar, slider_crank
from states import at_neutral

import rbd
from rbd.errors import CannotAssemble
from rbd.mechanism import branches, n_four_bar, trace
from rbd.mechanism.constraint_error import Closure
from rbd.mechanism.poses import distance

TURN = 2.0 * math.pi
CRANK_ROCKER = (1.0, 3.0, 2.5, 3.0)
TRIPLE_ROCKER = (2.0, 2.0, 2.2, 3.5)


def angle_between(a: float, d: float, far: float) -> float:
    """Of a triangle with sides a and d, the angle that leaves `far` opposite: where links in line put the crank."""
    return math.acos((a * a + d * d - far * far) / (2.0 * a * d))


def gap(q: np.ndarray, angles: tuple[float, float]) -> float:
    """Distance of coupler and rocker from closed-form angles, on the unit circle."""
    return float(np.abs(np.exp(1j * absolute(q)[1:]) - np.exp(1j * np.array(angles))).max())


@pytest.mark.parametrize("branch", [0, 1])
@pytest.mark.parametrize("continuous", [False, True])
def test_a_crank_turns_all_the_way_on_its_own_branch(branch: int, continuous: bool):
    """361 poses of a turn: each the closed form's of the same branch, and the last is the first one turn on."""
    robot, loops = four_bar(*CRANK_ROCKER, continuous=continuous)
    coupler, rocker = four_bar_angles(*CRANK_ROCKER, 0.7)[branch]
    q0 = pin.integrate(robot.model, pin.neutral(robot.model), np.array([0.7, coupler - 0.7, rocker]))
    motion = trace(rbd.State(robot, q0), loops, joint="crank", values=(0.7, 0.7 + TURN), steps=360)
    assert len(motion) == 361 and motion.complete and not motion.limits and not motion.crossings
    assert np.array_equal(motion.input, np.linspace(0.7, 0.7 + TURN, 361))
    for crank, q in zip(motion.input, motion.q, strict=True):
        if continuous:
            q = np.arctan2(q[1::2], q[::2])
        assert abs(np.exp(1j * q[0]) - np.exp(1j * crank)) < 1e-12
        assert gap(q, four_bar_angles(*CRANK_ROCKER, crank)[branch]) < 1e-10
    assert motion.residual.max() <= 1e-12
    errors = [np.abs(loops[0].rows(rbd.State(robot, q)).error).max() for q in motion.q]
    assert np.array_equal(errors, motion.residual)


def test_sigma_and_condition_are_those_of_j2():
    """Its least singular value and condition number, from the text's matrix at each pose."""
    robot, loops = four_bar(*CRANK_ROCKER)
    motion = trace(rbd.State(robot, np.array([0.7, -0.03, 1.5])), loops, joint="crank", values=(0.7, 3.0), steps=20)
    for i, q in enumerate(motion.q):
        s = np.linalg.svd(loops[0].rows(rbd.State(robot, q)).J[:, 1:], compute_uv=False)
        assert motion.sigma_min[i] == pytest.approx(s[1], rel=1e-12)
        assert motion.condition[i] == pytest.approx(s[0] / s[1], rel=1e-12)


def test_the_rocker_of_a_crank_rocker_stops_at_its_limits():
    """Crank and coupler in line: c and d with b + a, or b - a, opposite. Driven up and down the rocker finds both."""
    a, b, c, d = CRANK_ROCKER
    most, least = (math.pi - angle_between(c, d, b + s * a) for s in (1.0, -1.0))
    most, least = max(most, least), min(most, least)
    robot, loops = four_bar(*CRANK_ROCKER)
    start = trace(rbd.State(robot, np.array([2.0, 0.0, 2.0])), loops, joint="crank", values=(2.0, 2.1), steps=1)
    value = float(start.q[-1][2])
    for target, limit in ((value + 2.0, most), (value - 2.0, least)):
        motion = trace(rbd.State(robot, start.q[-1]), loops, joint="rocker", values=(value, target), steps=50)
        (found,) = motion.limits
        assert found.value == pytest.approx(limit, abs=1e-12)
        assert found.greatest == (target > value)
        assert motion.input[-1] == found.value and np.array_equal(motion.q[-1], found.q)
        assert not motion.complete and len(motion.unreached) + len(motion) - 1 == 51
        assert motion.sigma_min[-1] < 1e-9
        crank, coupler, _ = absolute(found.q)
        assert abs(math.sin(coupler - crank)) < 1e-9
        assert np.abs(np.diff(motion.input) - np.diff(motion.input)[0])[:-1].max() < 1e-12


def test_past_its_limits_a_rocker_leads_the_crank_all_the_way_round():
    """Followed over both limits the motion comes back where it began; the crank has made its turn."""
    a, b, c, d = CRANK_ROCKER
    robot, loops = four_bar(*CRANK_ROCKER)
    rocker = four_bar_angles(*CRANK_ROCKER, 2.0)[0][1]
    q0 = np.array([2.0, four_bar_angles(*CRANK_ROCKER, 2.0)[0][0] - 2.0, rocker])
    motion = trace(rbd.State(robot, q0), loops, joint="rocker", values=(rocker, rocker + 5.0), past_limits=True)
    assert motion.closed and not motion.complete
    expected = sorted(math.pi - angle_between(c, d, b + s * a) for s in (1.0, -1.0))
    assert sorted(limit.value for limit in motion.limits) == pytest.approx(expected, abs=1e-12)
    turned = np.unwrap(motion.q[:, 0])
    assert abs(abs(turned[-2] - turned[0]) - TURN) < 0.2  # up to the last step
    for q in motion.q:
        assert gap(q, four_bar_angles(*CRANK_ROCKER, q[0])[0]) < 1e-9
    assert "back where it began" in str(motion)


def test_a_linkage_without_a_crank_turns_back_by_the_triangle_inequality():
    """Coupler and rocker stretched, b + c opposite a and d: +- 1.67024589 rad; over them it changes its branch."""
    a, b, c, d = TRIPLE_ROCKER
    limit = angle_between(a, d, b + c)
    robot, loops = four_bar(*TRIPLE_ROCKER)
    coupler, rocker = four_bar_angles(*TRIPLE_ROCKER, 0.5)[0]
    q0 = np.array([0.5, coupler - 0.5, rocker])
    for target, sign in ((6.0, 1.0), (-6.0, -1.0)):
        motion = trace(rbd.State(robot, q0), loops, joint="crank", values=(0.5, target))
        assert motion.limits[0].value == pytest.approx(sign * limit, abs=1e-12)
        assert abs(motion.input).max() <= limit + 1e-12
        exact = [four_bar_angles(*TRIPLE_ROCKER, u)[0] for u in motion.input[:-1]]
        assert max(gap(q, angles) for q, angles in zip(motion.q, exact, strict=False)) < 1e-9
    loop = trace(rbd.State(robot, q0), loops, joint="crank", values=(0.5, 6.0), past_limits=True)
    assert loop.closed
    assert [limit.value for limit in loop.limits] == pytest.approx([limit, -limit], abs=1e-12)
    between = [gap(q, four_bar_angles(*TRIPLE_ROCKER, u)[1]) < 1e-9 for u, q in zip(loop.input, loop.q, strict=True)]
    assert any(between) and not all(between)


@pytest.mark.parametrize("branch", ["open", "folded"])
def test_a_rhombus_passes_its_flat_poses_on_the_same_branch(branch: str):
    """Singular at 0 and 180 deg. Open: the coupler stays level; folded: the rocker stays at 180 deg, all the turn round."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    q0 = np.array([0.5, -0.5, 0.5]) if branch == "open" else np.array([0.5, math.pi, math.pi])
    motion = trace(rbd.State(robot, q0), loops, joint="crank", values=(0.5, 0.5 + 2.0 * TURN), steps=97)
    assert motion.complete
    expected = [(0.0, u) if branch == "open" else (u + math.pi, math.pi) for u in motion.input]
    assert max(gap(q, angles) for q, angles in zip(motion.q, expected, strict=True)) < 1e-6  # 1e-12 in e near a flat pose
    far = np.abs(np.sin(motion.input)) > 0.05
    assert max(gap(q, x) for q, x, use in zip(motion.q, expected, far, strict=True) if use) < 1e-10
    assert [x.value for x in motion.crossings] == pytest.approx([math.pi, TURN, 3.0 * math.pi, 2.0 * TURN], abs=1e-5)
    assert max(x.sigma for x in motion.crossings) < 1e-5
    assert "passes a singular pose" in str(motion)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_n_four_bars_pass_lying_flat_together(n: int):
    """IFToMM's A02: N loops lose rank at once where all bars lie in line; all cranks go on turning as one."""
    robot = n_four_bar(n)
    motion = trace(robot.at("assembled"), joint="crank_0_joint", values=(math.pi / 2, math.pi / 2 + TURN), steps=37)
    assert motion.complete
    cranks = [robot.model.joints[robot.joint_id(f"crank_{i}_joint")].idx_q for i in range(n + 1)]
    for u, q in zip(motion.input, motion.q, strict=True):
        assert max(abs(q[i] + 1j * q[i + 1] - np.exp(1j * u)) for i in cranks) < 1e-6
    assert [x.value for x in motion.crossings] == pytest.approx([math.pi, TURN], abs=1e-5)


@pytest.mark.parametrize("more", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_branches_that_nearly_cross_are_not_jumped(more: float, sign: float):
    """A parallelogram's coupler longer or shorter by a hair: it no longer passes flat, and turns back at its closed form."""
    a, b, c, d = 1.0, 2.0 + sign * more, 1.0, 2.0
    robot, loops = four_bar(a, b, c, d)
    coupler, rocker = four_bar_angles(a, b, c, d, 0.5)[0]
    motion = trace(rbd.State(robot, np.array([0.5, coupler - 0.5, rocker])), loops, joint="crank", values=(0.5, 0.5 + TURN))
    limit = TURN - angle_between(a, d, b - c) if sign > 0.0 else angle_between(a, d, b + c)
    (found,) = motion.limits
    assert found.value == pytest.approx(limit, abs=1e-9)
    assert not motion.complete and not motion.crossings
    # Straight on, as the parallelogram itself, would be the other branch beyond pi.
    away = [i for i, u in enumerate(motion.input[:-1]) if abs(math.sin(u)) > 0.03]
    assert max(gap(motion.q[i], four_bar_angles(a, b, c, d, motion.input[i])[0]) for i in away) < 1e-9
    assert (motion.input.max() > math.pi + 0.1) == (sign > 0.0)


def test_a_slider_has_its_dead_centres_as_limits():
    """From l - r to l + r, crank and rod in line; over both and back again."""
    robot, loops = slider_crank(1.0, 3.0)
    q0 = np.array([0.5, -0.66, 3.7])
    motion = trace(rbd.State(robot, q0), loops, joint="slider", values=(3.5, 0.0), past_limits=True)
    assert sorted(limit.value for limit in motion.limits) == pytest.approx([2.0, 4.0], abs=1e-12)
    assert motion.closed
    crank = trace(rbd.State(robot, q0), loops, joint="crank", values=(0.5, 0.5 + TURN))
    x = np.cos(crank.input) + np.sqrt(9.0 - np.sin(crank.input) ** 2)
    assert np.abs(crank.q[:, 2] - x).max() < 1e-11


def test_values_are_visited_in_order_to_and_fro():
    """Up, back over the start, up again: each pose as if it had been gone to alone, on the same branch."""
    robot, loops = four_bar(*CRANK_ROCKER)
    values = [0.7, 0.9, 0.9, 0.72, 0.3, 0.31, 2.5, -1.0]
    motion = trace(rbd.State(robot, np.array([0.7, -0.03, 1.5])), loops, joint="crank", values=values)
    assert np.array_equal(motion.input, values)
    for u, q in zip(values, motion.q, strict=True):
        assert gap(q, four_bar_angles(*CRANK_ROCKER, u)[0]) < 1e-10


def test_from_a_limit_the_way_leads_back():
    """The limit itself is reached, and from there the joint is driven back on the side that it came from."""
    a, b, c, d = TRIPLE_ROCKER
    limit = angle_between(a, d, b + c)
    robot, loops = four_bar(*TRIPLE_ROCKER)
    coupler, rocker = four_bar_angles(*TRIPLE_ROCKER, 0.5)[0]
    motion = trace(rbd.State(robot, np.array([0.5, coupler - 0.5, rocker])), loops, joint="crank", values=[0.5, limit, 1.0])
    assert motion.complete
    assert gap(motion.q[-1], four_bar_angles(*TRIPLE_ROCKER, 1.0)[0]) < 1e-10


def test_two_freedoms_want_a_fixed_joint():
    """A five-bar driven by one crank is refused with a joint to fix; with it fixed it moves, and that joint does not."""
    robot, loops = six_bar()
    with pytest.raises(rbd.InputError, match=r"2 degrees of freedom; driving 'crank' decides one. Fix 1 more, e.g. fixed=\{'"):
        trace(
            rbd.State(robot, np.zeros(5)),
            loops[:1] + [rbd.JointLock("l", "output", position=1.0)],
            joint="crank",
            values=(0.5, 1.0),
        )
    lock = {"link": 0.4, "output": 1.0}
    motion = trace(
        rbd.State(robot, np.array([0.7, 0.0, 1.5, 0.0, 0.0])), loops[:1], joint="crank", values=(0.7, 2.0), fixed=lock
    )
    assert motion.complete and np.array_equal(motion.q[:, 3:], np.tile([0.4, 1.0], (len(motion), 1)))


def test_a_structure_and_a_joint_that_does_not_move_are_refused():
    """No degree of freedom left, a driven joint that is fixed, a joint that stands still."""
    robot, loops = four_bar(*CRANK_ROCKER)
    q0 = np.array([0.7, -0.03, 1.5])
    value = four_bar_angles(*CRANK_ROCKER, 0.7)[0][1]
    with pytest.raises(rbd.InputError, match="does not move"):
        trace(rbd.State(robot, q0), loops, joint="crank", values=(0.7, 1.0), fixed={"rocker": value})
    with pytest.raises(rbd.InputError, match="driven and fixed"):
        trace(rbd.State(robot, q0), loops, joint="crank", values=(0.7, 1.0), fixed={"crank": 0.7})
    still = rbd.JointLock("brake", "output", position=1.0)
    six, six_loops = six_bar()
    q6 = np.array([0.7, 0.0, 1.5, 0.0, 1.0])
    with pytest.raises(rbd.InputError, match="is at rest while"):
        trace(rbd.State(six, q6), [six_loops[0], still], joint="output", values=(1.0, 1.5), fixed={"link": 0.0})


def test_a_start_where_branches_meet_is_refused():
    """At the flat pose of a rhombus both branches begin: which one is meant, the start must say."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    with pytest.raises(rbd.InputError, match="is singular: 2 degrees of freedom, branches meet there"):
        trace(rbd.State(robot, np.array([math.pi, -math.pi, math.pi])), loops, joint="crank", values=(math.pi, 4.0))


def test_a_start_at_a_limit_is_refused():
    """Two ways lead away from a dead centre."""
    robot, loops = slider_crank(1.0, 3.0)
    with pytest.raises(rbd.InputError, match="at a limit of its motion"):
        trace(rbd.State(robot, np.array([0.0, 0.0, 4.0])), loops, joint="slider", values=(4.0, 3.0))


def test_a_start_that_does_not_close_is_told():
    """As `assemble` tells it."""
    robot, loops = four_bar(*TRIPLE_ROCKER)
    with pytest.raises(CannotAssemble):
        trace(rbd.State(robot, np.array([0.5, 0.5, 1.5])), loops, joint="crank", values=(2.5, 3.0))


def test_a_stop_ends_the_motion_where_it_is():
    """The rocker's stop at 2 rad is reached with the crank where the closed form has it; no pose is beyond."""
    robot, loops = four_bar(*CRANK_ROCKER)
    stop = rbd.JointLimit("stop", "rocker", lower=-3.0, upper=2.0)
    motion = trace(rbd.State(robot, np.array([0.7, -0.03, 1.5])), [*loops, stop], joint="crank", values=(0.7, 3.0), steps=200)
    assert motion.stopped_by == "stop" and not motion.complete and "stopped by 'stop'" in str(motion)
    assert motion.q[-1, 2] == pytest.approx(2.0, abs=1e-9) and motion.q[:, 2].max() <= 2.0 + 1e-9
    rocker = four_bar_angles(*CRANK_ROCKER, float(motion.input[-1]))[0][1]
    assert rocker == pytest.approx(2.0, abs=1e-9)
    short = trace(
        rbd.State(robot, np.array([0.7, -0.03, 1.5])),
        [*loops, stop],
        joint="crank",
        values=(0.7, float(motion.input[-1]) - 1e-3),
    )
    assert short.complete and not short.stopped_by


def test_joints_beyond_their_files_limits_are_named():
    """They end nothing unless they are given as stops."""
    robot, loops = four_bar(*CRANK_ROCKER)
    robot.model.upperPositionLimit = np.array([9.0, 9.0, 2.0])
    motion = trace(rbd.State(robot, np.array([0.7, -0.03, 1.5])), loops, joint="crank", values=(0.7, 3.0))
    assert motion.complete and [x.joint for x in motion.beyond_limits] == ["rocker"]


def test_every_branch_of_a_six_bar_is_its_own_curve():
    """Traced from two branches over the same way, the poses never meet."""
    robot, loops = six_bar()
    found = branches(at_neutral(robot), loops, fixed={"crank": 0.7})
    one, other = (trace(rbd.State(robot, q), loops, joint="crank", values=(0.7, 1.5), steps=40) for q in found.q)
    assert one.complete and other.complete
    closure = Closure(robot, loops)
    assert min(distance(closure.robot, a, b) for a, b in zip(one.q, other.q, strict=True)) > 0.1
    assert max(one.residual.max(), other.residual.max()) <= 1e-12


def test_bennetts_linkage_turns_over_constrained():
    """Four hinges in space, five rows of rank two: tan(th1 / 2) tan(th2 / 2) = sin((b + a) / 2) / sin((b - a) / 2)."""
    robot, hinge = bennett(1.0, 0.6, 1.4), [pinned("revolute")]
    motion = trace(rbd.State(robot, np.array([2.35, -4.14, 3.93])), hinge, joint="j0", values=(2.35, 2.35 + TURN), steps=60)
    assert motion.complete and not motion.crossings and not motion.limits and motion.residual.max() <= 1e-12
    beta = math.asin(1.4 * math.sin(0.6))
    constant = math.sin((beta + 0.6) / 2.0) / math.sin((beta - 0.6) / 2.0)
    products = np.tan(motion.q[:, 0] / 2.0) * np.tan(motion.q[:, 1] / 2.0)
    assert np.abs(products / constant - 1.0).max() < 1e-9


def test_sarrus_linkage_folds_straight():
    """Six hinges, counted 0: driven by one, all its joints follow the fold in closed form."""
    robot, hinge = sarrus()
    motion = trace(rbd.State(robot, sarrus_pose(0.8)), [hinge], joint="x0", values=(0.8, 1.4), steps=12)
    assert np.abs(motion.q - [sarrus_pose(u) for u in motion.input]).max() < 1e-11


def test_a_start_far_from_q0_is_told():
    """A trace says how far its first pose is from what was given."""
    robot, loops = four_bar(*CRANK_ROCKER)
    far = trace(rbd.State(robot, np.array([0.7, 0.8, 1.0])), loops, joint="crank", values=(0.7, 0.8), steps=1)
    assert far.moved == pytest.approx(float(np.linalg.norm(far.q[0] - [0.7, 0.8, 1.0])), abs=1e-12)
    assert "its first pose is 0.9837 rad from the start, over all joints (root of the sum of squares)" in str(far)
    assert "from the start" not in str(trace(rbd.State(robot, far.q[0]), loops, joint="crank", values=(0.7, 0.8), steps=1))


def test_progress_is_told():
    """From above 0 to 1, never back."""
    told: list[float] = []
    robot, loops = four_bar(*CRANK_ROCKER)
    trace(
        rbd.State(robot, np.array([0.7, -0.03, 1.5])), loops, joint="crank", values=(0.7, 2.0), steps=10, progress=told.append
    )
    assert len(told) == 10 and told[-1] == 1.0 and sorted(told) == told


@pytest.mark.parametrize(
    ("joint", "values", "more", "error", "match"),
    [
        ("cranck", (0.7, 1.0), {}, rbd.errors.JointNotFound, "crank"),
        ("crank", (0.7,), {}, rbd.InputError, "start, stop"),
        ("crank", (0.7, math.nan), {}, rbd.InputError, "not finite"),
        ("crank", "01", {}, rbd.InputError, "numbers"),
        ("crank", (0.7, 1.0), {"steps": 0}, rbd.InputError, "steps"),
        ("crank", (0.7, 1.0), {"longest_step": 2.0}, rbd.InputError, "longest_step"),
        ("crank", (0.7, 1.0), {"progress": 3}, rbd.InputError, "progress"),
    ],
)
def test_bad_arguments_are_refused(joint: str, values: object, more: dict, error: type[Exception], match: str):
    """In words."""
    robot, loops = four_bar(*CRANK_ROCKER)
    with pytest.raises(error, match=match):
        trace(rbd.State(robot, np.array([0.7, -0.03, 1.5])), loops, joint=joint, values=values, **more)  # type: ignore[arg-type]


def test_a_joint_with_several_freedoms_cannot_be_driven():
    """One number drives one degree of freedom."""
    robot = rbd.load_robot("bolt")
    with pytest.raises(rbd.InputError, match="6 degrees of freedom"):
        trace(robot.standing(), robot.feet(friction=None), joint="root_joint", values=(0.0, 1.0))


def test_times_and_rates_are_those_of_a_unit_speed():
    """Q along t is the states' v to the error of central differences, h^2 / 6 times the third derivative; limits have none."""
    robot = rbd.mechanism.four_bar(*CRANK_ROCKER)
    path = trace(robot.at("assembled"), joint="crank_joint", values=(1.0, 0.0), steps=100)
    assert np.abs(path.t - np.linspace(0.0, 1.0, 101)).max() < 1e-15
    assert [state.t for state in path.states] == path.t.tolist()
    v = np.array([state.v for state in path.states])
    assert np.array_equal(v[:, 0], -np.ones(101)) and np.array_equal(path.rates[:, 0], np.ones(101))  # it turns backwards
    h = 1.0 / 100
    steps = np.array([pin.difference(robot.model, a, b) for a, b in zip(path.q[:-2], path.q[2:], strict=True)])
    assert np.abs(steps / (2.0 * h) - v[1:-1]).max() < 3.0 * h**2
    known = rbd.mechanism.velocity_partition(path.states[7], known={"crank_joint": -1.0}).v
    assert np.abs(known - v[7]).max() < 1e-12
    stops = trace(rbd.mechanism.four_bar(2.0, 2.0, 2.0, 3.0).at("assembled"), joint="crank_joint", values=(1.0, 3.0))
    assert np.isnan(stops.rates[-1]).all() and not stops.states[-1].v.any() and np.isfinite(stops.rates[:-1]).all()


def test_a_trace_goes_into_singularities_along_as_it_is():
    """A rocker turns back where crank and coupler are in line, b + a or b - a from the pin: the angles of two triangles."""
    a, b, c, d = CRANK_ROCKER
    robot = rbd.mechanism.four_bar(*CRANK_ROCKER)
    path = trace(robot.at("assembled"), joint="crank_joint", values=(0.0, TURN), steps=30)
    passed = rbd.mechanism.singularities_along(path.states[0], path=path, outputs=["rocker_joint"])
    found = sorted(rbd.mechanism.link_angles(robot.at(s.q))["crank"] % TURN for s in passed.found)
    assert found == pytest.approx([angle_between(b + a, d, c), angle_between(b - a, d, c) + math.pi], abs=1e-6)


def test_points_of_the_coupler_are_those_of_its_angle():
    """A point 1 along and 0.5 across the coupler, in the world, from the angles of crank and coupler."""
    robot = rbd.mechanism.four_bar(*CRANK_ROCKER)
    path = trace(robot.at("assembled"), joint="crank_joint", values=(0.0, 1.0), steps=4)
    angles = [rbd.mechanism.link_angles(state) for state in path.states]
    z = np.array([np.exp(1j * x["crank"]) + (1.0 + 0.5j) * np.exp(1j * x["coupler"]) for x in angles])
    found = path.points("coupler", (1.0, 0.0, 0.5))
    assert np.abs(found[:, [0, 2]] - np.stack([z.real, z.imag], axis=1)).max() < 1e-12
    assert repr(path).startswith("Trace(crank_joint from 0.00 deg to 57.30 deg: 5 poses") and len(repr(path)) < 120
