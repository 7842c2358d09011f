"""``vcfbench sim new``: a simulated bench with a gyroscope of one's own, from the figures of a data sheet."""

import sys
from enum import StrEnum
from functools import partial
from typing import Annotated, Any, Final

import typer

from vcfbench.cli.interview import Interview, written_anew
from vcfbench.cli.options import NewFile_, flag, option
from vcfbench.errors import ConfigError
from vcfbench.sim.own_gyro import data_sheet, own_gyro_bench


class Imperfections(StrEnum):
    """Quality of gyroscope, PCB and instruments."""

    NONE = "none"
    PAPER = "paper"


_FIGURES = {
    "scale_factor_v_per_deg_s": ("scale_factor", "Scale factor, mV/(deg/s), signed", "-12.542052"),
    "range_deg_s": ("range", "Range, deg/s, either way", "200"),
    "bias_deg_s": ("bias", "Bias, deg/s", "0"),
    "drive_hz": ("drive_frequency", "Drive frequency, Hz", "3488.9"),
    "q_drive": ("q_drive", "Quality factor of the drive mode", "1395"),
    "split_hz": ("split", "Mode split, drive less sense frequency, Hz", "24.8"),
    "q_sense": ("q_sense", "Quality factor of the sense mode", "1224"),
    "angle_random_walk_deg_sqrt_h": ("noise", "Angle random walk, deg/sqrt(h); 0: none", "0"),
    "bias_instability_deg_h": ("bias_instability", "Bias instability (Allan minimum), deg/h; 0: none", "0"),
    "bandwidth_hz": ("bandwidth", "Bandwidth (-3 dB), Hz, at most half the split; Enter: filter at four splits", ""),
    "k_vc_deg_s_per_v": ("k_vc", "K_Vc, (deg/s)/V: rate that one volt of V_Vc stands for", ""),
}
"""Keys of a data sheet: the option, the question, and the proposal."""
_MILLI = 1e-3
_PAPERS = {"angle_random_walk_deg_sqrt_h": "0.21", "bias_instability_deg_h": "3.7"}
"""Proposals instead where the imperfections are the paper's."""


FIGURE_OPTIONS: Final[dict[str, Any]] = {
    name: Annotated[
        float | None, option("X", f"{words.partition(';')[0]}.{f' [default: {proposed}]' if proposed else ''}")
    ]
    for name, words, proposed in _FIGURES.values()
}
"""Options of the command, one a figure."""


def new(
    file: NewFile_,
    *,
    imperfections: Annotated[
        Imperfections, option(None, "All perfect except noise, or as in the paper.")
    ] = Imperfections.NONE,
    name: Annotated[str | None, option("NAME", "Name of the bench. Default: that of FILE.")] = None,
    yes: Annotated[bool, flag("Ask nothing at a terminal: use what is proposed.", "--yes", "-y")] = False,
    **given: float | None,
) -> None:
    """Write a simulated bench with your own gyroscope: runs on it find the figures of its data sheet.

    At a terminal, figures that are not given are asked for.
    """
    answers = {figure: f"{value:.15g}" for figure, value in given.items() if value is not None}
    interview = Interview(answers, silent=yes or not sys.stdin.isatty())
    path = interview.free_file(file)
    real = imperfections is Imperfections.PAPER
    figures: dict[str, float] = {}
    for key, (figure, words, usual) in _FIGURES.items():
        proposed = (_PAPERS if real else {}).get(key, usual)
        if key == "k_vc_deg_s_per_v":
            proposed = f"{0.75 * figures['range_deg_s']:g}"
        interview.ask(figure, words, proposed, partial(_take, key=key, figures=figures))
    text = own_gyro_bench(data_sheet(**figures), name or path.stem, imperfections=real)
    written_anew(path, text)
    typer.echo(f"{path} is written; next: vcfbench run turntable --bench {path}")


def _take(answer: str, key: str, figures: dict[str, float]) -> None:
    """Put an answer among the figures, held against those before it; no range yet is one of 1 deg/s."""
    if not answer:
        return
    try:
        value = float(answer) * (_MILLI if key == "scale_factor_v_per_deg_s" else 1.0)
    except ValueError:
        raise ConfigError(f"expected a number, came {answer!r}") from None
    try:
        data_sheet(**{"range_deg_s": 1.0, **figures, key: value})
    except ConfigError as error:
        raise ConfigError(error.what) from None
    figures[key] = value
