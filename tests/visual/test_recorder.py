"""What a scene's recorder passes on: everything at first, then differences."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

import rbd
from rbd.visual import Scene
from rbd.visual.pages.recorder import Recorder


def command(kind: str, path: str, value: int = 0) -> SimpleNamespace:
    """A command as Meshcat packs it."""
    return SimpleNamespace(lower=lambda: {"type": kind, "path": path, "value": value})


@pytest.fixture
def told() -> list[bytes | str]:
    """What the listener of `recorder` heard."""
    return []


@pytest.fixture
def recorder(told: list[bytes | str]) -> Recorder:
    """A recorder that is listened to, with three things in it."""
    recorder = Recorder()
    for name in ("a", "b", "b/c"):
        recorder.send(command("set_object", f"/meshcat/marks/{name}"))
    recorder.send(command("set_object", "/meshcat/robot/0"))
    recorder.listen(told.append)
    return recorder


def test_what_is_drawn_again_unchanged_is_not_sent(recorder: Recorder, told: list[bytes | str]):
    """Deleted and sent again within one change: viewers have it already."""
    with recorder.together():
        recorder.send(command("delete", "/meshcat/marks"))
        for name in ("a", "b", "b/c"):
            recorder.send(command("set_object", f"/meshcat/marks/{name}"))
        assert told == []
    assert told == []


def test_what_changed_is_sent_and_what_is_gone_is_deleted(recorder: Recorder, told: list[bytes | str]):
    """One new value, one deletion for all below a path; other paths are not touched."""
    with recorder.together(), recorder.together():
        recorder.send(command("delete", "/meshcat/marks"))
        recorder.send(command("set_object", "/meshcat/marks/a", 1))
    assert len(told) == 2 and b"delete" in told[0] and b"/meshcat/marks/b" in told[0] and b"/meshcat/marks/a" in told[1]
    kept = recorder.messages()[0]
    assert sum(b"set_object" in message for message in kept) == 2 and sum(b"robot" in message for message in kept) == 1


def test_a_late_viewer_gets_the_same_scene(recorder: Recorder):
    """Who has the first messages is told of deletions since, in order, though something new stands there again."""
    seen = recorder.messages()[1]
    with recorder.together():
        recorder.send(command("delete", "/meshcat/marks"))
    with recorder.together():
        recorder.send(command("set_object", "/meshcat/marks/b", 2))
    late = recorder.messages(after=seen)[0]
    assert [b"delete" in message for message in late] == [True, False] and b"marks/b" in late[1]


def test_a_path_that_loses_something_is_sent_whole(recorder: Recorder, told: list[bytes | str]):
    """An object that had a transform and has none any more: deleted, and sent without it."""
    recorder.send(command("set_transform", "/meshcat/marks/a"))
    told.clear()
    with recorder.together():
        recorder.send(command("delete", "/meshcat/marks/a"))
        recorder.send(command("set_object", "/meshcat/marks/a"))
    assert [b"delete" in m for m in told] == [True, False] and b"set_object" in told[1]


def test_after_a_motion_all_is_sent_again(recorder: Recorder, told: list[bytes | str]):
    """The page moved the robot by itself and wrote the legend: what we sent before is no longer what it shows."""
    recorder.post("legend", "L")
    recorder.post("motion", "M")
    told.clear()
    with recorder.together():
        recorder.post("motion", "null")
        recorder.post("legend", "L")
        recorder.send(command("set_object", "/meshcat/robot/0"))
    assert len(told) == 3
    with recorder.together():
        recorder.post("motion", "null")
        recorder.post("legend", "L")
    assert len(told) == 3


def test_a_change_that_fails_is_sent_as_far_as_it_came(recorder: Recorder, told: list[bytes | str]):
    """Viewers show what the scene's own record says."""
    with pytest.raises(ValueError, match="odd"), recorder.together():
        recorder.post("legend", "half")
        raise ValueError("odd")
    assert told == ["half"]
    recorder.post("legend", "whole")
    assert told[-1] == "whole"


def test_other_threads_wait_for_a_change(recorder: Recorder, told: list[bytes | str]):
    """What another thread sends meanwhile comes after it, and is not lost."""
    with recorder.together():
        other = threading.Thread(target=lambda: recorder.post("late", "2"))
        other.start()
        other.join(0.05)
        recorder.post("early", "1")
        assert other.is_alive()
    other.join(10)
    assert told == ["1", "2"]


def test_a_scene_sends_what_differs(g1: rbd.Robot):
    """Showing the same again sends nothing; another push sends its arrow and the forces, and no mesh of the robot."""
    state, feet = g1.standing(), g1.feet(friction=0.7)
    held = rbd.hold(state, feet)
    with Scene(g1) as scene:
        pushes = [rbd.ExternalForce("torso_link", (size, 0.0, 0.0)) for size in (5.0, 6.0)]
        solutions = [rbd.solve(state, held.tau, feet, external=[push]) for push in pushes]
        scene.show(state, solutions[0], external=pushes[0])
        whole = sum(map(len, scene.recorder.messages()[0]))
        told: list[bytes | str] = []
        scene.recorder.listen(told.append)
        scene.show(state, solutions[0], external=pushes[0])
        assert told == []
        scene.show(state, solutions[1], external=pushes[1])
        assert any(b"pushes" in m for m in told if isinstance(m, bytes))
        assert not any(b"/robot/" in m or b"/com/" in m or b"support" in m for m in told if isinstance(m, bytes))
        assert sum(map(len, told)) < 0.2 * whole


def test_a_whole_branch_is_deleted_at_its_top(recorder: Recorder, told: list[bytes | str]):
    """Many things gone below one path, and nothing left there: one deletion; a neighbour with a longer name stays."""
    for i in range(5):
        recorder.send(command("set_object", f"/meshcat/marks/torques/{i}/arc"))
    recorder.send(command("set_object", "/meshcat/marks/torques_of_others"))
    told.clear()
    with recorder.together():
        recorder.send(command("delete", "/meshcat/marks/torques"))
    assert len(told) == 1 and b"/meshcat/marks/torques" in told[0] and b"torques/" not in told[0]
    assert sum(b"of_others" in message for message in recorder.messages()[0]) == 1


def test_differences_come_in_the_order_of_drawing(recorder: Recorder, told: list[bytes | str]):
    """A list of marks that has been sent before comes after the new marks that it names."""
    recorder.post("marks", "a")
    told.clear()
    with recorder.together():
        recorder.send(command("set_object", "/meshcat/marks/new"))
        recorder.post("marks", "a, new")
    assert b"marks/new" in told[0] and told[1] == "a, new"
