"""Questions of ``vcfbench bench new`` about a station, each answer held against the whole bench file at once."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from vcfbench.cli.interview import day, number, pair, say, yes_or_no
from vcfbench.cli.result_questions import put_number, put_text, results
from vcfbench.errors import ConfigError
from vcfbench.models import find_language, find_model, languages, models_for
from vcfbench.sim.served import served_places
from vcfbench.station import discovery
from vcfbench.station.bounds import NAME_PATTERN
from vcfbench.station.settings import PAPER_RATES_DEG_S

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import date

    from vcfbench.cli.interview import Interview
    from vcfbench.station.discovery import DiscoveredInstrument
    from vcfbench.station.new_station import Draft

_NONE = "none"
_USUAL = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table")
"""Roles that are asked for when nothing was found for them."""
_NODES = "output, v_vc, drive, carrier, sense, rail_positive, rail_negative"


@dataclass(frozen=True, slots=True)
class DiscoveryOptions:
    """Search for instruments, as ``bench discover`` takes it; `served` is a control port."""

    library: str
    tries: tuple[str, ...]
    timeout_s: float
    probe_serial: bool
    served: str | None


def interviewed(draft: Draft, interview: Interview, finding: DiscoveryOptions) -> None:
    """Find instruments and ask for everything that a station's file must say.

    Raises:
        BenchError: the VISA library cannot be used, or a served bench is not served.
    """
    _instruments(draft, interview, finding)
    _names(draft, interview)
    for role in draft.roles():
        _calibration(draft, interview, role)
    _limits(draft, interview)
    _wiring(draft, interview)
    words = "Latitude, deg, north positive (for the Earth's rate)"
    interview.ask("site.latitude_deg", words, "0", partial(put_number, draft, "site.latitude_deg"))
    interview.ask("site.mains_hz", "Mains frequency, Hz (50, 60)", "50", partial(put_number, draft, "site.mains_hz"))
    results(draft, interview)


# Instruments


def _instruments(draft: Draft, interview: Interview, finding: DiscoveryOptions) -> None:
    say("Looking for instruments ...")
    found, places = _found(draft, finding)
    for each in found:
        _place(draft, interview, each, places.get(each.resource))
    while not interview.silent and (more := _further(draft, interview, finding)):
        _place(draft, interview, more, None)
    for role in _USUAL:
        if role not in draft.roles() and (not interview.silent or f"{role}.resource" in interview.given):
            _named_by_hand(draft, interview, finding, role)
    if not draft.roles():
        raise ConfigError(
            "no instrument was found or named, so there is no bench", hint="--try RESOURCE, --served PORT"
        )


def _found(draft: Draft, finding: DiscoveryOptions) -> tuple[list[DiscoveredInstrument], dict[str, str]]:
    """Return the instruments that answer, and the place of each by its resource, where it is known."""
    places: dict[str, str] = {}
    if finding.served is not None:
        control, places = served_places(finding.served)
        draft.values["served"] = {"control": control}
        asked = discovery.discover("@py", tuple(places), timeout_s=finding.timeout_s)
        answering = list(asked.tried)
    else:
        asked = discovery.discover(
            finding.library, finding.tries, timeout_s=finding.timeout_s, serial_probe=finding.probe_serial
        )
        answering = [*asked.resources, *(port.found for port in asked.serial_ports if port.found), *asked.tried]
        if finding.library != "@py":
            draft.values["visa_library"] = finding.library
    for each in answering:
        say(f"  {each.resource}: {each.answer or each.problem}")
    for port in asked.serial_ports:
        if port.found is None and finding.served is None:
            say(f"  {port.port}: {port.description}, not asked (--probe-serial asks)")
    return [each for each in answering if each.answer is not None], places


def _place(draft: Draft, interview: Interview, found: DiscoveredInstrument, hint: str | None) -> None:
    """Ask for the role of an instrument that answered."""
    possible = discovery.places(found.model) or (*_USUAL, "v_vc_meter", "vibration_source", "chamber")
    free = [role for role in possible if role not in draft.roles()]
    proposed = hint if hint in free else free[0] if free and found.model is not None else _NONE

    def take(role: str) -> None:
        if role == _NONE:
            return
        if role not in free:
            taken = f"; {role} is filled already" if role in draft.roles() else ""
            raise ConfigError(f"expected one of {', '.join((*free, _NONE))}, came {role!r}{taken}")
        draft.add_instrument(role, _keys(interview, role, found))
        _lock(draft, interview, role, found)

    what = found.model or "not recognised"
    interview.ask(f"role of {found.resource}", f"{what} at {found.resource}: its role", proposed, take)


def _keys(interview: Interview, role: str, found: DiscoveredInstrument) -> dict[str, Any]:
    """Return the bench file's keys of an instrument; those of one that is not recognised are asked for."""
    keys = discovery.taken_over(role, found)
    if found.model is None and role == "rate_table":
        keys["dialect"] = interview.ask("rate_table.dialect", "  language of the table", "acl", _language)
    elif found.model is None:
        keys["model"] = (found.answer or "").split(",")[1].strip() if "," in (found.answer or "") else ""
        keys["like"] = interview.ask(f"{role}.like", "  which it speaks like", models_for(role)[0], _model(role))
    if keys.get("dialect") == "zaber":
        keys["steps_per_deg"] = interview.ask("rate_table.steps_per_deg", "  microsteps per degree", "", number)
    return keys


def _language(answer: str) -> str:
    if find_language(answer) is None and not answer.endswith(".toml"):
        raise ConfigError(f"expected one of {', '.join(languages())}, or FILE.toml, came {answer!r}")
    return answer


def _model(role: str) -> Callable[[str], str]:
    def take(answer: str) -> str:
        row = find_model(answer)
        if row is None or role not in row.places:
            raise ConfigError(f"expected one of {', '.join(models_for(role))}, came {answer!r}")
        return answer

    return take


def _lock(draft: Draft, interview: Interview, role: str, found: DiscoveredInstrument) -> None:
    """Ask whether another specimen shall be refused, where there is a serial number to tell it by."""
    if role == "rate_table" or found.serial_number is None:
        return

    def take(answer: str) -> None:
        if yes_or_no(answer):
            draft.change({f"{role}.serial_number": found.serial_number})

    interview.ask(
        f"{role}.serial_number", f"  refuse any other than number {found.serial_number} (yes, no)", "no", take
    )


def _further(draft: Draft, interview: Interview, finding: DiscoveryOptions) -> DiscoveredInstrument | None:
    """Ask for a resource that does not announce itself; None when there is none."""

    def take(answer: str) -> DiscoveredInstrument | None:
        if not answer:
            return None
        known = {part["resource"]: role for role in draft.roles() if isinstance(part := draft.values[role], dict)}
        if answer in known:
            raise ConfigError(f"{answer} is {known[answer]} already")
        return _asked(answer, finding)

    return interview.ask("further", "Another resource to ask (TCPIP0::..., socket://host:port; Enter: none)", "", take)


def _asked(resource: str, finding: DiscoveryOptions) -> DiscoveredInstrument:
    """Return the instrument that answers at `resource`; ConfigError when none does."""
    found = discovery.discover("@py", (resource,), timeout_s=finding.timeout_s).tried[0]
    if found.answer is None:
        raise ConfigError(f"{resource}: {found.problem}")
    return found


def _named_by_hand(draft: Draft, interview: Interview, finding: DiscoveryOptions, role: str) -> None:
    """Ask where an instrument is that was not found; one that is switched off today may be named all the same."""
    words = (
        f"No {role} was found: its resource ('off RESOURCE' when it does not answer today; Enter: the bench has none)"
    )

    def take(answer: str) -> None:
        if not answer:
            return
        silent = answer.startswith("off ")
        resource = answer.removeprefix("off ").strip()
        found = discovery.DiscoveredInstrument(resource) if silent else _asked(resource, finding)
        if silent:
            asked = _language if role == "rate_table" else _model(role)
            first = "acl" if role == "rate_table" else models_for(role)[0]
            key = "dialect" if role == "rate_table" else "model"
            model = interview.ask(f"{role}.{key}", f"  its {key}", first, asked)
            found = discovery.DiscoveredInstrument(resource, model=model)
        elif found.model is not None and role not in discovery.places(found.model):
            raise ConfigError(f"{found.model} answers there, which is no {role}")
        draft.add_instrument(role, _keys(interview, role, found))

    interview.ask(f"{role}.resource", words, "", take)


# Everything else


def _names(draft: Draft, interview: Interview) -> None:
    def name(answer: str) -> None:
        if not re.match(NAME_PATTERN, answer):
            raise ConfigError(f"expected letters, digits, '.', '_' and '-', came {answer!r}")
        draft.change({"name": answer})

    interview.ask("name", "Short name of the station", draft.values["name"], name)
    interview.ask("title", "Its title, for reports", draft.values["title"], partial(put_text, draft, "title"))
    for key, words in (("name", "Name of the laboratory"), ("address", "Its address"), ("operator", "Who runs it")):
        path = f"laboratory.{key}"
        interview.ask(path, f"{words} (Enter: none)", "", partial(put_text, draft, path))


def _calibration(draft: Draft, interview: Interview, role: str) -> None:
    """Ask for the dates of an instrument's calibration, and its certificate."""

    def done(answer: str) -> None:
        if answer:
            draft.change({f"{role}.calibrated": day(answer)})

    interview.ask(f"{role}.calibrated", f"{role}: calibrated on (YYYY-MM-DD; Enter: not known)", "", done)
    made = draft.value(f"{role}.calibrated")
    if made is None:
        return

    def due(answer: str) -> None:
        draft.change({f"{role}.calibration_due": day(answer)})

    interview.ask(f"{role}.calibration_due", "  due again on", str(_a_year_after(made)), due)
    path = f"{role}.certificate"
    interview.ask(path, "  number of the certificate (Enter: none)", "", partial(put_text, draft, path))


def _a_year_after(made: date) -> date:
    try:
        return made.replace(year=made.year + 1)
    except ValueError:  # 29 February
        return made.replace(year=made.year + 1, day=28)


def _limits(draft: Draft, interview: Interview) -> None:
    """Ask for the limits of the station; proposals of procedures that would leave them follow."""
    roles = draft.roles()
    if roles:
        say("Limits: what must never be exceeded here. They are checked before anything is sent.")
    if "rate_table" in roles:
        _limit(draft, interview, "max_rate_deg_s", "Highest rate, deg/s", _fitting_rates)
        _limit(draft, interview, "max_acceleration_deg_s2", "Highest acceleration, deg/s^2", _fitting_acceleration)
    if "rate_source" in roles or "vibration_source" in roles:
        _limit(draft, interview, "max_v_vc_v", "Highest V_Vc, V, either sign")
    if "power" in roles:
        _rails(draft, interview)
        _limit(draft, interview, "max_rail_current_a", "Highest current limit of a rail, A", _fitting_current)
    if "chamber" in roles:
        _limit(draft, interview, "min_temperature_c", "Lowest temperature, degC")
        _limit(draft, interview, "max_temperature_c", "Highest temperature, degC")
        _limit(draft, interview, "max_ramp_k_min", "Fastest ramp, K/min")


def _nothing_else(limit: float) -> dict[str, Any]:
    del limit
    return {}


def _limit(
    draft: Draft,
    interview: Interview,
    key: str,
    words: str,
    follow: Callable[[float], dict[str, Any]] = _nothing_else,
) -> None:
    path = f"limits.{key}"

    def take(answer: str) -> None:
        limit = number(answer)
        draft.change({path: limit, **follow(limit)})

    interview.ask(path, words, f"{draft.value(path):g}", take)


def _fitting_rates(limit_deg_s: float) -> dict[str, Any]:
    """Return rates of the procedures that stay below a limit, and a rate of the match."""
    if limit_deg_s >= max(PAPER_RATES_DEG_S):
        return {"procedure.rates_deg_s": None, "procedure.virtual-coriolis": None}
    fitting = [rate for rate in PAPER_RATES_DEG_S if abs(rate) <= limit_deg_s]
    rates = fitting if len(fitting) >= 7 else [limit_deg_s * part for part in (1.0, 0.5, 0.2, 0.0, -0.2, -0.5, -1.0)]
    positive = [rate for rate in reversed(rates) if rate > 0.0]
    match = {"match_rate_deg_s": min(10.0, limit_deg_s), "match_rates_deg_s": positive}
    return {"procedure.rates_deg_s": rates, "procedure.virtual-coriolis": match}


def _fitting_acceleration(limit_deg_s2: float) -> dict[str, Any]:
    return {"procedure.acceleration_deg_s2": limit_deg_s2 if limit_deg_s2 < 100.0 else None}


def _fitting_current(limit_a: float) -> dict[str, Any]:
    return {"procedure.rail_current_limit_a": limit_a if limit_a < 0.1 else None}


def _rails(draft: Draft, interview: Interview) -> None:
    """Ask for the rails: their level goes to the procedures, the window about it to the limits."""

    def level(answer: str) -> None:
        volts = number(answer)
        window = {"limits.min_rail_v": round(0.95 * volts, 6), "limits.max_rail_v": round(1.05 * volts, 6)}
        usual = volts == 10.0
        draft.change(
            {
                **window,
                "procedure.positive_rail_v": None if usual else volts,
                "procedure.negative_rail_v": None if usual else -volts,
            }
        )

    interview.ask("procedure.positive_rail_v", "Rails of the PCB, V, either sign", "10", level)
    proposed = f"{draft.value('limits.min_rail_v'):g} {draft.value('limits.max_rail_v'):g}"

    def window(answer: str) -> None:
        low, high = pair(answer)
        draft.change({"limits.min_rail_v": low, "limits.max_rail_v": high})

    interview.ask("limits.rails", "  they must stay within, V (low high)", proposed, window)


def _wiring(draft: Draft, interview: Interview) -> None:
    if "power" in draft.roles():
        words = "Supply output of the positive rail (P25V, P6V; the negative one is N25V)"
        interview.ask("wiring.rails.positive", words, "P25V", partial(put_text, draft, "wiring.rails.positive"))
    if "oscilloscope" not in draft.roles():
        return
    say(f"Oscilloscope: what each channel sees: {_NODES}")
    for channel, proposed in enumerate(("drive", "carrier", "sense", "output"), start=1):
        path = f"wiring.oscilloscope.channel_{channel}"
        interview.ask(path, f"  channel {channel}", proposed, partial(put_text, draft, path))
