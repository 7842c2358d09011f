"""docs/records.md names every line, field and kind that a journal has, and no other."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

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

PAGE = (Path(__file__).parents[2] / "docs" / "records.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    return re.split(r"\n##+ ", re.split(rf"\n##+ {title}\n", PAGE)[1])[0]


def rows(title: str) -> dict[str, str]:
    """Return the rows of the table of a section: each name in the first cell, and the words of its row."""
    found = re.findall(r"^\| ([^|]+?) \| (.*) \|$", section(title), re.MULTILINE)
    return {name: words for first, words in found for name in re.findall(r"[a-z_0-9]+(?: [a-z ]+)?", first)}


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
    always = {name for name, words in described.items() if not words.endswith("optional")} - {"field"}
    of_kind = [set(line) | {"utc", "seal"} for line in lines if line["type"] == kind]
    assert of_kind
    for fields in of_kind:
        assert always <= fields <= set(described) | set(rows("Every line")) | set(rows("Lines of a step"))


def _fields(kind: type[Any]) -> list[str]:
    struct = getattr(kind, "__struct_fields__", None)  # the project's own; dataclasses are those of others
    return [each.name for each in dataclasses.fields(kind)] if struct is None else list(struct)


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
