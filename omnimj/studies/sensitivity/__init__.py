"""Which numbers of the model matter to which result of a scenario: what to measure on a robot first."""
