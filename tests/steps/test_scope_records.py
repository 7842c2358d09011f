"""Records of an oscilloscope: scales and points that suit the signal, whatever it is."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.procedures.fakes import make_settings
from vcfbench.errors import ClippedRecord, MeasurementError
from vcfbench.interfaces import Waveform
from vcfbench.steps.scope import Screen, interval_of
from vcfbench.uncertainty.oscilloscope import as_expected, points_over, points_that_show

SPANS_S = st.sampled_from([factor * 10.0**decade for decade in range(-3, 2) for factor in (1.0, 2.0, 5.0)])


class Scope:
    """Shows sines of its amplitudes, by channel, clipped beyond four divisions."""

    def __init__(self, amplitudes_v: dict[int, float]) -> None:
        self.amplitudes_v = amplitudes_v
        self.scales: dict[int, float] = {}
        self.records = 0

    def configure_channel(self, channel: int, scale_v_per_div: float) -> None:
        self.scales[channel] = scale_v_per_div

    def acquire(self) -> None:
        self.records += 1

    def waveform(self, channel: int, points: int) -> Waveform:
        if self.amplitudes_v[channel] > 4.0 * self.scales[channel]:
            raise ClippedRecord("clipped")
        return Waveform(np.arange(points) * 1.0, self.amplitudes_v[channel] * np.ones(points))


def looking_by(scope: Scope) -> Any:
    return SimpleNamespace(bench=SimpleNamespace(oscilloscope=scope), believable=lambda ask: ask())


@given(amplitudes_v=st.tuples(*[st.floats(0.0, 19.0)] * 2), shown_v=st.tuples(*[st.floats(0.0, 15.0)] * 2))
def test_what_is_clipped_is_shown_at_a_larger_scale(amplitudes_v: Any, shown_v: Any) -> None:
    scope = Scope(dict(zip((1, 3), amplitudes_v, strict=True)))
    taken = Screen(looking_by(scope), (1, 3), shown_v).record(scope.acquire, 10)
    assert [float(each.voltage_v[0]) for each in taken] == list(amplitudes_v)
    assert scope.records <= 25
    for channel, amplitude_v, first_v in zip((1, 3), amplitudes_v, shown_v, strict=True):
        assert scope.scales[channel] <= max(first_v, 2.0 * amplitude_v, 0.04) / 3.0 * 1.0001


def test_what_no_scale_shows_is_said() -> None:
    scope = Scope({1: 25.0})
    with pytest.raises(ClippedRecord):
        Screen(looking_by(scope), (1,), (1.0,)).record(scope.acquire)


@given(span_s=SPANS_S, drive_hz=st.floats(1000.0, 50_000.0), phase=st.floats(0.0, 2.0 * math.pi))
def test_few_points_still_show_how_large_the_drive_is(span_s: float, drive_hz: float, phase: float) -> None:
    points = points_that_show(span_s, drive_hz)
    t = span_s / points * np.arange(points)
    assert np.abs(np.cos(2.0 * math.pi * drive_hz * t + phase)).max() > 0.75  # the scale has a third to spare


@pytest.mark.parametrize("drive_hz", [1000.0, 2000.0, 5000.0, 8000.0, 12_000.0, 18_000.0, 25_000.0, 50_000.0])
@pytest.mark.parametrize("span_s", [0.05, 0.2, 0.5, 5.0])
def test_round_frequencies_and_round_spans_still_show_it(span_s: float, drive_hz: float) -> None:
    test_few_points_still_show_how_large_the_drive_is.hypothesis.inner_test(  # type: ignore[attr-defined]
        span_s, drive_hz, 0.5 * math.pi
    )


@given(span_s=SPANS_S, highest_hz=st.floats(1000.0, 71_500.0), a_period=st.floats(2.5, 40.0))
def test_points_of_a_record_tell_its_fastest_sine(span_s: float, highest_hz: float, a_period: float) -> None:
    points = points_over(span_s, highest_hz, a_period)
    taken = Waveform(span_s / points * np.arange(2), np.zeros(2))
    assert interval_of(taken, highest_hz) * highest_hz < 0.5 / 1.2
    with pytest.raises(MeasurementError, match="are too few for a sine"):
        interval_of(taken, 0.5 * points / span_s)


@given(drive_hz=st.floats(500.0, 60_000.0))
def test_unexpected_drive_signal_is_reported(drive_hz: float) -> None:
    settings = make_settings()
    low_hz, high_hz = settings.drive.frequency_hz
    if low_hz <= drive_hz <= high_hz:
        assert as_expected(settings, drive_hz) == drive_hz
    else:
        with pytest.raises(MeasurementError, match=r"expected 3480 to 3498 Hz \(drive.frequency_hz\)"):
            as_expected(settings, drive_hz)
