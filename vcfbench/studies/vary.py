"""Varied paths of a study: dotted paths into the bench file or the settings, with values listed or drawn by the seed.

``[vary]`` of a study file has a key for each path::

    "settings.samples" = [5, 10, 20]
    "simulation.override.sense_anti_phase.frequency_hz" = { from = 3464.1, to = 3472.9, steps = 5 }
    "simulation.override.table.rate_error" = { uniform = [-1e-5, 1e-5] }
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct
from numpy.random import SeedSequence, default_rng

from vcfbench.errors import ConfigError
from vcfbench.files import dotted, shown
from vcfbench.station.layering import keys_of
from vcfbench.strict import converted, refusal, words

SETTINGS = "settings"  # First part of a path that is a setting of the procedure; all others are keys of the bench file

_STREAM = 0x5354_5544  # Keeps the random numbers of studies from those of the simulation, which come from the same seed


class _Form(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Form of a path to vary."""

    label: Annotated[str, Meta(min_length=1, max_length=80)] | None = None


class _Listed(_Form, frozen=True):
    """``{ values = [...] }``."""

    values: Annotated[tuple[Any, ...], Meta(min_length=1)]


class _Range(_Form, frozen=True, rename={"begin": "from", "end": "to"}):
    """``{ from = 1.0, to = 2.0, steps = 5 }``: both ends are in it; whole numbers, where all of them are."""

    begin: int | float
    end: int | float
    steps: Annotated[int, Meta(ge=2, le=10_000)]
    spacing: Literal["linear", "log"] = "linear"


class _Uniform(_Form, frozen=True):
    """``{ uniform = [low, high] }``."""

    uniform: tuple[float, float]


class _Normal(_Form, frozen=True):
    """``{ normal = [mean, standard deviation] }``."""

    normal: tuple[float, float]


class _Choice(_Form, frozen=True):
    """``{ choice = [...] }``: any of them, each as likely."""

    choice: Annotated[tuple[Any, ...], Meta(min_length=1)]


_FORMS: Mapping[str, type[Struct]] = {
    "values": _Listed,
    "from": _Range,
    "uniform": _Uniform,
    "normal": _Normal,
    "choice": _Choice,
}
_EXPECTED = "a list, { values = }, { from =, to =, steps = }, { uniform = }, { normal = } or { choice = }"


class Varied(Struct, frozen=True):
    """A path that a study varies; `label` is the name of its column."""

    path: str
    label: str


class Listed(Varied, frozen=True):
    """With values that make the cases of the study."""

    values: tuple[Any, ...]


class Drawn(Varied, frozen=True):
    """With a value drawn for each seed, the same in all cases; `of` are ends, mean and deviation, or the choices."""

    law: Literal["uniform", "normal", "choice"]
    of: tuple[Any, ...]

    def value(self, seed: int) -> Any:
        """Return the value for `seed`: it depends on nothing but that, path and law."""
        random = default_rng(SeedSequence(seed, spawn_key=(_STREAM, *self.path.encode())))
        if self.law == "choice":
            return self.of[int(random.integers(len(self.of)))]
        return float(random.uniform(*self.of) if self.law == "uniform" else random.normal(*self.of))


def varied(table: Mapping[str, Any], source: str) -> tuple[Varied, ...]:
    """Return the paths of ``[vary]`` of the study file `source`, in its order.

    Raises:
        ConfigError: a path is given twice or is none, or its values are of no known form.
    """
    found: dict[str, Varied] = {}
    for path, value in leaves(table):
        where = f"{source}: vary.{shown(path)}"
        one = _varied(path, value, where)
        if path in found:
            raise refusal(where, "each path once", "the same one again")
        if one.label in {each.label for each in found.values()} or one.label in _TAKEN:
            raise refusal(where, "a label of its own", repr(one.label))
        found[path] = one
    return tuple(found.values())


_TAKEN = {"case", "seed", "status", "message", "verdict", "bench_seconds"}  # Columns that every study has


def leaves(table: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Yield every path with its values: TOML takes dots in a bare key for tables within tables."""
    for key, value in table.items():
        path = (*above, key)
        if isinstance(value, Mapping) and not _FORMS.keys() & value.keys() and value:
            yield from leaves(value, path)
        else:
            yield ".".join(path), value


def _varied(path: str, value: Any, where: str) -> Varied:
    if isinstance(value, list):
        value = {"values": value}
    kind = next((form for word, form in _FORMS.items() if isinstance(value, Mapping) and word in value), None)
    if kind is None or not keys_of(path):
        raise refusal(where, _EXPECTED, words(value))
    said: Any = converted(value, kind, lambda keys: f"{where}{'.' if keys else ''}{dotted(keys)}")
    label = said.label or path
    if isinstance(said, _Listed):
        return Listed(path, label, said.values)
    if isinstance(said, _Range):
        if said.spacing == "log" and not (said.begin > 0.0 and said.end > 0.0):
            raise refusal(where, "both ends above 0 for logarithmic steps", f"{said.begin:g} to {said.end:g}")
        space = np.geomspace if said.spacing == "log" else np.linspace
        values = space(said.begin, said.end, said.steps)
        whole = (
            isinstance(said.begin, int)
            and isinstance(said.end, int)
            and np.allclose(values, values.round(), rtol=1e-12, atol=0.0)
        )
        return Listed(path, label, tuple(values.round().astype(int).tolist() if whole else values.tolist()))
    if isinstance(said, _Uniform) and said.uniform[0] > said.uniform[1]:
        raise refusal(f"{where}.uniform", "the lower end first", words(list(said.uniform)))
    if isinstance(said, _Normal) and said.normal[1] < 0.0:
        raise refusal(f"{where}.normal", "a mean and a standard deviation of at least 0", words(list(said.normal)))
    law = next(name for name in ("uniform", "normal", "choice") if hasattr(said, name))
    return Drawn(path, label, law, getattr(said, law))  # type: ignore[arg-type]  # one of the three


def count(axes: Sequence[Listed], how: str) -> int:
    """Return the number of cases that :func:`combined` would make; none is made for it."""
    numbers = [len(axis.values) for axis in axes]
    return math.prod(numbers) if how == "grid" else max(numbers, default=1)


def combined(axes: Sequence[Listed], how: str, source: str) -> tuple[dict[str, Any], ...]:
    """Return the values of each case by path: every one with every other (``grid``), or the first with the first.

    Raises:
        ConfigError: values that are to be paired are not of one number.
    """
    columns = [axis.values for axis in axes]
    numbers = {axis.path: len(axis.values) for axis in axes}
    if how != "grid" and len(set(numbers.values())) > 1:
        came = ", ".join(f"{number} of {path}" for path, number in numbers.items())
        raise refusal(f"{source}: combine", "as many values of each path, to pair them", came)
    rows = product(*columns) if how == "grid" or not axes else zip(*columns, strict=True)
    return tuple(dict(zip(numbers, row, strict=True)) for row in rows)


def placed(table: Mapping[str, Any], path: str, value: Any, where: str) -> dict[str, Any]:
    """Return a copy of the nested `table` with `value` at `path`; tables on the way that are missing are made.

    Raises:
        ConfigError: a part of the path is no table, or a list without such an entry; `where` begins its words.
    """
    copy: Any = _put(dict(table), keys_of(path), value, where)
    return dict(copy)


def _put(node: Any, keys: Sequence[str | int], value: Any, where: str) -> Any:
    if not keys:
        return value
    key, below = keys[0], keys[1:]
    if isinstance(key, int):
        if not isinstance(node, list | tuple) or not key < len(node):
            raise ConfigError(f"{where}: expected a list with an entry [{key}], got {words(node)}")
        return [_put(each, below, value, where) if place == key else each for place, each in enumerate(node)]
    if not isinstance(node, Mapping):
        raise ConfigError(f"{where}: expected a table that holds {key!r}, got {words(node)}")
    return {**node, key: _put(node.get(key, {}) if below else None, below, value, where)}
