"""The device side of SCPI and IEEE 488.2."""
