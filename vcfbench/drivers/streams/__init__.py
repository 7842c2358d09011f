"""Gyroscopes whose output is a stream of numbers: description of their frames, decoder, reader."""
