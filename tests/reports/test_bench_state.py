from __future__ import annotations

from tests.procedures.fakes import FakeBench, MemoryJournal, make_settings
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.reports.bench_state import BenchState
from vcfbench.steps import ConfigureGenerator, EnableVvc, SetSine, SetVvc, VvcSetting, Window
from vcfbench.steps.events import Event, StepFinished, StepStarted
from vcfbench.steps.executor import Executor
from vcfbench.steps.step import Done


class States:
    """Follows a run, and keeps each state that the bench was in."""

    def __init__(self) -> None:
        self.states = [BenchState()]
        self.at_windows: list[str] = []

    def handle(self, event: Event) -> None:
        state = self.states[-1]
        if isinstance(event, StepStarted):
            self.states.append(state.begun(event.step))
        if isinstance(event, StepFinished):
            self.states.append(state.after(event.step, event.result))
            if isinstance(event.result, Window):
                state = self.states[-1]
                self.at_windows.append(f"{state.table()}; {state.supplied()}; {state.driven()}")


def followed(procedure: str) -> States:
    states = States()
    Executor(FakeBench(), MemoryJournal(), [states]).execute(PROCEDURES[procedure].plan(make_settings()))
    return states


def test_nothing_is_known_before_anything_was_done() -> None:
    state = BenchState()
    assert (state.table(), state.supplied(), state.driven()) == ("table -", "", "V_Vc -")


def test_each_window_has_the_state_in_which_it_was_taken() -> None:
    windows = followed("virtual-coriolis").at_windows
    rails = "rails +10.000 -10.000 V"
    assert windows[0] == f"table +0, reads +0.0000 deg/s; {rails}; V_Vc off"
    assert f"table -200, reads -200.0000 deg/s; {rails}; V_Vc off" in windows
    assert any(each.startswith(f"table +0, reads +0.0000 deg/s; {rails}; V_Vc +5.0") for each in windows)


def test_a_table_on_its_way_has_not_yet_read_back() -> None:
    assert "table +200 deg/s" in {state.table() for state in followed("turntable").states}


def test_in_the_end_all_is_off() -> None:
    last = followed("virtual-coriolis").states[-1]
    assert (last.table(), last.supplied(), last.driven()) == ("table off", "rails off", "V_Vc off")


def test_a_sine_is_told_by_peak_and_frequency() -> None:
    state = BenchState().after(ConfigureGenerator(0.0), VvcSetting(0.0)).after(EnableVvc(), Done())
    assert state.driven() == "V_Vc +0.00000 V"
    assert state.after(SetSine(2.0, 0.5), Done()).driven() == "V_Vc 0.5 V, 2 Hz"
    assert state.after(SetVvc(1.0), VvcSetting(1.0001)).driven() == "V_Vc +1.00010 V"
