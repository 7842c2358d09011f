"""Every single part of every u is what the table of parts says, by hand and by what a change does to the simulation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from tests.procedures.parts import values
from tests.procedures.parts.held import Part, Run, grouped, parts_of
from tests.procedures.parts.procedures import PROCEDURES, Held, parts_of_table
from tests.procedures.parts.simulated import Change
from vcfbench.uncertainty.statement import StatedValue

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

PARTS, KEPT = parts_of_table(), values.kept()

_CLOSE, _OF_U = 0.06, 0.01
"""A part may be off by so much of itself, for second orders of the gyroscope's curves, and by so much of u."""
_NO_ROW = 0.05
"""Share of u up to which a source may move a value without a row."""


@pytest.mark.parametrize(
    ("held", "gyroscope"),
    [
        pytest.param(held, each, id=held.key(each), marks=[pytest.mark.exhaustive] * (later > 0 or held.slow))
        for held in PROCEDURES
        for later, each in enumerate(held.gyroscopes)
    ],
)
def test_parts_match_the_table_and_numbers_are_unchanged(held: Held, gyroscope: str) -> None:
    run, rows = held.run(gyroscope), PARTS[held.procedure]
    moved = [(part, part.moves(run)) for part in rows]
    wrong = [*_left_over(run, rows), *_wrong(run, moved), *_not_in_it(run, moved), *_turned(run, moved)]
    if (kept := KEPT.get(held.key(gyroscope))) is not None:
        wrong += values.differing(values.of_run(run), kept)
    assert "\n".join(wrong) == ""


def _left_over(run: Run, rows: Sequence[Part]) -> Iterator[str]:
    """Yield the parts that no row has, and what is not the root of the squares."""
    for name, value in run.values.items():
        found, named = grouped(value), {part.source for part in rows if part.has(name)}
        for source, u in found.items():
            if source not in named and u > 1e-6 * value.u:
                yield f"{name}: {source}, {u:.3g} of u {value.u:.3g}, is in no row"
        if abs((total := math.hypot(*found.values())) - value.u) > 1e-9 * value.u:
            yield f"{name}: u {value.u:.6g} is not that of its parts, {total:.6g}"


def _wrong(run: Run, moved: Sequence[tuple[Part, dict[str, float]]]) -> Iterator[str]:
    """Yield the parts that are missing, of another size or owner, or known by other degrees of freedom."""
    for part, by in moved:
        role = part.owner.removeprefix("role ")
        owner = part.owner if role == part.owner else run.settings.station.instruments[role].owner
        for name, value in run.values.items():
            if not part.has(name):
                continue
            came, must = grouped(value).get(part.source), abs(by.get(name, 0.0)) * part.u
            about = f"{name}: {part.source} ({part.why})"
            if came is None:
                yield f"{about} is missing, must be {must:.3g} of u {value.u:.3g}"
            elif part.by is not None and abs(came - must) > _CLOSE * must + _OF_U * value.u:
                yield f"{about} is {came:.4g}, must be {must:.4g} of u {value.u:.3g}"
            for source, _, dof, of, rectangle in parts_of(value):
                if part.source not in {source, source.partition(": ")[0]}:
                    continue
                if owner not in (of or "") or bool(of) != bool(owner) or rectangle != part.rectangle:
                    yield f"{about} is of {of}, a rectangle {rectangle}; must be of {owner}, {part.rectangle}"
                if (dof is None) != (part.dof is None) or (part.dof not in {None, math.inf} and dof != part.dof):
                    yield f"{about} has {dof} degrees of freedom, must have {part.dof}"


def _not_in_it(run: Run, moved: Sequence[tuple[Part, dict[str, float]]]) -> Iterator[str]:
    """Yield the values that a source moves though no row says so."""
    said: dict[int, set[str]] = {}
    for part, _ in moved:
        said.setdefault(id(part.by), set()).update(n for n in run.values if part.has(n) or part.free_of(n))
    for part, by in moved:
        for name, value in run.values.items():
            must = abs(by.get(name, 0.0)) * part.u
            if isinstance(part.by, Change) and name not in said[id(part.by)] and must > _NO_ROW * value.u:
                yield f"{name}: {part.source} moves it by {must:.3g} of u {value.u:.3g}, and is in no row"


def _turned(run: Run, moved: Sequence[tuple[Part, dict[str, float]]]) -> Iterator[str]:
    """Yield the sources whose sensitivities have the sign of the effect in one value, and the other in another."""
    for part, by in moved:
        signs = {
            name: signed * by[name] > 0.0
            for name, value in run.values.items()
            if isinstance(part.by, Change) and isinstance(value, StatedValue) and part.has(name)
            for source, signed, *_ in parts_of(value)
            if source == part.source and abs(by[name]) * part.u > _OF_U * value.u
        }
        if len(set(signs.values())) > 1:
            yield f"{part.source} has the sign of its effect in some values and not in others: {signs}"
