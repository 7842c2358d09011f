"""The command ``simrack``; ``--version`` prints before other modules are loaded."""

import sys

from simrack.stated import stated_version


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--version"] and (version := stated_version("simrack")):
        print(f"simrack {version}")  # noqa: T201
        return
    from simrack.cli import app  # noqa: PLC0415  # see above

    app()


if __name__ == "__main__":
    main()
