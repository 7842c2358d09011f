"""Faults that a run cannot have seen, with their sizes; computed for a report, a certificate or on request."""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.plausibility import doubts_of_record
from vcfbench.archive.output_unit import in_output_unit, unit_of_record
from vcfbench.archive.run import Run
from vcfbench.belief.in_turn import DEG, InTurn
from vcfbench.belief.jumps import GAIN, OFFSET, V_VC_GAIN, V_VC_OFFSET
from vcfbench.belief.unseen import (
    MATTERS,
    MATTERS_UNREFUSED,
    OFFSETS,
    UNIT,
    Course,
    Unseen,
    course_of,
    unseen,
    unseen_in_turn,
)
from vcfbench.devices.device import KnownDeviceSettings
from vcfbench.errors import BenchError
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.instructions.scale_factor import ROUGHLY, AtRestSettings, scale_factor_used, seen_from, tells_scale_factor
from vcfbench.instructions.v_vc import SHOWN_SHARE
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.characterize.plan import BeginPart
from vcfbench.procedures.layers import recorded_settings
from vcfbench.procedures.threshold import ThresholdSettings
from vcfbench.records.plain import plain
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Part, Table, Text, texts
from vcfbench.steps import ModulatedRecord, OutputSeen, SineResponse
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Step, StepResult
from vcfbench.values.printing import grouped
from vcfbench.values.value import Value

K_VC: Final = "of K_Vc"  # Unit of a fault: the share by which K_Vc is another
SCALE_FACTOR: Final = "of the scale factor"  # The same of the scale factor that turns volts into rates
V_VC_SET: Final = "of V_Vc as it was set"  # The same of what arrives
_WORDS: Final[dict[tuple[str, str], str]] = {
    ("step", OFFSET): "a step of the output",
    ("pulse", OFFSET): "a temporary shift of the output",
    ("ramp", OFFSET): "a ramp of the output to the end",
    ("change", GAIN): "a change of the multimeter's gain",
    ("pulse", GAIN): "a different gain of the multimeter for one record",
    ("creep", GAIN): "a creeping gain of the multimeter",
    ("step", V_VC_OFFSET): "a step of the reading of the meter on V_Vc",
    ("pulse", V_VC_OFFSET): "a temporary shift of the reading of the meter on V_Vc",
    ("ramp", V_VC_OFFSET): "a ramp of the reading of the meter on V_Vc to the end",
    ("change", V_VC_GAIN): "a change of the gain of the meter on V_Vc",
    ("change", K_VC): "a change of K_Vc that only a rate table shows",
    ("change", SCALE_FACTOR): "a scale factor that is not as it was told",
    ("change", V_VC_SET): "V_Vc that differs from its setting, as with a terminator of 50 ohm",
    ("pulse", V_VC_GAIN): "a different gain of the meter on V_Vc for one record",
    ("creep", V_VC_GAIN): "a creeping gain of the meter on V_Vc",
}
_IN_TURN: Final = {"change": "a change in some records of", "creep": "a creep, to the last record, of"}
_OF_STREAM: Final[dict[tuple[str, str], str]] = {  # No instrument reads the output
    ("change", GAIN): "a change of the gyroscope's own gain",
    ("pulse", GAIN): "a different gain of the gyroscope for one record",
    ("creep", GAIN): "a creeping gain of the gyroscope",
}
_OFF: Final = 0.1  # Share by which a told number may be off what is seen
_HALF: Final = 0.5  # Of a record: where its step is
_LATE: Final = 0.85  # Of a run: where a change of a gain begins that shows little
_SIZES: Final = (5e-2, 2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4)  # Of a fault in records, V or shares
_LADDER: Final = tuple((UNIT * np.geomspace(1e-3, 1e3, 31)).tolist())  # Of a fault within a record, V
_PLACES: Final = (0.15, 0.4, 0.65, 0.85)
_IN_RECORDS: Final = (
    *(("step", unit) for unit in (OFFSET, V_VC_OFFSET)),
    *((kind, unit) for unit in (GAIN, V_VC_GAIN) for kind in ("change", "pulse", "creep")),
)
_EXPLAINED: Final = (
    "Each size is the largest that the run's own checks would have missed with 95 % probability, and the effect is "
    "for the worst time. U95 contains none of them. Effects below a third of U95 are not listed; of faults that no "
    "check finds at any size, below a thirtieth."
)


class Refusable(Struct, frozen=True, eq=False):
    """A run that can be evaluated again with its windows moved: its statements, and its performed steps."""

    procedure: AnyProcedure
    settings: Any
    measured: Measured
    steps: tuple[tuple[Step, StepResult], ...]
    course: Course
    u95: Mapping[str, float]
    """Half widths of what is stated with 95 %, by name."""

    def values(self, output_v: Floats, v_vc_v: Floats) -> Mapping[str, float]:
        """Return the values with the points moved by volts, (n,), and V_Vc of the meter, V, (n,)."""
        return self.evaluated(self.settings, self.measured.moved(output_v.tolist(), v_vc_v.tolist()))

    def with_records(self, each: InTurn, sizes: Floats) -> Mapping[str, float]:
        """Return the values with a fault of so much in each visit, (n,)."""
        at = {visit.result: size for visit, size in zip(each.visits, sizes.tolist(), strict=True)}
        spoilt = self.measured.changed(lambda result: each.spoilt(result, at[result]) if at.get(result) else result)
        return self.evaluated(self.settings, spoilt)

    def evaluated(self, settings: Any, measured: Measured) -> Mapping[str, float]:
        """Return the values by other settings or data; a bound has 0."""
        found = values_of(in_output_unit(self.procedure.results(settings, measured), settings.station.output_unit))
        return {name: found[name].value or 0.0 for name in self.u95}


def refusable(run: Run) -> Refusable | None:
    """Return a function that evaluates `run` again, or None if that is impossible.

    A run without a record has lost its readings; one of several procedures (`characterize`) would be evaluated for
    minutes.
    """
    stated = {name: u95 for name, value in run.values.items() if (u95 := _half_width(value))}
    known = run.procedure in PROCEDURES and run.no_results is None
    if not known or not stated or run.directory is None or run.measured.parted(BeginPart):
        return None
    procedure = PROCEDURES[run.procedure]
    try:
        settings = recorded_settings(procedure, plain(run.header.get("settings")))
    except BenchError:  # of another version: the results are those that were stored
        return None
    measured = run.measured.corrected(settings.station.sources)
    steps = measured.found(StepResult) if run.points else ()
    return Refusable(procedure, settings, measured, steps, course_of(settings, steps, procedure.watched), stated)


def unseen_of(run: Run) -> tuple[Unseen, ...]:
    """Return the faults that `run` cannot have seen; none if its results cannot be computed again."""
    found = refusable(run)
    if found is None:
        return ()
    windows = len(found.course.windows)
    bent = frozenset(name for name in found.u95 if run.values[name].form != "plus-minus")
    between = unseen(found.course, found.u95, found.values, bent) if windows > 1 else ()
    within = _in_a_record(found) if windows == 1 else ()
    return (*between, *within, *_in_records(found), *_in_turn(found), *_of_knowledge(found))


def _in_turn(found: Refusable) -> Iterator[Unseen]:
    """Yield the effects of what changed between records of the oscilloscope."""
    if found.procedure.in_turn is None:
        return
    before = found.evaluated(found.settings, found.measured)
    for each in found.procedure.in_turn(found.settings, found.measured):
        yield from unseen_in_turn(each, found.u95, before, partial(found.with_records, each))


def _in_a_record(found: Refusable) -> Iterator[Unseen]:
    """Yield the effects of faults within the one record, below the size from which the record itself tells them."""
    volts = found.measured.readings.windows[0].voltage_v
    over = np.linspace(0.0, 1.0, volts.size)
    step = (over >= _HALF).astype(float)
    shapes = {"step": step, "pulse": step * (over < _HALF + 0.1), "ramp": over}
    before = found.evaluated(found.settings, found.measured)
    for kind, shape in shapes.items():
        size = None if kind == "ramp" else named_from(volts, shape)
        after = found.evaluated(found.settings, found.measured.moved_within((size or UNIT) * shape))
        if moved := _beyond(found, before, after, MATTERS_UNREFUSED if size is None else MATTERS):
            why = "it is the record's trend" if kind == "ramp" else "the readings beside it do not show it"
            yield Unseen(kind, size, OFFSET, moved, "" if size else why)


def named_from(volts: Floats, shape: Floats) -> float | None:
    """Return the size in V from which on a record says that it has a fault of this shape, wherever it begins.

    Of some places the last to be told counts, once more by half: noise may hide a part. None: at no size.
    """
    had, largest = len(doubts_of_record(volts)), 0
    for begin in (round(place * volts.size) for place in _PLACES):
        moved = np.roll(shape, begin) if shape[-1] == 0.0 else (np.arange(volts.size) >= begin).astype(float)

        def is_named(at: int, moved: Floats = moved) -> bool:
            return len(doubts_of_record(volts + _LADDER[at] * moved)) > had

        largest = max(largest, bisect_left(range(len(_LADDER)), x=True, key=is_named))
    return 1.5 * _LADDER[largest] if largest < len(_LADDER) else None


def _in_records(found: Refusable) -> Iterator[Unseen]:
    """Yield the effects of a step within each record of a sine, and of gains that change between them.

    They are those at the smallest of some sizes that the results refuse; where they refuse none, those of 1 mV, 0.1 %.
    """
    both = found.measured.found(ModulatedRecord)
    number = len(found.measured.found(SineResponse)) + len(both)
    if not number:
        return
    looked_at = {OFFSET, GAIN, *((V_VC_OFFSET, V_VC_GAIN) if any(each.v_vc_v for _, each in both) else ())}
    over, before = np.linspace(0.0, 1.0, number), found.evaluated(found.settings, found.measured)
    one, few = (np.abs(np.arange(number) - number // 3) <= wide for wide in (0, 1))
    least = (over >= _LATE, (over >= 1.0 / 3.0) & (over < 2.0 / 3.0), few)  # what shows least in a sweep
    courses: dict[str, list[Floats]] = {
        "step": [np.ones(number)],
        "change": [each.astype(float) for each in least],
        "pulse": [one.astype(float)],
        "creep": [over],
    }
    for kind, unit in (each for each in _IN_RECORDS if each[1] in looked_at):
        ends = list[tuple[float | None, Mapping[str, float]]]()
        for course in (sign * each for each in courses[kind] for sign in (1.0, -1.0)):
            refused = None
            for size in _SIZES:
                spoilt = found.measured.changed(in_records(unit, (size * course).tolist()))
                try:
                    after = found.evaluated(found.settings, spoilt)
                except BenchError:
                    refused = size
                    continue
                ends.append((refused, {name: (each - before[name]) / size for name, each in after.items()}))
                break
        sizes = [refused for refused, _ in ends]
        largest = None if None in sizes else max(filter(None, sizes), default=None)
        share = MATTERS_UNREFUSED if largest is None else MATTERS
        per = {name: max((abs(each[name]) for _, each in ends), default=0.0) for name in found.u95}
        most = {name: before[name] + (largest or UNIT) * each for name, each in per.items()}
        if moved := _beyond(found, before, most, share):
            yield Unseen(
                kind, largest, unit, moved, "records are not held against each other" if largest is None else ""
            )


def in_records(unit: str, sizes: Sequence[float]) -> Callable[[StepResult], StepResult]:
    """Return a function that puts a fault into records of sines in turn: a step in the middle, or another gain."""
    left = iter(sizes)

    def spoilt(result: StepResult) -> StepResult:
        if not isinstance(result, SineResponse | ModulatedRecord):
            return result
        field = "output_v" if isinstance(result, ModulatedRecord) else "voltages_v"
        field = "v_vc_v" if unit in {V_VC_OFFSET, V_VC_GAIN} else field
        size, volts = next(left), np.array(getattr(result, field, ()))
        later = np.arange(len(volts)) >= _HALF * len(volts)
        volts = volts + size * later if unit in OFFSETS else volts * (1.0 + size)
        return replace(result, **{field: tuple(volts.tolist())}) if len(volts) else result

    return spoilt


def _of_knowledge(found: Refusable) -> Iterator[Unseen]:
    """Yield what K_Vc and V_Vc do that are other than they are told, where nothing looks at them."""
    before, faults = found.evaluated(found.settings, found.measured), list[tuple[float | None, str, Any, Measured]]()
    if isinstance(found.settings, KnownDeviceSettings):
        known = found.settings.known
        curve = replace(known.k_vc, coefficients=tuple((1.0 + UNIT) * each for each in known.k_vc.coefficients))
        station = replace(found.settings.station, known=replace(known, k_vc=curve))
        size = _k_vc_seen_from(found.settings, found.measured)
        faults.append((size, K_VC, replace(found.settings, station=station), found.measured))
    faults += _otherwise(found.settings, found.measured)
    if any(each.v_vc_measured_v is None and each.v_vc_v for each in found.measured):
        wiring = found.settings.station.oscilloscope
        size = None if wiring is None or wiring.channel_of("v_vc") is None else SHOWN_SHARE
        faults.append((size, V_VC_SET, found.settings, found.measured.set_otherwise(UNIT)))
    for size, unit, settings, measured in faults:
        after, times = found.evaluated(settings, measured), 1.0 if size is None else size / UNIT
        most = {name: before[name] + times * (each - before[name]) for name, each in after.items()}
        if moved := _beyond(found, before, most):
            yield Unseen("change", size, unit, moved)


def _otherwise(settings: Any, measured: Measured) -> Iterator[tuple[float | None, str, Any, Measured]]:
    """Yield a told K_Vc or scale factor that is another by `UNIT`, with the share from which it is refused."""
    looks = [step for step, _ in measured.found(OutputSeen)]
    turned = any(getattr(step, "rate_deg_s", 0.0) for step in looks)
    if isinstance(settings, ThresholdSettings) and settings.k_vc_deg_s_per_v is not None:
        k_vc = (1.0 + UNIT) * settings.k_vc_deg_s_per_v
        yield _OFF if turned else ROUGHLY - 1.0, K_VC, replace(settings, k_vc_deg_s_per_v=k_vc), measured
    if isinstance(settings, AtRestSettings) and tells_scale_factor(settings):
        other = replace(settings, scale_factor_v_per_deg_s=(1.0 + UNIT) * scale_factor_used(settings).value)
        yield seen_from(settings, by_v_vc=not turned) if looks else None, SCALE_FACTOR, other, measured


def _k_vc_seen_from(settings: KnownDeviceSettings, measured: Measured) -> float | None:
    """Return the share from which another K_Vc of the device is refused; by a certificate alone its change is none."""
    known, turned = settings.known, any(getattr(step, "rate_deg_s", 0.0) for step, _ in measured.found(OutputSeen))
    if settings.expected.scale_factor_v_per_deg_s is not None:
        low, high = sorted(map(abs, settings.expected.scale_factor_v_per_deg_s))
        return (1.0 + _OFF) * high / low - 1.0
    if known.issued is not None:
        return None
    return _OFF if turned or known.reference is not None else ROUGHLY - 1.0


def _beyond(
    found: Refusable, before: Mapping[str, float], after: Mapping[str, float], share: float = MATTERS_UNREFUSED
) -> Mapping[str, float]:
    """Return the amount by which values moved, those that did so by more than this share of their U95."""
    moved = {name: abs(after[name] - before[name]) for name in found.u95}
    return {name: each for name, each in moved.items() if each > share * found.u95[name]}


def _half_width(value: Value) -> float | None:
    """Return the largest error of a value with 95 %; of a bound all of it."""
    match value.form:
        case "interval":
            low, high = value.ends
            return 0.5 * (high - low)
        case "below" | "size-below":
            return value.high
    return value.u95


def unseen_words(run: Run, found: Sequence[Unseen]) -> Iterator[tuple[str, str, str]]:
    """Yield for each fault its kind, the size up to which it is not refused, and its effect on each value."""
    volts = unit_of_record(run.header)
    offset, known = ((1e3, "mV"), _WORDS) if volts == "V" else ((1.0, volts), _WORDS | _OF_STREAM)
    for each in found:
        factor, unit = offset if each.unit in OFFSETS else (1.0, DEG) if each.unit == DEG else (1e2, "%")
        done = ", ".join(_effect(run.values[name], effect) for name, effect in each.effects.items())
        why = f": {each.why}" if each.why else ""
        size, of = (f"any size{why}", f"of {factor * UNIT:g} {unit}: ") if each.size is None else ("", "")
        what = known[each.kind, each.unit] if not each.what else f"{_IN_TURN[each.kind]} {each.what}"
        yield what, size or f"below {grouped(factor * (each.size or 0.0))} {unit}", of + done


def unseen_in_short(run: Run, found: Sequence[Unseen]) -> str:
    """Return the faults with the sizes up to which they are not refused, without their effects."""
    return "; ".join(dict.fromkeys(f"{what} ({size})" for what, size, _ in unseen_words(run, found)))


def _effect(value: Value, effect: float) -> str:
    of = value.named
    if value.value and (value.unit == "V/(deg/s)" or value.kind == "k_vc"):  # what people compare in ppm
        return f"{of.words} {grouped(1e6 * effect / abs(value.value))} ppm"
    return f"{of.words} {grouped(abs(of.factor) * effect)} {of.unit}".strip()


def unseen_parts(run: Run, found: Sequence[Unseen]) -> tuple[Part, ...]:
    """Return the table of the faults that the run cannot have seen, and its explanation."""
    if run.directory is None and run.values:
        return (Text("The faults that the run cannot detect are computed from its record, and it has none."),)
    if not found:
        return ()
    rows = list(unseen_words(run, found))
    return Table(texts("undetected fault", "size", "possible effect"), rows), Text(_EXPLAINED)
