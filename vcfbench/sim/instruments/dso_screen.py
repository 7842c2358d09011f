"""The oscilloscope's screen as a picture: grid and traces, nothing else."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

__all__ = ["screenshot"]

WIDTH, HEIGHT = 640, 480
_COLOURS = ((255, 255, 0), (0, 255, 0), (80, 80, 255), (255, 80, 160))
_GRID = (70, 70, 70)


def screenshot(traces: Sequence[NDArray[np.float64]]) -> bytes:
    """Return a PNG of traces whose values run from -0.5 (bottom) to 0.5 (top)."""
    picture = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    picture[:: HEIGHT // 8, :] = _GRID
    picture[:, :: WIDTH // 10] = _GRID
    for trace, colour in zip(traces, _COLOURS, strict=False):
        _draw(picture, trace, colour)
    return _png(picture)


def _draw(picture: NDArray[np.uint8], trace: NDArray[np.float64], colour: tuple[int, int, int]) -> None:
    """Draw each column from its lowest to its highest sample, joined to the column before."""
    columns = np.array_split(np.clip(np.round((0.5 - trace) * (HEIGHT - 1)), 0, HEIGHT - 1).astype(int), WIDTH)
    last = int(columns[0][0])
    for x, rows in enumerate(columns):
        top, bottom = min(int(rows.min()), last), max(int(rows.max()), last)
        picture[top : bottom + 1, x] = colour
        last = int(rows[-1])


def _png(picture: NDArray[np.uint8]) -> bytes:
    rows = b"".join(b"\0" + row.tobytes() for row in picture)
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    chunks = (_chunk(b"IHDR", header), _chunk(b"IDAT", zlib.compress(rows)), _chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
