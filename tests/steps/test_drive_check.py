"""The words of the check of the drive signal."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.station.parts import DriveWindow
from vcfbench.steps import DriveReading
from vcfbench.steps.drive_check import _complaint


@given(st.floats(-360.0, 360.0), st.floats(-180.0, 180.0), st.floats(1.0, 90.0))
def test_phase_is_within_half_a_turn_of_its_window(read_deg: float, middle_deg: float, half_deg: float) -> None:
    window = DriveWindow(phase_deg=(middle_deg - half_deg, middle_deg + half_deg))
    said = _complaint(DriveReading(3489.0, 1.0, read_deg, 1.0), window, 1.0)
    away = math.remainder(read_deg - middle_deg, 360.0)
    if abs(away) < half_deg - 1e-6:
        assert not said
    elif abs(away) > half_deg + 1e-6:
        told_deg = float(said.removeprefix("phase ").partition(" deg")[0])
        assert told_deg == pytest.approx(middle_deg + away, abs=1e-2)
        assert abs(told_deg) <= 360.0


def test_33_degrees_are_33_and_not_393() -> None:
    assert _complaint(DriveReading(3489.0, 1.0, 33.0, 1.0), DriveWindow(phase_deg=(80.0, 100.0)), 1.0).startswith(
        "phase 33 deg, expected 80...100 deg"
    )
