"""Many trials of one thing: done by many processes, kept as they come, counted with bounds."""
