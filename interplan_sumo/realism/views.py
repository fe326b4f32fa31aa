"""Where and how recordings look at traffic: simulated traffic is looked at in the same way before the two are compared.

Nobody records a city. Sensors stand at a junction, or come by one, see so far, and are on for so long; in such a view
there are more starts, turns and speed-ups than on a whole map, and nobody is seen to queue for minutes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.realism.features import MovingTraffic
from interplan_sumo.realism.motion import MOVING_MPS
from interplan_sumo.realism.tracker_noise import TrackerNoise
from interplan_sumo.realism.tracks import RecordedTraffic, Track, unbroken
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.world.geometry import Floats, Ints

SEEN_SHARE: Final = 95.0
"""Per cent of the boxes of those who drive lie within the radius of a view: few are seen from very far."""
LOOKS: Final = 60
"""At least so many at the traffic of one network."""
CANDIDATES: Final = 12
"""Of so many places and times, a look is taken at the one where traffic is most nearly as dense as in the recording."""
SAME_S: Final = 1e-3
"""Boxes no further apart in time are of one moment."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedView:
    """What one recording sees of the traffic around it."""

    radius_m: float
    """About the median place of those who drive."""
    lasts_s: float
    drivers: float
    """How many who drive at some time are in it on average."""
    noise: TrackerNoise

    @classmethod
    def of(cls, recording: RecordedTraffic) -> RecordedView | None:
        """None if nobody drives."""
        driven = [each.track for each in MovingTraffic.of(recording).vehicles]
        if not driven:
            return None
        x_m, y_m = (np.concatenate([getattr(each, name) for each in driven]) for name in ("x_m", "y_m"))
        radius_m = np.percentile(np.hypot(x_m - np.median(x_m), y_m - np.median(y_m)), SEEN_SHARE)
        begins_s, ends_s = (np.array([each.time_s[row] for each in recording.tracks]) for row in (0, -1))
        lasts_s = float(ends_s.max() - begins_s.min())
        seen_s = SEEN_SHARE / 100.0 * sum(each.time_s[-1] - each.time_s[0] for each in driven)
        return cls(float(radius_m), lasts_s, float(seen_s / lasts_s), TrackerNoise.of([recording]))


def views_of(recordings: Iterable[RecordedTraffic]) -> tuple[RecordedView, ...]:
    """Of all in which somebody drives."""
    return tuple(view for each in recordings if (view := RecordedView.of(each)) is not None)


def signalled_junctions(network: SumoNetwork) -> Floats:
    """(N, 2) the middles of the junctions with lights, in SUMO's frame: where the ends of their ways are on average."""
    ends: dict[str, list[Floats]] = {}
    for links in network.links.values():
        for link in links:
            if link.light is not None:
                lines = network.lanes[link.from_lane].line, network.lanes[link.to_lane].line
                ends.setdefault(link.light[0], []).extend((lines[0].points[-1], lines[1].points[0]))
    return np.array([np.mean(points, axis=0) for _, points in sorted(ends.items())]).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class _Look:
    """Where and when traffic is looked at."""

    place_m: Floats
    radius_m: float
    from_s: float
    to_s: float


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """All boxes of some traffic in the order of time; rows belong together."""

    time_s: Floats
    x_m: Floats
    y_m: Floats
    track: Ints
    drives: NDArray[np.bool_]
    """Whether it drives just then."""

    @classmethod
    def of(cls, traffic: RecordedTraffic) -> _Boxes:
        time_s, x_m, y_m, speed_mps = (
            np.concatenate([getattr(each, name) for each in traffic.tracks])
            for name in ("time_s", "x_m", "y_m", "speed_mps")
        )
        track = np.repeat(np.arange(len(traffic.tracks)), [len(each.time_s) for each in traffic.tracks])
        order = np.argsort(time_s, kind="stable")
        return cls(time_s[order], x_m[order], y_m[order], track[order], speed_mps[order] > MOVING_MPS)

    def drivers(self, look: _Look) -> float:
        """How many who drive at some time of a look are seen in it on average."""
        rows = slice(*np.searchsorted(self.time_s, (look.from_s, look.to_s)))
        if rows.stop == rows.start:
            return 0.0
        inside = np.hypot(self.x_m[rows] - look.place_m[0], self.y_m[rows] - look.place_m[1]) <= look.radius_m
        track = self.track[rows][inside]
        driven = np.unique(track[self.drives[rows][inside]])
        times = 1 + np.count_nonzero(np.diff(self.time_s[rows]) > SAME_S)
        return np.count_nonzero(np.isin(track, driven)) / times


def looked_at(
    traffic: RecordedTraffic, places: Floats, views: Sequence[RecordedView], seed: int
) -> Iterator[RecordedTraffic]:
    """What the views see of simulated traffic, each as often as the others: from one of (N, 2) places.

    Places and times are drawn; of every `CANDIDATES` the one is taken that holds most nearly as many
    who drive as the recording. A view that lasts longer than the traffic is taken in parts. What is seen
    has the noise of the view, and who drives out of it and in again counts as another.
    """
    if not traffic.tracks or not views or not len(places):
        return
    rng = np.random.default_rng(seed)
    boxes = _Boxes.of(traffic)
    begins_s = boxes.time_s[0]
    lasts_s = boxes.time_s[-1] - begins_s
    parts = [max(1, ceil(each.lasts_s / lasts_s)) for each in views]
    rounds = ceil(LOOKS / sum(parts))
    for number, view in enumerate(views):
        part_s = view.lasts_s / parts[number]
        for at in range(rounds * parts[number]):
            drawn: list[_Look] = []
            for _ in range(CANDIDATES):
                place_m = places[int(rng.integers(len(places)))]
                from_s = begins_s + rng.uniform(0.0, lasts_s - part_s)
                drawn.append(_Look(place_m, view.radius_m, from_s, from_s + part_s))
            look = min(drawn, key=lambda each: abs(boxes.drivers(each) - view.drivers))
            tracks = tuple(part for each in traffic.tracks for part in _within(each, look))
            yield view.noise.on(RecordedTraffic(f"{traffic.name} {number} {at}", traffic.place, tracks))


def _within(track: Track, look: _Look) -> Iterator[Track]:
    """What is seen of a track."""
    seen = np.hypot(track.x_m - look.place_m[0], track.y_m - look.place_m[1]) <= look.radius_m
    rows = np.flatnonzero(seen & (track.time_s >= look.from_s) & (track.time_s <= look.to_s))
    names = ("time_s", "x_m", "y_m", "heading_rad", "speed_mps")
    for id_, part in unbroken(track.id, track.time_s[rows]) if len(rows) else ():
        yield replace(track, id=id_, **{name: getattr(track, name)[rows[part]] for name in names})
