"""SUMO networks (`.net.xml`, plain or gzipped) as maps."""

from interplan_sumo.maps.importers.formats import MapFormat
from interplan_sumo.maps.importers.sumo.count import count_sumo_network
from interplan_sumo.maps.importers.sumo.reader import read_sumo_network

FORMAT = MapFormat("SUMO network", "*.net.xml*", read_sumo_network, count_sumo_network)
