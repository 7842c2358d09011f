"""Instruments that are simulated are known by what they answer and where they are, not by a table in a file alone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs
from simrack.serial_numbers import SERIAL_NUMBERS, is_simulated_serial
from simrack_tests.cells import few

import simrack
import vcfbench
from vcfbench.bench.simulated_instruments import CONTROL_VARIABLE, simulated_roles
from vcfbench.errors import ConfigError
from vcfbench.interfaces import Identity
from vcfbench.station.description import BenchDescription
from vcfbench.steps import Note
from vcfbench.testing.benches import serve_simulated

REAL = vcfbench.load_bench("paper")
ROLES = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table")


def look(_settings: vcfbench.ProcedureSettings) -> Any:
    yield Note("nothing is done")


LOOK = vcfbench.Procedure(
    name="look", title="Look.", settings=vcfbench.ProcedureSettings, plan=look, results=lambda *_: None
)


def unsaid(bench: BenchDescription) -> BenchDescription:
    return structs.replace(bench, served=None)


def test_serial_numbers_of_all_simulated_instruments_are_known() -> None:
    sources = Path(next(iter(simrack.__path__))).joinpath("instruments").rglob("*.py")
    found = {
        each for source in sources for each in re.findall(r"\b[A-Z]{2}\d{8}\b", source.read_text(encoding="utf-8"))
    }
    assert found == set(SERIAL_NUMBERS)


@given(st.sampled_from(SERIAL_NUMBERS), st.integers(-10_000, 10_000))
def test_serial_numbers_beside_the_made_up_ones_are_real(first: str, further: int) -> None:
    number = f"{first[:2]}{int(first[2:]) + further:08d}"
    assert is_simulated_serial(number) is any(0 <= int(number[2:]) - int(each[2:]) < 100 for each in SERIAL_NUMBERS)


@given(st.lists(st.sampled_from([*SERIAL_NUMBERS, "0", "", "MY41000816"]), min_size=5, max_size=5))
def test_one_such_number_elsewhere_may_be_a_laboratorys(numbers: list[str]) -> None:
    identities = {role: Identity("", "", each, "") for role, each in zip(ROLES, numbers, strict=True)}
    made_up = sum(each in SERIAL_NUMBERS for each in numbers)
    assert len(simulated_roles(REAL, identities)) == (made_up if made_up > 1 else 0)


@pytest.mark.parametrize("needs", few([["oscilloscope"], ["power", "multimeter"]], every=2))
def test_served_bench_without_its_table_is_simulated(needs: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with serve_simulated("paper") as lab:
        monkeypatch.setenv(CONTROL_VARIABLE, str(lab.control_port))
        bench = unsaid(lab.on_wires())
        assert not bench.simulated
        with vcfbench.open_bench(bench, needs=needs) as opened:
            assert opened.simulated
            assert set(needs) <= set(opened.simulated_roles)


def test_run_on_it_counts_as_simulated(tmp_path: Path) -> None:
    with serve_simulated("paper") as lab:
        with pytest.warns(UserWarning, match="oscilloscope .* are simulated: .* counts as simulated"):
            run = vcfbench.run(LOOK, unsaid(lab.on_wires()), runs=tmp_path)
        assert run.simulated
        assert vcfbench.load_run(run.directory).simulated
        asked = {"dut": "Z", "devices": str(tmp_path / "devices")}
        with pytest.raises(ConfigError, match=r"the bench file is of a real bench, but .* are simulated"):
            vcfbench.run("zero", unsaid(lab.on_wires()), settings=asked, runs=tmp_path)


def test_real_instrument_beside_served_is_refused() -> None:
    with serve_simulated("paper") as lab:
        bench = lab.on_wires()
        assert bench.multimeter is not None
        real = structs.replace(bench, multimeter=structs.replace(bench.multimeter, resource="GPIB0::22::INSTR"))
        with pytest.raises(ConfigError, match=r"multimeter at GPIB0::22::INSTR: expected a simulated instrument"):
            vcfbench.open_bench(real)
