"""A live scene with sliders and choices on its page: what they send is checked, and the answer goes back as a picture."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from rbd.arrays import as_float
from rbd.displayed import Displayed
from rbd.errors import InputError, RbdError
from rbd.errors.inputs import check_kind
from rbd.model.data_pool import renewed_after_fork
from rbd.visual.pages.browser import Closing
from rbd.visual.scene import Scene
from rbd.visual.shapes import round_number

LARGEST_MESSAGE = 4000
"""Largest message of a page that is read, in characters."""
LARGEST_VALUE = 1e12
MOST_NAMES, LONGEST_NAME = 200, 80
_STEPS = 200


@dataclass(frozen=True, slots=True)
class Slider(Displayed):
    """A number that the page's visitor sets between two bounds.

    Attributes:
        name: Its name on the page, and in the values.
        low: Least value.
        high: Largest value.
        value: At first.
        unit: Written after the number.
        step: Distance of neighbouring values; by default the round number nearest to 1/200 of the range.

    Raises:
        InputError: no name, numbers that are not finite, low not below high, a value outside.

    Example:
        >>> rbd.visual.Slider("push", 0.0, 200.0, 50.0, unit="N").step
        1.0
    """

    name: str
    low: float
    high: float
    value: float
    unit: str = ""
    step: float | None = None

    def __post_init__(self) -> None:
        """Check, and fill in the step."""
        check_name(self.name)
        if not isinstance(self.unit, str) or len(self.unit) > LONGEST_NAME:
            raise InputError(f"the unit of {self.name!r} is {self.unit!r:.80}; expected a short text.")
        for what in ("low", "high", "value"):
            number = as_float(getattr(self, what))
            if not abs(number) <= LARGEST_VALUE:
                raise InputError(f"{what} of {self.name!r} is {getattr(self, what)!r:.80}; expected a finite number.")
            object.__setattr__(self, what, number)
        if not self.low < self.high or not self.low <= self.value <= self.high:
            raise InputError(
                f"{self.name!r} goes from {self.low:g} to {self.high:g} and starts at {self.value:g}; expected low < high and "
                "a value between them."
            )
        step = round_number((self.high - self.low) / _STEPS) if self.step is None else as_float(self.step)
        if not 0.0 < step <= self.high - self.low:
            raise InputError(f"step of {self.name!r} is {self.step!r:.80}; expected a number above 0, within the range.")
        object.__setattr__(self, "step", step)

    def read(self, given: object) -> float | None:
        """A value from outside, cut at the bounds; None for what is no number."""
        number = as_float(given)
        return None if math.isnan(number) else min(max(number, self.low), self.high)

    def data(self) -> dict[str, object]:
        """What the page needs, without the value."""
        return {"kind": "slider", "name": self.name, "low": self.low, "high": self.high, "unit": self.unit, "step": self.step}


@dataclass(frozen=True, slots=True)
class Choice(Displayed):
    """One of some names that the page's visitor picks.

    Attributes:
        name: Its name on the page, and in the values.
        options: What there is to pick.
        value: At first; by default the first option.

    Raises:
        InputError: no name, no options or two alike, a value that is none of them.

    Example:
        >>> rbd.visual.Choice("law", ("coulomb", "convex")).value
        'coulomb'
    """

    name: str
    options: tuple[str, ...]
    value: str = ""

    def __post_init__(self) -> None:
        """Check, and fill in the value."""
        check_name(self.name)
        given: Any = self.options
        options = () if isinstance(given, str) or not isinstance(given, Sequence) else tuple(given)
        if not 1 <= len(options) <= MOST_NAMES or not all(isinstance(o, str) and 0 < len(o) <= LONGEST_NAME for o in options):
            raise InputError(f"options of {self.name!r} are {given!r:.80}; expected 1 to {MOST_NAMES} short names in a list.")
        if len(set(options)) < len(options):
            raise InputError(f"options of {self.name!r} name one twice: {', '.join(options):.200}.")
        value = options[0] if isinstance(self.value, str) and not self.value else self.value
        if not isinstance(value, str) or value not in options:
            raise InputError(f"{self.name!r} starts at {value!r:.80}; expected one of {', '.join(options):.300}.")
        object.__setattr__(self, "options", options)
        object.__setattr__(self, "value", value)

    def read(self, given: object) -> str | None:
        """A value from outside, if it is an option; else None."""
        return given if isinstance(given, str) and given in self.options else None

    def data(self) -> dict[str, object]:
        """What the page needs, without the value."""
        return {"kind": "choice", "name": self.name, "options": list(self.options)}


Control: TypeAlias = Slider | Choice


@dataclass(frozen=True, slots=True)
class Request:
    """What a page asks for.

    Attributes:
        values: {control: its value}, of those that are to change; all within their bounds.
        asked: Which page asks, and its how many-th question this is: given back with the answer.
    """

    values: Mapping[str, float | str]
    asked: tuple[int, int]


def check_name(name: object) -> None:
    """Refuse what is no short name.

    Raises:
        InputError: it is none.
    """
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME:
        raise InputError(f"a control's name is {name!r:.80}; expected a short text, as 'push'.")


def checked_controls(controls: object) -> dict[str, Control]:
    """{name: control}.

    Raises:
        InputError: what is no list of controls, or two of one name.
    """
    given: Any = [controls] if isinstance(controls, Slider | Choice) else controls
    if not isinstance(given, Sequence | Iterator) or isinstance(given, str):
        raise InputError(f"controls are {controls!r:.80}; expected a list of rbd.visual.Slider and rbd.visual.Choice.")
    out: dict[str, Control] = {}
    for control in given:
        if not isinstance(control, Slider | Choice):
            raise InputError(f"controls hold {control!r:.80}; expected rbd.visual.Slider or rbd.visual.Choice.")
        if control.name in out:
            raise InputError(f"two controls are named {control.name!r}; expected different names.")
        out[control.name] = control
    if not 1 <= len(out) <= MOST_NAMES:
        raise InputError(f"there are {len(out)} controls; expected 1 to {MOST_NAMES}.")
    return out


def read_request(message: str, controls: Mapping[str, Control]) -> Request | None:
    """What a message asks for; None if it asks for nothing that there is.

    Unknown names and values that are none are ignored, numbers are cut at their bounds. It raises nothing, for any text.

    Args:
        message: JSON, as {"set": {name: value}, "asked": [page, number]}.
        controls: {name: control} of what there is.
    """
    if len(message) > LARGEST_MESSAGE:
        return None
    try:
        told = json.loads(message)
    except (ValueError, RecursionError):
        return None
    if not isinstance(told, dict) or not isinstance(wanted := told.get("set"), dict):
        return None
    values = {}
    for name, given in wanted.items():
        if name in controls and (value := controls[name].read(given)) is not None:
            values[name] = value
    return Request(values, _asked(told.get("asked"))) if values else None


def _asked(given: Any) -> tuple[int, int]:
    if isinstance(given, list) and len(given) == 2 and all(type(n) is int and 0 <= n < 2**32 for n in given):
        return given[0], given[1]
    return 0, 0


SETTLE_SECONDS = 0.06
"""Later steps of an answer are computed when nothing new has been asked for so long [s]."""
LONGEST_TEXT = 2000
_OURSELVES = (0, 0)


@dataclass(frozen=True, slots=True)
class Verdict(Displayed):
    """What the page says next to its sliders.

    Attributes:
        title: In a few words, as "Holds".
        lines: More, below it.
        good: Whether it is well: green; False: red, and the robot is drawn in grey; None: neither.

    Raises:
        InputError: a title that is no text, lines that are no list of texts, `good` that is neither of the three.

    Example:
        >>> rbd.visual.Verdict("Holds", ("friction used: 41 %",), True).title
        'Holds'
    """

    title: str
    lines: tuple[str, ...] = ()
    good: bool | None = None

    def __post_init__(self) -> None:
        """Check."""
        given: Any = self.lines
        check_kind("the title of a verdict", self.title, str, "text")
        if not isinstance(given, list | tuple) or not all(isinstance(line, str) for line in given):
            raise InputError(f"the lines of a verdict are {given!r:.80}; expected texts in a list.")
        check_kind("good", self.good, bool | None, "True, False or None")
        object.__setattr__(self, "lines", tuple(given))

    def data(self) -> dict[str, object]:
        """What the page needs."""
        return {"title": self.title[:LONGEST_TEXT], "lines": [line[:LONGEST_TEXT] for line in self.lines], "good": self.good}


Values: TypeAlias = Mapping[str, Any]
Answered: TypeAlias = Verdict | Iterator[Verdict | None] | None


class Explorer(Displayed, Closing):
    """A scene with sliders: made by `explore`. Use it as a context, or close it; the scene stays open.

    Args:
        scene: Where the answers are drawn.
        controls: What the page shows.
        answer: See `explore`.

    Example:
        >>> with rbd.visual.Scene(rbd.testing.box(mass=10.0)) as scene:
        ...     with rbd.visual.explore(scene, rbd.visual.Slider("lift", 0.0, 1.0, 0.0), lambda values: None) as page:
        ...         print(page.values, page.verdict)
        {'lift': 0.0} None
    """

    def __init__(self, scene: Scene, controls: Mapping[str, Control], answer: Callable[[Values], Answered]) -> None:
        self._scene, self._controls, self._answer = scene, controls, answer
        self._values: dict[str, float | str] = {name: control.value for name, control in controls.items()}
        self._news = threading.Condition()
        self._asked: tuple[int, int] | None = None
        self._busy = self._closed = False
        self.verdict: Verdict | None = None
        """What the last answer said."""
        self._said = ""
        for _ in self._steps(dict(self._values), _OURSELVES):  # an answer that fails now is the caller's error
            pass
        listed = [control.data() for control in controls.values()]
        scene.recorder.post("controls", json.dumps({"controls": {"listed": listed}}))
        scene.recorder.post("answer", self._said)  # after its controls, for pages that are opened later
        scene.recorder.answer_by(self._receive)
        renewed_after_fork(self)
        self._thread = threading.Thread(target=self._work, name="rbd-explorer", daemon=True)
        self._thread.start()

    @property
    def values(self) -> dict[str, float | str]:
        """{control: its value}, as it is now set."""
        with self._news:
            return dict(self._values)

    @property
    def url(self) -> str:
        """Address of the page, on 127.0.0.1 only."""
        return self._scene.url

    def open(self) -> str:
        """Open the page in the default browser; returns its address."""
        return self._scene.open()

    def set(self, values: Values) -> None:
        """Set controls as a page would; all pages follow. The answer comes later: see `wait`.

        Raises:
            InputError: there is no such control, or it does not take the value.
        """
        if not isinstance(values, Mapping):
            raise InputError(f"values are {values!r:.80}; expected {{name: value}}.")
        read = {}
        for name, given in values.items():
            if name not in self._controls:
                raise InputError(f"there is no control {name!r:.80}; expected {', '.join(self._controls)}.")
            if (value := self._controls[name].read(given)) is None:
                raise InputError(f"{name} is {given!r:.80}; expected a value that the page could set.")
            read[name] = value
        self._ask(Request(read, _OURSELVES))

    def wait(self, seconds: float = 10.0) -> bool:
        """Wait until everything asked for is answered; whether it is."""
        with self._news:
            return self._news.wait_for(lambda: self._closed or (self._asked is None and not self._busy), seconds)

    def close(self) -> None:
        """Answer no more. The page keeps its picture."""
        self._scene.recorder.answer_by(None)
        with self._news:
            self._closed = True
            self._news.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def renew_after_fork(self) -> None:
        """In a forked child: the thread that answers stays with the parent."""
        self._news, self._closed = threading.Condition(), True

    def _receive(self, message: str) -> None:
        if (request := read_request(message, self._controls)) is not None:
            self._ask(request)

    def _ask(self, request: Request) -> None:
        """Newer values replace those that wait."""
        with self._news:
            self._values.update(request.values)
            self._asked = request.asked
            self._news.notify_all()

    def _work(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._closed or self._asked is not None)
                if self._closed:
                    return
                values, asked = dict(self._values), self._asked
                self._asked, self._busy = None, True
            assert asked is not None
            try:
                for _ in self._steps(values, asked):
                    with self._news:
                        if self._news.wait_for(lambda: self._closed or self._asked is not None, SETTLE_SECONDS):
                            break
            except RbdError as error:
                self._tell(values, asked, Verdict("No answer", (str(error),), False))
            except Exception as error:  # the page says it: nobody looks at this thread
                self._tell(values, asked, Verdict("The answer failed", (f"{type(error).__name__}: {error}",), False))
            with self._news:
                self._busy = False
                self._news.notify_all()

    def _steps(self, values: Values, asked: tuple[int, int]) -> Iterator[None]:
        """Computes and sends an answer, step by step."""
        started = time.perf_counter()
        found = self._answer(values)
        steps: Iterable[Verdict | None] = found if isinstance(found, Iterator) else (found,)
        for verdict in steps:
            check_kind("the answer", verdict, Verdict | None, "a rbd.visual.Verdict, or None")
            self._tell(values, asked, verdict, 1e3 * (time.perf_counter() - started))
            yield

    def _tell(self, values: Values, asked: tuple[int, int], verdict: Verdict | None, took_ms: float = 0.0) -> None:
        self.verdict = verdict
        said = None if verdict is None else verdict.data()
        answer = {"values": dict(values), "asked": asked, "verdict": said, "ms": round(took_ms, 2)}
        self._said = json.dumps({"answer": answer})
        self._scene.recorder.post("answer", self._said)


def explore(scene: Scene, controls: Iterable[Control] | Control, answer: Callable[[Values], Answered]) -> Explorer:
    """Put sliders and choices onto the page of a live scene; `answer` draws what they ask for, while they move.

    Only the newest values are answered. What is drawn is compared with what the page has: little is sent. Values of pages are
    checked; names that there are not, and what is no number, are ignored.

    Args:
        scene: Where the answers are drawn; show something first, or let the first answer do it.
        controls: `Slider` and `Choice`, of different names.
        answer: Of {name: value}: draws, with `scene.show` and its kin, and returns a `Verdict` or None. It runs in a thread of
            its own, once at a time. As a generator it answers in steps: what it yields is sent, and when newer values have come
            meanwhile it is not continued. An error is told on the page; that of the first answer is raised here.

    Returns:
        The explorer; `url` is its address on 127.0.0.1, `open()` shows it in the browser, `close()` ends it.

    Raises:
        InputError: no scene, no controls, no function, or an answer that is none.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> def answer(values):
        ...     wind = rbd.ExternalForce("base_link", (0.0, values["wind"], 0.0))
        ...     held = rbd.hold(state, feet, external=wind)
        ...     scene.show(state, held, external=wind)
        ...     return rbd.visual.Verdict(f"Holds with {abs(held.tau).max():.2f} N m", (), True)
        >>> with rbd.visual.Scene(solo) as scene:
        ...     wind = rbd.visual.Slider("wind", -5.0, 5.0, 0.0, unit="N")
        ...     with rbd.visual.explore(scene, [wind], answer) as page:
        ...         page.set({"wind": 4.0})
        ...         print(page.wait(), page.values, page.verdict.title)
        True {'wind': 4.0} Holds with 0.78 N m
    """
    check_kind("scene", scene, Scene, "a rbd.visual.Scene")
    if not callable(answer):
        raise InputError(f"answer is {answer!r:.80}; expected a function of the controls' values.")
    return Explorer(scene, checked_controls(controls), answer)
