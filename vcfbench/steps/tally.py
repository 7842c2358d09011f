"""Count, mean and scatter of readings that come chunk by chunk: all that stays of a long window in memory."""

import math
from collections.abc import Sequence

from msgspec import Struct


class Tally(Struct):
    """Sums over chunks of readings: those within a chunk exact, chunks joined without a difference of large numbers.

    `squares_v2` is the sum of squares about the mean of all readings (V^2), `within_v2` that about the mean of each
    chunk. Joined as in Chan, Golub and LeVeque, "Algorithms for computing the sample variance", Am. Stat. 37 (1983).
    """

    chunks: int = 0
    count: int = 0
    mean_v: float = 0.0
    squares_v2: float = 0.0
    within_v2: float = 0.0

    def add(self, readings_v: Sequence[float]) -> None:
        """Take one chunk, V; an empty one is none."""
        count = len(readings_v)
        if count == 0:
            return
        mean_v = math.fsum(readings_v) / count
        squares_v2 = math.fsum([(reading_v - mean_v) ** 2 for reading_v in readings_v])
        self.within_v2 += squares_v2
        if self.count == 0:
            self.mean_v, self.squares_v2 = mean_v, squares_v2
        else:
            apart_v = mean_v - self.mean_v
            weight = count / (self.count + count)
            self.mean_v += apart_v * weight
            self.squares_v2 += squares_v2 + apart_v**2 * weight * self.count
        self.count += count
        self.chunks += 1

    @property
    def std_v(self) -> float:
        """Sample standard deviation (n - 1) of all readings, V."""
        return math.sqrt(self.squares_v2 / max(1, self.count - 1))

    @property
    def within_std_v(self) -> float:
        """Standard deviation of one reading within its chunk, V: without the drift from chunk to chunk."""
        return math.sqrt(self.within_v2 / max(1, self.count - self.chunks))
