"""A drive in SUMO's own window: a folder that sumo-gui opens and plays."""
