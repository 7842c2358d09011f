"""The command line; ``--version`` prints before other modules are loaded."""

import sys
from contextlib import suppress

from simrack.stated import stated_version


def main() -> None:
    """Run the command line; the process ends with its code."""
    if sys.argv[1:] in (["--version"], ["-v"]) and sys.stdout and (version := stated_version("vcfbench")):
        with suppress(OSError):  # nobody listens: what follows knows how that ends
            print(f"vcfbench {version}", flush=True)  # noqa: T201
            return
    from vcfbench.cli.main import main as whole  # noqa: PLC0415 - see above

    whole()


if __name__ == "__main__":
    main()
