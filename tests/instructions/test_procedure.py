"""A procedure is one object."""

from __future__ import annotations

import re
from typing import Any

import pytest

from vcfbench.errors import ConfigError, PlanError
from vcfbench.instructions.procedure import Procedure
from vcfbench.procedures.catalogue import PROCEDURES, procedure
from vcfbench.procedures.turntable import TURNTABLE
from vcfbench.procedures.virtual_coriolis.plan import VIRTUAL_CORIOLIS
from vcfbench.station.settings import ProcedureSettings

TEXTS = {"name", "title", "method", "in_one_piece"}


def test_the_catalogue_finds_procedures_by_their_names() -> None:
    assert procedure("turntable") is TURNTABLE
    assert procedure("virtual-coriolis") is VIRTUAL_CORIOLIS
    with pytest.raises(PlanError, match="there is no procedure 'spin'; known are turntable, virtual-coriolis"):
        procedure("spin")


@pytest.mark.parametrize(
    ("name", "needs", "uses"),
    [
        ("turntable", ["multimeter", "rate_table"], ["power", "oscilloscope", "rate_source"]),
        ("virtual-coriolis", ["rate_source", "multimeter", "rate_table"], ["power", "oscilloscope", "v_vc_meter"]),
    ],
)
def test_papers_procedures_use_papers_instruments(name: str, needs: list[str], uses: list[str]) -> None:
    assert [*PROCEDURES[name].needs] == needs
    assert [*PROCEDURES[name].uses] == uses


def test_a_procedure_is_shown_by_its_name() -> None:
    assert repr(TURNTABLE) == "<Procedure turntable>"


def test_what_was_done_is_told_in_whole_words() -> None:
    """A word that was broken at the end of a line of code is none in a report."""
    broken = {name: re.findall(r"[a-z]+- [a-z]+", str(PROCEDURES[name].method)) for name in PROCEDURES}
    assert {name: words for name, words in broken.items() if words} == {}


@pytest.mark.parametrize("odd", [None, 3, "plan", 1.5, ["plan"]])
@pytest.mark.parametrize("field", sorted({*Procedure.__struct_fields__} - {"watched"}))
def test_a_part_of_another_type_is_refused_by_name(field: str, odd: Any) -> None:
    if (odd is None and field in {"entry", "in_turn"}) or (odd == "plan" and field in TEXTS):
        return
    parts = {"name": "own", "title": "Own.", "settings": ProcedureSettings, "plan": print, "results": print}
    with pytest.raises(ConfigError, match=f"procedure .*: ({field}: expected|expected {field})"):
        Procedure(**{**parts, field: odd})
