"""What ``pyvisa.ResourceManager("bench.toml@vcfbench")`` opens."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.bench.file import load_bench
from vcfbench.bench.simulated import SimulatedBench, chosen_seed
from vcfbench.clock import ScaledClock
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from vcfbench.clock import Clock
    from vcfbench.sim.device import Device

__all__ = ["resolve"]


def resolve(path: str) -> tuple[Mapping[str, Device], Clock]:
    """Return VISA instruments and clock of the bench file `path` ("" the paper bench), running in real time.

    Programs that know nothing of simulated time come this way; they wait with clocks of their own.

    Raises:
        OSError: the bench file cannot be used; PyVISA's word for a library that is not there.
    """
    try:
        description = load_bench(path or None)
        built = SimulatedBench.build(description, chosen_seed(description, None), ScaledClock())
    except ConfigError as error:
        raise OSError(str(error)) from error
    return built.visa_devices(), built.clock
