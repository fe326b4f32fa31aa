"""What figures over scenes say about scenes like them: intervals, comparisons, and differences that can be detected."""
