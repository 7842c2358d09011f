"""Outline of a journal for lists of runs, without its readings: thousands of records are listed in seconds.

The seal of the last line says whether the lines before it are as they were written. In records of before there were
seals every line is looked at, and must be JSON, in its place and in order of bench time. What is not plainly whole is
left to :func:`~vcfbench.records.journal.read_journal`, which says what is wrong. The sums over readings are not done
again here: that a point is not the mean of its readings is found by who reads the record itself.
"""

from __future__ import annotations

import sys
from math import isfinite
from typing import TYPE_CHECKING
from zlib import crc32

import msgspec
from msgspec import Struct, field

from vcfbench.errors import ConfigError
from vcfbench.files import read_file
from vcfbench.records.amendments import Amendment, amendments_of, lines_after
from vcfbench.records.schema import READABLE, SEALED, Status
from vcfbench.records.seal import holds_whole

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


class Mark(Struct, frozen=True, gc=False):
    """Mark that tells the points of one run from those of another: rate (deg/s), V_Vc (V), output (V), as recorded."""

    rate_deg_s: float | None = None
    v_vc_v: float | None = None
    output_v: float | None = None


class ListedMetadata(Struct, frozen=True):
    """Metadata of a run, as far as lists show it."""

    dut: str | None = None
    operator: str | None = None
    note: str | None = None
    tags: dict[str, str] = {}


class Outline(Struct, frozen=True):
    """A journal without steps and readings; `marks` are of its points, `device` that of its settings.

    `marks` are None where the sum in the footer says that the lines between are as they were written.
    """

    procedure: str
    bench: str | None
    seed: int | None
    status: Status
    points: int
    marks: tuple[Mark, ...] | None
    bench_seconds: float | None = None
    utc: str | None = None
    metadata: ListedMetadata = field(default_factory=ListedMetadata)
    device: str | None = None
    amendments: tuple[Amendment, ...] = ()


class _Settings(Struct, frozen=True):
    dut: str | None = None


class _Bench(Struct, frozen=True):
    name: str | None = None


class _Header(Struct, frozen=True):
    type: str
    format: int
    procedure: str
    bench: _Bench
    seed: int | None = None
    utc: str | None = None
    metadata: ListedMetadata = field(default_factory=ListedMetadata)
    settings: _Settings = field(default_factory=_Settings)
    seal: str | None = None


class _Line(Struct, frozen=True, gc=False):
    type: str
    n: int = 0
    t_s: float = 0.0
    end_s: float = 0.0
    point: Mark | None = None
    chunk: int = 0
    chunks: int = 0


class _Footer(Struct, frozen=True):
    type: str
    status: Status
    points: int
    bench_seconds: float | None = None
    crc32: int | None = None
    seal: str | None = None


_HEADER = msgspec.json.Decoder(_Header)
_LINE = msgspec.json.Decoder(_Line)
_FOOTER = msgspec.json.Decoder(_Footer)


def outline_of(path: Path) -> Outline | None:
    """Return the outline of a whole journal; None for any other, which is to be read in full."""
    try:
        data = read_file(path, "the journal of a run", sys.maxsize)
        later, end = lines_after(data)
        first, last = data.find(b"\n") + 1, data.rfind(b"\n", 0, max(0, end - 1)) + 1
        if not 0 < first < last or not data.endswith(b"\n"):
            return None
        header, footer = _HEADER.decode(data[:first]), _FOOTER.decode(data[last:end])
        sealed = _is_vouched_for(data, last, footer)
        if not sealed and (footer.crc32 is not None or header.format in SEALED or header.seal is not None):
            return None
        between = [] if sealed else _LINE.decode_lines(data[first:last])
        amendments = amendments_of(map(msgspec.json.decode, later))
    except (ConfigError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    marks = tuple(line.point for line in between if line.point is not None and line.type == "step")
    whole = sealed or (footer.points == len(marks) and _in_order(between))
    if (header.type, footer.type) != ("header", "footer") or not whole or header.format not in READABLE:
        return None
    head = (header.procedure, header.bench.name, header.seed, footer.status, footer.points)
    ended = (None if sealed else marks, footer.bench_seconds)
    return Outline(*head, *ended, header.utc, header.metadata, header.settings.dut, amendments)


def _is_vouched_for(data: bytes, last: int, footer: _Footer) -> bool:
    """Tell whether the footer, at `last`, has the seal of all before it, or the CRC-32 of older records."""
    if footer.seal is not None:
        return holds_whole(data)
    return footer.crc32 is not None and crc32(memoryview(data)[:last]) == footer.crc32


def _in_order(lines: Sequence[_Line]) -> bool:
    """Tell whether steps follow each other in number and time, each after all its chunks of readings."""
    step, chunk, before_s = 0, 0, 0.0
    for line in lines:
        kind = line.type
        if kind in ("step", "error"):
            step += 1
            begin_s = line.t_s
            end_s = line.end_s or begin_s
            if line.n != step or line.chunks != chunk or not before_s <= begin_s <= end_s or not isfinite(end_s):
                return False
            chunk, before_s = 0, end_s
        elif kind == "readings":
            chunk += 1
            if line.n != step + 1 or line.chunk != chunk:
                return False
        elif kind in ("header", "footer"):
            return False
    return True
