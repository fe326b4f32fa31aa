"""DTPP: a tree of the ego's trajectories in two stages, and what it costs given how the others answer to each of them.

Huang et al., "DTPP: Differentiable Joint Conditional Prediction and Cost Evaluation for Tree Policy Planning in
Autonomous Driving", ICRA 2024, arXiv 2310.05885. One plan:

1. `paths`: at most three reference paths along the route's lanes, from the ego on.
2. `tree`: cubic speed profiles to a grid of speeds along each of them, over 3 s.
3. Graph `encoder`: the scene. Graph `decoder`: how the agents answer to each branch, and its score.
4. The best branches are parents of the second stage, 3 to 8 s; the decoder scores their children.
5. The best sum of a parent's and its child's score is driven. Without a path the plan is to stop.

| module | holds |
|---|---|
| `sizes.py` | the numbers of tree, scene and network, compact and published |
| `inputs.py` | what the network is given |
| `paths.py` | reference paths from arrays of the schema, the same for driving and for training |
| `tree.py` | the two stages, for a batch of samples at once |
| `plans.py` | tree and scores together: a plan for each sample |
| `planner.py` | `DtppPlanner` |
"""
