"""What is left of a bench when a run ends badly: judged by the physics, over real wires, in another process."""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from simrack.serve import Control
from simrack_tests.cells import few
from simrack_tests.ports import free_port
from typer.testing import CliRunner

from tests import warm
from vcfbench.cli.main import app
from vcfbench.clock import WallClock, sleep
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.file import embedded_text
from vcfbench.station.writing import bench_text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and pseudo-terminals of POSIX")

SHORT = "\n[procedure]\nrates_deg_s = [100, 0, -20]\nsamples = 2\nmatch_rate_deg_s = 20\n[procedure.drive]"


class Bench:
    """A served bench: its file, and what is really there."""

    def __init__(self, path: Path, control: Control) -> None:
        self.path = path
        self.control = control

    def look(self, name: str) -> float:
        return float(self.control.request("get", name=name))

    def safe(self) -> bool:
        rails = max(abs(self.look(f"rail.{rail}.voltage_v")) for rail in ("positive", "negative"))
        return abs(self.look("applied_rate_deg_s")) < 0.05 and rails < 0.5 and abs(self.look("node.v_vc")) < 0.01

    def comes_to_rest(self, wall_s: float = 20.0) -> bool:
        wall = WallClock()
        while not self.safe() and wall.now() < wall_s:
            sleep(wall, 0.05)
        return self.safe()


@pytest.fixture(params=few(["tcp", "pty"], "tcp"))
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bench]:
    text = embedded_text("paper").replace("\n[procedure.drive]", SHORT)
    (tmp_path / "short.toml").write_text(text.replace('name = "paper"', f'name = "{tmp_path.name}"'), encoding="utf-8")
    written, port = tmp_path / "served.toml", free_port()
    words = ["sim", "serve", "--bench", str(tmp_path / "short.toml"), "--speed", "4", "--control-port", str(port)]
    offers = ["--wires", request.param, "--offer", f"power:{request.param}", "--offer", f"rate_source:{request.param}"]
    with warm.running(["vcfbench", *words, *offers, "--write-bench", str(written)], tmp_path) as process:
        assert process.stdout.readline()
        with Control(port) as control:
            yield Bench(written, control)


def impatient(bench: Bench, role: str) -> None:
    """Let the run wait shortly for the answers of an instrument."""
    described = load_bench(bench.path)
    described = structs.replace(described, **{role: structs.replace(getattr(described, role), timeout_s=0.8)})
    bench.path.write_text(bench_text(described), encoding="utf-8")


def on_its_own_clock(bench: Bench) -> None:
    """Let the run take the bench for a real one."""
    bench.path.write_text(bench.path.read_text(encoding="utf-8").split("\n[served]")[0], encoding="utf-8")


@pytest.mark.exhaustive
@pytest.mark.parametrize("pause_s", few([0.02, 0.15, 0.3], 0.15))
def test_three_signals_of_a_nervous_hand_leave_nothing_on(bench: Bench, tmp_path: Path, pause_s: float) -> None:
    on_its_own_clock(bench)
    command = ["vcfbench", "run", "turntable", "--json", "--bench", str(bench.path)]
    with warm.running(command, tmp_path, errors=True) as process:
        assert any("outputs on" in line for line in process.stderr)
        for _ in range(3):
            process.send_signal(signal.SIGTERM)
            sleep(WallClock(), pause_s)
        words = process.stderr.read()
        assert process.wait(30) in {4, 5}, words
    assert bench.comes_to_rest()


@pytest.mark.parametrize("role", few(["rate_table", "rate_source", "power"], "rate_table"))
def test_instrument_without_replies_is_at_rest_and_off(bench: Bench, tmp_path: Path, role: str) -> None:
    """Its answers are lost once the table turns; whatever is proved, nothing may go on."""
    at_s = 20.0
    impatient(bench, role)
    bench.control.request("fault", instrument=role, kind="silent", at_s=at_s)
    done = CliRunner().invoke(app, ["run", "turntable", "--quiet", "--runs", str(tmp_path), "--bench", str(bench.path)])
    assert done.exit_code == 5, done.output
    named = getattr(load_bench(bench.path), role).resource
    commanded = "told to stop" if role == "rate_table" else "told to switch off"
    assert f"NOT SAFE: {role} at {named}: {commanded}, not proved; last read back: " in done.stderr
    assert bench.comes_to_rest()
