"""OpenDRIVE maps (`.xodr`), versions 1.4 to 1.8."""

from interplan_sumo.maps.importers.formats import MapFormat
from interplan_sumo.maps.importers.opendrive.reader import read_opendrive
from interplan_sumo.maps.importers.opendrive.second_opinion import opinion_of_netconvert

FORMAT = MapFormat("OpenDRIVE", "*.xodr", read_opendrive, opinion=opinion_of_netconvert)
