"""The days on which the readings of a run were taken, as its record has them: UTC, over breaks and pauses."""

import sys
from datetime import datetime, timedelta

import msgspec
from msgspec import Struct

from vcfbench.archive.run import Run
from vcfbench.clock import CLOCK_SET
from vcfbench.files import read_file
from vcfbench.steps import Effect, Step


class _Line(Struct, frozen=True):
    """Times in a line of a journal."""

    type: str
    utc: str
    step_kind: str = ""
    t_s: float = 0.0
    end_s: float = 0.0


_LINE = msgspec.json.Decoder(_Line)


def days_of(run: Run) -> tuple[str, str] | None:
    """Return the first and the last day (UTC) of the readings of a run, those taken over from earlier records too.

    A line of the journal is written when its step is over; it began by its bench time sooner, which passes on no
    calendar where the bench is simulated. Where the clock was set meanwhile they are those of all
    lines, by either time of day.

    A run without readings has the day on which it began; None: none is known.
    """
    if (utc := run.header.get("utc")) is None:
        return None
    data = (
        b""
        if run.directory is None
        else read_file(run.directory / "journal.jsonl", "the journal of a run", sys.maxsize)
    )
    clock_set = any(CLOCK_SET in each for each in run.not_checked)
    first: datetime | None = None
    last: datetime | None = None
    for text in data.splitlines():
        try:
            line = _LINE.decode(text)
        except msgspec.DecodeError:  # torn, or none of this program: what is behind it is not known
            break
        kind = Step.kinds.get(line.step_kind)
        measures = line.type in {"step", "readings"} and (kind is None or kind.effect is Effect.MEASURES)
        if not (measures or (clock_set and line.type not in {"amendment", "signature"})):
            continue
        ended, took_s = datetime.fromisoformat(line.utc), 0.0 if run.simulated else line.end_s - line.t_s
        first = min(filter(None, (first, ended - timedelta(seconds=took_s))))
        last = max(filter(None, (last, ended)))  # a clock may have been set back
    began, ended = (first, last) if first and last else (datetime.fromisoformat(str(utc)),) * 2
    return f"{began:%Y-%m-%d}", f"{ended:%Y-%m-%d}"
