"""Finished runs: read back, listed, verified, amended, compared, exported and certified."""
