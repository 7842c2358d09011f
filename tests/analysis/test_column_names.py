"""Units as people write them, against a table by hand."""

from __future__ import annotations

import math
from itertools import product

import pytest

from vcfbench.analysis.column_names import Kind, column_name, unit_of

PREFIXES = {"": 1.0, "k": 1e3, "m": 1e-3, "u": 1e-6, "\u00b5": 1e-6, "n": 1e-9}
ANGLES = {"deg": 1.0, "\u00b0": 1.0, "rad": 180.0 / math.pi, "arcsec": 1.0 / 3600.0, "rev": 360.0, "turns": 360.0}
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "hour": 3600.0}
OTHERS = {
    Kind.COUNT: ("LSB", "counts", "digits", "raw", "ADC"),
    Kind.TEMPERATURE: ("degC", "\u00b0C", "C", "deg C", "Celsius", "K", "kelvin"),
    Kind.OTHER: ("g", "m/s^2", "mA", "Hz", "hPa", "%", "ohm", "deg", "rad", "mrad"),
}


@pytest.mark.parametrize(("prefix", "angle"), list(product(PREFIXES, ANGLES)))
def test_rates_are_angles_over_times_in_any_spelling(prefix: str, angle: str) -> None:
    for time, seconds in TIMES.items():
        for word in ("/", " / ", "_per_", "per", "_"):
            found = unit_of(f"{prefix}{angle}{word}{time}")
            assert found is not None
            assert (found.kind, found.factor) == (Kind.RATE, pytest.approx(PREFIXES[prefix] * ANGLES[angle] / seconds))
        for ending in ("-1", "^-1", "^(-1)", "**-1"):
            found = unit_of(f"{prefix}{angle} {time}{ending}")
            assert found is not None
            assert (found.kind, found.factor) == (Kind.RATE, pytest.approx(PREFIXES[prefix] * ANGLES[angle] / seconds))


def test_other_units_have_their_kinds_and_factors() -> None:
    rows = [(time, Kind.TIME, factor) for time, factor in TIMES.items()]
    rows += [(f"{p}{v}", Kind.VOLTAGE, by) for p, by in PREFIXES.items() for v in ("V", "volts", "V dc")]
    short = {"dps": 1.0, "dph": 1.0 / 3600.0, "rpm": 6.0}
    rows += [(f"{p}{word}", Kind.RATE, by * short[word]) for p, by in PREFIXES.items() for word in short]
    rows += [(word, kind, 1.0) for kind, words in OTHERS.items() for word in words]
    rows += [(word, Kind.TEMPERATURE, 5.0 / 9.0) for word in ("degF", "\u00b0F", "F")]
    for written, kind, factor in rows:
        found = unit_of(written)
        assert found is not None, written
        assert (found.written, found.kind, found.factor) == (written, kind, pytest.approx(factor)), written
    for written in ("MV", "Mdps", "furlong", "", "V/V", "deg/s/V"):
        assert unit_of(written) is None


@pytest.mark.parametrize(
    ("written", "base", "unit"),
    [
        *((f"{base}_{unit}", base, unit) for base in ("output", "gyro_z") for unit in ("mV", "V", "dps")),
        *((f"temp_{unit}", "temp", unit) for unit in ("c", "K", "degC", "F")),
        *((f"case {unit}", "case", unit) for unit in ("degC", "celsius")),
        *((f"gain_{word}", f"gain_{word}", None) for word in ("c", "k", "f", "s", "h", "g", "a")),
        *((f"time_{unit}", "time", unit) for unit in ("s", "ms", "h", "min")),
        *((f"wx_{unit}", f"wx_{unit}", None) for unit in ("s", "h", "sec")),
    ],
)
def test_an_end_is_a_unit_where_it_is_no_part_of_the_name(written: str, base: str, unit: str | None) -> None:
    found = column_name(written)
    assert (found.base, found.unit and found.unit.written) == (base, unit)
