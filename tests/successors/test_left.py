"""A run where the last user left all that is in reach: its first try is right, or names what is not ours to set."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from tests.successors import BENCH
from vcfbench.errors import InstrumentError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.builder import SimulatedBench

if TYPE_CHECKING:
    from pathlib import Path

LEFT = {
    "power": "OUTP:COUP:CHAN ALL;:VOLT:PROT 6,(@2);:VOLT:PROT:STAT ON,(@2);:OUTP:DEL:RISE 5,(@2);:OUTP ON,(@1)",
    "rate_source": "SOUR1:FUNC SIN;:SOUR1:AM:STAT ON;:OUTP1:POL INV;:OUTP1 ON",
    "multimeter": "CALC:FORM MXB;KMAT:MMF 2;MBF 0;:CALC:STAT ON;:VOLT:REF 1;REF:STAT ON",
    "oscilloscope": ":CHAN1:SCAL 0.01;OFFS 0.05;INV 1;:TRIG:HOLD 5;:ACQ:MODE SEGM;:TIM:MODE XY",
}


def left_behind(monkeypatch: pytest.MonkeyPatch, left: dict[str, str]) -> None:
    build = SimulatedBench.build

    def built(*arguments: Any) -> SimulatedBench:
        bench = build(*arguments)
        for role, words in left.items():
            bench.devices[role].write(words.encode("ascii") + b"\n", end=True)
        return bench

    monkeypatch.setattr(SimulatedBench, "build", built)


def slope(tmp_path: Path) -> float:
    bench = parse_bench(BENCH.read_text(encoding="utf-8"), "lab.toml")
    run = vcfbench.run(
        "turntable", bench, seed=1, settings={"samples": 5, "rates_deg_s": (-100, 0, 100)}, runs=tmp_path
    )
    return float(run.results.scale_factor.value)


def test_a_run_is_right_at_its_first_try(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clean = slope(tmp_path)
    left_behind(monkeypatch, LEFT)
    assert slope(tmp_path) == pytest.approx(clean, rel=2e-4)


def test_other_probe_factor_ends_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left_behind(monkeypatch, {"oscilloscope": ":CHAN1:PROB 10"})
    with pytest.raises(InstrumentError, match="its probe factor is not what"):
        slope(tmp_path)
