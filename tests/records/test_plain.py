"""Results of any procedure become JSON without a word of their own."""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import Enum
from pathlib import PurePosixPath
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.characters import CHARACTERS
from vcfbench.errors import ConfigError
from vcfbench.records.plain import ReadOnly, plain, read_only


class Direction(Enum):
    UP = "up"


@dataclass(frozen=True, slots=True)
class Loop:
    width_v: Any
    direction: Direction = Direction.UP


class Fit(msgspec.Struct, frozen=True):
    slope: float
    loops: tuple[Loop, ...] = ()


def test_dataclasses_and_structs_are_objects_by_their_fields() -> None:
    came = plain(Fit(0.5, (Loop(1), Loop(None))))
    assert came == {
        "slope": 0.5,
        "loops": [{"width_v": 1, "direction": "up"}, {"width_v": None, "direction": "up"}],
    }
    assert list(came) == ["slope", "loops"]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.float64(0.1), 0.1),
        (np.float32(0.5), 0.5),
        (np.int64(3), 3),
        (np.bool_(True), True),  # noqa: FBT003  # numpy's own
        (np.array([[1.0, 2.0], [3.0, 4.0]]), [[1.0, 2.0], [3.0, 4.0]]),
        (np.array([]), []),
        (np.array(2.5), 2.5),
        (np.str_("text"), "text"),
        ({10.0: np.int8(1), Direction.UP: 2}, {"10.0": 1, "up": 2}),
        ({3, 1}, [1, 3]),
        (PurePosixPath("a/b"), "a/b"),
        (datetime(2026, 8, 21, tzinfo=UTC), "2026-08-21 00:00:00+00:00"),
    ],
)
def test_numbers_and_arrays_of_numpy_are_numbers_and_lists(value: object, expected: object) -> None:
    came = plain(Loop(value))["width_v"]
    assert came == expected
    assert type(came) is type(expected)
    assert json.loads(msgspec.json.encode(came)) == expected


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (Loop(float("nan")), "results.width_v: expected a finite number or None, got nan"),
        (Fit(0.0, (Loop([0.0, np.inf]),)), r"results.loops\[0\].width_v\[1\]: expected a finite number.*got inf"),
        (np.array([1.0, np.nan]), r"results\[1\]: expected a finite number"),
        (Loop(1j), "results.width_v: expected numbers, texts, lists, or a frozen dataclass of them, got a complex"),
        (Loop(np.complex128(1j)), "got a complex128"),
        (Loop(Loop), "results.width_v: .* got a type"),
        (Loop(object()), "got a object"),
        ({(1, 2): 3}, "results: expected keys that are texts or numbers, got a tuple"),
        (Loop(1 << 64), "results.width_v: expected a whole number of 64 bits"),
    ],
)
def test_what_is_no_number_is_refused_by_its_name(value: object, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        plain(value)


NUMBERS = (
    st.none() | st.booleans() | st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**63), 2**63 - 1)
)
VALUES = st.recursive(
    NUMBERS | st.text(CHARACTERS),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(CHARACTERS), inner),
    max_leaves=20,
)


@given(VALUES)
def test_plain_values_stay_as_they_are(value: Any) -> None:
    assert plain(value) == value
    assert plain(read_only(value)) == value
    assert read_only(value) == read_only(pickle.loads(pickle.dumps(read_only(value))))  # noqa: S301  # ours


def test_what_is_read_only_cannot_be_changed() -> None:
    stored = ReadOnly({"a": {"b": [1, {"c": 2}]}})
    assert stored["a"]["b"][1]["c"] == 2
    assert stored == {"a": {"b": (1, {"c": 2})}}
    with pytest.raises(TypeError):
        stored["a"]["b"] = 3
    with pytest.raises(TypeError):
        stored["a"]["b"][0] = 3
