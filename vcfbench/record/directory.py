"""Where records lie: one directory a run, named by its start, procedure and six random hexadecimal digits."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.record.journal import JournalRecord, read_journal

if TYPE_CHECKING:
    from pathlib import Path

__all__ = ["RunDirectory", "create_run", "find_run", "list_runs"]


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """The directory of one run: `20260821T142530Z-turntable-0a1b2c`."""

    path: Path

    @property
    def run(self) -> str:
        """The run's name."""
        return self.path.name

    @property
    def journal(self) -> Path:
        """The journal; everything else in the directory can be made again from it."""
        return self.path / "journal.jsonl"

    def read(self) -> JournalRecord:
        """Read the journal."""
        return read_journal(self.journal)


def create_run(runs: Path, procedure: str) -> RunDirectory:
    """Make the directory of a new run under `runs`.

    Raises:
        ConfigError: it cannot be made.
    """
    path = runs / f"{utc_now():%Y%m%dT%H%M%SZ}-{procedure}-{secrets.token_hex(3)}"
    try:
        path.mkdir(parents=True)
    except OSError as error:
        raise ConfigError(f"{path}: no record can be kept there: {error.strerror}", hint="choose --runs") from error
    return RunDirectory(path)


def list_runs(runs: Path) -> tuple[RunDirectory, ...]:
    """Return the runs under `runs`, oldest first; none when the directory is not there."""
    return tuple(RunDirectory(journal.parent) for journal in sorted(runs.glob("*/journal.jsonl"), key=_age))


def _age(journal: Path) -> tuple[str, int]:
    """Return what sorts runs by their start, those of one second by their end."""
    return journal.parent.name[: len("20260821T142530Z")], journal.stat().st_mtime_ns


def find_run(runs: Path, name: str) -> RunDirectory:
    """Return the one run whose name begins or ends with `name`, or `last`.

    Raises:
        ConfigError: there is none, or more than one.
    """
    known = list_runs(runs)
    if name == "last" and known:
        return known[-1]
    exact = [run for run in known if run.run == name]
    found = exact or [run for run in known if run.run.startswith(name) or run.run.endswith(name)]
    if len(found) != 1:
        what = f"{len(found)} runs are called" if found else "there is no run"
        raise ConfigError(f"{runs}: {what} {name!r}", hint="vcfbench runs list shows them")
    return found[0]
