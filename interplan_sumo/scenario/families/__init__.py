"""One module per family of scenarios; each exports SCENARIOS, its rows as data."""
