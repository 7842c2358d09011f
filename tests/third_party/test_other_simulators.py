"""Our drivers against a simulator that nobody here wrote.

Of those on PyPI, instro serves a generic multimeter that knows FUNCtion, CONFigure, MEASure? and READ?. None is one of
the four models: sinstruments and PyVISA-sim bring no device that speaks like one of them.
"""

from __future__ import annotations

import subprocess
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from tests.third_party.conftest import install
from tests.third_party.test_driver_methods import CLIENTS
from vcfbench.clock import WallClock
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.registry import open_instrument
from vcfbench.errors import DeadlineExceeded, WrongInstrument

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture(scope="session")
def instro(shared: Path) -> Path:
    """Interpreter of an environment with instro."""
    return install(shared, "instro==1.22.0")


@contextmanager
def served_meter(python: Path, *identity: str) -> Iterator[str]:
    words = [str(python), str(CLIENTS / "instro_meter.py"), *identity]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        assert server.stdout is not None
        try:
            yield f"TCPIP0::127.0.0.1::{int(server.stdout.readline())}::SOCKET"
        finally:
            server.terminate()
            server.wait(10)


def opened(resource: str) -> Hp34401A:
    meter = open_instrument("multimeter", "34401A", resource, library="@py", clock=WallClock(), settings={})
    assert isinstance(meter, Hp34401A)
    return meter


def test_another_model_is_not_taken_for_ours(instro: Path) -> None:
    with served_meter(instro) as resource, pytest.raises(WrongInstrument, match="SIMULATED_DMM"):
        opened(resource)


def test_missing_command_is_error_and_known_one_is_read(instro: Path) -> None:
    identity = "HEWLETT-PACKARD,34401A,0,10-5-2"
    with served_meter(instro, identity) as resource:
        meter = opened(resource)
        with pytest.raises(DeadlineExceeded, match=r"ROUT:TERM\?"):  # which pair of terminals: the first thing asked
            meter.configure_dc_voltage(10.0, 10.0)
        meter.close()
    with served_meter(instro, identity) as resource:
        meter = opened(resource)
        assert meter.session.query_reading("READ?") == pytest.approx(1.25, rel=0.01)
        with pytest.raises(DeadlineExceeded, match=r"command 'FETC\?'"):  # it keeps no reading to be fetched twice
            meter.read_voltage_v()
        meter.close()
