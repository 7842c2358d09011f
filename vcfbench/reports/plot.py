"""Figures of a report as pictures: SVG for pages, or a file of any kind that Matplotlib writes.

The same figure gives the same bytes: no dates, no names of versions, and nothing of what a user set for Matplotlib.
"""

import re
from collections.abc import Sequence
from importlib import import_module
from io import BytesIO, StringIO
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vcfbench.analysis.regression import LineFit, line_so_far
from vcfbench.errors import ConfigError
from vcfbench.files import replaced, shown
from vcfbench.records.schema import Point
from vcfbench.reports.document import Axis, Figure, Series
from vcfbench.reports.typography import in_unicode, marked_up_in_svg

INK: Final = "#20262e"
"""Colour of axes and words; pages replace it by their own."""
GRID: Final = "#d4d8de"
PALETTE: Final = ("#0068ab", "#c8500a", "#008060", "#a8428a", "#8a6d00", "#5b5fc7")
"""Colours of the series, apart for the colour-blind as well; pages lighten them on dark ground."""

_MARKS: Final = {"points": "o", "line": "-"}
_SIZE_IN: Final = (6.0, 3.0)  # As wide as text, and small: words are still read when a telephone shows it across
FLAT_IN: Final = (7.2, 2.6)  # As wide as a printed page's text, so that a first page has room for it
_STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "text.parse_math": False,
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "legend.fontsize": 9.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": GRID,
    "axes.unicode_minus": False,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.markersize": 5.0,
    "legend.frameon": False,
}
_METADATA: Final = {
    "svg": dict.fromkeys(("Date", "Creator", "Format", "Type")),
    "pdf": dict.fromkeys(("CreationDate", "Creator", "Producer")),
    "png": {"Software": None},
}
COLUMNS: Final = 800
"""About as many as a drawing is wide in points of a screen: values closer together show as one line upright."""

DRAWN: Final = f"drawn are the least and the greatest in each of {COLUMNS} columns."
"""Words of a caption for a series that is drawn so."""

_WORDS: Final = re.compile(r"(?<=>)[^<>]+(?=</text>)")
_ID: Final = re.compile(r'(?<=\bid=")[^"]+|(?<=xlink:href="#)[^"]+|(?<=url\(#)[^)]+')


def svg_of(figure: Figure, name: str = "figure", size_in: tuple[float, float] = _SIZE_IN) -> str:
    """Return `figure` as an ``<svg>`` element with words as words; `name` keeps its ids apart on a page.

    Bars of error are U = 2 u. `size_in` is width and height, inch.
    """
    text = StringIO()
    with _settings(name):
        drawing = _drawing(figure, size_in, titled=False)
        drawing.savefig(text, format="svg", metadata=_METADATA["svg"], transparent=True)
    svg = text.getvalue()
    svg = re.sub(r"<(metadata|style)\b.*?</\1>\s*", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = svg.replace("<svg ", '<svg style="stroke-linejoin:round;stroke-linecap:butt" ', 1)  # what its style was
    svg = _WORDS.sub(lambda found: marked_up_in_svg(found[0]), svg)
    return _ID.sub(lambda found: f"{name}-{found[0]}", svg).strip()


def save_figure(figure: Figure, path: Path) -> None:
    """Draw `figure` into a file of the kind of its suffix: ``.png``, ``.svg``, ``.pdf``. Bars of error are U = 2 u.

    Raises:
        ConfigError: no such suffix is known, or the file cannot be written.
    """
    with _settings(path.stem):
        drawing = _drawing(figure, _SIZE_IN, titled=True)
        kind = path.suffix[1:].lower()
        try:
            drawing.savefig(data := BytesIO(), format=kind, dpi=200, metadata=_METADATA.get(kind))
        except ValueError as error:
            raise ConfigError(f"{shown(path)}: no picture can be written: {error}") from error
    with replaced(path) as draft:
        draft.write_bytes(data.getbuffer())


def line_of(points: Sequence[Point], step: int) -> tuple[list[int], LineFit | None]:
    """Return the places of the points of a step, and the line through them; None with less than three rates.

    Args:
        points: those of a run so far, each step of which is a calibration with a line of its own.
        step: that of the points.
    """
    numbers = [number for number, each in enumerate(points) if each.step == step]
    of_step = [points[number] for number in numbers]
    return numbers, line_so_far([each.rate_deg_s for each in of_step], [each.output_v for each in of_step])


def thinned(
    x: Sequence[float] | NDArray[np.float64], y: Sequence[float] | NDArray[np.float64], columns: int = COLUMNS
) -> tuple[list[float], list[float]] | None:
    """Return least and greatest `y` of each of some equal columns along `x`, where it begins; None for few values.

    No spike is lost; an empty column gives nothing. Values are a record only where `x` does not fall; where it does,
    they are drawn one by one.
    """
    if len(x) <= 4 * columns:
        return None
    along, values = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if along[-1] <= along[0] or np.any(along[1:] < along[:-1]):
        return None
    edges = np.linspace(along[0], along[-1], columns, endpoint=False)
    begins = np.unique(np.searchsorted(along, edges))
    extremes = np.column_stack([np.minimum.reduceat(values, begins), np.maximum.reduceat(values, begins)])
    return np.repeat(along[begins], 2).tolist(), extremes.ravel().tolist()


def caption_of(figure: Figure) -> str:
    """Return the words below `figure`: its caption, and which series are not drawn value by value."""
    thin = [
        f"{each.label}: {len(each.x)} values; {DRAWN}" for each in figure.series if thinned(each.x, each.y) is not None
    ]
    known = {each.label: {float(f"{2.0 * u:.2g}") for u in each.u_y} for each in figure.series if each.u_y}
    # where all are the same they are said too: bars may be smaller than their marks
    sizes = [f"{label} {u.pop():g} {figure.y.unit}" for label, u in known.items() if len(u) == 1]
    bars = [f"Bars are U = 2 u{': ' if sizes else ''}{', '.join(sizes)}."] if known else []
    return " ".join([*([figure.caption] if figure.caption else []), *bars, *thin])


def matplotlib() -> Any:
    """Return Matplotlib; ConfigError where it does not load for the sake of its own settings."""
    try:
        for part in ("figure", "ticker"):  # it takes a while, and figures alone need it
            import_module(f"matplotlib.{part}")
        mpl = import_module("matplotlib")
    except ValueError as error:
        raise ConfigError(f"Matplotlib does not load: {error}", hint="is MPLBACKEND one that it knows?") from error
    return mpl


def _settings(salt: str) -> Any:
    """Return a context in which Matplotlib has its defaults, but for settings that make the same bytes each time."""
    mpl = matplotlib()
    plain: dict[Any, Any] = {key: each for key, each in mpl.rcParamsDefault.items() if not key.startswith("backend")}
    return mpl.rc_context({**plain, **_STYLE, "svg.hashsalt": salt})


def _drawing(figure: Figure, size_in: tuple[float, float], *, titled: bool) -> Any:
    mpl = matplotlib()
    drawing, ticker = mpl.figure.Figure(figsize=size_in, layout="constrained"), mpl.ticker
    axes = drawing.subplots()
    axes.set(
        xlabel=in_unicode(figure.x.title),
        ylabel=in_unicode(figure.y.title),
        xscale=figure.x.scale,
        yscale=figure.y.scale,
    )
    if titled:
        axes.set_title(in_unicode(figure.title))
    colours = cycle(PALETTE)
    chosen: dict[str, str] = {}
    for series in figure.series:
        # a line through points has their colour: it is called after them
        same = [colour for label, colour in chosen.items() if series.label.startswith(f"{label}, ")]
        chosen[series.label] = same[0] if same else next(colours)
        _draw(axes, series, chosen[series.label])
    axes.grid(visible=True, linewidth=0.6)
    drawn: tuple[tuple[Any, Axis], ...] = ((axes.xaxis, figure.x), (axes.yaxis, figure.y))
    for axis, described in drawn:
        if described.scale == "linear":
            axis.get_major_formatter().set_useOffset(False)  # nobody adds up numbers at a corner
            axis.get_major_formatter().set_scientific(False)
        else:  # numbers as people write them, 0.01, 1, 100; of a short axis those between as well
            low, high = axis.get_view_interval()
            axis.set_major_formatter(ticker.StrMethodFormatter("{x:g}"))
            if high < 100.0 * low:
                axis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0) if high > 4.0 * low else "all"))
            axis.set_minor_formatter(ticker.StrMethodFormatter(""))
    if len(figure.series) > 1:
        drawing.legend(loc="outside lower left", ncols=min(len(figure.series), 2))
    return drawing


def _draw(axes: Any, series: Series, colour: str) -> None:
    x, y = thinned(series.x, series.y) or (series.x, series.y)
    look = {"color": colour, "label": in_unicode(series.label)}
    if series.low is not None:
        axes.fill_between(series.x, series.low, series.high, color=colour, alpha=0.18, linewidth=0)
    if series.kind == "bars":
        axes.bar(x, y, **look)
    elif len(x) != len(series.x):  # a zigzag between least and greatest, dense as the columns are
        axes.plot(x, y, "-", linewidth=0.7, **look)
    elif series.u_y is None:
        axes.plot(x, y, _MARKS[series.kind], linewidth=1.3, **look)
    else:
        u95 = [2.0 * each for each in series.u_y]
        axes.errorbar(x, y, u95, fmt=_MARKS[series.kind], linewidth=1.3, capsize=2.5, **look)
