"""What must be true of a run on a failing wire, whatever it was: each rule says what is wrong, or nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tests.faults.benches import Physics

__all__ = ["REST_S", "Facts", "mistakes"]

REST_S = 5.0
"""How long a table may turn after a step has failed, and anything be live after the end of the run, s."""

VOLTS, SHARE = 0.02, 0.02
"""More than the noise and the unfinished settling of points that were hurried; a wrong digit is more."""


@dataclass(frozen=True, slots=True)
class Facts:
    """What was seen of a run: its end, its words, its record, and the physics afterwards."""

    exit_code: int | None
    """None when it had to be killed."""
    stderr: str
    footer: Mapping[str, Any] | None
    answer: Mapping[str, Any] | None
    """What ``--json`` has printed."""
    physics: Physics
    hears: bool
    """Whether the instrument could be told anything."""
    still_s: float | None
    """From the step that failed, or the end of a run in which none did, until the table was at rest, s."""
    rest_s: float | None
    """The same until all was at rest and off, s."""
    after_end_s: float | None
    """From the end of the run until all was at rest and off, s."""
    slowness_s: float
    """What a stop on a good wire takes on this machine, s."""
    clean_v: Sequence[float] | None
    """The outputs of the run without a fault, V; None when nobody has to compare."""

    @property
    def unsafe(self) -> list[Mapping[str, Any]]:
        """The reports of what was not proved safe."""
        return [] if self.footer is None else [report for report in self.footer["safe"] if not report["safe"]]


def _ends(facts: Facts) -> str | None:
    return "it did not end" if facts.exit_code is None else None


def _known_code(facts: Facts) -> str | None:
    return None if facts.exit_code in {0, 3, 5, None} else f"exit code {facts.exit_code}"


def _no_traceback(facts: Facts) -> str | None:
    return "a traceback" if "Traceback" in facts.stderr or "RecursionError" in facts.stderr else None


def _at_rest(facts: Facts) -> str | None:
    turns = facts.hears and not facts.physics.at_rest
    return f"the table turns at {facts.physics.rate_deg_s:.4g} deg/s" if turns else None


def _off(facts: Facts) -> str | None:
    return f"left on: {facts.physics}" if facts.hears and not facts.physics.off else None


def _still_soon(facts: Facts) -> str | None:
    bar_s = REST_S + facts.slowness_s
    if facts.hears and facts.still_s is not None and facts.still_s > bar_s:
        return f"the table is at rest only {facts.still_s:.1f} s after the step that failed"
    return None


def _off_soon(facts: Facts) -> str | None:
    """An orderly end waits for each instrument in turn; once the run is over all must be off."""
    bar_s = REST_S + facts.slowness_s
    if facts.hears and facts.after_end_s is not None and facts.after_end_s > bar_s:
        return f"at rest and off only {facts.after_end_s:.1f} s after the end of the run"
    return None


def _recorded(facts: Facts) -> str | None:
    return "the journal has no footer" if facts.footer is None else None


def _not_safe_is_said(facts: Facts) -> str | None:
    if facts.exit_code != 5:
        return None
    missing = [report["instrument"] for report in facts.unsafe if report["instrument"] not in facts.stderr]
    if "NOT SAFE" not in facts.stderr or not facts.unsafe or missing:
        return f"exit code 5 without its words {missing}"
    return None


def _safe_is_proved(facts: Facts) -> str | None:
    if facts.exit_code not in {0, 3}:
        return None
    if facts.unsafe:
        return f"exit code {facts.exit_code} though not proved: {facts.unsafe}"
    return None if facts.physics.safe else f"exit code {facts.exit_code} though {facts.physics}"


def _complete_is_right(facts: Facts) -> str | None:
    if facts.exit_code != 0:
        return None
    if facts.answer is None or facts.answer["status"] != "complete":
        return "exit code 0 without a complete answer"
    if facts.clean_v is None:
        return None
    came = [point["output_v"] for point in facts.answer["points"]]
    same = len(came) == len(facts.clean_v) and all(
        abs(one - other) <= VOLTS + SHARE * abs(other) for one, other in zip(came, facts.clean_v, strict=True)
    )
    return None if same else f"complete with wrong numbers: {came}, without a fault {list(facts.clean_v)}"


_RULES: tuple[Callable[[Facts], str | None], ...] = (
    _ends,
    _known_code,
    _no_traceback,
    _at_rest,
    _off,
    _still_soon,
    _off_soon,
    _recorded,
    _not_safe_is_said,
    _safe_is_proved,
    _complete_is_right,
)


def mistakes(facts: Facts) -> tuple[str, ...]:
    """Return what is wrong."""
    return tuple(wrong for rule in _RULES if (wrong := rule(facts)) is not None)
