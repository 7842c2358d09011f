"""Signs that a journal was changed, cut or put together afterwards: none has them by itself, however its run ended.

The journal's own sums are done again: lines are counted, numbers follow each other, bench time goes forwards, a mean is
that of its readings. What they do not find, the sum over all lines in the last one does (`journal`): a run that was cut
has none.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

_WINDOWS = frozenset({"Acquire", "AcquireGapless", "AcquireWithVvc"})
"""Kinds of steps whose point is the mean of their readings."""
_LARGEST = 1e50  # Beyond an overload (9.9e37), and its square is a number
_AFTER_FOOTER = frozenset({"amendment", "signature"})


def first_damage(lines: Sequence[Mapping[str, Any]]) -> str | None:
    """Return the first damage of the complete lines of a journal in words, or None."""
    return next(chain(_ends(lines), _order(lines), _times(lines), _chunks(lines), _means(lines), _count(lines)), None)


def _ends(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Check that there is one header, which comes first, and at most one footer, which comes last."""
    kinds = [line.get("type") for line in lines]
    if kinds and kinds[0] != "header":
        yield "it does not begin with a header"
    for kind in ("header", "footer"):
        if kinds.count(kind) > 1:
            yield f"it has {kinds.count(kind)} {kind}s: several runs in one file"
    if "footer" in kinds:
        later = range(kinds.index("footer") + 1, len(kinds))
        yield from (f"line {each + 1} comes after the footer" for each in later if kinds[each] not in _AFTER_FOOTER)


def _order(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Check that steps are numbered 1, 2, 3 ... without a gap."""
    before = 0
    for place, line in _performed(lines):
        number = line.get("n")
        if type(number) is not int or number != before + 1:
            yield f"line {place} is step {number!r}, {f'after step {before}' if before else 'the first'}"
            return
        before = number


def _times(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Check that bench time goes forwards."""
    before_s = 0.0
    for place, line in _performed(lines):
        for name in ("t_s", "end_s"):
            now_s = line.get(name, before_s)
            is_number = isinstance(now_s, int | float) and not isinstance(now_s, bool) and math.isfinite(now_s)
            if not is_number or now_s < before_s:
                yield f"line {place}: bench time goes back from {before_s:.6g} s to {name} = {now_s!r}"
                return
            before_s = now_s


def _chunks(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Check that the chunks of readings before a step are its own, numbered 1, 2, 3 ..., as many as it tells of."""
    step, chunk = 0, 0
    before_s: dict[object, float] = {}  # of each of several devices
    for place, line in enumerate(lines, start=1):
        kind, number = line.get("type"), line.get("n")
        if kind == "readings":
            if number != step + 1 or line.get("chunk") != chunk + 1:
                after = f"after step {step}" if step else "the first"
                after = f"after chunk {chunk} of step {step + 1}" if chunk else after
                yield f"line {place} is chunk {line.get('chunk')!r} of step {number!r}, {after}"
            for reading in line["readings"]:
                last_s = before_s.get(line.get("device"), -math.inf)
                if reading["t_s"] < last_s:
                    yield f"line {place}: a reading of {reading['t_s']:.6g} s comes after one of {last_s:.6g} s"
                before_s[line.get("device")] = reading["t_s"]
            chunk += 1
        elif kind in ("step", "error"):
            if line.get("chunks", 0) != chunk:
                yield f"line {place}: step {number!r} has {chunk} chunks of readings, not {line.get('chunks', 0)!r}"
            step, chunk, before_s = number if type(number) is int else step, 0, {}


def _means(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Check that the point of a window is the mean of its readings, in chunks before it or in its own line."""
    chunked: list[Mapping[str, float]] = []
    for place, line in enumerate(lines, start=1):
        if line.get("type") == "readings":
            chunked += line["readings"]
        if line.get("type") not in ("step", "error"):
            continue
        readings, chunked = [*chunked, *own_readings(line)], []
        if any(abs(value) > _LARGEST for reading in readings for value in reading.values()):
            yield f"line {place}: one of its readings is above {_LARGEST:g}, which no instrument reports"
        if line.get("step_kind") not in _WINDOWS or "point" not in line or "result" not in line:
            continue
        point = line["point"]
        if len(readings) != point["n"]:
            yield f"line {place}: a point of {point['n']} readings has {len(readings)}"
            continue
        for name, column in (("output_v", "voltage_v"), ("v_vc_measured_v", "v_vc_v")):
            volts = [reading[column] for reading in readings] if name in point else [0.0]
            mean_v = math.fsum(volts) / len(volts)
            if name in point and not math.isclose(point[name], mean_v, rel_tol=1e-9, abs_tol=1e-12):
                yield f"line {place}: the point's {point[name]!r} V is not the mean of its readings"


def own_readings(line: Mapping[str, Any]) -> Sequence[Mapping[str, float]]:
    """Return the readings in the line of a step itself, or of one that failed."""
    readings: Sequence[Mapping[str, float]] = line.get("readings") or line.get("result", {}).get("readings", ())
    return readings


def _count(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Check that there are as many points as the footer counts."""
    points = sum("point" in line for line in lines if line.get("type") == "step")
    for line in lines:
        if line.get("type") == "footer" and line.get("points", points) != points:
            yield f"its footer counts {line['points']!r} points, there are {points}"


def _performed(lines: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield the lines of steps, performed or failed, with their numbers in the file."""
    return ((place, line) for place, line in enumerate(lines, start=1) if line.get("type") in ("step", "error"))
