"""Questions of ``vcfbench bench new`` about a station, each answer held against the whole bench file at once."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.cli.interview import day, number, pair, say, yes_or_no
from vcfbench.errors import ConfigError
from vcfbench.models import find_language, find_model, languages, models_for
from vcfbench.sim.served import served_places
from vcfbench.station import discovery
from vcfbench.station.bounds import NAME_PATTERN
from vcfbench.station.settings import PAPER_RATES_DEG_S

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
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
    questions = _Questions(draft, interview)
    _names(questions)
    for role in draft.roles():
        # Ask for the dates of an instrument's calibration, and its certificate
        path = f"{role}.calibrated"
        questions.ask(path, f"{role}: calibrated on (YYYY-MM-DD; Enter: not known)", "", day)
        made: date | None = questions.draft.value(path)
        if made is not None:
            leap = (made.month, made.day) == (2, 29)
            due = made.replace(year=made.year + 1, day=28 if leap else made.day)
            questions.ask(f"{role}.calibration_due", "  due again on", str(due), day)
            questions.ask(f"{role}.certificate", "  number of the certificate (Enter: none)")
    # Ask for the limits of the station; proposals of procedures that would leave them follow
    roles = questions.draft.roles()
    say("Limits: what must never be exceeded here. They are checked before anything is sent.")
    if "rate_table" in roles:
        questions.limit("max_rate_deg_s", "Highest rate, deg/s", _fitting_rates)
        acceleration = "procedure.acceleration_deg_s2"
        words = "Highest acceleration, deg/s^2"
        questions.limit("max_acceleration_deg_s2", words, lambda most: {acceleration: most if most < 100.0 else None})
    if "rate_source" in roles or "vibration_source" in roles:
        questions.limit("max_v_vc_v", "Highest V_Vc, V, either sign")
    if "power" in roles:
        _rails(questions)
        current, words = "procedure.rail_current_limit_a", "Highest current limit of a rail, A"
        questions.limit("max_rail_current_a", words, lambda most: {current: most if most < 0.1 else None})
    if "chamber" in roles:
        for key, words in _CHAMBER_LIMITS:
            questions.limit(key, words)
    _wiring_and_site(questions)
    _results(questions)


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

_LABORATORY = (("name", "Name of the laboratory"), ("address", "Its address"), ("operator", "Who runs it"))
_CHAMBER_LIMITS = (
    ("min_temperature_c", "Lowest temperature, degC"),
    ("max_temperature_c", "Highest temperature, degC"),
    ("max_ramp_k_min", "Fastest ramp, K/min"),
)
_EXPECTED = (
    ("scale_factor_v_per_deg_s", "Scale factor, V/(deg/s), signed: finds swapped leads"),
    ("bias_v", "Output at rest, V"),
    ("k_vc_deg_s_per_v", "K_Vc, (deg/s)/V"),
)
_ACCEPTED = (
    ("scale_factor_v_per_deg_s", "Scale factor, V/(deg/s), signed"),
    ("bias_deg_s", "Bias, deg/s"),
    ("nonlinearity_ppm", "Non-linearity, ppm of the span"),
    ("k_vc_deg_s_per_v", "K_Vc, (deg/s)/V"),
    ("scale_factor_error_percent", "Scale factor by V_Vc against table, %"),
)
_OF_THE_TABLE = (
    ("table_rate_error", "Largest relative error of the table's rate, from its certificate (1e-5)"),
    ("misalignment_deg", "Largest angle between the gyroscope's axis and the table's, deg"),
)
_OF_THE_GYROSCOPE = (
    ("temperature_k", "How far the gyroscope's temperature may be from the one stated, K (0: that of the run)"),
    ("bias_instability_deg_h", "Bias instability of the gyroscope, deg/h"),
)


class _Questions(Struct, frozen=True):
    """Questions whose answers are values of the draft; an empty answer leaves the key out."""

    draft: Draft
    interview: Interview

    def ask(
        self,
        path: str,
        words: str,
        proposed: str = "",
        read: Callable[[str], Any] = str,
        follow: Callable[[Any], Mapping[str, Any]] = lambda _: {},
    ) -> None:
        """Ask for the value at `path`, read by `read`; `follow` are other keys that its value decides."""

        def take(answer: str) -> None:
            if answer:
                value = read(answer)
                self.draft.change({path: value, **follow(value)})

        self.interview.ask(path, words, proposed, take)

    def limit(self, key: str, words: str, follow: Callable[[Any], Mapping[str, Any]] = lambda _: {}) -> None:
        """Ask for a limit, its present value proposed."""
        self.ask(f"limits.{key}", words, f"{self.draft.value(f'limits.{key}'):g}", number, follow)

    def windows(self, table: str, questions: Sequence[tuple[str, str]]) -> None:
        """Ask for low and high of each key of a table."""
        for key, words in questions:
            self.ask(f"{table}.{key}", f"  {words}", "", lambda answer: list(pair(answer)))


def _names(questions: _Questions) -> None:
    def name(answer: str) -> str:
        if not re.match(NAME_PATTERN, answer):
            raise ConfigError(f"expected letters, digits, '.', '_' and '-', came {answer!r}")
        return answer

    values = questions.draft.values
    questions.ask("name", "Short name of the station", values["name"], name)
    questions.ask("title", "Its title, for reports", values["title"])
    for key, words in _LABORATORY:
        questions.ask(f"laboratory.{key}", f"{words} (Enter: none)")


def _fitting_rates(limit_deg_s: float) -> dict[str, Any]:
    """Return rates of the procedures that stay below a limit, and a rate of the match."""
    if limit_deg_s >= max(PAPER_RATES_DEG_S):
        return {"procedure.rates_deg_s": None, "procedure.virtual-coriolis": None}
    fitting = [rate for rate in PAPER_RATES_DEG_S if abs(rate) <= limit_deg_s]
    rates = fitting if len(fitting) >= 7 else [limit_deg_s * part for part in (1.0, 0.5, 0.2, 0.0, -0.2, -0.5, -1.0)]
    positive = [rate for rate in reversed(rates) if rate > 0.0]
    match = {"match_rate_deg_s": min(10.0, limit_deg_s), "match_rates_deg_s": positive}
    return {"procedure.rates_deg_s": rates, "procedure.virtual-coriolis": match}


def _rails(questions: _Questions) -> None:
    """Ask for the rails: their level goes to the procedures, the window about it to the limits."""
    draft, ask = questions.draft, questions.interview.ask

    def level(answer: str) -> None:
        volts = number(answer)
        usual = volts == 10.0
        draft.change(
            {
                "limits.min_rail_v": round(0.95 * volts, 6),
                "limits.max_rail_v": round(1.05 * volts, 6),
                "procedure.positive_rail_v": None if usual else volts,
                "procedure.negative_rail_v": None if usual else -volts,
            }
        )

    def window(answer: str) -> None:
        low, high = pair(answer)
        draft.change({"limits.min_rail_v": low, "limits.max_rail_v": high})

    ask("procedure.positive_rail_v", "Rails of the PCB, V, either sign", "10", level)
    proposed = f"{draft.value('limits.min_rail_v'):g} {draft.value('limits.max_rail_v'):g}"
    ask("limits.rails", "  they must stay within, V (low high)", proposed, window)


def _wiring_and_site(questions: _Questions) -> None:
    if "power" in questions.draft.roles():
        words = "Supply output of the positive rail (P25V, P6V; the negative one is N25V)"
        questions.ask("wiring.rails.positive", words, "P25V")
    if "oscilloscope" in questions.draft.roles():
        say(f"Oscilloscope: what each channel sees: {_NODES}")
        for channel, proposed in enumerate(("drive", "carrier", "sense", "output"), start=1):
            questions.ask(f"wiring.oscilloscope.channel_{channel}", f"  channel {channel}", proposed)
    words = "Latitude, deg, north positive (for the Earth's rate)"
    questions.ask("site.latitude_deg", words, "0", number)
    questions.ask("site.mains_hz", "Mains frequency, Hz (50, 60)", "50", number)


def _results(questions: _Questions) -> None:
    """Ask for expected values, acceptance, and sources of uncertainty; Enter leaves each out."""
    say("What is expected, low and high each: a run ends where it finds something else. Enter: not checked.")
    questions.windows("expected", _EXPECTED)
    say("Limits of results, low and high each: outside, a run has failed. Enter: not judged.")
    questions.windows("acceptance", _ACCEPTED)
    if questions.draft.value("acceptance"):
        words = "  nearer to a limit than U95 is marginal (none, U95)"
        questions.ask("acceptance.guard_band", words, _NONE)
    say("What the uncertainties rest on. Enter: not known: the worst of its class counts, or values are incomplete.")
    with_table = "rate_table" in questions.draft.roles()
    for key, words in (*(_OF_THE_TABLE if with_table else ()), *_OF_THE_GYROSCOPE):
        questions.ask(f"uncertainty.{key}", f"  {words}", "", number)
