"""Reading of bench files with all checks, including procedure settings, and writing of complete ones."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from msgspec import to_builtins

from vcfbench.bench.ground import check_instruments_apart, check_simulation
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import check_tables, layers_of, plain_settings
from vcfbench.station import file
from vcfbench.station.description import BenchDescription
from vcfbench.station.layering import chosen_settings, merged, setting_keys
from vcfbench.station.parts import absent_rail_keys
from vcfbench.station.settings import ProcedureSettings
from vcfbench.station.writing import table_text

_CHECKS = (check_instruments_apart, check_simulation, check_tables)


def load_bench(path: Path | str | None = None) -> BenchDescription:
    """Return the bench described by the file at `path`; None is the embedded paper bench.

    The name of an embedded bench serves as a path where no such file exists; a directory of that name is no bench file.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or does not describe a bench.

    >>> station = vcfbench.load_bench("lab.toml")
    >>> station.limits.max_rate_deg_s, station.simulated
    (300.0, True)
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


def resolved_text(description: BenchDescription) -> str:
    """Return the bench file of `description` with every key of ``[procedure]``, defaults included."""
    return table_text(as_resolved(description))


def as_resolved(description: BenchDescription) -> dict[str, Any]:
    """Return `description` as nested tables, ``[procedure]`` with every key as it comes to be.

    The table of each installed procedure also holds the shared keys for which it has a value of its own.
    """
    shared = setting_keys(ProcedureSettings)
    supplied, values = description.power is not None, to_builtins(description)
    absent = absent_rail_keys(supplied=supplied, single=description.wiring.rails.single)
    everywhere = plain_settings(description.procedure, [key for key in shared if key not in absent])
    if not supplied:
        values["wiring"].pop("rails")
    given = {key: value for key, value in description.procedure_table.items() if key not in shared}
    own = {}
    for each in PROCEDURES.loaded():
        chosen = chosen_settings(each.settings, layers_of(each, description, description.name)).made_plain()
        table = plain_settings(chosen, [key for key in setting_keys(each.settings) if key not in absent]).items()
        if of_its_own := {key: value for key, value in table if key not in everywhere or value != everywhere[key]}:
            own[each.name] = merged(of_its_own, given.get(each.name, {}))
    return {**values, "procedure": {**everywhere, **given, **own}}
