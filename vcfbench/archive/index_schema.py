"""The tables of an index of runs, the same on SQLite and PostgreSQL; SQLAlchemy is imported when they are asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from msgspec import Struct

if TYPE_CHECKING:
    from sqlalchemy import MetaData, Table

SCHEMA: Final = "3"
"""Version of the tables; raised when their content changes, also in how it is made of a record."""
STATEMENTS_AT_ONCE: Final = 500
"""Rows written, or names asked for, in one statement."""


class Tables(Struct, frozen=True):
    """`runs` has a row a record, `tags` one a tag, `about` the version alone."""

    metadata: MetaData
    runs: Table
    tags: Table
    about: Table


def tables() -> Tables:
    """Return the tables; `store` is the station's name and the directory of its records."""
    from sqlalchemy import JSON, BigInteger, Column, Index, Integer, MetaData, Table, Text  # noqa: PLC0415

    metadata = MetaData()
    runs = Table(
        "vcfbench_runs",
        metadata,
        Column("store", Text, primary_key=True),
        Column("run", Text, primary_key=True),
        Column("fingerprint", Text, nullable=False),
        Column("directory", Text, nullable=False),
        Column("started_utc", Text, nullable=False),
        Column("status", Text, nullable=False),
        Column("procedure", Text),
        Column("bench", Text),
        Column("seed", BigInteger),
        Column("points", Integer),
        Column("dut", Text),
        Column("operator", Text),
        Column("note", Text),
        Column("tags", JSON, nullable=False),
        Column("results", JSON, nullable=False),
        Column("verdict", Text),
        Column("damage", Text),
        Column("problem", Text),
        Column("revision", Integer, nullable=False),
        Column("amended", JSON, nullable=False),
    )
    Index("vcfbench_runs_by_device", runs.c.dut, runs.c.started_utc)
    Index("vcfbench_runs_by_start", runs.c.started_utc)
    Index("vcfbench_runs_by_procedure", runs.c.procedure, runs.c.started_utc)
    tags = Table(
        "vcfbench_tags",
        metadata,
        Column("store", Text, primary_key=True),
        Column("run", Text, primary_key=True),
        Column("key", Text, primary_key=True),
        Column("value", Text, nullable=False),
    )
    Index("vcfbench_tags_by_value", tags.c.key, tags.c.value)
    about = Table("vcfbench_index", metadata, Column("value", Text, primary_key=True))
    return Tables(metadata, runs, tags, about)
