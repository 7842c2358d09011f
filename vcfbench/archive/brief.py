"""The answer of a run on one screen: values with U95, verdict, largest causes, missing inputs."""

from collections.abc import Iterator
from typing import Final

from vcfbench.archive.run import Run
from vcfbench.reports.document import Column, Part, Report, Table, Text
from vcfbench.values.printing import digits_of_value, grouped, in_digits, in_threes
from vcfbench.values.value import Value

_MOST: Final = 20  # Values on one screen
_CAUSED: Final = 3  # Values of which causes are named, and causes of each
_LEAST: Final = 0.5  # Share of the variance below which a cause is not named, %
_COLUMNS: Final = (Column("quantity", align="left"), Column("value"), Column("U95"), Column("unit", align="left"))


def brief(run: Run) -> Report | None:
    """Return the values of `run` with U95, its verdict, largest causes and missing inputs; None if no value has U95."""
    values = tuple(run.values.values())
    return Report(tuple(_parts(run, values))) if any(each.u95 for each in values) else None


def _parts(run: Run, values: tuple[Value, ...]) -> Iterator[Part]:
    yield Table(_COLUMNS, [_row(each) for each in values[:_MOST]])
    words = [f"and {len(values) - _MOST} more values"] if len(values) > _MOST else []
    caused = [each for each in values if each.parts and each.u][:_CAUSED]
    words += [f"U95 of {each.named.words}: {', '.join(_causes(each))}" for each in caused]
    if missing := dict.fromkeys(name for each in values for name in each.missing):
        words.append(f"INCOMPLETE: U95 lacks {', '.join(missing)} (not in the bench file)")
    if words:
        yield Text("\n".join(words))
    yield from run.remarks


def _row(value: Value) -> tuple[str, str, str, str]:
    """Return the cells of a value: its name, the value without its u, U95, unit."""
    of = value.named
    found = of.factor * (value.value or 0.0)
    if value.form != "plus-minus" or value.u95 is None:
        plain = value.form == "plus-minus" and value.u is None
        return of.words, f"{found:.4g}" if plain else value.figure(of.factor), "-", of.unit
    u95 = abs(of.factor) * value.u95
    return of.words, in_threes(in_digits(found, digits_of_value(found, u95))), grouped(u95), of.unit


def _causes(value: Value) -> Iterator[str]:
    """Yield the largest contributions to an uncertainty, with their shares of its variance."""
    whole = sum(part.u**2 for part in value.parts) or 1.0
    for part in sorted(value.parts, key=lambda part: -abs(part.u))[:_CAUSED]:
        if (share := 100.0 * part.u**2 / whole) >= _LEAST:
            yield f"{part.source} {share:.0f} %"
