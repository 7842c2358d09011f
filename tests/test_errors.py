"""The sentence of an error: what happened, where, after how long, what to do."""

from __future__ import annotations

import pytest

from vcfbench.errors import ConnectFailed


@pytest.mark.parametrize(("elapsed_s", "words"), [(9.73e-5, "at once"), (0.0213, "after 0.0213 s"), (2.0, "after 2 s")])
def test_an_error_says_where_and_after_how_long(elapsed_s: float, words: str) -> None:
    error = ConnectFailed("nobody answers", instrument="multimeter", resource="GPIB0::22::INSTR", elapsed_s=elapsed_s)
    assert str(error) == f"multimeter at GPIB0::22::INSTR: nobody answers, {words}"


def test_what_to_do_comes_last() -> None:
    assert str(ConnectFailed("nobody answers", hint="is it on?")) == "nobody answers; is it on?"
