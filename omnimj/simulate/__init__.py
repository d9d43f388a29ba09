"""Simulated runs: the loop that drives a plant, scenarios, and what is made of a run.

- `loop`: the step generator and the trace that it records.
- `compiled`: the same loop as one compiled function.
- `driving`: robots driven along references or at wheel speeds, rigs driven by currents, by one of the two.
- `kinematic`: the kinematic level, a plant without forces.
- `run`: runs a scenario; `plants` and `detectors` make what it needs.
- `metrics`, `judging`, `summary`: metrics, scores of the diagnoses, and `metrics.json`.
- `scenario`: scenario files and their checks.
- `suites`: test plans that are recorded as datasets.
- `teleop`: driving by hand.
"""
