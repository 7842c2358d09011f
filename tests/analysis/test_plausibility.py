"""Faults of records and tables are told with their place; clean noise of every kind says nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack_tests.cells import few

from tests.analysis.noise import flicker
from vcfbench.analysis.plausibility import _parted, doubts_of_line, doubts_of_record
from vcfbench.analysis.regression import fit_line

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.analysis.arrays import Floats

SIZE = 5000
CLEAN: dict[str, Callable[[np.random.Generator], Floats]] = {
    "white": lambda r: r.standard_normal(SIZE),
    "flicker": lambda r: r.standard_normal(SIZE) + 0.3 * flicker(SIZE, r)[0],
    "walk": lambda r: r.standard_normal(SIZE) + np.cumsum(0.03 * r.standard_normal(SIZE)),
    "ramp": lambda r: r.standard_normal(SIZE) + 1e-3 * np.arange(SIZE),
    "mean of twenty": lambda r: np.convolve(r.standard_normal(SIZE + 19), np.ones(20) / 20.0, "valid"),
    "coarse": lambda r: np.round(r.standard_normal(SIZE) / 3.0) * 3.0,
    "counts": lambda r: np.round(5.0 * r.standard_normal(SIZE)),
    "warm-up": lambda r: r.standard_normal(SIZE) + 5.0 * np.exp(-np.arange(SIZE) / 1000.0),
    "walk alone": lambda r: 0.1 * np.cumsum(r.standard_normal(SIZE)),
    "vibration": lambda r: r.standard_normal(SIZE) + 0.5 * np.sin(0.37 * np.arange(SIZE)),
}


@pytest.mark.parametrize("kind", few(CLEAN, every=4))
def test_clean_noise_says_nothing(kind: str) -> None:
    found = [doubts_of_record(CLEAN[kind](np.random.default_rng(seed))) for seed in range(12)]
    assert found == [[]] * 12


def spoilt(begin: int, end: int, by: float) -> Floats:
    record = CLEAN["white"](np.random.default_rng(1))
    record[begin:end] += by
    return record


def stuck(begin: int, end: int) -> Floats:
    record = CLEAN["white"](np.random.default_rng(1))
    record[begin:end] = record[begin]
    return record


def noisy(begin: int, end: int, times: float) -> Floats:
    record = CLEAN["white"](np.random.default_rng(1))
    record[begin:end] *= times
    return record


FAULTS: dict[str, tuple[Floats, int | None, str]] = {
    "one reading": (spoilt(3000, 3001, 25.0), 3000, "far from their neighbours"),
    "2 s of turning": (spoilt(3000, 3200, 20.0), 3000, "a step, or motion"),
    "a step": (spoilt(3000, 5000, 2.0), 3000, "a step, or motion"),
    "some readings of another level": (spoilt(3000, 3002, 9.5), 3000, "a burst"),
    "a disturbance": (noisy(3000, 3400, 2.5), 3000, "a disturbance, or another range"),
    "a small step": (spoilt(3000, 5000, 1.2), 3000, "a step, or motion"),
    "stuck": (stuck(3000, 3060), 3000, "60 readings in a row are the same"),
    "half stuck": (stuck(2500, 5000), 2500, "2500 readings in a row are the same"),
    "clipped above": (np.minimum(spoilt(0, 0, 0.0), 2.0), None, "the largest, 2 deg/s: clipped"),
    "clipped below": (np.maximum(spoilt(0, 0, 0.0), -2.0), None, "the least, -2 deg/s: clipped"),
    "wrapped": ((spoilt(0, 5000, 7.5) + 10.0) % 20.0 - 10.0, None, "far from their neighbours"),
    "wrapped close by": ((spoilt(0, 5000, 3.0) + 5.0) % 10.0 - 5.0, None, "wrapped, or two states"),
    "held": (np.repeat(spoilt(0, 0, 0.0), 4), 0, "each value stands 4 times"),
    "not at rest": (spoilt(0, 5000, 80.0), 0, "that it was at rest"),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_fault_of_a_record_is_told_with_its_place(kind: str) -> None:
    record, row, words = FAULTS[kind]
    (found,) = [each for each in doubts_of_record(record) if words in each.words]
    assert row is None or abs(found.row - row) <= 100


RATES = np.array([-300.0, -250.0, -200.0, -100.0, 0.0, 100.0, 200.0, 250.0, 300.0])


def of_table(outputs: Floats) -> list[str]:
    line = fit_line(RATES, outputs)
    return [each.words for each in doubts_of_line(RATES, outputs, line, line.u_scale_factor)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({0: -2.07, 8: 2.07}, "off the line: clipped, wrapped, or misread"),
        ({0: 2.5, 1: 2.5, 7: -2.5, 8: -2.5}, "the outputs at the two largest rates are the same"),
        ({5: 10.0}, "off the line: clipped, wrapped"),
        ({5: -1.02}, "far beyond what the others scatter"),
    ],
)
def test_fault_of_a_table_is_told(change: dict[int, float], words: str) -> None:
    outputs = -0.01 * RATES + 1e-4 * np.random.default_rng(2).standard_normal(RATES.size)
    assert of_table(outputs) == []
    outputs[list(change)] = list(change.values())
    assert any(words in each for each in of_table(outputs))


BENDS: dict[str, Callable[[Floats], Floats]] = {
    "square": lambda x: x**2,
    "cube": lambda x: x**3,
    "asymmetry": np.abs,
    "saturation": lambda x: np.tanh(1.5 * x),
}


@pytest.mark.parametrize("bend", BENDS)
def test_bend_of_the_curve_is_no_point_off_the_line(bend: str) -> None:
    """Where rates are spaced by factors, as in the paper, the ends alone lie in the bend."""
    steps = 200.0 * 0.4 ** np.arange(8.0)
    rates = np.concatenate([steps, [0.0], -steps])
    draw = np.random.default_rng(6)
    for size in (1e-4, 1e-3, 1e-2):
        outputs = -12.5e-3 * rates + size * BENDS[bend](rates / 200.0) + 1e-5 * draw.standard_normal(rates.size)
        line = fit_line(rates, outputs)
        assert doubts_of_line(rates, outputs, line, line.u_scale_factor) == []


@pytest.mark.parametrize("digit", few([1e-6, 1e-4, 1.0, 10.0], 1e-4))
@pytest.mark.parametrize("noise", [0.1, 0.2, 0.3, 0.5, 1.0, 3.0])
def test_rounding_of_a_line_that_meets_its_digits_says_nothing(digit: float, noise: float) -> None:
    """One digit off all others, which met theirs, was far beyond their scatter in up to 147 of 400 such tables."""
    for seed in range(50):
        draw = np.random.default_rng(seed)
        for rates in (RATES, np.linspace(-200.0, 200.0, 21), np.array([-150, -100, -50, -20, -5, 0, 5, 20, 50, 100.0])):
            outputs = np.round(125.0 * rates + 7.0 + noise * draw.standard_normal(rates.size)) * digit
            line = fit_line(rates, outputs)
            assert doubts_of_line(rates, outputs, line, line.u_scale_factor) == []
        outputs[3] += 60.0 * max(1.0, noise) * digit
        line = fit_line(rates, outputs)
        assert doubts_of_line(rates, outputs, line, line.u_scale_factor) != []


def test_dead_output_is_told() -> None:
    dead = 1e-4 + 1e-5 * np.random.default_rng(3).standard_normal(RATES.size)
    assert any("not beyond its own uncertainty" in each for each in of_table(dead))


def test_a_largest_rate_that_is_visited_twice_is_no_saturation() -> None:
    rates = np.array([-300.0, -300.0, -100.0, 0.0, 100.0, 300.0, 300.0])
    line = fit_line(rates, -0.01 * rates)
    assert doubts_of_line(rates, -0.01 * rates, line, line.u_scale_factor) == []


def test_a_burst_is_told_whatever_the_rate() -> None:
    (found,) = [each for each in doubts_of_record(100.0 + spoilt(3000, 3002, 9.5)) if "a burst" in each.words]
    assert abs(found.row - 3000) <= 100


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("count", "told"), [(3, False), (4, False), (5, True), (6, True), (30, True)])
def test_five_readings_apart_are_a_state_and_fewer_are_spikes(count: int, sign: float, *, told: bool) -> None:
    rates = np.round(np.random.default_rng(2).standard_normal(400), 3)
    rates[np.linspace(10, 390, count, dtype=int)] += 40.0 * sign
    assert bool(list(_parted(rates))) is told
