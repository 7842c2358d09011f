"""A value of a bench file that does not fit, and the checks of every table of numbers."""

from collections.abc import Iterator

from msgspec import Struct, structs

from vcfbench.station.bounds import LEAST

MOST_V = 25.0
"""Largest output where no limit of the rails tells it: that of the supplies."""
OUTPUTS = ("bias_v", "reading_noise_v", "zero_drift_v")
"""Keys of what an output is or scatters by."""


class InvalidValue(Struct, frozen=True):
    """A value that cannot be, or that contradicts another: its key path, the expected one and itself."""

    path: str
    expected: str
    came: object


def turned_windows(table: Struct, path: str) -> Iterator[InvalidValue]:
    """Yield every window of `table` at `path` whose low is not below its high."""
    for key, window in structs.asdict(table).items():
        if isinstance(window, tuple) and not window[0] < window[1]:
            yield InvalidValue(f"{path}.{key}", "a window [low, high] with low below high", list(window))


def beyond_output(table: Struct, path: str, most: float, slow_deg_s: float) -> Iterator[InvalidValue]:
    """Yield every output of `table` that is larger than `most`, V, and every slope by which it were at a slow rate."""
    for key, value in structs.asdict(table).items():
        per = {**dict.fromkeys(OUTPUTS, 1.0), "scale_factor_v_per_deg_s": slow_deg_s}.get(key)
        numbers = value if isinstance(value, tuple) else (value or 0.0,)
        if per and max(map(abs, numbers)) * per > most:
            ends = f"the output ends at {most:g}"
            if key not in OUTPUTS:
                ends += f", and {slow_deg_s:g} deg/s would be beyond"
            expected = f"at most {most / per:.4g} either way: {ends} (is it in another unit, mV?)"
            yield InvalidValue(path + key, expected, list(value) if isinstance(value, tuple) else value)


def lost_digits(value: object, path: str) -> Iterator[InvalidValue]:
    """Yield every number at or below `value`, at `path`, that is too close to zero to be meant.

    Uncertainties may be as small as one likes: 10 ppm of 0.3 mV/(deg/s) are 3e-9 V/(deg/s).
    """
    if isinstance(value, Struct):
        for name, below in structs.asdict(value).items():
            if isinstance(below, Struct | tuple | float) and "_u_" not in f"_{name}":
                yield from lost_digits(below, f"{path}.{name}" if path else name)
    elif isinstance(value, tuple):
        for index, below in enumerate(value):
            yield from lost_digits(below, f"{path}[{index}]")
    elif isinstance(value, float) and 0.0 < abs(value) < LEAST:
        yield InvalidValue(path, f"0, or at least {LEAST:g} either sign", value)
