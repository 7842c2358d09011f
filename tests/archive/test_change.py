"""Changes from run to run: like is compared with like, and what cannot be says why."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs

import vcfbench
from vcfbench.archive.change import Coefficients, Compared, Difference, Pair
from vcfbench.records.device_values import Measured
from vcfbench.values.definition import Drive
from vcfbench.values.kinds import slope_unit
from vcfbench.values.sources import TEMPERATURE
from vcfbench.values.value import UncertaintyPart

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

WIDE, NARROW, HALF = [200, 100, 50, 20, 0, -20, -50, -100, -200], [75, 30, 0, -30, -75], [0, -60, -90, -120]
NOTHING = Coefficients()


def ran(seed: int, rates: list[float], celsius: float | None = 20.0, bench: str = "paper", **settings: Any) -> Run:
    asked = {"rates_deg_s": rates, "samples": 6, "warm_up_s": 1800.0, **settings}
    told = {"dut": "G"} | ({} if celsius is None else {"ambient_temperature_c": celsius})
    return vcfbench.run("turntable", bench, seed=seed, settings=asked, metadata=told, runs=None)


@pytest.fixture(scope="module")
def wide() -> Run:
    return ran(1, WIDE)


@pytest.fixture(scope="module")
def narrow() -> Run:
    return ran(2, NARROW)


def changed(
    first: Run, other: Run, known: Coefficients = NOTHING, *more: Run, name: str = "scale_factor"
) -> Difference:
    pair = Pair(Compared(first), Compared(other), lambda: known, [Compared(each) for each in more])
    return pair.change(first.values[name], other.values[name])


def under(run: Run, **conditions: Any) -> Run:
    """The same run, told to have been under other conditions."""
    values = tuple(
        structs.replace(each, conditions=structs.replace(each.conditions, **conditions)) for each in run.values.values()
    )
    return structs.replace(run, _values=values)


def with_part(run: Run, source: str, relative: float) -> Run:
    """The same run, its scale factor with one more part of its u."""
    value = run.values["scale_factor"]
    u = relative * abs(value.value or 0.0)
    parts = (*value.parts, UncertaintyPart(source, u, 0.0))
    all_u = math.hypot(value.u or 0.0, u)
    dof = (value.dof or math.inf) * (all_u / (value.u or 1.0)) ** 4  # after Welch and Satterthwaite
    wider = structs.replace(value, u=all_u, dof=dof, parts=parts)
    return structs.replace(run, _values=tuple(wider if each is value else each for each in run.values.values()))


def ppm(found: Difference, run: Run) -> tuple[float, float]:
    size = 1e6 / abs(run.values["scale_factor"].value or 1.0)
    assert found.value is not None
    assert found.u95 is not None, found.reason
    return size * found.value, size * found.u95


@pytest.mark.exhaustive
def test_lines_over_other_rates_differ_and_their_device_does_not(wide: Run, narrow: Run) -> None:
    found = changed(wide, narrow)
    value, u95 = ppm(found, wide)
    assert abs(value) < u95 < 500.0
    assert found.note.startswith("over 75, 30, 0, -30, -75 deg/s, by the curve of both runs; as they stand")
    common = changed(wide, ran(3, [100, 50, 0, -50, -100]))
    assert common.note.startswith("over 100, 50, 0, -50, -100 deg/s, the rates of both")
    assert common.e_n is not None
    assert common.e_n < 1.0


def test_no_common_rates_give_no_figure_but_a_run(narrow: Run) -> None:
    found = changed(narrow, ran(4, [100, 90, 80]))
    assert found.value is None
    assert found.reason.endswith("would tell: --rates 100,90,80,75,30,0,-30,-75")


def test_two_devices_share_no_curve(wide: Run, narrow: Run) -> None:
    found = changed(wide, structs.replace(narrow, metadata=structs.replace(narrow.metadata, dut="H")))
    assert found.value is None
    assert "other rates, and --dut does not say that it is one device" in found.reason


@pytest.mark.parametrize("name", ["bias", "bias_deg_s", "nonlinearity"])
def test_what_a_line_leaves_is_of_its_rates(name: str, wide: Run, narrow: Run) -> None:
    found = changed(wide, narrow, name=name)
    assert found.value is None
    assert found.reason == ("of another measurand: rates: 9 rates, 200 to -200 deg/s and 75, 30, 0, -30, -75 deg/s")


def test_errors_of_the_same_instruments_cancel(wide: Run) -> None:
    apart = changed(wide, ran(5, WIDE))
    again = changed(wide, structs.replace(ran(5, WIDE), seed=1, _header=wide.header))
    assert not apart.cancelled
    assert [each.split()[0] for each in again.cancelled] == ["34401A", "acl"]
    assert (again.u or 0.0) < (apart.u or 0.0)


def test_another_temperature_is_corrected_or_refused(wide: Run) -> None:
    warm = under(wide, temperature_c=25.0)
    known = changed(wide, warm, Coefficients(Measured(value=-104.0, u=2.0)))
    value, u95 = ppm(known, wide)
    assert value == pytest.approx(-520.0, abs=1.0)  # of a slope that is below 0, as it has not changed
    assert u95 > 1.96 * 10.0
    assert "corrected by +520 ppm for 25 instead of 20 degC" in known.note
    assert [(why, round(1e6 * part / (wide.values["scale_factor"].value or 1.0))) for why, part in known.explained] == [
        ("25 instead of 20 degC", -520)
    ]
    unknown = changed(wide, warm)
    assert unknown.value is None
    assert "no temperature coefficient of the device is known" in unknown.reason
    silent = changed(wide, under(wide, temperature_c=None, drive=None))
    assert silent.missing == ("temperature of one of the runs",)
    assert silent.note == "incomplete, without temperature of one of the runs"


def test_warmer_device_is_seen_by_its_drive(wide: Run) -> None:
    of_drive, of_line = Measured(value=-25.0, u=0.5), Measured(value=-104.0, u=2.0)
    drive = structs.replace(wide.values["scale_factor"].conditions.drive or Drive(0.0, 0.0), u_hz=0.01)
    cool, warm = (
        under(
            with_part(wide, TEMPERATURE, 1e-3),
            temperature_c=None,
            drive=structs.replace(drive, frequency_hz=drive.frequency_hz * (1.0 - 25e-6 * rise_k)),
        )
        for rise_k in (0.0, 5.0)
    )
    value, u95 = ppm(changed(cool, warm, Coefficients(of_line, None, of_drive)), wide)
    assert value == pytest.approx(-520.0, abs=1.0)  # 5 K at -104 ppm/K, which the slope, left as it was, has not shown
    rise_u_k = math.hypot(math.sqrt(2.0) * 0.01 / drive.frequency_hz / 25e-6, 5.0 * 0.5 / 25.0)
    without = ppm(changed(wide, wide), wide)[1]  # the budgets' 1000 ppm by temperature are gone
    assert u95 == pytest.approx(math.hypot(without, 1.96 * 2.0 * 5.0, 1.96 * 104.0 * rise_u_k), rel=0.05)
    same = changed(cool, cool, Coefficients(of_line, None, of_drive))
    assert (same.value, same.note) == (0.0, "")
    unknown = changed(cool, warm)  # by -30 ppm/K, if not that of this gyroscope
    assert unknown.value is None
    assert "+4.2 K (U95 2.4 K) by the drive's frequency, and no temperature coefficient" in unknown.reason
    others = structs.replace(warm, metadata=structs.replace(warm.metadata, dut="H"))
    assert changed(cool, others, Coefficients(of_line, None, of_drive)).note == ""


def test_device_entries_are_read_only_if_conditions_differ(wide: Run, tmp_path: Path) -> None:
    (tmp_path / "G").mkdir()
    (tmp_path / "G" / "0001.json").write_text("{", encoding="utf-8")

    def kept() -> Coefficients:
        return Coefficients.kept([wide], tmp_path)

    same, warm = wide.values["scale_factor"], under(wide, temperature_c=25.0).values["scale_factor"]
    pair = Pair(Compared(wide), Compared(wide), kept)
    assert pair.change(same, same).value == 0.0
    assert "what is kept of the device cannot be read" in pair.change(same, warm).reason


def test_other_rails_are_corrected_or_refused(wide: Run) -> None:
    wider = under(wide, rails_v=(10.4, -10.4))
    known = changed(wide, wider, Coefficients(None, Measured(value=375.0, u=15.0)))
    assert ppm(known, wide)[0] == pytest.approx(150.0, abs=1.0)
    unknown = changed(wide, wider)
    assert unknown.value is None
    assert "what rails change of the device is not known (vcfbench run power)" in unknown.reason


def in_unit(run: Run, unit: str) -> Run:
    """The same run, its output in another unit."""
    units = {"V": unit, "V/(deg/s)": slope_unit(unit)}
    values = tuple(structs.replace(each, unit=units.get(each.unit, each.unit)) for each in run.values.values())
    return structs.replace(run, _values=values)


@pytest.mark.parametrize("name", ["scale_factor", "bias", "nonlinearity"])
def test_bound_and_value_are_named_by_their_figures(name: str, wide: Run) -> None:
    then = wide.values[name]
    bound = structs.replace(then, value=None, u=None, u95=None, dof=None, form="below", low=0.0, high=1.0, parts=())
    said = Pair(Compared(wide), Compared(wide)).change(then, bound).reason
    assert said == f"of another measurand: {then} and {bound}"


@pytest.mark.parametrize("unit", ["LSB", "deg/s", "LSB/s"])
def test_values_in_other_units_are_never_subtracted(unit: str, wide: Run, narrow: Run) -> None:
    for first, other in ((in_unit(wide, unit), narrow), (wide, in_unit(narrow, unit)), (wide, in_unit(wide, unit))):
        pair = Pair(Compared(first), Compared(other))
        compared = vcfbench.compare_runs(first, other)
        for name, then in first.values.items():
            if name in other.values and then.unit != (now := other.values[name]).unit:
                found = pair.change(then, now)
                assert (found.value, found.u95, found.e_n) == (None, None, None)
                assert found.reason == f"in {then.named.unit}, now in {now.named.unit}"
                assert name not in {each.name for each in compared.results}
                said = f"{then.named.words}: in {then.named.unit}, {now.named.unit}"
                assert said in compared.of_others
    assert any(each.unit == slope_unit(unit) for each in in_unit(wide, unit).values.values())
