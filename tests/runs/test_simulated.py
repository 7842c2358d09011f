"""A bench with a simulated instrument has simulated runs, however that is opened, and others have real ones."""

from __future__ import annotations

import pytest
from msgspec import structs

from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.runs.request import Request, prepare
from vcfbench.runs.under_way import UnderWay
from vcfbench.station.description import BenchDescription, Served
from vcfbench.station.file import embedded_text, template

REAL = ("@py", "@ivi", "/opt/sim", "/opt/@sim/libvisa.so", "PRLGX-TCPIP0::192.168.1.9::1234::INTFC@py")
SIMULATED = ("@vcfbench", "?speed=max&seed=1@vcfbench", "lab.toml@vcfbench", "@simrack", "/opt/rack.yaml@sim", "@sim")
PORTS = {"COM3": False, "socket://192.168.53.1:9878": False, "sim://lab": True, "SIM://lab": True}


def opened_by(library: str, port: str) -> BenchDescription:
    """Return the bench of the template, without ``[simulation]``, opened by a VISA library and a table's port."""
    bench = parse_bench(template(), "lab.toml")
    assert bench.rate_table is not None
    return structs.replace(bench, visa_library=library, rate_table=structs.replace(bench.rate_table, resource=port))


def kind_in_record(bench: BenchDescription) -> set[object]:
    """Return what the header says of a run on `bench`, and what its entries in the store of devices go by."""
    under_way = UnderWay(prepare(Request("turntable", bench)))
    under_way.open_journal({})
    return {under_way.header["simulated"], under_way.prepared.settings.station.simulated}


@pytest.mark.parametrize(
    ("library", "port"), [*((each, "COM3") for each in REAL + SIMULATED), *(("@py", each) for each in PORTS)]
)
def test_run_is_as_simulated_as_the_instruments_it_opens(library: str, port: str) -> None:
    bench = opened_by(library, port)
    assert kind_in_record(bench) == {library in SIMULATED or PORTS[port]}
    if bench.simulated:  # by what another program keeps, which has its own clock, seed and hands
        for more in ({"seed": 3}, {"speed": "max"}):
            with pytest.raises(ConfigError, match=r"has no \[simulation\]"):
                prepare(Request("turntable", bench, **more))  # type: ignore[arg-type]


def test_run_on_a_served_bench_is_simulated() -> None:
    bench = opened_by("@py", "socket://127.0.0.1:9878")
    for clock in (None, "wall"):
        served = structs.replace(bench, served=Served(control="127.0.0.1:20220", clock=clock))
        assert (kind_in_record(served), served.steered) == ({True}, clock is None)
    assert kind_in_record(parse_bench(embedded_text("lab"), "lab.toml")) == {True}
