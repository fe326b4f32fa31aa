"""Atlas replays: pages to watch failed scenes and the solved ones most like them, beside the page of an atlas."""

from __future__ import annotations

import sys
from pathlib import Path

from interplan_sumo.report.atlas import Atlas
from interplan_sumo.report.atlas_page import replay_name
from interplan_sumo.report.page.drives import replays_folder
from interplan_sumo.report.page.replays import ReplayJob, make_replay
from interplan_sumo.world.files import writing


def write_near_replays(atlas: Atlas, page: Path) -> None:
    """Those that are not there yet; one that cannot be made is named on stderr. InputError if none can be written."""
    assert atlas.run is not None, "a search keeps no drives"
    folder = replays_folder(page)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    scenes = {scene.id: scene for pair in atlas.near for scene in (pair.failed, pair.solved)}
    for scene in scenes.values():
        place = folder / replay_name(atlas, scene)
        if place.is_file():
            continue
        problem = make_replay(ReplayJob(((atlas.run, (scene.id, atlas.planner, scene.seed)),), place))
        if problem is not None:
            print(f"no replay: {problem}", file=sys.stderr)
