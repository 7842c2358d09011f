"""Benches of two gyroscopes without noise, and what a small change of one of their instruments does to a run's values.

A budget says by how much a source moves a value. Here the source is moved, in the simulated instrument, and the run is
done again: the difference of the values over the step is the sensitivity that the budget must have.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from msgspec import structs, to_builtins

import vcfbench
from vcfbench.sim.gyro.design import PAPER_TARGETS, design, imperfect, paper_bench
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.parameters import BenchParameters
from vcfbench.uncertainty.statement import StatedValue
from vcfbench.values.value import Measurand

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from vcfbench.station.description import BenchDescription


class Change(NamedTuple):
    """A small change of a simulated bench: `step` units of a source, in an instrument, a parameter, or a setting."""

    step: float
    instruments: Mapping[str, Any] = MappingProxyType({})
    """By role, the errors that there are instead of none."""
    parameters: Callable[[BenchParameters], BenchParameters] = lambda parameters: parameters
    settings: Mapping[str, float] = MappingProxyType({})
    """What is added to settings of the procedure."""


def _other() -> BenchParameters:
    """Return a gyroscope that is not the paper's: K_Vc and quadrature negative, the sense mode above the drive."""
    base = imperfect()
    above = structs.replace(
        base.sense_anti_phase,
        frequency_hz=base.drive_mode.frequency_hz + 18.0,
        quality=900.0,
        quadrature_rad_s=-math.radians(30.0),
    )
    straighter = structs.replace(base.virtual_path, second_order_per_v=4e-3, third_order_per_v2=-5e-3)
    in_phase = structs.replace(base.sense_in_phase, quality=above.quality)
    targets = structs.replace(
        PAPER_TARGETS,
        bias_v=0.03,
        scale_factor_v_s_deg=8e-3,
        second_order=2e-8,
        third_order=-1e-10,
        virtual_scale_deg_s_v=-110.0,
        switch_on_shift_v=-20e-3,
    )
    return design(
        structs.replace(base, sense_in_phase=in_phase, sense_anti_phase=above, virtual_path=straighter), targets
    )


GYROSCOPES = {"paper's": (paper_bench(), 150.0), "other": (_other(), -110.0)}
"""Parameters of gyroscope, PCB and table, and a guess of K_Vc, (deg/s)/V."""

_SILENT: dict[str, Any] = {"gain_error": 0.0, "offset_v": 0.0, "noise": 0.0}
_PERFECT: dict[str, Any] = {
    role: {} for role in ("power", "rate_source", "oscilloscope", "vibration_source", "chamber")
}
_PERFECT |= {"multimeter": _SILENT, "v_vc_meter": _SILENT}


def quiet(parameters: BenchParameters) -> BenchParameters:
    """Return the parameters without noise, pick-up, ripple, Earth's rate and self-heating."""
    replace = structs.replace
    return replace(
        parameters,
        noise=replace(parameters.noise, angle_random_walk_deg_sqrt_s=0.0, bias_instability_deg_s=0.0),
        pick_up=replace(parameters.pick_up, meter_leads_v=0.0, v_vc_lead_v=0.0),
        table=replace(parameters.table, rate_error=0.0, ripple_arcsec=(0.0, 0.0), flutter_per_sqrt_hz=0.0),
        thermal=replace(parameters.thermal, self_heating_k=0.0),
        supply=replace(parameters.supply, ripple_feedthrough=0.0),
    )


def sensitive_to_g(at: BenchParameters) -> BenchParameters:
    """Return a gyroscope that acceleration moves, along each of its axes otherwise."""
    at = quiet(at)
    return structs.replace(at, sense_path=structs.replace(at.sense_path, g_sensitivity_deg_s_g=(0.5, -0.3, 0.4)))


def blind(at: BenchParameters) -> BenchParameters:
    """Return a gyroscope with a dead band."""
    at = quiet(at)
    return structs.replace(at, sense_path=structs.replace(at.sense_path, dead_band_deg_s=0.03))


def noisy(at: BenchParameters) -> BenchParameters:
    """Return a gyroscope with white noise, the same in all runs."""
    at = quiet(at)
    return structs.replace(at, noise=structs.replace(at.noise, angle_random_walk_deg_sqrt_s=0.0035))


class Device(NamedTuple):
    """What a person knows of the gyroscope for the budget, true of the simulated one."""

    scale_factor_ppm_k: float
    bias_deg_h_k: float
    k_vc_ppm_carrier_deg: float
    k_vc_ppm_demodulator_deg: float
    scale_factor_ppm_demodulator_deg: float
    bias_deg_s_demodulator_deg: float


def small_signal(parameters: BenchParameters) -> tuple[float, float, float]:
    """Return scale factor, V/(deg/s), K_Vc, (deg/s)/V, and bias, deg/s, by the closed form."""
    output = warm_output(parameters, 0.0)
    slope = output(0.5, None) - output(-0.5, None)
    return slope, 1e3 * (output(0.0, 5e-4) - output(0.0, -5e-4)) / slope, output(0.0, None) / slope


def turned(carrier_deg: float = 0.0, demodulator_deg: float = 0.0) -> Callable[[BenchParameters], BenchParameters]:
    """Return what turns the phases of carrier and demodulator."""

    def turn(at: BenchParameters) -> BenchParameters:
        carrier = at.virtual_path.carrier_phase_rad + math.radians(carrier_deg)
        demodulator = at.sense_path.demodulator_phase_rad + math.radians(demodulator_deg)
        return structs.replace(
            at,
            virtual_path=structs.replace(at.virtual_path, carrier_phase_rad=carrier),
            sense_path=structs.replace(at.sense_path, demodulator_phase_rad=demodulator),
        )

    return turn


def warmer(kelvin: float) -> Callable[[BenchParameters], BenchParameters]:
    """Return what warms the room."""
    return lambda at: structs.replace(at, thermal=structs.replace(at.thermal, ambient_c=at.thermal.ambient_c + kelvin))


def known_of(parameters: BenchParameters) -> Device:
    """Return what the closed form says of the gyroscope's temperature and phases."""

    def slopes(change: Callable[[float], Callable[[BenchParameters], BenchParameters]], step: float) -> list[float]:
        low, high = (small_signal(change(sign * step)(parameters)) for sign in (-1.0, 1.0))
        per = 2.0 * step
        return [1e6 * (high[0] / low[0] - 1.0) / per, 1e6 * (high[1] / low[1] - 1.0) / per, (high[2] - low[2]) / per]

    warm = slopes(warmer, 1.0)
    carrier = slopes(lambda by: turned(carrier_deg=by), 0.1)
    demodulator = slopes(lambda by: turned(demodulator_deg=by), 0.1)
    return Device(warm[0], 3600.0 * warm[2], carrier[1], demodulator[1], demodulator[0], demodulator[2])


class Bench:
    """A bench with a gyroscope of `GYROSCOPES`, perfect instruments, and what its file knows of all errors."""

    def __init__(self, file: str, gyroscope: str, as_built: Callable[[BenchParameters], BenchParameters]) -> None:
        own, self.k_vc = GYROSCOPES[gyroscope]
        self.parameters = as_built(own)
        self.scale_factor, _, _ = small_signal(quiet(own))
        self.split_hz = abs(self.parameters.drive_mode.frequency_hz - self.parameters.sense_anti_phase.frequency_hz)
        self.device = known_of(quiet(own))
        self._known = {**KNOWN, **self.device._asdict()}
        self._file = vcfbench.load_bench(file)

    def described(self, change: Change) -> BenchDescription:
        """Return the bench file of the bench with a change."""
        file, simulation = self._file, self._file.simulation
        assert simulation is not None
        errors = {role: {**each, **change.instruments.get(role, {})} or "none" for role, each in _PERFECT.items()}
        changed = change.parameters(self.parameters)
        return structs.replace(
            file,
            site=structs.replace(file.site, latitude_deg=changed.site.latitude_deg),
            uncertainty=structs.replace(file.uncertainty, **self._known),
            simulation=structs.replace(
                simulation,
                errors=structs.replace(simulation.errors, rate_table="none", **errors),
                override={key: each for key, each in to_builtins(changed).items() if key != "site"},
            ),
        )

    @contextmanager
    def taken(self, procedure: str, settings: Mapping[str, Any], change: Change) -> Iterator[Any]:
        """Give a run of a procedure on the bench with a change, whose record is there meanwhile."""
        around = {"split_guess_hz": self.split_hz} if procedure in {"bandwidth", "resonance"} else {}
        told = {**around, "k_vc_guess_deg_s_per_v": self.k_vc, **settings}
        told |= {key: told[key] + each for key, each in change.settings.items()}
        with TemporaryDirectory() as folder:
            yield vcfbench.run(procedure, self.described(change), seed=1, settings=told, runs=folder)


KNOWN: dict[str, Any] = {
    "table_rate_error": 2e-5,
    "bias_instability_deg_h": 0.5,
    "temperature_k": 0.1,
    "misalignment_deg": 0.3,
    "carrier_phase_deg": 0.01,
    "demodulator_phase_deg": 0.012,
    "warm_up_k": 0.0,
    "k_vc_drift_ppm_per_year": 0.0,
    "k_vc_on_the_way_ppm": 0.0,
    "k_vc_not_measured_ppm": 0.0,
}
"""Limits of the bench file: such that no part of a budget hides another."""


def values_of(results: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Measurand | StatedValue]]:
    """Yield every value of results that has a budget, by its place in them."""
    if isinstance(results, StatedValue):
        yield results.name, results
    elif isinstance(results, Measurand):
        yield name, results
    elif isinstance(results, list | tuple) and depth < 6:
        for place, each in enumerate(results):
            yield from values_of(each, f"{name}[{place}]", depth + 1)
    elif isinstance(results, dict) and depth < 6:
        for key, each in results.items():
            yield from values_of(each, f"{name}.{key}", depth + 1)
    elif hasattr(results, "__struct_fields__") and depth < 6:
        for key in results.__struct_fields__:
            yield from values_of(getattr(results, key), f"{name}.{key}" if name else key, depth + 1)
