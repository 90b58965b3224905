"""The pictures of docs/courses/velocity_constraints/, as PNG files beside this script; `make.py` calls `pictures()`."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import rbd
from rbd.visual.figures.plots import frame

PICTURES = Path(__file__).resolve().parent
INK, GREY = "#24344d", "0.45"
COLORS = ("#d55e00", "#0072b2", "#009e73", "0.55")
"""Of links 1 to 4."""


def pictures() -> Iterator[Path]:
    """All of them."""
    yield four_bar_loop()
    yield unicycle_from_above()
    yield four_bar_singular()
    yield four_bar_turn()
    yield driven_four_bar()


def closed(L, theta_1: float, theta_4: float, side: float) -> np.ndarray:
    """The four angles of a loop [rad]: theta_2 = sigma + side alpha."""
    span = -L[0] * np.exp(1j * theta_1) - L[3] * np.exp(1j * theta_4)
    s, sigma = np.abs(span), np.angle(span)
    cosine = np.clip((L[1] ** 2 + s**2 - L[2] ** 2) / (2.0 * L[1] * s), -1.0, 1.0)
    theta_2 = sigma + side * np.arccos(cosine)
    return np.array([theta_1, theta_2, np.angle(span - L[1] * np.exp(1j * theta_2)), theta_4])


def four_bar_loop() -> Path:
    """A loop with its absolute angles; the open and the folded branch of the rhombus of the text."""
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    general, opened, folded = figure.subplots(1, 3, width_ratios=(1.5, 1.25, 1.0))
    L = np.array([1.0, 2.2, 1.7, 2.2])
    theta = closed(L, np.radians(65.0), np.pi, 1.0)
    _loop(general, L, theta, angles=True)
    general.set_title("Absolute angles, each from x", loc="left", fontsize=10)
    for ax, side, title in ((opened, -1.0, "Open: 30°, 180°, 210°, 0°"),
                            (folded, 1.0, "Folded: 30°, 210°, 180°, 0°")):  # fmt: skip
        _loop(ax, np.ones(4), closed(np.ones(4), np.radians(30.0), 0.0, side), apart=0.07 if side > 0.0 else 0.0)
        ax.set_title(title, loc="left", fontsize=10)
    return _save(figure, "four_bar_loop")


def unicycle_from_above() -> Path:
    """A unicycle from above with forward and sideways; forward, turn, back, turn back from above."""
    figure = Figure(figsize=(9.0, 3.9), layout="constrained")
    one, moves = figure.subplots(1, 2)
    heading = np.radians(35.0)
    e, n = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    at = np.array([1.1, 0.75])
    _wheel(one, at, heading, INK, 0.34)
    _arrow(one, at, 0.85 * e, COLORS[2], "forward\n$(\\cos\\theta, \\sin\\theta)$", (0.08, 0.06))
    _arrow(one, at, 0.7 * n, COLORS[0], "sideways\n$(-\\sin\\theta, \\cos\\theta)$", (-0.05, 0.06))
    one.text(*(at + 0.42 * n + (-0.3, -0.18)), "no velocity\nalong it", color=COLORS[0], ha="center", va="center", fontsize=9)
    one.plot([at[0], at[0] + 0.75], [at[1], at[1]], color=GREY, lw=1.0, ls=":")
    around = np.linspace(0.0, heading, 30)
    one.plot(at[0] + 0.5 * np.cos(around), at[1] + 0.5 * np.sin(around), color=GREY, lw=1.2)
    one.text(at[0] + 0.6, at[1] + 0.16, "$\\theta$", fontsize=13)
    one.plot([at[0], at[0], 0.0], [0.0, at[1], at[1]], color=GREY, lw=1.0, ls=":")
    one.text(at[0], -0.04, "$x$", ha="center", va="top", fontsize=13)
    one.text(-0.04, at[1], "$y$", ha="right", va="center", fontsize=13)
    for end in ((2.4, 0.0), (0.0, 1.75)):
        one.annotate("", xy=end, xytext=(0.0, 0.0), arrowprops={"arrowstyle": "-|>", "color": "0.3", "lw": 1.2})
    one.set(xlim=(-0.2, 2.5), ylim=(-0.2, 1.85))
    one.set_title("Configuration $(x, y, \\theta)$, from above", loc="left")

    step = 0.6
    far = np.array([step, 0.0])
    last = far - step * np.array([np.cos(step), np.sin(step)])
    ends = ((np.zeros(2), 0.0), (far, 0.0), (far, step), (last, step), (last, 0.0))
    shades = ("0.7", "0.7", "0.7", "0.7", INK)
    shifts = ((-0.01, 0.07, "start"), (0.05, -0.09, "1 forward"), (0.06, 0.11, "2 turn left"), (-0.02, 0.09, "3 backward"),
              (-0.02, -0.1, "4 turn right: end"))  # fmt: skip
    for (p, angle), color, (dx, dy, name) in zip(ends, shades, shifts, strict=True):
        _wheel(moves, p, angle, color, 0.09)
        moves.text(p[0] + dx, p[1] + dy, name, ha="center", va="center", fontsize=9, color=GREY if color != INK else INK)
    moves.plot(*np.array([ends[0][0], far]).T, color=COLORS[2], lw=1.8)
    moves.plot(*np.array([far, last]).T, color=COLORS[1], lw=1.8)
    drop = {"arrowstyle": "-|>", "color": COLORS[0], "lw": 2.2, "mutation_scale": 16, "shrinkA": 0.0, "shrinkB": 0.0}
    moves.annotate("", xy=(-0.17, last[1]), xytext=(-0.17, 0.0), arrowprops=drop)
    moves.text(
        -0.19, 0.5 * last[1], "sideways\nby about $\\varepsilon^2$", color=COLORS[0], ha="right", va="center", fontsize=10
    )
    moves.set(xlim=(-0.5, 0.85), ylim=(-0.52, 0.22))
    moves.set_title(f"Four moves of $\\varepsilon$ = {step} (m, rad)", loc="left")
    for ax in (one, moves):
        ax.set_aspect("equal")
        ax.set_axis_off()
    return _save(figure, "unicycle_from_above")


def four_bar_singular() -> Path:
    """Link 1 at the end of its range, and det J2 over the angle of link 1."""
    figure = Figure(figsize=(9.4, 4.2), layout="constrained")
    pose, plot = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    L = np.array([1.2, 0.8, 0.9, 1.4])
    limit = np.arccos(-((L[1] + L[2]) ** 2 - L[0] ** 2 - L[3] ** 2) / (2.0 * L[0] * L[3]))
    _loop(pose, L, closed(L, limit, np.pi, 1.0))
    pose.set_title(f"Links 2 and 3 in line: link 1 at its limit, {np.degrees(limit):.1f}°", loc="left", fontsize=10)
    cases = (((40.0, 120.0, 80.0, 100.0), "40, 120, 80, 100", COLORS[1]), (tuple(L), "1.2, 0.8, 0.9, 1.4", COLORS[0]),
             ((1.0, 1.0, 1.0, 1.0), "1, 1, 1, 1", COLORS[2]))  # fmt: skip
    for lengths, name, color in cases:
        size = np.array(lengths)
        reach = limit if size[0] == 1.2 else np.pi
        crank = np.linspace(-reach, reach, 400)
        for side, style in ((1.0, "-"), (-1.0, "--")):
            theta = np.array([closed(size, t, np.pi, side) for t in crank])
            label = f"{name}" if side > 0.0 else None
            plot.plot(np.degrees(crank), np.sin(theta[:, 2] - theta[:, 1]), style, color=color, label=label, lw=1.8)
    plot.axhline(0.0, color="0.4", lw=0.9)
    plot.set_ylabel("$\\det J_2\\, /\\, (L_2 L_3) = \\sin(\\theta_3 - \\theta_2)$")
    plot.set(xlabel="$\\theta_1$, ground at $\\theta_4$ = 180° [deg]", xlim=(-180, 180),
             ylim=(-1.1, 1.45), xticks=range(-180, 181, 60))  # fmt: skip
    plot.legend(
        frameon=False, loc="upper center", ncols=3, title="lengths of links 1 to 4; the other branch dashed", fontsize=9
    )
    frame(plot, "both")
    return _save(figure, "four_bar_singular")


def four_bar_turn() -> Path:
    """Angles, rates, transmission angle and a coupler curve over a turn of link 1."""
    bars = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0)
    turn = rbd.mechanism.trace(bars.at("assembled"), joint="crank_joint", values=(0.0, 2.0 * np.pi), steps=360)
    figure = Figure(figsize=(9.2, 6.8), layout="constrained")
    turn.plot(figure.subplots(2, 2), frame="coupler", offset=(0.6, 0.0, 0.3))
    return _save(figure, "four_bar_turn")


def driven_four_bar() -> Path:
    """Rates, det J2 and torque of a four-bar whose crank turns once at 3 rad/s."""
    bars, first = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0, crank_angle=np.radians(40.0)), np.radians(40.0)
    drive = rbd.DrivenJoint("drive", "crank_joint", rbd.Speed(3.0, start=first))
    start = rbd.mechanism.project_velocity(bars.at("assembled"), [drive])
    turn = rbd.simulate(start, [drive], duration=2.0 * np.pi / 3.0, step=2.0 * np.pi / 3.0 / 360)
    states = [turn.state(i) for i in range(len(turn))]
    rates = [rbd.mechanism.link_rates(state) for state in states]
    figure = Figure(figsize=(7.0, 6.4), layout="constrained")
    top, middle, bottom = figure.subplots(3, sharex=True)
    for link, number, color in (("coupler", 2, COLORS[1]), ("rocker", 3, COLORS[2])):
        top.plot(turn.t, [rate[link] for rate in rates], color=color, label=f"link {number}")
    top.legend(frameon=False, ncols=2)
    top.set_ylabel("rate [rad/s]")
    middle.plot(turn.t, [rbd.mechanism.link_jacobians(state, known=["crank"]).determinant for state in states], color=INK)
    middle.set_ylabel("$\\det J_2$ [m$^2$]")
    bottom.plot(turn.t, turn.forces["drive"][:, 0], color=COLORS[0])
    bottom.set(ylabel="torque [N m]", xlabel="time [s]", xlim=(0.0, turn.t[-1]))
    for ax in (top, middle, bottom):
        ax.axhline(0.0, color=GREY, lw=0.8)
        frame(ax, "both")
    return _save(figure, "driven_four_bar")


def _loop(ax: Axes, L, theta, *, angles: bool = False, apart: float = 0.0) -> None:
    """Four links as arrows, and pins; `apart` draws links 2 and 3 aside where they would hide others."""
    corners = np.concatenate([[0.0], np.cumsum(L * np.exp(1j * np.array(theta)))])
    size = float(L.max())
    for i in range(4):
        aside = apart * 1j * np.exp(1j * theta[i]) if i in (1, 2) else 0.0
        a, b = corners[i] + aside, corners[i + 1] + aside
        style = {"arrowstyle": "-|>", "color": COLORS[i], "lw": 4.0, "mutation_scale": 20, "shrinkA": 0.0, "shrinkB": 2.0}
        ax.annotate("", xy=(b.real, b.imag), xytext=(a.real, a.imag), arrowprops=style, zorder=3)
        normal = 1j * np.exp(1j * theta[i])
        out = ((0.5 * (a + b) - corners[:4].mean()) * np.conj(normal)).real > 0.0
        outward = out or apart > 0.0
        middle = 0.5 * (a + b) + (0.12 if outward else -0.12) * size * normal
        ax.text(middle.real, middle.imag, f"$L_{i + 1}$", color=COLORS[i], ha="center", va="center", fontsize=13)
        if angles:
            radius = 0.2 * size
            around = np.linspace(0.0, theta[i] % (2.0 * np.pi), 60)
            ax.plot([a.real, a.real + 1.5 * radius], [a.imag, a.imag], color=GREY, lw=1.0, ls=":")
            ax.plot(a.real + radius * np.cos(around), a.imag + radius * np.sin(around), color=COLORS[i], lw=1.2)
            away = a + (1.9 if around[-1] < 0.5 else 1.45) * radius * np.exp(0.3j * around[-1])
            ax.text(away.real, away.imag, f"$\\theta_{i + 1}$", color=COLORS[i], ha="center", va="center", fontsize=12)
    ax.plot(corners[:4].real, corners[:4].imag, "o", color="white", mec=INK, mew=1.6, ms=8.0, zorder=4)
    ax.set_aspect("equal")
    ax.set_axis_off()
    room = (0.36 if angles else 0.22) * size
    ax.set(xlim=(corners.real.min() - room, corners.real.max() + room + (0.12 * size if angles else 0.0)),
           ylim=(corners.imag.min() - room, corners.imag.max() + room))  # fmt: skip


def _wheel(ax: Axes, at, heading: float, color: str, half: float) -> None:
    """A wheel from above: a thick bar, and a dot where it touches."""
    e = half * np.array([np.cos(heading), np.sin(heading)])
    ax.plot(*np.array([at - e, at + e]).T, color=color, lw=9.0, solid_capstyle="round", zorder=3)
    ax.plot(*at, "o", color="white", ms=4.0, zorder=4)


def _arrow(ax: Axes, at, vector, color: str, name: str, shift: tuple[float, float]) -> None:
    style = {"arrowstyle": "-|>", "color": color, "lw": 2.4, "mutation_scale": 18, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", xy=np.add(at, vector), xytext=at, arrowprops=style, zorder=5)
    ax.text(*(np.add(at, vector) + shift), name, color=color, ha="center", va="bottom", fontsize=10)


def _save(figure: Figure, name: str) -> Path:
    figure.savefig(PICTURES / f"{name}.png", dpi=110, metadata={"Software": None})
    return PICTURES / f"{name}.png"


if __name__ == "__main__":
    for made in pictures():
        print(made.name)
