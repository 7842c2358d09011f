"""How long a fresh process takes before it is of use: import, `--help` and `--version`, against a bare typer app."""

from __future__ import annotations

import sys

from measure import COMMAND, Figure, median_child, report

BARE_TYPER = "import typer; app = typer.Typer(); app.command()(lambda: None); app(['--help'])"


def figures(runs: int = 9) -> list[Figure]:
    empty = median_child([sys.executable, "-c", "pass"], runs).wall_s
    package = median_child([sys.executable, "-c", "import vcfbench"], runs).wall_s
    shown = median_child([*COMMAND, "--help"], runs).wall_s
    version = median_child([*COMMAND, "--version"], runs).wall_s
    bare = median_child([sys.executable, "-c", BARE_TYPER], runs).wall_s
    return [
        report(Figure("import vcfbench", 1e3 * (package - empty), "ms", bar=15, gross=60)),
        report(Figure("vcfbench --help", 1e3 * shown, "ms", bar=160)),
        report(Figure("vcfbench --version", 1e3 * version, "ms", bar=60)),
        report(Figure("bare typer app --help", 1e3 * bare, "ms")),
        report(Figure("vcfbench --help against a bare typer app", shown / bare, "ratio", bar=1.0, gross=1.5)),
    ]


if __name__ == "__main__":
    figures()
