"""Amendments of a finished record: changed metadata, checks, signatures. Lines are added, none changes.

Only what a person says of a run can be amended; what was measured, set or answered stays as it is.
"""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
from msgspec import Struct, to_builtins
from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.files import opened, shown
from vcfbench.records.journal import JournalRecord, append_line
from vcfbench.records.metadata import metadata_from
from vcfbench.records.signing import SigningKey
from vcfbench.typed import typed

_Said = TypeVar("_Said", bound=Struct)  # Metadata of a record: all of it, or as much as lists show
CHECKED_BY: Final = "checked_by"
_WORDS: Final = ("dut", "operator", "note")
_TAG: Final = re.compile(r"tags?\.(.+)")
_OF_CERTIFICATE: Final = ("customer", "customer_address", "customer_email", "item", "item_manufacturer", "item_model")
"""Tags that a certificate takes its words from, by their names alone."""
_AFTER: Final = (b'{"type":"amendment"', b'{"type":"signature"')  # Beginnings of the lines that may follow the footer
_LONGEST_TAIL: Final = 1 << 22


class Change(Struct, frozen=True):
    """An amended entry; None is an empty one."""

    field: str
    was: str | None
    now: str | None


class Amendment(Struct, frozen=True, kw_only=True):
    """One line: `revision` is that of the record from then on, which began as 1."""

    revision: int
    utc: str
    by: str
    reason: str
    changes: tuple[Change, ...]

    def words(self) -> str:
        """Say in words the changes, their author, date and reason."""
        changed = "; ".join(f"{each.field} {each.was or 'nothing'} -> {each.now or 'nothing'}" for each in self.changes)
        return f"revision {self.revision}: {changed}, by {self.by}, {self.utc[:10]}: {self.reason}"


class Check(Struct, frozen=True):
    """Check of a revision of a record: its checker and date."""

    by: str
    revision: int
    utc: str


def amendments_of(lines: Iterable[Mapping[str, Any]]) -> tuple[Amendment, ...]:
    """Return the amendments, in order; ConfigError: a line is none of this program."""
    try:
        return tuple(typed(line, Amendment) for line in lines if line.get("type") == "amendment")
    except msgspec.ValidationError as error:
        raise ConfigError(f"amendment: no line of this program: {error}") from None


def amendments_at(path: Path) -> tuple[Amendment, ...]:
    """Return the amendments in a journal, of which no more than its end is read; errors as above."""
    with opened(path, "the journal of a run") as file:
        file.seek(-min(_LONGEST_TAIL, os.fstat(file.fileno()).st_size), os.SEEK_END)
        return amendments_of(map(msgspec.json.decode, lines_after(file.read())[0]))


def lines_after(data: bytes) -> tuple[list[bytes], int]:
    """Return the lines after the footer, or after the last line without a footer, and their start."""
    end, found = len(data), list[bytes]()
    while data.startswith(_AFTER, start := data.rfind(b"\n", 0, max(0, end - 1)) + 1):
        found.append(data[start:end])
        end = start
    return found[::-1], end


def amended(metadata: _Said, amendments: Sequence[Amendment]) -> _Said:
    """Return the metadata of a record with all amendments applied; ConfigError: a new value is invalid."""
    for each in amendments:
        for change in each.changes:
            metadata = _changed(metadata, change.field, change.now)
    return metadata


def amended_fields(amendments: Sequence[Amendment]) -> tuple[str, ...]:
    """Return the names of the amended fields, each once."""
    names = (change.field for each in amendments for change in each.changes if change.field != CHECKED_BY)
    return tuple(dict.fromkeys(names))


def check_of(amendments: Sequence[Amendment]) -> Check | None:
    """Return the last check of the record; None if it was never checked, or the check was withdrawn."""
    for each in reversed(amendments):
        for change in each.changes:
            if change.field == CHECKED_BY:
                return None if change.now is None else Check(change.now, each.revision, each.utc)
    return None


def amend(
    path: Path, record: JournalRecord, given: Mapping[str, str], *, reason: str, by: str, key: SigningKey | None = None
) -> Amendment:
    """Add a line to the journal at `path` that amends its record.

    Args:
        path: of the journal.
        record: what stands in it.
        given: new values by their names: ``dut``, ``operator``, ``note``, ``checked_by``, ``tags.KEY``, or a tag that
            certificates know (``customer``); an empty one takes it away.
        reason: why.
        by: who.
        key: what signs it, where the station has one.

    Raises:
        ConfigError: the record is damaged, or something cannot be amended, or not to that.
        BenchError: its run goes on, or it cannot be written.
    """
    if record.damage is not None or not record.header:
        raise ConfigError(f"{shown(path)}: the record is damaged, nothing is amended: {record.damage or 'no header'}")
    if not reason.strip() or not by.strip():
        raise ConfigError("amend: expected a reason and the name of the person, got an empty text")
    before, changes = amendments_of(record.lines), []
    metadata = amended(metadata_from(record.header), before)
    for name, value in given.items():
        field, now, again = _field(name), value.strip() or None, False
        if field == CHECKED_BY:
            check = check_of(before)
            was = None if check is None else check.by
            again = now is not None and check is not None and check.revision <= len(before)  # that was another revision
        else:
            tag = _TAG.fullmatch(field)
            was = metadata.tags.get(tag[1]) if tag else getattr(metadata, field)
        if was == now and not again:
            raise ConfigError(f"{name}: it is {now or 'empty'} already")
        metadata = _changed(metadata, field, now)
        changes.append(Change(field, was, now))
    if not changes:
        raise ConfigError("amend: name a field to amend", hint="--set dut=G-018")
    made = {"revision": len(before) + 2, "by": by, "reason": reason, "changes": to_builtins(changes)}
    append_line(path, {"type": "amendment", **made}, key)
    return amendments_at(path)[-1]


def _field(name: str) -> str:
    """Return the name of an amended field as a line has it; ConfigError where it cannot be."""
    if name in {*_WORDS, CHECKED_BY}:
        return name
    if tag := _TAG.fullmatch(name):
        return f"tags.{tag[1]}"
    if name in _OF_CERTIFICATE:
        return f"tags.{name}"
    known = ", ".join((*_WORDS, CHECKED_BY, *_OF_CERTIFICATE, "tags.KEY"))
    raise ConfigError(
        f"{name}: expected a field that a person gave for the run, one of {known}",
        hint="measured values, settings and answers cannot be amended: measure again",
    )


def _changed(metadata: _Said, field: str, now: str | None) -> _Said:
    if field == CHECKED_BY:
        return metadata
    if tag := _TAG.fullmatch(field):
        kept = {key: value for key, value in getattr(metadata, "tags", {}).items() if key != tag[1]}
        return replace(metadata, tags=kept if now is None else {**kept, tag[1]: now})
    if field not in _WORDS:
        raise ConfigError(f"amendment: {field}: expected {', '.join(_WORDS)}, {CHECKED_BY} or tags.KEY")
    return replace(metadata, **{field: now})
