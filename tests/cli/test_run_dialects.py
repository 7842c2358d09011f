"""``vcfbench run turntable`` with each language of rate tables: the same result within the table's own resolution."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from typer.testing import CliRunner

from vcfbench.bench.file import embedded_text
from vcfbench.cli.main import app
from vcfbench.drivers.rate_table.dialects import DIALECTS, spoken

if TYPE_CHECKING:
    from pathlib import Path

STEPS = 640000 / 360
RATES = (20.0, 10.0, 5.0, 0.0, -5.0, -10.0, -20.0)


def bench_file(dialect: str) -> str:
    steps = f"\nsteps_per_deg = {STEPS}" if dialect == "zaber" else ""
    text = embedded_text("ideal").replace('dialect = "acl"', f'dialect = "{dialect}"{steps}')
    return text.replace(
        "[procedure.drive]", f"[procedure]\nrates_deg_s = {list(RATES)}\nsamples = 2\n[procedure.drive]"
    )


def run(file: Path, *arguments: str) -> dict[str, Any]:
    command = ["run", "turntable", "--bench", str(file), "--json", "--quiet", "--runs", str(file.parent), *arguments]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    values: dict[str, Any] = json.loads(result.stdout)
    return values


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_result_is_the_gyroscope_s_whatever_the_table_speaks(dialect: str, tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(bench_file(dialect), encoding="utf-8")
    scale_factor = run(file)["results"]["scale_factor"]["value"]
    quantum = spoken(dialect, steps_per_deg=STEPS).dialect.rate_quantum_deg_s
    assert scale_factor == pytest.approx(-0.012542052, rel=max(1e-9, quantum / 2 / max(RATES)))


def test_all_of_the_paper_s_rates_over_a_table_that_must_stop_in_between(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(embedded_text("ideal").replace('dialect = "acl"', 'dialect = "ruya"'), encoding="utf-8")
    assert run(file)["results"]["scale_factor"]["value"] == pytest.approx(-0.012542052, rel=1e-9)


def test_a_profile_beside_the_bench_file(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(bench_file("lab.toml"), encoding="utf-8")
    (tmp_path / "lab.toml").write_text(
        """
title = "a controller of its own"
evidence = "none: a test"
twin = "esp"
link = { baud = 19200, tx_end = "\\r" }
units = { rate_quantum = 1e-4, rate_max = 400 }
refusals = { query = "TE?", good = "0" }
[commands]
identify = [{ send = "VE?", expect = "version" }]
enable = [{ send = "1MO" }]
disable = [{ send = "1MF" }]
set_accel = [{ send = "1AC{acc:.4f};1AG{acc:.4f}" }]
load_rate = [{ send = "1VA{abs_rate:.4f}" }]
start = [{ send = "1MV{dir}" }]
stop = [{ send = "1ST" }]
read_pos = [{ send = "1TP", expect = "number" }]
read_rate = [{ send = "1TV", expect = "number" }]
status = [{ send = "1MO?", expect = "number" }]
[replies]
version = { pattern = '(?P<model>ESP\\d+) Version (?P<firmware>.*)' }
number = { pattern = '(?P<value>[-+.\\d]+)' }
[fields]
position = { from = "read_pos", group = "value" }
rate = { from = "read_rate", group = "value" }
[status]
enabled = { from = "status", group = "value", in = [1], type = "decimal" }
""".replace("rate_max = 400 }", 'rate_max = 400, positive = "+", negative = "-" }'),
        encoding="utf-8",
    )
    assert run(file)["results"]["scale_factor"]["value"] == pytest.approx(-0.012542052, rel=1e-9)


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        (None, "lab.toml: expected a readable profile of a rate table: No such file or directory"),
        ("title = 1", "lab.toml: title: expected a text, came 1"),
    ],
)
def test_a_profile_that_cannot_be_used_ends_with_exit_code_2(profile: str | None, words: str, tmp_path: Path) -> None:
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
    assert "rate_table.dialect: expected a text: one of acl, zaber, atl, esp" in " ".join(result.output.split())
