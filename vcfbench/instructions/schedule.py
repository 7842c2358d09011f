"""Order of the rates of a calibration, places of zeros, lengths of windows: pure functions of numbers.

A drift of the zero reads as scale factor where rate and time go together: in the paper's falling order 1 mV a window is
0.4 % of the scale factor. In `ABBA` each pair of rates is taken +, -, -, +, which a linear drift leaves as it is.
"""

import math
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import Annotated, ClassVar

from vcfbench.instructions.kept import KnownFlickerSettings
from vcfbench.instructions.scale_factor import require_as_used, tells_scale_factor
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import ProcedureSettings

ABBA_SIGNS = (1.0, -1.0, -1.0, 1.0)
"""A level and its opposite so that a linear drift cancels between them."""

EARTH_DEG_S = 15.041067 / 3600.0
"""The Earth's rate."""

ZERO_TABLE, ZERO_DRIVEN, SEARCH = 5, 6, 7
"""The numbers that points of zeros carry, table at rest with the generator off, and with the generator on at 0 V; and
those of a search for V_Vc.
"""


class Order(Enum):
    """Order of the rates.

    `PAPER`: as they are given. `ALTERNATE`: by size, + before -. `ABBA`: by size, each pair +, -, -, +. `LOOP`: from 0
    up to the largest, down to the smallest, back to 0.
    """

    PAPER = "paper"
    ALTERNATE = "alternate"
    ABBA = "abba"
    LOOP = "loop"


class Zeros(Enum):
    """Additional zeros: none, before and after each series, before and after each rate."""

    NONE = "none"
    ENDS = "ends"
    BRACKET = "bracket"


class KvcBy(Enum):
    """Source of K_Vc in the four steps.

    `ONE_POINT`: the match at one rate. `PLUS_MINUS`: half the difference of those at it and its opposite. `CURVE`: a
    curve through matches at several rates of both signs.
    """

    ONE_POINT = "one-point"
    PLUS_MINUS = "plus-minus"
    CURVE = "curve"


class Earth(Enum):
    """Treatment of the Earth's rate: it stays in the bias, or is added to the rate of the table."""

    BIAS = "bias"
    RATE = "rate"


class SweepSettings(KnownFlickerSettings, frozen=True, kw_only=True):
    """Settings of procedures that visit rates: the defaults are the paper's."""

    order: Annotated[Order, said("order of the rates; drift cancels in abba, a loop shows hysteresis", option=True)] = (
        Order.PAPER
    )
    zeros: Annotated[
        Zeros,
        said(
            "measure zeros around each series (ends) or each rate (bracket) and subtract their drift", option="--zero"
        ),
    ] = Zeros.NONE
    repeat: Annotated[int, ranged(1, 100, "number of times that the series is measured", option=True)] = 1
    earth: Annotated[
        Earth, said("the Earth's rate stays in the bias, or is added to the table's rate", option=True)
    ] = Earth.BIAS
    axis_tilt_deg: Annotated[float, ranged(0.0, 90.0, "largest tilt of the table's axis; used if earth is rate")] = 0.5

    table_step: ClassVar[int] = 1
    """The number that the points on the table carry."""

    @property
    def early_look(self) -> tuple[str, ...]:
        """The table, where the bench file expects a scale factor."""
        return ("rate_table",) if tells_scale_factor(self) else ()

    def require_known_answer(self, slope: float, within: float, *, by_v_vc: bool) -> None:
        """See that the output answers as the bench file expects."""
        require_as_used(self, slope, within, by_v_vc=by_v_vc)

    @property
    def as_in_the_paper(self) -> bool:
        """True if the rates are visited as the paper does it."""
        asked = (self.order, self.zeros, self.repeat, self.earth)
        return asked == (Order.PAPER, Zeros.NONE, 1, Earth.BIAS)

    @property
    def series_deg_s(self) -> tuple[float, ...]:
        """The rates of one series in their order."""
        return ordered(self.rates_deg_s, self.order)

    @property
    def visits_deg_s(self) -> tuple[float | None, ...]:
        """All windows of a sweep in their order, None where a zero is taken."""
        return visits(self.series_deg_s, self.zeros, self.repeat)

    @property
    def earth_rate_deg_s(self) -> float:
        """Addition to the rate of the table, deg/s: the Earth's rate about its axis, or nothing."""
        if self.earth is Earth.BIAS or self.station.latitude_deg is None:
            return 0.0
        return EARTH_DEG_S * math.sin(math.radians(self.station.latitude_deg))

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.order is Order.ABBA and sorted(self.rates_deg_s) != sorted(-rate for rate in self.rates_deg_s):
            expected = "each rate with both signs, equally often (order abba takes pairs)"
            yield InvalidValue("rates_deg_s", expected, list(self.rates_deg_s))
        if self.earth is Earth.RATE and self.station.latitude_deg is None:
            yield InvalidValue("earth", "a latitude in the bench file (site.latitude_deg)", "rate")


def ordered(rates_deg_s: Sequence[float], order: Order) -> tuple[float, ...]:
    """Return one series: the rates in the order in which they are visited.

    `PAPER` and `ALTERNATE` visit each as often as it is given, `ABBA` twice as often; `LOOP` visits each different rate
    twice, once on a way up and once on a way down, and 0 three times.
    """
    if order is Order.ALTERNATE:
        return tuple(sorted(rates_deg_s, key=lambda rate: (abs(rate), -rate)))
    if order is Order.ABBA:
        plus = sorted(rate for rate in rates_deg_s if rate > 0.0)
        at_rest = [0.0] * (2 * sum(rate == 0.0 for rate in rates_deg_s))
        return (*at_rest, *(sign * rate for rate in plus for sign in (1.0, -1.0, -1.0, 1.0)))
    if order is Order.LOOP:
        return tuple(rate for _, way in _loop(rates_deg_s) for rate in way)
    return tuple(rates_deg_s)


def loop_directions(rates_deg_s: Sequence[float]) -> tuple[int, ...]:
    """Return the direction of each window of a loop: 1 on a way up, -1 on the way down."""
    return tuple(direction for direction, way in _loop(rates_deg_s) for _ in way)


def _loop(rates_deg_s: Sequence[float]) -> list[tuple[int, list[float]]]:
    rising = sorted({rate + 0.0 for rate in rates_deg_s})
    return [(1, [rate for rate in rising if rate >= 0.0]), (-1, rising[::-1]), (1, [r for r in rising if r <= 0.0])]


def visits(series_deg_s: Sequence[float], zeros: Zeros, repeat: int) -> tuple[float | None, ...]:
    """Return all windows of `repeat` series; None is a zero, and one between two windows serves both."""
    if zeros is Zeros.NONE:
        return tuple(series_deg_s) * repeat
    if zeros is Zeros.ENDS:
        return (None, *(*series_deg_s, None) * repeat)
    return (None, *[each for rate in series_deg_s for each in (rate, None)] * repeat)


def sweep_words(settings: SweepSettings) -> str:
    """Return the order of the rates in words if it is not the paper's way; else empty."""
    if settings.as_in_the_paper:
        return ""
    zeros = {
        Zeros.NONE: "no zeros between",
        Zeros.ENDS: "a zero before and after each series",
        Zeros.BRACKET: "a zero before and after each rate",
    }[settings.zeros]
    if settings.zeros is Zeros.ENDS and settings.order is Order.PAPER:
        zeros += " (two zeros know a drift less well than rates that fall or rise count it: u grows; abba, bracket)"
    words = [f"order {settings.order.value}", zeros]
    words += [f"{settings.repeat} times"] if settings.repeat > 1 else []
    words += ["the Earth's rate added to the table's"] if settings.earth is Earth.RATE else []
    return ": " + ", ".join(words)


def earth_left_deg_s(settings: ProcedureSettings) -> float | None:
    """Return the limit of the Earth's rate left by a tilted axis, deg/s; None where that rate was not taken out."""
    if not isinstance(settings, SweepSettings) or settings.earth is Earth.BIAS or settings.station.latitude_deg is None:
        return None
    level_deg_s = EARTH_DEG_S * math.cos(math.radians(settings.station.latitude_deg))
    return level_deg_s * math.sin(math.radians(settings.axis_tilt_deg))
