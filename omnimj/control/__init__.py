"""The controller: knows measurements and targets, neither MuJoCo nor the wire."""
