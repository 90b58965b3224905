"""Events on terrain name the piece that a point is on: in text, in files and in data sets."""

from __future__ import annotations

from pathlib import Path

import pytest

import rbd

BOX = rbd.testing.box(mass=10.0)


@pytest.fixture(scope="module")
def fallen() -> rbd.simulation.Trajectory:
    """A box falls flat onto the edge of a step: front corners on the step, rear ones in the air, then on the floor."""
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.6, on=rbd.Terrain.stairs(0.02, 0.3, 1))
    state = rbd.State(BOX, [-0.15, 0, 0.025, 0, 0, 0, 1])
    return rbd.simulate(state, [face], duration=0.3, step=2e-3, progress=False)


def test_the_text_says_the_piece(fallen: rbd.simulation.Trajectory) -> None:
    """Front corners touch the step (box 1), rear ones the floor (box 0), each by its number."""
    touches = [e for e in fallen.events if e.kind == "touches"]
    assert {(e.point, e.piece) for e in touches} >= {(0, "box 1"), (1, "box 1"), (2, "box 0"), (3, "box 0")}
    first = next(e for e in touches if e.point == 0)
    assert "s: face[0] on box 1 touches at " in str(first)
    assert str(first) in str(fallen)
    assert "on box 1" in str(fallen.events[0])


def test_a_plane_has_no_piece() -> None:
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.6, on=0.0)
    events = rbd.simulate(rbd.State(BOX, [0, 0, 0.01, 0, 0, 0, 1]), [face], duration=0.1, step=2e-3, progress=False).events
    assert events and not any(e.piece for e in events)
    assert "s: face[0] touches at " in str(events[0])


@pytest.mark.parametrize("ending", ["npz", "nc"])
def test_files_keep_it(fallen: rbd.simulation.Trajectory, tmp_path: Path, ending: str) -> None:
    """Files and data sets have it; a file written before it was there has events without a piece."""
    path = tmp_path / f"fallen.{ending}"
    fallen.save(path)
    again = rbd.simulation.Trajectory.load(path, robot=BOX)
    assert [str(e) for e in again.events] == [str(e) for e in fallen.events]
    assert fallen.to_xarray()["event_piece"].values.tolist() == [e.piece for e in fallen.events]


def test_events_of_older_files_have_no_piece() -> None:
    from rbd.simulation.trajectory_contents import _event

    given = [0.1, "face", "touches", 2, 0.5, 1.0]
    assert _event(given) == rbd.simulation.Event(*given)
    with pytest.raises(rbd.InputError, match="expected time, name, kind, point, speed, impulse, piece"):
        _event([*given, 3.0])


def test_shapes_say_the_piece() -> None:
    """A robot that falls with its collision shapes: rear feet on the floor, front ones on the step."""
    solo = rbd.load_robot("solo12")
    q = solo.standing().q.copy()
    q[2] += 0.03
    steps = rbd.Terrain.stairs(0.01, 0.3, 1)  # its riser under the trunk
    contacts = rbd.CollisionContacts("shapes", solo, friction=0.7, on=steps)
    run = rbd.simulate(rbd.State(solo, q), [contacts], duration=0.1, step=1e-3, progress=False, may_sink=True)
    touches = [event for event in run.events if event.kind == "touches"]
    assert {event.piece for event in touches} == {"box 0", "box 1"}
    assert touches[0].piece == "box 1"  # the step is met first
    assert "] on box 1 touches at " in str(touches[0])
