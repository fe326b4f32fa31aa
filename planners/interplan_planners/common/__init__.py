"""What several planners share: paths along the route, the IDM policy."""
