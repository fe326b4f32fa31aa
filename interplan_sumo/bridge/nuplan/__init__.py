"""nuPlan's planners on our scenes, and our planners in nuPlan's simulation; needs nuPlan's devkit on the path."""
