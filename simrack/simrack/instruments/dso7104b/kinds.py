"""Differences between oscilloscopes of the InfiniiVision series, as data."""

from __future__ import annotations

from msgspec import Struct


class ScopeKind(Struct, frozen=True):
    """A model.

    Args:
        name: what ``*IDN?`` calls it.
        identity: what it says around that name.
        screen_points: longest measurement record (:WAVeform:POINts:MODE NORMal).
        record_lengths: what :WAVeform:POINts can be, rising; those up to `screen_points` of the measurement record.
        memory: points with one channel a pair, and with both.
        rate_hz: sample rates likewise.
        decimals: of numbers in replies.
        least_range_v: smallest range of a channel at 1:1.
        limit_hz: corner of the bandwidth limit.
    """

    name: str
    identity: str
    screen_points: int
    record_lengths: tuple[int, ...]
    memory: tuple[int, int]
    rate_hz: tuple[float, float]
    decimals: int
    least_range_v: float
    limit_hz: float


KIND_7000B = ScopeKind(
    "DSO7104B",
    "AGILENT TECHNOLOGIES,{},MY49520121,06.00.0003",
    screen_points=1000,
    record_lengths=(
        *(100, 250, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000, 200_000, 500_000),
        *(1_000_000, 2_000_000, 4_000_000, 8_000_000),
    ),
    memory=(8_000_000, 4_000_000),
    rate_hz=(4e9, 2e9),
    decimals=8,
    least_range_v=0.016,
    limit_hz=25e6,
)
