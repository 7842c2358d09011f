"""A run over real wires to a bench in another process gives the results of the run in one process, byte for byte."""

from __future__ import annotations

import json
import os
import signal
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
import serial
from simrack.serve import Control
from simrack_tests.cells import few
from simrack_tests.ports import free_port
from typer.testing import CliRunner

from tests import warm
from tests.drivers.rate_table import DIALECTS
from vcfbench.cli.main import app
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

QUICK = """
[procedure]
rates_deg_s = [40, 20, -40]
match_rate_deg_s = 20
acceleration_deg_s2 = 200
settle_s = 0.1
sample_interval_s = 1
samples = 2
nplc = 1
[procedure.drive]"""
needs_ptys = pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")


@pytest.fixture
def short(tmp_path: Path) -> Path:
    """The paper bench with few rates."""
    path = tmp_path / "short.toml"
    path.write_text(embedded_text("paper").replace("\n[procedure.drive]", QUICK), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def turntable(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A short turntable calibration in one process."""
    folder = tmp_path_factory.mktemp("turntable")
    bench = folder / "short.toml"
    bench.write_text(embedded_text("paper").replace("\n[procedure.drive]", QUICK), encoding="utf-8")
    return answer(folder, "turntable", "--bench", str(bench), "--seed", "7")


WIRES = ["tcp", pytest.param("pty", marks=needs_ptys), "vxi11", "hislip"]
INSTRUMENTS = ("power", "rate_source", "multimeter", "oscilloscope")


def everywhere(wires: str) -> list[str]:
    """Return what offers every instrument on `wires`, and runs on them; a table has sockets and serial lines only."""
    offers = [word for role in INSTRUMENTS for word in ("--offer", f"{role}:{wires}")]
    return ["--wires", wires, *offers]


def require_wires(served: Path, wires: str) -> None:
    """Make sure that the bench file names those wires for every instrument."""
    marks = {"tcp": "::SOCKET", "pty": "ASRL/dev/", "vxi11": "::inst0::INSTR", "hislip": "::hislip0,"}
    description = load_bench(served)
    assert all(marks[wires] in getattr(description, role).resource for role in INSTRUMENTS)


def speak(bench: Path, dialect: str) -> None:
    """Let the table of `bench` speak `dialect`; one that only turns to and fro turns slowly."""
    said = f'dialect = "{dialect}"' + ("\nsteps_per_deg = 1777.7777777777778" if dialect == "zaber" else "")
    text = bench.read_text(encoding="utf-8").replace('dialect = "acl"', said)
    if dialect == "aaaa":
        text = text.replace("[40, 20, -40]", "[20, 10, -15]").replace("rate_deg_s = 20\n", "rate_deg_s = 10\n")
    bench.write_text(text, encoding="utf-8")


def on_terminals(served: Path, instruments: dict[str, dict[str, Any]]) -> None:
    """Let a bench file name the terminals that there are."""
    text = served.read_text(encoding="utf-8")
    for wires in instruments.values():
        if wires["pty"] is not None:
            text = text.replace(f'"{wires["tcp"]}"', f'"{wires["pty"]}"')
    served.write_text(text.replace("[power]", "[power]\nserial_pause_s = 0.0"), encoding="utf-8")


@contextmanager
def serving(bench: Path, *arguments: str) -> Iterator[Path]:
    """Serve `bench` in another process; the bench file that it writes."""
    written = bench.with_name("served.toml")
    words = ["sim", "serve", "--bench", str(bench), "--speed", "max", "--control-port", str(free_port())]
    command = ["vcfbench", *words, "--write-bench", str(written), *arguments]
    with warm.running(command, bench.parent) as process:
        assert process.stdout.readline()
        yield written


def answer(folder: Path, procedure: str, *arguments: str) -> dict[str, Any]:
    done = CliRunner().invoke(app, ["run", procedure, "--json", "--quiet", "--runs", str(folder), *arguments])
    assert done.exit_code == 0, done.output
    given: dict[str, Any] = json.loads(done.stdout)
    del given["run"], given["equipment"]  # they hold the time of day, and where the instruments are
    return given


@pytest.mark.parametrize("wires", few(WIRES, "pty"))
def test_turntable_over_real_wires_gives_the_same_bytes(
    turntable: dict[str, Any], short: Path, tmp_path: Path, wires: str
) -> None:
    with serving(short, *everywhere(wires), "--seed", "7") as served:
        require_wires(served, wires)
        over_wires = answer(tmp_path, "turntable", "--bench", str(served))
    assert json.dumps(over_wires) == json.dumps(turntable)


@pytest.mark.exhaustive
@pytest.mark.parametrize("dialect", few(DIALECTS, "dd16"))
def test_turntable_with_every_table_gives_the_same_bytes(short: Path, tmp_path: Path, dialect: str) -> None:
    """Frames, unasked status, answers in order: over TCP, and on the same server put back over a serial line."""
    speak(short, dialect)
    alone = answer(tmp_path, "turntable", "--bench", str(short), "--seed", "7")
    with serving(short, "--seed", "7") as served:
        served_at = load_bench(served).served
        assert served_at is not None
        over_wires = [answer(tmp_path, "turntable", "--bench", str(served))]
        if hasattr(os, "openpty"):
            with Control(served_at.address()[1]) as control:
                control.request("reset")
                on_terminals(served, control.request("status")["instruments"])
            over_wires.append(answer(tmp_path, "turntable", "--bench", str(served)))
    assert {json.dumps(each) for each in over_wires} == {json.dumps(alone)}


@pytest.mark.exhaustive
@needs_ptys
def test_controlling_run_starts_at_0_although_a_table_sent_status(short: Path, tmp_path: Path) -> None:
    speak(short, "ruya")
    alone = answer(tmp_path, "turntable", "--bench", str(short), "--seed", "7")
    with serving(short, "--wires", "pty", "--seed", "7") as served:
        described = load_bench(served)
        with serial.Serial(described.rate_table.resource, timeout=10.0) as port:
            assert len(port.read(40)) == 40
        over_wires = answer(tmp_path, "turntable", "--bench", str(served))
    assert json.dumps(over_wires) == json.dumps(alone)


@pytest.mark.exhaustive
def test_all_four_steps_over_real_wires_give_the_same_bytes(short: Path, tmp_path: Path) -> None:
    alone = answer(tmp_path, "virtual-coriolis", "--bench", str(short), "--seed", "7")
    with serving(short, *everywhere("tcp"), "--seed", "7") as served:
        require_wires(served, "tcp")
        over_wires = answer(tmp_path, "virtual-coriolis", "--bench", str(served), "--speed", "max")
    assert json.dumps(over_wires) == json.dumps(alone)


@pytest.mark.exhaustive  # three whole runs
def test_after_a_reset_the_bench_gives_the_same_bytes_again(short: Path, tmp_path: Path) -> None:
    with serving(short) as served:
        served_at = load_bench(served).served
        assert served_at is not None
        first = answer(tmp_path, "turntable", "--bench", str(served))
        second = answer(tmp_path, "turntable", "--bench", str(served))
        with Control(served_at.address()[1]) as control:
            control.request("reset")
        third = answer(tmp_path, "turntable", "--bench", str(served))
    assert json.dumps(first) == json.dumps(third)
    assert json.dumps(first["results"]) != json.dumps(second["results"])


@pytest.mark.exhaustive  # at real time
def test_served_bench_with_a_clock_of_its_own_runs_on_wall_clock(short: Path, tmp_path: Path) -> None:
    """At 20 times real time a program's waits are that much longer for the bench; the physics is the same.

    A reading may begin half an interval late: long intervals, since the machine may be busy.
    """
    # nothing that warms up: it takes as long as it takes
    short.write_text(embedded_text("ideal").replace("\n[procedure.drive]", QUICK), encoding="utf-8")
    alone = answer(tmp_path, "turntable", "--bench", str(short))
    with serving(short, "--speed", "20") as served:
        served.write_text(served.read_text(encoding="utf-8") + 'clock = "wall"\n', encoding="utf-8")
        real = answer(tmp_path, "turntable", "--bench", str(served))
    assert (real["simulated"], real["seed"]) == (True, None)
    slopes = [given["results"]["scale_factor"]["value"] for given in (alone, real)]
    assert slopes[1] == pytest.approx(slopes[0], rel=2e-3)


def test_who_leads_the_time_has_the_bench(short: Path) -> None:
    with serving(short) as served:
        served_at = load_bench(served).served
        assert served_at is not None
        with Control(served_at.address()[1]) as other:
            other.request("lead")
            refused = CliRunner().invoke(app, ["run", "turntable", "--quiet", "--bench", str(served)])
    assert refused.exit_code == 3
    assert "another connection leads the clock" in refused.stderr


def test_bench_no_longer_served_is_one_sentence(short: Path) -> None:
    with serving(short) as served:
        pass
    refused = CliRunner().invoke(app, ["run", "turntable", "--quiet", "--bench", str(served)])
    assert refused.exit_code == 3
    assert "start it with vcfbench sim serve" in refused.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["--seed", "3"], "its server was given the seed"), (["--speed", "5"], "always takes at max")],
)
def test_seed_and_speed_are_the_servers(short: Path, arguments: list[str], words: str) -> None:
    text = embedded_text("paper").split("[simulation]")[0] + '[served]\ncontrol = "127.0.0.1:1"\n'
    short.write_text(text, encoding="utf-8")
    refused = CliRunner().invoke(app, ["run", "turntable", "--bench", str(short), *arguments])
    assert refused.exit_code == 2
    assert words in refused.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to a child alone")
def test_a_run_that_is_stopped_makes_the_served_bench_safe(short: Path, tmp_path: Path) -> None:
    """Broken off amid a request, the clock still tells the right time, or making safe would miss its deadlines."""
    with serving(short, "--speed", "1") as served:
        served_at = load_bench(served).served
        assert served_at is not None
        command = ["vcfbench", "run", "turntable", "--json", "--bench", str(served)]
        with warm.running(command, tmp_path, errors=True) as process:
            assert any("average 2 readings" in line for line in process.stderr)
            process.send_signal(signal.SIGINT)
            process.stderr.read()
            assert process.wait(30) == 4
        with Control(served_at.address()[1]) as control:
            assert control.request("get", name="applied_rate_deg_s") == pytest.approx(0.0, abs=0.1)
            assert control.request("get", name="rail.positive.voltage_v") == pytest.approx(0.0, abs=0.5)


@needs_ptys
@pytest.mark.exhaustive
@pytest.mark.parametrize("dialect", DIALECTS)
def test_real_line_gives_same_bytes_as_process(dialect: str, short: Path, tmp_path: Path) -> None:
    """Each character to and from the table takes its time, here as there; those of the others take none."""
    speak(short, dialect)
    text = short.read_text(encoding="utf-8").replace('"sim://paper"', '"/dev/ttyS0"')
    short.write_text(text, encoding="utf-8")
    alone = answer(tmp_path, "turntable", "--bench", str(short), "--seed", "7")
    with serving(short, "--rs232", "real", "--seed", "7") as served:
        with Control(load_bench(served).served.address()[1]) as control:
            wires = control.request("status")["instruments"]["rate_table"]
        on_terminals(served, {"rate_table": wires})
        assert answer(tmp_path, "turntable", "--bench", str(served)) == alone
