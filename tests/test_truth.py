"""The study of the uncertainties compares with a closed form: without noise and errors a calibration gives that."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest
from simrack_tests.cells import few

import vcfbench
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.simulation import true_output
from vcfbench.studies.truth import four_step_truth, truth_of

STUDY = Path(__file__).parents[1] / "experiments" / "truth.py"
QUIET = """
[simulation.errors]
power = "none"
rate_source = "none"
multimeter = "none"
oscilloscope = "none"
rate_table = "none"
[simulation.override]
table = { rate_error = 0.0, ripple_arcsec = [0.0, 0.0], flutter_per_sqrt_hz = 0.0 }
noise = { angle_random_walk_deg_sqrt_s = 0.0, bias_instability_deg_s = 0.0 }
pick_up = { meter_leads_v = 0.0, v_vc_lead_v = 0.0 }
"""


def quiet_bench() -> str:
    """The paper's bench, without the errors of its generator, instruments and table, and without noise."""
    text = (Path(vcfbench.__file__).parent / "station" / "paper.toml").read_text("utf-8")
    return text.split("# The generator's errors are chosen", 1)[0] + QUIET


@pytest.fixture(autouse=True)
def _beside_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(STUDY.parent)


def study() -> Any:
    spec = importlib.util.spec_from_file_location("truth", STUDY)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_calibration_without_noise_and_errors_gives_the_closed_form(tmp_path: Path) -> None:
    truth = study()
    bench = tmp_path / "bench.toml"
    bench.write_text(quiet_bench(), encoding="utf-8")
    settings = {"warm_up_s": truth.WARM_UP_S}
    run = vcfbench.run("virtual-coriolis", bench, seed=1, settings=settings, runs=tmp_path)
    rates = [point.rate_deg_s for point in run.points if point.step == 3]
    levels = [point.v_vc_v for point in run.points if point.step == 4]
    output = true_output(load_bench(bench))
    expected = four_step_truth(output, table_deg_s=rates, levels_v=levels, matched_deg_s=(10.0,))
    assert truth_of(run, load_bench(bench)) == expected
    left_v = 2e-7  # of the warm-up: 31 uV, exp(-6) of it
    for each in run.results.uncertainty.values:
        left = {"V": left_v, "deg/s": left_v / 0.0125, "ppm": 1e6 * left_v / 5.0}.get(each.unit, 0.0)
        assert each.value == pytest.approx(expected[each.name], rel=1e-6, abs=left), each.name


@pytest.mark.parametrize(
    "settings", few([{"earth": "rate"}, {"earth": "rate", "k_vc_by": "plus-minus"}], {"earth": "rate"})
)
@pytest.mark.parametrize("procedure", few(["turntable", "virtual-coriolis"], "turntable"))
def test_added_earth_rate_is_not_in_true_bias(procedure: str, settings: dict[str, Any], tmp_path: Path) -> None:
    """Without noise and errors the values are the true ones: 0.0026 deg/s, 32 uV, are a hundred times what is left."""
    truth = study()
    bench = tmp_path / "bench.toml"
    bench.write_text(quiet_bench(), encoding="utf-8")
    asked = {"warm_up_s": truth.WARM_UP_S, **settings}
    if procedure == "turntable":
        asked = {key: each for key, each in asked.items() if key != "k_vc_by"}
    run = vcfbench.run(procedure, bench, seed=1, settings=asked, runs=tmp_path)
    expected = truth_of(run, load_bench(bench))
    left_v = 3e-7
    for each in run.results.uncertainty.values:
        left = {"V": left_v, "deg/s": left_v / 0.0125, "ppm": 1e6 * left_v / 5.0}.get(each.unit, 0.0)
        if each.name in expected:
            assert each.value == pytest.approx(expected[each.name], rel=2e-6, abs=left), each.name


@pytest.mark.exhaustive
def test_absolute_match_is_compared_with_k_vc(tmp_path: Path) -> None:
    run = vcfbench.run("virtual-coriolis", "lab", seed=1, settings={"match": "absolute"}, runs=tmp_path)
    true = truth_of(run, load_bench("lab"))
    assert true["k_vc"] == pytest.approx(150.0, rel=0.01)
    for name in ("k_vc", "virtual.scale_factor", "scale_factor_error_percent"):
        found = run.results.uncertainty.value(name)
        assert abs(found.value - true[name]) <= found.u95
        assert abs(found.value - true[name]) > 0.3 * found.u95


def test_a_study_goes_on_where_it_was_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truth, file, run = study(), tmp_path / "lines.jsonl", []

    def calibrations(seed: int, v_vc: str) -> dict[str, Any]:
        run.append(seed)
        return {"seed": seed, "value": [0.5 * seed, seed < 3], "e_n": float(seed), "v_vc": v_vc}

    monkeypatch.setattr(truth, "calibrations", calibrations)
    whole = truth.continued(file, range(5), {"v_vc": "set"}, 1)
    text = file.read_text(encoding="utf-8")
    file.write_text(text[: text.index('{"seed": 3') + 9], encoding="utf-8")  # a line that was not written to its end
    assert truth.continued(file, range(5), {"v_vc": "set"}, 1) == whole
    assert run == [0, 1, 2, 3, 4, 3, 4]
    assert file.read_text(encoding="utf-8") == text


def test_a_summary_marks_what_is_outside_the_bars() -> None:
    truth = study()
    z = [-1.4, -0.7, 0.0, 0.7, 1.4] * 20
    lines = [
        {"seed": n, "good": [each, n % 20 != 0], "bad": [each + 1.0, n % 5 > 1], "e_n": 0.5} for n, each in enumerate(z)
    ]
    del lines[0]["bad"]  # a value that is not stated
    good, bad = truth.summary(lines)[2:4]
    assert good.endswith("95.0%")
    assert bad.endswith("  * 60 of 99 hold the truth, 81 to 99 should  in 99 seeds")
