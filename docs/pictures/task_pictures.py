"""The pictures of docs/tasks/*.md, drawn from what the code of each page computes; `make.py` calls `pictures()`."""

import contextlib
import html
import io
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from photographs import motion_sheet, screenshot

import rbd
from rbd.cli.app import app
from rbd.visual import Scene, notebook_page, plot_energy, plot_forces
from rbd.visual.figures.plots import frame

PICTURES = Path(__file__).resolve().parent
TASKS = PICTURES.parent / "tasks"
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "0.5"


def pictures() -> Iterator[Path]:
    """All of them."""
    makers = (task_walker, task_hold, task_wall, task_loop, task_sweep, task_many, task_forces, task_swing, task_figure)
    for make in (*makers, task_masses, task_command, task_reach, task_notebook, task_springs):
        yield make()


def computed(page: str) -> dict[str, Any]:
    """The names that the Python blocks of a task page leave behind."""
    text = (TASKS / f"{page}.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {"__name__": page}
    with contextlib.redirect_stdout(io.StringIO()):
        for block in re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
            exec(block, names)
    return names


def exported(page: Path, state: rbd.State, answer: Any = None, **shown: Any) -> Path:
    """A robot with the forces of an answer, as a page."""
    with Scene(state.robot) as drawn:
        drawn.show(state, answer, **shown)
        return drawn.export(page)


def photograph(write: Callable[[Path], Path], picture: str, height: int = 760) -> Path:
    """A picture of the page that this function writes."""
    with tempfile.TemporaryDirectory() as folder:
        return screenshot(write(Path(folder) / f"{picture}.html"), PICTURES / f"{picture}.png", width=1000, height=height)


def saved(drawn: Figure, picture: str) -> Path:
    """A plot as a file."""
    drawn.savefig(PICTURES / f"{picture}.png", dpi=110, metadata={"Software": None})
    return PICTURES / f"{picture}.png"


def walker_page(page: Path) -> Path:
    """The walker of `load_my_robot`, in the pose of `put_it_on_its_feet`, in 3-D."""
    names = computed("put_it_on_its_feet")
    return exported(page, names["state"], rbd.hold(names["state"], names["robot"].soles()))


def task_walker() -> Path:
    """A photograph of it."""
    return photograph(walker_page, "task_walker")


def task_hold() -> Path:
    """Talos on its left leg."""
    names = computed("hold_it")
    return photograph(lambda page: exported(page, names["pose"].state, names["hold"]), "task_hold")


def task_springs() -> Path:
    """Talos with a strap at its hand, a belt between its hands, and a spring in its knee."""
    names = computed("springs_and_dampers")
    shown = {"external": names["acting"]}
    return photograph(lambda page: exported(page, names["state"], names["held"], **shown), "task_springs")


def task_wall() -> Path:
    """Talos between the wall and the push."""
    names = computed("place_a_hand_on_a_wall")
    return photograph(lambda page: exported(page, names["state"], names["hold"], external=names["push"]), "task_wall")


def loop_page(page: Path) -> Path:
    """The four-bar in both of its branches, in 3-D."""
    names = computed("close_a_loop")
    four_bar, state = names["four_bar"], names["state"]
    found = rbd.mechanism.branches(state, [names["pin"]], fixed={"crank_joint": 0.7}).found
    others = {str(i): four_bar.at(branch.q) for i, branch in enumerate(found) if abs(branch.q - state.q).max() > 1e-3}
    view = {"legend": False, "ground": False, "seen_from": (0.25, -1.0, 0.2)}
    with Scene(four_bar, **view) as drawn:
        drawn.show(state, names["solution"])
        drawn.beside(others)
        return drawn.export(page)


def task_loop() -> Path:
    """A photograph of it."""
    return photograph(loop_page, "task_loop", height=560)


def task_sweep() -> Path:
    """The map of reasons that the page draws."""
    drawn = computed("sweep_a_parameter")["drawn"][0].figure
    drawn.set_size_inches(7.0, 4.2)
    return saved(drawn, "task_sweep")


def task_command() -> Path:
    """What the first command of the page draws."""
    text = (TASKS / "sweep_on_the_command_line.md").read_text(encoding="utf-8")
    command = re.findall(r"^rbd (stand .*) --png map.png$", text, flags=re.MULTILINE)[0]
    picture = PICTURES / "task_command.png"
    app([*command.split(), "--png", str(picture)], standalone_mode=False)
    return picture


def task_many() -> Path:
    """How hard the hardest motor works, over all poses."""
    names = computed("solve_thousands_of_states")
    drawn = Figure(figsize=(7.0, 3.6), layout="constrained")
    ax = drawn.subplots()
    ax.hist(names["share"], bins=40, color=BLUE)
    ax.set(xlabel="largest torque, of its limit [%]", ylabel=f"poses, of {names['n']}")
    frame(ax, "y")
    return saved(drawn, "task_many")


def task_masses() -> Path:
    """The torque of an elbow, measured, by the model and identified."""
    names = computed("find_masses_from_a_motion")
    found, moved, model, elbow = names["found"], names["moved"], names["model"], 2
    drawn = Figure(figsize=(8.0, 3.4), layout="constrained")
    ax = drawn.subplots()
    each = list(zip(moved.q, moved.v, moved.a, strict=True))
    for robot, color, style, label in ((model, ORANGE, "--", "by the model"), (found.robot(), BLUE, "-", "identified")):
        by = [rbd.dynamics.inverse_dynamics(rbd.State(robot, q, v), a)[elbow] for q, v, a in each]
        ax.plot(moved.t, by, style, color=color, label=label)
    ax.plot(moved.t[::3], names["tau"][::3, elbow], ".", color=GREY, markersize=7, label="measured", zorder=1)
    ax.set(xlabel="time [s]", ylabel="torque of the elbow [N m]")
    drawn.legend(*ax.get_legend_handles_labels(), frameon=False, ncols=3, loc="outside upper center")
    return saved(drawn, "task_masses")


def task_forces() -> Path:
    """The push as it is, as a low-pass of it, and as the observer sees it; and the loads of both soles."""
    names = computed("read_forces_from_data")
    record, seen = names["record"], names["seen"]
    drawn = Figure(figsize=(8.0, 5.2), layout="constrained")
    upper, lower = drawn.subplots(2, 1, sharex=True)
    pushed = np.where((record.t >= 0.05) & (record.t < 0.15), 25.0, 0.0)
    upper.plot(record.t, pushed, color=GREY, ls="--", label="push")
    upper.plot(record.t, seen.forces["torso"][:, 1], color=ORANGE, label="as the observer sees it")
    upper.legend(frameon=False)
    upper.set(ylabel="at the torso, to the left [N]")
    frame(upper, "y")
    for name, color in (("left_sole", BLUE), ("right_sole", "#009e73")):
        lower.plot(record.t, record.forces[name][:, 2], color=color, ls="--", alpha=0.5)
        lower.plot(record.t, seen.forces[name][:, 2], color=color, label=name)
    lower.legend(frameon=False)
    lower.set(xlabel="time [s]", ylabel="normal force [N]")
    frame(lower, "y")
    return saved(drawn, "task_forces")


def task_swing() -> Path:
    """The box on its rod, at equal distances of time."""
    path = computed("add_a_constraint")["swing"].q[:, (0, 2)]
    drawn = Figure(figsize=(7.0, 4.4), layout="constrained")
    ax = drawn.subplots()
    ax.plot(*path.T, color=BLUE, lw=1.0)
    for i, point in enumerate(path[:: (len(path) - 1) // 7]):
        ax.plot(*np.array([(0.0, 0.0), point]).T, color=GREY, lw=1.0, zorder=1)
        ax.add_patch(Rectangle(point - (0.1, 0.05), 0.2, 0.1, facecolor=BLUE, alpha=0.2 + 0.1 * i, lw=0.0))
    ax.plot(0.0, 0.0, "o", color="black")
    ax.set(xlabel="x [m]", ylabel="z [m]", aspect="equal", ylim=(-0.62, 0.04))
    ax.set_title("every 0.1 s, from pale to dark; the box at half its size", fontsize=10)
    frame(ax)
    return saved(drawn, "task_swing")


def task_reach() -> Path:
    """Talos at three times of its reach."""
    moved = computed("make_it_follow_tasks")["reaches"]
    return motion_sheet(moved, [0.0, 0.5, 1.5], PICTURES / "task_reach.png", width=330, height=480, seen_from=(1.0, 0.9, 0.25))


def task_figure() -> Path:
    """The plot that the page `export_a_figure` saves."""
    moved = computed("export_a_figure")["moved"]
    drawn = Figure(figsize=(8.0, 5.0), layout="constrained")
    upper, lower = drawn.subplots(2, 1, sharex=True)
    plot_forces(upper, moved)
    plot_energy(lower, moved)
    return saved(drawn, "task_figure")


def task_notebook() -> Path:
    """Three outputs of a notebook: what holds a robot, the scene, the largest pushes."""
    names = computed("use_it_in_a_notebook")
    state, soles, held = names["state"], names["soles"], names["held"]
    with Scene(state.robot) as scene, tempfile.TemporaryDirectory() as folder:
        scene.show(state, held)
        pushes = rbd.statics.push_limits(state, soles, "torso_2_link", ((1, 0, 0), (-1, 0, 0), (0, 1, 0)))
        cells = {
            "held": held._repr_html_(),
            "notebook_page(scene)": notebook_page(scene, still=True, height=380)._repr_html_(),
            'rbd.statics.push_limits(state, soles, "torso_2_link", ways)': pushes._repr_html_(),
        }
        style = "margin:10px 0;padding:6px 8px;background:#f3f4f6;border:1px solid #d5dbe1"
        shown = "".join(f"<pre style='{style}'>{html.escape(code)}</pre>{output}" for code, output in cells.items())
        page = Path(folder) / "notebook.html"
        body = "margin:16px 24px;font:14px/1.4 'DejaVu Sans',sans-serif"
        page.write_text(f'<!DOCTYPE html><meta charset="utf-8"><body style="{body}">{shown}', encoding="utf-8")
        return screenshot(page, PICTURES / "task_notebook.png", width=1000, height=1080)
