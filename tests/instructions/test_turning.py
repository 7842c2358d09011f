"""The sense signal turns against the drive either way, however far the time bases are apart."""

from __future__ import annotations

import math
from random import Random
from typing import cast

import pytest

from tests.procedures.fakes import make_settings
from vcfbench.analysis.rotating import reference_phase
from vcfbench.instructions.routines import turning
from vcfbench.steps import CaptureRotations, Done, RotationRecord, Rotations, SetSine
from vcfbench.uncertainty.oscilloscope import aimed

REFERENCE_DEG = 87.0


def lag_deg(over_usual: float) -> float:
    """Return the lag of a Butterworth filter of fourth order, which the usual difference is a twelfth of."""
    over_corner = over_usual / 12.4
    return math.degrees(over_corner / math.sin(math.pi / 8.0) + over_corner**3 / 3.0 / math.sin(3.0 * math.pi / 8.0))


def turned(step: CaptureRotations, apart: float, off_hz: float) -> tuple[list[RotationRecord], float]:
    """Return records of a sense signal whose filter's lag is curved, the time bases `apart`, relative."""
    set_hz = 2.0 * step.drive_hz + step.difference_hz - off_hz
    work = turning(make_settings(), step, 1.0, off_hz)
    asked, sign = next(work), math.copysign(1.0, step.difference_hz)
    while True:
        if isinstance(asked, SetSine):
            set_hz = asked.frequency_hz
        seen_hz = set_hz * (1.0 + apart) - 2.0 * step.drive_hz
        record = RotationRecord(
            step.drive_hz, seen_hz, REFERENCE_DEG + lag_deg(seen_hz / step.difference_hz) * sign, 1.0, 1.0
        )
        result = Rotations((record,) * step.count) if isinstance(asked, CaptureRotations) else Done()
        try:
            asked = work.send(result)
        except StopIteration as ended:
            return cast("tuple[list[RotationRecord], float]", ended.value)


def test_reference_is_from_records_that_turned_equally() -> None:
    random = Random(1)  # noqa: S311  # frequencies, no secrets
    for _ in range(200):
        drive_hz, near_hz = 10.0 ** random.uniform(3.0, 4.7), 10.0 ** random.uniform(0.0, 0.9)
        apart, off_hz, took = random.uniform(-45e-6, 45e-6), 0.0, []
        found: list[RotationRecord] = []
        for sign in (1.0, -1.0, -1.0, 1.0):
            step = CaptureRotations((1, 2, 3), (1.0, 1.0, 1.0), 2, 1000, sign * near_hz, drive_hz)
            records, off_hz = turned(step, apart, off_hz)
            found += records
            took.append(len(records))
        assert took[1:] == [2, 2, 2]  # the first has shown how far the time bases are apart
        assert reference_phase(aimed(found, near_hz)).phase_deg == pytest.approx(REFERENCE_DEG, abs=2e-3)


def test_records_that_turn_as_they_should_are_taken_once() -> None:
    for near_hz in (5.0, -5.0):
        step = CaptureRotations((1, 2, 3), (1.0, 1.0, 1.0), 2, 1000, near_hz, 30_000.0)
        assert len(turned(step, 6e-8, 0.0)[0]) == 2  # off by 0.0036 Hz
        assert len(turned(step, 1e-7, 0.0)[0]) == 4  # by 0.006 Hz
