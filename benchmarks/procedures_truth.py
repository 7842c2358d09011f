"""Whether what the procedures state is true: each on gyroscopes and benches that are drawn anew for every seed.

    python benchmarks/procedures_truth.py zero 0:200 --lines zero.jsonl      seeds 0 to 199, a line each
    python benchmarks/procedures_truth.py --summary zero.jsonl warmup.jsonl
    python benchmarks/procedures_truth.py                                    names what can be asked for

The truth is a closed form of the parameters (docs/theory.md), which the simulation does not use, of a gyroscope
without noise: what flicker does to a bias is the business of its uncertainty. Gyroscopes and instruments are drawn
here, by numbers that have no part in the program: the generator's ranges break where no budget expects it, within the
data sheet all the same. For each value the summary has z = (value - truth) / u and how often U95 holds the truth; of a
bound, how often the truth is below. The same seeds give the same bytes. What stands in the file of --lines is not run
again. Records are kept in memory where there is a /dev/shm.

A procedure is a row of STUDIES: a function of a seed and a directory that yields `Stated` values.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from msgspec import structs

import vcfbench
from vcfbench.bench.settings import PAPER_RATES_DEG_S
from vcfbench.bench.simulated import physical_parameters, true_output
from vcfbench.studies.truth import turntable_truth

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from vcfbench.bench.description import BenchDescription

    Line = dict[str, Any]

MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile
LAB = vcfbench.load_bench("lab")
assert LAB.simulation is not None  # noqa: S101 - its file has one
FRESH = physical_parameters(LAB)
SIGMAS = 4.0
"""Of a 34401A's limits: its maker says that they are better than so many standard deviations."""
METER_LIMITS = {10.0: (35e-6, 50e-6)}
"""Limits of a 34401A a year after calibration by range: of the reading, and V (User's Guide p. 216)."""


class Stated(NamedTuple):
    """A value as it is stated, and the truth of it; without `u` it is a bound that the truth should be below."""

    name: str
    value: float
    truth: float
    u: float | None = None
    u95: float | None = None


def stated(name: str, found: Any, truth: float) -> Iterator[Stated]:
    """Yield a measurand, a stated value or an estimate beside its truth; nothing where it was not found."""
    if found is None or not found.u:
        return
    halves = (getattr(found, key, None) for key in ("expanded_u", "u95", "u_95"))
    yield Stated(name, found.value, truth, found.u, next((each for each in halves if each is not None), None))


def drawn_bench(seed: int, *, base: BenchDescription = LAB, told: Mapping[str, Any] | None = None) -> BenchDescription:
    """Return the bench of a seed: its gyroscope and all instruments drawn, none as the program draws them.

    Args:
        seed: of the draw.
        base: the bench whose instruments, limits and settings there are.
        told: keys of [uncertainty] of its bench file that are changed.
    """
    draw = np.random.default_rng([20260723, seed])

    def about(value: float, share: float) -> float:
        return value * (1.0 + share * float(draw.uniform(-1.0, 1.0)))

    noise, stage = FRESH.noise, FRESH.output_stage
    flicker_deg_s = noise.bias_instability_deg_s * math.exp(float(draw.uniform(-0.7, 0.7)))
    modes = {
        name: {
            "quality": about(getattr(FRESH, name).quality, 0.1),
            "quadrature_rad_s": about(getattr(FRESH, name).quadrature_rad_s, 0.2),
        }
        for name in ("sense_in_phase", "sense_anti_phase")
    }
    override: dict[str, Any] = {
        **modes,
        "output_stage": {
            "gain": about(stage.gain, 0.03),
            "offset_v": stage.offset_v + float(draw.uniform(-0.02, 0.02)),
        },
        "noise": {
            "angle_random_walk_deg_sqrt_s": about(noise.angle_random_walk_deg_sqrt_s, 0.3),
            "bias_instability_deg_s": flicker_deg_s,
        },
        "table": {
            "rate_error": 1e-5 * float(draw.uniform(-1.0, 1.0)),
            "ripple_phase_rad": draw.uniform(-3, 3, 2).tolist(),
        },
    }
    assert base.simulation is not None  # noqa: S101 - as above
    errors = structs.replace(
        base.simulation.errors,
        multimeter=_meter(draw),
        v_vc_meter=_meter(draw) if base.v_vc_meter is not None else base.simulation.errors.v_vc_meter,
        rate_source=_generator(draw),
    )
    known = {"bias_instability_deg_h": 3600.0 * flicker_deg_s, **(told or {})}
    return structs.replace(
        base,
        simulation=structs.replace(base.simulation, errors=errors, override=override),
        uncertainty=structs.replace(base.uncertainty, **known),
    )


def _meter(draw: np.random.Generator) -> dict[str, Any]:
    """Return errors of a 34401A on its 10 V range; its noise is that of the data sheet."""
    gain, offset_v = METER_LIMITS[10.0]
    return {
        "gain_error": gain / SIGMAS * float(draw.standard_normal()),
        "offset_v": offset_v / SIGMAS * float(draw.standard_normal()),
        "noise": 0.3,
        "noise_seed": int(draw.integers(2**31)),
    }


def _generator(draw: np.random.Generator) -> dict[str, Any]:
    """Return errors of a 33220A within 2 % and 4 mV, whose ranges break anywhere."""
    uppers = [*np.sort(np.exp(draw.uniform(math.log(0.03), math.log(9.0), int(draw.integers(2, 5))))).tolist(), 10.0]
    ranges = [
        {
            "upper_v": upper_v,
            "gain_error": 0.02 * float(draw.uniform(-1.0, 1.0)),
            "offset_error_v": 4e-3 * float(draw.uniform(-1.0, 1.0)),
        }
        for upper_v in uppers
    ]
    return {"ranges": ranges, "dac_bits": 14, "setting_digits": 4}


class Truth(NamedTuple):
    """What is true of a bench's gyroscope, of small signals at rest."""

    bias_v: float
    scale_factor: float
    k_vc: float

    @classmethod
    def of(cls, bench: BenchDescription) -> Truth:
        """Return it by the closed form of the warm gyroscope."""
        output, at_input = true_output(bench), true_output(bench, at_input=True)
        slope = (output(0.01, None) - output(-0.01, None)) / 0.02
        per_volt = (at_input(0.0, 1e-4) - at_input(0.0, -1e-4)) / 2e-4
        return cls(output(0.0, None), slope, per_volt / slope)


def run(procedure: str, bench: BenchDescription, seed: int, where: str, **settings: Any) -> Any:
    """Return the run of a procedure; ends the study where it gave no results."""
    done = vcfbench.run(procedure, bench, seed=seed, settings=settings, runs=where)
    if done.results is None:
        raise SystemExit(f"{procedure}, seed {seed}: no results: {done.error}")
    return done


def zero(seed: int, where: str) -> Iterator[Stated]:
    """An hour at rest."""
    bench = drawn_bench(seed)
    true, noise = Truth.of(bench), physical_parameters(bench).noise
    found = run("zero", bench, seed, where, scale_factor_v_per_deg_s=true.scale_factor).results
    yield from stated("output_v", found.output_v, true.bias_v)
    yield from stated("bias", found.bias, true.bias_v / true.scale_factor)
    yield from stated("trend", found.trend, 0.0)
    truths = {
        "angle random walk": 60.0 * noise.angle_random_walk_deg_sqrt_s,
        "bias instability": 3600.0 * noise.bias_instability_deg_s,
    }
    for name, truth in truths.items():
        each = found.coefficient(name)
        if each.value and each.u:
            half = getattr(each, "u_95", None)
            yield Stated(name, each.value, truth, each.u, 1.96 * each.u if half is None else half)
        yield Stated(f"{name}, below", each.upper_95, truth)


def warmup(seed: int, where: str) -> Iterator[Stated]:
    """From power-on; every other gyroscope has an exponential that is seen."""
    bench = drawn_bench(seed)
    seen = {} if seed % 2 else {"thermal": {"self_heating_k": 3.0, "bias_coefficient_deg_s_k": 30.0 / 3600.0}}
    assert bench.simulation is not None  # noqa: S101 - as above
    override = {**bench.simulation.override, **seen}
    bench = structs.replace(bench, simulation=structs.replace(bench.simulation, override=override))
    true, of = Truth.of(bench), physical_parameters(bench)
    flicker_deg_h = 3600.0 * of.noise.bias_instability_deg_s
    settings = {"scale_factor_v_per_deg_s": true.scale_factor, "bias_instability_deg_h": flicker_deg_h}
    found = run("warmup", bench, seed, where, **settings).results
    kind = "seen" if found.amplitude is not None else "unseen"
    yield from stated(f"bias_end, exponential {kind}", found.bias_end, true.bias_v / true.scale_factor)
    if seen:
        yield from stated("time_constant", found.time_constant, of.thermal.time_constant_s)


def kvc(seed: int, where: str) -> Iterator[Stated]:
    """K_Vc on the table."""
    bench = drawn_bench(seed)
    true = Truth.of(bench)
    found = run("kvc", bench, seed, where, warm_up_s=1800.0).results
    yield from stated("bias", found.bias, true.bias_v)
    yield from stated("k_vc", found.k_vc, true.k_vc)
    yield from stated("scale_factor", found.scale_factor, true.scale_factor)


def self_calibration(seed: int, where: str) -> Iterator[Stated]:
    """K_Vc on the table, then the gyroscope by itself, the noise another."""
    bench = drawn_bench(seed)
    true = Truth.of(bench)
    settings = {"warm_up_s": 1800.0, "dut": "G", "devices": f"{where}/devices"}
    run("kvc", bench, 2 * seed, where, **settings)
    found = run("self-calibration", bench, 2 * seed + 1, where, **settings).results
    yield from stated("bias", found.bias, true.bias_v)
    yield from stated("scale_factor", found.scale_factor, true.scale_factor)
    yield from stated("drift", found.drift.change_ppm, 0.0)


def characterize(seed: int, where: str) -> Iterator[Stated]:
    """The session whose later parts are warm: values of its parts, and biases as the data sheet has them."""
    bench = drawn_bench(seed)
    true = Truth.of(bench)
    parts = ["warmup", "turntable", "kvc", "zero"]
    found = run("characterize", bench, seed, where, parts=parts).results
    line = turntable_truth(true_output(bench), PAPER_RATES_DEG_S)
    truths = {
        ("kvc", "bias", "V"): true.bias_v,
        ("zero", "bias", "deg/s"): true.bias_v / true.scale_factor,
        ("zero", "output", "V"): true.bias_v,
        ("warmup", "bias end", "deg/s"): true.bias_v / true.scale_factor,
        ("kvc", "K_Vc", "(deg/s)/V"): true.k_vc,
        ("kvc", "scale factor", "V/(deg/s)"): true.scale_factor,
        ("turntable", "scale factor", "V/(deg/s)"): line["scale_factor"],
        ("turntable", "bias", "V"): line["bias"],
        ("turntable", "bias", "deg/s"): line["bias_deg_s"],
    }
    for row in found.data_sheet:
        truth = truths.get((row.procedure, row.quantity, row.unit))
        if truth is not None and row.u:
            yield Stated(f"{row.procedure}: {row.quantity}, {row.unit}", row.value, truth, row.u, row.u95)


STUDIES: Mapping[str, Callable[[int, str], Iterator[Stated]]] = {
    "zero": zero,
    "warmup": warmup,
    "kvc": kvc,
    "self-calibration": self_calibration,
    "characterize": characterize,
}


def line_of(procedure: str, seed: int) -> Line:
    """Return the line of a seed: procedure, seed, and of each value [value, truth, u, u95]."""
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as where:
        values = {each.name: list(each[1:]) for each in STUDIES[procedure](seed, where)}
    return {"procedure": procedure, "seed": seed, "values": values}


def lines_of(files: Iterable[Path]) -> list[Line]:
    """Return the lines of some files; one that was cut off at the end of a file is left out."""
    texts = [text for file in files for text in file.read_text(encoding="utf-8").splitlines(keepends=True)]
    return [json.loads(text) for text in texts if text.endswith("\n")]


def continued(file: Path | None, procedure: str, seeds: Sequence[int]) -> list[Line]:
    """Return the lines of `seeds`: those that stand in `file`, and those that are run now and added to it."""
    had = lines_of([file]) if file is not None and file.exists() else []
    known = {line["seed"]: line for line in had if line["procedure"] == procedure}
    if file is not None:
        file.write_text("".join(json.dumps(line) + "\n" for line in had), encoding="utf-8")
    for seed in seeds:
        if seed in known:
            continue
        known[seed] = line_of(procedure, seed)
        if file is not None:
            with file.open("a", encoding="utf-8") as out:
                print(json.dumps(known[seed]), file=out)
    return [known[seed] for seed in seeds]


def summary(lines: Sequence[Line]) -> Iterator[str]:
    """Yield the table of the study, a row a value."""
    yield f"{'value':58} {'seeds':>5} {'mean z':>7} {'sd z':>6} {'max |z|':>7} {'in U95':>7}"
    for procedure in dict.fromkeys(line["procedure"] for line in lines):
        own = [line["values"] for line in lines if line["procedure"] == procedure]
        for name in sorted({each for values in own for each in values}):
            yield _row(f"{procedure}: {name}", np.array([v[name] for v in own if name in v], dtype=np.float64))
    yield "* outside sd 0.9 to 1.1 or 93 to 97.5 %; in N seeds chance alone moves the sd by 0.7/sqrt(N),"
    yield "  the share by 22 %/sqrt(N)"


def _row(name: str, found: Any) -> str:
    """Return the row of a value; found (n, 4): value, truth, u, u95, the last two NaN of a bound."""
    value, truth, u, u95 = found.T
    if np.isnan(u).all():
        held = 100.0 * float(np.mean(truth <= value))
        mark = "" if 93.0 <= held <= 97.5 else "  *"
        return f"{name:58} {value.size:5d} {'':7} {'':6} {'':7} {held:6.1f}%{mark}"
    z = (value - truth) / u
    held = 100.0 * float(np.mean(np.abs(value - truth) <= u95))
    mark = "" if 93.0 <= held <= 97.5 and 0.9 <= z.std(ddof=1) <= 1.1 else "  *"
    mark = "  no U95" if np.isnan(u95).any() else mark
    return f"{name:58} {z.size:5d} {z.mean():+7.2f} {z.std(ddof=1):6.2f} {abs(z).max():7.2f} {held:6.1f}%{mark}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("procedure", nargs="?", choices=sorted(STUDIES))
    parser.add_argument("seeds", nargs="?", default="0:20", help="first, and the one after the last: 0:200")
    parser.add_argument("--lines", type=Path, help="file that keeps a line a seed")
    parser.add_argument("--summary", type=Path, nargs="+", metavar="FILE", help="run nothing, sum up such files")
    asked = parser.parse_args()
    if asked.summary:
        lines = lines_of(asked.summary)
    elif asked.procedure:
        first, after = map(int, asked.seeds.split(":"))
        lines = continued(asked.lines, asked.procedure, range(first, after))
    else:
        parser.print_help()
        return 0
    print("\n".join(summary(lines)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
