"""Draws docs/pictures/architecture.png, and writes the table of rooms and sub-packages into docs/architecture.md.

python docs/pictures/architecture.py             both
python docs/pictures/architecture.py --check     exit code 1 where the page's table is not that of the code
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

TOP = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(TOP / "docs" / "site"))
from rbd_site.modules import first_line, packages  # noqa: E402

PAGE = TOP / "docs" / "architecture.md"
BEGIN, END = "<!-- rooms: made by docs/pictures/architecture.py -->\n", "<!-- end of the rooms -->\n"

ROOMS = [  # from the ground up, as tests/test_layers.py keeps them: (name, what it holds)
    [("errors", "errors and warnings"), ("arrays", "checked numbers"), ("installation, modules", "what is loaded")],
    [("model", "robot files, State, dynamics;\nPinocchio"), ("problem", "cones, rows, problem,\nresiduals; NumPy")],
    [("constraints", "contacts, loops, joints,\nwheels: rows of a State"), ("solvers", "problem to answer")],
    [("robots", "load_robot, postures,\nfeet"), ("answers", "solve, solve_many, certificates,\nuniqueness, derivatives")],
    [
        ("statics", "hold, least effort,\nsupport regions"),
        ("centroid", "motions of the\ncentre of mass"),
        ("robust", "all members\nof a set"),
    ],
    [("mechanism", "assemble, trace,\nmobility, small motion"), ("control", "inverse dynamics,\nwhole-body control, walking")],
    [("simulation", "simulate, Trajectory"), ("planar", "chains in symbols")],
    [("motion", "reference motions, repair, identification, measured forces")],
    [("audits", "forces of\nother engines"), ("planning", "motions over\ngiven contacts"), ("worlds", "many worlds\nat once")],
    [
        ("visual", "pages, plots"),
        ("studies", "samples,\ncomparisons"),
        ("envs", "Gymnasium"),
        ("testing", "checks of your\nown kinds"),
    ],
    [("cli", "the command rbd")],
]
WAYS = {
    "rbd.solve": [
        ("(robot, q, v)", "robots"),
        ("State: M, h, kinematics", "model.state"),
        ("Rows: J, bias, cone of each constraint", "constraints"),
        ("GaussProblem: M, rhs, rows", "problem.gauss_problem"),
        ("Answer: a, f", "solvers"),
        ("Residuals of the law, in N and m/s2", "problem.residuals"),
        ("Solution: forces, certificate", "answers.solution"),
    ],
    "rbd.simulate": [
        ("State at t", "model.state"),
        ("contact points: gap, J, cone", "constraints.contact_points"),
        ("velocity problem over the step h", "simulation.velocity_problem"),
        ("impulses of sticking, slipping points", "solvers.newton"),
        ("step; impacts at their own times", "simulation.time_step"),
        ("back onto loops and contacts", "mechanism.projection"),
        ("Trajectory: motion, forces, certificate", "simulation.trajectory"),
    ],
}
_EDGE, _FILL, _WAY = "#30507a", "#eaf1fa", "#fdf3e3"


def table() -> str:
    """A line for each room and sub-package: its name and the first line of its docstring."""
    lines = [f"| `{name}` | {first_line(folder / '__init__.py')} |" for name, folder in packages().items()]
    return "\n".join(["| room | contents |", "| --- | --- |", *lines]) + "\n"


def written() -> str:
    """The page with the table of today's code."""
    text = PAGE.read_text(encoding="utf-8")
    return text[: text.index(BEGIN) + len(BEGIN)] + "\n" + table() + "\n" + text[text.index(END) :]


def draw() -> Figure:
    """The sub-packages, lower ones below; beside them the way of the data through `solve` and `simulate`."""
    figure = Figure(figsize=(13.0, 8.6))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, 13), ylim=(0, 8.6))
    axes.axis("off")
    axes.text(2.9, 8.3, "sub-packages: each imports only those below it", ha="center", fontsize=11, weight="bold")
    height = 0.725
    for layer, rooms in enumerate(ROOMS):
        width, y = 5.5 / len(rooms), 0.25 + layer * height
        for i, (name, words) in enumerate(rooms):
            _box(axes, 0.15 + i * width, y, width - 0.1, height - 0.14, name, words, _FILL)
    for i, (verb, stops) in enumerate(WAYS.items()):
        x = 6.1 + 3.45 * i
        axes.text(x + 1.65, 8.3, f"flow of data through {verb}", ha="center", fontsize=11, weight="bold")
        for k, (record, module) in enumerate(stops):
            y = 7.25 - k * 1.1
            _box(axes, x, y, 3.3, 0.74, record, module, _WAY)
            if k:
                axes.annotate("", (x + 1.65, y + 0.76), (x + 1.65, y + 1.08), arrowprops={"arrowstyle": "-|>", "color": _EDGE})
    axes.text(7.75, 0.18, "no step changes the data of an earlier one", ha="center", fontsize=9, style="italic")
    axes.text(11.2, 0.18, "the next step begins at the top again", ha="center", fontsize=9, style="italic")
    return figure


def _box(axes: object, x: float, y: float, width: float, height: float, head: str, words: str, color: str) -> None:
    shape = FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.07", fc=color, ec=_EDGE, lw=1.0)
    axes.add_patch(shape)  # type: ignore[attr-defined]
    middle = x + width / 2
    axes.text(middle, y + height - 0.16, head, ha="center", va="center", fontsize=9.5, weight="bold")  # type: ignore[attr-defined]
    axes.text(middle, y + (height - 0.26) / 2, words, ha="center", va="center", fontsize=7.5, linespacing=1.05)  # type: ignore[attr-defined]


def main() -> int:
    """Write, or check."""
    if "--check" in sys.argv:
        return int(written() != PAGE.read_text(encoding="utf-8"))
    PAGE.write_text(written(), encoding="utf-8")
    draw().savefig(TOP / "docs" / "pictures" / "architecture.png", dpi=110, metadata={"Software": None})
    return 0


if __name__ == "__main__":
    sys.exit(main())
