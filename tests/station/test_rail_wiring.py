"""Where the rails are connected goes by the supply's model, and is said wherever somebody connects them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.cells import few
from vcfbench.cli.main import app
from vcfbench.models import MODELS, models_for, rail_terminals
from vcfbench.station.file import embedded_text
from vcfbench.station.new_station import Draft

ROOT = Path(__file__).parents[2]
WIRED = {
    "E3631A": "positive rail to + of +-25V, negative rail to - of +-25V, ground to COM",
    "E36312A": "positive rail to + of output 2, negative rail to - of output 3, "
    "ground to - of output 2 and + of output 3",
}
"""By the terminals on the boxes: the E36312A's outputs are all positive and float."""
SUPPLIES = models_for("power")


def bench(folder: Path, model: str) -> str:
    """Write a simulated bench with that supply."""
    text = embedded_text("paper").replace('model = "E3631A"', f'model = "{model}"')
    (folder / "station.toml").write_text(text, encoding="utf-8")
    return str(folder / "station.toml")


def test_each_supply_has_its_terminals() -> None:
    assert {row.name for row in MODELS if row.terminals} == set(SUPPLIES) == set(WIRED)
    for model in SUPPLIES:
        assert rail_terminals(model, None, "P25V", "N25V") == f"{model}: {WIRED[model]}"
    assert "positive rail to + of output 1" in rail_terminals("E36312A", None, "P6V", "N25V")
    assert rail_terminals("EDU36311A", "E36312A", "P25V", "N25V") == f"E36312A: {WIRED['E36312A']}"
    assert "measure both rails at the plug" in rail_terminals("PL330T", None, "P25V", "N25V")


@pytest.mark.parametrize("model", few(SUPPLIES, "E36312A"))
def test_pages_and_commands_and_the_new_bench_file_say_it(model: str, tmp_path: Path) -> None:
    file, said = bench(tmp_path, model), f"{model}: {WIRED[model]}"
    draft = Draft("new.toml")
    draft.add_instrument("power", {"model": model, "resource": "GPIB0::5::INSTR"})
    assert f"\n# {said}\n" in draft.text("Written by a test.")
    for command in (["bench", "check", "--bench", file], ["run", "power", "--dry-run", "--bench", file]):
        assert f"wiring: {said}\n" in CliRunner().invoke(app, command).stdout
        assert json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)["wiring"] == said
    text = (ROOT / "docs" / "howto" / "wiring.md").read_text(encoding="utf-8").replace("**", "")
    (row,) = (line for line in text.splitlines() if f"| {model} |" in line)
    assert WIRED[model] in row


def test_first_pages_warn_of_reversed_output_3() -> None:
    for page in ("README.md", "docs/safety.md"):
        text = " ".join((ROOT / page).read_text(encoding="utf-8").replace("**", "").split()).lower()
        assert "output 3" in text
        assert "connected the other way round, its plus terminal to ground" in text
        assert "howto/wiring.md" in text


def test_a_bench_without_a_supply_says_nothing_of_rails() -> None:
    draft = Draft("new.toml")
    draft.add_instrument("multimeter", {"model": "34401A", "resource": "GPIB0::22::INSTR"})
    assert "rail to" not in draft.text("x")
