"""The oscilloscope's screen as a picture: grid and traces, nothing else, in the formats of :DISPlay:DATA.

Pixels and colours are chosen (a screen of 1024 by 768 is what the data sheet's XGA means; unverified of the picture).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Generator, Mapping

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

WIDTH, HEIGHT = 1024, 768
COLOURS = ((255, 255, 0), (0, 255, 0), (80, 80, 255), (255, 80, 160), (200, 80, 255))
"""Of the channels and the math trace."""
_GRID = (70, 70, 70)
_LUMINANCE = (0.299, 0.587, 0.114)
_LEVELS = 6
"""Of each of red, green and blue in the palette of an 8-bit picture."""
_GREYS = 256 - _LEVELS**3
_AT_ONCE = 1 << 17
"""Points of a trace that are drawn in one go."""
_BANDS = 16
"""Parts of a picture that are coloured one after the other."""


class PictureStyle(Struct, frozen=True):
    """Style of the picture: palette COL, GRAY or MON; the ink saver makes the background white."""

    palette: str = "COL"
    ink_saver: bool = False


def screenshot(
    traces: Mapping[int, NDArray[np.float64]], kind: str, look: PictureStyle
) -> Generator[None, None, bytes]:
    """Return, after slices of work, a picture of traces by their number from 1.

    Their values run from -0.5 (bottom) to 0.5 (top).
    """
    picture = np.full((HEIGHT, WIDTH, 3), 255 if look.ink_saver else 0, dtype=np.uint8)
    picture[:: HEIGHT // 8, :] = _GRID
    picture[:, :: WIDTH // 10] = _GRID
    for number, trace in traces.items():
        # Draw each column from its lowest to its highest sample, joined to the column before
        rows = np.empty(len(trace), dtype=int)
        for first in range(0, len(trace), _AT_ONCE):
            yield
            heights = (0.5 - trace[first : first + _AT_ONCE]) * (HEIGHT - 1)
            rows[first : first + _AT_ONCE] = np.clip(np.round(heights), 0, HEIGHT - 1)
        if len(rows) < WIDTH:  # the nearest point
            rows = rows[np.arange(WIDTH) * len(rows) // WIDTH]
        columns, (each, more) = np.arange(WIDTH), divmod(len(rows), WIDTH)
        firsts = columns * each + np.minimum(columns, more)
        before = rows[np.maximum(firsts - 1, 0)]
        tops = np.minimum(np.minimum.reduceat(rows, firsts), before)
        bottoms = np.maximum(np.maximum.reduceat(rows, firsts), before)
        yield
        for x, (top, bottom) in enumerate(zip(tops.tolist(), bottoms.tolist(), strict=True)):
            picture[top : bottom + 1, x] = COLOURS[number - 1]
        yield
    bands, packed, packer = [], [], zlib.compressobj(1)
    for band in np.array_split(picture, _BANDS):
        toned = _toned(band, look)
        bands.append(_indexed(toned) if kind == "BMP8" else toned)
        if kind == "PNG":
            packed.append(packer.compress(b"".join(b"\0" + row.tobytes() for row in toned)))
        yield
    return _png([*packed, packer.flush()]) if kind == "PNG" else FORMATS[kind](np.concatenate(bands))


def _toned(picture: NDArray[np.uint8], look: PictureStyle) -> NDArray[np.uint8]:
    if look.palette == "COL":
        return picture
    grey = picture @ np.array(_LUMINANCE)
    if look.palette == "MON":
        paper = 255.0 if look.ink_saver else 0.0
        grey = np.where(np.abs(grey - paper) > 32.0, 255.0 - paper, paper)
    return np.repeat(np.rint(grey).astype(np.uint8)[:, :, None], 3, axis=2)


def _png(packed: list[bytes]) -> bytes:
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    chunks = (_chunk(b"IHDR", header), _chunk(b"IDAT", b"".join(packed)), _chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _bmp(pixels: bytes, palette: bytes, bits: int) -> bytes:
    """Return a Windows bitmap of rows from the bottom up."""
    start = 14 + 40 + len(palette)
    size = struct.pack("<IiiHHIIiiII", 40, WIDTH, HEIGHT, 1, bits, 0, len(pixels), 2835, 2835, len(palette) // 4, 0)
    return struct.pack("<2sIHHI", b"BM", start + len(pixels), 0, 0, start) + size + palette + pixels


def _indexed(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the numbers of colours in the palette: six levels a colour, and a ramp of greys."""
    cube = np.rint(picture * ((_LEVELS - 1) / 255.0)).astype(int) @ np.array((_LEVELS**2, _LEVELS, 1))
    grey = _LEVELS**3 + np.rint(picture[:, :, 0] * ((_GREYS - 1) / 255.0)).astype(int)
    is_grey = (picture[:, :, 0] == picture[:, :, 1]) & (picture[:, :, 1] == picture[:, :, 2])
    return np.asarray(np.where(is_grey, grey, cube), dtype=np.uint8)


def _palette() -> bytes:
    """Return the colours of an 8-bit picture as blue, green, red, 0."""
    steps = [round(level * 255 / (_LEVELS - 1)) for level in range(_LEVELS)]
    cube = [(blue, green, red, 0) for red in steps for green in steps for blue in steps]
    greys = [(round(level * 255 / (_GREYS - 1)),) * 3 + (0,) for level in range(_GREYS)]
    return bytes(value for colour in cube + greys for value in colour)


def _tiff(picture: NDArray[np.uint8]) -> bytes:
    """Return a bilevel TIFF, one strip without compression, 1 being white."""
    bits = np.packbits(picture[:, :, 0] > 127, axis=1).tobytes()
    tags = (
        (256, 4, 1, WIDTH),
        (257, 4, 1, HEIGHT),
        (258, 3, 1, 1),  # bits a sample
        (259, 3, 1, 1),  # not compressed
        (262, 3, 1, 1),  # black is zero
        (273, 4, 1, 8),  # where the strip is
        (277, 3, 1, 1),  # samples a pixel
        (278, 4, 1, HEIGHT),  # rows a strip
        (279, 4, 1, len(bits)),
    )
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    return struct.pack("<2sHI", b"II", 42, 8 + len(bits)) + bits + struct.pack("<H", len(tags)) + entries + bytes(4)


FORMATS: Mapping[str, Callable[[NDArray[np.uint8]], bytes]] = {
    "BMP": lambda picture: _bmp(picture[::-1, :, ::-1].tobytes(), b"", 24),
    "BMP8": lambda picture: _bmp(picture[::-1].tobytes(), _palette(), 8),
    "TIFF": _tiff,
}
"""Formats by the short forms of their words, beside PNG, whose rows are packed as they come."""
