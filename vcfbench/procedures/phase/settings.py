"""Keys of the procedure `phase`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Final

from msgspec import Meta

from vcfbench.procedures.shared.kept_characteristics import KeptSettings
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import rate_words

LEAST_CYCLES: Final = 3


class PhaseSettings(KeptSettings, frozen=True, kw_only=True):
    """Keys of `phase`."""

    warm_up_s: Annotated[float, Meta(ge=0.0, le=86_400.0, description="wait after power-on")] = 600.0
    rate_deg_s: Annotated[float, Meta(ge=1.0, le=1e4, description="of the table, both signs")] = 100.0
    v_vc_v: Annotated[float, Meta(ge=0.01, le=10.0, description="V_Vc, both signs")] = 0.7
    sine_amplitude_v: Annotated[
        float, Meta(ge=0.01, le=10.0, description="peak of the sine that finds the demodulator's reference")
    ] = 1.4
    difference_hz: Annotated[
        float, Meta(ge=0.5, le=50.0, description="by which that sine is off twice the drive frequency, both ways")
    ] = 8.0
    records: Annotated[int, Meta(ge=2, le=1000, description="records of each state in a cycle")] = 5
    rotation_records: Annotated[int, Meta(ge=1, le=100, description="records of each of both sines in a cycle")] = 2
    target_deg: Annotated[
        float, Meta(ge=1e-3, le=10.0, description="expanded uncertainty at which cycles end, of every phase")
    ] = 0.05
    most_cycles: Annotated[int, Meta(ge=LEAST_CYCLES, le=1000, description="and after so many they end anyway")] = 20

    @property
    def fastest_deg_s(self) -> float:
        """The fastest that the table is asked to turn, deg/s, either way."""
        return self.rate_deg_s

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield the contradictions beyond the ranges; every node that is looked at needs a channel."""
        yield from super().contradictions()
        most_deg_s = self.station.limits.max_rate_deg_s
        if most_deg_s is not None and self.rate_deg_s > most_deg_s:
            yield InvalidValue("rate_deg_s", rate_words(most_deg_s), self.rate_deg_s)
        if self.station.oscilloscope is not None:
            for node in ("sense", "output"):
                if self.station.oscilloscope.channel_of(node) is None:
                    yield InvalidValue(
                        "station.oscilloscope", f"a channel that sees {node!r} (bench file, wiring)", None
                    )
