"""Phases of carrier, Coriolis and virtual signal and of the demodulator against the drive."""
