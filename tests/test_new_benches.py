"""Each procedure runs to its end on a bench file that `bench new` writes with nothing but what it insists on."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from typer.testing import CliRunner

import vcfbench
from tests.cells import few
from vcfbench.cli.main import app
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.models import MODELS, languages
from vcfbench.procedures.bench_file import load_bench
from vcfbench.runs.needs import what_can_run
from vcfbench.station.file import embedded_text
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from vcfbench.testing import ServedLab

RACK = embedded_text("lab").partition("\n[simulation]")[0] + '\n[simulation]\nparameters = "paper"\n'
BY_CERTIFICATE = ("self-calibration", "online")
ORDER = [*(name for name in BUILT_IN if name not in BY_CERTIFICATE), *BY_CERTIFICATE]
"""Those that need the certificate of `kvc` come after it."""
STANDS_FOR = {"power": "E3631A", "rate_source": "33220A", "multimeter": "34401A", "oscilloscope": "DSO7104B"}
SETS = [
    "E3631A",  # all as the paper has it
    *(model.name for model in MODELS if STANDS_FOR.get(model.roles[0], model.name) != model.name),
    *(language for language in languages() if language not in {"acl", "zaber"}),
    "no v_vc_meter",
    "no oscilloscope",
]
"""What is not as on the embedded bench `lab`: another model, another table, or an instrument that is not there."""


def rack(other: str) -> str:
    """Return the bench `lab` with another model or language in its place, or without a role."""
    if other.startswith("no "):
        before, table, after = RACK.partition(f"[{other.removeprefix('no ')}]\n")
        assert table
        return before + after[after.index("\n[") + 1 :]
    if other in languages():
        return RACK.replace('dialect = "acl"', f'dialect = "{other}"')
    (model,) = (each for each in MODELS if each.name == other)
    return RACK.replace(f'"{STANDS_FOR[model.roles[0]]}"', f'"{other}"')


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def new_bench(served: ServedLab, where: Path) -> Path:
    """Write a bench file for what is served, by the latitude alone."""
    words = ["bench", "new", "new.toml", "--yes", "--served", str(served.control_port), "--set", "site.latitude_deg=48"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.stderr
    return where / "new.toml"


def ends(other: str, procedures: Sequence[str], where: Path) -> Iterator[tuple[str, str]]:
    """Run those procedures that the bench has instruments for; yield how each ended."""
    (where / "rack.toml").write_text(rack(other), encoding="utf-8")
    with serve_simulated(where / "rack.toml", seed=5) as served:
        bench = new_bench(served, where)
        lacking = what_can_run(load_bench(bench))
        for name in procedures:
            by: dict[str, Any] = {"dut": "G-1"} if name in {"kvc", *BY_CERTIFICATE} else {}
            if lacking[name] is None:
                try:
                    yield name, vcfbench.run(name, bench, metadata=by).status
                except vcfbench.BenchError as error:
                    yield name, str(error)


LONG = {"characterize", "online", "threshold"}
"""Minutes each; `python -m tests.test_new_benches` has them, and all others on every set of instruments."""
KEPT = {"33509B", "33622A", "34461A", "DSOX3024A"}
ALIKE = {model.name for model in MODELS if model.own is not None} - KEPT
"""Models that differ from others of these sets by a number."""
CELLS = [
    ("E36312A", ("turntable",)),
    ("no oscilloscope", ("virtual-coriolis",)),
    *(
        (other, ("polarity", "turntable" if other in languages() else "kvc"))
        for other in SETS[1:]
        if other not in ALIKE
    ),
]


@pytest.mark.parametrize(("other", "procedures"), few(CELLS[::3], CELLS[0]))
def test_each_procedure_runs_to_its_end_on_a_new_bench(other: str, procedures: Sequence[str], here: Path) -> None:
    found = dict(ends(other, procedures, here))
    assert {*found.values()} == {"complete"}, found


if __name__ == "__main__":
    for each in SETS:
        folder = Path(tempfile.mkdtemp())
        os.environ["VCFBENCH_LOCKS"] = str(folder / "locks")
        os.chdir(folder)
        for procedure, end in ends(each, ORDER, folder):
            print(each, procedure, end, flush=True)  # noqa: T201
