"""The procedures whose budgets are held, each with few windows, and how their gyroscope is built."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.procedures.parts.held import Part, Run
from tests.procedures.parts.moved import MOVED
from tests.procedures.parts.simulated import Bench, blind, noisy, quiet, sensitive_to_g
from vcfbench.files import parse_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from vcfbench.sim.parameters import BenchParameters

HERE = Path(__file__).parent


class Held(NamedTuple):
    """A procedure, its settings in these tests, its gyroscope, its bench file."""

    procedure: str
    told: Callable[[Bench], Mapping[str, Any]]
    gyroscopes: tuple[str, ...] = ("paper's", "other")
    as_built: Callable[[BenchParameters], BenchParameters] = quiet
    file: str = "lab"
    slow: bool = False
    """Figures are kept of the first gyroscope alone, and it too is for the exhaustive tests, as all others are."""

    def key(self, gyroscope: str) -> str:
        """Return the name of the run of a gyroscope."""
        return f"{self.procedure}, {gyroscope}"

    def run(self, gyroscope: str) -> Run:
        """Return the run of a gyroscope."""
        bench = Bench(self.file, gyroscope, self.as_built)
        return Run(bench, self.procedure, {"sample_interval_s": _INTERVAL_S, **self.told(bench)})


_INTERVAL_S = 0.7
"""From reading to reading: at the default of 1 s a time is the same with it left out, or as a divisor."""
_SWEEP = {"rates_deg_s": [200.0, 50.0, 10.0, 0.0, -10.0, -50.0, -200.0], "samples": 4}
_FEW = {"samples": 4, "cycles": 1}
_WARM = {"warm_up_s": 10.0}
_SHORT = {**_WARM, "record_samples": 256}
_SPARSE = {
    "frequencies_hz": [1.0, 4.5, 9.0, 16.0, 31.0, 48.0],
    "around_split": [0.5, 0.7, 0.88, 0.96, 1.0, 1.04, 1.12, 1.35, 1.65],
}


def _scale(bench: Bench) -> dict[str, float]:
    return {"scale_factor_v_per_deg_s": bench.scale_factor, "scale_factor_u_v_per_deg_s": 1e-6}


def _k_vc(bench: Bench) -> dict[str, Any]:
    return {"k_vc": str(bench.k_vc), "k_vc_u_deg_s_per_v": 0.002}


PROCEDURES = (
    Held("turntable", lambda _: _SWEEP),
    Held("virtual-coriolis", lambda _: _SWEEP, slow=True),
    Held("kvc", lambda _: {**_FEW, "match_rates_deg_s": [20.0, 80.0, 200.0], "health": False}, slow=True),
    Held(
        "self-calibration",
        lambda bench: {**_FEW, "virtual_rates_deg_s": [20.0, 80.0, 200.0], "health": False, **_k_vc(bench)},
        slow=True,
    ),
    Held("online", lambda bench: {**_WARM, "duration_s": 120.0, **_k_vc(bench)}, slow=True),
    Held("bandwidth", lambda _: {**_SHORT, **_SPARSE}, ("paper's",), slow=True),
    Held("resonance", lambda _: _SHORT, ("paper's",), slow=True),
    Held("phase", lambda _: _WARM, slow=True),
    Held("power", lambda bench: {**_WARM, **_FEW, **_scale(bench), "rails_varied": ["positive", "both"]}, slow=True),
    Held(
        "temperature",
        lambda bench: {
            **_WARM,
            **_FEW,
            "cycles": 2,
            **_scale(bench),
            "temperatures_c": [0.0, 20.0, 40.0],
            "level_deg_s": 100.0,
            "bias_instability_deg_h": 0.5,
        },
        slow=True,
    ),
    Held("electrical", lambda _: {}),
    Held(
        "vibration",
        lambda bench: {
            **_SHORT,
            "vibration_hz": [2.0, 10.0],
            "split_hz": bench.split_hz,
            "q": 1224.0,
            "in_phase_share": 0.147,
        },
        slow=True,
    ),
    Held("rate-limits", lambda bench: {**_WARM, "samples": 4, **_scale(bench)}),
    Held("g-sensitivity", lambda bench: {**_WARM, "samples": 4, **_scale(bench)}, as_built=sensitive_to_g),
    Held(
        "threshold",
        lambda bench: {
            **_FEW,
            "cycles": 2,
            "at_most_s": 60.0,
            "k_vc_deg_s_per_v": bench.k_vc,
            "k_vc_u_deg_s_per_v": 0.02,
        },
        as_built=blind,
        slow=True,
    ),
    Held(
        "warmup",
        lambda bench: {"shortest_s": 300.0, "longest_s": 400.0, "bias_instability_deg_h": 0.5, **_scale(bench)},
        as_built=noisy,
        slow=True,
    ),
    Held("zero", lambda bench: {"powered_s": 10.0, "duration_s": 300.0, **_scale(bench)}, as_built=noisy, slow=True),
)

_PER_U = {
    "u": 1.0,
    "4 sigma": 4.0,
    "limit": 3.0**0.5,
    "rectangle": 3.0**0.5,
    "digit": 12.0**0.5,
    "two limits": 6.0**0.5,
}


def parts_of_table() -> dict[str, tuple[Part, ...]]:
    """Return the rows of the table by procedure."""
    table = parse_toml((HERE / "parts.toml").read_text(encoding="utf-8"), "parts.toml")
    return {procedure: tuple(_part(row) for row in rows["parts"]) for procedure, rows in table.items()}


def _part(row: Sequence[Any]) -> Part:
    source, values, size, what, by, owner, why = row
    named, _, conditions = values.partition(";")
    kind, finite, dof = what.partition(", dof")
    if by.startswith("tests/"):
        assert (HERE.parents[2] / by).is_file(), f"{source} of {values}: there is no {by}"
    return Part(
        source,
        named,
        size / _PER_U[kind],
        None if by.startswith("tests/") else MOVED[by],
        why,
        owner,
        (float(dof) if dof else math.inf) if finite else None,
        kind == "rectangle",
        conditions,
    )
