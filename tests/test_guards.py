"""Nonsense in, an `RbdError` out, or a right answer: a property of every public function, found by hypothesis.

Each function has a call that works, its arguments by name. One or two of them are replaced by nonsense: wrong types and
sizes, NaN, infinity, huge and ragged numbers, odd dtypes, masks, quaternions off the sphere, names that are nearly right.
What is then answered must be finite (and certified, where it is a solution), and the same as on the cleaned input.
"""

from __future__ import annotations

import inspect
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from itertools import combinations, islice
from pathlib import Path
from typing import Any

import coal
import hypothesis
import hypothesis.strategies as st
import numpy as np
import pinocchio as pin
import pytest
from hypothesis.configuration import set_hypothesis_home_dir
from matplotlib.figure import Figure

import rbd
from rbd.model.output_files import new_folder
from rbd.robots.loop_file import KINDS
from rbd.visual import (
    Scene,
    contact_colors,
    contact_sheet,
    export_motion,
    export_video,
    motion_sheet,
    notebook_page,
    plot_control,
    plot_directions,
    plot_ellipses,
    plot_energy,
    plot_forces,
    plot_joint,
    plot_panels,
    plot_paths,
    plot_plan,
    plot_pushes,
    plot_ranges,
    plot_region,
    plot_report,
    plot_split,
    plot_sticks,
    plot_study,
    plot_timing,
    plot_walk,
    plot_wrench_cone,
    replay,
    scenes_beside,
    screenshot,
)

set_hypothesis_home_dir(Path(tempfile.gettempdir()) / "rbd_hypothesis")
EXAMPLES = 60
"""So many draws a function; a fifth of them but in `make exhaustive`."""
SETTINGS = hypothesis.settings(
    derandomize=True,
    deadline=None,
    database=None,
    phases=(hypothesis.Phase.generate,),
    suppress_health_check=list(hypothesis.HealthCheck),
)
LONGEST_MESSAGE = 1500

URDF = Path(__file__).parents[1] / "urdf" / "box.urdf"
LOOPED = URDF.with_name("four_bar.urdf")
BOX = rbd.load_robot(URDF)
STAIRS = rbd.Terrain.stairs(0.1, 0.3, 3)
WORLD, WEDGE = (Path(tempfile.mkdtemp()) / name for name in ("world.urdf", "wedge.stl"))
WORLD.write_text(
    '<robot name="w"><link name="floor"><collision><geometry><box size="4 4 0.2"/></geometry></collision></link></robot>'
)
WEDGE.write_text(
    "solid wedge\n"
    + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {corner}\n" for corner in three) + "endloop\nendfacet\n"
        for three in combinations(("-1 -1 0", "1 -1 0", "0 1 0", "0 0 -1"), 3)
    )
    + "endsolid wedge\n"
)
with warnings.catch_warnings():
    warnings.simplefilter("ignore", rbd.errors.ModelWarning)
    BOLT = rbd.load_robot("bolt")
    SOLO_12 = rbd.load_robot("solo12")
    G1 = rbd.load_robot("g1")
STATE = BOLT.standing()
FEET = BOLT.feet()
TAU = np.zeros(BOLT.nu)
PROBLEM = rbd.gauss_problem(STATE, TAU, FEET)
SOLUTION = rbd.solve(STATE, TAU, FEET)
V = np.linspace(-0.5, 0.5, BOLT.nv)
MOVING = rbd.State(BOLT, STATE.q, V)
LIFTED = {"root_joint": np.array([0.1, 0.2, 0.9, 0.0, 0.6, 0.0, 0.8])}
CORNERS = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])
ROWS = PROBLEM.rows[0]
PLAIN = {"name": "row", "J": np.array([[1.0, 0.0], [0.5, 2.0]]), "bias": np.array([0.5, -0.1])}
FRAME = BOLT.frames()[8]
PUSH = rbd.ExternalForce(FRAME, (0.0, 9.0, 0.0))
STANDS = {"robot": "solo12", "posture": "standing", "friction": 0.7, "at": "base_link", "push": 1.0, "push_angle": 30.0} | {
    "direction": (0.0, 1.0, 0.0), "push_x": 0.1, "push_y": 0.0, "push_z": -0.2
}  # fmt: skip
ASKED = {"state": STATE, "tau": TAU, "constraints": FEET, "external": np.zeros(BOLT.nv)}


FOUR_BAR = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
LINKED = FOUR_BAR.at("assembled")
HANGING = rbd.find_equilibrium(LINKED)
SWING = HANGING.linearised.modes()[0]
SLEIGH = rbd.load_robot(URDF.with_name("chaplygin_sleigh.urdf")).at(None, [2.0, 0.0, 0.0])
FROM_HERE = {"state": LINKED, "constraints": list(FOUR_BAR.loops())}
LOOPS = {"constraints": list(FOUR_BAR.loops()), "inputs": ["crank_joint"], "outputs": ["rocker_joint"]}


def use_contact(contact: Any) -> Any:
    """A contact's rows on the box, and what they hold."""
    state = rbd.State(BOX, BOX.neutral())
    return contact.rows(state), rbd.solve(state, [], [contact])


def use_joint(constraint: Any) -> Any:
    """The rows of a constraint on a joint, and what they do to Bolt in free fall."""
    return constraint.rows(STATE), rbd.solve(STATE, TAU, [constraint])


def use_moving(constraint: Any) -> Any:
    """Its rows on a box in flight, and what they do to it."""
    state = rbd.State(BOX, BOX.neutral(), np.array([0.3, -0.2, 0.1, 0.5, 0.4, -0.6]))
    return constraint.rows(state), rbd.solve(state, [], [constraint])


SQUEEZED = rbd.GaussProblem(
    np.eye(1), np.ones(1), [rbd.Rows("row", np.array([[1.0], [-1.0]]), np.array([-1.0, -0.5]), rbd.problem.NonNegative(2))]
)


def use_contradiction(**given: Any) -> Any:
    """The certificate and the violation of a contradiction, if there is one."""
    found = rbd.answers.analysis.contradiction(**given)
    return None if found is None else (dict(found.certificate), found.violation)


def use_linearised(**given: Any) -> Any:
    """Its matrices and eigenvalues."""
    found = rbd.linearise(**given)
    return found.A, found.B, np.sort_complex(found.eigenvalues).view(float)


MANY = {"robot": BOLT, "q": np.tile(STATE.q, (2, 1)), "v": np.zeros((2, BOLT.nv)), "tau": TAU, "constraints": FEET}


def use_worlds(**given: Any) -> Any:
    """The worlds that go on."""
    found = rbd.simulate_many(**given)
    goes = found.stopped < 0
    return [array[goes] for array in (found.q, found.v, found.residual, found.points)]


def use_many(**given: Any) -> Any:
    """The rows that have an answer."""
    found = rbd.solve_many(**given)
    return [array[found.answered] for array in (found.a, found.worst, *found.forces.values(), *found.corner_forces.values())]


def use_actuations(found: rbd.statics.Actuations) -> Any:
    """The rows that have an answer."""
    return [array[found.answered] for array in (found.tau, found.worst, *found.forces.values())]


def abs_of(x: float) -> dict[str, float]:
    """A function to be studied."""
    return {"value": abs(x)}


STORED = new_folder() / "stored.zarr"
rbd.study(abs_of, {"x": [0.5, -1.0]}, executor=0, progress=False, out=STORED)


def a_study() -> Any:
    """What `rbd.study` returns, of three dimensions of two values: ok and not ok."""
    import xarray

    dims = {"friction": [0.2, 0.4], "push": [10.0, 50.0], "side": ["left", "right"]}
    given = xarray.Dataset(coords=dims)
    used = given.push / (given.friction * 98.1) + xarray.zeros_like(given.side, float)
    used = used.where(used < 1.0) + xarray.DataArray([0.0, 1.0, 2.0], dims="row", coords={"row": ["fx", "fy", "fz"]})
    ok = np.isfinite(used[..., 0].drop_vars("row"))
    return xarray.Dataset({"ok": ok, "reason": (~ok * 41).astype("int16"), "used": used})


STUDIED = a_study()


def use_cone(cone: Any) -> Any:
    """A set of forces in a problem of its own."""
    n = cone.dim
    rows = rbd.Rows("row", np.eye(n), np.zeros(n), cone)
    problem = rbd.GaussProblem(np.eye(n), np.linspace(-1.0, 1.0, n), [rows])
    return cone.project(np.linspace(-1.0, 1.0, n)), solved(problem)


def solved(problem: rbd.GaussProblem) -> rbd.Solution | None:
    """What ProxQP makes of a problem; a failure that says so is no answer."""
    if rbd.ProxQP().reason_unsupported(problem) is not None:
        return None
    found = rbd.solve_problem(problem, check=False)
    return None if found.status in (rbd.problem.Status.FAILED, rbd.problem.Status.INFEASIBLE) else found


def use_rows(**given: Any) -> Any:
    """Rows in a problem of their own."""
    rows = rbd.Rows(**given)
    return rows, solved(rbd.GaussProblem(np.eye(2), np.ones(2), [rows]))


def use_problem(**given: Any) -> Any:
    """The free acceleration of a problem, and its solution."""
    problem = rbd.GaussProblem(**given)
    return problem.a_free, solved(problem)


def use_force(**given: Any) -> Any:
    """What an external force does."""
    return rbd.dynamics.free_acceleration(STATE, TAU, rbd.ExternalForce(**given))


def use_element(element: Any) -> Any:
    """What a force element does, with its derivatives and its energy."""
    state = rbd.State(BOX, [0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], np.full(6, 0.1))
    return (
        element.generalised(state),
        element.derivatives(state),
        element.energy(state),
        rbd.solve(state, [], external=element).a,
    )


def use_joint_element(element: Any) -> Any:
    """The same of one in a joint of Bolt."""
    return element.generalised(MOVING), element.derivatives(MOVING), element.energy(MOVING)


ENDS = {"frame": "box", "to": np.array([0.0, 0.1, 2.0]), "offset": (0.1, 0.0, 0.0), "to_offset": np.zeros(3), "name": "one"}


def use_scene(state: Any, solution: Any, external: Any, arrow_per_weight: Any, seen_from: Any) -> Any:
    """The scale of a picture, and its marks."""
    scene = Scene(BOLT, arrow_per_weight=arrow_per_weight, seen_from=seen_from)
    scene.show(state, solution, external=external)
    return scene.metres_per_newton, [mark.points for mark in scene.drawn]


def use_explore(controls: Any, values: Any) -> Any:
    """A page with a slider: its values after it has been set."""
    with Scene(BOX) as scene, rbd.visual.explore(scene, controls, lambda values: rbd.visual.Verdict("Holds")) as page:
        page.set(values)
        return page.wait(), page.values


def use_export(path: Any) -> Any:
    """An exported page; only odd paths come here, and none of them can be written."""
    scene = Scene(BOX)
    scene.show(BOX.at())
    return scene.export(path)


def use_plot(ax: Any, uniqueness: Any) -> Any:
    """Where bars and marks are."""
    return [artist.get_xdata() for artist in plot_ranges(ax, uniqueness)]


FLOOR = [rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=0.5)]
ON_FLOOR = [rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)]
REGION = rbd.statics.support_region(BOX.at(), FLOOR)


def use_region(ask: Any = rbd.statics.support_region, **given: Any) -> Any:
    """How far a region reaches, and its certificate."""
    region = ask(**given)
    return [region.vertices.min(axis=0, initial=0.0), region.vertices.max(axis=0, initial=0.0), str(region)]


TRAJECTORY = rbd.simulate(BOX.at(), FLOOR, duration=0.003, step=1e-3)
LINKS = rbd.planar.Chain(2, lengths=[0.5, 0.4])
PLANAR = rbd.planar.endpoint_motion(LINKS, rbd.planar.minimum_jerk([0.6, 0.3], [0.2, 0.6], 1.0))
HOLD_BOLT = rbd.control.HoldPosture(STATE, FEET)
STILL_BOLT = rbd.motion.minimum_jerk(BOLT, [STATE.q, STATE.q], [0.0, 0.02], rate=100.0)


def height(state: Any) -> float:
    """An event: the box is 0.1 mm below its start."""
    return float(state.q[2] - BOX.at().q[2] + 1e-4)


FALLING = BOX.at().with_velocity(np.array([0.1, 0.0, -1.0, 0.0, 0.2, 0.0]))


def use_simulate(**given: Any) -> Any:
    """Where a motion went."""
    moved = rbd.simulate(**given)
    return moved.t, moved.q, moved.v, moved.a


def use_integrator(integrator: Any) -> Any:
    """What one makes of a box in flight."""
    return use_simulate(state=BOX.at(), constraints=[], duration=0.01, step=0.005, integrator=integrator)


def use_controller(controller: Any) -> Any:
    """Its torques."""
    return controller(STATE, 0.001)


def use_whole_body(controller: Any) -> Any:
    """Its torques, and what it logs of the step."""
    controller.accepted(rbd.control.AcceptedStep(STATE, 0.0, 1e-3, {}))
    return controller(STATE, 0.0), controller.log.residual, controller.log.torque_share


TROT = rbd.control.Walk(SOLO_12, 1, gait="trot")
TROT.accepted(rbd.control.AcceptedStep(TROT.state, 0.0, 1e-3, {}))
TROT_LOG = TROT.log
SMALL_PLAN = rbd.plan(
    SOLO_12, {0.0: "standing", 0.2: "standing"}, {foot.name: True for foot in SOLO_12.feet()}, self_collision=False,
    progress=False,
)  # fmt: skip


def use_walk(robot: Any, steps: Any = 1, *args: Any, **given: Any) -> Any:
    """Its first torques, and where it means to go."""
    walk = rbd.control.Walk(robot, min(steps, 3) if isinstance(steps, int) else steps, *args, **given)
    walk.accepted(rbd.control.AcceptedStep(walk.state, 0.0, 1e-3, {}))
    return walk(walk.state, 0.0), walk.plan.centroid.com, str(walk)


def use_balance(**given: Any) -> Any:
    """Its first torques, and where it stands."""
    balance = rbd.control.Balance(**given)
    balance.accepted(rbd.control.AcceptedStep(balance.state, 0.0, 1e-3, {}))
    return balance(balance.state, 0.0), balance.plan.centroid.com, str(balance)


def use_capture(**given: Any) -> Any:
    """Its polygons, and what they say of a point."""
    region = rbd.control.capture_region(**given)
    return region.inner, region.outer, region.capture_point, region.contains([0.0, 0.0]), region.beyond([1.0, 0.0])


def use_schedule(schedule: Any) -> Any:
    """When contacts are wanted, and how much they may carry."""
    return schedule.wanted(0.02), schedule.share("foot", 0.02), schedule.normal_force(0.02, 800.0), schedule.in_flight(["foot"])


def use_task(task: Any) -> Any:
    """Its rows at a moving state."""
    terms = task.terms(MOVING, 0.25)
    return terms.A, terms.wanted, terms.cost


def use_step(**given: Any) -> Any:
    """What a step does, and what it says of itself."""
    found = rbd.control.step(**given)
    return found.a, found.tau, found.certificate.worst


def use_limits(limits: Any) -> Any:
    """Bounds of a moving state."""
    both = (limits.torques(BOLT), *limits.accelerations(MOVING))
    return [np.clip(each, -1e9, 1e9) for each in both]  # infinite where there is no limit


def use_collision(**given: Any) -> Any:
    """Rows and points of a robot's collision shapes."""
    contacts = rbd.CollisionContacts(**grounded(given))
    return contacts.rows(BOX.at()), contacts.points(BOX.at()).positions


def use_plots(plot: Any, **given: Any) -> Any:
    """That a plot of a motion draws something."""
    return len(plot(**given))


CARRIED = {"mass": 2.0, "grasps": ["FL_FOOT", "FR_FOOT"], "size": (0.1, 0.2, 0.3), "inertia": (0.1, 0.1, 0.1), "name": "box"}
CARRIED |= {"placement": pin.SE3.Identity(), "second": np.eye(4), "shares": (0.25, 0.75)}


def use_carried(**given: Any) -> Any:
    """Its inertia, and the mass of a robot that holds it."""
    thing = rbd.Carried(**given)
    return thing.inertia, thing.size, BOLT.carrying(thing).at().M


def use_carrying(carrying: Callable[..., Any], thing: Any, **given: Any) -> Any:
    """The equations of motion of what carries it."""
    found = carrying(thing, **given)
    return getattr(found, "robot", found).at().M


@dataclass(frozen=True)
class Case:
    """A public callable, by its name, and arguments that work."""

    call: Callable[..., Any]
    good: dict[str, Any]
    examples: int = EXAMPLES


def contact_case(kind: Any, more: dict[str, Any]) -> Case:
    """A contact, made and used."""
    good = {"name": "floor", "frame": "box", "friction": 0.5, "facets": 4, **more}
    return Case(lambda **given: use_contact(kind(**grounded(given))), good)


def grounded(given: dict[str, Any]) -> dict[str, Any]:
    """What a contact is given, the arguments of a ground made one."""
    of_ground = {key: value for key, value in given.items() if key in GROUND}
    rest = {key: value for key, value in given.items() if key not in GROUND}
    return rest | ({"on": rbd.Ground(**of_ground)} if of_ground else {})


TASK = {"cost": np.ones(3), "gain": 10.0, "damping_ratio": 0.7, "name": "own"}
GROUND = ("normal", "point", "velocity", "acceleration", "about")


def rolling_case(kind: Any, **more: Any) -> Case:
    """A ball, a disk or a wheel, made and used: at rest, and with a table that speeds up."""
    good = {"name": "it", "frame": "box", "radius": 0.1, "friction": 0.5, "facets": 4, **LIFT}
    good |= {"point": np.array([0.0, 0.0, -0.1]), "normal": np.array([0.0, 0.0, 1.0])}
    return Case(lambda **given: use_contact(kind(**grounded(given))), good | more)


LIFT = {"velocity": np.zeros(6), "acceleration": np.array([0.0, 0.0, 1.0]), "about": np.array([1.0, 0.0, 0.0])}


def use_pair(against: Any, **given: Any) -> Any:
    """Two robots in one model, and a contact between them."""
    pair = rbd.robots.merge_robots(**given)
    contact = rbd.SurfaceContact("between", given["names"][0] + "box", half_lengths=(0.1, 0.1), on=rbd.Body(against))
    return contact.rows(pair.at()), pair.mass, pair.at().M


def of_state(name: str, **more: Any) -> Case:
    """A function of `rbd.dynamics`."""
    return Case(getattr(rbd.dynamics, name), {"state": MOVING, **more})


def weighed(kind: Any, good: dict[str, Any], **more: Any) -> Case:
    """A solid, and what it weighs."""
    common = {"mass": 2.0, "at": (0.1, 0.2, 0.3), "rpy": (0.1, 0.2, 0.3), "color": "blue", "draws": True, "collides": False}

    def weigh(**given: Any) -> Any:
        solid = kind(**given)
        found = solid.mass_properties()
        return found.mass, found.lever, found.inertia, solid.volume, len(solid.drawn_sizes())

    return Case(weigh, {key: value for key, value in (good | common | more).items() if value is not None})


def use_builder(what: str, **given: Any) -> Any:
    """A part of a model in memory, and the robot: a body, a joint, a frame, a loop, a coupling, a wheel, a posture."""
    own = given if what == "robot" else {}
    b = rbd.RobotBuilder(**({"name": "guarded", "root": "fixed"} | own))
    for name in ("upper", "lower"):
        b.body(name, rbd.robots.Box((0.1, 0.2, 0.3), mass=1.0))
    for name, parent, child in (("one", "ground" if b.root == "fixed" else None, "upper"), ("two", "upper", "lower")):
        if parent:
            b.joint(name, parent, child, at=(0, 0, 1))
    b.body("free", rbd.robots.Sphere(0.1, mass=1.0))
    if what != "joint":
        b.joint("weld", "lower", "free", "fixed")
    if what != "robot":
        getattr(b, what)(**given)
    if what == "body":
        b.joint("three", "upper", given["name"])
    robot = b.robot()
    own = (*robot.loops(), *robot.wheels(), *robot.drives())
    return robot.mass, robot.nv, robot.at().M, [c.name for c in own], robot.frames()


def built(what: str, **good: Any) -> Case:
    """A method of a builder."""
    return Case(lambda **given: use_builder(what, **given), good, 60)


def use_word(word: Any, kind: Any) -> Any:
    """What a word of loop files stands for, while it is asked."""
    before = dict(KINDS)
    try:
        rbd.register_constraint(word, kind)
        return sorted(KINDS[word].keys)
    finally:
        KINDS.clear()
        KINDS.update(before)


def use_measured(*given: Any, ask: Any = rbd.estimate_forces, **named: Any) -> Any:
    """What explains a motion, what is left, and its covariance."""
    found = ask(*given, **named)
    return found.row_forces, found.residual, found.tau, found.net, found.row_covariance


ARM = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
ARM_MOTION = rbd.motion.minimum_jerk(ARM, [np.zeros(1), np.ones(1), np.zeros(1)], [0.0, 0.5, 1.2], rate=20.0)
ARM_MEASURED = rbd.motion.identification.MeasuredMotion(
    ARM_MOTION, np.array([rbd.dynamics.inverse_dynamics(ARM_MOTION.state(i), ARM_MOTION.a[i]) for i in range(ARM_MOTION.n)])
)


def use_identified(**given: Any) -> Any:
    """What is found."""
    found = rbd.identify(**given)
    return found.base_values, found.deviations, found.mass


def use_ground(on: Any) -> Any:
    """How far a point and a sole are from a plane."""
    contacts = rbd.PointContact("toe", "box", on=on), rbd.SurfaceContact("sole", "box", half_lengths=(0.1, 0.05), on=on)
    return [contact.rows(BOX.at()).patch.gaps for contact in contacts], [foot.on for foot in BOLT.feet(on=on)][0] is None


def use_terrain(terrain: rbd.Terrain) -> Any:
    """Its surface, and how far a point and a sole are from it."""
    P = np.array([[0.0, 0.0, 0.1], [0.3, 0.2, 0.0]])
    return finite(terrain.heights_of(P)), rbd.PointContact("toe", "box", on=terrain).rows(BOX.at()).patch.gaps, str(terrain)


def finite(x: Any) -> Any:
    """The numbers that are; infinity says that there is no terrain."""
    return x[~np.isinf(x)]


def use_samples(made: rbd.studies.Samples) -> Any:
    """How many there are, after all that can be asked of them has been; infinity and NaN are values like others."""
    n = len(made)
    made.columns(0, min(n, 9)), made.row(n - 1), made.coords(), made.digest(), f"{made} {made!r}"
    return n, len(made.names), len(made.fixed)


CASES: dict[str, Case] = {
    "Bounds": Case(
        lambda **given: use_cone(rbd.problem.Bounds(**given)), {"lo": np.array([-1.0, 0.0]), "hi": np.array([1.0, 2.0])}
    ),
    "Free": Case(lambda **given: use_cone(rbd.problem.Free(**given)), {"dim": 3}),
    "NonNegative": Case(lambda **given: use_cone(rbd.problem.NonNegative(**given)), {"dim": 3}),
    "EllipticCone": Case(lambda **given: use_cone(rbd.problem.EllipticCone(**given)), {"mu_x": 0.5, "mu_y": 0.4, "facets": 4}),
    "FrictionCone": Case(lambda **given: use_cone(rbd.problem.FrictionCone(**given)), {"mu": 0.5, "facets": 4}),
    "LineCone": Case(lambda **given: use_cone(rbd.problem.LineCone(**given)), {"half_length": 0.1, "mu": 0.5, "facets": 4}),
    "Product": Case(
        lambda **given: use_cone(rbd.problem.Product(**given)), {"cones": [rbd.problem.Free(1), rbd.problem.FrictionCone(0.5)]}
    ),
    "UnevenCone": Case(
        lambda **given: use_cone(rbd.problem.UnevenCone(**given)),
        {"corners": np.c_[CORNERS, np.zeros(4)], "axes": np.tile(np.eye(3), (4, 1, 1)), "mu": 0.5, "facets": 4, "dim": 6},
    ),
    "WrenchCone": Case(
        lambda **given: use_cone(rbd.problem.WrenchCone(**given)),
        {"corners": np.c_[CORNERS, np.zeros(4)], "mu": 0.5, "facets": 4},
    ),
    "PointContact": contact_case(rbd.PointContact, {"offset": np.array([0.1, 0.0, -0.1]), "normal": np.array([0.0, 0.0, 1.0])}),
    "SurfaceContact": contact_case(rbd.SurfaceContact, {"corners": CORNERS, "placement": np.eye(4)}),
    "PointContact, on a lift": contact_case(rbd.PointContact, LIFT | {"anchor": np.array([0.0, 0.1, 0.0])}),
    "SurfaceContact, on a lift": contact_case(rbd.SurfaceContact, LIFT | {"half_lengths": (0.1, 0.05), "anchor": np.eye(4)}),
    "LineContact": contact_case(
        rbd.LineContact, {"half_length": 0.1, "placement": np.eye(4), "normal": np.array([0.0, 0.0, 1.0])}
    ),
    "register_constraint": Case(use_word, {"word": "pillar", "kind": rbd.RollingBall}, 20),
    "merge_robots": Case(
        use_pair, {"first": BOX, "second": BOLT, "placement": np.eye(4), "names": ("a_", "b_"), "against": "b_FL_FOOT"}
    ),
    "Ground": Case(
        lambda **given: use_ground(rbd.Ground(**given)), {"point": np.zeros(3), "normal": np.array([0.0, 0.0, 1.0])}
    ),
    "Contact": contact_case(
        rbd.constraints.Contact, {"corners": CORNERS[:2], "placement": np.eye(4), "normal": (0.0, 0.0, 1.0)}
    ),
    "Body": Case(
        lambda **given: rbd.PointContact("toe", FRAME, on=rbd.Body(**given)).rows(STATE),
        {"frame": BOLT.frames()[-1], "normal": np.array([0.0, 0.6, 0.8])},
    ),
    "Ground, moved": Case(
        lambda **given: use_ground(rbd.Ground(point=np.zeros(3), **given)), {"motion": rbd.Speed((0.1, 0.0, 0.2))}
    ),
    "Ground, by its height": Case(use_ground, {"on": 0.25}),
    "Terrain": Case(
        lambda **given: use_terrain(rbd.Terrain(**given)),
        {"pieces": {"floor": (coal.Box(4.0, 4.0, 0.2), np.array([0.0, 0.0, -0.1]))}, "friction": 0.5},
    ),
    "Terrain, a piece": Case(
        lambda shape, pose: use_terrain(rbd.Terrain({"floor": (shape, pose)})),
        {"shape": coal.Box(4.0, 4.0, 0.2), "pose": np.eye(4)},
    ),
    "Terrain.boxes": Case(
        lambda low, high, friction: use_terrain(rbd.Terrain.boxes((low, high), friction=friction)),
        {"low": np.array([-1.0, -1.0, -0.5]), "high": np.array([1.0, 1.0, 0.0]), "friction": 0.5},
    ),
    "Terrain.stairs": Case(
        lambda **given: use_terrain(rbd.Terrain.stairs(**given)),
        {"rise": 0.1, "depth": 0.3, "n": 3, "start": np.zeros(3), "width": 2.0, "landing": 2.0, "down": False, "friction": 0.5},
    ),
    "Terrain.heights": Case(
        lambda **given: use_terrain(rbd.Terrain.heights(**given)),
        {"z": np.zeros((4, 3)), "spacing": 0.5, "origin": np.array([-0.5, -0.5]), "friction": 0.5},
    ),
    "Terrain.mesh": Case(
        lambda **given: use_terrain(rbd.Terrain.mesh(**given)), {"path": WEDGE, "pose": None, "scale": 1.0, "friction": 0.5}, 60
    ),
    "Terrain.read": Case(
        lambda **given: use_terrain(rbd.Terrain.read(**given)), {"path": WORLD, "friction": 0.5, "package_dirs": ()}, 60
    ),
    "Terrain.heights_of": Case(lambda points: finite(STAIRS.heights_of(points)), {"points": np.array([[0.1, 0.0, 0.2]])}),
    "Terrain.distances": Case(lambda points: finite(STAIRS.distances(points)), {"points": np.array([[0.1, 0.0, 0.2]])}),
    "Terrain.ground_at": Case(STAIRS.ground_at, {"x": 0.1, "y": 0.0}),
    "SurfaceContact, a rectangle": contact_case(rbd.SurfaceContact, {"half_lengths": (0.1, 0.05)}),
    "JointLimit": Case(
        lambda **given: use_joint(rbd.JointLimit(**given)),
        {"name": "stop", "joint": list(BOLT.joints)[3], "lower": 0.5, "upper": 2.0, "margin": 0.1},
    ),
    "JointLock": Case(
        lambda **given: use_joint(rbd.JointLock(**given)), {"name": "lock", "joint": "root_joint", "position": STATE.q[:7]}
    ),
    "JointCoupling": Case(
        lambda **given: use_joint(rbd.JointCoupling(**given)),
        {"name": "gear", "joint": list(BOLT.joints)[3], "to": list(BOLT.joints)[4], "ratio": -2.0, "offset": 0.1},
    ),
    "Speed": Case(
        lambda **given: use_joint(rbd.DrivenJoint("drive", list(BOLT.joints)[3], rbd.Speed(**given))),
        {"rate": 2.0, "start": 0.1},
    ),
    "DrivenJoint": Case(
        lambda **given: use_joint(rbd.DrivenJoint(**given)),
        {"name": "drive", "joint": list(BOLT.joints)[3], "motion": rbd.Speed(2.0)},
    ),
    "JointFriction": Case(
        lambda **given: use_joint(rbd.JointFriction(**given)), {"name": "rub", "joint": list(BOLT.joints)[3], "torque": 0.2}
    ),
    "Baumgarte": Case(
        lambda **given: use_joint(
            rbd.constraints.Baumgarte(**given).of(rbd.JointLock("lock", list(BOLT.joints)[3], position=0.3))
        ),
        {"frequency": 10.0, "damping_ratio": 0.7},
    ),
    "LoopClosure": Case(
        lambda **given: use_joint(rbd.LoopClosure(**given)),
        {"name": "loop", "frame_a": FRAME, "frame_b": BOLT.frames()[-1], "kind": "revolute", "axis": np.array([0.6, 0.0, 0.8])},
    ),
    "FunctionConstraint": Case(
        lambda **given: use_moving(rbd.FunctionConstraint(**given)),
        {"name": "height", "phi": lambda q: q[2] - 0.1, "jacobian": None, "bias": None, "cone": rbd.problem.Free(1)},
        30,
    ),
    "VelocityConstraint": Case(
        lambda **given: use_moving(rbd.VelocityConstraint(**given)),
        {"name": "row", "A": np.linspace(-1.0, 1.0, 6), "bias": None, "b": 0.5, "b_rate": None},
    ),
    "KnifeEdge": Case(
        lambda **given: use_moving(rbd.KnifeEdge(**given)),
        {"name": "blade", "frame": "box", "direction": (1, 0.2, 0), "normal": np.array([0.0, 0.6, 0.8]), "offset": np.ones(3)},
    ),
    "RollingBall": rolling_case(rbd.RollingBall),
    "RollingDisk": rolling_case(rbd.RollingDisk, axis=np.array([0.0, 1.0, 0.2])),
    "RollingBody": rolling_case(rbd.constraints.RollingBody, shape=np.array([0.3, 0.2, 0.1])),
    "RollingOnRound": rolling_case(rbd.constraints.RollingOnRound, surface_radius=-0.5, axis=(0, 1, 0)),
    "RollingWheel": rolling_case(rbd.RollingWheel, axis=(0, 1, 0), friction=None),
    "joint_limits": Case(rbd.constraints.joint_limits, {"robot": BOLT, "margin": 0.1}),
    "Motor": Case(
        lambda **given: BOLT.with_motors({BOLT.actuated_names[0]: rbd.Motor(**given)}),
        {"limit": 4.0, "gear": 9.0, "speed_limit": 20.0, "torque_speed": [(0.0, 4.0), (9.0, 0.0)], "rotor_inertia": 1e-5},
    ),
    "Robot.with_motors": Case(
        lambda motor, **given: BOLT.with_motors({BOLT.actuated_names[0]: motor}, **given),
        {"motor": rbd.Motor(limit=3.0), "others_passive": True},
    ),
    "Carried": Case(use_carried, CARRIED),
    "Robot.carrying": Case(lambda **given: use_carrying(BOLT.carrying, **given), {"thing": rbd.Carried(**CARRIED), "at": None}),
    "Robot.torque_limits": Case(BOLT.torque_limits, {"v": V}),
    "Robot.is_like": Case(BOLT.is_like, {"other": BOLT}),
    "Robot.joint_limits": Case(BOLT.joint_limits, {"margin": 0.1}),
    "joint_frictions": Case(rbd.constraints.joint_frictions, {"robot": BOLT}),
    "mimics": Case(rbd.constraints.mimics, {"robot": BOLT}),
    "ExternalForce": Case(
        use_force, {"frame": FRAME, "force": np.array([1.0, 0.0, 9.0]), "moment": (0.0, 1.0, 0.0), "offset": (0.1, 0.0, 0.0)}
    ),
    "Spring": Case(
        lambda **given: use_element(rbd.Spring(**given)),
        {**ENDS, "stiffness": 20.0, "rest": 0.5, "preload": 1.0, "axis": np.array([0.0, 0.6, 0.8])},
    ),
    "Spring, along a line": Case(
        lambda **given: use_element(rbd.Spring(**given)), {**ENDS, "stiffness": 20.0, "rest": 0.5, "preload": 1.0}
    ),
    "Damper": Case(lambda **given: use_element(rbd.Damper(**given)), {**ENDS, "damping": 2.0, "axis": (0, 0, 1)}),
    "Bushing": Case(
        lambda **given: use_element(rbd.Bushing(**given)),
        {**ENDS, "stiffness": np.arange(1.0, 7.0), "damping": np.eye(6), "preload": np.zeros(6)},
    ),
    "Bushing.relaxed_at": Case(
        lambda **given: use_element(rbd.Bushing.relaxed_at(**given)),
        {"state": BOX.at(), "frame": "box", "to": None, "stiffness": 2.0, "damping": 0.1, "offset": np.zeros(3), "name": "one"},
        30,
    ),
    "JointSpring": Case(
        lambda **given: use_joint_element(rbd.JointSpring(**given)),
        {"joint": list(BOLT.joints)[3], "stiffness": 20.0, "rest": 0.1, "preload": 1.0, "name": "one"},
    ),
    "JointDamping": Case(
        lambda **given: use_joint_element(rbd.JointDamping(**given)),
        {"damping": {list(BOLT.joints)[3]: 0.5}, "name": "one"},
    ),
    "JointDamping, a number": Case(lambda d: use_joint_element(rbd.JointDamping({list(BOLT.joints)[3]: d})), {"d": 0.5}, 30),
    "Rows": Case(
        use_rows,
        {**PLAIN, "cone": rbd.problem.Free(2), "velocity": np.zeros(2), "feedback": np.zeros(2), "resultant": np.eye(2)},
    ),
    "GaussProblem": Case(
        use_problem,
        {"M": np.diag([1.0, 2.0]), "rhs": np.array([1.0, -1.0]), "rows": [rbd.Rows(**PLAIN, cone=rbd.problem.Free(2))]},
    ),
    "State": Case(rbd.State, {"robot": BOLT, "q": STATE.q, "v": V, "t": 0.1}, 200),
    "KKT": Case(lambda problem: rbd.KKT().solve(problem), {"problem": rbd.gauss_problem(STATE, TAU, BOLT.feet(None))}),
    "ProxQP": Case(lambda problem: rbd.ProxQP().solve(problem), {"problem": PROBLEM}),
    "ConeSolver": Case(lambda law, problem: rbd.ConeSolver(law=law).solve(problem), {"law": "coulomb", "problem": PROBLEM}),
    "gauss_problem": Case(rbd.gauss_problem, ASKED),
    "solve": Case(rbd.solve, {**ASKED, "solver": rbd.ProxQP(), "check": True, "rest_speed": 1e-6}, 200),
    "solve_many": Case(
        use_many, MANY | {"law": "coulomb", "external": np.zeros(BOLT.nv), "friction": 0.5, "rest_speed": 1e-6, "t": 0.1}
    ),
    "hold_many": Case(
        lambda **given: use_actuations(rbd.statics.hold_many(**given)),
        {key: MANY[key] for key in ("robot", "q")} | {"contacts": FEET, "coefficients": 0.5, "friction": "cone", "margin": 0.0},
        20,
    ),
    "inverse_dynamics_many": Case(
        lambda **given: use_actuations(rbd.control.inverse_dynamics_many(**given)),
        {key: MANY[key] for key in ("robot", "q", "v")}
        | {
            "a": np.zeros(BOLT.nv),
            "contacts": FEET,
            "coefficients": 0.5,
            "rest_speed": 1e-6,
            "external": np.zeros(BOLT.nv),
            "t": 0.1,
        },
        20,
    ),
    "solve_problem": Case(rbd.solve_problem, {"problem": PROBLEM, "solver": rbd.ProxQP(), "check": True}),
    "Solution.of": Case(rbd.Solution.of, {"answer": rbd.KKT().solve(rbd.gauss_problem(STATE, TAU, BOLT.feet(None)))}),
    "contradiction": Case(use_contradiction, {"problem": SQUEEZED, "law": "convex"}),
    "nearest_motion": Case(
        rbd.answers.solution.nearest_motion, {"problem": SQUEEZED, "weights": {"row": 2.0}, "solver": rbd.ProxQP()}
    ),
    "Workers": Case(lambda count: rbd.studies.Workers(count).count, {"count": 2}),
    "withstand_push": Case(lambda **given: rbd.studies.withstand_push(**given).tau, {**STANDS, "facets": 4, "margin": 0.1}, 30),
    "move_under_push": Case(rbd.studies.move_under_push, {**STANDS, "law": "coulomb"}, 30),
    "grid": Case(lambda **given: use_samples(rbd.grid(**given)), {"friction": [0.3, 0.6], "law": ["a", "b"], "mu": 1}),
    "sample": Case(
        lambda **given: use_samples(rbd.sample(**given)),
        {"n": 5, "method": "sobol", "seed": 3, "ranges": {"mu": (0.1, 1.0)}, "push": (0.0, 9.0), "law": ["a", "b", "c"]},
    ),
    "table": Case(
        lambda **given: use_samples(rbd.studies.table(**given)), {"rows": {"mu": [0.1, 0.2], "law": "a"}, "dimension": "case"}
    ),
    "table, its columns": Case(lambda **given: use_samples(rbd.studies.table(given)), {"mu": [0.1, 0.2], "law": ["a", "b"]}),
    "study": Case(
        lambda **given: rbd.study(executor=0, progress=False, **given).ok.values.tolist(),
        {"function": abs_of, "samples": {"x": [0.5, -1.0, 2.0]}, "keep": ("value",), "seed": 3, "chunk": 2},
    ),
    "open_study": Case(rbd.studies.open_study, {"path": STORED}),
    "compare_laws": Case(rbd.studies.compare_laws, ASKED),
    "kept_names": Case(rbd.studies.kept_names, {"result": rbd.Solution}),
    "compare_solvers": Case(  # without the times in it, which differ
        lambda **given: [x.a for x in rbd.studies.compare_solvers(**given).answers], ASKED
    ),
    "support_region": Case(
        use_region,
        {"state": BOX.at(), "contacts": FLOOR, "torque_limits": False, "margin": 0.1, "friction": "inscribed"}
        | {"area_gap": 1e-3},
        30,
    ),
    "zmp": Case(rbd.statics.zmp, {"state": MOVING, "a": V, "on": 0.1, "external": np.zeros(BOLT.nv)}),
    "zmp_region": Case(
        lambda **given: use_region(rbd.statics.zmp_region, **given),
        {"state": BOX.at(), "contacts": FLOOR, "on": -1.0, "pendular": True, "margin": 0.1, "friction": "inscribed"}
        | {"area_gap": 1e-3, "torque_limits": False},
        30,
    ),
    "wrench_cone": Case(
        lambda **given: rbd.statics.wrench_cone(**given).margin((0.0, 0.0, 1.0, 0.0, 0.0, 0.0)),
        {"state": BOX.at(), "contacts": FLOOR, "about": np.zeros(3), "friction": "inscribed", "margin": 0.1},
        30,
    ),
    "push_limits": Case(
        lambda **given: rbd.statics.push_limits(**given).forces,
        {"state": BOX.at(), "contacts": FLOOR, "frame": "box", "directions": np.eye(3), "offset": np.zeros(3), "at_most": 50.0}
        | {"friction": "inscribed", "margin": 0.1},
        30,
    ),
    "robust.hold": Case(
        lambda **given: rbd.robust.hold(**given).margin,
        {"state": BOX.at(), "contacts": FLOOR, "pushes": {"box": np.eye(3)}, "friction": 0.3, "mass": {"box": 0.1}}
        | {"com": {"box": 0.01}, "joints": None, "torques": "each", "margin": 0.1, "loops": True, "most_parts": 2},
        10,
    ),
    "robust.PushSet": Case(
        lambda **given: np.asarray(rbd.robust.PushSet(**given).corners),
        {"frame": "box", "corners": np.eye(3), "offset": np.zeros(3)},
        10,
    ),
    "robust.push_limits": Case(
        lambda **given: rbd.robust.push_limits(**given).inner,
        {
            "state": BOX.at(),
            "contacts": FLOOR,
            "frame": "box",
            "directions": np.eye(3)[:1],
            "offset": np.zeros(3),
            "at_most": 50.0,
        }
        | {"friction": 0.3, "mass": 0.1, "com": {"box": 0.01}, "joints": None, "torques": "each", "margin": 0.1}
        | {"most_parts": 1},
        10,
    ),
    "robust.region": Case(
        lambda **given: rbd.robust.region(**given).area,
        {"state": BOX.at(), "contacts": FLOOR, "pushes": {"box": np.eye(3)[:1]}, "friction": 0.3, "mass": 0.1, "com": None}
        | {"joints": None, "torques": "each", "margin": 0.1, "most_parts": 1, "most_directions": 5},
        5,
    ),
    "visual.plot_region": Case(
        lambda ax, region, labels: len(plot_region(ax, region, labels=labels)),
        {"ax": Figure().subplots(), "region": REGION, "labels": ["where it stands"]},
        20,
    ),
    "visual.plot_pushes": Case(
        lambda **given: len(plot_pushes(**given)),
        {"ax": Figure().subplots(), "limits": rbd.statics.push_limits(BOX.at(), FLOOR, "box", np.eye(3))},
        20,
    ),
    "visual.plot_directions": Case(
        lambda **given: len(plot_directions(**given)),
        {"ax": Figure().add_subplot(projection="polar"), "directions": np.eye(3)[:2], "curves": {"a push": [1.0, 2.0]}}
        | {"quantity": "largest push", "unit": "N"},
        20,
    ),
    "visual.plot_study": Case(
        lambda **given: len(plot_study(**given)),
        {"dataset": STUDIED, "x": "friction", "y": "push", "value": "used[fz]", "by": "side", "ax": None},
        20,
    ),
    "visual.plot_wrench_cone": Case(
        lambda **given: len(plot_wrench_cone(**given)),
        {"ax": Figure().subplots(), "cone": rbd.statics.wrench_cone(BOX.at(), FLOOR)},
        20,
    ),
    "hold": Case(
        rbd.hold,
        {"state": STATE, "contacts": FEET, "external": np.zeros(BOLT.nv), "friction": "inscribed"}
        | {"objective": rbd.statics.Effort(forces=1e-3), "margin": 0.1},
    ),
    "inverse_dynamics": Case(
        rbd.inverse_dynamics,
        {"state": STATE, "a": np.zeros(BOLT.nv), "contacts": FEET, "external": np.zeros(BOLT.nv), "friction": "cone"}
        | {"objective": rbd.statics.Effort(forces=1e-3), "margin": 0.1, "rest_speed": 1e-6},
    ),
    "estimate_forces": Case(
        use_measured,
        {"state": MOVING, "a": V, "contacts": FEET, "tau": TAU, "noise": rbd.motion.SensorNoise(a=0.1, tau=0.2)}
        | {"external": np.zeros(BOLT.nv)},
        30,
    ),
    "motion.estimate_forces_along": Case(
        lambda **given: rbd.motion.estimate_forces_along(TRAJECTORY, **given).net,
        {"contacts": FLOOR, "tau": np.zeros((4, 0)), "a": np.zeros((4, 6)), "touches": np.ones((4, 1), bool)}
        | {"noise": rbd.motion.SensorNoise(a=0.1), "external": np.zeros(6)},
        30,
    ),
    "motion.SensorNoise": Case(
        lambda **given: use_measured(STATE, V, FEET, TAU, noise=rbd.motion.SensorNoise(**given)),
        {"q": 1e-4, "v": 1e-3, "a": 0.1, "tau": 0.1},
        30,
    ),
    "identify": Case(
        use_identified,
        {"motions": [ARM_MEASURED], "columns": ["inertia", "damping"], "prior": 0.3, "noise": rbd.motion.SensorNoise(tau=0.1)},
        30,
    ),
    "identification.MeasuredMotion": Case(
        lambda **given: rbd.motion.identification.MeasuredMotion(**given).equations(1, ("inertia",))[1:],
        {"motion": TRAJECTORY, "tau": np.zeros((4, 0)), "contacts": FLOOR, "touches": np.ones((4, 1), bool)}
        | {"forces": TRAJECTORY.forces, "external": np.zeros(6)},
        30,
    ),
    "identification.base_parameters": Case(
        lambda **given: rbd.motion.identification.base_parameters(**given).B, {"robot": BOX, "columns": ["inertia"]}, 10
    ),
    "identification.excitation": Case(
        lambda **given: rbd.motion.identification.excitation(**given).singular_values,
        {"motions": [ARM_MEASURED], "columns": ["inertia", "damping"]},
        20,
    ),
    "dynamics.regressor": Case(
        lambda **given: (found := rbd.dynamics.regressor(**given)).Y.shape + (found.Y @ found.theta, found.theta),
        {"state": MOVING, "a": V, "contacts": FEET, "columns": ["inertia"]},
        30,
    ),
    "Solution.derivatives": Case(
        lambda parameters: [x.da for x in SOLUTION.derivatives(parameters).parameters.values()],
        {"parameters": ["friction", "mass"]},
        20,
    ),
    "motion.MomentumObserver": Case(
        lambda t, state, tau, **given: use_measured(ask=rbd.motion.MomentumObserver(**given).update, t=t, state=state, tau=tau),
        {"robot": BOLT, "contacts": FEET, "bandwidth": 20.0, "torques": True, "held": False, "t": 0.1, "state": MOVING}
        | {"tau": TAU, "noise": rbd.motion.SensorNoise(v=1e-3, tau=0.2)},
        30,
    ),
    "Effort": Case(
        lambda **given: rbd.hold(STATE, FEET, objective=rbd.statics.Effort(**given)),
        {"torques": [1.0] * BOLT.nu, "forces": {FEET[0].name: 0.1}, "normal_force": {FEET[0].name: (1.0, 20.0)}}
        | {"edge_margin": 0.0},
    ),
    "doctor": Case(rbd.doctor, {"robot": BOX}),
    "FileLimits": Case(
        lambda **given: rbd.load_robot(URDF, limits=rbd.model.FileLimits(**given)), {"max_dof": 200, "max_bytes": 10_000}
    ),
    "load_robot": Case(
        rbd.load_robot,
        {"name_or_path": str(URDF), "root": "free_flyer", "passive": ["root_joint"], "package_dirs": ["."], "limits": None}
        | {"gravity": (0.0, 0.0, -1.62), "plane": None},
    ),
    "load_robot, its rotors": Case(rbd.load_robot, {"name_or_path": str(URDF), "rotors": True}),
    "load_robot, its text": Case(
        rbd.load_robot, {"text": URDF.read_text(), "root": "free_flyer", "loops": True, "package_dirs": ["."], "limits": None}
    ),
    "Box": weighed(rbd.robots.Box, {"size": (0.1, 0.2, 0.3)}),
    "Sphere": weighed(rbd.robots.Sphere, {"radius": 0.1}),
    "Cylinder": weighed(rbd.robots.Cylinder, {"radius": 0.1, "length": 0.3}),
    "Capsule": weighed(rbd.robots.Capsule, {"radius": 0.1, "length": 0.3}),
    "Plate": weighed(rbd.robots.Plate, {"size": (0.1, 0.2)}),
    "Rod": weighed(rbd.robots.Rod, {"start": (0, 0, 0), "end": (0.1, 0.2, 0.3), "radius": 0.01}, at=None, rpy=None),
    "PointMass": weighed(rbd.robots.PointMass, {"kilogram": 1.0, "radius": 0.01}, mass=None),
    "RobotBuilder": built("robot", name="guarded", root="fixed", plane=None, about="It is guarded."),
    "RobotBuilder.body": built("body", name="x", mass=1.0, com=(0.1, 0.2, 0.3), inertia=(0.1, 0.1, 0.15), elements=""),
    "RobotBuilder.joint": built(
        "joint",
        **{"name": "x", "parent": "lower", "child": "free", "kind": "revolute", "at": (0, 0, 1), "rpy": (0, 0, 1)},
        **{"axis": (0, 0, 1), "motor": True, "effort": 5.0, "limits": (-1, 1), "speed": 3.0, "damping": 0.0, "friction": 0.0},
        armature=0.1,
    ),
    "RobotBuilder.frame": built("frame", name="x", body="lower", at=(0, 0, 1), rpy=(0, 0, 1)),
    "RobotBuilder.loop": built("loop", name="x", a="lower", b=("ground", (0, 0, 1)), kind="planar", axis=(0, 0, 1)),
    "RobotBuilder.coupling": built("coupling", name="x", joint="one", to="two", ratio=2.0, offset=0.1),
    "RobotBuilder.drive": built("drive", name="x", joint="one", rate=2.0, start=0.1),
    "RobotBuilder.drive along a spline": built(
        "drive", name="x", joint="one", times=(0, 1, 2, 3), values=(0, 1, 1, 0), periodic=True
    ),
    "RobotBuilder.wheel": built("wheel", name="x", frame="lower", kind="rolling_disk", radius=0.1, axis=(0, 1, 0), on=0.1),
    "RobotBuilder.wheel in a pipe": built(
        "wheel", name="x", frame="lower", kind="rolling_on_round", radius=0.1, surface_radius=-1.0, axis=(0, 1, 0), on=(0, 0, 1)
    ),
    "RobotBuilder.wheel of an egg": built("wheel", name="x", frame="lower", kind="rolling_body", shape=(0.1, 0.2, 0.1)),
    "RobotBuilder.posture": built("posture", name="x", values={"one": 0.1}),
    "mechanism.Link": Case(
        lambda **given: str(rbd.mechanism.Link(**given)),
        {"name": "x", "parent": "ground", "at": (0.0, 0.0), "points": ((0.1, 0.0),), "mass": 1.0, "color": "blue", "tip": 1}
        | {"layer": 0, "slides": False, "motor": True, "limits": (-1.0, 1.0), "width": 1.0},
    ),
    "mechanism.Linkage": Case(
        lambda **given: rbd.mechanism.Linkage(**given).robot().at().M,
        {"name": "x", "about": "", "ground": ((0.0, 0.0),), "closures": {}, "postures": {}, "radius": 0.01}
        | {"links": (rbd.mechanism.Link("arm", "ground", (0.0, 0.0), ((0.1, 0.0),), 1.0),), "rail": (0.0, 1.0, 0.0)},
        60,
    ),
    "load_robot, its feet": Case(rbd.load_robot, {"name_or_path": str(URDF), "feet": ["box"]}),
    "load_robot, its loops": Case(
        rbd.load_robot, {"name_or_path": str(LOOPED), "root": "fixed", "loops": str(LOOPED.with_suffix(".loops.yaml"))}
    ),
    "mechanism.four_bar": Case(
        rbd.mechanism.four_bar,
        {"a": 1.0, "b": 3.0, "c": 2.0, "d": 2.5, "crank_angle": 1.0, "masses": (1.0, 2.0, 3.0), "mass_per_length": 2.0},
        30,
    ),
    "mechanism.four_bar, no file": Case(
        rbd.mechanism.four_bar, {"a": 1.0, "b": 3.0, "c": 2.0, "d": 2.5, "path": "/nowhere/x.urdf"}, 30
    ),
    "mechanism.n_four_bar": Case(rbd.mechanism.n_four_bar, {"n": 2, "length": 1.0, "mass": 2.0}, 30),
    "mechanism.slider_crank": Case(
        rbd.mechanism.slider_crank,
        {"crank": 1.0, "rod": 2.0, "offset": 0.1, "crank_angle": 1.0, "masses": (1.0, 2.0, 3.0), "mass_per_length": 2.0},
        30,
    ),
    "mechanism.assemble": Case(
        rbd.mechanism.assemble,
        {**FROM_HERE, "fixed": {"crank_joint": 0.5}, "within_limits": False, "within": 9.0}
        | {"tolerance": 1e-10, "max_iterations": 50},
    ),
    "mechanism.branches": Case(
        lambda **given: list(rbd.mechanism.branches(**given).q),
        {**FROM_HERE, "fixed": {"crank_joint": 0.5}, "seed": 1, "tries": 6, "tolerance": 1e-10},
        30,
    ),
    "mechanism.trace": Case(
        rbd.mechanism.trace,
        {**FROM_HERE, "joint": "crank_joint", "values": np.array([0.5, 0.8]), "steps": 3, "fixed": {}, "past_limits": False}
        | {"longest_step": 0.1, "tolerance": 1e-10, "max_steps": 200},
        30,
    ),
    "mechanism.velocity_partition": Case(
        rbd.mechanism.velocity_partition,
        {"state": LINKED, "constraints": list(FOUR_BAR.loops()), "known": {"crank_joint": 1.0}},
    ),
    "mechanism.velocity_partition, a rate": Case(
        lambda rate: rbd.mechanism.velocity_partition(LINKED, None, {"crank_joint": rate}), {"rate": 1.0}
    ),
    "mechanism.acceleration_partition": Case(
        rbd.mechanism.acceleration_partition,
        {"state": LINKED, "constraints": list(FOUR_BAR.loops()), "known": {"crank_joint": 1.0}},
    ),
    "mechanism.independent_velocities": Case(
        lambda **given: list(map(len, rbd.mechanism.independent_velocities(**given))),
        {"state": LINKED, "constraints": list(FOUR_BAR.loops()), "prefer": ["crank_joint"]},
    ),
    "mechanism.link_angles": Case(rbd.mechanism.link_angles, {"state": LINKED}),
    "mechanism.with_link_angles": Case(rbd.mechanism.with_link_angles, {"state": LINKED, "angles": {"crank": 0.3}}),
    "mechanism.link_rates": Case(rbd.mechanism.link_rates, {"state": LINKED, "rates": np.array([1.0, -0.5, 0.3])}),
    "mechanism.link_jacobians": Case(
        rbd.mechanism.link_jacobians, {"state": LINKED, "constraints": list(FOUR_BAR.loops()), "known": ["crank"]}
    ),
    "mechanism.project_velocity": Case(
        lambda **given: rbd.mechanism.project_velocity(**given).v, {"state": MOVING, "constraints": FEET}
    ),
    "mechanism.project_acceleration": Case(rbd.mechanism.project_acceleration, {"state": MOVING, "a": V, "constraints": FEET}),
    "place_on_ground": Case(rbd.robots.place_on_ground, {"state": STATE.with_joints(LIFTED), "contacts": FEET}),
    "find_pose": Case(
        rbd.find_pose, {"robot": BOX, "targets": {"box": (0.1, 0.0, 0.3)}, "posture": BOX.neutral(), "com": None}, 30
    ),
    "find_pose, a place": Case(
        lambda where, normal, com: rbd.find_pose(BOX, {"box": (where, normal)}, com=com),
        {"where": np.array([0.1, 0.2, 0.3]), "normal": np.array([0.0, 0.6, 0.8]), "com": np.array([0.1, 0.2])},
        30,
    ),
    "mechanism.find_pose": Case(
        lambda on: rbd.mechanism.find_pose(BOX, {rbd.SurfaceContact("side", "box", half_lengths=(0.1, 0.1)): on}), {"on": 0.2}
    ),
    "mechanism.mobility": Case(
        rbd.mechanism.mobility, {"state": LINKED, "constraints": list(FOUR_BAR.loops()), "tolerance": 1e-9, "seed": 1}
    ),
    "mechanism.singularities": Case(rbd.mechanism.singularities, {"state": LINKED, **LOOPS, "tolerance": 1e-6, "seed": 1}),
    "mechanism.singularities_along": Case(
        rbd.mechanism.singularities_along,
        {"state": LINKED, "path": np.array([LINKED.q, LINKED.q]), **LOOPS, "tolerance": 1e-6},
    ),
    "linearise": Case(
        use_linearised,
        {"state": HANGING.state, "constraints": list(FOUR_BAR.loops()), "tau": np.zeros(1), "external": np.zeros(3)}
        | {"differences": False, "seed": 1},
        20,
    ),
    "floquet": Case(
        lambda **given: rbd.simulation.floquet(**given).monodromy,
        {"state": HANGING.state, "constraints": list(FOUR_BAR.loops()), "period": 0.01, "external": np.zeros(3)},
        20,
    ),
    "find_equilibrium": Case(
        lambda **given: rbd.find_equilibrium(**given).state.q,
        {"state": LINKED, "constraints": list(FOUR_BAR.loops()), "tau": np.zeros(1), "external": np.zeros(3), "fixed": {}},
        10,
    ),
    "find_steady_motion": Case(
        lambda **given: rbd.find_steady_motion(**given).state.v,
        {"state": SLEIGH, "constraints": list(SLEIGH.robot.wheels()), "tau": np.zeros(0), "external": np.zeros(3)}
        | {"fixed": {}, "speeds": {"root_joint.vx": 2.0}, "conditions": ()},
        10,
    ),
    "small_motion.Linearised.changed": Case(HANGING.linearised.changed, {"x": np.array([1e-3, 1e-3])}),
    "small_motion.Mode.at": Case(SWING.at, {"t": 0.1, "amplitude": 0.1}),
    "small_motion.Mode.pose": Case(SWING.pose, {"factor": 0.1}),
    "visual.mode_scene": Case(
        lambda mode, amplitude: rbd.visual.mode_scene(mode, amplitude=amplitude).shown, {"mode": SWING, "amplitude": 0.1}, 5
    ),
    "visual.export_mode": Case(
        lambda mode, path, amplitude: rbd.visual.export_mode(mode, path, amplitude=amplitude).name,
        {"mode": SWING, "path": "no/folder/swing.html", "amplitude": 0.1},
        5,
    ),
    "visual.plot_mode": Case(
        lambda ax, mode, most: len(rbd.visual.plot_mode(ax, mode, most=most)),
        {"ax": Figure().subplots(), "mode": SWING, "most": 3},
        10,
    ),
    "visual.plot_eigenvalues": Case(
        lambda ax, linearised: len(rbd.visual.plot_eigenvalues(ax, linearised)),
        {"ax": Figure().subplots(), "linearised": HANGING.linearised},
        10,
    ),
    "mechanism.integrability": Case(
        rbd.mechanism.integrability,
        {**FROM_HERE, "points": LINKED.q[None], "seed": 1, "tolerance": 1e-6},
    ),
    "mechanism.classify": Case(
        rbd.mechanism.classify,
        {**FROM_HERE, "end": FOUR_BAR.frames()[-1], "seed": 1},
    ),
    "catalogue.file_path": Case(lambda path: rbd.robots.catalogue.file_path(path, "the path"), {"path": "x.urdf"}),
    "catalogue.licence": Case(lambda name: rbd.robots.catalogue.licence(rbd.robots.catalogue.find(name)), {"name": "bolt"}),
    "catalogue.find": Case(rbd.robots.catalogue.find, {"name_or_path": "bolt", "package_dirs": ["."]}),
    "dynamics.checked": of_state("checked"),
    "dynamics.generalised": Case(rbd.dynamics.generalised, {"state": MOVING, "external": np.linspace(-1.0, 1.0, BOLT.nv)}),
    "dynamics.mass_matrix": of_state("mass_matrix"),
    "dynamics.bias_force": of_state("bias_force"),
    "dynamics.gravity_torque": of_state("gravity_torque"),
    "dynamics.coriolis_matrix": of_state("coriolis_matrix"),
    "dynamics.coriolis_tensor": of_state("coriolis_tensor"),
    "dynamics.kinetic_energy": of_state("kinetic_energy"),
    "dynamics.potential_energy": of_state("potential_energy"),
    "dynamics.momentum": of_state("momentum"),
    "dynamics.inverse_dynamics": of_state("inverse_dynamics", a=V),
    "dynamics.constraint_hessian": of_state("constraint_hessian", constraint=FEET[0]),
    "dynamics.free_acceleration": of_state("free_acceleration", tau=TAU, external=np.zeros(BOLT.nv)),
    "dynamics.free_force": of_state("free_force", tau=TAU, external=np.zeros(BOLT.nv)),
    "Robot.posture": Case(BOLT.posture, {"name": "standing"}),
    "Robot.at": Case(BOLT.at, {"q": STATE.q, "v": V}),
    "Robot.standing": Case(BOLT.standing, {"posture": "standing"}),
    "Robot.soles": Case(BOLT.soles, {"friction": 0.5, "facets": 4}),
    "Robot.feet": Case(BOLT.feet, {"friction": 0.5, "facets": 4}),
    "Robot.soles_from_collision": Case(
        BOX.soles_from_collision, {"frames": ["box"], "friction": 0.5, "at": BOX.at(), "facets": 4}
    ),
    "Robot.frame": Case(BOLT.frame, {"name": FRAME}),
    "Robot.frame_id": Case(BOLT.frame_id, {"name": FRAME}),
    "Robot.site": Case(BOLT.site, {"frame": FRAME}),
    "Robot.joint_id": Case(BOLT.joint_id, {"name": list(BOLT.joints)[3]}),
    "Robot.check_q": Case(BOLT.check_q, {"q": STATE.q}),
    "Robot.check_v": Case(BOLT.check_v, {"v": V}),
    "Robot.check_tau": Case(BOLT.check_tau, {"tau": TAU}),
    "Solution.with_forces": Case(SOLUTION.with_forces, {"weight": {SOLUTION.problem.rows[0].name: 2.0}}),
    "Solution.with_forces, one foot": Case(
        lambda foot: SOLUTION.with_forces({SOLUTION.problem.rows[0].name: foot}), {"foot": [2.0]}
    ),
    "State.with_velocity": Case(STATE.with_velocity, {"v": V}),
    "State.with_joint_velocities": Case(
        lambda values, rate: (
            STATE.with_joint_velocities(values),
            STATE.with_joint_velocities({list(BOLT.joints)[3]: rate}),
        ),
        {"values": {"root_joint": V[:6]}, "rate": 0.3},
    ),
    "Robot.with_gravity": Case(
        lambda gravity: rbd.State(BOLT.with_gravity(gravity), STATE.q).h, {"gravity": (0.5, 0.0, -9.0)}, 20
    ),
    "State.at_time": Case(lambda t: STATE.at_time(t), {"t": 0.5}),
    "State.on": Case(lambda robot: STATE.on(robot), {"robot": BOLT}),
    "State.joint": Case(STATE.joint, {"name": "root_joint"}),
    "State.with_joints": Case(
        lambda values, angle: (STATE.with_joints(values), STATE.with_joints({list(BOLT.joints)[3]: angle})),
        {"values": {"root_joint": STATE.q[:7]}, "angle": 0.3},
    ),
    "State.frame": Case(STATE.frame, {"name": FRAME, "offset": np.zeros(3)}),
    "visual.Scene": Case(
        use_scene,
        {"state": STATE, "solution": SOLUTION, "external": PUSH, "arrow_per_weight": 0.3, "seen_from": (1, 0.6, 0.3)},
        40,
    ),
    "visual.Slider": Case(
        rbd.visual.Slider, {"name": "push", "low": 0.0, "high": 9.0, "value": 2.0, "unit": "N", "step": 0.5}, 20
    ),
    "visual.Choice": Case(rbd.visual.Choice, {"name": "law", "options": ("a", "b"), "value": "b"}, 20),
    "visual.Verdict": Case(rbd.visual.Verdict, {"title": "Holds", "lines": ("well",), "good": True}, 20),
    "visual.explore": Case(
        use_explore,
        {
            "controls": [rbd.visual.Slider("push", 0.0, 9.0, 2.0)],
            "values": {"push": 3.0},
        },
        10,
    ),
    "visual.Scene.export": Case(use_export, {"path": "/nowhere/x.html"}, 40),
    "visual.plot_ranges": Case(use_plot, {"ax": Figure().subplots(), "uniqueness": SOLUTION.uniqueness()}, 20),
    "simulate": Case(
        use_simulate,
        {"state": BOX.at(), "constraints": FLOOR, "duration": 0.01, "step": 0.005, "controller": None, "external": np.zeros(6)}
        | {"law": "coulomb", "restitution": 0.5, "integrator": rbd.TimeStepping(), "stabilisation": rbd.simulation.Projection()}
        | {"record_every": 1, "may_sink": False, "progress": False, "events": [height], "inactive": ()},
        30,
    ),
    "simulate_many": Case(
        use_worlds,
        {"states": BOX.at(), "contacts": ON_FLOOR, "duration": 0.01, "step": 0.005, "tau": np.zeros(0), "controller": None}
        | {"every": 1, "law": "coulomb", "friction": 0.5, "mass": {"box": 1.5}, "gravity": np.array([0.0, 0.0, -9.0])}
        | {"ground": np.zeros(2), "damping": {}, "pushes": (), "record": 1, "threads": 1, "progress": False},
        30,
    ),
    "Servo": Case(
        lambda **given: use_worlds(
            states=STATE, contacts=FEET, duration=0.01, step=0.005, controller=rbd.worlds.Servo(**given)
        ),
        {"stiffness": 0.1, "damping": 0.01, "target": np.zeros(BOLT.nu), "torque": np.zeros(BOLT.nu), "limited": True},
        20,
    ),
    "WorldPushes": Case(
        lambda **given: use_worlds(
            states=BOX.at(), contacts=ON_FLOOR, duration=0.01, step=0.005, pushes=rbd.worlds.WorldPushes(**given)
        ),
        {"frame": "box", "force": np.ones((2, 3)), "start": 0.0, "duration": np.ones(2), "moment": np.zeros(3)}
        | {"offset": np.zeros(3)},
        20,
    ),
    "Worlds": Case(
        lambda **given: (lambda worlds: (worlds.q, worlds.v, worlds.residual))(rbd.worlds.Worlds(**given)),
        {
            "robot": BOX,
            "contacts": ON_FLOOR,
            "q": np.tile(BOX.at().q, (2, 1)),
            "v": np.zeros(6),
            "step": 0.005,
            "law": "convex",
        },
        20,
    ),
    "motion_derivatives": Case(
        lambda **given: (lambda found: found.q[np.isfinite(found.q)])(rbd.worlds.motion_derivatives(**given)),
        {"state": BOX.at(), "contacts": ON_FLOOR, "by": ("friction", "v"), "duration": 0.01, "step": 0.005, "size": 0.01}
        | {"mass": 1.1, "gravity": np.array([0.0, 0.0, -9.0]), "ground": 0.0, "record": 1, "threads": 1},
        20,
    ),
    "TimeStepping": Case(
        lambda **given: use_integrator(rbd.TimeStepping(**given)),
        {"impact_speed": 1e-3, "impacts": 20, "touch_tolerance": 1e-9},
        20,
    ),
    "StateEvent": Case(
        lambda **given: use_simulate(
            state=BOX.at(), constraints=[], duration=0.01, step=0.005, events=[rbd.simulation.StateEvent(**given)]
        ),
        {"function": height, "name": "height", "direction": -1, "terminal": 2, "zero": 1e-12, "required": False},
        20,
    ),
    "Switch": Case(
        lambda **given: (lambda switch: (switch.on, switch.off))(rbd.simulation.Switch(**given)),
        {"on": "left", "off": ("right",), "impact": True},
        20,
    ),
    "impact": Case(
        lambda **given: (lambda found: (found.v, found.energy_lost, *found.impulses.values()))(rbd.impact(**given)),
        {"state": FALLING, "contacts": FLOOR, "restitution": 0.5, "law": "coulomb", "plastic_below": 1e-3},
        30,
    ),
    "DormandPrince8": Case(lambda **given: use_integrator(rbd.DormandPrince8(**given)), {"rtol": 1e-9, "atol": 1e-9}, 20),
    "Projection": Case(
        lambda **given: use_simulate(
            state=BOX.at(), constraints=FLOOR, duration=0.002, step=0.001, stabilisation=rbd.simulation.Projection(**given)
        ),
        {"tolerance": 1e-12, "iterations": 20},
        20,
    ),
    "HoldPosture": Case(
        lambda **given: use_controller(rbd.control.HoldPosture(**given)),
        {"state": STATE, "contacts": FEET, "frequency": 10.0, "damping_ratio": 1.0, "external": np.zeros(BOLT.nv)},
        30,
    ),
    "ContactSchedule": Case(
        lambda **given: use_schedule(rbd.control.ContactSchedule(**given)),
        {"intervals": {"foot": [(0.0, 1.0), (1.5, 2.0)]}, "fade": 0.05, "flight": False},
    ),
    "Footstep": Case(
        lambda **given: use_walk(robot=SOLO_12, steps=[rbd.control.Footstep(**given)]),
        {"foot": "front_left", "pose": pin.SE3(np.eye(3), np.array([0.22, 0.15, 0.0])), "start": 0.5, "end": 0.8},
        60,
    ),
    "Gait": Case(
        lambda **given: rbd.control.Gait(**given).flies,
        {"order": (("left",), ("right",)), "swing": 2.0, "overlap": 1.0, "lift": 0.1, "stride": 0.2},
    ),
    "Balance": Case(
        lambda **given: use_balance(**given),
        {"robot": G1, "terrain": 0.0, "friction": 0.6, "state": G1.standing(), "model": G1, "steps": True},
        60,
    ),
    "capture_region": Case(
        lambda **given: use_capture(**given),
        {"state": SOLO_12.standing(), "contacts": SOLO_12.feet(friction=0.7), "torque_limits": True, "momentum": 0.1}
        | {"highest": 0.3, "margin": 0.1, "friction": "inscribed"},
        20,
    ),
    "visual.plot_capture": Case(
        lambda ax, region: len(rbd.visual.plot_capture(ax, region)),
        {"ax": Figure().subplots(), "region": rbd.control.capture_region(SOLO_12.standing(), SOLO_12.feet(friction=0.7))},
        10,
    ),
    "Walk": Case(
        lambda **given: use_walk(**given),
        {"robot": SOLO_12, "steps": 1, "velocity": np.array([0.05, 0.0, 0.0]), "terrain": 0.0, "gait": "trot", "friction": 0.6}
        | {"state": SOLO_12.standing(), "model": SOLO_12, "adapts": True, "arms": True},
        60,
    ),
    "WholeBodyController": Case(
        lambda **given: use_whole_body(rbd.control.WholeBodyController(**given)),
        {"tasks": [rbd.control.PostureTask(STATE)], "contacts": FEET, "every": 0.002, "contact_damping": 50.0, "early": 0.5}
        | {"schedule": rbd.control.ContactSchedule({}), "limits": rbd.control.Limits(), "external": np.zeros(BOLT.nv)},
        30,
    ),
    "TorqueSchedule": Case(
        lambda **given: use_controller(rbd.control.TorqueSchedule(**given)),
        {"times": np.array([0.0, 1.0]), "torques": np.zeros((2, BOLT.nu)), "held": False},
    ),
    "TrackingController": Case(
        lambda **given: use_controller(rbd.control.TrackingController(**given)),
        {"motion": STILL_BOLT, "contacts": FEET, "frequency": 10.0, "damping_ratio": 1.0, "stiffness": 100.0, "damping": 1.0}
        | {"torques": "exact", "every": 0.01},
        30,
    ),
    "follow": Case(
        lambda **given: use_whole_body(rbd.control.follow(**given)),
        {"motion": STILL_BOLT.with_contacts(rbd.motion.find_contacts(STILL_BOLT)), "friction": 0.6, "every": 0.002},
        30,
    ),
    "ZeroOrderHold": Case(
        lambda **given: use_controller(rbd.control.ZeroOrderHold(**given)), {"controller": HOLD_BOLT, "period": 0.002}, 30
    ),
    "Push": Case(
        lambda **given: use_simulate(
            state=BOX.at(), constraints=[], duration=0.002, step=0.001, external=rbd.control.Push(**given)
        ),
        {"frame": "box", "force": np.array([1.0, 0.0, 0.0]), "start": 0.0, "duration": 0.1, "moment": np.zeros(3)}
        | {"offset": np.zeros(3)},
        30,
    ),
    "Pushes": Case(
        lambda pushes: rbd.control.Pushes(pushes)(STATE, 0.0),
        {"pushes": [PUSH, rbd.control.Push(FRAME, (1.0, 0.0, 0.0), start=0.0, duration=1.0)]},
    ),
    "Reference": Case(
        lambda **given: use_task(rbd.control.ComTask(rbd.control.Reference(**given))),
        {"value": np.ones(3), "velocity": np.zeros(3), "acceleration": np.ones(3)},
        30,
    ),
    "TaskTerms": Case(
        lambda **given: rbd.control.TaskTerms(**given),
        {"name": "own", "A": np.eye(2), "wanted": np.array([1.0, -1.0]), "cost": np.array([1.0, 0.0]), "contact": ""},
        30,
    ),
    "ComTask": Case(lambda **given: use_task(rbd.control.ComTask(**given)), {"target": np.array([0.1, 0.0, 0.3]), **TASK}, 30),
    "FrameTask": Case(
        lambda **given: use_task(rbd.control.FrameTask(**given)),
        {"frame": FRAME, "target": np.eye(4), "offset": np.zeros(3), "position_cost": np.ones(3), "orientation_cost": 0.5}
        | {"axes": "frame", "gain": 10.0, "damping_ratio": 0.7, "name": "hand"},
        30,
    ),
    "FrameTask, a position": Case(
        lambda target: use_task(rbd.control.FrameTask(FRAME, target)), {"target": np.array([0.1, 0.0, 0.3])}, 20
    ),
    "PostureTask": Case(
        lambda **given: use_task(rbd.control.PostureTask(**given)),
        {"target": STATE.q, "joints": list(BOLT.actuated_names), **TASK, "cost": np.ones(BOLT.nu)},
        30,
    ),
    "MomentumTask": Case(
        lambda **given: use_task(rbd.control.MomentumTask(**given)),
        {"target": np.ones(6), "linear_cost": 0.5, "angular_cost": np.ones(3), "gain": 5.0, "name": "calm"},
        30,
    ),
    "ForceTask": Case(
        lambda **given: use_task(rbd.control.ForceTask(**given)),
        {"contact": "left", "target": np.array([1.0, 0.0, 9.0]), "cost": np.ones(3), "name": "press"},
        30,
    ),
    "step": Case(
        use_step,
        {"state": MOVING, "tasks": [rbd.control.PostureTask(STATE.q)], "contacts": FEET, "t": 0.1}
        | {
            "limits": rbd.control.Limits(),
            "external": np.zeros(BOLT.nv),
            "normal_force": {FEET[0].name: (0.0, 50.0)},
            "contact_damping": 20.0,
        },
        100,
    ),
    "Limits": Case(
        lambda **given: use_limits(rbd.control.Limits(**given)),
        {"torque": 0.5, "position": True, "velocity": False, "braking": 30.0, "horizon": 0.01, "margin": 1e-3},
        30,
    ),
    "Limits.torques": Case(rbd.control.Limits().torques, {"robot": BOLT}, 10),
    "Limits.accelerations": Case(
        lambda state: [np.clip(each, -1e9, 1e9) for each in rbd.control.Limits().accelerations(state)], {"state": MOVING}, 10
    ),
    "CollisionContacts": Case(
        use_collision,
        {"name": "floor", "robot": BOX, "friction": 0.5, "facets": 4, "ground": True, "pairs": False}
        | {"point": np.array([0.0, 0.0, -0.1]), "normal": np.array([0.0, 0.0, 1.0]), "margin": 1e-4},
        30,
    ),
    "visual.export_motion": Case(
        export_motion,
        {"motion": TRAJECTORY, "path": "/nowhere/x.html", "fps": 30, "speed": 1.0, "title": "x", "start": 0.0}
        | {
            "seen_from": (1, 0.6, 0.3),
            "arrow_per_weight": 0.3,
            "ghost": TRAJECTORY,
            "beside": TRAJECTORY,
            "charts": ["energy"],
            "plan": TROT.plan,
        },
        20,
    ),
    "visual.plot_walk": Case(
        lambda **given: use_plots(plot_walk, **given), {"axes": Figure().subplots(3).tolist(), "plan": TROT.plan}, 10
    ),
    "visual.plot_plan": Case(
        lambda **given: use_plots(plot_plan, **given), {"axes": Figure().subplots(3).tolist(), "plan": SMALL_PLAN}, 10
    ),
    "visual.plot_control": Case(
        lambda **given: use_plots(plot_control, **given), {"axes": Figure().subplots(2).tolist(), "log": TROT_LOG}, 10
    ),
    "visual.motion_sheet": Case(
        motion_sheet,
        {"motion": TRAJECTORY, "times": [0.0], "png_path": "/nowhere/x.png", "columns": 1, "width": 9, "height": 9}
        | {"ghost": None},
        20,
    ),
    "visual.export_video": Case(
        export_video,
        {
            "motion": TRAJECTORY,
            "path": "/nowhere/x.gif",
            "fps": 30,
            "width": 96,
            "height": 64,
            "speed": 1.0,
            "view": "front",
        }
        | {
            "title": "x",
            "ghost": None,
            "beside": None,
            "seen_from": (1, 0.6, 0.3),
            "layers": {"cones": False},
            "browser": None,
        },
        20,
    ),
    "visual.notebook_page": Case(
        notebook_page, {"shown": "/nowhere/x.html", "height": 300, "still": False, "browser": None}, 20
    ),
    "visual.replay": Case(replay, {"motion": "none", "speed": 1.0, "scene": "none"}, 20),
    "visual.plot_forces": Case(
        lambda **given: use_plots(plot_forces, **given),
        {"ax": Figure().subplots(), "trajectory": TRAJECTORY, "names": ["floor"]},
        20,
    ),
    "visual.plot_energy": Case(
        lambda **given: use_plots(plot_energy, **given), {"ax": Figure().subplots(), "trajectory": TRAJECTORY}, 20
    ),
    "visual.plot_joint": Case(
        lambda **given: use_plots(plot_joint, **given),
        {"ax": Figure().subplots(), "trajectory": TRAJECTORY, "joint": "root_joint.x", "what": "q"},
        20,
    ),
    "visual.plot_panels": Case(
        lambda **given: use_plots(plot_panels, **given), {"axes": Figure().subplots(2, 4).tolist(), "motion": PLANAR}, 20
    ),
    "visual.plot_paths": Case(
        lambda **given: use_plots(plot_paths, **given), {"axes": Figure().subplots(1, 2).tolist(), "motion": PLANAR}, 20
    ),
    "visual.plot_split": Case(
        lambda **given: use_plots(plot_split, **given), {"axes": Figure().subplots(1, 3).tolist(), "motion": PLANAR}, 20
    ),
    "visual.plot_sticks": Case(
        lambda **given: use_plots(plot_sticks, **given),
        {"ax": Figure().subplots(), "chain": LINKS, "q_samples": PLANAR.q[::20], "count": 3},
        20,
    ),
    "visual.plot_ellipses": Case(
        lambda **given: use_plots(plot_ellipses, **given),
        {"ax": Figure().subplots(), "chain": LINKS, "q_samples": PLANAR.q[::20], "kind": "manipulability", "count": 3},
        20,
    ),
    "visual.contact_colors": Case(contact_colors, {"names": ["left", "right"]}),
    "visual.scenes_beside": Case(
        scenes_beside,
        {"scenes": {"box": BOX.at()}, "html_path": "/nowhere/x.html", "columns": 2, "seen_from": np.ones(3), "legend": True},
        10,
    ),
    "visual.contact_sheet": Case(
        contact_sheet,
        {"robots": ["nobody"], "png_path": "/nowhere/x.png", "columns": 1, "width": 9, "height": 9, "friction": 0.7},
    ),
    "visual.screenshot": Case(
        screenshot, {"html_path": "/nowhere/x.html", "png_path": "/nowhere/x.png", "width": 9, "height": 9}
    ),
}
SWAY_T = np.arange(8) / 20.0
SWAY_Q = np.array([pin.integrate(BOLT.model, STATE.q, 0.02 * np.sin(3.0 * t) * V) for t in SWAY_T])
SWAY = rbd.Motion.of_arrays(BOLT, SWAY_T, SWAY_Q)
SWAY_FILE = Path(tempfile.mkdtemp()) / "sway.csv"
SWAY.save(SWAY_FILE, header=False)


def use_motion(motion: Any) -> Any:
    """The numbers of a motion."""
    if isinstance(motion, rbd.Motion):
        how = motion.derivation
        noise = () if how is None else (how.window, how.cutoff, how.noise_q, how.noise_v, how.noise_a)
        return motion.t, motion.q, motion.v, motion.a, motion.ground, noise
    return motion


def use_save(**given: Any) -> Any:
    """Nothing that is saved; a place that is none of the test's is not written to."""
    given["path"] = given["path"] if isinstance(given["path"], str) and "nowhere" in given["path"] else "x"
    return SWAY.save(**given)


def use_files(ask: Any, files: Any, **given: Any) -> Any:
    """The same for files that are listed: no folder of the machine is walked."""
    return [str(each) for each in ask("/nowhere/x.csv" if isinstance(files, str) else files, **given)]


CASES |= {
    "motion.list_motions": Case(
        lambda **given: use_files(rbd.motion.list_motions, **given), {"files": [SWAY_FILE], "robot": BOLT}, 10
    ),
    "motion.read_all": Case(
        lambda **given: use_files(rbd.motion.read_all, **given), {"files": {"bolt": SWAY_FILE}, "rate": 20.0}, 10
    ),
    "motion.derivatives": Case(
        lambda **given: (found := rbd.motion.derivatives(**given))[:2] + (found[2].noise_a, found[2].cutoff),
        {"robot": BOLT, "t": SWAY_T, "q": SWAY_Q, "window": 0.2, "order": 3, "method": "local polynomial", "noise": 1e-6},
        30,
    ),
    "motion.minimum_jerk": Case(
        lambda **given: use_motion(rbd.motion.minimum_jerk(**given)),
        {"robot": BOLT, "poses": [STATE.q, SWAY_Q[3]], "times": [0.0, 0.5], "rate": 20.0, "ground": 0.0},
        30,
    ),
    "Motion.of_arrays": Case(
        lambda **given: use_motion(rbd.Motion.of_arrays(**given)),
        {"robot": BOLT, "t": SWAY_T, "q": SWAY_Q, "window": 0.2, "order": 3, "cutoff": 5.0, "noise": 1e-6, "notes": ["x"]},
        30,
    ),
    "Motion.of_arrays, given": Case(
        lambda **given: use_motion(rbd.Motion.of_arrays(BOLT, **given)),
        {"t": SWAY_T, "q": SWAY_Q, "v": SWAY.v, "a": SWAY.a, "ground": 0.0},
        30,
    ),
    "Motion.of_trajectory": Case(lambda **given: use_motion(rbd.Motion.of_trajectory(**given)), {"trajectory": TRAJECTORY}, 10),
    "Motion.from_function": Case(
        lambda **given: use_motion(rbd.Motion.from_function(**given)),
        {"robot": BOLT, "f": lambda t: STATE.q, "t": SWAY_T, "ground": 0.0},
        20,
    ),
    "Motion.read": Case(
        lambda **given: use_motion(rbd.Motion.read(**given)),
        {
            **{"path": SWAY_FILE, "robot": BOLT, "rate": 20.0, "quaternion": "xyzw", "joints": list(BOLT.actuated_names)},
            **{"units": "rad", "window": 0.2, "order": 3, "cutoff": 5.0, "ground": 0.0, "progress": False},
        },
        30,
    ),
    "Motion.state": Case(SWAY.state, {"i": 3}, 10),
    "Motion.with_contacts": Case(lambda contacts: use_motion(SWAY.with_contacts(contacts)), {"contacts": None}, 10),
    "Motion.resample": Case(lambda rate: use_motion(SWAY.resample(rate)), {"rate": 30.0}, 20),
    "Motion.cut": Case(lambda **given: use_motion(SWAY.cut(**given)), {"start": 0.1, "end": 0.3}, 20),
    "Motion.carrying": Case(lambda **given: use_carrying(SWAY.carrying, **given), {"thing": rbd.Carried(1.0, [FRAME])}, 10),
    "Motion.lifted": Case(lambda height: use_motion(SWAY.lifted(height)), {"height": 0.1}, 10),
    "Motion.filtered": Case(lambda cutoff: use_motion(SWAY.filtered(cutoff)), {"cutoff": 5.0}, 10),
    "Motion.save": Case(use_save, {"path": "/nowhere/x.csv", "kind": "motion", "header": True, "decimals": 6}, 10),
}
AUDITED = rbd.audits.from_solutions([SOLUTION, rbd.solve(MOVING, TAU, [])])
RECORDED = {name: getattr(AUDITED, name) for name in ("t", "q", "v", "a", "tau", "points", "normals", "friction", "forces")}
RECORDED |= {"contact_at": AUDITED.contact_at, "gaps": np.zeros(len(AUDITED.points)), "step": 0.01}
RECORDED |= {"contact_bodies": [AUDITED.bodies[first] for first, _ in AUDITED.contact_bodies.tolist()]}


def use_audit(report: Any) -> Any:
    """What it says of each frame."""
    return report.missing, report.sizes, report.obeying, str(report)


CASES |= {
    "audit": Case(
        lambda **given: use_audit(rbd.audit(**given)),
        {"record": AUDITED, "law": "coulomb", "friction": 0.7, "thresholds": None},
        20,
    ),
    "audits.Record.of_arrays": Case(
        lambda **given: use_audit(rbd.audit(rbd.audits.Record.of_arrays(BOLT, **given))),
        RECORDED | {"quaternion": "xyzw", "base_velocity": "body", "engine": "x", "notes": ["x"]},
        40,
    ),
}
CHECKED = {"motion": SWAY, "friction": 0.7, "torque_limits": True, "contacts": None, "ground": "fit", "threshold": 0.02}
CHECKED |= {"bodies": False, "self_collision": False, "torque_speed": None, "rest_speed": 5e-3}
CHECKED |= {"touch_height": 0.03, "touch_speed": 0.25}


SWAY_REPORT = rbd.check_motion(**CHECKED)


def use_difference(off: Any) -> Any:
    """Its numbers."""
    return off.joints, off.base, off.turn, off.com


def use_checks(files: Any, **given: Any) -> Any:
    """The numbers of a data set; what is wrong with its motion."""
    given["workers"] = min(given["workers"], 0) if isinstance(given["workers"], int) else given["workers"]
    found = rbd.studies.check_motions("/nowhere/x.csv" if isinstance(files, str) else files, **given, progress=False)
    for reason, message in found.failed.values():
        raise rbd.errors.InputError(f"{reason}: {message}")
    return [float(found.dataset[name][0]) for name in ("score", "missing_median")]


ARM = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0]).with_motors({"joint_1": rbd.Motor(limit=8.0)})
SWING = rbd.motion.minimum_jerk(ARM, [np.array([-1.5]), np.array([0.0])], [0.0, 0.6])
TIMED = {"motion": SWING, "contacts": None, "fastest": 1.5, "start": 1.0, "end": 1.0, "friction": 0.7, "torque_limits": True}
TIMED |= {"speed_limits": True, "threshold": 0.02}


BARS = rbd.mechanism.four_bar(1.0, 3.0, 2.5, 3.0)
FOUR_BAR_TRACE = rbd.mechanism.trace(BARS.at("assembled"), joint="crank_joint", values=(0.0, 0.5), steps=3)


def use_check(**given: Any) -> Any:
    """What a check computes."""
    report = rbd.check_motion(**given)
    return report.causes.astype(float), report.missing, report.forces, report.tau, report.score


CASES |= {
    "check_motion": Case(use_check, CHECKED, 20),
    "check_motions": Case(
        use_checks,
        {"files": [SWAY_FILE], "robot": BOLT, "reading": {"rate": 20.0}, "between": (0.0, 1.0), "cutoff": 5.0, "lift": False}
        | {"workers": 0},
        5,
    ),
    "motion.find_timing": Case(lambda **given: [(x := rbd.motion.find_timing(**given)).s, x.t, x.pace, x.rise], TIMED, 20),
    "motion.retimed": Case(lambda **given: use_motion(rbd.motion.retimed(**given)), TIMED, 20),
    "mechanism.pin_forces": Case(
        lambda **given: list(rbd.mechanism.pin_forces(**given).values()), {"solution": rbd.solve(BARS.at("assembled"), [0.0])}
    ),
    "visual.plot_trace": Case(
        lambda **given: use_plots(rbd.visual.plot_trace, **given),
        {"axes": Figure().subplots(2, 2), "trace": FOUR_BAR_TRACE, "frame": "coupler", "offset": (0.1, 0.0, 0.0)},
        10,
    ),
    "mechanism.FourBarClass": Case(
        lambda **given: rbd.mechanism.FourBarClass(**given).excess, {"input": 1.0, "coupler": 3.0, "output": 2.5, "ground": 3.0}
    ),
    "visual.plot_timing": Case(
        lambda **given: use_plots(plot_timing, **given),
        {"ax": Figure().subplots(), "timing": rbd.motion.find_timing(**TIMED)},
        10,
    ),
    "plan": Case(
        lambda **given: [(x := rbd.plan(**given)).q, x.t, x.missing, x.drift, x.torques(0.1)],
        {
            "robot": SOLO_12,
            "keyframes": {0.0: SOLO_12.standing(), 0.2: SOLO_12.standing()},
            "contacts": {foot.name: True for foot in SOLO_12.feet()},
            "friction": 0.6,
            "ground": 0.0,
            "times": "given",
            "cost": rbd.centroid.CentroidCosts(),
            "limits": 0.9,
            "self_collision": False,
            "clearance": 0.01,
            "progress": False,
        },
        10,
    ),
    "MotionReport.repaired": Case(
        lambda **given: use_motion(SWAY_REPORT.repaired(**given)), {"slower": 1.5, "keep": ["FL_FOOT"], "progress": False}, 10
    ),
    "MotionDifference.of": Case(
        lambda **given: use_difference(rbd.motion.MotionDifference.of(**given)), {"motion": SWAY, "reference": SWAY}, 10
    ),
    "motion.check_motion": Case(use_check, CHECKED, 5),
    "visual.plot_report": Case(
        lambda **given: use_plots(plot_report, **given), {"axes": Figure().subplots(2).tolist(), "report": SWAY_REPORT}, 10
    ),
    "motion.find_contacts": Case(
        lambda **given: [(x := rbd.motion.find_contacts(**given)).heights, x.touches.astype(float), x.ground],
        {"motion": SWAY, "bodies": False, "ground": "fit", "rest_speed": 5e-3, "touch_height": 0.03, "touch_speed": 0.25},
        20,
    ),
}
DROP = rbd.audits.bench.FrictionProblem("drop", 3, mu=[0.5], W=np.eye(3), q=np.array([-1.0, 0.1, 0.0]))
STEP = {"name": "step", "dim": 2, "mu": np.array([0.5]), "M": np.diag([2.0, 1.0]), "H": np.eye(2), "w": np.zeros(2)} | {
    "f": np.array([-1.0, 3.0]), "about": "a step", "known": {}
}  # fmt: skip
DROPPED = rbd.audits.bench.write(WORLD.with_name("drop.dat"), DROP)


def use_friction(problem: Any) -> Any:
    """What the bench makes of a problem."""
    answer = rbd.audits.bench.solve(problem)
    assert answer.solved
    return answer.u, answer.v, answer.natural_map  # its forces need not be unique


CASES |= {
    "bench.FrictionProblem": Case(lambda **given: use_friction(rbd.audits.bench.FrictionProblem(**given)), STEP, 30),
    "bench.FrictionProblem, local": Case(
        lambda **given: use_friction(rbd.audits.bench.FrictionProblem("rolls", **given)),
        {"dim": 5, "mu": [0.5], "mu_r": [0.1], "W": np.eye(5), "q": np.array([-1.0, 1.0, 0.0, 0.0, 2.0])},
        30,
    ),
    "bench.solve": Case(lambda **given: rbd.audits.bench.solve(**given).u, {"problem": DROP, "guess": np.zeros(3)}, 20),
    "bench.compare": Case(
        lambda **given: use_answers(rbd.audits.bench.compare(**given)),
        {"problems": [DROP], "solvers": ["rbd, sparse Newton", "Pinocchio, PGS"]},
        10,
    ),
    "bench.humanoid_problems": Case(
        lambda **given: [problem.f for problem in islice(rbd.audits.bench.humanoid_problems(**given), 2)],
        {"count": 2, "seed": 1, "scenes": ["fall", "jam"]},
        10,
    ),
    "bench.spheres_in_a_box": Case(
        lambda **given: use_spheres(**given), {"side": 2, "layers": 2, "friction": 0.5, "seed": 1}, 10
    ),
    "bench.read": Case(lambda **given: use_friction(rbd.audits.bench.read(**given)), {"path": DROPPED}, 10),
    "bench.write": Case(
        lambda path, **given: str(rbd.audits.bench.write(given_place(path), **given)),
        {"path": DROPPED.with_name("again.dat"), "problem": DROP, "answer": None},
        10,
    ),
}


def given_place(path: Any) -> Any:
    """A path that is nonsense is not written to."""
    return path if isinstance(path, Path) or not isinstance(path, str | bytes) else "/nowhere/x.dat"


def use_answers(found: Any) -> Any:
    """What several solvers make of problems."""
    return [answer.u for name in found.answers for answer in found.taken(name)]


def use_spheres(**given: Any) -> Any:
    """The matrices of a few spheres."""
    problem = rbd.audits.bench.spheres_in_a_box(**given)
    return problem.f, problem.mu


MADE_BY_RBD = {
    "Comparison",
    "FrictionAnswer",
    "Plan",
    "MomentumCertificate",
    "WalkPlan",
    "ElementPicture",
    "LoopFile",
    "Floquet",
    "Linearised",
    "Mode",
    "SteadyState",
    "Samples",
    "Explorer",
    "Motion",
    "MotionChecks",
    "MotionDifference",
    "MotionFile",
    "Derivation",
    "ContactTimeline",
    "MotionReport",
    "Timing",
    "Answer",
    "Trajectory",
    "Trajectories",
    "MotionDerivatives",
    "WorldCertificate",
    "AcceptedStep",
    "ContactTouch",
    "ControlLog",
    "ForceEstimate",
    "Identification",
    "IdentificationCertificate",
    "BodyInertia",
    "BaseParameters",
    "Excitation",
    "ParameterDerivatives",
    "ForceHistory",
    "OpenComponents",
    "Event",
    "Impact",
    "ContactPoints",
    "Solutions",
    "SolverComparison",
    "LawComparison",
    "Contradiction",
    "NearestMotion",
    "Derivatives",
    "ContactWrenchCone",
    "PushLimits",
    "RobustHold",
    "Counterexample",
    "Member",
    "RobustPushLimits",
    "RobustRegion",
    "CaptureRegion",
    "SupportRegion",
    "ZmpRegion",
    "Actuation",
    "TaskActuation",
    "StepCertificate",
    "Violation",
    "Actuations",
    "ActuationUniqueness",
    "Limit",
    "Margins",
    "Missing",
    "RobotPair",
    "Solution",
    "Robot",
    "ModelReport",
    "ModelIssue",
    "Enclosure",
    "Intervals",
    "Uniqueness",
    "Mobility",
    "Singularities",
    "SingularitiesAlong",
    "Integrability",
    "MechanismClass",
    "Assembly",
    "FoundPose",
    "ProjectedAcceleration",
    "Branch",
    "Branches",
    "Trace",
    "VelocityPartition",
    "AccelerationPartition",
}
"""Records that only `rbd` makes; their makers are tested here."""


NAMES = [
    *("", " ", "left_sol", "LEFT", "universe", "a\0b", "Ω\u202e", "../../x", "%s{}", "x" * 100_000, "\ud800", "~nobody/x.urdf"),
    b"bolt",
]
NUMBERS = [0, -1, 1, 10**400, 10**12, -(2**70), 1e300, -1e300, 1e150, 1e-320, np.nan, np.inf, -np.inf, 0.5, 1 + 2j, True]
ODD = [
    *(None, (), [], {}, set(), [[]], [None], [[1.0], [1.0, 2.0]], [[[1.0] * 3] * 3] * 3, object(), object, len, ..., range(3)),
    *(np.array(3.0), np.array([]), np.zeros((0, 3)), np.zeros((3, 0)), np.array(["1", "2", "3"]), np.array([1, 2, 3], "m8[s]")),
    *(np.ma.masked_array([1.0, 2.0, 3.0], [0, 1, 0]), np.float32(1.0), np.bool_(True), np.array([None] * 3), {"a": 1}),
    *(
        np.zeros(3, dtype=[("x", float)]),
        pin.SE3.Random(),
        BOX,
        STATE,
        BOX.at(),
        FEET[0],
        FEET,
        PROBLEM,
        SOLUTION,
        rbd.problem.Free(3),
    ),
    *(rbd.State, rbd.PointContact, rbd.PointContact("other", "box"), PUSH, Path("."), rbd.ProxQP(), [10**400] * 3, "1 2 3"),
]


def spoilt(value: Any) -> st.SearchStrategy[Any]:
    """Nonsense that is near to an argument that works, or far from it."""
    far = st.one_of(st.sampled_from(NAMES), st.sampled_from(NUMBERS), st.sampled_from(ODD), st.binary(max_size=8))
    if isinstance(value, str):
        near = [value[:-1], value + "x", value.upper(), value + "\0", value.encode(), [value], Path(value), " " + value]
        return st.one_of(st.sampled_from(near), far)
    if isinstance(value, np.ndarray):
        return st.one_of(_spoilt_array(value), _spoilt_array(value), far)
    if isinstance(value, list | tuple):
        items = list(value)
        near = [items * 2, items[:-1], [*items, None], [items], iter(items), tuple(items), dict.fromkeys(range(len(items)))]
        return st.one_of(st.sampled_from(near[:4] + near[5:]), far.map(lambda x: [*items, x]), far)
    return far


@st.composite
def _spoilt_array(draw: st.DrawFn, value: np.ndarray) -> Any:
    how = draw(st.integers(0, 9))
    if how < 4 and value.size:
        out = value.copy()
        at = draw(st.integers(0, value.size - 1))
        entry = draw(st.sampled_from(["nan", "inf", "-inf", 1e300, -1e150, 1e149, 1e12, 1e100, 1e-320, "3.5", "-1"]))
        out.flat[at] = float(entry)
        return out
    scale = draw(st.sampled_from([1.0 + 1e-7, 1.01, -1.0, 0.0, 1e8, 1e60, 1e140, 1e307]))
    kinds = [float, "f4", "f2", "g", complex, object, str, "i8", bool, "u1"]
    return [
        value * scale if np.abs(value).max(initial=0.0) < 10.0 else value,
        value.astype(draw(st.sampled_from(kinds))),
        draw(st.sampled_from([value[:-1], np.r_[value, value[:1]], value[None], value.T[..., None], value.ravel()])),
        value.tolist(),
        np.repeat(value, 2, axis=0)[::2],  # not contiguous
        np.ma.masked_invalid(value),
    ][how - 4]


def numbers_in(answer: Any) -> Iterator[np.ndarray]:
    """All numbers of an answer."""
    if isinstance(answer, np.ndarray | float | int | np.generic) and not isinstance(answer, bool):
        yield np.asarray(answer, float)
    elif isinstance(answer, pin.SE3):
        yield answer.homogeneous
    elif isinstance(answer, rbd.State):
        yield from numbers_in([answer.q, answer.v, answer.M, answer.h, answer.com])
    elif isinstance(answer, rbd.Robot):
        yield from numbers_in([answer.mass, answer.nq])
    elif isinstance(answer, rbd.GaussProblem):
        yield from numbers_in([answer.M, answer.rhs, answer.a_free, answer.J, answer.offset])
    elif isinstance(answer, rbd.problem.Answer):
        yield from numbers_in([answer.a, answer.forces])
    elif isinstance(answer, rbd.Actuation):
        yield from numbers_in([answer.a, answer.tau, answer.forces, answer.corner_forces])
    elif isinstance(answer, rbd.Rows):
        yield from numbers_in([answer.J, answer.bias, answer.velocity])
    elif isinstance(answer, dict):
        yield from numbers_in(list(answer.values()))
    elif isinstance(answer, list | tuple):
        for each in answer:
            yield from numbers_in(each)
    elif is_dataclass(answer) and not isinstance(answer, type):
        yield from numbers_in([getattr(answer, f.name) for f in fields(answer) if not f.name.startswith("_")])


def certified(answer: Any) -> bool:
    """Whether every solution in an answer is one, and every inertia is positive definite."""
    if isinstance(answer, rbd.problem.Answer):
        return answer.status in (rbd.problem.Status.SOLVED, rbd.problem.Status.INACCURATE)
    if isinstance(answer, rbd.Actuation):
        return answer.status in (rbd.problem.Status.SOLVED, rbd.problem.Status.INACCURATE)
    if isinstance(answer, rbd.State):
        return bool(np.linalg.eigvalsh(answer.M)[0] > 0.0)
    return all(map(certified, answer)) if isinstance(answer, list | tuple) else True


def cleaned(value: Any, good: Any) -> Any:
    """An argument as whoever gave it meant it."""
    listed = (
        isinstance(good, np.ndarray)
        and isinstance(value, np.ndarray | list | tuple)
        and getattr(value, "ndim", 1)
        and len(value) > 0
    )
    return np.array(value, float) if listed else value


def ask(case: Case, given: dict[str, Any]) -> Any:
    """The answer, or the `RbdError`; any other exception, and warnings that are not ours, go through."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", rbd.errors.RbdWarning)
        try:
            return case.call(**given)
        except rbd.RbdError as error:
            return error


def check(case: Case, spoils: dict[str, Any], *, twice: bool = True) -> None:
    """The law: an `RbdError` that can be read, or an answer that is finite, certified and that of the cleaned input.

    Where nothing is to be cleaned the same question is asked `twice`, or not.
    """
    answer = ask(case, case.good | spoils)
    if isinstance(answer, rbd.RbdError):
        assert 0 < len(str(answer)) <= LONGEST_MESSAGE
        return
    found = list(numbers_in(answer))
    assert all(np.isfinite(x).all() for x in found), "not finite"
    assert certified(answer) or "check" in spoils, "not certified"
    clean = {key: cleaned(value, case.good[key]) for key, value in spoils.items()}
    if not twice and all(clean[key] is spoils[key] for key in spoils):
        return
    again = ask(case, case.good | clean)
    for x, y in zip(found, numbers_in(again), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-6 * max(1.0, float(np.abs(y).max(initial=0.0))))


@pytest.mark.parametrize("name", CASES)
def test_nonsense_is_refused_or_answered_right(name: str, exhaustive: bool) -> None:
    """Found by hypothesis: two arguments spoilt at once, arrays and names that are nearly right."""
    case = CASES[name]

    @hypothesis.settings(SETTINGS, max_examples=case.examples if exhaustive else case.examples // 5)
    @hypothesis.given(st.data())
    def law(data: st.DataObject) -> None:
        keys = data.draw(st.lists(st.sampled_from(sorted(case.good)), min_size=1, max_size=2, unique=True))
        check(case, {key: data.draw(spoilt(case.good[key]), label=key) for key in keys})

    law()


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, case in CASES.items() for key in case.good])
def test_each_odd_thing_is_refused_or_answered_right(name: str, key: str, exhaustive: bool) -> None:
    """Left to chance, one in a hundred would be missed: every odd thing, for every argument.

    That the same question has the same answer is asked above, and of each odd thing by `make exhaustive`.
    """
    for odd in (*NAMES, *NUMBERS, *ODD):
        check(CASES[name], {key: odd}, twice=exhaustive)


@pytest.mark.parametrize("name", CASES)
def test_the_unspoilt_call_is_answered(name: str) -> None:
    """The law above can fail: arguments that work are not refused, but for pages that cannot be written."""
    answer = ask(CASES[name], CASES[name].good)
    refused = {"visual.Scene.export", "visual.screenshot", "visual.contact_sheet", "Robot.soles", "mechanism.four_bar, no file"}
    refused |= {
        "visual.export_mode",
        "visual.export_motion",
        "visual.export_video",
        "visual.motion_sheet",
        "visual.notebook_page",
        "visual.replay",
        "visual.scenes_beside",
        "Motion.save",
    }
    assert isinstance(answer, rbd.RbdError) == (name in refused), answer


def public() -> Iterator[str]:
    """Names of all public callables that take arguments."""
    packages = (
        rbd.answers.analysis,
        rbd.constraints,
        rbd.control,
        rbd.constraints.forces,
        rbd.answers.many,
        rbd.model,
        rbd.problem,
        rbd.robots,
        rbd.simulation,
        rbd.statics,
        rbd.studies,
        rbd.worlds,
    )
    rooms = [("", place, place.__all__) for place in (rbd, *packages)]
    rooms += [("dynamics.", rbd.dynamics, None), ("catalogue.", rbd.robots.catalogue, None)]
    rooms += [("mechanism.", rbd.mechanism, rbd.mechanism.__all__), ("visual.", rbd.visual, rbd.visual.__all__)]
    rooms += [("small_motion.", rbd.mechanism.small_motion, rbd.mechanism.small_motion.__all__)]
    rooms += [("identification.", rbd.motion.identification, rbd.motion.identification.__all__)]
    rooms += [("robust.", rbd.robust, rbd.robust.__all__)]
    rooms += [("bench.", rbd.audits.bench, rbd.audits.bench.__all__)]
    rooms += [("motion.", rbd.motion, rbd.motion.__all__), ("Motion.", rbd.Motion, None)]
    rooms += [("Robot.", rbd.Robot, None), ("State.", rbd.State, None)]
    for room, place, names in rooms:
        for name in names or [n for n in dir(place) if not n.startswith("_")]:
            value = getattr(place, name)
            if inspect.ismodule(value) or not callable(value) or name in MADE_BY_RBD or room + name in INNER:
                continue
            if place is not rbd and name in rbd.__all__ and getattr(rbd, name) is value:
                continue  # asked by its name on top
            if isinstance(value, type) and (issubclass(value, BaseException) or issubclass(value, Enum)):
                continue
            if getattr(value, "_is_protocol", False):
                continue
            if names is None and inspect.ismodule(place) and (value.__module__ != place.__name__ or isinstance(value, type)):
                continue
            wanted = [p for p in inspect.signature(value).parameters if p != "self"]
            if wanted:
                yield room + name


INNER = {"State.moving", "State.balance", "State.base_pose", "State.joint_places", "State.joint_motion", "dynamics.polarised"}
INNER |= {"Robot.limits_at", "Robot.torque_use", "Robot.too_fast", "Robot.moved", "Robot.has_read"}
INNER |= {"dynamics.energies_and_momenta", "dynamics.unconstrained"}
"""What constraints and problems call, with what was checked."""


def test_every_public_callable_is_asked() -> None:
    """A new one wants a case."""
    assert set(public()) - set(CASES) == set()
