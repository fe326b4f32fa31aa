"""CommonRoad scenarios (XML, versions 2018b and 2020a) as maps."""

from interplan_sumo.maps.importers.commonroad.count import count_commonroad
from interplan_sumo.maps.importers.commonroad.reader import read_commonroad
from interplan_sumo.maps.importers.formats import MapFormat

FORMAT = MapFormat("CommonRoad", "*.xml", read_commonroad, count_commonroad)
