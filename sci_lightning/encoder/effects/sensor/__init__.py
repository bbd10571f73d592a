"""Effects of the sensor: from light to numbers."""
