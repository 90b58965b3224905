"""Does Talos stand however it is pushed, whatever its links weigh, on any ground of friction 0.5 or more?

A member of that set is a push w in a polytope, masses m and centres of mass c in boxes, a coefficient mu >= 0.5. Each needs
contact forces f in its cones and torques within their limits with

    S^T tau + J^T f + J_P^T w = g(m, m c).

A thousand members tried prove nothing of the next one. `rbd.robust.hold` proves it for all: forces at the corners of the
polytope and an affine correction for each mass, found by conic programs, then checked in fractions. A set that is too large is
refuted by one member of it, with a virtual motion along which its load does more work than forces and torques can.
"""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

import rbd
from rbd.robust import Counterexample, PushSet, RobustHold, hold, push_limits, verifier

TORSO, FRICTION, MASS, COM = "torso_2_link", 0.5, 0.05, {"torso_2_link": 0.02}
SIDES = 4


class Result(NamedTuple):
    """What is proved, what is refuted, and how far pushes may go."""

    held: RobustHold
    read: tuple[bool, str]
    refuted: Counterexample
    limits: rbd.robust.RobustPushLimits


def main(show: bool = True) -> Result:
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=0.7)
    given = {"friction": FRICTION, "mass": MASS, "com": COM}

    # Pushes of up to 30 N within 25 degrees of straight back, and every member of the rest.
    held = hold(state, soles, pushes=PushSet.cone(TORSO, (-1, 0, 0), 30.0, 25.0), **given)
    print(f"Pushed back by up to 30 N within 25 degrees: proved for all, {held.margin:.2f} N (N m) to each limit.")

    # Anybody can check the file: 200 lines of Python's standard library do.
    with TemporaryDirectory() as folder:
        file = held.save(Path(folder) / "held.json")
        read = verifier.verify(json.loads(file.read_text(encoding="utf-8")))
    print(f"The certificate, read from its file: {'proved' if read[0] else 'not proved'}.")

    # Twice the push is too much for a member.
    refuted = hold(state, soles, pushes={TORSO: [(0.0, 0.0, 0.0), (-90.0, 0.0, 0.0)]}, **given)
    member = refuted.members[0]
    pelvis = talos.model.inertias[talos.site("base_link")[0]].mass
    push, trunk, more = member.push[TORSO][0], 100 * member.com[TORSO][0], 100 * (member.mass["base_link"] / pelvis - 1)
    print(f"By 90 N: refuted, by a push of {push:.0f} N, the trunk {trunk:+.0f} cm along x and {more:+.0f} % of the pelvis.")
    print(f"The proof of that holds: {refuted.verify()}.")

    # How far pushes may go, from both sides, against the robot as its file has it.
    angles = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    ways = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)])
    limits = push_limits(state, soles, TORSO, ways, **given)
    file_says = rbd.statics.push_limits(state, talos.soles(FRICTION), TORSO, ways).forces
    print("push along [deg]   all members hold   one does not beyond   the file's robot [N]")
    for angle, inner, outer, own in zip(np.degrees(angles), limits.inner, limits.outer, file_says, strict=True):
        print(f"{angle:16.0f}   {inner:16.1f}   {outer:19.1f}   {own:20.1f}")

    if show:
        from rbd.visual import Scene

        page = Path("out/39_proved_for_all.html")
        page.parent.mkdir(exist_ok=True)
        with Scene(talos, arrow_per_weight=4.0) as scene:  # metres: pushes are a tenth of it
            scene.show(state)
            scene.draw(held, limits)
            print(f"Open {scene.export(page)} in a browser: the pushes that are proved, and both outlines.")
        members = held.export(page.with_name("39_members.html"))
        print(f"Open {members}: sliders move one member within the set, and beyond it.")
    return Result(held, read, refuted, limits)


def check(result: Result) -> None:
    """What is proved holds in fractions; single members agree; the truth is between both outlines."""
    held, read, refuted, limits = result
    assert read[0] and held.margin > 0.0 and refuted.verify()
    assert (limits.inner <= limits.outer).all() and all(proof.verify() for proof in limits.holds[:1])
    state, worst = held.loads.state, refuted.members[0]
    load = refuted.loads.corners[1] - state.h  # the push alone, as a generalised force the other way round
    assert np.abs(load + state.frame(TORSO).J[:3].T @ worst.push[TORSO]).max() < 1e-9


if __name__ == "__main__":
    check(main())
