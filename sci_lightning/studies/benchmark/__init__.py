"""What decoding costs: parameters, multiply-accumulates, seconds and memory."""
