"""The page of the fault matrix is made of docs/evidence/fault-matrix.json, whole and without a wrong cell."""

from __future__ import annotations

import runpy
from pathlib import Path

from tests.faults.matrix import LANGUAGES, MODES, MOMENTS, WIRES, all_cases

MADE = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "make_faults.py"))
fault_page, page, read_cells = (MADE[name] for name in ("fault_page", "page", "read_cells"))

KEYS = ("language", "moment", "wires", "mode", "lasting")


def test_page_has_each_language() -> None:
    assert all(f"| `{language}` |" in fault_page() for language in LANGUAGES)


def test_it_counts_the_cells_of_the_matrix() -> None:
    assert f" {len(all_cases())} cells " in fault_page()


def test_the_cells_are_those_of_the_matrix_each_once() -> None:
    cells = [tuple(cell[key] for key in KEYS) for cell in read_cells() if "no fault" not in cell["mode"]]
    assert len(cells) == len(set(cells))
    assert set(cells) <= {tuple(getattr(case, key) for key in KEYS) for case in all_cases()}
    assert {cell[4] for cell in cells} == {True, False}
    for place, names in enumerate((LANGUAGES, MOMENTS, WIRES, MODES)):
        assert {cell[place] for cell in cells} == set(names)


def test_only_cells_whose_fault_struck_count() -> None:
    assert all(cell["begun"] and cell["hit"] for cell in read_cells())


def test_no_cell_is_wrong_and_all_that_hear_are_safe() -> None:
    cells = read_cells()
    assert not [cell for cell in cells if cell["wrong"]]
    assert all(cell["at_rest_and_off"] for cell in cells if cell["hears"])


def test_a_wrong_cell_is_shown() -> None:
    cells = read_cells()
    shown = page([{**cells[0], "wrong": ["the table turns"], "at_rest_and_off": False}, *cells[1:]])
    assert "## What is wrong" in shown
    assert ": the table turns" in shown
