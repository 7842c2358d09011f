"""First page of a report: persons, dates, the results with their uncertainties, and their basis.

What ISO/IEC 17025, 7.8.2 and 7.8.4 ask for and nobody told is a blank line, to be filled in by hand.
"""

import re
import sys
from collections.abc import Collection, Iterator, Mapping
from typing import Any, Final

import msgspec

from vcfbench.archive.certificate import NOT_ADJUSTED, revised, stated_words
from vcfbench.archive.days import days_of
from vcfbench.archive.run import Run
from vcfbench.clock import CLOCK_SET
from vcfbench.files import read_file
from vcfbench.records.amendments import check_of, lines_after
from vcfbench.records.plain import plain
from vcfbench.records.schema import Status
from vcfbench.records.stated import left_out
from vcfbench.reports.document import Column, Figure, Heading, Notice, Part, Table, Text, Value, facts
from vcfbench.station.acceptance import Acceptance, Verdict, limit_key
from vcfbench.values.kinds import KINDS, in_words
from vcfbench.values.printing import grouped, incomplete
from vcfbench.values.sources import TEMPERATURE
from vcfbench.values.value import Value as Stated
from vcfbench.values.verdict import RULES

BLANK: Final = "_" * 24  # Stands for what was not told
_MEASURING: Final = ("multimeter", "V_Vc meter", "rate table")  # Results are traced by them: blanks if nothing is told
MOST: Final = 12  # So many results stand on the first page; the others follow
_OF_LINES: Final = {"scale_factor", "scale_factor_of_range", "scale_factor_by_v_vc"}
_KEY: Final = re.compile(r" \([a-z]+(?:_[a-z]+)+\)")  # Name of a setting, for programs


def front_page(
    run: Run,
    title: str,
    given: Mapping[str, str] | None,
    figure: Figure | None,
    left_unseen: str = "",
) -> Iterator[Part]:
    """Yield the parts of the first page of `run`; `given` are words of a certificate, `figure` the one that it shows.

    `left_unseen` says which faults the run would not have refused, as :func:`unseen_in_short` has them.

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
    table = values_table(run, most=MOST)
    if table is not None:
        yield table
    # before the notes, which may need a second page
    issued, seal = words.get("issued") or BLANK, seal_of(run) or "none"
    signature = ", ".join(filter(None, (BLANK, words.get("responsible"), words.get("responsible_function"))))
    yield facts([("issued on", issued), ("name, function, signature", signature), ("seal of the record", seal)])
    yield Text(
        "These results are those of the device named above, at the time and under the conditions stated. Without a "
        "signature this is no certificate. It is copied whole, or with the laboratory's leave."
    )
    if table is not None:
        yield Text("\n".join(_said_of_results(run, run.values.values())))
        if left_unseen:
            yield Text(f"It does not contain undetected faults either (section Undetected faults): {left_unseen}.")
    if figure is not None:
        yield figure


def _persons_and_dates(run: Run, words: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return persons, device and dates."""

    def said(*keys: str) -> str:
        return ", ".join(filter(None, map(words.get, keys))) or BLANK

    days, number = days_of(run), words.get("identifier")
    clock_set = ", clock set meanwhile" if any(CLOCK_SET in each for each in run.not_checked) else ""
    revision = "" if not run.amendments else f", revision {run.revision}, amended since the run (see Record)"
    traced = [
        f"{each.model} ({each.title}) {each.certificate or BLANK}{f', {each.calibrated}' if each.calibrated else ''}"
        for each in run.equipment
        if each.title in _MEASURING or each.certificate or each.calibrated
    ]
    return [
        *([("certificate", number)] if number and number != revised(run, run.name) else []),
        ("laboratory", said("laboratory", "laboratory_address", "laboratory_email", "laboratory_code")),
        ("customer", said("customer", "customer_address", "customer_email")),
        ("device", said("item", "item_manufacturer") if "item" in words else "MEMS gyroscope"),
        ("model", said("item_model")),
        ("serial number", said("serial")),
        ("record", f"{run.name or 'not recorded'}{revision}"),
        ("received on", said("received")),
        ("method", words.get("method", run.procedure)),
        ("deviations from it", said("deviations")),
        ("adjustment", words.get("adjustment", NOT_ADJUSTED)),
        ("place", said("place")),
        ("measured on", BLANK if days is None else f"{' to '.join(dict.fromkeys(days))} (UTC{clock_set})"),
        ("operator", run.metadata.operator or BLANK),
        ("checked by", checked(run) or BLANK),
        ("traceable by", "; ".join(traced) or BLANK),
    ]


def checked(run: Run) -> str | None:
    """Name the person that checked the run; later amendments are unchecked."""
    check = check_of(run.amendments)
    if check is None:
        return None
    since = "" if check.revision == run.revision else f"; revision {run.revision} is not checked"
    return f"{check.by}, {check.utc[:10]} (UTC), revision {check.revision}{since}"


def values_table(run: Run, most: int | None = None) -> Table | None:
    """Return the values that a run states, each in its form, with its limits; None where it states none.

    `most` of them, those with limits all the same.
    """
    verdict = run.verdict or Acceptance(())
    limits = {each.key: each for each in verdict.limits}
    rows: list[tuple[Value, ...]] = []
    for place, each in enumerate(run.values.values()):
        limit = limits.pop(limit_key(each), None)
        if most is not None and place >= most and limit is None:
            continue
        of, k = each.named, each.coverage_factor
        found = each.found_in_bound(of.factor) if limit else ""
        value = f"{each.figure(of.factor)} {of.unit}".strip() + found
        if each.u95 is not None:
            u95 = f"{grouped(abs(of.factor) * each.u95)} {of.unit}".strip()
        elif each.kind and KINDS[each.kind].stands_alone:
            u95 = "-"
        else:
            u95 = "in its value" if each.form != "plus-minus" else "not known"
        window = _window(limit, of.factor)
        rows.append((f"{of.words}{incomplete(each.missing)}", value, u95, None if k is None else f"{k:.2f}", *window))
    for limit in limits.values():  # of what no results state
        of, judged = verdict.named(limit), verdict.judged(limit)
        value = "-" if judged is None else f"{judged.figure(of.factor)} {of.unit}".strip()
        rows.append((of.words, value, "-" if judged is None else "not known", "", *_window(limit, of.factor)))
    names = ("quantity", "value", "U95", "k", "limits", "verdict")
    shown = len(names) if run.verdict is not None else 4
    columns = [Column(each, align="left" if place in {0, 5} else "right") for place, each in enumerate(names[:shown])]
    return Table(columns, [row[:shown] for row in rows], "Results") if rows else None


def _window(limit: Verdict | None, factor: float) -> tuple[str, str]:
    if limit is None:
        return "", ""
    rule = f"; {limit.rule}" if limit.rule else ""
    return f"{factor * limit.low:g} to {factor * limit.high:g}", f"{limit.said}{rule}"


def _said_of_results(run: Run, stated: Collection[Stated]) -> Iterator[str]:
    if any(each.u is not None for each in stated):
        yield (
            "In parentheses: standard uncertainty u, in units of the last digits. U95 = k u: expanded uncertainty, the "
            "half width of an interval that covers the value with 95 % (JCGM 100)."
        )
    applied = () if run.verdict is None else {each.rule for each in run.verdict.limits}
    for rule, words in RULES.items():
        if rule.value in applied:
            yield f"Decision rule, {rule.value}: {words}."
    under = dict.fromkeys(each.conditions for each in run.values.values())
    for conditions in under:
        yield f"The results hold at {conditions.words}."
    station = (plain(run.header.get("settings")) or {}).get("station", {})
    within_k = station.get("sources", {}).get("temperature_k")
    if within_k and any(part.source == TEMPERATURE for each in stated for part in each.parts):
        yield f"U95 contains a device that is up to {within_k:g} K away from the temperature of these results."
    over = {each.named.words: each.definition.levels_words for each in stated if each.kind in _OF_LINES}
    yield from (f"The {words} is that of the line over {levels}." for words, levels in over.items() if levels)
    if known := station.get("known"):
        measured = f", measured on {known['issued'][:10]} (UTC)" if known.get("issued") else ""
        yield f"Source of K_Vc: {known['source']}{measured}."
    yield from _limits_of_meters(station, {each.role for each in run.equipment})
    if without := [_KEY.sub("", each) for each in left_out(run.results)]:
        yield f"U95 does not contain: {'; '.join(without)}."
    if any(each.form == "below" for each in stated):
        yield "Below: an upper bound (95 %), given if the value found is within the errors of the measurement."
    if len(stated) > MOST:
        yield f"All {len(stated)} results are in the section Results."


def _limits_of_meters(station: Mapping[str, Any], used: Collection[str]) -> Iterator[str]:
    """Yield for each voltmeter that was used the distribution of the limits of its data sheet."""
    sources, meters = station.get("sources", {}), station.get("meters", {})
    for role, key in (("multimeter", "meter"), ("v_vc_meter", "v_vc")):
        is_stream = role == "multimeter" and (station.get("gyro") or {}).get("stream")
        if is_stream or role not in used or sources.get(f"{key}_gain") is None:
            continue
        sigmas, name = sources.get(f"{key}_sigmas"), in_words(role)[0]
        counted = (
            f"{sigmas:g} standard deviations, as its maker says" if sigmas else "rectangular: any error is as likely"
        )
        if not meters.get(role, {}).get("calibration"):
            yield f"Limits of the data sheet of the {name} count as {counted}."


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
