"""Segment worker: how a worker comes to drive segments; SUMO is imported by who drives only."""

from __future__ import annotations

from functools import partial

import msgspec

from interplan_sumo.batch.tasks import Answer, OpenGroup, Publish, Work
from interplan_sumo.endurance.segment_job import SegmentJob, SegmentSettings
from interplan_sumo.scenario.route import forget_lines


def segment_jobs(settings: SegmentSettings) -> OpenGroup:
    """The function that a worker opens with a planner's name; picklable."""
    return partial(_open_planner, settings)


def _open_planner(settings: SegmentSettings, name: str, publish: Publish) -> Work:
    from interplan_sumo.endurance.driving import driven_segment  # only who drives waits for SUMO

    seat = settings.drive.seat(name)

    def work(job: SegmentJob) -> Answer:
        record = driven_segment(job, settings, seat, publish)
        forget_lines()
        return {"segment": msgspec.to_builtins(record)}, record.fault

    return work
