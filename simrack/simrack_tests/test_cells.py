"""Cells of matrices: which are kept, and each exhaustive test is in one sixth."""

from __future__ import annotations

from typing import Any

import pytest

from simrack_tests.cells import few, of_other_sixths


@pytest.mark.parametrize(("kept", "every"), [([], None), ([], 3), ([4], 3), ([1, 6], None)])
def test_named_and_spaced_cells_are_kept(kept: list[int], every: int | None) -> None:
    rows = few(range(7), *kept, every=every)
    assert [row.values for row in rows] == [(cell,) for cell in range(7)]
    spaced = [] if every is None else [0, 3, 6]
    assert [row.values[0] for row in rows if not row.marks] == sorted({*kept, *spaced})


@pytest.mark.exhaustive
def test_each_exhaustive_test_is_in_one_sixth(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    items: list[Any] = request.session.items
    asked = [item for item in items if item.get_closest_marker("exhaustive") is not None]
    drawn = []
    for sixth in range(6):
        monkeypatch.setenv("EXHAUSTIVE_SIXTH", str(sixth))
        drawn += [item for item in asked if item not in of_other_sixths(items)]
    assert asked
    assert sorted(drawn, key=id) == sorted(asked, key=id)
    monkeypatch.delenv("EXHAUSTIVE_SIXTH")
    assert of_other_sixths(items) == []
