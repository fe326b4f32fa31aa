"""What several planners share: route search, centreline paths, corridors and the Intelligent Driver Model."""
