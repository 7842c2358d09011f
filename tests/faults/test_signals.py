"""A nervous hand: three signals within 0.6 s leave a served bench at rest and off all the same, and say how it is."""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING

import pytest

from tests.faults.benches import SPEED, bench_text, serving
from tests.faults.forks import fork_host
from tests.faults.matrix import Station
from vcfbench.clock import WallClock, sleep

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to a child alone"),
]

PROCEDURES = {"table at rate": "turntable", "V_Vc on": "virtual-coriolis", "rails on": "turntable"}
REST_S = 20.0
"""Far more than the table needs: a slow machine shall not fail."""


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    text = bench_text("acl", name=f"signals-{tmp_path.parent.name}"[:60])
    with serving(tmp_path, text, speed=SPEED["acl"]) as served, fork_host() as host:
        yield Station(served, host, tmp_path, "acl")


def mistake(station: Station, moment: str, number: int, pause_s: float) -> str | None:
    """Send three signals at `moment`; say what is wrong afterwards."""
    run, clock = station.brought_to(moment, PROCEDURES[moment]), WallClock()
    for _ in range(3):
        run.signal(number)
        sleep(clock, pause_s)
    code, end_s = run.wait(), clock.now()
    while not station.served.physics().safe:
        if clock.now() > end_s + REST_S:
            return f"{moment}, every {pause_s} s: {station.served.physics()}, exit code {code}: {run.stderr}"
        sleep(clock, 0.05)
    footer = run.footer()
    said = code == 4 or (code == 5 and "NOT SAFE" in run.stderr)
    if not said or footer is None or "Traceback" in run.stderr:
        return f"{moment}, every {pause_s} s: exit code {code}, footer {footer}: {run.stderr}"
    if code == 4 and not all(report["safe"] for report in footer["safe"]):
        return f"{moment}, every {pause_s} s: exit code 4 though {footer['safe']}"
    return None


@pytest.mark.exhaustive
def test_three_signals(station: Station) -> None:
    assert mistake(station, "table at rate", signal.SIGTERM, 0.2) is None


@pytest.mark.fault_matrix
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_three_signals_at_every_moment(station: Station, number: int) -> None:
    tries = [(moment, pause_s) for moment in PROCEDURES for pause_s in (0.2, 0.1, 0.04, 0.0)]
    wrong = [words for moment, pause_s in tries if (words := mistake(station, moment, number, pause_s)) is not None]
    assert not wrong, "\n".join(wrong)
