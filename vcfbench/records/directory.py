"""Directories of records: one a run, named by its start, procedure and six random hexadecimal digits."""

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from msgspec import Struct

from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.files import shown, try_lock
from vcfbench.records.journal import JournalRecord, read_header, read_journal

_STAMP = "%Y%m%dT%H%M%SZ"
_STAMP_LENGTH = len("20260821T142530Z")
_STAMPED = re.compile(r"\d{8}T\d{6}Z-")
_CLOCKS_DIFFER = timedelta(minutes=1)  # Two hosts that share a directory need not agree to the second
_TRIAL_BYTES = 65_536


class RunDirectory(Struct, frozen=True):
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

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Lock this run against a second resume, if the file system has locks.

        Raises:
            ConfigError: another program does so already.
        """
        on_windows = os.name == "nt"  # which opens no directory
        descriptor = None
        try:
            with suppress(OSError):
                path, flags = (self.journal, os.O_RDWR) if on_windows else (self.path, os.O_RDONLY)
                descriptor = os.open(path, flags)
                if not try_lock(descriptor):
                    raise ConfigError(f"{self.run} is being resumed already, by another program")
            yield
        finally:
            if descriptor is not None:
                os.close(descriptor)

    def discard(self) -> None:
        """Remove the directory, if nothing was recorded."""
        with suppress(OSError):  # something is in it, or it cannot be taken away: it does no harm
            self.path.rmdir()


def create_run(runs: Path, procedure: str) -> RunDirectory:
    """Make the directory of a new run under `runs`, and check that a record can be kept there.

    Raises:
        ConfigError: it cannot be made, or takes no files: no right to, disk full; or a run there began in the future,
            so the clock was set back, and the newest run of a device would count as an earlier one.
    """
    now = utc_now()
    if later := _latest_after(runs, now + _CLOCKS_DIFFER):
        raise ConfigError(
            f"{shown(runs)}: {later} began in the future; the clock of this computer says {now:%Y-%m-%d %H:%M:%S} UTC",
            hint="set the clock, or choose --runs: runs are in the order of their times",
        )
    path = runs / f"{now:{_STAMP}}-{procedure}-{secrets.token_hex(3)}"
    try:
        path.mkdir(parents=True)
        # Write a file as long as a short record, and take it away; take the directory away too when that fails
        trial = path / "trial"
        try:
            with trial.open("wb") as file:
                file.write(bytes(_TRIAL_BYTES))
                file.flush()
                os.fsync(file.fileno())
        except OSError:
            with suppress(OSError):
                trial.unlink(missing_ok=True)
                path.rmdir()
            raise
        trial.unlink()
    except OSError as error:
        raise ConfigError(f"{path}: no record can be written there: {error.strerror}", hint="choose --runs") from error
    return RunDirectory(path)


def _latest_after(runs: Path, instant: datetime) -> str:
    """Return the name with the latest time after `instant`; empty without one."""
    after, names = f"{instant:{_STAMP}}", list[str]()
    with suppress(OSError):
        names = [each for each in os.listdir(runs) if each[:_STAMP_LENGTH] > after]  # noqa: PTH208  # of thousands
    return max((each for each in names if _STAMPED.match(each)), default="")


def list_runs(runs: Path) -> tuple[RunDirectory, ...]:
    """Return the runs under `runs`, oldest first by the start in their headers; none when the directory is not there.

    Names can be changed and files copied, so the name's stamp and the file's time count only where there is no header.
    """
    return tuple(sorted(recorded_runs(runs), key=lambda run: (_began(run), _changed_ns(run), run.run)))


def recorded_runs(runs: Path) -> Iterator[RunDirectory]:
    """Yield the runs under `runs`, in no order, those too that may not be read.

    Raises:
        ConfigError: `runs` is there and cannot be read.
    """
    try:
        with os.scandir(runs) as found:  # there are thousands: globs of paths take four times the time
            for each in found:
                try:
                    os.stat(f"{each.path}/journal.jsonl")  # noqa: PTH116
                except PermissionError:
                    if not _STAMPED.match(each.name):
                        continue
                except OSError:
                    continue
                yield RunDirectory(runs / each.name)
    except (FileNotFoundError, NotADirectoryError):
        return
    except OSError as error:
        words = f"{shown(runs)}: the runs there cannot be listed: {error.strerror}"
        raise ConfigError(words, hint="choose --runs, or ask its owner for the right to read") from error


def _changed_ns(run: RunDirectory) -> int:
    try:
        return run.journal.stat().st_mtime_ns
    except OSError:  # gone since, or a link to nowhere: reading it will say so
        return 0


def _began(run: RunDirectory) -> datetime:
    try:
        return began(run, read_header(run.journal).get("utc"))
    except ConfigError:
        return began(run, None)


def began(run: RunDirectory, utc: object) -> datetime:
    """Return when a run began: as its header has `utc`, or else by its name, or else its file."""
    for text in (str(utc), run.run[:_STAMP_LENGTH]):
        with suppress(ValueError):
            instant = datetime.fromisoformat(text)
            return instant if instant.tzinfo is not None else instant.replace(tzinfo=UTC)
    return datetime.fromtimestamp(_changed_ns(run) / 1e9, UTC)


def find_run(runs: Path, name: str) -> RunDirectory:
    """Return the one run whose name begins or ends with `name`, or for `last` the run that began last.

    Raises:
        ConfigError: there is none, or more than one, or which is the last cannot be known: the newest lies in the
            future, so the clock was set back since it began.
    """
    if not name:
        raise ConfigError(f"{shown(runs)}: expected the name of a run, its beginning or end, or 'last'")
    if name == "last" and (known := list_runs(runs)):
        newest, started = known[-1], _began(known[-1])
        if started > utc_now() + _CLOCKS_DIFFER:
            raise ConfigError(
                f"the last run cannot be determined: {newest.run} began at {started:%Y-%m-%d %H:%M:%S} UTC, which "
                "is in the future: the clock was set back",
                hint="give the run's name; vcfbench runs list shows them",
            )
        return newest
    if Path(name).name == name and os.path.isfile(runs / name / "journal.jsonl"):  # noqa: PTH113  # raises nothing
        return RunDirectory(runs / name)
    found = [each for each in recorded_runs(runs) if each.run.startswith(name) or each.run.endswith(name)]
    if len(found) != 1:
        what = f"{len(found)} runs are called" if found else "there is no run"
        raise ConfigError(f"{shown(runs)}: {what} {name!r}", hint="vcfbench runs list shows them")
    return found[0]
