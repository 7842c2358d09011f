"""What temperature, mounting and phases do to values, as far as a bench file knows them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from tests.procedures.fakes import make_settings
from vcfbench.analysis.budget import Source, evaluate
from vcfbench.instructions.schedule import Earth
from vcfbench.procedures.virtual_coriolis.budget import zeros_apart
from vcfbench.station.settings import Sources, Station
from vcfbench.uncertainty.phases import PhaseErrors
from vcfbench.uncertainty.statement import Circumstances, Statement, stated_value, statement
from vcfbench.uncertainty.windows import Flicker
from vcfbench.values.sources import CARRIER_PHASE, DEMODULATOR_PHASE, MISALIGNMENT, TEMPERATURE, WARM_UP

KNOWN = Sources(
    carrier_phase_deg=2.0,
    demodulator_phase_deg=1.0,
    k_vc_ppm_carrier_deg=-300.0,
    k_vc_ppm_demodulator_deg=20.0,
    scale_factor_ppm_demodulator_deg=150.0,
    bias_deg_s_demodulator_deg=0.5,
    scale_factor_ppm_k=-100.0,
    bias_deg_h_k=36.0,
    temperature_k=1.0,
    warm_up_k=4.0,
    warm_up_time_s=100.0,
    misalignment_deg=2.0,
)


def test_phase_at_limit_has_largest_effect_with_cosine() -> None:
    phases = PhaseErrors.of(KNOWN)
    carrier = -(2.0 * 300e-6 + 1.0 - math.cos(math.radians(2.0)))
    demodulator = 150e-6 + 1.0 - math.cos(math.radians(1.0))
    assert phases.effect("k_vc", {CARRIER_PHASE: 2.0}) == pytest.approx(carrier)
    assert phases.effect("k_vc", {DEMODULATOR_PHASE: 1.0}) == pytest.approx(20e-6)
    assert phases.effect("scale_factor", {DEMODULATOR_PHASE: 1.0}) == pytest.approx(demodulator)
    assert phases.effect("bias_deg_s", {DEMODULATOR_PHASE: 1.0}) == 0.5
    u_carrier, u_demodulator = (limit_deg / math.sqrt(3.0) for limit_deg in (2.0, 1.0))
    by_carrier = abs(carrier) / 2.0
    assert phases.u("k_vc") == pytest.approx(
        {CARRIER_PHASE: by_carrier * u_carrier, DEMODULATOR_PHASE: 20e-6 * u_demodulator}
    )
    assert phases.u("scale_factor") == pytest.approx({DEMODULATOR_PHASE: demodulator * u_demodulator})
    assert phases.u("self_calibrated") == pytest.approx(
        {CARRIER_PHASE: by_carrier * u_carrier, DEMODULATOR_PHASE: (demodulator + 20e-6) * u_demodulator}
    )
    assert phases.u("bias_deg_s") == pytest.approx({DEMODULATOR_PHASE: 0.5 * u_demodulator})
    assert PhaseErrors.of(Sources()).sources == ()
    assert {phases.effect(value, {}) for value in phases.per_deg} == {0.0}
    without = PhaseErrors.of(Sources(demodulator_phase_deg=1.0))
    assert without.effect("bias_deg_s", {DEMODULATOR_PHASE: 1.0}) == 0.0


def circumstances(known: Sources) -> Circumstances:
    settings = make_settings(warm_up_s=200.0)
    return Circumstances.of(replace(settings, station=replace(settings.station, sources=known)))


def test_warm_up_counts_from_the_first_window() -> None:
    sources = {source.name: source.u * math.sqrt(3.0) for source in circumstances(KNOWN).sources}
    start_up_s = make_settings(warm_up_s=200.0).start_up_s
    assert sources == pytest.approx(
        {
            "temperature": 1.0,
            "warm-up": 4.0 * math.exp(-start_up_s / 100.0),
            "misalignment": 1.0 - math.cos(math.radians(2.0)),
            CARRIER_PHASE: 2.0,
            DEMODULATOR_PHASE: 1.0,
        }
    )
    assert circumstances(Sources()).sources == ()


VALUES = {
    "virtual.k_vc": 150.0,
    "turntable.scale_factor": -0.0125,
    "virtual.scale_factor": -0.0127,
    "turntable.bias": -0.042,
    "virtual.bias": 0.001,
    "virtual.bias_deg_s": -0.08,
    "bias_difference_v": 0.043,
}


def test_value_holds_for_stated_temperature_mounting_and_phases() -> None:
    """A kelvin, a tilt of 1e-3 and a degree of the demodulator's phase, by hand."""
    around = circumstances(KNOWN)
    q = {TEMPERATURE: 0.6, WARM_UP: 0.4, MISALIGNMENT: 1e-3, DEMODULATOR_PHASE: 1.0}
    found = {**around.applied(VALUES, q), **zeros_apart(around, VALUES, q)}
    scale, k_vc = 1.0 + around.phases.effect("scale_factor", q), 1.0 + around.phases.effect("k_vc", q)
    moved = 0.043 * (1.0 / (k_vc * scale * (1.0 - 100e-6 * 0.6)) - 1.0)
    drifted = 0.01 * 1.0 + 0.5
    by_phase = sum(around.phases.per_deg[each][DEMODULATOR_PHASE] for each in ("k_vc", "scale_factor"))
    also = 0.043 / 0.0127 * (100e-6 * 0.6 + abs(by_phase))  # the same sources, so that both add up
    assert found == pytest.approx(
        {
            "virtual.k_vc": 150.0 / 1.001 / k_vc,
            "turntable.scale_factor": -0.0125 * 1.001 / (1.0 - 100e-6) / scale,
            "virtual.scale_factor": -0.0127 * 1.001 / (1.0 - 100e-6) / scale,
            "turntable.bias": -0.042 + drifted * 0.0125,
            "virtual.bias": 0.001 + (drifted + also) * 0.0127,
            "virtual.bias_deg_s": (-0.08 - drifted) / 1.001 - also,
            "bias_difference_v": 0.043 + moved,
        }
    )
    still = {**around.applied(VALUES, {}), **zeros_apart(around, VALUES, {})}
    assert still == pytest.approx(VALUES)  # nothing is away from what they are stated for
    one = {"scale_factor": -0.0125, "bias": -0.042}
    assert around.applied(one, q)["bias"] == pytest.approx(-0.042 + drifted * 0.0125)


def test_misalignment_leaves_difference_of_zeros_unchanged() -> None:
    tilted = circumstances(Sources(misalignment_deg=2.0))
    assert zeros_apart(tilted, VALUES, {MISALIGNMENT: 1e-3}) == {}
    assert circumstances(Sources()).applied(VALUES, {}) is VALUES


def stated(known: Sources, u: float = 1.0, **more: Any) -> Statement:
    """The statement of one value of one source, a half of which is the difference of two."""
    asked = make_settings(station=Station(sources=known))
    source, meaning = Source("readings", 3.0, u, "V", 8.0), {"value": ("V", "of the record"), "half": ("V", "")}
    return statement(
        asked, [source], lambda q: {"value": q["readings"], "half": -0.5 * q["readings"]}, {}, meaning, **more
    )


AGES = Sources(meter_age_days=90.0, meter_age_from="today", v_vc_meter_age_days=10.0, v_vc_meter_age_from="its label")
METER_SAID = "multimeter: 90 days after calibration (today)"
RANGES_SAID = "ranges of the generator: not known, the worst for each value are assumed"


@pytest.mark.parametrize(
    ("known", "more", "said"),
    [
        ({}, {}, []),
        ({}, {"levels_by": "V_Vc meter"}, ["meter on V_Vc: 10 days after calibration (its label)"]),
        ({"generator_gain": 0.1}, {"levels_by": "generator"}, [RANGES_SAID]),
        (
            {"generator_gain": 0.1},
            {"levels_by": "V_Vc meter"},
            ["meter on V_Vc: 10 days after calibration (its label)"],
        ),
        ({"generator_gain": 0.1, "generator_ranges_v": (1.0,)}, {"levels_by": "generator"}, []),
        ({}, {"levels_by": "generator"}, []),
        ({}, {"flicker": Flicker(5.25, 9.0, "blocks")}, ["flicker: B 5.25 deg/h (blocks)"]),
        (
            {"assumed": {"table_rate": "the worst table", "k_vc_drift_ppm_per_year": "not said"}},
            {},
            ["the worst table"],
        ),
    ],
)
def test_what_is_taken_for_known_says_where_it_is_from(
    known: dict[str, Any], more: dict[str, Any], said: list[str]
) -> None:
    assert stated(replace(AGES, **known), **more).known_from == (METER_SAID, *said)


def test_statement_has_values_correlation_and_e_n() -> None:
    made = stated(Sources(), difference="half")
    value, half = made.values
    assert (value.value, value.u, value.dof, value.of) == (3.0, 1.0, 8.0, "of the record")
    assert value.u95 == pytest.approx(2.306, abs=1e-3)
    (line,) = half.parts
    assert (line.source, line.rectangular, line.u_source, line.unit, line.dof) == ("readings", False, 1.0, "V", 8.0)
    assert (line.sensitivity, line.u, line.share) == (-0.5, 0.5, 1.0)
    assert np.array(made.correlation) == pytest.approx(np.array([[1.0, -1.0], [-1.0, 1.0]]))
    assert made.e_n == pytest.approx(1.5 / half.u95)
    exact = stated(Sources(), u=0.0, difference="half")
    assert (exact.e_n, exact.correlation) == (None, ((1.0, 0.0), (0.0, 1.0)))
    assert made.value("half") is half
    with pytest.raises(KeyError):
        made.value("third")


@pytest.mark.parametrize(("latitude_deg", "earth"), [(None, "with Earth's rate"), (60.0, "without Earth's rate")])
def test_a_value_lacks_what_nobody_knows_of_its_kind(latitude_deg: float | None, earth: str) -> None:
    """And a bias says whether the Earth's rate is in it."""
    asked = make_settings(
        earth=Earth.RATE, station=Station(latitude_deg=latitude_deg, sources=Sources(meter_gain=1e-5))
    )
    meanings = {"table.bias": ("V", "output at rest, with Earth's rate"), "table.scale_factor": ("V/(deg/s)", "slope")}
    made = statement(asked, [Source("x", 1.0, 0.1)], lambda q: dict.fromkeys(meanings, q["x"]), {}, meanings)
    known = asked.station.sources
    assert [each.missing for each in made.values] == [known.missing("bias"), known.missing("scale_factor")]
    assert made.missing == tuple(dict.fromkeys((*known.missing("bias"), *known.missing("scale_factor"))))
    assert not made.complete
    assert made.values[0].of == f"output at rest, {earth}"
    assert ("Earth's rate: contained in the bias" in made.not_in_u) == (latitude_deg is None)


def test_a_value_that_no_contribution_names_lacks_them_all() -> None:
    """Less knowledge never gives a smaller U95, of a new value either."""
    known = Sources(meter_gain=1e-5)
    every = tuple(gap.name for gap in known.gaps())
    assert known.missing("bias_of_range") == every
    assert set(known.missing("asymmetry")) < set(every)
    assert known.missing("scale_factor_error_percent") == ()


@pytest.mark.parametrize(("share", "factor"), [(0.049, 1.96), (0.051, None), (1.0, 0.95 * math.sqrt(3.0))])
def test_a_limit_that_prevails_has_its_own_factor(share: float, factor: float | None) -> None:
    sources = [Source("readings", 0.0, math.sqrt(1.0 - share)), Source.within("table", 0.0, math.sqrt(3.0 * share))]
    budget = evaluate(sources, lambda q: {"value": q["readings"] + q["table"]})
    made = stated_value(budget.results[0], budget, "V", "")
    student = budget.results[0].coverage_factor
    assert made.coverage_factor == (pytest.approx(factor, rel=1e-3) if factor else made.coverage_factor)
    assert (made.coverage_factor == pytest.approx(student, rel=1e-9)) == (share < 0.05)
    assert made.u95 == pytest.approx(made.coverage_factor)
    assert len(made.parts) == (1 if share == 1.0 else 2)  # what moves nothing is not told
