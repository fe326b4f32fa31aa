"""What several planners share, from lane search and paths to forecasts, batch scoring and lane-change decisions."""
