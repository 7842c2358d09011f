"""The recent past of the inputs of the DSO7104B, for its blocking capacitor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from simrack.instruments.dso7104b.filters import REMEMBERED_S
from simrack.instruments.dso7104b.inputs import ScopeWorld
from simrack.instruments.dso7104b.settings import CHANNELS, ScopeSettings
from simrack.trace import History, Piece


class Coupling:
    """Keeps the past while any channel, or the trigger, is AC coupled.

    Args:
        world: where the nodes are.
        nodes: node of each channel that is wired.
    """

    def __init__(self, world: ScopeWorld, nodes: Mapping[int, str]) -> None:
        self._world = world
        self._nodes = nodes
        self._history: History | None = None

    def watch(self, state: ScopeSettings) -> None:
        """Begin or end to keep it, as the settings are."""
        coupled = "AC" in {state.trigger.coupling, *(state.channel[channel].coupling for channel in CHANNELS)}
        if coupled and self._history is None:
            self._history = self._world.trace(REMEMBERED_S)
        elif not coupled and self._history is not None:
            self._history.end()
            self._history = None

    def past(self, channels: Iterable[int]) -> dict[int, list[Piece]]:
        """Return the past of the nodes of some channels up to now, oldest first."""
        if self._history is None:
            return {}
        nodes = {channel: self._nodes[channel] for channel in channels if channel in self._nodes}
        return {channel: self._history.pieces(node) for channel, node in nodes.items()}
