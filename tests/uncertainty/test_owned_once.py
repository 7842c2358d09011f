"""An error of one owner that acts in two places is one error: of frequencies, of a bias as a rate, of temperatures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.procedures.test_kvc import LAB
from tests.procedures.test_online import FAST
from tests.procedures.test_self_calibration import aged
from vcfbench.devices.k_vc_since import with_temperature
from vcfbench.procedures.resonance import ResonanceSettings, resonance_characteristics
from vcfbench.uncertainty.measurand import difference, measurand, quotient
from vcfbench.uncertainty.oscilloscope import TIME_BASE, frequency_of
from vcfbench.values.value import UncertaintyPart

if TYPE_CHECKING:
    from pathlib import Path

SIZES = st.floats(1e-3, 1e3)
SIGNS = st.sampled_from([1.0, -1.0])


def part(found: Any, source: str) -> float:
    """Return the size of the one part of a source, 0 where there is none."""
    own = [abs(each.u) for each in found.parts if each.source == source]
    assert len(own) <= 1
    return sum(own)


@given(SIZES, SIZES, st.floats(1e-6, 1e-3))
def test_time_base_acts_on_frequency_difference(first_hz: float, second_hz: float, base: float) -> None:
    each = [
        measurand(hz, "Hz", [UncertaintyPart("records", 1e-3), UncertaintyPart("time base", base * hz, of="scope")])
        for hz in (first_hz, second_hz)
    ]
    found = difference(*each)
    assert found.value == first_hz - second_hz
    assert part(found, "time base") == pytest.approx(base * abs(first_hz - second_hz), abs=1e-12)
    assert found.u == pytest.approx(math.hypot(1e-3, 1e-3, base * (first_hz - second_hz)))


def test_instruments_of_two_owners_do_not_cancel() -> None:
    each = [measurand(1.0, "Hz", [UncertaintyPart("time base", 0.1, of=owner)]) for owner in ("one", "other")]
    assert difference(*each).u == pytest.approx(math.hypot(0.1, 0.1))
    assert quotient(*each, "").u == pytest.approx(math.hypot(0.1, 0.1))


@given(SIZES, SIZES, SIGNS, SIGNS, st.floats(1e-6, 1e-2))
def test_shared_gain_cancels_in_rate(bias: float, slope: float, sign: float, other: float, gain: float) -> None:
    of_bias = [UncertaintyPart("gain", bias * gain, of="meter"), UncertaintyPart("readings", 0.01 * bias)]
    of_slope = [UncertaintyPart("gain", slope * gain, of="meter"), UncertaintyPart("table", 0.02 * slope)]
    found = quotient(measurand(sign * bias, "V", of_bias), measurand(other * slope, "V/(deg/s)", of_slope), "deg/s")
    assert found.value == pytest.approx(sign * other * bias / slope)
    assert part(found, "gain") == pytest.approx(0.0, abs=1e-12 * abs(found.value))
    assert found.u == pytest.approx(abs(found.value) * math.hypot(0.01, 0.02))


@pytest.mark.exhaustive
def test_kept_in_phase_split_has_the_u_of_its_records(tmp_path: Path) -> None:
    """Drive less sense frequency, signed; a time base of 14 ppm makes 2 mHz of 147 Hz, not 50 mHz of 3.5 kHz twice."""
    override = {"sense_in_phase": {"frequency_hz": 3342.0}, "thermal": {"self_heating_k": 0.0}}
    settings: dict[str, Any] = {
        "warm_up_s": 0.0,
        "frequencies_hz": [2.0, 12.0, 18.0, 30.0, 40.0],
        "around_split": [0.75, 0.97, 1.0, 1.03, 1.2, 1.5],
        "record_samples": 256,
        "sense_ring_downs": 4,
        "drive_ring_downs": 3,
    }
    run = vcfbench.run("resonance", aged(LAB, **override), seed=2, settings=settings, runs=tmp_path)
    kept = resonance_characteristics(ResonanceSettings(), run.results)
    apart = kept.in_phase_split_hz
    assert apart is not None
    assert kept.split_hz is not None
    assert apart.value == pytest.approx(146.9, abs=0.2)
    by_base = [share.u for share in apart.shares if share.source == "time base"]
    assert by_base == [pytest.approx(TIME_BASE / math.sqrt(3.0) * 146.9, rel=0.01)]
    records = [share.u for share in apart.shares if share.source == "records"]
    assert apart.u == pytest.approx(math.hypot(*by_base, *records))
    assert kept.split_hz.shares[-1].u == pytest.approx(TIME_BASE / math.sqrt(3.0) * 24.8, rel=0.01)


@given(st.lists(st.floats(-1e4, -1.0) | st.floats(1.0, 1e4), min_size=3, max_size=9))
def test_split_has_time_base_error_of_split(values_hz: list[float]) -> None:
    found = frequency_of(values_hz, "scope")
    size_hz = abs(sum(values_hz) / len(values_hz))
    assert part(found, "time base") == pytest.approx(TIME_BASE / math.sqrt(3.0) * size_hz, rel=1e-6, abs=1e-9)


@given(SIZES, SIZES)
def test_one_temperature_acts_on_output_and_k_vc_together(of_output: float, of_k_vc: float) -> None:
    since = [UncertaintyPart("drift", 7.0), UncertaintyPart("temperature", of_k_vc)]
    found = {each.source: each.u for each in with_temperature({"temperature": of_output, "warm-up": 3.0}, since)}
    assert found == {"temperature": pytest.approx(of_output + of_k_vc), "warm-up": 3.0, "drift": 7.0}
    assert with_temperature({}, since) == since


@pytest.mark.parametrize("procedure", few(["self-calibration", "online"], "self-calibration"))
def test_temperature_without_table_is_one_part(procedure: str, tmp_path: Path) -> None:
    """Known within 1 K: the output by 104 ppm/K, K_Vc by 30 with a u of its own, both by the same kelvin."""
    override = {"temperature_k": 1.0, "scale_factor_ppm_k": 104.0}
    bench = vcfbench.load_bench("lab")

    bench = structs.replace(bench, uncertainty=structs.replace(bench.uncertainty, **override))
    own = {"self-calibration": {"health": False, "cycles": 1, "samples": 5}, "online": FAST}[procedure]
    run = vcfbench.run(procedure, bench, seed=2, settings={**own, "k_vc": "150"}, runs=tmp_path)
    found = run.results.scale_factor
    k_vc_ppm_k = 1e6 * part(found, "temperature") / abs(found.value) * math.sqrt(3.0) - 104.0
    assert 25.0 < k_vc_ppm_k < 45.0
    assert part(found, "warm-up") > 0.0
