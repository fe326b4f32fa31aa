"""interplan-sumo: can a motion planner cope with rare, interactive traffic?"""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("interplan-sumo")
except PackageNotFoundError:  # a bare checkout
    __version__ = "0.0.0"
