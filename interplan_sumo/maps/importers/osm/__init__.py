"""OpenStreetMap extracts (`.osm`, `.osm.xml`, plain or gzipped) as maps, by way of SUMO's own reader."""

from interplan_sumo.maps.importers.formats import MapFormat
from interplan_sumo.maps.importers.osm.reader import count_osm, read_osm_extract

FORMAT = MapFormat("OpenStreetMap", "*.osm*", read_osm_extract, count_osm)
