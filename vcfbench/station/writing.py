"""Writes a bench description as a bench file."""

from collections.abc import Iterator
from datetime import date
from json import dumps
from typing import Any

import msgspec

from vcfbench.station.description import BenchDescription


def bench_text(description: BenchDescription) -> str:
    """Return the bench file of `description`: every key, defaults included; of ``[procedure]`` the given ones."""
    return table_text(msgspec.to_builtins(description))


def table_text(tables: dict[str, Any]) -> str:
    """Return nested tables as a TOML file; None is left out."""
    return "\n".join(_lines(tables, "")) + "\n"


def _lines(table: dict[str, Any], path: str) -> Iterator[str]:
    """Yield a nested dict as the lines of a TOML file; None is left out, as in a bench file."""
    plain = {key: value for key, value in table.items() if not isinstance(value, dict) and value is not None}
    if path and plain:
        yield f"\n[{path}]"
    for key, value in plain.items():
        yield f"{key} = {value_text(value)}"
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _lines(value, f"{path}.{key}" if path else key)


def value_text(value: object) -> str:
    """Return a plain value as TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {value_text(item)}' for key, item in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, date):
        return value.isoformat()
    return dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)
