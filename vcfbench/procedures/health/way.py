"""Choice of the instrument that measures the characteristics of K_Vc: oscilloscope or multimeter."""

from __future__ import annotations

from typing import Final, Literal

from vcfbench.errors import ConfigError
from vcfbench.interfaces import SamplesVoltage, SetsSine, lacking
from vcfbench.procedures.shared.known.v_vc import KnownVvcSettings
from vcfbench.station.parts import Node

HEALTH: Final = "whether what K_Vc depends on is measured too, where the bench can"
AC_WANTED: Final = "whether a person moves the multimeter to drive and carrier, for the ratio of their AC volts"
NODES: Final[tuple[Node, ...]] = ("drive", "carrier", "sense", "output")
"""Nodes that the oscilloscope must see."""


def way_of(settings: KnownVvcSettings) -> tuple[Literal["oscilloscope", "multimeter"] | None, str]:
    """Return the measuring instrument, and the reason if it measures only a part, or nothing (None)."""
    if lacking(_driver_class(settings, "rate_source"), SetsSine):
        return None, "the generator makes no sines"
    wiring = settings.station.oscilloscope
    unseen = list(NODES) if wiring is None else [node for node in NODES if wiring.channel_of(node) is None]
    if not unseen:
        return "oscilloscope", ""
    why = f"no channel of the oscilloscope sees {' and '.join(unseen)} (wiring.oscilloscope)"
    why = "the bench has no oscilloscope" if wiring is None else why
    if lacking(_driver_class(settings, "multimeter"), SamplesVoltage):
        return None, f"{why}, and the multimeter takes no readings by itself"
    return "multimeter", why


def _driver_class(settings: KnownVvcSettings, role: str) -> type:
    from vcfbench.drivers.registry import find_driver  # noqa: PLC0415  # the drivers are loaded when a run needs them

    placed = settings.station.instruments.get(role)
    try:
        return type(None) if placed is None else find_driver(placed.model).driver_class
    except ConfigError:
        return type(None)
