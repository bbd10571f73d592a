"""Effects of the sensor: how light becomes a signal with noise."""
