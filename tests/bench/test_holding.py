"""A bench that is still open when Python ends is made safe, and the process ends by itself."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import nullcontext
from mmap import mmap
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pytest
from msgspec import structs
from simrack_tests.cells import few

from vcfbench.bench.bench import open_bench
from vcfbench.errors import Aborted, NotSafe
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.writing import bench_text
from vcfbench.testing.benches import open_simulated, serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.testing.benches import ServedLab

ROOT = Path(__file__).parents[2]

SCRIPT = """
import os, signal, sys
from pathlib import Path
from vcfbench.bench.bench import open_bench
from vcfbench.procedures.bench_file import load_bench
from vcfbench.clock import sleep

bench = open_bench(load_bench(Path(sys.argv[1])))
bench.power.configure_output("P25V", 10.0, 0.1)
bench.power.configure_output("N25V", -10.0, 0.1)
bench.power.enable_outputs()
bench.rate_source.configure_dc(0.5)
bench.rate_source.enable_output()
bench.rate_table.enable()
bench.rate_table.set_rate(50.0, 100.0)
sleep(bench.clock, 2.0)
print(bench, round(bench.rate_table.rate_deg_s()), flush=True)
"""
ENDS = {
    "the script raises": ("raise ValueError('a typo')", 1),
    "the script ends": ("", 0),
    "it leaves": ("sys.exit(7)", 7),
    "it is terminated": ("os.kill(os.getpid(), signal.SIGTERM)\nraise ValueError('too late')", 4),
    "its last reference is gone": ("bench = None\nprint('went on', flush=True)", 0),
}


@pytest.fixture(scope="module")
def lab() -> Iterator[ServedLab]:
    with serve_simulated() as served:
        yield served


def ended(lab: ServedLab, folder: Path, end: str, timeout_s: float = 20.0) -> subprocess.CompletedProcess[str]:
    bench = lab.on_wires()
    bench = structs.replace(bench, rate_source=structs.replace(bench.rate_source, timeout_s=timeout_s))
    (folder / "served.toml").write_text(bench_text(bench), encoding="utf-8")
    command = [sys.executable, "-W", "default", "-c", SCRIPT + end, str(folder / "served.toml")]
    while True:
        done = subprocess.run(  # noqa: S603
            command, capture_output=True, text=True, check=False, timeout=60, cwd=ROOT
        )
        if "leads the clock" not in done.stderr:  # the server has not yet seen that the one before has gone
            return done


def what_is_on(lab: ServedLab) -> list[str]:
    most = {"applied_rate_deg_s": 0.1, "rail.positive.voltage_v": 0.5, "rail.negative.voltage_v": 0.5, "node.v_vc": 0.1}
    seen = {name: lab.ask("get", name=name) for name in most}
    return [f"{name} {value}" for name, value in seen.items() if abs(value) > most[name]]


@pytest.mark.skipif(sys.platform == "win32", reason="a process sends itself a SIGTERM")
@pytest.mark.parametrize("how", few(ENDS, "it is terminated"))
def test_bench_open_when_python_ends_is_made_safe(lab: ServedLab, tmp_path: Path, how: str) -> None:
    end, code = ENDS[how]
    done = ended(lab, tmp_path, end)
    assert (done.stdout.split("\n")[0], done.returncode) == ("<Bench paper, open> 50", code), done.stderr
    when = how if how.startswith("its last") else "Python ended"
    assert f"vcfbench: bench paper was still open when {when}; it was made safe\n" in done.stderr
    assert ("ResourceWarning" in done.stderr) == how.startswith("its last")
    assert what_is_on(lab) == []


@pytest.mark.exhaustive
def test_unproved_end_of_python_is_code_five(lab: ServedLab, tmp_path: Path) -> None:
    end = """
from simrack.serve import Control
with Control(int(bench.description.served.control.rpartition(":")[2])) as control:
    control.request("fault", instrument="rate_source", kind="silent")
raise ValueError("a typo")
"""
    done = ended(lab, tmp_path, end, timeout_s=0.5)
    assert done.returncode == 5, done.stderr
    assert "ValueError: a typo" in done.stderr
    assert "NOT SAFE: rate_source at " in done.stderr
    assert what_is_on(lab) == []
    lab.ask("clear_faults")


def test_bench_outside_with_is_closed_once() -> None:
    bench = open_bench(load_bench(None))
    assert (repr(bench), bench.closed, bench.safe_reports) == ("<Bench paper, open>", False, [])
    bench.close()
    reports = list(bench.safe_reports)
    bench.close()
    assert (repr(bench), bench.closed) == ("<Bench paper, closed>", True)
    assert [report.safe for report in reports] == [True] * 5
    assert bench.safe_reports == reports


def test_unreferenced_bench_is_made_safe_with_warnings_as_errors(
    capsys: pytest.CaptureFixture[str],
) -> None:
    bench = open_bench(load_bench(None))
    holding = bench.holding
    with pytest.raises(ResourceWarning, match="<Bench paper, open> was never closed"):
        bench.__del__()
    assert holding.closed
    assert "still open when its last reference is gone; it was made safe" in capsys.readouterr().err


def test_closing_raises_what_is_not_safe_and_does_so_once() -> None:
    with pytest.raises(NotSafe, match="rate_table") as caught, open_simulated() as lab:  # noqa: PT012
        lab.bench.rate_table.enable()
        lab.bench.rate_table.set_rate(50.0, 100.0)
        lab.fault("rate_table", "silent")
        with pytest.raises(NotSafe):
            lab.bench.close()
        lab.bench.close()
        raise NotSafe("rate_table: that was all")
    assert caught.value.what == "rate_table: that was all"


def test_a_bench_may_be_opened_first_and_entered_later() -> None:
    bench = open_bench(load_bench(None))
    with pytest.raises(Aborted, match="stopped by the test"), bench as entered:  # noqa: PT012
        assert entered is bench
        raise Aborted("stopped by the test")
    assert bench.closed


@pytest.mark.parametrize("entered", [True, False])
def test_early_signals_do_not_end_making_safe(*, entered: bool) -> None:
    """Three of a nervous hand at once: the third came while the watchdog was told."""

    class Listening:
        def making_safe(self, longest_s: float) -> None:
            told.append(longest_s > 5.0)
            for _ in range(3):
                signal.raise_signal(signal.SIGINT)

        def leave(self, *, safe: bool) -> None:
            told.append(safe)

    told: list[bool] = []
    bench = open_bench(load_bench(None))
    bench.holding.watchdog = cast("Any", Listening())
    bench.holding.reserve = mmap(-1, 4096)
    with bench if entered else nullcontext():
        bench.rate_table.enable()
        bench.rate_table.set_rate(50.0, 100.0)
    bench.close()
    assert all(each.safe for each in bench.safe_reports)
    assert len(bench.safe_reports) == 5
    assert told == [True, True]
    assert bench.holding.reserve.closed
