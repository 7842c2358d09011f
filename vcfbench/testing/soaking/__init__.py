"""Runs under faults drawn by seed, on simulated benches in virtual time: a failure is one line to repeat.

::

    for verdict in soak(range(129, 130)):
        print(verdict.draw.describe(), verdict.wrong)

A seed draws a bench, a procedure, and up to five faults, kills, signals, clocks that are set and disks that are full
(`draw`). Its clean run comes first, then the program is started, killed and started again (`trial`), and after the last
fault once more. What must be true after each is in `judge`.
"""

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.records.journal import JournalRecord, read_journal
from vcfbench.records.schema import Status
from vcfbench.testing.soaking.draw import Draw, drawn
from vcfbench.testing.soaking.judge import (
    VALUE_FAULTS,
    reaches_of,
    shifted_throughout,
    wrong_of,
    wrong_record,
    wrong_values,
)
from vcfbench.testing.soaking.trial import Clean, Ended, start

_MEMORY = Path("/dev/shm")  # noqa: S108  # Linux has it, and directories in it are made by tempfile
_IN_ONE_PIECE, _SAME_END = "cannot be resumed: a warm-up", "it would end with the same error"


class Verdict(Struct, frozen=True):
    """Faults found in a draw; none: it held. `ends` has the end of each start in words."""

    draw: Draw
    wrong: tuple[str, ...]
    ends: tuple[str, ...] = ()


def soak(seeds: Iterable[int]) -> Iterator[Verdict]:
    """Yield the verdict on each seed."""
    clean: tuple[Draw, Clean] | None = None
    for draw in map(drawn, seeds):
        without = _without_happenings(draw)
        if clean is None or clean[0] != without:
            clean = without, cleaned(draw)
        yield tried(draw, clean[1])


def _without_happenings(draw: Draw) -> Draw:
    return replace(draw, seed=0, happenings=())


def cleaned(draw: Draw) -> Clean:
    """Do the clean run of a draw."""
    with _folder() as folder:
        ended = start(_without_happenings(draw), 0, Clean(), folder, None)
        clean = Clean(ended.end_s, ended.operations)
        wrong = tuple(f"without a fault: {each}" for each in wrong_of(ended, clean))
        return replace(clean, values={} if ended.run is None else reaches_of(ended.run.results), wrong=wrong)


def tried(draw: Draw, clean: Clean | None = None) -> Verdict:
    """Try a draw: its clean run, where that is not given, then all its starts, then once more without a fault."""
    clean = cleaned(draw) if clean is None else clean
    if clean.wrong:
        return Verdict(draw, clean.wrong)
    with _folder() as folder:
        lives = _Lives(draw, clean, folder)
        lives.go_through()
    return Verdict(draw, tuple(lives.wrong), tuple(lives.said))


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="soak", dir=_MEMORY if _MEMORY.is_dir() else None) as name:
        yield Path(name)


class _Lives:
    """The starts of one draw, one after the other."""

    def __init__(self, draw: Draw, clean: Clean, folder: Path) -> None:
        self.wrong: list[str] = []
        self.said: list[str] = []
        self._draw, self._clean, self._folder = draw, clean, folder
        self._earlier: Path | None = None
        """The record to go on with."""
        self._spoilt = self._lost = self._shifted = False

    def go_through(self) -> None:
        """Start the program as often as drawn, and, unless that is over, once without a fault.

        That must end it, or refuse what a fault has spoilt before.
        """
        for life in range(self._draw.lives):
            if self._is_over(life):
                return
        if not self._is_over(self._draw.lives) and not self._spoilt:
            self.wrong.append("it is not complete after a start without a fault")

    def _is_over(self, life: int) -> bool:
        """Start the program once; return True if nothing is left to be done, or nothing can be."""
        earlier, known = self._earlier, set(self._folder.iterdir())
        before = self._read(earlier)
        ended = start(self._draw, life, self._clean, self._folder, earlier)
        self.said.append(_words(ended))
        if before is not None and isinstance(ended.error, ConfigError) and not ended.began:
            said = str(ended.error)
            fine = _IN_ONE_PIECE in said or (self._spoilt and _SAME_END in said)
            if not (fine or (self._lost and before.damage is not None) or ended.disk_troubles):
                self.wrong.append(f"it cannot be resumed: {said}")
            return not ended.disk_troubles
        made = [each for each in self._folder.iterdir() if each not in known and (each / "journal.jsonl").exists()]
        record = self._read(made[0]) if made else None
        if before is None or not before.points:
            self._shifted = shifted_throughout(ended)
        elif ended.measured_s is not None:  # windows of two starts, which differ by the offset
            self._shifted = False
        wrong = [
            *wrong_of(ended, self._clean, spoilt=self._spoilt),
            *wrong_values(ended, self._clean.values, shifted=self._shifted),
        ]
        if made and record is not None and record.header and not _is_short(record):
            if before is not None:
                ended.points[:0] = [each.as_json() for each in before.points]
            self._earlier = made[0]
        if record is None or not _is_short(record):
            wrong += wrong_record(ended, record, self._draw)
        self.wrong += [f"start {life + 1}: {each}" for each in wrong]
        self._lost = ended.died == "power cut" and not self._draw.synchronised
        kinds = {each.fault.kind for each in ended.faults if each.fault is not None}
        self._spoilt = self._spoilt or bool(kinds & VALUE_FAULTS)
        complete = record is not None and record.status is Status.COMPLETE
        return complete or bool(self.wrong) or (ended.error is None and not ended.died)

    def _read(self, directory: Path | None) -> JournalRecord | None:
        with suppress(ConfigError):
            return None if directory is None else read_journal(directory / "journal.jsonl")
        return None


def _is_short(record: JournalRecord) -> bool:
    """Return True if a record was cut before it had taken over the one that it goes on with, which counts then."""
    resumed_from = record.header.get("resumed_from") or {}
    return len(record.steps) < int(resumed_from.get("steps", 0))


def _words(ended: Ended) -> str:
    if ended.died:
        return f"{ended.died} at {ended.end_s:.2f} s"
    if ended.error is not None:
        return f"{type(ended.error).__name__} at {ended.end_s:.2f} s: {ended.error}"
    return f"complete at {ended.end_s:.2f} s"


def shrunk(verdict: Verdict) -> Verdict:
    """Return the smallest draw that still fails: happenings are taken away one by one as long as one can be."""
    smaller, clean = True, cleaned(verdict.draw)
    while smaller:
        smaller = False
        for number in range(len(verdict.draw.happenings)):
            left = (*verdict.draw.happenings[:number], *verdict.draw.happenings[number + 1 :])
            again = tried(replace(verdict.draw, happenings=left), clean)
            if again.wrong:
                verdict, smaller = again, True
                break
    return verdict
