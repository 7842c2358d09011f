"""Single parts of uncertainties against what they must be: by hand, or by moving what they are of."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.devices.test_split_sign import far_records
from tests.procedures.fakes import make_settings
from vcfbench.analysis.chopped import CHOPPED, Block, BlockNoise
from vcfbench.procedures import bandwidth
from vcfbench.procedures.health.found import _feedthrough
from vcfbench.procedures.null_comparison.blocks import bias_at_rest
from vcfbench.procedures.power.results import PowerSettings, _imbalance_v, _step_v, _three
from vcfbench.records.device_values import Measured
from vcfbench.records.schema import Point
from vcfbench.station.settings import Sources, Station
from vcfbench.uncertainty.oscilloscope import TIME_BASE
from vcfbench.uncertainty.over_temperature import Cause, Temperatures, relative_over_temperature
from vcfbench.uncertainty.windows import window_times
from vcfbench.values.value import Measurand, UncertaintyPart

if TYPE_CHECKING:
    from pathlib import Path

K = -0.0125


def part(found: Any, source: str) -> float:
    """Return the one part whose source begins so, 0 where there is none."""
    own = [each.u for each in found.parts if each.source.startswith(source)]
    assert len(own) <= 1, source
    return abs(sum(own))


def test_flicker_of_bias_is_integral_of_density() -> None:
    """B^2/(pi f), one-sided, through the mean of the zeros less that of the horizon."""
    known = Sources(bias_instability_deg_h=5.57, horizon_h=24.0)
    asked = make_settings(station=Station(meter_resolution_v=1e-6, sources=known))
    points = [Point(1, rate, 0.0, K * rate, 1e-4, 10) for rate in (0.0, 20.0, -20.0, -20.0, 20.0, 0.0) * 2]
    noise = BlockNoise(1e-5, 0.0, 0.0, ((1e-10, 0.0), (0.0, 1e-10)), 10.0)
    found = bias_at_rest(asked, points, 1, noise, K)
    places = [place for place, point in enumerate(points) if point.rate_deg_s == 0.0]
    begin, end = (each[places] for each in window_times(asked, points))
    frequency, middle = np.logspace(-8, 1, 100_001), 0.5 * (begin[0] + end[-1])
    turned = np.exp(-2j * math.pi * frequency[:, None] * (0.5 * (begin + end) - middle))
    gain = (turned * np.sinc(frequency[:, None] * (end - begin))).mean(axis=1) - np.sinc(frequency * 86_400.0)
    integral = float(np.trapezoid(np.abs(gain) ** 2, np.log(frequency)))
    expected = abs(K) * 5.57 / 3600.0 * math.sqrt(integral / math.pi)
    assert part(found, "flicker") == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("split_hz", [24.8, -24.8])
def test_a_feed_through_has_the_error_of_the_modes_shares(split_hz: float) -> None:
    modes, share, far = far_records(split_hz, 3e-4)
    through = [_feedthrough(far, modes, Measured(value=share + moved, u=0.01), 1.0).value for moved in (0.0, 0.01)]
    found = _feedthrough(far, modes, Measured(value=share, u=0.01), 1.0)
    assert part(found, "in-phase share") == pytest.approx(abs(through[1] - through[0]), rel=1e-6)
    assert part(found, "the same at all") == pytest.approx(0.05 / math.sqrt(3.0) * abs(found.value))


def test_a_sweep_knows_its_frequencies_by_the_generators_time_base() -> None:
    pairs = {
        "split_hz": (24.8, 1e-4),
        "q": (1224.0, 0.2),
        "plus_3_db_hz": (13.0, 1e-4),
        "peak_hz": (24.7, 1e-4),
        "peak_gain": (9.0, 1e-3),
        "minus_3_db_hz": (38.0, 1e-4),
    }
    values = np.array([1.0])
    band: Any = SimpleNamespace(
        **pairs,
        **dict.fromkeys(("frequency_hz", "gain", "u_gain", "residual"), values),
        static_gain=1.0,
        in_phase_share=(0.1, 0.01),
        chi_square=1.0,
        dof=1,
        noise_dof=100.0,
    )
    found = bandwidth._bandwidth(band, 3488.9, 0.05, (), lacking=False)
    for name, (value, u) in pairs.items():
        measured: Measurand = getattr(found, name)
        of_base = 0.0 if name == "peak_gain" else 20e-6 / math.sqrt(3.0) * value
        of_drive = 0.05 / 3488.9 * value if name == "q" else 0.0
        assert {part.source: part.u for part in measured.parts if part.u} == pytest.approx(
            {key: each for key, each in (("noise", u), ("time base", of_base), ("drive frequency", of_drive)) if each}
        )
        assert measured.u == pytest.approx(math.hypot(u, of_base, of_drive))


# --- temperature -------------------------------------------------------------------------------------------------

AT_C = np.array([0.0, 20.0, 45.0, 60.0, 45.0, 20.0])
VALUES = np.array([5.0, 5.2, 5.31, 5.36, 5.33, 5.18])


def fitted(at_c: np.ndarray, values: np.ndarray, **known: float) -> Any:
    temperatures = Temperatures(at_c, [True] * at_c.size, 25.0, **known)
    cause = Cause("noise", np.diag(np.full(at_c.size, 1e-6)))
    return relative_over_temperature(temperatures, list(values), [cause], "V")


def estimates(at_c: np.ndarray, values: np.ndarray = VALUES) -> np.ndarray:
    found = fitted(at_c, values)
    return np.array([found.value.value, found.tc.value, found.tc2.value])


def test_common_temperature_error_moves_a_parabola() -> None:
    found = fitted(AT_C, VALUES, u_alike_k=0.3)
    moved = 0.5 * (estimates(AT_C + 0.01) - estimates(AT_C - 0.01)) / 0.01
    for number, each in enumerate((found.value, found.tc, found.tc2)):
        expected = 0.3 * abs(moved[number])
        assert part(each, "temperature, the same at all") == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_single_temperature_errors_move_a_parabola_by_its_slope() -> None:
    """An error of one temperature is, to first order, one of its value by the slope of the parabola there."""
    found = fitted(AT_C, VALUES, u_each_k=0.2)
    off = AT_C - 25.0
    slopes = 1e-6 * found.value.value * (found.tc.value + 2.0 * found.tc2.value * off)
    for number, each in enumerate((found.value, found.tc, found.tc2)):
        moves = [
            1e4 * (estimates(AT_C, VALUES + 0.2e-4 * slope * row)[number] - estimates(AT_C)[number])
            for slope, row in zip(slopes, np.eye(AT_C.size), strict=True)
        ]
        assert part(each, "temperatures, each by itself") == pytest.approx(float(np.linalg.norm(moves)), rel=1e-5)


def test_noise_of_the_values_goes_through_the_parabola() -> None:
    found = fitted(AT_C, VALUES)
    for number, each in enumerate((found.value, found.tc, found.tc2)):
        moves = [estimates(AT_C, VALUES + 1e-6 * row)[number] - estimates(AT_C)[number] for row in np.eye(AT_C.size)]
        assert part(each, "noise") == pytest.approx(1e3 * float(np.linalg.norm(moves)), rel=1e-5)


AT_RUN_C = np.array([10.0, 30.0, 50.0, 30.0])


@pytest.mark.exhaustive
@pytest.mark.parametrize("by", few(["table", "v-vc"], "v-vc"))
def test_a_run_over_temperature_states_the_parts_of_its_instruments(by: str, tmp_path: Path) -> None:
    bench = vcfbench.load_bench("lab")
    bench = structs.replace(bench, uncertainty=structs.replace(bench.uncertainty, misalignment_deg=0.5))
    settings = {
        "temperatures_c": AT_RUN_C.tolist(),
        "reference_c": 25.0,
        "cycles": 1,
        "by": by,
        "u_temperature_k": 0.4,
        "bias_instability_deg_h": 5.57,
        "scale_factor_v_per_deg_s": K,
    }
    found = vcfbench.run("temperature", bench, seed=3, settings=settings, runs=tmp_path).results
    slope, root = abs(found.scale_factor.value), math.sqrt(3.0)
    moves = 2.0 * found.scale_factor_tc2.value - 1e-6 * found.scale_factor_tc.value**2  # it is a ratio
    by_hand = {
        "scale_factor": {
            "meter gain": 35e-6 / 4.0 * slope,  # User's Guide p. 216: a year, four sigmas (p. 227)
            "table rate": 1e-5 / root * slope if by == "table" else 0.0,
            "misalignment": (1.0 - math.cos(math.radians(0.5))) / root * slope if by == "table" else 0.0,
            "V_Vc gain": 0.0 if by == "table" else 0.02 / root * slope,  # 2 %, maker's data sheet
            "temperature, the same at all": 0.4e-6 * abs(found.scale_factor_tc.value) * slope,
        },
        "bias": {
            "meter offset": 50e-6 / 4.0 / (slope if by == "table" else abs(K)),
            "temperature, the same at all": 0.4 * abs(found.bias_tc.value),
            "wander (flicker)": math.sqrt(2.0 * math.log(2.0) / math.pi) * 5.57 / 3600.0,
        },
        "frequency": {
            "time base": TIME_BASE / root * found.frequency.value,
            "temperature, the same at all": 0.4e-6 * abs(found.frequency_tc.value) * found.frequency.value,
        },
        "scale_factor_tc": {"temperature, the same at all": 0.4 * abs(moves)},
    }
    for name, parts in by_hand.items():
        for source, u in parts.items():
            assert part(getattr(found, name), source) == pytest.approx(u, rel=2e-3), f"{name}: {source}"
    # Readings: those of the points, through the parabola at the reference
    first, making = found.points[0], np.linalg.pinv(np.vander(AT_RUN_C - 25.0, 3, increasing=True))
    through = float(np.linalg.norm(making[0]))
    assert part(found.scale_factor, "readings and flicker") == pytest.approx(first.u_slope * through, rel=1e-3)
    assert part(found.bias, "readings") == pytest.approx(first.u_bias_deg_s * through, rel=1e-3)
    of_records = through * math.sqrt(np.mean([each.u_frequency_hz**2 for each in found.points]))
    assert math.hypot(part(found.frequency, "records"), part(found.frequency, "digits")) == pytest.approx(
        of_records,
        rel=0.3,  # digits err alike where the frequency is the same
    )
    # White noise of n windows: half the difference of two levels, each of two of them; and two zeros
    level = 200.0 if by == "table" else 200.0 / 150.0
    volts_per_deg_s = slope if by == "table" else abs(K)
    assert 2.0 * level * first.u_slope == pytest.approx(math.sqrt(2.0) * volts_per_deg_s * first.u_bias_deg_s, rel=0.1)
    for name in ("scale_factor_tc", "bias_tc", "frequency_tc"):
        held = {each.source for each in getattr(found, name).parts}
        assert not held & {"meter gain", "meter offset", "time base", "table rate"}


# --- power -------------------------------------------------------------------------------------------------------

RAISED, LOWERED, STEP_V = 40.0, 100.0, 0.2
NOISE = ((4e-6, 1e-6), (1e-6, 4e-6))


def of_blocks(lowered: float, raised: float) -> list[Block]:
    """Return two blocks of a value that goes by so much a volt below and above its level."""
    moved = {0: 0.0, 1: STEP_V * raised, -1: -STEP_V * lowered}
    return [Block(tuple(1.0 + moved[sign] for sign in CHOPPED))] * 2


def three(imbalance_v: float = 0.0, u_v: float = 0.0, blocks: Any = None) -> tuple[Measurand, ...]:
    noise: Any = SimpleNamespace(covariance_v2=NOISE, dof=10.0)
    step = STEP_V, [UncertaintyPart("step: gain", 0.01)]
    return _three(blocks or of_blocks(LOWERED, RAISED), noise, step, (imbalance_v, u_v), ("1/V", 1.0))


@pytest.mark.parametrize("imbalance_v", [-0.05, 0.0, 0.05])
def test_the_parts_of_what_rails_do(imbalance_v: float) -> None:
    both, lowered, raised = found = three(imbalance_v, 0.01)
    assert both.value == pytest.approx(0.5 * (lowered.value + raised.value))
    # Noise: by moving each difference of the blocks
    moved = []
    for place in (1, -1):
        outputs = [
            [each + (1e-3 if sign == place else 0.0) for sign, each in zip(CHOPPED, b.outputs_v, strict=True)]
            for b in of_blocks(LOWERED, RAISED)
        ]
        again = three(imbalance_v, 0.01, [Block(tuple(each)) for each in outputs])
        moved.append([(new.value - old.value) / 1e-3 for new, old in zip(again, found, strict=True)])
    by = np.array(moved)
    expected = np.sqrt(np.diag(by.T @ np.array(NOISE) @ by) / 2.0)
    for each, u in zip(found, expected, strict=True):
        assert part(each, "readings and flicker") == pytest.approx(u, rel=1e-6)
        assert part(each, "step: gain") == pytest.approx(0.01 * abs(each.value))
    below = 0.5 * math.erfc(-imbalance_v / 0.01 / math.sqrt(2.0))
    kink = abs(lowered.value - raised.value) * 0.01 / STEP_V
    for each, share in zip(found, (0.5, math.sqrt(below), math.sqrt(1.0 - below)), strict=True):
        assert part(each, "imbalance of the rails") == pytest.approx(share * kink)


@pytest.mark.exhaustive
def test_imbalance_of_rails_moves_both_halves_as_drawn() -> None:
    """Rails that are of one size as read back, within 4 mV: what is read is a drive by the weaker of them."""
    drawn = np.random.default_rng(1).normal(0.0, 0.004, 1500)
    errors = np.array([[each.value for each in three(float(off_v))] for off_v in drawn])
    stated = [part(each, "imbalance of the rails") for each in three(0.0, 0.004)]
    assert np.sqrt(np.mean((errors - [each.value for each in three()]) ** 2, axis=0)) == pytest.approx(stated, rel=0.1)


def test_rail_step_is_half_of_read_back_change() -> None:
    asked = PowerSettings(station=Station(meter_resolution_v=1e-5))
    outputs = {each.rail: each.output for each in asked.rails}
    states = [
        {outputs["positive"]: 10.0 + STEP_V * sign + 0.03, outputs["negative"]: -10.0 - STEP_V * sign}
        for sign in CHOPPED
    ]
    for rails in ("positive", "negative", "both"):
        step_v, parts = _step_v(asked, rails, [states])
        assert step_v == pytest.approx(STEP_V)
        (resolution,) = [each for each in parts if "resolution" in each.source]
        assert resolution.u == pytest.approx(1.5e-3 / math.sqrt(24.0) / STEP_V)  # a digit is 1.5 mV; two, half
    assert _imbalance_v(asked, "positive", [states])[0] == pytest.approx(0.03)
    assert _imbalance_v(asked, "negative", [states])[0] == pytest.approx(-0.03)
    assert _imbalance_v(asked, "both", [states]) == (0.0, 0.0)
    assert _imbalance_v(asked, "positive", [states])[1] == pytest.approx(1.5e-3 / math.sqrt(6.0))
