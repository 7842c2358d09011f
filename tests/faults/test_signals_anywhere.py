"""Signals between any two calls of what ends a run: the bench is made safe or said not to be, and the record closed."""

from __future__ import annotations

import json
import signal
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from simrack_tests.cells import few

import vcfbench
from vcfbench.errors import Aborted, NotSafe
from vcfbench.steps.events import StepStarted

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

    from vcfbench.steps.events import Event

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="its signals are others")

OURS = (str(Path(vcfbench.__file__).parent), "contextlib.py")
STEP = 20
"""Amid the series: the table turns, the rails are on."""


class NervousHand:
    """Signals once at the beginning of a step, and twice more at event `at` (call or return) of what follows."""

    def __init__(self, at: int) -> None:
        self.events, self._at = 0, at

    def handle(self, event: Event) -> None:
        if isinstance(event, StepStarted) and event.number == STEP:
            signal.raise_signal(signal.SIGTERM)
            sys.setprofile(self._count)

    def _count(self, frame: FrameType, _event: str, _argument: Any) -> None:
        if any(part in frame.f_code.co_filename for part in OURS):
            self.events += 1
            if self.events == self._at:
                sys.setprofile(None)
                try:
                    signal.raise_signal(signal.SIGTERM)
                finally:
                    signal.raise_signal(signal.SIGTERM)


@contextmanager
def harmless_outside() -> Iterator[None]:
    """Let signals that come when the run is over end nothing."""
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        yield
    finally:
        sys.setprofile(None)
        signal.signal(signal.SIGTERM, before)


def ended(at: int, runs: Path) -> NervousHand:
    """Run into the signals, and look at what came of it."""
    hand = NervousHand(at)
    with harmless_outside(), pytest.raises((Aborted, NotSafe)) as caught:
        vcfbench.run("turntable", "ideal", runs=runs, observers=[hand])
    (journal,) = runs.glob("*/journal.jsonl")
    footer = json.loads(journal.read_text("utf-8").splitlines()[-1])
    assert footer["type"] == "footer"
    if isinstance(caught.value, Aborted):
        assert [report["safe"] for report in footer["safe"]] == [True] * 5
    else:
        assert "third signal" in str(caught.value)
    return hand


@pytest.mark.parametrize("times", few([200, 6], 6))
def test_signals_at_any_call_leave_nothing_unsaid(times: int, tmp_path: Path) -> None:
    most = ended(0, tmp_path / "none").events
    assert most > 500
    for at in 1 + np.random.default_rng(times).choice(most, times, replace=False):
        ended(int(at), tmp_path / str(at))
