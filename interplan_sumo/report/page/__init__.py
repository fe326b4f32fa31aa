"""The report as one HTML page for planning researchers: table, families, every drive and how it was made."""
