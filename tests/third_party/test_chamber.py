"""PyMeasure's driver of the ATS-545, which nobody here wrote, on the simulated one over TCP."""

from __future__ import annotations

import json
from pathlib import Path

from tests.bench.test_chamber import with_chamber
from tests.third_party.conftest import command
from vcfbench.testing import serve_simulated

CLIENT = Path(__file__).parent / "clients" / "pymeasure_ats545.py"


def test_pymeasure_brings_the_simulated_stream_to_a_temperature(pymeasure: Path) -> None:
    with serve_simulated(with_chamber()) as lab:
        lab.ask("speed", value=10.0)
        done = command(pymeasure, CLIENT, str(lab.wires["chamber"].tcp))
    assert done.returncode == 0, done.stderr[-3000:]
    read = json.loads(done.stdout.splitlines()[-1])
    assert read.pop("id").startswith("Temptronic,ATS-545,")
    room_c, before = read.pop("before")
    assert room_c == 20.0
    assert before & 32 == 0
    assert read == {
        "errors": 0,
        "limits": [-50.0, 120.0],
        "window": [0.5, 3.0],
        "not yet": [False, True],
        "there": [True, 60.0, 60.0, 60.0],
        "flow": [32, True],
        "cold": [2, -30.0],
        "after": [0, 0],
    }
