"""Settings of a run over temperature."""

from collections.abc import Iterator
from typing import Annotated, ClassVar

from msgspec import structs

from vcfbench.instructions.scale_factor import LevelSettings, ScaleFactorBy
from vcfbench.procedures.bandwidth import BandwidthSettings
from vcfbench.station.bounds import ranged, said, several
from vcfbench.station.invalid_value import InvalidValue

STEADY_MEANS = 3
"""So many means in a row must stand still."""
Celsius = Annotated[float, ranged(-100.0, 200.0)]


class TemperatureSettings(LevelSettings, frozen=True, kw_only=True):
    """Settings of the run over temperature, in addition to those of all procedures."""

    checked_warm: ClassVar[bool] = False
    temperatures_c: Annotated[tuple[Celsius, ...], several(3, 100, "temperatures of the air, in their order")] = (
        *(0.0, 20.0, 40.0, 60.0, 40.0, 20.0, 0.0),
    )
    reference_c: Annotated[float, ranged(-100.0, 200.0, "reference temperature of the coefficients")] = 20.0
    room_c: Annotated[float, ranged(-50.0, 60.0, "final temperature of a chamber that a person sets")] = 20.0
    ramp_k_min: Annotated[float, ranged(0.1, 1000.0, "fastest ramp of the air")] = 10.0
    window_k: Annotated[float, ranged(0.1, 9.9, "tolerance of the air temperature once it is reached")] = 1.0
    chamber_takes_s: Annotated[
        float, ranged(0.0, 86_400.0, "time for a temperature to be reached, beyond the ramp")
    ] = 900.0
    soak_s: Annotated[float, ranged(0.0, 86_400.0, "shortest soak at a temperature")] = 3600.0
    longest_soak_s: Annotated[float, ranged(0.0, 864_000.0, "longest soak; beyond it the run ends")] = 14_400.0
    steady_ppm_min: Annotated[
        float, ranged(0.1, 1e5, "the soak is over when the output at level_deg_s moves less than this")
    ] = 10.0
    soak_window_s: Annotated[float, ranged(10.0, 600.0, "length of the three means that decide this")] = 60.0
    cycles: Annotated[int, ranged(1, 100, "chopped blocks at each temperature")] = 2
    split: Annotated[bool, said("also measure the mode split, as bandwidth does")] = False
    u_temperature_k: Annotated[float, ranged(0.0, 20.0, "standard uncertainty common to all temperatures")] = 0.5
    u_each_temperature_k: Annotated[
        float, ranged(0.0, 20.0, "standard uncertainty of each one: regulation, resolution")
    ] = 0.0
    bias_instability_deg_h: Annotated[
        float, ranged(0.0, 1e6, "B of this gyroscope from its zero record: wander of the bias")
    ] = 5.6

    @property
    def early_look(self) -> tuple[str, ...]:
        either = super().early_look  # The table turns under the air alone where somebody asked for it
        return either[:1] if self.by is ScaleFactorBy.TABLE else either[1:]

    @property
    def chamber(self) -> str | None:
        """The model of the chamber, None where a person sets the temperature."""
        placed = self.station.instruments.get("chamber")
        return None if placed is None else placed.model

    @property
    def sweep(self) -> BandwidthSettings:
        """Settings of the sweep at a temperature: as `bandwidth`, fewer frequencies."""
        shared = {each: getattr(self, each) for each in structs.asdict(BandwidthSettings()) if hasattr(self, each)}
        fewer_hz, around = (1.0, 4.5, 9.0, 16.0, 20.0, 25.0, 31.0, 48.0), (0.7, 0.9, 0.97, 1.0, 1.03, 1.1, 1.2, 1.5)
        return structs.replace(BandwidthSettings(**shared), frequencies_hz=fewer_hz, around_split=around)

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        limits = self.station.limits
        if len(set(self.temperatures_c)) < 3:
            yield InvalidValue("temperatures_c", "at least three different ones", list(self.temperatures_c))
        low_c, high_c = limits.min_temperature_c, limits.max_temperature_c
        for index, each_c in enumerate(self.temperatures_c):
            if low_c is not None and high_c is not None and not low_c <= each_c <= high_c:
                yield InvalidValue(f"temperatures_c[{index}]", f"{low_c:g} to {high_c:g} degC (limits)", each_c)
        if limits.max_ramp_k_min is not None and self.ramp_k_min > limits.max_ramp_k_min:
            yield InvalidValue("ramp_k_min", f"at most {limits.max_ramp_k_min:g} K/min (limits)", self.ramp_k_min)
        if self.longest_soak_s < self.soak_s + STEADY_MEANS * self.soak_window_s:
            least_s = self.soak_s + STEADY_MEANS * self.soak_window_s
            yield InvalidValue("longest_soak_s", f"at least {least_s:g} s: soak_s and three means", self.longest_soak_s)
