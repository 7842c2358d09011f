"""First page of a report: who, what and when, the results with their uncertainties, and what stands behind them.

What ISO/IEC 17025, 7.8.2 and 7.8.4 ask for and nobody told is a blank line, to be filled in by hand.
"""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any, Final

import msgspec

from vcfbench.archive.certificate import stated_words
from vcfbench.archive.quantities import ResultValue, values_of
from vcfbench.archive.run import Run
from vcfbench.files import read_file
from vcfbench.records.amendments import check_of, lines_after
from vcfbench.records.plain import plain
from vcfbench.records.schema import Status
from vcfbench.reports.document import Column, Figure, Heading, Notice, Part, Table, Text, Value, facts
from vcfbench.station.acceptance import Verdict
from vcfbench.values.kinds import named
from vcfbench.values.printing import grouped, incomplete, shorthand

BLANK: Final = "_" * 24  # Stands for what was not told
_MEASURING: Final = ("multimeter", "v_vc_meter", "rate_table")  # Results are traced by them: blanks if nothing is told
_MOST: Final = 12  # So many results stand on the first page; the others follow
LIMITED: Final = {
    "scale_factor_v_per_deg_s": "scale_factor",
    "bias_v": "bias",
    "nonlinearity_ppm": "nonlinearity",
    "k_vc_deg_s_per_v": "k_vc",
}
"""Results by the keys of ``[acceptance]`` that are not their names."""
_RULES: Final = {
    "none": "simple acceptance: a value within its limits passes, its uncertainty set aside (ILAC-G8, w = 0)",
    "U95": "guarded acceptance: a value nearer to a limit than its U95 is marginal (ILAC-G8, w = U95)",
}
_BOUND: Final = re.compile(r"(\S+): .*; it is below (\S+) (\S+) \(95 %\)")
"""Of a value that is not stated, since errors alone may make it."""
_KEY: Final = re.compile(r" \([a-z]+(?:_[a-z]+)+\)")  # Name of a setting, for programs


def front_page(run: Run, title: str, given: Mapping[str, str] | None, figure: Figure | None) -> Iterator[Part]:
    """Yield the parts of the first page of `run`; `given` are words of a certificate, `figure` the one that it shows.

    Raises:
        ConfigError: the record cannot be read any more, or a word is none of a certificate.
    """
    words = stated_words(run, given)
    yield Heading(title)
    # what nobody must overlook: a simulation, a run that is not whole, the verdict
    if run.simulated:
        seed = "" if run.seed is None else f" (seed {run.seed})"
        yield Notice(f"SIMULATED: instruments and gyroscope were simulated{seed}. Nothing here was measured.")
    if run.status is not Status.COMPLETE:
        why = "" if run.error is None else f": {run.error}"
        yield Notice(f"This run is not complete, its record is {run.status.value}{why}", "fail")
    for each in run.equipment:
        if each.overdue:
            yield Notice(f"OVERDUE: the calibration of {each.role} ({each.model}) was due {each.calibration_due}.")
    if run.verdict is not None:
        yield Notice(f"Verdict: {run.verdict.said}", run.verdict.word)
    yield facts(_persons_and_dates(run, words))
    yield from _results(run)
    if figure is not None:
        yield figure
    issued, seal = words.get("issued") or BLANK, seal_of(run) or "none"
    yield facts([("issued on", issued), ("signature", BLANK), ("seal of the record", seal)])
    yield Text(
        "These results are those of the device named above, at the time and under the conditions stated. Without a "
        "signature this is no certificate. It is copied whole, or with the laboratory's leave."
    )


def _persons_and_dates(run: Run, words: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return persons, device and dates."""

    def said(*keys: str) -> str:
        return ", ".join(filter(None, map(words.get, keys))) or BLANK

    revision = "" if not run.amendments else f", revision {run.revision}, amended since the run (see Record)"
    traced = [
        f"{each.model} ({each.role.replace('_', ' ')}) {each.certificate or BLANK}"
        f"{f', {each.calibrated}' if each.calibrated else ''}"
        for each in run.equipment
        if each.role in _MEASURING or each.certificate or each.calibrated
    ]
    return [
        ("laboratory", said("laboratory", "laboratory_address", "laboratory_code")),
        ("customer", said("customer", "customer_address")),
        ("device", said("item", "item_manufacturer") if "item" in words else "MEMS gyroscope"),
        ("model", said("item_model")),
        ("serial number", said("serial")),
        ("record", f"{run.name or 'not recorded'}{revision}"),
        ("procedure", run.procedure),
        ("measured on", " to ".join(dict.fromkeys(days_of(run) or (BLANK,)))),
        ("operator", run.metadata.operator or BLANK),
        ("checked by", checked(run) or BLANK),
        ("traceable by", "; ".join(traced) or BLANK),
    ]


def days_of(run: Run) -> tuple[str, str] | None:
    """Return the days on which a run began and ended; simulated bench time passed on no calendar."""
    if (utc := run.header.get("utc")) is None:
        return None
    began = datetime.fromisoformat(str(utc))
    took_s = 0.0 if run.simulated else run.bench_seconds or 0.0
    return f"{began:%Y-%m-%d}", f"{began + timedelta(seconds=took_s):%Y-%m-%d}"


def checked(run: Run) -> str | None:
    """Name the person that checked the run; later amendments are unchecked."""
    check = check_of(run.amendments)
    if check is None:
        return None
    since = "" if check.revision == run.revision else f"; revision {run.revision} is not checked"
    return f"{check.by}, {check.utc[:10]}, revision {check.revision}{since}"


def _results(run: Run) -> Iterator[Part]:
    """Yield the box of the results, and what is to be known of their uncertainties."""
    known = {each.name: each for each in values_of(run).values() if each.u is not None}
    limits = {} if run.verdict is None else {LIMITED.get(each.key, each.key): each for each in run.verdict.limits}
    # a bias stands there once, as a rate, unless the other is limited
    again = {name for name in known if f"{name}_deg_s" in known} | {"bias_difference_v"}
    shown = [each for name, each in known.items() if name not in again or name.rpartition(".")[2] in limits]
    rows: list[tuple[Value, ...]] = []
    for each in shown[:_MOST]:
        of, u, u95, k = named(each.name, each.unit), each.u or 0.0, each.u95 or 0.0, each.coverage_factor
        value = f"{shorthand(of.factor * each.value, abs(of.factor) * u)} {of.unit}".strip()
        of_u = (f"{grouped(of.factor * u95)} {of.unit}".strip(), None if k is None else f"{k:.2f}")
        window = _window(limits.pop(each.name.removeprefix("turntable."), None), of.factor)
        rows.append((f"{of.words}{incomplete(each.missing)}", value, *of_u, *window))
    left_out = _left_out(run)
    for bound in filter(None, map(_BOUND.fullmatch, left_out)):
        of = named(bound[1], bound[3])
        value = f"below {grouped(of.factor * float(bound[2]))} {of.unit}".strip()
        window = _window(limits.pop(bound[1].removeprefix("turntable."), None), of.factor)
        rows.append((of.words, value, "not stated", "", *window))
    for limit in limits.values():  # of values without an uncertainty
        of = named(limit.key)
        value = "-" if limit.value is None else f"{shorthand(limit.value, None)} {of.unit}".strip()
        rows.append((of.words, value, "not known", "", *_window(limit, 1.0)))
    if not rows:
        return
    names = ("quantity", "value", "U95", "k", "limits", "verdict")
    judged = len(names) if run.verdict is not None else 4
    columns = [Column(each, align="left" if place in {0, 5} else "right") for place, each in enumerate(names[:judged])]
    yield Table(columns, [row[:judged] for row in rows], "Results")
    yield Text("\n".join(_said_of_results(run, shown)))


def _window(limit: Verdict | None, factor: float) -> tuple[str, str]:
    if limit is None:
        return "", ""
    return f"{factor * limit.low:g} to {factor * limit.high:g}", limit.said


def _said_of_results(run: Run, shown: Sequence[ResultValue]) -> Iterator[str]:
    if shown:
        yield (
            "In parentheses: standard uncertainty u, in units of the last digits. U95 = k u: expanded uncertainty, the "
            "half width of an interval that covers the value with 95 % (JCGM 100)."
        )
    if run.verdict is not None:
        acceptance: Mapping[str, Any] = run.header.get("bench", {}).get("acceptance") or {}
        yield f"Decision rule: {_RULES[acceptance.get('guard_band', 'none')]}."
    left_out = [_KEY.sub("", each) for each in _left_out(run) if not _BOUND.fullmatch(each)]
    if left_out:
        yield f"U95 does not contain: {'; '.join(left_out)}."
    if len(left_out) < len(_left_out(run)):
        yield "Below: a bound with 95 %, where errors of the measurement alone may make as much as was found."
    if len(shown) > _MOST:
        yield f"{len(shown) - _MOST} results more are in the section Results."


def _left_out(run: Run) -> Sequence[str]:
    """Return what the uncertainties of the results do not contain."""
    results = None if run.results is None else plain(run.results)
    stated = results.get("uncertainty") if isinstance(results, dict) else None
    return (stated.get("not_in_u") or ()) if isinstance(stated, dict) else ()


def seal_of(run: Run) -> str | None:
    """Return the seal of the last line of a record, which `vcfbench runs verify` holds against all before it."""
    if run.directory is None:
        return None
    data = read_file(run.directory / "journal.jsonl", "the journal of a run", sys.maxsize)
    last = lines_after(data)[0]
    line = last[-1] if last else data.rstrip(b"\n").rpartition(b"\n")[2]
    try:
        seal = msgspec.json.decode(line).get("seal")
    except (msgspec.DecodeError, AttributeError):  # a line that is torn has none
        return None
    return seal if isinstance(seal, str) else None
