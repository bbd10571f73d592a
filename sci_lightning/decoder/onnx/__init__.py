"""A decoder as an ONNX graph, and the comparison of that graph with torch."""
