"""Single values of a dataclass by their names, as a bench file gives them: physical parameters, instrument errors."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import msgspec

from vcfbench.records.plain import field_names
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.layering import merged
from vcfbench.strict import one_of
from vcfbench.typed import typed

T = TypeVar("T")

_LEAST, _MOST = 1e-30, 1e30
"""Range of any physical value in SI units: beyond, squares and products overflow."""

_KINDS = {"float": "a number", "int": "a whole number", "array": "a list", "str": "a text", "object": "a table"}


def overridden(base: T, changes: Mapping[str, Any]) -> T:
    """Return `base` with `changes` (nested as `base` is) in place of its values."""
    return typed(merged(msgspec.to_builtins(base), changes), type(base)) if changes else base


def part_way(ideal: T, other: T, share: float) -> T:
    """Return `other` with every real number in it `share` times as far from that of `ideal`; the rest is as it is."""
    return typed(_between(msgspec.to_builtins(ideal), msgspec.to_builtins(other), share), type(other))


def _between(ideal: Any, other: Any, share: float) -> Any:
    if isinstance(ideal, dict) and isinstance(other, dict):
        return {name: _between(ideal.get(name), value, share) for name, value in other.items()}
    if isinstance(ideal, list | tuple) and isinstance(other, list | tuple) and len(ideal) == len(other):
        return [_between(*pair, share) for pair in zip(ideal, other, strict=True)]
    numbers = isinstance(ideal, float) and isinstance(other, float) and math.isfinite(ideal) and math.isfinite(other)
    return ideal + share * (other - ideal) if numbers else other


def invalid_overrides(base: Any, changes: Mapping[str, Any], path: str) -> Iterator[InvalidValue]:
    """Yield the entries of `changes` that are no value of `base`, a dataclass or struct; `path` is their key."""
    known = {name: getattr(base, name) for name in field_names(base) or ()}
    for name, value in changes.items():
        here = f"{path}.{name}"
        if name not in known:
            table, _, key = name.partition(".")
            quoted = f"the key without quotes, {path}.{name}: between them it is one name"
            yield InvalidValue(here, quoted if key and table in known else one_of(name, [*known], "name"), value)
        elif (below := field_names(known[name])) is None:
            try:
                overridden(base, {name: value})
            except ValueError as error:
                words = str(error).partition(" - at `")[0].replace("`", "")  # msgspec's: they become the bench file's
                missing = words.partition("missing required field ")[2]
                kind = words.partition("Expected ")[2].partition(", got")[0]
                expected = f"every entry to have {missing}" if missing else _KINDS.get(kind, kind or words)
                yield InvalidValue(here, expected, value)
                continue
            if type(value) in (int, float) and not (value == 0 or _LEAST <= abs(value) <= _MOST):
                yield InvalidValue(here, f"0, or a number from {_LEAST:g} to {_MOST:g} either sign", value)
        elif isinstance(value, dict):
            yield from invalid_overrides(known[name], value, here)
        else:
            yield InvalidValue(here, f"a table with {', '.join(below)}", value)
