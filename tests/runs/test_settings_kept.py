"""Another program, or a key of the front panel, changes a setting during a run: it never has results."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from vcfbench.errors import BenchError, ConfigError, SettingChanged
from vcfbench.records.schema import Status
from vcfbench.steps.events import StepStarted
from vcfbench.testing.benches import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.steps.events import Event

QUICK = {"samples": 3, "rates_deg_s": [20.0, -20.0, 40.0]}
METERS = {
    **dict.fromkeys(("34401A", "34461A", "34465A"), ("VOLT:DC:NPLC 1", "VOLT:DC:RANG 100", "CONF:VOLT:DC 100", "*RST")),
    "2000": ("VOLT:DC:NPLC 1", "VOLT:DC:RANG 100"),
    "DMM6500": ("VOLT:DC:NPLC 1", "VOLT:DC:RANG 100"),
}
GENERATORS = {"33220A": ("*RST", "FUNC SIN", "OUTP:LOAD 50"), "33522B": ("*RST", "SOUR1:FUNC SIN", "OUTP1:LOAD 50")}
CHANGES = [
    (role, model, words, step)
    for role, models in (("multimeter", METERS), ("rate_source", GENERATORS))
    for model, each in models.items()
    for words in each
    for step in (20, 30, 60)
]
CASES = few(CHANGES, ("rate_source", "33220A", "*RST", 20), ("multimeter", "34401A", "VOLT:DC:NPLC 1", 60))


class Meddler:
    """Sends words to a port at the beginning of a step, as another program would."""

    def __init__(self, port: int, words: str, step: int) -> None:
        self.port, self.words, self.step = port, words, step

    def handle(self, event: Event) -> None:
        if isinstance(event, StepStarted) and event.number == self.step:
            with socket.create_connection(("127.0.0.1", self.port)) as wire:
                wire.sendall(f"{self.words}\n*OPC?\n".encode())
                wire.recv(16)


@pytest.mark.parametrize(("role", "model", "words", "step"), CASES)
def test_run_with_changed_setting_has_no_results(role: str, model: str, words: str, step: int, tmp_path: Path) -> None:
    paper = vcfbench.load_bench("paper")
    bench = structs.replace(paper, **{role: structs.replace(getattr(paper, role), model=model)})
    with serve_simulated(bench) as lab:
        meddler = Meddler(int(lab.resource(role).split("::")[2]), words, step)
        with pytest.raises(BenchError) as caught:
            vcfbench.run("virtual-coriolis", lab.on_wires(), settings=QUICK, runs=tmp_path, observers=[meddler])
    run = caught.value.run
    assert run is not None
    assert (run.status, run.results) == (Status.ABORTED, None)
    if isinstance(caught.value, SettingChanged):
        assert caught.value.instrument == role
        assert caught.value.step == "end of the run, all was measured"
        with pytest.raises(ConfigError, match=r"cannot be resumed: .* something else has changed a setting"):
            vcfbench.resume(run)
