"""The operator's panel: a batch whose devices a person starts in a browser, one after another."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import StrEnum
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Lock
from typing import Any, Final

from vcfbench.archive.batch_sheet import SheetRow, batch_sheet
from vcfbench.errors import ConfigError
from vcfbench.interfaces import Request
from vcfbench.page.parts import parts_of
from vcfbench.page.view import View
from vcfbench.runs.batch import Batch
from vcfbench.safety.signals import StopSignals

_LOOKS_S: Final = 0.5
"""A signal that comes just before a wait does not end it: so often it is looked for, wall time."""


class PanelState(StrEnum):
    """State of the panel; compares with the word."""

    SERIAL = "serial"
    """Somebody types or scans the serial number of the next device."""
    MOUNTING = "mounting"
    """Somebody mounts the device and starts."""
    MEASURING = "measuring"
    ASKING = "asking"
    """Amid a run somebody does by hand what the page asks for."""
    VERDICT = "verdict"
    """The last device is judged, and the next one can be named."""
    NOT_SAFE = "not safe"
    """The bench was left live: nothing is started any more."""


class Panel:
    """State of the panel. Browsers name a device and start it; the thread that measures waits for that.

    Every method of a browser may come at any time, from any thread: one that does not fit the state is a ConfigError.
    """

    def __init__(self, batch: Batch, runs: Path) -> None:
        self._batch, self._runs = batch, runs
        self._lock = Lock()
        self._state = PanelState.SERIAL
        self._serial = ""
        self._verdict: dict[str, Any] | None = None
        self._asked = ""
        self._started: SimpleQueue[str] = SimpleQueue()
        self._answers: SimpleQueue[str] = SimpleQueue()
        self._run: dict[str, Any] | None = None
        self._failed = dict[str, str]()
        """Devices that could not be measured, and why."""
        self._sheet: list[dict[str, Any]] = []
        self._of_run: View | None = None
        self._draw_sheet()

    def name(self, serial: str) -> None:
        """Name the next device; it is checked against the limits of the bench before it is mounted.

        Raises:
            ConfigError: another one is being measured, this one is already, or the plan does not name it.
            BenchError: a run of the batch cannot be made with it.
        """
        self._require(PanelState.SERIAL, PanelState.MOUNTING, PanelState.VERDICT)
        if not (serial := serial.strip()):
            raise ConfigError("expected a serial number, got an empty one")
        if self._batch.devices and serial not in self._batch.devices:
            raise ConfigError(f"{serial} is not in the plan: {', '.join(self._batch.devices)}")
        if not self._batch.left(serial, self._runs):
            raise ConfigError(f"{serial} is measured already")
        self._batch.check(serial, self._runs)
        with self._lock:
            self._require(PanelState.SERIAL, PanelState.MOUNTING, PanelState.VERDICT)
            self._serial, self._state, self._verdict = serial, PanelState.MOUNTING, None

    def start(self) -> None:
        """Measure the device that was named: it is mounted."""
        with self._lock:
            self._require(PanelState.MOUNTING)
            self._state, self._run = PanelState.MEASURING, None
            self._started.put(self._serial)

    def answer(self, words: str) -> None:
        """Mark the question as answered, with `words` as the answer."""
        with self._lock:
            self._require(PanelState.ASKING)
            self._state, self._asked = PanelState.MEASURING, ""
            self._answers.put(words.strip())

    def _require(self, *states: PanelState) -> None:
        if self._state not in states:
            raise ConfigError(f"the panel is in the state {self._state.value}: reload it")

    def next_device(self) -> str:
        """Wait until the operator starts a device, and return its serial number."""
        return _taken(self._started)

    def person(self, signals: StopSignals) -> Callable[[Request], str]:
        """Return the person at the panel, as a run asks for one; `signals` end the waiting."""

        def ask(request: Request) -> str:
            with self._lock:
                self._answers = SimpleQueue()  # what was asked before may have been broken off
                self._state, self._asked = PanelState.ASKING, request.words
            return signals.attend(partial(_taken, self._answers)) or ("" if request.types else "done")

        return ask

    def begin(self, procedure: str, number: int, of: int, view: View) -> None:
        """Take in that a run of the device begins."""
        with self._lock:
            self._state, self._asked, self._of_run = PanelState.MEASURING, "", view
            self._run = {"procedure": procedure, "number": number, "of": of}

    @property
    def measures(self) -> bool:
        """Return True from the first run of a device until it is judged, also between two runs."""
        return self._run is not None

    def judge(self, word: str, why: str = "") -> None:
        """Take in the verdict on the device: one word, and the reason."""
        self._failed |= {self._serial: why} if word == "ERROR" else {}
        own = [row.run for row in self._draw_sheet() if row.device == self._serial and row.run]
        with self._lock:
            self._state = PanelState.NOT_SAFE if word == "NOT SAFE" else PanelState.VERDICT
            self._asked, self._run = "", None
            self._verdict = {"word": word, "why": why, "run": own[-1] if own else None}

    def _draw_sheet(self) -> Sequence[SheetRow]:
        left_out = self._batch.left_out(self._runs)
        rows = self._batch.rows(self._runs, self._failed, left_out)
        tried = any(not row.waits for row in rows)
        self._sheet = parts_of(batch_sheet(self._batch.name, rows, left_out)) if tried else []
        left = {row.device for row in rows if not row.passed}
        self._left = [serial for serial in self._batch.devices if serial in left]
        return rows

    def shown(self) -> dict[str, Any]:
        """Return the state for a browser."""
        with self._lock:
            run, view = self._run, self._of_run
            state = {
                "state": self._state,
                "batch": self._batch.name,
                "bench": self._batch.description.name,
                "simulated": self._batch.description.simulated,
                "operator": self._batch.operator,
                "procedures": [each.procedure.name for each in self._batch.runs],
                "left": self._left,
                "serial": self._serial,
                "asked": self._asked,
                "verdict": self._verdict,
                "sheet": self._sheet,
            }
        if run is not None and view is not None:
            begun_s = view.t_s if view.began_s is None else view.began_s
            doing = "" if view.doing is None else view.doing["what"]
            progress = {
                "run": view.about.get("run", ""),
                "t_s": view.t_s - begun_s,
                "planned_s": view.planned_s,
                "doing": doing,
                "control": view.control,
            }
            state["run"] = {**run, **progress}
        return state


def _taken(words: SimpleQueue[str]) -> str:
    while True:
        with suppress(Empty):
            return words.get(timeout=_LOOKS_S)
