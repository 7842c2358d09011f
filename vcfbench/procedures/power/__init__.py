"""The supply of the gyroscope: currents, time to valid output, what the rails do to the output."""
