"""Learned planners: networks trained on ordinary driving, driven with onnxruntime.

How one is made, by the example of `pdm_open`. Nothing shared is edited.

| module | holds |
|---|---|
| `pdm_open/planner.py` | the planner and `inputs(arrays)`, what the network is given; no torch |
| `tools/train/models/pdm_open.py` | `recipe(size, **options)`: network, loss, what of a sample to keep; torch |
| `pdm_open/pdm_open.json` and `.onnx` | model card and network, both written by the training |

Everything is a dict of arrays whose first axis is the sample: `inputs` is the same function for a batch of training
samples and for the single one of `plan()` (`driving.one_sample`). Its arrays are those of
`interplan_sumo.features.schema`. A plan is `driving.POSES` poses of the rear axle in the ego frame, `driving.STEP_S`
apart, which `driving.plan_through` turns into what `plan()` returns.

    class PdmOpenPlanner:
        def __init__(self, weights="pdm_open"):
            self._network = load_network("pdm_open", weights)

        def start(self, mission):
            self._view = EgoView(mission)

        def plan(self, observation):
            outputs = self._network.run(inputs(one_sample(self._view.arrays(observation))))
            return plan_through(outputs["poses"][0], self._view, seen)

Training, in a checkout: `python -m tools.train pdm_open --data DIR --out DIR`. What a recipe must say is told in
`tools/train/recipe.py`; `tests/learned/test_learned_recipes.py` holds every recipe it finds to it. A method that works
in numpy between two networks (traversals, trees) gives several graphs: `Network.run(inputs, graph="policy")`.
"""
