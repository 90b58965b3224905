"""The pictures of docs/courses/least_constraint, as PNG files beside this script; `make.py` calls `pictures()`."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon
from PIL import Image

import rbd
from rbd.arrays import Array
from rbd.visual import motion_sheet
from rbd.visual.figures.plots import frame

PICTURES = Path(__file__).resolve().parent
LINK, GREY = "#24344d", "0.45"
FREE, TRUE, FORCE, OTHER = "#0072b2", "#24344d", "#d55e00", "#b8c0cc"
ANGLES = np.radians([60.0, -20.0])


def pictures() -> Iterator[Path]:
    """All of them."""
    yield two_masses()
    yield projection()
    yield multiplier()
    yield cones()
    yield free_and_held()


def two_masses() -> Path:
    """Two point masses on two rods, their angles, and the rail of the second mass."""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    ax = figure.subplots()
    points = np.vstack([np.zeros(2), np.cumsum(np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]), axis=0)])
    height = points[2, 1]
    ax.plot([-0.25, 2.1], [height, height], color=OTHER, lw=7.0, solid_capstyle="butt", zorder=1)
    ax.text(-0.25, height + 0.06, "rail, at height b", color=GREY)
    for i, (at, name) in enumerate(zip(points, ("$q_1$", "$q_2$"), strict=False)):
        angle = np.degrees(ANGLES[i])
        ax.plot([at[0], at[0] + 0.5], [at[1]] * 2, color=GREY, lw=1.0, ls=":")
        ax.add_patch(Arc(at, 0.6, 0.6, theta1=min(0.0, angle), theta2=max(0.0, angle), color=GREY))
        middle = 0.5 * ANGLES[i]
        ax.text(*(at + 0.4 * np.array([np.cos(middle), np.sin(middle)])), name, ha="center", va="center", fontsize=13)
    ax.plot(*points.T, color=LINK, lw=5.0, solid_joinstyle="round", zorder=3)
    ax.plot(0.0, 0.0, "o", color="white", mec=LINK, mew=1.8, ms=10.0, zorder=4)
    ax.plot(*points[1:].T, "o", color=LINK, ms=17.0, zorder=4)
    for at, name, shift in ((points[1], "$r_1$", (0.05, 0.11)), (points[2], "$r_2$", (0.1, -0.14))):
        ax.text(*(at + shift), name, ha="center", va="center", fontsize=13)
        ax.text(*at, "m", color="white", ha="center", va="center", fontsize=11, zorder=5)
    _arrow(ax, points[2] + [0.0, 0.07], points[2] + [0.0, 0.45], FORCE)
    ax.text(points[2, 0] + 0.06, height + 0.3, "f", color=FORCE, fontsize=13)
    ax.text(*(0.5 * points[1] + [-0.09, 0.05]), r"$\ell$", color=LINK, fontsize=13, ha="center", va="center")
    ax.text(*(0.5 * (points[1] + points[2]) + [0.1, -0.14]), r"$\ell$", color=LINK, fontsize=13, ha="center", va="center")
    ax.set(xlim=(-0.3, 2.15), ylim=(-0.2, 1.15), xlabel="x [m]", ylabel="height [m]", aspect="equal")
    frame(ax)
    return _save(figure, "two_masses")


def projection() -> Path:
    """Gauss's principle in the plane of two accelerations, and in coordinates in which the distance is Euclidean."""
    M, a_free, J, bias = _masses()
    a, _ = _nearest(M, a_free, J, bias)
    wrong, _ = _nearest(np.eye(2), a_free, J, bias)
    along = np.array([-J[1], J[0]]) / np.linalg.norm(J)
    line = a[:, None] + along[:, None] * np.array([-20.0, 20.0])
    upper = np.linalg.cholesky(M).T

    def line_at(x: float) -> tuple[float, float]:
        return x, float(a[1] + along[1] / along[0] * (x - a[0]))

    figure = Figure(figsize=(10.5, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.array([np.cos(turn), np.sin(turn)])
    radius = float(np.linalg.norm(upper @ (a - a_free)))
    for ax, place in ((left, lambda x: x), (right, lambda x: upper @ (x.T - a_free).T)):
        for share in (0.4, 0.7, 1.0, 1.3):
            ellipse = a_free[:, None] + np.linalg.solve(upper, share * radius * circle)
            style = {"color": FREE, "lw": 1.8} if share == 1.0 else {"color": FREE, "lw": 0.9, "alpha": 0.45}
            ax.plot(*place(ellipse), **style)
        ax.plot(*place(line), color=GREY, lw=2.0)
        _arrow(ax, place(a_free), place(a), FORCE)
        ax.plot(*place(a_free), "o", color=FREE, ms=9.0, zorder=5)
        ax.plot(*place(a), "o", color=TRUE, ms=9.0, zorder=5)
        frame(ax, "both")
        ax.set_aspect("equal")
    left.plot(*wrong, "o", color="white", mec=GREY, mew=1.6, ms=8.0, zorder=5)
    left.annotate("nearest without M", wrong, (4.0, 8.0), textcoords="offset points", color=GREY)
    left.annotate("$a_{free}$", a_free, (-8.0, -16.0), textcoords="offset points", color=FREE, fontsize=13, ha="right")
    left.annotate("$a$", a, (2.0, 10.0), textcoords="offset points", color=TRUE, fontsize=14)
    left.annotate(
        "$M^{-1}J^T f$", 0.5 * (a + a_free), (-10.0, 4.0), textcoords="offset points", color=FORCE, fontsize=13, ha="right"
    )
    left.annotate(
        r"$J a + \dot J v = 0$", line_at(9.0), (0.0, -18.0), textcoords="offset points", color=GREY, fontsize=12, ha="right"
    )
    left.set(xlim=(-13.0, 9.5), ylim=(-18.0, 7.0), xticks=range(-12, 9, 4), xlabel="$a_1$ [rad/s²]", ylabel="$a_2$ [rad/s²]")
    left.set_title("Accelerations of the two rods: distance by M", loc="left")
    end = upper @ (a - a_free)
    right.annotate("free motion, z = 0", (0.0, 0.0), (-6.0, -18.0), textcoords="offset points", color=FREE, ha="right")
    right.annotate("true motion", end, (10.0, 4.0), textcoords="offset points", color=TRUE)
    right.set(xlim=(-14.5, 14.5), ylim=(-14.5, 14.5), xlabel="$z_1$", ylabel="$z_2$")
    right.set_title("$z = L^T(a - a_{free})$ with $M = L L^T$: ordinary distance", loc="left")
    return _save(figure, "gauss_projection")


def multiplier() -> Path:
    """Gauss's function of the mass on the rail against the acceleration at which the rail gives way."""
    M, a_free, J, bias = _masses()
    free = float(J @ a_free + bias)
    inertia = 1.0 / float(J @ np.linalg.solve(M, J))
    force, least = -inertia * free, 0.5 * inertia * free**2
    y = np.linspace(-11.5, 4.0, 200)
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    ax = figure.subplots()
    ax.plot(y, 0.5 * inertia * (y - free) ** 2, color=FREE, lw=2.0)
    tangent = np.array([-4.6, 3.0])
    ax.plot(tangent, least + force * tangent, color=FORCE, lw=1.6)
    ax.plot(0.0, least, "o", color=TRUE, ms=9.0, zorder=5)
    ax.plot(free, 0.0, "o", color=FREE, ms=9.0, zorder=5, clip_on=False)
    ax.annotate(
        f"rail holds: slope f = {force:.1f} N", (0.0, least), (-12.0, 10.0), textcoords="offset points", color=FORCE, ha="right"
    )
    ax.annotate("free motion: f = 0", (free, 0.0), (14.0, 26.0), textcoords="offset points", color=FREE, ha="center")
    ax.axvline(0.0, color="0.6", lw=0.8, zorder=0)
    ax.set(xlim=(y[0], y[-1]), ylim=(0.0, 105.0), xlabel="row acceleration y at which the rail gives way [m/s²]")
    ax.set_ylabel("least Gauss function Z* [N m/s²]")
    frame(ax, "both")
    return _save(figure, "multiplier")


def cones() -> Path:
    """Friction cone and dual cone from the side; sections of the cone and of two pyramids from above."""
    mu = 0.6
    figure = Figure(figsize=(10.5, 4.6), layout="constrained")
    side, above = figure.subplots(1, 2)
    for slope, color, name, at in ((1.0 / mu, FORCE, "K, forces\n$|f_t| \\leq \\mu f_n$", (0.0, 1.05)), (mu, FREE, "", None)):
        x = min(1.5, 1.35 / slope)
        side.add_patch(
            Polygon([(0.0, 0.0), (-x, slope * x), (-x, 1.35), (x, 1.35), (x, slope * x)], color=color, alpha=0.16, lw=0.0)
        )
        side.plot([-x, 0.0, x], [slope * x, 0.0, slope * x], color=color, lw=2.0)
        if at is not None:
            side.text(*at, name, color=color, ha="center", va="center", fontsize=12)
    side.text(1.1, 1.05, "K*\naccelerations\n$y_n \\geq \\mu |y_t|$", color=FREE, ha="center", va="center", fontsize=10)
    edge = np.array([mu, 1.0]) / np.hypot(mu, 1.0)
    other = np.array([-1.0, mu]) / np.hypot(mu, 1.0)
    side.plot(*np.array([0.12 * edge, 0.12 * (edge + other), 0.12 * other]).T, color=GREY, lw=1.0)
    side.axhline(0.0, color="0.6", lw=1.0)
    side.set(xlim=(-1.55, 1.55), ylim=(-0.1, 1.4), aspect="equal")
    side.set(
        xlabel="tangential part, forces and accelerations to their own scales", ylabel="normal part", xticks=[0.0], yticks=[0.0]
    )
    side.set_title(f"Friction cone and its dual, μ = {mu}", loc="left")
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    above.fill(mu * np.cos(turn), mu * np.sin(turn), color=FORCE, alpha=0.16, lw=0.0)
    above.plot(mu * np.cos(turn), mu * np.sin(turn), color=FORCE, lw=2.0, label="circular cone")
    for facets, color, style in ((4, FREE, "-"), (8, TRUE, "--")):
        corners = rbd.problem.cones.pyramid(mu, facets)[:2].T
        above.plot(*np.vstack([corners, corners[:1]]).T, style, color=color, lw=1.6, label=f"pyramid, {facets} facets")
    above.set(
        xlim=(-1.0, 1.0),
        ylim=(-0.82, 1.12),
        aspect="equal",
        xticks=(-0.6, 0.0, 0.6),
        yticks=(-0.6, 0.0, 0.6),
        xlabel="$f_x / f_n$",
        ylabel="$f_y / f_n$",
    )
    above.set_title("Section at unit normal force", loc="left")
    above.legend(frameon=False, loc="upper left", ncols=3, fontsize=9)
    for ax in (side, above):
        frame(ax)
    return _save(figure, "cones")


def free_and_held() -> Path:
    """Talos without motor torques: falling freely, and with its soles held."""
    talos = rbd.load_robot("talos")
    state, times, size = talos.standing(), [0.0, 0.1, 0.2, 0.3], {"width": 300, "height": 360}
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, constraints in (("without constraints", []), ("soles held", talos.soles(friction=None))):
            way = rbd.simulate(state, constraints=constraints, duration=0.3, step=1e-3)
            sheet = motion_sheet(way, times, Path(folder) / f"{name}.png", follow=False, seen_from=(1.0, 0.6, 0.15), **size)
            with Image.open(sheet) as drawn:
                rows.append((name, np.asarray(drawn.convert("RGB"))))
    figure = Figure(figsize=(10.5, 7.2), layout="constrained")
    for ax, (name, row) in zip(figure.subplots(2, 1), rows, strict=True):
        ax.imshow(row)
        ax.set_title(name, loc="left")
        ax.set_axis_off()
    return _save(figure, "free_and_held")


def _masses() -> tuple[Array, Array, Array, float]:
    """(M, a_free, J, J_dot v) of the course's two masses of 1 kg on rods of 1 m."""
    sin, cos = np.sin(ANGLES), np.cos(ANGLES)
    v = np.array([1.0, -cos[0] / cos[1]])
    apart = ANGLES[0] - ANGLES[1]
    M = np.array([[2.0, np.cos(apart)], [np.cos(apart), 1.0]])
    rhs = -9.81 * np.array([2.0, 1.0]) * cos - np.sin(apart) * np.array([v[1] ** 2, -(v[0] ** 2)])
    return M, np.linalg.solve(M, rhs), cos, float(-sin @ v**2)


def _nearest(metric: Array, a_free: Array, J: Array, bias: float) -> tuple[Array, float]:
    """The point of J a + bias = 0 nearest to a_free in a metric, and the multiplier."""
    step = np.linalg.solve(metric, J)
    f = -float(J @ a_free + bias) / float(J @ step)
    return a_free + step * f, f


def _arrow(ax: Axes, start: Array, end: Array, color: str) -> None:
    ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 2.0, "mutation_scale": 16}, zorder=4)


def _save(figure: Figure, name: str) -> Path:
    figure.savefig(PICTURES / f"{name}.png", dpi=110, metadata={"Software": None})
    return PICTURES / f"{name}.png"
