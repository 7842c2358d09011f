"""How long a fresh process takes before it is of use: import, `--help` and `--version`, against a bare typer app.

And what a run waits for its watchdog, which starts while the instruments are opened: the start, and the CPU it takes.
"""

from __future__ import annotations

import statistics
import sys

from measure import COMMAND, Figure, child, median_child, report

BARE_TYPER = "import typer; app = typer.Typer(); app.command()(lambda: None); app(['--help'])"


WATCHDOG = """
import resource, time
from vcfbench import load_bench
from vcfbench.safety.watchdog import Watchdog
from vcfbench.drivers.calls import Calls
description = load_bench("paper")
started = time.perf_counter()
watchdog = Watchdog(description, print, Calls(), print)
begun = time.perf_counter()
watchdog.require_ready()
ready = time.perf_counter()
watchdog.leave(safe=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(begun - started, ready - started, used.ru_utime + used.ru_stime)
"""


def watchdog(runs: int) -> list[float]:
    """Return the seconds to start it, until it watches, and of CPU that it takes until then."""
    return list(map(statistics.median, zip(*(_seconds(WATCHDOG) for _ in range(runs)), strict=True)))


def _seconds(script: str) -> list[float]:
    return [float(each) for each in child([sys.executable, "-c", script]).out.split()]


def figures(runs: int = 9) -> list[Figure]:
    empty = median_child([sys.executable, "-c", "pass"], runs).wall_s
    package = median_child([sys.executable, "-c", "import vcfbench"], runs).wall_s
    shown = median_child([*COMMAND, "--help"], runs).wall_s
    version = median_child([sys.executable, "-m", "vcfbench", "--version"], runs).wall_s
    bare = median_child([sys.executable, "-c", BARE_TYPER], runs).wall_s
    begun, ready, used = watchdog(runs)
    return [
        report(Figure("import vcfbench", 1e3 * (package - empty), "ms", bar=15, gross=60)),
        report(Figure("vcfbench --help", 1e3 * shown, "ms", bar=160)),
        report(Figure("vcfbench --version", 1e3 * version, "ms", bar=30)),
        report(Figure("bare typer app --help", 1e3 * bare, "ms")),
        report(Figure("vcfbench --help against a bare typer app", shown / bare, "ratio", bar=1.0, gross=1.5)),
        report(Figure("a watchdog is started", 1e3 * begun, "ms", bar=10)),
        report(Figure("a watchdog watches", 1e3 * ready, "ms", bar=60)),
        report(Figure("CPU of a watchdog until it watches", 1e3 * used, "ms", bar=20, gross=60)),
    ]


if __name__ == "__main__":
    figures()
