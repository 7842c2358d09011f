"""``python -m vcfbench``: the command line."""

from __future__ import annotations

from vcfbench.cli.main import main

if __name__ == "__main__":
    main()
