"""The word safe of `talk`: whatever one instrument does, the others are stopped and switched off."""

from __future__ import annotations

import pytest

from vcfbench.clock import sleep
from vcfbench.errors import BenchError
from vcfbench.runs.by_hand import ByHand
from vcfbench.safety.signals import StopSignals
from vcfbench.testing import open_simulated


@pytest.mark.parametrize("broken", ["rate_table", "rate_source", "power"])
def test_safe_switches_off_answering_and_names_silent_instruments(broken: str) -> None:
    with open_simulated(seed=1) as lab:
        by_hand = ByHand(lab.bench, StopSignals(), lambda _words: None)
        lab.bench.power.configure_output("P25V", 10.0, 0.1)
        lab.bench.power.enable_outputs()
        lab.bench.rate_source.configure_dc(0.5)
        lab.bench.rate_source.enable_output()
        lab.bench.rate_table.enable()
        lab.fault(broken, "silent", duration_s=200.0)
        with pytest.raises(BenchError, match=f"not all is safe: .*{broken}"):
            by_hand.perform("safe", [])
        lab.faults.clear()
        sleep(lab.bench.clock, 2.0)  # a rail falls by itself
        on = {
            "rate_table": lab.world.table.servo_closed,
            "rate_source": abs(lab.world.value_v("v_vc")) > 0.1,
            "power": lab.world.value_v("rail_positive") > 1.0,
        }
        assert {role for role, live in on.items() if live} <= {broken}
