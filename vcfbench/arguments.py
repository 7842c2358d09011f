"""Arguments of the public functions, held against their annotations: a wrong one is a ConfigError with its name."""

import builtins
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from datetime import date
from functools import cache, wraps
from inspect import Parameter, Signature, signature
from numbers import Integral, Real
from pathlib import Path
from sys import modules
from types import FunctionType, NoneType, UnionType
from typing import Any, Final, Union, get_args, get_origin, get_type_hints

from vcfbench.strict import refusal, words

UNIONS: Final = (Union, UnionType)
_NUMBERS: Final[dict[Any, Any]] = {int: Integral, float: Real}
"""What counts as a number: numpy's are registered there."""
_SEVERAL: Final = (Sequence, Collection, Iterable)
_WORDS: Final[dict[Any, str]] = {
    str: "a text",
    Path: "a path",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    date: "a date",
    Mapping: "a mapping",
    dict: "a mapping",
    tuple: "a tuple",
    Callable: "a function",
    NoneType: "None",
}

_SAID_THERE: Final = {
    **dict.fromkeys(("run", "dry_run", "start"), frozenset({"procedure", "bench", "settings", "metadata"})),
    "open_bench": {"bench"},
    "safe_bench": {"bench"},
    "load_bench": {"path"},
    "compare_runs": {"runs"},
    "analyze": {"compared"},
}
"""Parameters by function that it refuses itself, with more words."""


class _Anything:
    """Type of a module that imports it for types alone."""

    def __class_getitem__(cls, _: Any) -> type:
        return cls


class _Names(dict[str, Any]):
    """Names of a module."""

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, _Anything)


def checked(function: Any) -> Any:
    """Return a public function that holds its arguments against their annotations; anything else as it is.

    ConfigError: one is of another type; it names the parameter, the expected types and what came.
    """
    if not isinstance(function, FunctionType):
        return function

    @cache
    def expected() -> tuple[Signature, dict[str, Any]]:
        return signature(function), get_type_hints(function, localns=_Names(function.__globals__))

    @wraps(function)
    def call(*positional: Any, **named: Any) -> Any:
        parameters, hints = expected()
        try:
            given = parameters.bind(*positional, **named).arguments
        except TypeError:
            return function(*positional, **named)  # Python says itself which argument is missing or unknown
        for name in (each for each in given if each not in _SAID_THERE.get(function.__name__, ())):
            value = given[name]
            several = parameters.parameters[name].kind is Parameter.VAR_POSITIONAL
            for each in value if several else (value,):
                require(name, each, hints[name])
        return function(*positional, **named)

    call.__module__ = "vcfbench"  # where pickle finds it
    return call


def require_fields(made: Any, *names: str) -> None:
    """Hold fields of a value that somebody made against their annotations, as :func:`checked` does arguments.

    Raises:
        ConfigError: one is of another type; it names the field, the expected types and what came.
    """
    hints = hints_of(type(made))
    for name in names:
        require(name, getattr(made, name), hints[name])


def hints_of(kind: type) -> dict[str, Any]:
    """Return the annotations of the fields of a class."""
    return get_type_hints(kind, localns=_Names(vars(modules[kind.__module__])))


def require_types(made: Any, called: str, types: Mapping[str, Any]) -> None:
    """Hold fields of a value that somebody made against `types`, as :func:`require` does."""
    for name, expected in types.items():
        require(f"{called}: {name}", getattr(made, name), expected)


def require(name: str, value: Any, hint: Any) -> None:
    """Raise ConfigError, with name and value, unless the value fits the annotation `hint`."""
    if not _fits(value, hint):
        came = words(value) if isinstance(value, str | int | float | None) else type(value).__name__
        raise refusal(name, " or ".join(dict.fromkeys(_said(hint))), came)


def require_number(name: str, value: Any) -> None:
    """Raise ConfigError unless `value` is a number."""
    if type(value) is not float:
        require(name, value, float)


def _fits(value: Any, hint: Any) -> bool:
    """Return True if `value` may be meant by `hint`; what numpy declares is left to who takes it."""
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind in UNIONS:
        return any(_fits(value, each) for each in inner)
    if kind in _NUMBERS:
        return isinstance(value, _NUMBERS[kind]) and not isinstance(value, bool)
    if not isinstance(kind, type) or kind is _Anything or kind.__module__.startswith("numpy"):
        return True
    if getattr(kind, "_is_protocol", False) and not kind.__module__.startswith(("collections", "typing")):
        own = [name for name in vars(kind) if name == "__call__" or not name.startswith("_")]
        # one that lacks some is told by who calls it
        return not isinstance(value, type) and any(hasattr(value, name) for name in own)
    if not isinstance(value, kind) or (kind in _SEVERAL and isinstance(value, str | bytes)):
        return False
    items: Any = value
    return kind is not Sequence or all(_fits(each, inner[0]) for each in items)


def _said(hint: Any) -> Iterator[str]:
    kind = get_origin(hint) or hint
    if kind in UNIONS:
        for each in get_args(hint):
            yield from _said(each)
    elif kind in _SEVERAL:
        yield f"a list, each {' or '.join(_said(get_args(hint)[0]))}"
    else:
        yield _WORDS.get(kind, getattr(kind, "__name__", str(kind)))
