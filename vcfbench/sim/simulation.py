"""Choices of a bench file for a simulated bench: seed, instruments, physical parameters. Loads no simulation."""

from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.models import ROLES, Model, TableLanguage, find_language, find_model, languages, profile_reader, twin_of
from vcfbench.sim.gyro.design import ideal_bench, paper_bench
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.parameters import BenchParameters
from vcfbench.station.description import BenchDescription, Simulation, whole_seed
from vcfbench.station.overrides import overridden


def chosen_seed(description: BenchDescription, seed: int | None) -> int:
    """Return `seed`, or the bench file's without one; raises ConfigError for an invalid seed."""
    return simulation_of(description).seed if seed is None else whole_seed(seed)


def twins(description: BenchDescription) -> dict[str, Any]:
    """Return the class of the simulated instrument of every role that the bench fills.

    Raises:
        ConfigError: a model has none, or its package cannot be loaded.
    """
    found: dict[str, Any] = {}
    for role in (*ROLES, "rate_table"):
        part = getattr(description, role)
        if part is None:
            continue
        if role == "multimeter" and description.stream:
            from simrack.stream import StreamTwin  # noqa: PLC0415  # few benches have one

            found[role] = StreamTwin
            continue
        row: Model | TableLanguage | None
        if role == "rate_table":
            name = profile_twin(part.dialect) if part.dialect.endswith(".toml") else part.dialect
            row, said = find_language(name), f"table that speaks {name!r}"
        else:
            said = part.like or part.model
            row = find_model(said)
        if row is None or row.twin is None:
            raise ConfigError(
                f"there is no simulated {said}",
                hint="its package names one in its row of vcfbench.models; a real bench needs none",
            )
        try:
            found[role] = twin_of(row)
        except Exception as error:  # another package is anyone's code
            raise ConfigError(f"the simulated {row.name} ({row.twin}) cannot be loaded: {error}") from error
    return found


def profile_twin(dialect: str) -> str:
    """Return the name of the simulated table that a profile names; ConfigError if it names none."""
    twin: str | None = profile_reader().load_profile(dialect).twin
    if twin is None or find_language(twin) is None:
        came = "nothing" if twin is None else repr(twin)
        raise ConfigError(f"{dialect}: twin: expected one of {', '.join(languages())} on a simulated bench, got {came}")
    return twin


def named_parameters(simulation: Simulation) -> BenchParameters:
    """Return the shipped parameter set that the bench file names."""
    return ideal_bench() if simulation.parameters == "ideal" else paper_bench()


def physical_parameters(description: BenchDescription) -> BenchParameters:
    """Return the parameters of gyroscope, PCB and table: the named set at the bench's site, then the overrides."""
    simulation = simulation_of(description)
    named = named_parameters(simulation)
    here = replace(
        named,
        site=replace(named.site, latitude_deg=description.site.latitude_deg),
        pick_up=replace(named.pick_up, mains_hz=float(description.site.mains_hz)),
    )
    return overridden(here, simulation.override)


def true_output(
    description: BenchDescription, *, at_input: bool = False, rails_v: tuple[float, float] | None = None
) -> Callable[[float, float | None], float]:
    """Return the true output of the warm gyroscope by rate (deg/s) and V_Vc (V); None with the generator off.

    It is in V, or in the unit of its stream of numbers: deg/s or LSB. V_Vc is the level of the open generator, or that
    `at_input`, where a second meter sees it. `rails_v` are the rails, positive and negative; None means the nominal
    ones of the gyroscope.
    """
    from simrack.instruments.agilent33220a.settings import SOURCE_OHM  # noqa: PLC0415

    output_v = warm_output(physical_parameters(description), 0.0 if at_input else SOURCE_OHM, rails_v)
    if description.stream is None:
        return output_v
    from simrack.stream import VOLTS_PER_DEG_S, StreamErrors  # noqa: PLC0415

    asked = simulation_of(description).errors.multimeter
    errors = overridden(StreamErrors.none(), asked if isinstance(asked, dict) else {})
    per_deg_s = errors.lsb_per_deg_s if description.stream.unit == "LSB" else 1.0
    return lambda rate_deg_s, v_vc_v: per_deg_s * output_v(rate_deg_s, v_vc_v) / VOLTS_PER_DEG_S


def simulation_of(description: BenchDescription) -> Simulation:
    """Return the table ``[simulation]``; raises ConfigError for a bench without."""
    if description.simulation is None:
        raise ConfigError(f"{description.name}: expected a bench with a table [simulation]")
    return description.simulation
