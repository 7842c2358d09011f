"""Study files: what is asked for is checked wholly before anything runs, and each mistake says where it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.errors import BenchError, ConfigError, LimitError, PlanError
from vcfbench.studies.file import read_study, study_of

if TYPE_CHECKING:
    from pathlib import Path

SMALL = {
    "procedure": "turntable",
    "seeds": {"count": 2},
    "settings": {"rates_deg_s": [10, 0, -10], "samples": 3},
}
Q = "simulation.override.sense_anti_phase.quality"


def refused(**changes: Any) -> str:
    with pytest.raises(BenchError) as caught:
        list(study_of({**SMALL, **changes}).check())
    return str(caught.value)


def test_a_study_has_a_case_for_each_combination() -> None:
    vary = {"settings.samples": [3, 5], Q: {"from": 1000.0, "to": 2000.0, "steps": 3}}
    study = study_of({**SMALL, "vary": vary})
    assert [case.number for case in study.check()] == [0, 1, 2, 3, 4, 5]
    assert study.cases[5].values == {"settings.samples": 5, Q: 2000.0}
    assert study.runs[:3] == [(0, 0), (0, 1), (1, 0)]
    description, settings = study.described(study.cases[5], 1)
    assert settings["samples"] == 5
    assert description.simulation is not None
    assert description.simulation.override == {"sense_anti_phase": {"quality": 2000.0}}


def test_bare_keys_with_dots_are_paths_too(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    text = 'procedure = "turntable"\nseeds.count = 1\n'
    text += "[vary]\nsettings.samples = [3, 5]\nlimits.max_rate_deg_s = [250, 300]\n"
    file.write_text(text, encoding="utf-8")
    assert list(read_study(file).labels) == ["settings.samples", "limits.max_rate_deg_s"]


@pytest.mark.parametrize(
    ("ends", "values"),
    [
        ({"from": 3, "to": 7, "steps": 3}, (3, 5, 7)),
        ({"from": 1, "to": 100, "steps": 3, "spacing": "log"}, (1, 10, 100)),
        ({"from": 3, "to": 4, "steps": 3}, (3.0, 3.5, 4.0)),
        ({"from": 100_000, "to": 100_001, "steps": 3}, (100_000.0, 100_000.5, 100_001.0)),
        ({"from": 3.0, "to": 7.0, "steps": 3}, (3.0, 5.0, 7.0)),
    ],
)
def test_a_range_of_whole_numbers_is_of_whole_numbers(ends: dict[str, Any], values: tuple[float, ...]) -> None:
    study = study_of({**SMALL, "vary": {"settings.samples": ends}})
    found = tuple(case.values["settings.samples"] for case in study.cases)
    assert (found, *map(type, found)) == (values, *map(type, values))


def test_values_can_be_paired() -> None:
    study = study_of({**SMALL, "combine": "paired", "vary": {"settings.samples": [3, 5], Q: [900.0, 800.0]}})
    assert [case.values[Q] for case in study.cases] == [900.0, 800.0]
    words = refused(combine="paired", vary={"settings.samples": [3, 5], Q: [900.0]})
    assert (
        words
        == f"study: combine: expected as many values of each path, to pair them, got 2 of settings.samples, 1 of {Q}"
    )


def test_a_grid_is_counted_before_it_is_made() -> None:
    """A hundred million cases took 8 GB before the number was looked at."""
    vary = {"settings.samples": list(range(3, 10_003)), Q: {"from": 1.0, "to": 2.0, "steps": 10_000}}
    assert "at most 10000 cases, got 100000000 cases of 2 seeds, 200000000 runs" in refused(vary=vary)
    many = refused(seeds={"count": 10_001})
    assert "at most 10000 runs, got 1 cases of 10001 seeds, 10001 runs; most_runs of the study file" in many
    assert len(study_of({**SMALL, "seeds": {"count": 10_001}, "most_runs": 20_000}).seeds) == 10_001
    assert "most_runs: expected" in refused(most_runs=2_000_000)


def test_drawn_values_depend_on_seed_and_path_alone() -> None:
    vary = {"settings.samples": [3, 5], Q: {"uniform": [1000.0, 1001.0]}, "settings.settle_s": {"choice": [0.5, 1.0]}}
    study = study_of({**SMALL, "vary": vary})
    other = study_of({**SMALL, "seeds": {"first": 1, "count": 9}, "vary": {Q: {"uniform": [1000.0, 1001.0]}}})
    drawn = study.values(study.cases[0], 1)[Q]
    assert 1000.0 <= drawn <= 1001.0
    assert study.values(study.cases[1], 1)[Q] == drawn == other.values(other.cases[0], 1)[Q]
    assert len({other.values(other.cases[0], seed)[Q] for seed in other.seeds}) == 9


def test_an_entry_of_a_list_can_be_varied() -> None:
    change = {
        "simulation": {
            "errors": {"rate_source": {"ranges": [{"upper_v": 10.0, "gain_error": 0.0, "offset_error_v": 0.0}]}}
        }
    }
    path = "simulation.errors.rate_source.ranges[0].gain_error"
    study = study_of({**SMALL, "change": change, "vary": {path: [0.0, 0.01]}})
    list(study.check())
    simulation = study.described(study.cases[1], 0)[0].simulation
    assert simulation is not None
    assert simulation.errors.rate_source["ranges"][0]["gain_error"] == 0.01  # type: ignore[index]
    assert "expected a list with an entry [3]" in refused(change=change, vary={path.replace("[0]", "[3]"): [0.0]})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sedes": 1}, "study: sedes: expected a known key ('seeds'?), got an unknown key"),
        ({"seeds": {"count": 0}}, "study: seeds.count: expected a whole number at least 1"),
        ({"vary": {"settings.smaples": [3]}}, "study: vary.settings.smaples: expected a known key ('samples'?)"),
        ({"vary": {"settings.samples": [3, 0]}}, "study: vary.settings.samples: expected a whole number at least 2"),
        ({"settings": {"samples": 0}}, "study: settings.samples: expected a whole number at least 2"),
        ({"vary": {"sight.latitude_deg": [3]}}, "study: vary.sight: expected a known key ('site'?)"),
        ({"vary": {"site.latitude_deg": [300.0]}}, "study: vary.site.latitude_deg: expected a number"),
        ({"change": {"site": {"latitude_deg": 300.0}}}, "study: change.site.latitude_deg: expected a number"),
        ({"vary": {"simulation.override.noise.flicker": [3]}}, "study: vary.simulation.override.noise.flicker: "),
        ({"vary": {Q: [-1.0]}}, f"study: vary.{Q}: expected"),
        ({"vary": {Q: {"normal": [1000.0, 5000.0]}}, "seeds": {"count": 20}}, f"study: vary.{Q}: expected"),
        ({"vary": {Q: {"normal": [1000.0, -1.0]}}}, f"study: vary.{Q}.normal: expected a mean and a standard"),
        ({"vary": {Q: {"uniform": [2.0, 1.0]}}}, f"study: vary.{Q}.uniform: expected the lower end first"),
        ({"vary": {Q: 3.0}}, f"study: vary.{Q}: expected a list, {{ values = }}"),
        ({"vary": {Q: []}}, f"study: vary.{Q}.values: expected a list"),
        ({"vary": {Q: {"from": 1.0, "to": 2.0}}}, f"study: vary.{Q}.steps: expected a whole number"),
        ({"vary": {Q: {"from": -1.0, "to": 2.0, "steps": 3, "spacing": "log"}}}, "both ends above 0"),
        ({"vary": {Q: {"values": [900.0], "label": "seed"}}}, "expected a label of its own, got 'seed'"),
        ({"vary": {"title.x": [900.0]}}, "study: vary.title.x: expected a table that holds 'x', got"),
        ({"vary": {"settings.samples": {"from": 3, "to": 5, "steps": 4}}}, "study: vary.settings.samples: expected"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_key(changes: dict[str, Any], words: str) -> None:
    assert words in refused(**changes)


def test_a_plan_that_leaves_a_limit_names_the_case() -> None:
    vary = {"expected.k_vc_deg_s_per_v": [[140.0, 160.0], [15.0, 17.0]]}
    study = study_of({**SMALL, "procedure": "virtual-coriolis", "settings": {}, "vary": vary})
    with pytest.raises(LimitError) as caught:
        list(study.check())
    assert str(caught.value).startswith("study: ")
    assert "case 1 (expected.k_vc_deg_s_per_v = [15.0, 17.0])" in str(caught.value)


def test_message_of_drawn_mistake_ends_with_seed_and_case() -> None:
    words = refused(vary={Q: {"normal": [1000.0, 5000.0]}}, seeds={"count": 20})
    assert "drawn for seed" in words or "case 0" in words


def test_real_benches_and_served_ones_are_not_studied(tmp_path: Path) -> None:
    from vcfbench.station.file import template  # noqa: PLC0415

    (tmp_path / "station.toml").write_text(template(), encoding="utf-8")
    (tmp_path / "study.toml").write_text('procedure = "turntable"\nbench = "station.toml"\nseeds.count = 1\n', "utf-8")
    with pytest.raises(
        ConfigError, match=r"study.toml: bench: expected a bench that is simulated here, .*station.toml"
    ):
        read_study(tmp_path / "study.toml")


def test_a_procedure_that_there_is_not() -> None:
    with pytest.raises(PlanError, match="there is no procedure 'turntabel'"):
        study_of({**SMALL, "procedure": "turntabel"})


def test_the_seeds_are_no_part_of_what_tells_studies_apart() -> None:
    vary = {"settings.samples": [3, 5]}
    study = study_of({**SMALL, "vary": vary})
    same = study_of({**SMALL, "vary": vary, "seeds": {"count": 50}, "title": "more"})
    assert study.fingerprint() == same.fingerprint()
    others = [
        {**SMALL, "vary": {"settings.samples": [3, 6]}},
        {**SMALL, "vary": vary, "settings": {"samples": 4}},
        {**SMALL, "vary": vary, "bench": "lab"},
        {**SMALL, "vary": vary, "metrics": ["bias"]},
        {**SMALL, "vary": {"settings.samples": {"choice": [3, 5]}}},
    ]
    assert study.fingerprint() not in {study_of(each).fingerprint() for each in others}
