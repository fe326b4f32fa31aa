"""Dataset: training data made from drives, and read back."""
