"""One module per foreign format: what a file holds, read anew. Nothing here may know the readers that it checks."""
