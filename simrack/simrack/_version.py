"""Version of both distributions, simrack and vcfbench, in one place."""

__version__ = "0.1.0"
