"""Which torques and contact forces keep a humanoid standing?

Talos stands on two flat feet. We ask for the motor torques that keep it still, put them back into the equations of
motion, and look at three answers: with frictional ground, with bilateral soles (the textbook's contact), and
without any ground.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rbd

GRAVITY = 9.81


@dataclass(frozen=True)
class Result:
    """What was found, for `check` and for pictures."""

    state: rbd.State
    hold: rbd.Actuation
    standing: rbd.Solution
    glued: rbd.Solution
    falling: rbd.Solution


def main(show: bool = True) -> Result:
    # Robot: 32 motors and a floating base; standing() lays its soles flat on z = 0.
    talos = rbd.load_robot("talos")
    state = talos.standing()

    # Constraints: one surface contact a foot, six rows each.
    soles = talos.soles(friction=0.7)

    # Solve: statics gives torques; Gauss's principle gives back the motion and the forces they produce.
    hold = rbd.hold(state, soles)
    standing = rbd.solve(state, hold.tau, soles)
    glued = rbd.solve(state, hold.tau, talos.soles(friction=None), solver=rbd.KKT())
    falling = rbd.solve(state, hold.tau)
    result = Result(state, hold, standing, glued, falling)

    # Print.
    print(f"Talos weighs {talos.mass * GRAVITY:.2f} N. Its feet carry, in newtons:")
    for name, contact in standing.contacts.items():
        print(f"  {name:<12}{contact.normal:8.2f}   friction used {100 * contact.friction_used:4.1f} %")
    share = np.abs(hold.tau) / talos.effort_limit
    print("The hardest working motors, in % of their limits:")
    for i in np.argsort(-share)[:3]:
        print(f"  {talos.actuated_names[i]:<20}{100 * share[i]:6.1f}   {hold.tau[i]:+8.2f} N m")
    print(f"Contact rows: {standing.problem.m} of rank {standing.rank}; law: {standing.law}; {standing.status}.")
    print(f"The centre of mass accelerates by {com_acceleration(state, standing)[2] + 0.0:.3f} m/s2 on the ground")
    print(f"and by {com_acceleration(state, falling)[2]:.3f} m/s2 without it.")

    # Picture: one page that opens in any browser.
    if show:
        from rbd.visual import Scene

        page = Path("out/01_stand.html")
        page.parent.mkdir(exist_ok=True)
        with Scene(talos) as scene:
            scene.show(state, standing)
            print(f"Open {scene.export(page)} in a browser.")
    return result


def com_acceleration(state: rbd.State, solution: rbd.Solution) -> np.ndarray:
    """Acceleration of the centre of mass in W, shape (3,) [m/s2]: rate of momentum over mass."""
    balance = solution.problem.balance
    return np.round((balance.A_g @ solution.a + balance.rate_bias)[:3] / state.robot.mass, 9)


def check(result: Result) -> None:
    """The laws that the answer must obey, whatever the robot."""
    weight_N = result.state.robot.mass * GRAVITY
    total_N = sum(wrench[:3] for wrench in result.standing.forces.values())
    assert np.abs(total_N - [0.0, 0.0, weight_N]).max() < 1e-9 * weight_N, "the feet carry the weight, and only that"
    assert np.abs(result.standing.a).max() < 1e-8, "holding torques hold"
    assert np.abs(result.glued.a - result.standing.a).max() < 1e-8, "nothing slips, so glue changes nothing"
    falls = com_acceleration(result.state, result.falling)[2]
    assert abs(falls + GRAVITY) < 1e-8, "motors cannot hold a robot in the air"
    assert result.standing.status is rbd.problem.Status.SOLVED


if __name__ == "__main__":
    check(main())
