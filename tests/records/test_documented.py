"""docs/records.md names every line, field and kind that a journal has, and no other."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.procedures.fakes import FakeBench, MemoryJournal, make_settings
from tests.steps.test_long_window import acquire, plan
from tests.test_pause import Presser
from vcfbench.records.journal import read_journal
from vcfbench.records.schema import CHUNK_READINGS, CHUNK_S, FORMAT, Point, Status
from vcfbench.steps import Acquire, ConfigureMeter, ConfigureRail, RailReading, Reading, SetVvc, VvcSetting
from vcfbench.steps.decode import result_of, step_of
from vcfbench.steps.executor import Executor
from vcfbench.steps.replay import start_up_again
from vcfbench.steps.step import Step, StepResult

if TYPE_CHECKING:
    from collections.abc import Mapping

PAGE = (Path(__file__).parents[2] / "docs" / "records.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def rows(title: str) -> dict[str, str]:
    """Return the rows of the table of a section: first cell without its quotes, and the others."""
    found = re.findall(r"^\| `?([^|`]+?)`? \| (.*) \|$", section(title), re.MULTILINE)
    return {first: others for first, others in found if first not in {"field", "kind", "part"}}


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Return lines of every type: those of a run that pauses, of a long window, and of one that fails."""
    runs = tmp_path_factory.mktemp("runs")
    Presser(36).run("turntable", runs=runs)
    [journal] = runs.glob("*/journal.jsonl")
    memory, made = MemoryJournal(), FakeBench()
    made.multimeter.overload_at = 70
    Executor(made, memory).execute(plan(acquire(60, 1.0)))
    Executor(FakeBench(), memory).execute(plan(acquire(90, 1.0)))
    Executor(FakeBench(), memory).restore(start_up_again([ConfigureMeter(10.0, 10.0)], make_settings()))
    made.multimeter.readings = 0
    Executor(made, memory).execute(plan(acquire(90, 1.0)))
    return [*map(json.loads, journal.read_text(encoding="utf-8").splitlines()), *memory.lines]


@pytest.mark.parametrize("kind", ["header", "step", "readings", "restored", "paused", "went_on", "error", "footer"])
def test_each_field_of_a_line_is_described(kind: str, lines: list[dict[str, Any]]) -> None:
    described = rows(kind)
    always = {name for name, words in described.items() if "only where" not in words}
    of_kind = [set(line) | {"utc", "seal"} for line in lines if line["type"] == kind]
    assert of_kind
    for fields in of_kind:
        assert always <= fields <= set(described)


def _fields(kind: type[Any]) -> list[str]:
    struct = getattr(kind, "__struct_fields__", None)  # the project's own; dataclasses are those of others
    return [each.name for each in dataclasses.fields(kind)] if struct is None else list(struct)


@pytest.mark.parametrize(("title", "kinds"), [("Steps", Step.kinds), ("Results", StepResult.kinds)])
def test_each_kind_is_described_with_its_fields_and_their_units(title: str, kinds: Mapping[str, type[Any]]) -> None:
    shipped = {name: kind for name, kind in kinds.items() if kind.__module__.startswith("vcfbench.steps")}
    described = rows(title)
    assert set(described) == set(shipped)
    for name, kind in shipped.items():
        fields = re.findall(r"`([a-z_0-9]+)`", described[name])
        assert fields == _fields(kind), name
        for field in fields:
            unit = _unit(field)
            assert not unit or f"`{field}` ({unit})" in described[name], (name, field)


def _unit(field: str) -> str:
    """Return the unit that the end of a field's name stands for."""
    units = {"deg_s2": "deg/s^2", "deg_s": "deg/s", "deg": "deg", "hz": "Hz", "v": "V", "a": "A", "s": "s"}
    return next((unit for end, unit in units.items() if field.endswith(f"_{end}")), "")


@pytest.mark.parametrize(
    ("part", "kind"),
    [("reading", Reading), ("point", Point), ("rail of a step", ConfigureRail), ("rail of a result", RailReading)],
)
def test_each_part_is_described(part: str, kind: type[Any]) -> None:
    assert re.findall(r"`([a-z_0-9]+)`", rows("Parts")[part]) == _fields(kind)


def test_the_numbers_of_the_page_are_those_of_the_program() -> None:
    assert f"**format {FORMAT}**" in PAGE
    assert f"has {CHUNK_READINGS} readings or its first is {CHUNK_S:g} s old" in " ".join(PAGE.split())


def test_the_example_is_a_record(tmp_path: Path) -> None:
    (tmp_path / "j").write_text(section("Example").split("```\n")[1], encoding="utf-8")
    record = read_journal(tmp_path / "j")
    assert (record.status, record.damage) == (Status.INCOMPLETE, None)
    assert (step_of(record.steps[0]), result_of(record.steps[0])) == (SetVvc(0.25), VvcSetting(0.25))
    assert isinstance(step_of(record.chunks[-1]), Acquire)
    assert len(record.chunks[-1]["readings"]) == 2
