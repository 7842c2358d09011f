"""A table whose read-back has failed is not called safe by it, and its servo is not opened while it turns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from msgspec import Struct
from msgspec.structs import replace
from simrack.faults import Fault
from simrack.faulty_device import FaultInjector
from simrack_tests.cells import few

from vcfbench.errors import BenchError, NotSafe
from vcfbench.procedures.bench_file import load_bench
from vcfbench.procedures.layers import asked_in_python
from vcfbench.runs.conduct import conduct
from vcfbench.runs.request import Request
from vcfbench.safety.signals import StopSignals
from vcfbench.sim.builder import SimulatedBench
from vcfbench.testing.soaking.draw import LANGUAGES

if TYPE_CHECKING:
    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription

HOW = ("readback_zero", "readback_stuck", "readback_half", "readback_behind", "rate alone")
PARTS = (0.0, 0.12, 0.4, 0.7, 0.97)
"""When it begins, as a part of the clean run: at the opening, on a ramp, in windows, as the run ends."""


class Seen(Struct):
    """What became of a run and of the table."""

    error: BenchError | None = None
    rate_deg_s: float = 0.0
    opened_deg_s: float = 0.0
    """Highest rate at which the servo was opened."""
    duration_s: float = 0.0

    @property
    def code(self) -> int:
        return 0 if self.error is None else self.error.exit_code


def run(language: str, how: str | None = None, at_s: float = 0.0) -> Seen:
    """Perform a short turntable run at a table that speaks `language`, its read-back failing from `at_s` on."""
    seen = Seen()
    kept: list[Any] = []

    def build(description: BenchDescription, seed: int, clock: Clock, /) -> SimulatedBench:
        built = SimulatedBench.build(description, seed, clock)
        faults = FaultInjector(built.devices, built.clock, seed)
        built.clock.attend(*faults.devices.values())
        table, motion = built.devices["rate_table"], built.world.table
        kept.extend((motion, built.clock))
        opens = motion.open_servo

        def opened() -> None:
            seen.opened_deg_s = max(seen.opened_deg_s, abs(motion.rate_deg_s()) if motion.servo_closed else 0.0)
            opens()

        motion.open_servo = opened
        if how == "rate alone":
            axis = table._drive.axis if language == "acl" else table._axis  # what is told, not what is
            shown = axis.rate_deg_s
            axis.rate_deg_s = lambda: 0.0 if built.clock.now() >= at_s else shown()
        elif how is not None:
            faults.add(Fault("rate_table", how, at_s=at_s))  # type: ignore[arg-type]  # one of HOW
        return replace(built, devices=faults.devices)

    paper = load_bench("paper")
    assert paper.rate_table is not None
    steps = 16_000.0 / 9.0 if language == "zaber" else None
    bench = replace(paper, rate_table=replace(paper.rate_table, dialect=language, steps_per_deg=steps))
    rate = 20.0 if language == "aaaa" else 200.0
    own: dict[str, Any] = {"rate_tolerance_deg_s": 5.0} if language in {"ruya", "aaaa"} else {}
    settings = {"rates_deg_s": [rate, 0.0, -rate], "samples": 3, "sample_interval_s": 0.1, "nplc": 1, "settle_s": 0.7}
    request = Request("turntable", bench, 1, asked_in_python(settings | own), build=build, warn=lambda _: None)
    try:
        with StopSignals() as signals:
            conduct(request, signals)
    except BenchError as error:
        seen.error = error
    motion, clock = kept
    seen.rate_deg_s, seen.duration_s = abs(motion.rate_deg_s()), clock.now()
    return seen


def require_honest(seen: Seen, where: str) -> None:
    """Fail where a turning table was called safe, its servo opened, or a run that its read-back ended called proved."""
    assert seen.opened_deg_s <= 1.0, f"{where}: servo opened at {seen.opened_deg_s:.3g} deg/s"
    assert seen.code == NotSafe.exit_code or seen.rate_deg_s <= 0.05, f"{where}: safe at {seen.rate_deg_s:.3g} deg/s"
    if seen.error is not None and "reads" in str(seen.error):
        assert seen.code == NotSafe.exit_code, f"{where}: {seen.error}"
        assert "not proved" in str(seen.error), f"{where}: {seen.error}"


@pytest.mark.parametrize("language", few(LANGUAGES, LANGUAGES[2]))
def test_a_read_back_that_has_failed_proves_no_rest(language: str) -> None:
    place = LANGUAGES.index(language)
    clean = run(language)
    assert clean.code == 0, clean.error
    how, part = HOW[place % len(HOW)], PARTS[(2 * place + 1) % len(PARTS)]
    for each, at in {("readback_zero", 0.4), (how, part)}:
        require_honest(run(language, each, at * clean.duration_s), f"{language}, {each} from {at:.0%}")


@pytest.mark.exhaustive
@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("language", LANGUAGES)
def test_every_read_back_from_every_instant(language: str, how: str) -> None:
    clean = run(language)
    for part in PARTS:
        require_honest(run(language, how, part * clean.duration_s), f"{language}, {how} from {part:.0%}")
