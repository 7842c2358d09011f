"""What `sim show` says of each number of a simulated bench: a meaning, a unit, and where it comes from."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.stream import StreamErrors

from vcfbench.files import parse_toml
from vcfbench.procedures.bench_file import checked_bench, load_bench
from vcfbench.sim.inventory import inventory
from vcfbench.sim.own_gyro import DataSheet, own_gyro_bench

STREAMED = parse_toml(own_gyro_bench(DataSheet(), "a", stream={"profile": "vn100", "resource": "ASRL9::INSTR"}), "a")


@pytest.mark.parametrize("bench", ["paper", "lab", "ideal"])
def test_every_number_of_a_bench_has_a_meaning(bench: str) -> None:
    assert [row.path for row in inventory(load_bench(bench), 1) if not row.meaning] == []


@given(st.sets(st.sampled_from(StreamErrors.__struct_fields__)), st.booleans())
def test_numbers_of_a_stream_are_explained_and_come_from_where_they_stand(chosen: set[str], drawn: bool) -> None:  # noqa: FBT001
    errors = {**dict.fromkeys(chosen, 0.5), **({"drawn": 1.0} if drawn else {})}
    values = {**STREAMED, "simulation": {**STREAMED["simulation"], "errors": {"multimeter": errors}}}
    rows = [row for row in inventory(checked_bench(values, "a"), 1) if row.path.startswith("errors.multimeter.")]
    assert len(rows) == len(StreamErrors.__struct_fields__)
    assert all(row.meaning for row in rows)
    assert {row.path.rpartition(".")[2] for row in rows if "bench file" in row.source} == chosen
    assert {row.unit for row in rows if row.path.endswith("lsb_per_deg_s")} == {"LSB/(deg/s)"}
    assert all(("drawn" in row.source) == drawn for row in rows if "bench file" not in row.source)
