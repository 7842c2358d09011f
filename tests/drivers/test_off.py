"""A supply that is off is safe at what its guide allows an open output, and named with its voltage beyond."""

from __future__ import annotations

from contextlib import ExitStack, suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from simrack_tests.cells import few

from vcfbench.errors import NotSafe
from vcfbench.procedures.bench_file import load_bench
from vcfbench.testing import open_simulated


@pytest.mark.parametrize("model", few(["E3631A", "E36312A"], every=2))
@given(output=st.sampled_from(["P6V", "P25V", "N25V"]), reverse_v=st.floats(-1.5, 1.5))
def test_switched_off_output_may_be_reversed_below_0_7_v(model: str, output: str, reverse_v: float) -> None:
    paper = load_bench("paper")
    with ExitStack() as stack:
        lab = stack.enter_context(open_simulated(replace(paper, power=replace(paper.power, model=model)), seed=1))
        there = lab.faults.devices["power"].device.outputs[output]
        there.errors = replace(there.errors, reverse_v=reverse_v)
        read_v = -reverse_v + there.kind.sign * there.errors.readback_offset_v
        if -0.69 < read_v < 0.19:
            lab.bench.close()
        elif -0.71 < read_v < 0.21:  # at the limit its converter decides
            with suppress(NotSafe):
                lab.bench.close()
        else:
            sign = "-" if (reverse_v > 0.0) == (output != "N25V") else "+"
            with pytest.raises(NotSafe, match=rf"outputs are off, but {output} \{sign}\d") as caught:
                lab.bench.close()
            assert ("more reverse than" if reverse_v > 0.0 else "not discharged") in str(caught.value)


def test_drawn_supply_has_reverse_outputs_when_off() -> None:
    with open_simulated(load_bench("paper"), seed=1) as lab:
        pass
    detail = next(report.detail for report in lab.bench.safe_reports if report.instrument == "power")
    assert all(0.25 < abs(float(said.split()[1])) < 0.65 for said in detail.split(", ")[1:]), detail
