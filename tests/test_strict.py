"""What is wrong in nested values is said with its place, as far as keys lead to it."""

from __future__ import annotations

from typing import Any

import pytest

from vcfbench.errors import ConfigError
from vcfbench.strict import converted


@pytest.mark.parametrize(
    ("kind", "raw", "keys"),
    [
        (dict[str, int], {"a": "x"}, ()),
        (dict[str, tuple[float, ...]], {"a": ["x"]}, ()),
        (tuple[dict[str, int], ...], [{"a": 1}, {"a": "x"}], (1,)),
        (dict[str, dict[str, list[int]]], {"a": {"b": [1, "x"]}}, ()),
    ],
)
def test_a_mistake_in_a_mapping_is_one_error(kind: Any, raw: Any, keys: tuple[str | int, ...]) -> None:
    with pytest.raises(ConfigError, match="expected") as caught:
        converted(raw, kind, repr)
    assert str(caught.value).startswith(f"{keys!r}: ")
