"""Models that other packages register, and what becomes of those that do not fit."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import TYPE_CHECKING

import pytest

from vcfbench.bench import own_models
from vcfbench.bench.file import embedded_text, parse_bench
from vcfbench.bench.guard import guard_of
from vcfbench.bench.own_models import own_twin
from vcfbench.drivers import installed
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.registry import DRIVERS, Registry, visa_driver
from vcfbench.errors import ConfigError, LimitError

if TYPE_CHECKING:
    from vcfbench.bench.description import BenchDescription


class Meter(Hp34401A):
    model = "M1"


@pytest.fixture(autouse=True)
def packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three models: one that fits, one whose package is broken, one that registers something else."""
    module = ModuleType("acme_of_a_test")
    module.DRIVER = visa_driver("M1", Meter)  # type: ignore[attr-defined]
    module.TWIN = Meter  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "acme_of_a_test", module)
    where = {"M1": "acme_of_a_test:DRIVER", "M2": "no_such_module:DRIVER", "M3": "acme_of_a_test:TWIN"}
    driver_points = [EntryPoint(name, value, "vcfbench.drivers") for name, value in where.items()]
    twin_points = [EntryPoint("M1", "acme_of_a_test:TWIN", "vcfbench.simulated")]
    twin_points.append(EntryPoint("M2", "no_such_module:TWIN", "vcfbench.simulated"))

    def found(group: str, name: str | None = None) -> list[EntryPoint]:
        points = driver_points if group == "vcfbench.drivers" else twin_points
        return [each for each in points if name in {None, each.name}]

    monkeypatch.setattr(installed, "entry_points", found)
    monkeypatch.setattr(own_models, "entry_points", found)


def bench(old: str, model: str) -> BenchDescription:
    return parse_bench(embedded_text("paper").replace(f'"{old}"', f'"{model}"', 1), "lab.toml")


def test_a_registered_model_fills_a_role() -> None:
    assert bench("34401A", "M1").multimeter.model == "M1"
    assert DRIVERS.find("M1").driver_class is Meter
    assert Registry().find("M1").driver_class is Meter


@pytest.mark.parametrize(
    ("old", "model", "said"),
    [
        ("34401A", "2000", "lab.toml: multimeter.model: expected '34401A' or 'M1' or 'M2' or 'M3', came '2000'"),
        ("33220A", "M1", "rate_source.model: expected '33220A', or a driver that has configure_dc, configure_sine"),
        ("34401A", "M2", "the driver of 'M2' (no_such_module:DRIVER) cannot be loaded: No module named"),
        ("34401A", "M3", "what is registered for 'M3' is no vcfbench.drivers.registry.Driver of that model"),
    ],
)
def test_a_model_that_does_not_fit_is_a_mistake_of_the_bench_file(old: str, model: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        bench(old, model)
    assert said in str(caught.value)


def test_twins_are_found_or_missed_by_name() -> None:
    assert own_twin("M1").device_class() is Meter
    with pytest.raises(ConfigError, match=r"the simulated M2 \(no_such_module:TWIN\) cannot be loaded"):
        own_twin("M2")
    with pytest.raises(ConfigError, match="there is no simulated M3"):
        own_twin("M3")


def test_of_a_language_that_is_not_known_only_questions_pass() -> None:
    guard = guard_of("multimeter", bench("34401A", "M1"))
    guard.judge("*IDN?;MEASURE?", str)
    for message in ("RANGE 10", "*IDN?;RANGE 10", "*TST?"):
        with pytest.raises(LimitError, match="cannot be judged"):
            guard.judge(message, str)
