"""Electrical check before power: the resistance of each line by the multimeter, against limits.

IEEE 1431, 12.2, as far as a multimeter goes: no insulation at high voltage. Nothing is switched on; a line that is
outside its limits ends the run, and what comes after it gets no power. Supply currents are those of `power`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean, stdev
from typing import Annotated, Literal

from msgspec import Meta, Struct

from vcfbench import steps
from vcfbench.errors import MeasurementError
from vcfbench.instructions.procedure import Procedure, roles
from vcfbench.interfaces import ReadsResistance
from vcfbench.records.schema import Point
from vcfbench.reports.document import Report, Table, Text, heads
from vcfbench.specifications import HP_34401A, VoltmeterSpecification
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import MeterKnown, ProcedureSettings
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import answer
from vcfbench.uncertainty.measurand import made_of, measurand, printed, titled
from vcfbench.values.value import Measurand, UncertaintyPart, Value

_Ohm = Annotated[float, Meta(ge=0.0, le=1e8)]
_Window = tuple[_Ohm, _Ohm] | None
_LINES: Mapping[str, tuple[str, str]] = {
    "positive_rail_ohm": ("rail_positive", "the positive rail, the supply's lead off it"),
    "negative_rail_ohm": ("rail_negative", "the negative rail, the supply's lead off it"),
    "v_vc_ohm": ("v_vc", "the V_Vc input, the generator's lead off it"),
    "output_ohm": ("output", "the output"),
}
"""Lines by their setting: node of the PCB, words for who puts the leads there; the rails first."""
_SHORT_OHM, _OPEN_OHM = 10.0, 1e6
"""Below and beyond, what is out of its limits is called shorted, or open."""
_RANGES_OHM = tuple(HP_34401A.ohms)
"""Ranges that all meters have."""
_OVER_RANGE = 1.2
_YEAR_DAYS = 365.0


class ElectricalSettings(ProcedureSettings, frozen=True, kw_only=True):
    """Settings of the electrical check; each line has the least and the largest resistance, null leaves it out."""

    positive_rail_ohm: Annotated[_Window, said("limits of the positive rail without power")] = (100.0, 10_000.0)
    negative_rail_ohm: Annotated[_Window, said("limits of the negative rail without power")] = (100.0, 10_000.0)
    v_vc_ohm: Annotated[_Window, said("limits of the V_Vc input")] = (0.8e6, 1.2e6)
    output_ohm: Annotated[_Window, said("limits of the output without power")] = (50.0, 200.0)
    wires: Annotated[Literal[2, 4], said("two wires, with the leads included, or four", option=True)] = 2
    lead_ohm: Annotated[float, ranged(0.0, 10.0, "largest resistance of two leads and the meter's input")] = 0.2
    ohm_readings: Annotated[int, ranged(2, 100, "readings per line")] = 5

    @property
    def windows(self) -> Mapping[str, tuple[float, float]]:
        """Limits of the lines that are measured, by setting."""
        lacking = {"negative_rail_ohm"} if self.station.rails.single else set()
        return {key: window for key in _LINES if (window := getattr(self, key)) is not None and key not in lacking}

    @property
    def leads_ohm(self) -> float:
        """Resistance that leads may have."""
        return self.lead_ohm if self.wires == 2 else 0.0

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        for key, (low, high) in self.windows.items():
            if not low < high:
                yield InvalidValue(key, "least and largest resistance, in this order", [low, high])
        if not self.windows:
            yield InvalidValue("output_ohm", "limits of at least one line", None)


class LineResistance(Struct, frozen=True):
    """Resistance of one line with its limits, ohm; `of` is the node of the PCB."""

    of: str
    resistance: Measurand
    low_ohm: float
    high_ohm: float


class ElectricalResult(Struct, frozen=True):
    """Result of the electrical check: all lines are within their limits."""

    lines: tuple[LineResistance, ...]
    wires: int

    def stated(self) -> Iterator[Value]:
        """Yield its values."""
        for each in self.lines:
            yield titled(f"resistance, {each.of}", each.resistance)


def electrical(settings: ElectricalSettings) -> steps.Plan:
    """Ask for the leads on each line in turn, all outputs off; refuse if a line is out of its limits."""
    placed = settings.station.instruments
    if "rate_source" in placed:
        yield steps.DisableVvc()
    if "power" in placed:
        yield steps.DisableSupply()
    else:
        yield steps.AskOperator("switch the device off, its own supply too: resistance is measured without power")
    seen: dict[str, float] = {}
    for key, (low, high) in settings.windows.items():
        node, words = _LINES[key]
        asked = f"move the leads of the multimeter to {words}"
        yield steps.AskOperator(asked, adjustments=(("multimeter.input.node", node),))
        for range_ohm in (next(each for each in _RANGES_OHM if each >= high), _RANGES_OHM[-1]):
            how = float(settings.nplc), settings.ohm_readings, settings.wires, 0.5 * (low + high)
            measured = yield steps.MeasureResistance(node, range_ohm, *how)
            seen[key] = answer(measured, steps.ResistanceSeen).mean_ohm
            if math.isfinite(seen[key]):
                break  # else another line may be there, of which the limits know nothing
    yield steps.move_leads("multimeter", "output")
    if wrong := list(findings(settings, seen)):
        raise MeasurementError(
            "; ".join(wrong),
            instrument="multimeter",
            step="resistance of the lines",
            hint="all outputs stayed off; check the connector and the leads before you switch on",
        )


def findings(settings: ElectricalSettings, seen_ohm: Mapping[str, float]) -> Iterator[str]:
    """Yield the faults of the lines in words; two lines with each other's resistance are swapped."""
    windows = settings.windows

    def fits(ohm: float, key: str) -> bool:
        low, high = windows[key]
        return low <= ohm <= high + settings.leads_ohm

    out = [key for key in windows if not fits(seen_ohm[key], key)]
    if len(out) > 1 and all(map(math.isinf, seen_ohm.values())):
        yield "all lines are open: check the multimeter's leads on its ohm terminals, with four wires also on sense"
        return
    swapped = {one: other for one in out for other in out if fits(seen_ohm[one], other) and fits(seen_ohm[other], one)}
    for key in out:
        low, high = windows[key]
        ohm, name = seen_ohm[key], _LINES[key][0].replace("_", " ")
        limits = f"limits {low:g} to {high:g} ohm ({key})"
        if key in swapped:
            other = _LINES[swapped[key]][0].replace("_", " ")
            yield f"{name} has {ohm:.4g} ohm, {limits}: swapped with {other}"
        else:
            much = "open" if ohm > max(_OPEN_OHM, high) else "too much"
            what = much if ohm > high else "shorted" if ohm < min(_SHORT_OHM, low) else "too little"
            size = f"more than {_OVER_RANGE * _RANGES_OHM[-1]:.4g}" if math.isinf(ohm) else f"{ohm:.4g}"
            yield f"{name} has {size} ohm, {limits}: {what}"


def results(settings: ElectricalSettings, measured: Measured) -> ElectricalResult:
    """Return the resistances; the mean resistance of the leads is subtracted."""
    lines, found = [], measured.found(steps.ResistanceSeen)
    for (low, high), (step, seen) in zip(settings.windows.values(), found, strict=True):
        assert isinstance(step, steps.MeasureResistance)  # noqa: S101  # no other has such results
        lines.append(LineResistance(step.line, _resistance(settings, step.range_ohm, seen.readings_ohm), low, high))
    return ElectricalResult(tuple(lines), settings.wires)


def _resistance(settings: ElectricalSettings, range_ohm: float, readings_ohm: Sequence[float]) -> Measurand:
    """Return it with the data sheet's limits of a year; older, they grow on with time, as those of voltages."""
    placed, own = settings.station.instruments.get("multimeter"), settings.station.sheet_of("multimeter")
    known = own is not None and range_ohm in own.ohms
    sheet: VoltmeterSpecification = own if known else HP_34401A  # the worst of these meters
    ohm, limit = fmean(readings_ohm), sheet.ohms[range_ohm]
    older = max(1.0, settings.station.sources.meter_age_days / _YEAR_DAYS)
    rectangular = settings.station.meters.get("multimeter", MeterKnown()).rectangular
    sigmas = sheet.limit_sigmas if known and not rectangular else None
    of = None if placed is None else placed.owner
    scatter = stdev(readings_ohm) / math.sqrt(len(readings_ohm))
    digit, half = sheet.resolution[float(settings.nplc)] * range_ohm, 0.5 * settings.leads_ohm
    by_limits = {"of reading": limit.reading * abs(ohm), "of range": limit.range * range_ohm}
    parts = [
        *(
            UncertaintyPart(
                f"meter, {name}", older * each / (sigmas or math.sqrt(3.0)), None, of, rectangular=sigmas is None
            )
            for name, each in by_limits.items()
        ),
        UncertaintyPart("leads", half / math.sqrt(3.0), rectangular=True),
        UncertaintyPart("readings", scatter, len(readings_ohm) - 1),
        UncertaintyPart("last digit", digit / math.sqrt(12.0)),
    ]
    return measurand(ohm - half, "ohm", parts)


def report(settings: ElectricalSettings, _points: Sequence[Point], found: ElectricalResult) -> Report:
    """Report each line with its limits."""
    columns = heads("<line | resistance [ohm] | u:.2g | U95:.2g | from:.4g | to:.4g | <contributions to u")
    rows = [
        (each.of.replace("_", " "), *printed(each.resistance), each.low_ohm, each.high_ohm, made_of(each.resistance))
        for each in found.lines
    ]
    leads = f"by {found.wires} wires, of which 0 to {settings.leads_ohm:g} ohm are leads"
    return Report([Table(columns, rows), Text(f"all lines are within their limits, nothing was switched on; {leads}")])


ELECTRICAL = Procedure(
    name="electrical",
    method=(
        "All outputs off, the multimeter's leads are put on each line in turn, and its resistance is held against "
        "limits; a line outside them ends the run before anything gets power."
    ),
    settings=ElectricalSettings,
    plan=electrical,
    results=results,
    report=report,
    needs=roles(multimeter=ReadsResistance),
    uses=roles("power", "rate_source"),
)
