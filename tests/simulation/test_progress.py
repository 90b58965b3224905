"""The progress bar: silent where nobody watches, gone when it is over."""

from __future__ import annotations

import io
from contextlib import redirect_stderr

import numpy as np
import pytest
from work import calls

from rbd.simulation import progress_bar as entry
from rbd.simulation.progress_bar import progress_of
from rbd.simulation.run import _times

TIMES = np.linspace(0.0, 10.0, 1001).tolist()
SHOW, HIDE = "\x1b[?25h", "\x1b[?25l"
"""What shows and hides the cursor of a terminal."""


class Terminal(io.StringIO):
    """A stderr that says it is a terminal."""

    def isatty(self) -> bool:
        """It is."""
        return True


class Clock:
    """Time that passes only where a test says so."""

    now = 50.0

    def perf_counter(self) -> float:
        """As `time.perf_counter`."""
        return self.now


@pytest.fixture(autouse=True)
def clock(monkeypatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(entry, "time", found)
    return found


@pytest.fixture
def terminal(monkeypatch) -> Terminal:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(entry, "PACE", 0.0)
    return Terminal()


def run(stderr: io.StringIO | None, shown: bool = True, stop: BaseException | None = None) -> None:
    with redirect_stderr(stderr), progress_of(TIMES, shown=shown) as told:
        for t in TIMES[:20]:
            told(t)
            entry.time.now += 0.002
        if stop is not None:
            raise stop


def test_a_short_run_shows_nothing(terminal: Terminal):
    """Patience is a second."""
    run(terminal)
    assert terminal.getvalue() == ""


def test_a_long_run_shows_a_bar_that_goes_away(terminal: Terminal, monkeypatch):
    """It tells the simulated time; at the end the line is erased and the cursor is there."""
    monkeypatch.setattr(entry, "PATIENCE", 0.01)
    run(terminal)
    text = terminal.getvalue()
    assert "of 10 s" in text and "x real time" in text
    assert text.rfind(SHOW) > text.rfind(HIDE) >= 0 and "\x1b[2K" in text[text.rfind("real time") :]


def test_other_work_tells_its_share(terminal: Terminal, monkeypatch):
    """What is done, whatever its name is, and how much of it; no simulated time."""
    monkeypatch.setattr(entry, "PATIENCE", 0.0)
    with redirect_stderr(terminal), progress_of([0.0, 8.0], doing="reading [b]{x}.csv") as told:
        entry.time.now += 2.0
        told(2.0)
    text = terminal.getvalue()
    assert "reading [b]{x}.csv" in text and "25 %" in text and "real time" not in text


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), RuntimeError("broken")])
def test_the_terminal_is_whole_after_ctrl_c_and_errors(terminal: Terminal, monkeypatch, stop: BaseException):
    """The cursor comes back, and the exception goes on."""
    monkeypatch.setattr(entry, "PATIENCE", 0.01)
    with pytest.raises(type(stop)):
        run(terminal, stop=stop)
    assert terminal.getvalue().rfind(SHOW) > terminal.getvalue().rfind(HIDE) >= 0


def test_who_does_not_watch_sees_nothing(monkeypatch, terminal: Terminal):
    """No terminal, a dumb one, a closed one, none at all, or a user who said so."""
    monkeypatch.setattr(entry, "PATIENCE", 0.0)
    run(terminal, shown=False)
    monkeypatch.setenv("TERM", "dumb")
    run(terminal)
    monkeypatch.setenv("TERM", "xterm")
    file, closed = io.StringIO(), io.StringIO()
    closed.close()
    for other in (file, closed, None):
        run(other)
    assert terminal.getvalue() == file.getvalue() == ""


def test_one_time_has_no_progress(terminal: Terminal, monkeypatch):
    """Nothing to wait for."""
    monkeypatch.setattr(entry, "PATIENCE", 0.0)
    with redirect_stderr(terminal), progress_of([0.0]) as told:
        told(0.0)
    assert terminal.getvalue() == ""


def test_a_step_costs_next_to_nothing(terminal: Terminal):
    """Two calls where it draws nothing, its own and that of the clock."""
    with redirect_stderr(terminal), progress_of(TIMES) as told:
        assert calls(lambda: told(1.0)) <= 3  # with the lambda


@pytest.mark.parametrize(
    ("duration", "step", "times"),
    [(0.25, 0.1, [0.0, 0.1, 0.2, 0.25]), (0.3, 0.1, [0.0, 0.1, 0.2, 0.3]), (0.05, 0.1, [0.0, 0.05])],
)
def test_the_last_step_is_shorter_where_the_duration_asks_for_it(duration: float, step: float, times: list[float]):
    """Steps of the length given, then what is left; rounding makes no sliver of a step."""
    assert _times(duration, step) == pytest.approx(times, abs=1e-15) and _times(duration, step)[-1] == duration
