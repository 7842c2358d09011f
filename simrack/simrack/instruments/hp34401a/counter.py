"""Frequency and period of the 34401A: a reciprocal counter behind the ac path (User's Guide p. 61, 218, 221).

It counts how often what is behind the path rises through the upper of two thresholds after it was below the lower one.
The first such event opens the gate, the first after its time closes it, and the count is divided by what lies between.
Where each cycle of a signal makes one event its phase tells how many there were; else they are looked for.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from simrack.components import Component, Turning, Values, transform_hz
from simrack.instruments.hp34401a.ac import AcResponse
from simrack.trace import Piece, merged

OVERHEAD_S = 2.2e-3
"""What 9.8 and 80 readings a second leave beside gates of 0.1 and 0.01 s (p. 221)."""
LONGEST_WAIT_S = 1.0
"""How long the counter waits for a first event, or one that closes the gate, before it does without (unverified)."""
_BLOCKED_S = 4.0
"""How much of the past the blocking capacitor is worked out for."""
_BLOCKED_BINS = 1 << 13
_RINGING_S = 5e-6
"""After this nothing is left of what the amplifier makes of a jump."""
_RINGS_BELOW_S = 0.25e-6
"""Whoever looks more coarsely than this sees nothing of the amplifier."""
_BLOCK = 1 << 13
"""So many looks are one slice of the work, some 10 ms."""
_LOOKS_BACK = 1 << 13
_FEWEST_LOOKS, _MOST_LOOKS = 1 << 10, 1 << 21
_STRETCHES, _STRETCH_LOOKS = 64, 1 << 14
"""A signal that would need more than the most looks is counted in so many stretches of the gate."""
_CYCLE_LOOKS, _MOST_CYCLE_LOOKS = 1 << 12, 1 << 16
_TURN_LOOKS, _TURN_CYCLES = 1 << 12, 4
"""How finely an event is looked for where the phase tells of the others, over how many cycles."""
_FAST_CYCLES = 16.0
"""A signal whose frequency never falls below so many times its corner moves the blocking capacitor no more."""
_FEW_CYCLES = 8.0
_SAME = 1e-9
_FINER = 1024.0
_FINEST_S = 1e-9


class Counted(NamedTuple):
    """Result of a gate so far.

    Args:
        frequency_hz: up to its last event, 0 with less than two.
        closes_s: when the event that closes it may be looked for; what is past says that it is closed.
    """

    frequency_hz: float
    closes_s: float


def counting(
    pieces: list[Piece], gate_s: tuple[float, float], known_s: float, response: AcResponse, least_v: float
) -> Generator[None, None, Counted]:
    """Return, after slices of work, the result of a gate on a signal known up to `known_s`.

    Sines below `least_v` rms are none.
    """
    known = merged(piece for piece in pieces if piece.stop_s > piece.start_s)
    if not known:
        return Counted(0.0, math.inf)
    threshold_v = math.sqrt(2.0) * least_v
    behind = _Behind(known, gate_s[0], known_s, response)
    if known[-1].start_s <= gate_s[0]:
        regular = yield from _paced(behind, known[-1], gate_s, known_s, threshold_v)
        regular = regular or (yield from _turned(behind, known[-1], gate_s, threshold_v))
        if regular is not None:
            return regular
    yield
    return (yield from _Gate(behind, gate_s, known_s, threshold_v).counting())


def _counted(events: int, first_s: float, last_s: float, closes_s: float) -> Counted:
    return Counted(events / (last_s - first_s) if events > 0 else 0.0, closes_s)


class _Behind:
    """Signal behind the ac path, as far as one gate needs it."""

    def __init__(self, pieces: list[Piece], start_s: float, stop_s: float, response: AcResponse) -> None:
        self._parts = [(piece.start_s, piece.stop_s, piece.components()) for piece in pieces]
        self.response = response
        self._start_s = start_s
        self.settled_v: float | None = None
        """Voltage across the blocking capacitor, where that is known to stay."""
        self._edges_s = np.linspace(max(start_s - _BLOCKED_S, pieces[0].start_s), stop_s, _BLOCKED_BINS + 1)
        self._middles_s = (self._edges_s[1:] + self._edges_s[:-1]) / 2

    @cached_property
    def _slow_v(self) -> tuple[Values, Values]:
        """Return coarsely the voltage before the blocking capacitor, and the voltage across it."""
        means = self._means(self._edges_s)
        before = means[self._middles_s < self._start_s]
        first_v = float((before if len(before) else means).mean())
        # Voltage of a capacitor behind a resistance, from `first_v` on
        edges_s = self._edges_s
        step = math.tau * self.response.corner_hz * float(edges_s[1] - edges_s[0])
        grown = np.exp(step * np.arange(len(means)))
        taken = -math.expm1(-step) * math.exp(step) * np.cumsum(means * grown)
        return means, np.asarray((first_v + np.concatenate(([0.0], taken[:-1]))) / grown)

    def finest_s(self, start_s: float, stop_s: float) -> float:
        """Return the spacing that it needs between two times."""
        within = [parts for begin, end, parts in self._parts if begin < stop_s and end > start_s]
        return min((each.finest_s for parts in within for each in parts), default=math.inf)

    def volts(self, start_s: float, step_s: float, looks: int) -> Values:
        """Return the volts in the middles of so many steps."""
        pad = math.ceil(_RINGING_S / step_s) if step_s < _RINGS_BELOW_S else 0
        edges = _evenly(start_s - pad * step_s, step_s, looks + 2 * pad)
        means = self._means(edges)
        if pad:
            lines = np.fft.rfft(means) * self.response.fast(transform_hz(len(means), step_s))
            means = np.asarray(np.fft.irfft(lines, len(means))[pad : pad + looks], dtype=np.float64)
        middles = (edges[pad + 1 : pad + looks + 1] + edges[pad : pad + looks]) / 2
        return np.asarray(means - self.blocked_v(middles))

    def blocked_v(self, times_s: Values) -> Values:
        """Return the voltage across the blocking capacitor."""
        if self.settled_v is not None:
            return np.full(len(times_s), self.settled_v)
        return np.asarray(np.interp(times_s, self._middles_s, self._slow_v[1]))

    def armed(self, instant_s: float, threshold_v: float) -> bool:
        """Return True if coarse samples fell below the lower threshold after they were above the upper one."""
        before, across = self._slow_v
        past = (before - across)[self._middles_s < instant_s]
        beyond = past[np.abs(past) > threshold_v]
        return not len(beyond) or bool(beyond[-1] < 0.0)

    def _means(self, edges_s: Values) -> Values:
        means, middles = np.zeros(len(edges_s) - 1), (edges_s[1:] + edges_s[:-1]) / 2
        for start, stop, components in self._parts:
            first, last = np.searchsorted(middles, (start, stop))
            if first < last:
                means[first:last] = sum(each.means(edges_s[first : last + 1]) for each in components)
        return means


def _evenly(start_s: float, step_s: float, looks: int) -> Values:
    """Return the edges of so many steps."""
    return np.asarray(start_s + step_s * np.arange(looks + 1), dtype=np.float64)


def _paced(
    behind: _Behind, piece: Piece, gate_s: tuple[float, float], known_s: float, threshold_v: float
) -> Generator[None, None, Counted | None]:
    """Return the count of a signal with one periodic component that decides alone; None if it is not so."""
    components = piece.components()
    paces = [each.pace_hz for each in components]
    if any(pace is None for pace in paces):
        return None
    sounding = [pace for pace in paces if pace]
    if not sounding:
        return Counted(0.0, math.inf)
    start_s, lowest = gate_s[0], min(sounding)
    if all(abs(pace / lowest - round(pace / lowest)) < _SAME for pace in sounding):
        seen = _cycle(behind, components, lowest, start_s, blocked=True)
        yield
        looks = len(seen)
        places = _coming(np.tile(seen, 2), looks, threshold_v)
        events_s = start_s + (places - looks + 0.5) / (looks * lowest)
        return _repeated(events_s, lowest, gate_s[1], known_s)
    peaks = [each.peak_v(behind.response.fast) for each in components]
    leading = int(np.argmax(peaks))
    hertz, beside_v = paces[leading] or 0.0, sum(peaks) - peaks[leading]
    cycle = _cycle(behind, (components[leading],), hertz, start_s, blocked=False)
    yield
    if (gate_s[1] - start_s) * hertz < _FEW_CYCLES or not _decides(cycle - cycle.mean(), beside_v, threshold_v):
        return None
    yield
    others = [each for index, each in enumerate(components) if index != leading]
    return (yield from _Disturbed(behind, cycle, others, hertz, threshold_v).counted(gate_s, known_s))


def _turned(
    behind: _Behind, piece: Piece, gate_s: tuple[float, float], threshold_v: float
) -> Generator[None, None, Counted | None]:
    """Return the count of one component whose frequency moves, by its phase; None if that does not tell."""
    components = piece.components()
    moving = [each for each in components if each.pace_hz != 0.0]
    turning = moving[0].turning if len(moving) == 1 else None
    if turning is None or turning.lowest_hz < _FAST_CYCLES * behind.response.corner_hz:
        return None
    if (gate_s[1] - gate_s[0]) * turning.lowest_hz < _FEW_CYCLES:
        return None
    ends_hz = (turning.lowest_hz, turning.highest_hz)
    cycles = []
    for hertz in ends_hz:
        cycles.append(_cycle(behind, (turning.steady(hertz),), hertz, 0.0, blocked=False))
        yield
    mean_v = float(cycles[0].mean())
    if all(float((cycle - mean_v).max()) <= threshold_v for cycle in cycles):
        return Counted(0.0, math.inf)
    if not all(_decides(cycle - mean_v, 0.0, threshold_v) for cycle in cycles):
        return None
    levels_v = sum(float(each.means(np.array(gate_s))[0]) for each in components if each.pace_hz == 0.0)
    behind.settled_v = mean_v + levels_v
    events = []
    for instant in gate_s:
        yield
        if (event := _event_after(behind, turning, instant, threshold_v)) is None:
            behind.settled_v = None
            return None
        events.append(event)
    first, last = events
    turned = turning.cycles(np.array(events))
    return _counted(round(float(turned[1] - turned[0])), first, last, last)


def _event_after(behind: _Behind, turning: Turning, instant_s: float, threshold_v: float) -> float | None:
    """Return when a component rises next after an instant; None where that is not within two cycles."""
    near = instant_s + np.array([0.0, 1.0 / turning.highest_hz])
    cycle_s = 1.0 / (turning.highest_hz * float(np.diff(turning.cycles(near))[0]))
    step_s = max(_TURN_CYCLES * cycle_s / _TURN_LOOKS, _FINEST_S)
    begun = instant_s - _TURN_CYCLES / 2 * cycle_s
    volts = behind.volts(begun, step_s, math.ceil(_TURN_CYCLES * cycle_s / step_s))
    events = begun + step_s * (rises(volts, threshold_v, armed=False)[0] + 0.5)
    later = events[events >= instant_s]
    return exactly(behind, float(later[0]), step_s, threshold_v) if len(later) else None


def _cycle(behind: _Behind, components: Sequence[Component], hertz: float, start_s: float, *, blocked: bool) -> Values:
    """Return a cycle of the periodic components from an instant on, behind the amplifier, and the capacitor too."""
    finest = min(each.finest_s for each in components)
    looks = min(max(_CYCLE_LOOKS, 2 ** math.ceil(math.log2(1.0 / (hertz * finest)))), _MOST_CYCLE_LOOKS)
    edges = _evenly(start_s, 1.0 / (looks * hertz), looks)
    lines = np.fft.rfft(sum((each.means(edges) for each in components), start=np.zeros(looks)))
    harmonics_hz = transform_hz(looks, 1.0 / (looks * hertz))[1:]
    lines[1:] *= behind.response.fast(harmonics_hz)
    if blocked:
        lines[0] = 0.0
        lines[1:] *= behind.response.slow(harmonics_hz)
    return np.asarray(np.fft.irfft(lines))


def _repeated(events_s: Values, hertz: float, stop_s: float, known_s: float) -> Counted:
    """Return the count by the events of a first cycle, which all come again."""
    if not len(events_s):
        return Counted(0.0, math.inf)
    first, each = float(events_s[0]), len(events_s)
    cycles = max(math.floor((stop_s - first) * hertz), 0)
    coming = np.concatenate((events_s + cycles / hertz, events_s + (cycles + 1) / hertz))
    closing = max(int(np.searchsorted(coming, stop_s)), 1 if not cycles else 0)
    if (closes_s := float(coming[closing])) > known_s:
        closing = int(np.searchsorted(coming, known_s, side="right")) - 1
    return _counted(cycles * each + closing, first, float(coming[closing]), closes_s)


def _decides(cycle: Values, beside_v: float, threshold_v: float) -> bool:
    """Return True if each cycle rises once, whatever is added up to `beside_v`."""
    levels = (threshold_v + beside_v, max(threshold_v - beside_v, 0.0))
    return all(len(_coming(np.tile(cycle, 3), len(cycle), level)) == 2 for level in levels)


def _coming(volts: Values, cycle: int, threshold_v: float) -> Values:
    """Return where volts rise after a first cycle, which arms the counter."""
    places, _ = rises(volts, threshold_v, armed=True)
    return np.asarray(places[places >= cycle])


class _Disturbed:
    """Cycles that something else makes come a little earlier or later."""

    def __init__(
        self, behind: _Behind, cycle: Values, others: list[Component], hertz: float, threshold_v: float
    ) -> None:
        self._behind = behind
        self._cycle = cycle
        self._others = others
        self._hertz = hertz
        self._threshold_v = threshold_v

    def counted(self, gate_s: tuple[float, float], known_s: float) -> Generator[None, None, Counted]:
        """Return the count of a gate; its cycles are counted from the same phase on."""
        begun_s = gate_s[0] - 1.0 / self._hertz
        early = yield from self._events(begun_s)
        later = math.floor((min(gate_s[1], known_s) - begun_s) * self._hertz - 2.0)
        late = yield from self._events(begun_s + later / self._hertz)
        first = float(early[np.searchsorted(early, gate_s[0])])
        closing = float(late[np.searchsorted(late, gate_s[1])])
        last = closing if closing <= known_s else float(late[np.searchsorted(late, known_s) - 1])
        return _counted(round((last - first) * self._hertz), first, last, closing)

    def _events(self, begun_s: float) -> Generator[None, None, Values]:
        """Return, after slices of work, the events of five cycles from a time on at which `cycle` begins."""
        looks, step = 6 * len(self._cycle), 1.0 / (len(self._cycle) * self._hertz)
        edges = _evenly(begun_s - 1.0 / self._hertz, step, looks)
        slow_v = np.zeros(looks)
        for each in self._others:
            slow_v = slow_v + each.means(edges)
            yield
        slow_v -= self._behind.blocked_v((edges[1:] + edges[:-1]) / 2)
        yield
        places = _coming(np.tile(self._cycle, 6) + slow_v, len(self._cycle), self._threshold_v)
        return np.asarray(edges[0] + step * (places + 0.5))


class _Gate:
    """The gate of a signal about which nothing is known."""

    def __init__(self, behind: _Behind, gate_s: tuple[float, float], known_s: float, threshold_v: float) -> None:
        self._behind = behind
        self._start_s, self._stop_s = gate_s
        self._known_s = known_s
        self._threshold_v = threshold_v

    def counting(self) -> Generator[None, None, Counted]:
        """Return the count so far, after a slice of work a block."""
        lasts = self._stop_s - self._start_s
        step = min(self._behind.finest_s(self._start_s, self._stop_s), lasts / _FEWEST_LOOKS)
        if lasts / step > _MOST_LOOKS:
            return Counted((yield from self._in_stretches(step)), self._stop_s)
        seen, closed = np.empty(0), False
        for events in self._events(self._start_s, self._known_s, step):
            seen = np.concatenate((seen, events))
            after = max(int(np.searchsorted(seen, self._stop_s)), 1)
            if closed := after < len(seen):
                seen = seen[: after + 1]
                break
            yield
        waits = max(OVERHEAD_S, (self._known_s - self._start_s) / 4)
        if len(seen) < 2:
            return Counted(0.0, self._known_s + waits if len(seen) else math.inf)
        yield
        first = exactly(self._behind, float(seen[0]), step, self._threshold_v)
        yield
        last = exactly(self._behind, float(seen[-1]), step, self._threshold_v)
        return _counted(len(seen) - 1, first, last, self._stop_s if closed else self._known_s + waits)

    def _in_stretches(self, step_s: float) -> Generator[None, None, float]:
        lasts, found = step_s * _STRETCH_LOOKS, 0
        for start in np.linspace(self._start_s, self._stop_s - lasts, _STRETCHES).tolist():
            for events in self._events(start, start + lasts, step_s):
                found += len(events)
                yield
        return found / (lasts * _STRETCHES)

    def _events(self, start_s: float, stop_s: float, step_s: float) -> Iterator[Values]:
        """Yield, block by block, when it rose through the upper threshold."""
        reached = start_s - step_s * _LOOKS_BACK
        armed, end = self._behind.armed(reached, self._threshold_v), round((stop_s - reached) / step_s)
        for first in range(0, end, _BLOCK):
            begun = reached + first * step_s
            volts = self._behind.volts(begun - step_s, step_s, min(_BLOCK, end - first) + 1)
            times, armed = rises(volts, self._threshold_v, armed=armed)
            events = begun + step_s * (times - 0.5)
            yield events[(events >= start_s) & (events <= stop_s)]


def exactly(behind: _Behind, event_s: float, step_s: float, threshold_v: float) -> float:
    """Return the exact instant at which a signal rose, by finer steps about the event."""
    finer = max(step_s / _FINER, min(_FINEST_S, step_s))
    looks = round(4.0 * step_s / finer)
    begun = event_s - 2.0 * step_s
    times, _ = rises(behind.volts(begun, finer, looks), threshold_v, armed=True)
    return begun + finer * (float(times[0]) + 0.5) if len(times) else event_s


def rises(volts: Values, threshold_v: float, *, armed: bool) -> tuple[Values, bool]:
    """Return where, in steps from the first of them, volts rise through a threshold after they were below minus that.

    `armed` says whether they were below it before; what is returned beside the places says so of the end.
    """
    beyond = np.flatnonzero(np.abs(volts) > threshold_v)
    up = volts[beyond] > 0.0
    before = np.concatenate(([not armed], up[:-1]))
    found = beyond[up & ~before]
    low, high = volts[np.maximum(found - 1, 0)], volts[found]
    ends_armed = not bool(up[-1]) if len(up) else armed
    part = np.where(high > low, (high - threshold_v) / np.where(high > low, high - low, 1.0), 0.0)
    return found - np.clip(part, 0.0, 1.0), ends_armed
