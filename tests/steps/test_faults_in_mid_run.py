"""Faults of leads, instruments and surroundings in the middle of a run on the simulated bench: none is complete."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.cells import few

from tests.procedures import test_resonance
from tests.procedures.fakes import MemoryJournal
from vcfbench.errors import MeasurementError, NotSafe
from vcfbench.procedures.bench_file import load_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.steps.events import StepStarted
from vcfbench.steps.executor import Execution, Executor
from vcfbench.testing import SimulatedLab, open_simulated

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.steps.events import Event


class At:
    """Changes something at the first step that begins after `at_s`."""

    def __init__(self, lab: SimulatedLab, at_s: float, change: Callable[[SimulatedLab], None]) -> None:
        self.lab, self.at_s, self.change, self.done = lab, at_s, change, False

    def handle(self, event: Event) -> None:
        if not self.done and isinstance(event, StepStarted) and event.t_s >= self.at_s:
            self.done = True
            self.change(self.lab)


def run(name: str, at_s: float, change: Callable[[SimulatedLab], None], **settings: Any) -> Execution:
    with open_simulated(seed=3) as lab:
        procedure = PROCEDURES[name]
        plan = procedure.plan(settings_of(procedure, lab.bench.description, asked_in_python(settings)))
        return Executor(lab.bench, MemoryJournal(), [At(lab, at_s, change)]).execute(plan)


def lead_off(lab: SimulatedLab) -> None:
    lab.world.leads["multimeter"].connect("input", None)


def swapped(lab: SimulatedLab) -> None:
    lab.world.leads["multimeter"].turn("input", reversed_=True)


def warmer(lab: SimulatedLab) -> None:
    lab.world.set_ambient_c(65.0)


def offset(lab: SimulatedLab) -> None:
    lab.fault("multimeter", "offset", offset=0.5)


def short(lab: SimulatedLab) -> None:
    lab.fault("power", "current_limit", at_s=lab.bench.clock.now() + 10.0, duration_s=600.0)


def burst(lab: SimulatedLab) -> None:
    lab.fault("multimeter", "offset", offset=5.0, at_s=lab.bench.clock.now() + 3.0, duration_s=0.9)


FAULTS = [
    *(("virtual-coriolis", at_s, change) for at_s, change in ((200.0, lead_off), (200.0, swapped), (100.0, warmer))),
    *(("virtual-coriolis", at_s, change) for at_s, change in ((200.0, offset), (450.0, swapped), (200.0, burst))),
    *(("turntable", at_s, change) for at_s, change in ((60.0, lead_off), (20.0, swapped), (20.0, warmer))),
    *(("turntable", at_s, change) for at_s, change in ((150.0, offset), (5.0, burst))),
]
CASES = few(FAULTS, ("virtual-coriolis", 200.0, burst), *[fault for fault in FAULTS if fault[0] == "turntable"][:2])


@pytest.mark.parametrize(("name", "at_s", "change"), CASES, ids=lambda value: getattr(value, "__name__", str(value)))
def test_fault_in_run_ends_it_with_instrument_and_step(
    name: str, at_s: float, change: Callable[[SimulatedLab], None]
) -> None:
    error = run(name, at_s, change).error
    assert isinstance(error, MeasurementError)
    assert (error.instrument, error.resource) == ("multimeter", "GPIB0::22::INSTR")
    assert error.step
    assert " V" in error.what


@pytest.mark.exhaustive
def test_supply_failure_during_a_burst_ends_the_run() -> None:
    """A record of a gyroscope without its rails is one of no response, and would be fitted as one."""
    error = run("bandwidth", 1830.0, short).error
    assert isinstance(error, MeasurementError)
    assert error.instrument == "power"
    assert "current limit" in error.what


@pytest.mark.parametrize(
    ("name", "at_s", "settings"),
    few(
        [("phase", 60.0, {}), ("zero", 1801.0, {}), ("warmup", 400.0, {}), ("resonance", 70.0, test_resonance.QUICK)],
        ("zero", 1801.0, {}),
    ),
)
def test_current_limit_is_named_instead_of_its_effects(name: str, at_s: float, settings: dict[str, Any]) -> None:
    """Without rails there is no sine, another scatter, nothing that decays: another instrument sees that."""
    error = run(name, at_s, short, **settings).error
    assert isinstance(error, MeasurementError)
    assert error.instrument == "power", error
    assert "current limit" in error.what


def test_stopped_table_is_named_not_the_gyroscope() -> None:
    class Interlock:
        def handle(self, event: Event) -> None:
            if isinstance(event, StepStarted) and event.step.describe().startswith("the output at +10"):
                lab.fault("rate_table", "interlock", duration_s=0.4)

    paper = load_bench("paper")
    assert paper.rate_table is not None
    bench = structs.replace(paper, rate_table=structs.replace(paper.rate_table, dialect="mn_as"))  # it tells no faults
    asked = asked_in_python({"powered_s": 10.0, "duration_s": 200.0})
    with ExitStack() as stack:
        lab = stack.enter_context(open_simulated(bench, seed=3))
        plan = PROCEDURES["zero"].plan(settings_of(PROCEDURES["zero"], lab.bench.description, asked))
        error = Executor(lab.bench, MemoryJournal(), [Interlock()]).execute(plan).error
        with pytest.raises(NotSafe, match="its read-back proves nothing"):
            lab.bench.close()
    assert isinstance(error, MeasurementError)
    assert error.instrument == "rate_table", error
