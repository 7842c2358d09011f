"""A gyroscope mirrored: what leads the other way round, or an inverting output, leave of every value is its sign.

Combs of the other sign and the modulator's curve turned are leads of V_Vc exchanged: K_Vc turns. An output stage turned
with its offset and curve turns the scale factor. Noise is that of the same seed, so values and contributions are alike.
"""

from __future__ import annotations

import math
import re
from functools import cache
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest
from msgspec import structs

import vcfbench
from vcfbench.records.plain import plain
from vcfbench.sim.simulation import physical_parameters

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.station.description import BenchDescription

LEVELS = {"match_rates_deg_s": [20.0, 100.0, 200.0], "cycles": 1, "samples": 5}
SHORT = {"warm_up_s": 60.0}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "turntable": ("turntable", {}),
    "four steps": ("virtual-coriolis", {}),
    "four steps, V_Vc set": ("virtual-coriolis", {"bench": "paper"}),
    "four steps, absolute": ("virtual-coriolis", {"match": "absolute"}),
    "four steps, absolute, V_Vc set": ("virtual-coriolis", {"match": "absolute", "bench": "paper"}),
    "four steps, pair": ("virtual-coriolis", {"k_vc_by": "plus-minus"}),
    "four steps, pair, V_Vc set": ("virtual-coriolis", {"k_vc_by": "plus-minus", "bench": "paper"}),
    "four steps, curve": ("virtual-coriolis", {"k_vc_by": "curve"}),
    "four steps, curve, V_Vc set": ("virtual-coriolis", {"k_vc_by": "curve", "bench": "paper"}),
    "four steps, zeros": ("virtual-coriolis", {"order": "abba", "zeros": "bracket", "earth": "rate"}),
    "kvc": ("kvc", LEVELS),
    "kvc, V_Vc set": ("kvc", {**LEVELS, "v_vc": "set", "health": False}),
    "self-calibration": ("self-calibration", {"k_vc": 150.0}),
    "self-calibration, V_Vc set": ("self-calibration", {"k_vc": 150.0, "v_vc": "set"}),
    "online": ("online", {"k_vc": 150.0, "duration_s": 100.0, **SHORT}),
    "online, V_Vc set": ("online", {"k_vc": 150.0, "duration_s": 100.0, "v_vc": "set", **SHORT}),
    "threshold": ("threshold", {"at_most_s": 60.0}),
    "zero": ("zero", {"duration_s": 600.0}),
    "warmup": ("warmup", {}),
    "phase": ("phase", {**SHORT, "most_cycles": 3}),
    "bandwidth": ("bandwidth", SHORT),
    "resonance": ("resonance", SHORT),
    "vibration": ("vibration", {}),
    "power": ("power", SHORT),
    "electrical": ("electrical", {}),
    "rate-limits": ("rate-limits", {**SHORT, "samples": 4}),
    "g-sensitivity": ("g-sensitivity", {}),
    "repeatability": ("repeatability", {"power_cycles": 3, "off_s": 60.0}),
    "temperature": ("temperature", {}),
}
MIRRORS = {"K_Vc": (-1.0, 1.0), "scale factor": (1.0, -1.0), "both": (-1.0, -1.0)}
SIZES = ("dead_band.v_vc_v", "threshold.v_vc_v", "resolution.v_vc_v", "amplitude_v", "noise_v")
"""Volts without a sign."""


class Said(NamedTuple):
    """A value of the results with its uncertainty, and what that is made of."""

    value: float
    u: float
    unit: str
    scatter: float
    """Of an uncertainty with its degrees of freedom, relative, thrice."""
    parts: dict[str, float]


def said(found: Any, path: str = "") -> Iterator[tuple[str, Said]]:
    """Yield every value with an uncertainty, by where it stands."""
    if isinstance(found, dict):
        if {"value", "u", "unit"} <= found.keys() and found["u"] is not None:
            made_of = found.get("parts", found.get("contributions", ()))
            parts: dict[str, float] = {}
            for each in made_of:
                source = each["source"].partition(":")[0]  # what follows may be figures
                parts[source] = math.hypot(parts.get(source, 0.0), each["u"])
            scatter = 3.0 / math.sqrt(2.0 * (found.get("dof") or math.inf))
            yield path, Said(found["value"], found["u"], found["unit"], 0.15 + scatter, parts)
        for key, each in found.items():
            yield from said(each, f"{path}.{key}")
    elif isinstance(found, list | tuple):
        for place, each in enumerate(found):
            name = each.get("name", place) if isinstance(each, dict) else place
            yield from said(each, f"{path}[{name}]")


def mirrored(name: str, k_vc: float, scale: float) -> BenchDescription:
    """Return an embedded bench with its gyroscope mirrored, and a generator that is the same either way."""
    bench = vcfbench.load_bench(name)
    assert bench.simulation is not None
    of = physical_parameters(bench)
    turned: dict[str, tuple[float, tuple[str, ...]]] = {
        "virtual_path": (
            k_vc,
            ("left_comb_n_per_v2", "right_comb_n_per_v2", "offset_v", "second_order_per_v"),
        ),
        "output_stage": (scale, ("gain", "offset_v", "second_order_per_v")),
    }
    override = {**bench.simulation.override}
    for group, (sign, keys) in turned.items():
        own = {key: sign * getattr(getattr(of, group), key) for key in keys}
        override[group] = {**override.get(group, {}), **own}
    errors = structs.replace(bench.simulation.errors, rate_source="none", power="none")
    expected = structs.replace(bench.expected, scale_factor_v_per_deg_s=tuple(sorted((-0.012 * scale, -0.013 * scale))))
    bench = structs.replace(bench, expected=expected)
    return structs.replace(bench, simulation=structs.replace(bench.simulation, override=override, errors=errors))


def turn(name: str, unit: str, k_vc: float, scale: float) -> float:
    """Return the sign by which a mirror turns a value."""
    if unit == "V/V":
        return k_vc * scale
    if name.endswith(("k_vc", "[k_vc]")):
        return k_vc
    return scale if unit in {"V", "V/(deg/s)"} and not name.endswith(SIZES) else 1.0


@cache
def results(case: str, k_vc: float, scale: float) -> Any:
    """Return the results of a run on the mirrored bench, as they are written."""
    procedure, settings = CASES[case]
    settings = {"k_vc_guess_deg_s_per_v": k_vc * 150.0, **settings}
    bench = settings.pop("bench", "lab")
    if "k_vc" in settings:
        settings["k_vc"] = str(k_vc * settings["k_vc"])
    with TemporaryDirectory() as runs:
        run = vcfbench.run(procedure, mirrored(bench, k_vc, scale), seed=3, settings=settings, runs=runs)
        return plain(run.results)


USUAL = ("four steps",)
EVERY = pytest.mark.exhaustive
DRAWN = [pytest.param(case, "both", marks=[] if case in USUAL else [EVERY]) for case in CASES]
DRAWN += [pytest.param("four steps", mirror, marks=[EVERY]) for mirror in ("K_Vc", "scale factor")]


def below_0(found: Any, path: str = "") -> Iterator[str]:
    """Yield where an uncertainty, or a scatter, is below 0; contributions have the signs of their effects."""
    if isinstance(found, dict):
        for key, each in found.items():
            if isinstance(each, float) and each < 0.0 and re.match(r"(u|std|u95|expanded_u)(_|$)", key):
                yield f"{path}.{key}: {each}"
            if key not in {"parts", "contributions"}:
                yield from below_0(each, f"{path}.{key}")
    elif isinstance(found, list | tuple):
        for place, each in enumerate(found):
            yield from below_0(each, f"{path}[{place}]")


@pytest.mark.exhaustive
@pytest.mark.parametrize(("case", "mirror"), DRAWN)
def test_no_uncertainty_of_a_mirrored_gyroscope_is_below_0(case: str, mirror: str) -> None:
    assert list(below_0(results(case, *MIRRORS[mirror]))) == []


@pytest.mark.parametrize(("case", "mirror"), DRAWN)
def test_mirrored_gyroscope_has_equal_u_and_opposite_signs(case: str, mirror: str) -> None:
    turned = MIRRORS[mirror]
    usual, other = (dict(said(results(case, *signs))) for signs in ((1.0, 1.0), turned))
    assert usual
    assert usual.keys() == other.keys()
    rough = 0.5 if case in {"bandwidth", "resonance"} else 0.0  # noise of each gain is that of its own record
    for name, first in usual.items():
        close = first.scatter + rough
        second = other[name]
        apart = second.value - turn(name, first.unit, *turned) * first.value
        if name.endswith("virtual_deg"):
            apart = math.remainder(apart, 180.0)
        assert abs(apart) <= 6.0 * first.u, f"{name}: {first.value} u {first.u}, mirrored {second.value}"
        assert second.u == pytest.approx(first.u, rel=close), name
        for source in first.parts.keys() | second.parts.keys():
            parts = [abs(each.parts.get(source, 0.0)) for each in (first, second)]
            assert parts[1] == pytest.approx(parts[0], rel=0.15 + rough, abs=close * first.u), f"{name}: {source}"
