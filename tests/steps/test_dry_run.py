"""Plans walked without a bench."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace

import vcfbench
from tests.cells import few
from vcfbench import LimitError, Note, PlanError, Settle
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps import dry_run

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Plan


def _notes(number: int) -> Plan:
    for each in range(number):
        yield Note(f"{each}")


def _no_end() -> Plan:
    for each in count():
        yield Settle(0.0, f"look {each}")


def test_a_plan_without_an_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dry_run, "_MOST_STEPS", 1000)
    gyro = LinearGyro(-100.0)
    assert len(list(dry_run.walk(_notes(1000), gyro))) == 1000
    for plan, last in ((_notes(1001), "1000"), (_no_end(), "look 1000")):
        with pytest.raises(PlanError, match=rf"^the plan has more than 1000 steps, the last .*{last}.*does not end$"):
            list(dry_run.walk(plan, gyro))


@pytest.mark.parametrize("order", few(["paper", "alternate", "abba", "loop"], "loop"))
@pytest.mark.parametrize("rate_deg_s", few([12.0, 25.0, 40.0, 60.0], 25.0, 40.0))
@pytest.mark.parametrize("sign", few([1.0, -1.0], 1.0))
def test_run_keeps_within_travel_or_never_begins(order: str, rate_deg_s: float, sign: float, tmp_path: Path) -> None:
    bench = load_bench("paper")
    assert bench.rate_table is not None
    bench = replace(
        bench,
        rate_table=replace(bench.rate_table, dialect="aaaa", model=None),
        limits=replace(bench.limits, max_acceleration_deg_s2=1000.0),
    )
    rates = [sign * part * rate_deg_s for part in (1.0, 0.5, 0.0, -0.5, -1.0)]
    settings = {"rates_deg_s": rates, "samples": 5, "order": order, "rate_tolerance_deg_s": 2.0}
    try:
        run = vcfbench.run("turntable", bench, settings=settings, runs=tmp_path)
    except LimitError as error:
        assert "deg from its middle, its travel has 755 deg" in str(error)  # noqa: PT017  # the other end is as good
        assert not list(tmp_path.iterdir())
    else:
        assert run.status == "complete"
