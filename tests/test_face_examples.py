"""The examples in the docstrings of the public names: each runs as it stands, in the order of the page of the API."""

from __future__ import annotations

import doctest
import re
import runpy
import shutil
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Annotated, Any

import pytest
from msgspec import Meta

import vcfbench
from tests.records.test_devices import CERTIFICATE
from vcfbench.clock import ScaledClock, VirtualClock, WallClock, sleep
from vcfbench.procedures.layers import settings_of
from vcfbench.records.devices import DeviceStore
from vcfbench.testing import open_simulated

ROOT = Path(__file__).parents[1]
QUICK = {"rates_deg_s": [10, 0, -10], "samples": 3}
LABORATORY = """
[laboratory]
name = "Gyro Lab"
address = "2 Station Road, York"
country = "GB"

[acceptance]
scale_factor_v_per_deg_s = [-0.0127, -0.0124]
"""
SECONDS = ("write_report", "study", "StudyResult", "load_study")
MINUTES = ("validate", "Validation")
"""Names whose examples take that long; those that take minutes are not run."""
EXAMPLE = re.compile(r"^```pycon\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@cache
def examples() -> dict[str, str]:
    """The examples of each public name, as the page of the API shows them."""
    page: str = runpy.run_path(str(ROOT / "docs" / "make_api.py"))["api_page"]()
    _, *parts = re.split(r"^### (?:class )?(\w+)$", page, flags=re.MULTILINE)
    return {name: "\n".join(EXAMPLE.findall(part)) for name, part in zip(parts[::2], parts[1::2], strict=True)}


class Heard:
    """An observer that keeps events, and stops the run at the step `until`."""

    def __init__(self, until: int = 0) -> None:
        self.until = until
        self.events: list[vcfbench.Event] = []

    def handle(self, event: vcfbench.Event) -> None:
        self.events.append(event)
        if isinstance(event, vcfbench.StepStarted) and event.number == self.until:
            raise KeyboardInterrupt


def given(folder: Path) -> dict[str, Any]:
    """Make the files in `folder`, and the names, with which the examples begin as the head of the page says."""
    shutil.copy(ROOT / "examples" / "paper-table1.csv", folder)
    draw = Random(1).gauss  # noqa: S311
    for name, head in (("rest", "gyro_z / (deg/s)"), ("imu", "gx,gy,gz")):
        rates = (",".join([f"{draw(0.0, 0.1):.4f}"] * (1 + head.count(","))) for _ in range(500))
        Path(folder, f"{name}.csv").write_text(f"{head}\n" + "\n".join(rates), "utf-8")
    turned = [[rate * (axis == each) for each in range(3)] for axis in range(3) for rate in (-100.0, 0.0, 100.0)]
    axes = [f"{x},{y},{z},{1e-4 * x - 0.0125 * z - 0.04 + draw(0.0, 1e-5):.6f}" for x, y, z in turned]
    warm = [(at_c, rate) for at_c in (-20.0, 0.0, 25.0, 50.0, 70.0) for rate in (-100.0, 100.0)]
    over = [f"{rate},{rate * (-0.0125 + 1e-6 * at_c):.6f},{at_c}" for at_c, rate in warm]
    for name, head, rows in (
        ("axes", "x_deg_s,y_deg_s,z_deg_s,output_v", axes),
        ("over-temperature", "rate_deg_s,output_v,temperature_c", over),
    ):
        Path(folder, f"{name}.csv").write_text("\n".join([head, *rows]), "utf-8")
    Path(folder, "lab.toml").write_text((ROOT / "vcfbench/station/paper.toml").read_text("utf-8") + LABORATORY, "utf-8")
    DeviceStore(folder / "devices").add(CERTIFICATE)
    heard = Heard()
    who = {"dut": "G-0042", "operator": "A. Person"}
    run = vcfbench.run("turntable", "lab.toml", seed=3, settings=QUICK, observers=[heard], metadata=who)
    with pytest.raises(vcfbench.Aborted) as stopped:
        vcfbench.run("turntable", "lab.toml", seed=3, settings=QUICK, observers=[Heard(until=20)], runs="broken-off")
    return {
        "vcfbench": vcfbench,
        "open_simulated": open_simulated,
        "dataclass": dataclass,
        "Annotated": Annotated,
        "Meta": Meta,
        "run": run,
        "events": heard.events,
        "stopped": stopped.value.run,
        "ScaledClock": ScaledClock,
        "VirtualClock": VirtualClock,
        "WallClock": WallClock,
        "sleep": sleep,
        "settings": settings_of(vcfbench.PROCEDURES["turntable"], vcfbench.load_bench("lab.toml")),
    }


def mistakes(shown: dict[str, str], folder: Path) -> dict[str, str]:
    """What is wrong with the examples of each name, nothing for those that run as they stand."""
    begun, parser, runner = given(folder), doctest.DocTestParser(), doctest.DocTestRunner(optionflags=FLAGS)
    wrong: dict[str, str] = {}
    for name, text in shown.items():
        with ExitStack() as stack:
            stack.enter_context(suppress(vcfbench.NotSafe))
            names = dict(begun)
            if re.search(r"\b(lab|bench)\b", text):
                names["lab"] = stack.enter_context(open_simulated("ideal", seed=1))
                names["bench"] = names["lab"].bench
            told: list[str] = []
            if runner.run(parser.get_doctest(text, names, name, None, None), out=told.append).failed:
                wrong[name] = "".join(told)
    return wrong


def test_every_public_name_has_an_example() -> None:
    assert [name for name, text in examples().items() if ">>> " not in text] == []


def test_examples_of_public_names_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert mistakes({name: text for name, text in examples().items() if name not in MINUTES + SECONDS}, tmp_path) == {}


@pytest.mark.exhaustive
def test_dear_examples_of_public_names_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shown = examples()
    assert mistakes({name: shown[name] for name in SECONDS}, tmp_path) == {}
