from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

from vcfbench.errors import DeadlineExceeded
from vcfbench.testing import expected_exchange, over_visa

if TYPE_CHECKING:
    from vcfbench.drivers.session import Session

OPEN = over_visa(lambda session: session)


def test_what_was_expected_passes() -> None:
    with expected_exchange(OPEN, [("A?", "1"), ("B", None)]) as session:
        assert session.query("A?") == "1"
        session.send("B")


def test_an_unexpected_message_fails() -> None:
    with (
        pytest.raises(AssertionError, match=r"unexpected: b'B\?\\n' was sent where b'A\?\\n' was expected"),
        expected_exchange(OPEN, [("A?", "1")]) as session,
    ):
        session.query("B?")


def test_a_message_too_many_fails() -> None:
    with pytest.raises(AssertionError, match="after the last of the expected"), expected_exchange(OPEN, []) as session:
        session.query("B?")


def test_a_missing_message_fails() -> None:
    with pytest.raises(AssertionError, match=r"missing: b'A\?\\n' never came"), expected_exchange(OPEN, [("A?", "1")]):
        pass


def test_an_unread_answer_fails() -> None:
    with (
        pytest.raises(AssertionError, match=r"unread: b'1\\n' was answered and not read"),
        expected_exchange(OPEN, [("A?", "1")]) as session,
    ):
        session.send("A?")


def test_a_line_more_than_was_asked_for_is_unread() -> None:
    with (
        pytest.raises(AssertionError, match=r"unread: b'2\\n' was answered and not read"),
        expected_exchange(OPEN, [("A?", "1\n2")]) as session,
    ):
        assert session.query("A?") == "1"


def test_swallowed_exchange_error_is_raised() -> None:
    with (
        pytest.raises(AssertionError, match=r"unexpected: b'B\?\\n' was sent after .* \(message 2\)"),
        expected_exchange(OPEN, [("A?", "1")]) as session,
    ):
        _asks_and_ignores(session)


def _asks_and_ignores(session: Session) -> None:
    session.query("A?")
    with suppress(Exception):
        session.query("B?")


def test_silence_takes_the_time_out() -> None:
    with expected_exchange(OPEN, [("A?", None)]) as session:
        with pytest.raises(DeadlineExceeded):
            session.query("A?")
        assert session.clock.now() == 1.0
        assert session.dirty


def test_bytes_are_literal() -> None:
    with expected_exchange(OPEN, [(b"A?\n", b"#15ab\ncd\n")]) as session:
        assert session.query_block("A?") == b"ab\ncd"


def test_error_of_body_is_not_hidden_by_missing_message() -> None:
    def fail(session: Session) -> None:
        del session
        raise ValueError("mine")

    with pytest.raises(ValueError, match="mine"), expected_exchange(OPEN, [("A?", "1")]) as session:
        fail(session)
