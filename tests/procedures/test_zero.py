"""The static record: its plan, and what it finds of the noise that the paper's gyroscope is simulated with."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.procedures.fakes import FakeBench, MemoryJournal
from vcfbench.analysis.allan import Sampling, Term, deviation_factor
from vcfbench.analysis.noise_fit import Coefficients, NoiseFit, NoiseTerm
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.files import opened
from vcfbench.instructions.scale_factor import scale_factor_used
from vcfbench.procedures.zero.noise import by_scatter, record_noise, with_what_is_let_through, without_meter
from vcfbench.procedures.zero.plan import ZERO
from vcfbench.procedures.zero.results import Mode, ZeroResult, ZeroSettings, zero_report, zero_results
from vcfbench.records import journal
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.station.parts import Limits
from vcfbench.station.settings import Sources, Station
from vcfbench.steps import Acquire, AcquireGapless, EnableSupply, EnableTable, EnableVvc, Settle
from vcfbench.steps.dry_run import walk
from vcfbench.steps.executor import Executor

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

PAPER = paper_bench()
N_DEG_RTH = 60.0 * PAPER.noise.angle_random_walk_deg_sqrt_s
B_DEG_H = 3600.0 * PAPER.noise.bias_instability_deg_s
TRUE_SCALE = -0.0125527
ON_PAPER: dict[str, Any] = {"scale_factor_v_per_deg_s": TRUE_SCALE}


def run(runs: Path, *, seed: int = 3, **settings: Any) -> Run:
    return vcfbench.run("zero", seed=seed, settings={**ON_PAPER, **settings}, runs=runs)


@pytest.fixture(scope="module")
def hour(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """An hour at one reading of 0.2 s a second, its 3.4 Hz of noise declared."""
    return run(tmp_path_factory.mktemp("hour"), noise_bandwidth_hz=3.4)


AS_READ = ZeroSettings(scale_factor_v_per_deg_s=1.0, nplc=50, mode=Mode.GAPLESS)
"""One reading after the other, each of a second, in deg/s."""


def of_record(record: Any, settings: ZeroSettings) -> ZeroResult:
    scale = scale_factor_used(settings)
    return zero_results(settings, scale, record, settings.sample_interval_s * np.arange(float(record.size)))


def shown(found: ZeroResult, settings: ZeroSettings) -> str:
    return vcfbench.text_of(ZERO.report(settings, vcfbench.Measured(()), found))


def walk_of(results: ZeroResult) -> tuple[float, float]:
    found = results.coefficient("angle random walk")
    assert found.value is not None
    assert found.u is not None
    return found.value, found.u


@pytest.mark.exhaustive
def test_dead_time_of_one_reading_is_corrected(hour: Run) -> None:
    value, u = walk_of(hour.results)
    assert hour.results.angle_random_walk_as_read / N_DEG_RTH == pytest.approx(2.6, abs=0.1)
    assert hour.results.white_noise_seen == pytest.approx(math.sqrt(2.0 * 3.4))
    assert abs(value - N_DEG_RTH) < 3.0 * u < 0.015
    unstable = hour.results.coefficient("bias instability")
    assert abs(unstable.value - B_DEG_H) < 3.0 * unstable.u < 3.3
    text = vcfbench.text_of(hour.report())
    assert "white noise appears 2.61 times too large" in text
    assert f"for [uncertainty] of the bench file: bias_instability_deg_h = {unstable.value:.3g}\n" in text
    assert "NOT corrected" not in text


@pytest.mark.exhaustive
def test_a_record_is_read_once_for_its_results_and_readings(hour: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """A million readings take a second each time."""
    opens = []
    monkeypatch.setattr(journal, "opened", lambda *arguments: opens.append(arguments) or opened(*arguments))
    assert hour.directory is not None
    read = vcfbench.load_run(hour.directory)
    assert read.measured.readings.voltage_v.size == 3600
    assert len(opens) == 1
    assert read.measured.broken_off is False
    assert len(opens) == 2  # what is not kept is on the disk, and not in memory


@pytest.mark.exhaustive
def test_as_it_stands_is_said_to_be_so(hour: Run, tmp_path: Path) -> None:
    raw = run(tmp_path, seed=5, mode="dead-time", duration_s=1200.0)
    value, u = walk_of(raw.results)
    assert value == pytest.approx(2.6 * N_DEG_RTH, abs=2.0 * u)
    assert value - N_DEG_RTH > 3.0 * u
    assert raw.results.dead_share == pytest.approx(0.8)
    assert raw.results.white_noise_seen == pytest.approx(math.sqrt(5.0))
    assert all(row.corrected is None for row in raw.results.allan_deg_h)
    assert "NOT corrected" in vcfbench.text_of(raw.report())
    assert hour.results.allan_deg_h[0].corrected == pytest.approx(3600.0 * N_DEG_RTH / 60.0, rel=0.1)


@pytest.mark.exhaustive
def test_without_gaps_nothing_has_to_be_corrected(tmp_path: Path) -> None:
    done = run(tmp_path, mode="gapless", duration_s=1800.0)
    value, u = walk_of(done.results)
    assert abs(value - N_DEG_RTH) < 3.0 * u < 0.06
    assert (done.results.white_noise_seen, done.results.samples) == (1.0, 1800)
    assert 0.0 < done.results.dead_share < 0.02
    assert len(done.readings) == 9000
    bandwidth = done.results.noise_bandwidth_hz
    assert abs(bandwidth.value - 3.41) < 2.0 * bandwidth.u < 1.5
    assert f"noise bandwidth of one reading {bandwidth.value:.2g}"[:-1] in vcfbench.text_of(done.report())
    assert np.median(np.diff([reading.t_s for reading in done.readings])) == pytest.approx(0.2)
    again = vcfbench.load_run("last", runs=tmp_path)
    assert again.status == "complete"
    assert again.results == done.results


@pytest.mark.exhaustive
def test_flicker_of_the_mean_grows_with_the_horizon(hour: Run) -> None:
    """By the integral of a 1/f from the horizon to the record."""
    volts = np.array([reading.voltage_v for reading in hour.readings])

    def flicker(horizon_h: float) -> float:
        station = Station(sources=Sources(horizon_h=horizon_h))
        output = of_record(volts, ZeroSettings(scale_factor_v_per_deg_s=TRUE_SCALE, station=station)).output_v
        assert output is not None
        return next(part.u for part in output.parts if part.source.startswith("flicker"))

    assert flicker(1000.0) / flicker(24.0) == pytest.approx(1.4408 / 0.9428, rel=1e-3)


@pytest.mark.exhaustive
def test_unknown_noise_bandwidth_gives_a_bound_of_n(hour: Run) -> None:
    """The least bandwidth, 1 / (2 x 0.2 s), makes N 17 % too large here: it is no value, and the true one is below."""
    volts = np.array([reading.voltage_v for reading in hour.readings])
    settings = ZeroSettings(scale_factor_v_per_deg_s=TRUE_SCALE)
    found = of_record(volts, settings)
    walk = found.coefficient("angle random walk")
    assert (walk.value, walk.u) == (None, None)
    assert N_DEG_RTH < walk.upper_95 < 1.25 * N_DEG_RTH
    assert found.coefficient("bias instability").value is not None
    assert "N has an upper bound only" in " ".join(shown(found, settings).split())


def test_n_is_the_middle_of_its_flicker_bounds() -> None:
    """Readings of white noise 6 and flicker 0.3: N if a 1/f without end is folded in, and if nothing is."""
    sampling, b, u = Sampling(1.0, 0.2), 0.3, 0.02
    fitted = 6.0 / math.sqrt(5.0)
    terms = {
        Term.ANGLE_RANDOM_WALK: NoiseTerm(fitted, u, fitted + 1.645 * u, u),
        Term.BIAS_INSTABILITY: NoiseTerm(b, None, b, 0.0),
    }
    fit = NoiseFit(Coefficients(angle_random_walk=fitted, bias_instability=b), terms, np.zeros((5, 5)))
    found = with_what_is_let_through(fit, sampling, 0.0).terms[Term.ANGLE_RANDOM_WALK]
    excess = deviation_factor(sampling, Term.BIAS_INSTABILITY) ** 2 - 1.0
    nothing = math.sqrt((36.0 + excess * 2.0 * math.log(2.0) / math.pi * b**2) / 5.0)
    assert found.value == pytest.approx(0.5 * (fitted + nothing), rel=1e-6)
    half = 0.5 * (nothing - fitted) / math.sqrt(3.0)
    assert found.u == pytest.approx(math.hypot(u, half), rel=1e-5)
    assert found.upper_95 == pytest.approx(found.value + 1.645 * math.hypot(u, half), rel=1e-5)


@pytest.mark.parametrize("split_hz", [-9.0, 4.12, 8.5, 37.75])
def test_n_is_that_of_the_scatter_of_readings(split_hz: float) -> None:
    """A mode of 0.15 Hz half width, read once a second: long means have more of it, or less, by where the split is."""
    draw = np.random.default_rng(7)
    kept = math.exp(-math.tau * 0.15) * np.exp(2j * math.pi * split_hz)
    steps = draw.standard_normal((2, 3600)) * math.sqrt(1.0 - abs(kept) ** 2)
    ringing, last = np.empty(3600), 0j
    for place, (real, imaginary) in enumerate(steps.T):
        last = kept * last + complex(real, imaginary)
        ringing[place] = last.real
    readings = ringing + draw.standard_normal(3600)
    for wrong in (0.5, 1.0, 2.0):  # what a fit of long means may have made of it
        fit = NoiseFit(
            Coefficients(angle_random_walk=wrong), {Term.ANGLE_RANDOM_WALK: NoiseTerm(wrong, 0.0, wrong, 0.0)}
        )
        found = by_scatter(fit, readings, Sampling(1.0, 0.2, 7.0)).terms[Term.ANGLE_RANDOM_WALK]
        assert found.u is not None
        assert found.value == pytest.approx(math.sqrt(2.0 / 14.0), abs=3.0 * found.u)
        assert 0.011 < found.u / found.value < 0.016


@pytest.mark.parametrize("meter", [0.0, 0.1, 0.5, 0.9])
def test_meter_scatter_widens_the_uncertainty_of_n(meter: float) -> None:
    sampling, u = Sampling(1.0, 0.2, 3.4), 0.01
    fit = NoiseFit(Coefficients(angle_random_walk=1.0), {Term.ANGLE_RANDOM_WALK: NoiseTerm(1.0, u, 1.02, u)})
    found = without_meter(fit, sampling, meter * math.sqrt(6.8)).terms[Term.ANGLE_RANDOM_WALK]
    least = math.sqrt(1.0 - meter**2)
    assert found.value == pytest.approx(0.5 * (1.0 + least))
    assert found.u == pytest.approx(math.hypot(u, 0.5 * (1.0 - least) / math.sqrt(3.0)))
    assert found.upper_95 == 1.02


def test_n_that_the_meter_alone_may_make_is_no_value() -> None:
    term = NoiseTerm(1.0, 0.01, 1.02, 0.01)
    fit = NoiseFit(Coefficients(angle_random_walk=1.0), {Term.ANGLE_RANDOM_WALK: term})
    found = without_meter(fit, Sampling(1.0, 0.2, 3.4), 3.0).terms[Term.ANGLE_RANDOM_WALK]
    assert (found.value, found.u, found.upper_95) == (0.0, None, 1.02)


def test_a_bandwidth_of_another_integration_time_is_not_known() -> None:
    settings = ZeroSettings(noise_bandwidth_hz=3.41)
    assert settings.passed_hz == 3.41
    assert structs.replace(settings, nplc=1).passed_hz is None
    assert structs.replace(settings, nplc=1, noise_bandwidth_nplc=1, noise_bandwidth_hz=214.0).passed_hz == 214.0


@pytest.mark.exhaustive
def test_its_record_gives_the_same_results_and_report(hour: Run) -> None:
    assert hour.directory is not None
    again = vcfbench.load_run(hour.directory)
    assert again.no_results is None
    assert again.results == hour.results
    assert vcfbench.text_of(again.report()) == vcfbench.text_of(hour.report())
    (figure,) = [part for part in again.report().parts if isinstance(part, vcfbench.Figure)]
    assert (figure.x.scale, figure.y.scale) == ("log", "log")
    written = json.loads((hour.directory / "result.json").read_text())["results"]
    assert written["noise"][0]["unit"] == "deg/sqrt(h)"


@pytest.mark.exhaustive
def test_a_trend_that_shows_is_said_of_the_mean(hour: Run) -> None:
    trend = hour.results.trend
    assert trend is not None
    for value, is_said in ((0.5 * trend.u95, False), (-2.0 * trend.u95, True)):
        results = structs.replace(hour.results, trend=structs.replace(trend, value=value))
        text = vcfbench.text_of(zero_report(ZeroSettings(), None, results))
        assert ("This record has a trend: at another time the mean differs" in text) is is_said


def test_mean_and_trend_have_uncertainties_that_a_lab_can_use(hour: Run) -> None:
    bias, trend = hour.results.bias, hour.results.trend
    assert bias is not None
    assert trend is not None
    assert bias.value == pytest.approx(np.mean([reading.voltage_v for reading in hour.readings]) / TRUE_SCALE)
    assert 0.3 * 3.7 / 3600.0 < bias.u < 3.0 * 3.7 / 3600.0  # the flicker floor, not 34 deg/h / sqrt(3600)
    assert bias.u95 > 1.9 * bias.u
    assert bias.dof is not None
    assert bias.dof > 5.0
    assert abs(trend.value) < 4.0 * trend.u
    assert trend.unit == "(deg/h)/h"


@pytest.mark.exhaustive
def test_trend_of_white_noise_has_least_squares_uncertainty() -> None:
    """At least s / sqrt(n (n^2 - 1) / 12) a reading, from any textbook; flicker not excluded is in it too."""
    n, rng, found = 400, np.random.default_rng(5), []
    for _ in range(200):
        trend = of_record(rng.standard_normal(n), AS_READ).trend
        assert trend is not None
        found.append(trend)
    expected = 3600.0**2 / math.sqrt(n * (n**2 - 1) / 12.0)
    assert expected <= np.median([trend.u for trend in found]) < 2.5 * expected
    assert np.std([trend.value for trend in found]) == pytest.approx(expected, rel=0.15)
    assert 0.92 < np.mean([abs(trend.value) < trend.u95 for trend in found]) <= 1.0


@pytest.mark.parametrize("seed", few(range(12), 0))
def test_missing_ramp_leaves_mean_useful(seed: int) -> None:
    """An hour of white noise and flicker (twelve Ornstein-Uhlenbeck processes): U95 and dof can be used."""
    rng, n = np.random.default_rng(seed), 3600
    record = 0.5 * rng.standard_normal(n)
    for octave in range(12):
        keep, step, state = math.exp(-(2.0**-octave)), rng.standard_normal(n), 0.0
        for place in range(n):
            state = keep * state + math.sqrt(1.0 - keep**2) * step[place]
            record[place] += 0.03 * state
    found = of_record(record, AS_READ).bias
    assert found is not None
    assert found.u95 < 0.5
    assert found.dof is None or found.dof > 2.0


@pytest.mark.exhaustive
def test_alternating_readings_do_not_bend_fit() -> None:
    """Ten readings a second, whose neighbours share what passes at the mode split: B is that of the slow noise."""
    n, interval_s, b = 2**16, 0.1, 2.0
    rng, frequency = np.random.default_rng(4), np.fft.rfftfreq(2**16, 0.1)[1:]
    density = 50.0 + b**2 / math.pi / frequency  # one-sided: N = 5
    density += 4000.0 / (1.0 + ((frequency - 4.8) / 0.1) ** 2)
    drawn = rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size)
    record = np.fft.irfft(np.concatenate([[0.0], drawn * np.sqrt(density * n / interval_s) / 2.0]), n)
    settings = structs.replace(AS_READ, sample_interval_s=interval_s, nplc=5)
    found = of_record(record, settings)
    coefficient = found.coefficient("bias instability")
    assert found.fitted_from_s > interval_s
    assert coefficient.value is not None
    assert coefficient.u is not None
    assert abs(coefficient.value / 3600.0 - b) < 2.5 * coefficient.u / 3600.0 < 1.25 * b
    assert found.bias is not None
    assert found.bias.u > 0.5 * b  # the flicker floor
    assert "shorter ones do not follow powers of the time" in shown(found, settings)


def test_a_record_without_noise_has_no_coefficients() -> None:
    settings = ZeroSettings(scale_factor_v_per_deg_s=0.0125)
    found = of_record(np.full(400, 0.25), settings)
    assert (found.noise, found.bias, found.bias_deg_s) == ((), None, 20.0)
    assert "no noise" in shown(found, settings)


def steps(**changes: Any) -> list[Any]:
    limits = changes.pop("limits", Limits(max_rate_deg_s=300.0, max_v_vc_v=2.0))
    settings = ZeroSettings(station=Station(meter_resolution_v=1e-5, limits=limits), **changes)
    return [each.step for each in walk(ZERO.plan(settings), settings.expected_gyro())]


def test_plan_warms_up_and_leaves_v_vc_off() -> None:
    plan = steps()
    kinds = [type(step) for step in plan]
    assert kinds.index(EnableSupply) < kinds.index(EnableTable) < kinds.index(Acquire)
    assert EnableVvc not in kinds
    assert [step.seconds for step in plan if isinstance(step, Settle)][:2] == [5.0, 1795.0]
    (window,) = [step for step in plan if isinstance(step, Acquire)]
    assert (window.samples, window.interval_s, window.table_deg_s) == (3600, 1.0, 0.0)


def test_a_bench_of_supply_and_multimeter_will_do() -> None:
    kinds = {type(step).__name__ for step in steps(limits=Limits())}
    assert kinds.isdisjoint({"DisableVvc", "ConfigureGenerator", "EnableTable", "SetRate", "DisableTable"})
    assert {"EnableSupply", "Acquire", "DisableSupply"} <= kinds
    assert [*ZERO.needs] == ["multimeter"]


def test_bursts_hold_whole_intervals_and_count_what_lies_between_them() -> None:
    (window,) = [step for step in steps(mode=Mode.GAPLESS, burst_readings=512) if isinstance(step, AcquireGapless)]
    assert (window.samples, window.interval_s, window.burst) == (18_000, 0.2, 510)
    assert window.duration_s > window.physical_s == pytest.approx(3600.0)


def test_a_meter_that_takes_no_readings_by_itself_is_named() -> None:
    settings = ZeroSettings(mode=Mode.GAPLESS, powered_s=1.0, station=Station(meter_resolution_v=1e-5))
    plan = ZERO.plan(replace_drive(settings))
    error = Executor(FakeBench(), MemoryJournal()).execute(plan).error
    assert isinstance(error, MeasurementError)
    assert "takes no readings by itself" in str(error)


def replace_drive(settings: ZeroSettings) -> ZeroSettings:
    return structs.replace(settings, station=structs.replace(settings.station, oscilloscope=None))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration_s": 100.0}, "duration_s: expected at least 200 s"),
        ({"mode": "gapless", "sample_interval_s": 0.5}, "whole number of integration times of 0.2 s"),
        ({"sample_interval_s": 0.1}, "sample_interval_s: expected at least 0.4 s"),
        ({"noise_bandwidth_hz": -1.0}, "noise_bandwidth_hz: expected"),
        (
            {"noise_bandwidth_hz": 2.0},
            "expected at least the 2.5 Hz of an integration time of 0.2 s",
        ),
        ({"mode": "raw"}, "mode: expected"),
    ],
)
def test_settings_that_cannot_be_are_refused_before_anything_is_opened(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        vcfbench.dry_run("zero", settings=changes)


def test_ten_readings_per_second_fit_one_power_line_cycle() -> None:
    planned = vcfbench.dry_run("zero", settings={"sample_interval_s": 0.1, "nplc": 1, "duration_s": 7200.0})
    (window,) = [each.step for each in planned.steps if isinstance(each.step, Acquire)]
    assert (window.samples, window.interval_s) == (72_000, 0.1)


def test_a_scale_factor_of_nothing_is_refused() -> None:
    with pytest.raises(ConfigError, match="scale_factor_v_per_deg_s: expected a scale factor other than 0"):
        vcfbench.dry_run("zero", settings={"scale_factor_v_per_deg_s": 0.0})


def test_default_scale_factor_is_that_of_the_look(tmp_path: Path) -> None:
    settings = {"duration_s": 200.0, "noise_bandwidth_hz": 0.0}
    done = vcfbench.run("zero", seed=3, settings=settings, runs=tmp_path)
    found = done.results.scale_factor_v_per_deg_s
    assert abs(found.value + 0.0125527) <= 3.0 * found.u < 1e-4
    text = vcfbench.text_of(done.report())
    assert "by this run's look at a slow rate of the table" in text
    assert "set noise_bandwidth_hz, or measure it with mode=gapless" in text


@pytest.mark.parametrize(("procedure", "table"), few([("zero", True), ("warmup", False)], ("warmup", False)))
def test_a_demodulator_that_is_dead_ends_a_record_at_rest(procedure: str, *, table: bool) -> None:
    """Its output stands still anyway: it is asked by a rate, or by V_Vc, whether it answers."""
    bench = vcfbench.load_bench("paper")
    assert bench.simulation is not None
    simulation = structs.replace(bench.simulation, override={"sense_path": {"multiplier_per_v": 0.0}})
    alive = (
        bench
        if table
        else structs.replace(bench, rate_table=None, limits=structs.replace(bench.limits, max_rate_deg_s=None))
    )
    short = {"zero": {"powered_s": 10.0, "duration_s": 200.0}, "warmup": {"shortest_s": 180.0, "longest_s": 240.0}}
    settings = {**ON_PAPER, **short[procedure]}
    assert vcfbench.run(procedure, alive, seed=3, settings=settings, runs=None).error is None
    dead = structs.replace(alive, simulation=simulation)
    with pytest.raises(
        MeasurementError, match="does not respond to " + ("a rate of 10 deg/s" if table else "V_Vc of 1 V")
    ):
        vcfbench.run(procedure, dead, seed=3, settings=settings, runs=None)


@pytest.mark.parametrize("rate_deg_s", [2e30, -2e30])
def test_record_with_an_impossible_rate_is_refused(rate_deg_s: float) -> None:
    rates = np.random.default_rng(4).standard_normal(1000)
    rates[500] = rate_deg_s
    with pytest.raises(ConfigError, match="larger than any gyroscope's"):
        record_noise(rates, Sampling.without_gaps(1.0), corrected=False, u_bandwidth_hz=0.0, meter_deg_s=0.0)


@pytest.mark.parametrize("period_s", [40.0, 150.0, 500.0])
@pytest.mark.parametrize("size_deg_s", [0.3, 1.0])
def test_white_noise_beside_a_vibration_has_a_bound_of_n_above_it(size_deg_s: float, period_s: float) -> None:
    """1 deg/s a second are 60 deg/sqrt(h); what no sum of noises describes is told with the times that were fitted."""
    noise = np.random.default_rng(4).standard_normal(1000)
    rates = noise + size_deg_s * np.sin(2.0 * np.pi / period_s * np.arange(1000))
    found = record_noise(rates, Sampling.without_gaps(1.0), corrected=False, u_bandwidth_hz=0.0, meter_deg_s=0.0)
    (walk,) = (each for each in found.coefficients if each.words == Term.ANGLE_RANDOM_WALK.value)
    assert walk.upper_95 > 60.0 or walk.value == pytest.approx(60.0, abs=2.0 * (walk.u or 0.0))
    times_s = [each.tau_s for each in found.rows]
    assert times_s.index(found.fitted_from_s) <= times_s.index(found.fitted_to_s)
    assert found.described or any(re.search("No sum of these noises|comes back", each) for each in found.remarks)
