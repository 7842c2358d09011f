"""Settable keys of a procedure, with default, range and meaning, as help and error messages name them."""

from collections.abc import Iterator
from typing import Any

from msgspec import NODEFAULT, Struct, inspect, structs, to_builtins

from vcfbench.files import dotted
from vcfbench.station.settings import ProcedureSettings
from vcfbench.station.writing import value_text
from vcfbench.strict import expectation


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
    name, option = dotted(path), extra.get("option")
    if not isinstance(option, str):  # one is declared where a key may not be called like a procedure
        option = f"--{name.replace('_', '-')}" if option else ""
    items = described.item_types if isinstance(described, inspect.TupleType) else ()
    item = described.item_type if isinstance(described, inspect.VarTupleType) else next(iter(items), None)
    limits = expectation(item).removeprefix("a number") if isinstance(item, inspect.FloatType) else ""
    expected = f"{expectation(described)}{f', each{limits}' if limits else ''}"
    value = field.default if field.default_factory is NODEFAULT else field.default_factory()
    default = "" if value is NODEFAULT or value is None else value_text(to_builtins(value))
    yield SettableKey(name, default, expected, meaning, option)
