"""The replay: a stored drive, or two side by side, as one HTML page that plays without a network."""
