"""Records of segments: written and read back, and refused where they contradict themselves."""

from __future__ import annotations

import msgspec
import pytest

from interplan_sumo.batch.records import Fault, RecordError, encode
from interplan_sumo.endurance.records import EventRecord, RareEventRecord, SegmentRecord, TrafficCell, segment_of

HIT = EventRecord("collision", 12.0, 140.0, "turn", True, "car", "jaywalker", 0.02, 1.0, 2.0)
SEGMENT = SegmentRecord(
    index=3, cell=TrafficCell("us-ma-boston", 0.5, "mixed"), planner="idm", planner_hash=None, seed=3, naive=False,
    start="e1", metres=1500.0, seconds=180.0, weighted_metres=1300.0, weighted_seconds=160.0, final_weight=0.02,
    natural={"jaywalker": 0.001}, drawn_with={"jaywalker": 0.05}, opportunities={"jaywalker": 12},
    rare_events=(RareEventRecord("jaywalker", 9.0, "w1", 1.1, 0.022, {"jaywalker": 3}, "turn"),),
    events=(HIT,), metres_at={"turn": 1500.0}, fault=Fault("planner", "raised"),
)  # fmt: skip


def test_a_segment_is_read_as_it_was_written() -> None:
    assert segment_of(encode(SEGMENT)) == SEGMENT
    assert SEGMENT.begun == {"jaywalker": 1}


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("naive", True, "weight 1"),
        ("drawn_with", {}, "no probability"),
        ("rare_events", [], "none began"),
        ("metres", -1.0, "metres"),
        ("start", None, "start"),
    ],
)
def test_a_segment_that_contradicts_itself_is_refused(field: str, value: object, said: str) -> None:
    fields = msgspec.to_builtins(SEGMENT) | {field: value}
    with pytest.raises(RecordError, match=said):
        segment_of(msgspec.json.encode(fields))
