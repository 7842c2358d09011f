"""The bench file of a simulated bench with a gyroscope of one's own, from the figures of its data sheet."""

from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import structs, to_builtins

from vcfbench.errors import ConfigError
from vcfbench.sim.gyro.data_sheet import DataSheet, own_gyro, peak_response, settling_s
from vcfbench.sim.parameters import BenchParameters
from vcfbench.sim.simulation import named_parameters
from vcfbench.station.description import Simulation
from vcfbench.station.file import EMBEDDED, parse_bench
from vcfbench.station.settings import PAPER_RATES_DEG_S
from vcfbench.station.writing import table_text, value_text

_HEAD = "# A simulated bench with a gyroscope of one's own, written by `vcfbench sim new` from these figures:"
_LATITUDE_DEG = 37.9
_USUAL_SPLIT_HZ = 24.8
_AT_THE_PEAK_V = 5.0
_TABLE_DEG_S = 900.0
"""The simulated table turns at 1000 deg/s, its own trip above the limit included."""
_ROUGH_HZ = (0.3, 1.0, 2.0, 4.5, 6.5, 9.0, 12.0, 16.0, 20.0, 25.0, 31.0, 38.0, 48.0, 60.0)
"""Frequencies of `bandwidth` at the paper's split."""


def own_gyro_bench(sheet: DataSheet, name: str, *, imperfections: bool = False) -> str:
    """Return the bench file of a simulated bench with the gyroscope of `sheet`.

    Without `imperfections` gyroscope, PCB and instruments are perfect, but for the noise of the sheet; with them they
    are as imperfect as those of the paper.

    Raises:
        ConfigError: it would be no bench, or `name` is no name.
    """
    if name in EMBEDDED:
        raise ConfigError(f"--name {name}: a bench of that name comes with the package")
    latitude_deg = _LATITUDE_DEG if imperfections else 0.0
    simulation = Simulation(parameters="paper" if imperfections else "ideal")
    slope = sheet.scale_factor_v_per_deg_s
    roles = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table")
    errors = {} if imperfections else dict.fromkeys((*roles, "vibration_source", "v_vc_meter", "chamber"), "none")
    own = own_gyro(sheet, imperfections=imperfections, latitude_deg=latitude_deg)
    tables = {
        **_station(name, sheet),
        "site": {"latitude_deg": latitude_deg},
        "procedure": _procedure(sheet),
        "expected": {"scale_factor_v_per_deg_s": sorted(_round(part * slope) for part in (0.95, 1.05))},
        "simulation": {"parameters": simulation.parameters, "errors": errors},
    }
    figures = [
        f"# {key} = {'as the filter is' if value is None else value_text(value)}"
        for key, value in structs.asdict(sheet).items()
    ]
    overrides = _overrides(named_parameters(simulation), own)
    text = "\n".join((_HEAD, *figures, "", table_text(tables), *overrides, ""))
    parse_bench(text, name)
    return text


def _station(name: str, sheet: DataSheet) -> dict[str, Any]:
    """Return the instruments of the paper's rack, with limits for the range of the gyroscope."""
    wider = sheet.range_deg_s / 200.0
    return {
        "name": name,
        "title": f"{name}: a simulated gyroscope of its own",
        "power": {"model": "E3631A", "resource": "GPIB0::5::INSTR"},
        "rate_source": {"model": "33220A", "resource": "USB0::0x0957::0x0407::MY44021876::INSTR"},
        "multimeter": {"model": "34401A", "resource": "GPIB0::22::INSTR"},
        "oscilloscope": {"model": "DSO7104B", "resource": "USB0::0x0957::0x175D::MY49520121::INSTR"},
        "rate_table": {"dialect": "acl", "resource": f"sim://{name}"},
        "limits": {
            "max_rate_deg_s": min(1.5 * sheet.range_deg_s, _TABLE_DEG_S),
            "max_acceleration_deg_s2": max(200.0, 200.0 * wider),
            "max_v_vc_v": 10.0,
            "min_rail_v": 9.5,
            "max_rail_v": 10.5,
            "max_rail_current_a": 0.2,
        },
    }


def _procedure(sheet: DataSheet) -> dict[str, Any]:
    """Return settings with which this gyroscope can be measured: rates, drive signal, times, frequencies."""
    wider, finer = sheet.range_deg_s / 200.0, abs(sheet.split_hz) / _USUAL_SPLIT_HZ
    drive_s, sense_s = settling_s(sheet)
    # A sine on V_Vc that drives the output well, and at the peak of the response not against its rail
    slope_v_per_v = abs(sheet.scale_factor_v_per_deg_s) * sheet.k_vc_deg_s_per_v
    sine_v = min(10.0, max(0.01, _AT_THE_PEAK_V / (slope_v_per_v * max(1.0, peak_response(sheet)))))
    rates = [_round(rate * wider) for rate in PAPER_RATES_DEG_S]
    match = min(10.0 * wider, 5.0 * sheet.k_vc_deg_s_per_v)
    return {
        "rates_deg_s": rates,
        "acceleration_deg_s2": max(100.0, 100.0 * wider),
        "k_vc_guess_deg_s_per_v": sheet.k_vc_deg_s_per_v,
        "settle_s": _round(max(2.0, sense_s)),
        "drive": {
            "frequency_hz": [_round(0.996 * sheet.drive_hz), _round(1.004 * sheet.drive_hz)],
            "amplitude_v": [0.8, 1.2],
            "phase_deg": [80.0, 100.0],
            "start_up_s": _round(min(600.0, max(5.0, drive_s))),
        },
        "virtual-coriolis": {
            "match_rate_deg_s": _round(match),
            "match_rates_deg_s": [_round(rate * wider) for rate in (10.0, 20.0, 50.0, 100.0, 200.0)],
        },
        "bandwidth": {
            "sine_amplitude_v": _round(sine_v),
            "split_guess_hz": _round(abs(sheet.split_hz)),
            "frequencies_hz": [_round(each * finer) for each in _ROUGH_HZ if each * finer <= 75.0],
            "in_phase_split_hz": _round(sheet.in_phase_split_hz),
            "low_pass_hz": _round(sheet.low_pass_hz),
        },
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
