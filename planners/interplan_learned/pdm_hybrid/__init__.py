"""PDM-Hybrid: PDM-Closed's plan, corrected beyond 2 s by a network, PDM-Offset (Dauner et al., CoRL 2023).

"Parting with Misconceptions about Learning-based Vehicle Motion Planning", arXiv 2306.07962.
"""
