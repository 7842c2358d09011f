"""The table of docs/howto/own-table.md: checked, turned, and carrying the simulated gyroscope."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from simrack_tests.ports import free_port
from typer.testing import CliRunner

from tests import warm
from vcfbench.cli.main import app

if TYPE_CHECKING:
    from collections.abc import Iterator

    from typer.testing import Result

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "own-table"
PAGE = (ROOT / "docs" / "howto" / "own-table.md").read_text("utf-8")


@contextmanager
def standing_in(*control: str) -> Iterator[str]:
    """Run the stand-in; give its address."""
    command = [sys.executable, EXAMPLE / "stand_in.py", "0", *control]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdout is not None
        try:
            yield process.stdout.readline().rpartition(" ")[2].strip()
        finally:
            process.kill()


def shown(name: str, folder: Path, address: str = "") -> Path:
    """Write a file that the page shows and the example has, with the address of the stand-in."""
    found = re.search(rf'title="{name}"\n(.*?)```', PAGE, re.DOTALL)
    assert found is not None
    assert (EXAMPLE / name).read_text("utf-8").endswith(found[1])
    (folder / name).write_text(found[1].replace("socket://127.0.0.1:4001", address), "utf-8")
    return folder / name


def at_leisure(profile: Path, span_s: float) -> None:
    """Let the rate be taken from angles `span_s` apart, and less exactly: a busy machine asks late."""
    slowly = f'rate = {{ differentiate = "position", span_s = {span_s} }}\n[at_rate]\ntolerance_deg_s = 2'
    profile.write_text(profile.read_text("utf-8").replace('group = "deg" }', f'group = "deg" }}\n{slowly}'), "utf-8")


def done(command: str, **paths: Path) -> Result:
    for name, path in paths.items():
        command = command.replace(f"{name}.toml", path.as_posix())
    return CliRunner().invoke(app, shlex.split(command)[1:])


@pytest.fixture
def station(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Write the two files of the page, with the address of a stand-in; return the bench file."""
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    shown("corner.toml", tmp_path)
    with standing_in() as address:
        yield shown("station.toml", tmp_path, address)


@pytest.mark.exhaustive
def test_own_table_is_checked_and_turned_by_its_stand_in(station: Path) -> None:
    at_leisure(station.with_name("corner.toml"), 0.25)
    station.write_text(station.read_text("utf-8") + "rate_tolerance_deg_s = 2\n", "utf-8")
    check, talk = re.findall(r"^(vcfbench .*--bench station.toml.*)$", PAGE, re.MULTILINE)
    checked, turned = done(check, station=station), done(talk, station=station)
    assert (checked.exit_code, turned.exit_code) == (0, 0), checked.stderr + turned.stderr
    assert re.search(r"rate_table +ok .*table in the corner", checked.stdout)
    assert "can run: no procedure: each needs other instruments" in checked.stdout
    assert "cannot run" not in checked.stdout
    rate = re.search(r"^\+([\d.]+) deg/s, [\d.]+ deg$", turned.stdout, re.MULTILINE)
    assert rate is not None, turned.stdout
    assert float(rate[1]) == pytest.approx(10.0, abs=2.0)


@pytest.mark.exhaustive
def test_table_without_a_limit_is_stopped(station: Path) -> None:
    text = station.read_text("utf-8").replace("max_acceleration_deg_s2 = 20", "max_acceleration_deg_s2 = 2000")
    station.write_text(text, "utf-8")
    profile = station.with_name("corner.toml")
    text = profile.read_text("utf-8").replace("rate_max", "acceleration_max = 100\nrate_max")
    text = text.replace("load_rate", 'set_accel = [{ send = "A {acc:.1f}", expect = "ok" }]\nload_rate')
    profile.write_text(text, "utf-8")
    checked = done("vcfbench bench check --bench station.toml", station=station)
    assert checked.exit_code == 0, checked.stderr


@pytest.mark.exhaustive  # at real time
def test_a_simulated_gyroscope_turns_on_the_stand_in(tmp_path: Path) -> None:
    """The rate of the world, 20 times faster here, is that of the stand-in; its angle is looked at in real time."""
    at_leisure(shown("corner.toml", tmp_path), 1.0)
    bench, port = tmp_path / "served.toml", str(free_port())
    command = f"vcfbench sim serve --bench ideal --speed 20 --control-port {port} --write-bench {bench}"
    with warm.running(shlex.split(command), tmp_path) as process, standing_in(port) as address:
        assert process.stdout.readline()
        table = f'[rate_table]\ndialect = "corner.toml"\nresource = "{address}"\n\n'
        text = re.sub(r"\[rate_table\]\n.*?\n\n", table, bench.read_text("utf-8"), flags=re.DOTALL)
        assert text.endswith(f'[served]\ncontrol = "127.0.0.1:{port}"\n')
        bench.write_text(f'{text}clock = "wall"\n', "utf-8")
        found = re.search(r"`(vcfbench run turntable --bench served.toml .*?)`", " ".join(PAGE.split()))
        assert found is not None
        quickly = "--set settle_s=0.2 --set sample_interval_s=0.3 --set nplc=1 --set rate_tolerance_deg_s=3"
        run = done(f"{found[1]} --json --quiet {quickly} --runs {tmp_path.as_posix()}", served=bench)
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["simulated"] is True
    assert json.loads(run.stdout)["results"]["scale_factor"]["value"] == pytest.approx(-0.012542, rel=1e-3)
