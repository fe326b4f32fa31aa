"""Argoverse 2 maps, one JSON file for each log."""

from interplan_sumo.maps.importers.argoverse2.count import count_argoverse2
from interplan_sumo.maps.importers.argoverse2.reader import read_argoverse2
from interplan_sumo.maps.importers.formats import MapFormat

FORMAT = MapFormat("Argoverse 2", "log_map_archive_*.json", read_argoverse2, count_argoverse2)
