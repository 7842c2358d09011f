"""The numbers in the results of a run, by name, with their uncertainties as far as the results tell them."""

from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import Struct

from vcfbench.archive.run import Run
from vcfbench.records.plain import plain

_USUAL_FACTOR = 2.0
"""Coverage factor for 95 % where only the standard uncertainty is told: that of a normal distribution."""


class ResultValue(Struct, frozen=True):
    """One number of a run's results.

    `name` is that of its field, with dots between where fields are nested; `u` the standard uncertainty, None where it
    is not known; `stated_u95` the half width of the 95 % interval where the results say it; `of` says what it is,
    `missing` what its uncertainty is incomplete without.
    """

    name: str
    value: float
    unit: str = ""
    u: float | None = None
    stated_u95: float | None = None
    of: str = ""
    missing: tuple[str, ...] = ()
    causes: tuple[tuple[str, float], ...] = ()
    """Sources and their contributions to `u`, the largest first; none where the results do not say."""

    @property
    def u95(self) -> float | None:
        """Expanded uncertainty for 95 %: as the results say it, else 2 u; None where no uncertainty is known."""
        if self.stated_u95 is not None:
            return self.stated_u95
        return None if self.u is None else _USUAL_FACTOR * self.u

    @property
    def coverage_factor(self) -> float | None:
        """The expanded uncertainty over the standard one; None where there is none."""
        return self.u95 / self.u if self.u and self.u95 is not None else None


def values_of(run: Run) -> dict[str, ResultValue]:
    """Return the numbers of the results of `run` by name, in their order; lists are left out.

    Where there is a statement of uncertainties (`results.uncertainty`), its values come before those of the same name:
    they have U95.
    """
    return {} if run.results is None else named_values(run.results)


def named_values(of_run: Any) -> dict[str, ResultValue]:
    """Return the numbers of the results of a run by name, as :func:`values_of`."""
    results = plain(of_run)
    if not isinstance(results, dict):
        return {}
    statement = results.get("uncertainty")
    values = statement.get("values") if isinstance(statement, dict) else None
    found: dict[str, ResultValue] = {}
    for each in values if isinstance(values, list) else ():
        if isinstance(each, dict) and isinstance(name := each.get("name"), str) and (value := _quantity(name, each)):
            found[name] = value
    for named in _named(results, ""):
        found.setdefault(named.name, named)
    return found


def _named(values: Mapping[str, Any], before: str) -> Iterator[ResultValue]:
    """Yield numbers and quantities, going down into values nested by names."""
    for key, value in values.items():
        name = f"{before}{key}"
        if (number := _number(value)) is not None:
            yield ResultValue(name, number)
        elif isinstance(value, dict) and (quantity := _quantity(name, value)) is not None:
            yield quantity
        elif isinstance(value, dict) and "value" not in value and key != "uncertainty":
            yield from _named(value, f"{name}.")


def _quantity(name: str, value: Mapping[str, Any]) -> ResultValue | None:
    """Return a value of a statement, or a measurand; None where there is no number."""
    if (number := _number(value.get("value"))) is None:
        return None
    u95 = next((value[each] for each in ("u95", "expanded_u") if _number(value.get(each)) is not None), None)
    words, missing = str(value.get("of", "")), tuple(value.get("missing", ()))
    parts = value.get("contributions") or value.get("parts") or ()
    causes = tuple(sorted(((each["source"], abs(each["u"])) for each in parts), key=lambda each: -each[1]))
    return ResultValue(name, number, str(value.get("unit", "")), _number(value.get("u")), u95, words, missing, causes)


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
