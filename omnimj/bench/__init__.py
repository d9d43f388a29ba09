"""How fast the parts are, each as a ratio or a time within one run on this machine."""
