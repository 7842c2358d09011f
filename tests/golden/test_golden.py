"""Points, steps, results and replies have the bytes whose hashes are kept in ``hashes.json``.

They are made anew by ``python -m tests.golden``.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few

from tests.cli.test_run_served import everywhere, needs_ptys, require_wires, serving
from tests.evaluation import require_raised
from tests.golden.cases import (
    HASHES,
    MODELS,
    RUNS,
    WIRED,
    WIRES,
    GoldenRun,
    arithmetic,
    jobs,
    replies_hash,
    wired_bench,
    wired_hashes,
)
from tests.procedures.parts import values
from vcfbench.version import EVALUATION

if TYPE_CHECKING:
    from pathlib import Path

GOLDEN = json.loads(HASHES.read_text(encoding="utf-8"))
FAST = (
    *(("turntable", "ideal"), ("virtual-coriolis", "paper"), ("polarity", "paper")),
    ("self-calibration", "ideal"),
)

QUICK_MODELS = ("e3631a", "e36312a", "keysight33622a", "keysight34465a", "keithley2000", "dmm6500", "dsox3024a")


@pytest.fixture
def same_arithmetic() -> None:
    """Skip where last digits may differ."""
    differing = {name: (GOLDEN["made_with"][name], here) for name, here in arithmetic().items()}
    differing = {name: both for name, both in differing.items() if both[0] != both[1]}
    if differing:
        words = ", ".join(f"{name} {there}, here {here}" for name, (there, here) in differing.items())
        pytest.skip(f"the hashes were made with {words}")


def test_every_procedure_model_and_seed_has_a_hash() -> None:
    assert {section: set(parts) for section, parts in jobs().items()} == {
        section: set(GOLDEN[section]) for section in jobs()
    }


def test_results_are_kept_by_the_evaluation_that_records_name() -> None:
    """Neither is changed without the other."""
    assert GOLDEN["evaluation"] == values.evaluation() == EVALUATION
    require_raised(EVALUATION - 1, ["turntable"])
    require_raised(EVALUATION, [])
    with pytest.raises(SystemExit, match=f"raise EVALUATION .* to {EVALUATION + 1}"):
        require_raised(EVALUATION, ["turntable"])


@pytest.mark.parametrize(
    "run", few(RUNS, *(GoldenRun(name, bench, 0) for name, bench in FAST)), ids=lambda run: run.key
)
def test_a_run_has_the_same_bytes(run: GoldenRun) -> None:
    """The points everywhere; what is worked out of them has the last digits of its processor."""
    differing = [name for name, here in arithmetic().items() if GOLDEN["made_with"][name] != here]
    if differing == ["machine"]:
        assert run.hashes()["points"] == GOLDEN["runs"][run.key]["points"]
    elif differing:
        pytest.skip(f"the hashes were made with another {', '.join(differing)}")
    else:
        assert run.hashes() == GOLDEN["runs"][run.key]


@pytest.mark.usefixtures("same_arithmetic")
@pytest.mark.parametrize("model", few(MODELS, *QUICK_MODELS))
def test_an_instrument_answers_in_the_same_bytes(model: str) -> None:
    assert replies_hash(model) == GOLDEN["replies"][model]


@pytest.mark.exhaustive
@needs_ptys
@pytest.mark.usefixtures("same_arithmetic")
@pytest.mark.parametrize(
    ("procedure", "wires", "bench"),
    [
        (procedure, wires, ("paper", "ideal")[(row + column) % 2])
        for row, procedure in enumerate(WIRED)
        for column, wires in enumerate(WIRES)
    ],
)
def test_run_over_wires_has_bytes_of_run_in_process(procedure: str, wires: str, bench: str, tmp_path: Path) -> None:
    with serving(wired_bench(tmp_path, bench), *everywhere(wires), "--seed", "7") as served:
        require_wires(served, wires)
        assert wired_hashes(procedure, served, seed=None) == GOLDEN["wired"][f"{procedure} {bench}"]
