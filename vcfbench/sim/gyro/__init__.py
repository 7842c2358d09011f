"""The gyroscope: modes, drive loop, sense path, electronics and noise."""
