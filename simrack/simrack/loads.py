"""Loads on the nodes of a World by instruments and faults: resistances to ground, behind each node's own."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Hashable, Mapping

from simrack.clock import Clock
from simrack.observations import Observed
from simrack.sources import Approach, Drive, Played


class NodeLoads:
    """The added resistances from nodes to ground.

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

    def ohm_of(self, who: Hashable) -> float:
        """Return the added resistance, ohm; inf without one."""
        return self._loads[who][1] if who in self._loads else math.inf

    def conductance_s(self, node: str) -> float:
        """Return the conductance from `node` to ground, S."""
        return self._conductances_s.get(node, 0.0)

    def presented_ohm(self, node: str, own_ohm: float | None = None) -> float:
        """Return the resistance of `node`: its own parallel to the loads; a rail has none."""
        own = self._sources_ohm.get(node, 0.0) if own_ohm is None else own_ohm
        return own / (1.0 + own * self.conductance_s(node))

    def behind(self, node: str, source: Drive | Played | None) -> Drive | Played | None:
        """Return the source that a generator and the load on the input `node` are together (Thevenin)."""
        conductance = self.conductance_s(node)
        if source is None or not conductance:
            return source
        share = 1.0 / (1.0 + source.source_ohm * conductance)
        return source.divided(share)


class Loaded(Observed):
    """An observed World whose nodes and rails carry loads; their supplies are notified of each change.

    Args:
        clock: bench time.
        sources_ohm: as of :class:`NodeLoads`.
    """

    rails: tuple[str, ...]

    def __init__(self, clock: Clock, sources_ohm: Mapping[str, float]) -> None:
        super().__init__(clock)
        self._loads = NodeLoads(sources_ohm)
        self._on_load: list[Callable[[], None]] = []

    @abstractmethod
    def move_rail(self, rail: str, approach: Approach) -> None:
        """Change the voltage on a supply pin along a given course from now on, signed."""

    def set_rail(self, rail: str, voltage_v: float) -> None:
        """Put a voltage on a supply pin from now on, signed: "positive" +10 V, "negative" -10 V."""
        self.move_rail(rail, Approach(voltage_v))

    def load_ohm(self, rail: str) -> float:
        """Return the load on `rail` parallel to the device, ohm; inf without one."""
        self._require(rail, self.rails)
        return self._loads.ohm_of((Loaded, rail))

    def set_load(self, rail: str, resistance_ohm: float) -> None:
        """Put a load on `rail` parallel to the device, a fault for instance; inf removes it.

        Raises:
            ValueError: it is not above 0 ohm.
        """
        self._require(rail, self.rails)
        self._load((Loaded, rail), f"rail_{rail}", resistance_ohm)

    def load_node(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        """Hang a resistance on `node` in place of any former one of `who`; inf takes it off.

        Raises:
            ValueError: the node is unknown, or the resistance is not above 0 ohm.
        """
        self._require(node, self.nodes)
        self._load(who, node, resistance_ohm)

    def _load(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        self.advance()
        self._loads.put(who, node, resistance_ohm)
        for regulate in self._on_load:
            regulate()

    def on_load(self, regulate: Callable[[], None]) -> None:
        """Call `regulate` after each change of a load, so that a supply finds its new working point at once."""
        self._on_load.append(regulate)
