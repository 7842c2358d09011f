# noqa: INP001 - a script, not a package
"""Draws the README's figures anew, those of a report on the simulated bench: `python docs/make_figures.py`."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import vcfbench
from vcfbench.reports.plot import save_figure

NAMES = ("report-output.svg", "report-residuals.svg")
"""In the order of the report of `virtual-coriolis`, which has one figure more."""


def draw(folder: Path) -> None:
    """Run the calibration on the paper's bench, and write its figures into `folder`."""
    with TemporaryDirectory() as runs:
        report = vcfbench.run("virtual-coriolis", runs=runs).report()
    figures = (part for part in report.parts if isinstance(part, vcfbench.Figure))
    for name, figure in zip(NAMES, figures, strict=False):
        save_figure(figure, folder / name)
        text = (folder / name).read_text(encoding="utf-8")
        lines = "\n".join(line.rstrip() for line in text.splitlines())
        (folder / name).write_text(lines + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    draw(Path(__file__).parent)
