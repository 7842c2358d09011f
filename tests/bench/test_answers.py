"""The check asks what runs depend on once, in the form that they demand."""

from __future__ import annotations

import pytest

from tests.drivers.boxes import GENERATORS, METERS, SCOPES, SUPPLIES, box
from vcfbench.bench.check import check_bench
from vcfbench.errors import FramingError, InstrumentError
from vcfbench.procedures.bench_file import load_bench


@pytest.mark.parametrize("model", [*GENERATORS, *METERS, *SCOPES, *SUPPLIES])
def test_each_question_is_answered_in_its_form(model: str) -> None:
    with box(model).driven() as driver:
        answers = driver.answers()
    assert list(answers) == [question for question, _ in driver.questions]
    assert len(answers) >= 2


@pytest.mark.parametrize("model", [*GENERATORS, *SCOPES, "E3631A"])
def test_an_answer_in_another_form_is_told_with_its_question(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with box(model).driven() as driver:
        strict = [question for question, form in driver.questions if form.pattern.fullmatch("1.5") is None]
        assert strict
        query = driver.session.query
        for garbled in strict:
            monkeypatch.setattr(driver.session, "query", lambda each, at=garbled: "1.5" if each == at else query(each))
            with pytest.raises(FramingError) as caught:
                driver.answers()
            assert caught.value.command == garbled
            assert "got '1.5'" in str(caught.value)


@pytest.mark.parametrize("model", METERS)
def test_rear_terminals_are_told(model: str) -> None:
    of = box(model)
    of.device.rear = True  # type: ignore[attr-defined]
    with of.driven() as meter, pytest.raises(InstrumentError, match="selects other terminals"):
        meter.answers()


def test_the_check_says_which_answers_came() -> None:
    checked = {each.role: each for each in check_bench(load_bench("paper")).instruments}
    assert checked["rate_source"].answers["VOLT:OFFS?"].startswith("+0.000")
    assert checked["power"].answers["MEAS:VOLT? P25V"].startswith(("+", "-"))
    assert not checked["rate_table"].answers
