"""FlowDrive: a plan is noise that a learned flow carries to where the experts drove, in a few straight steps.

Wang et al., "FlowDrive: moderated flow matching with data balancing for trajectory planning", 2025, arXiv 2509.21961;
read of it were the abstract and what others tell. Kept are the conditional rectified flow from noise to a plan, the few
steps and training balanced by kinds of futures (`tools.train.data`). Ours are the size, the encoder, which GameFormer
and DTPP share, what a plan is told by (`told`), and that the network says where the flow ends, from which its direction
follows. There is no moderated guidance and no scoring of several plans, which make FlowDrive* of it.
"""
