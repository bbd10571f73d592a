"""Effects of the optics between modulator and sensor."""
