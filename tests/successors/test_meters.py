"""The Keithley 2000 and DMM6500 beside the 34401A: console, data sheets and drawn specimens, and runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from simrack.instruments.keithley import Errors2000, Errors6500, KeithleyDMM6500Twin

import vcfbench
from tests.successors import BENCH
from vcfbench.errors import WrongInstrument
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.turntable import TURNTABLE
from vcfbench.specifications import KEITHLEY_2000, KEITHLEY_DMM6500, VoltmeterSpecification
from vcfbench.station.discovery import recognise

if TYPE_CHECKING:
    from vcfbench.station.description import BenchDescription


def bench(model: str) -> BenchDescription:
    return parse_bench(BENCH.read_text(encoding="utf-8").replace('"2000"', f'"{model}"'), "lab.toml")


@pytest.mark.parametrize("model", ["2000", "DMM6500"])
def test_it_reads_the_node_that_it_is_on(model: str) -> None:
    with vcfbench.open_bench(bench(model), needs=["multimeter"]) as opened:
        opened.multimeter.configure_dc_voltage(10.0, 1.0)
        assert abs(opened.multimeter.read_voltage_v()) < 1e-2
        assert opened.multimeter.identify().model.startswith("MODEL ")


def test_one_that_speaks_tsp_is_refused_by_the_bench(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(KeithleyDMM6500Twin, "command_set", "TSP")
    with (
        pytest.raises(WrongInstrument, match="set to the command set TSP"),
        vcfbench.open_bench(bench("DMM6500"), needs=["multimeter"]),
    ):
        pass


@pytest.mark.parametrize(("model", "resolution_v"), [("2000", 1e-5), ("DMM6500", 1e-5)])
def test_the_resolution_of_the_budget_is_that_of_the_model(model: str, resolution_v: float) -> None:
    assert settings_of(TURNTABLE, bench(model)).station.meter_resolution_v == pytest.approx(resolution_v)


@pytest.mark.parametrize(("errors", "sheet"), [(Errors2000, KEITHLEY_2000), (Errors6500, KEITHLEY_DMM6500)])
def test_specimens_lie_within_their_sheet(errors: Any, sheet: VoltmeterSpecification) -> None:
    limit = sheet.accuracy_of(10.0, 365)
    drawn = [errors.drawn(np.random.default_rng(seed)) for seed in range(60)]
    assert 0.9 < max(abs(each.gain_error) for each in drawn) / limit.reading <= 1.0
    assert 0.9 < max(abs(each.offset_v) for each in drawn) / (limit.range * 10.0) <= 1.0


def test_discovery_finds_both_by_real_replies() -> None:
    assert recognise("KEITHLEY INSTRUMENTS INC.,MODEL 2000,1308393,A20  /A02") == "2000"
    assert recognise("KEITHLEY INSTRUMENTS,MODEL DMM6500,04592448,1.7.12b") == "DMM6500"
    assert recognise("KEITHLEY INSTRUMENTS INC.,MODEL 2400,1,C30") is None
