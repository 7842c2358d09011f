"""What a record says of its run beside what was measured."""

from __future__ import annotations

import pickle
from datetime import date
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.characters import CHARACTERS
from vcfbench.errors import ConfigError
from vcfbench.interfaces import Identity
from vcfbench.records.metadata import Equipment, RunMetadata, equipment_of, metadata_from, metadata_of

KEYS = st.from_regex(r"\A[A-Za-z0-9][A-Za-z0-9_.-]{0,20}\Z", alphabet=CHARACTERS)
LINES = st.text(CHARACTERS, min_size=1, max_size=50).filter(str.strip)
TOLD = st.fixed_dictionaries(
    {},
    optional={
        "dut": st.from_regex(r"\AG-[0-9]{1,6}\Z", alphabet=CHARACTERS),
        "operator": LINES,
        "note": LINES,
        "tags": st.dictionaries(KEYS, LINES, min_size=1, max_size=5),
        "ambient_temperature_c": st.floats(-100.0, 100.0),
        "humidity_percent": st.floats(0.0, 100.0),
    },
)


@given(TOLD)
def test_what_is_told_comes_back_from_a_record(stated: dict[str, Any]) -> None:
    metadata = metadata_of(stated)
    assert metadata.as_json() == stated
    assert metadata_from({"metadata": {**metadata.as_json(), "of a later version": 7}}) == metadata
    assert metadata_of(metadata) is metadata
    assert pickle.loads(pickle.dumps(metadata)) == metadata  # noqa: S301 - our own


def test_nothing_told_is_nothing() -> None:
    assert metadata_of(None) == RunMetadata()
    assert RunMetadata().as_json() == {}


def test_tags_cannot_be_changed() -> None:
    given_tags = {"batch": "7"}
    metadata = RunMetadata(tags=given_tags)
    given_tags["batch"] = "8"
    assert metadata.tags == {"batch": "7"}
    with pytest.raises(TypeError):
        metadata.tags["batch"] = "9"  # type: ignore[index]


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"dut": "../G-1"}, r"dut: serial number '../G-1': expected letters"),
        ({"dut": 42}, "dut: expected a text of 1 to 200 characters, got 42"),
        ({"operator": " "}, "operator: expected a text of 1 to 200 characters, got ' '"),
        ({"note": "n" * 10_001}, "note: expected a text of 1 to 10000 characters"),
        ({"tags": {"a b": "c"}}, "tags: expected a key of letters, digits, '_', '-' and '.', got 'a b'"),
        ({"tags": {"batch": 7}}, "tag batch: expected a text of 1 to 200 characters, got 7"),
        ({"tags": ["batch"]}, "tags: expected texts by key, at most 100"),
        ({"tags": {f"k{i}": "v" for i in range(101)}}, "tags: expected texts by key, at most 100"),
        ({"ambient_temperature_c": 296.0}, "ambient_temperature_c: expected a number from -100 to 100, got 296"),
        ({"ambient_temperature_c": float("nan")}, "ambient_temperature_c: expected a number"),
        ({"humidity_percent": True}, "humidity_percent: expected a number from 0 to 100, got True"),
        ({"humidity_percent": 101}, "humidity_percent: expected a number from 0 to 100, got 101"),
        ({"ambient_from": "window"}, "ambient_from: expected 'chamber', got 'window'"),
        ({"opperator": "A"}, r"metadata: opperator: expected a known key \('operator'\?\), got an unknown key"),
    ],
)
def test_what_cannot_be_is_refused_with_its_name(stated: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        metadata_of(stated)


METER = Equipment(
    role="multimeter",
    model="34401A",
    resource="GPIB0::22::INSTR",
    identity=Identity("HEWLETT-PACKARD", "34401A", "0", "11-5-2"),
    inventory_number="GL-017",
    calibrated=date(2026, 1, 15),
    calibration_due=date(2027, 1, 15),
    certificate="K-7",
    overdue=True,
)


def header(*equipment: Equipment) -> dict[str, Any]:
    identity = {"maker": "HEWLETT-PACKARD", "model": "34401A", "serial": "0", "firmware": "11-5-2"}
    return {"identities": {"multimeter": identity}, "equipment": [each.as_json() for each in equipment]}


def test_equipment_comes_back_from_a_record_with_who_answered() -> None:
    assert equipment_of(header(METER)) == (METER,)
    assert equipment_of({}) == ()


@pytest.mark.parametrize("spoilt", [7, [7], [{}], [{**METER.as_json(), "calibrated": "soon"}]])
def test_equipment_that_is_none_is_refused(spoilt: object) -> None:
    with pytest.raises(ConfigError, match="equipment: expected the instruments of a run"):
        equipment_of({**header(), "equipment": spoilt})


@pytest.mark.parametrize("spoilt", [7, {"dut": 7}, {"tags": "batch"}])
def test_metadata_that_is_none_is_refused(spoilt: object) -> None:
    with pytest.raises(ConfigError):
        metadata_from({"metadata": spoilt})
