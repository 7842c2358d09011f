"""The sense signal turns against the drive either way, however far the time bases are apart."""

from __future__ import annotations

from random import Random
from statistics import median

from tests.procedures.fakes import make_settings
from vcfbench.instructions.routines import turning
from vcfbench.steps import CaptureRotations, Done, RotationRecord, Rotations, SetSine


def turned_hz(step: CaptureRotations, apart: float) -> list[float]:
    """Return by how much the sense signal turned in each record, the time bases `apart`, relative."""
    set_hz, work = 2.0 * step.drive_hz + step.difference_hz, turning(make_settings(), step, 1.0)
    asked = next(work)
    while True:
        if isinstance(asked, SetSine):
            set_hz = asked.frequency_hz
        seen_hz = set_hz * (1.0 + apart) - 2.0 * step.drive_hz
        record = RotationRecord(step.drive_hz, seen_hz, 90.0, 1.0, 1.0)
        result = Rotations((record,) * step.count) if isinstance(asked, CaptureRotations) else Done()
        try:
            asked = work.send(result)
        except StopIteration as ended:
            return [each.difference_hz for each in ended.value]


def test_two_records_turn_either_way_whatever_the_drive_and_the_split() -> None:
    random = Random(1)  # noqa: S311  # frequencies, no secrets
    for _ in range(200):
        drive_hz, near_hz = 10.0 ** random.uniform(3.0, 4.7), 10.0 ** random.uniform(0.0, 0.9)
        apart = random.uniform(-45e-6, 45e-6)
        for sign in (1.0, -1.0):
            step = CaptureRotations((1, 2, 3), (1.0, 1.0, 1.0), 2, 1000, sign * near_hz, drive_hz)
            found = turned_hz(step, apart)
            assert sum(each * sign > 0.0 for each in found) >= 2
            assert abs(median(found[-2:]) - sign * near_hz) < 0.5 * near_hz + 1e-3


def test_records_that_turn_as_they_should_are_taken_once() -> None:
    for near_hz in (5.0, -5.0):
        step = CaptureRotations((1, 2, 3), (1.0, 1.0, 1.0), 2, 1000, near_hz, 30_000.0)
        assert len(turned_hz(step, 30e-6)) == 2  # off by 1.8 Hz
        assert len(turned_hz(step, 45e-6)) == 4  # by 2.7 Hz
