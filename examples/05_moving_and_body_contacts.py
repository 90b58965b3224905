"""What if the ground moves, or a robot touches another robot?

A parcel on a conveyor belt: put down on it, moving with it, and when the belt brakes. Then two Talos face to face, fist to
fist: each braces itself against a push of its own choice, and one of them may be the stronger.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

import rbd

GRAVITY, BELT_MU = 9.81, 0.4
BELT_SPEED = 1.0  # [m/s], along x
LEFT, RIGHT, FIST = "gripper_left_base_link", "gripper_right_base_link", (0.0, 0.0, -0.152)


@dataclass(frozen=True)
class Result:
    """The belt's answers by what happens on it, and the robots' by how hard each pushes."""

    belt: dict[str, rbd.Solution]
    pair: rbd.robots.RobotPair
    fists: dict[tuple[float, float], rbd.Solution]


def main(show: bool = True) -> Result:
    # A parcel of 10 kg. Rows and velocities of its contact are relative to the belt.
    parcel = rbd.load_robot("box")
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))

    def on_belt(speed: float, belt_gains: float = 0.0) -> rbd.Solution:
        moves = rbd.Ground(velocity=(BELT_SPEED, 0.0, 0.0), acceleration=(belt_gains, 0.0, 0.0))
        belt = rbd.SurfaceContact("belt", "box", half_lengths=(0.2, 0.2), placement=below, friction=BELT_MU, on=moves)
        state = parcel.at(v=np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]))
        return rbd.solve(state, np.zeros(0), [belt])

    belt = {"put down on it": on_belt(0.0), "moving with it": on_belt(BELT_SPEED)}
    belt |= {f"belt brakes at {brake} m/s2": on_belt(BELT_SPEED, -brake) for brake in (3, 6)}
    print(f"{'A parcel of 98.1 N:':<24}{'belt on it':>12}{'gains':>14}{'on the belt':>14}")
    for what, s in belt.items():
        rub_N, gains, slip = np.round([s.forces["belt"][0], s.a[0], s.accelerations["belt"][0]], 9) + 0.0  # no -0.000
        print(f"  {what:<22}{rub_N:10.2f} N{gains:9.3f} m/s2{slip:9.3f} m/s2")

    # Two robots in one model, the second turned to face the first, fist to fist.
    talos = rbd.load_robot("talos")
    alone = arms_forward(talos)
    reach = alone.frame(LEFT, FIST).X_WF.translation[0]
    facing = pin.SE3(pin.exp3(np.array([0.0, 0.0, np.pi])), np.array([2.0 * reach, 0.0, 0.0]))
    pair = rbd.robots.merge_robots(talos, talos, placement=facing)
    state = pair.together(alone, alone)
    contacts = [*pair.feet(friction=0.7), *fists(state)]

    def braced(push_N: float) -> np.ndarray:
        """Torques that keep one robot still while each of its fists is pushed back."""
        pushed = [rbd.ExternalForce(hand, (-push_N, 0.0, 0.0), offset=FIST) for hand in (LEFT, RIGHT)]
        return rbd.hold(alone, talos.soles(), external=pushed).tau

    answers = {}
    for pushes in ((40.0, 40.0), (40.0, 20.0), (40.0, 0.0)):
        tau = np.concatenate([braced(push_N) for push_N in pushes])
        answers[pushes] = rbd.solve(state, tau, contacts)
    at = state.frame(f"a_{LEFT}", FIST)  # the robot starts from rest: J a is the fist's acceleration
    print(f"\n{'Fist to fist:':<24}{'fists carry':>12}{'fists gain':>14}")
    for (one, other), s in answers.items():
        print(f"  {one:2.0f} N against {other:2.0f} N     {fist_force(s):10.2f} N{(at.J @ s.a)[0] + 1e-12:9.3f} m/s2")

    if show:
        from rbd.visual import Scene

        Path("out").mkdir(exist_ok=True)
        with Scene(pair, arrow_per_weight=5.0, seen_from=(0.25, -1.0, 0.25)) as scene:
            scene.show(state, answers[40.0, 40.0])
            print(f"Open {scene.export('out/05_moving_and_body_contacts.html')} in a browser.")
    return Result(belt, pair, answers)


def arms_forward(talos: rbd.Robot) -> rbd.State:
    """Standing with its forearms level, pointing ahead."""
    bends = {1: 0.0, 4: -np.pi / 2, 7: 0.0}
    angles = {f"arm_{side}_{joint}_joint": angle for side in ("left", "right") for joint, angle in bends.items()}
    return talos.standing().with_joints(angles)


def fists(state: rbd.State) -> list[rbd.PointContact]:
    """Each fist of the first against the one before it; the normal, out of the second's fist, is in that fist's axes."""
    out = []
    for name, mine, other in (("left fist", LEFT, RIGHT), ("right fist", RIGHT, LEFT)):
        normal = state.frame(f"b_{other}").X_WF.rotation.T @ np.array([-1.0, 0.0, 0.0])
        out.append(rbd.PointContact(name, f"a_{mine}", offset=FIST, on=rbd.Body(f"b_{other}", normal=normal), friction=0.5))
    return out


def fist_force(s: rbd.Solution) -> float:
    """The normal force of the second on each fist of the first, on average [N]."""
    return 0.5 * (s.contacts["left fist"].normal + s.contacts["right fist"].normal)


def check(result: Result) -> None:
    """Coulomb on the belt; action and reaction between the robots."""
    limit, gains = BELT_MU * GRAVITY, {what: s.a[0] for what, s in result.belt.items()}
    assert abs(gains["put down on it"] - limit) < 1e-8 and abs(gains["belt brakes at 6 m/s2"] + limit) < 1e-8, "it slips"
    assert abs(gains["moving with it"]) < 1e-8 and abs(gains["belt brakes at 3 m/s2"] + 3.0) < 1e-8, "it sticks"
    for s in [*result.belt.values(), *result.fists.values()]:
        assert s.status is rbd.problem.Status.SOLVED and s.residuals.centroidal.scaled < 1e-9, "momentum is balanced"
    even, weaker, limp = result.fists.values()
    assert abs(fist_force(even) - 40.0) < 1e-6 and np.abs(even.a).max() < 1e-7, "equal pushes: nothing moves"
    assert 40.0 > fist_force(weaker) > fist_force(limp) > 0.0, "the fists carry less than the stronger one pushes with"
    weight_N = sum(force[2] for name, force in even.forces.items() if "sole" in name)
    assert abs(weight_N - result.pair.mass * GRAVITY) < 1e-6, "what is between the robots does not weigh on the ground"


if __name__ == "__main__":
    check(main())
