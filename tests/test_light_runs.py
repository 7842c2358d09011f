"""What a calibration loads: SciPy costs more to load than a simulated run takes."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tests.cells import few

if TYPE_CHECKING:
    from pathlib import Path

RUN = """
import sys
import vcfbench
settings = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 3, "sample_interval_s": 0.5, "settle_s": 0.5}
run = vcfbench.run(sys.argv[1], settings=settings, runs=sys.argv[2])
run.report()
print(len(run.results.uncertainty.values), sorted({"scipy", "GTC", "numpy.f2py"} & set(sys.modules)))
"""


@pytest.mark.parametrize(
    ("procedure", "values"), few([("turntable", 3), ("virtual-coriolis", 9)], ("virtual-coriolis", 9))
)
def test_a_run_with_its_budget_loads_no_scipy(procedure: str, values: int, tmp_path: Path) -> None:
    command = [sys.executable, "-c", RUN, procedure, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.splitlines()[-1] == f"{values} []"
