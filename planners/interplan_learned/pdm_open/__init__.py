"""PDM-Open: the ego's past and the line to follow, through a multi-layer perceptron (Dauner et al., CoRL 2023).

"Parting with Misconceptions about Learning-based Vehicle Motion Planning", arXiv 2306.07962.
"""
