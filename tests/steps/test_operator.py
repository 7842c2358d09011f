"""What only hands can do: asked for, waited for, written down; done to the world on a simulated bench."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs

import vcfbench
from tests.procedures.fakes import FakeBench, MemoryJournal
from vcfbench.bench.bench import open_bench
from vcfbench.errors import ConfigError, PlanError
from vcfbench.interfaces import Request
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps import AskOperator, MeasureVvc, OperatorAnswer, move_leads
from vcfbench.steps.decode import result_of, step_of
from vcfbench.steps.executor import Executor
from vcfbench.steps.operator import simulated_operator
from vcfbench.steps.step import Context
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.bench.bench import Bench
    from vcfbench.steps.step import Plan, Step


def plan_of(*steps: Step) -> Plan:
    for step in steps:  # noqa: UP028  # a tuple cannot be sent results
        yield step


MOVE = move_leads("multimeter", "v_vc")


def test_answer_of_operator_is_in_journal() -> None:
    asked: list[Request] = []

    def person(request: Request) -> str:
        asked.append(request)
        return "done, J. Smith"

    journal = MemoryJournal()
    done = Executor(FakeBench(), journal, operator=person).execute(plan_of(MOVE))
    assert done.error is None
    assert [each.words for each in asked] == ["move the leads of the multimeter to the V_Vc input"]
    [line] = journal.lines
    assert step_of(line) == MOVE
    assert result_of(line) == OperatorAnswer("done, J. Smith")
    assert result_of(line).describe() == "done, J. Smith"


def test_run_without_operator_ends_and_names_request() -> None:
    done = Executor(FakeBench(), MemoryJournal()).execute(plan_of(MOVE))
    assert isinstance(done.error, PlanError)
    assert "a person has to move the leads of the multimeter to the V_Vc input" in str(done.error)
    assert "--yes" in str(done.error)


def test_it_is_predicted_as_done_and_takes_a_minute() -> None:
    assert MOVE.predict(LinearGyro(36.0)) == OperatorAnswer("done")
    assert MOVE.duration_s == 60.0
    assert MOVE.physical_s == 0.0
    assert MOVE.describe() == "by hand: move the leads of the multimeter to the V_Vc input"


def measured_by_hand(bench: Bench) -> tuple[float, float]:
    """V_Vc by the one meter, moved there and back; then the output, V."""
    hands = simulated_operator(bench)
    assert hands is not None
    context = Context(bench, lambda _: None, operator=hands)
    bench.power.configure_output("P25V", 10.0, 0.1)
    bench.power.configure_output("N25V", -10.0, 0.1)
    bench.power.enable_outputs()
    bench.rate_source.configure_dc(0.5)
    bench.rate_source.enable_output()
    bench.multimeter.configure_dc_voltage(10.0, 10.0)
    start_s = bench.clock.now()
    MOVE.perform(context)
    assert bench.clock.now() == pytest.approx(start_s + 60.0)
    measured = MeasureVvc(0.5, 3, 1.0, 0.01, "multimeter").perform(context)
    move_leads("multimeter", "output").perform(context)
    return measured.mean_v, bench.multimeter.read_voltage_v()


@pytest.mark.exhaustive
def test_one_meter_measures_v_vc_and_the_output_in_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path))
    with open_bench("ideal") as bench:
        here = measured_by_hand(bench)
    assert here[0] == pytest.approx(0.5, abs=1e-4)
    assert here[1] != pytest.approx(0.5, abs=0.1)
    with serve_simulated("ideal") as lab, open_bench(lab.on_wires()) as bench:
        assert measured_by_hand(bench) == pytest.approx(here, abs=1e-4)


def test_what_hands_cannot_do_on_the_simulated_bench_is_said() -> None:
    with open_bench("ideal") as bench:
        hands = simulated_operator(bench)
        context = Context(bench, lambda _: None, operator=hands) if hands is not None else None
        assert context is not None
        with pytest.raises(ConfigError, match=r"multimeter\.input\.lamp: the simulated bench has no such"):
            AskOperator("light it", adjustments=(("multimeter.input.lamp", True),)).perform(context)
        with pytest.raises(ConfigError, match="moon' is none of output"):
            AskOperator("go", adjustments=(("multimeter.input.node", "moon"),)).perform(context)


def asking() -> vcfbench.Procedure[Any, Any]:
    turntable = vcfbench.PROCEDURES["turntable"]

    def plan(_settings: Any) -> Plan:
        return plan_of(MOVE, AskOperator("put a cover on it", takes_s=5.0))

    return structs.replace(
        turntable, name="asking", plan=plan, results=lambda _settings, _points: {}, needs={}, uses={}
    )


def answers(run: vcfbench.Run) -> list[str]:
    assert run.directory is not None
    lines = map(json.loads, (run.directory / "journal.jsonl").read_text(encoding="utf-8").splitlines())
    return [line["result"]["answer"] for line in lines if line.get("step_kind") == "AskOperator"]


def test_a_run_on_a_simulated_bench_needs_nobody(tmp_path: Path) -> None:
    done = vcfbench.run(asking(), runs=tmp_path)
    assert answers(done) == ["done to the simulated bench"] * 2
    assert done.bench_seconds == pytest.approx(65.0)
    assert vcfbench.dry_run(asking()).bench_seconds == 65.0


def test_a_run_from_python_asks_who_it_is_told(tmp_path: Path) -> None:
    asked: list[str] = []

    def person(request: Request) -> str:
        asked.append(request.words)
        return f"number {len(asked)}"

    assert answers(vcfbench.run(asking(), runs=tmp_path, operator=person)) == ["number 1", "number 2"]
    assert asked[1] == "put a cover on it"


def test_missing_operator_is_found_before_anything_is_opened(tmp_path: Path) -> None:
    real = structs.replace(load_bench(None), simulation=None)
    said = r"asking asks a person to move the leads of the multimeter to the V_Vc input, and 1 more, but no operator"
    with pytest.raises(PlanError, match=said) as caught:
        vcfbench.run(asking(), real, runs=tmp_path)
    assert caught.value.exit_code == 2
    assert list(tmp_path.iterdir()) == []
