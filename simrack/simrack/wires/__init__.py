"""Simulated instruments in this process: a PyVISA backend, and serial ports of pyserial under ``sim://``."""
