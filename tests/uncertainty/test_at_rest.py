"""The budget of an output at rest: each contribution against its closed form."""

from __future__ import annotations

import math

import pytest

from tests.procedures.fakes import make_settings
from vcfbench.station.settings import PlacedInstrument, Sources, Station
from vcfbench.uncertainty.at_rest import (
    as_rate,
    flicker_counted,
    flicker_found,
    flicker_part,
    parts_at_rest,
)
from vcfbench.uncertainty.measurand import measurand
from vcfbench.uncertainty.windows import Flicker
from vcfbench.values.value import UncertaintyPart

METER = {"multimeter": PlacedInstrument(model="34401A", where="FAKE")}
ROOT3 = math.sqrt(3.0)
START_UP_S = make_settings(warm_up_s=50.0).start_up_s


@pytest.mark.parametrize(
    ("instruments", "known", "expected"),
    [
        (METER, {"meter_gain": 4e-3, "meter_offset_v": 3e-3, "meter_sigmas": 2.0}, (0.05 * 2e-3, 1.5e-3)),
        (METER, {"meter_gain": 4e-3, "meter_offset_v": 3e-3}, (0.05 * 4e-3 / ROOT3, 3e-3 / ROOT3)),
        ({}, {"meter_gain": 4e-3, "meter_offset_v": 3e-3}, ()),
        ({}, {"temperature_k": 2.0, "bias_deg_h_k": -36.0}, (-0.0125 * 0.01 * 2.0 / ROOT3,)),
        ({}, {"temperature_k": 2.0}, (0.0,)),
        (  # 4 K are to go at power-on, with 100 s: of the mean over a window of 80 s this is left
            *({}, {"warm_up_k": 4.0, "warm_up_time_s": 100.0, "bias_deg_h_k": 36.0}),
            (0.0125 * 0.01 * 4.0 / ROOT3 * math.exp(-START_UP_S / 100.0) * (1.0 - math.exp(-0.8)) / 0.8,),
        ),
        ({}, {"demodulator_phase_deg": 0.5, "bias_deg_s_demodulator_deg": -0.3}, (0.0125 * 0.3 * 0.5 / ROOT3,)),
        ({}, {}, ()),
    ],
)
def test_each_contribution_to_an_output_at_rest(
    instruments: dict[str, PlacedInstrument], known: dict[str, float], expected: tuple[float, ...]
) -> None:
    settings = make_settings(warm_up_s=50.0, station=Station(instruments=instruments, sources=Sources(**known)))
    parts = list(parts_at_rest(settings, -0.05, -0.0125, 80.0))
    assert [part.u for part in parts] == pytest.approx(list(expected))
    assert {part.of for part in parts} <= (
        {settings.station.instruments["multimeter"].owner} if instruments else {None}
    )


def test_output_as_rate_includes_u_of_scale_factor() -> None:
    """V / S: each part over |S|, and |V| / S^2 times that of S."""
    output = measurand(0.3, "V", [UncertaintyPart("readings", 2e-3, 9.0), UncertaintyPart("meter", 1e-3, None, "M1")])
    rate = as_rate(output, -0.02, 1e-3)
    assert (rate.value, rate.unit) == (pytest.approx(-15.0), "deg/s")
    assert {part.source: part.u for part in rate.parts} == pytest.approx(
        {"readings": 0.1, "meter": 0.05, "scale factor": 0.3 / 0.02**2 * 1e-3}
    )
    assert {part.source: (part.dof, part.of) for part in rate.parts if part.source != "scale factor"} == {
        "readings": (9.0, None),
        "meter": (None, "M1"),
    }
    assert not rate.missing
    without = as_rate(measurand(0.3, "V", output.parts, ["flicker"]), -0.02, None)
    assert without.u == pytest.approx(math.hypot(0.1, 0.05))
    assert (without.value, without.missing) == (pytest.approx(-15.0), ("flicker", "scale factor"))


def test_flicker_enters_a_value_by_its_sensitivity() -> None:
    part = flicker_part(Flicker(4.0, 20.0, "this record"), 0.25)
    assert part == UncertaintyPart("flicker: B 4 deg/h (this record)", 1.0, 20.0)
    assert flicker_part(Flicker(4.0, math.inf, "told"), 0.25).dof is None


@pytest.mark.parametrize("u_square", [0.25, 10.0])
def test_a_square_well_above_0_is_as_it_was_found(u_square: float) -> None:
    """Its degrees of freedom are twice its square over its variance."""
    found = flicker_counted(None, 20.0 * u_square, u_square, "run")
    assert found == Flicker(math.sqrt(20.0 * u_square), pytest.approx(800.0), "run, dof 800.0")
    assert flicker_counted(None, 9.0, 0.0, "run") == Flicker(3.0, math.inf, "run, dof inf")


def test_square_near_0_is_the_mean_above_0() -> None:
    """Numerically: mean and variance of a normal distribution about 6 of u 10, cut off at 0."""
    n = 200_000
    x = [100.0 * (k + 0.5) / n for k in range(n)]
    weights = [math.exp(-0.5 * ((each - 6.0) / 10.0) ** 2) for each in x]
    total = math.fsum(weights)
    mean = math.fsum(w * each for w, each in zip(weights, x, strict=True)) / total
    variance = math.fsum(w * (each - mean) ** 2 for w, each in zip(weights, x, strict=True)) / total
    found = flicker_counted(None, 6.0, 10.0, "run")
    assert (found.deg_h**2, found.dof) == (
        pytest.approx(mean, rel=1e-5),
        pytest.approx(2.0 * mean**2 / variance, rel=1e-4),
    )


def test_stated_scatter_counts_up_to_chance() -> None:
    """1.645 standard uncertainties: one in twenty of a normal distribution lies beyond."""
    told = Flicker(5.0, math.inf, "told")
    assert flicker_counted(told, 25.0 + 1.64 * 8.0, 8.0, "run") is told
    assert flicker_counted(told, 25.0 + 1.65 * 8.0, 8.0, "run").said.startswith("run, dof ")


TOLD = Sources(bias_instability_deg_h=5.0, bias_instability_from="told")


@pytest.mark.parametrize(
    ("known", "square", "u_square", "own"),
    [
        (Sources(), 4.0, 4.0, True),
        (TOLD, 4.0, 4.0, False),
        (TOLD, 4.0, 1.0, True),  # 32 degrees of freedom are enough
        (TOLD, 36.0, 30.0, True),  # more than what is told
        (Sources(bias_instability_deg_h=5.0, assumed={"bias_instability_deg_h": "the worst"}), 4.0, 4.0, True),
    ],
)
def test_own_flicker_counts_if_well_known_or_larger(
    known: Sources,
    square: float,
    u_square: float,
    own: bool,  # noqa: FBT001
) -> None:
    found = flicker_found(known, square, u_square)
    assert found.said == (f"this record, dof {found.dof:.1f}" if own else "told")
    assert own or found.deg_h == 5.0
