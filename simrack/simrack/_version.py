"""Version of both distributions, simrack and vcfbench: the one place where it stands."""

__version__ = "0.1.0"
