"""Training, offline: from a data set to a network in ONNX with its card. Nothing that drives imports this."""
