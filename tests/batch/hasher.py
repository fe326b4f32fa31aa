"""Toy tasks that take a while in each phase and give the same hash every time; quick to import, as workers do."""

from __future__ import annotations

import hashlib
import time

from interplan_sumo.batch.tasks import Answer, Publish, Work


def open_hasher(_group: str, publish: Publish) -> Work:
    def work(number: int) -> Answer:
        digest = hashlib.sha256()
        for step in range(10):
            publish("plan")
            digest.update(f"{number} {step}".encode())
            time.sleep(0.001)
            publish("simulate")
            time.sleep(0.001)
        return {"trace_hash": digest.hexdigest()}, None

    return work
