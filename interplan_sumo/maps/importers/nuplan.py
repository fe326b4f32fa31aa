"""nuPlan's own maps: GeoPackages that are taken over as they are."""

from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.importers.formats import MapFormat

FORMAT = MapFormat("nuPlan GeoPackage", "*.gpkg", read_map)
