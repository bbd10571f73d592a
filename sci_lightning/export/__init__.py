"""A decoder as an ONNX graph: made, compared with torch, and timed beside it."""
