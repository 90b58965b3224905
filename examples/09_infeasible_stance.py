"""Why is there no solution: which constraints contradict each other, and which motion comes nearest?

Talos stands with the brakes of both legs closed, one foot on the ground, the other on a lift that starts upwards. With
bilateral soles, its feet and brakes require what no motion gives. We look at the certificate, at the motion that violates the
rows least, and at unilateral contacts, which break. Then a common mistake: a foot that turns, fixed at its four corners.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

LIFT = 1.0  # upward acceleration of the lift [m/s2]
TURN = 1.0  # of the foot about the vertical [rad/s]
GRAVITY = 9.81


@dataclass(frozen=True)
class Result:
    """The contradictions, the motions that come nearest, and what happens where contacts can open."""

    glued: rbd.NoSolution
    nearest: rbd.answers.solution.NearestMotion
    opened: rbd.Solution
    real: rbd.Solution
    turning: rbd.NoSolution
    as_points: rbd.answers.solution.NearestMotion
    as_sole: rbd.Solution


def main(show: bool = True) -> Result:
    talos = rbd.load_robot("talos")
    state = talos.standing()
    tau = rbd.hold(state, talos.soles()).tau
    brakes = [rbd.JointLock(name.replace("_joint", " brake"), name) for name in talos.joints if name.startswith("leg_")]

    def stance(friction: float | None) -> list:
        left, right = talos.soles(friction)
        lifted = rbd.SurfaceContact(
            "right_sole", right.frame, corners=right.corners, placement=right.placement, friction=friction,
            on=rbd.Ground(acceleration=(0.0, 0.0, LIFT, 0.0, 0.0, 0.0)),
        )  # fmt: skip
        return [left, lifted, *brakes]

    # Glued down: no acceleration does what is asked. The error says why, and what comes nearest.
    glued = refused(state, tau, stance(None))
    nearest, why = glued.nearest(), glued.contradiction
    print(f"One glued foot is lifted with {LIFT:.0f} m/s2: {len(why.rows)} of 14 constraints contradict each other:")
    for name, rows in why.rows.items():
        print(f"  {name:<19}{', '.join(rows):<30} {np.round(why.certificate[name], 2) + 0.0}")
    print(f"These forces balance, and each motion misses a row by {why.violation:.3f} m/s2 at least.")
    below, above = (nearest.violation[name][2] for name in ("left_sole", "right_sole"))
    print(f"The nearest motion lifts the left sole by {-below:.3f}, the right one by {LIFT - above:.3f} m/s2.")

    # One brake opened is not enough, as others take its place in the certificate; both of the hips' roll joints are.
    tried = {}
    for opened in (["leg_left_2 brake"], ["leg_left_2 brake", "leg_right_2 brake"]):
        kept = [c for c in stance(None) if c.name not in opened]
        tried[len(opened)] = rbd.solve(state, tau, kept, check=False)
        print(f"Open {' and '.join(opened)}: {tried[len(opened)].status}.")

    # Unilateral contacts with friction can break: then there is an answer.
    real = rbd.solve(state, tau, stance(0.7))
    normal_N = {name: contact.normal for name, contact in real.contacts.items()}
    print(f"Real soles: {normal_N['left_sole']:.1f} N on the ground, {normal_N['right_sole']:.1f} N on the lift.")

    # A foot that turns, held at its four corners (twelve rows) and as the one patch that it is (six).
    left = talos.soles(None)[0]
    corners = [
        rbd.PointContact(f"corner {i}", left.frame, offset=left.placement.act(corner)) for i, corner in enumerate(left.corners)
    ]
    pivoting = state.with_velocity(np.linalg.pinv(left.rows(state).J) @ [0.0, 0.0, 0.0, 0.0, 0.0, TURN])
    turning = refused(pivoting, tau, corners)
    as_points, as_sole = turning.nearest(), rbd.solve(pivoting, tau, [left], rest_speed=1.1 * TURN)
    print(f"A foot turns at {TURN:.0f} rad/s on four glued corners: {turning.contradiction.who} contradict each other.")
    largest_N = np.abs(as_points.solution.multipliers).max()
    print(f"The nearest motion misses corners by {as_points.worst:.3f} m/s2; no corner carries more than {largest_N:.0f} N,")
    print(f"and the robot moves as on one glued patch, to {np.abs(as_points.a - as_sole.a).max() + 1e-10:.0e} m/s2.")

    if show:
        from rbd.visual import Scene

        page = Path("out/09_infeasible_stance.html")
        page.parent.mkdir(exist_ok=True)
        with Scene(talos) as scene:
            scene.show(state, nearest.solution)  # the forces that it takes to come nearest
            print(f"Open {scene.export(page)} in a browser.")
    return Result(glued, nearest, tried[2], real, turning, as_points, as_sole)


def refused(state: rbd.State, tau: np.ndarray, constraints: list) -> rbd.NoSolution:
    """The error of a problem without an answer."""
    try:
        rbd.solve(state, tau, constraints, rest_speed=1.1 * TURN)  # corners of a foot that turns may move
    except rbd.NoSolution as error:
        return error
    raise AssertionError("there is an answer")


def check(result: Result) -> None:
    """The certificates, from their definition, and what a rigid body must do."""
    for error in (result.glued, result.turning):
        problem, why = error.problem, error.contradiction
        f = np.concatenate([why.certificate[rows.name] for rows in problem.rows])
        assert np.abs(problem.J.T @ f).max() < 1e-12, "the forces balance on every body"
        assert abs(f @ problem.offset + 1.0) < 1e-12, "and would do work on what is required"
    brakes = np.abs([result.glued.contradiction.certificate[f"leg_{side}_4 brake"] for side in ("left", "right")])
    assert np.ptp(brakes) < 1e-9, "both knees bear the same part of the squeeze"
    lifts = result.opened.problem.J @ result.opened.a + result.opened.problem.offset
    assert np.abs(lifts).max() < 1e-9, "with two joints free, all that is left can be met"
    total_N = sum(wrench[2] for wrench in result.real.forces.values() if len(wrench) == 6)
    assert abs(total_N / (90.272 * (GRAVITY + LIFT)) - 1.0) < 0.02, "with open contacts the lift raises nearly the whole robot"
    assert result.real.contacts["left_sole"].normal < 1e-6, "and the other foot leaves the ground"
    assert np.abs(result.as_points.a - result.as_sole.a).max() < 1e-9, "what cannot be met moves nothing"


if __name__ == "__main__":
    check(main())
