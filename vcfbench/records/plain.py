"""Results as plain values ready for JSON, and read-only plain values read back."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import date
from enum import Enum
from pathlib import PurePath
from typing import Any

from vcfbench.errors import ConfigError
from vcfbench.values.value import UncertaintyPart, Value

_WHOLE = 1 << 63


def plain(value: object, name: str = "results") -> Any:
    """Return `value` as JSON has it: numbers, texts, lists, and objects by the names of their fields, in their order.

    Frozen dataclasses and msgspec structs become objects, numpy's numbers and arrays become numbers and lists, an enum
    its value, a date or a path its text.

    Args:
        value: what a procedure returned as its results.
        name: what it is called in errors.

    Raises:
        ConfigError: something in it is no finite number, or nothing that JSON has; it names where.
    """
    if value is None or type(value) in (str, bool) or (type(value) is float and math.isfinite(value)):
        return value  # what nearly all are
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, Value | UncertaintyPart):
        value = value.in_results()
    if isinstance(value, Mapping):
        return {_key(key, name): plain(each, f"{name}.{key}") for key, each in value.items()}
    if isinstance(value, list | tuple):
        if set(map(type, value)) == {float} and all(map(math.isfinite, value)):
            return list(value)  # a million of them take no time
        return [plain(each, f"{name}[{place}]") for place, each in enumerate(value)]
    if (names := field_names(value)) is None:
        return _single(value, name)
    return {each: plain(getattr(value, each), f"{name}.{each}") for each in names}


def field_names(value: object) -> Sequence[str] | None:
    """Return the fields of a dataclass or struct, None of anything else."""
    if isinstance(value, type):
        return None
    if is_dataclass(value):
        return [field.name for field in fields(value)]
    return getattr(value, "__struct_fields__", None)


def _single(value: object, name: str) -> Any:
    """Return one number or text; numpy's are known by their methods, so that numpy is not needed."""
    match value:
        case None | bool():
            return value
        case str() | date() | PurePath():
            return str(value)
        case int():
            if not -_WHOLE <= value < _WHOLE:
                raise ConfigError(f"{name}: expected a whole number of 64 bits, got a longer one")
            return value
        case float():
            if not math.isfinite(value):
                raise ConfigError(f"{name}: expected a finite number or None, got {value}")
            return float(value)
        case set() | frozenset():
            return plain(sorted(value), name)
    hold = None if isinstance(value, type) else getattr(value, "tolist", None)
    held = value if hold is None else hold()
    if isinstance(held, bool | int | float | str | list | date):
        return plain(held, name)
    raise ConfigError(
        f"{name}: expected numbers, texts, lists, or a frozen dataclass of them, got a {type(value).__name__}"
    )


def _key(key: object, name: str) -> str:
    """Return a key as a text; numbers as they are printed."""
    found = key.value if isinstance(key, Enum) else key
    if not isinstance(found, str | int | float):
        raise ConfigError(f"{name}: expected keys that are texts or numbers, got a {type(key).__name__}")
    return str(found)


class ReadOnly(Mapping[str, Any]):
    """A mapping that cannot be changed, nor can its values; compares, and can be pickled."""

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._values = {key: read_only(value) for key, value in values.items()}

    def __getitem__(self, key: str) -> Any:
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(self._values)


def read_only(value: Any) -> Any:
    """Return read-only plain values: read-only mappings, tuples instead of lists, the rest unchanged."""
    if isinstance(value, Mapping):
        return value if isinstance(value, ReadOnly) else ReadOnly(value)
    return tuple(map(read_only, value)) if isinstance(value, list | tuple) else value
