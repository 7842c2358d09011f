"""Settable keys of a procedure, with default, range and meaning, as help and error messages name them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import NODEFAULT, Struct, inspect, structs, to_builtins

from vcfbench.files import dotted
from vcfbench.station.strict import expectation
from vcfbench.station.writing import value_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.station.settings import ProcedureSettings


class SettableKey(Struct, frozen=True):
    """One key: `path` as ``--set`` takes it, `default` in TOML (empty when it has none), and its description.

    `option` is what the command's own option for it is called, empty when it has none.
    """

    path: str
    default: str
    expected: str
    meaning: str
    option: str


def settable_keys(kind: type[ProcedureSettings]) -> Iterator[SettableKey]:
    """Yield every key of settings of `kind`, those of tables within one by one; keys of the station are none."""
    for field in structs.fields(kind):
        if field.name != "station":
            yield from _keys(field, ())


def _keys(field: structs.FieldInfo, above: tuple[str, ...]) -> Iterator[SettableKey]:
    described = inspect.type_info(field.type)
    path = (*above, field.encode_name)
    extra: dict[str, Any] = {}
    meaning = ""
    if isinstance(described, inspect.Metadata):
        extra, meaning = described.extra or {}, (described.extra_json_schema or {}).get("description", "")
        described = described.type
    if isinstance(described, inspect.StructType):
        for below in structs.fields(described.cls):
            yield from _keys(below, path)
        return
    name = dotted(path)
    yield SettableKey(name, _default(field), _expected(described), meaning, _option(name, extra.get("option")))


def _option(name: str, option: object) -> str:
    """Return the option that a key has, named after it or as declared: a key may not be called like a procedure."""
    if isinstance(option, str):
        return option
    return f"--{name.replace('_', '-')}" if option else ""


def _expected(node: inspect.Type) -> str:
    """Describe the expected value; of a list also each number in it."""
    items = node.item_types if isinstance(node, inspect.TupleType) else ()
    item = node.item_type if isinstance(node, inspect.VarTupleType) else next(iter(items), None)
    limits = expectation(item).removeprefix("a number") if isinstance(item, inspect.FloatType) else ""
    return f"{expectation(node)}{f', each{limits}' if limits else ''}"


def _default(field: structs.FieldInfo) -> str:
    value = field.default if field.default_factory is NODEFAULT else field.default_factory()
    return "" if value is NODEFAULT or value is None else value_text(to_builtins(value))
