"""The example project, as its owner would run it."""

from __future__ import annotations

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from simrack_tests.cells import few

from tests.testing.test_plugin import run
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.fault_scripts import read_script
from vcfbench.studies.file import read_study
from vcfbench.studies.one_run import PlannedRun, perform

ROOT = Path(__file__).parents[1]
LAB = ROOT / "examples" / "lab-tests"
OWN = ROOT / "examples" / "own-instrument"
HYSTERESIS = ROOT / "examples" / "own-procedure"


@pytest.mark.exhaustive
def test_the_labs_tests_pass_away_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    folder = tmp_path / "lab"
    shutil.copytree(LAB, folder, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    done = run(folder, "-q")
    assert done.returncode == 0, done.stdout
    passed = re.search(r"(\d+) passed in", done.stdout)
    assert passed is not None
    assert int(passed[1]) >= 14
    assert "skipped" not in done.stdout


def installed(project: Path, folder: Path) -> Path:
    """Put a project where an installation would put it, with the entry points of its ``pyproject.toml``."""
    parsed = tomllib.loads((project / "pyproject.toml").read_text("utf-8"))["project"]
    name = parsed["name"].replace("-", "_")
    about = folder / f"{name}-{parsed['version']}.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {parsed['name']}\nVersion: {parsed['version']}\n", "utf-8"
    )
    groups = (
        f"[{group}]\n" + "".join(f"{model} = {where}\n" for model, where in entries.items())
        for group, entries in parsed["entry-points"].items()
    )
    (about / "entry_points.txt").write_text("\n".join(groups), "utf-8")
    shutil.copytree(project / "acme", folder / "acme", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.mark.exhaustive
def test_an_instrument_of_ones_own_is_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its tests pass, and a calibration runs with it."""
    site = installed(OWN, tmp_path / "site")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]))
    folder = tmp_path / "project"
    shutil.copytree(OWN, folder, ignore=shutil.ignore_patterns("__pycache__", ".*", "acme"))
    done = run(folder, "-q")
    assert "6 passed" in done.stdout, done.stdout
    command = [sys.executable, "-m", "vcfbench", "run", "turntable", "--bench", "lab.toml", "--json", "--quiet"]
    ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    assert ran.returncode == 0, ran.stderr
    results = json.loads(ran.stdout)["results"]
    assert results["scale_factor"]["value"] == pytest.approx(-0.01254, rel=1e-3)


@pytest.mark.exhaustive  # three interpreters
def test_a_procedure_of_ones_own_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its test passes away from here; it is short, and a name on the command line."""
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    folder = tmp_path / "own"
    shutil.copytree(HYSTERESIS, folder, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    done = run(folder, "-q")
    assert "2 passed" in done.stdout, done.stdout
    assert len((folder / "hysteresis.py").read_text("utf-8").splitlines()) <= 60
    command = [sys.executable, "-m", "vcfbench", "run", "./hysteresis.py", "--set", "rates_deg_s=0,50,100"]
    ran = subprocess.run(  # noqa: S603
        [*command, "--set", "samples=5", "--quiet"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    assert [line.split()[0] for line in ran.stdout.splitlines()[2:5]] == ["0", "50", "100"]


def test_the_labs_files_are_what_they_say() -> None:
    station = load_bench(LAB / "lab.toml")
    assert not station.simulated
    for script in (LAB / "faults").glob("*.toml"):
        assert read_script(script).faults


STUDIES = ROOT / "examples" / "studies"


def test_every_study_has_a_test() -> None:
    assert {file.stem for file in STUDIES.glob("*.toml")} == {"readings", "generator", "split", "match-points"}


@pytest.mark.parametrize("name", few(["readings", "generator", "split", "match-points"], "readings"))
def test_the_studies_can_be_done(name: str) -> None:
    """Every case of them is checked, and the last one run for one seed."""
    study = read_study(STUDIES / f"{name}.toml")
    cases = list(study.check())
    row = perform(PlannedRun(study.of(cases[-1].number), study.seeds[0]))
    assert row.status == "complete", row.message
    assert any(name.endswith(".z") for name in row.metrics)


def test_the_data_set_has_one_record_of_each_procedure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "records"))
    make = importlib.import_module("make")
    assert sorted(make.procedures()) == sorted(BUILT_IN)
    (run,) = make.make(tmp_path / "set", ("polarity",))
    assert (run.status, run.metadata.dut, run.directory.parent) == ("complete", "G-001", tmp_path / "set" / "runs")
    assert (tmp_path / "set" / "README.md").read_text("utf-8").startswith("# Twenty-one records")
