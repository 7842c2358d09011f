"""The error queue of each instrument is read once more when all was measured."""

from __future__ import annotations

import pytest

import vcfbench
from vcfbench.drivers.scpi_instrument import ScpiInstrument
from vcfbench.errors import InstrumentError
from vcfbench.records.schema import Status


def test_error_queue_at_end_is_reported_and_keeps_results(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(instrument: ScpiInstrument) -> None:
        if instrument.name == "multimeter":
            where = {"instrument": instrument.name, "resource": instrument.resource}
            raise InstrumentError('refused with -410 "Query INTERRUPTED"', **where)  # type: ignore[arg-type]

    monkeypatch.setattr(ScpiInstrument, "check_errors", refused)
    with pytest.raises(InstrumentError, match=r"multimeter at .*-410 .*end of the run, all was measured") as caught:
        vcfbench.run("turntable", seed=1, settings={"samples": 3, "rates_deg_s": [-50.0, 0.0, 50.0]}, runs=None)
    assert caught.value.run.status is Status.COMPLETE
    assert caught.value.run.results is not None
