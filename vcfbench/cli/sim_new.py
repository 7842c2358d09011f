"""``vcfbench sim new``: a simulated bench with a gyroscope of one's own, from the figures of a data sheet."""

from enum import StrEnum
from typing import Annotated, Any, Final

import typer

from vcfbench.cli.new_file import require_free, written_anew
from vcfbench.cli.options import NewFile_, option
from vcfbench.sim.own_gyro import data_sheet, own_gyro_bench


class Imperfections(StrEnum):
    """Quality of gyroscope, PCB and instruments."""

    NONE = "none"
    PAPER = "paper"


_FIGURES: Final = {
    "scale_factor_v_per_deg_s": ("scale_factor", "Scale factor, mV/(deg/s), signed", -12.542052),
    "range_deg_s": ("range", "Range, deg/s, either way", 200.0),
    "bias_deg_s": ("bias", "Bias, deg/s", 0.0),
    "drive_hz": ("drive_frequency", "Drive frequency, Hz", 3488.9),
    "q_drive": ("q_drive", "Quality factor of the drive mode", 1395.0),
    "split_hz": ("split", "Mode split, drive less sense frequency, Hz", 24.8),
    "q_sense": ("q_sense", "Quality factor of the sense mode", 1224.0),
    "angle_random_walk_deg_sqrt_h": ("noise", "Angle random walk, deg/sqrt(h)", 0.0),
    "bias_instability_deg_h": ("bias_instability", "Bias instability (Allan minimum), deg/h", 0.0),
    "bandwidth_hz": ("bandwidth", "Bandwidth (-3 dB), Hz, at most half the split", None),
    "k_vc_deg_s_per_v": ("k_vc", "K_Vc, (deg/s)/V: rate that one volt of V_Vc stands for", None),
}
"""Keys of a data sheet: the option, its help, and the figure without it."""
_MILLI = 1e-3
_PAPERS: Final = {"angle_random_walk_deg_sqrt_h": 0.21, "bias_instability_deg_h": 3.7}
"""Figures instead where the imperfections are the paper's."""


FIGURE_OPTIONS: Final[dict[str, Any]] = {
    name: Annotated[float | None, option("X", f"{words}.{'' if usual is None else f' [default: {usual:.15g}]'}")]
    for name, words, usual in _FIGURES.values()
}
"""Options of the command, one a figure."""


def new(
    file: NewFile_,
    *,
    imperfections: Annotated[
        Imperfections, option(None, "All perfect except noise, or as in the paper.")
    ] = Imperfections.NONE,
    name: Annotated[str | None, option("NAME", "Name of the bench. Default: that of FILE.")] = None,
    **given: float | None,
) -> None:
    """Write a simulated bench with your own gyroscope: runs on it find the figures of its data sheet.

    Without --bandwidth the filter is at four splits, without --k-vc 1 V stands for three quarters of the range.
    """
    require_free(file)
    real = imperfections is Imperfections.PAPER
    figures: dict[str, float] = {}
    for key, (figure, _, usual) in _FIGURES.items():
        asked = given.get(figure)
        value = (_PAPERS if real else {}).get(key, usual) if asked is None else asked
        if value is not None:
            figures[key] = value * _MILLI if key == "scale_factor_v_per_deg_s" else value
    figures.setdefault("k_vc_deg_s_per_v", 0.75 * figures["range_deg_s"])
    text = own_gyro_bench(data_sheet(**figures), name or file.stem, imperfections=real)
    written_anew(file, text)
    typer.echo(f"{file} is written; next: vcfbench run turntable --bench {file}")
