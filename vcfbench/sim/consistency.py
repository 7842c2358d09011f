"""Checks of ``[simulation]``: physical parameters, instrument errors, and the simulated table of a profile."""

from collections.abc import Iterator

from msgspec import structs

from vcfbench.sim.parameters import Contradiction
from vcfbench.sim.simulation import named_parameters, physical_parameters, profile_twin, twins
from vcfbench.station.description import BenchDescription
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.overrides import invalid_overrides
from vcfbench.strict import refusal, words

_MOST_DRAWN = 10.0
"""Times the published accuracy: more is no such instrument any more."""


def check_simulation(description: BenchDescription, source: str) -> None:
    """Check the simulated part of a bench; raises ConfigError, in which `source` names the file."""
    for invalid_value in _overrides(description):
        raise refusal(f"{source}: {invalid_value.path}", invalid_value.expected, words(invalid_value.came))
    table = description.rate_table
    if table is not None and table.dialect.endswith(".toml"):
        profile_twin(table.dialect)


def _overrides(description: BenchDescription) -> Iterator[InvalidValue]:
    """Check names and types of single parameters and instrument errors; most bench files have none."""
    simulation = description.simulation
    errors = {} if simulation is None else structs.asdict(simulation.errors)
    if simulation is None or not (simulation.override or any(isinstance(each, dict) for each in errors.values())):
        return
    single = list(invalid_overrides(named_parameters(simulation), simulation.override, "simulation.override"))
    yield from single
    try:  # parameters, each of them one, must fit together
        if not single:
            physical_parameters(description)
    except Contradiction as error:
        yield InvalidValue("simulation.override", error.expected, error.came)
    for role, twin in twins(description).items():
        if isinstance(errors[role], dict):
            named = {name: value for name, value in errors[role].items() if name != "drawn"}
            yield from invalid_overrides(twin.errors_class.none(), named, f"simulation.errors.{role}")
            share = errors[role].get("drawn", 0.0)
            if type(share) not in (int, float) or not 0.0 <= share <= _MOST_DRAWN:
                yield InvalidValue(f"simulation.errors.{role}.drawn", f"a number from 0 to {_MOST_DRAWN:g}", share)
