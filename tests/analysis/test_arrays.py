"""What somebody hands in as numbers is taken as such, or refused; nothing becomes another number silently."""

from __future__ import annotations

import math
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

import vcfbench
from vcfbench.errors import ConfigError

RATES, OUTPUTS = np.array([-100.0, 0.0, 100.0]), np.array([1.25, 0.0, -1.25])


class Quantity:
    """A value with a unit, as astropy (`unit`, `value`) and pint (`units`, `magnitude`) have them."""

    def __init__(self, values: Any, unit: str, library: str) -> None:
        setattr(self, *{"astropy": ("unit", unit), "pint": ("units", unit)}[library])
        setattr(self, {"astropy": "value", "pint": "magnitude"}[library], values)
        self._of, self._values, self._library = unit, values, library

    def to(self, unit: str) -> Quantity:
        factors = {("rad/s", "deg/s"): 180.0 / np.pi, ("mV", "V"): 1e-3}
        return Quantity(factors[self._of, unit] * self._values, unit, self._library)

    def __array__(self, *_: Any, **__: Any) -> Any:
        return self._values


@pytest.mark.parametrize("library", ["astropy", "pint"])
def test_quantities_are_converted(library: str) -> None:
    rates, outputs = Quantity(np.radians(RATES), "rad/s", library), Quantity(1e3 * OUTPUTS, "mV", library)
    assert vcfbench.characterise(rates, outputs).line.scale_factor == pytest.approx(-0.0125)
    with pytest.raises(ConfigError, match="outputs: expected a unit such as V, got furlong"):
        vcfbench.characterise(RATES, Quantity(OUTPUTS, "furlong", library))
    with pytest.raises(ConfigError, match="expected plain numbers in the unit of the result, got rad/s"):
        vcfbench.allan_deviation(rates, 1.0)


@pytest.mark.parametrize(
    "given", [OUTPUTS.tolist(), OUTPUTS.reshape(-1, 1), OUTPUTS.reshape(1, -1), [Decimal(str(v)) for v in OUTPUTS]]
)
def test_columns_and_lists_are_rows(given: Any) -> None:
    assert vcfbench.characterise(RATES, given).line.scale_factor == pytest.approx(-0.0125)
    assert vcfbench.characterise(RATES, np.ma.masked_invalid(OUTPUTS)).line.scale_factor == pytest.approx(-0.0125)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (np.ma.masked_equal(OUTPUTS, 0.0), "outputs: 1 values are masked"),
        (OUTPUTS + 0.1j, "expected real numbers, got complex128"),
        (["1", "2", "3"], "expected real numbers, got <U1"),
        (np.arange(3).astype("datetime64[s]"), r"expected real numbers, got datetime64\[s\]"),
        (np.ones((3, 2)), r"expected one dimension, got the shape \(3, 2\)"),
        ([1.0, None, 2.0], "not a finite number"),
        ([1.0, "a", 2.0], "expected real numbers"),
    ],
)
def test_what_is_no_number_is_refused(given: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        vcfbench.characterise(RATES, given)
    if "masked" not in words and "finite" not in words:
        with pytest.raises(ConfigError, match=words):
            vcfbench.allan_deviation(given, 1.0)


@pytest.mark.parametrize("kind", ["Series", "DataFrame", "Index", "array"])
@pytest.mark.parametrize("dtype", ["float64", "float32", "Float64"])
def test_columns_of_pandas_are_taken_as_arrays(kind: str, dtype: str) -> None:
    pandas = pytest.importorskip("pandas", reason="pip install 'vcfbench[dev]'")

    def column(values: Any) -> Any:
        return getattr(pandas, kind)(values, dtype=dtype)

    found = vcfbench.characterise(column(RATES), column(OUTPUTS), column([1e-3, 2e-3, 1e-3]))
    assert found.line.scale_factor == pytest.approx(-0.0125)
    assert found.type_a is not None
    assert found.type_a.u_scale_factor == pytest.approx(1e-3 * math.sqrt(2.0) / 200.0)
    record = np.array([0.02, -0.01, 0.03, 0.0, -0.02])
    assert vcfbench.allan_deviation(column(record), 1.0)[0].deviation == pytest.approx(
        vcfbench.allan_deviation(record, 1.0)[0].deviation
    )


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (-1e-4, "expected uncertainties of 0 or more, got -0.0001"),
        ([1e-4, math.nan, 1e-4], "expected uncertainties of 0 or more, got nan"),
        ([1e-4, 1e-4, math.inf], "expected uncertainties of 0 or more, got inf"),
        ([1e-4, 1e-4], "expected one uncertainty, or 3, got 2"),
        ([], "expected one uncertainty, or 3, got 0"),
    ],
)
def test_impossible_uncertainties_are_refused(given: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        vcfbench.characterise(RATES, OUTPUTS, given)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95.0, -0.5, math.nan])
def test_an_impossible_confidence_is_refused(confidence: float) -> None:
    with pytest.raises(ConfigError, match="expected a confidence between 0 and 1"):
        vcfbench.allan_deviation([0.02, -0.01, 0.03], 1.0, confidence=confidence)


def test_a_record_that_cannot_be_overwritten_is_copied() -> None:
    record = np.array([0.02, -0.01, 0.03, 0.0, -0.02])
    expected = vcfbench.allan_deviation(record, 1.0)
    record.flags.writeable = False
    again = vcfbench.allan_deviation(record, 1.0, overwrite=True)
    assert [each.deviation for each in again] == pytest.approx([each.deviation for each in expected])
