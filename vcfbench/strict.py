"""Plain values into frozen structs; every mistake is one line with its place, the expected value and the given one.

msgspec says what is wrong in words of its own, which end in " - at `$.path`"; value and type are looked up there.
"""

import difflib
import re
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from vcfbench.errors import ConfigError
from vcfbench.typed import typed

Keys = tuple[str | int, ...]
Naming = Callable[[Keys], str]
"""Says where a key stands, for errors: ``station.toml: procedure.samples``."""

NAME_PATTERN = r"\A[A-Za-z0-9][A-Za-z0-9_.-]{0,63}\Z"
ADDRESS_PATTERN = r"\A(?:[^\s:\[\]]+|\[[0-9A-Fa-f:]+\]):[0-9]{1,5}\Z"

_T = TypeVar("_T")
_SOME = 8
"""Names that one line can hold and a person still reads."""
_AT = re.compile(r" - at `\$(?P<path>.*)`$", re.DOTALL)
_STEP = re.compile(r"\.(?P<key>[^.\[]+)|\[(?P<index>\d+)\]")
_UNKNOWN = re.compile(r"unknown field `(?P<key>.*)`", re.DOTALL)
_MISSING = re.compile(r"missing required field `(?P<key>.*)`")


def converted(raw: Any, kind: type[_T], naming: Naming) -> _T:
    """Return `raw` as a `kind`; ConfigError: a key is unknown or missing, or a value cannot be."""
    try:
        return typed(raw, kind)
    except msgspec.ValidationError as error:
        raise _explain(str(error), raw, kind, naming) from None


def refusal(where: str, expected: str, came: str) -> ConfigError:
    """Return the error that names the expected value at `where`, and the given one."""
    return ConfigError(f"{where}: expected {expected}, got {came}")


def unknown_key(key: str, known: Sequence[str], where: str) -> ConfigError:
    """Return the error that says that `key` is none of `known`; close ones are suggested."""
    error, (table, _, rest) = refusal(where, one_of(key, known, "key"), "an unknown key"), key.partition(".")
    if rest and table in known:
        error.hint = f"in Python a table is a mapping, {{{table!r}: {{{rest!r}: ...}}}}; in a file no quotes: {key}"
    return error


def one_of(name: str, known: Sequence[str], what: str) -> str:
    """Raise an error with the names that were expected for `name`: near ones, else a few of `known`."""
    parts = {part for part in name.split("_") if len(part) > 3}
    alike = [each for each in known if parts & {*each.split("_")}]
    if close := difflib.get_close_matches(name, known, n=1) or alike[:3]:
        return f"a known {what} ({' or '.join(map(repr, close))}?)"
    some = ", ".join(known[:_SOME])
    return f"one of {some}" if len(known) <= _SOME else f"one of {len(known)} {what}s ({some}, ...)"


def words(value: object) -> str:
    """Describe a given value, short and on one line."""
    if isinstance(value, dict):
        return "a table"
    if value is None or isinstance(value, bool):
        return "nothing" if value is None else str(value).lower()
    text = repr(value)
    if isinstance(value, str | int | float | list):
        return text if len(text) <= 60 else f"{text[:57]}..."
    return f"{type(value).__name__} {value}"


def _explain(message: str, raw: Any, kind: Any, naming: Naming) -> ConfigError:
    where = _AT.search(message)
    steps = _STEP.finditer(where["path"].partition("[...]")[0] if where else "")  # behind that is in a mapping
    keys: Keys = tuple(step["key"] or int(step["index"]) for step in steps)
    what = message[: where.start()] if where else message
    if unknown := _UNKNOWN.search(what):
        node = _type_at(kind, keys)
        return unknown_key(
            unknown["key"],
            (tuple(field.encode_name for field in node.fields) if isinstance(node, inspect.StructType) else ()),
            naming((*keys, unknown["key"])),
        )
    if missing := _MISSING.search(what):
        path = (*keys, missing["key"])
        return refusal(naming(path), expectation(_type_at(kind, path)), "nothing")
    for key in keys:
        raw = raw[key]
    return refusal(naming(keys), expectation(_type_at(kind, keys)), words(raw))


# --- the expected type, in words ---


def _type_at(kind: Any, keys: Keys) -> inspect.Type:
    node: inspect.Type = inspect.type_info(kind)
    for key in keys:
        match _bare(node):
            case inspect.StructType(fields=fields):
                node = next(field.type for field in fields if field.encode_name == key)
            case inspect.TupleType(item_types=types) if isinstance(key, int):
                node = types[key]
            case inspect.VarTupleType(item_type=item):
                node = item
            case _:
                node = inspect.AnyType()
    return _bare(node)


def _bare(node: inspect.Type) -> inspect.Type:
    """Return `node` without its description, and without that it may be missing."""
    while isinstance(node, inspect.Metadata):
        node = node.type
    if not isinstance(node, inspect.UnionType):
        return node
    types = [part for part in node.types if not isinstance(part, inspect.NoneType)]
    return _bare(types[0]) if len(types) == 1 else inspect.UnionType(tuple(types))


def expectation(node: inspect.Type) -> str:
    """Describe a value of the type `node`: ``a whole number at least 2 and at most 100``."""
    bare = _bare(node)
    match bare:
        case inspect.UnionType(types):
            said = " or ".join(map(expectation, types))
        case inspect.LiteralType(values):
            said = " or ".join(sorted(map(repr, values)))
        case inspect.EnumType(cls):
            said = " or ".join(repr(member.value) for member in cls)
        case inspect.FloatType() | inspect.IntType():
            kind = "a number" if isinstance(bare, inspect.FloatType) else "a whole number"
            bounds = (("above", bare.gt), ("at least", bare.ge), ("below", bare.lt), ("at most", bare.le))
            within = " and ".join(f"{word} {bound:.16g}" for word, bound in bounds if bound is not None)
            said = f"{kind} {within}".rstrip()
        case inspect.StrType(pattern=pattern) if pattern == ADDRESS_PATTERN:
            said = "a text with host and port, as in 127.0.0.1:20220"
        case inspect.StrType(pattern=pattern) if pattern == NAME_PATTERN:
            said = "a text of letters, digits, '_', '-' and '.'"
        case inspect.StrType(min_length=least, max_length=most):
            said = f"a text of {least} to {most} characters on one line" if most else "a text"
        case _:
            said = _shape(bare)
    return said


def _shape(node: inspect.Type) -> str:
    if isinstance(node, inspect.BoolType):
        return "true or false"
    if isinstance(node, inspect.DateType):
        return "a day, as in 2026-01-15"
    if isinstance(node, inspect.TupleType):
        return f"a list of {len(node.item_types)} numbers"
    if isinstance(node, inspect.VarTupleType) and node.max_length is not None:
        items = "numbers" if isinstance(_bare(node.item_type), inspect.FloatType | inspect.IntType) else "texts"
        return f"a list of {node.min_length or 0} to {node.max_length} {items}"
    if isinstance(node, inspect.VarTupleType | inspect.ListType | inspect.SetType | inspect.FrozenSetType):
        return "a list"
    return "a table"
