"""Benches behind ``pyvisa.ResourceManager("bench.toml@vcfbench")``, and their options behind a ``?``."""

from collections.abc import Mapping
from urllib.parse import parse_qsl

from simrack.device import Device

from vcfbench.bench.ground import FASTEST, check_simulation, pace_of
from vcfbench.clock import Clock, ScaledClock, VirtualClock
from vcfbench.errors import ConfigError
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.simulation import chosen_seed
from vcfbench.station.file import read_bench

_OPTIONS = ("speed", "seed", "name")


def resolve(path: str) -> tuple[Mapping[str, Device], Clock]:
    """Return VISA instruments and clock of the bench file `path` ("" the paper bench).

    Programs that know nothing of simulated time come this way; they wait with clocks of their own, so bench time is
    real time unless `path` ends in ``?speed=20`` or ``?speed=max``. ``seed`` is that of the noise. ``name`` does
    nothing: PyVISA gives one string one bench, and it tells two of them apart.

    Raises:
        OSError: the bench file or an option cannot be used; PyVISA's error for a missing library.
    """
    file, _, asked = path.partition("?")
    options = dict(parse_qsl(asked, keep_blank_values=True))
    seed, speed = options.get("seed"), options.get("speed", "1")
    if unknown := [name for name in options if name not in _OPTIONS]:
        raise OSError(f"?{asked}: expected {', '.join(_OPTIONS)}, got {unknown[0]!r}")
    if seed is not None and not seed.isdecimal():
        raise OSError(f"?seed={seed}: expected a whole number")
    try:
        description = read_bench(file or None, check_simulation)
        chosen = chosen_seed(description, None if seed is None else int(seed))
        clock = VirtualClock() if speed == FASTEST else ScaledClock(pace_of(speed, f"?speed={speed}"))
        built = SimulatedBench.build(description, chosen, clock)
    except ConfigError as error:
        raise OSError(str(error)) from error
    return built.visa_devices(), built.clock
