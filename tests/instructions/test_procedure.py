"""A procedure is one object."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from msgspec import Meta, defstruct

from vcfbench.errors import ConfigError, PlanError
from vcfbench.instructions.procedure import Procedure
from vcfbench.procedures.catalogue import PROCEDURES, procedure
from vcfbench.procedures.turntable import TURNTABLE
from vcfbench.procedures.virtual_coriolis.plan import VIRTUAL_CORIOLIS
from vcfbench.station.layering import require_defaults
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


@pytest.mark.parametrize(
    ("expected", "default", "said"),
    [
        (Annotated[int, Meta(ge=1, le=9)], 0, "a whole number at least 1 and at most 9, got 0"),
        (Annotated[int, Meta(ge=1, le=9)], True, "a whole number at least 1 and at most 9, got true"),
        (Annotated[float, Meta(gt=0)], "1", "a number above 0, got '1'"),
        (float, None, "a number, got nothing"),
        (Literal[1, 10], 3, "'?1'? or '?10'?, got 3"),
        (Annotated[tuple[float, ...], Meta(min_length=2)], (1.0,), r"a list, got tuple \(1.0,\)"),
        (tuple[float, ...], ("1",), "a number, got '1'"),
        (str, 3, "a text, got 3"),
    ],
)
def test_a_default_outside_of_its_own_type_is_refused(expected: Any, default: Any, said: str) -> None:
    own = defstruct("Own", [("loops", expected, default)], bases=(ProcedureSettings,), frozen=True)
    with pytest.raises(ConfigError, match=rf"procedure 'own': default of loops.*: expected {said}"):
        Procedure(name="own", title="Own.", settings=own, plan=print, results=print)
    Procedure(
        name="own",
        title="Own.",
        settings=defstruct("Own", [("loops", int, np.int64(3))], bases=(ProcedureSettings,), frozen=True),
        plan=print,
        results=print,
    )


def test_defaults_of_what_comes_along_are_within_their_types() -> None:
    kinds = {PROCEDURES[name].settings for name in PROCEDURES}
    own = [defstruct(f"Own{kind.__name__}", [], bases=(kind,), frozen=True) for kind in kinds]
    for kind in own:
        require_defaults(kind, "")
