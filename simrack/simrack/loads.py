"""Loads on the nodes of the PCB by instruments and faults: resistances to ground, behind each node's own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from simrack.sources import Drive, Played


class NodeLoads:
    """The resistances that hang on the nodes, each put there by somebody.

    Args:
        sources_ohm: resistance of each of the nodes that are outputs of a device.
    """

    def __init__(self, sources_ohm: Mapping[str, float]) -> None:
        self._sources_ohm = dict(sources_ohm)
        self._loads: dict[Hashable, tuple[str, float]] = {}
        self._conductances_s: dict[str, float] = {}
        self.shares: dict[str, float] = {}
        """What is left of the open voltage of the PCB's outputs; of those that nothing loads nothing is said."""

    def put(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        """Put a resistance from `node` to ground in place of the former one of `who`; inf takes it off.

        Raises:
            ValueError: it is not above 0 ohm.
        """
        if not resistance_ohm > 0.0:
            raise ValueError(f"a load has more than 0 ohm, not {resistance_ohm}")
        self._loads.pop(who, None)
        if math.isfinite(resistance_ohm):
            self._loads[who] = (node, resistance_ohm)
        loaded = {node for node, _ in self._loads.values()}
        self._conductances_s = {
            node: sum(1.0 / ohm for on, ohm in self._loads.values() if on == node) for node in loaded
        }
        own = self._sources_ohm
        self.shares = {node: 1.0 / (1.0 + own[node] * self.conductance_s(node)) for node in loaded if node in own}

    def conductance_s(self, node: str) -> float:
        """Return the conductance from `node` to ground, S."""
        return self._conductances_s.get(node, 0.0)

    def presented_ohm(self, node: str, own_ohm: float | None = None) -> float:
        """Return the resistance that `node` presents: its own beside the loads; a rail has none."""
        own = self._sources_ohm.get(node, 0.0) if own_ohm is None else own_ohm
        return own / (1.0 + own * self.conductance_s(node))

    def behind(self, node: str, source: Drive | Played | None) -> Drive | Played | None:
        """Return the source that a generator and the load on the input `node` are together (Thevenin)."""
        conductance = self.conductance_s(node)
        if source is None or not conductance:
            return source
        share = 1.0 / (1.0 + source.source_ohm * conductance)
        return source.divided(share)
