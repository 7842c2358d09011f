"""The supply of the gyroscope: currents, time to valid output, effect of the rails on the output."""
