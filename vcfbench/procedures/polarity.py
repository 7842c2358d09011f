"""Polarity: which way the output goes for a positive table rate and a positive V_Vc, and which wire is the wrong way.

After IEEE 1431, 12.7, the sign is never assumed. Each lead that is reversed, and each phase that is turned by half a
cycle, turns signs of its own. The least that explains all signs that are wrong is what is named, and beside it every
pair of faults that shows the same signs.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from itertools import combinations
from operator import xor
from types import MappingProxyType
from typing import Annotated, Literal

from msgspec import Meta, Struct, structs

from vcfbench import steps
from vcfbench.errors import MeasurementError
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, roles
from vcfbench.instructions.schedule import ABBA_SIGNS
from vcfbench.instructions.v_vc import both_signs, ready_v_vc_meter
from vcfbench.records.schema import Point
from vcfbench.reports.document import Report, Table, Text, heads
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import V_VC_RANGE_V, Limit, ProcedureSettings
from vcfbench.steps.drive_check import check_drive
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import LOOK_AT_SIGNALS, Routine
from vcfbench.values.value import Value

AT_REST, TURNED, DRIVEN = 1, 2, 3
"""The steps, as in its points: at rest, on the table, with V_Vc."""

_SURE = 5.0
"""Standard uncertainties, of the scatter of the readings, by which a response must differ from none."""
_LEAST = 0.2
"""Part of the response that is expected below which there is none."""
_ANY_V = 1e3
"""Tolerance of a meter on V_Vc here, without any demand: its sign is the question."""

What = Literal["table", "V_Vc", "bias", "meter on V_Vc", "carrier"]

CAUSES: Mapping[str, frozenset[What]] = MappingProxyType(
    {
        "the multimeter's leads on the output are reversed": frozenset({"table", "V_Vc", "bias"}),
        "the generator's leads to V_Vc are reversed": frozenset({"V_Vc", "meter on V_Vc"}),
        "the table's positive sense is the other one, or the gyroscope is mounted upside down": frozenset({"table"}),
        "the leads of the meter on V_Vc are reversed": frozenset({"meter on V_Vc"}),
        "the carrier is shifted by half a cycle": frozenset({"V_Vc", "carrier"}),
        "V_Vc drives the opposite combs": frozenset({"V_Vc"}),
        "the demodulator's reference is shifted by half a cycle": frozenset({"table", "V_Vc"}),
        "the sense pick-off is shifted by half a cycle": frozenset({"table", "V_Vc"}),
    }
)
"""Possible reversals, and the signs that each turns."""
DEMODULATED: frozenset[str] = frozenset(name for name, turned in CAUSES.items() if turned == {"table", "V_Vc"})
"""These turn the bias too where it is quadrature rather than the output stage's offset, which nobody knows here."""


class PolaritySettings(ProcedureSettings, frozen=True, kw_only=True):
    """Settings of the check, in addition to those of all procedures."""

    polarity_rate_deg_s: Annotated[
        float, Meta(gt=0.0, le=1000.0, description="rate of the table, taken with both signs")
    ] = 10.0
    polarity_v_vc_v: Annotated[float, Meta(gt=0.0, le=10.0, description="V_Vc, taken with both signs")] = 0.1

    @property
    def acceptance(self) -> tuple[Limit, ...]:
        """The limits of the bench file, and that no sign is wrong: that is the verdict."""
        return (*super().acceptance, Limit("wrong_signs", 0.0, 0.0))

    @property
    def has_table(self) -> bool:
        """True if the bench has a table."""
        return self.station.limits.max_rate_deg_s is not None

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from self.beyond_table("polarity_rate_deg_s", self.polarity_rate_deg_s)


class Sign(Struct, frozen=True):
    """One sign: its input, the response per unit of it, and True if it is as expected.

    `found` is 0 where there is no response. `u_response` is what the scatter of the readings leaves; whether a sign is
    sure is all that it is for. Of the carrier the response is its phase against the drive, read once.
    """

    what: What
    expected: Literal[-1, 1]
    found: Literal[-1, 0, 1]
    response: float
    u_response: float | None
    unit: str

    @property
    def right(self) -> bool:
        """True if the sign is the expected one."""
        return self.found == self.expected


class PolarityResult(Struct, frozen=True):
    """The signs, the number of wrong or missing ones, and their explanation.

    Each of `causes` alone does: the fewest faults. Each of `look_alikes`, two faults at once, shows the same signs;
    where no sign is wrong, these undo each other.
    """

    signs: tuple[Sign, ...]
    wrong_signs: int
    causes: tuple[str, ...]
    look_alikes: tuple[str, ...]
    expected_from: str

    def stated(self) -> Iterator[Value]:
        """Yield the number of wrong signs."""
        yield Value("wrong_signs", float(self.wrong_signs), kind="wrong_signs")


@routines.framed(routines.energised)
def polarity(settings: PolaritySettings) -> steps.Plan:
    """Turn both ways, then drive V_Vc both ways."""
    seen: steps.DriveReading | None
    if _carrier_has_a_sign(settings):  # one that is turned by half a cycle is a finding here, and no reason to end
        either_way = structs.replace(settings, drive=structs.replace(settings.drive, phase_deg=(-180.0, 180.0)))
        seen = yield from check_drive(either_way)
        if not _carrier_sign(settings, seen.phase_deg):
            yield from check_drive(settings)  # which ends the run, and says why
    else:
        seen = yield from routines.look_at_drive(settings)
    yield steps.Note("At rest, generator off")
    yield steps.Settle(settings.settle_s, "gyro settles")
    yield from routines.take(settings, AT_REST, rate_deg_s=0.0, v_vc_v=0.0)
    points: list[Point] = []
    if settings.has_table:
        points += yield from routines.under_servo(settings, _turned(settings))
        yield steps.Settle(settings.settle_s, "gyro settles")
    yield steps.Note(f"V_Vc, {settings.polarity_v_vc_v:g} V both ways")
    yield from ready_v_vc_meter(settings, V_VC_RANGE_V)
    yield from routines.v_vc_on()
    points += yield from both_signs(settings, DRIVEN, settings.polarity_v_vc_v, tolerance_v=_ANY_V)
    yield steps.DisableVvc()
    silent = [each.what for each in _responses(settings, points) if not each.found]
    if silent:
        raise MeasurementError(
            "; ".join(_silence(silent)),
            instrument="v_vc_meter" if silent == ["meter on V_Vc"] else "multimeter",
            step=str(points[-1].step),
            hint=LOOK_AT_SIGNALS,
        )
    yield from routines.look_again(settings, seen)


def _carrier_has_a_sign(settings: PolaritySettings) -> bool:
    """Return True if the carrier is seen, and expected in so narrow a window that half a cycle more is outside."""
    low_deg, high_deg = settings.drive.phase_deg
    return settings.station.oscilloscope is not None and high_deg - low_deg < 180.0


def _carrier_sign(settings: PolaritySettings, phase_deg: float) -> Literal[-1, 0, 1]:
    """Return True if the carrier's phase is as expected, half a cycle from it, or neither."""
    low_deg, high_deg = settings.drive.phase_deg
    within = [(phase_deg + turned_deg - low_deg) % 360.0 <= high_deg - low_deg for turned_deg in (0.0, 180.0)]
    return 1 if within[0] else -1 if within[1] else 0


def _turned(settings: PolaritySettings) -> Routine[list[Point]]:
    yield steps.Note(f"The table, {settings.polarity_rate_deg_s:g} deg/s both ways")
    rates_deg_s = [sign * settings.polarity_rate_deg_s for sign in ABBA_SIGNS]
    return (yield from routines.at_rates(settings, TURNED, rates_deg_s))


def results(settings: PolaritySettings, points: Measured) -> PolarityResult:
    """Return the signs, and the explanation of the wrong ones."""
    signs, bias_v = _responses(settings, points), settings.expected.bias_v
    if bias_v is not None and not bias_v[0] <= 0.0 <= bias_v[1]:  # the output at rest tells leads from phases
        [rest] = [point for point in points if point.step == AT_REST]
        at_rest = _sign_of(rest.output_v) if abs(rest.output_v) > _SURE * _u(rest) else 0
        signs.append(Sign("bias", _sign_of(bias_v[0]), at_rest, rest.output_v, _u(rest), "V"))
    if _carrier_has_a_sign(settings):
        *_, (_, drive) = points.found(steps.DriveReading)
        found = _carrier_sign(settings, drive.phase_deg)
        signs.append(Sign("carrier", 1, found, drive.phase_deg, None, "deg"))
    wrong = {each.what for each in signs if not each.right}
    silent = [each.what for each in signs if not each.found]
    causes, look_alikes = (_silence(silent), ()) if silent else _explained(wrong, {each.what for each in signs})
    expected = settings.expected
    windows = {"scale factor": expected.scale_factor_v_per_deg_s, "K_Vc": expected.k_vc_deg_s_per_v}
    sources = {
        "[expected] of the bench file": [name for name, window in windows.items() if window is not None],
        "the paper's gyroscope": [name for name, window in windows.items() if window is None],
    }
    expected_from = "; ".join(f"{source}: {', '.join(names)}" for source, names in sources.items() if names)
    return PolarityResult(tuple(signs), len(wrong), causes, look_alikes, expected_from)


def _responses(settings: PolaritySettings, points: Sequence[Point]) -> list[Sign]:
    """Return the signs of the responses to table and V_Vc."""
    gyro = settings.expected_gyro()
    driven = [point for point in points if point.step == DRIVEN]
    signs = [_sign("V_Vc", [(p.v_vc_v, p.output_v, _u(p)) for p in driven], gyro.scale_factor * gyro.k_vc, "V/V")]
    if settings.has_table:
        turned = [(p.rate_deg_s, p.output_v, _u(p)) for p in points if p.step == TURNED]
        signs.insert(0, _sign("table", turned, gyro.scale_factor, "V/(deg/s)"))
    measured = [(p, p.v_vc_measured_v) for p in driven if p.v_vc_measured_v is not None]
    if seen := [(p.v_vc_v, level_v, (p.v_vc_std_v or 0.0) / math.sqrt(p.n)) for p, level_v in measured]:
        signs.append(_sign("meter on V_Vc", seen, 1.0, "V/V"))
    return signs


def _u(point: Point) -> float:
    return point.std_v / math.sqrt(point.n)


def _sign(what: What, seen: Sequence[tuple[float, float, float]], expected: float, unit: str) -> Sign:
    """Return the sign of the slope through inputs, outputs and their uncertainties."""
    swing = math.fsum(abs(x) for x, _, _ in seen)
    response = math.fsum(math.copysign(1.0, x) * y for x, y, _ in seen) / swing
    u = math.sqrt(math.fsum(each**2 for _, _, each in seen)) / swing
    sure = abs(response) > _SURE * u and abs(response) > _LEAST * abs(expected)
    return Sign(what, 1 if expected > 0.0 else -1, _sign_of(response) if sure else 0, response, u, unit)


def _sign_of(value: float) -> Literal[-1, 1]:
    return 1 if value > 0.0 else -1


def _silence(silent: Sequence[What]) -> tuple[str, ...]:
    """Name the leads that may be loose where there is no response."""
    if "table" in silent and "V_Vc" in silent:
        return ("the output does not move: a lead of the multimeter is off, or the gyroscope does not run",)
    loose: dict[What, str] = {
        "table": "the output does not respond to the table: is the gyroscope on it, and its axis along the table's?",
        "V_Vc": "the output does not respond to V_Vc: a lead of the generator is off",
        "meter on V_Vc": "the meter on V_Vc shows no response: one of its leads is off",
        "bias": "the output at rest is nearly 0 V, not as expected",
        "carrier": "the carrier is neither as expected nor half a cycle from it",
    }
    return tuple(loose[each] for each in silent)


def _explained(wrong: set[What], seen: set[What]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the fewest causes that turn just the wrong signs, of those that were seen, each choice a line.

    Besides, those with two faults where one would do, or none. Two that turn the same sign leave it as it was.
    """

    def shows(chosen: Sequence[str]) -> bool:  # together just the signs that are wrong, each of them one that was seen
        turns = [CAUSES[each] & seen for each in chosen]
        alone = reduce(xor, turns)
        bias = frozenset({"bias"}) & seen if sum(each in DEMODULATED for each in chosen) % 2 else frozenset()
        return all(turns) and wrong in (alone, alone ^ bias)

    by_count: list[tuple[str, ...]] = [() if wrong else ("",)]  # no fault at all
    for count in range(1, len(CAUSES) + 1):
        choices = [chosen for chosen in combinations(CAUSES, count) if shows(chosen)]
        by_count.append(tuple(", and ".join(chosen) for chosen in choices))
        if count > 1 and any(by_count):
            break
    fewest = next((count for count, choices in enumerate(by_count) if choices), None)
    if fewest is None:
        return ("no known cause explains these signs",), ()
    return by_count[fewest] if fewest else (), by_count[2] if fewest < 2 else ()


def report(settings: PolaritySettings, _points: Sequence[Point], found: PolarityResult) -> Report:
    """Report each sign, and the explanation of the wrong ones."""
    words = {-1: "-", 0: "no response", 1: "+"}
    columns = heads("<sign of the output for | expected | found | response:.5g | u:.1g | <unit | <verdict")
    rows = [
        (
            *(_LONG[each.what], words[each.expected], words[each.found], each.response, each.u_response, each.unit),
            "right" if each.right else "WRONG" if each.found else "NO RESPONSE",
        )
        for each in found.signs
    ]
    basis = f"expected by {found.expected_from}"
    lines = [f"all signs are right ({basis})"]
    if found.wrong_signs:
        head = "cause" if len(found.causes) == 1 else "possible causes"
        lines = [f"{found.wrong_signs} of {len(found.signs)} signs are wrong ({basis}); {head}:"]
        lines += [f"  {each}" for each in found.causes]
    if found.look_alikes:
        two = (
            "two simultaneous faults that would look the same"
            if found.wrong_signs
            else "two faults that would cancel, undetected by this run"
        )
        lines += [f"{two}:", *(f"  {each}" for each in found.look_alikes)]
    if len(found.causes) > 1 and not settings.has_table:
        lines.append("a rate table, or turning the gyroscope by hand, narrows the causes")
    if len(found.causes) > 1 and settings.expected.bias_v is None:
        lines.append("set expected.bias_v in the bench file to distinguish reversed leads from shifted phases")
    return Report([Table(columns, rows), Text("\n".join(lines))])


_LONG: Mapping[What, str] = MappingProxyType(
    {
        "table": "a positive rate of the table",
        "V_Vc": "a positive V_Vc",
        "bias": "rest",
        "meter on V_Vc": "a positive V_Vc, of its own meter",
        "carrier": "carrier, by its phase against the drive",
    }
)


POLARITY = Procedure(
    name="polarity",
    method=(
        "The table turns a little either way, then V_Vc is set to either sign; the signs of what the output does tell "
        "whether table, V_Vc and output are connected the right way round."
    ),
    settings=PolaritySettings,
    plan=polarity,
    results=results,
    report=report,
    needs=roles("rate_source", "multimeter"),
    uses=roles("power", "oscilloscope", "v_vc_meter", "rate_table"),
)
