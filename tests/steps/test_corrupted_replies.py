"""Each byte of a reply of a window lost, flipped or doubled: no run is complete with another number."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.cells import few

from tests.procedures.fakes import MemoryJournal
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.procedures.turntable import TURNTABLE, turntable
from vcfbench.steps.executor import Execution, Executor
from vcfbench.testing import open_simulated

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.clock import Deadline

REPLY = b"-1.67463210E-01\n"


class SpoilingWire:
    """Passes on what a wire says, but for reply number `nth` to ``FETC?``, which it spoils."""

    def __init__(self, wire: Any, nth: int, spoil: Callable[[bytes], bytes]) -> None:
        self._wire, self._left, self._spoil, self._asked = wire, nth, spoil, False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._wire, name)

    def send(self, data: bytes, deadline: Deadline) -> None:
        self._asked = data == b"FETC?\n"
        self._wire.send(data, deadline)

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        data, end = self._wire.receive(deadline)
        if self._asked and data:
            self._left -= 1
            if self._left == 0:
                return self._spoil(data), end
        return data, end


def run(nth: int, spoil: Callable[[bytes], bytes]) -> Execution:
    with open_simulated(seed=3) as lab:
        session: Any = lab.bench.multimeter.session  # type: ignore[attr-defined]
        session._wire = SpoilingWire(session._wire, nth, spoil)
        settings = settings_of(TURNTABLE, lab.bench.description, asked_in_python({"rates_deg_s": (10.0, 0.0, -10.0)}))
        return Executor(lab.bench, MemoryJournal(), []).execute(turntable(settings))


def lost(at: int) -> Callable[[bytes], bytes]:
    return lambda data: data[:at] + data[at + 1 :]


def doubled(at: int) -> Callable[[bytes], bytes]:
    return lambda data: data[: at + 1] + data[at:]


def flipped(at: int) -> Callable[[bytes], bytes]:
    bit = 1 << 3 * at % 7
    return lambda data: data[:at] + bytes([data[at] ^ bit]) + data[at + 1 :]


@pytest.mark.parametrize("kind", few([lost, doubled, flipped]))
def test_no_byte_of_a_reply_can_change_a_result(kind: Callable[[int], Callable[[bytes], bytes]]) -> None:
    clean = run(0, lambda data: data)
    noise_v = max(point.std_v for point in clean.points) * math.sqrt(2.0 / 10.0)  # of the difference of two means
    for at in range(len(REPLY)):
        spoilt = run(7 + at % 2, kind(at))  # the first and the second time that a reading is fetched
        assert spoilt.error is not None or spoilt.asked_again or spoilt.points == clean.points, at
        if spoilt.error is not None:
            continue
        for point, true in zip(spoilt.points, clean.points, strict=True):  # a reading taken anew has noise of its own
            assert abs(point.output_v - true.output_v) <= 6.0 * noise_v


def test_what_was_asked_again_is_told_with_its_step() -> None:
    spoilt = run(7, lost(4))
    assert spoilt.error is None
    [said] = spoilt.asked_again
    assert said.startswith("step ")
    assert "multimeter at GPIB0::22::INSTR: expected a number of the form +d.ddddddddE+dd, got '-4." in said
