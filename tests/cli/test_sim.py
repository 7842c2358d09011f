from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from typer.testing import CliRunner

from vcfbench.cli.main import app
from vcfbench.station.file import embedded_text, template

if TYPE_CHECKING:
    from pathlib import Path


def shown(*arguments: str) -> dict[str, dict[str, Any]]:
    done = CliRunner().invoke(app, ["sim", "show", "--json", *arguments])
    assert done.exit_code == 0, done.stderr
    rows = json.loads(done.stdout)["parameters"]
    by_path = {row["path"]: row for row in rows}
    assert len(by_path) == len(rows)
    return by_path


def test_every_parameter_has_a_unit_a_meaning_and_a_source() -> None:
    for path, row in shown().items():
        assert row["unit"] or isinstance(row["value"], bool | str), path
        assert row["meaning"], path
        assert row["source"], path


def test_physics_and_the_errors_of_every_instrument_are_there() -> None:
    groups = {path.split(".")[1] for path in shown() if path.startswith("errors.")}
    assert groups == {"power", "rate_source", "multimeter", "oscilloscope", "rate_table"}
    assert shown()["override.sense_anti_phase.quality"]["value"] == 1224


def test_drawn_errors_follow_the_seed_and_chosen_ones_do_not() -> None:
    first, again, other = shown("--seed", "1"), shown("--seed", "1"), shown("--seed", "2")
    assert first == again
    changed = {path.split(".")[1] for path in first if first[path] != other[path]}
    assert changed == {"power", "multimeter", "oscilloscope", "rate_table"}
    assert first["errors.multimeter.gain_error"]["source"] == "drawn from the published accuracy by seed 1"
    assert first["errors.rate_source.dac_bits"]["source"] == "chosen in the bench file"
    ideal = shown("--bench", "ideal")
    assert ideal["errors.multimeter.gain_error"]["source"] == "none: a perfect instrument"


def test_an_instrument_more_changes_nothing_for_the_others(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    more = '\n[vibration_source]\nmodel = "33220A"\nresource = "GPIB0::10::INSTR"\n'
    path.write_text(embedded_text("paper") + more, "utf-8")
    before, after = shown(), shown("--bench", str(path))
    assert {name: after[name] for name in before} == before
    assert any(name.startswith("errors.vibration_source.") for name in after)


def test_the_bench_file_overrides_single_values_and_sets_the_latitude(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    text = embedded_text("paper").replace("latitude_deg = 37.9", "latitude_deg = 31.0")
    path.write_text(text + "\n[simulation.override]\noutput_stage.offset_v = 0.125\n", "utf-8")
    values = shown("--bench", str(path))
    assert values["override.output_stage.offset_v"]["value"] == 0.125
    assert values["override.output_stage.offset_v"]["source"] == "chosen in the bench file"
    assert values["override.drive_mode.quality"]["source"].startswith("Wang et al.")
    assert values["override.site.latitude_deg"]["value"] == 31.0


def test_people_are_shown_the_same() -> None:
    done = CliRunner().invoke(app, ["sim", "show"])
    assert done.exit_code == 0
    assert "\noverride.drive_mode.frequency_hz = 3488.9 Hz\n    resonance at the reference temperature (" in done.stdout
    assert all(f"\n{path} = " in done.stdout for path in shown())


def test_a_real_bench_has_nothing_to_show(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(template(), "utf-8")
    done = CliRunner().invoke(app, ["sim", "show", "--bench", str(path)])
    assert done.exit_code == 2
    assert done.stderr == "vcfbench: lab-1: expected a bench with a table [simulation]\n"
