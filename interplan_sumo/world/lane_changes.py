"""How many lane changes a route still asks for, lane by lane."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from interplan_sumo.world.roads import Roads


def lane_changes_needed(roads: Roads, route: Iterable[str], goal_lane: str) -> dict[str, int]:
    """Fewest lane changes to the goal lane from each lane and connector of the route from which a way leads there.

    `route` are roadblock ids. Going on to a successor costs nothing, going to a
    neighbour lane one, and both stay inside the route's roadblocks.
    """
    blocks = set(route)
    needed = {goal_lane: 0}
    queue = deque([goal_lane])
    while queue:  # breadth first from the goal backwards; free steps go to the front of the queue
        here = queue.popleft()
        neighbours = (roads.left_of(here), roads.right_of(here))
        steps = [(lane, 0) for lane in roads.incoming(here)]
        steps += [(lane.id, 1) for lane in neighbours if lane is not None]
        for lane, cost in steps:
            changes = needed[here] + cost
            if roads[lane].roadblock_id in blocks and (lane not in needed or changes < needed[lane]):
                needed[lane] = changes
                (queue.append if cost else queue.appendleft)(lane)
    return needed
