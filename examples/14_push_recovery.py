"""Pushed at the torso for a tenth of a second, does Talos stay on its soles, tip a foot and come back, or fall?

It stands on two soles with friction, its motors holding the posture (`rbd.control.HoldPosture`): torques that carry its weight,
and a spring and a damper at the joints. Three pushes to its left. Events tell which corner of which sole leaves, and when.

What could be done at best? Of a mass at height z over a centre of pressure p, y'' = (g / z) (y - p). With p at the outer edge
of the sole it comes back if y + y' sqrt(z / g) is inside, so an impulse up to m sqrt(g / z) (edge - y) could be answered
without a step; a controller that only holds a posture falls sooner.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

GRAVITY, FRICTION, START, LASTS = 9.81, 0.7, 0.1, 0.1  # the push starts at 0.1 s and lasts 0.1 s
PUSHES_N = (40.0, 80.0, 250.0)


@dataclass(frozen=True)
class Result:
    """The motions, by the size of the push, which sole's corners leave first, and what an ideal ankle could take."""

    ways: dict[float, rbd.Trajectory]
    lifts: dict[float, rbd.simulation.Event | None]
    ideal_N: float


def main(show: bool = True) -> Result:
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=FRICTION)
    hold = rbd.control.HoldPosture(state, soles)
    patch = soles[0].rows(state).patch
    edge_m = float((patch.point + patch.corners @ patch.axes.T)[:, 1].max() - state.com[1])
    ideal_N = talos.mass * np.sqrt(GRAVITY / state.com[2]) * edge_m / LASTS
    print(f"Talos, {talos.mass:.1f} kg, pushed to its left at the torso for {LASTS} s.")
    ways, lifts = {}, {}
    for force_N in PUSHES_N:
        given = {"controller": hold, "external": push(force_N), "progress": False}
        with warnings.catch_warnings():  # steps of 2 ms make 3 % of its energy where it falls; 0.3 ms would make 0.1 %
            warnings.simplefilter("ignore", rbd.errors.InaccurateWarning)
            ways[force_N] = way = rbd.simulate(state, soles, duration=1.0, step=2e-3, **given)
        lifts[force_N] = next((e for e in way.events if e.kind == "leaves"), None)
        print(f"{force_N:5.0f} N: {outcome(way, lifts[force_N])}")
    print(f"An ideal ankle could answer {ideal_N:.0f} N without a step.")
    small = ways[PUSHES_N[0]]
    residual, impulse = small.residuals["law"].max(), 100.0 * missing(small)
    print(f"At {PUSHES_N[0]:.0f} N the soles move by {moved(small):.0e} m; the law is met to {residual:.0e},")
    print(f"and the impulses of soles, weight and push make up the change of momentum to {impulse:.2f} %.")
    result = Result(ways, lifts, ideal_N)
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(7.5, 6.0), layout="constrained")
        plot_pushes(figure.subplots(2, 1), result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/14_push_recovery.png", dpi=150)
        page = ways[250.0].export("out/14_push_recovery.html", external=push(250.0))
        print(f"See out/14_push_recovery.png and {page}.")
    return result


def push(force_N: float) -> rbd.control.Push:
    return rbd.control.Push("torso_2_link", (0.0, force_N, 0.0), start=START, duration=LASTS)


def outcome(way: rbd.Trajectory, lift: rbd.simulation.Event | None) -> str:
    """What happened, in words."""
    sway_mm = 1e3 * np.abs(way.com[:, 1] - way.com[0, 1])
    if lift is None:
        return f"stays on both soles; sways by {sway_mm.max():.1f} mm, after 1 s by {sway_mm[-1]:.1f} mm."
    first = f"{lift.name} tips at {lift.t:.2f} s"
    if falls(way):
        return f"{first}, and it falls."
    back = max(e.t for e in way.events if e.kind == "touches")
    return f"{first}, is back at {back:.2f} s; sways by {sway_mm.max():.1f} mm, after 1 s by {sway_mm[-1]:.1f} mm."


def falls(way: rbd.Trajectory) -> bool:
    """Whether its middle has gone off by more than a decimetre at the end."""
    return bool(np.linalg.norm(way.com[-1] - way.com[0]) > 0.1)


def moved(way: rbd.Trajectory) -> float:
    """How far the centre of a sole goes [m]."""
    return max(float(np.abs(x - x[0]).max()) for x in way.points.values())


def missing(way: rbd.Trajectory) -> float:
    """Impulse of all recorded forces, less the change of momentum, over the push's impulse."""
    total = sum(force[:, :3] for force in way.forces.values()) + [0.0, 0.0, -way.robot.mass * GRAVITY]
    total[:, 1] += [PUSHES_N[0] if START <= t + 1e-9 < START + LASTS else 0.0 for t in way.t]
    impulse = np.diff(way.t) @ total[:-1]
    return float(np.abs(impulse - way.momentum[-1, :3] + way.momentum[0, :3]).max() / (PUSHES_N[0] * LASTS))


def plot_pushes(axes, result: Result) -> list:
    """Forces of the soles over time, of the push in the middle and of the one that fells it; returns the artists."""
    from rbd.visual import plot_forces

    artists = []
    for ax, force_N in zip(axes, PUSHES_N[1:], strict=True):
        artists += plot_forces(ax, result.ways[force_N])
        artists.append(ax.text(0.99, 0.8, f"pushed with {force_N:.0f} N", ha="right", transform=ax.transAxes))
    return artists


def check(result: Result) -> None:
    """Who stays, who comes back, who falls; laws and Newton's second."""
    small, middle, large = (result.ways[force_N] for force_N in PUSHES_N)
    assert not small.events and moved(small) < 1e-7 and small.residuals["law"].max() < 1e-8 and missing(small) < 0.01
    assert not falls(middle) and falls(large) and result.ideal_N > 250.0
    assert [result.lifts[force_N].name for force_N in PUSHES_N[1:]] == ["right_sole"] * 2, "the far foot unloads"


if __name__ == "__main__":
    check(main())
