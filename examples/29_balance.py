"""What is the hardest push that Talos survives without a step, from eight sides, and what decides it?

Pushed at the torso, with a force F at a height h for T = 0.1 s, it is to stand still again where it stood. With z the height of
its centre of mass c over the soles, w = sqrt(g / z), p the centre of pressure, and while its angular momentum stays zero,

    c'' = w^2 (c - p) + F h / (m z),         so with p at the edge of the soles it comes back if F < F_s / (1 - exp(-w T)):

the capture point c + c' / w is then inside the edge when the push ends. F_s = m g d / h, with the edge at a distance d, is what
it withstands if it lasts: `rbd.statics.push_limits`. A blow at c (T near 0) may have an impulse of m w d. More takes
angular momentum: arms, torso and hips turn, as those of one who balances on a beam.

The whole-body controller wants c'' = -6 w^2 (c + c' / w - c_0), feedback of the capture point. Where the soles cannot give it,
the costs let momentum, torso and posture go first; feet that leave the ground are put back by tasks of their own.
"""

from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path

import numpy as np

import rbd

GRAVITY, LASTS_S, STEP_S, WATCHED_S, FAR_M = 9.81, 0.1, 4e-3, 1.5, 0.12
TORSO, CONTROL = "torso_2_link", "whole-body control"
FIRST = {"fixed torques": 1, "held posture": 8, CONTROL: 40}  # where a search starts [N s]


class FallsError(Exception):
    """The centre of mass has gone too far to come back: a run ends early."""


@cache
def talos() -> tuple:
    """Talos as it stands, its soles, all it may touch (its joints have stops), and what answers pushes, by name."""
    robot = rbd.load_robot("talos")
    state, soles = robot.standing(), robot.soles(friction=0.7)
    torques = rbd.hold(state, soles).tau
    tasks = [
        rbd.control.ComTask(state.com, cost=1000.0, gain=6.0 * rate(state) ** 2, damping_ratio=np.sqrt(6.0) / 2.0),
        rbd.control.MomentumTask(angular_cost=0.02 * robot.mass**2, gain=3.0),
        rbd.control.FrameTask(TORSO, state.frame(TORSO).X_WF.rotation, gain=40.0),
        rbd.control.PostureTask(state.q, cost=0.5, gain=40.0),
        *[rbd.control.FrameTask(s.frame, state.frame(s.frame).X_WF, position_cost=100.0, gain=400.0) for s in soles],
    ]
    held, whole_body = rbd.control.HoldPosture(state, soles), rbd.control.WholeBodyController(tasks, soles)
    answers = dict(zip(FIRST, (lambda state, t: torques, held, whole_body), strict=True))
    return state, soles, [*soles, *robot.joint_limits()], answers


def rate(state: rbd.State) -> float:
    """The rate w at which a capture point moves away [1/s]; the soles are at height zero."""
    return float(np.sqrt(GRAVITY / state.com[2]))


def push(impulse: np.ndarray) -> rbd.control.Push:
    return rbd.control.Push(TORSO, impulse / LASTS_S, start=0.0, duration=LASTS_S)


def pushed(name: str, impulse: np.ndarray) -> rbd.Trajectory | None:
    """The motion after a push with an impulse [N s]; None where Talos falls."""
    (state, _, touches, answers), force = talos(), push(impulse)

    def watched(now: rbd.State, t: float) -> tuple:
        if np.abs(now.com - state.com).max() > FAR_M:
            raise FallsError
        return force(now, t)

    given = {"controller": answers[name], "external": watched, "record_every": 5, "progress": False}
    try:
        return rbd.simulate(state, touches, duration=WATCHED_S, step=STEP_S, **given)
    except rbd.errors.SimulationStopped as stopped:
        if isinstance(stopped.__cause__, FallsError):
            return None
        raise


def stands(way: rbd.Trajectory | None) -> bool:
    """Whether it is still at the end: within 2 cm of where it stood, slower than 5 cm/s, a fifth of its weight on each sole."""
    if way is None:
        return False
    near, slow = np.abs(way.com[-1] - way.com[0]) < 0.02, np.abs(way.momentum[-1, :3]) < 0.05 * way.robot.mass
    weight = way.robot.mass * GRAVITY
    return bool(near.all() and slow.all() and all(way.forces[sole.name][-1, 2] > 0.2 * weight for sole in talos()[1]))


def largest(by: int, way: np.ndarray) -> dict[str, int]:
    """The largest impulse along a direction after which Talos stands [N s], found by bisection to within `by`."""
    found = {}
    for name, first in FIRST.items():
        low, high = 0, -(-first // by)
        while stands(pushed(name, high * by * way)):
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if stands(pushed(name, middle * by * way)) else (low, middle)
        found[name] = low * by
    return found


def main(show: bool = True) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    state, soles, *_ = talos()
    angles = np.radians(np.arange(0, 360, 45) if show else [90])
    ways, by = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles]).round(12), 1 if show else 8
    statics = rbd.statics.push_limits(state, soles, TORSO, ways).forces * LASTS_S
    if show:
        with ProcessPoolExecutor(2) as pool:
            runs = list(pool.map(partial(largest, by), ways))
    else:
        runs = [largest(by, way) for way in ways]
    impulses = {name: np.array([run[name] for run in runs]) for name in FIRST}
    impulses |= {"push_limits": statics, "no angular momentum": statics / -np.expm1(-rate(state) * LASTS_S)}
    print(f"Talos pushed at its torso for {LASTS_S} s: the largest impulses it survives [N s], in steps of {by} N s")
    blow = statics / LASTS_S * state.frame(TORSO).X_WF.translation[2] * rate(state) / GRAVITY
    table = {**impulses, "m w d": blow}
    print("towards" + "".join(f"{name:>{len(name) + 3}}" for name in table))
    for i, angle in enumerate(np.degrees(angles)):
        print(f"{angle:3.0f} deg" + "".join(f"{sizes[i]:{len(name) + 3}.0f}" for name, sizes in table.items()))
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(8.0, 4.6), layout="constrained")
        plot_impulses(figure.add_subplot(projection="polar"), (ways, impulses))
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/29_balance.png", dpi=150)
        left = impulses[CONTROL][2] * ways[2]
        page = pushed(CONTROL, left).export("out/29_balance.html", external=push(left))
        print(f"See out/29_balance.png and, pushed to its left, {page}.")
    return ways, impulses


def plot_impulses(ax, result: tuple[np.ndarray, dict[str, np.ndarray]]) -> list:
    """The largest impulses by direction, on polar axes; returns the artists."""
    return rbd.visual.plot_directions(ax, *result, quantity="largest impulse", unit="N s")


def check(result: tuple[np.ndarray, dict[str, np.ndarray]]) -> None:
    """The controller survives more than any without angular momentum could, a held posture less; fixed torques no push."""
    fixed, posture, control, statics, bound = result[1].values()
    assert (fixed == 0).all() and (posture > 0).all() and (posture < bound).all()
    assert (control > bound).all() and (statics < bound).all()


if __name__ == "__main__":
    check(main())
