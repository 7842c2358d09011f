"""Every number of a simulated bench, with unit, meaning and source."""

import ast
import inspect
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from textwrap import dedent
from typing import Any

from msgspec.structs import replace

from vcfbench.records.plain import field_names
from vcfbench.sim.builder import instrument_errors
from vcfbench.sim.parameters import ParameterRow
from vcfbench.sim.simulation import chosen_seed, named_parameters, physical_parameters, simulation_of
from vcfbench.station.description import BenchDescription

_CHOSEN = "chosen in the bench file"

_UNITS = (
    ("lsb_per_deg_s", "LSB/(deg/s)"),
    ("_deg_s2", "deg/s^2"),
    ("_deg_s", "deg/s"),
    ("_deg", "deg"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_ohm", "ohm"),
    ("_f", "F"),
    ("_v_per_a", "V/A"),
    ("_v", "V"),
    ("_a", "A"),
    ("_s", "s"),
    ("_ppm", "ppm"),
)
"""Units by the end of a field's name, the longest first."""


def inventory(description: BenchDescription, seed: int | None = None) -> list[ParameterRow]:
    """Return every physical parameter and every instrument error of the bench; errors as drawn by `seed`.

    Paths are those of the bench file's ``[simulation]``.

    Raises:
        ConfigError: the bench is a real one.
    """
    used, shipped = chosen_seed(description, seed), named_parameters(simulation_of(description)).rows()
    found: list[ParameterRow] = []
    for row, usual in zip(physical_parameters(description).rows(), shipped, strict=True):
        source = usual.source if row.value == usual.value else _CHOSEN
        found.append(replace(row, path=f"override.{row.path}", source=source))
    for role, group in instrument_errors(description, used).items():  # their meanings tell the distributions
        asked = getattr(simulation_of(description).errors, role)
        share = asked.get("drawn", 0.0) if isinstance(asked, dict) else float(asked == "drawn")
        drawn = f"drawn from the published accuracy by seed {used}" if share else "none: a perfect instrument"
        found += _rows(group, f"errors.{role}", drawn, asked)
    return found


def _rows(group: Any, path: str, usual: str, asked: Any) -> Iterator[ParameterRow]:
    """Yield the numbers of a group; the source of those of `asked` is the bench file, of the others the `usual` one."""
    kind: type = type(group)
    meanings = _field_docstrings(kind)
    for name in field_names(group) or ():
        here, value = f"{path}.{name}", getattr(group, name)
        chosen = asked.get(name) if isinstance(asked, Mapping) else None
        source = usual if chosen is None else _CHOSEN
        if field_names(value) is not None:
            yield from _rows(value, here, usual, chosen)
        elif isinstance(value, tuple) and value and field_names(value[0]) is not None:
            for index, entry in enumerate(value):
                yield from _rows(entry, f"{here}[{index}]", source, None)
        else:
            unit = next((unit for end, unit in _UNITS if name.endswith(end)), "1")
            yield ParameterRow(here, value, "" if isinstance(value, bool) else unit, meanings.get(name, ""), source)


@cache  # finding a class in its file takes a while
def _field_docstrings(kind: type) -> dict[str, str]:
    """Return the docstrings that follow the fields of a class; Python itself forgets them."""
    (definition,) = ast.parse(dedent(inspect.getsource(kind))).body
    assert isinstance(definition, ast.ClassDef)  # noqa: S101  # the source of a class is one
    return {
        field.target.id: " ".join(text.value.value.split())
        for field, text in pairwise(definition.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }
