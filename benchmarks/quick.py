"""All benchmarks, short; fails only on gross regressions, since absolute times wobble on shared machines."""

from __future__ import annotations

import sys

import analysis
import physics
import reads
import startup
import tcp
import whole_runs


def main() -> int:
    found = [
        *startup.figures(runs=3),
        *analysis.figures(),
        *physics.figures(),
        *reads.figures(),
        *whole_runs.figures(runs=1),
        *tcp.figures(starts=3),  # last: it keeps to one processor
    ]
    broken = [figure.figure for figure in found if not figure.holds]
    if broken:
        print(f"gross regression: {'; '.join(broken)}", file=sys.stderr)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
