"""Whether a self-calibration years after the table tells the truth: gyroscopes that age, and other instruments.

    python experiments/ageing.py --check                              the truth, against an integration at carrier level
    python experiments/ageing.py --seeds 0:100 --lines first.jsonl    all causes of ageing
    python experiments/ageing.py --seeds 0:300 --cause leak,all_seen --lines leak.jsonl
    python experiments/ageing.py --no-oscilloscope --cause nothing,leak,split    nothing of its health is measured
    python experiments/ageing.py --summary first.jsonl leak.jsonl

Each seed draws a gyroscope of the kind (vcfbench.testing.gyroscopes; or takes the paper's, with --gyroscopes paper) and
a laboratory, and calibrates it on its table (`run kvc --dut`). Then, for every cause, that
gyroscope ages, is put on a bench without a table, and calibrates itself (`run self-calibration`). Nothing is taken
from the simulation or from its draws: the truth is the closed form in gyroscope_by_hand.py, the specimens of the
instruments are drawn here and stated one by one in the bench files, generators with ranges of their own. The same
instrument has the same inventory number.

Of each value z = (value - truth) / u is kept, and whether U95 holds the truth; or that the run refused to state it.
What stands in the file of --lines is not run again. The exit code is 1 where something is beyond the limits of
limits.py, or where a run stated what cannot be corrected.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from copy import deepcopy
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from gyroscope_by_hand import Gyroscope, integrated_v
from limits import outside

import vcfbench
from vcfbench.errors import Aborted, BenchError
from vcfbench.testing import gyroscopes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    Line = dict[str, Any]
    Overrides = dict[str, dict[str, Any]]
    Parameters = Mapping[str, Mapping[str, Any]]
    Ageing = Callable[[np.random.Generator, Parameters], Overrides]
    Unseen = Callable[[float, Parameters], Overrides]

MEMORY = Path("/dev/shm")  # noqa: S108 - Linux has it, and directories in it are made by tempfile
STREAM = 0x41474549  # of these draws: no other benchmark has it
WARM_UP_S = 1800.0
SENSE = ("sense_in_phase", "sense_anti_phase")
METERS = ("multimeter", "v_vc_meter")
ON_TABLE = "on the table"


# Specimens of the instruments


def _within(rng: np.random.Generator, limit: float) -> float:
    """Return an error somewhere within a limit, one place as likely as another."""
    return float(rng.uniform(-limit, limit))


def _quarter(rng: np.random.Generator, limit: float) -> float:
    """Return an error of which the limit is four standard deviations, as the maker of the 34401A says."""
    return float(np.clip(rng.normal(0.0, limit / 4.0), -limit, limit))


def meter(rng: np.random.Generator) -> Line:
    """Return a 34401A a year after its calibration, by the 10 V range and the ac table of its guide."""
    (of_ranges,) = rng.spawn(1)
    ac = {
        "range_gain_error": [_quarter(rng, 0.0006), *(_quarter(of_ranges, 0.0006) for _ in range(4))],
        "low_frequency_error": _quarter(rng, 0.007),
        "flatness_error": _quarter(rng, 0.024),
        "range_share": _quarter(rng, 1.0),
        "noise": 3e-6,
    }
    counter = {"timebase_error": _quarter(rng, 8e-5), "noise": 0.3}
    return {
        "gain_error": _quarter(rng, 35e-6),
        "offset_v": _quarter(rng, 50e-6),
        "noise": 0.3,
        "short_noise": 0.25,
        "input_ohm": 10e6 * (1.0 + _within(rng, 0.01)),
        "quantised": True,
        "noise_seed": int(rng.integers(1 << 31)),
        "ac": ac,
        "counter": counter,
    }


def generator(rng: np.random.Generator) -> Line:
    """Return a 33220A within 2 % and 4 mV, with one to six ranges whose ends are drawn."""
    ends = sorted(float(each) for each in 10.0 ** rng.uniform(-1.6, 0.9, int(rng.integers(0, 6))))
    ranges = [
        {"upper_v": end, "gain_error": _within(rng, 0.02), "offset_error_v": _within(rng, 0.004)}
        for end in (*ends, 10.0)
    ]
    return {
        "ranges": ranges,
        "amplitude_error": _within(rng, 0.01),
        "frequency_error": _within(rng, 20e-6),
        "dac_bits": 14,
        "setting_digits": 4,
    }


def supply(rng: np.random.Generator) -> Line:
    """Return an E3631A by the limits of its guide."""
    outputs = {}
    for name in ("p25v", "n25v"):
        outputs[name] = {
            "programming_gain": _within(rng, 0.5e-3),
            "programming_offset_v": _within(rng, 20e-3),
            "readback_gain": _within(rng, 0.5e-3),
            "readback_offset_v": _within(rng, 10e-3),
            "ripple_v": float(rng.uniform(0.0, 2e-4)),
            "ripple_phase_rad": _within(rng, math.pi),
        }
    return {**outputs, "quantised": True}


def oscilloscope(rng: np.random.Generator) -> Line:
    """Return a DSO7104B within 2 %, a tenth of a division, 100 ps and 25 ppm."""
    return {
        "gain_error": [_within(rng, 0.02) for _ in range(4)],
        "offset_error_div": [_within(rng, 0.1) for _ in range(4)],
        "skew_s": [_within(rng, 1e-10) for _ in range(4)],
        "time_base_error": _within(rng, 25e-6),
        "noise_div": 0.02,
        "converter_bits": 8,
        "noise_seed": int(rng.integers(1 << 31)),
    }


SPECIMENS: dict[str, Callable[[np.random.Generator], Line]] = {
    "multimeter": meter,
    "v_vc_meter": meter,
    "rate_source": generator,
    "power": supply,
    "oscilloscope": oscilloscope,
}


def weaker_rail_v(power: Line, set_v: float) -> float:
    """Return the weaker rail of the gyroscope, V, where `set_v` are set."""
    return min(
        float(set_v * (1.0 + power[n]["programming_gain"]) + power[n]["programming_offset_v"]) for n in ("p25v", "n25v")
    )


# Causes


@dataclass(frozen=True)
class Cause:
    """What happens between table and field: to the gyroscope, to the room, and which instruments are others."""

    ages: tuple[Ageing, ...] = ()
    other: tuple[str, ...] = ()
    apart_k: tuple[float, float] = (0.0, 0.0)
    """Least and largest difference of the room's temperatures, either way."""
    probe: bool = False
    """Whether a channel of the oscilloscope, or its probe, has changed by 2e-4 to 1e-2, either way."""
    unseen: tuple[Unseen, ...] = ()
    """What drifts since the certificate, by up to what the bench file says it may."""


def _times(names: Iterable[tuple[str, str]], factor: float, old: Parameters) -> Overrides:
    changed: Overrides = {}
    for group, name in names:
        changed.setdefault(group, {})[name] = old[group][name] * factor
    return changed


def leak(rng: np.random.Generator, old: Parameters) -> Overrides:
    """All quality factors fall to 50 to 100 %."""
    return _times([(mode, "quality") for mode in ("drive_mode", *SENSE)], rng.uniform(0.5, 1.0), old)


def split(rng: np.random.Generator, old: Parameters) -> Overrides:
    """The anti-phase mode moves by up to 0.5 Hz."""
    mode = "sense_anti_phase"
    return {mode: {"frequency_hz": old[mode]["frequency_hz"] + _within(rng, 0.5)}}


def in_phase(rng: np.random.Generator, old: Parameters) -> Overrides:
    """The in-phase mode moves by up to 5 Hz."""
    mode = "sense_in_phase"
    return {mode: {"frequency_hz": old[mode]["frequency_hz"] + _within(rng, 5.0)}}


def carrier_phase(rng: np.random.Generator, old: Parameters) -> Overrides:
    """The carrier turns by up to a degree."""
    return {
        "virtual_path": {"carrier_phase_rad": old["virtual_path"]["carrier_phase_rad"] + _within(rng, math.tau / 360)}
    }


def demodulator_phase(rng: np.random.Generator, old: Parameters) -> Overrides:
    """The demodulator's reference turns by up to a degree."""
    return {
        "sense_path": {
            "demodulator_phase_rad": old["sense_path"]["demodulator_phase_rad"] + _within(rng, math.tau / 360)
        }
    }


def feedthrough(rng: np.random.Generator, _old: Parameters) -> Overrides:
    """Up to a thousandth of the modulated V_Vc gets into the sense signal."""
    return {"sense_path": {"v_vc_feedthrough": _within(rng, 1e-3)}}


def modulator(rng: np.random.Generator, old: Parameters) -> Overrides:
    """Both orders of the modulator change by up to 30 %."""
    path = old["virtual_path"]
    names = ("second_order_per_v", "third_order_per_v2")
    return {"virtual_path": {name: path[name] * (1.0 + _within(rng, 0.3)) for name in names}}


def harmless(rng: np.random.Generator, old: Parameters) -> Overrides:
    """What K_Vc does not hold: output gain 3 %, bias 20 mV, quadrature 20 %, drive with carrier 2 %, pick-offs 2 %."""
    drive = 1.0 + _within(rng, 0.02)
    pick_off = [(mode, "pick_off_v_per_m") for mode in SENSE]
    amplitudes = [("drive_loop", "amplitude_m"), ("sense_path", "reference_amplitude_v")]
    return merged(
        _times(pick_off, 1.0 + _within(rng, 0.02), old),
        _times([(mode, "quadrature_rad_s") for mode in SENSE], 1.0 + _within(rng, 0.2), old),
        _times(amplitudes, drive, old),
        _times([("output_stage", "gain")], 1.0 + _within(rng, 0.03), old),
        {"output_stage": {"offset_v": old["output_stage"]["offset_v"] + _within(rng, 0.02)}},
    )


def drive_alone(rng: np.random.Generator, old: Parameters) -> Overrides:
    """The drive's amplitude changes by up to half a per cent and the carrier does not follow."""
    return _times([("drive_loop", "amplitude_m")], 1.0 + _within(rng, 0.005), old)


def combs(relative: float, old: Parameters) -> Overrides:
    """Return both feedback combs, stronger by a part of them."""
    names = [("virtual_path", "left_comb_n_per_v2"), ("virtual_path", "right_comb_n_per_v2")]
    return _times(names, 1.0 + relative, old)


def mass(relative: float, old: Parameters) -> Overrides:
    """Return the sense mass, larger by a part of it."""
    return _times([("virtual_path", "mass_kg")], 1.0 + relative, old)


SEEN = (leak, split, in_phase, carrier_phase, demodulator_phase, feedthrough, modulator)
BEYOND = ("too_warm",)
"""Causes that are seen and beyond what can be corrected: there the run shall refuse."""
EVERYTHING = ("multimeter", "v_vc_meter", "rate_source", "power", "oscilloscope")
CAUSES: dict[str, Cause] = {
    "nothing": Cause(),
    "harmless": Cause((harmless,)),
    "leak": Cause((leak,)),
    "split": Cause((split,)),
    "in_phase": Cause((in_phase,)),
    "temperature": Cause(apart_k=(0.0, 15.0)),
    "carrier_phase": Cause((carrier_phase,)),
    "demodulator_phase": Cause((demodulator_phase,)),
    "feedthrough": Cause((feedthrough,)),
    "modulator": Cause((modulator,)),
    "other_meter": Cause(other=METERS),
    "other_generator": Cause(other=("rate_source",)),
    "other_supply": Cause(other=("power",)),
    "other_bench": Cause(other=EVERYTHING),
    "all_seen": Cause((*SEEN, harmless), apart_k=(0.0, 15.0)),
    "all_seen_elsewhere": Cause((*SEEN, harmless), other=EVERYTHING, apart_k=(0.0, 15.0)),
    "drive_alone": Cause((drive_alone,)),
    "drive_alone_elsewhere": Cause((drive_alone,), other=EVERYTHING),
    "probe": Cause(probe=True),
    "probe_and_drive": Cause((drive_alone,), probe=True),
    "all_seen_probe": Cause((*SEEN, harmless), apart_k=(0.0, 15.0), probe=True),
    "too_warm": Cause(apart_k=(25.0, 35.0)),
    "combs": Cause(unseen=(combs,)),
    "mass": Cause(unseen=(mass,)),
    "all_elsewhere_later": Cause((*SEEN, harmless), other=EVERYTHING, apart_k=(0.0, 15.0), unseen=(combs,)),
}


def merged(*several: Parameters) -> Overrides:
    """Return what several say of parameters, the later ones last."""
    found: Overrides = {}
    for each in several:
        for group, values in each.items():
            found.setdefault(group, {}).update(values)
    return found


# Benches


def shipped(bench: str) -> Overrides:
    """Return the parameters of a bench by their names, as `vcfbench sim show` prints them."""
    command = [sys.executable, "-m", "vcfbench", "sim", "show", "--bench", bench, "--json"]
    shown = json.loads(subprocess.run(command, capture_output=True, check=True, text=True).stdout)
    found: Overrides = {}
    for each in shown["parameters"]:
        kind, group, name, *_ = each["path"].split(".")
        if kind == "override":
            found.setdefault(group, {})[name] = each["value"]
    return found


def near_the_papers(rng: np.random.Generator, named: Parameters) -> Overrides:
    """Return a gyroscope whose modes, combs, phases, quadrature and modulator are drawn about the paper's."""
    drive_hz = named["drive_mode"]["frequency_hz"]
    size = 1.0 + _within(rng, 0.02)
    return {
        "drive_mode": {"quality": float(rng.uniform(1000.0, 2000.0))},
        "sense_anti_phase": {
            "frequency_hz": drive_hz - float(rng.uniform(20.0, 30.0)),
            "quality": float(rng.uniform(900.0, 1800.0)),
            "quadrature_rad_s": _within(rng, 0.4),
        },
        "sense_in_phase": {
            "frequency_hz": drive_hz - float(rng.uniform(110.0, 180.0)),
            "quality": float(rng.uniform(900.0, 1800.0)),
            "left_participation": 0.8 + _within(rng, 0.05),
            "quadrature_rad_s": _within(rng, 0.1),
        },
        "virtual_path": {
            "carrier_phase_rad": math.pi + _within(rng, math.radians(1.0)),
            "left_comb_n_per_v2": 1.434e-07 * size * (1.0 + _within(rng, 0.015)),
            "right_comb_n_per_v2": 1.434e-07 * size * (1.0 + _within(rng, 0.015)),
            "offset_v": _within(rng, 0.03),
            "second_order_per_v": _within(rng, 0.015),
            "third_order_per_v2": _within(rng, 0.015),
        },
        "sense_path": {"demodulator_phase_rad": math.pi + _within(rng, math.radians(1.0))},
    }


@dataclass(frozen=True)
class Station:
    """A bench: its file without the simulation, the specimens on it, and the gyroscope."""

    file: Mapping[str, Any]
    specimens: Mapping[str, Line]
    numbers: Mapping[str, str]
    """Inventory number of each instrument."""
    table: Mapping[str, Any]
    gyroscope: Overrides

    def text(self) -> str:
        """Return the bench file."""
        bench = deepcopy(dict(self.file))
        roles = [role for role in self.specimens if role in bench]
        for role in roles:
            bench[role]["inventory_number"] = self.numbers[role]
        errors = {role: self.specimens[role] for role in roles}
        bench["simulation"] = {
            "parameters": "paper",
            "errors": errors,
            "override": merged(self.gyroscope, {"table": self.table}),
        }
        return "".join(toml_lines(bench))


def toml_lines(table: Mapping[str, Any], path: str = "") -> Iterable[str]:
    """Yield the lines of a table: its values first, then the tables in it."""
    below = {name: value for name, value in table.items() if isinstance(value, dict)}
    yield f"[{path}]\n" if path else ""
    yield from (f"{name} = {_value(value)}\n" for name, value in table.items() if name not in below)
    for name, value in below.items():
        yield from toml_lines(value, f"{path}.{name}" if path else name)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {_value(each)}" for name, each in value.items()) + " }"
    return json.dumps(value) if isinstance(value, str | bool) else repr(value)


def laboratory_file(seed: int, *, drawn: bool) -> tuple[Line, Overrides]:
    """Return the file of the bench with a table and a meter on V_Vc, and the gyroscope on it."""
    if not drawn:
        shipped_file = Path(str(vcfbench.__path__[0])) / "station" / "lab.toml"
        return tomllib.loads(shipped_file.read_text(encoding="utf-8")), {}
    file = tomllib.loads(gyroscopes.drawn_bench(seed))
    gyroscope = file.pop("simulation")["override"]
    del gyroscope["table"]
    return file, gyroscope


def field_file(laboratory: Mapping[str, Any], *, with_oscilloscope: bool) -> Line:
    """Return the file of a laboratory's bench without its table, its chamber and its second generator."""
    bench = deepcopy(dict(laboratory))
    without = ["rate_table", "chamber", "vibration_source", *([] if with_oscilloscope else ["oscilloscope"])]
    for name in without:
        del bench[name]
    for name in list(bench["limits"]):
        if any(word in name for word in ("rate_", "acceleration", "temperature", "ramp")):
            del bench["limits"][name]
    for name in ("carrier_phase_deg", "demodulator_phase_deg"):  # those of the laboratory hold on that day
        bench["uncertainty"].pop(name, None)
    bench["name"], bench["title"] = "field", "without a table"
    return bench


# The life of a gyroscope


@dataclass(frozen=True)
class How:
    """What is asked for of the study."""

    drawn: bool
    """Whether each seed has a gyroscope of its own."""
    with_oscilloscope: bool
    sets: Mapping[str, Any]
    """Settings of the self-calibration."""
    not_measured_ppm: float | None = None
    """What the file in the field says of what may have become of K_Vc unmeasured; None: nothing."""


@dataclass(frozen=True)
class Life:
    """One gyroscope: where its device store and its records are, its laboratory, and the names of its parameters."""

    where: Path
    seed: int
    how: How
    lab: Station
    named: Overrides


def rng_of(seed: int, *what: int) -> np.random.Generator:
    return np.random.default_rng([STREAM, seed, *what])


def specimens_of(seed: int, place: int) -> tuple[dict[str, Line], dict[str, str]]:
    """Return the instruments of the laboratory (0) or of elsewhere (1) with their inventory numbers."""
    drawn = {role: draw(rng_of(seed, 1 + place, at)) for at, (role, draw) in enumerate(SPECIMENS.items())}
    return drawn, {role: f"{role}-{seed}-{place}" for role in drawn}


def laboratory(seed: int, how: How, named: Overrides) -> Station:
    """Return the laboratory of a seed: its table within 10 ppm, ripple of any phase."""
    specimens, numbers = specimens_of(seed, 0)
    rng = rng_of(seed, 9)
    phases = [_within(rng, math.pi) for _ in named["table"]["ripple_phase_rad"]]
    table = {"rate_error": _within(rng, 1e-5), "ripple_phase_rad": phases}
    file, gyroscope = laboratory_file(seed, drawn=how.drawn)
    return Station(file, specimens, numbers, table, gyroscope)


def unseen_drift(seed: int) -> tuple[float, float, float]:
    """Return how fast K_Vc may drift unseen, ppm a year, days since the certificate, and what it drifted, relative."""
    rng = rng_of(seed, 22)
    ppm_per_year, days = 10.0 ** rng.uniform(1.5, 3.5), rng.uniform(0.0, 360.0)
    return ppm_per_year, days, _within(rng, 1e-6 * ppm_per_year * days / 365.25)


def in_the_field(life: Life, cause: Cause) -> tuple[Station, float]:
    """Return the bench in the field with the aged gyroscope, and the days since the certificate."""
    seed, how, lab, named = life.seed, life.how, life.lab, life.named
    others, numbers = specimens_of(seed, 1)
    old = merged(named, lab.gyroscope)
    gyroscope = deepcopy(lab.gyroscope)
    for age in cause.ages:
        changed = age(rng_of(seed, 20, *age.__name__.encode()), merged(old, gyroscope))
        gyroscope = merged(gyroscope, json.loads(json.dumps(changed)))
    rng = rng_of(seed, 21)
    if any(cause.apart_k):
        room_c = old["thermal"]["ambient_c"] + float(rng.uniform(*cause.apart_k) * rng.choice([-1.0, 1.0]))
        gyroscope = merged(gyroscope, {"thermal": {"ambient_c": room_c}})
    file, days = field_file(lab.file, with_oscilloscope=how.with_oscilloscope), 0.0
    if how.not_measured_ppm is not None:
        file["uncertainty"]["k_vc_not_measured_ppm"] = how.not_measured_ppm
    if cause.unseen:
        file["uncertainty"]["k_vc_drift_ppm_per_year"], days, drifted = unseen_drift(seed)
        for drift in cause.unseen:
            gyroscope = merged(gyroscope, drift(drifted, merged(old, gyroscope)))
    specimens = {role: others[role] if role in cause.other else each for role, each in lab.specimens.items()}
    if cause.probe:
        gains = [
            float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-3.7, -2.0)),
            *specimens["oscilloscope"]["gain_error"][1:],
        ]
        gains[0] += specimens["oscilloscope"]["gain_error"][0]
        specimens["oscilloscope"] = {**specimens["oscilloscope"], "gain_error": gains}
    for role, each in specimens.items():  # the same instrument does not make the same noise again
        if "noise_seed" in each:
            specimens[role] = {**each, "noise_seed": int(rng.integers(1 << 31))}
    station = Station(
        file,
        specimens,
        {role: numbers[role] if role in cause.other else each for role, each in lab.numbers.items()},
        {},
        gyroscope,
    )
    return station, days


def truth_of(station: Station, named: Overrides) -> Gyroscope:
    """Return the gyroscope of a station on the rails that its supply makes."""
    set_v = station.file.get("procedure", {}).get("positive_rail_v", 10.0)
    return Gyroscope(merged(named, station.gyroscope), weaker_rail_v(station.specimens["power"], set_v))


def stated_c(station: Station, named: Overrides) -> float:
    """Return the temperature that is told to the program: that of the gyroscope."""
    thermal = merged(named, station.gyroscope)["thermal"]
    return float(thermal["ambient_c"] + thermal["self_heating_k"])


def calibrated(life: Life) -> Line:
    """Calibrate on the table; return what was found."""
    lab, named, where = life.lab, life.named, life.where
    file, store = where / "lab.toml", where / "devices"
    file.write_text(lab.text(), encoding="utf-8")
    settings = {"dut": "G", "devices": str(store), "warm_up_s": WARM_UP_S, "temperature_c": stated_c(lab, named)}
    found = vcfbench.run("kvc", file, seed=life.seed * 100 + 1, settings=settings, runs=where).results
    true = truth_of(lab, named)
    return {
        "k_vc": _z(found.k_vc, true.k_vc),
        "table": _z(found.scale_factor, true.scale_factor),
        "bias": _z(found.bias, true.output_v(0.0)),
    }


def _earlier(store: Path, days: float) -> None:
    """Make the entries of a device so many days older."""
    for file in store.glob("*/*.json"):
        entry = json.loads(file.read_text(encoding="utf-8"))
        for key in ("issued", "valid_until", "done"):
            if entry.get(key):
                entry[key] = (datetime.fromisoformat(entry[key]) - timedelta(days=days)).isoformat()
        file.write_text(json.dumps(entry), encoding="utf-8")


def self_calibrated(life: Life, name: str) -> Line:
    """Age the gyroscope by a cause, self-calibrate, and return what was stated beside what is true."""
    seed, where, lab, named = life.seed, life.where, life.lab, life.named
    cause, number = CAUSES[name], list(CAUSES).index(name)
    station, days = in_the_field(life, cause)
    true, before = truth_of(station, named), truth_of(lab, named)
    line: Line = {"seed": seed, "cause": name, "days": days, "k_vc_ppm": 1e6 * (true.k_vc / before.k_vc - 1.0)}
    with tempfile.TemporaryDirectory(dir=where) as own:
        store, file = Path(own) / "devices", Path(own) / "field.toml"
        shutil.copytree(where / "devices", store)
        _earlier(store, days)
        file.write_text(station.text(), encoding="utf-8")
        settings: Line = {"dut": "G", "devices": str(store), "warm_up_s": WARM_UP_S}
        settings |= {"temperature_c": stated_c(station, named), **life.how.sets}
        try:
            found = vcfbench.run(
                "self-calibration", file, seed=seed * 100 + 2 + number, settings=settings, runs=own
            ).results
        except Aborted:  # somebody stopped the study: no line of it
            raise
        except BenchError as error:
            return line | {"refused": f"{type(error).__name__}: {error}"[:300]}
    zero_v = _zero_v(station.specimens["rate_source"]) - _zero_v(lab.specimens["rate_source"])
    return line | stated(found, true, before, true.k_vc * zero_v)


def _zero_v(generator: Line) -> float:
    """Return what a generator gives where 0 V are set, V."""
    return float(generator["ranges"][0]["offset_error_v"])


def stated(found: Any, true: Gyroscope, before: Gyroscope, zero_deg_s: float) -> Line:
    """Return z of every value that a self-calibration states.

    Levels are rates from the zero of their generator, which is `zero_deg_s` from that of the laboratory's.
    """
    if not hasattr(found, "scale_factor"):
        return {"refused": found.refusal()}
    rates = [zero_deg_s, *(zero_deg_s + level.rate_deg_s for level in found.levels)]
    line: Line = {
        "refused": None,
        "missing": list(found.scale_factor.missing),
        "verdict": None if found.drift is None else found.drift.verdict,
    }
    values = {
        "scale_factor": (found.scale_factor, true.scale_factor),
        "line": (found.line, true.line_slope(rates)),
        "bias": (found.bias, true.output_v(0.0)),
        "drift": (found.drift and found.drift.change_ppm, 1e6 * (true.scale_factor / before.scale_factor - 1.0)),
    }
    return line | {name: _z(*value) for name, value in values.items() if value[0] is not None}


def _z(found: Any, true: float) -> Line:
    size = 1e6 if found.unit == "ppm" else abs(true)
    return {
        "error_ppm": 1e6 * (found.value - true) / size,
        "u_ppm": 1e6 * found.u / size,
        "z": (found.value - true) / found.u,
        "within_95": abs(found.value - true) <= found.u95,
    }


def study(seeds: Sequence[int], causes: Sequence[str], how: How, file: Path | None) -> list[Line]:
    """Run what does not stand in `file` yet, and return all lines of these seeds and causes."""
    had = {(line["seed"], line["cause"]): line for line in lines_of([file] if file and file.exists() else [])}
    named = shipped("lab")

    def keep(line: Line) -> None:
        had[line["seed"], line["cause"]] = line
        if file is not None:
            with file.open("a", encoding="utf-8") as out:
                print(json.dumps(line), file=out)

    for seed in seeds:
        missing = [name for name in causes if (seed, name) not in had]
        if not missing:
            continue
        lab = laboratory(seed, how, named)
        with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as directory:
            life = Life(Path(directory), seed, how, lab, named)
            on_table = calibrated(life)
            if (seed, ON_TABLE) not in had:
                keep({"seed": seed, "cause": ON_TABLE, "refused": None, **on_table})
            for name in missing:
                keep(self_calibrated(life, name))
    return [had[seed, name] for seed in seeds for name in (ON_TABLE, *causes)]


def lines_of(files: Iterable[Path]) -> list[Line]:
    """Return the lines of some files; one that was cut off at the end of a file is left out."""
    texts = [text for file in files for text in file.read_text(encoding="utf-8").splitlines(keepends=True)]
    return [json.loads(text) for text in texts if text.endswith("\n")]


def summary(lines: Sequence[Line]) -> tuple[list[str], bool]:
    """Return the table of the study, a row for each value of each cause, and whether there is nothing to be mended."""
    rows = [
        (
            f"{'cause':22} {'value':13} {'n':>4} {'refused':>7} {'mean z':>7} {'sd z':>6} {'in U95':>7}"
            f" {'error, ppm rms':>15} {'u, ppm rms':>11} {'dK_Vc':>7}"
        )
    ]
    good = all(line["refused"] is not None for line in lines if line["cause"] in BEYOND)
    for cause in dict.fromkeys((ON_TABLE, *CAUSES)):
        of_cause = [line for line in lines if line["cause"] == cause]
        refused = sum(line["refused"] is not None for line in of_cause)
        moved = _rms([line.get("k_vc_ppm", 0.0) for line in of_cause])
        for name in dict.fromkeys(key for line in of_cause for key, value in line.items() if _is_value(value)):
            stated = [line[name] for line in of_cause if name in line]
            z, within = np.array([each["z"] for each in stated]), [each["within_95"] for each in stated]
            errors, u = _rms([each["error_ppm"] for each in stated]), _rms([each["u_ppm"] for each in stated])
            beyond, share = outside(within, z.tolist()), 100.0 * float(np.mean(within))
            good = good and not beyond
            rows.append(
                f"{cause:22} {name:13} {len(stated):4} {refused:7} {z.mean():+7.2f} {z.std():6.2f} {share:6.1f}%"
                f" {errors:15.1f} {u:11.1f} {moved:7.0f}{f'  * {beyond}' if beyond else ''}"
            )
        if of_cause and refused == len(of_cause):
            rows.append(f"{cause:22} {'-':13} {0:4} {refused:7}")
    for what, causes in (("could be corrected", set(CAUSES) - set(BEYOND)), ("cannot be corrected", set(BEYOND))):
        ended = [line["refused"] is not None for line in lines if line["cause"] in causes]
        rows += [f"of {len(ended)} that {what} {100 * np.mean(ended):.1f} % were refused"] if ended else []
    return rows, good


def _is_value(value: Any) -> bool:
    return isinstance(value, dict) and "z" in value


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(math.fsum(each * each for each in values) / len(values)) if values else math.nan


def check(count: int) -> None:
    """Print how far the closed form is from the integration, and the simulation without noise from the closed form."""
    named = shipped("lab")
    print("largest difference of the filtered volts, closed form and integration (matrix exponential, Runge-Kutta)")
    for seed in range(count):
        rng = rng_of(seed, 99)
        drawn = merged(
            named,
            near_the_papers(rng, named) if seed else {},
            {
                "sense_path": {"carrier_feedthrough": _within(rng, 1e-4), "v_vc_feedthrough": _within(rng, 1e-3)},
                "table": {"misalignment_deg": _within(rng, 2.0)},
                "thermal": {"ambient_c": 20.0 + _within(rng, 15.0)},
            },
        )
        gyroscope = Gyroscope(drawn, 10.0 + _within(rng, 0.1))
        driven = [(200.0, None), (-50.0, None), (0.0, None), (0.0, 0.0), (0.0, 1.3), (3.0, -0.07)]
        closed = [gyroscope.filtered_v(*each) for each in driven]
        ways = zip(*(integrated_v(gyroscope, *each) for each in driven), strict=True)
        span = max(closed) - min(closed)
        apart = [max(abs(a - b) for a, b in zip(closed, way, strict=True)) / span for way in ways]
        print(f"  gyroscope {seed}: {apart[0]:.1e}, {apart[1]:.1e} of the span; K_Vc {gyroscope.k_vc:.4f} (deg/s)/V")
    print("simulated bench without noise and errors, found less closed form, ppm")
    for seed in range(min(count, 3)):
        print(f"  gyroscope {seed}: {_quiet(seed, named)}")


def _quiet(seed: int, named: Overrides) -> str:
    """Return how far the calibrations of a bench without noise and errors are from the truth."""
    quiet: Overrides = {
        "noise": {"angle_random_walk_deg_sqrt_s": 0.0, "bias_instability_deg_s": 0.0},
        "table": {"rate_error": 0.0, "flutter_per_sqrt_hz": 0.0, "ripple_arcsec": [], "ripple_harmonic": []},
        "pick_up": {"meter_leads_v": 0.0, "v_vc_lead_v": 0.0},
    }
    quiet["table"]["ripple_phase_rad"] = []
    how = How(drawn=seed > 0, with_oscilloscope=True, sets={})
    drawn = laboratory(seed, how, named)
    ideal: dict[str, Line] = {role: {} for role in SPECIMENS}
    ideal["rate_source"] = {"ranges": [{"upper_v": 10.0, "gain_error": 0.0, "offset_error_v": 0.0}]}
    ideal["power"] = {name: {"programming_gain": 0.0, "programming_offset_v": 0.0} for name in ("p25v", "n25v")}
    table = quiet.pop("table")
    lab = Station(drawn.file, ideal, drawn.numbers, table, merged(drawn.gyroscope, quiet))
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as directory:
        life = Life(Path(directory), seed, how, lab, named)
        found = calibrated(life)
        station, _ = in_the_field(life, Cause((leak, split, feedthrough)))
        moved = 1e6 * (truth_of(station, named).k_vc / truth_of(lab, named).k_vc - 1)
        return (
            f"K_Vc {found['k_vc']['error_ppm']:+.2f}, scale factor {found['table']['error_ppm']:+.2f}, "
            f"bias {found['bias']['error_ppm']:+.2f}; leak, split and feed-through move K_Vc by {moved:+.0f} ppm"
        )


def main() -> int:
    """Do what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:10", help="the first, and the one after the last")
    parser.add_argument("--cause", default=",".join(CAUSES), help=f"one or some, with commas: {', '.join(CAUSES)}")
    parser.add_argument(
        "--gyroscopes", choices=["drawn", "paper"], default="drawn", help="one of the kind each, or the paper's for all"
    )
    parser.add_argument("--no-oscilloscope", action="store_true", help="the bench in the field has none")
    parser.add_argument(
        "--not-measured", type=float, metavar="PPM", help="k_vc_not_measured_ppm of the bench in the field"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the self-calibration")
    parser.add_argument("--lines", type=Path, help="file that keeps a line for each seed and cause")
    parser.add_argument("--summary", type=Path, nargs="+", metavar="FILE", help="run nothing, sum up such files")
    parser.add_argument("--check", type=int, nargs="?", const=8, metavar="N", help="check the truth on N gyroscopes")
    asked = parser.parse_args()
    if asked.check:
        check(asked.check)
        return 0
    if asked.summary:
        rows, good = summary(lines_of(asked.summary))
        print("\n".join(rows))
        return int(not good)
    first, last = map(int, asked.seeds.split(":"))
    sets = {
        name: tomllib.loads(f"value = {value}")["value"] for name, value in (each.split("=", 1) for each in asked.set)
    }
    how = How(asked.gyroscopes == "drawn", not asked.no_oscilloscope, sets, asked.not_measured)
    rows, good = summary(study(range(first, last), asked.cause.split(","), how, asked.lines))
    print("\n".join(rows))
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
