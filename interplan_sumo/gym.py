"""Gym: the benchmark as gymnasium environments: the same loop, traffic and score, with a policy as the planner.

Importing this module registers `interplan_sumo/Scenario-v0`, one id per suite (`interplan_sumo/Smoke-v0`) and one
per family (`interplan_sumo/Nudge-v0`, `interplan_sumo/LaneChangeHtd-v0`).
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise ImportError("interplan_sumo.gym needs gymnasium; run: pip install 'interplan-sumo[gym]'") from error

from interplan_sumo.batch.custom_references import keep_certified, own_expert
from interplan_sumo.batch.jobs import Selection
from interplan_sumo.batch.options import SCENE_OPTIONS, RunOptions
from interplan_sumo.errors import InputError, PlannerError, TrafficError, UnknownNameError, check_names
from interplan_sumo.extras import need_matplotlib
from interplan_sumo.families import names
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.drivable_area import drivable_area
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.profile import DEFAULT_PROFILE, find_profile
from interplan_sumo.metrics.score import score
from interplan_sumo.policy import (
    ACTIONS,
    OBSERVED,
    ActionForm,
    Arrays,
    ObservationForm,
    Senses,
    plan_of,
    speed_limit_mps,
    vector_of,
)
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import expert, suites
from interplan_sumo.simulation.episode import Loop
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.simulation.traffic import Traffic
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace

PROGRESS_PER_M = 0.1
"""Reward for a metre along the route, up to the goal; as much is lost by backing."""
OVERSPEED_PER_MPS = -0.1
"""For each step and each m/s above the limit of the lane."""
GOAL_REACHED = 10.0
FAILED = -10.0
"""For a collision at fault, for leaving the drivable area and for an action that cannot be followed."""

PICTURE_PX = (800, 500)
PICTURE_M = 120.0
"""How wide a rendered picture is."""

Seen = Arrays | dict[str, Arrays]


class ScenarioEnv(gymnasium.Env[Seen, Arrays]):
    """One scenario per episode, 0.1 s per step, scored as `run` scores it.

    Terminated at the goal and, unless `stop_at_failure` is False, at a
    collision at fault and off the drivable area; always by an action that
    cannot be followed. Truncated when the scenario's time is up. TrafficError
    if SUMO gives up: `reset` again.

    SUMO runs one simulation per process. The environment that is reset last
    has it; `step` of any other is refused until it is reset in turn. Use
    `gymnasium.vector.AsyncVectorEnv` to have several at a time.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10}  # type: ignore[misc]

    def __init__(
        self,
        suite: str | None = None,
        scenarios: str | Sequence[str] = (),
        *,
        observation: ObservationForm = "vector",
        action: ActionForm = "acceleration_steering",
        stop_at_failure: bool = True,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """`scenarios` are ids, globs or YAML files, as `run` takes them; an episode draws one of them.

        Further options are those of `run` that say what is driven: `seeds` N
        draws traffic with the seeds 0 to N-1, of which 0 is the certified one;
        `density`, `behaviour`, `perception`, `traffic`, `profile`. InputError for anything
        that cannot be used.
        """
        wanted = RunOptions.of({"suite": suite, "scenarios": scenarios, **options}, names=SCENE_OPTIONS)
        for what, given, known in (
            ("observation", observation, ("vector", "dict")),
            ("action", action, ACTIONS),
            ("render mode", render_mode or "rgb_array", self.metadata["render_modes"]),
        ):
            if given not in known:
                raise UnknownNameError(what, given, known)
        selection = Selection.of(wanted)
        source = selection.source
        self._overrides = wanted.overrides
        self._own_experts: Path | None = None
        """Where the experts of scenarios of one's own lie."""
        if not source.official:
            self._own_experts = Path(tempfile.mkdtemp(prefix="interplan-sumo-"))
            weakref.finalize(self, shutil.rmtree, self._own_experts, ignore_errors=True)
            keep_certified(source.scenarios, selection.files, self._own_experts)
        self.scenarios = {each.id: each for each in selection.scenarios}
        """What may be drawn, by id."""
        self.seeds = wanted.seeds
        self.profile = find_profile(wanted.profile or DEFAULT_PROFILE)
        self.stop_at_failure = stop_at_failure
        self.render_mode = render_mode
        self._observation: ObservationForm = observation
        self._action: ActionForm = action
        bounds = {part.name: spaces.Box(*part.bounds) for part in OBSERVED}
        low, high = (vector_of({n: getattr(box, end) for n, box in bounds.items()}) for end in ("low", "high"))
        self.observation_space = spaces.Dict(bounds) if observation == "dict" else spaces.Box(low, high)  # type: ignore[assignment]
        self.action_space = spaces.Box(*ACTIONS[action])
        self._loop: Loop | None = None
        self._is_over = True

    # --- gymnasium's methods -------------------------------------------------------------------

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """A new episode; `options` may name the `scenario` (its id) and the traffic's `seed` instead of chance."""
        super().reset(seed=seed)
        self.scenario, self.traffic_seed = self._drawn(options or {})
        self._roads = load_roads(self.scenario.map, self.scenario.maps_beside)
        self._expert = self._expert_drive()
        _close_traffic()
        traffic = open_traffic(
            self.scenario, self._roads, seed=self.traffic_seed, vehicle_types=self._overrides.vehicle_types
        )
        _hold(self, traffic)
        self._behaviours = traffic.behaviours
        self._loop = loop = Loop(self.scenario, self._roads, traffic, seed=self.traffic_seed)
        self._is_over = False
        self._senses = Senses(loop.open(), loop.observation)
        self._touched: set[str] = set()
        self._arc_m = self._progress_m(loop)
        loop.begin_frame()
        return self._seen(loop), self._told(loop)

    def step(self, action: Arrays) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Drive 0.1 s along the plan that the action stands for."""
        loop = self._driving()
        try:
            loop.advance(plan_of(action, loop.ego, self._action, loop.shape))
            goes_on = loop.begin_frame()
        except PlannerError as error:
            return self._seen(loop), FAILED, True, False, self._ended(loop) | {"score": 0.0, "fault": str(error)}
        except TrafficError:
            self._end()
            raise
        failed = goes_on and self.stop_at_failure and self._has_failed(loop)
        terminated, truncated = loop.reached_goal or failed, not goes_on and not loop.reached_goal
        reward = self._reward(loop) + GOAL_REACHED * loop.reached_goal + FAILED * failed
        told = self._ended(loop) if terminated or truncated else self._told(loop)
        return self._seen(loop), reward, terminated, truncated, told

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """(500, 800, 3) the scene from above, the ego driving to the right; None without a render mode."""
        if self.render_mode is None:
            return None
        if self._loop is None:
            raise gymnasium.error.ResetNeeded("there is nothing to render; call reset() before render()")
        return _picture(self._loop, self._behaviours)

    def close(self) -> None:
        """End the episode and SUMO with it; may be called twice."""
        if _holder() is self:
            self._end()

    # --- the episode ---------------------------------------------------------------------------

    def _drawn(self, options: Mapping[str, Any]) -> tuple[Scenario, int]:
        """The scenario, overridden as asked, and the traffic's seed."""
        check_names("option of reset()", options, ("scenario", "seed"))
        ids = list(self.scenarios)
        scenario_id, seed = ids[int(self.np_random.integers(len(ids)))], int(self.np_random.integers(self.seeds))
        scenario_id, seed = options.get("scenario", scenario_id), int(options.get("seed", seed))
        if scenario_id not in self.scenarios:
            raise UnknownNameError("scenario in this environment", scenario_id, ids)
        return self._overrides.applied(self.scenarios[scenario_id]), seed

    def _expert_drive(self) -> EgoTrack:
        """What progress is measured against; of one's own scenario it may have to be driven, which opens SUMO."""
        if self._own_experts is None:
            return expert(self.scenario)
        _close_traffic()
        return own_expert(self.scenario, self._own_experts)

    def _driving(self) -> Loop:
        """The loop, if the episode goes on."""
        if self._loop is None or self._is_over:
            raise gymnasium.error.ResetNeeded("there is no episode to drive on; call reset() before step()")
        if _holder() is not self:
            raise InputError(
                "the episode was ended by the reset() of another environment: SUMO runs one simulation per process; "
                "reset() this one, or give each a process of its own with gymnasium.vector.AsyncVectorEnv"
            )
        return self._loop

    def _end(self) -> None:
        self._is_over = True
        _close_traffic()

    def _ended(self, loop: Loop) -> dict[str, Any]:
        """End the episode; what is told in its last step."""
        trace = loop.trace()
        self._end()
        assert trace is not None, "reset() begins the first frame"
        sheet = score(trace, self._roads, self._expert, self.scenario, self.profile)
        return self._told(loop) | {
            "score": sheet.score,
            "metrics": {name: result.score for name, result in sheet.metrics.items() if result.score is not None},
            "reasons": sheet.reasons(),
            "reached_goal": loop.reached_goal,
            "trace_hash": trace.hash(),
            "fault": None,
        }

    def _told(self, loop: Loop) -> dict[str, Any]:
        return {
            "scenario": self.scenario.id,
            "traffic_seed": self.traffic_seed,
            "time_s": loop.ego.time_s,
            "progress_m": self._arc_m,
        }

    def _seen(self, loop: Loop) -> Seen:
        parts = self._senses.parts(loop.observation)
        return parts if self._observation == "dict" else vector_of(parts)

    def _progress_m(self, loop: Loop) -> float:
        """Arc length on the route's line, up to the goal."""
        return min(loop.route.project_point(loop.ego.x_m, loop.ego.y_m)[0], loop.goal_m)

    def _reward(self, loop: Loop) -> float:
        before_m, self._arc_m = self._arc_m, self._progress_m(loop)
        limit_mps = speed_limit_mps(self._roads, loop.ego)
        over_mps = 0.0 if limit_mps is None else max(0.0, loop.ego.speed_mps - limit_mps)
        return PROGRESS_PER_M * (self._arc_m - before_m) + OVERSPEED_PER_MPS * over_mps

    def _has_failed(self, loop: Loop) -> bool:
        """Whether the present frame holds a new collision at fault or a corner off the drivable area."""
        now = EgoTrack.of([loop.ego])
        scene = ActorTable.of([loop.scene.actors])
        frame = Trace(now, scene, (loop.scene.signals,), (), np.zeros(0), loop.shape)
        facts = Facts(frame, self._roads, now, self.scenario)
        new = [each for each in facts.collisions if each.track not in self._touched]
        self._touched |= {each.track for each in new}
        return any(each.at_fault for each in new) or drivable_area(facts).score == 0.0


# --- one simulation per process ------------------------------------------------------------------


_held: tuple[weakref.ref[ScenarioEnv], Traffic] | None = None
"""Who drives in this process, and in which traffic."""


def _hold(env: ScenarioEnv, traffic: Traffic) -> None:
    global _held
    _held = (weakref.ref(env), traffic)


def _holder() -> ScenarioEnv | None:
    return None if _held is None else _held[0]()


def _close_traffic() -> None:
    """Close what any environment of this process has open, though the environment itself may be gone."""
    global _held
    if _held is not None:
        _held[1].close()
        _held = None


# --- the picture ---------------------------------------------------------------------------------


def _picture(loop: Loop, behaviours: Mapping[str, str]) -> NDArray[np.uint8]:
    """The present scene in the colours of `scenarios render`."""
    need_matplotlib("rendering")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from interplan_sumo.report.scenario_drawing import (
        EGO,
        PERSON,
        View,
        behaviour_colours,
        draw_agents,
        draw_obstacles,
        draw_roads,
        draw_route,
    )

    width, height = PICTURE_PX
    scale = width / PICTURE_M
    ego, actors = loop.ego, loop.scene.actors
    view = View(ego.x_m, ego.y_m, ego.heading_rad, PICTURE_M, height / scale, scale)
    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    draw_roads(axes, loop.roads, view)
    draw_route(axes, loop.scenario, loop.roads, view)
    draw_obstacles(axes, loop.scenario, loop.roads, view)
    draw_agents(axes, actors, behaviours, view, behaviour_colours(behaviours.values()))
    for corners in actors.corners[actors.kind == ActorKind.PEDESTRIAN]:
        axes.fill(*view.points(corners).T, facecolor=PERSON, edgecolor="white", linewidth=0.4, zorder=7.6)
    axes.fill(*view.points(ego.corners(loop.shape)).T, facecolor=EGO, edgecolor="white", linewidth=0.4, zorder=8.0)
    axes.set_xlim(-view.width_m / 2.0, view.width_m / 2.0)
    axes.set_ylim(-view.height_m / 2.0, view.height_m / 2.0)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


# --- registration --------------------------------------------------------------------------------


def _register() -> None:
    """`Scenario-v0`, and an id for each suite and family."""
    made: dict[str, dict[str, Any]] = {"Scenario": {}}
    made |= {_title(key.partition("==")[0]): {"suite": key} for key in suites()}
    made |= {_title(name): {"scenarios": f"{name}/*"} for name in names(ordinary=False)}
    for name, arguments in made.items():
        gymnasium.register(f"interplan_sumo/{name}-v0", "interplan_sumo.gym:ScenarioEnv", kwargs=arguments)


def _title(name: str) -> str:
    """`LaneChangeHtd` of `lane_change_htd`, `InterplanLarge` of `interplan-large`."""
    return "".join(word.capitalize() for word in name.replace("-", "_").split("_"))


_register()
