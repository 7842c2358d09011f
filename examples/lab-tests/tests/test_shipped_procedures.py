"""The procedures that come with vcfbench, under the conditions of this lab."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest
from vcfbench.errors import MeasurementError
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.turntable import TURNTABLE
from vcfbench.records.schema import Status
from vcfbench.steps.executor import Execution, Executor

if TYPE_CHECKING:
    from vcfbench.bench.bench import Bench


@dataclass
class Lines:
    """A journal in memory."""

    lines: list[Any] = field(default_factory=list)

    def write(self, kind: str, values: Any) -> None:
        """Keep one line: a performed step, or one that failed."""
        del kind
        self.lines.append(values)


def run(bench: Bench) -> Execution:
    settings = settings_of(TURNTABLE, bench.description)
    return Executor(bench, Lines()).execute(TURNTABLE.plan(settings))


def test_the_turntable_calibration_gives_this_labs_seven_points(simulated_bench: Bench) -> None:
    execution = run(simulated_bench)
    assert execution.status is Status.COMPLETE
    assert [point.rate_deg_s for point in execution.points] == [100, 50, 10, 0, -10, -50, -100]


@pytest.mark.vcfbench(faults="faults/overload.toml")
def test_calibration_ends_at_the_first_bad_reading_with_its_points(simulated_bench: Bench) -> None:
    execution = run(simulated_bench)
    assert execution.status is Status.ABORTED
    assert isinstance(execution.error, MeasurementError)
    assert 1 <= len(execution.points) < 7
