"""The electrical check: resistances against the world's, faults by their names, and nothing that gets power."""

from __future__ import annotations

import math
from typing import Any

import pytest
from msgspec import structs

import vcfbench
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.interfaces import ReadsResistance
from vcfbench.procedures.electrical import ElectricalSettings, _resistance, findings
from vcfbench.sim.world import World
from vcfbench.testing import simulated

GOOD = {"positive_rail_ohm": 1000.0, "negative_rail_ohm": 1000.0, "v_vc_ohm": 1e6, "output_ohm": 100.0}


def run(bench: Any = "paper", **settings: Any) -> Any:
    return vcfbench.run("electrical", bench, seed=3, settings=settings, runs=None)


def test_resistances_are_those_of_the_world_within_u95() -> None:
    """By the PCB's own resistors: rails 1000 ohm, pull-down of V_Vc 1 Mohm, output 100 ohm."""
    found = run().results
    for line, true_ohm in zip(found.lines, GOOD.values(), strict=True):
        off = abs(line.resistance.value - true_ohm)
        assert off <= line.resistance.u95, line.of
        assert line.resistance.u95 < 0.12 + 2.5e-4 * true_ohm


def test_meter_on_v_vc_loads_it_by_its_ten_megohm() -> None:
    (v_vc,) = (each for each in run("lab").results.lines if each.of == "v_vc")
    assert v_vc.resistance.value == pytest.approx(1e6 * 10.0 / 11.0, rel=2e-3)


def test_nothing_is_on_while_resistances_are_measured() -> None:
    kinds = [type(each.step).__name__ for each in vcfbench.dry_run("electrical", "lab").steps]
    assert kinds[:2] == ["DisableVvc", "DisableSupply"]
    assert not [each for each in kinds if each.startswith("Enable")]
    assert kinds.count("MeasureResistance") == kinds.count("AskOperator") - 1 == 4


@pytest.mark.parametrize(
    ("planted", "words"),
    [
        (
            {"rail_positive": 0.5},
            r"rail positive has 0\.\d+ ohm, limits 100 to 10000 ohm \(positive_rail_ohm\): shorted",
        ),
        ({"output": 2e6}, r"output has 2e\+06 ohm, limits 50 to 200 ohm \(output_ohm\): open"),
        ({"rail_negative": math.inf}, r"rail negative has more than 1.2e\+08 ohm, .*: open"),
        ({"output": 1e3}, r"output has 1000 ohm, limits 50 to 200 ohm \(output_ohm\): too much"),
        ({"v_vc": 5e5}, r"v vc has 5e\+05 ohm, limits 800000 to 1.2e\+06 ohm \(v_vc_ohm\): too little"),
    ],
)
def test_fault_is_named_and_nothing_gets_power(
    planted: dict[str, float], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    true_ohm = World.source_ohm
    monkeypatch.setattr(World, "source_ohm", lambda self, node: planted.get(node) or true_ohm(self, node))
    with pytest.raises(MeasurementError, match=f"^multimeter.*{words}") as refused:
        run(simulated("paper", errors="none"))
    assert str(refused.value).count("limits") == 1  # no other line is blamed


@pytest.mark.parametrize(("one", "two"), [("rail positive", "output"), ("v vc", "output")])
def test_lines_that_are_swapped_are_named_together(one: str, two: str, monkeypatch: pytest.MonkeyPatch) -> None:
    true_ohm, nodes = World.source_ohm, [each.replace(" ", "_") for each in (one, two)]
    other = dict(zip(nodes, reversed(nodes), strict=True))
    monkeypatch.setattr(World, "source_ohm", lambda self, node: true_ohm(self, other.get(node, str(node))))
    with pytest.raises(MeasurementError, match=f"{one} has .*: swapped with {two}; {two} has .*: swapped with {one}"):
        run(simulated("paper", errors="none"), positive_rail_ohm=[500, 2000])


def test_shorted_rail_is_found_and_powered_one_is_not(simulated_world: World) -> None:
    assert simulated_world.source_ohm("rail_positive") == pytest.approx(1000.0)
    simulated_world.set_load("positive", 0.5)
    assert simulated_world.source_ohm("rail_positive") == pytest.approx(0.5, rel=1e-3)
    simulated_world.set_rail("positive", 10.0)
    assert simulated_world.source_ohm("rail_positive") == 0.0


def test_findings_by_hand() -> None:
    settings = ElectricalSettings()
    assert list(findings(settings, GOOD)) == []
    assert list(findings(settings, dict.fromkeys(GOOD, math.inf))) == [
        "all lines are open: check the multimeter's leads on its ohm terminals, with four wires also on sense"
    ]
    (said,) = findings(settings, {**GOOD, "output_ohm": 200.5})
    assert said.endswith("too much")
    assert list(findings(settings, {**GOOD, "output_ohm": 200.1})) == []  # that the leads may have


def test_missing_sense_leads_differ_from_open_bench() -> None:
    with pytest.raises(MeasurementError, match="with four wires also on sense"):
        run(wires=4)


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"output_ohm": [200.0, 50.0]}, "in this order"), (dict.fromkeys(GOOD), "limits of at least one line")],
)
def test_limits_that_cannot_be_are_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        run(**settings)


def test_line_without_limits_is_left_out() -> None:
    found = run(v_vc_ohm=None, output_ohm=None).results
    assert [each.of for each in found.lines] == ["rail_positive", "rail_negative"]


@pytest.mark.parametrize("model", ["34401A", "34461A", "34465A", "2000", "DMM6500"])
def test_every_meter_reads_resistance_in_its_own_words(model: str) -> None:
    bench = simulated("paper", errors="none")
    assert bench.multimeter is not None
    meter = structs.replace(bench.multimeter, model=model)
    found = run(structs.replace(bench, multimeter=meter), lead_ohm=0.0).results
    for line, true_ohm in zip(found.lines, GOOD.values(), strict=True):
        assert line.resistance.value == pytest.approx(true_ohm, rel=1e-5), line.of
    assert isinstance(ReadsResistance, type)


def test_scatter_of_a_resistance_is_that_of_the_mean() -> None:
    found = _resistance(ElectricalSettings(), 1000.0, (99.0, 100.0, 101.0, 100.0))
    u = {part.source: part.u for part in found.parts}
    assert u["readings"] == pytest.approx(math.sqrt(2.0 / 3.0) / 2.0)
