"""Rows of models: those that come along, those that other packages bring, and what becomes of rows that do not fit."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import TYPE_CHECKING

import pytest
from msgspec import to_builtins
from msgspec.structs import replace

from tests.drivers.rate_table import OF_PLUGIN
from vcfbench import models
from vcfbench.bench.check import check_bench
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings
from vcfbench.drivers.registry import find_driver
from vcfbench.errors import ConfigError
from vcfbench.models import (
    LANGUAGES,
    MODELS,
    Model,
    TableLanguage,
    bare_model,
    driver_of,
    find_language,
    find_model,
    resolve,
    twin_of,
)
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.turntable import TURNTABLE
from vcfbench.sim.simulation import twins
from vcfbench.specifications import HP_34401A
from vcfbench.station.discovery import recognise
from vcfbench.station.file import embedded_text
from vcfbench.typed import typed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.station.description import BenchDescription


@pytest.mark.parametrize("row", [*MODELS, *LANGUAGES], ids=lambda row: row.name)
def test_every_error_of_twin_can_be_set(row: Model | TableLanguage) -> None:
    kind = resolve(row.twin).errors_class
    none = kind.none()
    assert typed(to_builtins(none), kind) == none


class Meter(Hp34401A):
    model = "M1"


class Twin:
    errors_class = dict


METERS = " or ".join(f"'{row.name}'" for row in MODELS if "multimeter" in row.roles)
"""Those that come along, as messages list them."""


@pytest.fixture(autouse=True)
def packages(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Three models: one that fits, one whose package is broken, one that registers something else."""
    module = ModuleType("acme_of_a_test")
    module.MODEL = Model("M1", ("multimeter",), driver=Meter, twin=Twin, makers=("ACME",))  # type: ignore[attr-defined]
    module.LANGUAGE = TableLanguage(  # type: ignore[attr-defined]
        "acme",
        twin="simrack.rate_tables.atl:AtlTable",
        dialect="vcfbench_tables.atl:AtlDialect",
    )
    module.TWIN = Twin  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "acme_of_a_test", module)
    where = {
        "M1": "acme_of_a_test:MODEL",
        "M2": "no_such_module:MODEL",
        "M3": "acme_of_a_test:TWIN",
        "acme": "acme_of_a_test:LANGUAGE",
    }
    points = [EntryPoint(name, value, "vcfbench.models") for name, value in where.items()]

    def found(group: str) -> list[EntryPoint]:
        assert group == "vcfbench.models"
        return points

    monkeypatch.setattr(models, "entry_points", found)
    models._installed.cache_clear()
    yield
    models._installed.cache_clear()


def bench(old: str, new: str) -> BenchDescription:
    return parse_bench(embedded_text("paper").replace(old, new, 1), "lab.toml")


@pytest.mark.parametrize("row", MODELS, ids=lambda row: row.name)
def test_what_a_row_names_is_there(row: Model) -> None:
    assert find_driver(row.name).model == driver_of(row).model == row.name
    assert twin_of(row).errors_class.none() is not None
    assert set(row.roles) <= set(models.ROLES)
    maker, model, *_ = row.answers["*IDN?"].split(",")
    assert row.recognises(maker, model)
    assert recognise(row.answers["*IDN?"]) == row.name
    assert not row.recognises("ACME", model)


@pytest.mark.parametrize("row", [*LANGUAGES, *OF_PLUGIN], ids=lambda row: row.name)
def test_what_a_language_names_is_there(row: TableLanguage) -> None:
    assert resolve(row.twin).errors_class is not None
    if row.dialect is not None:
        dialect: TableDialect = resolve(row.dialect)(TableSettings(steps_per_deg=1000.0))
        assert dialect.rate_quantum_deg_s > 0.0


def test_names_are_given_once() -> None:
    names = [row.name for row in (*MODELS, *LANGUAGES, *OF_PLUGIN)]
    assert len(set(names)) == len(names)


def test_rows_load_no_driver_and_no_simulation() -> None:
    code = "import sys, vcfbench.models as m; m.find_model('34401A'); print([n for n in sys.modules if n.startswith("
    code += "('vcfbench.drivers', 'vcfbench.sim', 'vcfbench.bench', 'numpy', 'pyvisa'))])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603 - our own interpreter and words
    assert done.stdout.strip() == "[]"


def test_installed_packages_are_looked_through_for_strange_names_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bench of known instruments never waits for that: some milliseconds."""
    asked: list[str] = []
    monkeypatch.setattr(models, "entry_points", lambda group: asked.append(group) or [])
    models._installed.cache_clear()
    assert find_language("34401A") is None
    assert models.find_model("acl") is None
    assert not asked
    assert models.find_model("34499Z") is None
    assert asked == ["vcfbench.models"]


def test_a_registered_model_fills_a_role() -> None:
    assert bench('"34401A"', '"M1"').multimeter.model == "M1"
    assert find_driver("M1").driver_class is Meter
    assert twins(bench('"34401A"', '"M1"'))["multimeter"] is Twin


def test_a_registered_model_is_discovered_like_one_that_comes_along() -> None:
    assert recognise("ACME,M1,7,1.0") == "M1"
    assert recognise("ACME,M9,7,1.0") is None


def test_a_registered_language_is_one_that_bench_files_know() -> None:
    assert bench('"acl"', '"acme"').rate_table.dialect == "acme"
    assert find_language("acme") is not None


def test_model_with_same_commands_is_one_line() -> None:
    described = bench('"34401A"', '"34410A"\nlike = "34401A"')
    driver = find_driver("34410A", described.multimeter.like).driver_class
    assert driver.model == "34410A"
    assert issubclass(driver, Hp34401A)
    assert twins(described)["multimeter"].__name__ == "Hp34401ATwin"


@pytest.mark.parametrize("model", [row.name for row in MODELS if "chamber" not in row.roles])
def test_the_simulated_instrument_in_its_place_bears_its_name(model: str) -> None:
    """A driver that checks who answers opens it, in every role of a simulated bench."""
    row = find_model(model)
    assert row is not None
    role = row.roles[0]
    described = bench(f'[{role}]\nmodel = "{_at(role)}"', f'[{role}]\nmodel = "{model}X"\nlike = "{model}"')
    checked = check_bench(described)
    assert checked.failure() is None, checked
    (seen,) = [each.identity for each in checked.instruments if each.role == role]
    assert seen is not None
    assert bare_model(seen.model) == f"{model}X".upper()


def _at(role: str) -> str:
    """Return the model of the paper bench in `role`."""
    return str(getattr(parse_bench(embedded_text("paper"), "lab.toml"), role).model)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            '"34401A"',
            '"2010"',
            f"lab.toml: multimeter.model: expected {METERS} or 'M1', or",
        ),
        ('"33220A"', '"M1"', "rate_source.model: expected '33220A' or '33509B'"),
        (
            '"34401A"',
            '"X"\nlike = "33220A"',
            f"multimeter.like: expected {METERS} or 'M1', got '33220A'",
        ),
        ('"34401A"', '"M2"', "the model 'M2' (no_such_module:MODEL) cannot be loaded: No module named"),
        ('"34401A"', '"M3"', "the entry registered for 'M3' (acme_of_a_test:TWIN) is not a row of vcfbench.models"),
        ('"acl"', '"M1"', "rate_table.dialect: expected a text: one of acl, acme"),
    ],
)
def test_unfit_model_is_a_mistake_of_the_bench_file(old: str, new: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        bench(old, new)
    assert said in str(caught.value)


def test_a_model_without_a_twin_serves_on_real_benches_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["acme_of_a_test"], "MODEL", Model("M1", ("multimeter",), driver=Meter))
    assert find_model("M1") is not None
    with pytest.raises(ConfigError, match="there is no simulated M1"):
        twins(bench('"34401A"', '"M1"'))


def test_meter_without_data_sheet_is_refused() -> None:
    with pytest.raises(ConfigError, match="the resolution of a M1 is not known") as caught:
        settings_of(TURNTABLE, bench('"34401A"', '"M1"'))
    assert "name a data sheet" in str(caught.value)


def test_unknown_integration_time_is_a_mistake_of_the_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = Model(
        "M1", ("multimeter",), driver=Meter, twin=Twin, specifications=replace(HP_34401A, resolution={1.0: 1e-6})
    )
    monkeypatch.setattr(sys.modules["acme_of_a_test"], "MODEL", row)
    with pytest.raises(ConfigError, match=r"procedure\.nplc: a 34401A integrates over 1 cycles, not 10"):
        settings_of(TURNTABLE, bench('"34401A"', '"M1"'))
