"""Keysight 34461A and 34465A multimeters, after the Truevolt Series Operating and Service Guide.

They speak the 34401A's words but for those that stand here as data. INITiate is overlapped: FETCh? waits for the
reading and may be asked again, for it stays in memory (users' drivers, after the guide).
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Self

from vcfbench.drivers.hp34401a import Hp34401A

_MODELS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        # Apertures that do not depend on the line: guide p. 452; memory: p. 306
        "34461A": {"makers": ("KEYSIGHT", "AGILENT"), "fast_apertures_s": {0.02: 0.3e-3, 0.2: 3e-3}},
        # More integration times (guide p. 329); it refuses the three fastest without its option DIG
        "34465A": {
            "memory_readings": 50_000,
            "integration_times_nplc": (0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1.0, 10.0, 100.0),
        },
    }
)


class Truevolt(Hp34401A):
    """A meter of the series, made by :meth:`of_model`: every function has an autozero of its own (guide p. 223)."""

    makers: ClassVar[tuple[str, ...]] = ("KEYSIGHT",)
    dc_words: ClassVar[tuple[str, ...]] = (
        "CONF:VOLT:DC {range}",
        "VOLT:DC:NPLC {nplc}",
        "VOLT:DC:ZERO:AUTO ON",
        "TRIG:SOUR IMM",
    )
    sampling_words: ClassVar[tuple[str, ...]] = ("VOLT:DC:ZERO:AUTO ONCE", "SAMP:COUN {samples}", "TRIG:DEL {pause}")
    single_words: ClassVar[tuple[str, ...]] = ("SAMP:COUN 1", "TRIG:DEL:AUTO ON", "VOLT:DC:ZERO:AUTO ON")
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({})
    memory_readings: ClassVar[int] = 10_000
    abort_words: ClassVar[tuple[str, ...]] = ("ABOR",)
    """A raw socket has no device clear, and *OPC? waits for a measurement that is under way."""

    @classmethod
    def of_model(cls, model: str, **own: Any) -> type[Self]:
        """Return the driver of the 34461A or 34465A."""
        return super().of_model(model, **_MODELS[model], **own)
