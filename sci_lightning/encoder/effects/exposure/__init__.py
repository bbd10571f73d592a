"""Effects of the exposure: when light is collected."""
