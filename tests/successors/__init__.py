"""A bench of nothing but successors, and what each of them is by itself."""

from pathlib import Path

BENCH = Path(__file__).parent / "bench.toml"
