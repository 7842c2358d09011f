"""What K_Vc depends on, measured without a table: each cause corrected, not measured, or K_Vc not stated."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs

import vcfbench
from tests.procedures.test_kvc import LAB, truth, warm
from tests.procedures.test_self_calibration import aged
from vcfbench.analysis.decays import RingingMode
from vcfbench.devices.k_vc_change import k_vc_change
from vcfbench.errors import MeasurementError
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.health.check import (
    MAY_HAVE,
    charging_warning,
    checked,
    health_parts,
    not_measured,
    unmeasured,
)
from vcfbench.procedures.health.found import Health, _one_share, beside, carrier_over_drive, means_of
from vcfbench.procedures.health.plan import Modes, _expected, level_v, modes_of
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.procedures.resonance import SenseDecay
from vcfbench.procedures.self_calibration.shape import bent, has_changed, orders_of
from vcfbench.records.device_values import Characteristics
from vcfbench.records.device_values import Measured as Kept
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.simulation import physical_parameters
from vcfbench.steps import CaptureMeanSines, ConfigureScope, SineRecord, SineRecords
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.value import UncertaintyPart

if TYPE_CHECKING:
    from pathlib import Path

FRESH: dict[str, tuple[float, float]] = {
    "drive_hz": (3488.9, 1e-4),
    "split_hz": (24.8, 1e-3),
    "q_anti_phase": (1224.0, 1.5),
    "in_phase_split_hz": (146.9, 0.01),
    "q_in_phase": (1224.0, 9.0),
    "in_phase_share": (0.147, 1e-3),
    "carrier_phase_deg": (0.3, 3e-4),
    "demodulator_phase_deg": (-0.5, 5e-3),
    "v_vc_feedthrough": (0.0, 5e-6),
    "drive_amplitude_v": (1.0, 0.0),
    "carrier_amplitude_v": (2.0, 1e-5),
    "sense_phase_deg": (0.0, 0.02),
}


def health(*, exchanged: bool = True, **now: float) -> Health:
    """Return what was found by channels whose gains are within 2 %, and which are in the ratio unless `exchanged`."""

    def found(name: str, value: float, u: float) -> Any:
        parts = [UncertaintyPart("records", u)]
        if name.endswith("amplitude_v"):
            parts.append(UncertaintyPart("gain", 0.0115 * value, of="both"))
            parts.append(UncertaintyPart("gain of one", 0.0 if exchanged else 0.0115 * value))
        return measurand(value, "", parts)

    return {name: found(name, now.get(name, value), u) for name, (value, u) in FRESH.items()}


THEN = beside(health(), Characteristics())


FULL = physical_parameters(LAB)


@pytest.mark.parametrize(
    ("now", "override"),
    [
        (
            {"q_anti_phase": 612.0, "q_in_phase": 612.0},
            {name: {"quality": 612.0} for name in ("sense_anti_phase", "sense_in_phase")},
        ),
        (
            {"carrier_phase_deg": 1.3},
            {"virtual_path": {"carrier_phase_rad": FULL.virtual_path.carrier_phase_rad + math.radians(1.0)}},
        ),
        (
            {"demodulator_phase_deg": 0.5},
            {"sense_path": {"demodulator_phase_rad": FULL.sense_path.demodulator_phase_rad + math.radians(1.0)}},
        ),
        ({"drive_amplitude_v": 1.005}, {"drive_loop": {"amplitude_m": 1.005 * FULL.drive_loop.amplitude_m}}),
        ({"carrier_amplitude_v": 2.01}, {"sense_path": {"reference_amplitude_v": 2.01}}),
    ],
)
def test_a_cause_that_is_seen_is_corrected(now: dict[str, float], override: dict[str, dict[str, float]]) -> None:
    found = checked(THEN, beside(health(**now), Characteristics()))  # type: ignore[arg-type]
    before, after = (truth(warm(physical_parameters(bench)))[1] for bench in (LAB, aged(LAB, **override)))
    assert found.ppm == pytest.approx(1e6 * (after / before - 1.0), rel=0.05)
    assert found.u_ppm < 20.0
    assert not found.refused
    assert {cause.done for cause in found.causes} == {"corrected", "explained"}
    assert found.ppm == pytest.approx(sum(cause.ppm for cause in found.causes) + found.together_ppm)


@pytest.mark.parametrize("exchanged", [False, True])
def test_exchanged_ratio_has_no_error_of_a_channel(*, exchanged: bool) -> None:
    """Gains change by 2e-4 to 1e-2 of one number; the drive alone changes too, and that is all that is left."""
    for seed in range(50):
        rng = Random(seed)  # noqa: S311  # drawn cases, not secrets
        gains = [1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-3.7, -2.0) for _ in range(2)]
        drive_v, carrier_v = (rng.uniform(0.3, 3.0) for _ in range(2))

        def seen(on_drive: int, drive_v: float = drive_v, carrier_v: float = carrier_v) -> SineRecord:
            return SineRecord(3489.0, (gains[on_drive] * drive_v, gains[1 - on_drive] * carrier_v), (0.0, 90.0))  # noqa: B023

        (ratio,) = carrier_over_drive([seen(0)], [seen(1)] if exchanged else [])
        assert (abs(ratio * drive_v / carrier_v - 1.0) < 1e-12) == exchanged


def test_means_are_told_apart_by_the_channel_on_the_drive() -> None:
    record = SineRecord(3489.0, (1.0, 2.0), (0.0, 90.0))
    ways = [(1, 2), (2, 1), (2, 1), (1, 2)]
    steps = [(CaptureMeanSines(way, (2.0, 2.0), 1, record), SineRecords(way, (record,))) for way in ways]
    means, turned = means_of(SimpleNamespace(found=lambda _kind: steps), 1)  # type: ignore[arg-type]
    assert (len(means), len(turned)) == (2, 2)


def test_unexchanged_probes_do_not_correct_amplitudes() -> None:
    found = checked(THEN, beside(health(exchanged=False, carrier_amplitude_v=2.04), Characteristics()))
    assert not found.refused
    assert found.u_ppm < 20.0  # not 16 000
    assert [cause.done for cause in found.causes if "amplitude" in cause.cause] == ["not measured"]


def test_measured_split_and_q_are_not_counted_in_temperature() -> None:
    """Without a drive frequency temperature is the thermometer's: what it did to split and Q is measured."""
    then = structs.replace(
        THEN, drive_hz=None, drive_ppm_k=Kept(value=-30.0, u=0.0), split_hz_k=Kept(value=0.0035, u=0.0)
    )
    at = [Kept(value=each, u=0.0) for each in (20.0, 35.0)]
    q = Kept(value=0.97 * 1224.0, u=0.0)
    now = Characteristics(temperature_c=at[1], q_anti_phase=q, q_in_phase=q)
    parts = {each.quantity: each.ppm for each in k_vc_change(structs.replace(then, temperature_c=at[0]), now).parts}
    assert parts["temperature_c"] == pytest.approx(450.0, abs=4.0)  # with Q's share it would be 441
    assert parts["q_anti_phase"] == pytest.approx(-8.0, abs=2.0)


def test_k_vc_is_refused_after_uncorrectable_change() -> None:
    larger = checked(THEN, beside(health(exchanged=False, carrier_amplitude_v=2.4), Characteristics()))
    assert "+200000 ppm" in larger.refused[0]
    turned = checked(THEN, beside(health(sense_phase_deg=0.4), Characteristics()))
    assert "+0.40 deg" in turned.refused[0]
    assert "K_Vc is not stated: the phase" in health_parts(turned)[1].text  # type: ignore[union-attr]
    of_certificate = structs.replace(THEN, sense_phase_deg=Kept(value=0.4, u=0.0))
    assert not checked(of_certificate, beside(health(sense_phase_deg=0.4), Characteristics())).refused
    back = checked(of_certificate, beside(health(sense_phase_deg=0.0), Characteristics()))
    assert "-0.40 deg" in back.refused[0]


def test_phase_of_few_noisy_records_is_refused_beyond_chance_alone() -> None:
    before = structs.replace(THEN, sense_phase_deg=Kept(value=-1.01, u=0.43, dof=14.0))
    for moved_deg, refused in ((2.9, False), (5.0, True)):
        after = structs.replace(THEN, sense_phase_deg=Kept(value=moved_deg - 1.01, u=0.69, dof=14.0))
        assert bool(checked(before, after).refused) is refused


def test_nothing_is_left_unmeasured_where_all_was_measured() -> None:
    stated = SimpleNamespace(station=SimpleNamespace(sources=SimpleNamespace(k_vc_not_measured_ppm=300.0)))
    names = [name for name, *_ in MAY_HAVE]
    assert unmeasured(stated, names) == []  # type: ignore[arg-type]
    (part,) = unmeasured(stated, names[1:])  # type: ignore[arg-type]
    assert (part.u, part.rectangular) == (pytest.approx(300e-6 / math.sqrt(3.0)), True)


def test_a_split_that_temperature_does_not_explain_is_a_warning() -> None:
    cold = checked(THEN, beside(health(drive_hz=3487.3, split_hz=24.85), Characteristics(split_hz_k=None)))
    charged = checked(THEN, beside(health(split_hz=25.3), Characteristics()))
    assert cold.warning is None
    assert charged.warning is not None and "charges on the combs" in charged.warning  # noqa: PT018


@pytest.mark.parametrize("split_hz", [24.8, -24.8])
@pytest.mark.parametrize("rise_k", [-8.0, 8.0])
@pytest.mark.parametrize("per_k", [0.05, -0.05])
def test_warned_is_of_what_temperature_leaves_of_a_split_s_size(split_hz: float, rise_k: float, per_k: float) -> None:
    def at(temperature_c: float, size_hz: float) -> Characteristics:
        split = Kept(value=math.copysign(size_hz, split_hz), u=1e-3)
        of_size = Kept(value=per_k, u=1e-3)
        return Characteristics(split_hz=split, split_hz_k=of_size, temperature_c=Kept(value=temperature_c, u=0.0))

    def warned(beyond_hz: float) -> str | None:
        return charging_warning(at(20.0, 24.8), at(20.0 + rise_k, 24.8 + per_k * rise_k + beyond_hz))

    assert warned(0.0) is None
    for beyond_hz in (-0.5, 0.5):
        assert f"changed by {beyond_hz:+.3f} Hz in size" in str(warned(beyond_hz))


def test_changed_modulator_shape_is_separated_from_output() -> None:
    output, then, now = np.array([8.4e-6, -2.6e-8]), np.array([0.2, 150.0, 1.95, 2.2]), np.array([0.2, 150.0, 1.5, 2.9])
    v_vc_v = np.array([0.001, 0.13, -0.13, 0.7, -0.7, 1.3, -1.3])
    rates = np.polynomial.polynomial.polyval(v_vc_v, now)
    outputs = -0.0125 * np.polynomial.polynomial.polyval(rates, [0.0, 1.0, *output])
    outputs, noise = outputs[1:] - outputs[0], 1e-10 * np.eye(6)
    orders, covariance = orders_of(then, v_vc_v, outputs, noise)
    known = [Kept(value=value, u=0.0) for value in output]
    seen = Characteristics(output_second_per_deg_s=known[0], output_third_per_deg_s2=known[1])
    assert has_changed(orders, covariance, output, seen)
    found = bent(then, v_vc_v, outputs, noise, output)
    assert found == pytest.approx(now, rel=2e-3)
    assert not has_changed(*orders_of(found, v_vc_v, outputs, noise), output, seen)


@pytest.mark.parametrize(("sizes", "changed"), [(0.99, False), (1.01, True)])
def test_curve_has_changed_beyond_chi_square_of_one_in_thousand(sizes: float, *, changed: bool) -> None:
    covariance, u = np.array([[4e-12, 1e-14], [1e-14, 9e-16]]), (1.5e-6, 2e-8)
    then = Characteristics(
        output_second_per_deg_s=Kept(value=8.4e-6, u=u[0]), output_third_per_deg_s2=Kept(value=-2.6e-8, u=u[1])
    )
    both = covariance + np.diag(np.square(u))
    for angle in np.linspace(0.0, 2.0 * np.pi, 9):
        off = np.linalg.cholesky(both) @ [np.cos(angle), np.sin(angle)] * sizes * math.sqrt(-2.0 * math.log(1e-3))
        output = np.array([8.4e-6, -2.6e-8])
        assert has_changed(output + off, covariance, output, then) is changed


@pytest.mark.parametrize("rest_v", [-0.4, 0.0, 0.3])
def test_orders_of_an_output_are_those_at_rest_wherever_v_vc_is_then(rest_v: float) -> None:
    """With an offset of V_Vc at rest the rates are not about 0; the covariance is what the outputs' noise makes."""
    orders, curve = np.array([8.4e-5, -2.6e-7]), np.array([0.2, 150.0, 1.95, 2.2])
    v_vc_v = np.array([rest_v, 0.13, -0.13, 0.7, -0.7, 1.3, -1.3])
    rates = np.polynomial.polynomial.polyval(v_vc_v, curve)
    outputs = -0.0125 * np.polynomial.polynomial.polyval(rates, [0.0, 1.0, *orders])
    outputs, noise = outputs[1:] - outputs[0], 1e-10 * (np.eye(6) + 1.0)
    found, covariance = orders_of(curve, v_vc_v, outputs, noise)
    assert found == pytest.approx(orders, rel=1e-6)
    moves = [(orders_of(curve, v_vc_v, outputs + row, noise)[0] - found) / 1e-6 for row in 1e-6 * np.eye(6)]
    expected = np.transpose(moves) @ noise @ moves
    u = np.sqrt(np.diag(expected))
    assert covariance / np.outer(u, u) == pytest.approx(expected / np.outer(u, u), abs=0.05)


@pytest.mark.parametrize("splits_hz", [(-25.0, -150.0), (25.0, 150.0), (-25.0, 150.0)])
@pytest.mark.parametrize("share", [0.15, 0.6, -0.2])
@pytest.mark.parametrize("late_s", [0.0, 0.05])
def test_share_by_a_ring_down_is_that_of_the_static_answers(
    splits_hz: tuple[float, float], share: float, late_s: float
) -> None:
    """Forces that make 1 - s and s of the static answer, their motions at the drive, released there and seen later."""
    at_hz, q = [3489.0 + split_hz for split_hz in splits_hz], (1200.0, 700.0)
    dynamic = [f**2 - 3489.0**2 + 1j * f * 3489.0 / own for f, own in zip(at_hz, q, strict=True)]
    forces = [part * each.real for part, each in zip((1.0 - share, share), dynamic, strict=True)]
    motions = [force / each for force, each in zip(forces, dynamic, strict=True)]
    sizes = [
        abs(moved) * 0.5 * (1.0 + 3489.0 / f) * math.exp(-math.pi * f / own * late_s)
        for moved, f, own in zip(motions, at_hz, q, strict=True)
    ]
    modes = Modes(3489.0, *(RingingMode(*each) for each in zip(at_hz, q, sizes, strict=True)))
    sign = math.copysign(1.0, forces[0] * forces[1])
    found = _one_share(modes, sign, abs(sum(motions)))
    assert found == pytest.approx(share, rel=0.01 if late_s else 1e-6)  # rounds towards when it was released


@pytest.mark.parametrize("splits_hz", [(-25.0, -150.0), (25.0, 150.0), (-25.0, 150.0), (25.0, -150.0)])
def test_the_mode_nearer_to_the_drive_is_that_in_anti_phase(splits_hz: tuple[float, float]) -> None:
    modes = tuple(RingingMode(3489.0 + split_hz, 1200.0, 1.0) for split_hz in splits_hz)
    for order in (modes, modes[::-1]):
        found = modes_of(SenseDecay(3489.0, order))
        assert (found.anti_phase, found.in_phase) == modes


def test_a_dry_run_finds_nothing_that_has_changed() -> None:
    planned = vcfbench.dry_run("kvc", LAB)
    words = [each.step.describe() for each in planned.steps]
    assert "oscilloscope: the sense modes ring down" in words
    assert planned.bench_seconds - vcfbench.dry_run("kvc", LAB, settings={"health": False}).bench_seconds < 600.0


@pytest.mark.parametrize("k_vc", [-400.0, -150.0, 150.0, 20.0])
@pytest.mark.parametrize("limit_v", [None, 0.2, 1.0, 5.0])
def test_ring_downs_leave_room_for_larger_sines(k_vc: float, limit_v: float | None) -> None:
    """52.5 % of the largest rate, 200 deg/s, at most half of what the bench or a 10 V range may have."""
    known = settings_of(PROCEDURES["kvc"], LAB, asked_in_python({"k_vc_guess_deg_s_per_v": k_vc}))
    limits = structs.replace(known.station.limits, max_v_vc_v=limit_v)
    settings: Any = structs.replace(known, station=structs.replace(known.station, limits=limits))
    assert level_v(settings) == pytest.approx(min(105.0 / abs(k_vc), 0.5 * (limit_v or 10.0)))


@pytest.mark.parametrize("drive_hz", [1e3, 3488.9, 5e4])
def test_modes_of_a_dry_run_share_what_is_at_rest(drive_hz: float) -> None:
    modes = _expected(drive_hz)
    found = [(drive_hz - each.frequency_hz, each.q, each.amplitude_v) for each in (modes.anti_phase, modes.in_phase)]
    assert found == [pytest.approx((25.0, 1200.0, 0.85)), pytest.approx((150.0, 1200.0, 0.15))]


def test_exchanged_probes_begin_evenly_over_the_drive() -> None:
    steps = [each.step for each in vcfbench.dry_run("kvc", LAB).steps]
    begins: dict[int, list[float]] = {}
    for scope, mean in pairwise(steps):
        if isinstance(mean, CaptureMeanSines):
            assert isinstance(scope, ConfigureScope)
            assert (scope.trigger_channel, mean.expected.amplitudes_v[0]) == (mean.channels[0], 1.0)
            begins.setdefault(scope.trigger_channel, []).append(scope.level_v)
    assert len(begins) == 2
    for levels_v in begins.values():
        assert sorted(levels_v) == pytest.approx(np.linspace(-0.8, 0.8, 12))


def test_what_the_bench_cannot_measure_is_said_not_to_be(tmp_path: Path) -> None:
    del tmp_path
    field = vcfbench.load_bench("examples/field-bench.toml")
    words = [
        each.step.describe() for each in vcfbench.dry_run("self-calibration", field, settings={"k_vc": "150"}).steps
    ]
    assert any(word.startswith("NOT CHECKED: what K_Vc depends on") for word in words)


def test_unmeasured_cause_widens_u95() -> None:
    found = {part.source: 1e6 * part.u for part in not_measured(THEN)}
    assert math.hypot(*found.values()) > 750.0  # a degree of the carrier is 1270 ppm
    assert found["not measured: Q (by 50 %, assumed)"] == pytest.approx(254.0 / math.sqrt(3.0), rel=0.05)
    nothing_known = {part.source: 1e6 * part.u for part in not_measured(None)}
    assert math.hypot(*nothing_known.values()) > math.hypot(*found.values())
    assert len(not_measured(THEN, but=["Q"])) == len(found) - 1


@pytest.mark.exhaustive
def test_changed_oscilloscope_is_no_change_of_k_vc(tmp_path: Path) -> None:
    settings = {"dut": "G", "devices": str(tmp_path / "devices"), "warm_up_s": 1800.0}

    def bench(gain: float) -> Any:
        errors = {"gain_error": [gain, 0.0, 0.0, 0.0], "noise_div": 0.02, "converter_bits": 8}
        simulation = structs.replace(LAB.simulation.errors, oscilloscope=errors)  # type: ignore[union-attr]
        return structs.replace(LAB, simulation=structs.replace(LAB.simulation, errors=simulation))  # type: ignore[type-var]

    vcfbench.run("kvc", bench(0.0), seed=1, settings=settings, runs=tmp_path)
    found = vcfbench.run("self-calibration", bench(0.01), seed=2, settings=settings, runs=tmp_path).results
    true, _ = truth(warm(physical_parameters(LAB)))
    assert abs(found.scale_factor.value - true) < found.scale_factor.u95 < 100e-6 * abs(true)
    assert not found.scale_factor.missing


@pytest.mark.exhaustive
def test_ageing_of_visible_causes_leaves_k_right(tmp_path: Path) -> None:
    fresh = physical_parameters(LAB)
    settings = {"dut": "G", "devices": str(tmp_path / "devices"), "warm_up_s": 1800.0}
    vcfbench.run("kvc", LAB, seed=1, settings=settings, runs=tmp_path)
    modes = {name: {"quality": 0.6 * getattr(fresh, name).quality} for name in ("sense_in_phase", "sense_anti_phase")}
    modes["sense_anti_phase"]["frequency_hz"] = fresh.sense_anti_phase.frequency_hz - 0.4
    old = aged(
        LAB,
        **modes,
        virtual_path={
            "carrier_phase_rad": fresh.virtual_path.carrier_phase_rad + math.radians(1.0),
            "third_order_per_v2": 1.3 * fresh.virtual_path.third_order_per_v2,
        },
        sense_path={
            "demodulator_phase_rad": fresh.sense_path.demodulator_phase_rad - math.radians(1.0),
            "v_vc_feedthrough": 5e-4,
        },
        thermal={"ambient_c": 32.0},
    )
    output_v = warm_output(physical_parameters(old))
    scale_factor = (output_v(0.01, None) - output_v(-0.01, None)) / 0.02
    found = vcfbench.run("self-calibration", old, seed=1, settings=settings, runs=tmp_path)
    assert abs(found.results.health.ppm) > 1000.0
    assert found.results.modulator[1] == pytest.approx(1.3 * fresh.virtual_path.third_order_per_v2, rel=0.02)
    assert abs(found.results.scale_factor.value / scale_factor - 1.0) < 2e-4
    assert abs(found.results.scale_factor.value - scale_factor) < 3.5 * found.results.scale_factor.u
    entry = vcfbench.load_device("G", tmp_path / "devices").self_calibrations[-1]
    assert entry.characteristics is not None
    assert entry.characteristics.q_anti_phase.value == pytest.approx(0.6 * 1224.0, rel=0.03)  # type: ignore[union-attr]
    assert vcfbench.load_run(found.directory).results == found.results  # type: ignore[arg-type]


def test_a_k_vc_that_is_refused_ends_the_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from vcfbench.procedures.self_calibration import results as of  # noqa: PLC0415

    refused = checked(THEN, beside(health(sense_phase_deg=0.4), Characteristics()))
    monkeypatch.setattr(of, "_health", lambda _settings, _points: (THEN, refused))
    settings = {"k_vc": "150", "cycles": 1, "samples": 2, "virtual_rates_deg_s": [20.0, 100.0, 200.0]}
    with pytest.raises(MeasurementError, match=r"does not hold any more: the phase of the sense signal") as ended:
        vcfbench.run("self-calibration", "examples/field-bench.toml", settings=settings, runs=tmp_path)
    assert ended.value.exit_code == 3
    assert ended.value.run is not None
    assert not hasattr(ended.value.run.results, "scale_factor")
