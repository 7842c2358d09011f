"""Cells of matrices: each exhaustive test is in one fourth."""

from __future__ import annotations

from typing import Any

import pytest

from simrack_tests.cells import of_other_fourths


@pytest.mark.exhaustive
def test_each_exhaustive_test_is_in_one_fourth(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    items: list[Any] = request.session.items
    asked = [item for item in items if item.get_closest_marker("exhaustive") is not None]
    drawn = []
    for fourth in range(4):
        monkeypatch.setenv("EXHAUSTIVE_FOURTH", str(fourth))
        drawn += [item for item in asked if item not in of_other_fourths(items)]
    assert asked
    assert sorted(drawn, key=id) == sorted(asked, key=id)
    monkeypatch.delenv("EXHAUSTIVE_FOURTH")
    assert of_other_fourths(items) == []
