"""The bench file of a simulated bench with a custom gyroscope, from the figures of its data sheet."""

import math
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from msgspec import structs, to_builtins
from simrack.stream import VOLTS_PER_DEG_S

from vcfbench.errors import ConfigError
from vcfbench.models import ROLES
from vcfbench.sim.gyro.data_sheet import (
    FLICKER_MINIMUM,
    LEAST_SINE_V,
    MOST_RANGE_DEG_S,
    DataSheet,
    change_per_k,
    in_phase_share,
    noise_bandwidth_hz,
    own_gyro,
    peak_response,
    settling_s,
    started_s,
)
from vcfbench.sim.parameters import BenchParameters
from vcfbench.sim.simulation import named_parameters
from vcfbench.station.consistency import LIMITS_OF
from vcfbench.station.description import Simulation, SimulationErrors
from vcfbench.station.file import EMBEDDED, parse_bench
from vcfbench.station.settings import PAPER_RATES_DEG_S
from vcfbench.station.writing import device_text, table_text, value_text

_HEAD = "# A simulated bench with a custom gyroscope, written by `vcfbench sim new` from these figures:"
_LATITUDE_DEG = 37.9
_HERE = Path()
_USUAL_RANGE_DEG_S, _USUAL_V, _USUAL_SPLIT_HZ = 200.0, 200.0 / 150.0, 24.8
"""Range, V_Vc for it, and split of the gyroscope for which the settings of procedures have their defaults."""
_AT_THE_PEAK = 0.6
"""Share of the range that a sine takes at the peak of the response: beyond, the output's curvature is in the gains."""
TABLE_RATE_ERROR = 1e-5
"""Class of a BD125, unverified."""
_LEAST_LEVEL_V, _LEAST_STEP_V = 0.07, 0.04
"""The least of a level whose offset of 4 mV does not tell, and of one taken with both signs."""
_MOST_V_VC_V = 10.0
_OFFSET_V = 0.06
"""V_Vc that an output at rest is off by as soon as V_Vc is on: the carrier comes through."""
_LEAST_DEG_H = 1e-3
_READING_S = 0.2
_SETTLED_READINGS = 4.0
"""Readings in the time that an output settles in, to e^-12: between two of them the noise of a mode falls to 5 %."""
_LONGEST_WINDOW_S = 60.0
_HIGHEST_HZ, _HIGHEST_IN_PAIRS_HZ = 79.0, 75.0
"""Sines on V_Vc that a meter samples, and that two sample in turn."""
_ROUGH_HZ = (0.3, 1.0, 2.0, 4.5, 6.5, 9.0, 12.0, 16.0, 20.0, 25.0, 31.0, 38.0, 48.0, 60.0)
"""Frequencies of `bandwidth` at the usual split."""
_VIBRATION_HZ = (0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 35.0)
_THRESHOLD_STEPS_DEG_S = (2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02)
_BY_ITSELF = frozenset(
    {"self-calibration", "repeatability", "rate-limits", "threshold", "online", "axes", "g-sensitivity"}
)
"""Procedures that are no part of `characterize`."""
NUMBERS_V_PER_DEG_S = VOLTS_PER_DEG_S
"""Scale factor of the voltage of which simulated streams are made, for numbers of 1 a deg/s or in LSB."""
LEFT_OUT = frozenset({*ROLES, "rate_table"} - {"multimeter"})
"""Roles that a bench can do without; without an output there is nothing to measure."""
_OF_VOLTS = frozenset(
    {
        "scale_factor_v_per_deg_s",
        "k_vc_deg_s_per_v",
        "rail_v",
        "rails",
        "k_vc_guess_deg_s_per_v",
        "meter_range_v",
        "drive",
    }
)
"""Figures and settings that a gyroscope with digital output has not."""


def own_gyro_bench(
    sheet: DataSheet,
    name: str,
    *,
    imperfections: bool = False,
    without: Collection[str] = (),
    stream: Mapping[str, Any] | None = None,
    lsb_per_deg_s: float | None = None,
    devices: int = 1,
    folder: Path = _HERE,
) -> str:
    """Return the bench file of a simulated bench with the gyroscope of `sheet`.

    Without `imperfections` gyroscope, PCB and instruments are perfect, but for noise and quadrature of the sheet; with
    them they are as imperfect as those of the paper. Roles in `without` are left out: without a supply the gyroscope
    feeds itself. One that speaks numbers has the table ``[gyro.stream]`` and stands on a table alone, where there may
    be several; the sheet is that of the voltage of which the numbers are made, `lsb_per_deg_s` of them in LSB. Its
    profile, if a file, is found from the `folder` of the bench file.

    Raises:
        ConfigError: it would be no bench, a role is none, or `name` is no name.
    """
    if name in EMBEDDED:
        raise ConfigError(f"--name {name}: a bench of that name comes with the package")
    latitude_deg = _LATITUDE_DEG if imperfections else 0.0
    simulation = Simulation(parameters="paper" if imperfections else "ideal")
    if unknown := sorted(set(without) - LEFT_OUT):
        raise ConfigError(f"--without {unknown[0]}: expected one of {', '.join(sorted(LEFT_OUT))}")
    without = {*without, *(ROLES if stream else ())}
    slope = sheet.scale_factor_v_per_deg_s
    station = _station(name, sheet, without)
    errors: dict[str, Any] = {} if imperfections else dict.fromkeys(SimulationErrors.__struct_fields__, "none")
    if stream:
        slope = lsb_per_deg_s or slope / NUMBERS_V_PER_DEG_S
    if lsb_per_deg_s:
        errors["multimeter"] = {"lsb_per_deg_s": lsb_per_deg_s, **({"drawn": 1.0} if imperfections else {})}
    own = own_gyro(sheet, imperfections=imperfections, latitude_deg=latitude_deg)
    tables = {
        **station,
        "site": {"latitude_deg": latitude_deg},
        **({"gyro": {"stream": stream}} if stream else {}),
        **({"gyro": {"null_v": sheet.rest_v}} if sheet.rest_v and "power" in without else {}),  # no rail tells it
        "procedure": {k: v for k, v in _shared(sheet, without).items() if not stream or k not in _OF_VOLTS}
        | ({} if stream else _procedures(sheet)),
        "expected": {"scale_factor_v_per_deg_s": sorted(_round(part * slope) for part in _expected_parts(sheet))},
        "uncertainty": _uncertainty(sheet, own),
        "simulation": {"parameters": simulation.parameters, "errors": errors},
    }
    figures = [
        f"# {key} = {'as the filter is' if value is None else value_text(value)}"
        for key, value in structs.asdict(sheet).items()
        if not (stream and key in _OF_VOLTS)
    ]
    overrides = _overrides(named_parameters(simulation), own)
    alone = range(1, devices + 1) if devices > 1 else ()
    lot = [device_text({"name": f"G-{number}", "resource": f"ASRL{8 + number}::INSTR"}) for number in alone]
    text = "\n".join((_HEAD, *figures, "", table_text(tables), *overrides, *lot, ""))
    parse_bench(text, str(folder / name))
    return text


def _expected_parts(sheet: DataSheet) -> tuple[float, float]:
    """Return within which parts of the scale factor that of the first match comes: 5 %, and six times its noise."""
    white_deg_s = sheet.angle_random_walk_deg_sqrt_h / 60.0  # two means of two seconds of readings
    apart = 0.05 + 6.0 * white_deg_s / _least_match_deg_s(sheet)
    return 1.0 - apart, 1.0 + apart


def _least_match_deg_s(sheet: DataSheet) -> float:
    """Return the smallest rate that V_Vc is matched with: 5 % of the range, by a level that stands above its offset."""
    return max(0.05 * sheet.range_deg_s, _LEAST_LEVEL_V * abs(sheet.k_vc_deg_s_per_v))


def _most_match_deg_s(sheet: DataSheet) -> float:
    """Return the largest rate that V_Vc is matched with: with its offset, its bend and 5 % too much no clipping."""
    free_v = sheet.swing_v / abs(sheet.scale_factor_v_per_deg_s)
    offset_deg_s = abs(sheet.bias_deg_s) + _OFFSET_V * abs(sheet.k_vc_deg_s_per_v)
    return min(sheet.range_deg_s, 0.9 * free_v - offset_deg_s)


def _station(name: str, sheet: DataSheet, without: Collection[str]) -> dict[str, Any]:
    """Return the instruments of the bench `lab`, with limits for range and rails of the gyroscope."""
    station: dict[str, Any] = {
        "name": name,
        "title": f"{name}: a custom simulated gyroscope",
        "power": {"model": "E3631A", "resource": "GPIB0::5::INSTR"},
        "rate_source": {"model": "33220A", "resource": "USB0::0x0957::0x0407::MY44021876::INSTR"},
        "multimeter": {"model": "34401A", "resource": "GPIB0::22::INSTR"},
        "v_vc_meter": {"model": "34401A", "resource": "GPIB0::23::INSTR"},
        "vibration_source": {"model": "33220A", "resource": "USB0::0x0957::0x0407::MY44021877::INSTR"},
        "oscilloscope": {"model": "DSO7104B", "resource": "USB0::0x0957::0x175D::MY49520121::INSTR"},
        "rate_table": {"dialect": "acl", "resource": f"sim://{name}"},
        "chamber": {"model": "ATS-545", "resource": "GPIB0::18::INSTR"},
        "limits": {
            "max_rate_deg_s": min(1.5 * sheet.range_deg_s, MOST_RANGE_DEG_S),
            "max_acceleration_deg_s2": max(200.0, sheet.range_deg_s),
            "max_v_vc_v": _MOST_V_VC_V,
            "min_rail_v": _round(0.95 * sheet.rail_v),
            "max_rail_v": _round(1.05 * sheet.rail_v),
            "max_rail_current_a": 0.2,
            "min_temperature_c": -40.0,
            "max_temperature_c": 85.0,
            "max_ramp_k_min": 60.0,
        },
        **({"wiring": {"rails": {"negative": "none"}}} if sheet.rest_v and "power" not in without else {}),
    }
    kept = {key for role in {*ROLES, "rate_table"} - {*without} for key in LIMITS_OF.get(role, ())}
    station["limits"] = {key: value for key, value in station["limits"].items() if key in kept}
    return {key: value for key, value in station.items() if key not in without}


def _shared(sheet: DataSheet, without: Collection[str]) -> dict[str, Any]:
    """Return the settings of all procedures: rails, rates, times, the drive signal."""
    wider = sheet.range_deg_s / _USUAL_RANGE_DEG_S
    negative = {} if sheet.rest_v else {"negative_rail_v": -sheet.rail_v}
    return {
        **({} if "power" in without else {"positive_rail_v": sheet.rail_v, **negative}),
        "rates_deg_s": [_round(rate * wider) for rate in PAPER_RATES_DEG_S],
        "acceleration_deg_s2": max(100.0, _round(100.0 * wider)),
        "k_vc_guess_deg_s_per_v": sheet.k_vc_deg_s_per_v,
        "settle_s": _round(max(2.0, settling_s(sheet)[1])),
        "sample_interval_s": _interval_s(sheet),
        "meter_range_v": 100 if sheet.rest_v + sheet.swing_v > 11.5 else 10,  # a 34401A goes a fifth beyond its range
        "drive": {
            "frequency_hz": [_round(0.996 * sheet.drive_hz), _round(1.004 * sheet.drive_hz)],
            "amplitude_v": [0.8, 1.2],
            "phase_deg": [80.0, 100.0],
            "start_up_s": _round(max(5.0, started_s(sheet))),  # `warmup` takes its first window then
        },
    }


def _procedures(sheet: DataSheet) -> dict[str, Any]:
    """Return the settings of each procedure that follow from the gyroscope."""
    own = {**_of_levels(sheet), **_of_modes(sheet)}
    parts = {  # warm from the first one on
        part: {key: value for key, value in given.items() if key != "warm_up_s"}
        for part, given in own.items()
        if part not in _BY_ITSELF
    }
    return {**own, "characterize": parts}


def _of_levels(sheet: DataSheet) -> dict[str, dict[str, Any]]:
    """Return those that follow from range, K_Vc, noise and the start of the drive loop."""
    wider = sheet.range_deg_s / _USUAL_RANGE_DEG_S
    instability_deg_h = max(_LEAST_DEG_H, _flicker_deg_h(sheet))
    least_deg_s, most_deg_s = _least_match_deg_s(sheet), _most_match_deg_s(sheet)
    level = {"level_deg_s": _round(most_deg_s)}
    steps = [(most_deg_s / least_deg_s) ** (0.25 * place) for place in range(5)]
    matched = {"match_rates_deg_s": [_round(least_deg_s * step) for step in steps]}
    loop_s = _round(max(5.0, settling_s(sheet)[0]))
    started = {"warm_up_s": loop_s}
    return {
        "turntable": started,
        "virtual-coriolis": {"match_rate_deg_s": _round(least_deg_s), **matched, **started},
        "kvc": {**matched, **started},
        "self-calibration": {**started, "virtual_rates_deg_s": matched["match_rates_deg_s"]},
        "zero": {**_whole_readings(sheet), **_noise_bandwidth(sheet)},
        "warmup": {"turn_on_tolerance_deg_s": _round(wider), "bias_instability_deg_h": instability_deg_h},
        "power": {**level, "valid_tolerance_deg_s": _round(wider), "rail_step_v": _round(0.02 * sheet.rail_v)},
        "repeatability": {**level, "settle_s": _round(started_s(sheet))},
        "rate-limits": {"level_deg_s": _round(50.0 * wider), "resolution_deg_s": _round(max(0.05, 0.5 * wider))},
        "polarity": {
            **started,
            "polarity_rate_deg_s": _round(10.0 * wider),
            "polarity_v_vc_v": _both_signs_v(sheet, 0.1),
        },
        "threshold": {
            **started,
            "steps_deg_s": [_round(each * wider) for each in _THRESHOLD_STEPS_DEG_S],
            "at_rate_deg_s": _round(10.0 * wider),
        },
        "temperature": {**level, "bias_instability_deg_h": instability_deg_h},
        "g-sensitivity": {"samples": math.floor(_LONGEST_WINDOW_S / _interval_s(sheet))},
    }


def _interval_s(sheet: DataSheet) -> float:
    return _round(max(1.0, settling_s(sheet)[1] / _SETTLED_READINGS))


def _whole_readings(sheet: DataSheet) -> dict[str, float]:
    """Return an interval of whole readings, which a record without gaps asks for, where the usual one is none."""
    interval_s = _interval_s(sheet)
    whole_s = _round(_READING_S * math.ceil(interval_s / _READING_S - 1e-9))
    return {} if whole_s == interval_s else {"sample_interval_s": whole_s}


def _of_modes(sheet: DataSheet) -> dict[str, dict[str, Any]]:
    """Return the figures that follow from the modes: frequencies, and amplitudes of their responses."""
    finer, usual_v = abs(sheet.split_hz) / _USUAL_SPLIT_HZ, sheet.range_deg_s / abs(sheet.k_vc_deg_s_per_v) / _USUAL_V
    peak_v = _AT_THE_PEAK * _USUAL_V * usual_v / max(1.0, peak_response(sheet))
    filters = {"in_phase_split_hz": _round(sheet.in_phase_split_hz), "low_pass_hz": _round(sheet.low_pass_hz)}
    modes = {"split_hz": _round(abs(sheet.split_hz)), "in_phase_share": _round(in_phase_share(sheet))}
    sines = {
        "sine_amplitude_v": _round(max(LEAST_SINE_V, peak_v)),
        "split_guess_hz": _round(min(abs(sheet.split_hz), _HIGHEST_HZ)),
        "frequencies_hz": [
            min(_round(each * finer), _HIGHEST_HZ)  # that near the split too, or the last one is far below the peak
            for each in _ROUGH_HZ
            if 0.05 <= each * finer < 1.03 * _HIGHEST_HZ
        ],
        **filters,
    }
    return {
        "bandwidth": sines,
        "resonance": {**sines, "ring_down_v_vc_v": _round(0.7 * usual_v)},
        "phase": {
            "rate_deg_s": _round(0.5 * sheet.range_deg_s),
            "v_vc_v": _round(0.7 * usual_v),
            "sine_amplitude_v": _round(1.4 * usual_v),
            "difference_hz": _round(max(0.5, min(8.0 * finer, 0.5 * sheet.low_pass_hz))),
        },
        "vibration": {
            "vibration_hz": [
                _round(each * finer) for each in _VIBRATION_HZ if 0.3 <= each * finer <= _HIGHEST_IN_PAIRS_HZ
            ],
            "vibration_amplitude_v": _both_signs_v(sheet, 0.04),
            "static_v_vc_v": _both_signs_v(sheet, 0.05),
            "q": sheet.q_sense,
            **modes,
            "split_hz": _round(sheet.split_hz),
            **filters,
        },
        "online": {
            "virtual_rate_deg_s": _round(0.25 * sheet.range_deg_s),
            "in_phase_split_hz": filters["in_phase_split_hz"],
            **modes,
        },
    }


def _both_signs_v(sheet: DataSheet, usual_v: float) -> float:
    """Return `usual_v` scaled to this gyroscope's range of V_Vc; not less than can be seen."""
    return _round(max(_LEAST_STEP_V, usual_v * sheet.range_deg_s / abs(sheet.k_vc_deg_s_per_v) / _USUAL_V))


def _noise_bandwidth(sheet: DataSheet) -> dict[str, float]:
    """Return that of a reading, known as for a Q within 10 %; none where a narrow filter takes part of it."""
    found_hz = noise_bandwidth_hz(sheet, _READING_S)
    if found_hz < 0.5 / _READING_S:
        return {}
    return {"noise_bandwidth_hz": _round(found_hz), "u_noise_bandwidth_hz": _round(0.015 * found_hz)}


def _flicker_deg_h(sheet: DataSheet) -> float:
    """Return the coefficient B of the flicker noise; so little that nobody measures it is none."""
    found = _round(sheet.bias_instability_deg_h / FLICKER_MINIMUM)
    return found if found >= _LEAST_DEG_H else 0.0


def _uncertainty(sheet: DataSheet, own: BenchParameters) -> dict[str, Any]:
    """Return the ``[uncertainty]`` of a simulated bench, as of the bench `paper`; values are those of the run."""
    relative, leak_deg_s = change_per_k(own)
    return {
        "table_rate_error": TABLE_RATE_ERROR if own.table.rate_error else 0.0,
        "bias_instability_deg_h": _flicker_deg_h(sheet),
        "scale_factor_ppm_k": _round(1e6 * abs(relative)),
        "bias_deg_h_k": _round(1.2 * 3600.0 * abs(own.thermal.bias_coefficient_deg_s_k + leak_deg_s)),
        "warm_up_k": own.thermal.self_heating_k,
        "warm_up_time_s": own.thermal.time_constant_s,
        "temperature_k": 0.0,
        "carrier_phase_deg": 0.0,
        "demodulator_phase_deg": 0.0,
        "misalignment_deg": 0.0,
        "output_ohm": own.source.output_ohm,
        "k_vc_on_the_way_ppm": 0.0,
    }


def _round(value: float) -> float:
    return float(f"{value:.6g}")


def _overrides(shipped: BenchParameters, own: BenchParameters) -> Iterator[str]:
    """Yield the parameters that are not those of the shipped set, with unit and meaning."""
    before: Mapping[str, Mapping[str, Any]] = to_builtins(shipped)
    for group, values in to_builtins(own).items():
        quantities = type(getattr(own, group)).quantities()
        changed = {key: value for key, value in values.items() if value != before[group][key] and group != "site"}
        if changed:
            yield f"\n[simulation.override.{group}]"
        for key, value in changed.items():
            unit = "" if quantities[key].unit == "1" else f"{quantities[key].unit}: "
            yield f"{key} = {value_text(value):<24}# {unit}{quantities[key].meaning}"
