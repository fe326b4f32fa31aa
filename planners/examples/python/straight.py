"""Straight ahead at the present speed, without a library: the planner protocol in JSON lines.

Run: --planner 'exec:python3 straight.py'
"""

import json
import math

AHEAD_S = [0.1 * k for k in range(41)]


def plan(ego: dict[str, float], time_s: float) -> dict[str, object]:
    """Where the car is if it goes on as it does."""
    way_m = [ego["vx_mps"] * ahead_s for ahead_s in AHEAD_S]
    return {
        "type": "plan",
        "time_s": [time_s + ahead_s for ahead_s in AHEAD_S],
        "x_m": [ego["x_m"] + way * math.cos(ego["heading_rad"]) for way in way_m],
        "y_m": [ego["y_m"] + way * math.sin(ego["heading_rad"]) for way in way_m],
        "heading_rad": [ego["heading_rad"]] * len(AHEAD_S),
    }


def main() -> None:
    """Answer until nobody asks any more."""
    with open(3) as requests, open(4, "w", buffering=1) as replies:
        print(json.dumps({"protocol": "interplan-sumo/planner", "versions": [1], "form": "json"}), file=replies)
        requests.readline()  # the welcome
        for line in requests:
            request = json.loads(line)
            answer = plan(request["ego"], request["time_s"]) if request["type"] == "plan" else {"type": "ok"}
            print(json.dumps(answer), file=replies)


if __name__ == "__main__":
    main()
