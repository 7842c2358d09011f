"""Figures as pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import matplotlib as mpl
import pytest
from simrack_tests.cells import few

from tests.reports.test_text import FIGURE
from vcfbench.errors import ConfigError
from vcfbench.reports.document import Axis, Figure, Series
from vcfbench.reports.plot import PALETTE, caption_of, save_figure, svg_of

if TYPE_CHECKING:
    from pathlib import Path

RATE, OUTPUT = Axis("rate", "deg/s"), Axis("output", "V")
LOG = Axis("averaging time", "s", "log"), Axis("Allan deviation", "deg/h", "log")


def words_of(svg: str) -> list[str]:
    return ["".join(each.itertext()) for each in ET.fromstring(svg).iter() if each.tag.endswith("text")]  # noqa: S314  # ours


def test_a_figure_is_an_element_with_its_words_as_words() -> None:
    svg = svg_of(FIGURE)
    assert svg.startswith("<svg ")
    assert {"rate / (°/s)", "output / V"} <= set(words_of(svg))
    assert "metadata" not in svg
    assert "Matplotlib" not in svg


def test_figure_has_same_bytes_for_any_user_setting() -> None:
    first = svg_of(FIGURE)
    with mpl.rc_context({"font.size": 30.0, "axes.grid": True, "lines.linewidth": 9.0}):
        assert svg_of(FIGURE) == first
    assert mpl.rcParams["svg.hashsalt"] is None


def test_names_of_a_picture_are_its_own() -> None:
    one, other = (ET.fromstring(svg_of(FIGURE, name)) for name in ("one", "other"))  # noqa: S314  # ours
    ids = [{each.get("id") for each in tree.iter()} - {None} for tree in (one, other)]
    assert ids[0]
    assert ids[0].isdisjoint(ids[1])


def test_line_has_colour_of_its_points() -> None:
    line = Series("table, least-squares line", [0.0, 1.0], [0.0, 1.0], kind="line")
    points = [Series(name, [0.0, 1.0], [0.0, 1.0], [0.1, 0.1]) for name in ("table", "virtual")]
    svg = svg_of(Figure("both", RATE, OUTPUT, [points[0], line, points[1]]))
    assert PALETTE[0] in svg
    assert PALETTE[1] in svg
    assert PALETTE[2] not in svg


@pytest.mark.exhaustive
def test_logarithmic_axes_have_plain_numbers_and_bands_are_drawn() -> None:
    band = Series("Allan", [1.0, 10.0, 1000.0], [3.0, 2.0, 5.0], low=[2.0, 1.0, 1.0], high=[4.0, 5.0, 40.0])
    figure = Figure("Allan", *LOG, [band])
    assert {"1", "10", "100", "1000"} <= set(words_of(svg_of(figure)))
    assert "fill-opacity: 0.18" in svg_of(figure)


def test_words_with_signs_of_formulas_are_words() -> None:
    figure = Figure(
        "$\\alpha", Axis("a $x_1$ <b>"), OUTPUT, [Series("$$", [1.0], [2.0], kind="bars"), FIGURE.series[0]]
    )
    assert {"a $x_1$ <b>", "$$"} <= set(words_of(svg_of(figure)))


@pytest.mark.exhaustive
def test_extremes_of_many_values_are_drawn_and_captioned(tmp_path: Path) -> None:
    spike = [0.0] * 50_000
    spike[33_333] = 7.0
    figure = Figure("long", Axis("time", "s"), OUTPUT, [Series("raw", range(50_000), spike, kind="line")], "At rest.")
    assert len(svg_of(figure)) < 60_000
    assert "7" in words_of(svg_of(figure))  # the axis reaches it
    assert caption_of(figure) == (
        "At rest. raw: 50000 values; drawn are the least and the greatest in each of 800 columns."
    )
    assert caption_of(FIGURE) == ""
    save_figure(figure, tmp_path / "long.svg")
    assert "long" in words_of((tmp_path / "long.svg").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("name", "begins"), few([("f.png", b"\x89PNG"), ("f.svg", b"<?xml"), ("f.pdf", b"%PDF")], ("f.svg", b"<?xml"))
)
def test_figure_file_has_kind_of_its_suffix(name: str, begins: bytes, tmp_path: Path) -> None:
    save_figure(FIGURE, tmp_path / name)
    written = (tmp_path / name).read_bytes()
    assert written.startswith(begins)
    save_figure(FIGURE, tmp_path / name)
    assert (tmp_path / name).read_bytes() == written


def test_a_name_that_says_no_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no picture can be written"):
        save_figure(FIGURE, tmp_path / "f.xyz")
