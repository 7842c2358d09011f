"""``vcfbench run turntable`` with each language of rate tables: the same result within the table's own resolution."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

from tests.drivers.rate_table import DIALECTS
from vcfbench.cli.main import app
from vcfbench.drivers.rate_table.dialect import TableSettings, spoken
from vcfbench.station.file import embedded_text
from vcfbench_tables import language

STEPS = 640000 / 360
RATES = (20.0, 10.0, 5.0, 0.0, -5.0, -10.0, -20.0)


def bench_file(dialect: str) -> str:
    steps = f"\nsteps_per_deg = {STEPS}" if dialect == "zaber" else ""
    text = embedded_text("ideal").replace('dialect = "acl"', f'dialect = "{dialect}"{steps}')
    return text.replace(
        "[procedure.drive]", f"[procedure]\nrates_deg_s = {list(RATES)}\nsamples = 2\n[procedure.drive]"
    )


def run(file: Path, runs: Path) -> dict[str, Any]:
    command = ["run", "turntable", "--bench", str(file), "--json", "--quiet", "--runs", str(runs)]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    values: dict[str, Any] = json.loads(result.stdout)
    return values


@pytest.mark.parametrize("dialect", few(DIALECTS, "acl", "aaaa"))
def test_the_result_is_the_gyroscope_s_whatever_the_table_speaks(dialect: str, tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(bench_file(dialect), encoding="utf-8")
    scale_factor = run(file, tmp_path)["results"]["scale_factor"]["value"]
    quantum = spoken(dialect, TableSettings(steps_per_deg=STEPS))[0].rate_quantum_deg_s
    assert scale_factor == pytest.approx(-0.012542052, rel=max(1e-9, quantum / 2 / max(RATES)))


@pytest.mark.exhaustive
def test_paper_rates_run_on_table_that_stops_in_between(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(embedded_text("ideal").replace('dialect = "acl"', 'dialect = "ruya"'), encoding="utf-8")
    assert run(file, tmp_path)["results"]["scale_factor"]["value"] == pytest.approx(-0.012542052, rel=1e-9)


def test_a_profile_beside_the_bench_file(tmp_path: Path) -> None:
    file = Path(__file__).parents[2] / "examples" / "own-table" / "bench.toml"
    assert run(file, tmp_path)["results"]["scale_factor"]["value"] == pytest.approx(-0.012542052, rel=1e-9)


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        (None, "lab.toml: expected a profile of a rate table, there is no such file"),
        ("title = 1", "lab.toml: title: expected a text of 1 to 60 characters on one line, got 1"),
    ],
)
def test_unusable_profile_is_exit_code_2(profile: str | None, words: str, tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(bench_file("lab.toml"), encoding="utf-8")
    if profile is not None:
        (tmp_path / "lab.toml").write_text(profile, encoding="utf-8")
    result = CliRunner().invoke(app, ["run", "turntable", "--bench", str(file), "--runs", str(tmp_path)])
    assert result.exit_code == 2
    assert words in " ".join(result.output.split())


def test_a_dialect_that_there_is_not(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(bench_file("zabre"), encoding="utf-8")
    result = CliRunner().invoke(app, ["run", "turntable", "--bench", str(file), "--runs", str(tmp_path)])
    assert result.exit_code == 2
    assert "rate_table.dialect: expected a text: one of acl, aaaa, atl, dd16, esp" in " ".join(result.output.split())


def test_the_page_names_every_dialect_and_command() -> None:
    text = (Path(__file__).parents[2] / "docs" / "rate-tables.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in (*DIALECTS, *language.COMMANDS))


def test_record_keeps_text_of_custom_profile(tmp_path: Path) -> None:
    folder = Path(__file__).parents[2] / "examples" / "own-table"
    run(folder / "bench.toml", tmp_path)
    header = json.loads(next(tmp_path.glob("*/*.jsonl")).read_text(encoding="utf-8").splitlines()[0])
    assert header["table_profile"] == (folder / "table.toml").read_text(encoding="utf-8")
