"""Results of a record, computed again from its points; where that cannot be, those that are stored."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from vcfbench.archive.results import evaluate, nothing
from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.journal import lines_of
from vcfbench.records.schema import Status

if TYPE_CHECKING:
    from vcfbench.archive.results import Evaluation
    from vcfbench.records.directory import RunDirectory
    from vcfbench.records.journal import JournalRecord


def evaluation_of(directory: RunDirectory, record: JournalRecord) -> tuple[Evaluation, str | None]:
    """Compute the results again from the points; where that cannot be, return the stored ones, with the reason."""
    from vcfbench.archive.stored import stored  # noqa: PLC0415

    if record.status is not Status.COMPLETE:
        return nothing(record.points), f"the record is {record.status.value}"
    try:
        return _computed(directory, record), None
    except BenchError as error:
        why = printable(error.what)
    try:
        return stored(directory, record), why
    except ConfigError as error:
        return nothing(record.points), f"{why}; {error.what}"


def _computed(directory: RunDirectory, record: JournalRecord) -> Evaluation:
    """Compute the results again.

    Raises:
        BenchError: procedure or settings are not known here, or the procedure gives no result of these points any more.
    """
    from vcfbench.procedures.catalogue import PROCEDURES  # noqa: PLC0415  # it is needed for complete records alone
    from vcfbench.procedures.layers import recorded_settings  # noqa: PLC0415
    from vcfbench.steps.measured import Measured  # noqa: PLC0415

    name = record.header.get("procedure")
    if not isinstance(name, str) or name not in PROCEDURES:
        raise ConfigError(f"the procedure {name!r} is not known here")
    procedure = PROCEDURES[name]
    settings = recorded_settings(procedure, record.header.get("settings"))
    measured = Measured(record.points, lambda: record.lines)  # they have been read: a million readings take a second
    try:
        return evaluate(procedure, settings, settings.acceptance, measured)
    except BenchError as error:
        raise ConfigError(f"the points give no result: {error.what}") from error
    finally:
        measured.read_again_from(partial(lines_of, directory.journal))  # and are not held in memory


def printable(value: object) -> str:
    """Return a text of a record as it can be printed: a file must not write on the terminal by itself."""
    text = str(value)
    return text if text.isprintable() else ascii(text)
