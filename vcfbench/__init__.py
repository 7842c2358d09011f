"""vcfbench: calibrates MEMS vibratory gyroscopes on a rate table and by a virtual Coriolis force."""

__version__ = "0.1.0"

__all__ = ["__version__"]
