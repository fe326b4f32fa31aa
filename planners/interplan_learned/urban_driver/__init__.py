"""UrbanDriver, open loop: the ego looks once at polylines of vehicles and of the map (Scheel et al., CoRL 2021).

"Urban Driver: Learning to Drive from Real-world Demonstrations Using Policy
Gradients", arXiv 2109.13333, trains in a differentiable simulator. This is not
that: it is the open-loop network that nuPlan made of it, which learns by
imitation and is what the benchmarks drive.
"""
