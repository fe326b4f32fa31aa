"""Lanelet2 maps in OSM XML, as the library, JOSM, Autoware's editors and CommonRoad's converter write them."""

from interplan_sumo.maps.importers.readers.lanelet2.read import read_lanelet2

__all__ = ["read_lanelet2"]
