"""Questions of ``vcfbench bench new`` about results: expected values, acceptance, sources of uncertainty."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from vcfbench.cli.interview import number, pair, say

if TYPE_CHECKING:
    from vcfbench.cli.interview import Interview
    from vcfbench.station.new_station import Draft

_NONE = "none"


def results(draft: Draft, interview: Interview) -> None:
    """Ask for expected values, acceptance, and sources of uncertainty; Enter leaves each out."""
    say("What is expected, low and high each: a run ends where it finds something else. Enter: not checked.")
    for key, words in (
        ("scale_factor_v_per_deg_s", "Scale factor, V/(deg/s), signed: finds swapped leads"),
        ("bias_v", "Output at rest, V"),
        ("k_vc_deg_s_per_v", "K_Vc, (deg/s)/V"),
    ):
        path = f"expected.{key}"
        interview.ask(path, f"  {words}", "", partial(_window, draft, path))
    _acceptance(draft, interview)
    _uncertainty(draft, interview)


def put_text(draft: Draft, path: str, answer: str) -> None:
    """Put a text at a dotted key, if there is one."""
    if answer:
        draft.change({path: answer})


def put_number(draft: Draft, path: str, answer: str) -> None:
    """Put a number at a dotted key."""
    draft.change({path: number(answer)})


def _acceptance(draft: Draft, interview: Interview) -> None:
    say("Limits of results, low and high each: outside, a run has failed. Enter: not judged.")
    for key, words in (
        ("scale_factor_v_per_deg_s", "Scale factor, V/(deg/s), signed"),
        ("bias_deg_s", "Bias, deg/s"),
        ("nonlinearity_ppm", "Non-linearity, ppm of the span"),
        ("k_vc_deg_s_per_v", "K_Vc, (deg/s)/V"),
        ("scale_factor_error_percent", "Scale factor by V_Vc against table, %"),
    ):
        path = f"acceptance.{key}"
        interview.ask(path, f"  {words}", "", partial(_window, draft, path))
    if draft.value("acceptance"):
        path = "acceptance.guard_band"
        words = "  nearer to a limit than U95 is marginal (none, U95)"
        interview.ask(path, words, _NONE, partial(put_text, draft, path))


def _window(draft: Draft, path: str, answer: str) -> None:
    if answer:
        draft.change({path: list(pair(answer))})


def _uncertainty(draft: Draft, interview: Interview) -> None:
    """Ask for the values that everybody can state; the rest is in the file, switched off."""
    say("What the uncertainties rest on. Enter: not known: the worst of its class counts, or values are incomplete.")
    roles = draft.roles()
    known = [
        ("temperature_k", "How far the gyroscope's temperature may be from the one stated, K (0: that of the run)"),
        ("bias_instability_deg_h", "Bias instability of the gyroscope, deg/h"),
    ]
    if "rate_table" in roles:
        known = [
            ("table_rate_error", "Largest relative error of the table's rate, from its certificate (1e-5)"),
            ("misalignment_deg", "Largest angle between the gyroscope's axis and the table's, deg"),
            *known,
        ]
    for key, words in known:
        path = f"uncertainty.{key}"
        interview.ask(path, f"  {words}", "", partial(_number_or_none, draft, path))


def _number_or_none(draft: Draft, path: str, answer: str) -> None:
    if answer:
        put_number(draft, path, answer)
