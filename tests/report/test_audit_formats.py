"""The audit as figures: how many scenarios are of a class, and how well that is known."""

from __future__ import annotations

from interplan_sumo.report.audit_formats import audit_json
from interplan_sumo.verification.audit import AuditFinding
from tests.report.rows import drive


def test_shares_have_intervals_for_scenarios_like_these() -> None:
    kinds = ["basic driving"] * 7 + ["unsafe start"] * 3
    found = [(drive(f"nudge/{n}", 1.0), AuditFinding(f"nudge/{n}", kind)) for n, kind in enumerate(kinds)]
    shares = audit_json("mine", "idm", None, found)["shares"]
    assert shares["unsafe start"]["percent"] == 30.0
    low, high = shares["unsafe start"]["ci"]
    assert low < 10.0
    assert 50.0 < high < 100.0
    assert shares["noisy objects"] == {"percent": 0.0, "ci": [0.0, 30.8497]}  # none of ten
    assert audit_json("mine", "idm", None, [])["shares"]["unsafe start"] == {"percent": None, "ci": None}
