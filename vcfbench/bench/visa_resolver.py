"""Benches behind ``pyvisa.ResourceManager("bench.toml@vcfbench")``, and their options behind a ``?``."""

import math
from collections.abc import Mapping
from urllib.parse import parse_qsl

from simrack.device import Device

from vcfbench.bench.ground import FASTEST, SLOWEST, check_simulation
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
        OSError: the bench file or what is asked of it cannot be used; PyVISA's word for a library that is not there.
    """
    file, _, asked = path.partition("?")
    try:
        options = _options(asked)
        description = read_bench(file or None, check_simulation)
        seed = chosen_seed(description, _seed(options.get("seed")))
        built = SimulatedBench.build(description, seed, _clock(options.get("speed")))
    except ConfigError as error:
        raise OSError(str(error)) from error
    return built.visa_devices(), built.clock


def _options(asked: str) -> dict[str, str]:
    options = dict(parse_qsl(asked, keep_blank_values=True))
    for name in options:
        if name not in _OPTIONS:
            raise ConfigError(f"?{asked}: expected {', '.join(_OPTIONS)}, came {name!r}")
    return options


def _seed(asked: str | None) -> int | None:
    if asked is None or asked.isdecimal():
        return None if asked is None else int(asked)
    raise ConfigError(f"?seed={asked}: expected a whole number")


def _clock(asked: str | None) -> Clock:
    """Return a clock of the speed `asked`: time that moves only when somebody waits for it, or scaled real time."""
    if asked == FASTEST:
        return VirtualClock()
    try:
        speed = 1.0 if asked is None else float(asked)
    except ValueError:
        speed = 0.0
    if not SLOWEST <= speed < math.inf:
        raise ConfigError(f"?speed={asked}: expected a number of at least {SLOWEST:g}, or {FASTEST!r}")
    return ScaledClock(speed)
