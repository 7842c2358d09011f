"""The pytest plugin in projects of other people, each run by a pytest of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from textwrap import dedent

import pytest

ROOT = Path(__file__).parents[2]
PLUGIN = "vcfbench.testing.plugin"
WARNINGS = ("-W", "error")
INSTALLED = any(entry.value == PLUGIN for entry in entry_points(group="pytest11"))


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run pytest in `folder`; where the package's entry point is not installed the plugin is named."""
    named = () if INSTALLED else ("-p", PLUGIN)
    return subprocess.run(  # noqa: S603
        [
            sys.executable,
            "-m",
            "pytest",
            "-p",
            "no:cacheprovider",
            "-W",
            "error",
            "--strict-markers",
            *named,
            *arguments,
        ],
        cwd=folder,
        env={**os.environ, "PYTHONUTF8": "1", "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


def project(folder: Path, tests: str, ini: str = "") -> Path:
    (folder / "pytest.ini").write_text(f"[pytest]\n{dedent(ini)}", "utf-8")
    (folder / "test_it.py").write_text(dedent(tests), "utf-8")
    return folder


def outcomes(done: subprocess.CompletedProcess[str]) -> str:
    return done.stdout.strip().splitlines()[-1].partition(" in ")[0]


def test_importing_it_loads_nothing_of_the_package() -> None:
    code = (
        f"import sys, {PLUGIN}; print(*sorted(m for m in sys.modules if m.startswith(('vcfbench.', 'numpy', 'pyv'))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.split() == ["vcfbench.testing", PLUGIN]


@pytest.mark.exhaustive
def test_a_project_that_does_not_use_it_does_not_notice(tmp_path: Path) -> None:
    tests = """
    import sys
    def test_nothing_is_there(request):
        assert "vcfbench.testing.benches" not in sys.modules
        assert "numpy" not in sys.modules and "serial" not in sys.modules
        assert not any("vcfbench" in name for name in request.fixturenames)
    """
    assert outcomes(run(project(tmp_path, tests), "-q")) == "1 passed"


@pytest.mark.exhaustive
def test_fixtures_marks_and_ini_options(tmp_path: Path) -> None:
    tests = """
    import pytest
    from vcfbench.errors import MeasurementError, NotSafe
    from vcfbench.clock import sleep

    def test_ini(simulated_bench, simulated_world):
        assert simulated_bench.seed == 4
        assert simulated_bench.description.name == "ideal"
        assert simulated_world.parameters.site.latitude_deg == 12.5
        assert simulated_bench.description.simulation.errors.multimeter == "drawn"

    @pytest.mark.vcfbench(seed=9, bench="paper", errors="none", overrides={"site": {"latitude_deg": 1.0}})
    class TestMarked:
        def test_class(self, simulated_bench, simulated_world):
            assert simulated_bench.seed == 9
            assert simulated_bench.description.name == "paper"
            assert simulated_bench.description.simulation.errors.multimeter == "none"
            assert simulated_world.parameters.site.latitude_deg == 1.0

        @pytest.mark.vcfbench(seed=10)
        def test_nearest(self, simulated_bench):
            assert (simulated_bench.seed, simulated_bench.description.name) == (10, "paper")

    def test_fault(simulated_bench, fault):
        simulated_bench.multimeter.configure_dc_voltage(10.0, 10.0)
        fault("multimeter", "overload", at_s=5.0, duration_s=2.0)
        simulated_bench.multimeter.read_voltage_v()
        sleep(simulated_bench.clock, 6.0)
        with pytest.raises(MeasurementError):
            simulated_bench.multimeter.read_voltage_v()
        sleep(simulated_bench.clock, 6.0)
        simulated_bench.multimeter.read_voltage_v()

    @pytest.mark.vcfbench(faults="faults.toml")
    def test_script(simulated_bench):
        simulated_bench.multimeter.configure_dc_voltage(10.0, 10.0)
        with pytest.raises(MeasurementError):
            simulated_bench.multimeter.read_voltage_v()

    def test_lost_links_end_with_the_test(simulated_bench, fault):
        fault("rate_table", "unreachable")

    def test_several(open_simulated_bench):
        seeds = []
        for seed in (1, 2):
            with open_simulated_bench(seed=seed) as lab:
                seeds.append(lab.bench.seed)
        assert seeds == [1, 2]
        with pytest.raises(NotSafe), open_simulated_bench() as lab:
            lab.fault("rate_table", "unreachable")

    def test_served(served_bench):
        assert served_bench.resource("multimeter").startswith("TCPIP0::127.0.0.1::")
        assert served_bench.seed == 4
        assert served_bench.ask("now") >= 0.0

    def test_protocol(expected_exchange):
        from vcfbench.testing import over_visa
        with expected_exchange(over_visa(lambda session: session), [("*OPC?", "1")]) as session:
            assert session.query("*OPC?") == "1"
    """
    ini = """
    vcfbench_bench = ideal
    vcfbench_seed = 4
    vcfbench_errors = drawn
    vcfbench_overrides =
        site.latitude_deg = 12.5
    """
    folder = project(tmp_path, tests, ini)
    (folder / "faults.toml").write_text('[[fault]]\ninstrument = "multimeter"\nkind = "overload"\n', "utf-8")
    done = run(folder, "-q")
    assert outcomes(done) == "9 passed", done.stdout


@pytest.mark.exhaustive
def test_what_cannot_be_is_told(tmp_path: Path) -> None:
    wrong = {
        "seeds=3": "the mark is vcfbench(bench=None",
        "3": "the mark is vcfbench(bench=None",
        'bench="none.toml"': "none.toml: expected a bench file, there is no such file",
        'parameters="mine"': "parameters: expected 'ideal' or 'paper', got 'mine'",
        'seed="x"': "seed: expected a whole number, got 'x'",
        'speed="x"': "--speed x: expected a number",
        'faults="none.toml"': "none.toml",
        "faults=\"[[fault]]\\ninstrument = 'kettle'\\nkind = 'silent'\"": "the bench has no 'kettle'",
        'overrides={"supply": {"dead_v": 99.0}}': "simulation.override: expected supply.dead_v at most brown_out_v",
    }
    tests = "".join(
        f"@pytest.mark.vcfbench({mark})\ndef test_{number}(simulated_bench): ...\n" for number, mark in enumerate(wrong)
    )
    done = run(project(tmp_path, f"import pytest\n{tests}"), "-q")
    assert outcomes(done) == f"{len(wrong)} errors"
    assert "plugin.py" not in done.stdout  # where it was seen helps nobody
    assert [words for words in wrong.values() if words not in done.stdout] == []
