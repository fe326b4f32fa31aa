"""How near drivers come to a place they were not fitted to: `python -m benchmarks.held_out_places RECORDING...`.

Each place is left out in turn; drivers fitted to the others drive in plain traffic, which is held against the place
left out, feature by feature. Beside the median over the places stands what recordings have: the median of pairs of
places, and each place beside all the others, which is the best that could be hoped for without knowing the place.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from interplan_sumo.realism.calibration import CalibrationOptions, calibrated
from interplan_sumo.realism.comparison import FEWEST, realism_report, recorded_places
from interplan_sumo.realism.distances import kolmogorov_smirnov
from interplan_sumo.realism.features import FEATURES, FeatureSamples, feature_samples
from interplan_sumo.realism.plain_traffic import plain_traffic
from interplan_sumo.realism.tracks import RecordedTraffic, open_recordings
from interplan_sumo.realism.views import views_of
from interplan_sumo.simulation.vehicle_types import read_vehicle_types


def driven_without(place: str, recordings: list[RecordedTraffic], limits_mps: dict[str, float]) -> FeatureSamples:
    """Plain traffic of drivers fitted to all places but one, seen as that one was recorded."""
    others = [each for each in recordings if each.place != place]
    known = {each.place for each in others}
    options = CalibrationOptions(limits_mps={name: mps for name, mps in limits_mps.items() if name in known})
    views = views_of(each for each in recordings if each.place == place)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "drivers.xml"
        file.write_text(calibrated(others, options).text(), encoding="utf-8")
        return feature_samples(plain_traffic(read_vehicle_types(file), place, views))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--limit", action="append", default=[], metavar="PLACE=MPS")
    options = parser.parse_args()
    recordings = list(open_recordings(options.recordings))
    limits_mps = {name: float(mps) for name, mps in (each.split("=") for each in options.limit)}
    recorded = recorded_places(recordings)
    between = realism_report({}, recordings).between_places
    simulated = {place: driven_without(place, recordings, limits_mps) for place in recorded.places}
    print(f"{'feature':28} {'left out':>8} {'pairs':>6} {'others':>6}  by place")
    for feature in FEATURES:
        key = feature.key
        there = [place for place, samples in recorded.places.items() if samples[key].road_users >= FEWEST]
        if key not in between or not all(simulated[place][key].road_users for place in there):
            continue  # nobody walks in plain traffic
        apart = {place: kolmogorov_smirnov(simulated[place][key], recorded.places[place][key]) for place in there}
        others = [kolmogorov_smirnov(recorded.without(e).together[key], recorded.places[e][key]) for e in there]
        words = ", ".join(f"{place} {value:.2f}" for place, value in apart.items())
        print(f"{feature.title:28} {median(apart.values()):8.2f} {between[key]:6.2f} {median(others):6.2f}  {words}")


if __name__ == "__main__":
    main()
