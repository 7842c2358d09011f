"""The values that results state, found by type in their order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from vcfbench.errors import ConfigError
from vcfbench.records.stated import BEYOND_SHEETS, left_out, stated, values_of
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.value import UncertaintyPart, Unstated, Value


@dataclass(frozen=True)
class Own:
    """Results of somebody's own procedure."""

    gain: Any
    by_axis: dict[str, Any]
    several: tuple[Any, ...]
    bias_v: float | None
    table: tuple[tuple[float, ...], ...] = ((1.0, 2.0),)


def test_values_are_found_in_fields_mappings_and_tuples_by_place() -> None:
    per_axis = {"x": measurand(0.01, "V", [UncertaintyPart("readings", 1e-3, 9.0)]), "y": Value("", 1.0, "V", 0.1)}
    several = (Value("drift", 3.0, "ppm", u=1.0, dof=3.0), 7.0)
    found = values_of(Own(Value("gain", np.float64(2.0), "V", u95=0.1), per_axis, several, 0.25))
    assert list(found) == ["gain", "by_axis.x", "by_axis.y", "drift", "bias_v"]
    assert type(found["gain"].value) is float
    assert [part.source for part in found["by_axis.x"].parts] == ["readings"]
    assert found["drift"].u95 == pytest.approx(3.182, abs=1e-3)
    assert (found["bias_v"].kind, found["bias_v"].u95) == ("bias", None)


def test_every_stated_uncertainty_lists_its_omissions() -> None:
    known = Own(Value("gain", 2.0, "V", u=0.1), {}, (), None)
    assert left_out(known) == (BEYOND_SHEETS,)
    assert left_out({"gain": {"value": 2.0, "unit": "V", "u": 0.1}, "holds_not": ["drift"]}) == (BEYOND_SHEETS, "drift")
    assert left_out(Own(Value("gain", 2.0, "V"), {}, (), None)) == ()


def test_impossible_number_and_double_name_are_refused() -> None:
    own = Own(Value("gain", 2.0), {}, (), None)
    assert list(stated(own))[-1] == Unstated("bias_v", "bias")
    with pytest.raises(ConfigError, match="two named gain"):
        values_of(Own(Value("gain", 2.0), {}, (Value("gain", 3.0),), None))


def test_old_stored_results_give_values_by_their_old_names() -> None:
    statement = {"values": [{"name": "scale_factor", "value": -0.0125, "unit": "V/(deg/s)", "u": 1e-6, "u95": 3e-6}]}
    before = {
        "scale_factor": {"value": -0.0125, "u": 1e-6, "unit": "V/(deg/s)", "u_fit": 2e-6},
        "bias": {"value": -0.04, "u": None, "unit": "V"},
        "drift": {"value": 1.0, "unit": "ppm", "u": 0.1, "expanded_u": 0.37, "missing": ["temperature"]},
        "scale_factor_v_per_deg_s": {"value": -0.0125, "u": None, "source": "the default"},
        "uncertainty": statement,
    }
    found = values_of(before)
    assert list(found) == ["scale_factor", "bias", "drift"]
    assert (found["scale_factor"].kind, found["scale_factor"].u95) == ("scale_factor", 3e-6)
    assert (found["drift"].u95, found["drift"].missing) == (0.37, ("temperature",))
