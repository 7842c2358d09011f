"""Conflicts between settings of a 33220A: which one gives way, and the -221 that says so.

The words are general knowledge of the family (unverified), but for those that public drivers quote.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from simrack.instruments.agilent33220a.levels import Levels
from simrack.instruments.agilent33220a.settings import GeneratorKind, GeneratorSettings, conflict
from simrack.scpi import ScpiError

_NAMES = {"RAMP": "ramp", "PULS": "pulse", "USER": "user", "SIN": "sine", "SQU": "square", "TRI": "triangle"}
_MODE_WORDS = {"SWE": "sweep", "BURS": "burst"}
_UNMODULATED = {"PULS", "NOIS", "DC"}
_NOT_ABLE = {"SWE": "not able to sweep this function", "BURS": "not able to burst this function"}
_ROUND_OFF = 1 + 1e-12
_ABOVE_HZ = 100e3
"""How far FM may go above the function's highest frequency."""
_TIMED_BURST_HZ = 2.001e-3
"""Lowest frequency of bursts of the internal timer: one cycle and the rest go into its longest period."""
_BURST_REST_S = 200e-9
_EDGE_SHARE = 0.625


def fm_limit_hz(settings: GeneratorSettings, kind: GeneratorKind) -> float:
    """Return the largest deviation of the function: 10.05 MHz of a sine, 150 kHz of a ramp."""
    return float(kind.frequency_hz[settings.function][1] + _ABOVE_HZ) / 2.0


def width_limits_s(settings: GeneratorSettings, kind: GeneratorKind) -> tuple[float, float]:
    """Return the least and the largest width of a pulse of the present period and edges, s."""
    period = 1.0 / settings.frequency_hz
    shortest = next(width for limit, width in kind.least_width_s.items() if period <= limit * _ROUND_OFF)
    return shortest, period - max(shortest, settings.edge_s / _EDGE_SHARE)


def longest_edge_s(settings: GeneratorSettings, kind: GeneratorKind) -> float:
    """Return the largest edge time of a pulse of the present width and period, s."""
    room: float = min(settings.width_s, 1.0 / settings.frequency_hz - settings.width_s)
    return max(min(kind.edge_s[1], _EDGE_SHARE * room), kind.edge_s[0])


def widest_swing_s(settings: GeneratorSettings, kind: GeneratorKind) -> float:
    """Return the amount by which a pulse's width may be modulated: high and low keep their least width."""
    least, longest = width_limits_s(settings, kind)
    least = max(least, settings.edge_s / _EDGE_SHARE)
    return float(max(min(settings.width_s - least, longest - settings.width_s), 0.0))


class SettingRules:
    """Keeps the settings consistent; `report` takes the conflicts."""

    def __init__(
        self, kind: GeneratorKind, settings: GeneratorSettings, levels: Levels, report: Callable[[ScpiError], None]
    ) -> None:
        self._kind = kind
        self._settings = settings
        self._levels = levels
        self._report = report

    def _conflict(self, words: str) -> None:
        self._report(conflict(words))

    # --- functions and modes ----------------------------------------------------------------------------------------

    def select(self, function: str) -> None:
        """Change the function; settings beyond its abilities are reduced."""
        settings = self._settings
        left_dc = settings.function == "DC" and function != "DC"
        settings.function = function
        low, high = self._kind.frequency_hz[function]
        if not low <= settings.frequency_hz <= high:
            settings.frequency_hz = min(max(settings.frequency_hz, low), high)
            word = "reduced" if function != "PULS" else "changed"
            self._conflict(f"frequency {word} for {_NAMES.get(function, function)} function")
        if left_dc:
            self._levels.move_offset("offset changed on exit from dc function")
        if settings.mode and not self._allows(settings.mode):
            words = self._refusal(settings.mode)
            settings.mode = ""
            self._conflict(words)
        self.fit()

    def _allows(self, mode: str) -> bool:
        function = self._settings.function
        if mode == "PWM":
            return bool(function == "PULS")
        if mode == "BURS":
            return function != "DC" and not (function == "NOIS" and self._settings.burst_mode == "TRIG")
        return function not in _UNMODULATED

    def _refusal(self, mode: str) -> str:
        if mode == "BURS" and self._settings.function == "NOIS":
            return "triggered burst not available for noise"
        return _NOT_ABLE.get(mode, "not able to modulate this function")

    def switch_mode(self, mode: str, *, on: bool) -> None:
        """Switch one of AM, FM, PM, FSK, PWM, sweep, burst; only one can be on."""
        active = self._settings.mode
        if not on:
            self._settings.mode = "" if active == mode else active
            return
        if not self._allows(mode):
            raise conflict(self._refusal(mode))
        if active not in ("", mode):
            word = _MODE_WORDS.get(active, active)
            self._conflict(f"{word} turned off by selection of other mode or modulation")
        self._settings.mode = mode
        self.fit()

    # --- what depends on each other -----------------------------------------------------------------------------

    def fit(self) -> None:
        """Make settings fit each other again after one of them has changed."""
        self._fit_square()
        self._fit_pulse()
        # Keep FM above 0 Hz and not too far above the highest frequency, and PWM within the pulse
        settings = self._settings
        if settings.mode == "PWM":
            self._lower(
                "pwm_deviation_s",
                widest_swing_s(settings, self._kind),
                "PWM deviation decreased due to pulse parameters",
            )
        if settings.mode == "FM":
            highest = self._kind.frequency_hz[settings.function][1] + _ABOVE_HZ - settings.frequency_hz
            self._lower("fm_deviation_hz", settings.frequency_hz, "FM deviation cannot exceed carrier")
            self._lower("fm_deviation_hz", highest, "FM deviation exceeds max frequency")
        self._fit_burst()
        self._fit_marker()
        self._fit_connector()

    def _fit_square(self) -> None:
        settings = self._settings
        if (
            settings.function != "SQU"
            or settings.frequency_hz <= self._kind.narrow_duty_hz
            or 40.0 <= settings.duty_percent <= 60.0
        ):
            return
        settings.duty_percent = min(max(settings.duty_percent, 40.0), 60.0)
        self._conflict("frequency forced duty cycle change")

    def _fit_pulse(self) -> None:
        """Keep the pulse within its period, and the edges within the pulse."""
        settings = self._settings
        if settings.function != "PULS":
            return
        self._lower("edge_s", _EDGE_SHARE * 0.5 / settings.frequency_hz, "edge time decreased due to period")
        shortest, longest = width_limits_s(settings, self._kind)
        self._lower("width_s", longest, "pulse width decreased due to period")
        if settings.width_s < shortest / _ROUND_OFF:
            settings.width_s = shortest
            self._conflict("pulse width increased due to large period")
        self._lower("edge_s", _EDGE_SHARE * settings.width_s, "edge time decreased due to pulse width")

    def _lower(self, name: str, highest: float, words: str) -> None:
        if getattr(self._settings, name) > highest * _ROUND_OFF:
            setattr(self._settings, name, highest)
            self._conflict(words)

    def _fit_burst(self) -> None:
        settings = self._settings
        if settings.mode != "BURS":
            return
        timed = settings.burst_mode == "TRIG" and settings.trigger == "IMM"
        low, high = self._kind.burst_hz
        low = max(_TIMED_BURST_HZ, low) if timed else low
        if math.isinf(settings.cycles) or settings.function not in {"SIN", "SQU"}:
            high = self._kind.frequency_hz[settings.function][1]
        if not low <= settings.frequency_hz <= high:
            settings.frequency_hz = min(max(settings.frequency_hz, low), high)
            self._conflict("frequency made compatible with burst mode")
        if timed:
            self._fit_period()

    def _fit_period(self) -> None:
        """Keep a burst, and its delay, within the period of the internal timer."""
        settings = self._settings
        needed = settings.cycles / settings.frequency_hz + _BURST_REST_S
        if needed > self._kind.longest_burst_s:
            settings.cycles = max(1.0, math.floor((self._kind.longest_burst_s - _BURST_REST_S) * settings.frequency_hz))
            self._conflict("burst count reduced to fit entire burst")
            needed = min(settings.cycles / settings.frequency_hz + _BURST_REST_S, self._kind.longest_burst_s)
        if settings.burst_period_s < needed * (1 - 1e-12):
            settings.burst_period_s = needed
            self._conflict("burst period increased to fit entire burst")
        if settings.delay_s > settings.burst_period_s - needed + 1e-12:
            settings.delay_s = max(settings.burst_period_s - needed, 0.0)
            self._conflict("trigger delay reduced to fit entire burst")

    def _fit_marker(self) -> None:
        settings = self._settings
        low, high = sorted((settings.start_hz, settings.stop_hz))
        if settings.mode != "SWE" or not settings.marker_on or low <= settings.marker_hz <= high:
            return
        settings.marker_hz = min(max(settings.marker_hz, low), high)
        self._conflict("marker forced into sweep span")

    def _fit_connector(self) -> None:
        """Trig In and Trig Out are one connector: settings that need the input switch the output off."""
        settings = self._settings
        words = self._input_in_use()
        if settings.trigger_out and words:
            settings.trigger_out = False
            self._conflict(words)

    def _input_in_use(self) -> str:
        settings = self._settings
        if settings.mode == "FSK" and settings.fsk.source == "EXT":
            return "trigger output connector used by FSK"
        if settings.mode == "BURS" and settings.burst_mode == "GAT":
            return "trigger output connector used by burst gate"
        if settings.mode in {"BURS", "SWE"} and settings.trigger == "EXT":
            return "trigger output connector used by trigger external"
        return ""
