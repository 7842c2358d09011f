"""Measured values as they are reported: one combined uncertainty, its contributions, and its omissions."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean, stdev

from msgspec.structs import replace

from vcfbench.analysis.budget import Source, convolved_coverage_factor, summed
from vcfbench.records.device_values import Measured, Share
from vcfbench.reports.document import Cell, Table, heads
from vcfbench.values.printing import digits_of_u, digits_of_value, grouped, in_digits, incomplete
from vcfbench.values.value import Measurand, UncertaintyPart, Unstated, Value

_ROUNDING = 1e-9
"""A part of u that is smaller, against all of it, is left by rounding."""


def as_kept(found: Measurand) -> Measured:
    """Return a value as it is kept of a device."""
    shares = tuple(Share(source=part.source, u=part.u, of=part.of, dof=part.dof) for part in found.parts)
    return Measured(value=found.value, u=found.u, dof=found.dof, shares=shares, missing=found.missing)


def printed(found: Value) -> tuple[Cell | str, Cell | None, Cell | None]:
    """Return value, u and U95 as they are printed; what is stated otherwise in its form."""
    if found.value is None or found.u is None or found.u95 is None:
        return found.figure(), None, None
    return stated_cells(found.value, found.u, found.u95)


def stated_cells(value: float, u: float, u95: float) -> tuple[Cell, Cell, Cell]:
    """Return value, u and U95 as they are printed: two digits of either uncertainty, the value to the last one of u."""
    return Cell(value, digits_of_value(value, u)), Cell(u, digits_of_u(u)), Cell(u95, digits_of_u(u95))


def titled(words: str, found: Measurand) -> Measurand:
    """Return a value that is called by its words, by programs too."""
    return found.called(re.sub(r"\W+", "_", words).strip("_").lower(), "", words)


def divided(found: Measurand, by: float, u_by: float | None) -> Measurand:
    """Return a rate with the uncertainty of the scale factor that the output was divided by.

    Without a `u_by`, V/(deg/s) as `by` is, it is incomplete.
    """
    if u_by is None:
        return measurand(found.value, found.unit, found.parts, (*found.missing, "scale factor"), found.kind)
    part = UncertaintyPart("scale factor", abs(found.value * u_by / by))
    return measurand(found.value, found.unit, [*found.parts, part], found.missing, found.kind)


def finite(dof: float) -> float | None:
    """Return degrees of freedom as values have them: None where they are as many as one likes."""
    return dof if math.isfinite(dof) else None


def measurand(
    value: float,
    unit: str,
    parts: Sequence[UncertaintyPart],
    missing: Iterable[str] = (),
    kind: str = "",
) -> Measurand:
    """Return `value` with the combined uncertainty of independent `parts`, after the GUM (Welch and Satterthwaite).

    It is incomplete without what is `missing`. The parts stand in it by size.
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
    return Measurand(
        *("", value, unit, result.u, finite(result.dof), factor * result.u),
        kind=kind,
        parts=by_size,
        missing=tuple(dict.fromkeys(missing)),
    )


def difference(first: Measurand, second: Measurand) -> Measurand:
    """Return the difference of two values of one unit; one owner's error acts with the difference of its effects."""
    parts = [*first.parts, *(replace(part, u=-part.u) for part in second.parts)]
    return measurand(first.value - second.value, first.unit, _owned_once(parts), (*first.missing, *second.missing))


def quotient(first: Measurand, second: Measurand, unit: str, kind: str = "", *, less: float = 0.0) -> Measurand:
    """Return the first value `less` an exact one over the second; an error of one owner is one error."""
    value, size = (first.value - less) / second.value, abs(second.value)
    parts = [replace(part, u=abs(part.u) / size) for part in first.parts]
    parts += [replace(part, u=-abs(value * part.u) / size) for part in second.parts]
    return measurand(value, unit, _owned_once(parts), (*first.missing, *second.missing), kind)


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


def quality_of(records: Sequence[float]) -> Measurand:
    """Return the quality factor of ring-downs: noise moves the rate of each alike up and down, which is 1/Q.

    Noise that rings as the mode does makes their mean rate smaller, by about the square of their relative scatter.
    """
    rates = [1.0 / each for each in records]
    share = stdev(rates) / fmean(rates)
    u = math.hypot(share / math.sqrt(len(rates)), share**2) / fmean(rates)
    return measurand(1.0 / fmean(rates), "", [UncertaintyPart("records", u, len(rates) - 1)])


def said_of(name: str, found: Measurand) -> str:
    """Return a line: value, unit, standard and expanded uncertainty; `u` also in ppm where a ratio means something."""
    # The share of a bias, whose zero is anywhere, or of what is in ppm itself, means nothing
    ratio = found.value and found.unit not in {"V", "deg/s", "ppm"}
    relative = f", {grouped(1e6 * found.u / abs(found.value))} ppm" if ratio else ""
    factor = f"k = {found.coverage_factor or 0.0:.2f}"
    value = in_digits(found.value, digits_of_value(found.value, found.u))
    u, u95 = (in_digits(each, digits_of_u(each)) for each in (found.u, found.u95))
    return f"{name}: {value} {found.unit}, u {u}{relative}, U95 {u95} ({factor}){incomplete(found.missing)}"


def quantity_table(quantities: Mapping[str, Measurand], title: str = "") -> Table:
    """Return a table of values by name."""
    return value_table((found.called(name, "", name) for name, found in quantities.items()), title)


def value_table(values: Iterable[Value | Unstated], title: str = "") -> Table:
    """Return a table of the values that results state, each in its form."""
    found = [each for each in values if isinstance(each, Value)]
    rows = [(each.named.words, *printed(each), each.unit, made_of(each)) for each in found]
    return Table(heads("<quantity | value:.6g | u:.2g | U95:.2g | <unit | <contributions to u"), rows, title)


def made_of(found: Value, digits: str = ".2g") -> str:
    """Name the contributions to the uncertainty of `found`, with their sizes."""
    return ", ".join(f"{each.source} {abs(each.u):{digits}}" for each in found.parts)


def budget_table(name: str, found: Measurand) -> Table:
    """Return the contributions to the uncertainty of `found`, the largest first."""
    columns = heads(
        f"<source | u [{found.unit}]:.2g | u [ppm]:.2g | share [%]:.1f | degrees of freedom:.3g | <shared with"
    )
    rows = []
    for part in found.parts:
        u = abs(part.u) if abs(part.u) > _ROUNDING * found.u else 0.0
        ppm = 1e6 * abs(part.u / found.value) if found.value else None
        share = 100.0 * (part.u / found.u) ** 2 if found.u else None
        rows.append((part.source, u, ppm, share, part.dof, part.of or ""))
    title = f"uncertainty of {name}: u {grouped(found.u)} {found.unit}, U95 {grouped(found.u95)}"
    return Table(columns, rows, title + incomplete(found.missing))
