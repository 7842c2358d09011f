"""Settings of the test of the supply."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta, structs

from vcfbench.procedures.shared.known.scale_factor import LevelSettings
from vcfbench.station.invalid_value import InvalidValue

Order = Literal["together", "positive", "negative"]
Varied = Literal["positive", "negative", "both"]


class PowerSettings(LevelSettings, frozen=True, kw_only=True):
    """Settings of the test of the supply, beside those of all procedures."""

    warm_up_s: Annotated[float, Meta(ge=0.0, le=86_400.0, description="wait after power-on")] = 1800.0
    orders: Annotated[
        tuple[Order, ...],
        Meta(
            min_length=1,
            max_length=6,
            description="power-on: both rails together, or this one first; only what the PCB bears",
        ),
    ] = ("together",)
    order_delay_s: Annotated[float, Meta(ge=0.1, le=600.0, description="from the first rail to the second")] = 1.0
    log_s: Annotated[float, Meta(ge=1.0, le=600.0, description="how long a power-on is followed")] = 10.0
    off_s: Annotated[float, Meta(ge=1.0, le=3600.0, description="without power between two of them")] = 10.0
    valid_tolerance_deg_s: Annotated[
        float, Meta(ge=1e-3, le=1e3, description="the output is valid when it stays so close to what it comes to")
    ] = 1.0
    rails_varied: Annotated[
        tuple[Varied, ...], Meta(min_length=1, max_length=3, description="which rails are moved, by themselves or both")
    ] = ("positive", "negative", "both")
    rail_step_v: Annotated[
        float, Meta(ge=0.05, le=5.0, description="how far a rail is moved either way, within the limits")
    ] = 0.2
    cycles: Annotated[int, Meta(ge=1, le=100, description="times that each rail is moved up and down")] = 2

    def moved(self, which: Varied, step_v: float) -> PowerSettings:
        """Return these settings with the rails `which` so much larger, V."""
        positive = step_v if which in {"positive", "both"} else 0.0
        negative = step_v if which in {"negative", "both"} else 0.0
        return structs.replace(
            self, positive_rail_v=self.positive_rail_v + positive, negative_rail_v=self.negative_rail_v - negative
        )

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield the contradictions beyond the ranges."""
        yield from super().contradictions()
        limits = self.station.limits
        low_v, high_v = limits.min_rail_v, limits.max_rail_v
        if low_v is not None and high_v is not None:
            for rail_v in (self.positive_rail_v, -self.negative_rail_v):
                if not low_v <= rail_v - self.rail_step_v <= rail_v + self.rail_step_v <= high_v:
                    most_v = min(rail_v - low_v, high_v - rail_v)
                    yield InvalidValue(
                        "rail_step_v", f"at most {most_v:g} V, for the limits of the rails", self.rail_step_v
                    )
