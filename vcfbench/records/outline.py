"""Outline of a journal for lists of runs, without its readings: thousands of records are listed in seconds.

The seal of the last line says whether the lines before it are as they were written. What is not plainly whole is
left to :func:`~vcfbench.records.journal.read_journal`, which says what is wrong. The sums over readings are not done
again here: that a point is not the mean of its readings is found by who reads the record.
"""

import sys
from pathlib import Path

import msgspec
from msgspec import Struct, field

from vcfbench.errors import ConfigError
from vcfbench.files import read_file
from vcfbench.records.amendments import Amendment, amendments_of, lines_after
from vcfbench.records.schema import FORMAT, Status
from vcfbench.records.seal import holds_whole


class ListedMetadata(Struct, frozen=True):
    """Metadata of a run, as far as lists show it."""

    dut: str | None = None
    operator: str | None = None
    note: str | None = None
    tags: dict[str, str] = {}


class Outline(Struct, frozen=True):
    """A journal without steps and readings."""

    procedure: str
    bench: str | None
    seed: int | None
    status: Status
    points: int
    bench_seconds: float | None = None
    utc: str | None = None
    metadata: ListedMetadata = field(default_factory=ListedMetadata)
    amendments: tuple[Amendment, ...] = ()
    simulated: bool | None = None
    run: str | None = None
    """Name that the record had when it was made."""


class _Bench(Struct, frozen=True):
    name: str | None = None


class _Header(Struct, frozen=True, tag_field="type", tag="header"):
    format: int
    procedure: str
    bench: _Bench
    seed: int | None = None
    utc: str | None = None
    metadata: ListedMetadata = field(default_factory=ListedMetadata)
    simulated: bool | None = None
    run: str | None = None


class _Footer(Struct, frozen=True, tag_field="type", tag="footer"):
    status: Status
    points: int
    bench_seconds: float | None = None


_HEADER = msgspec.json.Decoder(_Header)
_FOOTER = msgspec.json.Decoder(_Footer)


def outline_of(path: Path) -> Outline | None:
    """Return the outline of a whole journal; None for any other, which is to be read in full."""
    try:
        data = read_file(path, "the journal of a run", sys.maxsize)
        later, end = lines_after(data)
        first, last = data.find(b"\n") + 1, data.rfind(b"\n", 0, max(0, end - 1)) + 1
        if not 0 < first < last or not holds_whole(data):
            return None
        header, footer = _HEADER.decode(data[:first]), _FOOTER.decode(data[last:end])
        amendments = amendments_of(map(msgspec.json.decode, later))
    except (ConfigError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    if header.format != FORMAT:
        return None
    head = (header.procedure, header.bench.name, header.seed, footer.status, footer.points, footer.bench_seconds)
    return Outline(*head, header.utc, header.metadata, amendments, header.simulated, header.run)
