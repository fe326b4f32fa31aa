"""Lanelet2 maps in OSM XML, as the library, JOSM, Autoware's editors and CommonRoad's converter write them."""

from interplan_sumo.maps.importers.formats import MapFormat
from interplan_sumo.maps.importers.lanelet2.count import count_lanelet2
from interplan_sumo.maps.importers.lanelet2.reader import read_lanelet2

FORMAT = MapFormat("Lanelet2", "*.osm", read_lanelet2, count_lanelet2)
