"""Effects of the modulator: what it displays differs from the commanded patterns."""
