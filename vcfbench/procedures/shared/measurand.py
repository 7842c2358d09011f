"""Measured values as they are reported: one combined uncertainty, its contributions, and its omissions."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean, stdev

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.budget import Source, convolved_coverage_factor, summed
from vcfbench.records.device_values import Measured, Share
from vcfbench.reports.document import Cell, Table, heads
from vcfbench.values.kinds import kind_of
from vcfbench.values.printing import digits_of_u, digits_of_value, incomplete
from vcfbench.values.value import UncertaintyPart, Unstated, Value

_ROUNDING = 1e-9
"""A part of u that is smaller, against all of it, is left by rounding."""


class Measurand(Struct, frozen=True):
    """A value with its combined standard uncertainty, all sources in it; their parts add up in squares."""

    value: float
    u: float
    unit: str
    dof: float | None
    """Effective degrees of freedom, None where they are as many as one likes."""
    coverage_factor: float
    expanded_u: float
    """Half width of the interval that holds the true value with 95 %."""
    parts: tuple[UncertaintyPart, ...]
    """The largest first."""
    complete: bool = True
    missing: tuple[str, ...] = ()
    """Contributions that `u` lacks because nobody tells them; none where it is complete."""

    def printed(self) -> tuple[Cell, Cell, Cell]:
        """Return value, u and U95 as they are printed: two digits of either, the value to the last one of u."""
        return stated_cells(self.value, self.u, self.expanded_u)

    def as_value(self, name: str, kind: str | None = None, words: str = "", of: str = "") -> Value:
        """Return it as a value of a run, of the kind that has its name and unit where none is said."""
        return Value(
            *(name, self.value, self.unit, self.u, self.dof, self.expanded_u),
            kind=kind_of(name, self.unit) if kind is None else kind,
            words=words,
            of=of,
            parts=self.parts,
            missing=self.missing,
        )

    def kept(self) -> Measured:
        """Return it as it is kept of a device."""
        shares = tuple(Share(source=part.source, u=part.u, of=part.of, dof=part.dof) for part in self.parts)
        return Measured(value=self.value, u=self.u, dof=self.dof, shares=shares, missing=self.missing)


def stated_cells(value: float, u: float, u95: float) -> tuple[Cell, Cell, Cell]:
    """Return value, u and U95 as they are printed: two digits of either uncertainty, the value to the last one of u."""
    return Cell(value, digits_of_value(value, u)), Cell(u, digits_of_u(u)), Cell(u95, digits_of_u(u95))


def titled(words: str, found: Measurand, kind: str = "") -> Value:
    """Return a value that is called by its words, by programs too."""
    return found.as_value(re.sub(r"\W+", "_", words).strip("_").lower(), kind, words)


def finite(dof: float) -> float | None:
    """Return degrees of freedom as values have them: None where they are as many as one likes."""
    return dof if math.isfinite(dof) else None


def measurand(value: float, unit: str, parts: Sequence[UncertaintyPart], missing: Iterable[str] = ()) -> Measurand:
    """Return `value` with the combined uncertainty of independent `parts`, after the GUM (Welch and Satterthwaite).

    It is incomplete without what is `missing`.
    """
    sources = [
        Source(
            *(f"{number}: {part.source}", 0.0, abs(part.u), unit, math.inf if part.dof is None else part.dof),
            part.rectangular,
        )
        for number, part in enumerate(parts)
    ]
    result = summed(sources, value)
    by_size = tuple(sorted(parts, key=lambda part: -abs(part.u)))
    factor = convolved_coverage_factor(result, sources)
    without, dof = tuple(dict.fromkeys(missing)), finite(result.dof)
    return Measurand(value, result.u, unit, dof, factor, factor * result.u, by_size, not without, without)


def difference(first: Measurand, second: Measurand) -> Measurand:
    """Return the difference of two values of one unit; one owner's error acts with the difference of its effects."""
    parts = [*first.parts, *(replace(part, u=-part.u) for part in second.parts)]
    return measurand(first.value - second.value, first.unit, _owned_once(parts), (*first.missing, *second.missing))


def quotient(first: Measurand, second: Measurand, unit: str) -> Measurand:
    """Return the quotient of two values; an error of one owner that is the same part of both cancels."""
    value, size = first.value / second.value, abs(second.value)
    parts = [replace(part, u=abs(part.u) / size) for part in first.parts]
    parts += [replace(part, u=-abs(value * part.u) / size) for part in second.parts]
    return measurand(value, unit, _owned_once(parts), (*first.missing, *second.missing))


def _owned_once(parts: Iterable[UncertaintyPart]) -> list[UncertaintyPart]:
    """Return the parts, those of one owner and source added up with their signs: they are one error."""
    found: dict[object, UncertaintyPart] = {}
    for place, part in enumerate(parts):
        key = place if part.of is None else (part.of, part.source)
        found[key] = replace(part, u=found[key].u + part.u) if key in found else part
    return list(found.values())


def mean_of_records(values: Sequence[float], unit: str, *others: UncertaintyPart) -> Measurand:
    """Return the mean of records with their scatter."""
    scatter = UncertaintyPart("records", stdev(values) / math.sqrt(len(values)), len(values) - 1)
    return measurand(fmean(values), unit, [scatter, *others])


def said_of(name: str, found: Measurand) -> str:
    """Return a line: value, unit, standard and expanded uncertainty; `u` also in ppm where a ratio means something."""
    # The share of a bias, whose zero is anywhere, or of what is in ppm itself, means nothing
    ratio = found.value and found.unit not in {"V", "deg/s", "ppm"}
    relative = f", {1e6 * found.u / abs(found.value):.0f} ppm" if ratio else ""
    factor = f"k = {found.coverage_factor:.2f}"
    value = format(found.value, digits_of_value(found.value, found.u))
    u, u95 = (format(each, digits_of_u(each)) for each in (found.u, found.expanded_u))
    return f"{name}: {value} {found.unit}, u {u}{relative}, U95 {u95} ({factor}){incomplete(found.missing)}"


QUANTITY_COLUMNS = heads("<quantity | value:.6g | u:.2g | U95:.2g | <unit | <u is made of")


def quantity_table(quantities: Mapping[str, Measurand], title: str = "") -> Table:
    """Return a table of values by name."""
    return Table(QUANTITY_COLUMNS, [quantity_row(*each) for each in quantities.items()], title)


def value_table(values: Iterable[Value | Unstated]) -> Table:
    """Return a table of the values that results state, each in its form."""
    rows: list[tuple[Cell | str | None, ...]] = []
    for each in values:
        if isinstance(each, Unstated):
            continue
        parts = ", ".join(f"{part.source} {abs(part.u):.2g}" for part in each.parts)
        words = each.named.words
        if each.value is None or each.u is None or each.u95 is None:
            rows.append((words, each.figure(), None, None, each.unit, parts))
        else:
            rows.append((words, *stated_cells(each.value, each.u, each.u95), each.unit, parts))
    return Table(QUANTITY_COLUMNS, rows)


def quantity_row(name: str, found: Measurand) -> tuple[Cell | str, ...]:
    """Return the row of a value in a table with `QUANTITY_COLUMNS`."""
    return (name, *found.printed(), found.unit, made_of(found))


def made_of(found: Measurand, digits: str = ".2g") -> str:
    """Name the contributions to the uncertainty of `found`, with their sizes."""
    return ", ".join(f"{each.source} {abs(each.u):{digits}}" for each in found.parts)


def budget_table(name: str, found: Measurand) -> Table:
    """Return the contributions to the uncertainty of `found`, the largest first."""
    columns = heads(
        f"<source | u [{found.unit}]:.2g | u [ppm]:.2f | share [%]:.1f | degrees of freedom:.3g | <shared with"
    )
    rows = []
    for part in found.parts:
        u = abs(part.u) if abs(part.u) > _ROUNDING * found.u else 0.0
        ppm = 1e6 * abs(part.u / found.value) if found.value else None
        share = 100.0 * (part.u / found.u) ** 2 if found.u else None
        rows.append((part.source, u, ppm, share, part.dof, part.of or ""))
    title = f"uncertainty of {name}: u {found.u:.3g} {found.unit}, U95 {found.expanded_u:.3g}"
    return Table(columns, rows, title + incomplete(found.missing))
