"""A bench of nothing but successors: the whole calibration, in one process and over TCP, and who is found there."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

from tests.cli.test_run_served import QUICK, answer, serving
from tests.successors import BENCH
from vcfbench.cli.main import app

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bench with few rates."""
    path = tmp_path_factory.mktemp("successors") / "bench.toml"
    path.write_text(BENCH.read_text(encoding="utf-8").replace("\n[procedure.drive]", QUICK), encoding="utf-8")
    return path


def test_discovery_writes_every_one_of_them_into_a_bench_file() -> None:
    done = CliRunner().invoke(app, ["bench", "discover", "--library", f"{BENCH}?speed=max@vcfbench"])
    assert done.exit_code == 0, done.output
    found = [line for line in done.stdout.splitlines() if line.startswith("model = ")]
    assert sorted(found) == [f'model = "{model}"' for model in ("2000", "33522B", "DSOX3024A", "E36312A")]


@pytest.mark.parametrize("procedure", few(["turntable", "virtual-coriolis"]))
def test_calibration_over_tcp_has_bytes_of_process(procedure: str, bench: Path, tmp_path: Path) -> None:
    alone = answer(tmp_path, procedure, "--bench", str(bench), "--seed", "7")
    assert alone["status"] == "complete"
    with serving(bench, "--wires", "tcp", "--seed", "7") as served:
        over_tcp = answer(tmp_path, procedure, "--bench", str(served))
    for each in (alone, over_tcp):
        each.pop("equipment", None)  # it says on which wires the instruments are
    assert json.dumps(over_tcp) == json.dumps(alone)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "other"), [("2000", "DMM6500"), ("33522B", "33622A"), ("33522B", "33509B"), ("DSOX3024A", "DSOX4104A")]
)
def test_so_does_one_with_another_of_them(model: str, other: str, bench: Path, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(bench.read_text(encoding="utf-8").replace(f'"{model}"', f'"{other}"'), encoding="utf-8")
    test_calibration_over_tcp_has_bytes_of_process("virtual-coriolis", path, tmp_path)
