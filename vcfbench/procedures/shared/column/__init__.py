"""One column of a calibration: outputs against rates, real or virtual."""
