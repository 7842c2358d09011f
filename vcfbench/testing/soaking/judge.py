"""Rules that must hold for a start, and for all starts of a seed: each yields its violations."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from vcfbench.errors import BenchError, ConfigError, MeasurementError, NotSafe
from vcfbench.records.journal import JournalRecord
from vcfbench.records.schema import Status
from vcfbench.records.stated import values_of
from vcfbench.testing.soaking.draw import Draw
from vcfbench.testing.soaking.trial import Clean, Ended
from vcfbench.values.quantile import t_quantile

_RATE_DEG_S, _V_VC_V, _RAIL_V = 0.05, 0.01, 0.5
"""Beyond these something turns or is on."""
_COASTING_DEG_S = 1.0
"""Above this rate a servo is not opened but by an interlock: the table would coast."""
_DROPPING = frozenset({"interlock", "door", "emergency_stop", "drive_fault", "jam"})
_LONGEST_S = 600.0
"""Bench time by which faults may lengthen a run that takes twice as long as the clean one."""
_ONE_IN = 1.6e-5
"""Part of all values that noise alone takes that far to one side: two in 60 000, where 1 U95 of both is one in 200."""
_SHIFTED = frozenset({"bias", "bias_deg_s", "output_v"})
"""Results that an offset of the meter shifts."""
VALUE_FAULTS = frozenset({"offset", "overload", "current_limit", "power_cycle", "jam", "drive_fault"})
"""Faults that change readings: a resumed run may refuse those recorded under them."""


def reaches_of(results: Any) -> dict[str, tuple[float, float]]:
    """Return every value that results state with an uncertainty: value, and how far noise alone may take it."""
    return {
        name: (each.value, _reach(each.u95, each.dof))
        for name, each in values_of(results).items()
        if each.value is not None and each.u95 is not None
    }


def _reach(u95: float, dof: float | None) -> float:
    """Return half of the noise that two runs may differ by: Student's t has longer tails the fewer the readings."""
    dof = math.inf if dof is None else dof
    return u95 * t_quantile(2.0 * _ONE_IN, dof) / t_quantile(0.05, dof) / math.sqrt(2.0)


def wrong_of(ended: Ended, clean: Clean, *, spoilt: bool = False) -> Iterator[str]:
    """Yield the faults of one start; `spoilt`: the readings before it may be refused."""
    yield from ended.wrong
    if ended.died:
        return
    error = ended.error
    if error is not None and not isinstance(error, BenchError):
        yield f"raised {type(error).__name__}: {error}"
        return
    faults = [each.fault for each in ended.faults if each.fault is not None and each.fault.at_s <= ended.end_s]
    said = {each.instrument for each in getattr(ended.error, "reports", ()) if not each.safe}
    if ended.opened_deg_s > _COASTING_DEG_S and not {each.kind for each in faults} & _DROPPING:
        yield f"its servo was opened at {ended.opened_deg_s:.3g} deg/s"
    if abs(ended.rate_deg_s) > _RATE_DEG_S and "rate_table" not in said:
        yield f"left turning at {ended.rate_deg_s:.3g} deg/s without a report"
    if abs(ended.v_vc_v) > _V_VC_V and "rate_source" not in said:
        yield f"V_Vc left at {ended.v_vc_v:.3g} V without a report"
    if max(map(abs, ended.rails_v)) > _RAIL_V and "power" not in said:
        yield f"rails left at {ended.rails_v[0]:.3g} V and {ended.rails_v[1]:.3g} V without a report"
    # one that is said not to be safe has a fault that goes on, or was broken off by a third signal
    ill = {each.instrument for each in faults if each.kind not in {"error", "identity"}}
    for each in error.reports if isinstance(error, NotSafe) and ended.signals < 3 else ():
        if not each.safe and each.instrument not in ill:
            yield f"NOT SAFE without a cause: {each.instrument}: {each.detail}"
    yield from _code(ended, spoilt=spoilt)
    if ended.end_s > 2.0 * clean.duration_s + _LONGEST_S:
        yield f"it took {ended.end_s:.0f} s of bench time, without faults {clean.duration_s:.0f} s"


def _code(ended: Ended, *, spoilt: bool) -> Iterator[str]:
    error = ended.error
    caused = ended.faults or ended.signals or ended.disk_troubles or (spoilt and isinstance(error, MeasurementError))
    if isinstance(error, ConfigError) and ended.began and not ended.disk_troubles:
        yield f"exit code 2 from an open bench: {error}"
    if error is None and ended.run is not None and ended.run.status != Status.COMPLETE:
        yield f"exit code 0 of a run that is {ended.run.status.value}"
    if error is not None and not caused:
        yield f"refused without a cause: {type(error).__name__}: {error}"
    if isinstance(error, BenchError) and "mistake" in str(error):
        yield f"a mistake: {error}"


def wrong_record(ended: Ended, record: JournalRecord | None, draw: Draw) -> Iterator[str]:
    """Yield the faults of the record that a start left on the disk; None: no record."""
    lost = ended.died == "power cut" and not draw.synchronised
    if record is None:
        if ended.points and not lost:
            yield f"{len(ended.points)} points were shown, and there is no record"
        return
    if record.damage is not None and not lost:
        yield f"the record is damaged: {record.damage}"
        return
    kept = [each.as_json() for each in record.points]
    if not lost and kept[: len(ended.points)] != ended.points:
        yield f"of {len(ended.points)} points that were shown the record has {len(kept)}, not the same"
    if not ended.died and not ended.disk_troubles:
        if record.footer is None:
            yield "the record has no last line"
        elif (record.footer["error"] or {}).get("what") != (None if ended.error is None else str(ended.error)):
            yield f"the record's last line says {record.footer['error']}, the run {ended.error}"


def shifted_throughout(ended: Ended) -> bool:
    """Return True if the meter had an offset in all windows of a start: nothing in them contradicts the bias."""
    begun_s, over_s = ended.measured_s or (0.0, 0.0)
    offsets = [each.fault for each in ended.faults if each.fault is not None and each.fault.kind == "offset"]
    return any(each.at_s <= begun_s and each.at_s + (each.duration_s or math.inf) >= over_s for each in offsets)


def wrong_values(ended: Ended, clean: Mapping[str, tuple[float, float]], *, shifted: bool = False) -> Iterator[str]:
    """Yield the results of a complete run that are further from the clean run than the noise of both can bring them.

    `shifted`: its windows are those of a meter with an offset.
    """
    if ended.run is None or ended.error is not None or ended.died:
        return
    stated = reaches_of(ended.run.results)
    # of a line that is straight, or of noise that is not seen, there is a bound alone
    if missing := clean.keys() - values_of(ended.run.results).keys():
        yield f"complete without {', '.join(sorted(missing))}"
    for name in clean.keys() & stated.keys():
        value, reach = stated[name]
        if shifted and name.rpartition(".")[2] in _SHIFTED:
            continue
        if abs(value - clean[name][0]) > reach + clean[name][1]:
            yield f"{name} is {value:.9g}, without a fault {clean[name][0]:.9g}, by noise {reach:.2g} of each at most"
