"""Search for the effects that a model lacks.

- `search`: refit of the base, forward selection, backward elimination
- `selection`: one round of the forward selection
- `judgement`: effects given each other, with the rivals that the data do not rule out
- `elimination`: backward elimination from the model of all effects
- `screening`: first-order gains of candidates, of random curves (decoys) and of free curves
- `strength`: whether an effect is equally strong everywhere, as its law claims
- `cross_validation`: groups of runs, folds, held-out losses and gains
"""
