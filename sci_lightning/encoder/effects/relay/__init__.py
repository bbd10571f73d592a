"""Effects of the relay lens: where and how sharply the mask is imaged onto the sensor."""
