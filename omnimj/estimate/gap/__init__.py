"""Where simulation and measurement disagree, the missing effect by name, and the model with it."""
