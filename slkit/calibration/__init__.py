"""Calibrators: from captures of boards to a rig; reached by name through `slkit.registry`."""
