"""Questions of ``vcfbench bench new`` about a station; each answer is a value in TOML, and is held against the whole.

What an answer must be stands in one place, in the types of the bench file: whatever they refuse is asked for again.
"""

from collections.abc import Callable
from datetime import date
from typing import Any, Final, NamedTuple

import typer

from vcfbench.cli.interview import Interview
from vcfbench.cli.set_option import plain_value
from vcfbench.errors import ConfigError
from vcfbench.station.new_station import Draft
from vcfbench.station.settings import PAPER_RATES_DEG_S


class Question(NamedTuple):
    """A question: key of the bench file, words, proposal where it has no value yet, roles of which one must be there.

    An empty answer leaves the key out.
    """

    path: str
    words: str
    proposed: str = ""
    roles: tuple[str, ...] = ()


_TABLE, _POWER, _CHAMBER, _SCOPE = ("rate_table",), ("power",), ("chamber",), ("oscilloscope",)
_LATITUDE: Final = "site.latitude_deg"
_NODES: Final = "output, v_vc, drive, carrier, sense, rail_positive, rail_negative"
_FIRST: Final = (
    Question("name", "Short name of the station"),
    Question("title", "Its title, for reports"),
    Question("laboratory.name", "Name of the laboratory (Enter: none)"),
    Question("laboratory.address", "Its address (Enter: none)"),
    Question("laboratory.operator", "Who runs it (Enter: none)"),
)
_REST: Final = (
    "Limits: what must never be exceeded here. They are checked before anything is sent.",
    Question("limits.max_rate_deg_s", "Highest rate, deg/s", "", _TABLE),
    Question("limits.max_acceleration_deg_s2", "Highest acceleration, deg/s^2", "", _TABLE),
    Question("limits.max_v_vc_v", "Highest V_Vc, V, either sign", "", ("rate_source", "vibration_source")),
    Question("procedure.positive_rail_v", "Rails of the PCB, V, either sign", "10", _POWER),
    Question("limits.min_rail_v", "  they must not be below, V", "", _POWER),
    Question("limits.max_rail_v", "  nor above, V", "", _POWER),
    Question("limits.max_rail_current_a", "Highest current limit of a rail, A", "", _POWER),
    Question("limits.min_temperature_c", "Lowest temperature, degC", "", _CHAMBER),
    Question("limits.max_temperature_c", "Highest temperature, degC", "", _CHAMBER),
    Question("limits.max_ramp_k_min", "Fastest ramp, K/min", "", _CHAMBER),
    Question("wiring.rails.positive", "Supply output of the positive rail (P25V, P6V)", "P25V", _POWER),
    Question("wiring.oscilloscope.channel_1", f"Oscilloscope ({_NODES}): channel 1", "drive", _SCOPE),
    Question("wiring.oscilloscope.channel_2", "  channel 2", "carrier", _SCOPE),
    Question("wiring.oscilloscope.channel_3", "  channel 3", "sense", _SCOPE),
    Question("wiring.oscilloscope.channel_4", "  channel 4", "output", _SCOPE),
    Question(_LATITUDE, "Latitude, deg, north positive (for the Earth's rate)"),
    Question("site.mains_hz", "Mains frequency, Hz (50, 60)", "50"),
    "What is expected, low and high each: a run ends where it finds something else. Enter: not checked.",
    Question("expected.scale_factor_v_per_deg_s", "  Scale factor, V/(deg/s), signed: finds swapped leads"),
    Question("expected.bias_v", "  Output at rest, V"),
    Question("expected.k_vc_deg_s_per_v", "  K_Vc, (deg/s)/V"),
    "Limits of results, low and high each: outside, a run has failed. Enter: not judged.",
    Question("acceptance.scale_factor_v_per_deg_s", "  Scale factor, V/(deg/s), signed"),
    Question("acceptance.bias_deg_s", "  Bias, deg/s"),
    Question("acceptance.nonlinearity_ppm", "  Non-linearity, ppm of the span"),
    Question("acceptance.k_vc_deg_s_per_v", "  K_Vc, (deg/s)/V"),
    Question("acceptance.scale_factor_error_percent", "  Scale factor by V_Vc against table, %"),
    Question("acceptance.guard_band", "  nearer to a limit than U95 is marginal (none, U95)", "none"),
    "What the uncertainties rest on. Enter: not known: the worst of its class counts, or values are incomplete.",
    Question("uncertainty.table_rate_error", "  Largest relative error of the table's rate (1e-5)", "", _TABLE),
    Question("uncertainty.misalignment_deg", "  Largest angle from the table's axis, deg", "", _TABLE),
    Question("uncertainty.temperature_k", "  How far from the temperature stated, K (0: that of the run)"),
    Question("uncertainty.bias_instability_deg_h", "  Bias instability of the gyroscope, deg/h"),
)
"""All that is asked once the instruments are known, with headings."""


def _fitting_rates(limit_deg_s: float) -> dict[str, Any]:
    """Return rates of the procedures that stay below a limit, and a rate of the match."""
    if limit_deg_s >= max(PAPER_RATES_DEG_S):
        return {"procedure.rates_deg_s": None, "procedure.virtual-coriolis": None}
    fitting = [rate for rate in PAPER_RATES_DEG_S if abs(rate) <= limit_deg_s]
    rates = fitting if len(fitting) >= 7 else [limit_deg_s * part for part in (1.0, 0.5, 0.2, 0.0, -0.2, -0.5, -1.0)]
    positive = [rate for rate in reversed(rates) if rate > 0.0]
    match = {"match_rate_deg_s": min(10.0, limit_deg_s), "match_rates_deg_s": positive}
    return {"procedure.rates_deg_s": rates, "procedure.virtual-coriolis": match}


def _rails(volts: float) -> dict[str, Any]:
    own = {"positive": None, "negative": None} if volts == 10.0 else {"positive": volts, "negative": -volts}
    window = {"limits.min_rail_v": round(0.95 * volts, 6), "limits.max_rail_v": round(1.05 * volts, 6)}
    return {**window, **{f"procedure.{rail}_rail_v": level for rail, level in own.items()}}


_FOLLOW: Final[dict[str, Callable[[float], dict[str, Any]]]] = {
    "limits.max_rate_deg_s": _fitting_rates,
    "limits.max_acceleration_deg_s2": lambda most: {"procedure.acceleration_deg_s2": most if most < 100.0 else None},
    "limits.max_rail_current_a": lambda most: {"procedure.rail_current_limit_a": most if most < 0.1 else None},
    "procedure.positive_rail_v": _rails,
}
"""What else an answer decides: settings of the procedures that would leave a limit."""


def ask_about_station(draft: Draft, interview: Interview) -> None:
    """Ask for all that the file of a station must say once its instruments are known; answers go into the draft."""
    for each in _FIRST:
        _ask(each, draft, interview)
    for role in draft.roles():
        path = f"{role}.calibrated"
        _ask(Question(path, f"{role}: calibrated on (YYYY-MM-DD; Enter: not known)"), draft, interview)
        made: date | None = draft.value(path)
        if made is not None:
            leap = (made.month, made.day) == (2, 29)
            due = made.replace(year=made.year + 1, day=28 if leap else made.day)
            _ask(Question(f"{role}.calibration_due", "  due again on", str(due)), draft, interview)
            _ask(Question(f"{role}.certificate", "  number of the certificate (Enter: none)"), draft, interview)
    for heading_or_question in _REST:
        if isinstance(heading_or_question, str):
            typer.echo(heading_or_question, err=True)
        else:
            _ask(heading_or_question, draft, interview)


def _ask(question: Question, draft: Draft, interview: Interview) -> None:
    path, words, proposed, roles = question
    if roles and {*roles}.isdisjoint(draft.roles()):
        return
    if path == "acceptance.guard_band" and not draft.value("acceptance"):
        return

    def take(answer: str) -> None:
        if path == _LATITUDE and not answer:  # 0, the equator, would be a wrong Earth's rate that nobody sees
            raise ConfigError(f"{path}: expected that of the bench", hint=f"--set {path}=48.1")
        if answer:
            value: Any = answer
            if path.startswith(("expected", "acceptance")):  # low and high, with a blank or a comma between them
                value = plain_value(",".join(answer.replace(",", " ").split()), path)
            elif not path.startswith(("name", "title", "laboratory")) and not path.endswith("certificate"):
                value = plain_value(answer, path)
            draft.change({path: value})
            draft.change(_FOLLOW[path](value) if path in _FOLLOW else {})

    known = None if path == _LATITUDE else draft.value(path)
    if known is not None:
        proposed = f"{known:g}" if isinstance(known, float | int) else str(known)
    interview.ask(path, words, proposed, take)
