"""Change of a value from one run to another: like is compared with like, else there is a reason.

Conditions that both runs tell and that differ are corrected where the device's coefficient is known. Lines over the
same rates are subtracted; over others it is their own points at the rates that both have, else, of one device, the
curve that its runs share. What instruments both have in common cancels. Where none of it gives a figure there is none.
"""

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from statistics import fmean
from typing import Final, NamedTuple

import numpy as np
from msgspec import Struct, structs

from vcfbench.analysis.shared_curve import Windows, slopes_over
from vcfbench.archive.run import Run
from vcfbench.devices.thermometer import rise_by_drive, thermometer
from vcfbench.errors import ConfigError
from vcfbench.instructions.schedule import SweepSettings
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import recorded_settings
from vcfbench.records.device_values import Measured
from vcfbench.records.devices import DeviceStore
from vcfbench.station.settings import ProcedureSettings, Sources
from vcfbench.uncertainty.of_range import windows_of
from vcfbench.values.definition import WITHIN, WITHIN_DEG_S, Conditions, Definition
from vcfbench.values.quantile import t_quantile
from vcfbench.values.sources import METER_GAIN, METER_OFFSET, TABLE_RATE, TEMPERATURE
from vcfbench.values.value import UncertaintyPart, Value

STATED_PPM: Final = 500.0
"""U95 of a change by other rates, or under other conditions, up to which it is stated."""
_LEAST_LEVELS: Final = 7
"""Rates from which a run, with both signs among them, tells the curve of others of its device."""
_LIKE_K: Final = 1.0
"""Difference of temperature that is none, of values whose coefficient nobody keeps."""
_CLASS_PPM_K: Final = 500.0
_ENDS: Final = 0.7
"""Part of the range of both runs that common rates must span."""
_SAME_CURVE: Final = 0.05
"""Chance of one curve below which it is told to have changed."""
_MOST_RATES: Final = 21
_COEFFICIENTS: Final = {"ppm_k": "table_slope_ppm_k", "ppm_v": "table_slope_ppm_v", "drive_ppm_k": "drive_ppm_k"}


class Difference(Struct, frozen=True):
    """Difference of one run's value from that of the first: `u` and `e_n` None where an uncertainty is not known.

    `e_n` is its size over its expanded uncertainty (95 %); above 1 they disagree. `value` is None where there is no
    figure, `reason` then says why and what would give one. `note` says how it was found where the two values are not
    subtracted as they stand. `cancelled` are the instruments of both, `missing` what `u` lacks.
    """

    value: float | None
    u: float | None = None
    u95: float | None = None
    e_n: float | None = None
    note: str = ""
    reason: str = ""
    explained: tuple[tuple[str, float], ...] = ()
    """What of the difference of both values, as they stand, other rates and conditions explain, each in their unit."""
    cancelled: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


class Coefficients(Struct, frozen=True):
    """Change of a device's scale factor with temperature, ppm/K, and with the size of both rails, ppm/V, if known.

    By `drive_ppm_k` the drive's frequency is the thermometer of both runs.
    """

    ppm_k: Measured | None = None
    ppm_v: Measured | None = None
    drive_ppm_k: Measured | None = None

    @classmethod
    def kept(cls, runs: Sequence[Run], devices: str | Path) -> "Coefficients":
        """Return the last coefficients in the entries of the runs' device; none for runs of several devices."""
        (serial, simulated), *others = {(run.metadata.dut, bool(run.simulated)) for run in runs}
        store = DeviceStore(Path(devices), simulated=simulated)
        if serial is None or others or not (store.root / serial).is_dir():
            return cls()
        found: dict[str, Measured] = {}
        for entry in store.standing(serial):
            known = getattr(entry.record, "characteristics", None)
            for key, of in _COEFFICIENTS.items():
                if (one := getattr(known, of, None)) is not None:
                    found[key] = one
        return cls(**found)


class Compared(Struct, frozen=True, dict=True, eq=False):
    """A run in a comparison, with its settings, which are read once."""

    run: Run

    @cached_property
    def settings(self) -> ProcedureSettings | None:
        """Its settings; None where they are those of no procedure that is known here."""
        procedure, written = PROCEDURES.get(self.run.procedure), self.run.header.get("settings")
        try:
            return None if procedure is None or not written else recorded_settings(procedure, written)
        except ConfigError:
            return None

    @cached_property
    def windows(self) -> Windows | None:
        """The windows of its line on the table, in rates by the line's own slope; None: it has none."""
        settings = self.settings
        if not isinstance(settings, SweepSettings):
            return None
        points = self.run.measured.corrected(settings.station.sources)
        return windows_of(settings, points, settings.table_step)

    @property
    def tells_curve(self) -> bool:
        """Return True if the run has enough rates of both signs to give the curve of the device."""
        seen = self.windows
        levels = set() if seen is None else set(np.round(seen.rate_deg_s, 2).tolist())
        return len(levels) >= _LEAST_LEVELS and min(levels) < 0.0 < max(levels)

    def owner(self, source: str) -> str | None:
        """Return the owner of a source of the budget: the instrument with its last calibration."""
        role = next((role for start, role in _ROLES.items() if source.startswith(start)), None)
        if role is None or self.settings is None:
            return None
        if (placed := self.settings.station.instruments.get(role)) is not None:
            return placed.owner
        found = next((each for each in self.run.equipment if each.role == role), None)
        if found is None:
            return None
        drawn = f", seed {self.run.seed}" if self.run.seed is not None else ""
        at = found.serial_number or found.inventory_number or f"at {found.resource} of {self.run.bench}{drawn}"
        return f"{found.model} {at}" + ("" if found.calibrated is None else f", calibrated {found.calibrated}")


_ROLES: Final = {
    "multimeter": "multimeter",
    METER_GAIN: "multimeter",
    METER_OFFSET: "multimeter",
    TABLE_RATE: "rate_table",
}
"""Roles of the instruments that sources of a budget are of, by the beginnings of their names."""


class Pair(Struct, frozen=True):
    """Two runs whose values are compared, the entries of their device, and more runs of it for its curve."""

    first: Compared
    other: Compared
    coefficients: Callable[[], Coefficients] = Coefficients
    """Asked where conditions differ."""
    witnesses: Sequence[Compared] = ()

    @property
    def one_device(self) -> bool:
        """Return True if both runs are told to be of the same gyroscope."""
        serial = self.first.run.metadata.dut
        return serial is not None and serial == self.other.run.metadata.dut

    def change(self, then: Value, now: Value) -> Difference:
        """Return the amount by which the value `now` of the other run differs from `then` of the first."""
        plain = (now.value or 0.0) - (then.value or 0.0)
        if then.unit == now.unit and not then.kind and then.u is None and now.u is None:
            return Difference(plain)
        definitions = then.definition, now.definition
        unlike = definitions[0].unlike(definitions[1])
        if (then.kind, then.form) != (now.kind, now.form):
            both = (then, now) if then.kind == now.kind else (then.named.words, now.named.words)
            unlike = f"{both[0]} and {both[1]}"
        elif then.unit == now.unit and not unlike and None in {then.value, now.value, then.u, now.u, then.u95, now.u95}:
            return Difference(plain)
        lines = then.kind == now.kind == "scale_factor" and definitions[0].choices == definitions[1].choices
        other_unit = f"in {then.named.unit}, now in {now.named.unit}" if then.unit != now.unit else ""
        if other_unit or (unlike and not (lines and then.value and now.value)):
            return Difference(None, reason=other_unit or f"of another measurand: {unlike}")
        moved = self._moved(then, now)
        if isinstance(moved, str):
            return Difference(None, reason=moved)
        own = _by_windows(then, now, self) if unlike else _as_they_stand(then, now)
        if isinstance(own, str):
            return Difference(None, reason=own + _bridge(*definitions))
        return self._stated(then, now, own, moved, _bridge(*definitions) if unlike else "")

    def _moved(self, then: Value, now: Value) -> "_Moved | str":
        """Return the effects of other conditions of the runs; or the reason for no figure."""
        before, after = then.conditions, now.conditions
        if before == after:
            return _Moved()
        try:
            known = self.coefficients()
        except ConfigError as error:
            return f"the conditions differ, and what is kept of the device cannot be read: {error.what}"
        slope = then.kind.startswith("scale_factor")
        settings = [each.settings for each in (self.first, self.other) if each.settings is not None]
        bands = [each.station.sources for each in settings]
        tolerance_v = max((each.rail_tolerance_v for each in settings), default=0.0)
        if not self.one_device:  # whose drives tell no temperature
            before, after = structs.replace(before, drive=None), structs.replace(after, drive=None)
        warmer = _by_temperature(before, after, known, bands, slope=slope)
        wider = _by_rails(before, after, known.ppm_v, tolerance_v, slope=slope)
        if isinstance(warmer, str) or isinstance(wider, str):
            return warmer if isinstance(warmer, str) else str(wider)
        said = "; ".join(each.said for each in (warmer, wider) if each.said)
        parts = warmer.parts + wider.parts
        missing = warmer.missing + wider.missing
        return _Moved(parts, math.hypot(warmer.u, wider.u), said, missing, warmer.replaced, warmer.unknown)

    def _stated(self, then: Value, now: Value, own: "_Own", moved: "_Moved", bridge: str) -> Difference:
        """Return the change without the effects of conditions and instruments; or no figure, and the reason."""
        size = abs(then.value or 0.0)
        common, cancelled = covariance(then, now, self.first, self.other)
        common += sum(part.u**2 for part in (*then.parts, *now.parts) if part.source in moved.replaced) / 2.0
        u = math.sqrt(max(own.u**2 + own.u_instruments**2 - 2.0 * common, 0.0) + (moved.u * size) ** 2)
        u95 = t_quantile(0.05, u**4 / own.freedom if own.freedom else math.inf) * u
        if (bridge or moved.unknown) and 1e6 * u95 > STATED_PPM * size:
            why = f"U95 would be {1e6 * u95 / size:.0f} ppm" if size else "the effect of the conditions is not known"
            return Difference(None, reason=f"{why}{': ' * bool(moved.said)}{moved.said}{bridge}")
        value = own.value - sum(part for _, part in moved.parts) * (then.value or 0.0)
        lacks = f"incomplete, without {', '.join(moved.missing)}" if moved.missing else ""
        note = "; ".join(each for each in (own.note, moved.said, lacks) if each)
        rates = [] if not bridge else [("other rates", (now.value or 0.0) - (then.value or 0.0) - own.value)]
        explained = (*rates, *((words, part * (then.value or 0.0)) for words, part in moved.parts))
        ratio = abs(value) / u95 if u95 else None
        return Difference(value, u, u95, ratio, note, "", explained, cancelled, moved.missing)


class _Own(NamedTuple):
    """A change in the unit of the value, its u by noise and by instruments, and the sum of u^4 over its freedom."""

    value: float
    u: float
    u_instruments: float
    freedom: float
    note: str = ""


class _Moved(NamedTuple):
    """Effects of other conditions, relative, each by its name, the u of all, and the condition that a run lacks.

    `replaced` are the sources of both budgets in whose place `u` stands; where a coefficient is `unknown`, `u` is by
    the limit of its class.
    """

    parts: tuple[tuple[str, float], ...] = ()
    u: float = 0.0
    said: str = ""
    missing: tuple[str, ...] = ()
    replaced: frozenset[str] = frozenset()
    unknown: bool = False


def _as_they_stand(then: Value, now: Value) -> _Own:
    both = [(each.u or 0.0, each.dof or math.inf) for each in (then, now)]
    u = math.hypot(*(u for u, _ in both))
    return _Own((now.value or 0.0) - (then.value or 0.0), u, 0.0, sum(u**4 / dof for u, dof in both))


def _by_temperature(
    before: Conditions, after: Conditions, known: Coefficients, bands: Sequence[Sources], *, slope: bool
) -> _Moved | str:
    then_c, now_c = before.temperature_c, after.temperature_c
    u_k, by_drive = 0.0, False
    then, now, per_k = before.drive, after.drive, thermometer(known.drive_ppm_k)
    if then and now and per_k and (known.drive_ppm_k or then_c is None or now_c is None):
        away_k, u_k = rise_by_drive((then.frequency_hz, then.u_hz), (now.frequency_hz, now.u_hz), per_k)
        by_drive = abs(away_k) > 2.0 * u_k  # within its U95 the temperature is the same
        away_k *= by_drive
        words = f"{away_k:+.1f} K (U95 {2.0 * u_k:.1f} K) by the drive's frequency"
    elif then_c is None or now_c is None:
        return _Moved() if then_c == now_c else _Moved(missing=("temperature of one of the runs",))
    else:
        away_k, words = now_c - then_c, f"{now_c:g} instead of {then_c:g} degC"
    if away_k and slope and known.ppm_k is not None:
        moved = _corrected(known.ppm_k, away_k, words, u_k)
        return moved._replace(replaced=frozenset({TEMPERATURE} if by_drive else ()))
    if abs(away_k) <= max(sum(each.temperature_k or 0.0 for each in bands), 0.0 if slope else _LIKE_K):
        return _Moved(said=words if by_drive and slope else "")
    nobody = f"{words}, and no temperature coefficient of the device is known (vcfbench run temperature)"
    stated = [each.scale_factor_ppm_k for each in bands if "scale_factor_ppm_k" not in each.assumed]
    limit = 1e-6 * (abs(away_k) + 2.0 * u_k) * max((each for each in stated if each is not None), default=_CLASS_PPM_K)
    return _Moved(u=limit / math.sqrt(3.0), said=nobody, unknown=True) if slope else nobody


def _by_rails(
    before: Conditions, after: Conditions, known: Measured | None, tolerance_v: float, *, slope: bool
) -> _Moved | str:
    then_v, now_v = before.rails_v, after.rails_v
    if then_v is None or now_v is None or then_v == now_v:
        return _Moved()
    single = not then_v[1] and not now_v[1]  # one supply
    wider_v = [now_v[0] - then_v[0], *([] if single else [then_v[1] - now_v[1]])]
    now, then = (" and ".join(f"{each:g}" for each in rails_v if each) for rails_v in (now_v, then_v))
    words = f"{'a rail' if single else 'rails'} of {now} V instead of {then} V"
    if slope and known is not None and max(wider_v) - min(wider_v) <= tolerance_v:
        return _corrected(known, fmean(wider_v), words)
    if max(map(abs, wider_v)) <= tolerance_v * (1.0 + 1e-9):
        return _Moved()
    return f"{words}, and what rails change of the device is not known (vcfbench run power)"


def _corrected(known: Measured, by: float, words: str, u_by: float = 0.0) -> _Moved:
    relative = 1e-6 * known.value * by
    u = 1e-6 * math.hypot(known.u * by, known.value * u_by)
    return _Moved(((words, relative),), u, f"corrected by {-1e6 * relative:+.0f} ppm for {words}")


def covariance(then: Value, now: Value, first: Compared, other: Compared) -> tuple[float, tuple[str, ...]]:
    """Return the covariance of both values by their common instruments, and these instruments."""
    found, owners = 0.0, []
    earlier = {_key(first, part): part.u for part in then.parts}
    for part in now.parts:
        key = _key(other, part)
        if key[0] is not None and key in earlier:
            found += earlier[key] * part.u
            owners.append(key[0])
    return found, tuple(dict.fromkeys(owners))


def _key(run: Compared, part: UncertaintyPart) -> tuple[str | None, str]:
    return part.of or run.owner(part.source), part.source.rpartition(": ")[2]


def _by_instruments(value: Value) -> float:
    """Return the variance of a value by all but noise."""
    return sum(part.u**2 for part in value.parts if not part.source.startswith(("readings", "flicker")))


def _by_windows(then: Value, now: Value, pair: Pair) -> _Own | str:
    """Return the change over rates of both runs; or the reason for none."""
    both_runs = pair.first, pair.other
    a, b = (each.windows for each in both_runs)
    if a is None or b is None or not then.value or not now.value:
        return "of another measurand: other rates"
    size = then.value
    low, high = max(a.rate_deg_s.min(), b.rate_deg_s.min()), min(a.rate_deg_s.max(), b.rate_deg_s.max())
    lines = now.value / then.value  # of slopes that are 1 each in their windows
    as_they_stand = f"as they stand the lines differ by {1e6 * (lines - 1.0):+.0f} ppm"
    instruments = math.sqrt(sum(_by_instruments(each) for each in (then, now)))

    def over(rates_deg_s: Sequence[float], relative: float, u: float, how: str) -> _Own:
        dof = min(part.dof or math.inf for of in (then, now) for part in of.parts if part.source.startswith("readings"))
        u *= abs(size)
        words = f"over {Definition.of(rates_deg_s).levels_words}, {how}; {as_they_stand}"
        return _Own((lines * relative - 1.0) * size, u, instruments, u**4 / dof, words)

    levels = [sorted({round(float(rate), 6) for rate in each.rate_deg_s}, reverse=True) for each in (a, b)]
    both = [rate for rate in levels[0] if np.isclose(rate, levels[1], WITHIN, WITHIN_DEG_S).any()]
    if len(both) > 1 and both[0] - both[-1] >= _ENDS * (high - low):
        (one, u_one), (two, u_two) = (each.at(both, WITHIN, WITHIN_DEG_S).slope for each in (a, b))
        if 1.96e6 * (u := math.hypot(u_one / one, u_two / two)) <= STATED_PPM:
            return over(both, two / one, u, "the rates of both")
    if not pair.one_device:
        return "of another measurand: other rates, and --dut does not say that it is one device"
    if high - low <= 0.0:
        return "the runs have no range of rates in common"
    narrower = min(levels, key=lambda each: each[0] - each[-1])
    within = [rate for rate in narrower if low <= rate <= high]
    if len(within) < 2 or within[0] - within[-1] < _ENDS * (high - low):
        within = np.linspace(high, low, 5).tolist()
    witness = next((each for each in pair.witnesses if each not in both_runs and each.tells_curve), None)
    found = slopes_over(within, [a, b, *([] if witness is None or witness.windows is None else [witness.windows])])
    ratio = float(found.values[1] / found.values[0])
    by = np.array([-ratio, 1.0]) / found.values[0]
    u = math.sqrt(float(by @ found.covariance[:2, :2] @ by))
    curve = "both runs" if witness is None else f"both runs and {witness.run.name}"
    changed = "; the curve itself has changed, this holds for these rates only"
    return over(within, ratio, u, f"by the curve of {curve}{changed * (found.same_curve < _SAME_CURVE)}")


def _bridge(first: Definition, other: Definition) -> str:
    """Say with which rates a run would compare with both."""
    rates = sorted({round(rate, 3) for each in (first, other) for rate, _ in each.levels_deg_s}, reverse=True)
    if len(rates) > _MOST_RATES:
        rates = np.linspace(rates[0], rates[-1], _MOST_RATES).tolist()
    return f"; a run at the rates of both would tell: --rates {','.join(f'{rate:g}' for rate in rates)}"
