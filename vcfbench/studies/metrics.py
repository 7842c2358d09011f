"""Metrics of a run that a study keeps: one flat row of numbers by name."""

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from vcfbench.archive.run import Run
from vcfbench.records.plain import plain
from vcfbench.records.stated import stated, values_of
from vcfbench.station.description import BenchDescription
from vcfbench.studies.truth import truth_of
from vcfbench.values.kinds import KINDS

PARTS = (".u", ".u95", ".truth", ".z", ".covered")
"""Endings of names beside a value: its uncertainties, the true value, (value - truth)/u, and whether U95 holds it."""

_DEEPEST = 4


def metrics_of(run: Run, description: BenchDescription, patterns: Sequence[str]) -> dict[str, Any]:
    """Return the numbers of the results of `run` by name, those whose names one of `patterns` fits.

    What is stated with an uncertainty comes first, with u, U95 and, where the simulation knows it, the truth; then what
    ``[acceptance]`` can limit, then every other number of the results that is no list.
    """
    truth = truth_of(run, description)
    found: dict[str, Any] = {}
    limited = ((KINDS[each.kind].limit, each) for each in stated(run.results) if each.kind)
    acceptance = ((f"acceptance.{key}", getattr(each, "value", None)) for key, each in limited if key)
    for name, value in (*_stated(run.results, truth), *acceptance, *_numbers(plain(run.results))):
        whole = next((name.removesuffix(part) for part in PARTS if name.endswith(part)), name)
        if any(fnmatchcase(whole, pattern) for pattern in patterns):
            found.setdefault(name, value)
    return found


def _stated(results: Any, truth: Mapping[str, float]) -> Iterator[tuple[str, Any]]:
    """Yield the values that results state."""
    for each in values_of(results).values():
        yield each.name, each.value
        if each.u is None or each.u95 is None:
            continue
        yield f"{each.name}.u", each.u
        yield f"{each.name}.u95", each.u95
        if each.name in truth and each.value is not None:
            true = truth[each.name]
            yield f"{each.name}.truth", true
            if each.u > 0.0:
                yield f"{each.name}.z", (each.value - true) / each.u
            yield f"{each.name}.covered", abs(each.value - true) <= each.u95


def _numbers(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield the numbers of plain results by the names of their fields; the ``value`` of a quantity has its name."""
    if isinstance(value, bool | int | float):
        yield name, value
    elif isinstance(value, dict) and depth < _DEEPEST:
        for key, below in value.items():
            if (name, key) == ("", "uncertainty"):
                continue  # its values were there already
            here = f"{name}.{key}" if name else key
            yield from _numbers(below, name if key == "value" and name else here, depth + 1)
