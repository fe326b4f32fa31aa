"""How the ego moves: nuPlan's LQR tracker and kinematic bicycle.

`lqr.follow(state, plan, dt_s, shape) -> EgoState` drives one step;
`batch.follow_all` follows many plans at once, for planners that simulate what they propose.
The rest of the program speaks of the box centre; only this package knows the
rear axle, at which nuPlan defines tracker and bicycle.
"""
