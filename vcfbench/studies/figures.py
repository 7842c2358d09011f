"""The pictures of a study: every headline over each varied path, all runs and their mean with its spread."""

import io
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from vcfbench.reports.plot import matplotlib
from vcfbench.studies.one_run import RunRow
from vcfbench.studies.summary import CaseSummary, headlines

_MOST_PANELS = 12
_ACROSS = 3
_WIDTH = 0.5  # Width of the band over which the runs of a case are spread, in cases


def picture(title: str, rows: Sequence[RunRow], cases: Sequence[CaseSummary]) -> str:
    """Return a picture as SVG: a panel per metric, with runs as points, and mean and deviation of each case.

    The same rows give the same bytes.
    """
    mpl = matplotlib()
    names = headlines(cases)[:_MOST_PANELS]
    down = -(-len(names) // _ACROSS) or 1
    with mpl.rc_context({"svg.hashsalt": "vcfbench", "svg.fonttype": "none", "font.size": 8.0}):
        drawing = mpl.figure.Figure(figsize=(4.0 * _ACROSS, 2.7 * down), layout="constrained")
        drawing.suptitle(title)
        panels = drawing.subplots(down, _ACROSS, squeeze=False).flat
        places, label = _places(cases)
        for axes, name in zip(panels, names, strict=False):
            _panel(axes, name, rows, cases, places)
            axes.set(title=name, xlabel=label)
        for axes in list(drawing.axes)[len(names) :]:
            axes.remove()
        data = io.StringIO()
        drawing.savefig(data, format="svg", metadata={"Date": None})
    return data.getvalue()


def _places(cases: Sequence[CaseSummary]) -> tuple[Mapping[int, float], str]:
    """Return where each case is drawn: at its value where one number is varied, else by its number."""
    labels = list(dict.fromkeys(label for case in cases for label in case.values))
    if len(labels) == 1:
        values = [case.values.get(labels[0]) for case in cases]
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            return {case.case: float(case.values[labels[0]]) for case in cases}, ".".join(labels[0].split(".")[-2:])
    return {case.case: float(case.case) for case in cases}, "case"


def _panel(
    axes: Any, name: str, rows: Sequence[RunRow], cases: Sequence[CaseSummary], places: Mapping[int, float]
) -> None:
    spots = sorted(places.values())
    step = min((right - left for left, right in pairwise(spots)), default=1.0) or 1.0
    found = [row for row in rows if row.metrics.get(name) is not None]
    numbers: dict[int, int] = {}
    x = []
    for row in found:
        place = numbers[row.case] = numbers.get(row.case, -1) + 1
        aside = (place * 0.618034) % 1.0 - 0.5  # spread evenly, and the same each time
        x.append(places[row.case] + _WIDTH * step * aside)
    y = [float(row.metrics[name]) for row in found]
    axes.plot(x, y, ".", markersize=3.0, alpha=0.5, color="tab:blue", rasterized=len(y) > 5000)
    drawn = [case for case in cases if name in case.metrics]
    means = [case.metrics[name].mean for case in drawn]
    spreads = [case.metrics[name].sd or 0.0 for case in drawn]
    at = [places[case.case] for case in drawn]
    axes.errorbar(at, means, spreads, fmt="o", color="black", markersize=4.0, capsize=4.0, zorder=3)
    truths = {row.case: row.metrics[f"{name}.truth"] for row in found if f"{name}.truth" in row.metrics}
    if truths:
        axes.plot([places[case] for case in truths], list(truths.values()), "_", color="tab:red", markersize=14.0)
    if all(place == int(place) for place in spots) and len(spots) <= _MOST_PANELS:
        axes.set_xticks(spots)
    axes.grid(visible=True, alpha=0.3)
