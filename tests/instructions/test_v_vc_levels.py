"""V_Vc measured in the four-step calibration: then the two methods disagree, as the closed form says they do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from vcfbench.instructions.v_vc import at_measured_levels, standing_for
from vcfbench.records.schema import Point
from vcfbench.reports.document import Table
from vcfbench.steps import AcquireWithVvc, ConfigureVvcMeter
from vcfbench.studies.truth import truth_of

if TYPE_CHECKING:
    from vcfbench.archive.run import Run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run[Any]:
    """The paper's procedure on a bench with a meter on V_Vc and a generator that is some per cent off."""
    settings = {"warm_up_s": 1800.0}
    return vcfbench.run("virtual-coriolis", "lab", seed=3, settings=settings, runs=tmp_path_factory.mktemp("runs"))


@pytest.mark.exhaustive
def test_values_are_those_of_the_v_vc_that_was_measured(run: Run[Any]) -> None:
    measured = [point for point in run.points if point.v_vc_measured_v is not None]
    assert {point.step for point in measured} == {2, 4}
    truth = truth_of(run, vcfbench.load_bench("lab"))
    for each in run.results.uncertainty.values:
        assert abs(each.value - truth[each.name]) <= 4.0 * each.u, each.name
    assert run.results.k_vc.value == pytest.approx(run.results.uncertainty.value("k_vc").value, rel=1e-12)
    assert run.results.k_vc_u_generator == 0.0


@pytest.mark.exhaustive
def test_the_methods_are_seen_to_disagree(run: Run[Any]) -> None:
    """By 1.9 %: the modulator's odd order, which one point at 10 deg/s cannot see."""
    error = run.results.uncertainty.value("scale_factor_error_percent")
    assert error.value == pytest.approx(1.9, abs=0.3)
    assert error.u95 < 0.1
    assert run.results.uncertainty.e_n > 10.0
    known_by = {each.source for each in error.parts}
    assert not any("generator" in each for each in known_by)
    assert "V_Vc meter readings: match" in known_by


@pytest.mark.exhaustive
def test_the_record_and_the_report_have_the_same_levels(run: Run[Any]) -> None:
    again = vcfbench.load_run(run.directory)
    assert again.results == run.results
    zero = next(point for point in run.points if point.step == 4 and point.v_vc_v == 0.0)
    table = next(part for part in run.report().parts if isinstance(part, Table))
    assert zero.v_vc_measured_v in [row[-1] for row in table.rows]


def test_windows_at_one_setting_have_one_level() -> None:
    points = [
        Point(1, 10.0, 0.0, 0.1, 0.0, 2),
        Point(2, 0.0, 0.1, 0.1, 0.0, 2, v_vc_measured_v=0.1001, v_vc_std_v=0.0),
        Point(2, 0.0, 0.1, 0.1, 0.0, 2, v_vc_measured_v=0.1003, v_vc_std_v=0.0),
        Point(4, 15.0, 0.1, 0.1, 0.0, 2, v_vc_measured_v=0.1005, v_vc_std_v=0.0),
    ]
    seen = at_measured_levels(points)
    assert [point.v_vc_v for point in seen] == pytest.approx([0.0, 0.1002, 0.1002, 0.1005])
    stands = standing_for(seen, 4, lambda volts: 150.0 * volts)
    assert [point.rate_deg_s for point in stands] == pytest.approx([10.0, 0.0, 0.0, 15.075])
    assert at_measured_levels(points[:1]) == points[:1]


@pytest.mark.parametrize(
    ("procedure", "settings"),
    [
        ("virtual-coriolis", {"k_vc_by": "one-point"}),
        ("virtual-coriolis", {"k_vc_by": "plus-minus"}),
        ("virtual-coriolis", {"k_vc_by": "curve"}),
        ("kvc", {}),
        ("self-calibration", {"k_vc": "150"}),
    ],
)
def test_v_vc_meter_is_set_up_before_reading(procedure: str, settings: dict[str, Any]) -> None:
    """Else it stands on ranges of its own choice, whose errors are not those of the budget."""
    steps = [each.step for each in vcfbench.dry_run(procedure, "lab", settings=settings).steps]
    first = next(place for place, step in enumerate(steps) if isinstance(step, AcquireWithVvc))
    assert any(isinstance(step, ConfigureVvcMeter) for step in steps[:first])
