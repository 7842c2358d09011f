"""Reads bench files: TOML to a frozen description, every mistake one line with file, key path and what was expected."""

from __future__ import annotations

import difflib
import re
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import inspect

from vcfbench.bench.consistency import misfits
from vcfbench.bench.description import ADDRESS_PATTERN, NAME_PATTERN, BenchDescription
from vcfbench.errors import ConfigError
from vcfbench.files import dotted, parse_toml, read_text, require_numbers, shown

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["EMBEDDED", "described", "embedded_text", "load_bench", "parse_bench", "template", "with_settings"]

EMBEDDED = ("paper", "ideal")
"""Names of the benches that come with the package, usable in place of a file."""

Keys = tuple[str | int, ...]


def load_bench(path: Path | str | None = None) -> BenchDescription:
    """Return the bench described by the file at `path`; None is the embedded paper bench.

    The name of an embedded bench serves as a path where no such file exists.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or does not describe a bench.
    """
    if path is None:
        return _embedded("paper")
    if str(path) in EMBEDDED and not Path(path).exists():
        return _embedded(str(path))
    return _beside(parse_bench(read_text(path, "a bench file"), shown(path)), Path(path))


def described(bench: BenchDescription | Path | str | None) -> BenchDescription:
    """Return the bench that is meant: a description, or what :func:`load_bench` takes."""
    return bench if isinstance(bench, BenchDescription) else load_bench(bench)


def with_settings(description: BenchDescription, settings: Mapping[str, Any]) -> BenchDescription:
    """Return the bench with `settings`, nested as in the bench file, in place of those of its ``[procedure]``.

    Raises:
        ConfigError: a key is unknown or a value cannot be, as in a bench file.
    """
    raw: dict[str, Any] = msgspec.to_builtins(description)
    told: dict[str, Any] = msgspec.to_builtins(dict(settings), enc_hook=_plain_number)
    require_numbers({"procedure": told}, "settings")
    raw["procedure"] = _merged(raw["procedure"], told)
    return _checked(_converted(raw, "settings"), "settings")


def _plain_number(value: object) -> object:
    """Return numpy's numbers and arrays as Python's."""
    tolist = getattr(value, "tolist", None)
    return str(value) if tolist is None else tolist()


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for name, value in changes.items():
        below = merged.get(name)
        merged[name] = _merged(below, value) if isinstance(below, dict) and isinstance(value, dict) else value
    return merged


def _beside(description: BenchDescription, path: Path) -> BenchDescription:
    """Return the bench with the profile of its table found from where its bench file is, and read once."""
    table = description.rate_table
    if table is None or not table.dialect.endswith(".toml"):
        return description
    found = msgspec.structs.replace(table, dialect=str(path.parent / table.dialect))
    _check_profile(found.dialect, found.axis, simulated=description.simulation is not None)
    return msgspec.structs.replace(description, rate_table=found)


def _check_profile(dialect: str, axis: int, *, simulated: bool) -> None:
    """Read the profile of a table now: what is wrong with it shall not be found with the bench half open."""
    from vcfbench.bench.simulated import profile_twin  # noqa: PLC0415  # few benches have a profile of their own
    from vcfbench.drivers.rate_table.dialect import AxisSettings  # noqa: PLC0415
    from vcfbench.drivers.rate_table.dialects import spoken  # noqa: PLC0415

    spoken(dialect, AxisSettings(axis))
    if simulated:
        profile_twin(dialect)


def parse_bench(text: str, source: str) -> BenchDescription:
    """Return the bench that the TOML `text` describes; `source` names it in errors (ConfigError)."""
    return _checked(_described(text, source), source)


def _checked(description: BenchDescription, source: str) -> BenchDescription:
    for misfit in misfits(description):
        raise _error(source, misfit.path, misfit.expected, _words(misfit.came))
    return description


def _described(text: str, source: str) -> BenchDescription:
    return _converted(parse_toml(text, source), source)


def _converted(raw: dict[str, Any], source: str) -> BenchDescription:
    try:
        return msgspec.convert(raw, BenchDescription)
    except msgspec.ValidationError as error:
        raise _explain(str(error), raw, source) from None


def template() -> str:
    """Return the commented bench file of a real station, ready to be filled in."""
    return embedded_text("station")


def embedded_text(name: str) -> str:
    """Return the text of the bench file `name` that comes with the package."""
    return resources.files("vcfbench.bench").joinpath(f"{name}.toml").read_text(encoding="utf-8")


def _embedded(name: str) -> BenchDescription:
    """Return a bench that comes with the package; that it agrees with itself is tested, and costs imports to see."""
    return _described(embedded_text(name), f"embedded {name} bench")


# --- msgspec's words into ours. Its message ends in " - at `$.path`"; the value and the type are looked up there. ---

_AT = re.compile(r" - at `\$(?P<path>.*)`$", re.DOTALL)
_STEP = re.compile(r"\.(?P<key>[^.\[]+)|\[(?P<index>\d+|\.\.\.)\]")
_UNKNOWN = re.compile(r"unknown field `(?P<key>.*)`", re.DOTALL)
_MISSING = re.compile(r"missing required field `(?P<key>.*)`")


def _explain(message: str, raw: dict[str, Any], source: str) -> ConfigError:
    where = _AT.search(message)
    keys = _keys(where["path"]) if where else ()
    what = message[: where.start()] if where else message
    if unknown := _UNKNOWN.search(what):
        return _unknown_key((*keys, unknown["key"]), _field_names(keys), source)
    if missing := _MISSING.search(what):
        path = (*keys, missing["key"])
        return _error(source, dotted(path), _expectation(_type_at(path)), "nothing")
    return _error(source, dotted(keys), _expectation(_type_at(keys)), _words(_value_at(raw, keys)))


def _unknown_key(keys: Keys, known: Sequence[str], source: str) -> ConfigError:
    close = difflib.get_close_matches(str(keys[-1]), known, n=1)
    expected = f"{close[0]!r}" if close else f"one of {', '.join(known)}"
    return _error(source, dotted(keys), f"a known key ({expected}?)" if close else expected, "an unknown key")


def _error(source: str, path: str, expected: str, came: str) -> ConfigError:
    return ConfigError(f"{source}: {path}: expected {expected}, came {came}")


def _keys(path: str) -> Keys:
    steps = (match["key"] or int(match["index"]) for match in _STEP.finditer(path) if match["index"] != "...")
    return tuple(steps)


def _value_at(raw: object, keys: Keys) -> object:
    for key in keys:
        raw = raw[key]  # type: ignore[index]  # the path came from a walk through this very value
    return raw


def _words(value: object) -> str:
    """Say what came, short and on one line."""
    if isinstance(value, dict):
        return "a table"
    if value is None or isinstance(value, bool):
        return "nothing" if value is None else str(value).lower()
    text = repr(value)
    if isinstance(value, str | int | float | list):
        return text if len(text) <= 60 else f"{text[:57]}..."
    return f"{type(value).__name__} {value}"


# --- the expected type, in words ---


def _type_at(keys: Keys) -> inspect.Type:
    node: inspect.Type = inspect.type_info(BenchDescription)
    for key in keys:
        node = _step_into(_without_none(node), key)
    return _without_none(node)


def _step_into(node: inspect.Type, key: str | int) -> inspect.Type:
    if isinstance(node, inspect.StructType):
        return next(field.type for field in node.fields if field.encode_name == key)
    if isinstance(node, inspect.TupleType) and isinstance(key, int):
        return node.item_types[key]
    if isinstance(node, inspect.VarTupleType):
        return node.item_type
    return inspect.AnyType()


def _without_none(node: inspect.Type) -> inspect.Type:
    if not isinstance(node, inspect.UnionType):
        return node
    types = [part for part in node.types if not isinstance(part, inspect.NoneType)]
    return types[0] if len(types) == 1 else inspect.UnionType(tuple(types))


def _field_names(keys: Keys) -> tuple[str, ...]:
    node = _type_at(keys)
    return tuple(field.encode_name for field in node.fields) if isinstance(node, inspect.StructType) else ()


def _expectation(node: inspect.Type) -> str:
    match node:
        case inspect.UnionType(types):
            return " or ".join(map(_expectation, types))
        case inspect.LiteralType(values):
            return " or ".join(sorted(map(repr, values)))
        case inspect.FloatType() | inspect.IntType():
            return f"{'a number' if isinstance(node, inspect.FloatType) else 'a whole number'}{_range(node)}"
        case inspect.StrType():
            return f"a text{_form(node)}"
        case _:
            return _shape(node)


def _shape(node: inspect.Type) -> str:
    if isinstance(node, inspect.TupleType):
        return f"a list of {len(node.item_types)} numbers"
    if isinstance(node, inspect.VarTupleType):
        return f"a list of {node.min_length} to {node.max_length} numbers"
    return "a table"


def _range(node: inspect.FloatType | inspect.IntType) -> str:
    bounds = (("above", node.gt), ("at least", node.ge), ("below", node.lt), ("at most", node.le))
    words = [f"{word} {bound:.16g}" for word, bound in bounds if bound is not None]
    return f" {' and '.join(words)}" if words else ""


def _form(node: inspect.StrType) -> str:
    if node.pattern == ADDRESS_PATTERN:
        return " with host and port, as in 127.0.0.1:20220"
    if node.pattern == NAME_PATTERN:
        return " of letters, digits, '_', '-' and '.'"
    return f" of {node.min_length} to {node.max_length} characters on one line" if node.max_length else ""
