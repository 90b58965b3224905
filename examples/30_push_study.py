"""Which pushes can Talos withstand, on which floors, and what gives way first?

A push F on the torso to the left, friction mu of the floor: 14 x 21 samples, and in each the question whether any motor torques
within their limits and contact forces within their cones keep the robot still (`rbd.hold`). A sample without an answer is no
error of the study: it is a row with its reason. What one expects: on ice the soles slide from F = mu m g on, and on rough
floors the robot tips about the edge of its left sole, whatever the friction.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray

import rbd

TORSO = "torso_2_link"


class Result(NamedTuple):
    """What the study found, and the limits that it is checked with."""

    study: xarray.Dataset
    limits: np.ndarray  # of rbd.statics.push_limits, one for each friction [N]


@cache
def talos() -> tuple[rbd.Robot, rbd.State]:
    """The robot as it stands, built once in each process."""
    robot = rbd.load_robot("talos")
    return robot, robot.standing()


def held(friction: float, push: float) -> rbd.Actuation:
    """What holds it: one sample. It raises `CannotHold`, with the reason, where nothing does."""
    robot, state = talos()
    return rbd.hold(state, robot.soles(friction=friction), external=rbd.ExternalForce(TORSO, (0.0, push, 0.0)))


def largest(friction: float) -> float:
    """The largest push that is held at one friction, computed directly: a check."""
    robot, state = talos()
    return float(rbd.statics.push_limits(state, robot.soles(friction=friction), TORSO, [(0.0, 1.0, 0.0)]).forces[0])


def main(show: bool = True) -> Result:
    # The tests take coarse steps, in this process; else as many processes work as there are cores, and what they find is kept:
    # the same call after Ctrl-C goes on where it was.
    friction = np.geomspace(0.05, 1.0, 14) if show else np.array([0.05, 0.1, 0.2, 0.5])
    push = np.linspace(0.0, 200.0, 21 if show else 6)
    samples = rbd.grid(friction=friction, push=push).with_units(friction="1", push="N")
    keep, out = ("status", "worst_residual", "worst_torque", "forces"), "out/30_push_study.zarr" if show else None
    if show:
        Path("out").mkdir(exist_ok=True)
    study = rbd.study(held, samples, keep=keep, executor=None if show else 0, out=out, progress=show)
    limits = np.array([largest(mu) for mu in friction])

    ok = study["ok"].values
    small = bool(study.worst_residual.max() < 1e-9)
    print(f"{ok.sum()} of {ok.size} samples are held; their residuals are below 1e-9: {small}")
    for code, count in zip(*np.unique(study["reason"], return_counts=True), strict=True):
        if code:
            print(f"{count:5d} are not: {rbd.errors.Reason.of_code(int(code))}")
    print("friction   held up to   not from   push_limits   hardest motor there")
    for mu, row, limit in zip(friction, ok, limits, strict=True):
        last = push[row].max()
        share = 100.0 * float(study.worst_torque.sel(friction=mu, push=last))
        print(f"{mu:8.2f} {last:10.0f} N {push[~row].min():8.0f} N {limit:11.1f} N {share:18.0f} %")
    if show:
        draw(study, limits).savefig("out/30_push_study.png", dpi=150)
        print(
            "See out/30_push_study.png and", beside(samples, study, "out/30_push_study.html"), "with the robot at two samples."
        )
    return Result(study, limits)


def draw(study: xarray.Dataset, limits: np.ndarray):
    """Left, how hard the hardest motor works; right, what prevents the rest; dots, `push_limits`."""
    from matplotlib.figure import Figure  # in the extra `plot`

    figure = Figure(figsize=(10.5, 4.4), layout="constrained")
    figure.get_layout_engine().set(wspace=0.06)
    left, right = figure.subplots(1, 2, sharey=True)
    rbd.visual.plot_study(study, value="worst_torque", ax=left)
    rbd.visual.plot_study(study, value="reason", ax=right)
    for ax in (left, right):
        ax.plot(study.friction, limits, "o", color="black", mec="white", ms=6.0, zorder=4)
    left.text(
        0.97, 0.94, "dots: rbd.statics.push_limits", transform=left.transAxes, ha="right", va="top", backgroundcolor="white"
    )
    right.set_ylabel("")
    return figure


def beside(samples, study: xarray.Dataset, page: str) -> Path:
    """The last push that is held on the roughest floor, and the nearest motion under the next one: the right foot is lifted."""
    mu, ok = float(study.friction[-1]), study["ok"][-1].values
    last, first = study.push.values[ok].max(), study.push.values[~ok].min()
    scenes = {f"{last:.0f} N: held": held(**samples.at(friction=mu, push=last))}
    try:
        held(**samples.at(friction=mu, push=first))
    except rbd.CannotHold as error:
        scenes[f"{first:.0f} N: the nearest motion tips"] = error.nearest()
    return rbd.visual.scenes_beside(scenes, page, seen_from=(1.0, 0.15, 0.15))


def check(result: Result) -> None:
    """The limit computed directly lies between the last push that is held and the first that is not, at each friction."""
    study, push = result.study, result.study.push.values
    for ok, limit in zip(study["ok"].values, result.limits, strict=True):
        assert push[ok].max() <= limit <= push[~ok].min() and ok[push < limit].all()
    robot, _ = talos()
    slides = study.friction.values * robot.mass * 9.81
    assert np.abs(result.limits / np.minimum(slides, result.limits[-1]) - 1.0).max() < 0.01
    reasons = {rbd.errors.Reason.of_code(int(code)) for code in np.unique(study["reason"])}
    assert reasons >= {rbd.errors.Reason.CANNOT_HOLD_FRICTION}
    assert float(study.worst_residual.max()) < 1e-9


if __name__ == "__main__":
    check(main())
