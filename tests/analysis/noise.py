"""Records of each law of noise, made without the code under test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

OVERSAMPLED = 8


def flicker(samples: int, rng: np.random.Generator, *, records: int = 1) -> NDArray[np.float64]:
    """Flicker noise of bias instability 1 as readings see it: means of eight values of 1/f noise by Kasdin and Walter.

    Its filter is h[k] = h[k-1] (k - 1/2) / k; the two-sided density is 1 / (2 pi f), so the Allan variance 2 ln 2 / pi.
    What comes before the record is as long as the record.
    """
    length = 2 * OVERSAMPLED * samples
    k = np.arange(1, length)
    filtered = np.fft.rfft(np.concatenate([[1.0], np.cumprod((k - 0.5) / k)]), 2 * length)
    white = rng.standard_normal((records, length))
    values = np.fft.irfft(filtered * np.fft.rfft(white, 2 * length, axis=1), 2 * length, axis=1)[
        :, length // 2 : length
    ]
    return np.asarray(values.reshape(records, samples, OVERSAMPLED).mean(axis=2))


def random_walk(samples: int, rng: np.random.Generator, *, records: int = 1) -> NDArray[np.float64]:
    """Rate random walk of coefficient 1 as readings see it: means of eight values of the walk."""
    steps = rng.standard_normal((records, OVERSAMPLED * samples)) / np.sqrt(OVERSAMPLED)
    return np.asarray(np.cumsum(steps, axis=1).reshape(records, samples, OVERSAMPLED).mean(axis=2))
