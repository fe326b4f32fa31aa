"""GameFormer: joint futures of ego and agents, refined level by level, and a plan whose motion is refined once more.

Huang et al., "GameFormer: Game-theoretic Modeling and Learning of Transformer-based Interactive Prediction and
Planning for Autonomous Driving", ICCV 2023, arXiv 2303.05760; numbers are those of its nuPlan planner.

| module | holds |
|---|---|
| `inputs.py` | what the network is given, compact and published |
| `candidates.py` | ways along the route, joined to the ego by Bezier curves |
| `reference.py` | which of them is followed, and how fast at most |
| `occupancy.py` | when which metre of it is taken, by predicted agents and red lights |
| `refinement.py` | Gauss-Newton over the speeds of 8 s |
| `planner.py` | `GameFormerPlanner`: network, then all of these |
"""
