"""The E36312A beside the E3631A: data sheet and drawn specimens."""

from __future__ import annotations

import numpy as np
from simrack.instruments.e36312a import Errors36312A

from vcfbench.specifications import KEYSIGHT_E36312A
from vcfbench.station.discovery import recognise


def test_specimens_read_back_within_the_sheet_that_the_uncertainties_use() -> None:
    drawn = [Errors36312A.drawn(np.random.default_rng(seed)) for seed in range(60)]
    for name, (part, volts) in KEYSIGHT_E36312A.voltage.items():
        outputs = [each.of(name) for each in drawn]
        assert 0.2 < np.std([each.readback_gain for each in outputs]) / part < 0.3
        assert 0.2 < np.std([each.readback_offset_v for each in outputs]) / volts < 0.3


def test_discovery_finds_it_by_a_real_reply() -> None:
    assert recognise("Keysight Technologies,E36312A,MY59002391,2.1.0-1.0.4-1.12") == "E36312A"
