"""The InfiniiVision 3000 X and 4000 X beside the DSO7104B: who they are, and a record through the driver."""

from __future__ import annotations

import pytest

import vcfbench
from tests.successors import BENCH
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.discovery import recognise


@pytest.mark.parametrize(
    ("answer", "model"),
    [
        ("AGILENT TECHNOLOGIES,DSO-X 3024A,MY00000000,02.38.2014110300", "DSOX3024A"),
        ("KEYSIGHT TECHNOLOGIES,DSO-X 3024A,MY50340123,02.43.2018020600", "DSOX3024A"),
        ("KEYSIGHT TECHNOLOGIES,MSO-X 3104T,MY1,07.30", "MSOX3104T"),
        ("KEYSIGHT TECHNOLOGIES,DSO-X 4104A,MY1,04.08", "DSOX4104A"),
        ("KEYSIGHT TECHNOLOGIES,DSO-X 1102G,MY1,01.10", None),
    ],
)
def test_discovery_finds_them_as_they_write_themselves(answer: str, model: str | None) -> None:
    assert recognise(answer) == model


@pytest.mark.parametrize("model", ["DSOX3024A", "DSOX4104A"])
def test_a_record_comes_through_the_driver(model: str) -> None:
    described = parse_bench(BENCH.read_text(encoding="utf-8").replace("DSOX3024A", model), "lab.toml")
    with vcfbench.open_bench(described, needs=["oscilloscope"]) as bench:
        scope = bench.oscilloscope
        scope.configure_channel(1, 1e-3)
        scope.configure_timebase(1e-3)
        scope.configure_trigger(1)
        scope.acquire(1)
        wave = scope.waveform(1, 5000)
        assert len(wave.time_s) == len(wave.voltage_v) == 5000
        assert wave.time_s[0] == pytest.approx(-5e-3)
        assert abs(wave.voltage_v).max() < 4e-3
