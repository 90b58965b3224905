"""What `rbd.solve` takes by default: Gauss's QP first, circular cones where its answer is not one of Coulomb's law."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from test_admm import signorini_and_coulomb

import rbd
from rbd.errors import InputError
from rbd.problem.residuals import residuals_of
from rbd.solvers.default import GaussFirst, coulombs, solver_of
from rbd.testing import box

G = 9.81
MASS = 10.0
CORNERS = [[0.2, 0.2, 0.0], [0.2, -0.2, 0.0], [-0.2, -0.2, 0.0], [-0.2, 0.2, 0.0]]


def on_floor(friction=0.6, facets=4):
    """A box of 10 kg on its lower face, with its problem's contacts."""
    robot = box(MASS, (0.4, 0.4, 0.2))
    sole = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=sole, friction=friction, facets=facets)
    return rbd.State(robot, pin.neutral(robot.model)), [floor]


def pushed(force, at=(0.0, 0.0, 0.0), friction=0.6, facets=4, **chosen):
    """The box under a push."""
    state, floor = on_floor(friction, facets)
    return rbd.solve(state, np.zeros(0), floor, external=rbd.ExternalForce("box", force, offset=at), **chosen)


def test_the_box_under_both_laws():
    """80 N at friction 0.6: (80 - 58.86) / 10 and 98.1 N; or, lifting at mu times its slide, (m g + mu F) / (1 + mu^2)."""
    coulomb, convex = pushed((80.0, 0.0, 0.0)), pushed((80.0, 0.0, 0.0), law="convex")
    assert coulomb.a == pytest.approx([2.114, 0, 0, 0, 0, 0], abs=1e-9)
    assert coulomb.contacts["floor"].normal == pytest.approx(98.1)
    normal = (MASS * G + 0.6 * 80.0) / 1.36
    assert normal == pytest.approx(107.4, abs=0.05)
    assert convex.a[[0, 2]] == pytest.approx([1.554, 0.933], abs=5e-4) and np.abs(convex.a[[1, 3, 4, 5]]).max() < 1e-9
    assert convex.contacts["floor"].normal == pytest.approx(normal)
    assert (str(coulomb.law), str(convex.law)) == ("coulomb", "convex")


def test_the_law_and_what_answered_stand_in_the_first_line():
    """Closed form, QP, or cones."""
    state, _ = on_floor()
    glued = rbd.solve(state, np.zeros(0), [rbd.PointContact("glue", "box")])
    for s, method, law in (
        (glued, "closed form", "bilateral"),
        (pushed((30.0, 0.0, 0.0)), "closed form", "coulomb"),
        (pushed((30.0, 0.0, 0.0), solver=GaussFirst()), "QP", "coulomb"),
        (pushed((80.0, 0.0, 0.0)), "cones: Newton", "coulomb"),
        (pushed((80.0, 0.0, 0.0), solver=GaussFirst()), "cones: ADMM, Newton", "coulomb"),
        (pushed((30.0, 0.0, 0.0), law="convex"), "closed form", "convex"),
        (pushed((30.0, 0.0, 0.0), solver=rbd.ProxQP()), "QP", "convex, 4 facets"),
    ):
        assert s.method == method and str(s).splitlines()[0].startswith(f"solved by {method}, law: {law}; ")


def test_what_sticks_in_the_pyramid_and_not_in_the_cone_slides():
    """80 N on the diagonal, 4 facets: the QP holds the box, with 136 % of the friction that there is."""
    push = (80.0 / 2**0.5, 80.0 / 2**0.5, 0.0)
    assert np.abs(pushed(push, solver=rbd.ProxQP()).a).max() < 1e-9
    slides = pushed(push)
    assert np.hypot(*slides.a[:2]) == pytest.approx(2.114) and slides.method.startswith("cones")


def test_each_corner_counts_and_not_the_soles_resultant():
    """On its edge: two corners leave steeply and carry nothing, two keep still and carry all."""
    tips = partial(pushed, (0.0, 0.0, -150.0), at=(0.35, 0.0, 0.1), friction=2.0)
    for s, method in ((tips(), "cones: Newton"), (tips(solver=GaussFirst()), "QP")):
        assert s.method == method and s.a[4] > 0.1
        normals = s.corner_forces["floor"][:, 2]
        assert (normals > 1.0).sum() == 2 and (np.abs(normals) < 1e-9).sum() == 2
        assert signorini_and_coulomb(s) < 1e-9


def test_a_centre_of_pressure_near_an_edge_is_no_reason_to_go_on():
    """The shortest forces of four corners would pull at two of them: those in the cones do not, and the QP's motion stays."""
    s = pushed((0.0, 0.0, 0.0), friction=0.6, solver=GaussFirst())
    leaning = pushed((15.0, 4.0, -60.0), at=(0.35, 0.28, 0.1), friction=0.6, solver=GaussFirst())
    for each in (s, leaning):
        assert each.method == "QP" and np.abs(each.a).max() < 1e-9
        forces = each.corner_forces["floor"]
        assert forces[:, 2].min() >= -1e-12
        assert (np.hypot(forces[:, 0], forces[:, 1]) <= 0.6 * forces[:, 2] + 1e-9).all()
    naive = np.linalg.pinv(leaning.problem.force_set.G) @ leaning.multipliers
    assert naive[2::3].min() < -1e-3
    found, jammed = coulombs(rbd.ProxQP().solve(leaning.problem))
    assert found is not None and not jammed and found.residuals.within(1e-9)


@pytest.mark.parametrize("twice", [False, True])
def test_a_motion_in_which_one_point_sticks_and_another_slips_is_not_coulombs(twice):
    """Convex: the slipping point also lifts, under a load. Without one it is Coulomb's: unloaded points may do both."""
    J, cone = np.eye(6), rbd.problem.FrictionCone(0.5)
    rows = [rbd.Rows("sticks", J[:3], np.zeros(3), cone), rbd.Rows("slips", J[3:], np.zeros(3), cone)]
    rows += [rbd.Rows("sticks again", J[:3], np.zeros(3), cone)] * twice
    for load, coulomb in ((-10.0, False), (12.0, True)):
        convex = rbd.ProxQP().solve(rbd.GaussProblem(np.eye(6), [1.0, 0.0, -10.0, 20.0, 0.0, load], rows))
        assert convex.status == "solved" and np.abs(convex.a[:3]).max() < 1e-9 < convex.a[5]
        found, jammed = coulombs(convex)
        assert not jammed and (found is not None and found.status == "solved") == coulomb == (found is not None)


def test_limits_dry_friction_and_smooth_contacts_do_not_count():
    """They move and carry as they like: both laws treat them alike."""
    rows = [
        rbd.Rows("stop", np.eye(3)[:1], np.zeros(1), rbd.problem.NonNegative(1)),
        rbd.Rows("rubs", np.eye(3)[1:2], np.zeros(1), rbd.problem.Bounds([-3.0], [3.0])),
        rbd.Rows("smooth", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.0)),
    ]
    s = rbd.solve_problem(rbd.GaussProblem(np.eye(3), [-5.0, 7.0, -9.0], rows))
    assert s.method == "QP" and s.a == pytest.approx([0.0, 4.0, 0.0], abs=1e-12)
    assert np.concatenate(list(s.forces.values())) == pytest.approx([5.0, -3.0, 0.0, 0.0, 9.0], abs=1e-12)
    assert residuals_of(s.problem, s.a, s.multipliers, s.weights, "coulomb").within(1e-9)


def test_where_the_qp_has_no_answer_coulombs_law_may():
    """A point is drawn along the ground at 1 m/s2: the convex law would lift it, and it must not. Coulomb's law rubs it."""
    rows = [
        rbd.Rows("drawn", np.eye(3)[[0]], np.array([-1.0]), rbd.problem.Free(1)),
        rbd.Rows("kept down", np.eye(3)[[2]], np.zeros(1), rbd.problem.Free(1)),
        rbd.Rows("ground", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.5)),
    ]
    P = rbd.GaussProblem(np.eye(3), [0.0, 0.0, -10.0], rows)
    for convex in ({"law": "convex"}, {"solver": rbd.ProxQP()}):
        with pytest.raises(rbd.NoSolution, match="contradict each other"):
            rbd.solve_problem(P, **convex)
    s = rbd.solve_problem(P)
    assert s.status == "solved" and s.a == pytest.approx([1.0, 0.0, 0.0], abs=1e-9) and s.method.startswith("cones")
    f = s.forces["ground"]
    assert f[0] == pytest.approx(-0.5 * f[2], abs=1e-9) and abs(f[1]) < 1e-9 and f[2] >= 0.0


def test_rows_that_contradict_each_other_are_named_with_their_certificate():
    """By the law's own rows: a floor that is to be left upwards and downwards. Unchecked: the motion of least violation."""
    rows = [
        rbd.Rows("floor", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.6)),
        rbd.Rows("press", np.eye(3)[[2]], np.array([1.0]), rbd.problem.Free(1)),
    ]
    P = rbd.GaussProblem(np.eye(3), [0.0, 0.0, -10.0], rows)
    with pytest.raises(rbd.NoSolution, match="'floor' .normal. and 'press' contradict each other") as caught:
        rbd.solve_problem(P)
    assert caught.value.contradiction is not None and str(caught.value.contradiction.law) == "coulomb"
    near = caught.value.nearest()
    assert near.a == pytest.approx([0.0, 0.0, -0.5], abs=1e-9) and str(near.solution.law) == "coulomb"
    unchecked = rbd.solve_problem(P, check=False)
    assert unchecked.status is rbd.problem.Status.INFEASIBLE and unchecked.a == pytest.approx(near.a, abs=1e-9)
    assert rbd.answers.solution.nearest_motion(P, law="convex").a == pytest.approx([0.0, 0.0, -0.5], abs=1e-9)


@pytest.mark.parametrize(
    ("law", "solver"), [("coulomb", rbd.ProxQP()), ("convex", rbd.ConeSolver()), ("coulomb", rbd.ConeSolver(law="convex"))]
)
def test_a_law_and_a_solver_of_another_are_refused(law, solver):
    """Which of the two is meant is not guessed."""
    with pytest.raises(
        InputError, match=rf"law is '{law}', and solver={type(solver).__name__}\(\.\.\.\) solves for the (convex|coulomb) law"
    ):
        pushed((30.0, 0.0, 0.0), law=law, solver=solver)
    with pytest.raises(InputError, match="Leave one of them out"):
        rbd.answers.solution.nearest_motion(rbd.GaussProblem(np.eye(1), [1.0]), law=law, solver=solver)


def test_what_is_no_law_is_refused_and_what_fits_is_taken():
    """A solver for rows that hold has no law of slipping; a `Law` is as good as its word."""
    for wrong in ("bilateral", "convex, 4 facets", "hooke", 3):
        with pytest.raises(InputError, match="expected 'coulomb' or 'convex'"):
            pushed((30.0, 0.0, 0.0), law=wrong)
        with pytest.raises(InputError, match="expected 'coulomb' or 'convex'"):
            rbd.simulate(on_floor()[0], duration=0.1, step=0.1, law=wrong)
    assert solver_of("convex", rbd.KKT()) == rbd.KKT() and solver_of("coulomb", rbd.KKT()) == rbd.KKT()
    assert solver_of(None, None) == solver_of(rbd.problem.gauss_problem.COULOMB, None) == GaussFirst()
    assert solver_of("convex", None) == solver_of("convex", rbd.ConeSolver(law="convex")) == rbd.ConeSolver(law="convex")


def drawn(name: str, count: int, seed: int):
    """Problems of a standing robot: noise on its torques, a push, friction from 0.2 to 0.7."""
    rng = np.random.default_rng(seed)
    robot = rbd.load_robot(name)
    state = robot.standing()
    tau = rbd.hold(state, robot.feet(0.7)).tau
    frame = {"talos": "torso_2_link", "g1": "torso_link", "solo12": "base_link"}[name]
    limit, size = robot.effort_limit, 0.1 if name == "solo12" else 1.0
    for _ in range(count):
        push = rng.normal(size=3) * robot.mass * G * rng.choice([0.05, 0.3, 0.8])
        noise = size * rng.choice([0.0, 1.0, 10.0]) * rng.normal(size=robot.nu)
        feet = robot.feet(rng.choice([0.2, 0.4, 0.7]))
        yield rbd.gauss_problem(state, np.clip(tau + noise, -limit, limit), feet, external=rbd.ExternalForce(frame, push))


@pytest.mark.parametrize("name", ["talos", "g1", "solo12"])
def test_it_is_the_motion_of_circular_cones_where_that_is_unique(name, exhaustive):
    """25 or 100 problems a robot: same a to 1e-8, Signorini's and Coulomb's laws at corners, same modes and derivatives."""
    of = dict.fromkeys(("QP", "cones"), 0)
    count = 100 if exhaustive else 25
    for i, P in enumerate(drawn(name, count, seed=5)):
        s, other = rbd.solve_problem(P), rbd.solve_problem(P, solver=rbd.ConeSolver())
        of[s.method[:5]] += 1
        assert s.status == "solved" and str(s.law) == "coulomb" and signorini_and_coulomb(s) < 1e-8
        size = max(1.0, np.abs(other.a).max())
        if other.reason:
            continue  # one of a family: see `test_admm.py`
        assert np.abs(s.a - other.a).max() < 1e-8 * size
        if i % 20 == 0:
            one, two = s.derivatives(), other.derivatives()
            assert one.active == two.active and np.abs(one.da_dtau - two.da_dtau).max() < 1e-7 * np.abs(two.da_dtau).max()
            assert s.uniqueness().motion_freedom == other.uniqueness().motion_freedom == 0
    assert of["QP"] > 0.3 * count and of["cones"] > 0.05 * count
