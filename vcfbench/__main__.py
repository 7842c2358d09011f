"""``python -m vcfbench``: the command line."""

from vcfbench.cli.main import main

if __name__ == "__main__":
    main()
