"""The response to a virtual vibration against the closed form of the parameters, with P and R of docs/theory.md."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from typer.testing import CliRunner

import vcfbench
from tests.procedures.test_kvc import still, warm
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError, LimitError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.reports.document import Figure
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.file import embedded_text
from vcfbench.steps import DisableVibration, EnableVibration, EnableVvc, SampleModulated

if TYPE_CHECKING:
    from pathlib import Path

TEXT = embedded_text("lab")
LAB = parse_bench(TEXT, "lab")
QUIET = still(LAB, vibration_source="none")
FEW: dict[str, Any] = {"warm_up_s": 7200.0, "record_samples": 256, "vibration_hz": [2.0, 10.0, 20.0, 35.0]}


def closed_form(at_hz: float) -> float:
    """Return the response over response at rest, the filter of 100 Hz and fourth order in it."""
    gyro = warm(physical_parameters(LAB))
    path, driven = gyro.virtual_path, 2.0 * np.pi * gyro.drive_mode.frequency_hz
    phase = path.carrier_phase_rad - gyro.sense_path.demodulator_phase_rad

    def response(s: complex) -> complex:
        total = 0j
        for mode in (gyro.sense_in_phase, gyro.sense_anti_phase):
            w = 2.0 * np.pi * mode.frequency_hz
            left = mode.left_participation * path.left_comb_n_per_v2
            force = left + mode.right_participation * path.right_comb_n_per_v2
            p, r = s**2 + w / mode.quality * s + w**2 - driven**2, 2.0 * s * driven + w * driven / mode.quality
            total += mode.pick_off_v_per_m * force * (p * np.cos(phase) + r * np.sin(phase)) / (p**2 + r**2)
        return total

    filtered = 1.0 / np.sqrt(1.0 + (at_hz / 100.0) ** 8)
    return float(filtered * abs(response(2j * np.pi * at_hz)) / abs(response(0j)))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A run with everything drawn."""
    return vcfbench.run("vibration", LAB, seed=6, settings=FEW, runs=tmp_path_factory.mktemp("drawn"))


def test_without_noise_and_errors_the_closed_form_comes_out(tmp_path: Path) -> None:
    """What is left is the modulator's cube, 20 ppm, and the output stage's at the peak."""
    found = vcfbench.run("vibration", QUIET, settings=FEW, runs=tmp_path).results
    assert [each.frequency_hz for each in found.responses] == FEW["vibration_hz"]
    for each in found.responses:
        assert each.response.value == pytest.approx(closed_form(each.frequency_hz), rel=60e-6)
        assert each.expected.value == pytest.approx(closed_form(each.frequency_hz), abs=2.0 * each.expected.u)
        assert each.virtual_rate_deg_s == pytest.approx(6.0, rel=1e-3)
    assert found.largest_e_n < 1.0


@pytest.mark.exhaustive
def test_response_lies_within_u95_for_any_generator_error(drawn: Any) -> None:
    found = drawn.results
    assert found.v_vc_is_measured
    for each in found.responses:
        assert abs(each.response.value - closed_form(each.frequency_hz)) <= 3.5 * each.response.u
        assert each.response.u < 0.005 * each.response.value
    off = {round(each.v_vc_amplitude_v / 0.04 - 1.0, 3) for each in found.responses}
    assert off != {0.0}


@pytest.mark.exhaustive
def test_the_record_gives_the_same_and_the_report_shows_it(drawn: Any) -> None:
    assert vcfbench.load_run(drawn.directory).results == drawn.results
    [figure] = [each for each in drawn.report().parts if isinstance(each, Figure)]
    assert figure.title == "Response to the virtual vibration"
    shown = CliRunner().invoke(app, ["runs", "show", drawn.directory.name, "--runs", str(drawn.directory.parent)])
    assert "largest E_n" in shown.stdout


def test_without_a_meter_on_v_vc_both_generators_count(tmp_path: Path) -> None:
    one = structs.replace(QUIET, v_vc_meter=None)
    settings = {**FEW, "vibration_hz": [10.0]}
    [response] = vcfbench.run("vibration", one, settings=settings, runs=tmp_path).results.responses
    assert response.response.u / response.response.value == pytest.approx(0.02 * (2.0 / 3.0) ** 0.5, rel=0.01)
    assert response.response.value == pytest.approx(closed_form(10.0), rel=1e-3)


def test_the_second_generator_is_on_only_while_it_vibrates() -> None:
    steps = [each.step for each in vcfbench.dry_run("vibration", LAB).steps]
    kinds = [type(each) for each in steps]
    assert kinds[0] is not EnableVibration
    assert kinds.index(DisableVibration) < kinds.index(EnableVvc) < kinds.index(EnableVibration)
    last = max(place for place, kind in enumerate(kinds) if kind is SampleModulated)
    assert DisableVibration in kinds[last:]
    assert [each.frequency_hz for each in steps if isinstance(each, SampleModulated)] == [
        *(0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 35.0)
    ]


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ConfigError, match="vibration needs vibration_source"):
        vcfbench.dry_run("vibration", "paper")
    assert LAB.limits is not None
    tight = structs.replace(LAB, limits=structs.replace(LAB.limits, max_v_vc_v=0.5))
    with pytest.raises(LimitError, match=r"peak voltage 0\.6 V"):
        vcfbench.dry_run("vibration", tight, settings={"vibration_amplitude_v": 0.6})


@pytest.mark.exhaustive
def test_stated_noise_is_scatter_over_seeds(tmp_path: Path) -> None:
    """24 seeds, five frequencies: sd of z within four of its own standard deviations of 1."""
    asked = {**FEW, "vibration_hz": [2.0, 5.0, 10.0, 20.0, 35.0]}
    runs = [
        vcfbench.run("vibration", LAB, seed=seed, settings=asked, runs=tmp_path).results for seed in range(300, 324)
    ]
    z = np.array(
        [[(x.response.value - closed_form(x.frequency_hz)) / x.response.u for x in run.responses] for run in runs]
    )
    assert np.all(np.abs(z.std(axis=0, ddof=1) - 1.0) < 4.0 / np.sqrt(48.0))
    assert abs(z.std(ddof=1) - 1.0) < 0.2
