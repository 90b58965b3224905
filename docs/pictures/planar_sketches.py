"""Drawings in the course on planar chains, as PNG files beside this script: angles, velocities, problems 2 to 5."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from planar_strokes import GREY, LINK, OTHER, across, along, angle_mark, arrow, hinge, link, plane, save, turn

import rbd.planar
from rbd.visual.figures.planar_figures import plot_sticks

VELOCITY, TANGENTIAL, CENTRIPETAL, CORIOLIS = "#0072b2", "#009e73", "#d55e00", "#5e4fa2"
TRIANGLE, BRANCH = "#c0392b", "#e69f00"


def pictures() -> Iterator[Path]:
    """All of them."""
    yield from (freedom(), kinds(), one_link(), two_links(), triangle(), relative_velocity())
    yield from (problem_2(), problem_3(), problem_4(), problem_5())


def freedom() -> Path:
    """Degrees of freedom of a particle, a body, one link and two links."""
    figure = Figure(figsize=(8.4, 2.6), layout="constrained")
    particle, body, one, two = figure.subplots(1, 4)
    for ax in (particle, body):
        for axis, name in zip(_SPACE, ("x", "y", "z"), strict=True):
            arrow(ax, (0.0, 0.0), 1.05 * axis, GREY, width=1.2)
            ax.text(*(1.17 * axis), name, color=GREY, ha="center", va="center")
    at = np.array([0.55, 0.75, 0.7])
    _corner(particle, at)
    particle.plot(*(at @ _SPACE), "o", color=LINK, ms=11.0, zorder=5)
    _corner(body, at)
    _box(body, at, (0.34, 0.26, 0.26), 0.12)
    for axis in _SPACE:
        center = at @ _SPACE + 0.62 * axis / np.linalg.norm(axis)
        body.plot(*np.array([at @ _SPACE, center]).T, color=TANGENTIAL, lw=0.8, ls=":", zorder=5)
        turn(body, center, 0.085, -2.2, 2.4, TANGENTIAL)
    for ax, q in ((one, [0.7]), (two, [0.45, 0.85])):
        points = rbd.planar.Chain(len(q), lengths=[1.0 / len(q)] * len(q)).numeric.positions(q) * 1.15
        link(ax, points, LINK)
        _angles(ax, points, q)
        ax.set(xlim=(-0.2, 1.25), ylim=(-0.35, 1.15))
    for ax in (particle, body):
        ax.set(xlim=(-0.75, 1.45), ylim=(-0.6, 1.6))
    titles = ("particle: 3", "rigid body: 6", "one link: 1", "two links: 2")
    for ax, title in zip((particle, body, one, two), titles, strict=True):
        plane(ax, title, ground=ax in (one, two))
    return save(figure, "planar_freedom")


def kinds() -> Path:
    """An open serial chain, a branched one, and a closed one."""
    figure = Figure(figsize=(8.4, 2.9), layout="constrained")
    serial, branched, closed = figure.subplots(1, 3)
    points = rbd.planar.Chain(3, lengths=(0.5, 0.4, 0.3)).numeric.positions([1.1, -0.8, -0.6])
    link(serial, points, LINK)
    serial.text(0.07, -0.03, "base", color=GREY, va="top")
    serial.text(*(points[-1] + (0.08, 0.0)), "end point", color=GREY, va="center")
    arm = rbd.planar.Chain(2, lengths=(0.5, 0.35)).numeric.positions([1.0, -0.6])
    for bend in (0.75, 0.1, -0.5):
        finger = arm[-1] + np.cumsum([(0.0, 0.0), *(0.17 * np.array([along(0.4 + bend), along(0.4 + 1.4 * bend)]))], axis=0)
        link(branched, finger, LINK, width=4.0)
    link(branched, [*arm], LINK, last=False)
    branched.text(0.07, -0.03, "base", color=GREY, va="top")
    branched.text(*(arm[-1] + (0.36, 0.05)), "three ends", color=GREY, va="center")
    chain = rbd.planar.Chain(3, lengths=(0.4, 1.0, 0.7))
    q = rbd.planar.inverse(chain, (0.9, 0.0), start=np.radians([70.0, -50.0, -120.0])).q
    loop = chain.numeric.positions(q)
    link(closed, loop, LINK, last=False)
    for at in (loop[0], loop[-1]):
        hinge(closed, at)
    closed.text(0.45, -0.09, "the ground closes the loop", color=GREY, ha="center", va="top")
    limits = ((-0.2, 1.5), (-0.2, 1.5), (-0.4, 1.3))
    titles = ("open, serial", "open, branched", "closed")
    for ax, title, x in zip((serial, branched, closed), titles, limits, strict=True):
        ax.set(xlim=x, ylim=(-0.2, 1.1))
        plane(ax, title)
    return save(figure, "planar_kinds")


def one_link() -> Path:
    """One link: its coordinates, its velocity with the angular velocity, and the two parts of its acceleration."""
    figure = Figure(figsize=(8.8, 3.5), layout="constrained")
    where, fast, faster = figure.subplots(1, 3)
    angle, rate, acceleration = np.radians(40.0), 0.75, 0.9
    e, n = along(angle), across(angle)
    around = np.radians(np.linspace(-6.0, 96.0, 100))
    for ax in (where, fast, faster):
        ax.plot(np.cos(around), np.sin(around), color="0.8", lw=1.0, ls="--", zorder=1)
        link(ax, [(0.0, 0.0), e], LINK)
        ax.set(xlim=(-0.3, 1.45), ylim=(-0.3, 1.3))
    angle_mark(where, (0.0, 0.0), 0.0, angle, 0.28, "$\\theta$")
    where.text(*(0.5 * e + 0.07 * n), "$\\ell$", color=LINK, ha="center", va="center", fontsize=13)
    where.plot([e[0], e[0], 0.0], [0.0, e[1], e[1]], color=GREY, lw=1.0, ls=":", zorder=2)
    where.text(e[0], -0.05, "$x_P$", ha="center", va="top", fontsize=12)
    where.text(-0.04, e[1], "$y_P$", ha="right", va="center", fontsize=12)
    where.text(*(e + (0.06, 0.0)), "P", va="center", fontsize=12)
    where.plot([0.0, 0.0], [0.0, 1.15], color="0.6", lw=1.0, zorder=1)
    for shown, name, far in ((e, "$\\mathbf{e}$", 0.32), (n, "$\\mathbf{n}$", 0.32)):
        arrow(where, e, far * shown, GREY, width=1.6)
        where.text(*(e + (far + 0.07) * shown), name, color=GREY, ha="center", va="center", fontsize=12)
    arrow(fast, e, rate * n, VELOCITY, "$\\mathbf{v} = \\ell\\dot\\theta\\,\\mathbf{n}$", (-0.02, 0.03))
    turn(fast, (0.0, 0.0), 0.2, 0.0, 2.2, VELOCITY)
    fast.text(0.02, 0.24, "$\\dot\\theta$", color=VELOCITY, ha="center", fontsize=13)
    fast.plot(-0.12, -0.16, "o", color="white", mec=VELOCITY, mew=1.6, ms=13.0, zorder=5)
    fast.plot(-0.12, -0.16, "o", color=VELOCITY, ms=4.0, zorder=6)
    fast.text(-0.03, -0.16, "$\\mathbf{\\omega} = \\dot\\theta\\,\\hat\\mathbf{k}$, towards you", color=VELOCITY, va="center")
    tangential, centripetal = 0.55 * acceleration * n, -0.5 * e
    whole = tangential + centripetal
    for part in (tangential, centripetal):
        faster.plot(*np.array([e + part, e + whole]).T, color="0.7", lw=1.0, ls=":", zorder=2)
    arrow(faster, e, tangential, TANGENTIAL, "tangential\n$\\ell\\ddot\\theta\\,\\mathbf{n}$", (0.18, 0.06))
    arrow(faster, e, centripetal, CENTRIPETAL, "centripetal\n$-\\ell\\dot\\theta^2\\,\\mathbf{e}$", (0.42, -0.17))
    arrow(faster, e, whole, "0.2", "$\\mathbf{a}$", (-0.06, 0.0))
    for ax, title in ((where, "position"), (fast, "velocity"), (faster, "acceleration")):
        plane(ax, title)
    return save(figure, "planar_one_link")


def two_links() -> Path:
    """Two links with joint angles and the angle of the second segment."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    ax = figure.subplots()
    _two_links(ax, np.radians([25.0, 50.0]), joints=True, segments=True)
    points = rbd.planar.Chain(2, lengths=(0.6, 0.5)).numeric.positions(np.radians([25.0, 50.0]))
    for k, name in enumerate(("joint 1, the base", "joint 2", "P, the end point")):
        ax.text(
            *(points[k] + ((-0.03, -0.05), (-0.06, 0.06), (0.05, 0.02))[k]),
            name,
            color=GREY,
            ha=("left", "right", "left")[k],
            va=("top", "bottom", "bottom")[k],
        )
    ax.set(xlim=(-0.15, 1.15), ylim=(-0.16, 0.85))
    plane(ax, "")
    return save(figure, "planar_two_links")


def triangle() -> Path:
    """The right triangle with the angle phi, the angle of the cosine rule, and the other branch."""
    figure = Figure(figsize=(7.6, 5.2), layout="constrained")
    ax = figure.subplots()
    lengths, q = (0.6, 0.5), np.radians([18.0, 68.0])
    arm = rbd.planar.Chain(2, lengths=lengths)
    points = arm.numeric.positions(q)
    target = points[-1]
    mirrored = rbd.planar.inverse(arm, target, start=q + [1.0, -2.0]).q
    link(ax, arm.numeric.positions(mirrored), BRANCH, alpha=0.55)
    foot = (lengths[0] + lengths[1] * np.cos(q[1])) * along(q[0])
    ax.add_patch(Polygon([(0.0, 0.0), foot, target], closed=True, facecolor=TRIANGLE, alpha=0.09, zorder=0))
    ax.plot(*np.array([(0.0, 0.0), foot, target, (0.0, 0.0)]).T, color=TRIANGLE, lw=2.0, zorder=2)
    square = 0.035 * np.array([-along(q[0]), -along(q[0]) + across(q[0]), across(q[0])]) + foot
    ax.plot(*square.T, color=TRIANGLE, lw=1.2, zorder=2)
    link(ax, points, LINK)
    way = float(np.arctan2(target[1], target[0]))
    angle_mark(ax, (0.0, 0.0), 0.0, q[0], 0.36, "$\\theta_1$", far=1.14)
    angle_mark(ax, (0.0, 0.0), q[0], way, 0.26, "$\\phi$", color=TRIANGLE, far=1.22)
    angle_mark(ax, points[1], q[0], q.sum(), 0.12, "$\\theta_2$", far=1.5)
    angle_mark(ax, points[1], q.sum(), q[0] + np.pi, 0.09, "$\\pi - \\theta_2$", far=1.95)
    style = {"ha": "center", "va": "center", "fontsize": 12}
    ax.text(*(0.84 * points[1] - 0.05 * across(q[0])), "$\\ell_1$", color=LINK, **style)
    ax.text(*(0.42 * points[1] + 0.58 * target - 0.05 * across(q.sum())), "$\\ell_2$", color=LINK, **style)
    turned = {"rotation": np.degrees(q[0]), "color": TRIANGLE, **style}
    ax.text(*(0.5 * (points[1] + foot) - 0.05 * across(q[0])), "$\\ell_2\\cos\\theta_2$", **turned)
    ax.text(*(0.5 * (target + foot) + 0.1 * along(q[0])), "$\\ell_2\\sin\\theta_2$", color=TRIANGLE, **style)
    ax.text(*(0.58 * target + 0.045 * across(way)), "$r$", color=TRIANGLE, **style)
    ax.text(*(target + (0.03, 0.03)), "P", fontsize=12)
    elbow = arm.numeric.positions(mirrored)[1]
    ax.text(*(elbow + (-0.03, 0.03)), "the other branch,\n$\\theta_2' = -\\theta_2$", color="#a06c00", ha="right", va="bottom")
    ax.set(xlim=(-0.32, 1.15), ylim=(-0.1, 0.83))
    plane(ax, "")
    return save(figure, "planar_triangle")


def relative_velocity() -> Path:
    """Velocities that add from joint 2 to the end point; and the three parts of its acceleration."""
    figure = Figure(figsize=(8.4, 4.0), layout="constrained")
    fast, faster = figure.subplots(1, 2)
    arm, q, rates, second = rbd.planar.Chain(2, lengths=(0.6, 0.5)), np.radians([25.0, 50.0]), [0.5, 0.45], [0.6, -0.1]
    points = arm.numeric.positions(q)
    elbow, hand = arm.numeric.velocity(q, rates, 1), arm.numeric.velocity(q, rates)
    for ax in (fast, faster):
        link(ax, points, OTHER)
    arrow(fast, points[1], elbow, GREY, "$\\mathbf{v}_{\\rm joint\\,2}$", (0.0, 0.02))
    arrow(fast, points[2], elbow, GREY, "$\\mathbf{v}_{\\rm joint\\,2}$", (0.12, -0.08))
    arrow(fast, points[2] + elbow, hand - elbow, TANGENTIAL, "$\\mathbf{v}_{\\rm rel}$", (0.03, 0.03))
    arrow(fast, points[2], hand, VELOCITY, "$\\mathbf{v}$", -0.5 * hand + (-0.05, -0.09))
    fast.text(*(points[2] + (0.05, -0.02)), "P", va="top", fontsize=12)
    rates = [0.75, 0.6]
    parts, scale = arm.numeric.split(q, rates, second), 0.8
    at = points[2]
    for part, color, name, shift in (
        (parts.tangential, TANGENTIAL, "tangential $J\\,\\ddot\\theta$", (0.02, 0.03)),
        (parts.centripetal, CENTRIPETAL, "centripetal", (0.1, -0.09)),
        (parts.coriolis, CORIOLIS, "Coriolis", (-0.01, -0.08)),
    ):
        arrow(faster, at, scale * part, color)
        end = at + scale * part
        faster.plot(*np.array([points[1], points[2]]).T, color=OTHER, lw=1.0, zorder=1)
        faster.text(*(end + shift), name, color=color, ha="right" if color == CENTRIPETAL else "left", va="bottom", zorder=8)
    arrow(faster, at, scale * parts.total, "0.2", "$\\mathbf{a}$", (-0.05, 0.0))
    for ax, title in ((fast, "velocities add from joint to joint"), (faster, "three parts of the acceleration of P")):
        ax.set(xlim=(-0.15, 1.1), ylim=(-0.12, 1.3))
        plane(ax, title)
    return save(figure, "planar_relative_velocity")


def problem_2() -> Path:
    """The first joint held at zero, and the second one."""
    figure = Figure(figsize=(8.4, 3.7), layout="constrained")
    arm = rbd.planar.Chain(2, lengths=(0.6, 0.45))
    titles = (
        "a) first joint at 0: a circle\nof radius $\\ell_2$ about joint 2",
        "b) second joint at 0: a circle\nof radius $\\ell_1 + \\ell_2$ about the base",
    )
    for ax, held, title in zip(figure.subplots(1, 2), (0, 1), titles, strict=True):
        moving = 1 - held
        for angle in np.radians([0.0, 30.0, 60.0, 90.0]):
            points = arm.numeric.positions([0.0, angle] if held == 0 else [angle, 0.0])
            link(ax, points, LINK if angle == np.radians(60.0) else OTHER, front=angle == np.radians(60.0))
        center, radius = ((0.6, 0.0), 0.45) if held == 0 else ((0.0, 0.0), 1.05)
        around = np.radians(np.linspace(-12.0, 110.0, 100))
        ax.plot(center[0] + radius * np.cos(around), center[1] + radius * np.sin(around), color=CENTRIPETAL, lw=1.6, ls="--")
        angle = np.radians(60.0)
        angle_mark(ax, center, 0.0, angle, 0.2, f"$\\theta_{moving + 1}$", far=1.35)
        arrow(
            ax, np.add(center, radius * along(angle)), 0.3 * across(angle), VELOCITY, "$\\mathbf{v}$", (-0.03, 0.02), front=True
        )
        ax.set(xlim=(-0.35, 1.3), ylim=(-0.22, 1.22))
        plane(ax, title)
    return save(figure, "planar_problem_2")


def problem_3() -> Path:
    """The polar manipulator in five poses; its acceleration, and the parts that the free arm's formulas give there."""
    figure = Figure(figsize=(8.4, 4.6), layout="constrained")
    poses, parts = figure.subplots(1, 2)
    arm = rbd.planar.Chain(2, lengths=(0.5, 0.5))
    for angle in np.radians([15.0, 30.0, 45.0, 60.0, 75.0]):
        front = angle == np.radians(45.0)
        link(poses, arm.numeric.positions([angle, np.pi - 2.0 * angle]), LINK if front else OTHER, front=front)
    poses.plot([0.0, 0.0], [0.0, 1.1], color=CENTRIPETAL, lw=1.6, ls="--", zorder=1)
    angle = np.radians(45.0)
    points = arm.numeric.positions([angle, np.pi - 2.0 * angle])
    angle_mark(poses, (0.0, 0.0), 0.0, angle, 0.2, "$\\theta_1$", far=1.25)
    angle_mark(poses, points[1], angle, np.pi - angle, 0.1, "")
    poses.plot(*np.array([points[1], points[1] + 0.2 * along(angle)]).T, color=GREY, lw=1.0, ls=":")
    poses.text(*(points[1] + (0.02, 0.17)), "$\\theta_2 = \\pi - 2\\theta_1$", fontsize=12, zorder=8)
    poses.text(-0.03, 0.98, "path of P", color=CENTRIPETAL, ha="right")
    q, rate, scale = np.array([angle, np.pi - 2.0 * angle]), 1.0, 0.25
    free = arm.numeric.split(q, rate * np.array([1.0, -2.0]), np.zeros(2))
    at = points[2]
    link(parts, points, OTHER)
    parts.plot([0.0, 0.0], [0.0, 1.1], color="0.8", lw=1.2, ls="--", zorder=1)
    centripetal, coriolis = scale * free.centripetal, scale * free.coriolis
    arrow(parts, at, centripetal, CENTRIPETAL, "centripetal part\nof the free arm", (0.06, -0.02), ha="left")
    arrow(parts, at, coriolis, CORIOLIS, "Coriolis part of the free arm", (0.2, 0.03))
    arrow(parts, at, scale * free.total, "0.2", "their sum, along the line", (-0.03, -0.03), ha="right")
    for ax, title in ((poses, "P stays on the vertical"), (parts, "at constant $\\dot\\theta_1$")):
        ax.set(xlim=(-0.62, 0.72), ylim=(-0.12, 1.2))
        plane(ax, title)
    return save(figure, "planar_problem_3")


def problem_4() -> Path:
    """The pendulum's angles from the vertical, and its swing after release."""
    figure = Figure(figsize=(8.4, 4.2), layout="constrained")
    sketch, swing = figure.subplots(1, 2)
    pendulum = rbd.planar.Chain(2, lengths=(1.0, 1.0), angles="vertical")
    q = np.radians([28.0, 55.0])
    points = pendulum.numeric.positions(q)
    for k in (0, 1):
        sketch.plot(*np.array([points[k], points[k] - (0.0, 0.75)]).T, color=GREY, lw=1.0, ls=":", zorder=1)
        angle_mark(sketch, points[k], -np.pi / 2, q[k] - np.pi / 2, 0.45, f"$\\theta_{k + 1}$", far=1.2)
        middle, aside = 0.5 * (points[k] + points[k + 1]), across(q[k] - np.pi / 2)
        sketch.text(*(middle + 0.11 * aside), f"$\\ell_{k + 1}$", color=LINK, ha="center", va="center", fontsize=13)
    link(sketch, points, LINK)
    sketch.set(xlim=(-0.5, 1.7), ylim=(-1.75, 0.25))
    plane(sketch, "angles from the downward vertical")
    rods = rbd.planar.dynamics(pendulum, bodies="rods", masses=(1, 1), gravity=9.81)
    coordinates = rbd.planar.robot_coordinates(pendulum)
    way = rbd.simulate(rbd.planar.to_robot(rods).at(coordinates(np.radians([60.0, 60.0]))), duration=0.9, step=1e-3)
    plot_sticks(swing, pendulum, coordinates.inverse(way.q), count=10)
    swing.set_title("released at 60°, 0.1 s apart", loc="left")
    return save(figure, "planar_problem_4")


def problem_5() -> Path:
    """One pose, measured by joint angles and by segment angles."""
    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    for ax, segments in zip(figure.subplots(1, 2), (False, True), strict=True):
        _two_links(ax, np.radians([25.0, 50.0]), joints=not segments, segments=segments)
        ax.set(xlim=(-0.15, 1.15), ylim=(-0.12, 0.85))
        plane(ax, "segment angles, from x" if segments else "joint angles, from the link before")
    return save(figure, "planar_problem_5")


_SPACE = np.array([(-0.48, -0.38), (0.95, -0.06), (0.0, 1.0)])
"""Pictures of the unit vectors x, y, z in the drawings of space."""


def _corner(ax: Axes, at: np.ndarray) -> None:
    """Dotted lines from a point in space down to the ground and to its coordinates."""
    down = np.array([at[0], at[1], 0.0])
    for start, stop in ((at, down), (down, [at[0], 0.0, 0.0]), (down, [0.0, at[1], 0.0])):
        ax.plot(*(np.array([start, stop]) @ _SPACE).T, color=GREY, lw=1.0, ls=":", zorder=2)


def _box(ax: Axes, at: np.ndarray, half: tuple[float, float, float], angle: float) -> None:
    """The faces of a box that one sees, turned about z, in space."""
    seen_from = np.array([1.0, *np.linalg.solve(_SPACE[1:].T, -_SPACE[0])])
    turned = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    sides = turned * np.array(half)[:, None]
    for k, shade in enumerate(("#8fa0b8", "#6d7f99", "#b8c4d4")):
        outward = sides[k] * np.sign(sides[k] @ seen_from)
        first, second = np.delete(sides, k, axis=0)
        face = [at + outward + i * first + j * second for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        ax.add_patch(Polygon(np.array(face) @ _SPACE, closed=True, facecolor=shade, edgecolor=LINK, lw=1.6, zorder=4))


def _two_links(ax: Axes, q: np.ndarray, *, joints: bool, segments: bool) -> None:
    points = rbd.planar.Chain(2, lengths=(0.6, 0.5)).numeric.positions(q)
    link(ax, points, LINK)
    style = {"color": LINK, "ha": "center", "va": "center", "fontsize": 13}
    ax.text(*(0.6 * points[1] + (-0.02, 0.06)), "$\\ell_1$", **style)
    ax.text(*(0.45 * points[1] + 0.55 * points[2] + (-0.06, 0.02)), "$\\ell_2$", **style)
    if joints:
        ahead = points[1] + 0.3 * along(q[0])
        ax.plot(*np.array([points[1], ahead]).T, color=GREY, lw=1.0, ls=":")
        angle_mark(ax, points[0], 0.0, q[0], 0.3, "$\\theta_1$", far=1.17)
        angle_mark(ax, points[1], q[0], q.sum(), 0.16, "$\\theta_2$", far=1.35)
    if segments:
        ax.plot(*np.array([points[1], points[1] + (0.42, 0.0)]).T, color=TANGENTIAL, lw=1.0, ls=":")
        name = "$\\psi_2 = \\theta_1 + \\theta_2$" if joints else "$\\psi_2$"
        radius = 0.36 if joints else 0.2
        angle_mark(ax, points[1], 0.0, q.sum(), radius, name, color=TANGENTIAL, far=1.36 if joints else 1.3)
        if not joints:
            angle_mark(ax, points[0], 0.0, q[0], 0.3, "$\\psi_1$", color=TANGENTIAL, far=1.17)


def _angles(ax: Axes, points: np.ndarray, q: Sequence[float]) -> None:
    direction = 0.0
    for k, angle in enumerate(q):
        name = "$\\theta$" if len(q) == 1 else f"$\\theta_{k + 1}$"
        if k:
            ax.plot(*np.array([points[k], points[k] + 0.3 * along(direction)]).T, color=GREY, lw=1.0, ls=":")
        angle_mark(ax, points[k], direction, direction + angle, 0.26, name, far=1.35)
        direction += angle


if __name__ == "__main__":
    for made in pictures():
        print(made.name)
