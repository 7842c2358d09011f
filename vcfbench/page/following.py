"""Sources of a view: the beginning of a run in this process, or the growing journal of another's."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any

import msgspec
from msgspec import Struct

from vcfbench.archive.output_unit import unit_of_record
from vcfbench.errors import BenchError
from vcfbench.files import shown
from vcfbench.page.view import View
from vcfbench.runs.request import Prepared
from vcfbench.steps import Note
from vcfbench.steps.decode import result_of, step_of
from vcfbench.steps.events import Moved, Paused, StepFailed, StepFinished, WentOn
from vcfbench.typed import typed
from vcfbench.values.kinds import in_words

_AT_ONCE = 1 << 22  # Bytes of a journal that are read at once: a long one must not hold up readers of another


_NO_LINE_OF_OURS = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""Errors from a line that no journal has; msgspec's are ValueErrors."""


def introduce(view: View, prepared: Prepared) -> None:
    """Give a view the name and header of its run before the events."""
    planned, description = prepared.planned(), prepared.description
    view.planned_s = planned.bench_seconds
    view.headings = [each.step.describe() for each in planned.steps if isinstance(each.step, Note)]
    view.about = {
        "run": prepared.procedure.name if prepared.directory is None else prepared.directory.run,
        "procedure": prepared.procedure.name,
        "title": prepared.procedure.title,
        "bench": description.name,
        "simulated": description.simulated,
        "limits": _limits(msgspec.to_builtins(description.limits)),
        "unit": prepared.settings.station.output_unit,
    }
    view.points += prepared.points()
    view.version += 1


class _Reading(Struct, frozen=True, gc=False):
    t_s: float
    voltage_v: float


class _Chunk(Struct, frozen=True):
    readings: list[_Reading]
    device: str = ""


_CHUNK = msgspec.json.Decoder(_Chunk)
_LINE = msgspec.json.Decoder(dict[str, Any])


class JournalFollower:
    """Gives a view the lines of a journal, and each added line."""

    def __init__(self, path: Path) -> None:
        self.view = View()
        self.path = path
        self._offset = 0
        self._began_s = 0.0
        self._device = ""
        self._lock = Lock()

    def read_on(self) -> bool:
        """Take in the lines added since, a few megabytes at most; return True if there is more."""
        with self._lock, self.path.open("rb") as file:
            file.seek(self._offset)
            data = file.read(_AT_ONCE)
            end = data.rfind(b"\n") + 1
            if not end and len(data) == _AT_ONCE:  # one line that is longer still
                data += file.readline()
                end = len(data) if data.endswith(b"\n") else 0
            for line in data[:end].splitlines():
                with suppress(*_NO_LINE_OF_OURS):  # runs show says what is wrong
                    self._take(line)
            self._offset += end
            return bool(end) and len(data) >= _AT_ONCE

    def _take(self, line: bytes) -> None:
        if line.startswith(b'{"type":"readings"'):
            chunk = _CHUNK.decode(line)
            self._device = self._device or chunk.device
            if chunk.device == self._device:  # of several devices the first is shown
                self._read(chunk.readings)
            return
        values = _LINE.decode(line)
        match values.get("type"):
            case "header":
                self._began_s = float(values.get("began_s") or 0.0)
                bench, planned_s = values.get("bench") or {}, values.get("planned_s")
                self.view.planned_s = planned_s if isinstance(planned_s, float) else None
                self.view.about = {
                    "run": values.get("run") or shown(self.path.parent),
                    "procedure": values.get("procedure"),
                    "title": values.get("title") or "",
                    "bench": bench.get("name"),
                    "simulated": values.get("simulated"),
                    "limits": _limits(bench.get("limits") or {}),
                    "unit": unit_of_record(values),
                    "began_utc": values.get("utc"),
                }
                self.view.version += 1
            case "step":
                found: Any = values.get("result")
                found = found if isinstance(found, dict) else {}
                of_each = found.get("results")
                if isinstance(of_each, dict) and of_each:
                    found = next(iter(of_each.values()))
                own = found.get("readings")
                self._read(typed(own if isinstance(own, list) else [], list[_Reading]))
                step: Any = step_of(values)  # or one that is not known here, which describes itself as well
                result: Any = result_of(values)
                again = tuple(values.get("asked_again", ()))
                self.view.handle(StepFinished(values["n"], values["end_s"], step, result, again))
            case "paused":
                self.view.handle(Paused(values["n"], values["t_s"], values["by"]))
            case "went_on":
                took_s, moved = values["t_s"] - self.view.t_s, typed(values.get("moved"), Moved | None)
                self.view.handle(WentOn(values["n"], values["t_s"], values["by"], values["waited_s"], took_s, moved))
            case "error":
                step = step_of(values)
                self.view.handle(StepFailed(values["n"], values["t_s"], step, BenchError(str(values["error"]))))
            case "footer":
                error = (values.get("error") or {}).get("what")
                self.view.finished({"status": values["status"], "error": error})

    def _read(self, readings: list[_Reading]) -> None:
        if readings:
            began_s = self._began_s
            self.view.read([each.t_s - began_s for each in readings], [each.voltage_v for each in readings])


def _limits(limits: Mapping[str, Any]) -> list[list[str]]:
    """Return the limits, in words and numbers with their unit."""
    named = ((*in_words(key), value) for key, value in limits.items() if isinstance(value, int | float))
    return [[words, f"{value:g} {unit}".rstrip()] for words, unit, value in named]
