"""What a run cannot have seen, with its size: worked out when a report, a certificate or a person asks for it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.archive.run import Run
from vcfbench.errors import BenchError
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.characterize.plan import BeginPart
from vcfbench.procedures.layers import recorded_settings
from vcfbench.procedures.procedure import AnyProcedure
from vcfbench.procedures.shared.steady.jumps import GAIN, OFFSET, V_VC_GAIN
from vcfbench.procedures.shared.steady.unseen import UNIT, Course, Unseen, course_of, unseen
from vcfbench.records.plain import plain
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Part, Table, Text, texts
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Step, StepResult
from vcfbench.values.printing import grouped
from vcfbench.values.value import Value

_WORDS: Final[Mapping[tuple[str, str], str]] = {
    ("step", OFFSET): "a step of the output",
    ("pulse", OFFSET): "a shift of the output for a while",
    ("ramp", OFFSET): "a ramp of the output to the end",
    ("change", GAIN): "a change of the multimeter's gain",
    ("creep", GAIN): "a creeping gain of the multimeter",
    ("change", V_VC_GAIN): "a change of the gain of the meter on V_Vc",
    ("creep", V_VC_GAIN): "a creeping gain of the meter on V_Vc",
}
_LEAST_WINDOWS: Final = 2
_RELATIVE: Final = frozenset({"V/(deg/s)", "(deg/s)/V"})  # Units of what people compare in ppm
_EXPLAINED: Final = (
    "Each is the largest that the run would not have refused with 95 %, by its own tests, noise and plan, wherever it "
    "moves a value; what it may do to a value is that at the worst time. None of it is in U95. Less than a third of "
    "U95 is not listed."
)


class Refusable(Struct, frozen=True, eq=False):
    """A run that can be evaluated again with its windows moved: what it stated, and what was performed."""

    procedure: AnyProcedure
    settings: Any
    measured: Measured
    steps: tuple[tuple[Step, StepResult], ...]
    course: Course
    u95: Mapping[str, float]
    """Half widths of what is stated with 95 %, by name."""

    def values(self, output_v: Floats, v_vc_v: Floats) -> Mapping[str, float]:
        """Return the values with the points moved, V, (n,), and V_Vc as measured beside them, V, (n,)."""
        moved = self.measured.moved(output_v.tolist(), v_vc_v.tolist())
        found = values_of(self.procedure.results(self.settings, moved))
        return {name: found[name].value or 0.0 for name in self.u95}  # a bound has 0, whatever moves


def refusable(run: Run) -> Refusable | None:
    """Return how `run` is evaluated again; None where nothing can be computed again, or it has no windows of its own.

    One of several procedures (`characterize`) would be evaluated for minutes.
    """
    stated = {name: u95 for name, value in run.values.items() if (u95 := _half_width(value))}
    known = run.procedure in PROCEDURES and run.no_results is None
    if not known or len(run.points) < _LEAST_WINDOWS or not stated or run.measured.parted(BeginPart):
        return None
    procedure = PROCEDURES[run.procedure]
    try:
        settings = recorded_settings(procedure, plain(run.header.get("settings")))
    except BenchError:  # of another version: the results are those that were stored
        return None
    measured = run.measured.corrected(settings.station.sources)
    steps = measured.found(StepResult)
    return Refusable(procedure, settings, measured, steps, course_of(settings, steps, procedure.watched), stated)


def unseen_of(run: Run) -> tuple[Unseen, ...]:
    """Return what `run` cannot have seen; nothing of one without windows, or whose results cannot be computed again."""
    found = refusable(run)
    return () if found is None else tuple(unseen(found.course, found.u95, found.values))


def _half_width(value: Value) -> float | None:
    if value.form == "interval" and value.low is not None and value.high is not None:
        return 0.5 * (value.high - value.low)
    return value.u95 if value.form == "plus-minus" else None


def unseen_words(run: Run, found: Sequence[Unseen]) -> Iterator[tuple[str, str, str]]:
    """Yield of each fault what it is, up to which size it is not refused, and what it may do to which value."""
    for each in found:
        factor, unit = (1e3, "mV") if each.unit == OFFSET else (1e2, "%")
        done = ", ".join(_effect(run.values[name], effect) for name, effect in each.effects.items())
        size, of = ("any size", f"of {factor * UNIT:g} {unit}: ") if each.size is None else ("", "")
        yield _WORDS[each.kind, each.unit], size or f"below {grouped(factor * (each.size or 0.0))} {unit}", of + done


def _effect(value: Value, effect: float) -> str:
    of = value.named
    if value.value and value.unit in _RELATIVE:
        return f"{of.words} {grouped(1e6 * effect / abs(value.value))} ppm"
    return f"{of.words} {grouped(abs(of.factor) * effect)} {of.unit}".strip()


def unseen_parts(run: Run, found: Sequence[Unseen]) -> tuple[Part, ...]:
    """Return the table of what the run cannot have seen, and what it means."""
    rows = list(unseen_words(run, found))
    return Table(texts("not refused", "size", "may have moved, by as much as"), rows), Text(_EXPLAINED)
