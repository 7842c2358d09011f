"""Drivers: one file a model, speaking to real instruments over VISA or a serial port."""
