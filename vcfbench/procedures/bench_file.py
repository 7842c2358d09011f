"""Bench files with every check: the station's own, those of the simulation, and the settings of the procedures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vcfbench.bench.ground import check_simulation
from vcfbench.procedures.layers import check_tables
from vcfbench.station import file
from vcfbench.station.description import BenchDescription

_CHECKS = (check_simulation, check_tables)


def load_bench(path: Path | str | None = None) -> BenchDescription:
    """Return the bench described by the file at `path`; None is the embedded paper bench.

    The name of an embedded bench serves as a path where no such file exists; a directory of that name is no bench file.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or does not describe a bench.
    """
    return file.read_bench(path, *_CHECKS)


def described(bench: BenchDescription | Path | str | None) -> BenchDescription:
    """Return the bench as a description, read with :func:`load_bench` where a file is named."""
    return file.described(bench, *_CHECKS)


def parse_bench(text: str, source: str) -> BenchDescription:
    """Return the bench that the TOML `text` describes; `source` names it in errors (ConfigError)."""
    return file.parse_bench(text, source, *_CHECKS)


def checked_bench(values: Mapping[str, Any], source: str) -> BenchDescription:
    """Return the bench that nested tables describe; `source` names it in errors (ConfigError)."""
    return file.checked_bench(values, source, *_CHECKS)
