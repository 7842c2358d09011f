"""A figure of a report as a picture in a file, by Matplotlib, which comes with the extra ``plot``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vcfbench.errors import ConfigError
from vcfbench.files import shown

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.report.document import Figure, Series

__all__ = ["save_figure"]

_MARKS = {"points": "o", "line": "-"}


def save_figure(figure: Figure, path: Path) -> None:
    """Draw `figure` into a file; its suffix says as what: ``.png``, ``.svg``, ``.pdf``. Bars of error are U = 2 u.

    Raises:
        ConfigError: Matplotlib is not installed, no such suffix is known, or the file cannot be written.
    """
    try:
        from matplotlib.figure import Figure as Drawing  # noqa: PLC0415 - an optional extra
    except ImportError as error:
        raise ConfigError("a plot needs Matplotlib", hint="pip install vcfbench[plot]") from error
    drawing = Drawing(figsize=(8.0, 5.0), layout="constrained")
    axes = drawing.subplots()
    axes.set(title=figure.title, xlabel=figure.x.title, ylabel=figure.y.title)
    axes.set(xscale=figure.x.scale, yscale=figure.y.scale)
    for series in figure.series:
        _draw(axes, series)
    axes.grid(visible=True, alpha=0.3)
    if len(figure.series) > 1:
        axes.legend()
    try:
        drawing.savefig(path)
    except (ValueError, OSError) as error:
        raise ConfigError(f"{shown(path)}: no picture can be written: {error}") from error


def _draw(axes: Any, series: Series) -> None:
    if series.kind == "bars":
        axes.bar(series.x, series.y, label=series.label)
    elif series.u_y is None:
        axes.plot(series.x, series.y, _MARKS[series.kind], label=series.label)
    else:
        u95 = [2.0 * each for each in series.u_y]
        axes.errorbar(series.x, series.y, u95, fmt=_MARKS[series.kind], capsize=3.0, label=series.label)
