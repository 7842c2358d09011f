"""Other multimeters than the 34401A in its place: a run in one process and over real wires gives the same bytes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from tests.cli.test_run_served import QUICK, answer, serving
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from pathlib import Path

LIKE_34410A = '34410A"\nlike = "34401A'
MARKS = {"tcp": "::SOCKET", "vxi11": "::inst0::INSTR", "hislip": "::hislip0,"}


def bench(folder: Path, model: str) -> Path:
    """Write the paper bench with few rates and another meter."""
    path = folder / "bench.toml"
    text = embedded_text("paper").replace("\n[procedure.drive]", QUICK)
    path.write_text(text.replace('"34401A"', f'"{model}"', 1), encoding="utf-8")
    return path


@pytest.mark.exhaustive
@pytest.mark.parametrize(("model", "wire"), [("34461A", "vxi11"), ("34465A", "hislip"), (LIKE_34410A, "tcp")])
def test_run_over_each_wire_of_meter_gives_same_bytes(tmp_path: Path, model: str, wire: str) -> None:
    path = bench(tmp_path, model)
    alone = answer(tmp_path, "virtual-coriolis", "--bench", str(path), "--seed", "7")
    with serving(path, "--wires", wire, "--seed", "7") as served:
        assert MARKS[wire] in load_bench(served).multimeter.resource
        over_wire = answer(tmp_path, "virtual-coriolis", "--bench", str(served))
    assert json.dumps(over_wire) == json.dumps(alone)


@pytest.mark.exhaustive
def test_the_resolution_is_that_of_the_meter_in_use(tmp_path: Path) -> None:
    resolutions = {}
    for model in ("34401A", "34461A", "34465A", LIKE_34410A):
        answer(tmp_path / "runs", "turntable", "--bench", str(bench(tmp_path, model)), "--seed", "7")
        (run,) = (tmp_path / "runs").iterdir()
        header = json.loads((run / "journal.jsonl").read_text(encoding="utf-8").splitlines()[0])
        resolutions[model] = header["settings"]["station"]["meter_resolution_v"]
        run.rename(tmp_path / f"done-{len(resolutions)}")
    at_nplc_1 = {"34401A": 3e-5, "34461A": 3e-5, "34465A": 3e-6, LIKE_34410A: 3e-5}
    assert resolutions == pytest.approx(at_nplc_1)
