"""A scale factor that was told is held against what the output shows, before anything is stated by it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.instructions.routines import OTHER_SCALE_FACTOR
from vcfbench.instructions.scale_factor import AtRestSettings, require_as_used
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.records.devices import DeviceStore
from vcfbench.sim.gyro.data_sheet import DataSheet
from vcfbench.sim.own_gyro import own_gyro_bench
from vcfbench.station.parts import Expected
from vcfbench.station.settings import Station

if TYPE_CHECKING:
    from pathlib import Path

TRUE = -0.0125527
WRONG = {"in mV": 1e3 * TRUE, "sign": -TRUE, "per deg/h": TRUE / 3600.0, "twice": 2.0 * TRUE, "half": 0.5 * TRUE}
SHORT: dict[str, dict[str, Any]] = {
    "zero": {"duration_s": 200.0, "powered_s": 10.0},
    "warmup": {"shortest_s": 180.0, "longest_s": 240.0},
    "power": {"warm_up_s": 0.0, "samples": 4},
    "rate-limits": {"warm_up_s": 0.0, "samples": 4},
    "repeatability": {"power_cycles": 3, "off_s": 60.0, "warm_up_s": 60.0, "samples": 4},
    "g-sensitivity": {"warm_up_s": 0.0, "samples": 4},
    "temperature": {"temperatures_c": [20.0, 40.0, 60.0], "samples": 4},
}
BY_V_VC = {"g-sensitivity", "temperature"}
"""Of these nobody turns the table: K_Vc is known to a factor of ten."""


def told(value: float, *, expected: bool, **keys: Any) -> AtRestSettings:
    if expected:
        window = (min(0.99 * value, 1.01 * value), max(0.99 * value, 1.01 * value))
        return AtRestSettings(station=Station(expected=Expected(scale_factor_v_per_deg_s=window, **keys)))
    return AtRestSettings(scale_factor_v_per_deg_s=value, station=Station(expected=Expected(**keys)))


@pytest.mark.parametrize("expected", [False, True])
@pytest.mark.parametrize("wrong", WRONG)
def test_an_output_that_answers_otherwise_is_refused(wrong: str, *, expected: bool) -> None:
    with pytest.raises(MeasurementError, match=r"the output changes by -0\.01255 V/"):
        require_as_used(told(WRONG[wrong], expected=expected), TRUE, by_v_vc=False)
    known = told(WRONG[wrong], expected=expected, k_vc_deg_s_per_v=(148.0, 152.0))
    with pytest.raises(MeasurementError, match=r"-1\.883 V a volt of V_Vc, .* what is expected"):
        require_as_used(known, TRUE, by_v_vc=True)


@pytest.mark.parametrize("expected", [False, True])
@pytest.mark.parametrize("off", [0.92, 1.0, 1.08])
def test_what_warm_up_and_curvature_make_is_let_through(off: float, *, expected: bool) -> None:
    require_as_used(told(TRUE, expected=expected), off * TRUE, by_v_vc=False)
    require_as_used(told(TRUE, expected=expected), 8.0 * off * TRUE, by_v_vc=True)
    noisy = told(TRUE, expected=expected)
    require_as_used(noisy, 1.4 * TRUE, abs(0.35 * TRUE), by_v_vc=False)


def test_u_of_a_scale_factor_widens_the_limits() -> None:
    rough = structs.replace(told(TRUE, expected=False), scale_factor_u_v_per_deg_s=abs(TRUE) / 3.0)
    require_as_used(rough, 1.6 * TRUE, by_v_vc=False)
    with pytest.raises(MeasurementError, match="cannot be"):
        require_as_used(rough, 1.8 * TRUE, by_v_vc=False)


def ended(name: str, tmp_path: Path, settings: dict[str, Any], window: list[float] | None = None) -> Exception | None:
    bench = vcfbench.load_bench("lab" if name == "temperature" else "paper")
    if window is not None:
        bench = structs.replace(bench, expected=structs.replace(bench.expected, scale_factor_v_per_deg_s=tuple(window)))
    try:
        settings = {**SHORT[name], **settings, "dut": "Z", "devices": str(tmp_path)}
        found = vcfbench.run(name, bench, seed=1, settings=settings, runs=None)
    except (ConfigError, MeasurementError) as error:
        return error
    return found.error


@pytest.mark.parametrize("name", few(["repeatability", "rate-limits"], every=2))
def test_another_gyroscope_of_which_nothing_is_told_costs_no_run(name: str, tmp_path: Path) -> None:
    """Its rates are by the paper's scale factor and incomplete; nothing of them is kept of the device."""
    bench = vcfbench.load_bench("paper")
    other = structs.replace(
        bench, simulation=structs.replace(bench.simulation, override={"output_stage": {"gain": 5.0}})
    )
    asked = {**SHORT[name], "dut": "Z", "devices": str(tmp_path / "devices")}
    found = vcfbench.run(name, other, seed=1, settings=asked, runs=tmp_path / "runs")
    assert found.status == "complete"
    (said,) = (each for each in found.not_checked if each.startswith(OTHER_SCALE_FACTOR))
    assert "the output changes by -0.006" in said
    assert "which cannot be -0.0125 V/(deg/s) (value of the paper" in said
    rates = [each for each in found.values.values() if each.unit.removeprefix("(").startswith("deg/s")]
    assert [each.name for each in rates if "scale factor" not in each.missing and each.value is not None] == []
    assert not [*(tmp_path / "devices").glob("Z/*")]


@pytest.mark.parametrize("expected", few(["none", "wide", "as it is"], "wide"))
@pytest.mark.parametrize("name", ["zero", "warmup"])
@pytest.mark.parametrize(("factor", "bias_deg_s"), few([(8e-3, 2.5), (-2e-3, -12.0)], (-2e-3, -12.0)))
def test_rates_at_rest_are_by_the_look_on_the_table(
    name: str, expected: str, factor: float, bias_deg_s: float, tmp_path: Path
) -> None:
    """Nobody gives the scale factor; the window of the bench file is a window and no value."""
    sizes = {"range_deg_s": 900.0, "angle_random_walk_deg_sqrt_h": 0.1, "bias_instability_deg_h": 5.0}
    own = DataSheet(scale_factor_v_per_deg_s=factor, bias_deg_s=bias_deg_s, **sizes)
    bench = parse_bench(own_gyro_bench(own, "own", imperfections=False), "own")
    window = {"none": None, "wide": (0.9 * factor, 1.4 * factor), "as it is": (0.99 * factor, 1.01 * factor)}[expected]
    ends = window and (min(window), max(window))
    bench = structs.replace(bench, expected=structs.replace(bench.expected, scale_factor_v_per_deg_s=ends))
    run = vcfbench.run(name, bench, seed=3, settings=SHORT[name], runs=tmp_path)
    bias = next(each for name, each in run.values.items() if name.startswith("bias") and each.unit == "deg/s")
    assert bias.value is not None
    assert bias.u95 is not None
    assert abs(bias.value - bias_deg_s) <= bias.u95 < 0.2
    assert not bias.missing
    assert "not those of this gyroscope" not in vcfbench.text_of(run.report())


@pytest.mark.exhaustive
@pytest.mark.parametrize(("gain", "slope"), few([(10.0, -0.0131169), (5.0, -0.0065629)], (5.0, -0.0065629)))
def test_power_states_biases_by_the_look_on_the_table(gain: float, slope: float, tmp_path: Path) -> None:
    """`slope` is that of `turntable` on the same bench."""
    bench = vcfbench.load_bench("paper")
    simulation = structs.replace(bench.simulation, override={"output_stage": {"gain": gain}})
    other = structs.replace(bench, simulation=simulation)
    run = vcfbench.run("power", other, seed=1, settings=SHORT["power"], runs=tmp_path)
    found = run.results.scale_factor_v_per_deg_s
    assert abs(found.value - slope) <= 3.0 * found.u < 0.01 * abs(slope)
    assert [name for name, each in run.values.items() if "scale factor" in each.missing] == []


def test_nothing_is_kept_by_a_scale_factor_of_the_wrong_sign(tmp_path: Path) -> None:
    assert isinstance(ended("zero", tmp_path, {"scale_factor_v_per_deg_s": -TRUE}), MeasurementError)
    assert not DeviceStore(tmp_path).standing("Z")


@pytest.mark.exhaustive
@pytest.mark.parametrize("expected", [False, True])
@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("name", SHORT)
def test_no_procedure_believes_it(name: str, wrong: str, tmp_path: Path, *, expected: bool) -> None:
    value = WRONG[wrong]
    window = sorted([0.99 * value, 1.01 * value]) if expected else None
    found = ended(name, tmp_path, {} if expected else {"scale_factor_v_per_deg_s": value}, window)
    rough = name in BY_V_VC and wrong in {"twice", "half"}
    assert (found is None) is rough
    assert not DeviceStore(tmp_path).standing("Z") or rough


@pytest.mark.parametrize("value", [1e3 * TRUE, TRUE / 3600.0])
def test_another_unit_is_refused_before_anything_is_opened(value: float) -> None:
    with pytest.raises(ConfigError, match=r"scale_factor_v_per_deg_s: expected at (most 1|least 1e-05) either way"):
        vcfbench.dry_run("zero", settings={"scale_factor_v_per_deg_s": value})


@pytest.mark.parametrize("value", [-TRUE, 2.0 * TRUE])
def test_a_setting_unlike_what_is_expected_is_refused(value: float) -> None:
    paper = vcfbench.load_bench("paper")
    bench = structs.replace(paper, expected=Expected(scale_factor_v_per_deg_s=(-0.0127, -0.0124)))
    with pytest.raises(ConfigError, match=r"expected within 10 % of -0\.0127 to -0\.0124 V/\(deg/s\)"):
        vcfbench.dry_run("zero", bench, settings={"scale_factor_v_per_deg_s": value})
    vcfbench.dry_run("zero", bench, settings={"scale_factor_v_per_deg_s": 1.05 * TRUE})


@pytest.mark.parametrize("value", [-150.0, 2000.0])
def test_k_vc_unlike_the_guess_is_refused(value: float) -> None:
    with pytest.raises(ConfigError, match=r"k_vc_deg_s_per_v = .*: expected 15 to 1500 .*k_vc_guess_deg_s_per_v"):
        vcfbench.dry_run("threshold", settings={"k_vc_deg_s_per_v": value})
