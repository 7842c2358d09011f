from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vcfbench.errors import ConfigError
from vcfbench.records.damage import first_damage
from vcfbench.records.journal import read_journal
from vcfbench.records.schema import Status

if TYPE_CHECKING:
    from collections.abc import Callable

VOLTS = (-2.5, -2.5001, -2.4999)


def window(number: int) -> dict[str, Any]:
    point = {"step": 3, "rate_deg_s": 200.0, "v_vc_v": 0.0, "output_v": -2.5, "std_v": 1e-4, "n": 3}
    result = {"readings": [{"t_s": float(number), "voltage_v": volts} for volts in VOLTS]}
    times = {"t_s": float(number), "end_s": number + 0.5}
    return {"type": "step", "n": number, "step_kind": "Acquire", **times, "result": result, "point": point}


def whole() -> list[dict[str, Any]]:
    steps = [window(number) for number in range(1, 6)]
    error = {"type": "error", "n": 6, "t_s": 6.0, "error": "the lead came off"}
    footer = {"type": "footer", "status": "aborted", "points": 5}
    return [{"type": "header", "format": 1, "procedure": "turntable"}, *steps, error, footer]


def test_journal_and_each_beginning_of_it_have_no_damage() -> None:
    lines = whole()
    assert [first_damage(lines[:kept]) for kept in range(len(lines) + 1)] == [None] * 9


def without(*places: int) -> Callable[[list[dict[str, Any]]], None]:
    def cut(lines: list[dict[str, Any]]) -> None:
        for place in sorted(places, reverse=True):
            del lines[place]

    return cut


def swap(lines: list[dict[str, Any]]) -> None:
    lines[2], lines[3] = lines[3], lines[2]


def edit(place: int, *keys: Any, to: Any) -> Callable[[list[dict[str, Any]]], None]:
    def change(lines: list[dict[str, Any]]) -> None:
        value: Any = lines[place]
        for key in keys[:-1]:
            value = value[key]
        value[keys[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without(0), "it does not begin with a header"),
        (without(2, 3, 4), "line 3 is step 5, after step 1"),
        (without(1), "line 2 is step 2, the first"),
        (without(6), None),  # what failed was perhaps never written: the disk was full
        (without(5, 6), "its footer counts 5 points, there are 4"),
        (swap, "line 3 is step 3, after step 1"),
        (lambda lines: lines.insert(3, lines[2]), "line 4 is step 2, after step 2"),
        (lambda lines: lines.insert(1, lines[0]), "it has 2 headers: several runs in one file"),
        (lambda lines: lines.extend(whole()), "it has 2 headers: several runs in one file"),
        (lambda lines: lines.append(lines[-1]), "it has 2 footers: several runs in one file"),
        (lambda lines: lines.append(window(7)), "line 9 comes after the footer"),
        (edit(2, "n", to=True), "line 3 is step True, after step 1"),
        (edit(2, "t_s", to=0.5), "line 3: bench time goes back from 1.5 s to t_s = 0.5"),
        (edit(2, "end_s", to=1.9), "line 3: bench time goes back from 2 s to end_s = 1.9"),
        (edit(2, "end_s", to="2.5"), "line 3: bench time goes back from 2 s to end_s = '2.5'"),
        (edit(3, "point", "output_v", to=2.5), "line 4: the point's 2.5 V is not the mean of its readings"),
        (edit(3, "point", "n", to=4), "line 4: a point of 4 readings has 3"),
        (edit(3, "result", "readings", 1, "voltage_v", to=-2.6), "line 4: the point's -2.5 V is not the mean"),
        (edit(3, "result", "readings", 1, "voltage_v", to=-1e308), "line 4: one of its readings is above 1e+50"),
        (edit(7, "points", to=51), "its footer counts 51 points, there are 5"),
    ],
)
def test_what_no_journal_has_by_itself_is_named(
    change: Callable[[list[dict[str, Any]]], None], words: str | None
) -> None:
    lines = whole()
    change(lines)
    damage = first_damage(lines)
    assert damage is None if words is None else damage is not None and damage.startswith(words)


@pytest.fixture(scope="module")
def text() -> bytes:
    return b"".join(json.dumps(line).encode() + b"\n" for line in whole())


@settings(max_examples=60)
@given(place=st.integers(0, 2000), data=st.binary(min_size=1, max_size=4), insert=st.booleans())
def test_bytes_changed_anywhere_are_a_record_or_one_sentence(
    text: bytes, tmp_path_factory: pytest.TempPathFactory, place: int, data: bytes, *, insert: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "changed.jsonl"
    place %= len(text)
    path.write_bytes(text[:place] + data + text[place + (0 if insert else len(data)) :])
    try:
        status = read_journal(path).status
    except ConfigError as error:
        assert "\n" not in str(error)  # noqa: PT017  # either will do
    else:
        assert status in Status


@given(places=st.sets(st.integers(1, 5), min_size=1))
def test_steps_cut_out_are_found(places: set[int]) -> None:
    lines = whole()
    without(*places)(lines)
    assert first_damage(lines) is not None
