"""From captures to what is wrong with the encoder: likelihood, camera model, joint fits."""
