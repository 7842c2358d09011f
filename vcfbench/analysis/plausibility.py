"""Faults visible in a record at rest or a table, each with row and size; the data stay unchanged.

Limits are such that clean noise of any kind that sensors have (white, flicker, walks, held, filtered, quantised) says
nothing, and faults are told well before they move a result by its uncertainty (`tests/analysis/test_plausibility.py`).
"""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.digit import decimal_digit, least_step
from vcfbench.analysis.regression import LineFit

_FAR: Final = 8.0
"""Robust standard deviations from the neighbours beyond which a reading, or a block, is no noise."""
_SAMPLE: Final = 200_000
_PIECE: Final = 1 << 17
_BLOCKS: Final = 200
_SCALES: Final = (1, 2, 4, 8)
"""Blocks whose means are held against each other: long ones show small steps, none of them a warm-up."""
_NEARLY: Final = 0.9
_AROUND: Final = 256
_RUN: Final = 20
_HELD: Final = 0.9
_OFTEN: Final = 3.0
"""Readings from one change to the next of a sensor of which it can be said that it is stuck."""
_PILED: Final = 8
_LEVELS: Final = 1000
_COARSE: Final = 5
"""A sensor that shows no more levels in so many readings is coarse: what it shows most may be its extreme."""
_FEW: Final = 5
_GAP: Final = 0.12
"""Part of the range of a record that noise never leaves empty between more than a few readings."""
_LEVELS_APART: Final = 2.5
_REST_DEG_S: Final = 30.0
"""Beyond that no gyroscope at rest reads (ours)."""
_MAD: Final = 1.4826
_LEFT: Final = 0.1
_LEAST_POINTS: Final = 6
_CHANCE: Final = 1e-5
_DIGITS: Final = 2.0
"""Last digits by which rounding, and noise of less than one, put a point off a line."""


class Doubt(Struct, frozen=True):
    """Something that is no noise: the row at which it is first seen, from 0, and its description."""

    row: int
    words: str


def doubts_of_record(rates_deg_s: Floats) -> list[Doubt]:
    """Return the features of a record at rest, deg/s, shape (n,), that no sensor at rest gives."""
    if rates_deg_s.size < _RUN or np.ptp(rates_deg_s) == 0.0:
        return []
    mean = float(rates_deg_s.mean())
    found = [*_far_ones(rates_deg_s), *_repeated(rates_deg_s), *_piled_up(rates_deg_s), *_moved(rates_deg_s)]
    found += _parted(rates_deg_s)
    if not found:
        found += [*_burst(rates_deg_s), *_restless(rates_deg_s)]
    if abs(mean) > _REST_DEG_S:
        found.append(Doubt(0, f"a mean of {mean:.3g} deg/s: check its unit, and that it was at rest"))
    return found


def _far_ones(rates: Floats) -> Iterator[Doubt]:
    """Yield single readings, or edges, that are far from both neighbours."""
    sample = rates[:_SAMPLE]
    bent = sample[1:-1] - 0.5 * (sample[:-2] + sample[2:])
    bent = np.abs(bent[bent != 0.0])
    if not bent.size:
        return
    limit = max(_FAR * _MAD * float(np.median(bent)), 2.0 * least_step(rates))
    count, first, largest = 0, 0, 0.0
    for begin in range(0, rates.size - 2, _PIECE):
        part = rates[begin : begin + _PIECE + 2]
        off = np.abs(part[1:-1] - 0.5 * (part[:-2] + part[2:]))
        far = np.flatnonzero(off > limit)
        if far.size:
            first = first if count else begin + 1 + int(far[off[far[:3]].argmax()])
            count, largest = count + far.size, max(largest, float(off[far].max()))
    if count:
        times = largest / (limit / _FAR)
        yield Doubt(
            first,
            f"{count} readings far from their neighbours, the largest by {largest:.3g} deg/s, {times:.0f} standard "
            "deviations: a glitch, a wrap, a knock",
        )


def _repeated(rates: Floats) -> Iterator[Doubt]:
    """Yield a sensor that was stuck, or each value that stands several times."""
    repeats = np.flatnonzero(rates[1:] == rates[:-1])
    if not repeats.size:
        return
    begins = np.flatnonzero(np.diff(repeats, prepend=-2) > 1)
    lengths = 1 + np.diff(begins, append=repeats.size)
    runs = rates.size - repeats.size  # those of one reading too
    inner = lengths[1:-1] if lengths.size > 2 else lengths
    usual = int(np.median(inner))
    held = runs > _RUN and int(np.count_nonzero(lengths == usual)) > _HELD * runs
    if held:
        yield Doubt(0, f"each value stands {usual} times: the log is faster than the sensor")
    longest = int(lengths.argmax())
    others = (rates.size - int(lengths[longest])) / max(1, runs - 1)
    if (held or others < _OFTEN) and lengths[longest] > max(_RUN, 3.0 * others * math.log(rates.size)):
        row = int(repeats[begins[longest]])
        yield Doubt(row, f"{lengths[longest]} readings in a row are the same: stuck, or lost and filled in")


def _piled_up(rates: Floats) -> Iterator[Doubt]:
    """Yield readings that stand on an extreme more often than on the value beside it."""
    if len(set(rates[:_LEVELS].tolist())) <= _COARSE:
        return
    for what, extreme, none in (("largest", np.max, -np.inf), ("least", np.min, np.inf)):
        value = extreme(rates)
        top = np.flatnonzero(rates == value)
        if top.size < _PILED:
            continue
        beside = np.count_nonzero(rates == extreme(rates, where=rates != value, initial=none))
        if top.size > 3 * beside:
            yield Doubt(int(top[0]), f"{top.size} readings are the {what}, {value:.6g} deg/s: clipped, or saturated")


def _parted(rates: Floats) -> Iterator[Doubt]:
    """Yield two groups of readings with nothing between them, between which the record goes to and fro."""
    ordered = np.sort(rates[:_SAMPLE])
    inner = np.diff(ordered[_FEW - 1 : ordered.size - _FEW + 1])
    if not inner.size:
        return
    at = int(inner.argmax())
    apart, middle = float(inner[at]), 0.5 * float(ordered[at + _FEW - 1] + ordered[at + _FEW])
    if apart <= _GAP * float(np.ptp(rates)) or apart <= _LEVELS_APART * least_step(rates):
        return
    above = rates > middle
    crossed = np.flatnonzero(above[1:] != above[:-1])
    if crossed.size >= _FEW:
        words = f"{crossed.size} jumps of {apart:.3g} deg/s without a reading between: wrapped, or two states"
        yield Doubt(int(crossed[0]) + 1, words)


def _moved(rates: Floats) -> Iterator[Doubt]:
    """Yield a step, or a motion: means over some blocks that are far from those over as many blocks before."""
    length = max(8, rates.size // _BLOCKS)
    ends = np.concatenate([[0.0], np.cumsum(_blocks(rates, length).mean(axis=1))])
    for several in _SCALES:
        if ends.size < _RUN * several:
            return
        steps = (ends[2 * several :] - 2.0 * ends[several:-several] + ends[: -2 * several]) / several
        steps -= np.median(steps)
        spread = _MAD * float(np.median(np.abs(steps)))
        size = np.abs(steps)
        if spread > 0.0 and size.max() > max(_FAR * spread, 2.0 * least_step(rates)):
            largest = int(np.argmax(size > _NEARLY * size.max()))  # both edges of a motion are as large
            yield Doubt(
                (largest + several) * length,
                f"the mean of {several * length} readings moves by {size[largest]:.3g} deg/s, "
                f"{size[largest] / spread:.0f} times the usual: a step, or motion",
            )
            return


def _burst(rates: Floats) -> Iterator[Doubt]:
    """Yield readings that are far from the median of those around them, be they several in a row."""
    sample = _blocks(rates[:_SAMPLE], min(_AROUND, rates.size))
    usual = _MAD * float(np.median(np.abs(sample - np.median(sample, axis=1)[:, None])))
    if usual == 0.0:
        return
    blocks = _blocks(rates, sample.shape[1])
    spans = blocks.max(axis=1) - blocks.min(axis=1)  # what is far from the median makes a span that is as wide
    least, count, first, size = 2.0 * least_step(rates), 0, 0, 0.0
    for row in np.flatnonzero(spans > max(_FAR * usual, least)).tolist():
        off = np.abs(blocks[row] - np.median(blocks[row]))
        far = np.flatnonzero(off > max(_FAR * max(usual, _MAD * float(np.median(off))), least))
        if far.size:
            first, size = (first, size) if count else (row * off.size + int(far[0]), float(off[far[0]]))
            count += far.size
    if count:
        yield Doubt(first, f"{count} readings far from those around them, the first by {size:.3g} deg/s: a burst")


def _restless(rates: Floats) -> Iterator[Doubt]:
    """Yield a part of the record whose readings scatter more, or less, than those of all others."""
    length = max(_RUN, rates.size // (_BLOCKS // 2))
    scatter = np.array([block.std() for block in _blocks(rates, length)])
    if scatter.size < _RUN or not scatter.all():
        return
    usual = float(np.median(scatter))
    off = np.abs(np.log(scatter / usual))
    spread = max(_MAD * float(np.median(off)), math.sqrt(0.5 / length))
    far = np.flatnonzero(off > _FAR * spread)
    if far.size:
        worst = int(off.argmax())
        yield Doubt(
            int(far[0]) * length,
            f"{length} readings scatter by {scatter[worst]:.3g} deg/s, the others by {usual:.3g}: a disturbance, "
            "or another range",
        )


def _blocks(rates: Floats, length: int) -> Floats:
    """Return the record in rows of so many readings, without a rest at its end."""
    return rates[: rates.size // length * length].reshape(-1, length)


def doubts_of_line(rate_deg_s: Floats, output: Floats, line: LineFit, u_scale_factor: float) -> list[Doubt]:
    """Return the features of points of a calibration, shape (n,), that no gyroscope within its range gives."""
    found, residuals = [], np.abs(line.residuals_v)
    if abs(line.scale_factor) < 3.0 * u_scale_factor:
        found.append(
            Doubt(0, "the scale factor is not beyond its own uncertainty: check that the output follows the rate")
        )
    span = abs(line.scale_factor) * float(np.ptp(rate_deg_s))
    worst = int(residuals.argmax())
    if residuals[worst] > _LEFT * span:
        share = 100.0 * residuals[worst] / span
        found.append(Doubt(worst, f"a point is {share:.0f} % of the span off the line: clipped, wrapped, or misread"))
    elif (row := _stray(rate_deg_s, output)) is not None:
        found.append(Doubt(row, f"a point is {residuals[row]:.3g} off the line, far beyond what the others scatter"))
    order = np.argsort(rate_deg_s, kind="stable")
    for ends in (order[:2], order[-2:]):
        apart = abs(float(rate_deg_s[ends[1]] - rate_deg_s[ends[0]])) * abs(line.scale_factor)
        if output[ends[0]] == output[ends[1]] and apart > 0.01 * span:
            found.append(Doubt(int(ends[1]), "the outputs at the two largest rates are the same: saturated"))
    return found


def _stray(rate: Floats, output: Floats) -> int | None:
    """Return the point that a fit of the others misses far beyond their scatter, None if none is.

    At an end of the rates alone the curve may bend: there the fit has a square, a cube and an asymmetry beside the line
    (the turntable's points of the paper miss their line most at both ends).
    """
    if rate.size < _LEAST_POINTS:
        return None
    x = (rate - rate.mean()) / np.ptp(rate)
    row = far_off(np.column_stack([np.ones_like(x), x]), output)
    if row is None or rate.min() < rate[row] < rate.max():
        return row
    bent = np.column_stack([np.ones_like(x), x, x**2, x**3, np.abs(rate)])
    return row if far_off(bent, output) == row else None


def far_off(columns: Floats, output: Floats) -> int | None:
    """Return the row whose deleted residual, studentised, is the largest, if chance does not make one so large."""
    from scipy.special import stdtrit  # noqa: PLC0415 - SciPy costs more to import than all the rest

    size, dof = len(columns), len(columns) - columns.shape[1] - 1
    basis = np.linalg.qr(columns)[0]
    keeps = np.maximum(1.0 - (basis**2).sum(axis=1), 1e-9)
    left = output - basis @ (basis.T @ output)
    whole = float(left @ left)
    if dof < 1 or not whole > (1e-12 * float(np.abs(output).max())) ** 2:
        return None
    ratio = np.abs(left) / np.sqrt(np.maximum(whole * keeps - left**2, 1e-12 * whole) / dof)
    row = int(ratio.argmax())
    if abs(left[row]) <= _DIGITS * decimal_digit(output):  # the others may have met their digits
        return None
    return row if ratio[row] > float(stdtrit(dof, 1.0 - _CHANCE / size)) else None
