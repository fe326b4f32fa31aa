"""GC-PGP: traversals of the lane graph, sampled from a learned policy, decoded and clustered (Hallgarten et al., 2023).

"From Prediction to Planning With Goal Conditioned Lane Graph Traversals", arXiv 2302.07753. One plan:

1. `local_graph`: the nodes of the map's lane graph around the ego, with successor and proximal edges.
2. Graph `policy`: every edge and the end at every node get a score; the ego and the nodes get encodings.
3. `plans`: traversals, chains of edges, sampled from the scores; edges that leave the route are never taken.
4. Graph `decoder`: each of them, with noise of its own, becomes a trajectory.
5. `plans` again: K-means over the trajectories; the mean of the cluster that Ward's merging ranks first is the plan.
6. A spline through the plan tells where the car points; a car that hardly moves stands still.
"""
