"""The part of a large map around a place."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
import shapely

from interplan_sumo.world.roads import Roads
