"""Programs that know nothing of vcfbench, on the served bench: here a script with PyVISA."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import pyvisa

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.testing import ServedLab


@pytest.fixture
def meter(served_bench: ServedLab) -> Iterator[pyvisa.resources.MessageBasedResource]:
    """The multimeter, on a real socket."""
    manager = pyvisa.ResourceManager("@py")
    opened = manager.open_resource(served_bench.resource("multimeter"), read_termination="\n", write_termination="\n")
    opened.timeout = 2000
    yield opened
    opened.close()
    manager.close()


def test_a_script_of_ours_reads_the_meter(meter) -> None:
    assert "34401A" in meter.query("*IDN?")
    assert abs(float(meter.query("MEAS:VOLT:DC? 10"))) < 1.0


def test_it_survives_a_meter_that_falls_silent(served_bench: ServedLab, meter) -> None:
    served_bench.fault("multimeter", "silent")
    meter.timeout = 200
    with pytest.raises(pyvisa.errors.VisaIOError):
        meter.query("*IDN?")
