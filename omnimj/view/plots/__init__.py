"""Matplotlib figures for reports and README; each function returns one figure.

- `drawing`: shared parts, and SVG for a page.
- `runs`: signals and path of a robot or a rig. `comparison`: methods overlaid.
- `diagnosis`: residuals, diagnoses and modes.
- `mismatch`, `candidates`: gap between twin and recordings, and the candidate effects.
- `identification`: friction curves, and validation overlays.
- `evaluation`, `tuning`, `sensitivity`: studies.
"""
