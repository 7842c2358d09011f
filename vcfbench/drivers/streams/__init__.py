"""Gyroscopes whose output is a stream of numbers: how a bench file tells its frames, and what reads them."""
