"""Data sheets by model: limits of direct voltages, and the resolution of meters.

What no source at hand confirms says so in its `source`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from msgspec import Struct, field


class Accuracy(Struct, frozen=True):
    """The largest error that is promised: a part of the reading and a part of the range."""

    reading: float
    range: float

    def limit_v(self, reading_v: float, range_v: float) -> float:
        """Return the largest error of `reading_v` on the range of `range_v`, V."""
        return self.reading * abs(reading_v) + self.range * range_v


class VoltmeterSpecification(Struct, frozen=True):
    """Data sheet of a voltmeter for direct voltages.

    Args:
        model: its name.
        accuracy: by range, V, and days since its calibration.
        resolution: power-line cycles, rising, to the resolution of a reading as a part of the range.
        accuracy_source: where `accuracy` stands.
        resolution_source: where `resolution` stands.
        limit_sigmas: how many standard deviations of its specimens a limit of `accuracy` is, as the maker says; None
            where nothing is said: then any error within the limit is as likely as any other. The simulated
            instruments are drawn from the same.
        added_noise: power-line cycles to the largest noise that they add to a reading, as a part of the range and in
            V; the scatter of readings has it, so no uncertainty takes it from here.
        ohms: a year after calibration by range of resistance, ohm: by four wires, or by two without their leads.
        lead_ohm: what leads and input add by two wires at most.
    """

    model: str
    accuracy: Mapping[float, Mapping[int, Accuracy]]
    resolution: Mapping[float, float]
    accuracy_source: str
    resolution_source: str
    limit_sigmas: float | None = None
    added_noise: Mapping[float, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))
    ohms: Mapping[float, Accuracy] = field(default_factory=lambda: MappingProxyType({}))
    lead_ohm: float = 0.2

    def accuracy_of(self, range_v: float, age_days: float) -> Accuracy:
        """Return the limit of error on a range so long after a calibration.

        Raises:
            ValueError: the meter has no such range, or its data sheet nothing about an age so great.
        """
        if range_v not in self.accuracy:
            raise ValueError(f"a {self.model} has the ranges {_listed(self.accuracy)} V, not {range_v:g} V")
        if (promised := self.known_accuracy(range_v, age_days)) is None:
            raise ValueError(self.beyond(range_v))
        return promised

    def known_accuracy(self, range_v: float, age_days: float) -> Accuracy | None:
        """Return the limit of error on a range so long after a calibration; None: nothing is promised."""
        age = min((each for each in self.accuracy[range_v] if each >= age_days), default=None)
        return None if age is None else self.accuracy[range_v][age]

    def beyond(self, range_v: float) -> str:
        """Say up to which age something is promised of a range."""
        return f"at most {max(self.accuracy[range_v])} days after calibration: a {self.model} has no limits beyond"

    def standard_deviation(self, range_v: float, age_days: float) -> Accuracy:
        """Return the standard uncertainties of reading and range that the limits stand for, as parts of both.

        Raises:
            ValueError: as `accuracy_of`.
        """
        limit = self.accuracy_of(range_v, age_days)
        sigmas = math.sqrt(3.0) if self.limit_sigmas is None else self.limit_sigmas
        return Accuracy(limit.reading / sigmas, limit.range / sigmas)

    def resolution_v(self, range_v: float, nplc: float) -> float:
        """Return the resolution of a reading of `nplc` power-line cycles, V.

        Raises:
            ValueError: the meter has no such integration time.
        """
        if nplc not in self.resolution:
            raise ValueError(f"a {self.model} integrates over {_listed(self.resolution)} cycles, not {nplc:g}")
        return self.resolution[nplc] * range_v

    def added_noise_v(self, range_v: float, nplc: float) -> float:
        """Return the largest noise that is promised of an integration of `nplc` cycles, V; 0 where none is added."""
        part, volts = self.added_noise.get(nplc, (0.0, 0.0))
        return part * range_v + volts


class LevelSpecification(Struct, frozen=True):
    """Limits of a generator's direct voltage into an open circuit: a part of the setting, and volts.

    Any error within the limits is as likely as any other. `ranges_v` are the largest levels of its ranges, V, within
    each of which the errors are the same at all levels; `bits` are those of its converter over the range, both signs.
    """

    model: str
    setting: float
    offset_v: float
    source: str
    ranges_v: tuple[float, ...]
    bits: int
    ranges_source: str

    def limit_v(self, level_v: float) -> float:
        """Return the largest error of a level, V."""
        return self.setting * abs(level_v) + self.offset_v

    def range_of(self, level_v: float) -> float:
        """Return the range that a level is made on, by its largest level, V."""
        return min((each for each in self.ranges_v if each >= abs(level_v)), default=self.ranges_v[-1])


def _listed(values: Mapping[float, object]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _ages(**by_age: tuple[float, float]) -> Mapping[int, Accuracy]:
    """Return accuracies by days, given as percent of reading and of range, as data sheets print them."""
    days = {"day": 1, "quarter": 90, "year": 365, "two_years": 730}
    return MappingProxyType({days[age]: Accuracy(of[0] / 100.0, of[1] / 100.0) for age, of in by_age.items()})


_CLASSIC: Final = MappingProxyType({0.02: 1e-4, 0.2: 1e-5, 1.0: 3e-6, 10.0: 1e-6, 100.0: 3e-7})

HP_34401A: Final = VoltmeterSpecification(
    model="34401A",
    accuracy=MappingProxyType(
        {
            0.1: _ages(day=(0.0030, 0.0030), quarter=(0.0040, 0.0035), year=(0.0050, 0.0035)),
            1.0: _ages(day=(0.0020, 0.0006), quarter=(0.0030, 0.0007), year=(0.0040, 0.0007)),
            10.0: _ages(day=(0.0015, 0.0004), quarter=(0.0020, 0.0005), year=(0.0035, 0.0005)),
            100.0: _ages(day=(0.0020, 0.0006), quarter=(0.0035, 0.0006), year=(0.0045, 0.0006)),
            1000.0: _ages(day=(0.0020, 0.0006), quarter=(0.0035, 0.0010), year=(0.0045, 0.0010)),
        }
    ),
    resolution=_CLASSIC,
    accuracy_source="User's Guide 34401-90004 p. 216; the sums agree with the test limits of the Service Guide, p. 69",
    resolution_source="User's Guide 34401-90004 p. 54-57",
    limit_sigmas=4.0,  # "better than 4 sigma", User's Guide p. 227
    ohms=MappingProxyType(  # p. 216; 0.2 ohm more by two wires
        {
            1e2: Accuracy(1e-4, 4e-5),
            **dict.fromkeys((1e3, 1e4, 1e5, 1e6), Accuracy(1e-4, 1e-5)),
            1e7: Accuracy(4e-4, 1e-5),
            1e8: Accuracy(8e-3, 1e-4),
        }
    ),
    added_noise=MappingProxyType({0.02: (1e-4, 20e-6), 0.2: (1e-5, 20e-6), 1.0: (1e-5, 0.0)}),  # p. 217
)

_TRUEVOLT_SIGMAS: Final = 2.0
"""The data sheet of the series (5991-1983EN, 2022) calls its accuracies compliant to ISO/IEC 17025 for K = 2."""

KEYSIGHT_34461A: Final = VoltmeterSpecification(
    model="34461A",
    accuracy=MappingProxyType(
        {
            range_v: _ages(day=day, quarter=quarter, year=year, two_years=two_years)
            for range_v, day, quarter, year, two_years in (
                (0.1, (0.0030, 0.0030), (0.0040, 0.0035), (0.0050, 0.0035), (0.0065, 0.0035)),
                (1.0, (0.0020, 0.0006), (0.0030, 0.0007), (0.0040, 0.0007), (0.0055, 0.0007)),
                (10.0, (0.0015, 0.0004), (0.0020, 0.0005), (0.0035, 0.0005), (0.0050, 0.0005)),
                (100.0, (0.0020, 0.0006), (0.0035, 0.0006), (0.0045, 0.0006), (0.0060, 0.0006)),
                (1000.0, (0.0020, 0.0006), (0.0035, 0.0010), (0.0045, 0.0010), (0.0060, 0.0010)),
            )
        }
    ),
    resolution=_CLASSIC,
    accuracy_source="data sheet 5991-1983EN of 2022, as a table made from it has it",
    resolution_source="Truevolt Series Operating and Service Guide p. 452",
    limit_sigmas=_TRUEVOLT_SIGMAS,
)

KEYSIGHT_34465A: Final = VoltmeterSpecification(
    model="34465A",
    accuracy=MappingProxyType({10.0: _ages(year=(0.0030, 0.0004))}),
    resolution=MappingProxyType(
        {
            0.001: 30e-6,
            0.002: 15e-6,
            0.006: 6e-6,
            0.02: 3e-6,
            0.06: 1.5e-6,
            0.2: 7e-7,
            1.0: 3e-7,
            10.0: 1e-7,
            100.0: 3e-8,
        }
    ),
    accuracy_source="as generally quoted, unverified; the other ranges and ages were not at hand",
    resolution_source="users' drivers (QCoDeS), which follow the guide's table; the three fastest with option DIG",
    limit_sigmas=_TRUEVOLT_SIGMAS,
)

_KEITHLEY_DIGITS: Final = MappingProxyType({0.01: 1e-4, 0.1: 1e-5, 0.2: 1e-5, 1.0: 1e-6, 10.0: 1e-6})

KEITHLEY_2000: Final = VoltmeterSpecification(
    model="2000",
    accuracy=MappingProxyType(
        {
            0.1: _ages(day=(0.0030, 0.0030), quarter=(0.0040, 0.0035), year=(0.0050, 0.0035)),
            1.0: _ages(day=(0.0015, 0.0006), quarter=(0.0025, 0.0007), year=(0.0030, 0.0007)),
            10.0: _ages(day=(0.0015, 0.0004), quarter=(0.0020, 0.0005), year=(0.0030, 0.0005)),
            100.0: _ages(day=(0.0015, 0.0006), quarter=(0.0030, 0.0006), year=(0.0045, 0.0006)),
            1000.0: _ages(day=(0.0020, 0.0006), quarter=(0.0035, 0.0006), year=(0.0045, 0.0006)),
        }
    ),
    resolution=_KEITHLEY_DIGITS,
    accuracy_source="data sheet of the 2016 (Rev. D), a 2000 with more functions; of the 2000's own this table was "
    "not at hand",
    resolution_source="digits by power-line cycles in the same sheet: 6 1/2 at 10 and 1, 5 1/2 at 0.1 (and 0.2, "
    "between them), 4 1/2 at 0.01",
)

KEITHLEY_DMM6500: Final = VoltmeterSpecification(
    model="DMM6500",
    accuracy=MappingProxyType({10.0: _ages(year=(0.0025, 0.0005))}),
    resolution=MappingProxyType({0.01: 1e-5, 0.1: 1e-5, 0.2: 1e-5, 1.0: 1e-6, 10.0: 1e-6}),
    accuracy_source="Calibration and Adjustment Manual DMM6500-905-01 p. 2-4; other ranges and ages were not at hand",
    resolution_source="digits by power-line cycles in its data sheet p. 9 (resistance): 6 1/2 at 1, 5 1/2 at 0.1, 0.01 "
    "(and 0.2, between them)",
)

AGILENT_33220A: Final = LevelSpecification(
    model="33220A",
    setting=0.02,
    offset_v=4e-3,
    source="data sheet, unverified: 2 % of the setting and 2 mV into 50 ohm, hence 4 mV into an open circuit",
    ranges_v=(0.32, 1.0, 3.2, 10.0),
    bits=14,
    ranges_source="14 bits by the data sheet; ranges 10 dB apart, each with its own errors: unverified",
)

KEYSIGHT_33500B: Final = LevelSpecification(
    model="33500B",
    setting=0.01,
    offset_v=4e-3,
    source="data sheet, from memory and unverified: 1 % of the setting and 2 mV into 50 ohm, hence 4 mV into an open "
    "circuit; the 33600A's is the same",
    ranges_v=(0.32, 1.0, 3.2, 10.0),
    bits=16,
    ranges_source="16 bits by the data sheet; ranges 10 dB apart, each with its own errors: unverified",
)
