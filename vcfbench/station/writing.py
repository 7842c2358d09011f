"""Writes a bench description as a bench file."""

from collections.abc import Iterator, Mapping
from datetime import date
from json import dumps
from typing import Any

import msgspec

from vcfbench.station.description import BenchDescription


def bench_text(description: BenchDescription) -> str:
    """Return the bench file of `description`: every key, defaults included; of ``[procedure]`` the given ones."""
    values = msgspec.to_builtins(description)
    devices = values.pop("devices", ())
    own = set(devices[0]) - {"name"} if devices else set()  # what is a device's own stands in its table
    return "".join([table_text({k: v for k, v in values.items() if k not in own}), *map(device_text, devices)])


def device_text(values: Mapping[str, Any]) -> str:
    """Return the table ``[[device]]`` of one of several gyroscopes."""
    return "\n" + table_text({"device": values}).lstrip("\n").replace("[device]", "[[device]]", 1)


def table_text(values: Mapping[str, Any]) -> str:
    """Return nested tables as a TOML file; None is left out."""
    return "\n".join(line for path, keys in nested_tables(values) for line in table_lines(path, keys)) + "\n"


def nested_tables(values: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every table by its dotted name, with its own plain keys; the top level is ''. None is left out."""
    plain = {key: value for key, value in values.items() if not isinstance(value, dict) and value is not None}
    if plain or not path:
        yield path, plain
    for key, value in values.items():
        if isinstance(value, dict):
            yield from nested_tables(value, f"{path}.{key}" if path else key)


def table_lines(path: str, keys: Mapping[str, Any]) -> list[str]:
    """Return one table of its own plain keys as lines of TOML."""
    return [*(["", f"[{path}]"] if path else []), *(f"{key} = {value_text(value)}" for key, value in keys.items())]


def value_text(value: object) -> str:
    """Return a plain value as TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {value_text(item)}' for key, item in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, date):
        return value.isoformat()
    return dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)
