"""A sense mode below or above the drive: what K_Vc depends on, by the signs of drawn gyroscopes."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from msgspec import structs

import vcfbench
from vcfbench.analysis.decays import RingingMode
from vcfbench.devices.k_vc_change import at_temperature, k_vc_change, k_vc_sensitivities
from vcfbench.procedures.bandwidth import characteristics
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.health.check import checked, not_measured
from vcfbench.procedures.health.found import _feedthrough  # type: ignore[attr-defined]
from vcfbench.procedures.health.plan import Modes
from vcfbench.records.device_values import Characteristics, Measured
from vcfbench.records.devices import Certificate, DeviceStore, together
from vcfbench.sim.gyro.data_sheet import DataSheet, own_gyro
from vcfbench.sim.gyro.design import demodulated
from vcfbench.sim.own_gyro import own_gyro_bench
from vcfbench.sim.simulation import physical_parameters
from vcfbench.steps import RotationRecord
from vcfbench.testing.gyroscopes import drawn_sheet
from vcfbench.uncertainty.measurand import as_kept, measurand
from vcfbench.values.value import UncertaintyPart

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.sim.parameters import BenchParameters, SenseMode

SEEDS = range(40)


def drawn(seed: int) -> BenchParameters:
    """Return a gyroscope with the phases and combs of a real one."""
    of = own_gyro(drawn_sheet(seed), imperfections=True, latitude_deg=0.0)
    return structs.replace(of, sense_path=structs.replace(of.sense_path, v_vc_feedthrough=2e-5))


def k_vc(of: BenchParameters) -> float:
    """Return K_Vc by the closed form of the simulation's steady state, (deg/s)/V."""
    found = demodulated(of, 0.0, of.drive_loop.amplitude_m)
    return found.per_v / found.per_deg_s


def measured(of: BenchParameters) -> Characteristics:
    """Return what would be measured of it without an error, by the definitions."""
    drive_hz, path, virtual = of.drive_mode.frequency_hz, of.sense_path, of.virtual_path

    def answer(mode: SenseMode, force: float) -> complex:
        stiff = mode.frequency_hz**2 - drive_hz**2
        return force * mode.pick_off_v_per_m / complex(stiff, mode.frequency_hz * drive_hz / mode.quality)

    def combs(mode: SenseMode) -> float:
        left, right = mode.left_participation, mode.right_participation
        return left * virtual.left_comb_n_per_v2 + right * virtual.right_comb_n_per_v2

    modes = of.sense_in_phase, of.sense_anti_phase
    answers = [answer(mode, combs(mode)) for mode in modes]
    static = [combs(mode) * mode.pick_off_v_per_m / (mode.frequency_hz**2 - drive_hz**2) for mode in modes]
    by_rate = [combs(mode) / (mode.left_participation + mode.right_participation) for mode in modes]
    in_unit = (2.0 * math.pi) ** 2 * virtual.mass_kg / (path.preamplifier_gain * path.amplifier_gain)
    through = path.v_vc_feedthrough / path.reference_amplitude_v * in_unit / abs(sum(answers))
    values = {
        "drive_hz": drive_hz,
        "split_hz": drive_hz - of.sense_anti_phase.frequency_hz,
        "q_anti_phase": of.sense_anti_phase.quality,
        "in_phase_split_hz": drive_hz - of.sense_in_phase.frequency_hz,
        "q_in_phase": of.sense_in_phase.quality,
        "in_phase_share": static[0] / sum(static),
        "carrier_phase_deg": math.remainder(math.degrees(virtual.carrier_phase_rad), 180.0),
        "demodulator_phase_deg": math.remainder(math.degrees(path.demodulator_phase_rad), 180.0),
        "comb_mismatch": by_rate[0] / by_rate[1] - 1.0,
        "v_vc_feedthrough": math.copysign(1.0, by_rate[1]) * through,
        "drive_amplitude_v": of.drive_loop.amplitude_m * of.drive_loop.pick_off_v_per_m,
        "carrier_amplitude_v": path.reference_amplitude_v,
    }
    return Characteristics(**{name: Measured(value=value, u=0.0) for name, value in values.items()})


MOVED: dict[str, tuple[str, str, float, float]] = {
    "split_hz": ("sense_anti_phase", "frequency_hz", 1e-4, -1.0),
    "q_anti_phase": ("sense_anti_phase", "quality", 1e-2, 1.0),
    "in_phase_split_hz": ("sense_in_phase", "frequency_hz", 1e-4, -1.0),
    "q_in_phase": ("sense_in_phase", "quality", 1e-2, 1.0),
    "carrier_phase_deg": ("virtual_path", "carrier_phase_rad", 1e-6, 180.0 / math.pi),
    "demodulator_phase_deg": ("sense_path", "demodulator_phase_rad", 1e-6, 180.0 / math.pi),
}
"""What is moved of the simulation for each quantity, by how much, and its unit in that of the quantity."""


def by_difference(of: BenchParameters, name: str) -> float:
    """Return the sensitivity of K_Vc, ppm for one unit, by moving a parameter of the simulation."""
    group, key, step, unit = MOVED[name]
    own = getattr(of, group)
    ends = [
        k_vc(structs.replace(of, **{group: structs.replace(own, **{key: getattr(own, key) + sign * step})}))
        for sign in (1.0, -1.0)
    ]
    return 1e6 * (ends[0] - ends[1]) / (2.0 * step * unit) / k_vc(of)


def sensitivities(known: Characteristics) -> dict[str, Measured]:
    return {
        each.quantity: Measured(value=each.ppm_per_unit, u=each.u_ppm_per_unit) for each in k_vc_sensitivities(known)
    }


def only_size(known: Characteristics) -> Characteristics:
    """Return what is known where `bandwidth` alone has seen the split."""
    assert known.split_hz is not None
    size = structs.replace(known.split_hz, value=abs(known.split_hz.value))
    return structs.replace(known, split_hz=None, split_size_hz=size)


@pytest.mark.parametrize("seed", SEEDS)
def test_drawn_gyroscopes_have_sensitivity_signs_of_closed_form(seed: int) -> None:
    of = drawn(seed)
    found = sensitivities(measured(of))
    for name in MOVED:
        assert found[name].value == pytest.approx(by_difference(of, name), rel=2e-3, abs=1e-3), name


@pytest.mark.parametrize("seed", SEEDS)
def test_a_split_without_a_sign_leaves_the_sensitivities_of_either(seed: int) -> None:
    of = drawn(seed)
    found = sensitivities(only_size(measured(of)))
    for name in MOVED:
        apart = abs(found[name].value - by_difference(of, name))
        assert apart <= 1.01 * found[name].u + 2e-3 * abs(found[name].value) + 1e-3, name


def test_the_signs_of_both_splits_are_among_the_drawn() -> None:
    assert {math.copysign(1.0, drawn_sheet(seed).split_hz) for seed in SEEDS} == {1.0, -1.0}


@pytest.mark.parametrize("split_hz", [24.8, -24.8])
def test_what_nobody_measured_holds_for_a_mode_on_either_side(split_hz: float) -> None:
    sheet = structs.replace(drawn_sheet(0), drive_hz=3488.9, split_hz=split_hz, q_sense=1224.0)
    of = own_gyro(sheet, imperfections=True, latitude_deg=0.0)
    found = sensitivities(Characteristics())
    for name in ("carrier_phase_deg", "split_hz", "q_anti_phase"):
        assert abs(found[name].value - by_difference(of, name)) <= 2.0 * found[name].u, name


@pytest.mark.parametrize("split_hz", [24.8, -24.8])
def test_the_share_of_the_modes_counts_on_either_side(split_hz: float) -> None:
    """Its u goes through the change of a split by 0.5 Hz; it was cut at 0, and so was a split at 0.01 Hz."""
    share = math.copysign(0.147, split_hz)
    then = Characteristics(
        split_hz=Measured(value=split_hz, u=0.0),
        in_phase_split_hz=Measured(value=146.9, u=0.0),
        q_anti_phase=Measured(value=1224.0, u=0.0),
        q_in_phase=Measured(value=1224.0, u=0.0),
        in_phase_share=Measured(value=share, u=0.01),
        carrier_phase_deg=Measured(value=2.0, u=0.0),
        demodulator_phase_deg=Measured(value=0.0, u=0.0),
        comb_mismatch=Measured(value=0.01, u=0.0),
        v_vc_feedthrough=Measured(value=0.0, u=0.0),
    )
    now = Characteristics(split_hz=Measured(value=split_hz + 0.5, u=0.0))

    def ppm(value: float) -> float:
        return k_vc_change(structs.replace(then, in_phase_share=Measured(value=value, u=0.0)), now).ppm

    expected = 0.5 * abs(ppm(share + 0.01) - ppm(share - 0.01))
    assert k_vc_change(then, now).u_ppm == pytest.approx(expected, rel=1e-6)
    assert expected > 0.5


@pytest.mark.parametrize("split_hz", [24.8, -24.8])
def test_split_without_sign_takes_the_sign_of_now(split_hz: float) -> None:
    then = structs.replace(measured(drawn(1)), split_hz=Measured(value=split_hz, u=0.01))
    now = Characteristics(split_hz=Measured(value=split_hz + 0.1, u=0.01))
    both, of_size = k_vc_change(then, now), k_vc_change(only_size(then), now)
    assert of_size.ppm == pytest.approx(both.ppm)
    assert of_size.u_ppm == pytest.approx(both.u_ppm)
    assert checked(only_size(then), now).ppm == pytest.approx(both.ppm)


def test_unseen_change_is_worse_of_both_signs() -> None:
    known = measured(drawn(2))
    assert known.split_hz is not None
    either = [
        {part.source: part.u for part in not_measured(structs.replace(known, split_hz=Measured(value=value, u=0.0)))}
        for value in (known.split_hz.value, -known.split_hz.value)
    ]
    for part in not_measured(only_size(known)):
        assert part.u == pytest.approx(max(each[part.source] for each in either), rel=1e-6)


@pytest.mark.parametrize("split_hz", [24.8, -24.8])
def test_split_size_follows_temperature_on_either_side(split_hz: float) -> None:
    per_k, at = Measured(value=0.0027, u=1e-4), Measured(value=20.0, u=0.0)
    known = Characteristics(temperature_c=at, split_hz=Measured(value=split_hz, u=0.0), split_hz_k=per_k)
    for each in (known, only_size(known)):
        warm = at_temperature(each, Measured(value=30.0, u=0.0))
        found = warm.split_hz or warm.split_size_hz
        assert found is not None
        assert abs(found.value) == pytest.approx(24.827)
        assert found.u == pytest.approx(1e-3)
        assert (warm.split_hz is None) == (each.split_hz is None)


def test_split_has_size_of_sweep_and_sign_of_ring_down() -> None:
    swept = Characteristics(split_size_hz=Measured(value=24.8, u=1e-3))
    rang = Characteristics(split_hz=Measured(value=-24.7, u=1e-2))
    assert together([swept]).split_hz is None
    assert together([swept, rang]) == rang
    assert together([rang, swept]).split_hz == Measured(value=-24.8, u=1e-3)
    assert together([rang, swept]).split_size_hz is None


def test_bandwidth_keeps_no_sign() -> None:
    found = measurand(24.8, "Hz", [UncertaintyPart("noise", 1e-3)])
    band = {"drive_hz": 3488.9, "u_drive_hz": 0.01, "in_phase_share": 0.1, "u_in_phase_share": 0.01}
    kept = characteristics(SimpleNamespace(**band, split_hz=found, q=found))  # type: ignore[arg-type]
    assert (kept.split_hz, kept.split_size_hz) == (None, as_kept(found))


def far_records(split_hz: float, through: float) -> tuple[Modes, float, list[RotationRecord]]:
    """Return modes, the share of the in-phase one, and records far from the drive with a feed-through."""
    drive_hz, q, weight = 3488.9, 1224.0, 0.9
    modes = Modes(drive_hz, RingingMode(drive_hz - split_hz, q, 1.0), RingingMode(drive_hz - 146.9, q, 0.2))

    def moved(at_hz: float) -> complex:
        answers = [
            1.0 / complex(mode.frequency_hz**2 - at_hz**2, mode.frequency_hz * at_hz / mode.q)
            for mode in (modes.anti_phase, modes.in_phase)
        ]
        return answers[0] + weight * answers[1]

    at_rest = abs(moved(drive_hz))
    stiff = [mode.frequency_hz**2 - drive_hz**2 for mode in (modes.anti_phase, modes.in_phase)]
    share = weight / stiff[1] / (weight / stiff[1] + 1.0 / stiff[0])
    far = [
        RotationRecord(drive_hz, off_hz, 0.0, abs(moved(drive_hz + off_hz) / at_rest + through), 0.0)
        for off_hz in (0.43 * drive_hz, -0.43 * drive_hz)
        for _ in range(2)
    ]
    return modes, share, far


@pytest.mark.parametrize("split_hz", [24.8, -24.8])
@pytest.mark.parametrize("through", [3e-4, -3e-4])
def test_feed_through_has_its_sign_on_either_side(split_hz: float, through: float) -> None:
    """Amplitudes far above and below the drive, where the feed-through adds to one and takes from the other."""
    modes, share, far = far_records(split_hz, through)
    found = _feedthrough(far, modes, Measured(value=share, u=0.01), 1.0)
    assert found.value == pytest.approx(through, rel=0.05)


EVERY = pytest.mark.exhaustive
CORNERS = [
    pytest.param(k_vc, slope, split_hz, marks=[] if (k_vc, slope, split_hz) == (-150.0, 0.0125, -24.8) else [EVERY])
    for k_vc in (150.0, -150.0)
    for slope in (0.0125, -0.0125)
    for split_hz in (24.8, -24.8)
]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("k_vc_deg_s_per_v", "slope", "split_hz"), CORNERS)
def test_the_store_has_the_signs_of_the_gyroscope(
    k_vc_deg_s_per_v: float, slope: float, split_hz: float, tmp_path: Path
) -> None:
    """By `kvc` with health; K_Vc, splits, share, phases and sensitivities of either sign."""
    sheet = DataSheet(
        scale_factor_v_per_deg_s=slope,
        k_vc_deg_s_per_v=k_vc_deg_s_per_v,
        split_hz=split_hz,
        angle_random_walk_deg_sqrt_h=0.2,
        bias_instability_deg_h=3.0,
    )
    bench = parse_bench(own_gyro_bench(sheet, "drawn", imperfections=True), "drawn")
    settings = {"dut": "G", "devices": str(tmp_path), "cycles": 1, "samples": 5, "warm_up_s": 1800.0}
    vcfbench.run("kvc", bench, seed=2, settings=settings, runs=tmp_path)
    record = DeviceStore(tmp_path).certificate("G").record
    assert isinstance(record, Certificate)
    assert record.k_vc.coefficients[1] == pytest.approx(k_vc_deg_s_per_v, rel=1e-3)
    assert record.scale_factor_v_per_deg_s is not None
    assert record.scale_factor_v_per_deg_s.value == pytest.approx(slope, rel=1e-3)
    assert record.characteristics is not None
    true = measured(physical_parameters(bench))
    for name in ("split_hz", "in_phase_split_hz", "carrier_phase_deg", "demodulator_phase_deg", "in_phase_share"):
        found, right = getattr(record.characteristics, name), getattr(true, name)
        scatter = 0.06 * abs(right.value) if name == "in_phase_share" else 0.0  # its u holds that of the records alone
        few = found.dof is not None and found.dof < 4.0  # four records: Student's t of 5 sd is 12
        assert abs(found.value - right.value) <= (12.0 if few else 5.0) * found.u + scatter, name
    assert record.characteristics.split_size_hz is None
    by = {each.quantity: each for each in record.sensitivities}
    for name in ("carrier_phase_deg", "split_hz", "q_anti_phase"):
        right = sensitivities(true)[name]
        found = by[name]
        assert abs(found.ppm_per_unit - right.value) <= 3.0 * found.u_ppm_per_unit + 0.02 * abs(right.value), name
