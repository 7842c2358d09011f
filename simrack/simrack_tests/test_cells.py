"""Cells of matrices: each exhaustive test is in one sixth."""

from __future__ import annotations

from typing import Any

import pytest

from simrack_tests.cells import of_other_sixths


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
