"""Pictures of the screen, taken apart by readers that share nothing with the writer."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np
import pytest

from simrack_tests.instruments.dso7104b.bench import Bench

if TYPE_CHECKING:
    from numpy.typing import NDArray

WIDTH, HEIGHT = 1024, 768
YELLOW, GREEN = (255, 255, 0), (0, 255, 0)
ROW_OF_A_QUARTER_VOLT = round((0.5 - 0.25 / 4) * (HEIGHT - 1))
"""0.25 V of 4 V above the middle."""


def png(data: bytes) -> NDArray[np.uint8]:
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II5B", data[16:29]) == (WIDTH, HEIGHT, 8, 2, 0, 0, 0)
    start = data.index(b"IDAT") + 4
    (size,) = struct.unpack(">I", data[start - 8 : start - 4])
    packed = data[start : start + size]
    assert struct.unpack(">I", data[start + size : start + size + 4]) == (zlib.crc32(b"IDAT" + packed),)
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(HEIGHT, 1 + 3 * WIDTH)
    assert not rows[:, 0].any()
    return rows[:, 1:].reshape(HEIGHT, WIDTH, 3)


def bmp(data: bytes) -> NDArray[np.uint8]:
    kind, size, _, start, header, width, height, planes, bits, packing = struct.unpack("<2sIIIIiiHHI", data[:34])
    assert (kind, size, header, width, height, planes, packing) == (b"BM", len(data), 40, WIDTH, HEIGHT, 1, 0)
    pixels = np.frombuffer(data[start:], np.uint8)
    if bits == 24:
        return pixels.reshape(HEIGHT, WIDTH, 3)[::-1, :, ::-1]
    assert bits == 8
    palette = np.frombuffer(data[54:start], np.uint8).reshape(256, 4)
    return palette[pixels.reshape(HEIGHT, WIDTH)[::-1]][:, :, 2::-1]


def tiff(data: bytes) -> NDArray[np.bool_]:
    order, magic, place = struct.unpack("<2sHI", data[:8])
    assert (order, magic) == (b"II", 42)
    (count,) = struct.unpack("<H", data[place : place + 2])
    tags = {}
    for index in range(count):
        tag, kind, number, value = struct.unpack("<HHII", data[place + 2 + 12 * index : place + 14 + 12 * index])
        assert kind in {3, 4}
        assert number == 1
        tags[tag] = value
    assert list(tags) == sorted(tags)
    assert (tags[256], tags[257], tags[258], tags[259], tags[277], tags[278]) == (WIDTH, HEIGHT, 1, 1, 1, HEIGHT)
    strip = np.frombuffer(data[tags[273] : tags[273] + tags[279]], np.uint8)
    return np.unpackbits(strip.reshape(HEIGHT, WIDTH // 8), axis=1).astype(bool)


def picture(bench: Bench, asked: str) -> bytes:
    reply = bench.raw(f":DISP:DATA? {asked}")
    assert reply[:2] == b"#8"
    assert int(reply[2:10]) == len(reply) - 11
    return reply[10:-1]


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.send(":CHAN3:RANG 4;:TIM:RANG 1E-3;:HARD:INKS OFF;:DIG CHAN3")
    return bench


@pytest.mark.parametrize(
    ("kind", "read"), [("PNG,SCR,COL", png), ("BMP,SCREEN,COLOR", bmp), ("BMP8bit,SCR,COL", bmp), ("", png)]
)
def test_a_colour_picture_shows_the_trace_where_its_voltage_is(bench: Bench, kind: str, read: object) -> None:
    assert callable(read)
    column = read(picture(bench, kind))[:, 533]
    blue = (80, 80, 255)
    near = np.abs(column.astype(int) - blue).max(axis=1) <= 26  # six levels a colour in eight bits
    assert np.flatnonzero(near).tolist() == [ROW_OF_A_QUARTER_VOLT]


def test_all_formats_of_one_screen_show_the_same(bench: Bench) -> None:
    full = png(picture(bench, "PNG,SCR,COL"))
    assert (bmp(picture(bench, "BMP,SCR,COL")) == full).all()
    assert np.abs(bmp(picture(bench, "BMP8bit,SCR,COL")).astype(int) - full).max() <= 26
    grey = png(picture(bench, "PNG,SCR,GRAY"))
    assert (grey == np.rint(full @ (0.299, 0.587, 0.114)).astype(int)[:, :, None]).all()
    assert (bmp(picture(bench, "BMP8bit,SCR,GRAY")).astype(int) - grey).max() <= 4
    two_tones = tiff(picture(bench, "TIFF,GRAT,MON"))
    assert (two_tones == (grey[:, :, 0] > 32)).all()


def test_the_ink_saver_makes_the_paper_white(bench: Bench) -> None:
    assert (png(picture(bench, "PNG"))[100, 50] == 0).all()
    bench.send(":HARD:INKS ON")
    page = png(picture(bench, "PNG"))
    assert (page[100, 50] == 255).all()
    assert (page[ROW_OF_A_QUARTER_VOLT, 533] == (80, 80, 255)).all()


@pytest.mark.parametrize("asked", ["TIFF,SCR", "TIFF,GRAT,COL"])
def test_a_tiff_is_a_graticule_in_two_tones(bench: Bench, asked: str) -> None:
    bench.send(f":DISP:DATA? {asked}")
    assert bench.errors() == [-221]


def test_channels_and_the_math_trace_have_their_colours() -> None:
    bench = Bench()
    bench.send(":HARD:INKS OFF;:CHAN1:RANG 16;:CHAN2:RANG 16;:CHAN1:OFFS 4;:CHAN2:OFFS -4;:TIM:RANG 1E-3")
    bench.send(":FUNC:OPER SUBT;SOUR1 CHAN3;SOUR2 CHAN3;RANG 16;OFFS -2;:DIG CHAN1,CHAN2,FUNC")
    page = png(picture(bench, "PNG"))
    rows = {colour: np.flatnonzero((page[:, 333] == colour).all(axis=1)) for colour in (YELLOW, GREEN, (200, 80, 255))}
    # channel 1 about -4 V of 16 V below the centre, channel 2 as much above it; 0 V of the math trace at +2 V of 16 V
    assert HEIGHT * 0.6 < rows[YELLOW].min() <= rows[YELLOW].max() < HEIGHT * 0.9
    assert HEIGHT * 0.05 < rows[GREEN].min() <= rows[GREEN].max() < HEIGHT * 0.4
    assert rows[200, 80, 255].tolist() == [round(0.375 * (HEIGHT - 1))]
