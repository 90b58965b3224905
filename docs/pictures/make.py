"""Makes docs/pictures/*.png: `make pictures`, or `python docs/pictures/make.py NAME ...`, with Chromium on PATH."""

import itertools
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import constraint_pictures
import least_constraint_pictures
import numpy as np
import planar_pictures
import planar_sketches
import scenes
import task_pictures
import walk_pictures
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont
from photographs import contact_sheet, motion_sheet, screenshot
from PIL import Image, ImageDraw, ImageFont

import rbd
from rbd.cli.mechanism_report import MechanismReport, report_mechanism
from rbd.visual import Scene, plot_region
from rbd.visual.figures.plots import frame
from rbd.visual.pages.browser import Browser

PICTURES = Path(__file__).resolve().parent
TOP = PICTURES.parents[1]
STANDING = ("talos", "g1", "romeo", "icub", "human", "solo12", "anymal_c", "go2", "bolt")
MECHANISMS = (
    *("four_bar", "slider_crank", "five_bar", "six_bar", "parallel_leg"),
    *("unicycle", "two_wheeled", "bicycle", "rolling_disk"),
)


def scene(picture: str, width: int, height: int) -> Path:
    """A photograph of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        page = scenes.SCENES[picture](Path(folder) / f"{picture}.html")
        return screenshot(page, PICTURES / f"{picture}.png", width=width, height=height)


def example_page(picture: str, name: str, width: int, height: int) -> Path:
    """A photograph of the page that an example writes."""
    with tempfile.TemporaryDirectory() as folder:
        page = scenes.shown(name, Path(folder) / f"{picture}.html")
        return screenshot(page, PICTURES / f"{picture}.png", width=width, height=height)


def poses() -> Path:
    """Three poses of `docs/reference/poses.md`, each held by its feet."""
    talos, g1, width, height = rbd.load_robot("talos"), rbd.load_robot("g1"), 500, 560
    step = {"left_sole": (0.15, 0.12, 0.0), "right_sole": (-0.1, -0.12, 0.0), "gripper_left_base_link": (0.55, 0.35, 1.25)}
    standing = g1.standing()
    stay = {sole.name: standing.frame(sole.frame).X_WF * sole.placement for sole in g1.soles()}
    stair = {"left_sole": (0.3, 0.085, 0.17), "right_sole": (0.0, -0.085, 0.0)}
    made = (
        (rbd.find_pose(talos, step, com=(0.02, 0.0)), talos.soles()),
        (rbd.find_pose(g1, stay, com=standing.com - [0.0, 0.0, 0.2]), g1.soles()),
        (rbd.find_pose(talos, stair, com=(0.15, 0.0)), talos.soles(on={"left_sole": 0.17})),
    )
    sheet = Image.new("RGB", (3 * width, height), "white")
    with tempfile.TemporaryDirectory() as folder:
        for i, (found, soles) in enumerate(made):
            solution = rbd.solve(found.state, rbd.hold(found.state, soles).tau, soles)
            with Scene(found.state.robot, legend=False) as scene:
                scene.show(found.state, solution)
                page = scene.export(Path(folder) / f"{i}.html")
            shot = Image.open(screenshot(page, Path(folder) / f"{i}.png", width=width, height=height))
            sheet.paste(shot.resize((width, height)), (width * i, 0))
    sheet.save(PICTURES / "poses.png")
    return PICTURES / "poses.png"


def where_it_can_stand() -> Path:
    """Support regions of Talos from above, and its largest pushes all around."""
    robot = rbd.load_robot("talos")
    state, soles = robot.standing(), robot.soles(friction=0.7)
    wall = rbd.Ground(normal=(0.0, -1.0, 0.0))
    contacts = [*soles, rbd.PointContact("hand", "gripper_left_base_link", on=wall, friction=0.5)]
    regions = {
        "with the hand": rbd.statics.support_region(state, contacts),
        "with the hand, within torque limits": rbd.statics.support_region(state, contacts, torque_limits=True),
        "soles alone": rbd.statics.support_region(state, soles),
    }
    angle = np.arange(72) * 2.0 * np.pi / 72
    ways = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    figure = Figure(figsize=(12.0, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot_region(left, *regions.values(), labels=list(regions))
    rbd.statics.push_limits(state, contacts, "torso_2_link", ways).plot(right)
    figure.savefig(PICTURES / "where_it_can_stand.png", dpi=110, metadata={"Software": None})
    return PICTURES / "where_it_can_stand.png"


def robust() -> Path:
    """Both outlines of `docs/reference/robust.md`: places and pushes of Solo that are proved for a wide set."""
    solo = rbd.load_robot("solo12")
    state, feet, angle = solo.standing(), solo.feet(friction=0.7), np.arange(16) * 2.0 * np.pi / 16
    ways, given = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]), {"mass": 0.2, "com": {"base_link": 0.02}}
    figure = Figure(figsize=(14.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    pushes = rbd.robust.PushSet.box("base_link", (-4, -4, 0), (4, 4, 0))
    rbd.robust.region(state, feet, pushes=pushes, friction=0.4, **given).plot(left)
    rbd.robust.push_limits(state, feet, "base_link", ways, friction=0.4, **given).plot(right)
    figure.savefig(PICTURES / "robust.png", dpi=110, metadata={"Software": None})
    return PICTURES / "robust.png"


def motion_timing() -> Path:
    """The pace of `docs/reference/motion_repair.md`: G1 leans, the least slowed timing and the fastest one."""
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    for ax, most in zip(figure.subplots(1, 2), (1.0, 3.0), strict=True):
        rbd.motion.find_timing(scenes.lean(1.0), fastest=most).plot(ax)
    figure.savefig(PICTURES / "motion_timing.png", dpi=110, metadata={"Software": None})
    return PICTURES / "motion_timing.png"


def plot(picture: str, example: str, draw: str, size: tuple[float, float], *axes: int, sharex: bool = False) -> Path:
    """A plot of an example, drawn on axes of ours by the example's own function."""
    figure = Figure(figsize=size, layout="constrained")
    getattr(scenes.example(example), draw)(figure.subplots(*axes, sharex=sharex), scenes.result(example))
    figure.savefig(PICTURES / f"{picture}.png", dpi=110, metadata={"Software": None})
    return PICTURES / f"{picture}.png"


def fall() -> Path:
    """Example 14: Talos falls."""
    way, seen = scenes.result("14_push_recovery").ways[250.0], (1.0, 0.25, 0.2)
    push = scenes.example("14_push_recovery").push(250.0)
    times = [0.0, 0.15, 0.4, 0.7, 1.0]
    return motion_sheet(way, times, PICTURES / "fall.png", external=push, seen_from=seen, width=300, height=420)


def coin_strip() -> Path:
    """Example 16: a slow coin leans over more and more."""
    coin = scenes.result("16_rolling_disk").runs["slow"]
    return motion_sheet(coin, [0.0, 0.3, 0.5, 0.6, 0.7], PICTURES / "coin_strip.png", width=300, height=300)


def balance_strip() -> Path:
    """Example 29: Talos is pushed to its left, turns its arms and hips, and stands again."""
    push, way = scenes.balanced()
    times = [0.0, 0.1, 0.2, 0.35, 0.5, 0.8, 1.5]
    picture = PICTURES / "balance_strip.png"
    return motion_sheet(way, times, picture, external=push, seen_from=(1.0, 0.15, 0.15), trace=False, width=240, height=400)


def springs_strip() -> Path:
    """Example 31: Solo12 on a rubber cord, with springs in its joints, falls to the floor and up again."""
    run, times = scenes.result("31_springs").sprung, [0.0, 0.2, 0.35, 0.5, 0.75]
    picture = PICTURES / "springs_strip.png"
    return motion_sheet(run, times, picture, seen_from=(1.0, 0.6, 0.15), trace=False, width=240, height=500)


def tipping() -> Path:
    """Example 17: a crate tips over."""
    crate, times, aside = scenes.result("17_sliding_box").tipped[0.6], [0.0, 0.15, 0.3, 0.45, 0.6], (0.2, -1.0, 0.2)
    return motion_sheet(crate, times, PICTURES / "tipping.png", width=300, height=300, seen_from=aside)


def drawn(picture: str, name: str, width: int, height: int) -> Path:
    """The plot that an example writes, made smaller."""
    with tempfile.TemporaryDirectory() as folder, Image.open(scenes.shown(name, Path(folder) / "plot.png")) as plot:
        plot.resize((width, height), Image.Resampling.LANCZOS).save(PICTURES / f"{picture}.png")
    return PICTURES / f"{picture}.png"


def inverse_dynamics() -> Path:
    """The plot of docs/reference/inverse_dynamics.md: Talos' hips move to the left; what it costs, and what is possible."""
    robot = rbd.load_robot("talos")
    state, soles, held = robot.standing(), robot.soles(friction=0.7), robot.soles(friction=None)
    weight, wanted, shares, reached, lateral = 9.81 * robot.mass, np.linspace(0.0, 3.0, 121), [], [], np.zeros(robot.nv)
    for rate in wanted:
        lateral[1] = rate
        a = rbd.mechanism.project_acceleration(state, lateral, held).a
        try:
            way = rbd.inverse_dynamics(state, a, soles)
            friction = 1.0 - min(way.margins.friction.values())
            shares.append((1.0 - way.margins.torque.min(), friction, way.contacts["left_sole"].normal / weight))
        except rbd.CannotMove as error:
            way = error.nearest()
        reached.append((a[1], way.a[1]))
    figure = Figure(figsize=(8.6, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    words = ("largest torque, of its limit", "most friction of a foot, of its cone", "left foot, of the weight")
    colors = ("#0072b2", "#d55e00", "#009e73")
    for share, label, color in zip(100.0 * np.array(shares).T, words, colors, strict=True):
        left.plot(np.array(reached)[: len(shares), 0], share, color=color, label=label)
    left.set(ylabel="[%]", ylim=(0.0, 135.0), yticks=range(0, 101, 20), xlim=(0.0, 2.0))
    left.legend(frameon=False, loc="upper left")
    right.plot(*np.array(reached).T, color="#0072b2", label="possible")
    right.plot(*[np.array(reached)[:, 0]] * 2, ":", color="0.4", label="wanted")
    right.set(ylabel="nearest that is possible [m/s2]", xlim=(0.0, reached[-1][0]), ylim=(0.0, reached[-1][0]))
    right.legend(frameon=False, loc="upper left")
    for ax in (left, right):
        frame(ax, "y")
        ax.axvline(reached[len(shares) - 1][0], ls="--", color="0.4")
        ax.set_xlabel("hips to the left, wanted [m/s2]")
    figure.savefig(PICTURES / "inverse_dynamics.png", dpi=110, metadata={"Software": None})
    return PICTURES / "inverse_dynamics.png"


def control() -> Path:
    """The plot of docs/reference/control.md: a posture that is reached, and a joint that brakes before its limit."""
    arm = rbd.load_robot("panda", root="fixed")
    joint, colors = arm.joints["panda_joint4"], ("#0072b2", "#d55e00", "#009e73")
    start = arm.at().with_joints({joint.name: -0.8})

    def angles(goal: float, limits: rbd.control.Limits, **law: float) -> tuple[np.ndarray, np.ndarray]:
        task = rbd.control.PostureTask(start.with_joints({joint.name: goal}), cost=1e6, **law)
        controller = rbd.control.WholeBodyController([task], limits=limits)
        moved = rbd.simulate(start, [], duration=0.8, step=2e-3, controller=controller, progress=False)
        return moved.t, moved.q[:, joint.q][:, 0]

    figure = Figure(figsize=(8.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    free, root = rbd.control.Limits(torque=None, position=False, velocity=False), 10.0
    for zeta, color in zip((0.3, 1.0, 1.5), colors, strict=True):
        t, angle = angles(-0.7, free, gain=root**2, damping_ratio=zeta)
        left.plot(t[::16], (angle[::16] + 0.7) / -0.1, "o", ms=4, color=color, label=f"ζ = {zeta}")
        a, b = np.roots([1.0, 2.0 * zeta * root, root**2]) + (0.0, 1e-6)  # a little apart where they are equal
        left.plot(t, ((b * np.exp(a * t) - a * np.exp(b * t)) / (b - a)).real, color=color, lw=1.0)
    left.set(xlabel="time [s]", ylabel="error, of the first one")
    left.set_title("points: simulated; lines: closed form", fontsize=10)
    for braking, color in zip((5.0, 20.0, 50.0), colors, strict=True):
        t, angle = angles(0.4, rbd.control.Limits(horizon=2e-3, braking=braking), gain=root**2)
        right.plot(t, angle, color=color, label=f"braking = {braking:g} rad/s²")
    right.axhline(joint.upper, ls="--", color="0.4")
    right.annotate("limit of the joint", (0.0, joint.upper), (4, 4), textcoords="offset points", color="0.3")
    right.set(xlabel="time [s]", ylabel=f"{joint.name} [rad]", ylim=(-0.85, 0.05))
    right.set_title("asked to go beyond its limit", fontsize=10)
    for ax, where in ((left, "upper right"), (right, "lower right")):
        ax.legend(frameon=False, loc=where)
        frame(ax, "y")
    figure.savefig(PICTURES / "control.png", dpi=110, metadata={"Software": None})
    return PICTURES / "control.png"


def motors() -> Path:
    """The plot of docs/reference/motors.md: a link swings up as fast as its motor's torque-speed line lets it."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    arm = arm.with_motors({"joint_1": rbd.Motor(torque_speed=[(0.0, 10.0), (5.0, 10.0), (10.0, 0.0)])})
    task = rbd.control.PostureTask(arm.at([2.5]).q, gain=400.0)
    controller = rbd.control.WholeBodyController([task], limits=rbd.control.Limits(position=False, velocity=False))
    run = rbd.simulate(arm.at([0.0]), controller=controller, duration=1.0, step=2e-3, progress=False)
    figure = Figure(figsize=(8.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    speeds = np.linspace(-12.0, 12.0, 481)[:, None]
    least, most = arm.torque_limits(speeds)
    left.fill_between(speeds[:, 0], least[:, 0], most[:, 0], color="0.9", lw=0)
    left.plot(run.v[:, 0], run.tau[:, 0], color="#0072b2", lw=2.0)
    left.plot(run.v[0], run.tau[0], "o", color="#0072b2")
    for x, y, words in ((1.0, 4.5, "drives"), (1.0, -5.5, "brakes"), (-5.0, 4.5, "brakes"), (-5.0, -5.5, "drives")):
        left.text(x, y, words, color="0.35", fontsize=9)
    left.set(xlabel="speed of the joint [rad/s]", ylabel="torque [N m]")
    left.set_title("grey: what the motor has", fontsize=10)
    rbd.visual.plot_joint(right, run, "joint_1", what="tau")
    frame(left, "y")
    figure.savefig(PICTURES / "motors.png", dpi=110, metadata={"Software": None})
    return PICTURES / "motors.png"


def mechanisms() -> Path:
    """The models of `urdf/` with loops and wheels, each with all its branches, three in a row, with captions."""
    width, height, caption = 560, 440, 54
    sheet = Image.new("RGB", (3 * width, 3 * (height + caption)), "white")
    pen = ImageDraw.Draw(sheet)
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        for i, name in enumerate(MECHANISMS):
            robot = rbd.load_robot(TOP / "urdf" / f"{name}.urdf")
            posture = next(iter(robot.postures), None)
            report = report_mechanism(robot, robot.at().q if posture is None else robot.at(posture).q)
            with Scene(robot, legend=False) as scene:
                scene.show(report.state)
                scene.beside(report.poses(), shown=report.shown)
                shot = scene.screenshot(Path(folder) / f"{name}.png", width=width, height=height, browser=browser)
            x, y = width * (i % 3), (height + caption) * (i // 3)
            with Image.open(shot) as picture:
                sheet.paste(picture.resize((width, height)), (x, y))
            pen.text((x + 16, y + height + 6), name, font=_font(20), fill="#1f2933")
            pen.text((x + 16, y + height + 30), _what_it_shows(report), font=_font(15), fill="#5b6770")
    sheet.save(PICTURES / "mechanisms.png")
    return PICTURES / "mechanisms.png"


def _font(size: int) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which travels with Matplotlib."""
    return ImageFont.truetype(findfont("DejaVu Sans"), size)


def _what_it_shows(report: MechanismReport) -> str:
    """Degrees of freedom, and how many branches are drawn for which joint angles."""
    m = report.mobility
    if report.branches is None or len(report.branches) < 2:
        free = "degrees of freedom" + (" of velocity" if m.velocity_only else "")
        return f"{m.finite} {free}, {m.velocities} coordinates" if m.velocity_only else f"{m.finite} {free}"
    fixed = report.verdict[1].split(" with ")[1].split(";")[0]
    return f"{len(report.branches)} branches with {fixed}".replace("_joint", "").replace(" deg", "\N{DEGREE SIGN}")


def motion_checks() -> Path:
    """The page of a data set: G1 leans at four speeds, slides, hovers on one foot, and stands on tilted soles."""
    rng = np.random.default_rng(0)
    g1, lean = rbd.load_robot("g1"), scenes.lean(0.6)
    ankles = [g1.joints[f"{side}_ankle_pitch_joint"].q.start for side in ("left", "right")]
    leg = [g1.joints[f"right_{name}_joint"].q.start for name in ("hip_pitch", "knee", "ankle_pitch")]
    made = {f"lean_at_{speed:g}": scenes.lean(speed) for speed in (0.6, 1.0, 1.7, 3.0)}
    for name, where, by in (
        *((f"tilt_{degrees}", ankles, np.deg2rad(degrees)) for degrees in (2, 4, 6, 9)),
        *((f"hover_{bend}", leg, 0.01 * bend * np.array([-1.0, 2.0, -1.0])) for bend in (4, 6, 8)),
        *((f"slip_{speed}", [0], 1e-3 * speed * lean.t[:, None]) for speed in (10, 40)),
        *((f"noise_{size}", np.arange(7, g1.nq), 1e-3 * size * rng.standard_normal((lean.n, g1.nq - 7))) for size in (1, 3)),
    ):
        q = lean.q.copy()
        q[:, where] += by
        made[name] = rbd.Motion.of_arrays(g1, lean.t, q)
    with tempfile.TemporaryDirectory() as folder:
        for name, motion in made.items():
            motion.save(Path(folder) / f"{name}.npz")
        page = rbd.studies.check_motions(folder, robot=g1, workers=0).export(Path(folder) / "report", pages=6)
        return screenshot(page, PICTURES / "motion_checks.png", width=1180, height=880)


def robots() -> Path:
    """The contact sheet: nine robots at rest on their feet, with the forces that carry them."""
    return contact_sheet(STANDING, PICTURES / "robots.png")


MAKERS: dict[str, Callable[[], Path]] = {
    "talos": partial(scene, "talos", 1100, 900),
    "hand_on_a_wall": partial(scene, "hand_on_a_wall", 1000, 820),
    "motion_check": partial(scene, "motion_check", 1200, 720),
    "motion_checks": motion_checks,
    "repaired_motion": partial(scene, "repaired_motion", 1200, 720),
    "four_bar": partial(scene, "four_bar", 900, 640),
    "double_pendulum": partial(scene, "double_pendulum", 900, 640),
    "standing": partial(example_page, "standing", "01_stand", 900, 760),
    "walker": partial(example_page, "walker", "03_your_own_robot", 900, 760),
    "fists": partial(example_page, "fists", "05_moving_and_body_contacts", 1100, 900),
    "infeasible_stance": partial(example_page, "infeasible_stance", "09_infeasible_stance", 900, 760),
    "unicycle": partial(example_page, "unicycle", "12_unicycle", 900, 640),
    "impossible_motion": partial(example_page, "impossible_motion", "26_is_this_motion_possible", 1200, 720),
    "crouch": partial(drawn, "crouch", "25_torques_of_a_crouch", 770, 462),
    "identification": partial(drawn, "identification", "35_identify", 770, 616),
    "models_in_memory": partial(drawn, "models_in_memory", "32_models_in_memory", 990, 374),
    "painleve": partial(drawn, "painleve", "06_painleve", 770, 462),
    "weave": partial(scene, "weave", 900, 700),
    "bicycle": partial(drawn, "bicycle", "34_bicycle", 1000, 450),
    "push_samples": partial(scene, "push_samples", 1200, 720),
    "push_study": partial(drawn, "push_study", "30_push_study", 1050, 440),
    "balance": partial(drawn, "balance", "29_balance", 880, 506),
    "learning": partial(drawn, "learning", "38_learning_to_stand", 880, 453),
    "shakers": partial(drawn, "shakers", "36_shakers", 880, 500),
    "springs": partial(drawn, "springs", "31_springs", 880, 440),
    "polar_manipulator": partial(drawn, "polar_manipulator", "20_polar_manipulator", 495, 550),
    "push": partial(plot, "push", "02_push", "plot_push", (7.0, 4.2)),
    "two_laws": partial(plot, "two_laws", "04_two_laws", "plot_laws", (8.6, 3.8), 1, 2),
    "sensitivities": partial(plot, "sensitivities", "07_sensitivities", "plot_sensitivity", (7.0, 4.2)),
    "unique": partial(plot, "unique", "08_what_is_unique", "draw", (8.0, 6.4), 2, sharex=True),
    "slider_crank": partial(plot, "slider_crank", "11_slider_crank", "plot_turn", (7.0, 6.0), 3, 1, sharex=True),
    "sleigh": partial(plot, "sleigh", "13_sleigh", "plot_flow", (6.4, 5.0)),
    "push_recovery": partial(plot, "push_recovery", "14_push_recovery", "plot_pushes", (7.5, 6.0), 2, 1),
    "four_bar_swing": partial(plot, "four_bar_swing", "15_four_bar_swing", "plot_swing", (7.0, 6.0), 2, 1),
    "passive_walker": partial(plot, "passive_walker", "33_passive_walker", "plot_walk", (7.0, 9.0), 3, 1),
    "coin": partial(plot, "coin", "16_rolling_disk", "plot_lean", (7.0, 4.0)),
    "sliding_box": partial(plot, "sliding_box", "17_sliding_box", "plot_slide", (7.0, 6.0), 2, 1),
    **{
        f.__name__: f
        for f in (
            poses,
            where_it_can_stand,
            robust,
            motion_timing,
            inverse_dynamics,
            control,
            motors,
            mechanisms,
            robots,
            fall,
            coin_strip,
            tipping,
            balance_strip,
            springs_strip,
        )
    },
}
"""{picture: makes it}; those of the courses and tasks are in modules of their own."""
MODULES = (planar_pictures, planar_sketches, constraint_pictures, least_constraint_pictures, task_pictures, walk_pictures)


def chosen(names: list[str]) -> Iterator[Path]:
    """The pictures of these names, or all; a name of a module's function makes that function's."""
    if not names:
        yield from (make() for make in MAKERS.values())
        yield from itertools.chain.from_iterable(module.pictures() for module in MODULES)
    for name in names:
        found = [MAKERS[name]] if name in MAKERS else [vars(module)[name] for module in MODULES if name in vars(module)]
        if not found:
            raise SystemExit(f"no picture {name!r}; expected one of {', '.join(MAKERS)}, or a function of a module of pictures")
        made = found[0]()
        yield from [made] if isinstance(made, Path) else made


if __name__ == "__main__":
    for written in chosen(sys.argv[1:]):
        print(written.relative_to(TOP))
