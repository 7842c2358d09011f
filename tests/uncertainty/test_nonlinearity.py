"""The largest residual of a line as a sum of errors: each effect against its closed form."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.procedures.test_uncertainty import K_VC, RATES, settings, table_points
from tests.uncertainty.test_known_levels import of
from tests.uncertainty.test_line import line_of
from tests.uncertainty.test_residuals import driven, four_steps_of
from vcfbench.analysis.budget import Source
from vcfbench.procedures.turntable import turntable_statement
from vcfbench.procedures.virtual_coriolis.budget import four_step_statement
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.station.settings import Match, Sources
from vcfbench.uncertainty import nonlinearity
from vcfbench.uncertainty.nonlinearity import CurvedLine, WorstResidual

LINE = line_of([-2.0, -1.0, 0.5, 1.0, 3.0], [2.0, 1.3, -0.4, -1.0, -3.5])
VOLTS, THROUGH = np.array([-2.0, -1.0, 0.5, 1.0, 3.0]), np.arange(25.0).reshape(5, 5) - 7.0


def test_level_and_range_errors_move_residuals() -> None:
    known, curved = of(1.0, 10.0), CurvedLine.of("it", LINE)
    moved = curved.with_errors(known, VOLTS, THROUGH, [0.25, 0.5])
    u_v = [0.25, 0.5, *map(known.u_besides_v, VOLTS[2:])]
    assert list(moved.own) == ["generator resolution"]
    assert moved.own["generator resolution"] == pytest.approx(THROUGH * u_v)
    low = np.abs(VOLTS) <= 1.0
    expected = {
        f"generator {kind}, {ends} V range": (THROUGH * weights)[:, here].sum(axis=1)
        for kind, weights in (("gain", VOLTS), ("offset", 1.0))
        for ends, here in (("1", low), ("10", ~low))
    }
    assert {name: effect.tolist() for name, effect in moved.effects.items()} == {
        name: pytest.approx(effect.tolist()) for name, effect in expected.items()
    }
    assert moved.only_bound == ""


def test_unknown_generator_ranges_use_the_worst_case() -> None:
    known = of()
    moved = CurvedLine.of("it", LINE).with_errors(known, VOLTS, THROUGH)
    largest = int(np.abs(moved.ppm).argmax())
    for kind in ("gain", "offset"):
        ranges = known.shared(VOLTS, THROUGH, largest)
        columns = [error.u * effect for of_kind, _, effect, error in ranges if of_kind == kind]
        assert moved.own[f"generator {kind}"] == pytest.approx(np.column_stack(columns))
    assert (moved.effects, bool(moved.only_bound)) == ({}, True)


def test_largest_residual_follows_errors_by_its_sign(monkeypatch: pytest.MonkeyPatch) -> None:
    spreads: list[Any] = []

    def spread(*values: Any) -> Any:
        spreads.append(values)
        return SimpleNamespace(near_largest=lambda: np.array([0, 3]), largest=lambda: "by trials")

    monkeypatch.setattr(nonlinearity, "ResidualSpread", spread)
    flicker, readings = 3.0 * np.eye(5), 2.0 * np.eye(5)
    noise: Any = SimpleNamespace(dof=8.0, by_flicker=lambda *_: flicker, by_readings=lambda _: readings)
    curved = CurvedLine.of("it", LINE).with_errors(of(1.0, 10.0), VOLTS, THROUGH, [0.25, 0.5])
    sources = {name: Source(name, 0.0, 0.5 + n) for n, name in enumerate(curved.effects)}
    table = next(iter(sources))
    sources[table] = Source.within(table, 0.0, 2.0)
    found = WorstResidual.of(curved, sources, noise)
    k = int(np.abs(curved.ppm).argmax())
    sign, own = float(np.sign(curved.ppm[k])), curved.own["generator resolution"]
    assert found.size_ppm == abs(curved.ppm[k])
    assert found.sum.weights == pytest.approx(sign * curved.weights[k])
    assert [(each.name, each.u, each.unit) for each in found.own] == [
        ("generator resolution: it", pytest.approx(np.linalg.norm(own[k])), "ppm")
    ]
    assert found.rates_deg_s == (-2.0, 1.0)
    q = {name: 0.5 + n for n, name in enumerate((*found.effects, "readings: it", "flicker: it"))}
    effects = {name: sign * float(effect[k]) for name, effect in curved.effects.items()}
    of_levels = math.fsum(size * q[name] for name, size in effects.items()) + q["generator resolution: it"]
    assert found.value(q) == pytest.approx(found.size_ppm - q["readings: it"] - q["flicker: it"] - of_levels)
    ((ppm, scattered, dof, normal, common, rectangular),) = spreads
    assert (ppm is curved.ppm, scattered is readings, dof) == (True, True, 8.0)
    assert normal == pytest.approx(flicker + own @ own.T)
    assert common == pytest.approx(np.array([curved.effects[name] * each.u for name, each in sources.items()]))
    assert rectangular.tolist() == [True, False, False, False]


def test_three_rates_have_a_non_linearity() -> None:
    ends = [point for point in table_points(std_v=1e-9) if point.rate_deg_s in {200.0, 0.0, -200.0}]
    bent = [point if point.rate_deg_s else type(point)(1, 0.0, 0.0, point.output_v + 0.01, 1e-9, 10) for point in ends]
    value = turntable_statement(settings(Sources()), bent).value("nonlinearity")
    assert value.value == pytest.approx(1e6 * 0.01 * 2.0 / 3.0 / (0.0125 * 400.0))


def test_unknown_generator_ranges_give_a_bound() -> None:
    known = Sources(generator_gain=1e-6, generator_offset_v=1e-9)
    points = four_steps_of(driven(np.array(RATES) / K_VC))
    stated = four_step_statement(settings(known), points, Matching.of(points, Match.ZERO, 10.0))
    (bound,) = (each for each in stated.bounds if each.name == "virtual.nonlinearity")
    assert "the ends of the generator's ranges are unknown" in bound.of
    with pytest.raises(KeyError):
        stated.value("virtual.nonlinearity")
