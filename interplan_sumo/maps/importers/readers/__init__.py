"""One module per foreign format: a file to a `SourceMap`, nothing interpreted that the file does not say."""
