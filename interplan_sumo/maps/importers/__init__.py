"""Maps of other formats: each reader makes a `SourceMap` of a file, and `build` turns that into `Roads`."""
